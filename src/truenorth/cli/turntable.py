"""``truenorth turntable``: north from a rotating accelerometer, and what a table must be to find it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import ConfigError
from .guard import ExitCode
from .numbers import parse_numbers, require_positive

if TYPE_CHECKING:
    from ..northfinding.turntable_design import TurntableDesign
    from ..sensors.turntable_accelerometer import TurntableAccelerometerDescription

__all__ = ["COMMANDS", "read_device"]

_OUT = Annotated[Path | None, typer.Option("--out", help="Table: .csv or .parquet.")]
_FIGURE = Annotated[Path | None, typer.Option("--figure", help="Figure: .png, .pdf or .svg.")]
_JSON = Annotated[bool, typer.Option("--json", help="As JSON.")]


def _solve(
    logs: Annotated[
        list[Path],
        typer.Argument(help="Logs of the rotating accelerometer; several: at several speeds.", metavar="LOG"),
    ],
    latitude: Annotated[float, typer.Option(help="Degrees, north positive.")],
    longitude: Annotated[float, typer.Option(help="Degrees, east positive.")] = 0.0,
    height: Annotated[float, typer.Option(help="Metres above the ellipsoid.")] = 0.0,
    latitude_sd: Annotated[float, typer.Option(help="How well the latitude is known, degrees.")] = 0.0,
    method: Annotated[str, typer.Option(help="maximum-likelihood or square-wave.")] = "maximum-likelihood",
    device: Annotated[
        Path | None,
        typer.Option(help="TOML file with a table [turntable_accelerometer]: the errors of the device."),
    ] = None,
    pitch: Annotated[float | None, typer.Option(help="Of the platform, degrees, nose up.")] = None,
    roll: Annotated[float | None, typer.Option(help="Of the platform, degrees, right side down.")] = None,
    tilt_sd: Annotated[float, typer.Option(help="How well each of them is known, degrees.")] = 0.0,
    lean_sd: Annotated[
        float, typer.Option(help="How well the lean of the sensitive axis is known, mrad.")
    ] = 0.0,
    mark_sd: Annotated[float, typer.Option(help="How well the mark is known, degrees.")] = 0.0,
    encoder: Annotated[bool, typer.Option(help="Use the table's angle, or estimate its speed.")] = True,
    harmonics: Annotated[int, typer.Option(help="Fit sines up to this multiple of the revolution.")] = 1,
    require_deg: Annotated[float, typer.Option(help="Sigma of the heading that is needed, degrees.")] = 1.0,
    out: _OUT = None,
    figure: _FIGURE = None,
    as_json: _JSON = False,
) -> int:
    """Find north in the log of a rotating accelerometer: heading of each revolution and combined."""
    import json

    import numpy as np

    from ..export.planning import write_table
    from ..formats.sensor_table import read_sensor_table
    from ..northfinding import Site
    from ..northfinding.turntable import find_north_turntable
    from ..report.files import save_figure
    from ..report.north_text import north_dict, north_text
    from .plan import check_files

    check_files(out, figure)
    require_positive("--require-deg", require_deg)
    if harmonics < 1:
        raise ConfigError(f"`--harmonics {harmonics}` must be 1 or more", key="harmonics", value=harmonics)
    for option, value in (("--tilt-sd", tilt_sd), ("--lean-sd", lean_sd), ("--mark-sd", mark_sd)):
        if not (np.isfinite(value) and value >= 0.0):
            raise ConfigError(f"`{option} {value:g}` must not be negative", key=option[2:], value=value)
    tilt = None
    if pitch is not None or roll is not None:
        tilt = (float(np.radians(pitch or 0.0)), float(np.radians(roll or 0.0)))
        if not max(abs(angle) for angle in tilt) < 0.5 * np.pi:
            raise ConfigError("`--pitch` and `--roll` must be below 90 degrees", key="pitch")
    site = Site(*np.radians([latitude, longitude]).tolist(), height, float(np.radians(latitude_sd)))
    records = [read_sensor_table(path) for path in logs]
    found = find_north_turntable(
        records,
        site,
        description=None if device is None else read_device(device),
        method=method,  # type: ignore[arg-type]
        tilt_rad=tilt,
        tilt_sd_rad=float(np.radians(tilt_sd)),
        lean_sd_rad=1e-3 * lean_sd,
        mark_sd_rad=float(np.radians(mark_sd)),
        encoder=encoder,
        harmonics=harmonics,
        required_heading_sd_rad=float(np.radians(require_deg)),
    )
    run = found.run
    columns: dict[str, Any] = {
        "revolution": np.arange(1, len(found.revolution_time_s) + 1),
        "time_s": found.revolution_time_s,
        "heading_deg": np.degrees(found.revolution_heading_rad),
        "heading_sd_deg": np.full(len(found.revolution_time_s), np.degrees(found.revolution_sd_rad)),
    }
    if run is not None:
        columns["combined_heading_deg"] = np.degrees(run.angles_rad[:, 0])
        columns["combined_heading_sd_deg"] = np.degrees(run.sd_rad[:, 0])
    written = []
    if out is not None:
        written.append(write_table(columns, out))
    if figure is not None:
        from ..report.turntable_figures import turntable_figure

        name = ", ".join(path.name for path in logs)
        written.append(save_figure(turntable_figure(found, records, title=name), figure))
    if as_json:
        told = {
            "logs": [str(path) for path in logs],
            **north_dict(found),
            "crlb_deg": float(np.degrees(found.crlb_rad)),
            "revolutions": {name: values.tolist() for name, values in columns.items()},
            "files": [str(path) for path in written],
        }
        print(json.dumps(told, indent=2, allow_nan=False))
    else:
        for path, record in zip(logs, records, strict=True):
            print(f"record      {path}: {record.n_samples} samples")
        print(north_text(found))
        scatter = found.revolution_scatter_rad
        print(
            f"revolution  {len(found.revolution_time_s)} of them, sigma "
            f"{np.degrees(found.revolution_sd_rad):.4f} deg each, scatter {np.degrees(scatter):.4f} deg"
            if np.isfinite(scatter)
            else f"revolution  one, sigma {np.degrees(found.revolution_sd_rad):.4f} deg"
        )
        print(f"bound       {np.degrees(found.crlb_rad):.4f} deg (Cramer-Rao, with the noise of the record)")
        for path in written:
            print(f"written     {path}")
    verdict = found.verdict
    return ExitCode.NO_SOLUTION if verdict is not None and verdict.able is False else ExitCode.GOOD


def _design(
    latitude: Annotated[str, typer.Option(help="Degrees; several with commas between.")] = "0,20,30,40,60,80",
    radius: Annotated[str, typer.Option(help="Of the accelerometer, metres.")] = "0.05",
    rpm: Annotated[str, typer.Option(help="Speed of the table, revolutions a minute.")] = "600",
    noise: Annotated[str, typer.Option(help="White noise of a sample, m/s^2.")] = "1e-5",
    noise_density: Annotated[
        str | None, typer.Option(help="Noise as a density instead, micro-g/sqrt(Hz).")
    ] = None,
    samples: Annotated[str, typer.Option(help="Samples in a revolution.")] = "500",
    revolutions: Annotated[str, typer.Option(help="Revolutions recorded.")] = "10",
    inclination: Annotated[str, typer.Option(help="Tilt that is not known, one sigma, degrees.")] = "0",
    lean: Annotated[float, typer.Option(help="Lean of the axis that is not known, mrad.")] = 0.0,
    encoder: Annotated[bool, typer.Option(help="An encoder tells the angle, or only a mark.")] = True,
    require_deg: Annotated[
        float | None, typer.Option(help="Sigma of the heading that is needed: how many revolutions?")
    ] = None,
    out: _OUT = None,
    figure: _FIGURE = None,
    as_json: _JSON = False,
) -> int:
    """Predict the sigma of a rotating accelerometer, for every combination of the values given."""
    import json

    import numpy as np

    from ..constants import UG_MPS2
    from ..export.planning import write_table
    from ..northfinding.turntable_design import design_turntable
    from ..report.files import save_figure
    from .plan import check_files

    check_files(out, figure)
    if require_deg is not None:
        require_positive("--require-deg", require_deg)
    density = None
    if noise_density is not None:
        density = [UG_MPS2 * ug for ug in parse_numbers("--noise-density", noise_density)]
    design = design_turntable(
        np.radians(parse_numbers("--latitude", latitude)).tolist(),
        radius_m=parse_numbers("--radius", radius),
        table_rate_radps=[rate * np.pi / 30.0 for rate in parse_numbers("--rpm", rpm)],
        noise_mps2=parse_numbers("--noise", noise),
        noise_density_mps2_rthz=density,
        samples_per_revolution=[round(n) for n in parse_numbers("--samples", samples)],
        revolutions=[round(n) for n in parse_numbers("--revolutions", revolutions)],
        inclination_sd_rad=np.radians(parse_numbers("--inclination", inclination)).tolist(),
        lean_rad=1e-3 * lean,
        speed_known=encoder,
        required_heading_sd_rad=None if require_deg is None else float(np.radians(require_deg)),
    )
    columns = design.columns()
    if require_deg is None:
        columns = {name: values for name, values in columns.items() if not name.startswith("needed")}
    written = []
    if out is not None:
        written.append(write_table(columns, out))
    if figure is not None:
        from ..report.turntable_figures import turntable_design_figure

        written.append(save_figure(turntable_design_figure(design), figure))
    if as_json:
        rows = [
            {name: value if np.isfinite(value) else None for name, value in zip(columns, row, strict=True)}
            for row in zip(*(values.tolist() for values in columns.values()), strict=True)
        ]
        told = {"required_heading_sd_deg": require_deg, "designs": rows, "files": [str(p) for p in written]}
        print(json.dumps(told, indent=2, allow_nan=False))
    else:
        print(_design_text(design, with_needed=require_deg is not None))
        for path in written:
            print(f"written     {path}")
    impossible = require_deg is not None and not np.isfinite(design.needed_revolutions).any()
    return ExitCode.NO_SOLUTION if impossible else ExitCode.GOOD


def _design_text(design: TurntableDesign, *, with_needed: bool) -> str:
    """The table: what is the same in all rows above it, the rest by columns."""
    import numpy as np

    columns = design.columns()
    given = {
        "latitude_deg": "latitude, deg",
        "radius_m": "radius, m",
        "table_rpm": "rpm",
        "noise_mps2": "noise, m/s^2",
        "samples_per_revolution": "samples",
        "revolutions": "revolutions",
        "inclination_sd_deg": "tilt, deg",
    }
    results = {
        "amplitude_mps2": ("amplitude", ".3e"),
        "likelihood_sd_deg": ("likelihood", ".4f"),
        "square_wave_sd_deg": ("square wave", ".4f"),
        "inclination_error_deg": ("by tilt", ".4f"),
        "heading_sd_deg": ("sigma, deg", ".4f"),
        "duration_s": ("time, s", ".4g"),
    }
    if with_needed:
        results |= {"needed_revolutions": ("needed", ".0f"), "needed_s": ("needed, s", ".4g")}
    fixed = [name for name in given if len(np.unique(columns[name])) == 1]
    varied = [name for name in given if name not in fixed]
    lines = (
        ["same for all: " + "; ".join(f"{given[name]} {columns[name][0]:g}" for name in fixed)]
        if fixed
        else []
    )
    if np.isfinite(design.required_heading_sd_rad):
        lines.append(f"asked for: a heading sigma of {np.degrees(design.required_heading_sd_rad):g} deg")
    head = [*(given[name] for name in varied), *(label for label, _ in results.values())]
    rows = [
        [
            *(f"{columns[name][k]:g}" for name in varied),
            *(
                format(columns[name][k], form) if np.isfinite(columns[name][k]) else "never"
                for name, (_, form) in results.items()
            ),
        ]
        for k in range(len(design.latitude_rad))
    ]
    widths = [max(len(row[i]) for row in [head, *rows]) for i in range(len(head))]
    lines += [
        "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in [head, *rows]
    ]
    return "\n".join(lines)


def read_device(path: Path) -> TurntableAccelerometerDescription:
    """Device of a TOML file: its table ``[turntable_accelerometer]``, also within ``[sensors]``.

    Parameters
    ----------
    path : Path
        The file; a scenario will do.

    Returns
    -------
    TurntableAccelerometerDescription

    Raises
    ------
    ConfigError
        If the file cannot be read, is not TOML, has no such table, or a setting is impossible.
    """
    import tomllib

    from ..config import convert_settings
    from ..sensors.turntable_accelerometer import TurntableAccelerometerDescription

    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(
            f"could not read the device from {path}: {error.strerror or error}", key="device"
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"could not read the device: {path} is not valid TOML: {error}", key="device"
        ) from error
    sensors = table.get("sensors", table)
    section = sensors.get("turntable_accelerometer") if isinstance(sensors, dict) else None
    if not isinstance(section, dict):
        raise ConfigError(
            f"{path} has no table [turntable_accelerometer]; put the settings of the device under one",
            key="device",
            value=str(path),
        )
    return convert_settings(section, TurntableAccelerometerDescription, prefix="turntable_accelerometer.")


COMMANDS = {"solve": _solve, "design": _design}
"""Commands of ``truenorth turntable`` by name."""
