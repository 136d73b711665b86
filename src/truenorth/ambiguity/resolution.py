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
from .carried import ResolutionState
from .slips import Arcs, find_arcs

__all__ = [
    "ResolvedEpochs",
    "estimate_variance_factors",
    "median_factor",
    "resolve_epochs",
    "resolve_sample",
]

SEARCH_MARGIN = 20.0
"""Candidates within this of the best objective count for the posterior probability; one further
away weighs less than exp(-10)."""

SEARCH_CAP_FACTOR = 5.0
"""The search looks no further than this multiple of the residual test's limit, plus the margin."""

MAX_NODES = 5_000_000
"""Nodes of one epoch's search tree before it gives up (about a tenth of a second)."""

MAX_EXCLUSIONS = 2
"""Outlying phases that one epoch may lose before it is given up."""

UNKNOWN_LENGTH_CHANGE_M = 1.0
"""How far a baseline of unknown length may turn between epochs, in the test for slips."""

DISAGREEMENT_M = 0.03
DISAGREEMENT_SD = 5.0
"""Forward and backward baselines further apart than both of these have different integers."""


ENGINE_EVENTS = {
    1: ("fixed", "integers accepted and held: probability {statistic:.6f}, demanded {limit:g}"),
    2: ("released", "integer of {name} released: an outlier {limit:g} times, last {statistic:.1f} sigma"),
    3: ("released", "all held integers released: residual test {statistic:.1f}, limit {limit:.1f}"),
    4: ("released", "all held integers released: length off by {statistic:.1f} sigma, limit {limit:g}"),
    5: ("held", "integer of {name} held too: {statistic:.4f} m from the nearest, limit {limit:.4f} m"),
    6: ("outlier", "phase of {name} excluded: the largest normalised residual, {statistic:.1f} sigma"),
}
"""Kinds of events of the compiled engine and their sentences."""


SAMPLE_EPOCHS = (30, 120)
SAMPLE_DOF = 1500.0
"""The variance factors come from so many epochs, or from as many as give this redundancy."""

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
        Numbers of each epoch, columns of `truenorth._kernels.engine`.
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


def select_phase_rows(differences):
    """Rows of the phases that integers are sought for, and their epoch offsets."""
    return _select_rows(differences, np.isfinite(differences.phase_m) & differences.integer_ok)


def _select_rows(differences, keep):
    """Rows to keep and their epoch offsets."""
    cumulative = np.concatenate(([0], np.cumsum(keep)))
    return np.flatnonzero(keep).astype(np.int64), cumulative[differences.start].astype(np.int64)


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


def resolve_epochs(differences, base, rover, settings, *, factors=None, state=None, progress=None):
    """Resolve the integers of every epoch: of a whole run, or of the next block of one.

    Parameters
    ----------
    differences : SingleDifferences
        The epochs.
    base, rover : Observations
        The raw observations, for their loss-of-lock flags.
    settings : GnssSettings
        Method, length, tests.
    factors : tuple of float, optional
        On the phase and code variances; by default as the settings say, from these epochs.
    state : ResolutionState, optional
        What is carried, updated in place; the results do not depend on how a run is cut into blocks.
        By default the run begins and ends here, as one that runs backward must.
    progress : callable, optional
        Called with (epochs done, epochs in all) from time to time.

    Returns
    -------
    ResolvedEpochs
    """
    if factors is None:
        factors = estimate_variance_factors(differences, settings)
    state = ResolutionState() if state is None else state
    if settings.method not in ("constrained", "lambda", "filter"):
        from .classical import resolve_classical

        return resolve_classical(differences, settings, factors, memory=state.classical, progress=progress)
    if settings.single_epoch:
        return _run_engine(differences, _no_arcs(differences), settings, factors)
    change = settings.length_m if settings.length_m is not None else UNKNOWN_LENGTH_CHANGE_M
    arcs = find_arcs(differences, base, rover, baseline_change_m=change, past=state.ends)
    if settings.direction == "combined":
        result = _combine(
            _run_engine(differences, arcs, settings, factors),
            _run_engine(differences, arcs, settings, factors, backward=True),
        )
    elif settings.direction == "backward":
        result = _run_engine(differences, arcs, settings, factors, backward=True)
    else:
        result = _run_engine(differences, arcs, settings, factors, state=state)
    result.events.extend(arcs.events)
    return result


def _no_arcs(differences):
    """Rows numbered by satellite and signal: identities for an engine that remembers nothing."""
    key = differences.sat.astype(np.int64) * 1000 + differences.signal
    _, arc = np.unique(key, return_inverse=True)
    return Arcs(arc.astype(np.int64), int(arc.max(initial=-1)) + 1, [])


def _run_engine(differences, arcs, settings, factors, *, backward=False, epochs=None, state=None):
    """One pass of the compiled engine over all epochs, or over the few of `epochs`."""
    from .._kernels import engine
    from .acceptance import chi2_limits

    d = differences
    keep_phase = np.isfinite(d.phase_m) & d.integer_ok
    keep_code = np.isfinite(d.code_m) & settings.use_code
    if epochs is not None:
        chosen = np.zeros(d.n_epochs, bool)
        chosen[epochs] = True
        chosen = chosen[d.epoch_of_row]
        keep_phase &= chosen
        keep_code &= chosen
    row, start = _select_rows(d, keep_phase)
    code_row, code_start = _select_rows(d, keep_code)
    n = d.n_epochs
    order = np.arange(n)
    if backward:
        order = order[::-1]
        turn, start = _reverse(start)
        row = row[turn]
        turn, code_start = _reverse(code_start)
        code_row = code_row[turn]
    arc = arcs.arc[row]
    # Whole cycles of phase minus code stay outside the engine, so its numbers are small.
    apart = np.nan_to_num((d.phase_m[row] - d.code_m[row]) / d.wavelength_m[row])
    carry = not settings.single_epoch and epochs is None
    widest = int(np.diff(start).max(initial=1))
    memory = (state or ResolutionState()).enter_block(
        arcs, int(d.time_ns[0]), max(arcs.n_arcs, 1), max(widest, int(np.diff(code_start).max(initial=1)))
    )
    if not carry:
        offset_row = np.rint(apart)
    else:
        first_arc, first_row = np.unique(arc, return_index=True)
        known = np.isfinite(memory.offset_cyc[first_arc])
        memory.offset_cyc[first_arc[~known]] = np.rint(apart[first_row[~known]])
        offset_row = memory.offset_cyc[arc]

    known = settings.length_m is not None and settings.length_use != "off"
    use_length = known and settings.length_use == "constrain" and settings.method != "lambda"
    prior_information, prior_rhs = _prior(settings)
    ratio_mode, ratio_limits = _ratio_limits(settings, widest + 1)
    table = np.empty((n, engine.N_COLUMNS))
    status, reason = np.zeros(n, np.uint8), np.zeros(n, np.uint8)
    residual, integer = np.empty(len(row)), np.empty(len(row))
    events, numbers = np.empty((20 * n + 100, 3), np.int64), np.empty((20 * n + 100, 2))
    n_events = engine.run_engine(
        (d.time_ns[order] - memory.origin_ns) / NS_PER_S, start,
        d.phase_m[row] - d.wavelength_m[row] * offset_row, d.design_enu[row], d.wavelength_m[row],
        factors[0] * d.phase_variance_m2[row], d.group[row], arc,
        code_start, d.code_m[code_row], d.design_enu[code_row],
        factors[1] * d.code_variance_m2[code_row], d.group[code_row], prior_information, prior_rhs,
        float(settings.length_m) if known else np.nan, float(settings.length_sd_m) ** 2, use_length,
        known and settings.length_use in ("constrain", "check"), float(settings.length_tolerance_sd),
        PSEUDO_WEIGHT, SEARCH_CAP_FACTOR, SEARCH_MARGIN, MAX_NODES,
        chi2_limits(settings.residual_significance, widest + 2),
        float(settings.success_probability), ratio_mode, ratio_limits, MAX_EXCLUSIONS,
        carry,
        carry and settings.method == "filter",
        float(settings.stochastic.correlation_s), float(settings.stochastic.memory_epochs),
        settings.min_epochs_to_fix, _change_sd_mps(settings),
        memory.memory, memory.vector, memory.slot_arc, memory.arc_number, memory.arc_value, memory.carried,
        residual, integer, table, status, reason, events, numbers,
    )  # fmt: skip
    # Whole cycles put back, and integers counted from the reference of their group.
    integer += offset_row
    epoch_of = np.repeat(np.arange(n), np.diff(start))
    reference = group_references(epoch_of, d.group[row], integer)
    integer -= integer[reference]

    log = []
    for k in range(n_events):
        at = int(events[k, 1])
        name, tracking = "", ""
        if at >= 0:
            name, tracking = sat_name(int(d.sat[row[at]])), signal_name(int(d.signal[row[at]]))
        kind, text = ENGINE_EVENTS[int(events[k, 2])]
        statistic, limit = float(numbers[k, 0]), float(numbers[k, 1])
        text = text.format(name=f"{name} {tracking}", statistic=statistic, limit=limit)
        log.append((int(d.time_ns[order[events[k, 0]]]), kind, name, tracking, statistic, limit, text))
    if backward:
        table, status, reason = table[::-1].copy(), status[::-1].copy(), reason[::-1].copy()
        turn, start = _reverse(start)
        row, residual, integer = row[turn], residual[turn], integer[turn]
    reason[~d.has_position] = Reason.NO_POSITION
    status[~d.has_position] = Status.NONE
    return ResolvedEpochs(table, status, reason, row, start, residual, integer, factors, log)


def group_references(epoch, group, integer):
    """Row of the reference satellite of each row: the first of its group that took part.

    Parameters
    ----------
    epoch, group : ndarray of int, shape (m,)
        Rows of one group of one epoch are neighbours.
    integer : ndarray, shape (m,)
        Integers of the rows, NaN where a row did not take part.

    Returns
    -------
    ndarray of int64, shape (m,)
        The group's first row where none took part.
    """
    head = np.ones(len(epoch), bool)
    head[1:] = (epoch[1:] != epoch[:-1]) | (group[1:] != group[:-1])
    segment = np.cumsum(head) - 1
    first = np.flatnonzero(head)
    present = np.flatnonzero(np.isfinite(integer))[::-1]
    first[segment[present]] = present
    return first[segment]


def _ratio_limits(settings, n_limits):
    """Mode of the ratio test and its limits by the number of double differences."""
    limits = np.full(n_limits, float(settings.ratio_threshold))
    if settings.ratio_test == "fixed_failure_rate":
        from .acceptance import tabulated_ratio_threshold

        # Without the model's own failure rate the table's weakest acceptable column stands.
        limits = np.array(
            [tabulated_ratio_threshold(max(n, 2), 0.1, settings.failure_rate) for n in range(n_limits)]
        )
    return {"none": 0, "fixed": 1, "fixed_failure_rate": 1, "difference": 2}[settings.ratio_test], limits


def _change_sd_mps(settings):
    """How far the baseline may turn in a second, metres; NaN where it is free."""
    if settings.rotation_rate_sd_dps is None or settings.length_m is None:
        return np.nan
    return float(np.radians(settings.rotation_rate_sd_dps) * settings.length_m)


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
    from .._kernels import engine as columns

    accepted_f = forward.status >= Status.HELD
    accepted_b = backward.status >= Status.HELD
    take_b = accepted_b & ~accepted_f
    more = np.nan_to_num(backward.table[:, columns.N_PHASES]) > np.nan_to_num(
        forward.table[:, columns.N_PHASES]
    )
    take_b |= accepted_b & accepted_f & more
    gap = np.linalg.norm(
        forward.table[:, columns.BX : columns.BZ + 1] - backward.table[:, columns.BX : columns.BZ + 1], axis=1
    )
    variances = slice(columns.COV, columns.COV + 3)
    sd = np.sqrt(np.sum(forward.table[:, variances] + backward.table[:, variances], axis=1))
    clash = accepted_f & accepted_b & (gap > DISAGREEMENT_M) & (gap > DISAGREEMENT_SD * sd)
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


def resolve_sample(differences, settings, sample=None):
    """Resolve a sample of epochs, each by itself, with the noise that they show.

    Parameters
    ----------
    differences : SingleDifferences
        All epochs.
    settings : GnssSettings
        Of an engine method.
    sample : ndarray of int, optional
        Indices of the epochs; by default they are spread over the run.

    Returns
    -------
    resolved : ResolvedEpochs
        Only the rows of the sample are filled.
    sample : ndarray of int
        Epoch indices.
    """
    d = differences
    sample = _sample_epochs(d) if sample is None else sample
    factors = estimate_variance_factors(d, settings, sample)
    return _run_engine(d, _no_arcs(d), settings, factors, epochs=sample), sample


def _sample_epochs(differences):
    """Indices of epochs spread over the run, enough for `SAMPLE_DOF`."""
    d = differences
    dof_of_epoch = max(len(d.sat) / max(d.n_epochs, 1) - 4.0, 1.0)
    size = min(d.n_epochs, int(np.clip(SAMPLE_DOF / dof_of_epoch, *SAMPLE_EPOCHS)))
    return np.unique(np.linspace(0, d.n_epochs - 1, size).astype(int))


def estimate_variance_factors(differences, settings, sample=None):
    """Robust variance factors of phases and codes from the winners of a sample of epochs.

    The medians over the epochs of the winners' chi-square over its expectation: wrong winners of the
    worst epochs do not move them. A prior of a few degrees of freedom at 1 keeps short runs sane.

    Parameters
    ----------
    differences : SingleDifferences
        All epochs.
    settings : GnssSettings
        Of the run; where it takes the noise as declared, the factors are 1.
    sample : ndarray of int, optional
        Indices of the epochs; by default they are spread over the run.

    Returns
    -------
    tuple of float
        Of the variances of phases and codes.
    """
    from .._kernels import engine as kernel

    if not settings.stochastic.estimate:
        return 1.0, 1.0
    d = differences
    sample = _sample_epochs(d) if sample is None else sample
    resolved = _run_engine(d, _no_arcs(d), settings, (1.0, 1.0), epochs=sample)
    chi2 = resolved.table[sample, kernel.CHI2]
    dof = resolved.table[sample, kernel.CHI2_DOF]
    phase = median_factor(chi2, dof)

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
    return phase, median_factor(code_chi2, code_dof)


def median_factor(chi2, dof):
    """Variance factor from chi-squares by their median; its logarithm shrinks towards 0 with `PRIOR_DOF`.

    Parameters
    ----------
    chi2, dof : ndarray, shape (n,)
        Weighted square sums and their degrees of freedom; NaN and 0 where there is none.

    Returns
    -------
    float
    """
    good = np.isfinite(chi2) & (dof > 0)
    if not good.any():
        return 1.0
    # Median of chi-square by Wilson and Hilferty.
    expected = dof[good] * (1.0 - 2.0 / (9.0 * dof[good])) ** 3
    n = dof[good].sum()
    factor = max(float(np.median(chi2[good] / expected)), 1e-6)
    return factor ** (n / (n + PRIOR_DOF))
