"""The arguments of a plain ``truenorth solve``, read without the library that parses all others.

Loading that library takes as long as solving some minutes of data. So a command line that is plainly
right is read here; anything else (help, an unknown option, a value that is no number) is left to it,
which then says what is wrong. The tests hold the two to the same result.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

__all__ = ["SolveCall", "parse_solve"]

_VALUES: dict[str, tuple[str, type]] = {
    "--length": ("length_m", float),
    "--length-sd": ("length_sd_m", float),
    "--length-use": ("length_use", str),
    "--method": ("method", str),
    "--systems": ("systems", str),
    "--bands": ("bands", str),
    "--mask": ("elevation_mask_deg", float),
    "--cn0-mask": ("cn0_mask_dbhz", float),
    "--ratio-test": ("ratio_test", str),
    "--ratio-threshold": ("ratio_threshold", float),
    "--success-probability": ("success_probability", float),
    "--direction": ("direction", str),
}
_FLAGS = {"--single-epoch": True, "--no-single-epoch": False}
_OUTPUTS: dict[str, tuple[str, type]] = {
    "--out": ("out", Path),
    "--figure": ("figure", Path),
    "--explain": ("explain", str),
}


class SolveCall(NamedTuple):
    """Arguments of `truenorth.cli.run.run_solve`."""

    arguments: tuple[list[Path], dict[str, Any], list[str]]
    outputs: dict[str, Any]


def parse_solve(words: list[str]) -> SolveCall | None:
    """Read the arguments of ``truenorth solve``.

    Parameters
    ----------
    words : list of str
        The command line after the name of the program.

    Returns
    -------
    SolveCall or None
        None for everything that is not plainly right, or another command.
    """
    if words[:1] != ["solve"]:
        return None
    files: list[Path] = []
    settings: dict[str, Any] = {}
    assignments: list[str] = []
    outputs: dict[str, Any] = {}
    rest = iter(words[1:])
    for word in rest:
        if not word.startswith("-"):
            files.append(Path(word))
            continue
        name, equals, given = word.partition("=")
        if name == "--json" and not equals:
            outputs["as_json"] = True
            continue
        if name in _FLAGS and not equals:
            settings["single_epoch"] = _FLAGS[name]
            continue
        value = given if equals else next(rest, None)
        if value is None:
            return None
        try:
            if name in _VALUES:
                key, kind = _VALUES[name]
                settings[key] = kind(value)
            elif name in _OUTPUTS:
                key, kind = _OUTPUTS[name]
                outputs[key] = kind(value)
            elif name == "--set":
                assignments.append(value)
            else:
                return None
        except ValueError:
            return None
    if not files:
        return None
    if "bands" in settings:
        settings["bands"] = split_names(settings["bands"])
    return SolveCall((files, settings, assignments), outputs)


def split_names(text: str) -> list[str]:
    """Names with commas between."""
    return [name.strip() for name in text.split(",")]
