"""Is the stated covariance of position and velocity honest? Monte Carlo with the solver's own weights."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from simulated_sky import navigation, observe
from truenorth.constants import SPEED_OF_LIGHT_MPS
from truenorth.frames import ecef_from_geodetic
from truenorth.observations import frequency_hz
from truenorth.positioning import PointStatus, solve_single_point

PLACE = ecef_from_geodetic(np.radians(-35.0), np.radians(149.0), 600.0)
CLOCK_S = 1e-4
N = 3000
ALARM = 1e-5


@pytest.fixture(scope="module")
def draws():
    """One epoch, `N` times with other noise."""
    nav = navigation()
    one = observe(nav, PLACE, clock_s=CLOCK_S)
    clean = solve_single_point(one, nav)
    rng = np.random.default_rng(20240624)
    rows = np.tile(np.arange(one.n_rows), N)
    # Doppler noise as the documented weights have it: 5 cm/s (1 + 1 / sin^2 el)^(1/2).
    rate_sd_mps = 0.05 * np.sqrt(1.0 + 1.0 / np.sin(clean.satellites.elevation_rad) ** 2)
    doppler_sd_hz = rate_sd_mps * frequency_hz(one.sat, one.signal) / SPEED_OF_LIGHT_MPS
    columns = ("sat", "signal", "phase_cyc", "cn0_dbhz", "lli")
    many = replace(
        one,
        # All at one instant but for a nanosecond, so that the geometry is the same.
        time_ns=one.time_ns[0] + np.arange(N),
        epoch_start=np.arange(N + 1) * one.n_rows,
        code_m=one.code_m[rows] + rng.normal(size=len(rows)) * clean.satellites.code_sd_m[rows],
        doppler_hz=one.doppler_hz[rows] + rng.normal(size=len(rows)) * doppler_sd_hz[rows],
        clock_offset_s=np.full(N, np.nan),
        **{name: getattr(one, name)[rows] for name in columns},
    )
    # No removals, which would cut the tails off.
    return solve_single_point(many, nav, significance=1e-12)


def in_bounds(total, dof):
    """A chi-square total lies in its two-sided interval."""
    return chi2.ppf(ALARM / 2, dof) < total < chi2.isf(ALARM / 2, dof)


def test_residuals_follow_chi_square(draws):
    assert (draws.status == PointStatus.OK).all()
    assert in_bounds(draws.chi2.sum(), draws.dof.sum())
    assert in_bounds(draws.velocity_chi2.sum(), (draws.n_velocity_sats - 4).sum())
    # The share above the 95 % limit is 5 %: binomial, four and a half standard deviations.
    share = np.mean(draws.chi2 > chi2.isf(0.05, draws.dof))
    assert share == pytest.approx(0.05, abs=4.5 * np.sqrt(0.05 * 0.95 / N))


def test_errors_of_position_and_clock_follow_the_covariance(draws):
    error = np.column_stack([draws.position_ecef_m - PLACE, SPEED_OF_LIGHT_MPS * (draws.clock_s - CLOCK_S)])
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(draws.covariance_m2), error)
    assert in_bounds(nees.sum(), 4 * N)
    mean = error.mean(axis=0)
    assert in_bounds(N * mean @ np.linalg.inv(draws.covariance_m2[0]) @ mean, 4)


def test_errors_of_velocity_follow_the_covariance(draws):
    error = np.column_stack([draws.velocity_ecef_mps, SPEED_OF_LIGHT_MPS * draws.clock_drift_sps])
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(draws.velocity_covariance_m2ps2), error)
    assert in_bounds(nees.sum(), 4 * N)


def test_false_alarms_come_at_the_stated_rate(draws):
    nav = navigation()
    one = observe(nav, PLACE, clock_s=CLOCK_S)
    limit = chi2.isf(0.05, draws.dof[0])
    # The solver's test at 5 % removes something, or gives up, in the epochs above the limit only.
    rows = np.tile(np.arange(one.n_rows), 200)
    columns = ("sat", "signal", "phase_cyc", "cn0_dbhz", "lli", "doppler_hz")
    rng = np.random.default_rng(5)
    sd_m = draws.satellites.code_sd_m[: one.n_rows]
    obs = replace(
        one,
        time_ns=one.time_ns[0] + np.arange(200),
        epoch_start=np.arange(201) * one.n_rows,
        code_m=one.code_m[rows] + rng.normal(size=len(rows)) * sd_m[rows],
        clock_offset_s=np.full(200, np.nan),
        **{name: getattr(one, name)[rows] for name in columns},
    )
    lenient = solve_single_point(obs, nav, significance=1e-12)
    strict = solve_single_point(obs, nav, significance=0.05)
    flagged = (strict.n_rejected > 0) | (strict.status == PointStatus.INCONSISTENT)
    assert (flagged == (lenient.chi2 > limit)).all()
    assert flagged.any()
