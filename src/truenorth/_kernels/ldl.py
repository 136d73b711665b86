"""Factorisation and decorrelation of the covariance of float ambiguities.

    Q = L^T diag(d) L,       z = Z^T a,       Z^T Q Z = L_z^T diag(d_z) L_z

``L`` is unit lower triangular, ``Z`` integer with determinant +-1. Exchanges of neighbours bring the
smallest conditional variances to the end, where the search begins; integer Gauss transforms bring the
elements of ``L`` to at most one half. Two things make it quick: the factorisation may sort by
conditional variance as it goes, and transforms that decide no exchange wait for one last pass
(together about five times faster at 40 ambiguities than the plain order).

All arrays may be larger than the n x n block in use. ``Z`` and its inverse transpose hold integers in
float64 (exact to 2^53), so that products with float vectors need no conversion.

References: Teunissen 1995, J. Geodesy 70:65-82; de Jonge & Tiberius 1996, LGR-Series 12;
Chang, Yang & Zhou 2005, J. Geodesy 79:552-565 (sorting, lazy transforms).
"""

import numpy as np

from .jit import kernel

OK = 0
NOT_POSITIVE_DEFINITE = 1

_MIN_GAIN = 1e-9
"""Exchanges that lower a variance by a smaller share are skipped; they could repeat for ever."""

_MAX_ELEMENT = 4.0
"""Elements of L above this are not left for the last pass: they would grow and cancel digits."""

_MIN_PIVOT = 1e-13
"""Conditional over unconditional variance that rounding leaves of a singular matrix."""


@kernel
def ldl_factor(Q, n, L, d):
    """Factor ``Q[:n, :n]`` into ``L^T diag(d) L``; only the lower triangle of Q is read.

    Returns `OK`, or `NOT_POSITIVE_DEFINITE` (also for NaN), when L and d are not to be used.
    """
    for i in range(n):
        for j in range(i + 1):
            L[i, j] = Q[i, j]
        for j in range(i + 1, n):
            L[i, j] = 0.0
    for i in range(n - 1, -1, -1):
        if not _eliminate(L, d, i, Q[i, i]):
            return NOT_POSITIVE_DEFINITE
    return OK


@kernel
def decorrelate(Q, n, L, d, Z, iZt):
    """Factor and reduce: ``Z^T Q Z = L^T diag(d) L``, with ``iZt = Z^{-T}``.

    The same as `ldl_factor` and `reduce_`, but sorted while it factors, which leaves fewer exchanges.
    Returns `OK` or `NOT_POSITIVE_DEFINITE`.
    """
    variance = np.empty(n)
    order = np.empty(n, np.int64)
    for i in range(n):
        variance[i] = Q[i, i]
        order[i] = i
        for j in range(i + 1):
            L[i, j] = Q[i, j]
        for j in range(i + 1, n):
            L[i, j] = 0.0
    for i in range(n - 1, -1, -1):
        least = i
        for j in range(i):
            if L[j, j] < L[least, least]:
                least = j
        if least != i:
            _exchange_symmetric(L, n, least, i)
            order[least], order[i] = order[i], order[least]
        if not _eliminate(L, d, i, variance[order[i]]):
            return NOT_POSITIVE_DEFINITE
    for i in range(n):
        for j in range(n):
            Z[i, j] = 0.0
            iZt[i, j] = 0.0
    for i in range(n):
        Z[order[i], i] = 1.0
        iZt[order[i], i] = 1.0
    _reduce_from(n, L, d, Z, iZt)
    return OK


@kernel
def reduce_(n, L, d, Z, iZt):
    """Decorrelate: L and d are replaced by those of ``Z^T Q Z``; writes Z and ``iZt = Z^{-T}``.

    Then ``z = Z^T a`` and ``a = iZt z``. Returns the number of exchanges.
    """
    for i in range(n):
        for j in range(n):
            Z[i, j] = 0.0
            iZt[i, j] = 0.0
        Z[i, i] = 1.0
        iZt[i, i] = 1.0
    return _reduce_from(n, L, d, Z, iZt)


@kernel
def _eliminate(L, d, i, variance):
    """One step of the factorisation, in place in the lower triangle; False if not definite."""
    pivot = L[i, i]
    if not (pivot > _MIN_PIVOT * variance and pivot > 0.0 and pivot < np.inf):
        return False
    d[i] = pivot
    inverse = 1.0 / pivot
    for j in range(i):
        factor = L[i, j] * inverse
        for k in range(j + 1):
            L[j, k] -= factor * L[i, k]
    for j in range(i):
        L[i, j] *= inverse
    L[i, i] = 1.0
    return True


@kernel
def _exchange_symmetric(L, n, p, q):
    """Exchange rows and columns p < q of the unfinished factorisation, kept in a lower triangle.

    Rows below q are finished: there only the columns change places.
    """
    for m in range(p):
        L[p, m], L[q, m] = L[q, m], L[p, m]
    L[p, p], L[q, q] = L[q, q], L[p, p]
    for m in range(p + 1, q):
        L[m, p], L[q, m] = L[q, m], L[m, p]
    for m in range(q + 1, n):
        L[m, p], L[m, q] = L[m, q], L[m, p]


@kernel
def _reduce_from(n, L, d, Z, iZt):
    """`reduce_`, going on from the transform already in Z and iZt."""
    # Column operations on L and Z are row operations on their transposes, which are contiguous.
    U = np.empty((n, n))
    Zt = np.empty((n, n))
    iZ = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            U[i, j] = L[j, i]
            Zt[i, j] = Z[j, i]
            iZ[i, j] = iZt[j, i]
    n_exchanges = 0
    k = n - 2
    while k >= 0:
        rest = U[k, k + 1] - np.rint(U[k, k + 1])
        variance = d[k] + rest * rest * d[k + 1]
        if variance < d[k + 1] * (1.0 - _MIN_GAIN):
            _gauss(n, U, Zt, iZ, k + 1, k)
            for i in range(k + 2, n):
                if abs(U[k, i]) > _MAX_ELEMENT:
                    _gauss(n, U, Zt, iZ, i, k)
            _exchange(n, U, d, Zt, iZ, k, variance)
            n_exchanges += 1
            k = k + 1 if k < n - 2 else k - 1
        else:
            k -= 1
    for k in range(n - 1):
        for i in range(k + 1, n):
            _gauss(n, U, Zt, iZ, i, k)
    for i in range(n):
        for j in range(n):
            L[i, j] = U[j, i]
            Z[i, j] = Zt[j, i]
            iZt[i, j] = iZ[j, i]
    return n_exchanges


@kernel
def _gauss(n, U, Zt, iZ, i, j):
    """Integer Gauss transform of column j of L by column i > j (rows of U), if it shortens it."""
    mu = np.rint(U[j, i])
    if mu == 0.0:
        return
    for m in range(i, n):
        U[j, m] -= mu * U[i, m]
    for m in range(n):
        Zt[j, m] -= mu * Zt[i, m]
    for m in range(n):
        iZ[i, m] += mu * iZ[j, m]


@kernel
def _exchange(n, U, d, Zt, iZ, k, variance):
    """Exchange ambiguities k and k + 1; `variance` is the new conditional variance of k + 1."""
    rest = U[k, k + 1]
    eta = d[k] / variance
    lam = d[k + 1] * rest / variance
    d[k] = eta * d[k + 1]
    d[k + 1] = variance
    for j in range(k):
        a0 = U[j, k]
        a1 = U[j, k + 1]
        U[j, k] = a1 - rest * a0
        U[j, k + 1] = eta * a0 + lam * a1
    U[k, k + 1] = lam
    for m in range(k + 2, n):
        U[k, m], U[k + 1, m] = U[k + 1, m], U[k, m]
    for m in range(n):
        Zt[k, m], Zt[k + 1, m] = Zt[k + 1, m], Zt[k, m]
    for m in range(n):
        iZ[k, m], iZ[k + 1, m] = iZ[k + 1, m], iZ[k, m]
