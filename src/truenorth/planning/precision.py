r"""Accuracy and reliability of an attitude, told from geometry and noise alone, all epochs at once.

All antennas see the same signals with the same noise, so the weights of the rows (antenna a, signal s) are
a product and the elimination of what the antennas share of a satellite (c_s) and of the clocks (t_ag) falls
into two parts (every double difference, with its full covariance, for every choice of references):

    M = J x W,    J = 1 - 11^T / n,    W = blockdiag over groups (diag w - w w^T / sum w)

With the unit vectors e_s to the satellites and r_a the antennas from their centre, in north, east, down,

    G = E^T W E,                  information about the vector between two antennas, of one antenna
    N = sum_a [r_a]x^T G [r_a]x,  information about a small turn of the platform

and for uncertain body coordinates G^-1 gains their variance. The blunder of one phase (a, s) that a test of
noncentrality delta0 finds, and what it does to the turn while it is not found, follow from

    q = w_s (e_s - mean e) . [r_a]x,   R = (1 - 1/n) w_s (1 - w_s / sum w) - q N^-1 q^T,
    MDB = delta0 / sqrt R,             external = N^-1 q^T MDB.

References
----------
P. J. G. Teunissen, "The affine constrained GNSS attitude model and its multivariate integer least-squares
solution", Journal of Geodesy 86 (2012); W. Baarda, "A testing procedure for use in geodetic networks",
Netherlands Geodetic Commission 2/5 (1968); C. Wang, G. Lachapelle, "GPS attitude determination reliability
performance improvement using low cost receivers", Journal of Global Positioning Systems 1 (2002).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..attitude.vector_methods import MIN_ACROSS_M
from ..attitude.vectors import angle_jacobian, array_extent_m
from ..rotations import rot_ned_from_body, skew
from .view import SkyView

__all__ = ["Precision", "array_precision", "group_sums", "vector_information"]

WEAK_GEOMETRY = 1e12
"""A condition beyond this is a plane of satellites, but for rounding."""


class Precision(NamedTuple):
    """Accuracy of the attitude at n epochs.

    Parameters
    ----------
    cov_rad2 : ndarray, shape (n, 3, 3)
        Of heading, pitch and roll; NaN for what cannot be observed.
    cov_ned_rad2 : ndarray, shape (n, 3, 3)
        Of the small turn in north, east, down; without the turn about a line of antennas.
    angle_of_turn : ndarray, shape (3, 3)
        Heading, pitch and roll of a small turn in north, east, down.
    """

    cov_rad2: np.ndarray
    cov_ned_rad2: np.ndarray
    angle_of_turn: np.ndarray


def group_sums(view: SkyView, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sum of weights, and weighted mean of the lines of sight, of the group to which each row belongs.

    Parameters
    ----------
    view : SkyView
        Signals in view, m rows.
    weight : ndarray, shape (m,)
        Of each row; 0 takes it out.

    Returns
    -------
    total : ndarray, shape (m,)
    mean_ned : ndarray, shape (m, 3)
    """
    n_groups = max(len(view.groups), 1)
    cell = view.epoch * n_groups + view.group
    size = view.n_epochs * n_groups
    total = np.bincount(cell, weight, minlength=size)
    safe = np.where(total > 0.0, total, 1.0)
    mean = np.stack(
        [np.bincount(cell, weight * view.line_of_sight_ned[:, i], minlength=size) / safe for i in range(3)],
        axis=-1,
    )
    return total[cell], mean[cell]


def vector_information(view: SkyView, weight: np.ndarray) -> np.ndarray:
    """Information G that one antenna's rows hold about its place among the others.

    Parameters
    ----------
    view : SkyView
        Signals in view, m rows, n epochs.
    weight : ndarray, shape (m,)
        Of the undifferenced row: one over its variance.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        The covariance of the vector between two antennas is twice its inverse.
    """
    _, mean = group_sums(view, weight)
    centred = view.line_of_sight_ned - mean
    information = np.empty((view.n_epochs, 3, 3))
    for i in range(3):
        for j in range(3):
            information[:, i, j] = np.bincount(
                view.epoch, weight * centred[:, i] * centred[:, j], minlength=view.n_epochs
            )
    return information


def array_precision(
    information: np.ndarray,
    positions_body_m: np.ndarray,
    angles_rad: tuple[float, float, float],
    *,
    position_sd_m: float = 0.0,
) -> Precision:
    """Covariance of heading, pitch and roll of an array, single epoch, integers known.

    Parameters
    ----------
    information : ndarray, shape (n, 3, 3)
        From `vector_information`.
    positions_body_m : ndarray, shape (k, 3)
        Antennas.
    angles_rad : tuple of float
        Heading, pitch and roll at which the platform stands.
    position_sd_m : float
        Of each body coordinate.

    Returns
    -------
    Precision
    """
    n = len(information)
    rot = rot_ned_from_body(*angles_rad)
    centred = (positions_body_m - positions_body_m.mean(0)) @ rot.T
    _, across, axis = array_extent_m(positions_body_m - positions_body_m[0])
    inverse = angle_jacobian(rot[None])[0]
    regular = np.zeros(n, dtype=bool)
    finite = np.isfinite(information).all((1, 2))
    with np.errstate(all="ignore"):
        regular[finite] = np.linalg.cond(information[finite]) < WEAK_GEOMETRY
    cov = np.full((n, 3, 3), np.nan)
    g = information[regular]
    if position_sd_m > 0.0:
        g = np.linalg.inv(np.linalg.inv(g) + position_sd_m**2 * np.eye(3))
    lever = skew(centred)
    normal = np.einsum("aji,njk,akl->nil", lever, g, lever)
    keep = np.eye(3)
    if across < MIN_ACROSS_M:
        # The turn about the line does nothing; a normal matrix without it is inverted beside it.
        line = rot @ axis
        keep -= np.outer(line, line)
        normal = normal + np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.outer(line, line)
        inverse = np.where((np.abs(inverse @ line) > 1e-3)[:, None], np.nan, inverse)
    cov[regular] = keep @ np.linalg.inv(normal) @ keep
    return Precision(inverse @ cov @ inverse.T, cov, inverse)
