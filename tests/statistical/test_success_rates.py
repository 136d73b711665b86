"""Success rates, posterior and failure rates in simulation, against what theory says.

Every bound is the quantile of the binomial (or normal) distribution at 1e-5, so that about ten
comparisons raise a false alarm in less than one of ten thousand suites, had the seeds not been fixed.
"""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from truenorth.ambiguity import acceptance
from truenorth.ambiguity.lambda_ import _posterior, bootstrap, decorrelate
from truenorth.ambiguity.success_rate import bootstrapped_success_rate, success_rates

TOOLS = Path(__file__).resolve().parents[2] / "tools"
FALSE_ALARM = 1e-5


def load_tool(name):
    """A module of tools/, which is no package."""
    spec = importlib.util.spec_from_file_location(name, TOOLS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


float_covariance = load_tool("model_geometry").float_covariance


def model_with_bootstrapped_rate(n, n_bands, rate, seed):
    """A covariance scaled to a bootstrapped success rate."""
    cov = float_covariance(n, n_bands, rng=np.random.default_rng(seed))
    d = decorrelate(cov).d_cyc2
    low, high = 1e-6, 1e6
    for _ in range(80):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if bootstrapped_success_rate(d * middle) > rate else (low, middle)
    return cov * middle


@pytest.mark.parametrize(("n", "rate"), [(3, 0.6), (8, 0.9), (15, 0.75)])
def test_bootstrapping_succeeds_as_often_as_computed(n, rate):
    cov = model_with_bootstrapped_rate(n, 1, rate, seed=n)
    rng = np.random.default_rng(n)
    n_draws = 3000
    floats = rng.standard_normal((n_draws, n)) @ np.linalg.cholesky(cov).T
    right = sum(not bootstrap(row, cov).any() for row in floats)
    low, high = stats.binom.ppf(
        [FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], n_draws, success_rates(cov).bootstrapped
    )
    assert low <= right <= high


@pytest.mark.parametrize(("n", "n_bands", "rate"), [(4, 1, 0.5), (8, 1, 0.8), (12, 2, 0.6)])
def test_least_squares_succeeds_within_its_bounds(n, n_bands, rate):
    cov = model_with_bootstrapped_rate(n, n_bands, rate, seed=100 + n)
    rates = success_rates(cov)
    n_draws = 4000
    _, is_right = acceptance.simulate_ratios(cov, n_draws=n_draws, seed=n)
    right = int(is_right.sum())
    assert right >= stats.binom.ppf(FALSE_ALARM, n_draws, rates.ils_lower)
    assert right <= stats.binom.ppf(1 - FALSE_ALARM, n_draws, rates.ils_upper)
    # The ADOP-based number is an approximation of the rate: good to some per cent in these models.
    assert right / n_draws == pytest.approx(rates.adop_based, abs=0.15)


@pytest.mark.parametrize(("n", "rate"), [(4, 0.3), (8, 0.6), (12, 0.9)])
def test_posterior_is_calibrated(n, rate):
    decorrelation = decorrelate(model_with_bootstrapped_rate(n, 1, rate, seed=200 + n))
    L, d = decorrelation.L, decorrelation.d_cyc2
    n_draws = 1500
    z_hat = (np.random.default_rng(n).standard_normal((n_draws, n)) * np.sqrt(d)) @ L
    from truenorth.ambiguity.lambda_ import _search

    stated, right = np.empty(n_draws), np.empty(n_draws)
    for k in range(n_draws):
        found = _search(z_hat[k], L, d, 2, 10**6)
        stated[k], _ = _posterior(z_hat[k], L, d, found.cost)
        right[k] = not found.integers_cyc[0].any()
    # With a flat prior the best candidate is right with exactly the stated probability, draw by draw.
    limit = stats.norm.isf(FALSE_ALARM / 2)
    deviation = np.sum(right - stated) / np.sqrt(np.sum(stated * (1.0 - stated)))
    assert abs(deviation) < limit
    sure = stated > 0.9
    if sure.sum() > 100:
        expected_wrong = np.sum(1.0 - stated[sure])
        assert np.sum(1.0 - right[sure]) <= stats.poisson.isf(FALSE_ALARM, expected_wrong)


@pytest.mark.parametrize(("n", "n_bands", "rate"), [(4, 1, 0.91), (9, 1, 0.93), (16, 2, 0.91), (24, 2, 0.95)])
def test_tabulated_threshold_keeps_the_failure_rate(n, n_bands, rate):
    # Other skies than those of the table.
    cov = model_with_bootstrapped_rate(n, n_bands, rate, seed=9000 + n)
    n_draws = 4000
    ratio, is_right = acceptance.simulate_ratios(cov, n_draws=n_draws, seed=n)
    threshold = acceptance.tabulated_ratio_threshold(n, 1.0 - success_rates(cov).bootstrapped, 0.01)
    wrong = int(np.sum((ratio >= threshold) & ~is_right))
    # A single sky may be somewhat worse than the four that made the table.
    assert wrong <= stats.binom.isf(FALSE_ALARM, n_draws, 0.01)
    # A test that refuses everything would pass the line above.
    assert np.mean(ratio[is_right] >= threshold) > 0.2


def test_simulated_threshold_keeps_the_failure_rate_on_other_draws():
    cov = model_with_bootstrapped_rate(7, 1, 0.85, seed=5)
    threshold, ils_failure = acceptance.simulated_ratio_threshold(cov, 0.01, n_draws=8000, seed=1)
    assert 0.01 < ils_failure <= 0.16
    ratio, is_right = acceptance.simulate_ratios(cov, n_draws=8000, seed=2)
    wrong = int(np.sum((ratio >= threshold) & ~is_right))
    # Both runs scatter: the difference of two counts of 80.
    assert abs(wrong - 80) < stats.norm.isf(FALSE_ALARM / 2) * np.sqrt(2 * 80)
    assert acceptance.simulated_ratio_threshold(cov, 0.01, n_draws=500, seed=1) == (
        acceptance.simulated_ratio_threshold(cov, 0.01, n_draws=500, seed=1)
    )
