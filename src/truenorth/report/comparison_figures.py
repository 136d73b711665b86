"""Static figures of a comparison: the errors of every angle with their stated bands, and how they spread."""

import numpy as np

from ..errors import Status
from .figures import plot_series, status_handles
from .style import STATUS_COLORS

__all__ = ["comparison_figure", "plot_error", "plot_spread"]


def plot_error(comparison, k, *, ax):
    """Errors of one angle against time, in their stated 3-sigma band.

    Parameters
    ----------
    comparison : Comparison
        Result of `truenorth.evaluation.compare`.
    k : int
        Which angle.
    ax : matplotlib.axes.Axes
        Where to draw.

    Returns
    -------
    matplotlib.axes.Axes
        Degrees; the band lies about zero, where the errors should be; crosses are wrong epochs.
    """
    from ..timescales import gpst_to_datetime64

    error_deg, sd_deg = np.degrees(comparison.error_rad[:, k]), np.degrees(comparison.sd_rad[:, k])
    plot_series(ax, comparison, error_deg, sd_deg, band_about=0.0)
    limit_deg = error_limit_deg(comparison, k)
    ax.set_ylim(-limit_deg, limit_deg)
    wrong = np.flatnonzero(comparison.is_wrong)
    time = gpst_to_datetime64(comparison.time_ns)
    ax.plot(time[wrong], error_deg[wrong], "x", color="#D55E00", markersize=5)
    ax.axhline(0.0, color="black", linewidth=0.6)
    ax.set_ylabel(f"{comparison.angles[k]} error, deg")
    return ax


def error_limit_deg(comparison, k):
    """Scale for the errors of one angle: the largest accepted one and nearly all of the band are inside."""
    accepted = comparison.is_accepted & np.isfinite(comparison.error_rad[:, k])
    if not np.any(accepted):
        return 1.0
    error_deg = np.degrees(np.abs(comparison.error_rad[accepted, k]))
    sd_deg = np.nan_to_num(np.degrees(comparison.sd_rad[accepted, k]))
    return 1.12 * max(float(np.max(error_deg)), 3.0 * float(np.quantile(sd_deg, 0.95)), 1e-4)


def plot_spread(comparison, *, ax):
    """Share of accepted epochs by the size of their error, in standard deviations, beside a normal's.

    Parameters
    ----------
    comparison : Comparison
        Result of `truenorth.evaluation.compare`.
    ax : matplotlib.axes.Axes
        Where to draw.

    Returns
    -------
    matplotlib.axes.Axes
        Errors over stated sigma on the horizontal, share beyond on a logarithmic vertical.
    """
    accepted = comparison.is_accepted
    colors = (STATUS_COLORS[Status.FIXED], "#D55E00", "#009E73")
    size = np.linspace(0.0, 6.0, 121)
    from math import erfc

    ax.plot(size, [erfc(x / np.sqrt(2.0)) for x in size], color="black", linewidth=1.0, label="normal")
    for k, name in enumerate(comparison.angles):
        ratio = np.abs(comparison.error_rad[accepted, k] / comparison.sd_rad[accepted, k])
        ratio = np.sort(ratio[np.isfinite(ratio)])
        if len(ratio):
            share = 1.0 - np.arange(len(ratio)) / len(ratio)
            ax.step(ratio, share, where="post", color=colors[k], linewidth=1.4, label=name)
    ax.set_yscale("log")
    n = max(int(np.count_nonzero(accepted)), 2)
    ax.set_ylim(0.5 / n, 1.5)
    ax.set_xlim(0.0, 6.0)
    ax.set_xlabel("error over stated sigma", fontsize="small")
    ax.set_ylabel("share of epochs beyond")
    ax.grid(alpha=0.3)
    ax.legend(fontsize="small", loc="upper right")
    return ax


def comparison_figure(comparison):
    """One page: errors of every angle, how they spread, and the numbers.

    Parameters
    ----------
    comparison : Comparison
        Result of `truenorth.evaluation.compare`.

    Returns
    -------
    matplotlib.figure.Figure
        Call its ``savefig``.
    """
    from matplotlib.figure import Figure

    n = len(comparison.angles)
    figure = Figure(figsize=(10.0, 3.0 + 2.6 * n), dpi=120, layout="constrained")
    grid = figure.add_gridspec(n + 1, 2, height_ratios=[*[1.0] * n, 1.15], width_ratios=(1.0, 1.1))
    first = None
    for k in range(n):
        ax = figure.add_subplot(grid[k, :], sharex=first)
        plot_error(comparison, k, ax=ax)
        if k < n - 1:
            ax.set_xlabel("")
            ax.tick_params(labelbottom=False)
        first = first or ax
    plot_spread(comparison, ax=figure.add_subplot(grid[n, 0]))
    _write_numbers(comparison, figure.add_subplot(grid[n, 1]))
    first.legend(
        handles=status_handles(comparison, band="stated 3 sigma"),
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=5,
        fontsize="small",
        frameon=False,
    )
    figure.suptitle("Errors against the reference", fontsize="large", fontweight="bold")
    return figure


def _write_numbers(comparison, ax):
    """The numbers of the comparison as text."""
    ax.axis("off")
    c = comparison.consistency
    lines = [
        f"available   {100.0 * comparison.availability:.1f} % of {comparison.expected_epochs} epochs",
        f"outage      {comparison.longest_outage_s:g} s at most",
        f"wrong       {np.count_nonzero(comparison.is_wrong)} beyond {comparison.wrong_sd:g} sigma"
        + (f" or {comparison.wrong_deg:g} deg" if comparison.wrong_deg else ""),
        f"NEES        {c.nees:.2f} per angle, {c.lower:.2f} to {c.upper:.2f}",
        f"            expected: {c.verdict}",
        "",
        f"{'deg':<10}{'rms':>8}{'68 %':>8}{'95 %':>8}{'99 %':>8}{'max':>8}",
    ]
    for name, e in comparison.statistics["accepted"].items():
        lines.append(f"{name:<10}{e.rms:8.3f}{e.p68:8.3f}{e.p95:8.3f}{e.p99:8.3f}{e.max:8.3f}")
    ax.text(0.0, 0.95, "\n".join(lines), family="monospace", fontsize="small", va="top")
