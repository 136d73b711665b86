"""The page and the figure of `study_success_rates`, from its tallies."""

from dataclasses import dataclass

import numpy as np
from scipy import stats
from success_rate_trials import METHODS, Cell, Run

NOISE_MM = (1.0, 2.0, 3.0, 5.0, 10.0)
MAIN_NOISE_MM = (1.0, 3.0, 10.0)
FREQUENCIES = (1, 2, 3)
SIGNALS = {1: "L1", 2: "L1 L2", 3: "L1 L2 L5"}
FALSE_ALARM = 0.01
"""Chance that an honest solver has any cell at all outside its bounds."""

MEASURES = ("all integers right", "wrong among the accepted", "heading error over sigma", "NEES of direction")


# What is stated against what is observed.


def count_p_value(observed, expected, variance):
    """Two-sided p-value of a count of independent events with unequal probabilities.

    Normal where there are many; else Poisson, whose bounds are a little wider than they need be.
    """
    if variance > 100.0:
        return 2.0 * stats.norm.sf(abs(observed - expected) / np.sqrt(variance))
    tail = min(stats.poisson.cdf(observed, expected), stats.poisson.sf(observed - 1, expected))
    return min(1.0, 2.0 * tail)


def chi2_p_value(total, dof):
    """Two-sided p-value of a sum of squares."""
    return min(1.0, 2.0 * min(stats.chi2.cdf(total, dof), stats.chi2.sf(total, dof)))


@dataclass(frozen=True)
class Check:
    """One stated number of one cell against the observed one."""

    cell: Cell
    run: Run
    measure: str
    stated: float
    observed: float
    p_value: float


def checks_of(cell, run, tally):
    """All that one cell can be checked for."""
    found = []
    if tally.candidates:
        wrong, stated_wrong = tally.candidates - tally.right, tally.candidates - tally.stated
        rarer = (wrong, stated_wrong) if stated_wrong < tally.stated else (tally.right, tally.stated)
        p_value = count_p_value(*rarer, tally.stated_variance)
        stated, observed = tally.stated / tally.draws, tally.right / tally.draws
        found.append(Check(cell, run, MEASURES[0], stated, observed, p_value))
    if tally.accepted:
        p_value = count_p_value(tally.wrong, tally.wrong_stated, tally.wrong_stated)
        stated, observed = tally.wrong_stated / tally.accepted, tally.wrong / tally.accepted
        found.append(Check(cell, run, MEASURES[1], stated, observed, p_value))
    if tally.headings:
        n = tally.headings
        # The azimuth of a steep baseline is no normal variable; its direction on the sphere is.
        if not cell.any_direction:
            p_value = chi2_p_value(tally.heading_normalised, n)
            found.append(Check(cell, run, MEASURES[2], 1.0, np.sqrt(tally.heading_normalised / n), p_value))
        p_value = chi2_p_value(tally.nees, 2 * n)
        found.append(Check(cell, run, MEASURES[3], 1.0, tally.nees / (2 * n), p_value))
    return found


CAUSES = {
    "level": "the posterior takes every direction as equally likely, and this platform is level",
    "length": "what `lambda` accepts has also passed the test of the known length, and is surer than stated; "
    "without that test the cell is within",
    "bent": "weak geometry, nearly all of it in epochs of a PDOP above 8, or a sigma above 1.5 degrees: over "
    "such errors the sphere of the known length is not flat, and may pass the observations twice, the wrong "
    "place little worse than the right one",
    "few": "fewer than 5 % accepted: those whose noise happened to be small",
    "air": "the solver leaves out the delay of the air between antennas of different height below 20 m, and "
    "from there on takes it from the two single-point heights, noise included; without air, or without that "
    "correction of level baselines, the cells are within",
    "?": "not explained",
}
"""Why a check may be outside its bounds, the first that applies."""


def cause(check, tally):
    """Key of `CAUSES`."""
    cell = check.cell
    if check.measure in MEASURES[:2]:
        if check.run.method == "constrained":
            return "?" if cell.any_direction else "level"
        return "length" if check.measure == MEASURES[1] and check.observed < check.stated else "?"
    is_weak = check.run.method == "constrained" and cell.n_satellites <= 5
    if is_weak or np.degrees(np.sqrt(tally.heading_variance_rad2 / tally.headings)) > 1.5:
        return "bent"
    if tally.accepted < 0.05 * tally.draws:
        return "few"
    return "air" if cell.length_m >= 20.0 or (cell.any_direction and cell.length_m >= 1.0) else "?"


def told_checks(table):
    """Checks of all cells whose solver knew the noise, and the p-value below which one fails."""
    checks = [
        check for (cell, run), tally in table.items() if run.told for check in checks_of(cell, run, tally)
    ]
    return checks, FALSE_ALARM / len(checks)


def wilson(hits, n, z=1.96):
    """Confidence interval of a share."""
    share = hits / n
    middle = (share + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * np.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    return (middle - half if hits > 0 else 0.0), (middle + half if hits < n else 1.0)


# Tables.


def percent(share):
    """A share in per cent; what is not quite all or nothing never reads so."""
    if share in (0.0, 1.0):
        return f"{100.0 * share:.0f}"
    return {"100.0": ">99.9", "0.0": "<0.1"}.get(text := f"{100.0 * share:.1f}", text)


def markdown(header, rows):
    """Lines of a table whose first column names the rows."""
    ruler = "| --- |" + " ---: |" * (len(header) - 1)
    return ["| " + " | ".join(header) + " |", ruler, *("| " + " | ".join(row) + " |" for row in rows)]


def satellites_of(table):
    """Numbers of satellites of the level cells of a metre."""
    return sorted({cell.n_satellites for cell, _ in table if cell.length_m == 1.0 and not cell.any_direction})


def lengths_of(table):
    """Baselines of the level cells."""
    return sorted({cell.length_m for cell, _ in table if not cell.any_direction})


def right_cell(table, cell, n_frequencies, told=True):
    """Shares of right integers of both methods."""
    both = [table[cell, Run(method, n_frequencies, told)] for method in METHODS]
    return " / ".join(percent(tally.right / tally.draws) for tally in both)


def accepted_cell(table, cell, run):
    """Share accepted, and the share of these that is wrong."""
    tally = table[cell, run]
    if not tally.accepted:
        return "0"
    return f"{percent(tally.accepted / tally.draws)} ({percent(tally.wrong / tally.accepted)})"


def heading_cell(table, cell, method, n_frequencies):
    """Root mean square of the heading error, and its ratio to sigma with the noise told and with defaults."""
    told, default = (table[cell, Run(method, n_frequencies, is_told)] for is_told in (True, False))
    if told.headings < 100:
        return "–"
    size = np.degrees(np.sqrt(told.heading_square_rad2 / told.headings))
    ratios = [
        f"{np.sqrt(tally.heading_normalised / tally.headings):.2f}" if tally.headings >= 100 else "–"
        for tally in (told, default)
    ]
    return f"{size:.2g} ({', '.join(ratios)})"


def right_tables(table):
    """Shares of right integers by satellites and by baseline."""
    header = ["signals", "satellites", *(f"{sd:g} mm" for sd in NOISE_MM)]
    rows = [
        [SIGNALS[f], str(n), *(right_cell(table, Cell(n, 1.0, sd), f) for sd in NOISE_MM)]
        for f in FREQUENCIES
        for n in satellites_of(table)
    ]
    lines = markdown(header, rows)
    header = ["signals", "baseline", *(f"{sd:g} mm" for sd in MAIN_NOISE_MM)]
    rows = [
        [SIGNALS[f], f"{length:g} m", *(right_cell(table, Cell(7, length, sd), f) for sd in MAIN_NOISE_MM)]
        for f in FREQUENCIES
        for length in lengths_of(table)
    ]
    return lines, markdown(header, rows)


def accepted_table(table, method):
    """What is accepted by satellites, with the noise told and with the defaults."""
    header = ["signals", "satellites"]
    for sd in MAIN_NOISE_MM:
        header += [f"{sd:g} mm, told", "default"]
    rows = []
    for f in FREQUENCIES:
        for n in satellites_of(table):
            row = [SIGNALS[f], str(n)]
            for sd in MAIN_NOISE_MM:
                row += [
                    accepted_cell(table, Cell(n, 1.0, sd), Run(method, f, told)) for told in (True, False)
                ]
            rows.append(row)
    return markdown(header, rows)


def heading_table(table):
    """Heading errors by satellites and by baseline, `constrained`."""
    header = ["satellites", "baseline"]
    header += [f"{SIGNALS[f]}, {sd:g} mm" for f in FREQUENCIES[:2] for sd in MAIN_NOISE_MM]
    places = [(n, 1.0) for n in satellites_of(table)]
    places += [(7, length) for length in lengths_of(table) if length != 1.0]
    rows = [
        [str(n), f"{length:g} m"]
        + [
            heading_cell(table, Cell(n, length, sd), "constrained", f)
            for f in FREQUENCIES[:2]
            for sd in MAIN_NOISE_MM
        ]
        for n, length in places
    ]
    return markdown(header, rows)


def place_text(cell):
    """The cell in words."""
    return f"{cell.n_satellites} satellites, {cell.length_m:g} m, {cell.phase_sd_mm:g} mm"


def verdict_table(checks, limit):
    """How many checks of the told runs are within their bounds."""
    header = ["baselines", "method", *(f"{measure}: within" for measure in MEASURES)]
    rows = []
    for any_direction in (True, False):
        for method in METHODS:
            row = ["all directions" if any_direction else "level", f"`{method}`"]
            for measure in MEASURES:
                chosen = [
                    check
                    for check in checks
                    if check.measure == measure
                    and check.cell.any_direction == any_direction
                    and check.run.method == method
                ]
                inside = sum(check.p_value >= limit for check in chosen)
                row.append(f"{inside} of {len(chosen)}" if chosen else "–")
            rows.append(row)
    return markdown(header, rows)


def outside_table(table, checks, limit):
    """Every check of the told runs that is outside its bounds."""
    header = ["baselines", "cell", "signals", "method", "what", "stated", "observed", "why"]
    rows = [
        [
            "all directions" if check.cell.any_direction else "level",
            place_text(check.cell),
            SIGNALS[check.run.n_frequencies],
            f"`{check.run.method}`",
            check.measure,
            f"{check.stated:.4g}",
            f"{check.observed:.4g}",
            cause(check, table[check.cell, check.run]),
        ]
        for check in checks
        if check.p_value < limit
    ]
    if not rows:
        return ["None."]
    known = {row[-1] for row in rows}
    return [*markdown(header, rows), "", *(f"- {key}: {CAUSES[key]}." for key in CAUSES if key in known)]


def default_table(table):
    """The claims of runs with default settings against what happened, by method, signals and noise."""
    header = [
        "signals", "phase noise", "method", "stated minus observed, points", "wrong of accepted, worst",
        "heading error over sigma",
    ]  # fmt: skip
    rows = []
    for f in FREQUENCIES:
        for sd in NOISE_MM:
            for method in METHODS:
                chosen = [
                    tally
                    for (cell, run), tally in table.items()
                    if run == Run(method, f, False) and cell.phase_sd_mm == sd and cell.length_m == 1.0
                ]
                gap = [100.0 * (tally.stated - tally.right) / tally.draws for tally in chosen]
                many = [tally for tally in chosen if tally.headings >= 100]
                wrong = max((tally.wrong / tally.accepted for tally in many), default=np.nan)
                ratio = [np.sqrt(tally.heading_normalised / tally.headings) for tally in many]
                rows.append(
                    [
                        SIGNALS[f],
                        f"{sd:g} mm",
                        f"`{method}`",
                        f"{min(gap):+.1f} to {max(gap):+.1f}",
                        f"{percent(wrong)} %" if many else "–",
                        f"{min(ratio):.2f} to {max(ratio):.2f}" if many else "–",
                    ]
                )
    return markdown(header, rows)


# Page.

PAGE = """\
# Success rate and heading error: satellites, baseline, phase noise, frequencies

Epochs of the emulator, each resolved by itself. Two antennas on a slow turntable at 55 degrees north see
the nominal GPS constellation over whole days. The receivers track only the highest satellites, as
between houses, so that few satellites are also a weak geometry. White noise of one standard deviation
on every signal, the same at all elevations: codes 0.30 m, phases as given, undifferenced. Clocks, line
biases, atmosphere, orbit errors and wind-up are those of the emulator; there is no multipath. Where the
solver is told the noise and the exact length, a cell has at least {told:,} epochs; where it runs with
its defaults, those of two days, at least {default:,}.

![Success rate, heading error, and stated against observed](success_rates.png)

Panels a to e: the solver is told the noise; bars are 95 % intervals. In f, cells without a wrong epoch
have no mark. All numbers: [success_rates.csv](success_rates.csv).

## All integers right

Share of the epochs whose best candidate is right, accepted or not, in per cent: `constrained` /
`lambda`, the solver told the noise, the baseline 1 m and level.

{by_satellites}

Of the epochs with 4 satellites {lost} % have no single-point position, for their geometry is too weak,
and so no heading.

The same with 7 satellites, by baseline. The length helps `constrained` the more, the shorter the
baseline is; `lambda` does not use it.

{by_baseline}

## What is accepted

Share of the epochs accepted at a stated probability of 0.99 and, in brackets, the wrong among the
accepted, both in per cent; baseline 1 m. "Told" knows the noise. "Default" knows the length alone:
noise by elevation (2 mm and 2 mm / sin), scaled by a variance factor estimated from the run.

`constrained`:

{accepted_constrained}

`lambda`:

{accepted_lambda}

## Heading error

Root mean square over the epochs that were accepted with right integers, degrees, `constrained`, noise
told. In brackets, that of the error over the stated sigma: noise told, default settings. Cells with
fewer than 100 such epochs are left out.

{heading}

## Is what the solver states true, when it knows the noise?

Of each cell: the stated probabilities against the count of right epochs, and of wrong ones among the
accepted; the heading error over sigma (root mean square), and the normalised square error of the
direction (NEES over its 2 degrees of freedom). {n_checks:,} checks, with bounds that an honest solver
keeps in all of them in {confidence:.0f} of 100 such studies. {n_outside} are outside. Baselines in all
directions are what the posterior of `constrained` assumes; a level platform contradicts it.

{verdict}

Outside:

{outside}

## What a user gets who declares nothing

Default settings, baseline 1 m, over all numbers of satellites: by how much the mean stated probability
exceeds the share of right epochs; the wrong among the accepted in the worst cell, where 1 % is allowed;
and the heading error over sigma. The last two of cells with 100 accepted epochs.

{defaults}

Three things spoil the claims. The variance factor comes from the residuals of the best candidates:
where these are often wrong, as with few satellites on one frequency, they fit better than the truth
would, and the factor is too small. Where the noise is several times the declared one (10 mm), the sample
that it comes from has lost its largest residuals to the outlier test, and the factor is too small again,
with many satellites too. And the default model weighs by elevation what is alike at all elevations here.
Who knows the noise should declare it in `stochastic`.

{made}
"""


def write_page(table, made):
    """The page as Markdown."""
    four = [
        tally
        for (cell, run), tally in table.items()
        if run == Run("constrained", 3, True) and cell.n_satellites == 4 and not cell.any_direction
    ]
    by_satellites, by_baseline = right_tables(table)
    checks, limit = told_checks(table)
    parts = {
        "by_satellites": by_satellites,
        "by_baseline": by_baseline,
        "accepted_constrained": accepted_table(table, "constrained"),
        "accepted_lambda": accepted_table(table, "lambda"),
        "heading": heading_table(table),
        "verdict": verdict_table(checks, limit),
        "outside": outside_table(table, checks, limit),
        "defaults": default_table(table),
    }
    return PAGE.format(
        told=round(min(tally.draws for (_, run), tally in table.items() if run.told)),
        default=round(min(tally.draws for (_, run), tally in table.items() if not run.told)),
        lost=percent(1.0 - sum(tally.candidates for tally in four) / sum(tally.draws for tally in four)),
        n_checks=len(checks),
        confidence=100.0 * (1.0 - FALSE_ALARM),
        n_outside=sum(check.p_value < limit for check in checks),
        made=made,
        **{name: "\n".join(lines) for name, lines in parts.items()},
    )


# Figure.

COLOURS = {1: "#0072B2", 2: "#D55E00", 3: "#009E73"}
"""Of Okabe and Ito (2008), told apart with any colour vision."""
MARKERS = {1: "o", 2: "s", 3: "^"}
DASHES = {"constrained": "-", "lambda": (0, (4, 2))}
NOISE_COLOURS = {1.0: "#0072B2", 3.0: "#E69F00", 10.0: "#CC79A7"}
NOISE_MARKERS = {1.0: "o", 3.0: "D", 10.0: "v"}


def draw_success(axes, table, cells, x, told=True):
    """Share of right integers along a sweep, both methods and all frequency counts."""
    for f in FREQUENCIES:
        for method in METHODS:
            tallies = [table[cell, Run(method, f, told)] for cell in cells]
            share = np.array([tally.right / tally.draws for tally in tallies])
            bounds = np.array([wilson(tally.right, tally.draws) for tally in tallies]).T
            axes.errorbar(
                x, 100 * share, 100 * np.maximum(np.abs(bounds - share), 0.0), color=COLOURS[f],
                marker=MARKERS[f], ls=DASHES[method], mfc=COLOURS[f] if method == "constrained" else "white",
                ms=4.5, lw=1.3, capsize=1.5,
            )  # fmt: skip
    axes.set(ylim=(-3, 103), ylabel="epochs with all integers right, %")


def draw_heading(axes, table, cells_by_noise, x):
    """Observed heading errors and stated sigmas along a sweep."""
    for sd, cells in cells_by_noise.items():
        tallies = [table[cell, Run("constrained", 2, True)] for cell in cells]
        known = np.array([tally.headings >= 100 for tally in tallies])
        at = np.asarray(x, float)[known]
        tallies = [tally for tally, is_known in zip(tallies, known, strict=True) if is_known]
        stated = [np.degrees(np.sqrt(t.heading_variance_rad2 / t.headings)) for t in tallies]
        observed = [np.degrees(np.sqrt(t.heading_square_rad2 / t.headings)) for t in tallies]
        axes.plot(at, stated, "-", color=NOISE_COLOURS[sd], lw=1.3)
        axes.plot(at, observed, NOISE_MARKERS[sd], color=NOISE_COLOURS[sd], ms=5)
    axes.set(yscale="log", ylabel="heading error, rms, degrees")


def draw_honesty(axes, table):
    """Observed against stated share of wrong integers, cell by cell."""
    kinds = {
        "told, all directions": (lambda cell, run: run.told and cell.any_direction, "#0072B2", "o"),
        "told, level": (lambda cell, run: run.told and not cell.any_direction, "#009E73", "^"),
        "default settings, level": (lambda cell, run: not run.told, "#E69F00", "x"),
    }
    for name, (belongs, colour, marker) in reversed(kinds.items()):
        points = []
        for (cell, run), tally in table.items():
            n, wrong = tally.candidates, tally.candidates - tally.right
            if belongs(cell, run) and wrong > 0:
                points.append(((n - tally.stated) / n, wrong / n))
        stated, observed = np.array(points).T
        axes.plot(
            stated, observed, marker, color=colour, ms=4, mew=1.0, ls="none", label=name,
            mfc="none" if marker != "x" else None,
        )  # fmt: skip
    axes.plot([1e-7, 1], [1e-7, 1], color="0.5", lw=1, zorder=0)
    axes.set(xscale="log", yscale="log", xlim=(1e-5, 1.5), ylim=(5e-5, 1.5),
             xlabel="stated share of wrong integers", ylabel="observed share of wrong integers")  # fmt: skip
    axes.legend(frameon=False, fontsize=8, loc="upper left")


def draw_figure(table, path):
    """Six panels: success, heading error, and whether the claims are true."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.lines import Line2D

    figure, axes = plt.subplots(2, 3, figsize=(12.5, 7.6), layout="constrained")
    satellites, lengths = satellites_of(table), lengths_of(table)
    draw_success(axes[0, 0], table, [Cell(n, 1.0, 3.0) for n in satellites], satellites)
    axes[0, 0].set(xlabel="satellites", title="Satellites: 1 m, 3 mm")
    draw_success(axes[0, 1], table, [Cell(5, 1.0, sd) for sd in NOISE_MM], NOISE_MM)
    axes[0, 1].set(xlabel="phase noise, mm", title="Phase noise: 5 satellites, 1 m")
    draw_success(axes[0, 2], table, [Cell(7, length, 10.0) for length in lengths], lengths)
    axes[0, 2].set(xlabel="baseline, m", xscale="log", title="Baseline: 7 satellites, 10 mm")
    handles = [
        Line2D([], [], color=COLOURS[f], marker=MARKERS[f], ls="none", label=SIGNALS[f]) for f in FREQUENCIES
    ]
    handles += [Line2D([], [], color="0.3", ls=DASHES[method], label=method) for method in METHODS]
    axes[0, 0].legend(handles=handles, frameon=False, fontsize=8, loc="lower right")
    draw_heading(
        axes[1, 0], table, {sd: [Cell(n, 1.0, sd) for n in satellites] for sd in MAIN_NOISE_MM}, satellites
    )
    axes[1, 0].set(xlabel="satellites", title="Heading: 1 m, L1 L2, constrained")
    draw_heading(
        axes[1, 1], table, {sd: [Cell(7, length, sd) for length in lengths] for sd in MAIN_NOISE_MM}, lengths
    )
    axes[1, 1].set(xlabel="baseline, m", xscale="log", title="Heading: 7 satellites, L1 L2, constrained")
    for panel in (axes[0, 2], axes[1, 1]):
        panel.set_xticks(lengths, [f"{length:g}" for length in lengths])
        panel.minorticks_off()
    handles = [
        Line2D([], [], color=NOISE_COLOURS[sd], marker=NOISE_MARKERS[sd], ls="none", label=f"{sd:g} mm")
        for sd in MAIN_NOISE_MM
    ]
    handles.append(Line2D([], [], color="0.3", label="stated sigma"))
    axes[1, 0].legend(handles=handles, frameon=False, fontsize=8, loc="upper right")
    draw_honesty(axes[1, 2], table)
    axes[1, 2].set_title("Are the claims true? One mark a cell")
    for letter, panel in zip("abcdef", axes.flat, strict=True):
        panel.grid(color="0.92")
        panel.set_axisbelow(True)
        panel.set_title(f"{letter}   {panel.get_title()}", fontsize=10, loc="left")
        panel.title.set_text("")
    figure.savefig(path, dpi=110)
    plt.close(figure)
