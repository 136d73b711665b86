"""``truenorth northfind``: where an inertial unit at rest points, from the Earth's rotation."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import ConfigError
from .guard import ExitCode
from .numbers import parse_numbers, require_positive

if TYPE_CHECKING:
    from ..formats.imu_table import ImuTable
    from ..northfinding import Site

__all__ = ["run_northfind"]


def run_northfind(
    log: Path,
    *,
    mapping: Path | None = None,
    position: Path | None = None,
    latitude_deg: float | None = None,
    longitude_deg: float | None = None,
    height_m: float | None = None,
    latitude_sd_deg: float = 0.0,
    method: str | None = None,
    errors: str | None = None,
    required_deg: float = 1.0,
    start_s: float | None = None,
    end_s: float | None = None,
    table_angles_deg: str | None = None,
    out: Path | None = None,
    figure: Path | None = None,
    as_json: bool = False,
) -> int:
    """Find north in an inertial log; print azimuth, pitch, roll, error budget and verdict.

    Parameters
    ----------
    log : Path
        Table of gyro and accelerometer samples.
    mapping : Path or None
        TOML file that names columns and units.
    position : Path or None
        Session or RINEX file that says where.
    latitude_deg, longitude_deg, height_m : float or None
        Where; before `position` and the log's own header.
    latitude_sd_deg : float
        How well the latitude is known.
    method : str or None
        A name of `truenorth.northfinding.METHODS`.
    errors : str or None
        Grade of the sensor, or the TOML file that states its errors.
    required_deg : float
        Sigma of the azimuth that the verdict is about.
    start_s, end_s : float or None
        Part of the log, seconds from its start.
    table_angles_deg : str or None
        Angles of a turntable at its halts, with commas between.
    out, figure : Path or None
        Files to write: the running estimate, and convergence and budget drawn.
    as_json : bool
        Tell it as JSON.

    Returns
    -------
    int
        Exit code: 1 where the stated errors do not allow what was asked for.
    """
    import json
    import time

    import numpy as np

    from ..config import convert_settings
    from ..export.planning import check_table_path, write_table
    from ..formats.imu_table import read_imu_table
    from ..northfinding import DEFAULT_METHOD, find_north
    from ..report.files import check_static_path, save_figure
    from ..report.north_text import north_columns, north_dict, north_text
    from ..sensors import ImuDescription
    from ..sensors.error_file import read_errors

    if figure is not None:
        check_static_path(figure)
    if out is not None:
        check_table_path(out)
    require_positive("--require-deg", required_deg)
    stated = None if errors is None else read_errors(errors)
    table = read_imu_table(log, mapping, start_s=start_s, end_s=end_s)
    if stated is None and table.errors:
        stated = convert_settings(dict(table.errors), ImuDescription, prefix="errors.")
    place = (latitude_deg, longitude_deg, height_m, latitude_sd_deg)
    options = {}
    if table_angles_deg is not None:
        options["table_angle_rad"] = np.radians(parse_numbers("--table-angles", table_angles_deg))
    site = _site(table, position, *place)
    started = time.perf_counter()
    solution = find_north(
        table,
        site,
        method=method or DEFAULT_METHOD,
        errors=stated,
        required_heading_sd_rad=float(np.radians(required_deg)),
        **options,
    )
    seconds = time.perf_counter() - started
    written = []
    if out is not None:
        written.append(write_table(north_columns(solution), out))
    if figure is not None:
        from ..report.north_figures import north_figure

        written.append(save_figure(north_figure(solution, title=Path(log).name), figure))
    if as_json:
        files = [str(path) for path in written]
        told = {"log": str(log), **north_dict(solution), "seconds": seconds, "files": files}
        print(json.dumps(told, indent=2, allow_nan=False))
    else:
        rate_hz = 1.0 / table.interval_s
        print(f"record      {log}: {table.n_samples} samples, {table.duration_s:g} s at {rate_hz:g} Hz")
        for note in (*table.notes, *_contradictions(table, site)):
            print(f"            {note}")
        print(north_text(solution))
        print(f"time        {seconds:.2f} s")
        for path in written:
            print(f"written     {path}")
    verdict = solution.verdict
    return ExitCode.NO_SOLUTION if verdict is not None and verdict.able is False else ExitCode.GOOD


def _contradictions(table: ImuTable, site: Site) -> list[str]:
    """A sentence where the log says another place than the one that was taken."""
    import math

    if table.latitude_rad is None or abs(table.latitude_rad - site.latitude_rad) < math.radians(0.1):
        return []
    said, taken = (math.degrees(angle) for angle in (table.latitude_rad, site.latitude_rad))
    return [f"The log says latitude {said:.3f}; {taken:.3f} was given and is taken."]


def _site(
    table: ImuTable,
    position: Path | None,
    latitude_deg: float | None,
    longitude_deg: float | None,
    height_m: float | None,
    latitude_sd_deg: float,
) -> Site:
    """Where: what is typed wins over the position's file, and that over the header of the log."""
    import numpy as np

    from ..northfinding import Site

    found = (table.latitude_rad, table.longitude_rad, table.height_m)
    if position is not None:
        from ..northfinding.place import position_from_file

        found = position_from_file(position)
    typed = (latitude_deg, longitude_deg)
    latitude, longitude = (
        place if given is None else float(np.radians(given))
        for place, given in zip(found, typed, strict=False)
    )
    height = found[2] if height_m is None else height_m
    if latitude is None:
        raise ConfigError(
            f"{table.source} does not say where it was recorded, and north depends on it; give --latitude, or"
            f" --position with a RINEX or session file",
            key="latitude",
        )
    if not latitude_sd_deg >= 0.0:
        raise ConfigError(
            f"`--latitude-sd {latitude_sd_deg:g}` is no standard deviation; give 0 or more", key="latitude-sd"
        )
    return Site(latitude, longitude or 0.0, height or 0.0, float(np.radians(latitude_sd_deg)))
