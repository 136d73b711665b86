"""The closed suburban street route: 90 degree turns, changing speed limits, stops, gentle hills.

The streets bound a group of blocks that is grown at random on an uneven grid, so that the route is closed,
crosses itself nowhere and turns left as well as right. It follows the description of the test drives in
Harvey, R. S., "Development of a precision pointing system using an integrated multi-sensor approach",
M.Sc. thesis, University of Calgary, UCGE 20117 (1998), ch. 7: north-west Calgary, a closed route repeated
several times, once with a halt of 350 s.
"""

from __future__ import annotations

import msgspec
import numpy as np

from ...errors import ConfigError
from ..randomness import stream
from .drives import LAW_STEP_S, drive_law, height_profile, require_not_negative, require_positive, street_path
from .kinematics import LocalPlane
from .laws import Law
from .paths import SplinePath
from .routes import BodySection, RouteTrajectory, Sinusoids, road_unevenness

__all__ = ["SuburbanMotion", "suburban_trajectory"]

STOP_LINE_M = 12.0
"""How far before the corner a vehicle halts."""


class SuburbanMotion(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="suburban"
):
    """Laps of a closed route through suburban streets, drawn from the seed."""

    blocks: int = 10
    """How many blocks the route goes around; ten make a lap of some 3 km."""
    block_m: tuple[float, float] = (90.0, 220.0)
    """Least and greatest distance of parallel streets."""
    bearing_deg: float = 0.0
    """Of the streets, clockwise from north."""
    speed_kmh: tuple[int, int] = (20, 50)
    """Lowest and highest speed limit; each street has one of its own between them, in steps of 10."""
    acceleration_mps2: float = 1.5
    """Highest acceleration and deceleration."""
    lateral_acceleration_mps2: float = 2.0
    """Highest acceleration across: turns are taken at 15 km/h."""
    corner_radius_m: float = 9.0
    """Of the turns."""
    stop_share: float = 0.3
    """Share of the corners at which the vehicle halts, drawn anew in each lap."""
    stop_s: tuple[float, float] = (2.0, 25.0)
    """Shortest and longest halt."""
    grade_percent: float = 3.0
    """Slope of the streets, two standard deviations."""
    wait_s: float = 10.0
    """At rest before the departure."""
    stationary_at_s: float | None = None
    """Instant from which on the vehicle is parked; left out, never."""
    stationary_for_s: float = 350.0
    """How long it is parked."""
    body: BodySection = BodySection(unevenness_mps2=0.5)

    def __post_init__(self) -> None:
        require_positive(
            self, "acceleration_mps2", "lateral_acceleration_mps2", "corner_radius_m", "stationary_for_s"
        )
        require_not_negative(self, "wait_s")
        if not 1 <= self.blocks <= 200:
            raise ConfigError(f"`blocks` is {self.blocks!r}; give 1 to 200", key="blocks", value=self.blocks)
        for key, least in (("block_m", 4.0 * self.corner_radius_m), ("speed_kmh", 10), ("stop_s", 0.0)):
            value = getattr(self, key)
            if not least <= value[0] <= value[1]:
                raise ConfigError(
                    f"`{key}` is {value!r}; give a least value of {least:g} or more and a greatest",
                    key=key,
                    value=value,
                )
        if not 0.0 <= self.stop_share <= 1.0:
            raise ConfigError(
                f"`stop_share` is {self.stop_share!r}; give 0 to 1", key="stop_share", value=self.stop_share
            )
        if not 0.0 <= self.grade_percent <= 15.0:
            raise ConfigError(
                f"`grade_percent` is {self.grade_percent!r}; give 0 to 15",
                key="grade_percent",
                value=self.grade_percent,
            )
        if self.stationary_at_s is not None and self.stationary_at_s < self.wait_s + 60.0:
            raise ConfigError(
                f"`stationary_at_s` is {self.stationary_at_s!r}; give a minute after `wait_s` or later",
                key="stationary_at_s",
                value=self.stationary_at_s,
            )


def grow_blocks(n_blocks: int, rng: np.random.Generator) -> list[tuple[int, int]]:
    """Outline of a random group of squares of a grid.

    Parameters
    ----------
    n_blocks : int
        Squares in the group.
    rng : numpy.random.Generator
        Draws the squares.

    Returns
    -------
    list of (int, int)
        Corners of the outline, clockwise with x to the east and y to the north; it is one closed line that
        meets itself nowhere.
    """
    group = {(0, 0)}
    outline = trace_outline(group)
    while len(group) < n_blocks:
        near = sorted(
            {(x + dx, y + dy) for x, y in group for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1))} - group
        )
        grown = group | {near[rng.integers(len(near))]}
        longer = trace_outline(grown)
        # A group with a hole, or that touches itself at a corner, has no such outline: draw another square.
        if longer is not None:
            group, outline = grown, longer
    return [] if outline is None else outline


def trace_outline(group: set[tuple[int, int]]) -> list[tuple[int, int]] | None:
    """Corners of the outline of squares; None where it is not one line without double points."""
    edges: set[tuple[tuple[int, int], tuple[int, int]]] = set()
    for x, y in group:
        corners = [(x, y), (x, y + 1), (x + 1, y + 1), (x + 1, y)]
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            if (b, a) in edges:
                edges.remove((b, a))
            else:
                edges.add((a, b))
    following = dict(edges)
    if len(following) != len(edges):
        return None
    start = min(following)
    ring = [start]
    while (after := following[ring[-1]]) != start:
        ring.append(after)
    if len(ring) != len(edges):
        return None
    n = len(ring)
    return [
        ring[k]
        for k in range(n)
        if (ring[k][0] - ring[k - 1][0], ring[k][1] - ring[k - 1][1])
        != (ring[(k + 1) % n][0] - ring[k][0], ring[(k + 1) % n][1] - ring[k][1])
    ]


def street_corners(section: SuburbanMotion, rng: np.random.Generator) -> np.ndarray:
    """Corners of the route; the first lies in the middle of the longest side and is the origin."""
    outline = np.array(grow_blocks(section.blocks, rng))
    low, high = section.block_m
    corners = np.empty(outline.shape)
    for axis in (0, 1):
        first, last = outline[:, axis].min(), outline[:, axis].max()
        streets = np.concatenate([[0.0], np.cumsum(rng.uniform(low, high, last - first))])
        corners[:, axis] = streets[outline[:, axis] - first]
    sides = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T)
    k = int(np.argmax(sides))
    corners = np.roll(corners, -k - 1, axis=0)
    middle = 0.5 * (corners[-1] + corners[0])
    bearing = np.radians(section.bearing_deg)
    turn = np.array([[np.cos(bearing), np.sin(bearing)], [-np.sin(bearing), np.cos(bearing)]])
    return (np.concatenate([middle[None], corners]) - middle) @ turn.T


def hill_heights(points_m: np.ndarray, grade: float, rng: np.random.Generator) -> np.ndarray:
    """Height of gently rolling ground at points: waves of 300 to 1500 m, slope of the given sd."""
    n = 8
    wave = 2.0 * np.pi / rng.uniform(300.0, 1500.0, n)
    azimuth = rng.uniform(0.0, 2.0 * np.pi, n)
    phase = rng.uniform(0.0, 2.0 * np.pi, n)
    # Along a street the slope is that of the wave times the cosine of the angle between them.
    amplitude = grade * 2.0 / np.sqrt(n) / wave
    heights = np.zeros(len(points_m))
    for a, k, direction, start in zip(amplitude, wave, azimuth, phase, strict=True):
        along = points_m @ np.array([np.sin(direction), np.cos(direction)])
        heights += Sinusoids(np.array([a]), np.array([k]), np.array([start])).derivatives(along)[0]
    return heights - heights[0]


def find_straight(path: SplinePath, way_m: float) -> float:
    """Last point before a way from which the next 10 m and the 30 m behind are straight."""
    for where in np.arange(way_m, way_m - path.length_m, -5.0):
        if np.max(np.abs(path.curvature(where + np.arange(-30.0, 11.0, 2.0)))) < 1e-4:
            return float(where)
    return float(way_m)


def suburban_trajectory(
    section: SuburbanMotion, plane: LocalPlane, duration_s: float, seed: int
) -> RouteTrajectory:
    """Trajectory of a `SuburbanMotion`.

    Parameters
    ----------
    section : SuburbanMotion
        Settings.
    plane : LocalPlane
        Where the route is drawn.
    duration_s : float
        How long the motion is needed; it goes on in laps.
    seed : int
        Of the scenario.

    Returns
    -------
    RouteTrajectory
        The drive.
    """
    rng = stream(seed, "motion", "streets")
    corners = street_corners(section, rng)
    path, corner_way = street_path(corners, section.corner_radius_m, closed=True)
    slow, fast = section.speed_kmh
    limits_mps = rng.choice(np.arange(slow, fast + 1, 10), len(corner_way)) / 3.6
    # The start in the middle of a street has its limit from the corner before it.
    limits_mps[0] = limits_mps[-1]
    ground = np.linspace(0.0, path.length_m, int(path.length_m / 8.0), endpoint=False)
    heights = hill_heights(path.derivatives(ground)[0], 0.005 * section.grade_percent, rng)
    # Nobody drives evenly: a speed that wanders within a tenth below the limit.
    habit = Sinusoids(
        np.full(3, 1.0 / 3.0), 2.0 * np.pi / rng.uniform(80.0, 400.0, 3), rng.uniform(0.0, 6.28, 3)
    )

    def limit(way: np.ndarray) -> np.ndarray:
        side = np.searchsorted(corner_way, np.mod(way, path.length_m), side="right") - 1
        return limits_mps[side] * (0.95 + 0.05 * habit.derivatives(way)[0])

    laps = 2 + int((duration_s + 60.0) * np.max(limits_mps) / path.length_m)
    stops: list[tuple[float, float]] = []
    for lap in range(laps):
        rng = stream(seed, "motion", "stops", lap)
        halted = rng.random(len(corner_way) - 1) < section.stop_share
        lengths = rng.uniform(*section.stop_s, len(halted))
        where = lap * path.length_m + corner_way[1:] - STOP_LINE_M
        stops.extend(zip(where[halted], lengths[halted], strict=True))

    def plan(stops: list[tuple[float, float]]) -> tuple[Law, np.ndarray, np.ndarray]:
        return drive_law(
            path,
            laps,
            limit,
            acceleration_mps2=section.acceleration_mps2,
            lateral_acceleration_mps2=section.lateral_acceleration_mps2,
            duration_s=duration_s,
            wait_s=section.wait_s,
            stops=stops,
        )

    law, way, arrival = plan(stops)
    if section.stationary_at_s is not None:
        # Parked on a straight street that is reached in time (braking for it, and the smoothing of the law,
        # take some seconds that the drive without it did not need), there until the end asked for.
        for early_s in (10.0, 15.0, 20.0, 30.0, 40.0):
            parked = find_straight(path, float(np.interp(section.stationary_at_s - early_s, arrival, way)))
            others = [stop for stop in stops if abs(stop[0] - parked) > 60.0]
            _, way_there, arrival_there = plan([*others, (parked, 0.0)])
            reached = arrival_there[np.argmin(np.abs(way_there - parked))]
            waited = section.stationary_at_s - float(reached)
            if waited > 3.0 * LAW_STEP_S:
                break
        law, _, _ = plan([*others, (parked, waited + section.stationary_for_s)])
    return RouteTrajectory(
        plane,
        path,
        law,
        profile=height_profile(ground, heights, path),
        body=section.body,
        disturbances=road_unevenness(section.body.unevenness_mps2, stream(seed, "motion", "road")),
    )
