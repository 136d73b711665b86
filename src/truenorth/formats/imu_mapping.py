"""What the columns of a foreign inertial log mean: a small TOML file.

::

    axes = "x forward, y left, z up"     # or FLU: where the axes of the columns point on the vehicle
    separator = "comma"                  # semicolon, tab, space
    header_lines = 0                     # lines to leave out before the names (or the numbers)
    compensated = false                  # does the unit itself compensate coning and sculling?
    mount_deg = [0.0, 0.0, 0.0]          # heading, pitch, roll of the unit (forward, right, down) in the body

    [time]
    column = "t"                         # a name, or a number counted from 1 in files without names
    unit = "s"                           # s, ms, us, ns
    # or, for files without stamps or with useless ones:  rate_hz = 100.0

    [gyro]
    columns = ["wx", "wy", "wz"]
    unit = "deg/s"                       # rates: rad/s, deg/s, deg/h; increments: rad, deg, arcsec
    scale = 1.0                          # what one count is worth in this unit
    range_dps = 400.0                    # where the sensor saturates, if known

    [accelerometer]
    columns = ["fx", "fy", "fz"]         # specific force: the axis that points up reads +g at rest
    unit = "g"                           # forces: m/s^2, g, mg, ug; increments: m/s, g*s, mg*s, ug*s
    scale = 1.0                          # -1 for a unit whose axis that points down reads +g
    g_mps2 = 9.80665                     # what it calls g
    range_g = 10.0

    [place]                              # optional
    latitude_deg = 39.9

    [errors]                             # optional: settings of a sensor description
    grade = "tactical"

Units and axes must be given, and of increments `compensated`; nothing else must. A log that says itself what
its numbers mean may have a mapping without [time], [gyro] and [accelerometer], to say the rest.
"""

from __future__ import annotations

import math
import os
import re
import tomllib
from pathlib import Path
from typing import Any, Literal, NoReturn, get_args

import msgspec
import numpy as np

from ..errors import ConfigError, FormatError

__all__ = [
    "AccelerometerColumns",
    "GyroColumns",
    "ImuMapping",
    "PlaceOfLog",
    "TimeColumn",
    "rot_frd_from_axes",
]

GyroUnit = Literal["rad/s", "deg/s", "deg/h", "rad", "deg", "arcsec"]
AccelerometerUnit = Literal["m/s^2", "g", "mg", "ug", "m/s", "g*s", "mg*s", "ug*s"]
TimeUnit = Literal["s", "ms", "us", "ns"]

_DEG = math.pi / 180.0
_GYRO = {"rad/s": 1.0, "deg/s": _DEG, "deg/h": _DEG / 3600, "rad": 1.0, "deg": _DEG, "arcsec": _DEG / 3600}
_G_PARTS = {"g": 1.0, "mg": 1e-3, "ug": 1e-6, "g*s": 1.0, "mg*s": 1e-3, "ug*s": 1e-6}
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Worth of the units of time stamps."""

_DIRECTIONS = {
    "F": ("forward", "front"),
    "B": ("backward", "back", "aft", "rear"),
    "R": ("right", "starboard"),
    "L": ("left", "port"),
    "D": ("down",),
    "U": ("up",),
}
_UNIT_VECTORS = {
    "F": (1.0, 0.0, 0.0),
    "B": (-1.0, 0.0, 0.0),
    "R": (0.0, 1.0, 0.0),
    "L": (0.0, -1.0, 0.0),
    "D": (0.0, 0.0, 1.0),
    "U": (0.0, 0.0, -1.0),
}


def _refuse(key: str, value: object, wanted: str) -> NoReturn:
    raise ConfigError(f"`{key}` is {value!r}; {wanted}", key=key, value=value)


def _require_positive(struct: msgspec.Struct, *keys: str) -> None:
    for key in keys:
        value = getattr(struct, key)
        if value is not None and not 0.0 < value < math.inf:
            _refuse(key, value, "give a positive number")


def rot_frd_from_axes(axes: str) -> np.ndarray:
    """Turn components along named axes into forward, right, down.

    Parameters
    ----------
    axes : str
        Three letters of F, B, R, L, D, U for x, y, z, or words: ``x right, y forward, z up``.

    Returns
    -------
    ndarray, shape (3, 3)
        Exact: entries are 0, 1 and -1.

    Raises
    ------
    ConfigError
        If these are not three axes at right angles that make a right-handed set.
    """
    letters = axes.strip().upper()
    if not re.fullmatch("[FBRLDU]{3}", letters):
        words = dict(re.findall(r"\b([xyz])\s*[:=]?\s*([a-z]+)", axes.lower()))
        of_word = {word: letter for letter, names in _DIRECTIONS.items() for word in names}
        letters = "".join(of_word.get(words.get(axis, ""), "?") for axis in "xyz")
    wanted = "give three letters of F, B, R, L, D, U for x, y, z, or words such as 'x right, y forward, z up'"
    if "?" in letters:
        _refuse("axes", axes, wanted)
    rot = np.array([_UNIT_VECTORS[letter] for letter in letters]).T
    determinant = round(float(np.linalg.det(rot)))
    if determinant == 0:
        _refuse("axes", axes, f"two of them lie along one line; {wanted}")
    if determinant < 0:
        _refuse(
            "axes",
            axes,
            "these are left-handed, which leaves the sense of the gyros open; name the axes about which the"
            " gyros turn clockwise as seen along them",
        )
    return rot


class TimeColumn(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where the time stamps are, or how fast samples come."""

    column: str | int | None = None
    """Name, or number counted from 1."""
    unit: TimeUnit | None = None
    rate_hz: float | None = None
    """Samples per second of a table without stamps, or whose stamps are not to be used."""
    epoch: Literal["record", "gps"] = "record"
    """``gps``: the stamps count from 1980-01-06, GPS time."""

    def __post_init__(self) -> None:
        _require_positive(self, "rate_hz")
        if (self.column is None) == (self.rate_hz is None):
            _refuse("rate_hz", self.rate_hz, "give either a `column` with its `unit`, or `rate_hz`")
        if self.column is not None and self.unit is None:
            _refuse("unit", None, "give " + ", ".join(get_args(TimeUnit)))


Column = str | int


class GyroColumns(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Three columns of a gyro."""

    columns: tuple[Column, Column, Column]
    unit: GyroUnit
    scale: float = 1.0
    """What one count is worth in the unit."""
    range_dps: float | None = None

    def __post_init__(self) -> None:
        _check_scale(self)
        _require_positive(self, "range_dps")

    @property
    def is_rate(self) -> bool:
        """bool: Whether samples are rates, not increments."""
        return "/" in self.unit

    @property
    def factor(self) -> float:
        """float: What turns a cell into rad/s or rad."""
        return self.scale * _GYRO[self.unit]


class AccelerometerColumns(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Three columns of an accelerometer."""

    columns: tuple[Column, Column, Column]
    unit: AccelerometerUnit
    scale: float = 1.0
    """What one count is worth in the unit; negative where the axis that points down reads +g at rest."""
    g_mps2: float = 9.80665
    """What the unit calls g."""
    range_g: float | None = None

    def __post_init__(self) -> None:
        _check_scale(self)
        _require_positive(self, "g_mps2", "range_g")

    @property
    def is_rate(self) -> bool:
        """bool: Whether samples are specific forces, not increments."""
        return self.unit in ("m/s^2", "g", "mg", "ug")

    @property
    def factor(self) -> float:
        """float: What turns a cell into m/s^2 or m/s."""
        parts = _G_PARTS.get(self.unit)
        return self.scale * (1.0 if parts is None else parts * self.g_mps2)


def _check_scale(struct: GyroColumns | AccelerometerColumns) -> None:
    if not (math.isfinite(struct.scale) and struct.scale != 0.0):
        _refuse("scale", struct.scale, "give what one count is worth in the unit")


class PlaceOfLog(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where the log was taken."""

    latitude_deg: float
    longitude_deg: float | None = None
    height_m: float | None = None

    def __post_init__(self) -> None:
        for key, limit in (("latitude_deg", 90.0), ("longitude_deg", 360.0), ("height_m", 1e5)):
            value = getattr(self, key)
            if value is not None and not abs(value) <= limit:
                _refuse(key, value, f"give {-limit:g} to {limit:g}")


class ImuMapping(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the columns of an inertial log mean; see the head of this module."""

    axes: str | None = None
    """Where x, y, z of the columns point on the unit; needed with [gyro] and [accelerometer]."""
    separator: Literal["comma", "semicolon", "tab", "space"] = "comma"
    """Between the cells of a text table; ``space`` is any number of blanks."""
    header_lines: int = 0
    """Lines to leave out at the top of a text table."""
    compensated: bool | None = None
    """Whether the unit compensates coning and sculling itself; needed for increments."""
    mount_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Heading, pitch and roll of the unit in the body."""
    time: TimeColumn | None = None
    gyro: GyroColumns | None = None
    accelerometer: AccelerometerColumns | None = None
    place: PlaceOfLog | None = None
    errors: dict[str, Any] | None = None
    """Settings of a sensor description, kept as they are."""

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, self.mount_deg)):
            _refuse("mount_deg", self.mount_deg, "give heading, pitch and roll in degrees")
        if self.header_lines < 0:
            _refuse("header_lines", self.header_lines, "give 0 or more")
        if (self.gyro is None) != (self.accelerometer is None):
            key = "gyro" if self.gyro is None else "accelerometer"
            _refuse(key, None, "give both [gyro] and [accelerometer], or neither")
        if self.axes is not None:
            rot_frd_from_axes(self.axes)
        if self.gyro is None or self.accelerometer is None:
            return
        if self.axes is None:
            _refuse("axes", None, "say where the axes of the columns point, e.g. 'x right, y forward, z up'")
        if self.time is None:
            _refuse("time", None, "give [time] with a `column` and its `unit`, or with `rate_hz`")
        if self.compensated is None and not (self.gyro.is_rate and self.accelerometer.is_rate):
            _refuse(
                "compensated",
                None,
                "say whether the increments are compensated for coning and sculling: true or false",
            )
        kinds = {type(column) for column in self.columns}
        if len(kinds) > 1:
            _refuse("columns", list(self.columns), "name all columns, or number all of them")

    @property
    def columns(self) -> tuple[Column, ...]:
        """All columns that are needed: time, gyro, accelerometer."""
        stamps = () if self.time is None or self.time.column is None else (self.time.column,)
        gyro = () if self.gyro is None else self.gyro.columns
        return stamps + gyro + (() if self.accelerometer is None else self.accelerometer.columns)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> ImuMapping:
        """Read a mapping.

        Parameters
        ----------
        path : str or path-like
            The TOML file.

        Returns
        -------
        ImuMapping

        Raises
        ------
        FormatError
            If the file cannot be read or is not TOML.
        ConfigError
            If a setting is unknown, missing or impossible; the message names it.
        """
        try:
            text = Path(path).read_text(encoding="utf-8")
            table = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise FormatError(f"the mapping is not valid TOML: {error}", path=path) from None
        except UnicodeDecodeError:
            raise FormatError("the mapping is not text; give a TOML file", path=path) from None
        except OSError as error:
            raise FormatError(f"the mapping cannot be read: {error.strerror or error}", path=path) from None
        try:
            return cls.from_table(table)
        except ConfigError as error:
            raise ConfigError(f"{os.fspath(path)}: {error}", key=error.key, value=error.value) from None

    @classmethod
    def from_table(cls, table: dict[str, Any]) -> ImuMapping:
        """Make a mapping of plain dictionaries, strictly.

        Raises
        ------
        ConfigError
            Naming the setting at fault.
        """
        try:
            return msgspec.convert(table, cls)
        except msgspec.ValidationError as error:
            _explain(error, table)


def _explain(error: msgspec.ValidationError, table: dict[str, Any]) -> NoReturn:
    """The sentence of an impossible mapping."""
    match = re.fullmatch(r"(?s)(.*?)(?: - at `\$\.?(.*)`)?", str(error))
    assert match is not None  # the pattern matches any text
    text, place = match.group(1), match.group(2) or ""
    outer = f"{place}." if place else ""
    if isinstance(error.__cause__, ConfigError):
        cause = error.__cause__
        key = f"{outer}{cause.key}"
        said = str(cause).replace(f"`{cause.key}` is None;", f"`{cause.key}` is missing;")
        raise ConfigError(said.replace(f"`{cause.key}`", f"`{key}`", 1), key=key, value=cause.value) from None
    if unknown := re.search(r"unknown field `(.*?)`", text):
        key = outer + unknown.group(1)
        known = {"gyro": GyroColumns, "accelerometer": AccelerometerColumns, "time": TimeColumn}
        known |= {"place": PlaceOfLog, "": ImuMapping}
        names = ", ".join(known[place].__struct_fields__)
        raise ConfigError(f"`{key}` is not a setting of a mapping; known are {names}", key=key) from None
    if missing := re.search(r"missing required field `(\w+)`", text):
        key = outer + missing.group(1)
        raise ConfigError(f"`{key}` is missing; give it", key=key) from None
    value: Any = table
    for name in re.findall(r"\w+", place):
        value = value[int(name)] if isinstance(value, list) else value[name]
    choices = {"gyro.unit": GyroUnit, "accelerometer.unit": AccelerometerUnit, "time.unit": TimeUnit}
    wanted = (
        "give one of " + ", ".join(get_args(choices[place]))
        if place in choices
        else text[:1].lower() + text[1:]
    )
    raise ConfigError(f"`{place}` is {value!r}; {wanted}", key=place, value=value) from None
