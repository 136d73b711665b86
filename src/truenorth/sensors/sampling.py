"""When a sensor samples, what clock stamps the samples, and how numbers become counts."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import msgspec
import numpy as np

from ..timescales import NS_PER_S
from .checks import require_not_negative, require_positive

__all__ = [
    "GeneratorByName",
    "SampledSensor",
    "blocks",
    "quantise",
    "sample_times_s",
    "stamp_times",
    "table_at",
]

GeneratorByName = Callable[..., np.random.Generator]
"""``generator("noise")`` gives the random generator of one purpose, the same whatever else is drawn.

``functools.partial(truenorth.simulation.randomness.stream, seed)`` is one.
"""


class SampledSensor(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What all sensors have: a rate and a clock that stamps their samples."""

    rate_hz: float = 10.0
    """Samples per second."""
    phase_s: float = 0.0
    """Delay of all samples against whole multiples of the sample interval, seconds."""
    latency_s: float = 0.0
    """From the instant (the end of the interval) a sample belongs to until it is stamped, seconds."""
    time_tag_step_s: float = 0.0
    """Step of the clock that stamps: stamps are floored to it. 0: exact stamps.
    A PC of the 1990s counts 65536 / 1193182 s, the 55 ms of Harvey (1998)."""

    def __post_init__(self) -> None:
        require_positive(self, "rate_hz")
        require_not_negative(self, "phase_s", "latency_s", "time_tag_step_s")


def sample_times_s(sensor: SampledSensor, duration_s: float) -> np.ndarray:
    """Ends of the sample intervals that fit into a record, with the start of the first.

    Parameters
    ----------
    sensor : SampledSensor
        Gives rate and phase.
    duration_s : float
        Length of the record, seconds.

    Returns
    -------
    ndarray, shape (n + 1,)
        Seconds since the start: the samples belong to the last n; the first begins their interval.
    """
    # A duration that is a whole number of intervals has its last sample, whatever the rounding.
    n = max(0, int((duration_s - sensor.phase_s) * sensor.rate_hz + 1e-6))
    return sensor.phase_s + np.arange(n + 1) / sensor.rate_hz


def stamp_times(
    sensor: SampledSensor, time_s: np.ndarray, start_ns: int, generator: GeneratorByName
) -> tuple[np.ndarray, np.ndarray]:
    """True times of samples, and the times that the logging clock gives them.

    Parameters
    ----------
    sensor : SampledSensor
        Gives latency and step of the clock.
    time_s : ndarray, shape (n,)
        Instants of the samples, seconds since the start.
    start_ns : int
        GPS time of the start, nanoseconds.
    generator : callable
        Random generators by name; the clock's ticks fall at a random phase.

    Returns
    -------
    true_ns, stamped_ns : ndarray of int64, shape (n,)
    """
    true_ns = start_ns + np.rint(np.asarray(time_s) * NS_PER_S).astype(np.int64)
    stamped_ns = true_ns + round(sensor.latency_s * NS_PER_S)
    step_ns = round(sensor.time_tag_step_s * NS_PER_S)
    if step_ns > 0:
        tick_ns = start_ns + int(generator("clock_phase").integers(step_ns))
        stamped_ns = tick_ns + (stamped_ns - tick_ns) // step_ns * step_ns
    return true_ns, stamped_ns


def quantise(value: np.ndarray, step: float) -> np.ndarray:
    """Round to whole steps; 0 leaves the value as it is."""
    return np.rint(value / step) * step if step > 0.0 else np.asarray(value)


def table_at(table: tuple[tuple[float, float], ...], argument: np.ndarray) -> np.ndarray:
    """Value of a table of (argument, value) pairs: linear between the rows, constant outside."""
    arguments, values = zip(*table, strict=True)
    return np.interp(argument, arguments, values)


def blocks(n: int, size: int = 20_000) -> Iterator[slice]:
    """Slices that cover n samples, so that a long record asks for its motion in parts."""
    for first in range(0, n, size):
        yield slice(first, min(n, first + size))
