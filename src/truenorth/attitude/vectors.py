r"""Attitude of a rigid array from its measured vectors: weighted least squares on the rotation group.

The vectors run from one antenna to each other one. With body coordinates l_i and measured vectors b_i in
north, east, down,

    b_i = R l_i + e_i,      Cov(e) = C + (I x R) C_l (I x R)^T,

where C is the whole covariance of all vectors of the epoch: they share the reference antenna and the
satellites. C_l is that of the body coordinates. Each step turns R by a small vector p,
R <- exp([p]x) R, until p vanishes; the start is the solution of Wahba's problem by singular values. The
normal matrix of p gives the covariance of the angles, to first order: where one direction of the vectors is
known to a twentieth of their length only, errors are larger than it by a tenth.

References
----------
P. J. G. Teunissen, "The affine constrained GNSS attitude model and its multivariate integer least-squares
solution", Journal of Geodesy 86 (2012); F. L. Markley, "Attitude determination using vector observations
and the singular value decomposition", Journal of the Astronautical Sciences 36 (1988); J. L. Crassidis,
F. L. Markley, Y. Cheng, "Survey of nonlinear attitude estimation methods", Journal of Guidance, Control,
and Dynamics 30 (2007); C. Wang, G. Lachapelle, "GPS attitude determination reliability performance
improvement using low cost receivers", Journal of Global Positioning Systems 1 (2002).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..rotations import exp_so3, heading_pitch_roll, rot_ned_from_body, skew

__all__ = [
    "RotationFit",
    "angle_covariance",
    "angle_jacobian",
    "array_extent_m",
    "fit_rotation",
    "mirrored_rotation",
    "shared_reference_covariance",
    "total_covariance",
    "turned_covariance",
    "wahba_rotation",
    "weighted_square",
]

MAX_STEPS = 20
GAUSS_NEWTON_STEPS = 4
"""Vectors that fit have converged by then; the others go on with the bend of the rotation."""

STEP_LIMIT_RAD = 1e-10
"""Below a hundredth of a nanoradian nothing changes that could be measured."""

CONVERGED_RAD = 1e-6
"""Vectors that contradict each other converge slowly; a step below a fifth of an arc second will do."""

LONGEST_STEP_RAD = 0.5
"""A longer step has left the region in which the vectors are linear in the turn."""


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
    chi2 : ndarray, shape (n,)
        Weighted sum of squares of the residuals: 3 k - 3 degrees of freedom, 3 k - 2 on a line.
    is_converged : ndarray of bool, shape (n,)
        Whether the steps died out.
    """

    rot_ned_from_body: np.ndarray
    cov_ned_rad2: np.ndarray
    residual_m: np.ndarray
    chi2: np.ndarray
    is_converged: np.ndarray


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


def fit_rotation(
    vector_ned_m, cov_ned_m2, body_m, *, body_cov_m2=None, free_axis_body=None, start_ned_from_body=None
):
    """Best rotation of a rigid array, with the whole covariance of its vectors.

    Parameters
    ----------
    vector_ned_m : ndarray, shape (n, k, 3)
        Measured vectors from one antenna, metres.
    cov_ned_m2 : ndarray, shape (n, 3 k, 3 k)
        Their joint covariance, positive definite.
    body_m : ndarray, shape (k, 3)
        The same vectors in the body frame.
    body_cov_m2 : ndarray, shape (3 k, 3 k), optional
        Joint covariance of these; exact where omitted. It turns with the attitude and is taken along in
        the iteration.
    free_axis_body : ndarray, shape (3,), optional
        Unit vector of the line on which all antennas stand, near the x axis. The rotation about it cannot
        be observed: it stays as it is at the start, with roll 0.
    start_ned_from_body : ndarray, shape (n, 3, 3), optional
        Where the iteration starts; by default the solution of Wahba's problem.

    Returns
    -------
    RotationFit
        With `free_axis_body`, variances of turns about that axis mean nothing.
    """
    n, k = vector_ned_m.shape[:2]
    if start_ned_from_body is not None:
        rot = start_ned_from_body.copy()
    elif free_axis_body is None:
        variance = np.einsum("nii->ni", cov_ned_m2).reshape(n, k, 3).sum(-1)
        rot = wahba_rotation(vector_ned_m, body_m, 1.0 / variance)
    else:
        rot = _point_along(np.einsum("nki,k->ni", vector_ned_m, body_m @ free_axis_body))
    if body_cov_m2 is not None and _is_same_all_round(body_cov_m2):
        cov_ned_m2, body_cov_m2 = cov_ned_m2 + body_cov_m2, None
    fixed = _whitener(cov_ned_m2) if body_cov_m2 is None else None
    normal = np.empty((n, 3, 3))
    live = np.arange(n)
    near = np.zeros(n, bool)
    for count in range(MAX_STEPS):
        turned = rot[live]
        if fixed is None:
            white = _whitener(total_covariance(cov_ned_m2[live], turned, body_cov_m2))
        else:
            white = fixed[live] if len(live) < n else fixed
        fitted = np.einsum("nij,kj->nki", turned, body_m)
        misfit = white @ (vector_ned_m[live] - fitted).reshape(len(live), 3 * k, 1)
        design = white @ -skew(fitted).reshape(len(live), 3 * k, 3)
        upside = np.swapaxes(design, 1, 2)
        own = upside @ design
        if free_axis_body is not None:
            axis = turned @ free_axis_body
            size = np.trace(own, axis1=1, axis2=2)[:, None, None]
            own += size * axis[:, :, None] * axis[:, None, :]
        if count < GAUSS_NEWTON_STEPS:
            step = np.linalg.solve(own, upside @ misfit)[..., 0]
        else:
            step = _downhill(own + _second_order(white, misfit, fitted), upside @ misfit)
        length = np.sqrt(np.sum(step * step, axis=1))
        step *= np.minimum(1.0, LONGEST_STEP_RAD / np.maximum(length, LONGEST_STEP_RAD))[:, None]
        rot[live] = exp_so3(step) @ turned
        normal[live] = own
        near[live] = length < CONVERGED_RAD
        live = live[length >= STEP_LIMIT_RAD]
        if len(live) == 0:
            break
    residual_m = vector_ned_m - np.einsum("nij,kj->nki", rot, body_m)
    if fixed is None:
        fixed = _whitener(total_covariance(cov_ned_m2, rot, body_cov_m2))
    white = fixed @ residual_m.reshape(n, 3 * k, 1)
    return RotationFit(rot, np.linalg.inv(normal), residual_m, np.sum(white**2, axis=(1, 2)), near)


def _second_order(white, misfit, fitted):
    """What the bend of a rotation adds to the normal matrix: sum g.y I - (g y^T + y g^T) / 2, g = C^-1 e.

    exp([p]x) y = y + p x y + p x (p x y) / 2. It matters where a weakly measured direction leaves errors as
    large as the tilt itself.
    """
    n, k, _ = fitted.shape
    force = (np.swapaxes(white, 1, 2) @ misfit).reshape(n, k, 3)
    mixed = np.einsum("nki,nkj->nij", force, fitted)
    size = np.trace(mixed, axis1=1, axis2=2)[:, None, None]
    return size * np.eye(3) - 0.5 * (mixed + np.swapaxes(mixed, 1, 2))


def _downhill(curvature, slope):
    """Steps that lead down, also where the curvature is negative or nearly none."""
    value, axes = np.linalg.eigh(curvature)
    value = np.maximum(np.abs(value), 1e-6 * np.max(np.abs(value), axis=1, keepdims=True))
    return np.einsum("nij,nj->ni", axes, np.einsum("nji,nj->ni", axes, slope[..., 0]) / value)


def shared_reference_covariance(cov_ned_m2):
    """Joint covariance of vectors that were solved one by one from the same reference antenna.

    Half of the variance of every vector is that of the reference antenna, which all of them share. With
    P_i = L_i L_i^T (Cholesky) the cross covariance of two is L_i L_j^T / 2, which is exact for alike
    receivers under the same satellites.

    Parameters
    ----------
    cov_ned_m2 : ndarray, shape (..., k, 3, 3)
        Covariance of each vector.

    Returns
    -------
    ndarray, shape (..., 3 k, 3 k)
        Positive definite.
    """
    factor = np.linalg.cholesky(cov_ned_m2)
    *lead, k, _, _ = factor.shape
    joint = 0.5 * np.einsum("...iab,...jcb->...iajc", factor, factor)
    for i in range(k):
        joint[..., i, :, i, :] = cov_ned_m2[..., i, :, :]
    return joint.reshape(*lead, 3 * k, 3 * k)


def total_covariance(cov_ned_m2, rot_ned_from_body, body_cov_m2):
    """Joint covariance of measured less fitted vectors: that of the body coordinates turned and added.

    Parameters
    ----------
    cov_ned_m2 : ndarray, shape (n, 3 k, 3 k)
        Of the measured vectors.
    rot_ned_from_body : ndarray, shape (n, 3, 3)
        Attitude.
    body_cov_m2 : ndarray, shape (3 k, 3 k)
        Of the same vectors in the body frame.

    Returns
    -------
    ndarray, shape (n, 3 k, 3 k)
    """
    return cov_ned_m2 + turned_covariance(body_cov_m2, rot_ned_from_body)


def turned_covariance(cov_m2, rot):
    """Joint covariance of vectors after all of them were turned.

    Parameters
    ----------
    cov_m2 : ndarray, shape (3 k, 3 k) or (n, 3 k, 3 k)
        Before the turn.
    rot : ndarray, shape (n, 3, 3)
        Rotations.

    Returns
    -------
    ndarray, shape (n, 3 k, 3 k)
    """
    k = cov_m2.shape[-1] // 3
    blocks = np.swapaxes(cov_m2.reshape(-1, k, 3, k, 3), 2, 3)
    turned = rot[:, None, None] @ blocks @ np.swapaxes(rot, 1, 2)[:, None, None]
    return np.swapaxes(turned, 2, 3).reshape(len(rot), 3 * k, 3 * k)


def weighted_square(residual_m, cov_ned_m2):
    """Sum of squares of the residuals in the metric of their joint covariance.

    Parameters
    ----------
    residual_m : ndarray, shape (n, k, 3)
        Residuals of the vectors of an epoch.
    cov_ned_m2 : ndarray, shape (n, 3 k, 3 k)
        Their joint covariance.

    Returns
    -------
    ndarray, shape (n,)
        Chi-square of 3 k - 3 degrees of freedom after three angles were estimated.
    """
    n = len(residual_m)
    white = np.linalg.solve(np.linalg.cholesky(cov_ned_m2), residual_m.reshape(n, -1, 1))
    return np.sum(white**2, axis=(1, 2))


def mirrored_rotation(rot_ned_from_body, body_m, direction_ned):
    """Attitude whose vectors are the mirror images, at a plane, of those of another attitude.

    With M the mirror at the plane in which the antennas stand, which leaves them where they are, and S the
    one at the plane across `direction_ned`, S R M is a rotation and gives S (R l) for every vector. Where
    that direction is not measured, both fit alike.

    Parameters
    ----------
    rot_ned_from_body : ndarray, shape (n, 3, 3)
        Attitude.
    body_m : ndarray, shape (k, 3)
        Vectors of the array; one with height is mirrored at the plane that fits it best.
    direction_ned : ndarray, shape (n, 3)
        Unit vectors.

    Returns
    -------
    ndarray, shape (n, 3, 3)
    """
    flat = np.linalg.svd(np.vstack([body_m, np.zeros((2, 3))]))[2][2]
    mirror = np.eye(3) - 2.0 * np.outer(flat, flat)
    turned = rot_ned_from_body @ mirror
    across = np.einsum("ni,nij->nj", direction_ned, turned)
    return turned - 2.0 * direction_ned[:, :, None] * across[:, None, :]


def angle_jacobian(rot_ned_from_body):
    """Derivatives of heading, pitch and roll by a small turn of the attitude in north, east, down.

    A small turn is the sum of turns about three axes: heading about down, pitch about the horizontal
    axis to the right of the heading, roll about the forward axis of the body.

    Parameters
    ----------
    rot_ned_from_body : ndarray, shape (n, 3, 3)
        Attitude.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        Rows heading, pitch, roll; not finite where the nose points straight up or down.
    """
    heading_rad, pitch_rad, _ = heading_pitch_roll(rot_ned_from_body)
    sh, ch = np.sin(heading_rad), np.cos(heading_rad)
    with np.errstate(divide="ignore", invalid="ignore"):
        tangent, secant = np.tan(pitch_rad), 1.0 / np.cos(pitch_rad)
    jacobian = np.zeros((*np.shape(heading_rad), 3, 3))
    jacobian[..., 0, 0], jacobian[..., 0, 1], jacobian[..., 0, 2] = ch * tangent, sh * tangent, 1.0
    jacobian[..., 1, 0], jacobian[..., 1, 1] = -sh, ch
    jacobian[..., 2, 0], jacobian[..., 2, 1] = ch * secant, sh * secant
    return jacobian


def angle_covariance(rot_ned_from_body, cov_ned_rad2):
    """Covariance of heading, pitch and roll from that of a small rotation in north, east, down.

    Parameters
    ----------
    rot_ned_from_body : ndarray, shape (n, 3, 3)
        Attitude.
    cov_ned_rad2 : ndarray, shape (n, 3, 3)
        Covariance of the turn.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        Heading, pitch, roll; radians squared.
    """
    jacobian = angle_jacobian(rot_ned_from_body)
    return jacobian @ cov_ned_rad2 @ np.swapaxes(jacobian, -1, -2)


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


def _whitener(cov_m2):
    """Inverse Cholesky factors."""
    return np.linalg.inv(np.linalg.cholesky(cov_m2))


def _is_same_all_round(body_cov_m2):
    """Whether every block of two vectors is a multiple of the unit matrix, which no rotation changes."""
    k = len(body_cov_m2) // 3
    blocks = body_cov_m2.reshape(k, 3, k, 3)
    own = np.einsum("kala->kl", blocks) / 3.0
    apart = blocks - own[:, None, :, None] * np.eye(3)[None, :, None, :]
    return np.max(np.abs(apart)) <= 1e-12 * np.max(np.abs(own), initial=0.0)


def _point_along(direction_ned):
    """Rotations with roll 0 whose forward axis has a direction."""
    north, east, down = np.moveaxis(direction_ned, -1, 0)
    pitch = np.arctan2(-down, np.hypot(north, east))
    return rot_ned_from_body(np.arctan2(east, north), pitch, np.zeros_like(pitch))
