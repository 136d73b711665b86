"""Adjusting the baselines of an array: one rotation an epoch, and which baselines it may rest on.

Where the baselines contradict the body coordinates, each is left out in turn: the one without which the
others agree is to blame, provided that leaving out no other explains the data nearly as well.
"""

from __future__ import annotations

import numpy as np

from ..ambiguity.acceptance import chi2_limits
from ..errors import Reason
from ..rotations import heading_pitch_roll
from .vectors import angle_covariance, array_extent_m, fit_rotation, weighted_square

__all__ = ["ArrayAdjustment", "free_of_length"]

MIN_ACROSS_M = 0.02
"""Antennas nearer than this to one line leave the rotation about it to the noise of the phases."""

ALONG_X = 0.002
"""A line of antennas within this angle, radians, of the x axis gives heading and pitch whatever the roll."""

CLEARLY_WORSE = 13.8
"""The second best exclusion must be worse by this much in chi-square, a likelihood ratio of a thousand."""


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


class ArrayAdjustment:
    """Rotations of all epochs, filled block by block and, within a block, by which baselines are there."""

    def __init__(self, body_m, n_epochs, settings):
        m = len(body_m)
        self.body_m = body_m
        self.body_variance_m2 = settings.length_sd_m**2
        self.limits = chi2_limits(settings.residual_significance, 3 * m + 1)
        self.angle_rad = np.full((n_epochs, 3), np.nan)
        self.cov_rad2 = np.full((n_epochs, 3, 3), np.nan)
        self.rot = np.full((n_epochs, 3, 3), np.nan)
        self.chi2, self.chi2_limit = np.full(n_epochs, np.nan), np.full(n_epochs, np.nan)
        self.is_used, self.is_excluded = np.zeros((n_epochs, m), bool), np.zeros((n_epochs, m), bool)
        self.is_solved = np.zeros(n_epochs, bool)
        self.reason = np.zeros(n_epochs, np.uint8)

    def solve(self, rows, vector_m, cov_m2, accepted):
        """Solve some epochs from the baselines accepted in each."""
        pattern = accepted[rows] @ (1 << np.arange(accepted.shape[1]))
        for code in np.unique(pattern[pattern > 0]):
            used = np.flatnonzero(code >> np.arange(accepted.shape[1]) & 1)
            self._solve_pattern(rows[pattern == code], used, vector_m, cov_m2)

    def _solve_pattern(self, rows, used, vector_m, cov_m2):
        """Solve epochs that have the same baselines; where they contradict, without the one to blame."""
        fit, chi2, limit = self._fit(rows, used, vector_m, cov_m2)
        new = np.isnan(self.chi2[rows])
        self.chi2[rows[new]], self.chi2_limit[rows[new]] = chi2[new], limit
        self.reason[rows] = Reason.GEOMETRY_TEST
        good = chi2 <= limit
        self._store(rows, used, fit, good)
        bad = rows[~good]
        if len(bad) == 0 or len(used) < 3:
            return
        left_out = [self._fit(bad, np.delete(used, k), vector_m, cov_m2) for k in range(len(used))]
        chi2 = np.stack([chi2 for _, chi2, _ in left_out], axis=1)
        limit = np.array([limit for _, _, limit in left_out])
        order = np.argsort(chi2, axis=1)
        blamed, next_best = order[:, 0], order[:, 1]
        best, second = np.take_along_axis(chi2, order[:, :2], axis=1).T
        clear = (second > limit[next_best]) | (second - best > CLEARLY_WORSE)
        for k, wrong in enumerate(used):
            mine = clear & (blamed == k)
            if not mine.any():
                continue
            rest = np.delete(used, k)
            self.is_excluded[bad[mine], wrong] = True
            if len(rest) >= 3:
                # There may be another one.
                self._solve_pattern(bad[mine], rest, vector_m, cov_m2)
            else:
                self._store(bad, rest, left_out[k][0], mine & (best <= limit[k]))
        lost = bad[~self.is_solved[bad]]
        self.is_excluded[lost] = False

    def _fit(self, rows, used, vector_m, cov_m2):
        """Rotations from some baselines, the test of each and its limit."""
        vector_m, cov_m2, body_m = vector_m[np.ix_(rows, used)], cov_m2[np.ix_(rows, used)], self.body_m[used]
        _, across, axis = array_extent_m(body_m)
        is_line = across < MIN_ACROSS_M
        fit = fit_rotation(vector_m, cov_m2, body_m, free_axis_body=axis if is_line else None)
        chi2 = weighted_square(fit.residual_m, cov_m2 + self.body_variance_m2 * np.eye(3))
        limit = self.limits[3 * len(used) - (2 if is_line else 3)]
        return fit, chi2, limit

    def _store(self, rows, used, fit, good):
        """Keep the rotations of the good epochs."""
        _, across, axis = array_extent_m(self.body_m[used])
        is_line = across < MIN_ACROSS_M
        rows = rows[good]
        if is_line and np.hypot(axis[1], axis[2]) > ALONG_X:
            self.reason[rows] = Reason.DIRECTION_ONLY
            return
        self.is_used[np.ix_(rows, used)] = True
        rot = fit.rot_ned_from_body[good]
        angle_rad = np.stack(heading_pitch_roll(rot), axis=-1)
        cov = angle_covariance(angle_rad[:, 0], rot, fit.cov_ned_rad2[good])
        if is_line:
            angle_rad[:, 2], cov[:, 2, :], cov[:, :, 2], rot = np.nan, np.nan, np.nan, np.nan
        self.angle_rad[rows], self.cov_rad2[rows], self.rot[rows] = angle_rad, cov, rot
        self.is_solved[rows] = True
        self.reason[rows] = Reason.ROLL_UNOBSERVABLE if is_line else Reason.OK
