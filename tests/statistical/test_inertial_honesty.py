"""Inertial-frame alignment is as good as it says: errors of many draws against their stated covariance."""

import msgspec
import numpy as np
import pytest
from scipy.stats import chi2

from shaken_platform import DPH, SITE, STILL, attitude_error, platform, with_errors
from truenorth.northfinding.inertial import FORMS, align_inertial
from truenorth.sensors import ImuDescription
from truenorth.simulation.motion import SwayMotion

DRAWS = 25
UG = 1e-6 * 9.80665

# What is drawn below and no more: no scale errors, misalignments, instabilities.
QUIET = dict.fromkeys(
    (
        "gyro_bias_instability_dph", "gyro_scale_sd_ppm", "gyro_misalignment_sd_mrad",
        "gyro_g_sensitivity_dph_per_g", "gyro_resolution_dps", "accel_bias_instability_ug",
        "accel_scale_sd_ppm", "accel_misalignment_sd_mrad", "accel_resolution_ug",
    ),
    0.0,
)  # fmt: skip
# Accelerometer biases far above the deflection of the vertical that the budget assumes and nobody draws.
UNIT = ImuDescription(
    grade="navigation", gyro_bias_sd_dph=0.02, gyro_random_walk_deg_per_sqrt_h=0.003, accel_bias_sd_ug=500.0,
    accel_random_walk_mps_per_sqrt_h=0.02, **QUIET,
)  # fmt: skip
AT_REST = SwayMotion(heading_deg=217.0, pitch_deg=3.0, roll_deg=-2.0, **STILL)
SHAKEN = SwayMotion(heading_deg=217.0, pitch_deg=3.0, roll_deg=-2.0)


def drawn(ideal, unit, seed):
    """Increments of the unit in one run."""
    rng = np.random.default_rng(seed)
    return with_errors(
        ideal, rng,
        gyro_walk=np.radians(unit.gyro_random_walk_deg_per_sqrt_h) / 60.0,
        accel_walk=unit.accel_random_walk_mps_per_sqrt_h / 60.0,
        gyro_bias=unit.gyro_bias_sd_dph * DPH * rng.standard_normal(3),
        accel_bias=unit.accel_bias_sd_ug * UG * rng.standard_normal(3),
    )  # fmt: skip


def squared_errors(section, unit, form, *, stated=True):
    """Squared normalised errors of the attitude and of the heading, of each draw."""
    ideal, truth = platform(section, 240.0, 5.0 if section is AT_REST else 10.0)
    rows = []
    for seed in range(DRAWS):
        found = align_inertial(
            drawn(ideal, unit, seed), SITE, form=form, errors=unit if stated else None, running=False
        )
        error, cov = attitude_error(found.rot_ned_from_body, truth), found.cov_ned_rad2
        rows.append((error @ np.linalg.solve(cov, error), error[2] ** 2 / cov[2, 2]))
    return np.array(rows).T


def is_within(squares, freedom, alarm=1e-5):
    """Whether the sum of chi-squared numbers is one that chance may bring, two-sided."""
    freedom *= len(squares)
    return chi2.ppf(alarm, freedom) < np.sum(squares) < chi2.isf(alarm, freedom)


@pytest.mark.parametrize("form", FORMS)
def test_errors_are_as_large_as_stated_at_rest(form):
    whole, heading = squared_errors(AT_REST, UNIT, form)
    assert is_within(whole, 3), whole.mean()
    assert is_within(heading, 1), heading.mean()


@pytest.mark.parametrize("form", ["velocity-fit", "weighted"])
def test_errors_are_as_large_as_stated_on_a_shaken_platform(form):
    whole, heading = squared_errors(SHAKEN, UNIT, form)
    assert is_within(whole, 3), whole.mean()
    assert is_within(heading, 1), heading.mean()


@pytest.mark.parametrize("form", ["velocity-fit", "weighted"])
@pytest.mark.parametrize("walk_deg_per_sqrt_h", [0.0005, 0.05])
def test_noise_alone_is_told_from_the_data(form, walk_deg_per_sqrt_h):
    """Without stated errors; four minutes tell a random walk to a factor only, so the bounds are wide."""
    noisy = msgspec.structs.replace(
        UNIT, gyro_bias_sd_dph=0.0, accel_bias_sd_ug=0.0, gyro_random_walk_deg_per_sqrt_h=walk_deg_per_sqrt_h
    )
    _, heading = squared_errors(AT_REST, noisy, form, stated=False)
    assert 0.3 < np.mean(heading) < 3.0


def test_the_weighted_form_is_the_best_for_a_noisy_gyro():
    """Its error is that of plain averaging, a sixth below that of the unweighted fit."""
    noisy = msgspec.structs.replace(
        UNIT, gyro_bias_sd_dph=0.0, accel_bias_sd_ug=0.0, gyro_random_walk_deg_per_sqrt_h=0.05
    )
    ideal, truth = platform(AT_REST, 240.0, 5.0)
    error = {form: [] for form in ("velocity-fit", "weighted")}
    for seed in range(40):
        for form, rows in error.items():
            found = align_inertial(drawn(ideal, noisy, seed), SITE, form=form, errors=noisy, running=False)
            rows.append(attitude_error(found.rot_ned_from_body, truth)[2])
    plain, weighted = (np.sqrt(np.mean(np.square(rows))) for rows in error.values())
    averaging = np.radians(0.05) / 60.0 / np.sqrt(240.0) / SITE.horizontal_rate_radps
    assert weighted < 0.97 * plain
    assert is_within(np.square(error["weighted"]) / averaging**2, 1)
    assert is_within(np.square(error["velocity-fit"]) / (10.0 / 7.0 * averaging**2), 1)


def test_level_is_honest_where_the_gyros_are_too_bad_for_north():
    """Biases of 70 deg/h turn the inertial frame by six degrees, and the level of velocity-fit not at all."""
    bad = msgspec.structs.replace(UNIT, gyro_bias_sd_dph=70.0)
    ideal, truth = platform(AT_REST, 240.0, 5.0)
    for form in ("velocity-fit", "velocity-optimised"):
        tilts = []
        for seed in range(12):
            found = align_inertial(drawn(ideal, bad, seed), SITE, form=form, errors=bad, running=False)
            error, sd = attitude_error(found.rot_ned_from_body, truth), np.sqrt(np.diag(found.cov_ned_rad2))
            tilts.append((np.hypot(*error[:2]), np.hypot(*sd[:2])))
            assert sd[2] > 1.0
        size, stated = np.sqrt(np.mean(np.square(tilts), axis=0))
        # North errors of any size turn the axes of the tilts; their length stays.
        assert size < 1.5 * stated
        if form == "velocity-fit":
            assert size < np.radians(0.4)
