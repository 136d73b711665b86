"""LAMBDA: decorrelation, then rounding, bootstrapping or integer least squares.

    a_hat ~ N(a, Q_a),    a integer:      minimise (a_hat - a)^T Q_a^{-1} (a_hat - a)

For one epoch of double differences the code (and a prior, where there is one) gives a float baseline
b_hat with covariance Q_b, and every phase then gives its own float ambiguity:

    a_hat = (phase - H b_hat) / lambda,       Q_a = (Q_phase + H Q_b H^T) / (lambda lambda^T)
    b(a)  = b_hat - Q_ba Q_a^{-1} (a_hat - a),    Q_ba = -Q_b H^T / lambda

The baseline length takes no part in the search; it can be checked afterwards (`constrained` puts it
into the search). Whole cycles are moved out of the floats first, so phases of 1e9 cycles lose nothing.

References: Teunissen 1995, J. Geodesy 70:65-82; Teunissen 1999, J. Geodesy 73:587-593; Teunissen,
Joosten & Tiberius 1999, ION NTM-99, 5-14 (partial fixing); Chang, Yang & Zhou 2005, J. Geodesy
79:552-565; Verhagen & Teunissen 2013, GPS Solutions 17:535-548.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..errors import ConfigError, ModelError, Reason, Status
from .acceptance import (
    POSTERIOR_WINDOW,
    AcceptanceTest,
    difference_test,
    difference_threshold,
    probability_test,
    ratio_test,
    residual_test,
    tabulated_ratio_threshold,
)
from .model import DoubleDifferences, Resolution
from .success_rate import bootstrapped_success_rate

__all__ = [
    "Decorrelation",
    "FloatSolution",
    "IntegerCandidates",
    "PartialFix",
    "bootstrap",
    "decorrelate",
    "estimate_float",
    "integer_least_squares",
    "partial_fix",
    "resolve_lambda",
    "round_integers",
]

MAX_NODES = 20_000_000
"""Nodes after which a search stops and says so; about half a second."""

_POSTERIOR_CAPACITY = 20_000
"""Candidates that may take part in one posterior."""

_POSTERIOR_NODES = 400_000


@dataclass(frozen=True, slots=True, eq=False)
class Decorrelation:
    """An integer change of variables that makes ambiguities nearly independent.

    Parameters
    ----------
    z_transform : ndarray of int64, shape (n, n)
        ``Z``, of determinant +-1: ``z = Z^T a``.
    inverse_transpose : ndarray of int64, shape (n, n)
        ``Z^{-T}``: ``a = Z^{-T} z``.
    L : ndarray, shape (n, n)
        Unit lower triangular, elements at most one half: ``Z^T Q Z = L^T diag(d) L``.
    d_cyc2 : ndarray, shape (n,)
        Conditional variances of z, cycles squared; the last one is not conditional on any.
    """

    z_transform: np.ndarray
    inverse_transpose: np.ndarray
    L: np.ndarray
    d_cyc2: np.ndarray

    @property
    def n(self):
        """int: Number of ambiguities."""
        return len(self.d_cyc2)

    def to_z(self, a_cyc):
        """Ndarray: z = Z^T a of ambiguities in the last axis."""
        return a_cyc @ self.z_transform

    def from_z(self, z_cyc):
        """Ndarray: a = Z^{-T} z of decorrelated ambiguities in the last axis."""
        return z_cyc @ self.inverse_transpose.T

    def cov_z_cyc2(self):
        """Ndarray, shape (n, n): covariance of z, cycles squared."""
        return (self.L.T * self.d_cyc2) @ self.L

    def success_rate(self):
        """float: Bootstrapped success rate of z."""
        return bootstrapped_success_rate(self.d_cyc2)


@dataclass(frozen=True, slots=True, eq=False)
class IntegerCandidates:
    """Integer vectors in order of cost.

    Parameters
    ----------
    integers_cyc : ndarray of int64, shape (c, n)
        Best first.
    cost : ndarray, shape (c,)
        ``(a_hat - a)^T Q^{-1} (a_hat - a)``.
    is_complete : bool
        Whether the search proved that no other vector is better. False when it reached its limit of
        nodes: then these are the best that it met.
    n_nodes : int
        Integers tried at one level of the tree.
    """

    integers_cyc: np.ndarray
    cost: np.ndarray
    is_complete: bool
    n_nodes: int


@dataclass(frozen=True, slots=True, eq=False)
class PartialFix:
    """Integers for the well-determined part; the rest stays float, improved by what was fixed.

    Parameters
    ----------
    is_fixed : ndarray of bool, shape (n,)
        Ambiguities whose integers are determined; the others were left out.
    float_cyc : ndarray, shape (n,)
        Integers where `is_fixed`, conditional floats elsewhere.
    cov_cyc2 : ndarray, shape (n, n)
        Covariance given the fixed part; zero rows where `is_fixed`.
    success_rate : float
        Bootstrapped success rate of the fixed part.
    n_fixed_z : int
        Decorrelated ambiguities that were fixed: integer combinations count here even where no single
        ambiguity came out fixed.
    candidates : IntegerCandidates
        Search among the fixed decorrelated ambiguities; its integers are z, the last `n_fixed_z`.
    decorrelation : Decorrelation
        What z means.
    """

    is_fixed: np.ndarray
    float_cyc: np.ndarray
    cov_cyc2: np.ndarray
    success_rate: float
    n_fixed_z: int
    candidates: IntegerCandidates
    decorrelation: Decorrelation

    @property
    def left_out(self):
        """Ndarray of int: indices of the ambiguities that stay float."""
        return np.flatnonzero(~self.is_fixed)


@dataclass(frozen=True, slots=True, eq=False)
class FloatSolution:
    """Float baseline and ambiguities of one epoch.

    Parameters
    ----------
    float_cyc : ndarray, shape (m,)
        Float double-difference ambiguities, cycles.
    cov_cyc2 : ndarray, shape (m, m)
        Their covariance.
    baseline_enu_m : ndarray, shape (3,)
        Float baseline.
    cov_baseline_m2 : ndarray, shape (3, 3)
        Its covariance.
    cov_baseline_float_m_cyc : ndarray, shape (3, m)
        Covariance between the two.
    """

    float_cyc: np.ndarray
    cov_cyc2: np.ndarray
    baseline_enu_m: np.ndarray
    cov_baseline_m2: np.ndarray
    cov_baseline_float_m_cyc: np.ndarray


def decorrelate(cov_cyc2):
    """Decorrelating integer transform of an ambiguity covariance.

    Parameters
    ----------
    cov_cyc2 : ndarray, shape (n, n)
        Symmetric positive definite, cycles squared; the lower triangle is read.

    Returns
    -------
    Decorrelation

    Raises
    ------
    ModelError
        The matrix is not square, not finite or not positive definite.

    Examples
    --------
    >>> decorrelation = decorrelate([[6.290, 5.978, 0.544], [5.978, 6.292, 2.340], [0.544, 2.340, 6.288]])
    >>> abs(round(float(np.linalg.det(decorrelation.z_transform))))
    1
    """
    from .._kernels import ldl

    cov = np.ascontiguousarray(cov_cyc2, dtype=np.float64)
    n = len(cov) if cov.ndim == 2 else -1
    if cov.shape != (n, n):
        raise ModelError(
            f"decorrelating ambiguities: the covariance has the shape {cov.shape}; give a square matrix"
        )
    if not cov.flags.writeable:
        cov = cov.copy()
    z_transform, inverse_transpose = np.empty((n, n)), np.empty((n, n))
    L, d = np.empty((n, n)), np.empty(n)
    if ldl.decorrelate(cov, n, L, d, z_transform, inverse_transpose) != ldl.OK:
        raise ModelError(
            f"decorrelating {n} ambiguities: their covariance is not positive definite; "
            "leave out the ambiguities that nothing determines, or give the noise a variance"
        )
    return Decorrelation(z_transform.astype(np.int64), inverse_transpose.astype(np.int64), L, d)


def round_integers(float_cyc):
    """Round every ambiguity by itself to the nearest integer.

    Parameters
    ----------
    float_cyc : ndarray
        Float ambiguities, cycles.

    Returns
    -------
    ndarray of int64
    """
    return np.rint(np.asarray(float_cyc, dtype=float)).astype(np.int64)


def bootstrap(float_cyc, cov_cyc2, *, decorrelated=True):
    """Integer bootstrapping: round one by one, correcting the rest for what was rounded.

    Parameters
    ----------
    float_cyc : ndarray, shape (n,)
        Float ambiguities, cycles.
    cov_cyc2 : ndarray, shape (n, n)
        Their covariance.
    decorrelated : bool
        Bootstrap after decorrelation, the better way; otherwise as given, from the last to the first.

    Returns
    -------
    ndarray of int64, shape (n,)
        Integers; `truenorth.ambiguity.success_rate.bootstrapped_success_rate` says how often they are
        right.
    """
    whole, fraction = _split(float_cyc)
    if decorrelated:
        decorrelation = decorrelate(cov_cyc2)
        z = _bootstrap_z(decorrelation.to_z(fraction), decorrelation.L)
        return whole + decorrelation.from_z(z)
    return whole + _bootstrap_z(fraction, _factor(cov_cyc2)[0])


def integer_least_squares(float_cyc, cov_cyc2, candidates=2, *, max_nodes=MAX_NODES):
    """Integer vectors of least cost, by the shrinking search in the decorrelated space.

    Parameters
    ----------
    float_cyc : ndarray, shape (n,)
        Float ambiguities, cycles.
    cov_cyc2 : ndarray, shape (n, n)
        Their covariance.
    candidates : int
        How many vectors to return.
    max_nodes : int
        Where the search stops, unfinished.

    Returns
    -------
    IntegerCandidates
        With ``is_complete``, the true optima; otherwise the best that were met.

    Raises
    ------
    ModelError
        The covariance is not positive definite, or the floats are not finite.

    Examples
    --------
    The example of de Jonge & Tiberius 1996:

    >>> cov = [[6.290, 5.978, 0.544], [5.978, 6.292, 2.340], [0.544, 2.340, 6.288]]
    >>> best = integer_least_squares([5.450, 3.100, 2.970], cov)
    >>> best.integers_cyc.tolist(), best.cost.round(4).tolist()
    ([[5, 3, 4], [6, 4, 4]], [0.2183, 0.3073])
    """
    whole, fraction = _split(float_cyc)
    decorrelation = decorrelate(cov_cyc2)
    found = _search(
        decorrelation.to_z(fraction), decorrelation.L, decorrelation.d_cyc2, candidates, max_nodes
    )
    return IntegerCandidates(
        whole + decorrelation.from_z(found.integers_cyc), found.cost, found.is_complete, found.n_nodes
    )


def partial_fix(float_cyc, cov_cyc2, min_success_rate=0.999, *, candidates=2, max_nodes=MAX_NODES):
    """Fix the largest decorrelated subset that reaches a success rate, and say what was left out.

    Parameters
    ----------
    float_cyc : ndarray, shape (n,)
        Float ambiguities, cycles.
    cov_cyc2 : ndarray, shape (n, n)
        Their covariance.
    min_success_rate : float
        Bootstrapped success rate that the fixed part must have.
    candidates : int
        Vectors of the fixed part to search for.
    max_nodes : int
        Where the search stops, unfinished.

    Returns
    -------
    PartialFix

    Notes
    -----
    The decorrelated ambiguities are ordered by conditional variance, the smallest last; they are taken
    from the end while the product of their success rates allows, fixed by integer least squares, and
    the rest follows from its conditional expectation. An ambiguity is fixed when it is a combination
    of fixed z alone.
    """
    whole, fraction = _split(float_cyc)
    decorrelation = decorrelate(cov_cyc2)
    L, d, n = decorrelation.L, decorrelation.d_cyc2, decorrelation.n
    first, rate = n, 1.0
    while first > 0:
        with_next = rate * bootstrapped_success_rate(d[first - 1 : first])
        if with_next < min_success_rate:
            break
        first, rate = first - 1, with_next
    z_hat = decorrelation.to_z(fraction)
    found = _search(z_hat[first:], L[first:, first:], d[first:], candidates, max_nodes)
    if len(found.cost) == 0:
        first, rate = n, 1.0
    z_fixed = found.integers_cyc[0] if first < n else np.empty(0, dtype=np.int64)
    z = z_hat.copy()
    cov_z = np.zeros((n, n))
    if first > 0:
        # With Q = L^T D L the conditional z_1 | z_2 has the covariance L11^T D1 L11, and moves by
        # L21^T L22^{-T} (z_2 - z_hat_2).
        shift = np.linalg.solve(L[first:, first:].T, z_fixed - z_hat[first:])
        z[:first] += L[first:, :first].T @ shift
        cov_z[:first, :first] = (L[:first, :first].T * d[:first]) @ L[:first, :first]
    z[first:] = z_fixed
    back = decorrelation.inverse_transpose
    is_fixed = ~back[:, :first].any(axis=1)
    float_fixed = whole + np.where(is_fixed, np.rint(decorrelation.from_z(z)), decorrelation.from_z(z))
    cov = back @ cov_z @ back.T
    return PartialFix(is_fixed, float_fixed, cov, rate, n - first, found, decorrelation)


def estimate_float(problem):
    """Float ambiguities and baseline of one epoch of double differences.

    Parameters
    ----------
    problem : DoubleDifferences
        One epoch.

    Returns
    -------
    FloatSolution or Reason
        The reason when code and prior together do not determine the baseline.
    """
    normal, right = np.zeros((3, 3)), np.zeros(3)
    has_prior = problem.prior_baseline_enu_m is not None and problem.cov_prior_m2 is not None
    if has_prior:
        weight = np.linalg.inv(problem.cov_prior_m2)
        normal += weight
        right += weight @ problem.prior_baseline_enu_m
    if len(problem.code_m):
        weighted = np.linalg.solve(problem.cov_code_m2, problem.code_design).T
        normal += weighted @ problem.code_design
        right += weighted @ problem.code_m
    elif not has_prior:
        return Reason.NO_CODE
    if not has_prior and len(problem.code_m) < 3:
        return Reason.TOO_FEW_SATELLITES
    # Directions known to worse than a millionth of the best one count as not known.
    if not np.all(np.isfinite(normal)) or np.linalg.cond(normal) > 1e12:
        return Reason.WEAK_GEOMETRY
    cov_baseline = np.linalg.inv(normal)
    cov_baseline = 0.5 * (cov_baseline + cov_baseline.T)
    baseline = cov_baseline @ right
    design_cyc = problem.design / problem.wavelength_m[:, None]
    cov_phase_cyc2 = problem.cov_phase_m2 / np.outer(problem.wavelength_m, problem.wavelength_m)
    return FloatSolution(
        float_cyc=problem.phase_m / problem.wavelength_m - design_cyc @ baseline,
        cov_cyc2=cov_phase_cyc2 + design_cyc @ cov_baseline @ design_cyc.T,
        baseline_enu_m=baseline,
        cov_baseline_m2=cov_baseline,
        cov_baseline_float_m_cyc=-cov_baseline @ design_cyc.T,
    )


def resolve_lambda(
    problem: DoubleDifferences,
    *,
    estimator="ils",
    candidates=2,
    min_success_rate=None,
    success_probability=0.99,
    ratio_test_kind="none",
    ratio_threshold=3.0,
    failure_rate=0.001,
    residual_significance=1e-4,
    check_length=True,
    length_tolerance_sd=4.0,
    max_nodes=MAX_NODES,
) -> Resolution:
    """Resolve the ambiguities of one epoch by LAMBDA, without the length in the search.

    Parameters
    ----------
    problem : DoubleDifferences
        One epoch; needs pseudoranges or a prior baseline.
    estimator : {"ils", "bootstrap", "round"}
        Integer least squares, or the simpler estimators after decorrelation.
    candidates : int
        Candidates to return, at least 2 for the ratio and difference tests.
    min_success_rate : float, optional
        Fix only the largest subset with this bootstrapped success rate (partial fixing).
    success_probability : float
        Posterior probability demanded; 0 demands nothing.
    ratio_test_kind : {"none", "fixed", "fixed_failure_rate", "difference"}
        Classical test beside it.
    ratio_threshold : float
        For "fixed".
    failure_rate : float
        For "fixed_failure_rate", 0.01 or 0.001.
    residual_significance : float
        False-alarm rate of the chi-square test of the winner.
    check_length : bool
        Refuse when the fixed baseline's length disagrees with the declared one, where there is one.
    length_tolerance_sd : float
        By more than this many joint standard deviations.
    max_nodes : int
        Limit of the search.

    Returns
    -------
    Resolution
        The objective is the cost against the float solution, which equals the weighted residual square
        sum of the fixed adjustment less that of the code adjustment. It has as many degrees of freedom
        as ambiguities were fixed.

    Raises
    ------
    ConfigError
        An option is unknown.
    """
    _refuse_unknown("estimator", estimator, ("ils", "bootstrap", "round"))
    _refuse_unknown("ratio_test", ratio_test_kind, ("none", "fixed", "fixed_failure_rate", "difference"))
    m = problem.n_phases
    if m == 0:
        return _unresolved(problem, Reason.TOO_FEW_SATELLITES)
    floats = estimate_float(problem)
    if isinstance(floats, Reason):
        return _unresolved(problem, floats)

    whole, fraction = _split(floats.float_cyc)
    try:
        decorrelation = decorrelate(floats.cov_cyc2)
    except ModelError:
        return _unresolved(problem, Reason.WEAK_GEOMETRY, floats)
    L, d = decorrelation.L, decorrelation.d_cyc2
    z_hat = decorrelation.to_z(fraction)
    first = 0 if min_success_rate is None else _first_of_subset(d, min_success_rate)
    if first == m:
        return _unresolved(problem, Reason.PROBABILITY_TEST, floats)
    L2, d2, z2 = np.ascontiguousarray(L[first:, first:]), np.ascontiguousarray(d[first:]), z_hat[first:]

    found = _search(z2, L2, d2, max(candidates, 1), max_nodes)
    if len(found.cost) == 0:
        return _unresolved(problem, Reason.SEARCH_LIMIT, floats)
    z_candidates, cost = found.integers_cyc, found.cost
    if estimator != "ils":
        z_one = _bootstrap_z(z2, L2) if estimator == "bootstrap" else round_integers(z2)
        z_candidates, cost = _put_first(z_one, _cost(z2 - z_one, L2, d2), z_candidates, cost)

    # Baselines, and the floats that follow from the fixed part: conditional expectations.
    to_z = decorrelation.z_transform[:, first:]
    cov_bz = floats.cov_baseline_float_m_cyc @ to_z
    gain = np.linalg.solve((L2.T * d2) @ L2, cov_bz.T).T
    baselines = floats.baseline_enu_m + (z_candidates - z2) @ gain.T
    cov_baseline = floats.cov_baseline_m2 - gain @ cov_bz.T
    integers, is_fixed = _integers_of_candidates(decorrelation, z_hat, z_candidates, first)

    probability, n_evaluated = _posterior(z2, L2, d2, cost)
    tests = [
        _complete_test(found, max_nodes),
        residual_test(cost[0], m - first, residual_significance),
        _length_test(problem, baselines[0], cov_baseline, length_tolerance_sd if check_length else math.inf),
        _classical_test(ratio_test_kind, cost, d2, ratio_threshold, failure_rate, success_probability),
    ]
    if success_probability > 0.0:
        tests.append(probability_test(probability, success_probability))
    reason = next((test.reason for test in tests if not test.accepted), Reason.OK)
    return Resolution(
        status=Status.FIXED if reason == Reason.OK else Status.FLOAT,
        reason=reason,
        integers_cyc=whole + integers,
        objective=cost,
        baseline_enu_m=baselines,
        cov_baseline_m2=0.5 * (cov_baseline + cov_baseline.T),
        float_baseline_enu_m=floats.baseline_enu_m,
        is_fixed=is_fixed,
        ratio=ratio_test(cost).statistic,
        success_probability=probability,
        chi2=float(cost[0]),
        chi2_limit=tests[1].limit,
        n_candidates=max(n_evaluated, len(cost)),
    )


def _split(float_cyc):
    """Whole cycles as int64, and the rest."""
    floats = np.asarray(float_cyc, dtype=float)
    if not np.all(np.isfinite(floats)):
        raise ModelError("resolving ambiguities: a float ambiguity is not finite; leave it out")
    whole = np.rint(floats)
    return whole.astype(np.int64), floats - whole


def _factor(cov_cyc2):
    """L and d of a covariance, not decorrelated."""
    from .._kernels import ldl

    cov = np.array(cov_cyc2, dtype=np.float64, order="C")
    n = len(cov)
    L, d = np.empty((n, n)), np.empty(n)
    if ldl.ldl_factor(cov, n, L, d) != ldl.OK:
        raise ModelError(f"factoring the covariance of {n} ambiguities: it is not positive definite")
    return L, d


def _search(z_hat, L, d, candidates, max_nodes):
    """`IntegerCandidates` in the space of z."""
    from .._kernels import ils

    n = len(d)
    z, cost = np.empty((candidates, n)), np.empty(candidates)
    z_hat, L, d = (np.ascontiguousarray(x, dtype=np.float64) for x in (z_hat, L, d))
    count, n_nodes, status = ils.search_best(n, L, d, z_hat, candidates, z, cost, max_nodes)
    return IntegerCandidates(
        z[:count].astype(np.int64), cost[:count].copy(), status == ils.COMPLETE, int(n_nodes)
    )


def _bootstrap_z(z_hat, L):
    """Sequential conditional rounding from the last to the first."""
    n = len(z_hat)
    conditional = np.array(z_hat, dtype=float)
    z = np.zeros(n, dtype=np.int64)
    for i in range(n - 1, -1, -1):
        z[i] = round_integers(conditional[i])
        conditional[:i] += (z[i] - conditional[i]) * L[i, :i]
    return z


def _cost(error, L, d):
    """Square norm of `error` in the metric of ``(L^T diag(d) L)^{-1}``."""
    return float(np.sum(np.linalg.solve(L.T, error) ** 2 / d))


def _first_of_subset(d, min_success_rate):
    """First decorrelated ambiguity of the largest subset at the end with this success rate."""
    rate, first = 1.0, len(d)
    while first > 0:
        rate *= bootstrapped_success_rate(d[first - 1 : first])
        if rate < min_success_rate:
            break
        first -= 1
    return first


def _put_first(z_one, cost_one, z_candidates, cost):
    """The estimate of another estimator in front of the least-squares candidates, not twice."""
    others = np.any(z_candidates != z_one, axis=1)
    keep = max(len(cost) - 1, 1)
    return (
        np.vstack([z_one[None], z_candidates[others][:keep]]),
        np.concatenate([[cost_one], cost[others][:keep]]),
    )


def _integers_of_candidates(decorrelation, z_hat, z_candidates, first):
    """Ambiguities of every candidate, and which of them the fixed z determine."""
    c, n = len(z_candidates), decorrelation.n
    L = decorrelation.L
    z = np.empty((c, n))
    z[:, first:] = z_candidates
    if first:
        shift = np.linalg.solve(L[first:, first:].T, (z_candidates - z_hat[first:]).T)
        z[:, :first] = z_hat[:first] + (L[first:, :first].T @ shift).T
        return round_integers(decorrelation.from_z(z)), ~decorrelation.inverse_transpose[:, :first].any(
            axis=1
        )
    return decorrelation.from_z(z_candidates), np.ones(n, dtype=bool)


def _posterior(z_hat, L, d, cost):
    """Posterior of the first candidate over all integers within the window, and how many those are."""
    from .._kernels import ils

    n = len(d)
    z_hat, L, d = (np.ascontiguousarray(x, dtype=np.float64) for x in (z_hat, L, d))
    z, costs = np.empty((_POSTERIOR_CAPACITY, n)), np.empty(_POSTERIOR_CAPACITY)
    window = POSTERIOR_WINDOW
    count = 0
    # A weak model has more candidates than can be listed. A narrower window then still holds those
    # that weigh most: at 10 the ones left out weigh less than 1 % each, and P is far from any level.
    while window >= 4.0:
        count, _, status = ils.enumerate_within(
            n, L, d, z_hat, float(cost.min()) + window, z, costs, _POSTERIOR_NODES
        )
        if status == ils.COMPLETE:
            break
        window *= 0.7
    weights = costs[:count]
    # The first candidate is in the list when integer least squares found it; other estimators may be out.
    least = float(cost.min())
    total = float(np.exp(-0.5 * (weights - least)).sum()) if count else 0.0
    own = math.exp(-0.5 * (float(cost[0]) - least))
    return own / max(total, np.exp(-0.5 * (cost - least)).sum()), count


def _complete_test(found, max_nodes):
    """An unfinished search proves nothing."""
    reason = Reason.OK if found.is_complete else Reason.SEARCH_LIMIT
    return AcceptanceTest(found.is_complete, reason, float(found.n_nodes), float(max_nodes))


def _length_test(problem, baseline, cov_baseline, tolerance_sd):
    """Measured length against the declared one, in joint standard deviations."""
    if not (math.isfinite(problem.length_m) and math.isfinite(tolerance_sd)):
        return AcceptanceTest(True, Reason.OK, math.nan, math.nan)
    length = float(np.linalg.norm(baseline))
    direction = baseline / length if length > 0.0 else np.array([1.0, 0.0, 0.0])
    declared_sd = problem.length_sd_m if math.isfinite(problem.length_sd_m) else 0.0
    sd = math.sqrt(direction @ cov_baseline @ direction + declared_sd**2)
    statistic = abs(length - problem.length_m) / sd
    passed = statistic <= tolerance_sd
    return AcceptanceTest(passed, Reason.OK if passed else Reason.LENGTH_TEST, statistic, tolerance_sd)


def _classical_test(kind, cost, d, threshold, failure_rate, probability):
    """The test named in the settings, against the second-best candidate."""
    if kind == "fixed":
        return ratio_test(cost, threshold)
    if kind == "fixed_failure_rate":
        ils_failure_rate = 1.0 - bootstrapped_success_rate(d)
        return ratio_test(cost, tabulated_ratio_threshold(len(d), ils_failure_rate, failure_rate))
    if kind == "difference":
        return difference_test(cost, difference_threshold(max(probability, 0.5)))
    return AcceptanceTest(True, Reason.OK, math.nan, math.nan)


def _unresolved(problem, reason, floats=None):
    """A resolution without integers."""
    nothing = np.full(3, np.nan)
    has_float = floats is not None
    return Resolution(
        status=Status.FLOAT if has_float else Status.NONE,
        reason=reason,
        integers_cyc=np.empty((0, problem.n_phases), dtype=np.int64),
        objective=np.empty(0),
        baseline_enu_m=np.empty((0, 3)),
        cov_baseline_m2=floats.cov_baseline_m2 if has_float else np.full((3, 3), np.nan),
        float_baseline_enu_m=floats.baseline_enu_m if has_float else nothing,
        is_fixed=np.zeros(problem.n_phases, dtype=bool),
        ratio=math.nan,
        success_probability=math.nan,
        chi2=math.nan,
        chi2_limit=math.nan,
        n_candidates=0,
    )


def _refuse_unknown(key, value, known):
    """One sentence for an option that does not exist."""
    if value not in known:
        raise ConfigError(f"`{key}` is {value!r}; give one of {', '.join(known)}", key=key, value=value)
