"""Noise of velocities in an inertial frame: its covariance, whitening, what of it shows, bumps."""

import numpy as np
import pytest

from truenorth.northfinding.inertial_noise import (
    VelocityNoise,
    bump_factors,
    estimate_noise,
    walk_covariance,
    whiten,
)

GRAVITY = 9.8


def drawn(noise, number, rng, *, finer=20, axes=2):
    """Mean velocities with these noises, integrated finely from rest and level, and the last slope."""
    step = noise.interval_s / finer
    shape = (number * finer, axes)
    walked = GRAVITY * noise.angle_walk_rad_per_sqrt_s * np.sqrt(step) * rng.standard_normal(shape)
    force = np.cumsum(walked, axis=0)
    pushed = noise.velocity_walk_mps_per_sqrt_s * np.sqrt(step) * rng.standard_normal(shape)
    velocity = np.cumsum((force - 0.5 * walked) * step + pushed, axis=0) - 0.5 * pushed
    means = velocity.reshape(number, finer, axes).mean(axis=1)
    return means + noise.shaking_mps * rng.standard_normal((number, axes)), force[-1]


@pytest.mark.parametrize(
    "noise",
    [
        VelocityNoise(1.0, 1e-3, 0.0, 0.0),
        VelocityNoise(1.0, 1e-6, 1e-3, 0.0),
        VelocityNoise(2.0, 1e-6, 0.0, 1e-4),
        VelocityNoise(0.5, 1e-3, 2e-3, 5e-4),
    ],
)
def test_whitened_noise_is_white(noise):
    rng = np.random.default_rng(1)
    means, _ = drawn(noise, 30, rng, finer=80, axes=1000)
    white = whiten(means, noise, GRAVITY, np.ones(30))
    # 1000 draws tell variances to 4.5 %, correlations to 3 %.
    cov = np.cov(white)
    np.testing.assert_allclose(np.diag(cov), 1.0, atol=0.22)
    np.testing.assert_allclose(cov - np.diag(np.diag(cov)), 0.0, atol=0.16)


def test_what_was_shaken_more_is_whitened_by_its_own_variance():
    rng = np.random.default_rng(2)
    factors = np.where(np.arange(30) % 7 == 3, 100.0, 1.0)
    shaken = 1e-3 * np.sqrt(factors)[:, None] * rng.standard_normal((30, 2000))
    white = whiten(shaken, VelocityNoise(1.0, 1e-3, 0.0, 0.0), GRAVITY, factors)
    np.testing.assert_allclose(np.cov(white), np.eye(30), atol=0.16)


def test_the_slope_walked_follows_from_earlier_rows():
    """The running sum predicts the slope at the end with the variance that it says."""
    noise = VelocityNoise(1.0, 2e-3, 1e-4, 1e-4)
    rng = np.random.default_rng(3)
    number = 60
    means, slope = drawn(noise, number, rng, axes=3000)
    time = np.arange(number) + 0.5
    trend = np.stack([np.ones(number), time], axis=1)
    walk = walk_covariance(noise, GRAVITY, number)
    white = whiten(np.column_stack([trend, walk, means]), noise, GRAVITY, np.ones(number))
    of_trend, of_walk, of_means = white[:, :2], white[:, 2], white[:, 3:]
    fitted = np.linalg.lstsq(of_trend, of_means, rcond=None)[0]
    predicted = fitted[1] + of_walk @ (of_means - of_trend @ fitted)
    share = np.array([0.0, 1.0]) - of_walk @ of_trend
    density = (GRAVITY * noise.angle_walk_rad_per_sqrt_s) ** 2
    variance = share @ np.linalg.inv(of_trend.T @ of_trend) @ share
    variance += density * number - of_walk @ of_walk
    error = predicted - slope
    assert np.mean(error**2) == pytest.approx(variance, rel=0.13)
    assert variance < 0.05 * density * number


@pytest.mark.parametrize(
    ("noise", "number"),
    [
        (VelocityNoise(1.0, 1e-4, 5e-5, 1.4e-7), 1800),
        (VelocityNoise(1.0, 1e-3, 1e-3, 4e-5), 600),
        (VelocityNoise(1.0, 5e-3, 1e-6, 4e-6), 900),
    ],
)
def test_noise_that_shows_is_found(noise, number):
    found = []
    for seed in range(6):
        means, _ = drawn(noise, number, np.random.default_rng(seed))
        # A parabola, as the fit of the rotation leaves it, does not matter.
        means += 1e-6 * np.arange(number)[:, None] ** 2
        seen = estimate_noise(means, 1.0, GRAVITY, np.ones(number))
        found.append((seen.shaking_mps, seen.velocity_walk_mps_per_sqrt_s, seen.angle_walk_rad_per_sqrt_s))
    shaking, accelerometer, gyro = np.median(found, axis=0)
    assert shaking == pytest.approx(noise.shaking_mps, rel=0.1)
    assert gyro == pytest.approx(noise.angle_walk_rad_per_sqrt_s, rel=0.5)
    if noise.velocity_walk_mps_per_sqrt_s > 0.1 * noise.shaking_mps:
        assert accelerometer == pytest.approx(noise.velocity_walk_mps_per_sqrt_s, rel=0.25)
    else:
        # One that drowns in the shaking is not made up.
        assert accelerometer < 0.05 * noise.shaking_mps


def test_noise_that_is_stated_is_taken():
    means, _ = drawn(VelocityNoise(1.0, 1e-3, 0.0, 0.0), 100, np.random.default_rng(4))
    seen = estimate_noise(
        means, 1.0, GRAVITY, np.ones(100), angle_walk_rad_per_sqrt_s=3e-6, velocity_walk_mps_per_sqrt_s=2e-3
    )
    assert seen.angle_walk_rad_per_sqrt_s == 3e-6
    assert seen.velocity_walk_mps_per_sqrt_s == 2e-3


def test_bumps_are_told_from_noise_and_from_what_is_slow():
    rng = np.random.default_rng(5)
    number = 200
    time = np.arange(number)
    calm = 1e-3 * rng.standard_normal((number, 2)) + 1e-5 * time[:, None] ** 2
    # Of 400 departures of Gaussian noise beyond four of their standard deviations 0.03 are expected.
    assert np.count_nonzero(bump_factors(calm) > 1.0) <= 2
    bumped = calm.copy()
    for k in (0, 57, 58, 199):
        bumped[k, k % 2] += 0.02
    factors = bump_factors(bumped)
    assert set(np.flatnonzero(factors > 2.0)) == {0, 57, 58, 199}
    # About 20 of the 4 standard deviations that are let pass, squared.
    np.testing.assert_allclose(factors[[57, 58]], 25.0, rtol=0.6)
    # Nothing but rounding, and a line, have none.
    assert np.all(bump_factors(np.outer(time, [1.0, -2.0])) == 1.0)
    assert np.all(bump_factors(1e3 * np.outer(time[:9], [1.0, -2.0])) == 1.0)
