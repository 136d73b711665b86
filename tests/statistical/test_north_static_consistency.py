"""Errors of static alignment have the covariance that is stated, and each noise leaves what its line says.

Sums of squares over their variances are chi-square; the bounds are two-sided with a false alarm of 1e-5 each.
"""

import functools

import numpy as np
import pytest
from scipy import stats

from truenorth.northfinding import Site
from truenorth.northfinding.budget import static_budget
from truenorth.northfinding.static import align_static
from truenorth.rotations import log_so3, rot_ned_from_body
from truenorth.sensors import ImuDescription
from truenorth.sensors.imu import imu_increments_from_log, simulate_imu
from truenorth.sensors.processes import flicker, random_walk
from truenorth.simulation.motion import StaticMotion, build_trajectory
from truenorth.simulation.randomness import stream
from truenorth.strapdown import InertialIncrements

SITE = Site(0.62, 0.3, 200.0)
NO_DEFLECTION = {"deflection_sd_rad": 0.0}

# Every kind of error, the heading to about 1.6 degrees: first order holds to a part in a thousand.
SENSOR = ImuDescription(
    grade="tactical",
    rate_hz=10.0,
    output="rates",
    gyro_bias_sd_dph=0.2,
    gyro_bias_instability_dph=0.03,
    gyro_random_walk_deg_per_sqrt_h=0.01,
    gyro_bias_walk_dph_per_sqrt_h=1.5,
    gyro_scale_sd_ppm=2000.0,
    gyro_misalignment_sd_mrad=4.0,
    gyro_g_sensitivity_dph_per_g=0.1,
    gyro_resolution_dps=2e-4,
    accel_bias_sd_ug=500.0,
    accel_bias_walk_ug_per_sqrt_h=2000.0,
    accel_misalignment_sd_mrad=0.5,
    accel_scale_sd_ppm=500.0,
    accel_resolution_ug=300.0,
    accel_bias_instability_ug=40.0,
)


def interval(dof):
    """Bounds of a mean of dof squared standard normal errors."""
    return stats.chi2.ppf([5e-6, 1.0 - 5e-6], dof) / dof


def still(unit, angles_deg, seconds, seed):
    heading, pitch, roll = angles_deg
    trajectory = build_trajectory(
        StaticMotion(heading_deg=heading, pitch_deg=pitch, roll_deg=roll),
        latitude_rad=SITE.latitude_rad,
        longitude_rad=SITE.longitude_rad,
        height_m=SITE.height_m,
        duration_s=seconds,
        seed=1,
    )
    log = simulate_imu(
        unit, trajectory, start_ns=0, duration_s=seconds, generator=functools.partial(stream, seed)
    )
    angle, velocity = imu_increments_from_log(unit, log)
    return InertialIncrements(np.arange(len(angle) + 1) / unit.rate_hz, angle, velocity)


@pytest.mark.parametrize("form", ["orthonormal", "published"])
def test_errors_of_a_stated_sensor_have_the_stated_covariance(form):
    angles = (70.0, 20.0, -50.0)
    truth, n = rot_ned_from_body(*np.radians(angles)), 250
    square, heading = [], []
    for seed in range(n):
        found = align_static(still(SENSOR, angles, 30.0, seed), SITE, errors=SENSOR, form=form)
        error = log_so3(found.rot_ned_from_body @ truth.T)
        square.append(error @ np.linalg.solve(found.cov_ned_rad2, error))
        heading.append((found.heading_rad - np.radians(angles[0])) / found.angle_sd_rad[0])
    low, high = interval(3 * n)
    assert low < np.mean(square) / 3.0 < high
    low, high = interval(n)
    assert low < np.mean(np.square(heading)) < high
    # Both signs: the mean of n standard normal errors.
    assert abs(np.mean(heading)) < 4.5 / np.sqrt(n)


def test_without_stated_errors_sigma_is_that_of_noise():
    noise = {
        "gyro_random_walk_deg_per_sqrt_h": 0.01,
        "accel_random_walk_mps_per_sqrt_h": 0.5,
    }
    quiet = {
        name: 0.0
        for name in ImuDescription.__struct_fields__
        if name.startswith(("gyro_", "accel_")) and "_range_" not in name
    }
    unit = ImuDescription(rate_hz=10.0, **quiet | noise)
    truth, n = rot_ned_from_body(0.4, -0.2, 0.1), 200
    square, at_half = [], []
    for seed in range(n):
        found = align_static(still(unit, np.degrees([0.4, -0.2, 0.1]), 60.0, seed), SITE)
        error = log_so3(found.rot_ned_from_body @ truth.T)
        square.append(error @ np.linalg.solve(found.cov_ned_rad2, error) / 3.0)
        half = found.run.angles_rad[29, 0] - 0.4
        at_half.append((half / found.run.sd_rad[29, 0]) ** 2)
    # The scatter itself is measured in 60 (30) seconds: Hotelling's T2 of 3 (1) has this mean.
    low, high = interval(3 * n)
    assert 0.95 * low < np.mean(square) / (59.0 / (59.0 - 4.0)) < 1.05 * high
    low, high = interval(n)
    assert 0.95 * low < np.mean(at_half) / (29.0 / 27.0) < 1.05 * high


def line_sd(unit, source, duration_s):
    """What the mean of one axis keeps of an error, by the budget: rad/s or m/s^2."""
    budget = static_budget(unit, np.eye(3), SITE, duration_s, **NO_DEFLECTION)
    line = next(line for line in budget.lines if line.source == source)
    if source.startswith(("accelerometer", "velocity")):
        return np.sqrt(line.cov_ned_rad2[0, 0]) * SITE.gravity_mps2
    return np.sqrt(line.cov_ned_rad2[2, 2]) * SITE.horizontal_rate_radps


def test_a_mean_keeps_of_slow_noises_what_their_lines_say():
    n, step_s, seconds = 3000, 0.1, 40.0
    unit = ImuDescription(gyro_bias_instability_dph=1.0, accel_bias_walk_ug_per_sqrt_h=60.0)
    rng = np.random.default_rng(8)
    flickering = flicker(rng, (round(seconds / step_s), n), step_s, np.radians(1.0 / 3600.0)).mean(axis=0)
    walking = random_walk(rng, (round(seconds / step_s), n), step_s, 9.80665e-6).mean(axis=0)
    low, high = np.sqrt(interval(n))
    assert low < np.std(flickering) / line_sd(unit, "gyro bias instability", seconds) < high
    assert low < np.std(walking) / line_sd(unit, "accelerometer bias walk", seconds) < high


@pytest.mark.parametrize("spread", [0.0, 0.15, 0.3, 1.0])
def test_a_mean_of_rounded_rates_keeps_what_the_noise_does_not_smooth(spread):
    rate_hz, seconds, step_dps, n = 10.0, 40.0, 0.01, 4000
    # Angle random walk whose noise per sample is a part of a step.
    walk = spread * step_dps / np.sqrt(rate_hz) * 60.0
    unit = ImuDescription(
        rate_hz=rate_hz,
        output="rates",
        gyro_resolution_dps=step_dps,
        gyro_random_walk_deg_per_sqrt_h=walk,
    )
    rng = np.random.default_rng(4)
    truth = rng.uniform(-0.5, 0.5, n)
    noise = rng.normal(0.0, spread, (round(rate_hz * seconds), n)) if spread else np.zeros((1, n))
    left = np.radians(step_dps) * ((np.rint(truth + noise) - noise).mean(axis=0) - truth)
    ratio = np.std(left) / line_sd(unit, "gyro quantisation", seconds)
    # A rounding error is bounded, so this is wider than needed; noise and rounding are not quite independent
    # where the noise is a part of a step, which moves the small white part.
    low, high = np.sqrt(interval(n))
    assert low < ratio < high


def test_counted_increments_round_only_the_ends():
    rate_hz, seconds, n = 10.0, 20.0, 4000
    unit = ImuDescription(rate_hz=rate_hz, output="increments", accel_resolution_ug=1000.0)
    step_mps = 1000.0 * 9.80665e-6 / rate_hz
    start, gained = np.random.default_rng(2).uniform(-50.0, 50.0, (2, n))
    left = (np.rint(start + gained) - np.rint(start) - gained) * step_mps / seconds
    low, high = np.sqrt(interval(n))
    assert low < np.std(left) / line_sd(unit, "accelerometer quantisation", seconds) < high
