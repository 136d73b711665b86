"""Table 9 of Oguz (2006) made from runs: ways to find north under one common truth.

    python tools/study_north_comparison.py --out docs/validation

What `truenorth compare-north --runs 40 --seed 2006` computes, as a page with its figure; a minute or two.
Everything but the processor times follows from the seed.
"""

import argparse
import platform
import re
import sys
import textwrap
from datetime import date
from pathlib import Path

import numpy as np
from scipy.stats import chi2

import truenorth
from truenorth.evaluation import compare_north
from truenorth.evaluation.north_comparison import LATITUDES_DEG, data_word, short
from truenorth.evaluation.north_gnss import KALMAN_EPOCHS, NOISE_CYC, NOISE_M
from truenorth.evaluation.north_inertial import INERTIAL_S
from truenorth.report.files import save_figure
from truenorth.report.north_comparison_figures import north_comparison_figure


def percent(share):
    """A share as text."""
    return "–" if not np.isfinite(share) else f"{100.0 * share:.0f} %"


def cell(value):
    """A number as text."""
    return short(value).replace("-", "–") if not np.isfinite(value) else short(value)


def table(head, rows):
    """Lines of a table; the first column is text."""
    rule = ["---", *("---:" for _ in head[1:])]
    lines = ["| " + " | ".join(row) + " |" for row in (head, rule, *rows)]
    return [*lines, ""]


def paragraph(text):
    """One paragraph of the page, wrapped, and the empty line after it."""
    return [*textwrap.wrap(" ".join(text.split()), 110, break_long_words=False, break_on_hyphens=False), ""]


def bullet(text):
    """One item of a list, wrapped."""
    return textwrap.wrap(
        " ".join(text.split()), 110, initial_indent="- ", subsequent_indent="  ", break_long_words=False,
        break_on_hyphens=False,
    )  # fmt: skip


class Columns:
    """Numbers of a comparison by technique."""

    def __init__(self, comparison):
        self.values = comparison.columns()
        self.row = {name: k for k, name in enumerate(self.values["technique"])}

    def __call__(self, name, column):
        """Value of a technique in a column."""
        return self.values[column][self.row[name]]


def page(comparison, command):
    """The whole page."""
    scene, of = comparison.scene, Columns(comparison)
    versions = (
        f"truenorth {truenorth.__version__}, NumPy {np.__version__}, Python {platform.python_version()}"
    )
    lines = [
        "# Ways to find north, side by side",
        "",
        *paragraph(f"Made by `{command}` on {date.today().isoformat()}: {versions}."),
        *paragraph(f"""P. Oğuz, *Implementation of Northfinding Techniques*, METU 2006, ends with a table (9)
            of four techniques: two antennas with a search or with Kalman filters, an accelerometer on a
            turntable, and an inertial unit. Its accuracies are single draws, or a bound. Here the same four,
            and the methods of this package beside them, find the same north: a level platform at rest at
            latitude {scene.latitude_deg:.4f}, longitude {scene.longitude_deg:.1f}, height
            {scene.height_m:.0f} m, heading {scene.heading_deg:g} degrees. All errors are drawn anew
            {scene.runs} times. The same table in a terminal: `truenorth compare-north --runs {scene.runs}
            --seed {scene.seed}`."""),
        *truth(),
        "## Table 9, and what the runs say",
        "",
        *paragraph("""Components, cost, dependency, coverage, complexity and accuracy are the thesis's own
            words and numbers; cost was not looked into here. The last four columns are of our runs,
            degrees."""),
        *published(comparison, of),
        "## Errors",
        "",
        *paragraph("""Degrees. Wrong: false integers, or, where a technique has none, an error beyond five
            times the sigma that it states. Right: the rms without the wrong ones. The sigma of the search is
            the thesis's rule, 0.5 cm over the length; it states none with its answers. NEES: mean square of
            the errors over the stated sigma, 1 where that is honest; of satellites, of the right answers. The
            inertial methods have the same units, so their errors go together."""),
        *errors(comparison, of),
        "![Errors of every technique, and accuracy against latitude](north_comparison.png)",
        "",
        *latitudes(comparison, of),
        "## What an answer costs",
        "",
        *paragraph("""Processor time of one answer, from raw phases, increments or accelerations to the
            heading with its sigma, compiled, on the machine that made this page; only the ratios mean
            anything elsewhere. Of the search and of all that takes single epochs it is the time of all runs
            together over their number. Averaging includes the check whether the platform rocked. The filters
            and the least squares on the table are plain NumPy."""),
        *costs(comparison, of),
        "## What it says",
        "",
        *findings(comparison, of),
    ]
    return "\n".join(lines).rstrip() + "\n"


def truth():
    """What is common to all."""
    return [
        "## The common truth",
        "",
        *bullet(f"""Satellites: one nominal sky of GPS, GLONASS, Galileo and BeiDou with today's broadcast
            errors; runs are spread over the day in which it comes round. Phases have white noise of
            {NOISE_CYC:g} cycle of L1, {1e3 * NOISE_M:.1f} mm, at each antenna, codes of 1 m; ionosphere and
            troposphere are there. Receivers have one oscillator and calibrated lines, for the thesis's search
            needs both. Nothing stands in the way of the signals, and every method is told the noise."""),
        *bullet(f"""GPS search: single differences of three satellites on L1, of the four highest those that
            span most, one epoch; all integer sets up to 1 (0.20 m) or 4 (0.76 m); the set that fits best is
            the answer. GPS Kalman: the four highest of those in view throughout, {KALMAN_EPOCHS} epochs of
            one second, 1 m, float integers rounded at the end, then the second filter. The thesis's cases are
            on [their own page](oguz_2006.md)."""),
        *bullet("""All satellites: the default search with the known length, one epoch by itself, two
            frequencies, above 15 degrees. Four antennas: a square, resolved jointly, one epoch."""),
        *bullet("""Rotating accelerometer: 600 rpm, 5 cm, 1e-5 m/s², 500 samples in a revolution, ten
            revolutions on a level table, no vibration, no jitter of the speed."""),
        *bullet(f"""Inertial units: gyros 1 deg/h and 0.1 deg/√h, accelerometers 1 mg and 250 µg/√Hz, scales
            500 ppm, misalignments 1 mrad, one sigma, another unit in every run; {INERTIAL_S:.0f} s of data
            for every method; the thesis does not say how long it averaged. On the turntables the same units:
            half a turn in the middle of the record, or 6 deg/s throughout, with an encoder. One row has a
            navigation-grade unit. The platform neither sways nor shakes, so plain averaging is at its
            best."""),
        "",
    ]  # fmt: skip


def published(comparison, of):
    """Table 9 with our columns."""
    rows = []
    for result in comparison.results:
        one, name = result.technique, result.name
        if not one.is_published:
            continue
        rows.append(
            [
                one.title,
                one.needs,
                one.published_cost,
                one.dependence,
                one.coverage,
                one.published_usage,
                one.published_complexity,
                f"{one.published_deg:g}",
                one.published_draw,
                cell(of(name, "rms_deg")),
                cell(of(name, "right_rms_deg")),
                percent(of(name, "wrong_share")),
                data_word(of(name, "data_s")),
            ]
        )
    head = [
        "technique", "components", "cost", "dependency", "coverage", "practical usage", "complexity",
        "accuracy", "which is", "rms of all answers", "rms of the right ones", "wrong", "data",
    ]  # fmt: skip
    return table(head, rows)


def errors(comparison, of):
    """Distribution of the errors."""
    rows = []
    for result in comparison.results:
        name = result.name
        numbers = (
            "published_deg",
            "rms_deg",
            "right_rms_deg",
            "p95_deg",
            "worst_deg",
            "stated_sd_deg",
            "nees",
        )
        rows.append(
            [
                result.technique.title,
                *(cell(of(name, column)) for column in numbers),
                percent(of(name, "wrong_share")),
                percent(of(name, "available_share")),
                data_word(of(name, "data_s")),
                result.technique.dependence,
                result.technique.limit,
            ]
        )
    head = [
        "technique", "table 9", "rms", "right", "95 %", "worst", "mean stated sigma", "NEES", "wrong",
        "answered", "data", "depends", "limited by",
    ]  # fmt: skip
    return table(head, rows)


def latitudes(comparison, of):
    """Accuracy at other latitudes."""
    rows = []
    for result in comparison.results:
        words = [result.technique.title]
        for latitude in LATITUDES_DEG:
            at = f"at_{latitude:.0f}"
            rms, sd, usable = (
                of(result.name, f"{column}_{at}") for column in ("rms_deg", "stated_sd_deg", "usable_share")
            )
            text = f"{cell(rms)} ({cell(sd)})"
            words.append(f"{text} {percent(usable)}" if result.technique.is_external else text)
        rows.append(words)
    return [
        "## Coverage by latitude",
        "",
        *paragraph(f"""Rms of the runs, degrees, and in brackets the mean of the sigma that the error model
            states; of satellites the rms of the right answers and the share of runs that have one.
            {comparison.scene.runs} runs at each latitude, {comparison.runs_elsewhere} where an answer takes
            long (Kalman, filter, two positions, carousel). An error that has no north left is 104
            degrees."""),
        *table(["technique", *(f"{latitude:.0f}°" for latitude in LATITUDES_DEG)], rows),
    ]


def costs(comparison, of):
    """Processor times."""
    rows = [
        [
            result.technique.title,
            result.technique.published_complexity or "–",
            cell(of(result.name, "cpu_ms")),
            cell(of(result.name, "cpu_of_fastest")),
            cell(of(result.name, "cpu_of_slowest")),
        ]
        for result in comparison.results
    ]
    return table(["technique", "complexity, table 9", "ms", "of the fastest", "of the slowest"], rows)


FINDINGS = (
    """The search: the thesis's 0.43 and 0.11 degrees are draws in which the right set won. It loses in
    <search-20 wrong_share> of the runs at 0.20 m and in <search-76 wrong_share> at 0.76 m, and then the
    heading is anything. Where it wins, the rms is <search-20 right_rms_deg> and <search-76 right_rms_deg>.
    The same antennas with the same noise, all satellites of four systems and two frequencies, one epoch:
    wrong in <constrained-20 wrong_share> and <constrained-76 wrong_share>, <constrained-20 rms_deg> and
    <constrained-76 rms_deg> degrees; four antennas, <array rms_deg>.""",
    """The Kalman filters: where the rounded integers are right they are better than the 0.08 of table 9
    (<kalman right_rms_deg>), because they average a quarter of an hour of noise that is white here; real
    multipath is not. <kalman wrong_share> of the runs are wrong<failed>, without a warning.""",
    """The accelerometer: <accelerometer rms_deg> degrees from one second of data, below the 0.2 of table 9,
    which leaves room for the scatter of single revolutions and for a tilt. The variance of maximum
    likelihood is <gain> times smaller in these runs; π²/8 = 1.23 is the square wave's loss against the bound.
    The thesis only simulated it, too; tilt, lean of the axis, vibration and jitter, which are absent here,
    decide in practice.""",
    """The inertial unit: 5 degrees is about one sigma, not a bound; the rms is <imu rms_deg> and the worst of
    the <runs> units <imu worst_deg>. No way of computing changes that on a platform at rest
    (<inertial rms_deg> in the inertial frame, <fine rms_deg> by the filter), for the bias of the east gyro
    and north are one number. Turning the unit separates them, and the angle random walk remains:
    <two-position rms_deg> from two positions, <carousel rms_deg> on the carousel. A navigation-grade unit has
    <navigation rms_deg> without being turned.""",
    """Sigma: errors larger than the stated sigma by more than chance (0.1 %) allows: <small>. The rule of the
    search is that of a difference with the noise of one antenna, whatever the geometry.""",
    """Latitude: what feels the Earth's rotation gets worse as 1 / cos, from <accelerometer-ml rms_deg_at_0>
    to <accelerometer-ml rms_deg_at_85> degrees for the accelerometer, and the unit of 1 deg/h finds no north
    at 85 degrees. Satellites do not mind.""",
    """Complexity: the search that table 9 calls high takes <search-76 cpu_ms> ms, the filters that it calls
    low <kalman cpu_ms> ms, for their epochs are many. None of it matters beside the time that the data
take.""",
)
"""What the numbers mean; every number comes from the tables."""


def small_sigmas(comparison, of):
    """Techniques whose errors are larger than their sigma allows by chance, as words."""
    told = []
    for result in comparison.results:
        own, nees = result.answers, of(result.name, "nees")
        counted = own.is_given & ~own.is_wrong if result.technique.is_external else own.is_given
        n = int(np.count_nonzero(counted))
        if n and nees > chi2.ppf(0.999, n) / n:
            told.append(f"{result.technique.title} ({np.sqrt(nees):.1f} times)")
    return "none" if not told else "; ".join(told)


def findings(comparison, of):
    """List of findings with their numbers."""
    kalman = next(r.answers for r in comparison.results if r.name == "kalman")
    false = np.abs(kalman.error_deg[kalman.is_given & kalman.is_wrong])
    failed = f", then off by {cell(float(np.median(false)))} degrees in the median" if len(false) else ""
    gain = (of("accelerometer", "rms_deg") / of("accelerometer-ml", "rms_deg")) ** 2
    other = {
        "failed": failed,
        "gain": f"{gain:.2f}",
        "runs": f"{comparison.scene.runs}",
        "small": small_sigmas(comparison, of),
    }

    def number(found):
        name, _, column = found[1].partition(" ")
        if not column:
            return other[name]
        value = of(name, column)
        return percent(value) if column.endswith("_share") else cell(value)

    texts = [re.sub("<([^<>]+)>", number, " ".join(text.split())) for text in FINDINGS]
    return [line for text in texts for line in bullet(text)]


def main():
    """Make the page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--seed", type=int, default=2006)
    parser.add_argument("--out", type=Path, help="folder for the page; without it it is printed only")
    given = parser.parse_args()
    comparison = compare_north(runs=given.runs, seed=given.seed)
    options = f"--runs {given.runs} --seed {given.seed} --out docs/validation"
    command = f"python tools/study_north_comparison.py {options}"
    text = page(comparison, command)
    if given.out is None:
        sys.stdout.write(text)
        return
    (given.out / "north_comparison.md").write_text(text, encoding="utf-8")
    save_figure(north_comparison_figure(comparison), given.out / "north_comparison.png")


if __name__ == "__main__":
    main()
