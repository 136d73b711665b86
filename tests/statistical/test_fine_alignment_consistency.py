"""Errors of the fine alignment have the covariance that it states, and its innovations too.

Sums of normalised squares are chi-square; the bounds are two-sided with a false alarm of 1e-5 each.
"""

import numpy as np
import pytest
from scipy import stats

from shaken_records import QUIET, SITE, drawn_record, trajectory_at_site, true_attitude
from truenorth.northfinding.fine import align_fine
from truenorth.rotations import log_so3
from truenorth.sensors.imu import ImuDescription
from truenorth.simulation.motion import Move, Oscillation, StaticMotion, SwayMotion, TurntableMotion

CERTAIN = {"deflection_sd_rad": 0.0, "gravity_sd_mps2": 1e-6}

STILL = StaticMotion(heading_deg=130.0, pitch_deg=4.0, roll_deg=-3.0)
TWO = TurntableMotion(heading_deg=30.0, steps=((0.0, 0.0), (60.0, 30.0), (66.0, 0.0)))
CAR = SwayMotion(heading_deg=75.0)
MOVED = SwayMotion(
    heading_deg=75.0,
    moves=(
        Move(at_s=40.3, duration_s=3.0, yaw_deg=10.0, pitch_deg=2.0, sway_m=1.3),
        Move(at_s=80.3, duration_s=4.0, lasting=False, roll_deg=5.0, surge_m=0.8, heave_m=0.5),
    ),
    **QUIET,
)

# One that turning by half a revolution helps: 1 deg/h of bias, and little noise.
BIASED = ImuDescription(
    grade="tactical",
    rate_hz=10.0,
    gyro_bias_sd_dph=1.0,
    gyro_bias_instability_dph=0.01,
    gyro_random_walk_deg_per_sqrt_h=0.002,
    gyro_scale_sd_ppm=20.0,
    gyro_misalignment_sd_mrad=0.02,
    gyro_g_sensitivity_dph_per_g=0.1,
    accel_bias_sd_ug=100.0,
    accel_bias_instability_ug=2.0,
    accel_random_walk_mps_per_sqrt_h=0.01,
    accel_misalignment_sd_mrad=0.1,
)


def interval(dof):
    """Bounds of a mean of dof squared standard normal errors."""
    return stats.chi2.ppf([5e-6, 1.0 - 5e-6], dof) / dof


def draws(motion, unit, seconds, number, **options):
    """Solutions of so many records, and the errors of their attitudes."""
    trajectory = trajectory_at_site(motion, seconds)
    truth = true_attitude(trajectory, seconds)[0]
    found = []
    for seed in range(number):
        record, _ = drawn_record(trajectory, unit, seconds, seed)
        found.append(align_fine(record, SITE, errors=unit, running=False, **CERTAIN, **options))
    return found, np.array([log_so3(solution.rot_ned_from_body @ truth.T) for solution in found])


def unit_of(grade, rate_hz=10.0):
    return ImuDescription(grade=grade, rate_hz=rate_hz)


@pytest.mark.parametrize(
    ("motion", "unit", "options"),
    [
        (STILL, unit_of("navigation"), {}),
        (STILL, unit_of("tactical"), {}),
        (TWO, unit_of("navigation"), {}),
        (TWO, unit_of("tactical"), {}),
        (TWO, BIASED, {}),
        (CAR, unit_of("navigation", 20.0), {}),
        (MOVED, unit_of("navigation"), {"updates": "still"}),
        (MOVED, unit_of("navigation"), {"updates": "always"}),
    ],
    ids=[
        "still-navigation", "still-tactical", "turned-navigation", "turned-tactical", "turned-biased",
        "shaken", "moved-still", "moved-always",
    ],
)  # fmt: skip
def test_attitude_errors_have_the_stated_covariance(motion, unit, options):
    found, errors = draws(motion, unit, 126.0, 20, **options)
    square = [
        error @ np.linalg.solve(solution.history.cov_ned_rad2[-1], error)
        for solution, error in zip(found, errors, strict=True)
    ]
    low, high = interval(3 * len(square))
    assert low < np.mean(square) / 3.0 < high
    # Each axis by itself as well: a heading that is too sure could hide behind tilts that are not enough so.
    sd = np.sqrt([np.diag(solution.history.cov_ned_rad2[-1]) for solution in found])
    low, high = interval(len(square))
    assert np.all((np.mean((errors / sd) ** 2, axis=0) > low) & (np.mean((errors / sd) ** 2, axis=0) < high))


@pytest.mark.parametrize("grade", ["navigation", "tactical", "industrial"])
def test_innovations_have_the_stated_covariance(grade):
    found, _ = draws(STILL, unit_of(grade), 120.0, 8, displacement_sd_m=0.0)
    # The first ones fill in what was not known.
    nis = np.concatenate([solution.history.nis[6:] for solution in found])
    low, high = interval(3 * len(nis))
    # The displacement cannot be stated smaller than 10 um, and rounding is not quite white: 5 %.
    assert 0.95 * low < np.mean(nis) / 3.0 < 1.05 * high


def test_shaking_faster_than_the_intervals_is_white():
    def fast(amplitude, period_s):
        return (Oscillation(amplitude=amplitude, period_s=period_s, bandwidth=0.3),)

    motion = SwayMotion(
        heading_deg=75.0,
        yaw=(),
        roll=fast(0.1, 0.37),
        pitch=fast(0.1, 0.31),
        surge=fast(0.003, 0.31),
        sway=fast(0.003, 0.37),
        heave=fast(0.003, 0.29),
    )
    found, _ = draws(motion, unit_of("navigation", 50.0), 126.0, 8)
    sizes = np.array([solution.displacement_sd_m for solution in found])
    assert np.mean(sizes) == pytest.approx(0.003 / np.sqrt(2.0), rel=0.1)
    # One shaking for all draws, and what it is is found from the record itself: 15 %.
    assert np.mean([solution.measured["nis_mean"] for solution in found]) == pytest.approx(3.0, rel=0.15)


def test_half_a_turn_removes_a_bias_of_one_degree_an_hour():
    steps = TurntableMotion(heading_deg=30.0, steps=((0.0, 0.0), (300.0, 30.0), (306.0, 0.0)))
    dph = np.degrees(1.0) * 3600.0
    turned, errors = draws(steps, BIASED, 606.0, 8)
    still, still_errors = draws(StaticMotion(heading_deg=30.0), BIASED, 606.0, 8)
    level_sd = np.array([solution.gyro_bias_sd_radps[:2] for solution in turned]) * dph
    assert np.all(level_sd < 0.03)
    # As a rate that points east, the heading is better than 0.05 deg/h; at rest it keeps the bias.
    rate = SITE.horizontal_rate_radps * dph
    bound = interval(8)[1]
    assert np.sqrt(np.mean(errors[:, 2] ** 2)) * rate < 0.05
    assert np.mean((errors[:, 2] / [solution.angle_sd_rad[0] for solution in turned]) ** 2) < bound
    assert np.sqrt(np.mean(still_errors[:, 2] ** 2)) * rate > 0.5
    assert np.mean((still_errors[:, 2] / [solution.angle_sd_rad[0] for solution in still]) ** 2) < bound
