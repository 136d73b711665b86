"""Delays of the ionosphere and the troposphere that a single receiver cannot measure.

Klobuchar's broadcast model of the ionosphere (IS-GPS-200N, figure 20-4), for GPS L1; the delay of
another carrier is ``(f_L1 / f)^2`` times that:

    delay = c F (5 ns + A (1 - x^2/2 + x^4/24)),   A = sum alpha_n phi_m^n,   F = 1 + 16 (0.53 - E)^3

Saastamoinen's zenith delay of the troposphere with the ICAO standard atmosphere, mapped to the
elevation by Black & Eisner:

    delay = 0.0022768 (p + (1255/T + 0.05) e) / (1 - 0.00266 cos 2 lat - 0.00028 h_km) * m(el)
    m(el) = 1.001 / sqrt(0.002001 + sin^2 el)

These functions are the readable form; the position solver runs their compiled twins.

References
----------
IS-GPS-200N, 20.3.3.5.2.5. Klobuchar 1987, IEEE Trans. AES-23(3):325-331.
Saastamoinen 1973, Bulletin Geodesique 105-107. ICAO Doc 7488 (standard atmosphere).
Black & Eisner 1984, J. Geophys. Res. 89(D2):2616-2626. WMO-No. 8 (saturation vapour pressure).
"""

import numpy as np

from ..constants import SPEED_OF_LIGHT_MPS

__all__ = ["klobuchar_delay_m", "saastamoinen_delay_m", "saastamoinen_zenith_delay_m", "troposphere_mapping"]


def klobuchar_delay_m(coefficients, latitude_rad, longitude_rad, azimuth_rad, elevation_rad, day_s):
    """Ionospheric delay of a code on GPS L1, by the broadcast model.

    Parameters
    ----------
    coefficients : ndarray, shape (8,)
        Broadcast alpha 0-3 (s, s/semicircle, ...), then beta 0-3.
    latitude_rad, longitude_rad : float or ndarray
        Geodetic position of the receiver.
    azimuth_rad, elevation_rad : float or ndarray
        Direction of the satellite.
    day_s : float or ndarray
        GPS time, seconds of the day (or of the week).

    Returns
    -------
    ndarray
        Metres, positive: the code comes late by so much.

    Notes
    -----
    IS-GPS-200N, 20.3.3.5.2.5, in semicircles as there.
    """
    alpha, beta = np.split(np.asarray(coefficients, dtype=float), 2)
    e = np.asarray(elevation_rad, dtype=float) / np.pi
    psi = 0.0137 / (e + 0.11) - 0.022
    phi_i = np.clip(latitude_rad / np.pi + psi * np.cos(azimuth_rad), -0.416, 0.416)
    lambda_i = longitude_rad / np.pi + psi * np.sin(azimuth_rad) / np.cos(phi_i * np.pi)
    phi_m = phi_i + 0.064 * np.cos((lambda_i - 1.617) * np.pi)
    local_s = np.mod(43_200.0 * lambda_i + day_s, 86_400.0)
    powers = phi_m[..., None] ** np.arange(4)
    amplitude_s = np.maximum(powers @ alpha, 0.0)
    period_s = np.maximum(powers @ beta, 72_000.0)
    x = 2.0 * np.pi * (local_s - 50_400.0) / period_s
    day = np.where(np.abs(x) < 1.57, amplitude_s * (1.0 - x**2 / 2.0 + x**4 / 24.0), 0.0)
    return SPEED_OF_LIGHT_MPS * (1.0 + 16.0 * (0.53 - e) ** 3) * (5e-9 + day)


def saastamoinen_zenith_delay_m(latitude_rad, height_m, *, humidity=0.7):
    """Zenith delay of the troposphere, hydrostatic and wet, in the standard atmosphere.

    Parameters
    ----------
    latitude_rad, height_m : float or ndarray
        Geodetic latitude and height; heights outside -500 m to 11 km are taken at the nearest end.
    humidity : float
        Relative humidity, 0 to 1.

    Returns
    -------
    ndarray
        Metres.
    """
    h = np.clip(height_m, -500.0, 11_000.0)
    temperature_k = 288.15 - 0.0065 * h
    pressure_hpa = 1013.25 * (1.0 - 2.2557e-5 * h) ** 5.2568
    celsius = temperature_k - 273.15
    vapour_hpa = humidity * 6.112 * np.exp(17.62 * celsius / (243.12 + celsius))
    gravity = 1.0 - 0.00266 * np.cos(2.0 * np.asarray(latitude_rad)) - 0.00028e-3 * h
    return 0.0022768 * (pressure_hpa + (1255.0 / temperature_k + 0.05) * vapour_hpa) / gravity


def troposphere_mapping(elevation_rad):
    """Slant over zenith delay at an elevation; good to 1 % above 5 degrees, 1 at the zenith."""
    return 1.001 / np.sqrt(0.002001 + np.maximum(np.sin(elevation_rad), 0.0) ** 2)


def saastamoinen_delay_m(latitude_rad, height_m, elevation_rad, *, humidity=0.7):
    """Slant delay of the troposphere, metres; arguments as `saastamoinen_zenith_delay_m`."""
    zenith_m = saastamoinen_zenith_delay_m(latitude_rad, height_m, humidity=humidity)
    return zenith_m * troposphere_mapping(elevation_rad)
