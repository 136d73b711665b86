"""The RINEX observation reader on real files, against a second parser that is slow and obvious."""

import gzip

import numpy as np
import pytest

import truenorth as tn
from truenorth.formats.compression import read_bytes
from truenorth.observations import LLI_HALF_CYCLE, LLI_SLIP, NO_CHANNEL, sat_id, signal_id
from truenorth.timescales import NS_PER_S, gpst_from_calendar

RINEX3 = [
    "pair_1m_geodetic/base.obs.gz",
    "pair_0.33m_ublox/rover.obs.gz",
    "moving_simulator_rose/Rover-dynamic_MO_Spirent.obs.gz",
    "ubx_with_rinex/f9p_spirent_15min.obs.gz",
    "rinex_samples/ACOR00ESP_R_20213550000_01D_30S_MO.rnx",
    "rinex_samples/KMS300DNK_R_20221591000_01H_30S_MO.crx",
]
RINEX2 = [
    "pair_38m_gps/UPC10770.11o.gz",
    "pair_38m_gps/UPC20770.11o.gz",
    "rinex_samples/delf0010.21o",
    "rinex_samples/npaz3550.21o",
]
# Signals that the RINEX 2 types of the sample files mean, in the words of the reader's own table.
OLD_SIGNALS = {
    "G": {"C1": "1C", "L1": "1C", "S1": "1C", "P1": "1W", "P2": "2W", "L2": "2W", "S2": "2W"},
    "R": {"C1": "1C", "L1": "1C", "S1": "1C", "P1": "1P", "P2": "2P", "L2": "2P", "S2": "2P"},
}


def value_of(text):
    """Number of a field F14.3; None when blank or zero."""
    text = text.strip()
    return float(text) or None if text else None


def slow_rinex3(text, n_max):
    """Rows {(epoch ns, sat, signal): {kind: (value, lli)}} of the first epochs, by slicing strings."""
    lines = text.splitlines()
    types, system = {}, ""
    for line in lines:
        label = line[60:].strip()
        if label == "SYS / # / OBS TYPES":
            system = line[0] if line[0] != " " else system
            types.setdefault(system, []).extend(line[6:60].split())
        if label == "END OF HEADER":
            break
    rows, epochs = {}, []
    k = lines.index(line) + 1
    while k < len(lines) and len(epochs) < n_max:
        line = lines[k]
        assert line[0] == ">"
        assert line[31] == "0"
        year, month, day, hour, minute = (int(x) for x in line[2:18].split())
        time = gpst_from_calendar(year, month, day, hour, minute, float(line[18:29]))
        epochs.append(time)
        for sat_line in lines[k + 1 : k + 1 + int(line[32:35])]:
            for n, name in enumerate(types[sat_line[0]]):
                field = sat_line[3 + 16 * n : 19 + 16 * n].ljust(16)
                value = value_of(field[:14])
                if value is not None and name[0] in "CLDS":
                    key = (time, sat_id(sat_line[:3]), signal_id(name[1:]))
                    rows.setdefault(key, {})[name[0]] = (value, int(field[14:15].strip() or 0))
        k += 1 + int(line[32:35])
    return epochs, rows


def slow_rinex2(text, n_max):
    """The same for RINEX 2 files of GPS and GLONASS with the common types."""
    lines = text.splitlines()
    types = []
    for line in lines:
        label = line[60:].strip()
        if label == "# / TYPES OF OBSERV":
            types += line[6:60].split()
        if label == "END OF HEADER":
            break
    per_sat = -(-len(types) // 5)
    rows, epochs = {}, []
    k = lines.index(line) + 1
    while k < len(lines) and len(epochs) < n_max:
        line = lines[k]
        year, month, day, hour, minute = (int(line[a : a + 3]) for a in (0, 3, 6, 9, 12))
        time = gpst_from_calendar(2000 + year, month, day, hour, minute, float(line[15:26]))
        assert line[28] == "0"
        epochs.append(time)
        count = int(line[29:32])
        listed = line[32:68]
        k += 1
        while len(listed.rstrip()) < 3 * count:
            listed = listed[: 3 * (len(listed.rstrip()) // 3)] + lines[k][32:68]
            k += 1
        for n in range(count):
            sat = listed[3 * n : 3 * n + 3]
            block = "".join(x.ljust(80)[:80] for x in lines[k : k + per_sat])
            k += per_sat
            for m, name in enumerate(types):
                field = block[16 * m : 16 * m + 16]
                value = value_of(field[:14])
                if value is not None:
                    key = (time, sat_id(sat), signal_id(OLD_SIGNALS[sat[0]][name]))
                    kind = "C" if name[0] == "P" else name[0]
                    rows.setdefault(key, {})[kind] = (value, int(field[14:15].strip() or 0))
    return epochs, rows


@pytest.mark.jit
@pytest.mark.parametrize("name", RINEX3 + RINEX2)
def test_every_value_is_that_of_a_slow_parser(data_dir, name):
    text = read_bytes(data_dir / name).decode("latin-1")
    observations = tn.read_observations(data_dir / name)
    slow = slow_rinex3 if name in RINEX3 else slow_rinex2
    epochs, rows = slow(text, n_max=60)
    head = observations.select_epochs(slice(0, len(epochs)))
    assert head.time_ns.tolist() == epochs
    keys = list(
        zip(head.time_ns[head.epoch_of_row].tolist(), head.sat.tolist(), head.signal.tolist(), strict=True)
    )
    assert keys == sorted(rows)
    columns = {"C": head.code_m, "L": head.phase_cyc, "D": head.doppler_hz, "S": head.cn0_dbhz}
    for kind, column in columns.items():
        expected = [rows[key].get(kind, (np.nan, 0))[0] for key in keys]
        # Equal to the last bit: both must be the double nearest to the decimal text.
        np.testing.assert_array_equal(column, expected)
    has_phase = np.array(["L" in rows[key] for key in keys])
    lli = np.array([rows[key].get("L", (0.0, 0))[1] & 3 for key in keys])
    np.testing.assert_array_equal(head.lli[has_phase], lli[has_phase])


@pytest.mark.jit
@pytest.mark.parametrize(
    ("name", "n_epochs", "n_sats", "systems"),
    [
        ("pair_1m_geodetic/base.obs.gz", 301, 57, "GRECJ"),
        ("pair_1m_geodetic/rover.obs.gz", 301, 58, "GRECJ"),
        ("pair_0.33m_ublox/base.obs.gz", 283, 24, "GR"),
        ("pair_0.33m_ublox/rover.obs.gz", 1202, 23, "GR"),
        ("pair_38m_gps/UPC10770.11o.gz", 3600, 12, "G"),
        ("pair_38m_gps/UPC20770.11o.gz", 3600, 12, "G"),
        ("moving_simulator_rose/Base-static_MO_Spirent.obs.gz", 601, 20, "GE"),
        ("moving_simulator_rose/Rover-static-2km-east_MO_Spirent.obs.gz", 601, 20, "GE"),
        ("ubx_with_rinex/f9p_spirent_15min.obs.gz", 931, 22, "GE"),
        ("rinex_samples/ACOR00ESP_R_20213550000_01D_30S_MO.rnx", 25, 38, "GREC"),
        ("rinex_samples/KMS300DNK_R_20221591000_01H_30S_MO.crx", 19, 51, "GRECJS"),
        ("rinex_samples/delf0010.21o", 105, 24, "GR"),
        ("rinex_samples/npaz3550.21o", 129, 20, "GR"),
    ],
)
def test_counts(data_dir, name, n_epochs, n_sats, systems):
    observations = tn.read_observations(data_dir / name)
    assert observations.n_epochs == n_epochs
    assert len(np.unique(observations.sat)) == n_sats
    assert {"GRECJIS"[s] for s in np.unique(observations.sat // 100)} == set(systems)
    for column in (observations.sat, observations.code_m, observations.time_ns, observations.lli):
        assert column.flags.c_contiguous


@pytest.mark.jit
@pytest.mark.parametrize(
    ("packed", "plain"),
    [
        ("delf0010.21d", "delf0010.21o"),
        ("ACOR00ESP_R_20213550000_01D_30S_MO.crx", "ACOR00ESP_R_20213550000_01D_30S_MO.rnx"),
    ],
)
def test_hatanaka_twins_are_equal(data_dir, tmp_path, packed, plain):
    folder = data_dir / "rinex_samples"
    a, b = tn.read_observations(folder / packed), tn.read_observations(folder / plain)
    inside = tmp_path / "inside.gz"
    inside.write_bytes(gzip.compress((folder / packed).read_bytes()))
    c = tn.read_observations(inside)
    for other in (b, c):
        for column in ("time_ns", "epoch_start", "sat", "signal", "code_m", "phase_cyc", "doppler_hz",
                       "cn0_dbhz", "lli", "clock_offset_s", "glonass_channel"):  # fmt: skip
            np.testing.assert_array_equal(getattr(a, column), getattr(other, column))


@pytest.mark.jit
def test_geodetic_header(data_dir):
    observations = tn.read_observations(data_dir / "pair_1m_geodetic" / "base.obs.gz")
    meta = observations.meta
    assert meta.receiver_type == "SEPT MOSAIC-X5"
    assert meta.receiver_firmware == "4.14.4"
    assert meta.version == "3.04"
    assert meta.interval_s == 1.0
    assert meta.leap_seconds == 18
    assert meta.approx_position_ecef_m == (-3817680.7270, 3562839.5216, 3650159.2407)
    assert meta.phase_shift_cyc["G2L"] == 0.0
    assert meta.glonass_code_phase_bias_m == {"1C": 0.0, "2C": 0.0}
    assert meta.warnings == ()
    assert observations.glonass_channel[[1, 2, 18, 24]].tolist() == [1, -4, -3, 2]
    assert observations.glonass_channel[4] == NO_CHANNEL
    # X1, the channel number, is no signal; the first rows belong to G and begin with L1 C/A.
    assert observations.signal[0] == signal_id("1C")


@pytest.mark.jit
def test_ublox_flags_and_time_tags(data_dir):
    observations = tn.read_observations(data_dir / "pair_0.33m_ublox" / "base.obs.gz")
    # Tags near .99 s: the receiver does not steer its clock to the second.
    assert observations.time_ns[0] % NS_PER_S == 990_000_000
    assert observations.time_ns[-1] % NS_PER_S == 991_000_000
    first = slice(*observations.epoch_start[:2])
    row = np.flatnonzero(observations.sat[first] == sat_id("G22"))[0]
    assert observations.lli[row] == LLI_SLIP
    assert np.any(observations.lli & LLI_HALF_CYCLE)
    assert observations.phase_cyc[row] == 94031532.721


@pytest.mark.jit
def test_simulator_clock_offsets(data_dir):
    observations = tn.read_observations(data_dir / "moving_simulator_rose" / "Base-static_MO_Spirent.obs.gz")
    np.testing.assert_array_equal(observations.clock_offset_s, np.zeros(observations.n_epochs))


@pytest.mark.jit
def test_galileo_and_gps_share_a_clock(data_dir):
    # Code on 5X minus code on 1C is ionosphere and bias, tens of metres at most: columns are not mixed up.
    observations = tn.read_observations(data_dir / "pair_1m_geodetic" / "base.obs.gz")
    epoch = observations.epoch_of_row
    l1 = {(e, s): c for e, s, g, c in zip(epoch, observations.sat, observations.signal, observations.code_m,
                                          strict=True) if g == signal_id("1C")}  # fmt: skip
    l5 = observations.signal == signal_id("5Q")
    difference = [
        c - l1[e, s]
        for e, s, c in zip(epoch[l5], observations.sat[l5], observations.code_m[l5], strict=True)
        if (e, s) in l1
    ]
    assert len(difference) > 1000
    assert np.nanmax(np.abs(difference)) < 60.0
