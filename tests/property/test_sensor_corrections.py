"""Laws of the sensors' corrections: each undoes its error model for any input."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from truenorth.rotations import body_rate_from_euler_rates, rot_ned_from_body
from truenorth.sensors import CompassDescription, FogDescription, correct_tilt, heading_rate, magnetic_heading
from truenorth.sensors.compass import correct_iron
from truenorth.sensors.gyro import rate_from_counts, scale_radps_per_count, sensitive_axis_body
from truenorth.sensors.kinematics import apparent_tilt, frame_rate_ned
from truenorth.sensors.sampling import SampledSensor, sample_times_s, stamp_times


def numbers(low, high):
    return st.floats(low, high, allow_nan=False, allow_infinity=False)


angles, rates, tilts = numbers(-3.1, 3.1), numbers(-2.0, 2.0), numbers(-1.0, 1.0)


@given(
    angles, tilts, tilts, rates, rates, rates, numbers(-40.0, 40.0), numbers(-20.0, 20.0), numbers(-1.4, 1.4)
)
def test_heading_rate_undoes_any_turn(heading, pitch, roll, dh, dp, dr, axis_pitch, axis_roll, latitude):
    axis = sensitive_axis_body(FogDescription(axis_pitch_deg=axis_pitch, axis_roll_deg=axis_roll))
    np.testing.assert_allclose(np.linalg.norm(axis), 1.0, rtol=1e-14)
    frame = frame_rate_ned(latitude, 100.0, np.array([30.0, -20.0, 1.0]))
    body = body_rate_from_euler_rates(pitch, roll, dh, dp, dr)
    inertial = body + rot_ned_from_body(heading, pitch, roll).T @ frame
    turning = body_rate_from_euler_rates(pitch, roll, 1.0, 0.0, 0.0) @ axis
    back = heading_rate(
        inertial @ axis, pitch, roll, pitch_rate_radps=dp, roll_rate_radps=dr, axis_body=axis,
        heading_rad=heading, frame_rate_ned_radps=frame,
    )  # fmt: skip
    if abs(turning) > 1e-3:
        np.testing.assert_allclose(back, dh, atol=1e-12 / abs(turning))


@given(numbers(-1.2, 1.2), numbers(-1.2, 1.2), numbers(-4.0, 4.0), numbers(-4.0, 4.0), numbers(-4.0, 4.0))
def test_tilt_correction_undoes_any_acceleration(pitch, roll, forward, right, down):
    force = rot_ned_from_body(0.0, pitch, roll).T @ np.array([forward, right, down - 9.81])
    back = correct_tilt(*apparent_tilt(force), forward, right, down_mps2=down)
    np.testing.assert_allclose(back, (pitch, roll), atol=1e-7)


@given(angles, numbers(-1.5, 1.5), angles, numbers(-1.4, 1.4))
def test_magnetic_heading_does_not_depend_on_the_attitude(heading, pitch, roll, dip):
    field = rot_ned_from_body(heading, pitch, roll).T @ np.array([np.cos(dip), 0.0, np.sin(dip)])
    back = magnetic_heading(field[None], np.array([pitch]), np.array([roll]))[0]
    np.testing.assert_allclose(np.mod(back - heading + 1.0, 2.0 * np.pi), 1.0, atol=1e-9)


@given(
    st.lists(numbers(-0.3, 0.3), min_size=9, max_size=9), st.lists(numbers(-1e4, 1e4), min_size=6, max_size=6)
)
def test_iron_correction_undoes_any_iron(bend, magnets):
    soft = np.eye(3) + np.reshape(bend, (3, 3)) / 2.0
    compass = CompassDescription(
        soft_iron=tuple(map(tuple, soft.tolist())), hard_iron_body_nt=tuple(magnets[:3])
    )
    field = np.array([magnets[3:]])
    np.testing.assert_allclose(
        correct_iron(compass, field @ soft.T + np.array(magnets[:3])), field, atol=1e-9 * 1e4
    )


@given(st.integers(-2048, 2047), numbers(-40.0, 85.0), numbers(-3.0, 3.0))
def test_counts_become_rates_linearly(count, temperature, offset):
    gyro = FogDescription()
    scale = scale_radps_per_count(gyro, np.array(temperature))
    step = rate_from_counts(gyro, count + 1, temperature) - rate_from_counts(gyro, count, temperature)
    np.testing.assert_allclose(step, scale, rtol=1e-9)
    moved = rate_from_counts(gyro, count, temperature, bias_offset_count=offset)
    np.testing.assert_allclose(
        rate_from_counts(gyro, count, temperature) - moved, offset * scale, rtol=1e-9, atol=1e-14
    )


@given(
    numbers(0.5, 500.0), numbers(0.0, 0.5), numbers(0.0, 0.2), numbers(0.0, 0.3), numbers(0.0, 30.0),
    st.integers(0, 2**61),
)  # fmt: skip
def test_stamps_are_never_early_nor_more_than_a_tick_late(rate, phase, latency, tick, duration, start_ns):
    sensor = SampledSensor(rate_hz=rate, phase_s=phase, latency_s=latency, time_tag_step_s=tick)
    edges = sample_times_s(sensor, duration)
    assert len(edges) >= 1
    assert np.all(edges[1:] <= duration + 1e-5 / rate)
    true_ns, stamped_ns = stamp_times(sensor, edges[1:], start_ns, lambda *_: np.random.default_rng(1))
    late = true_ns + round(latency * 1e9) - stamped_ns
    assert np.all((late >= 0) & (late <= max(0, round(tick * 1e9) - 1)))
    assert np.all(np.diff(stamped_ns) >= 0)
