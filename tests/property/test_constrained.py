"""The constrained search is exact: against brute force, and the tree against the sphere.

The brute force knows nothing of secular equations or trees: it enumerates a box of integers around the
true ones and minimises the full weighted adjustment over a dense set of directions, then by Newton
steps in two angles (and the length, where that is an observation).
"""

import importlib.util
import itertools
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from truenorth.ambiguity.constrained import resolve_constrained, search_on_sphere
from truenorth.ambiguity.lambda_ import resolve_lambda
from truenorth.ambiguity.model import DoubleDifferences
from truenorth.errors import Reason, Status

TOOLS = Path(__file__).parents[2] / "tools"


def load(name):
    """A module of tools/, which is no package."""
    spec = importlib.util.spec_from_file_location(name, TOOLS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(name, module)
    spec.loader.exec_module(module)
    return module


engine_run = load("engine_run")


def draw_problem(seed, n_sats, length_m=1.0, length_sd_m=0.0, phase_sd_m=0.003, code_sd_m=0.3, n_groups=1):
    """A random sky with unequal variances, one or two frequencies; the rows of single differences too."""
    rng = np.random.default_rng(seed)
    azimuth = rng.uniform(0.0, 2.0 * np.pi, n_sats)
    up = rng.uniform(0.2, 1.0, n_sats)
    direction = np.column_stack([np.sqrt(1 - up**2) * np.sin(azimuth), np.sqrt(1 - up**2) * np.cos(azimuth), up])
    heading, sine = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-1.0, 1.0)
    size = length_m + length_sd_m * rng.standard_normal()
    level = np.sqrt(1.0 - sine**2)
    baseline = size * np.array([level * np.sin(heading), level * np.cos(heading), sine])
    wavelength = np.repeat([0.190293673, 0.244210213][:n_groups], n_sats)
    group = np.repeat(np.arange(n_groups), n_sats)
    design = -np.tile(direction, (n_groups, 1))
    n = len(group)
    factor = rng.uniform(0.5, 2.0, n)
    phase_variance, code_variance = 2.0 * factor * phase_sd_m**2, 2.0 * factor * code_sd_m**2
    integers = rng.integers(-9, 10, n)
    phase = design @ baseline + wavelength * integers + np.sqrt(phase_variance) * rng.standard_normal(n)
    code = design @ baseline + np.sqrt(code_variance) * rng.standard_normal(n)
    operator = np.zeros((n - n_groups, n))
    rows = [i for i in range(n) if i % n_sats]
    for j, i in enumerate(rows):
        operator[j, i], operator[j, i - i % n_sats] = 1.0, -1.0
    problem = DoubleDifferences(
        phase_m=operator @ phase,
        design=operator @ design,
        wavelength_m=wavelength[rows],
        cov_phase_m2=(operator * phase_variance) @ operator.T,
        code_m=operator @ code,
        code_design=operator @ design,
        cov_code_m2=(operator * code_variance) @ operator.T,
        length_m=length_m,
        length_sd_m=length_sd_m,
    )
    singles = engine_run.Rows(
        start=np.array([0, n]), phase_m=phase, code_m=code, design=design, wavelength_m=wavelength,
        phase_variance_m2=phase_variance, code_variance_m2=code_variance, group=group, arc=np.arange(n),
    )  # fmt: skip
    return problem, singles, (operator @ integers).astype(np.int64)


def whitened(problem, integers, use_code):
    """Rows A, y with cost(b) = |y - A b|^2 (+ length term): phases, and codes above their own least."""
    root = np.linalg.inv(np.linalg.cholesky(problem.cov_phase_m2))
    a, y = root @ problem.design, root @ (problem.phase_m - problem.wavelength_m * integers)
    if use_code:
        root = np.linalg.inv(np.linalg.cholesky(problem.cov_code_m2))
        h = root @ problem.code_design
        # Only what the codes say of the baseline: their residuals without integers are a constant.
        a, y = np.vstack([a, h]), np.concatenate([y, h @ np.linalg.pinv(h) @ root @ problem.code_m])
    return a, y


_N = 20_000
_TURN = np.pi * (1 + 5**0.5) * np.arange(_N)
_UP = 1.0 - (2.0 * np.arange(_N) + 1.0) / _N
SPIRAL = np.column_stack([np.sqrt(1 - _UP**2) * np.cos(_TURN), np.sqrt(1 - _UP**2) * np.sin(_TURN), _UP])


def brute_minimum(a, y, start, length, length_sd):
    """Local minimum of the adjustment with the length, from a start near it; angles and no multiplier."""
    from scipy.optimize import least_squares

    tight = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15, "x_scale": "jac"}
    if length_sd > 0.0:
        found = least_squares(
            lambda b: np.append(y - a @ b, (np.linalg.norm(b) - length) / length_sd), start, **tight
        )
        return 2.0 * found.cost, found.x
    frame = np.vstack([start / np.linalg.norm(start), np.linalg.svd(start[None])[2][1:]])

    def point(x):
        return length * np.array([np.cos(x[0]) * np.cos(x[1]), np.sin(x[0]) * np.cos(x[1]), np.sin(x[1])]) @ frame

    found = least_squares(lambda x: y - a @ point(x), np.zeros(2), **tight)
    return 2.0 * found.cost, point(found.x)


def brute_two_best(problem, use_code):
    """Two least objectives over all integers that any baseline of this length can reach, and the best's."""
    length, sd = problem.length_m, problem.length_sd_m
    reach = np.linalg.norm(problem.design, axis=1) * (length + 6 * sd)
    reach = reach + 6 * np.sqrt(np.diag(problem.cov_phase_m2))
    low = np.ceil((problem.phase_m - reach) / problem.wavelength_m).astype(int)
    high = np.floor((problem.phase_m + reach) / problem.wavelength_m).astype(int)
    vectors = np.array(list(itertools.product(*(range(i, j + 1) for i, j in zip(low, high, strict=True)))))
    least, starts = np.empty(len(vectors)), np.empty((len(vectors), 3))
    shells = length + sd * np.array([-3, -1.5, 0, 1.5, 3] if sd > 0.0 else [0])
    points = np.concatenate([size * SPIRAL for size in shells])
    rest = np.repeat(((shells - length) / sd) ** 2 if sd > 0.0 else np.zeros(1), _N)
    a, _ = whitened(problem, vectors[0], use_code)
    rest = rest + np.sum((points @ a.T) ** 2, axis=1)
    for k, integers in enumerate(vectors):
        _, y = whitened(problem, integers, use_code)
        cost = y @ y + rest - 2.0 * points @ (a.T @ y)
        best = np.argmin(cost)
        least[k], starts[k] = cost[best], points[best]
    # No point lies further from the grid than this, which bounds what the grid may miss.
    gap = 2.0 * shells.max() / np.sqrt(_N) + 0.75 * sd
    slack = np.linalg.eigvalsh(a.T @ a)[-1] * gap**2 / 2.0 + (gap / sd) ** 2 / 2.0 if sd > 0.0 else (
        np.linalg.eigvalsh(a.T @ a)[-1] * gap**2 / 2.0
    )
    found = []
    for k in np.argsort(least):
        if len(found) >= 2 and least[k] > sorted(c for c, _, _ in found)[1] + slack:
            break
        _, y = whitened(problem, vectors[k], use_code)
        found.append((*brute_minimum(a, y, starts[k], length, sd), vectors[k]))
        if len(found) > 60:
            break
    found.sort(key=lambda item: item[0])
    return found


@pytest.mark.parametrize("use_code", [True, False], ids=["code", "phase"])
@pytest.mark.parametrize("length_sd_m", [0.0, 0.01], ids=["exact", "sd"])
@pytest.mark.parametrize("n_sats", [4, 5, 6])
def test_both_searches_find_the_optimum_of_brute_force(n_sats, length_sd_m, use_code):
    # More satellites have more integers to enumerate, so their baselines are shorter.
    length = {4: 0.30, 5: 0.22, 6: 0.15}[n_sats]
    for seed in range(3):
        problem, _, _ = draw_problem([seed, n_sats], n_sats, length, length_sd_m, phase_sd_m=0.008)
        found = brute_two_best(problem, use_code)
        tree = resolve_constrained(problem, use_code=use_code)
        sphere = search_on_sphere(problem, use_code=use_code)
        for result in (tree, sphere):
            if result.reason == Reason.SEARCH_VOLUME_TOO_LARGE:
                continue
            assert np.array_equal(result.integers_cyc[0], found[0][2])
            # Objectives of square millimetre residuals to a millionth; the minimisers stop at 1e-8 rad.
            assert result.objective[0] == pytest.approx(found[0][0], rel=1e-6, abs=1e-6)
            assert result.baseline_enu_m[0] == pytest.approx(found[0][1], abs=1e-5)
        if tree.ratio * tree.objective[0] < tree.objective[0] + 29.0:
            assert tree.ratio * tree.objective[0] == pytest.approx(found[1][0], rel=1e-6, abs=1e-6)
