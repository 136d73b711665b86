"""What a calibration found, as text for a terminal."""

from __future__ import annotations

import numpy as np

__all__ = ["array_calibration_text"]


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
            row += f" {pair.declared_m:>9.4f} {1e3 * pair.difference_m:>9.1f}"
        lines.append(row)
    if check is not None:
        lines += ["", f"verdict     {check.sentence()}"]
    lines += [f"warning     {text}" for text in c.warnings]
    return "\n".join(lines)
