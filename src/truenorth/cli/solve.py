"""``truenorth solve``: from antennas' raw files to a direction or an attitude for every epoch."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .quick import split_names
from .run import run_solve

__all__ = ["solve"]


def solve(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="BASE.obs ROVER.obs BRDC.nav [MORE.nav ...], or BASE.ubx ROVER.ubx, or one session.toml. "
            "The baseline points from BASE to ROVER; a session of three or more antennas gives the attitude.",
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
            "--set",
            metavar="KEY=VALUE",
            help="Any other, e.g. stochastic.phase_sd_m=0.002, array.method=triad.",
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
) -> int:
    """Find where a baseline or an array of antennas points, with uncertainty and status of every epoch."""
    overrides = {
        "length_m": length,
        "length_sd_m": length_sd,
        "length_use": length_use,
        "method": method,
        "single_epoch": single_epoch,
        "systems": systems,
        "bands": None if bands is None else split_names(bands),
        "elevation_mask_deg": mask,
        "cn0_mask_dbhz": cn0_mask,
        "ratio_test": ratio_test,
        "ratio_threshold": ratio_threshold,
        "success_probability": success_probability,
        "direction": direction,
    }
    return run_solve(files, overrides, assign or [], out=out, figure=figure, explain=explain, as_json=as_json)
