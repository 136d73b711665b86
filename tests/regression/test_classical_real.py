"""The classical methods on the real pairs: every accepted baseline is the known one."""

import functools

import numpy as np
import pytest

from truenorth.ambiguity.differencing import build_single_differences
from truenorth.ambiguity.double_differences import double_differences
from truenorth.ambiguity.exhaustive import resolve_exhaustive
from truenorth.ambiguity.kalman import KalmanIntegerEstimator
from truenorth.ambiguity.lsast import LeastSquaresSearch, LsastOptions, resolve_lsast
from truenorth.config import GnssSettings
from truenorth.errors import Reason, Status
from truenorth.formats import read_navigation, read_observations
from truenorth.positioning import solve_single_point

PAIRS = {
    "pair_1m_geodetic": ("base.obs.gz", "rover.obs.gz", "base.nav.gz", 0.9902, (-0.2232, -0.9647, 0.0096)),
    "pair_0.33m_ublox": ("base.obs.gz", "rover.obs.gz", "rover.nav.gz", 0.3296, (-0.2367, 0.2292, 0.0013)),
    "pair_38m_gps": (
        "UPC10770.11o.gz",
        "UPC20770.11o.gz",
        "brdc0770.11n",
        37.946,
        (-27.417, -26.234, -0.030),
    ),
}


@functools.cache
def differences(folder, name):
    base, rover, navigation, length, truth = PAIRS[name]
    settings = GnssSettings(systems="G", bands=("L1",), length_m=length)
    base, rover = read_observations(folder / name / base), read_observations(folder / name / rover)
    navigation = read_navigation(folder / name / navigation)
    points = [solve_single_point(o, navigation, systems="G", elevation_mask_deg=10.0) for o in (base, rover)]
    return build_single_differences(base, rover, *points, settings), length, np.array(truth)


def resolved(folder, name, update, *, keyed=False, step=1):
    """Status, reason and error of the best candidate at every step-th epoch."""
    single, length, truth = differences(folder, name)
    status, reason, error = [], [], []
    for epoch in range(0, single.n_epochs, step):
        problem, _, _, key, reference = double_differences(single, epoch, length_m=length, length_sd_m=0.003)
        keys = {"row_key": key, "reference_key": reference} if keyed else {}
        result = update(problem, **keys)
        best = result.baseline_enu_m[0] if len(result.objective) else np.full(3, np.nan)
        status.append(result.status)
        reason.append(result.reason)
        error.append(np.linalg.norm(best - truth))
    return np.array(status), np.array(reason), np.array(error)


# A wrong integer moves these baselines by more than a decimetre; right ones scatter by a centimetre.
WRONG_M = 0.05


@pytest.mark.parametrize("update", [resolve_lsast, resolve_exhaustive])
def test_one_metre_pair_every_epoch_alone(data_dir, update):
    status, _, error = resolved(data_dir, "pair_1m_geodetic", update, step=3)
    assert np.all(status == Status.FIXED)
    assert error.max() < WRONG_M


def test_short_low_cost_pair(data_dir):
    status, _, error = resolved(data_dir, "pair_0.33m_ublox", resolve_exhaustive, step=2)
    fixed = status == Status.FIXED
    assert np.mean(fixed) > 0.85
    assert error[fixed].max() < WRONG_M
    # The least-squares search is often left with one candidate there, which proves nothing by itself.
    status, reason, error = resolved(data_dir, "pair_0.33m_ublox", resolve_lsast, step=2)
    fixed = status == Status.FIXED
    assert np.mean(fixed) > 0.3
    assert error[fixed].max() < WRONG_M
    assert np.count_nonzero(reason == Reason.SINGLE_CANDIDATE) > np.count_nonzero(~fixed) / 2


def test_long_pair_needs_code_and_memory(data_dir):
    status, _, error = resolved(data_dir, "pair_38m_gps", resolve_lsast, step=12)
    fixed = status == Status.FIXED
    # RTKLIB fixes 34.7 % of these epochs, 2.2 % of them wrong.
    assert np.mean(fixed) > 0.75
    assert np.mean(error[fixed] > WRONG_M) <= 0.01
    search = LeastSquaresSearch(LsastOptions(min_epochs=3))
    status, _, error = resolved(data_dir, "pair_38m_gps", search.update, keyed=True, step=12)
    fixed = status == Status.FIXED
    assert np.mean(fixed) > 0.9
    assert error[fixed].max() < WRONG_M


def test_filter_on_an_hour_of_a_standing_pair(data_dir):
    # The satellites' motion alone separates integers and baseline; that takes minutes, and is said so.
    estimator = KalmanIntegerEstimator()
    status, reason, error = resolved(data_dir, "pair_38m_gps", estimator.update, keyed=True, step=5)
    first = int(np.argmax(status == Status.FIXED))
    assert 10 < first < len(status) / 2
    assert np.all(reason[:first] == Reason.NOT_PERSISTENT)
    fixed = status == Status.FIXED
    assert np.mean(fixed[first:]) > 0.9
    assert error[fixed].max() < WRONG_M


def test_five_minutes_are_too_short_for_the_filter(data_dir):
    estimator = KalmanIntegerEstimator()
    status, _, error = resolved(data_dir, "pair_1m_geodetic", estimator.update, keyed=True, step=2)
    # It may fix late or not at all, never wrong.
    assert np.all(status >= Status.FLOAT)
    assert not np.any(error[status == Status.FIXED] > WRONG_M)
