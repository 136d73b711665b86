"""``truenorth calibrate``: where antennas stand and how things are mounted."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from ..calibration import ArrayCalibration
    from ..config import Session

__all__ = ["COMMANDS", "calibrate_session", "session_with"]

MAP_ROWS = 2_000_000
"""Residuals of each baseline that maps are made of, at most."""


def _array(
    session: Annotated[Path, typer.Argument(help="A session.toml.", metavar="SESSION")],
    out: Annotated[
        Path | None, typer.Option(help="Session file to write, with the measured coordinates.")
    ] = None,
    lengths: Annotated[
        str,
        typer.Option(help="What the integers may rest on: unknown, approximate or declared lengths."),
    ] = "unknown",
    length_sd: Annotated[float, typer.Option(help="Of approximate lengths, metres.")] = 0.05,
    declared_sd: Annotated[
        float | None,
        typer.Option(help="Of each declared coordinate in the test of them, metres; by default [array]'s."),
    ] = None,
    rule: Annotated[
        str, typer.Option(help="Frame of the result: declared (best fit to it) or axes.")
    ] = "declared",
    axes: Annotated[
        str | None,
        typer.Option(metavar="NAMES", help="Of --rule axes: antennas at the origin, forward, level."),
    ] = None,
    moving: Annotated[
        bool | None, typer.Option("--moving/--at-rest", help="By default what the data show.")
    ] = None,
    correlation: Annotated[
        float | None, typer.Option(help="Seconds over which errors stay alike, at least.")
    ] = None,
    common_sd: Annotated[
        float, typer.Option(help="Of errors that stay alike through the run (phase centres), metres.")
    ] = 0.001,
    assign: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="A setting, as for `solve`.")
    ] = None,
    phase_maps: Annotated[
        Path | None, typer.Option(help="CSV table to write: residuals of each antenna over its sky.")
    ] = None,
    figure: Annotated[Path | None, typer.Option(help="Figure of these maps: .png, .pdf or .svg.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
) -> int:
    """Survey the antennas of a session with their own phases, and test the declared coordinates."""
    from .request import make_session

    return calibrate_session(
        make_session([session], {}, assign or []),
        out=out,
        lengths=lengths,
        length_sd_m=length_sd,
        declared_sd_m=declared_sd,
        rule=rule,
        axes=None if axes is None else tuple(name.strip() for name in axes.split(",")),
        moving=moving,
        correlation_s=correlation,
        common_sd_m=common_sd,
        phase_maps=phase_maps,
        figure=figure,
        as_json=as_json,
    )


def calibrate_session(
    session: Session,
    *,
    out: Path | None = None,
    lengths: str = "unknown",
    length_sd_m: float = 0.05,
    declared_sd_m: float | None = None,
    rule: str = "declared",
    axes: tuple[str, ...] | None = None,
    moving: bool | None = None,
    correlation_s: float | None = None,
    common_sd_m: float = 0.001,
    phase_maps: Path | None = None,
    figure: Path | None = None,
    as_json: bool = False,
) -> int:
    """Survey the antennas of a session, tell the outcome and write a session with it.

    Parameters
    ----------
    session : Session
        Two antennas or more.
    out : Path, optional
        Session file to write.
    lengths, length_sd_m
        As for `truenorth.calibration.survey_session`.
    declared_sd_m, rule, moving, correlation_s, common_sd_m
        As for `truenorth.calibration.calibrate_array`.
    axes : tuple of str, optional
        Names of the antennas that give the axes.
    phase_maps, figure : Path, optional
        Table and figure of the phase residuals of each antenna over the sky as the body sees it.
    as_json : bool
        Tell it as JSON.

    Returns
    -------
    int
        Exit code.
    """
    import json

    import numpy as np

    from ..calibration import calibrate_array, survey_session
    from ..config import Session
    from ..errors import ConfigError
    from ..export.files import ensure_writable
    from ..report.calibration_text import array_calibration_text
    from .progress import working

    antennas = session.platform.antennas
    names = [antenna.name for antenna in antennas]
    chosen = None
    if axes is not None:
        for name in axes:
            if name not in names:
                raise ConfigError(
                    f"`--axes` names {name!r}; the antennas are {', '.join(names)}", key="axes", value=name
                )
        chosen = tuple(names.index(name) for name in axes)
    for key, path in (("out", out), ("phase_maps", phase_maps), ("figure", figure)):
        if path is not None:
            ensure_writable(path, key=key)
    if figure is not None and figure.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise ConfigError(
            f"`--figure` is {figure}; give a name that ends in .png, .pdf or .svg",
            key="figure",
            value=str(figure),
        )
    known = all(antenna.position_body_m is not None for antenna in antennas)
    declared = np.array([antenna.position_body_m for antenna in antennas], dtype=float) if known else None
    with working("calibrating") as progress:
        from .first_run import compile_kernels

        # Its antennas are solved two by two, whose engine is all that it needs.
        first, second = session.observation_paths[:2]
        compile_kernels(Session.for_pair(first, second, session.gnss.navigation))
        wants_maps = phase_maps is not None or figure is not None
        vectors, baselines, warnings = survey_session(
            session,
            lengths=lengths,
            length_sd_m=length_sd_m,
            progress=progress,
            residual_rows=MAP_ROWS if wants_maps else 0,
        )
        kept = [names.index(name) for name in vectors.names]
        if len(kept) < len(names):
            if rule != "declared" and out is not None:
                raise ConfigError(
                    "antennas are left out whose declared coordinates are not in the frame of --rule axes: "
                    f"{'; '.join(warnings)}; write no session, or use --rule declared",
                    key="rule",
                    value=rule,
                )
            declared = None if declared is None else declared[kept]
            chosen = None if chosen is None else tuple(_kept_index(kept, k, names) for k in chosen)
        calibration = calibrate_array(
            vectors,
            declared_m=declared,
            declared_sd_m=session.array.position_sd_m if declared_sd_m is None else declared_sd_m,
            moving="auto" if moving is None else moving,
            rule=rule if known else "axes",
            axes=chosen,
            correlation_s=correlation_s,
            common_sd_m=common_sd_m,
        )
    written: list[Path] = []
    if out is not None:
        _write(out, session_with(session, calibration).to_toml(folder=out.parent), written)
    if wants_maps:
        from ..calibration.phase_maps import CSV_HEAD, map_residuals

        maps = map_residuals(
            baselines,
            calibration.positions_body_m,
            calibration.time_ns,
            calibration.rot_ned_from_body,
            names=vectors.names,
        )
        if phase_maps is not None:
            _write(phase_maps, "\n".join([CSV_HEAD, *(one.to_csv() for one in maps)]) + "\n", written)
        if figure is not None:
            from ..report.calibration_figures import phase_map_figure

            phase_map_figure(maps).savefig(figure)
            written.append(figure)
    if as_json:
        described: dict[str, Any] = calibration.to_dict()
        described["warnings"] += list(warnings)
        described["session"] = None if out is None else str(out)
        described["files"] = [str(path) for path in written]
        print(json.dumps(described, indent=2, allow_nan=False))
        return 0
    print(array_calibration_text(calibration))
    for text in warnings:
        print(f"warning     {text}")
    for path in written:
        print(f"written     {path}")
    return 0


def _kept_index(kept: list[int], k: int, names: list[str]) -> int:
    from ..errors import ConfigError

    if k not in kept:
        raise ConfigError(
            f"`--axes` names {names[k]!r}, which could not be solved; choose another one",
            key="axes",
            value=names[k],
        )
    return kept.index(k)


def _write(path: Path, text: str, written: list[Path]) -> None:
    from ..errors import writing

    with writing(path):
        path.write_text(text, encoding="utf-8")
    written.append(path)


def session_with(session: Session, calibration: ArrayCalibration) -> Session:
    """Session with the measured coordinates, to a tenth of a millimetre.

    Parameters
    ----------
    session : Session
        What was calibrated.
    calibration : ArrayCalibration
        Its outcome.

    Returns
    -------
    Session
        Antennas that were left out keep their coordinates; ``[array]`` says how well all are known. Of two
        antennas without coordinates: with the measured length.
    """
    import msgspec

    platform, gnss = session.platform, session.gnss
    if any(antenna.position_body_m is None for antenna in platform.antennas):
        length_m = round(calibration.distances[0].distance_m, 4)
        platform = msgspec.structs.replace(platform, length_m=length_m)
        return msgspec.structs.replace(
            session, platform=platform, gnss=msgspec.structs.replace(gnss, length_m=None)
        )
    places = {
        name: tuple(round(float(x), 4) + 0.0 for x in place)
        for name, place in zip(calibration.names, calibration.positions_body_m, strict=True)
    }
    antennas = tuple(
        msgspec.structs.replace(antenna, position_body_m=places.get(antenna.name, antenna.position_body_m))
        for antenna in platform.antennas
    )
    gnss = msgspec.structs.replace(gnss, length_m=None)
    platform = msgspec.structs.replace(platform, antennas=antennas, length_m=None)
    # Of those that the rule leaves free.
    sd_m = calibration.sd_body_m[calibration.sd_body_m > 0.0]
    known_m = round(float((sd_m**2).mean() ** 0.5), 4) if len(sd_m) else 0.0
    array = msgspec.structs.replace(session.array, position_sd_m=known_m)
    return msgspec.structs.replace(session, platform=platform, gnss=gnss, array=array)


def _theodolite(
    survey: Annotated[Path, typer.Argument(help="Survey file (TOML): stations, table of pointings.")],
    as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
) -> None:
    """Adjust the pointings of theodolites to marks on the platform; points and body coordinates of them."""
    import json

    from ..calibration.survey_file import SurveyFile, solve_survey
    from ..report.calibration_text import survey_text

    points = solve_survey(SurveyFile.read(survey))
    if not as_json:
        print(survey_text(points))
        return
    network, body_m = points.network, points.position_body_m
    described: dict[str, Any] = {
        "names": list(points.names),
        "position_ned_m": points.position_ned_m.tolist(),
        "cov_ned_m2": points.cov_ned_m2.tolist(),
        "position_body_m": None if body_m is None else body_m.tolist(),
        "cov_body_m2": None if points.cov_body_m2 is None else points.cov_body_m2.tolist(),
        "statistic": network.statistic,
        "limit": network.limit,
        "degrees_of_freedom": network.degrees,
        "left_out": list(network.events),
    }
    print(json.dumps(described, indent=2, allow_nan=False))


def _boresight(
    attitude: Annotated[
        Path, typer.Argument(help="Attitude of the array: result of `solve`, CSV or Parquet.")
    ],
    reference: Annotated[Path, typer.Argument(help="Attitude of the IMU or other frame: a table of angles.")],
    test_share: Annotated[
        float, typer.Option(help="Share of the epochs, the last, that test what the others give.")
    ] = 0.0,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
) -> None:
    """Find the constant rotation between an array and an IMU (or anything with an attitude)."""
    import json

    from ..evaluation.boresight import boresight_of_tracks
    from ..report.calibration_text import boresight_text

    found = boresight_of_tracks(attitude, reference, test_share=test_share)
    print(json.dumps(found.to_dict(), indent=2, allow_nan=False) if as_json else boresight_text(found))


COMMANDS = {"array": _array, "theodolite": _theodolite, "boresight": _boresight}
"""Commands of ``truenorth calibrate`` by name."""
