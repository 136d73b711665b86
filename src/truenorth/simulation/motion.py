"""How a platform moves: position, velocity, acceleration, attitude and rate at any instant.

Every motion is a smooth function of time, so that receivers may sample it at their own true times and
sensors at their own rates, and all agree.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import msgspec
import numpy as np

__all__ = ["Motion", "MotionSection", "StaticMotion", "Trajectory", "build_trajectory"]


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """State of the body frame's origin at n instants.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Seconds of GPS time since the start of the scenario.
    position_ecef_m, velocity_ecef_mps, acceleration_ecef_mps2 : ndarray, shape (n, 3)
        Position and its first and second derivative in the turning ECEF frame.
    rot_ecef_from_body : ndarray, shape (n, 3, 3)
        Attitude, ``v_ecef = rot @ v_body``; body is forward, right, down.
    rate_body_radps : ndarray, shape (n, 3)
        Angular rate of the body against the Earth, in body axes.
    heading_rad, pitch_rad, roll_rad : ndarray, shape (n,)
        Attitude against the local geodetic north, east, down; heading in [0, 2 pi).
    """

    time_s: np.ndarray
    position_ecef_m: np.ndarray
    velocity_ecef_mps: np.ndarray
    acceleration_ecef_mps2: np.ndarray
    rot_ecef_from_body: np.ndarray
    rate_body_radps: np.ndarray
    heading_rad: np.ndarray
    pitch_rad: np.ndarray
    roll_rad: np.ndarray


class Trajectory(Protocol):
    """A motion that can be asked for any instant (also a little before the start and after the end)."""

    def at(self, time_s: np.ndarray) -> Motion:
        """State at instants, seconds since the start, shape (n,)."""
        ...


class StaticMotion(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="static"
):
    """A platform at rest."""

    heading_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0


MotionSection = StaticMotion


def build_trajectory(motion, *, latitude_rad, longitude_rad, height_m, duration_s, seed, folder=""):
    """Trajectory of a ``[motion]`` table; the place is that of the start."""
    raise NotImplementedError
