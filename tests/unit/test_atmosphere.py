"""Atmosphere: published points, and the compiled functions against the readable ones."""

import numpy as np
import pytest

from truenorth._kernels import atmosphere as kernels
from truenorth.constants import SPEED_OF_LIGHT_MPS
from truenorth.orbits.atmosphere import (
    klobuchar_delay_m,
    saastamoinen_delay_m,
    saastamoinen_zenith_delay_m,
    troposphere_mapping,
)

COEFFICIENTS = np.array(
    [1.8626e-8, 2.2352e-8, -1.1921e-7, -5.9605e-8, 1.2902e5, 1.6384e5, -1.9661e5, -2.6214e5]
)


def test_klobuchar_at_night_is_five_nanoseconds_times_the_slant():
    # Zenith at local midnight: F = 1 + 16 * 0.03^3 = 1.000432.
    delay = klobuchar_delay_m(COEFFICIENTS, 0.6, 0.0, 0.0, np.pi / 2, 0.0)
    assert delay == pytest.approx(SPEED_OF_LIGHT_MPS * 5e-9 * 1.000432, rel=1e-9)


def test_klobuchar_peaks_at_fourteen_hours_local_time():
    day_s = np.arange(0, 86_400, 300.0)
    delay = klobuchar_delay_m(COEFFICIENTS, 0.6, np.radians(30.0), 0.0, np.pi / 2, day_s)
    # 30 degrees east is two hours ahead.
    assert day_s[np.argmax(delay)] == pytest.approx(12 * 3600, abs=300)
    assert delay.min() == pytest.approx(1.5, abs=0.01)


def test_klobuchar_clamps_amplitude_and_period():
    coefficients = np.array([-1e-8, 0, 0, 0, 1e3, 0, 0, 0])
    day_s = np.arange(0, 86_400, 600.0)
    delay = klobuchar_delay_m(coefficients, 0.1, 0.0, 0.0, np.pi / 2, day_s)
    assert np.ptp(delay) == 0.0


def test_saastamoinen_at_sea_level_is_two_metres_thirty_dry():
    # Davis et al. 1985: 2.2768 mm/hPa * 1013.25 hPa at 45 degrees latitude.
    assert saastamoinen_zenith_delay_m(np.radians(45), 0.0, humidity=0.0) == pytest.approx(2.3070, abs=2e-4)
    wet = saastamoinen_zenith_delay_m(np.radians(45), 0.0) - 2.3070
    # 17.04 hPa of vapour saturate air of 15 C; 70 % of that gives 12 cm.
    assert wet == pytest.approx(0.0022768 * (1255 / 288.15 + 0.05) * 0.7 * 17.04, abs=1e-3)


def test_mapping_is_one_at_the_zenith_and_about_ten_at_five_degrees():
    assert troposphere_mapping(np.pi / 2) == pytest.approx(1.0, abs=1e-4)
    # Niell 1996 gives 10.15 for the hydrostatic part at 5 degrees.
    assert troposphere_mapping(np.radians(5.0)) == pytest.approx(10.15, rel=0.02)


def test_compiled_functions_equal_the_readable_ones():
    rng = np.random.default_rng(11)
    for _ in range(300):
        lat, lon = rng.uniform(-1.5, 1.5), rng.uniform(-np.pi, np.pi)
        az, el = rng.uniform(0, 2 * np.pi), rng.uniform(0, np.pi / 2)
        height, day_s, humidity = rng.uniform(-1000, 20_000), rng.uniform(0, 86_400), rng.uniform(0, 1)
        assert kernels.klobuchar_delay(COEFFICIENTS, lat, lon, az, el, day_s) == pytest.approx(
            float(klobuchar_delay_m(COEFFICIENTS, lat, lon, az, el, day_s)), rel=1e-12
        )
        slant = kernels.saastamoinen_zenith(lat, height, humidity) * kernels.troposphere_mapping(np.sin(el))
        readable = saastamoinen_delay_m(lat, height, el, humidity=humidity)
        assert slant == pytest.approx(float(readable), rel=1e-12)
