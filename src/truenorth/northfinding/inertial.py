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

The constant c is the velocity of the body at the start. ``velocity-fit`` minimises the squared disturbance
over C and c, which is Wahba's problem of the centred vectors; the velocities are means over intervals, where
the shaking averages out.

References
----------
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

import numpy as np

from ..errors import ConfigError, NoSolutionError
from ..rotations import exp_so3, heading_pitch_roll
from ..sensors.imu import ImuDescription
from ..strapdown import InertialIncrements, compress_increments
from .site import Site
from .solution import NorthRun, NorthSolution

__all__ = ["FORMS", "align_inertial"]

FEWEST_INTERVALS = 5
"""Rotation, velocity and a residual need that many."""


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
    velocity = np.concatenate([np.zeros((1, 3)), np.cumsum(gained, axis=0)])
    moved = np.einsum("nij,nj->ni", rot[:-1], blocks.position_m) + velocity[:-1] * np.diff(time_s)[:, None]
    return _Path(time_s, velocity, np.concatenate([np.zeros((1, 3)), np.cumsum(moved, axis=0)])), rot


def _expected_path(site: Site, time_s: np.ndarray) -> _Path:
    """What a unit at rest on the turning Earth feels, in n0."""
    rate = float(np.linalg.norm(site.earth_rate_ned_radps))
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


def _closest_rotation(profile: np.ndarray) -> np.ndarray:
    """Rotations that solve Wahba's problem: the largest trace of their product with the profile sum r b^T."""
    u, _, vt = np.linalg.svd(profile)
    u[..., 2] *= (np.linalg.det(u) * np.linalg.det(vt))[..., None]
    return u @ vt


def _velocity_fit(felt: _Path, expected: _Path, counts: np.ndarray) -> np.ndarray:
    """Least squares of rotation and starting velocity over mean velocities."""
    b, r = felt.mean_velocity_mps, expected.mean_velocity_mps
    number = counts[:, None, None]
    products = np.cumsum(r[:, :, None] * b[:, None, :], axis=0)[counts - 1]
    sums_b, sums_r = (np.cumsum(rows, axis=0)[counts - 1] for rows in (b, r))
    return _closest_rotation(products - sums_r[:, :, None] * sums_b[:, None, :] / number)


FORMS: dict[str, Callable[[_Path, _Path, np.ndarray], np.ndarray]] = {"velocity-fit": _velocity_fit}
"""Name of each form and what finds the constant rotation from the first so many intervals."""


def align_inertial(
    increments: InertialIncrements,
    site: Site,
    *,
    errors: ImuDescription | None = None,
    form: str = "velocity-fit",
    running: bool = True,
    interval_s: float = 1.0,
) -> NorthSolution:
    """North, roll and pitch of a platform at rest that may sway and shake.

    Parameters
    ----------
    increments : InertialIncrements
        What the unit felt, body axes.
    site : Site
        Where.
    errors : ImuDescription, optional
        What is known of the sensor.
    form : str
        One of `FORMS`.
    running : bool
        Whether to give the estimate after every interval too.
    interval_s : float
        Length over which the increments are summed and velocities averaged first, seconds.

    Returns
    -------
    NorthSolution
        At the end of the record.

    Raises
    ------
    ConfigError
        If there is no such form.
    NoSolutionError
        If the record is too short.
    """
    if form not in FORMS:
        raise ConfigError(
            f"inertial alignment has no form {form!r}; give one of {', '.join(FORMS)}", key="form", value=form
        )
    step_s = float(np.median(np.diff(increments.time_s)))
    samples = max(1, round(interval_s / step_s))
    number = len(increments.angle_rad) // samples
    if number < FEWEST_INTERVALS:
        raise NoSolutionError(
            f"inertial alignment got {len(increments.angle_rad) * step_s:.1f} s of data; give at least"
            f" {FEWEST_INTERVALS * samples * step_s:.0f} s"
        )
    blocks = compress_increments(_ending(increments, number * samples), samples)
    felt, rot_b0_from_b = _felt_path(blocks)
    expected = _expected_path(site, felt.time_s)
    counts = np.arange(FEWEST_INTERVALS, number + 1) if running else np.array([number])
    rot_n0_from_b0 = FORMS[form](felt, expected, counts)
    rot_n_from_n0 = exp_so3(np.multiply.outer(-felt.time_s[counts], site.earth_rate_ned_radps))
    rot_ned_from_body = rot_n_from_n0 @ rot_n0_from_b0 @ rot_b0_from_b[counts]

    residual = felt.mean_velocity_mps @ rot_n0_from_b0[-1].T - expected.mean_velocity_mps
    residual -= residual.mean(axis=0)
    horizontal = float(np.sqrt(np.mean(residual[:, :2] ** 2)))
    duration = felt.time_s[counts]
    lever = site.gravity_mps2 * site.horizontal_rate_radps
    heading_sd = horizontal * np.sqrt(720.0 / counts) / (lever * duration**2)
    tilt_sd = horizontal * np.sqrt(12.0 / counts) / (site.gravity_mps2 * duration)
    sd = np.stack([heading_sd, tilt_sd, tilt_sd], axis=1)
    angles = np.stack(heading_pitch_roll(rot_ned_from_body), axis=1)
    return NorthSolution(
        method="inertial",
        site=site,
        time_s=float(blocks.time_s[-1]),
        duration_s=float(duration[-1]),
        rot_ned_from_body=rot_ned_from_body[-1],
        cov_ned_rad2=np.diag(sd[-1, ::-1] ** 2),
        measured={"residual_mps": horizontal},
        run=NorthRun(blocks.time_s[counts], angles, sd) if running else None,
        notes=() if errors is not None else _NOISE_ONLY,
    )


_NOISE_ONLY = ("Sigma covers noise only, for no errors of the sensor were stated.",)


def _ending(increments: InertialIncrements, used: int) -> InertialIncrements:
    """The last so many intervals."""
    skip = len(increments.angle_rad) - used
    return InertialIncrements(
        increments.time_s[skip:],
        increments.angle_rad[skip:],
        increments.velocity_mps[skip:],
        None if increments.position_m is None else increments.position_m[skip:],
    )
