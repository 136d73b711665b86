r"""Attitude from vectors as it has been published, each under its own name.

With L the columns of the measured vectors and B those of the same vectors in the body frame,

    M = B L^+,      L^+ = L^-1  or  L^T (L L^T)^-1,

takes local components to body components (Landfahrer 2009, 3.15 and 3.22). The columns differ:

======================  =================================================================
direct (3.9-3.20)       u, v, u x v
triad (7.1-7.11)        A, v, z  with z = v x u, A along z x v, as long as u is across v
pseudoinverse (3.21)    all vectors, and the cross product of the first two
======================  =================================================================

M is no rotation when the vectors have errors; the angles are read from single elements of it (3.18-3.20).
What is mended: the printed R31 of (3.16) has the wrong sign and makes the matrix no rotation; the printed
yaw runs counter-clockwise and is turned into a heading; the arc tangents take both arguments; all cross
products are formed in right-handed frames, since on the north, east, up of the thesis, which is left-handed,
z would point down in one frame and up in the other. What is kept: no weights, and a cross product in square
metres beside vectors in metres. That costs accuracy, see `truenorth.attitude.vectors` for the alternative.

The implicit least squares of Wang & Lachapelle (2002) solve w = M b - l = 0 for the three angles with the
covariance of the vectors turned into the body frame.

References
----------
K. Landfahrer, "Attitude determination using a GPS multi antenna array", Graz University of Technology
(2009); C. Wang, G. Lachapelle, "GPS attitude determination reliability performance improvement using low
cost receivers", Journal of Global Positioning Systems 1 (2002); F. L. Markley, "Attitude determination using
vector observations and the singular value decomposition", J. Astronautical Sciences 36 (1988); A. J. Pope,
"Some pitfalls to be avoided in the iterative adjustment of nonlinear problems", American Society of
Photogrammetry (1972).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..rotations import heading_pitch_roll, rot_ned_from_body, skew
from .vectors import angle_jacobian, turned_covariance, wahba_rotation

__all__ = [
    "MatrixFit",
    "angles_of_matrix",
    "angles_of_matrix_jacobian",
    "direct_matrix",
    "implicit_least_squares",
    "point_a_distance_m",
    "pseudoinverse_matrix",
    "triad_matrix",
    "wahba_of_points",
]

MAX_STEPS = 20
STEP_LIMIT_RAD = 1e-10


class MatrixFit(NamedTuple):
    """Matrices that take local components to body components, with their derivatives.

    Parameters
    ----------
    rot_body_from_ned : ndarray, shape (n, 3, 3)
        Not quite orthogonal.
    jacobian : ndarray, shape (n, 3, 3, 3 k)
        Derivative of each element by the components of the k measured vectors, where they fit the body
        frame. A change of the body coordinates, turned into the local frame, acts with the opposite sign.
    """

    rot_body_from_ned: np.ndarray
    jacobian: np.ndarray


def direct_matrix(vector_ned_m, body_m):
    """Direct attitude from two vectors and their cross product (Landfahrer 2009, 3.9-3.15).

    Parameters
    ----------
    vector_ned_m : ndarray, shape (n, 2, 3)
        Measured vectors u and v from their common antenna; any right-handed local frame.
    body_m : ndarray, shape (2, 3)
        The same in the body frame, right-handed, not on one line.

    Returns
    -------
    MatrixFit
    """
    return _matrix(*_direct_columns(vector_ned_m), _direct_columns(body_m[None])[0][0])


def triad_matrix(vector_ned_m, body_m):
    """Orthogonal triad of two vectors, with the point A (Landfahrer 2009, 7.1-7.11).

    The second vector v is kept; the first, u, serves for the plane only. A stands across v from the common
    antenna, towards u, in the distance that the body coordinates give. So two angles come from v alone.

    Parameters
    ----------
    vector_ned_m : ndarray, shape (n, 2, 3)
        Measured vectors u and v from their common antenna; any right-handed local frame.
    body_m : ndarray, shape (2, 3)
        The same in the body frame, right-handed, not on one line.

    Returns
    -------
    MatrixFit
    """
    u, v = body_m
    length_m = point_a_distance_m(np.linalg.norm(u), np.linalg.norm(v), np.linalg.norm(v - u))
    return _matrix(
        *_triad_columns(vector_ned_m, length_m), _triad_columns(np.asarray(body_m)[None], length_m)[0][0]
    )


def pseudoinverse_matrix(vector_ned_m, body_m, *, with_cross=True):
    """Attitude from three or more vectors by the pseudoinverse (Landfahrer 2009, 3.21-3.22).

    Parameters
    ----------
    vector_ned_m : ndarray, shape (n, k, 3)
        Measured vectors, also between other antennas than the first one; a right-handed local frame.
    body_m : ndarray, shape (k, 3)
        The same in the body frame, right-handed.
    with_cross : bool
        Append the cross product of the first two, without which antennas in one plane give nothing.

    Returns
    -------
    MatrixFit
    """
    local, derivative = _all_columns(vector_ned_m, with_cross)
    return _matrix(local, derivative, _all_columns(np.asarray(body_m)[None], with_cross)[0][0])


def point_a_distance_m(s12_m, s13_m, s23_m):
    """Distance of the point A from antenna 1, which is that of antenna 2 from the line 1-3 (7.5-7.8).

    Parameters
    ----------
    s12_m, s13_m, s23_m : float
        Sides of the triangle of the antennas.

    Returns
    -------
    float
        Antenna 1 to A, metres.
    """
    s = 0.5 * (s12_m + s13_m + s23_m)
    half_angle = np.arctan(np.sqrt((s - s13_m) * (s - s12_m) / (s * (s - s23_m))))
    return s12_m * np.cos(0.5 * np.pi - 2.0 * half_angle)


def angles_of_matrix(rot_body_from_ned):
    """Heading, pitch and roll from the elements of a matrix that is nearly a rotation (3.18-3.20).

    Parameters
    ----------
    rot_body_from_ned : ndarray, shape (n, 3, 3)
        The rows are the forward, right and down axes of the body.

    Returns
    -------
    ndarray, shape (n, 3)
        Heading in [0, 2 pi), pitch, roll.
    """
    m = rot_body_from_ned
    heading = np.mod(np.arctan2(m[:, 0, 1], m[:, 0, 0]), 2.0 * np.pi)
    pitch = np.arctan2(-m[:, 0, 2], np.hypot(m[:, 0, 0], m[:, 0, 1]))
    return np.stack([heading, pitch, np.arctan2(m[:, 1, 2], m[:, 2, 2])], axis=-1)


def angles_of_matrix_jacobian(rot_body_from_ned):
    """Derivatives of `angles_of_matrix` by the elements.

    Parameters
    ----------
    rot_body_from_ned : ndarray, shape (n, 3, 3)

    Returns
    -------
    ndarray, shape (n, 3, 3, 3)
        Angle, row, column.
    """
    m = rot_body_from_ned
    jacobian = np.zeros((len(m), 3, 3, 3))
    square = m[:, 0, 0] ** 2 + m[:, 0, 1] ** 2
    level = np.sqrt(square)
    jacobian[:, 0, 0, 0], jacobian[:, 0, 0, 1] = -m[:, 0, 1] / square, m[:, 0, 0] / square
    size = square + m[:, 0, 2] ** 2
    for column in (0, 1):
        jacobian[:, 1, 0, column] = m[:, 0, 2] * m[:, 0, column] / (level * size)
    jacobian[:, 1, 0, 2] = -level / size
    size = m[:, 1, 2] ** 2 + m[:, 2, 2] ** 2
    jacobian[:, 2, 1, 2], jacobian[:, 2, 2, 2] = m[:, 2, 2] / size, -m[:, 1, 2] / size
    return jacobian


def wahba_of_points(vector_ned_m, body_m):
    """Rotation of antennas of equal weight about their centre, by singular values.

    The reference antenna is one point among the others. With equal and independent errors at all antennas
    this is the best estimate; the vectors themselves, with equal weights, would count its error k times.

    Parameters
    ----------
    vector_ned_m : ndarray, shape (n, k, 3)
        Measured vectors from the reference antenna.
    body_m : ndarray, shape (k, 3)
        The same in the body frame.

    Returns
    -------
    rot_ned_from_body : ndarray, shape (n, 3, 3)
    jacobian : ndarray, shape (n, 3, 3 k)
        Derivative of the small turn in north, east, down by the components of the vectors.
    """
    n, k = vector_ned_m.shape[:2]
    points = np.concatenate([np.zeros((n, 1, 3)), vector_ned_m], axis=1)
    body = np.vstack([np.zeros(3), body_m])
    body = body - body.mean(0)
    rot = wahba_rotation(points - points.mean(1, keepdims=True), body, np.ones((n, k + 1)))
    inertia = np.sum(body**2) * np.eye(3) - body.T @ body
    arm = skew(np.einsum("nij,kj->nki", rot, body[1:]))
    turned = rot @ np.linalg.inv(inertia) @ np.swapaxes(rot, 1, 2)
    return rot, np.einsum("nij,nkjl->nikl", turned, arm).reshape(n, 3, 3 * k)


def implicit_least_squares(vector_ned_m, cov_ned_m2, body_m, *, body_cov_m2=None):
    """Heading, pitch and roll from w = M b - l = 0 (Wang & Lachapelle 2002; conditions in the body frame).

    The covariance of w is M C M^T, to which the printed form adds nothing; that of the body coordinates is
    added here where it is known. The derivatives are taken at the fitted vectors, not at the measured ones,
    without which the estimate would be biased (Pope 1972). Singular where the nose points straight up or
    down, as angles are.

    Parameters
    ----------
    vector_ned_m : ndarray, shape (n, k, 3)
        Measured vectors b.
    cov_ned_m2 : ndarray, shape (n, 3 k, 3 k)
        Their joint covariance C.
    body_m : ndarray, shape (k, 3)
        Vectors l in the body frame, not on one line.
    body_cov_m2 : ndarray, shape (3 k, 3 k), optional
        Their joint covariance.

    Returns
    -------
    angle_rad : ndarray, shape (n, 3)
        Heading, pitch, roll.
    cov_rad2 : ndarray, shape (n, 3, 3)
        Their covariance.
    """
    n, k = vector_ned_m.shape[:2]
    start = wahba_of_points(vector_ned_m, body_m)[0]
    angle = np.stack(heading_pitch_roll(start), axis=-1)
    body_cov_m2 = np.zeros((3 * k, 3 * k)) if body_cov_m2 is None else body_cov_m2
    cov = np.empty((n, 3, 3))
    live = np.arange(n)
    for _ in range(MAX_STEPS):
        rot = rot_ned_from_body(*angle[live].T)
        down = np.swapaxes(rot, 1, 2)
        w = (np.einsum("nij,nkj->nki", down, vector_ned_m[live]) - body_m).reshape(-1, 3 * k, 1)
        # A small turn p of the attitude changes M b by M (b x p), taken at the fitted b.
        axes = np.linalg.inv(angle_jacobian(rot))
        fitted = np.einsum("nij,kj->nki", rot, body_m)
        design = (down[:, None] @ skew(fitted) @ axes[:, None]).reshape(-1, 3 * k, 3)
        cov_w = turned_covariance(cov_ned_m2[live], down) + body_cov_m2
        upside = np.swapaxes(np.linalg.solve(cov_w, design), 1, 2)
        cov[live] = np.linalg.inv(upside @ design)
        step = (cov[live] @ (upside @ -w))[..., 0]
        angle[live] += step
        live = live[np.max(np.abs(step), axis=1) >= STEP_LIMIT_RAD]
        if len(live) == 0:
            break
    return np.stack(heading_pitch_roll(rot_ned_from_body(*angle.T)), axis=-1), cov


def _matrix(local, derivative, body):
    """B L^+ and its derivative where the columns fit."""
    upside = np.swapaxes(local, 1, 2)
    plus = upside @ np.linalg.inv(local @ upside) if local.shape[2] > 3 else np.linalg.inv(local)
    matrix = body @ plus
    return MatrixFit(matrix, -np.einsum("nab,nbce,ncj->naje", matrix, derivative, plus, optimize=True))


def _direct_columns(vectors):
    return _all_columns(vectors, True)


def _all_columns(vectors, with_cross):
    """Columns, shape (n, 3, c), and their derivatives by all components, shape (n, 3, c, 3 k)."""
    n, k = vectors.shape[:2]
    columns = np.empty((n, 3, k + with_cross))
    derivative = np.zeros((n, 3, k + with_cross, 3 * k))
    columns[:, :, :k] = np.swapaxes(vectors, 1, 2)
    for c in range(k):
        derivative[:, :, c, 3 * c : 3 * c + 3] = np.eye(3)
    if with_cross:
        u, v = vectors[:, 0], vectors[:, 1]
        columns[:, :, k] = np.cross(u, v)
        derivative[:, :, k, :3], derivative[:, :, k, 3:6] = -skew(v), skew(u)
    return columns, derivative


def _triad_columns(vectors, length_m):
    """A, v, z, and their derivatives by u and v."""
    u, v = vectors[:, 0], vectors[:, 1]
    z = np.cross(v, u)
    dz = np.concatenate([skew(v), -skew(u)], axis=2)
    ahead = np.cross(z, v)
    d_ahead = -skew(v) @ dz
    d_ahead[:, :, 3:] += skew(z)
    size = np.linalg.norm(ahead, axis=1)[:, None, None]
    unit = ahead[:, :, None] / size
    across = np.eye(3) - unit * np.swapaxes(unit, 1, 2)
    derivative = np.zeros((len(vectors), 3, 3, 6))
    derivative[:, :, 0] = length_m * across @ d_ahead / size
    derivative[:, :, 1, 3:] = np.eye(3)
    derivative[:, :, 2] = dz
    return np.stack([length_m * unit[:, :, 0], v, z], axis=2), derivative
