"""Adjusting the vectors of an array: one rotation an epoch, and which vectors it may rest on.

Where the vectors contradict the body coordinates, each antenna is left out in turn, the reference among
them: the one without which the others agree is to blame, provided that leaving out no other explains the
data nearly as well. With three antennas a contradiction is detected, and nobody can say whose it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..ambiguity.acceptance import chi2_limits
from ..errors import Reason
from .array_vectors import ArrayVectors, VectorBlock
from .geometry_checks import GeometryChecks, GeometryCheckSettings, check_geometry
from .solution import EpochEvent
from .vector_methods import CLEARLY_WORSE, AttitudeFit, solve_block
from .vectors import shared_reference_covariance

__all__ = ["AdjustedVectors", "ArrayAdjustment", "adjust_vectors", "free_of_length", "without_antenna"]


def free_of_length(solution, epochs=slice(None)):
    """Accepted baselines as the phases alone give them, without the length that adjusted them.

    The engine adds the length l as one observation with variance s^2 along the adjusted baseline b:
    I_free (b_free - b) = v b with v = (|b| - l) / (s^2 |b|), and the inverse covariance is
    I_free + v 1 + (1 / s^2 - v) u u^T, u = b / |b|. Both are solved for what was there before, because
    the body coordinates, of which the length is part, enter the attitude once.

    Parameters
    ----------
    solution : BaselineSolution
        A run of a method that adjusts with the length (``constrained``, ``filter``), or of another.
    epochs : slice or ndarray of int, optional
        Epochs that are wanted, n of them.

    Returns
    -------
    baseline_enu_m : ndarray, shape (n, 3)
    cov_enu_m2 : ndarray, shape (n, 3, 3)
        As they are where the length took no part.
    """
    settings = solution.settings
    length_m, sd_m = settings.get("length_m"), settings.get("length_sd_m", 0.0)
    baseline_m, cov_m2 = solution.baseline_enu_m[epochs].copy(), solution.cov_enu_m2[epochs].copy()
    adjusted = settings.get("length_use") == "constrain" and settings.get("method") in (
        "constrained",
        "filter",
    )
    if not adjusted or length_m is None or sd_m <= 0.0:
        return baseline_m, cov_m2
    rows = np.flatnonzero(solution.is_accepted[epochs])
    b = baseline_m[rows]
    size = np.linalg.norm(b, axis=1)
    bend = (size - length_m) / (sd_m**2 * size)
    unit = b / size[:, None]
    information = np.linalg.inv(cov_m2[rows])
    information -= bend[:, None, None] * np.eye(3)
    information -= (1.0 / sd_m**2 - bend)[:, None, None] * unit[:, :, None] * unit[:, None, :]
    cov = np.linalg.inv(0.5 * (information + np.swapaxes(information, 1, 2)))
    baseline_m[rows] = b + bend[:, None] * np.einsum("nij,nj->ni", cov, b)
    cov_m2[rows] = cov
    return baseline_m, cov_m2


@dataclass(frozen=True, slots=True, eq=False)
class AdjustedVectors:
    """Attitude from the vectors that agree, and those that do not; n epochs, m antennas.

    Parameters
    ----------
    fit : AttitudeFit
        Attitude from the vectors that took part. Where the reference antenna was to blame, residuals are
        those of vectors from the first antenna that was left.
    is_excluded : ndarray of bool, shape (n, m)
        Antennas that contradicted the others.
    chi2, chi2_limit : ndarray, shape (n,)
        Test of all vectors against the body coordinates, before any was left out, and its limit.
    events : tuple of EpochEvent
        When antennas were left out and came back, with the statistic that decided.
    checks : GeometryChecks or None
        What the lengths, angles and signs said, where they were asked.
    """

    fit: AttitudeFit
    is_excluded: np.ndarray
    chi2: np.ndarray
    chi2_limit: np.ndarray
    events: tuple[EpochEvent, ...] = ()
    checks: GeometryChecks | None = None


def adjust_vectors(
    vectors: ArrayVectors,
    *,
    is_used: np.ndarray | None = None,
    false_alarm: float = 1e-4,
    blame_reference: bool = True,
    checks: GeometryCheckSettings | None = None,
) -> AdjustedVectors:
    """Attitude by weighted least squares, without the antennas that contradict the others.

    Parameters
    ----------
    vectors : ArrayVectors
        Vectors with their joint covariance.
    is_used : ndarray of bool, shape (n, m), optional
        Vectors that take part; all by default.
    false_alarm : float
        Share of right epochs that fail the chi-square test.
    blame_reference : bool
        Whether the antenna from which all vectors run may be the wrong one.
    checks : GeometryCheckSettings, optional
        Check lengths, angles and signs first: vectors that these name are left out before the adjustment.
        An epoch in which they contradict without a name, and the adjustment names none either, has no
        attitude.

    Returns
    -------
    AdjustedVectors
    """
    adjustment = _Adjustment(vectors, false_alarm, blame_reference)
    checked = None
    if checks is not None:
        checked = check_geometry(vectors, checks, is_used=is_used)
        is_used = checked.is_present & ~checked.is_excluded
        adjustment.is_excluded |= checked.is_excluded
    for block in vectors.blocks(is_used):
        adjustment.solve(block)
    if checked is not None:
        adjustment.withdraw(checked.is_detected & ~checked.is_identified & ~adjustment.is_excluded.any(1))
    return adjustment.result(checked)


def without_antenna(block: VectorBlock, antenna: int) -> VectorBlock:
    """The same epochs without one antenna; without the reference, vectors run from the first one left.

    Parameters
    ----------
    block : VectorBlock
        Of two or more vectors.
    antenna : int
        Number of the antenna in the array.

    Returns
    -------
    VectorBlock
    """
    k = len(block.antennas)
    if antenna == block.reference:
        reference, antennas = int(block.antennas[0]), block.antennas[1:]
        chosen = np.eye(k)[1:] - np.eye(k)[0]
    else:
        keep = np.flatnonzero(block.antennas != antenna)
        reference, antennas, chosen = block.reference, block.antennas[keep], np.eye(k)[keep]
    whole = np.kron(chosen, np.eye(3))
    return VectorBlock(
        block.epochs,
        antennas,
        reference,
        np.einsum("pk,nki->npi", chosen, block.vector_ned_m),
        whole @ block.cov_ned_m2 @ whole.T,
        chosen @ block.body_m,
        whole @ block.body_cov_m2 @ whole.T,
    )


class _Adjustment:
    """Attitude of all epochs, filled block by block."""

    def __init__(self, vectors, false_alarm, blame_reference):
        n, m = vectors.n_epochs, len(vectors.positions_body_m)
        self.vectors, self.blame_reference = vectors, blame_reference
        self.limits = chi2_limits(false_alarm, 3 * m + 1)
        self.angle_rad, self.cov_rad2 = np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
        self.rot, self.cov_ned_rad2 = np.full((n, 3, 3), np.nan), np.full((n, 3, 3), np.nan)
        self.chi2, self.dof = np.full(n, np.nan), np.zeros(n, np.int64)
        self.first_chi2, self.first_limit = np.full(n, np.nan), np.full(n, np.nan)
        self.residual_m = np.full((n, m, 3), np.nan)
        self.is_used, self.is_excluded = np.zeros((n, m), bool), np.zeros((n, m), bool)
        self.reason = np.full(n, Reason.NO_VECTORS, np.uint8)

    def solve(self, block):
        """Solve the epochs of a block; where its vectors contradict, without the antenna to blame."""
        found, limit = self._fit(block)
        new = np.isnan(self.first_chi2[block.epochs])
        rows = block.epochs[new]
        self.first_chi2[rows], self.first_limit[rows] = found.chi2[new], limit
        is_bad = found.chi2 > limit
        self._store(block, found, ~is_bad)
        self.reason[block.epochs[is_bad]] = Reason.GEOMETRY_TEST
        if is_bad.any() and len(block.antennas) >= 3:
            self._blame(block, np.flatnonzero(is_bad))

    def _blame(self, block, rows):
        """Leave out each antenna in turn where the vectors contradict."""
        bad = _rows(block, rows)
        suspects = [int(antenna) for antenna in block.antennas]
        if self.blame_reference:
            suspects.append(block.reference)
        rests = [without_antenna(bad, antenna) for antenna in suspects]
        fits = [self._fit(rest) for rest in rests]
        chi2 = np.stack([np.nan_to_num(found.chi2, nan=np.inf) for found, _ in fits], axis=1)
        limit = np.array([limit for _, limit in fits])
        order = np.argsort(chi2, axis=1)
        blamed, next_best = order[:, 0], order[:, 1]
        best, second = np.take_along_axis(chi2, order[:, :2], axis=1).T
        clear = np.isfinite(best) & ((second > limit[next_best]) | (second - best > CLEARLY_WORSE))
        for k, (antenna, rest) in enumerate(zip(suspects, rests, strict=True)):
            mine = clear & (blamed == k)
            if not mine.any():
                continue
            self.is_excluded[bad.epochs[mine], antenna] = True
            if len(rest.antennas) >= 3:
                # There may be another one.
                self.solve(_rows(rest, mine))
            else:
                self._store(rest, fits[k][0], mine & (best <= limit[k]))
        # Nobody was to blame after all; what others had named before stays named.
        lost = bad.epochs[self.reason[bad.epochs] == Reason.GEOMETRY_TEST]
        self.is_excluded[np.ix_(lost, suspects)] = False

    def _fit(self, block):
        found = solve_block(block)
        return found, self.limits[found.dof]

    def _store(self, block, found, good):
        """Keep the attitude of the good epochs."""
        rows = block.epochs[good]
        self.angle_rad[rows], self.cov_rad2[rows] = found.angle_rad[good], found.cov_rad2[good]
        self.rot[rows], self.cov_ned_rad2[rows] = found.rot_ned_from_body[good], found.cov_ned_rad2[good]
        self.chi2[rows], self.dof[rows], self.reason[rows] = found.chi2[good], found.dof, found.reason[good]
        self.residual_m[np.ix_(rows, block.antennas)] = found.residual_m[good]
        # A vector that gives no angle was not used for one.
        self.is_used[np.ix_(rows, block.antennas)] = found.is_solved[good, None]

    def withdraw(self, is_open):
        """Take back the attitude of some epochs."""
        is_open = is_open & np.isfinite(self.angle_rad[:, 0])
        for values in (self.angle_rad, self.cov_rad2, self.rot, self.cov_ned_rad2):
            values[is_open] = np.nan
        self.is_used[is_open] = False
        self.reason[is_open] = Reason.GEOMETRY_TEST

    def result(self, checks):
        """All epochs together."""
        fit = AttitudeFit(
            self.vectors.time_ns, "adjustment", self.rot, *self.angle_rad.T, self.cov_rad2,
            self.cov_ned_rad2, self.chi2, self.dof, self.residual_m, self.is_used,
            np.isfinite(self.angle_rad[:, 0]), self.reason,
        )  # fmt: skip
        named = self.is_excluded if checks is None else self.is_excluded & ~checks.is_excluded
        events = [*exclusion_events(self.vectors, named, self.first_chi2, self.first_limit)]
        events += [] if checks is None else checks.events
        events.sort(key=lambda event: event.time_ns)
        return AdjustedVectors(
            fit, self.is_excluded, self.first_chi2, self.first_limit, tuple(events), checks
        )


def exclusion_events(vectors, is_excluded, statistic, limit):
    """Yield when antennas were left out and came back, in time order.

    Parameters
    ----------
    vectors : ArrayVectors
    is_excluded : ndarray of bool, shape (n, m)
    statistic, limit : ndarray, shape (n,)
        Chi-square of all vectors and its limit.

    Yields
    ------
    EpochEvent
    """
    changes = np.diff(is_excluded, axis=0, prepend=False)
    for row, antenna in zip(*np.nonzero(changes), strict=True):
        name = vectors.names[antenna] if vectors.names else f"antenna {antenna}"
        if is_excluded[row, antenna]:
            kind = "excluded"
            text = (
                f"{name} contradicts the other antennas and is left out: chi-square {statistic[row]:.1f} "
                f"with it, limit {limit[row]:.1f}"
            )
        else:
            kind, text = "returned", f"{name} is no longer left out"
        yield EpochEvent(
            int(vectors.time_ns[row]), kind, "", "", float(statistic[row]), float(limit[row]), text
        )


class ArrayAdjustment:
    """Rotations from baselines that were solved one by one, filled block by block.

    Parameters
    ----------
    body_m : ndarray, shape (m, 3)
        Body coordinates of the rovers from the reference antenna.
    n_epochs : int
        Epochs of the run.
    settings : GnssSettings
        ``residual_significance``, and ``length_sd_m``: how well each distance is known.
    checks : GeometryCheckSettings, optional
        Check lengths, angles and signs before the adjustment.
    """

    def __init__(self, body_m, n_epochs, settings, checks=None):
        m = len(body_m)
        self.positions_body_m = np.vstack([np.zeros(3), body_m])
        # A distance is that of two antennas.
        self.body_cov_m2 = 0.5 * settings.length_sd_m**2 * np.eye(3 * m + 3)
        self.false_alarm, self.checks = settings.residual_significance, checks
        self.angle_rad = np.full((n_epochs, 3), np.nan)
        self.cov_rad2 = np.full((n_epochs, 3, 3), np.nan)
        self.rot = np.full((n_epochs, 3, 3), np.nan)
        self.chi2, self.chi2_limit = np.full(n_epochs, np.nan), np.full(n_epochs, np.nan)
        self.is_used, self.is_excluded = np.zeros((n_epochs, m), bool), np.zeros((n_epochs, m), bool)
        self.is_solved = np.zeros(n_epochs, bool)
        self.reason = np.zeros(n_epochs, np.uint8)

    def solve(self, rows, vector_m, cov_m2, accepted):
        """Solve some epochs from the baselines accepted in each.

        Parameters
        ----------
        rows : ndarray of int, shape (e,)
            The epochs.
        vector_m, cov_m2 : ndarray, shape (n, m, 3) and (n, m, 3, 3)
            Baselines in north, east, down.
        accepted : ndarray of bool, shape (n, m)
            Baselines that may take part.
        """
        rows = rows[accepted[rows].any(1)]
        m = accepted.shape[1]
        vector = np.full((len(rows), m + 1, 3), np.nan)
        vector[:, 1:] = np.where(accepted[rows, :, None], vector_m[rows], np.nan)
        some = np.where(accepted[rows][:, :, None, None], cov_m2[rows], np.eye(3))
        cov = np.full((len(rows), 3 * m + 3, 3 * m + 3), np.nan)
        cov[:, 3:, 3:] = shared_reference_covariance(some)
        vectors = ArrayVectors(
            np.zeros(len(rows), np.int64), np.zeros(len(rows), np.int64), vector, cov,
            self.positions_body_m, self.body_cov_m2,
        )  # fmt: skip
        # A baseline stands for its rover here: there is nothing left without the reference.
        found = adjust_vectors(
            vectors, false_alarm=self.false_alarm, blame_reference=False, checks=self.checks
        )
        fit = found.fit
        self.angle_rad[rows], self.cov_rad2[rows] = fit.angles_rad, fit.cov_rad2
        self.rot[rows], self.reason[rows] = fit.rot_ned_from_body, fit.reason
        self.chi2[rows], self.chi2_limit[rows] = found.chi2, found.chi2_limit
        self.is_used[rows], self.is_excluded[rows] = fit.is_used[:, 1:], found.is_excluded[:, 1:]
        self.is_solved[rows] = fit.is_solved


def _rows(block, rows):
    """Some epochs of a block."""
    return VectorBlock(
        block.epochs[rows], block.antennas, block.reference, block.vector_ned_m[rows],
        block.cov_ned_m2[rows], block.body_m, block.body_cov_m2,
    )  # fmt: skip
