"""From the arguments of the command line to a session."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import msgspec

from ..config import GnssSettings, Session, convert_settings
from ..errors import ConfigError, FormatError

__all__ = ["OPTION_KEYS", "make_session"]

OPTION_KEYS = {
    "method": "--method",
    "single_epoch": "--single-epoch",
    "systems": "--systems",
    "bands": "--bands",
    "elevation_mask_deg": "--mask",
    "cn0_mask_dbhz": "--cn0-mask",
    "length_m": "--length",
    "length_sd_m": "--length-sd",
    "length_use": "--length-use",
    "ratio_test": "--ratio-test",
    "ratio_threshold": "--ratio-threshold",
    "success_probability": "--success-probability",
    "direction": "--direction",
}
"""Options by the setting that each stands for."""

ARRAY_TABLES = ("array", "attitude_filter", "reliability")
"""Tables of a session beside ``[gnss]`` whose settings can be typed."""


def make_session(files: list[Path], overrides: dict[str, Any], assignments: list[str]) -> Session:
    """Session of a command line: a session file or observation and navigation files, and options.

    Parameters
    ----------
    files : list of Path
        One ``.toml``, or base, rover and navigation files.
    overrides : dict
        Settings given as options; None where an option was not given.
    assignments : list of str
        ``key=value`` texts, dotted keys allowed; values as in TOML, bare words are text. Keys are those of
        ``[gnss]`` unless they begin with another table of the session, e.g. ``array.method=triad``.

    Returns
    -------
    Session

    Raises
    ------
    ConfigError
        If the arguments are too few or contradict each other, or a setting is impossible.
    FormatError
        If a file does not exist.
    """
    table = {key: value for key, value in overrides.items() if value is not None}
    options = {key: option for key, option in OPTION_KEYS.items() if key in table}
    for text in assignments:
        _assign(table, text)
    tables = {name: table.pop(name) for name in ARRAY_TABLES if name in table}
    is_session = any(path.suffix.lower() == ".toml" for path in files)
    if is_session and len(files) > 1:
        raise ConfigError("a session file names its own inputs; give it alone, or BASE ROVER NAV without it")
    try:
        if is_session:
            return _with_overrides(Session.read(files[0]), table, tables)
        if tables:
            raise ConfigError(
                f"`--set {next(iter(tables))}...` is for an array of antennas; give its session.toml",
                key=next(iter(tables)),
            )
        return Session.for_pair(*_pair(files), settings=convert_settings(table, GnssSettings))
    except ConfigError as error:
        # Name the option that the user typed, not the setting behind it.
        option = options.get(error.key or "")
        if option is None:
            raise
        raise ConfigError(
            str(error).replace(f"`{error.key}`", f"`{option}`", 1), key=error.key, value=error.value
        ) from error


def _pair(files: list[Path]) -> tuple[str, str, tuple[str, ...]]:
    """Base, rover and navigation files, each of which must exist."""
    if len(files) < 2:
        raise ConfigError(
            f"{len(files)} file given; give BASE.obs ROVER.obs BRDC.nav, BASE.ubx ROVER.ubx or a session.toml"
        )
    for path in files:
        if path.is_dir():
            raise FormatError("it is a folder; give a file", path=str(path))
        if not path.exists():
            raise FormatError("there is no such file; check the name", path=str(path))
    base, rover, *navigation = files
    if base.samefile(rover):
        raise ConfigError(f"base and rover are the same file, {base}; give the files of two antennas")
    for path in navigation:
        if path.samefile(base) or path.samefile(rover):
            raise ConfigError(f"{path} is given both for observations and for navigation; give it once")
    return str(base), str(rover), tuple(str(path) for path in navigation)


def _with_overrides(session: Session, table: dict[str, Any], tables: dict[str, Any]) -> Session:
    """Session with some of its settings replaced by options."""
    described = msgspec.to_builtins(session)
    _merge(described["gnss"], table)
    _merge(described, tables)
    if table.get("length_m") is not None and session.is_array:
        raise ConfigError(
            f"`length_m` is for two antennas; the platform has {len(session.platform.antennas)}, whose body "
            "coordinates give the lengths",
            key="length_m",
            value=table["length_m"],
        )
    if "length_m" in table:
        # What is typed wins over what the platform says.
        described["platform"]["length_m"] = None
        for antenna in described["platform"]["antennas"]:
            antenna["position_body_m"] = None
    return convert_settings(described, Session)


def _merge(into: dict[str, Any], table: dict[str, Any]) -> None:
    for key, value in table.items():
        if isinstance(value, dict) and isinstance(into.get(key), dict):
            _merge(into[key], value)
        else:
            into[key] = value


def _assign(table: dict[str, Any], text: str) -> None:
    """Put one ``key=value`` into a table of settings."""
    key, equals, value = (part.strip() for part in text.partition("="))
    if not equals or not key:
        raise ConfigError(f"`--set {text}` is not KEY=VALUE", key=key)
    try:
        parsed = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        parsed = value
    *outer, last = key.removeprefix("gnss.").split(".")
    for name in outer:
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            raise ConfigError(f"`--set {text}`: `{name}` is not a group of settings", key=key)
    table[last] = parsed
