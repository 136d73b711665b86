"""Land vehicles: a circle, a route through waypoints, a suburban street route, a driver-safety circuit."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from ...errors import ConfigError
from ..randomness import stream
from .kinematics import LocalPlane
from .laws import PAD_S, SplineLaw, UniformLaw, fastest_times, sample_passage
from .paths import CirclePath, SplinePath, SplineProfile, rounded_polyline
from .routes import BodySection, RouteTrajectory, road_unevenness

__all__ = [
    "CircleMotion",
    "Stop",
    "WaypointMotion",
    "circle_trajectory",
    "drive_law",
    "height_profile",
    "require_not_negative",
    "require_open_turns",
    "require_positive",
    "street_path",
    "waypoint_trajectory",
]

LAW_STEP_S = 0.4
"""Step of the planned law: changes of acceleration take a second."""


def require_positive(section: object, *keys: str) -> None:
    """Refuse settings that are not positive numbers."""
    for key in keys:
        value = getattr(section, key)
        if not value > 0.0:
            raise ConfigError(f"`{key}` is {value!r}; give a positive number", key=key, value=value)


def require_not_negative(section: object, *keys: str) -> None:
    """Refuse settings that are negative or no numbers."""
    for key in keys:
        value = getattr(section, key)
        if not value >= 0.0:
            raise ConfigError(f"`{key}` is {value!r}; give 0 or more", key=key, value=value)


def require_open_turns(key: str, corners_m: ArrayLike, *, closed: bool) -> None:
    """Refuse corners that coincide, or at which the route turns back on itself."""
    corners = np.asarray(corners_m, dtype=float)
    sides = np.diff(np.concatenate([corners, corners[:1]]) if closed else corners, axis=0)
    if np.min(np.hypot(*sides.T)) < 1.0:
        raise ConfigError(f"`{key}` has neighbours closer than 1 m; leave one out", key=key, value=corners_m)
    azimuth = np.arctan2(sides[:, 0], sides[:, 1])
    turn = np.diff(np.concatenate([azimuth, azimuth[:1]]) if closed else azimuth)
    if len(turn) and np.max(np.abs(np.mod(turn + np.pi, 2.0 * np.pi) - np.pi)) > np.radians(170.0):
        raise ConfigError(
            f"`{key}` turns back by more than 170 degrees at a point; give two for such a turn",
            key=key,
            value=corners_m,
        )


def drive_law(
    path: SplinePath,
    laps: int,
    speed_limit: Callable[[np.ndarray], np.ndarray],
    *,
    acceleration_mps2: float,
    lateral_acceleration_mps2: float,
    duration_s: float,
    wait_s: float,
    stops: Sequence[tuple[float, float]] = (),
) -> tuple[SplineLaw, np.ndarray, np.ndarray]:
    """Drive along a path from rest to rest, as fast as the limits allow.

    Parameters
    ----------
    path : SplinePath
        The route.
    laps : int
        How many times a closed path is driven; 1 for an open one.
    speed_limit : callable
        Highest speed (m/s) by the way (m), arrays.
    acceleration_mps2, lateral_acceleration_mps2 : float
        Limits along and across.
    duration_s : float
        Until when the law is needed.
    wait_s : float
        At rest before the departure.
    stops : sequence of (float, float)
        Way (m) and duration (s) of halts.

    Returns
    -------
    law : SplineLaw
        Way over time.
    way_m, arrival_s : ndarray
        Points of the route and when they are reached.
    """
    # Cells of a metre, or less where the path is finer; as many in each lap, so that a longer drive begins
    # like a shorter one.
    cells = int(np.ceil(path.length_m / min(1.0, path.step_m)))
    way = np.arange(laps * cells + 1) * (path.length_m / cells)
    limit = speed_limit(way)
    # The law is smoothed in time, so that a turn is entered a little faster than it was planned.
    curvature = np.abs(path.curvature(way))
    limit = np.minimum(limit, np.sqrt(0.78 * lateral_acceleration_mps2 / np.maximum(curvature, 1e-9)))
    # Tight turns are driven so slowly that a whole second of smoothing would carry the speed into them.
    step_s = min(LAW_STEP_S, max(0.05, 0.25 * float(np.min(limit)) / acceleration_mps2))
    limit[[0, -1]] = 0.0
    # Six equal control points in a row make a rest, so that a halt takes five steps more than it lasts.
    halts = [(round(where / path.length_m * cells), duration + 5.0 * step_s) for where, duration in stops]
    arrival, departure, speed = fastest_times(way, limit, acceleration_mps2, acceleration_mps2, halts)
    start = wait_s + 3.0 * step_s
    times = np.arange(-np.ceil(PAD_S / step_s), np.ceil((duration_s + PAD_S) / step_s) + 1.0) * step_s
    samples = sample_passage(times, way, arrival + start, departure + start, speed)
    return SplineLaw(times[0], step_s, samples), way, arrival + start


class CircleMotion(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="circle"
):
    """A level circle at constant speed through the start point."""

    radius_m: float = 30.0
    speed_mps: float = 5.0
    clockwise: bool = True
    heading_deg: float = 0.0
    """Course at the start."""
    coordinated: bool = False
    """Bank into the turn, like an aircraft."""
    body: BodySection = BodySection()

    def __post_init__(self) -> None:
        require_positive(self, "radius_m", "speed_mps")


def circle_trajectory(section: CircleMotion, plane: LocalPlane, seed: int) -> RouteTrajectory:
    """Trajectory of a `CircleMotion`."""
    return RouteTrajectory(
        plane,
        CirclePath(
            section.radius_m if section.clockwise else -section.radius_m, np.radians(section.heading_deg)
        ),
        UniformLaw(section.speed_mps),
        body=section.body,
        coordinated=section.coordinated,
        disturbances=road_unevenness(section.body.unevenness_mps2, stream(seed, "motion", "road")),
    )


class Stop(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A halt on a route."""

    waypoint: int
    """Index of the waypoint to halt at, from 0."""
    duration_s: float
    """How long, at rest."""


class WaypointMotion(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="waypoints"
):
    """A drive through waypoints within limits of speed and acceleration, from rest to rest."""

    points_m: tuple[tuple[float, ...], ...]
    """East, north and, if wanted, up from the start point of the scenario, metres."""
    speed_mps: float = 10.0
    """Highest speed."""
    acceleration_mps2: float = 1.5
    """Highest acceleration and deceleration."""
    lateral_acceleration_mps2: float = 2.0
    """Highest acceleration across; turns are driven slower for it."""
    corner_radius_m: float = 10.0
    """Radius of the turn at a waypoint, as far as its neighbours leave room."""
    stops: tuple[Stop, ...] = ()
    """Halts at waypoints, in every lap."""
    wait_s: float = 5.0
    """At rest before the departure."""
    closed: bool = False
    """Return to the first waypoint."""
    laps: int | None = None
    """Of a closed route; left out, as many as the duration needs."""
    body: BodySection = BodySection()

    def __post_init__(self) -> None:
        require_positive(
            self, "speed_mps", "acceleration_mps2", "lateral_acceleration_mps2", "corner_radius_m"
        )
        require_not_negative(self, "wait_s")
        for point in self.points_m:
            if len(point) not in (2, 3):
                raise ConfigError(
                    f"`points_m` holds {point!r}; give east, north and at most up",
                    key="points_m",
                    value=point,
                )
        if len(self.points_m) < (3 if self.closed else 2):
            raise ConfigError(
                f"`points_m` has {len(self.points_m)} points; give two, of a closed route three",
                key="points_m",
                value=self.points_m,
            )
        require_open_turns("points_m", [point[:2] for point in self.points_m], closed=self.closed)
        for stop in self.stops:
            if not 0 <= stop.waypoint < len(self.points_m) or not stop.duration_s > 0.0:
                raise ConfigError(
                    f"`stops` holds {stop!r}; give the index of a waypoint and a positive duration",
                    key="stops",
                    value=stop,
                )
        if self.laps is not None and (self.laps < 1 or not self.closed):
            raise ConfigError(
                f"`laps` is {self.laps!r}; give 1 or more, with `closed`", key="laps", value=self.laps
            )


def waypoint_trajectory(
    section: WaypointMotion, plane: LocalPlane, duration_s: float, seed: int
) -> RouteTrajectory:
    """Trajectory of a `WaypointMotion`."""
    points = np.array([(*point, 0.0)[:3] for point in section.points_m])
    path, corner_way = street_path(points[:, :2], section.corner_radius_m, closed=section.closed)

    def limit(way: np.ndarray) -> np.ndarray:
        return np.full(len(way), section.speed_mps)

    laps = 1
    if section.closed:
        laps = section.laps or 2 + int(duration_s * section.speed_mps / path.length_m)
    stops = [
        (lap * path.length_m + corner_way[stop.waypoint], stop.duration_s)
        for lap in range(laps)
        for stop in section.stops
    ]
    law, _, _ = drive_law(
        path,
        laps,
        limit,
        acceleration_mps2=section.acceleration_mps2,
        lateral_acceleration_mps2=section.lateral_acceleration_mps2,
        duration_s=duration_s,
        wait_s=section.wait_s,
        stops=stops,
    )
    return RouteTrajectory(
        plane,
        path,
        law,
        profile=height_profile(corner_way, points[:, 2], path),
        body=section.body,
        disturbances=road_unevenness(section.body.unevenness_mps2, stream(seed, "motion", "road")),
    )


def street_path(corners_m: np.ndarray, radius_m: float, *, closed: bool) -> tuple[SplinePath, np.ndarray]:
    """Smooth path around corners, and the way to the middle of each.

    Parameters
    ----------
    corners_m : ndarray, shape (n, 2)
        East and north.
    radius_m : float
        Radius of the turns.
    closed : bool
        The last corner is joined to the first.

    Returns
    -------
    path : SplinePath
        The path; its curvature goes from 0 to that of the turn within about a radius.
    corner_way_m : ndarray, shape (n,)
        Where the corners are along it.
    """
    points, corner_way = rounded_polyline(corners_m, radius_m, closed=closed)
    path = SplinePath.through(points, closed=closed)
    sides = np.diff(np.concatenate([points, points[:1]]) if closed else points, axis=0)
    return path, corner_way * (path.length_m / np.sum(np.hypot(*sides.T)))


def height_profile(way_m: np.ndarray, heights_m: np.ndarray, path: SplinePath) -> SplineProfile | None:
    """Heights at points of a path, joined by even grades with vertical curves of some 20 m between them."""
    if not np.any(heights_m):
        return None
    if path.closed:
        way_m = np.concatenate([way_m, [path.length_m]])
        heights_m = np.concatenate([heights_m, heights_m[:1]])
    n = max(6, round(path.length_m / 8.0))
    where = np.linspace(0.0, path.length_m, n + 1)
    heights = np.interp(where, way_m, heights_m)
    step = path.length_m / n
    return SplineProfile(step, heights[:-1], path.length_m) if path.closed else SplineProfile(step, heights)
