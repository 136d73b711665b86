"""The container of broadcast ephemerides: what every navigation reader fills.

Satellites of GPS, Galileo, BeiDou, QZSS and NavIC follow Kepler elements with corrections;
GLONASS (and SBAS) send state vectors. Both tables are flat columns, one row per ephemeris.
"""

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

__all__ = [
    "KEPLER_COLUMNS",
    "STATE_COLUMNS",
    "KeplerEphemerides",
    "MessageType",
    "Navigation",
    "StateEphemerides",
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
    "tgd_s",  # GPS/QZSS/NavIC TGD; Galileo BGD E5a/E1; BeiDou TGD1 (B1I)
    "tgd2_s",  # Galileo BGD E5b/E1; BeiDou TGD2 (B2I); else 0
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
    """

    kepler: KeplerEphemerides
    states: StateEphemerides
    klobuchar: dict[str, np.ndarray] = field(default_factory=dict)
    nequick: np.ndarray | None = None
    leap_seconds: int | None = None
    skipped: dict[str, int] = field(default_factory=dict)
    paths: tuple[str, ...] = ()

    def glonass_channels(self) -> np.ndarray:
        """GLONASS frequency channel by slot, shape (100,), as in `Observations`."""
        from .constants import GLONASS
        from .observations import NO_CHANNEL

        table = np.full(100, NO_CHANNEL, dtype=np.int8)
        glonass = self.states.sat // 100 == GLONASS
        table[self.states.sat[glonass] % 100] = self.states.channel[glonass]
        return table
