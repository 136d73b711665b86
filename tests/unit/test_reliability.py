"""Tests for blunders and what they leave undetected, against the definitions carried out by brute force."""

from dataclasses import replace

import numpy as np
import pytest

from array_reliability_models import (
    LINE_M,
    SQUARE_M,
    TRIANGLE_M,
    WAVELENGTH_M,
    attitudes,
    make_epoch,
    make_vectors,
)
from truenorth.attitude.adjustment import without_antenna
from truenorth.attitude.reliability import (
    Outcome,
    ProtectionState,
    ReliabilitySettings,
    adapt_attitude,
    adapt_model,
    adaptation_events,
    attitude_reliability,
    filter_model,
    filter_reliability,
    least_squares_model,
    multiple_fault_risk,
    phase_events,
    phase_model,
    phase_reliability,
    protection_events,
    protection_level,
    reliability_events,
)
from truenorth.attitude.reliability.array_adaptation import fit_block
from truenorth.attitude.reliability.array_reliability import antenna_shapes
from truenorth.attitude.vectors import angle_jacobian
from truenorth.errors import ConfigError
from truenorth.rotations import exp_so3, heading_pitch_roll, log_so3, rot_ned_from_body, skew


def random_model(rng, r=8, u=3, e=4):
    design = rng.standard_normal((e, r, u))
    root = rng.standard_normal((e, r, r + 3))
    return design, root @ np.swapaxes(root, 1, 2)


def test_least_squares_against_its_definition():
    rng = np.random.default_rng(1)
    design, cov = random_model(rng)
    model = least_squares_model(design, cov)
    y = rng.standard_normal((4, 8))
    for k in range(4):
        weight = np.linalg.inv(cov[k])
        Q = np.linalg.inv(design[k].T @ weight @ design[k])
        x = Q @ design[k].T @ weight @ y[k]
        v = y[k] - design[k] @ x
        Q_v = cov[k] - design[k] @ Q @ design[k].T
        np.testing.assert_allclose(model.gain[k] @ y[k], x, rtol=1e-9)
        np.testing.assert_allclose(model.statistic(y)[k], v @ weight @ v, rtol=1e-9)
        np.testing.assert_allclose(model.cov_residual[k], Q_v, atol=1e-9 * np.abs(Q_v).max())
        np.testing.assert_allclose(model.redundancy[k], np.diag(Q_v @ weight), atol=1e-10)
        seen = np.diag(weight @ Q_v @ weight)
        np.testing.assert_allclose(model.local(y)[k], weight @ v / np.sqrt(seen), rtol=1e-8)
        np.testing.assert_allclose(model.mdb(4.0)[k], 4.0 / np.sqrt(seen), rtol=1e-9)
        effect = Q @ design[k].T @ weight * (4.0 / np.sqrt(seen))
        np.testing.assert_allclose(model.external(4.0)[k], effect, rtol=1e-8)
        ratio = np.diag(effect.T @ np.linalg.inv(Q) @ effect)
        np.testing.assert_allclose(model.bias_to_noise(4.0)[k], ratio, rtol=1e-8)
    assert model.redundancy.sum(axis=1) == pytest.approx(np.full(4, 5.0))


def test_filter_against_its_definition():
    rng = np.random.default_rng(2)
    design, cov = random_model(rng)
    root = rng.standard_normal((4, 6, 8))
    prior = root @ np.swapaxes(root, 1, 2)
    model = filter_model(design, cov, prior)
    for k in range(4):
        H = np.hstack([design[k], np.zeros((8, 3))])
        C_v = H @ prior[k] @ H.T + cov[k]
        K = prior[k] @ H.T @ np.linalg.inv(C_v)
        P = (np.eye(6) - K @ H) @ prior[k]
        mdb = 4.0 / np.sqrt(np.diag(np.linalg.inv(C_v)))
        np.testing.assert_allclose(model.gain[k], K, atol=1e-9 * np.abs(K).max())
        np.testing.assert_allclose(model.cov_unknowns[k], P, atol=1e-9 * np.abs(prior[k]).max())
        np.testing.assert_allclose(model.mdb(4.0)[k], mdb, rtol=1e-9)
        np.testing.assert_allclose(model.redundancy[k], np.diag(cov[k] @ np.linalg.inv(C_v)), rtol=1e-8)
        ratio = np.diag((K * mdb).T @ np.linalg.inv(P) @ (K * mdb))
        np.testing.assert_allclose(model.bias_to_noise(4.0)[k], ratio, rtol=1e-6)


def test_a_fault_is_what_leaving_it_out_says():
    """Statistic, estimate and solution separation are those of the adjustment without the observations."""
    rng = np.random.default_rng(3)
    design, cov = random_model(rng, r=9, e=2)
    model = least_squares_model(design, cov)
    y = rng.standard_normal((2, 9))
    faults = model.faults(np.eye(9).reshape(9, 3, 3))
    variance = faults.separation_variance(np.eye(3)[None].repeat(2, 0))
    for part in range(3):
        rest = np.delete(np.arange(9), [3 * part, 3 * part + 1, 3 * part + 2])
        short = least_squares_model(design[:, rest], cov[:, rest[:, None], rest])
        np.testing.assert_allclose(
            faults.statistic(y)[:, part], model.statistic(y) - short.statistic(y[:, rest]), rtol=1e-8
        )
        own = np.einsum("euu->eu", short.cov_unknowns) - np.einsum("euu->eu", model.cov_unknowns)
        np.testing.assert_allclose(variance[:, :, part], own, rtol=1e-7)
        moved = np.einsum("eur,er->eu", model.gain, y) - np.einsum("eur,er->eu", short.gain, y[:, rest])
        through = np.einsum("euq,eq->eu", faults.gain[:, :, part], faults.estimate(y)[:, part])
        np.testing.assert_allclose(moved, through, atol=1e-8)


def test_the_worst_direction_of_a_fault():
    rng = np.random.default_rng(4)
    design, cov = random_model(rng, r=9, e=1)
    faults = least_squares_model(design, cov).faults(np.eye(9).reshape(9, 3, 3))
    unit = rng.standard_normal((20_000, 3))
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    rows = np.array([[[1.0, 0.0, 0.0]]])
    for part in range(3):
        size = 4.0 / np.sqrt(np.einsum("ni,ij,nj->n", unit, faults.seen[0, part], unit))
        effect = np.abs(size * (unit @ faults.gain[0, 0, part]))
        assert faults.worst_mdb(4.0)[0, part] == pytest.approx(size.max(), rel=0.01)
        largest = 4.0 * np.sqrt(faults.separation_variance(rows)[0, 0, part])
        assert largest == pytest.approx(effect.max(), rel=0.01)
        assert effect.max() <= largest * (1.0 + 1e-12)


def test_what_no_test_sees_has_no_finite_blunder():
    """Two measurements of one length and one of another: the latter is not checked."""
    design = np.array([[[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]])
    model = least_squares_model(design, np.eye(3)[None])
    assert model.redundancy[0] == pytest.approx([0.5, 0.5, 0.0])
    assert model.mdb(4.0)[0, 2] == np.inf
    effect = model.external(4.0)[0]
    assert effect[0, 2] == 0.0
    assert effect[1, 2] == np.inf
    assert model.local(np.ones((1, 3)))[0, 2] == 0.0
    assert model.bias_to_noise(4.0)[0, 2] == np.inf


def test_adaptation_is_leaving_out():
    rng = np.random.default_rng(5)
    design, cov = random_model(rng, r=12, e=6)
    model = least_squares_model(design, cov)
    y = np.einsum("eij,ej->ei", np.linalg.cholesky(cov), 0.3 * rng.standard_normal((6, 12)))
    wrong = rng.integers(0, 4, 6)
    mdb = model.faults(np.eye(12).reshape(12, 4, 3)).worst_mdb(4.1)
    for k in range(6):
        y[k, 3 * wrong[k] : 3 * wrong[k] + 3] += 8.0 * mdb[k, wrong[k]]
    result = adapt_model(model, y, np.eye(12).reshape(12, 4, 3))
    assert np.array_equal(result.fault[:, 0], wrong)
    assert np.all(result.outcome == Outcome.ADAPTED)
    for k in range(6):
        rest = np.delete(np.arange(12), range(3 * wrong[k], 3 * wrong[k] + 3))
        short = least_squares_model(design[k : k + 1, rest], cov[k][np.ix_(rest, rest)][None])
        np.testing.assert_allclose(result.correction[k], short.gain[0] @ y[k, rest], atol=1e-8)
        np.testing.assert_allclose(result.cov[k], short.cov_unknowns[0], rtol=1e-7)
        assert result.statistic[k, 1] == pytest.approx(short.statistic(y[k : k + 1, rest])[0], rel=1e-6)
        assert result.limit[k, 1] == ReliabilitySettings().limit(6)


def test_the_cap_gives_an_epoch_up():
    y = np.zeros((1, 10))
    y[0, [1, 4, 7]] = 30.0, -40.0, 50.0
    model = least_squares_model(np.ones((1, 10, 1)), np.eye(10)[None])
    shapes = np.eye(10)[:, :, None]
    found = adapt_model(model, y, shapes, settings=ReliabilitySettings(max_rejections=3))
    assert list(found.fault[0]) == [7, 4, 1, -1]
    assert found.correction[0, 0] == pytest.approx(0.0, abs=1e-10)
    given_up = adapt_model(model, y, shapes, settings=ReliabilitySettings(max_rejections=2))
    assert given_up.outcome[0] == Outcome.TOO_MANY
    assert np.isnan(given_up.correction).all()
    assert not given_up.is_rejected.any()


def test_two_observations_contradict_and_none_is_to_blame():
    model = least_squares_model(np.ones((1, 2, 1)), np.eye(2)[None])
    result = adapt_model(model, np.array([[0.0, 20.0]]), np.eye(2)[:, :, None])
    assert result.outcome[0] == Outcome.NOT_SEPARATED


@pytest.mark.parametrize("screen", ["none", "estimated", "innovation"])
def test_readings_of_the_screen(screen):
    """A blunder between the limits of the local test and the screens is rejected by some of them only."""
    settings = ReliabilitySettings(mdb_screen=screen, separation=0.0)
    model = least_squares_model(np.ones((1, 9, 1)), np.eye(9)[None])
    for w, rejected in (
        (3.8, {"none"}),
        (4.2, {"none", "estimated"}),
        (4.9, {"none", "estimated", "innovation"}),
    ):
        # The residual is the blunder times the redundancy number 8/9, and w that times sqrt(9/8).
        y = np.zeros((1, 9))
        y[0, 3] = w * np.sqrt(9.0 / 8.0)
        result = adapt_model(model, y, np.eye(9)[:, :, None], settings=settings)
        assert (result.fault[0, 0] == 3) == (screen in rejected), (w, result.outcome)


def test_one_wrong_antenna_of_four_is_found_wherever_it_is():
    """A shift of one cycle and more in any direction, as wrong integers make it; the reference as well."""
    rng = np.random.default_rng(6)
    n = 400
    rot, antenna = attitudes(n, rng), rng.integers(0, 4, n)
    shift = rng.standard_normal((n, 3))
    shift *= (WAVELENGTH_M * rng.uniform(1.0, 4.0, n) / np.linalg.norm(shift, axis=1))[:, None]
    result = adapt_attitude(make_vectors(rot, rng, shift_m=shift, antenna=antenna))
    right = result.is_rejected[np.arange(n), antenna]
    # 1 % has its shift nearly where three antennas do not look, and is given up; none blames another.
    assert right.mean() > 0.96
    assert result.is_rejected.sum() == right.sum()
    resolved = result.outcome <= Outcome.ADAPTED
    assert np.array_equal(resolved, right)
    assert np.all(result.vectors.reference[right & (antenna == 0)] == 1)
    error = log_so3(result.rot_ned_from_body[resolved] @ np.swapaxes(rot[resolved], 1, 2))
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(result.cov_ned_rad2[resolved]), error)
    # Chi-square of 3 degrees of freedom; the mean of some 390 has a standard deviation of 0.125.
    assert nees.mean() == pytest.approx(3.0, abs=0.5)
    assert np.isnan(result.rot_ned_from_body[~resolved]).all()


def test_without_the_reference_the_others_point_from_another():
    """Leaving out any antenna gives the attitude of the vectors between the rest."""
    rng = np.random.default_rng(7)
    vectors = make_vectors(attitudes(3, rng), rng, body_sd_m=0.001)
    block = next(vectors.blocks())
    gone = without_antenna(block, 0)
    assert gone.reference == 1
    np.testing.assert_allclose(gone.body_m, SQUARE_M[2:] - SQUARE_M[1])
    np.testing.assert_allclose(gone.vector_ned_m, block.vector_ned_m[:, 1:] - block.vector_ned_m[:, :1])
    # Antennas are alike, so the covariance is that of any reference.
    np.testing.assert_allclose(gone.cov_ned_m2, block.cov_ned_m2[:, :6, :6], atol=1e-18)
    np.testing.assert_allclose(gone.body_cov_m2, block.body_cov_m2[:6, :6], atol=1e-18)
    assert fit_block(gone)[3] == 3


def test_three_antennas_see_a_contradiction_and_blame_no_one():
    rng = np.random.default_rng(8)
    rot = attitudes(50, rng)
    vectors = make_vectors(
        rot, rng, body_m=TRIANGLE_M, shift_m=rot[:, :, 0] * 0.1, antenna=1, names=("a", "b", "c")
    )
    result = adapt_attitude(vectors)
    assert np.all(result.outcome > Outcome.ADAPTED)
    assert not result.is_rejected.any()
    events = adaptation_events(result)
    assert len(events) == 50
    assert events[0].kind == "test"
    assert "the epoch has no attitude" in events[0].text


def test_attitude_reliability_is_that_of_small_turns():
    """The effect of a blunder is what adjusting with it does to the angles, the reference's too."""
    rng = np.random.default_rng(9)
    vectors = make_vectors(attitudes(5, rng), rng, body_sd_m=0.001)
    block = next(vectors.blocks())
    rot, _, chi2, _ = fit_block(block)
    np.testing.assert_allclose(attitude_reliability(vectors, rot).statistic, chi2, rtol=1e-6)
    # Residuals bend the effect by their share of the arms, so there are none.
    vectors.vector_ned_m[:, 1:] = np.einsum("nij,kj->nki", rot, SQUARE_M[1:])
    block = next(vectors.blocks())
    result = attitude_reliability(vectors, rot)
    worst = np.zeros((5, 3))
    for column, antenna in enumerate([1, 2, 3, 0]):
        for axis in range(3):
            shift = antenna_shapes(3)[:, column, axis].reshape(3, 3)
            moved = replace_vectors(block, block.vector_ned_m + 1e-5 * shift)
            angles = np.array(heading_pitch_roll(fit_block(moved)[0])) - np.array(heading_pitch_roll(rot))
            angles = (angles.T + np.pi) % (2.0 * np.pi) - np.pi
            worst = np.maximum(worst, np.abs(angles) / 1e-5 * result.mdb_m[:, antenna, axis, None])
    np.testing.assert_allclose(result.external_rad, worst, rtol=1e-3)
    cov = angle_jacobian(rot) @ fit_block(block)[1] @ np.swapaxes(angle_jacobian(rot), 1, 2)
    np.testing.assert_allclose(result.sd_rad, np.sqrt(np.einsum("nii->ni", cov)), rtol=1e-6)
    assert np.nansum(result.redundancy, axis=(1, 2)) == pytest.approx(np.full(5, 6.0))


def replace_vectors(block, vector):
    return type(block)(
        block.epochs,
        block.antennas,
        block.reference,
        vector,
        block.cov_ned_m2,
        block.body_m,
        block.body_cov_m2,
    )


def test_which_antenna_is_the_reference_plays_no_role():
    rng = np.random.default_rng(10)
    vectors = make_vectors(attitudes(4, rng), rng)
    rot = fit_block(next(vectors.blocks()))[0]
    result = attitude_reliability(vectors, rot)
    turned = vectors.vector_ned_m - vectors.vector_ned_m[:, 2:3]
    turned[:, 0], turned[:, 2] = -vectors.vector_ned_m[:, 2], np.nan
    other = replace(
        vectors, vector_ned_m=turned, reference=np.full(4, 2), cov_ned_m2=swap(vectors.cov_ned_m2)
    )
    again = attitude_reliability(other, rot)
    for name in (
        "statistic",
        "antenna_statistic",
        "antenna_mdb_m",
        "mdb_m",
        "external_rad",
        "protection_rad",
    ):
        np.testing.assert_allclose(getattr(again, name), getattr(result, name), rtol=1e-6, err_msg=name)
    np.testing.assert_allclose(again.w, result.w, atol=1e-7)


def swap(cov):
    """Covariance of the same alike antennas seen from antenna 2."""
    out = np.full_like(cov, np.nan)
    at, new = np.arange(3, 12), np.r_[0:6, 9:12]
    out[:, new[:, None], new] = cov[:, at[:, None], at]
    return out


def test_filter_with_a_loose_prediction_is_least_squares():
    rng = np.random.default_rng(11)
    vectors = make_vectors(attitudes(3, rng), rng)
    rot = fit_block(next(vectors.blocks()))[0]
    plain = attitude_reliability(vectors, rot)
    loose = filter_reliability(vectors, rot, np.tile(np.diag([1.0] * 3 + [0.1] * 3), (3, 1, 1)))
    np.testing.assert_allclose(loose.mdb_m, plain.mdb_m, rtol=1e-3)
    np.testing.assert_allclose(loose.external_rad, plain.external_rad, rtol=1e-2)
    assert np.all(loose.dof == 9)


def test_a_tight_prediction_sees_what_three_antennas_cannot():
    rng = np.random.default_rng(12)
    vectors = make_vectors(attitudes(2, rng), rng, body_m=TRIANGLE_M)
    rot = fit_block(next(vectors.blocks()))[0]
    assert np.all(np.isinf(attitude_reliability(vectors, rot).antenna_mdb_m))
    tight = filter_reliability(vectors, rot, np.tile(1e-6 * np.eye(3), (2, 1, 1)))
    assert np.all(tight.antenna_mdb_m < 0.1)
    assert np.all(tight.protection_state == ProtectionState.OK)


def test_a_line_of_antennas_has_no_roll():
    rng = np.random.default_rng(13)
    rot = attitudes(4, rng)
    result = attitude_reliability(make_vectors(rot, rng, body_m=LINE_M), rot)
    assert np.isfinite(result.sd_rad[:, :2]).all()
    assert np.isnan(result.sd_rad[:, 2]).all()
    assert np.isnan(result.external_rad[:, 2]).all()
    assert np.all(result.protection_state[:, 2] == ProtectionState.NOT_OBSERVABLE)
    assert np.all(result.dof == 4)
    # Three antennas on a line check each other across it: shifting the middle one is seen.
    assert np.isfinite(result.antenna_mdb_m).all()


def test_epochs_without_attitude_stay_empty():
    rng = np.random.default_rng(14)
    rot = attitudes(3, rng)
    vectors = make_vectors(rot, rng)
    rot[1] = np.nan
    result = attitude_reliability(vectors, rot)
    assert list(result.is_tested) == [True, False, True]
    assert np.all(result.protection_state[1] == ProtectionState.NOT_SOLVED)
    assert np.all(np.isinf(result.protection_rad[1]))


# Phases


@pytest.mark.parametrize("position_sd_m", [0.0, 0.002])
def test_phases_in_one_adjustment_are_their_vectors_and_the_array(position_sd_m):
    """Vectors from the phases, then the attitude from them: the same as the attitude from the phases."""
    rng = np.random.default_rng(15)
    epoch, rot, integers = make_epoch(rng, position_sd_m=position_sd_m)
    whole = phase_reliability(epoch, rot, integers)
    free = phase_reliability(epoch, rot, integers, stage="vectors")
    assert whole.dof == 15
    assert free.dof == 9
    assert np.nansum(whole.redundancy) == pytest.approx(15.0)
    assert np.nansum(free.redundancy) == pytest.approx(9.0)
    # Free vectors and their covariance by brute force: unknowns are positions, clocks, constants.
    n, m = len(epoch.antenna), 4
    columns = np.zeros((n, 3 * (m - 1) + (m - 1) + 7))
    for row in range(n):
        a = epoch.antenna[row] - 1
        if a >= 0:
            columns[row, 3 * a : 3 * a + 3] = epoch.design_ned[row]
            columns[row, 9 + a] = 1.0
        columns[row, 12 + epoch.satellite[row]] = 1.0
    weight = 1.0 / epoch.phase_variance_m2
    Q = np.linalg.inv(columns.T * weight @ columns)
    x = Q @ (columns.T * weight) @ (epoch.phase_m - WAVELENGTH_M * integers)
    vector = np.full((1, 4, 3), np.nan)
    vector[0, 1:] = x[:9].reshape(3, 3)
    cov = np.full((1, 12, 12), np.nan)
    cov[0, 3:, 3:] = Q[:9, :9]
    vectors = make_vectors(rot[None], rng, body_sd_m=position_sd_m)
    vectors = replace(vectors, vector_ned_m=vector, cov_ned_m2=cov)
    array = attitude_reliability(vectors, rot[None])
    assert whole.statistic == pytest.approx(free.statistic + array.statistic[0], rel=1e-6)
    np.testing.assert_allclose(whole.sd_rad, array.sd_rad[0], rtol=1e-6)


def test_a_slip_of_a_cycle_hides_where_vectors_stand_alone():
    """Five satellites: each vector by itself has one degree of freedom, the array nine."""
    rng = np.random.default_rng(16)
    epoch, rot, integers = make_epoch(rng, n_sats=5)
    whole = phase_reliability(epoch, rot, integers)
    free = phase_reliability(epoch, rot, integers, stage="vectors")
    assert not whole.hides_a_cycle.any()
    assert free.hides_a_cycle.any()
    assert np.all(free.mdb_m >= whole.mdb_m)
    np.testing.assert_allclose(whole.mdb_cyc, whole.mdb_m / WAVELENGTH_M)
    # Four satellites and no array: nothing is checked.
    epoch, rot, _ = make_epoch(rng, n_sats=4)
    alone = phase_reliability(epoch, rot, stage="vectors")
    assert alone.dof == 0
    assert np.all(np.isinf(alone.mdb_m))
    assert np.isnan(alone.w).all()
    assert not phase_reliability(epoch, rot).hides_a_cycle.any()


def test_a_slip_of_a_cycle_is_found_and_told():
    rng = np.random.default_rng(17)
    epoch, rot, integers = make_epoch(rng)
    slipped = integers.copy()
    slipped[9] += 1
    result = phase_reliability(epoch, rot, slipped)
    assert np.nanargmax(np.abs(result.w)) == 9
    assert result.statistic > result.limit
    # The phase has a cycle less than the integer says; estimated to within five of its standard deviations.
    sd = result.mdb_m[9] / result.settings.delta0
    assert result.estimated_m[9] == pytest.approx(-WAVELENGTH_M, abs=5.0 * sd)
    events = phase_events(
        5, result, epoch, antennas="abcd", satellites=[f"G{k:02d}" for k in range(7)], signals=["L1C"] * 7
    )
    assert events[0].satellite == "G02"
    assert events[0].text.startswith("the phase G02 L1C of antenna b is -")


def test_effect_of_a_phase_is_what_adjusting_with_it_does():
    rng = np.random.default_rng(18)
    epoch, rot, _ = make_epoch(rng, phase_sd_m=0.002)
    result = phase_reliability(epoch, rot)
    satellites, clocks = np.eye(7)[epoch.satellite], np.eye(4)[epoch.antenna]
    turn = np.einsum("ri,rij->rj", epoch.design_ned, -skew(epoch.positions_body_m[epoch.antenna] @ rot.T))
    columns = np.hstack([turn, satellites, clocks[:, 1:]])
    gain = np.linalg.pinv(columns)[:3]
    for row in (0, 5, 27):
        turned = exp_so3(1e-5 * gain[:, row]) @ rot
        angles = np.array(heading_pitch_roll(turned)) - np.array(heading_pitch_roll(rot))
        np.testing.assert_allclose(
            result.external_rad[row], np.abs(angles) / 1e-5 * result.mdb_m[row], rtol=1e-3
        )


def test_a_satellite_that_one_antenna_sees_is_nothing_to_anyone():
    rng = np.random.default_rng(19)
    epoch, rot, integers = make_epoch(rng)
    only = (epoch.satellite == 6) & (epoch.antenna != 2)
    epoch.phase_m[only] = np.nan
    result = phase_reliability(epoch, rot, integers)
    row = np.flatnonzero((epoch.satellite == 6) & ~only)[0]
    assert result.mdb_m[row] == np.inf
    assert np.all(result.external_rad[row] == 0.0)
    assert result.bias_to_noise[row] == 0.0
    assert np.isnan(result.mdb_m[only]).all()
    assert result.dof == 12


def test_phases_of_a_filter_are_those_of_its_vectors():
    """A prediction that knows nothing adds nothing, and information adds up."""
    rng = np.random.default_rng(24)
    epoch, rot, integers = make_epoch(rng)
    plain = phase_reliability(epoch, rot, integers)
    loose = phase_reliability(epoch, rot, integers, prior_cov_rad2=np.eye(6))
    tight = phase_reliability(epoch, rot, integers, prior_cov_rad2=np.diag([1e-6] * 3 + [1.0] * 3))
    np.testing.assert_allclose(loose.mdb_m, plain.mdb_m, rtol=1e-3)
    assert loose.dof == plain.dof + 3
    assert np.all(tight.mdb_m <= plain.mdb_m)
    assert np.all(tight.external_rad.max(axis=0) < plain.external_rad.max(axis=0))
    angles = angle_jacobian(rot[None])[0]
    own = np.linalg.inv(phase_model(epoch, rot)[0].cov_unknowns[0])
    both = angles @ np.linalg.inv(own + 1e6 * np.eye(3)) @ angles.T
    np.testing.assert_allclose(tight.sd_rad, np.sqrt(np.diag(both)), rtol=1e-9)


def test_slips_of_two_phases_are_left_out_one_after_the_other():
    rng = np.random.default_rng(25)
    epoch, rot, integers = make_epoch(rng)
    model, rows, _ = phase_model(epoch, rot)
    computed = np.einsum("ri,ri->r", epoch.design_ned, epoch.positions_body_m[epoch.antenna] @ rot.T)
    misclosure = epoch.phase_m - WAVELENGTH_M * integers - computed
    misclosure[4] += 2.0 * WAVELENGTH_M
    misclosure[18] -= WAVELENGTH_M
    result = adapt_model(model, misclosure[None], np.eye(len(rows))[:, :, None])
    assert set(result.fault[0, :2]) == {4, 18}
    assert result.outcome[0] == Outcome.ADAPTED
    error = result.correction[0] @ np.linalg.inv(result.cov[0]) @ result.correction[0]
    # Chi-square of 3 degrees of freedom beyond 21.1 once in ten thousand.
    assert error < 21.1


def test_levels_from_phases_allow_for_satellites():
    """A satellite at fault at all antennas: a level where the others still determine the angle."""
    rng = np.random.default_rng(26)
    epoch, rot, _ = make_epoch(rng)
    alone = phase_reliability(epoch, rot)
    settings = ReliabilitySettings(satellite_prior=1e-4)
    both = phase_reliability(epoch, rot, settings=settings)
    assert np.all(both.protection_rad > alone.protection_rad)
    assert np.isfinite(both.protection_rad).all()
    # Of three satellites none can be missed.
    three, rot, _ = make_epoch(rng, n_sats=3)
    assert np.all(
        phase_reliability(three, rot, settings=settings).protection_state == ProtectionState.NO_REDUNDANCY
    )


def test_unknown_stage_is_refused():
    epoch, rot, _ = make_epoch(np.random.default_rng(20))
    with pytest.raises(ConfigError, match="neither attitude nor vectors"):
        phase_reliability(epoch, rot, stage="baselines")


# Protection levels


def test_level_without_faults_is_the_quantile():
    level, state = protection_level(
        np.array([[2.0]]), np.zeros((1, 1, 0)), np.zeros(0), np.zeros((1, 0)), risk=2.699796e-3
    )
    assert level[0, 0] == pytest.approx(6.0, rel=1e-5)
    assert state[0, 0] == ProtectionState.OK


def test_level_adds_up_to_the_risk():
    from scipy.stats import norm

    rng = np.random.default_rng(21)
    sd, separation = rng.uniform(1.0, 2.0, (50, 3)), rng.uniform(0.0, 5.0, (50, 3, 4))
    prior, limit = np.array([1e-3, 1e-4, 1e-5, 1e-6]), rng.uniform(10.0, 20.0, (50, 4))
    level, _ = protection_level(sd, separation, prior, limit, risk=1e-4, wrong_integer_risk=2e-5)
    total = 2.0 * norm.sf(level / sd)
    spread = np.sqrt(sd[..., None] ** 2 + separation**2)
    tail = 2.0 * norm.sf((level[..., None] - np.sqrt(limit)[:, None] * separation) / spread)
    total += np.sum(prior * np.minimum(tail, 1.0), axis=-1)
    left = 1e-4 - 2e-5 - multiple_fault_risk(prior)
    np.testing.assert_allclose(total, left, rtol=2e-4)
    assert np.all(total <= left * (1.0 + 1e-5))


def test_why_there_is_no_level():
    sd, separation = np.ones((1, 3)), np.array([[[1.0, 1.0], [1.0, np.inf], [np.inf, np.inf]]])
    limit = np.full((1, 2), 12.0)

    def states(prior, **options):
        level, state = protection_level(sd, separation, np.array(prior), limit, **options)
        assert np.array_equal(np.isinf(level), state != ProtectionState.OK)
        return [ProtectionState(code).name for code in state[0]]

    assert states([1e-4, 1e-6], risk=1e-5) == ["OK", "OK", "NO_REDUNDANCY"]
    assert states([1e-4, 1e-4], risk=1e-5) == ["OK", "NO_REDUNDANCY", "NO_REDUNDANCY"]
    assert states([1e-2, 1e-2], risk=1e-5) == ["MULTIPLE_FAULTS"] * 3
    assert states([1e-4, 1e-6], risk=1e-5, wrong_integer_risk=1e-3) == ["WRONG_INTEGERS"] * 3
    assert states([1e-4, 1e-6], risk=1e-5, wrong_integer_risk=np.array([np.nan])) == ["WRONG_INTEGERS"] * 3


def test_risk_of_several_faults():
    prior = np.array([0.1, 0.2, 0.3])
    none = 0.9 * 0.8 * 0.7
    one = 0.1 * 0.8 * 0.7 + 0.9 * 0.2 * 0.7 + 0.9 * 0.8 * 0.3
    assert multiple_fault_risk(prior) == pytest.approx(1.0 - none - one)
    assert multiple_fault_risk(np.full(4, 1e-9)) == pytest.approx(6e-18)


def test_levels_grow_with_the_risk_of_wrong_integers_until_there_is_none():
    rng = np.random.default_rng(22)
    rot = np.repeat(rot_ned_from_body(0.3, 0.02, 0.01)[None], 4, axis=0)
    vectors = make_vectors(rot, rng, names=("aft", "fore", "left", "right"))
    result = attitude_reliability(vectors, rot, wrong_integer_risk=np.array([0.0, 5e-6, 2e-5, 0.0]))
    assert np.all(result.protection_rad[1] > result.protection_rad[0])
    assert np.all(np.isinf(result.protection_rad[2]))
    assert np.all(result.protection_rad[0] > 4.4 * result.sd_rad[0])
    texts = [event.text for event in protection_events(result)]
    assert len(texts) == 6
    assert texts[0].startswith("heading has no protection level at a risk of 1e-05: the integers are wrong")
    assert texts[3].startswith("heading has a protection level again")


# Sentences


def test_events_tell_statistic_limit_and_consequence():
    rng = np.random.default_rng(23)
    rot = attitudes(2, rng)
    shift = np.array([[0.0, 0.0, 0.0], [0.3, 0.1, -0.1]])
    vectors = make_vectors(rot, rng, shift_m=shift, antenna=3, names=("aft", "fore", "left", "right"))
    (event,) = adaptation_events(adapt_attitude(vectors))
    assert event.kind == "excluded"
    assert event.time_ns == 10**9
    assert event.statistic > event.limit == ReliabilitySettings().limit(3)
    assert event.text.startswith("antenna right contradicts the others (test ")
    assert event.text.endswith("and is left out; the attitude rests on aft, fore and left")
    kept = reliability_events(attitude_reliability(vectors, rot))
    assert [event.time_ns for event in kept] == [10**9]
    assert "antenna right stands out most" in kept[0].text


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("false_alarm", 0.0),
        ("missed_detection", 1.0),
        ("integrity_risk", -1e-5),
        ("fault_prior", 1.0),
        ("wrong_integer_risk", -0.1),
        ("max_rejections", -1),
        ("separation", float("nan")),
    ],
)
def test_impossible_settings_are_refused(key, value):
    with pytest.raises(ConfigError, match=key):
        ReliabilitySettings(**{key: value})
