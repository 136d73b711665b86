"""Kalman estimators of a standing baseline: start, convergence, changes of satellites, slips."""

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from truenorth.ambiguity.kalman import (
    KalmanAttitudeEstimator,
    KalmanIntegerEstimator,
    KalmanOptions,
    chain_covariance,
    triple_difference_baseline,
)
from truenorth.ambiguity.model import DoubleDifferences
from truenorth.errors import ConfigError, ModelError, Reason, Status

_TOOL = Path(__file__).parents[2] / "tools" / "circular_sky.py"
_SPEC = importlib.util.spec_from_file_location("circular_sky", _TOOL)
sky = importlib.util.module_from_spec(_SPEC)
sys.modules.setdefault("circular_sky", sky)
_SPEC.loader.exec_module(sky)

LAMBDA_M = sky.WAVELENGTH_M
BASELINE = np.array([np.sin(np.radians(11.0)), np.cos(np.radians(11.0)), 0.0])
UNDIFFERENCED = np.random.default_rng(0).integers(-9, 10, 24)
SD_M = 0.002


def epoch(time_s, satellites, reference, rng=None, *, code=False, slip=None, baseline=BASELINE):
    """Double differences of some of the 24 satellites against one of them."""
    rays = sky.directions_enu(time_s)
    satellites = np.asarray(satellites)
    m = len(satellites)
    design = -(rays[satellites] - rays[reference])
    integers = UNDIFFERENCED[satellites] - UNDIFFERENCED[reference]
    cov = SD_M**2 * (np.eye(m) + 1.0)
    phase = design @ baseline + LAMBDA_M * integers
    if rng is not None:
        phase = phase + np.linalg.cholesky(cov) @ rng.standard_normal(m)
    if slip is not None:
        phase = phase + LAMBDA_M * np.asarray(slip)
    cov_code = cov / SD_M**2 * 0.3**2
    code_m = design @ baseline
    if rng is not None:
        code_m = code_m + np.linalg.cholesky(cov_code) @ rng.standard_normal(m)
    keep = m if code else 0
    problem = DoubleDifferences(
        phase_m=phase,
        design=design,
        wavelength_m=np.full(m, LAMBDA_M),
        cov_phase_m2=cov,
        code_m=code_m[:keep],
        code_design=design[:keep],
        cov_code_m2=cov_code[:keep, :keep],
        length_m=float(np.linalg.norm(baseline)),
        length_sd_m=0.003,
    )
    return problem, integers, {"row_key": satellites, "reference_key": np.full(m, reference)}


HIGH = sky.highest(sky.directions_enu(300.0), 9)


def test_chain_covariance_is_that_of_the_chain():
    difference = np.diff(np.eye(5), axis=0)
    np.testing.assert_allclose(chain_covariance(4, 0.7), 0.7 * difference @ difference.T)


def test_triple_difference_finds_the_baseline_without_integers():
    first, _, _ = epoch(0.0, HIGH[1:6], HIGH[0])
    last, _, _ = epoch(600.0, HIGH[1:6], HIGH[0])
    baseline, cov = triple_difference_baseline(
        last.phase_m, last.design, first.phase_m, first.design, last.cov_phase_m2
    )
    # Without noise only rounding errors, enlarged by the small change of the design, are left.
    np.testing.assert_allclose(baseline, BASELINE, atol=1e-9)
    noisy = []
    rng = np.random.default_rng(1)
    for _ in range(200):
        first, _, _ = epoch(0.0, HIGH[1:6], HIGH[0], rng)
        last, _, _ = epoch(600.0, HIGH[1:6], HIGH[0], rng)
        noisy.append(
            triple_difference_baseline(
                last.phase_m, last.design, first.phase_m, first.design, last.cov_phase_m2
            )[0]
        )
    # NEES of 200 draws of 3 degrees of freedom: 600 +- 5 * sqrt(1200).
    error = np.array(noisy) - BASELINE
    nees = np.einsum("ni,ij,nj->", error, np.linalg.inv(cov), error)
    assert 427.0 < nees < 773.0


def test_triple_difference_refuses_one_instant():
    first, _, _ = epoch(0.0, HIGH[1:6], HIGH[0])
    with pytest.raises(ModelError, match="minutes apart"):
        triple_difference_baseline(
            first.phase_m, first.design, first.phase_m, first.design, first.cov_phase_m2
        )


def test_attitude_estimator_is_the_joint_adjustment():
    rng = np.random.default_rng(2)
    estimator = KalmanAttitudeEstimator()
    normal, right = np.zeros((3, 3)), np.zeros(3)
    for k in range(5):
        problem, integers, _ = epoch(60.0 * k, HIGH[1:5], HIGH[0], rng)
        free = problem.phase_m - LAMBDA_M * integers
        baseline, cov = estimator.update(free, problem.design, problem.cov_phase_m2)
        weight = np.linalg.inv(problem.cov_phase_m2)
        normal += problem.design.T @ weight @ problem.design
        right += problem.design.T @ weight @ free
    np.testing.assert_allclose(cov, np.linalg.inv(normal), rtol=1e-9)
    np.testing.assert_allclose(baseline, np.linalg.solve(normal, right), atol=1e-10)


def test_two_satellites_determine_nothing():
    problem, integers, _ = epoch(0.0, HIGH[1:3], HIGH[0])
    free = problem.phase_m - LAMBDA_M * integers
    baseline, _ = KalmanAttitudeEstimator().update(free, problem.design, problem.cov_phase_m2)
    assert np.isnan(baseline).all()


def run(estimator, times, satellites=HIGH[1:6], reference=HIGH[0], seed=3, **options):
    rng = np.random.default_rng(seed)
    results = []
    for t in times:
        problem, integers, keys = epoch(t, satellites, reference, rng, **options)
        results.append(estimator.update(problem, **keys))
    return results, integers


def test_float_then_fixed():
    estimator = KalmanIntegerEstimator(KalmanOptions(use_code=False))
    results, integers = run(estimator, np.arange(0.0, 900.0, 5.0))
    status = np.array([r.status for r in results])
    first = int(np.argmax(status == Status.FIXED))
    assert 0 < first < len(status)
    assert np.all(status[:first] == Status.FLOAT)
    assert np.all(status[first:] == Status.FIXED)
    assert results[first - 1].reason == Reason.NOT_PERSISTENT
    last = results[-1]
    np.testing.assert_array_equal(last.integers_cyc[0], integers)
    error = last.baseline_enu_m[0] - BASELINE
    # 3 degrees of freedom; 25 is exceeded by chance once in 60 000.
    assert error @ np.linalg.solve(last.cov_baseline_m2, error) < 25.0
    off = estimator.float_integers_cyc - integers
    assert np.all(np.abs(off) < 5.0 * estimator.float_integer_sd_cyc)
    assert 0.99 < last.success_probability <= 1.0


def test_filter_is_the_batch_adjustment():
    # With a start as wide as this the filter must agree with least squares over all epochs.
    estimator = KalmanIntegerEstimator(KalmanOptions(use_code=True, baseline_sd_m=1e4))
    rng = np.random.default_rng(4)
    m = 5
    normal, right = np.zeros((3 + m, 3 + m)), np.zeros(3 + m)
    for t in range(0, 300, 20):
        problem, _, keys = epoch(float(t), HIGH[1:6], HIGH[0], rng, code=True)
        estimator.update(problem, **keys)
        rows = np.hstack([problem.design, np.diag(problem.wavelength_m)])
        weight = np.linalg.inv(problem.cov_phase_m2)
        normal += rows.T @ weight @ rows
        right += rows.T @ weight @ problem.phase_m
        weight = np.linalg.inv(problem.cov_code_m2)
        normal[:3, :3] += problem.code_design.T @ weight @ problem.code_design
        right[:3] += problem.code_design.T @ weight @ problem.code_m
    batch = np.linalg.solve(normal, right)
    sd = np.sqrt(np.diag(np.linalg.inv(normal)))
    np.testing.assert_allclose(estimator.float_integers_cyc, batch[3:], atol=1e-3 * sd[3:].min())
    np.testing.assert_allclose(estimator.float_integer_sd_cyc, sd[3:], rtol=1e-3)


def test_triple_difference_start_agrees_with_the_diffuse_one():
    times = np.arange(0.0, 900.0, 5.0)
    late = KalmanIntegerEstimator(KalmanOptions(start="triple_difference", start_epochs=60, use_code=False))
    results, integers = run(late, times)
    assert all(r.reason == Reason.NOT_PERSISTENT and r.status == Status.NONE for r in results[:60])
    assert results[-1].status == Status.FIXED
    np.testing.assert_array_equal(results[-1].integers_cyc[0], integers)


def test_satellites_and_reference_change_without_loss():
    estimator = KalmanIntegerEstimator(KalmanOptions(use_code=False))
    run(estimator, np.arange(0.0, 700.0, 5.0))
    before = dict(zip(HIGH[1:6], estimator.float_integers_cyc, strict=True))
    # Another reference, the old one among the rows, one satellite gone: nothing is new, so nothing restarts.
    satellites = np.array([HIGH[0], HIGH[2], HIGH[4], HIGH[5]])
    results, integers = run(estimator, [705.0], satellites, HIGH[1], seed=9)
    expected = np.array([-before[HIGH[1]]] + [before[s] - before[HIGH[1]] for s in satellites[1:]])
    # One epoch moves floats of 0.02 cycles by less than that.
    np.testing.assert_allclose(estimator.float_integers_cyc, expected, atol=0.02)
    assert results[0].status == Status.FIXED
    np.testing.assert_array_equal(results[0].integers_cyc[0], integers)
    # A newcomer is float until it has been stable.
    results, integers = run(estimator, [710.0], [*satellites, HIGH[7]], HIGH[1], seed=10)
    assert results[0].status == Status.FLOAT
    results, integers = run(estimator, np.arange(715.0, 790.0, 5.0), [*satellites, HIGH[7]], HIGH[1], seed=11)
    assert results[-1].status == Status.FIXED
    np.testing.assert_array_equal(results[-1].integers_cyc[0], integers)


def test_unrelated_satellites_start_anew():
    estimator = KalmanIntegerEstimator(KalmanOptions(use_code=False))
    run(estimator, np.arange(0.0, 700.0, 5.0))
    results, _ = run(estimator, [705.0], HIGH[6:9], HIGH[5])
    assert results[0].status == Status.FLOAT
    assert estimator.float_integer_sd_cyc.max() > 0.5


def test_without_keys_rows_are_those_of_the_last_epoch():
    estimator = KalmanIntegerEstimator(KalmanOptions(use_code=False))
    for t in np.arange(0.0, 900.0, 5.0):
        problem, _, _ = epoch(t, HIGH[1:6], HIGH[0], np.random.default_rng(int(t)))
        result = estimator.update(problem)
    assert result.status == Status.FIXED
    problem, _, _ = epoch(905.0, HIGH[1:5], HIGH[0])
    assert estimator.update(problem).status == Status.FLOAT


def test_a_slip_is_found_and_only_its_row_restarts():
    estimator = KalmanIntegerEstimator(KalmanOptions(use_code=False))
    run(estimator, np.arange(0.0, 700.0, 5.0))
    calm = estimator.float_integer_sd_cyc
    slip = [0, 1, 0, 0, 0]
    results, integers = run(estimator, [705.0], slip=slip, seed=5)
    assert results[0].status == Status.FLOAT
    # The known baseline gives the new integer back within one epoch, though not all of its sharpness.
    assert estimator.float_integer_sd_cyc[1] > 1.1 * calm[1]
    np.testing.assert_array_equal(results[0].integers_cyc[0], integers + slip)
    others = [0, 2, 3, 4]
    np.testing.assert_allclose(estimator.float_integer_sd_cyc[others], calm[others], rtol=0.05)
    results, integers = run(estimator, np.arange(710.0, 790.0, 5.0), slip=slip, seed=6)
    assert results[-1].status == Status.FIXED
    np.testing.assert_array_equal(results[-1].integers_cyc[0], integers + slip)


def test_a_wrong_declared_length_is_named():
    estimator = KalmanIntegerEstimator(KalmanOptions(use_code=False))
    rng = np.random.default_rng(3)
    for t in np.arange(0.0, 900.0, 5.0):
        problem, _, keys = epoch(t, HIGH[1:6], HIGH[0], rng)
        result = estimator.update(replace(problem, length_m=1.2), **keys)
    assert result.status == Status.FLOAT
    assert result.reason == Reason.LENGTH_TEST


def test_too_few_rows_and_bad_options():
    problem, _, _ = epoch(0.0, HIGH[1:3], HIGH[0])
    assert KalmanIntegerEstimator().update(problem).reason == Reason.TOO_FEW_SATELLITES
    problem, _, _ = epoch(0.0, HIGH[1:6], HIGH[0])
    with pytest.raises(ModelError, match="noise settings"):
        KalmanIntegerEstimator().update(replace(problem, cov_phase_m2=np.zeros((5, 5))))
    for options in ({"start": "now"}, {"max_integer_sd_cyc": 0.6}, {"stable_epochs": 0}):
        with pytest.raises(ConfigError):
            KalmanOptions(**options)
