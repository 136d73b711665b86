"""Compiled adjustment of one epoch of all antennas of a rigid array.

Rows are undifferenced phases of one antenna, satellite and signal, sorted by group, satellite, antenna:

    y = h . b_a + c_s + t_ag + noise,      b_a = R l_a,      h = -e

The constant c_s of a satellite and signal is eliminated by centring its rows, the clock t_ag of an antenna in
a group by a Cholesky factor for each group; what remains is

    f(b) = b' P b - 2 g' b + q

for the stacked vectors b of all antennas, with the full covariance of all double differences. It has no
reference: P is blind to a common shift, and the vectors from one antenna to the others follow when its block
is struck out. Uncertain body coordinates l_a + d_a, d ~ N(0, s^2), are eliminated likewise.

The rotation minimises f over R: Gauss-Newton steps p with R <- exp([p]x) R.

References: Teunissen 2012 (J. Geodesy 86, the affine model); Giorgi et al. 2012 (J. Guidance 35).
"""

import numpy as np

from .jit import kernel

MAX_STEPS = 30


@kernel
def factor_with_gaps(a, n):
    """Cholesky factor of the positive semidefinite a[:n, :n] in place; null pivots leave rows of zeros.

    Returns the rank. A null pivot is a direction that no observation sees: it is kept at zero.
    """
    rank = 0
    for j in range(n):
        scale = a[j, j]
        pivot = scale
        for k in range(j):
            pivot -= a[j, k] * a[j, k]
        if pivot > 1e-10 * scale and pivot > 0.0:
            rank += 1
            root = np.sqrt(pivot)
            a[j, j] = root
            for i in range(j + 1, n):
                value = a[i, j]
                for k in range(j):
                    value -= a[i, k] * a[j, k]
                a[i, j] = value / root
        else:
            a[j, j] = 0.0
            for i in range(j + 1, n):
                a[i, j] = 0.0
    return rank


@kernel
def forward_with_gaps(factor, n, x):
    """Solve L x = x in place for a factor of `factor_with_gaps`."""
    for i in range(n):
        if factor[i, i] > 0.0:
            value = x[i]
            for k in range(i):
                value -= factor[i, k] * x[k]
            x[i] = value / factor[i, i]
        else:
            x[i] = 0.0


@kernel
def backward_with_gaps(factor, n, x):
    """Solve L' x = x in place for a factor of `factor_with_gaps`."""
    for i in range(n - 1, -1, -1):
        if factor[i, i] > 0.0:
            value = x[i]
            for k in range(i + 1, n):
                value -= factor[k, i] * x[k]
            x[i] = value / factor[i, i]
        else:
            x[i] = 0.0


@kernel
def centre_clocks(first, last, antenna, satellite, y, w, n_antennas, factor, sums):
    """Take the clocks out of the rows of a group as if all antennas stood at one point."""
    # Twice: the second time the numbers are small enough to keep their digits.
    for _ in range(2):
        for a in range(n_antennas):
            sums[a] = 0.0
            for b in range(n_antennas):
                factor[a, b] = 0.0
        i = first
        while i < last:
            j = i
            total = 0.0
            mean = 0.0
            while j < last and satellite[j] == satellite[i]:
                if w[j] > 0.0:
                    total += w[j]
                    mean += w[j] * y[j]
                j += 1
            if total > 0.0:
                mean /= total
                for k in range(i, j):
                    if w[k] > 0.0:
                        a = antenna[k]
                        sums[a] += w[k] * (y[k] - mean)
                        factor[a, a] += w[k]
                        for q in range(i, j):
                            if w[q] > 0.0:
                                factor[a, antenna[q]] -= w[k] * w[q] / total
            i = j
        factor_with_gaps(factor, n_antennas)
        forward_with_gaps(factor, n_antennas, sums)
        backward_with_gaps(factor, n_antennas, sums)
        for k in range(first, last):
            y[k] -= sums[antenna[k]]


@kernel
def reduce_rows(
    n, antenna, satellite, group, y, w, design, n_antennas, information, rhs, factor, cross, right
):  # fmt: skip
    """Normal equations of the stacked vectors, satellites and clocks eliminated.

    Parameters
    ----------
    n, n_antennas : int
        Rows and antennas.
    antenna, satellite, group : ndarray of int64, shape (n,)
        Rows of a satellite and of a group are neighbours; groups count from 0.
    y, w : ndarray, shape (n,)
        Phases with known integers, metres, and weights; a row of weight 0 does not count. On return y is
        less the clocks of a platform of no size: hundreds of kilometres would cost the digits of q.
    design : ndarray, shape (n, 3)
        h.
    information, rhs : ndarray, shapes (3 m, 3 m), (3 m,)
        Outputs P and g.
    factor, cross, right : ndarray, shapes (groups, m, m), (groups, 3 m, m), (groups, m)
        Outputs: of each group the factor of its clocks' information, their information with the vectors,
        and their right side.

    Returns
    -------
    square : float
        q.
    redundancy : int
        Double differences: rows beyond the constants of satellites and clocks.
    """
    m3 = 3 * n_antennas
    for i in range(m3):
        rhs[i] = 0.0
        for j in range(m3):
            information[i, j] = 0.0
    square = 0.0
    redundancy = 0
    x = np.empty(n_antennas)
    sums = np.empty(n_antennas)
    # No literal: a kernel is compiled anew for each literal it is called with.
    i = np.int64(0)
    while i < n:
        g = group[i]
        for a in range(n_antennas):
            right[g, a] = 0.0
            for b in range(n_antennas):
                factor[g, a, b] = 0.0
            for r in range(m3):
                cross[g, r, a] = 0.0
        last = i
        while last < n and group[last] == g:
            last += 1
        centre_clocks(i, last, antenna, satellite, y, w, n_antennas, factor[g], sums)
        for a in range(n_antennas):
            for b in range(n_antennas):
                factor[g, a, b] = 0.0
        while i < last:
            j = i
            total = 0.0
            mean = 0.0
            count = 0
            while j < n and satellite[j] == satellite[i]:
                if w[j] > 0.0:
                    total += w[j]
                    mean += w[j] * y[j]
                    count += 1
                j += 1
            if count > 1:
                redundancy += count - 1
                mean /= total
                for k in range(i, j):
                    if not w[k] > 0.0:
                        continue
                    a = antenna[k]
                    gap = y[k] - mean
                    square += w[k] * gap * gap
                    right[g, a] += w[k] * gap
                    for r in range(3):
                        rhs[3 * a + r] += design[k, r] * w[k] * gap
                    for q in range(i, j):
                        if not w[q] > 0.0:
                            continue
                        b = antenna[q]
                        share = -w[k] * w[q] / total
                        if q == k:
                            share += w[k]
                        factor[g, a, b] += share
                        for r in range(3):
                            along = design[k, r] * share
                            cross[g, 3 * a + r, b] += along
                            for c in range(3):
                                information[3 * a + r, 3 * b + c] += along * design[k, c]
            i = j
        redundancy -= factor_with_gaps(factor[g], n_antennas)
        # Rows of `cross` whitened by the clocks: what is eliminated is their product.
        for r in range(m3):
            forward_with_gaps(factor[g], n_antennas, cross[g, r])
        for a in range(n_antennas):
            x[a] = right[g, a]
        forward_with_gaps(factor[g], n_antennas, x)
        for a in range(n_antennas):
            right[g, a] = x[a]
            square -= x[a] * x[a]
        for r in range(m3):
            for a in range(n_antennas):
                rhs[r] -= cross[g, r, a] * x[a]
            for c in range(r + 1):
                value = 0.0
                for a in range(n_antennas):
                    value += cross[g, r, a] * cross[g, c, a]
                information[r, c] -= value
                if c < r:
                    information[c, r] -= value
    return square, redundancy


@kernel
def strike_reference(information, rhs, active, reference, small, small_rhs):
    """Normal equations of the vectors from the antenna `reference` to the other active ones.

    `active` (n_antennas,) is 1 where an antenna takes part. Writes the small system and returns the number of
    vectors.
    """
    k = 0
    for a in range(len(active)):
        if active[a] == 0 or a == reference:
            continue
        q = 0
        for b in range(len(active)):
            if active[b] == 0 or b == reference:
                continue
            for r in range(3):
                for c in range(3):
                    small[3 * k + r, 3 * q + c] = information[3 * a + r, 3 * b + c]
            q += 1
        for r in range(3):
            small_rhs[3 * k + r] = rhs[3 * a + r]
        k += 1
    return k


@kernel
def soften(k, small, small_rhs, square, variance, factor, work):
    """Eliminate the errors of body coordinates, independent with `variance` each; returns the new q.

    With L = Q_d^-1, Q_d = variance (I + 11') of the vectors that share their reference:
    P <- P - P (P + L)^-1 P, g <- g - P (P + L)^-1 g. `factor` keeps the Cholesky factor of P + L, `work`
    (3 k + 1, 3 k) is overwritten.
    """
    n = 3 * k
    for i in range(n):
        for j in range(n):
            value = small[i, j]
            if i % 3 == j % 3:
                value -= 1.0 / (variance * (k + 1))
                if i == j:
                    value += 1.0 / variance
            factor[i, j] = value
            work[i, j] = small[i, j]
        work[n, i] = small_rhs[i]
    factor_with_gaps(factor, n)
    for i in range(n + 1):
        forward_with_gaps(factor, n, work[i])
    for i in range(n):
        for j in range(n):
            value = 0.0
            for r in range(n):
                value += work[i, r] * work[j, r]
            small[i, j] -= value
        value = 0.0
        for r in range(n):
            value += work[i, r] * work[n, r]
        small_rhs[i] -= value
    for r in range(n):
        square -= work[n, r] * work[n, r]
    return square


@kernel
def turn(rot, p):
    """Turn the rotation by a small vector in the navigation frame: rot <- exp([p]x) rot."""
    angle = np.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
    if angle < 1e-8:
        s = 1.0
        c = 0.5
    else:
        s = np.sin(angle) / angle
        c = (1.0 - np.cos(angle)) / (angle * angle)
    for j in range(3):
        x, y, z = rot[0, j], rot[1, j], rot[2, j]
        dot = p[0] * x + p[1] * y + p[2] * z
        square = p[0] * p[0] + p[1] * p[1] + p[2] * p[2]
        # v + s p x v + c p x (p x v)
        rot[0, j] = x + s * (p[1] * z - p[2] * y) + c * (p[0] * dot - x * square)
        rot[1, j] = y + s * (p[2] * x - p[0] * z) + c * (p[1] * dot - y * square)
        rot[2, j] = z + s * (p[0] * y - p[1] * x) + c * (p[2] * dot - z * square)


@kernel
def straighten(rot):
    """Make the columns orthonormal again after many turns."""
    for j in range(3):
        for q in range(min(j, 2)):
            dot = 0.0
            for r in range(3):
                dot += rot[r, j] * rot[r, q]
            for r in range(3):
                rot[r, j] -= dot * rot[r, q]
        if j == 2:
            rot[0, 2] = rot[1, 0] * rot[2, 1] - rot[2, 0] * rot[1, 1]
            rot[1, 2] = rot[2, 0] * rot[0, 1] - rot[0, 0] * rot[2, 1]
            rot[2, 2] = rot[0, 0] * rot[1, 1] - rot[1, 0] * rot[0, 1]
        else:
            norm = np.sqrt(rot[0, j] ** 2 + rot[1, j] ** 2 + rot[2, j] ** 2)
            for r in range(3):
                rot[r, j] /= norm


@kernel
def solve_3(matrix, rhs, x, inverse):
    """Solve a symmetric positive definite 3 x 3 system; False where it is none. Writes the inverse too."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    d, e, f = matrix[1, 1], matrix[1, 2], matrix[2, 2]
    c00 = d * f - e * e
    c01 = c * e - b * f
    c02 = b * e - c * d
    det = a * c00 + b * c01 + c * c02
    if not (a > 0.0 and d > 0.0 and f > 0.0 and det > 1e-13 * a * d * f):
        return False
    inverse[0, 0] = c00 / det
    inverse[0, 1] = c01 / det
    inverse[0, 2] = c02 / det
    inverse[1, 1] = (a * f - c * c) / det
    inverse[1, 2] = (b * c - a * e) / det
    inverse[2, 2] = (a * d - b * b) / det
    inverse[1, 0] = inverse[0, 1]
    inverse[2, 0] = inverse[0, 2]
    inverse[2, 1] = inverse[1, 2]
    for i in range(3):
        x[i] = inverse[i, 0] * rhs[0] + inverse[i, 1] * rhs[1] + inverse[i, 2] * rhs[2]
    return True


@kernel
def fit_rotation(k, small, small_rhs, square, body, axis_body, is_line, rot, normal, cov, vector):
    """Rotation that fits the normal equations of k vectors best, from the start that `rot` holds.

    Parameters
    ----------
    k : int
        Vectors.
    small, small_rhs, square : ndarray, ndarray, float
        P, g, q.
    body : ndarray, shape (k, 3)
        The vectors in the body frame.
    axis_body, is_line : ndarray, shape (3,), bool
        Antennas on one line along `axis_body`: the rotation about it stays as it is.
    rot, normal, cov : ndarray, shape (3, 3)
        In and output: the rotation; outputs: normal matrix and covariance of its small turn.
    vector : ndarray, shape (3 k,)
        Output: the fitted vectors.

    Returns
    -------
    float
        f at the minimum; NaN where the observations do not determine the rotation.
    """
    n = 3 * k
    gradient = np.empty(n)
    lever = np.empty((n, 3))
    half = np.empty((n, 3))
    right = np.empty(3)
    step = np.empty(3)
    axis = np.empty(3)
    damped = np.empty((3, 3))
    found = np.nan
    damping = 0.0
    retreats = False
    for _ in range(MAX_STEPS):
        for i in range(k):
            x, y, z = body[i, 0], body[i, 1], body[i, 2]
            for r in range(3):
                vector[3 * i + r] = rot[r, 0] * x + rot[r, 1] * y + rot[r, 2] * z
            bx, by, bz = vector[3 * i], vector[3 * i + 1], vector[3 * i + 2]
            # d(exp([p]x) b) / dp = -[b]x
            lever[3 * i, 0] = 0.0
            lever[3 * i, 1] = bz
            lever[3 * i, 2] = -by
            lever[3 * i + 1, 0] = -bz
            lever[3 * i + 1, 1] = 0.0
            lever[3 * i + 1, 2] = bx
            lever[3 * i + 2, 0] = by
            lever[3 * i + 2, 1] = -bx
            lever[3 * i + 2, 2] = 0.0
        cost = square
        size = abs(square)
        for i in range(n):
            value = 0.0
            for j in range(n):
                value += small[i, j] * vector[j]
            gradient[i] = small_rhs[i] - value
            cost -= vector[i] * (gradient[i] + small_rhs[i])
            size += abs(vector[i] * small_rhs[i])
        # The cost is a small difference of large numbers: what is within their rounding is no rise.
        if found == found and cost > found + 1e-9 * (1.0 + abs(found)) + 1e-13 * size:
            # Too long a step: back, and shorter from there.
            for r in range(3):
                step[r] = -step[r]
            turn(rot, step)
            damping = max(10.0 * damping, 0.1)
            retreats = True
            continue
        if not retreats:
            damping = 0.1 * damping if damping > 1e-3 else 0.0
        retreats = False
        found = cost
        for i in range(n):
            for c in range(3):
                value = 0.0
                for j in range(n):
                    value += small[i, j] * lever[j, c]
                half[i, c] = value
        for r in range(3):
            right[r] = 0.0
            for i in range(n):
                right[r] += lever[i, r] * gradient[i]
            for c in range(3):
                value = 0.0
                for i in range(n):
                    value += lever[i, r] * half[i, c]
                normal[r, c] = value
        trace = normal[0, 0] + normal[1, 1] + normal[2, 2]
        if is_line:
            for r in range(3):
                axis[r] = rot[r, 0] * axis_body[0] + rot[r, 1] * axis_body[1] + rot[r, 2] * axis_body[2]
            for r in range(3):
                for c in range(3):
                    normal[r, c] += trace * axis[r] * axis[c]
        for r in range(3):
            for c in range(3):
                damped[r, c] = normal[r, c]
            damped[r, r] += damping * trace
        if not solve_3(damped, right, step, cov):
            return np.nan
        turn(rot, step)
        if step[0] * step[0] + step[1] * step[1] + step[2] * step[2] < 1e-20:
            break
    straighten(rot)
    # Damping shortens steps; it is no information.
    if damping > 0.0 and not solve_3(normal, right, step, cov):
        return np.nan
    return found


@kernel
def start_rotation(k, vector, body, is_line, axis_body, rot):
    """Rotation by two measured vectors (TRIAD), or one with roll 0 along a line of antennas.

    The longest vector and the one furthest from its line. Returns False where they are no frame.
    """
    first = 0
    longest = 0.0
    for i in range(k):
        size = body[i, 0] ** 2 + body[i, 1] ** 2 + body[i, 2] ** 2
        if size > longest:
            longest = size
            first = i
    frame = np.empty((2, 3, 3))
    if is_line:
        x = 0.0
        y = 0.0
        z = 0.0
        for i in range(k):
            along = body[i, 0] * axis_body[0] + body[i, 1] * axis_body[1] + body[i, 2] * axis_body[2]
            x += along * vector[3 * i]
            y += along * vector[3 * i + 1]
            z += along * vector[3 * i + 2]
        flat = np.sqrt(x * x + y * y)
        norm = np.sqrt(flat * flat + z * z)
        if not flat > 0.0:
            return False
        # Columns of the frame: along, level to the right, down.
        for q in range(2):
            if q == 1:
                x, y, z = axis_body[0], axis_body[1], axis_body[2]
                flat = np.sqrt(x * x + y * y)
                norm = 1.0
                if not flat > 0.0:
                    return False
            frame[q, 0, 0] = x / norm
            frame[q, 1, 0] = y / norm
            frame[q, 2, 0] = z / norm
            frame[q, 0, 1] = -y / flat
            frame[q, 1, 1] = x / flat
            frame[q, 2, 1] = 0.0
    else:
        second = -1
        widest = 0.0
        for i in range(k):
            cx = body[first, 1] * body[i, 2] - body[first, 2] * body[i, 1]
            cy = body[first, 2] * body[i, 0] - body[first, 0] * body[i, 2]
            cz = body[first, 0] * body[i, 1] - body[first, 1] * body[i, 0]
            size = cx * cx + cy * cy + cz * cz
            if size > widest:
                widest = size
                second = i
        if second < 0:
            return False
        for q in range(2):
            for r in range(3):
                frame[q, r, 0] = vector[3 * first + r] if q == 0 else body[first, r]
                frame[q, r, 1] = vector[3 * second + r] if q == 0 else body[second, r]
            norm = np.sqrt(frame[q, 0, 0] ** 2 + frame[q, 1, 0] ** 2 + frame[q, 2, 0] ** 2)
            if not norm > 0.0:
                return False
            dot = 0.0
            for r in range(3):
                frame[q, r, 0] /= norm
                dot += frame[q, r, 0] * frame[q, r, 1]
            norm = 0.0
            for r in range(3):
                frame[q, r, 1] -= dot * frame[q, r, 0]
                norm += frame[q, r, 1] ** 2
            if not norm > 0.0:
                return False
            for r in range(3):
                frame[q, r, 1] /= np.sqrt(norm)
    for q in range(2):
        for r in range(3):
            u, v = (r + 1) % 3, (r + 2) % 3
            frame[q, r, 2] = frame[q, u, 0] * frame[q, v, 1] - frame[q, v, 0] * frame[q, u, 1]
    for r in range(3):
        for c in range(3):
            rot[r, c] = (
                frame[0, r, 0] * frame[1, c, 0]
                + frame[0, r, 1] * frame[1, c, 1]
                + frame[0, r, 2] * frame[1, c, 2]
            )
    return True


@kernel
def row_residuals(
    n, antenna, satellite, group, y, w, design, n_antennas, stacked, factor, cross, right, shift, residual
):  # fmt: skip
    """Residuals of all rows at the stacked vectors; rows of weight 0 get what they would have.

    Parameters
    ----------
    n, antenna, satellite, group, y, w, design, n_antennas, factor, cross, right
        As of `reduce_rows`, after it.
    stacked : ndarray, shape (3 m,)
        Vector of every antenna from a common point.
    shift : ndarray, shape (n,)
        Output: number of rows of weight that the row's satellite (hundreds) and its clock (ones) have apart
        from this one; a residual of a row of weight 0 means something where both are positive.
    residual : ndarray, shape (n,)
        Output, metres.
    """
    m3 = 3 * n_antennas
    clock = np.empty(n_antennas)
    uses = np.empty(n_antennas)
    i = 0
    while i < n:
        g = group[i]
        for a in range(n_antennas):
            value = right[g, a]
            for r in range(m3):
                value -= cross[g, r, a] * stacked[r]
            clock[a] = value
            uses[a] = 0.0
        backward_with_gaps(factor[g], n_antennas, clock)
        first = i
        while i < n and group[i] == g:
            if w[i] > 0.0:
                uses[antenna[i]] += 1.0
            i += 1
        j = first
        while j < i:
            k = j
            total = 0.0
            mean = 0.0
            count = 0.0
            while k < i and satellite[k] == satellite[j]:
                a = antenna[k]
                value = y[k] - clock[a]
                for r in range(3):
                    value -= design[k, r] * stacked[3 * a + r]
                residual[k] = value
                if w[k] > 0.0:
                    total += w[k]
                    mean += w[k] * value
                    count += 1.0
                k += 1
            for q in range(j, k):
                own = 1.0 if w[q] > 0.0 else 0.0
                if total > 0.0:
                    residual[q] -= mean / total
                shift[q] = 100.0 * (count - own) + min(uses[antenna[q]] - own, 99.0)
            j = k


@kernel
def row_redundancy(
    n_antennas, antenna, w, design, total, row, first, last, factor, cross, lever, normal_inverse, rows
):  # fmt: skip
    """Information that is left of one row after satellites, clocks and the rotation took their part.

    `first:last` are the rows of its satellite, `total` their weight; `lever` (3 m, 3) turns a small rotation
    into the stacked vectors. The normalised residual of the row is w v / sqrt(this) (Baarda 1968).
    """
    a = antenna[row]
    x = rows
    own = w[row] - w[row] * w[row] / total
    for b in range(n_antennas):
        x[b] = 0.0
    for q in range(first, last):
        if w[q] > 0.0:
            x[antenna[q]] -= w[row] * w[q] / total
    x[a] += w[row]
    turn_x = 0.0
    turn_y = 0.0
    turn_z = 0.0
    for b in range(n_antennas):
        if x[b] == 0.0:
            continue
        for r in range(3):
            weight = design[row, r] * x[b]
            turn_x += lever[3 * b + r, 0] * weight
            turn_y += lever[3 * b + r, 1] * weight
            turn_z += lever[3 * b + r, 2] * weight
    forward_with_gaps(factor, n_antennas, x)
    for b in range(n_antennas):
        own -= x[b] * x[b]
    for r in range(3 * n_antennas):
        value = 0.0
        for b in range(n_antennas):
            value += cross[r, b] * x[b]
        turn_x -= lever[r, 0] * value
        turn_y -= lever[r, 1] * value
        turn_z -= lever[r, 2] * value
    n = normal_inverse
    return own - (
        n[0, 0] * turn_x * turn_x
        + n[1, 1] * turn_y * turn_y
        + n[2, 2] * turn_z * turn_z
        + 2.0 * (n[0, 1] * turn_x * turn_y + n[0, 2] * turn_x * turn_z + n[1, 2] * turn_y * turn_z)
    )
