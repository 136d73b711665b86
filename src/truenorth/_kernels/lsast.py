"""Enumeration of the least-squares ambiguity search: primary triples, secondary rounding, residuals.

The lattice of primary integers is walked from the last coordinate to the first inside an ellipsoid
(a sphere around the base antenna, or the region of an a-priori baseline), so that only points inside
it are visited. Every point is then completed by the secondary rows one after the other: predict from
the baseline so far, round, update. With the rows whitened by the Cholesky factor of their covariance
the update is a recursion of three numbers a row, and the sum of the squared, normalised innovations
is the residual quadratic form of the full least-squares adjustment.

References: Hatch 1990; Harvey 1998 (UCGE 20117), sec. 4.1-4.3; Fincke & Pohst 1985 (the walk).
"""

import numpy as np

from .jit import kernel


@kernel
def rounding_order(design, variance_m2, wavelength_m, cov_primary):
    """Order of the secondary rows: always the one that the baseline so far predicts best, in cycles.

    Parameters
    ----------
    design, variance_m2, wavelength_m : ndarray, shape (m, 3), (m,), (m,)
        Rows, the three primaries first.
    cov_primary : ndarray, shape (3, 3)
        Covariance of the baseline of the primaries.

    Returns
    -------
    ndarray of int64, shape (m,)
        Row indices; 0, 1, 2 first. Correlation between rows is left out: it only orders.
    """
    m = design.shape[0]
    order = np.empty(m, dtype=np.int64)
    for i in range(m):
        order[i] = i
    cov = cov_primary.copy()
    pa = np.empty(3)
    for k in range(3, m):
        best = k
        best_s = np.inf
        for j in range(k, m):
            i = order[j]
            s = variance_m2[i]
            for r in range(3):
                for c in range(3):
                    s += design[i, r] * cov[r, c] * design[i, c]
            s /= wavelength_m[i] ** 2
            if s < best_s:
                best_s = s
                best = j
        chosen = order[best]
        order[best] = order[k]
        order[k] = chosen
        s = variance_m2[chosen]
        for r in range(3):
            pa[r] = 0.0
            for c in range(3):
                pa[r] += cov[r, c] * design[chosen, c]
            s += design[chosen, r] * pa[r]
        for r in range(3):
            for c in range(3):
                cov[r, c] -= pa[r] * pa[c] / s
    return order


@kernel
def recursion_gains(whitened_design, cov_primary):
    """Gains and innovation variances of the whitened rows after the first three.

    Parameters
    ----------
    whitened_design : ndarray, shape (m, 3)
        Design, premultiplied by the inverse Cholesky factor; rows in processing order.
    cov_primary : ndarray, shape (3, 3)
        Covariance of that baseline.

    Returns
    -------
    gain : ndarray, shape (m, 3)
        Baseline correction per unit of whitened innovation; zero for the first three rows.
    variance : ndarray, shape (m,)
        Variance of the whitened innovation; 1 for the first three rows.
    cov : ndarray, shape (3, 3)
        Covariance of the baseline after all rows.
    """
    m = whitened_design.shape[0]
    gain = np.zeros((m, 3))
    variance = np.ones(m)
    cov = cov_primary.copy()
    pa = np.empty(3)
    for i in range(3, m):
        s = 1.0
        for r in range(3):
            pa[r] = 0.0
            for c in range(3):
                pa[r] += cov[r, c] * whitened_design[i, c]
            s += whitened_design[i, r] * pa[r]
        variance[i] = s
        for r in range(3):
            gain[i, r] = pa[r] / s
            for c in range(3):
                cov[r, c] -= pa[r] * pa[c] / s
    return gain, variance, cov


@kernel
def search_primaries(
    phase_m,
    design,
    wavelength_m,
    lower,
    whitened_design,
    gain,
    variance,
    primary_map,
    factor,
    centre_integers,
    hole,
    region_centre,
    region_weight,
    box_centre,
    box_half_width,
    cone_axis,
    cone_cosine,
    length_low,
    length_high,
    fine_low,
    fine_high,
    by_primary,
    n_keep,
    max_points,
):
    """Visit every primary integer triple of a region and keep the best completed candidates.

    Parameters
    ----------
    phase_m, design, wavelength_m : ndarray, shape (m,), (m, 3), (m,)
        Double differences in processing order, the three primaries first.
    lower : ndarray, shape (m, m)
        Cholesky factor of their covariance.
    whitened_design, gain, variance : ndarray
        See `recursion_gains`.
    primary_map : ndarray, shape (3, 3)
        Baseline from the ambiguity-free primary phases.
    factor : ndarray, shape (3, 3)
        Upper triangular R with ``||R (n - centre_integers)||^2 <= 1`` inside it.
    centre_integers : ndarray, shape (3,)
        The real-valued integers of the centre.
    hole : float
        Inner bound of the same quadratic form (0 for a full ellipsoid).
    region_centre, region_weight : ndarray, shape (f, 3), (f, 3, 3)
        Further ellipsoids the primary baseline has to lie in.
    box_centre, box_half_width : ndarray, shape (3,)
        Box the primary baseline has to lie in (infinite where there is none).
    cone_axis, cone_cosine : ndarray, shape (3,), float
        Cone around a direction (cosine -2 where there is none).
    length_low, length_high : float
        Coarse limits on the length of the primary baseline.
    fine_low, fine_high : float
        Limits on the length of the baseline of all rows.
    by_primary : bool
        Round all secondary rows from the primary baseline instead of one after the other.
    n_keep : int
        Candidates to keep.
    max_points : int
        Stop after that many lattice points.

    Returns
    -------
    integers : ndarray of int64, shape (n_keep, m)
        Kept candidates, unordered.
    baseline : ndarray, shape (n_keep, 3)
        Least-squares baseline of each.
    objective : ndarray, shape (n_keep,)
        Residual quadratic form.
    counts : ndarray of int64, shape (4,)
        Lattice points in the region, those that passed the region and coarse length tests,
        those that passed the fine length test, and the number kept.
    """
    m = phase_m.shape[0]
    integers = np.zeros((n_keep, m), dtype=np.int64)
    baselines = np.zeros((n_keep, 3))
    objective = np.zeros(n_keep)
    counts = np.zeros(4, dtype=np.int64)
    n_row = np.zeros(m, dtype=np.int64)
    y = np.empty(m)
    w = np.empty(m)
    xp = np.empty(3)
    x = np.empty(3)
    n_kept = 0
    worst = 0
    limit = np.inf

    half2 = 1.0 / abs(factor[2, 2])
    for n2 in range(int(np.ceil(centre_integers[2] - half2)), int(np.floor(centre_integers[2] + half2)) + 1):
        d2 = n2 - centre_integers[2]
        rest2 = 1.0 - (factor[2, 2] * d2) ** 2
        if rest2 < 0.0:
            continue
        mid1 = centre_integers[1] - factor[1, 2] * d2 / factor[1, 1]
        half1 = np.sqrt(rest2) / abs(factor[1, 1])
        for n1 in range(int(np.ceil(mid1 - half1)), int(np.floor(mid1 + half1)) + 1):
            d1 = n1 - centre_integers[1]
            rest1 = rest2 - (factor[1, 1] * (n1 - mid1)) ** 2
            if rest1 < 0.0:
                continue
            mid0 = centre_integers[0] - (factor[0, 1] * d1 + factor[0, 2] * d2) / factor[0, 0]
            half0 = np.sqrt(rest1) / abs(factor[0, 0])
            first = int(np.ceil(mid0 - half0))
            last = int(np.floor(mid0 + half0))
            # The line may cross the hole; its points are skipped without being looked at.
            inner = hole - (1.0 - rest1)
            skip_first = last + 1
            skip_last = last
            if inner > 0.0:
                inner_half = np.sqrt(inner) / abs(factor[0, 0])
                skip_first = int(np.floor(mid0 - inner_half)) + 1
                skip_last = int(np.ceil(mid0 + inner_half)) - 1
            n0 = first - 1
            while n0 < last:
                n0 += 1
                if skip_first <= n0 <= skip_last:
                    n0 = skip_last
                    continue
                counts[0] += 1
                if counts[0] > max_points:
                    counts[3] = n_kept
                    return integers, baselines, objective, counts
                n_row[0] = n0
                n_row[1] = n1
                n_row[2] = n2
                for i in range(3):
                    y[i] = phase_m[i] - wavelength_m[i] * n_row[i]
                length = 0.0
                along = 0.0
                outside = False
                for r in range(3):
                    xp[r] = primary_map[r, 0] * y[0] + primary_map[r, 1] * y[1] + primary_map[r, 2] * y[2]
                    length += xp[r] * xp[r]
                    along += xp[r] * cone_axis[r]
                    if abs(xp[r] - box_centre[r]) > box_half_width[r]:
                        outside = True
                length = np.sqrt(length)
                if outside or length < length_low or length > length_high or along < cone_cosine * length:
                    continue
                for f in range(region_centre.shape[0]):
                    q = 0.0
                    for r in range(3):
                        for c in range(3):
                            q += (
                                (xp[r] - region_centre[f, r])
                                * region_weight[f, r, c]
                                * (xp[c] - region_centre[f, c])
                            )
                    if q > 1.0:
                        outside = True
                if outside:
                    continue
                counts[1] += 1

                for r in range(3):
                    x[r] = xp[r]
                omega = 0.0
                for i in range(m):
                    known = 0.0
                    for j in range(i):
                        known += lower[i, j] * w[j]
                    if i >= 3:
                        if by_primary:
                            predicted = design[i, 0] * xp[0] + design[i, 1] * xp[1] + design[i, 2] * xp[2]
                        else:
                            predicted = known + lower[i, i] * (
                                whitened_design[i, 0] * x[0]
                                + whitened_design[i, 1] * x[1]
                                + whitened_design[i, 2] * x[2]
                            )
                        n_row[i] = int(np.floor((phase_m[i] - predicted) / wavelength_m[i] + 0.5))
                        y[i] = phase_m[i] - wavelength_m[i] * n_row[i]
                    w[i] = (y[i] - known) / lower[i, i]
                    if i >= 3:
                        innovation = w[i] - (
                            whitened_design[i, 0] * x[0]
                            + whitened_design[i, 1] * x[1]
                            + whitened_design[i, 2] * x[2]
                        )
                        omega += innovation * innovation / variance[i]
                        if omega > limit:
                            break
                        for r in range(3):
                            x[r] += gain[i, r] * innovation
                if omega > limit:
                    continue
                length = np.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
                if length < fine_low or length > fine_high:
                    continue
                counts[2] += 1
                place = n_kept
                if n_kept < n_keep:
                    n_kept += 1
                else:
                    place = worst
                # Element by element: assigning a row costs three seconds of compilation.
                for i in range(m):
                    integers[place, i] = n_row[i]
                for r in range(3):
                    baselines[place, r] = x[r]
                objective[place] = omega
                if n_kept == n_keep:
                    limit = -1.0
                    for k in range(n_keep):
                        if objective[k] > limit:
                            limit = objective[k]
                            worst = k
    counts[3] = n_kept
    return integers, baselines, objective, counts
