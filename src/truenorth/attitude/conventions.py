r"""Other people's angles: roll, pitch and yaw as published, to and from our rotation matrix.

This package holds an attitude as the rotation from the body (forward, right, down) to north, east, down;
heading, pitch and roll are its intrinsic z-y-x angles. Wang & Lachapelle (2002) and Landfahrer (2009) write

    x_body = R2(r) R1(p) R3(y) x_local

with passive rotations. What r, p and y mean depends on the axes:

============  ===============================================================================
``ned-frd``   ours: R1(roll) R2(pitch) R3(heading)
``enu-rfu``   local east, north, up and body right, forward, up: r is roll, p is pitch, and
              y is counter-clockwise from north, **heading = -y**
``neu-fru``   the same formula on the axes that Landfahrer (2009) declares, which are
              left-handed: north, east, up and forward, right, up. There y is the heading, but r
              turns about the transverse axis and p about the longitudinal one, with the
              opposite signs and in the other order: for small angles pitch = -r, roll = -p
============  ===============================================================================

The element R31 is printed with a sign that makes the matrix no rotation (its determinant is 0.9962 at 2, 6
and 12 degrees); the right sign is used here.
"""

from __future__ import annotations

import numpy as np

from ..errors import ConfigError
from ..rotations import heading_pitch_roll, rot_ned_from_body

__all__ = [
    "CONVENTIONS",
    "angles_213",
    "angles_in_convention",
    "body_axes",
    "local_axes",
    "rot_213",
    "rot_from_convention",
]

CONVENTIONS = ("ned-frd", "enu-rfu", "neu-fru")
"""Names of the conventions."""

_SWAP = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_AXES = {"ned-frd": np.eye(3), "enu-rfu": _SWAP, "neu-fru": np.diag([1.0, 1.0, -1.0])}


def local_axes(convention):
    """Matrix that takes north, east, down to the local axes of a convention.

    Parameters
    ----------
    convention : str
        One of `CONVENTIONS`.

    Returns
    -------
    ndarray, shape (3, 3)
        Symmetric and its own inverse; its determinant is -1 for left-handed axes.
    """
    if convention not in _AXES:
        raise ConfigError(
            f"no convention `{convention}`; give one of {', '.join(CONVENTIONS)}",
            key="convention",
            value=convention,
        )
    return _AXES[convention].copy()


def body_axes(convention):
    """Matrix that takes forward, right, down to the body axes of a convention; see `local_axes`."""
    return local_axes(convention)


def rot_213(roll_rad, pitch_rad, yaw_rad):
    """R2(r) R1(p) R3(y), which takes local to body components (Landfahrer 2009, 3.16, R31 mended).

    Parameters
    ----------
    roll_rad, pitch_rad, yaw_rad : float or ndarray
        Broadcast together.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    r, p, y = np.broadcast_arrays(*(np.asarray(a, dtype=float) for a in (roll_rad, pitch_rad, yaw_rad)))
    sr, cr, sp, cp, sy, cy = np.sin(r), np.cos(r), np.sin(p), np.cos(p), np.sin(y), np.cos(y)
    rows = [
        (cr * cy - sr * sp * sy, cr * sy + sr * sp * cy, -sr * cp),
        (-cp * sy, cp * cy, sp),
        (sr * cy + cr * sp * sy, sr * sy - cr * sp * cy, cp * cr),
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def angles_213(rot):
    """Roll, pitch and yaw of R2(r) R1(p) R3(y) (Landfahrer 2009, 3.18-3.20, with both arguments).

    Parameters
    ----------
    rot : ndarray, shape (..., 3, 3)
        Local to body; need not be quite orthogonal.

    Returns
    -------
    roll_rad, pitch_rad, yaw_rad : ndarray
        Roll and yaw in (-pi, pi].
    """
    rot = np.asarray(rot, dtype=float)
    return (
        np.arctan2(-rot[..., 0, 2], rot[..., 2, 2]),
        np.arctan2(rot[..., 1, 2], np.hypot(rot[..., 1, 0], rot[..., 1, 1])),
        np.arctan2(-rot[..., 1, 0], rot[..., 1, 1]),
    )


def rot_from_convention(convention, roll_rad, pitch_rad, yaw_rad):
    """Attitude from the angles of a convention.

    Parameters
    ----------
    convention : str
        One of `CONVENTIONS`.
    roll_rad, pitch_rad, yaw_rad : float or ndarray
        As the convention names them; the yaw of ``ned-frd`` is the heading.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        ``v_ned = rot @ v_body``, the body being forward, right, down.
    """
    axes = local_axes(convention)
    if convention == "ned-frd":
        return rot_ned_from_body(yaw_rad, pitch_rad, roll_rad)
    return axes @ np.swapaxes(rot_213(roll_rad, pitch_rad, yaw_rad), -1, -2) @ axes


def angles_in_convention(convention, rot_ned_from_body):
    """Angles of an attitude as a convention names them.

    Parameters
    ----------
    convention : str
        One of `CONVENTIONS`.
    rot_ned_from_body : ndarray, shape (..., 3, 3)
        Attitude.

    Returns
    -------
    roll_rad, pitch_rad, yaw_rad : ndarray
        The inverse of `rot_from_convention`.
    """
    axes = local_axes(convention)
    if convention == "ned-frd":
        heading, pitch, roll = heading_pitch_roll(rot_ned_from_body)
        return roll, pitch, heading
    return angles_213(axes @ np.swapaxes(rot_ned_from_body, -1, -2) @ axes)
