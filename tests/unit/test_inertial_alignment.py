"""Inertial-frame alignment: exact where nothing disturbs, hardly moved by sway and bumps, errors apart."""

import numpy as np
import pytest

from shaken_platform import DPH, SITE, STILL, attitude_error, platform, with_errors
from truenorth.errors import ConfigError, NoSolutionError
from truenorth.northfinding import Site
from truenorth.northfinding.budget import accelerometer_sensitivity, gyro_sensitivity
from truenorth.northfinding.inertial import FORMS, align_inertial, estimate_latitude
from truenorth.northfinding.inertial_errors import noise_shapes
from truenorth.northfinding.static import align_static
from truenorth.rotations import rot_ned_from_body
from truenorth.sensors import ImuDescription
from truenorth.simulation.motion import Move, SwayMotion
from truenorth.strapdown import InertialIncrements, compress_increments

DEGREE = np.radians(1.0)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    ("latitude_deg", "angles_deg"),
    [(51.1, (217.0, 3.0, -2.0)), (-33.0, (0.0, 0.0, 0.0)), (0.0, (300.0, -40.0, 170.0))],
)
def test_at_rest_every_form_finds_the_attitude(form, latitude_deg, angles_deg):
    site = Site(np.radians(latitude_deg))
    at_rest = SwayMotion(heading_deg=angles_deg[0], pitch_deg=angles_deg[1], roll_deg=angles_deg[2], **STILL)
    ideal, truth = platform(at_rest, 120.5, 20.0, site)
    found = align_inertial(ideal, site, form=form)
    # Rounding of velocities of 1 km/s limits it; the weighted form is as good as its noise is positive.
    np.testing.assert_allclose(attitude_error(found.rot_ned_from_body, truth), 0.0, atol=2e-7)
    np.testing.assert_allclose(truth, rot_ned_from_body(*np.radians(angles_deg)), atol=1e-12)
    assert found.method == form
    assert found.time_s == pytest.approx(120.5)
    assert found.duration_s == pytest.approx(120.0)
    assert found.measured["gravity_mps2"] == pytest.approx(site.gravity_mps2, rel=1e-9)
    # The estimate after each second, of the attitude then, which does not change.
    np.testing.assert_allclose(found.run.time_s, np.arange(8.5, 121.0))
    heading = np.unwrap(found.run.angles_rad[20:, 0] - np.radians(angles_deg[0]) + 1.0) - 1.0
    np.testing.assert_allclose(np.remainder(heading + 1.0, 2 * np.pi) - 1.0, 0.0, atol=2e-5)


def test_sway_moves_it_little_where_plain_averaging_is_lost():
    ideal, truth = platform()
    errors = {
        form: abs(attitude_error(align_inertial(ideal, SITE, form=form).rot_ned_from_body, truth)[2])
        for form in FORMS
    }
    averaged = align_static(ideal, SITE)
    # Velocities of 20 mm/s, of which a parabola over 120 s takes 60 * 2 / (2 pi 120 s / 1.3 s) at its ends:
    # 4 mm/s over 120 s squared, beside g times the horizontal Earth rate.
    assert errors["velocity-fit"] < 0.04 * DEGREE
    assert errors["weighted"] < 0.04 * DEGREE
    # Velocities at instants have all of it; two alone may be lucky.
    for form in ("gravity-fit", "velocity-differences", "velocity-optimised", "displacement-optimised"):
        assert 10.0 * errors["velocity-fit"] < errors[form] < 3.0 * DEGREE
    assert errors["two-velocities"] < 3.0 * DEGREE
    assert abs(attitude_error(averaged.rot_ned_from_body, truth)[2]) > 3.0 * DEGREE


def test_an_interval_of_a_tenth_says_nearly_the_same():
    ideal, truth = platform()
    fine = align_inertial(ideal, SITE, interval_s=0.1, running=False)
    assert abs(attitude_error(fine.rot_ned_from_body, truth)[2]) < 0.05 * DEGREE
    assert fine.run is None
    # Blocks made beforehand are as good as samples.
    blocks = compress_increments(ideal, 20)
    one, other = (align_inertial(of, SITE, running=False) for of in (ideal, blocks))
    np.testing.assert_allclose(one.rot_ned_from_body, other.rot_ned_from_body, atol=1e-13)


def test_a_bump_counts_less_and_is_reported():
    quiet = SwayMotion(heading_deg=217.0)
    someone_enters = SwayMotion(
        heading_deg=217.0,
        moves=(Move(at_s=20.0, duration_s=3.0, pitch_deg=0.3, roll_deg=0.5, sway_m=0.08, surge_m=0.05),),
    )
    for form in ("velocity-fit", "weighted"):
        calm, bumped = (
            align_inertial(platform(section)[0], SITE, form=form) for section in (quiet, someone_enters)
        )
        error = attitude_error(bumped.rot_ned_from_body, platform(someone_enters)[1])
        assert abs(error[2]) < 0.06 * DEGREE
        assert 2 <= bumped.measured["bumps"] <= 12
        assert bumped.measured["bumps"] > calm.measured["bumps"]
        assert any("count less" in note for note in bumped.notes)
    # Without weights the same bump would turn north by a multiple.
    plain = align_inertial(platform(someone_enters)[0], SITE, form="gravity-fit")
    assert abs(attitude_error(plain.rot_ned_from_body, platform(someone_enters)[1])[2]) > 0.12 * DEGREE


@pytest.mark.parametrize("form", FORMS)
def test_the_last_of_the_run_is_the_result_and_earlier_ones_are_those_of_a_shorter_record(form):
    ideal, _ = platform(SwayMotion(heading_deg=217.0, **STILL))
    noisy = with_errors(ideal, np.random.default_rng(3), gyro_walk=1e-6, accel_walk=1e-4)
    known = ImuDescription(grade="navigation")
    whole = align_inertial(noisy, SITE, form=form, errors=known)
    np.testing.assert_allclose(whole.run.angles_rad[-1], whole.angles_rad, atol=1e-12)
    np.testing.assert_allclose(whole.run.sd_rad[-1], whole.angle_sd_rad, rtol=1e-9)
    batch = align_inertial(noisy, SITE, form=form, errors=known, running=False)
    np.testing.assert_allclose(batch.rot_ned_from_body, whole.rot_ned_from_body, atol=1e-10)
    half = InertialIncrements(noisy.time_s[:1201], noisy.angle_rad[:1200], noisy.velocity_mps[:1200])
    short = align_inertial(half, SITE, form=form, errors=known)
    at = np.flatnonzero(whole.run.time_s == 60.0)[0]
    # The weighted form knows the noise of the whole record; all others do not use it.
    limit = 0.2 * short.angle_sd_rad[0] if form == "weighted" else 1e-3 * short.angle_sd_rad[0]
    np.testing.assert_allclose(whole.run.angles_rad[at], short.angles_rad, atol=max(limit, 1e-9))


def test_responses_to_noise_are_those_of_the_published_weights():
    # 30 u^2 (1 - u)^2, its derivative and its second derivative: integrals of their squares.
    gyro, accelerometer, shaking, start = noise_shapes("velocity-fit")[:, 2, 2]
    assert gyro == pytest.approx(10.0 / 7.0, rel=2e-3)
    assert accelerometer == pytest.approx(120.0 / 7.0, rel=2e-3)
    assert shaking == pytest.approx(720.0, rel=3e-3)
    # The velocity at the start is fitted.
    assert start == pytest.approx(0.0, abs=1e-6)
    # Two velocities weigh the rate by a triangle, 4 min(u, 1 - u), whatever happens in between.
    gyro, accelerometer, shaking, start = noise_shapes("two-velocities")[:, 2, 2]
    assert gyro == pytest.approx(4.0 / 3.0, rel=2e-3)
    assert accelerometer == pytest.approx(16.0, rel=2e-3)
    # V(1) - 2 V(1/2) + V(0), times 4 of each.
    assert shaking == pytest.approx(48.0 * 16.0 * 5.0, rel=2e-3)
    assert start == pytest.approx(16.0, rel=2e-3)
    # All that a rate can be weighed by is at least as noisy as plain averaging.
    for form in FORMS:
        if form != "weighted":
            assert noise_shapes(form)[0, 2, 2] > 1.0


@pytest.mark.parametrize("form", FORMS)
def test_constant_errors_act_as_the_budget_says(form):
    """Gyro and accelerometer biases turn north as in plain averaging; level does not follow the gyros."""
    ideal, truth = platform(SwayMotion(heading_deg=217.0, pitch_deg=3.0, **STILL), 300.0)
    known = ImuDescription(grade="tactical")
    clean = align_inertial(ideal, SITE, form=form, running=False, errors=known).rot_ned_from_body
    by_gyro, by_force = gyro_sensitivity(truth, SITE), accelerometer_sensitivity(truth, SITE)
    for axis in np.eye(3):
        bias = 0.01 * DPH * axis
        biased = with_errors(ideal, np.random.default_rng(0), gyro_bias=bias)
        error = attitude_error(
            align_inertial(biased, SITE, form=form, running=False, errors=known).rot_ned_from_body, clean
        )
        # A second part in a hundred: the bias also tilts, and gravity turns by a degree in five minutes.
        np.testing.assert_allclose(
            error[2], (by_gyro @ bias)[2], atol=0.02 * np.abs(by_gyro).max() * 0.01 * DPH
        )
        if form in ("velocity-fit", "weighted"):
            # The drift over the record is 4e-6 rad; the bend towards east takes it up.
            np.testing.assert_allclose(error[:2], 0.0, atol=4e-7)
        push = 1e-4 * axis
        pushed = with_errors(ideal, np.random.default_rng(0), accel_bias=push)
        error = attitude_error(
            align_inertial(pushed, SITE, form=form, running=False, errors=known).rot_ned_from_body, clean
        )
        np.testing.assert_allclose(error, by_force @ push, atol=0.02 * 1e-4 / 9.8)


def test_the_budget_adds_up_and_names_what_was_seen():
    ideal, _ = platform()
    known = ImuDescription(grade="navigation")
    noisy = with_errors(ideal, np.random.default_rng(3), gyro_walk=6e-7, accel_walk=2e-4)
    for form in FORMS:
        found = align_inertial(noisy, SITE, form=form, errors=known)
        np.testing.assert_allclose(found.budget.cov_ned_rad2, found.cov_ned_rad2, rtol=1e-6, atol=1e-20)
        sources = [line.source for line in found.budget.lines]
        assert len(set(sources)) == len(sources)
        assert {"gyro bias", "accelerometer bias"} < set(sources)
        headings = [found.budget.cov_ned_rad2[2, 2]] + [
            line.cov_ned_rad2[2, 2] for line in found.budget.lines
        ]
        assert headings == sorted(headings, reverse=True)
    unstated = align_inertial(noisy, SITE)
    assert unstated.budget is None
    assert "not stated" in unstated.notes[0]


def test_a_wrong_latitude_shows_and_does_little_harm():
    ideal, truth = platform(SwayMotion(heading_deg=217.0, **STILL), 300.0)
    wrong = Site(SITE.latitude_rad + DEGREE, SITE.longitude_rad, SITE.height_m)
    found = align_inertial(ideal, wrong)
    assert found.measured["latitude_deg"] == pytest.approx(51.1, abs=0.01)
    assert found.measured["horizontal_rate_dph"] == pytest.approx(SITE.horizontal_rate_radps / DPH, abs=2e-3)
    # Level stays exact; of the heading a hundredth of the error goes wrong in five minutes.
    error = attitude_error(found.rot_ned_from_body, truth)
    np.testing.assert_allclose(error[:2], 0.0, atol=2e-6)
    assert abs(error[2]) < 0.02 * DEGREE


@pytest.mark.parametrize("latitude_deg", [51.1, -33.0, 12.0])
def test_the_latitude_follows_from_gravity_alone(latitude_deg):
    site = Site(np.radians(latitude_deg))
    ideal, _ = platform(SwayMotion(heading_deg=120.0, pitch_deg=5.0, **STILL), 300.0, 20.0, site)
    found = estimate_latitude(ideal)
    assert np.degrees(found.latitude_rad) == pytest.approx(latitude_deg, abs=0.01)
    swayed, _ = platform(SwayMotion(heading_deg=120.0), 300.0, 20.0, site)
    found = estimate_latitude(swayed, errors=ImuDescription(grade="navigation"))
    assert abs(found.latitude_rad) == pytest.approx(abs(site.latitude_rad), abs=4.0 * found.latitude_sd_rad)
    assert 1e-5 < found.latitude_sd_rad < 5e-3


def test_what_turns_faster_than_the_earth_has_no_latitude():
    ideal, _ = platform(SwayMotion(heading_deg=120.0, pitch_drift_deg_per_h=30.0, **STILL), 120.0)
    drifted = with_errors(ideal, np.random.default_rng(0), gyro_bias=(0.0, 40.0 * DPH, 0.0))
    with pytest.raises(NoSolutionError, match="as fast as the Earth"):
        estimate_latitude(drifted)


def test_bad_input_is_refused_in_a_sentence():
    ideal, _ = platform()
    with pytest.raises(ConfigError, match="velocity-fit"):
        align_inertial(ideal, SITE, form="best")
    with pytest.raises(ConfigError, match="interval"):
        align_inertial(ideal, SITE, interval_s=0.0)
    with pytest.raises(NoSolutionError, match="at least 8 s"):
        align_inertial(
            InertialIncrements(ideal.time_s[:101], ideal.angle_rad[:100], ideal.velocity_mps[:100]), SITE
        )
    with pytest.raises(NoSolutionError, match="at least"):
        align_inertial(InertialIncrements(np.zeros(1), np.zeros((0, 3)), np.zeros((0, 3))), SITE)
    holes = ideal.angle_rad.copy()
    holes[77, 1] = np.nan
    with pytest.raises(NoSolutionError, match="no numbers"):
        align_inertial(InertialIncrements(ideal.time_s, holes, ideal.velocity_mps), SITE)
    with pytest.raises(NoSolutionError, match="zero throughout"):
        align_inertial(InertialIncrements(ideal.time_s, ideal.angle_rad, 0.0 * ideal.velocity_mps), SITE)
