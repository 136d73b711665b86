"""The interactive page of a solution beside its reference: verdict, map, angles, errors and their causes."""

import html

import numpy as np

from ..errors import Status
from ..timescales import gpst_to_datetime64
from .attitude_page import draw_support
from .comparison_figures import error_limit_deg
from .page import (
    assemble_page,
    draw_azimuth,
    draw_series,
    figures_html,
    provenance_html,
    table_html,
)
from .style import STATUS_COLORS, thin_epochs, thin_rows

__all__ = ["comparison_html"]

_CARDS_STYLE = """
<style>
.cards {
  display: grid; grid-template-columns: repeat(auto-fit, minmax(190px, 1fr)); gap: 0.8em; margin: 1.2em 0;
}
.card { border: 1px solid #ddd; border-left: 5px solid #009E73; border-radius: 4px; padding: 0.6em 0.9em; }
.card.warn { border-left-color: #E69F00; }
.card.alarm { border-left-color: #b00020; }
.card b { display: block; font-size: 1.7em; font-weight: 600; line-height: 1.2; }
.card span { color: #555; font-size: 0.9em; }
</style>
"""


def comparison_html(comparison, *, solution=None, title=None, subtitle="", rows=(), places=()):
    """The comparison as one HTML page with interactive figures.

    Parameters
    ----------
    comparison : Comparison
        Result of `truenorth.evaluation.compare`.
    solution : AttitudeSolution, optional
        What was compared: adds satellites and antennas over time, and settings.
    title, subtitle : str, optional
        Above the page.
    rows : sequence of (str, str)
        Further lines of the verdict.
    places : sequence of (time_ns, str)
        What to mark on the map, with the time at which the platform was there.

    Returns
    -------
    str
        HTML text that needs nothing else.
    """
    import plotly.graph_objects as go

    sections = [_cards(comparison), _numbers(comparison, rows)]
    spread = _spread(go, comparison)
    comparison, step = thin_epochs(comparison, keep=comparison.is_wrong)
    if step > 1:
        subtitle += f"{'; ' if subtitle else ''}one epoch in {step} is drawn, and all wrong ones"
    time = gpst_to_datetime64(comparison.time_ns)
    figures = []
    if comparison.latitude_deg is not None:
        figures.append(("Track", _track(go, comparison, time, places)))
    figures.append((comparison.angles[0].capitalize(), _heading(go, comparison, time)))
    for k, name in enumerate(comparison.angles):
        figures.append((f"Error of the {name}", _errors(go, comparison, time, k)))
    if solution is not None:
        drawn, _ = thin_epochs(solution, keep=np.any(solution.is_excluded, axis=1))
        own = gpst_to_datetime64(drawn.time_ns)
        figures.append(("Satellites and antennas", draw_support(go, drawn, own)))
    figures.append(("Errors against the stated sigma", spread))
    sections.append(figures_html(figures))
    if solution is not None:
        from ..export import summarize_solution

        sections.append(provenance_html(solution, summarize_solution(solution)))
    return assemble_page(title or "Errors against the reference", subtitle, sections)


def _cards(comparison):
    """The four numbers that decide."""
    first = comparison.angles[0]
    heading = comparison.statistics["accepted"][first]
    wrong = int(np.count_nonzero(comparison.is_wrong))
    c = comparison.consistency
    cards = [
        (
            f"{100.0 * comparison.availability:.1f} %",
            f"of {comparison.expected_epochs} epochs have "
            + ("an attitude" if first == "heading" else "a direction"),
            "" if comparison.availability > 0.9 else "warn" if comparison.availability > 0.0 else "alarm",
        ),
        (
            f"{heading.p95:.3f}°" if heading.n else "none",
            f"95 % of the {first} errors are smaller",
            "" if heading.n else "alarm",
        ),
        (
            f"{wrong} wrong",
            f"accepted epochs beyond {comparison.wrong_sd:g} sigma"
            + (f" or {comparison.wrong_deg:g}°" if comparison.wrong_deg else ""),
            "" if wrong == 0 else "warn" if comparison.wrong_fraction < 1e-3 else "alarm",
        ),
        (
            f"NEES {c.nees:.2f}" if np.isfinite(c.nees) else "NEES unknown",
            f"{c.verdict}: {c.lower:.2f} to {c.upper:.2f} is expected of an honest sigma"
            if np.isfinite(c.nees)
            else "no epochs with a stated covariance",
            "" if c.verdict == "consistent" else "warn",
        ),
    ]
    body = "\n".join(
        f'<div class="card {style}"><b>{html.escape(number)}</b><span>{html.escape(text)}</span></div>'
        for number, text, style in cards
    )
    return f'{_CARDS_STYLE}<div class="cards">\n{body}\n</div>'


def _numbers(comparison, rows):
    """Verdict and table of errors."""
    verdict = [
        ("Available", comparison.availability_sentence(), ""),
        ("Wrong", comparison.wrong_sentence(), "bad" if np.any(comparison.is_wrong) else ""),
        ("Consistency", comparison.consistency_sentence(), ""),
        *((name, text, "") for name, text in rows),
    ]
    heads = ("", "epochs", "mean", "sd", "rms", "68 %", "95 %", "99 %", "max")
    lines = ["<tr>" + "".join(f"<th>{head}</th>" for head in heads) + "</tr>"]
    for name, e in comparison.statistics["accepted"].items():
        numbers = (e.mean, e.sd, e.rms, e.p68, e.p95, e.p99, e.max)
        cells = [f"{value:.4f}°" if np.isfinite(value) else "–" for value in numbers]
        lines.append(
            f"<tr><th>{name.capitalize()}</th><td>{e.n}</td>"
            + "".join(f"<td>{cell}</td>" for cell in cells)
            + "</tr>"
        )
    return (
        f"<h2>Verdict</h2>\n{table_html(verdict)}\n"
        "<h2>Errors of the accepted epochs</h2>\n<table>\n" + "\n".join(lines) + "\n</table>"
    )


def _track(go, comparison, time, places):
    """Where the platform drove, coloured by status, in metres east and north of its start."""
    latitude, longitude = np.radians(comparison.latitude_deg), np.radians(comparison.longitude_deg)
    known = np.flatnonzero(np.isfinite(latitude) & np.isfinite(longitude))
    figure = go.Figure()
    if len(known) == 0:
        return figure
    origin = known[0]
    north = 6.371e6 * (latitude - latitude[origin])
    east = 6.371e6 * (longitude - longitude[origin]) * np.cos(latitude[origin])
    figure.add_trace(
        go.Scatter(
            x=east[known],
            y=north[known],
            mode="lines",
            line={"color": "#cccccc", "width": 1},
            hoverinfo="skip",
            showlegend=False,
        )
    )
    for status in (Status.NONE, Status.FLOAT, Status.HELD, Status.FIXED):
        rows = known[comparison.status[known] == status]
        if len(rows) == 0:
            continue
        heading = np.degrees(comparison.reference_rad[rows, 0])
        error = np.degrees(comparison.error_rad[rows, 0])
        figure.add_trace(
            go.Scattergl(
                x=east[rows],
                y=north[rows],
                mode="markers",
                marker={"size": 5, "color": STATUS_COLORS[status]},
                name=f"{status.label} ({len(rows)})",
                customdata=np.stack(
                    [np.datetime_as_string(time[rows], unit="s").astype(object), heading, error], axis=1
                ),
                hovertemplate="%{customdata[0]}<br>"
                + comparison.angles[0]
                + " %{customdata[1]:.1f}°, error %{customdata[2]:.3f}°",
            )
        )
    wrong = known[comparison.is_wrong[known]]
    if len(wrong):
        figure.add_trace(
            go.Scatter(
                x=east[wrong],
                y=north[wrong],
                mode="markers",
                marker={"size": 11, "symbol": "x", "color": "#b00020"},
                name=f"wrong ({len(wrong)})",
                hoverinfo="skip",
            )
        )
    figure.add_trace(
        go.Scatter(
            x=[east[origin]],
            y=[north[origin]],
            mode="markers+text",
            marker={"size": 11, "symbol": "star", "color": "#222"},
            text=["start"],
            textposition="top right",
            hoverinfo="skip",
            showlegend=False,
        )
    )
    for time_ns, text in places:
        row = known[np.argmin(np.abs(comparison.time_ns[known] - time_ns))]
        figure.add_annotation(
            x=east[row], y=north[row], text=html.escape(text), arrowcolor="#666", arrowwidth=1, ax=35, ay=-35
        )
    figure.update_layout(
        height=560,
        xaxis={"title": "east, m", "scaleanchor": "y"},
        yaxis={"title": "north, m"},
    )
    return figure


def _heading(go, comparison, time):
    """The first angle: the reference as a line, the estimates with their band."""
    figure = draw_azimuth(
        go,
        comparison,
        time,
        comparison.estimate_rad[:, 0],
        comparison.sd_rad[:, 0],
        f"{comparison.angles[0]}, deg",
    )
    from .style import azimuth_for_plot, runs_of_epochs

    reference_deg, _ = azimuth_for_plot(comparison, comparison.reference_rad[:, 0])
    x, y = [], []
    for piece in runs_of_epochs(comparison.time_ns, reference_deg, jump=180.0):
        x += [*time[piece], time[piece[-1]]]
        y += [*reference_deg[piece], None]
    figure.add_trace(go.Scatter(x=x, y=y, mode="lines", line={"color": "#222", "width": 1}, name="reference"))
    return figure


def _errors(go, comparison, time, k):
    """Errors of one angle in their stated band."""
    figure = draw_series(
        go,
        comparison,
        time,
        np.degrees(comparison.error_rad[:, k]),
        np.degrees(comparison.sd_rad[:, k]),
        f"{comparison.angles[k]} error, deg",
        band_about=0.0,
    )
    wrong = np.flatnonzero(comparison.is_wrong)
    if len(wrong):
        figure.add_trace(
            go.Scatter(
                x=time[wrong],
                y=np.degrees(comparison.error_rad[wrong, k]),
                mode="markers",
                marker={"size": 9, "symbol": "x-thin-open", "color": "#b00020"},
                name=f"wrong ({len(wrong)})",
                hoverinfo="skip",
            )
        )
    limit_deg = error_limit_deg(comparison, k)
    figure.update_layout(height=270, yaxis={"range": [-limit_deg, limit_deg]})
    return figure


def _spread(go, comparison):
    """Share of accepted epochs whose error is beyond so many stated sigma."""
    from math import erfc

    figure = go.Figure()
    size = np.linspace(0.0, 6.0, 121)
    figure.add_trace(
        go.Scatter(
            x=size,
            y=[erfc(x / np.sqrt(2.0)) for x in size],
            mode="lines",
            line={"color": "#222", "width": 1.5, "dash": "dot"},
            name="normal distribution",
        )
    )
    accepted = comparison.is_accepted
    n = max(int(np.count_nonzero(accepted)), 2)
    for k, (name, color) in enumerate(
        zip(comparison.angles, ("#0072B2", "#D55E00", "#009E73"), strict=False)
    ):
        ratio = np.abs(comparison.error_rad[accepted, k] / comparison.sd_rad[accepted, k])
        ratio = np.sort(ratio[np.isfinite(ratio)])
        if len(ratio):
            # The rare large ones all, the many small ones thinly.
            at = np.unique(np.concatenate([thin_rows(len(ratio), 1000), np.arange(len(ratio))[-500:]]))
            figure.add_trace(
                go.Scatter(
                    x=ratio[at],
                    y=1.0 - at / len(ratio),
                    mode="lines",
                    line={"shape": "hv", "color": color, "width": 2},
                    name=name,
                )
            )
    figure.update_layout(
        height=330,
        xaxis={"title": "error over stated sigma", "range": [0, 6]},
        yaxis={
            "title": "share of epochs beyond",
            "type": "log",
            "range": [float(np.log10(0.5 / n)), 0.1],
            "dtick": 1,
            "tickformat": "~p",
        },
    )
    return figure
