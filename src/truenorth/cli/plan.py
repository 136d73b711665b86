"""``truenorth plan``: what an array will achieve at a place over a day, before it is built."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import ConfigError

if TYPE_CHECKING:
    from ..config import StochasticSettings

__all__ = ["check_files", "naming_options", "parse_noise", "parse_points", "run_plan"]

_OPTIONS = {
    "antennas": "--antenna",
    "latitude_deg": "--latitude",
    "longitude_deg": "--longitude",
    "height_m": "--height",
    "start": "--date",
    "hours": "--hours",
    "step_s": "--step",
    "elevation_mask_deg": "--mask",
    "systems": "--systems",
    "bands": "--bands",
    "heading_deg": "--heading",
    "pitch_deg": "--pitch",
    "roll_deg": "--roll",
    "position_sd_m": "--position-sd",
    "along_m": "--along",
    "phase_sd_m": "--noise",
    "code_sd_m": "--noise",
}
"""Options by the setting that each stands for."""


@contextmanager
def naming_options() -> Iterator[None]:
    """Let errors name the option that the user typed, not the setting behind it."""
    try:
        yield
    except ConfigError as error:
        option = _OPTIONS.get(error.key or "")
        if option is None:
            raise
        text = str(error).replace(f"`{error.key}`", f"`{option}`", 1)
        raise ConfigError(text, key=error.key, value=error.value) from error


def run_plan(
    source: str | None,
    *,
    antenna: list[str],
    noise: str | None,
    out: Path | None,
    figure: Path | None,
    as_json: bool,
    **changes: Any,
) -> None:
    """Plan an array and tell, write and draw what comes out.

    Parameters
    ----------
    source : str or None
        Session or scenario.
    antenna : list of str
        Body coordinates, ``x,y,z`` each.
    noise : str or None
        ``phase,code`` in metres.
    out, figure : Path or None
        Files to write.
    as_json : bool
        Tell it as JSON.
    **changes
        Fields of `truenorth.planning.PlanSettings`; None for what was not given.
    """
    import json

    from ..planning import plan_array

    check_files(out, figure)
    with naming_options():
        changes |= _changes_of(antenna, noise)
    _need_place(source, changes)
    with naming_options():
        plan = plan_array(source, **changes)
    written = []
    if out is not None:
        from ..export.planning import write_table

        written.append(write_table(plan.columns(), out))
    if figure is not None:
        from ..report.planning_figures import plan_figure, save_plan_figure

        written.append(save_plan_figure(plan_figure(plan), figure))
    if as_json:
        print(json.dumps({**plan.to_dict(), "files": [str(path) for path in written]}, indent=2))
        return
    print(plan)
    for path in written:
        print(f"written     {path}")


def parse_points(texts: list[str], option: str = "--antenna") -> list[tuple[float, float, float]]:
    """Points of the body given as ``x,y,z``.

    Parameters
    ----------
    texts : list of str
        One for each.
    option : str
        What the user typed, for the error.

    Returns
    -------
    list of tuple of float
    """
    points = []
    for text in texts:
        try:
            forward, right, down = (float(part) for part in text.split(","))
        except ValueError:
            raise ConfigError(
                f"`{option} {text}` is not three numbers; give metres forward, right, down, e.g. 2.0,0,0",
                key="antennas",
                value=text,
            ) from None
        points.append((forward, right, down))
    return points


def parse_noise(text: str) -> StochasticSettings:
    """White noise given as ``phase,code`` in metres."""
    from ..planning import white_noise

    try:
        phase_sd_m, code_sd_m = (float(part) for part in text.split(","))
    except ValueError:
        raise ConfigError(
            f"`--noise {text}` is not two numbers; give phase and code in metres, e.g. 0.003,0.3",
            key="noise",
            value=text,
        ) from None
    return white_noise(phase_sd_m, code_sd_m)


def check_files(out: Path | None, figure: Path | None) -> None:
    """Refuse what could not be written before any work starts."""
    if out is not None:
        from ..export.planning import check_table_path

        check_table_path(out)
    if figure is not None:
        from ..report.planning_figures import check_plan_figure_path

        check_plan_figure_path(figure)


def _changes_of(antenna: list[str], noise: str | None) -> dict[str, Any]:
    changes: dict[str, Any] = {}
    if antenna:
        changes["antennas"] = parse_points(antenna)
    if noise is not None:
        changes["stochastic"] = parse_noise(noise)
    return changes


def _need_place(source: str | None, changes: dict[str, Any]) -> None:
    """Name the options that are missing, not the settings behind them."""
    if source is None and "antennas" not in changes:
        raise ConfigError(
            "no array is given; name a session.toml or a scenario, or give --antenna x,y,z for each antenna",
            key="antennas",
        )
    is_scenario = source is not None and not _is_session(source)
    for key, option in (
        ("latitude_deg", "--latitude"),
        ("longitude_deg", "--longitude"),
        ("start", "--date"),
    ):
        if changes.get(key) is None and not is_scenario:
            raise ConfigError(f"`{option}` is missing; give where and when the array will stand", key=key)


def _is_session(source: str) -> bool:
    """Whether a source is a session file, which says nothing of place and day."""
    if not source.endswith(".toml"):
        return False
    import tomllib

    try:
        table = tomllib.loads(Path(source).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return False
    return "place" not in table and "extends" not in table
