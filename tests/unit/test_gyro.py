"""The fibre-optic gyro: what its axis feels, its counts, its clock, and the way back to a heading rate."""

import numpy as np
import pytest

from moving_bodies import LATITUDE, Resting, Wobbling, generators
from truenorth.errors import ConfigError, ModelError
from truenorth.gravity import EARTH_RATE_RADPS
from truenorth.sensors import FogDescription, correct_gyro, heading_rate, simulate_gyro
from truenorth.sensors.gyro import heading_rate_simplified, scale_radps_per_count, sensitive_axis_body
from truenorth.sensors.kinematics import angle_integrals, frame_rate_ned
from truenorth.strapdown import rate_inertial_body_radps
from truenorth.timescales import NS_PER_S, gpst_from_calendar

START_NS = gpst_from_calendar(1997, 10, 15, 22, 13, 0)
QUIET = {"bias_walk_count_per_sqrt_s": 0.0, "angle_random_walk_deg_per_sqrt_h": 0.0}


def run(gyro, body, duration_s=20.0, seed=1):
    return simulate_gyro(gyro, body, start_ns=START_NS, duration_s=duration_s, generator=generators(seed))


def test_scale_polynomial_has_the_published_values_and_stays_at_its_ends():
    scale = np.degrees(scale_radps_per_count(FogDescription(), np.array([15.0, 20.0, 23.0, -10.0, 60.0])))
    # Harvey (1998), eq. 5.2, evaluated by hand to six digits.
    np.testing.assert_allclose(scale[:3], [0.046287, 0.046912, 0.047630], atol=5e-7)
    assert scale[3] == scale[0]
    assert scale[4] == scale[2]


def test_integrated_rate_agrees_with_dense_integration():
    from scipy.integrate import cumulative_simpson

    body, edges = Wobbling(), np.arange(0.0, 10.05, 0.1)
    dense = np.linspace(0.0, 10.0, 100_001)
    rate = rate_inertial_body_radps(body.at(dense))
    whole = cumulative_simpson(rate, x=dense, axis=0, initial=0.0)[::1000]
    # 1e-9 rad in 0.1 s is 2e-3 deg/h; the coning correction alone is worth 1e-5 rad here.
    np.testing.assert_allclose(angle_integrals(body, edges), np.diff(whole, axis=0), atol=1e-9)


def test_a_gyro_at_rest_feels_the_vertical_part_of_the_earth_rate():
    log = run(FogDescription(), Resting())
    np.testing.assert_allclose(log.truth["rate_radps"], -EARTH_RATE_RADPS * np.sin(LATITUDE), rtol=1e-6)
    # Heading west, an axis that leans in the plane of west and down feels the cosine.
    west = run(FogDescription(axis_pitch_deg=30.0), Resting(heading_deg=270.0)).truth["rate_radps"]
    np.testing.assert_allclose(
        west, -EARTH_RATE_RADPS * np.sin(LATITUDE) * np.cos(np.radians(30.0)), rtol=1e-6
    )


def test_heading_rate_comes_back_exactly_under_tilt_and_the_turning_earth():
    body, t = Wobbling(), np.linspace(0.0, 20.0, 401)
    gyro = FogDescription(axis_pitch_deg=2.0, axis_roll_deg=-3.0)
    motion = body.at(t)
    axis = sensitive_axis_body(gyro)
    _, _, _, wanted, pitch_rate, roll_rate = body.angles(t)
    rate = heading_rate(
        rate_inertial_body_radps(motion) @ axis,
        motion.pitch_rad,
        motion.roll_rad,
        pitch_rate_radps=pitch_rate,
        roll_rate_radps=roll_rate,
        axis_body=axis,
        heading_rad=motion.heading_rad,
        frame_rate_ned_radps=frame_rate_ned(LATITUDE),
    )
    np.testing.assert_allclose(rate, wanted, atol=1e-14)


def test_small_angle_form_misses_what_the_source_neglects():
    # Harvey (1998), eq. 5.13: 15 deg of tilt with 10 deg/s of pitch and roll rate; the largest error is
    # sqrt(2) tan(15 deg) 10 deg/s = 3.79 deg/s, at equal tilt about both axes.
    tilt = np.radians(15.0) / np.sqrt(2.0)
    rate = np.radians(10.0)
    error = np.degrees(np.sqrt(2.0) * rate * np.tan(np.hypot(tilt, tilt)))
    assert error == pytest.approx(3.79, abs=0.005)
    # On a steady, tilted turn both forms agree to the fourth order of the angles.
    felt = 0.3 * np.cos(0.1) * np.cos(0.05)
    assert heading_rate(felt, 0.1, 0.05) == pytest.approx(0.3, abs=1e-15)
    assert heading_rate_simplified(felt, 0.1, 0.05) == pytest.approx(0.3, abs=0.3 * 0.1**4)


def test_counts_round_the_rate_and_end_with_the_word():
    gyro = FogDescription(bias_table=((0.0, 0.4),), temperature_profile=((0.0, 20.0),), **QUIET)
    log = run(gyro, Wobbling())
    scale = scale_radps_per_count(gyro, np.array(20.0))
    np.testing.assert_array_equal(
        log.columns["rate_count"], np.rint(log.truth["rate_radps"] / scale + 0.4).astype(int)
    )
    assert np.all(log.columns["temperature_count"] == 120)
    short = run(FogDescription(bits=5, bias_table=((0.0, 0.0),)), Wobbling())
    assert short.columns["rate_count"].max() == 15


def test_correction_returns_the_rate_within_half_a_count():
    gyro = FogDescription(temperature_profile=((0.0, 15.0), (20.0, 23.0)), **QUIET)
    log = run(gyro, Wobbling())
    error = correct_gyro(gyro, log) - log.truth["rate_radps"]
    # Half a step of the thermometer moves the scale of 46 deg/s by 4e-5 rad/s and the bias by 0.003 count.
    assert np.abs(error).max() < 0.51 * scale_radps_per_count(gyro, np.array(23.0)) + 1e-3


def test_failures_are_flagged_and_freeze_the_rate():
    log = run(FogDescription(failures=((5.0, 7.0),)), Wobbling())
    failed = log.columns["status"] == 1
    assert failed.sum() == 20
    first = np.flatnonzero(failed)[0]
    assert np.all(log.columns["rate_count"][failed] == log.columns["rate_count"][first - 1])
    assert np.array_equal(np.isnan(correct_gyro(FogDescription(), log)), failed)


def test_stamps_are_those_of_a_clock_that_ticks_every_55_ms():
    gyro = FogDescription(latency_s=0.01)
    log = run(gyro, Resting(), duration_s=300.0)
    late = log.truth["time_ns"] + 10_000_000 - log.time_ns
    assert late.min() >= 0
    assert late.max() < 55_000_000
    assert set(np.unique(np.diff(log.time_ns))) == {55_000_000, 110_000_000}
    per_second = np.bincount((log.time_ns - START_NS) // NS_PER_S)[1:-1]
    assert set(per_second) == {9, 10, 11}
    exact = run(FogDescription(time_tag_step_s=0.0), Resting())
    np.testing.assert_array_equal(exact.time_ns, exact.truth["time_ns"])


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("rate_hz", 0.0),
        ("bits", 1),
        ("scale_polynomial", (0.0,)),
        ("bias_table", ((20.0, 0.1), (15.0, 0.2))),
        ("temperature_profile", ()),
        ("failure_probability", 1.5),
        ("failures", ((7.0, 5.0),)),
        ("axis_roll_deg", 90.0),
        ("angle_random_walk_deg_per_sqrt_h", float("nan")),
    ],
)
def test_impossible_settings_are_refused_by_name(key, value):
    with pytest.raises(ConfigError, match=f"`{key}`") as caught:
        FogDescription(**{key: value})
    assert caught.value.key == key


def test_impossible_corrections_are_refused():
    with pytest.raises(ModelError, match="small-angle"):
        heading_rate_simplified(np.ones(2), np.array([0.1, 0.9]), np.array([0.0, 0.9]))
    with pytest.raises(ModelError, match="heading_rad"):
        heading_rate(np.ones(2), np.zeros(2), np.zeros(2), frame_rate_ned_radps=np.zeros(3))
    assert np.isnan(heading_rate(0.1, np.pi / 2.0, 0.0))
