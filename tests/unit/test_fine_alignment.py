"""Fine alignment: exact on ideal records, its recursions against dense matrices, what it says and refuses."""

import dataclasses

import numpy as np
import pytest

from shaken_records import QUIET, SITE, drawn_record, ideal_record, trajectory_at_site, true_attitude
from truenorth.errors import ConfigError, NoSolutionError
from truenorth.northfinding import fine_filter, fine_model
from truenorth.northfinding.fine import align_fine
from truenorth.northfinding.site import Site
from truenorth.rotations import exp_so3, heading_pitch_roll, log_so3, skew
from truenorth.sensors.imu import ImuDescription
from truenorth.simulation.motion import Move, StaticMotion, SwayMotion, TurntableMotion
from truenorth.strapdown import InertialIncrements, compress_increments

NAVIGATION = ImuDescription(grade="navigation", rate_hz=20.0)
CERTAIN = {"deflection_sd_rad": 0.0, "gravity_sd_mps2": 1e-6}
STILL = StaticMotion(heading_deg=130.0, pitch_deg=4.0, roll_deg=-3.0)
STEPS = TurntableMotion(heading_deg=30.0, steps=((0.0, 0.0), (60.0, 30.0), (66.0, 0.0)))


def error_rad(solution, truth):
    return log_so3(solution.rot_ned_from_body @ truth.T)


@pytest.mark.parametrize(
    "motion",
    [STILL, StaticMotion(heading_deg=300.0, pitch_deg=70.0, roll_deg=120.0), STEPS],
    ids=["still", "tilted", "steps"],
)
def test_an_ideal_record_gives_the_true_attitude(motion):
    record, truth = ideal_record(motion, 120.0)
    found = align_fine(record, SITE, errors=NAVIGATION, **CERTAIN)
    # The plumb line at 100 m curves by 1e-7 rad, and a milliradian off the start is off by its square.
    assert np.max(np.abs(error_rad(found, truth))) < 1.5e-6
    assert np.max(np.abs(found.gyro_bias_radps)) < 0.05 * np.max(found.gyro_bias_sd_radps)
    assert found.time_s == pytest.approx(120.0)


def test_of_the_shaking_is_left_what_its_line_says():
    record, truth = ideal_record(SwayMotion(heading_deg=200.0, pitch_drift_deg_per_h=3.0), 120.0)
    found = align_fine(record, SITE, errors=NAVIGATION, **CERTAIN)
    line = next(line for line in found.budget.lines if line.source == "shaking")
    assert np.all(np.abs(error_rad(found, truth)) < 4.0 * np.sqrt(np.diag(line.cov_ned_rad2)) + 2e-7)
    # Half of the square of the amplitudes, turned by 200 degrees; the lines of 120 s do not average out.
    turn = np.radians(200.0)
    north2 = 0.5 * ((0.002 * np.cos(turn)) ** 2 + (0.004 * np.sin(turn)) ** 2)
    assert found.displacement_sd_m[0] == pytest.approx(np.sqrt(north2), rel=0.3)


def test_known_biases_are_found_by_turning():
    record, truth = ideal_record(STEPS, 126.0)
    gyro, accel = np.array([4e-7, -6e-7, 5e-7]), np.array([3e-4, -2e-4, 1e-4])
    # Constant in the body, which turns by 1.5 degrees within an interval.
    step_s, turned = np.diff(record.time_s)[:, None], fine_model.mean_rotation(record.angle_rad)
    biased = InertialIncrements(
        record.time_s,
        log_so3(exp_so3(turned @ gyro * step_s) @ exp_so3(record.angle_rad)),
        record.velocity_mps + turned @ accel * step_s,
        record.position_m + 0.5 * turned @ accel * step_s**2,
    )
    # A unit of which little is known but that it has almost no noise.
    unit = ImuDescription(
        grade="tactical",
        rate_hz=20.0,
        gyro_bias_instability_dph=0.0,
        gyro_random_walk_deg_per_sqrt_h=1e-5,
        gyro_scale_sd_ppm=0.0,
        gyro_misalignment_sd_mrad=0.0,
        gyro_g_sensitivity_dph_per_g=0.0,
        gyro_resolution_dps=0.0,
        accel_bias_instability_ug=0.0,
        accel_random_walk_mps_per_sqrt_h=1e-5,
        accel_scale_sd_ppm=0.0,
        accel_misalignment_sd_mrad=0.0,
        accel_resolution_ug=0.0,
    )
    found = align_fine(biased, SITE, errors=unit, interval_s=0.1, **CERTAIN)
    # 0.1 to 0.15 deg/h of bias would turn the heading by half a degree at rest.
    assert np.abs(error_rad(found, truth)) == pytest.approx(np.zeros(3), abs=1e-5)
    assert found.gyro_bias_radps[:2] == pytest.approx(gyro[:2], abs=1e-9)
    assert found.accel_bias_mps2[:2] == pytest.approx(accel[:2], abs=1e-6)
    assert np.all(found.gyro_bias_sd_radps[:2] < 1e-8)


def test_a_start_that_is_far_off_leads_to_the_same_estimate():
    record, _ = drawn_record(trajectory_at_site(STILL, 120.0), NAVIGATION, 120.0, seed=4)
    found = align_fine(record, SITE, errors=NAVIGATION)
    wrong = exp_so3(np.array([0.02, -0.03, 0.8])) @ found.rot_ned_from_body
    again = align_fine(
        record, SITE, errors=NAVIGATION, start=dataclasses.replace(found, rot_ned_from_body=wrong)
    )
    assert again.passes > found.passes
    # The trajectory is taken to stay when it moves by less than a milliradian or a tenth of sigma.
    apart = log_so3(again.rot_ned_from_body @ found.rot_ned_from_body.T)
    assert np.all(np.abs(apart) < 0.1 * np.sqrt(np.diag(found.cov_ned_rad2)))
    # What acts like a bias at an attitude is taken at the start that was given.
    assert np.diag(again.cov_ned_rad2) == pytest.approx(np.diag(found.cov_ned_rad2), rel=0.05)


def test_the_budget_adds_up_to_the_covariance():
    site = dataclasses.replace(SITE, latitude_sd_rad=1e-3)
    record, _ = drawn_record(trajectory_at_site(STEPS, 90.0), NAVIGATION, 90.0, seed=5)
    found = align_fine(record, site, errors=NAVIGATION)
    scale = np.sqrt(np.diag(found.cov_ned_rad2))
    assert found.budget.cov_ned_rad2 / np.outer(scale, scale) == pytest.approx(
        found.cov_ned_rad2 / np.outer(scale, scale), abs=1e-6
    )
    shares = [found.budget.angle_sd_rad(line)[0] for line in found.budget.lines]
    assert shares == sorted(shares, reverse=True)
    names = {line.source for line in found.budget.lines}
    assert {"gyro bias", "angle random walk", "gyro scale", "latitude", "shaking"} <= names


def dense_transition(model, drive):
    transition = np.diag(np.concatenate([np.zeros(9), model.decay]))
    transition[:9, :9], transition[:9, 9:] = model.core, drive
    return transition


@pytest.mark.parametrize("moved", [False, True])
def test_the_smoother_is_that_of_dense_matrices(moved):
    record, _ = drawn_record(trajectory_at_site(STILL, 30.0), NAVIGATION, 30.0, seed=6)
    blocks = compress_increments(record, 20)
    rot = align_fine(record, SITE, errors=NAVIGATION).rot_ned_from_body
    model = fine_model.ErrorModel(
        blocks, SITE, NAVIGATION, gravity_sd_mps2=1e-4, turned=True, level_from_body=rot
    )
    none = np.zeros(3)
    nominal = model.nominal(exp_so3(np.array([1e-3, 0.0, 0.02])) @ rot, 30, none, none)
    action = np.full(31, fine_filter.MEASURED)
    if moved:
        action[12:16] = fine_filter.NOTHING
        action[16] = fine_filter.PLACED
    variance = np.array([1e-6, 2e-6, 3e-6])
    forward = fine_filter.filter_errors(model, nominal, action, np.tile(variance, (31, 1)))
    error, cov = fine_filter.smooth_attitude(model, forward)

    # Rauch, Tung and Striebel, written out.
    core_noise, rest_noise = model.process_cov
    noise = np.diag(np.concatenate([np.zeros(9), rest_noise]))
    noise[:9, :9] = core_noise
    place = np.zeros((3, model.n))
    place[:, 6:9] = np.eye(3)
    replace = np.eye(model.n)
    replace[6:9, 6:9] = 0.0
    replace[3:6, 6:9] = -skew(SITE.earth_rate_ned_radps)
    x, p = np.zeros(model.n), model.start_cov
    filtered = []
    for k in range(31):
        if k:
            step = dense_transition(model, forward.drive[k - 1])
            x, p = step @ x, step @ p @ step.T + noise
        if action[k] == fine_filter.MEASURED:
            gain = p @ place.T @ np.linalg.inv(place @ p @ place.T + np.diag(variance))
            x = x + gain @ (nominal.displacement_m[k] - place @ x)
            rest = np.eye(model.n) - gain @ place
            p = rest @ p @ rest.T + gain @ np.diag(variance) @ gain.T
        elif action[k] == fine_filter.PLACED:
            shift = np.zeros(model.n)
            shift[3:6] = skew(SITE.earth_rate_ned_radps) @ nominal.displacement_m[k]
            shift[6:9] = nominal.displacement_m[k]
            x, p = replace @ x + shift, replace @ p @ replace.T
            p[6:9, 6:9] = np.diag(variance)
        filtered.append((x, p))
    scale = np.sqrt(np.diag(filtered[-1][1]))
    assert np.max(np.abs(forward.state[-1] - filtered[-1][0]) / scale) < 1e-4
    assert forward.cov / np.outer(scale, scale) == pytest.approx(
        filtered[-1][1] / np.outer(scale, scale), abs=1e-4
    )
    # Backwards over the last halt; through the move the dense form has no inverse.
    smooth_x, smooth_p = filtered[-1]
    for k in range(29, 16 if moved else 4, -1):
        x, p = filtered[k]
        step = dense_transition(model, forward.drive[k])
        before = step @ p @ step.T + noise
        back = np.linalg.solve(before, step @ p).T
        smooth_x = x + back @ (smooth_x - step @ x)
        smooth_p = p + back @ (smooth_p - before) @ back.T
        sd = np.sqrt(np.diag(smooth_p)[:3])
        assert error[k] / sd == pytest.approx(smooth_x[:3] / sd, abs=2e-3)
        assert np.sqrt(np.diag(cov[k])) == pytest.approx(sd, rel=2e-3)


def test_the_whole_record_tells_the_attitude_at_its_start():
    trajectory = trajectory_at_site(SwayMotion(heading_deg=75.0), 120.0)
    record, _ = drawn_record(trajectory, NAVIGATION, 120.0, seed=7)
    found = align_fine(record, SITE, errors=NAVIGATION, smooth=True, **CERTAIN)
    history = found.history
    assert history.smooth_rot_ned_from_body[-1] == pytest.approx(found.rot_ned_from_body, abs=1e-12)
    truth = true_attitude(trajectory, history.time_s)
    late = log_so3(history.smooth_rot_ned_from_body @ np.swapaxes(truth, -1, -2))
    sd = np.sqrt(np.diagonal(history.smooth_cov_ned_rad2, axis1=1, axis2=2))
    # All edges share the error of the heading, which the two minutes leave; five sigma.
    assert np.all(np.abs(late) < 5.0 * sd)
    heading_sd = np.sqrt(history.cov_ned_rad2[[10, -1], 2, 2])
    assert sd[0, 2] < 1.05 * heading_sd[1] < 0.05 * heading_sd[0]


def test_what_is_not_observable_at_rest_is_said():
    record, _ = drawn_record(trajectory_at_site(STILL, 300.0), NAVIGATION, 300.0, seed=8)
    states = {state.name: state for state in align_fine(record, SITE, errors=NAVIGATION).observability.states}
    assert states["heading"].ratio < 0.01
    # Level accelerometer biases are tilts, the east gyro bias is a heading.
    for way, tilt in (("north", "tilt about east"), ("east", "tilt about north")):
        state = states[f"accelerometer bias {way}"]
        assert state.ratio > 0.95
        assert state.partner == tilt
        assert abs(state.correlation) > 0.95
        assert "not observed" in state.sentence
    assert states["gyro bias east"].partner == "heading"
    assert states["gyro bias east"].ratio > 0.95


def test_turning_makes_the_biases_observable():
    unit = ImuDescription(grade="tactical", rate_hz=20.0, gyro_random_walk_deg_per_sqrt_h=0.003)
    sums = {}
    for name, motion in (("rest", STILL), ("turned", STEPS)):
        record, _ = drawn_record(trajectory_at_site(motion, 126.0), unit, 126.0, seed=9)
        found = align_fine(record, SITE, errors=unit)
        sums[name] = {state.name: state.ratio for state in found.observability.states}
        assert np.all(np.diff(found.observability.left) >= 0.0)
    assert sums["rest"]["gyro bias east"] > 0.9
    assert sums["turned"]["gyro bias east"] < 0.4


def test_a_platform_that_was_moved_is_given_a_new_place():
    moves = (Move(at_s=100.3, duration_s=3.0, yaw_deg=4.0, pitch_deg=1.0, sway_m=0.4),)
    trajectory = trajectory_at_site(SwayMotion(heading_deg=75.0, moves=moves, **QUIET), 200.0)
    record, _ = drawn_record(trajectory, NAVIGATION, 200.0, seed=10)
    truth = true_attitude(trajectory, 200.0)[0]
    for updates in ("always", "still"):
        found = align_fine(record, SITE, errors=NAVIGATION, updates=updates, **CERTAIN)
        assert found.method == {"always": "fine", "still": "strapdown"}[updates]
        wrong = error_rad(found, truth)
        assert np.all(np.abs(wrong) < 4.5 * np.sqrt(np.diag(found.cov_ned_rad2)))
        assert np.degrees(found.angle_sd_rad[0]) < 0.12
        # Between 101 and 103 s nobody takes it to stand.
        time_s, history = found.history.time_s, found.history
        moving = (time_s > 101.5) & (time_s < 103.0)
        assert np.all(~history.still[moving] | (history.nis[moving] > fine_filter.MOVED))
        assert any("moved" in note for note in found.notes)


@pytest.mark.parametrize("stated_m", [None, 1e-4])
def test_a_move_at_the_very_start_does_not_lock_the_filter_out(stated_m):
    # Before the velocity is known, a move looks like one: what follows then seems to be beyond chance.
    moves = tuple(Move(at_s=at, duration_s=1.5, pitch_deg=0.05, surge_m=0.004) for at in (0.5, 2.5, 4.5, 6.0))
    trajectory = trajectory_at_site(SwayMotion(heading_deg=75.0, moves=moves, **QUIET), 150.0)
    truth = true_attitude(trajectory, 150.0)[0]
    for seed in range(3):
        record, _ = drawn_record(trajectory, NAVIGATION, 150.0, seed)
        found = align_fine(record, SITE, errors=NAVIGATION, displacement_sd_m=stated_m, **CERTAIN)
        assert np.all(np.abs(error_rad(found, truth)) < 4.5 * np.sqrt(np.diag(found.cov_ned_rad2)))
        assert np.degrees(found.angle_sd_rad[0]) < 0.2


def test_a_stated_shaking_that_the_record_belies_is_not_kept_to():
    record, truth = ideal_record(SwayMotion(heading_deg=75.0), 100.0)
    found = align_fine(record, SITE, errors=NAVIGATION, displacement_sd_m=1e-4, **CERTAIN)
    assert np.sqrt(np.mean(found.displacement_sd_m**2)) > 1e-3
    assert any("more than the 0.1 mm stated" in note for note in found.notes)
    assert np.all(np.abs(error_rad(found, truth)) < 3.0 * np.sqrt(np.diag(found.cov_ned_rad2)))


def test_a_heading_nobody_can_know_leaves_the_tilts_alone():
    unit = ImuDescription(grade="industrial", rate_hz=20.0)
    record, _ = drawn_record(trajectory_at_site(STILL, 120.0), unit, 120.0, seed=11)
    found = align_fine(record, SITE, errors=unit)
    tilt_sd = found.angle_sd_rad[1:]
    assert np.all(np.degrees(tilt_sd) < 0.15)
    assert np.abs(np.array([found.pitch_rad, found.roll_rad]) - np.radians([4.0, -3.0])) == pytest.approx(
        np.zeros(2), abs=5.0 * np.max(tilt_sd)
    )
    # Nearly any direction is as likely, which would be 104 degrees.
    assert np.degrees(found.angle_sd_rad[0]) == pytest.approx(180.0 / np.sqrt(3.0), rel=0.1)
    assert np.all(np.isnan(found.run.angles_rad))


def test_the_run_grows_to_the_solution():
    record, _ = drawn_record(trajectory_at_site(STILL, 120.0), NAVIGATION, 120.0, seed=12)
    found = align_fine(record, SITE, errors=NAVIGATION)
    assert np.isnan(found.run.angles_rad[1]).all()
    assert found.run.angles_rad[-1] == pytest.approx(found.angles_rad, abs=1e-12)
    assert found.run.sd_rad[-1] == pytest.approx(found.angle_sd_rad, rel=1e-9)
    known = np.isfinite(found.run.angles_rad[:, 0])
    assert np.all(np.diff(found.run.sd_rad[known, 0]) < 1e-6)
    assert align_fine(record, SITE, errors=NAVIGATION, running=False).run is None


def test_a_wrong_latitude_is_in_sigma():
    site = Site(SITE.latitude_rad + 2e-3, 0.3, 100.0, latitude_sd_rad=2e-3)
    record, truth = ideal_record(STEPS, 126.0)
    found = align_fine(record, site, errors=NAVIGATION, **CERTAIN)
    # North, east, down of a place 13 km off, against the same plumb line.
    heading, pitch, roll = heading_pitch_roll(truth)
    wrong = np.abs(found.angles_rad - [heading % (2.0 * np.pi), pitch, roll])
    assert np.all(wrong < 3.0 * found.angle_sd_rad)
    assert any(line.source == "latitude" for line in found.budget.lines)


def test_refusals():
    record, _ = ideal_record(STILL, 30.0)
    with pytest.raises(ConfigError, match="`updates` is 'never'"):
        align_fine(record, SITE, errors=NAVIGATION, updates="never")
    with pytest.raises(ConfigError, match="state the sensor's errors"):
        align_fine(record, SITE, errors=None)
    short, _ = ideal_record(STILL, 6.0)
    with pytest.raises(NoSolutionError, match=r"6\.0 s of data; give at least 10 s"):
        align_fine(short, SITE, errors=NAVIGATION)
    found = align_fine(record, SITE, errors=NAVIGATION)
    with pytest.raises(ConfigError, match="outside of the record"):
        align_fine(record, SITE, errors=NAVIGATION, start=dataclasses.replace(found, time_s=99.0))
    moves = tuple(Move(at_s=at, duration_s=3.0, yaw_deg=5.0) for at in np.arange(1.0, 28.0, 6.0))
    restless, _ = ideal_record(SwayMotion(moves=moves), 30.0)
    with pytest.raises(NoSolutionError, match="let the platform rest"):
        align_fine(restless, SITE, errors=NAVIGATION, updates="still")
