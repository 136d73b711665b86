"""Ways to find north under one truth: in small, against the committed page; the same from the same seed."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom, f

from truenorth.evaluation import compare_north
from truenorth.evaluation.north_answers import Answers, Scene
from truenorth.evaluation.north_comparison import LATITUDES_DEG, TECHNIQUES
from truenorth.evaluation.north_gnss import SkyOfADay
from truenorth.evaluation.north_inertial import UnitAtRest

PAGE = (Path(__file__).parents[2] / "docs" / "validation" / "north_comparison.md").read_text("utf-8")
PAGE_RUNS, PAGE_SEED = (int(v) for v in re.search(r"--runs (\d+) --seed (\d+)", PAGE).groups())
RUNS = 10
QUICK = (
    "search-20", "constrained-76", "array", "accelerometer", "accelerometer-ml", "imu", "inertial"
)  # fmt: skip
FALSE_ALARM = 1e-5

pytestmark = [pytest.mark.statistical, pytest.mark.jit]


def _page(head):
    """Rows of the page's table whose head holds these words: cells by title."""
    lines = PAGE.splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith("|") and all(w in line for w in head))
    names = [cell.strip() for cell in lines[at].strip("|").split("|")]
    rows = {}
    for line in lines[at + 2 :]:
        if not line.startswith("|"):
            return rows
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        rows[cells[0]] = dict(zip(names, cells, strict=True))
    return rows


@pytest.fixture(scope="module")
def small():
    # Other draws than those of the page.
    return compare_north(runs=RUNS, seed=PAGE_SEED + 1000, methods=QUICK)


def test_the_page_holds_every_technique_and_the_published_numbers():
    rows = _page(["table 9", "worst"])
    assert set(rows) == {one.title for one in TECHNIQUES.values()}
    published = {name: one.published_deg for name, one in TECHNIQUES.items() if one.is_published}
    assert published == {
        "search-20": 0.5, "search-76": 0.5, "kalman": 0.08, "accelerometer": 0.2, "imu": 5.0,
    }  # fmt: skip
    for name, value in published.items():
        assert float(rows[TECHNIQUES[name].title]["table 9"]) == value


def test_a_small_run_agrees_with_the_page(small):
    rows, columns = _page(["table 9", "worst"]), small.columns()
    for k, name in enumerate(columns["technique"]):
        row = rows[TECHNIQUES[name].title]
        share = float(row["wrong"].rstrip(" %")) / 100.0
        wrong = round(columns["wrong_share"][k] * RUNS)
        # A share of nought or one in the page may be a few per cent off it.
        low, high = max(share - 0.15, 0.0), min(share + 0.15, 1.0)
        assert binom.sf(wrong - 1, RUNS, high) > FALSE_ALARM
        assert binom.cdf(wrong, RUNS, low) > FALSE_ALARM
        right = RUNS - wrong
        if right < 3 or share > 0.9:
            continue
        ratio = (columns["right_rms_deg"][k] / float(row["right"])) ** 2
        there = round((1.0 - share) * PAGE_RUNS)
        # The search has tails where three satellites stand badly: a quarter of the runs counts.
        freedom = (right, there) if not name.startswith("search") else (right / 4.0, there / 4.0)
        assert f.ppf(FALSE_ALARM, *freedom) < ratio < f.isf(FALSE_ALARM, *freedom), name


def test_what_feels_the_earth_fades_with_the_latitude_and_satellites_do_not(small):
    columns = small.columns()
    row = {name: k for k, name in enumerate(columns["technique"])}

    def growth(name, column="rms_deg"):
        return columns[f"{column}_at_75"][row[name]] / columns[f"{column}_at_0"][row[name]]

    expected = 1.0 / np.cos(np.radians(75.0))
    # The same draws at every latitude, so the ratio is that of the horizontal Earth rate.
    assert growth("accelerometer") == pytest.approx(expected, rel=0.02)
    # Beyond 20 degrees the first order is no longer exact.
    for name in ("imu", "inertial"):
        assert growth(name) == pytest.approx(expected, rel=0.25)
        assert growth(name, "stated_sd_deg") == pytest.approx(expected, rel=0.15)
    assert growth("constrained-76", "stated_sd_deg") == pytest.approx(1.0, abs=0.3)
    for latitude in LATITUDES_DEG:
        assert columns[f"usable_share_at_{latitude:.0f}"][row["array"]] == 1.0


def test_a_seed_decides_everything_but_the_processor_times():
    def told():
        found = compare_north(runs=2, seed=7, methods=["accelerometer", "search-20"]).to_dict()
        for entry in found["techniques"]:
            times = [entry.pop(name) for name in ("cpu_ms", "cpu_of_fastest", "cpu_of_slowest")]
            assert min(times) > 0.0
        return found

    first = told()
    assert first == told()
    assert [entry["technique"] for entry in first["techniques"]] == ["search-20", "accelerometer"]


def test_kalman_filters_with_the_right_integers_keep_their_sigma():
    answers = SkyOfADay(Scene(39.9167, 32.8, 900.0, 11.0, 3, PAGE_SEED)).kalman()
    right = answers.is_given & ~answers.is_wrong
    assert right.any()
    assert np.all(np.abs(answers.error_deg[right]) < 4.9 * answers.sd_deg[right])
    # Wrong integers are centimetres, far beyond the sigma that is stated with them.
    assert np.all(np.abs(answers.error_deg[answers.is_given & answers.is_wrong]) > 1.0)


@pytest.mark.parametrize(("method", "motion"), [("positions", "half turn"), ("carousel", "carousel")])
def test_a_turned_unit_is_compared_with_where_it_points_at_the_end(method, motion):
    answers = UnitAtRest(Scene(39.9167, 32.8, 900.0, 11.0, 3, PAGE_SEED)).align(method, motion=motion)
    assert np.all(np.abs(answers.error_deg) < 4.9 * answers.sd_deg)
    # The bias alone, of 1 deg/h, would be 5 degrees.
    assert np.all(answers.sd_deg < 2.5)


def test_answers_are_judged_by_their_own_sigma():
    error = np.array([0.1, -0.6, np.nan, 0.2])
    answers = Answers.judged(error, np.full(4, 0.1), 0.0, 1.0)
    assert answers.is_wrong.tolist() == [False, True, False, False]
    assert answers.available == 0.75
    assert answers.wrong == pytest.approx(1.0 / 3.0)
    assert answers.rms_deg(right_only=True) == pytest.approx(np.sqrt((0.01 + 0.04) / 2.0))
    assert answers.nees() == pytest.approx((1.0 + 36.0 + 4.0) / 3.0)
