"""From single differences to resolved epochs: one entry for all integer methods.

`resolve_epochs` prepares the arrays, runs the compiled engine (``constrained``, ``lambda``,
``filter``) or the classical searches epoch by epoch (``lsast``, ``exhaustive``, ``kalman``), and
returns the same table for all of them.
"""

from dataclasses import dataclass, field

import numpy as np

from ..errors import Reason, Status

__all__ = ["ResolvedEpochs", "resolve_epochs"]

SEARCH_MARGIN = 20.0
"""Candidates within this of the best objective count for the posterior probability; one further
away weighs less than exp(-10)."""

SEARCH_CAP_FACTOR = 1.5
"""The search looks no further than this multiple of the residual test's limit, plus the margin."""

MAX_NODES = 5_000_000
"""Nodes of one epoch's search tree before it gives up (about a tenth of a second)."""

PSEUDO_WEIGHT = 10.0
"""Weight kappa = mu l^2 of the pseudo-observation that bounds the search. Small values widen the
ball |b|^2 <= l^2 (1 + C / kappa), large ones loosen the bound by kappa; 5 to 20 cost the same."""


@dataclass(frozen=True, slots=True, eq=False)
class ResolvedEpochs:
    """What the integer methods found, one row per epoch.

    Parameters
    ----------
    table : ndarray, shape (n_epochs, n_columns)
        Numbers of each epoch, columns of `truenorth._kernels.baseline`.
    status, reason : ndarray of uint8, shape (n_epochs,)
        Codes of `Status` and `Reason`.
    row : ndarray of int64, shape (m,)
        Single-difference rows whose phases took part.
    start : ndarray of int64, shape (n_epochs + 1,)
        Their epoch offsets.
    residual_m, integer_cyc : ndarray, shape (m,)
        Single-difference residual of the winner, and its integer against the group's first row.
    variance_factor : float
        Applied to the variances of the settings.
    events : list
        Decisions of the method.
    """

    table: np.ndarray
    status: np.ndarray
    reason: np.ndarray
    row: np.ndarray
    start: np.ndarray
    residual_m: np.ndarray
    integer_cyc: np.ndarray
    variance_factor: float = 1.0
    events: list = field(default_factory=list)


def _select_rows(differences, keep):
    """Rows to keep and their epoch offsets."""
    cumulative = np.concatenate(([0], np.cumsum(keep)))
    return np.flatnonzero(keep).astype(np.int64), cumulative[differences.start].astype(np.int64)


def chi2_limits(significance, n=200):
    """Upper chi-square limits by degrees of freedom 0 to n - 1, for the kernels."""
    from ..positioning.single_point import _chi2_limits

    return np.ascontiguousarray(_chi2_limits(n, significance))


def _prior(settings):
    """Information and right side of the a-priori direction, in east, north, up."""
    information, rhs = np.zeros((3, 3)), np.zeros(3)
    if settings.direction_azimuth_deg is None or settings.length_m is None:
        return information, rhs
    azimuth, elevation = np.radians([settings.direction_azimuth_deg, settings.direction_elevation_deg])
    sd_azimuth, sd_elevation = np.radians(settings.direction_sd_deg)
    se, ce = np.sin(elevation), np.cos(elevation)
    sa, ca = np.sin(azimuth), np.cos(azimuth)
    along = np.array([sa * ce, ca * ce, se])
    across = np.array([ca, -sa, 0.0])
    upward = np.array([-se * sa, -se * ca, ce])
    length = settings.length_m
    # The shell already knows the length; the prior speaks of the direction and, loosely, of the cap's depth.
    depth = length * max(sd_azimuth, sd_elevation) ** 2 + 3.0 * settings.length_sd_m
    for vector, sd in (
        (across, length * max(ce, 0.05) * sd_azimuth),
        (upward, length * sd_elevation),
        (along, depth),
    ):
        information += np.outer(vector, vector) / sd**2
    return information, information @ (length * along)


def resolve_epochs(differences, settings, *, progress=None):
    """Resolve the integers of every epoch.

    Parameters
    ----------
    differences : SingleDifferences
        All epochs.
    settings : GnssSettings
        Method, length, tests.
    progress : callable, optional
        Called with (epochs done, epochs in all) from time to time.

    Returns
    -------
    ResolvedEpochs
    """
    if settings.method in ("constrained", "lambda") and settings.single_epoch:
        factor = 1.0
        if settings.stochastic.estimate:
            factor = _estimate_variance_factor(differences, settings)
        return _resolve_alone(differences, settings, factor, progress)
    raise NotImplementedError(settings.method)


def _resolve_alone(differences, settings, factor, progress, epochs=None):
    """Every epoch by itself, in the compiled engine."""
    from .._kernels import baseline as kernel

    d = differences
    keep_phase = np.isfinite(d.phase_m) & d.integer_ok
    keep_code = np.isfinite(d.code_m)
    if not settings.use_code:
        keep_code[:] = False
    if epochs is not None:
        chosen = np.zeros(d.n_epochs, bool)
        chosen[epochs] = True
        chosen = chosen[d.epoch_of_row]
        keep_phase &= chosen
        keep_code &= chosen
    row, start = _select_rows(d, keep_phase)
    code_row, code_start = _select_rows(d, keep_code)
    n = d.n_epochs
    table = np.empty((n, kernel.N_COLUMNS))
    status = np.zeros(n, np.uint8)
    reason = np.zeros(n, np.uint8)
    residual = np.empty(len(row))
    integer = np.empty(len(row))
    known = settings.length_m is not None and settings.length_use != "off"
    in_search = known and settings.length_use == "constrain" and settings.method == "constrained"
    prior_information, prior_rhs = _prior(settings)
    modes = {"none": 0, "fixed": 1, "difference": 2, "fixed_failure_rate": 1}
    kernel.solve_single_epochs(
        start, d.phase_m[row], d.design_enu[row], d.wavelength_m[row],
        factor * d.phase_variance_m2[row], d.group[row],
        code_start, d.code_m[code_row], d.design_enu[code_row], d.code_variance_m2[code_row], d.group[code_row],
        prior_information, prior_rhs,
        float(settings.length_m) if known else np.nan,
        float(settings.length_sd_m) ** 2,
        in_search,
        known and settings.length_use in ("constrain", "check"),
        float(settings.length_tolerance_sd), PSEUDO_WEIGHT, SEARCH_CAP_FACTOR, SEARCH_MARGIN, MAX_NODES,
        chi2_limits(settings.residual_significance),
        float(settings.success_probability), modes[settings.ratio_test], float(settings.ratio_threshold),
        residual, integer, table, status, reason,
    )  # fmt: skip
    reason[~d.has_position] = Reason.NO_POSITION
    status[~d.has_position] = Status.NONE
    return ResolvedEpochs(table, status, reason, row, start, residual, integer, factor)


def _estimate_variance_factor(differences, settings):
    """Robust variance factor of the phases from the winners of a sample of epochs.

    The median of the winners' chi-square over its expectation: wrong winners of the worst epochs do not
    move it.
    """
    from .._kernels import baseline as kernel

    sample = np.unique(np.linspace(0, differences.n_epochs - 1, min(differences.n_epochs, 120)).astype(int))
    resolved = _resolve_alone(differences, settings, 1.0, None, epochs=sample)
    chi2 = resolved.table[sample, kernel.CHI2]
    dof = resolved.table[sample, kernel.CHI2_DOF]
    good = np.isfinite(chi2) & (dof > 0)
    if not good.any():
        return 1.0
    # Median of chi-square by Wilson and Hilferty.
    expected = dof[good] * (1.0 - 2.0 / (9.0 * dof[good])) ** 3
    return float(np.median(chi2[good] / expected))
