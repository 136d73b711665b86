"""``truenorth allan``: the noise of an inertial unit from a record at rest."""

from __future__ import annotations

from pathlib import Path

from ..errors import ConfigError

__all__ = ["run_allan"]


def run_allan(
    log: Path,
    *,
    mapping: Path | None,
    grade: str,
    start_s: float | None,
    end_s: float | None,
    out: Path | None,
    table: Path | None,
    figure: Path | None,
    as_json: bool,
) -> None:
    """Analyse a log and tell, write and draw what its Allan deviation says.

    Parameters
    ----------
    log : Path
        Table of gyro and accelerometer samples.
    mapping : Path or None
        TOML file that names columns and units.
    grade : str
        Of the sensor, for what a record at rest cannot show.
    start_s, end_s : float or None
        Part of the log, seconds from its start.
    out, table, figure : Path or None
        Files to write: the errors for `northfind`, the curves, the curves drawn.
    as_json : bool
        Tell it as JSON.
    """
    import json

    from ..export.files import check_suffix
    from ..formats.imu_table import read_imu_table
    from ..sensors.imu import GRADES
    from .plan import check_files

    if grade not in GRADES:
        raise ConfigError(
            f"`--grade {grade}` is no grade of sensor; give {', '.join(GRADES)}", key="grade", value=grade
        )
    check_files(table, figure)
    if out is not None:
        check_suffix(out, (".toml",))
    record = read_imu_table(log, mapping, start_s=start_s, end_s=end_s)
    from ..sensors.allan import analyse_allan

    result = analyse_allan(record.increments)
    written = []
    if out is not None:
        written.append(result.write(out, grade))
    if table is not None:
        from ..export.planning import write_table

        written.append(write_table(result.columns(), table))
    if figure is not None:
        from ..report.allan_figures import allan_figure
        from ..report.files import save_figure

        written.append(save_figure(allan_figure(result, title=log.name), figure))
    if as_json:
        told = {"log": str(log), **result.to_dict(), "files": [str(path) for path in written]}
        print(json.dumps(told, indent=2, allow_nan=False))
        return
    print(
        f"record      {log}: {record.n_samples} samples, {record.duration_s:.1f} s at "
        f"{1.0 / record.interval_s:g} Hz"
    )
    print(result)
    for note in result.notes:
        print(f"note        {note}")
    for path in written:
        print(f"written     {path}")
