"""Exhaustive integer search with the attitude adjusted for every integer set (Oguz 2006).

Single differences between two antennas, in cycles, phases of the first antenna minus the second:

    dphi_ij + k_ij = b_i' A s_j / wavelength + noise,      |k_ij| <= ceil(|b_i| / wavelength)

with the baselines b_i known in the body frame, the directions s_j in the local frame and A the
rotation body from local. For every set of integers the attitude is found by Gauss-Newton steps, and
the set's cost is the sum of the squared residuals over baselines, satellites and epochs (3.19).

What differs from the thesis: the integer bound is the safe one (its sets for 0.2 m and 0.5 m are too
small at 19 cm); with one baseline the step matrix is singular, so the step of least norm is taken;
the update is the exponential map instead of I + Theta; the search starts at each set's least-squares
vector; all sets inside the gate are reported, since several usually are.

With real receivers the single differences hold the clock difference, so `resolve_exhaustive` works
on double differences with their covariance, over baselines of the known length.

References: Oguz 2006, *Implementation of Northfinding Techniques*, METU, sec. 3.1-3.4 and table 1;
Cohen 1992 (attitude determination using GPS, Stanford).
"""

from dataclasses import dataclass

import numpy as np

from ..errors import ConfigError, ModelError, Reason, Status
from .model import Resolution
from .outcome import chi2_limits, code_baseline, unresolved

__all__ = [
    "ExhaustiveOptions",
    "SingleDifferenceSets",
    "integer_bound",
    "resolve_exhaustive",
    "search_single_differences",
    "set_index",
]


def integer_bound(length_m, wavelength_m):
    """Largest magnitude of a single-difference integer: ``ceil(length / wavelength)``.

    Both receivers' phase fractions lie in [0, 1), so their difference lies within one cycle of the
    projected baseline.

    Parameters
    ----------
    length_m, wavelength_m : float
        Antenna separation and carrier wavelength, metres.

    Returns
    -------
    int
    """
    return int(np.ceil(length_m / wavelength_m))


def set_index(integers, bound):
    """Place of an integer set in the list of all, from 1, the first integer slowest (Oguz 2006).

    Parameters
    ----------
    integers : ndarray of int, shape (..., n)
        Sets; the last axis runs over satellites (all baselines one after the other).
    bound : int
        Largest magnitude; the list runs over ``-bound ... bound`` for each.

    Returns
    -------
    int or ndarray of int64
    """
    digits = np.asarray(integers, dtype=np.int64) + bound
    base = 2 * bound + 1
    if np.any((digits < 0) | (digits >= base)):
        raise ModelError(f"numbering an integer set: it holds values beyond {bound}; give a larger bound")
    weights = base ** np.arange(digits.shape[-1] - 1, -1, -1)
    return digits @ weights + 1


@dataclass(frozen=True, slots=True, eq=False)
class SingleDifferenceSets:
    """Integer sets of a single-difference search, best first.

    Parameters
    ----------
    integers_cyc : ndarray of int64, shape (c, b, s)
        Sets inside the gate (at least the best one), by baseline and satellite.
    index : ndarray of int64, shape (c,)
        Place of each in the list of all, from 1.
    cost_cyc2 : ndarray, shape (c,)
        Sum of squared residuals, cycles squared.
    rot_body_from_local : ndarray, shape (c, epochs, 3, 3)
        Attitude of each. With one baseline the turn about it is arbitrary.
    direction_local : ndarray, shape (c, epochs, b, 3)
        Unit vectors of the baselines in the local frame, first antenna to second.
    cost_limit_cyc2 : float
        The gate.
    n_sets : int
        Number of possible sets.
    n_evaluated : int
        Number of sets evaluated; smaller after an early exit.
    """

    integers_cyc: np.ndarray
    index: np.ndarray
    cost_cyc2: np.ndarray
    rot_body_from_local: np.ndarray
    direction_local: np.ndarray
    cost_limit_cyc2: float
    n_sets: int
    n_evaluated: int

    @property
    def is_unique(self):
        """bool: Whether no second set is inside the gate."""
        return bool(np.count_nonzero(self.cost_cyc2 <= self.cost_limit_cyc2) == 1)


def search_single_differences(
    fraction_cyc,
    direction,
    baseline_body_m,
    wavelength_m,
    *,
    bound=None,
    single_difference_sd_cyc=0.025,
    significance=1e-3,
    cost_limit_cyc2=None,
    early_exit=False,
    start="least_squares",
    n_keep=100,
    max_sets=2_000_000,
):
    """Try every integer set of single differences and report those that fit.

    Parameters
    ----------
    fraction_cyc : ndarray, shape (epochs, b, s) or (s,)
        Single-difference phases without integers, first antenna minus second, cycles, by epoch,
        baseline and satellite. Integers are the same at all epochs.
    direction : ndarray, shape (epochs, s, 3) or (s, 3)
        Unit vectors to the satellites in the local frame.
    baseline_body_m : ndarray, shape (b, 3) or (3,)
        Baselines in the body frame, metres.
    wavelength_m : float
        Carrier wavelength.
    bound : int, optional
        Largest integer; the safe `integer_bound` of the longest baseline by default.
    single_difference_sd_cyc : float
        Noise that the gate is made for, cycles.
    significance : float
        Rate at which the gate loses the right set.
    cost_limit_cyc2 : float, optional
        The gate itself, instead of the two above.
    early_exit : bool
        Stop at the first set inside the gate, as the thesis does; it may be a wrong one.
    start : {"least_squares", "identity"}
        Where the attitude steps start: at each set's own least-squares vectors, or at the unit
        matrix, as in the thesis.
    n_keep : int
        Sets to report at most.
    max_sets : int
        Refuse larger searches.

    Returns
    -------
    SingleDifferenceSets

    Raises
    ------
    ModelError
        If there are more sets than `max_sets`, or fewer than two satellites.
    """
    from .._kernels.exhaustive import attitude_of_integer_sets

    direction = np.array(direction, dtype=float, ndmin=3)
    baseline = np.array(baseline_body_m, dtype=float, ndmin=2)
    fraction = np.array(fraction_cyc, dtype=float, ndmin=3)
    n_epochs, n_base, n_sat = fraction.shape
    if direction.shape != (n_epochs, n_sat, 3) or baseline.shape != (n_base, 3):
        raise ModelError(
            f"searching single differences: phases of shape {fraction.shape} need directions of shape "
            f"{(n_epochs, n_sat, 3)} and {n_base} baselines, but got {direction.shape} and "
            f"{len(baseline)}; match them"
        )
    if n_sat < 2:
        raise ModelError("searching single differences: one satellite gives no direction; give three or more")
    if start not in ("least_squares", "identity"):
        raise ConfigError(f"`start` is {start!r}; give least_squares or identity", key="start", value=start)
    if bound is None:
        bound = integer_bound(np.linalg.norm(baseline, axis=1).max(), wavelength_m)
    n_sets = (2 * bound + 1) ** (n_base * n_sat)
    if n_sets > max_sets:
        raise ModelError(
            f"searching single differences: {n_sets} integer sets for {n_sat} satellites exceed the limit of "
            f"{max_sets}; use fewer satellites or baselines"
        )
    if cost_limit_cyc2 is None:
        dof = n_epochs * (n_base * n_sat - (2 if n_base == 1 else 3))
        high = chi2_limits(dof, significance)[1]
        cost_limit_cyc2 = high * single_difference_sd_cyc**2 if dof > 0 else 1e-9
    start_map = np.ascontiguousarray(np.linalg.pinv(direction))
    arguments = (
        int(bound),
        fraction,
        direction,
        baseline / wavelength_m,
        start_map,
        start == "identity",
        float(cost_limit_cyc2),
    )
    cost, n_evaluated = attitude_of_integer_sets(
        np.arange(n_sets), *arguments, bool(early_exit), np.empty((0, n_epochs, 3, 3))
    )
    best_first = np.argsort(cost, kind="stable")[:n_keep]
    inside = max(1, int(np.count_nonzero(cost[best_first] <= cost_limit_cyc2)))
    chosen = np.ascontiguousarray(best_first[:inside], dtype=np.int64)
    rot = np.empty((len(chosen), n_epochs, 3, 3))
    attitude_of_integer_sets(chosen, *arguments, False, rot)
    digits = chosen[:, None] // (2 * bound + 1) ** np.arange(n_base * n_sat - 1, -1, -1) % (2 * bound + 1)
    unit = baseline / np.linalg.norm(baseline, axis=1)[:, None]
    return SingleDifferenceSets(
        integers_cyc=(digits - bound).reshape(-1, n_base, n_sat),
        index=chosen + 1,
        cost_cyc2=cost[chosen],
        rot_body_from_local=rot,
        # The transpose takes body vectors back to the local frame.
        direction_local=np.einsum("cepq,bp->cebq", rot, unit),
        cost_limit_cyc2=float(cost_limit_cyc2),
        n_sets=int(n_sets),
        n_evaluated=int(n_evaluated),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ExhaustiveOptions:
    """Settings of the exhaustive search on double differences.

    Parameters
    ----------
    n_satellites : int
        Highest satellites whose integers are enumerated, the reference among them.
    max_sets : int
        Refuse searches of more integer sets.
    n_keep : int
        Enumerated sets that are completed with the remaining rows.
    residual_significance : float
        False-alarm rate of the chi-square test.
    ratio_threshold : float
        Second-best over best objective that has to be exceeded.
    aid_sigmas, code_sigmas : float
        Half width of an a-priori baseline's and of the pseudoranges' region in standard deviations,
        where they narrow the integers.
    """

    n_satellites: int = 5
    max_sets: int = 1_000_000
    n_keep: int = 500
    residual_significance: float = 1e-3
    ratio_threshold: float = 3.0
    aid_sigmas: float = 3.0
    code_sigmas: float = 5.0

    def __post_init__(self):
        if self.n_satellites < 3:
            raise ConfigError(
                f"`n_satellites` is {self.n_satellites}; give 3 or more",
                key="n_satellites",
                value=self.n_satellites,
            )
        if self.n_keep < 2:
            raise ConfigError(f"`n_keep` is {self.n_keep}; give 2 or more", key="n_keep", value=self.n_keep)


def _enumerated_rows(problem, n_rows):
    """Highest rows of the first group that has enough of them, else of all."""
    m = problem.n_phases
    elevation = -np.arange(m, dtype=float) if problem.elevation_rad is None else problem.elevation_rad
    high_first = np.argsort(-elevation, kind="stable")
    if problem.group is not None:
        for group in np.unique(problem.group):
            rows = high_first[problem.group[high_first] == group]
            if len(rows) >= min(n_rows, 3):
                return rows[:n_rows]
    return high_first[:n_rows]


def _integer_ranges(problem, rows, options, code, cov_code):
    """Smallest and largest integer of each enumerated row."""
    design, wavelength = problem.design[rows], problem.wavelength_m[rows]
    noise = 5.0 * np.sqrt(np.diag(problem.cov_phase_m2)[rows])
    reach = problem.length_m * np.linalg.norm(design, axis=1)
    low, high = -reach, reach.copy()
    known = [(code, cov_code, options.code_sigmas)]
    if problem.prior_baseline_enu_m is not None and problem.cov_prior_m2 is not None:
        known.append((problem.prior_baseline_enu_m, problem.cov_prior_m2, options.aid_sigmas))
    for centre, cov, sigmas in known:
        if np.isfinite(centre).all():
            middle = design @ centre
            half = sigmas * np.sqrt(np.einsum("mi,ij,mj->m", design, cov, design))
            low, high = np.maximum(low, middle - half), np.minimum(high, middle + half)
    first = np.ceil((problem.phase_m[rows] - high - noise) / wavelength).astype(np.int64)
    last = np.floor((problem.phase_m[rows] - low + noise) / wavelength).astype(np.int64)
    return first, last


def resolve_exhaustive(problem, options=None):
    """Search one epoch of double differences over all integers that the known length allows.

    The highest satellites of the first group are enumerated. For every set the baseline of the known
    length that fits best is found; the best sets are completed by rounding the other rows and
    adjusted with all rows and their full covariance.

    Parameters
    ----------
    problem : DoubleDifferences
        The epoch; ``length_m`` is needed. The enumeration takes it as exact; in the final adjustment
        it is an observation with ``length_sd_m``, if that is given.
    options : ExhaustiveOptions, optional
        Settings.

    Returns
    -------
    Resolution
        `Reason.SEARCH_VOLUME_TOO_LARGE` where the length is unknown or allows too many sets.
    """
    from .._kernels.exhaustive import baselines_on_sphere, search_on_sphere

    options = options or ExhaustiveOptions()
    m = problem.n_phases
    if not problem.length_m > 0.0:
        return unresolved(problem, Reason.SEARCH_VOLUME_TOO_LARGE)
    if m < 3:
        return unresolved(problem, Reason.TOO_FEW_SATELLITES)
    rows = _enumerated_rows(problem, options.n_satellites - 1)
    if len(rows) < 3 or np.linalg.matrix_rank(problem.design[rows], tol=1e-3) < 3:
        return unresolved(problem, Reason.WEAK_GEOMETRY)
    code, cov_code = code_baseline(problem)
    first, last = _integer_ranges(problem, rows, options, code, cov_code)
    count = last - first + 1
    if np.any(count < 1):
        return unresolved(problem, Reason.NO_CANDIDATE)
    n_sets = float(np.prod(count.astype(float)))
    if n_sets > options.max_sets:
        return unresolved(problem, Reason.SEARCH_VOLUME_TOO_LARGE)

    whitener, design, normal, baseline_map = _normals(problem, rows)
    integers, baseline, _, n_kept = search_on_sphere(
        np.ascontiguousarray(problem.phase_m[rows], dtype=float),
        np.ascontiguousarray(problem.wavelength_m[rows], dtype=float),
        first,
        count,
        whitener,
        baseline_map,
        normal,
        float(np.linalg.eigvalsh(normal)[0]),
        float(problem.length_m),
        int(options.n_keep),
    )
    integers = _complete(problem, rows, integers[:n_kept], baseline[:n_kept])
    whitener, design, normal, baseline_map = _normals(problem, np.arange(m))
    free_phase = whitener @ (problem.phase_m - problem.wavelength_m * integers).T
    free = np.ascontiguousarray((baseline_map @ free_phase).T)
    unconstrained = np.sum((free_phase - design @ free.T) ** 2, axis=0)
    baseline, growth = baselines_on_sphere(normal, free, float(problem.length_m))
    # A length known to sigma instead of exactly: to first order the pull onto the sphere is shared between
    # the measured length (variance s^2) and the declared one.
    share = 1.0
    if problem.length_sd_m > 0.0:
        along = baseline / problem.length_m
        measured = np.einsum("ci,ij,cj->c", along, np.linalg.inv(normal), along)
        share = measured / (measured + problem.length_sd_m**2)
        baseline = free + share[:, None] * (baseline - free)
    objective = unconstrained + share * growth
    order = np.argsort(objective, kind="stable")
    integers, baseline, objective = integers[order], baseline[order], objective[order]

    # Two angles are estimated, or three coordinates with the length as an observation.
    limit = chi2_limits(m - 2, options.residual_significance)[1]
    ratio = np.nan
    if len(objective) > 1:
        ratio = min(float(objective[1] / objective[0]) if objective[0] > 0.0 else np.inf, 999.9)
    if objective[0] > limit:
        reason = Reason.RESIDUAL_TEST
    elif len(objective) < 2:
        reason = Reason.SINGLE_CANDIDATE
    elif not ratio > options.ratio_threshold:
        reason = Reason.RATIO_TEST
    else:
        reason = Reason.OK
    along = baseline[0] / np.linalg.norm(baseline[0])
    if problem.length_sd_m > 0.0:
        cov = np.linalg.inv(normal + np.outer(along, along) / problem.length_sd_m**2)
    else:
        tangent = np.linalg.svd(along[None, :])[2][1:].T
        cov = tangent @ np.linalg.inv(tangent.T @ normal @ tangent) @ tangent.T
    if reason == Reason.OK:
        status = Status.FIXED
    else:
        status = Status.FLOAT if np.isfinite(code).all() else Status.NONE
    return Resolution(
        status=status,
        reason=reason,
        integers_cyc=integers,
        objective=objective,
        baseline_enu_m=baseline,
        cov_baseline_m2=cov,
        float_baseline_enu_m=code,
        is_fixed=np.ones(m, dtype=bool),
        ratio=ratio,
        success_probability=np.nan,
        chi2=float(objective[0]),
        chi2_limit=limit,
        n_candidates=int(n_sets),
    )


def _normals(problem, rows):
    """Whitener, whitened design, normal matrix and baseline map of some rows."""
    try:
        lower = np.linalg.cholesky(problem.cov_phase_m2[np.ix_(rows, rows)])
    except np.linalg.LinAlgError as error:
        raise ModelError(
            "searching integers: the covariance of the double-difference phases is not positive definite; "
            "check the noise settings"
        ) from error
    whitener = np.ascontiguousarray(np.linalg.inv(lower))
    design = whitener @ problem.design[rows]
    normal = np.ascontiguousarray(design.T @ design)
    return whitener, design, normal, np.ascontiguousarray(np.linalg.solve(normal, design.T))


def _complete(problem, rows, integers, baseline):
    """Round the rows that were not enumerated, given those that were; sets once each."""
    m = problem.n_phases
    full = np.zeros((len(integers), m), dtype=np.int64)
    full[:, rows] = integers
    rest = np.setdiff1d(np.arange(m), rows)
    if len(rest):
        cov = problem.cov_phase_m2
        gain = np.linalg.solve(cov[np.ix_(rows, rows)], cov[np.ix_(rows, rest)])
        residual = problem.phase_m[rows] - problem.wavelength_m[rows] * integers
        residual = residual - baseline @ problem.design[rows].T
        predicted = baseline @ problem.design[rest].T + residual @ gain
        full[:, rest] = np.rint((problem.phase_m[rest] - predicted) / problem.wavelength_m[rest])
    return full
