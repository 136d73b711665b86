"""Where a search for north takes its position from: a session, a receiver's file, a scenario.

A session names observation files; their headers hold the approximate position, which is good to metres where
a hundred are enough (a latitude wrong by 100 m turns north by less than a thousandth of a degree).
"""

from __future__ import annotations

import math
import os
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from ..config import Session
from ..errors import ConfigError, FormatError
from ..formats.compression import read_pieces
from ..formats.registry import read_observations, sniff_bytes
from ..frames import geodetic_from_ecef

__all__ = ["position_from_file"]

_LOWEST_M, _HIGHEST_M = 6.3e6, 6.5e6
"""Distances from the centre of the Earth between which a receiver can be."""


def position_from_file(path: str | os.PathLike[str]) -> tuple[float, float, float]:
    """Geodetic position that a file tells.

    Parameters
    ----------
    path : str or os.PathLike
        A ``session.toml`` (the first of its observation files that tells a position), a file of observations
        (RINEX, UBX, OEM3; packed or not), a TOML file with a table ``[place]`` (a scenario of the emulator, a
        mapping of an inertial log), or a folder with a ``session.toml`` or a ``scenario.toml``.

    Returns
    -------
    latitude_rad, longitude_rad, height_m : float
        Height above the ellipsoid, 0 where a ``[place]`` gives none.

    Raises
    ------
    FormatError
        If the file cannot be read.
    ConfigError
        If it tells no position, or one that is not on the Earth.
    """
    path = Path(path)
    if path.is_dir():
        # A simulated folder of sensors alone has no session, but says what it was made from.
        path = path / ("session.toml" if (path / "session.toml").exists() else "scenario.toml")
    if path.suffix.lower() != ".toml":
        return _of_observations(str(path))
    table = _toml(path)
    if "place" in table:
        return _of_place(table["place"], path)
    if "platform" not in table or "extends" in table:
        where = f" (it extends {table['extends']!r}, which may)" if "extends" in table else ""
        raise ConfigError(
            f"{path} tells no position{where}; give a session, a RINEX file, or --latitude", key="position"
        )
    problems = []
    for name in Session.read(path).observation_paths:
        try:
            return _of_observations(name)
        except ConfigError as error:
            problems.append(error)
    raise problems[0]


def _toml(path: Path) -> dict[str, Any]:
    """Content of a TOML file."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise FormatError(
            f"the position cannot be read, this is not valid TOML: {error}", path=path
        ) from None
    except UnicodeDecodeError:
        raise FormatError("the position cannot be read, the file is not text", path=path) from None
    except OSError as error:
        raise FormatError(
            f"the position cannot be read: {error.strerror or error}; give a session, a RINEX file, or"
            f" --latitude",
            path=path,
        ) from None


def _of_place(place: Any, path: Path) -> tuple[float, float, float]:
    """Position of a table ``[place]``."""
    place = place if isinstance(place, dict) else {}
    values = []
    for key, limit in (("latitude_deg", 90.0), ("longitude_deg", 360.0), ("height_m", 1e5)):
        value = place.get(key, None if key == "latitude_deg" else 0.0)
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= limit:
            raise ConfigError(
                f"{path}: `place.{key}` is {value!r}; give a number from {-limit:g} to {limit:g}",
                key=f"place.{key}",
                value=value,
            )
        values.append(float(value))
    return math.radians(values[0]), math.radians(values[1]), values[2]


def _of_observations(path: str) -> tuple[float, float, float]:
    """Approximate position of a receiver's file."""
    pieces = read_pieces(path)
    first = next(pieces)
    pieces.close()
    form = sniff_bytes(first)
    if form is not None and form.name == "rinex_obs":
        position = _of_header(first)
    else:
        position = read_observations(path).meta.approx_position_ecef_m
    advice = "give another file, or --latitude"
    if position is None:
        raise ConfigError(f"{path} tells no position of its receiver; {advice}", key="position", value=path)
    radius_m = float(np.linalg.norm(position))
    if radius_m == 0.0:
        raise ConfigError(
            f"the position in the header of {path} is zero, its receiver did not know it; {advice}",
            key="position",
            value=path,
        )
    if not _LOWEST_M < radius_m < _HIGHEST_M:
        raise ConfigError(
            f"the position in the header of {path} lies {radius_m / 1e3:.0f} km from the centre of the Earth;"
            f" {advice}",
            key="position",
            value=path,
        )
    latitude, longitude, height = geodetic_from_ecef(np.array(position))
    return float(latitude), float(longitude), float(height)


def _of_header(text: bytes) -> tuple[float, ...] | None:
    """Approximate position of a RINEX header, also where it is zero; the observations are not read."""
    for line in text.split(b"END OF HEADER", 1)[0].split(b"\n"):
        if line[60:].strip() == b"APPROX POSITION XYZ":
            try:
                position = tuple(float(word) for word in line[:60].split())
            except ValueError:
                return None
            return position if len(position) == 3 and all(map(math.isfinite, position)) else None
    return None
