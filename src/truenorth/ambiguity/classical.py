"""The classical searches on a whole run: one epoch of double differences after the other.

``lsast`` (Hatch 1990; Harvey 1998; Wang & Lachapelle 2002), ``exhaustive`` and ``kalman`` (Oguz 2006)
get what the compiled engine gets and return the same table, so that a user can compare them epoch by
epoch.
"""

import numpy as np

from ..errors import Status
from .double_differences import double_differences
from .resolution import ResolvedEpochs, select_phase_rows

__all__ = ["resolve_classical"]


def resolve_classical(differences, settings, factors, *, memory=None, progress=None):
    """Resolve every epoch with one of the classical methods.

    Parameters
    ----------
    differences : SingleDifferences
        All epochs.
    settings : GnssSettings
        ``method`` is ``lsast``, ``exhaustive`` or ``kalman``.
    factors : tuple of float
        Factors on the phase and code variances.
    memory : dict, optional
        What is carried from block to block of a run, updated in place; empty at its start.
    progress : callable, optional
        Called with (epochs done, epochs in all).

    Returns
    -------
    ResolvedEpochs
    """
    from .._kernels import engine

    d = differences
    memory = {} if memory is None else memory
    step = memory.setdefault("step", _stepper(settings))
    known = settings.length_m is not None and settings.length_use != "off"
    n = d.n_epochs
    table = np.full((n, engine.N_COLUMNS), np.nan)
    status, reason = np.zeros(n, np.uint8), np.zeros(n, np.uint8)
    row, start = select_phase_rows(d)
    place = np.full(len(d.sat), -1, np.int64)
    place[row] = np.arange(len(row))
    residual, integer = np.full(len(row), np.nan), np.full(len(row), np.nan)
    events = []
    for epoch in range(n):
        problem, at, reference, row_key, reference_key = double_differences(
            d, epoch,
            length_m=settings.length_m if known else None,
            length_sd_m=settings.length_sd_m if known else None,
            use_code=settings.use_code, prior=_prior(settings), variance_factors=factors,
        )  # fmt: skip
        found = step(problem, row_key, reference_key)
        status[epoch], reason[epoch] = found.status, found.reason
        _fill(table[epoch], problem, found, settings, engine)
        if len(found.integers_cyc):
            at_fixed, integers = at[found.is_fixed], found.integers_cyc[0][found.is_fixed]
            used = place[np.concatenate((at_fixed, reference[found.is_fixed]))]
            integer[used] = np.concatenate((integers, np.zeros(len(at_fixed))))
            used = np.unique(used)
            residual[used] = _residuals(d, row[used], integer[used], table[epoch, : engine.BZ + 1])
        if progress is not None and epoch % 50 == 0:
            progress(epoch, n)
    was_fixed = memory.get("fixed", False)
    memory["fixed"] = bool(n and status[-1] == Status.FIXED)
    for epoch in np.flatnonzero(np.diff(status == Status.FIXED, prepend=was_fixed)):
        word = "accepted" if status[epoch] == Status.FIXED else "no longer accepted"
        text = f"integers {word} by the {settings.method} search"
        events.append(
            (int(d.time_ns[epoch]), "fixed", "", "", float(table[epoch, engine.RATIO]), np.nan, text)
        )
    return ResolvedEpochs(table, status, reason, row, start, residual, integer, factors, events)


def _stepper(settings):
    """Function (problem, row_key, reference_key) -> Resolution of the method asked for."""
    if settings.method == "lsast":
        from .lsast import LeastSquaresSearch, LsastOptions

        lone = settings.single_candidate
        if lone == "auto":
            lone = "refuse" if settings.single_epoch else "accept"
        search = LeastSquaresSearch(
            LsastOptions(
                length_tolerance_sd=settings.length_tolerance_sd,
                use_code=settings.use_code,
                residual_significance=settings.residual_significance,
                ratio_threshold=settings.ratio_threshold,
                single_candidate=lone,
                min_epochs=settings.min_epochs_to_fix,
            )
        )

        def step(problem, row_key, reference_key):
            if settings.single_epoch:
                search.reset()
            return search.update(problem, row_key, reference_key)

        return step
    if settings.method == "exhaustive":
        from .exhaustive import ExhaustiveOptions, resolve_exhaustive

        options = ExhaustiveOptions(
            residual_significance=settings.residual_significance, ratio_threshold=settings.ratio_threshold
        )
        return lambda problem, row_key, reference_key: resolve_exhaustive(problem, options)
    from .kalman import KalmanIntegerEstimator, KalmanOptions

    estimator = KalmanIntegerEstimator(KalmanOptions(use_code=settings.use_code))
    return estimator.update


def _prior(settings):
    """A-priori baseline and covariance from the declared direction, or None."""
    if settings.direction_azimuth_deg is None or settings.length_m is None:
        return None
    from .lsast import direction_prior

    return direction_prior(
        np.radians(settings.direction_azimuth_deg),
        np.radians(settings.direction_elevation_deg),
        settings.length_m,
        azimuth_sd_rad=np.radians(settings.direction_sd_deg[0]),
        elevation_sd_rad=np.radians(settings.direction_sd_deg[1]),
        length_sd_m=settings.length_sd_m,
    )


def _fill(row, problem, found, settings, engine):
    """One row of the engine's table from a `Resolution`."""
    row[engine.N_PHASES] = problem.n_phases
    row[engine.FLOAT_X : engine.FLOAT_X + 3] = found.float_baseline_enu_m
    if len(problem.code_m) >= 3:
        information = problem.code_design.T @ np.linalg.solve(problem.cov_code_m2, problem.code_design)
        if np.linalg.cond(information) < 1e12:
            row[engine.FLOAT_COV : engine.FLOAT_COV + 6] = _six(np.linalg.inv(information))
    row[engine.FOUND] = found.n_candidates
    row[engine.RATIO] = min(found.ratio, 999.9) if np.isfinite(found.ratio) else np.nan
    row[engine.PROBABILITY] = found.success_probability
    row[engine.CHI2], row[engine.CHI2_LIMIT] = found.chi2, found.chi2_limit
    if len(found.objective):
        row[engine.COST] = found.objective[0]
        row[engine.SECOND_COST] = found.objective[1] if len(found.objective) > 1 else np.inf
        row[engine.BX : engine.BZ + 1] = found.baseline_enu_m[0]
        row[engine.COV : engine.COV + 6] = _six(found.cov_baseline_m2)
        # The measured length comes from the phases alone.
        fixed = found.is_fixed
        y = problem.phase_m[fixed] - problem.wavelength_m[fixed] * found.integers_cyc[0][fixed]
        design = problem.design[fixed]
        weighted = np.linalg.solve(problem.cov_phase_m2[np.ix_(fixed, fixed)], design)
        information = weighted.T @ design
        if np.linalg.cond(information) < 1e12:
            cov = np.linalg.inv(information)
            free = cov @ (weighted.T @ y)
            length = np.linalg.norm(free)
            row[engine.LENGTH] = length
            row[engine.LENGTH_SD] = np.sqrt(free @ cov @ free) / length
    if problem.n_phases >= 3:
        _fill_dops(row, problem, engine)


def _fill_dops(row, problem, engine):
    """DOPs of the double differences for unit undifferenced noise (Wang & Lachapelle 2002)."""
    same = problem.group[:, None] == problem.group[None, :]
    cov = 2.0 * (same + np.eye(problem.n_phases))
    information = problem.design.T @ np.linalg.solve(cov, problem.design)
    if np.linalg.cond(information) > 1e12:
        return
    q = np.linalg.inv(information)
    row[engine.PDOP], row[engine.HDOP] = np.sqrt(np.trace(q)), np.sqrt(q[0, 0] + q[1, 1])
    row[engine.VDOP] = np.sqrt(q[2, 2])
    baseline = row[engine.BX : engine.BZ + 1]
    if not np.isfinite(baseline).all():
        baseline = row[engine.FLOAT_X : engine.FLOAT_X + 3]
    horizontal, size = np.hypot(baseline[0], baseline[1]), np.linalg.norm(baseline)
    if horizontal > 0.0:
        sa, ca = baseline[0] / horizontal, baseline[1] / horizontal
        se, ce = baseline[2] / size, horizontal / size
        for column, g in ((engine.AZ_DOP, np.array([ca, -sa, 0.0]) / ce),
                          (engine.EL_DOP, np.array([-se * sa, -se * ca, ce]))):  # fmt: skip
            row[column] = np.sqrt(g @ q @ g)


def _residuals(differences, rows, integers, baseline):
    """Single-difference residuals of rows with known integers, one clock for each group."""
    d = differences
    misfit = d.phase_m[rows] - d.wavelength_m[rows] * integers - d.design_enu[rows] @ baseline
    weight = 1.0 / d.phase_variance_m2[rows]
    _, group = np.unique(d.group[rows], return_inverse=True)
    return misfit - (np.bincount(group, weight * misfit) / np.bincount(group, weight))[group]


def _six(matrix):
    """Elements xx, yy, zz, xy, xz, yz of a symmetric matrix."""
    return matrix[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
