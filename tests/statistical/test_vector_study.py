"""The study of methods and guards against its committed page and the figures it was made after."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]


def load(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


study = load("study_vector_methods")
PAGE = (ROOT / "docs" / "validation" / "vector_methods.md").read_text(encoding="utf-8")
TRIALS, WRONG = (int(re.search(rf"--{key} (\d+)", PAGE)[1]) for key in ("trials", "wrong"))


def rows(heading):
    """Cells of the table under a heading, without its head."""
    part = PAGE.split(f"## {heading}")[1].split("\n## ")[0]
    table = [line.strip("| ").split(" | ") for line in part.splitlines() if line.startswith("| ")]
    return [row for row in table[1:] if row[0].strip("-")]


def numbers(cell):
    return [float(word) for word in re.findall(r"[\d.]+", cell)]


def test_the_page_has_the_figures_that_are_known():
    """Standard deviations of the reference geometry, and the misses of a fixed 5 degrees."""
    table = {
        tuple(row[:3]): [numbers(cell)[0] for cell in row[3:]] for row in rows("The published methods")[0:]
    }
    for key, expected in (
        (("equal", "3", "direct"), (0.522, 0.526, 0.520)),
        (("equal", "3", "triad"), (0.520, 0.527, 0.518)),
        (("equal", "3", "wahba"), (0.517, 0.524, 0.370)),
        (("equal", "4", "pseudoinverse"), (0.520, 0.527, 0.578)),
        (("equal", "4", "wahba"), (0.520, 0.304, 0.262)),
    ):
        # Both from 40,000 draws: 0.5 % of the difference, four times.
        np.testing.assert_allclose(table[key], expected, rtol=0.02, atol=6e-4)
    # Least-squares candidates of 3 mm, ratio not asked: an independent count of some hundred each.
    for row in rows("A wrong vector"):
        one, all_three = numbers(row[3])[0], numbers(row[4])[0]
        expected = {"5": (12.0, 2.0), "6": (9.0, 0.0), "7": None}[row[0]]
        if expected is not None:
            assert abs(one - expected[0]) < 6.0
            assert abs(all_three - expected[1]) < 2.5
        # A wrong integer turns the vector by 13.6 degrees or more.
        assert float(row[1]) > 13.0


def test_the_default_is_never_worse_on_the_page():
    table = rows("The published methods")
    best = {tuple(row[:2]): [numbers(cell)[0] for cell in row[3:]] for row in table if row[2] == "adjustment"}
    for row in table:
        ours = best[tuple(row[:2])]
        assert all(numbers(cell)[0] >= 0.999 * ours[k] - 6e-4 for k, cell in enumerate(row[3:]))


@pytest.mark.parametrize(("errors", "method"), [("equal", "pseudoinverse"), ("sky", "adjustment")])
def test_a_small_run_agrees_with_the_committed_methods(errors, method):
    n = 4000
    cov = 1e-4 * np.eye(3) if errors == "equal" else 0.0035**2 * study.antenna_covariance(7)
    found, stated = study.method_spread(method, 4, cov, n, seed=1)
    (row,) = [row for row in rows("The published methods") if row[:3] == [errors, "4", method]]
    expected = np.array([numbers(cell) for cell in row[3:]])
    # A standard deviation from 4000 draws is good to 1.1 %.
    np.testing.assert_allclose(found, expected[:, 0], rtol=0.05)
    np.testing.assert_allclose(stated, expected[:, 1], rtol=0.01, atol=6e-4)


def test_a_small_run_agrees_with_the_committed_guards():
    n = 30
    vector_m, turn_deg = study.wrong_vectors(6, n, seed=1)
    detected, named = study.alarms(vector_m, 6)
    (row,) = [row for row in rows("A wrong vector") if row[0] == "6"]
    for guard, cell in zip(study.GUARDS, row[3:], strict=True):
        share = numbers(cell)[0] / 100.0
        sd = np.sqrt(max(share * (1.0 - share), 1.0 / n) / n)
        assert abs(np.mean(~detected[guard]) - share) < 4.5 * sd
    assert np.min(turn_deg) > 13.0
    assert np.mean(named["chi2 three"] == 1) > 0.8
