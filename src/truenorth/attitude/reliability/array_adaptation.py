"""Leaving out the wrong antenna of an array: tests of every epoch's vectors, the attitude from the rest.

The tests are those of `truenorth.attitude.reliability.adaptation`, but what an antenna explains is found by
adjusting without it: wrong integers turn a vector by tens of degrees, and the linear model of the wrong
attitude does not reach so far. Also the antenna from which all vectors point can be the wrong one; the rest
then point from another.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..adjustment import without_antenna
from ..array_vectors import ArrayVectors, VectorBlock
from ..vector_methods import MIN_ACROSS_M
from ..vectors import array_extent_m, fit_rotation
from .adaptation import Outcome, identify
from .settings import ReliabilitySettings

__all__ = ["AttitudeAdaptation", "adapt_attitude", "fit_block"]


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeAdaptation:
    """Outcome of n epochs with m antennas.

    Parameters
    ----------
    vectors : ArrayVectors
        Those that are left, from another antenna where the reference was left out.
    rot_ned_from_body : ndarray, shape (n, 3, 3)
        Their attitude; NaN where it is not resolved. Of antennas on one line the roll means nothing.
    cov_ned_rad2 : ndarray, shape (n, 3, 3)
        Covariance of its small rotation in north, east, down.
    is_rejected : ndarray of bool, shape (n, m)
        Antennas that were left out.
    outcome : ndarray of uint8, shape (n,)
        Codes of `truenorth.attitude.reliability.Outcome`.
    statistic, limit : ndarray, shape (n, p)
        Global test before each pass, and its limit.
    antenna : ndarray of int64, shape (n, p)
        Whom each pass left out; -1 for no one.
    antenna_statistic, antenna_limit : ndarray, shape (n, p)
        Its test.
    """

    vectors: ArrayVectors
    rot_ned_from_body: np.ndarray
    cov_ned_rad2: np.ndarray
    is_rejected: np.ndarray
    outcome: np.ndarray
    statistic: np.ndarray
    limit: np.ndarray
    antenna: np.ndarray
    antenna_statistic: np.ndarray
    antenna_limit: np.ndarray


def fit_block(block):
    """Attitude of a block and its global test.

    Parameters
    ----------
    block : VectorBlock
        e epochs with k vectors.

    Returns
    -------
    rot : ndarray, shape (e, 3, 3)
        Attitude; with roll unknown for vectors along one line.
    cov_ned_rad2 : ndarray, shape (e, 3, 3)
    chi2 : ndarray, shape (e,)
        Weighted square sum of the residuals.
    dof : int
        Its degrees of freedom.
    """
    _, across, axis = array_extent_m(block.body_m)
    is_line = across < MIN_ACROSS_M
    fit = fit_rotation(
        block.vector_ned_m,
        block.cov_ned_m2,
        block.body_m,
        body_cov_m2=block.body_cov_m2 if block.body_cov_m2.any() else None,
        free_axis_body=axis if is_line else None,
    )
    dof = 3 * len(block.antennas) - (2 if is_line else 3)
    return fit.rot_ned_from_body, fit.cov_ned_rad2, fit.chi2, dof


def adapt_attitude(vectors, *, settings=None, is_used=None):
    """Attitude of every epoch from the vectors that agree.

    Parameters
    ----------
    vectors : ArrayVectors
        Vectors of n epochs and their joint covariance.
    settings : ReliabilitySettings, optional
        What is demanded.
    is_used : ndarray of bool, shape (n, m), optional
        Vectors that may take part; by default all that are there.

    Returns
    -------
    AttitudeAdaptation
        With three antennas a contradiction is seen, but whose fault it is can not be told.
    """
    settings = ReliabilitySettings() if settings is None else settings
    n, m = vectors.vector_ned_m.shape[:2]
    passes = settings.max_rejections + 1
    is_used = vectors.is_present if is_used is None else is_used & vectors.is_present
    kept_m = np.where(is_used[..., None], vectors.vector_ned_m, np.nan)
    result = AttitudeAdaptation(
        ArrayVectors(
            vectors.time_ns, vectors.reference.copy(), kept_m, _masked(vectors.cov_ned_m2, is_used),
            vectors.positions_body_m, vectors.body_cov_m2, vectors.names,
        ),
        np.full((n, 3, 3), np.nan), np.full((n, 3, 3), np.nan), np.zeros((n, m), bool),
        np.full(n, Outcome.NOT_TESTED, np.uint8), np.full((n, passes), np.nan), np.full((n, passes), np.nan),
        np.full((n, passes), -1), np.full((n, passes), np.nan), np.full((n, passes), np.nan),
    )  # fmt: skip
    for block in vectors.blocks(is_used):
        _adapt_block(block, result, settings, 0)
    lost = result.outcome > Outcome.ADAPTED
    result.is_rejected[lost] = False
    return result


def _adapt_block(block, result, settings, number):
    """Test a block; store what passes, and go on without the culprit elsewhere."""
    rot, cov, chi2, dof = fit_block(block)
    at = block.epochs
    result.statistic[at, number], result.limit[at, number] = chi2, settings.limit(dof)
    everyone = [*block.antennas, block.reference]
    # Adjusting without each costs as much as all so far: only where something may be wrong. An antenna's test
    # is part of the global one, which therefore must exceed the smaller limit first.
    suspect = np.flatnonzero(chi2 > settings.limit(1))
    outcome = np.full(len(at), Outcome.PASSED, np.uint8)
    culprit = np.full(len(at), -1)
    if len(suspect) and dof > 0:
        part = _rows(block, suspect)
        statistic, rank = (
            np.zeros((len(suspect), len(everyone))),
            np.zeros((len(suspect), len(everyone)), int),
        )
        size = np.full(len(everyone), 3)
        for column, antenna in enumerate(everyone):
            if len(block.antennas) < 2:
                continue
            _, _, rest, rest_dof = fit_block(without_antenna(part, antenna))
            statistic[:, column], rank[:, column] = np.maximum(chi2[suspect] - rest, 0.0), dof - rest_dof
            if len(block.antennas) > 2:
                # Three antennas may be left on one line, with an attitude short of the turn about it.
                size[column] = dof - rest_dof
        fault, found = identify(chi2[suspect], np.full(len(suspect), dof), statistic, rank, size, settings)
        outcome[suspect], culprit[suspect] = found, fault
        for row in np.flatnonzero(found == Outcome.ADAPTED):
            epoch = at[suspect[row]]
            if number < settings.max_rejections:
                result.antenna[epoch, number] = everyone[fault[row]]
                result.antenna_statistic[epoch, number] = statistic[row, fault[row]]
                result.antenna_limit[epoch, number] = settings.limit(int(rank[row, fault[row]]))
    passed = np.flatnonzero(outcome == Outcome.PASSED)
    result.rot_ned_from_body[at[passed]], result.cov_ned_rad2[at[passed]] = rot[passed], cov[passed]
    result.outcome[at] = np.where((outcome == Outcome.PASSED) & (number > 0), Outcome.ADAPTED, outcome)
    if number > 0:
        _store_vectors(_rows(block, passed), result.vectors)
    go = outcome == Outcome.ADAPTED
    if number == settings.max_rejections:
        result.outcome[at[go]] = Outcome.TOO_MANY
        return
    for column in np.unique(culprit[go]):
        rows = np.flatnonzero(go & (culprit == column))
        result.is_rejected[at[rows], everyone[column]] = True
        _adapt_block(without_antenna(_rows(block, rows), everyone[column]), result, settings, number + 1)


def _rows(block, rows):
    """Some epochs of a block."""
    return VectorBlock(
        block.epochs[rows], block.antennas, block.reference, block.vector_ned_m[rows], block.cov_ned_m2[rows],
        block.body_m, block.body_cov_m2,
    )  # fmt: skip


def _masked(cov, is_used):
    """Covariances of the vectors that are used, NaN elsewhere."""
    wide = np.repeat(is_used, 3, axis=1)
    return np.where(wide[:, :, None] & wide[:, None, :], cov, np.nan)


def _store_vectors(block, vectors):
    """What is left of epochs that lost an antenna."""
    at = (3 * block.antennas[:, None] + np.arange(3)).ravel()
    vectors.reference[block.epochs] = block.reference
    vectors.vector_ned_m[block.epochs] = np.nan
    vectors.vector_ned_m[np.ix_(block.epochs, block.antennas)] = block.vector_ned_m
    vectors.cov_ned_m2[block.epochs] = np.nan
    vectors.cov_ned_m2[np.ix_(block.epochs, at, at)] = block.cov_ned_m2
