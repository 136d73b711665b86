"""Ephemerides of any values become frames, and the frames the ephemerides to the last bit that was sent."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from truenorth.formats import navigation_bits as bits
from truenorth.formats.navigation_frames import as_broadcast, frame_start_ns, insert
from truenorth.formats.ubx import parse_ubx
from truenorth.formats.ubx_writer import write_ubx
from truenorth.navigation import KEPLER_COLUMNS, STATE_COLUMNS, MessageType, build_navigation
from truenorth.observations import NO_CHANNEL, Observations, sat_id, signal_id
from truenorth.timescales import BDT_OFFSET_NS, NS_PER_S, NS_PER_WEEK, gpst_from_calendar

FIELDS = {
    "LNAV": (bits.LNAV_FIELDS, bits.LNAV_BITS),
    "INAV": (bits.INAV_FIELDS, bits.INAV_BITS),
    "FNAV": (bits.FNAV_FIELDS, bits.FNAV_BITS),
    "D1": (bits.D1_FIELDS, bits.D1_BITS),
    "D2": (bits.D2_FIELDS, bits.D2_BITS),
    "FDMA": (bits.GLONASS_FIELDS, bits.GLONASS_BITS),
}
MESSAGES = [("G05", "LNAV"), ("J03", "LNAV"), ("E11", "INAV"), ("E11", "FNAV"), ("C21", "D1"), ("C03", "D2")]
ANGLES = ("m0_rad", "omega0_rad", "omega_rad", "i0_rad")


def limits(field):
    """Least and greatest whole number that a field holds."""
    length = sum(count for _, _, count in field.runs)
    half = 1 << (length - 1)
    return {"u": (0, 2 * half - 1), "s": (-half, half - 1), "m": (1 - half, half - 1)}[field.kind]


@given(st.data())
@pytest.mark.parametrize("message", FIELDS)
def test_what_is_inserted_is_extracted(message, data):
    """All fields together: none writes over another."""
    fields, n_bits = FIELDS[message]
    frames = {run[0]: 0 for field in fields.values() for run in field.runs}
    numbers = {name: data.draw(st.integers(*limits(field))) for name, field in fields.items()}
    for name, field in fields.items():
        insert(frames, field, n_bits, numbers[name] * field.scale)
    for name, field in fields.items():
        assert bits.extract(frames, field, n_bits) == numbers[name] * field.scale, name
    assert all(0 <= frame < 1 << n_bits for frame in frames.values())


@given(st.data())
def test_what_has_no_room_is_refused(data):
    fields, n_bits = FIELDS[data.draw(st.sampled_from(list(FIELDS)))]
    name = data.draw(st.sampled_from(sorted(fields)))
    low, high = limits(fields[name])
    number = data.draw(st.sampled_from([low - 1, high + 1, 3 * low - 3, 3 * high + 3]))
    frames = {run[0]: 0 for run in fields[name].runs}
    with pytest.raises(ValueError, match="has no room"):
        insert(frames, fields[name], n_bits, number * fields[name].scale)


def through_a_log(path, navigation, sat, time_ns):
    observations = Observations(
        time_ns=np.array([time_ns]), epoch_start=np.array([0, 1]), sat=np.array([sat], np.int16),
        signal=np.array([signal_id("2I" if sat // 100 == 3 else "1C")], np.int16), code_m=np.array([2.2e7]),
        phase_cyc=np.array([1.1e8]), doppler_hz=np.array([0.0]), cn0_dbhz=np.array([45.0]),
        lli=np.zeros(1, np.uint8), clock_offset_s=np.array([np.nan]),
        glonass_channel=np.full(100, NO_CHANNEL, np.int8),
    )  # fmt: skip
    assert write_ubx(path, observations, navigation) == {}
    return parse_ubx(path.read_bytes())[1]


@st.composite
def ephemerides(draw, name, message):
    """A Keplerian ephemeris within the range of its message, not on its grid; toe anywhere near the time."""
    system = sat_id(name) // 100
    fields = FIELDS[message][0]
    values = dict.fromkeys(KEPLER_COLUMNS, 0.0)
    for column in KEPLER_COLUMNS:
        if column in fields:
            low, high = limits(fields[column])
            values[column] = draw(st.floats(low + 0.5, high - 0.5)) * fields[column].scale
        if column in ANGLES:
            values[column] = draw(st.floats(-10.0, 10.0))
    values["sqrt_a"] = draw(st.floats(5000.0, 6600.0))
    values["eccentricity"] = draw(st.floats(0.0, 0.4))
    values["ura_m"] = draw(st.sampled_from([np.nan, 2.0, 2.8, 4.0, 3.12, 0.5]))
    values["fit_interval_s"] = 7_200.0 if system == 4 else 14_400.0
    step_s = {0: 16, 4: 16, 2: 60, 3: 8}[system]
    time_ns = draw(st.integers(1900 * NS_PER_WEEK, 2600 * NS_PER_WEEK))
    own_ns = BDT_OFFSET_NS if system == 3 else 0
    step_ns = step_s * NS_PER_S
    toe_ns, toc_ns = (
        (time_ns + draw(st.integers(-(10**13), 10**13)) - own_ns) // step_ns * step_ns + own_ns
        for _ in range(2)
    )
    issue = draw(st.integers(0, 31 if system == 3 else 255))
    times = (toe_ns, toc_ns, toe_ns)
    row = (sat_id(name), int(MessageType[message]), *times, issue, issue, 0, list(values.values()))
    return row, time_ns


@given(data=st.data())
@pytest.mark.parametrize(("name", "message"), MESSAGES)
def test_kepler_elements_to_half_a_bit(tmp_path_factory, name, message, data):
    row, time_ns = data.draw(ephemerides(name, message))
    path = tmp_path_factory.mktemp("log") / "a.ubx"
    once = through_a_log(path, build_navigation([row]), sat_id(name), time_ns)
    assert len(once.kepler) == 1
    eph, fields = once.kepler, FIELDS[message][0]
    assert (eph.toe_ns[0], eph.toc_ns[0], eph.message[0]) == (row[2], row[3], row[1])
    assert (eph.iode[0], eph.iodc[0], eph.health[0]) == (row[5], row[6], 0)
    sent_ns = int(eph.transmission_ns[0]) - frame_start_ns(sat_id(name) // 100, time_ns)
    assert sent_ns == {"LNAV": 6, "INAV": 24, "FNAV": 0, "D1": 0, "D2": 0}[message] * NS_PER_S
    for column, value in zip(KEPLER_COLUMNS, row[-1], strict=True):
        if column not in fields or (column == "tgd_s" and eph.column(column)[0] == 0.0):
            continue  # the least delay of LNAV means that there is none
        difference = eph.column(column)[0] - value
        if column in ANGLES:
            difference = (difference + np.pi) % (2 * np.pi) - np.pi
        # Half a bit, the rounding of the value, and pi with 14 digits.
        assert abs(difference) <= 0.5 * abs(fields[column].scale) * (1 + 1e-9) + 4e-13 * (column in ANGLES), (
            column
        )
    # What was sent once is sent again unchanged, and is what rounding alone makes of it.
    rounded = as_broadcast(build_navigation([row])).kepler.elements[0]
    sent = [KEPLER_COLUMNS.index(column) for column in KEPLER_COLUMNS if column in fields]
    sent.remove(KEPLER_COLUMNS.index("tgd_s"))
    np.testing.assert_array_equal(eph.elements[0][sent], rounded[sent])
    again = through_a_log(path, once, sat_id(name), time_ns)
    np.testing.assert_array_equal(again.kepler.elements, once.kepler.elements)


@given(data=st.data(), quarter=st.integers(1, 95), channel=st.integers(-7, 6))
def test_glonass_states_to_half_a_bit(tmp_path_factory, data, quarter, channel):
    fields = FIELDS["FDMA"][0]
    values = []
    for column in STATE_COLUMNS:
        low, high = limits(fields[column])
        values.append(data.draw(st.floats(low + 0.5, high - 0.5)) * fields[column].scale)
    values[:3] = (np.array([0.7, -0.5, 0.5]) * data.draw(st.floats(2.3e7, 2.7e7))).tolist()
    toe_ns = gpst_from_calendar(2023, 9, 19) + (18 - 3 * 3600 + 900 * quarter) * NS_PER_S
    time_ns = toe_ns + data.draw(st.integers(-6 * 3600, 6 * 3600)) * NS_PER_S
    health = data.draw(st.integers(0, 3))
    row = (sat_id("R07"), toe_ns, toe_ns, channel, health, values)
    path = tmp_path_factory.mktemp("log") / "a.ubx"
    once = through_a_log(path, build_navigation([], [row]), sat_id("R07"), time_ns)
    if len(once.states) == 0:  # the frame began more than six hours from the reference time
        assert abs(toe_ns - frame_start_ns(1, time_ns)) > 6 * 3600 * NS_PER_S
        return
    eph = once.states
    assert (eph.toe_ns[0], eph.channel[0], eph.health[0]) == (toe_ns, channel, health)
    assert eph.transmission_ns[0] == frame_start_ns(1, time_ns)
    steps = np.array([abs(fields[column].scale) for column in STATE_COLUMNS])
    assert np.all(np.abs(eph.states[0] - values) <= 0.5 * steps * (1 + 1e-9))
    np.testing.assert_array_equal(as_broadcast(build_navigation([], [row])).states.states, eph.states)
    again = through_a_log(path, once, sat_id("R07"), time_ns)
    np.testing.assert_array_equal(again.states.states, eph.states)
