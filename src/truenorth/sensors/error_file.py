"""The errors of an inertial unit as a small TOML file: a grade, and what differs from it.

::

    [errors]
    grade = "tactical"
    gyro_random_walk_deg_per_sqrt_h = 0.004

The keys are those of `ImuDescription`. `truenorth allan` writes such a file from a log; a person writes one
from a data sheet.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Sequence
from pathlib import Path

from ..config import convert_settings, toml_lines
from ..errors import ConfigError, FormatError, writing
from .imu import GRADES, ImuDescription

__all__ = ["errors_toml", "read_errors", "write_errors"]


def read_errors(source: str | os.PathLike[str]) -> ImuDescription:
    """Errors of an inertial unit: of a named grade, or from a file.

    Parameters
    ----------
    source : str or path-like
        ``consumer``, ``industrial``, ``tactical`` or ``navigation``, or a TOML file with a table
        ``[errors]``.

    Returns
    -------
    ImuDescription

    Raises
    ------
    ConfigError
        If it is neither, or a setting is unknown, missing or impossible; the message names it.
    FormatError
        If the file is not TOML.
    """
    name = os.fspath(source)
    if name in GRADES:
        return ImuDescription(grade=name)  # type: ignore[arg-type]
    grades = ", ".join(GRADES)
    path = Path(name)
    if not path.suffix and not path.exists():
        raise ConfigError(
            f"no grade of sensor is called {name!r}; give {grades}, or a TOML file", key="errors", value=name
        )
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise FormatError(f"could not read the errors of the sensor: {error}", path=name) from error
    except UnicodeDecodeError as error:
        raise FormatError("could not read the errors of the sensor: it is not text", path=name) from error
    except OSError as error:
        raise ConfigError(
            f"could not read the errors of the sensor from {name}: {error.strerror or error}; give {grades}, "
            f"or a TOML file",
            key="errors",
            value=name,
        ) from error
    section = table.get("errors")
    if set(table) != {"errors"} or not isinstance(section, dict):
        found = ", ".join(f"`{key}`" for key in table) or "nothing"
        raise ConfigError(
            f"could not read the errors of the sensor from {name}: it holds {found}; give one table [errors] "
            f"with a `grade` and what differs from it",
            key="errors",
            value=name,
        )
    if "grade" not in section:
        raise ConfigError(
            f"`errors.grade` is missing in {name}; give {grades}, from which everything comes that the file "
            f"leaves out",
            key="errors.grade",
        )
    return convert_settings(section, ImuDescription, prefix="errors.")


def errors_toml(description: ImuDescription, comments: Sequence[str] = ()) -> str:
    """Format a description as the text that `read_errors` reads.

    Parameters
    ----------
    description : ImuDescription
        The errors.
    comments : sequence of str
        Lines for the top, without the sign.

    Returns
    -------
    str
        The grade, and the settings that differ from it.
    """
    plain = ImuDescription(grade=description.grade)
    section = {"grade": description.grade}
    for key in description.__struct_fields__:
        value = getattr(description, key)
        if value != getattr(plain, key):
            section[key] = value
    lines = [f"# {line}".rstrip() for line in comments]
    return "\n".join([*lines, *toml_lines({"errors": section})[0 if lines else 1 :]]) + "\n"


def write_errors(
    description: ImuDescription, path: str | os.PathLike[str], comments: Sequence[str] = ()
) -> Path:
    """Write a description to a file for `read_errors`.

    Parameters
    ----------
    description : ImuDescription
        The errors.
    path : str or path-like
        A ``.toml`` file; an existing one is replaced.
    comments : sequence of str
        Lines for its top.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ConfigError
        If it cannot be written.
    """
    path = Path(path)
    with writing(path):
        path.write_text(errors_toml(description, comments), encoding="utf-8", newline="\n")
    return path
