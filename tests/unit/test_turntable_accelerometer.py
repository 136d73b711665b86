"""The accelerometer on a turntable: exact signal against the textbook's, and north from it."""

import numpy as np
import pytest

from moving_bodies import Resting, generators
from truenorth.errors import ConfigError
from truenorth.northfinding.turntable import demodulate, inclination_error_rad
from truenorth.sensors import TurntableAccelerometerDescription, simulate_turntable_accelerometer
from truenorth.sensors.turntable_accelerometer import (
    Vibration,
    coriolis_amplitude_mps2,
)

FORTY = np.radians(40.0)


def run(sensor, body, duration_s=10.0, seed=1):
    return simulate_turntable_accelerometer(
        sensor, body, start_ns=0, duration_s=duration_s, generator=generators(seed)
    )


def azimuth_errors_deg(sensor, body):
    heading, _ = demodulate(sensor, run(sensor, body))
    return np.degrees(np.mod(heading - np.radians(body.heading_deg) + np.pi, 2.0 * np.pi) - np.pi)


def test_signal_is_gravity_and_the_coriolis_term_of_the_textbook():
    sensor = TurntableAccelerometerDescription(noise_mps2=0.0)
    body = Resting(FORTY, heading_deg=-60.0)  # the source counts 60 deg counter-clockwise
    log = run(sensor, body)
    assert log.n_samples == 5000
    assert coriolis_amplitude_mps2(sensor, FORTY) == pytest.approx(3.51e-4, abs=5e-7)  # 40 deg in the source
    signal = log.truth["signal_mps2"]
    # Beside it stand centrifugal terms of the Earth rate: W^2 rho = 3e-10 m/s^2.
    np.testing.assert_allclose(signal - signal.mean(), log.truth["coriolis_mps2"], atol=1e-9)
    phase = sensor.table_rate_radps * log.time_ns * 1e-9 + np.radians(60.0)
    np.testing.assert_allclose(
        log.truth["coriolis_mps2"], coriolis_amplitude_mps2(sensor, FORTY) * np.cos(phase), atol=1e-12
    )
    assert signal.mean() == pytest.approx(9.80, abs=0.01)


@pytest.mark.parametrize("heading_deg", [0.0, 33.0, 180.0, 300.0])
@pytest.mark.parametrize("mark_deg", [0.0, 77.0])
def test_demodulation_finds_the_heading(heading_deg, mark_deg):
    sensor = TurntableAccelerometerDescription(noise_mps2=0.0, mark_deg=mark_deg)
    # A square wave of 500 samples knows its edges to 0.7 deg; the estimate is good to second order of that.
    np.testing.assert_allclose(azimuth_errors_deg(sensor, Resting(FORTY, heading_deg)), 0.0, atol=0.01)
    _, amplitude = demodulate(sensor, run(sensor, Resting(FORTY, heading_deg)))
    np.testing.assert_allclose(amplitude, coriolis_amplitude_mps2(sensor, FORTY), rtol=1e-4)


@pytest.mark.parametrize("inclination_deg", [0.2, 2.0, 5.0])
def test_inclination_about_the_meridian_costs_what_the_formula_says(inclination_deg):
    # Tilted about the north axis (roll at heading 0): exact rotation and formula agree to 0.005 deg.
    sensor = TurntableAccelerometerDescription(noise_mps2=0.0, tilt_roll_deg=inclination_deg)
    error = azimuth_errors_deg(sensor, Resting(FORTY))
    wanted = np.degrees(inclination_error_rad(np.radians(inclination_deg), FORTY, 0.0))
    np.testing.assert_allclose(np.abs(error), wanted, atol=0.01)


def test_inclination_about_another_axis_depends_on_its_sense():
    # About an axis at 60 deg and by 5 deg, an exact rotation costs 1.886 or 2.343 deg, the formula has 2.097.
    assert np.degrees(inclination_error_rad(np.radians(5.0), FORTY, np.radians(60.0))) == pytest.approx(
        2.097, abs=5e-4
    )
    costs = []
    for roll in (5.0, -5.0):
        sensor = TurntableAccelerometerDescription(noise_mps2=0.0, tilt_roll_deg=roll)
        costs.append(float(np.abs(azimuth_errors_deg(sensor, Resting(FORTY, heading_deg=60.0))).mean()))
    np.testing.assert_allclose(sorted(costs), [1.886, 2.343], atol=0.01)


def test_a_leaning_axis_feels_the_centripetal_acceleration():
    sensor = TurntableAccelerometerDescription(noise_mps2=0.0, axis_error_mrad=(1.0, 0.0))
    lean = run(sensor, Resting(FORTY)).truth["signal_mps2"]
    plain = run(TurntableAccelerometerDescription(noise_mps2=0.0), Resting(FORTY)).truth["signal_mps2"]
    inward = sensor.table_rate_radps**2 * sensor.radius_m
    assert (lean - plain).mean() == pytest.approx(-1e-3 * inward, rel=1e-3)


def test_jitter_and_vibration_appear_and_revolutions_fit_the_record():
    wave = Vibration(frequency_hz=25.0, amplitude_mps2=1e-4)
    sensor = TurntableAccelerometerDescription(
        noise_mps2=0.0, vibrations=(wave,), speed_jitter=0.01, revolutions=100, start_s=1.0
    )
    log = run(sensor, Resting(FORTY), duration_s=3.05)
    assert log.n_samples == 20 * 500
    assert log.time_ns[0] == 10**9
    assert np.std(log.truth["vibration_mps2"]) == pytest.approx(1e-4 / np.sqrt(2.0), rel=1e-3)
    steady = sensor.table_rate_radps * np.arange(log.n_samples) / 5000.0
    assert 0.001 < np.std(log.truth["table_angle_rad"] - steady) < 1.0
    assert run(sensor, Resting(FORTY), duration_s=0.5).n_samples == 0


def test_impossible_settings_are_refused_by_name():
    for key, value in (
        ("radius_m", 0.0),
        ("revolutions", 0),
        ("tilt_pitch_deg", 95.0),
        ("speed_jitter", -0.1),
    ):
        with pytest.raises(ConfigError, match=f"`{key}`"):
            TurntableAccelerometerDescription(**{key: value})
