"""The interactive page of a result: one HTML file that needs nothing else.

The verdict comes first, then the figures, then where everything came from.
"""

import html

import numpy as np

from ..attitude.array_solution import AttitudeSolution
from ..constants import SYSTEM_NAMES
from ..errors import REASON_SENTENCES, Reason, Status
from ..evaluation import Comparison
from ..export import summarize_solution
from ..observations import sat_name, signal_name
from ..timescales import gpst_to_datetime64
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
from .text import length_sentence

__all__ = ["page_html"]

_MAX_POINTS = 30_000

_MAX_SVG_EPOCHS = 10_000
"""Longer runs are drawn by WebGL, of which browsers allow few canvases on a page."""

STYLE = """
body {
  font: 15px/1.45 system-ui, sans-serif; color: #222;
  max-width: 1100px; margin: 2em auto; padding: 0 1em;
}
h1 { font-size: 1.5em; margin-bottom: 0; }
h2 { font-size: 1.15em; margin: 1.6em 0 0.4em; }
table { border-collapse: collapse; }
td, th { padding: 0.25em 0.9em 0.25em 0; text-align: left; vertical-align: top; }
tr + tr td, tr + tr th { border-top: 1px solid #ddd; }
th { font-weight: 600; white-space: nowrap; }
.caption { color: #555; }
.bad { color: #b00020; font-weight: 600; }
pre { font-size: 0.85em; overflow-x: auto; background: #f6f6f6; padding: 0.8em; }
"""


def page_html(solution):
    """The whole result as one HTML page with interactive figures.

    Parameters
    ----------
    solution : BaselineSolution, AttitudeSolution or Comparison
        Result of `truenorth.solve_session`, or its comparison with a reference.

    Returns
    -------
    str
        HTML text; the plotting library is inside, so that it opens without a network.
    """
    if isinstance(solution, AttitudeSolution):
        from .attitude_page import attitude_html

        return attitude_html(solution)
    if isinstance(solution, Comparison):
        from .comparison_page import comparison_html

        return comparison_html(solution)
    summary = summarize_solution(solution)
    sections = [
        _verdict(summary),
        _figures(solution),
        provenance_html(solution, summary),
    ]
    return assemble_page("Direction of the baseline", caption(solution), sections)


def assemble_page(title, subtitle, sections):
    """Put sections of HTML under a title into one page."""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f'<h1>{html.escape(title)}</h1>\n<p class="caption">{html.escape(subtitle)}</p>\n'
        + "\n".join(sections)
        + "\n</body>\n</html>\n"
    )


def _verdict(summary):
    """The table that answers what a reader asks first."""
    counts = ", ".join(f"{count} {name}" for name, count in summary["epochs_by_status"].items() if count)
    check = summary["length_check"]
    length_class = "bad" if check["verdict"] == "disagrees" else ""
    share = 100.0 * summary["accepted_fraction"]
    rows = [
        (
            "Accepted",
            f"{share:.1f} % of {summary['epochs']} epochs ({counts or 'none'})",
            "bad" if share == 0 else "",
        ),
        ("Azimuth", _quantity(summary["azimuth_deg"], "°", 3), ""),
        ("Elevation", _quantity(summary["elevation_deg"], "°", 3), ""),
        ("Length", _quantity(summary["length_m"], " m", 4), ""),
        ("Declared length", length_sentence(check), length_class),
    ]
    for name, entry in summary["reasons"].items():
        rows.append(("Not accepted", f"{entry['epochs']} epochs, {name}: {entry['sentence']}", ""))
    rows += [("Warning", text, "bad") for text in summary["warnings"]]
    return "<h2>Verdict</h2>\n" + table_html(rows)


def _figures(solution):
    """The figures, one under another."""
    import plotly.graph_objects as go

    time = gpst_to_datetime64(solution.time_ns)
    heading = draw_azimuth(go, solution, time, solution.azimuth_rad, solution.azimuth_sd_rad, "azimuth, deg")
    figures = [
        ("Heading", heading),
        (
            "Elevation",
            draw_series(
                go,
                solution,
                time,
                np.degrees(solution.elevation_rad),
                np.degrees(solution.elevation_sd_rad),
                "elevation, deg",
            ),
        ),
        ("Length", draw_series(go, solution, time, *length_for_plot(solution))),
        ("Phase residuals by satellite", _residuals(go, solution, time)),
        ("Sky", _sky(go, solution)),
        ("Satellites and dilution of precision", _satellites_dop(go, solution, time)),
    ]
    return figures_html(figures)


def figures_html(figures):
    """Plotly figures under their titles, (title, figure) pairs; the first brings the library along."""
    parts = []
    for k, (title, figure) in enumerate(figures):
        figure.update_layout(
            template="plotly_white",
            margin={"l": 60, "r": 60, "t": 30, "b": 40},
            legend={"orientation": "h", "y": 1.02, "yanchor": "bottom"},
        )
        body = figure.to_html(
            full_html=False, include_plotlyjs=k == 0, config={"displaylogo": False, "responsive": True}
        )
        parts.append(f"<h2>{html.escape(title)}</h2>\n{body}")
    return "\n".join(parts)


def draw_series(go, solution, time, value, sd, label, *, wrap=False, band_about=None):
    """Draw a value over time by status, with the 3-sigma band of the accepted epochs.

    The band lies about the values, or about `band_about` where one is given. Epochs without reason codes
    (those of a comparison) are not explained.
    """
    figure = go.Figure()
    scatter = go.Scatter if solution.n_epochs <= _MAX_SVG_EPOCHS else go.Scattergl
    accepted = solution.is_accepted & np.isfinite(value)
    jump = 180.0 if wrap else np.inf
    middle = value if band_about is None else np.full(len(value), band_about)
    figure.add_traces(draw_band(go, solution.time_ns, time, middle, sd, accepted, jump))
    shown = value % 360.0 if wrap else value
    for status in (Status.FLOAT, Status.HELD, Status.FIXED):
        rows = np.flatnonzero((solution.status == status) & np.isfinite(value))
        if len(rows) == 0:
            continue
        sentences = _sentences(solution, rows)
        figure.add_trace(
            scatter(
                x=time[rows],
                y=value[rows],
                mode="markers",
                marker={"size": 4, "color": STATUS_COLORS[status]},
                name=f"{status.label} ({len(rows)})",
                customdata=np.stack([shown[rows], sd[rows], np.array(sentences, dtype=object)], axis=1),
                hovertemplate="%{x}<br>%{customdata[0]:.4f}, sd %{customdata[1]:.4f}<br>%{customdata[2]}",
            )
        )
    absent = np.flatnonzero(solution.status == Status.NONE)
    if len(absent):
        figure.add_trace(
            scatter(
                x=time[absent],
                y=np.full(len(absent), 0.02),
                yaxis="y2",
                mode="markers",
                marker={"size": 6, "symbol": "line-ns-open", "color": STATUS_COLORS[Status.NONE]},
                name=f"none ({len(absent)})",
                text=_sentences(solution, absent),
                hovertemplate="%{x}<br>%{text}",
            )
        )
        figure.update_layout(yaxis2={"overlaying": "y", "range": [0, 1], "visible": False})
    if np.any(accepted) and band_about is None:
        # As in the static figure, the accepted epochs set the scale.
        low = float(np.min((value - 3.0 * np.nan_to_num(sd))[accepted]))
        high = float(np.max((value + 3.0 * np.nan_to_num(sd))[accepted]))
        margin = max(0.15 * (high - low), 1e-3)
        figure.update_layout(yaxis={"range": [low - margin, high + margin]})
    figure.update_layout(height=330, yaxis_title=label, xaxis_title="GPS time")
    return figure


def _sentences(solution, rows):
    """Why epochs are what they are."""
    if not hasattr(solution, "reason"):
        return [""] * len(rows)
    return [REASON_SENTENCES[Reason(int(code))] for code in solution.reason[rows]]


def draw_azimuth(go, solution, time, azimuth_rad, sd_rad, label):
    """Draw an angle of the whole circle over time, on a scale that is not broken where it need not be."""
    azimuth_deg, is_whole_circle = azimuth_for_plot(solution, azimuth_rad)
    figure = draw_series(go, solution, time, azimuth_deg, np.degrees(sd_rad), label, wrap=True)
    if is_whole_circle:
        figure.update_layout(yaxis={"range": [0, 360], "dtick": 90})
    else:
        label_across_north(figure)
    return figure


def label_across_north(figure):
    """Label an azimuth axis that runs below 0 or above 360 by the azimuths themselves."""
    if figure.layout.yaxis.range is None:
        return
    low, high = figure.layout.yaxis.range
    if low >= 0.0 and high <= 360.0:
        return
    decade = 10.0 ** np.floor(np.log10(high - low))
    step = next(decade * part for part in (0.1, 0.2, 0.5, 1.0, 2.0) if (high - low) / (decade * part) <= 7.0)
    ticks = step * np.arange(np.ceil(low / step), np.floor(high / step) + 1.0)
    figure.update_layout(yaxis={"tickvals": ticks, "ticktext": [f"{tick % 360.0:g}" for tick in ticks]})


def draw_band(go, time_ns, time, value, sd, accepted, jump):
    """Make the 3-sigma band as closed outlines, one for each run of epochs without gap or jump."""
    traces = []
    red, green, blue = (int(STATUS_COLORS[Status.FIXED][k : k + 2], 16) for k in (1, 3, 5))
    color = f"rgba({red},{green},{blue},{BAND_ALPHA})"
    for piece in runs_of_epochs(time_ns, np.where(accepted, value, np.nan), jump=jump):
        upper, lower = value[piece] + 3.0 * sd[piece], value[piece] - 3.0 * sd[piece]
        traces.append(
            go.Scatter(
                x=np.concatenate([time[piece], time[piece][::-1]]),
                y=np.concatenate([upper, lower[::-1]]),
                fill="toself",
                mode="lines",
                # The outline shows single epochs between gaps, where a band has no width.
                line={"width": 1.5 if len(piece) == 1 else 0, "color": color},
                fillcolor=color,
                hoverinfo="skip",
                name="3 sigma of accepted",
                legendgroup="band",
                showlegend=not traces,
            )
        )
    return traces


def _residuals(go, solution, time):
    """Phase residuals, one colour for each system, a legend entry for each satellite."""
    figure = go.Figure()
    known = accepted_rows(solution)
    sats = np.unique(solution.residual_sat[known])
    drawn = known[thin_rows(len(known), _MAX_POINTS)]
    for k, sat in enumerate(sats):
        rows = drawn[solution.residual_sat[drawn] == sat]
        name = sat_name(int(sat))
        epochs = solution.residual_epoch[rows]
        figure.add_trace(
            go.Scattergl(
                x=k - 0.4 + 0.8 * (epochs + 0.5) / solution.n_epochs,
                y=1e3 * solution.residual_m[rows],
                mode="markers",
                marker={"size": 2.5, "color": SYSTEM_COLORS[name[0]]},
                name=name,
                customdata=np.stack(
                    [
                        np.datetime_as_string(time[epochs], unit="s").astype(object),
                        np.array(
                            [signal_name(int(code)) for code in solution.residual_signal[rows]], dtype=object
                        ),
                        np.degrees(solution.residual_elevation_rad[rows]).astype(object),
                    ],
                    axis=1,
                ),
                hovertemplate=name
                + " %{customdata[1]}<br>%{customdata[0]}<br>%{y:.1f} mm at %{customdata[2]:.0f}° elevation",
                showlegend=False,
            )
        )
    figure.update_layout(
        height=380,
        yaxis_title="phase residual, mm",
        xaxis={"tickvals": list(range(len(sats))), "ticktext": [sat_name(int(sat)) for sat in sats]},
    )
    return figure


def _sky(go, solution):
    """Where the satellites stood."""
    figure = go.Figure()
    known = accepted_rows(solution)
    for sat in np.unique(solution.residual_sat[known]):
        rows = known[solution.residual_sat[known] == sat]
        rows = rows[thin_rows(len(rows), 200)]
        name = sat_name(int(sat))
        figure.add_trace(
            go.Scatterpolar(
                r=90.0 - np.degrees(solution.residual_elevation_rad[rows]),
                theta=np.degrees(solution.residual_azimuth_rad[rows]) % 360.0,
                mode="lines+markers+text",
                text=[""] * (len(rows) - 1) + [name],
                textposition="top right",
                line={"color": SYSTEM_COLORS[name[0]], "width": 2},
                marker={"size": [0] * (len(rows) - 1) + [8], "opacity": 1, "line": {"width": 0}},
                name=f"{name} ({SYSTEM_NAMES[name[0]]})",
                hovertemplate=name + "<br>azimuth %{theta:.1f}°, %{r:.1f}° from the zenith",
                showlegend=False,
            )
        )
    figure.update_layout(
        height=540,
        polar={
            "angularaxis": {
                "direction": "clockwise",
                "rotation": 90,
                "tickvals": [0, 90, 180, 270],
                "ticktext": list("NESW"),
            },
            "radialaxis": {"range": [0, 90], "tickvals": [30, 60], "ticktext": ["60°", "30°"]},
        },
    )
    return figure


def _satellites_dop(go, solution, time):
    """Satellites used and dilutions over time."""
    figure = go.Figure()
    figure.add_trace(
        go.Scatter(
            x=time,
            y=solution.n_sats,
            mode="lines",
            line={"shape": "hvh", "color": "#000000"},
            name="satellites used",
        )
    )
    for name, label, color in (
        ("pdop", "position DOP", "#D55E00"),
        ("azimuth_dop", "azimuth DOP", "#0072B2"),
        ("elevation_dop", "elevation DOP", "#009E73"),
    ):
        figure.add_trace(
            go.Scatter(
                x=time,
                y=getattr(solution, name),
                yaxis="y2",
                mode="lines",
                line={"color": color, "width": 1.5},
                name=label,
            )
        )
    figure.update_layout(
        height=330,
        yaxis={"title": "satellites used", "rangemode": "tozero"},
        yaxis2={
            "title": "dilution of precision",
            "overlaying": "y",
            "side": "right",
            "rangemode": "tozero",
            "showgrid": False,
            "tickformat": ".2~f",
        },
        xaxis_title="GPS time",
    )
    return figure


def provenance_html(solution, summary):
    """Write version, inputs, settings, running time."""
    import json

    seconds = ", ".join(f"{name} {value:.2f} s" for name, value in summary["seconds"].items())
    rows = [("Program", f"TrueNorth {summary['version']}", ""), ("Running time", seconds, "")]
    settings = json.dumps(solution.settings, indent=2, default=str)
    inputs = json.dumps(summary["inputs"], indent=2)
    return (
        f"<h2>Provenance</h2>\n{table_html(rows)}\n"
        f"<h2>Inputs</h2>\n<pre>{html.escape(inputs)}</pre>\n"
        f"<h2>Settings</h2>\n<pre>{html.escape(settings)}</pre>"
    )


def table_html(rows):
    """Write rows of (name, text, class) as a table."""
    lines = [
        f'<tr><th>{html.escape(name)}</th><td class="{style}">{html.escape(text)}</td></tr>'
        for name, text, style in rows
    ]
    return "<table>\n" + "\n".join(lines) + "\n</table>"


def _quantity(entry, unit, digits):
    if entry["mean"] is None:
        return "none"
    stated = "" if entry["stated_sd"] is None else f", stated {entry['stated_sd']:.{digits}f}{unit}"
    return f"{entry['mean']:.{digits}f}{unit}, scatter {entry['sd']:.{digits}f}{unit}{stated}"
