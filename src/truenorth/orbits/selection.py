"""Which ephemeris describes a satellite at a time.

Of the ephemerides whose window holds the time, the best message type of the system wins, then the
nearest reference time; among reference times within a minute of the nearest, the message sent last
(an upload that cuts in changes toe by seconds). The time is rounded to a second before it is compared,
with a boundary where receivers put no epochs, so that two receivers whose tags differ by milliseconds
choose alike.

Windows, from the reference time to either side:

    GPS, QZSS   half the fit interval (2 h, 1 h unless the message says more; CNAV 1.5 h), and at least 2 h
    Galileo     4 h         BeiDou, NavIC   2 h
    GLONASS     30 min      SBAS            6 min

Health: a satellite whose chosen ephemeris says unhealthy is refused unless asked for. The word is
judged per system (see `health_ok`).
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from ..constants import BEIDOU, GALILEO, GLONASS, GPS, QZSS, SBAS, SYSTEMS
from ..navigation import KEPLER_COLUMNS, MessageType
from ..timescales import BDT_OFFSET_NS, NS_PER_S, NS_PER_WEEK

__all__ = [
    "ORBIT_STATUS_SENTENCES",
    "STATE_WINDOW_S",
    "WINDOW_S",
    "OrbitStatus",
    "health_ok",
    "select_ephemerides",
]


class OrbitStatus(IntEnum):
    """Whether a satellite's state could be computed. The numbers are those of the kernels."""

    OK = 0
    NO_EPHEMERIS = 1
    TOO_OLD = 2
    UNHEALTHY = 3
    NOT_COMPUTABLE = 4
    NO_CODE = 5


ORBIT_STATUS_SENTENCES = {
    OrbitStatus.OK: "computed",
    OrbitStatus.NO_EPHEMERIS: "no ephemeris of the satellite in the navigation data",
    OrbitStatus.TOO_OLD: "no ephemeris of the satellite is valid at the time",
    OrbitStatus.UNHEALTHY: "the satellite says that it is unhealthy",
    OrbitStatus.NOT_COMPUTABLE: "the ephemeris gives no finite orbit",
    OrbitStatus.NO_CODE: "no pseudorange, so the time of transmission is unknown",
}
"""One sentence for each `OrbitStatus`."""

WINDOW_S = {"G": 7200.0, "J": 7200.0, "E": 14_400.0, "C": 7200.0, "I": 7200.0}
"""Least half-width of the validity window of Keplerian ephemerides around toe, seconds."""

STATE_WINDOW_S = {"R": 1800.0, "S": 360.0}
"""Half-width of the validity window of state vectors, seconds."""

# Preferred messages first; a later one serves where no earlier one is valid.
_RANK = np.zeros(len(MessageType), dtype=np.int64)
for _message, _rank in {
    MessageType.LNAV: 0,
    MessageType.CNAV: 1,
    MessageType.CNAV2: 2,
    MessageType.INAV: 0,
    MessageType.FNAV: 1,
    MessageType.D1: 0,
    MessageType.D2: 0,
    MessageType.CNV1: 1,
    MessageType.CNV2: 2,
    MessageType.CNV3: 3,
    MessageType.L1NV: 1,
}.items():
    _RANK[_message] = _rank

# GM (m^3/s^2) and Earth rotation (rad/s) of each system's own interface document.
_GM = np.full(len(SYSTEMS), 3.986005e14)
_GM[[GALILEO, BEIDOU]] = 3.986004418e14
_OMEGA_E = np.full(len(SYSTEMS), 7.292_115_146_7e-5)
_OMEGA_E[[BEIDOU, GLONASS]] = 7.292115e-5

_QZSS_LNAV_BITS = 0b101110
_CNAV_BITS = 0b110
_SBAS_RANGING_BIT = 1
_BOUNDARY_NS = 630_000_000

N_SAT_CODES = 100 * len(SYSTEMS)


@dataclass(frozen=True, slots=True, eq=False)
class EphemerisTable:
    """Kepler and state ephemerides of a `Navigation` in one table, as the kernels take them.

    Row k is ``navigation.kepler[k]`` for k below ``n_kepler``, else ``navigation.states[k - n_kepler]``.
    ``rows`` lists the rows satellite by satellite: satellite s has ``rows[first[s]:first[s + 1]]``.
    """

    n_kepler: int
    kind: np.ndarray
    toe_ns: np.ndarray
    toc_ns: np.ndarray
    toe_sow: np.ndarray
    gm: np.ndarray
    omega_e: np.ndarray
    elements: np.ndarray
    healthy: np.ndarray
    ura_m: np.ndarray
    rows: np.ndarray
    first: np.ndarray
    choice_toe_ns: np.ndarray
    choice_sent_ns: np.ndarray
    choice_rank: np.ndarray
    choice_window_ns: np.ndarray
    choice_healthy: np.ndarray


def health_ok(sat, message, health):
    """Judge health words.

    Parameters
    ----------
    sat, message, health : ndarray of int, shape (n,)
        Satellite, `MessageType`, health word as broadcast.

    Returns
    -------
    ndarray of bool, shape (n,)
        The word is zero, except: of GPS and QZSS CNAV only the bits of L1 and L2 count, because L5 has
        been sent as "unhealthy" since it began (IS-GPS-200N 30.3.3.1.1.2); of QZSS LNAV the summary
        bit and the bits of L2C, L5 and L1C, not those of L1C/A and L1C/B, because a satellite sends one
        of the two and marks the other (IS-QZSS-PNT-005 section 4.1.2.3); of SBAS the ranging bit.
    """
    system = np.asarray(sat) // 100
    health = np.asarray(health)
    message = np.asarray(message)
    counted = np.where((system == QZSS) & (message == MessageType.LNAV), _QZSS_LNAV_BITS, -1)
    counted = np.where(
        ((system == GPS) | (system == QZSS)) & (message == MessageType.CNAV), _CNAV_BITS, counted
    )
    counted = np.where(system == SBAS, _SBAS_RANGING_BIT, counted)
    return (health & counted) == 0


_last_table = (None, None)


def ephemeris_table(navigation):
    """`EphemerisTable` of a `Navigation`; the last one made is remembered."""
    global _last_table  # noqa: PLW0603
    remembered, table = _last_table
    if remembered is navigation:
        return table
    table = _make_table(navigation)
    _last_table = (navigation, table)
    return table


def _make_table(navigation):
    kepler, states = navigation.kepler, navigation.states
    n_kepler, n_states = len(kepler), len(states)
    sat = np.concatenate([kepler.sat, states.sat]).astype(np.int64)
    system = sat // 100
    elements = np.zeros((n_kepler + n_states, len(KEPLER_COLUMNS)))
    elements[:n_kepler] = kepler.elements
    elements[n_kepler:, : states.states.shape[1]] = states.states
    message = np.concatenate([kepler.message, np.zeros(n_states, dtype=np.int8)]).astype(np.int64)
    is_state = np.arange(n_kepler + n_states) >= n_kepler
    number = sat % 100
    uses_geo_frame = (message == MessageType.D1) | (message == MessageType.D2)
    is_geo = (system == BEIDOU) & ((number <= 5) | (number >= 59)) & uses_geo_frame & ~is_state
    kind = np.where(is_state, np.where(system == GLONASS, 2, 3), is_geo.astype(np.int64))
    toe_ns = np.concatenate([kepler.toe_ns, states.toe_ns]).astype(np.int64)
    toc_ns = np.concatenate([kepler.toc_ns, states.toe_ns]).astype(np.int64)
    sent_ns = np.concatenate([kepler.transmission_ns, states.transmission_ns]).astype(np.int64)
    health = np.concatenate([kepler.health, states.health])
    healthy = health_ok(sat, message, health).astype(np.int64)
    own_toe_ns = toe_ns - np.where(system == BEIDOU, BDT_OFFSET_NS, 0)
    half_fit_s = np.where(is_state, 0.0, 0.5 * elements[:, KEPLER_COLUMNS.index("fit_interval_s")])
    least_s = np.array([WINDOW_S.get(letter, 0.0) for letter in SYSTEMS])[system]
    state_s = np.array([STATE_WINDOW_S.get(letter, 0.0) for letter in SYSTEMS])[system]
    window_s = np.where(is_state, state_s, np.fmax(least_s, np.fmin(half_fit_s, 86_400.0)))
    ura_m = np.where(is_state, np.nan, elements[:, KEPLER_COLUMNS.index("ura_m")])
    rows = np.argsort(sat, kind="stable")
    first = np.searchsorted(sat[rows], np.arange(N_SAT_CODES + 1)).astype(np.int64)
    rank = np.where(is_state, 0, _RANK[message])
    return EphemerisTable(
        n_kepler=n_kepler,
        kind=kind.astype(np.int64),
        toe_ns=toe_ns,
        toc_ns=toc_ns,
        toe_sow=(own_toe_ns % NS_PER_WEEK) / NS_PER_S,
        gm=_GM[system],
        omega_e=_OMEGA_E[system],
        elements=elements,
        healthy=healthy,
        ura_m=ura_m,
        rows=rows,
        first=first,
        choice_toe_ns=toe_ns[rows],
        choice_sent_ns=sent_ns[rows],
        choice_rank=rank[rows].astype(np.int64),
        choice_window_ns=(window_s * 1e9).astype(np.int64)[rows],
        choice_healthy=healthy[rows],
    )


def select_ephemerides(navigation, sat, time_ns, *, include_unhealthy=False):
    """Choose the broadcast ephemeris of each pair of satellite and time.

    Parameters
    ----------
    navigation : Navigation
        Broadcast ephemerides.
    sat : ndarray of int, shape (n,)
        Satellites, see `truenorth.observations.sat_id`.
    time_ns : int or ndarray of int64, shape (n,)
        GPS time, nanoseconds; to be the same for both receivers of a pair it may be either's time
        tag (tags may differ by a third of a second around a whole second).
    include_unhealthy : bool
        Accept satellites that say they are unhealthy.

    Returns
    -------
    index : ndarray of int64, shape (n,)
        Row of ``navigation.kepler``; or, from ``len(navigation.kepler)`` on, of
        ``navigation.states`` beyond it. -1 where there is none; an unhealthy one keeps its row.
    status : ndarray of uint8, shape (n,)
        `OrbitStatus`.
    """
    from .._kernels.orbits import select_ephemerides as choose

    table = ephemeris_table(navigation)
    sat = np.array(sat, dtype=np.int64, order="C", ndmin=1)
    time_ns = np.array(np.broadcast_to(np.asarray(time_ns, dtype=np.int64), sat.shape))
    second_ns = (time_ns + _BOUNDARY_NS) // NS_PER_S * NS_PER_S
    place = np.empty(len(sat), dtype=np.int64)
    status = np.empty(len(sat), dtype=np.uint8)
    choose(
        sat,
        second_ns,
        table.first,
        table.choice_toe_ns,
        table.choice_sent_ns,
        table.choice_rank,
        table.choice_window_ns,
        table.choice_healthy,
        int(include_unhealthy),
        place,
        status,
    )
    if len(table.rows) == 0:
        return place, status
    return np.where(place >= 0, table.rows[place], -1), status
