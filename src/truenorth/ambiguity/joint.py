"""Integers of all baselines of a rigid array at once, with the body geometry inside the search.

Objective of the integers N of one epoch, up to a constant (Teunissen 2012; Giorgi et al. 2012):

    C(N) = min over R in SO(3) of the weighted square sum of all rows,

every satellite constant and clock eliminated: the weighted residuals of the adjustment of the attitude with
the integers known, less those of the codes alone. The body coordinates enter as they are, lengths, angles
and handedness, and are never linearised; where they are uncertain, the vectors R l + d deviate from them by d
of the covariance that the coordinates have. Found is the exact optimum and every candidate within a margin of
it (see the compiled search).

The posterior probability integrates each candidate over its attitude by the curvature at the minimum
(Laplace), all attitudes equally likely beforehand. Antennas on one line leave the turn about the line free;
three satellites may leave the mirror image of an attitude as likely as itself: then nothing is accepted.

Over several epochs with the same integers the costs add up. A candidate in no epoch's list costs more than
the sum of what the lists are complete to, so the lists of small margins together prove the optimum of all.

References: Teunissen 2012, J. Geodesy 86:41-54; Giorgi, Teunissen, Verhagen & Buist 2012, J. Guidance,
Control, Dynamics 35:51-67; Teunissen 2010, J. Geodesy 84:433-447.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from ..errors import Reason, Status
from ..rotations import exp_so3
from .acceptance import chi2_quantile
from .array_model import ArrayEpoch

__all__ = ["JointArcs", "JointResolution", "resolve_joint", "resolve_joint_epochs"]

SUCCESS_PROBABILITY = 0.999
"""Demanded posterior probability of integers and attitude together."""

POSTERIOR_MARGIN = 24.0
"""Candidates this much costlier than the best weigh less than 7e-6 and are left out of the posterior."""

REACH = 400.0
"""Cost beyond its degrees of freedom above which a candidate is of no interest: no model of noise has it."""

MAX_NODES = 20_000_000

MAX_LISTED = 4000
"""Candidates of one epoch that are carried to the other epochs."""

RISING_TOLERANCE_CYC = 0.25
"""Arcs of a satellite that is not there all the time are fixed when nearer than this to whole cycles."""


@dataclass(frozen=True, slots=True, eq=False)
class JointResolution:
    """What the joint search found in one epoch.

    Parameters
    ----------
    status : Status
        `Status.FIXED` when accepted, `Status.FLOAT` when there is a winner that is not, else `Status.NONE`.
    reason : Reason
        Why.
    integers_cyc : ndarray of int64, shape (n,)
        Winner's integers of each row, up to constants of satellites and clocks: 0 at the rows that fix
        these, and at rows without phase.
    rot_ned_from_body : ndarray, shape (3, 3)
        Its attitude; NaN without one. Of antennas on one line the most level one.
    cov_rad2 : ndarray, shape (3, 3)
        Covariance of a small rotation of the attitude, in the frame north, east, down; a turn about the
        line of antennas on one line is not in it.
    rank : int
        Directions that the antennas span: 1 leaves the turn about their line free.
    objective, second_objective : float
        Least cost and the next (or the least that it can be).
    success_probability : float
        Posterior probability of the integers.
    attitude_share : float
        Share of the attitude in it, where the same integers have another one.
    chi2, chi2_limit, dof : float, float, int
        Residual test: the cost, its limit, and its degrees of freedom.
    n_candidates, n_nodes : int
        Candidates within the margin; nodes and checks of the search.
    candidates_cyc : ndarray of int64, shape (k, n)
        The best candidates, best first.
    candidate_cost, candidate_log_volume : ndarray, shape (k,)
        Their costs, and the logarithm of the volume of attitudes each has.
    complete_to : float
        Cost up to which none is missing.
    """

    status: Status
    reason: Reason
    integers_cyc: np.ndarray
    rot_ned_from_body: np.ndarray
    cov_rad2: np.ndarray
    rank: int
    objective: float
    second_objective: float
    success_probability: float
    attitude_share: float
    chi2: float
    chi2_limit: float
    dof: int
    n_candidates: int
    n_nodes: int
    candidates_cyc: np.ndarray
    candidate_cost: np.ndarray
    candidate_log_volume: np.ndarray
    complete_to: float


def resolve_joint(
    epoch: ArrayEpoch,
    *,
    use_code=True,
    success_probability=SUCCESS_PROBABILITY,
    residual_significance=1e-4,
    prior_rot=None,
    prior_information=None,
    candidates=0,
    margin=POSTERIOR_MARGIN,
    max_nodes=MAX_NODES,
) -> JointResolution:
    """Resolve the integers of one epoch of an array, all baselines together.

    Parameters
    ----------
    epoch : ArrayEpoch
        Rows of all antennas; two antennas are enough, and none need have all satellites.
    use_code : bool
        Whether pseudoranges take part.
    success_probability : float
        Posterior probability demanded, of integers and attitude.
    residual_significance : float
        False-alarm rate of the chi-square test of the winner.
    prior_rot, prior_information : ndarray, shape (3, 3), optional
        Attitude known beforehand, and the information on a small rotation of it in north, east, down,
        1/rad^2. An axis known better than the other two together counts as these do together.
    candidates : int
        How many of the best candidates to return.
    margin : float
        How far beyond the best candidates count for the posterior probability.
    max_nodes : int
        Nodes and checks after which the search stops, unfinished.

    Returns
    -------
    JointResolution
    """
    from .._kernels import joint_search as kernel

    n = len(epoch.antenna)
    integers = np.zeros(n, np.int64)
    rot, cov = np.empty((3, 3)), np.empty((3, 3))
    row = np.empty(kernel.N_COLUMNS)
    listed = np.zeros((candidates, n), np.int64)
    cost, volume = np.zeros(candidates), np.zeros(candidates)
    has_prior = prior_rot is not None and prior_information is not None
    reason = Reason(
        kernel.search_array(
            *(_integers(a) for a in (epoch.antenna, epoch.satellite, epoch.group)),
            _floats(epoch.phase_m),
            _floats(epoch.code_m) if use_code else np.full(n, np.nan),
            *(
                _floats(a)
                for a in (
                    epoch.design_ned,
                    epoch.wavelength_m,
                    epoch.phase_variance_m2,
                    epoch.code_variance_m2,
                    epoch.positions_body_m,
                )
            ),
            float(epoch.position_sd_m),
            _floats(prior_rot) if has_prior else np.eye(3),
            _floats(prior_information) if has_prior else np.zeros((3, 3)),
            float(margin),
            REACH,
            int(max_nodes),
            integers,
            rot,
            cov,
            row,
            listed,
            cost,
            volume,
        )
    )
    best = float(row[kernel.COST])
    probability, share = float(row[kernel.PROBABILITY]), float(row[kernel.ATTITUDE_SHARE])
    dof = int(row[kernel.DOF]) if math.isfinite(row[kernel.DOF]) else 0
    limit = chi2_quantile(residual_significance, dof, upper=True) if dof > 0 else math.nan
    status = Status.FLOAT if math.isfinite(best) else Status.NONE
    if reason is Reason.OK:
        if dof > 0 and best > limit:
            reason = Reason.RESIDUAL_TEST
        elif not probability * share >= success_probability:
            reason = Reason.PROBABILITY_TEST
        else:
            status = Status.FIXED
    k = int(row[kernel.N_LISTED])
    return JointResolution(
        status=status,
        reason=reason,
        integers_cyc=integers,
        rot_ned_from_body=rot,
        cov_rad2=cov,
        rank=int(row[kernel.RANK]) if math.isfinite(row[kernel.RANK]) else 0,
        objective=best,
        second_objective=float(row[kernel.SECOND_COST]),
        success_probability=probability,
        attitude_share=share,
        chi2=best,
        chi2_limit=float(limit),
        dof=dof,
        n_candidates=int(row[kernel.N_CANDIDATES]),
        n_nodes=int(row[kernel.N_NODES]),
        candidates_cyc=listed[:k],
        candidate_cost=cost[:k],
        candidate_log_volume=np.log(volume[:k]),
        complete_to=float(row[kernel.COMPLETE_TO]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class JointArcs:
    """What several epochs with the same integers say together.

    Parameters
    ----------
    status : Status
        `Status.FIXED` when accepted, `Status.FLOAT` when there is a winner that is not, else `Status.NONE`.
    reason : Reason
        Why.
    arcs : ndarray of int64, shape (a,)
        Numbers of the arcs, ascending.
    integers_cyc : ndarray of int64, shape (a,)
        Their integers, up to constants of satellites and clocks.
    is_fixed : ndarray of bool, shape (a,)
        Arcs whose integers are known: those of the search, and others that the attitudes decide.
    rot_ned_from_body : ndarray, shape (epochs, 3, 3)
        Attitude of the winner in each epoch.
    objective, second_objective : float
        Summed costs of the winner and of the next.
    success_probability : float
        Posterior probability of the winner.
    chi2, chi2_limit, dof : float, float, int
        Residual test of the sum.
    n_candidates : int
        Candidates within the margin.
    """

    status: Status
    reason: Reason
    arcs: np.ndarray
    integers_cyc: np.ndarray
    is_fixed: np.ndarray
    rot_ned_from_body: np.ndarray
    objective: float
    second_objective: float
    success_probability: float
    chi2: float
    chi2_limit: float
    dof: int
    n_candidates: int


def resolve_joint_epochs(
    epochs,
    arcs,
    *,
    use_code=True,
    success_probability=SUCCESS_PROBABILITY,
    residual_significance=1e-4,
    margin=POSTERIOR_MARGIN,
    max_nodes=MAX_NODES,
) -> JointArcs:
    """Resolve the integers that several epochs share; the attitude may be another in each.

    Parameters
    ----------
    epochs : sequence of ArrayEpoch
        Of one array.
    arcs : sequence of ndarray of int64
        For each epoch the number of each row's arc (antenna, satellite, signal without a cycle slip); equal
        numbers have equal integers.
    use_code, success_probability, residual_significance, margin, max_nodes
        As in `resolve_joint`.

    Returns
    -------
    JointArcs

    Notes
    -----
    The search rests on the arcs that all epochs have. Others are fixed afterwards, by rounding at the
    winner's attitudes.
    """
    epochs = list(epochs)
    arcs = [np.asarray(a, dtype=np.int64) for a in arcs]
    every = np.unique(np.concatenate(arcs))
    common = every
    for epoch, number in zip(epochs, arcs, strict=True):
        common = np.intersect1d(common, number[np.isfinite(epoch.phase_m)])
    # The rows of the common arcs, in the order and with the numbers of the first epoch.
    first = np.flatnonzero(np.isin(arcs[0], common))
    order = arcs[0][first]
    satellite = np.unique(epochs[0].satellite[first], return_inverse=True)[1]
    group = np.unique(epochs[0].group[first], return_inverse=True)[1]
    parts = []
    for epoch, number in zip(epochs, arcs, strict=True):
        at = {int(arc): row for row, arc in enumerate(number)}
        rows = np.array([at[int(arc)] for arc in order], dtype=np.int64)
        parts.append(
            ArrayEpoch(
                epoch.antenna[rows],
                satellite,
                group,
                epoch.phase_m[rows],
                epoch.code_m[rows] if use_code else np.full(len(rows), np.nan),
                epoch.design_ned[rows],
                epoch.wavelength_m[rows],
                epoch.phase_variance_m2[rows],
                epoch.code_variance_m2[rows],
                epoch.positions_body_m,
                epoch.position_sd_m,
            )
        )
    none = JointArcs(
        Status.NONE, Reason.TOO_FEW_SATELLITES, every, np.zeros(len(every), np.int64),
        np.zeros(len(every), bool), np.full((len(epochs), 3, 3), np.nan), math.nan, math.nan, math.nan,
        math.nan, math.nan, 0, 0,
    )  # fmt: skip
    if len(order) == 0:
        return none
    adjustments = [_Adjustment(part) for part in parts]
    width = np.full(len(parts), max(margin / len(parts), 6.0))
    for _ in range(4):
        lists = [
            resolve_joint(part, candidates=MAX_LISTED, margin=w, max_nodes=max_nodes)
            for part, w in zip(parts, width, strict=True)
        ]
        failed = next((one for one in lists if one.reason in (Reason.SEARCH_LIMIT, Reason.NO_CANDIDATE,
                       Reason.TOO_FEW_SATELLITES, Reason.WEAK_GEOMETRY)), None)  # fmt: skip
        if failed is not None:
            return replace(none, reason=failed.reason)
        candidates = np.unique(np.concatenate([one.candidates_cyc for one in lists]), axis=0)
        each = [adjustment.evaluate(candidates) for adjustment in adjustments]
        cost = np.sum([one[0] for one in each], axis=0)
        log_volume = np.sum([one[1] for one in each], axis=0)
        complete_to = sum(one.complete_to for one in lists)
        short = cost.min() + margin - complete_to
        if short <= 0.0:
            break
        width = width + short / len(parts) + 1e-6
    best = int(np.argmin(cost))
    weight = np.exp(log_volume - log_volume[best] - 0.5 * (cost - cost[best]))
    weight[cost > cost[best] + margin] = 0.0
    probability = float(1.0 / weight.sum())
    dof = sum(one.dof for one in lists)
    limit = chi2_quantile(residual_significance, dof, upper=True) if dof > 0 else math.nan
    status, reason = Status.FLOAT, Reason.OK
    if short > 0.0:
        reason = Reason.SEARCH_LIMIT
    elif cost[best] > limit:
        reason = Reason.RESIDUAL_TEST
    elif not probability >= success_probability:
        reason = Reason.PROBABILITY_TEST
    else:
        status = Status.FIXED
    rot = np.array([one[2][best] for one in each])
    integers = np.zeros(len(every), np.int64)
    is_fixed = np.isin(every, order)
    integers[np.searchsorted(every, order)] = candidates[best]
    _fix_rising(epochs, arcs, rot, every, integers, is_fixed)
    others = np.delete(cost, best)
    return JointArcs(
        status=status,
        reason=reason,
        arcs=every,
        integers_cyc=integers,
        is_fixed=is_fixed,
        rot_ned_from_body=rot,
        objective=float(cost[best]),
        second_objective=float(min(others.min(initial=np.inf), max(complete_to, cost[best]))),
        success_probability=probability,
        chi2=float(cost[best]),
        chi2_limit=float(limit),
        dof=dof,
        n_candidates=int(np.sum(cost <= cost[best] + margin)),
    )


class _Adjustment:
    """The attitude of one epoch adjusted for many sets of integers at once."""

    def __init__(self, epoch):
        body = epoch.positions_body_m - epoch.positions_body_m[epoch.antenna].mean(axis=0)
        by_place, y, by_phase, spent = [], [], [], 0.0
        n = len(epoch.antenna)
        places = np.zeros((n, len(body), 3))
        places[np.arange(n), epoch.antenna] = epoch.design_ned
        for value, variance, is_phase in (
            (epoch.phase_m, epoch.phase_variance_m2, True),
            (epoch.code_m, epoch.code_variance_m2, False),
        ):
            used = np.flatnonzero(np.isfinite(value))
            if len(used) == 0:
                continue
            root = 1.0 / np.sqrt(variance[used])
            constants = np.hstack(
                [
                    epoch.satellite[used, None] == np.unique(epoch.satellite[used]),
                    (epoch.antenna + len(body) * epoch.group)[used, None]
                    == np.unique((epoch.antenna + len(body) * epoch.group)[used]),
                ]
            ) * root[:, None]  # fmt: skip
            project = (np.eye(len(used)) - constants @ np.linalg.pinv(constants, rcond=1e-9)) * root
            design = project @ places[used].reshape(len(used), -1)
            y.append(project @ (value[used] - value[used].mean()))
            by_place.append(design)
            by_phase.append(project if is_phase else np.zeros((len(used), n)))
            if not is_phase:
                spent = float(np.sum((y[-1] - design @ np.linalg.pinv(design, rcond=1e-9) @ y[-1]) ** 2))
        by_place, y, by_phase = np.vstack(by_place), np.concatenate(y), np.vstack(by_phase)
        if epoch.position_sd_m > 0.0:
            m = by_place.shape[1]
            basis = np.linalg.qr(np.vstack([by_place, np.eye(m) / epoch.position_sd_m]))[0]
            keep = np.vstack([np.eye(len(y)), np.zeros((m, len(y)))])
            keep = keep - basis @ (basis.T @ keep)
            by_place, y, by_phase = keep @ by_place, keep @ y, keep @ by_phase
        design = np.einsum("nar,ac->nrc", by_place.reshape(len(y), -1, 3), body).reshape(len(y), 9)
        self.normal = design.T @ design
        self.rhs, self.rhs_phase = design.T @ y, design.T @ (by_phase * epoch.wavelength_m)
        self.square, self.spent = y @ y, spent
        self.cross = y @ (by_phase * epoch.wavelength_m)
        self.square_phase = (by_phase * epoch.wavelength_m).T @ (by_phase * epoch.wavelength_m)
        singular = np.linalg.svd(body, compute_uv=False)
        self.rank = int(np.sum(singular > max(1e-6 * singular[0], 2.0 * epoch.position_sd_m)))

    def evaluate(self, integers):
        """Costs, logarithms of the volumes, and attitudes of sets of integers, (k, rows)."""
        integers = integers.astype(float)
        rhs = self.rhs - integers @ self.rhs_phase.T
        square = (
            self.square - 2.0 * integers @ self.cross
            + np.einsum("ki,ij,kj->k", integers, self.square_phase, integers) - self.spent
        )  # fmt: skip
        # Starts: the nearest rotation of the free solution, and of its mirror images.
        trace = 1e-6 * np.trace(self.normal)
        free = np.linalg.solve(self.normal + trace * np.eye(9), rhs.T).T.reshape(-1, 3, 3)
        weak = np.linalg.eigh(np.einsum("rcsc->rs", self.normal.reshape(3, 3, 3, 3)))[1][:, 0]
        mirror = np.eye(3) - 2.0 * np.outer(weak, weak)
        results = [self._descend(_nearest(start), rhs, square) for start in (free, mirror @ free)]
        results.append(self._descend(_nearest(mirror @ results[0][2]), rhs, square))
        cost = np.array([one[0] for one in results])
        best = cost.argmin(axis=0)
        at = np.arange(len(integers))
        # A second attitude of the same integers counts where it is another one.
        log_volume = np.array([one[1] for one in results])
        rot = np.array([one[2] for one in results])
        apart = np.sum((rot - rot[best, at]) ** 2, axis=(2, 3)) > 1e-6
        other = np.where(apart, log_volume - 0.5 * (cost - cost[best, at]), -np.inf).max(axis=0)
        return cost[best, at], np.logaddexp(log_volume[best, at], other), rot[best, at]

    def _descend(self, rot, rhs, square):
        """Damped Newton steps on the group for all at once."""
        normal = self.normal

        def evaluate(rot):
            x = rot.reshape(-1, 9)
            return square + np.sum((x @ normal - 2.0 * rhs) * x, axis=1)

        cost, damping = evaluate(rot), np.full(len(rhs), 1e-6)
        for _ in range(50):
            h, g = self._curvature(rot, rhs)
            scale = np.trace(h, axis1=1, axis2=2)
            lowest = np.linalg.eigvalsh(h)[:, 0]
            shift = np.maximum(damping * scale, -1.5 * lowest + 1e-9 * scale)
            step = -np.linalg.solve(h + shift[:, None, None] * np.eye(3), g[..., None])[..., 0]
            trial = exp_so3(step) @ rot
            reached = evaluate(trial)
            is_better = reached <= cost
            gain = np.max(np.where(is_better, cost - reached, 0.0), initial=0.0)
            rot = np.where(is_better[:, None, None], trial, rot)
            cost = np.where(is_better, reached, cost)
            damping = np.clip(np.where(is_better, 0.1 * damping, 30.0 * damping), 1e-12, 1e3)
            if gain < 1e-9 and is_better.all():
                break
        values = np.linalg.eigvalsh(self._curvature(rot, rhs)[0])
        if self.rank == 1:
            values = values[:, 1:]
        return cost, -0.5 * np.sum(np.log(np.maximum(values, 1e-12)), axis=1), rot

    def _curvature(self, rot, rhs):
        """Half the second and first derivatives for a small rotation."""
        x = rot.reshape(-1, 9)
        error = (x @ self.normal - rhs).reshape(-1, 3, 3)
        turn = np.stack([_CROSS[k] @ rot for k in range(3)], axis=-1).reshape(-1, 9, 3)
        outer = error @ np.swapaxes(rot, 1, 2)
        group = 0.5 * (outer + np.swapaxes(outer, 1, 2))
        group = group - np.trace(outer, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        h = np.swapaxes(turn, 1, 2) @ (self.normal @ turn) + group
        g = np.swapaxes(turn, 1, 2) @ error.reshape(-1, 9, 1)
        return h, g[..., 0]


_CROSS = np.array([[[0, 0, 0], [0, 0, -1], [0, 1, 0]], [[0, 0, 1], [0, 0, 0], [-1, 0, 0]],
                   [[0, -1, 0], [1, 0, 0], [0, 0, 0]]], dtype=float)  # fmt: skip


def _nearest(matrix):
    """Rotations nearest to matrices; directions that these leave open are completed."""
    u, _, v = np.linalg.svd(matrix)
    u[..., 2] *= np.sign(np.linalg.det(u @ v))[..., None]
    return u @ v


def _fix_rising(epochs, arcs, rot, every, integers, is_fixed):
    """Fix arcs that not all epochs have, in place: rounding of what the winner's attitudes leave of them."""
    known = is_fixed.copy()
    sums, counts = np.zeros(len(every)), np.zeros(len(every))
    for epoch, number, attitude in zip(epochs, arcs, rot, strict=True):
        at = np.searchsorted(every, number)
        place = epoch.positions_body_m @ attitude.T
        rest = epoch.phase_m - np.sum(epoch.design_ned * place[epoch.antenna], axis=1)
        has_phase = np.isfinite(rest)
        rest = rest - epoch.wavelength_m * np.where(is_fixed[at], integers[at], 0)
        for group in np.unique(epoch.group):
            inside = has_phase & (epoch.group == group)
            old = np.flatnonzero(inside & known[at])
            if len(old) == 0:
                continue
            antennas = np.unique(epoch.antenna[old])
            columns = np.hstack(
                [
                    epoch.satellite[old, None] == np.unique(epoch.satellite[old]),
                    epoch.antenna[old, None] == antennas,
                ]
            ).astype(float)
            level = rest[old].mean()
            solution = np.linalg.lstsq(columns, rest[old] - level, rcond=1e-9)[0]
            clock = dict(zip(antennas, solution[-len(antennas) :], strict=True))
            for satellite in np.unique(epoch.satellite[inside & ~known[at]]):
                rows = np.flatnonzero(inside & (epoch.satellite == satellite))
                rows = [i for i in rows if epoch.antenna[i] in clock]
                if not rows:
                    continue
                # A satellite with a known arc hangs on that; of a new one the first arc fixes the constant.
                datum = next((i for i in rows if known[at[i]]), None)
                if datum is None:
                    datum = next((i for i in rows if is_fixed[at[i]]), rows[0])
                    is_fixed[at[datum]] = True
                base = rest[datum] - clock[epoch.antenna[datum]]
                for i in rows:
                    if i != datum and not known[at[i]]:
                        value = rest[i] - clock[epoch.antenna[i]] - base
                        if not is_fixed[at[i]]:
                            sums[at[i]] += value / epoch.wavelength_m[i]
                            counts[at[i]] += 1
    seen = counts > 0
    mean = sums[seen] / counts[seen]
    near = np.abs(mean - np.rint(mean)) < RISING_TOLERANCE_CYC
    index = np.flatnonzero(seen)[near]
    integers[index] = np.rint(mean[near]).astype(np.int64)
    is_fixed[index] = True


def _integers(values):
    """Contiguous int64, as the kernel takes them."""
    return np.ascontiguousarray(values, dtype=np.int64)


def _floats(values):
    """Contiguous, writable float64, as the kernel takes them."""
    values = np.ascontiguousarray(values, dtype=np.float64)
    return values if values.flags.writeable else values.copy()
