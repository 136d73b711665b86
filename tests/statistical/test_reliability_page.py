"""The committed pages on reliability against a small run of the study that made them."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "validation" / "reliability.md"


def study():
    """A module of tools/, which is no package."""
    spec = importlib.util.spec_from_file_location(
        "study_protection_level", ROOT / "tools" / "study_protection_level.py"
    )
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.BLOCK = 2000
    return module


def tables():
    """Tables of the page: lists of rows of cells, without their heads."""
    text = PAGE.read_text(encoding="utf-8")
    found = re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE)
    return [
        [[cell.strip() for cell in line.strip("|\n").split("|")] for line in t.splitlines()[2:]]
        for t in found
    ]


def test_what_slips_hide_in_is_what_the_page_says():
    committed = tables()[1]
    for row, (m, n_sats, stage, result) in zip(committed, study().phase_table(), strict=True):
        assert row[:4] == [
            str(m),
            str(n_sats),
            "the array" if stage == "attitude" else "its vector",
            str(result.dof),
        ]
        largest = result.mdb_cyc.max()
        assert row[6] == (f"{largest:.2f}" if np.isfinite(largest) else "unbounded")
        assert row[7] == f"{100.0 * result.hides_a_cycle.mean():.0f}"


def test_rates_of_the_tests_are_those_of_the_page():
    n = 20_000
    rates = study().rates_of_tests(np.random.default_rng(7), n)
    for k, row in enumerate(tables()[0]):
        for counted, committed in ((rates[0, k], float(row[3])), (rates[1, k], float(row[4]))):
            scatter = np.sqrt(committed * (1.0 - committed) / n)
            assert abs(counted - committed) < 4.5 * scatter + 2.0 / n


def test_levels_hold_as_the_page_says():
    module = study()
    exceeded, total = module.levels_without_faults(np.random.default_rng(8), 6000, module.RISKS[:2])
    for row, committed in zip(exceeded, tables()[2], strict=False):
        stated = float(committed[0])
        assert np.all(np.abs(row - stated * total) < 4.5 * np.sqrt(stated * total) + 1.0)
    for row in tables()[3]:
        allowed = float(row[8])
        assert all(float(beyond) <= allowed for beyond in row[9:13])
    prior, risk = module.WORST
    for row in tables()[4]:
        assert all(4.0 * prior * float(share) < risk for share in row[2:5])


@pytest.mark.parametrize(("risk", "column"), [(1e-1, 1), (1e-2, 1), (1e-3, 1), (1e-4, 1), (1e-5, 1)])
def test_a_million_epochs_stay_within_the_stated_risk(risk, column):
    """Counts of the committed table: the level is exceeded as often as stated, within its scatter."""
    rows = {float(row[0]): row for row in tables()[2]}
    stated = float(rows[risk][4])
    for cell in rows[risk][column : column + 3]:
        assert abs(float(cell) - stated) < 4.5 * np.sqrt(stated) + 1.0


@pytest.mark.jit
def test_levels_hold_from_raw_phases():
    """A minute of the vehicle whose noise is declared right: no error beyond the level of 1e-5."""
    module = study()
    module.SCENARIOS = ("wang-vehicle",)
    ((_, epochs, passed, wrong, _, _, _, _, levels),) = module.multipath_rows(2002, 60.0)
    assert epochs >= 60
    # One in fifty right epochs fails the tests.
    assert passed > 0.8 * epochs
    assert wrong == 0
    for risk, _, _, beyond, *_ in levels:
        if risk <= 1e-5:
            assert not beyond.any()
