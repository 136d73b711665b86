r"""Detection, identification, adaptation: find what contradicts, leave it out, and look again.

Each pass tests the whole model and every candidate fault. Where a test fails, the fault is identified whose
statistic is largest in units of its own limit; it must exceed that limit, and explain the data better than
any other one by a clear margin. The model is then adapted: the fault becomes an unknown,

    S = F^T M F,   M <- M - M F S^-1 F^T M,   K <- K - K F S^-1 F^T M,   Q <- Q + K F S^-1 F^T K^T

which for a whole observation or vector is the same as leaving it out, in least squares and in a filter.
Passes are repeated up to a cap; an epoch that needs more, whose culprit is not clear, or that cannot do
without the culprit, is not resolved and gives no result.

References
----------
P. J. G. Teunissen, "Quality control in integrated navigation systems", IEEE Aerospace and Electronic Systems
Magazine 5 (1990); W. Baarda, "A testing procedure for use in geodetic networks", Netherlands Geodetic
Commission 2/5 (1968).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from .linear import LinearModel
from .settings import ReliabilitySettings

__all__ = ["Adaptation", "Outcome", "adapt_model", "identify"]


class Outcome(IntEnum):
    """How the tests of an epoch ended."""

    PASSED = 0
    ADAPTED = 1
    NOT_IDENTIFIED = 2
    NOT_SEPARATED = 3
    NOT_REMOVABLE = 4
    TOO_MANY = 5
    NOT_TESTED = 6

    @property
    def is_resolved(self) -> bool:
        """bool: Whether the epoch may be used."""
        return self <= Outcome.ADAPTED


@dataclass(frozen=True, slots=True, eq=False)
class Adaptation:
    """Outcome of e epochs with f candidate faults and u unknowns.

    Parameters
    ----------
    correction : ndarray, shape (e, u)
        Corrections of the unknowns after the adaptation; NaN where it is not resolved.
    cov : ndarray, shape (e, u, u)
        Their covariance.
    is_rejected : ndarray of bool, shape (e, f)
        Faults that became unknowns.
    outcome : ndarray of uint8, shape (e,)
        Codes of `Outcome`.
    statistic, limit : ndarray, shape (e, p)
        Global test before each pass, and its limit; NaN where a pass was not needed.
    fault : ndarray of int64, shape (e, p)
        What each pass rejected; -1 for nothing.
    fault_statistic, fault_limit : ndarray, shape (e, p)
        Its test.
    """

    correction: np.ndarray
    cov: np.ndarray
    is_rejected: np.ndarray
    outcome: np.ndarray
    statistic: np.ndarray
    limit: np.ndarray
    fault: np.ndarray
    fault_statistic: np.ndarray
    fault_limit: np.ndarray


def identify(total, dof, statistic, rank, size, settings, *, is_open=None, passes_screen=None):
    """One pass of tests: which epochs fail, and which fault is to blame.

    Parameters
    ----------
    total : ndarray, shape (e,)
        Global test.
    dof : ndarray of int, shape (e,)
        Its degrees of freedom.
    statistic : ndarray, shape (e, f)
        Test of each fault: by how much the global test falls without it.
    rank : ndarray of int, shape (e, f)
        Its degrees of freedom.
    size : int or ndarray of int, shape (f,)
        Dimensions of a fault; where fewer can be seen it cannot be left out.
    settings : ReliabilitySettings
        What is demanded.
    is_open : ndarray of bool, shape (e, f), optional
        Faults that may be blamed.
    passes_screen : ndarray of bool, shape (e, f), optional
        Faults that pass a screen of the caller's.

    Returns
    -------
    fault : ndarray of int64, shape (e,)
        Index of the culprit; -1 where there is none.
    outcome : ndarray of uint8, shape (e,)
        `Outcome.PASSED`, `Outcome.ADAPTED` (to be), or why it cannot be.
    """
    is_open = np.ones(statistic.shape, bool) if is_open is None else is_open
    most = int(max(np.max(dof, initial=0), np.max(rank, initial=0)))
    limits = np.array([settings.limit(k) for k in range(most + 1)])
    own = limits[rank]
    if settings.mdb_screen == "estimated":
        own = np.maximum(own, np.where(rank > 0, settings.delta0**2, np.inf))
    quotient = np.where(is_open & (rank > 0), statistic / np.where(rank > 0, own, 1.0), -np.inf)
    if passes_screen is not None:
        quotient = np.where(passes_screen, quotient, np.minimum(quotient, 1.0))
    fault = np.argmax(quotient, axis=1)
    best = np.take_along_axis(statistic, fault[:, None], 1)[:, 0]
    exceeds = np.take_along_axis(quotient, fault[:, None], 1)[:, 0] > 1.0
    failed = (total > limits[dof]) | exceeds
    # Another fault explains the data as well when what it leaves passes and is hardly worse.
    left = total[:, None] - statistic
    rest = limits[np.maximum(dof[:, None] - rank, 0)]
    rival = is_open & (rank > 0) & (left <= rest) & (best[:, None] - statistic <= settings.separation)
    np.put_along_axis(rival, fault[:, None], False, 1)
    removable = (
        np.take_along_axis(rank, fault[:, None], 1)[:, 0] == np.broadcast_to(size, statistic.shape[1:])[fault]
    )
    outcome = np.full(len(total), Outcome.ADAPTED, np.uint8)
    outcome[rival.any(axis=1)] = Outcome.NOT_SEPARATED
    outcome[~removable] = Outcome.NOT_REMOVABLE
    outcome[~exceeds] = Outcome.NOT_IDENTIFIED
    outcome[~failed] = Outcome.PASSED
    return np.where(outcome == Outcome.ADAPTED, fault, -1), outcome


def adapt_model(model, misclosure, shapes, *, settings=None):
    """Test linear models and leave out what contradicts, all epochs at once.

    Parameters
    ----------
    model : LinearModel
        Of e epochs, from `least_squares_model` or `filter_model`.
    misclosure : ndarray, shape (e, r)
        Observed less computed; the innovations of a filter.
    shapes : ndarray, shape (r, f, q)
        Candidate faults, none of them part of another: ``np.eye(r)[:, :, None]`` for single observations,
        `antenna_shapes` for vectors.
    settings : ReliabilitySettings, optional
        What is demanded.

    Returns
    -------
    Adaptation

    Examples
    --------
    Four measurements of one length, the third 10 sigma off:

    >>> from truenorth.attitude.reliability import least_squares_model
    >>> model = least_squares_model(np.ones((1, 4, 1)), 0.01**2 * np.eye(4)[None])
    >>> result = adapt_model(model, np.array([[0.002, -0.004, 0.1, 0.003]]), np.eye(4)[:, :, None])
    >>> int(result.fault[0, 0]), round(float(result.correction[0, 0]), 4)
    (2, 0.0003)
    """
    settings = ReliabilitySettings() if settings is None else settings
    e, f, q = len(model.test), shapes.shape[1], shapes.shape[2]
    test, gain, cov = model.test.copy(), model.gain.copy(), model.cov_unknowns.copy()
    dof = np.full(e, model.dof)
    passes = settings.max_rejections + 1
    outcome = np.full(e, Outcome.PASSED, np.uint8)
    is_rejected = np.zeros((e, f), bool)
    history = {
        name: np.full((e, passes), np.nan)
        for name in ("statistic", "limit", "fault_statistic", "fault_limit")
    }
    blamed = np.full((e, passes), -1)
    open_epochs = np.arange(e)
    for number in range(passes):
        at = open_epochs
        part = LinearModel(model.cov[at], model.weight[at], test[at], gain[at], cov[at], model.dof)
        faults = part.faults(shapes)
        y = misclosure[at]
        total, statistic, rank = part.statistic(y), faults.statistic(y), faults.rank
        screen = None
        if settings.mdb_screen == "innovation":
            residual = np.abs(np.einsum("eij,ejk,ek->ei", part.cov, part.test, y, optimize=True))
            over = residual > part.mdb(settings.delta0)
            screen = np.einsum("er,rfq->ef", over.astype(float), np.abs(shapes)) > 0.0
        fault, found = identify(
            total, dof[at], statistic, rank, q, settings, is_open=~is_rejected[at], passes_screen=screen
        )
        history["statistic"][at, number] = total
        history["limit"][at, number] = [settings.limit(k) for k in dof[at]]
        outcome[at] = np.where((found == Outcome.PASSED) & (number > 0), Outcome.ADAPTED, found)
        go = found == Outcome.ADAPTED
        if number == passes - 1:
            outcome[at[go]] = Outcome.TOO_MANY
        if number == passes - 1 or not go.any():
            break
        rows, chosen = at[go], fault[go]
        picked = np.flatnonzero(go)
        blamed[rows, number] = chosen
        is_rejected[rows, chosen] = True
        history["fault_statistic"][rows, number] = statistic[picked, chosen]
        history["fault_limit"][rows, number] = [settings.limit(k) for k in rank[picked, chosen]]
        shape = np.moveaxis(shapes, 1, 0)[chosen]
        seen = np.linalg.inv(faults.seen[picked, chosen])
        through, weigh = gain[rows] @ shape, test[rows] @ shape
        cov[rows] += through @ seen @ np.swapaxes(through, 1, 2)
        gain[rows] -= through @ seen @ np.swapaxes(weigh, 1, 2)
        test[rows] -= weigh @ seen @ np.swapaxes(weigh, 1, 2)
        dof[rows] -= q
        open_epochs = rows
    correction = np.einsum("eur,er->eu", gain, misclosure)
    lost = outcome > Outcome.ADAPTED
    correction[lost], cov[lost], is_rejected[lost] = np.nan, np.nan, False
    return Adaptation(correction, cov, is_rejected, outcome, fault=blamed, **history)
