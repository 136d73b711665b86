"""Success rates against numbers known without them."""

import numpy as np
import pytest
from scipy import stats

from truenorth.ambiguity import success_rate
from truenorth.errors import ModelError

COV_3 = np.array([[6.290, 5.978, 0.544], [5.978, 6.292, 2.340], [0.544, 2.340, 6.288]])


def test_one_ambiguity_is_the_normal_distribution():
    for sd in (0.05, 0.2, 0.5, 2.0):
        expected = 2.0 * stats.norm.cdf(0.5 / sd) - 1.0
        rates = success_rate.success_rates([[sd**2]])
        assert rates.bootstrapped == pytest.approx(expected, rel=1e-12)
        assert rates.adop_based == pytest.approx(expected, rel=1e-12)
        assert rates.adop_cyc == pytest.approx(sd, rel=1e-12)
        # For one ambiguity every bound is sharp.
        bounds = (rates.rounding_lower, rates.rounding_upper, rates.ils_lower, rates.ils_upper)
        assert bounds == pytest.approx((expected,) * 4, rel=1e-10)


def test_rates_are_in_the_order_that_theory_demands():
    for scale in (1.0, 0.1, 0.03, 0.01):
        rates = success_rate.success_rates(COV_3 * scale)
        assert rates.rounding_lower <= rates.rounding_upper
        assert rates.rounding_lower <= rates.bootstrapped <= rates.adop_based
        assert rates.ils_lower <= rates.ils_upper
        assert rates.adop_cyc == pytest.approx(np.linalg.det(COV_3 * scale) ** (1 / 6), rel=1e-10)


def test_no_noise_and_no_ambiguities():
    assert success_rate.bootstrapped_success_rate([0.0, 1e-30]) == 1.0
    assert success_rate.bootstrapped_success_rate([]) == 1.0
    assert success_rate.ils_success_rate_bounds([]) == (1.0, 1.0)
    with pytest.raises(ModelError):
        success_rate.success_rates(np.empty((0, 0)))
