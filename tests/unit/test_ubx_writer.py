"""The UBX writer: what a log can hold comes back, and what it cannot hold is said."""

from dataclasses import replace

import numpy as np
import pytest

from truenorth.errors import FormatError
from truenorth.formats import UbxWriter, read, write_ubx
from truenorth.formats.navigation_frames import as_broadcast, frame_start_ns, lnav_words
from truenorth.formats.ubx import find_frames, parse_ubx
from truenorth.formats.ubx_writer import encode_frame
from truenorth.navigation import KEPLER_COLUMNS, STATE_COLUMNS, MessageType, build_navigation
from truenorth.observations import (
    LLI_HALF_CYCLE,
    LLI_SLIP,
    NO_CHANNEL,
    ObservationMeta,
    Observations,
    sat_id,
    sat_name,
    signal_id,
    signal_name,
)
from truenorth.timescales import BDT_OFFSET_NS, NS_PER_S, gpst_from_calendar

START_NS = gpst_from_calendar(2024, 6, 24, 8, 20, 7.0)


def make(epochs, *, step_ns=NS_PER_S, start_ns=START_NS, channel=None, **meta):
    """Observations of lists of (satellite, signal, code, phase, Doppler, C/N0, lli)."""
    epochs = [
        sorted(epoch, key=lambda row: (sat_id(row[0]), signal_id(row[1]))) for epoch in epochs
    ]  # the order of the container
    rows = [row for epoch in epochs for row in epoch]
    table = np.full(100, NO_CHANNEL, dtype=np.int8)
    for slot, number in (channel or {}).items():
        table[slot] = number
    values = np.array([row[2:6] for row in rows], dtype=float).reshape(-1, 4)
    return Observations(
        time_ns=start_ns + step_ns * np.arange(len(epochs), dtype=np.int64),
        epoch_start=np.concatenate(([0], np.cumsum([len(epoch) for epoch in epochs]))).astype(np.int64),
        sat=np.array([sat_id(row[0]) for row in rows], dtype=np.int16),
        signal=np.array([signal_id(row[1]) for row in rows], dtype=np.int16),
        code_m=values[:, 0].copy(),
        phase_cyc=values[:, 1].copy(),
        doppler_hz=values[:, 2].copy(),
        cn0_dbhz=values[:, 3].copy(),
        lli=np.array([row[6] for row in rows], dtype=np.uint8),
        clock_offset_s=np.full(len(epochs), np.nan),
        glonass_channel=table,
        meta=ObservationMeta(**meta),
    )


def row(sat, signal, *, code=2.2e7 + 1 / 3, phase=1.1e8 + 1 / 7, doppler=-1234.5, cn0=45.0, lli=0):
    return sat, signal, code, phase, doppler, cn0, lli


def back(tmp_path, observations, navigation=None):
    path = tmp_path / "a.ubx"
    skipped = write_ubx(path, observations, navigation)
    return *read(path), skipped


def test_a_known_frame():
    """The poll of the receiver's version, as the interface description's checksum gives it."""
    assert encode_frame(0x0A04, b"") == bytes.fromhex("B5620A0400000E34")


def test_values_come_back_as_the_message_holds_them(tmp_path):
    wanted = make(
        [
            [row("G05", "1C"), row("R07", "2C", cn0=38.6), row("E11", "5Q", doppler=0.1)],
            [row("G05", "1C", phase=np.nan), row("G06", "2L", code=np.nan, cn0=np.nan, doppler=np.nan)],
            [],
        ],
        channel={7: -7},
        receiver_type="SIMULATED",
        receiver_firmware="0.1",
        approx_position_ecef_m=(-3817680.731, 3562839.524, 3650159.236),
        leap_seconds=18,
    )
    found, navigation, skipped = back(tmp_path, wanted)
    assert skipped == {}
    for name in ("time_ns", "epoch_start", "sat", "signal", "code_m", "phase_cyc", "lli", "glonass_channel"):
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), err_msg=name)
    np.testing.assert_array_equal(found.doppler_hz, wanted.doppler_hz.astype(np.float32))
    np.testing.assert_array_equal(found.cn0_dbhz, np.rint(wanted.cn0_dbhz))
    assert (found.meta.receiver_type, found.meta.receiver_firmware) == ("SIMULATED", "0.1")
    assert found.meta.approx_position_ecef_m == (-3817680.73, 3562839.52, 3650159.24)
    assert found.meta.leap_seconds == 18
    assert len(navigation.kepler) == len(navigation.states) == 0


SIGNALS = {
    "G": "1C 2L 2S 5I 5Q", "R": "1C 2C", "E": "1C 1B 5I 5Q 7I 7Q 6B 6C 6A", "C": "2I 7I 6I 1P 1D 5P 5D",
    "J": "1C 1Z 2S 2L 5I 5Q 1E", "S": "1C", "I": "5A",
}  # fmt: skip


@pytest.mark.parametrize("sat", ["G32", "R24", "E36", "C21", "C03", "C61", "J07", "S37", "I14"])
def test_every_signal_has_its_code(tmp_path, sat):
    names = SIGNALS[sat[0]].split()
    found, _, skipped = back(tmp_path, make([[row(sat, name) for name in names]], channel={24: 6}))
    assert skipped == {}
    assert {sat_name(s) for s in found.sat.tolist()} == {sat}
    assert {signal_name(s) for s in found.signal.tolist()} == set(names)


def test_combined_tracking_is_written_as_the_pilot_unless_that_is_there(tmp_path):
    observations = make([[row("G05", "2X"), row("E11", "5X"), row("E11", "5Q", phase=7.0), row("C21", "2X")]])
    found, _, skipped = back(tmp_path, observations)
    names = [f"{sat_name(s)} {signal_name(g)}" for s, g in zip(found.sat, found.signal, strict=True)]
    assert names == ["G05 2L", "E11 5Q", "C21 2I"]
    assert found.phase_cyc[1] == 7.0
    assert skipped == {"E 5X": 1}


def test_what_has_no_code_is_counted(tmp_path):
    observations = make(
        [[row("G05", "1C"), row("G05", "2W"), row("R07", "1C"), row("R08", "1C")]] * 3, channel={8: 1}
    )
    found, _, skipped = back(tmp_path, observations)
    assert found.n_rows == 6
    assert skipped == {"G 2W": 3, "R 1C": 3}


def lli_through(tmp_path, flags, *, sizes=(99,), step_ns=NS_PER_S, missing=()):
    """Flags of one signal, epoch by epoch, through a log that is written in blocks of these sizes."""
    epochs = [[] if k in missing else [row("G05", "1C", lli=flag)] for k, flag in enumerate(flags)]
    observations = make(epochs, step_ns=step_ns)
    path = tmp_path / "a.ubx"
    with UbxWriter(path) as writer:
        first = 0
        while first < observations.n_epochs:
            size = sizes[first % len(sizes)]
            writer.write_block(observations.select_epochs(slice(first, first + size)))
            first += size
    return read(path)[0].lli.tolist()


@pytest.mark.parametrize("sizes", [(99,), (1,), (2,), (3, 1, 2)])
def test_slips_and_half_cycles_come_back(tmp_path, sizes):
    flags = [LLI_SLIP, 0, 0, LLI_SLIP, LLI_SLIP, 0, LLI_HALF_CYCLE, LLI_SLIP | LLI_HALF_CYCLE, 0, 0]
    assert lli_through(tmp_path, flags, sizes=sizes) == flags
    assert lli_through(tmp_path, [0, 0, LLI_SLIP, 0], sizes=sizes, step_ns=50_000_000) == [0, 0, LLI_SLIP, 0]
    # Away for a while without a slip, and with one.
    assert lli_through(tmp_path, [0] * 6, sizes=sizes, missing=(2, 3)) == [0] * 4
    assert lli_through(tmp_path, [0, 0, 0, 0, LLI_SLIP, 0], sizes=sizes, missing=(2, 3)) == [
        0,
        0,
        LLI_SLIP,
        0,
    ]


def test_a_slip_without_a_phase_marks_the_next_phase(tmp_path):
    epochs = [[row("G05", "1C")], [row("G05", "1C", phase=np.nan, lli=LLI_SLIP)], [row("G05", "1C")]]
    found, _, _ = back(tmp_path, make(epochs))
    assert found.lli.tolist() == [0, 0, LLI_SLIP]


def test_refusals(tmp_path):
    observations = make([[row("G05", "1C")]])
    with UbxWriter(tmp_path / "a.ubx") as writer:
        writer.write_block(observations)
        writer.write_block(observations.select_epochs(slice(0, 0)))
        with pytest.raises(FormatError, match="not later than the one before"):
            writer.write_block(observations)
    signals = "G 1C, G 2L, G 5Q, E 1C, E 5Q, E 7Q, C 2I, C 5P, C 7I".split(", ")
    crowd = [row(f"{name[0]}{n:02d}", name[2:]) for name in signals for n in range(1, 33)]
    with pytest.raises(FormatError, match="has 288 measurements and RXM-RAWX holds 255"):
        write_ubx(tmp_path / "b.ubx", make([crowd]))
    with pytest.raises(FormatError, match="cannot be written"):
        UbxWriter(tmp_path / "nowhere" / "a.ubx")


# ---------------------------------------------------------------------------------- navigation bits

TOE_NS = gpst_from_calendar(2024, 6, 24, 8)
ELEMENTS = dict.fromkeys(KEPLER_COLUMNS, 0.0) | {
    "sqrt_a": 5153.5, "eccentricity": 0.01, "i0_rad": 0.95, "ura_m": 2.0, "fit_interval_s": 14_400.0
}  # fmt: skip
STATE = dict.fromkeys(STATE_COLUMNS, 0.0) | {"x_m": 2.5e7, "vy_mps": -3000.0, "az_mps2": 2.8e-6}


def kepler(sat, message, *, toe_ns=TOE_NS, sent_ns=TOE_NS - 7200 * NS_PER_S, **elements):
    values = list((ELEMENTS | elements).values())
    if sat[0] == "C":
        toe_ns += BDT_OFFSET_NS
    return (sat_id(sat), int(message), toe_ns, toe_ns, sent_ns, 7, 7, 0, values)


def state(sat, *, toe_ns, channel=1):
    return (sat_id(sat), toe_ns, toe_ns - 900 * NS_PER_S, channel, 0, list(STATE.values()))


def frames_of(path):
    """(gnssId, svId, sigId, words) of every RXM-SFRBX, and the number of RXM-RAWX before it."""
    data = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    offset, length, kind, n_damaged = find_frames(data)
    assert n_damaged == 0
    found, epochs = [], 0
    for at, size, what in zip(offset.tolist(), length.tolist(), kind.tolist(), strict=True):
        epochs += what == 0x0215
        if what == 0x0213:
            payload = data[at + 6 : at + 6 + size]
            found.append((*payload[:3].tolist(), epochs, payload[8:].view("<u4").tolist()))
    return found


def test_frames_come_with_the_first_epoch_and_every_30_s(tmp_path):
    navigation = build_navigation([kepler("G05", MessageType.LNAV), kepler("C21", MessageType.D1)])
    observations = make([[row("G05", "1C"), row("C21", "2I")]] * 70)  # from 7 s after a GPS frame
    path = tmp_path / "a.ubx"
    assert write_ubx(path, observations, navigation) == {}
    found = frames_of(path)
    # Frames of GPS end 23 s later and again after 30 s; those of BeiDou 14 s after those of GPS.
    assert [frame[3] for frame in found if frame[0] == 0] == [1] * 3 + [24] * 3 + [54] * 3
    assert [frame[3] for frame in found if frame[0] == 3] == [1] * 3 + [8] * 3 + [38] * 3 + [68] * 3
    _, again = read(path)
    assert again.kepler.toe_ns.tolist() == [TOE_NS, TOE_NS + BDT_OFFSET_NS]
    assert again.kepler.transmission_ns[0] == frame_start_ns(0, START_NS) + 6 * NS_PER_S


def test_only_satellites_in_view_send_and_the_ephemeris_closest_in_time(tmp_path):
    times = [TOE_NS - 7200 * NS_PER_S, TOE_NS, TOE_NS + 7200 * NS_PER_S]
    navigation = build_navigation(
        [kepler(sat, MessageType.LNAV, toe_ns=t, sqrt_a=5153.5 + k)
         for sat in ("G05", "G06") for k, t in enumerate(times)]
    )  # fmt: skip
    _, found, _ = back(tmp_path, make([[row("G05", "1C")]] * 3), navigation)
    assert found.kepler.sat.tolist() == [5]
    assert found.kepler.toe_ns.tolist() == [TOE_NS]


def test_of_one_reference_time_the_last_message_counts(tmp_path):
    rows = [
        kepler("G05", MessageType.LNAV, sent_ns=TOE_NS - k * 3600 * NS_PER_S, sqrt_a=5153.0 + k)
        for k in (2, 1)
    ]
    _, found, _ = back(tmp_path, make([[row("G05", "1C")]]), build_navigation(rows))
    assert found.kepler.column("sqrt_a").tolist() == [5154.0]


def test_ionosphere_and_leap_seconds(tmp_path):
    steps = 2.0 ** np.array([-30, -27, -24, -24, 11, 14, 16, 16])
    coefficients = np.array([3.0, -2.0, 1.0, 127.0, -128.0, 5.0, 0.0, 1.0]) * steps
    navigation = build_navigation(
        [kepler("G05", MessageType.LNAV), kepler("E11", MessageType.INAV), kepler("C21", MessageType.D1)],
        klobuchar={"G": coefficients, "C": -coefficients / 2},
        nequick=np.array([161.75, 0.66015625, 0.01937866]),
    )
    observations = make([[row("G05", "1C"), row("E11", "1C"), row("C21", "2I")]])
    _, found, skipped = back(tmp_path, observations, navigation)
    assert skipped == {}
    np.testing.assert_array_equal(found.klobuchar["G"], coefficients)
    assert np.all(np.abs(found.klobuchar["C"] + coefficients / 2) <= steps / 2)
    for letter, values in as_broadcast(navigation).klobuchar.items():
        np.testing.assert_array_equal(found.klobuchar[letter], values)
    np.testing.assert_allclose(found.nequick, navigation.nequick, atol=2.0**-16)
    assert found.leap_seconds == 18
    # 12.5 minutes later they come again.
    path = tmp_path / "b.ubx"
    write_ubx(path, make([[row("G05", "1C")]] * 80, step_ns=10 * NS_PER_S), navigation)
    pages = [f for f in frames_of(path) if (f[4][1] >> 8 & 7) == 4]
    assert len(pages) in (2, 3)


def test_glonass_from_the_navigation_data(tmp_path):
    toe_ns = gpst_from_calendar(2024, 6, 24, 8, 15, 18)
    navigation = build_navigation([], [state("R07", toe_ns=toe_ns, channel=-4)])
    observations, found, skipped = back(tmp_path, make([[row("R07", "1C")]] * 2), navigation)
    assert skipped == {}
    assert observations.glonass_channel[7] == -4
    assert found.states.toe_ns.tolist() == [toe_ns]
    assert found.states.channel.tolist() == [-4]
    steps = np.array([1e3 / 2**11] * 3 + [1e3 / 2**20] * 3 + [1e3 / 2**30] * 3 + [2**-30, 2**-40, 2**-30])
    assert np.all(np.abs(found.states.states[0] - list(STATE.values())) <= steps / 2)


def test_what_no_message_can_carry_is_counted_once(tmp_path):
    rows = [
        kepler("G05", MessageType.CNAV),
        kepler("G06", MessageType.LNAV, tgd_s=1e-6),
        kepler("G07", MessageType.LNAV, toe_ns=TOE_NS + NS_PER_S),
        kepler("G08", MessageType.LNAV, toe_ns=TOE_NS - 86_400 * 5 * NS_PER_S),
    ]
    states = [state("R01", toe_ns=gpst_from_calendar(2024, 6, 24, 8, 20, 18)), state("S31", toe_ns=TOE_NS)]
    sats = ["G05", "G06", "G07", "G08", "R01", "S31"]
    observations = make([[row(sat, "1C") for sat in sats]] * 40, channel={1: 1})
    _, found, skipped = back(tmp_path, observations, build_navigation(rows, states))
    assert len(found.kepler) == len(found.states) == 0
    assert skipped == {"G05 CNAV": 1, "G06 LNAV": 1, "G07 LNAV": 1, "R01 FDMA": 1, "S31 SBAS": 1}


def test_midnight_of_moscow_has_no_reference_time(tmp_path):
    """The count of quarter hours begins with 1, so such an ephemeris is never sent."""
    toe_ns = gpst_from_calendar(2024, 6, 24, 21, 0, 18)
    observations = make([[row("R01", "1C")]], channel={1: 1}, start_ns=toe_ns)
    _, found, skipped = back(tmp_path, observations, build_navigation([], [state("R01", toe_ns=toe_ns)]))
    assert (len(found.states), skipped) == (0, {"R01 FDMA": 1})


def test_geostationary_beidou_satellites_send_d2(tmp_path):
    navigation = build_navigation([kepler("C03", MessageType.D1), kepler("C61", MessageType.D2)])
    _, found, _ = back(tmp_path, make([[row("C03", "2I"), row("C61", "2I")]]), navigation)
    assert found.kepler.message.tolist() == [MessageType.D2, MessageType.D2]


def test_words_two_and_ten_of_lnav_end_in_zeros():
    """So the word after the second never depends on it; above each word stand the last bits before it."""
    generator = np.random.default_rng(5)
    for _ in range(50):
        words = lnav_words(int.from_bytes(generator.bytes(30), "big"))
        assert words[2] >> 30 == 0
        assert words[9] & 3 in (0, 3)  # inverted where the ninth ends in a one


def test_blocks_give_the_bytes_of_the_whole(tmp_path):
    navigation = build_navigation([kepler("G05", MessageType.LNAV)])
    observations = make([[row("G05", "1C", lli=k % 7 == 0)] for k in range(40)])
    whole, parts = tmp_path / "a.ubx", tmp_path / "b.ubx"
    write_ubx(whole, observations, navigation)
    with UbxWriter(parts, navigation) as writer:
        for first in range(0, 40, 9):
            writer.write_block(observations.select_epochs(slice(first, first + 9)))
    assert parts.read_bytes() == whole.read_bytes()


def test_without_navigation_data_there_are_no_frames(tmp_path):
    path = tmp_path / "a.ubx"
    write_ubx(path, replace(make([[row("G05", "1C")]]), meta=ObservationMeta()))
    assert frames_of(path) == []
    assert parse_ubx(path.read_bytes())[0].meta.approx_position_ecef_m is None
