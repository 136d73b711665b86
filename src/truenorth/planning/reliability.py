"""Blunders of a phase that may stay hidden, and what they would do to the attitude, over a day."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..attitude.reliability import ReliabilitySettings
from ..rotations import rot_ned_from_body, skew
from .precision import Precision, group_sums
from .view import SkyView

__all__ = ["DayReliability", "day_reliability"]


class DayReliability(NamedTuple):
    """Worst phase of each of n epochs.

    Parameters
    ----------
    mdb_m, mdb_cyc : ndarray, shape (n,)
        Largest minimal detectable blunder of a phase; infinite where a blunder of one is never seen.
    external_rad : ndarray, shape (n, 3)
        Largest effect of such a blunder on heading, pitch and roll.
    """

    mdb_m: np.ndarray
    mdb_cyc: np.ndarray
    external_rad: np.ndarray


def day_reliability(
    view: SkyView,
    weight: np.ndarray,
    information: np.ndarray,
    precision: Precision,
    positions_body_m: np.ndarray,
    angles_rad: tuple[float, ...],
    *,
    position_sd_m: float = 0.0,
) -> DayReliability:
    """Compute internal and external reliability of the phases of an array, integers fixed.

    Parameters
    ----------
    view : SkyView
        Signals in view, m rows, n epochs.
    weight : ndarray, shape (m,)
        One over the variance of the phase; 0 takes it out.
    information : ndarray, shape (n, 3, 3)
        From `vector_information`.
    precision : Precision
        Of the attitude that the phases give.
    positions_body_m : ndarray, shape (k, 3)
        Antennas.
    angles_rad : tuple of float
        Heading, pitch and roll at which the platform stands.
    position_sd_m : float
        Of each body coordinate.

    Returns
    -------
    DayReliability
    """
    n, k = view.n_epochs, len(positions_body_m)
    delta0 = ReliabilitySettings().delta0
    epoch = view.epoch
    total, mean = group_sums(view, weight)
    pull = weight[:, None] * (view.line_of_sight_ned - mean)
    centred = (positions_body_m - positions_body_m.mean(0)) @ rot_ned_from_body(*angles_rad).T
    own = weight * (1.0 - weight / np.where(total > 0.0, total, 1.0))
    if position_sd_m > 0.0:
        # Errors of the coordinates are unknowns with a variance, eliminated like the clocks.
        loss = np.linalg.inv(information + np.eye(3) / position_sd_m**2)
        own -= np.einsum("mi,mij,mj->m", pull, loss[epoch], pull)
        pull = pull - np.einsum("mi,mij->mj", pull, (loss @ information)[epoch])
    own *= 1.0 - 1.0 / k
    mdb_m, mdb_cyc, external = np.full(n, np.nan), np.full(n, np.nan), np.full((n, 3), np.nan)
    cov = precision.cov_ned_rad2[epoch]
    known = np.isfinite(cov).all((1, 2)) & (weight > 0.0) & (total > weight)
    rows = np.flatnonzero(known)
    if len(rows) == 0:
        return DayReliability(mdb_m, mdb_cyc, external)
    reached = np.unique(epoch[rows])
    mdb_m[reached], mdb_cyc[reached], external[reached] = 0.0, 0.0, 0.0
    for lever in skew(centred):
        q = pull[rows] @ lever
        turn = np.einsum("mij,mj->mi", cov[rows], q)
        redundancy = own[rows] - np.einsum("mi,mi->m", q, turn)
        seen = redundancy > 1e-9 * own[rows]
        size = np.where(seen, delta0 / np.sqrt(np.where(seen, redundancy, 1.0)), np.inf)
        with np.errstate(invalid="ignore"):
            effect = np.abs(turn @ precision.angle_of_turn.T) * size[:, None]
        np.maximum.at(mdb_m, epoch[rows], size)
        np.maximum.at(mdb_cyc, epoch[rows], size / view.wavelength_m[rows])
        np.maximum.at(external, epoch[rows], effect)
    return DayReliability(mdb_m, mdb_cyc, external)
