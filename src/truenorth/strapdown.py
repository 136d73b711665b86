r"""Strapdown in its exact discrete form: increments of a true motion, and the way back.

Over an interval from k to k+1 of length T an ideal inertial unit gives, all in its axes of instant k,

* the rotation vector :math:`\Delta\theta` of the body against inertial space,
* the integral :math:`\Delta v = \int C^{b_k}_{b(t)} f\,dt` of the specific force (with coning, sculling),
* its second integral :math:`\Delta s = \int\!\!\int C^{b_k}_{b(t)} f\,dt\,dt` (with scrolling).

The mechanisation is that of an inertial frame which coincides with ECEF at instant k. With the inertial
velocity :math:`u = v + \omega\times r`, attitude :math:`C` (ECEF from body), gravitation :math:`\gamma`
and the turn of the Earth :math:`E = \exp([\omega T])`:

.. math::
    C_{k+1} &= E^T C_k \exp([\Delta\theta])\\
    E\,u_{k+1} &= u_k + C_k\Delta v + \tfrac T2 (\gamma_k + E\gamma_{k+1})\\
    E\,r_{k+1} &= r_k + T u_k + C_k\Delta s + \tfrac{T^2}6 (2\gamma_k + E\gamma_{k+1})

Nothing is neglected but the second derivative of the gravitation along the way within an interval (at
100 m/s and 1 s, 1e-10 m/s). `reference_increments` solves these for the increments, `integrate_increments`
for the states, so that one undoes the other to rounding at any interval. A real unit has no :math:`\Delta s`;
without it the position takes the trapezoid :math:`C_k\Delta v\,T/2`, whose error does not grow: it stays
within :math:`T^2/12` times the change of the acceleration since the start.

References
----------
Savage, P. G., "Strapdown inertial navigation integration algorithm design", J. Guidance, Control, and
Dynamics 21 (1998) 19-28 and 208-221.
Groves, P. D., Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed. (2013),
sec. 5.2 to 5.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from .gravity import EARTH_RATE_RADPS, gravitation_ecef_mps2, gravity_ecef_mps2
from .rotations import exp_so3, log_so3

__all__ = [
    "InertialIncrements",
    "InertialStates",
    "accumulate_turns",
    "compensate_increments",
    "compress_increments",
    "integrate_increments",
    "rate_inertial_body_radps",
    "reference_increments",
    "specific_force_body_mps2",
]

_EARTH_RATE = np.array([0.0, 0.0, EARTH_RATE_RADPS])


class _Mover(Protocol):
    """What can be asked for its motion at any instant."""

    def at(self, time_s: np.ndarray) -> Any:
        """Motion at instants."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class InertialIncrements:
    """What an ideal inertial unit gives over n intervals, in its axes at the start of each.

    Parameters
    ----------
    time_s : ndarray, shape (n + 1,)
        Edges of the intervals.
    angle_rad : ndarray, shape (n, 3)
        Rotation vector of the body against inertial space.
    velocity_mps : ndarray, shape (n, 3)
        Integral of the specific force.
    position_m : ndarray, shape (n, 3), or None
        Second integral of the specific force; None from a real unit, which has none.
    """

    time_s: np.ndarray
    angle_rad: np.ndarray
    velocity_mps: np.ndarray
    position_m: np.ndarray | None = None

    def part(self, first: int, last: int | None = None) -> InertialIncrements:
        """Intervals ``first`` to ``last - 1``, or to the end, with their times."""
        last = len(self.angle_rad) if last is None else last
        return InertialIncrements(
            self.time_s[first : last + 1],
            self.angle_rad[first:last],
            self.velocity_mps[first:last],
            None if self.position_m is None else self.position_m[first:last],
        )


@dataclass(frozen=True, slots=True, eq=False)
class InertialStates:
    """Navigation states at n instants.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Instants.
    position_ecef_m, velocity_ecef_mps : ndarray, shape (n, 3)
        Position and velocity in the turning ECEF frame.
    rot_ecef_from_body : ndarray, shape (n, 3, 3)
        Attitude.
    """

    time_s: np.ndarray
    position_ecef_m: np.ndarray
    velocity_ecef_mps: np.ndarray
    rot_ecef_from_body: np.ndarray


def rate_inertial_body_radps(motion: Any) -> np.ndarray:
    """Angular rate of the body against inertial space: what an ideal gyro feels.

    Parameters
    ----------
    motion : Motion
        State at n instants.

    Returns
    -------
    ndarray, shape (n, 3)
        In body axes, rad/s.
    """
    return motion.rate_body_radps + EARTH_RATE_RADPS * motion.rot_ecef_from_body[:, 2, :]


def specific_force_body_mps2(motion: Any) -> np.ndarray:
    """Specific force at the body's origin: what an ideal accelerometer feels.

    ``f = R^T (a + 2 W x v - g)`` with the Earth rate W and gravity g; at rest and level ``(0, 0, -g)``.

    Parameters
    ----------
    motion : Motion
        State at n instants.

    Returns
    -------
    ndarray, shape (n, 3)
        In body axes, m/s^2.
    """
    force_ecef = (
        motion.acceleration_ecef_mps2
        + 2.0 * np.cross(_EARTH_RATE, motion.velocity_ecef_mps)
        - gravity_ecef_mps2(motion.position_ecef_m)
    )
    return np.einsum("nji,nj->ni", motion.rot_ecef_from_body, force_ecef)


def _earth_turn(interval_s: np.ndarray) -> np.ndarray:
    """Turn of the Earth over intervals less the identity, shape (n, 3, 3).

    The identity is left out, because a product of 1 - 1e-11 with the radius of the Earth rounds to half a
    nanometre, always in the same direction, and thousands of intervals add up.
    """
    angle = EARTH_RATE_RADPS * np.asarray(interval_s)
    turn = np.zeros((len(angle), 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = -2.0 * np.sin(0.5 * angle) ** 2
    turn[:, 1, 0] = np.sin(angle)
    turn[:, 0, 1] = -turn[:, 1, 0]
    return turn


def reference_increments(trajectory: _Mover, time_s: np.ndarray) -> InertialIncrements:
    """Increments that an ideal inertial unit at the body's origin gives between instants.

    Parameters
    ----------
    trajectory : Trajectory
        The true motion.
    time_s : ndarray, shape (n + 1,)
        Edges of the intervals, seconds since the start, ascending.

    Returns
    -------
    InertialIncrements
        Such that `integrate_increments` from the true state at ``time_s[0]`` returns to the truth.
    """
    time_s = np.asarray(time_s, dtype=float)
    motion = trajectory.at(time_s)
    interval = np.diff(time_s)[:, None]
    attitude = motion.rot_ecef_from_body
    position = motion.position_ecef_m
    inertial = motion.velocity_ecef_mps + np.cross(_EARTH_RATE, position)
    gravitation = gravitation_ecef_mps2(position)
    earth = _earth_turn(interval[:, 0])

    def gain(vectors: np.ndarray) -> np.ndarray:
        """From the start of each interval to its end, in the inertial frame."""
        return np.diff(vectors, axis=0) + np.einsum("nij,nj->ni", earth, vectors[1:])

    start = attitude[:-1]
    g0 = gravitation[:-1]
    g1 = g0 + gain(gravitation)
    force = gain(inertial) - 0.5 * interval * (g0 + g1)
    force2 = gain(position) - interval * inertial[:-1] - interval**2 / 6.0 * (2.0 * g0 + g1)
    return InertialIncrements(
        time_s=time_s,
        angle_rad=log_so3(np.swapaxes(start, -1, -2) @ (np.eye(3) + earth) @ attitude[1:]),
        velocity_mps=np.einsum("nji,nj->ni", start, force),
        position_m=np.einsum("nji,nj->ni", start, force2),
    )


def accumulate_turns(angle_rad: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
    """Attitude at the edges of intervals, in the axes in which it is known at the first.

    Parameters
    ----------
    angle_rad : ndarray, shape (n, 3)
        Rotation vector of each interval, in the axes at its start.
    start : ndarray, shape (3, 3), optional
        Attitude at the first edge; by default its own axes are kept.

    Returns
    -------
    ndarray, shape (n + 1, 3, 3)
    """
    steps = exp_so3(angle_rad)
    rot = np.empty((len(steps) + 1, 3, 3))
    rot[0] = np.eye(3) if start is None else start
    for k, step in enumerate(steps):
        rot[k + 1] = rot[k] @ step
    return rot


def compensate_increments(angle_rad: np.ndarray, velocity_mps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    r"""Coning and sculling of a unit that only integrates what its axes feel.

    With the integrals :math:`\alpha` of the rate and :math:`\upsilon` of the specific force in the turning
    axes (Savage 1998, two-sample form),

    .. math::
        \Delta\theta_k &= \alpha_k + \tfrac1{12} \alpha_{k-1} \times \alpha_k\\
        \Delta v_k &= \upsilon_k + \tfrac12 \alpha_k \times \upsilon_k
        + \tfrac1{12} (\alpha_{k-1} \times \upsilon_k + \upsilon_{k-1} \times \alpha_k)

    Parameters
    ----------
    angle_rad, velocity_mps : ndarray, shape (n, 3)
        Integrals over equal intervals.

    Returns
    -------
    angle_rad, velocity_mps : ndarray, shape (n, 3)
        Rotation vectors and velocity increments in the axes at the start of each interval.
    """
    angle, velocity = np.asarray(angle_rad, dtype=float), np.asarray(velocity_mps, dtype=float)
    # The first interval has none before it and is taken for its own.
    angle0, velocity0 = (np.concatenate([rows[:1], rows[:-1]]) for rows in (angle, velocity))
    coned = angle + np.cross(angle0, angle) / 12.0
    sculled = velocity + 0.5 * np.cross(angle, velocity)
    return coned, sculled + (np.cross(angle0, velocity) + np.cross(velocity0, angle)) / 12.0


def compress_increments(increments: InertialIncrements, samples: int) -> InertialIncrements:
    """Fewer, longer intervals that say the same: turn, velocity and position of each, in its first axes.

    Parameters
    ----------
    increments : InertialIncrements
        n intervals.
    samples : int
        How many become one; what is left at the end is dropped.

    Returns
    -------
    InertialIncrements
        ``n // samples`` intervals, with positions: where the unit gives none, by trapezoids within samples.
    """
    n = len(increments.angle_rad) // samples
    used = n * samples
    step = np.diff(increments.time_s[: used + 1]).reshape(n, samples, 1)
    angle, velocity = (
        rows[:used].reshape(n, samples, 3) for rows in (increments.angle_rad, increments.velocity_mps)
    )
    if increments.position_m is None:
        position = 0.5 * step * velocity
    else:
        position = increments.position_m[:used].reshape(n, samples, 3)
    turn = np.tile(np.eye(3), (n, 1, 1))
    gained, moved = np.zeros((n, 3)), np.zeros((n, 3))
    for k in range(samples):
        moved += step[:, k] * gained + np.einsum("nij,nj->ni", turn, position[:, k])
        gained += np.einsum("nij,nj->ni", turn, velocity[:, k])
        turn = turn @ exp_so3(angle[:, k])
    return InertialIncrements(increments.time_s[: used + 1 : samples], log_so3(turn), gained, moved)


def integrate_increments(
    increments: InertialIncrements,
    position_ecef_m: np.ndarray,
    velocity_ecef_mps: np.ndarray,
    rot_ecef_from_body: np.ndarray,
) -> InertialStates:
    """Dead reckoning from an initial state; the inverse of `reference_increments`.

    Parameters
    ----------
    increments : InertialIncrements
        n intervals.
    position_ecef_m, velocity_ecef_mps : ndarray, shape (3,)
        State at the first edge.
    rot_ecef_from_body : ndarray, shape (3, 3)
        Attitude at the first edge.

    Returns
    -------
    InertialStates
        At all n + 1 edges, the first as given.
    """
    n = len(increments.time_s)
    interval = np.diff(increments.time_s)
    back = np.swapaxes(_earth_turn(interval), -1, -2)
    turn = exp_so3(increments.angle_rad)
    second = increments.position_m
    if second is None:
        second = 0.5 * interval[:, None] * increments.velocity_mps
    positions, velocities, attitudes = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3, 3))
    position = np.array(position_ecef_m, dtype=float)
    inertial = np.asarray(velocity_ecef_mps, dtype=float) + np.cross(_EARTH_RATE, position)
    attitude = np.array(rot_ecef_from_body, dtype=float)
    positions[0], velocities[0], attitudes[0] = position, velocity_ecef_mps, attitude
    gravitation = gravitation_ecef_mps2(position)
    for k in range(n - 1):
        t, earth = interval[k], back[k]
        pushed = attitude @ increments.velocity_mps[k] + 0.5 * t * gravitation
        moved = t * inertial + attitude @ second[k] + t * t / 3.0 * gravitation
        free = position + (earth @ position + moved + earth @ moved)
        # Gravitation at the end depends on the end, but changes by 3e-6 of the way there only: one
        # correction is below rounding for intervals of a second.
        ahead = gravitation_ecef_mps2(free + t * t / 6.0 * gravitation)
        position = free + t * t / 6.0 * ahead
        gravitation = gravitation_ecef_mps2(position)
        inertial = inertial + (earth @ inertial + pushed + earth @ pushed) + 0.5 * t * gravitation
        attitude = (attitude + earth @ attitude) @ turn[k]
        positions[k + 1], velocities[k + 1], attitudes[k + 1] = position, inertial, attitude
    velocities[1:] -= np.cross(_EARTH_RATE, positions[1:])
    return InertialStates(increments.time_s, positions, velocities, attitudes)
