"""Cycle slips, and the arcs of continuous phase between them.

An arc ends where either receiver flags loss of lock (also at epochs that the other does not have),
where the single difference is missing for longer than `MAX_GAP_S`, and where the phase jumped: by the
time-differenced single differences with the baseline known short, by the geometry-free combination of
two bands, or, with few satellites, by the Doppler prediction (Harvey 1998, sec. 3.5; Wang &
Lachapelle 2002). Every decision carries its statistic and limit.
"""

from dataclasses import dataclass

import numpy as np

from ..observations import LLI_SLIP, sat_name, signal_name
from ..timescales import NS_PER_S

__all__ = ["Arcs", "find_arcs"]

MAX_GAP_S = 30.0
"""A phase that is missing for longer starts a new arc."""

LIMIT_SD = 8.0
"""Jumps beyond this many standard deviations (and a quarter of a cycle) are slips."""

KINDS = {
    1: "time-differenced phase",
    2: "geometry-free combination",
    3: "Doppler prediction",
    4: "loss-of-lock flag",
}


@dataclass(frozen=True, slots=True, eq=False)
class Arcs:
    """Continuous arcs of the single-difference phases.

    Parameters
    ----------
    arc : ndarray of int64, shape (n_rows,)
        Arc of each row; -1 for rows without a phase.
    n_arcs : int
        Number of arcs.
    events : list of tuple
        (time_ns, kind, satellite, signal, statistic, limit, text) of every slip.
    """

    arc: np.ndarray
    n_arcs: int
    events: list


def _lock_losses(observations):
    """Running count of loss-of-lock flags of each signal, shape (n_rows,)."""
    key = observations.sat.astype(np.int64) * 1000 + observations.signal
    order = np.argsort(key, kind="stable")
    flag = (observations.lli[order] & LLI_SLIP > 0).astype(np.int64)
    count = np.empty(len(key), np.int64)
    count[order] = np.cumsum(flag)
    return count


def find_arcs(differences, base, rover, *, baseline_change_m):
    """Find the arcs of all single-difference phases.

    Parameters
    ----------
    differences : SingleDifferences
        Of the pair.
    base, rover : Observations
        The raw observations, whose flags at unmatched epochs count too.
    baseline_change_m : float
        How far the baseline may move from one epoch to the next, one sigma.

    Returns
    -------
    Arcs
    """
    from .._kernels.slips import detect_slips

    d = differences
    valid = np.flatnonzero(np.isfinite(d.phase_m))
    epoch = d.epoch_of_row[valid]
    time = d.time_ns[epoch]
    signal = d.sat[valid].astype(np.int64) * 1000 + d.signal[valid]
    order = np.lexsort((epoch, signal))
    same = np.zeros(len(order), bool)
    same[1:] = signal[order][1:] == signal[order][:-1]
    gap = np.zeros(len(order))
    gap[1:] = np.diff(time[order]) / NS_PER_S
    linked = same & (gap <= MAX_GAP_S)

    losses = _lock_losses(base)[d.base_row[valid]] + _lock_losses(rover)[d.rover_row[valid]]
    flagged = np.zeros(len(order), bool)
    flagged[1:] = linked[1:] & (np.diff(losses[order]) != 0)
    flags = flagged.copy()

    previous = np.full(len(d.phase_m), -1, np.int64)
    dt = np.zeros(len(d.phase_m))
    use = linked & ~flagged
    rows = valid[order]
    at = np.flatnonzero(use)
    previous[rows[at]] = rows[at - 1]
    dt[rows[at]] = gap[at]
    slip = np.zeros(len(d.phase_m), np.int64)
    statistic = np.full(len(d.phase_m), np.nan)
    limit = np.full(len(d.phase_m), np.nan)
    detect_slips(
        d.start, d.phase_m, d.design_enu, d.phase_variance_m2, d.wavelength_m, d.sat.astype(np.int64),
        previous, d.doppler_mps, dt, float(baseline_change_m), LIMIT_SD, slip, statistic, limit,
    )  # fmt: skip
    begins = ~linked | flags | (slip[rows] > 0)
    arc = np.full(len(d.phase_m), -1, np.int64)
    arc[rows] = np.cumsum(begins) - 1

    events = []
    slipped = rows[linked & (flags | (slip[rows] > 0))]
    from_flag = np.zeros(len(d.phase_m), bool)
    from_flag[rows[flags]] = True
    for row in np.sort(slipped):
        kind = KINDS[4] if from_flag[row] else KINDS[int(slip[row])]
        name, tracking = sat_name(int(d.sat[row])), signal_name(int(d.signal[row]))
        text = f"cycle slip of {name} {tracking} by the {kind}"
        if not from_flag[row]:
            text += f": {statistic[row]:+.3f} m, limit {limit[row]:.3f} m"
        time_ns = int(d.time_ns[np.searchsorted(d.start, row, side="right") - 1])
        events.append((time_ns, "slip", name, tracking, float(statistic[row]), float(limit[row]), text))
    return Arcs(arc, int(np.sum(begins)), events)
