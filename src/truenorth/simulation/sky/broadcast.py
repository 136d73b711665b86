"""Broadcast messages of satellites on nominal orbits.

The orbit of a slot is one smooth curve (`truenorth.simulation.sky.almanac.orbit_elements`); its ephemerides
are that curve written down at each reference time, so that consecutive ones agree to rounding. GLONASS
state vectors are integrated from one record to the next by the equations that receivers use (ICD 5.1,
A.3.1.2). Clocks and group delays are drawn once per satellite, with the sizes that broadcast files show.

Reference times and what is sent with them follow the interface documents: every two hours for GPS and
NavIC, every hour for Galileo (which updates more often), BeiDou and QZSS, every half hour for GLONASS.
"""

from dataclasses import dataclass, replace

import numpy as np

from ...constants import BEIDOU, GALILEO, GLONASS, GPS, NAVIC, QZSS
from ...navigation import KEPLER_COLUMNS, STATE_COLUMNS, MessageType, Navigation, build_navigation
from ...observations import sat_name
from ...timescales import BDT_OFFSET_NS, NS_PER_DAY, NS_PER_S, NS_PER_WEEK, leap_seconds
from ..randomness import stream
from .almanac import EARTH_RATE_RADPS, GLONASS_CHANNELS, nominal_slots, orbit_elements

__all__ = [
    "FIT_S",
    "URA_M",
    "BroadcastTruth",
    "KeplerOrbit",
    "as_written",
    "constants_of",
    "is_beidou_fixed",
    "kepler_rows",
    "messages_of",
    "nominal_navigation",
    "reference_times",
]

_INTERVAL_S = {GPS: 7200, GLONASS: 1800, GALILEO: 3600, BEIDOU: 3600, QZSS: 3600, NAVIC: 7200}
FIT_S = {GPS: 14_400.0, GALILEO: 28_800.0, BEIDOU: 14_400.0, QZSS: 7200.0, NAVIC: 14_400.0}
URA_M = {GPS: 2.0, GALILEO: 3.12, BEIDOU: 2.0, QZSS: 2.0, NAVIC: 2.0}

# Clock bias (s) and drift, group delays (s): half-widths of what is drawn; the second is BGD E5b, TGD2.
_CLOCK = {
    GPS: (5e-4, 1e-11, 1.2e-8, 0.0),
    GLONASS: (2e-4, 2e-12, 4e-9, 0.0),
    GALILEO: (8e-4, 1e-11, 6e-9, 6e-9),
    BEIDOU: (8e-4, 3e-11, 1.5e-8, 1e-8),
    QZSS: (1e-6, 2e-13, 4e-9, 0.0),
    NAVIC: (5e-4, 3e-11, 3e-9, 0.0),
}
"""Broadcast files of 2024 and 2026 hold such values."""

# Resolution of what the messages carry for them, so that every format carries the same number.
_AF0_S, _AF1_SPS, _DELAY_S = 2.0**-34, 2.0**-50, 2.0**-32
_BEIDOU_DELAY_S = 1e-10


@dataclass(frozen=True, slots=True, eq=False)
class BroadcastTruth:
    """True orbits and clocks are those of broadcast ephemerides, as they are."""

    navigation: Navigation

    def states(self, sat, time_ns, delay_s):
        """Position, velocity, clock, clock drift, status: see `truenorth.simulation.sky.Sky.true_states`."""
        from ...orbits import compute_satellite_states

        states = compute_satellite_states(self.navigation, sat, time_ns, delay_s=delay_s)
        return (
            states.position_ecef_m,
            states.velocity_ecef_mps,
            states.clock_s,
            states.clock_drift_sps,
            states.status,
        )


class KeplerOrbit:
    """Elements at a reference time and how they move on: one curve for all ephemerides of a satellite."""

    def __init__(self, sat, reference_ns, elements):
        self.sat = int(sat)
        self.reference_ns = int(reference_ns)
        self.elements = elements

    def at(self, toe_ns):
        """Elements of the curve at a reference time, as a message writes them."""
        system = self.sat // 100
        # The tilted frame of the BeiDou geostationary satellites is that of the Earth at each reference time.
        later_s = 0.0 if is_beidou_fixed(self.sat) else (toe_ns - self.reference_ns) / NS_PER_S
        el = dict(self.elements)
        argument_rate, node = el.pop("argument_rate_radps"), el.pop("node_rad")
        gm, omega_e = constants_of(system)
        # The almanac turns the node with its own rate of the Earth; each message with that of its document.
        node_rate = el["omega_dot_radps"] + omega_e - EARTH_RATE_RADPS
        own_toe_ns = toe_ns - (BDT_OFFSET_NS if system == BEIDOU else 0)
        toe_sow = (own_toe_ns % NS_PER_WEEK) / NS_PER_S
        mean_motion = np.sqrt(gm / el["sqrt_a"] ** 6)
        el["delta_n_radps"] = argument_rate - mean_motion
        el["m0_rad"] = _wrapped(el["m0_rad"] + argument_rate * later_s)
        el["omega0_rad"] = _wrapped(node + (node_rate - omega_e) * later_s + omega_e * toe_sow)
        el["omega_dot_radps"] = node_rate
        return el


def _wrapped(angle):
    """Angle in [-pi, pi), as messages carry it."""
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


def as_written(navigation):
    """Navigation data rounded to the 13 digits of a RINEX file: what is read back is then equal.

    Parameters
    ----------
    navigation : Navigation
        As computed.

    Returns
    -------
    Navigation
    """

    def rounded(values, scale):
        # GLONASS is written in kilometres.
        digits = [float(f"{value:.12e}") for value in (values / scale).ravel().tolist()]
        return np.array(digits).reshape(values.shape) * scale

    scale = np.ones(len(STATE_COLUMNS))
    scale[:9] = 1e3
    kepler = replace(navigation.kepler, elements=rounded(navigation.kepler.elements, 1.0))
    states = replace(navigation.states, states=rounded(navigation.states.states, scale))
    return replace(navigation, kepler=kepler, states=states)


def constants_of(system):
    """GM (m^3/s^2) and rate of the Earth (rad/s) that the system's messages mean."""
    gm = 3.986_004_418e14 if system in (GALILEO, BEIDOU) else 3.986_005e14
    return gm, 7.292_115e-5 if system == BEIDOU else 7.292_115_146_7e-5


def is_beidou_fixed(sat):
    """Whether a satellite is a geostationary one of BeiDou, which sends D2."""
    return sat // 100 == BEIDOU and (sat % 100 <= 5 or sat % 100 >= 59)


def _tilted(elements):
    """Elements of a BeiDou geostationary orbit in its message's plane, tilted by 5 degrees (ICD 5.2.4.12)."""
    node, inclination = elements["node_rad"], elements["i0_rad"]
    argument = elements["omega_rad"] + elements["m0_rad"]
    c, s = np.cos(np.radians(5.0)), np.sin(np.radians(5.0))
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    normal = np.array(
        [np.sin(inclination) * np.sin(node), -np.sin(inclination) * np.cos(node), np.cos(inclination)]
    )
    along_node = np.array([np.cos(node), np.sin(node), 0.0])
    radius = np.cos(argument) * along_node + np.sin(argument) * np.cross(normal, along_node)
    normal, radius = tilt @ normal, tilt @ radius
    node = np.arctan2(normal[0], -normal[1])
    along_node = np.array([np.cos(node), np.sin(node), 0.0])
    argument = np.arctan2(radius @ np.cross(normal, along_node), radius @ along_node)
    return elements | {
        "node_rad": float(node),
        "i0_rad": float(np.arccos(normal[2])),
        "omega_rad": 0.0,
        "m0_rad": float(argument),
        "omega_dot_radps": 0.0,
        "argument_rate_radps": EARTH_RATE_RADPS,
    }


def reference_times(system, start_ns, duration_s):
    """Reference times of a system's ephemerides: the first before the scenario, the last after it.

    Parameters
    ----------
    system : int
        System code.
    start_ns : int
        GPS time of the start, nanoseconds.
    duration_s : float
        Length, seconds.

    Returns
    -------
    list of int
        GPS time, nanoseconds.
    """
    step = _INTERVAL_S[system] * NS_PER_S
    offset = 0
    if system == BEIDOU:
        offset = BDT_OFFSET_NS
    elif system == GLONASS:
        # 15 and 45 minutes past the hour, UTC.
        offset = 900 * NS_PER_S + int(leap_seconds(start_ns)) * NS_PER_S
    end_ns = start_ns + round(duration_s * NS_PER_S)
    first = (start_ns - offset) // step
    last = -((offset - end_ns) // step)
    return [offset + k * step for k in range(first, last + 1)]


def _rounded(value, resolution):
    return float(np.rint(value / resolution) * resolution)


def _draw_clock(sat, seed):
    """Bias, drift and group delays of a satellite."""
    rng = stream(seed, "sky", "clock", sat_name(sat))
    draw = rng.uniform(-1.0, 1.0, 4) * _CLOCK[sat // 100]
    delay = _BEIDOU_DELAY_S if sat // 100 == BEIDOU else _DELAY_S
    steps = (_AF0_S, _AF1_SPS, delay, delay)
    return [_rounded(value, step) for value, step in zip(draw, steps, strict=True)]


def messages_of(sat):
    """Legacy messages that a satellite sends."""
    system = sat // 100
    if system == GALILEO:
        return (MessageType.INAV, MessageType.FNAV)
    if system == BEIDOU:
        return (MessageType.D2 if is_beidou_fixed(sat) else MessageType.D1,)
    return (MessageType.LNAV,)


def kepler_rows(orbit, times_ns, clock, clock_ns):
    """Ephemerides of an orbit, rows for `truenorth.navigation.build_navigation`.

    Parameters
    ----------
    orbit : KeplerOrbit
        The satellite and its curve.
    times_ns : iterable of int
        Reference times, GPS time.
    clock : tuple of 4 float
        Bias (s) at ``clock_ns``, drift, first and second group delay (s).
    clock_ns : int
        Time of the bias, GPS time.

    Returns
    -------
    list of tuple
    """
    bias_s, drift_sps, *delays_s = clock
    system = orbit.sat // 100
    rows = []
    for toe_ns in times_ns:
        elements = dict.fromkeys(KEPLER_COLUMNS, 0.0) | orbit.at(toe_ns)
        elements |= {
            "af0_s": bias_s + drift_sps * ((toe_ns - clock_ns) / NS_PER_S),
            "af1_sps": drift_sps,
            "tgd_s": delays_s[0],
            "tgd2_s": delays_s[1],
            "ura_m": URA_M[system],
            "fit_interval_s": FIT_S[system],
        }
        # Messages go out from two hours before the reference time on (GPS, NavIC), or from that time on.
        ahead_s = 7200 if system in (GPS, NAVIC) else 0
        sent_ns = toe_ns - ahead_s * NS_PER_S
        own_ns = toe_ns - (BDT_OFFSET_NS if system == BEIDOU else 0)
        issue = int(own_ns // (_INTERVAL_S[system] * NS_PER_S))
        iode = issue % (24 if system == BEIDOU else 240 if system != GALILEO else 128)
        values = [elements[name] for name in KEPLER_COLUMNS]
        rows += [
            (orbit.sat, message, toe_ns, toe_ns, sent_ns, iode, iode, 0, values)
            for message in messages_of(orbit.sat)
        ]
    return rows


def _glonass_rows(orbits, times_ns, seed, clock_ns):
    """State vectors, each integrated from the one before."""
    from ...orbits import compute_satellite_states

    sats = np.array([orbit.sat for orbit in orbits], dtype=np.int64)
    start = build_navigation(
        [
            # As a GPS satellite of the same slot number, only to evaluate the Kepler elements once.
            (
                orbit.sat % 100,
                MessageType.LNAV,
                times_ns[0],
                times_ns[0],
                times_ns[0],
                0,
                0,
                0,
                [
                    (
                        dict.fromkeys(KEPLER_COLUMNS, 0.0)
                        | KeplerOrbit(orbit.sat % 100, orbit.reference_ns, orbit.elements).at(times_ns[0])
                    )[name]
                    for name in KEPLER_COLUMNS
                ],
            )
            for orbit in orbits
        ]
    )
    first = compute_satellite_states(start, sats % 100, times_ns[0])
    position, velocity = first.position_ecef_m, first.velocity_ecef_mps
    clocks = [_draw_clock(int(sat), seed) for sat in sats]
    rows = []
    for k, toe_ns in enumerate(times_ns):
        new = []
        for j, sat in enumerate(sats):
            bias_s, drift_sps, delay_s, _ = clocks[j]
            states = dict.fromkeys(STATE_COLUMNS, 0.0)
            states |= dict(zip(STATE_COLUMNS[:6], [*position[j], *velocity[j]], strict=True))
            states["clock_s"] = bias_s + drift_sps * ((toe_ns - clock_ns) / NS_PER_S)
            states["clock_drift_sps"] = drift_sps
            states["delta_tau_s"] = delay_s
            channel = GLONASS_CHANNELS[int(sat) % 100 - 1]
            values = [float(states[name]) for name in STATE_COLUMNS]
            new.append((int(sat), toe_ns, toe_ns - 900 * NS_PER_S, channel, 0, values))
        rows += new
        if k + 1 < len(times_ns):
            step = build_navigation((), new)
            ahead = compute_satellite_states(step, sats, times_ns[k + 1], ephemeris=np.arange(len(sats)))
            position, velocity = ahead.position_ecef_m, ahead.velocity_ecef_mps
    return rows


def nominal_navigation(section, *, start_ns, duration_s, seed):
    """Broadcast ephemerides of the nominal constellations, valid over the scenario.

    Parameters
    ----------
    section : truenorth.simulation.sky.NominalSky
        What to make.
    start_ns : int
        GPS time of the scenario's start, nanoseconds.
    duration_s : float
        Its length, seconds.
    seed : int
        Seed of the scenario: eccentricities, clocks, group delays.

    Returns
    -------
    navigation : Navigation
        As written in files.
    truth : BroadcastTruth
        The orbits and clocks before the messages are rounded.
    """
    reference_ns = start_ns // NS_PER_DAY * NS_PER_DAY
    rows, glonass = [], []
    for slot in nominal_slots(section.systems, gps_slots=section.gps_slots):
        elements = orbit_elements(slot, reference_ns)
        system = slot.sat // 100
        if system == GPS and section.gps_eccentricity > 0.0:
            rng = stream(seed, "sky", "orbit", sat_name(slot.sat))
            argument = elements["omega_rad"] + elements["m0_rad"]
            elements["eccentricity"] = section.gps_eccentricity * float(rng.random())
            elements["omega_rad"] = float(rng.uniform(-np.pi, np.pi))
            elements["m0_rad"] = argument - elements["omega_rad"]
        if is_beidou_fixed(slot.sat):
            elements = _tilted(elements)
        orbit = KeplerOrbit(slot.sat, reference_ns, elements)
        if system == GLONASS:
            glonass.append(orbit)
            continue
        times_ns = reference_times(system, start_ns, duration_s)
        rows += kepler_rows(orbit, times_ns, _draw_clock(slot.sat, seed), reference_ns)
    states = []
    if glonass:
        times_ns = reference_times(GLONASS, start_ns, duration_s)
        states = _glonass_rows(glonass, times_ns, seed, reference_ns)
    exact = build_navigation(
        rows,
        states,
        klobuchar={"G": np.array(section.klobuchar)},
        leap_seconds=int(leap_seconds(start_ns)),
    )
    return as_written(exact), BroadcastTruth(exact)
