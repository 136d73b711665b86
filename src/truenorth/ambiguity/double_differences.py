"""One epoch of double differences from the single differences of all epochs.

Every group's rows are referred to its highest satellite,

    dd_j = sd_j - sd_ref,      cov = D diag(sd variances) D',

so that the noise of the reference appears in every pair of rows of a group. Rows of a group whose
satellite has no partner are left out.

References: Harvey 1998 (UCGE 20117), (3.10); Landfahrer 2009, (2.20).
"""

import numpy as np

from .model import DoubleDifferences

__all__ = ["double_differences"]


def _operator(group, usable):
    """Differencing matrix, and the rows and references of its lines; references come first."""
    lines, rows, references = [], [], []
    reference = -1
    for j in np.flatnonzero(usable):
        if reference < 0 or group[j] != group[reference]:
            reference = j
            continue
        line = np.zeros(len(group))
        line[j], line[reference] = 1.0, -1.0
        lines.append(line)
        rows.append(j)
        references.append(reference)
    matrix = np.array(lines).reshape(len(lines), len(group))
    return matrix, np.array(rows, dtype=np.int64), np.array(references, dtype=np.int64)


def double_differences(
    differences,
    epoch,
    *,
    length_m=None,
    length_sd_m=None,
    use_code=True,
    prior=None,
    variance_factors=(1.0, 1.0),
):
    """Double differences of one epoch, with the identity of every row.

    Parameters
    ----------
    differences : SingleDifferences
        All epochs.
    epoch : int
        Which one.
    length_m, length_sd_m : float, optional
        Known antenna separation and its standard deviation.
    use_code : bool
        Whether pseudoranges are handed on.
    prior : tuple of ndarray, optional
        A-priori baseline (east, north, up) and its covariance.
    variance_factors : tuple of float
        Factors on the variances of phases and codes.

    Returns
    -------
    problem : DoubleDifferences
        The epoch, rows by group and falling elevation.
    row : ndarray of int64, shape (m,)
        Row of each double difference's satellite in the single differences.
    reference : ndarray of int64, shape (m,)
        Row of its reference satellite.
    row_key, reference_key : ndarray of int64, shape (m,)
        Identities of satellite and signal that stay from epoch to epoch.
    """
    d = differences
    first, last = int(d.start[epoch]), int(d.start[epoch + 1])
    here = slice(first, last)
    phase, code, group = d.phase_m[here], d.code_m[here], d.group[here]
    operator, row, reference = _operator(group, np.isfinite(phase) & d.integer_ok[here])
    code_operator, _, _ = _operator(group, np.isfinite(code) & use_code)
    design = d.design_enu[here]
    problem = DoubleDifferences(
        phase_m=operator @ np.nan_to_num(phase),
        design=operator @ design,
        wavelength_m=d.wavelength_m[here][row],
        cov_phase_m2=variance_factors[0] * (operator * d.phase_variance_m2[here]) @ operator.T,
        code_m=code_operator @ np.nan_to_num(code),
        code_design=code_operator @ design,
        cov_code_m2=variance_factors[1] * (code_operator * d.code_variance_m2[here]) @ code_operator.T,
        elevation_rad=d.elevation_rad[here][row],
        group=group[row],
        length_m=np.nan if length_m is None else float(length_m),
        length_sd_m=np.nan if length_sd_m is None else float(length_sd_m),
        prior_baseline_enu_m=None if prior is None else prior[0],
        cov_prior_m2=None if prior is None else prior[1],
    )
    key = group * 1000 + d.sat[here]
    return problem, first + row, first + reference, key[row], key[reference]
