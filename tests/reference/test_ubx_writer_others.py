"""Logs that the writer makes, read by pyubx2 and by RTKLIB's convbin."""

import io
import shutil
import subprocess

import numpy as np
import pytest

import truenorth as tn
from truenorth.formats import write_ubx

CONVBIN = shutil.which("convbin")


@pytest.fixture(scope="module")
def log(data_dir, tmp_path_factory):
    """A minute of the geodetic base as a log, what it was made of, and the path."""
    folder = data_dir / "pair_1m_geodetic"
    observations = tn.read_observations(folder / "base.obs.gz").select_epochs(slice(0, 60))
    navigation = tn.read_navigation(folder / "base.nav.gz")
    path = tmp_path_factory.mktemp("log") / "base.ubx"
    write_ubx(path, observations, navigation)
    return observations, navigation, path


def test_pyubx2_finds_every_message_and_the_same_values(log):
    import pyubx2

    _, _, path = log
    # 2: a wrong checksum, or what is no message, is an error.
    reader = pyubx2.UBXReader(io.BytesIO(path.read_bytes()), quitonerror=2, validate=pyubx2.VALCKSUM)
    messages = [message for _, message in reader]
    kinds = [message.identity for message in messages]
    assert kinds[:2] == ["MON-VER", "NAV-POSECEF"]
    assert kinds.count("RXM-RAWX") == 60
    assert kinds.count("RXM-SFRBX") > 300
    found, _ = tn.read(path)
    epoch = found.select_epochs(slice(7, 8))
    theirs = [message for message in messages if message.identity == "RXM-RAWX"][7]
    count = theirs.numMeas
    assert (count, theirs.leapS, theirs.leapSec) == (epoch.n_rows, 18, 1)
    values = {
        name: np.array([getattr(theirs, f"{name}_{k:02d}") for k in range(1, count + 1)])
        for name in ("prMes", "cpMes", "doMes", "cno", "locktime", "prValid", "cpValid", "halfCyc")
    }
    np.testing.assert_array_equal(values["prMes"], np.nan_to_num(epoch.code_m))
    np.testing.assert_array_equal(values["cpMes"], np.nan_to_num(epoch.phase_cyc))
    np.testing.assert_array_equal(values["prValid"], np.isfinite(epoch.code_m))
    np.testing.assert_array_equal(values["cpValid"], np.isfinite(epoch.phase_cyc))
    np.testing.assert_array_equal(values["halfCyc"], np.isfinite(epoch.phase_cyc) & (epoch.lli & 2 == 0))
    np.testing.assert_array_equal(values["cno"], np.nan_to_num(epoch.cn0_dbhz))
    np.testing.assert_allclose(values["doMes"], epoch.doppler_hz, rtol=1e-6)


@pytest.mark.skipif(CONVBIN is None, reason="RTKLIB's convbin is not installed")
def test_convbin_makes_the_same_rinex_of_it(log, tmp_path):
    _, navigation, path = log
    made = [tmp_path / "o.obs", tmp_path / "o.nav"]
    subprocess.run(
        [CONVBIN, "-r", "ubx", "-v", "3.04", "-od", "-os", "-o", made[0], "-n", made[1], path],
        capture_output=True, check=True,
    )  # fmt: skip
    ours, _ = tn.read(path)
    theirs = tn.read_observations(made[0])
    np.testing.assert_array_equal(theirs.time_ns, ours.time_ns)
    # It knows two frequencies of each system and leaves the third out.
    key, other = ((o.epoch_of_row * 1000 + o.sat) * 1000 + o.signal for o in (ours, theirs))
    _, mine, its = np.intersect1d(key, other, assume_unique=True, return_indices=True)
    assert len(its) == theirs.n_rows > 0.6 * ours.n_rows
    for name in ("code_m", "phase_cyc", "doppler_hz", "cn0_dbhz"):
        a, b = getattr(ours, name)[mine], getattr(theirs, name)[its]
        both = np.isfinite(a) & np.isfinite(b)
        # It blanks phases whose stated deviation is above 0.02 cycles: those below 30 dB-Hz.
        assert np.all(both | np.isnan(a) | ((name == "phase_cyc") & (ours.cn0_dbhz[mine] < 30.0))), name
        if name == "phase_cyc":  # of the geostationary BeiDou satellites it adds half a cycle, always
            number = ours.sat[mine] - 300
            b = b - 0.5 * ((number > 0) & ((number <= 5) | (number >= 59)) & (ours.sat[mine] < 400))
        assert np.max(np.abs(a - b)[both]) < 0.5001e-3, name  # three decimals

    found = tn.read_navigation(made[1])
    for one, other, values in (
        (found.kepler, navigation.kepler, "elements"),
        (found.states, navigation.states, "states"),
    ):
        assert len(one) > 5
        for k in range(len(one)):
            same = np.flatnonzero((other.sat == one.sat[k]) & (other.toe_ns == one.toe_ns[k]))
            assert len(same) > 0
            rows = getattr(other, values)[same]
            scale = np.maximum(np.abs(rows), 1e-30)
            # Ten digits: between those of the files and the least bits of the messages; but the group
            # delays, accuracy and fit of the last columns, whose meaning differs between programs.
            close = np.abs(rows - getattr(one, values)[k]) <= 1e-7 * scale
            assert np.any(np.all(close[:, :9], axis=1))
