"""A scenario: where, when, how it moves, what is aboard, what goes wrong; one strict TOML file."""

from __future__ import annotations

import copy
import os
import re
import tomllib
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from ..config import GnssSettings, convert_settings, toml_lines
from ..errors import ConfigError, FormatError
from ..sensors import SensorsSection
from ..timescales import parse_gpst
from .environment import EnvironmentSection
from .faults import Fault, ScheduledSlips
from .motion import MotionSection, StaticMotion
from .receivers import ReceiverSection
from .sky import NominalSky, SkySection
from .visibility import VisibilitySection

__all__ = [
    "FlexureSection",
    "OutputSection",
    "PlaceSection",
    "Scenario",
    "SimulatedAntenna",
    "SimulatedPlatform",
    "read_scenario",
    "scenario_names",
]


class PlaceSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where the motion starts."""

    latitude_deg: float
    longitude_deg: float
    height_m: float = 100.0
    """Above the ellipsoid."""

    def __post_init__(self) -> None:
        if not -90.0 <= self.latitude_deg <= 90.0:
            value = self.latitude_deg
            raise ConfigError(f"`latitude_deg` is {value!r}; give -90 to 90", key="latitude_deg", value=value)
        if not -180.0 <= self.longitude_deg <= 360.0:
            value = self.longitude_deg
            raise ConfigError(
                f"`longitude_deg` is {value!r}; give -180 to 360", key="longitude_deg", value=value
            )


class SimulatedAntenna(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One antenna with its receiver, a ``[[platform.antennas]]`` table."""

    name: str
    position_body_m: tuple[float, float, float]
    """Of the antenna reference point in the body frame: forward, right, down, metres."""
    receiver: ReceiverSection = ReceiverSection()
    """What differs from the scenario's ``[receiver]``."""

    def __post_init__(self) -> None:
        # The name becomes a file name.
        if not re.fullmatch(r"[A-Za-z0-9_-]+", self.name):
            raise ConfigError(
                f"`name` is {self.name!r}; give letters, digits, - and _", key="name", value=self.name
            )


class FlexureSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Bending of the array: antennas swing about their places, farther ones more."""

    amplitude_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Of an antenna `reference_m` from the origin; forward, right, down."""
    reference_m: float = 10.0
    period_s: float = 8.0

    def __post_init__(self) -> None:
        for key in ("reference_m", "period_s"):
            if not getattr(self, key) > 0.0:
                raise ConfigError(f"`{key}` is {getattr(self, key)!r}; give a positive number", key=key)


class SimulatedPlatform(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The ``[platform]`` table."""

    name: str = ""
    antennas: tuple[SimulatedAntenna, ...] = ()
    """None where there is no sky, and only sensors are aboard."""
    flexure: FlexureSection = FlexureSection()

    def __post_init__(self) -> None:
        names = [antenna.name for antenna in self.antennas]
        for name in names:
            if names.count(name) > 1:
                raise ConfigError(
                    f"`antennas` names {name!r} twice; give each antenna its own name",
                    key="antennas",
                    value=name,
                )


class OutputSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The ``[output]`` table: what `truenorth simulate` writes beside truth and sensor tables."""

    observations: tuple[Literal["rinex", "ubx", "oem3"], ...] = ("rinex",)
    """Formats of the raw observations; ``session.toml`` names the first."""
    gzip: bool = False
    native_sensors: bool = True
    """Sensor logs also in the format of the instrument."""
    signal_truth: bool = True
    """Every error term of every observation and sensor sample, as Parquet tables."""
    quantise: bool = True
    """Observations carry the digits of a RINEX file, in memory as well."""

    def __post_init__(self) -> None:
        if not self.observations:
            raise ConfigError("`observations` is empty; give rinex, ubx or oem3", key="observations")


class Scenario(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All that a simulation needs; read one with `read_scenario`."""

    name: str
    title: str = ""
    """One line for `truenorth simulate --list`."""
    source: str = ""
    """The publication that it re-creates."""
    assumes: tuple[str, ...] = ()
    """What the source leaves open and was chosen here."""
    seed: int = 1
    start: str = "2024-06-24T08:00:00"
    """GPS time of the first epoch."""
    duration_s: float
    interval_s: float = 1.0
    place: PlaceSection
    platform: SimulatedPlatform
    motion: MotionSection = StaticMotion()
    sky: SkySection = NominalSky()
    visibility: VisibilitySection = VisibilitySection()
    environment: EnvironmentSection = EnvironmentSection()
    receiver: ReceiverSection = ReceiverSection()
    antex: str = ""
    """ANTEX file with the phase centres of the antennas that name their type."""
    slips: ScheduledSlips = ScheduledSlips()
    faults: tuple[Fault, ...] = ()
    sensors: SensorsSection = SensorsSection()
    solve: GnssSettings = GnssSettings()
    """What ``session.toml`` tells the solver."""
    output: OutputSection = OutputSection()
    folder: str = ""
    """What relative paths start from; of a file its own folder."""

    def __post_init__(self) -> None:
        def refuse(key: str, wanted: str) -> None:
            raise ConfigError(
                f"`{key}` is {getattr(self, key)!r}; give {wanted}", key=key, value=getattr(self, key)
            )

        if not 0.0 < self.duration_s <= 7 * 86400.0:
            refuse("duration_s", "more than 0 seconds and at most a week")
        if not 0.001 <= self.interval_s <= 3600.0:
            refuse("interval_s", "0.001 to 3600 seconds")
        if self.seed < 0:
            refuse("seed", "0 or more")
        try:
            parse_gpst(self.start)
        except ValueError:
            refuse("start", "a time such as 2024-06-24T08:00:00")
        known = [antenna.name for antenna in self.platform.antennas]
        if not known and self.sensors == SensorsSection():
            raise ConfigError(
                "the platform has neither antennas nor sensors; give it one of them", key="platform.antennas"
            )
        for k, fault in enumerate(self.faults):
            if fault.antenna not in known:
                raise ConfigError(
                    f"`faults[{k}].antenna` is {fault.antenna!r}; give one of " + ", ".join(known),
                    key=f"faults[{k}].antenna",
                    value=fault.antenna,
                )

    @property
    def start_ns(self) -> int:
        """int: GPS time of the first epoch, nanoseconds."""
        return parse_gpst(self.start)

    @property
    def n_epochs(self) -> int:
        """int: Number of epochs, both ends included."""
        return int(np.floor(self.duration_s / self.interval_s + 1e-9)) + 1

    @property
    def interval_ns(self) -> int:
        """int: Time between epochs, nanoseconds."""
        return round(self.interval_s * 1e9)

    def epoch_s(self, first: int, last: int) -> np.ndarray:
        """Instants of the epochs ``first`` to ``last - 1``, seconds since the start."""
        return np.arange(first, last) * (self.interval_ns * 1e-9)

    def to_toml(self) -> str:
        """The scenario with every default, as TOML."""
        table = msgspec.to_builtins(self)
        del table["folder"]
        return "\n".join(toml_lines(table)).lstrip() + "\n"


def scenario_names() -> list[str]:
    """Names of the scenarios in the package, sorted."""
    files = resources.files(__package__).joinpath("scenarios").iterdir()
    return sorted(file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml"))


def read_scenario(
    scenario: str | os.PathLike[str] | Mapping[str, Any] | Scenario,
    overrides: Mapping[str, Any] | Iterable[str] = (),
) -> Scenario:
    """Read a scenario: one of the package by name, a TOML file, or a dictionary of the same shape.

    A file may build on another one: ``extends = "harvey-suburban"`` takes everything from there and
    replaces what it names itself. An antenna's ``receiver`` table is laid over the common ``[receiver]``.

    Parameters
    ----------
    scenario : str, path-like, dict or Scenario
        Name, file or content.
    overrides : dict or sequence of str
        Dotted keys with values, or texts such as ``"duration_s=60"``, ``"platform.antennas.1.name=aft"``;
        values of texts are TOML, or else plain strings.

    Returns
    -------
    Scenario

    Raises
    ------
    ConfigError
        For an unknown scenario or key or an impossible value, by name.
    FormatError
        If a file cannot be read.
    """
    if isinstance(scenario, Scenario):
        if not overrides:
            return scenario
        table, folder = msgspec.to_builtins(scenario), scenario.folder
    elif isinstance(scenario, Mapping):
        folder = str(scenario.get("folder", ""))
        table = _extended(_plain(scenario), folder, ())
    else:
        table, folder = _read_table(scenario, ())
    for key, value in _parse_overrides(overrides):
        _put(table, key, _plain(value))
    antennas = (
        table.get("platform", {}).get("antennas", ()) if isinstance(table.get("platform"), dict) else ()
    )
    for antenna in antennas:
        if isinstance(antenna, dict) and isinstance(table.get("receiver", {}), dict):
            antenna["receiver"] = _laid_over(table.get("receiver", {}), antenna.get("receiver", {}))
    table["folder"] = str(folder)
    return convert_settings(table, Scenario)


def _plain(value: Any) -> Any:
    """A copy of tables and lists in which numbers and arrays of NumPy are plain ones."""
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return [_plain(entry) for entry in value] if isinstance(value, list | tuple) else value


def _read_table(name: str | os.PathLike[str], trail: tuple[str, ...]) -> tuple[dict[str, Any], str]:
    """Content of a named scenario or a file, and the folder of its relative paths."""
    text_name = os.fspath(name)
    if not text_name.endswith(".toml"):
        import difflib

        if text_name not in scenario_names():
            near = difflib.get_close_matches(text_name, scenario_names(), n=1, cutoff=0.4)
            hint = f"did you mean {near[0]!r}?" if near else "`truenorth simulate --list` shows them"
            raise ConfigError(f"there is no scenario {text_name!r}; {hint}", key="scenario", value=text_name)
        text = resources.files(__package__).joinpath("scenarios", f"{text_name}.toml").read_text("utf-8")
        folder = ""
    else:
        path = Path(text_name)
        try:
            text = path.read_text(encoding="utf-8")
        except OSError as error:
            raise FormatError(f"could not read the scenario: {error.strerror}", path=text_name) from error
        except UnicodeDecodeError as error:
            raise FormatError("could not read the scenario: it is not UTF-8 text", path=text_name) from error
        folder = str(path.parent)
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{text_name} is not valid TOML: {error}") from error
    return _extended(table, folder, (*trail, text_name)), folder


def _extended(table: dict[str, Any], folder: str, trail: tuple[str, ...]) -> dict[str, Any]:
    """A table laid over the scenario that it extends."""
    parent = table.pop("extends", None)
    if parent is None:
        return table
    name = os.path.join(folder, parent) if str(parent).endswith(".toml") else str(parent)
    if name in trail:
        raise ConfigError(f"`extends` leads back to {name!r}; break the circle", key="extends", value=name)
    base, _ = _read_table(name, trail)
    return _laid_over(base, table)


def _laid_over(base: Mapping[str, Any], top: Mapping[str, Any]) -> dict[str, Any]:
    """Tables merged key by key; a table of another kind replaces the one below."""
    merged = copy.deepcopy(dict(base))
    for key, value in top.items():
        below = merged.get(key)
        if isinstance(below, Mapping) and isinstance(value, Mapping) and key != "signals":
            is_same_kind = "kind" not in value or below.get("kind", value["kind"]) == value["kind"]
            merged[key] = _laid_over(below, value) if is_same_kind else copy.deepcopy(value)
        else:
            merged[key] = copy.deepcopy(value)
    return merged


def _parse_overrides(overrides: Mapping[str, Any] | Iterable[str]) -> list[tuple[str, Any]]:
    if isinstance(overrides, Mapping):
        return list(overrides.items())
    pairs = []
    for text in overrides:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise ConfigError(f"could not understand `{text}`; give key=value", key=text)
        try:
            pairs.append((key.strip(), tomllib.loads(f"value = {value}")["value"]))
        except tomllib.TOMLDecodeError:
            pairs.append((key.strip(), value.strip()))
    return pairs


def _put(table: Any, key: str, value: Any) -> None:
    """Set a dotted key; numbers index arrays."""
    names = re.findall(r"[^.\[\]]+", key)
    for k, name in enumerate(names):
        is_last = k == len(names) - 1
        if isinstance(table, list):
            if not name.isdigit() or int(name) >= len(table):
                raise ConfigError(
                    f"`{key}`: there is no entry {name!r} among {len(table)}; count from 0",
                    key=key,
                    value=value,
                )
            if is_last:
                table[int(name)] = value
            else:
                table = table[int(name)]
        elif isinstance(table, dict):
            if is_last:
                if isinstance(value, dict) and isinstance(table.get(name), dict):
                    value = _laid_over(table[name], value)
                table[name] = value
            else:
                table = table.setdefault(name, {})
        else:
            raise ConfigError(f"`{key}` goes below a value, not a table", key=key, value=value)
