"""The compiled engine of an array: all antennas over many epochs, from phases to accepted attitudes.

Rows are undifferenced phases and codes of one antenna, satellite and signal
(`truenorth._kernels.array_normal`). What an epoch needs to go on is the integer of every arc: one antenna,
one satellite, one signal, unbroken. As long as enough of them are held, an epoch is one adjustment of all
phases with three unknowns; no satellite and no antenna is the reference, so any of them may come and go.

- An adjustment that fails its test loses the phase with the largest normalised residual, again and again, or
  else the one antenna without which the others agree (detection, identification, adaptation: Baarda 1968;
  Wang & Lachapelle 2002). A phase a third of a cycle off has slipped; its integer is found anew.
- New arcs are rounded at the attitude of the others and must repeat before they count.
- Where nothing is held, or what is held contradicts itself, the caller's joint search decides
  (`truenorth._kernels.joint_search`): rare, and much code that need not be compiled into this loop.

All that is carried stands in the arrays of the caller, so epochs may come in blocks of any size.
"""

import numpy as np

from .array_normal import (
    backward_with_gaps,
    factor_with_gaps,
    fit_rotation,
    forward_with_gaps,
    reduce_rows,
    row_redundancy,
    row_residuals,
    soften,
    start_rotation,
    strike_reference,
)
from .jit import kernel

# Columns of the result row of one epoch.
ROT = 0  # nine elements, row by row
COV = 9  # of the small turn in north, east, down: xx, yy, zz, xy, xz, yz
CHI2, CHI2_LIMIT, CHI2_DOF = 15, 16, 17
PROBABILITY = 18
N_PHASES = 19
REFERENCE = 20
IS_LINE = 21
SECOND_COST = 22
FOUND = 23
N_COLUMNS = 24

# What is carried from epoch to epoch.
LAST_TIME = 0  # of the last accepted attitude, NaN before it
HELD_PROBABILITY = 1
LAST_ROT = 2  # nine elements
N_CARRIED = 11

# Rows of the integer state of arcs, and of their values.
VOTES, STRIKES = 0, 1
HELD, CANDIDATE = 0, 1

# Part of an antenna in an epoch.
ABSENT, USED, EXCLUDED = 0, 1, 2

# Reasons and statuses, equal to truenorth.errors (held equal by a test).
R_OK = 0
R_TOO_FEW_SATELLITES = 2
R_WEAK_GEOMETRY = 12
R_HOLD_RELEASED = 14
S_NONE, S_HELD, S_FIXED = 0, 2, 3

# Kinds of events, spelt out in truenorth.attitude.array_events.
E_FIXED = 1
E_SLIPPED = 2
E_DROPPED = 3
E_RELEASED = 4
E_HELD = 5
E_STRUCK = 6
E_ANTENNA_EXCLUDED = 7
E_ANTENNA_DROPPED = 8

VOTES_TO_HOLD = 3
"""Epochs in which a new arc's integer must repeat."""

STRIKES_TO_DROP = 5
"""Epochs in a row that a held phase may be an outlier before its integer is dropped."""

SLIPPED_CYC = 0.34
"""A phase further than this from its integer has slipped."""

ROUNDING_CYC = 0.25
"""A new arc further than this from an integer does not vote."""

OUTLIER_SD = 4.0
"""Normalised residual beyond which a phase is an outlier. Where the test fails without one, the noise is
larger than declared: the covariance grows with it, and nothing is rejected."""

WEAK_SD_RAD = 0.07
"""An attitude known no better than this is none: with as little, its mirror image may fit as well (four of
7, 2, 1 and 7 phases: 38 degrees off at a stated 5.6)."""

SHARE_TO_STRIKE = 0.2
"""Share of the degrees of freedom that outliers may take."""

SURE_CYC = 0.12
"""Standard deviation of a prediction that may be rounded."""

ON_LINE_M = 0.02
"""Antennas nearer than this to one line leave the rotation about it to the noise."""

NEAR_S = 1.0
"""An attitude this old is a start for the next."""


@kernel
def find_line(k, body, axis):
    """Whether k vectors lie on one line; `axis` gets its direction, the longest component positive."""
    first = 0
    longest = 0.0
    for i in range(k):
        size = body[i, 0] ** 2 + body[i, 1] ** 2 + body[i, 2] ** 2
        if size > longest:
            longest = size
            first = i
    norm = np.sqrt(longest)
    sign = 1.0
    big = 0.0
    for r in range(3):
        if abs(body[first, r]) > big:
            big = abs(body[first, r])
            sign = 1.0 if body[first, r] > 0.0 else -1.0
    for r in range(3):
        axis[r] = sign * body[first, r] / norm
    furthest = 0.0
    for i in range(k):
        furthest = max(furthest, distance_from_line(body, np.int64(i), axis))
    return furthest <= ON_LINE_M


@kernel
def distance_from_line(body, i, axis):
    """Distance of a point from the line through the origin."""
    x = body[i, 1] * axis[2] - body[i, 2] * axis[1]
    y = body[i, 2] * axis[0] - body[i, 0] * axis[2]
    z = body[i, 0] * axis[1] - body[i, 1] * axis[0]
    return np.sqrt(x * x + y * y + z * z)


@kernel
def log_event(events, numbers, counter, epoch, row, kind, statistic, limit):
    """Append one event where there is room; `row` is the row of a phase, or -1 - antenna."""
    k = counter[0]
    if k < len(events):
        events[k, 0] = epoch
        events[k, 1] = row
        events[k, 2] = kind
        numbers[k, 0] = statistic
        numbers[k, 1] = limit
        counter[0] = k + 1


@kernel
def adjust(
    n, antenna, satellite, group, y, w, design, body, position_variance, rot_last, has_last, chi2_limits,
    information, rhs, factor, cross, right, active, small, small_rhs, soft, soft_rhs, soft_factor, work,
    vectors, body_k, axis, rot, rot_try, normal, cov, fitted, stacked, numbers,
):  # fmt: skip
    """Adjust the rows of positive weight for the rotation.

    Writes `rot`, `cov` (of its small turn), `stacked` (vectors of all antennas from the reference) and
    `numbers`: chi-square, degrees of freedom, limit, reference antenna, vectors, is_line. `small` and
    `small_rhs` stay the normal equations of the vectors without any geometry. Returns False where the rows do
    not determine the rotation.
    """
    m = len(body)
    square, redundancy = reduce_rows(
        n, antenna, satellite, group, y, w, design, m, information, rhs, factor, cross, right
    )
    reference = -1
    for a in range(m):
        seen = 0.0
        for r in range(3):
            seen += information[3 * a + r, 3 * a + r]
        # An antenna whose only phase fixes its clock has the rounding errors of that for information.
        weight = 0.0
        for i in range(n):
            if antenna[i] == a:
                weight += w[i]
        active[a] = 1 if seen > 1e-9 * weight else 0
        if active[a] == 1 and reference < 0:
            reference = a
    numbers[1] = 0.0
    numbers[3] = reference
    numbers[4] = 0.0
    if reference < 0:
        return False
    k = strike_reference(information, rhs, active, np.int64(reference), small, small_rhs)
    numbers[4] = k
    if k < 1 or redundancy < 3:
        return False
    q = 0
    for a in range(m):
        if active[a] == 1 and a != reference:
            for r in range(3):
                body_k[q, r] = body[a, r] - body[reference, r]
            q += 1
    is_line = find_line(k, body_k, axis)
    numbers[5] = 1.0 if is_line else 0.0
    freedom = redundancy - (2 if is_line else 3)
    if freedom < 0:
        return False
    size = 3 * k
    for i in range(size):
        for j in range(size):
            soft[i, j] = small[i, j]
        soft_rhs[i] = small_rhs[i]
    if position_variance > 0.0:
        square = soften(k, soft, soft_rhs, square, position_variance, soft_factor, work)
    limit = chi2_limits[min(freedom, len(chi2_limits) - 1)] if freedom > 0 else np.inf
    best = np.nan
    if has_last:
        for r in range(3):
            for c in range(3):
                rot[r, c] = rot_last[r, c]
        best = fit_rotation(k, soft, soft_rhs, square, body_k, axis, is_line, rot, normal, cov, fitted)
    if not best <= limit:
        # The vectors by themselves, where the phases determine them.
        for i in range(size):
            for j in range(size):
                work[i, j] = small[i, j]
            vectors[i] = small_rhs[i]
        if factor_with_gaps(work, size) == size:
            forward_with_gaps(work, size, vectors)
            backward_with_gaps(work, size, vectors)
            if start_rotation(k, vectors, body_k, is_line, axis, rot_try):
                cost = fit_rotation(
                    k, soft, soft_rhs, square, body_k, axis, is_line, rot_try, normal, cov, fitted
                )
                if cost == cost and not best <= cost:
                    best = cost
                    for r in range(3):
                        for c in range(3):
                            rot[r, c] = rot_try[r, c]
                elif best == best:
                    best = fit_rotation(
                        k, soft, soft_rhs, square, body_k, axis, is_line, rot, normal, cov, fitted
                    )
    if np.isnan(best):
        return False
    # Errors of the coordinates at the attitude found: d = (P + L)^-1 (g - P R l).
    for i in range(size):
        soft_rhs[i] = 0.0
    if position_variance > 0.0:
        for i in range(size):
            value = small_rhs[i]
            for j in range(size):
                value -= small[i, j] * fitted[j]
            soft_rhs[i] = value
        forward_with_gaps(soft_factor, size, soft_rhs)
        backward_with_gaps(soft_factor, size, soft_rhs)
    q = 0
    for a in range(m):
        moved = active[a] == 1 and a != reference
        for r in range(3):
            value = 0.0
            for c in range(3):
                value += rot[r, c] * (body[a, c] - body[reference, c])
            stacked[3 * a + r] = value + (soft_rhs[3 * q + r] if moved else 0.0)
        if moved:
            q += 1
    numbers[0] = best
    numbers[1] = freedom
    numbers[2] = limit
    return True


@kernel
def worst_phase(
    n, antenna, satellite, group, w, design, m, stacked, cov, factor, cross, residual, lever, rows
):  # fmt: skip
    """Row with the largest normalised residual; returns (row or -1, that number)."""
    for a in range(m):
        x, y, z = stacked[3 * a], stacked[3 * a + 1], stacked[3 * a + 2]
        lever[3 * a, 0] = 0.0
        lever[3 * a, 1] = z
        lever[3 * a, 2] = -y
        lever[3 * a + 1, 0] = -z
        lever[3 * a + 1, 1] = 0.0
        lever[3 * a + 1, 2] = x
        lever[3 * a + 2, 0] = y
        lever[3 * a + 2, 1] = -x
        lever[3 * a + 2, 2] = 0.0
    worst = -1
    largest = 0.0
    i = 0
    while i < n:
        j = i
        total = 0.0
        count = 0
        while j < n and satellite[j] == satellite[i]:
            total += w[j]
            if w[j] > 0.0:
                count += 1
            j += 1
        if count > 1:
            for q in range(i, j):
                if not w[q] > 0.0:
                    continue
                g = group[q]
                left = row_redundancy(
                    m, antenna, w, design, total, np.int64(q), np.int64(i), np.int64(j), factor[g], cross[g],
                    lever, cov, rows,
                )  # fmt: skip
                # Rows with hardly any redundancy cannot be judged.
                if left > 0.02 * w[q]:
                    size = w[q] * abs(residual[q]) / np.sqrt(left)
                    if size > largest:
                        largest = size
                        worst = q
        i = j
    return worst, largest


@kernel
def hold_more(
    e, n, antenna, satellite, group, arc, lam, variance, design, body, reference, is_line, axis, cov, stacked,
    shift, residual, held, candidate, votes, index, events, numbers, counter,
):  # fmt: skip
    """Round new arcs at the attitude of the others; what repeats is held.

    A satellite or a clock that nothing held has to do with takes its first arc as it comes: its constant
    is free. `body` holds the coordinates, `residual` is y without any integer where nothing is held.
    """
    m = len(body)
    from_reference = np.empty((m, 3))
    for a in range(m):
        for r in range(3):
            from_reference[a, r] = body[a, r] - body[reference, r]
    last_satellite = np.int64(-1)
    last_group = np.int64(-1)
    begun = np.zeros(m, np.int64)
    for i in range(n):
        if group[i] != last_group:
            last_group = group[i]
            for a in range(m):
                begun[a] = 0
        a = antenna[i]
        is_known = held[arc[i]] == held[arc[i]]
        if is_known or variance[i] >= 1e20 or np.isnan(residual[i]):
            continue
        in_satellite = np.floor(shift[i] / 100.0)
        in_clock = shift[i] - 100.0 * in_satellite
        nearest = np.rint(residual[i] / lam[i])
        if is_line and distance_from_line(from_reference, a, axis) > ON_LINE_M:
            continue
        if in_satellite < 0.5:
            # A new satellite: one antenna begins it.
            if satellite[i] != last_satellite and begun[a] == 0:
                held[arc[i]] = nearest
                last_satellite = satellite[i]
                if in_clock < 0.5:
                    begun[a] = 1
            continue
        if in_clock < 0.5:
            # A new clock: one satellite begins it.
            if begun[a] == 0:
                held[arc[i]] = nearest
                begun[a] = 1
            continue
        x, y_, z = stacked[3 * a], stacked[3 * a + 1], stacked[3 * a + 2]
        px = design[i, 2] * y_ - design[i, 1] * z
        py = design[i, 0] * z - design[i, 2] * x
        pz = design[i, 1] * x - design[i, 0] * y_
        sigma = variance[i] * (1.0 + 1.0 / in_satellite + 1.0 / in_clock) + (
            cov[0, 0] * px * px + cov[1, 1] * py * py + cov[2, 2] * pz * pz
            + 2.0 * (cov[0, 1] * px * py + cov[0, 2] * px * pz + cov[1, 2] * py * pz)
        )  # fmt: skip
        off = residual[i] - lam[i] * nearest
        if np.sqrt(sigma) > SURE_CYC * lam[i] or abs(off) > ROUNDING_CYC * lam[i]:
            votes[arc[i]] = 0
            continue
        if candidate[arc[i]] == nearest:
            votes[arc[i]] += 1
        else:
            candidate[arc[i]] = nearest
            votes[arc[i]] = 1
        if votes[arc[i]] >= VOTES_TO_HOLD:
            held[arc[i]] = nearest
            log_event(events, numbers, counter, e, index[i], np.int64(E_HELD), off, ROUNDING_CYC * lam[i])


@kernel
def run_array(
    first_epoch, answer, time_s, start, antenna_all, satellite_all, group_all, arc_all, phase_all, design_all,
    lam_all, variance_all, body, position_variance, chi2_limits, max_strikes, single_epoch, arc_number,
    arc_value, carried, found, out, status, reason, part, vector_out, cov_out, residual, integer, events,
    numbers, counter,
):  # fmt: skip
    """Run the engine over epochs, until one needs a search.

    The search is left to the caller, who runs it and calls again with the same epoch and the answer.

    Parameters
    ----------
    first_epoch : int
        Where to go on.
    answer : int
        What the search of that epoch said: -1 not asked, 0 nothing accepted, 1 integers in `found`.
    time_s : ndarray, shape (n_epochs,)
        Epochs.
    start : ndarray of int64, shape (n_epochs + 1,)
        Row offsets; the rows of an epoch are sorted by group, satellite and signal, antenna.
    antenna_all, satellite_all, group_all, arc_all : ndarray of int64, shape (n_rows,)
        Of each row; satellites and groups by any number that tells them apart, arcs from 0.
    phase_all, design_all, lam_all, variance_all : ndarray, shape (n_rows, ...)
        Metres; NaN where there is no phase. Designs are -e in north, east, down.
    body : ndarray, shape (m, 3)
        Body coordinates of the antennas.
    position_variance : float
        Of each of them.
    chi2_limits : ndarray
        Limits of the residual test by degrees of freedom.
    max_strikes : int
        Outlying phases that an epoch may lose.
    single_epoch : bool
        Every epoch by itself: nothing is held.
    arc_number, arc_value : ndarray, shape (2, n_arcs)
        State of the arcs: votes, strikes; integers held, candidates (NaN: none).
    carried : ndarray, shape (N_CARRIED,)
        State of the run.
    found : ndarray, shape (n_rows,)
        Integers that a search found, at the rows of `first_epoch`; NaN where it found none.
    out, status, reason : ndarray
        Outputs, one row per epoch; the search has written its columns and its reason.
    part : ndarray of uint8, shape (n_epochs, m)
        Output: what became of each antenna.
    vector_out, cov_out : ndarray, shapes (n_epochs, m, 3), (n_epochs, 3 m, 3 m)
        Outputs: vectors from the epoch's reference and their joint covariance, without any geometry.
    residual, integer : ndarray, shape (n_rows,)
        Outputs: of the rows that took part, NaN elsewhere.
    events, numbers : ndarray, shapes (capacity, 3), (capacity, 2)
        Outputs: (epoch, row or -1 - antenna, kind) and (statistic, limit).
    counter : ndarray of int64, shape (1,)
        In and output: number of events.

    Returns
    -------
    int
        The epoch that needs a search; the number of epochs when all are done.
    """
    n_epochs = len(start) - 1
    m = len(body)
    m3 = 3 * m
    widest = 1
    for e in range(n_epochs):
        widest = max(widest, start[e + 1] - start[e])
    antenna = np.empty(widest, np.int64)
    satellite = np.empty(widest, np.int64)
    group = np.empty(widest, np.int64)
    arc = np.empty(widest, np.int64)
    index = np.empty(widest, np.int64)
    phase = np.empty(widest)
    y = np.empty(widest)
    w = np.empty(widest)
    lam = np.empty(widest)
    variance = np.empty(widest)
    design = np.empty((widest, 3))
    res = np.empty(widest)
    shift = np.empty(widest)
    struck = np.zeros(widest, np.int64)
    # Groups of an epoch are fewer than its rows, and few.
    n_groups = 1
    for e in range(n_epochs):
        count = 0
        for i in range(start[e], start[e + 1]):
            if i == start[e] or group_all[i] != group_all[i - 1]:
                count += 1
        n_groups = max(n_groups, count)
    information = np.empty((m3, m3))
    rhs = np.empty(m3)
    factor = np.empty((n_groups, m, m))
    cross = np.empty((n_groups, m3, m))
    right = np.empty((n_groups, m))
    active = np.empty(m, np.int64)
    small = np.empty((m3, m3))
    small_rhs = np.empty(m3)
    soft = np.empty((m3, m3))
    soft_rhs = np.empty(m3)
    soft_factor = np.empty((m3, m3))
    work = np.empty((m3 + 1, m3))
    vectors = np.empty(m3)
    body_k = np.empty((m, 3))
    axis = np.empty(3)
    rot = np.empty((3, 3))
    rot_last = np.empty((3, 3))
    rot_try = np.empty((3, 3))
    normal = np.empty((3, 3))
    cov = np.empty((3, 3))
    fitted = np.empty(m3)
    stacked = np.empty(m3)
    verdict = np.zeros(6)
    lever = np.empty((m3, 3))
    rows = np.empty(m)
    nobody = np.int64(-1)
    votes, strikes = arc_number[VOTES], arc_number[STRIKES]
    held, candidate = arc_value[HELD], arc_value[CANDIDATE]
    n_arcs = arc_value.shape[1]
    for r in range(3):
        for c in range(3):
            rot_last[r, c] = carried[LAST_ROT + 3 * r + c]

    for e in range(first_epoch, n_epochs):
        n = start[e + 1] - start[e]
        row = out[e]
        is_answered = e == first_epoch and answer >= 0
        has_answer = e == first_epoch and answer == 1
        if not is_answered:
            for k in range(N_COLUMNS):
                row[k] = np.nan
            status[e] = S_NONE
            reason[e] = R_TOO_FEW_SATELLITES
        local_satellite = nobody
        local_group = nobody
        for k in range(n):
            i = start[e] + k
            residual[i] = np.nan
            integer[i] = np.nan
            index[k] = i
            antenna[k] = antenna_all[i]
            if k == 0 or group_all[i] != group_all[i - 1]:
                local_group += 1
                local_satellite += 1
            elif satellite_all[i] != satellite_all[i - 1]:
                local_satellite += 1
            satellite[k] = local_satellite
            group[k] = local_group
            arc[k] = arc_all[i]
            phase[k] = phase_all[i]
            lam[k] = lam_all[i]
            # A row without a phase never counts.
            variance[k] = variance_all[i] if phase[k] == phase[k] else 1e30
            for r in range(3):
                design[k, r] = design_all[i, r]
            struck[k] = 0
        for a in range(m):
            part[e, a] = ABSENT
        has_last = abs(time_s[e] - carried[LAST_TIME]) <= NEAR_S and not has_answer
        if single_epoch or has_answer:
            for a in range(n_arcs):
                held[a] = np.nan
                strikes[a] = 0
        if single_epoch:
            has_last = False
        if has_answer:
            carried[HELD_PROBABILITY] = row[PROBABILITY]
            for k in range(n):
                if variance[k] < 1e20:
                    held[arc[k]] = found[start[e] + k]
        n_held = 0
        for k in range(n):
            h = held[arc[k]] if variance[k] < 1e20 else np.nan
            w[k] = 1.0 / variance[k] if h == h else 0.0
            y[k] = phase[k] - lam[k] * h if h == h else phase[k]
            n_held += 1 if h == h else 0
        solved = False
        if n_held > 0:
            solved = adjust_and_repair(
                e, n, antenna, satellite, group, y, w, variance, design, index, body, position_variance,
                rot_last, has_last, chi2_limits, max_strikes, information, rhs, factor, cross, right, active,
                small, small_rhs, soft, soft_rhs, soft_factor, work, vectors, body_k, axis, rot, rot_try,
                normal, cov, fitted, stacked, verdict, shift, res, struck, lever, rows, part, arc, held,
                events, numbers, counter,
            )  # fmt: skip
            if not solved:
                if not has_answer:
                    log_event(
                        events, numbers, counter, e, nobody, np.int64(E_RELEASED), verdict[0], verdict[2]
                    )
                    reason[e] = R_HOLD_RELEASED
                for a in range(n_arcs):
                    held[a] = np.nan
                    votes[a] = 0
                    strikes[a] = 0
        if not is_answered:
            # What is held may leave a turn unobservable that all antennas would show.
            poor = solved and verdict[5] > 0.5 and spans_plane(n, antenna, variance, body, body_k, axis)
            if (not solved or poor) and n > 0:
                return e
        if has_answer and solved:
            log_event(events, numbers, counter, e, nobody, np.int64(E_FIXED), row[PROBABILITY], np.nan)
        if not solved:
            continue
        if cov[0, 0] + cov[1, 1] + cov[2, 2] > WEAK_SD_RAD * WEAK_SD_RAD:
            # Few phases leave a turn open, or two attitudes that fit; what is held waits for better ones.
            reason[e] = R_WEAK_GEOMETRY
            continue
        status[e] = S_FIXED if has_answer else S_HELD
        reason[e] = R_OK
        reference = np.int64(verdict[3])
        row[CHI2] = verdict[0]
        row[CHI2_DOF] = verdict[1]
        row[CHI2_LIMIT] = verdict[2]
        row[PROBABILITY] = carried[HELD_PROBABILITY]
        row[REFERENCE] = verdict[3]
        row[IS_LINE] = verdict[5]
        for r in range(3):
            row[COV + r] = cov[r, r]
            for c in range(3):
                row[ROT + 3 * r + c] = rot[r, c]
                rot_last[r, c] = rot[r, c]
                carried[LAST_ROT + 3 * r + c] = rot[r, c]
        row[COV + 3] = cov[0, 1]
        row[COV + 4] = cov[0, 2]
        row[COV + 5] = cov[1, 2]
        scale = verdict[0] / verdict[1] if verdict[0] > verdict[2] else 1.0
        for r in range(6):
            row[COV + r] *= scale
        carried[LAST_TIME] = time_s[e]
        for a in range(m):
            if active[a] == 1:
                part[e, a] = USED
        row_residuals(
            n, antenna, satellite, group, y, w, design, m, stacked, factor, cross, right, shift, res
        )
        used = 0
        for k in range(n):
            if w[k] > 0.0:
                used += 1
                residual[index[k]] = res[k]
                integer[index[k]] = held[arc[k]]
                strikes[arc[k]] = 0
        row[N_PHASES] = used
        out_antenna = nobody
        for k in range(n):
            if struck[k] == 0 or np.isnan(held[arc[k]]):
                continue
            strikes[arc[k]] += 1
            was = held[arc[k]]
            # Of an antenna that is left out nothing is known but that it contradicts the others.
            apart = part[e, antenna[k]] == EXCLUDED
            slipped = not apart and shift[k] > 100.5 and abs(res[k]) > SLIPPED_CYC * lam[k]
            if slipped or strikes[arc[k]] >= STRIKES_TO_DROP:
                held[arc[k]] = np.nan
                votes[arc[k]] = 0
                strikes[arc[k]] = 0
                if not apart:
                    kind = E_SLIPPED if slipped else E_DROPPED
                    log_event(
                        events, numbers, counter, e, index[k], np.int64(kind), res[k], SLIPPED_CYC * lam[k]
                    )
                elif out_antenna != antenna[k]:
                    out_antenna = antenna[k]
                    log_event(
                        events, numbers, counter, e, -1 - antenna[k], np.int64(E_ANTENNA_DROPPED),
                        float(STRIKES_TO_DROP), np.nan,
                    )  # fmt: skip
                # Its residual becomes that of a phase without an integer.
                res[k] += lam[k] * was
        hold_more(
            e, n, antenna, satellite, group, arc, lam, variance, design, body, reference, verdict[5] > 0.5,
            axis, cov, stacked, shift, res, held, candidate, votes, index, events, numbers, counter,
        )  # fmt: skip
        write_vectors(
            e, active, reference, np.int64(verdict[4]), small, small_rhs, scale, work, vectors, vector_out,
            cov_out,
        )  # fmt: skip
    return n_epochs


@kernel
def spans_plane(n, antenna, variance, body, body_k, axis):
    """Whether the antennas that have phases stand on no common line."""
    m = len(body)
    reference = -1
    k = np.int64(0)
    for a in range(m):
        count = 0
        for i in range(n):
            if antenna[i] == a and variance[i] < 1e20:
                count += 1
        if count < 3:
            continue
        if reference < 0:
            reference = a
            continue
        for r in range(3):
            body_k[k, r] = body[a, r] - body[reference, r]
        k += 1
    if k < 2:
        return False
    return not find_line(k, body_k, axis)


@kernel
def write_vectors(e, active, reference, k, small, small_rhs, scale, work, vectors, vector_out, cov_out):
    """Vectors that the phases give without any geometry, and their joint covariance, where they suffice."""
    m = len(active)
    size = 3 * k
    for i in range(size):
        for j in range(size):
            work[i, j] = small[i, j]
        vectors[i] = small_rhs[i]
    if len(vector_out) == 0 or factor_with_gaps(work, size) < size:
        return
    forward_with_gaps(work, size, vectors)
    backward_with_gaps(work, size, vectors)
    column = np.empty(size)
    q = 0
    for a in range(m):
        if active[a] == 0 or a == reference:
            continue
        for r in range(3):
            vector_out[e, a, r] = vectors[3 * q + r]
            for i in range(size):
                column[i] = 0.0
            column[3 * q + r] = 1.0
            forward_with_gaps(work, size, column)
            backward_with_gaps(work, size, column)
            p = 0
            for b in range(m):
                if active[b] == 0 or b == reference:
                    continue
                for c in range(3):
                    cov_out[e, 3 * a + r, 3 * b + c] = scale * column[3 * p + c]
                p += 1
        q += 1


@kernel
def adjust_and_repair(
    e, n, antenna, satellite, group, y, w, variance, design, index, body, position_variance, rot_last,
    has_last, chi2_limits, max_strikes, information, rhs, factor, cross, right, active, small, small_rhs,
    soft, soft_rhs, soft_factor, work, vectors, body_k, axis, rot, rot_try, normal, cov, fitted, stacked,
    verdict, shift, res, struck, lever, rows, part, arc, held, events, numbers, counter,
):  # fmt: skip
    """Adjust an epoch and, where its test fails, find what contradicts: single phases, or one antenna.

    Weights of what is left out become 0. Returns False where neither helps; `verdict` is then that of all.
    """
    m = len(body)
    n_struck = 0
    most = 0.0
    # Antenna that is left out: -1 while single phases are struck; m: the one to blame.
    out = -1
    blamed = np.int64(-1)
    least = np.inf
    chi2_all = np.nan
    limit_all = np.nan
    while True:
        if out >= 0:
            a_out = np.int64(out) if out < m else blamed
            for k in range(n):
                h = held[arc[k]] if variance[k] < 1e20 else np.nan
                w[k] = 1.0 / variance[k] if h == h and antenna[k] != a_out else 0.0
        solved = adjust(
            n, antenna, satellite, group, y, w, design, body, position_variance, rot_last, has_last,
            chi2_limits, information, rhs, factor, cross, right, active, small, small_rhs, soft, soft_rhs,
            soft_factor, work, vectors, body_k, axis, rot, rot_try, normal, cov, fitted, stacked, verdict,
        )  # fmt: skip
        if out < 0:
            passes = solved and verdict[0] <= verdict[2]
            if n_struck == 0:
                if passes or not solved:
                    return solved
                chi2_all = verdict[0]
                limit_all = verdict[2]
                # Many outliers hide one another: what remains must still be able to contradict.
                most = max(1.0, min(float(max_strikes), SHARE_TO_STRIKE * verdict[1]))
            elif passes and verdict[1] > 0.0:
                return True
            if solved and not passes and n_struck < most:
                row_residuals(
                    n, antenna, satellite, group, y, w, design, m, stacked, factor, cross, right, shift, res
                )
                worst, size = worst_phase(
                    n, antenna, satellite, group, w, design, m, stacked, cov, factor, cross, res, lever, rows
                )
                if worst >= 0 and size < OUTLIER_SD:
                    return True
                if worst >= 0:
                    w[worst] = 0.0
                    struck[worst] = 1
                    n_struck += 1
                    log_event(events, numbers, counter, e, index[worst], np.int64(E_STRUCK), size, res[worst])
                    continue
            # All phases again, but for those of one antenna; what was said of single phases is taken back.
            counter[0] -= n_struck
            for k in range(n):
                struck[k] = 0
            out = 0
            continue
        if out < m:
            if solved and verdict[1] >= 3.0 and verdict[0] <= verdict[2] and verdict[0] < least:
                least = verdict[0]
                blamed = np.int64(out)
            out += 1
            if out == m and blamed < 0:
                verdict[0] = chi2_all
                verdict[2] = limit_all
                return False
            continue
        part[e, blamed] = EXCLUDED
        for k in range(n):
            if antenna[k] == blamed and held[arc[k]] == held[arc[k]]:
                struck[k] = 1
        log_event(events, numbers, counter, e, -1 - blamed, np.int64(E_ANTENNA_EXCLUDED), chi2_all, limit_all)
        return solved
