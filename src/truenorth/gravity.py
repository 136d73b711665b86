r"""Gravity: the normal field of WGS 84, exact at any height, in ECEF.

The level ellipsoid that turns with the Earth has a closed gravity field. In ellipsoidal-harmonic coordinates
u (semi-minor axis of the confocal ellipsoid through the point) and \beta (reduced latitude on it), with the
linear excentricity E:

.. math::
    w\,\gamma_u &= -\frac{GM}{u^2+E^2} - \frac{\omega^2a^2E}{u^2+E^2}\frac{q'}{q_0}
        \left(\tfrac12\sin^2\beta-\tfrac16\right)\\
    w\,\gamma_\beta &= \frac{\omega^2a^2}{\sqrt{u^2+E^2}}\frac{q}{q_0}\sin\beta\cos\beta

is the gravitation; gravity adds the centrifugal acceleration. On the ellipsoid it is Somigliana's formula.
Deflections of the vertical and anomalies (up to 0.02 deg and some 1e-3 m/s^2) are not part of it.

References
----------
NGA.STND.0036_1.0.0_WGS84, Department of Defense World Geodetic System 1984 (2014), sec. 4.
Heiskanen, W. A., Moritz, H., Physical Geodesy (1967), sec. 2-7 to 2-9.
"""

import numpy as np
from numpy.typing import ArrayLike

from .frames import WGS84_A_M, WGS84_F

__all__ = ["EARTH_RATE_RADPS", "gravitation_ecef_mps2", "gravity_ecef_mps2", "normal_gravity_mps2"]

EARTH_RATE_RADPS = 7.2921151467e-5
"""Rate of the Earth against inertial space, rad/s (IS-GPS-200; WGS 84 rounds it in the ninth digit)."""

_GM = 3.986004418e14
_B = WGS84_A_M * (1.0 - WGS84_F)
_E = np.sqrt(WGS84_A_M**2 - _B**2)
_WGS84_RATE_RADPS = 7.292115e-5  # the defining constant of the normal field


def _q(u: ArrayLike) -> np.ndarray:
    """Legendre function of the second kind of degree 2, up to its factor."""
    ratio = np.asarray(u) / _E
    return 0.5 * ((1.0 + 3.0 * ratio**2) * np.arctan(1.0 / ratio) - 3.0 * ratio)


_Q0 = float(_q(_B))


def gravitation_ecef_mps2(position_ecef_m: ArrayLike) -> np.ndarray:
    """Attraction of the Earth's mass, without the centrifugal acceleration.

    Parameters
    ----------
    position_ecef_m : ndarray, shape (..., 3)
        Position, metres; outside the Earth or a little below its surface.

    Returns
    -------
    ndarray, shape (..., 3)
        Acceleration in ECEF axes, m/s^2.
    """
    position = np.asarray(position_ecef_m, dtype=float)
    x, y, z = position[..., 0], position[..., 1], position[..., 2]
    axial = np.hypot(x, y)
    excess = axial**2 + z**2 - _E**2
    u2 = 0.5 * excess * (1.0 + np.sqrt(1.0 + (2.0 * _E * z / excess) ** 2))
    u, v2 = np.sqrt(u2), u2 + _E**2
    v = np.sqrt(v2)
    beta = np.arctan2(z * v, u * axial)
    sb, cb = np.sin(beta), np.cos(beta)
    w = np.sqrt((u2 + _E**2 * sb**2) / v2)
    turning = (_WGS84_RATE_RADPS * WGS84_A_M) ** 2
    q_prime = 3.0 * (1.0 + u2 / _E**2) * (1.0 - u / _E * np.arctan(_E / u)) - 1.0
    along_u = -(_GM + turning * _E * q_prime / _Q0 * (0.5 * sb**2 - 1.0 / 6.0)) / (v2 * w)
    along_beta = turning * _q(u) / _Q0 * sb * cb / (v * w)
    # The unit vectors of u and beta, in the meridian and then in ECEF; on the axis the meridian is free.
    outward = (along_u * u / v * cb - along_beta * sb) / w
    north = (along_u * sb + along_beta * u / v * cb) / w
    longitude = np.arctan2(y, x)
    return np.stack((outward * np.cos(longitude), outward * np.sin(longitude), north), axis=-1)


def gravity_ecef_mps2(position_ecef_m: ArrayLike) -> np.ndarray:
    """Gravity as felt on the turning Earth: gravitation and centrifugal acceleration.

    Parameters
    ----------
    position_ecef_m : ndarray, shape (..., 3)
        Position, metres.

    Returns
    -------
    ndarray, shape (..., 3)
        Acceleration in ECEF axes, m/s^2.
    """
    position = np.asarray(position_ecef_m, dtype=float)
    return gravitation_ecef_mps2(position) + EARTH_RATE_RADPS**2 * position * (1.0, 1.0, 0.0)


def normal_gravity_mps2(latitude_rad: ArrayLike) -> np.ndarray:
    """Normal gravity on the ellipsoid by Somigliana's formula.

    Parameters
    ----------
    latitude_rad : float or ndarray
        Geodetic latitude, radians.

    Returns
    -------
    ndarray
        Magnitude, m/s^2.
    """
    sin2 = np.sin(latitude_rad) ** 2
    e2 = WGS84_F * (2.0 - WGS84_F)
    return 9.7803253359 * (1.0 + 0.001931852652458 * sin2) / np.sqrt(1.0 - e2 * sin2)
