"""``truenorth north-budget``: what an inertial unit will achieve, before anything is recorded."""

from __future__ import annotations

from pathlib import Path

from .guard import ExitCode
from .numbers import parse_numbers, require_positive

__all__ = ["run_north_budget"]


def run_north_budget(
    errors: str,
    *,
    latitudes: str,
    durations: str,
    methods: str,
    positions: int,
    heading_deg: float,
    required_deg: float,
    out: Path | None,
    as_json: bool,
) -> int:
    """Print the predicted sigma of every combination; of a single one its budget and verdict.

    Parameters
    ----------
    errors : str
        Grade of the sensor, or the TOML file that states its errors.
    latitudes, durations, methods : str
        Degrees, seconds and names, several with commas between.
    positions : int
        Of the method ``positions``.
    heading_deg : float
        Heading of the platform.
    required_deg : float
        Sigma that is asked for.
    out : Path or None
        Table to write.
    as_json : bool
        Tell it as JSON.

    Returns
    -------
    int
        Exit code: 1 where no combination reaches what was asked for.
    """
    import json

    import numpy as np

    from ..export.planning import check_table_path, write_table
    from ..northfinding import TURNING, Site, judge, predict_budget
    from ..report.north_text import budget_dict, budget_text, verdict_text
    from ..sensors.error_file import read_errors

    if out is not None:
        check_table_path(out)
    require_positive("--require-deg", required_deg)
    stated = read_errors(errors)
    required_rad = float(np.radians(required_deg))
    rows, budgets = [], []
    for latitude in parse_numbers("--latitude", latitudes):
        site = Site(float(np.radians(latitude)))
        for duration in parse_numbers("--duration", durations):
            for method in map(str.strip, methods.split(",")):
                budget = predict_budget(
                    stated,
                    site,
                    duration,
                    method=method,
                    positions=positions,
                    heading_rad=float(np.radians(heading_deg)),
                )
                verdict = judge(budget, site, duration, required_rad, turned=method in TURNING)
                budgets.append((budget, verdict))
                rows.append(
                    {
                        "latitude_deg": latitude,
                        "duration_s": duration,
                        "method": method,
                        "heading_sd_deg": float(np.degrees(verdict.achievable_heading_sd_rad)),
                        "limited_by": f"{budget.lines[0].source}, {budget.lines[0].stated}",
                        "able": bool(verdict.able),
                    }
                )
    written = []
    if out is not None:
        columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        written.append(write_table(columns, out))
    if as_json:
        for row, (budget, verdict) in zip(rows, budgets, strict=True):
            row |= {"budget": budget_dict(budget), "verdict": verdict.sentence}
        told = {"required_deg": required_deg, "rows": rows, "files": [str(path) for path in written]}
        print(json.dumps(told, indent=2, allow_nan=False))
    else:
        print(f"{'latitude':>8} {'seconds':>8}  {'method':<22} {'sigma, deg':>10}  limited by")
        for row in rows:
            print(
                f"{row['latitude_deg']:>8g} {row['duration_s']:>8g}  {row['method']:<22}"
                f" {row['heading_sd_deg']:>10.3g}  {row['limited_by']}"
            )
        if len(rows) == 1:
            budget, verdict = budgets[0]
            print(budget_text(budget))
            print(verdict_text(verdict))
        for path in written:
            print(f"written     {path}")
    return ExitCode.GOOD if any(row["able"] for row in rows) else ExitCode.NO_SOLUTION
