"""When to believe integers: ratio, difference, probability and residual tests.

With the costs C_1 <= C_2 <= ... of the candidates (weighted square sums against the float solution),

    ratio                C_2 / C_1 >= c           fixed c, or c for a fixed failure rate
    difference           C_2 - C_1 >= c
    posterior            exp(-C_1 / 2) / sum_k exp(-C_k / 2) >= P
    residuals            C_1 <= chi2 quantile

The ratio test with one c for all models fails too often in weak ones and asks too much of strong ones;
for a fixed failure rate c follows from the model, by simulation or from a table by number of
ambiguities and failure rate of integer least squares. The posterior is exact for normal noise and a
flat prior. The table is our own simulation (`tools/make_failure_rate_table.py`).

The chi-square functions are here because importing SciPy takes longer than solving a file.

References: Frei & Beutler 1990, Manuscripta Geodaetica 15:325-356 (ratio); Tiberius & de Jonge 1995,
DSNS-95, paper 30 (difference); Verhagen & Teunissen 2013, GPS Solutions 17:535-548 (fixed failure rate);
de Lacy et al. 2002, J. Geodesy 76:82-94, and Teunissen 2003, J. Geodesy 77:402-410 (posterior); Abramowitz &
Stegun 1964, 6.5.29, 6.5.31, 26.4.17.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np

from ..errors import ConfigError, Reason

__all__ = [
    "POSTERIOR_WINDOW",
    "AcceptanceTest",
    "chi2_cdf",
    "chi2_limits",
    "chi2_quantile",
    "chi2_sf",
    "difference_test",
    "difference_threshold",
    "posterior_probability",
    "probability_test",
    "ratio_test",
    "residual_test",
    "simulated_ratio_threshold",
    "tabulated_ratio_threshold",
]

POSTERIOR_WINDOW = 30.0
"""Candidates this much costlier than the best weigh less than 3e-7 and are left out of the posterior."""


@dataclass(frozen=True, slots=True)
class AcceptanceTest:
    """Outcome of one test.

    Parameters
    ----------
    accepted : bool
        Whether the statistic is on the right side of the limit.
    reason : Reason
        `Reason.OK`, or what failed.
    statistic, limit : float
        The numbers that decided; NaN where there is none.
    """

    accepted: bool
    reason: Reason
    statistic: float
    limit: float


def ratio_test(costs, threshold=3.0):
    """Ratio test: second-best over best cost at least `threshold`.

    Parameters
    ----------
    costs : ndarray, shape (c,)
        Costs of the candidates, ascending.
    threshold : float
        At least 1; `tabulated_ratio_threshold` and `simulated_ratio_threshold` give it for a demanded
        failure rate. Infinite refuses everything.

    Returns
    -------
    AcceptanceTest
        A single candidate is refused with `Reason.SINGLE_CANDIDATE`, because the ratio is unknown.

    Examples
    --------
    >>> ratio_test([0.2183, 0.3073], 3.0).accepted
    False
    """
    if len(costs) < 2:
        return _single(costs, threshold)
    ratio = float(costs[1] / costs[0]) if costs[0] > 0.0 else math.inf
    passed = ratio >= threshold and math.isfinite(threshold)
    return AcceptanceTest(passed, Reason.OK if passed else Reason.RATIO_TEST, ratio, float(threshold))


def difference_test(costs, threshold):
    """Difference test: second-best less best cost at least `threshold`.

    Parameters
    ----------
    costs : ndarray, shape (c,)
        Costs of the candidates, ascending.
    threshold : float
        Square-sum units; see `difference_threshold`.

    Returns
    -------
    AcceptanceTest
        A failure has `Reason.RATIO_TEST`, the reason of all tests against the second-best.
    """
    if len(costs) < 2:
        return _single(costs, threshold)
    difference = float(costs[1] - costs[0])
    passed = difference >= threshold
    return AcceptanceTest(passed, Reason.OK if passed else Reason.RATIO_TEST, difference, float(threshold))


def difference_threshold(probability):
    """Threshold of the difference test at which the best of two candidates has this posterior.

    Parameters
    ----------
    probability : float
        Between 0.5 and 1.

    Returns
    -------
    float
        ``2 ln(P / (1 - P))``.

    Examples
    --------
    >>> round(difference_threshold(0.99), 2)
    9.19
    """
    return 2.0 * math.log(probability / (1.0 - probability))


def posterior_probability(costs):
    """Posterior probability of the first candidate among all those given.

    Parameters
    ----------
    costs : ndarray, shape (c,)
        Costs of all candidates that weigh anything: those within `POSTERIOR_WINDOW` of the best. A cut
        list makes the probability too high. The first is the candidate in question.

    Returns
    -------
    float
        ``exp(-C_1 / 2) / sum exp(-C_k / 2)``; NaN without candidates.

    Examples
    --------
    >>> round(posterior_probability([1.0, 10.19]), 3)
    0.99
    """
    costs = np.asarray(costs, dtype=float)
    if costs.size == 0:
        return math.nan
    least = costs.min()
    weights = np.exp(-0.5 * (costs - least))
    return float(weights[0] / weights.sum())


def probability_test(probability, level):
    """Accept when the posterior probability reaches `level`.

    Parameters
    ----------
    probability : float
        From `posterior_probability`; NaN is refused.
    level : float
        Demanded probability.

    Returns
    -------
    AcceptanceTest
    """
    passed = bool(probability >= level)
    return AcceptanceTest(
        passed, Reason.OK if passed else Reason.PROBABILITY_TEST, float(probability), float(level)
    )


def residual_test(chi2, dof, false_alarm=1e-4):
    """Chi-square test of a weighted square sum of residuals.

    Parameters
    ----------
    chi2 : float
        Weighted square sum; NaN is refused.
    dof : int
        Degrees of freedom; 0 accepts, because nothing can be tested.
    false_alarm : float
        Probability of refusing right integers.

    Returns
    -------
    AcceptanceTest
    """
    if dof <= 0:
        return AcceptanceTest(True, Reason.OK, float(chi2), math.nan)
    limit = chi2_quantile(false_alarm, dof, upper=True)
    passed = bool(chi2 <= limit)
    return AcceptanceTest(passed, Reason.OK if passed else Reason.RESIDUAL_TEST, float(chi2), limit)


def tabulated_ratio_threshold(n, ils_failure_rate, failure_rate=0.001):
    """Threshold of the ratio test for a fixed failure rate, from the committed table.

    Parameters
    ----------
    n : int
        Number of ambiguities.
    ils_failure_rate : float
        Failure rate of integer least squares without a test. One minus the bootstrapped success rate
        is an upper bound of it and gives a safe threshold.
    failure_rate : float
        Demanded failure rate, 0.01 or 0.001.

    Returns
    -------
    float
        ``c`` of ``C_2 / C_1 >= c``: 1 where the model meets the failure rate without a test, infinite
        beyond the failure rates of the table (0.1), where a test cannot save the model.

    Raises
    ------
    ConfigError
        The failure rate is not in the table.

    Notes
    -----
    Linear in log failure rate and n between the nodes; beyond the table's n the last column is used.
    The simulated models are single epochs of one to three frequencies, and each node holds the most
    careful of its models (Verhagen & Teunissen 2013, sec. 4). For a model of another kind use
    `simulated_ratio_threshold`.
    """
    from .failure_rate_table import DIMENSIONS, ILS_FAILURE_RATES, RATIO

    if failure_rate not in RATIO:
        known = ", ".join(f"{rate:g}" for rate in RATIO)
        raise ConfigError(
            f"`failure_rate` is {failure_rate!r}, and the table holds {known}; give one of them or simulate",
            key="failure_rate",
            value=failure_rate,
        )
    if not ils_failure_rate > failure_rate:
        return 1.0 if ils_failure_rate == ils_failure_rate else math.inf
    if ils_failure_rate > ILS_FAILURE_RATES[-1]:
        return math.inf
    table = np.array(RATIO[failure_rate])
    log_rate = math.log(ils_failure_rate)
    by_n = [np.interp(log_rate, np.log(ILS_FAILURE_RATES), row) for row in table]
    return float(max(1.0, np.interp(n, DIMENSIONS, by_n)))


def simulated_ratio_threshold(cov_cyc2, failure_rate=0.001, *, n_draws=20_000, seed=0):
    """Threshold of the ratio test for a fixed failure rate, by simulating this very model.

    Parameters
    ----------
    cov_cyc2 : ndarray, shape (n, n)
        Covariance of the float ambiguities, cycles squared.
    failure_rate : float
        Demanded share of accepted and wrong among all trials.
    n_draws : int
        Trials; at least some 20 over the failure rate.
    seed : int
        Of the generator; the same seed gives the same threshold.

    Returns
    -------
    threshold : float
        ``c`` of ``C_2 / C_1 >= c``, at least 1.
    ils_failure_rate : float
        Share of wrong integers without a test.

    Raises
    ------
    ModelError
        The covariance is not positive definite.
    """
    ratio, is_right = simulate_ratios(cov_cyc2, n_draws=n_draws, seed=seed)
    return ratio_threshold_of_draws(ratio, is_right, failure_rate), float(np.mean(~is_right))


def simulate_ratios(cov_cyc2, *, n_draws, seed):
    """Ratios of integer least squares on float ambiguities drawn from N(0, cov).

    Parameters
    ----------
    cov_cyc2 : ndarray, shape (n, n)
        Covariance of the float ambiguities, cycles squared.
    n_draws, seed : int
        Number of trials, and seed of the generator.

    Returns
    -------
    ratio : ndarray, shape (n_draws,)
        Second-best over best cost.
    is_right : ndarray of bool, shape (n_draws,)
        Whether the best candidate is the truth (zero).

    Raises
    ------
    ModelError
        The covariance is not positive definite.
    """
    from .._kernels.ils import search_best
    from .lambda_ import MAX_NODES, decorrelate

    decorrelation = decorrelate(cov_cyc2)
    L, d = decorrelation.L, decorrelation.d_cyc2
    n = len(d)
    rng = np.random.default_rng(seed)
    z_hat = (rng.standard_normal((n_draws, n)) * np.sqrt(d)) @ L
    z, cost = np.empty((2, n)), np.empty(2)
    ratio, is_right = np.empty(n_draws), np.empty(n_draws, dtype=bool)
    for k in range(n_draws):
        search_best(n, L, d, z_hat[k], 2, z, cost, MAX_NODES)
        ratio[k] = cost[1] / cost[0]
        is_right[k] = not z[0].any()
    return ratio, is_right


def ratio_threshold_of_draws(ratio, is_right, failure_rate):
    """Smallest threshold at which at most this share of the draws is accepted and wrong.

    Parameters
    ----------
    ratio, is_right : ndarray, shape (n_draws,)
        From `simulate_ratios`.
    failure_rate : float
        Demanded failure rate.

    Returns
    -------
    float
        At least 1.
    """
    wrong = np.sort(ratio[~is_right])
    allowed = math.floor(failure_rate * len(ratio))
    if len(wrong) <= allowed:
        return 1.0
    # Accepting needs ratio >= c: c just above the largest ratio that must be refused.
    return float(max(1.0, np.nextafter(wrong[len(wrong) - 1 - allowed], math.inf)))


def chi2_cdf(x, dof):
    """Distribution function of the chi-square distribution.

    Parameters
    ----------
    x : float
        Where; values below 0 give 0.
    dof : float
        Degrees of freedom, above 0.

    Returns
    -------
    float

    Examples
    --------
    >>> round(chi2_cdf(3.841459, 1), 6)
    0.95
    """
    return _gamma_shares(0.5 * dof, 0.5 * x)[0]


def chi2_sf(x, dof):
    """Upper tail of the chi-square distribution, accurate where it is small.

    Parameters
    ----------
    x : float
        Where.
    dof : float
        Degrees of freedom, above 0.

    Returns
    -------
    float
        ``1 - chi2_cdf(x, dof)`` without the loss of digits.
    """
    return _gamma_shares(0.5 * dof, 0.5 * x)[1]


@functools.lru_cache(maxsize=1024)
def chi2_quantile(probability, dof, *, upper=False):
    """Quantile of the chi-square distribution.

    Parameters
    ----------
    probability : float
        Between 0 and 1.
    dof : float
        Degrees of freedom, above 0.
    upper : bool
        The probability is that of the upper tail (a false-alarm rate).

    Returns
    -------
    float
        Relative accuracy 1e-10; 0 or infinity at the ends.

    Notes
    -----
    Wilson-Hilferty start, then Newton steps kept inside a shrinking bracket.

    Examples
    --------
    >>> round(chi2_quantile(0.05, 1, upper=True), 6)
    3.841459
    """
    if not (0.0 <= probability <= 1.0 and dof > 0.0):
        return math.nan
    if probability in (0.0, 1.0):
        return math.inf if (probability == 1.0) != upper else 0.0
    # Work on the tail that is given, so that small probabilities keep their digits.
    tail = 1 if upper else 0
    sign = -1.0 if upper else 1.0
    z = sign * _normal_quantile(probability)
    step = 2.0 / (9.0 * dof)
    base = 1.0 - step + z * math.sqrt(step)
    # Far in the lower tail Wilson-Hilferty turns negative; there cdf ~ (x/2)^a / Gamma(a + 1).
    a = 0.5 * dof
    if base > 0.1:
        x = dof * base**3
    else:
        log_lower = math.log1p(-probability) if upper else math.log(probability)
        x = 2.0 * math.exp((log_lower + math.lgamma(a + 1.0)) / a)
    low, high = 0.0, math.inf
    for _ in range(100):
        share = _gamma_shares(a, 0.5 * x)[tail]
        excess = sign * (share - probability)
        if excess > 0.0:
            high = min(high, x)
        else:
            low = max(low, x)
        log_density = (a - 1.0) * math.log(0.5 * x) - 0.5 * x - math.lgamma(a) - math.log(2.0)
        # Newton on the logarithm of the share is nearly linear in the tails.
        delta = (
            sign * share * math.log(share / probability) / math.exp(log_density) if share > 0.0 else math.inf
        )
        if abs(delta) <= 1e-9 * x:
            # Newton squares the error, so this step ends at the rounding.
            return x - delta
        new = x - delta
        if not low < new < high:
            new = 0.5 * (low + high) if math.isfinite(high) else 2.0 * x
        x = new
    return x


def chi2_limits(false_alarm, max_dof):
    """Limits of the residual test for all degrees of freedom, as an array for compiled loops.

    Parameters
    ----------
    false_alarm : float
        Upper-tail probability.
    max_dof : int
        Largest degrees of freedom.

    Returns
    -------
    ndarray, shape (max_dof + 1,)
        Quantile by degrees of freedom; infinity at 0, where nothing can be tested.
    """
    return np.array([math.inf, *(_chi2_limit(false_alarm, dof) for dof in range(1, max_dof + 1))])


@functools.lru_cache(maxsize=4096)
def _chi2_limit(false_alarm, dof):
    """Upper quantile, remembered: a run asks for the same ones several times."""
    return chi2_quantile(false_alarm, dof, upper=True)


def _single(costs, threshold):
    """Outcome of the tests against a second-best that does not exist."""
    reason = Reason.SINGLE_CANDIDATE if len(costs) else Reason.NO_CANDIDATE
    return AcceptanceTest(False, reason, math.nan, float(threshold))


def _gamma_shares(a, x):
    """Regularised incomplete gamma functions P(a, x) and Q(a, x)."""
    if not x > 0.0:
        return (math.nan, math.nan) if x != x else (0.0, 1.0)
    if math.isinf(x):
        return 1.0, 0.0
    front = math.exp(a * math.log(x) - x - math.lgamma(a))
    if x < a + 1.0:
        # Series (A&S 6.5.29).
        term = total = 1.0 / a
        k = a
        while abs(term) > 1e-17 * abs(total):
            k += 1.0
            term *= x / k
            total += term
        lower = front * total
        return lower, 1.0 - lower
    # Continued fraction (A&S 6.5.31) by Lentz's method.
    tiny = 1e-300
    b = x + 1.0 - a
    c = 1.0 / tiny
    d = 1.0 / b
    fraction = d
    for k in range(1, 10_000):
        numerator = k * (a - k)
        b += 2.0
        d = numerator * d + b
        d = 1.0 / (d if abs(d) > tiny else tiny)
        c = b + numerator / c
        c = c if abs(c) > tiny else tiny
        change = c * d
        fraction *= change
        if abs(change - 1.0) < 1e-16:
            break
    upper = front * fraction
    return 1.0 - upper, upper


def _normal_quantile(probability):
    """Normal quantile to 5e-4 (A&S 26.2.23), enough to start Newton."""
    tail = min(probability, 1.0 - probability)
    t = math.sqrt(-2.0 * math.log(tail)) if tail > 0.0 else 38.0
    z = t - (2.515517 + 0.802853 * t + 0.010328 * t * t) / (
        1.0 + 1.432788 * t + 0.189269 * t * t + 0.001308 * t**3
    )
    return -z if probability < 0.5 else z
