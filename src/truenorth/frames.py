"""Earth frames: ECEF, geodetic and local level, and the angles of a vector in them.

NED is the navigation frame of the package; ENU appears at the edges by name. Azimuth is clockwise
from true north. Ellipsoid: WGS 84.
"""

import numpy as np
from numpy.typing import ArrayLike

__all__ = [
    "WGS84_A_M",
    "WGS84_E2",
    "azimuth_elevation_from_enu",
    "ecef_from_geodetic",
    "geodetic_from_ecef",
    "rot_enu_from_ecef",
    "rot_ned_from_ecef",
]

WGS84_A_M = 6_378_137.0
WGS84_F = 1.0 / 298.257_223_563
WGS84_E2 = WGS84_F * (2.0 - WGS84_F)


def ecef_from_geodetic(
    latitude_rad: float | np.ndarray, longitude_rad: float | np.ndarray, height_m: float | np.ndarray
) -> np.ndarray:
    """Geodetic coordinates on WGS 84 to ECEF.

    Parameters
    ----------
    latitude_rad, longitude_rad, height_m : float or ndarray
        Geodetic latitude, longitude (radians) and ellipsoidal height (metres); broadcast together.

    Returns
    -------
    ndarray, shape (..., 3)
        ECEF position, metres.
    """
    sin_lat, cos_lat = np.sin(latitude_rad), np.cos(latitude_rad)
    n = WGS84_A_M / np.sqrt(1.0 - WGS84_E2 * sin_lat**2)
    return np.stack(
        np.broadcast_arrays(
            (n + height_m) * cos_lat * np.cos(longitude_rad),
            (n + height_m) * cos_lat * np.sin(longitude_rad),
            (n * (1.0 - WGS84_E2) + height_m) * sin_lat,
        ),
        axis=-1,
    )


def geodetic_from_ecef(position_ecef_m: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """ECEF to geodetic coordinates on WGS 84, by Bowring's form iterated to machine precision.

    Parameters
    ----------
    position_ecef_m : ndarray, shape (..., 3)
        Position, metres; not the centre of the Earth.

    Returns
    -------
    latitude_rad, longitude_rad, height_m : ndarray, shape (...)
        Radians, radians, metres.
    """
    x, y, z = np.moveaxis(np.asarray(position_ecef_m, dtype=float), -1, 0)
    p = np.hypot(x, y)
    b = WGS84_A_M * (1.0 - WGS84_F)
    beta = np.arctan2(WGS84_A_M * z, b * p)
    for _ in range(4):
        lat = np.arctan2(
            z + WGS84_E2 / (1.0 - WGS84_E2) * b * np.sin(beta) ** 3,
            p - WGS84_E2 * WGS84_A_M * np.cos(beta) ** 3,
        )
        beta = np.arctan2((1.0 - WGS84_F) * np.sin(lat), np.cos(lat))
    sin_lat, cos_lat = np.sin(lat), np.cos(lat)
    # This form of the height has no singularity, at the poles or the equator.
    height = p * cos_lat + z * sin_lat - WGS84_A_M * np.sqrt(1.0 - WGS84_E2 * sin_lat**2)
    return lat, np.arctan2(y, x), height


def rot_enu_from_ecef(latitude_rad: float | np.ndarray, longitude_rad: float | np.ndarray) -> np.ndarray:
    """Rotation from ECEF to local east, north, up at a geodetic position.

    Parameters
    ----------
    latitude_rad, longitude_rad : float or ndarray
        Geodetic latitude and longitude, radians.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        ``v_enu = rot @ v_ecef``.
    """
    latitude_rad, longitude_rad = np.broadcast_arrays(latitude_rad, longitude_rad)
    sp, cp = np.sin(latitude_rad), np.cos(latitude_rad)
    sl, cl = np.sin(longitude_rad), np.cos(longitude_rad)
    zero = np.zeros_like(sp)
    rows = [(-sl, cl, zero), (-sp * cl, -sp * sl, cp), (cp * cl, cp * sl, sp)]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rot_ned_from_ecef(latitude_rad: float | np.ndarray, longitude_rad: float | np.ndarray) -> np.ndarray:
    """Rotation from ECEF to local north, east, down; arguments as `rot_enu_from_ecef`."""
    enu = rot_enu_from_ecef(latitude_rad, longitude_rad)
    return np.stack([enu[..., 1, :], enu[..., 0, :], -enu[..., 2, :]], axis=-2)


def azimuth_elevation_from_enu(vector_enu: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth (clockwise from north, [0, 2 pi)) and elevation of vectors, radians.

    Parameters
    ----------
    vector_enu : ndarray, shape (..., 3)
        East, north, up; any unit.

    Returns
    -------
    azimuth_rad, elevation_rad : ndarray, shape (...)
    """
    east, north, up = np.moveaxis(np.asarray(vector_enu, dtype=float), -1, 0)
    azimuth = np.mod(np.arctan2(east, north), 2.0 * np.pi)
    return azimuth, np.arctan2(up, np.hypot(east, north))
