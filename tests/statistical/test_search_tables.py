"""The classical searches against their committed tables and the literature's figures, in small."""

import importlib.util
import re
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]


def load(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(name, module)
    spec.loader.exec_module(module)
    return module


anchors = load("make_lsast_anchors")
load("circular_sky")


def committed_table():
    """Shares in per cent and headings of the committed page."""
    text = (ROOT / "docs" / "validation" / "lsast_anchors.md").read_text()
    headings = int(re.search(r"--headings (\d+)", text)[1])
    rows = re.findall(r"^\| (\d) \| ([\d.]+) \| ([\d.]+)[^|]*\| ([\d.]+)[^|]*\| ([\d.]+)[^|]*\|$", text, re.M)
    return headings, {(int(n), float(s)): tuple(map(float, v)) for n, s, *v in rows}


def z_score(hits, n, share, n_share):
    """Difference of an observed share from one observed elsewhere, in standard deviations."""
    pooled = (hits + share * n_share) / (n + n_share)
    # A share of 0 or 1 has no spread; one hit more or less stands for it.
    sd = np.sqrt(max(pooled * (1.0 - pooled), 1.0 / (n + n_share)) * (1.0 / n + 1.0 / n_share))
    return (hits / n - share) / sd


def test_committed_table_agrees_with_the_independent_implementation():
    headings, table = committed_table()
    assert set(table) == set(anchors.CASES)
    scores = []
    for n, s, right, accepted, both in anchors.REFERENCE:
        ours = table[n, s]
        scores.append(z_score(headings * ours[0] / 100, headings, right / 100, 400))
        scores.append(z_score(headings * ours[1] / 100, headings, accepted / 100, 400))
        n_ours, n_theirs = headings * ours[1] / 100, 4 * accepted
        scores.append(z_score(n_ours * ours[2] / 100, n_ours, both / 100, n_theirs))
    # 18 comparisons at a false alarm of 1e-4 in all.
    assert np.max(np.abs(scores)) < 4.4


@pytest.mark.parametrize(("n_satellites", "sd_mm"), [(7, 1.0), (7, 4.0), (6, 2.0), (5, 2.0)])
def test_small_run_agrees_with_the_committed_table(n_satellites, sd_mm):
    headings, table = committed_table()
    n = 150
    right, accepted, _ = anchors.shares(n_satellites, sd_mm, n, seed=1)
    share = table[n_satellites, sd_mm]
    assert abs(z_score(right, n, share[0] / 100, headings)) < 4.0
    assert abs(z_score(accepted, n, share[1] / 100, headings)) < 4.0
