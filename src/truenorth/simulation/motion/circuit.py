"""The circuit of a driver-safety centre: laps of different radius and speed, the last ones over a hillock.

After the description in Landfahrer, M., "Attitude determination using a GPS multi antenna array", master's
thesis, Graz University of Technology (2009), ch. 5: about eight minutes, start and end at one point, pitch to
nearly 6 degrees on the hillock of the last four laps, roll mostly within 4 degrees. Radii, speeds and the
shape of the hillock are not given there; those below are assumed.
"""

from __future__ import annotations

import msgspec
import numpy as np

from ...errors import ConfigError
from ..randomness import stream
from .drives import drive_law, require_not_negative, require_positive
from .kinematics import LocalPlane
from .paths import SplinePath, SplineProfile
from .routes import BodySection, RouteTrajectory, road_unevenness

__all__ = ["CircuitLap", "CircuitMotion", "circuit_trajectory"]


class CircuitLap(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One lap."""

    radius_m: float
    """Of the circle."""
    speed_kmh: float
    """Highest speed."""
    hillock: bool = False
    """The lap leads over the hillock."""

    def __post_init__(self) -> None:
        require_positive(self, "radius_m", "speed_kmh")


def _laps(*laps: tuple[float, float], hillock: bool = False) -> tuple[CircuitLap, ...]:
    return tuple(CircuitLap(radius_m=radius, speed_kmh=speed, hillock=hillock) for radius, speed in laps)


class CircuitMotion(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="circuit"
):
    """Circular laps from rest to rest, back to the start."""

    laps: tuple[CircuitLap, ...] = (
        *_laps((60, 30), (60, 35), (50, 30), (50, 35), (70, 40)),
        *_laps((60, 50), (50, 48), (40, 42), (45, 46), (60, 54), (55, 50)),
        *_laps((60, 40), (60, 40), (60, 45), (60, 45), hillock=True),
    )
    clockwise: bool = True
    heading_deg: float = 0.0
    """Course at the start."""
    hillock_height_m: float = 1.6
    hillock_length_m: float = 50.0
    """From foot to foot; the steepest slope is pi times the height by the length."""
    hillock_azimuth_deg: float = 150.0
    """How far around from the start the top is."""
    acceleration_mps2: float = 1.5
    lateral_acceleration_mps2: float = 5.0
    wait_s: float = 10.0
    """At rest before the departure."""
    body: BodySection = BodySection(roll_deg_per_mps2=0.8, unevenness_mps2=0.3)

    def __post_init__(self) -> None:
        require_positive(
            self, "hillock_height_m", "hillock_length_m", "acceleration_mps2", "lateral_acceleration_mps2"
        )
        require_not_negative(self, "wait_s")
        if not self.laps:
            raise ConfigError("`laps` is empty; give at least one lap", key="laps", value=self.laps)
        if np.pi * self.hillock_height_m > 0.5 * self.hillock_length_m:
            raise ConfigError(
                f"`hillock_height_m` is {self.hillock_height_m!r}; give less than 0.16 of `hillock_length_m`",
                key="hillock_height_m",
                value=self.hillock_height_m,
            )


def circuit_trajectory(
    section: CircuitMotion, plane: LocalPlane, duration_s: float, seed: int
) -> RouteTrajectory:
    """Trajectory of a `CircuitMotion`.

    Parameters
    ----------
    section : CircuitMotion
        Settings.
    plane : LocalPlane
        Where the route is drawn.
    duration_s : float
        How long the motion is needed; after the last lap the vehicle stands.
    seed : int
        Of the scenario.

    Returns
    -------
    RouteTrajectory
        The drive.
    """
    radii = np.array([lap.radius_m for lap in section.laps])
    radii = np.append(radii, radii[0])
    cell = np.radians(5.0)
    around = np.arange(len(section.laps) * 72 + 1) * cell
    # From one radius to the next within 60 degrees on both sides of the start line; at the end, before it.
    lap = np.clip(np.rint(around / (2.0 * np.pi)).astype(int), 1, len(section.laps))
    offset = around - 2.0 * np.pi * lap
    share = np.clip(np.where(lap == len(section.laps), 1.0, 0.5) + offset / np.radians(120.0), 0.0, 1.0)
    share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    radius = radii[lap - 1] + share * (radii[lap] - radii[lap - 1])
    side = 1.0 if section.clockwise else -1.0
    azimuth = np.radians(section.heading_deg) + side * (around - 0.5 * np.pi)
    points = radius[:, None] * np.stack((np.sin(azimuth), np.cos(azimuth)), axis=-1)
    path = SplinePath.through(points - points[0], closed=False)
    chord = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    ways = chord * (path.length_m / chord[-1])
    line = ways[::72]
    speeds = np.array([lap.speed_kmh / 3.6 for lap in section.laps])

    def limit(way: np.ndarray) -> np.ndarray:
        return speeds[np.clip(np.searchsorted(line, way, side="right") - 1, 0, len(speeds) - 1)]

    n = int(path.length_m / 2.0)
    ground = np.linspace(0.0, path.length_m, n + 1)
    heights = np.zeros(n + 1)
    for k, lap_section in enumerate(section.laps):
        if lap_section.hillock:
            top = np.interp(2.0 * np.pi * k + np.radians(section.hillock_azimuth_deg), around, ways)
            near = np.abs(ground - top) < 0.5 * section.hillock_length_m
            bump = np.cos(np.pi * (ground - top) / section.hillock_length_m) ** 2
            heights += section.hillock_height_m * np.where(near, bump, 0.0)
    law, _, _ = drive_law(
        path,
        1,
        limit,
        acceleration_mps2=section.acceleration_mps2,
        lateral_acceleration_mps2=section.lateral_acceleration_mps2,
        duration_s=duration_s,
        wait_s=section.wait_s,
    )
    return RouteTrajectory(
        plane,
        path,
        law,
        profile=SplineProfile(ground[1], heights),
        body=section.body,
        disturbances=road_unevenness(section.body.unevenness_mps2, stream(seed, "motion", "road")),
    )
