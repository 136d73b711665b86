"""Integers of one epoch with the known baseline length inside the search, in two independent ways.

Objective of an integer vector a (Teunissen 2010, eq. (14); Giorgi et al. 2012), up to a constant:

    C(a) = |a_hat - a|^2_Qa + min over b of { |b_hat(a) - b|^2_Qb|a + (|b| - l)^2 / sigma_l^2 }

which is the weighted residual square sum of the adjustment with the integers and the length known,
less that of code and prior alone. sigma_l = 0 puts b on the sphere.

Inner minimum. In the eigenframe of the information, with eigenvalues p_i and centre c, the minimum is
b_i = p_i c_i / (p_i + nu), where nu is the root of the secular equation

    |b(nu)| (1 - nu sigma_l^2) = l,        -p_min < nu < 1 / sigma_l^2,

whose left side falls monotonically, so the root is the global minimum; the length is never linearised.

`resolve_constrained` searches a tree. For every mu >= 0 with mu sigma_l^2 < 1 and every b

    (|b| - l)^2 / sigma_l^2  >=  mu |b|^2 - mu l^2 / (1 - mu sigma_l^2),

(Lagrangian duality), so C(a) >= J_mu(a) - mu l^2 / (1 - mu sigma_l^2), with J_mu the ordinary objective
of the adjustment that has the pseudo-observation "b = 0, weight mu". Its decorrelated search up to that
bound misses nothing, and needs no pseudorange.

`search_on_sphere` needs no tree. An integer vector with C(a) <= C_max has double-difference residuals
below sqrt(C_max Q_jj) at a baseline within sigma_l sqrt(C_max) of the sphere; a grid on the sphere that
leaves no point further than s from it finds it by rounding when, for all rows,

    |H_j| (s + sigma_l sqrt(C_max)) + sqrt(C_max Q_jj) < lambda_j / 2.

Its cost grows with (l / s)^2. It shares no code with the first way, which is how each proves the other.

References: Teunissen 2006, Artificial Satellites 41:89-103; Teunissen 2010, J. Geodesy 84:433-447;
Giorgi, Teunissen, Verhagen & Buist 2012, J. Guidance, Control, Dynamics 35:51-67.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..errors import Reason, Status
from .acceptance import chi2_quantile
from .lambda_ import resolve_lambda
from .model import DoubleDifferences, Resolution

__all__ = ["resolve_constrained", "search_on_sphere"]

PSEUDO_WEIGHT = 10.0
"""mu l^2 without a length deviation; 5 to 20 cost the same, and none changes the result."""

POSTERIOR_MARGIN = 30.0
"""Candidates this much costlier than the best weigh less than 3e-7 and are left out of the posterior."""

REACH = 400.0
"""Objective above which a candidate is of no interest; such residuals belong to no model of noise."""

MAX_NODES = 20_000_000
MAX_GRID_POINTS = 2_000_000


def resolve_constrained(
    problem: DoubleDifferences,
    *,
    use_code=True,
    success_probability=0.99,
    residual_significance=1e-4,
    length_tolerance_sd=4.0,
    max_nodes=MAX_NODES,
) -> Resolution:
    """Resolve the ambiguities of one epoch with the length in the objective, by tree search.

    Parameters
    ----------
    problem : DoubleDifferences
        One epoch. Pseudoranges and a prior baseline help but are not needed. Without a length this is
        `resolve_lambda`.
    use_code : bool
        Whether pseudoranges take part.
    success_probability : float
        Posterior probability demanded.
    residual_significance : float
        False-alarm rate of the chi-square test of the winner's objective.
    length_tolerance_sd : float
        The length that the phases alone measure may differ from the known one by this many joint
        standard deviations.
    max_nodes : int
        Nodes after which the search stops, unfinished.

    Returns
    -------
    Resolution
        One candidate, the optimum; `ratio` refers to the second-best objective, or is the least that
        it can be where none lies within `POSTERIOR_MARGIN` of the best.

    Notes
    -----
    The posterior probability integrates each candidate's baseline over the sphere by the curvature at
    its minimum (Laplace), with all directions equally likely beforehand.
    """
    from .._kernels import engine

    if not math.isfinite(problem.length_m):
        return resolve_lambda(
            _drop_code(problem, use_code),
            success_probability=success_probability,
            residual_significance=residual_significance,
            max_nodes=max_nodes,
        )
    model = _Model.of(problem, use_code)
    n = problem.n_phases
    if n < 2:
        return _unresolved(model, Reason.TOO_FEW_SATELLITES)
    length, variance = float(problem.length_m), model.length_variance
    mu = PSEUDO_WEIGHT / (length**2 + PSEUDO_WEIGHT * variance)
    normal = model.side_information + mu * np.eye(3)
    cov = np.linalg.inv(normal)
    b_float = cov @ model.side_rhs
    design_cyc = problem.design / problem.wavelength_m[:, None]
    a_float = problem.phase_m / problem.wavelength_m - design_cyc @ b_float
    q_float = (
        problem.cov_phase_m2 / np.outer(problem.wavelength_m, problem.wavelength_m)
        + design_cyc @ cov @ design_cyc.T
    )
    j_min = mu * b_float @ b_float + model.side_cost(b_float)
    a_best, b_fixed, b_free = np.zeros(n), np.zeros(3), np.zeros(3)
    row = np.full(engine.N_COLUMNS, np.nan)
    reason = engine.resolve_integers(
        n, a_float, np.ascontiguousarray(q_float), np.ascontiguousarray(-cov @ design_cyc.T), b_float,
        float(j_min), np.ascontiguousarray(model.information), float(mu), length, float(variance), REACH,
        POSTERIOR_MARGIN, 1.0, int(max_nodes), a_best, b_fixed, b_free, row,
    )  # fmt: skip
    if not row[engine.FOUND] > 0:
        return _unresolved(model, Reason(reason))
    best, second = row[engine.COST], row[engine.SECOND_COST]
    return _resolution(
        model, Reason(reason), np.rint(a_best)[None], np.array([best]), b_fixed[None],
        second, row[engine.PROBABILITY],
        int(row[engine.FOUND]), success_probability, residual_significance, length_tolerance_sd,
    )  # fmt: skip


def search_on_sphere(
    problem: DoubleDifferences,
    *,
    use_code=True,
    candidates=2,
    success_probability=0.99,
    residual_significance=1e-4,
    length_tolerance_sd=4.0,
    max_points=MAX_GRID_POINTS,
) -> Resolution:
    """Resolve the ambiguities of one epoch by trying every direction of the baseline.

    Parameters
    ----------
    problem : DoubleDifferences
        One epoch with a known length; pseudoranges and a prior baseline help but are not needed.
    use_code, success_probability, residual_significance, length_tolerance_sd
        As in `resolve_constrained`.
    candidates : int
        Integer vectors to return.
    max_points : int
        Points of the grid beyond which the search is refused.

    Returns
    -------
    Resolution
        `Reason.SEARCH_VOLUME_TOO_LARGE` where no grid of `max_points` can be proved complete: a long
        baseline, or noise too large for rounding.

    Notes
    -----
    A coarse grid gives an upper bound C_0 of the optimum, the grid for C_max = C_0 then every candidate
    that could be the optimum, and the grid for C* + min(margin, what the grid can reach) the rest of the
    posterior. The optimum is exact; a second-best objective is reported only when it is, too.
    """
    model = _Model.of(problem, use_code)
    if problem.n_phases < 2 or not math.isfinite(problem.length_m):
        return _unresolved(model, Reason.TOO_FEW_SATELLITES)
    found = _evaluate(model, _round_on_grid(model, 0.1 * float(problem.wavelength_m.min()), max_points))
    if found is None:
        return _unresolved(model, Reason.SEARCH_VOLUME_TOO_LARGE)
    best = found.cost[0]
    spacing = _spacing(model, best)
    complete = spacing > 0.0
    if complete:
        finer = _evaluate(model, _round_on_grid(model, spacing, max_points))
        complete = finer is not None
        found = finer if complete else found
    if not complete:
        return _unresolved(model, Reason.SEARCH_VOLUME_TOO_LARGE)
    # The posterior: as far beyond the optimum as a grid of the allowed size proves.
    reach = found.cost[0]
    for margin in (POSTERIOR_MARGIN, 20.0, 14.0, 10.0):
        spacing = _spacing(model, found.cost[0] + margin)
        wider = _evaluate(model, _round_on_grid(model, spacing, max_points)) if spacing > 0.0 else None
        if wider is not None:
            found, reach = wider, found.cost[0] + margin
            break
    kept = found.cost <= reach
    weight = found.volume[kept] * np.exp(-0.5 * (found.cost[kept] - found.cost[0]))
    probability = float(weight[0] / weight.sum())
    count = min(max(candidates, 1), int(kept.sum()))
    second = float(found.cost[1]) if kept.sum() > 1 else reach
    return _resolution(
        model, Reason.OK, found.integers[:count], found.cost[:count], found.baseline[:count], second,
        probability, int(kept.sum()), success_probability, residual_significance, length_tolerance_sd,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class _Model:
    """The quadratic parts of the objective: phases, and what speaks of the baseline beside them."""

    problem: DoubleDifferences
    length_variance: float
    side_information: np.ndarray
    side_rhs: np.ndarray
    side_square: float
    weight_phase: np.ndarray
    information: np.ndarray

    @classmethod
    def of(cls, problem, use_code):
        """Normal equations of code and prior (the "side"), and with known integers of all."""
        information, rhs, square = np.zeros((3, 3)), np.zeros(3), 0.0
        if use_code and len(problem.code_m):
            weighted = np.linalg.solve(problem.cov_code_m2, problem.code_design).T
            information += weighted @ problem.code_design
            rhs += weighted @ problem.code_m
        if problem.prior_baseline_enu_m is not None and problem.cov_prior_m2 is not None:
            weight = np.linalg.inv(problem.cov_prior_m2)
            information += weight
            rhs += weight @ problem.prior_baseline_enu_m
        # rhs' I^+ rhs: the least side cost is the zero of the objective, also where I is singular.
        square = float(rhs @ np.linalg.pinv(information, rcond=1e-10, hermitian=True) @ rhs)
        weight_phase = np.linalg.inv(problem.cov_phase_m2)
        sd = problem.length_sd_m if math.isfinite(problem.length_sd_m) else 0.0
        return cls(
            problem, sd**2, information, rhs, square, weight_phase,
            information + problem.design.T @ weight_phase @ problem.design,
        )  # fmt: skip

    def side_cost(self, baseline):
        """float: Square sum of code and prior at a baseline, above their least."""
        return baseline @ self.side_information @ baseline - 2.0 * baseline @ self.side_rhs + self.side_square

    @property
    def side_rank(self):
        """int: Directions that code and prior determine."""
        values = np.linalg.eigvalsh(self.side_information)
        return int(np.sum(values > 1e-10 * max(values[-1], 1e-300)))


@dataclass(frozen=True, slots=True, eq=False)
class _Candidates:
    """Evaluated integer vectors, best first."""

    integers: np.ndarray
    cost: np.ndarray
    baseline: np.ndarray
    volume: np.ndarray


def _spacing(model, cost):
    """Distance to the nearest grid point below which rounding finds all candidates of this cost."""
    p = model.problem
    sd = np.sqrt(np.diag(p.cov_phase_m2))
    room = (0.5 * p.wavelength_m - math.sqrt(cost) * sd) / np.linalg.norm(p.design, axis=1)
    return 0.999 * float(np.min(room)) - math.sqrt(cost * model.length_variance)


def _round_on_grid(model, spacing, max_points):
    """Distinct integer vectors from rounding at every point of a grid, or None where it is too large.

    Rings of equal latitude `sqrt(2) spacing` apart, their points likewise: no point of the sphere is
    further than `spacing` from the grid, since half a step along either way make the diagonal.
    """
    p = model.problem
    step = math.sqrt(2.0) * spacing / p.length_m
    n_rings = max(math.ceil(math.pi / step), 2)
    if 2.0 * n_rings**2 > math.pi * max_points:
        return None
    height = math.pi / n_rings
    found = []
    for ring in range(n_rings):
        latitude = -0.5 * math.pi + (ring + 0.5) * height
        # The widest parallel of the band around the ring.
        nearest = max(abs(latitude) - 0.5 * height, 0.0)
        n_points = max(math.ceil(2.0 * math.pi * math.cos(nearest) / step), 1)
        longitude = np.arange(n_points) * (2.0 * math.pi / n_points)
        point = p.length_m * np.column_stack(
            [
                math.cos(latitude) * np.sin(longitude),
                math.cos(latitude) * np.cos(longitude),
                np.full(n_points, math.sin(latitude)),
            ]
        )
        integers = np.rint((p.phase_m - point @ p.design.T) / p.wavelength_m).astype(np.int64)
        found.append(np.unique(integers, axis=0))
    return np.unique(np.concatenate(found), axis=0)


def _evaluate(model, integers):
    """Exact objective of many integer vectors, by bisection of the secular equation."""
    if integers is None:
        return None
    p = model.problem
    y = p.phase_m - p.wavelength_m * integers
    weighted = y @ model.weight_phase
    rhs = weighted @ p.design + model.side_rhs
    values, axes = np.linalg.eigh(model.information)
    q = rhs @ axes
    base = np.sum(weighted * y, axis=1) + model.side_square
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        b, nu = _on_shell(values, q, p.length_m, model.length_variance)
        size = np.linalg.norm(b, axis=1)
        cost = base - 2.0 * np.sum(b * q, axis=1) + np.sum(values * b * b, axis=1)
        if model.length_variance > 0.0:
            cost += (size - p.length_m) ** 2 / model.length_variance
        stiff = np.maximum(values + nu[:, None], 1e-9 * values)
        radial = np.sum(b * b / stiff, axis=1) / size**2
        radial = model.length_variance + (1.0 - nu * model.length_variance) * radial
        volume = 1.0 / np.sqrt(np.prod(stiff, axis=1) * radial)
    order = np.argsort(cost, kind="stable")
    return _Candidates(integers[order], cost[order], (b @ axes.T)[order], volume[order])


def _on_shell(values, q, length, variance):
    """Baselines b_i = q_i / (p_i + nu) of the secular equation, for many right sides at once.

    Bisection between the pole and the far end. Where the weakest component of the right side vanishes
    (the hard case) that component takes what the others leave of the length.
    """
    low = np.full(len(q), -values[0])
    norm = np.linalg.norm(q, axis=1)
    # |b(nu)| <= |q| / (p_min + nu): beyond this the baseline is too short.
    high = norm / length - values[0] + 1e-300
    if variance > 0.0:
        high = np.minimum(np.maximum(high, 0.0), 1.0 / variance)
        high = np.maximum(high, low)
    for _ in range(200):
        middle = 0.5 * (low + high)
        size = np.linalg.norm(q / (values + middle[:, None]), axis=1) * (1.0 - middle * variance)
        longer = size > length
        low, high = np.where(longer, middle, low), np.where(longer, high, middle)
    nu = high
    b = q / (values + nu[:, None])
    target = length / (1.0 - nu * variance)
    missing = target**2 - b[:, 1] ** 2 - b[:, 2] ** 2
    # At the pole the quotient of the weakest component carries no digits.
    b[:, 0] = np.where(
        values[0] + nu < 1e-6 * values[0],
        np.where(q[:, 0] < 0.0, -1.0, 1.0) * np.sqrt(np.maximum(missing, 0.0)),
        b[:, 0],
    )
    return b, nu


def _resolution(
    model, reason, integers, cost, baseline, second, probability, n_candidates,
    success_probability, residual_significance, length_tolerance_sd,
):  # fmt: skip
    """Tests of the winner, and the common result."""
    p = model.problem
    # Phases and length, and of the side no more than it has in common with them.
    dof = p.n_phases + 1 - (3 - model.side_rank)
    limit = chi2_quantile(residual_significance, dof, upper=True) if dof > 0 else math.inf
    if reason == Reason.OK:
        if cost[0] > limit:
            reason = Reason.RESIDUAL_TEST
        elif _length_statistic(model, integers[0]) > length_tolerance_sd:
            reason = Reason.LENGTH_TEST
        elif not probability >= success_probability:
            reason = Reason.PROBABILITY_TEST
    return Resolution(
        status=Status.FIXED if reason == Reason.OK else Status.FLOAT,
        reason=reason,
        integers_cyc=np.asarray(integers, dtype=np.int64),
        objective=np.asarray(cost, dtype=float),
        baseline_enu_m=np.asarray(baseline, dtype=float),
        cov_baseline_m2=_covariance(model, integers[0], baseline[0]),
        float_baseline_enu_m=_side_baseline(model),
        is_fixed=np.ones(p.n_phases, dtype=bool),
        ratio=float(second / max(cost[0], 1e-9)),
        success_probability=float(probability),
        chi2=float(cost[0]),
        chi2_limit=limit,
        n_candidates=n_candidates,
    )


def _free_baseline(model, integers):
    """Baseline with the integers known and the length not, and the right side of its normal equations."""
    p = model.problem
    rhs = (p.phase_m - p.wavelength_m * integers) @ model.weight_phase @ p.design + model.side_rhs
    return np.linalg.solve(model.information, rhs), rhs


def _length_statistic(model, integers):
    """Measured length against the known one, in joint standard deviations."""
    free, _ = _free_baseline(model, integers)
    size = np.linalg.norm(free)
    variance = free @ np.linalg.solve(model.information, free) / size**2 + model.length_variance
    return abs(size - model.problem.length_m) / math.sqrt(variance)


def _covariance(model, integers, baseline):
    """Inverse of the Hessian of the objective at the minimum; singular along b for an exact length."""
    _, rhs = _free_baseline(model, integers)
    size = np.linalg.norm(baseline)
    direction = baseline / size
    nu = direction @ (rhs - model.information @ baseline) / size
    tangent = np.linalg.inv(model.information + nu * np.eye(3))
    along = tangent @ direction
    softness = model.length_variance / (1.0 - nu * model.length_variance)
    return tangent - np.outer(along, along) / (softness + direction @ along)


def _side_baseline(model):
    """Baseline of code and prior alone; NaN where they do not determine it."""
    if model.side_rank < 3:
        return np.full(3, np.nan)
    return np.linalg.solve(model.side_information, model.side_rhs)


def _unresolved(model, reason):
    """A resolution without integers."""
    p = model.problem
    has_float = model.side_rank == 3
    return Resolution(
        status=Status.FLOAT if has_float else Status.NONE,
        reason=reason,
        integers_cyc=np.empty((0, p.n_phases), dtype=np.int64),
        objective=np.empty(0),
        baseline_enu_m=np.empty((0, 3)),
        cov_baseline_m2=np.linalg.inv(model.side_information) if has_float else np.full((3, 3), np.nan),
        float_baseline_enu_m=_side_baseline(model),
        is_fixed=np.ones(p.n_phases, dtype=bool),
        ratio=math.nan,
        success_probability=math.nan,
        chi2=math.nan,
        chi2_limit=math.nan,
        n_candidates=0,
    )


def _drop_code(problem, use_code):
    """The problem without its pseudoranges where they are not to take part."""
    from dataclasses import replace

    if use_code:
        return problem
    return replace(problem, code_m=np.empty(0), code_design=np.empty((0, 3)), cov_code_m2=np.empty((0, 0)))
