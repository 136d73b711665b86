"""A recording thinned to a lower update rate, as a receiver of that rate would have given it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import ConfigError, NoSolutionError
from ..observations import LLI_SLIP, Observations
from ..timescales import NS_PER_S

__all__ = ["decimate", "median_interval_ns", "point_spacing_m"]


def point_spacing_m(speed_mps: float | np.ndarray, rate_hz: float | np.ndarray) -> Any:
    """Distance between points along the route.

    Parameters
    ----------
    speed_mps : float or ndarray
        Of the platform.
    rate_hz : float or ndarray
        Update rate.

    Returns
    -------
    float or ndarray
        Metres.

    Examples
    --------
    >>> round(point_spacing_m(60.0 / 3.6, 20.0), 2)
    0.83
    """
    return speed_mps / rate_hz


def decimate(observations: Observations, rate_hz: float, *, start_ns: int | None = None) -> Observations:
    """Keep the epochs that a receiver of a lower rate would have given.

    Parameters
    ----------
    observations : Observations
        The full recording.
    rate_hz : float
        Epochs in a second that remain.
    start_ns : int, optional
        An instant of the grid; by default whole seconds of GPS time.

    Returns
    -------
    Observations
        With every loss of lock since the last epoch that was kept.

    Raises
    ------
    ConfigError
        If the recording has not that many epochs in a second.
    """
    if not rate_hz > 0.0 or not np.isfinite(rate_hz):
        raise ConfigError(f"`rates` holds {rate_hz!r}; give positive rates in hertz", key="rates")
    time_ns = observations.time_ns
    if len(time_ns) < 2:
        raise NoSolutionError("could not thin the recording: it has fewer than two epochs")
    own_ns = median_interval_ns(time_ns)
    step_ns = NS_PER_S / rate_hz
    if step_ns < 0.99 * own_ns:
        raise ConfigError(
            f"`rates` holds {rate_hz:g} Hz, but the recording has {NS_PER_S / own_ns:g} Hz; give no more",
            key="rates",
            value=rate_hz,
        )
    if abs(step_ns - own_ns) < 0.01 * own_ns:
        return observations
    origin = int(start_ns) if start_ns is not None else int(time_ns[0]) // NS_PER_S * NS_PER_S
    slot = np.rint((time_ns - origin) / step_ns).astype(np.int64)
    off_ns = np.abs(time_ns - origin - slot * step_ns)
    near = np.flatnonzero(off_ns <= 0.5 * own_ns + 1.0)
    # One epoch a slot, the nearest.
    order = near[np.lexsort((off_ns[near], slot[near]))]
    _, first = np.unique(slot[order], return_index=True)
    keep = np.zeros(len(time_ns), dtype=bool)
    keep[order[first]] = True
    return _with_slips_between(observations, keep).select_epochs(keep)


def _with_slips_between(observations: Observations, keep: np.ndarray) -> Observations:
    """Flag the kept rows whose signal lost lock in an epoch that goes."""
    channel = observations.sat.astype(np.int64) * 1000 + observations.signal
    order = np.lexsort((np.arange(len(channel)), channel))
    slipped = (observations.lli[order] & LLI_SLIP) > 0
    kept = keep[observations.epoch_of_row][order]
    # Slips up to each row less those up to the kept row before it, within the same signal.
    count = np.cumsum(slipped)
    chosen = np.flatnonzero(kept)
    before = np.zeros(len(chosen), dtype=np.int64)
    same = np.zeros(len(chosen), dtype=bool)
    same[1:] = channel[order][chosen[1:]] == channel[order][chosen[:-1]]
    before[1:] = count[chosen[:-1]]
    lost = np.where(same, count[chosen] > before, slipped[chosen])
    lli = observations.lli.copy()
    lli[order[chosen[lost]]] |= LLI_SLIP
    return replace(observations, lli=lli)


def median_interval_ns(time_ns: np.ndarray) -> int:
    """Usual time between epochs, nanoseconds; a second for a single one."""
    return int(np.median(np.diff(time_ns))) if len(time_ns) > 1 else NS_PER_S
