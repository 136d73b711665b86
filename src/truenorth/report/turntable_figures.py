"""Figures of the rotating accelerometer: what a record says of north, and what a design will say."""

import numpy as np

from .north_text import sigma_word

__all__ = ["turntable_design_figure", "turntable_figure"]

_BLUE, _ORANGE, _GREEN, _PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
_CYCLE = (_BLUE, _ORANGE, _GREEN, _PURPLE, "#E69F00", "#56B4E9", "#000000")


def turntable_figure(found, logs, *, title=None):
    """One page: the signal folded on a turn, the heading of each revolution, the spectrum, the sigma.

    Parameters
    ----------
    found : truenorth.northfinding.turntable.TurntableNorth
        The result.
    logs : sequence of SensorLog
        What it was found in.
    title : str, optional
        What comes first in the headline, e.g. the name of the log.

    Returns
    -------
    matplotlib.figure.Figure
        Call its ``savefig``.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 7.6), dpi=120, layout="constrained")
    (folded, turns), (spectrum, sigma) = figure.subplots(2, 2)
    for fit, log, color in zip(found.fits, logs, _CYCLE, strict=False):
        _plot_folded(folded, fit, color)
        _plot_spectrum(spectrum, fit, log, color)
    _plot_revolutions(turns, found)
    _plot_sigma(sigma, found)
    heading, sd = np.degrees(found.heading_rad), np.degrees(found.heading_sd_rad)
    decimals = int(np.clip(1 - np.floor(np.log10(max(sd, 1e-9))), 2, 5))
    figure.suptitle(
        f"{f'{title}: ' if title else ''}heading {round(heading, decimals) % 360.0:.{decimals}f}° "
        f"± {sigma_word(sd)}° (1 sigma)\n{found.method}, {len(found.revolution_time_s)} revolutions at "
        f"latitude {np.degrees(found.site.latitude_rad):.3f}°",
        fontsize="large",
        fontweight="bold",
    )
    return figure


def _plot_folded(ax, fit, color):
    """Means of the samples at each angle of the table, and the sine that was found."""
    angle = np.mod(np.degrees(fit.angle_rad[fit.used]), 360.0)
    cell = np.minimum((angle / 10.0).astype(int), 35)
    count = np.maximum(np.bincount(cell, minlength=36), 1)
    micro = 1e6 * fit.cleaned_mps2[fit.used]
    mean = np.bincount(cell, micro, minlength=36) / count
    centre = np.arange(5.0, 360.0, 10.0)
    h = 1e6 * fit.harmonic_mps2
    at = np.radians(np.linspace(0.0, 360.0, 361))
    sd = 1e6 * fit.noise.white_sd / np.sqrt(count)
    ax.errorbar(centre, mean, sd, fmt=".", color=color, markersize=4.0, linewidth=1.0)
    rpm = fit.rate_radps * 30.0 / np.pi
    ax.plot(np.degrees(at), h[0] * np.cos(at) - h[1] * np.sin(at), color=color, label=f"{rpm:.4g} rpm")
    ax.set_xlim(0.0, 360.0)
    ax.set_xticks(np.arange(0.0, 361.0, 60.0))
    ax.set_xlabel("angle of the accelerometer, counter-clockwise from forward, deg")
    ax.set_ylabel("once a revolution, µm/s²")
    ax.set_title("signal, mean over ten degrees", fontsize="medium")
    ax.grid(alpha=0.3)
    ax.legend(fontsize="small")


def _plot_spectrum(ax, fit, log, color):
    """What the fit leaves, as the noise of a sample that it would be if it were white."""
    step_s = float(np.median(np.diff(log.time_ns))) * 1e-9
    n = len(fit.residual_mps2)
    hz = np.fft.rfftfreq(n, step_s)[1:]
    level = np.abs(np.fft.rfft(fit.residual_mps2))[1:] / np.sqrt(n)
    shown = level > 1e-6 * level.max(initial=0.0)
    ax.plot(hz[shown], 1e6 * level[shown], color=color, alpha=0.45, linewidth=0.6)
    turn_hz = abs(fit.rate_radps) / (2.0 * np.pi)
    ax.plot(turn_hz, 1e6 * fit.noise.signal_sd, "D", color=color, markersize=6.0, label="noise at the signal")
    for frequency, _ in fit.vibrations:
        ax.axvline(frequency, color=_PURPLE, linewidth=0.8, linestyle=":")
    ax.axvline(turn_hz, color="black", linewidth=0.8, linestyle="--")
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlabel("Hz (dashed: the table; dotted: vibration lines that were fitted)")
    ax.set_ylabel("noise of a sample, µm/s²")
    ax.set_title("spectrum of the residuals", fontsize="medium")
    ax.grid(alpha=0.3)
    ax.legend(fontsize="small", loc="lower right")


def _plot_revolutions(ax, found):
    """Heading of each revolution about the combined one."""
    number = np.arange(1, len(found.revolution_heading_rad) + 1)
    off = np.degrees(np.mod(found.revolution_heading_rad - found.heading_rad + np.pi, 2.0 * np.pi) - np.pi)
    sd = np.degrees(found.revolution_sd_rad)
    if len(number) <= 60:
        ax.errorbar(number, off, sd, fmt="o", color=_BLUE, markersize=4.0, linewidth=1.0, label="revolution")
    else:
        ax.plot(number, off, ".", color=_BLUE, markersize=3.0, label="revolution")
        ax.axhspan(-sd, sd, color=_BLUE, alpha=0.12, linewidth=0)
    combined = np.degrees(found.heading_sd_rad)
    ax.axhspan(-combined, combined, color=_ORANGE, alpha=0.3, linewidth=0, label="combined, 1 sigma")
    ax.axhline(0.0, color=_ORANGE, linewidth=1.0)
    ax.xaxis.get_major_locator().set_params(integer=True)
    ax.set_xlabel("revolution")
    ax.set_ylabel("heading less combined, deg")
    ax.set_title("heading of each revolution", fontsize="medium")
    ax.grid(alpha=0.3)
    ax.legend(fontsize="small")


def _plot_sigma(ax, found):
    """Sigma after each revolution beside the bound."""
    number = np.arange(1, len(found.revolution_time_s) + 1)
    ax.plot(number, np.degrees(found.run.sd_rad[:, 0]), color=_BLUE, label="stated")
    bound = np.degrees(found.crlb_rad) * np.sqrt(number[-1] / number)
    ax.plot(number, bound, color="black", linestyle="--", linewidth=1.0, label="Cramér-Rao, noise alone")
    off = np.mod(found.run.angles_rad[:, 0] - found.heading_rad + np.pi, 2.0 * np.pi) - np.pi
    ax.plot(number[:-1], np.abs(np.degrees(off[:-1])), ".", color=_GREEN, label="off the final heading")
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_ylim(bottom=0.03 * np.degrees(found.run.sd_rad[-1, 0]))
    ax.set_xlabel("revolutions")
    _plain(ax.xaxis)
    _plain(ax.yaxis)
    ax.set_ylabel("deg")
    ax.set_title("sigma of the heading as revolutions are added", fontsize="medium")
    ax.grid(alpha=0.3)
    ax.legend(fontsize="small")


def turntable_design_figure(design):
    """Sigma against latitude for every design: total, noise alone, square wave.

    Parameters
    ----------
    design : truenorth.northfinding.turntable_design.TurntableDesign
        Result of `truenorth.northfinding.turntable_design.design_turntable`.

    Returns
    -------
    matplotlib.figure.Figure
        Call its ``savefig``.
    """
    from matplotlib.figure import Figure

    columns = design.columns()
    given = {
        "radius_m": "{:g} m",
        "table_rpm": "{:g} rpm",
        "noise_mps2": "noise {:.3g} m/s²",
        "samples_per_revolution": "{:g} samples",
        "revolutions": "{:g} revolutions",
        "inclination_sd_deg": "tilt ± {:g}°",
    }
    varied = [name for name in given if len(np.unique(columns[name])) > 1]
    keys = np.stack([columns[name] for name in given], axis=1)
    cases = np.unique(keys, axis=0)
    figure = Figure(figsize=(9.0, 5.6), dpi=120, layout="constrained")
    ax = figure.subplots()
    for case, color in zip(cases, (_CYCLE * (1 + len(cases) // len(_CYCLE))), strict=False):
        rows = np.flatnonzero((keys == case).all(axis=1))
        rows = rows[np.argsort(columns["latitude_deg"][rows])]
        words = ", ".join(
            text.format(value)
            for (name, text), value in zip(given.items(), case, strict=True)
            if name in varied
        )
        latitude = columns["latitude_deg"][rows]
        ax.plot(latitude, columns["heading_sd_deg"][rows], "o-", color=color, label=words or "sigma")
        ax.plot(latitude, columns["square_wave_sd_deg"][rows], "--", color=color, linewidth=0.8)
        if columns["inclination_error_deg"][rows].any():
            ax.plot(latitude, columns["likelihood_sd_deg"][rows], ":", color=color, linewidth=1.2)
    if np.isfinite(design.required_heading_sd_rad):
        ax.axhline(np.degrees(design.required_heading_sd_rad), color="black", label="asked for")
    ax.set_yscale("log")
    ax.set_xlabel("latitude, deg (dashed: noise by square waves; dotted: noise by maximum likelihood alone)")
    ax.set_ylabel("sigma of the heading, deg")
    _plain(ax.yaxis)
    ax.grid(alpha=0.3, which="both")
    if len(cases) <= 12:
        ax.legend(fontsize="small")
    same = ", ".join(text.format(columns[name][0]) for name, text in given.items() if name not in varied)
    figure.suptitle(f"Rotating accelerometer: {same}", fontsize="medium", fontweight="bold")
    return figure


def _plain(axis):
    """Label a logarithmic axis by plain numbers, few of them."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
