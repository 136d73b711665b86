"""Laws of the rotating accelerometer that hold for any table, tilt, lean and heading."""

import msgspec
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from moving_bodies import Resting, generators
from truenorth.northfinding import Site
from truenorth.northfinding.turntable import demodulate
from truenorth.northfinding.turntable_fit import fit_harmonic
from truenorth.northfinding.turntable_signal import (
    first_harmonic_mps2,
    heading_from_harmonic_rad,
    heading_jacobian,
    inclination_error_rad,
    table_geometry,
)
from truenorth.sensors import TurntableAccelerometerDescription, simulate_turntable_accelerometer

angle = st.floats(0.0, 2.0 * np.pi, exclude_max=True)
tilt_deg = st.floats(-30.0, 30.0)
mrad = st.floats(-20.0, 20.0)
latitude = st.floats(-80.0, 80.0).map(np.radians)
rpm = st.floats(30.0, 3000.0).flatmap(lambda size: st.sampled_from([size, -size]))


def difference(first, second):
    return float(np.abs(np.mod(first - second + np.pi, 2.0 * np.pi) - np.pi))


@st.composite
def tables(draw):
    """A description, its geometry on a tilted platform, and a heading."""
    sensor = TurntableAccelerometerDescription(
        radius_m=draw(st.floats(0.01, 1.0)),
        table_rpm=draw(rpm),
        tilt_pitch_deg=draw(tilt_deg),
        tilt_roll_deg=draw(tilt_deg),
        axis_error_mrad=(draw(mrad), draw(mrad)),
    )
    platform = tuple(np.radians([draw(tilt_deg), draw(tilt_deg)]))
    return sensor, table_geometry(sensor, Site(draw(latitude)), tilt_rad=platform), draw(angle)


@given(tables())
def test_the_heading_comes_back_from_the_harmonic(table):
    sensor, geometry, heading = table
    rate = sensor.table_rate_radps
    harmonic = first_harmonic_mps2(geometry, rate, heading)
    found, north = heading_from_harmonic_rad(
        geometry, (harmonic - geometry.lean_mps2) / geometry.gain_mps(rate)
    )
    # The lean's share can be 1e4 times the signal, so digits are lost.
    assert difference(found, heading) < 1e-7
    assert 0.0 <= found < 2.0 * np.pi
    np.testing.assert_allclose(north, geometry.north_radps, rtol=1e-7)


@given(tables())
def test_the_jacobian_is_the_slope_of_the_heading(table):
    _, geometry, heading = table
    rate = geometry.rate_plane_radps(heading)
    step = 1e-6 * geometry.north_radps
    slopes = [
        np.sin(
            heading_from_harmonic_rad(geometry, rate + step * side)[0]
            - heading_from_harmonic_rad(geometry, rate - step * side)[0]
        )
        / (2.0 * step)
        for side in np.eye(2)
    ]
    np.testing.assert_allclose(
        heading_jacobian(geometry, heading) * geometry.north_radps,
        np.array(slopes) * geometry.north_radps,
        atol=1e-4,
    )


@given(tables())
def test_reversing_the_table_reverses_the_earth_and_not_the_lean(table):
    sensor, geometry, heading = table
    rate = sensor.table_rate_radps
    one, other = (first_harmonic_mps2(geometry, sign * rate, heading) for sign in (1.0, -1.0))
    lean = geometry.lean_mps2
    earth = geometry.gain_mps(rate) * geometry.rate_plane_radps(heading)
    # But for the Earth's own turn, 1e-5 of the slowest table's.
    np.testing.assert_allclose(0.5 * (one - other), earth, rtol=1e-4, atol=1e-4 * np.linalg.norm(earth))
    np.testing.assert_allclose(0.5 * (one + other), lean, atol=1e-4 * np.linalg.norm(earth))


@given(st.floats(0.0, 1.0), latitude, angle)
def test_the_published_inclination_is_the_exact_one_to_second_order(theta_deg, phi, heading):
    # Rolled about the forward axis, whose azimuth is the heading.
    sensor = TurntableAccelerometerDescription(tilt_roll_deg=theta_deg)
    site = Site(phi)
    rate = table_geometry(sensor, site).rate_plane_radps(heading)
    level = table_geometry(TurntableAccelerometerDescription(), site)
    error = difference(heading_from_harmonic_rad(level, rate)[0], heading)
    theta = np.radians(theta_deg)
    formula = abs(inclination_error_rad(theta, phi, heading))
    # Second order: theta^2 times what the tangent allows.
    assert abs(error - formula) <= 2.0 * (theta / np.cos(phi)) ** 2 + 1e-12


@given(angle, st.floats(-180.0, 180.0), st.sampled_from([600.0, -600.0]), st.integers(8, 60))
def test_both_methods_agree_on_a_clean_record(heading, mark_deg, table_rpm, per_turn):
    # Few samples know the edges of the square waves badly unless these fall symmetrically: four divide them.
    sensor = TurntableAccelerometerDescription(
        noise_mps2=0.0, mark_deg=mark_deg, table_rpm=table_rpm, revolutions=3,
        samples_per_revolution=4 * per_turn,
    )  # fmt: skip
    log = simulate_turntable_accelerometer(
        sensor, Resting(0.7, heading_deg=float(np.degrees(heading))), start_ns=0, duration_s=1.0,
        generator=generators(),
    )  # fmt: skip
    for found in demodulate(sensor, log)[0]:
        assert difference(found, heading) < 1e-4
    alpha = log.columns["table_angle_rad"] + np.radians(mark_deg)
    fit = fit_harmonic(log.time_ns * 1e-9, log.columns["acceleration_mps2"], angle_rad=alpha)
    toward = np.sign(table_rpm) * fit.harmonic_mps2
    assert difference(np.arctan2(-toward[1], toward[0]), heading) < 1e-5


@given(st.floats(0.85, 1.15), angle, st.floats(1e-6, 1e-1))
def test_a_speed_that_is_not_known_is_found(factor, phase, size):
    time = np.arange(1200) * 1e-3
    rate = 2.0 * np.pi * 9.0 * factor
    signal = 9.8 + size * np.cos(rate * time + phase)
    fit = fit_harmonic(time, signal, rate_radps=2.0 * np.pi * 9.0)
    assert abs(fit.rate_radps - rate) < 1e-6 * rate
    # cos(rate t + phase) is h . (cos, -sin) with h at the phase.
    assert difference(np.arctan2(fit.harmonic_mps2[1], fit.harmonic_mps2[0]), phase) < 1e-4


@given(tables())
def test_a_description_may_be_put_level(table):
    sensor, _, heading = table
    flat = msgspec.structs.replace(sensor, tilt_pitch_deg=0.0, tilt_roll_deg=0.0, axis_error_mrad=(0.0, 0.0))
    geometry = table_geometry(flat, Site(0.5))
    toward = first_harmonic_mps2(geometry, abs(flat.table_rate_radps), heading)
    assert difference(np.arctan2(-toward[1], toward[0]), heading) < 1e-12
