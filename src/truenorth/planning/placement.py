"""Where one more antenna helps most: every candidate point is tried over the day.

An antenna above the plane of the others does what no antenna in it can: a plane favours heading over pitch
and roll (Landfahrer 2009, outlook), because the sky determines heights worst. So the best point is told
beside the best one in the plane of the array.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import ConfigError, NoSolutionError
from .plan import ANGLES, Plan
from .precision import array_precision
from .requirements import value_at

__all__ = ["CRITERIA", "Placement", "box_points", "place_antenna"]

CRITERIA = (*ANGLES, "trace")
"""What is to become small: the standard deviation of an angle, or the root of the sum of all variances."""

MOST_POINTS = 20_000
IN_PLANE_M = 0.005
"""A point this near to the plane of the array counts as in it."""


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Candidate points for one more antenna, m of them, the best first.

    Parameters
    ----------
    criterion : str
        One of `CRITERIA`.
    at : str
        ``median``, ``p95`` or ``worst`` epoch of the plan.
    point_body_m : ndarray, shape (m, 3)
        Candidates.
    sd_deg : ndarray, shape (m, 3)
        Standard deviations of heading, pitch and roll with it.
    value_deg : ndarray, shape (m,)
        The criterion.
    before_deg : ndarray, shape (3,)
        Standard deviations without it; NaN for what the array does not observe.
    is_in_plane : ndarray of bool, shape (m,)
        The point lies in the plane (or on the line) of the array; all False where the array has none.
    """

    criterion: str
    at: str
    point_body_m: np.ndarray
    sd_deg: np.ndarray
    value_deg: np.ndarray
    before_deg: np.ndarray
    is_in_plane: np.ndarray

    @property
    def best_body_m(self) -> np.ndarray:
        """Ndarray, shape (3,): the best point."""
        return self.point_body_m[0]

    def columns(self) -> dict[str, np.ndarray]:
        """One row a candidate: name of the column and its values."""
        return {
            **{f"{name}_m": self.point_body_m[:, k] for k, name in enumerate(("forward", "right", "down"))},
            **{f"{name}_sd_deg": self.sd_deg[:, k] for k, name in enumerate(ANGLES)},
            f"{self.criterion}_deg": self.value_deg,
            "in_plane": self.is_in_plane,
        }

    def to_dict(self) -> dict[str, Any]:
        """Compute the best point, and the best in the plane, in values that JSON can hold."""
        in_plane = np.flatnonzero(self.is_in_plane)

        def told(k: int) -> dict[str, Any]:
            return {
                "point_body_m": self.point_body_m[k].tolist(),
                **{f"{name}_sd_deg": _number(self.sd_deg[k, j]) for j, name in enumerate(ANGLES)},
            }

        return {
            "criterion": self.criterion,
            "at": self.at,
            "points": len(self.value_deg),
            "without": {f"{name}_sd_deg": _number(self.before_deg[j]) for j, name in enumerate(ANGLES)},
            "best": told(0),
            "best_in_plane": told(int(in_plane[0])) if len(in_plane) else None,
        }

    def __str__(self) -> str:
        """Without, with the best point, with the best one in the plane, and with the worst."""
        lines = [
            f"one more    antenna, for the least {self.criterion} ({self.at} epoch), of "
            f"{len(self.value_deg)} points",
            f"{'':<12}{'forward':>9}{'right':>9}{'down':>9}" + "".join(f"{name:>11}" for name in ANGLES),
            f"  {'without':<37}" + _words(self.before_deg),
        ]
        chosen = [("best", 0)]
        in_plane = np.flatnonzero(self.is_in_plane)
        if len(in_plane) and in_plane[0] != 0:
            chosen.append(("in plane", int(in_plane[0])))
        if len(self.value_deg) > 1:
            chosen.append(("worst", len(self.value_deg) - 1))
        for label, k in chosen:
            place = "".join(f"{value:9.3f}" for value in self.point_body_m[k])
            lines.append(f"  {label:<10}{place}" + _words(self.sd_deg[k]))
        gain = self.before_deg / self.sd_deg[0]
        told = [
            f"{name} {factor:.2f} times" for name, factor in zip(ANGLES, gain, strict=True) if factor > 1.0
        ]
        if told:
            lines.append(f"gain        {', '.join(told)} as accurate as without")
        new = [name for k, name in enumerate(ANGLES) if np.isnan(self.before_deg[k])]
        if new:
            lines.append(f"new         {' and '.join(new)} become observable")
        if len(in_plane) and in_plane[0] != 0:
            above = self.sd_deg[in_plane[0]] / self.sd_deg[0]
            words = ", ".join(f"{name} {factor:.2f}" for name, factor in zip(ANGLES, above, strict=True))
            lines.append(
                f"off plane   the best point against the best one in the plane of the array: {words}"
            )
        return "\n".join(lines)


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _words(values: np.ndarray) -> str:
    return "".join(f"{'-':>11}" if not np.isfinite(value) else f"{value:11.4g}" for value in values)


def box_points(lower_m: Any, upper_m: Any, step_m: float) -> np.ndarray:
    """Points of a grid in a box of the body frame, a plane or a line where sides are zero.

    Parameters
    ----------
    lower_m, upper_m : array_like, shape (3,)
        Opposite corners: forward, right, down, metres.
    step_m : float
        Between points; shortened so that it divides each side.

    Returns
    -------
    ndarray, shape (m, 3)

    Raises
    ------
    ConfigError
        If the corners are mixed up or the points too many.
    """
    lower, upper = np.array(lower_m, dtype=float), np.array(upper_m, dtype=float)
    if np.any(upper < lower):
        raise ConfigError(
            f"`box` runs from {lower.tolist()} to {upper.tolist()}; give the lower corner first", key="box"
        )
    if not step_m > 0.0:
        raise ConfigError(f"`grid_m` is {step_m!r}; give a positive number", key="grid_m", value=step_m)
    counts = np.ceil((upper - lower) / step_m - 1e-9).astype(int) + 1
    if np.prod(counts.astype(float)) > MOST_POINTS:
        raise ConfigError(
            f"`grid_m` is {step_m!r}: these are {int(np.prod(counts))} points; give a coarser grid, for "
            f"{MOST_POINTS} at most",
            key="grid_m",
            value=step_m,
        )
    axes = [np.linspace(lower[k], upper[k], counts[k]) for k in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def place_antenna(
    plan: Plan,
    candidates_body_m: Any,
    *,
    criterion: str = "trace",
    at: str = "median",
    min_apart_m: float = 0.1,
) -> Placement:
    """Try one more antenna at every candidate point.

    Parameters
    ----------
    plan : Plan
        The array, its place and its day.
    candidates_body_m : array_like, shape (m, 3)
        Mounting points in the body frame, e.g. from `box_points`.
    criterion : str
        ``heading``, ``pitch``, ``roll`` or ``trace``.
    at : str
        ``median``, ``p95`` or ``worst`` epoch.
    min_apart_m : float
        Points nearer to an antenna are left out.

    Returns
    -------
    Placement

    Raises
    ------
    ConfigError
        If the criterion is unknown or no point is left.
    NoSolutionError
        If no candidate lets the array observe what is to become small.

    Examples
    --------
    >>> from truenorth.planning import box_points, place_antenna, plan_array
    >>> day = plan_array(antennas=[(0, 0, 0), (1, 0, 0), (0, 1, 0)], latitude_deg=47.07, longitude_deg=15.44,
    ...                  start="2024-06-24", hours=0)
    >>> mast = place_antenna(day, box_points((0, 0, -1), (1, 1, 0), 0.5), criterion="pitch")
    >>> float(mast.best_body_m[2])  # as high as it may be
    -1.0
    """
    if criterion not in CRITERIA:
        raise ConfigError(
            f"`criterion` is {criterion!r}; give one of " + ", ".join(CRITERIA),
            key="criterion",
            value=criterion,
        )
    points = np.atleast_2d(np.asarray(candidates_body_m, dtype=float))
    if points.ndim != 2 or points.shape[1] != 3 or not np.all(np.isfinite(points)):
        raise ConfigError(
            "`candidates_body_m` are not points of three coordinates in metres", key="candidates"
        )
    array_m = np.array(plan.settings.antennas)
    apart_m = np.linalg.norm(points[:, None] - array_m[None], axis=-1).min(1)
    points = points[apart_m >= min_apart_m]
    if len(points) == 0:
        raise ConfigError(
            f"no candidate is {min_apart_m:g} m or more from every antenna; give points further away",
            key="candidates",
        )

    def sd_deg(positions_m: np.ndarray) -> np.ndarray:
        found = array_precision(
            plan.information, positions_m, plan.angles_rad, position_sd_m=plan.settings.position_sd_m
        )
        variance = np.einsum("nii->ni", found.cov_rad2)
        return np.degrees(np.sqrt(np.column_stack([variance, variance.sum(1)])))

    before = sd_deg(array_m)
    every = np.array(
        [[value_at(column, at) for column in sd_deg(np.vstack([array_m, point])).T] for point in points]
    )
    value = every[:, CRITERIA.index(criterion)]
    if not np.any(np.isfinite(value)):
        raise NoSolutionError(
            f"could not place an antenna for {criterion}: with none of {len(points)} points is it observed "
            f"at the {at} epoch"
        )
    order = np.argsort(np.where(np.isfinite(value), value, np.inf), kind="stable")
    return Placement(
        criterion=criterion,
        at=at,
        point_body_m=points[order],
        sd_deg=every[order, :3],
        value_deg=value[order],
        before_deg=np.array([value_at(column, at) for column in before.T[:3]]),
        is_in_plane=_in_plane(points[order], array_m),
    )


def _in_plane(points_m: np.ndarray, array_m: np.ndarray) -> np.ndarray:
    """Points in the plane, or on the line, that the array spans; none where it fills space."""
    centre = array_m.mean(0)
    _, size, axes = np.linalg.svd(np.vstack([array_m - centre, np.zeros((3, 3))]))
    spanned = axes[:3][size[:3] > IN_PLANE_M]
    if len(spanned) == 3:
        return np.zeros(len(points_m), dtype=bool)
    away = points_m - centre
    away = away - (away @ spanned.T) @ spanned
    return np.linalg.norm(away, axis=1) < IN_PLANE_M
