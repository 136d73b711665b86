"""Figures of plans: the sky over a day, what an array makes of it, sweeps, and rates compared."""

import numpy as np

from ..constants import SYSTEM_NAMES
from ..observations import sat_name
from ..timescales import format_gpst, gpst_to_datetime64
from .style import SYSTEM_COLORS

__all__ = [
    "ANGLE_COLORS",
    "placement_figure",
    "plan_figure",
    "rates_figure",
    "sweep_figure",
]

ANGLE_COLORS = {"heading": "#0072B2", "pitch": "#D55E00", "roll": "#009E73"}
"""Of the same palette as everything else."""


MOST_NAMED = 40
"""Satellites that are named one by one; of more only the systems are."""


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
    # Few enough satellites are named, which takes more room.
    sky_height = float(np.clip((0.1 if n_satellites <= MOST_NAMED else 0.055) * n_satellites, 1.2, 5.0))
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
    if len(satellites) <= MOST_NAMED:
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


def sweep_figure(sweeps):
    """One panel a sweep: standard deviations of the angles on logarithmic scales.

    Parameters
    ----------
    sweeps : sequence of truenorth.planning.Sweep
        What to draw, side by side.

    Returns
    -------
    matplotlib.figure.Figure
        Call its ``savefig``.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.ticker import FuncFormatter

    figure = Figure(figsize=(max(6.4, 5.2 * len(sweeps)), 5.0), dpi=120, layout="constrained")
    axes = figure.subplots(1, len(sweeps), sharey=True, squeeze=False)[0]
    plain = FuncFormatter(lambda value, _: f"{value:g}")
    methods = list(dict.fromkeys(method for sweep in sweeps for method in sweep.curves_deg))
    for ax, sweep in zip(axes, sweeps, strict=True):
        for method, curve in sweep.curves_deg.items():
            for k, color in enumerate(ANGLE_COLORS.values()):
                # Where curves coincide, the wider one below shows on both sides of the other.
                if method == methods[0]:
                    ax.plot(sweep.x, curve[:, k], "-", color=color, linewidth=(3.4, 2.2, 1.2)[k])
                else:
                    size = (8.0, 5.5, 3.0)[k]
                    ax.plot(sweep.x, curve[:, k], "o", color=color, markersize=size, markerfacecolor="none")
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.xaxis.set_major_formatter(plain)
        ax.yaxis.set_major_formatter(plain)
        ax.set_xlabel(sweep.label)
        ax.set_title(sweep.title.replace(", ", ",\n", 1), fontsize="medium")
        ax.grid(alpha=0.3, which="both")
    axes[0].set_ylabel("sigma, deg")
    handles = [Line2D([], [], color=color, label=name) for name, color in ANGLE_COLORS.items()]
    handles += [
        Line2D(
            [],
            [],
            color="0.3",
            linestyle="-" if k == 0 else "",
            marker="o" if k else "",
            markerfacecolor="none",
            label=method,
        )
        for k, method in enumerate(methods)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    return figure


def placement_figure(plan, placement):
    """One page: where one more antenna helps, seen from above; with height; and the angles before and after.

    Parameters
    ----------
    plan : truenorth.planning.Plan
        The array without it.
    placement : truenorth.planning.Placement
        The candidates.

    Returns
    -------
    matplotlib.figure.Figure
        Call its ``savefig``.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 4.6), dpi=120, layout="constrained")
    above, beside, after = figure.subplots(1, 3, width_ratios=(1.25, 1.0, 1.0))
    point = placement.point_body_m
    antennas = np.array(plan.settings.antennas)
    good = np.isfinite(placement.value_deg)
    what = "root of summed variances" if placement.criterion == "trace" else f"{placement.criterion} sigma"
    # Of the candidates above one another the best, which comes first.
    _, first = np.unique(point[good][:, :2].round(6), axis=0, return_index=True)
    order = np.flatnonzero(good)[first]
    shown = above.scatter(
        point[order, 1],
        point[order, 0],
        c=placement.value_deg[order],
        cmap="viridis_r",
        s=float(np.clip(9000.0 / len(order), 6.0, 90.0)),
        marker="s",
        linewidths=0,
    )
    above.plot(antennas[:, 1], antennas[:, 0], "^", color="black", markersize=9, label="array")
    best = placement.best_body_m
    above.plot(best[1], best[0], "*", color="#D55E00", markersize=16, label="best")
    above.set_aspect("equal", adjustable="datalim")
    above.set_xlabel("right, m")
    above.set_ylabel("forward, m")
    above.legend(fontsize="small", loc="upper center", bbox_to_anchor=(0.5, 1.12), ncols=2, frameon=False)
    figure.colorbar(shown, ax=above, label=f"{what} at the best height, deg")
    heights = np.unique(-point[good, 2])
    least = [placement.value_deg[good][-point[good, 2] == height].min() for height in heights]
    beside.plot(least, heights, ".-", color="#0072B2")
    beside.set_xlabel(f"least {what}, deg")
    beside.set_ylabel("height above the origin, m")
    if len(heights) == 1:
        beside.set_ylim(heights[0] - 1.0, heights[0] + 1.0)
    beside.grid(alpha=0.3)
    in_plane = np.flatnonzero(placement.is_in_plane)
    cases = [("without", placement.before_deg, "0.6")]
    if len(in_plane) and in_plane[0] != 0:
        cases.append(("best in plane", placement.sd_deg[in_plane[0]], "#56B4E9"))
    cases.append(("best", placement.sd_deg[0], "#D55E00"))
    width = 0.8 / len(cases)
    for k, (label, values, color) in enumerate(cases):
        place = np.arange(3) + (k - 0.5 * (len(cases) - 1)) * width
        after.bar(place, np.nan_to_num(values), width=0.92 * width, color=color, label=label)
        for x, value in zip(place, values, strict=True):
            word = f"{value:.2g}" if np.isfinite(value) else "none"
            after.annotate(
                word, (x, value if np.isfinite(value) else 0.0), ha="center", va="bottom", fontsize="x-small"
            )
    after.set_xticks(range(3), list(ANGLE_COLORS))
    after.set_ylabel("sigma, deg")
    after.margins(y=0.12)
    after.grid(alpha=0.3, axis="y")
    after.legend(fontsize="small", loc="upper center", bbox_to_anchor=(0.5, 1.12), ncols=3, frameon=False)
    figure.suptitle(
        f"One more antenna for the least {what} ({placement.at} epoch)", fontsize="large", fontweight="bold"
    )
    return figure


def rates_figure(study):
    """One page: satellites, status at each rate, errors where there is a reference, and time to re-fix.

    Parameters
    ----------
    study : truenorth.evaluation.RateStudy
        Result of `truenorth.evaluation.compare_rates`.

    Returns
    -------
    matplotlib.figure.Figure
        Call its ``savefig``.
    """
    from matplotlib.figure import Figure

    start_ns = int(study.time_ns[0])
    angles = study.results[0].comparison.angles if study.results[0].comparison is not None else ()
    heights = [1.3, 0.5 + 0.32 * len(study.results), 1.3, *[1.5] * len(angles)]
    if study.obstructions:
        heights.append(1.6)
    figure = Figure(figsize=(10.0, sum(heights) + 2.2), dpi=120, layout="constrained")
    grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
    top = figure.add_subplot(grid[0])
    _plot_common(study, top, start_ns)
    strips = figure.add_subplot(grid[1], sharex=top)
    _plot_strips(study, strips, start_ns)
    dop = figure.add_subplot(grid[2], sharex=top)
    colors = _rate_colors(study)
    order = np.argsort([-result.rate_hz for result in study.results])
    for k in order:
        result = study.results[k]
        time_s = (result.solution.time_ns - start_ns) * 1e-9
        dop.plot(time_s, result.pdop, ".", markersize=2.0, color=colors[k], label=f"{result.rate_hz:g} Hz")
    _finish(dop, "PDOP", [result.pdop for result in study.results])
    last = dop
    for row, angle in enumerate(angles):
        last = figure.add_subplot(grid[3 + row], sharex=top)
        _plot_errors(study, last, start_ns, row, colors, order)
        last.set_ylabel(f"{angle}\nerror, deg")
    for ax in figure.axes:
        ax.tick_params(labelbottom=ax is last)
        for item in study.obstructions:
            ax.axvspan(
                (item.start_ns - start_ns) * 1e-9,
                (item.end_ns - start_ns) * 1e-9,
                color="0.85",
                linewidth=0,
                zorder=0,
            )
    last.set_xlabel(f"seconds from {format_gpst(start_ns, decimals=0).replace('T', ' ')} GPST")
    top.set_xlim(0.0, (study.time_ns[-1] - start_ns) * 1e-9)
    if study.obstructions:
        _plot_refix(study, figure.add_subplot(grid[-1]), colors)
    figure.suptitle(
        f"One recording of {study.recorded_hz:g} Hz at "
        + ", ".join(f"{result.rate_hz:g}" for result in study.results)
        + " Hz: same satellites, same obstructions",
        fontsize="large",
        fontweight="bold",
    )
    return figure


_RATE_PALETTE = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")


def _rate_colors(study):
    return [_RATE_PALETTE[k % len(_RATE_PALETTE)] for k in range(len(study.results))]


def _plot_common(study, ax, start_ns):
    """Satellites that all antennas have, and the least that it takes."""
    time_s = (study.time_ns - start_ns) * 1e-9
    ax.step(time_s, study.n_common, where="post", color="0.25", linewidth=1.0)
    ax.axhline(4, color="#D55E00", linewidth=0.8, linestyle="--")
    ax.set_ylim(0.0, 1.1 * max(float(study.n_common.max()), 4.0))
    ax.set_ylabel("satellites\nin common")
    ax.grid(alpha=0.3)


def _plot_strips(study, ax, start_ns):
    """Status of every epoch, one strip a rate."""
    from matplotlib.patches import Patch

    from ..errors import Status
    from .style import STATUS_COLORS

    for place, result in enumerate(study.results):
        step_s = 1.0 / result.rate_hz
        time_s = (result.solution.time_ns - start_ns) * 1e-9
        cut = np.flatnonzero((np.diff(result.solution.status) != 0) | (np.diff(time_s) > 1.5 * step_s)) + 1
        for run in np.split(np.arange(len(time_s)), cut):
            status = Status(int(result.solution.status[run[0]]))
            ax.barh(
                place,
                time_s[run[-1]] - time_s[run[0]] + step_s,
                left=time_s[run[0]],
                height=0.7,
                color=STATUS_COLORS[status],
                linewidth=0,
            )
    ax.set_yticks(range(len(study.results)), [f"{result.rate_hz:g} Hz" for result in study.results])
    ax.set_ylim(len(study.results) - 0.4, -0.6)
    ax.legend(
        handles=[Patch(color=color, label=status.label) for status, color in STATUS_COLORS.items()],
        fontsize="small",
        loc="center left",
        bbox_to_anchor=(1.0, 0.5),
        frameon=False,
    )


def _plot_errors(study, ax, start_ns, k, colors, order):
    """Errors of the accepted epochs, the fastest rate at the back."""
    largest = []
    for number in order:
        comparison = study.results[number].comparison
        good = comparison.is_accepted
        error_deg = np.degrees(comparison.error_rad[good, k])
        time_s = (comparison.time_ns[good] - start_ns) * 1e-9
        size = 1.5 + 2.5 * float(
            np.searchsorted([-study.results[j].rate_hz for j in order], -study.results[number].rate_hz)
        ) / max(len(order) - 1, 1)
        ax.plot(time_s, error_deg, ".", markersize=size, color=colors[number])
        largest.append(np.quantile(np.abs(error_deg), 0.998) if len(error_deg) else 0.0)
    limit = 1.25 * max(largest) if max(largest) > 0.0 else 1.0
    ax.set_ylim(-limit, limit)
    ax.axhline(0.0, color="black", linewidth=0.6)
    ax.grid(alpha=0.3)


def _plot_refix(study, ax, colors):
    """Time to re-fix after each obstruction, a bar a rate; a cross where none came."""
    n = len(study.results)
    width = 0.8 / n
    for k, result in enumerate(study.results):
        place = np.arange(len(study.obstructions)) + (k - 0.5 * (n - 1)) * width
        ax.bar(
            place,
            np.nan_to_num(result.refix_s),
            width=0.92 * width,
            color=colors[k],
            label=f"{result.rate_hz:g} Hz",
        )
        never = np.isnan(result.refix_s)
        ax.plot(place[never], np.zeros(never.sum()), "x", color=colors[k])
        for x, value in zip(place[~never], result.refix_s[~never], strict=True):
            if len(study.obstructions) * n <= 24:
                ax.annotate(f"{value:.2g}", (x, value), ha="center", va="bottom", fontsize="x-small")
    start_ns = int(study.time_ns[0])
    labels = [
        f"{(item.start_ns - start_ns) * 1e-9:.0f} s\n({item.duration_s:.1f} s)" for item in study.obstructions
    ]
    ax.set_xticks(range(len(labels)), labels, fontsize="small")
    ax.margins(y=0.2)
    ax.set_ylim(bottom=0.0)
    ax.set_ylabel("time to\nre-fix, s")
    ax.set_xlabel("obstruction at (and for)")
    ax.grid(alpha=0.3, axis="y")
    _legend(ax)
