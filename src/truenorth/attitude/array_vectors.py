"""Vectors between the antennas of a rigid array at every epoch, with the whole covariance of an epoch.

Once the integers are known, the vectors that the phases give without any geometry, and their joint
covariance, hold all that the phases say about the attitude: adjusting them is adjusting the double
differences of all baselines at once (Teunissen 2012). What rests on them (attitude, filter, tests,
calibration) needs no phases.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

__all__ = ["ArrayVectors", "VectorBlock"]


@dataclass(frozen=True, slots=True, eq=False)
class VectorBlock:
    """Epochs that have the same antennas: k vectors at each of e epochs.

    Parameters
    ----------
    epochs : ndarray of int64, shape (e,)
        Their indices in the run.
    antennas : ndarray of int64, shape (k,)
        Antennas to which the vectors point.
    reference : int
        Antenna from which they point.
    vector_ned_m : ndarray, shape (e, k, 3)
    cov_ned_m2 : ndarray, shape (e, 3 k, 3 k)
        Joint covariance of the epoch's vectors, one after the other.
    body_m : ndarray, shape (k, 3)
        The same vectors in the body frame.
    body_cov_m2 : ndarray, shape (3 k, 3 k)
        Their joint covariance; zero where the coordinates are taken as exact.
    """

    epochs: np.ndarray
    antennas: np.ndarray
    reference: int
    vector_ned_m: np.ndarray
    cov_ned_m2: np.ndarray
    body_m: np.ndarray
    body_cov_m2: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class ArrayVectors:
    """Vectors from one antenna of the array to each other one, m antennas, n epochs.

    Parameters
    ----------
    time_ns : ndarray of int64, shape (n,)
        GPS time.
    reference : ndarray of int64, shape (n,)
        Antenna from which the epoch's vectors point; -1 where there are none.
    vector_ned_m : ndarray, shape (n, m, 3)
        Vectors to each antenna; NaN for the reference itself and for antennas without one.
    cov_ned_m2 : ndarray, shape (n, 3 m, 3 m)
        Joint covariance of the vectors of an epoch; NaN in the rows and columns without one. Single
        precision saves half of the memory.
    positions_body_m : ndarray, shape (m, 3)
        Body coordinates of the antennas.
    body_cov_m2 : ndarray, shape (3 m, 3 m)
        Their joint covariance.
    names : tuple of str
        Of the antennas.
    """

    time_ns: np.ndarray
    reference: np.ndarray
    vector_ned_m: np.ndarray
    cov_ned_m2: np.ndarray
    positions_body_m: np.ndarray
    body_cov_m2: np.ndarray
    names: tuple[str, ...] = ()

    @property
    def n_epochs(self) -> int:
        """int: Number of epochs."""
        return len(self.time_ns)

    @property
    def is_present(self) -> np.ndarray:
        """Ndarray of bool, shape (n, m): antennas that an epoch has a vector to."""
        return np.isfinite(self.vector_ned_m[..., 0])

    def blocks(self, is_used: np.ndarray | None = None, *, max_epochs: int = 20_000) -> Iterator[VectorBlock]:
        """Yield the epochs by the antennas they have, so that each block is one array computation.

        Parameters
        ----------
        is_used : ndarray of bool, shape (n, m), optional
            Vectors that take part; by default all that are there.
        max_epochs : int
            Most epochs of a block.

        Yields
        ------
        VectorBlock
        """
        m = len(self.positions_body_m)
        is_used = self.is_present if is_used is None else is_used & self.is_present
        has_any = is_used.any(1)
        code = (self.reference + 1) * (1 << m) + is_used @ (1 << np.arange(m))
        for value in np.unique(code[has_any]):
            epochs = np.flatnonzero(has_any & (code == value))
            reference = int(self.reference[epochs[0]])
            antennas = np.flatnonzero(is_used[epochs[0]])
            at = (3 * antennas[:, None] + np.arange(3)).ravel()
            # Coordinates of antennas from the reference: what both share of it goes with both.
            jump = np.zeros((len(at), 3 * m))
            jump[np.arange(len(at)), at] = 1.0
            jump[np.arange(len(at)), 3 * reference + np.arange(len(at)) % 3] -= 1.0
            for first in range(0, len(epochs), max_epochs):
                part = epochs[first : first + max_epochs]
                yield VectorBlock(
                    part,
                    antennas,
                    reference,
                    self.vector_ned_m[part][:, antennas],
                    self.cov_ned_m2[part][:, at[:, None], at].astype(float),
                    self.positions_body_m[antennas] - self.positions_body_m[reference],
                    jump @ self.body_cov_m2 @ jump.T,
                )
