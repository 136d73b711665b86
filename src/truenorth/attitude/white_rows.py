r"""Epochs of an array as white observation rows on the coordinates of all antennas.

Vectors z from a reference antenna with covariance C, or the normal matrix N and right side b that the phases
give for them, say the same: with :math:`N = C^{-1}`, :math:`b = N z` and :math:`N = W^T W`,

.. math:: y = W z = W J p + e, \qquad e \sim N(0, I),

p the stacked coordinates of all antennas and J the differences that make the vectors. Behind this form no
antenna is the reference. A normal matrix may be singular, as with too few satellites to have the vectors
themselves: it then gives fewer rows, which hold what the phases do say.

References
----------
P. J. G. Teunissen, "The affine constrained GNSS attitude model and its multivariate integer least-squares
solution", Journal of Geodesy 86 (2012); G. J. Bierman, Factorization Methods for Discrete Sequential
Estimation (1977), on data equations of unit noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..errors import ModelError
from .array_vectors import ArrayVectors

__all__ = ["ArrayInformation", "WhiteRows", "white_rows"]

_RANK = 1e-10
"""Eigenvalues below this share of the largest hold rounding only."""


@dataclass(frozen=True, slots=True, eq=False)
class ArrayInformation:
    """What the phases of every epoch say about the vectors, as normal equations: n epochs, m antennas.

    Parameters
    ----------
    time_ns : ndarray of int64, shape (n,)
        GPS time.
    reference : ndarray of int64, shape (n,)
        Antenna from which the epoch's vectors point; -1 where there are none.
    normal_per_m2 : ndarray, shape (n, 3 m, 3 m)
        Normal matrix on the stacked vectors in north, east, down, ambiguities and clocks eliminated; zero in
        the rows and columns of the reference and of antennas without signals. May be singular.
    right_side_per_m : ndarray, shape (n, 3 m)
        Its right side: normal matrix times vectors.
    positions_body_m : ndarray, shape (m, 3)
        Body coordinates of the antennas.
    body_cov_m2 : ndarray, shape (3 m, 3 m)
        Their joint covariance.
    names : tuple of str
        Of the antennas.
    """

    time_ns: np.ndarray
    reference: np.ndarray
    normal_per_m2: np.ndarray
    right_side_per_m: np.ndarray
    positions_body_m: np.ndarray
    body_cov_m2: np.ndarray
    names: tuple[str, ...] = ()

    @classmethod
    def from_vectors(cls, vectors: ArrayVectors) -> ArrayInformation:
        """Normal equations of vectors: the same numbers in the other form."""
        n, m = vectors.n_epochs, len(vectors.positions_body_m)
        normal, right = np.zeros((n, 3 * m, 3 * m)), np.zeros((n, 3 * m))
        for block in vectors.blocks():
            at = (3 * block.antennas[:, None] + np.arange(3)).ravel()
            inverse = np.linalg.inv(block.cov_ned_m2)
            stacked = block.vector_ned_m.reshape(len(block.epochs), -1)
            normal[block.epochs[:, None, None], at[:, None], at] = inverse
            right[block.epochs[:, None], at] = np.einsum("eij,ej->ei", inverse, stacked)
        return cls(
            vectors.time_ns, vectors.reference, normal, right,
            vectors.positions_body_m, vectors.body_cov_m2, vectors.names,
        )  # fmt: skip

    @property
    def n_epochs(self) -> int:
        """int: Number of epochs."""
        return len(self.time_ns)

    @property
    def is_present(self) -> np.ndarray:
        """Ndarray of bool, shape (n, m): antennas that an epoch has a vector to."""
        diagonal = np.einsum("nii->ni", self.normal_per_m2)
        return diagonal.reshape(self.n_epochs, -1, 3).max(2) > 0.0


class WhiteRows(NamedTuple):
    """Rows ``y = rows @ p + e`` of n epochs, e white with variance one.

    Parameters
    ----------
    n_rows : ndarray of int64, shape (n,)
        How many an epoch has; the others are zero.
    rows : ndarray, shape (n, r, 3 m)
        Design on the stacked antenna coordinates in north, east, down; one over metres.
    y : ndarray, shape (n, r)
        Observations.
    is_seen : ndarray of bool, shape (n, m)
        Antennas that take part, the reference among them.
    """

    n_rows: np.ndarray
    rows: np.ndarray
    y: np.ndarray
    is_seen: np.ndarray


def white_rows(
    measured: ArrayVectors | ArrayInformation, epochs: slice, is_used: np.ndarray | None = None
) -> WhiteRows:
    """White rows of a range of epochs.

    Parameters
    ----------
    measured : ArrayVectors or ArrayInformation
        Vectors with their covariance, or their normal equations.
    epochs : slice
        Which epochs.
    is_used : ndarray of bool, shape (n, m), optional
        Vectors that take part, of all epochs; by default all that are there.

    Returns
    -------
    WhiteRows
        Of those epochs, at most ``3 (m - 1)`` rows each.

    Raises
    ------
    ModelError
        If a covariance is not positive definite.
    """
    m = len(measured.positions_body_m)
    use = measured.is_present[epochs] if is_used is None else measured.is_present[epochs] & is_used[epochs]
    n = len(use)
    result = WhiteRows(
        np.zeros(n, dtype=np.int64),
        np.zeros((n, max(3 * (m - 1), 1), 3 * m)),
        np.zeros((n, max(3 * (m - 1), 1))),
        np.zeros((n, m), dtype=bool),
    )
    reference = measured.reference[epochs]
    if isinstance(measured, ArrayVectors):
        from .._kernels.attitude_filter import whiten_epochs

        part = replace(
            measured,
            time_ns=measured.time_ns[epochs],
            reference=reference,
            vector_ned_m=measured.vector_ned_m[epochs],
            cov_ned_m2=measured.cov_ned_m2[epochs],
        )
        for block in part.blocks(use):
            k = len(block.antennas)
            stacked = np.array(block.vector_ned_m.reshape(len(block.epochs), 3 * k), dtype=float, order="C")
            jump = _differences(block.antennas, block.reference, m)
            cov = np.array(block.cov_ned_m2, dtype=float, order="C")
            failed = whiten_epochs(block.epochs, cov, stacked, jump, result.rows, result.y)
            result.n_rows[block.epochs] = 3 * k
            if failed >= 0:
                time = part.time_ns[block.epochs[failed]]
                raise ModelError(
                    f"the covariance of the vectors at {time} ns is not positive definite; check `cov_ned_m2`"
                )
            result.is_seen[block.epochs[:, None], block.antennas] = True
            result.is_seen[block.epochs, block.reference] = True
        return result
    for base in np.unique(reference[use.any(1)]):
        others = np.array([a for a in range(m) if a != base])
        at = (3 * others[:, None] + np.arange(3)).ravel()
        jump = _differences(others, int(base), m)
        rows = np.flatnonzero(use.any(1) & (reference == base))
        normal = measured.normal_per_m2[epochs][rows][:, at[:, None], at].astype(float)
        right = measured.right_side_per_m[epochs][rows][:, at].astype(float)
        normal, right = _marginalised(normal, right, np.repeat(use[rows][:, others], 3, axis=1))
        values, axes = np.linalg.eigh(normal)
        # Eigenvalues ascend; the largest go first, so that what is left over stands at the end.
        values, axes = values[:, ::-1], axes[:, :, ::-1]
        is_seen = values > _RANK * values[:, :1]
        root = np.sqrt(np.where(is_seen, values, 1.0))
        white = np.where(is_seen, root, 0.0)[:, :, None] * np.swapaxes(axes, 1, 2)
        result.n_rows[rows] = is_seen.sum(1)
        result.rows[rows, : len(at)] = white @ jump
        result.y[rows, : len(at)] = np.where(is_seen, np.einsum("eji,ej->ei", axes, right) / root, 0.0)
        result.is_seen[rows] = use[rows]
        result.is_seen[rows, base] = True
    return result


def _differences(antennas: np.ndarray, reference: int, m: int) -> np.ndarray:
    """Matrix that makes vectors from a reference of the stacked coordinates of m antennas."""
    jump = np.zeros((len(antennas), m))
    jump[np.arange(len(antennas)), antennas] = 1.0
    jump[:, reference] -= 1.0
    return np.kron(jump, np.eye(3))


def _marginalised(
    normal: np.ndarray, right: np.ndarray, is_used: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations of the unknowns that are used, the others eliminated; zero in their rows."""
    for pattern in np.unique(is_used, axis=0):
        if pattern.all():
            continue
        epochs = np.flatnonzero((is_used == pattern).all(1))
        keep, drop = np.flatnonzero(pattern), np.flatnonzero(~pattern)
        inverse = np.linalg.pinv(normal[epochs][:, drop[:, None], drop], hermitian=True)
        mixed = normal[epochs][:, keep[:, None], drop] @ inverse
        less = normal[epochs][:, keep[:, None], keep] - mixed @ normal[epochs][:, drop[:, None], keep]
        rest = right[epochs][:, keep] - np.einsum("eij,ej->ei", mixed, right[epochs][:, drop])
        normal[epochs], right[epochs] = 0.0, 0.0
        normal[epochs[:, None, None], keep[:, None], keep] = less
        right[epochs[:, None], keep] = rest
    return normal, right
