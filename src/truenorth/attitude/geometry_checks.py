r"""Checks of measured vectors against a rigid array: lengths, angles, handedness, and who is to blame.

A wrong integer turns and stretches a vector. Its length, the angle to each other vector and the volume
that it spans with two others are known from the body coordinates, whatever the attitude:

    |theta - theta_body| <= k sigma_theta,      theta = atan2(|u x v|, u . v)

For independent errors s of every coordinate of every antenna, of which u and v share one,

    sigma_theta = s sqrt(2 / |u|^2 + 2 / |v|^2 - 2 cos(theta) / (|u| |v|))

to first order; here the standard deviation comes from the joint covariance of the epoch, and that formula
or a fixed angle (5 degrees in the paper) are options. Near 180 and 0 degrees the angle folds: opposite
vectors are tested by v / |v| + u / |u|, which has two components across them, and whose limit is that of
chi-square with two degrees of freedom at the same false alarm.

All pairs with a wrong vector fail, and no pair passes with it: with three vectors or more that names it.
With two vectors an angle only shows that one of them is wrong. Lengths and angles are blind to the mirror
image of an array with height; the sign of a triple product is not.

References
----------
C. Wang, G. Lachapelle, "GPS attitude determination reliability performance improvement using low cost
receivers", Journal of Global Positioning Systems 1 (2002), eqs. 3-4; K. Landfahrer, "Attitude determination
using a GPS multi antenna array", Graz University of Technology (2009), eqs. 3.10-3.11.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Literal

import msgspec
import numpy as np

from ..errors import ConfigError
from .array_vectors import ArrayVectors
from .solution import EpochEvent

__all__ = [
    "GeometryCheckSettings",
    "GeometryChecks",
    "angle_between_rad",
    "angle_sd_first_order_rad",
    "angle_sd_rad",
    "check_geometry",
]

NEARLY_ONE_LINE = 0.1
"""Below this sine of the angle two vectors are tested as ones on a line: within four standard deviations of
a good array the angle would fold."""


class GeometryCheckSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tolerances of the checks after the search."""

    sigma_factor: float = 4.0
    """Lengths and angles may be off by this many standard deviations."""
    angle_tolerance_deg: float | None = None
    """One tolerance for all angles instead; 5 degrees in Wang & Lachapelle (2002), for vectors of 1-2 m."""
    antenna_sd_m: float | None = None
    """Take the standard deviations of angles from this error of every antenna coordinate, by the
    first-order formula for independent antennas, instead of the covariance."""
    lengths: bool = True
    """Check the lengths."""
    angles: bool = True
    """Check the angles."""
    handedness: bool = True
    """Check the signs of the triple products of arrays with height."""
    vote: Literal["strict", "common"] = "strict"
    """``strict``: the wrong vector is in all pairs that fail and in none that passes. ``common``: it may be
    in one that passes by chance, if it is the only one in all pairs that fail."""

    def __post_init__(self) -> None:
        for key in ("sigma_factor", "angle_tolerance_deg", "antenna_sd_m"):
            value = getattr(self, key)
            if value is not None and not 0.0 < value < math.inf:
                raise ConfigError(f"`{key}` is {value!r}; give a positive number", key=key, value=value)


@dataclass(frozen=True, slots=True, eq=False)
class GeometryChecks:
    """What the checks found; n epochs, m antennas, p pairs and t triples of antennas.

    A pair or triple is tested where its antennas have vectors; statistics are NaN elsewhere. Vectors run
    from the epoch's reference antenna, so that each antenna but this one stands for its vector.

    Parameters
    ----------
    pairs, triples : ndarray of int64, shape (p, 2) and (t, 3)
        Antennas.
    length_misfit_m, length_limit_m : ndarray, shape (n, m)
        Measured length less that of the body coordinates, and its limit.
    angle_rad : ndarray, shape (n, p)
        Measured angle of two vectors.
    angle_misfit_rad, angle_limit_rad : ndarray, shape (n, p)
        Its difference from that of the body coordinates, or the fold of vectors on a line; its limit.
    handedness : ndarray, shape (n, t)
        Measured triple product as a share of that of the body, -1 for a mirror image; NaN where it is not
        clear from the noise.
    is_length_bad, is_angle_bad, is_mirrored : ndarray of bool, shape (n, m), (n, p) and (n, t)
        Checks that failed.
    is_excluded : ndarray of bool, shape (n, m)
        Vectors to blame.
    is_detected : ndarray of bool, shape (n,)
        Epochs in which a check failed.
    is_identified : ndarray of bool, shape (n,)
        Those of them whose failed checks all have an excluded vector in them.
    is_present : ndarray of bool, shape (n, m)
        Vectors that were checked.
    events : tuple of EpochEvent
        When vectors were excluded and came back, and when a contradiction could not be assigned.
    """

    pairs: np.ndarray
    triples: np.ndarray
    length_misfit_m: np.ndarray
    length_limit_m: np.ndarray
    angle_rad: np.ndarray
    angle_misfit_rad: np.ndarray
    angle_limit_rad: np.ndarray
    handedness: np.ndarray
    is_length_bad: np.ndarray
    is_angle_bad: np.ndarray
    is_mirrored: np.ndarray
    is_excluded: np.ndarray
    is_detected: np.ndarray
    is_identified: np.ndarray
    is_present: np.ndarray
    events: tuple[EpochEvent, ...] = ()

    @property
    def is_trusted(self) -> np.ndarray:
        """Ndarray of bool, shape (n, m): vectors that an attitude may rest on.

        None where a contradiction could not be assigned.
        """
        return self.is_present & ~self.is_excluded & (~self.is_detected | self.is_identified)[:, None]


def angle_between_rad(u, v):
    """Angle between vectors, exact to rounding at any angle.

    Parameters
    ----------
    u, v : ndarray, shape (..., 3)

    Returns
    -------
    ndarray, shape (...)
        0 to pi.
    """
    u, v = np.asarray(u, dtype=float), np.asarray(v, dtype=float)
    cross = np.cross(u, v)
    return np.arctan2(np.sqrt(np.sum(cross * cross, axis=-1)), np.sum(u * v, axis=-1))


def angle_sd_first_order_rad(first_m, second_m, angle_rad, antenna_sd_m):
    """Standard deviation of the angle of two vectors with a common antenna (Wang & Lachapelle 2002).

    Parameters
    ----------
    first_m, second_m : float or ndarray
        Lengths of the vectors.
    angle_rad : float or ndarray
        Angle between them, not near 0 or 180 degrees, where it folds.
    antenna_sd_m : float
        Error of every coordinate of every antenna, independent.

    Returns
    -------
    float or ndarray
        Radians.
    """
    return antenna_sd_m * np.sqrt(
        2.0 / first_m**2 + 2.0 / second_m**2 - 2.0 * np.cos(angle_rad) / (first_m * second_m)
    )


def angle_sd_rad(u, v, cov_m2):
    """Standard deviation of the angle of two vectors from their joint covariance, to first order.

    Parameters
    ----------
    u, v : ndarray, shape (..., 3)
        Vectors, not on one line.
    cov_m2 : ndarray, shape (..., 6, 6)
        Joint covariance.

    Returns
    -------
    ndarray, shape (...)
        Radians.
    """
    u_m, v_m = np.linalg.norm(u, axis=-1)[..., None], np.linalg.norm(v, axis=-1)[..., None]
    along_u, along_v = u / u_m, v / v_m
    cosine = np.sum(along_u * along_v, axis=-1)[..., None]
    sine = np.maximum(np.sqrt(np.sum(np.cross(along_u, along_v) ** 2, axis=-1))[..., None], 1e-9)
    gradient = np.concatenate(
        [-(along_v - cosine * along_u) / (sine * u_m), -(along_u - cosine * along_v) / (sine * v_m)], axis=-1
    )
    return np.sqrt(np.einsum("...i,...ij,...j->...", gradient, cov_m2, gradient))


def check_geometry(
    vectors: ArrayVectors,
    settings: GeometryCheckSettings | None = None,
    *,
    is_used: np.ndarray | None = None,
) -> GeometryChecks:
    """Check the vectors of every epoch against the body coordinates, and name the wrong one.

    A vector of wrong length is to blame unless all are wrong. Of the others, the one that is in all pairs
    that fail and in none that passes is; likewise for the triples of which the sign is wrong.

    Parameters
    ----------
    vectors : ArrayVectors
        Vectors with their joint covariance.
    settings : GeometryCheckSettings, optional
        Tolerances; the defaults where omitted.
    is_used : ndarray of bool, shape (n, m), optional
        Vectors to be checked; all by default.

    Returns
    -------
    GeometryChecks
    """
    settings = settings or GeometryCheckSettings()
    n, m = vectors.n_epochs, len(vectors.positions_body_m)
    pairs = np.array(list(itertools.combinations(range(m), 2)), np.int64).reshape(-1, 2)
    triples = np.array(list(itertools.combinations(range(m), 3)), np.int64).reshape(-1, 3)
    place_of_pair = {tuple(pair): k for k, pair in enumerate(pairs.tolist())}
    place_of_triple = {tuple(triple): k for k, triple in enumerate(triples.tolist())}
    length, length_limit = np.full((n, m), np.nan), np.full((n, m), np.nan)
    angle, misfit, limit = (np.full((n, len(pairs)), np.nan) for _ in range(3))
    handedness = np.full((n, len(triples)), np.nan)
    present = np.zeros((n, m), bool)
    for block in vectors.blocks(is_used):
        rows, antennas = block.epochs, block.antennas
        present[np.ix_(rows, antennas)] = True
        geometry = _BlockGeometry(block)
        if settings.lengths:
            for k, antenna in enumerate(antennas):
                length[rows, antenna], sd_m = geometry.length(k)
                length_limit[rows, antenna] = settings.sigma_factor * sd_m
        if settings.angles:
            for i, j in itertools.combinations(range(len(antennas)), 2):
                at = place_of_pair[int(antennas[i]), int(antennas[j])]
                angle[rows, at], misfit[rows, at], limit[rows, at] = geometry.angle(i, j, settings)
        if settings.handedness:
            for i, j, k in itertools.combinations(range(len(antennas)), 3):
                at = place_of_triple[int(antennas[i]), int(antennas[j]), int(antennas[k])]
                handedness[rows, at] = geometry.handedness(i, j, k, settings.sigma_factor)
    length_bad = np.abs(length) > length_limit
    angle_bad = np.abs(misfit) > limit
    mirrored = handedness < 0.0
    # Where every length is wrong, it is rather the antenna that the vectors share.
    by_length = length_bad & (present & ~length_bad).any(1)[:, None]
    left = present & ~by_length
    is_strict = settings.vote == "strict"
    by_angle = _vote(pairs, angle_bad, np.isfinite(misfit), left, is_strict)
    left &= ~by_angle
    by_sign = _vote(triples, mirrored, np.isfinite(handedness), left, is_strict)
    excluded = by_length | by_angle | by_sign
    detected = length_bad.any(1) | angle_bad.any(1) | mirrored.any(1)
    unexplained = (length_bad & ~excluded).any(1)
    for groups, bad in ((pairs, angle_bad), (triples, mirrored)):
        if len(groups):
            unexplained |= (bad & ~excluded[:, groups].any(2)).any(1)
    found = GeometryChecks(
        pairs, triples, length, length_limit, angle, misfit, limit, handedness, length_bad, angle_bad,
        mirrored, excluded, detected, detected & ~unexplained, present,
    )  # fmt: skip
    return replace(found, events=tuple(_events(found, vectors)))


def _vote(groups, is_bad, is_tested, is_left, is_strict):
    """Member of all groups that fail, and of none that passes if the vote is strict; one or none."""
    n, m = is_left.shape
    blamed = np.zeros((n, m), bool)
    counts = is_tested & is_left[:, groups].all(2)
    bad, good = is_bad & counts, counts & ~is_bad
    n_bad = bad.sum(1)
    for antenna in range(m):
        inside = (groups == antenna).any(1)
        blamed[:, antenna] = (n_bad > 0) & (bad[:, inside].sum(1) == n_bad)
        if is_strict:
            blamed[:, antenna] &= ~good[:, inside].any(1)
    return blamed & (blamed.sum(1) == 1)[:, None]


class _BlockGeometry:
    """Lengths, angles and volumes of one block, with their standard deviations."""

    def __init__(self, block):
        self.vector_m, self.cov_m2 = block.vector_ned_m, block.cov_ned_m2
        self.body_m, self.body_cov_m2 = block.body_m, block.body_cov_m2
        self.size_m = np.linalg.norm(self.vector_m, axis=2)
        self.body_size_m = np.linalg.norm(self.body_m, axis=1)

    def length(self, k):
        """Misfit of a length and its standard deviation."""
        at = slice(3 * k, 3 * k + 3)
        along = self.vector_m[:, k] / self.size_m[:, k, None]
        variance = np.einsum("ni,nij,nj->n", along, self.cov_m2[:, at, at], along)
        along = self.body_m[k] / self.body_size_m[k]
        variance += along @ self.body_cov_m2[at, at] @ along
        return self.size_m[:, k] - self.body_size_m[k], np.sqrt(variance)

    def angle(self, i, j, settings):
        """Angle of two vectors, its misfit and limit."""
        at = np.r_[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
        u, v = self.vector_m[:, i], self.vector_m[:, j]
        cov, body_cov = self.cov_m2[:, at[:, None], at], self.body_cov_m2[np.ix_(at, at)]
        angle = angle_between_rad(u, v)
        expected = float(angle_between_rad(self.body_m[i], self.body_m[j]))
        is_line = math.sin(expected) < NEARLY_ONE_LINE
        misfit = angle - expected
        if is_line:
            side = 1.0 if expected > 0.5 * math.pi else -1.0
            fold = np.pi - angle if side > 0.0 else angle
            misfit = fold - (math.pi - expected if side > 0.0 else expected)
        false_alarm = math.erfc(settings.sigma_factor / math.sqrt(2.0))
        # Upper quantile of chi-square with two degrees of freedom; k^2 is that with one.
        square = -2.0 * math.log(false_alarm) if is_line else settings.sigma_factor**2
        if settings.angle_tolerance_deg is not None:
            limit = np.full(len(u), math.radians(settings.angle_tolerance_deg))
        elif settings.antenna_sd_m is not None:
            sd = angle_sd_first_order_rad(
                self.size_m[:, i], self.size_m[:, j], expected, settings.antenna_sd_m
            )
            limit = math.sqrt(square) * sd
        elif is_line:
            # The body's own part may lie in any direction across the line.
            body_part = _fold_covariance(self.body_m[None, i], self.body_m[None, j], body_cov[None], side)[0]
            variance = _fold_variance(u, v, cov, side) + np.linalg.eigvalsh(body_part[0])[-1]
            limit = np.sqrt(square * variance)
        else:
            body_sd = float(angle_sd_rad(self.body_m[i], self.body_m[j], body_cov))
            limit = math.sqrt(square) * np.hypot(angle_sd_rad(u, v, cov), body_sd)
        return angle, misfit, limit

    def handedness(self, i, j, k, sigma_factor):
        """Triple product as a share of that of the body; NaN where its sign is not sure."""
        own = [3 * s + c for s in (i, j, k) for c in range(3)]
        body_volume, body_gradient = _triple(*(self.body_m[None, s] for s in (i, j, k)))
        volume, gradient = _triple(*(self.vector_m[:, s] for s in (i, j, k)))
        cov = self.cov_m2[:, np.array(own)[:, None], own]
        variance = np.einsum("ni,nij,nj->n", gradient, cov, gradient)
        variance += (body_gradient @ self.body_cov_m2[np.ix_(own, own)] @ body_gradient.T)[0, 0]
        sure = abs(body_volume[0]) > sigma_factor * np.sqrt(variance)
        return np.where(sure, volume / np.where(sure, body_volume[0], 1.0), np.nan)


def _triple(u, v, w):
    """Triple products and their derivatives by the nine components."""
    gradient = np.concatenate([np.cross(v, w), np.cross(w, u), np.cross(u, v)], axis=1)
    return np.sum(u * gradient[:, :3], axis=1), gradient


def _fold_covariance(u, v, cov_m2, side):
    """Covariance of v / |v| + side u / |u|, shape (n, 3, 3), that sum, and the direction of the line."""
    u_m, v_m = np.linalg.norm(u, axis=1)[:, None], np.linalg.norm(v, axis=1)[:, None]
    along_u, along_v = u / u_m, v / v_m
    by_u = side * (np.eye(3) - along_u[:, :, None] * along_u[:, None, :]) / u_m[:, :, None]
    by_v = (np.eye(3) - along_v[:, :, None] * along_v[:, None, :]) / v_m[:, :, None]
    jacobian = np.concatenate([by_u, by_v], axis=2)
    line = along_v - side * along_u
    line = line / np.linalg.norm(line, axis=1)[:, None]
    return jacobian @ cov_m2 @ np.swapaxes(jacobian, 1, 2), along_v + side * along_u, line


def _fold_variance(u, v, cov_m2, side):
    """Square of the fold that one unit of chi-square allows in the direction in which the vectors fold."""
    cov, fold, line = _fold_covariance(u, v, cov_m2, side)
    size = np.linalg.norm(fold, axis=1)
    where = np.where(size[:, None] > 0.0, fold / np.where(size > 0.0, size, 1.0)[:, None], np.eye(3)[0])
    where -= np.sum(where * line, axis=1)[:, None] * line
    # Nothing varies along the line; filled up, the matrix can be inverted without a change across it.
    full = cov + np.trace(cov, axis1=1, axis2=2)[:, None, None] * line[:, :, None] * line[:, None, :]
    weight = np.einsum("ni,nij,nj->n", where, np.linalg.inv(full), where)
    return np.sum(where**2, axis=1) / weight


def _events(found, vectors):
    """Changes of what is excluded, and of what could not be assigned, in time order."""
    names = vectors.names or tuple(f"antenna {k}" for k in range(len(vectors.positions_body_m)))
    open_ = found.is_detected & ~found.is_identified
    flags = np.column_stack([found.is_excluded, open_])
    for row, column in zip(*np.nonzero(np.diff(flags, axis=0, prepend=False)), strict=True):
        is_on = flags[row, column]
        statistic, limit, what = _worst(found, row, None if column == len(names) else column, names)
        if column < len(names):
            kind = "excluded" if is_on else "returned"
            text = f"{names[column]} is left out: {what}" if is_on else f"{names[column]} fits again"
        else:
            kind = "contradiction"
            text = (
                f"the vectors contradict each other and none can be named: {what}"
                if is_on
                else "the vectors no longer contradict each other"
            )
        yield EpochEvent(int(vectors.time_ns[row]), kind, "", "", statistic, limit, text)


def _worst(found, row, antenna, names):
    """Failed check that exceeds its limit most, of one antenna or of all: statistic, limit and words."""
    worst, share = (math.nan, math.nan, ""), 1.0
    for k in np.flatnonzero(found.is_length_bad[row]):
        if antenna in (None, k):
            misfit, limit = found.length_misfit_m[row, k], found.length_limit_m[row, k]
            if abs(misfit) / limit > share:
                share = abs(misfit) / limit
                text = f"the vector to {names[k]} is {abs(misfit) * 1e3:.0f} mm too "
                text += f"{'long' if misfit > 0.0 else 'short'}, limit {limit * 1e3:.0f} mm"
                worst = float(misfit), float(limit), text
    for k in np.flatnonzero(found.is_angle_bad[row]):
        pair = found.pairs[k]
        if antenna is None or antenna in pair:
            misfit, limit = found.angle_misfit_rad[row, k], found.angle_limit_rad[row, k]
            if abs(misfit) / limit > share:
                share = abs(misfit) / limit
                text = f"the angle between {names[pair[0]]} and {names[pair[1]]} is off by "
                text += f"{math.degrees(abs(misfit)):.2f} degrees, limit {math.degrees(limit):.2f}"
                worst = float(misfit), float(limit), text
    for k in np.flatnonzero(found.is_mirrored[row]):
        triple = found.triples[k]
        if share == 1.0 and (antenna is None or antenna in triple):
            text = "the vectors to " + ", ".join(names[s] for s in triple)
            worst = float(found.handedness[row, k]), 0.0, f"{text} are the mirror image of the array"
    return worst
