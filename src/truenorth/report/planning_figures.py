"""Figures of plans: the sky over a day, what an array makes of it, sweeps, and rates compared."""

from pathlib import Path

import numpy as np

from ..constants import SYSTEM_NAMES
from ..errors import ConfigError
from ..export.files import ensure_writable
from ..observations import sat_name
from ..timescales import format_gpst, gpst_to_datetime64
from .files import STATIC_SUFFIXES
from .style import SYSTEM_COLORS

__all__ = ["ANGLE_COLORS", "check_plan_figure_path", "plan_figure", "save_plan_figure"]

ANGLE_COLORS = {"heading": "#0072B2", "pitch": "#D55E00", "roll": "#009E73"}
"""Of the same palette as everything else."""


def check_plan_figure_path(path):
    """Make sure that a figure of a plan can be written.

    Parameters
    ----------
    path : str or path-like
        File to be written later.

    Raises
    ------
    ConfigError
        If the suffix is unknown or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in STATIC_SUFFIXES:
        raise ConfigError(
            f"could not choose the format of {path}: {path.suffix or 'no suffix'!r} is not one of "
            + ", ".join(STATIC_SUFFIXES),
            key="figure",
            value=str(path),
        )
    ensure_writable(path, key="figure")


def save_plan_figure(figure, path):
    """Write a figure to a file.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        What to write.
    path : str or path-like
        ``.png``, ``.pdf`` or ``.svg``.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ConfigError
        If the suffix is unknown or the file cannot be written.
    """
    path = Path(path)
    check_plan_figure_path(path)
    try:
        figure.savefig(path)
    except OSError as error:
        raise ConfigError(
            f"could not write {path}: {error.strerror or error}; give another place",
            key="figure",
            value=str(path),
        ) from error
    return path


def plan_figure(plan):
    """One page: satellites in view, accuracy, hidden blunders, dilutions and success over time.

    Parameters
    ----------
    plan : truenorth.planning.Plan
        The plan.

    Returns
    -------
    matplotlib.figure.Figure
        Call its ``savefig``.
    """
    from matplotlib.figure import Figure

    n_satellites = len(np.unique(plan.view.satellite))
    sky_height = float(np.clip(0.055 * n_satellites, 1.2, 5.0))
    heights = (sky_height, 1.0, 1.8, 1.8, 1.5, 1.3)
    figure = Figure(figsize=(10.0, sum(heights) + 2.4), dpi=120, layout="constrained")
    axes = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
    time = gpst_to_datetime64(plan.time_ns)
    _plot_bars(plan, axes[0])
    _plot_counts(plan, axes[1], time)
    _plot_angles(axes[2], time, np.degrees(plan.sd_rad), "sigma, deg")
    _plot_angles(axes[3], time, np.degrees(plan.reliability.external_rad), "hidden blunder, deg")
    axes[4].plot(time, plan.azimuth_dop, color=ANGLE_COLORS["heading"], label="azimuth")
    axes[4].plot(time, plan.elevation_dop, color=ANGLE_COLORS["pitch"], label="elevation")
    _finish(axes[4], "DOP, longest\nbaseline", (plan.azimuth_dop, plan.elevation_dop))
    axes[5].plot(time, plan.success, color="#0072B2")
    axes[5].set_ylim(-0.03, 1.03)
    axes[5].set_ylabel("success of one\nbaseline, at least")
    axes[5].grid(alpha=0.3)
    _time_axis(axes[-1], plan)
    s = plan.settings
    figure.suptitle(
        f"Plan of {len(s.antennas)} antennas at {s.latitude_deg:.3f}, {s.longitude_deg:.3f}: single epoch, "
        f"integers fixed, above {s.elevation_mask_deg:g} deg",
        fontsize="large",
        fontweight="bold",
    )
    return figure


def _plot_bars(plan, ax):
    """One line for each satellite while it is in view, systems together."""
    view = plan.view
    time = gpst_to_datetime64(plan.time_ns)
    step = np.timedelta64(round(plan.settings.step_s * 1e9), "ns")
    satellites = np.unique(view.satellite)[::-1]
    ticks, labels = [], []
    for place, sat in enumerate(satellites):
        epochs = np.unique(view.epoch[view.satellite == sat])
        cuts = np.flatnonzero(np.diff(epochs) > 1) + 1
        color = SYSTEM_COLORS[sat_name(int(sat))[0]]
        for run in np.split(epochs, cuts):
            ax.plot(
                [time[run[0]] - step / 2, time[run[-1]] + step / 2],
                [place, place],
                color=color,
                linewidth=2.6,
                solid_capstyle="butt",
            )
        ticks.append(place)
        labels.append(sat_name(int(sat)))
    every = max(1, -(-len(satellites) // 40))
    if every == 1:
        ax.set_yticks(ticks, labels, fontsize=6)
    else:
        systems = np.array([label[0] for label in labels])
        middle = {
            letter: float(np.mean(np.flatnonzero(systems == letter))) for letter in dict.fromkeys(systems)
        }
        ax.set_yticks(list(middle.values()), [SYSTEM_NAMES[letter] for letter in middle])
        ax.tick_params(axis="y", length=0)
    ax.set_ylim(-1, len(satellites))
    ax.grid(alpha=0.3, axis="x")


def _plot_counts(plan, ax, time):
    """Number of satellites, stacked by system."""
    view = plan.view
    first = np.ones(len(view.satellite), dtype=bool)
    first[1:] = (np.diff(view.satellite) != 0) | (np.diff(view.epoch) != 0)
    letters = np.array([sat_name(int(sat))[0] for sat in view.satellite[first]])
    below = np.zeros(plan.n_epochs)
    for letter in dict.fromkeys(sorted(letters, key="GRECJIS".index)):
        count = np.bincount(view.epoch[first][letters == letter], minlength=plan.n_epochs)
        ax.fill_between(
            time,
            below,
            below + count,
            step="mid",
            color=SYSTEM_COLORS[letter],
            alpha=0.75,
            linewidth=0,
            label=SYSTEM_NAMES[letter],
        )
        below = below + count
    ax.set_ylim(0.0, 1.05 * max(float(below.max()), 1.0))
    ax.set_ylabel("satellites")
    ax.grid(alpha=0.3)
    if len(ax.get_legend_handles_labels()[1]) > 1:
        _legend(ax)


def _plot_angles(ax, time, value_deg, label):
    """Three curves, one for each angle that can be observed."""
    for k, (name, color) in enumerate(ANGLE_COLORS.items()):
        if np.any(np.isfinite(value_deg[:, k])):
            ax.plot(time, value_deg[:, k], color=color, label=name)
    _finish(ax, label, value_deg.T)


def _finish(ax, label, series):
    """Scale from zero; rare peaks may leave the panel at the top."""
    known = np.concatenate([np.asarray(values)[np.isfinite(values)] for values in series])
    if len(known):
        top = min(float(known.max()), 3.0 * float(np.quantile(known, 0.95)))
        ax.set_ylim(0.0, 1.08 * top if top > 0.0 else 1.0)
    ax.set_ylabel(label)
    ax.grid(alpha=0.3)
    if len(ax.get_legend_handles_labels()[1]):
        _legend(ax)


def _legend(ax):
    ax.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)


def _time_axis(ax, plan):
    """Hours of the day; the date once."""
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    locator = AutoDateLocator(maxticks=12)
    ax.xaxis.set_major_locator(locator)
    ax.xaxis.set_major_formatter(ConciseDateFormatter(locator, show_offset=False))
    ax.set_xlabel(f"GPS time, from {format_gpst(plan.time_ns[0], decimals=0).replace('T', ' ')}")
    time = gpst_to_datetime64(plan.time_ns)
    if len(time) > 1:
        ax.set_xlim(time[0], time[-1])
