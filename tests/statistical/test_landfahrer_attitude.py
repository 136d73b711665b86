"""The drives of Landfahrer's thesis on the emulator against their committed page, in small."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

from truenorth.evaluation import compare

ROOT = Path(__file__).parents[2]


def load(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


study = load("study_landfahrer_attitude")
PAGE = (ROOT / "docs" / "validation" / "landfahrer_2009.md").read_text(encoding="utf-8")


def rows(heading, table=0):
    """Cells of a table under a heading, without its head."""
    part = PAGE.split(f"## {heading}")[1].split("\n## ")[0]
    blocks = re.findall(r"(?:^\|.*\n)+", part, re.M)
    return [line.strip("| ").split(" | ") for line in blocks[table].splitlines()[2:]]


def test_the_page_loses_no_attitude_with_a_receiver():
    for drive, case, epochs, possible, accepted, without, _, wrong, *_ in rows("Availability"):
        assert int(wrong) == 0, (drive, case)
        if drive == "OEAMTC":
            assert int(epochs) == 9601
            # Two antennas alone give a direction only.
            assert int(without) == 0 or float(accepted) == pytest.approx(float(possible), abs=1.0)
            if case != study.CASES[-1]:
                assert int(without) == 0
    for drive, case, event, without, *_ in rows("Availability", 1):
        if case != study.CASES[-1]:
            assert int(without) == 0, (drive, case, event)


def test_the_page_is_better_than_published_and_than_the_published_methods():
    for case, drive, angle, _, sd, _, _, _, published, _ in rows("Against the published"):
        assert float(sd) < float(published), (case, drive, angle)
    for drive, antennas, method, _, *numbers in rows("The published methods"):
        ratio = np.array(numbers[3:], float)
        if method.startswith(("two vectors", "orthogonalised", "pseudoinverse")):
            assert np.all(ratio > 0.98), (drive, antennas, method)
            if antennas == "4":
                # Pitch and heading gain the long arm.
                assert np.all(ratio[1:] > 1.3), (drive, antennas, method)


@pytest.mark.jit
def test_the_first_receiver_dies_and_returns_in_a_small_run():
    case = study.CASES[3]
    session, solution = study.drive("landfahrer-oeamtc", case, 7, 24.0)
    comparison = compare(solution, session.truth, wrong_deg=study.WRONG_DEG)
    assert comparison.expected_epochs == 481
    assert comparison.is_accepted.all()
    assert comparison.n_epochs == 481
    assert not comparison.is_wrong.any()
    used = solution.is_used[:, 0]
    assert used[:159].all()
    assert not used[161:319].any()
    # Three seconds until it tracks again, three epochs until its integers repeat.
    assert used[-80:].all()
    (row,) = [r for r in rows("Availability") if r[:2] == ["OEAMTC", case]]
    rms = [comparison.statistics["accepted"][angle].rms for angle in study.ANGLES]
    # Multipath with a memory of 2 s while moving: a dozen independent values, and more noise in some circles.
    np.testing.assert_allclose(rms, [float(cell) for cell in row[8:11]], rtol=0.6)


@pytest.mark.jit
def test_the_published_methods_in_a_small_run():
    session, solution = study.drive("landfahrer-oeamtc", study.CASES[0], 8, 20.0)
    errors, n = study.by_methods(solution, session.truth)
    assert n == 401
    best = np.std(errors["joint solution"], axis=0, ddof=1)
    np.testing.assert_allclose(np.std(errors["adjustment"], axis=0, ddof=1), best, rtol=0.02)
    order = [study.COLUMN[angle] for angle in study.ANGLES]
    committed = {
        r[2]: np.array(r[4:7], float) for r in rows("The published methods") if r[:2] == ["OEAMTC", "4"]
    }
    for name in ("two vectors and their cross product", "orthogonalised triad (the thesis)", "pseudoinverse"):
        rms = np.sqrt(np.mean(errors[name] ** 2, axis=0))[order]
        # Multipath with a memory of 2 s and a reflection that turns with the car: ten values, or fewer.
        np.testing.assert_array_less(rms, 2.5 * committed[name])
        np.testing.assert_array_less(committed[name] / 2.5, rms)
        assert np.all(np.std(errors[name], axis=0, ddof=1)[[0, 1]] > 1.2 * best[[0, 1]])
