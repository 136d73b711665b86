r"""How often the integers of a single epoch will be right, told before any data.

Of one baseline, codes alone place the antenna: with the information G_c of the codes, the double
differences of the phases have the float ambiguities

    Q_a = L^-1 (D 2 S D^T + D E (2 G_c^-1) E^T D^T) L^-1,     L = diag(wavelengths),

D the differences to one satellite of the group, S the variances of the phases. Bootstrapping after
decorrelation gives the success rate, which is a lower bound of that of integer least squares; knowing the
length, or the geometry of an array, only raises it.

References
----------
P. J. G. Teunissen, "Success probability of integer GPS ambiguity rounding and bootstrapping", Journal of
Geodesy 72 (1998).
"""

from __future__ import annotations

import numpy as np

from ..errors import ModelError
from .precision import WEAK_GEOMETRY, vector_information
from .view import SkyView

__all__ = ["baseline_ambiguity_cov", "baseline_success"]


def baseline_ambiguity_cov(view: SkyView, epoch: int, code_information: np.ndarray) -> np.ndarray:
    """Covariance of the float ambiguities of one baseline in a single epoch.

    Parameters
    ----------
    view : SkyView
        Signals in view.
    epoch : int
        Which epoch.
    code_information : ndarray, shape (3, 3)
        Of the codes, from `vector_information`.

    Returns
    -------
    ndarray, shape (k, k)
        Cycles squared; empty where there are no double differences.
    """
    rows = view.rows(epoch)
    use = np.flatnonzero(view.has_integers[rows]) + rows.start
    first: dict[int, int] = {}
    groups = view.group[use].tolist()
    pivot = np.array([first.setdefault(number, k) for k, number in enumerate(groups)], dtype=np.int64)
    others = np.flatnonzero(pivot != np.arange(len(use)))
    d = np.zeros((len(others), len(use)))
    d[np.arange(len(others)), others] = 1.0
    d[np.arange(len(others)), pivot[others]] = -1.0
    design = d @ view.line_of_sight_ned[use]
    cov_m2 = (d * (2.0 * view.phase_variance_m2[use])) @ d.T
    cov_m2 += design @ (2.0 * np.linalg.inv(code_information)) @ design.T
    scale = 1.0 / view.wavelength_m[use][others]
    return scale[:, None] * cov_m2 * scale


def baseline_success(view: SkyView) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Success rate and ADOP of the integers of one baseline, epoch by epoch.

    Parameters
    ----------
    view : SkyView
        Signals in view, n epochs.

    Returns
    -------
    success : ndarray, shape (n,)
        Lower bound for integer least squares, without a known length; 0 where there is nothing to resolve.
    adop_cyc : ndarray, shape (n,)
        NaN there.
    n_integers : ndarray of int, shape (n,)
    """
    from ..ambiguity.success_rate import success_rates

    information = vector_information(view, 1.0 / view.code_variance_m2)
    n = view.n_epochs
    success, adop_cyc, n_integers = np.zeros(n), np.full(n, np.nan), np.zeros(n, dtype=np.int64)
    for k in range(n):
        with np.errstate(all="ignore"):
            if not np.linalg.cond(information[k]) < WEAK_GEOMETRY:
                continue
        cov_cyc2 = baseline_ambiguity_cov(view, k, information[k])
        n_integers[k] = len(cov_cyc2)
        if len(cov_cyc2) < 3:
            continue
        try:
            rates = success_rates(cov_cyc2)
        except ModelError:
            continue
        success[k], adop_cyc[k] = rates.bootstrapped, rates.adop_cyc
    return success, adop_cyc, n_integers
