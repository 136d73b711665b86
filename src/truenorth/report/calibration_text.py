"""What a calibration found, as text for a terminal."""

from __future__ import annotations

import numpy as np

__all__ = ["array_calibration_text", "boresight_text", "survey_text"]


def array_calibration_text(calibration) -> str:
    """Table of an array's coordinates, of its distances, and the verdict.

    Parameters
    ----------
    calibration : ArrayCalibration
        Result of `truenorth.calibration.calibrate_array`.

    Returns
    -------
    str
        Coordinates in metres; standard deviations and differences in millimetres.
    """
    c, check = calibration, calibration.declared
    how = "at rest" if c.is_static else "moving, an attitude of its own for every epoch"
    lines = [
        f"epochs      {c.n_used} of {c.n_epochs} used, {c.span_s:.0f} s, {how}",
        f"noise       residuals {np.sqrt(c.variance_factor):.2f} times as large as stated; worth "
        f"{c.effective_epochs:.0f} independent epochs"
        + (f" ({c.correlation_s:.1f} s apart)" if c.correlation_s > 0.0 else ""),
        f"frame       {c.rule_text}",
        "",
    ]
    width = max(8, *(len(name) for name in c.names))
    head = f"{'antenna':<{width}}  {'forward, right, down (m)':>29}  {'sd (mm)':>17}"
    if check is not None:
        head += f"  {'measured less declared (mm)':>27}  verdict"
    lines.append(head)
    sd_mm = 1e3 * c.sd_body_m
    for k, name in enumerate(c.names):
        row = (
            f"{name:<{width}}  "
            + "".join(f"{x:>10.4f}" for x in np.round(c.positions_body_m[k], 4) + 0.0)[1:]
        )
        row += "  " + "".join(f"{x:>6.2f}" for x in sd_mm[k])[1:]
        if check is not None:
            row += (
                "  "
                + "".join(f"{x:>9.1f}" for x in np.round(1e3 * check.difference_m[k], 1) + 0.0)
                + f"  {check.verdict(k)}"
            )
        lines.append(row)
    if c.common_sd_m > 0.0:
        lines.append(
            f"{'':<{width}}  sd: scatter of the run, up to {1e3 * c.scatter_sd_m.max():.2f} mm, and "
            f"{1e3 * c.common_sd_m:.1f} mm for what stays alike through it"
        )
    lines += ["", f"{'distance':<{2 * width + 3}} {'m':>9} {'sd (mm)':>8}"]
    has_declared = not any(np.isnan(pair.declared_m) for pair in c.distances)
    if has_declared:
        lines[-1] += f" {'declared':>9} {'less (mm)':>9}"
    for pair in c.distances:
        row = f"{pair.first + ' - ' + pair.second:<{2 * width + 3}} {pair.distance_m:>9.4f} "
        row += f"{1e3 * pair.sd_m:>8.2f}"
        if has_declared:
            row += f" {pair.declared_m:>9.4f} {round(1e3 * pair.difference_m, 1) + 0.0:>9.1f}"
        lines.append(row)
    if check is not None:
        lines += ["", f"verdict     {check.sentence()}"]
    lines += [f"warning     {text}" for text in c.warnings]
    return "\n".join(lines)


def survey_text(points) -> str:
    """Tables of surveyed marks, the test of the survey, and its blunders.

    Parameters
    ----------
    points : SurveyedPoints
        Result of `truenorth.calibration.survey_file.solve_survey`.

    Returns
    -------
    str
    """
    network = points.network
    verdict = "as stated" if network.statistic <= network.limit else "worse than stated"
    lines = [
        f"pointings   {len(network.residual_rad)}, chi-square {network.statistic:.1f} of {network.degrees} "
        f"degrees of freedom, limit {network.limit:.1f}: {verdict}"
    ]
    lines += [f"left out    {text}" for text in network.events]
    lines.append("")
    lines += _point_table(points.names, points.position_ned_m, points.cov_ned_m2, "north, east, down (m)")
    if points.position_body_m is not None:
        lines.append("")
        lines += _point_table(
            points.names, points.position_body_m, points.cov_body_m2, "forward, right, down (m)"
        )
    return "\n".join(lines)


def _point_table(names, position_m, cov_m2, head):
    width = max(8, *(len(name) for name in names))
    sd_mm = 1e3 * np.sqrt(np.maximum(np.diag(cov_m2), 0.0)).reshape(-1, 3)
    lines = [f"{'point':<{width}}  {head:>32}  {'sd (mm)':>20}"]
    for name, place, sd in zip(names, np.round(position_m, 5) + 0.0, sd_mm, strict=True):
        lines.append(
            f"{name:<{width}}  "
            + "".join(f"{x:>11.5f}" for x in place)[1:]
            + "  "
            + "".join(f"{x:>7.3f}" for x in sd)[1:]
        )
    return lines


def boresight_text(boresight) -> str:
    """Angles of a boresight with their standard deviations, and the errors of the epochs kept for testing.

    Parameters
    ----------
    boresight : Boresight
        Result of `truenorth.calibration.mounting.align_attitudes`.

    Returns
    -------
    str
    """
    b = boresight
    lines = [f"epochs      {b.n_used} used, worth {b.effective:.0f} independent ones"]
    for k, name in enumerate(("heading", "pitch", "roll")):
        angle, sd = np.degrees(b.angles_rad[k]), np.degrees(b.sd_rad[k])
        lines.append(f"{name:<11} {angle:>10.4f} deg, sd {sd:.4f} deg")
    if np.isfinite(b.test_mean_rad).all():
        lines.append("test        errors of the epochs that took no part, about forward, right, down:")
        for word, values in (("mean", b.test_mean_rad), ("sd", b.test_sd_rad)):
            lines.append(f"{word:<11} " + "".join(f"{np.degrees(x):>10.4f}" for x in values) + " deg")
    return "\n".join(lines)
