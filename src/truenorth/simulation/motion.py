"""How a platform moves: position, velocity, acceleration, attitude and rate at any instant.

Every motion is a smooth function of time, so that receivers may sample it at their own true times and
sensors at their own rates, and all agree. There is no step in acceleration or angular rate. The kinds of
motion are the alternatives of the ``[motion]`` table of a scenario, by their ``kind``.
"""

from __future__ import annotations

from typing import assert_never

from ..strapdown import (
    InertialIncrements,
    InertialStates,
    integrate_increments,
    rate_inertial_body_radps,
    reference_increments,
    specific_force_body_mps2,
)
from .drives import CircleMotion, WaypointMotion, circle_trajectory, waypoint_trajectory
from .fixed import StaticMotion, TurntableMotion, TurntableTrajectory
from .kinematics import LocalPlane, Motion, Trajectory

__all__ = [
    "CircleMotion",
    "InertialIncrements",
    "InertialStates",
    "Motion",
    "MotionSection",
    "StaticMotion",
    "Trajectory",
    "TurntableMotion",
    "WaypointMotion",
    "build_trajectory",
    "integrate_increments",
    "rate_inertial_body_radps",
    "reference_increments",
    "specific_force_body_mps2",
]

MotionSection = StaticMotion | TurntableMotion | CircleMotion | WaypointMotion
"""The ``[motion]`` table of a scenario."""


def build_trajectory(
    motion: MotionSection,
    *,
    latitude_rad: float,
    longitude_rad: float,
    height_m: float,
    duration_s: float,
    seed: int,
    folder: str = "",
) -> Trajectory:
    """Trajectory of a ``[motion]`` table.

    Parameters
    ----------
    motion : MotionSection
        What moves, and how.
    latitude_rad, longitude_rad, height_m : float
        The start of routes, geodetic.
    duration_s : float
        Of the scenario; the trajectory reaches 5 s further at both ends.
    seed : int
        Of the scenario; what is random about the motion (waves, unevenness, streets) has streams of its own.
    folder : str
        Folder that file names in the table are relative to.

    Returns
    -------
    Trajectory
        The motion at any instant.

    Raises
    ------
    ConfigError
        If a setting is impossible.
    """
    plane = LocalPlane(latitude_rad, longitude_rad, height_m)
    match motion:
        case StaticMotion() | TurntableMotion():
            return TurntableTrajectory.build(motion, latitude_rad, longitude_rad, height_m, duration_s)
        case CircleMotion():
            return circle_trajectory(motion, plane, seed)
        case WaypointMotion():
            return waypoint_trajectory(motion, plane, duration_s, seed)
        case _:
            assert_never(motion)
