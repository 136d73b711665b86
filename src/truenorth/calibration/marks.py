r"""Reference points from marks: planes, lines, where they meet, and coordinates in the body frame.

A reference point that cannot be pointed at is found from marks that can: the plane n.x = d through three or
more of them and the line x = q + t m through two or more meet at

    x = q + m (d - n.q) / (n.m).

Planes and lines are those of least squares of the distances of the marks. Covariances go through with that of
all marks together.

Reference: K. Landfahrer, "Attitude determination using a GPS multi antenna array", MSc thesis, TU Graz, 2009,
sec. 4.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import ConfigError
from .body_frame import axes_rule, s_transformation

__all__ = [
    "Line",
    "Plane",
    "body_coordinates",
    "fit_line",
    "fit_plane",
    "plane_line_point",
]

STEP_M = 1e-5
"""Of the differences that give derivatives; marks are decimetres apart."""

MIN_SPREAD_M = 1e-3
"""Marks nearer to one another than this give no direction."""

MIN_SINE = 0.1
"""A line nearer to its plane than this sine pierces it nowhere in particular."""


class Plane(NamedTuple):
    """The plane n.x = d.

    Parameters
    ----------
    normal : ndarray, shape (3,)
        Unit vector n.
    offset_m : float
        d.
    misfit_m : ndarray, shape (k,)
        Distances of the marks from it.
    """

    normal: np.ndarray
    offset_m: float
    misfit_m: np.ndarray


class Line(NamedTuple):
    """The line x = q + t m.

    Parameters
    ----------
    point_m : ndarray, shape (3,)
        Middle q of its marks.
    direction : ndarray, shape (3,)
        Unit vector m.
    misfit_m : ndarray, shape (k,)
        Distances of the marks from it.
    """

    point_m: np.ndarray
    direction: np.ndarray
    misfit_m: np.ndarray


def fit_plane(marks_m) -> Plane:
    """Plane through three marks or more.

    Parameters
    ----------
    marks_m : array_like, shape (k, 3)
        Coordinates.

    Returns
    -------
    Plane
        Its normal points to the side of the larger last coordinate.

    Raises
    ------
    ConfigError
        If the marks are fewer than three or stand on one line.
    """
    marks_m = np.asarray(marks_m, dtype=float)
    if len(marks_m) < 3:
        raise ConfigError(f"a plane needs three marks, {len(marks_m)} are given", key="plane")
    middle = marks_m.mean(0)
    _, size, axes = np.linalg.svd(marks_m - middle)
    if size[1] < MIN_SPREAD_M:
        raise ConfigError("the marks of the plane stand on one line; choose others", key="plane")
    normal = axes[2] if axes[2][np.argmax(np.abs(axes[2]))] > 0.0 else -axes[2]
    return Plane(normal, float(normal @ middle), (marks_m - middle) @ normal)


def fit_line(marks_m) -> Line:
    """Line through two marks or more, from the first towards the last.

    Parameters
    ----------
    marks_m : array_like, shape (k, 3)
        Coordinates.

    Returns
    -------
    Line

    Raises
    ------
    ConfigError
        If the marks are fewer than two or stand in one place.
    """
    marks_m = np.asarray(marks_m, dtype=float)
    if len(marks_m) < 2:
        raise ConfigError(f"a line needs two marks, {len(marks_m)} are given", key="line")
    middle = marks_m.mean(0)
    _, size, axes = np.linalg.svd(marks_m - middle)
    if size[0] < MIN_SPREAD_M:
        raise ConfigError("the marks of the line stand in one place; choose others", key="line")
    direction = axes[0] if axes[0] @ (marks_m[-1] - marks_m[0]) > 0.0 else -axes[0]
    apart = marks_m - middle
    across = apart - np.outer(apart @ direction, direction)
    return Line(middle, direction, np.linalg.norm(across, axis=1))


def plane_line_point(plane_marks_m, line_marks_m, cov_m2=None):
    """Point at which the line through some marks pierces the plane through others.

    Parameters
    ----------
    plane_marks_m : array_like, shape (p, 3)
        Three or more.
    line_marks_m : array_like, shape (q, 3)
        Two or more.
    cov_m2 : ndarray, shape (3 (p + q), 3 (p + q)), optional
        Joint covariance of the marks, those of the plane first.

    Returns
    -------
    point_m : ndarray, shape (3,)
    jacobian : ndarray, shape (3, 3 (p + q))
        How it follows the marks.
    cov_m2 : ndarray, shape (3, 3)
        Its covariance; NaN without that of the marks.

    Raises
    ------
    ConfigError
        If the line runs along the plane, or the marks give neither.
    """
    plane_marks_m = np.asarray(plane_marks_m, dtype=float)
    line_marks_m = np.asarray(line_marks_m, dtype=float)
    n_plane = 3 * len(plane_marks_m)

    def pierce(flat):
        plane = fit_plane(flat[:n_plane].reshape(-1, 3))
        line = fit_line(flat[n_plane:].reshape(-1, 3))
        slope = plane.normal @ line.direction
        if abs(slope) < MIN_SINE:
            raise ConfigError(
                "the line runs along the plane and does not pierce it; choose others", key="line"
            )
        return line.point_m + line.direction * (plane.offset_m - plane.normal @ line.point_m) / slope

    flat = np.concatenate([plane_marks_m.ravel(), line_marks_m.ravel()])
    jacobian = _derivative(pierce, flat)
    cov = np.full((3, 3), np.nan) if cov_m2 is None else jacobian @ cov_m2 @ jacobian.T
    return pierce(flat), jacobian, cov


def _derivative(function, at):
    """Central differences."""
    columns = []
    for k in range(len(at)):
        step = np.zeros(len(at))
        step[k] = STEP_M
        columns.append((function(at + step) - function(at - step)) / (2.0 * STEP_M))
    return np.stack(columns, axis=1)


def body_coordinates(points_ned_m, cov_m2, axes=(0, 1, 2), *, down_ned=(0.0, 0.0, 1.0)):
    """Surveyed points in the body frame that three of them span.

    Parameters
    ----------
    points_ned_m : ndarray, shape (k, 3)
        North, east, down of a local frame.
    cov_m2 : ndarray, shape (3 k, 3 k)
        Joint covariance.
    axes : sequence of int
        Points at the origin, forward of it, and at their height.
    down_ned : array_like, shape (3,)
        Which way is down, about.

    Returns
    -------
    positions_body_m : ndarray, shape (k, 3)
        Forward, right, down. Those that are no antennas are lever arms.
    cov_body_m2 : ndarray, shape (3 k, 3 k)
        By the rule of the axes.
    rot_body_from_ned : ndarray, shape (3, 3)
    """
    points_ned_m = np.asarray(points_ned_m, dtype=float)
    rot, shift, rule = axes_rule(points_ned_m, axes, down_body=np.asarray(down_ned, dtype=float))
    positions_m = points_ned_m @ rot.T + shift
    change = s_transformation(positions_m, rule) @ np.kron(np.eye(len(points_ned_m)), rot)
    return positions_m, change @ cov_m2 @ change.T, rot
