"""Figure of Allan deviations: each axis with its confidence, the fitted noises, and what each slope means."""

import numpy as np

from ..constants import DPH_RADPS, UG_MPS2

__all__ = ["allan_figure"]

_AXIS_COLORS = ("#0072B2", "#D55E00", "#009E73")

_UNITS = {
    "gyro": ("deg/h", DPH_RADPS),
    "accelerometer": ("ug", UG_MPS2),
}

_SLOPES = {
    "quantisation": "slope -1",
    "random_walk": "slope -1/2",
    "bias_instability": "slope 0",
    "bias_walk": "slope +1/2",
    "drift": "slope +1",
}


def allan_figure(result, *, title=None):
    """One page: gyros at the left, accelerometers at the right, on logarithmic axes.

    Parameters
    ----------
    result : truenorth.sensors.allan.AllanResult
        What to draw.
    title : str, optional
        What comes first in the headline, e.g. the name of the log.

    Returns
    -------
    matplotlib.figure.Figure
        Call its ``savefig``.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 6.6), dpi=120, layout="constrained")
    panels = figure.subplots(1, 2)
    for ax, kind, together in zip(
        panels, ("gyro", "accelerometer"), (result.gyro, result.accelerometer), strict=True
    ):
        _plot_kind(result, ax, kind, together)
    figure.suptitle(
        f"{f'{title}: ' if title else ''}Allan deviation of {result.duration_s:.0f} s at "
        f"{1.0 / result.interval_s:g} Hz",
        fontsize="large",
        fontweight="bold",
    )
    return figure


def _plot_kind(result, ax, kind, together):
    """Three axes of one kind of sensor."""
    from matplotlib.ticker import FuncFormatter

    unit, factor = _UNITS[kind]
    axes = [axis for axis in result.axes if axis.kind == kind]
    for axis, color in zip(axes, _AXIS_COLORS, strict=True):
        low, high = axis.interval()
        ax.fill_between(axis.tau_s, low / factor, high / factor, color=color, alpha=0.2, linewidth=0)
        ax.plot(axis.tau_s, axis.deviation / factor, color=color, linewidth=1.4, label=axis.name)
        if np.any(axis.affected):
            ax.plot(
                axis.tau_s[axis.affected],
                axis.deviation[axis.affected] / factor,
                "o",
                color=color,
                markersize=3.5,
                markerfacecolor="white",
            )
        if axis.levelled_tau_s is not None:
            ax.plot(
                axis.levelled_tau_s,
                axis.levelled_deviation / factor,
                color=color,
                linestyle=(0, (5, 1.5)),
                linewidth=1.1,
            )
    values = np.concatenate([axis.deviation for axis in axes]) / factor
    values = np.concatenate(
        [values, *(a.levelled_deviation / factor for a in axes if a.levelled_deviation is not None)]
    )
    ax.set_xscale("log")
    ax.set_yscale("log")
    tau_s = together.tau_s
    ax.set_xlim(tau_s[0] * 0.8, tau_s[-1] * 1.25)
    ax.set_ylim(0.35 * values[values > 0.0].min(), 2.5 * values.max())
    _plot_terms(ax, together, factor)
    plain = FuncFormatter(lambda value, _: f"{value:g}")
    ax.xaxis.set_major_formatter(plain)
    ax.yaxis.set_major_formatter(plain)
    ax.set_xlabel("averaging time, s")
    ax.set_ylabel(unit)
    ax.set_title(f"{kind}s", loc="left", fontsize="medium", fontweight="bold")
    ax.grid(alpha=0.3)
    ax.grid(alpha=0.12, which="minor")
    _legend(ax, axes, together)


def _plot_terms(ax, together, factor):
    """The fitted sum, and each noise in it as a line of its slope with its coefficient."""
    if np.any(np.isfinite(together.fitted)):
        ax.plot(together.tau_s, together.fitted / factor, color="black", linewidth=1.2, linestyle="--")
    low, high = ax.get_ylim()
    for term in together.terms.values():
        line = term.deviation(together.tau_s) / factor
        seen = (line > low) & (line < high)
        if not term.is_determined or np.count_nonzero(seen) < 2:
            continue
        ax.plot(together.tau_s, line, color="0.45", linewidth=0.8, linestyle=":")


def _legend(ax, axes, together):
    """Axes, what the marks mean, and the coefficients of the three together."""
    from matplotlib.lines import Line2D

    handles = list(ax.get_legend_handles_labels()[0])
    if np.any(np.isfinite(together.fitted)):
        handles.append(Line2D([], [], color="black", linestyle="--", linewidth=1.2, label="fit of all three"))
        handles.append(Line2D([], [], color="0.45", linestyle=":", linewidth=0.8, label="one noise of it"))
    if any(np.any(axis.affected) for axis in axes):
        handles.append(
            Line2D([], [], color="0.3", marker="o", markerfacecolor="white", label="more than noise")
        )
    if any(axis.levelled_tau_s is not None for axis in axes):
        name = "modified Allan" if together.kind == "gyro" else "Hadamard"
        handles.append(
            Line2D([], [], color="0.3", linestyle="--", label=f"without the platform's turn ({name})")
        )
    ax.legend(handles=handles, fontsize="small", loc="best", framealpha=0.95)
    lines = [
        f"{term.name.replace('_', ' ')} ({_SLOPES[term.name]}): {term} {term.unit}"
        for term in together.terms.values()
        if term.is_determined or term.name in ("random_walk", "bias_instability", "bias_walk")
    ]
    ax.text(
        0.02,
        0.02,
        "\n".join(["together", *lines]),
        transform=ax.transAxes,
        fontsize="small",
        va="bottom",
        bbox={"facecolor": "white", "alpha": 0.85, "edgecolor": "0.8"},
    )
