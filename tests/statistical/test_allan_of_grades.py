"""Noise of simulated units of every grade, found again in their Allan deviation.

Bounds hold for the fixed seeds below; a coefficient is 5 of its own sigmas off by chance once in two million.
"""

import functools

import numpy as np
import pytest
from scipy.stats import chi2

from truenorth.sensors.allan import analyse_allan
from truenorth.sensors.imu import (
    GRADES,
    ImuDescription,
    allan_deviation,
    imu_increments_from_log,
    simulate_imu,
)
from truenorth.simulation.motion import StaticMotion, build_trajectory
from truenorth.simulation.randomness import stream
from truenorth.strapdown import InertialIncrements

DURATION_S, RATE_HZ = 3600.0, 20.0


@pytest.fixture(scope="module", params=GRADES)
def analysed(request):
    """A grade at rest for an hour, and its analysis."""
    imu = ImuDescription(grade=request.param, rate_hz=RATE_HZ)
    rest = build_trajectory(
        StaticMotion(heading_deg=30.0, pitch_deg=1.0),
        latitude_rad=0.8,
        longitude_rad=0.2,
        height_m=300.0,
        duration_s=DURATION_S,
        seed=1,
    )
    log = simulate_imu(imu, rest, start_ns=0, duration_s=DURATION_S, generator=functools.partial(stream, 20))
    angle, velocity = imu_increments_from_log(imu, log)
    return imu, analyse_allan(InertialIncrements(np.arange(len(angle) + 1) / RATE_HZ, angle, velocity))


def _stated(imu, axis):
    """Terms of an axis that the description has, with their values there."""
    for term in axis.terms.values():
        field = f"{'gyro' if axis.kind == 'gyro' else 'accel'}_{term.name}_{term.suffix}"
        if hasattr(imu, field):
            yield term, getattr(imu, field)


def test_coefficients_come_back_within_their_sigma(analysed):
    imu, result = analysed
    for axis in (*result.axes, result.gyro, result.accelerometer):
        assert axis.disturbance is None
        assert axis.probability > 1e-4
        for term, truth in _stated(imu, axis):
            if term.is_determined and truth > 0.0:
                assert abs(term.value - truth) < 5.0 * term.sd, (axis.name, term)
            elif not term.is_determined:
                # The bound is 1.6 sigma of the square up; 1.6 times as much is 4 sigma and more.
                assert truth < 1.6 * term.bound, (axis.name, term)
        # Steps of rates add a little white noise: at most 0.2 % here.
        white = axis.terms["random_walk"]
        assert white.is_determined
        assert white.sd < 0.01 * white.value


def test_curves_agree_with_those_of_the_description(analysed):
    imu, result = analysed
    theory = allan_deviation(imu, result.gyro.tau_s)
    for axis in result.axes:
        ratio = (axis.deviation / theory[axis.kind == "accelerometer"]) ** 2
        # 34 times of 24 curves; walks of points are up to 1 / (2 m^2) above the theory, with their share.
        low, high = (chi2.ppf(tail, axis.edf) / axis.edf for tail in (1e-8, 1.0 - 1e-8))
        assert np.all((ratio > 0.995 * low) & (ratio < 1.005 * high)), axis.name


def test_what_is_written_describes_the_unit_again(analysed, tmp_path):
    from truenorth.sensors.error_file import read_errors

    imu, result = analysed
    found = read_errors(result.write(tmp_path / "errors.toml", imu.grade))
    assert found == result.describe(imu.grade)
    assert found.rate_hz == RATE_HZ
    assert found.gyro_bias_sd_dph == imu.gyro_bias_sd_dph
    for field in ("gyro_random_walk_deg_per_sqrt_h", "accel_random_walk_mps_per_sqrt_h"):
        assert getattr(found, field) == pytest.approx(getattr(imu, field), rel=0.02)
    assert found.accel_bias_instability_ug == pytest.approx(imu.accel_bias_instability_ug, rel=0.5)
