"""Gauss-Krueger: printed coefficients, a quadrature of the meridian, there and back, a misprint."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from truenorth.calibration.gauss_krueger import (
    BESSEL,
    FERRO_DEG,
    WGS84,
    ecef_from_gauss_krueger,
    footpoint_coefficients,
    footpoint_latitude,
    gauss_krueger_from_geodetic,
    gauss_krueger_scale,
    geodetic_from_gauss_krueger,
)

M34_RAD = np.radians(34.0 + FERRO_DEG)


def test_footpoint_coefficients_are_those_of_landfahrers_table_4_1():
    alpha, beta, gamma, delta, epsilon = footpoint_coefficients()
    # To the digits that are printed.
    assert alpha == pytest.approx(6_367_449.1458, abs=5e-5)
    assert beta == pytest.approx(2.51882658e-3, abs=5e-12)
    assert gamma == pytest.approx(3.70095e-6, abs=5e-12)
    assert delta == pytest.approx(7.45e-9, abs=5e-12)
    assert epsilon == pytest.approx(17e-12, abs=5e-13)


@pytest.mark.parametrize("ellipsoid", [WGS84, BESSEL])
def test_the_footpoint_is_where_the_arc_of_the_meridian_ends(ellipsoid):
    a, b = ellipsoid
    e2 = 1.0 - (b / a) ** 2
    for latitude_deg in (-60.0, 5.0, 47.0, 89.0):
        latitude = np.radians(latitude_deg)
        arc_m, _ = quad(
            lambda phi: a * (1.0 - e2) / (1.0 - e2 * np.sin(phi) ** 2) ** 1.5, 0.0, latitude, epsrel=1e-13
        )
        # A hundredth of a millimetre on the ground.
        assert footpoint_latitude(arc_m, ellipsoid) == pytest.approx(latitude, abs=2e-12)


@given(
    latitude_deg=st.floats(-75.0, 75.0), away_deg=st.floats(-3.0, 3.0), meridian_deg=st.floats(-170.0, 170.0)
)
def test_there_and_back(latitude_deg, away_deg, meridian_deg):
    latitude, meridian = np.radians(latitude_deg), np.radians(meridian_deg)
    longitude = meridian + np.radians(away_deg)
    plane = gauss_krueger_from_geodetic(latitude, longitude, meridian)
    back = geodetic_from_gauss_krueger(*plane, meridian)
    # A tenth of a millimetre.
    assert 6.4e6 * abs(back[0] - latitude) < 1e-4
    assert 6.4e6 * np.cos(latitude) * abs(back[1] - longitude) < 1e-4


def test_cos_squared_in_eta_matters_by_what_the_misprint_moves():
    """At x = -67 km and 47 degrees the printed e'^2 cos(phi) moves the longitude by 6e-4 degrees, 49 m."""
    a, b = WGS84
    easting_m = -67_000.0
    _, northing_m = gauss_krueger_from_geodetic(np.radians(47.0), M34_RAD, M34_RAD)
    _, longitude = geodetic_from_gauss_krueger(easting_m, northing_m, M34_RAD)
    phi = footpoint_latitude(northing_m)
    printed = (a * a - b * b) / (b * b) * np.cos(phi)
    radius_m = a * a / (b * np.sqrt(1.0 + printed))
    first_m, third = easting_m / radius_m, -1.0 - 2.0 * np.tan(phi) ** 2 - printed
    misprinted = M34_RAD + (first_m + third * first_m**3 / 6.0) / np.cos(phi)
    off_deg = np.degrees(abs(misprinted - longitude))
    assert off_deg == pytest.approx(6e-4, rel=0.1)
    assert np.radians(off_deg) * radius_m * np.cos(phi) == pytest.approx(49.0, rel=0.05)


def test_scale_at_graz():
    assert np.degrees(M34_RAD) == pytest.approx(16.0 + 20.0 / 60.0)
    assert 1e6 * (gauss_krueger_scale(-67_000.0, np.radians(47.07)) - 1.0) == pytest.approx(55.0, abs=0.5)
    # 0.15 mm of the arm of 2.669 m; by the coordinates themselves.
    _, northing_m = gauss_krueger_from_geodetic(np.radians(47.07), M34_RAD, M34_RAD)
    corners = ecef_from_gauss_krueger(
        np.array([-67_000.0, -67_000.0]), northing_m + np.array([0.0, 2.669]), np.zeros(2), M34_RAD
    )
    shorter_m = 2.669 - np.linalg.norm(corners[1] - corners[0])
    assert shorter_m == pytest.approx(0.147e-3, abs=0.005e-3)
