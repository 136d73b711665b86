"""Figure of a search for north: how the estimate settled, and where its error comes from."""

import numpy as np

from ..errors import ConfigError
from .files import STATIC_SUFFIXES, save_figure
from .north_text import sigma_word
from .planning_figures import ANGLE_COLORS

__all__ = ["STATIC_SUFFIXES", "north_figure", "save_figure"]

_SETTLED = 0.1
"""The scale is set by what comes after this share of the run; the first seconds say little."""


def north_figure(solution, *, title=None):
    """One page: heading, pitch and roll as they settled, their sigma, and the error budget by source.

    Parameters
    ----------
    solution : truenorth.northfinding.solution.NorthSolution
        The result, with a run or a budget.
    title : str, optional
        What comes before the method in the headline, e.g. the name of the log.

    Returns
    -------
    matplotlib.figure.Figure
        Call its ``savefig``.

    Raises
    ------
    ConfigError
        If there is neither a run nor a budget to draw.
    """
    from matplotlib.figure import Figure

    run, budget = solution.run, solution.budget
    drawn = None if run is None else np.flatnonzero(np.all(np.isfinite(run.angles_rad), axis=1))
    if drawn is not None and len(drawn) < 2:
        drawn = None
    if drawn is None and budget is None:
        raise ConfigError(
            "there is nothing to draw: the result has neither a running estimate nor an error budget; ask "
            "for a running estimate or state the errors of the sensor",
            key="figure",
        )
    heights = []
    if drawn is not None:
        heights.append(5.2)
    if budget is not None:
        heights.append(1.1 + 0.3 * (len(budget.lines) + 1))
    figure = Figure(figsize=(11.0, sum(heights) + 1.3), dpi=120, layout="constrained")
    parts = np.atleast_1d(figure.subfigures(len(heights), 1, height_ratios=heights))
    if drawn is not None:
        _plot_run(solution, parts[0], drawn)
    if budget is not None:
        _plot_budget(solution, parts[-1])
    _headline(solution, figure, title)
    return figure


def _plot_run(solution, part, drawn):
    """Angles with bands of one and three sigma at the left, all sigmas at the right."""
    grid = part.add_gridspec(3, 2, height_ratios=(1.8, 1.0, 1.0), width_ratios=(1.5, 1.0))
    time_s = solution.run.time_s[drawn]
    final = np.degrees(solution.angles_rad)
    top = None
    for k, (name, color) in enumerate(ANGLE_COLORS.items()):
        ax = part.add_subplot(grid[k, 0], sharex=top)
        top = top or ax
        shift = np.degrees(solution.run.angles_rad[drawn, k]) - final[k]
        if name != "pitch":
            shift = (shift + 180.0) % 360.0 - 180.0
        sd = np.degrees(solution.run.sd_rad[drawn, k])
        value = final[k] + shift
        for times, alpha in ((3.0, 0.13), (1.0, 0.25)):
            ax.fill_between(
                time_s, value - times * sd, value + times * sd, color=color, alpha=alpha, linewidth=0
            )
        ax.plot(time_s, value, color=color, linewidth=1.3)
        ax.axhline(final[k], color="black", linewidth=0.6, linestyle="--")
        ax.set_ylim(*_limits(time_s, value, sd, final[k]))
        ax.set_ylabel(f"{name}, deg")
        _label_angles(ax, name == "heading")
        ax.grid(alpha=0.3)
        ax.tick_params(labelbottom=k == 2)
    top.set_xlim(0.0, time_s[-1])
    top.set_title("attitude at each instant from all data until then, with 1 and 3 sigma", fontsize="medium")
    ax.set_xlabel("seconds of data")
    beside = part.add_subplot(grid[:, 1])
    _plot_sigmas(solution, beside, drawn)


def _limits(time_s, value, sd, final):
    """Scale that shows what is settled, with room for the band at the end; the start leaves the panel."""
    late = time_s >= time_s[0] + _SETTLED * (time_s[-1] - time_s[0])
    known = sd[late][np.isfinite(sd[late])]
    usual, last = (float(np.median(known)), float(known[-1])) if len(known) else (0.0, 0.0)
    low = max(min(value[late].min() - usual, final - 4.0 * last), final - 180.0)
    high = min(max(value[late].max() + usual, final + 4.0 * last), final + 180.0)
    margin = 0.08 * (high - low) or 1e-6
    return low - margin, high + margin


def _label_angles(ax, wraps):
    """Plain degrees, a heading within the full turn."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    locator = MaxNLocator(nbins=6 if wraps else 4)
    ax.yaxis.set_major_locator(locator)
    low, high = ax.get_ylim()
    ticks = locator.tick_values(low, high)
    decimals = int(np.clip(np.ceil(-np.log10(np.diff(ticks)[0]) - 1e-9), 0, 7))
    if not np.allclose(np.round(ticks, decimals), ticks, atol=1e-3 * np.diff(ticks)[0]):
        decimals += 1

    def word(value, _):
        shown = round(value, decimals)
        return f"{shown % 360.0 if wraps else shown + 0.0:.{decimals}f}"

    ax.yaxis.set_major_formatter(FuncFormatter(word))


def _plot_sigmas(solution, ax, drawn):
    """How sigma falls; both axes logarithmic, so that a power of time is a straight line."""
    from matplotlib.ticker import FuncFormatter

    time_s = solution.run.time_s[drawn]
    positive = time_s > 0.0
    lowest = []
    for k, (name, color) in enumerate(ANGLE_COLORS.items()):
        sd = np.degrees(solution.run.sd_rad[drawn, k])
        good = positive & np.isfinite(sd) & (sd > 0.0)
        if np.any(good):
            # Pitch and roll often coincide: the wider one below shows on both sides of the other.
            width = (1.5, 3.2, 1.3)[k]
            ax.plot(time_s[good], np.minimum(sd[good], 360.0), color=color, label=name, linewidth=width)
            lowest.append(sd[good].min())
    verdict = solution.verdict
    if verdict is not None and np.isfinite(verdict.required_heading_sd_rad):
        ax.axhline(
            np.degrees(verdict.required_heading_sd_rad),
            color=ANGLE_COLORS["heading"],
            linestyle="--",
            linewidth=1.0,
            label="heading asked for",
        )
    if verdict is not None and solution.budget is not None and np.isfinite(verdict.achievable_heading_sd_rad):
        ax.axhline(
            np.degrees(verdict.achievable_heading_sd_rad),
            color=ANGLE_COLORS["heading"],
            linestyle=":",
            linewidth=1.2,
            label="heading, by the budget",
        )
    ax.set_xscale("log")
    ax.set_yscale("log")
    plain = FuncFormatter(lambda value, _: f"{value:g}")
    ax.xaxis.set_major_formatter(plain)
    ax.yaxis.set_major_formatter(plain)
    if lowest:
        ax.set_ylim(bottom=0.6 * min(lowest))
    ax.set_title("sigma, deg", fontsize="medium")
    ax.set_xlabel("seconds of data")
    ax.grid(alpha=0.3)
    ax.grid(alpha=0.12, which="minor")
    ax.legend(fontsize="small", loc="best", framealpha=0.95)


def _plot_budget(solution, part):
    """Bars by source: of the heading in one panel, of the small angles in another."""
    budget = solution.budget
    names = [f"{line.source}, {line.stated}" if line.stated else line.source for line in budget.lines]
    names.append("total")
    sd = np.degrees([*(budget.angle_sd_rad(line) for line in budget.lines), budget.angle_sd_rad()])
    place = np.arange(len(names))
    heading, level = part.subplots(1, 2, sharey=True, width_ratios=(1.5, 1.0))
    unit, factor = _scale(heading, sd[:, :1], "error budget: heading sigma")
    _bars(heading, place, factor * sd[:, 0], ANGLE_COLORS["heading"], 0.7)
    _, level_factor = _scale(level, sd[:, 1:], "pitch and roll sigma")
    for k, name, shift in ((1, "pitch", -0.2), (2, "roll", 0.2)):
        _bars(level, place + shift, level_factor * sd[:, k], ANGLE_COLORS[name], 0.36, label=name)
    for ax in (heading, level):
        ax.grid(alpha=0.3, axis="x")
        ax.set_axisbelow(True)
        ax.axhline(place[-1] - 0.5, color="0.4", linewidth=0.8)
        ax.tick_params(axis="y", length=0)
    heading.set_yticks(place, names)
    heading.get_yticklabels()[-1].set_fontweight("bold")
    heading.set_ylim(place[-1] + 0.55, -0.55)
    verdict = solution.verdict
    if verdict is not None and np.isfinite(verdict.required_heading_sd_rad):
        wanted = np.degrees(verdict.required_heading_sd_rad)
        if factor * wanted < heading.get_xlim()[1]:
            heading.axvline(
                factor * wanted,
                color="black",
                linestyle="--",
                linewidth=1.0,
                label=f"{factor * wanted:.3g} {unit} asked for",
            )
            _legend_above(heading)
    _legend_above(level)


def _scale(ax, sd_deg, title):
    """Axis from zero in degrees, or in minutes of arc where all is below a tenth of a degree."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    largest = float(np.max(sd_deg[np.isfinite(sd_deg)], initial=0.0)) or 1.0
    unit, factor = ("deg", 1.0) if largest >= 0.1 else ("arcmin", 60.0)
    ax.set_xlim(0.0, 1.2 * factor * largest)
    ax.xaxis.set_major_locator(MaxNLocator(nbins=6))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.set_xlabel(unit)
    ax.set_title(title, fontsize="medium", loc="left")
    return unit, factor


def _legend_above(ax):
    """Where it hides no bar."""
    ax.legend(
        fontsize="small",
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=2,
        frameon=False,
        borderaxespad=0.1,
    )


def _bars(ax, place, value, color, height, label=None):
    """Bars with their numbers; an infinite one fills the panel, what is nothing beside the rest is pale."""
    finite = np.isfinite(value)
    full = ax.get_xlim()[1] / 1.1
    ax.barh(place, np.where(finite, value, full), height=height, color=color, alpha=0.85, label=label)
    for y, x in zip(place, value, strict=True):
        nothing = x < 1e-5 * full
        ax.annotate(
            "0" if nothing else sigma_word(x),
            (x if np.isfinite(x) else full, y),
            xytext=(3, 0) if np.isfinite(x) else (-3, 0),
            textcoords="offset points",
            va="center",
            ha="left" if np.isfinite(x) else "right",
            color="0.6" if nothing else "black",
            fontsize="small" if height > 0.5 else "x-small",
            bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 0.5},
        )


def _headline(solution, figure, title):
    """Method, place, result, and whether the sensor can do it."""
    site = solution.site
    north = np.degrees(site.latitude_rad)
    heading, sd = np.degrees(solution.heading_rad), np.degrees(solution.angle_sd_rad[0])
    decimals = 2
    if np.isfinite(sd) and sd > 0.0:
        decimals = int(np.clip(1 - np.floor(np.log10(sd)), 2, 5))
    lines = [
        f"{f'{title}: ' if title else ''}heading {round(heading, decimals) % 360.0:.{decimals}f}° "
        f"± {sigma_word(sd)}° (1 sigma)",
        f"{solution.method}, {solution.duration_s:g} s at latitude "
        f"{abs(north):.3f}° {'N' if north >= 0.0 else 'S'}",
    ]
    verdict = solution.verdict
    if verdict is not None:
        asked = f"{np.degrees(verdict.required_heading_sd_rad):.3g}"
        able = {
            True: f"{asked}° asked for: the sensor can do it",
            False: f"{asked}° asked for: the sensor cannot do it",
            None: f"{asked}° asked for: open, its errors are not stated",
        }
        lines[1] += f"; {able[verdict.able]}"
    figure.suptitle("\n".join(lines), fontsize="large", fontweight="bold")
