"""Integer least squares: the tree search over decorrelated ambiguities.

    C(z) = (zhat - z)^T Q^{-1} (zhat - z) = sum_k (z_k - zbar_k)^2 / d_k,    Q = L^T diag(d) L
    zbar_k = zhat_k + sum_{i > k} (z_i - zbar_i) L_ik

Depth first from the last ambiguity; at every level the integers are taken in order of distance from
``zbar_k`` (zig-zag), so the first leaf is the bootstrapped solution and a level is done at the first
integer outside the bound. The sums of a level are kept, and redone only from the highest level that
changed since. A node is one integer tried at one level.

Integers are held in float64 arrays. Move whole cycles out of ``zhat`` first: values of 1e9 would leave
only 1e-7 cycles of precision.

References: Schnorr & Euchner 1994, Math. Programming 66:181-199; Chang, Yang & Zhou 2005, J. Geodesy
79:552-565 (shrinking bound); Ghasemmehdi & Agrell 2011, IEEE Trans. Inf. Theory 57(6):3530-3536
(kept sums).
"""

import numpy as np

from .jit import kernel

COMPLETE = 0
NODE_LIMIT = 1
CAPACITY = 2


@kernel
def search_best(n, L, d, zhat, n_candidates, z_out, cost_out, max_nodes):
    """The `n_candidates` integer vectors of least cost, best first, by a shrinking bound.

    Writes ``z_out[:count, :n]`` and ``cost_out[:count]``. Returns (count, nodes, status): `COMPLETE`
    proves optimality, `NODE_LIMIT` means the best found within `max_nodes`.
    """
    if n < 1 or n_candidates < 1:
        return 0, 0, COMPLETE
    z = np.empty(n)
    zbar = np.empty(n)
    step = np.empty(n)
    above = np.zeros(n + 1)
    inverse_d = np.empty(n)
    sums = np.zeros((n, n + 1))
    stale = np.empty(n, np.int64)
    for k in range(n):
        inverse_d[k] = 1.0 / d[k]
        stale[k] = n - 1
    count = 0
    nodes = 0
    bound = np.inf
    k = n - 1
    zbar[k] = zhat[k]
    _first(k, zbar, z, step)
    while True:
        nodes += 1
        y = z[k] - zbar[k]
        cost = above[k + 1] + y * y * inverse_d[k]
        if cost < bound:
            if k > 0:
                above[k] = cost
                k -= 1
                _condition(k, L, zhat, z, zbar, sums, stale)
                _first(k, zbar, z, step)
                if nodes >= max_nodes:
                    return count, nodes, NODE_LIMIT
                continue
            # A leaf: insert in order of cost, dropping the worst of a full list.
            place = count if count < n_candidates else n_candidates - 1
            while place > 0 and cost_out[place - 1] > cost:
                cost_out[place] = cost_out[place - 1]
                for i in range(n):
                    z_out[place, i] = z_out[place - 1, i]
                place -= 1
            cost_out[place] = cost
            for i in range(n):
                z_out[place, i] = z[i]
            if count < n_candidates:
                count += 1
            if count == n_candidates:
                bound = cost_out[n_candidates - 1]
        else:
            k += 1
            if k == n:
                return count, nodes, COMPLETE
        z[k] += step[k]
        step[k] = -step[k] - 1.0 if step[k] > 0.0 else 1.0 - step[k]
        if nodes >= max_nodes:
            return count, nodes, NODE_LIMIT


@kernel
def enumerate_within(n, L, d, zhat, bound, z_out, cost_out, max_nodes):
    """All integer vectors of cost at most `bound`, in the order of the search.

    Writes ``z_out[:count, :n]`` and ``cost_out[:count]``. Returns (count, nodes, status): `COMPLETE`
    says that none is missing; `CAPACITY` that ``z_out`` is full and more exist; `NODE_LIMIT` that
    `max_nodes` were visited.
    """
    if n < 1 or not bound < np.inf:
        return 0, 0, COMPLETE if n < 1 else NODE_LIMIT
    z = np.empty(n)
    zbar = np.empty(n)
    step = np.empty(n)
    above = np.zeros(n + 1)
    inverse_d = np.empty(n)
    sums = np.zeros((n, n + 1))
    stale = np.empty(n, np.int64)
    for k in range(n):
        inverse_d[k] = 1.0 / d[k]
        stale[k] = n - 1
    capacity = cost_out.shape[0]
    count = 0
    nodes = 0
    k = n - 1
    zbar[k] = zhat[k]
    _first(k, zbar, z, step)
    while nodes < max_nodes:
        nodes += 1
        y = z[k] - zbar[k]
        cost = above[k + 1] + y * y * inverse_d[k]
        if cost <= bound:
            if k > 0:
                above[k] = cost
                k -= 1
                _condition(k, L, zhat, z, zbar, sums, stale)
                _first(k, zbar, z, step)
                continue
            if count == capacity:
                return count, nodes, CAPACITY
            cost_out[count] = cost
            for i in range(n):
                z_out[count, i] = z[i]
            count += 1
        else:
            k += 1
            if k == n:
                return count, nodes, COMPLETE
        z[k] += step[k]
        step[k] = -step[k] - 1.0 if step[k] > 0.0 else 1.0 - step[k]
    return count, nodes, NODE_LIMIT


@kernel
def _first(k, zbar, z, step):
    """Start level k at the integer nearest to its conditional value."""
    z[k] = np.rint(zbar[k])
    step[k] = 1.0 if zbar[k] >= z[k] else -1.0


@kernel
def _condition(k, L, zhat, z, zbar, sums, stale):
    """Conditional value of level k; ``sums[k, i]`` holds the terms of levels i and above."""
    top = stale[k]
    if top < k + 1:
        top = k + 1
    for i in range(top, k, -1):
        sums[k, i] = sums[k, i + 1] + (z[i] - zbar[i]) * L[i, k]
    zbar[k] = zhat[k] + sums[k, k + 1]
    if k > 0 and stale[k - 1] < top:
        stale[k - 1] = top
    stale[k] = k + 1
