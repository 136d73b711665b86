"""Figures of a calibration: the phase residuals of each antenna over the sky as the body sees it."""

from __future__ import annotations

import numpy as np

__all__ = ["phase_map_figure"]


def phase_map_figure(maps):
    """Maps of all antennas and bands, forward at the top, the zenith of the body in the middle.

    Parameters
    ----------
    maps : sequence of PhaseMap
        Result of `truenorth.calibration.phase_maps.map_residuals`.

    Returns
    -------
    matplotlib.figure.Figure
        Call its ``savefig``.
    """
    from matplotlib.figure import Figure

    antennas = list(dict.fromkeys(one.antenna for one in maps))
    bands = sorted({one.band for one in maps})
    size_mm = [np.abs(1e3 * one.mean_m[np.isfinite(one.mean_m)]) for one in maps]
    everything = np.concatenate([*size_mm, [0.0]])
    limit_mm = max(float(np.quantile(everything, 0.98)), 0.5)
    figure = Figure(
        figsize=(3.2 * len(antennas) + 1.0, 3.4 * len(bands) + 0.6), dpi=120, layout="constrained"
    )
    axes = figure.subplots(len(bands), len(antennas), squeeze=False, subplot_kw={"projection": "polar"})
    drawn = None
    for one in maps:
        ax = axes[bands.index(one.band), antennas.index(one.antenna)]
        ax.set_theta_zero_location("N")
        ax.set_theta_direction(-1)
        drawn = ax.pcolormesh(
            one.azimuth_edges_rad,
            90.0 - np.degrees(one.elevation_edges_rad),
            1e3 * one.mean_m.T,
            cmap="RdBu_r",
            vmin=-limit_mm,
            vmax=limit_mm,
            shading="flat",
        )
        ax.set_ylim(0.0, 90.0)
        ax.set_yticks([30.0, 60.0, 90.0], ["60", "30", "0"], fontsize="x-small")
        ax.set_xticks(
            np.radians([0.0, 90.0, 180.0, 270.0]), ["forward", "right", "aft", "left"], fontsize="small"
        )
        title = f"{one.antenna}, L{one.band}: rms {1e3 * one.rms_m:.1f} mm"
        if np.isfinite(one.repeatability):
            title += f", {100.0 * one.share:.0f} % real"
        ax.set_title(title, fontsize="medium")
    if drawn is not None:
        figure.colorbar(drawn, ax=axes, label="mean phase residual, mm", shrink=0.7)
    figure.suptitle("Phase residuals in the body frame", fontsize="large", fontweight="bold")
    return figure
