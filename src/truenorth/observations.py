"""The container of raw observations: what every reader fills and every solver eats.

One row is one signal of one satellite at one epoch: code, phase, Doppler and C/N0 side by side.
Rows are sorted by (epoch, satellite, signal) in flat columns; ``epoch_start`` holds the row offsets
of the epochs. Satellites and signals are small integers (`sat_id`, `signal_id`).
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .constants import FREQUENCY_HZ, GLONASS, GLONASS_CHANNEL_STEP_HZ, SYSTEMS

__all__ = [
    "LLI_HALF_CYCLE",
    "LLI_SLIP",
    "NO_CHANNEL",
    "ObservationEvent",
    "ObservationMeta",
    "Observations",
    "frequency_hz",
    "sat_id",
    "sat_name",
    "signal_id",
    "signal_name",
]

LLI_SLIP = 1
"""Bit of ``lli``: lock was lost since the previous observation of this signal."""

LLI_HALF_CYCLE = 2
"""Bit of ``lli``: the phase may be off by half a cycle."""

NO_CHANNEL = -128
"""Value of an unknown GLONASS frequency channel."""

_UNKNOWN_ATTRIBUTE = 26


def sat_id(name: str) -> int:
    """Integer of a satellite name: 100 * system + number; ``"G05"`` is 5, ``"E11"`` is 211."""
    return SYSTEMS.index(name[0]) * 100 + int(name[1:])


def sat_name(sat: int) -> str:
    """Name of a satellite integer, the inverse of `sat_id`."""
    return f"{SYSTEMS[sat // 100]}{sat % 100:02d}"


def signal_id(name: str) -> int:
    """Integer of a RINEX 3 band and attribute: 100 * band + letter; ``"1C"`` is 102.

    A missing or blank attribute (``"1 "``) is kept as unknown.
    """
    attribute = name[1:2]
    letter = ord(attribute) - ord("A") if attribute.isalpha() else _UNKNOWN_ATTRIBUTE
    return int(name[0]) * 100 + letter


def signal_name(signal: int) -> str:
    """Band and attribute of a signal integer, the inverse of `signal_id` (unknown is ``"?"``)."""
    letter = signal % 100
    return f"{signal // 100}{'?' if letter == _UNKNOWN_ATTRIBUTE else chr(ord('A') + letter)}"


def frequency_hz(sat: Any, signal: Any, glonass_channel: np.ndarray | None = None) -> np.ndarray:
    """Carrier frequency of satellite-signal pairs.

    Parameters
    ----------
    sat, signal : int or ndarray of int
        Codes of `sat_id` and `signal_id`.
    glonass_channel : ndarray, shape (100,), optional
        Frequency channel by GLONASS slot number, `NO_CHANNEL` where unknown.

    Returns
    -------
    ndarray
        Hertz; NaN for bands that the system does not have and for GLONASS FDMA satellites whose
        channel is unknown.
    """
    sat, signal = np.asarray(sat), np.asarray(signal)
    system, band = sat // 100, signal // 100
    freq = FREQUENCY_HZ[system, band].copy()
    for fdma_band, step in GLONASS_CHANNEL_STEP_HZ.items():
        fdma = (system == GLONASS) & (band == fdma_band)
        if np.any(fdma):
            table = np.full(100, NO_CHANNEL) if glonass_channel is None else glonass_channel
            channel = np.asarray(table, dtype=float)[sat % 100]
            shifted = freq + np.where(channel == NO_CHANNEL, np.nan, channel) * step
            freq = np.where(fdma, shifted, freq)
    return freq


@dataclass(frozen=True, slots=True)
class ObservationEvent:
    """An event record of the file (RINEX epoch flags 2 to 6, or a receiver's own message).

    Parameters
    ----------
    time_ns : int or None
        GPS time, nanoseconds; None where the record carries no time.
    flag : int
        RINEX epoch flag.
    text : str
        What was said, one line per record line.
    """

    time_ns: int | None
    flag: int
    text: str


@dataclass(frozen=True, slots=True)
class ObservationMeta:
    """What a file says about itself; empty strings and None where it is silent."""

    path: str = ""
    format: str = ""
    version: str = ""
    marker: str = ""
    receiver_type: str = ""
    receiver_serial: str = ""
    receiver_firmware: str = ""
    antenna_type: str = ""
    antenna_serial: str = ""
    approx_position_ecef_m: tuple[float, float, float] | None = None
    antenna_delta_hen_m: tuple[float, float, float] | None = None
    interval_s: float | None = None
    leap_seconds: int | None = None
    phase_shift_cyc: dict[str, float] = field(default_factory=dict)
    """Declared phase shifts by system and signal, e.g. ``{"G2X": 0.25}``; already in the phases."""
    glonass_code_phase_bias_m: dict[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Raw observations of one receiver.

    Parameters
    ----------
    time_ns : ndarray of int64, shape (n_epochs,)
        Receiver time tags in GPS time, nanoseconds since 1980-01-06; strictly increasing.
    epoch_start : ndarray of int64, shape (n_epochs + 1,)
        Rows of epoch k are ``epoch_start[k]:epoch_start[k + 1]``.
    sat : ndarray of int16, shape (n_rows,)
        Satellite, see `sat_id`.
    signal : ndarray of int16, shape (n_rows,)
        Band and tracking attribute, see `signal_id`.
    code_m, phase_cyc, doppler_hz, cn0_dbhz : ndarray of float64, shape (n_rows,)
        Pseudorange, carrier phase (positive with range), Doppler (positive for approaching
        satellites), carrier-to-noise density. NaN where missing.
    lli : ndarray of uint8, shape (n_rows,)
        `LLI_SLIP` and `LLI_HALF_CYCLE` bits of the phase.
    clock_offset_s : ndarray of float64, shape (n_epochs,)
        Receiver clock offset given in the file, NaN where absent. Not applied to the observations.
    glonass_channel : ndarray of int8, shape (100,)
        GLONASS frequency channel by slot number; `NO_CHANNEL` where unknown.
    meta : ObservationMeta
        What the file says about itself.
    events : tuple of ObservationEvent
        Event records in file order.
    """

    time_ns: np.ndarray
    epoch_start: np.ndarray
    sat: np.ndarray
    signal: np.ndarray
    code_m: np.ndarray
    phase_cyc: np.ndarray
    doppler_hz: np.ndarray
    cn0_dbhz: np.ndarray
    lli: np.ndarray
    clock_offset_s: np.ndarray
    glonass_channel: np.ndarray
    meta: ObservationMeta = ObservationMeta()
    events: tuple[ObservationEvent, ...] = ()

    @property
    def n_epochs(self) -> int:
        """int: Number of epochs."""
        return len(self.time_ns)

    @property
    def n_rows(self) -> int:
        """int: Number of satellite-signal rows over all epochs."""
        return len(self.sat)

    @property
    def epoch_of_row(self) -> np.ndarray:
        """Ndarray of int64, shape (n_rows,): epoch index of every row."""
        return np.repeat(np.arange(self.n_epochs), np.diff(self.epoch_start))

    def select_epochs(self, keep: slice | np.ndarray) -> "Observations":
        """Keep some epochs.

        Parameters
        ----------
        keep : slice or ndarray of bool or int
            Index of the epochs, in increasing order.

        Returns
        -------
        Observations
        """
        chosen = np.arange(self.n_epochs)[keep]
        counts = np.diff(self.epoch_start)[chosen]
        start = np.concatenate(([0], np.cumsum(counts))).astype(np.int64)
        rows = np.repeat(self.epoch_start[chosen] - start[:-1], counts) + np.arange(start[-1])
        return replace(
            self._take_rows(rows),
            time_ns=self.time_ns[chosen],
            epoch_start=start,
            clock_offset_s=self.clock_offset_s[chosen],
        )

    def select_rows(self, keep: np.ndarray) -> "Observations":
        """Keep some rows; epochs stay, possibly empty.

        Parameters
        ----------
        keep : ndarray of bool, shape (n_rows,)
            Rows to keep.

        Returns
        -------
        Observations
        """
        cumulative = np.concatenate(([0], np.cumsum(keep)))
        return replace(
            self._take_rows(np.flatnonzero(keep)),
            epoch_start=cumulative[self.epoch_start].astype(np.int64),
        )

    def _take_rows(self, rows: np.ndarray) -> "Observations":
        columns = ("sat", "signal", "code_m", "phase_cyc", "doppler_hz", "cn0_dbhz", "lli")
        return replace(self, **{name: getattr(self, name)[rows] for name in columns})

    def __str__(self) -> str:
        """One line: source, epochs, span, satellites."""
        from .timescales import format_gpst

        if self.n_epochs == 0:
            return f"{self.meta.path or 'observations'}: no epochs"
        systems = "".join(SYSTEMS[k] for k in np.unique(self.sat // 100))
        return (
            f"{self.meta.path or 'observations'}: {self.n_epochs} epochs, "
            f"{format_gpst(self.time_ns[0])} to {format_gpst(self.time_ns[-1])} GPST, "
            f"{len(np.unique(self.sat))} satellites ({systems})"
        )
