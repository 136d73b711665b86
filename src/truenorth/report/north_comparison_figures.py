"""Figure of a comparison of ways to find north: errors of each, and what becomes of it with the latitude."""

import numpy as np

from ..evaluation.north_comparison import LATITUDES_DEG

__all__ = ["north_comparison_figure"]

LEAST_SHARE = 0.2
"""Where fewer answers are right, their accuracy says nothing and is not drawn."""

LEAST_DEG = 1e-3
"""Smaller errors lie on the edge of the panel."""

LOOKS = {
    "search-20": ("#56B4E9", "o", "-"),
    "search-76": ("#0072B2", "o", "-"),
    "kalman": ("#009E73", "o", "-"),
    "accelerometer": ("#E69F00", "o", "-"),
    "imu": ("#D55E00", "o", "-"),
    "constrained-20": ("#56B4E9", "s", "--"),
    "constrained-76": ("#0072B2", "s", "--"),
    "array": ("#CC79A7", "s", "--"),
    "accelerometer-ml": ("#E69F00", "s", "--"),
    "inertial": ("#D55E00", "s", "--"),
    "fine": ("#8C3A00", "^", ":"),
    "two-position": ("#000000", "s", "--"),
    "carousel": ("#777777", "^", ":"),
    "navigation": ("#7A5C99", "s", "--"),
}
"""Colour, marker and line: one colour for one kind of hardware, filled and solid for the thesis's own."""

WRONG = "#B00000"


def north_comparison_figure(comparison):
    """One page: the errors of every technique, and its accuracy against latitude.

    Parameters
    ----------
    comparison : truenorth.evaluation.NorthComparison
        What to draw.

    Returns
    -------
    matplotlib.figure.Figure
        Save it with `truenorth.report.files.save_figure`.
    """
    from matplotlib.figure import Figure

    n = len(comparison.results)
    figure = Figure(figsize=(13.0, 2.6 + 0.36 * max(n, 6)), dpi=120, layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    _plot_errors(comparison, left)
    _plot_latitudes(comparison, right)
    scene = comparison.scene
    figure.suptitle(
        f"Ways to find north: a level platform at rest, latitude {scene.latitude_deg:.2f}, heading "
        f"{scene.heading_deg:g} deg, {scene.runs} runs each",
        fontsize="large",
        fontweight="bold",
    )
    return figure


def _plot_errors(comparison, ax):
    """Every error, a line of dots a technique, with its rms and the thesis's number."""
    from matplotlib.lines import Line2D

    results = comparison.results
    scatter = np.random.default_rng(0)
    for row, result in enumerate(results):
        color = LOOKS[result.name][0]
        own = result.answers
        size = np.maximum(np.abs(own.error_deg), LEAST_DEG)
        place = row + scatter.uniform(-0.28, 0.28, len(size))
        right, wrong = own.is_given & ~own.is_wrong, own.is_given & own.is_wrong
        ax.plot(size[right], place[right], ".", color=color, markersize=4.5, alpha=0.55, markeredgewidth=0)
        ax.plot(size[wrong], place[wrong], "x", color=WRONG, markersize=4.0, alpha=0.7)
        rms = own.rms_deg(right_only=True)
        if np.isfinite(rms):
            ax.plot([rms, rms], [row - 0.36, row + 0.36], color="black", linewidth=1.8, zorder=4)
        if result.technique.is_published:
            ax.plot(
                result.technique.published_deg, row, "D", color="white", markeredgecolor="black",
                markeredgewidth=1.3, markersize=7.5, zorder=5,
            )  # fmt: skip
        count = np.count_nonzero(wrong)
        words = [f"{count} wrong"] if count else []
        if not own.is_given.all():
            words.append(f"{np.count_nonzero(~own.is_given)} silent")
        if words:
            ax.text(3000.0, row, ", ".join(words), va="center", ha="right", fontsize="small", color=WRONG)
    published = sum(result.technique.is_published for result in results)
    if 0 < published < len(results):
        ax.axhline(published - 0.5, color="0.5", linewidth=0.8)
        for text, place in (("Oguz's", "bottom"), ("modern", "top")):
            ax.text(
                0.995, published - 0.5, text, transform=ax.get_yaxis_transform(), ha="right", va=place,
                fontsize="x-small", color="0.4",
            )  # fmt: skip
    ax.set_xscale("log")
    ax.set_xlim(LEAST_DEG, 3500.0)
    ax.set_xticks([1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0], ["0.001", "0.01", "0.1", "1", "10", "100"])
    ax.set_ylim(len(results) - 0.5, -0.5)
    ax.set_yticks(range(len(results)), [result.technique.title for result in results])
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel("size of the heading error, deg")
    ax.grid(alpha=0.3, axis="x")
    ax.minorticks_off()
    handles = [
        Line2D([], [], marker=".", linestyle="", color="0.35", label="an answer"),
        Line2D([], [], marker="x", linestyle="", color=WRONG, label="a wrong one"),
        Line2D([], [], marker="|", linestyle="", color="black", markersize=11, markeredgewidth=1.8,
               label="rms, wrong ones left out"),
        Line2D([], [], marker="D", linestyle="", color="white", markeredgecolor="black", markeredgewidth=1.3,
               label="Oguz 2006, table 9"),
    ]  # fmt: skip
    ax.legend(
        handles=handles, fontsize="small", loc="upper center", bbox_to_anchor=(0.35, -0.1), ncols=4,
        frameon=False, columnspacing=1.2, handletextpad=0.3,
    )  # fmt: skip


def _plot_latitudes(comparison, ax):
    """Accuracy at each latitude: rms of the runs, and a line through the mean of the stated sigma."""
    columns = comparison.columns()
    latitude = np.array(LATITUDES_DEG)
    for k, result in enumerate(comparison.results):
        color, marker, line = LOOKS[result.name]
        rms, stated, usable = (
            np.array([columns[f"{name}_at_{at:.0f}"][k] for at in LATITUDES_DEG])
            for name in ("rms_deg", "stated_sd_deg", "usable_share")
        )
        drawn = usable >= LEAST_SHARE
        if not drawn.any():
            continue
        ax.plot(latitude[drawn], stated[drawn], line, color=color, linewidth=1.2)
        face = color if result.technique.is_published else "white"
        ax.plot(
            latitude[drawn], rms[drawn], marker, color=color, markerfacecolor=face, markersize=5.5,
            label=result.technique.title,
        )  # fmt: skip
    ax.set_yscale("log")
    ax.set_xlim(-3.0, 88.0)
    ax.set_xticks(latitude, [f"{value:.0f}" for value in latitude])
    ax.set_ylim(LEAST_DEG, 150.0)
    ax.set_yticks([1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0], ["0.001", "0.01", "0.1", "1", "10", "100"])
    ax.minorticks_off()
    ax.set_xlabel("latitude, deg")
    ax.set_ylabel("marks: rms of the runs; lines: sigma they state, deg")
    ax.grid(alpha=0.3)
    ax.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
