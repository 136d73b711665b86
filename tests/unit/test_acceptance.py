"""Acceptance tests of integers, and the chi-square functions against SciPy."""

import math

import numpy as np
import pytest
from scipy import stats

from truenorth.ambiguity import acceptance
from truenorth.errors import ConfigError, Reason

DOFS = (1, 2, 3, 5, 10, 37, 60, 100, 200, 500)


@pytest.mark.parametrize("dof", DOFS)
def test_chi2_shares_agree_with_scipy(dof):
    for x in (1e-3, 0.1, 1.0, 3.0, 10.0, 40.0, 100.0, 300.0, 700.0):
        assert acceptance.chi2_cdf(x, dof) == pytest.approx(stats.chi2.cdf(x, dof), rel=1e-10, abs=1e-290)
        assert acceptance.chi2_sf(x, dof) == pytest.approx(stats.chi2.sf(x, dof), rel=1e-10, abs=1e-290)


@pytest.mark.parametrize("dof", DOFS)
def test_chi2_quantiles_agree_with_scipy(dof):
    for p in (1e-12, 1e-6, 1e-4, 0.001, 0.01, 0.05, 0.3, 0.5, 0.7, 0.9, 0.99, 0.999, 0.9999, 1 - 1e-7):
        assert acceptance.chi2_quantile(p, dof) == pytest.approx(stats.chi2.ppf(p, dof), rel=1e-8)
        assert acceptance.chi2_quantile(p, dof, upper=True) == pytest.approx(stats.chi2.isf(p, dof), rel=1e-8)


def test_chi2_at_the_ends():
    assert acceptance.chi2_quantile(0.0, 3) == 0.0
    assert acceptance.chi2_quantile(1.0, 3) == math.inf
    assert acceptance.chi2_quantile(0.0, 3, upper=True) == math.inf
    assert acceptance.chi2_quantile(1.0, 3, upper=True) == 0.0
    assert math.isnan(acceptance.chi2_quantile(1.5, 3))
    assert math.isnan(acceptance.chi2_quantile(0.5, 0))
    assert acceptance.chi2_cdf(-1.0, 3) == 0.0
    assert acceptance.chi2_sf(math.inf, 3) == 0.0
    assert math.isnan(acceptance.chi2_cdf(math.nan, 3))


def test_chi2_limits_by_dof():
    limits = acceptance.chi2_limits(1e-4, 40)
    assert limits[0] == math.inf
    assert limits[1:] == pytest.approx(stats.chi2.isf(1e-4, np.arange(1, 41)), rel=1e-8)


def test_ratio_test():
    assert acceptance.ratio_test([1.0, 3.0], 3.0).accepted
    refused = acceptance.ratio_test([1.0, 2.999], 3.0)
    assert (refused.accepted, refused.reason, refused.statistic) == (False, Reason.RATIO_TEST, 2.999)
    assert acceptance.ratio_test([0.0, 1.0], 3.0).statistic == math.inf
    assert not acceptance.ratio_test([0.0, 1.0], math.inf).accepted
    assert acceptance.ratio_test([1.0]).reason == Reason.SINGLE_CANDIDATE
    assert acceptance.ratio_test([]).reason == Reason.NO_CANDIDATE


def test_difference_test_is_the_posterior_of_two():
    threshold = acceptance.difference_threshold(0.995)
    assert acceptance.posterior_probability([2.0, 2.0 + threshold]) == pytest.approx(0.995, rel=1e-12)
    assert acceptance.difference_test([2.0, 2.001 + threshold], threshold).accepted
    assert acceptance.difference_test([2.0, 1.999 + threshold], threshold).reason == Reason.RATIO_TEST
    assert acceptance.difference_test([2.0], threshold).reason == Reason.SINGLE_CANDIDATE


def test_posterior_of_equal_and_of_costly_candidates():
    assert acceptance.posterior_probability([5.0] * 4) == pytest.approx(0.25)
    # The candidate in question need not be the cheapest.
    assert acceptance.posterior_probability([3.0, 1.0]) == pytest.approx(1.0 / (1.0 + math.e))
    assert acceptance.posterior_probability([5000.0, 5000.0 + 80.0]) == pytest.approx(1.0)
    assert math.isnan(acceptance.posterior_probability([]))


def test_probability_and_residual_tests():
    assert acceptance.probability_test(0.99, 0.99).accepted
    assert acceptance.probability_test(math.nan, 0.99).reason == Reason.PROBABILITY_TEST
    limit = stats.chi2.isf(1e-4, 7)
    assert acceptance.residual_test(limit * 0.999, 7, 1e-4).accepted
    refused = acceptance.residual_test(limit * 1.001, 7, 1e-4)
    assert refused.reason == Reason.RESIDUAL_TEST
    assert refused.limit == pytest.approx(limit, rel=1e-8)
    assert acceptance.residual_test(math.nan, 7).reason == Reason.RESIDUAL_TEST
    assert acceptance.residual_test(0.0, 0).accepted


def test_tabulated_threshold_is_sane():
    threshold = acceptance.tabulated_ratio_threshold
    assert threshold(10, 0.0005, 0.001) == 1.0
    assert threshold(10, 0.001, 0.001) == 1.0
    assert threshold(10, 0.9, 0.001) == math.inf
    assert threshold(10, math.nan, 0.001) == math.inf
    for n in (2, 6, 12, 25, 60):
        by_rate = [threshold(n, rate, 0.001) for rate in (0.002, 0.01, 0.03, 0.06, 0.1)]
        assert by_rate == sorted(by_rate)
        assert by_rate[0] >= 1.0
        assert by_rate[-1] > 1.05
        assert threshold(n, 0.05, 0.01) <= threshold(n, 0.05, 0.001)
    # More ambiguities bring the ratio of wrong integers closer to one.
    assert threshold(20, 0.05, 0.001) < threshold(5, 0.05, 0.001)
    with pytest.raises(ConfigError, match="failure_rate"):
        threshold(10, 0.05, 0.02)


def test_threshold_of_draws_is_the_smallest_that_keeps_the_rate():
    ratio = np.array([1.5, 2.0, 2.5, 3.0, 1.2, 1.1, 1.3, 1.4, 9.0, 9.0])
    is_right = np.array([False, False, False, True, False, True, True, True, True, True])
    for rate in (0.0, 0.1, 0.2, 0.3):
        c = acceptance.ratio_threshold_of_draws(ratio, is_right, rate)
        assert np.mean((ratio >= c) & ~is_right) <= rate
        assert np.mean((ratio >= c * (1 - 1e-12)) & ~is_right) > rate
    assert acceptance.ratio_threshold_of_draws(ratio, is_right, 0.4) == 1.0
