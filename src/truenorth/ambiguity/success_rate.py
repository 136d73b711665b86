"""How often integers will be right, told from the covariance alone, before any data.

With ``d`` the conditional variances of the (decorrelated) float ambiguities and Phi the normal
distribution function,

    P_bootstrap = prod_i (2 Phi(1 / (2 sqrt(d_i))) - 1)
    ADOP        = det(Q)^(1 / 2n) = (prod_i d_i)^(1 / 2n)                      cycles
    P_round <= P_bootstrap <= P_ils <= P(chi2_n <= c_n / ADOP^2),   c_n = (n/2 Gamma(n/2))^(2/n) / pi

Probabilities hold for unbiased normal noise with the covariance given; real noise is heavier.

References: Teunissen 1998, J. Geodesy 72:606-612 (rounding and bootstrapping); Teunissen 1999,
J. Geodesy 73:587-593 (integer least squares is best); Teunissen & Odijk 1997, ION GPS-97, 891-899
(ADOP); Hassibi & Boyd 1998, IEEE Trans. Signal Processing 46:2938-2952 (volume bound); Verhagen 2005,
Navigation 52:99-110 (comparison of the bounds).
"""

import math
from dataclasses import dataclass

import numpy as np

from ..errors import ModelError
from .acceptance import chi2_cdf

__all__ = [
    "SuccessRates",
    "adop",
    "adop_success_rate",
    "bootstrapped_success_rate",
    "ils_success_rate_bounds",
    "rounding_success_rate_bounds",
    "success_rates",
]


def bootstrapped_success_rate(conditional_variance_cyc2):
    """Probability that integer bootstrapping finds all integers; exact, and a lower bound for ILS.

    Parameters
    ----------
    conditional_variance_cyc2 : ndarray, shape (n,)
        Conditional variances ``d`` of ``Q = L^T diag(d) L``, cycles squared; decorrelated ones give the
        success rate of bootstrapping after decorrelation.

    Returns
    -------
    float
        Teunissen 1998; 1 for no ambiguities.

    Examples
    --------
    >>> round(bootstrapped_success_rate([0.25, 0.25]), 4)  # 1 sd is half a cycle: (0.6827)^2
    0.4661
    """
    return math.prod(_within_half_cycle(math.sqrt(d)) for d in np.atleast_1d(conditional_variance_cyc2))


def adop(conditional_variance_cyc2):
    """Ambiguity dilution of precision: the geometric mean of the conditional standard deviations.

    Parameters
    ----------
    conditional_variance_cyc2 : ndarray, shape (n,)
        Conditional variances, of any order of the ambiguities, cycles squared.

    Returns
    -------
    float
        Cycles; the same for every decorrelation, as the determinant does not change.

    Examples
    --------
    >>> round(adop([0.01, 0.04]), 6)
    0.141421
    """
    return math.exp(0.5 * float(np.mean(np.log(conditional_variance_cyc2))))


def adop_success_rate(adop_cyc, n):
    """Success rate of n ambiguities that would all have the conditional standard deviation ADOP.

    Parameters
    ----------
    adop_cyc : float
        Ambiguity dilution of precision, cycles.
    n : int
        Number of ambiguities.

    Returns
    -------
    float
        Upper bound of the bootstrapped success rate, and an approximation of that of integer least
        squares (Verhagen 2005).
    """
    return _within_half_cycle(adop_cyc) ** n


def rounding_success_rate_bounds(cov_cyc2):
    """Lower and upper bound of the success rate of rounding every ambiguity by itself.

    Parameters
    ----------
    cov_cyc2 : ndarray, shape (n, n)
        Covariance of the float ambiguities as they are rounded (decorrelated or not), cycles squared.

    Returns
    -------
    lower, upper : float
        The product of the marginal success rates (Teunissen 1998: Sidak's inequality) and the worst
        one of them.
    """
    share = [_within_half_cycle(math.sqrt(v)) for v in np.diag(np.atleast_2d(cov_cyc2))]
    return math.prod(share), min(share, default=1.0)


def ils_success_rate_bounds(conditional_variance_cyc2):
    """Lower and upper bound of the success rate of integer least squares.

    Parameters
    ----------
    conditional_variance_cyc2 : ndarray, shape (n,)
        Conditional variances of the decorrelated ambiguities, cycles squared.

    Returns
    -------
    lower, upper : float
        The bootstrapped success rate, and the probability of the ellipsoid with the volume of a
        pull-in region (one cycle to the power n).
    """
    n = np.size(conditional_variance_cyc2)
    if n == 0:
        return 1.0, 1.0
    log_c = (2.0 / n) * (math.log(n / 2.0) + math.lgamma(n / 2.0)) - math.log(math.pi)
    radius2 = math.exp(log_c) / adop(conditional_variance_cyc2) ** 2
    lower = bootstrapped_success_rate(conditional_variance_cyc2)
    # For n = 1 both are the same number, computed in two ways.
    return lower, max(chi2_cdf(radius2, n), lower)


@dataclass(frozen=True, slots=True)
class SuccessRates:
    """What the covariance says about resolving its ambiguities.

    Parameters
    ----------
    n : int
        Number of ambiguities.
    adop_cyc : float
        Ambiguity dilution of precision, cycles.
    bootstrapped : float
        Success rate of bootstrapping after decorrelation.
    adop_based : float
        ADOP-based approximation.
    rounding_lower, rounding_upper : float
        Bounds for rounding after decorrelation.
    ils_lower, ils_upper : float
        Bounds for integer least squares.
    """

    n: int
    adop_cyc: float
    bootstrapped: float
    adop_based: float
    rounding_lower: float
    rounding_upper: float
    ils_lower: float
    ils_upper: float


def success_rates(cov_cyc2):
    """All success rates and bounds of a covariance, after decorrelation.

    Parameters
    ----------
    cov_cyc2 : ndarray, shape (n, n)
        Covariance of the float ambiguities, cycles squared.

    Returns
    -------
    SuccessRates

    Raises
    ------
    ModelError
        The matrix is empty or not positive definite.
    """
    from .lambda_ import decorrelate

    decorrelation = decorrelate(cov_cyc2)
    d = decorrelation.d_cyc2
    if len(d) == 0:
        raise ModelError("computing success rates: there are no ambiguities; give at least one")
    rounding = rounding_success_rate_bounds(decorrelation.cov_z_cyc2())
    ils = ils_success_rate_bounds(d)
    return SuccessRates(
        n=len(d),
        adop_cyc=adop(d),
        bootstrapped=ils[0],
        adop_based=adop_success_rate(adop(d), len(d)),
        rounding_lower=rounding[0],
        rounding_upper=rounding[1],
        ils_lower=ils[0],
        ils_upper=ils[1],
    )


def _within_half_cycle(sd_cyc):
    """Probability that a normal error stays within half a cycle: 2 Phi(1 / (2 sd)) - 1."""
    return math.erf(1.0 / (2.0 * math.sqrt(2.0) * sd_cyc)) if sd_cyc > 0.0 else 1.0
