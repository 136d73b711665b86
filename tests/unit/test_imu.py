"""IMUs: grades, what an ideal unit says of a known motion, each error by itself, and the way back."""

from typing import get_args, get_type_hints

import msgspec
import numpy as np
import pytest

from moving_bodies import LATITUDE, Circling, Resting, Wobbling, generators
from truenorth.config import convert_settings
from truenorth.errors import ConfigError
from truenorth.gravity import EARTH_RATE_RADPS
from truenorth.sensors import ImuDescription, correct_imu, simulate_imu
from truenorth.sensors.imu import GRADES, draw_calibration, imu_increments_from_log
from truenorth.sensors.kinematics import PointOfBody
from truenorth.strapdown import InertialIncrements, integrate_increments

PERFECT = {key: 0.0 for key in GRADES["tactical"] if key != "output" and "_range_" not in key}


def run(imu, body, duration_s=10.0, seed=1):
    return simulate_imu(imu, body, start_ns=0, duration_s=duration_s, generator=generators(seed))


def test_a_grade_fills_what_is_left_out_and_nothing_else():
    imu = ImuDescription(grade="navigation", gyro_random_walk_deg_per_sqrt_h=0.01)
    assert imu.gyro_random_walk_deg_per_sqrt_h == 0.01
    for key, value in GRADES["navigation"].items():
        if key != "gyro_random_walk_deg_per_sqrt_h":
            assert getattr(imu, key) == value
    assert tuple(GRADES) == get_args(get_type_hints(ImuDescription)["grade"])
    # What is printed back into a file describes the same unit.
    assert convert_settings(msgspec.to_builtins(imu), ImuDescription) == imu


def test_better_grades_are_better_in_every_noise():
    for key in PERFECT:
        if "sensitivity" in key or "sd" in key or "random_walk" in key:
            values = [GRADES[grade][key] for grade in ("consumer", "industrial", "tactical", "navigation")]
            if (
                key != "accel_random_walk_mps_per_sqrt_h"
            ):  # the tactical unit is noisier here than the industrial
                assert values == sorted(values, reverse=True), key


def test_an_ideal_unit_returns_to_the_truth_where_it_sits():
    lever = (1.2, -0.4, 0.3)
    imu = ImuDescription(output="increments", position_body_m=lever, mount_deg=(30.0, 10.0, -5.0), **PERFECT)
    for body in (Wobbling(), Circling()):
        log = run(imu, body)
        angle, velocity = imu_increments_from_log(imu, log)
        turned = imu.rot_body_from_imu
        edges = np.arange(log.n_samples + 1) / imu.rate_hz
        truth = PointOfBody(body, np.array(lever)).at(edges)
        states = integrate_increments(
            InertialIncrements(edges, angle @ turned.T, velocity @ turned.T),
            truth.position_ecef_m[0], truth.velocity_ecef_mps[0], truth.rot_ecef_from_body[0],
        )  # fmt: skip
        np.testing.assert_allclose(states.rot_ecef_from_body, truth.rot_ecef_from_body, atol=1e-12)
        np.testing.assert_allclose(states.velocity_ecef_mps, truth.velocity_ecef_mps, atol=1e-8)
        # A unit gives no second integral, and T^2 / 12 of the change of acceleration is what that costs.
        np.testing.assert_allclose(states.position_ecef_m, truth.position_ecef_m, atol=1e-4)


def test_at_rest_it_feels_the_earth_turn_and_its_gravity():
    imu = ImuDescription(output="rates", **PERFECT)
    log = run(imu, Resting(heading_deg=90.0), 2.0)
    rate = [log.columns[f"rate_{axis}_radps"] for axis in "xyz"]
    wanted = EARTH_RATE_RADPS * np.array([0.0, -np.cos(LATITUDE), -np.sin(LATITUDE)])
    # Increments of 7e-7 rad keep ten digits beside the 1 of a rotation matrix.
    np.testing.assert_allclose(np.transpose(rate), np.tile(wanted, (200, 1)), atol=1e-12)
    np.testing.assert_allclose(log.columns["force_z_mps2"], -9.80828, atol=1e-4)
    np.testing.assert_allclose(log.columns["force_x_mps2"], 0.0, atol=1e-5)


def test_constant_errors_enter_as_described_and_come_off_to_rounding():
    errors = {
        key: value for key, value in GRADES["consumer"].items() if "_sd_" in key or "_sensitivity_" in key
    }
    for output in ("increments", "rates"):
        settings = {**PERFECT, **errors, "output": output, "mount_deg": (90.0, 0.0, 0.0)}
        imu = ImuDescription(name="unit", **settings)
        log = run(imu, Wobbling(), 5.0, seed=4)
        calibration = draw_calibration(imu, generators(4))
        truth = run(ImuDescription(output=output, **PERFECT), Wobbling(), 5.0)
        wanted = imu_increments_from_log(imu, truth)
        raw, corrected = imu_increments_from_log(imu, log), correct_imu(imu, log, calibration)
        for was, now, true in zip(raw, corrected, wanted, strict=True):
            assert np.abs(was - true).max() > 1e-5
            np.testing.assert_allclose(now, true, atol=1e-14)
        for axis, bias in zip("xyz", calibration.gyro_bias_radps, strict=True):
            np.testing.assert_allclose(log.truth[f"gyro_bias_{axis}_radps"], bias, rtol=1e-12)


def test_counted_increments_lose_nothing_and_rates_are_rounded():
    step = np.radians(0.5) / 100.0
    settings = {**PERFECT, "gyro_resolution_dps": 0.5}
    counted = run(ImuDescription(output="increments", **settings), Wobbling())
    for axis in "xyz":
        name = f"delta_angle_{axis}_rad"
        np.testing.assert_allclose(
            counted.columns[name] / step, np.rint(counted.columns[name] / step), atol=1e-6
        )
        lost = np.cumsum(counted.columns[name] - counted.truth[name])
        assert np.abs(lost).max() <= 0.5 * step * (1.0 + 1e-9)
    rounded = run(ImuDescription(output="rates", **settings), Wobbling())
    error = rounded.columns["rate_x_radps"] - rounded.truth["rate_x_radps"]
    assert np.abs(error).max() <= 0.5 * np.radians(0.5) * (1.0 + 1e-9)


def test_the_range_ends_the_output():
    imu = ImuDescription(output="rates", **PERFECT, gyro_range_dps=20.0, accel_range_g=0.5)
    log = run(imu, Wobbling())
    assert np.degrees(log.columns["rate_z_radps"]).max() == pytest.approx(20.0)
    assert log.columns["force_z_mps2"].min() == pytest.approx(-0.5 * 9.80665)


@pytest.mark.parametrize(
    ("key", "value"),
    [("gyro_range_dps", 0.0), ("accel_bias_sd_ug", -1.0), ("rate_hz", -100.0), ("name", "")],
)
def test_impossible_settings_are_refused_by_name(key, value):
    with pytest.raises(ConfigError, match=f"`{key}`"):
        ImuDescription(**{key: value})
