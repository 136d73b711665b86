"""Attitude from baselines: exact geometry, covariance, wrong vectors, antennas on one line, missing ones."""

from dataclasses import replace

import numpy as np
import pytest

from synthetic_array import BODY_M, NAMES, make_attitude, make_baselines, true_angles
from truenorth.attitude.adjustment import free_of_length
from truenorth.attitude.array import attitude_from_baselines, solve_array
from truenorth.attitude.vectors import (
    angle_covariance,
    array_extent_m,
    fit_rotation,
    shared_reference_covariance,
    wahba_rotation,
    weighted_square,
)
from truenorth.config import GnssSettings
from truenorth.errors import ConfigError, Reason, Status
from truenorth.rotations import exp_so3, heading_pitch_roll, rot_ned_from_body


def errors_rad(solution):
    angles = np.stack([solution.heading_rad, solution.pitch_rad, solution.roll_rad], axis=1)
    error = angles - true_angles(solution.n_epochs)
    return (error + np.pi) % (2.0 * np.pi) - np.pi


def with_vector_error(baselines, k, epochs, error_enu_m):
    """The same baselines with a wrong vector at some epochs."""
    enu_m = baselines[k].baseline_enu_m.copy()
    enu_m[epochs] += error_enu_m
    return [*baselines[:k], replace(baselines[k], baseline_enu_m=enu_m), *baselines[k + 1 :]]


def without_epochs(baselines, k, epochs):
    """The same baselines, one of them not accepted at some epochs."""
    status, reason = baselines[k].status.copy(), baselines[k].reason.copy()
    status[epochs], reason[epochs] = Status.FLOAT, Reason.RATIO_TEST
    return [*baselines[:k], replace(baselines[k], status=status, reason=reason), *baselines[k + 1 :]]


def test_vectors_without_noise_give_the_attitude_exactly():
    solution = make_attitude(60, sd_m=(1e-9, 1e-9, 1e-9))
    # Nanometres over metres.
    assert np.max(np.abs(errors_rad(solution))) < 1e-8
    assert solution.is_accepted.all()
    assert (solution.reason == Reason.OK).all()
    np.testing.assert_array_equal(solution.n_antennas_used, 4)


def test_two_vectors_are_enough():
    solution = make_attitude(60, body_m=BODY_M[:3], names=NAMES[:3], sd_m=(1e-9, 1e-9, 1e-9))
    assert np.max(np.abs(errors_rad(solution))) < 1e-8


def test_a_flat_array_is_not_taken_for_its_mirror_image():
    flat = BODY_M * [1.0, 1.0, 0.0]
    solution = make_attitude(60, body_m=flat, sd_m=(1e-9, 1e-9, 1e-9))
    assert np.max(np.abs(errors_rad(solution))) < 1e-8
    assert np.linalg.det(solution.rot_ned_from_body) == pytest.approx(1.0, abs=1e-12)


def test_wahba_is_the_fit_with_equal_weights():
    rng = np.random.default_rng(3)
    rot = rot_ned_from_body(*true_angles(20).T)
    body = BODY_M[1:]
    # The fit ties the vectors by their first antenna; a common error there is what makes it differ.
    measured = np.einsum("nij,kj->nki", rot, body) + 0.01 * rng.standard_normal((20, 3, 3))
    start = wahba_rotation(measured, body, np.ones((20, 3)))
    cov = shared_reference_covariance(np.broadcast_to(np.eye(3), (20, 3, 3, 3)))
    fit = fit_rotation(measured, cov, body)
    # Same data, other weights: apart by less than the noise, 0.01 m over a metre.
    turn = np.einsum("nji,njk->nik", start, fit.rot_ned_from_body)
    assert np.max(np.abs(turn - np.eye(3))) < 0.02
    # The best rotation is stationary: turning it either way raises the sum of squares.
    best = weighted_square(fit.residual_m, cov)
    for axis in np.eye(3):
        for side in (-1e-3, 1e-3):
            turned = exp_so3(side * axis) @ fit.rot_ned_from_body
            assert (weighted_square(measured - np.einsum("nij,kj->nki", turned, body), cov) > best).all()


def test_vectors_share_half_of_their_variance_with_the_reference():
    rng = np.random.default_rng(5)
    factor = np.tril(rng.standard_normal((3, 3, 3))) + 3.0 * np.eye(3)
    cov = factor @ np.swapaxes(factor, 1, 2)
    whole = np.zeros((9, 9))
    for i in range(3):
        for j in range(3):
            whole[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] = factor[i] @ factor[j].T * (1.0 if i == j else 0.5)
    np.testing.assert_allclose(shared_reference_covariance(cov[None])[0], whole, rtol=1e-12, atol=1e-12)
    residual = rng.standard_normal((3, 3))
    expected = residual.ravel() @ np.linalg.solve(whole, residual.ravel())
    assert weighted_square(residual[None], whole[None])[0] == pytest.approx(expected, rel=1e-12)


def test_covariance_of_the_angles_is_that_of_finite_turns():
    angles = np.array([[0.3, -0.4, 0.7]])
    rot = rot_ned_from_body(*angles.T)
    cov = np.diag([1.0, 4.0, 9.0])[None]
    jacobian = np.empty((3, 3))
    for k, axis in enumerate(np.eye(3)):
        ahead = np.ravel(heading_pitch_roll(exp_so3(1e-6 * axis) @ rot))
        behind = np.ravel(heading_pitch_roll(exp_so3(-1e-6 * axis) @ rot))
        jacobian[:, k] = (ahead - behind) / 2e-6
    found = angle_covariance(rot, cov)[0]
    np.testing.assert_allclose(found, jacobian @ cov[0] @ jacobian.T, rtol=1e-6)


def test_a_wrong_vector_of_four_antennas_is_left_out():
    wrong = np.arange(50, 80)
    baselines = with_vector_error(make_baselines(120), 1, wrong, [0.12, -0.1, 0.05])
    solution = make_attitude(baselines=baselines)
    assert solution.is_excluded[wrong, 2].all()
    assert not np.delete(solution.is_excluded, wrong, axis=0).any()
    assert not solution.is_excluded[:, [0, 1, 3]].any()
    assert solution.is_accepted.all()
    np.testing.assert_array_equal(solution.n_antennas_used[wrong], 3)
    np.testing.assert_array_equal(solution.excluded[wrong], "right")
    # Millimetres over one to two metres: five standard deviations of the worst angle.
    assert np.max(np.abs(errors_rad(solution))) < np.radians(3.0)
    said = [event for event in solution.events if event.kind in ("excluded", "returned")]
    assert [event.text.split()[0] for event in said] == ["right", "right"]
    assert said[0].statistic > said[0].limit


def test_a_wrong_vector_of_three_antennas_is_only_detected():
    wrong = np.arange(50, 60)
    body_m = BODY_M[:3]
    baselines = with_vector_error(make_baselines(120, body_m=body_m), 0, wrong, [0.15, 0.1, 0.0])
    solution = make_attitude(baselines=baselines, body_m=body_m, names=NAMES[:3])
    assert (solution.reason[wrong] == Reason.GEOMETRY_TEST).all()
    assert (solution.status[wrong] == Status.NONE).all()
    assert np.isnan(solution.heading_rad[wrong]).all()
    assert solution.is_accepted.sum() == 110


def test_two_wrong_vectors_of_five_antennas_are_left_out_one_after_the_other():
    body_m = np.vstack([BODY_M, [[-1.0, 0.4, -0.2], [1.5, -0.5, -0.6]]])
    names = (*NAMES, "mast", "bow")
    baselines = make_baselines(60, body_m=body_m)
    baselines = with_vector_error(baselines, 0, np.arange(60), [0.2, 0.1, 0.0])
    baselines = with_vector_error(baselines, 3, np.arange(60), [-0.1, 0.3, 0.1])
    solution = make_attitude(baselines=baselines, body_m=body_m, names=names)
    np.testing.assert_array_equal(solution.excluded, "fore+mast")
    assert solution.is_accepted.all()


def test_a_dead_receiver_degrades_and_a_single_baseline_has_no_roll():
    baselines = without_epochs(make_baselines(90), 1, np.arange(30, 90))
    baselines = without_epochs(baselines, 2, np.arange(60, 90))
    solution = make_attitude(baselines=baselines, length_sd_m=0.0)
    assert solution.is_accepted.all()
    np.testing.assert_array_equal(solution.n_antennas_used, np.repeat([4, 3, 2], 30))
    # Only the baseline ahead is left: heading and pitch, and no roll.
    np.testing.assert_array_equal(solution.reason, np.repeat([0, 0, Reason.ROLL_UNOBSERVABLE], 30))
    assert np.isnan(solution.roll_rad[60:]).all()
    assert np.isnan(solution.cov_rad2[60:, 2]).all()
    assert np.isnan(solution.rot_ned_from_body[60:]).all()
    error = errors_rad(solution)[60:, :2]
    sd = np.sqrt(np.einsum("nii->ni", solution.cov_rad2))[60:, :2]
    assert np.max(np.abs(error / sd)) < 5.0
    # Twice the variance of 3 mm over 2 m, and of 3 mm of the body coordinates where they are not exact.
    assert sd[:, 0] == pytest.approx(np.sqrt(2.0) * 0.003 / 2.0, rel=0.02)
    unsure = make_attitude(baselines=baselines, length_sd_m=0.003)
    assert unsure.angle_sd_rad(0)[60:] == pytest.approx(np.sqrt(3.0) * 0.003 / 2.0, rel=0.02)


def test_a_single_baseline_across_the_body_gives_no_angles():
    baselines = without_epochs(without_epochs(make_baselines(40), 0, slice(None)), 2, slice(None))
    solution = make_attitude(baselines=baselines)
    assert (solution.reason == Reason.DIRECTION_ONLY).all()
    assert not solution.is_accepted.any()
    assert np.isnan(solution.heading_rad).all()
    assert not solution.is_used.any()


def test_antennas_on_one_line_ahead_give_heading_and_pitch():
    body_m = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [-1.5, 0.0, 0.0], [1.0, 0.001, 0.0]])
    solution = make_attitude(200, body_m=body_m)
    assert (solution.reason == Reason.ROLL_UNOBSERVABLE).all()
    error = errors_rad(solution)[:, :2]
    sd = np.sqrt(np.einsum("nii->ni", solution.cov_rad2))[:, :2]
    assert np.max(np.abs(error / sd)) < 5.0
    # Two long arms on both sides are better than either alone.
    assert np.mean(sd[:, 0]) < np.sqrt(2.0) * 0.003 / 2.0


def test_epochs_of_one_antenna_need_not_be_those_of_another():
    baselines = make_baselines(60)
    short = baselines[1]
    fields = {
        name: getattr(short, name)[20:40]
        for name in (
            "time_ns",
            "status",
            "reason",
            "baseline_enu_m",
            "cov_enu_m2",
            "n_sats",
            "position_ecef_m",
        )
    }
    fields["time_ns"] = fields["time_ns"] + 3_000_000  # three milliseconds off
    baselines[1] = replace(short, **fields)
    solution = make_attitude(
        baselines=[baselines[1], baselines[0]], body_m=BODY_M[[0, 2, 1]], names=NAMES[:3]
    )
    # The reference of make_attitude is the first baseline's own times here.
    assert solution.n_epochs == 20
    base_ns = make_baselines(60)[0].time_ns
    solution = attitude_from_baselines(
        baselines, BODY_M, base_ns, names=NAMES, settings=GnssSettings(max_time_difference_s=0.01)
    )
    assert solution.n_epochs == 60
    np.testing.assert_array_equal(solution.n_antennas_used, np.repeat([3, 4, 3], 20))
    np.testing.assert_array_equal(solution.time_ns, base_ns)


def test_what_no_baseline_solves_has_the_reason_of_the_nearest():
    baselines = make_baselines(40)
    for k in range(3):
        baselines = without_epochs(baselines, k, slice(10, 20))
    status = baselines[0].status.copy()
    status[10:20] = Status.NONE
    baselines[0] = replace(baselines[0], status=status)
    solution = make_attitude(baselines=baselines)
    assert (solution.reason[10:20] == Reason.RATIO_TEST).all()
    assert (solution.status[10:20] == Status.NONE).all()
    kinds = [event.kind for event in solution.events]
    assert kinds == ["fixed", "released", "fixed"]


def test_a_baseline_that_only_its_length_holds_is_not_used():
    """Two double differences and a length have two solutions, mirror images of each other."""
    baselines = make_baselines(40)
    cov = baselines[1].cov_enu_m2.copy()
    cov[10:20] += 4.0 * np.outer([0.6, 0.0, 0.8], [0.6, 0.0, 0.8])
    cov[20:25] = np.nan
    baselines[1] = replace(baselines[1], cov_enu_m2=cov)
    solution = make_attitude(baselines=baselines)
    assert not solution.is_used[10:25, 2].any()
    np.testing.assert_array_equal(solution.n_antennas_used, np.repeat([4, 3, 3, 4], [10, 10, 5, 15]))
    alone = make_attitude(baselines=baselines[1:2], body_m=BODY_M[[0, 2]], names=NAMES[:2])
    assert (alone.reason[10:25] == Reason.WEAK_GEOMETRY).all()


def test_held_baselines_make_a_held_attitude():
    baselines = make_baselines(30)
    status = baselines[2].status.copy()
    status[:10] = Status.HELD
    baselines[2] = replace(baselines[2], status=status)
    solution = make_attitude(baselines=baselines)
    np.testing.assert_array_equal(solution.status, np.repeat([Status.HELD, Status.FIXED, Status.FIXED], 10))


def test_the_length_is_taken_out_of_an_adjusted_baseline():
    """Adjust with a length as the engine does, take it out, and get the phases' own baseline back."""
    free = make_baselines(50)[1]
    length_m, sd_m = 1.8248, 0.002
    information = np.linalg.inv(free.cov_enu_m2[0])
    adjusted, cov = np.empty((50, 3)), np.empty((50, 3, 3))
    for n, b_free in enumerate(free.baseline_enu_m):
        b = b_free.copy()
        for _ in range(100):
            size = np.linalg.norm(b)
            bend = (size - length_m) / (sd_m**2 * size)
            u = b / size
            hessian = information + bend * np.eye(3) + (1.0 / sd_m**2 - bend) * np.outer(u, u)
            b -= np.linalg.solve(hessian, information @ (b - b_free) + bend * b)
        adjusted[n], cov[n] = b, np.linalg.inv(hessian)
    assert np.max(np.abs(adjusted - free.baseline_enu_m)) > 1e-3
    settings = {**free.settings, "length_m": length_m, "length_sd_m": sd_m, "method": "constrained"}
    found_m, found_cov_m2 = free_of_length(
        replace(free, baseline_enu_m=adjusted, cov_enu_m2=cov, settings=settings)
    )
    np.testing.assert_allclose(found_m, free.baseline_enu_m, atol=1e-9)
    np.testing.assert_allclose(found_cov_m2, free.cov_enu_m2, rtol=1e-6, atol=1e-12)


def test_extent_along_and_across():
    along, across, axis = array_extent_m(np.array([[-2.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    assert (along, across) == (pytest.approx(np.sqrt(5.0)), pytest.approx(0.0, abs=1e-12))
    np.testing.assert_allclose(axis, [1.0, 0.0, 0.0], atol=1e-12)
    assert array_extent_m(BODY_M[1:])[1] > 1.0


@pytest.mark.parametrize(
    ("antennas", "body_m", "options", "words"),
    [
        (["a"], [[0, 0, 0]], {}, "give two or more"),
        (["a", "b", "c"], [[0, 0, 0], [1, 0, 0]], {}, "body coordinates of shape"),
        (["a", "b"], [[0, 0, 0], [1, 0, 0]], {"names": ["a"]}, "1 names"),
        (["a", "b"], [[0, 0, 0], [1, 0, 0]], {"length_m": 1.0}, "leave it out"),
    ],
)
def test_refuses_arrays_that_cannot_be(antennas, body_m, options, words):
    with pytest.raises(ConfigError, match=words):
        solve_array(antennas, body_m, **options)
