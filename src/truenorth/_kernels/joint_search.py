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

from .constrained import eigen_symmetric_3
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
_VERY_WEAK = 100.0
_LIST_CAPACITY = 8192
_PART_CAPACITY = 32768
_TREE_CAPACITY = 65536


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
def complete_frame(rank, frame):
    """Complete a right-handed frame (columns) of one or two axes; of one by the most level second axis."""
    if rank == 1:
        size = np.sqrt(frame[0, 0] ** 2 + frame[1, 0] ** 2)
        is_upright = size < 1e-9
        frame[0, 1] = 0.0 if is_upright else -frame[1, 0] / size
        frame[1, 1] = 1.0 if is_upright else frame[0, 0] / size
        frame[2, 1] = 0.0
    for r in range(3):
        s, t = (r + 1) % 3, (r + 2) % 3
        frame[r, 2] = frame[s, 0] * frame[t, 1] - frame[t, 0] * frame[s, 1]


@kernel
def body_frame(n, vectors, tolerance, frame):
    """Orthonormal right-handed frame (columns) whose first axes span the vectors; returns their rank."""
    rest = np.empty((n, 3))
    for i in range(n):
        for r in range(3):
            rest[i, r] = vectors[i, r]
    rank = 0
    while rank < 3:
        best, largest = -1, tolerance
        for i in range(n):
            size = np.sqrt(rest[i, 0] ** 2 + rest[i, 1] ** 2 + rest[i, 2] ** 2)
            if size > largest * (1.0 + 1e-9):
                best, largest = i, size
        if best < 0:
            break
        for r in range(3):
            frame[r, rank] = rest[best, r] / largest
        for i in range(n):
            dot = 0.0
            for r in range(3):
                dot += rest[i, r] * frame[r, rank]
            for r in range(3):
                rest[i, r] -= dot * frame[r, rank]
        rank += 1
    if rank > 0:
        complete_frame(rank, frame)
    return rank


@kernel
def minimise(
    rank, a, centre, c0, bound, weak, weak_information, steady, n_starts, x, hessian, out
):  # fmt: skip
    """Least of c0 + (x - centre)' A (x - centre) over rotations of the `rank` axes x.

    Newton steps on the group, from a rotation near the centre and, unless that is too far for the bound,
    from the mirror image of the minimum through the plane across the weakest direction. Further pairs of
    starts are turned about the better known of the first two axes, all the way around.

    Parameters
    ----------
    a, centre : ndarray, shapes (3 rank, 3 rank), (3 rank,)
    c0, bound : float
    weak, weak_information : ndarray, shape (3,), float
        The direction of least information, and that information.
    steady, n_starts : int
        The better known one of the first two axes; 2 starts, or more where something is very weak.
    x : ndarray, shape (3, 3)
        Output: columns are the axes, completed to a right-handed frame.
    hessian : ndarray, shape (3, 3)
        Output: half the second derivatives for a small rotation; of one axis, plus that axis' square.
    out : ndarray, shape (2,)
        Output: volume of all attitudes found (inverse root of the determinant of the curvature), and the
        share of the best one.

    Returns
    -------
    float
        The least cost; infinite above the bound.
    """
    m = 3 * rank
    y = np.zeros((3, 3))
    trial = np.zeros((3, 3))
    turn = np.empty((3, m))
    off = np.empty(m)
    error = np.empty(m)
    h = np.empty((3, 3))
    inverse = np.empty((3, 3))
    step = np.empty(3)
    best = np.inf
    out[0] = 0.0
    out[1] = 1.0
    held, free = (steady, 1 - steady) if rank > 1 else (0, 1)
    for start in range(n_starts):
        height_square = 0.0
        for c in range(rank):
            height = 0.0
            square = 0.0
            for r in range(3):
                if start % 2 == 0:
                    y[r, c] = centre[3 * c + r]
                height += weak[r] * y[r, c]
                square += y[r, c] * y[r, c]
            height_square += height * height
            # The start: what the axes lack or exceed of their length goes to their weakest component.
            target = -height
            if start % 2 == 0:
                target = np.sqrt(max(1.0 - square + height * height, 0.0))
                if height < 0.0:
                    target = -target
            for r in range(3):
                y[r, c] += (target - height) * weak[r]
        if start % 2 == 1 and weak_information * height_square > bound - c0:
            continue
        for k in range(min(rank, 2)):
            c = held if k == 0 else free
            dot = 0.0
            square = 0.0
            for r in range(3):
                dot += y[r, c] * y[r, held]
            for r in range(3):
                if k == 1:
                    y[r, free] -= dot * y[r, held]
                square += y[r, c] * y[r, c]
            if square < 1e-12:
                # Nothing to start from: any axis across.
                least = 0
                for r in range(3):
                    if k == 1 and abs(y[r, held]) < abs(y[least, held]):
                        least = r
                cosine = y[least, held] if k == 1 else 0.0
                for r in range(3):
                    y[r, c] = (1.0 if r == least else 0.0) - cosine * y[r, held]
                square = 1.0 - cosine * cosine
            for r in range(3):
                y[r, c] /= np.sqrt(square)
        if rank > 1 and start > 1 and start % 2 == 0:
            angle = np.pi * start / n_starts * 2.0
            for r in range(3):
                s, t = (r + 1) % 3, (r + 2) % 3
                trial[r, free] = np.cos(angle) * y[r, free] + np.sin(angle) * (
                    y[s, held] * y[t, free] - y[t, held] * y[s, free]
                )
            for r in range(3):
                y[r, free] = trial[r, free]
        complete_frame(rank, y)
        cost = np.inf
        determinant = 1.0
        is_above = False
        for iteration in range(60):
            for c in range(rank):
                for r in range(3):
                    off[3 * c + r] = y[r, c] - centre[3 * c + r]
            cost = c0
            for i in range(m):
                value = 0.0
                for j in range(m):
                    value += a[i, j] * off[j]
                error[i] = value
                cost += value * off[i]
            # turn[r]: how the axes move with a rotation about r.
            along = 0.0
            for c in range(rank):
                for r in range(3):
                    s, t = (r + 1) % 3, (r + 2) % 3
                    turn[r, 3 * c + r] = 0.0
                    turn[r, 3 * c + s] = -y[t, c]
                    turn[r, 3 * c + t] = y[s, c]
                    along += error[3 * c + r] * y[r, c]
            gradient_square = 0.0
            for r in range(3):
                step[r] = 0.0
                for i in range(m):
                    step[r] -= turn[r, i] * error[i]
                gradient_square += step[r] * step[r]
                for s in range(3):
                    # The curvature of the group, then that of the quadratic form.
                    value = -along if r == s else 0.0
                    for c in range(rank):
                        value += 0.5 * (error[3 * c + r] * y[s, c] + error[3 * c + s] * y[r, c])
                    for i in range(m):
                        for j in range(m):
                            value += turn[r, i] * a[i, j] * turn[s, j]
                    if rank == 1:
                        # Turning about the only axis is no unknown.
                        value += y[r, 0] * y[s, 0]
                    h[r, s] = value
            is_convex = True
            size = abs(h[0, 0]) + abs(h[1, 1]) + abs(h[2, 2])
            while True:
                for r in range(3):
                    s, t = (r + 1) % 3, (r + 2) % 3
                    for q in range(3):
                        u, v = (q + 1) % 3, (q + 2) % 3
                        inverse[r, q] = h[s, u] * h[t, v] - h[s, v] * h[t, u]
                determinant = h[0, 0] * inverse[0, 0] + h[0, 1] * inverse[0, 1] + h[0, 2] * inverse[0, 2]
                if h[0, 0] > 0.0 and inverse[2, 2] > 0.0 and determinant > 0.0:
                    break
                # As much of the identity as makes a descent of the step.
                is_convex = False
                for r in range(3):
                    h[r, r] += size
            g0, g1, g2 = step[0], step[1], step[2]
            gain = 0.0
            angle_square = 0.0
            for r in range(3):
                step[r] = (inverse[r, 0] * g0 + inverse[r, 1] * g1 + inverse[r, 2] * g2) / determinant
                angle_square += step[r] * step[r]
            gain = step[0] * g0 + step[1] * g1 + step[2] * g2
            if gain < 1e-10:
                break
            # A quadratic step gains `gain`; many times that leads nowhere near the bound.
            if is_convex and iteration > 0 and cost - 8.0 * gain - 1.0 > bound:
                is_above = True
                break
            factor = min(1.0, 0.7 / np.sqrt(angle_square))
            reached = np.inf
            for _ in range(25):
                square = factor * factor * angle_square
                angle = np.sqrt(square)
                sinc = factor * (np.sin(angle) / angle if angle > 1e-8 else 1.0)
                versine = (1.0 - np.cos(angle)) / square if angle > 1e-4 else 0.5
                for c in range(rank):
                    dot = factor * (step[0] * y[0, c] + step[1] * y[1, c] + step[2] * y[2, c])
                    for r in range(3):
                        value = y[r, c] + versine * (dot * factor * step[r] - square * y[r, c])
                        for s in range(3):
                            value += sinc * step[s] * turn[s, 3 * c + r]
                        trial[r, c] = value
                        off[3 * c + r] = value - centre[3 * c + r]
                reached = c0
                for i in range(m):
                    value = 0.0
                    for j in range(m):
                        value += a[i, j] * off[j]
                    reached += value * off[i]
                if reached < cost:
                    break
                factor *= 0.3
            if not reached < cost:
                break
            for c in range(rank):
                for r in range(3):
                    y[r, c] = trial[r, c]
        if is_above:
            continue
        volume = 1.0 / np.sqrt(determinant)
        apart = 0.0
        for c in range(rank):
            for r in range(3):
                apart += (x[r, c] - y[r, c]) ** 2
        if best < np.inf and (apart < 1e-8 or (start > 1 and cost > best - 1e-6)):
            continue
        is_better = cost < best
        worse = max(cost, best)
        first_volume = out[0]
        ratio = 0.0
        if start > 0:
            # What the other attitude weighs against the better one.
            if is_better:
                ratio = first_volume / volume * np.exp(0.5 * (cost - worse))
            else:
                ratio = volume / first_volume * np.exp(0.5 * (best - worse))
        if is_better:
            best = cost
            out[0] = volume
            for r in range(3):
                for c in range(3):
                    hessian[r, c] = h[r, c]
                    if c < rank:
                        x[r, c] = y[r, c]
        out[0] *= 1.0 + ratio
        out[1] = 1.0 / (1.0 + ratio)
    if best < np.inf:
        complete_frame(rank, x)
    return best


@kernel
def prepare_subset(
    n, use, integer_row, n_integers, antenna, satellite, group, weight, design, slot, first_vector,
    end_vector, n_all, n_antennas, code_information, code_rhs, code_constant, body, position_variance, rank,
    frame, prior, prior_rot, mu, information, inverse, centre, turn, quadratic, linear,
):  # fmt: skip
    """Reduce the phases of some antennas, and what code and prior say of them, to a function of the integers.

    With x the phases less their integers at the rows `integer_row`,

        c_0(x) = constant + 2 linear' x + x' quadratic x,      X_0(x) = centre + turn x,

    and C = c_0 + (X - X_0)' information (X - X_0), X the first `rank` axes of the body frame as turned.

    Parameters
    ----------
    slot : ndarray of int64, shape (n_antennas,)
        Place of each antenna among the vectors; negative for the reference and those left out.
    first_vector, end_vector, n_all : int
        The vectors that the subset has, and how many the codes speak of.
    code_information, code_rhs, code_constant : ndarray, shapes (3 n_all, 3 n_all), (3 n_all,), float
        Cost of the codes: B' information B - 2 rhs' B + constant, zero at its least.
    body : ndarray, shape (n_all, 3)
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
    # The cost as a quadratic form g of (vectors or their deviations, axes X, phases x, 1).
    at_axes = 3 * n_all
    at_phases = at_axes + 3 * rank
    at_one = at_phases + n_integers
    g = np.zeros((at_one + 1, at_one + 1))
    projector = np.empty((n, n))
    project_rows(n, use, antenna, satellite, group, weight, n_antennas, projector)
    place = np.full(n, -1, np.int64)
    for p in range(n_integers):
        place[integer_row[p]] = at_phases + p
    for i in range(n):
        t = 3 * slot[antenna[i]]
        for j in range(n):
            value = projector[i, j]
            u = 3 * slot[antenna[j]]
            if value == 0.0 or u < 0:
                continue
            for s in range(3):
                if place[i] >= 0:
                    g[u + s, place[i]] -= design[j, s] * value
                if t >= 0:
                    for r in range(3):
                        g[t + r, u + s] += design[i, r] * value * design[j, s]
            if place[i] >= 0 and place[j] >= 0:
                g[place[i], place[j]] = value
    for p in range(at_axes):
        g[p, at_one] = -code_rhs[p]
        for q in range(at_axes):
            g[p, q] += code_information[p, q]
    # Vectors of the subset are the turned body vectors, in terms of the axes, plus deviations.
    for c in range(rank):
        for t in range(first_vector, end_vector):
            along = frame[0, c] * body[t, 0] + frame[1, c] * body[t, 1] + frame[2, c] * body[t, 2]
            for r in range(3):
                for q in range(at_one + 1):
                    if q < at_axes or q >= at_phases:
                        g[at_axes + 3 * c + r, q] += along * g[3 * t + r, q]
    for c in range(rank):
        for t in range(first_vector, end_vector):
            along = frame[0, c] * body[t, 0] + frame[1, c] * body[t, 1] + frame[2, c] * body[t, 2]
            for r in range(3):
                for q in range(at_axes, at_phases):
                    g[q, at_axes + 3 * c + r] += along * g[q, 3 * t + r]
    g[at_one, at_one] = code_constant - mu * rank
    for c in range(rank):
        for r in range(3):
            p = at_axes + 3 * c + r
            g[p, p] += mu
            for s in range(3):
                expected = 0.0
                for q in range(3):
                    expected += prior_rot[s, q] * frame[q, c]
                g[p, at_axes + 3 * c + s] += prior[r, s]
                g[p, at_one] -= prior[r, s] * expected
                for q in range(3):
                    g[at_one, at_one] += prior_rot[r, q] * frame[q, c] * prior[r, s] * expected
    # Eliminate the vectors that are not of the subset, and the deviations, their covariance v (I + 1 1').
    for p in range(at_one + 1):
        for q in range(p):
            if p >= at_phases:
                g[p, q] = g[q, p]
            else:
                g[q, p] = g[p, q]
    scale = np.empty(at_axes)
    for p in range(at_axes):
        scale[p] = 1e-10 * g[p, p]
    if position_variance > 0.0:
        share = 1.0 / (end_vector - first_vector + 1.0)
        for p in range(3 * first_vector, 3 * end_vector):
            for q in range(3 * first_vector + p % 3, 3 * end_vector, 3):
                g[p, q] += ((1.0 if p == q else 0.0) - share) / position_variance
    for k in range(at_axes):
        is_exact = position_variance == 0.0 and k >= 3 * first_vector and k < 3 * end_vector
        if not is_exact and g[k, k] > scale[k]:
            for p in range(k + 1, at_one + 1):
                factor = g[p, k] / g[k, k]
                if factor != 0.0:
                    for q in range(k + 1, at_one + 1):
                        g[p, q] -= factor * g[k, q]
    # Eliminate the axes: what they cost where nothing makes a rotation of them.
    k = 3 * rank
    mus = np.full(k, mu)
    for p in range(k):
        for q in range(k):
            information[p, q] = g[at_axes + p, at_axes + q]
    invert_semidefinite(information, k, mus, inverse)
    for p in range(k):
        for q in range(at_phases, at_one + 1):
            value = 0.0
            for s in range(k):
                value -= inverse[p, s] * g[at_axes + s, q]
            if q == at_one:
                centre[p] = value
            else:
                turn[p, q - at_phases] = value
    constant = g[at_one, at_one]
    for s in range(k):
        constant += g[at_one, at_axes + s] * centre[s]
    for p in range(n_integers):
        linear[p] = g[at_phases + p, at_one]
        for s in range(k):
            linear[p] += g[at_phases + p, at_axes + s] * centre[s]
        for q in range(n_integers):
            value = g[at_phases + p, at_phases + q]
            for s in range(k):
                value += g[at_phases + p, at_axes + s] * turn[s, q]
            quadratic[p, q] = value
    return constant


@kernel
def enumerate_rows(
    n_old, n_new, x, c_old, linear, quadratic, covariance, lower, diag, transform, back, observed,
    wavelength, bound, max_nodes, z_found, z_cost, integers, metres,
):  # fmt: skip
    """All integers of the last `n_new` phases for which c_0 is at most `bound`, the first x being given.

    Writes ``integers[:count, :n_new]`` and ``metres[:count, :n_new]``, the phases less these. Returns
    (count, nodes, is complete).
    """
    a = np.empty(n_new)
    whole = np.empty(n_new)
    slope = np.empty(n_new)
    z_float = np.zeros(n_new)
    for i in range(n_new):
        slope[i] = linear[n_old + i]
        for q in range(n_old):
            slope[i] += quadratic[n_old + i, q] * x[q]
    least = c_old
    for i in range(n_new):
        value = 0.0
        for j in range(n_new):
            value += covariance[i, j] * wavelength[i] * wavelength[j] * slope[j]
        least -= slope[i] * value
        a[i] = (observed[i] + value) / wavelength[i]
        whole[i] = np.floor(a[i] + 0.5)
    for i in range(n_new):
        for j in range(n_new):
            z_float[i] += transform[j, i] * (a[j] - whole[j])
    if least > bound:
        return 0, 1, True
    count, nodes, status = enumerate_within(
        n_new, lower, diag, z_float, bound - least, z_found, z_cost, max_nodes
    )
    for k in range(count):
        for i in range(n_new):
            value = whole[i]
            for j in range(n_new):
                value += back[i, j] * z_found[k, j]
            integers[k, i] = np.floor(value + 0.5)
            metres[k, i] = observed[i] - wavelength[i] * integers[k, i]
    return count, nodes, status == 0


@kernel
def join(
    n_parts, parts, part_cost, n_lists, sizes, list_metres, t, n_new, count, new_metres, new_integers,
    observed, wavelength, constant, linear, quadratic, centre, turn, information, inverse, rank, bound,
    margin, is_list, is_final, max_nodes, out, out_cost, out_volume, out_share, out_metres, out_integers,
    best_frame, best_hessian,
):  # fmt: skip
    """Join partial candidates of `n_lists` baselines with candidates of `n_new` more phases.

    Parameters
    ----------
    parts, part_cost : ndarray
        Candidate of each baseline (n_parts, lists), and cost, of what was joined before.
    sizes, list_metres : ndarray, shapes (lists,), (lists, capacity, n_max)
        Number of phases of each baseline, and the phases less integers of its candidates.
    t : int
        Where the index of the new candidate goes.
    count, new_metres, new_integers : int, ndarray, ndarray
        The new candidates, the same for all parts; a negative count has those of each part enumerated
        from `observed` and `wavelength` (n_new,) into these arrays.
    constant ... inverse
        Of `prepare_subset`, for the baselines joined before and the new phases.
    bound, margin : float
        Candidates above the bound are dropped; where `is_final` the bound shrinks to best + margin.
    is_list : bool
        Only the cheap tests are made, and the cost is c_0.
    out, out_cost, out_volume, out_share, out_metres, out_integers : ndarray
        Output, one row for each joined candidate; the last two only of those enumerated here.
    best_frame, best_hessian : ndarray, shape (3, 3)
        Output: axes and curvature of the best.

    Returns
    -------
    tuple of (int, float, int, bool)
        Number joined, bound, nodes and checks, whether all was kept.
    """
    k = 3 * rank
    n_old = np.int64(0)
    for u in range(n_lists):
        n_old += sizes[u]
    is_enumerated = count < 0
    capacity = out_cost.shape[0]
    # Factors for the enumeration.
    m = n_new if is_enumerated else 1
    tree_room = _TREE_CAPACITY if is_enumerated else 1
    lower = np.empty((m, m))
    diag = np.empty(m)
    transform = np.empty((m, m))
    back = np.empty((m, m))
    covariance = np.empty((m, m))
    weights = np.empty((m, m))
    scale = np.empty(m)
    z_found = np.empty((tree_room, m))
    z_cost = np.empty(tree_room)
    if is_enumerated:
        for i in range(m):
            for j in range(m):
                weights[i, j] = wavelength[i] * wavelength[j] * quadratic[n_old + i, n_old + j]
            scale[i] = 1e-4 * weights[i, i]
        invert_semidefinite(weights, m, scale, covariance)
        if decorrelate(covariance, m, lower, diag, transform, back) != 0:
            return 0, bound, 0, False
    # The largest variances of the axes, and the direction of least information.
    block = np.zeros((3, 3))
    values = np.empty(3)
    axes = np.empty((3, 3))
    spectrum = np.empty(rank)
    weak = np.empty(3)
    weakest = np.inf
    steady = np.int64(0)
    known = np.zeros(rank)
    for c in range(rank + 1):
        for r in range(3):
            for s in range(3):
                block[r, s] = 0.0
                for d in range(rank):
                    if c == rank:
                        block[r, s] += information[3 * d + r, 3 * d + s]
                    elif c == d:
                        block[r, s] = inverse[3 * c + r, 3 * c + s]
        eigen_symmetric_3(block, values, axes)
        if c < rank:
            # The least information on an axis by itself, whatever the others are.
            spectrum[c] = values[2]
            known[c] = 1.0 / values[2]
    for r in range(3):
        weak[r] = axes[r, 0]
    for c in range(rank):
        value = 0.0
        for r in range(3):
            for s in range(3):
                value += weak[r] * information[3 * c + r, 3 * c + s] * weak[s]
        weakest = min(weakest, value)
    n_starts = np.int64(2)
    for c in range(min(rank, 2)):
        if known[c] > known[steady]:
            steady = np.int64(1)
        if rank > 1 and known[c] < _VERY_WEAK:
            n_starts = np.int64(12)
    room = tree_room if is_enumerated else max(count, 1)
    new_cost = np.empty(room)
    partner = np.empty((room, max(n_old, 1)))
    shift = np.empty((room, k))
    x_old = np.empty(max(n_old, 1))
    at = np.empty(k)
    x0 = np.empty(k)
    frame = np.zeros((3, 3))
    hessian = np.empty((3, 3))
    extra = np.empty(2)
    n_out = 0
    nodes = 0
    least = np.inf
    is_complete = True
    is_fresh = not is_enumerated
    order = np.empty(n_parts, np.int64)
    sort_by_cost(n_parts, part_cost, order)
    for index in range(n_parts):
        part = order[index]
        if part_cost[part] > bound:
            break
        p = 0
        for u in range(n_lists):
            for q in range(sizes[u]):
                x_old[p] = list_metres[u, parts[part, u], q]
                p += 1
        c_old = constant
        for i in range(n_old):
            value = 2.0 * linear[i]
            for q in range(n_old):
                value += quadratic[i, q] * x_old[q]
            c_old += value * x_old[i]
        for i in range(k):
            at[i] = centre[i]
            for q in range(n_old):
                at[i] += turn[i, q] * x_old[q]
        if is_enumerated:
            count, visited, whole = enumerate_rows(
                n_old, n_new, x_old, c_old, linear, quadratic, covariance, lower, diag, transform, back,
                observed, wavelength, bound, max_nodes, z_found, z_cost, new_integers, new_metres,
            )  # fmt: skip
            nodes += visited
            is_complete = is_complete and whole
        nodes += 1 + count // 16
        if nodes > max_nodes:
            is_complete = False
        if not is_complete:
            break
        if is_enumerated or is_fresh:
            # Of each new candidate: its own cost, what multiplies the others' phases, its share of X_0.
            is_fresh = False
            for j in range(count):
                new_cost[j] = 0.0
                for p in range(n_new):
                    value = 2.0 * linear[n_old + p]
                    for q in range(n_new):
                        value += quadratic[n_old + p, n_old + q] * new_metres[j, q]
                    new_cost[j] += value * new_metres[j, p]
                for p in range(n_old):
                    partner[j, p] = 0.0
                    for q in range(n_new):
                        partner[j, p] += 2.0 * quadratic[p, n_old + q] * new_metres[j, q]
                for p in range(k):
                    shift[j, p] = 0.0
                    for q in range(n_new):
                        shift[j, p] += turn[p, n_old + q] * new_metres[j, q]
        for j in range(count):
            c0 = c_old + new_cost[j]
            for i in range(n_old):
                c0 += partner[j, i] * x_old[i]
            if c0 > bound:
                continue
            for i in range(k):
                x0[i] = at[i] + shift[j, i]
            if not is_near_rotation(rank, x0, inverse, spectrum, bound - c0):
                continue
            cost = c0
            if not is_list:
                nodes += 10
                cost = minimise(
                    rank, information, x0, c0, bound, weak, weakest, steady, n_starts, frame, hessian, extra
                )
                if cost > bound:
                    continue
            if n_out == capacity:
                # Drop what a bound that has shrunk since no longer admits.
                kept = 0
                for i in range(n_out):
                    if out_cost[i] <= bound:
                        for u in range(out.shape[1]):
                            out[kept, u] = out[i, u]
                        if is_enumerated:
                            for p in range(n_new):
                                out_metres[kept, p] = out_metres[i, p]
                                out_integers[kept, p] = out_integers[i, p]
                        out_cost[kept] = out_cost[i]
                        out_volume[kept] = out_volume[i]
                        out_share[kept] = out_share[i]
                        kept += 1
                n_out = kept
                if n_out == capacity:
                    return n_out, bound, nodes, False
            for u in range(n_lists):
                out[n_out, u] = parts[part, u]
            if is_enumerated:
                for p in range(n_new):
                    out_metres[n_out, p] = new_metres[j, p]
                    out_integers[n_out, p] = new_integers[j, p]
            else:
                out[n_out, t] = j
            out_cost[n_out] = cost
            out_volume[n_out] = extra[0]
            out_share[n_out] = extra[1]
            n_out += 1
            if is_final and cost < least:
                least = cost
                bound = min(bound, cost + margin)
                for r in range(3):
                    for s in range(3):
                        best_frame[r, s] = frame[r, s]
                        best_hessian[r, s] = hessian[r, s]
    return n_out, bound, nodes, is_complete


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
        Candidates whose cost exceeds the degrees of freedom by more are of no interest.
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
        row[i] = 0.0 if i in (N_NODES, N_CANDIDATES, N_LISTED) else np.nan
    for r in range(3):
        for s in range(3):
            rot_out[r, s] = np.nan
            cov_out[r, s] = np.nan
    has_phase = np.empty(n, np.bool_)
    has_code = np.empty(n, np.bool_)
    observed = np.empty(n)
    ranged = np.empty(n)
    weight = np.empty(n)
    code_weight = np.empty(n)
    n_phases_of = np.zeros(n_antennas, np.int64)
    for i in range(n):
        has_phase[i] = phase[i] == phase[i]
        has_code[i] = code[i] == code[i]
        observed[i] = phase[i] if has_phase[i] else 0.0
        ranged[i] = code[i] if has_code[i] else 0.0
        weight[i] = 1.0 / phase_variance[i] if has_phase[i] else 0.0
        code_weight[i] = 1.0 / code_variance[i] if has_code[i] else 0.0
        if has_phase[i]:
            n_phases_of[antenna[i]] += 1
    # The reference antenna has most phases.
    reference = np.int64(0)
    for a in range(n_antennas):
        if n_phases_of[a] > n_phases_of[reference]:
            reference = a
    role = np.empty(n, np.int64)
    sees_reference = np.empty(n, np.int64)
    reduce_rows(n, has_code, antenna, satellite, group, reference, n_antennas, ranged, role, sees_reference)
    reduce_rows(
        n, has_phase, antenna, satellite, group, reference, n_antennas, observed, role, sees_reference
    )
    offset = np.zeros(n)
    n_own = np.zeros(n_antennas, np.int64)
    n_integers = 0
    for i in range(n):
        if role[i] >= 0 or role[i] == EXTRA:
            offset[i] = np.floor(observed[i] / wavelength[i] + 0.5)
            observed[i] -= offset[i] * wavelength[i]
            # One integer of a list counts for more than all others.
            n_own[antenna[i]] += n if role[i] >= 0 else 1
            n_integers += 1
    row[REFERENCE] = reference
    row[N_INTEGERS] = n_integers
    if n_integers == 0:
        return R_TOO_FEW_SATELLITES

    # Slots of the antennas that take part: those with most integers in lists, and the shortest, first.
    slot = np.full(n_antennas, -1, np.int64)
    vectors = np.zeros((n_antennas, 3))
    sizes = np.zeros(n_antennas, np.int64)
    first_row = np.zeros(n_antennas + 1, np.int64)
    integer_row = np.empty(n_integers, np.int64)
    n_full = np.int64(0)
    n_lists = 0
    n_most = 1
    tolerance = 2.0 * position_sd
    n_listed = 0
    while True:
        best, shortest = -1, 0.0
        for a in range(n_antennas):
            if a == reference or slot[a] >= 0 or n_own[a] == 0:
                continue
            square = 0.0
            for r in range(3):
                square += (body[a, r] - body[reference, r]) ** 2
            if best < 0 or n_own[a] > n_own[best] or (n_own[a] == n_own[best] and square < shortest):
                best, shortest = a, square
        if best < 0:
            break
        slot[best] = n_full
        tolerance = max(tolerance, 1e-6 * np.sqrt(shortest))
        for r in range(3):
            vectors[n_full, r] = body[best, r] - body[reference, r]
        for i in range(n):
            if role[i] == best:
                integer_row[n_listed] = i
                n_listed += 1
        sizes[n_full] = n_listed - first_row[n_full]
        first_row[n_full + 1] = n_listed
        if sizes[n_full] > 0:
            n_lists += 1
            n_most = max(n_most, sizes[n_full])
        n_full += 1
    n_extra = n_integers - n_listed
    for i in range(n):
        if role[i] == EXTRA:
            integer_row[n_listed] = i
            n_listed += 1
    observed_of = np.empty(n_integers)
    wavelength_of = np.empty(n_integers)
    for p in range(n_integers):
        observed_of[p] = observed[integer_row[p]]
        wavelength_of[p] = wavelength[integer_row[p]]

    # What the codes say of the vectors of those that take part.
    m = 3 * n_full
    use = np.empty(n, np.bool_)
    slot_now = np.empty(n_antennas, np.int64)
    for i in range(n):
        use[i] = has_code[i] and (antenna[i] == reference or slot[antenna[i]] >= 0)
    projector = np.empty((n, n))
    project_rows(n, use, antenna, satellite, group, code_weight, n_antennas, projector)
    code_information = np.zeros((m, m))
    code_rhs = np.zeros(m)
    for i in range(n):
        t = 3 * slot[antenna[i]]
        for j in range(n):
            value = projector[i, j]
            u = 3 * slot[antenna[j]]
            if value == 0.0 or t < 0:
                continue
            for r in range(3):
                code_rhs[t + r] += design[i, r] * value * ranged[j]
                if u >= 0:
                    for s in range(3):
                        code_information[t + r, u + s] += design[i, r] * value * design[j, s]
    scale = np.empty(m)
    work = np.empty((m, m))
    for p in range(m):
        scale[p] = code_information[p, p]
    code_rank = invert_semidefinite(code_information, m, scale, work)
    code_constant = 0.0
    for p in range(m):
        for q in range(m):
            code_constant += code_rhs[p] * work[p, q] * code_rhs[q]
    prior = np.empty((3, 3))
    has_prior = prior_weight(prior_information, prior)
    frame = np.zeros((3, 3))
    rank = body_frame(n_full, vectors, tolerance, frame)
    if rank == 0:
        return R_WEAK_GEOMETRY
    if has_prior:
        rank = 3
    dof = n_integers + code_rank - (2 if rank == 1 else 3) + (3 if has_prior else 0)
    row[RANK] = rank
    row[DOF] = dof

    linear = np.zeros(n_integers)
    quadratic = np.zeros((n_integers, n_integers))
    information = np.zeros((9, 9))
    inverse = np.zeros((9, 9))
    centre = np.zeros(9)
    turn = np.zeros((9, n_integers))
    width = n_lists + 1
    counts = np.zeros(width, np.int64)
    metres = np.empty((width, _LIST_CAPACITY, n_most))
    integers = np.empty((width, _LIST_CAPACITY, n_most))
    list_costs = np.empty((width, _LIST_CAPACITY))
    parts = np.zeros((_PART_CAPACITY, width), np.int64)
    part_cost = np.zeros(_PART_CAPACITY)
    out = np.zeros((_PART_CAPACITY, width), np.int64)
    out_cost = np.empty(_PART_CAPACITY)
    out_volume = np.empty(_PART_CAPACITY)
    out_share = np.empty(_PART_CAPACITY)
    most = max(n_most, n_extra)
    new_metres = np.empty((_TREE_CAPACITY, most))
    new_integers = np.empty((_TREE_CAPACITY, most))
    extra_metres = np.empty((_PART_CAPACITY, max(n_extra, 1)))
    extra_integers = np.empty((_PART_CAPACITY, max(n_extra, 1)))
    best_frame = np.zeros((3, 3))
    hessian = np.zeros((3, 3))
    variance = position_sd * position_sd
    nodes = 0
    n_out = np.int64(0)
    best = -1
    reason = R_OK
    # Few integers: first a small bound, since lists grow with it. Many: one that is most likely enough.
    bound = dof + 10.0 if n_integers < 30 else dof + 3.5 * np.sqrt(dof) + margin
    largest = reach + dof
    bound = min(bound, largest)
    limit = bound
    while True:
        # Steps 0 .. n_lists - 1 make the lists; then list by list is joined, and what no list has.
        limit = bound
        n_parts = np.int64(1)
        is_complete = True
        for step in range(2 * n_lists + 1):
            is_list = step < n_lists
            is_extra = step == 2 * n_lists
            t = step if is_list else step - n_lists
            if (is_extra and n_extra == 0) or not is_complete:
                continue
            if step == n_lists and (n_lists > 1 or n_extra > 0):
                # The first list is what others are joined to.
                n_parts = counts[0]
                for k in range(n_parts):
                    parts[k, 0] = k
                    part_cost[k] = list_costs[0, k]
                continue
            is_final = is_extra or (step == 2 * n_lists - 1 and n_extra == 0)
            # The subset: its antennas, their vectors, and the place of its integers.
            begin = t if is_list else np.int64(0)
            end = n_full if is_extra else t + 1
            first = first_row[t] if is_list else 0
            last = n_integers if is_extra else first_row[t + 1]
            for a in range(n_antennas):
                slot_now[a] = slot[a] if slot[a] >= begin and slot[a] < end else -1
            for i in range(n):
                use[i] = (
                    has_phase[i]
                    and (antenna[i] == reference or slot_now[antenna[i]] >= 0)
                    and (is_extra or sees_reference[i] == 1)
                )
            rank = body_frame(end - begin, vectors[begin:end], tolerance, frame)
            if is_final and has_prior:
                rank = 3
            mu = bound + 10.0 if is_list else _MU
            constant = prepare_subset(
                n, use, integer_row[first:last], last - first, antenna, satellite, group, weight, design,
                slot_now, begin, end, n_full, n_antennas, code_information, code_rhs, code_constant, vectors,
                variance, rank, frame, prior, prior_rot, mu, information, inverse, centre, turn, quadratic,
                linear,
            )  # fmt: skip
            # What is joined to what, and where the result goes.
            old, count, cost_to = t, counts[t], out_cost
            new_from, metres_to, integers_to = metres[t], extra_metres, extra_integers
            start = first_row[t]
            if is_list:
                n_parts = np.int64(1)
                part_cost[0] = 0.0
                old, cost_to, metres_to, integers_to = np.int64(0), list_costs[t], metres[t], integers[t]
            if is_extra:
                old, start = n_lists, first_row[n_lists]
            if is_list or is_extra:
                count, new_from = np.int64(-1), new_metres
            n_out, limit, visited, whole = join(
                n_parts, parts, part_cost, old, sizes, metres, t, last - start, count, new_from, new_integers,
                observed_of[start:last], wavelength_of[start:last], constant, linear, quadratic, centre, turn,
                information, inverse, rank, limit, margin, is_list, is_final, max_nodes - nodes, out, cost_to,
                out_volume, out_share, metres_to, integers_to, best_frame, hessian,
            )  # fmt: skip
            nodes += visited
            is_complete = is_complete and whole
            if is_list:
                counts[t] = n_out
            elif not is_final:
                n_parts = n_out
                for k in range(n_out):
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
        if best >= 0 and out_cost[best] + margin <= bound:
            break
        if best < 0 and bound >= largest:
            reason = R_NO_CANDIDATE
            break
        bound = out_cost[best] + margin if best >= 0 else min(2.0 * bound + 10.0, largest)
    row[N_NODES] = nodes
    if reason != R_OK:
        return reason

    mass = 0.0
    order = np.empty(n_out, np.int64)
    sort_by_cost(n_out, out_cost, order)
    n_listed = 0
    row[COMPLETE_TO] = limit
    row[SECOND_COST] = limit
    for place in range(n_out):
        k = order[place]
        if out_cost[k] > limit:
            break
        row[N_CANDIDATES] += 1.0
        mass += out_volume[k] * np.exp(0.5 * (out_cost[best] - out_cost[k]))
        if place == 1:
            row[SECOND_COST] = out_cost[k]
        if place >= list_cost.shape[0]:
            if place == list_cost.shape[0] and place > 0:
                row[COMPLETE_TO] = out_cost[k]
            if place > 0:
                continue
        else:
            list_cost[place] = out_cost[k]
            list_volume[place] = out_volume[k]
            row[N_LISTED] += 1.0
            for i in range(n):
                list_integers[place, i] = 0
        for t in range(width):
            for j in range(n_extra if t == n_lists else sizes[t]):
                p = first_row[n_lists] + j if t == n_lists else first_row[t] + j
                i = integer_row[p]
                value = extra_integers[k, j] if t == n_lists else integers[t, out[k, t], j]
                whole_cycles = np.int64(offset[i] + value)
                if place == 0:
                    integers_out[i] = whole_cycles
                if place < list_cost.shape[0]:
                    list_integers[place, i] = whole_cycles
    row[COST] = out_cost[best]
    row[PROBABILITY] = out_volume[best] / mass
    row[ATTITUDE_SHARE] = out_share[best]
    for r in range(3):
        for s in range(3):
            rot_out[r, s] = 0.0
            for c in range(3):
                rot_out[r, s] += best_frame[r, c] * frame[s, c]
    invert_semidefinite(hessian, hessian.shape[0], np.zeros(3), cov_out)
    if rank == 1:
        for r in range(3):
            for s in range(3):
                cov_out[r, s] -= best_frame[r, 0] * best_frame[s, 0]
    return reason
