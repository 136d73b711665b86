"""The odometer: pulses of a known road, of a wheel beside the origin, backwards, and slipping."""

import numpy as np
import pytest

from moving_bodies import Circling, Rushing, generators
from truenorth.errors import ConfigError
from truenorth.sensors import OdometerDescription, simulate_odometer
from truenorth.sensors.odometer import distance_from_pulses

SURE = {"scale_sd_ppm": 0.0, "slips_per_minute": 0.0}


def run(odometer, body, duration_s=60.0):
    return simulate_odometer(odometer, body, start_ns=0, duration_s=duration_s, generator=generators())


def test_pulses_count_the_road_to_one_pulse():
    odometer = OdometerDescription(**SURE)
    log = run(odometer, Rushing(acceleration_mps2=0.5))
    road = 0.25 * (log.truth["time_ns"] * 1e-9) ** 2
    np.testing.assert_allclose(log.truth["distance_m"], road, rtol=1e-9)
    error = distance_from_pulses(odometer, log.columns["pulse_count"]) - road
    assert np.abs(error).max() <= odometer.pulse_m


def test_an_outer_wheel_runs_further():
    # A clockwise circle of 50 m, and the wheel 1 m to the left: 51 m.
    log = run(OdometerDescription(**SURE, position_body_m=(0.5, -1.0, 0.0)), Circling())
    np.testing.assert_allclose(log.truth["speed_mps"], 10.0 * 51.0 / 50.0, rtol=1e-9)


def test_backwards_counts_down_where_the_wheel_can_tell():
    back = Rushing(acceleration_mps2=-0.5)
    assert run(OdometerDescription(**SURE), back).columns["pulse_count"][-1] < 0
    assert run(OdometerDescription(**SURE, signed=False), back).columns["pulse_count"][-1] > 0


def test_slip_and_scale_are_in_the_pulses_and_in_the_truth():
    odometer = OdometerDescription(slips_per_minute=10.0, slip_sd=0.5)
    log = run(odometer, Circling(), 600.0)
    slip, scale = log.truth["slip"], log.truth["scale"][0]
    assert 0.05 < np.mean(slip != 0.0) < 0.5
    wanted = scale * 10.0 * (600.0 + 0.1 * slip.sum())
    got = distance_from_pulses(odometer, log.columns["pulse_count"][-1])
    # The slips are sampled at 10 Hz here and smooth over more than 0.75 s.
    assert got == pytest.approx(wanted, abs=2.0)
    assert distance_from_pulses(odometer, 100, scale=2.0) == pytest.approx(1.0)


def test_impossible_settings_are_refused_by_name():
    for key in ("pulse_m", "slip_duration_s"):
        with pytest.raises(ConfigError, match=f"`{key}`"):
            OdometerDescription(**{key: 0.0})
