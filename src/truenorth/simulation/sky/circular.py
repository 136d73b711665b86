"""Skies of circular orbits: the 24 satellites of Oguz (2006), and orbits through given directions.

A satellite at argument of latitude u, with the Greenwich longitude of its node Omega_er, is at (eq. 2.2)

    x = r cos Omega_er cos u - r sin Omega_er cos i sin u
    y = r sin Omega_er cos u + r cos Omega_er cos i sin u
    z = r sin i sin u

with Omega_er = Omega - Omega_ie t_er (eq. 2.3) and u growing by n = sqrt(GM / r^3). The Earth rate is that of
IS-GPS-200; the thesis rounds it to 15.041 degrees an hour. All satellites are GPS satellites with ideal
clocks, whose ephemerides say exactly this orbit.

Reference: P. Oguz, Implementation of Northfinding Techniques, METU, 2006, section 2.2.
"""

import numpy as np

from ...frames import geodetic_from_ecef, rot_enu_from_ecef
from ...navigation import build_navigation
from ...observations import sat_id
from ...timescales import leap_seconds
from .almanac import greenwich_angle_rad, nominal_slots
from .broadcast import BroadcastTruth, KeplerOrbit, as_written, kepler_rows, reference_times

__all__ = ["directions_navigation", "oguz_navigation"]

_GM_M3PS2 = 3.986_005e14
_GPS = 0


def _navigation(orbits, section, start_ns, duration_s):
    times_ns = reference_times(_GPS, start_ns, duration_s)
    ideal = (0.0, 0.0, 0.0, 0.0)
    exact = build_navigation(
        [row for orbit in orbits for row in kepler_rows(orbit, times_ns, ideal, start_ns)],
        klobuchar={"G": np.array(section.klobuchar)},
        leap_seconds=int(leap_seconds(start_ns)),
    )
    return as_written(exact), BroadcastTruth(exact)


def _circular(sat, start_ns, radius_m, inclination_rad, node_rad, argument_rad):
    elements = {
        "sqrt_a": float(np.sqrt(radius_m)),
        "eccentricity": 0.0,
        "i0_rad": float(inclination_rad),
        "node_rad": float(node_rad),
        "omega_rad": 0.0,
        "m0_rad": float(argument_rad),
        "omega_dot_radps": 0.0,
        "argument_rate_radps": float(np.sqrt(_GM_M3PS2 / radius_m**3)),
    }
    return KeplerOrbit(sat, start_ns, elements)


def oguz_navigation(section, *, start_ns, duration_s):
    """Ephemerides of the constellation of Oguz (2006).

    Parameters
    ----------
    section : truenorth.simulation.sky.OguzSky
        What to make.
    start_ns : int
        GPS time of the start, nanoseconds; t_er counts from it.
    duration_s : float
        Length, seconds.

    Returns
    -------
    navigation : Navigation
    truth : BroadcastTruth
    """
    angle = section.greenwich_angle_deg
    greenwich = greenwich_angle_rad(start_ns) if angle is None else np.radians(angle)
    orbits = []
    if section.phasing == "published_slots":
        slots = nominal_slots("G", gps_slots=24)
        arguments = [slot.latitude_argument_deg for slot in slots]
    else:
        arguments = [
            45.0 * (2 * k + plane % 2) + section.plane_phase_deg * plane
            for plane in range(6)
            for k in range(4)
        ]
    for number, argument in enumerate(arguments, start=1):
        node = np.radians(60.0 * ((number - 1) // 4)) - greenwich
        orbits.append(
            _circular(number, start_ns, section.orbit_radius_m, np.radians(55.0), node, np.radians(argument))
        )
    return _navigation(orbits, section, start_ns, duration_s)


def directions_navigation(section, *, start_ns, duration_s, position_ecef_m):
    """Ephemerides of circular orbits that pass given directions at the start.

    Parameters
    ----------
    section : truenorth.simulation.sky.DirectionsSky
        The directions.
    start_ns : int
        GPS time of the start, nanoseconds.
    duration_s : float
        Length, seconds.
    position_ecef_m : ndarray, shape (3,)
        Where they are seen from.

    Returns
    -------
    navigation : Navigation
    truth : BroadcastTruth

    Notes
    -----
    The ray meets the sphere of the orbits at the distance -u.p + sqrt((u.p)^2 + r^2 - p.p). Of the two orbits
    of the inclination through that place every other satellite takes the rising one.
    """
    place = np.asarray(position_ecef_m, dtype=float)
    lat, lon, _ = geodetic_from_ecef(place)
    to_enu = rot_enu_from_ecef(lat, lon)
    names = section.names or [f"G{k:02d}" for k in range(1, len(section.azimuth_elevation_deg) + 1)]
    orbits = []
    for k, (name, direction) in enumerate(zip(names, section.azimuth_elevation_deg, strict=True)):
        azimuth, elevation = np.radians(direction)
        enu = [np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)]
        ray = to_enu.T @ enu
        along = ray @ place
        distance = -along + np.sqrt(along**2 + section.orbit_radius_m**2 - place @ place)
        x, y, z = (place + distance * ray) / section.orbit_radius_m
        declination = np.arcsin(np.clip(z, -1.0, 1.0))
        inclination = max(np.radians(section.inclination_deg), abs(declination))
        argument = np.arcsin(np.clip(np.sin(declination) / np.sin(inclination), -1.0, 1.0))
        if k % 2:
            argument = np.pi - argument
        node = np.arctan2(y, x) - np.arctan2(np.cos(inclination) * np.sin(argument), np.cos(argument))
        orbits.append(_circular(sat_id(name), start_ns, section.orbit_radius_m, inclination, node, argument))
    return _navigation(orbits, section, start_ns, duration_s)
