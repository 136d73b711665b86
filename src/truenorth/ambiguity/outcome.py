"""What the classical searches share in their verdicts: residual limits, code baseline, refusals."""

from functools import lru_cache

import numpy as np

from ..errors import Status
from .acceptance import chi2_quantile
from .model import Resolution

__all__ = ["chi2_limits", "code_baseline", "unresolved"]


@lru_cache(maxsize=512)
def chi2_limits(dof, significance, tails="upper"):
    """Limits of the test of a residual quadratic form.

    Parameters
    ----------
    dof : int
        Degrees of freedom; with none the test passes everything.
    significance : float
        False-alarm rate.
    tails : {"upper", "both"}
        Where to reject.

    Returns
    -------
    low, high : float
    """
    if dof <= 0:
        return 0.0, np.inf
    if tails == "both":
        share = significance / 2.0
        return chi2_quantile(share, dof), chi2_quantile(share, dof, upper=True)
    return 0.0, chi2_quantile(significance, dof, upper=True)


def code_baseline(problem):
    """Weighted least-squares baseline of the pseudoranges.

    Parameters
    ----------
    problem : DoubleDifferences
        One epoch.

    Returns
    -------
    baseline_enu_m : ndarray, shape (3,)
        NaN where the pseudoranges do not suffice.
    cov_m2 : ndarray, shape (3, 3)
        Its covariance.
    """
    if len(problem.code_m) >= 3:
        weight = np.linalg.solve(problem.cov_code_m2, problem.code_design)
        normal = problem.code_design.T @ weight
        if np.linalg.cond(normal) < 1e10:
            cov = np.linalg.inv(normal)
            return cov @ (weight.T @ problem.code_m), cov
    return np.full(3, np.nan), np.full((3, 3), np.nan)


def unresolved(problem, reason, n_candidates=0):
    """Resolution of an epoch without a candidate.

    Parameters
    ----------
    problem : DoubleDifferences
        The epoch.
    reason : Reason
        Why.
    n_candidates : int
        Candidates that were looked at.

    Returns
    -------
    Resolution
        `Status.FLOAT` where the pseudoranges give a baseline, else `Status.NONE`.
    """
    code, _ = code_baseline(problem)
    return Resolution(
        status=Status.FLOAT if np.isfinite(code).all() else Status.NONE,
        reason=reason,
        integers_cyc=np.empty((0, problem.n_phases), dtype=np.int64),
        objective=np.empty(0),
        baseline_enu_m=np.empty((0, 3)),
        cov_baseline_m2=np.full((3, 3), np.nan),
        float_baseline_enu_m=code,
        is_fixed=np.ones(problem.n_phases, dtype=bool),
        ratio=np.nan,
        success_probability=np.nan,
        chi2=np.nan,
        chi2_limit=np.nan,
        n_candidates=n_candidates,
    )
