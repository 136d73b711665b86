"""Inertial increments: they return to the truth, and they are the integrals they are said to be."""

import numpy as np
import pytest

from motions import KINDS, LATITUDE_RAD, LONGITUDE_RAD, trajectory
from truenorth.frames import ecef_from_geodetic, geodetic_from_ecef, rot_ned_from_ecef
from truenorth.gravity import (
    EARTH_RATE_RADPS,
    gravitation_ecef_mps2,
    gravity_ecef_mps2,
    normal_gravity_mps2,
)
from truenorth.rotations import exp_so3, log_so3
from truenorth.strapdown import (
    InertialIncrements,
    integrate_increments,
    rate_inertial_body_radps,
    reference_increments,
    specific_force_body_mps2,
)


def dead_reckoning(moving, time_s, *, second=True):
    """Increments integrated from the true start: largest errors of position, velocity and attitude."""
    increments = reference_increments(moving, time_s)
    if not second:
        increments = InertialIncrements(increments.time_s, increments.angle_rad, increments.velocity_mps)
    truth = moving.at(time_s)
    states = integrate_increments(
        increments, truth.position_ecef_m[0], truth.velocity_ecef_mps[0], truth.rot_ecef_from_body[0]
    )
    turned = np.swapaxes(truth.rot_ecef_from_body, -1, -2) @ states.rot_ecef_from_body
    return (
        np.max(np.abs(states.position_ecef_m - truth.position_ecef_m)),
        np.max(np.abs(states.velocity_ecef_mps - truth.velocity_ecef_mps)),
        np.max(np.abs(log_so3(turned))),
    )


@pytest.mark.parametrize("kind", KINDS)
def test_integration_returns_to_the_truth(kind):
    # Ten minutes at 10 Hz. All is rounding: a double holds the Earth's radius to a nanometre.
    position, velocity, attitude = dead_reckoning(trajectory(kind, 600.0), np.arange(6001) * 0.1)
    assert position < 1e-6
    assert velocity < 1e-8
    assert attitude < 1e-11


def test_any_interval_returns_to_the_truth():
    moving = trajectory("suburban", 600.0)
    uneven = np.cumsum(np.random.Generator(np.random.PCG64(5)).uniform(0.001, 1.5, 700))
    position, velocity, attitude = dead_reckoning(moving, uneven)
    assert position < 1e-6
    assert velocity < 1e-8
    assert attitude < 1e-11


def test_without_second_integrals_the_position_error_does_not_grow():
    time_s = np.arange(60_00 + 1) * 0.01
    position, velocity, attitude = dead_reckoning(trajectory("circuit", 600.0), time_s, second=False)
    # T^2 / 12 times the change of the acceleration, at most 6 m/s^2.
    assert 1e-8 < position < 1e-4 / 12.0 * 6.0
    assert velocity < 1e-7
    assert attitude < 1e-11


def integrals(moving, start, interval, n_cells=40):
    """Integrals of instantaneous rate and force over an interval, in the body axes of its start.

    The rotation by Magnus' expansion of fourth order over two Gauss nodes a cell, the force by Gauss-Legendre
    quadrature with the true attitudes: neither positions nor velocities are in it.
    """
    cell = interval / n_cells
    begin = start + cell * np.arange(n_cells)[:, None]
    node, weight = np.polynomial.legendre.leggauss(2)
    rates = rate_inertial_body_radps(moving.at((begin + 0.5 * cell * (1.0 + node)).ravel())).reshape(-1, 2, 3)
    rot = np.eye(3)
    for first, second in rates:
        rot = rot @ exp_so3(
            0.5 * cell * (first + second) + np.sqrt(3.0) / 12.0 * cell**2 * np.cross(first, second)
        )
    node, weight = np.polynomial.legendre.leggauss(4)
    since = (cell * np.arange(n_cells)[:, None] + 0.5 * cell * (1.0 + node)).ravel()
    weights = np.tile(0.5 * cell * weight, n_cells)
    motion = moving.at(start + since)
    earth = exp_so3(since[:, None] * np.array([0.0, 0.0, EARTH_RATE_RADPS]))
    carried = moving.at(np.array([start])).rot_ecef_from_body[0].T @ earth @ motion.rot_ecef_from_body
    force = np.einsum("nij,nj->ni", carried, specific_force_body_mps2(motion))
    return log_so3(rot), weights @ force, (weights * (interval - since)) @ force


@pytest.mark.parametrize("kind", ["turntable", "sway", "circle", "suburban", "ship", "aircraft", "table"])
def test_increments_are_the_integrals_of_rate_and_force(kind):
    moving = trajectory(kind, 300.0)
    interval = 0.1
    starts = np.array([12.3, 77.7, 140.05, 233.3])
    for start in starts:
        increments = reference_increments(moving, np.array([start, start + interval]))
        angle, velocity, position = integrals(moving, start, interval)
        # The differences of positions of 6e6 m are known to 1e-9 m, those of velocities of 5e2 m/s to 1e-13.
        assert increments.angle_rad[0] == pytest.approx(angle, abs=1e-9)
        assert increments.velocity_mps[0] == pytest.approx(velocity, abs=1e-9)
        assert increments.position_m[0] == pytest.approx(position, abs=5e-9)


def test_earth_rate_of_a_platform_at_rest():
    motion = trajectory("static", 10.0).at(np.array([1.0]))
    ned = rot_ned_from_ecef(LATITUDE_RAD, LONGITUDE_RAD) @ motion.rot_ecef_from_body[0]
    rate = ned @ rate_inertial_body_radps(motion)[0]
    north, down = np.cos(LATITUDE_RAD), -np.sin(LATITUDE_RAD)
    assert rate == pytest.approx(EARTH_RATE_RADPS * np.array([north, 0.0, down]), abs=1e-18)
    force = ned @ specific_force_body_mps2(motion)[0]
    # The plumb line curves with height by some 1e-6 rad a kilometre; down is that of the ellipsoid.
    assert np.abs(force[:2]) == pytest.approx([0.0, 0.0], abs=2e-5)


def test_gravity_on_the_ellipsoid_is_somiglianas():
    latitude = np.radians(np.linspace(-90.0, 90.0, 37))
    position = ecef_from_geodetic(latitude, 0.7, 0.0)
    ned = np.einsum("nij,nj->ni", rot_ned_from_ecef(latitude, 0.7), gravity_ecef_mps2(position))
    # The constants of the formula have ten digits; the rates of IS-GPS-200 and of WGS 84 differ by 2e-9.
    assert ned[:, 2] == pytest.approx(normal_gravity_mps2(latitude), abs=2e-9)
    assert np.max(np.abs(ned[:, :2])) < 1e-8
    # NGA.STND.0036, table 3.5 and 3.6: at the equator and at the poles.
    assert ned[18, 2] == pytest.approx(9.7803253359, abs=2e-9)
    assert ned[0, 2] == pytest.approx(9.8321849379, abs=2e-9)


def test_gravity_above_the_ellipsoid():
    # The series in height of NGA.STND.0036 (4-3), good to a few 1e-7 at 10 km.
    latitude, height = np.radians(45.0), np.array([-100.0, 1000.0, 10_000.0])
    position = ecef_from_geodetic(latitude, -1.0, height)
    size = np.linalg.norm(gravity_ecef_mps2(position), axis=1)
    a, flattening, m = 6378137.0, 1.0 / 298.257223563, 0.00344978650684
    series = (
        1.0 - 2.0 / a * (1.0 + flattening + m - 2.0 * flattening * 0.5) * height + 3.0 * (height / a) ** 2
    )
    assert size == pytest.approx(normal_gravity_mps2(latitude) * series, abs=5e-7)


def test_gravitation_is_a_field_without_sources():
    # Laplace: no divergence; and no curl. Differences over 1 km of a field whose gradients are 3e-6 /s^2.
    point = ecef_from_geodetic(np.radians(33.0), 2.0, 5000.0)
    step = 1000.0
    gradient = np.array(
        [
            (gravitation_ecef_mps2(point + step * axis) - gravitation_ecef_mps2(point - step * axis))
            / (2.0 * step)
            for axis in np.eye(3)
        ]
    )
    assert abs(np.trace(gradient)) < 1e-12
    assert np.max(np.abs(gradient - gradient.T)) < 1e-12


def test_gravity_far_away_is_that_of_a_point():
    far = np.array([3e8, 4e8, 1e8])
    distance = np.linalg.norm(far)
    # The flattening adds some J2 (a / r)^2, 2e-7 of it.
    point = -3.986004418e14 * far / distance**3
    assert gravitation_ecef_mps2(far) == pytest.approx(point, rel=1e-6, abs=0.0)


def test_height_is_kept_by_a_free_fall_orbit():
    # A circular orbit over the equator without force: the increments of nothing keep it a circle.
    radius = 7.0e6
    gravitation = np.linalg.norm(gravitation_ecef_mps2(np.array([radius, 0.0, 0.0])))
    rate = np.sqrt(gravitation / radius)
    time_s = np.arange(0.0, 601.0, 1.0)
    nothing = np.zeros((600, 3))
    velocity = np.array([0.0, radius * (rate - EARTH_RATE_RADPS), 0.0])
    states = integrate_increments(
        InertialIncrements(time_s, nothing, nothing), np.array([radius, 0.0, 0.0]), velocity, np.eye(3)
    )
    angle = (rate - EARTH_RATE_RADPS) * time_s[-1]
    expected = radius * np.array([np.cos(angle), np.sin(angle), 0.0])
    # Gravitation is taken as linear over a second: its curvature, g n^2 T^2 / 12, is 1e-6 of it.
    assert states.position_ecef_m[-1] == pytest.approx(expected, abs=0.2)
    assert geodetic_from_ecef(states.position_ecef_m[-1])[2] == pytest.approx(radius - 6378137.0, abs=0.2)
