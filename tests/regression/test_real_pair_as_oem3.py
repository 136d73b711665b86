"""The geodetic pair written as logs of NovAtel OEM3 receivers and solved from them."""

import numpy as np
import pytest

import truenorth as tn
from truenorth.errors import Status
from truenorth.formats import write_oem3
from truenorth.formats.novatel_oem3 import SIGNAL_OF_TRACKING
from truenorth.observations import signal_id


@pytest.fixture(scope="module")
def pair(data_dir):
    """What the logs can hold of the first 120 epochs: GPS L1 and L2 with their ephemerides."""
    folder = data_dir / "pair_1m_geodetic"
    known = [signal_id(name) for name in SIGNAL_OF_TRACKING.values()]
    receivers = []
    for role in ("base", "rover"):
        observations = tn.read_observations(folder / f"{role}.obs.gz").select_epochs(slice(0, 120))
        receivers.append(
            observations.select_rows((observations.sat < 100) & np.isin(observations.signal, known))
        )
    return *receivers, tn.read_navigation(folder / "base.nav.gz")


@pytest.fixture(scope="module")
def expected(pair):
    return tn.solve_baseline(*pair, length_m=0.99)


@pytest.mark.jit
@pytest.mark.parametrize("ranges", ["RGED", "RGEB"])
def test_the_logs_alone_give_the_baseline(tmp_path, pair, expected, ranges):
    *receivers, navigation = pair
    paths = [tmp_path / "base.oem3", tmp_path / "rover.oem3"]
    for path, observations in zip(paths, receivers, strict=True):
        assert write_oem3(path, observations, navigation, ranges=ranges) == 0
    solution = tn.solve_baseline(*paths, length_m=0.99)
    assert np.all(solution.status == Status.FIXED)
    np.testing.assert_array_equal(solution.time_ns, expected.time_ns)
    off = np.hypot(
        np.degrees(solution.azimuth_rad - expected.azimuth_rad),
        np.degrees(solution.elevation_rad - expected.elevation_rad),
    )
    # Plain ranges lose nothing but digits of Doppler and C/N0. Compressed ones round the phase to 0.74 mm,
    # and the C/N0, which the weights come from, to 1 dB and to 20 dB-Hz or more (a seventh of the L2 signals
    # have less). 0.4 mm across 0.99 m are 0.02 degrees, in elevation a few times that; the noise is 0.12.
    assert np.max(off) < (1e-4 if ranges == "RGEB" else 0.10)
    assert np.sqrt(np.mean(off**2)) < (1e-4 if ranges == "RGEB" else 0.04)
