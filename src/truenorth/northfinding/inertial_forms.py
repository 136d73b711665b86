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
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..gravity import EARTH_RATE_RADPS
from ..rotations import exp_so3
from ..strapdown import InertialIncrements, accumulate_turns
from .inertial_noise import VelocityNoise, walk_covariance, whiten
from .site import Site

__all__ = [
    "AT_INSTANTS",
    "FORMS",
    "AlignmentFit",
    "AlignmentProblem",
    "InertialPath",
    "expected_path",
    "felt_path",
    "velocity_fit",
]


@dataclass(frozen=True, slots=True, eq=False)
class InertialPath:
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


class AlignmentProblem(NamedTuple):
    """What every form is given."""

    felt: InertialPath
    """In b0."""
    expected: InertialPath
    """In n0."""
    counts: np.ndarray
    """After how many intervals the rotation is wanted, shape (k,)."""
    factors: np.ndarray
    """How much the variance of each interval exceeds the usual, shape (n,)."""
    noise: VelocityNoise
    """Of the mean velocities."""
    gravity_mps2: float


class AlignmentFit(NamedTuple):
    """What a form finds after each of k counts."""

    rot_n0_from_b0: np.ndarray
    """Shape (k, 3, 3)."""
    bend_mps2_per_s: np.ndarray | None = None
    """What is left of the curvature of V in n0, shape (k, 3)."""
    slope_bend_covariance: np.ndarray | None = None
    """Of slope at the end and curvature along one horizontal axis, shape (k, 2, 2)."""


def felt_path(blocks: InertialIncrements) -> tuple[InertialPath, np.ndarray]:
    """What the unit felt, in b0.

    Parameters
    ----------
    blocks : InertialIncrements
        n intervals with second integrals, as `truenorth.strapdown.compress_increments` gives them.

    Returns
    -------
    path : InertialPath
        Its integrals in b0.
    rot_b0_from_b : ndarray, shape (n + 1, 3, 3)
        Attitude of the body against b0 at the edges.
    """
    rot = accumulate_turns(blocks.angle_rad)
    assert blocks.position_m is not None  # compressed increments always have it
    time_s = blocks.time_s - blocks.time_s[0]
    gained = np.einsum("nij,nj->ni", rot[:-1], blocks.velocity_mps)
    velocity = _from_zero(np.cumsum(gained, axis=0))
    moved = np.einsum("nij,nj->ni", rot[:-1], blocks.position_m) + velocity[:-1] * np.diff(time_s)[:, None]
    return InertialPath(time_s, velocity, _from_zero(np.cumsum(moved, axis=0))), rot


def expected_path(site: Site, time_s: np.ndarray) -> InertialPath:
    """What a unit at rest on the turning Earth feels, in n0.

    Parameters
    ----------
    site : Site
        Where.
    time_s : ndarray, shape (n + 1,)
        Edges of the intervals, from the start.

    Returns
    -------
    InertialPath
        The integrals of the reaction to gravity, in closed form.
    """
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
    return InertialPath(time_s, velocity, position)


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


def _two_velocities(problem: AlignmentProblem) -> AlignmentFit:
    half, last = problem.counts // 2, problem.counts
    r, b = problem.expected.velocity_mps, problem.felt.velocity_mps
    return AlignmentFit(_triad(r[last], r[half], b[last], b[half]))


def _velocity_optimised(problem: AlignmentProblem) -> AlignmentFit:
    r, b = problem.expected.velocity_mps[1:], problem.felt.velocity_mps[1:]
    return AlignmentFit(_closest_rotation(_products(r, b, problem.counts)))


def _displacement_optimised(problem: AlignmentProblem) -> AlignmentFit:
    r, b = problem.expected.position_m[1:], problem.felt.position_m[1:]
    return AlignmentFit(_closest_rotation(_products(r, b, problem.counts)))


def _velocity_differences(problem: AlignmentProblem) -> AlignmentFit:
    r, b = problem.expected.velocity_mps, problem.felt.velocity_mps
    profile = np.empty((len(problem.counts), 3, 3))
    for k, count in enumerate(problem.counts):
        lag = count // 2
        profile[k] = (r[lag : count + 1] - r[: count + 1 - lag]).T @ (
            b[lag : count + 1] - b[: count + 1 - lag]
        )
    return AlignmentFit(_closest_rotation(profile))


def _gravity_fit(problem: AlignmentProblem) -> AlignmentFit:
    time_s = problem.felt.time_s
    powers = np.stack([np.ones_like(time_s), time_s, 0.5 * time_s**2], axis=1)
    counts = problem.counts + 1
    normal = _products(powers, powers, counts)
    end = time_s[problem.counts]
    gravity = []
    for path in (problem.expected, problem.felt):
        fitted = _solve(normal, _products(powers, path.velocity_mps, counts))
        gravity += [fitted[:, 1], fitted[:, 1] + end[:, None] * fitted[:, 2]]
    return AlignmentFit(_triad(gravity[1], gravity[0], gravity[3], gravity[2]))


def _solve(normal: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solutions of normal equations whose unknowns differ in size by orders of magnitude."""
    size = np.sqrt(np.diagonal(normal, axis1=1, axis2=2))
    scaled = normal / size[:, :, None] / size[:, None, :]
    return np.asarray(np.linalg.solve(scaled, right / size[:, :, None]) / size[:, :, None])


def _columns(problem: AlignmentProblem) -> np.ndarray:
    """Mean velocities felt and expected, and those of an offset, a slope and a bend, shape (n, 9)."""
    time_s = problem.felt.time_s
    step = np.diff(time_s)
    middle = time_s[:-1] + 0.5 * step
    trend = np.stack([np.ones_like(middle), middle, 0.5 * middle**2 + step**2 / 24.0], axis=1)
    return np.hstack([problem.felt.mean_velocity_mps, problem.expected.mean_velocity_mps, trend])


def _least_squares(
    problem: AlignmentProblem, columns: np.ndarray, walk: np.ndarray | None = None
) -> AlignmentFit:
    """Rotation and offset from columns of `_columns` whose errors are independent.

    Parameters
    ----------
    problem : AlignmentProblem
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
    return AlignmentFit(exp_so3(tilt) @ rot, left[:, 2], covariance)


def velocity_fit(problem: AlignmentProblem) -> AlignmentFit:
    """Least squares over mean velocities, those of bumps weighing less.

    Parameters
    ----------
    problem : AlignmentProblem
        What is asked for.

    Returns
    -------
    AlignmentFit
        With the bend that is left.
    """
    return _least_squares(problem, _columns(problem) / np.sqrt(problem.factors)[:, None])


def _weighted(problem: AlignmentProblem) -> AlignmentFit:
    columns = _columns(problem)
    walk = walk_covariance(problem.noise, problem.gravity_mps2, len(columns))
    white = whiten(np.column_stack([columns, walk]), problem.noise, problem.gravity_mps2, problem.factors)
    return _least_squares(problem, white[:, :-1], white[:, -1])


FORMS: dict[str, Callable[[AlignmentProblem], AlignmentFit]] = {
    "velocity-fit": velocity_fit,
    "weighted": _weighted,
    "gravity-fit": _gravity_fit,
    "velocity-differences": _velocity_differences,
    "velocity-optimised": _velocity_optimised,
    "displacement-optimised": _displacement_optimised,
    "two-velocities": _two_velocities,
}
"""Name of each form and what finds its rotation."""

AT_INSTANTS = ("gravity-fit", "velocity-differences", "velocity-optimised", "two-velocities")
"""Forms that take velocities at instants, with all their shaking."""
