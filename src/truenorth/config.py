"""Settings of the solver and of a session: strict, with every default printed back.

Unknown keys and impossible values are refused before any work starts, naming the key.
"""

from __future__ import annotations

from typing import Any, Literal, NoReturn

import msgspec

from .constants import BAND_CLASSES, SYSTEMS
from .errors import ConfigError

__all__ = ["METHODS", "GnssSettings", "StochasticSettings"]

METHODS = ("constrained", "lambda", "lsast", "exhaustive", "kalman", "filter")
"""Names of the integer resolution methods."""

Method = Literal["constrained", "lambda", "lsast", "exhaustive", "kalman", "filter"]
LengthUse = Literal["constrain", "check", "compute", "off"]
RatioTest = Literal["none", "fixed", "fixed_failure_rate", "difference"]


class StochasticSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Noise of undifferenced observations: ``sd^2 = (a^2 + b^2 / sin^2 el) * 10^((45 - C/N0)/10 * s)``."""

    phase_sd_m: float = 0.003
    """Part of the phase noise that does not depend on elevation, metres."""
    phase_elevation_sd_m: float = 0.003
    """Part that grows with 1/sin(elevation), metres."""
    code_sd_m: float = 0.30
    """Code noise, the constant part, metres."""
    code_elevation_sd_m: float = 0.30
    """Code noise that grows with 1/sin(elevation), metres."""
    cn0_reference_dbhz: float = 45.0
    """Signals above this C/N0 get no further trust; those below are weighted down."""
    cn0_slope: float = 0.0
    """Share s of the thermal law; 0 ignores C/N0, 1 follows it."""
    estimate: bool = False
    """Scale the noise by a variance factor estimated robustly from the run."""


class GnssSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What `truenorth.solve_baseline` does, and the ``[gnss]`` table of a session file."""

    method: Method = "constrained"
    """Integer resolution."""
    single_epoch: bool = False
    """Resolve every epoch by itself, remembering nothing."""
    systems: str = "GRECJ"
    """Letters of the satellite systems to use."""
    bands: tuple[str, ...] = ("L1", "L2", "L5")
    """Band names, see `truenorth.constants.BAND_CLASSES`."""
    elevation_mask_deg: float = 15.0
    cn0_mask_dbhz: float = 0.0
    """Signals below are left out; 0 keeps all."""
    length_m: float | None = None
    """Known antenna separation, metres."""
    length_sd_m: float = 0.003
    """Its standard deviation."""
    length_use: LengthUse = "constrain"
    """``constrain``: in the search, and checked after it; ``check``: checked only;
    ``compute``: compared and reported, never decides; ``off``: ignored."""
    use_code: bool = True
    """Pseudoranges take part in the resolution (always in the single-point position)."""
    success_probability: float = 0.99
    """Posterior probability that the integers are right, demanded for acceptance."""
    ratio_test: RatioTest = "none"
    """Classical test beside the probability: fixed threshold, fixed failure rate, difference."""
    ratio_threshold: float = 3.0
    failure_rate: float = 0.001
    """For ``ratio_test = "fixed_failure_rate"``."""
    residual_significance: float = 1e-4
    """False-alarm rate of the chi-square test of the winner's residuals."""
    length_tolerance_sd: float = 4.0
    """Measured and declared length may differ by this many joint standard deviations."""
    min_epochs_to_fix: int = 1
    """Epochs that the same candidate must win before it is accepted (multi-epoch methods)."""
    direction_azimuth_deg: float | None = None
    """A-priori azimuth of the baseline, with `direction_sd_deg`."""
    direction_elevation_deg: float = 0.0
    direction_sd_deg: tuple[float, float] = (10.0, 5.0)
    """Standard deviations of the a-priori azimuth and elevation, degrees."""
    glonass_ambiguities: Literal["float", "calibrated"] = "float"
    """GLONASS FDMA phases: float (code only helps), or integer for alike receivers."""
    max_time_difference_s: float = 0.05
    """Base and rover time tags further apart are not the same epoch."""
    stochastic: StochasticSettings = StochasticSettings()

    def __post_init__(self) -> None:
        def refuse(key: str, value: object, wanted: str) -> NoReturn:
            raise ConfigError(f"`{key}` is {value!r}; give {wanted}", key=key, value=value)

        if not self.systems or set(self.systems) - set(SYSTEMS):
            refuse("systems", self.systems, f"letters among {SYSTEMS}")
        for band in self.bands:
            if band not in BAND_CLASSES:
                refuse("bands", band, "names among " + ", ".join(BAND_CLASSES))
        if not self.bands:
            refuse("bands", self.bands, "at least one of " + ", ".join(BAND_CLASSES))
        if not -90.0 <= self.elevation_mask_deg < 90.0:
            refuse("elevation_mask_deg", self.elevation_mask_deg, "an angle from -90 to below 90")
        if self.length_m is not None and not 0.01 <= self.length_m <= 10_000.0:
            refuse("length_m", self.length_m, "a length from 0.01 to 10000 metres")
        if not 0.0 <= self.length_sd_m <= 100.0:
            refuse("length_sd_m", self.length_sd_m, "a standard deviation from 0 to 100 metres")
        if not 0.5 <= self.success_probability < 1.0:
            refuse("success_probability", self.success_probability, "a share from 0.5 to below 1")


def _describe(settings: msgspec.Struct) -> Any:
    """Settings as plain dictionaries, every default included."""
    return msgspec.to_builtins(settings)
