"""Compiled resolution of one baseline: from single differences of an epoch to validated integers.

Single differences between the receivers enter with one row per satellite and signal, in groups that
share a clock (system, band, tracking). Differencing against the group's reference satellite, its
first row, and eliminating the group's clock by weighted centring are the same adjustment; the code
uses whichever is shorter.

    y = H b + lambda N + clock_group + e,     H = -e_enu,    e ~ N(0, diag(variance))
"""

import numpy as np

from .constrained import eigen_symmetric_3, search_shell
from .jit import kernel
from .ldl import ldl_factor, reduce_

# Columns of the result row of one epoch.
BX, BY, BZ = 0, 1, 2
COV = 3  # xx, yy, zz, xy, xz, yz
LENGTH, LENGTH_SD = 9, 10
COST, SECOND_COST = 11, 12
RATIO, PROBABILITY = 13, 14
CHI2, CHI2_LIMIT = 15, 16
N_PHASES, N_SATS = 17, 18
PDOP, HDOP, VDOP, AZ_DOP, EL_DOP = 19, 20, 21, 22, 23
FLOAT_X, FLOAT_Y, FLOAT_Z = 24, 25, 26
NODES, FOUND = 27, 28
CHI2_DOF = 29
LENGTH_STATISTIC = 30
FLOAT_COV = 31  # xx, yy, zz, xy, xz, yz
N_COLUMNS = 37

# Reasons, equal to truenorth.errors.Reason (held equal by a test).
R_OK = 0
R_TOO_FEW_SATELLITES = 2
R_SEARCH_VOLUME_TOO_LARGE = 3
R_NO_CANDIDATE = 4
R_LENGTH_TEST = 5
R_RESIDUAL_TEST = 6
R_RATIO_TEST = 7
R_PROBABILITY_TEST = 8
R_SEARCH_LIMIT = 11
R_WEAK_GEOMETRY = 12
R_NO_CODE = 13

# Status, equal to truenorth.errors.Status.
S_NONE, S_FLOAT, S_HELD, S_FIXED = 0, 1, 2, 3


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
    inverse[1, 0] = inverse[0, 1]
    inverse[1, 1] = (a * f - c * c) / det
    inverse[1, 2] = (b * c - a * e) / det
    inverse[2, 0] = inverse[0, 2]
    inverse[2, 1] = inverse[1, 2]
    inverse[2, 2] = (a * d - b * b) / det
    return True


@kernel
def add_groups(first, last, y, design, variance, group, information, rhs):
    """Add the normal equations of rows first:last with one free clock per group.

    Adds to `information` (3, 3) and `rhs` (3,) and returns (sum of squares, degrees of freedom)
    where the sum is y' W y with the clocks eliminated.
    """
    square = 0.0
    dof = 0
    i = first
    while i < last:
        j = i
        weight = 0.0
        mean_y = 0.0
        m0 = 0.0
        m1 = 0.0
        m2 = 0.0
        while j < last and group[j] == group[i]:
            w = 1.0 / variance[j]
            weight += w
            mean_y += w * y[j]
            m0 += w * design[j, 0]
            m1 += w * design[j, 1]
            m2 += w * design[j, 2]
            j += 1
        if j - i >= 2:
            mean_y /= weight
            m0 /= weight
            m1 /= weight
            m2 /= weight
            for k in range(i, j):
                w = 1.0 / variance[k]
                h0 = design[k, 0] - m0
                h1 = design[k, 1] - m1
                h2 = design[k, 2] - m2
                r = y[k] - mean_y
                information[0, 0] += w * h0 * h0
                information[0, 1] += w * h0 * h1
                information[0, 2] += w * h0 * h2
                information[1, 1] += w * h1 * h1
                information[1, 2] += w * h1 * h2
                information[2, 2] += w * h2 * h2
                rhs[0] += w * h0 * r
                rhs[1] += w * h1 * r
                rhs[2] += w * h2 * r
                square += w * r * r
            dof += j - i - 1
        i = j
    information[1, 0] = information[0, 1]
    information[2, 0] = information[0, 2]
    information[2, 1] = information[1, 2]
    return square, dof


@kernel
def clock_residuals(first, last, y, design, variance, group, b, residual):
    """Residuals y - H b - clock of rows first:last, one weighted-mean clock per group.

    Returns the weighted sum of squares.
    """
    total = 0.0
    i = first
    while i < last:
        j = i
        weight = 0.0
        mean = 0.0
        while j < last and group[j] == group[i]:
            r = y[j] - design[j, 0] * b[0] - design[j, 1] * b[1] - design[j, 2] * b[2]
            residual[j] = r
            mean += r / variance[j]
            weight += 1.0 / variance[j]
            j += 1
        mean /= weight
        for k in range(i, j):
            residual[k] -= mean
            total += residual[k] * residual[k] / variance[k]
        i = j
    return total


@kernel
def resolve_integers(
    n, a_float, q_float, q_baseline, b_float, j_min, info_code, info_total, mu,
    length, length_variance, cap, margin, max_nodes,
    a_best, b_constrained, b_free, out,
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
    info_code : ndarray, shape (3, 3)
        Not used in the search; kept for the float covariance.
    info_total : ndarray, shape (3, 3)
        Information on the baseline once the integers are known, without `mu`.
    a_best : ndarray, shape (2, n)
        Output: the two best integer vectors.
    b_constrained, b_free : ndarray, shape (2, 3)
        Output: their baselines with and without the length.
    out : ndarray, shape (N_COLUMNS,)
        Costs, nodes and probability are written.

    Returns
    -------
    int
        Reason code; R_OK when at least one candidate was found.
    """
    information = np.empty(3)
    axes = np.empty((3, 3))
    eigen_symmetric_3(info_total, information, axes)
    if not information[0] > 1e-9 * information[2]:
        return R_WEAK_GEOMETRY
    lower = np.empty((n, n))
    diag = np.empty(n)
    z_transform = np.empty((n, n))
    back = np.empty((n, n))
    if ldl_factor(q_float, n, lower, diag) != 0:
        return R_WEAK_GEOMETRY
    reduce_(n, lower, diag, z_transform, back)

    # Work near zero: the large integer part of the float ambiguities stays outside.
    base = np.empty(n)
    rest = np.empty(n)
    for i in range(n):
        base[i] = np.floor(a_float[i] + 0.5)
        rest[i] = a_float[i] - base[i]
    z_float = np.zeros(n)
    cross = np.zeros((3, n))
    for i in range(n):
        for j in range(n):
            w = z_transform[j, i]
            if w != 0.0:
                z_float[i] += w * rest[j]
                for r in range(3):
                    cross[r, i] += q_baseline[r, j] * w
    # gain = cross Q_z^-1, row by row, then into the eigenframe.
    gain_enu = np.empty((3, n))
    work = np.empty(n)
    for r in range(3):
        for i in range(n - 1, -1, -1):
            value = cross[r, i]
            for j in range(i + 1, n):
                value -= lower[j, i] * work[j]
            work[i] = value
        for i in range(n):
            work[i] /= diag[i]
        for i in range(n):
            value = work[i]
            for j in range(i):
                value -= lower[i, j] * gain_enu[r, j]
            gain_enu[r, i] = value
    gain = np.empty((3, n))
    b_eigen = np.empty(3)
    for r in range(3):
        for i in range(n):
            gain[r, i] = (
                axes[0, r] * gain_enu[0, i] + axes[1, r] * gain_enu[1, i] + axes[2, r] * gain_enu[2, i]
            )
        b_eigen[r] = axes[0, r] * b_float[0] + axes[1, r] * b_float[1] + axes[2, r] * b_float[2]

    z_best = np.zeros((2, n))
    cost_best = np.empty(2)
    best_eigen = np.zeros((2, 3))
    free_eigen = np.zeros((2, 3))
    found, nodes, complete, log_mass = search_shell(
        n, lower, diag, z_float, gain, b_eigen, information, axes, mu, j_min,
        length, length_variance, cap, margin, max_nodes,
        z_best, cost_best, best_eigen, free_eigen,
        np.empty(n), np.empty(n), np.empty(n), np.empty(n + 1), np.empty((n, n)),
    )  # fmt: skip
    out[NODES] = nodes
    out[FOUND] = found
    if found == 0:
        return R_NO_CANDIDATE if complete == 1 else R_SEARCH_LIMIT
    out[COST] = cost_best[0]
    out[SECOND_COST] = cost_best[1]
    out[PROBABILITY] = np.exp(-log_mass)
    for c in range(min(found, 2)):
        for i in range(n):
            value = base[i]
            for j in range(n):
                value += back[i, j] * z_best[c, j]
            a_best[c, i] = np.floor(value + 0.5)
        for r in range(3):
            b_constrained[c, r] = (
                axes[r, 0] * best_eigen[c, 0] + axes[r, 1] * best_eigen[c, 1] + axes[r, 2] * best_eigen[c, 2]
            )
            b_free[c, r] = (
                axes[r, 0] * free_eigen[c, 0] + axes[r, 1] * free_eigen[c, 1] + axes[r, 2] * free_eigen[c, 2]
            )
    return R_OK if complete == 1 else R_SEARCH_LIMIT


@kernel
def geometry_dops(first, last, design, group, b, out):
    """DOPs of the double differences for unit undifferenced noise, and of the angles of b."""
    information = np.zeros((3, 3))
    rhs = np.zeros(3)
    # Single-difference variance 2 for unit undifferenced noise.
    y = np.zeros(last)
    variance = np.full(last, 2.0)
    add_groups(first, last, y, design, variance, group, information, rhs)
    q = np.empty((3, 3))
    if not invert_3(information, q):
        for k in range(PDOP, EL_DOP + 1):
            out[k] = np.nan
        return
    out[PDOP] = np.sqrt(q[0, 0] + q[1, 1] + q[2, 2])
    out[HDOP] = np.sqrt(q[0, 0] + q[1, 1])
    out[VDOP] = np.sqrt(q[2, 2])
    horizontal = np.hypot(b[0], b[1])
    norm = np.hypot(horizontal, b[2])
    if horizontal > 0.0:
        sa, ca = b[0] / horizontal, b[1] / horizontal
        se, ce = b[2] / norm, horizontal / norm
        g = np.empty(3)
        g[0], g[1], g[2] = ca / ce, -sa / ce, 0.0
        out[AZ_DOP] = np.sqrt(quadratic_3(q, g))
        g[0], g[1], g[2] = -se * sa, -se * ca, ce
        out[EL_DOP] = np.sqrt(quadratic_3(q, g))


@kernel
def quadratic_3(matrix, v):
    """v' M v for a symmetric 3 x 3 matrix."""
    total = 0.0
    for i in range(3):
        for j in range(3):
            total += v[i] * matrix[i, j] * v[j]
    return total


@kernel
def validate(
    first, last, y, design, wavelength, variance, group, n, integers, b_constrained, b_free, info_total,
    length, length_variance, adjust_with_length, check_length, length_tolerance_sd,
    chi2_limits, min_probability, min_ratio, max_ratio_mode, residual, ambiguity, out,
):  # fmt: skip
    """Tests of the winner: residuals, length, probability, ratio; fills the result row.

    `integers` holds the double-difference integers of the n non-reference rows in row order; they are
    spread to `ambiguity`, one per row, 0 for the reference rows. Returns the reason code.
    """
    work = np.empty(last)
    k = 0
    i = first
    while i < last:
        ambiguity[i] = 0.0
        work[i] = y[i]
        j = i + 1
        while j < last and group[j] == group[i]:
            ambiguity[j] = integers[k]
            work[j] = y[j] - wavelength[j] * integers[k]
            k += 1
            j += 1
        i = j
    b = b_constrained if adjust_with_length else b_free
    chi2 = clock_residuals(first, last, work, design, variance, group, b, residual)
    dof = n - 3
    out[BX], out[BY], out[BZ] = b[0], b[1], b[2]

    cov = np.empty((3, 3))
    invert_3(info_total, cov)
    measured = np.sqrt(b_free[0] ** 2 + b_free[1] ** 2 + b_free[2] ** 2)
    u = b_free / measured
    length_sd = np.sqrt(quadratic_3(cov, u))
    out[LENGTH] = measured
    out[LENGTH_SD] = length_sd
    if adjust_with_length:
        size = np.sqrt(b[0] ** 2 + b[1] ** 2 + b[2] ** 2)
        u = b / size
        # The floor keeps an exactly known length invertible: a tenth of a micrometre.
        weight = 1.0 / max(length_variance, 1e-14)
        conditioned = info_total.copy()
        # Curvature of the sphere: the multiplier stiffens the tangent plane.
        nu = (size - length) / (max(length_variance, 1e-14) * size)
        for r in range(3):
            for c in range(3):
                conditioned[r, c] += (weight - nu) * u[r] * u[c]
            conditioned[r, r] += nu
        if not invert_3(conditioned, cov):
            invert_3(info_total, cov)
        chi2 += (size - length) ** 2 * weight if length_variance > 0.0 else 0.0
        dof += 1
    out[COV], out[COV + 1], out[COV + 2] = cov[0, 0], cov[1, 1], cov[2, 2]
    out[COV + 3], out[COV + 4], out[COV + 5] = cov[0, 1], cov[0, 2], cov[1, 2]
    out[CHI2] = chi2
    out[CHI2_DOF] = dof
    out[CHI2_LIMIT] = chi2_limits[min(dof, len(chi2_limits) - 1)] if dof > 0 else np.nan
    out[RATIO] = out[SECOND_COST] / out[COST] if out[SECOND_COST] < np.inf else np.nan
    if out[RATIO] > 999.9:
        out[RATIO] = 999.9
    statistic = np.nan
    if length == length:
        statistic = abs(measured - length) / np.sqrt(length_sd * length_sd + length_variance)
    out[LENGTH_STATISTIC] = statistic
    if dof > 0 and chi2 > out[CHI2_LIMIT]:
        return R_RESIDUAL_TEST
    if check_length and statistic > length_tolerance_sd:
        return R_LENGTH_TEST
    if not out[PROBABILITY] >= min_probability:
        return R_PROBABILITY_TEST
    # A single candidate inside the margin has no rival: the ratio then is not computable but huge.
    if max_ratio_mode == 1 and out[RATIO] < min_ratio:
        return R_RATIO_TEST
    if max_ratio_mode == 2 and out[SECOND_COST] - out[COST] < min_ratio:
        return R_RATIO_TEST
    return R_OK


@kernel
def float_ambiguities(m, n, y, design, wavelength, variance, group, q_b, b_float, a_float, q_a, q_ba):
    """Float double-difference ambiguities and covariances, given the baseline and its covariance."""
    h = np.empty((n, 3))
    lam = np.empty(n)
    owner = np.empty(n, np.int64)
    own = np.empty(n)
    k = 0
    i = 0
    while i < m:
        j = i + 1
        while j < m and group[j] == group[i]:
            lam[k] = wavelength[j]
            owner[k] = i
            own[k] = variance[j]
            value = y[j] - y[i]
            for r in range(3):
                h[k, r] = design[j, r] - design[i, r]
                value -= h[k, r] * b_float[r]
            a_float[k] = value / lam[k]
            k += 1
            j += 1
        i = j
    for k in range(n):
        for r in range(3):
            q_ba[r, k] = -(q_b[r, 0] * h[k, 0] + q_b[r, 1] * h[k, 1] + q_b[r, 2] * h[k, 2]) / lam[k]
        for j in range(k + 1):
            value = -(q_ba[0, k] * h[j, 0] + q_ba[1, k] * h[j, 1] + q_ba[2, k] * h[j, 2]) * lam[k]
            if owner[j] == owner[k]:
                value += variance[owner[k]]
            if j == k:
                value += own[k]
            q_a[k, j] = value / (lam[k] * lam[j])
            q_a[j, k] = q_a[k, j]


@kernel
def worst_row(m, residual, design, variance, group, information):
    """Row with the largest normalised residual |r_i| / sd(r_i); returns (row, that number).

    The variance of a residual is what is left of the observation's after the clock of its group and
    the baseline took their part.
    """
    q = np.empty((3, 3))
    best = -1
    largest = 0.0
    if not invert_3(information, q):
        return best, largest
    h = np.empty(3)
    i = 0
    while i < m:
        j = i
        total = 0.0
        mean = np.zeros(3)
        while j < m and group[j] == group[i]:
            total += 1.0 / variance[j]
            for r in range(3):
                mean[r] += design[j, r] / variance[j]
            j += 1
        for k in range(i, j):
            for r in range(3):
                h[r] = design[k, r] - mean[r] / total
            left = variance[k] - 1.0 / total - quadratic_3(q, h)
            if left > 0.02 * variance[k]:
                size = abs(residual[k]) / np.sqrt(left)
                if size > largest:
                    largest = size
                    best = k
        i = j
    return best, largest


@kernel
def solve_single_epochs(
    phase_start, phase_y, phase_design, wavelength, phase_variance, phase_group,
    code_start, code_y, code_design, code_variance, code_group,
    prior_information, prior_rhs,
    length, length_variance, use_length_in_search, check_length, length_tolerance_sd, kappa,
    cap_factor, margin, max_nodes, chi2_limits, min_probability, ratio_mode, min_ratio, max_exclusions,
    residual, ambiguity, excluded, out, status, reason,
):  # fmt: skip
    """Resolve every epoch by itself; results in `out` (n_epochs, N_COLUMNS), `status`, `reason`.

    When the residuals of the winner are too large and enough satellites remain, the row with the
    largest normalised residual is excluded and the epoch resolved anew, `max_exclusions` times at most;
    `excluded` holds its normalised residual.
    """
    n_epochs = len(phase_start) - 1
    info_code = np.empty((3, 3))
    info_mu = np.empty((3, 3))
    info_total = np.empty((3, 3))
    rhs = np.empty(3)
    dummy = np.empty(3)
    q_b = np.empty((3, 3))
    b_code = np.empty(3)
    b_float = np.empty(3)
    b_con = np.empty((2, 3))
    b_free = np.empty((2, 3))
    mu = 0.0
    if use_length_in_search:
        mu = kappa / (length * length + kappa * length_variance)
    for e in range(n_epochs):
        first, last = phase_start[e], phase_start[e + 1]
        m = last - first
        row = out[e]
        for k in range(N_COLUMNS):
            row[k] = np.nan
        status[e] = S_NONE
        # The epoch's phases, from which rows may be struck.
        index = np.empty(m, np.int64)
        y = np.empty(m)
        design = np.empty((m, 3))
        lam = np.empty(m)
        variance = np.empty(m)
        group = np.empty(m, np.int64)
        for i in range(m):
            k = first + i
            index[i] = k
            y[i] = phase_y[k]
            lam[i] = wavelength[k]
            variance[i] = phase_variance[k]
            group[i] = phase_group[k]
            for r in range(3):
                design[i, r] = phase_design[k, r]
        res = np.empty(m)
        amb = np.empty(m)
        # Code and prior information on the baseline.
        for r in range(3):
            rhs[r] = prior_rhs[r]
            for c in range(3):
                info_code[r, c] = prior_information[r, c]
        square, code_dof = add_groups(
            code_start[e], code_start[e + 1], code_y, code_design, code_variance, code_group, info_code, rhs
        )
        if invert_3(info_code, q_b):
            for r in range(3):
                b_code[r] = q_b[r, 0] * rhs[0] + q_b[r, 1] * rhs[1] + q_b[r, 2] * rhs[2]
                row[FLOAT_X + r] = b_code[r]
            row[FLOAT_COV], row[FLOAT_COV + 1], row[FLOAT_COV + 2] = q_b[0, 0], q_b[1, 1], q_b[2, 2]
            row[FLOAT_COV + 3], row[FLOAT_COV + 4], row[FLOAT_COV + 5] = q_b[0, 1], q_b[0, 2], q_b[1, 2]
            status[e] = S_FLOAT
            geometry_dops(0, m, design, group, b_code, row)
        for r in range(3):
            for c in range(3):
                info_mu[r, c] = info_code[r, c]
            info_mu[r, r] += mu
        searchable = invert_3(info_mu, q_b)
        j_min = square
        for r in range(3):
            b_float[r] = q_b[r, 0] * rhs[0] + q_b[r, 1] * rhs[1] + q_b[r, 2] * rhs[2]
        for r in range(3):
            j_min -= rhs[r] * b_float[r]

        for attempt in range(max_exclusions + 1):
            n = 0
            for i in range(1, m):
                if group[i] == group[i - 1]:
                    n += 1
            row[N_PHASES] = n
            if n < 3:
                reason[e] = R_TOO_FEW_SATELLITES
                break
            if not searchable:
                reason[e] = R_NO_CODE
                break
            for r in range(3):
                dummy[r] = 0.0
                for c in range(3):
                    info_total[r, c] = info_code[r, c]
            add_groups(0, m, y, design, variance, group, info_total, dummy)
            a_float = np.empty(n)
            q_a = np.empty((n, n))
            q_ba = np.empty((3, n))
            float_ambiguities(m, n, y, design, lam, variance, group, q_b, b_float, a_float, q_a, q_ba)
            constraint = length if use_length_in_search else np.nan
            dof = n + code_dof - 2 if use_length_in_search else n + code_dof - 3
            cap = cap_factor * chi2_limits[min(max(dof, 1), len(chi2_limits) - 1)] + margin
            a_best = np.empty((2, n))
            code = resolve_integers(
                n, a_float, q_a, q_ba, b_float, j_min, info_code, info_total, mu,
                constraint, length_variance, cap, margin, max_nodes, a_best, b_con, b_free, row,
            )  # fmt: skip
            if not row[FOUND] > 0:
                reason[e] = code
                break
            verdict = validate(
                0, m, y, design, lam, variance, group, n, a_best[0], b_con[0], b_free[0], info_total,
                length, length_variance, use_length_in_search, check_length, length_tolerance_sd,
                chi2_limits, min_probability, min_ratio, ratio_mode, res, amb, row,
            )  # fmt: skip
            geometry_dops(0, m, design, group, b_free[0], row)
            reason[e] = verdict if code == R_OK else code
            if reason[e] == R_OK:
                status[e] = S_FIXED
            if verdict != R_RESIDUAL_TEST or attempt == max_exclusions or n < 6:
                break
            worst, size = worst_row(m, res, design, variance, group, info_total)
            if worst < 0:
                break
            excluded[index[worst]] = size
            for i in range(worst, m - 1):
                index[i] = index[i + 1]
                y[i] = y[i + 1]
                lam[i] = lam[i + 1]
                variance[i] = variance[i + 1]
                group[i] = group[i + 1]
                for r in range(3):
                    design[i, r] = design[i + 1, r]
            m -= 1
        for i in range(first, last):
            residual[i] = np.nan
            ambiguity[i] = np.nan
        if row[FOUND] > 0:
            for i in range(m):
                residual[index[i]] = res[i]
                ambiguity[index[i]] = amb[i]
