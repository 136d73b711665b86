"""Settings of the solver and of a session: strict, with every default printed back.

Unknown keys and impossible values are refused before any work starts, naming the key.
"""

from __future__ import annotations

import difflib
import math
import os
import re
import tomllib
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NoReturn, TypeVar, Union, get_args, get_origin

import msgspec

from .constants import BAND_CLASSES, SYSTEMS
from .errors import ConfigError, FormatError

__all__ = [
    "METHODS",
    "AntennaSection",
    "ArraySettings",
    "AttitudeFilterSettings",
    "GnssSection",
    "GnssSettings",
    "PlatformSection",
    "ReliabilitySection",
    "Session",
    "StochasticSettings",
    "convert_settings",
    "toml_lines",
]

METHODS = ("constrained", "lambda", "lsast", "exhaustive", "kalman", "filter")
"""Names of the integer resolution methods."""

Method = Literal["constrained", "lambda", "lsast", "exhaustive", "kalman", "filter"]
LengthUse = Literal["constrain", "check", "compute", "off"]
RatioTest = Literal["none", "fixed", "fixed_failure_rate", "difference"]


class StochasticSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Noise of undifferenced observations: ``sd^2 = (a^2 + b^2 / sin^2 el) * 10^((45 - C/N0)/10 * s)``."""

    phase_sd_m: float = 0.002
    """Part of the phase noise that does not depend on elevation, metres."""
    phase_elevation_sd_m: float = 0.002
    """Part that grows with 1/sin(elevation), metres."""
    code_sd_m: float = 0.30
    """Code noise, the constant part, metres."""
    code_elevation_sd_m: float = 0.30
    """Code noise that grows with 1/sin(elevation), metres."""
    cn0_reference_dbhz: float = 45.0
    """Signals above this C/N0 get no further trust; those below are weighted down."""
    cn0_slope: float = 0.5
    """Share s of the thermal law; 0 ignores C/N0, 1 follows it. A compromise, chosen on the real pairs:
    docs/validation/real_data.md tabulates what other values give there."""
    correlation_s: float = 20.0
    """Time over which multipath stays alike: epochs closer together count in part."""
    memory_epochs: float = 10.0
    """Carried ambiguities never weigh more than this many independent epochs."""
    estimate: bool = True
    """Scale phase and code noise by variance factors estimated robustly from a sample of the run."""

    def __post_init__(self) -> None:
        for key in ("phase_sd_m", "code_sd_m", "correlation_s"):
            if not getattr(self, key) > 0.0:
                value = getattr(self, key)
                raise ConfigError(f"`{key}` is {value!r}; give a positive number", key=key, value=value)
        for key in ("phase_elevation_sd_m", "code_elevation_sd_m", "cn0_slope"):
            if not getattr(self, key) >= 0.0:
                value = getattr(self, key)
                raise ConfigError(f"`{key}` is {value!r}; give 0 or more", key=key, value=value)
        if not self.memory_epochs >= 1.0:
            value = self.memory_epochs
            raise ConfigError(
                f"`memory_epochs` is {value!r}; give 1 or more", key="memory_epochs", value=value
            )


class GnssSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What `truenorth.solve_baseline` does, and the ``[gnss]`` table of a session file."""

    method: Method = "constrained"
    """Integer resolution."""
    direction: Literal["forward", "backward", "combined"] = "forward"
    """Of the methods that carry ambiguities over epochs."""
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
    estimate_length: bool = False
    """Take the length from a first run without it, then use it like a declared one."""
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
    single_candidate: Literal["auto", "refuse", "accept"] = "auto"
    """``lsast``: what a lone survivor is worth, whose ratio test is void. ``auto`` refuses it in a single
    epoch and accepts it where the others fell over several epochs (Harvey 1998, sec. 4.2)."""
    min_epochs_to_fix: int = 1
    """Epochs that the same candidate must win before it is accepted (multi-epoch methods)."""
    rotation_rate_sd_dps: float | None = None
    """Rate dynamics of the methods that carry ambiguities: the direction wanders by so many degrees in
    a second, one sigma, from the last accepted one. Left out, every epoch's baseline is free."""
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
        for key in ("residual_significance", "failure_rate"):
            if not 0.0 < getattr(self, key) < 1.0:
                refuse(key, getattr(self, key), "a share between 0 and 1")
        if not self.ratio_threshold >= 1.0:
            refuse("ratio_threshold", self.ratio_threshold, "1 or more")
        if not self.length_tolerance_sd > 0.0:
            refuse("length_tolerance_sd", self.length_tolerance_sd, "a positive number")
        if self.min_epochs_to_fix < 1:
            refuse("min_epochs_to_fix", self.min_epochs_to_fix, "1 or more")
        if not self.cn0_mask_dbhz >= 0.0:
            refuse("cn0_mask_dbhz", self.cn0_mask_dbhz, "0 or more")
        if not 0.0 <= self.max_time_difference_s <= 1.0:
            refuse("max_time_difference_s", self.max_time_difference_s, "0 to 1 second")
        if not min(self.direction_sd_deg) > 0.0:
            refuse("direction_sd_deg", self.direction_sd_deg, "two positive angles")
        if self.rotation_rate_sd_dps is not None and not self.rotation_rate_sd_dps > 0.0:
            refuse("rotation_rate_sd_dps", self.rotation_rate_sd_dps, "a positive rate, or leave it out")
        if self.direction_azimuth_deg is not None and self.length_m is None:
            refuse("direction_azimuth_deg", self.direction_azimuth_deg, "`length_m` with it")


class ArraySettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How three and more antennas are solved, and the ``[array]`` table of a session file."""

    resolution: Literal["joint", "baselines"] = "joint"
    """``joint``: the integers of all antennas together, the body geometry inside the search; where the
    observations refute the geometry, the baselines one by one. ``baselines``: those alone."""
    position_sd_m: float = 0.002
    """Standard deviation of each body coordinate, independent, metres."""
    success_probability: float = 0.999
    """Posterior probability that all integers are right, demanded of the joint search."""
    method: Literal["adjustment", "wahba", "implicit", "direct", "triad", "pseudoinverse"] = "adjustment"
    """Attitude from the vectors: the weighted adjustment on the rotation group, or a classical method."""
    angle_tolerance_deg: float | None = None
    """Tolerance of the angles between vectors where the baselines are solved one by one; left out, four
    standard deviations of each angle. Wang & Lachapelle (2002) use 5 degrees."""
    keep_vectors: bool = True
    """Keep the vectors between the antennas with their joint covariance: 0.7 kB an epoch of four antennas."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.position_sd_m <= 10.0:
            value = self.position_sd_m
            raise ConfigError(
                f"`position_sd_m` is {value!r}; give a standard deviation from 0 to 10 metres",
                key="position_sd_m", value=value,
            )  # fmt: skip
        if not 0.5 <= self.success_probability < 1.0:
            value = self.success_probability
            raise ConfigError(
                f"`success_probability` is {value!r}; give a share from 0.5 to below 1",
                key="success_probability", value=value,
            )  # fmt: skip
        if self.angle_tolerance_deg is not None and not 0.0 < self.angle_tolerance_deg <= 180.0:
            value = self.angle_tolerance_deg
            raise ConfigError(
                f"`angle_tolerance_deg` is {value!r}; give an angle above 0 to 180, or leave it out",
                key="angle_tolerance_deg", value=value,
            )  # fmt: skip


class AttitudeFilterSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What `truenorth.attitude.filter.filter_attitude` does: the ``[attitude_filter]`` table."""

    direction: Literal["forward", "backward", "smoother"] = "forward"
    """``forward`` knows the past, ``backward`` the future, ``smoother`` both."""
    process: Literal["continuous", "wang"] = "continuous"
    """``continuous``: noise of the rates per time, whatever the epochs' interval; ``wang``: the same step at
    every epoch, as printed by Wang and Lachapelle (2002), eq. 9."""
    rate_noise_dps2_per_s: tuple[float, float, float] = (40.0, 40.0, 40.0)
    """Variance that the rate about the forward, right and down axis gains in a second, (deg/s)^2/s. 40 is
    2 deg/s in every 0.1 s."""
    rate_step_dps: tuple[float, float, float] = (2.0, 2.0, 2.0)
    """With ``process = "wang"``: standard deviation that every epoch adds to the rates, deg/s."""
    initial_rate_sd_dps: float = 30.0
    """Of the rate, which is taken as zero at a start."""
    gate: bool = True
    """Test the innovations and leave out what fails."""
    significance: float = 0.001
    """Of the local test (two-sided: 3.29) and of the vector-wise one (16.3)."""
    power: float = 0.8
    """With which all tests find an error of the size that the local test finds (B-method)."""
    global_test: Literal["b_method", "significance"] = "b_method"
    """Limit of the global test: of equal power with the local one (Baarda 1968), or of equal significance."""
    max_passes: int = 4
    """Antennas that may be left out of one epoch before all of it is."""
    lock_out_epochs: int = 5
    """Epochs in a row, what was left of which does not hold all three axes, after which the filter counts
    as locked out."""
    recovery: Literal["restart", "inflate", "none"] = "restart"
    """After a lock-out: start anew by least squares, widen the covariance, or go on predicting."""
    max_prediction_s: float = 10.0
    """Longest time without an update; after it the filter starts anew."""
    max_sd_deg: float = 30.0
    """Attitudes less certain than this (root of the sum of the three variances) are not given out."""
    output_rate_hz: float | None = None
    """Give out attitudes at this rate, on whole multiples of its period in GPS time, instead of at the
    epochs of the vectors."""
    keep_predictions: bool = True
    """Keep what was predicted before every update, which `innovations` needs."""

    def __post_init__(self) -> None:
        def refuse(key: str, wanted: str) -> NoReturn:
            value = getattr(self, key)
            raise ConfigError(f"`{key}` is {value!r}; give {wanted}", key=key, value=value)

        for key in ("rate_noise_dps2_per_s", "rate_step_dps"):
            if not all(0.0 < value < math.inf for value in getattr(self, key)):
                refuse(key, "three positive numbers")
        for key in ("initial_rate_sd_dps", "max_prediction_s", "max_sd_deg"):
            if not 0.0 < getattr(self, key) < math.inf:
                refuse(key, "a positive number")
        if not 0.0 < self.significance < 1.0:
            refuse("significance", "a share between 0 and 1")
        if not self.significance < self.power < 1.0:
            refuse("power", "a share between `significance` and 1")
        for key in ("max_passes", "lock_out_epochs"):
            if getattr(self, key) < 1:
                refuse(key, "1 or more")
        if self.output_rate_hz is not None and not 0.0 < self.output_rate_hz <= 10_000.0:
            refuse("output_rate_hz", "a rate up to 10000 Hz, or leave it out")


class ReliabilitySection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tests for blunders, minimal detectable blunders and protection levels: the ``[reliability]`` table."""

    false_alarm: float = 0.001
    """Significance of the test of one observation; those of all others follow by the B-method."""
    missed_detection: float = 0.2
    """One less the power at the minimal detectable blunder."""
    mdb_screen: Literal["none", "estimated", "innovation"] = "none"
    """Further condition of a rejection. ``estimated``: the estimated blunder exceeds the minimal detectable
    one, which raises the limit from 3.29 to 4.13 and leaves a power of one half at the minimal detectable
    blunder; ``innovation``: the residual itself exceeds it, as printed by Wang and Lachapelle (2002)."""
    max_rejections: int = 2
    """Most vectors (or observations) of an epoch that are left out, one pass each; an epoch that needs more
    is not used."""
    separation: float = 13.8
    """An exclusion must explain the data better than any other by this much in chi-square, a likelihood
    ratio of a thousand; otherwise the epoch is not used."""
    integrity_risk: float = 1e-5
    """Probability, in an epoch and for each angle, that its error exceeds the protection level unnoticed."""
    fault_prior: float = 1e-4
    """Probability that an antenna is at fault in an epoch by any amount; antennas independently."""
    satellite_prior: float = 0.0
    """Probability that the phases of a satellite are at fault in an epoch, for levels from phases."""
    wrong_integer_risk: float = 0.0
    """Probability that the integers of an epoch are wrong, where the run does not state its own; taken off
    the integrity risk. With 0 the levels are those of right integers."""

    def __post_init__(self) -> None:
        for key in ("false_alarm", "missed_detection", "integrity_risk"):
            value = getattr(self, key)
            if not 0.0 < value < 1.0:
                raise ConfigError(
                    f"`{key}` is {value!r}; give a probability between 0 and 1", key=key, value=value
                )
        for key in ("fault_prior", "satellite_prior", "wrong_integer_risk"):
            value = getattr(self, key)
            if not 0.0 <= value < 1.0:
                raise ConfigError(
                    f"`{key}` is {value!r}; give a probability, 0 or more", key=key, value=value
                )
        if self.max_rejections < 0:
            raise ConfigError(
                f"`max_rejections` is {self.max_rejections!r}; give 0 or more",
                key="max_rejections",
                value=self.max_rejections,
            )
        if not self.separation >= 0.0:
            raise ConfigError(
                f"`separation` is {self.separation!r}; give 0 or more",
                key="separation",
                value=self.separation,
            )


def _describe(settings: msgspec.Struct) -> Any:
    """Settings as plain dictionaries, every default included."""
    return msgspec.to_builtins(settings)


class AntennaSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One antenna of the platform, a ``[[platform.antennas]]`` table of a session file."""

    name: str
    observations: str
    """File of its receiver; relative to the session file."""
    position_body_m: tuple[float, float, float] | None = None
    """Where it stands in the body frame: forward, right, down, metres."""


class PlatformSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The ``[platform]`` table: antennas in body coordinates, or one known length."""

    name: str = ""
    antennas: tuple[AntennaSection, ...]
    """Two or more. The first is the reference, from which every baseline points; with three or more
    each needs its body coordinates."""
    length_m: float | None = None
    """Separation of two antennas, where body coordinates are not known."""


class GnssSection(GnssSettings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The ``[gnss]`` table: `GnssSettings` and the navigation files."""

    navigation: tuple[str, ...] = ()
    """Broadcast ephemerides; may be left out where the observation logs hold them (UBX)."""


class Session(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A session file: the platform, its files and how to solve them.

    Paths are relative to the session file in the file, and relative to the working directory (or
    absolute) here. Use `read` for a file, `from_toml` for text, `for_pair` for two observation files.
    """

    platform: PlatformSection
    gnss: GnssSection = GnssSection()
    array: ArraySettings = ArraySettings()
    attitude_filter: AttitudeFilterSettings | None = None
    """Filter or smooth the attitude; left out, every epoch stands by itself."""
    reliability: ReliabilitySection | None = None
    """State detectable blunders, their effect and protection levels of every epoch; left out, none."""

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Session:
        """Read a session file and make sure that its input files exist.

        Parameters
        ----------
        path : str or path-like
            The ``session.toml``.

        Returns
        -------
        Session

        Raises
        ------
        FormatError
            If the session file cannot be read.
        ConfigError
            If it is not TOML, holds an unknown key or an impossible value, or names a missing file.
        """
        path = Path(path)
        try:
            text = path.read_text(encoding="utf-8")
        except OSError as error:
            raise FormatError(f"could not read the session: {error.strerror}", path=str(path)) from error
        except UnicodeDecodeError as error:
            raise FormatError("could not read the session: it is not UTF-8 text", path=str(path)) from error
        try:
            session = cls.from_toml(text, folder=path.parent)
        except ConfigError as error:
            raise ConfigError(f"{path}: {error}", key=error.key, value=error.value) from error
        for key, name in session._files():
            if not Path(name).is_file():
                raise ConfigError(f"{path}: `{key}` names {name}, which is not a file", key=key, value=name)
        return session

    @classmethod
    def from_toml(cls, text: str, *, folder: str | os.PathLike[str] = "") -> Session:
        """Read a session from TOML text.

        Parameters
        ----------
        text : str
            The content of a session file.
        folder : str or path-like
            What relative paths start from.

        Returns
        -------
        Session

        Raises
        ------
        ConfigError
            If the text is not TOML, or holds an unknown key or an impossible value.
        """
        try:
            table = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise ConfigError(f"the session is not valid TOML: {error}") from error
        session = convert_settings(table, cls)
        antennas = tuple(
            msgspec.structs.replace(antenna, observations=os.path.join(folder, antenna.observations))
            for antenna in session.platform.antennas
        )
        navigation = tuple(os.path.join(folder, name) for name in session.gnss.navigation)
        return msgspec.structs.replace(
            session,
            platform=msgspec.structs.replace(session.platform, antennas=antennas),
            gnss=msgspec.structs.replace(session.gnss, navigation=navigation),
        )

    @classmethod
    def for_pair(
        cls, base: str, rover: str, navigation: tuple[str, ...] = (), settings: GnssSettings | None = None
    ) -> Session:
        """Session of two observation files and their navigation files; names relative to here."""
        antennas = (
            AntennaSection(name="base", observations=str(base)),
            AntennaSection(name="rover", observations=str(rover)),
        )
        fields = msgspec.structs.asdict(settings or GnssSettings())
        gnss = GnssSection(**fields, navigation=tuple(str(name) for name in navigation))
        return cls(platform=PlatformSection(antennas=antennas), gnss=gnss)

    def __post_init__(self) -> None:
        def refuse(key: str, value: object, text: str) -> NoReturn:
            raise ConfigError(f"`{key}` {text}", key=key, value=value)

        antennas = self.platform.antennas
        if len(antennas) < 2:
            refuse("platform.antennas", len(antennas), f"holds {len(antennas)} antennas; give two or more")
        names = [antenna.name for antenna in antennas]
        for k, name in enumerate(names):
            if name in names[:k]:
                refuse(f"platform.antennas[{k}].name", name, "is used twice; give each antenna its own")
        if len(antennas) > 2:
            self._check_array(refuse)
            return
        lengths = {
            "gnss.length_m": self.gnss.length_m,
            "platform.length_m": self.platform.length_m,
            "platform.antennas": _body_length_m(*antennas),
        }
        known = [(key, length_m) for key, length_m in lengths.items() if length_m is not None]
        for key, length_m in known:
            _check_length(key, length_m, refuse)
            if abs(length_m - known[0][1]) > 5.0 * self.gnss.length_sd_m + 0.001:
                other, other_m = known[0]
                refuse(
                    key, length_m, f"gives {length_m:g} m but `{other}` gives {other_m:g} m; give one of them"
                )

    def _check_array(self, refuse: Callable[[str, object, str], NoReturn]) -> None:
        """Three and more antennas: body coordinates of each, apart from one another, and no single length."""
        antennas = self.platform.antennas
        for key, length_m in (
            ("gnss.length_m", self.gnss.length_m),
            ("platform.length_m", self.platform.length_m),
        ):
            if length_m is not None:
                refuse(key, length_m, f"is for two antennas; {len(antennas)} have their body coordinates")
        for k, antenna in enumerate(antennas):
            key = f"platform.antennas[{k}].position_body_m"
            if antenna.position_body_m is None:
                refuse(key, None, f"is missing; {len(antennas)} antennas need their body coordinates")
            for other in antennas[:k]:
                length_m = _body_length_m(other, antenna)
                if length_m is not None:
                    _check_length(key, length_m, refuse)

    @property
    def observation_paths(self) -> tuple[str, ...]:
        """Observation files of the antennas, the reference first."""
        return tuple(antenna.observations for antenna in self.platform.antennas)

    @property
    def is_array(self) -> bool:
        """Whether the platform has three antennas or more."""
        return len(self.platform.antennas) > 2

    @property
    def settings(self) -> GnssSettings:
        """Solver settings, with the length that a platform of two gives where ``[gnss]`` has none."""
        fields = msgspec.structs.asdict(self.gnss)
        del fields["navigation"]
        if not self.is_array:
            for length_m in (self.platform.length_m, _body_length_m(*self.platform.antennas)):
                if fields["length_m"] is None:
                    fields["length_m"] = length_m
        return GnssSettings(**fields)

    def to_toml(self, *, folder: str | os.PathLike[str] | None = None) -> str:
        """Write the session as TOML, every default included.

        Parameters
        ----------
        folder : str or path-like, optional
            Where the file will live: names of files below it become relative to it, others absolute.
            By default names stay as they are.

        Returns
        -------
        str
            Text that `from_toml` reads back to an equal session.
        """

        def place(name: str) -> str:
            if folder is None:
                return name
            absolute, home = Path(name).resolve(), Path(folder).resolve()
            return str(absolute.relative_to(home) if absolute.is_relative_to(home) else absolute)

        table = _describe(self)
        for antenna in table["platform"]["antennas"]:
            antenna["observations"] = place(antenna["observations"])
        table["gnss"]["navigation"] = [place(name) for name in table["gnss"]["navigation"]]
        return "\n".join(toml_lines(table)).lstrip() + "\n"

    def _files(self) -> list[tuple[str, str]]:
        """Input files with the keys that name them."""
        named = [
            (f"platform.antennas[{k}].observations", antenna.observations)
            for k, antenna in enumerate(self.platform.antennas)
        ]
        return named + [(f"gnss.navigation[{k}]", name) for k, name in enumerate(self.gnss.navigation)]


def _body_length_m(first: AntennaSection, second: AntennaSection) -> float | None:
    """Separation of two antennas by their body coordinates, None where one is not given."""
    if first.position_body_m is None or second.position_body_m is None:
        return None
    return math.dist(first.position_body_m, second.position_body_m)


def _check_length(key: str, length_m: float, refuse: Callable[[str, object, str], NoReturn]) -> None:
    if not 0.01 <= length_m <= 10_000.0:
        refuse(key, length_m, f"gives a length of {length_m:g} m; give one from 0.01 to 10000 m")


Section = TypeVar("Section", bound=msgspec.Struct)


def convert_settings(table: dict[str, Any], kind: type[Section], *, prefix: str = "") -> Section:
    """Turn plain dictionaries into settings, strictly.

    Parameters
    ----------
    table : dict
        Keys and values, as read from TOML or the command line.
    kind : type
        `GnssSettings`, `Session` or another struct of this module.
    prefix : str
        What error messages write before the keys, e.g. ``gnss.``.

    Returns
    -------
    msgspec.Struct
        An instance of `kind`.

    Raises
    ------
    ConfigError
        Naming the key in dotted form: unknown (with the nearest known one), missing, of a wrong
        type, or with an impossible value.
    """
    _refuse_unknown(table, kind, prefix)
    try:
        return msgspec.convert(table, kind)
    except msgspec.ValidationError as error:
        match = re.fullmatch(r"(?s)(.*?)(?: - at `\$\.?(.*)`)?", str(error))
        assert match is not None  # the pattern matches any text
        text, place = match.group(1), prefix + (match.group(2) or "")
        cause = error.__cause__
        if isinstance(cause, ConfigError):
            outer = f"{place}." if place and not place.endswith(".") else place
            key = f"{outer}{cause.key}"
            raise ConfigError(
                str(cause).replace(f"`{cause.key}`", f"`{key}`", 1), key=key, value=cause.value
            ) from None
        if missing := re.search(r"missing required field `(\w+)`", text):
            key = f"{place}.{missing.group(1)}".lstrip(".")
            raise ConfigError(f"`{key}` is missing; give it", key=key) from None
        value = _value_at(table, place.removeprefix(prefix))
        wanted = _choices(kind, place.removeprefix(prefix)) or text[:1].lower() + text[1:]
        raise ConfigError(f"`{place}` is {value!r}; {wanted}", key=place, value=value) from None


def _refuse_unknown(table: Any, kind: Any, prefix: str) -> None:
    """Refuse keys that a struct does not have, at any depth, suggesting the nearest one."""
    if get_origin(kind) is tuple and isinstance(table, list | tuple):
        for k, item in enumerate(table):
            _refuse_unknown(item, get_args(kind)[0], f"{prefix.removesuffix('.')}[{k}].")
    if not isinstance(table, dict):
        return
    struct = _struct_for(table, kind, prefix)
    if struct is None:
        return
    kinds = {entry.name: entry.type for entry in msgspec.structs.fields(struct)}
    tag = struct.__struct_config__.tag_field
    for key, value in table.items():
        if key == tag:
            continue
        if key not in kinds:
            near = difflib.get_close_matches(key, kinds, n=1, cutoff=0.5)
            hint = f"did you mean `{near[0]}`?" if near else "known are " + ", ".join(list(kinds)[:8])
            if not near and len(kinds) > 8:
                hint += " ... (the settings file beside any result holds them all)"
            raise ConfigError(f"`{prefix}{key}` is not a setting; {hint}", key=prefix + key, value=value)
        _refuse_unknown(value, kinds[key], f"{prefix}{key}.")


def _struct_for(table: dict[str, Any], kind: Any, prefix: str) -> type[msgspec.Struct] | None:
    """The struct that a table is meant for; of several kinds the one that its tag names."""
    options = get_args(kind) if get_origin(kind) in (Union, types.UnionType) else (kind,)
    structs = [
        option for option in options if isinstance(option, type) and issubclass(option, msgspec.Struct)
    ]
    if len(structs) < 2:
        return structs[0] if structs else None
    configs = {struct.__struct_config__.tag: struct for struct in structs}
    tag_field = structs[0].__struct_config__.tag_field
    wanted = table.get(str(tag_field))
    if wanted not in configs:
        known = ", ".join(str(tag) for tag in configs)
        said = "is missing" if wanted is None else f"is {wanted!r}"
        key = f"{prefix}{tag_field}"
        raise ConfigError(f"`{key}` {said}; give one of {known}", key=key, value=wanted)
    return configs[wanted]


def _choices(kind: Any, place: str) -> str:
    """What a setting that is one of a few words may be, as ``give one of ...``; else empty."""
    for name in place.split("."):
        if not (isinstance(kind, type) and issubclass(kind, msgspec.Struct)):
            return ""
        kind = {entry.name: entry.type for entry in msgspec.structs.fields(kind)}.get(name)
    return "give one of " + ", ".join(get_args(kind)) if get_origin(kind) is Literal else ""


def _value_at(table: Any, place: str) -> Any:
    """The value at a dotted place such as ``platform.antennas[0].name``."""
    for name in re.findall(r"\w+", place):
        table = table[int(name)] if isinstance(table, list) else table[name]
    return table


def toml_lines(table: dict[str, Any], prefix: str = "") -> list[str]:
    """Lines of a TOML table; settings without a value stand as comments, for TOML has no null."""
    lines, inner = [], []
    for key, value in table.items():
        if isinstance(value, dict):
            inner += ["", f"[{prefix}{key}]", *toml_lines(value, f"{prefix}{key}.")]
        elif isinstance(value, list | tuple) and value and isinstance(value[0], dict):
            for item in value:
                inner += ["", f"[[{prefix}{key}]]", *toml_lines(item, f"{prefix}{key}.")]
        elif value is None:
            lines.append(f"# {key} is not set")
        else:
            lines.append(f"{key} = {_toml_value(value)}")
    return lines + inner


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # JSON escapes are TOML escapes, but for the delete character, which TOML wants escaped.
        return msgspec.json.encode(value).decode().replace("\x7f", "\\u007F")
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml_value(item) for item in value) + "]"
    return repr(value)
