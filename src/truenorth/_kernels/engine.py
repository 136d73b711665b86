"""The compiled engine: one baseline over many epochs, from single differences to accepted integers.

Single differences between the receivers enter with one row per satellite and signal, in groups that
share a clock (system, band, tracking):

    y = H b + lambda N + clock_group + e,     H = -e_enu,    e ~ N(0, diag(variance))

Centring the rows of a group about their weighted mean eliminates its clock; it is the same adjustment
as double differences with their full covariance, for every choice of the reference satellite.

Memory. Ambiguities are carried from epoch to epoch as information on the single-difference
ambiguities of the arcs in view, the baselines and clocks of past epochs eliminated:

    M <- f M + s (L W L - L W H (H' W H + N_code)^-1 H' W L)

with W the centred weights and L the wavelengths. It knows no reference satellite (its null space is
one constant per group), so a change of reference costs nothing; an arc that ends is marginalised.
s = min(1, dt / tau) is the share of an epoch that is new when multipath is correlated over tau; f fades
the memory to a stated number of epochs, because multipath of a standing antenna does not average out.
A single epoch is the same with no memory.

All that is carried stands in the arrays of the caller, who may hand over the epochs in blocks of any size,
down to one: the numbers are the same.
"""

import numpy as np

from .constrained import eigen_symmetric_3, nearest_on_shell, search_shell
from .jit import kernel
from .ldl import decorrelate

# Columns of the result row of one epoch.
BX, BY, BZ = 0, 1, 2
COV = 3  # xx, yy, zz, xy, xz, yz
LENGTH, LENGTH_SD = 9, 10
COST, SECOND_COST = 11, 12
RATIO, PROBABILITY = 13, 14
CHI2, CHI2_LIMIT = 15, 16
N_PHASES = 17
PDOP, HDOP, VDOP, AZ_DOP, EL_DOP = 18, 19, 20, 21, 22
FLOAT_X = 23
NODES, FOUND = 26, 27
CHI2_DOF = 28
LENGTH_STATISTIC = 29
FLOAT_COV = 30  # xx, yy, zz, xy, xz, yz
N_COLUMNS = 36

# What is carried from epoch to epoch beside the memory: of the run, and rows of values of every arc.
N_SLOTS, WEIGHT, WINS, TIME = 0, 1, 2, 3
HELD_PROBABILITY, ACCEPTED_TIME, ACCEPTED_VARIANCE, ACCEPTED_X = 4, 5, 6, 7
N_CARRIED = 10
SLOT, VOTES, STRIKES = 0, 1, 2
HELD, CANDIDATE, WINNER = 0, 1, 2

# Reasons and statuses, equal to truenorth.errors (held equal by a test).
R_OK = 0
R_TOO_FEW_SATELLITES = 2
R_NO_CANDIDATE = 4
R_LENGTH_TEST = 5
R_RESIDUAL_TEST = 6
R_RATIO_TEST = 7
R_PROBABILITY_TEST = 8
R_NOT_PERSISTENT = 10
R_SEARCH_LIMIT = 11
R_WEAK_GEOMETRY = 12
R_NO_CODE = 13
R_HOLD_RELEASED = 14
S_NONE, S_FLOAT, S_HELD, S_FIXED = 0, 1, 2, 3

# Kinds of events, spelt out in truenorth.ambiguity.resolution.
E_FIXED = 1
E_DROPPED = 2
E_RELEASED_RESIDUAL = 3
E_RELEASED_LENGTH = 4
E_ADDED = 5
E_EXCLUDED = 6

VOTES_TO_HOLD = 3
"""Epochs in which a new satellite's integer must repeat beside the held ones."""

STRIKES_TO_DROP = 5
"""Epochs in a row that a held satellite may be an outlier before its integer is dropped."""

REPORTED_RATIO = 3.0
"""Ratios are exact up to here, where no test asks for more; above, what is reported is a lower bound."""

_FLAT = 1e-7
"""Determinant of the phases' information over the cube of its mean; below, they see a plane."""

_SHARP = 0.1
"""Share of the length: a baseline known as well as this without it has no mirror image."""

_ABSENT = 1e30
"""Variance of a row that must not count."""


@kernel
def invert_3(matrix, inverse):
    """Inverse of a symmetric positive definite 3 x 3 matrix; returns False when it is not one."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    d, e, f = matrix[1, 1], matrix[1, 2], matrix[2, 2]
    c00 = d * f - e * e
    c01 = c * e - b * f
    c02 = b * e - c * d
    det = a * c00 + b * c01 + c * c02
    if not (a > 0.0 and a * d - b * b > 1e-14 * a * d and det > 1e-14 * a * d * f):
        return False
    inverse[0, 0] = c00 / det
    inverse[0, 1] = c01 / det
    inverse[0, 2] = c02 / det
    inverse[1, 0] = c01 / det
    inverse[1, 1] = (a * f - c * c) / det
    inverse[1, 2] = (b * c - a * e) / det
    inverse[2, 0] = c02 / det
    inverse[2, 1] = inverse[1, 2]
    inverse[2, 2] = (a * d - b * b) / det
    return True


@kernel
def quadratic_3(matrix, x, y, z):
    """Quadratic form v' M v for a symmetric 3 x 3 matrix and v = (x, y, z)."""
    return (
        matrix[0, 0] * x * x
        + matrix[1, 1] * y * y
        + matrix[2, 2] * z * z
        + 2.0 * (matrix[0, 1] * x * y + matrix[0, 2] * x * z + matrix[1, 2] * y * z)
    )


@kernel
def has_mirror(information, information_code, length, inverse):
    """Whether the phases see the baseline only in a plane, so that its mirror image has the same length.

    Two double differences of one direction each (three satellites, however many frequencies) leave two
    points on the sphere; only a code or a prior that is sharp against the length tells them apart.
    """
    xx = information[0, 0] - information_code[0, 0]
    yy = information[1, 1] - information_code[1, 1]
    zz = information[2, 2] - information_code[2, 2]
    xy = information[0, 1] - information_code[0, 1]
    xz = information[0, 2] - information_code[0, 2]
    yz = information[1, 2] - information_code[1, 2]
    volume = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    mean = (xx + yy + zz) / 3.0
    if volume > _FLAT * mean * mean * mean:
        return False
    if not invert_3(information, inverse):
        return True
    return inverse[0, 0] + inverse[1, 1] + inverse[2, 2] > (_SHARP * length) ** 2


@kernel
def write_symmetric(matrix, row, column):
    """Put the six elements of a symmetric matrix into the result row: xx, yy, zz, xy, xz, yz."""
    for r in range(3):
        row[column + r] = matrix[r, r]
    row[column + 3] = matrix[0, 1]
    row[column + 4] = matrix[0, 2]
    row[column + 5] = matrix[1, 2]


@kernel
def cholesky_invert(a, n, inverse):
    """Inverse of the symmetric positive definite a[:n, :n] (destroyed); False when it is not one."""
    for j in range(n):
        diagonal = a[j, j]
        scale = abs(diagonal)
        for k in range(j):
            diagonal -= a[j, k] * a[j, k]
        if not diagonal > 1e-13 * scale:
            return False
        root = np.sqrt(diagonal)
        a[j, j] = root
        for i in range(j + 1, n):
            value = a[i, j]
            for k in range(j):
                value -= a[i, k] * a[j, k]
            a[i, j] = value / root
    # The inverse of the factor replaces it, transposed above the diagonal so that rows are contiguous.
    for j in range(n):
        a[j, j] = 1.0 / a[j, j]
        for i in range(j + 1, n):
            value = a[i, j] * a[j, j]
            for k in range(j + 1, i):
                value += a[i, k] * a[j, k]
            a[j, i] = -value / a[i, i]
    for i in range(n):
        for j in range(i + 1):
            value = 0.0
            for k in range(i, n):
                value += a[i, k] * a[j, k]
            inverse[i, j] = value
            inverse[j, i] = value
    return True


@kernel
def centre(first, m, y, design, variance, group, w, hc, yc, total):
    """Weights and rows first:first+m about the weighted mean of their group.

    Writes the weight `w`, the centred design `hc` and observation `yc`, and the group's `total` weight of
    each row, from index 0. Returns the number of rows beyond the first of their group.
    """
    n = 0
    i = 0
    while i < m:
        j = i
        weight = 0.0
        m0 = 0.0
        m1 = 0.0
        m2 = 0.0
        my = 0.0
        while j < m and group[first + j] == group[first + i]:
            k = first + j
            w[j] = 1.0 / variance[k]
            weight += w[j]
            m0 += w[j] * design[k, 0]
            m1 += w[j] * design[k, 1]
            m2 += w[j] * design[k, 2]
            my += w[j] * y[k]
            j += 1
        n += j - i - 1
        for q in range(i, j):
            k = first + q
            hc[q, 0] = design[k, 0] - m0 / weight
            hc[q, 1] = design[k, 1] - m1 / weight
            hc[q, 2] = design[k, 2] - m2 / weight
            yc[q] = y[k] - my / weight
            total[q] = weight
        i = j
    return n


@kernel
def accumulate(m, w, hc, yc, information, rhs):
    """Add the normal equations of centred rows."""
    for k in range(m):
        for r in range(3):
            weighted = w[k] * hc[k, r]
            rhs[r] += weighted * yc[k]
            for c in range(3):
                information[r, c] += weighted * hc[k, c]


@kernel
def residual_sum(m, w, hc, yc, b, residual):
    """Residuals of centred rows at the baseline b; returns their weighted sum of squares."""
    chi2 = 0.0
    for k in range(m):
        residual[k] = yc[k] - hc[k, 0] * b[0] - hc[k, 1] * b[1] - hc[k, 2] * b[2]
        chi2 += w[k] * residual[k] * residual[k]
    return chi2


@kernel
def worst_row(m, w, hc, total, residual, cov):
    """Row with the largest normalised residual |r| / sd(r); returns (row or -1, that number).

    The variance of a residual is what is left of the observation's after the clock of its group and
    the baseline took their part (Baarda 1968); rows with hardly any redundancy cannot be judged.
    """
    worst = -1
    largest = 0.0
    for k in range(m):
        left = 1.0 / w[k] - 1.0 / total[k] - quadratic_3(cov, hc[k, 0], hc[k, 1], hc[k, 2])
        if left * w[k] > 0.02:
            size = abs(residual[k]) / np.sqrt(left)
            if size > largest and w[k] * _ABSENT > 10.0:
                largest = size
                worst = k
    return worst, largest


@kernel
def write_result(
    b_free, b, information, cov, chi2, dof, length, length_variance, use_length, chi2_limits, row
):
    """Fill the result row from an adjustment with known integers; `cov` gets the final covariance.

    `b_free` is adjusted without the length, `b` with it where `use_length`; `information` is that of
    `b_free`. Returns False when the information is singular.
    """
    if not invert_3(information, cov):
        return False
    measured = np.sqrt(b_free[0] ** 2 + b_free[1] ** 2 + b_free[2] ** 2)
    variance = quadratic_3(cov, b_free[0], b_free[1], b_free[2]) / (measured * measured)
    row[LENGTH] = measured
    row[LENGTH_SD] = np.sqrt(variance)
    row[LENGTH_STATISTIC] = abs(measured - length) / np.sqrt(variance + length_variance)
    if use_length:
        size = np.sqrt(b[0] ** 2 + b[1] ** 2 + b[2] ** 2)
        # The multiplier of the length bends the objective across the line of sight.
        nu = 0.0
        for r in range(3):
            for c in range(3):
                nu += b[r] * information[r, c] * (b_free[c] - b[c]) / (size * size)
        bent = np.empty((3, 3))
        for r in range(3):
            for c in range(3):
                bent[r, c] = information[r, c]
            bent[r, r] += nu
        if invert_3(bent, cov):
            # The length is one observation along b; a tenth of a micrometre keeps the result invertible.
            softness = max(length_variance, 1e-14) / (1.0 - nu * length_variance)
            along = np.zeros(3)
            for r in range(3):
                for c in range(3):
                    along[r] += cov[r, c] * b[c] / size
                softness += along[r] * b[r] / size
            for r in range(3):
                for c in range(3):
                    cov[r, c] -= along[r] * along[c] / softness
        dof += 1
        if length_variance > 0.0:
            chi2 += (size - length) ** 2 / length_variance
    for r in range(3):
        row[BX + r] = b[r]
    write_symmetric(cov, row, np.int64(COV))
    row[CHI2] = chi2
    row[CHI2_DOF] = dof
    row[CHI2_LIMIT] = chi2_limits[min(dof, len(chi2_limits) - 1)] if dof > 0 else np.nan
    return True


@kernel
def write_dops(m, design, variance, group, b, hc, yc, w, total, row):
    """DOPs of the double differences for unit undifferenced noise, and of the direction of b."""
    information = np.zeros((3, 3))
    rhs = np.zeros(3)
    q = np.empty((3, 3))
    # Single differences of unit undifferenced noise have variance 2.
    for k in range(m):
        variance[k] = 2.0
    centre(np.int64(0), m, yc, design, variance, group, w, hc, yc, total)
    accumulate(m, w, hc, yc, information, rhs)
    if not invert_3(information, q):
        return
    row[PDOP] = np.sqrt(q[0, 0] + q[1, 1] + q[2, 2])
    row[HDOP] = np.sqrt(q[0, 0] + q[1, 1])
    row[VDOP] = np.sqrt(q[2, 2])
    horizontal = np.sqrt(b[0] * b[0] + b[1] * b[1])
    if horizontal > 0.0:
        norm = np.sqrt(horizontal * horizontal + b[2] * b[2])
        sa, ca = b[0] / horizontal, b[1] / horizontal
        se, ce = b[2] / norm, horizontal / norm
        row[AZ_DOP] = np.sqrt(quadratic_3(q, ca / ce, -sa / ce, 0.0))
        row[EL_DOP] = np.sqrt(quadratic_3(q, -se * sa, -se * ca, ce))


@kernel
def pull_to_length(b_free, information, length, length_variance, b):
    """Nearest baseline of the known length to `b_free`, in the metric of the information."""
    values = np.empty(3)
    axes = np.empty((3, 3))
    centre_eigen = np.empty(3)
    inside = np.empty(3)
    eigen_symmetric_3(information, values, axes)
    for r in range(3):
        centre_eigen[r] = axes[0, r] * b_free[0] + axes[1, r] * b_free[1] + axes[2, r] * b_free[2]
    nearest_on_shell(centre_eigen, values, length, length_variance, inside)
    for r in range(3):
        b[r] = axes[r, 0] * inside[0] + axes[r, 1] * inside[1] + axes[r, 2] * inside[2]


@kernel
def resolve_integers(
    n, a_float, q_float, q_baseline, b_float, j_min, info_total, mu,
    length, length_variance, cap, margin, reach, max_nodes, a_best, b_constrained, b_free, row,
):  # fmt: skip
    """Integer least squares with or without the length, from a float solution.

    Parameters
    ----------
    n : int
        Ambiguities.
    a_float, q_float : ndarray, shapes (n,), (n, n)
        Float ambiguities and covariance, cycles; with the pseudo-observation of weight `mu`.
    q_baseline : ndarray, shape (3, n)
        Covariance of baseline and ambiguities.
    b_float, j_min : ndarray, float
        Float baseline and least objective, with the pseudo-observation.
    info_total : ndarray, shape (3, 3)
        Information on the baseline once the integers are known, without `mu`.
    length : float
        Known length; NaN leaves the search unconstrained.
    cap, margin, reach, max_nodes : float, float, float, int
        See `search_shell`.
    a_best, b_constrained, b_free : ndarray, shapes (n,), (3,), (3,)
        Output: the best integers and their baseline, with and without the length.
    row : ndarray
        Costs, nodes, ratio and probability are written.

    Returns
    -------
    int
        Reason code; R_OK when at least one candidate was found in a complete search.
    """
    information = np.empty(3)
    axes = np.empty((3, 3))
    row[FOUND] = 0.0
    eigen_symmetric_3(info_total, information, axes)
    if not information[0] > 1e-9 * information[2]:
        return R_WEAK_GEOMETRY
    lower = np.empty((n, n))
    diag = np.empty(n)
    z_transform = np.empty((n, n))
    back = np.empty((n, n))
    if decorrelate(q_float, n, lower, diag, z_transform, back) != 0:
        return R_WEAK_GEOMETRY

    # The whole cycles of the float ambiguities stay outside the search.
    z_float = np.zeros(n)
    cross = np.zeros((3, n))
    for j in range(n):
        rest = a_float[j] - np.floor(a_float[j] + 0.5)
        for i in range(n):
            factor = z_transform[j, i]
            if factor != 0.0:
                z_float[i] += factor * rest
                for r in range(3):
                    cross[r, i] += q_baseline[r, j] * factor
    # gain = cross Q_z^-1, row by row, then turned into the eigenframe.
    gain = np.empty((3, n))
    for r in range(3):
        for i in range(n - 1, -1, -1):
            for j in range(i + 1, n):
                cross[r, i] -= lower[j, i] * cross[r, j]
        for i in range(n):
            value = cross[r, i] / diag[i]
            for j in range(i):
                value -= lower[i, j] * gain[r, j]
            gain[r, i] = value
    b_eigen = np.empty(3)
    for i in range(n):
        g0, g1, g2 = gain[0, i], gain[1, i], gain[2, i]
        for r in range(3):
            gain[r, i] = axes[0, r] * g0 + axes[1, r] * g1 + axes[2, r] * g2
    for r in range(3):
        b_eigen[r] = axes[0, r] * b_float[0] + axes[1, r] * b_float[1] + axes[2, r] * b_float[2]

    z_best = np.zeros(n)
    costs = np.empty(2)
    best_eigen = np.zeros(3)
    free_eigen = np.zeros(3)
    found, nodes, complete, probability = search_shell(
        n, lower, diag, z_float, gain, b_eigen, information, mu, j_min,
        length, length_variance, cap, margin, reach, max_nodes, z_best, costs, best_eigen, free_eigen,
    )  # fmt: skip
    row[NODES] = nodes
    row[FOUND] = found
    if found == 0:
        return R_NO_CANDIDATE if complete else R_SEARCH_LIMIT
    row[COST] = costs[0]
    row[SECOND_COST] = costs[1]
    row[PROBABILITY] = probability
    row[RATIO] = min(costs[1] / max(costs[0], 1e-9), 999.9)
    for i in range(n):
        value = np.floor(a_float[i] + 0.5)
        for j in range(n):
            value += back[i, j] * z_best[j]
        a_best[i] = np.floor(value + 0.5)
    for r in range(3):
        b_constrained[r] = (
            axes[r, 0] * best_eigen[0] + axes[r, 1] * best_eigen[1] + axes[r, 2] * best_eigen[2]
        )
        b_free[r] = axes[r, 0] * free_eigen[0] + axes[r, 1] * free_eigen[1] + axes[r, 2] * free_eigen[2]
    return R_OK if complete else R_SEARCH_LIMIT


@kernel
def search_epoch(
    m, n, lam, group, slot, memory, vector, w, hc, yc, total, rhs, info_code, rhs_code, info_total, mu,
    length, length_variance, cap, margin, reach, max_nodes, a_best, b_con, b_free, row,
):  # fmt: skip
    """Float solution of one epoch with the memory, and its integer search.

    `slot` is the place of each row in the memory. Returns the reason code of `resolve_integers`.
    """
    nb = np.empty((3, 3))
    nb_inverse = np.empty((3, 3))
    for r in range(3):
        for s in range(3):
            nb[r, s] = info_total[r, s]
        nb[r, r] += mu
    row[FOUND] = 0.0
    if not invert_3(nb, nb_inverse):
        return R_NO_CODE
    member = np.empty(n, np.int64)
    k = 0
    for i in range(1, m):
        if group[i] == group[i - 1]:
            member[k] = i
            k += 1
    c = np.empty((n, 3))
    d = np.empty((n, 3))
    normal = np.empty((n, n))
    right = np.empty(n)
    for a in range(n):
        i = member[a]
        scale = lam[i] * w[i]
        right[a] = vector[slot[i]] + scale * yc[i]
        for r in range(3):
            c[a, r] = scale * hc[i, r]
        for r in range(3):
            d[a, r] = nb_inverse[r, 0] * c[a, 0] + nb_inverse[r, 1] * c[a, 1] + nb_inverse[r, 2] * c[a, 2]
            right[a] -= d[a, r] * rhs[r]
        for b in range(a + 1):
            j = member[b]
            value = memory[slot[i], slot[j]] - d[a, 0] * c[b, 0] - d[a, 1] * c[b, 1] - d[a, 2] * c[b, 2]
            if group[i] == group[j]:
                value -= scale * lam[j] * w[j] / total[i]
            if a == b:
                value += scale * lam[i]
            normal[a, b] = value
            normal[b, a] = value
    q_a = np.empty((n, n))
    if not cholesky_invert(normal, n, q_a):
        return R_NO_CODE
    a_float = np.zeros(n)
    q_ba = np.zeros((3, n))
    shift = np.zeros(3)
    b_float = np.zeros(3)
    for a in range(n):
        for b in range(n):
            a_float[a] += q_a[a, b] * right[b]
            for r in range(3):
                q_ba[r, a] -= d[b, r] * q_a[b, a]
        for r in range(3):
            shift[r] += c[a, r] * a_float[a]
    for r in range(3):
        for s in range(3):
            b_float[r] += nb_inverse[r, s] * (rhs[s] - shift[s])
    # The objective counts from the float solution without the pseudo-observation.
    j_min = mu * (b_float[0] ** 2 + b_float[1] ** 2 + b_float[2] ** 2)
    known = invert_3(info_code, nb)
    if not known:
        # One or two code differences: their least, with a millionth of their information added.
        floor = 1e-6 * (info_code[0, 0] + info_code[1, 1] + info_code[2, 2])
        regular = np.empty((3, 3))
        for r in range(3):
            for s in range(3):
                regular[r, s] = info_code[r, s]
            regular[r, r] += floor
        known = invert_3(regular, nb)
    if known:
        for r in range(3):
            for s in range(3):
                j_min += rhs_code[r] * nb[r, s] * rhs_code[s] + b_float[r] * info_code[r, s] * b_float[s]
            j_min -= 2.0 * b_float[r] * rhs_code[r]
    return resolve_integers(
        n, a_float, q_a, q_ba, b_float, j_min, info_total, mu,
        length, length_variance, cap, margin, reach, max_nodes, a_best, b_con, b_free, row,
    )  # fmt: skip


@kernel
def remember(m, lam, group, slot, w, hc, yc, total, cov, rhs, share, memory, vector):
    """Add the reduced information of one epoch to the memory; `cov` inverts its baseline information."""
    d = np.empty(3)
    for k in range(m):
        scale = share * lam[k] * w[k]
        vector[slot[k]] += scale * yc[k]
        for r in range(3):
            d[r] = scale * (cov[r, 0] * hc[k, 0] + cov[r, 1] * hc[k, 1] + cov[r, 2] * hc[k, 2])
            vector[slot[k]] -= d[r] * rhs[r]
        for q in range(m):
            other = lam[q] * w[q]
            value = -other * (d[0] * hc[q, 0] + d[1] * hc[q, 1] + d[2] * hc[q, 2])
            if group[q] == group[k]:
                value -= scale * other / total[k]
            if q == k:
                value += scale * lam[k]
            memory[slot[k], slot[q]] += value


@kernel
def marginalise(memory, vector, n_slots, s):
    """Eliminate slot s: what it says of the others stays, its own information becomes zero."""
    pivot = memory[s, s]
    if pivot > 1e-6:
        for i in range(n_slots):
            factor = memory[i, s] / pivot
            if i != s and factor != 0.0:
                for j in range(n_slots):
                    memory[i, j] -= factor * memory[s, j]
                vector[i] -= factor * vector[s]
    for i in range(n_slots):
        memory[i, s] = 0.0
        memory[s, i] = 0.0
    vector[s] = 0.0


@kernel
def forget(memory, vector, slot_arc, n_slots, s):
    """Marginalise slot s and put the last slot in its place; returns the new number of slots."""
    marginalise(memory, vector, n_slots, s)
    last = n_slots - 1
    for i in range(n_slots):
        memory[i, s] = memory[i, last]
    for i in range(n_slots):
        memory[s, i] = memory[last, i]
    vector[s] = vector[last]
    slot_arc[s] = slot_arc[last]
    for i in range(n_slots):
        memory[i, last] = 0.0
        memory[last, i] = 0.0
    vector[last] = 0.0
    return last


@kernel
def clear_memory(memory, vector, n_slots):
    """Forget what all arcs in view have told so far."""
    for s in range(n_slots):
        vector[s] = 0.0
        for t in range(n_slots):
            memory[s, t] = 0.0


@kernel
def strike_row(m, k, y, design, lam, variance, group, arc, index):
    """Take row k out of the epoch's compact arrays; returns the new number of rows."""
    for i in range(k, m - 1):
        y[i] = y[i + 1]
        lam[i] = lam[i + 1]
        variance[i] = variance[i + 1]
        group[i] = group[i + 1]
        arc[i] = arc[i + 1]
        index[i] = index[i + 1]
        for r in range(3):
            design[i, r] = design[i + 1, r]
    return m - 1


@kernel
def log_event(events, numbers, counter, epoch, row, kind, statistic, limit):
    """Write one event if there is room; counter[0] is the number of events."""
    k = counter[0]
    if k < len(events):
        events[k, 0] = epoch
        events[k, 1] = row
        events[k, 2] = kind
        numbers[k, 0] = statistic
        numbers[k, 1] = limit
        counter[0] = k + 1


@kernel
def count_held(m, group, arc, held):
    """Double differences among the rows whose integers are held."""
    count = 0
    i = 0
    while i < m:
        inside = 0
        j = i
        while j < m and group[j] == group[i]:
            if held[arc[j]] == held[arc[j]]:
                inside += 1
            j += 1
        count += max(inside - 1, 0)
        i = j
    return count


@kernel
def renew_slots(m, arc, carry, memory, vector, slot_arc, slot_of_arc, votes, n_slots):
    """Marginalise the arcs that left and give new ones an empty slot.

    Returns the number of slots that survived and the number of slots now.
    """
    if not carry:
        for s in range(n_slots):
            slot_of_arc[slot_arc[s]] = -1
        n_slots = np.int64(0)
    # Arcs in view are marked by a negative number.
    for k in range(m):
        if slot_of_arc[arc[k]] >= 0:
            slot_arc[slot_of_arc[arc[k]]] = -1 - arc[k]
    s = np.int64(0)
    while s < n_slots:
        if slot_arc[s] >= 0:
            slot_of_arc[slot_arc[s]] = -1
            n_slots = forget(memory, vector, slot_arc, n_slots, s)
        else:
            slot_arc[s] = -1 - slot_arc[s]
            slot_of_arc[slot_arc[s]] = s
            s += 1
    survivors = n_slots
    for k in range(m):
        if slot_of_arc[arc[k]] < 0:
            slot_of_arc[arc[k]] = n_slots
            slot_arc[n_slots] = arc[k]
            votes[arc[k]] = 0
            n_slots += 1
    return survivors, n_slots


@kernel
def check_held(
    epoch, m, y, design, lam, variance, group, arc, index, held, votes, strikes, info_code, rhs_code,
    length, length_variance, use_length, check_length, length_tolerance_sd, chi2_limits,
    y_held, variance_held, w, hc, yc, total, res, info, rhs, cov, b_free, b_con, row,
    events, numbers, counter,
):  # fmt: skip
    """Adjust an epoch with its held integers; they stand as long as residuals and length agree.

    Rows without a held integer count nothing, but get their residual against the group's clock. A bad
    phase is out for this epoch, and loses its integer when it stays bad.

    Returns
    -------
    int
        Double differences of held integers that stand; 0 where too few are held; -1 where they failed.
    """
    for k in range(m):
        known = held[arc[k]] == held[arc[k]]
        variance_held[k] = variance[k] if known else _ABSENT
        y_held[k] = y[k] - lam[k] * held[arc[k]] if known else y[k]
    n_held = count_held(m, group, arc, held)
    outcome = np.int64(0)
    attempt = 0
    while n_held >= 4:
        for r in range(3):
            rhs[r] = rhs_code[r]
            for c in range(3):
                info[r, c] = info_code[r, c]
        centre(np.int64(0), m, y_held, design, variance_held, group, w, hc, yc, total)
        accumulate(m, w, hc, yc, info, rhs)
        if not invert_3(info, cov) or (use_length and has_mirror(info, info_code, length, cov)):
            break
        for r in range(3):
            b_free[r] = cov[r, 0] * rhs[0] + cov[r, 1] * rhs[1] + cov[r, 2] * rhs[2]
            b_con[r] = b_free[r]
        chi2 = residual_sum(m, w, hc, yc, b_free, res)
        limit = chi2_limits[min(n_held - 3, len(chi2_limits) - 1)]
        if chi2 <= limit:
            if use_length:
                pull_to_length(b_free, info, length, length_variance, b_con)
                chi2 = residual_sum(m, w, hc, yc, b_con, res)
            write_result(
                b_free,
                b_con,
                info,
                cov,
                chi2,
                n_held - 3,
                length,
                length_variance,
                use_length,
                chi2_limits,
                row,
            )
            outcome = n_held
            statistic = row[LENGTH_STATISTIC]
            if check_length and statistic > length_tolerance_sd:
                outcome = np.int64(-1)
                log_event(
                    events, numbers, counter, epoch, outcome, np.int64(E_RELEASED_LENGTH), statistic,
                    length_tolerance_sd,
                )  # fmt: skip
            break
        worst, size = worst_row(m, w, hc, total, res, cov)
        attempt += 1
        if worst < 0 or n_held <= 4 or attempt > 1 + n_held // 4:
            outcome = np.int64(-1)
            log_event(events, numbers, counter, epoch, outcome, np.int64(E_RELEASED_RESIDUAL), chi2, limit)
            break
        variance_held[worst] = _ABSENT
        n_held -= 1
        a = arc[worst]
        strikes[a] += 2
        if strikes[a] >= 2 * STRIKES_TO_DROP:
            held[a] = np.nan
            votes[a] = 0
            log_event(
                events,
                numbers,
                counter,
                epoch,
                index[worst],
                np.int64(E_DROPPED),
                size,
                1.0 * STRIKES_TO_DROP,
            )
    for k in range(m):
        strikes[arc[k]] = max(strikes[arc[k]] - 1, 0)
    return outcome


@kernel
def hold_more(
    epoch, m, lam, variance, group, arc, index, total, res, held, candidate, votes, events, numbers, counter
):
    """Hold the integers of further rows that stay near the same integer, beside those that are held."""
    for k in range(m):
        a = arc[k]
        if held[a] == held[a]:
            continue
        if total[k] * _ABSENT < 1e3:
            # No held satellite in this group yet: its first one becomes the datum.
            if k == 0 or group[k] != group[k - 1]:
                held[a] = 0.0
            continue
        nearest = np.floor(res[k] / lam[k] + 0.5)
        off = abs(res[k] - nearest * lam[k])
        if off > 0.25 * lam[k] or off > 4.0 * np.sqrt(variance[k]):
            votes[a] = 0
            continue
        votes[a] = votes[a] + 1 if candidate[a] == nearest and votes[a] > 0 else 1
        candidate[a] = nearest
        if votes[a] >= VOTES_TO_HOLD:
            held[a] = nearest
            log_event(events, numbers, counter, epoch, index[k], np.int64(E_ADDED), off, 0.25 * lam[k])


@kernel
def run_engine(
    time_s, start, y_all, design_all, lam_all, variance_all, group_all, arc_all,
    code_start, code_y, code_design, code_variance, code_group, prior_information, prior_rhs,
    length, length_variance, use_length, check_length, length_tolerance_sd, kappa,
    cap_factor, margin, max_nodes, chi2_limits, min_probability, ratio_mode, ratio_limits, max_exclusions,
    carry, hold, correlation_s, memory_epochs, min_epochs_to_fix, change_sd_mps,
    memory, vector, slot_arc, arc_number, arc_value, carried,
    residual, integer, out, status, reason, events, numbers,
):  # fmt: skip
    """Resolve all epochs in the order given, from the state that is given, to the one after the last.

    Parameters
    ----------
    time_s, start : ndarray
        Times and row offsets of the epochs.
    y_all, design_all, lam_all, variance_all, group_all, arc_all : ndarray
        Phase rows: single differences (m), design (ENU), wavelength, variance, group, arc. The rows of a
        group are neighbours; the first of them is the reference of its double differences.
    code_start, code_y, code_design, code_variance, code_group : ndarray
        Code rows, likewise.
    prior_information, prior_rhs : ndarray, shapes (3, 3), (3,)
        A-priori information on the baseline, the same at every epoch.
    length, length_variance : float
        Known length (NaN: unknown) and its variance.
    use_length, check_length : bool
        The length takes part in search and adjustment; it is tested after them.
    kappa, cap_factor, margin, max_nodes : float, float, float, int
        Of the search: weight of the pseudo-observation times l^2, reach, posterior margin, limit.
    chi2_limits, min_probability, ratio_mode, ratio_limits, max_exclusions
        Of the tests; `ratio_limits` by the number of double differences, on the ratio (mode 1) or the
        difference (mode 2) of the two best objectives.
    carry, hold : bool
        Carry ambiguities over epochs; hold accepted ones.
    correlation_s, memory_epochs, min_epochs_to_fix
        Of the memory and of acceptance, see the module's docstring.
    change_sd_mps : float
        Standard deviation of the baseline's change in a second; NaN leaves it free.
    memory, vector, slot_arc : ndarray, shapes (k, k), (k,), (k,)
        State: information on the ambiguities, its right side, and the arc of each slot; k is twice the
        most rows of an epoch and one. Zero beyond the slots in use.
    arc_number, arc_value : ndarray of int64 and float, shape (3, n_arcs)
        State of the arcs: slot (-1: none), votes, strikes; integers held, candidates, last winner (NaN:
        none).
    carried : ndarray, shape (N_CARRIED,)
        State of the run: slots in use, weight of the memory, epochs that the winner won, time of the last
        epoch, probability with which the held integers were fixed; time, variance (NaN: none) and baseline
        of the last accepted epoch.
    residual, integer : ndarray, shape (n_rows,)
        Outputs: residuals of the winner and its integers, NaN where a row did not take part.
    out, status, reason : ndarray
        Outputs, one row per epoch.
    events, numbers : ndarray, shapes (capacity, 3), (capacity, 2)
        Outputs: (epoch, row or -1, kind) and (statistic, limit).

    Returns
    -------
    int
        Number of events.
    """
    n_epochs = len(start) - 1
    widest = 1
    for e in range(n_epochs):
        widest = max(widest, start[e + 1] - start[e], code_start[e + 1] - code_start[e])
    y = np.empty(widest)
    design = np.empty((widest, 3))
    lam = np.empty(widest)
    variance = np.empty(widest)
    group = np.empty(widest, np.int64)
    arc = np.empty(widest, np.int64)
    index = np.empty(widest, np.int64)
    slot = np.empty(widest, np.int64)
    y_held = np.empty(widest)
    variance_held = np.empty(widest)
    w = np.empty(widest)
    hc = np.empty((widest, 3))
    yc = np.empty(widest)
    total = np.empty(widest)
    res = np.empty(widest)
    a_best = np.empty(widest)
    spread = np.empty(widest)

    # The memory without the arcs that the epoch's search struck out.
    rest = np.zeros(memory.shape)
    rest_vector = np.zeros(len(vector))
    n_arcs = arc_value.shape[1]
    slot_of_arc, votes, strikes = arc_number[SLOT], arc_number[VOTES], arc_number[STRIKES]
    held, candidate, winner = arc_value[HELD], arc_value[CANDIDATE], arc_value[WINNER]
    n_slots = np.int64(carried[N_SLOTS])
    weight = carried[WEIGHT]
    wins = np.int64(carried[WINS])
    time_before = carried[TIME]
    probability_held = carried[HELD_PROBABILITY]
    time_last = carried[ACCEPTED_TIME]
    variance_last = carried[ACCEPTED_VARIANCE]
    b_last = carried[ACCEPTED_X:]
    # Plain integers, not literals: a kernel is compiled anew for each literal it is called with.
    zero = np.int64(0)
    nowhere = np.int64(-1)
    counter = np.zeros(1, np.int64)

    info_code = np.empty((3, 3))
    info = np.empty((3, 3))
    cov = np.empty((3, 3))
    rhs_code = np.empty(3)
    rhs = np.empty(3)
    b = np.empty(3)
    b_con = np.empty(3)
    b_free = np.empty(3)
    mu = 0.0
    constraint = np.nan
    if use_length:
        mu = kappa / (length * length + kappa * length_variance)
        constraint = length

    for e in range(n_epochs):
        m = start[e + 1] - start[e]
        row = out[e]
        for k in range(N_COLUMNS):
            row[k] = np.nan
        status[e] = S_NONE
        reason[e] = R_TOO_FEW_SATELLITES
        for k in range(m):
            i = start[e] + k
            residual[i] = np.nan
            integer[i] = np.nan
            index[k] = i
            y[k] = y_all[i]
            lam[k] = lam_all[i]
            variance[k] = variance_all[i]
            group[k] = group_all[i]
            arc[k] = arc_all[i]
            for r in range(3):
                design[k, r] = design_all[i, r]

        survivors, n_slots = renew_slots(m, arc, carry, memory, vector, slot_arc, slot_of_arc, votes, n_slots)
        share = 1.0
        if survivors == 0:
            weight = 0.0
        else:
            share = min(1.0, abs(time_s[e] - time_before) / correlation_s)
        time_before = time_s[e]

        # Code and a-priori direction of this epoch give the float baseline.
        for r in range(3):
            rhs_code[r] = prior_rhs[r]
            for c in range(3):
                info_code[r, c] = prior_information[r, c]
        if carry and variance_last == variance_last and change_sd_mps == change_sd_mps:
            # The baseline wanders from the last accepted one: a random walk.
            moved = change_sd_mps * (time_s[e] - time_last)
            stiffness = 1.0 / (moved * moved + variance_last)
            for r in range(3):
                info_code[r, r] += stiffness
                rhs_code[r] += stiffness * b_last[r]
        n_code = code_start[e + 1] - code_start[e]
        centre(code_start[e], n_code, code_y, code_design, code_variance, code_group, w, hc, yc, total)
        accumulate(n_code, w, hc, yc, info_code, rhs_code)
        for r in range(3):
            b[r] = 0.0
        if invert_3(info_code, cov):
            for r in range(3):
                for c in range(3):
                    b[r] += cov[r, c] * rhs_code[c]
                row[FLOAT_X + r] = b[r]
            write_symmetric(cov, row, np.int64(FLOAT_COV))
            status[e] = S_FLOAT

        n_held = zero
        if hold:
            n_held = check_held(
                e, m, y, design, lam, variance, group, arc, index, held, votes, strikes, info_code, rhs_code,
                length, length_variance, use_length, check_length, length_tolerance_sd, chi2_limits,
                y_held, variance_held, w, hc, yc, total, res, info, rhs, cov, b_free, b_con, row,
                events, numbers, counter,
            )  # fmt: skip
        done = n_held > 0
        released = n_held < 0
        if released:
            # Nothing learnt so far can be trusted, nor what is held of satellites out of view.
            for a in range(n_arcs):
                held[a] = np.nan
            clear_memory(memory, vector, n_slots)
            wins = 0
            weight = 0.0
            share = 1.0
        if done:
            status[e] = S_HELD
            reason[e] = R_OK
            # What is held is no surer than it was when it was fixed.
            row[PROBABILITY] = probability_held
            row[N_PHASES] = n_held
            for k in range(m):
                if held[arc[k]] == held[arc[k]] and variance_held[k] < _ABSENT:
                    residual[index[k]] = res[k]
                    integer[index[k]] = held[arc[k]]
            hold_more(
                e, m, lam, variance, group, arc, index, total, res, held, candidate, votes,
                events, numbers, counter,
            )  # fmt: skip

        # The search, where nothing is held; outlying phases are struck one by one.
        n = 0
        n_struck = 0
        for attempt in range(max_exclusions + 1):
            n = centre(zero, m, y, design, variance, group, w, hc, yc, total)
            for r in range(3):
                rhs[r] = rhs_code[r]
                for c in range(3):
                    info[r, c] = info_code[r, c]
            accumulate(m, w, hc, yc, info, rhs)
            if done or n < 3 or (use_length and has_mirror(info, info_code, length, cov)):
                break
            for k in range(m):
                slot[k] = slot_of_arc[arc[k]]
            row[N_PHASES] = n
            dof = n + 1 if use_length else n
            # The second-best objective must be exact as far as the classical test looks.
            threshold = ratio_limits[min(n, len(ratio_limits) - 1)]
            reach = 1.001 * threshold if ratio_mode == 1 else REPORTED_RATIO
            gap_wanted = 1.001 * threshold if ratio_mode == 2 else 0.0
            cap = cap_factor * (1.0 + weight) * chi2_limits[min(dof, len(chi2_limits) - 1)] + margin
            past, past_vector = (rest, rest_vector) if n_struck > 0 else (memory, vector)
            verdict = search_epoch(
                m, n, lam, group, slot, past, past_vector, w, hc, yc, total, rhs, info_code, rhs_code, info,
                mu, constraint, length_variance, cap, max(margin, gap_wanted), reach, max_nodes, a_best,
                b_con, b_free, row,
            )  # fmt: skip
            reason[e] = verdict
            if not row[FOUND] > 0.0:
                if weight > 0.0 and verdict == R_NO_CANDIDATE:
                    # The memory contradicts the epoch: the epoch may still stand by itself.
                    weight = 0.0
                    share = 1.0
                    clear_memory(memory, vector, n_slots)
                    clear_memory(rest, rest_vector, n_slots)
                    continue
                break
            j = 0
            for k in range(m):
                spread[k] = 0.0
                if k > 0 and group[k] == group[k - 1]:
                    spread[k] = a_best[j]
                    j += 1
                y_held[k] = y[k] - lam[k] * spread[k]
            centre(zero, m, y_held, design, variance, group, w, hc, yc, total)
            chi2 = residual_sum(m, w, hc, yc, b_con, res)
            write_result(
                b_free, b_con, info, cov, chi2, n - 3, length, length_variance, use_length, chi2_limits, row
            )
            for k in range(m):
                residual[index[k]] = res[k]
                integer[index[k]] = spread[k]
            gap = row[RATIO] if ratio_mode == 1 else row[SECOND_COST] - row[COST]
            if verdict == R_OK:
                if row[CHI2] > row[CHI2_LIMIT]:
                    verdict = R_RESIDUAL_TEST
                elif check_length and row[LENGTH_STATISTIC] > length_tolerance_sd:
                    verdict = R_LENGTH_TEST
                elif not row[PROBABILITY] >= min_probability:
                    verdict = R_PROBABILITY_TEST
                elif ratio_mode > 0 and gap < ratio_limits[min(n, len(ratio_limits) - 1)]:
                    verdict = R_RATIO_TEST
            reason[e] = verdict
            if verdict != R_RESIDUAL_TEST or attempt == max_exclusions or n < 6:
                break
            invert_3(info, cov)
            worst, size = worst_row(m, w, hc, total, res, cov)
            if worst < 0:
                break
            log_event(events, numbers, counter, e, index[worst], np.int64(E_EXCLUDED), size, np.nan)
            residual[index[worst]] = np.nan
            integer[index[worst]] = np.nan
            # The search goes on with what the memory says when nothing is known of the struck arc.
            if n_struck == 0:
                for s in range(n_slots):
                    rest_vector[s] = vector[s]
                    for t in range(n_slots):
                        rest[s, t] = memory[s, t]
            n_struck += 1
            marginalise(rest, rest_vector, n_slots, slot_of_arc[arc[worst]])
            m = strike_row(m, worst, y, design, lam, variance, group, arc, index)
        if n_struck > 0 and reason[e] == R_OK:
            # Without them all is well: the struck arcs begin anew.
            for s in range(n_slots):
                vector[s] = rest_vector[s]
                for t in range(n_slots):
                    memory[s, t] = rest[s, t]
        if not done and reason[e] == R_OK and n >= 3:
            # The same winner as before, whatever the reference: differences to the group's first.
            same = True
            for k in range(m):
                if k > 0 and group[k] == group[k - 1]:
                    change = spread[k] - winner[arc[k]]
                    if change != spread[k - 1] - winner[arc[k - 1]]:
                        same = False
            for k in range(m):
                winner[arc[k]] = spread[k]
            wins = wins + 1 if same else 1
            if wins >= min_epochs_to_fix:
                status[e] = S_FIXED
                if hold:
                    probability_held = row[PROBABILITY]
                    # Integers held of satellites out of view may refer to another first row.
                    for a in range(n_arcs):
                        held[a] = np.nan
                    for k in range(m):
                        held[arc[k]] = spread[k]
                        strikes[arc[k]] = 0
                    log_event(
                        events,
                        numbers,
                        counter,
                        e,
                        nowhere,
                        np.int64(E_FIXED),
                        row[PROBABILITY],
                        min_probability,
                    )
            else:
                reason[e] = R_NOT_PERSISTENT
        elif not done:
            wins = 0
            if released:
                reason[e] = R_HOLD_RELEASED

        # The memory learns from every epoch.
        if carry and n >= 1:
            centre(zero, m, y, design, variance, group, w, hc, yc, total)
            if invert_3(info, cov):
                fade = 1.0 - share / memory_epochs if weight > 0.0 else 1.0
                weight = fade * weight + share
                for s in range(n_slots):
                    vector[s] *= fade
                    for t in range(n_slots):
                        memory[s, t] *= fade
                for k in range(m):
                    slot[k] = slot_of_arc[arc[k]]
                remember(m, lam, group, slot, w, hc, yc, total, cov, rhs, share, memory, vector)
        if released:
            variance_last = np.nan
        if status[e] >= S_HELD:
            time_last = time_s[e]
            variance_last = (row[COV] + row[COV + 1] + row[COV + 2]) / 3.0
            for r in range(3):
                b[r] = row[BX + r]
                b_last[r] = b[r]
        write_dops(m, design, variance, group, b, hc, yc, w, total, row)
    carried[N_SLOTS] = n_slots
    carried[WEIGHT] = weight
    carried[WINS] = wins
    carried[TIME] = time_before
    carried[HELD_PROBABILITY] = probability_held
    carried[ACCEPTED_TIME] = time_last
    carried[ACCEPTED_VARIANCE] = variance_last
    return counter[0]
