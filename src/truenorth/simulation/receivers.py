"""Simulated receivers: which signals they track, their clocks, their noise and how they lose lock.

Noise by C/N0 after Kaplan & Hegarty 2017, Understanding GPS/GNSS, sec. 8.6 to 8.9 (thermal noise of PLL,
FLL and DLL); clocks as the two-state model of Brown & Hwang 2012, sec. 9.3.
"""

from __future__ import annotations

from typing import NoReturn

import msgspec
import numpy as np

from ..constants import FREQUENCY_HZ, SYSTEMS
from ..errors import ConfigError
from .multipath import MultipathSection

__all__ = [
    "BiasSection",
    "ClockSection",
    "ConstantNoise",
    "ReceiverClock",
    "ReceiverSection",
    "ThermalNoise",
    "TrackingSection",
    "antenna_gain_db",
    "noise_sd",
]


def _refuse(key: str, value: object, wanted: str) -> NoReturn:
    raise ConfigError(f"`{key}` is {value!r}; give {wanted}", key=key, value=value)


class ClockSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Oscillator of a receiver; its reading minus GPS time is the clock offset."""

    offset_s: float = 0.0
    """At the start."""
    offset_sd_s: float = 1e-7
    """Spread of the start value between receivers."""
    drift_sps: float = 0.0
    """Frequency offset at the start, seconds per second."""
    drift_sd_sps: float = 0.0
    """Spread of the start value between receivers."""
    white_frequency: float = 1e-10
    """White frequency noise as Allan deviation at one second."""
    random_walk_frequency: float = 1e-11
    """Random walk of the frequency, per square root of a second."""
    jump_s: float = 0.0
    """Where the offset exceeds half of this, it is set back by this (0.001: millisecond jumps); 0: never."""
    jump_phase: bool = True
    """Phases jump with the codes and stay consistent with them."""
    oscillator: str = ""
    """Receivers that name the same oscillator share it; empty for one of its own."""

    def __post_init__(self) -> None:
        for key in ("offset_sd_s", "drift_sd_sps", "white_frequency", "random_walk_frequency", "jump_s"):
            if not getattr(self, key) >= 0.0:
                _refuse(key, getattr(self, key), "0 or more")
        if abs(self.offset_s) > 0.5:
            _refuse("offset_s", self.offset_s, "half a second at most")


class ThermalNoise(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="thermal"
):
    """Thermal noise of the tracking loops, by C/N0."""

    pll_bandwidth_hz: float = 15.0
    dll_bandwidth_hz: float = 0.2
    correlator_spacing_chips: float = 0.5
    integration_s: float = 0.02
    factor: float = 1.0
    """All standard deviations times this."""

    def __post_init__(self) -> None:
        for key in ("pll_bandwidth_hz", "dll_bandwidth_hz", "correlator_spacing_chips", "integration_s"):
            if not getattr(self, key) > 0.0:
                _refuse(key, getattr(self, key), "a positive number")
        if not self.factor >= 0.0:
            _refuse("factor", self.factor, "0 or more")


class ConstantNoise(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="constant"
):
    """White noise of one standard deviation for every signal, as the published studies assume."""

    code_sd_m: float = 0.3
    phase_sd_m: float = 0.002
    doppler_sd_hz: float = 0.05

    def __post_init__(self) -> None:
        for key in ("code_sd_m", "phase_sd_m", "doppler_sd_hz"):
            if not getattr(self, key) >= 0.0:
                _refuse(key, getattr(self, key), "0 or more")


class TrackingSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """When a channel acquires, loses and slips."""

    acquire_dbhz: float = 33.0
    """C/N0 that a lost channel needs to come back."""
    lose_dbhz: float = 28.0
    """Below this, lock is lost."""
    code_wait_s: float = 1.0
    """From the signal's return to the first pseudorange."""
    phase_wait_s: float = 3.0
    """From the signal's return to the first phase."""
    slips_per_hour: float = 0.0
    """Of each signal, at random."""
    slip_cycles: int = 8
    """Random slips are 1 to this many cycles, either way."""
    slip_flag_share: float = 1.0
    """Share of the random slips that the receiver notices and flags."""
    half_cycle_s: float = 0.0
    """After re-acquisition the phase is ambiguous by half a cycle for this long, and flagged."""
    half_cycle_share: float = 0.5
    """Share of re-acquisitions that are off by half a cycle."""

    def __post_init__(self) -> None:
        if self.acquire_dbhz < self.lose_dbhz:
            _refuse("acquire_dbhz", self.acquire_dbhz, "at least `lose_dbhz`")
        for key in ("code_wait_s", "phase_wait_s", "slips_per_hour", "half_cycle_s"):
            if not getattr(self, key) >= 0.0:
                _refuse(key, getattr(self, key), "0 or more")
        for key in ("slip_flag_share", "half_cycle_share"):
            if not 0.0 <= getattr(self, key) <= 1.0:
                _refuse(key, getattr(self, key), "a share between 0 and 1")
        if self.slip_cycles < 1:
            _refuse("slip_cycles", self.slip_cycles, "1 or more")


class BiasSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Delays of antenna line and receiver, drawn once for each signal."""

    code_sd_m: float = 1.0
    phase_sd_cyc: float = 0.3
    glonass_code_m_per_channel: float = 0.0
    """Inter-channel bias of GLONASS FDMA codes."""
    glonass_phase_m_per_channel: float = 0.0
    """Inter-channel bias of GLONASS FDMA phases."""


_SIGNALS = {
    "G": ("1C", "2W"),
    "R": ("1C", "2C"),
    "E": ("1C", "5Q"),
    "C": ("2I", "7I"),
    "J": ("1C", "2L"),
}


class ReceiverSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A receiver and its antenna; ``[receiver]`` holds for all, an antenna's own table is laid over it."""

    type: str = "TRUENORTH SIMULATOR"
    """Name in the RINEX header."""
    antenna_type: str = ""
    """IGS name of the antenna; with the scenario's `antex` file its phase centre is applied."""
    signals: dict[str, tuple[str, ...]] = msgspec.field(default_factory=lambda: dict(_SIGNALS))
    """RINEX signals by system letter; systems that are not named are not tracked."""
    channels: int = 0
    """Satellites tracked at once, the highest first; 0 for no limit."""
    tag_offset_s: float = 0.0
    """Time tags stand this much after the scenario's grid (pair_38m_gps: receivers off the second)."""
    zenith_cn0_dbhz: float = 50.0
    horizon_cn0_dbhz: float = 36.0
    back_loss_db: float = 25.0
    """Further loss from the antenna's horizon to straight below; choke rings have more."""
    cn0_sd_db: float = 0.3
    boresight_body: tuple[float, float, float] = (0.0, 0.0, -1.0)
    """Where the antenna looks: forward, right, down."""
    clock: ClockSection = ClockSection()
    noise: ThermalNoise | ConstantNoise = ThermalNoise()
    tracking: TrackingSection = TrackingSection()
    bias: BiasSection = BiasSection()
    multipath: MultipathSection = MultipathSection()

    def __post_init__(self) -> None:
        for letter, names in self.signals.items():
            if letter not in SYSTEMS:
                _refuse("signals", letter, f"system letters among {SYSTEMS}")
            for name in names:
                is_signal = len(name) == 2 and name[0].isdigit() and name[1].isalpha()
                if not is_signal or np.isnan(FREQUENCY_HZ[SYSTEMS.index(letter), int(name[0])]):
                    _refuse(f"signals.{letter}", name, "RINEX signals such as 1C, with a band of the system")
        if self.channels < 0:
            _refuse("channels", self.channels, "0 or more")
        if self.horizon_cn0_dbhz > self.zenith_cn0_dbhz:
            _refuse("horizon_cn0_dbhz", self.horizon_cn0_dbhz, "no more than `zenith_cn0_dbhz`")
        if not np.linalg.norm(self.boresight_body) > 0.0:
            _refuse("boresight_body", self.boresight_body, "a direction")


# Chip lengths in metres by system letter and band digit; 293 m where not named.
_CHIP_M = {
    "G5": 29.3, "J5": 29.3, "E5": 29.3, "E7": 29.3, "E8": 29.3, "E6": 58.6, "J6": 58.6, "S5": 29.3,
    "R1": 586.7, "R2": 586.7, "R3": 29.3, "C2": 146.5, "C7": 146.5, "C6": 29.3, "C5": 29.3, "C8": 29.3,
    "G2W": 29.3, "G1W": 29.3, "G1P": 29.3, "G2P": 29.3, "R1P": 58.7, "R2P": 58.7,
}  # fmt: skip


def chip_length_m(system: str, signal: str) -> float:
    """Length of a code chip of a RINEX signal, metres."""
    return _CHIP_M.get(system + signal, _CHIP_M.get(system + signal[0], 293.05))


def noise_sd(
    noise: ThermalNoise | ConstantNoise, cn0_dbhz: np.ndarray, wavelength_m: np.ndarray, chip_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Standard deviations of code (m), phase (m) and Doppler (Hz).

    Parameters
    ----------
    noise : ThermalNoise or ConstantNoise
        The model.
    cn0_dbhz, wavelength_m, chip_m : ndarray
        Carrier-to-noise density, carrier wavelength, length of a chip.

    Returns
    -------
    code_sd_m, phase_sd_m, doppler_sd_hz : ndarray
        Kaplan & Hegarty 2017, eq. (8.97) (DLL, narrow correlator), (8.66) (PLL), (8.76) (FLL).
    """
    if isinstance(noise, ConstantNoise):
        n = len(cn0_dbhz)
        return np.full(n, noise.code_sd_m), np.full(n, noise.phase_sd_m), np.full(n, noise.doppler_sd_hz)
    cn0 = 10.0 ** (0.1 * cn0_dbhz)
    t = noise.integration_s
    d = noise.correlator_spacing_chips
    squaring = 1.0 + 1.0 / (2.0 * t * cn0)
    phase = wavelength_m / (2.0 * np.pi) * np.sqrt(noise.pll_bandwidth_hz / cn0 * squaring)
    code = chip_m * np.sqrt(noise.dll_bandwidth_hz * d / (2.0 * cn0) * (1.0 + 2.0 / ((2.0 - d) * t * cn0)))
    doppler = np.sqrt(4.0 * noise.pll_bandwidth_hz / 4.0 / cn0 * (1.0 + 1.0 / (t * cn0))) / (2.0 * np.pi * t)
    return noise.factor * code, noise.factor * phase, noise.factor * doppler


def antenna_gain_db(receiver: ReceiverSection, sin_elevation: np.ndarray) -> np.ndarray:
    """Gain relative to the zenith of the antenna, dB, by the sine of the elevation above its own horizon."""
    drop = receiver.zenith_cn0_dbhz - receiver.horizon_cn0_dbhz
    above = np.maximum(sin_elevation, 0.0)
    return -drop * (1.0 - above**0.7) + receiver.back_loss_db * np.minimum(sin_elevation, 0.0)


class ReceiverClock:
    """Clock offset of one receiver from epoch to epoch; the state is carried between blocks.

    Parameters
    ----------
    section : ClockSection
        What kind of oscillator.
    generator : numpy.random.Generator
        Its own stream.
    """

    def __init__(self, section: ClockSection, generator: np.random.Generator) -> None:
        self._section = section
        self._generator = generator
        self._time_s: float | None = None
        start = generator.standard_normal(2)
        self._offset_s = section.offset_s + section.offset_sd_s * start[0]
        self._drift_sps = section.drift_sps + section.drift_sd_sps * start[1]

    def step(self, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Offsets (s), drifts (s/s) and how much of the offset phases do not follow (s), shape (n,) each.

        ``time_s`` increases and goes on from the previous call.
        """
        n = len(time_s)
        draws = self._generator.standard_normal((n, 2))
        first = self._time_s if self._time_s is not None else time_s[0]
        dt = np.diff(time_s, prepend=first)
        white = self._section.white_frequency * np.sqrt(dt) * draws[:, 0]
        walk = self._section.random_walk_frequency * np.sqrt(dt) * draws[:, 1]
        # Summed from the carried value on, so that the blocks leave no trace in the last digit.
        drift = np.cumsum(np.concatenate(([self._drift_sps], walk)))
        before, drift = drift[:-1], drift[1:]
        offset = np.cumsum(np.concatenate(([self._offset_s], before * dt + white)))[1:]
        self._time_s, self._offset_s, self._drift_sps = time_s[-1], offset[-1], drift[-1]
        # The unwrapped clock is carried; jumps are what the receiver takes off it.
        jump = self._section.jump_s
        jumps = jump * np.rint(offset / jump) if jump > 0.0 else np.zeros(n)
        safe_dt = np.where(dt > 0.0, dt, 1.0)
        rate = before + white / safe_dt
        return offset - jumps, rate, np.zeros(n) if self._section.jump_phase else jumps
