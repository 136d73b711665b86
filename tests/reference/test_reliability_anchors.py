"""Numbers of Wang & Lachapelle 2002 and Baarda 1968, found by hand or by SciPy, and their square array."""

import numpy as np
import pytest
from scipy import stats

from truenorth.ambiguity.acceptance import chi2_quantile
from truenorth.attitude.array_vectors import ArrayVectors
from truenorth.attitude.reliability import (
    ReliabilitySettings,
    attitude_reliability,
    b_method_limit,
    b_method_significance,
    detectable_shift,
    filter_model,
    filter_reliability,
    least_squares_model,
    local_limit,
)
from truenorth.attitude.reliability.significance import noncentral_chi2_cdf, normal_tail, normal_tail_quantile
from truenorth.rotations import skew

SQUARE_M = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
SD_M = 0.005


def square(n=1, sd_m=SD_M):
    """Vectors of a level square of 1 m whose antennas have independent errors of 5 mm per coordinate."""
    cov = np.kron(np.eye(4) + 1.0, sd_m**2 * np.eye(3))
    vector = np.tile(SQUARE_M, (n, 1, 1))
    vector[:, 0] = np.nan
    return ArrayVectors(
        np.arange(n), np.zeros(n, np.int64), vector, np.tile(cov, (n, 1, 1)), SQUARE_M, np.zeros((12, 12))
    )


def steady_prediction(rate_sd_dps=2.0, dt_s=0.1):
    """Covariance of the prediction of the six-state filter of the paper once nothing changes any more."""
    transition = np.eye(6)
    transition[:3, 3:] = dt_s * np.eye(3)
    noise = np.diag([0.0, 0.0, 0.0, *[np.radians(rate_sd_dps) ** 2] * 3])
    design = np.zeros((9, 6))
    design[:, :3] = np.concatenate([-skew(vector) for vector in SQUARE_M[1:]])
    cov = np.kron(np.eye(3) + 1.0, SD_M**2 * np.eye(3))
    P = np.eye(6)
    for _ in range(2000):
        P = transition @ P @ transition.T + noise
        gain = P @ design.T @ np.linalg.inv(design @ P @ design.T + cov)
        P = P - gain @ design @ P
    return transition @ P @ transition.T + noise


def test_limit_of_the_local_test_and_shift_that_it_finds():
    assert local_limit(0.001) == pytest.approx(3.2905, abs=5e-5)
    assert detectable_shift(0.001, 0.2) == pytest.approx(4.1321, abs=5e-5)
    assert detectable_shift(0.001, 0.2) ** 2 == pytest.approx(17.075, abs=5e-4)
    power = stats.norm.sf(3.2905 - 4.1321) + stats.norm.cdf(-3.2905 - 4.1321)
    assert power == pytest.approx(0.800, abs=5e-4)


@pytest.mark.parametrize(("false_alarm", "limit"), [(0.001, 27.88), (0.01, 21.67), (0.05, 16.92)])
def test_limits_of_nine_innovations(false_alarm, limit):
    assert chi2_quantile(false_alarm, 9, upper=True) == pytest.approx(limit, abs=5e-3)


@pytest.mark.parametrize(
    ("dof", "limit", "significance"), [(3, 12.63, 0.0055), (6, 15.35, 0.0177), (9, 18.08, 0.0343)]
)
def test_limits_of_the_b_method(dof, limit, significance):
    assert b_method_limit(dof) == pytest.approx(limit, abs=5e-3)
    assert b_method_significance(dof) == pytest.approx(significance, abs=5e-5)
    assert b_method_limit(dof) == pytest.approx(stats.ncx2.ppf(0.2, dof, detectable_shift(0.001, 0.2) ** 2))


def test_the_vector_test_at_the_significance_of_the_local_one():
    assert chi2_quantile(0.001, 3, upper=True) == pytest.approx(16.27, abs=5e-3)


def test_the_screen_by_the_detectable_blunder_costs_power():
    """Comparing the estimated blunder with the detectable one is |w| > 4.13."""
    settings = ReliabilitySettings(mdb_screen="estimated")
    limit = settings.rejection_limit
    assert limit == pytest.approx(4.1321, abs=5e-5)
    assert 2.0 * stats.norm.sf(limit) == pytest.approx(3.6e-5, abs=5e-7)
    assert stats.norm.sf(limit - settings.delta0) == pytest.approx(0.50, abs=5e-3)
    assert settings.screened_delta0 == pytest.approx(4.97, abs=5e-3)
    assert stats.norm.sf(limit - settings.screened_delta0) == pytest.approx(0.80, abs=5e-4)


def test_least_squares_of_the_square():
    result = attitude_reliability(square(), np.eye(3)[None])
    assert np.degrees(result.sd_rad[0]) == pytest.approx([0.203, 0.286, 0.286], abs=5e-4)
    assert 1e3 * result.mdb_m[0, 1:] == pytest.approx(np.tile([26.1, 26.1, 41.3], (3, 1)), abs=0.05)
    assert np.degrees(result.external_rad[0]) == pytest.approx([0.374, 1.184, 1.184], abs=5e-4)
    assert np.nansum(result.redundancy) == pytest.approx(6.0, abs=1e-9)


def test_filter_of_the_square():
    result = filter_reliability(square(), np.eye(3)[None], steady_prediction()[None])
    assert np.degrees(result.sd_rad[0]) == pytest.approx([0.177, 0.240, 0.240], abs=5e-4)
    assert 1e3 * result.mdb_m[0, 1:] == pytest.approx(np.tile([25.5, 25.5, 32.7], (3, 1)), abs=0.05)
    assert np.degrees(result.external_rad[0]) == pytest.approx([0.281, 0.659, 0.659], abs=5e-4)
    assert np.nansum(result.redundancy) == pytest.approx(6.83, abs=5e-3)


def test_the_literal_screen_has_another_limit_for_every_component():
    """|v_i| > MDB_i asks for more than the estimated blunder by sqrt(C_ii (C^-1)_ii), 1.14 to 1.64."""
    design = np.concatenate([-skew(vector) for vector in SQUARE_M[1:]])[None]
    cov = np.kron(np.eye(3) + 1.0, SD_M**2 * np.eye(3))[None]
    model = filter_model(design, cov, steady_prediction()[None])
    innovation_cov = np.linalg.inv(model.test[0])
    ratio = np.sqrt(np.diag(innovation_cov) * np.diag(model.test[0]))
    assert ratio.min() == pytest.approx(1.14, abs=5e-3)
    assert ratio.max() == pytest.approx(1.64, abs=5e-3)


def test_a_filter_that_knows_nothing_is_least_squares():
    design = np.concatenate([-skew(vector) for vector in SQUARE_M[1:]])[None]
    cov = np.kron(np.eye(3) + 1.0, SD_M**2 * np.eye(3))[None]
    plain, loose = least_squares_model(design, cov), filter_model(design, cov, 10.0 * np.eye(3)[None])
    # A prior of three radians leaves less than a part in 1e5 of the information.
    np.testing.assert_allclose(plain.mdb(4.0), loose.mdb(4.0), rtol=1e-4)
    np.testing.assert_allclose(
        plain.external(4.0), loose.external(4.0), atol=1e-4 * np.abs(plain.external(4.0)).max()
    )


@pytest.mark.parametrize("dof", [1, 3, 8])
@pytest.mark.parametrize("noncentrality", [0.0, 2.5, 17.075])
def test_noncentral_distribution(dof, noncentrality):
    for x in (0.3, 4.0, 25.0):
        expected = stats.ncx2.cdf(x, dof, noncentrality) if noncentrality else stats.chi2.cdf(x, dof)
        assert noncentral_chi2_cdf(x, dof, noncentrality) == pytest.approx(expected, rel=1e-9)


def test_both_tails_of_the_normal_distribution():
    x = np.linspace(0.0, 12.0, 4321)
    np.testing.assert_allclose(normal_tail(x), 2.0 * stats.norm.sf(x), rtol=5e-6)
    np.testing.assert_allclose(normal_tail_quantile(normal_tail(x)), x, atol=1e-9)
    assert normal_tail(-1.0) == 1.0
