r"""Errors of inertial-frame alignment: what noise, drifts and biases leave of each form.

Every form is linear in small errors, so its errors follow from its response to pulses along the record: a
small turn of the gyros, a small step of the velocity, a velocity in one interval. With r(u) the response to
a pulse at the share u of the record,

.. math::
    \operatorname{Cov}_{\text{white}} = N^2 T \int r(u)\,r(u)^T du, \qquad
    \operatorname{Cov}_{\text{drift}} = T^2 \iint r(u)\,\rho(u - v)\,r(v)^T du\,dv .

Heading and tilts scale with powers of the duration, so one set of pulses holds for all. Errors that stay
constant turn north as they do in plain averaging (`truenorth.northfinding.budget`).

References
----------
Groves, P. D., Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed. (2013),
sec. 5.6 and 14.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from ..constants import DPH_RADPS, STANDARD_GRAVITY_MPS2, UG_MPS2
from ..rotations import exp_so3
from ..sensors.processes import flicker_components
from .budget import covariance_after, static_budget
from .inertial_forms import FORMS, AlignmentFit, AlignmentProblem, InertialPath, expected_path
from .inertial_noise import VelocityNoise, drift_covariances, ramble_covariance
from .site import Site
from .solution import BudgetLine, ErrorBudget

if TYPE_CHECKING:
    from ..sensors.imu import ImuDescription

__all__ = ["noise_covariances", "noise_shapes", "pulse_responses", "stated_budget"]


SECOND_ORDER_LAG = 0.2
"""Of a turn x by the gyros over a record, the tilt at its end is in error by some 0.2 x^2 (a cubic whose
parabola is fitted)."""

_PULSES = 48
"""Instants at which the response of a form to errors is found."""


def _noise_scales(site: Site, duration_s: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """What unit noises do to tilts and heading, in order of magnitude.

    Shape (4, k, 3): of gyros, accelerometers, shaking, and shaking where the record starts; instant; turn
    about north, east, down.
    """
    g, horizontal, t = site.gravity_mps2, site.horizontal_rate_radps, duration_s
    by_velocity = 1.0 / (g * t)
    tilts = np.stack([np.sqrt(t), by_velocity * np.sqrt(t), by_velocity / np.sqrt(counts), by_velocity])
    heading = tilts / (horizontal * t)
    return np.stack([tilts, tilts, heading], axis=-1)


@lru_cache(maxsize=16)
def pulse_responses(form: str) -> np.ndarray:
    r"""Errors of the attitude by pulses along a record, in units that hold for any duration.

    They are found by trying: a small turn of the gyros, a small step of the velocity, a velocity in one
    interval only. Of a fit of a parabola, with u the instant as a share of the record, the heading follows a
    rate of the east gyro by :math:`30u^2(1-u)^2`, whose square integrates to 10/7: the variance by white
    noise is 1.43 times that of plain averaging. An error of the accelerometers that changes feigns a rate:
    the heading follows it by the derivative of that weight.

    Parameters
    ----------
    form : str
        Of the alignment.

    Returns
    -------
    ndarray, shape (3, k, 2, 3)
        Kind of pulse, instant, axis (north, east); small rotation about north, east, down in units of
        `_response_scales`.
    """
    site, length_s, small = Site(np.radians(45.0)), 240.0, 1e-6
    time_s = np.linspace(0.0, length_s, _PULSES + 1)
    expected = expected_path(site, time_s)
    noise = VelocityNoise(length_s / _PULSES, 1.0, 0.0, 0.0)
    problem = AlignmentProblem(
        expected, expected, np.array([_PULSES]), np.ones(_PULSES), noise, site.gravity_mps2
    )
    to_end = exp_so3(-length_s * site.earth_rate_ned_radps)

    def response(
        velocity: np.ndarray, position: np.ndarray, push: np.ndarray, turn: np.ndarray
    ) -> np.ndarray:
        """Error of the attitude at the end, for one."""
        shaken = InertialPath(
            time_s,
            expected.velocity_mps + small * velocity[:, None] * push,
            expected.position_m + small * position[:, None] * push,
        )
        rot = FORMS[form](problem._replace(felt=shaken)).rot_n0_from_b0[0] @ exp_so3(small * turn)
        error = to_end @ rot @ to_end.T
        return np.array([error[2, 1], error[0, 2], error[1, 0]]) / small

    found = np.zeros((3, _PULSES, 2, 3))
    for k in range(_PULSES):
        since = np.maximum(time_s - 0.5 * (time_s[k] + time_s[k + 1]), 0.0)
        after = (since > 0.0).astype(float)
        for number, axis in enumerate(np.eye(3)[:2]):
            # A turn lets gravity feign a velocity, and stays.
            found[0, k, number] = response(since, 0.5 * since**2, np.cross(axis, site.force_ned_mps2), axis)
            found[1, k, number] = response(after, since, axis, 0.0 * axis)
            pulse = np.diff(after, prepend=0.0)
            found[2, k, number] = response(pulse, length_s / _PULSES * after, axis, 0.0 * axis)
    scales = _response_scales(site, np.array([length_s]))[:, 0]
    return np.asarray(found / scales[:, None, None, :])


def _response_scales(site: Site, duration_s: np.ndarray) -> np.ndarray:
    """What a unit turn, a unit step of the velocity and a unit velocity do to tilts and heading, in size.

    Shape (3, k, 3): kind of pulse, instant, turn about north, east, down.
    """
    g, horizontal, t = site.gravity_mps2, site.horizontal_rate_radps, duration_s
    tilts = np.stack([np.ones_like(t), 1.0 / (g * t), 1.0 / (g * t)])
    return np.stack([tilts, tilts, tilts / (horizontal * t)], axis=-1)


@lru_cache(maxsize=16)
def noise_shapes(form: str) -> np.ndarray:
    """Covariances by white noises, in units that hold for any duration.

    Parameters
    ----------
    form : str
        Of the alignment.

    Returns
    -------
    ndarray, shape (4, 3, 3)
        Of gyros, accelerometers, shaking, and shaking where the record starts, in units of `_noise_scales`.
    """
    found = pulse_responses(form)
    # Of noise over the whole record each pulse has its share of the variance; of shaking, all.
    share = np.array([1.0 / _PULSES, 1.0 / _PULSES, 1.0 * _PULSES])
    shapes = np.einsum("skap,skaq->spq", found, found) * share[:, None, None]
    # An error of the velocity at the start is one of opposite sign in all that follow.
    start = found[2].sum(axis=0)
    return np.concatenate([shapes, (start.T @ start)[None]])


_RATIOS = np.logspace(-6.0, 4.0, 81)
"""Durations over time constants at which drifts are reckoned; between, by interpolation."""


@lru_cache(maxsize=16)
def _drift_shapes(form: str) -> tuple[np.ndarray, np.ndarray]:
    """Covariances by drifts of gyros and forces: unit processes for each of `_RATIOS`, and a unit walk."""
    found = pulse_responses(form)[:2] / _PULSES
    return (
        np.stack([drift_covariances(each, _RATIOS) for each in found]),
        np.stack([ramble_covariance(each) for each in found]),
    )


_DRIFTS = (
    ("gyro bias instability", "gyro_bias_instability_dph", "deg/h"),
    ("rate random walk", "gyro_bias_walk_dph_per_sqrt_h", "deg/h/sqrt(h)"),
    ("accelerometer bias instability", "accel_bias_instability_ug", "ug"),
    ("accelerometer bias walk", "accel_bias_walk_ug_per_sqrt_h", "ug/sqrt(h)"),
)
"""Errors that change slowly, whose weights differ from those of a mean: source, setting, unit."""


def _drift_covariances(form: str, errors: ImuDescription, site: Site, duration_s: np.ndarray) -> np.ndarray:
    """Covariances of the attitude by each of `_DRIFTS`, shape (4, k, 3, 3)."""
    processes, walks = _drift_shapes(form)
    scales = _response_scales(site, duration_s)[:2] * duration_s[:, None]
    lines = np.zeros((len(_DRIFTS), len(duration_s), 3, 3))
    for number, (_, key, _) in enumerate(_DRIFTS):
        sensor = number // 2
        size = getattr(errors, key) * (DPH_RADPS, UG_MPS2)[sensor]
        if number % 2:
            # Stated by square roots of an hour.
            shape = walks[sensor] * (size / 60.0) ** 2 * duration_s[:, None, None]
        else:
            sd, time_constants = flicker_components(size)
            log_ratio = np.log(duration_s[:, None] / time_constants)
            table = processes[sensor].reshape(len(_RATIOS), 9)
            entries = [np.interp(log_ratio, np.log(_RATIOS), column).sum(axis=1) for column in table.T]
            shape = sd**2 * np.stack(entries, axis=-1).reshape(-1, 3, 3)
        lines[number] = scales[sensor][:, :, None] * shape * scales[sensor][:, None, :]
    return lines


def _lag_covariance(form: str, errors: ImuDescription, site: Site, duration_s: np.ndarray) -> np.ndarray:
    """Covariance of the tilts by constant errors of the gyros, shape (k, 3, 3).

    They tilt the frame b0 all along, so level at the end is not that of the mean. The forms that fit all
    bends follow the tilt but for its square.
    """
    force = errors.gyro_g_sensitivity_dph_per_g * site.gravity_mps2 / STANDARD_GRAVITY_MPS2
    turned = np.hypot(errors.gyro_bias_sd_dph, force) * DPH_RADPS * duration_s
    bent = np.minimum(SECOND_ORDER_LAG * turned**2, np.pi / np.sqrt(3.0))
    lag = pulse_responses(form)[0].sum(axis=0)[:, :2] / _PULSES
    # Where north is lost both tilts lag like the worse one; where it is not, neither matters.
    straight = float(np.linalg.norm(lag, 2)) * turned
    cov = np.zeros((len(duration_s), 3, 3))
    cov[:, [0, 1], [0, 1]] = (straight**2 + bent**2)[:, None]
    return cov


def noise_covariances(
    form: str, fit: AlignmentFit, problem: AlignmentProblem, site: Site, shaking_mps: float, start_mps: float
) -> np.ndarray:
    """Covariances of the attitude by noise, after each count of intervals.

    Parameters
    ----------
    form : str
        Of the alignment.
    fit : AlignmentFit
        What it found.
    problem : AlignmentProblem
        What was asked for, with the noise.
    site : Site
        Where.
    shaking_mps, start_mps : float
        Standard deviations of the velocities that the form takes, and of that at the start.

    Returns
    -------
    ndarray, shape (3, k, 3, 3)
        By gyros, accelerometers and shaking; of the weighted form all together, shape (1, k, 3, 3).
    """
    duration = problem.felt.time_s[problem.counts]
    if fit.slope_bend_covariance is not None:
        g, lever = site.gravity_mps2, site.gravity_mps2 * site.horizontal_rate_radps
        cov = fit.slope_bend_covariance
        line = np.zeros((1, len(duration), 3, 3))
        line[0, :, 0, 0] = line[0, :, 1, 1] = cov[:, 0, 0] / g**2
        line[0, :, 2, 2] = cov[:, 1, 1] / lever**2
        line[0, :, 1, 2] = line[0, :, 2, 1] = cov[:, 0, 1] / (g * lever)
        return line
    noise = problem.noise
    sizes = (noise.angle_walk_rad_per_sqrt_s, noise.velocity_walk_mps_per_sqrt_s, shaking_mps, start_mps)
    # Two instants alone stay as noisy however many intervals there are.
    counts = np.full_like(problem.counts, _PULSES) if form == "two-velocities" else problem.counts
    scales = _noise_scales(site, duration, counts) * np.array(sizes)[:, None, None]
    lines = scales[..., :, None] * noise_shapes(form)[:, None] * scales[..., None, :]
    return np.concatenate([lines[:2], lines[2:].sum(axis=0, keepdims=True)])


def _noise_budget(
    form: str, errors: ImuDescription, noise_cov: np.ndarray, noise: VelocityNoise, shaking_mps: float
) -> list[BudgetLine]:
    """Lines of the noise, as stated or as seen."""
    walk = f"{errors.gyro_random_walk_deg_per_sqrt_h:g} deg/sqrt(h)"
    shaking = f"{1e3 * shaking_mps:.2g} mm/s over {noise.interval_s:g} s, as seen"
    stated: tuple[tuple[str, str], ...] = (
        ("angle random walk", walk),
        ("velocity random walk", f"{60.0 * noise.velocity_walk_mps_per_sqrt_s:.2g} m/s/sqrt(h)"),
        ("shaking", shaking),
    )
    if form == "weighted":
        stated = (("angle random walk and shaking", f"{walk}, {shaking}"),)
    return [
        BudgetLine(source, size, cov)
        for (source, size), cov in zip(stated, noise_cov, strict=True)
        if np.any(cov)
    ]


def _drift_budget(errors: ImuDescription, drift_cov: np.ndarray) -> list[BudgetLine]:
    """Lines of what changes slowly."""
    return [
        BudgetLine(source, f"{getattr(errors, key):g} {unit}", cov)
        for (source, key, unit), cov in zip(_DRIFTS, drift_cov, strict=True)
        if np.any(cov)
    ]


def stated_budget(
    form: str,
    errors: ImuDescription,
    rot: np.ndarray,
    site: Site,
    duration_s: np.ndarray,
    noise_cov: np.ndarray,
    noise: VelocityNoise,
    shaking_mps: float,
) -> tuple[ErrorBudget, np.ndarray]:
    """Where the error comes from, and its covariance after each of k durations.

    Parameters
    ----------
    form : str
        Of the alignment.
    errors : ImuDescription
        Errors of the sensor.
    rot : ndarray, shape (3, 3)
        Attitude, north, east, down from body.
    site : Site
        Where.
    duration_s : ndarray, shape (k,)
        Durations; the budget is that of the last.
    noise_cov : ndarray, shape (m, k, 3, 3)
        Of `noise_covariances`.
    noise : VelocityNoise
        The noise.
    shaking_mps : float
        Standard deviation of the velocities that the form takes.

    Returns
    -------
    budget : ErrorBudget
        A line for each source.
    cov_ned_rad2 : ndarray, shape (k, 3, 3)
        Of the small rotation in north, east, down.
    """
    drifts = _drift_covariances(form, errors, site, duration_s)
    lag = _lag_covariance(form, errors, site, duration_s)
    constant = msgspec.structs.replace(errors, **{key: 0.0 for _, key, _ in _DRIFTS})
    lines = [
        *_noise_budget(form, errors, noise_cov[:, -1], noise, shaking_mps),
        *_drift_budget(errors, drifts[:, -1]),
        BudgetLine("tilting by the gyro bias", f"{errors.gyro_bias_sd_dph:g} deg/h", lag[-1]),
        *static_budget(constant, rot, site, float(duration_s[-1]), noise_factor=0.0).lines,
    ]
    lines = [line for line in lines if line.source == "latitude" or np.any(line.cov_ned_rad2)]
    lines.sort(key=lambda line: -float(line.cov_ned_rad2[2, 2]))
    lasting = covariance_after(constant, rot, site, duration_s, noise_factor=0.0)
    return ErrorBudget(tuple(lines), rot), noise_cov.sum(axis=0) + drifts.sum(axis=0) + lag + lasting
