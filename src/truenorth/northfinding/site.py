"""Where north is sought: what gravity and the Earth's rotation are there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import ConfigError
from ..frames import ecef_from_geodetic
from ..gravity import EARTH_RATE_RADPS, gravity_ecef_mps2

__all__ = ["Site"]

POLE_RAD = np.radians(89.9)
"""Beyond it the horizontal Earth rate is below 0.03 deg/h, and a metre of east is a different north."""


@dataclass(frozen=True, slots=True)
class Site:
    """A place on the Earth where something stands still.

    Parameters
    ----------
    latitude_rad : float
        Geodetic latitude.
    longitude_rad : float
        Geodetic longitude; gravity and Earth rate do not depend on it.
    height_m : float
        Above the ellipsoid.
    latitude_sd_rad : float
        How well the latitude is known, one sigma.

    Raises
    ------
    ConfigError
        If the latitude is none, or so near a pole that there is no north to find.
    """

    latitude_rad: float
    longitude_rad: float = 0.0
    height_m: float = 0.0
    latitude_sd_rad: float = 0.0

    def __post_init__(self) -> None:
        degrees = np.degrees(self.latitude_rad)
        if not abs(degrees) <= 90.0:
            raise ConfigError(
                f"a latitude of {degrees:g} degrees was given; give -90 to 90, north positive",
                key="latitude",
                value=degrees,
            )
        if abs(self.latitude_rad) > POLE_RAD:
            raise ConfigError(
                f"at latitude {degrees:.2f} the Earth turns about the vertical and no sensor can feel north;"
                f" use satellites instead",
                key="latitude",
                value=degrees,
            )

    @property
    def gravity_mps2(self) -> float:
        """float: Magnitude of normal gravity at the place, m/s^2."""
        place = ecef_from_geodetic(self.latitude_rad, self.longitude_rad, self.height_m)
        return float(np.linalg.norm(gravity_ecef_mps2(place)))

    @property
    def earth_rate_ned_radps(self) -> np.ndarray:
        """ndarray, shape (3,): Rate of the Earth against inertial space in north, east, down, rad/s."""
        return EARTH_RATE_RADPS * np.array([np.cos(self.latitude_rad), 0.0, -np.sin(self.latitude_rad)])

    @property
    def horizontal_rate_radps(self) -> float:
        """float: The part of the Earth rate that points north, rad/s."""
        return float(EARTH_RATE_RADPS * np.cos(self.latitude_rad))

    @property
    def force_ned_mps2(self) -> np.ndarray:
        """ndarray, shape (3,): Specific force at rest in north, east, down: up by gravity, m/s^2."""
        return np.array([0.0, 0.0, -self.gravity_mps2])
