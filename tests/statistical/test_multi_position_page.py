"""North from positions and carousels: the committed page holds its demands, a small run agrees with it."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import f as fisher

ROOT = Path(__file__).parents[2]


def load(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


study = load("study_multi_position")
PAGE = (ROOT / "docs" / "validation" / "multi_position.md").read_text(encoding="utf-8")
DRAWS = int(re.search(r"--draws (\d+)", PAGE)[1])


def rows(heading):
    """Cells of the table under a heading, without its head."""
    part = PAGE.split(f"## {heading}")[1].split("\n## ")[0]
    table = [[cell.strip() for cell in line.split("|")[1:-1]] for line in part.splitlines() if "|" in line]
    return table[2:]


NOISY = {
    study.Case(sensor, float(latitude), float(seconds), method): [float(cell or "nan") for cell in numbers]
    for sensor, latitude, seconds, method, *numbers in rows("With all errors")
}
"""Predicted, stated, rms, NEES over three, equivalent."""


def test_every_case_is_on_the_page():
    quiet, noisy = study.cases()
    assert set(NOISY) == set(noisy)
    assert [(row[0], row[1]) for row in rows("What is left")] == [
        (f"{case.latitude_deg:.0f}", case.method) for case in quiet
    ]


def test_a_bias_of_a_degree_an_hour_is_reduced_below_a_twentieth():
    for latitude, method, _, equivalent in rows("What is left"):
        if method == "one":
            assert float(equivalent) > 0.5, latitude
        else:
            assert float(equivalent) < 0.05, (latitude, method)
    # With a random walk of 0.01 deg/sqrt(h) too, noise and all.
    for case, (*_, equivalent) in NOISY.items():
        if case.sensor == "FOG 0.01" and case.method != "one":
            assert equivalent < 0.05 + 0.05 * 3.0 / np.sqrt(2.0 * DRAWS), case


def test_sigma_is_as_predicted_and_as_found():
    low, high = study.nees_bounds(DRAWS, 1e-4)
    spread = 4.0 / np.sqrt(2.0 * DRAWS)
    for case, (predicted, stated, rms, nees, _) in NOISY.items():
        if case.method == "one":
            continue
        assert stated == pytest.approx(predicted, rel=0.05), case
        assert rms == pytest.approx(stated, rel=spread), case
        assert low < nees < high, case


def test_least_squares_is_nowhere_worse_than_mean_rates():
    # The same records: what differs between the two is a part of their scatter only.
    for *case, ours, plain in rows("The estimator"):
        assert float(ours) < 1.1 * float(plain), case


@pytest.mark.parametrize("method", ["two", "carousel, encoder"])
def test_a_small_run_agrees_with_the_page(method):
    case = study.Case("FOG 0.01", 40.0, 240.0, method)
    draws = 8
    found = study.run_case(case, draws, 77)
    predicted, stated, rms, *_ = NOISY[case]
    # The page has three digits.
    assert found.predicted_deg == pytest.approx(predicted, rel=0.006)
    assert np.mean(found.sd_deg) == pytest.approx(stated, rel=0.01)
    low, high = fisher.ppf([5e-5, 1.0 - 5e-5], draws, DRAWS)
    assert low < (study.rms(found.error_deg) / rms) ** 2 < high


def test_the_same_seed_makes_the_same_errors():
    case = study.Case("FOG 0.01", 40.0, 240.0, "two", True)
    first, again = (study.run_case(case, 1, 5).error_deg for _ in range(2))
    np.testing.assert_array_equal(first, again)
