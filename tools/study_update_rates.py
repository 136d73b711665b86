"""The lap of Landfahrer (2009), chapter 6, at 1, 10 and 20 Hz with one sky, beside what was found there.

    python tools/study_update_rates.py --out docs/validation

The scenario is simulated once at 20 Hz; the other rates are its epochs thinned. Everything follows from the
seed of the scenario.
"""

import argparse
import platform
import sys
import textwrap
from dataclasses import replace
from datetime import date
from pathlib import Path

import msgspec
import numpy as np

import truenorth
from truenorth.evaluation import compare_rates
from truenorth.evaluation.decimation import point_spacing_m
from truenorth.report.files import save_figure
from truenorth.report.planning_figures import rates_figure
from truenorth.simulation import simulate
from truenorth.timescales import NS_PER_S

SCENARIO = "landfahrer-update-rate"
RATES_HZ = (1.0, 10.0, 20.0)

CASES = {
    "GPS and GLONASS, L1 and L2, length known": {},
    "GPS L1 alone, length known": {"systems": "G", "bands": ("L1",)},
    "GPS L1 alone, length unknown": {"systems": "G", "bands": ("L1",), "length_use": "off"},
}
"""Changes to what the scenario tells the solver. The thesis knew no length in the resolution."""

LINES = {
    "held_share": ("held, %", 100.0, 1),
    "fixed_share": ("fixed, %", 100.0, 2),
    "float_share": ("float, %", 100.0, 2),
    "none_share": ("none, %", 100.0, 2),
    "quality_1_share": ("quality 1, %", 100.0, 1),
    "gaps": ("gaps", 1.0, 0),
    "gaps_total_s": ("gaps together, s", 1.0, 1),
    "gap_longest_s": ("longest gap, s", 1.0, 2),
    "spacing_m": ("point spacing, m", 1.0, 2),
    "refix_median_s": ("time to re-fix, median, s", 1.0, 3),
    "refix_longest_s": ("time to re-fix, longest, s", 1.0, 2),
    "satellites_median": ("satellites, median", 1.0, 0),
    "pdop_median": ("PDOP, median", 1.0, 2),
    "pdop_95": ("PDOP, 95 %", 1.0, 2),
    "azimuth_rms_deg": ("azimuth error, rms, deg", 1.0, 2),
    "elevation_rms_deg": ("elevation error, rms, deg", 1.0, 2),
    "wrong_epochs": ("wrong epochs", 1.0, 0),
}


def studies(simulation):
    """The rates compared, for each case."""
    found = {}
    for name, changes in CASES.items():
        solve = msgspec.structs.replace(simulation.scenario.solve, **changes)
        scenario = msgspec.structs.replace(simulation.scenario, solve=solve)
        found[name] = compare_rates(replace(simulation, scenario=scenario), RATES_HZ, simulation.truth)
    return found


def stretches(simulation):
    """When the platform was beside each obstruction: letter with words, first and last instant."""
    way_m, time_ns = simulation.truth["distance_m"], simulation.truth["time_ns"]
    found = []
    for item in simulation.scenario.visibility.obstructions:
        inside = np.flatnonzero((way_m >= item.start_m) & (way_m < item.end_m))
        found.append((item.name, int(time_ns[inside[0]]), int(time_ns[inside[-1]])))
    return found


def stretch_row(study, name, first_ns, last_ns):
    """A line of the table: what the obstruction leaves, and what each rate makes of it."""
    inside = (study.time_ns >= first_ns) & (study.time_ns <= last_ns)
    cells = [name, f"{(first_ns - study.time_ns[0]) / NS_PER_S:.0f}", str(study.n_common[inside].min())]
    for result in study.results:
        solution = result.solution
        here = (solution.time_ns >= first_ns) & (solution.time_ns <= last_ns)
        accepted = np.count_nonzero(solution.is_accepted[here])
        step_ns, start_ns = NS_PER_S / result.rate_hz, study.time_ns[0]
        grid = np.arange(np.ceil((first_ns - start_ns) / step_ns), (last_ns - start_ns) / step_ns + 1e-6)
        expected = max(len(grid), 1)
        after = solution.time_ns[solution.is_accepted & (solution.time_ns > last_ns)]
        back_s = (after[0] - last_ns) / NS_PER_S if len(after) else np.nan
        cells.append(f"{100.0 * accepted / expected:.0f} %, {back_s:.2f}")
    return "| " + " | ".join(cells) + " |"


def case_table(study):
    """Quantities down, rates across."""
    columns = study.columns()
    lines = [
        "| | " + " | ".join(f"{rate:g} Hz" for rate in columns["rate_hz"]) + " |",
        "| --- |" + " ---: |" * len(columns["rate_hz"]),
    ]
    for key, (label, factor, digits) in LINES.items():
        values = columns[key] * factor
        if np.any(np.isfinite(values)):
            words = (f"{value:.{digits}f}" if np.isfinite(value) else "–" for value in values)
            lines.append(f"| {label} | " + " | ".join(words) + " |")
    return lines


def page(found, simulation, command):
    """The page as text."""
    names = list(found)
    own, _, bare = found.values()
    lines = [
        "# One lap at 1, 10 and 20 Hz",
        "",
        f"Made by `{command}` on {date.today().isoformat()}: truenorth {truenorth.__version__}, NumPy "
        f"{np.__version__}, Python {platform.python_version()}; seed {simulation.scenario.seed}.",
        "",
        *paragraph("""K. Landfahrer, *Attitude determination using a GPS multi antenna array*, 2009, chapter
            6: three laps near Wildon, one at each rate, two antennas 22 cm apart on a roof rack. Each lap had
            its own satellites, so the thesis could not tell the rate from the sky. Here one emulated lap
            of the same kind (`landfahrer-update-rate`; the route is assumed) is recorded at 20 Hz and
            thinned, so that satellites, obstructions, noise and multipath are the same at every rate. A
            loss of lock between two kept epochs is told at the second, as a slower receiver would.
            `truenorth rates session.toml --reference truth.csv` does this with any recording."""),
        "## Point spacing",
        "",
        "| speed | 1 Hz | 10 Hz | 20 Hz |",
        "| --- | ---: | ---: | ---: |",
    ]
    for speed in (60.0, 30.0):
        words = (f"{point_spacing_m(speed / 3.6, rate):.2f} m" for rate in RATES_HZ)
        lines.append(f"| {speed:.0f} km/h | " + " | ".join(words) + " |")
    lines += [
        "| published, 60 km/h | 16.66 m | 1.66 m | 0.83 m |",
        "| published, 30 km/h | 8.33 m | 0.83 m | 0.41 m |",
        "",
    ]
    for name, study in found.items():
        lines += [f"## {name}", "", *case_table(study), ""]
    lines += [
        "![Satellites, status, errors and time to re-fix](update_rates.png)",
        "",
        *paragraph("""The figure is of the first case. Times to re-fix count from the first instant of the 20
            Hz recording at which both antennas have the phases of four satellites again."""),
        "## Beside each obstruction",
        "",
        *paragraph("""Fewest satellites common to both antennas, of any elevation; then at each rate the
            share of accepted epochs within the stretch, and the seconds from its end to the next accepted
            epoch."""),
    ]
    for name, study in ((names[0], own), (names[2], bare)):
        lines += [
            f"{name}:",
            "",
            "| obstruction | at, s | fewest | 1 Hz | 10 Hz | 20 Hz |",
            "| --- | ---: | ---: | ---: | ---: | ---: |",
            *(stretch_row(study, *item) for item in stretches(simulation)),
            "",
        ]
    lines += ["## Beside the thesis", "", *findings(found)]
    return "\n".join(lines) + "\n"


def findings(found):
    """What chapter 6 says, and what one sky says; every number from the tables above."""
    study, _, unknown = found.values()
    own, bare = study.columns(), unknown.columns()

    def span(values, digits, factor=1.0):
        return " / ".join(f"{factor * value:.{digits}f}" for value in values)

    rows = [
        (
            "full loss at underpass (e) and in the forest (f) at 20 Hz",
            "the same two losses at every rate, "
            f"{span([item.duration_s for item in study.obstructions], 1)} s long",
        ),
        (
            "quick drops to 4 satellites at 1 Hz, minimum 5 at 20 Hz",
            "satellites are those of the sky: the median is "
            f"{span(own['satellites_median'], 0)} at 1 / 10 / 20 Hz",
        ),
        ("high PDOP in the village (d) at 1 Hz only", f"PDOP, 95 %: {span(own['pdop_95'], 2)}"),
        (
            "fewer float epochs at 20 Hz",
            f"float: {span(own['float_share'], 2, 100.0)} % with everything known, "
            f"{span(bare['float_share'], 1, 100.0)} % with GPS L1 and no length",
        ),
        (
            "20 Hz more sensitive to shadowing but recovers better",
            f"gaps: {span(own['gaps'], 0)}, and {span(bare['gaps'], 0)} with GPS L1 and no length; re-fixed "
            f"after {span(own['refix_longest_s'], 2)} s at the latest, and after "
            f"{span(bare['refix_longest_s'], 2)} s",
        ),
        (
            "10 Hz about as good as 20 Hz; 20 Hz chosen",
            f"azimuth error, rms: {span(own['azimuth_rms_deg'], 2)} deg; only the point spacing halves",
        ),
        (
            "20 Hz starts worse after a shorter static initialisation",
            "the first epoch is resolved at every rate",
        ),
    ]
    return [
        "| chapter 6 | one sky, three rates |",
        "| --- | --- |",
        *(f"| {published} | {here} |" for published, here in rows),
        "",
        *paragraph("""With the sky held, the rate decides how close the points lie, how soon after an
            obstruction the next epoch comes, and how many short gaps are seen at all; availability and
            accuracy are those of the sky and the obstructions. So most of what chapter 6 lays to the rate
            was the satellites of the lap. More epochs do not average multipath, which stays alike over
            seconds."""),
        *paragraph(f"""Nor do they make integers safer. {wrong_fixes(unknown)} A probability of 0.99 was
            demanded; more epochs of the same second add little to it, for their multipath is the same."""),
    ]


def wrong_fixes(study):
    """Sentence on the accepted epochs with wrong integers: when, and with which stated probability."""
    told = []
    for result in study.results:
        rows = np.flatnonzero(result.comparison.is_wrong)
        if len(rows) == 0:
            told.append(f"none at {result.rate_hz:g} Hz")
            continue
        since_s = (result.comparison.time_ns - study.time_ns[0]) / NS_PER_S
        first = int(np.searchsorted(result.solution.time_ns, result.comparison.time_ns[rows[0]]))
        told.append(
            f"{len(rows)} at {result.rate_hz:g} Hz, from {since_s[rows[0]]:.1f} to {since_s[rows[-1]]:.1f} "
            f"s, stated as right with {result.solution.success_probability[first]:.3f}"
        )
    return (
        "With GPS L1 and without the length, wrong epochs are accepted between the underpass (e) and the "
        "forest (f): " + "; ".join(told) + "."
    )


def paragraph(text):
    """One paragraph of the page, wrapped, and the empty line after it."""
    return [*textwrap.wrap(" ".join(text.split()), 110, break_long_words=False, break_on_hyphens=False), ""]


def main():
    """Make the page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, help="folder for the page; without it it is printed only")
    options = parser.parse_args()
    simulation = simulate(SCENARIO)
    found = studies(simulation)
    text = page(found, simulation, "python tools/study_update_rates.py --out docs/validation")
    if options.out is None:
        sys.stdout.write(text)
        return
    (options.out / "update_rates.md").write_text(text, encoding="utf-8")
    save_figure(rates_figure(next(iter(found.values()))), options.out / "update_rates.png")


if __name__ == "__main__":
    main()
