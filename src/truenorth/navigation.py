"""The containers of satellite orbits: what every navigation reader fills.

Satellites of GPS, Galileo, BeiDou, QZSS and NavIC follow Kepler elements with corrections;
GLONASS (and SBAS) send state vectors. Both tables are flat columns, one row per ephemeris.
Precise orbits are positions and clocks at regular epochs. `build_navigation` and
`merge_navigation` are the ways to make a `Navigation`: they sort and remove duplicates.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from typing import Any

import numpy as np

__all__ = [
    "KEPLER_COLUMNS",
    "STATE_COLUMNS",
    "KeplerEphemerides",
    "MessageType",
    "Navigation",
    "StateEphemerides",
    "build_navigation",
    "keep_satellites",
    "merge_navigation",
]


class MessageType(IntEnum):
    """Broadcast message that an ephemeris came from."""

    LNAV = 0
    CNAV = 1
    CNAV2 = 2
    INAV = 3
    FNAV = 4
    D1 = 5
    D2 = 6
    CNV1 = 7
    CNV2 = 8
    CNV3 = 9
    FDMA = 10
    SBAS = 11
    L1NV = 12


KEPLER_COLUMNS = (
    "sqrt_a",  # m^0.5; square root of the semi-major axis (at the reference time, see a_dot)
    "eccentricity",
    "i0_rad",
    "omega0_rad",
    "omega_rad",
    "m0_rad",
    "delta_n_radps",
    "omega_dot_radps",
    "idot_radps",
    "cuc_rad",
    "cus_rad",
    "crc_m",
    "crs_m",
    "cic_rad",
    "cis_rad",
    "a_dot_mps",  # 0 for messages without it
    "delta_n_dot_radps2",  # 0 for messages without it
    "af0_s",
    "af1_sps",
    "af2_sps2",
    "tgd_s",  # GPS/QZSS/NavIC TGD; Galileo BGD E5a/E1; BeiDou D1/D2 TGD1 (B1I), CNV1/2 B1Cp, CNV3 B2bI
    "tgd2_s",  # Galileo BGD E5b/E1; BeiDou D1/D2 TGD2 (B2I), CNV1/2 TGD of B2ap; else 0
    "ura_m",  # one-sigma accuracy, NaN where no statement
    "fit_interval_s",  # total length of the fit, centred at toe
)
"""Float columns of `KeplerEphemerides.elements`, in order."""

STATE_COLUMNS = (
    "x_m", "y_m", "z_m",
    "vx_mps", "vy_mps", "vz_mps",
    "ax_mps2", "ay_mps2", "az_mps2",
    "clock_s",  # satellite clock minus system time: GLONASS -TauN, SBAS aGf0
    "clock_drift_sps",  # +GammaN, SBAS aGf1
    "delta_tau_s",  # GLONASS L2 minus L1 group delay; 0 where unknown
)  # fmt: skip
"""Float columns of `StateEphemerides.states` (PZ-90/ECEF at the reference time)."""


@dataclass(frozen=True, slots=True, eq=False)
class KeplerEphemerides:
    """Keplerian ephemerides of all systems that use them, sorted by (sat, toe, transmission).

    Parameters
    ----------
    sat : ndarray of int16, shape (n,)
        Satellite, see `truenorth.observations.sat_id`.
    message : ndarray of int8, shape (n,)
        `MessageType`.
    toe_ns, toc_ns, transmission_ns : ndarray of int64, shape (n,)
        Reference times of orbit and clock and time of transmission, GPS time, nanoseconds.
    iode, iodc : ndarray of int32, shape (n,)
        Issues of data (Galileo: IODnav in both; BeiDou: AODE/AODC or IODE/IODC).
    health : ndarray of int32, shape (n,)
        Health word as broadcast; 0 is healthy.
    elements : ndarray of float64, shape (n, len(KEPLER_COLUMNS))
        The elements, in radians, metres and seconds.
    """

    sat: np.ndarray
    message: np.ndarray
    toe_ns: np.ndarray
    toc_ns: np.ndarray
    transmission_ns: np.ndarray
    iode: np.ndarray
    iodc: np.ndarray
    health: np.ndarray
    elements: np.ndarray

    def __len__(self) -> int:
        """Number of ephemerides."""
        return len(self.sat)

    def column(self, name: str) -> np.ndarray:
        """One column of ``elements`` by its name in `KEPLER_COLUMNS`, shape (n,)."""
        return self.elements[:, KEPLER_COLUMNS.index(name)]


@dataclass(frozen=True, slots=True, eq=False)
class StateEphemerides:
    """State-vector ephemerides (GLONASS FDMA, SBAS), sorted by (sat, reference time).

    Parameters
    ----------
    sat : ndarray of int16, shape (n,)
        Satellite.
    toe_ns, transmission_ns : ndarray of int64, shape (n,)
        Reference time and time of the message frame, already GPS time, nanoseconds.
    channel : ndarray of int8, shape (n,)
        GLONASS frequency channel; 0 for SBAS.
    health : ndarray of int32, shape (n,)
        0 is healthy.
    states : ndarray of float64, shape (n, len(STATE_COLUMNS))
        Position, velocity, acceleration, clock.
    """

    sat: np.ndarray
    toe_ns: np.ndarray
    transmission_ns: np.ndarray
    channel: np.ndarray
    health: np.ndarray
    states: np.ndarray

    def __len__(self) -> int:
        """Number of ephemerides."""
        return len(self.sat)


@dataclass(frozen=True, slots=True, eq=False)
class PreciseOrbits:
    """Positions and clocks at given epochs, as in an SP3 file.

    Parameters
    ----------
    time_ns : ndarray of int64, shape (n_epochs,)
        GPS time, nanoseconds; strictly increasing.
    sat : ndarray of int16, shape (n_sats,)
        Satellites, increasing.
    position_ecef_m : ndarray, shape (n_epochs, n_sats, 3)
        Centre of mass, Earth-fixed frame of the file; NaN where missing.
    clock_s : ndarray, shape (n_epochs, n_sats)
        Satellite clock minus system time, without the periodic relativistic term; NaN where missing.
    sd_m : ndarray, shape (n_sats,)
        Accuracy from the header; NaN where unknown.
    frame, agency, path : str
        What the file says about itself.
    """

    time_ns: np.ndarray
    sat: np.ndarray
    position_ecef_m: np.ndarray
    clock_s: np.ndarray
    sd_m: np.ndarray
    frame: str = ""
    agency: str = ""
    path: str = ""

    @property
    def n_epochs(self) -> int:
        """int: Number of epochs."""
        return len(self.time_ns)

    @property
    def n_sats(self) -> int:
        """int: Number of satellites."""
        return len(self.sat)


@dataclass(frozen=True, slots=True, eq=False)
class Navigation:
    """All that navigation files say.

    Parameters
    ----------
    kepler : KeplerEphemerides
        Orbits by Kepler elements.
    states : StateEphemerides
        Orbits by state vectors.
    klobuchar : dict of str to ndarray, shape (8,)
        Ionosphere coefficients alpha 0-3, beta 0-3 by source letter (``G``, ``C``, ``J``...).
    nequick : ndarray, shape (3,) or None
        Galileo ai0, ai1, ai2.
    leap_seconds : int or None
        GPS minus UTC as broadcast.
    skipped : dict of str to int
        Records that hold no usable orbit, by kind (``"STO"``, ``"EOP"``, ``"CNV9"``...).
    paths : tuple of str
        Files that this came from.
    precise : PreciseOrbits, optional
        Orbits and clocks that take the place of the broadcast ones, satellite by satellite of the file.
    """

    kepler: KeplerEphemerides
    states: StateEphemerides
    klobuchar: dict[str, np.ndarray] = field(default_factory=dict)
    nequick: np.ndarray | None = None
    leap_seconds: int | None = None
    skipped: dict[str, int] = field(default_factory=dict)
    paths: tuple[str, ...] = ()
    precise: PreciseOrbits | None = None

    def glonass_channels(self) -> np.ndarray:
        """GLONASS frequency channel by slot, shape (100,), as in `Observations`."""
        from .constants import GLONASS
        from .observations import NO_CHANNEL

        table = np.full(100, NO_CHANNEL, dtype=np.int8)
        glonass = self.states.sat // 100 == GLONASS
        table[self.states.sat[glonass] % 100] = self.states.channel[glonass]
        return table


_Columns = dict[str, np.ndarray]

_KEPLER_DTYPES = {
    "sat": np.int16,
    "message": np.int8,
    "toe_ns": np.int64,
    "toc_ns": np.int64,
    "transmission_ns": np.int64,
    "iode": np.int32,
    "iodc": np.int32,
    "health": np.int32,
}
_STATE_DTYPES = {
    "sat": np.int16,
    "toe_ns": np.int64,
    "transmission_ns": np.int64,
    "channel": np.int8,
    "health": np.int32,
}


def _unique_in_order(
    columns: _Columns, values: np.ndarray, identity: tuple[str, ...], order: tuple[str, ...]
) -> tuple[_Columns, np.ndarray]:
    """Remove rows that repeat all of `identity` and `values`; then sort by `order` (major first).

    Of repeated rows the one transmitted first stays.
    """
    # A checksum of the values brings equal rows together; whether they are equal is then compared.
    weights = np.arange(1, 2 * values.shape[1], 2, dtype=np.int64) * 0x9E3779B97F4A7C1
    checksum = np.sum(np.ascontiguousarray(values).view(np.int64) * weights, axis=1)
    keys = [checksum, *(columns[name] for name in reversed(identity))]
    sequence = np.lexsort([columns["transmission_ns"], *keys])
    columns = {name: column[sequence] for name, column in columns.items()}
    values = np.ascontiguousarray(values[sequence])
    bits = values.view(np.int64)
    same = np.all(bits[1:] == bits[:-1], axis=1)
    for name in identity:
        same &= columns[name][1:] == columns[name][:-1]
    keep = np.concatenate(([True], ~same)) if len(values) else np.zeros(0, dtype=bool)
    columns = {name: column[keep] for name, column in columns.items()}
    values = values[keep]
    sequence = np.lexsort([columns[name] for name in reversed(order)])
    columns = {name: column[sequence] for name, column in columns.items()}
    return columns, np.ascontiguousarray(values[sequence])


def _make_kepler(columns: _Columns, elements: np.ndarray) -> KeplerEphemerides:
    columns, elements = _unique_in_order(
        columns,
        elements,
        ("sat", "toe_ns", "toc_ns", "message", "iode", "iodc", "health"),
        ("sat", "toe_ns", "transmission_ns", "message"),
    )
    return KeplerEphemerides(**columns, elements=elements)


def _make_states(columns: _Columns, states: np.ndarray) -> StateEphemerides:
    columns, states = _unique_in_order(
        columns, states, ("sat", "toe_ns", "channel", "health"), ("sat", "toe_ns", "transmission_ns")
    )
    return StateEphemerides(**columns, states=states)


def _columns_from_rows(
    rows: Iterable[tuple[Any, ...]], dtypes: Mapping[str, Any], width: int, what: str
) -> tuple[_Columns, np.ndarray]:
    rows = list(rows)
    for row in rows:
        if len(row) != len(dtypes) + 1 or len(row[-1]) != width:
            raise ValueError(f"a {what} row needs {', '.join(dtypes)} and {width} values; got {row!r}")
    columns = {
        name: np.array([row[k] for row in rows], dtype=dtype)
        for k, (name, dtype) in enumerate(dtypes.items())
    }
    values = np.array([row[-1] for row in rows], dtype=np.float64).reshape(len(rows), width)
    return columns, values


def build_navigation(
    kepler_rows: Iterable[tuple[Any, ...]] = (),
    state_rows: Iterable[tuple[Any, ...]] = (),
    *,
    klobuchar: Mapping[str, np.ndarray] | None = None,
    nequick: np.ndarray | None = None,
    leap_seconds: int | None = None,
    skipped: Mapping[str, int] | None = None,
    paths: Iterable[str] = (),
) -> Navigation:
    """Make a `Navigation` from single ephemerides: sorted, without duplicates.

    Parameters
    ----------
    kepler_rows : iterable of tuple
        ``(sat, message, toe_ns, toc_ns, transmission_ns, iode, iodc, health, elements)`` with
        ``elements`` in the order of `KEPLER_COLUMNS`. Times are GPS time.
    state_rows : iterable of tuple
        ``(sat, toe_ns, transmission_ns, channel, health, states)`` with ``states`` in the order of
        `STATE_COLUMNS`.
    klobuchar, nequick, leap_seconds, skipped, paths
        As the attributes of `Navigation`.

    Returns
    -------
    Navigation

    Raises
    ------
    ValueError
        If a row has the wrong number of values.
    """
    return Navigation(
        kepler=_make_kepler(*_columns_from_rows(kepler_rows, _KEPLER_DTYPES, len(KEPLER_COLUMNS), "kepler")),
        states=_make_states(*_columns_from_rows(state_rows, _STATE_DTYPES, len(STATE_COLUMNS), "state")),
        klobuchar=dict(klobuchar or {}),
        nequick=nequick,
        leap_seconds=leap_seconds,
        skipped=dict(skipped or {}),
        paths=tuple(paths),
    )


def merge_navigation(*navigations: Navigation) -> Navigation:
    """Join navigation data: all ephemerides sorted, each once.

    Ionosphere coefficients and leap seconds come from the first argument that has them; counts of
    skipped records add up.

    Parameters
    ----------
    *navigations : Navigation
        What to join; none gives an empty `Navigation`.

    Returns
    -------
    Navigation
    """
    if len(navigations) == 1:
        return navigations[0]
    klobuchar: dict[str, np.ndarray] = {}
    skipped: dict[str, int] = {}
    paths: list[str] = []
    nequick = leap = precise = None
    for navigation in navigations:
        klobuchar = {**navigation.klobuchar, **klobuchar}
        nequick = navigation.nequick if nequick is None else nequick
        precise = navigation.precise if precise is None else precise
        leap = navigation.leap_seconds if leap is None else leap
        paths += [path for path in navigation.paths if path not in paths]
        for kind, count in navigation.skipped.items():
            skipped[kind] = skipped.get(kind, 0) + count

    def joined(table: str, name: str, dtype: Any, width: int | None = None) -> np.ndarray:
        parts = [getattr(getattr(navigation, table), name) for navigation in navigations]
        empty = np.empty(0 if width is None else (0, width), dtype=dtype)
        return np.concatenate([empty, *parts]).astype(dtype)

    return Navigation(
        kepler=_make_kepler(
            {name: joined("kepler", name, dtype) for name, dtype in _KEPLER_DTYPES.items()},
            joined("kepler", "elements", np.float64, len(KEPLER_COLUMNS)),
        ),
        states=_make_states(
            {name: joined("states", name, dtype) for name, dtype in _STATE_DTYPES.items()},
            joined("states", "states", np.float64, len(STATE_COLUMNS)),
        ),
        klobuchar=klobuchar,
        nequick=nequick,
        leap_seconds=leap,
        precise=precise,
        skipped=skipped,
        paths=tuple(paths),
    )


def keep_satellites(navigation: Navigation, sats: np.ndarray) -> Navigation:
    """Keep the broadcast ephemerides of some satellites.

    Parameters
    ----------
    navigation : Navigation
        All of them.
    sats : ndarray of int
        Satellites to keep.

    Returns
    -------
    Navigation
        With all else unchanged.
    """

    def rows(table: Any) -> Any:
        keep = np.isin(table.sat, sats)
        return replace(table, **{entry.name: getattr(table, entry.name)[keep] for entry in fields(table)})

    return replace(navigation, kepler=rows(navigation.kepler), states=rows(navigation.states))
