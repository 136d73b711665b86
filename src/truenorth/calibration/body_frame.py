r"""The body frame of an array: which of all frames in which the antennas have the same distances.

Phases give the shape of an array, scale included, but neither where its origin is nor which way it looks:
coordinates l and their covariance are determined up to a motion of six parameters with the Jacobian

    G = [ I, -[l_a] ]_a         (translation, rotation; m antennas)

A rule E^T dl = 0 of six rows fixes them. Coordinates by one rule become those by another by a rigid motion,
and covariances by the S-transformation

    T = I - G (E^T G)^-1 E^T,        C_rule = T C T^T.

References
----------
W. Baarda, "S-transformations and criterion matrices", Netherlands Geodetic Commission 5 (1973); K. S. Arun,
T. S. Huang, S. D. Blostein, "Least-squares fitting of two 3-D point sets", IEEE Transactions on Pattern
Analysis and Machine Intelligence 9 (1987).
"""

from __future__ import annotations

import numpy as np

from ..errors import ConfigError
from ..rotations import skew

__all__ = ["axes_rule", "best_fit", "fit_rule", "motion_jacobian", "s_transformation"]

MIN_ACROSS_M = 0.02
"""An antenna nearer than this to the line through two others does not say where a plane lies."""


def motion_jacobian(positions_m):
    """How the coordinates change with a small translation and rotation of the frame.

    Parameters
    ----------
    positions_m : ndarray, shape (m, 3)
        Coordinates.

    Returns
    -------
    ndarray, shape (3 m, 6)
    """
    m = len(positions_m)
    jacobian = np.zeros((m, 3, 6))
    jacobian[:, :, :3] = np.eye(3)
    jacobian[:, :, 3:] = -skew(positions_m)
    return jacobian.reshape(3 * m, 6)


def best_fit(positions_m, target_m, weight=None):
    """Rigid motion that brings points nearest to others.

    Parameters
    ----------
    positions_m, target_m : ndarray, shape (m, 3)
        The same points in two frames.
    weight : ndarray, shape (m,), optional
        Of each point; zero leaves it out.

    Returns
    -------
    rot : ndarray, shape (3, 3)
    shift_m : ndarray, shape (3,)
        ``target_m`` is about ``positions_m @ rot.T + shift_m``. Mirror images are excluded.
    """
    weight = np.ones(len(positions_m)) if weight is None else np.asarray(weight, dtype=float)
    middle = weight @ positions_m / weight.sum()
    target_middle = weight @ target_m / weight.sum()
    profile = (target_m - target_middle).T @ (weight[:, None] * (positions_m - middle))
    u, _, vt = np.linalg.svd(profile)
    u[:, 2] *= np.linalg.det(u) * np.linalg.det(vt)
    rot = u @ vt
    return rot, target_middle - rot @ middle


def fit_rule(positions_m, weight=None):
    """The rule that a frame fits declared coordinates best, at the coordinates where it does.

    Parameters
    ----------
    positions_m : ndarray, shape (m, 3)
        Coordinates in that frame.
    weight : ndarray, shape (m,), optional
        Of each antenna in the fit.

    Returns
    -------
    ndarray, shape (3 m, 6)
        E of E^T dl = 0.
    """
    weight = np.ones(len(positions_m)) if weight is None else np.asarray(weight, dtype=float)
    return np.repeat(weight, 3)[:, None] * motion_jacobian(positions_m)


def axes_rule(positions_m, antennas=(0, 1, 2), *, down_body=None):
    """Rigid motion to the frame that three antennas span, and its rule.

    The first antenna is the origin, the second stands on the forward axis, the third in the horizontal
    plane, on the side that turns the down axis towards `down_body`.

    Parameters
    ----------
    positions_m : ndarray, shape (m, 3)
        Coordinates in any frame.
    antennas : sequence of int
        The three; two are enough for antennas on one line.
    down_body : ndarray, shape (3,), optional
        Which way is down, about, in the frame of `positions_m`; without it the third antenna stands on the
        right.

    Returns
    -------
    rot : ndarray, shape (3, 3)
    shift_m : ndarray, shape (3,)
        Coordinates by the rule are ``positions_m @ rot.T + shift_m``.
    rule : ndarray, shape (3 m, 6)
        E of E^T dl = 0 there.

    Raises
    ------
    ConfigError
        If the three antennas stand on one line, or two in one place.
    """
    origin = positions_m[antennas[0]]
    forward = positions_m[antennas[1]] - origin
    length = np.linalg.norm(forward)
    if length < MIN_ACROSS_M:
        raise ConfigError(
            "the antennas that give the forward axis stand in one place; choose others", key="axes"
        )
    forward = forward / length
    if len(antennas) > 2:
        across = positions_m[antennas[2]] - origin
        across = across - forward * (forward @ across)
    else:
        across = np.zeros(3)
        across[np.argmin(np.abs(forward))] = 1.0
        across -= forward * (forward @ across)
    if np.linalg.norm(across) < MIN_ACROSS_M:
        raise ConfigError(
            "the three antennas that give the axes stand on one line; choose another third one", key="axes"
        )
    right = across / np.linalg.norm(across)
    if down_body is not None and np.cross(forward, right) @ down_body < 0.0:
        right = -right
    rot = np.stack([forward, right, np.cross(forward, right)])
    rule = np.zeros((3 * len(positions_m), 6))
    rows = [3 * antennas[0] + k for k in range(3)] + [3 * antennas[1] + k for k in (1, 2)]
    if len(antennas) > 2:
        rows.append(3 * antennas[2] + 2)
    rule[rows, np.arange(len(rows))] = 1.0
    return rot, -rot @ origin, rule


def s_transformation(positions_m, rule):
    """Matrix that brings changes of coordinates under a rule.

    Parameters
    ----------
    positions_m : ndarray, shape (m, 3)
        Coordinates that obey the rule.
    rule : ndarray, shape (3 m, 6)
        E of E^T dl = 0; columns of zeros are void.

    Returns
    -------
    ndarray, shape (3 m, 3 m)
        T; ``T @ cov @ T.T`` is the covariance by the rule. Of antennas on one line the turn about it stays
        as it is.
    """
    jacobian = motion_jacobian(positions_m)
    return np.eye(len(jacobian)) - jacobian @ np.linalg.pinv(rule.T @ jacobian, rcond=1e-9) @ rule.T
