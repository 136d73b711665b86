"""Static figures of an attitude: heading, pitch and roll with their bands, and what they rest on."""

import textwrap

import numpy as np

from ..timescales import gpst_to_datetime64
from .figures import new_axes, plot_azimuth, plot_series, status_handles, time_axis
from .style import caption

__all__ = ["attitude_figure", "plot_angle", "plot_support"]

_ANGLES = ("heading", "pitch", "roll")


def plot_angle(solution, name, *, ax=None):
    """One angle of the attitude against time, with its 3-sigma band, coloured by status.

    Parameters
    ----------
    solution : AttitudeSolution
        Result of `truenorth.attitude.solve_array`.
    name : {"heading", "pitch", "roll"}
        Which.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.axes.Axes
        Degrees.
    """
    ax = new_axes(ax)
    angle_rad, sd_rad = getattr(solution, f"{name}_rad"), solution.angle_sd_rad(_ANGLES.index(name))
    if name == "heading":
        plot_azimuth(ax, solution, angle_rad, sd_rad)
    else:
        plot_series(ax, solution, np.degrees(angle_rad), np.degrees(sd_rad))
    ax.set_ylabel(f"{name}, deg")
    return ax


def plot_support(solution, *, ax=None):
    """Satellites and antennas that the attitude rests on, against time.

    Parameters
    ----------
    solution : AttitudeSolution
        Result of `truenorth.attitude.solve_array`.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.axes.Axes
        Satellites on the left, of the baseline with fewest; antennas on the right.
    """
    ax = new_axes(ax)
    time = gpst_to_datetime64(solution.time_ns)
    ax.step(time, solution.n_sats, where="mid", color="black", linewidth=1.0, label="satellites")
    ax.set_ylim(0, max(4, int(np.max(solution.n_sats, initial=0))) * 1.35)
    ax.yaxis.get_major_locator().set_params(integer=True)
    ax.set_ylabel("satellites used")
    right = ax.twinx()
    right.step(
        time, solution.n_antennas_used, where="mid", color="#D55E00", linewidth=1.0, label="antennas used"
    )
    left_out = np.any(solution.is_excluded, axis=1)
    right.plot(
        time[left_out],
        solution.n_antennas_used[left_out],
        "x",
        color="#CC79A7",
        markersize=4,
        label="an antenna left out",
    )
    right.set_ylim(0, 1.6 * len(solution.antennas))
    right.set_yticks(range(len(solution.antennas) + 1))
    right.set_ylabel("antennas used")
    handles = [*ax.get_lines(), *(line for line in right.get_lines() if len(line.get_xdata()))]
    ax.legend(
        handles, [line.get_label() for line in handles], loc="upper center", ncols=3, fontsize="x-small"
    )
    ax.grid(alpha=0.3)
    time_axis(ax, solution)
    return ax


def attitude_figure(solution):
    """One page: heading, pitch, roll, satellites and antennas.

    Parameters
    ----------
    solution : AttitudeSolution
        Result of `truenorth.attitude.solve_array`.

    Returns
    -------
    matplotlib.figure.Figure
        Call its ``savefig``.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 11.0), dpi=120, layout="constrained")
    panels = figure.subplots(4, 1, sharex=True, gridspec_kw={"height_ratios": (1.3, 1.0, 1.0, 0.9)})
    for name, ax in zip(_ANGLES, panels, strict=False):
        plot_angle(solution, name, ax=ax)
        ax.set_xlabel("")
    plot_support(solution, ax=panels[3])
    panels[0].legend(
        handles=status_handles(solution),
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=5,
        fontsize="small",
        frameon=False,
    )
    figure.align_ylabels(panels)
    figure.suptitle("Attitude of the platform", fontsize="large", fontweight="bold")
    figure.supxlabel(textwrap.fill(caption(solution), 110), fontsize="small")
    return figure
