"""``truenorth solve``: from two antennas' raw files to azimuth and elevation for every epoch."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

__all__ = ["run_session", "solve"]

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


def solve(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="BASE.obs ROVER.obs BRDC.nav [MORE.nav ...], or BASE.ubx ROVER.ubx, or one session.toml. "
            "The baseline points from BASE to ROVER.",
            metavar="FILE...",
            show_default=False,
        ),
    ],
    length: Annotated[float | None, typer.Option(help="Known antenna separation, metres.")] = None,
    length_sd: Annotated[float | None, typer.Option(help="Its standard deviation, metres.")] = None,
    length_use: Annotated[str | None, typer.Option(help="constrain, check, compute or off.")] = None,
    method: Annotated[
        str | None, typer.Option(help="constrained, lambda, lsast, exhaustive, kalman or filter.")
    ] = None,
    single_epoch: Annotated[
        bool | None, typer.Option("--single-epoch/--no-single-epoch", help="Resolve every epoch by itself.")
    ] = None,
    systems: Annotated[str | None, typer.Option(help="Letters of the systems, e.g. GEC.")] = None,
    bands: Annotated[str | None, typer.Option(help="Bands with commas between, e.g. L1,L2.")] = None,
    mask: Annotated[float | None, typer.Option(help="Elevation mask, degrees.")] = None,
    cn0_mask: Annotated[float | None, typer.Option(help="Lowest C/N0, dB-Hz.")] = None,
    ratio_test: Annotated[
        str | None, typer.Option(help="none, fixed, fixed_failure_rate or difference.")
    ] = None,
    ratio_threshold: Annotated[float | None, typer.Option(help="Threshold of the fixed ratio test.")] = None,
    success_probability: Annotated[
        float | None, typer.Option(help="Probability of right integers, demanded for acceptance.")
    ] = None,
    direction: Annotated[
        str | None, typer.Option(help="forward, backward or combined, for --method filter.")
    ] = None,
    assign: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Any other setting, e.g. stochastic.phase_sd_m=0.002."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Result file: .csv, .parquet, .pos, .nmea, .json or .nc.")
    ] = None,
    figure: Annotated[Path | None, typer.Option(help="Figure page: .png, .pdf, .svg or .html.")] = None,
    explain: Annotated[
        str | None,
        typer.Option(metavar="TIME", help="Tell one epoch's story, e.g. 2024-06-24T08:20:00 or 08:20:00."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Summary as JSON on stdout.")] = False,
) -> None:
    """Find azimuth and elevation of a baseline for every epoch, with their uncertainty and status."""
    overrides = {
        "length_m": length,
        "length_sd_m": length_sd,
        "length_use": length_use,
        "method": method,
        "single_epoch": single_epoch,
        "systems": systems,
        "bands": None if bands is None else [name.strip() for name in bands.split(",")],
        "elevation_mask_deg": mask,
        "cn0_mask_dbhz": cn0_mask,
        "ratio_test": ratio_test,
        "ratio_threshold": ratio_threshold,
        "success_probability": success_probability,
        "direction": direction,
    }
    from .request import make_session

    session = make_session(files, overrides, assign or [])
    run_session(session, out=out, figure=figure, explain=explain, as_json=as_json)


def run_session(
    session: Any,
    *,
    out: Path | None = None,
    figure: Path | None = None,
    explain: str | None = None,
    as_json: bool = False,
) -> None:
    """Solve a session, write what was asked for, and tell the outcome.

    Parameters
    ----------
    session : Session
        What to solve.
    out, figure : Path, optional
        Files to write.
    explain : str, optional
        Time of an epoch whose story is told instead of the summary.
    as_json : bool
        Tell it as JSON.

    Raises
    ------
    typer.Exit
        With code 1 when no epoch was accepted.
    """
    import json
    import time
    import warnings

    from ..errors import TrueNorthWarning
    from ..export import check_output_path, summarize_solution, write_settings, write_solution
    from ..report.text import explain_epoch, find_epoch, summary_text
    from .guard import ExitCode
    from .progress import working

    if out is not None:
        check_output_path(out)
    if figure is not None:
        from ..report import check_figure_path

        check_figure_path(figure)

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", TrueNorthWarning)
        with working("solving") as progress:
            from ..attitude import solve_session

            solution = solve_session(session, progress=progress)
    said = [str(warning.message) for warning in caught if issubclass(warning.category, TrueNorthWarning)]

    written = []
    started = time.perf_counter()
    if out is not None:
        written = [write_solution(solution, out), write_settings(session, out, solution=solution)]
    if figure is not None:
        from ..report import write_figure

        with working("drawing"):
            written.append(write_figure(solution, figure))

    summary = summarize_solution(solution)
    summary["seconds"]["write"] = time.perf_counter() - started
    summary["warnings"] += [text for text in dict.fromkeys(said) if text not in summary["warnings"]]
    summary["files"] = [str(path) for path in written]
    summary["settings_file"] = str(written[1]) if out is not None else None

    if explain is not None:
        story = explain_epoch(solution, find_epoch(solution, explain))
        summary["explain"] = story
    if as_json:
        typer.echo(json.dumps(summary, indent=2, allow_nan=False))
    else:
        typer.echo(story if explain is not None else summary_text(summary))
    if summary["accepted_fraction"] == 0.0:
        raise typer.Exit(int(ExitCode.NO_SOLUTION))
