r"""How errors of positions become errors of angles: the chain of Landfahrer (2009), step by step.

Three antennas with positions in an earth-fixed frame and in the body frame, both with full covariances:

    differences     u = P2 - P1, v = P3 - P1: the common point keeps them correlated
    local level     Sigma_l = D^T Sigma_e D
    cross product   w = u x v, with the Jacobian (3.31)
    matrices        L = [u v w], B likewise; nothing of the correlation of w is lost
    rotation        vec(dR) = (L^-T x I) vec(dB) - (L^-T x R) vec(dL),   R = B L^-1
    angles          (3.18-3.20) differentiated

Each step is a Jacobian that can be used alone with `propagate`; `three_antenna_chain` does all of them and
keeps what comes out on the way. Only the third step is printed in the source. The closed form for two
baselines of given lengths (3.35-3.36) is `baseline_length_model`.

References
----------
K. Landfahrer, "Attitude determination using a GPS multi antenna array", Graz University of Technology
(2009), sections 3.2 and 3.3; J. A. Farrell, M. Barth, "The global positioning system and inertial
navigation" (1999).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..errors import ConfigError
from ..frames import rot_ned_from_ecef
from ..rotations import skew
from .conventions import angles_213, local_axes

__all__ = [
    "BaselineLengthModel",
    "ErrorChain",
    "angles_213_jacobian",
    "baseline_length_model",
    "columns_jacobian",
    "cross_product_jacobian",
    "difference_jacobian",
    "local_level_jacobian",
    "matrix_jacobians",
    "propagate",
    "three_antenna_chain",
]


@dataclass(frozen=True, slots=True, eq=False)
class ErrorChain:
    """Covariances on the way from positions to angles; leading axes are those of the given covariances.

    Parameters
    ----------
    rot_body_from_local : ndarray, shape (3, 3)
        R = B L^-1 in the axes of the convention.
    angle_rad : ndarray, shape (3,)
        Roll, pitch, yaw of the convention ``enu-rfu``: heading = -yaw.
    cov_differences_m2 : ndarray, shape (..., 6, 6)
        Of u and v in the earth-fixed frame, or in the local one where positions were given in it.
    cov_local_m2, cov_body_m2 : ndarray, shape (..., 6, 6)
        Of u and v in the local and in the body frame.
    cov_cross_local_m4, cov_cross_body_m4 : ndarray, shape (..., 3, 3)
        Of w.
    cov_l, cov_b : ndarray, shape (..., 9, 9)
        Of the columns of L and B, one after the other.
    cov_rot : ndarray, shape (..., 9, 9)
        Of the columns of R.
    cov_rad2 : ndarray, shape (..., 3, 3)
        Of roll, pitch, yaw.
    """

    rot_body_from_local: np.ndarray
    angle_rad: np.ndarray
    cov_differences_m2: np.ndarray
    cov_local_m2: np.ndarray
    cov_body_m2: np.ndarray
    cov_cross_local_m4: np.ndarray
    cov_cross_body_m4: np.ndarray
    cov_l: np.ndarray
    cov_b: np.ndarray
    cov_rot: np.ndarray
    cov_rad2: np.ndarray

    @property
    def sd_rad(self) -> np.ndarray:
        """Ndarray, shape (..., 3): standard deviations of roll, pitch, yaw."""
        return np.sqrt(np.diagonal(self.cov_rad2, axis1=-2, axis2=-1))


class BaselineLengthModel(NamedTuple):
    """Standard deviations of the angles, radians.

    Parameters
    ----------
    roll_rad, pitch_rad, yaw_rad : float or ndarray
    """

    roll_rad: Any
    pitch_rad: Any
    yaw_rad: Any


def propagate(jacobian, cov):
    """Covariance of linear functions: J Sigma J^T (3.28).

    Parameters
    ----------
    jacobian : ndarray, shape (..., p, q)
    cov : ndarray, shape (..., q, q)

    Returns
    -------
    ndarray, shape (..., p, p)
    """
    return jacobian @ cov @ np.swapaxes(jacobian, -1, -2)


def difference_jacobian(pairs, n_points):
    """Jacobian of coordinate differences by the coordinates of all points.

    Parameters
    ----------
    pairs : sequence of (int, int)
        Points from which and to which each vector runs.
    n_points : int
        Points in all.

    Returns
    -------
    ndarray, shape (3 k, 3 n_points)
    """
    jump = np.zeros((len(pairs), n_points))
    for row, (first, last) in enumerate(pairs):
        jump[row, first] -= 1.0
        jump[row, last] += 1.0
    return np.kron(jump, np.eye(3))


def local_level_jacobian(latitude_rad, longitude_rad, n_vectors, *, convention="ned-frd"):
    """Jacobian of vectors in the local axes of a convention by the same in the earth-fixed frame (3.8).

    Parameters
    ----------
    latitude_rad, longitude_rad : float
        Of the place.
    n_vectors : int
        How many vectors, one after the other.
    convention : str
        See `truenorth.attitude.conventions`; the axes of the thesis are those of ``neu-fru``.

    Returns
    -------
    ndarray, shape (3 n_vectors, 3 n_vectors)
    """
    rot = local_axes(convention) @ rot_ned_from_ecef(latitude_rad, longitude_rad)
    return np.kron(np.eye(n_vectors), rot)


def cross_product_jacobian(u, v):
    """Jacobian of u x v by u and v (3.31).

    Parameters
    ----------
    u, v : ndarray, shape (..., 3)

    Returns
    -------
    ndarray, shape (..., 3, 6)
    """
    return np.concatenate([-skew(v), skew(u)], axis=-1)


def columns_jacobian(u, v):
    """Jacobian of the columns of [u v u x v], one after the other, by u and v.

    Parameters
    ----------
    u, v : ndarray, shape (..., 3)

    Returns
    -------
    ndarray, shape (..., 9, 6)
    """
    cross = cross_product_jacobian(u, v)
    own = np.broadcast_to(np.eye(6), (*cross.shape[:-2], 6, 6))
    return np.concatenate([own, cross], axis=-2)


def matrix_jacobians(local, body):
    """Jacobians of R = B L^-1 by L and by B, all taken column after column.

    Parameters
    ----------
    local, body : ndarray, shape (3, 3)
        L and B.

    Returns
    -------
    by_local, by_body : ndarray, shape (9, 9)
    """
    inverse = np.linalg.inv(local)
    return -np.kron(inverse.T, body @ inverse), np.kron(inverse.T, np.eye(3))


def angles_213_jacobian(rot):
    """Jacobian of roll, pitch and yaw by the columns of R, one after the other (3.18-3.20).

    Parameters
    ----------
    rot : ndarray, shape (3, 3)
        Local to body.

    Returns
    -------
    ndarray, shape (3, 9)
    """
    by_element = np.zeros((3, 3, 3))
    size = rot[0, 2] ** 2 + rot[2, 2] ** 2
    by_element[0, 2, 2], by_element[0, 0, 2] = rot[0, 2] / size, -rot[2, 2] / size
    level = np.hypot(rot[1, 0], rot[1, 1])
    size = level**2 + rot[1, 2] ** 2
    by_element[1, 1, 2] = level / size
    by_element[1, 1, :2] = -rot[1, 2] * rot[1, :2] / (level * size)
    by_element[2, 1, 1], by_element[2, 1, 0] = rot[1, 0] / level**2, -rot[1, 1] / level**2
    return np.swapaxes(by_element, 1, 2).reshape(3, 9)


def three_antenna_chain(
    points_m, cov_points_m2, points_body_m, cov_body_m2, *, latitude_rad=None, longitude_rad=None
):
    """Error of the direct attitude of three antennas, with every step (Landfahrer 2009, section 3.3).

    Parameters
    ----------
    points_m : ndarray, shape (3, 3)
        Positions of the antennas, the common one first: earth-fixed, or east, north, up where no place is
        given.
    cov_points_m2 : ndarray, shape (..., 9, 9)
        Their joint covariance.
    points_body_m : ndarray, shape (3, 3)
        Right, forward, up.
    cov_body_m2 : ndarray, shape (..., 9, 9)
        Joint covariance of these.
    latitude_rad, longitude_rad : float, optional
        Place of the array.

    Returns
    -------
    ErrorChain
        In the convention ``enu-rfu``.
    """
    differences = difference_jacobian([(0, 1), (0, 2)], 3)
    u, v = (differences @ np.ravel(points_m)).reshape(2, 3)
    cov_differences = propagate(differences, np.asarray(cov_points_m2))
    cov_local = cov_differences
    if latitude_rad is not None:
        turn = local_level_jacobian(latitude_rad, longitude_rad, 2, convention="enu-rfu")
        u, v = turn[:3, :3] @ u, turn[:3, :3] @ v
        cov_local = propagate(turn, cov_differences)
    body_u, body_v = (differences @ np.ravel(points_body_m)).reshape(2, 3)
    cov_body = propagate(differences, np.asarray(cov_body_m2))
    local = np.column_stack([u, v, np.cross(u, v)])
    body = np.column_stack([body_u, body_v, np.cross(body_u, body_v)])
    cov_l = propagate(columns_jacobian(u, v), cov_local)
    cov_b = propagate(columns_jacobian(body_u, body_v), cov_body)
    by_local, by_body = matrix_jacobians(local, body)
    cov_rot = propagate(by_local, cov_l) + propagate(by_body, cov_b)
    rot = body @ np.linalg.inv(local)
    return ErrorChain(
        rot_body_from_local=rot,
        angle_rad=np.array(angles_213(rot)),
        cov_differences_m2=cov_differences,
        cov_local_m2=cov_local,
        cov_body_m2=cov_body,
        cov_cross_local_m4=cov_l[..., 6:, 6:],
        cov_cross_body_m4=cov_b[..., 6:, 6:],
        cov_l=cov_l,
        cov_b=cov_b,
        cov_rot=cov_rot,
        cov_rad2=propagate(angles_213_jacobian(rot), cov_rot),
    )


def baseline_length_model(sd_m, along_m, across_m, included_angle_rad, *, elevation_rad=0.0, form="sine"):
    r"""Standard deviations of the angles from the lengths of two baselines (3.35-3.36).

    .. math::
        \sigma_{roll} = \sigma / (b \sin\gamma),\quad \sigma_{pitch} = \sigma / a,\quad
        \sigma_{yaw} = \sigma / (a \cos\Phi)

    Parameters
    ----------
    sd_m : float or ndarray
        Error of each coordinate difference, metres.
    along_m : float or ndarray
        Length a of the baseline ahead.
    across_m : float or ndarray
        Length b of the other one.
    included_angle_rad : float or ndarray
        Angle between them, gamma.
    elevation_rad : float or ndarray
        Elevation Phi of the baseline ahead.
    form : str
        ``sine``: the roll rests on the part of b across a. ``cosine``: as printed, which agrees at 45
        degrees only and fails at 90.

    Returns
    -------
    BaselineLengthModel
    """
    if form not in ("sine", "cosine"):
        raise ConfigError(f"no form `{form}`; give `sine` or `cosine`", key="form", value=form)
    part = np.sin(included_angle_rad) if form == "sine" else np.cos(included_angle_rad)
    sd_m = np.asarray(sd_m, dtype=float)[()]
    return BaselineLengthModel(
        sd_m / (across_m * part), sd_m / along_m, sd_m / (along_m * np.cos(elevation_rad))
    )
