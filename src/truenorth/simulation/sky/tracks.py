"""Tracks of satellites over time: in the sky of a place, over the Earth, and among the stars."""

from dataclasses import dataclass

import numpy as np

from ...frames import azimuth_elevation_from_enu, geodetic_from_ecef, rot_enu_from_ecef
from .almanac import EARTH_RATE_RADPS, greenwich_angle_rad

__all__ = ["Tracks", "azimuth_elevation", "tracks"]


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """Where satellites are over time; NaN where they have no orbit.

    Parameters
    ----------
    time_ns : ndarray of int64, shape (n_times,)
        GPS time, nanoseconds.
    sat : ndarray of int16, shape (n_sats,)
        Satellites.
    azimuth_rad, elevation_rad : ndarray, shape (n_times, n_sats)
        Seen from the place.
    position_ecef_m, position_eci_m : ndarray, shape (n_times, n_sats, 3)
        Earth-fixed; and in axes that do not turn, x to the vernal equinox of date.
    """

    time_ns: np.ndarray
    sat: np.ndarray
    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray
    position_ecef_m: np.ndarray
    position_eci_m: np.ndarray

    def n_visible(self, elevation_mask_rad=0.0):
        """Satellites above an elevation at each time, shape (n_times,)."""
        with np.errstate(invalid="ignore"):
            return np.sum(self.elevation_rad >= elevation_mask_rad, axis=1)


def azimuth_elevation(satellite_ecef_m, position_ecef_m):
    """Azimuth and elevation of satellites from a place, without light time.

    Parameters
    ----------
    satellite_ecef_m : ndarray, shape (..., 3)
        Satellites.
    position_ecef_m : ndarray, shape (3,) or (..., 3)
        The place, or one for each satellite.

    Returns
    -------
    azimuth_rad, elevation_rad : ndarray, shape (...)
    """
    position_ecef_m = np.asarray(position_ecef_m, dtype=float)
    lat, lon, _ = geodetic_from_ecef(position_ecef_m)
    ray = satellite_ecef_m - position_ecef_m
    return azimuth_elevation_from_enu(np.einsum("...ij,...j->...i", rot_enu_from_ecef(lat, lon), ray))


def tracks(sky, position_ecef_m, time_ns):
    """Follow all satellites of a sky.

    Parameters
    ----------
    sky : truenorth.simulation.sky.Sky
        The satellites.
    position_ecef_m : ndarray, shape (3,) or (n_times, 3)
        Where they are seen from.
    time_ns : ndarray of int64, shape (n_times,)
        GPS time, nanoseconds.

    Returns
    -------
    Tracks
    """
    time_ns = np.atleast_1d(np.asarray(time_ns, dtype=np.int64))
    shape = (len(time_ns), len(sky.satellites))
    sat = np.broadcast_to(sky.satellites, shape).ravel()
    position, *_ = sky.true_states(sat, np.repeat(time_ns, shape[1]))
    position = position.reshape(*shape, 3)
    place = np.broadcast_to(np.asarray(position_ecef_m, dtype=float), (shape[0], 3))[:, None, :]
    azimuth, elevation = azimuth_elevation(position, place)
    angle = greenwich_angle_rad(int(time_ns[0])) + EARTH_RATE_RADPS * (time_ns - time_ns[0]) * 1e-9
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x, y, z = np.moveaxis(position, -1, 0)
    eci = np.stack([c * x - s * y, s * x + c * y, z], axis=-1)
    return Tracks(time_ns, sky.satellites.copy(), azimuth, elevation, position, eci)
