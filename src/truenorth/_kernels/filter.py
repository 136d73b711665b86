"""Compiled filter of ambiguities over epochs, in information form.

The memory is the information on the single-difference ambiguities of the arcs in view, after the
baseline and the receiver clocks of past epochs were eliminated. It knows no reference satellite
(its null space is one constant per group), so a change of reference costs nothing; an arc that ends
is marginalised. Each epoch adds

    M <- M + s (L W L - L W H (H' W H + N_code)^-1 H' W L)

with W the weights centred in each group, L the wavelengths, H the design, and s = min(1, dt / tau)
the share of the epoch that is new when the noise (multipath) is correlated over tau. The memory
also fades, so that it never weighs more than a stated number of epochs: multipath of a standing
antenna does not average out.
"""

import numpy as np

from .baseline import (
    BX,
    COST,
    FLOAT_COV,
    FLOAT_X,
    FOUND,
    N_PHASES,
    NODES,
    PROBABILITY,
    R_NO_CODE,
    R_OK,
    R_TOO_FEW_SATELLITES,
    S_FIXED,
    S_FLOAT,
    S_HELD,
    S_NONE,
    SECOND_COST,
    add_groups,
    clock_residuals,
    geometry_dops,
    invert_3,
    resolve_integers,
    validate,
)
from .constrained import eigen_symmetric_3 as eigen
from .constrained import nearest_on_shell as shell
from .jit import kernel

R_NOT_PERSISTENT = 10
R_HOLD_RELEASED = 14

# Kinds of events, equal to the table in truenorth.ambiguity.resolution.
E_FIXED = 1
E_HOLD_DROPPED = 2
E_RELEASED = 3
E_ADDED = 4


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
    # Inverse of the factor, in place below the diagonal, then its square.
    for j in range(n):
        a[j, j] = 1.0 / a[j, j]
        for i in range(j + 1, n):
            value = 0.0
            for k in range(j, i):
                value -= a[i, k] * a[k, j]
            a[i, j] = value / a[i, i]
    for i in range(n):
        for j in range(i + 1):
            value = 0.0
            for k in range(i, n):
                value += a[k, i] * a[k, j]
            inverse[i, j] = value
            inverse[j, i] = value
    return True


@kernel
def forget(memory, vector, slot_arc, n_slots, s):
    """Marginalise slot s and put the last slot in its place; returns the new number of slots."""
    pivot = memory[s, s]
    scale = 0.0
    for i in range(n_slots):
        if i != s:
            scale = max(scale, abs(memory[i, s]))
    if pivot > 1e-9 and pivot > 1e-9 * scale:
        for i in range(n_slots):
            if i == s:
                continue
            factor = memory[i, s] / pivot
            if factor != 0.0:
                for j in range(n_slots):
                    memory[i, j] -= factor * memory[s, j]
                vector[i] -= factor * vector[s]
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
def run_filter(
    time_s, start, y, design, wavelength, variance, group, arc, n_arcs,
    code_start, code_y, code_design, code_variance, code_group,
    length, length_variance, use_length_in_search, check_length, length_tolerance_sd, kappa,
    cap_factor, margin, max_nodes, chi2_limits, min_probability, ratio_mode, min_ratio,
    correlation_s, memory_epochs, hold, min_epochs_to_fix,
    residual, ambiguity, out, status, reason, events, event_numbers,
):  # fmt: skip
    """Run the filter over all epochs in the order given.

    `events` (capacity, 3) gets (epoch, row or -1, kind) and `event_numbers` (capacity, 2) the statistic
    and its limit. Returns the number of events.
    """
    n_epochs = len(start) - 1
    widest = 1
    for e in range(n_epochs):
        widest = max(widest, start[e + 1] - start[e])
    capacity = 2 * widest + 2
    memory = np.zeros((capacity, capacity))
    vector = np.zeros(capacity)
    slot_arc = np.full(capacity, -1, np.int64)
    slot_of_arc = np.full(n_arcs, -1, np.int64)
    held = np.full(n_arcs, np.nan)
    candidate = np.zeros(n_arcs)
    votes = np.zeros(n_arcs, np.int64)
    wins = 0
    weight = 0.0
    n_slots = 0
    n_events = 0
    max_events = len(events)

    info_code = np.empty((3, 3))
    nb = np.empty((3, 3))
    nb_inverse = np.empty((3, 3))
    info_total = np.empty((3, 3))
    rhs_code = np.empty(3)
    rhs = np.empty(3)
    b_float = np.empty(3)
    b_con = np.empty((2, 3))
    b_free = np.empty((2, 3))
    b_held = np.empty(3)

    for e in range(n_epochs):
        first, last = start[e], start[e + 1]
        m = last - first
        row = out[e]
        for k in range(len(row)):
            row[k] = np.nan
        status[e] = S_NONE
        reason[e] = R_TOO_FEW_SATELLITES
        for i in range(first, last):
            residual[i] = np.nan
            ambiguity[i] = np.nan
        share = 1.0
        if e > 0:
            share = min(1.0, abs(time_s[e] - time_s[e - 1]) / correlation_s)
        if n_slots == 0:
            share = 1.0
            weight = 0.0

        # Arcs that left are marginalised, new ones get an empty slot.
        for i in range(first, last):
            if slot_of_arc[arc[i]] < 0:
                votes[arc[i]] = 0
        seen = np.zeros(n_slots, np.bool_)
        for i in range(first, last):
            if slot_of_arc[arc[i]] >= 0:
                seen[slot_of_arc[arc[i]]] = True
        s = n_slots - 1
        while s >= 0:
            if not seen[s]:
                slot_of_arc[slot_arc[s]] = -1
                n_slots = forget(memory, vector, slot_arc, n_slots, s)
                if s < n_slots:
                    slot_of_arc[slot_arc[s]] = s
                    # The slot moved here was seen: it stood behind s.
            s -= 1
        for i in range(first, last):
            if slot_of_arc[arc[i]] < 0:
                slot_of_arc[arc[i]] = n_slots
                slot_arc[n_slots] = arc[i]
                n_slots += 1

        # Code of this epoch.
        for r in range(3):
            rhs_code[r] = 0.0
            for c in range(3):
                info_code[r, c] = 0.0
        add_groups(
            code_start[e], code_start[e + 1], code_y, code_design, code_variance, code_group, info_code, rhs_code
        )
        if invert_3(info_code, nb_inverse):
            for r in range(3):
                b_float[r] = 0.0
                for c in range(3):
                    b_float[r] += nb_inverse[r, c] * rhs_code[c]
                row[FLOAT_X + r] = b_float[r]
            row[FLOAT_COV], row[FLOAT_COV + 1], row[FLOAT_COV + 2] = (
                nb_inverse[0, 0], nb_inverse[1, 1], nb_inverse[2, 2],
            )  # fmt: skip
            row[FLOAT_COV + 3], row[FLOAT_COV + 4], row[FLOAT_COV + 5] = (
                nb_inverse[0, 1], nb_inverse[0, 2], nb_inverse[1, 2],
            )  # fmt: skip
            status[e] = S_FLOAT
        if m < 2:
            continue

        # Weighted means of the groups.
        w = np.empty(m)
        hc = np.empty((m, 3))
        yc = np.empty(m)
        weight_of = np.empty(m)
        is_reference = np.zeros(m, np.bool_)
        n = 0
        i = 0
        while i < m:
            j = i
            total = 0.0
            mean = 0.0
            m0 = 0.0
            m1 = 0.0
            m2 = 0.0
            while j < m and group[first + j] == group[first + i]:
                w[j] = 1.0 / variance[first + j]
                total += w[j]
                mean += w[j] * y[first + j]
                m0 += w[j] * design[first + j, 0]
                m1 += w[j] * design[first + j, 1]
                m2 += w[j] * design[first + j, 2]
                j += 1
            is_reference[i] = True
            n += j - i - 1
            for k in range(i, j):
                yc[k] = y[first + k] - mean / total
                hc[k, 0] = design[first + k, 0] - m0 / total
                hc[k, 1] = design[first + k, 1] - m1 / total
                hc[k, 2] = design[first + k, 2] - m2 / total
                weight_of[k] = total
            i = j
        row[N_PHASES] = n
        for r in range(3):
            rhs[r] = rhs_code[r]
            for c in range(3):
                info_total[r, c] = info_code[r, c]
        for k in range(m):
            for r in range(3):
                rhs[r] += w[k] * hc[k, r] * yc[k]
                for c in range(3):
                    info_total[r, c] += w[k] * hc[k, r] * hc[k, c]

        # Held integers first.
        done = False
        released = False
        if hold:
            for attempt in range(4):
                keep = np.empty(m, np.int64)
                n_keep = 0
                for k in range(m):
                    if held[arc[first + k]] == held[arc[first + k]]:
                        keep[n_keep] = k
                        n_keep += 1
                if n_keep < 4:
                    break
                hy = np.empty(n_keep)
                hd = np.empty((n_keep, 3))
                hv = np.empty(n_keep)
                hg = np.empty(n_keep, np.int64)
                hr = np.empty(n_keep)
                for q in range(n_keep):
                    k = keep[q]
                    hy[q] = y[first + k] - wavelength[first + k] * held[arc[first + k]]
                    for r in range(3):
                        hd[q, r] = design[first + k, r]
                    hv[q] = variance[first + k]
                    hg[q] = group[first + k]
                for r in range(3):
                    b_held[r] = rhs_code[r]
                    for c in range(3):
                        nb[r, c] = info_code[r, c]
                _, dof = add_groups(0, n_keep, hy, hd, hv, hg, nb, b_held)
                if dof < 4 or not invert_3(nb, nb_inverse):
                    break
                rx = b_held[0]
                ry = b_held[1]
                rz = b_held[2]
                for r in range(3):
                    b_held[r] = nb_inverse[r, 0] * rx + nb_inverse[r, 1] * ry + nb_inverse[r, 2] * rz
                chi2 = clock_residuals(0, n_keep, hy, hd, hv, hg, b_held, hr)
                limit = chi2_limits[min(dof - 3, len(chi2_limits) - 1)]
                size = np.sqrt(b_held[0] ** 2 + b_held[1] ** 2 + b_held[2] ** 2)
                length_off = False
                if check_length:
                    sd2 = 0.0
                    for r in range(3):
                        for c in range(3):
                            sd2 += b_held[r] * nb_inverse[r, c] * b_held[c]
                    sd2 = sd2 / (size * size) + length_variance
                    length_off = abs(size - length) > length_tolerance_sd * np.sqrt(sd2)
                if chi2 <= limit and not length_off:
                    done = True
                    break
                # One slipped satellite shows as the largest residual: drop it and try again.
                worst = 0
                for q in range(n_keep):
                    if abs(hr[q]) / np.sqrt(hv[q]) > abs(hr[worst]) / np.sqrt(hv[worst]):
                        worst = q
                if attempt == 3 or dof - 1 < 5 or length_off and chi2 <= limit:
                    released = True
                    if n_events < max_events:
                        events[n_events, 0] = e
                        events[n_events, 1] = -1
                        events[n_events, 2] = E_RELEASED
                        event_numbers[n_events, 0] = abs(size - length) if length_off and chi2 <= limit else chi2
                        event_numbers[n_events, 1] = length_variance if length_off and chi2 <= limit else limit
                        n_events += 1
                    break
                k = keep[worst]
                held[arc[first + k]] = np.nan
                votes[arc[first + k]] = 0
                if n_events < max_events:
                    events[n_events, 0] = e
                    events[n_events, 1] = first + k
                    events[n_events, 2] = E_HOLD_DROPPED
                    event_numbers[n_events, 0] = hr[worst]
                    event_numbers[n_events, 1] = np.sqrt(hv[worst])
                    n_events += 1
        if released:
            # Nothing learnt so far can be trusted.
            for s in range(n_slots):
                held[slot_arc[s]] = np.nan
                vector[s] = 0.0
                for t in range(n_slots):
                    memory[s, t] = 0.0
            wins = 0
            weight = 0.0
            share = 1.0

        if done:
            # Rows that are not held yet: their fractional part must stay near an integer.
            i = 0
            while i < m:
                j = i
                clock = 0.0
                total = 0.0
                while j < m and group[first + j] == group[first + i]:
                    k = first + j
                    if held[arc[k]] == held[arc[k]]:
                        r = y[k] - wavelength[k] * held[arc[k]]
                        r -= design[k, 0] * b_held[0] + design[k, 1] * b_held[1] + design[k, 2] * b_held[2]
                        clock += w[j] * r
                        total += w[j]
                    j += 1
                if total == 0.0:
                    # A group without a held row: its first satellite becomes the datum.
                    k = first + i
                    held[arc[k]] = 0.0
                    clock = y[k] - (
                        design[k, 0] * b_held[0] + design[k, 1] * b_held[1] + design[k, 2] * b_held[2]
                    )
                    total = 1.0
                clock /= total
                for q in range(i, j):
                    k = first + q
                    if held[arc[k]] == held[arc[k]]:
                        continue
                    r = y[k] - clock
                    r -= design[k, 0] * b_held[0] + design[k, 1] * b_held[1] + design[k, 2] * b_held[2]
                    integer = np.floor(r / wavelength[k] + 0.5)
                    off = abs(r - integer * wavelength[k])
                    if off < 0.25 * wavelength[k] and off < 4.0 * np.sqrt(variance[k]):
                        if votes[arc[k]] > 0 and candidate[arc[k]] == integer:
                            votes[arc[k]] += 1
                        else:
                            candidate[arc[k]] = integer
                            votes[arc[k]] = 1
                        if votes[arc[k]] >= 3:
                            held[arc[k]] = integer
                            if n_events < max_events:
                                events[n_events, 0] = e
                                events[n_events, 1] = k
                                events[n_events, 2] = E_ADDED
                                event_numbers[n_events, 0] = off
                                event_numbers[n_events, 1] = 0.25 * wavelength[k]
                                n_events += 1
                    else:
                        votes[arc[k]] = 0
                i = j
            row[PROBABILITY] = 1.0
            row[COST] = chi2
            row[SECOND_COST] = np.inf
            _finish_held(
                first, last, y, design, wavelength, variance, group, arc, held, info_code, rhs_code,
                length, length_variance, use_length_in_search, length_tolerance_sd, chi2_limits,
                residual, ambiguity, row,
            )  # fmt: skip
            status[e] = S_HELD
            reason[e] = R_OK

        # Search where nothing is held; the memory always learns.
        mu = 0.0
        if use_length_in_search:
            mu = kappa / (length * length + kappa * length_variance)
        if not done and n >= 3:
            for r in range(3):
                for c in range(3):
                    nb[r, c] = info_total[r, c]
                nb[r, r] += mu
            reason[e] = R_NO_CODE
            if invert_3(nb, nb_inverse):
                verdict, code = _search_epoch(
                    first, m, n, y, design, wavelength, variance, group, arc, slot_of_arc, memory, vector,
                    w, hc, yc, weight_of, is_reference, nb_inverse, rhs, mu, info_code, info_total,
                    length, length_variance, use_length_in_search, check_length, length_tolerance_sd,
                    cap_factor * (1.0 + weight), margin, max_nodes, chi2_limits, min_probability, ratio_mode,
                    min_ratio, b_con, b_free, candidate, votes, residual, ambiguity, row,
                )  # fmt: skip
                reason[e] = verdict
                if verdict == R_OK:
                    # `code` is 1 when the winner is the one of the last epoch.
                    wins = wins + 1 if code == 1 else 1
                    if wins >= min_epochs_to_fix:
                        status[e] = S_FIXED
                        if hold:
                            for k in range(m):
                                held[arc[first + k]] = ambiguity[first + k]
                            if n_events < max_events:
                                events[n_events, 0] = e
                                events[n_events, 1] = -1
                                events[n_events, 2] = E_FIXED
                                event_numbers[n_events, 0] = row[PROBABILITY]
                                event_numbers[n_events, 1] = min_probability
                                n_events += 1
                    else:
                        reason[e] = R_NOT_PERSISTENT
                else:
                    wins = 0
            if released and status[e] != S_FIXED:
                reason[e] = R_HOLD_RELEASED
        if status[e] >= S_HELD:
            for r in range(3):
                b_float[r] = row[BX + r]
        geometry_dops(first, last, design, group, b_float, row)

        if invert_3(info_total, nb_inverse):
            fade = 1.0 - share / memory_epochs if weight > 0.0 else 1.0
            weight = fade * weight + share
            for s in range(n_slots):
                vector[s] *= fade
                for t in range(n_slots):
                    memory[s, t] *= fade
            _remember(
                first, m, wavelength, group, arc, slot_of_arc, w, hc, yc, weight_of, nb_inverse, rhs,
                share, memory, vector,
            )  # fmt: skip
    return n_events


@kernel
def _remember(
    first, m, wavelength, group, arc, slot_of_arc, w, hc, yc, weight_of, nb_inverse, rhs, share, memory, vector
):
    """Add the reduced information of one epoch to the memory, weighted by `share`."""
    c = np.empty((m, 3))
    d = np.empty((m, 3))
    for k in range(m):
        lam = wavelength[first + k]
        for r in range(3):
            c[k, r] = lam * w[k] * hc[k, r]
    for k in range(m):
        for r in range(3):
            d[k, r] = nb_inverse[r, 0] * c[k, 0] + nb_inverse[r, 1] * c[k, 1] + nb_inverse[r, 2] * c[k, 2]
    for k in range(m):
        lam = wavelength[first + k]
        a = slot_of_arc[arc[first + k]]
        vector[a] += share * (lam * w[k] * yc[k] - d[k, 0] * rhs[0] - d[k, 1] * rhs[1] - d[k, 2] * rhs[2])
        for q in range(m):
            b = slot_of_arc[arc[first + q]]
            value = -(d[k, 0] * c[q, 0] + d[k, 1] * c[q, 1] + d[k, 2] * c[q, 2])
            if group[first + q] == group[first + k]:
                value -= lam * w[k] * w[q] * wavelength[first + q] / weight_of[k]
                if q == k:
                    value += lam * lam * w[k]
            memory[a, b] += share * value


@kernel
def _search_epoch(
    first, m, n, y, design, wavelength, variance, group, arc, slot_of_arc, memory, vector,
    w, hc, yc, weight_of, is_reference, nb_inverse, rhs, mu, info_code, info_total,
    length, length_variance, use_length_in_search, check_length, length_tolerance_sd,
    cap_factor, margin, max_nodes, chi2_limits, min_probability, ratio_mode, min_ratio,
    b_con, b_free, candidate, votes, residual, ambiguity, row,
):  # fmt: skip
    """Search the integers of one epoch with the memory; returns (reason, 1 if the winner persists)."""
    member = np.empty(n, np.int64)
    k = 0
    for i in range(m):
        if not is_reference[i]:
            member[k] = i
            k += 1
    c = np.empty((n, 3))
    d = np.empty((n, 3))
    for a in range(n):
        i = member[a]
        for r in range(3):
            c[a, r] = wavelength[first + i] * w[i] * hc[i, r]
        for r in range(3):
            d[a, r] = nb_inverse[r, 0] * c[a, 0] + nb_inverse[r, 1] * c[a, 1] + nb_inverse[r, 2] * c[a, 2]
    normal = np.empty((n, n))
    right = np.empty(n)
    for a in range(n):
        i = member[a]
        si = slot_of_arc[arc[first + i]]
        lam = wavelength[first + i]
        right[a] = vector[si] + lam * w[i] * yc[i] - d[a, 0] * rhs[0] - d[a, 1] * rhs[1] - d[a, 2] * rhs[2]
        for b in range(a + 1):
            j = member[b]
            value = memory[si, slot_of_arc[arc[first + j]]]
            value -= d[a, 0] * c[b, 0] + d[a, 1] * c[b, 1] + d[a, 2] * c[b, 2]
            if group[first + i] == group[first + j]:
                value -= lam * w[i] * w[j] * wavelength[first + j] / weight_of[i]
                if i == j:
                    value += lam * lam * w[i]
            normal[a, b] = value
            normal[b, a] = value
    q_a = np.empty((n, n))
    if not cholesky_invert(normal, n, q_a):
        return R_NO_CODE, 0
    a_float = np.zeros(n)
    b_float = np.empty(3)
    shift = np.zeros(3)
    for a in range(n):
        for b in range(n):
            a_float[a] += q_a[a, b] * right[b]
        for r in range(3):
            shift[r] += c[a, r] * a_float[a]
    for r in range(3):
        b_float[r] = 0.0
        for s in range(3):
            b_float[r] += nb_inverse[r, s] * (rhs[s] - shift[s])
    q_ba = np.zeros((3, n))
    for a in range(n):
        for b in range(n):
            for r in range(3):
                q_ba[r, a] -= d[b, r] * q_a[b, a]
    j_min = mu * (b_float[0] ** 2 + b_float[1] ** 2 + b_float[2] ** 2)
    dof = n + 1 if use_length_in_search else n
    cap = cap_factor * chi2_limits[min(dof, len(chi2_limits) - 1)] + margin
    a_best = np.empty((2, n))
    code = resolve_integers(
        n, a_float, q_a, q_ba, b_float, j_min, info_code, info_total, mu,
        length if use_length_in_search else np.nan, length_variance, cap, margin, max_nodes,
        a_best, b_con, b_free, row,
    )  # fmt: skip
    if not row[FOUND] > 0:
        return code, 0
    verdict = validate(
        first, first + m, y, design, wavelength, variance, group, n, a_best[0], b_con[0], b_free[0], info_total,
        length, length_variance, use_length_in_search, check_length, length_tolerance_sd,
        chi2_limits, min_probability, min_ratio, ratio_mode, residual, ambiguity, row,
    )  # fmt: skip
    persists = 1
    for k in range(n):
        i = arc[first + member[k]]
        if votes[i] == 0 or candidate[i] != a_best[0, k]:
            persists = 0
        candidate[i] = a_best[0, k]
        votes[i] = 1
    if code != R_OK:
        verdict = code
    return verdict, persists


@kernel
def _finish_held(
    first, last, y, design, wavelength, variance, group, arc, held, info_code, rhs_code,
    length, length_variance, adjust_with_length, length_tolerance_sd, chi2_limits, residual, ambiguity, row,
):  # fmt: skip
    """Adjust the epoch with all held integers and fill its result row."""
    m = last - first
    keep = np.empty(m, np.int64)
    n_keep = 0
    for i in range(first, last):
        if held[arc[i]] == held[arc[i]]:
            keep[n_keep] = i
            n_keep += 1
    y_kept = np.empty(n_keep)
    design_kept = np.empty((n_keep, 3))
    lam = np.empty(n_keep)
    var = np.empty(n_keep)
    grp = np.empty(n_keep, np.int64)
    for q in range(n_keep):
        i = keep[q]
        y_kept[q] = y[i] - wavelength[i] * held[arc[i]]
        for r in range(3):
            design_kept[q, r] = design[i, r]
        lam[q] = wavelength[i]
        var[q] = variance[i]
        grp[q] = group[i]
    information = info_code.copy()
    b_free = rhs_code.copy()
    _, dof = add_groups(0, n_keep, y_kept, design_kept, var, grp, information, b_free)
    q_b = np.empty((3, 3))
    invert_3(information, q_b)
    x, y_, z = b_free[0], b_free[1], b_free[2]
    for r in range(3):
        b_free[r] = q_b[r, 0] * x + q_b[r, 1] * y_ + q_b[r, 2] * z
    b = b_free.copy()
    if adjust_with_length:
        from_free = _pull_to_length(b_free, information, length, length_variance, b)
        if not from_free:
            for r in range(3):
                b[r] = b_free[r]
    zeros = np.zeros(dof)
    res = np.empty(n_keep)
    amb = np.empty(n_keep)
    validate(
        0, n_keep, y_kept, design_kept, lam, var, grp, dof, zeros, b, b_free, information,
        length, length_variance, adjust_with_length, False, length_tolerance_sd,
        chi2_limits, 0.0, 0.0, 0, res, amb, row,
    )  # fmt: skip
    row[N_PHASES] = dof
    for q in range(n_keep):
        residual[keep[q]] = res[q]
        ambiguity[keep[q]] = held[arc[keep[q]]]


@kernel
def _pull_to_length(b_free, information, length, length_variance, b):
    """Nearest baseline of the known length to b_free in the metric of the information."""
    from_values = np.empty(3)
    axes = np.empty((3, 3))
    eigen(information, from_values, axes)
    centre = np.empty(3)
    inside = np.empty(3)
    if not from_values[0] > 0.0:
        return False
    for r in range(3):
        centre[r] = axes[0, r] * b_free[0] + axes[1, r] * b_free[1] + axes[2, r] * b_free[2]
    shell(centre, from_values, length, length_variance, inside)
    for r in range(3):
        b[r] = axes[r, 0] * inside[0] + axes[r, 1] * inside[1] + axes[r, 2] * inside[2]
    return True
