r"""Paths in the plane by their arc length, and height profiles along them.

A drawn path (lines and arcs) has steps in its curvature; a vehicle on it would have steps in its lateral
acceleration. Its points therefore are the control points of a quintic B-spline, whose curvature and the
derivative of it are continuous; then the curve is parametrised again by its own length, so that a speed is a
speed (to 1e-6) and a distance a distance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from .laws import uniform_spline

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

__all__ = ["CirclePath", "FlatProfile", "Path", "Profile", "SplinePath", "SplineProfile", "rounded_polyline"]


class Path(Protocol):
    """A curve in the plane by its length, east and north."""

    def derivatives(self, way_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Point and its first three derivatives by the way, each of shape (n, 2)."""
        ...


class Profile(Protocol):
    """Height along a path."""

    def derivatives(self, way_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Height and its first two derivatives by the way, each of shape (n,)."""
        ...


class CirclePath:
    """A circle through the origin.

    Parameters
    ----------
    radius_m : float
        Radius; positive turns right.
    direction_rad : float
        Direction at the origin, clockwise from north.
    """

    def __init__(self, radius_m: float, direction_rad: float) -> None:
        self.radius_m, self.direction_rad = float(radius_m), float(direction_rad)

    def derivatives(self, way_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Point and its first three derivatives by the way, each of shape (n, 2)."""
        curvature = 1.0 / self.radius_m
        azimuth = self.direction_rad + way_m * curvature
        sine, cosine = np.sin(azimuth), np.cos(azimuth)
        east = np.cos(self.direction_rad) - cosine
        north = sine - np.sin(self.direction_rad)
        tangent = np.stack((sine, cosine), axis=-1)
        normal = np.stack((cosine, -sine), axis=-1)
        point = self.radius_m * np.stack((east, north), axis=-1)
        return point, tangent, curvature * normal, -(curvature**2) * tangent


class SplinePath:
    """A smooth curve by its length.

    Parameters
    ----------
    spline : scipy.interpolate.BSpline
        Point by the way.
    length_m : float
        Length; of a closed path, that of one lap.
    closed : bool
        The way goes on around.
    step_m : float
        Finest detail, the distance of the knots.
    """

    def __init__(self, spline: BSpline, length_m: float, closed: bool, step_m: float) -> None:
        self._splines = [spline, *(spline.derivative(order) for order in (1, 2, 3))]
        self.length_m, self.closed, self.step_m = float(length_m), closed, float(step_m)

    @classmethod
    def through(cls, points_m: np.ndarray, *, closed: bool) -> SplinePath:
        """Path near points that are spaced evenly.

        Parameters
        ----------
        points_m : ndarray, shape (n, 2)
            Points of a drawn path, n >= 8; the first is not repeated at the end of a closed one. The ends of
            an open one should be straight.
        closed : bool
            The last point is followed by the first.

        Returns
        -------
        SplinePath
            It stays within 0.25 c d^2 of a drawn arc of curvature c whose points are d apart.
        """
        points = np.asarray(points_m, dtype=float)
        n = len(points)
        if closed:
            curve = uniform_spline(-4.0, 1.0, np.concatenate([points[-4:], points, points[:5]]))
            end = float(n)
        else:
            count = np.arange(1, 5)[:, None]
            before = points[0] - (points[1] - points[0]) * count[::-1]
            after = points[-1] + (points[-1] - points[-2]) * count
            curve = uniform_spline(-4.0, 1.0, np.concatenate([before, points, after]))
            end = float(n - 1)
        return cls.by_length(curve, end, closed=closed, n_knots=2 * n)

    @classmethod
    def by_length(cls, curve: BSpline, end: float, *, closed: bool, n_knots: int) -> SplinePath:
        """Path of a curve with any parameter from 0 to ``end``.

        Parameters
        ----------
        curve : scipy.interpolate.BSpline
            Point by the parameter.
        end : float
            Last parameter.
        closed : bool
            The curve joins itself there, with all derivatives.
        n_knots : int
            How many intervals of even length the new spline has.

        Returns
        -------
        SplinePath
            The same curve, by its length.
        """
        from scipy.interpolate import CubicHermiteSpline, make_interp_spline

        # Length by Gauss-Legendre of four nodes in each of the even cells.
        edges = np.linspace(0.0, end, 2 * n_knots + 1)
        node, weight = np.polynomial.legendre.leggauss(4)
        half = 0.5 * (edges[1] - edges[0])
        inside = (edges[:-1, None] + half + half * node).ravel()
        tangent = curve.derivative()
        speed = np.hypot(*tangent(inside).T).reshape(-1, 4)
        length = np.concatenate([[0.0], np.cumsum(half * (speed @ weight))])
        inverse = CubicHermiteSpline(length, edges, 1.0 / np.hypot(*tangent(edges).T))
        way = np.linspace(0.0, length[-1], n_knots + 1)
        points = curve(np.clip(inverse(way), 0.0, end))
        if closed:
            points[-1] = points[0]
            return cls(make_interp_spline(way, points, k=5, bc_type="periodic"), length[-1], True, way[1])
        straight = [(2, np.zeros(2)), (3, np.zeros(2))]
        return cls(
            make_interp_spline(way, points, k=5, bc_type=(straight, straight)), length[-1], False, way[1]
        )

    def derivatives(self, way_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Point and its first three derivatives by the way, each of shape (n, 2)."""
        if self.closed:
            way_m = np.mod(way_m, self.length_m)
        point, first, second, third = (spline(way_m) for spline in self._splines)
        return point, first, second, third

    def curvature(self, way_m: np.ndarray) -> np.ndarray:
        """Curvature, 1/m, positive to the right, shape (n,)."""
        _, first, second, _ = self.derivatives(way_m)
        return second[:, 0] * first[:, 1] - second[:, 1] * first[:, 0]


class FlatProfile:
    """No heights."""

    def derivatives(self, way_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Height and its first two derivatives by the way, each of shape (n,)."""
        zero = np.zeros(len(way_m))
        return zero, zero, zero


class SplineProfile:
    """Heights of evenly spaced points, smoothed like a path.

    Parameters
    ----------
    step_m : float
        Distance of the points.
    heights_m : ndarray, shape (n,)
        Height at ``k step_m``; beyond the ends of an open profile it stays.
    period_m : float, optional
        Length of the lap of a closed profile; n step_m then.
    """

    def __init__(self, step_m: float, heights_m: np.ndarray, period_m: float | None = None) -> None:
        heights = np.asarray(heights_m, dtype=float)
        n_pad = 6
        padded = np.pad(heights, n_pad, mode="edge" if period_m is None else "wrap")
        spline = uniform_spline(-n_pad * step_m, step_m, padded)
        self._splines = [spline, spline.derivative(), spline.derivative(2)]
        self._period_m = period_m
        self._reach = (-step_m, len(heights) * step_m)

    def derivatives(self, way_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Height and its first two derivatives by the way, each of shape (n,)."""
        if self._period_m is not None:
            way_m = np.mod(way_m, self._period_m)
        height, first, second = (spline(way_m) for spline in self._splines)
        return height, first, second


def rounded_polyline(
    corners_m: np.ndarray, radius_m: float, *, closed: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Points at even distances on a polyline whose corners are replaced by arcs.

    Parameters
    ----------
    corners_m : ndarray, shape (n, 2)
        Corners.
    radius_m : float
        Radius of the arcs; less where a side is too short for it.
    closed : bool
        The last corner is joined to the first; the points then begin in the middle of the first corner's arc.

    Returns
    -------
    points_m : ndarray, shape (m, 2)
        Points, along straight lines and arcs, a fifth of the smallest radius apart.
    corner_way_m : ndarray, shape (n,)
        Where along them the middle of each corner's arc is (the ends of an open polyline: 0 and its length).
    """
    corners = np.asarray(corners_m, dtype=float)
    if closed:
        middle = 0.5 * (corners[-1] + corners[0])
        nodes = np.concatenate([[middle], corners, [middle]])
    else:
        nodes = corners
    side = np.diff(nodes, axis=0)
    length = np.hypot(*side.T)
    azimuth = np.arctan2(side[:, 0], side[:, 1])
    turn = np.mod(np.diff(azimuth) + np.pi, 2.0 * np.pi) - np.pi
    # An arc takes its tangent's length off both sides, and no more than its share of them: all of a side
    # whose other end has no corner, half of one between two corners.
    share = np.full(len(length), 0.499)
    share[[0, -1]] = 0.98
    room = np.minimum(length[:-1] * share[:-1], length[1:] * share[1:])
    tangent = np.minimum(radius_m * np.tan(np.abs(turn) / 2.0), room)
    pieces: list[tuple[float, np.ndarray, float, float]] = []  # length, first point, azimuth, curvature
    corner_way = [0.0]
    way = 0.0
    place = nodes[0]
    before = 0.0
    for k in range(len(length)):
        after = tangent[k] if k < len(turn) else 0.0
        straight = length[k] - before - after
        pieces.append((straight, place, azimuth[k], 0.0))
        way += straight
        place = place + straight * np.array([np.sin(azimuth[k]), np.cos(azimuth[k])])
        if k < len(turn):
            radius = tangent[k] / np.tan(abs(turn[k]) / 2.0) if abs(turn[k]) > 1e-9 else 0.0
            arc = radius * abs(turn[k])
            if arc > 0.0:
                pieces.append((arc, place, azimuth[k], np.sign(turn[k]) / radius))
            corner_way.append(way + 0.5 * arc)
            way += arc
            place = nodes[k + 1] + tangent[k] * np.array([np.sin(azimuth[k + 1]), np.cos(azimuth[k + 1])])
        before = after
    corner_way.append(way)
    tightest = min([1.0 / abs(piece[3]) for piece in pieces if piece[3] != 0.0], default=radius_m)
    n = int(np.clip(np.ceil(5.0 * way / tightest), 8, 200_000))
    if closed:
        ways = np.mod(corner_way[1] + np.linspace(0.0, way, n, endpoint=False), way)
    else:
        ways = np.linspace(0.0, way, n + 1)
    ends = np.cumsum([piece[0] for piece in pieces])
    which = np.minimum(np.searchsorted(ends, ways, side="right"), len(pieces) - 1)
    inside = ways - np.concatenate([[0.0], ends])[which]
    first = np.array([piece[1] for piece in pieces])[which]
    direction = np.array([piece[2] for piece in pieces])[which]
    curvature = np.array([piece[3] for piece in pieces])[which]
    # The chord of an arc: its length by the cardinal sine, its direction half of the turn.
    half = 0.5 * inside * curvature
    chord = inside * np.sinc(half / np.pi)
    points = first + chord[:, None] * np.stack((np.sin(direction + half), np.cos(direction + half)), axis=-1)
    return points, np.array(corner_way[1:-1]) - corner_way[1] if closed else np.array(corner_way)
