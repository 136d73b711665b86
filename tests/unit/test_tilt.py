"""The liquid tilt meter: apparent vertical, the liquid's answer, and the correction for acceleration."""

import numpy as np
import pytest

from moving_bodies import Circling, Resting, Rushing, generators
from truenorth.errors import ConfigError
from truenorth.sensors import TiltDescription, correct_tilt, simulate_tilt, spline_acceleration
from truenorth.sensors.kinematics import apparent_tilt
from truenorth.sensors.tilt import TILT_OUT_OF_RANGE, correct_tilt_simplified, follow
from truenorth.strapdown import specific_force_body_mps2

QUIET = {"noise_moving_deg": (0.0, 0.0), "noise_static_deg": (0.0, 0.0), "resolution_deg": 0.0}


def run(tilt, body, duration_s=30.0):
    return simulate_tilt(tilt, body, start_ns=0, duration_s=duration_s, generator=generators())


def test_at_rest_the_bubble_shows_pitch_and_roll():
    log = run(TiltDescription(**QUIET, offset_deg=(0.5, -0.25)), Resting(pitch_deg=12.0, roll_deg=-7.0))
    # Normal gravity bends by 0.2" over the 1100 m between the ellipsoid and the place.
    np.testing.assert_allclose(log.columns["pitch_deg"], 12.5, atol=1e-4)
    np.testing.assert_allclose(log.columns["roll_deg"], -7.25, atol=1e-4)


def test_acceleration_ahead_reads_nose_up_and_a_right_turn_right_side_up():
    ahead = run(TiltDescription(**QUIET), Rushing(acceleration_mps2=1.5))
    # 9.808 m/s^2 is gravity at the place; 8.70 deg. The Coriolis term of 45 m/s moves it by 0.03 deg.
    np.testing.assert_allclose(ahead.columns["pitch_deg"][20:], 8.70, atol=0.04)
    turn = run(TiltDescription(**QUIET), Circling(speed_mps=10.0, radius_m=50.0))
    np.testing.assert_allclose(turn.columns["roll_deg"][20:], -11.52, atol=0.02)


def test_the_liquid_answers_a_step_like_a_damped_oscillator():
    step_s, frequency, damping = 0.001, 1.5, 0.5
    t = np.arange(0.0, 3.0, step_s)
    angle = np.where(t >= 0.5, 1.0, 0.0)[:, None]
    answer = follow(angle, step_s, frequency, damping)[:, 0]
    w0 = 2.0 * np.pi * frequency
    wd, since = w0 * np.sqrt(1.0 - damping**2), np.maximum(t - 0.5, 0.0)
    wanted = 1.0 - np.exp(-damping * w0 * since) * (
        np.cos(wd * since) + damping / np.sqrt(1.0 - damping**2) * np.sin(wd * since)
    )
    # The step takes one sample to rise, so that the answer may be early by half a sample: w0 / 2 per ms.
    np.testing.assert_allclose(answer, wanted, atol=0.6 * w0 * step_s)
    assert answer.max() == pytest.approx(1.0 + np.exp(-np.pi * damping / np.sqrt(1 - damping**2)), abs=1e-3)


def test_the_liquid_starts_at_rest_and_may_be_left_out():
    angle = np.full((50, 2), (0.2, -0.1))
    np.testing.assert_allclose(follow(angle, 0.01, 1.5, 0.5), angle, atol=1e-12)
    np.testing.assert_array_equal(follow(angle, 0.01, 0.0, 0.5), angle)


def test_resolution_and_range_of_the_instrument():
    log = run(TiltDescription(), Circling())
    for name in ("pitch_deg", "roll_deg"):
        np.testing.assert_allclose(log.columns[name] / 0.3, np.rint(log.columns[name] / 0.3), atol=1e-9)
    beyond = run(TiltDescription(**QUIET), Resting(pitch_deg=60.0))
    assert np.all(beyond.columns["pitch_deg"] == 50.0)
    assert np.all(beyond.columns["error_code"] == TILT_OUT_OF_RANGE)
    assert not log.columns["error_code"].any()


def test_exact_correction_undoes_any_acceleration():
    rng = np.random.default_rng(3)
    n = 200
    pitch, roll = rng.uniform(-0.7, 0.7, (2, n))
    forward, right, down = rng.uniform(-3.0, 3.0, (3, n))
    from truenorth.rotations import rot_ned_from_body

    level = np.stack([forward, right, down - 9.8], axis=-1)
    force = np.einsum("nij,ni->nj", rot_ned_from_body(np.zeros(n), pitch, roll), level)
    seen = apparent_tilt(force)
    back = correct_tilt(*seen, forward, right, down_mps2=down, gravity_mps2=9.8)
    np.testing.assert_allclose(back, (pitch, roll), atol=1e-12)
    # The form of the source is good to first order: level ground, one axis at a time, exactly.
    flat = apparent_tilt(np.array([[1.5, 0.0, -9.81], [0.0, 1.5, -9.81]]))
    np.testing.assert_allclose(
        correct_tilt_simplified(*flat, np.array([1.5, 0.0]), np.array([0.0, 1.5])), 0.0, atol=1e-15
    )


def test_correction_of_a_simulated_turn_leaves_the_attitude():
    log = run(TiltDescription(**QUIET), Circling())
    motion = Circling().at((log.truth["time_ns"]) * 1e-9)
    gravity = np.linalg.norm(specific_force_body_mps2(Resting().at(np.zeros(1))))
    still = np.zeros(log.n_samples)
    pitch, roll = correct_tilt(
        np.radians(log.columns["pitch_deg"]), np.radians(log.columns["roll_deg"]),
        still, still + 2.0, gravity_mps2=gravity,
    )  # fmt: skip
    # What is left is the Coriolis acceleration of the turning Earth, 1.1e-3 m/s^2 at 10 m/s.
    np.testing.assert_allclose(pitch, motion.pitch_rad, atol=2e-4)
    np.testing.assert_allclose(roll, motion.roll_rad, atol=2e-4)


def test_spline_is_the_relaxed_cubic_through_three_velocities():
    from scipy.interpolate import CubicSpline

    rng = np.random.default_rng(5)
    time_s = np.array([0.0, 1.0, 2.2, 3.0, 4.1])
    velocity = rng.standard_normal((5, 2))
    at = np.linspace(0.0, 4.1, 83)
    rate = spline_acceleration(time_s, velocity, at)
    for last in (2, 3, 4):
        three = slice(last - 2, last + 1)
        reference = CubicSpline(time_s[three], velocity[three], bc_type="natural").derivative()
        begin = time_s[0] if last == 2 else time_s[last - 1]
        inside = (at >= begin) & (at < time_s[last])
        np.testing.assert_allclose(rate[inside], reference(at[inside]), atol=1e-12)


def test_spline_says_nothing_over_gaps_or_outside():
    time_s = np.arange(8.0)
    velocity = np.column_stack([2.0 * time_s])
    velocity[4] = np.nan
    at = np.array([-0.5, 0.5, 2.5, 3.5, 5.5, 6.5, 7.5])
    rate = spline_acceleration(time_s, velocity, at)[:, 0]
    np.testing.assert_allclose(rate, [np.nan, 2.0, 2.0, np.nan, np.nan, 2.0, np.nan], atol=1e-12)
    assert np.isnan(spline_acceleration(time_s[:2], velocity[:2], at)).all()


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("damping", 0.0),
        ("range_deg", 90.0),
        ("noise_moving_deg", (1.0, -1.0)),
        ("natural_frequency_hz", -1.0),
    ],
)
def test_impossible_settings_are_refused_by_name(key, value):
    with pytest.raises(ConfigError, match=f"`{key}`"):
        TiltDescription(**{key: value})
