"""LAMBDA on one epoch of double differences: against the adjustment done in full, and its refusals."""

from dataclasses import replace

import numpy as np
import pytest

from truenorth.ambiguity.lambda_ import (
    decorrelate,
    estimate_float,
    integer_least_squares,
    partial_fix,
    resolve_lambda,
)
from truenorth.ambiguity.model import DoubleDifferences
from truenorth.errors import ConfigError, ModelError, Reason, Status

BASELINE_M = np.array([-0.22, -0.95, 0.12])
LENGTH_M = float(np.linalg.norm(BASELINE_M))


def make_problem(n_sats=9, seed=3, phase_sd_m=0.003, code_sd_m=0.3, wavelength_m=0.190293673, noise=1.0):
    """One epoch of one frequency, known baseline and integers."""
    rng = np.random.default_rng(seed)
    azimuth = np.arange(n_sats) * 2.399963  # the golden angle spreads the sky
    sin_el = np.linspace(0.97, 0.25, n_sats)
    cos_el = np.sqrt(1.0 - sin_el**2)
    unit = np.column_stack([cos_el * np.sin(azimuth), cos_el * np.cos(azimuth), sin_el])
    m = n_sats - 1
    design = -(unit[1:] - unit[0])
    cofactor = 2.0 * (np.eye(m) + 1.0)
    root = np.linalg.cholesky(cofactor)
    integers = rng.integers(-1000, 1000, m)
    phase = wavelength_m * integers + design @ BASELINE_M
    phase = phase + noise * phase_sd_m * root @ rng.standard_normal(m)
    code = design @ BASELINE_M + noise * code_sd_m * root @ rng.standard_normal(m)
    problem = DoubleDifferences(
        phase_m=phase,
        design=design,
        wavelength_m=np.full(m, wavelength_m),
        cov_phase_m2=cofactor * phase_sd_m**2,
        code_m=code,
        code_design=design,
        cov_code_m2=cofactor * code_sd_m**2,
        length_m=LENGTH_M,
        length_sd_m=0.003,
    )
    return problem, integers


def full_adjustment(problem, integers):
    """Baseline, covariance and residual square sum of phase and code with the integers known."""
    y = np.concatenate([problem.phase_m - problem.wavelength_m * integers, problem.code_m])
    a = np.vstack([problem.design, problem.code_design])
    w = np.zeros((len(y), len(y)))
    m = problem.n_phases
    w[:m, :m] = np.linalg.inv(problem.cov_phase_m2)
    w[m:, m:] = np.linalg.inv(problem.cov_code_m2)
    cov = np.linalg.inv(a.T @ w @ a)
    b = cov @ a.T @ w @ y
    v = y - a @ b
    return b, cov, v @ w @ v


def test_result_is_the_full_least_squares_adjustment():
    problem, integers = make_problem(n_sats=12)
    result = resolve_lambda(problem)
    assert (result.status, result.reason) == (Status.FIXED, Reason.OK)
    assert np.array_equal(result.integers_cyc[0], integers)
    code_only = np.linalg.inv(problem.cov_code_m2)
    v = problem.code_m - problem.code_design @ result.float_baseline_enu_m
    code_square_sum = v @ code_only @ v
    for k in range(2):
        baseline, cov, square_sum = full_adjustment(problem, result.integers_cyc[k])
        # Two ways of the same adjustment: a micrometre is rounding.
        assert result.baseline_enu_m[k] == pytest.approx(baseline, abs=1e-6)
        assert result.objective[k] == pytest.approx(square_sum - code_square_sum, rel=1e-6)
    baseline, cov, _ = full_adjustment(problem, integers)
    assert result.cov_baseline_m2 == pytest.approx(cov, rel=1e-6, abs=1e-12)
    assert result.baseline_enu_m[0] == pytest.approx(BASELINE_M, abs=5 * np.sqrt(cov.max()))
    assert result.ratio == pytest.approx(result.objective[1] / result.objective[0])
    assert result.success_probability > 0.99
    assert result.chi2 <= result.chi2_limit
    assert result.is_fixed.all()


@pytest.mark.parametrize("estimator", ["bootstrap", "round"])
def test_simpler_estimators_give_their_own_integers(estimator):
    problem, integers = make_problem(n_sats=14, code_sd_m=0.05)
    result = resolve_lambda(problem, estimator=estimator)
    assert result.status == Status.FIXED
    assert np.array_equal(result.integers_cyc[0], integers)
    assert len(result.integers_cyc) == 2
    # In a weak model they lose against least squares now and then, and the posterior says so.
    losers = 0
    for seed in range(40):
        weak, _ = make_problem(n_sats=6, seed=seed)
        own = resolve_lambda(weak, estimator=estimator)
        best = resolve_lambda(weak)
        assert own.objective[0] >= best.objective[0] * (1 - 1e-12)
        if own.objective[0] > best.objective[0] * (1 + 1e-9):
            losers += 1
            assert own.success_probability < 0.5
            assert own.status == Status.FLOAT
            assert own.ratio < 1.0
    assert losers > 0


def test_prior_baseline_replaces_code():
    problem, integers = make_problem()
    no_code = replace(problem, code_m=np.empty(0), code_design=np.empty((0, 3)), cov_code_m2=np.empty((0, 0)))
    refused = resolve_lambda(no_code)
    assert (refused.status, refused.reason) == (Status.NONE, Reason.NO_CODE)
    assert np.isnan(refused.float_baseline_enu_m).all()
    assert refused.integers_cyc.shape == (0, problem.n_phases)
    with_prior = replace(
        no_code,
        prior_baseline_enu_m=BASELINE_M + np.array([0.01, -0.02, 0.01]),
        cov_prior_m2=np.eye(3) * 0.02**2,
    )
    result = resolve_lambda(with_prior)
    assert result.status == Status.FIXED
    assert np.array_equal(result.integers_cyc[0], integers)
    assert result.float_baseline_enu_m == pytest.approx(with_prior.prior_baseline_enu_m)


def test_reasons_of_geometry():
    problem, _ = make_problem()
    few = replace(
        problem,
        code_m=problem.code_m[:2],
        code_design=problem.code_design[:2],
        cov_code_m2=problem.cov_code_m2[:2, :2],
    )
    assert resolve_lambda(few).reason == Reason.TOO_FEW_SATELLITES
    flat = replace(problem, code_design=problem.code_design * [1.0, 1.0, 0.0])
    assert resolve_lambda(flat).reason == Reason.WEAK_GEOMETRY
    assert estimate_float(flat) == Reason.WEAK_GEOMETRY
    empty = replace(
        problem,
        phase_m=np.empty(0),
        design=np.empty((0, 3)),
        wavelength_m=np.empty(0),
        cov_phase_m2=np.empty((0, 0)),
    )
    assert resolve_lambda(empty).reason == Reason.TOO_FEW_SATELLITES


def test_each_test_refuses_for_its_own_reason():
    problem, integers = make_problem(n_sats=12)
    assert resolve_lambda(replace(problem, length_m=LENGTH_M + 0.2)).reason == Reason.LENGTH_TEST
    assert resolve_lambda(replace(problem, length_m=LENGTH_M + 0.2), check_length=False).reason == Reason.OK
    bumpy = replace(problem, phase_m=problem.phase_m + 0.03 * np.eye(len(integers))[2])
    assert resolve_lambda(bumpy, success_probability=0.0, check_length=False).reason == Reason.RESIDUAL_TEST
    assert resolve_lambda(problem, max_nodes=14).reason == Reason.SEARCH_LIMIT
    assert resolve_lambda(problem, max_nodes=3).reason == Reason.SEARCH_LIMIT
    weak, _ = make_problem(n_sats=5)
    unlimited = {"residual_significance": 1e-12, "check_length": False}
    assert resolve_lambda(weak, **unlimited).reason == Reason.PROBABILITY_TEST
    for kind in ("fixed", "fixed_failure_rate", "difference"):
        result = resolve_lambda(weak, ratio_test_kind=kind, **unlimited)
        assert (result.status, result.reason) == (Status.FLOAT, Reason.RATIO_TEST)
    single = resolve_lambda(problem, candidates=1, ratio_test_kind="fixed")
    assert single.reason == Reason.SINGLE_CANDIDATE
    strong, _ = make_problem(n_sats=14, code_sd_m=0.05)
    for kind in ("fixed", "fixed_failure_rate", "difference"):
        assert resolve_lambda(strong, ratio_test_kind=kind).reason == Reason.OK
    with pytest.raises(ConfigError, match="estimator"):
        resolve_lambda(problem, estimator="guess")
    with pytest.raises(ConfigError, match="ratio_test"):
        resolve_lambda(problem, ratio_test_kind="guess")


def test_partial_resolution_says_what_it_left_out():
    problem, integers = make_problem(n_sats=11)
    # One satellite whose phase hardly counts.
    cov = problem.cov_phase_m2.copy()
    cov[6, 6] += 0.5**2
    problem = replace(problem, cov_phase_m2=cov, phase_m=problem.phase_m + 0.31 * np.eye(10)[6])
    assert resolve_lambda(problem).reason == Reason.PROBABILITY_TEST
    result = resolve_lambda(problem, min_success_rate=0.9)
    assert result.status == Status.FIXED
    assert not result.is_fixed[6]
    assert np.array_equal(result.integers_cyc[0][result.is_fixed], integers[result.is_fixed])
    floats = estimate_float(problem)
    fix = partial_fix(floats.float_cyc, floats.cov_cyc2, 0.9)
    assert np.array_equal(fix.is_fixed, result.is_fixed)
    assert 6 in fix.left_out
    nothing = resolve_lambda(make_problem(n_sats=5)[0], min_success_rate=0.999999)
    assert (nothing.status, nothing.reason) == (Status.FLOAT, Reason.PROBABILITY_TEST)


@pytest.mark.jit
def test_posterior_over_all_integers_agrees_with_a_long_list():
    problem, _ = make_problem(n_sats=6, code_sd_m=0.4)
    floats = estimate_float(problem)
    cost = integer_least_squares(floats.float_cyc, floats.cov_cyc2, 5000).cost
    assert cost[-1] > cost[0] + 30.0
    weight = np.exp(-0.5 * (cost - cost[0]))
    # What lies outside the window of 30 weighs less than 1e-4 of the whole here.
    assert resolve_lambda(problem).success_probability == pytest.approx(1.0 / weight.sum(), rel=1e-4)


def test_matrices_that_cannot_be_used():
    for cov in (np.ones((3, 3)), np.diag([1.0, -1.0]), np.full((2, 2), np.nan), np.zeros((2, 2))):
        with pytest.raises(ModelError, match="positive definite"):
            decorrelate(cov)
    with pytest.raises(ModelError, match="square"):
        decorrelate(np.ones((2, 3)))
    with pytest.raises(ModelError, match="finite"):
        integer_least_squares([0.0, np.nan], np.eye(2))
