"""Cycle slips, and the arcs of continuous phase between them.

An arc ends where either receiver flags loss of lock (also at epochs that the other does not have),
where the single difference is missing for longer than `MAX_GAP_S`, and where the phase jumped: by the
time-differenced single differences with the baseline known short, by the geometry-free combination of
two bands, or, with few satellites, by the Doppler prediction (Harvey 1998, sec. 3.5; Wang &
Lachapelle 2002). Every decision carries its statistic and limit.
"""

from dataclasses import dataclass, field

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
class ArcEnds:
    """What a block of epochs leaves for the next one: the last row of every arc that may go on.

    Parameters
    ----------
    arc : ndarray of int64, shape (k,)
        Arc of each row, in the numbering of its block.
    key, base_key, rover_key : ndarray of int64, shape (k,)
        Satellite and signal: of the difference, in the base's and in the rover's observations.
    time_ns : ndarray of int64, shape (k,)
        Its epoch.
    losses : ndarray of int64, shape (k,)
        Minus the loss-of-lock flags of both receivers between it and the end of the block.
    phase_m, phase_variance_m2, wavelength_m, doppler_mps : ndarray, shape (k,)
        Of the single difference.
    design_enu : ndarray, shape (k, 3)
        Likewise.
    moved : ndarray, shape (k + 1, 4)
        Change of baseline and clock from the first epoch of the run to each row's, and to the last epoch.
    """

    arc: np.ndarray
    key: np.ndarray
    base_key: np.ndarray
    rover_key: np.ndarray
    time_ns: np.ndarray
    losses: np.ndarray
    phase_m: np.ndarray
    phase_variance_m2: np.ndarray
    wavelength_m: np.ndarray
    doppler_mps: np.ndarray
    design_enu: np.ndarray
    moved: np.ndarray


_NUMBER, _METRES = np.empty(0, np.int64), np.empty(0)
NO_ARCS = ArcEnds(*[_NUMBER] * 6, *[_METRES] * 4, np.empty((0, 3)), np.zeros((1, 4)))
"""Before the first epoch of a run."""


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
    resumed : ndarray of int64, shape (k,)
        Numbers that the arcs of the block before have now, in the order of its `ArcEnds`.
    ends : ArcEnds
        For the next block.
    """

    arc: np.ndarray
    n_arcs: int
    events: list
    resumed: np.ndarray = field(default_factory=lambda: _NUMBER)
    ends: ArcEnds = NO_ARCS


def _signal_key(of, row=slice(None)):
    return of.sat[row].astype(np.int64) * 1000 + of.signal[row]


def _count_losses(observations, key, row):
    """Loss-of-lock flags of the signals `key` up to and with the rows `row`."""
    n = len(observations.sat)
    flagged = np.flatnonzero(observations.lli & LLI_SLIP)
    place = np.sort(_signal_key(observations, flagged) * n + flagged)
    return np.searchsorted(place, key * n + row, side="right") - np.searchsorted(place, key * n)


def find_arcs(differences, base, rover, *, baseline_change_m, past=NO_ARCS):
    """Find the arcs of all single-difference phases.

    Parameters
    ----------
    differences : SingleDifferences
        Of the pair.
    base, rover : Observations
        The raw observations, whose flags at unmatched epochs count too.
    baseline_change_m : float
        How far the baseline may move from one epoch to the next, one sigma.
    past : ArcEnds, optional
        Of the block of epochs before; the arcs and their numbers are then those of one run.

    Returns
    -------
    Arcs
    """
    from .._kernels.slips import detect_slips

    d = differences
    # The last rows of the past come first, each as an epoch of its own, then an empty epoch: the last one.
    n_past = len(past.key)
    valid = np.flatnonzero(np.isfinite(d.phase_m))
    epoch_of_row = np.concatenate((np.arange(n_past), d.epoch_of_row + n_past + 1))
    key = np.concatenate((past.key, _signal_key(d)))
    time_ns = np.concatenate((past.time_ns, d.time_ns[d.epoch_of_row]))
    base_key = np.concatenate((past.base_key, _signal_key(base, d.base_row)))
    rover_key = np.concatenate((past.rover_key, _signal_key(rover, d.rover_row)))
    losses = _count_losses(base, base_key[n_past:], d.base_row)
    losses += _count_losses(rover, rover_key[n_past:], d.rover_row)
    losses = np.concatenate((past.losses, losses))
    columns = ("phase_m", "phase_variance_m2", "wavelength_m", "doppler_mps", "design_enu")
    phase, variance, wavelength, doppler, design = (
        np.concatenate((getattr(past, name), getattr(d, name))) for name in columns
    )
    valid = np.concatenate((np.arange(n_past), valid + n_past))
    rows = valid[np.lexsort((epoch_of_row[valid], key[valid]))]
    same = np.zeros(len(rows), bool)
    same[1:] = key[rows][1:] == key[rows][:-1]
    gap = np.zeros(len(rows))
    gap[1:] = np.diff(time_ns[rows]) / NS_PER_S
    linked = same & (gap <= MAX_GAP_S)
    flags = np.zeros(len(rows), bool)
    flags[1:] = linked[1:] & (np.diff(losses[rows]) != 0)

    n = len(phase)
    previous = np.full(n, -1, np.int64)
    dt = np.zeros(n)
    at = np.flatnonzero(linked & ~flags)
    previous[rows[at]] = rows[at - 1]
    dt[rows[at]] = gap[at]
    slip = np.zeros(n, np.int64)
    statistic, limit = np.full(n, np.nan), np.full(n, np.nan)
    start = np.concatenate((np.arange(n_past + 1), d.start + n_past))
    moved = np.concatenate((past.moved, np.empty((d.n_epochs, 4))))
    detect_slips(
        n_past + 1, start, phase, design, variance, wavelength, key // 1000, previous, doppler, dt,
        float(baseline_change_m), LIMIT_SD, moved, slip, statistic, limit,
    )  # fmt: skip
    begins = ~linked | flags | (slip[rows] > 0)
    arc = np.full(n, -1, np.int64)
    arc[rows] = np.cumsum(begins) - 1

    # Last rows of their signals, as far as the next epoch may still continue them.
    last = rows[np.append(~same[1:], True)] if len(rows) else rows
    last = last[d.time_ns[-1] - time_ns[last] <= MAX_GAP_S * NS_PER_S]
    to_come = _count_losses(base, base_key[last], base.n_rows - 1)
    to_come += _count_losses(rover, rover_key[last], rover.n_rows - 1)
    ends = ArcEnds(
        arc[last], key[last], base_key[last], rover_key[last], time_ns[last], losses[last] - to_come,
        phase[last], variance[last], wavelength[last], doppler[last], design[last],
        np.concatenate((moved[epoch_of_row[last]], moved[-1:])),
    )  # fmt: skip

    events = []
    slipped = rows[linked & (flags | (slip[rows] > 0))]
    from_flag = np.zeros(n, bool)
    from_flag[rows[flags]] = True
    for row in np.sort(slipped):
        kind = KINDS[4] if from_flag[row] else KINDS[int(slip[row])]
        sat, signal = divmod(int(key[row]), 1000)
        name, tracking = sat_name(sat), signal_name(signal)
        text = f"cycle slip of {name} {tracking} by the {kind}"
        if not from_flag[row]:
            text += f": {statistic[row]:+.3f} m, limit {limit[row]:.3f} m"
        numbers = float(statistic[row]), float(limit[row])
        events.append((int(time_ns[row]), "slip", name, tracking, *numbers, text))
    return Arcs(arc[n_past:], int(np.sum(begins)), events, arc[:n_past], ends)
