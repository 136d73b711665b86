r"""States of motion, and how they are put together without a gap between their derivatives.

A route is drawn in a plane that touches the Earth at the start of the scenario, with heights apart. A point
of the plane goes to the geodetic position of its foot on the ellipsoid, which then is given its own height,
so that heights stay heights however far the route leads; lengths shrink by :math:`d^2/2R^2` (3e-5 at 50 km).
Velocity, acceleration, heading and rates are the exact time derivatives of that mapping: with the radii of
curvature M and N,

.. math:: \dot\varphi = v_N/(M+h),\quad \dot\lambda = v_E/((N+h)\cos\varphi),\quad
    \omega^n_{en} = (\dot\lambda\cos\varphi, -\dot\varphi, -\dot\lambda\sin\varphi).

References
----------
Groves, P. D., Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed. (2013),
sec. 2.3 to 2.5 and 5.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...frames import (
    WGS84_A_M,
    WGS84_E2,
    ecef_from_geodetic,
    geodetic_from_ecef,
    rot_enu_from_ecef,
    rot_ned_from_ecef,
)
from ...rotations import body_rate_from_euler_rates, heading_pitch_roll, rot_ned_from_body

__all__ = ["Attitude", "LocalPlane", "Motion", "Place", "Trajectory", "motion_of", "place_from_ecef"]


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

    def distance_m(self, time_s: np.ndarray) -> np.ndarray:
        """Distance along the route since its start, on the map, shape (n,)."""
        ...

    def course_rad(self, time_s: np.ndarray) -> np.ndarray:
        """Direction of travel, clockwise from north in [0, 2 pi), shape (n,); held while at rest."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Where something is at n instants, how that changes, and the local level frame there.

    Parameters
    ----------
    position_ecef_m, velocity_ecef_mps, acceleration_ecef_mps2 : ndarray, shape (n, 3)
        Position and its time derivatives.
    rot_ned_from_ecef : ndarray, shape (n, 3, 3)
        Local geodetic north, east, down.
    transport_ned_radps : ndarray, shape (n, 3)
        Angular rate of the local level frame against the Earth, in its own axes.
    """

    position_ecef_m: np.ndarray
    velocity_ecef_mps: np.ndarray
    acceleration_ecef_mps2: np.ndarray
    rot_ned_from_ecef: np.ndarray
    transport_ned_radps: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Attitude:
    """Attitude against the local level frame at n instants, and its rate.

    Parameters
    ----------
    rot_ned_from_body : ndarray, shape (n, 3, 3)
        Attitude.
    rate_body_radps : ndarray, shape (n, 3)
        Angular rate of the body against the local level frame, in body axes.
    """

    rot_ned_from_body: np.ndarray
    rate_body_radps: np.ndarray

    @classmethod
    def from_angles(
        cls,
        heading: tuple[np.ndarray, np.ndarray],
        pitch: tuple[np.ndarray, np.ndarray],
        roll: tuple[np.ndarray, np.ndarray],
    ) -> Attitude:
        """Attitude of heading, pitch and roll, each given with its rate, radians and rad/s."""
        return cls(
            rot_ned_from_body(heading[0], pitch[0], roll[0]),
            body_rate_from_euler_rates(pitch[0], roll[0], heading[1], pitch[1], roll[1]),
        )


def motion_of(time_s: np.ndarray, place: Place, attitude: Attitude) -> Motion:
    """Motion of a body from its place and its attitude against the local level there.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Instants.
    place : Place
        Position and derivatives.
    attitude : Attitude
        Attitude and rate against the local level frame; its rate against the Earth is made by adding that
        of the frame.

    Returns
    -------
    Motion
        The whole.
    """
    transport = np.einsum("nji,nj->ni", attitude.rot_ned_from_body, place.transport_ned_radps)
    heading, pitch, roll = heading_pitch_roll(attitude.rot_ned_from_body)
    return Motion(
        time_s=time_s,
        position_ecef_m=place.position_ecef_m,
        velocity_ecef_mps=place.velocity_ecef_mps,
        acceleration_ecef_mps2=place.acceleration_ecef_mps2,
        rot_ecef_from_body=np.swapaxes(place.rot_ned_from_ecef, -1, -2) @ attitude.rot_ned_from_body,
        rate_body_radps=attitude.rate_body_radps + transport,
        heading_rad=heading,
        pitch_rad=pitch,
        roll_rad=roll,
    )


def _radii(sin_lat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Radii of curvature in the meridian and across it, metres."""
    w2 = 1.0 - WGS84_E2 * sin_lat**2
    across = WGS84_A_M / np.sqrt(w2)
    return across * (1.0 - WGS84_E2) / w2, across


def place_from_ecef(
    position_ecef_m: np.ndarray, velocity_ecef_mps: np.ndarray, acceleration_ecef_mps2: np.ndarray
) -> Place:
    """Place of a motion that is known in ECEF.

    Parameters
    ----------
    position_ecef_m, velocity_ecef_mps, acceleration_ecef_mps2 : ndarray, shape (n, 3)
        Position and its time derivatives.

    Returns
    -------
    Place
        With the local level frame and its rate.
    """
    latitude, longitude, height = geodetic_from_ecef(position_ecef_m)
    frame = rot_ned_from_ecef(latitude, longitude)
    meridian, across = _radii(np.sin(latitude))
    north, east, _ = np.moveaxis(np.einsum("nij,nj->ni", frame, velocity_ecef_mps), -1, 0)
    east_rate = east / (across + height)
    transport = np.stack((east_rate, -north / (meridian + height), -east_rate * np.tan(latitude)), axis=-1)
    return Place(position_ecef_m, velocity_ecef_mps, acceleration_ecef_mps2, frame, transport)


class LocalPlane:
    """The plane that touches the Earth at the start of a scenario, in which routes are drawn.

    Parameters
    ----------
    latitude_rad, longitude_rad, height_m : float
        Where it touches, geodetic; heights of routes count from ``height_m``.
    """

    def __init__(self, latitude_rad: float, longitude_rad: float, height_m: float) -> None:
        self.height_m = float(height_m)
        self.origin_ecef_m = ecef_from_geodetic(latitude_rad, longitude_rad, height_m)
        self.east_north_ecef = rot_enu_from_ecef(latitude_rad, longitude_rad)[:2]

    def place(
        self,
        east_north: tuple[np.ndarray, np.ndarray, np.ndarray],
        up: tuple[np.ndarray, np.ndarray, np.ndarray],
        direction: tuple[np.ndarray, np.ndarray],
    ) -> tuple[Place, np.ndarray, np.ndarray]:
        """Place of a point of the plane, and what a direction in the plane is from true north there.

        Parameters
        ----------
        east_north : tuple of ndarray, shape (n, 2)
            Coordinates in the plane and their first and second time derivatives, metres.
        up : tuple of ndarray, shape (n,)
            Height above that of the origin, and its derivatives.
        direction : tuple of ndarray, shape (n, 2)
            A direction in the plane (east, north), not zero, and its time derivative.

        Returns
        -------
        place : Place
            The point on the Earth.
        azimuth_rad, azimuth_rate_radps : ndarray, shape (n,)
            The direction, clockwise from north, in (-pi, pi], and its time derivative. That of the velocity
            in the plane is exactly the course over the ground.
        """
        foot, foot1, foot2 = (value @ self.east_north_ecef for value in east_north)
        latitude, longitude, foot_height = geodetic_from_ecef(self.origin_ecef_m + foot)
        frame = rot_ned_from_ecef(latitude, longitude)
        sin_lat, cos_lat = np.sin(latitude), np.cos(latitude)
        meridian, across = _radii(sin_lat)
        # First derivatives: of latitude, longitude and the height of the plane, then of the radii.
        v_north, v_east, v_down = np.moveaxis(np.einsum("nij,nj->ni", frame, foot1), -1, 0)
        north_arm, east_arm = meridian + foot_height, across + foot_height
        lat1, lon1 = v_north / north_arm, v_east / (east_arm * cos_lat)
        w2 = 1.0 - WGS84_E2 * sin_lat**2
        curve = WGS84_E2 * sin_lat * cos_lat / w2 * lat1
        meridian1, across1 = 3.0 * meridian * curve, across * curve
        transport = np.stack((lon1 * cos_lat, -lat1, -lon1 * sin_lat), axis=-1)
        # Second derivatives: components in a turning frame change by their own cross product with its rate.
        velocity_ned = np.stack((v_north, v_east, v_down), axis=-1)
        change = np.einsum("nij,nj->ni", frame, foot2) - np.cross(transport, velocity_ned)
        lat2 = (change[:, 0] - lat1 * (meridian1 - v_down)) / north_arm
        lon2 = (change[:, 1] + lon1 * (v_down * cos_lat + north_arm * sin_lat * lat1)) / (east_arm * cos_lat)
        # The same point with its own height instead of that of the plane.
        height, up1, up2 = self.height_m + up[0], up[1], up[2]
        north_own, east_own = meridian + height, across + height
        velocity_ned = np.stack((north_own * lat1, east_own * cos_lat * lon1, -up1), axis=-1)
        change = np.stack(
            (
                north_own * lat2 + (meridian1 + up1) * lat1,
                east_own * cos_lat * lon2 + (up1 * cos_lat - north_own * sin_lat * lat1) * lon1,
                -up2,
            ),
            axis=-1,
        )
        place = Place(
            ecef_from_geodetic(latitude, longitude, height),
            np.einsum("nji,nj->ni", frame, velocity_ned),
            np.einsum("nji,nj->ni", frame, change + np.cross(transport, velocity_ned)),
            frame,
            transport,
        )
        # The direction is stretched like the velocity is.
        along, along1 = (value @ self.east_north_ecef for value in direction)
        along_ned = np.einsum("nij,nj->ni", frame, along)
        along_ned1 = np.einsum("nij,nj->ni", frame, along1) - np.cross(transport, along_ned)
        stretch_n, stretch_e = north_own / north_arm, east_own / east_arm
        stretch_n1 = (meridian1 + up1 - stretch_n * (meridian1 - v_down)) / north_arm
        stretch_e1 = (across1 + up1 - stretch_e * (across1 - v_down)) / east_arm
        north, east = stretch_n * along_ned[:, 0], stretch_e * along_ned[:, 1]
        north1 = stretch_n * along_ned1[:, 0] + stretch_n1 * along_ned[:, 0]
        east1 = stretch_e * along_ned1[:, 1] + stretch_e1 * along_ned[:, 1]
        azimuth_rate = (north * east1 - east * north1) / (north**2 + east**2)
        return place, np.arctan2(east, north), azimuth_rate
