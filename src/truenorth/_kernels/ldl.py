"""Factorisation and decorrelation of the covariance of float ambiguities.

    Q = L^T diag(d) L,       z = Z^T a,       Z^T Q Z = L_z^T diag(d_z) L_z

``L`` is unit lower triangular, ``Z`` integer with determinant +-1. Integer Gauss transforms bring the
sub-diagonal of ``L`` to at most one half, exchanges of neighbours bring the smallest conditional
variances to the end, where the search begins. Transforms are lazy: those that change no exchange
wait for one last pass.

All arrays may be larger than the n x n block in use. ``Z`` and its inverse transpose hold integers in
float64 (exact to 2^53), so that products with float vectors need no conversion.

References: Teunissen 1995, J. Geodesy 70:65-82; de Jonge & Tiberius 1996, LGR-Series 12;
Chang, Yang & Zhou 2005, J. Geodesy 79:552-565 (MLAMBDA).
"""

import numpy as np

from .jit import kernel

OK = 0
NOT_POSITIVE_DEFINITE = 1

_MIN_GAIN = 1e-9
"""Exchanges that lower a variance by a smaller share are skipped; they could repeat for ever."""


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
        pivot = L[i, i]
        # 1e-13 of the variance itself is what rounding leaves of a singular matrix.
        if not (pivot > 1e-13 * abs(Q[i, i])) or pivot == np.inf:
            return NOT_POSITIVE_DEFINITE
        d[i] = pivot
        inverse = 1.0 / pivot
        for j in range(i):
            factor = L[i, j] * inverse
            for k in range(j + 1):
                L[j, k] -= factor * L[i, k]
        for j in range(i):
            L[i, j] *= inverse
        L[i, i] = 1.0
    return OK


@kernel
def reduce_(n, L, d, Z, iZt):
    """Decorrelate: L and d are replaced by those of ``Z^T Q Z``; writes Z and ``iZt = Z^{-T}``.

    Then ``z = Z^T a`` and ``a = iZt z``. Returns the number of exchanges.
    """
    # Column operations on L and Z are row operations on their transposes, which are contiguous.
    U = np.empty((n, n))
    Zt = np.zeros((n, n))
    iZ = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            U[i, j] = L[j, i]
        Zt[i, i] = 1.0
        iZ[i, i] = 1.0

    n_exchanges = 0
    k = n - 2
    while k >= 0:
        mu = np.rint(U[k, k + 1])
        rest = U[k, k + 1] - mu
        variance = d[k] + rest * rest * d[k + 1]
        if variance < d[k + 1] * (1.0 - _MIN_GAIN):
            # Keeping the whole column short costs little and keeps the numbers small.
            for i in range(k + 1, n):
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
        swap = U[k, m]
        U[k, m] = U[k + 1, m]
        U[k + 1, m] = swap
    for m in range(n):
        swap = Zt[k, m]
        Zt[k, m] = Zt[k + 1, m]
        Zt[k + 1, m] = swap
        swap = iZ[k, m]
        iZ[k, m] = iZ[k + 1, m]
        iZ[k + 1, m] = swap
