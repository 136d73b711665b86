r"""Gauss-Krueger plane coordinates to geodetic ones and back.

From the northing y the arc of the meridian gives the footpoint latitude, with n = (a - b) / (a + b)

    phi_f = s + beta sin 2s + gamma sin 4s + delta sin 6s + epsilon sin 8s,     s = y / alpha
    alpha = (a + b) / 2 (1 + n^2 / 4 + n^4 / 64)
    beta = 3/2 n - 27/32 n^3 + 269/512 n^5,     gamma = 21/16 n^2 - 55/32 n^4
    delta = 151/96 n^3 - 417/128 n^5,           epsilon = 1097/512 n^4

and series in the easting x from the central meridian give latitude and longitude, with t = tan phi_f,
eta^2 = e'^2 cos^2 phi_f and N = a^2 / (b sqrt(1 + eta^2)). Within 4 degrees of the meridian there and back
agree to a tenth of a millimetre.

References
----------
B. Hofmann-Wellenhof, H. Lichtenegger, E. Wasle, "GNSS: global navigation satellite systems", 2008, ch. 8;
K. Landfahrer, "Attitude determination using a GPS multi antenna array", MSc thesis, TU Graz, 2009, eqs.
(4.7) to (4.9), with cos^2 in place of cos in eta^2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..frames import ecef_from_geodetic

__all__ = [
    "BESSEL",
    "FERRO_DEG",
    "WGS84",
    "Ellipsoid",
    "ecef_from_gauss_krueger",
    "footpoint_coefficients",
    "footpoint_latitude",
    "gauss_krueger_from_geodetic",
    "gauss_krueger_scale",
    "geodetic_from_gauss_krueger",
]


class Ellipsoid(NamedTuple):
    """Ellipsoid of revolution.

    Parameters
    ----------
    a_m, b_m : float
        Semi-axes.
    """

    a_m: float
    b_m: float


WGS84 = Ellipsoid(6378137.0, 6378137.0 * (1.0 - 1.0 / 298.257223563))
BESSEL = Ellipsoid(6377397.15508, 6356078.96290)
"""Of the Austrian and German triangulations (1841)."""

FERRO_DEG = -(17.0 + 40.0 / 60.0)
"""Longitude of Ferro, from which Austrian meridians count: M34 lies at 34 degrees plus this."""


def footpoint_coefficients(ellipsoid: Ellipsoid = WGS84) -> tuple[float, float, float, float, float]:
    """Coefficients of the footpoint latitude by the series in the third flattening.

    Parameters
    ----------
    ellipsoid : Ellipsoid
        By default that of WGS 84.

    Returns
    -------
    tuple of float
        alpha in metres; beta, gamma, delta, epsilon in radians.
    """
    a, b = ellipsoid
    n = (a - b) / (a + b)
    return (
        0.5 * (a + b) * (1.0 + n**2 / 4.0 + n**4 / 64.0),
        1.5 * n - 27.0 / 32.0 * n**3 + 269.0 / 512.0 * n**5,
        21.0 / 16.0 * n**2 - 55.0 / 32.0 * n**4,
        151.0 / 96.0 * n**3 - 417.0 / 128.0 * n**5,
        1097.0 / 512.0 * n**4,
    )


def _arc_coefficients(ellipsoid):
    """Coefficients of the arc of the meridian as a function of latitude."""
    a, b = ellipsoid
    n = (a - b) / (a + b)
    return (
        0.5 * (a + b) * (1.0 + n**2 / 4.0 + n**4 / 64.0),
        -1.5 * n + 9.0 / 16.0 * n**3 - 3.0 / 32.0 * n**5,
        15.0 / 16.0 * n**2 - 15.0 / 32.0 * n**4,
        -35.0 / 48.0 * n**3 + 105.0 / 256.0 * n**5,
        315.0 / 512.0 * n**4,
    )


def footpoint_latitude(northing_m, ellipsoid: Ellipsoid = WGS84) -> np.ndarray:
    """Latitude at which the arc of the meridian from the equator has a length.

    Parameters
    ----------
    northing_m : float or ndarray
        Length of the arc.
    ellipsoid : Ellipsoid
        By default that of WGS 84.

    Returns
    -------
    ndarray
        Radians.
    """
    alpha, *terms = footpoint_coefficients(ellipsoid)
    s = np.asarray(northing_m, dtype=float) / alpha
    return s + sum(term * np.sin(2.0 * (k + 1) * s) for k, term in enumerate(terms))


def geodetic_from_gauss_krueger(easting_m, northing_m, central_meridian_rad, ellipsoid: Ellipsoid = WGS84):
    """Latitude and longitude of plane coordinates; Landfahrer 2009, eqs. (4.7) to (4.9).

    Parameters
    ----------
    easting_m, northing_m : float or ndarray
        From the central meridian and from the equator, without false easting.
    central_meridian_rad : float
        Its longitude from Greenwich.
    ellipsoid : Ellipsoid
        On which the coordinates rest.

    Returns
    -------
    latitude_rad, longitude_rad : ndarray
    """
    a, b = ellipsoid
    x = np.asarray(easting_m, dtype=float)
    phi = footpoint_latitude(northing_m, ellipsoid)
    cos_phi, t = np.cos(phi), np.tan(phi)
    e2 = (a * a - b * b) / (b * b) * cos_phi**2
    q = x * b * np.sqrt(1.0 + e2) / (a * a)  # x / N
    t2, t4, t6 = t**2, t**4, t**6
    latitude = phi + t * (
        q**2 / 2.0 * (-1.0 - e2)
        + q**4 / 24.0 * (5.0 + 3.0 * t2 + 6.0 * e2 - 6.0 * t2 * e2 - 3.0 * e2**2 - 9.0 * t2 * e2**2)
        + q**6 / 720.0 * (-61.0 - 90.0 * t2 - 45.0 * t4 - 107.0 * e2 + 162.0 * t2 * e2 + 45.0 * t4 * e2)
        + q**8 / 40320.0 * (1385.0 + 3633.0 * t2 + 4095.0 * t4 + 1575.0 * t6)
    )
    longitude = central_meridian_rad + 1.0 / cos_phi * (
        q
        + q**3 / 6.0 * (-1.0 - 2.0 * t2 - e2)
        + q**5 / 120.0 * (5.0 + 28.0 * t2 + 24.0 * t4 + 6.0 * e2 + 8.0 * t2 * e2)
        + q**7 / 5040.0 * (-61.0 - 662.0 * t2 - 1320.0 * t4 - 720.0 * t6)
    )
    return latitude, longitude


def gauss_krueger_from_geodetic(
    latitude_rad, longitude_rad, central_meridian_rad, ellipsoid: Ellipsoid = WGS84
):
    """Plane coordinates of latitude and longitude, the inverse of `geodetic_from_gauss_krueger`.

    Parameters
    ----------
    latitude_rad, longitude_rad : float or ndarray
        On the ellipsoid.
    central_meridian_rad : float
        Longitude of the central meridian.
    ellipsoid : Ellipsoid
        On which the coordinates rest.

    Returns
    -------
    easting_m, northing_m : ndarray
    """
    a, b = ellipsoid
    phi = np.asarray(latitude_rad, dtype=float)
    alpha, *terms = _arc_coefficients(ellipsoid)
    arc = alpha * (phi + sum(term * np.sin(2.0 * (k + 1) * phi) for k, term in enumerate(terms)))
    cos_phi, t = np.cos(phi), np.tan(phi)
    e2 = (a * a - b * b) / (b * b) * cos_phi**2
    radius = a * a / (b * np.sqrt(1.0 + e2))
    d = (np.asarray(longitude_rad, dtype=float) - central_meridian_rad) * cos_phi
    t2, t4, t6 = t**2, t**4, t**6
    northing = arc + t * radius * (
        d**2 / 2.0
        + d**4 / 24.0 * (5.0 - t2 + 9.0 * e2 + 4.0 * e2**2)
        + d**6 / 720.0 * (61.0 - 58.0 * t2 + t4 + 270.0 * e2 - 330.0 * t2 * e2)
        + d**8 / 40320.0 * (1385.0 - 3111.0 * t2 + 543.0 * t4 - t6)
    )
    easting = radius * (
        d
        + d**3 / 6.0 * (1.0 - t2 + e2)
        + d**5 / 120.0 * (5.0 - 18.0 * t2 + t4 + 14.0 * e2 - 58.0 * t2 * e2)
        + d**7 / 5040.0 * (61.0 - 479.0 * t2 + 179.0 * t4 - t6)
    )
    return easting, northing


def gauss_krueger_scale(easting_m, latitude_rad, ellipsoid: Ellipsoid = WGS84) -> np.ndarray:
    """Length in the plane over length on the ellipsoid.

    Parameters
    ----------
    easting_m : float or ndarray
        From the central meridian.
    latitude_rad : float or ndarray
        Of the place.
    ellipsoid : Ellipsoid
        On which the coordinates rest.

    Returns
    -------
    ndarray
        1 + x^2 / (2 R^2) + x^4 / (24 R^4) with the mean radius of curvature R.
    """
    a, b = ellipsoid
    e2 = (a * a - b * b) / (b * b) * np.cos(latitude_rad) ** 2
    radius = a * a / b / (1.0 + e2)
    q = (np.asarray(easting_m, dtype=float) / radius) ** 2
    return 1.0 + q / 2.0 + q**2 / 24.0


def ecef_from_gauss_krueger(
    easting_m, northing_m, height_m, central_meridian_rad, ellipsoid: Ellipsoid = WGS84
):
    """Earth-centred coordinates of surveyed points, from which vectors and distances in space follow.

    Parameters
    ----------
    easting_m, northing_m, height_m : float or ndarray
        Plane coordinates and height above the ellipsoid.
    central_meridian_rad : float
        Longitude of the central meridian.
    ellipsoid : Ellipsoid
        On which they rest. For a platform of metres it does not matter which.

    Returns
    -------
    ndarray, shape (..., 3)
        Metres; of the latitude and longitude on WGS 84.
    """
    latitude, longitude = geodetic_from_gauss_krueger(easting_m, northing_m, central_meridian_rad, ellipsoid)
    return ecef_from_geodetic(latitude, longitude, np.asarray(height_m, dtype=float))
