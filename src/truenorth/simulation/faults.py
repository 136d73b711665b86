"""Faults on schedule: slips, blunders, lost satellites, dead receivers."""

from __future__ import annotations

from typing import NoReturn

import msgspec
import numpy as np

from ..constants import SYSTEMS
from ..errors import ConfigError
from ..observations import sat_id, signal_id

__all__ = [
    "BlunderFault",
    "DeadFault",
    "Fault",
    "LostFault",
    "ScheduledSlips",
    "SlipFault",
]


def _refuse(key: str, value: object, wanted: str) -> NoReturn:
    raise ConfigError(f"`{key}` is {value!r}; give {wanted}", key=key, value=value)


def _check_names(satellite: str, signal: str) -> None:
    if satellite and not (len(satellite) == 3 and satellite[0] in SYSTEMS and satellite[1:].isdigit()):
        _refuse("satellite", satellite, "a name such as G05, or leave it out for all")
    if signal and not (len(signal) == 2 and signal[0].isdigit() and signal[1].isalpha()):
        _refuse("signal", signal, "a RINEX signal such as 1C, or leave it out for all")


class SlipFault(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="slip"
):
    """The phase jumps by whole cycles at an instant, without a flag."""

    antenna: str
    time_s: float
    satellite: str
    signal: str = ""
    """RINEX signal; empty for all of the satellite."""
    cycles: int = 1

    def __post_init__(self) -> None:
        _check_names(self.satellite, self.signal)


class BlunderFault(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="blunder"
):
    """Metres added to code or phase for some time."""

    antenna: str
    start_s: float
    end_s: float
    satellite: str = ""
    signal: str = ""
    code_m: float = 0.0
    phase_m: float = 0.0

    def __post_init__(self) -> None:
        _check_names(self.satellite, self.signal)
        if not self.end_s > self.start_s:
            _refuse("end_s", self.end_s, "a time after `start_s`")


class LostFault(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="lost"
):
    """A satellite (or signal) is lost at one receiver for some time."""

    antenna: str
    start_s: float
    end_s: float
    satellite: str = ""
    signal: str = ""

    def __post_init__(self) -> None:
        _check_names(self.satellite, self.signal)
        if not self.end_s > self.start_s:
            _refuse("end_s", self.end_s, "a time after `start_s`")


class DeadFault(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="dead"
):
    """A receiver gives no epochs from an instant on."""

    antenna: str
    start_s: float
    end_s: float = float("inf")
    """When it comes back, its ambiguities new."""

    def __post_init__(self) -> None:
        if not self.end_s > self.start_s:
            _refuse("end_s", self.end_s, "a time after `start_s`")


Fault = SlipFault | BlunderFault | LostFault | DeadFault


class ScheduledSlips(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Unflagged slips at random instants, receivers and satellites in view (Wang & Lachapelle 2002)."""

    count: int = 0
    min_cycles: int = 1
    max_cycles: int = 8
    start_s: float = 10.0
    """No slip before."""

    def __post_init__(self) -> None:
        if self.count < 0:
            _refuse("count", self.count, "0 or more")
        if not 1 <= self.min_cycles <= self.max_cycles:
            _refuse("max_cycles", self.max_cycles, "`min_cycles` or more, and that 1 or more")

    def draw(
        self, generator: np.random.Generator, duration_s: float, n_antennas: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Instants (s), antennas, places in the list of satellites (0 to 1), cycles; shape (count,) each."""
        time = np.sort(generator.uniform(self.start_s, max(duration_s, self.start_s), self.count))
        antenna = generator.integers(0, n_antennas, self.count)
        place = generator.uniform(0.0, 1.0, self.count)
        size = generator.integers(self.min_cycles, self.max_cycles + 1, self.count)
        sign = generator.choice((-1, 1), self.count)
        return time, antenna, place, size * sign


def concerns(fault: SlipFault | BlunderFault | LostFault, sat: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """Rows of a satellite-specific fault; ``sat``, ``signal`` of shape (n,)."""
    chosen = np.ones(len(sat), dtype=bool)
    if fault.satellite:
        chosen &= sat == sat_id(fault.satellite)
    if fault.signal:
        chosen &= signal == signal_id(fault.signal)
    return chosen
