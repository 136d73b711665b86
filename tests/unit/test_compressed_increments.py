"""Compressed increments move as the single ones do; a unit without compensation is mended to second order."""

import numpy as np
import pytest

from truenorth.strapdown import (
    InertialIncrements,
    compensate_increments,
    compress_increments,
    integrate_increments,
)

pytestmark = pytest.mark.unit

STEP_S = 0.01
START = (np.array([4.2e6, 1.1e6, 4.6e6]), np.zeros(3), np.eye(3))


def shaking(n):
    """Increments of a body that turns and is pushed about all axes."""
    rng = np.random.default_rng(5)
    angle = np.cumsum(rng.normal(0.0, 2e-3, (n, 3)), axis=0) * 0.1
    velocity = np.array([0.0, 0.0, -0.098]) + rng.normal(0.0, 0.01, (n, 3))
    return InertialIncrements(np.arange(n + 1) * STEP_S, angle, velocity)


def test_blocks_reach_the_same_state():
    single = shaking(500)
    trapezoid = InertialIncrements(
        single.time_s, single.angle_rad, single.velocity_mps, 0.5 * STEP_S * single.velocity_mps
    )
    fine = integrate_increments(trapezoid, *START)
    coarse = integrate_increments(compress_increments(single, 25), *START)
    np.testing.assert_allclose(coarse.time_s, fine.time_s[::25])
    np.testing.assert_allclose(coarse.rot_ecef_from_body, fine.rot_ecef_from_body[::25], atol=1e-13)
    # Gravitation within a block is taken as linear along the way: 4 mm of it in 0.25 s are 1e-9 m/s.
    np.testing.assert_allclose(coarse.velocity_ecef_mps, fine.velocity_ecef_mps[::25], atol=1e-7)
    np.testing.assert_allclose(coarse.position_ecef_m, fine.position_ecef_m[::25], atol=1e-7)


def test_what_does_not_fill_a_block_is_dropped():
    blocks = compress_increments(shaking(105), 10)
    assert len(blocks.angle_rad) == 10
    assert blocks.time_s[-1] == pytest.approx(1.0)


def test_coning_of_a_plain_unit_is_mended():
    # Classical coning: a tilt of 1 degree whose direction turns at 5 Hz drifts by 2 pi f (1 - cos) rad/s.
    tilt, turn_radps, n = np.radians(1.0), 2.0 * np.pi * 5.0, 400
    edges = np.arange(n + 1) * STEP_S
    rate = np.sin(tilt) * turn_radps
    plain = np.stack(
        [
            rate / turn_radps * np.diff(np.cos(turn_radps * edges)),
            rate / turn_radps * np.diff(np.sin(turn_radps * edges)),
            np.full(n, -turn_radps * (1.0 - np.cos(tilt)) * STEP_S),
        ],
        axis=1,
    )
    mended, _ = compensate_increments(plain, np.zeros((n, 3)))

    def drift(angle):
        return compress_increments(InertialIncrements(edges, angle, np.zeros((n, 3))), n).angle_rad[0, 2]

    # After whole turns the body is where it began; without the mending it seems to turn by 0.96 mrad/s x 4 s.
    assert abs(drift(plain)) > 40.0 * abs(drift(mended))


def test_a_steady_turn_does_not_bend_the_force():
    # A body that turns steadily while it is pushed northwards: its axes see the push turn.
    n, rate = 50, 2.0
    edges = np.arange(n + 1) * STEP_S
    seen = (
        np.stack([np.diff(np.sin(rate * edges)), np.diff(np.cos(rate * edges)), np.zeros(n)], axis=1) / rate
    )
    angle = np.tile([0.0, 0.0, rate * STEP_S], (n, 1))
    _, velocity = compensate_increments(angle, seen)
    whole = compress_increments(InertialIncrements(edges, angle, velocity), n)
    # A push along x of a body that turns by +rate about z: x fades and y goes negative; in the first axes it
    # is one second's worth of half a second, straight.  Left over: the third order, (rate step)^2 / 6.
    np.testing.assert_allclose(whole.velocity_mps[0], [n * STEP_S, 0.0, 0.0], atol=1e-4)
