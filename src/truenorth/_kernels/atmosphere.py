"""Compiled delays of the atmosphere; the readable twin with the equations is `orbits.atmosphere`.

References: IS-GPS-200N, 20.3.3.5.2.5 (Klobuchar); Saastamoinen 1973, Bulletin Geodesique 107;
Black & Eisner 1984, J. Geophys. Res. 89(D2) (mapping).
"""

import numpy as np

from .jit import kernel

SPEED_OF_LIGHT_MPS = 299_792_458.0


@kernel
def klobuchar_delay(coefficients, lat, lon, azimuth, elevation, day_s):
    """Delay of L1 in metres; angles in radians, ``day_s`` seconds of the GPS day."""
    e = elevation / np.pi
    psi = 0.0137 / (e + 0.11) - 0.022
    phi = min(max(lat / np.pi + psi * np.cos(azimuth), -0.416), 0.416)
    lam = lon / np.pi + psi * np.sin(azimuth) / np.cos(phi * np.pi)
    phi += 0.064 * np.cos((lam - 1.617) * np.pi)
    local_s = 43200.0 * lam + day_s
    local_s -= 86400.0 * np.floor(local_s / 86400.0)
    amplitude = coefficients[0] + phi * (coefficients[1] + phi * (coefficients[2] + phi * coefficients[3]))
    period = coefficients[4] + phi * (coefficients[5] + phi * (coefficients[6] + phi * coefficients[7]))
    x = 2.0 * np.pi * (local_s - 50400.0) / max(period, 72000.0)
    delay_s = 5e-9
    if abs(x) < 1.57:
        x2 = x * x
        delay_s += max(amplitude, 0.0) * (1.0 - x2 / 2.0 + x2 * x2 / 24.0)
    slant = 0.53 - e
    return SPEED_OF_LIGHT_MPS * (1.0 + 16.0 * slant * slant * slant) * delay_s


@kernel
def saastamoinen_zenith(lat, height_m, humidity):
    """Zenith delay of the whole troposphere in metres, standard atmosphere at ``height_m``."""
    # The standard atmosphere is defined for the troposphere; outside it the nearest end is used.
    h = min(max(height_m, -500.0), 11_000.0)
    temperature_k = 288.15 - 0.0065 * h
    pressure_hpa = 1013.25 * (1.0 - 2.2557e-5 * h) ** 5.2568
    celsius = temperature_k - 273.15
    vapour_hpa = humidity * 6.112 * np.exp(17.62 * celsius / (243.12 + celsius))
    gravity = 1.0 - 0.00266 * np.cos(2.0 * lat) - 0.00028e-3 * h
    return 0.0022768 * (pressure_hpa + (1255.0 / temperature_k + 0.05) * vapour_hpa) / gravity


@kernel
def troposphere_mapping(sin_elevation):
    """Slant over zenith delay."""
    s = max(sin_elevation, 0.0)
    return 1.001 / np.sqrt(0.002001 + s * s)
