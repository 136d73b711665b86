"""The interactive page of an attitude: verdict, angles with their bands, and what they rest on."""

import html

import numpy as np

from ..export import summarize_solution
from ..timescales import gpst_to_datetime64
from .page import (
    assemble_page,
    draw_azimuth,
    draw_series,
    figures_html,
    provenance_html,
    table_html,
)
from .style import caption, thin_epochs

__all__ = ["attitude_html", "draw_support"]


def attitude_html(solution):
    """The attitude as one HTML page with interactive figures.

    Parameters
    ----------
    solution : AttitudeSolution
        Result of `truenorth.attitude.solve_array`.

    Returns
    -------
    str
        HTML text that needs nothing else.
    """
    import plotly.graph_objects as go

    summary, subtitle = summarize_solution(solution), caption(solution)
    whole = solution
    solution, step = thin_epochs(solution, keep=np.any(solution.is_excluded, axis=1))
    subtitle += f"; one epoch in {step} is drawn" if step > 1 else ""
    time = gpst_to_datetime64(solution.time_ns)
    figures = [
        (
            "Heading",
            draw_azimuth(go, solution, time, solution.heading_rad, solution.angle_sd_rad(0), "heading, deg"),
        )
    ]
    for k, name in ((1, "pitch"), (2, "roll")):
        angle_deg = np.degrees(getattr(solution, f"{name}_rad"))
        sd_deg = np.degrees(solution.angle_sd_rad(k))
        figures.append(
            (name.capitalize(), draw_series(go, solution, time, angle_deg, sd_deg, f"{name}, deg"))
        )
    figures.append(("Satellites and antennas", draw_support(go, solution, time)))
    sections = [
        _verdict(solution, summary),
        figures_html(figures),
        _events(whole),
        provenance_html(solution, summary),
    ]
    return assemble_page("Attitude of the platform", subtitle, sections)


def draw_support(go, solution, time):
    """Draw satellites and antennas used over time, and the epochs in which an antenna was left out."""
    figure = go.Figure()
    for name, values, axis, color in (
        ("satellites used", solution.n_sats, "y", "#000000"),
        ("antennas used", solution.n_antennas_used, "y2", "#D55E00"),
    ):
        figure.add_trace(
            go.Scatter(
                x=time,
                y=values,
                yaxis=axis,
                mode="lines",
                line={"shape": "hvh", "color": color, "width": 1.5},
                name=name,
            )
        )
    rows = np.flatnonzero(np.any(solution.is_excluded, axis=1))
    if len(rows):
        figure.add_trace(
            go.Scatter(
                x=time[rows],
                y=solution.n_antennas_used[rows],
                yaxis="y2",
                mode="markers",
                marker={"symbol": "x-thin-open", "size": 6, "color": "#CC79A7"},
                name="an antenna left out",
                text=solution.excluded[rows],
                hovertemplate="%{x}<br>%{text} left out",
            )
        )
    figure.update_layout(
        height=300,
        yaxis={"title": "satellites used", "rangemode": "tozero"},
        yaxis2={
            "title": "antennas used",
            "overlaying": "y",
            "side": "right",
            "range": [0, 1.6 * len(solution.antennas)],
            "tickvals": list(range(len(solution.antennas) + 1)),
            "showgrid": False,
        },
        xaxis_title="GPS time",
    )
    return figure


def _verdict(solution, summary):
    """The table that answers what a reader asks first."""
    counts = ", ".join(f"{count} {name}" for name, count in summary["epochs_by_status"].items() if count)
    share = 100.0 * summary["accepted_fraction"]
    rows = [
        (
            "Accepted",
            f"{share:.1f} % of {summary['epochs']} epochs ({counts or 'none'})",
            "bad" if share == 0 else "",
        )
    ]
    for name in ("heading", "pitch", "roll"):
        stated = summary[f"{name}_deg"]["stated_sd"]
        text = "none" if stated is None else f"stated sigma {stated:.3f}° (root mean square over the run)"
        rows.append((name.capitalize(), text, ""))
    for name, entry in summary["antennas"].items():
        text = f"{entry['length_m']:.3f} m from the first, used in {100.0 * entry['used_fraction']:.1f} %"
        if entry["excluded_epochs"]:
            text += f", left out in {entry['excluded_epochs']} epochs"
        rows.append((f"Antenna {name}", text, ""))
    for name, entry in summary["reasons"].items():
        rows.append(("Not whole", f"{entry['epochs']} epochs, {name}: {entry['sentence']}", ""))
    rows += [("Warning", text, "bad") for text in summary["warnings"]]
    return "<h2>Verdict</h2>\n" + table_html(rows)


def _events(solution, limit=200):
    """What happened, the first events of many."""
    from ..timescales import format_gpst

    if not solution.events:
        return ""
    lines = [f"{format_gpst(event.time_ns)}  {event.text}" for event in solution.events[:limit]]
    if len(solution.events) > limit:
        lines.append(f"... and {len(solution.events) - limit} more")
    return "<h2>Events</h2>\n<pre>" + html.escape("\n".join(lines)) + "</pre>"
