"""``truenorth plan``: what an array will achieve at a place over a day, before it is built."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import ConfigError

if TYPE_CHECKING:
    from ..config import StochasticSettings

__all__ = ["check_files", "naming_options", "parse_noise", "parse_points", "run_plan"]

_OPTIONS = {
    "antenna": "--coordinate",
    "antennas": "--antenna",
    "axis": "--coordinate",
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
    "at": "--at",
    "box": "--place-box",
    "criterion": "--criterion",
    "demanded_deg": "--require-...-deg",
    "draws": "--draws",
    "grid_m": "--grid",
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
    sweep: str | None,
    require: dict[str, float | None],
    place: list[str],
    place_box: str | None,
    grid_m: float,
    criterion: str,
    at: str,
    draws: int,
    error_m: float | None,
    coordinate: str | None,
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
    sweep : str or None
        ``error``, ``coordinate`` or ``length``: a sweep takes the place of the day.
    require : dict of str to float or None
        Demanded standard deviations by angle, degrees.
    place : list of str
        Candidate points of one more antenna, ``x,y,z`` each.
    place_box : str or None
        Or a box of them, ``x0,y0,z0,x1,y1,z1``.
    grid_m : float
        Between the points of the box.
    criterion, at : str
        What the new antenna shall make small, and at which epoch.
    draws : int
        Draws of the joint search at some epochs; 0 for none.
    error_m : float or None
        Of the coordinates that a sweep holds.
    coordinate : str or None
        Which one is swept, ``antenna,axis`` with antennas counted from 1.
    out, figure : Path or None
        Files to write: of the sweep, of the candidates, or of the day.
    as_json : bool
        Tell it as JSON.
    **changes
        Fields of `truenorth.planning.PlanSettings`; None for what was not given.
    """
    import json

    from ..planning import draw_joint_success, place_antenna, plan_array, requirement

    check_files(out, figure)
    with naming_options():
        changes |= _changes_of(antenna, noise)
    if sweep is not None:
        with naming_options():
            swept = _swept(sweep, source, changes, error_m=error_m, coordinate=coordinate)
        _tell_sweeps(swept, out=out, figure=figure, as_json=as_json)
        return
    _need_place(source, changes)
    with naming_options():
        candidates = _candidates(place, place_box, grid_m)
        plan = plan_array(source, **changes)
        required = [
            requirement(plan, angle, demanded, at=at)
            for angle, demanded in require.items()
            if demanded is not None
        ]
        placement = None
        if candidates is not None:
            placement = place_antenna(plan, candidates, criterion=criterion, at=at)
        joint = draw_joint_success(plan, draws=draws) if draws else None
    table = plan.columns() if placement is None else placement.columns()
    written = []
    if out is not None:
        from ..export.planning import write_table

        written.append(write_table(table, out))
    if figure is not None:
        from ..report.files import save_figure
        from ..report.planning_figures import placement_figure, plan_figure

        page = plan_figure(plan) if placement is None else placement_figure(plan, placement)
        written.append(save_figure(page, figure))
    if as_json:
        told = plan.to_dict() | {"required": [asdict(item) for item in required]}
        if placement is not None:
            told["placement"] = placement.to_dict()
        if joint is not None:
            told["joint"] = joint.to_dict()
        told["files"] = [str(path) for path in written]
        print(json.dumps(told, indent=2))
        return
    print(plan)
    for item in (joint, *required, placement):
        if item is not None:
            print(item)
    for path in written:
        print(f"written     {path}")


def _swept(
    sweep: str,
    source: str | None,
    changes: dict[str, Any],
    *,
    error_m: float | None,
    coordinate: str | None,
) -> list[Any]:
    """The sweep that is asked for; of the published array where none is given."""
    from ..planning import plan_settings, sweep_coordinate, sweep_error, sweep_length
    from ..planning.sweeps import LANDFAHRER_ANGLES_DEG, LANDFAHRER_ANTENNAS

    if sweep not in ("error", "coordinate", "length"):
        raise ConfigError(
            f"`--sweep {sweep}` is not known; give error, coordinate or length", key="sweep", value=sweep
        )
    if sweep == "length":
        if source is not None or "antennas" in changes:
            raise ConfigError(
                "`--sweep length` is about two baselines, 2.16 m ahead and 1.57 m at 45 degrees to it; "
                "leave out the array",
                key="sweep",
            )
        return [sweep_length(which=which, error_m=error_m or 0.01) for which in ("a", "b")]
    antennas: Any = LANDFAHRER_ANTENNAS
    if "antennas" in changes:
        antennas = changes["antennas"]
    elif source is not None:
        # Place and day play no part.
        place = {key: 0.0 for key in ("latitude_deg", "longitude_deg") if changes.get(key) is None}
        given = {key: value for key, value in changes.items() if key != "navigation"}
        antennas = plan_settings(source, **{**given, **place, "start": "2024-01-01"}).antennas
    angles_deg = tuple(
        usual if changes.get(f"{name}_deg") is None else changes[f"{name}_deg"]
        for name, usual in zip(("heading", "pitch", "roll"), LANDFAHRER_ANGLES_DEG, strict=True)
    )
    if sweep == "error":
        return [sweep_error(antennas, angles_deg=angles_deg)]
    antenna, axis = _coordinate(coordinate or "2,north")
    return [
        sweep_coordinate(antennas, antenna=antenna, axis=axis, others_m=error_m or 0.1, angles_deg=angles_deg)
    ]


def _coordinate(text: str) -> tuple[int, str]:
    number, _, axis = text.partition(",")
    try:
        return int(number) - 1, axis.strip()
    except ValueError:
        raise ConfigError(
            f"`--coordinate {text}` is not an antenna and an axis; give e.g. 2,north",
            key="coordinate",
            value=text,
        ) from None


def _tell_sweeps(swept: list[Any], *, out: Path | None, figure: Path | None, as_json: bool) -> None:
    """Print, write and draw sweeps; tables beside one another where there are two."""
    import json

    written = []
    if out is not None:
        from ..export.planning import write_table

        for number, item in enumerate(swept):
            path = out if number == 0 else out.with_name(f"{out.stem}-{item.name}{out.suffix}")
            written.append(write_table(item.columns(), path))
    if figure is not None:
        from ..report.files import save_figure
        from ..report.planning_figures import sweep_figure

        written.append(save_figure(sweep_figure(swept), figure))
    if as_json:
        told = {"sweeps": [item.to_dict() for item in swept], "files": [str(path) for path in written]}
        print(json.dumps(told, indent=2))
        return
    print("\n\n".join(str(item) for item in swept))
    for path in written:
        print(f"written     {path}")


def _candidates(place: list[str], place_box: str | None, grid_m: float) -> Any:
    """Candidate points of one more antenna, None where none is asked for."""
    from ..planning import box_points

    if place and place_box is not None:
        raise ConfigError("`--place` and `--place-box` are given both; give points or a box", key="place")
    if place:
        return parse_points(place, "--place")
    if place_box is None:
        return None
    try:
        corners = [float(part) for part in place_box.split(",")]
    except ValueError:
        corners = []
    if len(corners) != 6:
        raise ConfigError(
            f"`--place-box {place_box}` is not six numbers; give the lower and the upper corner, metres "
            "forward, right, down, e.g. 0,-1,-0.5,2,1,0",
            key="place",
            value=place_box,
        )
    return box_points(corners[:3], corners[3:], grid_m)


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
        from ..report.files import check_static_path

        check_static_path(figure)


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
