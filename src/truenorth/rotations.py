r"""Rotations: Euler angles, rotation matrices, rotation vectors and quaternions.

Frames are right-handed. The body is forward, right, down and the navigation frame north, east, down, so

.. math:: C^n_b = R_3(\psi)\,R_2(\theta)\,R_1(\phi)

with heading, pitch and roll (intrinsic z-y-x). A rotation matrix ``rot_a_from_b`` takes the components of a
vector in b to those in a. Quaternions are Hamilton's, scalar first, and passive: ``quaternion_from_rot(
rot_a_from_b)`` turns b components into a components by ``q v q*``. All is vectorised over leading axes.

References
----------
Shuster, M. D., "A survey of attitude representations", J. Astronautical Sciences 41 (1993) 439-517.
Shepperd, S. W., "Quaternion from rotation matrix", J. Guidance and Control 1 (1978) 223-224.
Sola, J., Deray, J., Atchuthan, D., "A micro Lie theory for state estimation in robotics",
arXiv:1812.01537 (2018).
"""

import numpy as np
from numpy.typing import ArrayLike

__all__ = [
    "body_rate_from_euler_rates",
    "exp_so3",
    "heading_pitch_roll",
    "log_so3",
    "quaternion_from_rot",
    "quaternion_multiply",
    "rot_from_quaternion",
    "rot_ned_from_body",
    "skew",
]


def rot_ned_from_body(heading_rad: ArrayLike, pitch_rad: ArrayLike, roll_rad: ArrayLike) -> np.ndarray:
    """Attitude matrix of heading, pitch and roll.

    Parameters
    ----------
    heading_rad, pitch_rad, roll_rad : float or ndarray
        Heading clockwise from north, pitch nose up, roll right side down; radians, broadcast together.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        ``v_ned = rot @ v_body``.
    """
    heading, pitch, roll = np.broadcast_arrays(
        *(np.asarray(angle, dtype=float) for angle in (heading_rad, pitch_rad, roll_rad))
    )
    sh, ch = np.sin(heading), np.cos(heading)
    sp, cp = np.sin(pitch), np.cos(pitch)
    sr, cr = np.sin(roll), np.cos(roll)
    rot = np.empty((*heading.shape, 3, 3))
    rot[..., 0, 0] = ch * cp
    rot[..., 0, 1] = ch * sp * sr - sh * cr
    rot[..., 0, 2] = ch * sp * cr + sh * sr
    rot[..., 1, 0] = sh * cp
    rot[..., 1, 1] = sh * sp * sr + ch * cr
    rot[..., 1, 2] = sh * sp * cr - ch * sr
    rot[..., 2, 0] = -sp
    rot[..., 2, 1] = cp * sr
    rot[..., 2, 2] = cp * cr
    return rot


def heading_pitch_roll(rot_ned_from_body: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Euler angles of attitude matrices.

    Parameters
    ----------
    rot_ned_from_body : ndarray, shape (..., 3, 3)
        Attitude.

    Returns
    -------
    heading_rad, pitch_rad, roll_rad : ndarray, shape (...)
        Heading in [0, 2 pi), pitch in [-pi/2, pi/2], roll in (-pi, pi]. With the nose straight up or down
        only the sum or difference of heading and roll is determined; what comes back then is one of the
        pairs that describe the attitude.
    """
    rot = np.asarray(rot_ned_from_body, dtype=float)
    horizontal = np.hypot(rot[..., 0, 0], rot[..., 1, 0])
    heading = np.arctan2(rot[..., 1, 0], rot[..., 0, 0])
    pitch = np.arctan2(-rot[..., 2, 0], horizontal)
    # The roll is taken after the heading is removed, so that the two agree where the nose is vertical.
    sh, ch = np.sin(heading), np.cos(heading)
    roll = np.arctan2(
        sh * rot[..., 0, 2] - ch * rot[..., 1, 2],
        ch * rot[..., 1, 1] - sh * rot[..., 0, 1],
    )
    heading = np.mod(heading, 2.0 * np.pi)
    # The remainder of a tiny negative angle rounds up to the full circle itself.
    heading = np.where(heading >= 2.0 * np.pi, 0.0, heading)
    return heading, pitch, roll


def body_rate_from_euler_rates(
    pitch_rad: ArrayLike,
    roll_rad: ArrayLike,
    heading_rate_radps: ArrayLike,
    pitch_rate_radps: ArrayLike,
    roll_rate_radps: ArrayLike,
) -> np.ndarray:
    r"""Angular rate of the body against the navigation frame from the rates of its Euler angles.

    .. math::
        \omega^b_{nb} = (\dot\phi - \dot\psi\sin\theta,\;
        \dot\theta\cos\phi + \dot\psi\cos\theta\sin\phi,\;
        \dot\psi\cos\theta\cos\phi - \dot\theta\sin\phi)

    Parameters
    ----------
    pitch_rad, roll_rad : float or ndarray
        Attitude, radians.
    heading_rate_radps, pitch_rate_radps, roll_rate_radps : float or ndarray
        Time derivatives of heading, pitch and roll; all broadcast together.

    Returns
    -------
    ndarray, shape (..., 3)
        Rate in body axes, rad/s.
    """
    sp, cp = np.sin(pitch_rad), np.cos(pitch_rad)
    sr, cr = np.sin(roll_rad), np.cos(roll_rad)
    heading_rate, pitch_rate, roll_rate = (
        np.asarray(rate, dtype=float) for rate in (heading_rate_radps, pitch_rate_radps, roll_rate_radps)
    )
    return np.stack(
        np.broadcast_arrays(
            roll_rate - heading_rate * sp,
            pitch_rate * cr + heading_rate * cp * sr,
            heading_rate * cp * cr - pitch_rate * sr,
        ),
        axis=-1,
    )


def skew(vector: ArrayLike) -> np.ndarray:
    """Matrix of the cross product.

    Parameters
    ----------
    vector : ndarray, shape (..., 3)
        Any unit.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        ``skew(a) @ b = cross(a, b)``.
    """
    vector = np.asarray(vector, dtype=float)
    matrix = np.zeros((*vector.shape, 3))
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    matrix[..., 0, 1], matrix[..., 0, 2] = -z, y
    matrix[..., 1, 0], matrix[..., 1, 2] = z, -x
    matrix[..., 2, 0], matrix[..., 2, 1] = -y, x
    return matrix


def exp_so3(vector: ArrayLike) -> np.ndarray:
    r"""Rotation matrices of rotation vectors (Rodrigues).

    .. math:: R = I + \frac{\sin\theta}{\theta}[v] + \frac{1-\cos\theta}{\theta^2}[v]^2,\quad \theta = |v|

    Parameters
    ----------
    vector : ndarray, shape (..., 3)
        Axis times angle, radians.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        With ``vector`` that of frame b against frame a: ``v_a = rot @ v_b``. Exact to rounding at any angle:
        both coefficients are cardinal sines.
    """
    vector = np.asarray(vector, dtype=float)
    angle = np.sqrt(np.sum(vector * vector, axis=-1))[..., None, None]
    cross = skew(vector)
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    return np.eye(3) + first * cross + second * (cross @ cross)


def log_so3(rot: ArrayLike) -> np.ndarray:
    """Rotation vectors of rotation matrices; the inverse of `exp_so3`.

    Parameters
    ----------
    rot : ndarray, shape (..., 3, 3)
        Rotation matrices.

    Returns
    -------
    ndarray, shape (..., 3)
        Axis times angle, the angle in [0, pi]. It goes by the quaternion, whose largest component is found
        first, so that small angles and half turns are as exact as any other.
    """
    quaternion = quaternion_from_rot(rot)
    scalar, vector = quaternion[..., :1], quaternion[..., 1:]
    half_sine = np.sqrt(np.sum(vector * vector, axis=-1, keepdims=True))
    half_angle = np.arctan2(half_sine, scalar)
    tiny = half_sine < 1e-150
    return 2.0 * vector * np.where(tiny, 1.0, half_angle / np.where(tiny, 1.0, half_sine))


def quaternion_from_rot(rot: ArrayLike) -> np.ndarray:
    """Quaternions of rotation matrices, by Shepperd's choice of the largest component.

    Parameters
    ----------
    rot : ndarray, shape (..., 3, 3)
        Rotation matrices.

    Returns
    -------
    ndarray, shape (..., 4)
        Unit quaternions, scalar first and not negative.
    """
    rot = np.asarray(rot, dtype=float)
    r00, r11, r22 = rot[..., 0, 0], rot[..., 1, 1], rot[..., 2, 2]
    # Four times the outer product of the quaternion with itself, row by row; the row of the largest
    # component loses no digits.
    a, b, c = (
        rot[..., 2, 1] - rot[..., 1, 2],
        rot[..., 0, 2] - rot[..., 2, 0],
        rot[..., 1, 0] - rot[..., 0, 1],
    )
    d, e, f = (
        rot[..., 1, 0] + rot[..., 0, 1],
        rot[..., 0, 2] + rot[..., 2, 0],
        rot[..., 2, 1] + rot[..., 1, 2],
    )
    w, x, y, z = 1 + r00 + r11 + r22, 1 + r00 - r11 - r22, 1 - r00 + r11 - r22, 1 - r00 - r11 + r22
    rows = [(w, a, b, c), (a, x, d, e), (b, d, y, f), (c, e, f, z)]
    table = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    largest = np.argmax(np.stack((w, x, y, z), axis=-1), axis=-1)
    quaternion = np.take_along_axis(table, largest[..., None, None], axis=-2)[..., 0, :]
    quaternion = quaternion / np.sqrt(np.sum(quaternion * quaternion, axis=-1, keepdims=True))
    return np.where(quaternion[..., :1] < 0.0, -quaternion, quaternion)


def rot_from_quaternion(quaternion: ArrayLike) -> np.ndarray:
    """Rotation matrices of quaternions.

    Parameters
    ----------
    quaternion : ndarray, shape (..., 4)
        Scalar first; need not have unit length, but not zero.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        Rotation matrices.
    """
    unit = np.asarray(quaternion, dtype=float)
    unit = unit / np.sqrt(np.sum(unit * unit, axis=-1, keepdims=True))
    cross = skew(unit[..., 1:])
    return np.eye(3) + 2.0 * (unit[..., 0, None, None] * cross + cross @ cross)


def quaternion_multiply(first: ArrayLike, second: ArrayLike) -> np.ndarray:
    """Hamilton's product: ``rot(first * second) = rot(first) @ rot(second)``.

    Parameters
    ----------
    first, second : ndarray, shape (..., 4)
        Quaternions, scalar first.

    Returns
    -------
    ndarray, shape (..., 4)
        Their product.
    """
    a, b = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    aw, ax, ay, az = np.moveaxis(a, -1, 0)
    bw, bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack(
        (
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ),
        axis=-1,
    )
