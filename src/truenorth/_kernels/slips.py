"""Compiled detection of cycle slips between consecutive epochs of single differences.

    d_i = y_i(t) - y_i(t0) = H_i db + dclock + e_i

The change of the baseline db and of the receiver clocks is common to all satellites, so a slip
stands out by whole cycles. For a short baseline db is bounded by the length, which serves as a
weak observation and keeps the test alive with few satellites. Each row is tested against what the
others foretell of it, and the largest normalised residual is taken out first (Baarda 1968, A testing
procedure for use in geodetic networks). Changes are added up over the epochs, so that a satellite may
be compared across a gap of its own with what the others saw meanwhile.
"""

import numpy as np

from .jit import kernel

SLIP_TIME_DIFFERENCE = 1
SLIP_GEOMETRY_FREE = 2
SLIP_DOPPLER = 3

MIN_REDUNDANCY = 1e-3
"""A row of which the others foretell less than this cannot be tested."""


@kernel
def detect_slips(
    n_past, start, y, design, variance, wavelength, band_key, previous, doppler, dt_s,
    baseline_sd_m, limit_sd, moved, slip, statistic, limit,
):  # fmt: skip
    """Flag rows whose phase jumped since the row `previous` (-1 where there is none).

    Parameters
    ----------
    n_past : int
        Epochs, at least one, that stand for what was before: they lend their rows and `moved`.
    start : ndarray of int64
        Row offsets of the epochs.
    y, design, variance, wavelength : ndarray
        Single differences, metres.
    band_key : ndarray of int64
        Satellite of each row, for the geometry-free combination of its bands.
    previous : ndarray of int64
        Row of the same arc at its last epoch.
    doppler : ndarray
        Single-difference range rate, m/s, NaN where missing; its clock drift is common.
    dt_s : ndarray
        Time since the previous row.
    baseline_sd_m : float
        How far the baseline may change between epochs.
    limit_sd : float
        Multiple of the standard deviation of a row against the others' prediction that counts as a slip
        (and at least a quarter cycle).
    moved : ndarray, shape (n_epochs, 4)
        Baseline and clock since the first epoch of all, as far as the differences tell: given for the
        past, the last of which is the epoch just before; output for the others.
    slip, statistic, limit : ndarray
        Outputs: kind of slip (0 none), residual and its limit, metres.
    """
    n_epochs = len(start) - 1
    normal = np.empty((4, 4))
    rhs = np.empty(4)
    factor = np.empty((4, 4))
    x = np.empty(4)
    row, column = np.empty(4), np.empty(4)
    row[3] = 1.0
    epoch_of = np.empty(len(y), np.int64)
    for e in range(n_epochs):
        first, last = start[e], start[e + 1]
        m = np.int64(0)
        for i in range(first, last):
            epoch_of[i] = e
            slip[i] = 0
            if previous[i] >= 0:
                m += 1
        if e < n_past:
            continue
        for a in range(4):
            x[a] = 0.0
            moved[e, a] = moved[e - 1, a]
        if m < 2:
            continue
        index = np.empty(m, np.int64)
        d = np.empty(m)
        v = np.empty(m)
        alive = np.ones(m, np.bool_)
        m = np.int64(0)
        for i in range(first, last):
            p = previous[i]
            if p >= 0:
                index[m] = i
                # Of a satellite that was away, only the change since the last epoch.
                d[m] = y[i] - y[p] - (moved[e - 1, 3] - moved[epoch_of[p], 3])
                for a in range(3):
                    d[m] -= design[i, a] * (moved[e - 1, a] - moved[epoch_of[p], a])
                v[m] = variance[i] + variance[p]
                m += 1
        # Robust start: the clock change is the median.
        clock = _median(d, m)
        n_alive = m
        while n_alive >= 2:
            for a in range(4):
                rhs[a] = 0.0
                for b in range(4):
                    normal[a, b] = 0.0
            for a in range(3):
                normal[a, a] = 1.0 / (baseline_sd_m * baseline_sd_m)
            normal[3, 3] = 1e-12
            for k in range(m):
                if not alive[k]:
                    continue
                w = 1.0 / v[k]
                i = index[k]
                value = d[k] - clock
                for a in range(3):
                    rhs[a] += w * design[i, a] * value
                    normal[3, a] += w * design[i, a]
                    for b in range(a + 1):
                        normal[a, b] += w * design[i, a] * design[i, b]
                rhs[3] += w * value
                normal[3, 3] += w
            _cholesky_4(normal, factor)
            _solve_4(factor, rhs, x)
            # Against the others' prediction a row misses by r / redundancy. One that holds the adjustment
            # down hides its slip in its own r and shows it in those of the others.
            worst = -1
            largest = 0.0
            for k in range(m):
                if not alive[k]:
                    continue
                i = index[k]
                row[:3] = design[i]
                _solve_4(factor, row, column)
                leverage = 0.0
                r = d[k] - clock
                for a in range(4):
                    leverage += row[a] * column[a]
                    r -= row[a] * x[a]
                redundancy = 1.0 - leverage / v[k]
                if redundancy < MIN_REDUNDANCY:
                    statistic[i], limit[i] = r, np.inf
                    continue
                statistic[i] = r / redundancy
                limit[i] = max(limit_sd * np.sqrt(v[k] / redundancy), 0.25 * wavelength[i])
                score = abs(r) / np.sqrt(v[k] * redundancy)
                if abs(statistic[i]) > limit[i] and score > largest:
                    largest = score
                    worst = k
            if worst < 0:
                break
            alive[worst] = False
            slip[index[worst]] = SLIP_TIME_DIFFERENCE
            n_alive -= 1
        for a in range(3):
            moved[e, a] += x[a]
        moved[e, 3] += clock + x[3]
        # Removed rows get the statistic of the clean adjustment.
        for k in range(m):
            i = index[k]
            if not alive[k]:
                r = d[k] - clock - x[3] - design[i, 0] * x[0] - design[i, 1] * x[1] - design[i, 2] * x[2]
                statistic[i] = r
                if abs(r) <= limit[i]:
                    slip[i] = 0
        # Two bands of one satellite must move together, whatever the baseline does. Four satellites do
        # not tell which of the two slipped: then both did.
        n_sats = 0
        for k in range(m):
            known = False
            for q in range(k):
                known = known or band_key[index[q]] == band_key[index[k]]
            n_sats += not known
        for k in range(m):
            for q in range(k + 1, m):
                i, j = index[k], index[q]
                if band_key[i] != band_key[j] or (slip[i] != 0 and slip[j] != 0):
                    continue
                r = d[k] - d[q]
                bound = max(limit_sd * np.sqrt(v[k] + v[q]), 0.05)
                if abs(r) > bound and (n_sats < 5 or (slip[i] == 0 and slip[j] == 0)):
                    if slip[i] == 0:
                        slip[i] = SLIP_GEOMETRY_FREE
                        statistic[i] = r
                        limit[i] = bound
                    if slip[j] == 0:
                        slip[j] = SLIP_GEOMETRY_FREE
                        statistic[j] = -r
                        limit[j] = bound
        # With too few satellites for the test above, Doppler predicts the change (Harvey 1998, 3.5).
        if n_alive < 5:
            rate = np.empty(m)
            n_rate = np.int64(0)
            for k in range(m):
                i = index[k]
                p = previous[i]
                value = y[i] - y[p] - 0.5 * (doppler[i] + doppler[p]) * dt_s[i]
                if value == value:
                    rate[n_rate] = value
                    n_rate += 1
            if n_rate >= 2:
                centre = _median(rate, n_rate)
                for k in range(m):
                    i = index[k]
                    p = previous[i]
                    r = y[i] - y[p] - 0.5 * (doppler[i] + doppler[p]) * dt_s[i] - centre
                    # 5 cm/s of Doppler noise at each end of each receiver.
                    bound = max(0.75 * wavelength[i], limit_sd * 0.1 * dt_s[i])
                    if abs(r) > bound and slip[i] == 0:
                        slip[i] = SLIP_DOPPLER
                        statistic[i] = r
                        limit[i] = bound


@kernel
def _median(values, n):
    """Median of values[:n] by insertion; NumPy's costs a second and a half to compile."""
    ordered = np.empty(n)
    for i in range(n):
        k = i
        while k > 0 and ordered[k - 1] > values[i]:
            ordered[k] = ordered[k - 1]
            k -= 1
        ordered[k] = values[i]
    return 0.5 * (ordered[n // 2] + ordered[(n - 1) // 2])


@kernel
def _cholesky_4(a, factor):
    """Lower Cholesky factor of a 4 x 4 matrix given by its lower triangle."""
    for j in range(4):
        total = a[j, j]
        for k in range(j):
            total -= factor[j, k] * factor[j, k]
        factor[j, j] = np.sqrt(max(total, 1e-300))
        for i in range(j + 1, 4):
            total = a[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            factor[i, j] = total / factor[j, j]


@kernel
def _solve_4(factor, rhs, x):
    """Solve with the factor of `_cholesky_4`."""
    for i in range(4):
        total = rhs[i]
        for k in range(i):
            total -= factor[i, k] * x[k]
        x[i] = total / factor[i, i]
    for i in range(3, -1, -1):
        total = x[i]
        for k in range(i + 1, 4):
            total -= factor[k, i] * x[k]
        x[i] = total / factor[i, i]
