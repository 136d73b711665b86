"""Refusals shared by the descriptions: impossible values are named before any work starts."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import NoReturn

import msgspec

from ..errors import ConfigError

__all__ = ["refuse", "require", "require_not_negative", "require_positive", "require_table"]


def refuse(key: str, value: object, wanted: str) -> NoReturn:
    """Raise the error of an impossible value.

    Raises
    ------
    ConfigError
        Always.
    """
    raise ConfigError(f"`{key}` is {value!r}; give {wanted}", key=key, value=value)


def require(struct: msgspec.Struct, *keys: str, test: Callable[[float], bool], wanted: str) -> None:
    """Make sure that every number of some settings passes a test.

    Parameters
    ----------
    struct : msgspec.Struct
        The settings.
    *keys : str
        Names of numbers, or of nested tuples of numbers.
    test : callable
        Says of one finite number whether it is possible.
    wanted : str
        What the message asks for.

    Raises
    ------
    ConfigError
        Naming the first setting with a number that fails, or is not finite.
    """
    for key in keys:
        value = getattr(struct, key)
        if not all(math.isfinite(number) and test(number) for number in _numbers(value)):
            refuse(key, value, wanted)


def require_positive(struct: msgspec.Struct, *keys: str) -> None:
    """Make sure that settings are above zero; see `require`."""
    require(struct, *keys, test=lambda number: number > 0.0, wanted="a positive number")


def require_not_negative(struct: msgspec.Struct, *keys: str) -> None:
    """Make sure that settings are zero or above; see `require`."""
    require(struct, *keys, test=lambda number: number >= 0.0, wanted="0 or more")


def require_table(struct: msgspec.Struct, key: str, wanted: str) -> None:
    """Make sure that a table of (argument, value) pairs has a row and rising arguments.

    Raises
    ------
    ConfigError
        Naming the table.
    """
    table = getattr(struct, key)
    rising = all(first[0] < second[0] for first, second in itertools.pairwise(table))
    if not table or not rising or not all(map(math.isfinite, _numbers(table))):
        refuse(key, table, wanted)


def _numbers(value: object) -> list[float]:
    """The numbers of nested tuples."""
    if isinstance(value, tuple):
        return [number for item in value for number in _numbers(item)]
    assert isinstance(value, int | float)
    return [float(value)]
