"""From single differences to resolved epochs: one entry for all integer methods.

`resolve_epochs` prepares the arrays, runs the compiled engine (``constrained``, ``lambda``,
``filter``) or the classical searches epoch by epoch (``lsast``, ``exhaustive``, ``kalman``), and
returns the same table for all of them.
"""

from dataclasses import dataclass, field

import numpy as np

from ..errors import Reason, Status
from ..observations import sat_name, signal_name
from ..timescales import NS_PER_S
from .slips import find_arcs

__all__ = ["ResolvedEpochs", "resolve_epochs"]

SEARCH_MARGIN = 20.0
"""Candidates within this of the best objective count for the posterior probability; one further
away weighs less than exp(-10)."""

SEARCH_CAP_FACTOR = 5.0
"""The search looks no further than this multiple of the residual test's limit, plus the margin."""

MAX_NODES = 5_000_000
"""Nodes of one epoch's search tree before it gives up (about a tenth of a second)."""

MAX_EXCLUSIONS = 2
"""Outlying phases that one epoch may lose before it is given up."""

DISAGREEMENT_M = 0.03
"""Forward and backward baselines further apart than this have different integers."""

RATIO_MODES = {"none": 0, "fixed": 1, "fixed_failure_rate": 1, "difference": 2}

FILTER_EVENTS = {
    1: ("fixed", "integers accepted by the search: probability {statistic:.6f}, demanded {limit:g}"),
    2: ("released", "integer of {name} released: residual {statistic:+.4f} m, sd {limit:.4f} m"),
    3: ("released", "all held integers released: test {statistic:.4g}, limit {limit:.4g}"),
    4: ("held", "integer of {name} added: {statistic:.4f} m from the nearest, limit {limit:.4f} m"),
}

SAMPLE_EPOCHS = 120
PRIOR_DOF = 10.0

PSEUDO_WEIGHT = 10.0
"""Weight kappa = mu l^2 of the pseudo-observation that bounds the search. Small values widen the
ball |b|^2 <= l^2 (1 + C / kappa), large ones loosen the bound by kappa; 5 to 20 cost the same."""


@dataclass(frozen=True, slots=True, eq=False)
class ResolvedEpochs:
    """What the integer methods found, one row per epoch.

    Parameters
    ----------
    table : ndarray, shape (n_epochs, n_columns)
        Numbers of each epoch, columns of `truenorth._kernels.baseline`.
    status, reason : ndarray of uint8, shape (n_epochs,)
        Codes of `Status` and `Reason`.
    row : ndarray of int64, shape (m,)
        Single-difference rows whose phases took part.
    start : ndarray of int64, shape (n_epochs + 1,)
        Their epoch offsets.
    residual_m, integer_cyc : ndarray, shape (m,)
        Single-difference residual of the winner, and its integer against the group's first row.
    variance_factors : tuple of float
        Applied to the phase and code variances of the settings.
    events : list
        Decisions of the method.
    """

    table: np.ndarray
    status: np.ndarray
    reason: np.ndarray
    row: np.ndarray
    start: np.ndarray
    residual_m: np.ndarray
    integer_cyc: np.ndarray
    variance_factors: tuple[float, float] = (1.0, 1.0)
    events: list = field(default_factory=list)


def _select_rows(differences, keep):
    """Rows to keep and their epoch offsets."""
    cumulative = np.concatenate(([0], np.cumsum(keep)))
    return np.flatnonzero(keep).astype(np.int64), cumulative[differences.start].astype(np.int64)


def chi2_limits(significance, n=200):
    """Upper chi-square limits by degrees of freedom 0 to n - 1, for the kernels."""
    from ..positioning.single_point import _chi2_limits

    return np.ascontiguousarray(_chi2_limits(n, significance))


def _prior(settings):
    """Information and right side of the a-priori direction, in east, north, up."""
    information, rhs = np.zeros((3, 3)), np.zeros(3)
    if settings.direction_azimuth_deg is None or settings.length_m is None:
        return information, rhs
    azimuth, elevation = np.radians([settings.direction_azimuth_deg, settings.direction_elevation_deg])
    sd_azimuth, sd_elevation = np.radians(settings.direction_sd_deg)
    se, ce = np.sin(elevation), np.cos(elevation)
    sa, ca = np.sin(azimuth), np.cos(azimuth)
    along = np.array([sa * ce, ca * ce, se])
    across = np.array([ca, -sa, 0.0])
    upward = np.array([-se * sa, -se * ca, ce])
    length = settings.length_m
    # The shell already knows the length; the prior speaks of the direction and, loosely, of the cap's depth.
    depth = length * max(sd_azimuth, sd_elevation) ** 2 + 3.0 * settings.length_sd_m
    for vector, sd in (
        (across, length * max(ce, 0.05) * sd_azimuth),
        (upward, length * sd_elevation),
        (along, depth),
    ):
        information += np.outer(vector, vector) / sd**2
    return information, information @ (length * along)


def resolve_epochs(differences, base, rover, settings, *, progress=None):
    """Resolve the integers of every epoch.

    Parameters
    ----------
    differences : SingleDifferences
        All epochs.
    base, rover : Observations
        The raw observations, for their loss-of-lock flags.
    settings : GnssSettings
        Method, length, tests.
    progress : callable, optional
        Called with (epochs done, epochs in all) from time to time.

    Returns
    -------
    ResolvedEpochs
    """
    factors = (1.0, 1.0)
    if settings.stochastic.estimate:
        factors = _estimate_variance_factors(differences, settings)
    if settings.method in ("constrained", "lambda") and settings.single_epoch:
        return _resolve_alone(differences, settings, factors)
    if settings.method in ("constrained", "lambda", "filter"):
        return _resolve_filtered(differences, base, rover, settings, factors)
    from .classical import resolve_classical

    return resolve_classical(differences, base, rover, settings, factors, progress=progress)


def _resolve_alone(differences, settings, factors, epochs=None):
    """Every epoch by itself, in the compiled engine."""
    from .._kernels import baseline as kernel

    d = differences
    keep_phase = np.isfinite(d.phase_m) & d.integer_ok
    keep_code = np.isfinite(d.code_m)
    if not settings.use_code:
        keep_code[:] = False
    if epochs is not None:
        chosen = np.zeros(d.n_epochs, bool)
        chosen[epochs] = True
        chosen = chosen[d.epoch_of_row]
        keep_phase &= chosen
        keep_code &= chosen
    row, start = _select_rows(d, keep_phase)
    code_row, code_start = _select_rows(d, keep_code)
    n = d.n_epochs
    table = np.empty((n, kernel.N_COLUMNS))
    status = np.zeros(n, np.uint8)
    reason = np.zeros(n, np.uint8)
    residual = np.empty(len(row))
    integer = np.empty(len(row))
    excluded = np.zeros(len(row))
    known = settings.length_m is not None and settings.length_use != "off"
    in_search = known and settings.length_use == "constrain" and settings.method == "constrained"
    prior_information, prior_rhs = _prior(settings)
    kernel.solve_single_epochs(
        start, d.phase_m[row], d.design_enu[row], d.wavelength_m[row],
        factors[0] * d.phase_variance_m2[row], d.group[row],
        code_start, d.code_m[code_row], d.design_enu[code_row],
        factors[1] * d.code_variance_m2[code_row], d.group[code_row],
        prior_information, prior_rhs,
        float(settings.length_m) if known else np.nan,
        float(settings.length_sd_m) ** 2,
        in_search,
        known and settings.length_use in ("constrain", "check"),
        float(settings.length_tolerance_sd), PSEUDO_WEIGHT, SEARCH_CAP_FACTOR, SEARCH_MARGIN, MAX_NODES,
        chi2_limits(settings.residual_significance),
        float(settings.success_probability), RATIO_MODES[settings.ratio_test], float(settings.ratio_threshold),
        MAX_EXCLUSIONS, residual, integer, excluded, table, status, reason,
    )  # fmt: skip
    reason[~d.has_position] = Reason.NO_POSITION
    status[~d.has_position] = Status.NONE
    log = []
    for k in np.flatnonzero(excluded):
        epoch = np.searchsorted(start, k, side="right") - 1
        name, tracking = sat_name(int(d.sat[row[k]])), signal_name(int(d.signal[row[k]]))
        log.append((int(d.time_ns[epoch]), "outlier", name, tracking, float(excluded[k]), np.nan,
                    f"phase of {name} {tracking} excluded: normalised residual {excluded[k]:.1f}"))  # fmt: skip
    return ResolvedEpochs(table, status, reason, row, start, residual, integer, factors, log)


def _resolve_filtered(differences, base, rover, settings, factors):
    """Ambiguities carried over the epochs, in the compiled filter; forward, backward or both."""
    change = settings.length_m if settings.length_m is not None else 1.0
    arcs = find_arcs(differences, base, rover, baseline_change_m=change)
    resolved = {}
    directions = ("forward", "backward") if settings.direction == "combined" else (settings.direction,)
    for direction in directions:
        resolved[direction] = _run_filter(differences, arcs, settings, factors, direction == "backward")
    if settings.direction == "combined":
        result = _combine(resolved["forward"], resolved["backward"])
    else:
        result = resolved[directions[0]]
    result.events.extend(arcs.events)
    return result


def _run_filter(differences, arcs, settings, factors, backward):
    """One pass of the compiled filter."""
    from .._kernels import baseline as columns
    from .._kernels import filter as kernel

    d = differences
    keep_phase = np.isfinite(d.phase_m) & d.integer_ok
    keep_code = np.isfinite(d.code_m) & settings.use_code
    row, start = _select_rows(d, keep_phase)
    code_row, code_start = _select_rows(d, keep_code)
    n = d.n_epochs
    # The integer part of phase minus code keeps the numbers inside the filter small.
    offset = np.zeros(arcs.n_arcs)
    arc = arcs.arc[row]
    apart = np.nan_to_num((d.phase_m[row] - d.code_m[row]) / d.wavelength_m[row])
    first = np.unique(arc, return_index=True)
    offset[first[0]] = np.rint(apart[first[1]])
    y = d.phase_m[row] - d.wavelength_m[row] * offset[arc]
    order, code_order = row_order = np.arange(len(row)), np.arange(len(code_row))
    epochs = np.arange(n)
    if backward:
        epochs = epochs[::-1]
        order, start = _reverse(start)
        code_order, code_start = _reverse(code_start)
        row, y, arc, code_row = row[order], y[order], arc[order], code_row[code_order]
    del row_order
    known = settings.length_m is not None and settings.length_use != "off"
    in_search = known and settings.length_use == "constrain" and settings.method != "lambda"
    table = np.empty((n, columns.N_COLUMNS))
    status, reason = np.zeros(n, np.uint8), np.zeros(n, np.uint8)
    residual, integer = np.empty(len(row)), np.empty(len(row))
    capacity = 20 * n + 100
    events, numbers = np.empty((capacity, 3), np.int64), np.empty((capacity, 2))
    n_events = kernel.run_filter(
        (d.time_ns[epochs] - d.time_ns[0]) / NS_PER_S, start, y, d.design_enu[row], d.wavelength_m[row],
        factors[0] * d.phase_variance_m2[row], d.group[row], arc, arcs.n_arcs,
        code_start, d.code_m[code_row], d.design_enu[code_row], factors[1] * d.code_variance_m2[code_row],
        d.group[code_row],
        float(settings.length_m) if known else np.nan, float(settings.length_sd_m) ** 2, in_search,
        known and settings.length_use in ("constrain", "check"), float(settings.length_tolerance_sd),
        PSEUDO_WEIGHT, SEARCH_CAP_FACTOR, SEARCH_MARGIN, MAX_NODES,
        chi2_limits(settings.residual_significance), float(settings.success_probability),
        RATIO_MODES[settings.ratio_test], float(settings.ratio_threshold),
        settings.stochastic.correlation_s, settings.stochastic.memory_epochs, settings.method == "filter",
        settings.min_epochs_to_fix,
        residual, integer, table, status, reason, events, numbers,
    )  # fmt: skip
    integer += offset[arc]
    # Integers against the first row of each group, as in the single-epoch engine.
    epoch_of = np.repeat(np.arange(n), np.diff(start))
    group = d.group[row]
    head = np.ones(len(row), bool)
    head[1:] = (epoch_of[1:] != epoch_of[:-1]) | (group[1:] != group[:-1])
    integer -= integer[np.maximum.accumulate(np.where(head, np.arange(len(row)), 0))]
    if backward:
        table, status, reason = table[::-1].copy(), status[::-1].copy(), reason[::-1].copy()
        back, start = _reverse(start)
        row, residual, integer = row[back], residual[back], integer[back]
    reason[~d.has_position] = Reason.NO_POSITION
    status[~d.has_position] = Status.NONE
    log = []
    for k in range(n_events):
        epoch = epochs[events[k, 0]]
        at = int(events[k, 1])
        name = tracking = ""
        if at >= 0:
            source = (row[np.argsort(order)] if backward else row)[at]
            name, tracking = sat_name(int(d.sat[source])), signal_name(int(d.signal[source]))
        kind, text = FILTER_EVENTS[int(events[k, 2])]
        log.append((int(d.time_ns[epoch]), kind, name, tracking, float(numbers[k, 0]), float(numbers[k, 1]),
                    text.format(name=f"{name} {tracking}".strip(), statistic=numbers[k, 0], limit=numbers[k, 1])))  # fmt: skip
    return ResolvedEpochs(table, status, reason, row, start, residual, integer, factors, log)


def _reverse(start):
    """Row order and offsets with the epochs reversed and the order inside each kept."""
    counts = np.diff(start)[::-1]
    new_start = np.concatenate(([0], np.cumsum(counts))).astype(np.int64)
    begin = np.repeat(start[:-1][::-1] - new_start[:-1], counts)
    return begin + np.arange(new_start[-1]), new_start


def _combine(forward, backward):
    """Join both directions: accepted wins over float; where both are, the surer one.

    Both directions use the same observations of an epoch, so once their integers agree their fixed
    baselines are the same adjustment; where accepted integers disagree the epoch is not accepted.
    """
    from .._kernels import baseline as columns

    accepted_f = forward.status >= Status.HELD
    accepted_b = backward.status >= Status.HELD
    take_b = accepted_b & ~accepted_f
    more = np.nan_to_num(backward.table[:, columns.N_PHASES]) > np.nan_to_num(forward.table[:, columns.N_PHASES])
    take_b |= accepted_b & accepted_f & more
    gap = np.linalg.norm(
        forward.table[:, columns.BX : columns.BZ + 1] - backward.table[:, columns.BX : columns.BZ + 1], axis=1
    )
    clash = accepted_f & accepted_b & (gap > DISAGREEMENT_M)
    pick = take_b[:, None]
    status = np.where(take_b, backward.status, forward.status)
    reason = np.where(take_b, backward.reason, forward.reason)
    status[clash], reason[clash] = Status.FLOAT, Reason.DIRECTIONS_DISAGREE
    row_pick = np.repeat(take_b, np.diff(forward.start))
    return ResolvedEpochs(
        np.where(pick, backward.table, forward.table), status, reason, forward.row, forward.start,
        np.where(row_pick, backward.residual_m, forward.residual_m),
        np.where(row_pick, backward.integer_cyc, forward.integer_cyc),
        forward.variance_factors, forward.events + backward.events,
    )  # fmt: skip


def _estimate_variance_factors(differences, settings):
    """Robust variance factors of phases and codes from the winners of a sample of epochs.

    The medians over the epochs of the winners' chi-square over its expectation: wrong winners of the
    worst epochs do not move them. A prior of a few degrees of freedom at 1 keeps short runs sane.
    """
    from .._kernels import baseline as kernel

    d = differences
    sample = np.unique(np.linspace(0, d.n_epochs - 1, min(d.n_epochs, SAMPLE_EPOCHS)).astype(int))
    resolved = _resolve_alone(d, settings, (1.0, 1.0), epochs=sample)
    chi2 = resolved.table[sample, kernel.CHI2]
    dof = resolved.table[sample, kernel.CHI2_DOF]
    phase = _median_factor(chi2, dof)

    # Codes against the baseline of the winner.
    start = d.start
    code_chi2, code_dof = np.full(len(sample), np.nan), np.zeros(len(sample))
    for k, epoch in enumerate(sample):
        rows = np.arange(start[epoch], start[epoch + 1])
        rows = rows[np.isfinite(d.code_m[rows])]
        b = resolved.table[epoch, kernel.BX : kernel.BZ + 1]
        if not np.isfinite(b[0]) or len(rows) < 2:
            continue
        misfit = d.code_m[rows] - d.design_enu[rows] @ b
        weight = 1.0 / d.code_variance_m2[rows]
        _, group = np.unique(d.group[rows], return_inverse=True)
        total = np.bincount(group, weight)
        misfit -= (np.bincount(group, weight * misfit) / total)[group]
        code_chi2[k], code_dof[k] = np.sum(weight * misfit**2), len(rows) - len(total)
    return phase, _median_factor(code_chi2, code_dof)


def _median_factor(chi2, dof):
    """Variance factor from chi-squares by their median; its logarithm shrinks towards 0 with `PRIOR_DOF`."""
    good = np.isfinite(chi2) & (dof > 0)
    if not good.any():
        return 1.0
    # Median of chi-square by Wilson and Hilferty.
    expected = dof[good] * (1.0 - 2.0 / (9.0 * dof[good])) ** 3
    n = dof[good].sum()
    factor = max(float(np.median(chi2[good] / expected)), 1e-6)
    return factor ** (n / (n + PRIOR_DOF))
