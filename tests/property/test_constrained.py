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

from truenorth.ambiguity import lambda_
from truenorth.ambiguity.constrained import resolve_constrained, search_on_sphere
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
    direction = np.column_stack(
        [np.sqrt(1 - up**2) * np.sin(azimuth), np.sqrt(1 - up**2) * np.cos(azimuth), up]
    )
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
        return (
            length
            * np.array([np.cos(x[0]) * np.cos(x[1]), np.sin(x[0]) * np.cos(x[1]), np.sin(x[1])])
            @ frame
        )

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
    slack = (
        np.linalg.eigvalsh(a.T @ a)[-1] * gap**2 / 2.0 + (gap / sd) ** 2 / 2.0
        if sd > 0.0
        else (np.linalg.eigvalsh(a.T @ a)[-1] * gap**2 / 2.0)
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
        problem, _, _ = draw_problem([seed, n_sats], n_sats, length, length_sd_m, phase_sd_m=0.006)
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


seeds = st.integers(0, 10**6)


@given(
    seed=seeds,
    n_sats=st.integers(4, 7),
    n_groups=st.integers(1, 2),
    use_code=st.booleans(),
    length_sd_m=st.sampled_from([0.0, 0.001, 0.005]),
    length_m=st.sampled_from([0.1, 0.33, 1.0]),
)
def test_tree_and_sphere_agree(seed, n_sats, n_groups, use_code, length_sd_m, length_m):
    problem, _, _ = draw_problem(seed, n_sats, length_m, length_sd_m, 0.002, 0.3, n_groups)
    sphere = search_on_sphere(problem, use_code=use_code)
    assume(sphere.reason != Reason.SEARCH_VOLUME_TOO_LARGE)
    tree = resolve_constrained(problem, use_code=use_code)
    assert (tree.reason, tree.status) == (sphere.reason, sphere.status)
    assert np.array_equal(tree.integers_cyc[0], sphere.integers_cyc[0])
    # Objectives are sums of squares of metres over square millimetres: 1e-9 of their terms remains.
    assert tree.objective[0] == pytest.approx(sphere.objective[0], rel=1e-6, abs=1e-6)
    assert tree.baseline_enu_m == pytest.approx(sphere.baseline_enu_m[:1], abs=1e-7)
    # The sphere lists candidates as far as its grid proves them, at least 10 above the best.
    if tree.ratio * tree.objective[0] < tree.objective[0] + 9.0:
        assert tree.ratio == pytest.approx(sphere.ratio, rel=1e-5)
    assert tree.success_probability == pytest.approx(sphere.success_probability, abs=0.01)


@given(
    seed=seeds, n_sats=st.integers(5, 8), use_code=st.booleans(), length_sd_m=st.sampled_from([0.0, 0.003])
)
def test_engine_agrees_with_the_adjustment_of_double_differences(seed, n_sats, use_code, length_sd_m):
    problem, singles, _ = draw_problem(seed, n_sats, 1.0, length_sd_m, n_groups=2)
    one = resolve_constrained(problem, use_code=use_code)
    run = engine_run.run_engine(
        singles, use_code=use_code, length_m=1.0, length_sd_m=length_sd_m, margin=30.0, cap_factor=20.0
    )
    rows = np.flatnonzero(np.arange(2 * n_sats) % n_sats)
    assert np.array_equal(run.integer_cyc[rows], one.integers_cyc[0])
    assert run.cost[0] == pytest.approx(one.objective[0], rel=1e-7, abs=1e-6)
    assert run.baseline_m[0] == pytest.approx(one.baseline_enu_m[0], abs=1e-8)
    assert run.probability[0] == pytest.approx(one.success_probability, abs=1e-6)
    # The engine gives an exact length a tenth of a micrometre.
    assert run.cov_m2[0] == pytest.approx(one.cov_baseline_m2, rel=1e-5, abs=2e-14)


@given(seed=seeds, n_sats=st.integers(5, 9), code_sd_m=st.sampled_from([0.1, 0.3, 1.0]))
def test_engine_without_the_length_is_lambda(seed, n_sats, code_sd_m):
    problem, singles, _ = draw_problem(seed, n_sats, code_sd_m=code_sd_m, n_groups=2)
    # Windows so wide that what they cut off of the posterior does not matter.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lambda_, "POSTERIOR_WINDOW", 50.0)
        one = lambda_.resolve_lambda(problem)
    run = engine_run.run_engine(
        singles, length_m=1.0, use_length=False, margin=50.0, cap_factor=20.0, ratio_mode=1, ratio_limit=3.0
    )
    rows = np.flatnonzero(np.arange(2 * n_sats) % n_sats)
    assert np.array_equal(run.integer_cyc[rows], one.integers_cyc[0])
    assert run.cost[0] == pytest.approx(one.objective[0], rel=1e-7, abs=1e-6)
    assert run.baseline_m[0] == pytest.approx(one.baseline_enu_m[0], abs=1e-8)
    assert run.cov_m2[0] == pytest.approx(one.cov_baseline_m2, rel=1e-6, abs=1e-12)
    # Costs of two ways of arithmetic, with codes of a metre beside phases of millimetres, agree to 1e-8.
    assert run.probability[0] == pytest.approx(one.success_probability, abs=1e-7)
    # Further than the test looks the engine's ratio is only a lower bound.
    if one.ratio < 3.0:
        assert run.ratio[0] == pytest.approx(one.ratio, rel=1e-6)
    else:
        assert 3.0 <= run.ratio[0] <= one.ratio * (1.0 + 1e-6)


def shell_cost(centre, information, length, variance, b):
    """The function that `nearest_on_shell` minimises, over baselines (..., 3)."""
    cost = np.sum(information * (b - centre) ** 2, axis=-1)
    if variance > 0.0:
        cost = cost + (np.linalg.norm(b, axis=-1) - length) ** 2 / variance
    return cost


def brute_shell(centre, information, length, variance):
    """Its least value over a dense shell, polished from the three lowest points."""
    root = np.diag(np.sqrt(information))
    sizes = [length]
    if variance > 0.0:
        sizes = np.linspace(0.0, 2.0 * (length + np.linalg.norm(centre)), 201)[1:]
    starts = [size * SPIRAL[:: 1 if variance == 0.0 else 50] for size in sizes]
    points = np.concatenate(starts)
    cost = shell_cost(centre, information, length, variance, points)
    best = [
        brute_minimum(root, root @ centre, points[k], length, np.sqrt(variance))[0]
        for k in np.argsort(cost)[:3]
    ]
    return min(best)


CENTRES = {
    "outside": (0.9, -1.2, 0.8),
    "inside": (0.2, 0.3, -0.1),
    "zero": (0.0, 0.0, 0.0),
    "on the weak axis": (0.4, 0.0, 0.0),
    "on the middle axis, close in": (0.0, 0.1, 0.0),
    "on the middle axis, far out": (0.0, 3.0, 0.0),
    "on the stiff axis, close in": (0.0, 0.0, 0.1),
    "in the stiff plane": (0.0, 0.3, 0.2),
    "nearly in the stiff plane": (1e-13, 0.3, 0.2),
    "hardly off the stiff plane": (-1e-7, 0.3, 0.2),
    "on the sphere": (0.6, 0.0, 0.8),
}


@pytest.mark.parametrize("centre", CENTRES.values(), ids=CENTRES.keys())
@pytest.mark.parametrize("variance", [0.0, 1e-6, 0.01, 0.5])
@pytest.mark.parametrize(
    "information", [(4.0, 20.0, 900.0), (5.0, 5.0, 5.0), (5.0, 5.0, 80.0), (1e-3, 7.0, 7.0)]
)
def test_nearest_on_shell_is_the_global_minimum(centre, variance, information):
    from truenorth._kernels.constrained import nearest_on_shell

    centre, information = np.array(centre), np.array(information)
    b = np.empty(3)
    nu, inner = nearest_on_shell(centre, information, 1.0, variance, b)
    assert inner == pytest.approx(shell_cost(centre, information, 1.0, variance, b), rel=1e-9, abs=1e-12)
    assert np.linalg.norm(b) * (1.0 - nu * variance) == pytest.approx(1.0, abs=1e-9)
    assert -information[0] * (1.0 + 1e-12) <= nu
    # The value is attained by a baseline of that length, so it need only not exceed what others attain.
    assert inner <= brute_shell(centre, information, 1.0, variance) * (1.0 + 1e-9) + 1e-10


@given(
    centre=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    information=st.tuples(*[st.floats(-3.0, 6.0)] * 3),
    length=st.floats(0.05, 10.0),
    deviation=st.sampled_from([0.0, 1e-4, 0.01, 0.3]),
)
def test_nearest_on_shell_solves_the_secular_equation(centre, information, length, deviation):
    from truenorth._kernels.constrained import nearest_on_shell

    centre, information = np.array(centre), np.sort(10.0 ** np.array(information))
    b = np.empty(3)
    nu, inner = nearest_on_shell(centre, information, length, deviation**2, b)
    # The root lies where the Hessian is not negative, which makes it the global minimum.
    assert nu >= -information[0] * (1.0 + 1e-9)
    assert np.linalg.norm(b) * (1.0 - nu * deviation**2) == pytest.approx(length, rel=1e-6)
    gradient = information * (b - centre) + nu * b
    assert np.abs(gradient) == pytest.approx(0.0, abs=1e-6 * information[2] * (length + 6.0))
    # No better than the bounds of any baseline of that length.
    short = (np.linalg.norm(centre) - length) ** 2
    assert inner >= short / (1.0 / information[0] + deviation**2) * (1.0 - 1e-9) - 1e-9
    assert inner <= short / (1.0 / information[2] + deviation**2) * (1.0 + 1e-9) + 1e-9


@pytest.mark.parametrize("n_codes", [2, 3])
def test_few_codes_count_from_their_own_least(n_codes):
    # One or two double differences of code do not determine a baseline, yet they tell of it.
    problem, singles, _ = draw_problem(21, 6)
    told = replace(
        problem,
        code_m=problem.code_m[: n_codes - 1],
        code_design=problem.code_design[: n_codes - 1],
        cov_code_m2=problem.cov_code_m2[: n_codes - 1, : n_codes - 1],
    )
    tree, sphere = resolve_constrained(told), search_on_sphere(told)
    code_m = np.where(np.arange(6) < n_codes, singles.code_m, np.nan)
    run = engine_run.run_engine(replace(singles, code_m=code_m), length_m=1.0, margin=30.0, cap_factor=20.0)
    assert tree.objective[0] == pytest.approx(sphere.objective[0], rel=1e-7)
    # The engine finds the least of such codes with a millionth of their information added.
    assert run.cost[0] == pytest.approx(tree.objective[0], rel=1e-4)
    assert run.ratio[0] == pytest.approx(tree.ratio, rel=1e-4)
    assert run.probability[0] == pytest.approx(tree.success_probability, abs=1e-6)


def test_a_prior_direction_counts_in_both_searches():
    problem, _, truth = draw_problem(11, 4, 1.0, phase_sd_m=0.002)
    plain = resolve_constrained(problem, use_code=False)
    cov = np.diag([0.02, 0.02, 0.02]) ** 2
    true_b = np.linalg.lstsq(problem.design, problem.phase_m - problem.wavelength_m * truth, rcond=None)[0]
    told = replace(problem, prior_baseline_enu_m=true_b, cov_prior_m2=cov)
    tree, sphere = resolve_constrained(told, use_code=False), search_on_sphere(told, use_code=False)
    assert plain.success_probability < 0.9
    assert tree.status == Status.FIXED
    assert np.array_equal(tree.integers_cyc[0], truth)
    assert tree.objective == pytest.approx(sphere.objective[:1], rel=1e-8)
    assert tree.success_probability == pytest.approx(sphere.success_probability, abs=1e-6)


def test_without_a_length_it_is_lambda():
    problem, _, _ = draw_problem(5, 8)
    free = replace(problem, length_m=np.nan)
    ours, theirs = resolve_constrained(free), lambda_.resolve_lambda(free)
    assert np.array_equal(ours.integers_cyc[0], theirs.integers_cyc[0])
    assert resolve_constrained(free, use_code=False).reason == Reason.NO_CODE
    assert search_on_sphere(free).reason == Reason.TOO_FEW_SATELLITES


def test_refusals_are_reasons():
    problem, _, _ = draw_problem(5, 8)
    assert search_on_sphere(problem, max_points=100).reason == Reason.SEARCH_VOLUME_TOO_LARGE
    assert resolve_constrained(problem, max_nodes=3).reason == Reason.SEARCH_LIMIT
    assert resolve_constrained(problem, success_probability=1.1).reason == Reason.PROBABILITY_TEST
    assert resolve_constrained(replace(problem, length_m=1.5)).status != Status.FIXED
    noisy = replace(
        problem, phase_m=problem.phase_m + 0.02 * (np.arange(7) % 2), cov_phase_m2=problem.cov_phase_m2
    )
    assert resolve_constrained(noisy, use_code=False).reason in (Reason.RESIDUAL_TEST, Reason.NO_CANDIDATE)
