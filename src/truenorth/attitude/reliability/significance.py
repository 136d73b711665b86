r"""Significance, power and non-centrality of tests for blunders, matched over dimensions.

A test of one dimension with significance alpha and power 1 - beta finds a blunder of

    delta0 = z(1 - alpha / 2) + z(1 - beta)

standard deviations. The B-method lets every test of whatever dimension q find the blunders of the same
non-centrality lambda0 = delta0^2 with the same power: its limit K(q) is the quantile beta of the non-central
chi-square of q and lambda0, and its significance, larger with q, is what that limit leaves to the central
one. A blunder which the test of one observation sees is then seen by that of the whole model too.

References
----------
W. Baarda, "A testing procedure for use in geodetic networks", Netherlands Geodetic Commission 2/5 (1968);
C. Wang, G. Lachapelle, "GPS attitude determination reliability performance improvement using low cost
receivers", Journal of Global Positioning Systems 1 (2002).
"""

from __future__ import annotations

import functools
import math

import numpy as np

from ...ambiguity.acceptance import chi2_cdf, chi2_quantile, chi2_sf

__all__ = [
    "b_method_limit",
    "b_method_limits",
    "b_method_significance",
    "detectable_shift",
    "local_limit",
    "noncentral_chi2_cdf",
    "normal_tail",
    "normal_tail_quantile",
]

_STEP = 0.005
_FARTHEST = 37.5


@functools.lru_cache(maxsize=256)
def local_limit(false_alarm):
    """Limit of the two-sided test of one standardised quantity.

    Parameters
    ----------
    false_alarm : float
        Significance.

    Returns
    -------
    float

    Examples
    --------
    >>> round(local_limit(0.001), 4)
    3.2905
    """
    return math.sqrt(chi2_quantile(false_alarm, 1, upper=True))


@functools.lru_cache(maxsize=256)
def detectable_shift(false_alarm, missed_detection):
    """Shift delta0 of a standard normal quantity that the two-sided test misses this often.

    Parameters
    ----------
    false_alarm, missed_detection : float
        Significance and one less the power. The far side of the test is left out: its share is below
        the significance.

    Returns
    -------
    float

    Examples
    --------
    >>> round(detectable_shift(0.001, 0.2), 4)
    4.1321
    """
    one_sided = math.sqrt(
        chi2_quantile(min(2.0 * missed_detection, 2.0 - 2.0 * missed_detection), 1, upper=True)
    )
    return local_limit(false_alarm) + (one_sided if missed_detection < 0.5 else -one_sided)


def noncentral_chi2_cdf(x, dof, noncentrality):
    """Distribution function of the non-central chi-square distribution, as Poisson's mixture of central ones.

    Parameters
    ----------
    x : float
        Where.
    dof : int
        Degrees of freedom.
    noncentrality : float
        Sum of the squared shifts.

    Returns
    -------
    float
        To 1e-12.
    """
    half = 0.5 * noncentrality
    last = int(half + 12.0 * math.sqrt(half + 1.0) + 20.0)
    total, log_half = 0.0, math.log(half) if half > 0.0 else -math.inf
    for k in range(last + 1):
        log_weight = -half + (k * log_half - math.lgamma(k + 1.0) if k else 0.0)
        if log_weight > -40.0:
            total += math.exp(log_weight) * chi2_cdf(x, dof + 2 * k)
    return total


@functools.lru_cache(maxsize=1024)
def b_method_limit(dof, false_alarm=0.001, missed_detection=0.2):
    """Limit of the chi-square test that finds what the test of one observation finds.

    Parameters
    ----------
    dof : int
        Degrees of freedom of the test.
    false_alarm, missed_detection : float
        Of the test of one observation.

    Returns
    -------
    float
        Infinite for 0 degrees of freedom, where nothing can be tested.

    Examples
    --------
    >>> [round(b_method_limit(dof), 2) for dof in (3, 6, 9)]
    [12.63, 15.35, 18.08]
    """
    if dof <= 0:
        return math.inf
    noncentrality = detectable_shift(false_alarm, missed_detection) ** 2
    low, high = 0.0, dof + noncentrality + 40.0 * math.sqrt(dof + noncentrality)
    while high - low > 1e-11 * high:
        middle = 0.5 * (low + high)
        if noncentral_chi2_cdf(middle, dof, noncentrality) < missed_detection:
            low = middle
        else:
            high = middle
    return high


def b_method_significance(dof, false_alarm=0.001, missed_detection=0.2):
    """Significance of the test with the limit of `b_method_limit`.

    Parameters
    ----------
    dof : int
        Degrees of freedom.
    false_alarm, missed_detection : float
        Of the test of one observation.

    Returns
    -------
    float
    """
    return chi2_sf(b_method_limit(dof, false_alarm, missed_detection), dof) if dof > 0 else 0.0


def b_method_limits(max_dof, false_alarm=0.001, missed_detection=0.2):
    """Limits by degrees of freedom, for indexing.

    Parameters
    ----------
    max_dof : int
        Largest degrees of freedom.
    false_alarm, missed_detection : float
        Of the test of one observation.

    Returns
    -------
    ndarray, shape (max_dof + 1,)
    """
    return np.array([b_method_limit(dof, false_alarm, missed_detection) for dof in range(max_dof + 1)])


def normal_tail(x):
    """Both tails of the standard normal distribution, P(|z| > x).

    Parameters
    ----------
    x : ndarray
        Where; 1 is returned below 0.

    Returns
    -------
    ndarray
        With a relative error below 4e-6, interpolated between exact values; 0 beyond 37.5.
    """
    at, log_tail = _tail_table()
    x = np.asarray(x, dtype=float)
    return np.where(x > _FARTHEST, 0.0, np.exp(np.interp(x, at, log_tail)))


def normal_tail_quantile(probability):
    """Where both tails of the standard normal distribution hold a probability.

    Parameters
    ----------
    probability : ndarray
        0 where 1 or more is asked for, 37.5 at the farthest.

    Returns
    -------
    ndarray
    """
    at, log_tail = _tail_table()
    probability = np.maximum(np.asarray(probability, dtype=float), 1e-320)
    return np.interp(-np.log(probability), -log_tail, at)


@functools.cache
def _tail_table():
    """Nodes and the logarithms of both tails there."""
    at = np.arange(0.0, _FARTHEST + _STEP, _STEP)
    return at, np.array([math.log(math.erfc(x / math.sqrt(2.0))) for x in at])
