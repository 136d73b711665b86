r"""Time laws: how far along a route, or about an axis, at an instant.

A planned law is made in two steps. First the fastest motion within limits of speed and acceleration, stops
included: with the square of the speed as unknown both limits are linear in the way, and the two sweeps of the
classical planner (forward with the acceleration, backward with the deceleration) become running minima

.. math:: v^2(s) = \min_{s'} \left( v_{max}^2(s') + 2a\,|s-s'| \right).

Then its samples at even instants become the control points of a quintic B-spline. That is a smoothing by a
positive kernel (standard deviation 0.7 steps): speed and acceleration keep their limits, straight lines and
stops stay exact, and all derivatives up to the fourth are continuous, so that there is no step in
acceleration nor in jerk.

References
----------
Bobrow, J. E., Dubowsky, S., Gibson, J. S., "Time-optimal control of robotic manipulators along specified
paths", Int. J. Robotics Research 4 (1985) 3-17.
de Boor, C., A Practical Guide to Splines (1978), ch. IX to XI.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

__all__ = ["Law", "SplineLaw", "UniformLaw", "fastest_times", "sample_passage", "uniform_spline"]

PAD_S = 10.0
"""How far laws reach before the start and after the end."""


def uniform_spline(start: float, step: float, controls: np.ndarray) -> BSpline:
    """Quintic B-spline with even knots whose control points belong to the instants start + k step.

    Parameters
    ----------
    start, step : float
        Argument of the first control point, and from one to the next.
    controls : ndarray, shape (n, ...)
        Control points, n >= 6.

    Returns
    -------
    scipy.interpolate.BSpline
        Defined from ``start + 2 step`` to ``start + (n - 3) step``. It is the control points' own average by
        a positive kernel: linear sequences come back exactly.
    """
    from scipy.interpolate import BSpline

    knots = start + step * np.arange(-3.0, len(controls) + 3.0)
    return BSpline(knots, np.ascontiguousarray(controls, dtype=float), 5)


class Law(Protocol):
    """A smooth function of time."""

    def derivatives(self, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Value and first three derivatives at instants, each of shape (n,)."""
        ...


class UniformLaw:
    """Constant rate.

    Parameters
    ----------
    rate : float
        Per second.
    start : float
        Value at instant 0.
    """

    def __init__(self, rate: float, start: float = 0.0) -> None:
        self.rate, self.start = float(rate), float(start)

    def derivatives(self, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Value and first three derivatives at instants, each of shape (n,)."""
        zero = np.zeros(len(time_s))
        return self.start + self.rate * time_s, zero + self.rate, zero, zero


class SplineLaw:
    """A law of sampled values, smoothed.

    Parameters
    ----------
    start_s, step_s : float
        Instant of the first sample and distance of the samples.
    samples : ndarray, shape (n,)
        Control points. Beyond the ends the law goes on evenly.
    """

    def __init__(self, start_s: float, step_s: float, samples: np.ndarray) -> None:
        # Even continuation for the reach of a law, and for the support of the kernel.
        n_pad = 4 + int(np.ceil(PAD_S / step_s))
        count = np.arange(1, n_pad + 1)
        first = samples[0] - (samples[1] - samples[0]) * count[::-1]
        last = samples[-1] + (samples[-1] - samples[-2]) * count
        spline = uniform_spline(start_s - n_pad * step_s, step_s, np.concatenate([first, samples, last]))
        self._splines = [spline, *(spline.derivative(order) for order in (1, 2, 3))]

    @classmethod
    def from_rates(
        cls, instants_s: ArrayLike, rates: ArrayLike, *, duration_s: float, ramp_s: float
    ) -> SplineLaw:
        """Integral of rates that hold from one instant to the next; the first holds before as well.

        Parameters
        ----------
        instants_s : ndarray, shape (k,)
            When each rate begins, ascending.
        rates : ndarray, shape (k,)
            Rates.
        duration_s : float
            Until when the law is needed.
        ramp_s : float
            Duration of a change of rate (95 % of it).

        Returns
        -------
        SplineLaw
            Zero at instant 0, but for the smoothing.
        """
        # The kernel's central 95 % are 2 * 1.96 * 0.7 steps.
        step = ramp_s / 2.8
        times = np.arange(-2, np.ceil(duration_s / step) + 3) * step
        instants_s = np.asarray(instants_s, dtype=float)
        first, last = min(times[0], instants_s[0]) - 1.0, max(times[-1], instants_s[-1]) + 1.0
        edges = np.concatenate([[first], instants_s[1:], [last]])
        total = np.concatenate([[0.0], np.cumsum(np.diff(edges) * rates)])
        return cls(times[0], step, np.interp(times, edges, total) - np.interp(0.0, edges, total))

    def derivatives(self, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Value and first three derivatives at instants, each of shape (n,)."""
        value, first, second, third = (spline(time_s) for spline in self._splines)
        return value, first, second, third


def fastest_times(
    way_m: np.ndarray,
    speed_limit_mps: np.ndarray,
    acceleration_mps2: float,
    deceleration_mps2: float,
    stops: Sequence[tuple[int, float]] = (),
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fastest passage of points of a route within limits.

    Parameters
    ----------
    way_m : ndarray, shape (n,)
        Distance along the route, ascending.
    speed_limit_mps : ndarray, shape (n,)
        Highest speed at each point; 0 for a point where the motion begins, ends or halts.
    acceleration_mps2, deceleration_mps2 : float
        Limits, positive.
    stops : sequence of (int, float)
        Points to halt at, and for how many seconds.

    Returns
    -------
    arrival_s, departure_s, speed_mps : ndarray, shape (n,)
        When each point is reached and left, from 0 on, and the speed there. They differ at stops only.
    """
    limit2 = np.asarray(speed_limit_mps, dtype=float) ** 2
    halt = np.zeros(len(way_m))
    for index, duration in stops:
        limit2[index] = 0.0
        halt[index] += duration
    run_up, run_out = 2.0 * acceleration_mps2 * way_m, 2.0 * deceleration_mps2 * way_m
    forward = np.minimum.accumulate(limit2 - run_up) + run_up
    both = np.minimum.accumulate((forward + run_out)[::-1])[::-1] - run_out
    speed = np.sqrt(np.maximum(both, 0.0))
    speed[limit2 == 0.0] = 0.0
    passage = 2.0 * np.diff(way_m) / (speed[:-1] + speed[1:])
    elapsed = np.concatenate([[0.0], np.cumsum(passage)])
    departure = elapsed + np.cumsum(halt)
    return departure - halt, departure, speed


def sample_passage(
    time_s: np.ndarray,
    way_m: np.ndarray,
    arrival_s: np.ndarray,
    departure_s: np.ndarray,
    speed_mps: np.ndarray,
) -> np.ndarray:
    """Way at instants of a passage with constant acceleration from point to point.

    Parameters
    ----------
    time_s : ndarray, shape (m,)
        Instants; before the first departure and after the last arrival the ends are held.
    way_m, arrival_s, departure_s, speed_mps : ndarray, shape (n,)
        As `fastest_times` gives.

    Returns
    -------
    ndarray, shape (m,)
        Distance along the route.
    """
    k = np.clip(np.searchsorted(departure_s, time_s, side="right") - 1, 0, len(way_m) - 2)
    duration = arrival_s[k + 1] - departure_s[k]
    elapsed = np.clip(time_s - departure_s[k], 0.0, duration)
    gain = (speed_mps[k + 1] - speed_mps[k]) / duration
    return np.minimum(way_m[k] + elapsed * (speed_mps[k] + 0.5 * gain * elapsed), way_m[k + 1])
