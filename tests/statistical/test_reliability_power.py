"""Rates of the tests and of the protection levels, counted."""

import numpy as np
import pytest

from array_reliability_models import SQUARE_M, attitudes, make_epoch, make_vectors
from truenorth.attitude.reliability import (
    Outcome,
    ReliabilitySettings,
    adapt_attitude,
    attitude_reliability,
    b_method_significance,
    phase_model,
)
from truenorth.attitude.reliability.array_adaptation import fit_block
from truenorth.rotations import heading_pitch_roll

SETTINGS = ReliabilitySettings()


def assert_rate(count, n, expected):
    """Counted and expected rate agree within four and a half standard deviations (false alarm 7e-6)."""
    assert abs(count - n * expected) < 4.5 * np.sqrt(n * expected * (1.0 - expected)) + 1.0, (
        count,
        n * expected,
    )


def solved(n, seed, **options):
    rng = np.random.default_rng(seed)
    rot = attitudes(n, rng)
    vectors = make_vectors(rot, rng, **options)
    fitted = fit_block(next(vectors.blocks()))[0]
    return rot, vectors, fitted


def angle_errors(fitted, rot):
    error = np.stack(heading_pitch_roll(fitted), 1) - np.stack(heading_pitch_roll(rot), 1)
    return np.abs((error + np.pi) % (2.0 * np.pi) - np.pi)


def test_false_alarms_are_those_of_the_b_method():
    n = 6000
    _, vectors, fitted = solved(n, 101)
    result = attitude_reliability(vectors, fitted)
    assert_rate(np.count_nonzero(result.statistic > result.limit), n, b_method_significance(6))
    for antenna in range(4):
        flagged = result.antenna_statistic[:, antenna] > result.antenna_limit[:, antenna]
        assert_rate(np.count_nonzero(flagged), n, b_method_significance(3))
        for axis in range(3):
            assert_rate(np.count_nonzero(result.is_flagged[:, antenna, axis]), n, 0.001)
    # All at once: at least the largest, at most the sum.
    assert b_method_significance(6) < 1.0 - result.is_passed.mean() < b_method_significance(6) + 4 * 0.0055


@pytest.mark.parametrize(("antenna", "axis"), [(1, 0), (2, 2), (0, 1)])
def test_power_at_the_detectable_blunder(antenna, axis):
    """Every test that has the blunder among its faults finds it in four of five epochs: the B-method."""
    n = 4000
    rot, vectors, _ = solved(n, 102 + antenna)
    mdb_m = attitude_reliability(vectors, rot).mdb_m[:, antenna, axis]
    shift = np.zeros((n, 3))
    shift[:, axis] = mdb_m if antenna else -mdb_m
    if antenna:
        vectors.vector_ned_m[:, antenna] += shift
    else:
        vectors.vector_ned_m[:, 1:] += shift[:, None]
    result = attitude_reliability(vectors, fit_block(next(vectors.blocks()))[0])
    # Residuals of a centimetre on a metre bend the model by a part in a hundred of the blunder.
    for found in (
        np.abs(result.w[:, antenna, axis]) > SETTINGS.local_limit,
        result.antenna_statistic[:, antenna] > result.antenna_limit[:, antenna],
        result.statistic > result.limit,
    ):
        assert found.mean() == pytest.approx(0.8, abs=0.04)


def test_power_of_the_test_of_one_phase():
    rng = np.random.default_rng(103)
    epoch, rot, _ = make_epoch(rng, n_sats=6)
    model, rows, _ = phase_model(epoch, rot)
    n, row = 40_000, 13
    noise = rng.standard_normal((n, len(rows))) * np.sqrt(epoch.phase_variance_m2[rows])
    noise[:, row] += model.mdb(SETTINGS.delta0)[0, row]
    w = noise @ model.test[0, row] / np.sqrt(model.test[0, row, row])
    assert_rate(np.count_nonzero(np.abs(w) > SETTINGS.local_limit), n, 0.8)
    assert_rate(np.count_nonzero(np.abs(w) > SETTINGS.delta0), n, 0.5)


def test_exclusion_leaves_an_honest_attitude():
    """A wrong antenna in every epoch, of every size: what is accepted has the covariance it states."""
    n = 1500
    rng = np.random.default_rng(104)
    rot, antenna = attitudes(n, rng), rng.integers(0, 4, n)
    shift = rng.standard_normal((n, 3))
    shift *= (10.0 ** rng.uniform(-1.0, 0.0, n) / np.linalg.norm(shift, axis=1))[:, None]
    result = adapt_attitude(make_vectors(rot, rng, shift_m=shift, antenna=antenna))
    # Blaming another needs the shift to look like one of its own, which noise must fill up.
    assert result.is_rejected[np.arange(n), antenna].sum() >= result.is_rejected.sum() - 4
    accepted = result.outcome == Outcome.ADAPTED
    assert accepted.mean() > 0.9


@pytest.mark.parametrize("risk", [0.1, 1e-2])
def test_levels_without_faults_are_exceeded_at_their_risk(risk):
    """With no fault to allow for, the level is no bound but the quantile: neither more nor fewer."""
    n = 8000
    settings = ReliabilitySettings(integrity_risk=risk, fault_prior=0.0)
    rng = np.random.default_rng(105)
    rot = attitudes(n, rng)
    vectors = make_vectors(rot, rng)
    fitted = np.concatenate([fit_block(block)[0] for block in vectors.blocks()])
    result = attitude_reliability(vectors, fitted, settings=settings)
    exceeded = angle_errors(fitted, rot) > result.protection_rad
    for angle in range(3):
        assert_rate(np.count_nonzero(exceeded[:, angle]), n, risk)


def test_levels_bound_the_error_with_the_worst_fault():
    """In every epoch one antenna is shifted in the direction that moves the heading most for what is seen."""
    n, prior = 3000, 1e-2
    settings = ReliabilitySettings(integrity_risk=2e-3, fault_prior=prior)
    worst = 0.0
    for size in (3.0, 4.0, 5.0, 6.0):
        rng = np.random.default_rng(106)
        rot = attitudes(n, rng)
        vectors = make_vectors(rot, rng, body_m=SQUARE_M)
        down_axis = rot[:, :, 2]
        block = next(vectors.blocks())
        direction = np.cross(down_axis, np.einsum("nij,j->ni", rot, SQUARE_M[3]))
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        # Scaled to the wanted non-centrality by one look at what its test sees.
        trial = attitude_reliability(
            shifted(vectors, 3, direction, np.einsum("nij,kj->nki", rot, SQUARE_M)), rot, settings=settings
        )
        scale = size / np.sqrt(trial.antenna_statistic[:, 3])
        vectors.vector_ned_m[:, 3] += scale[:, None] * direction
        block = next(vectors.blocks())
        fitted = fit_block(block)[0]
        result = attitude_reliability(vectors, fitted, settings=settings)
        missed = result.is_passed[:, None] & (angle_errors(fitted, rot) > result.protection_rad)
        worst = max(worst, missed[:, 0].mean())
    assert 0.0 < 4 * prior * worst < settings.integrity_risk


def shifted(vectors, antenna, shift, exact):
    """Vectors without noise, one antenna shifted."""
    moved = vectors.vector_ned_m.copy()
    moved[:, 1:] = exact[:, 1:] - exact[:, :1]
    moved[:, antenna] += shift
    return type(vectors)(
        vectors.time_ns,
        vectors.reference,
        moved,
        vectors.cov_ned_m2,
        vectors.positions_body_m,
        vectors.body_cov_m2,
    )
