"""Compiled filter and smoother of attitude and angular rate, epoch by epoch.

A pose has four rows: those of the rotation R from body to north, east, down, and the rate in body axes. The
error of the state is (e, d): the rotation R of the truth is R_estimate exp([e]x) with e in body axes, the
rate in body axes is that of the estimate plus d. A step of length t turns R by exp([t rate]x):

    e <- exp(-[t rate]x) e + t J(t rate) d,     J the right Jacobian of the rotation group,

which is exact to first order in the error at any rate. Observations are white rows y = A p + noise of
variance one, p the stacked coordinates R l of all antennas in the navigation frame. Rows see differences of
antennas only, so that no antenna is the reference, and an antenna without signals has columns of zeros;
leaving an antenna out is eliminating its three columns from the rows.

The update is iterated (Gauss-Newton), and its innovation is the one linearised about the result; otherwise
the curvature of a turn by some degrees would count as an error of the vectors.

Errors of the body coordinates stay the same from epoch to epoch and must not average out. The sensitivity of
the state to them is carried beside the covariance of the noise ("consider" parameters); it takes part in the
tests.
"""

import numpy as np

from .constrained import eigen_symmetric_3
from .engine import cholesky_invert, invert_3
from .jit import kernel

# What is carried, beside pose, covariance and sensitivity.
HAS_STATE, N_REJECTED, STATE_TIME, UPDATE_TIME, SEGMENT, N_EVENTS, IS_PREDICTED, NO_RECOVERY = range(8)
N_CARRIED = 8

# Columns of what an epoch is given: GPS time, whether it is one of the vectors' epochs, number of white rows.
TIME, IS_EPOCH, N_ROWS = 0, 1, 2

# Settings that are whole numbers, and that are not; the noise of three rates comes first.
IS_GATED, MAX_PASSES, LOCK_OUT_EPOCHS, HAS_RECOVERY, IS_PRINTED = range(5)
NOISE, MAX_PREDICTION_NS, LOCAL_LIMIT = 0, 3, 4

# Rows of the limits: global, global beyond any doubt, of a vector; columns are degrees of freedom.
GLOBAL, STRICT, OF_VECTOR = 0, 1, 2

# Columns of the statistics of an epoch, before anything was left out.
CHI2, CHI2_LIMIT, DOF, LOCAL, VECTOR = range(5)
N_STATISTICS = 5

# Columns of the marks of an epoch, and what an antenna does at one.
STATUS, STRETCH = 0, 1
ABSENT, USED, REJECTED = 0, 1, 2

# Kinds of events, spelt out in truenorth.attitude.filter_run, and an event of no antenna.
E_REJECTED, E_EPOCH_REJECTED, E_DROPPED = 1.0, 2.0, 3.0
NOBODY = -1.0

# Why the loop came back.
DONE, NEEDS_START, LOCKED_OUT = 0, 1, 2

# States of an epoch, equal to truenorth.attitude.filter_state.FilterStatus (held equal by a test).
S_NONE, S_PREDICTED, S_UPDATED = 0, 1, 2

_NODES = (0.04691007703066800, 0.23076534494715846, 0.5, 0.76923465505284154, 0.95308992296933200)
_WEIGHTS = (
    0.11846344252809454,
    0.23931433524968324,
    0.28444444444444444,
    0.23931433524968324,
    0.11846344252809454,
)
"""Gauss-Legendre on the unit interval: the noise of a step, exact to the ninth power of the turn."""

# Sizes as typed numbers: a literal would compile what takes it anew.
_STATE = np.int64(6)
_ROT = np.int64(3)
_ONE = np.int64(1)
BLOCK = np.int64(3)

MAX_ITERATIONS = 8
_SETTLED = 1e-8
"""Square of the last step over the variance at which the iteration ends: a ten-thousandth of an sd."""

_WEAK = 1e-3
"""Share of the determinant of an epoch's information on the attitude; with less left, an axis is free."""

_EMPTY = 1e-6
"""Columns shorter than this share of the longest hold rounding only."""


@kernel
def whiten_epochs(epochs, cov, vector, jump, rows, y):
    """White rows of epochs with the same antennas; -1, or the first one whose covariance is not definite.

    With the factor of the covariance, C = F F^T, the rows are F^-1 jump and the observations F^-1 z. `cov`
    becomes the factors.
    """
    n = vector.shape[1]
    for e in range(len(epochs)):
        at = epochs[e]
        for i in range(n):
            for j in range(i + 1):
                value = cov[e, i, j]
                for k in range(j):
                    value -= cov[e, i, k] * cov[e, j, k]
                if j < i:
                    cov[e, i, j] = value / cov[e, j, j]
                elif value > 1e-12 * cov[e, i, i]:
                    cov[e, i, i] = np.sqrt(value)
                else:
                    return e
            for c in range(jump.shape[1]):
                value = jump[i, c]
                for k in range(i):
                    value -= cov[e, i, k] * rows[at, k, c]
                rows[at, i, c] = value / cov[e, i, i]
            value = vector[e, i]
            for k in range(i):
                value -= cov[e, i, k] * y[at, k]
            y[at, i] = value / cov[e, i, i]
    return -1


@kernel
def copy(source, target):
    """Copy a matrix into the corner of another one."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


@kernel
def turn(x, y, z, out):
    """Rotation matrix of the rotation vector (x, y, z), Rodrigues."""
    square = x * x + y * y + z * z
    if square > 1e-8:
        angle = np.sqrt(square)
        first = np.sin(angle) / angle
        half = np.sin(0.5 * angle) / angle
        second = 2.0 * half * half
    else:
        first = 1.0 - square / 6.0
        second = 0.5 - square / 24.0
    out[0, 0] = 1.0 - second * (y * y + z * z)
    out[1, 1] = 1.0 - second * (x * x + z * z)
    out[2, 2] = 1.0 - second * (x * x + y * y)
    out[0, 1] = second * x * y - first * z
    out[1, 0] = second * x * y + first * z
    out[0, 2] = second * x * z + first * y
    out[2, 0] = second * x * z - first * y
    out[1, 2] = second * y * z - first * x
    out[2, 1] = second * y * z + first * x


@kernel
def right_jacobian(x, y, z, out):
    """J with exp([v + d]x) = exp([v]x) exp([J d]x) to first order in d, v = (x, y, z)."""
    square = x * x + y * y + z * z
    if square > 1e-4:
        angle = np.sqrt(square)
        half = np.sin(0.5 * angle) / angle
        first = -2.0 * half * half
        second = (angle - np.sin(angle)) / (square * angle)
    else:
        first = -0.5 + square / 24.0
        second = 1.0 / 6.0 - square / 120.0
    out[0, 0] = 1.0 - second * (y * y + z * z)
    out[1, 1] = 1.0 - second * (x * x + z * z)
    out[2, 2] = 1.0 - second * (x * x + y * y)
    out[0, 1] = second * x * y - first * z
    out[1, 0] = second * x * y + first * z
    out[0, 2] = second * x * z + first * y
    out[2, 0] = second * x * z - first * y
    out[1, 2] = second * y * z - first * x
    out[2, 1] = second * y * z + first * x


@kernel
def right_jacobian_inverse(x, y, z, out):
    """Inverse of `right_jacobian`, for angles below a full turn."""
    square = x * x + y * y + z * z
    if square > 1e-3:
        half = 0.5 * np.sqrt(square)
        second = (1.0 - half * np.cos(half) / np.sin(half)) / square
    else:
        second = 1.0 / 12.0 + square / 720.0
    out[0, 0] = 1.0 - second * (y * y + z * z)
    out[1, 1] = 1.0 - second * (x * x + z * z)
    out[2, 2] = 1.0 - second * (x * x + y * y)
    out[0, 1] = second * x * y - 0.5 * z
    out[1, 0] = second * x * y + 0.5 * z
    out[0, 2] = second * x * z + 0.5 * y
    out[2, 0] = second * x * z - 0.5 * y
    out[1, 2] = second * y * z - 0.5 * x
    out[2, 1] = second * y * z + 0.5 * x


@kernel
def rotation_vector_between(start, end, out):
    """Rotation vector v with end = start exp([v]x), below a half turn, in the first column of out."""
    trace = 0.0
    for i in range(3):
        for j in range(3):
            trace += start[i, j] * end[i, j]
    x, y, z = 0.0, 0.0, 0.0
    for i in range(3):
        x += start[i, 2] * end[i, 1] - start[i, 1] * end[i, 2]
        y += start[i, 0] * end[i, 2] - start[i, 2] * end[i, 0]
        z += start[i, 1] * end[i, 0] - start[i, 0] * end[i, 1]
    sine = 0.5 * np.sqrt(x * x + y * y + z * z)
    factor = 0.5
    if sine > 1e-9:
        factor = 0.5 * np.arctan2(sine, 0.5 * (trace - 1.0)) / sine
    out[0, 0] = factor * x
    out[1, 0] = factor * y
    out[2, 0] = factor * z


@kernel
def multiply(a, b, n, inner, m, out):
    """Product a b, (n, inner) by (inner, m)."""
    for i in range(n):
        for j in range(m):
            value = 0.0
            for k in range(inner):
                value += a[i, k] * b[k, j]
            out[i, j] = value


@kernel
def sandwich(a, cov, n, work):
    """Replace cov by a cov a^T, n x n and symmetric to the last digit."""
    multiply(a, cov, n, n, n, work)
    for i in range(n):
        for j in range(i + 1):
            value = 0.0
            for k in range(n):
                value += work[i, k] * a[j, k]
            cov[i, j] = value
            cov[j, i] = value


@kernel
def transport(jacobian, cov, sensitivity, n_consider, work):
    """Express the rotation error of covariance and sensitivity in another tangent space."""
    for j in range(6):
        for i in range(3):
            value = 0.0
            for k in range(3):
                value += jacobian[i, k] * cov[k, j]
            work[i, j] = value
    for i in range(3):
        for j in range(3, 6):
            cov[i, j] = work[i, j]
            cov[j, i] = work[i, j]
        for j in range(i + 1):
            value = 0.0
            for k in range(3):
                value += work[i, k] * jacobian[j, k]
            cov[i, j] = value
            cov[j, i] = value
    for j in range(n_consider):
        x, y, z = sensitivity[0, j], sensitivity[1, j], sensitivity[2, j]
        for i in range(3):
            sensitivity[i, j] = jacobian[i, 0] * x + jacobian[i, 1] * y + jacobian[i, 2] * z


@kernel
def predict(dt, numbers, is_printed, has_noise, pose, cov, sensitivity, n_consider, phi, work, small, other):
    """Take the state, its covariance and its sensitivity dt seconds further; phi is the transition.

    The first of `numbers` are the variances that the rates gain in a second, or with the printed form at
    every epoch.
    """
    turn(dt * pose[3, 0], dt * pose[3, 1], dt * pose[3, 2], small)
    multiply(pose, small, _ROT, _ROT, _ROT, other)
    right_jacobian(dt * pose[3, 0], dt * pose[3, 1], dt * pose[3, 2], work)
    for i in range(3):
        for j in range(3):
            pose[i, j] = other[i, j]
            # The state turns by the rotation, its error by the transpose.
            phi[i, j] = small[j, i]
            phi[i, j + 3] = dt * work[i, j]
            phi[i + 3, j] = 0.0
            phi[i + 3, j + 3] = 1.0 if i == j else 0.0
    sandwich(phi, cov, _STATE, work)
    for c in range(n_consider):
        for i in range(3):
            value = 0.0
            for k in range(6):
                value += phi[i, k] * sensitivity[k, c]
            work[i, 0] = value
        for i in range(3):
            sensitivity[i, c] = work[i, 0]
    if not has_noise:
        return
    for i in range(3):
        cov[i + 3, i + 3] += numbers[i] if is_printed else numbers[i] * dt
    if is_printed:
        return
    for node in range(5):
        span = _NODES[node] * dt
        right_jacobian(span * pose[3, 0], span * pose[3, 1], span * pose[3, 2], small)
        weight = _WEIGHTS[node] * dt * span
        for i in range(3):
            for j in range(3):
                cross = weight * small[i, j] * numbers[j]
                cov[i, j + 3] += cross
                cov[j + 3, i] += cross
                for k in range(3):
                    cov[k, i] += span * cross * small[k, j]


@kernel
def linearise(rows, y, n_rows, body, n_antennas, rot, eta, turned, jacobian, design_p, design, misfit):
    """Misfit of the rows at rot exp([eta]x), and its derivative to eta.

    `turned` becomes that rotation, `design_p` the derivative of the antennas' coordinates.
    """
    turn(eta[0], eta[1], eta[2], jacobian)
    for i in range(3):
        for j in range(3):
            turned[i, j] = (
                rot[i, 0] * jacobian[0, j] + rot[i, 1] * jacobian[1, j] + rot[i, 2] * jacobian[2, j]
            )
    right_jacobian(eta[0], eta[1], eta[2], jacobian)
    for a in range(n_antennas):
        x, y_, z = body[a, 0], body[a, 1], body[a, 2]
        for i in range(3):
            # Row i of -R [l]x, then times the Jacobian.
            c0 = turned[i, 2] * y_ - turned[i, 1] * z
            c1 = turned[i, 0] * z - turned[i, 2] * x
            c2 = turned[i, 1] * x - turned[i, 0] * y_
            for j in range(3):
                design_p[3 * a + i, j] = c0 * jacobian[0, j] + c1 * jacobian[1, j] + c2 * jacobian[2, j]
            design_p[3 * a + i, 3] = turned[i, 0] * x + turned[i, 1] * y_ + turned[i, 2] * z
    for row in range(n_rows):
        d0, d1, d2, value = 0.0, 0.0, 0.0, y[row]
        for c in range(3 * n_antennas):
            factor = rows[row, c]
            d0 += factor * design_p[c, 0]
            d1 += factor * design_p[c, 1]
            d2 += factor * design_p[c, 2]
            value -= factor * design_p[c, 3]
        design[row, 0] = d0
        design[row, 1] = d1
        design[row, 2] = d2
        misfit[row] = value


@kernel
def estimate(
    rows, y, n_rows, body, n_antennas, rot, prior_inverse, eta, turned, jacobian, design_p, design, misfit,
    normal, posterior
):  # fmt: skip
    """Turn eta that fits prior and rows best; False where it cannot be found.

    `misfit` becomes the innovation against the prior, linearised about the result, `design` the derivative
    there, `posterior` the covariance of eta.
    """
    for i in range(3):
        eta[i] = 0.0
    for _ in range(MAX_ITERATIONS):
        linearise(rows, y, n_rows, body, n_antennas, rot, eta, turned, jacobian, design_p, design, misfit)
        for i in range(3):
            for j in range(3):
                normal[i, j] = prior_inverse[i, j]
        g0, g1, g2 = 0.0, 0.0, 0.0
        for row in range(n_rows):
            d0, d1, d2 = design[row, 0], design[row, 1], design[row, 2]
            value = misfit[row] + d0 * eta[0] + d1 * eta[1] + d2 * eta[2]
            misfit[row] = value
            g0 += d0 * value
            g1 += d1 * value
            g2 += d2 * value
            normal[0, 0] += d0 * d0
            normal[0, 1] += d0 * d1
            normal[0, 2] += d0 * d2
            normal[1, 1] += d1 * d1
            normal[1, 2] += d1 * d2
            normal[2, 2] += d2 * d2
        normal[1, 0], normal[2, 0], normal[2, 1] = normal[0, 1], normal[0, 2], normal[1, 2]
        if not invert_3(normal, posterior):
            return False
        step = 0.0
        for i in range(3):
            value = posterior[i, 0] * g0 + posterior[i, 1] * g1 + posterior[i, 2] * g2
            step += (value - eta[i]) ** 2
            eta[i] = value
        if step <= _SETTLED * (posterior[0, 0] + posterior[1, 1] + posterior[2, 2]):
            return True
    return step < 1e-4


@kernel
def innovation_inverse(
    n_rows,
    design,
    cov,
    rows,
    turned,
    n_antennas,
    sensitivity,
    consider,
    n_consider,
    lever,
    lever_cov,
    full,
    inverse,
):
    """Inverse of the covariance of the innovation: noise, prediction and body coordinates."""
    for i in range(n_rows):
        for j in range(i + 1):
            value = 1.0 if i == j else 0.0
            for a in range(3):
                for b in range(3):
                    value += design[i, a] * cov[a, b] * design[j, b]
            full[i, j] = value
    if n_consider > 0:
        # Derivative of the innovation to the coordinates: by the prediction, and at once.
        for row in range(n_rows):
            for a in range(n_antennas):
                for j in range(3):
                    c = 3 * a + j
                    value = 0.0
                    for i in range(3):
                        value += rows[row, 3 * a + i] * turned[i, j] + design[row, i] * sensitivity[i, c]
                    lever[row, c] = value
        multiply(lever, consider, n_rows, n_consider, n_consider, lever_cov)
        for i in range(n_rows):
            for j in range(i + 1):
                for c in range(n_consider):
                    full[i, j] += lever_cov[i, c] * lever[j, c]
    return cholesky_invert(full, n_rows, inverse)


@kernel
def judge_antennas(
    rows,
    n_rows,
    n_antennas,
    inverse,
    misfit,
    local_limit,
    limits,
    back,
    block,
    axes,
    values,
    found,
    is_fit,
):
    """Global, local and vector-wise tests: found becomes chi-square, largest |w|, largest 3-D statistic.

    Antennas are compared by their 3-D statistic over the limit of its rank. Returns the antenna with the
    largest; `is_fit` becomes 0 where one of them, or of its components, fails.
    """
    chi2 = 0.0
    for i in range(n_rows):
        value = 0.0
        for j in range(n_rows):
            value += inverse[i, j] * misfit[j]
        back[i, 3] = value
        chi2 += value * misfit[i]
    scale = 0.0
    for c in range(3 * n_antennas):
        square = 0.0
        for i in range(n_rows):
            square += rows[i, c] * rows[i, c]
        scale = max(scale, square)
    largest_local, largest_vector, largest_ratio = 0.0, 0.0, -1.0
    worst = -1
    is_fit[0] = 1
    for a in range(n_antennas):
        square = 0.0
        for i in range(n_rows):
            for c in range(3 * a, 3 * a + 3):
                square += rows[i, c] * rows[i, c]
        if square <= _EMPTY * _EMPTY * scale:
            continue
        for i in range(n_rows):
            for c in range(3):
                value = 0.0
                for j in range(n_rows):
                    value += inverse[i, j] * rows[j, 3 * a + c]
                back[i, c] = value
        ratio = 0.0
        for c in range(3):
            slope = 0.0
            for i in range(n_rows):
                slope += rows[i, 3 * a + c] * back[i, 3]
            back[n_rows, c] = slope
            for d in range(c + 1):
                value = 0.0
                for i in range(n_rows):
                    value += rows[i, 3 * a + d] * back[i, c]
                block[c, d] = value
                block[d, c] = value
            if block[c, c] > 1e-9 * scale:
                local = abs(slope) / np.sqrt(block[c, c])
                largest_local = max(largest_local, local)
                ratio = max(ratio, (local / local_limit) ** 2)
        eigen_symmetric_3(block, values, axes)
        statistic = 0.0
        rank = 0
        for e in range(3):
            if values[e] > 1e-9 * values[2]:
                rank += 1
                slope = 0.0
                for c in range(3):
                    slope += axes[c, e] * back[n_rows, c]
                statistic += slope * slope / values[e]
        largest_vector = max(largest_vector, statistic)
        if statistic > limits[OF_VECTOR, rank] or ratio > 1.0:
            is_fit[0] = 0
        ratio = statistic / limits[OF_VECTOR, rank]
        if ratio > largest_ratio:
            largest_ratio = ratio
            worst = a
            found[3] = statistic
            found[4] = limits[OF_VECTOR, rank]
    found[0] = chi2
    found[1] = largest_local
    found[2] = largest_vector
    return worst


@kernel
def eliminate(rows, y, n_rows, n_columns, first, count):
    """Rows that do not see columns first to first + count - 1; returns how many are left.

    A reflection gathers a column in the last row, which is then left out: the noise stays white.
    """
    scale = 0.0
    for c in range(n_columns):
        square = 0.0
        for i in range(n_rows):
            square += rows[i, c] * rows[i, c]
        scale = max(scale, square)
    for column in range(first, first + count):
        square = 0.0
        for i in range(n_rows):
            square += rows[i, column] * rows[i, column]
        if n_rows == 0 or square <= _EMPTY * _EMPTY * scale:
            for i in range(n_rows):
                rows[i, column] = 0.0
            continue
        last = n_rows - 1
        top = rows[last, column]
        length = np.sqrt(square)
        if top < 0.0:
            length = -length
        # The mirror's vector is the column itself with its last element changed.
        pivot = top + length
        factor = 1.0 / (length * pivot)
        for c in range(n_columns):
            if c == column:
                continue
            value = pivot * rows[last, c]
            for i in range(last):
                value += rows[i, column] * rows[i, c]
            value *= factor
            for i in range(last):
                rows[i, c] -= value * rows[i, column]
        value = pivot * y[last]
        for i in range(last):
            value += rows[i, column] * y[i]
        value *= factor
        for i in range(last):
            y[i] -= value * rows[i, column]
            rows[i, column] = 0.0
        n_rows = last
    return n_rows


@kernel
def information_volume(design, n_rows):
    """Determinant of the information that rows have on the attitude."""
    n00, n01, n02, n11, n12, n22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for row in range(n_rows):
        x, y, z = design[row, 0], design[row, 1], design[row, 2]
        n00 += x * x
        n01 += x * y
        n02 += x * z
        n11 += y * y
        n12 += y * z
        n22 += z * z
    return n00 * (n11 * n22 - n12 * n12) - n01 * (n01 * n22 - n12 * n02) + n02 * (n01 * n12 - n11 * n02)


@kernel
def log_event(events, carried, epoch, kind, antenna, statistic, limit):
    """Note what happened, as long as there is room."""
    n = carried[N_EVENTS]
    if n < len(events):
        events[n, 0] = epoch
        events[n, 1] = kind
        events[n, 2] = antenna
        events[n, 3] = statistic
        events[n, 4] = limit
        carried[N_EVENTS] = n + 1


@kernel
def update(
    rows, n_rows, turned, eta, design, posterior, prior_inverse, pose, cov, sensitivity, n_consider, gain,
    jacobian, work
):  # fmt: skip
    """Update by the turn eta and its covariance; rates learn through their correlation with it."""
    # Regression of the rates on the rotation, and what of their covariance it leaves.
    for i in range(3):
        for j in range(3):
            value = 0.0
            for k in range(3):
                value += cov[i + 3, k] * prior_inverse[k, j]
            gain[i, j] = value
    for i in range(3):
        for j in range(i + 1):
            value = cov[i + 3, j + 3]
            for k in range(3):
                value -= gain[i, k] * cov[j + 3, k]
            work[i, j] = value
    for i in range(3):
        for j in range(3):
            value = 0.0
            for k in range(3):
                value += gain[i, k] * posterior[k, j]
            work[i + 3, j] = value
    for i in range(3):
        for j in range(i + 1):
            value = work[i, j]
            for k in range(3):
                value += work[i + 3, k] * gain[j, k]
            cov[i + 3, j + 3] = value
            cov[j + 3, i + 3] = value
        for j in range(3):
            cov[i + 3, j] = work[i + 3, j]
            cov[j, i + 3] = work[i + 3, j]
            cov[i, j] = posterior[i, j]
            pose[i, j] = turned[i, j]
        pose[3, i] += gain[i, 0] * eta[0] + gain[i, 1] * eta[1] + gain[i, 2] * eta[2]
    # What the coordinates do to the innovation goes into the state with the gain.
    for c in range(n_consider):
        antenna = c // 3
        axis = c - 3 * antenna
        for i in range(3):
            work[0, i] = 0.0
        for row in range(n_rows):
            value = 0.0
            for i in range(3):
                value += rows[row, 3 * antenna + i] * turned[i, axis] + design[row, i] * sensitivity[i, c]
            for i in range(3):
                work[0, i] += design[row, i] * value
        for i in range(3):
            work[1, i] = (
                posterior[i, 0] * work[0, 0] + posterior[i, 1] * work[0, 1] + posterior[i, 2] * work[0, 2]
            )
        for i in range(3):
            sensitivity[i, c] -= work[1, i]
            sensitivity[i + 3, c] -= (
                gain[i, 0] * work[1, 0] + gain[i, 1] * work[1, 1] + gain[i, 2] * work[1, 2]
            )
    right_jacobian(eta[0], eta[1], eta[2], jacobian)
    transport(jacobian, cov, sensitivity, n_consider, work)


@kernel
def filter_epochs(
    first, epochs, rows, y, body, consider, n_consider, numbers, switches, limits, carried, pose, cov,
    sensitivity, out_pose, out_cov, out_sensitivity, before_pose, before_cov, marks, statistics, parts, events
):  # fmt: skip
    """Filter from epoch `first` on, until the end or until the caller must find an attitude.

    The caller owns all that is carried, so that epochs may come in blocks. Returns the epoch reached and why:
    `NEEDS_START` where there is no state and an epoch has rows, `LOCKED_OUT` after so many rejected epochs.
    """
    m = len(body)
    r_max, c_max = rows.shape[1], rows.shape[2]
    tall = np.empty((7, r_max + 1, max(r_max, c_max, 6)))
    a_rows, design, lever, lever_cov = tall[0], tall[1], tall[2], tall[3]
    full, inverse, back = tall[4], tall[5], tall[6]
    a_y, misfit = np.empty(r_max), np.empty(r_max)
    design_p = np.empty((c_max, 4))
    scratch = np.empty((11, 6, 6))
    phi, work, small, other = scratch[0], scratch[1], scratch[2], scratch[3]
    prior_inverse, turned, jacobian, normal = scratch[4], scratch[5], scratch[6], scratch[7]
    posterior, block, axes = scratch[8], scratch[9], scratch[10]
    moved = np.empty((6, c_max))
    eta, values, found, is_fit = np.zeros(3), np.empty(3), np.zeros(5), np.ones(1, dtype=np.int64)
    for k in range(first, len(epochs)):
        time = epochs[k, TIME]
        marks[k, STATUS], marks[k, STRETCH] = S_NONE, -1
        if carried[HAS_STATE] and time - carried[UPDATE_TIME] > numbers[MAX_PREDICTION_NS]:
            carried[HAS_STATE] = 0
            log_event(
                events, carried, k, E_DROPPED, NOBODY,
                1e-9 * (time - carried[UPDATE_TIME]), 1e-9 * numbers[MAX_PREDICTION_NS],
            )  # fmt: skip
        r = epochs[k, N_ROWS]
        if not carried[HAS_STATE]:
            if r > 0:
                return k, NEEDS_START
            continue
        if not carried[IS_PREDICTED]:
            predict(
                1e-9 * (time - carried[STATE_TIME]), numbers, switches[IS_PRINTED],
                switches[IS_PRINTED] == 0 or epochs[k, IS_EPOCH] == 1,
                pose, cov, sensitivity, n_consider, phi, work, small, other,
            )  # fmt: skip
            carried[STATE_TIME] = time
        carried[IS_PREDICTED] = 0
        if len(before_pose) > 0:
            copy(pose, before_pose[k])
            copy(cov, before_cov[k])
            multiply(sensitivity, consider, _STATE, n_consider, n_consider, moved)
            for c in range(n_consider):
                for i in range(6):
                    for j in range(6):
                        before_cov[k, i, j] += moved[i, c] * sensitivity[j, c]
        marks[k, STATUS], marks[k, STRETCH] = S_PREDICTED, carried[SEGMENT]
        if r > 0:
            n_logged = carried[N_EVENTS]
            copy(rows[k], a_rows)
            for i in range(r):
                a_y[i] = y[k, i]
            is_good = invert_3(cov, prior_inverse)
            passes = 0
            any_rejected = False
            volume = 0.0
            while r > 0:
                is_good = (
                    is_good
                    and estimate(
                        a_rows, a_y, r, body, m, pose, prior_inverse, eta, turned, jacobian, design_p, design,
                        misfit, normal, posterior,
                    )
                    and innovation_inverse(
                        r, design, cov, a_rows, turned, m, sensitivity, consider, n_consider, lever,
                        lever_cov, full, inverse,
                    )
                )  # fmt: skip
                if not is_good:
                    any_rejected = True
                    r = 0
                    break
                worst = judge_antennas(
                    a_rows, r, m, inverse, misfit, numbers[LOCAL_LIMIT], limits, back, block, axes, values,
                    found, is_fit,
                )  # fmt: skip
                if passes == 0:
                    volume = information_volume(design, r)
                    statistics[k, CHI2] = found[0]
                    statistics[k, CHI2_LIMIT] = limits[GLOBAL, r]
                    statistics[k, DOF] = r
                    statistics[k, LOCAL] = found[1]
                    statistics[k, VECTOR] = found[2]
                if (
                    not switches[IS_GATED]
                    or found[0] <= limits[GLOBAL, r]
                    or (is_fit[0] and found[0] <= limits[STRICT, r])
                ):
                    break
                any_rejected = True
                if passes == switches[MAX_PASSES]:
                    r = 0
                    break
                r = eliminate(a_rows, a_y, r, c_max, 3 * worst, BLOCK)
                parts[k, worst] = REJECTED
                if r > 0:
                    log_event(events, carried, k, E_REJECTED, 1.0 * worst, found[3], found[4])
                passes += 1
            # Does what is left hold all three axes by itself? If not, a wrong prediction would stay wrong.
            is_weak = any_rejected and (r == 0 or information_volume(design, r) <= _WEAK * volume)
            n_rejected = carried[N_REJECTED] + 1 if is_weak else 0
            if (
                n_rejected >= switches[LOCK_OUT_EPOCHS]
                and switches[HAS_RECOVERY]
                and not carried[NO_RECOVERY]
            ):
                carried[N_EVENTS] = n_logged
                return k, LOCKED_OUT
            carried[N_REJECTED] = n_rejected
            carried[NO_RECOVERY] = 0
            if r > 0:
                update(
                    a_rows, r, turned, eta, design, posterior, prior_inverse, pose, cov, sensitivity,
                    n_consider, small, jacobian, work,
                )  # fmt: skip
                marks[k, STATUS] = S_UPDATED
                carried[UPDATE_TIME] = time
            else:
                for a in range(m):
                    if parts[k, a] == USED:
                        parts[k, a] = REJECTED
                log_event(
                    events, carried, k, E_EPOCH_REJECTED, NOBODY,
                    statistics[k, CHI2], statistics[k, CHI2_LIMIT],
                )  # fmt: skip
        copy(pose, out_pose[k])
        copy(cov, out_cov[k])
        if n_consider > 0:
            copy(sensitivity, out_sensitivity[k])
    return len(epochs), DONE


@kernel
def smooth_epochs(epochs, numbers, is_printed, n_consider, marks, pose, cov, sensitivity):
    """Rauch, Tung and Striebel's smoother on the group, in place of the filtered states.

    Stretches within which the filter was not started anew are smoothed each by itself. What the smoothed
    state of the next epoch differs from the predicted one by is a vector of the tangent space there; errors
    are carried between tangent spaces by the Jacobian of the group.
    """
    scratch = np.empty((10, 6, 6))
    phi, work, small, other = scratch[0], scratch[1], scratch[2], scratch[3]
    next_cov, smooth_cov, inverse, gain = scratch[4], scratch[5], scratch[6], scratch[7]
    change, step = scratch[8], scratch[9]
    next_pose = np.empty((4, 3))
    next_sensitivity, smooth_sensitivity = np.empty((6, n_consider)), np.empty((6, n_consider))
    for k in range(len(epochs) - 2, -1, -1):
        if marks[k, STRETCH] < 0 or marks[k, STRETCH] != marks[k + 1, STRETCH]:
            continue
        copy(pose[k], next_pose)
        copy(cov[k], next_cov)
        copy(cov[k + 1], smooth_cov)
        if n_consider > 0:
            copy(sensitivity[k], next_sensitivity)
            copy(sensitivity[k + 1], smooth_sensitivity)
        predict(
            1e-9 * (epochs[k + 1, TIME] - epochs[k, TIME]), numbers, is_printed,
            is_printed == 0 or epochs[k + 1, IS_EPOCH] == 1,
            next_pose, next_cov, next_sensitivity, n_consider, phi, work, small, other,
        )  # fmt: skip
        # The gain, P phi^T (P of the prediction)^-1.
        copy(next_cov, work)
        if not cholesky_invert(work, _STATE, inverse):
            continue
        multiply(inverse, phi, _STATE, _STATE, _STATE, work)
        multiply(work, cov[k], _STATE, _STATE, _STATE, other)
        for i in range(6):
            for j in range(6):
                gain[i, j] = other[j, i]
        rotation_vector_between(next_pose, pose[k + 1], change)
        for i in range(3):
            change[i + 3, 0] = pose[k + 1, 3, i] - next_pose[3, i]
        right_jacobian_inverse(change[0, 0], change[1, 0], change[2, 0], small)
        transport(small, smooth_cov, smooth_sensitivity, n_consider, work)
        for i in range(6):
            for j in range(6):
                smooth_cov[i, j] -= next_cov[i, j]
            for c in range(n_consider):
                smooth_sensitivity[i, c] -= next_sensitivity[i, c]
        sandwich(gain, smooth_cov, _STATE, work)
        multiply(gain, smooth_sensitivity, _STATE, _STATE, n_consider, next_sensitivity)
        multiply(gain, change, _STATE, _STATE, _ONE, step)
        for i in range(6):
            for j in range(6):
                smooth_cov[i, j] += cov[k, i, j]
            for c in range(n_consider):
                next_sensitivity[i, c] += sensitivity[k, i, c]
        turn(step[0, 0], step[1, 0], step[2, 0], small)
        multiply(pose[k], small, _ROT, _ROT, _ROT, other)
        right_jacobian(step[0, 0], step[1, 0], step[2, 0], small)
        transport(small, smooth_cov, next_sensitivity, n_consider, work)
        for i in range(3):
            pose[k, 3, i] += step[i + 3, 0]
            for j in range(3):
                pose[k, i, j] = other[i, j]
        copy(smooth_cov, cov[k])
        if n_consider > 0:
            copy(next_sensitivity, sensitivity[k])
