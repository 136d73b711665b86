"""Sensitivities against errors injected one at a time; the published bound; what a verdict says.

Injection takes half the difference of both signs, so that only odd orders above the first are left: with
errors of 1e-4 of the vector, below 1e-8 of the turn.
"""

import numpy as np
import pytest

from truenorth.northfinding import Site
from truenorth.northfinding.budget import (
    accelerometer_sensitivity,
    covariance_after,
    deflection_sensitivity,
    gyro_sensitivity,
    heading_sd_against_latitude,
    heading_sd_on_circle,
    judge,
    latitude_sensitivity,
    matrix_sensitivity,
    published_bound_rad,
    static_budget,
    wrapped_covariance,
)
from truenorth.northfinding.solution import BudgetLine, ErrorBudget
from truenorth.northfinding.static import align_static
from truenorth.rotations import log_so3, rot_ned_from_body
from truenorth.sensors import ImuDescription
from truenorth.strapdown import InertialIncrements

DPH = np.radians(1.0 / 3600.0)
LATITUDES_DEG = (-62.0, 0.0, 39.0 + 55.0 / 60.0, 80.0)
ATTITUDES_DEG = (
    *((heading, 0.0, roll) for roll in (0.0, -90.0) for heading in (-90.0, 0.0, 90.0, 180.0)),
    (130.0, 15.0, -25.0),
    (250.0, -40.0, 70.0),
)
SILENT = {
    name: 0.0
    for sensor in ("gyro", "accel")
    for name in (
        f"{sensor}_bias_sd_{'dph' if sensor == 'gyro' else 'ug'}",
        f"{sensor}_bias_instability_{'dph' if sensor == 'gyro' else 'ug'}",
        f"{sensor}_random_walk_{'deg' if sensor == 'gyro' else 'mps'}_per_sqrt_h",
        f"{sensor}_bias_walk_{'dph' if sensor == 'gyro' else 'ug'}_per_sqrt_h",
        f"{sensor}_scale_sd_ppm",
        f"{sensor}_misalignment_sd_mrad",
        f"{sensor}_resolution_{'dps' if sensor == 'gyro' else 'ug'}",
    )
} | {"gyro_g_sensitivity_dph_per_g": 0.0}
"""A unit without any error."""


@pytest.fixture(params=[(lat, angles) for lat in LATITUDES_DEG for angles in ATTITUDES_DEG], ids=str)
def case(request):
    latitude, angles = request.param
    return Site(np.radians(latitude)), rot_ned_from_body(*np.radians(angles))


def turned(site, rot, form, rate=0.0, force=0.0, believed=None):
    """Small rotation of the estimate for errors of the means, half the difference of both signs."""

    def one(sign):
        found = align_static(
            InertialIncrements(
                np.arange(2.0),
                (site.earth_rate_ned_radps @ rot + sign * rate)[None],
                (site.force_ned_mps2 @ rot + sign * force)[None],
            ),
            site if believed is None else Site(site.latitude_rad + sign * believed),
            form=form,
            running=False,
        )
        return log_so3(found.rot_ned_from_body @ rot.T)

    return 0.5 * (one(1.0) - one(-1.0))


@pytest.mark.parametrize("form", ["orthonormal", "published"])
def test_sensitivities_to_errors_of_the_axes_are_those_of_injected_ones(case, form):
    site, rot = case
    by_gyro = gyro_sensitivity(rot, site, form=form)
    by_force = accelerometer_sensitivity(rot, site, form=form)
    for k in range(3):
        rate = 1e-4 * site.horizontal_rate_radps * np.eye(3)[k]
        force = 1e-4 * site.gravity_mps2 * np.eye(3)[k]
        np.testing.assert_allclose(turned(site, rot, form, rate=rate), by_gyro @ rate, atol=3e-11)
        # Up to a tangent of 6 in the turn, and its cube in what is left of it.
        np.testing.assert_allclose(turned(site, rot, form, force=force), by_force @ force, atol=1e-9)


def test_scale_misalignment_and_g_sensitivity_act_through_what_the_axis_feels(case):
    site, rot = case
    rate, force = site.earth_rate_ned_radps @ rot, site.force_ned_mps2 @ rot
    by_gyro, by_force = gyro_sensitivity(rot, site), accelerometer_sensitivity(rot, site)
    for j in range(3):
        for k in range(3):
            element = np.zeros((3, 3))
            element[j, k] = 1e-5
            got = turned(site, rot, "orthonormal", rate=element @ rate)
            np.testing.assert_allclose(got, 1e-5 * matrix_sensitivity(by_gyro, rate)[:, j, k], atol=3e-11)
            got = turned(site, rot, "orthonormal", force=element @ force)
            np.testing.assert_allclose(got, 1e-5 * matrix_sensitivity(by_force, force)[:, j, k], atol=3e-11)
            bent = element * site.horizontal_rate_radps / site.gravity_mps2
            said = matrix_sensitivity(by_gyro, force)[:, j, k] * bent[j, k]
            np.testing.assert_allclose(turned(site, rot, "orthonormal", rate=bent @ force), said, atol=3e-11)


def test_latitude_turns_nothing_but_the_north_tilt_of_the_direct_form(case):
    site, rot = case
    assert np.abs(turned(site, rot, "orthonormal", believed=1e-4)).max() < 1e-12
    got = turned(site, rot, "published", believed=1e-4)
    # Another latitude is also another normal gravity, 0.5 per cent from the equator to the pole.
    np.testing.assert_allclose(got, 1e-4 * latitude_sensitivity(form="published"), atol=2e-6)


def test_deflection_of_the_vertical_turns_north_by_laplace(case):
    site, rot = case
    xi, eta = 3e-5, -2e-5
    zenith = np.array([xi, eta, -1.0])
    felt = site.gravity_mps2 * zenith @ rot - site.force_ned_mps2 @ rot
    np.testing.assert_allclose(
        turned(site, rot, "orthonormal", force=felt), deflection_sensitivity(site) @ [xi, eta], atol=1e-10
    )
    assert deflection_sensitivity(site)[2, 1] == pytest.approx(np.tan(site.latitude_rad))


def test_signs_of_a_level_body_towards_north_are_those_of_the_published_model_mended():
    # Oguz (6.19) to (6.21) for a specific force of -g, C_estimated = (I - [phi]) C.
    site = Site(np.radians(40.0))
    rate, force = np.array([0.0, 2e-9, 0.0]), np.array([3e-6, -5e-6, 0.0])
    g, tangent = site.gravity_mps2, np.tan(site.latitude_rad)
    printed = np.array([
        force[1] / g,
        -force[0] / g,
        rate[1] / site.horizontal_rate_radps - force[1] / g * tangent,
    ])  # fmt: skip
    np.testing.assert_allclose(turned(site, np.eye(3), "orthonormal", rate, force), -printed, atol=1e-12)


def test_published_bound():
    # Four decimals are printed.
    with_inputs_of_the_print = np.degrees(published_bound_rad(np.radians(39.0), earth_rate_dph=15.0))
    assert with_inputs_of_the_print == pytest.approx(4.9615, abs=5e-5)
    latitude = np.radians(39.0 + 55.0 / 60.0)
    assert np.degrees(published_bound_rad(latitude)) == pytest.approx(5.0146, abs=5e-5)
    assert np.degrees(published_bound_rad(latitude, rss=True)) == pytest.approx(4.967, abs=5e-4)
    # It is the root of squares of this budget but for the difference of g and standard gravity.
    unit = ImuDescription(**SILENT | {"gyro_bias_sd_dph": 1.0, "accel_bias_sd_ug": 1000.0})
    budget = static_budget(unit, np.eye(3), Site(latitude), 60.0, deflection_sd_rad=0.0)
    assert {line.source for line in budget.lines} == {"gyro bias", "accelerometer bias"}
    assert budget.angle_sd_rad()[0] == pytest.approx(published_bound_rad(latitude, rss=True), rel=1e-4)


def test_lines_add_up_to_the_covariance_after_any_time():
    unit = ImuDescription(
        grade="consumer", mount_deg=(20.0, 10.0, -30.0), gyro_bias_walk_dph_per_sqrt_h=5.0
    )  # fmt: skip
    site, rot = Site(0.7, latitude_sd_rad=1e-3), rot_ned_from_body(1.0, 0.2, -0.4)
    for form in ("orthonormal", "published"):
        after = covariance_after(unit, rot, site, np.array([1.0, 60.0, 3600.0]), form=form)
        for k, time_s in enumerate((1.0, 60.0, 3600.0)):
            budget = static_budget(unit, rot, site, time_s, form=form)
            np.testing.assert_allclose(after[k], budget.cov_ned_rad2, rtol=1e-12)
            heading = [budget.angle_sd_rad(line)[0] for line in budget.lines]
            assert heading == sorted(heading, reverse=True)
            assert "latitude" in {line.source for line in budget.lines}


def test_misalignments_are_those_of_the_axes_of_the_unit():
    unit = ImuDescription(**SILENT | {"accel_scale_sd_ppm": 500.0})
    upright = ImuDescription(**SILENT | {"accel_scale_sd_ppm": 500.0}, mount_deg=(0.0, 0.0, 45.0))
    level = static_budget(unit, np.eye(3), Site(0.7), 60.0, deflection_sd_rad=0.0)
    assert not level.lines  # a level unit has its scale errors along gravity alone
    budget = static_budget(upright, np.eye(3), Site(0.7), 60.0, deflection_sd_rad=0.0)
    # Two axes at 45 degrees, each with 500 ppm of g / sqrt(2), half of it sideways each: 250 sqrt(2) ppm.
    assert np.sqrt(budget.cov_ned_rad2[0, 0]) == pytest.approx(250e-6 * np.sqrt(2.0), rel=1e-9)
    level_twin = static_budget(
        unit, rot_ned_from_body(0.0, 0.0, np.radians(45.0)), Site(0.7), 60.0, deflection_sd_rad=0.0
    )
    np.testing.assert_allclose(budget.cov_ned_rad2, level_twin.cov_ned_rad2, atol=1e-18)


def test_heading_on_the_circle_is_the_spread_of_a_noisy_vector():
    rng = np.random.default_rng(3)
    for sd in (0.05, 0.3, 1.0, 5.0):
        noise = rng.normal(0.0, sd, (2, 200_000))
        angle = np.arctan2(noise[1], 1.0 + noise[0])
        # The sd of 200 000 draws is known to 0.3 per cent at most; five of these.
        assert heading_sd_on_circle(sd) == pytest.approx(np.sqrt(np.mean(angle**2)), rel=0.015)
    assert heading_sd_on_circle(1e-4) == pytest.approx(1e-4)
    assert heading_sd_on_circle(0.0) == 0.0
    assert heading_sd_on_circle(1e9) == pytest.approx(np.pi / np.sqrt(3.0))
    rising = heading_sd_on_circle(np.geomspace(1e-3, 1e4, 500))
    assert np.all(np.diff(rising) >= 0.0)


def test_wrapped_covariance_moves_the_heading_alone():
    rot = rot_ned_from_body(2.0, 0.0, 0.3)
    cov = np.diag([1e-6, 4e-6, 25.0])
    wrapped = wrapped_covariance(rot, cov)
    np.testing.assert_allclose(wrapped[:2, :2], cov[:2, :2])
    assert np.sqrt(wrapped[2, 2]) == pytest.approx(float(heading_sd_on_circle(5.0)))
    small = cov * 1e-8
    np.testing.assert_allclose(wrapped_covariance(rot, small), small, rtol=1e-3)


def test_heading_against_latitude_rises_to_the_pole():
    unit = ImuDescription(grade="tactical")
    latitudes = np.radians([0.0, 40.0, 70.0, 85.0, 89.8])
    linear = heading_sd_against_latitude(unit, np.eye(3), latitudes, 300.0, linear=True)
    circle = heading_sd_against_latitude(unit, np.eye(3), latitudes, 300.0)
    # The gyro rules: 1 / cos but for a little misalignment against the vertical Earth rate.
    np.testing.assert_allclose(linear * np.cos(latitudes), linear[0], rtol=5e-3)
    assert np.all(np.diff(circle) > 0.0)
    assert circle[-1] < np.pi / np.sqrt(3.0)


def verdict(unit, latitude_deg, duration_s, required_deg):
    site = Site(np.radians(latitude_deg))
    budget = static_budget(unit, np.eye(3), site, duration_s)
    return judge(budget, site, duration_s, np.radians(required_deg))


def test_verdict_of_a_sensor_that_cannot():
    unit = ImuDescription(**SILENT | {"gyro_bias_sd_dph": 70.0})
    said = verdict(unit, 39.9, 300.0, 1.0)
    assert said.able is False
    assert "gyro bias of 70 deg/h is 6 times the horizontal Earth rate of 11.5 deg/h" in said.sentence
    assert said.achievable_heading_sd_rad < np.pi / np.sqrt(3.0)
    # However little is demanded: nothing is known of the heading.
    assert verdict(unit, 39.9, 300.0, 179.0).able is False


def test_verdict_tells_what_would_help():
    noisy = ImuDescription(**SILENT | {"gyro_random_walk_deg_per_sqrt_h": 0.01})
    said = verdict(noisy, 39.9, 60.0, 0.1)
    assert said.able is False
    assert "angle random walk of 0.01 deg/sqrt(h)" in said.sentence
    assert "averaging for 15 minutes would do" in said.sentence
    assert verdict(noisy, 39.9, 960.0, 0.1).able is True
    assert verdict(noisy, 39.9, 840.0, 0.1).able is False

    biased = ImuDescription(**SILENT | {"gyro_bias_sd_dph": 1.0, "gyro_random_walk_deg_per_sqrt_h": 0.01})
    said = verdict(biased, 39.9, 600.0, 1.0)
    assert said.able is False
    assert "180 degrees" in said.sentence
    assert "gyro bias of 1 deg/h" in said.sentence

    skewed = ImuDescription(**SILENT | {"gyro_misalignment_sd_mrad": 20.0})
    said = verdict(skewed, 39.9, 600.0, 1.0)
    assert "better sensor" in said.sentence
    assert "most of it by gyro misalignment" in said.sentence


def test_a_record_that_was_turned_is_not_told_to_turn():
    unit = ImuDescription(**SILENT | {"gyro_bias_sd_dph": 1.0})
    site = Site(0.7)
    budget = static_budget(unit, np.eye(3), site, 600.0)
    assert "180 degrees" in judge(budget, site, 600.0, 0.01).sentence
    told = judge(budget, site, 600.0, 0.01, turned=True).sentence
    assert "180 degrees" not in told
    assert "even longer averaging would leave" in told


def test_verdict_of_a_sensor_that_can():
    said = verdict(ImuDescription(grade="navigation"), 39.9, 300.0, 1.0)
    assert said.able is True
    assert "can find north to 0.04 deg (one sigma)" in said.sentence
    assert "angle random walk" in said.sentence
    assert said.achievable_heading_sd_rad == pytest.approx(np.radians(0.0403), rel=0.01)


def test_longer_averaging_does_not_help_where_the_bias_walks():
    unit = ImuDescription(
        **SILENT | {"gyro_random_walk_deg_per_sqrt_h": 0.02, "gyro_bias_walk_dph_per_sqrt_h": 3.0}
    )
    assert "averaging for" not in verdict(unit, 39.9, 300.0, 0.1).sentence


def test_verdict_without_errors_and_with_the_nose_up():
    site = Site(0.7)
    nothing = judge(ErrorBudget((), np.eye(3)), site, 60.0, 0.01)
    assert nothing.able is True
    assert nothing.achievable_heading_sd_rad == 0.0
    up = rot_ned_from_body(0.3, np.pi / 2.0, 0.0)
    line = BudgetLine("gyro bias", "1 deg/h", np.diag([0.0, 0.0, 1e-4]))
    assert judge(ErrorBudget((line,), up), site, 60.0, 0.02).able is True
