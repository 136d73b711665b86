"""Success rates and heading errors of the emulator's epochs against the committed study."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

ROOT = Path(__file__).parents[2]
PAGES = ROOT / "docs" / "validation"
FALSE_ALARM = 1e-4
"""Of each test."""

pytestmark = pytest.mark.jit


def load(name):
    """A module of tools/, which is no package."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(name, module)
    spec.loader.exec_module(module)
    return sys.modules[name]


trials = load("success_rate_trials")
page = load("success_rate_page")
study = load("study_success_rates")
Cell, Run = trials.Cell, trials.Run


@pytest.fixture(scope="module")
def committed():
    """Numbers of the committed study, and how they were made."""
    return study.read_numbers(PAGES / "success_rates.csv")


def test_page_says_what_the_numbers_say(committed):
    table, made = committed
    assert set(table) == {(cell, run) for cell in study.cells() for run in study.runs(cell)}
    assert (PAGES / "success_rates.md").read_text(encoding="utf-8") == page.write_page(table, made)


def test_committed_study_leaves_no_claim_unexplained(committed):
    table, _ = committed
    checks, limit = page.told_checks(table)
    odd = [check for check in checks if check.p_value < limit]
    assert [check for check in odd if page.cause(check, table[check.cell, check.run]) == "?"] == []


def z_score(hits, n, other_hits, other_n):
    """Difference of two observed shares in standard deviations."""
    pooled = (hits + other_hits) / (n + other_n)
    # A share of 0 or 1 has no spread; one hit more or less stands for it.
    sd = np.sqrt(max(pooled * (1.0 - pooled), 1.0 / (n + other_n)) * (1.0 / n + 1.0 / other_n))
    return (hits / n - other_hits / other_n) / sd


SMALL = {
    Cell(5, 1.0, 3.0): [Run("constrained", 1, True), Run("lambda", 2, True), Run("constrained", 2, False)],
    Cell(6, 1.0, 10.0): [Run("constrained", 1, True), Run("lambda", 2, True)],
    Cell(7, 0.2, 10.0): [Run("constrained", 1, True), Run("lambda", 1, True)],
    Cell(8, 1.0, 5.0): [Run("lambda", 1, True), Run("constrained", 3, True)],
}


@pytest.mark.parametrize("cell", SMALL, ids=page.place_text)
def test_small_run_agrees_with_the_committed_study(cell, committed):
    table, _ = committed
    runs = SMALL[cell]
    # One day, as the geometry of all days is nearly the same.
    for run, tally in trials.try_cell(cell, runs, 400, seed=78, interval_s=200.0).items():
        assert tally.draws > 400
        limit = stats.norm.isf(FALSE_ALARM / 4 / len(runs))
        for name in ("right", "accepted"):
            there = table[cell, run]
            score = z_score(getattr(tally, name), tally.draws, getattr(there, name), there.draws)
            assert abs(score) < limit, (run, name)


def test_what_is_stated_is_true_for_baselines_in_all_directions():
    runs = [Run(method, n, True) for n in (1, 2) for method in trials.METHODS]
    tallies = trials.try_cell(Cell(5, 1.0, 3.0, True), runs, 700, seed=79, interval_s=900.0)
    checks = [
        check
        for run, tally in tallies.items()
        # Of a few accepted epochs in a thousand only those with little noise are seen.
        for check in page.checks_of(Cell(5, 1.0, 3.0, True), run, tally)
        if check.measure in page.MEASURES[:2] or tally.accepted > 0.2 * tally.draws
    ]
    assert len(checks) >= 9
    assert [check for check in checks if check.p_value < FALSE_ALARM / len(checks)] == []


def test_wrong_claims_are_noticed():
    # The solver believes in a third of the noise: the checks of the study must see it.
    cell = Cell(6, 1.0, 9.0)
    day = trials.emulate(cell, 0, 300.0, 80)
    from truenorth import solve_baseline

    settings = trials.solver_settings(Cell(6, 1.0, 3.0), Run("constrained", 2, True))
    solution = solve_baseline(
        day.base, day.rover, day.navigation, settings=settings, residual_significance=1e-12
    )
    checks = page.checks_of(cell, Run("constrained", 2, True), trials.score(day, solution))
    assert {check.measure for check in checks if check.p_value < 1e-4} >= set(page.MEASURES[2:])
