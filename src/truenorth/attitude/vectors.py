r"""Attitude of a rigid array from its measured vectors: weighted least squares on the rotation group.

The vectors run from the reference antenna to each other one. With body coordinates l_i and measured
vectors b_i in north, east, down,

    b_i = R l_i + e_i,      Cov(e_i, e_j) = L_i L_j^T / 2 (i != j),   Cov(e_i) = P_i = L_i L_i^T.

Half of the variance of every vector is that of the reference antenna, which all of them share; with
alike receivers under the same satellites the P_i are equal and the cross covariance P / 2 is exact.
Each step turns R by a small vector p, R <- exp([p]x) R, until p vanishes; the start is the solution of
Wahba's problem by singular values. The normal matrix of p gives the covariance of the angles.

References
----------
F. L. Markley, "Attitude determination using vector observations and the singular value decomposition",
Journal of the Astronautical Sciences 36 (1988); J. L. Crassidis, F. L. Markley, Y. Cheng, "Survey of
nonlinear attitude estimation methods", Journal of Guidance, Control, and Dynamics 30 (2007); C. Wang,
G. Lachapelle, "GPS attitude determination reliability performance improvement using low cost
receivers", Journal of Global Positioning Systems 1 (2002).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..rotations import exp_so3, rot_ned_from_body, skew

__all__ = [
    "RotationFit",
    "angle_covariance",
    "array_extent_m",
    "fit_rotation",
    "wahba_rotation",
    "weighted_square",
]

MAX_STEPS = 12
STEP_LIMIT_RAD = 1e-10
"""Below a hundredth of a nanoradian nothing changes that could be measured."""


class RotationFit(NamedTuple):
    """Rotations that fit n sets of vectors best.

    Parameters
    ----------
    rot_ned_from_body : ndarray, shape (n, 3, 3)
        Attitude.
    cov_ned_rad2 : ndarray, shape (n, 3, 3)
        Covariance of its small rotation in north, east, down.
    residual_m : ndarray, shape (n, k, 3)
        Measured less fitted vectors.
    """

    rot_ned_from_body: np.ndarray
    cov_ned_rad2: np.ndarray
    residual_m: np.ndarray


def wahba_rotation(vector_ned_m, body_m, weight):
    """Rotation that minimises the weighted sum of squared distances, by singular values.

    Parameters
    ----------
    vector_ned_m : ndarray, shape (n, k, 3)
        Measured vectors.
    body_m : ndarray, shape (k, 3)
        The same vectors in the body frame; not all on one line.
    weight : ndarray, shape (n, k)
        Weight of each vector.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        Proper rotations: mirror images are excluded, also for an array in one plane.
    """
    profile = np.einsum("nk,nki,kj->nij", weight, vector_ned_m, body_m)
    u, _, vt = np.linalg.svd(profile)
    u[..., 2] *= (np.linalg.det(u) * np.linalg.det(vt))[:, None]
    return u @ vt


def fit_rotation(vector_ned_m, cov_ned_m2, body_m, *, free_axis_body=None):
    """Best rotation of a rigid array, with the correlation of the shared reference antenna.

    Parameters
    ----------
    vector_ned_m : ndarray, shape (n, k, 3)
        Measured vectors from the reference antenna, metres.
    cov_ned_m2 : ndarray, shape (n, k, 3, 3)
        Covariance of each.
    body_m : ndarray, shape (k, 3)
        The same vectors in the body frame.
    free_axis_body : ndarray, shape (3,), optional
        Unit vector of the line on which all antennas stand, near the x axis. The rotation about it cannot
        be observed: it stays as it is at the start, with roll 0.

    Returns
    -------
    RotationFit
        With `free_axis_body`, variances of turns about that axis mean nothing.
    """
    factor = np.linalg.inv(np.linalg.cholesky(cov_ned_m2))
    if free_axis_body is None:
        weight = 1.0 / np.einsum("nkii->nk", cov_ned_m2)
        rot = wahba_rotation(vector_ned_m, body_m, weight)
    else:
        rot = _point_along(np.einsum("nki,k->ni", vector_ned_m, body_m @ free_axis_body))
    for _ in range(MAX_STEPS):
        fitted = np.einsum("nij,kj->nki", rot, body_m)
        misfit = np.einsum("nkij,nkj->nki", factor, vector_ned_m - fitted)
        design = factor @ -skew(fitted)
        normal = _joint_product(design, design)
        rhs = _joint_product(design, misfit[..., None])
        if free_axis_body is not None:
            axis = rot @ free_axis_body
            size = np.trace(normal, axis1=1, axis2=2)[:, None, None]
            normal += size * axis[:, :, None] * axis[:, None, :]
        step = np.linalg.solve(normal, rhs)[..., 0]
        rot = exp_so3(step) @ rot
        if np.max(np.abs(step), initial=0.0) < STEP_LIMIT_RAD:
            break
    return RotationFit(rot, np.linalg.inv(normal), vector_ned_m - np.einsum("nij,kj->nki", rot, body_m))


def weighted_square(residual_m, cov_ned_m2):
    """Sum of squares of the residuals in the metric of their joint covariance.

    Parameters
    ----------
    residual_m : ndarray, shape (n, k, 3)
        Residuals of vectors that share their first antenna.
    cov_ned_m2 : ndarray, shape (n, k, 3, 3)
        Covariance of each vector.

    Returns
    -------
    ndarray, shape (n,)
        Chi-square of 3 k - 3 degrees of freedom after three angles were estimated.
    """
    white = np.linalg.solve(np.linalg.cholesky(cov_ned_m2), residual_m[..., None])
    return _joint_product(white, white)[:, 0, 0]


def angle_covariance(heading_rad, rot_ned_from_body, cov_ned_rad2):
    """Covariance of heading, pitch and roll from that of a small rotation in north, east, down.

    A small turn is the sum of turns about three axes: heading about down, pitch about the horizontal
    axis to the right of the heading, roll about the forward axis of the body.

    Parameters
    ----------
    heading_rad : ndarray, shape (n,)
        Heading.
    rot_ned_from_body : ndarray, shape (n, 3, 3)
        Attitude.
    cov_ned_rad2 : ndarray, shape (n, 3, 3)
        Covariance of the turn.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        Heading, pitch, roll; radians squared.
    """
    zero = np.zeros_like(heading_rad)
    down = np.stack([zero, zero, zero + 1.0], axis=-1)
    right = np.stack([-np.sin(heading_rad), np.cos(heading_rad), zero], axis=-1)
    axes = np.stack([down, right, rot_ned_from_body[..., 0]], axis=-1)
    inverse = np.linalg.inv(axes)
    return inverse @ cov_ned_rad2 @ np.swapaxes(inverse, -1, -2)


def array_extent_m(body_m):
    """Extent of antennas along and across the line that fits them best.

    Parameters
    ----------
    body_m : ndarray, shape (k, 3)
        Vectors from the reference antenna in the body frame.

    Returns
    -------
    along, across : float
        Root sums of squares of the coordinates along the line through the reference antenna and across
        it, metres.
    axis_body : ndarray, shape (3,)
        Unit vector of the line, forward.
    """
    _, size, axes = np.linalg.svd(np.vstack([body_m, np.zeros((2, 3))]))
    axis = axes[0] * (1.0 if axes[0, np.argmax(np.abs(axes[0]))] > 0.0 else -1.0)
    return size[0], size[1], axis


def _joint_product(left, right):
    """Sum over whitened vectors A^T C^-1 B, where C = (I + 11^T) / 2 ties them by their first antenna."""
    own = np.einsum("nkai,nkaj->nij", left, right)
    shared = np.einsum("nai,naj->nij", left.sum(1), right.sum(1))
    return 2.0 * (own - shared / (left.shape[1] + 1))


def _point_along(direction_ned):
    """Rotations with roll 0 whose forward axis has a direction."""
    north, east, down = np.moveaxis(direction_ned, -1, 0)
    pitch = np.arctan2(-down, np.hypot(north, east))
    return rot_ned_from_body(np.arctan2(east, north), pitch, np.zeros_like(pitch))
