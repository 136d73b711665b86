"""How a platform moves: position, velocity, acceleration, attitude and rate at any instant.

Every motion is a smooth function of time, so that receivers may sample it at their own true times and
sensors at their own rates, and all agree. There is no step in acceleration or angular rate. The kinds of
motion are the alternatives of the ``[motion]`` table of a scenario, by their ``kind``.
"""

from __future__ import annotations

from typing import assert_never

from ...strapdown import (
    InertialIncrements,
    InertialStates,
    integrate_increments,
    rate_inertial_body_radps,
    reference_increments,
    specific_force_body_mps2,
)
from .circuit import CircuitLap, CircuitMotion, circuit_trajectory
from .drives import CircleMotion, Stop, WaypointMotion, circle_trajectory, waypoint_trajectory
from .fixed import StaticMotion, TurntableMotion, TurntableTrajectory
from .flights import AircraftLeg, AircraftMotion, aircraft_trajectory
from .kinematics import LocalPlane, Motion, Trajectory
from .routes import BodySection
from .sea import Oscillation, ShipLeg, ShipMotion, ship_trajectory
from .suburb import SuburbanMotion, suburban_trajectory
from .sway import Move, SwayMotion, SwayTrajectory
from .table import TableMotion, TableTrajectory, read_motion_table

__all__ = [
    "AircraftLeg",
    "AircraftMotion",
    "BodySection",
    "CircleMotion",
    "CircuitLap",
    "CircuitMotion",
    "InertialIncrements",
    "InertialStates",
    "Motion",
    "MotionSection",
    "Move",
    "Oscillation",
    "ShipLeg",
    "ShipMotion",
    "StaticMotion",
    "Stop",
    "SuburbanMotion",
    "SwayMotion",
    "TableMotion",
    "TableTrajectory",
    "Trajectory",
    "TurntableMotion",
    "WaypointMotion",
    "build_trajectory",
    "integrate_increments",
    "rate_inertial_body_radps",
    "reference_increments",
    "specific_force_body_mps2",
]

MotionSection = (
    StaticMotion
    | TurntableMotion
    | SwayMotion
    | CircleMotion
    | WaypointMotion
    | SuburbanMotion
    | CircuitMotion
    | ShipMotion
    | AircraftMotion
    | TableMotion
)
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
        The start of routes, geodetic; a table has positions of its own.
    duration_s : float
        Of the scenario; the trajectory reaches 5 s further at both ends.
    seed : int
        Of the scenario; what is random about the motion (waves, shaking, unevenness, streets) has streams of
        its own.
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
        case SwayMotion():
            return SwayTrajectory(motion, latitude_rad, longitude_rad, height_m, seed)
        case CircleMotion():
            return circle_trajectory(motion, plane, seed)
        case WaypointMotion():
            return waypoint_trajectory(motion, plane, duration_s, seed)
        case SuburbanMotion():
            return suburban_trajectory(motion, plane, duration_s, seed)
        case CircuitMotion():
            return circuit_trajectory(motion, plane, duration_s, seed)
        case ShipMotion():
            return ship_trajectory(motion, plane, duration_s, seed)
        case AircraftMotion():
            return aircraft_trajectory(motion, plane, duration_s)
        case TableMotion():
            return read_motion_table(motion, duration_s=duration_s, folder=folder)
        case _:
            assert_never(motion)
