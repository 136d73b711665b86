"""Compiled integer search with the baseline length inside the objective.

Objective of one integer vector a (Teunissen 2010, eq. (14); Giorgi et al. 2012):

    C(a) = min over b of  |phase residual|^2 + |code residual|^2 + (|b| - l)^2 / sigma_l^2

Bound. For every mu >= 0 with mu sigma_l^2 < 1 and every b

    (|b| - l)^2 / sigma_l^2  >=  mu |b|^2 - mu l^2 / (1 - mu sigma_l^2),

so C(a) >= J_mu(a) - mu l^2 / (1 - mu sigma_l^2), where J_mu is the ordinary integer least-squares
objective with the pseudo-observation "b = 0, weight mu". Enumerating the integer vectors of that
ordinary problem up to the bound therefore misses no candidate, needs no pseudorange, and never
linearises the length.
"""

import numpy as np

from .jit import kernel


@kernel
def eigen_symmetric_3(matrix, values, vectors):
    """Eigenvalues (ascending) and eigenvectors (columns) of a symmetric 3 x 3 matrix, by Jacobi."""
    a = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            a[i, j] = matrix[i, j]
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(30):
        off = abs(a[0, 1]) + abs(a[0, 2]) + abs(a[1, 2])
        if off <= 1e-15 * (abs(a[0, 0]) + abs(a[1, 1]) + abs(a[2, 2])):
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if a[p, q] == 0.0:
                    continue
                theta = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
                t = 1.0 / (abs(theta) + np.sqrt(theta * theta + 1.0))
                if theta < 0.0:
                    t = -t
                c = 1.0 / np.sqrt(t * t + 1.0)
                s = t * c
                for k in range(3):
                    akp, akq = a[k, p], a[k, q]
                    a[k, p] = c * akp - s * akq
                    a[k, q] = s * akp + c * akq
                for k in range(3):
                    apk, aqk = a[p, k], a[q, k]
                    a[p, k] = c * apk - s * aqk
                    a[q, k] = s * apk + c * aqk
                for k in range(3):
                    vkp, vkq = vectors[k, p], vectors[k, q]
                    vectors[k, p] = c * vkp - s * vkq
                    vectors[k, q] = s * vkp + c * vkq
    for i in range(3):
        values[i] = a[i, i]
    for i in range(2):
        for j in range(i + 1, 3):
            if values[j] < values[i]:
                values[i], values[j] = values[j], values[i]
                for k in range(3):
                    vectors[k, i], vectors[k, j] = vectors[k, j], vectors[k, i]


@kernel
def nearest_on_shell(centre, information, length, variance, b):
    """Minimise sum p_i (b_i - c_i)^2 + (|b| - l)^2 / sigma^2 in the eigenframe of the information.

    The minimiser is b_i = p_i c_i / (p_i + nu) with nu the root of |b(nu)| (1 - nu sigma^2) = l in
    (-p_min, 1 / sigma^2), where the left side falls monotonically; sigma = 0 puts b on the sphere.
    Where c has no component along the weakest direction the root may not exist (the hard case):
    nu = -p_min and that component takes up the rest of the length.

    Parameters are the centre c (3,), the eigenvalues p (3,) ascending and positive, l, sigma^2 and
    the output b (3,). Returns (nu, minimum).
    """
    p_min = information[0]
    # The unknown is t = p_min + nu > 0, which keeps all its digits near the hard case.
    low = 0.0
    high = np.inf if variance <= 0.0 else p_min + 1.0 / variance
    t = p_min
    hard = False
    for _ in range(100):
        square = 0.0
        slope = 0.0
        for i in range(3):
            stiff = information[i] - p_min + t
            b[i] = information[i] * centre[i] / stiff
            square += b[i] * b[i]
            slope += b[i] * b[i] / stiff
        norm = np.sqrt(square)
        if norm == 0.0 or t < 1e-15 * p_min:
            hard = True
            break
        # phi(t) = 1 / |b| - (1 - nu sigma^2) / l: increasing, nearly linear.
        phi = 1.0 / norm - (1.0 - (t - p_min) * variance) / length
        if abs(phi) * norm < 1e-14:
            break
        if phi > 0.0:
            high = t
        else:
            low = t
        # A Newton step, or half the bracket where that leaves it.
        step = t - phi / (slope / (square * norm) + variance / length)
        if not low < step < high:
            step = 0.5 * (low + high) if high < np.inf else 2.0 * t
        if abs(step - t) <= 1e-15 * t:
            break
        t = step
    nu = t - p_min
    if hard:
        nu = -p_min
        target = length / (1.0 - nu * variance)
        rest = 0.0
        for i in range(1, 3):
            stiff = information[i] - p_min
            b[i] = information[i] * centre[i] / stiff if stiff > 1e-12 * information[i] else 0.0
            rest += b[i] * b[i]
        b[0] = np.sqrt(max(target * target - rest, 0.0))
        if centre[0] < 0.0:
            b[0] = -b[0]
    inner = 0.0
    square = 0.0
    for i in range(3):
        inner += information[i] * (b[i] - centre[i]) ** 2
        square += b[i] * b[i]
    if variance > 0.0:
        inner += (np.sqrt(square) - length) ** 2 / variance
    return nu, inner


@kernel
def search_shell(
    n, lower, diag, z_float, gain, b_float, information, mu, j_min,
    length, variance, cap, margin, reach, max_nodes, z_best, costs, b_best, b_free,
):  # fmt: skip
    """Enumerate decorrelated integers depth first and evaluate the exact objective at each leaf.

    Parameters
    ----------
    n : int
        Dimension.
    lower, diag : ndarray
        Factors of the decorrelated covariance, Q = L' D L.
    z_float : ndarray, shape (n,)
        Decorrelated float ambiguities.
    gain : ndarray, shape (3, n)
        Baseline shift per unit of (z_float - z), in the eigenframe.
    b_float : ndarray, shape (3,)
        Float baseline with the pseudo-observation, in the eigenframe.
    information : ndarray, shape (3,)
        Eigenvalues of the information on b once the integers are known (without mu).
    mu, j_min : float
        Weight of the pseudo-observation and the least value of its objective.
    length, variance : float
        Known length and its variance; NaN length leaves the objective unconstrained.
    cap : float
        Candidates with a larger objective are of no interest.
    margin : float
        Candidates within this of the best count for the posterior probability.
    reach : float
        Candidates within this multiple of the best objective are found too, for the ratio test.
    max_nodes : int
        Give up after so many nodes.
    z_best, costs, b_best, b_free : ndarray, shapes (n,), (2,), (3,), (3,)
        Outputs: the best integers, the two least objectives, and the best's constrained and
        unconstrained baselines (eigenframe). The second is a lower bound where none was in reach.

    Returns
    -------
    found : int
        Candidates evaluated within the cap.
    nodes : int
        Nodes visited.
    complete : bool
        The search was exhaustive.
    probability : float
        Posterior probability of the best: exp(-C/2) and the volume its baseline may take, over the
        sum of all candidates.
    """
    constrained = length == length
    offset = 0.0
    if constrained:
        offset = mu * length * length / (1.0 - mu * variance)
    costs[0] = np.inf
    costs[1] = np.inf
    limit = cap
    bound = limit + offset - j_min
    found = 0
    nodes = 0
    complete = True
    best_volume = 1.0
    # Posterior mass relative to exp(-best / 2): rescaled whenever a better one is found.
    mass = 0.0
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
            complete = False
            break
        gap = z_cond[k] - z_now[k]
        here = partial[k + 1] + gap * gap / diag[k]
        if here > bound:
            # No sibling further out can be closer: go up.
            k += 1
            if k == n:
                break
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
            # A leaf: exact objective.
            cost = j_min + here
            norm = 0.0
            for i in range(3):
                value = b_float[i]
                for j in range(n):
                    value -= gain[i, j] * (z_float[j] - z_now[j])
                c[i] = value * (information[i] + mu) / information[i]
                b[i] = c[i]
                cost -= mu * value * c[i]
                norm += c[i] * c[i]
            volume = 1.0
            if constrained:
                short = np.sqrt(norm) - length
                if cost + short * short / (1.0 / information[0] + variance) <= limit:
                    nu, inner = nearest_on_shell(c, information, length, variance, b)
                    cost += inner
                    inverse = 0.0
                    norm = b[0] * b[0] + b[1] * b[1] + b[2] * b[2]
                    for i in range(3):
                        stiff = max(information[i] + nu, 1e-9 * information[i])
                        volume *= stiff
                        inverse += b[i] * b[i] / (norm * stiff)
                    # The curvature of the objective at b; of an exact length, in the tangent plane.
                    volume = 1.0 / np.sqrt(volume * (variance + (1.0 - nu * variance) * inverse))
                else:
                    cost = np.inf
            if cost <= limit:
                found += 1
                if cost < costs[0]:
                    mass = mass * np.exp(0.5 * (cost - costs[0])) + volume
                    costs[1] = costs[0]
                    costs[0] = cost
                    best_volume = volume
                    for j in range(n):
                        z_best[j] = z_now[j]
                    for i in range(3):
                        b_best[i] = b[i]
                        b_free[i] = c[i]
                    limit = min(cap, max(cost + margin, reach * cost))
                    bound = limit + offset - j_min
                else:
                    mass += volume * np.exp(0.5 * (costs[0] - cost))
                    costs[1] = min(costs[1], cost)
        # Next sibling in zig-zag order.
        z_now[k] += step[k]
        step[k] = -step[k] - (1.0 if step[k] > 0.0 else -1.0)
    if found > 0:
        costs[1] = min(costs[1], max(limit, costs[0]))
    return found, nodes, complete, best_volume / mass if found > 0 else np.nan
