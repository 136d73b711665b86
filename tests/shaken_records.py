"""Records of an inertial unit on a platform of a kind of motion, with the true attitude at the end."""

import functools

import numpy as np

from truenorth.frames import rot_ned_from_ecef
from truenorth.northfinding.site import Site
from truenorth.sensors.imu import imu_increments_from_log, simulate_imu
from truenorth.simulation.motion import build_trajectory
from truenorth.simulation.randomness import stream
from truenorth.strapdown import InertialIncrements, reference_increments

SITE = Site(np.radians(40.0), 0.3, 100.0)

QUIET = {"yaw": (), "pitch": (), "roll": (), "surge": (), "sway": (), "heave": ()}
"""Settings of a swaying platform that does not sway."""


def trajectory_at_site(motion, seconds):
    """Trajectory of a section at the site."""
    return build_trajectory(
        motion,
        latitude_rad=SITE.latitude_rad,
        longitude_rad=SITE.longitude_rad,
        height_m=SITE.height_m,
        duration_s=seconds,
        seed=5,
    )


def true_attitude(trajectory, instants_s):
    """True attitude against the north, east, down of the site, shape (n, 3, 3)."""
    frame = rot_ned_from_ecef(SITE.latitude_rad, SITE.longitude_rad)
    return frame @ trajectory.at(np.atleast_1d(instants_s)).rot_ecef_from_body


def ideal_record(motion, seconds, rate_hz=20.0):
    """What a unit without errors feels, and the true attitude at the end."""
    trajectory = trajectory_at_site(motion, seconds)
    ideal = reference_increments(trajectory, np.arange(round(seconds * rate_hz) + 1) / rate_hz)
    return ideal, true_attitude(trajectory, seconds)[0]


def drawn_record(trajectory, unit, seconds, seed):
    """What a unit with errors gives, and its log."""
    log = simulate_imu(
        unit, trajectory, start_ns=0, duration_s=seconds, generator=functools.partial(stream, seed)
    )
    angle, velocity = imu_increments_from_log(unit, log)
    return InertialIncrements(np.arange(len(angle) + 1) / unit.rate_hz, angle, velocity), log
