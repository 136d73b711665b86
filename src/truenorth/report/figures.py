"""Static figures of a result, with matplotlib and without its global state.

Every function draws into the axes given, or into a new figure, and returns the axes. Nothing is
ever shown or saved here.
"""

import textwrap

import numpy as np

from ..attitude.array_solution import AttitudeSolution
from ..attitude.solution import BaselineSolution
from ..constants import SYSTEM_NAMES, SYSTEMS
from ..errors import Status
from ..evaluation import Comparison
from ..observations import sat_name
from ..timescales import format_gpst, gpst_to_datetime64
from .style import (
    BAND_ALPHA,
    STATUS_COLORS,
    SYSTEM_COLORS,
    accepted_rows,
    azimuth_for_plot,
    caption,
    length_for_plot,
    runs_of_epochs,
    thin_rows,
)

__all__ = [
    "figure_page",
    "new_axes",
    "plot_azimuth",
    "plot_elevation",
    "plot_heading",
    "plot_length_residual",
    "plot_residuals",
    "plot_satellites_dop",
    "plot_series",
    "plot_sky",
    "status_handles",
    "time_axis",
]

_MAX_POINTS = 60_000
"""Residuals drawn at most; more would only make the file large."""


def plot_heading(solution, *, ax=None):
    """Azimuth of the baseline against time, with its 3-sigma band, coloured by status.

    Parameters
    ----------
    solution : BaselineSolution
        Result of `truenorth.solve_baseline`.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.axes.Axes
        Degrees; the line is broken where the azimuth passes north on a whole circle, and where
        there is no solution.
    """
    ax = new_axes(ax)
    plot_azimuth(ax, solution, solution.azimuth_rad, solution.azimuth_sd_rad)
    ax.set_ylabel("azimuth, deg")
    return ax


def plot_azimuth(ax, solution, azimuth_rad, sd_rad):
    """Draw an angle of the whole circle into axes, on a scale that is not broken where it need not be."""
    azimuth_deg, is_whole_circle = azimuth_for_plot(solution, azimuth_rad)
    plot_series(ax, solution, azimuth_deg, np.degrees(sd_rad), jump=180.0)
    if is_whole_circle:
        ax.set_ylim(0.0, 360.0)
        ax.set_yticks(np.arange(0.0, 361.0, 90.0))
    else:
        low, high = ax.get_ylim()
        if low < 0.0 or high > 360.0:
            ax.yaxis.set_major_formatter(lambda value, _: f"{value % 360.0:g}")


def plot_elevation(solution, *, ax=None):
    """Elevation of the baseline against time; arguments as `plot_heading`.

    Parameters
    ----------
    solution : BaselineSolution
        Result of `truenorth.solve_baseline`.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.axes.Axes
        Degrees.
    """
    ax = new_axes(ax)
    plot_series(ax, solution, np.degrees(solution.elevation_rad), np.degrees(solution.elevation_sd_rad))
    ax.set_ylabel("elevation, deg")
    return ax


def plot_length_residual(solution, *, ax=None):
    """Measured length less the declared one (or its median), with its 3-sigma band.

    Parameters
    ----------
    solution : BaselineSolution
        Result of `truenorth.solve_baseline`.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.axes.Axes
        Millimetres; dotted lines are three standard deviations of the declared length. Without a
        declared one, a length that varies by more than a metre is drawn itself, in metres.
    """
    ax = new_axes(ax)
    value, sd, label = length_for_plot(solution)
    plot_series(ax, solution, value, sd)
    if label.endswith("mm"):
        ax.axhline(0.0, color="black", linewidth=0.8)
    if "declared" in label and solution.settings.get("length_sd_m"):
        for side in (-3.0, 3.0):
            limit_mm = side * 1e3 * solution.settings["length_sd_m"]
            ax.axhline(limit_mm, color="black", linewidth=0.8, linestyle=":")
    ax.set_ylabel(label)
    return ax


def plot_residuals(solution, *, ax=None):
    """Phase residuals by satellite: in each column time runs from left to right.

    Parameters
    ----------
    solution : BaselineSolution
        Result of `truenorth.solve_baseline`.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.axes.Axes
        Millimetres; the black bar of a satellite is its root mean square.
    """
    ax = new_axes(ax)
    ax.set_ylabel("phase residual, mm")
    rows = accepted_rows(solution)
    sats, column = np.unique(solution.residual_sat[rows], return_inverse=True)
    if len(sats) == 0:
        _say_empty(ax, "no residuals of accepted epochs")
        return ax
    residual_mm = 1e3 * solution.residual_m[rows]
    position = column - 0.4 + 0.8 * (solution.residual_epoch[rows] + 0.5) / solution.n_epochs
    system = sats[column] // 100
    drawn = thin_rows(len(rows), _MAX_POINTS)
    for code in np.unique(system):
        of_system = drawn[system[drawn] == code]
        letter = SYSTEMS[code]
        ax.plot(
            position[of_system],
            residual_mm[of_system],
            ".",
            markersize=1.5,
            color=SYSTEM_COLORS[letter],
            label=SYSTEM_NAMES[letter],
            rasterized=True,
        )
    rms_mm = np.sqrt(np.bincount(column, residual_mm**2) / np.bincount(column))
    ax.vlines(range(len(sats)), -rms_mm, rms_mm, color="black", linewidth=2.0)
    ax.axhline(0.0, color="black", linewidth=0.5)
    ax.set_xlim(-0.6, len(sats) - 0.4)
    ax.set_xticks(range(len(sats)), [sat_name(int(sat)) for sat in sats], rotation=90, fontsize="small")
    ax.grid(axis="y", alpha=0.3)
    ax.legend(loc="upper right", ncols=4, fontsize="small", markerscale=5.0)
    return ax


def plot_sky(solution, *, ax=None):
    """Where the satellites used stood, north up, horizon at the rim.

    Parameters
    ----------
    solution : BaselineSolution
        Result of `truenorth.solve_baseline`.
    ax : matplotlib.projections.polar.PolarAxes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.projections.polar.PolarAxes
        Radius is 90 degrees less the elevation.
    """
    ax = new_axes(ax, projection="polar")
    ax.set_theta_zero_location("N")
    ax.set_theta_direction(-1)
    ax.set_rlim(0.0, 90.0)
    ax.set_rgrids([30.0, 60.0, 90.0], ["60°", "30°", ""], fontsize="x-small", angle=22.5)
    ax.set_thetagrids(range(0, 360, 45), ["N", "", "E", "", "S", "", "W", ""])
    known = accepted_rows(solution)
    for sat in np.unique(solution.residual_sat[known]):
        rows = known[solution.residual_sat[known] == sat]
        rows = rows[thin_rows(len(rows), 400)]
        color = SYSTEM_COLORS[SYSTEMS[sat // 100]]
        zenith_deg = 90.0 - np.degrees(solution.residual_elevation_rad[rows])
        azimuth_rad = solution.residual_azimuth_rad[rows]
        ax.plot(azimuth_rad, zenith_deg, ".", markersize=2.0, color=color)
        ax.plot(azimuth_rad[-1:], zenith_deg[-1:], "o", markersize=5.0, color=color)
        ax.annotate(
            sat_name(int(sat)),
            (azimuth_rad[-1], zenith_deg[-1]),
            xytext=(4, 3),
            textcoords="offset points",
            fontsize="x-small",
            color=color,
        )
    if len(known) == 0:
        _say_empty(ax, "no satellites of accepted epochs")
    return ax


def plot_satellites_dop(solution, *, ax=None):
    """Satellites used, and dilution of position, azimuth and elevation, against time.

    Parameters
    ----------
    solution : BaselineSolution
        Result of `truenorth.solve_baseline`.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.axes.Axes
        Satellites on the left; the dilutions have their own axis on the right.
    """
    ax = new_axes(ax)
    time = gpst_to_datetime64(solution.time_ns)
    ax.step(time, solution.n_sats, where="mid", color="black", linewidth=1.2, label="satellites")
    ax.set_ylim(0, max(4, int(np.max(solution.n_sats, initial=0))) * 1.35)
    ax.set_ylabel("satellites used")
    ax.yaxis.get_major_locator().set_params(integer=True)
    right = ax.twinx()
    for name, label, color in (
        ("pdop", "position", "#D55E00"),
        ("azimuth_dop", "azimuth", "#0072B2"),
        ("elevation_dop", "elevation", "#009E73"),
    ):
        right.plot(time, getattr(solution, name), color=color, linewidth=1.0, label=f"{label} DOP")
    _limit_dop(right, solution)
    right.set_ylabel("dilution of precision")
    handles = [*ax.get_lines(), *right.get_lines()]
    ax.legend(
        handles, [line.get_label() for line in handles], loc="upper center", ncols=4, fontsize="x-small"
    )
    time_axis(ax, solution)
    return ax


def figure_page(solution):
    """One page: heading, elevation, length, residuals by satellite, sky, satellites and dilution.

    Parameters
    ----------
    solution : BaselineSolution, AttitudeSolution or Comparison
        Of an attitude: heading, pitch, roll and what they rest on; of a comparison with a reference: the
        errors.

    Returns
    -------
    matplotlib.figure.Figure
        Call its ``savefig``.
    """
    if isinstance(solution, AttitudeSolution):
        from .attitude_figures import attitude_figure

        return attitude_figure(solution)
    if isinstance(solution, Comparison):
        from .comparison_figures import comparison_figure

        return comparison_figure(solution)
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 13.0), dpi=120, layout="constrained")
    grid = figure.add_gridspec(5, 2, height_ratios=(1.25, 1.0, 1.0, 1.1, 1.6), width_ratios=(1.0, 1.25))
    heading = figure.add_subplot(grid[0, :])
    elevation = figure.add_subplot(grid[1, :], sharex=heading)
    plot_heading(solution, ax=heading)
    plot_elevation(solution, ax=elevation)
    plot_length_residual(solution, ax=figure.add_subplot(grid[2, :], sharex=heading))
    for ax in (heading, elevation):
        ax.set_xlabel("")
        ax.tick_params(labelbottom=False)
    plot_residuals(solution, ax=figure.add_subplot(grid[3, :]))
    plot_sky(solution, ax=figure.add_subplot(grid[4, 0], projection="polar"))
    plot_satellites_dop(solution, ax=figure.add_subplot(grid[4, 1]))
    heading.legend(
        handles=status_handles(solution),
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=5,
        fontsize="small",
        frameon=False,
    )
    figure.suptitle("Direction of the baseline", fontsize="large", fontweight="bold")
    figure.supxlabel(textwrap.fill(caption(solution), 110), fontsize="small")
    return figure


def new_axes(ax, **options):
    """The axes given, or new ones in a figure that no global state knows."""
    if ax is not None:
        return ax
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 5.0), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    return figure.add_subplot(**options)


def plot_series(ax, solution, value, sd, *, jump=np.inf, band_about=None):
    """Draw a value with its 3-sigma band over time, by status; gaps and jumps break both.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        Where to draw.
    solution : BaselineSolution, AttitudeSolution or Comparison
        Whose epochs these are.
    value, sd : ndarray, shape (n,)
        What to draw and its standard deviation.
    jump : float
        Neighbours further apart are not joined.
    band_about : float, optional
        The band lies about this instead of about the values.
    """
    time = gpst_to_datetime64(solution.time_ns)
    accepted = solution.is_accepted & np.isfinite(value)
    for piece in runs_of_epochs(solution.time_ns, np.where(accepted, value, np.nan), jump=jump):
        middle = value[piece] if band_about is None else band_about
        band = (middle - 3.0 * sd[piece], middle + 3.0 * sd[piece])
        if len(piece) == 1:
            # A band has no width here.
            ax.vlines(time[piece], *band, color=STATUS_COLORS[Status.FIXED], alpha=BAND_ALPHA, linewidth=1.5)
            continue
        ax.fill_between(time[piece], *band, color=STATUS_COLORS[Status.FIXED], alpha=BAND_ALPHA, linewidth=0)
        ax.plot(time[piece], value[piece], color=STATUS_COLORS[Status.FIXED], linewidth=0.6, alpha=0.6)
    for status in (Status.FLOAT, Status.HELD, Status.FIXED):
        rows = np.flatnonzero((solution.status == status) & np.isfinite(value))
        ax.plot(time[rows], value[rows], ".", markersize=3.0, color=STATUS_COLORS[status], label=status.label)
    _limit_to_accepted(ax, value, sd if band_about is None else 0.0 * sd, accepted)
    absent = time[solution.status == Status.NONE]
    if len(absent):
        ax.plot(
            absent,
            np.full(len(absent), 0.02),
            "|",
            color=STATUS_COLORS[Status.NONE],
            transform=ax.get_xaxis_transform(),
            label=Status.NONE.label,
        )
    ax.grid(alpha=0.3)
    time_axis(ax, solution)


def _limit_to_accepted(ax, value, sd, accepted):
    """Let the accepted epochs set the scale, so that wild float ones do not; say what is outside."""
    if not np.any(accepted):
        return
    low = np.min((value - 3.0 * np.nan_to_num(sd))[accepted])
    high = np.max((value + 3.0 * np.nan_to_num(sd))[accepted])
    margin = max(0.15 * (high - low), 1e-3)
    low, high = low - margin, high + margin
    ax.set_ylim(low, high)
    outside = int(np.count_nonzero(np.isfinite(value) & ((value < low) | (value > high))))
    if outside:
        ax.text(
            0.995,
            0.97,
            f"{outside} float epochs outside the scale",
            transform=ax.transAxes,
            ha="right",
            va="top",
            fontsize="x-small",
            color=STATUS_COLORS[Status.FLOAT],
        )


def _limit_dop(ax, solution):
    dilutions = np.concatenate([solution.pdop, solution.azimuth_dop, solution.elevation_dop])
    dilutions = dilutions[np.isfinite(dilutions)]
    # A few epochs of poor geometry would flatten all the others.
    ax.set_ylim(0.0, 1.45 * np.quantile(dilutions, 0.99) if len(dilutions) else 1.0)


def time_axis(ax, solution):
    """Label the time axis of epochs."""
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    locator = AutoDateLocator(minticks=3, maxticks=8)
    ax.xaxis.set_major_locator(locator)
    ax.xaxis.set_major_formatter(ConciseDateFormatter(locator, show_offset=False))
    if solution.n_epochs:
        first, last = gpst_to_datetime64(solution.time_ns[[0, -1]])
        margin = max((last - first) // 40, np.timedelta64(500, "ms"))
        ax.set_xlim(first - margin, last + margin)
        ax.set_xlabel(f"GPS time, {format_gpst(solution.time_ns[0], decimals=0)[:10]}", fontsize="small")


def _say_empty(ax, text):
    ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", va="center", color="gray")


def status_handles(solution, *, band="3 sigma of accepted"):
    """Legend entries: every status with its count, and the band."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles = []
    for status in sorted(Status, reverse=True):
        count = int(np.count_nonzero(solution.status == status))
        if count == 0 and not isinstance(solution, BaselineSolution):
            continue  # An attitude is never float.
        marker = "|" if status == Status.NONE else "o"
        label = f"{status.label} ({count})"
        handles.append(
            Line2D(
                [], [], linestyle="", marker=marker, markersize=5, color=STATUS_COLORS[status], label=label
            )
        )
    handles.append(Patch(color=STATUS_COLORS[Status.FIXED], alpha=BAND_ALPHA, label=band))
    return handles
