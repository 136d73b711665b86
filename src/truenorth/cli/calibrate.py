"""``truenorth calibrate``: where antennas stand and how things are mounted."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from ..calibration import ArrayCalibration
    from ..config import Session

__all__ = ["COMMANDS", "calibrate_session", "session_with"]


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
        float, typer.Option(help="Of each declared coordinate in the test of them, metres.")
    ] = 0.003,
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
        as_json=as_json,
    )


def calibrate_session(
    session: Session,
    *,
    out: Path | None = None,
    lengths: str = "unknown",
    length_sd_m: float = 0.05,
    declared_sd_m: float = 0.003,
    rule: str = "declared",
    axes: tuple[str, ...] | None = None,
    moving: bool | None = None,
    correlation_s: float | None = None,
    common_sd_m: float = 0.001,
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
    if out is not None:
        ensure_writable(out, key="out")
    known = all(antenna.position_body_m is not None for antenna in antennas)
    declared = np.array([antenna.position_body_m for antenna in antennas], dtype=float) if known else None
    with working("calibrating") as progress:
        from .first_run import compile_kernels

        compile_kernels(session)
        vectors, _, warnings = survey_session(
            session,
            lengths=lengths,  # type: ignore[arg-type]
            length_sd_m=length_sd_m,
            progress=progress,
        )
        calibration = calibrate_array(
            vectors,
            declared_m=declared,
            declared_sd_m=declared_sd_m,
            moving="auto" if moving is None else moving,
            rule=rule if known else "axes",  # type: ignore[arg-type]
            axes=chosen,
            correlation_s=correlation_s,
            common_sd_m=common_sd_m,
        )
    if out is not None:
        text = session_with(session, calibration).to_toml(folder=out.parent)
        try:
            out.write_text(text, encoding="utf-8")
        except OSError as error:
            raise ConfigError(
                f"could not write {out}: {error.strerror or error}; give another place", key="out"
            ) from error
    if as_json:
        described: dict[str, Any] = calibration.to_dict()
        described["warnings"] += list(warnings)
        described["session"] = None if out is None else str(out)
        print(json.dumps(described, indent=2, allow_nan=False))
        return 0
    print(array_calibration_text(calibration))
    for text in warnings:
        print(f"warning     {text}")
    if out is not None:
        print(f"written     {out}")
    return 0


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
        Of two antennas without coordinates: with the measured length.
    """
    import msgspec

    platform, gnss = session.platform, session.gnss
    if any(antenna.position_body_m is None for antenna in platform.antennas):
        length_m = round(calibration.distances[0].distance_m, 4)
        platform = msgspec.structs.replace(platform, length_m=length_m)
        return msgspec.structs.replace(
            session, platform=platform, gnss=msgspec.structs.replace(gnss, length_m=None)
        )
    antennas = tuple(
        msgspec.structs.replace(
            antenna,
            position_body_m=tuple(round(float(x), 4) + 0.0 for x in calibration.positions_body_m[k]),
        )
        for k, antenna in enumerate(platform.antennas)
    )
    gnss = msgspec.structs.replace(gnss, length_m=None)
    platform = msgspec.structs.replace(platform, antennas=antennas, length_m=None)
    return msgspec.structs.replace(session, platform=platform, gnss=gnss)


COMMANDS = {"array": _array}
"""Commands of ``truenorth calibrate`` by name."""
