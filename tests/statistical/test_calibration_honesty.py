"""Errors of self-surveys against their stated covariances, and the false alarms of their test."""

import numpy as np

from synthetic_survey import BODY_M, make_vectors
from truenorth.calibration import calibrate_array


def mean_nees(n_runs, **options):
    """Mean over runs of the normalised squared error of the six determined coordinates, each."""
    total = []
    for seed in range(n_runs):
        found = calibrate_array(
            make_vectors(seed=100 + seed, **options), declared_m=BODY_M, declared_sd_m=0.0, common_sd_m=0.0
        )
        error = (found.positions_body_m - BODY_M).ravel()
        total.append(error @ np.linalg.pinv(found.cov_body_m2, rcond=1e-8, hermitian=True) @ error / 6.0)
    return float(np.mean(total))


def test_covariance_of_a_survey_with_white_errors():
    # Mean of 24 chi-squares of 6 degrees over 6: sd sqrt(2 / 144) = 0.118; four of them.
    for is_moving in (True, False):
        assert abs(mean_nees(24, is_moving=is_moving) - 1.0) < 0.48


def test_covariance_of_a_survey_with_errors_that_stay_alike():
    # 600 epochs that are worth 30: the covariance itself is uncertain by a third. Without the correlation
    # taken into account it would be 20.
    assert 0.45 < mean_nees(15, n=600, tau_s=10.0) < 1.9
    assert 0.45 < mean_nees(15, n=600, tau_s=10.0, is_moving=False) < 1.9


def test_false_alarms_of_the_test_of_declared_coordinates():
    statistic = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        declared = BODY_M + 0.003 * rng.standard_normal(BODY_M.shape)
        found = calibrate_array(make_vectors(seed=seed), declared_m=declared, common_sd_m=0.0)
        statistic.append(found.declared.statistic)
    # Chi-square of 6 degrees: mean 6, sd of the mean of 40 sqrt(12 / 40) = 0.55; four of them.
    assert abs(np.mean(statistic) - 6.0) < 2.2
