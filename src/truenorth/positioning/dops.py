"""Dilution of precision of a baseline: how the sky turns phase noise into errors of direction.

    Q = (A^T C^-1 A)^-1,            C = 2 (I + 1 1^T)
    AzDOP = sqrt(g_az^T Q g_az),    g_az = (cos a, -sin a, 0) / cos e
    ElDOP = sqrt(g_el^T Q g_el),    g_el = (-sin e sin a, -sin e cos a, cos e)

A holds the double differences of a group (one system, band and tracking) against its reference; C
is their covariance for undifferenced noise of 1. So the standard deviation of the azimuth is
``AzDOP * sigma / length`` with sigma the noise of one phase at one receiver, in metres. The value
does not depend on which satellite is the reference: A^T C^-1 A = 1/2 sum (e - mean e)(e - mean e)^T.

References
----------
Wang & Lachapelle 2002, "GPS Attitude Determination Reliability Performance Improvement Using Low
Cost Receivers" (use of azimuth and elevation DOP). Teunissen & Kleusberg 1998, chapter 5.
"""

from dataclasses import dataclass

import numpy as np

__all__ = ["BaselineDops", "baseline_dops"]


@dataclass(frozen=True, slots=True, eq=False)
class BaselineDops:
    """Dilutions of precision of a baseline, unit undifferenced noise; NaN for a singular geometry.

    Parameters
    ----------
    pdop, hdop, vdop : ndarray, shape (n,)
        Of the three, the two horizontal and the vertical components.
    azimuth_dop, elevation_dop : ndarray, shape (n,)
        Of the direction; infinite azimuth DOP for a vertical baseline.
    """

    pdop: np.ndarray
    hdop: np.ndarray
    vdop: np.ndarray
    azimuth_dop: np.ndarray
    elevation_dop: np.ndarray


def baseline_dops(line_of_sight_enu, azimuth_rad, elevation_rad, *, group=None, epoch_start=None):
    """Compute the dilutions of precision of a baseline from the satellites used.

    Parameters
    ----------
    line_of_sight_enu : ndarray, shape (m, 3)
        Unit vectors receiver to satellite in east, north, up, one for each phase used.
    azimuth_rad, elevation_rad : float or ndarray, shape (n,)
        Direction of the baseline.
    group : ndarray of int, shape (m,), optional
        Phases that are differenced with each other share a number (small, from 0); by default all.
    epoch_start : ndarray of int64, shape (n + 1,), optional
        Offsets of the epochs; by default all rows are one epoch.

    Returns
    -------
    BaselineDops
        With arrays of shape (n,), n = 1 without `epoch_start`.

    Notes
    -----
    A group with a single phase contributes nothing.
    """
    e = np.asarray(line_of_sight_enu, dtype=float).reshape(-1, 3)
    start = np.array([0, len(e)]) if epoch_start is None else np.asarray(epoch_start)
    group = np.zeros(len(e), dtype=np.int64) if group is None else np.asarray(group, dtype=np.int64)
    n = len(start) - 1
    epoch = np.repeat(np.arange(n), np.diff(start))
    n_groups = int(group.max(initial=0)) + 1
    cell = epoch * n_groups + group
    count = np.maximum(np.bincount(cell, minlength=n * n_groups), 1)
    mean = np.stack([np.bincount(cell, e[:, i], minlength=n * n_groups) / count for i in range(3)], axis=-1)
    centred = e - mean[cell]
    normal = np.empty((n, 3, 3))
    for i in range(3):
        for j in range(3):
            normal[:, i, j] = 0.5 * np.bincount(epoch, centred[:, i] * centred[:, j], minlength=n)
    # A sky with a condition worse than this spans a plane only, but for rounding.
    regular = np.linalg.cond(normal) < 1e10 if n else np.zeros(0, dtype=bool)
    q = np.full((n, 3, 3), np.nan)
    q[regular] = np.linalg.inv(normal[regular])
    a = np.broadcast_to(np.asarray(azimuth_rad, dtype=float), (n,))
    v = np.broadcast_to(np.asarray(elevation_rad, dtype=float), (n,))
    with np.errstate(divide="ignore", invalid="ignore"):
        g_az = np.stack([np.cos(a), -np.sin(a), np.zeros(n)], axis=-1) / np.cos(v)[:, None]
    g_el = np.stack([-np.sin(v) * np.sin(a), -np.sin(v) * np.cos(a), np.cos(v)], axis=-1)
    horizontal = q[:, 0, 0] + q[:, 1, 1]
    return BaselineDops(
        pdop=np.sqrt(horizontal + q[:, 2, 2]),
        hdop=np.sqrt(horizontal),
        vdop=np.sqrt(q[:, 2, 2]),
        azimuth_dop=np.sqrt(np.einsum("ni,nij,nj->n", g_az, q, g_az)),
        elevation_dop=np.sqrt(np.einsum("ni,nij,nj->n", g_el, q, g_el)),
    )
