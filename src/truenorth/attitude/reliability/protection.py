r"""Protection levels of angles by solution separation over single faults.

The level L of an angle is exceeded by its error, in an epoch that passed its tests, with at most the
integrity risk I. With right integers and at most one antenna (or satellite) at fault,

    P(N > L / s_0)  +  sum_i p_i P(N > (L - T_i) / s_i)  <=  I - p_wrong - p_many

N is the size of a standard normal quantity, s_0 the standard deviation of the angle, s_i that without what
fault i touches, p_i its prior probability. T_i bounds the difference of the two solutions in an epoch that
passed: it is linear in the misclosure and lies in the space of the fault, so a test of that fault (or of the
whole model) with limit k bounds it by T_i = sqrt(k) d_i, d_i^2 = s_i^2 - s_0^2. A fault may have any size
and direction. The risk of wrong integers, p_wrong, and of two faults at once, p_many, are not covered by a
level and are taken off the risk: where they exceed it, there is none. A fault without redundancy (its d_i is
infinite) costs its whole prior.

References
----------
J. Blanch, T. Walter, P. Enge et al., "Advanced RAIM user algorithm description: integrity support message
processing, fault detection, exclusion, and protection level calculation", ION GNSS (2012); M. Brenner,
"Integrated GPS/inertial fault detection availability", Navigation 43 (1996).
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from .significance import normal_tail, normal_tail_quantile

__all__ = ["PROTECTION_SENTENCES", "ProtectionState", "multiple_fault_risk", "protection_level"]

_HALVINGS = 16
# Of a bracket of some per cent: to a part in a million.


class ProtectionState(IntEnum):
    """Why an angle has the protection level that it has."""

    OK = 0
    NOT_SOLVED = 1
    WRONG_INTEGERS = 2
    MULTIPLE_FAULTS = 3
    NO_REDUNDANCY = 4
    NOT_OBSERVABLE = 5


PROTECTION_SENTENCES = {
    ProtectionState.OK: "the level holds at the stated risk",
    ProtectionState.NOT_SOLVED: "the epoch has no attitude",
    ProtectionState.WRONG_INTEGERS: "the integers are wrong with a probability above the integrity risk",
    ProtectionState.MULTIPLE_FAULTS: "two faults at once are more probable than the integrity risk",
    ProtectionState.NO_REDUNDANCY: "a fault that no test can see is more probable than the integrity risk",
    ProtectionState.NOT_OBSERVABLE: "the antennas do not determine the angle",
}


def multiple_fault_risk(prior):
    """Probability that two or more of several independent faults are there at once.

    Parameters
    ----------
    prior : ndarray, shape (..., f)
        Probability of each.

    Returns
    -------
    ndarray, shape (...)
    """
    prior = np.asarray(prior, dtype=float)
    # The share of exactly none and one, summed from the small end to keep the digits of small priors.
    count = np.zeros((*prior.shape[:-1], 3))
    count[..., 0] = 1.0
    for p in np.moveaxis(prior, -1, 0):
        count[..., 2] += p * count[..., 1]
        count[..., 1] += p * (count[..., 0] - count[..., 1])
        count[..., 0] *= 1.0 - p
    return count[..., 2]


def protection_level(sd, separation_sd, prior, limit, *, risk, wrong_integer_risk=0.0):
    """Protection levels of quantities with a normal error.

    Parameters
    ----------
    sd : ndarray, shape (e, a)
        Standard deviation of each quantity.
    separation_sd : ndarray, shape (e, a, f)
        Standard deviation of the difference to the solution without fault f; infinite where that does not
        determine the quantity.
    prior : ndarray, shape (f,)
        Probability of each fault.
    limit : ndarray, shape (e, f)
        Limit of a chi-square test that every epoch with a level has passed, for each fault.
    risk : float
        Integrity risk of each quantity.
    wrong_integer_risk : float or ndarray, shape (e,)
        Probability of wrong integers.

    Returns
    -------
    level : ndarray, shape (e, a)
        In the units of `sd`; infinite where there is none.
    state : ndarray of uint8, shape (e, a)
        Codes of `ProtectionState`.
    """
    sd, separation_sd = np.asarray(sd, dtype=float), np.asarray(separation_sd, dtype=float)
    e, a = sd.shape
    prior = np.asarray(prior, dtype=float)
    blind = np.isinf(separation_sd)
    wrong = np.broadcast_to(np.asarray(wrong_integer_risk, dtype=float), (e,))[:, None]
    wrong = np.where(np.isnan(wrong), 1.0, wrong)
    many = multiple_fault_risk(prior)
    unseen = np.sum(np.where(blind, prior, 0.0), axis=-1)
    state = np.zeros((e, a), np.uint8)
    # In the order of what a user can do about it; the first that exceeds the risk names the reason.
    for code, used in (
        (ProtectionState.NO_REDUNDANCY, wrong + many + unseen),
        (ProtectionState.MULTIPLE_FAULTS, np.broadcast_to(wrong + many, (e, a))),
        (ProtectionState.WRONG_INTEGERS, np.broadcast_to(wrong, (e, a))),
    ):
        state[used >= risk] = code
    state[~np.isfinite(sd)] = ProtectionState.NOT_SOLVED
    level = np.full((e, a), np.inf)
    at, angle = np.nonzero(state == ProtectionState.OK)
    if len(at):
        left = risk - (wrong[at, 0] + many + unseen[at, angle])
        d = separation_sd[at, angle]
        weight = np.concatenate([np.ones((len(at), 1)), np.broadcast_to(prior, d.shape)], axis=1)
        is_blind = np.isinf(d)
        weight[:, 1:][is_blind] = 0.0
        d = np.where(is_blind, 0.0, d)
        own = sd[at, angle][:, None]
        spread = np.concatenate([own, np.sqrt(own**2 + d**2)], axis=1)
        bound = np.sqrt(np.where(d > 0.0, limit[at], 0.0)) * d
        offset = np.concatenate([np.zeros_like(own), bound], axis=1)
        level[at, angle] = _solve(spread, offset, weight, left)
    return level, state


def _solve(spread, offset, weight, risk):
    """Level at which weighted tails beyond offsets add up to a risk, from above; rows by hypotheses."""
    share = np.where(weight > 0.0, risk[:, None] / np.where(weight > 0.0, weight, 1.0), np.inf)
    alone = np.where(share < 1.0, offset + spread * normal_tail_quantile(np.minimum(share, 1.0)), 0.0)
    together = share / spread.shape[1]
    high = np.where(
        together < 1.0, offset + spread * normal_tail_quantile(np.minimum(together, 1.0)), 0.0
    ).max(1)
    low = alone.max(axis=1)
    # The table of the tail is good to 4e-6; the bracket is opened by more than that.
    low, high = low * (1.0 - 1e-4), high * (1.0 + 1e-4)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        total = np.sum(weight * normal_tail((middle[:, None] - offset) / spread), axis=1)
        exceeded = total > risk
        low, high = np.where(exceeded, middle, low), np.where(exceeded, high, middle)
    return high
