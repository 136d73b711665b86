r"""Compiled search for the integers of a rigid array, all baselines at once on the rotation group.

Objective of the integers N of one epoch (Teunissen 2012; Giorgi et al. 2012), every satellite constant and
every clock eliminated, with the attitude R, the body coordinates l_k from the reference antenna and x the
phases less their integers:

    C(N) = min over R in SO(3) of |x - D vec(R L)|^2 + the same for code, less the least of code alone

Lists and joins. What a subset of the antennas measured costs never more than the whole,
|v|^2_Q >= |v_S|^2_(Q_SS), so a candidate of the array that costs no more than a bound is, baseline by
baseline, in the list of those that cost no more by themselves. Each list is enumerated by a tree with the
length in its bound; the lists are joined baseline by baseline, each join keeping what costs no more than the
bound with the rotation known to be one.

Cheap tests. With the orthonormal body frame u_c of the antennas so far and X = (R u_1, ..),

    C(N, R) = c_0(N) + (X - X_0(N))' A (X - X_0(N)),     A the same for all candidates,

so X lies in an ellipsoid of size tau = bound - c_0 around X_0, and for every symmetric product of its columns

    |x_c . x_d - (c = d)| = 0  within  sqrt(tau g' A^-1 g) + tau |A^-1|,     g the gradient at X_0.

Only candidates that pass are adjusted, from the nearest rotation by Newton steps on the group. Where one
direction is weak, the mirror image through it is a second start and both attitudes count.

The pseudo-observation mu (|X|^2 - rank) = 0 added to C changes no value on the group and makes A regular.
"""

import numpy as np

from .constrained import eigen_symmetric_3, nearest_on_shell
from .ils import enumerate_within
from .jit import kernel
from .ldl import decorrelate

R_OK, R_TOO_FEW_SATELLITES, R_NO_CANDIDATE, R_SEARCH_LIMIT, R_WEAK_GEOMETRY = 0, 2, 4, 11, 12
"""Reason codes, equal to `errors.Reason`."""

COST = 0
SECOND_COST = 1
PROBABILITY = 2
ATTITUDE_SHARE = 3
DOF = 4
N_CANDIDATES = 5
N_NODES = 6
COMPLETE_TO = 7
RANK = 8
N_INTEGERS = 9
REFERENCE = 10
N_LISTED = 11
N_COLUMNS = 12
"""Places in the result row of `search_array`."""

TREE, EXTRA, UNUSED = -1, -2, -3
"""Role of a phase row: it fixes a constant; its integer is found last; none. Else the antenna of the list."""

_MU = 0.1
_LIST_CAPACITY = 8192
_PART_CAPACITY = 32768
_EXTRA_CAPACITY = 256
_PSEUDO_WEIGHT = 10.0


@kernel
def invert_semidefinite(a, n, scale, out):
    """Generalised inverse of a symmetric semidefinite matrix by sweeps; returns its rank.

    `scale` (n,) is what a pivot is compared with: below 1e-10 of it the row is taken as dependent.
    """
    for i in range(n):
        for j in range(n):
            out[i, j] = a[i, j]
    swept = np.zeros(n, np.int64)
    rank = 0
    for k in range(n):
        pivot = out[k, k]
        if not pivot > 1e-10 * scale[k]:
            continue
        swept[k] = 1
        rank += 1
        for i in range(n):
            if i == k:
                continue
            factor = out[i, k] / pivot
            if factor == 0.0:
                continue
            for j in range(n):
                if j != k:
                    out[i, j] -= factor * out[k, j]
        for i in range(n):
            if i != k:
                out[i, k] /= pivot
                out[k, i] = out[i, k]
        out[k, k] = -1.0 / pivot
    for i in range(n):
        for j in range(n):
            out[i, j] = -out[i, j] if swept[i] == 1 and swept[j] == 1 else 0.0
    return rank


@kernel
def project_rows(n, use, antenna, satellite, group, weight, n_antennas, matrix):
    """Weight matrix of the rows with the constants of satellites and of clocks eliminated.

    Rows are sorted by group and satellite; `matrix` (n, n) is zero for rows not in use.
    """
    for i in range(n):
        for j in range(n):
            matrix[i, j] = 0.0
    total = np.empty(n)
    clock = np.empty((n, n_antennas))
    gain = np.empty((n, n_antennas))
    normal = np.empty((n_antennas, n_antennas))
    inverse = np.empty((n_antennas, n_antennas))
    scale = np.empty(n_antennas)
    first = 0
    while first < n:
        last = first
        while last < n and group[last] == group[first]:
            last += 1
        for a in range(n_antennas):
            scale[a] = 0.0
            for b in range(n_antennas):
                normal[a, b] = 0.0
        i = first
        while i < last:
            j = i
            weight_of_satellite = 0.0
            while j < last and satellite[j] == satellite[i]:
                if use[j]:
                    weight_of_satellite += weight[j]
                j += 1
            for p in range(i, j):
                total[p] = weight_of_satellite
                for a in range(n_antennas):
                    clock[p, a] = 0.0
                if not use[p]:
                    continue
                scale[antenna[p]] += weight[p]
                clock[p, antenna[p]] += weight[p]
                normal[antenna[p], antenna[p]] += weight[p]
                for q in range(i, j):
                    if use[q]:
                        shared = weight[p] * weight[q] / weight_of_satellite
                        clock[p, antenna[q]] -= shared
                        normal[antenna[p], antenna[q]] -= shared
            i = j
        invert_semidefinite(normal, n_antennas, scale, inverse)
        for p in range(first, last):
            for a in range(n_antennas):
                value = 0.0
                for b in range(n_antennas):
                    value += inverse[a, b] * clock[p, b]
                gain[p, a] = value
        for p in range(first, last):
            if not use[p]:
                continue
            for q in range(first, p + 1):
                if not use[q]:
                    continue
                value = weight[p] if p == q else 0.0
                if satellite[p] == satellite[q]:
                    value -= weight[p] * weight[q] / total[p]
                for a in range(n_antennas):
                    value -= clock[p, a] * gain[q, a]
                matrix[p, q] = value
                matrix[q, p] = value
        first = last


@kernel
def reduce_rows(n, valid, antenna, satellite, group, reference, n_antennas, value, role, sees_reference):
    """Remove constants of satellites and clocks along a spanning tree of the rows, in place.

    Rows of the tree become 0; all others then hold double differences. The tree prefers the rows of
    the reference antenna, then one row of each antenna with a satellite of the reference.

    Parameters
    ----------
    value : ndarray, shape (n,)
        Observations, replaced.
    role : ndarray of int64, shape (n,)
        Output: `TREE`, `EXTRA`, `UNUSED`, or the antenna for the other rows it shares with the reference.
    sees_reference : ndarray of int64, shape (n,)
        Output: 1 where the reference antenna has the row's satellite.
    """
    n_satellites = 0
    for i in range(n):
        role[i] = UNUSED
        sees_reference[i] = 0
        n_satellites = max(n_satellites, satellite[i] + 1)
    of_satellite = np.zeros(n_satellites)
    satellite_done = np.zeros(n_satellites, np.int64)
    of_antenna = np.zeros(n_antennas)
    antenna_done = np.zeros(n_antennas, np.int64)
    first = 0
    while first < n:
        last = first
        while last < n and group[last] == group[first]:
            last += 1
        for a in range(n_antennas):
            of_antenna[a] = 0.0
            antenna_done[a] = 0
        for i in range(first, last):
            if valid[i] and antenna[i] == reference:
                of_satellite[satellite[i]] = value[i]
                satellite_done[satellite[i]] = 1
                antenna_done[reference] = 1
                role[i] = TREE
        for i in range(first, last):
            if satellite_done[satellite[i]] == 1:
                sees_reference[i] = 1
        for i in range(first, last):
            if valid[i] and antenna[i] != reference and sees_reference[i] == 1:
                if antenna_done[antenna[i]] == 0:
                    of_antenna[antenna[i]] = value[i] - of_satellite[satellite[i]]
                    antenna_done[antenna[i]] = 1
                    role[i] = TREE
                else:
                    role[i] = antenna[i]
        changed = True
        while changed:
            changed = False
            open_row = -1
            for i in range(first, last):
                if not valid[i] or role[i] != UNUSED:
                    continue
                a, s = antenna[i], satellite[i]
                if antenna_done[a] and satellite_done[s]:
                    role[i] = EXTRA
                elif antenna_done[a]:
                    of_satellite[s] = value[i] - of_antenna[a]
                    satellite_done[s] = 1
                    role[i] = TREE
                    changed = True
                elif satellite_done[s]:
                    of_antenna[a] = value[i] - of_satellite[s]
                    antenna_done[a] = 1
                    role[i] = TREE
                    changed = True
                else:
                    open_row = i
            if not changed and open_row >= 0:
                antenna_done[antenna[open_row]] = 1
                changed = True
        for i in range(first, last):
            if valid[i]:
                value[i] -= of_satellite[satellite[i]] + of_antenna[antenna[i]]
            if role[i] == TREE:
                value[i] = 0.0
        first = last


@kernel
def body_frame(n, vectors, tolerance, frame):
    """Orthonormal right-handed frame (columns) whose first axes span the vectors; returns their rank."""
    rest = np.empty((n, 3))
    for i in range(n):
        for r in range(3):
            rest[i, r] = vectors[i, r]
    rank = 0
    for c in range(3):
        best, size = -1, tolerance
        for i in range(n):
            norm = np.sqrt(rest[i, 0] ** 2 + rest[i, 1] ** 2 + rest[i, 2] ** 2)
            if norm > size * (1.0 + 1e-9):
                best, size = i, norm
        if best < 0:
            break
        for r in range(3):
            frame[r, c] = rest[best, r] / size
        for i in range(n):
            dot = rest[i, 0] * frame[0, c] + rest[i, 1] * frame[1, c] + rest[i, 2] * frame[2, c]
            for r in range(3):
                rest[i, r] -= dot * frame[r, c]
        rank += 1
    if rank == 0:
        frame[0, 0], frame[1, 0], frame[2, 0] = 1.0, 0.0, 0.0
    if rank < 2:
        # Any direction across: that of the axis the first one has least of.
        least = 0
        for r in range(1, 3):
            if abs(frame[r, 0]) < abs(frame[least, 0]):
                least = r
        size = np.sqrt(1.0 - frame[least, 0] ** 2)
        for r in range(3):
            frame[r, 1] = ((1.0 if r == least else 0.0) - frame[least, 0] * frame[r, 0]) / size
    frame[0, 2] = frame[1, 0] * frame[2, 1] - frame[2, 0] * frame[1, 1]
    frame[1, 2] = frame[2, 0] * frame[0, 1] - frame[0, 0] * frame[2, 1]
    frame[2, 2] = frame[0, 0] * frame[1, 1] - frame[1, 0] * frame[0, 1]
    return rank


@kernel
def nearest_rotation(rank, centre, x):
    """Orthonormal vectors x (3 rank,) nearest to those of `centre`, as a right-handed rotation turns them."""
    gram = np.zeros((3, 3))
    for c in range(rank):
        for d in range(rank):
            for r in range(3):
                gram[c, d] += centre[3 * c + r] * centre[3 * d + r]
    values = np.empty(3)
    right = np.empty((3, 3))
    eigen_symmetric_3(gram, values, right)
    left = np.zeros((3, 3))
    for k in range(2, 0, -1):
        for c in range(rank):
            for r in range(3):
                left[r, k] += centre[3 * c + r] * right[c, k]
        if k == 1:
            dot = left[0, 1] * left[0, 2] + left[1, 1] * left[1, 2] + left[2, 1] * left[2, 2]
            for r in range(3):
                left[r, 1] -= dot * left[r, 2]
        size = np.sqrt(left[0, k] ** 2 + left[1, k] ** 2 + left[2, k] ** 2)
        if size > 1e-12:
            for r in range(3):
                left[r, k] /= size
        elif k == 2:
            left[0, 2], left[1, 2], left[2, 2] = 1.0, 0.0, 0.0
        else:
            least = 0
            for r in range(1, 3):
                if abs(left[r, 2]) < abs(left[least, 2]):
                    least = r
            size = np.sqrt(1.0 - left[least, 2] ** 2)
            for r in range(3):
                left[r, 1] = ((1.0 if r == least else 0.0) - left[least, 2] * left[r, 2]) / size
    left[0, 0] = left[1, 1] * left[2, 2] - left[2, 1] * left[1, 2]
    left[1, 0] = left[2, 1] * left[0, 2] - left[0, 1] * left[2, 2]
    left[2, 0] = left[0, 1] * left[1, 2] - left[1, 1] * left[0, 2]
    hand = (
        right[0, 0] * (right[1, 1] * right[2, 2] - right[2, 1] * right[1, 2])
        - right[1, 0] * (right[0, 1] * right[2, 2] - right[2, 1] * right[0, 2])
        + right[2, 0] * (right[0, 1] * right[1, 2] - right[1, 1] * right[0, 2])
    )
    for c in range(rank):
        for r in range(3):
            x[3 * c + r] = (
                hand * left[r, 0] * right[c, 0] + left[r, 1] * right[c, 1] + left[r, 2] * right[c, 2]
            )


@kernel
def descend(rank, a, centre, c0, bound, x, hessian):
    """Newton steps on the group from x to a minimum of c0 + (x - centre)' A (x - centre).

    Writes x and half the second derivatives (3, 3). Returns (cost, volume), the volume being the inverse root
    of the determinant of the curvature; an infinite cost says that the minimum is above the bound.
    """
    m = 3 * rank
    error = np.empty(m)
    trial = np.empty(m)
    cost = np.inf
    determinant = 1.0
    for iteration in range(40):
        cost = c0
        for i in range(m):
            value = 0.0
            for j in range(m):
                value += a[i, j] * (x[j] - centre[j])
            error[i] = value
            cost += value * (x[i] - centre[i])
        g0, g1, g2, along = 0.0, 0.0, 0.0, 0.0
        h00, h11, h22, h10, h20, h21 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for c in range(rank):
            p = 3 * c
            x0, x1, x2 = x[p], x[p + 1], x[p + 2]
            e0, e1, e2 = error[p], error[p + 1], error[p + 2]
            g0 += x1 * e2 - x2 * e1
            g1 += x2 * e0 - x0 * e2
            g2 += x0 * e1 - x1 * e0
            # What the curvature of the group adds to the second derivatives.
            along += x0 * e0 + x1 * e1 + x2 * e2
            h00 += e0 * x0
            h11 += e1 * x1
            h22 += e2 * x2
            h10 += 0.5 * (e0 * x1 + e1 * x0)
            h20 += 0.5 * (e0 * x2 + e2 * x0)
            h21 += 0.5 * (e1 * x2 + e2 * x1)
            for d in range(rank):
                q = 3 * d
                y0, y1, y2 = x[q], x[q + 1], x[q + 2]
                # -[x] A_cd [y], column by column of A_cd [y].
                b1 = a[p + 1, q + 1] * y2 - a[p + 1, q + 2] * y1
                b2 = a[p + 2, q + 1] * y2 - a[p + 2, q + 2] * y1
                b0 = a[p, q + 1] * y2 - a[p, q + 2] * y1
                h00 += x2 * b1 - x1 * b2
                h10 += x0 * b2 - x2 * b0
                h20 += x1 * b0 - x0 * b1
                b0 = a[p, q + 2] * y0 - a[p, q] * y2
                b1 = a[p + 1, q + 2] * y0 - a[p + 1, q] * y2
                b2 = a[p + 2, q + 2] * y0 - a[p + 2, q] * y2
                h11 += x0 * b2 - x2 * b0
                h21 += x1 * b0 - x0 * b1
                b0 = a[p, q] * y1 - a[p, q + 1] * y0
                b1 = a[p + 1, q] * y1 - a[p + 1, q + 1] * y0
                h22 += x1 * b0 - x0 * b1
        h00 -= along
        h11 -= along
        h22 -= along
        if rank == 1:
            # Turning about the only axis is no unknown.
            h00 += x[0] * x[0]
            h11 += x[1] * x[1]
            h22 += x[2] * x[2]
            h10 += x[0] * x[1]
            h20 += x[0] * x[2]
            h21 += x[1] * x[2]
        is_convex = True
        i00 = h11 * h22 - h21 * h21
        i10 = h21 * h20 - h10 * h22
        i20 = h10 * h21 - h11 * h20
        determinant = h00 * i00 + h10 * i10 + h20 * i20
        if not (h00 > 0.0 and h00 * h11 > h10 * h10 and determinant > 0.0):
            # As much of the identity as makes a descent of the step.
            is_convex = False
            more = abs(h00) + abs(h11) + abs(h22) + 2.0 * (abs(h10) + abs(h20) + abs(h21)) + 1e-300
            h00 += more
            h11 += more
            h22 += more
            i00 = h11 * h22 - h21 * h21
            i10 = h21 * h20 - h10 * h22
            i20 = h10 * h21 - h11 * h20
            determinant = h00 * i00 + h10 * i10 + h20 * i20
        i11 = h00 * h22 - h20 * h20
        i22 = h00 * h11 - h10 * h10
        i21 = h10 * h20 - h00 * h21
        s0 = -(i00 * g0 + i10 * g1 + i20 * g2) / determinant
        s1 = -(i10 * g0 + i11 * g1 + i21 * g2) / determinant
        s2 = -(i20 * g0 + i21 * g1 + i22 * g2) / determinant
        gain = -(s0 * g0 + s1 * g1 + s2 * g2)
        hessian[0, 0], hessian[1, 1], hessian[2, 2] = h00, h11, h22
        hessian[0, 1], hessian[1, 0] = h10, h10
        hessian[0, 2], hessian[2, 0] = h20, h20
        hessian[1, 2], hessian[2, 1] = h21, h21
        if gain < 1e-10:
            break
        # A quadratic step gains `gain`; many times that leads nowhere near the bound.
        if is_convex and iteration > 0 and cost - 8.0 * gain - 1.0 > bound:
            return np.inf, 0.0
        size = np.sqrt(s0 * s0 + s1 * s1 + s2 * s2)
        factor = min(1.0, 0.7 / size)
        reached = np.inf
        for _ in range(25):
            t0, t1, t2 = factor * s0, factor * s1, factor * s2
            angle = factor * size
            sinc = np.sin(angle) / angle if angle > 1e-8 else 1.0
            versine = (1.0 - np.cos(angle)) / (angle * angle) if angle > 1e-4 else 0.5
            for c in range(rank):
                p = 3 * c
                x0, x1, x2 = x[p], x[p + 1], x[p + 2]
                y0, y1, y2 = t1 * x2 - t2 * x1, t2 * x0 - t0 * x2, t0 * x1 - t1 * x0
                trial[p] = x0 + sinc * y0 + versine * (t1 * y2 - t2 * y1)
                trial[p + 1] = x1 + sinc * y1 + versine * (t2 * y0 - t0 * y2)
                trial[p + 2] = x2 + sinc * y2 + versine * (t0 * y1 - t1 * y0)
            reached = c0
            for i in range(m):
                value = 0.0
                for j in range(m):
                    value += a[i, j] * (trial[j] - centre[j])
                reached += value * (trial[i] - centre[i])
            if reached < cost:
                break
            factor *= 0.3
        if not reached < cost:
            break
        for i in range(m):
            x[i] = trial[i]
    return cost, 1.0 / np.sqrt(determinant)


@kernel
def minimise(rank, a, centre, c0, bound, weak_axis, weak_information, x, other, hessian, scratch, out):
    """Least of c0 + (x - centre)' A (x - centre) over rotations, both attitudes where a direction is weak.

    Writes the best x (3 rank,), its curvature, and `out`: volume of all attitudes, share of the best one.
    `other` and `scratch` are room. Returns the cost, infinite above the bound.
    """
    nearest_rotation(rank, centre, x)
    cost, volume = descend(rank, a, centre, c0, bound, x, hessian)
    out[0] = volume
    out[1] = 1.0
    height = 0.0
    for c in range(rank):
        dot = 0.0
        for r in range(3):
            dot += weak_axis[r] * x[3 * c + r]
        height += dot * dot
    # Unless that is too far for the bound, the mirror image is a start of its own.
    if weak_information * height > bound - c0:
        return cost
    for c in range(min(rank, 2)):
        dot = 0.0
        for r in range(3):
            dot += weak_axis[r] * x[3 * c + r]
        for r in range(3):
            other[3 * c + r] = x[3 * c + r] - 2.0 * dot * weak_axis[r]
    if rank == 3:
        other[6] = other[1] * other[5] - other[2] * other[4]
        other[7] = other[2] * other[3] - other[0] * other[5]
        other[8] = other[0] * other[4] - other[1] * other[3]
    cost_2, volume_2 = descend(rank, a, centre, c0, bound, other, scratch)
    if not cost_2 < np.inf:
        return cost
    apart = 0.0
    for i in range(3 * rank):
        apart += (x[i] - other[i]) ** 2
    if cost < np.inf and apart < 1e-8:
        return cost
    if cost_2 < cost:
        if cost < np.inf:
            share = 1.0 / (1.0 + volume / volume_2 * np.exp(0.5 * (cost_2 - cost)))
        else:
            share = 1.0
        cost, volume = cost_2, volume_2
        for i in range(3 * rank):
            x[i] = other[i]
        for r in range(3):
            for s in range(3):
                hessian[r, s] = scratch[r, s]
    else:
        share = 1.0 / (1.0 + volume_2 / volume * np.exp(0.5 * (cost - cost_2)))
    out[0] = volume / share
    out[1] = share
    return cost


@kernel
def prepare_subset(
    n, use, integer_row, n_integers, antenna, satellite, group, weight, design, slot, n_vectors, n_antennas,
    code_information, code_rhs, body, position_variance, rank, frame, prior, prior_rot, mu,
    information, inverse, centre, turn, quadratic, linear,
):  # fmt: skip
    """Reduce the phases of some antennas, and what code and prior say of them, to a function of the integers.

    With x the phases less their integers at the rows `integer_row`,

        c_0(x) = constant + 2 linear' x + x' quadratic x,      X_0(x) = centre + turn x,

    and C = c_0 + (X - X_0)' information (X - X_0), X the first `rank` axes of the body frame as turned.

    Parameters
    ----------
    slot : ndarray of int64, shape (n_antennas,)
        Place of each antenna among the vectors; negative for the reference and those left out.
    code_information, code_rhs : ndarray, shapes (3 v, 3 v), (3 v,)
        Of the vectors, marginal.
    body : ndarray, shape (v, 3)
        The vectors from the reference in the body frame.
    prior, prior_rot : ndarray, shape (3, 3)
        Weight K and attitude R_p of trace((R - R_p)' K (R - R_p)).
    information, inverse, centre, turn, quadratic, linear : ndarray
        Output.

    Returns
    -------
    float
        The constant.
    """
    m = 3 * n_vectors
    k = 3 * rank
    projector = np.empty((n, n))
    project_rows(n, use, antenna, satellite, group, weight, n_antennas, projector)
    spread = np.zeros((n, m))
    for j in range(n):
        t = slot[antenna[j]]
        if not use[j] or t < 0:
            continue
        for i in range(n):
            value = projector[i, j]
            if value != 0.0:
                for r in range(3):
                    spread[i, 3 * t + r] += value * design[j, r]
    normal = np.empty((m, m))
    for p in range(m):
        for q in range(m):
            normal[p, q] = code_information[p, q]
    for i in range(n):
        t = slot[antenna[i]]
        if not use[i] or t < 0:
            continue
        for r in range(3):
            for q in range(m):
                normal[3 * t + r, q] += design[i, r] * spread[i, q]
    rhs = np.empty(m)
    for p in range(m):
        rhs[p] = code_rhs[p]
    # What code says costs nothing at its own best.
    scale = np.empty(m)
    work = np.empty((m, m))
    constant = 0.0
    for p in range(m):
        scale[p] = code_information[p, p]
    invert_semidefinite(code_information, m, scale, work)
    for p in range(m):
        for q in range(m):
            constant += code_rhs[p] * work[p, q] * code_rhs[q]
    cross = np.empty((m, n_integers))
    for i in range(n_integers):
        linear[i] = 0.0
        for p in range(m):
            cross[p, i] = spread[integer_row[i], p]
        for j in range(n_integers):
            quadratic[i, j] = projector[integer_row[i], integer_row[j]]
    if position_variance > 0.0:
        # Vectors R l + d: the deviations d are eliminated, their covariance v (I + 1 1') in any attitude.
        stiff = np.empty((m, m))
        for p in range(m):
            for q in range(m):
                stiff[p, q] = normal[p, q]
                if p % 3 == q % 3:
                    own = 1.0 if p == q else 0.0
                    stiff[p, q] += (own - 1.0 / (n_vectors + 1.0)) / position_variance
        for p in range(m):
            scale[p] = stiff[p, p]
        invert_semidefinite(stiff, m, scale, work)
        gain = np.empty((m, m))
        for p in range(m):
            for q in range(m):
                value = 0.0
                for t in range(m):
                    value += normal[p, t] * work[t, q]
                gain[p, q] = value
        pulled = np.empty((m, n_integers))
        pulled_rhs = np.empty(m)
        for p in range(m):
            value = 0.0
            for q in range(m):
                value += work[p, q] * rhs[q]
            pulled_rhs[p] = value
            for i in range(n_integers):
                value = 0.0
                for q in range(m):
                    value += work[p, q] * cross[q, i]
                pulled[p, i] = value
        for p in range(m):
            constant -= rhs[p] * pulled_rhs[p]
        for i in range(n_integers):
            for p in range(m):
                linear[i] -= cross[p, i] * pulled_rhs[p]
            for j in range(n_integers):
                value = 0.0
                for p in range(m):
                    value += cross[p, i] * pulled[p, j]
                quadratic[i, j] -= value
        for i in range(n_integers):
            for p in range(m):
                value = 0.0
                for q in range(m):
                    value += normal[p, q] * pulled[q, i]
                cross[p, i] -= value
        for p in range(m):
            value = 0.0
            for q in range(m):
                value += gain[p, q] * code_rhs[q]
            rhs[p] -= value
        for p in range(m):
            for q in range(m):
                value = 0.0
                for t in range(m):
                    value += gain[p, t] * normal[t, q]
                work[p, q] = value
        for p in range(m):
            for q in range(m):
                normal[p, q] -= 0.5 * (work[p, q] + work[q, p])
    # From the vectors to the axes of the body frame they span.
    along = np.empty((rank, n_vectors))
    for c in range(rank):
        for t in range(n_vectors):
            along[c, t] = frame[0, c] * body[t, 0] + frame[1, c] * body[t, 1] + frame[2, c] * body[t, 2]
    start = np.zeros(k)
    lift = np.zeros((k, n_integers))
    for c in range(rank):
        for r in range(3):
            p = 3 * c + r
            for t in range(n_vectors):
                start[p] += along[c, t] * rhs[3 * t + r]
                for i in range(n_integers):
                    lift[p, i] += along[c, t] * cross[3 * t + r, i]
            for d in range(rank):
                for s in range(3):
                    value = 0.0
                    for t in range(n_vectors):
                        for u in range(n_vectors):
                            value += along[c, t] * along[d, u] * normal[3 * t + r, 3 * u + s]
                    information[p, 3 * d + s] = value
    for c in range(rank):
        expected = np.zeros(3)
        for r in range(3):
            for s in range(3):
                expected[r] += prior_rot[r, s] * frame[s, c]
        for r in range(3):
            for s in range(3):
                start[3 * c + r] += prior[r, s] * expected[s]
                constant += expected[r] * prior[r, s] * expected[s]
                information[3 * c + r, 3 * c + s] += prior[r, s]
            information[3 * c + r, 3 * c + r] += mu
    constant -= mu * rank
    axis_scale = np.empty(k)
    for p in range(k):
        axis_scale[p] = mu
    invert_semidefinite(information, k, axis_scale, inverse)
    for p in range(k):
        value = 0.0
        for q in range(k):
            value += inverse[p, q] * start[q]
        centre[p] = value
        constant -= value * start[p]
        for i in range(n_integers):
            value = 0.0
            for q in range(k):
                value += inverse[p, q] * lift[q, i]
            turn[p, i] = value
    for p in range(k):
        for i in range(n_integers):
            linear[i] -= lift[p, i] * centre[p]
    for i in range(n_integers):
        for j in range(n_integers):
            value = 0.0
            for p in range(k):
                value += lift[p, i] * turn[p, j]
            quadratic[i, j] -= value
    return constant


@kernel
def enumerate_shell(
    n, lower, diag, z_float, gain, b_float, information, mu, j_min, length, variance, bound, max_nodes,
    z_out, cost_out,
):  # fmt: skip
    """All decorrelated integers whose objective with the length is at most `bound`; see `search_shell`.

    Writes ``z_out[:count, :n]`` and ``cost_out[:count]``. Returns (count, nodes, is complete).
    """
    capacity = cost_out.shape[0]
    limit = bound + mu * length * length / (1.0 - mu * variance) - j_min
    count = 0
    nodes = 0
    c = np.empty(3)
    b = np.empty(3)
    step = np.empty(n)
    z_now = np.empty(n)
    z_cond = np.empty(n)
    partial = np.zeros(n + 1)
    sums = np.zeros((n, n))
    k = n - 1
    z_cond[k] = z_float[k]
    z_now[k] = np.floor(z_cond[k] + 0.5)
    step[k] = 1.0 if z_cond[k] >= z_now[k] else -1.0
    while True:
        nodes += 1
        if nodes > max_nodes:
            return count, nodes, False
        gap = z_cond[k] - z_now[k]
        here = partial[k + 1] + gap * gap / diag[k]
        if here > limit:
            k += 1
            if k == n:
                return count, nodes, True
        elif k > 0:
            partial[k] = here
            for i in range(k):
                sums[k - 1, i] = sums[k, i] + (z_now[k] - z_cond[k]) * lower[k, i]
            k -= 1
            z_cond[k] = z_float[k] + sums[k, k]
            z_now[k] = np.floor(z_cond[k] + 0.5)
            step[k] = 1.0 if z_cond[k] >= z_now[k] else -1.0
            continue
        else:
            cost = j_min + here
            norm = 0.0
            for i in range(3):
                value = b_float[i]
                for j in range(n):
                    value -= gain[i, j] * (z_float[j] - z_now[j])
                if information[i] > 0.0:
                    c[i] = value * (information[i] + mu) / information[i]
                    cost -= mu * value * c[i]
                else:
                    c[i] = 0.0
                norm += c[i] * c[i]
            short = np.sqrt(norm) - length
            if cost + short * short / (1.0 / information[0] + variance) <= bound:
                cost += nearest_on_shell(c, information, length, variance, b)[1]
                if cost <= bound:
                    if count == capacity:
                        return count, nodes, False
                    for i in range(n):
                        z_out[count, i] = z_now[i]
                    cost_out[count] = cost
                    count += 1
        z_now[k] += step[k]
        step[k] = -step[k] - (1.0 if step[k] > 0.0 else -1.0)


@kernel
def list_baseline(
    n, n_integers, integer_row, antenna, satellite, group, reference, role, sees_reference, observed,
    wavelength, variance, design, code_information, code_rhs, length, length_variance, bound, max_nodes,
    integers, costs,
):  # fmt: skip
    """All integers of one baseline whose cost by itself, its length known, is at most `bound`.

    Writes ``integers[:count, :n_integers]`` and ``costs[:count]``. Returns (count, nodes, is complete).
    """
    m = n_integers
    d = np.empty((m, 3))
    y = np.empty(m)
    own = np.empty(m)
    tree = np.empty(m)
    for j in range(m):
        i = integer_row[j]
        base = -1
        for p in range(n):
            if role[p] == TREE and group[p] == group[i]:
                if antenna[p] == antenna[i] and sees_reference[p] == 1:
                    base = p
                elif antenna[p] == reference and satellite[p] == satellite[i]:
                    own[j] = variance[i] + variance[p]
        for p in range(n):
            if role[p] == TREE and antenna[p] == reference and satellite[p] == satellite[base]:
                tree[j] = variance[base] + variance[p]
        for r in range(3):
            d[j, r] = design[i, r] - design[base, r]
        y[j] = observed[i]
    # A trace of information everywhere, worth no more than its cost at 20 sd beyond the length.
    trace = 1e-3 / (length * length)
    mu = _PSEUDO_WEIGHT / (length * length + _PSEUDO_WEIGHT * length_variance)
    normal = np.empty((3, 3))
    total = np.empty((3, 3))
    inverse = np.empty((3, 3))
    scale = np.empty(3)
    for r in range(3):
        for s in range(3):
            total[r, s] = code_information[r, s]
        total[r, r] += trace
        for s in range(3):
            normal[r, s] = total[r, s]
        normal[r, r] += mu
        scale[r] = code_information[r, r]
    j_min = -trace * (length + 20.0 * np.sqrt(length_variance)) ** 2
    invert_semidefinite(code_information, 3, scale, inverse)
    for r in range(3):
        for s in range(3):
            j_min += code_rhs[r] * inverse[r, s] * code_rhs[s]
        scale[r] = mu
    invert_semidefinite(normal, 3, scale, inverse)
    b_float = np.empty(3)
    for r in range(3):
        b_float[r] = inverse[r, 0] * code_rhs[0] + inverse[r, 1] * code_rhs[1] + inverse[r, 2] * code_rhs[2]
    for r in range(3):
        j_min -= b_float[r] * code_rhs[r]
    # The phases' information on the vector: weights less their mean in each group.
    sum_w = np.zeros(m)
    mean = np.zeros((m, 3))
    for j in range(m):
        sum_w[j] = 1.0 / tree[j]
        for p in range(m):
            if group[integer_row[p]] == group[integer_row[j]]:
                sum_w[j] += 1.0 / own[p]
                for r in range(3):
                    mean[j, r] += d[p, r] / own[p]
    for j in range(m):
        for r in range(3):
            for s in range(3):
                total[r, s] += d[j, r] * (d[j, s] - mean[j, s] / sum_w[j]) / own[j]
    q_float = np.empty((m, m))
    q_baseline = np.empty((3, m))
    rest = np.empty(m)
    whole = np.empty(m)
    for j in range(m):
        value = y[j]
        for r in range(3):
            value -= d[j, r] * b_float[r]
            q_baseline[r, j] = (
                -(inverse[r, 0] * d[j, 0] + inverse[r, 1] * d[j, 1] + inverse[r, 2] * d[j, 2])
                / wavelength[integer_row[j]]
            )
        value /= wavelength[integer_row[j]]
        whole[j] = np.floor(value + 0.5)
        rest[j] = value - whole[j]
    for j in range(m):
        for p in range(m):
            value = 0.0
            if group[integer_row[p]] == group[integer_row[j]]:
                value = tree[j] + (own[j] if p == j else 0.0)
            value /= wavelength[integer_row[p]]
            for r in range(3):
                value -= d[p, r] * q_baseline[r, j] * wavelength[integer_row[j]] / wavelength[integer_row[p]]
            q_float[p, j] = value / wavelength[integer_row[j]]
    lower = np.empty((m, m))
    diag = np.empty(m)
    transform = np.empty((m, m))
    back = np.empty((m, m))
    if decorrelate(q_float, m, lower, diag, transform, back) != 0:
        return 0, 0, False
    values = np.empty(3)
    axes = np.empty((3, 3))
    eigen_symmetric_3(total, values, axes)
    z_float = np.zeros(m)
    cross = np.zeros((3, m))
    for j in range(m):
        for i in range(m):
            factor = transform[j, i]
            if factor != 0.0:
                z_float[i] += factor * rest[j]
                for r in range(3):
                    cross[r, i] += q_baseline[r, j] * factor
    gain = np.empty((3, m))
    for r in range(3):
        for i in range(m - 1, -1, -1):
            for j in range(i + 1, m):
                cross[r, i] -= lower[j, i] * cross[r, j]
        for i in range(m):
            value = cross[r, i] / diag[i]
            for j in range(i):
                value -= lower[i, j] * gain[r, j]
            gain[r, i] = value
    b_eigen = np.empty(3)
    for i in range(m):
        g0, g1, g2 = gain[0, i], gain[1, i], gain[2, i]
        for r in range(3):
            gain[r, i] = axes[0, r] * g0 + axes[1, r] * g1 + axes[2, r] * g2
    for r in range(3):
        b_eigen[r] = axes[0, r] * b_float[0] + axes[1, r] * b_float[1] + axes[2, r] * b_float[2]
    count, nodes, complete = enumerate_shell(
        m, lower, diag, z_float, gain, b_eigen, values, mu, j_min, length, length_variance, bound, max_nodes,
        integers, costs,
    )  # fmt: skip
    z = np.empty(m)
    for k in range(count):
        for i in range(m):
            z[i] = integers[k, i]
        for i in range(m):
            value = whole[i]
            for j in range(m):
                value += back[i, j] * z[j]
            integers[k, i] = np.floor(value + 0.5)
    return count, nodes, complete


@kernel
def is_near_rotation(rank, x, inverse, spectrum, tau):
    """False where no rotation lies within (X - x)' A (X - x) <= tau; `inverse` is A^-1.

    `spectrum` (rank,) holds the largest eigenvalues of the diagonal blocks of the inverse.
    """
    root = np.sqrt(tau)
    for c in range(rank):
        p = 3 * c
        for d in range(c, rank):
            q = 3 * d
            off = x[p] * x[q] + x[p + 1] * x[q + 1] + x[p + 2] * x[q + 2]
            slope = 0.0
            if c == d:
                off -= 1.0
                for r in range(3):
                    for s in range(3):
                        slope += x[p + r] * inverse[p + r, p + s] * x[p + s]
                slope *= 4.0
            else:
                for r in range(3):
                    for s in range(3):
                        slope += (
                            x[q + r] * inverse[p + r, p + s] * x[q + s]
                            + x[p + r] * inverse[q + r, q + s] * x[p + s]
                            + 2.0 * x[q + r] * inverse[p + r, q + s] * x[p + s]
                        )
            if abs(off) > root * np.sqrt(max(slope, 0.0)) + tau * np.sqrt(spectrum[c] * spectrum[d]):
                return False
    return True


@kernel
def sort_by_cost(n, cost, order):
    """Write into `order` the indices 0 .. n - 1 by ascending cost (Shell's sort)."""
    for i in range(n):
        order[i] = i
    gap = 1
    while gap < n // 3:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, n):
            item = order[i]
            j = i
            while j >= gap and cost[order[j - gap]] > cost[item]:
                order[j] = order[j - gap]
                j -= gap
            order[j] = item
        gap //= 3


@kernel
def join(
    n_parts, parts, part_cost, n_old, t, counts, sizes, metres, constant, linear, quadratic, centre, turn,
    information, inverse, rank, bound, margin, is_final, max_checks, out, out_cost, out_volume, out_share,
):  # fmt: skip
    """Join partial candidates of `n_old` baselines with the list of baseline `t`.

    Parameters
    ----------
    parts, part_cost : ndarray
        Candidate of each baseline (n_parts, lists), and cost, of what was joined before.
    metres : ndarray, shape (lists, capacity, n_max)
        Phases less integers of each baseline's candidates.
    constant ... inverse
        Of `prepare_subset`, for the baselines joined before and t.
    bound, margin : float
        Candidates above the bound are dropped; where `is_final` the bound shrinks to best + margin.
    out, out_cost, out_volume, out_share : ndarray
        Output, one row for each joined candidate.

    Returns
    -------
    tuple of (int, float, int, bool)
        Number joined, bound, checks made, whether all was kept.
    """
    k = 3 * rank
    n_before = 0
    for u in range(n_old):
        n_before += sizes[u]
    own = sizes[t]
    count = counts[t]
    capacity = out_cost.shape[0]
    # Of each candidate of the list: its share of c_0, what multiplies the others' phases, and of X_0.
    share_of_cost = np.empty(count)
    partner = np.empty((count, max(n_before, 1)))
    shift = np.empty((count, k))
    for j in range(count):
        value = 0.0
        for p in range(own):
            value += 2.0 * linear[n_before + p] * metres[t, j, p]
            for q in range(own):
                value += metres[t, j, p] * quadratic[n_before + p, n_before + q] * metres[t, j, q]
        share_of_cost[j] = value
        for p in range(n_before):
            value = 0.0
            for q in range(own):
                value += quadratic[p, n_before + q] * metres[t, j, q]
            partner[j, p] = 2.0 * value
        for p in range(k):
            value = 0.0
            for q in range(own):
                value += turn[p, n_before + q] * metres[t, j, q]
            shift[j, p] = value
    block = np.zeros((3, 3))
    sum_block = np.zeros((3, 3))
    values = np.empty(3)
    axes = np.empty((3, 3))
    spectrum = np.empty(rank)
    for c in range(rank):
        for r in range(3):
            for s in range(3):
                block[r, s] = inverse[3 * c + r, 3 * c + s]
                sum_block[r, s] += information[3 * c + r, 3 * c + s]
        eigen_symmetric_3(block, values, axes)
        spectrum[c] = values[2]
    eigen_symmetric_3(sum_block, values, axes)
    weak = np.empty(3)
    for r in range(3):
        weak[r] = axes[r, 0]
    weakest = values[0]
    for c in range(rank):
        value = 0.0
        for r in range(3):
            for s in range(3):
                value += weak[r] * information[3 * c + r, 3 * c + s] * weak[s]
        weakest = min(weakest, value)
    x_old = np.empty(max(n_before, 1))
    at = np.empty(k)
    x0 = np.empty(k)
    x = np.empty(k)
    other = np.empty(k)
    hessian = np.empty((3, 3))
    scratch = np.empty((3, 3))
    extra = np.empty(2)
    n_out = 0
    checks = 0
    is_complete = True
    order = np.empty(n_parts, np.int64)
    sort_by_cost(n_parts, part_cost, order)
    for index in range(n_parts):
        part = order[index]
        if part_cost[part] > bound:
            break
        p = 0
        for u in range(n_old):
            for q in range(sizes[u]):
                x_old[p] = metres[u, parts[part, u], q]
                p += 1
        c_old = constant
        for i in range(n_before):
            value = 2.0 * linear[i]
            for q in range(n_before):
                value += quadratic[i, q] * x_old[q]
            c_old += value * x_old[i]
        for i in range(k):
            at[i] = centre[i]
            for q in range(n_before):
                at[i] += turn[i, q] * x_old[q]
        checks += 1 + count // 16
        if checks > max_checks:
            is_complete = False
            break
        for j in range(count):
            c0 = c_old + share_of_cost[j]
            for i in range(n_before):
                c0 += partner[j, i] * x_old[i]
            if c0 > bound:
                continue
            for i in range(k):
                x0[i] = at[i] + shift[j, i]
            if not is_near_rotation(rank, x0, inverse, spectrum, max(bound - c0, 0.0)):
                continue
            checks += 10
            cost = minimise(
                rank, information, x0, c0, bound, weak, weakest, x, other, hessian, scratch, extra
            )
            if cost > bound:
                continue
            if n_out == capacity:
                # Drop what a bound that has shrunk since no longer admits.
                kept = 0
                for i in range(n_out):
                    if out_cost[i] <= bound:
                        for u in range(n_old + 1):
                            out[kept, u] = out[i, u]
                        out_cost[kept] = out_cost[i]
                        out_volume[kept] = out_volume[i]
                        out_share[kept] = out_share[i]
                        kept += 1
                n_out = kept
                if n_out == capacity:
                    return n_out, bound, checks, False
            for u in range(n_old):
                out[n_out, u] = parts[part, u]
            out[n_out, n_old] = j
            out_cost[n_out] = cost
            out_volume[n_out] = extra[0]
            out_share[n_out] = extra[1]
            n_out += 1
            if is_final and cost + margin < bound:
                bound = cost + margin
    return n_out, bound, checks, is_complete


@kernel
def join_extras(
    n_parts, parts, part_cost, n_lists, sizes, metres, n_extra, observed, wavelength, constant, linear,
    quadratic, centre, turn, information, inverse, rank, bound, margin, max_checks, out, out_cost, out_volume,
    out_share, out_extra,
):  # fmt: skip
    """Complete the candidates of all lists by the integers that the reference antenna has no part in.

    `observed` and `wavelength` (n_extra,) are those of the extra rows, which come last in `linear`,
    `quadratic` and `turn`; their integers are written into `out_extra`. Otherwise as `join`.
    """
    k = 3 * rank
    n_before = 0
    for u in range(n_lists):
        n_before += sizes[u]
    capacity = out_cost.shape[0]
    e = n_extra
    m = max(e, 1)
    lower = np.empty((m, m))
    diag = np.empty(m)
    transform = np.empty((m, m))
    back = np.empty((m, m))
    covariance = np.empty((m, m))
    if e > 0:
        weights = np.empty((e, e))
        scale = np.empty(e)
        for i in range(e):
            for j in range(e):
                weights[i, j] = wavelength[i] * wavelength[j] * quadratic[n_before + i, n_before + j]
            scale[i] = weights[i, i] * 1e-6
        if invert_semidefinite(weights, e, scale, covariance) < e:
            return 0, bound, 0, False
        if decorrelate(covariance, e, lower, diag, transform, back) != 0:
            return 0, bound, 0, False
    block = np.zeros((3, 3))
    sum_block = np.zeros((3, 3))
    values = np.empty(3)
    axes = np.empty((3, 3))
    spectrum = np.empty(rank)
    for c in range(rank):
        for r in range(3):
            for s in range(3):
                block[r, s] = inverse[3 * c + r, 3 * c + s]
                sum_block[r, s] += information[3 * c + r, 3 * c + s]
        eigen_symmetric_3(block, values, axes)
        spectrum[c] = values[2]
    eigen_symmetric_3(sum_block, values, axes)
    weak = np.empty(3)
    for r in range(3):
        weak[r] = axes[r, 0]
    weakest = values[0]
    for c in range(rank):
        value = 0.0
        for r in range(3):
            for s in range(3):
                value += weak[r] * information[3 * c + r, 3 * c + s] * weak[s]
        weakest = min(weakest, value)
    x_all = np.zeros(n_before + e)
    x0 = np.empty(k)
    x = np.empty(k)
    other = np.empty(k)
    hessian = np.empty((3, 3))
    scratch = np.empty((3, 3))
    extra = np.empty(2)
    z_float = np.empty(m)
    whole = np.empty(m)
    z_found = np.empty((_EXTRA_CAPACITY, m))
    z_cost = np.empty(_EXTRA_CAPACITY)
    a = np.empty(m)
    slope = np.empty(m)
    n_out = 0
    checks = 0
    is_complete = True
    order = np.empty(n_parts, np.int64)
    sort_by_cost(n_parts, part_cost, order)
    for index in range(n_parts):
        part = order[index]
        if part_cost[part] > bound:
            break
        p = 0
        for u in range(n_lists):
            for q in range(sizes[u]):
                x_all[p] = metres[u, parts[part, u], q]
                p += 1
        # Float integers: the least of c_0 over the extra phases.
        for i in range(e):
            value = linear[n_before + i]
            for q in range(n_before):
                value += quadratic[n_before + i, q] * x_all[q]
            slope[i] = value
        for i in range(e):
            value = 0.0
            for j in range(e):
                value += covariance[i, j] * wavelength[i] * wavelength[j] * slope[j]
            x_all[n_before + i] = -value
            value = (observed[i] + value) / wavelength[i]
            whole[i] = np.floor(value + 0.5)
            a[i] = value - whole[i]
        least = constant
        for i in range(n_before + e):
            value = 2.0 * linear[i]
            for q in range(n_before + e):
                value += quadratic[i, q] * x_all[q]
            least += value * x_all[i]
        if least > bound:
            continue
        n_found = 1
        z_cost[0] = 0.0
        if e > 0:
            for i in range(e):
                value = 0.0
                for j in range(e):
                    value += transform[j, i] * a[j]
                z_float[i] = value
            n_found, nodes, status = enumerate_within(
                e, lower, diag, z_float, bound - least, z_found, z_cost, max_checks
            )
            checks += nodes // 4
            if status != 0:
                is_complete = False
        if checks > max_checks:
            return n_out, bound, checks, False
        for found in range(n_found):
            c0 = least + z_cost[found]
            for i in range(e):
                value = whole[i]
                for j in range(e):
                    value += back[i, j] * z_found[found, j]
                a[i] = np.floor(value + 0.5)
                x_all[n_before + i] = observed[i] - wavelength[i] * a[i]
            for i in range(k):
                value = centre[i]
                for q in range(n_before + e):
                    value += turn[i, q] * x_all[q]
                x0[i] = value
            if c0 > bound or not is_near_rotation(rank, x0, inverse, spectrum, max(bound - c0, 0.0)):
                continue
            checks += 10
            cost = minimise(
                rank, information, x0, c0, bound, weak, weakest, x, other, hessian, scratch, extra
            )
            if cost > bound:
                continue
            if n_out == capacity:
                return n_out, bound, checks, False
            for u in range(n_lists):
                out[n_out, u] = parts[part, u]
            for i in range(e):
                out_extra[n_out, i] = a[i]
            out_cost[n_out] = cost
            out_volume[n_out] = extra[0]
            out_share[n_out] = extra[1]
            n_out += 1
            if cost + margin < bound:
                bound = cost + margin
    return n_out, bound, checks, is_complete


@kernel
def marginal_information(information, rhs, m, keep, out, out_rhs):
    """Information on the unknowns flagged in `keep` (m,) with all others eliminated."""
    n_drop = 0
    n_keep = 0
    drop_at = np.empty(m, np.int64)
    keep_at = np.empty(m, np.int64)
    for i in range(m):
        if keep[i]:
            keep_at[n_keep] = i
            n_keep += 1
        else:
            drop_at[n_drop] = i
            n_drop += 1
    block = np.empty((max(n_drop, 1), max(n_drop, 1)))
    inverse = np.empty((max(n_drop, 1), max(n_drop, 1)))
    scale = np.empty(max(n_drop, 1))
    for i in range(n_drop):
        for j in range(n_drop):
            block[i, j] = information[drop_at[i], drop_at[j]]
        scale[i] = block[i, i]
    invert_semidefinite(block, n_drop, scale, inverse)
    gain = np.empty(max(n_drop, 1))
    for i in range(n_keep):
        for b in range(n_drop):
            value = 0.0
            for a in range(n_drop):
                value += information[keep_at[i], drop_at[a]] * inverse[a, b]
            gain[b] = value
        value = rhs[keep_at[i]]
        for b in range(n_drop):
            value -= gain[b] * rhs[drop_at[b]]
        out_rhs[i] = value
        for j in range(n_keep):
            value = information[keep_at[i], keep_at[j]]
            for b in range(n_drop):
                value -= gain[b] * information[drop_at[b], keep_at[j]]
            out[i, j] = value


@kernel
def prior_weight(information, weight):
    """K of trace((R - R_p)' K (R - R_p)) that has this information on a small rotation of the attitude.

    An axis known better than the other two together is taken as known as well as they are; returns
    whether there is a prior at all.
    """
    values = np.empty(3)
    axes = np.empty((3, 3))
    eigen_symmetric_3(information, values, axes)
    for i in range(3):
        values[i] = max(values[i], 0.0)
    values[2] = min(values[2], values[0] + values[1])
    half = 0.5 * (values[0] + values[1] + values[2])
    for r in range(3):
        for s in range(3):
            value = half if r == s else 0.0
            for i in range(3):
                value -= axes[r, i] * values[i] * axes[s, i]
            weight[r, s] = value
    return half > 0.0


@kernel
def rotation_of_axes(rank, frame, x, rot):
    """Attitude that turns the first `rank` axes of the body frame to x; of one axis, the most level one."""
    full = np.zeros((3, 3))
    for c in range(rank):
        for r in range(3):
            full[r, c] = x[3 * c + r]
    if rank == 1:
        least = 0
        for r in range(1, 3):
            if abs(full[r, 0]) < abs(full[least, 0]):
                least = r
        size = np.sqrt(1.0 - full[least, 0] ** 2)
        for r in range(3):
            full[r, 1] = ((1.0 if r == least else 0.0) - full[least, 0] * full[r, 0]) / size
    if rank < 3:
        full[0, 2] = full[1, 0] * full[2, 1] - full[2, 0] * full[1, 1]
        full[1, 2] = full[2, 0] * full[0, 1] - full[0, 0] * full[2, 1]
        full[2, 2] = full[0, 0] * full[1, 1] - full[1, 0] * full[0, 1]
    for r in range(3):
        for s in range(3):
            rot[r, s] = full[r, 0] * frame[s, 0] + full[r, 1] * frame[s, 1] + full[r, 2] * frame[s, 2]
    if rank == 1:
        # Turn about the axis until the body's down is as near to down as it can be.
        x0, x1, x2 = full[0, 0], full[1, 0], full[2, 0]
        v0, v1, v2 = rot[0, 2], rot[1, 2], rot[2, 2]
        dot = x0 * v0 + x1 * v1 + x2 * v2
        across, level = x0 * v1 - x1 * v0, v2 - dot * x2
        size = np.sqrt(across * across + level * level)
        if size > 1e-12:
            sine, cosine = across / size, level / size
            for s in range(3):
                v0, v1, v2 = rot[0, s], rot[1, s], rot[2, s]
                dot = (1.0 - cosine) * (x0 * v0 + x1 * v1 + x2 * v2)
                rot[0, s] = cosine * v0 + sine * (x1 * v2 - x2 * v1) + dot * x0
                rot[1, s] = cosine * v1 + sine * (x2 * v0 - x0 * v2) + dot * x1
                rot[2, s] = cosine * v2 + sine * (x0 * v1 - x1 * v0) + dot * x2


@kernel
def search_array(
    antenna, satellite, group, phase, code, design, wavelength, phase_variance, code_variance, body,
    position_sd, prior_rot, prior_information, margin, reach, max_nodes, integers_out, rot_out, cov_out, row,
    list_integers, list_cost, list_volume,
):  # fmt: skip
    """Find the integers of one epoch of a rigid array by their joint cost on the rotation group.

    Rows as in `ambiguity.array_model.ArrayEpoch` (n of them, sorted by group and satellite; all arrays
    contiguous float64 or int64).

    Parameters
    ----------
    antenna, satellite, group : ndarray of int64, shape (n,)
        Of each row; satellites numbered from 0, each number within one group.
    phase, code : ndarray, shape (n,)
        Metres, NaN where there is none.
    design : ndarray, shape (n, 3)
        Minus the direction to the satellite.
    wavelength, phase_variance, code_variance : ndarray, shape (n,)
    body : ndarray, shape (antennas, 3)
        Coordinates of the antennas in the body frame.
    position_sd : float
        Of each of them.
    prior_rot, prior_information : ndarray, shape (3, 3)
        Attitude known beforehand and the information on a small rotation of it in the frame of the
        design, 1/rad^2; zeros say that there is none.
    margin : float
        Candidates within this of the best count for the posterior probability.
    reach : float
        Candidates with a larger cost are of no interest.
    max_nodes : int
        Nodes and checks after which the search stops, unfinished.
    integers_out : ndarray of int64, shape (n,)
        Output: of the best candidate; 0 at rows that fix a constant and at rows without phase.
    rot_out, cov_out : ndarray, shape (3, 3)
        Output: its attitude, and the covariance of a small rotation of it (rad^2). Of antennas on one
        line the attitude is the most level one, and the covariance has none of the turn about the line.
    row : ndarray, shape (N_COLUMNS,)
        Output, see the constants.
    list_integers, list_cost, list_volume : ndarray, shapes (k, n), (k,), (k,)
        Output: the best candidates by cost, as many as found and fit (``row[N_LISTED]``), and the volume of
        their attitudes; complete up to ``row[COMPLETE_TO]``. No rows, no list.

    Returns
    -------
    int
        Reason code; `R_OK` says that a winner was found and proved.
    """
    n = phase.shape[0]
    n_antennas = body.shape[0]
    for i in range(n):
        integers_out[i] = 0
    for i in range(N_COLUMNS):
        row[i] = np.nan
    row[N_NODES] = 0.0
    row[N_CANDIDATES] = 0.0
    row[N_LISTED] = 0.0
    for r in range(3):
        for s in range(3):
            rot_out[r, s] = np.nan
            cov_out[r, s] = np.nan

    # The reference antenna has most phases.
    has_phase = np.empty(n, np.bool_)
    has_code = np.empty(n, np.bool_)
    observed = np.empty(n)
    ranged = np.empty(n)
    n_of_antenna = np.zeros(n_antennas, np.int64)
    weight = np.empty(n)
    code_weight = np.empty(n)
    for i in range(n):
        has_phase[i] = phase[i] == phase[i]
        has_code[i] = code[i] == code[i]
        observed[i] = phase[i] if has_phase[i] else 0.0
        ranged[i] = code[i] if has_code[i] else 0.0
        weight[i] = 1.0 / phase_variance[i] if has_phase[i] else 0.0
        code_weight[i] = 1.0 / code_variance[i] if has_code[i] else 0.0
        if has_phase[i]:
            n_of_antenna[antenna[i]] += 1
    reference = 0
    for a in range(n_antennas):
        if n_of_antenna[a] > n_of_antenna[reference]:
            reference = a
    row[REFERENCE] = reference
    role = np.empty(n, np.int64)
    sees_reference = np.empty(n, np.int64)
    spare = np.empty(n, np.int64)
    reduce_rows(n, has_code, antenna, satellite, group, reference, n_antennas, ranged, spare, role)
    reduce_rows(
        n, has_phase, antenna, satellite, group, reference, n_antennas, observed, role, sees_reference
    )
    offset = np.zeros(n)
    n_listed_of = np.zeros(n_antennas, np.int64)
    n_extra_of = np.zeros(n_antennas, np.int64)
    n_extra = 0
    for i in range(n):
        if role[i] >= 0 or role[i] == EXTRA:
            offset[i] = np.floor(observed[i] / wavelength[i] + 0.5)
            observed[i] -= offset[i] * wavelength[i]
            if role[i] >= 0:
                n_listed_of[antenna[i]] += 1
            else:
                n_extra_of[antenna[i]] += 1
                n_extra += 1

    # Slots: antennas with a list, those with most integers and the shortest first; then the others.
    slot = np.empty(n_antennas, np.int64)
    taken = np.zeros(n_antennas, np.int64)
    of_slot = np.empty(n_antennas, np.int64)
    vectors = np.zeros((n_antennas, 3))
    n_lists = 0
    n_slots = 0
    for t in range(n_antennas - 1):
        best, best_square = -1, 0.0
        for a in range(n_antennas):
            if a == reference or taken[a] == 1:
                continue
            square = 0.0
            for r in range(3):
                square += (body[a, r] - body[reference, r]) ** 2
            if (
                best < 0
                or n_listed_of[a] > n_listed_of[best]
                or (n_listed_of[a] == n_listed_of[best] and square < best_square)
            ):
                best, best_square = a, square
        taken[best] = 1
        slot[best] = t
        of_slot[t] = best
        for r in range(3):
            vectors[t, r] = body[best, r] - body[reference, r]
        if n_listed_of[best] > 0 and best_square > 0.0:
            n_lists += 1
    slot[reference] = -1
    n_slots = n_antennas - 1
    m_all = 3 * n_slots

    # What the codes say of all vectors.
    code_information = np.zeros((m_all, m_all))
    code_rhs = np.zeros(m_all)
    projector = np.empty((n, n))
    project_rows(n, has_code, antenna, satellite, group, code_weight, n_antennas, projector)
    for i in range(n):
        t = slot[antenna[i]]
        if not has_code[i] or t < 0:
            continue
        for j in range(n):
            value = projector[i, j]
            u = slot[antenna[j]]
            if value == 0.0 or not has_code[j]:
                continue
            for r in range(3):
                code_rhs[3 * t + r] += design[i, r] * value * ranged[j]
                if u >= 0:
                    for s in range(3):
                        code_information[3 * t + r, 3 * u + s] += design[i, r] * value * design[j, s]
    # Who takes part: those with a list, with an integer of their own, or with a code that says something.
    n_full = n_lists
    for t in range(n_lists, n_slots):
        a = of_slot[t]
        trace = 0.0
        for r in range(3):
            trace += code_information[3 * t + r, 3 * t + r]
        if n_extra_of[a] == 0 and not trace > 1e-6:
            continue
        # Exchange with the first slot not yet known to take part.
        u = n_full
        if u != t:
            b = of_slot[u]
            of_slot[u], of_slot[t] = a, b
            slot[a], slot[b] = u, t
            for r in range(3):
                vectors[u, r], vectors[t, r] = vectors[t, r], vectors[u, r]
                p, q = 3 * u + r, 3 * t + r
                code_rhs[p], code_rhs[q] = code_rhs[q], code_rhs[p]
                for s in range(m_all):
                    code_information[p, s], code_information[q, s] = (
                        code_information[q, s], code_information[p, s],
                    )  # fmt: skip
            for r in range(3):
                p, q = 3 * u + r, 3 * t + r
                for s in range(m_all):
                    code_information[s, p], code_information[s, q] = (
                        code_information[s, q], code_information[s, p],
                    )  # fmt: skip
        n_full += 1
    for t in range(n_full, n_slots):
        slot[of_slot[t]] = -1
    is_partial = n_extra > 0 or n_full > n_lists
    n_integers = n_extra
    sizes = np.zeros(max(n_lists, 1), np.int64)
    first_row = np.zeros(max(n_lists, 1), np.int64)
    integer_row = np.empty(n, np.int64)
    p = 0
    n_most = 1
    for t in range(n_lists):
        first_row[t] = p
        for i in range(n):
            if role[i] == of_slot[t]:
                integer_row[p] = i
                p += 1
        sizes[t] = p - first_row[t]
        n_most = max(n_most, sizes[t])
    n_in_lists = p
    for i in range(n):
        if role[i] == EXTRA:
            integer_row[p] = i
            p += 1
    n_integers = p
    row[N_INTEGERS] = n_integers
    if n_integers == 0:
        return R_TOO_FEW_SATELLITES
    m_full = 3 * n_full
    scale = np.empty(max(m_all, 1))
    spread = np.empty((max(m_all, 1), max(m_all, 1)))
    for i in range(m_full):
        scale[i] = code_information[i, i]
    code_rank = invert_semidefinite(code_information, m_full, scale, spread)
    tolerance = 0.0
    for t in range(n_full):
        square = vectors[t, 0] ** 2 + vectors[t, 1] ** 2 + vectors[t, 2] ** 2
        tolerance = max(tolerance, 1e-6 * np.sqrt(square))
    tolerance = max(tolerance, 2.0 * position_sd)
    prior = np.empty((3, 3))
    has_prior = prior_weight(prior_information, prior)
    frame = np.zeros((3, 3))
    full_rank = body_frame(n_full, vectors, tolerance, frame)
    if full_rank == 0:
        return R_WEAK_GEOMETRY
    if has_prior:
        full_rank = 3
    row[RANK] = full_rank
    dof = n_integers + code_rank - (2 if full_rank == 1 else 3) + (3 if has_prior else 0)
    row[DOF] = dof
    variance = position_sd * position_sd
    shell_variance = (4.0 if has_prior else 2.0) * variance

    use = np.empty(n, np.bool_)
    slot_now = np.empty(n_antennas, np.int64)
    keep = np.zeros(max(m_all, 1), np.bool_)
    part_information = np.zeros((max(m_all, 1), max(m_all, 1)))
    part_rhs = np.zeros(max(m_all, 1))
    linear = np.zeros(n_integers)
    quadratic = np.zeros((n_integers, n_integers))
    information = np.zeros((9, 9))
    inverse = np.zeros((9, 9))
    centre = np.zeros(9)
    turn = np.zeros((9, n_integers))
    counts = np.zeros(max(n_lists, 1), np.int64)
    metres = np.empty((max(n_lists, 1), _LIST_CAPACITY, n_most))
    integers = np.empty((max(n_lists, 1), _LIST_CAPACITY, n_most))
    list_costs = np.empty((max(n_lists, 1), _LIST_CAPACITY))
    z_out = np.empty((_LIST_CAPACITY, n_most))
    z_cost = np.empty(_LIST_CAPACITY)
    width = max(n_lists, 1)
    parts = np.zeros((_PART_CAPACITY, width), np.int64)
    part_cost = np.zeros(_PART_CAPACITY)
    out = np.zeros((_PART_CAPACITY, width), np.int64)
    out_cost = np.empty(_PART_CAPACITY)
    out_volume = np.empty(_PART_CAPACITY)
    out_share = np.empty(_PART_CAPACITY)
    out_extra = np.zeros((_PART_CAPACITY if n_extra > 0 else 1, max(n_extra, 1)))
    extra_observed = np.empty(max(n_extra, 1))
    extra_wavelength = np.empty(max(n_extra, 1))
    for i in range(n_extra):
        extra_observed[i] = observed[integer_row[n_in_lists + i]]
        extra_wavelength[i] = wavelength[integer_row[n_in_lists + i]]
    nodes = 0
    bound = min(dof + 10.0, reach)
    complete_to = bound
    constant = 0.0
    rank = 1
    best = -1
    n_out = 0
    reason = R_OK
    while True:
        is_complete = True
        for t in range(n_lists):
            for i in range(m_full):
                keep[i] = i // 3 == t
            marginal_information(code_information, code_rhs, m_full, keep, part_information, part_rhs)
            length = np.sqrt(vectors[t, 0] ** 2 + vectors[t, 1] ** 2 + vectors[t, 2] ** 2)
            if has_prior:
                stiffest = prior[0, 0] + prior[1, 1] + prior[2, 2]
                share = 1.0 / (length * length + shell_variance * stiffest)
                for r in range(3):
                    for s in range(3):
                        part_information[r, s] += share * prior[r, s]
                        for q in range(3):
                            part_rhs[r] += share * prior[r, s] * prior_rot[s, q] * vectors[t, q]
            count, visited, whole = list_baseline(
                n, sizes[t], integer_row[first_row[t] : first_row[t] + sizes[t]], antenna, satellite, group,
                reference, role, sees_reference, observed, wavelength, phase_variance, design,
                part_information, part_rhs, length, shell_variance, bound, max_nodes - nodes, z_out, z_cost,
            )  # fmt: skip
            nodes += visited
            is_complete = is_complete and whole
            counts[t] = count
            for k in range(count):
                list_costs[t, k] = z_cost[k]
                for j in range(sizes[t]):
                    i = integer_row[first_row[t] + j]
                    integers[t, k, j] = z_out[k, j]
                    metres[t, k, j] = observed[i] - wavelength[i] * z_out[k, j]
        # Join list after list; the last one, or what follows it, decides.
        n_parts = 1
        part_cost[0] = 0.0
        limit = bound
        for t in range(n_lists + 1):
            is_last = t == n_lists
            if (is_last and not is_partial) or not is_complete:
                continue
            if not is_last and t == 0 and (n_lists > 1 or is_partial):
                n_parts = counts[0]
                for k in range(n_parts):
                    parts[k, 0] = k
                    part_cost[k] = list_costs[0, k]
                continue
            is_final = is_last or (t == n_lists - 1 and not is_partial)
            n_now = n_full if is_last else t + 1
            for a in range(n_antennas):
                slot_now[a] = slot[a] if slot[a] < n_now else -1
            for i in range(n):
                a = antenna[i]
                if is_last:
                    use[i] = has_phase[i] and (a == reference or slot_now[a] >= 0)
                else:
                    use[i] = sees_reference[i] == 1 and has_phase[i] and (a == reference or slot_now[a] >= 0)
            for i in range(m_full):
                keep[i] = i < 3 * n_now
            marginal_information(code_information, code_rhs, m_full, keep, part_information, part_rhs)
            rank = body_frame(n_now, vectors, tolerance, frame)
            if is_final and has_prior:
                rank = 3
            n_unknown = n_integers if is_last else first_row[t] + sizes[t]
            constant = prepare_subset(
                n, use, integer_row, n_unknown, antenna, satellite, group, weight, design, slot_now, n_now,
                n_antennas, part_information, part_rhs, vectors, variance, rank, frame, prior, prior_rot, _MU,
                information, inverse, centre, turn, quadratic, linear,
            )  # fmt: skip
            if is_last:
                n_out, limit, visited, whole = join_extras(
                    n_parts, parts, part_cost, n_lists, sizes, metres, n_extra, extra_observed,
                    extra_wavelength, constant, linear, quadratic, centre, turn, information, inverse, rank,
                    limit, margin, max_nodes - nodes, out, out_cost, out_volume, out_share, out_extra,
                )  # fmt: skip
            else:
                n_out, limit, visited, whole = join(
                    n_parts, parts, part_cost, t, t, counts, sizes, metres, constant, linear, quadratic,
                    centre, turn, information, inverse, rank, limit, margin, is_final, max_nodes - nodes,
                    out, out_cost, out_volume, out_share,
                )  # fmt: skip
            nodes += visited
            is_complete = is_complete and whole
            if not is_final:
                n_parts = n_out
                for k in range(n_parts):
                    part_cost[k] = out_cost[k]
                    for u in range(t + 1):
                        parts[k, u] = out[k, u]
        if not is_complete:
            reason = R_SEARCH_LIMIT
            break
        best = -1
        for k in range(n_out):
            if best < 0 or out_cost[k] < out_cost[best]:
                best = k
        complete_to = limit
        if best >= 0:
            wanted = out_cost[best] + margin
            if wanted <= bound + 1e-9:
                complete_to = min(limit, wanted)
                break
            bound = wanted
        elif bound >= reach:
            break
        else:
            bound = min(2.0 * bound + 10.0, reach)
    row[N_NODES] = nodes
    if reason != R_OK:
        return reason
    if best < 0:
        return R_NO_CANDIDATE
    least = out_cost[best]
    mass = 0.0
    second = complete_to
    n_candidates = 0
    for k in range(n_out):
        if out_cost[k] <= complete_to:
            n_candidates += 1
            mass += out_volume[k] * np.exp(0.5 * (least - out_cost[k]))
            if k != best:
                second = min(second, out_cost[k])
    row[COST] = least
    row[SECOND_COST] = second
    row[PROBABILITY] = out_volume[best] / mass
    row[ATTITUDE_SHARE] = out_share[best]
    row[N_CANDIDATES] = n_candidates
    row[COMPLETE_TO] = complete_to
    for t in range(n_lists):
        for j in range(sizes[t]):
            i = integer_row[first_row[t] + j]
            integers_out[i] = np.int64(offset[i] + integers[t, out[best, t], j])
    for j in range(n_extra):
        i = integer_row[n_in_lists + j]
        integers_out[i] = np.int64(offset[i] + out_extra[best, j])
    # The winner's attitude.
    x_all = np.empty(n_integers)
    for p in range(n_integers):
        i = integer_row[p]
        x_all[p] = observed[i] - wavelength[i] * (integers_out[i] - offset[i])
    k = 3 * rank
    x0 = np.empty(k)
    c0 = constant
    for p in range(n_integers):
        value = 2.0 * linear[p]
        for q in range(n_integers):
            value += quadratic[p, q] * x_all[q]
        c0 += value * x_all[p]
    for i in range(k):
        x0[i] = centre[i]
        for q in range(n_integers):
            x0[i] += turn[i, q] * x_all[q]
    x = np.empty(k)
    other = np.empty(k)
    hessian = np.empty((3, 3))
    scratch = np.empty((3, 3))
    extra = np.empty(2)
    weak = np.zeros(3)
    block = np.zeros((3, 3))
    values = np.empty(3)
    axes = np.empty((3, 3))
    for c in range(rank):
        for r in range(3):
            for s in range(3):
                block[r, s] += information[3 * c + r, 3 * c + s]
    eigen_symmetric_3(block, values, axes)
    for r in range(3):
        weak[r] = axes[r, 0]
    zero = 0.0
    minimise(rank, information, x0, c0, np.inf, weak, zero, x, other, hessian, scratch, extra)
    rotation_of_axes(rank, frame, x, rot_out)
    for r in range(3):
        values[r] = 1e-6 * hessian[r, r]
    invert_semidefinite(hessian, 3, values, cov_out)
    if rank == 1:
        for r in range(3):
            for s in range(3):
                cov_out[r, s] -= x[r] * x[s]
    # The list.
    capacity = list_cost.shape[0]
    if capacity > 0:
        order = np.empty(n_out, np.int64)
        sort_by_cost(n_out, out_cost, order)
        n_listed = 0
        for p in range(n_out):
            j = order[p]
            if out_cost[j] > complete_to:
                break
            if n_listed == capacity:
                row[COMPLETE_TO] = out_cost[j]
                break
            for i in range(n):
                list_integers[n_listed, i] = 0
            for t in range(n_lists):
                for q in range(sizes[t]):
                    i = integer_row[first_row[t] + q]
                    list_integers[n_listed, i] = np.int64(offset[i] + integers[t, out[j, t], q])
            for q in range(n_extra):
                i = integer_row[n_in_lists + q]
                list_integers[n_listed, i] = np.int64(offset[i] + out_extra[j, q])
            list_cost[n_listed] = out_cost[j]
            list_volume[n_listed] = out_volume[j]
            n_listed += 1
        row[N_LISTED] = n_listed
    return reason
