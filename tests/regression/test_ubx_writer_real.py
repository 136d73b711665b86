"""Real frames put together again bit by bit, and real RINEX data through a UBX log."""

import numpy as np
import pytest

import truenorth as tn
from truenorth.constants import BEIDOU, GALILEO
from truenorth.formats import write_ubx
from truenorth.formats.navigation_frames import beidou_words, glonass_words, lnav_words
from truenorth.formats.ubx import find_frames
from truenorth.orbits import compute_satellite_states


@pytest.fixture(scope="module")
def real_frames(data_dir):
    """Header and words of every RXM-SFRBX of the F9P log of five systems."""
    data = np.fromfile(data_dir / "receiver_logs" / "20230919-114418.ubx", dtype=np.uint8)
    offset, length, kind, _ = find_frames(data)
    return [
        (data[at : at + 8].tolist(), data[at + 8 : at + size].view("<u4").tolist())
        for at, size in zip(
            (offset[kind == 0x0213] + 6).tolist(), length[kind == 0x0213].tolist(), strict=True
        )
    ]


def joined(words, n_bits, shift):
    value = 0
    for word in words:
        value = value << n_bits | (word >> shift & ((1 << n_bits) - 1))
    return value


def test_check_bits_are_those_of_the_satellites(real_frames):
    """Only the data bits are taken from the log; all words come out as they were received."""
    count = {"LNAV": 0, "BeiDou": 0, "GLONASS": 0}
    for (gnss, _, sig, *_), words in real_frames:
        if gnss in (0, 5) and sig == 0:
            assert lnav_words(joined(words, 24, 6)) == words
            count["LNAV"] += 1
        elif gnss == 3:
            assert beidou_words((words[0] >> 4) << 198 | joined(words[1:], 22, 8)) == words
            count["BeiDou"] += 1
        elif gnss == 6:
            string = joined(words[:3], 32, 0) >> 11
            assert glonass_words(string, words[3] >> 16, words[3] & 0xFFFF) == words
            count["GLONASS"] += 1
    assert all(number > 70 for number in count.values()), count


def test_real_data_through_a_log(data_dir, tmp_path):
    """Phases and codes as they are, orbits to a millimetre, clocks to the bit of their message."""
    folder = data_dir / "pair_1m_geodetic"
    observations = tn.read_observations(folder / "base.obs.gz").select_epochs(slice(0, 60))
    navigation = tn.read_navigation(folder / "base.nav.gz")
    path = tmp_path / "base.ubx"
    assert write_ubx(path, observations, navigation).keys() == {"G 2W"}
    found, broadcast = tn.read(path)
    assert found.meta.warnings == ()
    assert broadcast.skipped == {}
    wanted = observations.select_rows(~((observations.sat < 100) & (observations.signal == 222)))
    for name in ("time_ns", "epoch_start", "sat", "signal", "code_m", "phase_cyc", "lli", "glonass_channel"):
        if name != "glonass_channel":
            np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), err_msg=name)
    np.testing.assert_array_equal(found.doppler_hz, wanted.doppler_hz.astype(np.float32))
    np.testing.assert_array_equal(found.cn0_dbhz, np.rint(wanted.cn0_dbhz))

    sat = np.unique(wanted.sat).astype(np.int64)
    time_ns = np.full(len(sat), wanted.time_ns[30])
    one = compute_satellite_states(navigation, sat, time_ns)
    other = compute_satellite_states(broadcast, sat, time_ns)
    known = one.status == 0
    np.testing.assert_array_equal(other.status, one.status)
    assert np.sum(known) > 50
    # The file has twelve decimals, one more than the 32 bits of the angles: 0.1 mm; sqrt(A) likewise.
    assert np.max(np.abs(one.position_ecef_m - other.position_ecef_m)[known]) < 1e-3
    assert np.max(np.abs(one.clock_s - other.clock_s)[known]) < 1e-13
    of_galileo = broadcast.kepler.sat // 100 == GALILEO
    assert {3, 4} >= set(broadcast.kepler.message[of_galileo].tolist())
    assert np.any(broadcast.kepler.sat // 100 == BEIDOU)
