r"""What a record tells of each state, and what it leaves as it was.

A state is observed as far as its standard deviation falls below the one it would have without measurements.
At rest some combinations cannot be told apart: an east gyro bias from a wrong heading, a level accelerometer
bias from a tilt. They show as pairs with a correlation near one of which the bias keeps what it had. In full,
with the covariance P at the end and the prior variances on the diagonal D, the eigenvalues of
:math:`D^{-1/2} P D^{-1/2}` are the shares of variance that are left in each direction: 1 says that the record
told nothing of it.

References
----------
Ham, F. M., Brown, R. G., "Observability, eigenvalues, and Kalman filtering", IEEE Transactions on Aerospace
and Electronic Systems 19 (1983) 269-273.
Bar-Itzhack, I. Y., Berman, N., "Control theoretic approach to inertial navigation systems", J. Guidance,
Control, and Dynamics 11 (1988) 237-245.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..constants import DPH_RADPS, UG_MPS2
from .fine_filter import FilterPass
from .fine_model import ErrorModel

__all__ = ["Observability", "ObservedState", "observe"]

_ANY_SD_RAD = np.pi / np.sqrt(3.0)
"""Of an angle of which nothing is known."""

SEEN, HARDLY = 0.3, 0.9
"""Ratios of standard deviations: below the first a state is observed, above the second it is not."""


@dataclass(frozen=True, slots=True)
class ObservedState:
    """One state and what the record told of it.

    Parameters
    ----------
    name : str
        E.g. ``gyro bias east``; directions are those at the end of the record.
    unit : str
        ``deg``, ``deg/h`` or ``ug``.
    before, after : float
        Standard deviations without and with the record.
    partner : str
        The state of the other kind with which its error goes along most.
    correlation : float
        Of the two errors.
    """

    name: str
    unit: str
    before: float
    after: float
    partner: str
    correlation: float

    @property
    def ratio(self) -> float:
        """float: What is left of the standard deviation."""
        return self.after / self.before if self.before > 0.0 else 1.0

    @property
    def sentence(self) -> str:
        """str: What a person is told."""
        size = f"{self.after:.3g} {self.unit}"
        if self.ratio < SEEN:
            told = f"{self.name} is observed: {self.before:.3g} came down to {size}"
        elif self.ratio < HARDLY:
            told = f"{self.name} is observed in part: {self.before:.3g} came down to {size}"
        else:
            told = f"{self.name} is not observed: {size}, as before the record"
        if abs(self.correlation) > 0.9:
            told += f"; its error shows as one of {self.partner}"
        return f"{told}."


@dataclass(frozen=True, slots=True, eq=False)
class Observability:
    """What the record tells of attitude and biases.

    Parameters
    ----------
    states : tuple of ObservedState
        Heading, tilts, and the biases along north, east and down at the end.
    names : tuple of str
        Of the components of the directions.
    left : ndarray, shape (9,)
        Share of the standard deviation that is left in each direction, ascending.
    directions : ndarray, shape (9, 9)
        Column j is the direction of ``left[j]`` in states divided by their standard deviation before.
    """

    states: tuple[ObservedState, ...]
    names: tuple[str, ...]
    left: np.ndarray
    directions: np.ndarray

    @property
    def sentences(self) -> tuple[str, ...]:
        """Tuple of str: One for each state."""
        return tuple(state.sentence for state in self.states)


def observe(model: ErrorModel, forward: FilterPass, rot_ned_from_body: np.ndarray) -> Observability:
    """Observability of attitude and biases from a pass of the filter.

    Parameters
    ----------
    model : ErrorModel
        States and noises.
    forward : FilterPass
        What the pass left.
    rot_ned_from_body : ndarray, shape (3, 3)
        Attitude at the end.

    Returns
    -------
    Observability
    """
    rows = np.zeros((9, model.n))
    rows[:3, :3] = np.eye(3)
    rows[3:6] = rot_ned_from_body @ model.gyro_sum
    rows[6:] = rot_ned_from_body @ model.accel_sum
    cov = rows @ forward.cov @ rows.T
    # Biases without measurements at the end: what the start had, decayed, and what came in since.
    number = len(forward.action) - 1
    start = np.diag(model.start_cov)[9:]
    added = model.process_cov[1]
    decay2 = model.decay**2
    steady = decay2 < 1.0
    fallen = decay2**number
    grown = np.where(steady, (1.0 - fallen) / np.where(steady, 1.0 - decay2, 1.0), float(number))
    free = np.concatenate([np.zeros(9), start * fallen + added * grown])
    before = np.sqrt(np.einsum("ij,j,ij->i", rows, free, rows))
    before[:3] = _ANY_SD_RAD
    after = np.sqrt(np.diag(cov))
    after[2] = min(after[2], before[2])
    names = (
        "tilt about north",
        "tilt about east",
        "heading",
        *(f"gyro bias {way}" for way in ("north", "east", "down")),
        *(f"accelerometer bias {way}" for way in ("north", "east", "down")),
    )
    units = (
        [(1.0 / np.radians(1.0), "deg")] * 3 + [(1.0 / DPH_RADPS, "deg/h")] * 3 + [(1.0 / UG_MPS2, "ug")] * 3
    )
    sd = np.sqrt(np.maximum(np.diag(cov), 1e-300))
    correlation = cov / np.outer(sd, sd)
    states = []
    for k in range(9):
        others = np.abs(correlation[k])
        others[3 * (k // 3) : 3 * (k // 3) + 3] = 0.0
        partner = int(np.argmax(others))
        factor, unit = units[k]
        states.append(
            ObservedState(
                names[k],
                unit,
                float(factor * before[k]),
                float(factor * after[k]),
                names[partner],
                float(correlation[k, partner]),
            )
        )
    scale = np.maximum(before, 1e-300)
    left, directions = np.linalg.eigh(cov / np.outer(scale, scale))
    return Observability(tuple(states), names, np.sqrt(np.maximum(left, 0.0)), directions)
