"""The commands of the program, as typer parses them."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from . import calibrate, turntable
from .guard import run_safely
from .solve import solve

__all__ = ["app"]

app = typer.Typer(
    help="Where a platform points, from the raw GNSS carrier phases of its antennas.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Exit codes: 0 good, 1 no usable solution, 2 usage, 3 unreadable input, 4 internal error.",
)


def _guarded(command: Callable[..., Any]) -> Callable[..., Any]:
    """Let a command end by an exit code; its signature is kept."""

    @functools.wraps(command)
    def run(*args: Any, **kwargs: Any) -> None:
        raise typer.Exit(run_safely(command, *args, **kwargs))

    return run


def _print_version(wanted: bool) -> None:
    if wanted:
        from .. import __version__

        typer.echo(f"truenorth {__version__}")
        raise typer.Exit


@app.callback()
def _global_options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


app.command("solve")(_guarded(solve))

_calibrate = typer.Typer(
    help="Measure where antennas stand and how things are mounted.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
for _name, _command in calibrate.COMMANDS.items():
    _calibrate.command(_name)(_guarded(_command))
app.add_typer(_calibrate, name="calibrate")

_turntable = typer.Typer(
    help="North from an accelerometer on a turntable: solve a log, or design the table.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
for _name, _command in turntable.COMMANDS.items():
    _turntable.command(_name)(_guarded(_command))
app.add_typer(_turntable, name="turntable")


@app.command("example")
@_guarded
def _example(
    name: Annotated[str, typer.Argument(help="Name of the set, see `truenorth datasets`.")],
    out: Annotated[Path | None, typer.Option("--out", help="Result file, as for `solve`.")] = None,
    figure: Annotated[
        Path | None, typer.Option("--figure", help="Figure page: .png, .pdf, .svg or .html.")
    ] = None,
    method: Annotated[
        str | None, typer.Option("--method", help="As for `solve`, or for `northfind`.")
    ] = None,
    single_epoch: Annotated[bool, typer.Option("--single-epoch", help="Every epoch by itself.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Summary as JSON.")] = False,
) -> int:
    """Solve a public data set by name, with its published truth beside; fetched when it is not at hand."""
    from .example import solve_example

    return solve_example(
        name, out=out, figure=figure, method=method, single_epoch=single_epoch, as_json=as_json
    )


@app.command("datasets")
@_guarded
def _datasets(
    name: Annotated[str | None, typer.Argument(help="Fetch this set and say where its files are.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
) -> None:
    """List the public data sets, or get one."""
    from .example import list_datasets, locate_dataset

    if name is None:
        list_datasets(as_json=as_json)
    else:
        locate_dataset(name, as_json=as_json)


@app.command("info")
@_guarded
def _info(
    files: Annotated[list[Path], typer.Argument(help="Observation or navigation files.", metavar="FILE...")],
    as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
) -> None:
    """Say what files hold: receiver, span, interval, satellites and signals, gaps, slips."""
    from .info import info

    info(files, as_json)


@app.command("simulate")
@_guarded
def _simulate(
    scenario: Annotated[
        str | None, typer.Argument(help="A scenario's name (see --list) or TOML file.", metavar="SCENARIO")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder to write; by default the name.")] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", help="Change a setting, e.g. duration_s=60.", metavar="KEY=VALUE"),
    ] = None,
    show_list: Annotated[bool, typer.Option("--list", help="List the scenarios of the package.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
) -> None:
    """Simulate raw data of antennas and sensors with known truth: a complete session."""
    from ..errors import ConfigError
    from .simulate import list_scenarios, simulate_scenario

    if show_list:
        list_scenarios(as_json=as_json)
        return
    if scenario is None:
        raise ConfigError("name a scenario or a TOML file; `truenorth simulate --list` shows what there is")
    folder = out or Path(Path(scenario).name.removesuffix(".toml"))
    simulate_scenario(scenario, folder, overrides or [], as_json=as_json)


@app.command("evaluate")
@_guarded
def _evaluate(
    solution: Annotated[Path, typer.Argument(help="Result of `solve`: .csv or .parquet.")],
    reference: Annotated[Path, typer.Argument(help="Table of truth, e.g. truth.csv of `simulate`.")],
    body: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z", help="Of a baseline: where the rover stands, metres forward, right, down."
        ),
    ] = None,
    wrong_sd: Annotated[float, typer.Option(help="Beyond so many stated sigma an epoch is wrong.")] = 5.0,
    wrong_deg: Annotated[float | None, typer.Option(help="Beyond so many degrees as well.")] = None,
    figure: Annotated[Path | None, typer.Option(help="Figure: .png, .pdf, .svg or .html.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
) -> None:
    """Compare a solution with a reference: errors, availability, wrong epochs, honesty of sigma."""
    from .evaluate import evaluate_files

    evaluate_files(
        solution,
        reference,
        body=body,
        wrong_sd=wrong_sd,
        wrong_deg=wrong_deg,
        figure=figure,
        as_json=as_json,
    )


@app.command("demo")
@_guarded
def _demo(
    out: Annotated[Path, typer.Option(help="Folder to write.")] = Path("truenorth-demo"),
    open_page: Annotated[
        bool | None,
        typer.Option("--open/--no-open", help="Open the page in a browser; by default on a desktop."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
) -> int:
    """Simulate a drive with four antennas, solve it, compare it with the truth: one page."""
    from .demo import run_demo

    return run_demo(out, open_page=open_page, as_json=as_json)


@app.command("plan")
@_guarded
def _plan(
    source: Annotated[
        str | None, typer.Argument(help="SESSION.toml, or a scenario by name or file.", metavar="SOURCE")
    ] = None,
    antenna: Annotated[
        list[str] | None,
        typer.Option(metavar="X,Y,Z", help="An antenna: metres forward, right, down. Repeat it."),
    ] = None,
    latitude: Annotated[float | None, typer.Option(help="Degrees north.")] = None,
    longitude: Annotated[float | None, typer.Option(help="Degrees east.")] = None,
    height: Annotated[float | None, typer.Option(help="Above the ellipsoid, metres.")] = None,
    date: Annotated[str | None, typer.Option(help="GPS time, e.g. 2024-06-24 or with T08:00:00.")] = None,
    hours: Annotated[float | None, typer.Option(help="How long; 24 by default.")] = None,
    step: Annotated[float | None, typer.Option(help="Seconds between epochs; 300 by default.")] = None,
    mask: Annotated[float | None, typer.Option(help="Elevation mask, degrees; 15 by default.")] = None,
    systems: Annotated[str | None, typer.Option(help="Letters among GRECJIS.")] = None,
    bands: Annotated[str | None, typer.Option(help="Bands, e.g. L1,L2.")] = None,
    navigation: Annotated[
        list[Path] | None, typer.Option(help="RINEX navigation or SP3 file; nominal orbits without.")
    ] = None,
    noise: Annotated[
        str | None, typer.Option(metavar="PHASE,CODE", help="White noise of one observation, metres.")
    ] = None,
    heading: Annotated[float | None, typer.Option(help="Where the platform points, degrees.")] = None,
    pitch: Annotated[float | None, typer.Option(help="Degrees.")] = None,
    roll: Annotated[float | None, typer.Option(help="Degrees.")] = None,
    position_sd: Annotated[float | None, typer.Option(help="Of each body coordinate, metres.")] = None,
    along: Annotated[
        float | None, typer.Option(help="Where on the scenario's route, metres, for its obstructions.")
    ] = None,
    sweep: Annotated[
        str | None, typer.Option(help="error, coordinate or length: a sweep, Landfahrer 3.9 and 3.10.")
    ] = None,
    require_heading: Annotated[
        float | None, typer.Option("--require-heading-deg", help="Demanded sigma: what does it take?")
    ] = None,
    require_pitch: Annotated[float | None, typer.Option("--require-pitch-deg", help="The same.")] = None,
    require_roll: Annotated[float | None, typer.Option("--require-roll-deg", help="The same.")] = None,
    place: Annotated[
        list[str] | None, typer.Option(metavar="X,Y,Z", help="Try one more antenna here. Repeat it.")
    ] = None,
    place_box: Annotated[
        str | None, typer.Option(metavar="X0,Y0,Z0,X1,Y1,Z1", help="Or anywhere in this box.")
    ] = None,
    grid: Annotated[float, typer.Option(help="Metres between the points of the box.")] = 0.25,
    criterion: Annotated[
        str, typer.Option(help="What it shall make small: heading, pitch, roll, trace.")
    ] = "trace",
    at: Annotated[str, typer.Option(help="Epoch that counts: median, p95, worst.")] = "p95",
    draws: Annotated[int, typer.Option(help="Draws of the joint search, at eight epochs; 0 for none.")] = 0,
    error: Annotated[float | None, typer.Option(help="Sweeps: metres of what is held.")] = None,
    coordinate: Annotated[
        str | None, typer.Option(metavar="N,AXIS", help="Sweeps: antenna from 1, and north, east or up.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Table: .csv or .parquet.")] = None,
    figure: Annotated[Path | None, typer.Option(help="Figure: .png, .pdf or .svg.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
) -> None:
    """Say what an array will achieve at a place over a day: accuracy, success, reliability."""
    from .plan import run_plan

    run_plan(
        source,
        antenna=antenna or [],
        noise=noise,
        sweep=sweep,
        require={"heading": require_heading, "pitch": require_pitch, "roll": require_roll},
        place=place or [],
        place_box=place_box,
        grid_m=grid,
        criterion=criterion,
        at=at,
        draws=draws,
        error_m=error,
        coordinate=coordinate,
        out=out,
        figure=figure,
        as_json=as_json,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        start=date,
        hours=hours,
        step_s=step,
        elevation_mask_deg=mask,
        systems=systems,
        bands=tuple(bands.split(",")) if bands else None,
        navigation=tuple(str(path) for path in navigation or ()),
        heading_deg=heading,
        pitch_deg=pitch,
        roll_deg=roll,
        position_sd_m=position_sd,
        along_m=along,
    )


@app.command("northfind")
@_guarded
def _northfind(
    log: Annotated[
        Path, typer.Argument(help="Table of an inertial unit: .csv, .parquet, PSINS text.", metavar="LOG")
    ],
    latitude: Annotated[float | None, typer.Option(help="Degrees north.")] = None,
    longitude: Annotated[float | None, typer.Option(help="Degrees east.")] = None,
    height: Annotated[float | None, typer.Option(help="Above the ellipsoid, metres.")] = None,
    latitude_sd: Annotated[float, typer.Option(help="How well the latitude is known, degrees.")] = 0.0,
    position: Annotated[
        Path | None, typer.Option(help="Where, from a session.toml or a RINEX observation file.")
    ] = None,
    mapping: Annotated[
        Path | None, typer.Option(help="TOML file that names the columns, units and axes of LOG.")
    ] = None,
    errors: Annotated[
        str | None,
        typer.Option(
            help="Errors of the sensor: consumer, industrial, tactical, navigation, or a TOML file."
        ),
    ] = None,
    method: Annotated[
        str | None, typer.Option(help="See docs/northfinding.md; velocity-fit by default.")
    ] = None,
    require: Annotated[
        float, typer.Option("--require-deg", help="Sigma of the azimuth that is asked for.")
    ] = 1.0,
    start: Annotated[float | None, typer.Option("--from", help="Seconds from the start of LOG.")] = None,
    end: Annotated[float | None, typer.Option("--until", help="Seconds from the start of LOG.")] = None,
    table_angles: Annotated[
        str | None,
        typer.Option(metavar="DEG,DEG...", help="Of a turntable at its halts, clockwise; method positions."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Estimate after every second: .csv or .parquet.")] = None,
    figure: Annotated[
        Path | None, typer.Option(help="Convergence and error budget: .png, .pdf or .svg.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
) -> int:
    """Find north from the rotation of the Earth: azimuth, pitch and roll from gyros and accelerometers."""
    from .northfind import run_northfind

    return run_northfind(
        log,
        mapping=mapping,
        position=position,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        latitude_sd_deg=latitude_sd,
        method=method,
        errors=errors,
        required_deg=require,
        start_s=start,
        end_s=end,
        table_angles_deg=table_angles,
        out=out,
        figure=figure,
        as_json=as_json,
    )


@app.command("compare-north")
@_guarded
def _compare_north(
    runs: Annotated[int | None, typer.Option(help="Draws of all errors; 40 by default.")] = None,
    seed: Annotated[int | None, typer.Option(help="Of the first draw; 2006 by default.")] = None,
    latitude: Annotated[float | None, typer.Option(help="Degrees north; Ankara by default.")] = None,
    heading: Annotated[float | None, typer.Option(help="Where the platform points; 11 by default.")] = None,
    methods: Annotated[
        str | None, typer.Option(metavar="NAME,NAME...", help="Only these techniques; all by default.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Table: .csv or .parquet.")] = None,
    figure: Annotated[Path | None, typer.Option(help="Figure: .png, .pdf or .svg.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
) -> None:
    """Compare ways to find north under one truth: GPS, rotating accelerometer, inertial units."""
    from .compare_north import run_compare_north

    run_compare_north(
        runs=runs,
        seed=seed,
        latitude_deg=latitude,
        heading_deg=heading,
        methods=methods,
        out=out,
        figure=figure,
        as_json=as_json,
    )


@app.command("north-budget")
@_guarded
def _north_budget(
    latitude: Annotated[str, typer.Option(help="Degrees north; several with commas between.")],
    errors: Annotated[
        str,
        typer.Option(
            help="Errors of the sensor: consumer, industrial, tactical, navigation, or a TOML file."
        ),
    ],
    duration: Annotated[str, typer.Option(help="Seconds of data; several with commas between.")] = "300",
    method: Annotated[
        str, typer.Option(help="As for `northfind`, several with commas between.")
    ] = "velocity-fit,positions",
    positions: Annotated[int, typer.Option(help="How many, of the method positions.")] = 2,
    heading: Annotated[float, typer.Option(help="Of the platform, degrees.")] = 0.0,
    require: Annotated[
        float, typer.Option("--require-deg", help="Sigma of the azimuth that is asked for.")
    ] = 1.0,
    out: Annotated[Path | None, typer.Option(help="Table: .csv or .parquet.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
) -> int:
    """Predict what an inertial unit will achieve: sigma, error budget and verdict before any recording."""
    from .north_budget import run_north_budget

    return run_north_budget(
        errors,
        latitudes=latitude,
        durations=duration,
        methods=method,
        positions=positions,
        heading_deg=heading,
        required_deg=require,
        out=out,
        as_json=as_json,
    )


@app.command("rates")
@_guarded
def _rates(
    session: Annotated[Path, typer.Argument(help="The session.toml of the recording.", metavar="SESSION")],
    rates: Annotated[str, typer.Option(metavar="HZ,HZ...", help="Update rates.")] = "1,10,20",
    reference: Annotated[Path | None, typer.Option(help="Table of truth, e.g. truth.csv.")] = None,
    out: Annotated[Path | None, typer.Option(help="Table: .csv or .parquet.")] = None,
    figure: Annotated[Path | None, typer.Option(help="Figure: .png, .pdf or .svg.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
) -> None:
    """Thin one recording to several update rates and compare: gaps, status, re-fixing, errors."""
    from .study_rates import run_rates

    run_rates(session, rates=rates, reference=reference, out=out, figure=figure, as_json=as_json)


@app.command("allan")
@_guarded
def _allan(
    log: Annotated[
        Path, typer.Argument(help="Inertial unit at rest: .csv, .parquet, PSINS text.", metavar="LOG")
    ],
    mapping: Annotated[
        Path | None, typer.Option(help="TOML file that names the columns, units and axes of LOG.")
    ] = None,
    grade: Annotated[
        str, typer.Option(help="For what does not show at rest: consumer, industrial, tactical, navigation.")
    ] = "tactical",
    start: Annotated[float | None, typer.Option("--from", help="Seconds from the start of LOG.")] = None,
    end: Annotated[float | None, typer.Option("--until", help="Seconds from the start of LOG.")] = None,
    out: Annotated[Path | None, typer.Option(help="Errors for `northfind --errors`: .toml.")] = None,
    table: Annotated[Path | None, typer.Option(help="The curves: .csv or .parquet.")] = None,
    figure: Annotated[Path | None, typer.Option(help="The curves drawn: .png, .pdf or .svg.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
) -> None:
    """Measure the noise of an inertial unit from a record at rest by its Allan deviation."""
    from .allan import run_allan

    run_allan(
        log,
        mapping=mapping,
        grade=grade,
        start_s=start,
        end_s=end,
        out=out,
        table=table,
        figure=figure,
        as_json=as_json,
    )
