"""Attitude from the vectors of an array, by the method that one asks for.

    attitude_from_vectors(vectors, method="adjustment")

One door to the default, least squares on the rotation group with the whole covariance, and to the published
algorithms beside it, all with the covariance of their angles and the same tests of what can be seen at all:

- antennas on one line, two above all, leave the turn about that line open;
- vectors that are not measured in one direction, as under three satellites, fit two attitudes that are
  mirror images of each other.

What is open is NaN, and the epoch's reason says why.

References
----------
C. Wang, G. Lachapelle, "GPS attitude determination reliability performance improvement using low cost
receivers" (2002); K. Landfahrer, "Attitude determination using a GPS multi antenna array", Graz University
of Technology (2009); J. L. Crassidis, F. L. Markley, Y. Cheng, "Survey of nonlinear attitude estimation
methods", Journal of Guidance, Control, and Dynamics 30 (2007).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import ConfigError, Reason
from ..rotations import heading_pitch_roll, rot_ned_from_body
from .array_vectors import ArrayVectors, VectorBlock
from .classical_vectors import (
    angles_of_matrix,
    angles_of_matrix_jacobian,
    direct_matrix,
    implicit_least_squares,
    pseudoinverse_matrix,
    triad_matrix,
    wahba_of_points,
)
from .vectors import (
    angle_covariance,
    angle_jacobian,
    array_extent_m,
    fit_rotation,
    mirrored_rotation,
    total_covariance,
    weighted_square,
)

__all__ = ["VECTOR_METHODS", "AttitudeFit", "BlockAttitude", "attitude_from_vectors", "solve_block"]

VECTOR_METHODS = ("adjustment", "implicit", "wahba", "direct", "triad", "pseudoinverse")
"""Names of the methods; the first is the default."""

MIN_ACROSS_M = 0.02
"""Antennas nearer than this to one line leave the rotation about it to the noise of the phases."""

ALONG_X = 0.002
"""A line of antennas within this angle, radians, of the x axis gives heading and pitch whatever the roll."""

WEAK_SHARE = 0.03
"""From this standard deviation on, as a share of the array's extent, the mirror image is tried as well:
with phases of millimetres its vectors fit no worse than the noise from about 0.05 on."""

CLEARLY_WORSE = 13.8
"""A rival must be worse by this much in chi-square, a likelihood ratio of a thousand."""

MAX_SD_RAD = 0.5
"""An attitude known no better than this is not known."""


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeFit:
    """Attitude at every epoch from its vectors; n epochs, m antennas.

    Parameters
    ----------
    time_ns : ndarray of int64, shape (n,)
        GPS time.
    method : str
        One of `VECTOR_METHODS`.
    rot_ned_from_body : ndarray, shape (n, 3, 3)
        NaN where one of the angles is.
    heading_rad, pitch_rad, roll_rad : ndarray, shape (n,)
        NaN where it cannot be observed.
    cov_rad2 : ndarray, shape (n, 3, 3)
        Covariance of heading, pitch and roll.
    cov_ned_rad2 : ndarray, shape (n, 3, 3)
        Covariance of a small turn of the attitude in north, east, down; NaN where the rotation is.
    chi2 : ndarray, shape (n,)
        Squares of the residuals in the metric of their covariance. For "adjustment" and "implicit" their
        minimum, which is chi-square distributed; larger for the other methods.
    dof : ndarray of int64, shape (n,)
        Coordinates less angles.
    residual_ned_m : ndarray, shape (n, m, 3)
        Measured less fitted vectors, also where one angle is open; NaN for vectors that took no part.
    is_used : ndarray of bool, shape (n, m)
        Vectors that took part.
    is_solved : ndarray of bool, shape (n,)
        Epochs with a heading.
    reason : ndarray of uint8, shape (n,)
        Code of `truenorth.errors.Reason`.
    """

    time_ns: np.ndarray
    method: str
    rot_ned_from_body: np.ndarray
    heading_rad: np.ndarray
    pitch_rad: np.ndarray
    roll_rad: np.ndarray
    cov_rad2: np.ndarray
    cov_ned_rad2: np.ndarray
    chi2: np.ndarray
    dof: np.ndarray
    residual_ned_m: np.ndarray
    is_used: np.ndarray
    is_solved: np.ndarray
    reason: np.ndarray

    @property
    def n_epochs(self) -> int:
        """int: Number of epochs."""
        return len(self.time_ns)

    @property
    def angles_rad(self) -> np.ndarray:
        """Ndarray, shape (n, 3): heading, pitch, roll."""
        return np.stack([self.heading_rad, self.pitch_rad, self.roll_rad], axis=-1)

    def angle_sd_rad(self, k: int) -> np.ndarray:
        """Standard deviations of heading (0), pitch (1) or roll (2), ndarray, shape (n,)."""
        return np.sqrt(self.cov_rad2[:, k, k])


@dataclass(frozen=True, slots=True, eq=False)
class BlockAttitude:
    """Attitude of the epochs of one block; e epochs, k vectors.

    Parameters
    ----------
    angle_rad, cov_rad2, rot_ned_from_body, cov_ned_rad2 : ndarray
        Shapes (e, 3), (e, 3, 3), (e, 3, 3), (e, 3, 3); NaN where open.
    residual_m : ndarray, shape (e, k, 3)
    chi2 : ndarray, shape (e,)
    dof : int
    reason : ndarray of uint8, shape (e,)
    """

    angle_rad: np.ndarray
    cov_rad2: np.ndarray
    rot_ned_from_body: np.ndarray
    cov_ned_rad2: np.ndarray
    residual_m: np.ndarray
    chi2: np.ndarray
    dof: int
    reason: np.ndarray

    @property
    def is_solved(self) -> np.ndarray:
        """Ndarray of bool, shape (e,): epochs with a heading."""
        return np.isfinite(self.angle_rad[:, 0])


def attitude_from_vectors(
    vectors: ArrayVectors,
    method: str = "adjustment",
    *,
    is_used: np.ndarray | None = None,
    pairs: Sequence[tuple[int, int]] | None = None,
    with_cross: bool = True,
) -> AttitudeFit:
    """Attitude of a rigid array at every epoch from the vectors between its antennas.

    Parameters
    ----------
    vectors : ArrayVectors
        Vectors with their joint covariance, and the body coordinates with theirs.
    method : str
        ``adjustment``: weighted least squares on the rotation group with both covariances, for any number
        of antennas. ``implicit``: the same condition in the angles themselves (Wang & Lachapelle 2002).
        ``wahba``: by singular values, the reference antenna being one point of equal weight among others.
        ``direct``: two vectors and their cross product; ``triad``: the same made orthogonal;
        ``pseudoinverse``: any number of vectors, unweighted (Landfahrer 2009). All but the first need
        antennas off one line.
    is_used : ndarray of bool, shape (n, m), optional
        Vectors that take part; all by default.
    pairs : sequence of (int, int), optional
        For the three methods of Landfahrer: antennas from which and to which each vector runs. ``direct``
        and ``triad`` take two; with ``triad`` the second one is kept and the first one made orthogonal to
        it. By default the first two vectors of the epoch that are not on one line, and for
        ``pseudoinverse`` all of them. Epochs without one of the antennas are not solved.
    with_cross : bool
        ``pseudoinverse``: append the cross product of the first two vectors as one more column.

    Returns
    -------
    AttitudeFit

    Raises
    ------
    ConfigError
        If there is no such method, or it takes no such vectors.
    """
    if method not in VECTOR_METHODS:
        raise ConfigError(
            f"no method `{method}` for the attitude from vectors; give one of {', '.join(VECTOR_METHODS)}",
            key="method",
            value=method,
        )
    n, m = vectors.n_epochs, len(vectors.positions_body_m)
    if pairs is not None:
        _check_pairs(pairs, m, method)
    angle, cov = np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
    rot, cov_ned = np.full((n, 3, 3), np.nan), np.full((n, 3, 3), np.nan)
    chi2, dof = np.full(n, np.nan), np.zeros(n, np.int64)
    residual = np.full((n, m, 3), np.nan)
    used = np.zeros((n, m), bool)
    reason = np.full(n, Reason.NO_VECTORS, np.uint8)
    for block in vectors.blocks(is_used):
        found = solve_block(block, method, pairs=pairs, with_cross=with_cross)
        at = block.epochs
        angle[at], cov[at], rot[at], cov_ned[at] = (
            found.angle_rad, found.cov_rad2, found.rot_ned_from_body, found.cov_ned_rad2,
        )  # fmt: skip
        chi2[at], dof[at], reason[at] = found.chi2, found.dof, found.reason
        residual[np.ix_(at, block.antennas)] = found.residual_m
        used[np.ix_(at, block.antennas)] = np.isfinite(found.chi2)[:, None]
    return AttitudeFit(
        vectors.time_ns, method, rot, *angle.T, cov, cov_ned, chi2, dof, residual, used,
        np.isfinite(angle[:, 0]), reason,
    )  # fmt: skip


def solve_block(
    block: VectorBlock,
    method: str = "adjustment",
    *,
    pairs: Sequence[tuple[int, int]] | None = None,
    with_cross: bool = True,
) -> BlockAttitude:
    """Attitude of the epochs of one block; see `attitude_from_vectors`.

    Parameters
    ----------
    block : VectorBlock
    method, pairs, with_cross
        As of `attitude_from_vectors`.

    Returns
    -------
    BlockAttitude
    """
    _, across, axis = array_extent_m(block.body_m)
    is_line = bool(across < MIN_ACROSS_M)
    good = _is_positive_definite(block.cov_ned_m2)
    if not good.all():
        return _spread(solve_block(_part(block, good), method, pairs=pairs, with_cross=with_cross), good)
    if is_line and method != "adjustment":
        return _not_solved(block, axis)
    if method == "adjustment":
        fit = _adjust(block, axis if is_line else None)
        rot, cov_ned, residual, chi2 = fit[:4]
        cov = angle_covariance(rot, cov_ned)
    else:
        solved = _angles_by(block, method, pairs, with_cross)
        if solved is None:
            return _not_solved(block, axis)
        angle, cov = solved
        rot = rot_ned_from_body(*angle.T)
        axes = np.linalg.inv(angle_jacobian(rot))
        cov_ned = axes @ cov @ np.swapaxes(axes, 1, 2)
        residual = block.vector_ned_m - np.einsum("nij,kj->nki", rot, block.body_m)
        chi2 = weighted_square(residual, total_covariance(block.cov_ned_m2, rot, block.body_cov_m2))
    reason = np.full(len(rot), Reason.OK, np.uint8)
    _settle_mirror_images(
        block, axis if is_line else None, method, (rot, cov_ned, cov, residual, chi2), reason
    )
    return _result(rot, cov_ned, cov, residual, chi2, reason, axis if is_line else None)


def _adjust(block, free_axis_body, start_ned_from_body=None):
    return fit_rotation(
        block.vector_ned_m,
        block.cov_ned_m2,
        block.body_m,
        body_cov_m2=block.body_cov_m2 if np.any(block.body_cov_m2) else None,
        free_axis_body=free_axis_body,
        start_ned_from_body=start_ned_from_body,
    )


def _angles_by(block, method, pairs, with_cross):
    """Angles and their covariance by one of the published methods; None where vectors are missing."""
    if method == "implicit":
        return implicit_least_squares(
            block.vector_ned_m, block.cov_ned_m2, block.body_m, body_cov_m2=block.body_cov_m2
        )
    if method == "wahba":
        rot, jacobian = wahba_of_points(block.vector_ned_m, block.body_m)
        angle = np.stack(heading_pitch_roll(rot), axis=-1)
        by_vector = angle_jacobian(rot) @ jacobian
        cov = total_covariance(block.cov_ned_m2, rot, block.body_cov_m2)
        return angle, by_vector @ cov @ np.swapaxes(by_vector, 1, 2)
    chosen = _difference_matrix(block, method, pairs)
    if chosen is None:
        return None
    vector_m, body_m = np.einsum("pk,nki->npi", chosen, block.vector_ned_m), chosen @ block.body_m
    if method == "pseudoinverse":
        matrix, jacobian = pseudoinverse_matrix(vector_m, body_m, with_cross=with_cross)
    else:
        matrix, jacobian = (direct_matrix if method == "direct" else triad_matrix)(vector_m, body_m)
    angle = angles_of_matrix(matrix)
    # The components of the epoch's vectors from those of the pairs.
    by_vector = np.einsum("nhab,nabq->nhq", angles_of_matrix_jacobian(matrix), jacobian)
    by_vector = by_vector @ np.kron(chosen, np.eye(3))
    cov = total_covariance(block.cov_ned_m2, rot_ned_from_body(*angle.T), block.body_cov_m2)
    return angle, by_vector @ cov @ np.swapaxes(by_vector, 1, 2)


def _difference_matrix(block, method, pairs):
    """Vectors of the pairs as sums and differences of the block's, shape (p, k); None if some are missing."""
    k = len(block.antennas)
    if pairs is None:
        rows = list(range(k)) if method == "pseudoinverse" else []
        if method != "pseudoinverse":
            rows = next(
                [i, j]
                for i in range(k)
                for j in range(i + 1, k)
                if array_extent_m(block.body_m[[i, j]])[1] >= MIN_ACROSS_M
            )
        return np.eye(k)[rows]
    place = {int(antenna): row for row, antenna in enumerate(block.antennas)}
    if not all(antenna == block.reference or antenna in place for pair in pairs for antenna in pair):
        return None
    chosen = np.zeros((len(pairs), k))
    for row, (first, last) in enumerate(pairs):
        if last in place:
            chosen[row, place[last]] += 1.0
        if first in place:
            chosen[row, place[first]] -= 1.0
    return chosen


def _settle_mirror_images(block, free_axis_body, method, solution, reason):
    """Try the mirror image where one direction is weakly measured; the better one is kept, in place.

    Where both fit, or the attitude is not known at all, `reason` says so.
    """
    rot, cov_ned, cov, residual, chi2 = solution
    n, k = block.vector_ned_m.shape[:2]
    own = np.einsum("nkikj->nij", block.cov_ned_m2.reshape(n, k, 3, k, 3)) / k
    extent_m = np.sqrt(np.mean(np.sum(block.body_m**2, axis=1)))
    weak = np.flatnonzero(np.einsum("nii->n", own) > (WEAK_SHARE * extent_m) ** 2)
    if len(weak) == 0:
        return
    direction = np.linalg.eigh(own[weak])[1][:, :, 2]
    some = _part(block, weak)
    first = _adjust(some, free_axis_body)
    start = mirrored_rotation(first.rot_ned_from_body, block.body_m, direction)
    other = _adjust(some, free_axis_body, start)
    turn = np.swapaxes(first.rot_ned_from_body, 1, 2) @ other.rot_ned_from_body
    moved = np.sqrt(np.sum((turn @ block.body_m.T - block.body_m.T) ** 2, axis=(1, 2)))
    is_other = moved > 1e-4 * extent_m
    better = is_other & other.is_converged & (other.chi2 < first.chi2)
    ambiguous = is_other & (np.abs(other.chi2 - first.chi2) < CLEARLY_WORSE)
    if method == "adjustment":
        at = weak[better]
        rot[at], cov_ned[at] = other.rot_ned_from_body[better], other.cov_ned_rad2[better]
        residual[at], chi2[at] = other.residual_m[better], other.chi2[better]
        cov[at] = angle_covariance(rot[at], cov_ned[at])
    else:
        ambiguous |= better
    reason[weak[ambiguous]] = Reason.MIRROR_AMBIGUOUS
    turns = cov_ned[weak]
    if free_axis_body is not None:
        across = np.eye(3) - np.einsum("ni,nj->nij", *2 * [rot[weak] @ free_axis_body])
        turns = across @ turns @ across
    # Near the level the normal equations of a tilt that is not measured lead nowhere.
    unknown = ~(first.is_converged | better) | (np.linalg.eigvalsh(turns)[:, 2] > MAX_SD_RAD**2)
    reason[weak[unknown]] = Reason.WEAK_GEOMETRY


def _result(rot, cov_ned, cov, residual, chi2, reason, line):
    """Angles with what is open taken out."""
    angle = np.stack(heading_pitch_roll(rot), axis=-1)
    if line is not None:
        is_ahead = np.hypot(line[1], line[2]) <= ALONG_X
        reason[reason == Reason.OK] = Reason.ROLL_UNOBSERVABLE if is_ahead else Reason.DIRECTION_ONLY
        angle[:, 2], cov[:, 2, :], cov[:, :, 2], rot[:], cov_ned[:] = np.nan, np.nan, np.nan, np.nan, np.nan
    open_ = (reason != Reason.OK) & (reason != Reason.ROLL_UNOBSERVABLE)
    angle[open_], cov[open_], rot[open_], cov_ned[open_] = np.nan, np.nan, np.nan, np.nan
    dof = 3 * residual.shape[1] - (3 if line is None else 2)
    return BlockAttitude(angle, cov, rot, cov_ned, residual, chi2, dof, reason)


def _not_solved(block, line):
    """A method that needs what the block does not have."""
    n, k = block.vector_ned_m.shape[:2]
    nan = np.full((n, 3, 3), np.nan)
    is_ahead = np.hypot(line[1], line[2]) <= ALONG_X
    _, across, _ = array_extent_m(block.body_m)
    reason = Reason.NO_VECTORS
    if across < MIN_ACROSS_M:
        reason = Reason.ROLL_UNOBSERVABLE if is_ahead else Reason.DIRECTION_ONLY
    return BlockAttitude(
        nan[:, 0], nan, nan, nan, np.full((n, k, 3), np.nan), nan[:, 0, 0], 3 * k - 3,
        np.full(n, reason, np.uint8),
    )  # fmt: skip


def _is_positive_definite(cov_m2):
    """Epochs whose covariance can be factored."""
    good = np.isfinite(cov_m2).all((1, 2))
    try:
        np.linalg.cholesky(cov_m2[good])
    except np.linalg.LinAlgError:
        variance = np.linalg.eigvalsh(cov_m2[good])
        good[good] = variance[:, 0] > 1e-14 * variance[:, -1]
    return good


def _part(block, rows):
    return VectorBlock(
        block.epochs[rows], block.antennas, block.reference, block.vector_ned_m[rows],
        block.cov_ned_m2[rows], block.body_m, block.body_cov_m2,
    )  # fmt: skip


def _spread(found, rows):
    """Result of some epochs among all, the others without one."""

    def among(values):
        whole = np.full((len(rows), *values.shape[1:]), np.nan)
        whole[rows] = values
        return whole

    reason = np.full(len(rows), Reason.WEAK_GEOMETRY, np.uint8)
    reason[rows] = found.reason
    return BlockAttitude(
        among(found.angle_rad), among(found.cov_rad2), among(found.rot_ned_from_body),
        among(found.cov_ned_rad2), among(found.residual_m), among(found.chi2), found.dof, reason,
    )  # fmt: skip


def _check_pairs(pairs, m, method):
    for pair in pairs:
        if len(pair) != 2 or not all(0 <= antenna < m for antenna in pair) or pair[0] == pair[1]:
            raise ConfigError(
                f"{pair!r} in `pairs` are not two of the {m} antennas; give numbers from 0", key="pairs"
            )
    if method in ("direct", "triad") and len(pairs) != 2:
        raise ConfigError(f"`pairs` holds {len(pairs)} vectors; the method `{method}` takes two", key="pairs")
