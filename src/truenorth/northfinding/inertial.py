r"""Inertial-frame alignment: north from how gravity turns, on a platform that sways and shakes.

Freeze two frames at the start of the record: b0, the body as it stood then, and n0, north, east, down of
then. Both stay fixed against the stars. The gyros carry the body against b0 however it is shaken, the
Earth's rotation carries north against n0, and what remains between is one constant rotation C:

.. math:: C^n_b(t) = C^{n}_{n_0}(t)\; C\; C^{b_0}_b(t), \qquad C = C^{n_0}_{b_0}.

The specific force integrated in b0 is, but for the velocity of the shaking itself, which stays small, the
reaction to gravity integrated in n0; gravity draws a cone there, about the axis of the Earth:

.. math::
    V_b(t) = \int_0^t C^{b_0}_b f\,d\tau, \qquad
    V_n(t) = \int_0^t C^{n_0}_{n} f^n d\tau, \qquad
    C\,V_b(t) = V_n(t) + c + \text{disturbance}(t).

The constant c is the velocity of the body at the start. The forms differ in how they find C:

=======================  ====================================================================================
velocity-fit             least squares of C and c over velocities averaged within intervals of a second,
                         where shaking averages out; bumps count less
weighted                 the same, generalised: noise of gyros and accelerometers is weighed against the
                         shaking (`truenorth.northfinding.inertial_noise`)
gravity-fit              gravity in both frames by fitting V with a parabola, as it is at both ends
velocity-differences     all differences of V over half the record
velocity-optimised       all V, c left out (Wu et al. 2011)
displacement-optimised   all integrals of V, c left out
two-velocities           V at half time and at the end, c left out (Qin et al. 2005)
=======================  ====================================================================================

All reduce to Wahba's problem, the rotation closest to sum V_n V_b^T, which singular values solve; sums run
on, so the estimate after every interval costs no more than the last. Eliminating c is subtracting means, and
generalised least squares is Wahba's problem of whitened velocities. A scale error common to all axes turns
nothing.

The rotation has one parameter for two bends of V: that towards north gives the heading, that towards east is
known (the horizontal Earth rate), and what is left of it says that the latitude or the gyro towards north is
wrong. The first two forms fit it too, so that roll and pitch at the end of the record do not suffer, and
report it.

References
----------
Qin, Y., Yan, G., Gu, D., Zheng, J., "A clever way of SINS coarse alignment despite rocking ship", Journal of
Northwestern Polytechnical University 23 (2005) 681-684.
Wu, M., Wu, Y., Hu, X., Hu, D., "Optimization-based alignment for inertial navigation systems: theory and
algorithm", Aerospace Science and Technology 15 (2011) 1-17.
Kabsch, W., "A solution for the best rotation to relate two sets of vectors", Acta Crystallographica A32
(1976) 922-923.
Groves, P. D., Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed. (2013),
sec. 5.6.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np

from ..attitude.vectors import angle_covariance
from ..errors import ConfigError, NoSolutionError
from ..gravity import EARTH_RATE_RADPS
from ..rotations import exp_so3, heading_pitch_roll
from ..sensors.processes import flicker_components
from ..strapdown import InertialIncrements, compress_increments
from .budget import covariance_after, static_budget, wrapped_covariance
from .inertial_noise import (
    BUMP_SD,
    VelocityNoise,
    bump_factors,
    drift_covariances,
    estimate_noise,
    ramble_covariance,
    walk_covariance,
    whiten,
)
from .site import Site
from .solution import BudgetLine, ErrorBudget, NorthRun, NorthSolution

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

_DPH = np.pi / 180.0 / 3600.0
_UG = 1e-6 * 9.80665


@dataclass(frozen=True, slots=True, eq=False)
class _Path:
    """What a specific force integrates to in a frame fixed against the stars; all zero at the start.

    Parameters
    ----------
    time_s : ndarray, shape (n + 1,)
        Edges of the intervals, from the start.
    velocity_mps, position_m : ndarray, shape (n + 1, 3)
        First and second integral at the edges.
    """

    time_s: np.ndarray
    velocity_mps: np.ndarray
    position_m: np.ndarray

    @property
    def mean_velocity_mps(self) -> np.ndarray:
        """ndarray, shape (n, 3): Over each interval."""
        return np.diff(self.position_m, axis=0) / np.diff(self.time_s)[:, None]


class _Problem(NamedTuple):
    """What every form is given."""

    felt: _Path
    """In b0."""
    expected: _Path
    """In n0."""
    counts: np.ndarray
    """After how many intervals the rotation is wanted, shape (k,)."""
    factors: np.ndarray
    """How much the variance of each interval exceeds the usual, shape (n,)."""
    noise: VelocityNoise
    """Of the mean velocities."""
    gravity_mps2: float


class _Fit(NamedTuple):
    """What a form finds after each of k counts."""

    rot_n0_from_b0: np.ndarray
    """Shape (k, 3, 3)."""
    bend_mps2_per_s: np.ndarray | None = None
    """What is left of the curvature of V in n0, shape (k, 3)."""
    slope_bend_covariance: np.ndarray | None = None
    """Of slope at the end and curvature along one horizontal axis, shape (k, 2, 2)."""


def _felt_path(blocks: InertialIncrements) -> tuple[_Path, np.ndarray]:
    """What the unit felt, in b0, and the attitude of the body against b0 at the edges."""
    turn = exp_so3(blocks.angle_rad)
    rot = np.empty((len(turn) + 1, 3, 3))
    rot[0] = np.eye(3)
    for k in range(len(turn)):
        rot[k + 1] = rot[k] @ turn[k]
    assert blocks.position_m is not None  # compressed increments always have it
    time_s = blocks.time_s - blocks.time_s[0]
    gained = np.einsum("nij,nj->ni", rot[:-1], blocks.velocity_mps)
    velocity = _from_zero(np.cumsum(gained, axis=0))
    moved = np.einsum("nij,nj->ni", rot[:-1], blocks.position_m) + velocity[:-1] * np.diff(time_s)[:, None]
    return _Path(time_s, velocity, _from_zero(np.cumsum(moved, axis=0))), rot


def _expected_path(site: Site, time_s: np.ndarray) -> _Path:
    """What a unit at rest on the turning Earth feels, in n0."""
    rate = EARTH_RATE_RADPS
    axis = site.earth_rate_ned_radps / rate
    along = axis * (axis @ site.force_ned_mps2)
    across = site.force_ned_mps2 - along
    ahead = np.cross(axis, across)
    t = time_s[:, None]
    angle = rate * t
    sine, versine = np.sin(angle), 2.0 * np.sin(0.5 * angle) ** 2
    velocity = along * t + (across * sine + ahead * versine) / rate
    position = 0.5 * along * t**2 + (across * versine + ahead * (angle - sine)) / rate**2
    return _Path(time_s, velocity, position)


def _from_zero(rows: np.ndarray) -> np.ndarray:
    """Rows after one of zeros."""
    return np.concatenate([np.zeros((1, *rows.shape[1:])), rows])


def _sums(rows: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Sums of the first so many rows, for each count."""
    return np.cumsum(rows, axis=0)[counts - 1]


def _products(a: np.ndarray, b: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Sums of a b^T over the first so many rows, for each count."""
    return _sums(a[:, :, None] * b[:, None, :], counts)


def _closest_rotation(profile: np.ndarray) -> np.ndarray:
    """Rotations that solve Wahba's problem: the largest trace of their product with the profile sum r b^T."""
    u, _, vt = np.linalg.svd(profile)
    u[..., 2] *= (np.linalg.det(u) * np.linalg.det(vt))[..., None]
    return np.asarray(u @ vt)


def _triad(first_r: np.ndarray, then_r: np.ndarray, first_b: np.ndarray, then_b: np.ndarray) -> np.ndarray:
    """Rotations that take the first vector of b to that of r exactly, and the plane with the second."""

    def axes(first: np.ndarray, then: np.ndarray) -> np.ndarray:
        x = first / np.linalg.norm(first, axis=-1, keepdims=True)
        z = np.cross(first, then)
        z = z / np.linalg.norm(z, axis=-1, keepdims=True)
        return np.stack([x, np.cross(z, x), z], axis=-1)

    return np.asarray(axes(first_r, then_r) @ np.swapaxes(axes(first_b, then_b), -1, -2))


def _two_velocities(problem: _Problem) -> _Fit:
    half, last = problem.counts // 2, problem.counts
    r, b = problem.expected.velocity_mps, problem.felt.velocity_mps
    return _Fit(_triad(r[last], r[half], b[last], b[half]))


def _velocity_optimised(problem: _Problem) -> _Fit:
    r, b = problem.expected.velocity_mps[1:], problem.felt.velocity_mps[1:]
    return _Fit(_closest_rotation(_products(r, b, problem.counts)))


def _displacement_optimised(problem: _Problem) -> _Fit:
    r, b = problem.expected.position_m[1:], problem.felt.position_m[1:]
    return _Fit(_closest_rotation(_products(r, b, problem.counts)))


def _velocity_differences(problem: _Problem) -> _Fit:
    r, b = problem.expected.velocity_mps, problem.felt.velocity_mps
    profile = np.empty((len(problem.counts), 3, 3))
    for k, count in enumerate(problem.counts):
        lag = count // 2
        profile[k] = (r[lag : count + 1] - r[: count + 1 - lag]).T @ (
            b[lag : count + 1] - b[: count + 1 - lag]
        )
    return _Fit(_closest_rotation(profile))


def _gravity_fit(problem: _Problem) -> _Fit:
    time_s = problem.felt.time_s
    powers = np.stack([np.ones_like(time_s), time_s, 0.5 * time_s**2], axis=1)
    counts = problem.counts + 1
    normal = _products(powers, powers, counts)
    end = time_s[problem.counts]
    gravity = []
    for path in (problem.expected, problem.felt):
        fitted = _solve(normal, _products(powers, path.velocity_mps, counts))
        gravity += [fitted[:, 1], fitted[:, 1] + end[:, None] * fitted[:, 2]]
    return _Fit(_triad(gravity[1], gravity[0], gravity[3], gravity[2]))


def _solve(normal: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solutions of normal equations whose unknowns differ in size by orders of magnitude."""
    size = np.sqrt(np.diagonal(normal, axis1=1, axis2=2))
    scaled = normal / size[:, :, None] / size[:, None, :]
    return np.asarray(np.linalg.solve(scaled, right / size[:, :, None]) / size[:, :, None])


def _columns(problem: _Problem) -> np.ndarray:
    """Mean velocities felt and expected, and those of an offset, a slope and a bend, shape (n, 9)."""
    time_s = problem.felt.time_s
    step = np.diff(time_s)
    middle = time_s[:-1] + 0.5 * step
    trend = np.stack([np.ones_like(middle), middle, 0.5 * middle**2 + step**2 / 24.0], axis=1)
    return np.hstack([problem.felt.mean_velocity_mps, problem.expected.mean_velocity_mps, trend])


def _least_squares(problem: _Problem, columns: np.ndarray, walk: np.ndarray | None = None) -> _Fit:
    """Rotation and offset from columns of `_columns` whose errors are independent.

    Parameters
    ----------
    problem : _Problem
        What is asked for.
    columns : ndarray, shape (n, 9)
        Whitened.
    walk : ndarray, shape (n,), optional
        Covariance of each row with the slope that the gyros' random walk has brought about by the end.
    """
    b, r, trend = columns[:, :3], columns[:, 3:6], columns[:, 6:]
    counts = problem.counts
    trend_b, trend_r = _products(trend, b, counts), _products(trend, r, counts)
    normal = _products(trend, trend, counts)
    mean = trend_r[:, 0, :, None] * trend_b[:, 0, None, :] / normal[:, 0, 0, None, None]
    rot = _closest_rotation(_products(r, b, counts) - mean)

    # What is left: C V_b - V_n, as offset, slope and bend.
    left = _solve(normal, trend_b @ np.swapaxes(rot, -1, -2) - trend_r)
    end = problem.felt.time_s[counts]
    slope = left[:, 1] + end[:, None] * left[:, 2]
    covariance = None
    if walk is not None:
        # The gyros' random walk since the start: what its covariance with the whitened errors tells of it.
        walked = _sums(walk[:, None] * trend, counts)
        walk_b, walk_r = (_sums(walk[:, None] * rows, counts) for rows in (b, r))
        slope += np.einsum("kij,kj->ki", rot, walk_b) - walk_r - np.einsum("ki,kij->kj", walked, left)
        share = np.zeros((len(counts), 2, 3))
        share[:, 0] = -walked
        share[:, 0, 1] += 1.0
        share[:, 0, 2] += end
        share[:, 1, 2] = 1.0
        covariance = share @ _solve(normal, np.swapaxes(share, -1, -2))
        density = (problem.gravity_mps2 * problem.noise.angle_walk_rad_per_sqrt_s) ** 2
        covariance[:, 0, 0] += density * end - _sums(walk**2, counts)
    force = np.diff(problem.expected.velocity_mps, axis=0)[counts - 1]
    tilt = np.cross(slope, force) / (problem.gravity_mps2 * np.linalg.norm(force, axis=1)[:, None])
    return _Fit(exp_so3(tilt) @ rot, left[:, 2], covariance)


def _velocity_fit(problem: _Problem) -> _Fit:
    return _least_squares(problem, _columns(problem) / np.sqrt(problem.factors)[:, None])


def _weighted(problem: _Problem) -> _Fit:
    columns = _columns(problem)
    walk = walk_covariance(problem.noise, problem.gravity_mps2, len(columns))
    white = whiten(np.column_stack([columns, walk]), problem.noise, problem.gravity_mps2, problem.factors)
    return _least_squares(problem, white[:, :-1], white[:, -1])


FORMS: dict[str, Callable[[_Problem], _Fit]] = {
    "velocity-fit": _velocity_fit,
    "weighted": _weighted,
    "gravity-fit": _gravity_fit,
    "velocity-differences": _velocity_differences,
    "velocity-optimised": _velocity_optimised,
    "displacement-optimised": _displacement_optimised,
    "two-velocities": _two_velocities,
}
"""Name of each form and what finds its rotation."""

_AT_INSTANTS = ("gravity-fit", "velocity-differences", "velocity-optimised", "two-velocities")
"""Forms that take velocities at instants, with all their shaking."""

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
def _responses(form: str) -> np.ndarray:
    r"""Errors of the attitude by pulses along a record, in units that hold for any duration.

    They are found by trying: a small turn of the gyros, a small step of the velocity, a velocity in one
    interval only. Of a fit of a parabola, with u the instant as a share of the record, the heading follows a
    rate of the east gyro by :math:`30u^2(1-u)^2`, whose square integrates to 10/7: the variance by white
    noise is 1.43 times that of plain averaging. An error of the accelerometers that changes feigns a rate:
    the heading follows it by the derivative of that weight.

    Returns
    -------
    ndarray, shape (3, k, 2, 3)
        Kind of pulse, instant, axis (north, east); small rotation about north, east, down in units of
        `_response_scales`.
    """
    site, length_s, small = Site(np.radians(45.0)), 240.0, 1e-6
    time_s = np.linspace(0.0, length_s, _PULSES + 1)
    expected = _expected_path(site, time_s)
    noise = VelocityNoise(length_s / _PULSES, 1.0, 0.0, 0.0)
    problem = _Problem(expected, expected, np.array([_PULSES]), np.ones(_PULSES), noise, site.gravity_mps2)
    to_end = exp_so3(-length_s * site.earth_rate_ned_radps)

    def response(
        velocity: np.ndarray, position: np.ndarray, push: np.ndarray, turn: np.ndarray
    ) -> np.ndarray:
        """Error of the attitude at the end, for one."""
        shaken = _Path(
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
def _noise_shapes(form: str) -> np.ndarray:
    """Covariances by white noises in units of `_noise_scales`, shape (4, 3, 3)."""
    found = _responses(form)
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
    found = _responses(form)[:2] / _PULSES
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


def _drift_lines(form: str, errors: ImuDescription, site: Site, duration_s: np.ndarray) -> np.ndarray:
    """Covariances of the attitude by each of `_DRIFTS`, shape (4, k, 3, 3)."""
    processes, walks = _drift_shapes(form)
    scales = _response_scales(site, duration_s)[:2] * duration_s[:, None]
    lines = np.zeros((len(_DRIFTS), len(duration_s), 3, 3))
    for number, (_, key, _) in enumerate(_DRIFTS):
        sensor = number // 2
        size = getattr(errors, key) * (_DPH, _UG)[sensor]
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


def _lag_line(form: str, errors: ImuDescription, site: Site, duration_s: np.ndarray) -> np.ndarray:
    """Covariance of the tilts by constant errors of the gyros, shape (k, 3, 3).

    They tilt the frame b0 all along, so level at the end is not that of the mean. The forms that fit all
    bends follow the tilt but for its square.
    """
    force = errors.gyro_g_sensitivity_dph_per_g * site.gravity_mps2 / 9.80665
    turned = np.hypot(errors.gyro_bias_sd_dph, force) * _DPH * duration_s
    bent = np.minimum(SECOND_ORDER_LAG * turned**2, np.pi / np.sqrt(3.0))
    lag = _responses(form)[0].sum(axis=0)[:, :2] / _PULSES
    # Where north is lost both tilts lag like the worse one; where it is not, neither matters.
    straight = float(np.linalg.norm(lag, 2)) * turned
    cov = np.zeros((len(duration_s), 3, 3))
    cov[:, [0, 1], [0, 1]] = (straight**2 + bent**2)[:, None]
    return cov


def _noise_lines(
    form: str, fit: _Fit, problem: _Problem, site: Site, shaking_mps: float, start_mps: float
) -> np.ndarray:
    """Covariances of the attitude by noise of gyros, accelerometers and shaking, shape (3, k, 3, 3).

    Of the weighted form there is one, of all noise together, shape (1, k, 3, 3).

    Parameters
    ----------
    form, fit, problem, site
        What was done.
    shaking_mps, start_mps : float
        Standard deviations of the velocities that the form takes, and of that at the start.
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
    lines = scales[..., :, None] * _noise_shapes(form)[:, None] * scales[..., None, :]
    return np.concatenate([lines[:2], lines[2:].sum(axis=0, keepdims=True)])


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
    felt, rot_b0_from_b = _felt_path(blocks)
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
    shaking = start if form in _AT_INSTANTS else problem.noise.shaking_mps
    lines = _noise_lines(form, fit, problem, site, shaking, start)
    cov = lines.sum(axis=0)
    budget = None
    notes: tuple[str, ...] = ()
    if errors is None:
        notes += (
            "The errors of the sensor were not stated: sigma covers only the noise seen in the data; a gyro"
            f" bias of 1 deg/h towards east would turn north by"
            f" {np.degrees(_DPH / site.horizontal_rate_radps):.2g} deg.",
        )
    else:
        drifts = _drift_lines(form, errors, site, duration)
        lag = _lag_line(form, errors, site, duration)
        constant = msgspec.structs.replace(errors, **{key: 0.0 for _, key, _ in _DRIFTS})
        sources = [
            *_noise_budget(form, errors, lines[:, -1], problem.noise, shaking),
            *_drift_budget(errors, drifts[:, -1]),
            BudgetLine("tilting by the gyro bias", f"{errors.gyro_bias_sd_dph:g} deg/h", lag[-1]),
            *static_budget(constant, rot, site, float(duration[-1]), noise_factor=0.0).lines,
        ]
        sources = [line for line in sources if line.source == "latitude" or np.any(line.cov_ned_rad2)]
        budget = ErrorBudget(tuple(sorted(sources, key=lambda line: -float(line.cov_ned_rad2[2, 2]))), rot)
        cov = (
            cov + lag + drifts.sum(axis=0) + covariance_after(constant, rot, site, duration, noise_factor=0.0)
        )
    bumps = int(np.count_nonzero(problem.factors > 1.0))
    if bumps and form in ("velocity-fit", "weighted"):
        notes += (
            f"{bumps} of {number} intervals of {problem.noise.interval_s:g} s were shaken more than the rest,"
            f" the worst {np.sqrt(problem.factors.max()) * BUMP_SD:.0f} times; they count less.",
        )
    cov = wrapped_covariance(rot, cov)
    run = None
    if running:
        angles = angle_covariance(attitude, cov)
        sd = np.sqrt(np.maximum(np.diagonal(angles, axis1=1, axis2=2), 0.0))
        run = NorthRun(blocks.time_s[counts], np.stack(heading_pitch_roll(attitude), axis=-1), sd)
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
    skip = available - number * samples
    ending = InertialIncrements(
        increments.time_s[skip:],
        increments.angle_rad[skip:],
        increments.velocity_mps[skip:],
        None if increments.position_m is None else increments.position_m[skip:],
    )
    return compress_increments(ending, samples)


def _plain_problem(felt: _Path, site: Site) -> tuple[_Problem, np.ndarray]:
    """All intervals, bumps marked, noise not known; and what a first fit leaves, shape (n, 3)."""
    number = len(felt.time_s) - 1
    expected = _expected_path(site, felt.time_s)
    noise = VelocityNoise(float(np.mean(np.diff(felt.time_s))), 0.0, 0.0, 0.0)
    problem = _Problem(felt, expected, np.array([number]), np.ones(number), noise, site.gravity_mps2)
    for _ in range(2):
        # Bumps show best where they do not bend the fit.
        rot = _velocity_fit(problem).rot_n0_from_b0[0]
        left = felt.mean_velocity_mps @ rot.T - expected.mean_velocity_mps
        problem = problem._replace(factors=bump_factors(left[:, :2]))
    return problem, left


def _seen_noise(problem: _Problem, left: np.ndarray, errors: ImuDescription | None) -> VelocityNoise:
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
    gyro = np.radians(errors.gyro_random_walk_deg_per_sqrt_h) / 60.0
    accelerometer = errors.accel_random_walk_mps_per_sqrt_h / 60.0
    if errors.output == "rates":
        rounding = 1.0 / np.sqrt(12.0 * errors.rate_hz)
        gyro = np.hypot(gyro, np.radians(errors.gyro_resolution_dps) * rounding)
        accelerometer = np.hypot(accelerometer, errors.accel_resolution_ug * _UG * rounding)
    return float(gyro), float(accelerometer)


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


def _measured(problem: _Problem, fit: _Fit, site: Site, left: np.ndarray) -> dict[str, float]:
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
        measured["horizontal_rate_dph"] = horizontal_radps / _DPH
        latitude = np.arccos(np.clip(horizontal_radps / EARTH_RATE_RADPS, -1.0, 1.0))
        measured["latitude_deg"] = float(np.degrees(np.copysign(latitude, site.latitude_rad)))
    return measured


def _horizontal_rate_radps(problem: _Problem, fit: _Fit, site: Site) -> float:
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
    felt, _ = _felt_path(blocks)
    found = []
    for sign in (1.0, -1.0):
        latitude = sign * np.radians(45.0)
        for _ in range(LATITUDE_STEPS):
            site = Site(latitude, longitude_rad, height_m)
            problem, left = _plain_problem(felt, site)
            fit = _velocity_fit(problem)
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
    lines = _noise_lines("velocity-fit", fit, problem, site, problem.noise.shaking_mps, 0.0)
    # The bends towards north and east are as noisy: one is the heading, the other the latitude.
    variance = float(lines[:, -1, 2, 2].sum()) * np.cos(site.latitude_rad) ** 2
    if errors is not None:
        biases = np.hypot(errors.gyro_bias_sd_dph, errors.gyro_bias_instability_dph)
        variance += (biases * _DPH / EARTH_RATE_RADPS) ** 2
    sine = max(abs(np.sin(site.latitude_rad)), np.sqrt(variance) ** 0.5)
    return replace(site, latitude_sd_rad=float(np.sqrt(variance) / sine))
