r"""North by plain averaging: two vectors, gravity and the Earth's rotation.

At rest the mean specific force and the mean rate are, but for errors, two vectors known in north, east, down,

.. math:: f^n = (0, 0, -g),\qquad \omega^n = (\omega\cos\phi, 0, -\omega\sin\phi)

Two forms make an attitude of them:

* ``orthonormal``: gravity is exact, the meridian is the plane of both vectors (TRIAD; Black 1964). Neither
  g nor the latitude is used.
* ``published``: the direct form of Oguz (6.4) to (6.10),

  .. math::
      C^n_b = [f^n \mid \omega^n \mid f^n\times\omega^n]^{-T}\,
      [f^b \mid \omega^b \mid f^b\times\omega^b]^T

  with :math:`f^n\times\omega^n = (0, -g\omega\cos\phi, 0)`. Printed as (6.9) is
  :math:`(0, g\omega\sin\phi, 0)`, which has the wrong sign and would be singular at the equator instead of
  the poles. The matrix is not orthonormal; the azimuth is taken from its elements,
  :math:`\tan^{-1}(C_{21}/C_{11})`, here over the full circle.

To first order both azimuths agree but for a vertical accelerometer error, which adds
:math:`-(\delta f_d/g)\sin\psi\cos\psi` to the published one of a level body at heading psi. A least-squares
(Wahba) compromise of the two vectors adds nothing to the heading: it can only share out the error of the
angle between them, within the meridian.

References
----------
Black, H. D., "A passive system for determining the attitude of a satellite", AIAA Journal 2 (1964) 1350-1351.
Oguz, P., M.Sc. thesis, Middle East Technical University (2006), sec. 6.
Titterton, D. H., Weston, J. L., Strapdown Inertial Navigation Technology, 2nd ed. (2004), sec. 10.4.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from ..constants import DPH_RADPS
from ..errors import ConfigError, NoSolutionError
from ..rotations import heading_pitch_roll, log_so3
from ..strapdown import InertialIncrements
from .budget import (
    accelerometer_sensitivity,
    covariance_after,
    gyro_sensitivity,
    static_budget,
    wrapped_covariance,
)
from .inertial import align_inertial
from .site import Site
from .solution import BudgetLine, ErrorBudget, NorthRun, NorthSolution, angle_deviations

if TYPE_CHECKING:
    from ..sensors.imu import ImuDescription

__all__ = ["align_static", "direct_matrix", "two_vector_attitude"]


ROCKING_SIGMAS = 4.0
"""Beyond so many standard deviations averages and inertial frame differ by more than noise."""

LEAST_ROCKING_RAD = np.radians(0.005)
"""Below it nobody minds; the Earth's own turn within the record makes some of it."""

LEAST_BLOCKS = 5
"""Seconds that the scatter of the data needs before it is called a standard deviation."""


def two_vector_attitude(force_body_mps2: np.ndarray, rate_body_radps: np.ndarray) -> np.ndarray:
    """Attitude from specific force and Earth rate, the force exact.

    Parameters
    ----------
    force_body_mps2, rate_body_radps : ndarray, shape (..., 3)
        Means at rest.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        North, east, down from body; NaN where the two are parallel or zero.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        down = -force_body_mps2 / np.linalg.norm(force_body_mps2, axis=-1, keepdims=True)
        east = np.cross(down, rate_body_radps)
        east = east / np.linalg.norm(east, axis=-1, keepdims=True)
    return np.stack([np.cross(east, down), east, down], axis=-2)


def direct_matrix(force_body_mps2: np.ndarray, rate_body_radps: np.ndarray, site: Site) -> np.ndarray:
    """Matrix of the published direct form with its signs mended; not orthonormal.

    Parameters
    ----------
    force_body_mps2, rate_body_radps : ndarray, shape (..., 3)
        Means at rest.
    site : Site
        Where.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        North, east, down from body, nearly.
    """
    force, rate = site.force_ned_mps2, site.earth_rate_ned_radps
    known = np.stack([force, rate, np.cross(force, rate)], axis=-1)
    measured = np.stack(
        [force_body_mps2, rate_body_radps, np.cross(force_body_mps2, rate_body_radps)], axis=-2
    )
    return np.linalg.inv(known).T @ measured


def align_static(
    increments: InertialIncrements,
    site: Site,
    *,
    errors: ImuDescription | None = None,
    form: Literal["orthonormal", "published"] = "orthonormal",
    running: bool = True,
) -> NorthSolution:
    """Attitude of a platform at rest from the means of gyros and accelerometers.

    Parameters
    ----------
    increments : InertialIncrements
        n intervals; the body does not move.
    site : Site
        Where.
    errors : ImuDescription, optional
        Errors of the sensor, for covariance and budget. Without them the covariance is that of the noise seen
        in the data alone.
    form : {"orthonormal", "published"}
        Gravity exact, or the published direct form. Of the latter the attitude is the rotation nearest to its
        matrix; the angles as published are ``published_heading_deg``, ``_pitch_deg`` and ``_roll_deg`` of
        `measured`.
    running : bool
        Whether to keep the estimate after every second (after every twentieth of a record under 20 s).

    Returns
    -------
    NorthSolution
        `measured` holds ``gravity_mps2``, ``earth_rate_dph``, ``horizontal_rate_dph``, ``latitude_deg`` (what
        the angle between the vectors says), and of the published form ``non_orthonormality`` (Frobenius norm
        of its matrix times its transpose less the identity).

    Raises
    ------
    NoSolutionError
        If there are no data, or rate and force do not span a plane.
    """
    if form not in ("orthonormal", "published"):
        raise ConfigError(
            f'the form of the static alignment is {form!r}; give "orthonormal" or "published"',
            key="form",
            value=form,
        )
    edge = _edges(increments.time_s)
    elapsed = increments.time_s[edge] - increments.time_s[0]
    force, rate = (
        np.cumsum(rows, axis=0)[edge - 1] / elapsed[:, None]
        for rows in (increments.velocity_mps, increments.angle_rad)
    )
    _check(force[-1], rate[-1])
    attitude = two_vector_attitude(force, rate)
    measured = _measured(force[-1], rate[-1])
    if form == "published":
        matrix = direct_matrix(force, rate, site)
        measured |= _published_angles(matrix[-1])
        u, _, vt = np.linalg.svd(matrix)
        u[..., 2] *= np.linalg.det(u @ vt)[:, None]
        attitude = u @ vt
    rot = attitude[-1]

    notes: tuple[str, ...] = ()
    budget = None
    if errors is None:
        by_gyro = gyro_sensitivity(rot, site, form=form)
        by_force = accelerometer_sensitivity(rot, site, form=form)
        cov = _seen_covariance(np.hstack([rate, force]), elapsed, np.hstack([by_gyro, by_force]))
        notes = (
            "The errors of the sensor were not stated: sigma covers only the noise seen in the data; a gyro"
            f" bias of 1 deg/h towards east would turn north by"
            f" {np.degrees(DPH_RADPS / site.horizontal_rate_radps):.2g} deg.",
        )
        if len(edge) < LEAST_BLOCKS:
            notes += ("The record has too few samples to show its noise, so sigma is not known.",)
    else:
        budget = static_budget(errors, rot, site, float(elapsed[-1]), form=form)
        cov = covariance_after(errors, rot, site, elapsed, form=form)
    rocked = _rocking_rad(increments, site, rot)
    if rocked > 0.0:
        rocking = np.diag([0.0, 0.0, rocked**2])
        cov[-1] += rocking
        words = f"{np.degrees(rocked):.2g} deg"
        notes += (
            f"The body did not stand still: an alignment in the inertial frame, which survives rocking, is"
            f" {words} away from these averages; take its heading.",
        )
        if budget is not None:
            line = BudgetLine("rocking of the body", words, rocking)
            budget = ErrorBudget((line, *budget.lines), budget.rot_ned_from_body)
    cov = wrapped_covariance(rot, cov)
    run = None
    if running:
        angles_rad = np.stack(heading_pitch_roll(attitude), axis=-1)
        run = NorthRun(increments.time_s[edge], angles_rad, angle_deviations(rot[None], cov))
    return NorthSolution(
        method="static" if form == "orthonormal" else "static-published",
        site=site,
        time_s=float(increments.time_s[-1]),
        duration_s=float(elapsed[-1]),
        rot_ned_from_body=rot,
        cov_ned_rad2=cov[-1],
        measured=measured,
        run=run,
        budget=budget,
        notes=notes,
    )


def _edges(time_s: np.ndarray) -> np.ndarray:
    """Indices of the edges at every whole second since the start, and of the last one."""
    elapsed = np.asarray(time_s) - time_s[0] if len(time_s) else np.zeros(0)
    if len(elapsed) < 2 or not elapsed[-1] > 0.0:
        raise NoSolutionError(
            "averaging gyros and accelerometers: the record holds no samples; give at least a minute at rest"
        )
    step_s = min(1.0, float(elapsed[-1]) / 20.0)
    instants = step_s * np.arange(1, int(elapsed[-1] / step_s + 1e-6) + 1)
    edge = np.unique(np.searchsorted(elapsed, instants + 1e-6 * step_s, side="right") - 1)
    return np.append(edge[(edge > 0) & (edge < len(elapsed) - 1)], len(elapsed) - 1)


def _rocking_rad(increments: InertialIncrements, site: Site, rot_ned_from_body: np.ndarray) -> float:
    """Turn about the vertical against an alignment that survives rocking; 0 where noise explains it.

    A body that ends tilted by an angle against its start adds angle / time to the mean rate. The alignment in
    the inertial frame feels no such thing, and has the same biases.
    """
    try:
        other = align_inertial(increments, site, running=False)
    except NoSolutionError:
        return 0.0
    off = float(log_so3(rot_ned_from_body @ other.rot_ned_from_body.T)[2])
    noise = float(np.sqrt(other.cov_ned_rad2[2, 2]))
    return abs(off) if abs(off) > max(ROCKING_SIGMAS * noise, LEAST_ROCKING_RAD) else 0.0


def _check(force: np.ndarray, rate: np.ndarray) -> None:
    """Refuse means that no attitude follows from."""
    if not np.all(np.isfinite(np.concatenate([force, rate]))):
        raise NoSolutionError(
            "averaging gyros and accelerometers: the record holds values that are no numbers; cut them out"
        )
    size, turn = float(np.linalg.norm(force)), float(np.linalg.norm(rate))
    if size == 0.0 or turn == 0.0:
        silent = "accelerometers" if size == 0.0 else "gyros"
        raise NoSolutionError(
            f"averaging gyros and accelerometers: the {silent} say zero throughout; check columns and units"
        )
    # A hundredth of a degree: the pole itself is refused at a tenth.
    if np.linalg.norm(np.cross(force, rate)) < np.radians(0.01) * size * turn:
        raise NoSolutionError(
            "averaging gyros and accelerometers: the rate felt is about the vertical alone, so there is no"
            " north in it; check the axes, and that the platform stands still"
        )


def _measured(force: np.ndarray, rate: np.ndarray) -> dict[str, float]:
    """What the means say of themselves."""
    up = force / np.linalg.norm(force)
    vertical = float(up @ rate)
    turn = float(np.linalg.norm(rate))
    return {
        "gravity_mps2": float(np.linalg.norm(force)),
        "earth_rate_dph": turn / DPH_RADPS,
        "horizontal_rate_dph": float(np.linalg.norm(np.cross(up, rate))) / DPH_RADPS,
        "latitude_deg": float(np.degrees(np.arcsin(np.clip(vertical / turn, -1.0, 1.0)))),
    }


def _published_angles(matrix: np.ndarray) -> dict[str, float]:
    """Angles from the elements of a matrix that is not orthonormal, as published, and how far it is off."""
    return {
        "non_orthonormality": float(np.linalg.norm(matrix @ matrix.T - np.eye(3))),
        "published_heading_deg": float(np.degrees(np.arctan2(matrix[1, 0], matrix[0, 0])) % 360.0),
        "published_pitch_deg": float(
            np.degrees(np.arctan2(-matrix[2, 0], np.hypot(matrix[2, 1], matrix[2, 2])))
        ),
        "published_roll_deg": float(np.degrees(np.arctan2(matrix[2, 1], matrix[2, 2]))),
    }


def _seen_covariance(means: np.ndarray, elapsed_s: np.ndarray, by_mean: np.ndarray) -> np.ndarray:
    """Covariance of the attitude from the scatter of the seconds, up to each, shape (k, 3, 3).

    Seconds are taken as independent; what stays the same over the record does not show.

    Parameters
    ----------
    means : ndarray, shape (k, 6)
        Means of rate and force up to each instant.
    elapsed_s : ndarray, shape (k,)
        The instants.
    by_mean : ndarray, shape (3, 6)
        Attitude error by an error of the means.
    """
    width = np.diff(elapsed_s, prepend=0.0)
    total = means * elapsed_s[:, None]
    second = np.diff(total, axis=0, prepend=np.zeros((1, 6))) / width[:, None]
    # White noise: the variance of each, times its width, is the density.
    off = (second - means[-1]) @ by_mean.T
    square = np.cumsum(width[:, None, None] * off[:, :, None] * off[:, None, :], axis=0)
    centre = (means - means[-1]) @ by_mean.T
    count = np.arange(1, len(width) + 1)[:, None, None]
    spread = square - elapsed_s[:, None, None] * centre[:, :, None] * centre[:, None, :]
    with np.errstate(invalid="ignore", divide="ignore"):
        cov = spread / (count - 1) / elapsed_s[:, None, None]
    # Data without any noise leave rounding errors of either sign.
    cov[np.diagonal(spread, axis1=1, axis2=2).min(axis=1) < 0.0] = 0.0
    cov[: LEAST_BLOCKS - 1] = np.nan
    return np.asarray(cov)
