"""Filter and smoother of attitude and rate: formulas, forms, and what happens to bad and missing vectors."""

import itertools
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from filtered_arrays import DEGREE, SOLID_M, SQUARE_M, array_vectors, turning_runs
from truenorth._kernels import attitude_filter as kernels
from truenorth.attitude.filter import (
    AttitudeFilterSettings,
    FilterStatus,
    filter_attitude,
    innovations,
)
from truenorth.attitude.white_rows import ArrayInformation, white_rows
from truenorth.errors import ConfigError, ModelError
from truenorth.rotations import exp_so3, heading_pitch_roll, log_so3, rot_ned_from_body, skew

SECOND = 1_000_000_000


def steady(n=40, dt_s=0.1, body=SQUARE_M, sd_m=0.003, rng=None):
    """A level array that turns by 10 degrees a second."""
    time_ns = np.rint(np.arange(n) * dt_s * 1e9).astype(np.int64)
    heading = 10.0 * DEGREE * 1e-9 * time_ns
    rot = rot_ned_from_body(heading, 0.05, -0.1)
    return rot, array_vectors(time_ns, rot, body, sd_m=sd_m, rng=rng)


def errors(filtered, rot, rate=None):
    """Rotation error, and rate error, in body axes."""
    turn = log_so3(np.swapaxes(filtered.rot_ned_from_body, 1, 2) @ rot)
    return turn if rate is None else np.concatenate([turn, rate - filtered.rate_body_radps], axis=1)


def assert_same(one, other, rtol=1e-9):
    """Same states and covariances."""
    assert np.array_equal(one.status, other.status)
    np.testing.assert_allclose(one.rot_ned_from_body, other.rot_ned_from_body, atol=1e-10)
    np.testing.assert_allclose(one.rate_body_radps, other.rate_body_radps, atol=1e-9)
    np.testing.assert_allclose(one.cov, other.cov, rtol=rtol, atol=1e-16)


def test_states_are_those_of_the_package():
    assert [int(s) for s in FilterStatus] == [kernels.S_NONE, kernels.S_PREDICTED, kernels.S_UPDATED]
    assert [s.label for s in FilterStatus] == ["none", "predicted", "updated"]


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-3, 0.02, 0.7, 2.5])
def test_rotations_of_the_kernel_are_those_of_the_package(size):
    vector = size * np.array([0.6, -0.48, 0.64])
    rot, back, jacobian, inverse = np.empty((3, 3)), np.empty((3, 1)), np.empty((3, 3)), np.empty((3, 3))
    kernels.turn(*vector, rot)
    np.testing.assert_allclose(rot, exp_so3(vector), atol=1e-15)
    start = exp_so3(np.array([0.3, 1.0, -0.4]))
    kernels.rotation_vector_between(start, start @ rot, back)
    np.testing.assert_allclose(back[:, 0], vector, rtol=1e-9, atol=1e-15)
    kernels.right_jacobian(*vector, jacobian)
    kernels.right_jacobian_inverse(*vector, inverse)
    np.testing.assert_allclose(jacobian @ inverse, np.eye(3), atol=1e-9)
    step = 1e-6
    for axis in np.eye(3):
        ahead, behind = exp_so3(vector + step * axis), exp_so3(vector - step * axis)
        slope = (log_so3(rot.T @ ahead) - log_so3(rot.T @ behind)) / (2.0 * step)
        np.testing.assert_allclose(jacobian @ axis, slope, atol=1e-8)


def predicted(rot, rate, dt, noise=(0.0, 0.0, 0.0), cov=None):
    """State, covariance and transition after a step of the kernel."""
    pose = np.vstack([rot, rate])
    cov = np.zeros((6, 6)) if cov is None else cov.copy()
    phi, work, small, other = (np.empty((6, 6)) for _ in range(4))
    kernels.predict(
        dt, np.array(noise), np.int64(0), True, pose, cov, np.empty((6, 0)), 0, phi, work, small, other
    )
    return pose[:3], pose[3], cov, phi


def test_transition_is_the_derivative_of_the_motion():
    rot, rate, dt = exp_so3(np.array([0.2, -0.5, 1.0])), np.array([0.4, -0.9, 1.3]), 0.7
    ahead, _, _, phi = predicted(rot, rate, dt)
    step = 1e-6
    for k in range(6):
        change = np.zeros(6)
        change[k] = step
        up, up_rate, _, _ = predicted(rot @ exp_so3(change[:3]), rate + change[3:], dt)
        down, down_rate, _, _ = predicted(rot @ exp_so3(-change[:3]), rate - change[3:], dt)
        slope = np.concatenate([log_so3(ahead.T @ up) - log_so3(ahead.T @ down), up_rate - down_rate])
        np.testing.assert_allclose(phi[:, k], slope / (2.0 * step), atol=1e-8)


def test_noise_of_a_step_does_not_depend_on_how_it_is_divided():
    rot, rate, noise = np.eye(3), np.array([0.3, -0.2, 0.8]), (0.1, 0.2, 0.3)
    _, _, whole, _ = predicted(rot, rate, 1.2, noise)
    cov = np.zeros((6, 6))
    for part in (0.5, 0.1, 0.6):
        rot, rate, cov, _ = predicted(rot, rate, part, noise, cov)
    # A step of 60 degrees here; at the usual ones nothing is left but rounding.
    np.testing.assert_allclose(cov, whole, rtol=1e-7, atol=1e-12)
    # Without a turn it is the integral of white noise, q [[t^3/3, t^2/2], [t^2/2, t]].
    _, _, still, _ = predicted(np.eye(3), np.zeros(3), 1.2, noise)
    expected = np.kron(np.array([[1.2**3 / 3.0, 1.2**2 / 2.0], [1.2**2 / 2.0, 1.2]]), np.diag(noise))
    np.testing.assert_allclose(still, expected, rtol=1e-12, atol=1e-16)


def test_design_of_the_rows_is_their_derivative():
    rng = np.random.default_rng(4)
    rot, eta = exp_so3(np.array([0.2, -0.5, 1.0])), np.array([0.1, 0.3, -0.2])
    rows, y, m = rng.standard_normal((5, 12)), rng.standard_normal(5), 4

    def misfit(at):
        design, left = np.empty((5, 3)), np.empty(5)
        turned, jacobian = np.empty((3, 3)), np.empty((3, 3))
        kernels.linearise(rows, y, 5, SOLID_M, m, rot, at, turned, jacobian, np.empty((12, 4)), design, left)
        return left, design

    value, design = misfit(eta)
    expected = y - rows @ (SOLID_M @ (rot @ exp_so3(eta)).T).ravel()
    np.testing.assert_allclose(value, expected, atol=1e-12)
    for k, axis in enumerate(np.eye(3)):
        slope = (misfit(eta + 1e-6 * axis)[0] - misfit(eta - 1e-6 * axis)[0]) / 2e-6
        np.testing.assert_allclose(-design[:, k], slope, atol=1e-7)


def test_eliminated_rows_are_the_vectors_without_the_antenna():
    rng = np.random.default_rng(5)
    _, vectors = steady(1, body=SOLID_M, rng=rng)
    for antenna in range(4):
        white = white_rows(vectors, slice(0, 1))
        rows, y = white.rows[0], white.y[0]
        left = kernels.eliminate(rows, y, 9, 12, 3 * antenna, kernels.BLOCK)
        assert left == 6
        use = np.ones((1, 4), dtype=bool)
        use[0, antenna] = False
        if antenna == 0:
            # Without the reference the vectors are those from the next antenna.
            points = np.concatenate([[np.zeros(3)], vectors.vector_ned_m[0, 1:]])
            without = replace(vectors, reference=np.array([1]), vector_ned_m=(points - points[1])[None])
            without = replace(without, cov_ned_m2=np.roll(vectors.cov_ned_m2, 3, axis=(1, 2)))
            without.vector_ned_m[0, :2] = np.nan
            without.cov_ned_m2[0, :6] = without.cov_ned_m2[0, :, :6] = np.nan
            without.cov_ned_m2[0, 6:, 6:] = vectors.cov_ned_m2[0, 6:, 6:]
            other = white_rows(without, slice(0, 1))
        else:
            other = white_rows(vectors, slice(0, 1), use)
        normal = rows[:left].T @ rows[:left]
        expected = other.rows[0].T @ other.rows[0]
        np.testing.assert_allclose(normal, expected, atol=1e-6 * np.abs(expected).max())
        right = other.rows[0].T @ other.y[0]
        np.testing.assert_allclose(rows[:left].T @ y[:left], right, atol=1e-6 * np.abs(right).max())


def test_update_is_the_one_of_kalman_and_its_parts_are_given_out():
    rng = np.random.default_rng(6)
    _, vectors = steady(30, body=SOLID_M, rng=rng)
    settings = AttitudeFilterSettings(gate=False)
    filtered = filter_attitude(vectors, settings)
    seen = 0
    for block, part in innovations(filtered, vectors):
        for e, k in enumerate(block.epochs):
            total = part.design[e] @ part.predicted_cov[e] @ part.design[e].T + block.cov_ned_m2[e]
            np.testing.assert_allclose(part.cov_m2[e], total, rtol=1e-12)
            gain = part.predicted_cov[e] @ part.design[e].T @ np.linalg.inv(total)
            np.testing.assert_allclose(part.gain[e], gain, rtol=1e-7, atol=1e-9)
            change = gain @ part.innovation_m[e]
            turn = log_so3(filtered.predicted_rot[k].T @ filtered.rot_ned_from_body[k])
            sd = np.sqrt(np.diag(part.predicted_cov[e]))
            # The iteration ends when a step is a ten-thousandth of an sd.
            assert np.all(np.abs(turn - change[:3]) < 1e-3 * sd[:3])
            step = filtered.rate_body_radps[k] - filtered.predicted_rate[k]
            assert np.all(np.abs(step - change[3:]) < 1e-3 * sd[3:])
            after = (np.eye(6) - gain @ part.design[e]) @ part.predicted_cov[e]
            jacobian = np.eye(6)
            kernels.right_jacobian(*change[:3], small := np.empty((3, 3)))
            jacobian[:3, :3] = small
            after = jacobian @ after @ jacobian.T
            np.testing.assert_allclose(
                filtered.cov[k] / np.outer(sd, sd), after / np.outer(sd, sd), atol=1e-4
            )
            chi2 = part.innovation_m[e] @ np.linalg.solve(total, part.innovation_m[e])
            assert filtered.chi2[k] == pytest.approx(chi2, rel=1e-3)
            seen += 1
    assert seen == 29


def test_angles_and_ned_covariance_belong_together():
    rot, vectors = steady(20)
    filtered = filter_attitude(vectors)
    heading, pitch, roll = heading_pitch_roll(rot)
    np.testing.assert_allclose(filtered.heading_rad, heading, atol=2e-4)
    np.testing.assert_allclose(filtered.pitch_rad, pitch, atol=2e-4)
    np.testing.assert_allclose(filtered.roll_rad, roll, atol=2e-4)
    # A turn about down is one of the heading alone.
    np.testing.assert_allclose(
        np.trace(filtered.cov_ned_rad2, axis1=1, axis2=2), np.trace(filtered.cov[:, :3, :3], axis1=1, axis2=2)
    )
    assert filtered.rate_ned_radps[-1] == pytest.approx([0.0, 0.0, 10.0 * DEGREE], abs=5e-3)


def test_phases_as_normal_equations_give_the_same_numbers():
    rng = np.random.default_rng(7)
    time_ns, rot, _ = turning_runs(rng, 2, [0.1] * 12, rate_noise_dps2_per_s=[40.0] * 3, rate_sd_dps=10.0)
    n = len(time_ns)
    missing = rng.random((n, 4)) < 0.2
    missing[::13] = False
    vectors = array_vectors(
        time_ns, rot, SOLID_M, rng=rng, reference=rng.integers(0, 4, n), is_missing=missing
    )
    information = ArrayInformation.from_vectors(vectors)
    assert_same(filter_attitude(information), filter_attitude(vectors), rtol=1e-6)
    use = rng.random((n, 4)) < 0.7
    assert_same(filter_attitude(information, is_used=use), filter_attitude(vectors, is_used=use), rtol=1e-6)


def test_information_that_determines_no_vector_still_turns_the_attitude():
    rot, vectors = steady(30, body=SOLID_M)
    whole = ArrayInformation.from_vectors(vectors)
    # The signals of two directions only from epoch 10 on: nothing is known of the third, east.
    blind = np.kron(np.eye(4), np.diag([1.0, 0.0, 1.0]))
    normal = whole.normal_per_m2.copy()
    normal[10:] = blind @ normal[10:] @ blind
    stacked = np.nan_to_num(vectors.vector_ned_m).reshape(30, 12)
    weak = replace(whole, normal_per_m2=normal, right_side_per_m=np.einsum("nij,nj->ni", normal, stacked))
    filtered = filter_attitude(weak)
    assert np.all(filtered.status == FilterStatus.UPDATED)
    assert np.all(filtered.dof[10:] == 6)
    assert np.abs(errors(filtered, rot)).max() < 0.1 * DEGREE


def test_choice_of_the_reference_does_not_matter():
    rng = np.random.default_rng(8)
    time_ns, rot, _ = turning_runs(rng, 1, [0.1] * 30, rate_noise_dps2_per_s=[40.0] * 3, rate_sd_dps=10.0)
    one = array_vectors(time_ns, rot, SOLID_M, rng=np.random.default_rng(1))
    reference = rng.integers(0, 4, len(time_ns))
    other = array_vectors(time_ns, rot, SOLID_M, rng=np.random.default_rng(1), reference=reference)
    assert_same(filter_attitude(one), filter_attitude(other), rtol=1e-8)


@pytest.mark.jit
def test_blocks_give_the_same_as_the_whole(monkeypatch):
    rng = np.random.default_rng(9)
    time_ns, rot, _ = turning_runs(rng, 3, [0.1] * 40, rate_noise_dps2_per_s=[40.0] * 3, rate_sd_dps=10.0)
    vectors = array_vectors(time_ns, rot, SOLID_M, rng=rng, is_missing=rng.random((len(time_ns), 4)) < 0.4)
    vectors = replace(vectors, body_cov_m2=np.eye(12) * 1e-6)
    whole = filter_attitude(vectors)
    cut, state, parts = [0, 7, 8, 41, 60, len(time_ns)], None, []
    for first, last in itertools.pairwise(cut):
        piece = replace(
            vectors,
            **{
                name: getattr(vectors, name)[first:last]
                for name in ("time_ns", "reference", "vector_ned_m", "cov_ned_m2")
            },
        )
        parts.append(filter_attitude(piece, state=state))
        state = parts[-1].state
    for name in ("status", "rot_ned_from_body", "rate_body_radps", "cov", "chi2", "segment", "is_used"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(joined, getattr(whole, name), err_msg=name)
    assert sum((part.events for part in parts), ()) == whole.events
    # Blocks that the filter makes itself to bound its memory.
    monkeypatch.setattr("truenorth.attitude.filter_run.BLOCK_NUMBERS", 5 * 108)
    for direction in ("forward", "backward", "smoother"):
        settings = AttitudeFilterSettings(direction=direction)
        small = filter_attitude(vectors, settings)
        monkeypatch.undo()
        assert_same(small, filter_attitude(vectors, settings), rtol=1e-12)
        monkeypatch.setattr("truenorth.attitude.filter_run.BLOCK_NUMBERS", 5 * 108)


def test_backward_is_forward_in_reversed_time():
    rng = np.random.default_rng(10)
    time_ns, rot, _ = turning_runs(rng, 1, [0.1, 0.3] * 15, rate_noise_dps2_per_s=[40.0] * 3, rate_sd_dps=9.0)
    vectors = array_vectors(time_ns, rot, SOLID_M, rng=rng)
    mirrored = replace(
        vectors,
        time_ns=time_ns[-1] - time_ns[::-1],
        vector_ned_m=vectors.vector_ned_m[::-1],
        cov_ned_m2=vectors.cov_ned_m2[::-1],
    )
    backward = filter_attitude(vectors, AttitudeFilterSettings(direction="backward"))
    forward = filter_attitude(mirrored)
    np.testing.assert_allclose(backward.rot_ned_from_body, forward.rot_ned_from_body[::-1], atol=1e-12)
    np.testing.assert_allclose(backward.rate_body_radps, -forward.rate_body_radps[::-1], atol=1e-12)
    np.testing.assert_allclose(backward.heading_rad, forward.heading_rad[::-1], atol=1e-12)
    np.testing.assert_allclose(backward.cov[:, :3, 3:], -forward.cov[::-1, :3, 3:], atol=1e-15)
    np.testing.assert_array_equal(backward.time_ns, time_ns)
    assert backward.state is None


@pytest.mark.parametrize("process", ["continuous", "wang"])
def test_smoother_is_the_batch_adjustment(process):
    """Against one Gauss-Newton adjustment of all epochs at once, prior, steps and vectors together."""
    rng = np.random.default_rng(11)
    time_ns, rot, _ = turning_runs(
        rng, 1, [0.1, 0.3, 0.2, 0.4, 0.1], rate_noise_dps2_per_s=[40.0] * 3, rate_sd_dps=20.0
    )
    vectors = array_vectors(time_ns, rot, SOLID_M, rng=rng)
    settings = AttitudeFilterSettings(direction="smoother", process=process, gate=False)
    smoothed = filter_attitude(vectors, settings)
    white = white_rows(vectors, slice(None))
    n = len(time_ns)
    at_rot, at_rate = smoothed.rot_ned_from_body.copy(), smoothed.rate_body_radps.copy()
    noise = np.array([4.0 if process == "wang" else 40.0] * 3) * DEGREE**2
    for _ in range(8):
        normal, right = np.zeros((6 * n, 6 * n)), np.zeros(6 * n)
        sd = settings.initial_rate_sd_dps * DEGREE
        normal[3:6, 3:6] += np.eye(3) / sd**2
        right[3:6] -= at_rate[0] / sd**2
        for k in range(n):
            design = white.rows[k] @ np.concatenate(-at_rot[k] @ skew(SOLID_M))
            misfit = white.y[k] - white.rows[k] @ (SOLID_M @ at_rot[k].T).ravel()
            here = slice(6 * k, 6 * k + 3)
            normal[here, here] += design.T @ design
            right[here] += design.T @ misfit
            if k:
                dt = 1e-9 * (time_ns[k] - time_ns[k - 1])
                ahead, rate, _, phi = predicted(at_rot[k - 1], at_rate[k - 1], dt)
                _, _, step_cov, _ = predicted(at_rot[k - 1], at_rate[k - 1], dt, noise)
                if process == "wang":
                    # A step of the rates alone is singular; a tiny turn beside it makes it regular.
                    step_cov = np.diag(np.concatenate([np.full(3, 1e-14), noise]))
                gap = np.concatenate([log_so3(ahead.T @ at_rot[k]), at_rate[k] - rate])
                jump = np.zeros((6, 6 * n))
                jump[:, 6 * k : 6 * k + 6] = np.eye(6)
                inverse = np.empty((3, 3))
                kernels.right_jacobian_inverse(*gap[:3], inverse)
                jump[:3, 6 * k : 6 * k + 3] = inverse
                jump[:, 6 * k - 6 : 6 * k] = -phi
                weight = np.linalg.inv(step_cov)
                normal += jump.T @ weight @ jump
                right -= jump.T @ weight @ gap
        step = np.linalg.solve(normal, right).reshape(n, 6)
        at_rot = at_rot @ exp_so3(step[:, :3])
        at_rate = at_rate + step[:, 3:]
    cov = np.linalg.inv(normal)
    for k in range(n):
        sd = np.sqrt(np.diag(cov[6 * k : 6 * k + 6, 6 * k : 6 * k + 6]))
        turn = log_so3(at_rot[k].T @ smoothed.rot_ned_from_body[k])
        # The smoother linearises each step once; the difference is of second order in the corrections.
        assert np.all(np.abs(turn) < 0.05 * sd[:3])
        assert np.all(np.abs(at_rate[k] - smoothed.rate_body_radps[k]) < 0.05 * sd[3:])
        np.testing.assert_allclose(np.sqrt(np.diag(smoothed.cov[k])), sd, rtol=0.02)


def test_smoother_never_knows_less_than_the_filter():
    rng = np.random.default_rng(12)
    time_ns, rot, _ = turning_runs(rng, 2, [0.1, 0.5] * 20, rate_noise_dps2_per_s=[40.0] * 3, rate_sd_dps=9.0)
    vectors = array_vectors(time_ns, rot, SOLID_M, rng=rng, is_missing=rng.random((len(time_ns), 4)) < 0.3)
    forward, smoother = (
        filter_attitude(vectors, AttitudeFilterSettings(direction=d, gate=False))
        for d in ("forward", "smoother")
    )
    both = (forward.status > 0) & (smoother.status > 0)
    # Linearised about other attitudes, a hundredth of slack.
    gain = np.linalg.eigvalsh(1.01 * forward.cov[both] - smoother.cov[both])
    assert np.all(gain[:, 0] > -1e-9)
    last = np.flatnonzero(both)[-1]
    np.testing.assert_allclose(smoother.cov[last], forward.cov[last])


@pytest.mark.jit
def test_times_between_epochs_change_nothing_at_the_epochs():
    rng = np.random.default_rng(13)
    time_ns, rot, _ = turning_runs(rng, 1, [0.2] * 30, rate_noise_dps2_per_s=[40.0] * 3, rate_sd_dps=9.0)
    vectors = array_vectors(time_ns, rot, SOLID_M, rng=rng)
    between = np.sort(np.concatenate([time_ns, time_ns[:-1] + 50_000_000, time_ns[:-1] + 170_000_000]))
    for direction in ("forward", "backward", "smoother"):
        for process in ("continuous", "wang"):
            settings = AttitudeFilterSettings(direction=direction, process=process)
            plain = filter_attitude(vectors, settings)
            dense = filter_attitude(vectors, settings, times_ns=between)
            at = np.searchsorted(between, time_ns)
            assert np.array_equal(dense.time_ns, between)
            assert np.all(dense.status[at] == plain.status)
            np.testing.assert_allclose(dense.cov[at], plain.cov, rtol=1e-4, atol=1e-12)
            turn = log_so3(np.swapaxes(plain.rot_ned_from_body, 1, 2) @ dense.rot_ned_from_body[at])
            assert np.abs(turn).max() < 1e-6
            assert dense.is_used[at].all()
            assert not dense.is_used[np.setdiff1d(np.arange(len(between)), at)].any()


def test_output_rate_and_prediction_in_both_directions():
    _, vectors = steady(21, dt_s=0.5)
    settings = AttitudeFilterSettings(direction="smoother", output_rate_hz=20.0)
    smooth = filter_attitude(vectors, settings)
    assert smooth.n_epochs == 201
    assert np.all(np.diff(smooth.time_ns) == 50_000_000)
    heading = 10.0 * DEGREE * 1e-9 * smooth.time_ns
    truth = rot_ned_from_body(heading, 0.05, -0.1)
    assert np.abs(errors(smooth, truth)).max() < 0.02 * DEGREE
    assert np.count_nonzero(smooth.status == FilterStatus.UPDATED) == 21
    # Two seconds before the first and after the last epoch: predicted, with a covariance that grows.
    outside = np.array([-2, -1, 0, 10, 11, 12]) * SECOND
    ends = filter_attitude(vectors, AttitudeFilterSettings(direction="smoother"), times_ns=outside)
    assert ends.status.tolist() == [1, 1, 2, 2, 1, 1]
    spread = np.trace(ends.cov[:, :3, :3], axis1=1, axis2=2)
    assert np.all(np.diff(spread[:3]) < 0.0)
    assert np.all(np.diff(spread[3:]) > 0.0)
    assert ends.heading_rad[:3] == pytest.approx(
        np.mod(DEGREE * np.array([-20.0, -10.0, 0.0]), 2 * np.pi), abs=5e-3
    )
    # The forward filter does not know the future.
    assert filter_attitude(vectors, times_ns=outside).status.tolist() == [0, 0, 2, 2, 1, 1]


def test_prediction_ends_after_its_time_and_the_filter_starts_anew():
    _, vectors = steady(200)
    use = np.ones((200, 4), dtype=bool)
    use[50:120] = False
    settings = AttitudeFilterSettings(rate_noise_dps2_per_s=(1.0,) * 3, max_prediction_s=5.0)
    filtered = filter_attitude(vectors, settings, is_used=use)
    # The last update is at epoch 49; epoch 99 is five seconds later.
    assert np.all(filtered.status[50:100] == FilterStatus.PREDICTED)
    assert np.all(filtered.status[100:120] == FilterStatus.NONE)
    assert np.all(np.isnan(filtered.heading_rad[100:120]))
    assert np.all(filtered.status[120:] == FilterStatus.UPDATED)
    assert filtered.segment[[99, 100, 120]].tolist() == [0, -1, 1]
    assert np.all(np.diff(np.trace(filtered.cov[50:100, :3, :3], axis1=1, axis2=2)) > 0.0)
    kinds = [event.kind for event in filtered.events]
    assert kinds == ["start", "gap", "start"]
    assert all(event.text.endswith(".") and event.text[0].isupper() for event in filtered.events)
    # What is too uncertain is not given out.
    strict = msgspec.structs.replace(settings, max_sd_deg=1.0)
    short = filter_attitude(vectors, strict, is_used=use)
    assert np.count_nonzero(short.status == FilterStatus.PREDICTED) < 20


def test_start_from_vectors_of_two_epochs():
    rot, vectors = steady(40, body=SQUARE_M[:3])
    use = np.zeros((40, 3), dtype=bool)
    use[5::2, 1] = True
    use[6::2, 2] = True
    filtered = filter_attitude(vectors, is_used=use)
    assert np.all(filtered.status[:6] == FilterStatus.NONE)
    assert np.all(filtered.status[6:] == FilterStatus.UPDATED)
    assert np.flatnonzero(filtered.is_start).tolist() == [6]
    assert "2 epochs" in filtered.events[0].text
    sd = np.sqrt(np.trace(filtered.cov[:, :3, :3], axis1=1, axis2=2))
    off = np.linalg.norm(errors(filtered, rot), axis=1)
    assert np.all(off[6:] < 3.0 * sd[6:])
    assert off[-1] < 0.2 * DEGREE


def test_antennas_on_one_line_start_nothing_but_keep_a_filter_going():
    line = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    _, vectors = steady(20, body=line)
    filtered = filter_attitude(vectors)
    assert np.all(filtered.status == FilterStatus.NONE)
    assert [event.kind for event in filtered.events] == ["start"]
    # One vector alone keeps two angles, the third is predicted.
    _, vectors = steady(40)
    use = np.ones((40, 4), dtype=bool)
    use[20:, 2:] = False
    filtered = filter_attitude(vectors, is_used=use)
    assert np.all(filtered.status == FilterStatus.UPDATED)
    sd = np.sqrt(filtered.cov[:, [0, 1, 2], [0, 1, 2]])
    assert sd[39, 0] > 10.0 * sd[19, 0]
    assert np.all(sd[39, 1:] < 2.0 * sd[19, 1:])


@pytest.mark.parametrize("antenna", [0, 1, 3])
def test_wrong_antenna_is_left_out_and_said(antenna):
    rng = np.random.default_rng(14)
    rot, vectors = steady(60, body=SOLID_M, rng=rng)
    wrong = vectors.vector_ned_m.copy()
    jump = np.array([0.0, 0.19, 0.0])
    # An error of the reference antenna goes into all vectors.
    wrong[30:33] += -jump if antenna == 0 else np.where(np.arange(4)[:, None] == antenna, jump, 0.0)
    filtered = filter_attitude(replace(vectors, vector_ned_m=wrong))
    name = "ABCD"[antenna]
    assert filtered.is_rejected[30:33, antenna].all()
    assert np.count_nonzero(filtered.is_rejected[30:33]) == 3
    assert not filtered.is_used[30:33, antenna].any()
    assert np.all(filtered.status[30:33] == FilterStatus.UPDATED)
    assert np.all(filtered.chi2[30:33] > filtered.chi2_limit[30:33])
    assert np.all(filtered.vector_statistic[30:33] > 16.27)
    assert np.abs(errors(filtered, rot))[20:].max() < 0.6 * DEGREE
    events = [event for event in filtered.events if event.kind == "outlier"]
    assert {event.signal for event in events if event.time_ns in vectors.time_ns[30:33]} == {name}
    assert all(event.statistic > event.limit for event in events if event.signal == name)
    assert f"Antenna {name} was left out of the attitude filter" in events[0].text
    without = filter_attitude(replace(vectors, vector_ned_m=wrong), AttitudeFilterSettings(gate=False))
    assert np.abs(errors(without, rot))[30:33].max() > 2.0 * DEGREE


def test_two_wrong_antennas_need_two_passes():
    rot, vectors = steady(40, body=np.vstack([SOLID_M, [[0.9, -0.8, 0.2]]]))
    wrong = vectors.vector_ned_m.copy()
    wrong[20, 1] += [0.0, 0.4, 0.1]
    wrong[20, 4] += [0.3, 0.0, -0.2]
    wrong = replace(vectors, vector_ned_m=wrong)
    filtered = filter_attitude(wrong)
    assert filtered.is_rejected[20].tolist() == [False, True, False, False, True]
    assert filtered.status[20] == FilterStatus.UPDATED
    # One pass is not enough, so the whole epoch is left out.
    capped = filter_attitude(wrong, AttitudeFilterSettings(max_passes=1))
    assert capped.status[20] == FilterStatus.PREDICTED
    assert capped.is_rejected[20].all()
    assert [event.kind for event in capped.events if event.time_ns == wrong.time_ns[20]][-1] == "rejected"
    assert np.abs(errors(capped, rot)).max() < 0.3 * DEGREE


def test_start_leaves_a_wrong_antenna_out():
    rot, vectors = steady(10, body=SOLID_M)
    wrong = vectors.vector_ned_m.copy()
    wrong[0, 2] += [0.19, 0.0, 0.0]
    filtered = filter_attitude(replace(vectors, vector_ned_m=wrong))
    assert filtered.status[0] == FilterStatus.UPDATED
    assert filtered.is_rejected[0].tolist() == [False, False, True, False]
    assert np.abs(errors(filtered, rot)).max() < 0.1 * DEGREE
    # Of three antennas it cannot be said which is wrong.
    three = replace(
        vectors,
        vector_ned_m=wrong[:, :3],
        cov_ned_m2=vectors.cov_ned_m2[:, :9, :9],
        positions_body_m=SOLID_M[:3],
        body_cov_m2=np.zeros((9, 9)),
    )
    filtered = filter_attitude(three)
    assert filtered.status[:2].tolist() == [FilterStatus.NONE, FilterStatus.UPDATED]
    assert "did not start" in filtered.events[0].text


@pytest.mark.parametrize(("recovery", "kind"), [("restart", "restart"), ("inflate", "widened")])
def test_lock_out_is_found_and_ended(recovery, kind):
    # The platform stands, and turns by a right angle while nothing is measured; the noise asked for is far
    # too small for that.
    time_ns = np.arange(80) * SECOND
    heading = np.where(np.arange(80) < 40, 0.0, 0.5 * np.pi)
    rot = rot_ned_from_body(heading, 0.0, 0.0)
    vectors = array_vectors(time_ns, rot, rng=np.random.default_rng(15))
    settings = AttitudeFilterSettings(rate_noise_dps2_per_s=(0.01,) * 3, recovery=recovery, lock_out_epochs=4)
    filtered = filter_attitude(vectors, settings)
    assert np.all(filtered.status[40:43] == FilterStatus.PREDICTED)
    assert filtered.is_lock_out[40:43].all()
    assert not filtered.is_lock_out[44:].any()
    assert np.flatnonzero(filtered.is_start).tolist() == [0, 43]
    kinds = [event.kind for event in filtered.events]
    assert [kinds.count("lock-out"), kinds.count(kind)] == [1, 1]
    assert np.abs(errors(filtered, rot))[46:].max() < 1.0 * DEGREE
    # Without the rule it never comes back.
    stuck = filter_attitude(
        vectors,
        AttitudeFilterSettings(rate_noise_dps2_per_s=(0.01,) * 3, recovery="none", max_prediction_s=60.0),
    )
    assert np.abs(errors(stuck, rot))[-1].max() > 45.0 * DEGREE
    if recovery == "restart":
        # The smoother goes back to where the rejections began.
        smooth = filter_attitude(vectors, msgspec.structs.replace(settings, direction="smoother"))
        assert np.all(smooth.status == FilterStatus.UPDATED)
        assert not smooth.is_lock_out.any()
        assert np.abs(errors(smooth, rot)).max() < 1.0 * DEGREE


def test_wrong_start_is_undone():
    """Integers that are wrong together at the first epoch: a rotated array that fits its coordinates."""
    rot, vectors = steady(30, body=SOLID_M, rng=np.random.default_rng(16))
    wrong = vectors.vector_ned_m.copy()
    wrong[0] = wrong[0] @ exp_so3(np.array([0.5, -0.2, 0.8])).T
    filtered = filter_attitude(replace(vectors, vector_ned_m=wrong))
    first, second = np.flatnonzero(filtered.is_start)
    assert first == 0
    # At first the rate is so uncertain that part of the turn could be true.
    assert 5 <= second <= 12
    assert filtered.is_lock_out[second - 4 : second].all()
    assert np.abs(errors(filtered, rot))[second:].max() < 1.5 * DEGREE


def test_contradicting_vectors_do_not_restart_a_locked_out_filter():
    rot, vectors = steady(60, body=SQUARE_M[:3])
    wrong = vectors.vector_ned_m.copy()
    wrong[20:40, 1] += [0.0, 0.4, 0.0]
    wrong[20:40, 2] += [0.3, 0.0, 0.2]
    filtered = filter_attitude(replace(vectors, vector_ned_m=wrong))
    assert not filtered.is_start[1:].any()
    assert [event.kind for event in filtered.events].count("lock-out") == 1
    assert np.all(filtered.status[40:] == FilterStatus.UPDATED)
    assert np.abs(errors(filtered, rot)).max() < 0.5 * DEGREE


@pytest.mark.jit
def test_body_coordinates_do_not_average_out():
    _, vectors = steady(400, sd_m=0.001)
    sd_m = 0.004
    unsure = replace(vectors, body_cov_m2=np.eye(12) * sd_m**2)
    settings = AttitudeFilterSettings(rate_noise_dps2_per_s=(0.01,) * 3)
    for direction in ("forward", "smoother"):
        exact, considered = (
            filter_attitude(each, msgspec.structs.replace(settings, direction=direction))
            for each in (vectors, unsure)
        )
        np.testing.assert_allclose(considered.rot_ned_from_body, exact.rot_ned_from_body, atol=1e-9)
        # The noise alone averages; the coordinates leave the least-squares attitude of a unit square with
        # independent errors: heading sd s / sqrt(sum of squares from the centroid), pitch and roll s / 1.
        extra = considered.cov[200, :3, :3] - exact.cov[200, :3, :3]
        np.testing.assert_allclose(np.sqrt(np.diag(extra)), sd_m * np.sqrt([1.0, 1.0, 0.5]), rtol=1e-3)
        # In axes that are turned by e, the rate w is off by w x e.
        turned = skew(considered.rate_body_radps[200])
        more = considered.cov[200, 3:, 3:] - exact.cov[200, 3:, 3:]
        np.testing.assert_allclose(more, turned @ extra @ turned.T, rtol=1e-2, atol=1e-9)


def test_wrong_input_is_refused():
    _, vectors = steady(5)
    with pytest.raises(ModelError, match="time order"):
        filter_attitude(replace(vectors, time_ns=vectors.time_ns[::-1]))
    with pytest.raises(ModelError, match="times asked for"):
        filter_attitude(vectors, times_ns=np.array([2, 1]))
    with pytest.raises(ModelError, match="positive definite"):
        filter_attitude(replace(vectors, cov_ned_m2=-vectors.cov_ned_m2))
    state = filter_attitude(vectors).state
    with pytest.raises(ConfigError, match="forward"):
        filter_attitude(vectors, AttitudeFilterSettings(direction="smoother"), state=state)
    lean = filter_attitude(vectors, AttitudeFilterSettings(keep_predictions=False))
    assert lean.predicted_cov is None
    with pytest.raises(ModelError, match="keep_predictions"):
        next(innovations(lean, vectors))
    smooth = filter_attitude(vectors, AttitudeFilterSettings(direction="smoother"))
    with pytest.raises(ModelError, match="no innovations"):
        next(innovations(smooth, vectors))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("rate_noise_dps2_per_s", (1.0, 0.0, 1.0)),
        ("rate_step_dps", (-1.0, 1.0, 1.0)),
        ("initial_rate_sd_dps", 0.0),
        ("significance", 1.0),
        ("power", 0.0005),
        ("max_passes", 0),
        ("lock_out_epochs", 0),
        ("max_prediction_s", float("nan")),
        ("max_sd_deg", -1.0),
        ("output_rate_hz", 0.0),
    ],
)
def test_impossible_settings_are_refused(key, value):
    with pytest.raises(ConfigError, match=key):
        AttitudeFilterSettings(**{key: value})


def test_no_epochs_at_all():
    _, vectors = steady(0)
    for direction in ("forward", "backward", "smoother"):
        assert filter_attitude(vectors, AttitudeFilterSettings(direction=direction)).n_epochs == 0
