r"""Attitude from white rows by least squares, without any prior: where a filter starts.

The nine elements of a free matrix are adjusted first (those that the antennas span), the rotation nearest to
it in the metric of the array is the start, and Gauss-Newton on the group,
:math:`R \leftarrow R\exp([p]_\times)`, ends it.

References
----------
F. L. Markley, "Attitude determination using vector observations and the singular value decomposition",
Journal of the Astronautical Sciences 36 (1988).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..rotations import exp_so3, skew

__all__ = ["RowFit", "fit_rows", "spans_directions"]

MAX_STEPS = 20
STEP_LIMIT_RAD = 1e-9

_FLAT = 1e-6
"""Singular values below this share of the largest are taken as zero."""


class RowFit(NamedTuple):
    """Attitude that fits rows best.

    Parameters
    ----------
    rot_ned_from_body : ndarray, shape (3, 3)
        Attitude.
    cov_body_rad2 : ndarray, shape (3, 3)
        Covariance of its rotation error in body axes, from noise alone.
    sensitivity : ndarray, shape (3, 3 m)
        Rotation error by a metre of error of each body coordinate, in body axes.
    chi2 : float
        Square of the residuals in the metric of noise and body coordinates.
    dof : int
        Its degrees of freedom.
    """

    rot_ned_from_body: np.ndarray
    cov_body_rad2: np.ndarray
    sensitivity: np.ndarray
    chi2: float
    dof: int


def spans_directions(points: np.ndarray) -> bool:
    """Whether points, shape (k, 3), do not all stand on one line."""
    if len(points) < 3:
        return False
    size = np.linalg.svd(points - points.mean(0), compute_uv=False)
    return bool(size[1] > _FLAT * size[0])


def fit_rows(rows: np.ndarray, y: np.ndarray, body_m: np.ndarray, body_cov_m2: np.ndarray) -> RowFit | None:
    """Least-squares attitude of white rows.

    Parameters
    ----------
    rows : ndarray, shape (r, 3 m)
        Design on the stacked antenna coordinates.
    y : ndarray, shape (r,)
        Observations.
    body_m : ndarray, shape (m, 3)
        Body coordinates.
    body_cov_m2 : ndarray, shape (3 m, 3 m)
        Their covariance.

    Returns
    -------
    RowFit or None
        None where the rows do not determine an attitude.
    """
    r, m = len(y), len(body_m)
    if r < 3:
        return None
    is_seen = np.abs(rows).reshape(r, m, 3).max((0, 2)) > 0.0
    body = body_m - body_m[is_seen].mean(0) if is_seen.any() else body_m
    # p_a = R l_a is linear in the nine elements of R.
    free = np.einsum("rai,aj->rij", rows.reshape(r, m, 3), body).reshape(r, 9)
    matrix = np.linalg.lstsq(free, y, rcond=_FLAT)[0].reshape(3, 3)
    moment = body[is_seen].T @ body[is_seen]
    u, _, vt = np.linalg.svd(matrix @ moment)
    u[:, 2] *= np.linalg.det(u) * np.linalg.det(vt)
    rot = u @ vt
    for _ in range(MAX_STEPS):
        misfit = y - rows @ (body @ rot.T).ravel()
        design = rows @ (-rot @ skew(body)).reshape(3 * m, 3)
        normal = design.T @ design
        size = np.linalg.eigvalsh(normal)
        if not size[0] > _FLAT * size[2]:
            return None
        step = np.linalg.solve(normal, design.T @ misfit)
        rot = rot @ exp_so3(step)
        if np.max(np.abs(step)) < STEP_LIMIT_RAD:
            break
    cov = np.linalg.inv(normal)
    lever = np.einsum("rai,ij->raj", rows.reshape(r, m, 3), rot).reshape(r, 3 * m)
    misfit = y - rows @ (body @ rot.T).ravel()
    total = np.eye(r) + lever @ body_cov_m2 @ lever.T
    # The attitude was found in the metric of the noise; what it leaves is tested in that of both, freed of
    # the turn that the coordinates' errors make.
    weight = np.linalg.inv(total)
    back = weight @ design
    chi2 = misfit @ weight @ misfit - (back.T @ misfit) @ np.linalg.solve(design.T @ back, back.T @ misfit)
    return RowFit(rot, cov, -cov @ design.T @ lever, float(chi2), r - 3)
