"""What lies between satellite and antenna: ionosphere, troposphere, and the sources' simpler worlds."""

from __future__ import annotations

from typing import Literal

import msgspec
import numpy as np

from ..errors import ConfigError
from ..frames import geodetic_from_ecef
from ..timescales import NS_PER_DAY

__all__ = ["EnvironmentSection", "ionosphere_l1_m", "troposphere_m"]


class EnvironmentSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The ``[environment]`` table."""

    signal_model: Literal["full", "oguz_2006"] = "full"
    """``full``: every term on code and phase. ``oguz_2006``: phases are those of the error-free range,
    without clocks or atmosphere; codes have white noise of 0.7 m from the satellite's clock and 0.5 m each
    from ionosphere and troposphere (Oguz 2006, sec. 2.2.5; the clock's bias of 2 m is that of the sky)."""
    ionosphere: Literal["klobuchar", "none"] = "klobuchar"
    ionosphere_factor: float = 1.0
    """The true delay is so many times what the broadcast model says."""
    ionosphere_gradient_mm_per_km: tuple[float, float] = (0.0, 0.0)
    """Slope of the vertical L1 delay to the north and to the east, from the start of the scenario."""
    troposphere: Literal["saastamoinen", "oguz_2006", "none"] = "saastamoinen"
    humidity: float = 0.7
    """Relative humidity of the standard atmosphere."""
    phase_windup: bool = True
    """Rotation of the antennas against the satellites turns the carrier (Wu et al. 1993)."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.humidity <= 1.0:
            raise ConfigError(
                f"`humidity` is {self.humidity!r}; give a share between 0 and 1",
                key="humidity",
                value=self.humidity,
            )
        if not self.ionosphere_factor >= 0.0:
            value = self.ionosphere_factor
            raise ConfigError(
                f"`ionosphere_factor` is {value!r}; give 0 or more", key="ionosphere_factor", value=value
            )


def ionosphere_l1_m(
    section: EnvironmentSection,
    coefficients: np.ndarray | None,
    origin_ecef_m: np.ndarray,
    position_ecef_m: np.ndarray,
    azimuth_rad: np.ndarray,
    elevation_rad: np.ndarray,
    time_ns: np.ndarray,
) -> np.ndarray:
    """Slant delay of an L1 code, metres.

    Parameters
    ----------
    section : EnvironmentSection
        The model.
    coefficients : ndarray, shape (8,), or None
        Klobuchar's, of the broadcast; None for no ionosphere.
    origin_ecef_m : ndarray, shape (3,)
        Where the gradient counts from.
    position_ecef_m : ndarray, shape (n, 3)
        Antennas.
    azimuth_rad, elevation_rad : ndarray, shape (n,)
        Directions of the satellites.
    time_ns : ndarray of int64, shape (n,)
        GPS time.

    Returns
    -------
    ndarray, shape (n,)
    """
    if section.ionosphere == "none":
        return np.zeros(len(azimuth_rad))
    from ..orbits.atmosphere import klobuchar_delay_m

    latitude, longitude, _ = geodetic_from_ecef(position_ecef_m)
    elevation = np.maximum(elevation_rad, 0.0)
    delay = np.zeros(len(azimuth_rad))
    if coefficients is not None:
        day_s = (time_ns % NS_PER_DAY) * 1e-9
        delay = section.ionosphere_factor * klobuchar_delay_m(
            coefficients, latitude, longitude, azimuth_rad, elevation, day_s
        )
    if any(section.ionosphere_gradient_mm_per_km):
        lat0, lon0, _ = geodetic_from_ecef(origin_ecef_m)
        north_m = (latitude - lat0) * 6.371e6
        east_m = (longitude - lon0) * 6.371e6 * np.cos(lat0)
        vertical = 1e-6 * (np.array(section.ionosphere_gradient_mm_per_km) @ np.array([north_m, east_m]))
        # Thin shell at 350 km.
        delay = delay + vertical / np.sqrt(1.0 - (6371.0 / 6721.0 * np.cos(elevation)) ** 2)
    return delay


def troposphere_m(
    section: EnvironmentSection, position_ecef_m: np.ndarray, elevation_rad: np.ndarray
) -> np.ndarray:
    """Slant delay of the troposphere, metres; arguments as `ionosphere_l1_m`.

    ``oguz_2006`` is 2.47 / (sin E + 0.0121), his eq. (2.17).
    """
    if section.troposphere == "none":
        return np.zeros(len(elevation_rad))
    if section.troposphere == "oguz_2006":
        return 2.47 / (np.sin(np.maximum(elevation_rad, 0.0)) + 0.0121)
    from ..orbits.atmosphere import saastamoinen_delay_m

    latitude, _, height = geodetic_from_ecef(position_ecef_m)
    return saastamoinen_delay_m(latitude, height, elevation_rad, humidity=section.humidity)
