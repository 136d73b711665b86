"""One motion of every kind, for tests that hold for all of them."""

import numpy as np

from truenorth.frames import ecef_from_geodetic
from truenorth.simulation.motion import (
    AircraftMotion,
    BodySection,
    CircleMotion,
    CircuitMotion,
    Move,
    ShipMotion,
    StaticMotion,
    Stop,
    SuburbanMotion,
    SwayMotion,
    TableTrajectory,
    TurntableMotion,
    WaypointMotion,
    build_trajectory,
)

LATITUDE_RAD, LONGITUDE_RAD, HEIGHT_M = np.radians(51.1), np.radians(-114.15), 1100.0

SECTIONS = {
    "static": StaticMotion(heading_deg=130.0, pitch_deg=4.0, roll_deg=-3.0),
    "turntable": TurntableMotion(rate_dps=7.0, tilt_deg=20.0, tilt_azimuth_deg=70.0),
    "turntable steps": TurntableMotion(steps=((0.0, 0.0), (20.0, 30.0), (60.0, -10.0), (90.0, 0.0))),
    "sway": SwayMotion(
        heading_deg=200.0,
        pitch_deg=-2.0,
        pitch_drift_deg_per_h=3.0,
        moves=(
            Move(at_s=40.0, duration_s=3.0, yaw_deg=5.0, sway_m=0.2),
            Move(at_s=70.0, duration_s=2.0, lasting=False, roll_deg=1.0, heave_m=-0.05),
        ),
    ),
    "circle": CircleMotion(clockwise=False, body=BodySection(unevenness_mps2=0.5, side_offset_deg=3.0)),
    "coordinated circle": CircleMotion(radius_m=500.0, speed_mps=50.0, coordinated=True),
    "waypoints": WaypointMotion(
        points_m=((0.0, 0.0), (0.0, 150.0, 3.0), (120.0, 200.0, -2.0), (300.0, 0.0)),
        stops=(Stop(waypoint=1, duration_s=8.0),),
    ),
    "closed waypoints": WaypointMotion(
        points_m=((0.0, 0.0), (0.0, 90.0, 2.0), (100.0, 100.0), (100.0, 0.0)),
        closed=True,
        stops=(Stop(waypoint=2, duration_s=5.0),),
    ),
    "suburban": SuburbanMotion(stationary_at_s=150.0, stationary_for_s=60.0),
    "circuit": CircuitMotion(),
    "ship": ShipMotion(),
    "aircraft": AircraftMotion(),
    "fast far aircraft": AircraftMotion(speed_mps=250.0, heading_deg=80.0),
}


def table_trajectory(duration_s):
    """A figure of eight with rolling, given at 10 Hz."""
    time_s = np.arange(-1.0, duration_s + 1.05, 0.1)
    angle = 0.05 * time_s
    latitude = LATITUDE_RAD + 2e-5 * np.sin(angle)
    longitude = LONGITUDE_RAD + 1e-5 * np.sin(2.0 * angle)
    position = ecef_from_geodetic(latitude, longitude, HEIGHT_M + 3.0 * np.cos(angle))
    roll = 0.1 * np.sin(0.7 * time_s)
    return TableTrajectory(time_s, position, np.mod(0.1 * time_s, 2.0 * np.pi), 0.5 * roll, roll)


def trajectory(kind, duration_s, seed=3):
    """Trajectory of a kind by its name."""
    if kind == "table":
        return table_trajectory(duration_s)
    return build_trajectory(
        SECTIONS[kind],
        latitude_rad=LATITUDE_RAD,
        longitude_rad=LONGITUDE_RAD,
        height_m=HEIGHT_M,
        duration_s=duration_s,
        seed=seed,
    )


KINDS = (*SECTIONS, "table")
