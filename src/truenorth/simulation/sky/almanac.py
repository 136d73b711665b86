"""The nominal constellations: where each slot's satellite is at any time.

All orbits but the quasi-zenith ones are circular and all repeat their ground track: P revolutions in Q
nodal days. Station keeping holds them so in reality, so the phase of a slot is known for ever from its
published state at one epoch:

    lambda(t) = lambda_0 - w (t - t_0),    u(t) = u_0 + (P / Q) w (t - t_0),    w = omega_E - dOmega/dt

with lambda the Greenwich longitude of the ascending node and u the (mean) argument of latitude. The
oblateness of the Earth moves node and satellite; to first order, with kappa = J2 (R / a)^2,

    dOmega/dt = -3/2 n kappa cos i,    du/dt = n (1 + 3/4 kappa (7/2 cos^2 i - 1/2)),    n = sqrt(GM / a^3)

which with du/dt = (P / Q) w fixes the semi-major axis a.

Sources: GPS SPS Performance Standard, 5th ed. (2020), tables 3.2-1 to 3.2-3 (slots and expandable slots,
epoch 2017-01-01 00:00 GPS time). GLONASS ICD L1/L2 5.1 (2008), section 5.2 (epoch 1983-01-01 00:00 Moscow
time); channels as used since 2010 (IAC Korolyov). Galileo OS Service Definition Document 1.1 (2019), table 1
and annex (24/3/1, slot A1, epoch 2016-11-21 00:00 UTC, 17 revolutions in 10 days). BeiDou OS Performance
Standard 3.0 (2021), section 4.1; PS-QZSS-003 and IS-QZSS-PNT-005; IRNSS SIS ICD 1.1 (2017), section 2. The
last three state the orbits but no phase at an epoch: the phases of the BeiDou MEO satellites and those
along the regional ground tracks are ours, evenly spaced. Satellite numbers follow the order of the slots.
"""

from dataclasses import dataclass, replace

import numpy as np

from ...observations import sat_id
from ...timescales import NS_PER_DAY, NS_PER_S, gpst_from_calendar, gpst_from_utc_ns, leap_seconds

__all__ = [
    "EARTH_RATE_RADPS",
    "GLONASS_CHANNELS",
    "GM_M3PS2",
    "J2",
    "Slot",
    "greenwich_angle_rad",
    "nominal_slots",
    "orbit_elements",
    "repeat_semi_major_axis_m",
]

GM_M3PS2 = 3.986_004_418e14
EARTH_RATE_RADPS = 7.292_115e-5
EARTH_RADIUS_M = 6_378_137.0
J2 = 1.082_626e-3

GLONASS_CHANNELS = (1, -4, 5, 6, 1, -4, 5, 6, -2, -7, 0, -1, -2, -7, 0, -1, 4, -3, 3, 2, 4, -3, 3, 2)
"""Frequency channel of slots 1 to 24; antipodal satellites share one."""

# Right ascension of the node and arguments of latitude of the four slots of each plane, degrees.
_GPS_PLANES = {
    "A": (288.85, (239.54, 133.20, 343.09, 13.22)),
    "B": (348.85, (52.37, 144.75, 281.39, 175.79)),
    "C": (48.85, (83.29, 343.21, 311.08, 212.97)),
    "D": (108.85, (106.64, 236.86, 6.57, 138.77)),
    "E": (168.85, (168.46, 274.01, 37.48, 305.10)),
    "F": (228.85, (210.30, 316.64, 76.62, 106.76)),
}
# Slots that may hold two satellites, one fore and one aft of the place; three are expanded first.
_GPS_EXPANDED = {
    "B1": (66.33, 37.77),
    "D2": (254.09, 229.39),
    "F2": (331.87, 305.43),
    "A2": (144.40, 117.96),
    "C4": (220.43, 195.73),
    "E3": (52.08, 23.52),
}
_GPS_GREENWICH_DEG = 100.765

_EPOCH_2017_NS = gpst_from_calendar(2017, 1, 1)
_GLONASS_EPOCH_NS = int(gpst_from_utc_ns(gpst_from_calendar(1982, 12, 31, 21)))
_GALILEO_EPOCH_NS = int(gpst_from_utc_ns(gpst_from_calendar(2016, 11, 21)))


@dataclass(frozen=True, slots=True)
class Slot:
    """One place of a constellation.

    Parameters
    ----------
    sat : int
        Satellite, see `truenorth.observations.sat_id`.
    epoch_ns : int
        GPS time at which the angles hold, nanoseconds.
    node_deg : float
        Greenwich longitude of the ascending node.
    latitude_argument_deg : float
        Mean argument of latitude (argument of perigee plus mean anomaly).
    inclination_deg : float
        Inclination to the equator.
    revolutions, days : int
        The ground track repeats after so many revolutions and nodal days.
    eccentricity, perigee_deg : float
        Shape of the orbit and argument of perigee.
    """

    sat: int
    epoch_ns: int
    node_deg: float
    latitude_argument_deg: float
    inclination_deg: float
    revolutions: int
    days: int
    eccentricity: float = 0.0
    perigee_deg: float = 0.0


def greenwich_angle_rad(time_ns):
    """Greenwich mean sidereal angle (IAU 1982), with UT1 taken as UTC: good to 0.9 s, 0.004 degrees.

    Parameters
    ----------
    time_ns : int
        GPS time, nanoseconds.

    Returns
    -------
    float
        Radians in [0, 2 pi).
    """
    utc_ns = time_ns - int(leap_seconds(time_ns)) * NS_PER_S
    utc_ns = time_ns - int(leap_seconds(utc_ns)) * NS_PER_S
    days = (utc_ns - gpst_from_calendar(2000, 1, 1, 12)) / NS_PER_DAY
    t = days / 36_525.0
    turns_s = 67_310.548_41 + 8_640_184.812_866 * t + 0.093_104 * t**2 - 6.2e-6 * t**3
    # 876600 hours a century are whole turns of the day; the fraction of the day is kept exact.
    turns = turns_s / 86_400.0 + days % 1.0
    return float(2.0 * np.pi * (turns % 1.0))


def _gps(n_slots):
    """Slots A1 to F4; beyond 24 the expandable ones hold two, in the order of the standard."""
    expanded = dict(list(_GPS_EXPANDED.items())[: n_slots - 24])
    places, spares = [], []
    for plane, (node, arguments) in _GPS_PLANES.items():
        for k, argument in enumerate(arguments):
            fore, aft = expanded.get(f"{plane}{k + 1}", (argument, None))
            places.append((node, fore))
            if aft is not None:
                spares.append((node, aft))
    return [
        Slot(sat_id(f"G{k:02d}"), _EPOCH_2017_NS, node - _GPS_GREENWICH_DEG, argument, 55.0, 2, 1)
        for k, (node, argument) in enumerate(places + spares, start=1)
    ]


def _glonass():
    first_node, first_argument = 251.25, 145.0 + 26.0 / 60.0 + 37.0 / 3600.0
    slots = []
    for j in range(1, 25):
        plane = (j - 1) // 8
        argument = first_argument + 15.0 * (27 - 3 * j + 25 * plane)
        slots.append(
            Slot(sat_id(f"R{j:02d}"), _GLONASS_EPOCH_NS, first_node + 120.0 * plane, argument, 64.8, 17, 8)
        )
    return slots


def _walker(names, epoch_ns, node_deg, argument_deg, inclination_deg, revolutions, days):
    """Walker constellation of 24 satellites in 3 planes with phasing 1 (15 degrees from plane to plane)."""
    return [
        Slot(
            sat_id(name),
            epoch_ns,
            node_deg + 120.0 * (k // 8),
            argument_deg + 45.0 * (k % 8) + 15.0 * (k // 8),
            inclination_deg,
            revolutions,
            days,
        )
        for k, name in enumerate(names)
    ]


def _galileo():
    node = 317.632 - np.degrees(greenwich_angle_rad(_GALILEO_EPOCH_NS))
    return _walker([f"E{k:02d}" for k in range(1, 25)], _GALILEO_EPOCH_NS, node, 180.153, 56.0, 17, 10)


def _geosynchronous(name, longitude_deg, phase_deg, inclination_deg, eccentricity=0.0, perigee_deg=0.0):
    """Satellite whose ground track is centred on a longitude; the phase is along the track."""
    return Slot(
        sat_id(name),
        _EPOCH_2017_NS,
        longitude_deg - phase_deg,
        phase_deg,
        inclination_deg,
        1,
        1,
        eccentricity,
        perigee_deg,
    )


def _beidou():
    meo = [k for k in range(19, 47) if k not in (31, 38, 39, 40)]
    slots = _walker([f"C{k}" for k in meo], _EPOCH_2017_NS, 0.0, 0.0, 55.0, 13, 7)
    slots += [_geosynchronous(f"C{38 + k}", 118.0, 120.0 * k, 55.0) for k in range(3)]
    slots += [
        _geosynchronous(name, longitude, 0.0, 0.0)
        for name, longitude in (("C59", 140.0), ("C60", 80.0), ("C61", 110.5))
    ]
    return slots


def _qzss():
    slots = [
        _geosynchronous(name, 135.0, 120.0 * k, 41.0, 0.075, 270.0)
        for k, name in enumerate(("J02", "J03", "J04"))
    ]
    return [*slots, _geosynchronous("J07", 127.0, 0.0, 0.0)]


def _navic():
    inclined = (("I02", 55.0, 0.0), ("I04", 111.75, 90.0), ("I05", 111.75, 270.0), ("I09", 55.0, 180.0))
    fixed = (("I03", 83.0), ("I06", 32.5), ("I07", 131.5))
    slots = [_geosynchronous(name, longitude, phase, 29.0) for name, longitude, phase in inclined]
    slots += [_geosynchronous(name, longitude, 0.0, 0.0) for name, longitude in fixed]
    return slots


def nominal_slots(systems, *, gps_slots=27):
    """Slots of the nominal constellations.

    Parameters
    ----------
    systems : str
        Letters among G, R, E, C, J, I.
    gps_slots : int
        24 for the baseline constellation, up to 30 with expandable slots held twice.

    Returns
    -------
    list of Slot
        In the order of the satellites.
    """
    makers = {
        "G": lambda: _gps(gps_slots),
        "R": _glonass,
        "E": _galileo,
        "C": _beidou,
        "J": _qzss,
        "I": _navic,
    }
    slots = [slot for letter in makers if letter in systems for slot in makers[letter]()]
    slots = [
        replace(
            slot, node_deg=slot.node_deg % 360.0, latitude_argument_deg=slot.latitude_argument_deg % 360.0
        )
        for slot in slots
    ]
    return sorted(slots, key=lambda slot: slot.sat)


def _secular_rates(a_m, inclination_rad):
    """Mean motion, rate of the node and rate of the argument of latitude, radians per second."""
    kappa = J2 * (EARTH_RADIUS_M / a_m) ** 2
    n = np.sqrt(GM_M3PS2 / a_m**3)
    c = np.cos(inclination_rad)
    return n, -1.5 * n * kappa * c, n * (1.0 + 0.75 * kappa * (3.5 * c * c - 0.5))


def repeat_semi_major_axis_m(revolutions, days, inclination_rad):
    """Semi-major axis of the circular orbit whose ground track repeats.

    Parameters
    ----------
    revolutions, days : int or ndarray
        Revolutions in nodal days.
    inclination_rad : float or ndarray
        Inclination.

    Returns
    -------
    float or ndarray
        Metres.
    """
    ratio = np.asarray(revolutions, dtype=float) / days
    a_m = (GM_M3PS2 / (ratio * EARTH_RATE_RADPS) ** 2) ** (1.0 / 3.0)
    for _ in range(20):
        _, node_rate, argument_rate = _secular_rates(a_m, inclination_rad)
        wanted = ratio * (EARTH_RATE_RADPS - node_rate)
        a_m = a_m * (argument_rate / wanted) ** (2.0 / 3.0)
    return a_m


def orbit_elements(slot, time_ns):
    """Elements of a slot's orbit at a time, with the short-period part of the oblateness.

    On a circular orbit the oblateness adds (J2 R^2 sin^2 i / 4 a) cos 2u to the radius and
    (J2 R^2 sin^2 i / 8 a^2) sin 2u to the argument of latitude, and only turns the plane evenly.

    Parameters
    ----------
    slot : Slot
        The place.
    time_ns : int
        GPS time, nanoseconds.

    Returns
    -------
    dict of str to float
        Names of `truenorth.navigation.KEPLER_COLUMNS`; instead of ``omega0_rad`` there is ``node_rad``,
        the Greenwich longitude of the node at the time. ``argument_rate_radps`` is du/dt.
    """
    inclination = np.radians(slot.inclination_deg)
    a_m = float(repeat_semi_major_axis_m(slot.revolutions, slot.days, inclination))
    _, node_rate, argument_rate = (float(rate) for rate in _secular_rates(a_m, inclination))
    elapsed_s = (time_ns - slot.epoch_ns) / NS_PER_S
    node = np.radians(slot.node_deg) - (EARTH_RATE_RADPS - node_rate) * elapsed_s
    argument = np.radians(slot.latitude_argument_deg) + argument_rate * elapsed_s
    perigee = np.radians(slot.perigee_deg)
    bulge = J2 * (EARTH_RADIUS_M / a_m) ** 2 * np.sin(inclination) ** 2
    return {
        "sqrt_a": float(np.sqrt(a_m)),
        "eccentricity": slot.eccentricity,
        "i0_rad": float(inclination),
        "node_rad": float(node % (2.0 * np.pi)),
        "omega_rad": float(perigee),
        "m0_rad": float((argument - perigee) % (2.0 * np.pi)),
        "omega_dot_radps": node_rate,
        "crc_m": float(0.25 * a_m * bulge),
        "cus_rad": float(0.125 * bulge),
        "argument_rate_radps": argument_rate,
    }
