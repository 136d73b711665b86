r"""The shape of an array from its vectors: body coordinates common to all epochs, a rotation of each epoch.

With the body coordinates l_a of the antennas and the vectors b_a from the reference antenna r,

    b_ka = R_k (l_a - l_r) + e_ka,        Cov(e_k) = C_k  (3 k x 3 k, the reference shared by all vectors).

A step turns R_k <- R_k exp([p_k]x); in the body frame of the epoch, W = (R^T C R)^-1,

    R^T b - (l_a - l_r) = J dl + B p_k,      B = -[l_a - l_r]x,

and eliminating p_k leaves the normal matrix sum_k J^T (W - W B (B^T W B)^+ B^T W) J of the coordinates alone.
The scale comes from the phases; six motions of the body frame stay free. At rest one p serves all epochs.

A rotation fitted to vectors with errors takes part of the errors for rotation, and the squares of what it
takes do not average out: vectors appear longer by (tr(P) 1 - P) l / 2, with P = (B^T W B)^+ the covariance of
p. That is taken off (for two antennas it is the known excess of a length, sigma^2 / L).

References
----------
W. Förstner, B. P. Wrobel, "Photogrammetric Computer Vision", 2016, sec. 15 (adjustment by elimination);
I. Borg, P. J. F. Groenen, "Modern Multidimensional Scaling", 2005, sec. 12.1 (the start, from distances).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..ambiguity.acceptance import chi2_quantile
from ..attitude.array_vectors import ArrayVectors
from ..attitude.vectors import wahba_rotation
from ..errors import NoSolutionError
from ..rotations import exp_so3, skew
from .body_frame import MIN_ACROSS_M

__all__ = ["ShapeFit", "fit_shape", "is_at_rest", "shape_from_distances"]

MAX_STEPS = 15
STEP_LIMIT_M = 1e-7
MAX_PASSES = 5
"""Epochs are rejected, and the rest adjusted again, so many times at most."""

REJECT_RISK = 1e-6
"""Risk of rejecting a good epoch; wrong integers are off by decimetres."""

AT_REST = 10.0
"""A platform whose attitudes differ from their middle by less than this, chi-square per angle, is at rest."""


class ShapeFit(NamedTuple):
    """Adjusted coordinates in some body frame.

    Parameters
    ----------
    positions_m : ndarray, shape (m, 3)
        Their mean is zero.
    normal : ndarray, shape (3 m, 3 m)
        Of the coordinates, rotations eliminated; six motions are in its null space.
    free : ndarray, shape (3 m, p)
        Basis of changes of the coordinates that were adjusted.
    score : ndarray, shape (n, 3 m)
        What each epoch contributes to the right-hand side; zero where it was not used.
    misfit, degrees : ndarray, shape (n,)
        Square sum of residuals and its degrees of freedom; NaN and 0 where there were no vectors.
    is_used : ndarray of bool, shape (n,)
        Epochs that took part.
    rot_ned_from_body : ndarray, shape (n, 3, 3)
        NaN without vectors. Of antennas on one line, the turn about it means nothing.
    is_static : bool
        Whether one rotation served all epochs.
    is_line : bool
        Whether the antennas stand on one line (two always do); only distances along it were adjusted.
    """

    positions_m: np.ndarray
    normal: np.ndarray
    free: np.ndarray
    score: np.ndarray
    misfit: np.ndarray
    degrees: np.ndarray
    is_used: np.ndarray
    rot_ned_from_body: np.ndarray
    is_static: bool
    is_line: bool


def shape_from_distances(vectors: ArrayVectors):
    """Coordinates of the antennas from the medians of their distances, in some frame.

    Parameters
    ----------
    vectors : ArrayVectors
        Some epochs may be wrong.

    Returns
    -------
    ndarray, shape (m, 3)
        Their mean is zero. Of the two mirror images of an array that is not flat, the one that fits.

    Raises
    ------
    NoSolutionError
        If two antennas are never seen together.
    """
    m = len(vectors.positions_body_m)
    place = vectors.vector_ned_m.copy()
    known = np.flatnonzero(vectors.reference >= 0)
    place[known, vectors.reference[known]] = 0.0
    square = np.zeros((m, m))
    for i in range(m):
        for j in range(i + 1, m):
            apart = place[:, i] - place[:, j]
            rows = np.flatnonzero(np.isfinite(apart[:, 0]))
            if len(rows) == 0:
                names = [vectors.names[k] if vectors.names else f"antenna {k}" for k in (i, j)]
                raise NoSolutionError(
                    f"could not calibrate the array: no epoch has both {names[0]} and {names[1]}; give "
                    "observations of all antennas at the same time"
                )
            noise = _distance_noise(vectors, rows, i, j)
            square[i, j] = square[j, i] = np.median(np.sum(apart[rows] ** 2, axis=1) - noise)
    centre = np.eye(m) - 1.0 / m
    size, axes = np.linalg.eigh(-0.5 * centre @ square @ centre)
    size, axes = np.append(size[::-1], np.zeros(3))[:3], np.hstack([axes[:, ::-1], np.zeros((m, 3))])[:, :3]
    positions = axes * np.sqrt(np.maximum(size, 0.0))
    mirrored = positions * [1.0, 1.0, -1.0]
    if m < 4:
        return positions
    return min((positions, mirrored), key=lambda shape: _median_misfit(vectors, shape))


def _distance_noise(vectors, rows, i, j):
    """Expected square of the noise of the difference of two places."""
    total = 0.0
    for k in (i, j):
        own = vectors.cov_ned_m2[rows, 3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
        total = total + np.nan_to_num(np.einsum("nii->n", own).astype(float))
    cross = vectors.cov_ned_m2[rows, 3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
    return total - 2.0 * np.nan_to_num(np.einsum("nii->n", cross).astype(float))


def _median_misfit(vectors, shape):
    """Median over epochs of the distance that is left after the best rotation."""
    left = []
    for block in vectors.blocks():
        if len(block.antennas) < 3:
            continue
        body_m = shape[block.antennas] - shape[block.reference]
        rot = wahba_rotation(block.vector_ned_m, body_m, np.ones(block.vector_ned_m.shape[:2]))
        residual = block.vector_ned_m - np.einsum("nij,kj->nki", rot, body_m)
        left.append(np.sum(residual**2, axis=(1, 2)))
    return float(np.median(np.concatenate(left))) if left else 0.0


def is_at_rest(fit: ShapeFit, vectors: ArrayVectors):
    """Whether the attitudes of a fit are one attitude and noise.

    Parameters
    ----------
    fit : ShapeFit
        With a rotation of each epoch.
    vectors : ArrayVectors
        What it was made from.

    Returns
    -------
    bool
        Of antennas on one line, by their directions.
    """
    rows = np.flatnonzero(fit.is_used)
    state = _State(vectors, fit.positions_m, fit.free, fit.is_line)
    state.rot[:] = fit.rot_ned_from_body
    turn, information = np.zeros((len(rows), 3)), np.zeros((len(rows), 3, 3))
    if fit.is_line:
        spread = np.median(np.abs(fit.rot_ned_from_body[rows, :, 0] - np.median(
            fit.rot_ned_from_body[rows, :, 0], axis=0)), axis=0)  # fmt: skip
        at_most = 0.0
        for _, _, part in state.parts(fit.is_used):
            at_most = max(at_most, float(np.sqrt(np.median(np.einsum("nii->n", part.turn_cov)))))
        return bool(1.4826 * np.max(spread) < np.sqrt(AT_REST) * at_most)
    u, _, vt = np.linalg.svd(fit.rot_ned_from_body[rows].mean(0))
    u[:, 2] *= np.linalg.det(u) * np.linalg.det(vt)
    from ..rotations import log_so3

    place = np.full(vectors.n_epochs, -1)
    place[rows] = np.arange(len(rows))
    for epochs, _, part in state.parts(fit.is_used):
        turn[place[epochs]] = log_so3(np.swapaxes(np.broadcast_to(u @ vt, (len(epochs), 3, 3)), 1, 2)
                                      @ fit.rot_ned_from_body[epochs])  # fmt: skip
        information[place[epochs]] = part.turn_normal
    return bool(np.median(np.einsum("ni,nij,nj->n", turn, information, turn)) < 3.0 * AT_REST)


def fit_shape(vectors: ArrayVectors, start_m, *, is_static=False):
    """Adjust the coordinates of the antennas and the rotations of the epochs.

    Parameters
    ----------
    vectors : ArrayVectors
        Vectors of all epochs.
    start_m : ndarray, shape (m, 3)
        Approximate coordinates in any frame, right to decimetres.
    is_static : bool
        Whether one rotation serves all epochs.

    Returns
    -------
    ShapeFit

    Raises
    ------
    NoSolutionError
        If the epochs do not determine the shape.
    """
    start_m = start_m - start_m.mean(0)
    extent, axes = np.linalg.svd(start_m)[1:]
    is_line = bool(extent[1] < MIN_ACROSS_M) and not is_static
    is_line |= len(start_m) < 3
    m = len(start_m)
    if is_line:
        # The line is the x axis; what stands beside it is not seen.
        start_m = np.outer(start_m @ axes[0], [1.0, 0.0, 0.0])
        free = np.zeros((3 * m, m))
        free[3 * np.arange(m), np.arange(m)] = 1.0
    else:
        free = np.eye(3 * m)
    state = _State(vectors, start_m, free, is_line)
    state.start_rotations(is_static)
    is_used = state.is_present & state.coarse(is_static)
    for _ in range(MAX_PASSES):
        fit = _adjust(state, is_used, is_static)
        good = state.is_present & _consistent(fit.misfit, fit.degrees, is_used)
        if np.array_equal(good, is_used):
            break
        is_used = good
    if np.count_nonzero(fit.is_used) < 2:
        raise NoSolutionError("could not calibrate the array: no two epochs agree with one another")
    return fit


def _consistent(misfit, degrees, is_used):
    """Epochs whose residuals are as large as those of most."""
    good = np.zeros(len(misfit), bool)
    tested = is_used & (degrees > 0)
    if not tested.any():
        return np.isfinite(misfit)
    ratio = np.full(len(misfit), np.nan)
    ratio[degrees > 0] = misfit[degrees > 0] / degrees[degrees > 0]
    for value in np.unique(degrees[tested]):
        of_value = degrees == value
        middle = chi2_quantile(0.5, int(value)) / value
        scale = max(np.median(ratio[tested & of_value]) / middle, 1e-12)
        limit = chi2_quantile(1.0 - REJECT_RISK, int(value)) / value
        good |= of_value & (ratio <= scale * limit)
    return good | (np.isfinite(misfit) & (degrees == 0))


class _Part(NamedTuple):
    """Normal equations of some epochs with the same antennas."""

    body_m: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    weight: np.ndarray
    turn_design: np.ndarray
    turn_normal: np.ndarray
    turn_cov: np.ndarray


class _State:
    """Coordinates and rotations while they are adjusted."""

    def __init__(self, vectors, positions_m, free, is_line):
        self.vectors, self.positions_m, self.free, self.is_line = vectors, positions_m, free, is_line
        self.rot = np.full((vectors.n_epochs, 3, 3), np.nan)
        self.is_present = vectors.is_present.any(1) & (vectors.reference >= 0)

    def start_rotations(self, is_static):
        """Best rotations of the epochs to the coordinates; at rest the middle of them."""
        for block in self.vectors.blocks():
            body_m = self.positions_m[block.antennas] - self.positions_m[block.reference]
            variance = np.einsum("nkk->n", block.cov_ned_m2)
            weight = np.broadcast_to(1.0 / variance[:, None], block.vector_ned_m.shape[:2])
            self.rot[block.epochs] = wahba_rotation(block.vector_ned_m, body_m, weight)
        if is_static:
            self._one_rotation()

    def _one_rotation(self):
        """Rotation of a platform at rest, from medians of its vectors."""
        place = self.vectors.vector_ned_m.copy()
        rows = np.flatnonzero(self.is_present)
        place[rows, self.vectors.reference[rows]] = 0.0
        # Vectors from the antenna that is the reference most often.
        first = int(np.bincount(self.vectors.reference[rows]).argmax())
        middle = np.nanmedian((place - place[:, first : first + 1])[rows], axis=0)
        rot = wahba_rotation(
            middle[None], self.positions_m - self.positions_m[first], np.ones((1, len(middle)))
        )
        self.rot[:] = rot[0]

    def coarse(self, is_static):
        """Epochs whose vectors are near the start: wrong integers must not lead the first steps astray."""
        worst = np.full(self.vectors.n_epochs, np.inf)
        for block in self.vectors.blocks():
            body_m = self.positions_m[block.antennas] - self.positions_m[block.reference]
            fitted = np.einsum("nij,kj->nki", self.rot[block.epochs], body_m)
            off = np.linalg.norm(block.vector_ned_m - fitted, axis=2).max(1)
            worst[block.epochs] = off
        return worst <= max(6.0 * np.median(worst[self.is_present]), 0.03)

    def parts(self, is_used):
        """Yield epochs, antennas of vectors and the equations of blocks of epochs."""
        m = len(self.positions_m)
        for block in self.vectors.blocks(np.repeat(is_used[:, None], m, axis=1), max_epochs=10_000):
            k = len(block.antennas)
            rot = self.rot[block.epochs]
            body_m = self.positions_m[block.antennas] - self.positions_m[block.reference]
            cov = block.cov_ned_m2.reshape(-1, k, 3, k, 3)
            cov = np.einsum("naj,npaqb,nbl->npjql", rot, cov, rot, optimize=True).reshape(-1, 3 * k, 3 * k)
            weight = np.linalg.inv(0.5 * (cov + np.swapaxes(cov, 1, 2)))
            jacobian = np.zeros((k, 3, m, 3))
            jacobian[np.arange(k), :, block.antennas] = np.eye(3)
            jacobian[np.arange(k), :, block.reference] -= np.eye(3)
            jacobian = jacobian.reshape(3 * k, 3 * m)
            turn_design = -skew(body_m).reshape(3 * k, 3)
            turn_normal = turn_design.T @ weight @ turn_design
            turn_cov = np.linalg.pinv(turn_normal, rcond=1e-7, hermitian=True)
            measured = np.einsum("nji,nkj->nki", rot, block.vector_ned_m)
            yield (
                block.epochs,
                block.antennas,
                _Part(
                    body_m,
                    (measured - body_m).reshape(-1, 3 * k),
                    jacobian,
                    weight,
                    turn_design,
                    turn_normal,
                    turn_cov,
                ),
            )

    @staticmethod
    def stretch(part, scale):
        """By how much vectors appear longer because rotations follow their errors, shape (n, 3 k)."""
        trace = np.einsum("nii->n", part.turn_cov)
        longer = 0.5 * scale * (trace[:, None, None] * np.eye(3) - part.turn_cov)
        return np.einsum("nij,kj->nki", longer, part.body_m).reshape(len(trace), -1)


def _adjust(state, is_used, is_static):
    """Gauss-Newton over coordinates and rotations."""
    n, width = state.vectors.n_epochs, 3 * len(state.positions_m)
    scale = 1.0
    for step in range(MAX_STEPS):
        normal, rhs = np.zeros((width, width)), np.zeros(width)
        mixed, turn_normal, turn_rhs = np.zeros((width, 3)), np.zeros((3, 3)), np.zeros(3)
        stored = []
        total, freedom = 0.0, 0
        for epochs, _, part in state.parts(is_used):
            weighted_turn = part.weight @ part.turn_design
            residual = part.residual if is_static else part.residual - state.stretch(part, scale)
            own_rhs = np.einsum("nji,nj->ni", weighted_turn, residual)
            if is_static:
                sum_weight = part.weight.sum(0)
                normal += part.jacobian.T @ sum_weight @ part.jacobian
                rhs += part.jacobian.T @ np.einsum("nij,nj->i", part.weight, residual)
                mixed += part.jacobian.T @ weighted_turn.sum(0)
                turn_normal += part.turn_normal.sum(0)
                turn_rhs += own_rhs.sum(0)
                continue
            gain = part.turn_cov @ np.swapaxes(weighted_turn, 1, 2)
            projected = part.weight - weighted_turn @ gain
            normal += part.jacobian.T @ projected.sum(0) @ part.jacobian
            rhs += part.jacobian.T @ np.einsum("nij,nj->i", projected, residual)
            stored.append((epochs, gain, part))
            total += float(np.einsum("ni,nij,nj->", residual, projected, residual))
            freedom += len(epochs) * (residual.shape[1] - (2 if state.is_line else 3))
        if is_static:
            inverse = np.linalg.pinv(turn_normal, rcond=1e-10, hermitian=True)
            normal -= mixed @ inverse @ mixed.T
            rhs -= mixed @ inverse @ turn_rhs
        elif freedom > 0:
            scale = total / freedom
        moved = state.free @ _solve(state.free.T @ normal @ state.free, state.free.T @ rhs)
        for epochs, gain, part in stored:
            left = part.residual - state.stretch(part, scale) - part.jacobian @ moved
            state.rot[epochs] = state.rot[epochs] @ exp_so3(np.einsum("nij,nj->ni", gain, left))
        if is_static:
            turn = inverse @ (turn_rhs - mixed.T @ moved)
            state.rot[:] = state.rot @ exp_so3(turn)
        state.positions_m = state.positions_m + moved.reshape(-1, 3)
        state.positions_m = state.positions_m - state.positions_m.mean(0)
        if step and np.max(np.abs(moved)) < STEP_LIMIT_M:
            break
    # What every epoch says at the end, those included that took no part.
    score = np.zeros((n, width))
    misfit, degrees = np.full(n, np.nan), np.zeros(n, np.int64)
    for epochs, _, part in state.parts(state.is_present):
        weighted_turn = part.weight @ part.turn_design
        residual = part.residual if is_static else part.residual - state.stretch(part, scale)
        own_rhs = np.einsum("nji,nj->ni", weighted_turn, residual)
        if is_static:
            score[epochs] = np.einsum("nij,nj->ni", part.weight, residual) @ part.jacobian
            score[epochs] -= own_rhs @ (inverse @ mixed.T)
            misfit[epochs] = np.einsum("ni,nij,nj->n", residual, part.weight, residual)
            degrees[epochs] = residual.shape[1]
        else:
            projected = part.weight - weighted_turn @ part.turn_cov @ np.swapaxes(weighted_turn, 1, 2)
            score[epochs] = np.einsum("nij,nj->ni", projected, residual) @ part.jacobian
            misfit[epochs] = np.einsum("ni,nij,nj->n", residual, projected, residual)
            degrees[epochs] = residual.shape[1] - (2 if len(part.turn_design) == 3 or state.is_line else 3)
    score[~is_used] = 0.0
    return ShapeFit(
        state.positions_m,
        normal,
        state.free,
        score,
        misfit,
        degrees,
        is_used,
        state.rot.copy(),
        is_static,
        state.is_line,
    )


def _solve(normal, rhs):
    """Least change that solves normal equations with motions in their null space."""
    size, axes = np.linalg.eigh(0.5 * (normal + normal.T))
    keep = size > 1e-9 * size[-1]
    return axes[:, keep] @ ((axes[:, keep].T @ rhs) / size[keep])
