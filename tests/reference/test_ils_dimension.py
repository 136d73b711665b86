"""Searches at 20 to 60 ambiguities: complete, proved by another search, and as the committed study says.

The study (`tools/study_ils_dimension.py`) compares with RTKLIB; its table is in
docs/validation/ils_dimension.md.
"""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

from truenorth.ambiguity.lambda_ import decorrelate, integer_least_squares

ROOT = Path(__file__).resolve().parents[2]


def load_tool(name):
    """A module of tools/, which is no package."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


float_covariance = load_tool("model_geometry").float_covariance


def study_rows():
    """Rows of the committed table, numbers as printed."""
    text = (ROOT / "docs" / "validation" / "ils_dimension.md").read_text()
    rows = re.findall(
        r"^\| (\d+) \| (\d+) \| (\d+) of (\d+) \| ([\d.]+) \| ([\d,]+) \| ([\d,]+) \|.*?"
        r"\| (\d+) \| (\d+) of (\d+) \|$",
        text,
        re.MULTILINE,
    )
    return [tuple(float(cell.replace(",", "")) for cell in row) for row in rows]


def integers_within(cov_z, z_hat, bound):
    """All integer vectors within the ellipsoid, by a plain recursion with ranges (Fincke & Pohst 1985)."""
    # Q^-1 = R^T R with R upper triangular: the last component stands alone.
    upper = np.linalg.cholesky(np.linalg.inv(cov_z)).T
    found = []

    def descend(k, z, left):
        if k < 0:
            found.append(z.copy())
            return
        shift = upper[k, k + 1 :] @ (z[k + 1 :] - z_hat[k + 1 :]) / upper[k, k]
        half = np.sqrt(left) / upper[k, k]
        for integer in range(
            int(np.ceil(z_hat[k] - shift - half)), int(np.floor(z_hat[k] - shift + half)) + 1
        ):
            z[k] = integer
            part = (upper[k, k] * (integer - z_hat[k] + shift)) ** 2
            if part <= left:
                descend(k - 1, z, left - part)

    descend(len(z_hat) - 1, np.zeros(len(z_hat)), bound)
    return np.array(found)


@pytest.mark.parametrize("n", [30, 40, 60])
def test_the_two_best_are_the_only_ones_within_their_bound(n):
    rng = np.random.default_rng(n)
    for _ in range(2):
        cov = float_covariance(n, 3, rng=rng)
        floats = np.linalg.cholesky(cov) @ rng.standard_normal(n)
        best = integer_least_squares(floats, cov, 2)
        assert best.is_complete
        decorrelation = decorrelate(cov)
        bound = best.cost[1] * (1.0 + 1e-9)
        z = integers_within(decorrelation.cov_z_cyc2(), decorrelation.to_z(floats), bound)
        integers = np.rint(decorrelation.from_z(z)).astype(np.int64)
        assert sorted(integers.tolist()) == sorted(best.integers_cyc.tolist())


@pytest.mark.parametrize("n_bands", [1, 2])
@pytest.mark.parametrize("n", [20, 30, 40, 60])
def test_searches_complete_as_the_study_says(n, n_bands):
    row = next(r for r in study_rows() if (r[0], r[1]) == (n, n_bands))
    rng = np.random.default_rng([n, n_bands, 7])
    nodes = []
    for _ in range(15):
        cov = float_covariance(n, n_bands, rng=rng)
        found = integer_least_squares(np.linalg.cholesky(cov) @ rng.standard_normal(n), cov, 2)
        assert found.is_complete
        nodes.append(found.n_nodes)
    # Nodes scatter by a factor of about two between skies; the median of 15 by less than 1.5.
    assert row[5] / 3 < np.median(nodes) < row[5] * 3


def test_the_committed_study_is_whole():
    rows = study_rows()
    assert [(int(r[0]), int(r[1])) for r in rows] == [(n, b) for b in (1, 2) for n in (20, 30, 40, 60)]
    for row in rows:
        assert row[2] == row[3] >= 500  # completed
        assert row[8] == row[9]  # the same as RTKLIB wherever that finished
    assert sum(row[7] for row in rows if row[0] >= 30) > 1000  # RTKLIB gave up


def test_an_unfinished_search_says_so():
    rng = np.random.default_rng(1)
    cov = float_covariance(40, 1, rng=rng)
    floats = np.linalg.cholesky(cov) @ rng.standard_normal(40)
    found = integer_least_squares(floats, cov, 2, max_nodes=1000)
    assert not found.is_complete
    assert found.n_nodes == 1000
