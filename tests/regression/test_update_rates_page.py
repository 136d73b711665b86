"""The page of update rates against its own study, run again at 1 Hz."""

import importlib.util
import re
from pathlib import Path

import pytest

from truenorth.evaluation import compare_rates
from truenorth.simulation import simulate

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.jit
def test_the_table_of_one_hertz_comes_out_again():
    spec = importlib.util.spec_from_file_location("study", ROOT / "tools" / "study_update_rates.py")
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    simulation = simulate(tool.SCENARIO)
    numbers = compare_rates(simulation, [1.0], simulation.truth).results[0].numbers()
    text = (ROOT / "docs" / "validation" / "update_rates.md").read_text(encoding="utf-8")
    first = text.split("\n## ")[2]
    assert first.startswith(next(iter(tool.CASES)))
    compared = 0
    for key, (label, factor, _) in tool.LINES.items():
        row = re.search(rf"^\| {re.escape(label)} \| ([^|]+) \|", first, re.MULTILINE)
        if row is not None:
            # The solver may change a little; what the page concludes may not: five per cent and a digit.
            assert numbers[key] * factor == pytest.approx(float(row.group(1)), rel=0.05, abs=0.1), label
            compared += 1
    assert compared >= 15
