"""Motion of the platform in an Allan variance: where it shows, and what remains without it.

See `truenorth.sensors.allan` for what is done and the references.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..strapdown import InertialIncrements
from .allan_fit import TERMS, TOLERANCE, Kind, ceiling_of, edf_of_noise, noise_basis

__all__ = ["Levelled", "find_hump", "level_axes"]


def find_hump(tau_s: np.ndarray, variance: np.ndarray, edf: np.ndarray) -> tuple[np.ndarray, str | None]:
    """Where a curve stands above its lower convex hull, which no sum of noises does."""
    from scipy.stats import chi2

    x = np.log(tau_s)
    low, high = (np.log(variance * edf / chi2.ppf(tail, edf)) for tail in (0.9999, 0.0001))
    hull: list[int] = []
    for k in range(len(x)):
        while len(hull) > 1 and (high[hull[-1]] - high[hull[-2]]) * (x[k] - x[hull[-1]]) >= (
            high[k] - high[hull[-1]]
        ) * (x[hull[-1]] - x[hull[-2]]):
            hull.pop()
        hull.append(k)
    excess = low - np.interp(x, x[hull], high[hull]) - np.log(1.0 + 2.0 * TOLERANCE)
    affected = excess > 0.0
    if not np.any(affected):
        return affected, None
    first, last = tau_s[affected][[0, -1]]
    # A sinusoid is seen most at 0.371 of its period.
    peak_s = tau_s[int(np.argmax(excess))]
    return affected, (
        f"between {first:.2g} and {last:.2g} s the curve has a hump that noise cannot have, as of a swing of "
        f"about {0.371 / peak_s:.2g} Hz"
    )


@dataclass(frozen=True, slots=True, eq=False)
class Levelled:
    """Deviation of one axis without the rotation that gyros and accelerometers share."""

    tau_s: np.ndarray
    deviation: np.ndarray
    squares: np.ndarray
    """Upper bounds of the squared coefficients; infinite where it says nothing."""
    first_s: float
    """From this averaging time on most of the curve was rotation."""


_Case = tuple[Kind, Callable[..., Any], np.ndarray, np.ndarray, bool, int, tuple[float, ...]]
"""Kind, estimator, phase with and without rotation; of its degrees of freedom; shares of the noises."""


def level_axes(increments: InertialIncrements, interval_s: float) -> dict[tuple[str, int], Levelled]:
    """Axes across gravity in which the platform's rotation shows, freed of it."""
    import allantools

    block = max(1, round(1.0 / interval_s))
    n = len(increments.angle_rad) // block
    if n < 64:
        return {}
    step_s = block * interval_s
    rate = increments.angle_rad - increments.angle_rad.mean(axis=0)
    angle, force = (
        values[: n * block].reshape(n, block, 3).mean(axis=1)
        for values in (np.cumsum(rate, axis=0), increments.velocity_mps / interval_s)
    )
    mean = force.mean(axis=0)
    change = force - mean
    # A body that turns by a small angle sees a fixed force turn by minus that angle.
    turn = np.cross(change, mean) / (mean @ mean)
    apart = change + np.cross(angle, mean)
    upright = np.abs(mean) / np.linalg.norm(mean)
    found: dict[tuple[str, int], Levelled] = {}
    samples = 2 ** np.arange(0, int(np.log2(n / 4.0)) + 1)
    taus = samples * step_s
    early = taus <= 0.1 * n * step_s
    for k in np.flatnonzero(upright < 0.5):
        cases: tuple[_Case, ...] = (
            (
                "gyro",
                allantools.mdev,
                angle[:, k],
                angle[:, k] - turn[:, k],
                True,
                2,
                (0.5, 0.675, 0.55, 1.0),
            ),
            (
                "accelerometer",
                allantools.ohdev,
                np.cumsum(change[:, k]) * step_s,
                np.cumsum(apart[:, k]) * step_s,
                False,
                3,
                (1.0, 0.811, 0.5),
            ),
        )
        for kind, estimator, raw, freed, modified, differences, shares in cases:
            tau_s, before, _, _ = estimator(raw, rate=1.0 / step_s, data_type="phase", taus=taus)
            _, after, _, _ = estimator(freed, rate=1.0 / step_s, data_type="phase", taus=taus)
            less = after**2 < 0.25 * before**2
            if np.count_nonzero(less & early[: len(less)]) < 3:
                continue
            used = samples[: len(tau_s)]
            edf = np.array([edf_of_noise(0, differences, int(m), n, modified) for m in used])
            ceiling = ceiling_of(after**2, edf)
            squares = np.full(len(TERMS), np.inf)
            # Below a few blocks the averages of the blocks still tell in the laws.
            long = used >= 8
            for term, share in zip((1, 2, 3, 4), shares, strict=False):
                squares[term] = np.min((ceiling / (share * noise_basis(tau_s)[:, term]))[long])
            found[kind, int(k)] = Levelled(tau_s, after, squares, float(tau_s[np.argmax(less)]))
    return found
