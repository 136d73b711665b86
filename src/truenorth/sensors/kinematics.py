"""What sensors on a moving body feel, beyond `truenorth.strapdown`.

The apparent vertical, the integral of the rate, the turning of the local level frame, and the motion of a
point beside the body's origin.

References
----------
P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed. (2013),
sec. 2.4, 5.3 to 5.5.
J. E. Bortz, "A new mathematical formulation for strapdown inertial navigation", IEEE Transactions on
Aerospace and Electronic Systems 7 (1971), 61-66 (the rotation vector against the integrated rate).
"""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np

from ..frames import WGS84_A_M, WGS84_E2
from ..gravity import EARTH_RATE_RADPS
from ..rotations import log_so3
from ..strapdown import rate_inertial_body_radps
from .sampling import blocks

__all__ = [
    "Mover",
    "PointOfBody",
    "angle_integrals",
    "apparent_tilt",
    "earth_rate_ned",
    "frame_rate_ned",
]


class Mover(Protocol):
    """What a sensor rides on: gives its motion at any instant."""

    def at(self, time_s: np.ndarray) -> Any:
        """Position, velocity, acceleration, attitude and rate at instants, as arrays."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class PointOfBody:
    """A point that is fixed in a moving body, as a mover of its own, without acceleration.

    Parameters
    ----------
    mover : object with ``at(time_s)``
        The body.
    place_body_m : ndarray, shape (3,)
        Forward, right, down of the body's origin, metres.
    """

    mover: Mover
    place_body_m: np.ndarray

    def at(self, time_s: np.ndarray) -> Any:
        """Position, velocity, attitude and rate at instants."""
        body = self.mover.at(time_s)
        arm_ecef = body.rot_ecef_from_body @ self.place_body_m
        swing_body = np.cross(body.rate_body_radps, self.place_body_m)
        return SimpleNamespace(
            time_s=body.time_s,
            position_ecef_m=body.position_ecef_m + arm_ecef,
            velocity_ecef_mps=body.velocity_ecef_mps
            + np.einsum("nij,nj->ni", body.rot_ecef_from_body, swing_body),
            rot_ecef_from_body=body.rot_ecef_from_body,
            rate_body_radps=body.rate_body_radps,
        )


def apparent_tilt(force_body: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pitch and roll that a bubble at rest in this specific force would show.

    Parameters
    ----------
    force_body : ndarray, shape (..., 3)
        Specific force in body axes, any unit.

    Returns
    -------
    pitch_rad, roll_rad : ndarray, shape (...)
        Nose-up and right-side-down positive; the true ones where nothing accelerates.
    """
    x, y, z = np.moveaxis(force_body, -1, 0)
    return np.arctan2(x, np.hypot(y, z)), np.arctan2(-y, -z)


def angle_integrals(mover: Mover, time_s: np.ndarray, parts: int = 4) -> np.ndarray:
    """Integral of the inertial rate in body axes over intervals: what ideal rate gyros add up.

    Parameters
    ----------
    mover : object with ``at(time_s)``
        The motion.
    time_s : ndarray, shape (n + 1,)
        Rising instants.
    parts : int
        Each interval is cut into so many.

    Returns
    -------
    ndarray, shape (n, 3)
        Radians.

    Notes
    -----
    Over each part the rotation vector Phi comes from the exact change of attitude; the integrated
    rate differs from it by coning, ``Phi - dt^2 / 12 * w0 x w1`` with the rates at both ends, which is
    exact for a rate that changes linearly (Bortz 1971).
    """
    n = len(time_s) - 1
    total = np.empty((n, 3))
    for rows in blocks(n, 20_000 // parts):
        edges = time_s[rows.start : rows.stop + 1]
        fine = np.linspace(edges[:-1], edges[1:], parts, endpoint=False, axis=-1)
        instants = np.append(fine.ravel(), edges[-1])
        motion = mover.at(instants)
        step = np.diff(instants)
        # Into the axes of the Earth as it has turned by the end of a part.
        turn = EARTH_RATE_RADPS * step
        spin = np.zeros((len(step), 3, 3))
        spin[:, 0, 0] = spin[:, 1, 1] = np.cos(turn)
        spin[:, 0, 1], spin[:, 1, 0] = -np.sin(turn), np.sin(turn)
        spin[:, 2, 2] = 1.0
        rot = motion.rot_ecef_from_body
        change = np.swapaxes(rot[:-1], -1, -2) @ spin @ rot[1:]
        rate = rate_inertial_body_radps(motion)
        coning = step[:, None] ** 2 / 12.0 * np.cross(rate[:-1], rate[1:])
        total[rows] = (log_so3(change) - coning).reshape(-1, parts, 3).sum(axis=1)
    return total


def earth_rate_ned(latitude_rad: float | np.ndarray) -> np.ndarray:
    """Rate of the Earth in north, east, down, shape (..., 3), rad/s."""
    latitude_rad = np.asarray(latitude_rad, dtype=float)
    return EARTH_RATE_RADPS * np.stack(
        [np.cos(latitude_rad), np.zeros_like(latitude_rad), -np.sin(latitude_rad)], axis=-1
    )


def frame_rate_ned(
    latitude_rad: float | np.ndarray,
    height_m: float | np.ndarray = 0.0,
    velocity_ned_mps: np.ndarray | None = None,
) -> np.ndarray:
    """Rate of the local north-east-down frame against inertial space: Earth rate and transport rate.

    Parameters
    ----------
    latitude_rad, height_m : float or ndarray, shape (...)
        Geodetic latitude, radians, and height, metres.
    velocity_ned_mps : ndarray, shape (..., 3), optional
        Velocity over ground; left out, the frame stands.

    Returns
    -------
    ndarray, shape (..., 3)
        In north, east, down, rad/s (Groves 2013, eq. 5.41, 5.44).
    """
    rate = earth_rate_ned(latitude_rad)
    if velocity_ned_mps is None:
        return rate
    north, east, _ = np.moveaxis(np.asarray(velocity_ned_mps, dtype=float), -1, 0)
    root = np.sqrt(1.0 - WGS84_E2 * np.sin(latitude_rad) ** 2)
    across = WGS84_A_M / root + height_m
    along = WGS84_A_M * (1.0 - WGS84_E2) / root**3 + height_m
    return rate + np.stack([east / across, -north / along, -east * np.tan(latitude_rad) / across], axis=-1)
