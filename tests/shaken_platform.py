"""A shaken platform at a known place, what ideal and noisy units in it feel, and how it points at the end."""

from functools import lru_cache

import numpy as np

from truenorth.northfinding import Site
from truenorth.rotations import log_so3, rot_ned_from_body
from truenorth.simulation.motion import SwayMotion, reference_increments
from truenorth.simulation.motion.sway import SwayTrajectory
from truenorth.strapdown import InertialIncrements

SITE = Site(np.radians(51.1), np.radians(-114.15), 1100.0)
DPH = np.radians(1.0 / 3600.0)
STILL = dict.fromkeys(("yaw", "pitch", "roll", "surge", "sway", "heave"), ())


@lru_cache(maxsize=8)
def platform(section=None, duration_s=120.0, rate_hz=20.0, site=SITE, seed=5):
    """Ideal increments and the true attitude at their end."""
    body = SwayTrajectory(
        section or SwayMotion(heading_deg=217.0, pitch_deg=3.0, roll_deg=-2.0),
        site.latitude_rad, site.longitude_rad, site.height_m, seed,
    )  # fmt: skip
    edges = np.linspace(0.0, duration_s, round(duration_s * rate_hz) + 1)
    end = body.at(edges[-1:])
    return reference_increments(body, edges), rot_ned_from_body(
        end.heading_rad[0], end.pitch_rad[0], end.roll_rad[0]
    )


def with_errors(ideal, rng, *, gyro_walk=0.0, accel_walk=0.0, gyro_bias=(0, 0, 0), accel_bias=(0, 0, 0)):
    """Increments with white noise of densities and biases, SI units."""
    step = np.diff(ideal.time_s)[:, None]
    noise = rng.standard_normal((2, *ideal.angle_rad.shape)) * np.sqrt(step)
    return InertialIncrements(
        ideal.time_s,
        ideal.angle_rad + np.asarray(gyro_bias) * step + gyro_walk * noise[0],
        ideal.velocity_mps + np.asarray(accel_bias) * step + accel_walk * noise[1],
        None,
    )


def attitude_error(found_ned_from_body, true_ned_from_body):
    """Small rotation in north, east, down by which the first exceeds the second, radians."""
    return log_so3(found_ned_from_body @ true_ned_from_body.T)
