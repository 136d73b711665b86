r"""Inertial-frame alignment of a record: north on a platform that sways and shakes, with its covariance.

The forms and what they rest on are those of `truenorth.northfinding.inertial_forms`. A first fit shows bumps
and noise (`truenorth.northfinding.inertial_noise`), the second is the result; what noise, drifts and biases
leave of it is reckoned by `truenorth.northfinding.inertial_errors`.

``velocity-fit`` is the default: least squares of the constant rotation and the starting velocity over
velocities averaged within seconds, with the estimate after every second from running sums.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..constants import DPH_RADPS, UG_MPS2
from ..errors import ConfigError, NoSolutionError
from ..gravity import EARTH_RATE_RADPS
from ..rotations import exp_so3
from ..strapdown import InertialIncrements, compress_increments
from .budget import wrapped_covariance
from .inertial_errors import noise_covariances, stated_budget
from .inertial_forms import (
    AT_INSTANTS,
    FORMS,
    AlignmentFit,
    AlignmentProblem,
    InertialPath,
    expected_path,
    felt_path,
    velocity_fit,
)
from .inertial_noise import BUMP_SD, VelocityNoise, bump_factors, estimate_noise
from .site import Site
from .solution import NorthRun, NorthSolution

if TYPE_CHECKING:
    from ..sensors.imu import ImuDescription

__all__ = ["FORMS", "align_inertial", "estimate_latitude"]

FEWEST_INTERVALS = 8
"""Rotation, offset and noise need that many."""

LATITUDE_STEPS = 4
"""The first step is nearly exact; the rest takes up the third derivative."""
LAST_LATITUDE_RAD = float(np.radians(89.8))
LATITUDE_SLACK = 0.05
"""How much faster than the Earth noise may make gravity turn at the equator."""


def align_inertial(
    increments: InertialIncrements,
    site: Site,
    *,
    errors: ImuDescription | None = None,
    form: str = "velocity-fit",
    running: bool = True,
    interval_s: float = 1.0,
) -> NorthSolution:
    """North, roll and pitch of a platform that stays in its place but may sway and shake.

    Parameters
    ----------
    increments : InertialIncrements
        What the unit felt, body axes.
    site : Site
        Where.
    errors : ImuDescription, optional
        Errors of the sensor, for covariance and budget. Without them the covariance is that of the noise seen
        in the data alone.
    form : str
        One of `FORMS`. ``weighted`` is up to a fifth better where the noise of the gyros is known or the
        record long; ``velocity-fit`` assumes nothing.
    running : bool
        Whether to keep the estimate after every interval.
    interval_s : float
        Length over which increments are summed and velocities averaged; a few periods of the shaking.

    Returns
    -------
    NorthSolution
        At the end of the record. `measured` holds ``gravity_mps2``, ``residual_mps`` (horizontal, rms, of
        mean velocities, without their bends), ``shaking_mps`` (of one mean), and as seen or stated
        ``gyro_random_walk_deg_per_sqrt_h`` and ``accel_random_walk_mps_per_sqrt_h``; ``bumps`` (intervals
        that count less), and of the first two forms ``horizontal_rate_dph`` and ``latitude_deg``, as the bend
        of the velocity says.

    Raises
    ------
    ConfigError
        If there is no such form, or the interval is not positive.
    NoSolutionError
        If the record is too short or holds no numbers.
    """
    if form not in FORMS:
        raise ConfigError(
            f"the form of the inertial alignment is {form!r}; give one of {', '.join(FORMS)}",
            key="form",
            value=form,
        )
    blocks = _blocks(increments, interval_s)
    felt, rot_b0_from_b = felt_path(blocks)
    number = len(blocks.angle_rad)
    counts = np.arange(FEWEST_INTERVALS, number + 1) if running else np.array([number])
    problem, left = _plain_problem(felt, site)
    problem = problem._replace(counts=counts, noise=_seen_noise(problem, left, errors))
    fit = FORMS[form](problem)
    duration = felt.time_s[counts]
    rot_n_from_n0 = exp_so3(np.multiply.outer(-duration, site.earth_rate_ned_radps))
    attitude = rot_n_from_n0 @ fit.rot_n0_from_b0 @ rot_b0_from_b[counts]
    rot = attitude[-1]

    at_edges = np.diff(felt.velocity_mps @ fit.rot_n0_from_b0[-1].T, n=2, axis=0)[:, :2]
    start = float(np.sqrt(np.mean(at_edges**2) / 6.0))
    shaking = start if form in AT_INSTANTS else problem.noise.shaking_mps
    lines = noise_covariances(form, fit, problem, site, shaking, start)
    cov = lines.sum(axis=0)
    budget = None
    notes: tuple[str, ...] = ()
    if errors is None:
        notes += (
            "The errors of the sensor were not stated: sigma covers only the noise seen in the data; a gyro"
            f" bias of 1 deg/h towards east would turn north by"
            f" {np.degrees(DPH_RADPS / site.horizontal_rate_radps):.2g} deg.",
        )
    else:
        budget, cov = stated_budget(form, errors, rot, site, duration, lines, problem.noise, shaking)
    bumps = int(np.count_nonzero(problem.factors > 1.0))
    if bumps and form in ("velocity-fit", "weighted"):
        notes += (
            f"{bumps} of {number} intervals of {problem.noise.interval_s:g} s were shaken more than the rest,"
            f" the worst {np.sqrt(problem.factors.max()) * BUMP_SD:.0f} times; they count less.",
        )
    cov = wrapped_covariance(rot, cov)
    run = None
    if running:
        run = NorthRun.of_attitudes(blocks.time_s[counts], attitude, cov)
    return NorthSolution(
        method=form,
        site=site,
        time_s=float(blocks.time_s[-1]),
        duration_s=float(duration[-1]),
        rot_ned_from_body=rot,
        cov_ned_rad2=cov[-1],
        measured=_measured(problem, fit, site, left) | {"bumps": float(bumps)},
        run=run,
        budget=budget,
        notes=notes,
    )


def _blocks(increments: InertialIncrements, interval_s: float) -> InertialIncrements:
    """Increments over intervals, the last of which ends with the record."""
    if not interval_s > 0.0:
        raise ConfigError(
            f"the interval of the inertial alignment is {interval_s:g} s; give a positive one",
            key="interval_s",
            value=interval_s,
        )
    available = len(increments.angle_rad)
    step_s = float(np.median(np.diff(increments.time_s))) if available else interval_s
    samples = max(1, round(interval_s / step_s))
    number = available // samples
    if number < FEWEST_INTERVALS:
        raise NoSolutionError(
            f"inertial alignment got {available * step_s:.3g} s of data; give at least"
            f" {FEWEST_INTERVALS * samples * step_s:.3g} s, and minutes for a useful north"
        )
    if not (np.all(np.isfinite(increments.angle_rad)) and np.all(np.isfinite(increments.velocity_mps))):
        raise NoSolutionError("inertial alignment: the record holds values that are no numbers; cut them out")
    if not np.any(increments.velocity_mps):
        raise NoSolutionError(
            "inertial alignment: the accelerometers say zero throughout; check columns and units"
        )
    return compress_increments(increments.part(available - number * samples), samples)


def _plain_problem(felt: InertialPath, site: Site) -> tuple[AlignmentProblem, np.ndarray]:
    """All intervals, bumps marked, noise not known; and what a first fit leaves, shape (n, 3)."""
    number = len(felt.time_s) - 1
    expected = expected_path(site, felt.time_s)
    noise = VelocityNoise(float(np.mean(np.diff(felt.time_s))), 0.0, 0.0, 0.0)
    problem = AlignmentProblem(felt, expected, np.array([number]), np.ones(number), noise, site.gravity_mps2)
    for _ in range(2):
        # Bumps show best where they do not bend the fit.
        rot = velocity_fit(problem).rot_n0_from_b0[0]
        left = felt.mean_velocity_mps @ rot.T - expected.mean_velocity_mps
        problem = problem._replace(factors=bump_factors(left[:, :2]))
    return problem, left


def _seen_noise(problem: AlignmentProblem, left: np.ndarray, errors: ImuDescription | None) -> VelocityNoise:
    """Noise that the residuals show, and the statement says."""
    gyro, accelerometer = (None, 0.0) if errors is None else _stated_walks(errors)
    return estimate_noise(
        left[:, :2],
        problem.noise.interval_s,
        problem.gravity_mps2,
        problem.factors,
        angle_walk_rad_per_sqrt_s=gyro,
        velocity_walk_mps_per_sqrt_s=accelerometer,
    )


def _without_bend(left: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Horizontal residuals without offset, slope and bend, shape (n, 2)."""
    trend = np.vander(np.linspace(-1.0, 1.0, len(left)), 3)
    weight = 1.0 / np.sqrt(factors)[:, None]
    return np.asarray(
        left[:, :2] - trend @ np.linalg.lstsq(weight * trend, weight * left[:, :2], rcond=None)[0]
    )


def _stated_walks(errors: ImuDescription) -> tuple[float, float]:
    """White noise of gyros, rad/sqrt(s), and accelerometers, (m/s)/sqrt(s), with the rounding of rates."""
    gyro, accelerometer = errors.gyro_density_rad_per_sqrt_s, errors.accel_density_mps_per_sqrt_s
    if errors.output == "rates":
        rounding = 1.0 / np.sqrt(12.0 * errors.rate_hz)
        gyro = np.hypot(gyro, np.radians(errors.gyro_resolution_dps) * rounding)
        accelerometer = np.hypot(accelerometer, errors.accel_resolution_ug * UG_MPS2 * rounding)
    return float(gyro), float(accelerometer)


def _measured(problem: AlignmentProblem, fit: AlignmentFit, site: Site, left: np.ndarray) -> dict[str, float]:
    """What the data say of themselves."""
    noise = problem.noise
    felt, expected = (
        path.velocity_mps - path.velocity_mps.mean(axis=0) for path in (problem.felt, problem.expected)
    )
    measured = {
        "gravity_mps2": site.gravity_mps2 * float(np.linalg.norm(felt) / np.linalg.norm(expected)),
        "residual_mps": float(np.sqrt(np.mean(_without_bend(left, problem.factors) ** 2))),
        "shaking_mps": noise.shaking_mps,
        "gyro_random_walk_deg_per_sqrt_h": 60.0 * float(np.degrees(noise.angle_walk_rad_per_sqrt_s)),
        "accel_random_walk_mps_per_sqrt_h": 60.0 * noise.velocity_walk_mps_per_sqrt_s,
    }
    if fit.bend_mps2_per_s is not None:
        horizontal_radps = _horizontal_rate_radps(problem, fit, site)
        measured["horizontal_rate_dph"] = horizontal_radps / DPH_RADPS
        latitude = np.arccos(np.clip(horizontal_radps / EARTH_RATE_RADPS, -1.0, 1.0))
        measured["latitude_deg"] = float(np.degrees(np.copysign(latitude, site.latitude_rad)))
    return measured


def _horizontal_rate_radps(problem: AlignmentProblem, fit: AlignmentFit, site: Site) -> float:
    """Horizontal Earth rate that the bend of the velocity towards east says."""
    assert fit.bend_mps2_per_s is not None  # of the form velocity-fit
    to_middle = exp_so3(-0.5 * problem.felt.time_s[-1] * site.earth_rate_ned_radps)
    bend = to_middle @ fit.bend_mps2_per_s[-1]
    return float(site.horizontal_rate_radps + bend[1] / site.gravity_mps2)


def estimate_latitude(
    increments: InertialIncrements,
    *,
    longitude_rad: float = 0.0,
    height_m: float = 0.0,
    errors: ImuDescription | None = None,
    interval_s: float = 1.0,
) -> Site:
    r"""Latitude from how gravity turns: where the place itself is not known.

    The axis of the Earth is that of gravity's cone and the latitude its angle to the horizontal. The bend of
    the velocity gives its cosine, and thereby nothing near the equator; which hemisphere it is shows in the
    third derivative only, so it takes a record of minutes from good gyros, or the sign is a guess. North of
    `align_inertial` hardly depends on the latitude that it is given; use this to check it.

    Parameters
    ----------
    increments : InertialIncrements
        What the unit felt, body axes.
    longitude_rad, height_m : float
        Passed on.
    errors : ImuDescription, optional
        Errors of the sensor; without them the standard deviation covers noise only.
    interval_s : float
        Over which velocities are averaged.

    Returns
    -------
    Site
        With the latitude found, and its standard deviation.

    Raises
    ------
    NoSolutionError
        If the record is too short, or gravity is not felt to turn as anywhere on the Earth.
    """
    blocks = _blocks(increments, interval_s)
    felt, _ = felt_path(blocks)
    found = []
    for sign in (1.0, -1.0):
        latitude = sign * np.radians(45.0)
        for _ in range(LATITUDE_STEPS):
            site = Site(latitude, longitude_rad, height_m)
            problem, left = _plain_problem(felt, site)
            fit = velocity_fit(problem)
            ratio = _horizontal_rate_radps(problem, fit, site) / EARTH_RATE_RADPS
            latitude = sign * min(float(np.arccos(np.clip(ratio, -1.0, 1.0))), LAST_LATITUDE_RAD)
        misfit = _without_bend(left, problem.factors) ** 2 / problem.factors[:, None]
        found.append((float(np.sum(misfit)), ratio, site, problem, fit, left))
    _, ratio, site, problem, fit, left = min(found, key=lambda row: row[0])
    if not abs(ratio) <= 1.0 + LATITUDE_SLACK:
        raise NoSolutionError(
            f"finding the latitude: gravity was felt to turn {ratio:.3g} times as fast as the Earth; check"
            " that the platform stays in its place, axes and units"
        )
    problem = problem._replace(noise=_seen_noise(problem, left, errors))
    lines = noise_covariances("velocity-fit", fit, problem, site, problem.noise.shaking_mps, 0.0)
    # The bends towards north and east are as noisy: one is the heading, the other the latitude.
    variance = float(lines[:, -1, 2, 2].sum()) * np.cos(site.latitude_rad) ** 2
    if errors is not None:
        biases = np.hypot(errors.gyro_bias_sd_dph, errors.gyro_bias_instability_dph)
        variance += (biases * DPH_RADPS / EARTH_RATE_RADPS) ** 2
    sine = max(abs(np.sin(site.latitude_rad)), np.sqrt(variance) ** 0.5)
    return replace(site, latitude_sd_rad=float(np.sqrt(variance) / sine))
