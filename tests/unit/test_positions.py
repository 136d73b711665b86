"""North from positions and carousels: exact without noise, told what is wrong with a record in a sentence."""

import functools
import itertools

import numpy as np
import pytest

from truenorth.errors import ConfigError, NoSolutionError
from truenorth.frames import ecef_from_geodetic
from truenorth.northfinding.positions import (
    align_carousel,
    align_positions,
    find_halts,
    positions_budget,
    turning_plan,
)
from truenorth.northfinding.site import Site
from truenorth.rotations import log_so3, rot_ned_from_body
from truenorth.sensors.imu import GRADES, ImuDescription, imu_increments_from_log, simulate_imu
from truenorth.sensors.kinematics import PointOfBody
from truenorth.simulation.motion import TurntableMotion, build_trajectory
from truenorth.simulation.motion.sway import Move, SwayMotion
from truenorth.simulation.motion.table import TableTrajectory
from truenorth.simulation.randomness import stream
from truenorth.strapdown import InertialIncrements, reference_increments

pytestmark = pytest.mark.unit

DPH = np.pi / 180.0 / 3600.0
BIAS_RADPS = DPH * np.array([1.0, -0.7, 0.5])
ACCEL_BIAS_MPS2 = np.array([5e-3, -3e-3, 2e-3])
FOG = ImuDescription(
    rate_hz=20.0,
    gyro_bias_sd_dph=1.0,
    gyro_bias_instability_dph=0.01,
    gyro_random_walk_deg_per_sqrt_h=0.01,
    gyro_g_sensitivity_dph_per_g=0.0,
    accel_bias_sd_ug=1000.0,
    accel_bias_instability_ug=20.0,
)
HALF_TURN = ((0.0, 0.0), (55.0, 20.0), (64.0, 0.0))
"""Halts of a minute on either side of half a turn; the first command is a start."""


def table(latitude_deg=40.0, duration_s=120.0, motion=None, **settings):
    """Trajectory of a turntable."""
    settings = {"steps": HALF_TURN, "heading_deg": 30.0, **settings}
    return build_trajectory(
        motion or TurntableMotion(**settings),
        latitude_rad=np.radians(latitude_deg),
        longitude_rad=0.2,
        height_m=100.0,
        duration_s=duration_s,
        seed=3,
    )


def site_at(latitude_deg=40.0):
    return Site(np.radians(latitude_deg), 0.2, 100.0)


def attitude_at(trajectory, time_s):
    """True attitude at an instant."""
    motion = trajectory.at(np.array([time_s]))
    return rot_ned_from_body(motion.heading_rad, motion.pitch_rad, motion.roll_rad)[0]


def ideal(trajectory, duration_s=120.0, rate_hz=10.0, lever_m=(0.0, 0.0, 0.0), bias=1.0):
    """Increments with constant biases and nothing else, and the attitude at the end."""
    time_s = np.arange(round(duration_s * rate_hz) + 1) / rate_hz
    point = PointOfBody(trajectory, np.array(lever_m))
    true = reference_increments(point, time_s)
    # A constant rate in turning axes adds its mean over the interval, to second order.
    return (
        InertialIncrements(
            time_s,
            true.angle_rad + bias * BIAS_RADPS / rate_hz,
            true.velocity_mps + bias * ACCEL_BIAS_MPS2 / rate_hz,
            true.position_m + 0.5 * bias * ACCEL_BIAS_MPS2 / rate_hz**2,
        ),
        attitude_at(trajectory, duration_s),
    )


def off_deg(solution, truth):
    """Angle between a solution and the truth."""
    return float(np.degrees(np.linalg.norm(log_so3(solution.rot_ned_from_body @ truth.T))))


def heading_off_deg(solution, truth):
    """Error of the heading."""
    return float(np.degrees(log_so3(solution.rot_ned_from_body @ truth.T)[2]))


@functools.cache
def noisy(latitude_deg=40.0):
    """A record of the FOG with all its errors."""
    trajectory = table(latitude_deg)
    log = simulate_imu(FOG, trajectory, start_ns=0, duration_s=120.0, generator=functools.partial(stream, 8))
    angle, velocity = imu_increments_from_log(FOG, log)
    increments = InertialIncrements(np.arange(len(angle) + 1) / FOG.rate_hz, angle, velocity)
    return increments, attitude_at(trajectory, 120.0), log


@pytest.mark.parametrize(
    ("latitude_deg", "settings"),
    [
        (40.0, {}),
        (-35.0, {"steps": ((0.0, 0.0), (55.0, -20.0), (64.0, 0.0))}),
        (60.0, {"tilt_deg": 5.0, "tilt_azimuth_deg": 70.0}),
        (5.0, {"steps": ((0.0, 0.0), (30.0, 15.0), (36.0, 0.0), (70.0, 15.0), (76.0, 0.0))}),
    ],
)
def test_the_bias_is_gone_after_a_turn(latitude_deg, settings):
    increments, truth = ideal(table(latitude_deg, **settings))
    solution = align_positions(increments, site_at(latitude_deg), errors=FOG, running=False)
    # 1 deg/h is 5 deg of heading at 40 degrees; the prior of the biases keeps a thousandth of it.
    assert abs(heading_off_deg(solution, truth)) < 0.01
    for i, axis in enumerate("xyz"):
        found, sd = (solution.measured[f"gyro_bias_{kind}{axis}_dph"] for kind in ("", "sd_"))
        assert abs(found - BIAS_RADPS[i] / DPH) < 0.02
        # Random walk of 0.01 deg/sqrt(h) over two minutes: 0.055 deg/h.
        assert 0.04 < sd < 0.08


@pytest.mark.parametrize(("misalignment_mrad", "share"), [(0.0, 1.0), (1.0, 1.0 / 3.0)])
def test_biases_of_accelerometers_are_told_from_tilts(misalignment_mrad, share):
    increments, truth = ideal(table())
    fields = {name: getattr(FOG, name) for name in FOG.__struct_fields__}
    fields |= {f"{kind}_misalignment_sd_mrad": misalignment_mrad for kind in ("gyro", "accel")}
    errors = ImuDescription(**fields)
    solution = align_positions(increments, site_at(), errors=errors, running=False)
    # 5e-3 m/s^2 are 510 ug. Half a turn tells them from a tilt; a misalignment of the accelerometers by a
    # milliradian looks the same, and one of the gyros tilts by as much in the turn: each takes a third. The
    # instability of 20 ug wanders by 48 ug in its longest times.
    assert solution.measured["accel_bias_x_ug"] == pytest.approx(share * 5e-3 / 9.80665e-6, rel=0.05)
    assert solution.measured["accel_bias_sd_x_ug"] < (60.0 if misalignment_mrad == 0.0 else 900.0)
    assert off_deg(solution, truth) < (0.005 if misalignment_mrad == 0.0 else 0.05)


def test_the_encoder_takes_the_scale_error_of_the_turn_away():
    increments, truth = ideal(table(), bias=0.0)
    wrong = np.where(np.abs(increments.angle_rad[:, 2:]) > 0.01, 1.003, 1.0)
    scaled = InertialIncrements(
        increments.time_s,
        increments.angle_rad * np.hstack([np.ones_like(wrong), np.ones_like(wrong), wrong]),
        increments.velocity_mps,
        increments.position_m,
    )
    by_gyro = align_positions(scaled, site_at(), errors=FOG, running=False)
    by_table = align_positions(
        scaled, site_at(), errors=FOG, table_angle_rad=np.array([0.0, np.pi]), running=False
    )
    # 0.3 % of half a turn is 0.54 deg; each halt has a half of it.
    assert abs(abs(heading_off_deg(by_gyro, truth)) - 0.27) < 0.03
    assert abs(heading_off_deg(by_table, truth)) < 0.01


@pytest.mark.parametrize("rate_dps", [15.0, -15.0])
def test_a_carousel_needs_no_bias_and_no_lever_arm(rate_dps):
    trajectory = table(steps=(), rate_dps=rate_dps, tilt_deg=1.0)
    increments, truth = ideal(trajectory, lever_m=(0.05, -0.03, 0.1))
    table_rad = np.radians(rate_dps) * increments.time_s
    options = {"errors": FOG, "table_angle_rad": table_rad, "running": False}
    solution = align_carousel(increments, site_at(), **options)
    assert abs(heading_off_deg(solution, truth)) < 0.03
    assert solution.measured["turn_period_s"] == pytest.approx(24.0, rel=1e-3)
    assert solution.measured["turned_deg"] == pytest.approx(1800.0, rel=0.01)
    budget = {line.source for line in solution.budget.lines}
    assert {"lever arm", "wobble of the table", "table angle"} <= budget


def test_halts_are_found_whatever_the_bias():
    increments, _ = ideal(table())
    drifting = InertialIncrements(
        increments.time_s, increments.angle_rad + np.radians([0.1, -0.07, 0.05]), increments.velocity_mps
    )
    for record in (increments, drifting):
        halts = find_halts(record)
        np.testing.assert_allclose(halts, [(0.0, 53.5), (66.0, 120.0)], atol=1.1)
    assert find_halts(InertialIncrements(np.arange(4.0), np.zeros((3, 3)), np.zeros((3, 3)))) == []


def test_given_halts_do_what_found_ones_do():
    increments, truth = ideal(table())
    solution = align_positions(
        increments, site_at(), errors=FOG, segments=[(2.0, 50.0), (70.0, 118.0)], running=False
    )
    assert abs(heading_off_deg(solution, truth)) < 0.01
    assert solution.measured["turn_1_deg"] == pytest.approx(180.0, abs=0.3)


def test_the_estimate_grows_second_by_second():
    increments, truth, _ = noisy()
    solution = align_positions(increments, site_at(), errors=FOG)
    run = solution.run
    np.testing.assert_allclose(run.time_s, np.arange(121.0), atol=1e-6)
    assert np.all(np.isnan(run.angles_rad[0]))
    np.testing.assert_allclose(run.angles_rad[-1], solution.angles_rad, atol=1e-7)
    np.testing.assert_allclose(run.sd_rad[-1], solution.angle_sd_rad, rtol=1e-4)
    sd_deg = np.degrees(run.sd_rad[:, 0])
    # A bias of 1 deg/h until the turn, 5 deg; then the noise.
    assert 4.9 < sd_deg[50] < 6.0
    assert sd_deg[-1] < 0.4
    # After the table has come to rest sigma never rises by more than what the gyros lose in a block.
    assert np.all(np.diff(sd_deg[75:]) < 1e-3)
    assert abs(heading_off_deg(solution, truth)) < 4.0 * sd_deg[-1]


def test_the_budget_is_the_covariance_and_known_before():
    increments, _, _ = noisy()
    solution = align_positions(increments, site_at(), errors=FOG, running=False)
    budget = solution.budget
    np.testing.assert_allclose(budget.cov_ned_rad2, solution.cov_ned_rad2, rtol=1e-9)
    assert budget.lines[0].source == "angle random walk"
    plan = turning_plan(120.0, 2, 10.0)
    before = positions_budget(FOG, site_at(), plan, heading_rad=np.radians(30.0))
    # The halts found are shorter by some blocks of one second.
    assert before.angle_sd_rad()[0] == pytest.approx(budget.angle_sd_rad()[0], rel=0.05)
    # The same turn measured by an encoder has no scale error in it; a swaying platform costs.
    encoded = positions_budget(FOG, site_at(), plan, encoder_sd_rad=1e-5)
    swaying = positions_budget(FOG, site_at(), plan, still=False, sway_mps=2e-3)
    assert encoded.angle_sd_rad()[0] < before.angle_sd_rad()[0] < swaying.angle_sd_rad()[0]


def test_the_inner_sum_of_the_budget_is_the_covariance_of_the_estimator():
    from truenorth.northfinding import positions_model

    seen = []

    class Spy(positions_model.Model):
        def lines(self):
            lines = super().lines()
            back = self.geometry.earth[-1].T
            start, turn, gain = self.start, self.turn, self.gain
            added = self.whiten(np.tensordot(self.all_gyro, turn, axes=([1, 2], [1, 2])))
            lean = np.eye(3) - added.T @ start
            inside = self.gyro_prior(turn) - added.T @ added
            inside = inside + lean @ np.linalg.inv(start.T @ start) @ lean.T
            seen.append((back @ inside @ back.T, sum(line.cov_ned_rad2 for line in lines), gain))
            return lines

    plain = positions_model.Model
    positions_model.Model = Spy
    try:
        positions_budget(FOG, site_at(), turning_plan(120.0, 3))
    finally:
        positions_model.Model = plain
    (inside, summed, gain), *_ = seen
    np.testing.assert_allclose(inside, summed, rtol=1e-6, atol=1e-16)
    assert gain.shape[0] == 3


def test_more_positions_and_longer_times_are_better_and_the_plan_must_fit():
    sd = {
        (n, duration): positions_budget(FOG, site_at(), turning_plan(duration, n)).angle_sd_rad()[0]
        for n, duration in itertools.product((2, 4), (120.0, 300.0))
    }
    assert sd[2, 300.0] < 0.8 * sd[2, 120.0]
    assert sd[4, 300.0] < 0.8 * sd[4, 120.0]
    np.testing.assert_allclose(turning_plan(120.0, 2, 10.0)[:, 0], [0.0, 55.0, 65.0, 120.0])
    with pytest.raises(ConfigError, match="give more time"):
        turning_plan(30.0, 4, 10.0)


def test_a_shaken_platform_is_seen_and_survived():
    moves = (
        Move(at_s=85.0, duration_s=10.0, yaw_deg=180.0),
        # Someone sits down in the first halt: all angles change for good.
        Move(at_s=40.0, duration_s=2.0, pitch_deg=0.05, yaw_deg=0.05),
    )
    trajectory = table(duration_s=180.0, motion=SwayMotion(heading_deg=30.0, moves=moves))
    log = simulate_imu(FOG, trajectory, start_ns=0, duration_s=180.0, generator=functools.partial(stream, 11))
    angle, velocity = imu_increments_from_log(FOG, log)
    increments = InertialIncrements(np.arange(len(angle) + 1) / FOG.rate_hz, angle, velocity)
    solution = align_positions(increments, site_at(), errors=FOG, running=False)
    truth = attitude_at(trajectory, 180.0)
    assert solution.measured["still"] == 0.0
    assert any("accelerometers in the inertial frame alone" in note for note in solution.notes)
    sd_deg = np.degrees(solution.angle_sd_rad[0])
    assert sd_deg < 1.5
    # 0.05 deg in 40 s is 4.5 deg/h, 20 deg of heading by means of the rates.
    assert abs(heading_off_deg(solution, truth)) < 4.0 * sd_deg


def test_a_carousel_on_a_swaying_platform_is_seen_and_survived():
    time_s = np.arange(-2.0, 182.0, 0.1)
    swings = np.radians(0.05) * np.sin(2.0 * np.pi * np.outer([1.0 / 2.3, 1.0 / 3.1], time_s))
    place = np.tile(ecef_from_geodetic(np.radians(40.0), 0.2, 100.0), (len(time_s), 1))
    spin = np.radians(15.0) * time_s
    trajectory = TableTrajectory(time_s, place, spin, *swings)
    log = simulate_imu(FOG, trajectory, start_ns=0, duration_s=180.0, generator=functools.partial(stream, 12))
    angle, velocity = imu_increments_from_log(FOG, log)
    increments = InertialIncrements(np.arange(len(angle) + 1) / FOG.rate_hz, angle, velocity)
    table_rad = np.radians(15.0) * increments.time_s
    options = {"errors": FOG, "table_angle_rad": table_rad, "encoder_sd_rad": 1e-3, "running": False}
    solution = align_carousel(increments, site_at(), **options)
    assert any("moves by more than its stated wobble" in note for note in solution.notes)
    sd_deg = np.degrees(solution.angle_sd_rad[0])
    assert sd_deg < 2.0
    assert abs(heading_off_deg(solution, attitude_at(trajectory, 180.0))) < 4.0 * sd_deg


def test_without_stated_errors_the_biases_are_free():
    increments, truth, _ = noisy()
    solution = align_positions(increments, site_at(), running=False)
    assert solution.budget is None
    assert any("not stated" in note for note in solution.notes)
    sd_deg = np.degrees(solution.angle_sd_rad[0])
    assert sd_deg < 0.5
    assert abs(heading_off_deg(solution, truth)) < 4.0 * sd_deg


def test_an_ideal_unit_is_no_special_case():
    none = {key: 0.0 for key in GRADES["navigation"] if key != "output" and "range" not in key}
    increments, truth = ideal(table(), bias=0.0)
    solution = align_positions(increments, site_at(), errors=ImuDescription(**none), running=False)
    assert off_deg(solution, truth) < 1e-5


def test_a_small_turn_is_said_to_be_small():
    increments, _ = ideal(table(steps=((0.0, 0.0), (55.0, 3.0), (58.0, 0.0))))
    solution = align_positions(increments, site_at(), errors=FOG, running=False)
    assert any("differ by less than 20 deg" in note for note in solution.notes)
    assert np.degrees(solution.angle_sd_rad[0]) > 1.0


@functools.cache
def bad(name):
    """Records that are not what they are said to be."""
    if name == "still":
        return ideal(table(steps=(), rate_dps=0.0))[0]
    if name == "steady":
        return ideal(table(steps=(), rate_dps=15.0))[0]
    if name == "fast":
        return ideal(table(steps=(), rate_dps=300.0), rate_hz=20.0)[0]
    return ideal(table())[0]


CONSUMER = ImuDescription(grade="consumer")


@pytest.mark.parametrize(
    ("align", "record", "options", "says"),
    [
        (align_positions, "still", {}, "one halt and no turn"),
        (align_positions, "steady", {}, "no turn between two"),
        (align_carousel, "still", {}, "turns by 0 deg"),
        (align_carousel, "turn", {}, "a whole turn or more"),
        (align_carousel, "fast", {}, "turn more slowly"),
        (align_carousel, "steady", {"errors": CONSUMER}, "may lose its heading"),
        (align_carousel, "steady", {"axis_body": np.array([1.0, 0.0, 0.0])}, "about the stated axis"),
        (align_carousel, "steady", {"table_angle_rad": np.zeros(3)}, "one for each"),
        (align_carousel, "steady", {"table_angle_rad": np.linspace(0.0, -31.4, 1201)}, "not wrapped"),
        (align_positions, "turn", {"axis_body": np.array([0.0, 1.0, 0.0])}, "90 deg off"),
        (align_positions, "turn", {"axis_body": np.zeros(3)}, "three numbers"),
        (align_positions, "turn", {"table_angle_rad": np.zeros(3)}, "2 halts"),
        (align_positions, "turn", {"table_angle_rad": np.array([0.0, 1.0])}, "57.3 deg by the table"),
        (align_positions, "turn", {"segments": [(0.0, 50.0), (70.0, 900.0)]}, "within the record"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(align, record, options, says):
    with pytest.raises((NoSolutionError, ConfigError), match=says) as caught:
        align(bad(record), site_at(), **options)
    assert "\n" not in str(caught.value)
