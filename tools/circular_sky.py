"""A sky of circular orbits for studies: 24 satellites in six planes, seen from a place on the Earth.

Deliberately simple (no ephemerides): what the studies of the classical methods need is satellites
that rise, move and set at the right speed.
"""

import numpy as np

ORBIT_RADIUS_M = 26_559_700.0
EARTH_RADIUS_M = 6_371_000.0
GM_M3PS2 = 3.986004418e14
EARTH_RATE_RADPS = 7.2921151467e-5
WAVELENGTH_M = 299_792_458.0 / 1575.42e6


def directions_enu(time_s, latitude_rad=0.696, longitude_rad=0.572, phase_rad=0.0):
    """Unit vectors to all 24 satellites in east, north, up, shape (..., 24, 3); Ankara by default."""
    time_s = np.asarray(time_s, dtype=float)[..., None]
    plane, slot = np.divmod(np.arange(24), 4)
    inclination = np.radians(55.0)
    node = np.radians(60.0) * plane - EARTH_RATE_RADPS * time_s
    rate = np.sqrt(GM_M3PS2 / ORBIT_RADIUS_M**3)
    argument = phase_rad + np.radians(90.0) * slot + np.radians(15.0) * plane + rate * time_s
    sat = ORBIT_RADIUS_M * np.stack(
        [
            np.cos(node) * np.cos(argument) - np.sin(node) * np.cos(inclination) * np.sin(argument),
            np.sin(node) * np.cos(argument) + np.cos(node) * np.cos(inclination) * np.sin(argument),
            np.sin(inclination) * np.sin(argument),
        ],
        axis=-1,
    )
    sp, cp, sl, cl = np.sin(latitude_rad), np.cos(latitude_rad), np.sin(longitude_rad), np.cos(longitude_rad)
    enu_from_ecef = np.array([[-sl, cl, 0.0], [-sp * cl, -sp * sl, cp], [cp * cl, cp * sl, sp]])
    ray = sat - EARTH_RADIUS_M * enu_from_ecef[2]
    ray = ray / np.linalg.norm(ray, axis=-1, keepdims=True)
    return ray @ enu_from_ecef.T


def highest(direction_enu, count):
    """Indices of the highest satellites of one instant, highest first."""
    return np.argsort(-direction_enu[:, 2])[:count]
