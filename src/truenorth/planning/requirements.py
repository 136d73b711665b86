"""From a demanded accuracy of an angle to what must be built: a longer array, quieter phases, better points.

The covariance of the angles falls with the square of the size of an array, whatever the sky and whatever the
errors of its coordinates in metres. So the array that reaches a demanded standard deviation is the planned
one enlarged by what it reaches over what is demanded. Noise of the phases is scaled until the demand is met,
which errors of the body coordinates may prevent. The allowed error of a position is that of a coordinate of
an antenna, independent and alike, of whatever method gives the positions (Landfahrer 2009, section 3.9).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from ..errors import ConfigError, NoSolutionError
from .plan import ANGLES, Plan
from .precision import array_precision

__all__ = ["QUANTILES", "Requirement", "requirement", "value_at"]

QUANTILES = {"median": 0.5, "p95": 0.95, "worst": 1.0}
"""Which epoch of the day counts."""


@dataclass(frozen=True, slots=True)
class Requirement:
    """What it takes to reach a demanded standard deviation of one angle.

    Parameters
    ----------
    angle : str
        ``heading``, ``pitch`` or ``roll``.
    demanded_deg : float
        Its standard deviation.
    at : str
        ``median``, ``p95`` or ``worst`` epoch of the plan.
    reached_deg : float
        What the planned array reaches there.
    scale : float
        The array must be so many times as large; below 1 it may be smaller.
    length_m : float
        Its longest baseline then.
    noise_factor : float
        Or the noise of the phases so many times as large; NaN where the errors of the body coordinates
        alone are too much.
    position_sd_m : float
        Error allowed to each coordinate of each antenna, where positions come from elsewhere.
    """

    angle: str
    demanded_deg: float
    at: str
    reached_deg: float
    scale: float
    length_m: float
    noise_factor: float
    position_sd_m: float

    def __str__(self) -> str:
        """Two lines: what is reached, and the three ways to reach what is demanded."""
        is_met = self.reached_deg <= self.demanded_deg
        noise = (
            f"phases of {self.noise_factor:.3g} times the noise"
            if np.isfinite(self.noise_factor)
            else "(no phases are quiet enough: the body coordinates are too uncertain)"
        )
        return (
            f"required    {self.angle} {self.demanded_deg:g} deg ({self.at}): the array reaches "
            f"{self.reached_deg:.4g} deg, which is {'enough' if is_met else 'not enough'}\n"
            f"            it takes an array {self.scale:.3g} times as large ({self.length_m:.3g} m at most), "
            f"or {noise};\n"
            f"            positions from elsewhere may be off by {1e3 * self.position_sd_m:.3g} mm in each "
            "coordinate"
        )


def value_at(values: np.ndarray, at: str) -> float:
    """Value of the median, 95 % or worst epoch; NaN where there is none.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Epochs; what is not known counts as worst.
    at : str
        One of `QUANTILES`.

    Returns
    -------
    float
    """
    if at not in QUANTILES:
        raise ConfigError(f"`at` is {at!r}; give one of " + ", ".join(QUANTILES), key="at", value=at)
    filled = np.sort(np.where(np.isfinite(values), values, np.inf))
    if len(filled) == 0 or not np.isfinite(filled[0]):
        return np.nan
    return float(filled[int(np.ceil(QUANTILES[at] * len(filled))) - 1])


def requirement(plan: Plan, angle: str, demanded_deg: float, *, at: str = "p95") -> Requirement:
    """Invert a plan: what reaches a demanded standard deviation of an angle.

    Parameters
    ----------
    plan : Plan
        The array, its place and its day.
    angle : str
        ``heading``, ``pitch`` or ``roll``.
    demanded_deg : float
        Its standard deviation.
    at : str
        ``median``, ``p95`` or ``worst`` epoch.

    Returns
    -------
    Requirement

    Raises
    ------
    ConfigError
        If the angle is unknown or the demand not positive.
    NoSolutionError
        If the array does not observe the angle, or not at that epoch.

    Examples
    --------
    >>> from truenorth.planning import plan_array, requirement, white_noise
    >>> day = plan_array(antennas=[(0, 0, 0), (1, 0, 0)], latitude_deg=47.07, longitude_deg=15.44,
    ...                  start="2024-06-24", hours=0, stochastic=white_noise(0.003, 0.3))
    >>> found = requirement(day, "heading", 0.1)
    >>> bool(abs(found.length_m * 0.1 - found.reached_deg * 1.0) < 1e-9)
    True
    """
    if angle not in ANGLES:
        raise ConfigError(f"`angle` is {angle!r}; give one of " + ", ".join(ANGLES), key="angle", value=angle)
    if not demanded_deg > 0.0:
        raise ConfigError(
            f"`demanded_deg` is {demanded_deg!r}; give a positive angle",
            key="demanded_deg",
            value=demanded_deg,
        )
    k = ANGLES.index(angle)
    settings = plan.settings
    positions_m = np.array(settings.antennas)
    angles_rad = plan.angles_rad
    reached_deg = value_at(np.degrees(plan.sd_rad[:, k]), at)
    if not np.isfinite(reached_deg):
        observed = np.any(np.isfinite(plan.sd_rad[:, k]))
        why = "too few satellites are in view at that epoch" if observed else "its antennas do not observe it"
        raise NoSolutionError(f"could not say what {angle} of {demanded_deg:g} deg takes: {why}")

    def sd_deg(factor: float) -> float:
        found = array_precision(
            plan.information / factor**2, positions_m, angles_rad, position_sd_m=settings.position_sd_m
        )
        return value_at(np.degrees(np.sqrt(found.cov_rad2[:, k, k])), at)

    first, second = plan.longest_baseline
    scale = reached_deg / demanded_deg
    unit = array_precision(np.eye(3)[None], positions_m, angles_rad).cov_rad2[0, k, k]
    return Requirement(
        angle=angle,
        demanded_deg=float(demanded_deg),
        at=at,
        reached_deg=reached_deg,
        scale=scale,
        length_m=scale * float(np.linalg.norm(positions_m[second] - positions_m[first])),
        noise_factor=_noise_factor(sd_deg, demanded_deg, scale, settings),
        position_sd_m=float(np.radians(demanded_deg) / np.sqrt(unit)),
    )


def _noise_factor(sd_deg: Any, demanded_deg: float, scale: float, settings: msgspec.Struct) -> float:
    """Factor of the phase noise at which the demand is met, by bisection where it is not plain."""
    if settings.position_sd_m == 0.0:  # type: ignore[attr-defined]
        return 1.0 / scale
    low, high = 1e-6, 1.0
    if sd_deg(low) > demanded_deg:
        return float("nan")
    while sd_deg(high) < demanded_deg and high < 1e6:
        high *= 2.0
    for _ in range(60):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if sd_deg(middle) < demanded_deg else (low, middle)
    return low
