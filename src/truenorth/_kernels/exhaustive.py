"""Loops of the exhaustive search: attitude of every integer set, and baselines on a sphere.

References: Oguz 2006 (METU), sec. 3.3, eq. (3.8)-(3.19), with the attitude step made regular; Cohen
1992 (the attitude cost).
"""

import numpy as np

from .jit import kernel


@kernel
def _solve3(a, b, out):
    """Solve a symmetric positive definite 3 by 3 system by Cholesky factors."""
    l00 = np.sqrt(a[0, 0])
    l10 = a[1, 0] / l00
    l20 = a[2, 0] / l00
    l11 = np.sqrt(a[1, 1] - l10 * l10)
    l21 = (a[2, 1] - l20 * l10) / l11
    l22 = np.sqrt(a[2, 2] - l20 * l20 - l21 * l21)
    y0 = b[0] / l00
    y1 = (b[1] - l10 * y0) / l11
    y2 = (b[2] - l20 * y0 - l21 * y1) / l22
    out[2] = y2 / l22
    out[1] = (y1 - l21 * out[2]) / l11
    out[0] = (y0 - l10 * out[1] - l20 * out[2]) / l00


@kernel
def _across(v, out):
    """Fill with the unit vector of the axis that is farthest from a vector."""
    smallest = 0
    for r in range(3):
        out[r] = 0.0
        if abs(v[r]) < abs(v[smallest]):
            smallest = r
    out[smallest] = 1.0


@kernel
def _triad(first, second, out):
    """Right-handed orthonormal columns along the first vector, then the plane of both."""
    n = np.sqrt(first[0] ** 2 + first[1] ** 2 + first[2] ** 2)
    for r in range(3):
        out[r, 0] = first[r] / n
    dot = 0.0
    for r in range(3):
        dot += out[r, 0] * second[r]
    n = 0.0
    for r in range(3):
        out[r, 1] = second[r] - dot * out[r, 0]
        n += out[r, 1] ** 2
    n = np.sqrt(n)
    for r in range(3):
        out[r, 1] /= n
    for r in range(3):
        i, j = (r + 1) % 3, (r + 2) % 3
        out[r, 2] = out[i, 0] * out[j, 1] - out[j, 0] * out[i, 1]


@kernel
def _attitude_step(rot, turn):
    """Premultiply a rotation by the exponential of a rotation vector, in place."""
    angle = np.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    if angle < 1e-9:
        s, c = 1.0 - angle * angle / 6.0, 0.5
    else:
        s, c = np.sin(angle) / angle, (1.0 - np.cos(angle)) / (angle * angle)
    v = np.empty(3)
    for k in range(3):
        dot = 0.0
        for r in range(3):
            v[r] = rot[r, k]
            dot += turn[r] * v[r]
        cos = 1.0 - c * angle * angle
        for r in range(3):
            i, j = (r + 1) % 3, (r + 2) % 3
            rot[r, k] = cos * v[r] + s * (turn[i] * v[j] - turn[j] * v[i]) + c * dot * turn[r]


@kernel
def attitude_of_integer_sets(
    index, bound, fraction_cyc, direction, baseline_cyc, start_map, from_identity, cost_limit, early_exit, rot
):
    """Least attitude cost of single-difference integer sets, given by their place in the list of all.

    The set with place ``index`` (from 0) has the digits of that number to the base 2 bound + 1, first
    baseline and first satellite slowest, each minus bound.

    Parameters
    ----------
    index : ndarray of int64, shape (t,)
        Sets to evaluate.
    bound : int
        Largest integer.
    fraction_cyc : ndarray, shape (epochs, b, s)
        Single-difference phases without their integers, cycles.
    direction : ndarray, shape (epochs, s, 3)
        Unit vectors to the satellites, local frame.
    baseline_cyc : ndarray, shape (b, 3)
        Baselines in the body frame, in wavelengths.
    start_map : ndarray, shape (epochs, 3, s)
        Pseudo-inverse of the directions.
    from_identity : bool
        Start from the unit matrix as the thesis does, else from the least-squares vectors.
    cost_limit : float
        With `early_exit`: stop at the first set whose cost is not above.
    early_exit : bool
        Whether to stop.
    rot : ndarray, shape (t or 0, epochs, 3, 3)
        Filled with the rotations body from local, if it has room.

    Returns
    -------
    cost : ndarray, shape (t,)
        Sum of squared residuals in cycles, infinite for sets not evaluated.
    n_evaluated : int
        Sets evaluated.
    """
    n_epochs, n_base, n_sat = fraction_cyc.shape
    n_digits = n_base * n_sat
    base = 2 * bound + 1
    cost = np.empty(index.shape[0])
    for t in range(index.shape[0]):
        cost[t] = np.inf
    r = np.empty((n_base, n_sat))
    a = np.empty((3, 3))
    local = np.empty((3, 3))
    body = np.empty((3, 3))
    normal = np.empty((3, 3))
    right = np.empty(3)
    turn = np.empty(3)
    h = np.empty(3)
    vector = np.zeros((2, 3))
    second = np.empty(3)
    for t in range(index.shape[0]):
        total = 0.0
        for e in range(n_epochs):
            rest = index[t]
            for d in range(n_digits - 1, -1, -1):
                i, j = d // n_sat, d % n_sat
                r[i, j] = fraction_cyc[e, i, j] + (rest % base) - bound
                rest //= base
            for p in range(3):
                for q in range(3):
                    a[p, q] = 1.0 if p == q else 0.0
            if not from_identity:
                for i in range(min(2, n_base)):
                    for p in range(3):
                        vector[i, p] = 0.0
                        for j in range(n_sat):
                            vector[i, p] += start_map[e, p, j] * r[i, j]
                if n_base > 1:
                    _triad(baseline_cyc[0], baseline_cyc[1], body)
                    _triad(vector[0], vector[1], local)
                else:
                    # The turn about the only baseline is free: any second direction will do.
                    _across(baseline_cyc[0], second)
                    _triad(baseline_cyc[0], second, body)
                    _across(vector[0], second)
                    _triad(vector[0], second, local)
                for p in range(3):
                    for q in range(3):
                        a[p, q] = 0.0
                        for k in range(3):
                            a[p, q] += body[p, k] * local[q, k]
            value = np.inf
            damping = 1e-9
            backup = a.copy()
            for _ in range(60):
                now = 0.0
                for p in range(3):
                    right[p] = 0.0
                    for q in range(3):
                        normal[p, q] = 0.0
                for j in range(n_sat):
                    for p in range(3):
                        second[p] = (
                            a[p, 0] * direction[e, j, 0]
                            + a[p, 1] * direction[e, j, 1]
                            + a[p, 2] * direction[e, j, 2]
                        )
                    for i in range(n_base):
                        residual = r[i, j]
                        for p in range(3):
                            k, m = (p + 1) % 3, (p + 2) % 3
                            residual -= baseline_cyc[i, p] * second[p]
                            h[p] = second[k] * baseline_cyc[i, m] - second[m] * baseline_cyc[i, k]
                        now += residual * residual
                        for p in range(3):
                            right[p] += h[p] * residual
                            for q in range(3):
                                normal[p, q] += h[p] * h[q]
                if now > value * (1.0 + 1e-12):
                    # Uphill: take the step back and shorten it.
                    damping *= 30.0
                    for p in range(3):
                        for q in range(3):
                            a[p, q] = backup[p, q]
                    if damping > 1e6:
                        break
                    value = np.inf
                    continue
                gain = value - now
                value = now
                if gain < 1e-14 * (1.0 + now):
                    break
                # With one baseline the matrix is singular (the turn about it is not observable). The
                # damping picks the step of least norm.
                trace = normal[0, 0] + normal[1, 1] + normal[2, 2]
                for p in range(3):
                    normal[p, p] += damping * trace + 1e-300
                _solve3(normal, right, turn)
                for p in range(3):
                    for q in range(3):
                        backup[p, q] = a[p, q]
                _attitude_step(a, turn)
            total += value
            if rot.shape[0] > 0:
                for p in range(3):
                    for q in range(3):
                        rot[t, e, p, q] = a[p, q]
        cost[t] = total
        if early_exit and total <= cost_limit:
            return cost, t + 1
    return cost, index.shape[0]


@kernel
def sphere_minimum(normal, centre, radius, x):
    """Least value of ``(x - centre)' normal (x - centre)`` on a sphere, by damped Newton steps.

    The direction is turned in its tangent plane (azimuth and elevation of the baseline, without their
    singularity), starting at the direction of the centre.

    Parameters
    ----------
    normal : ndarray, shape (3, 3)
        Positive definite.
    centre : ndarray, shape (3,)
        Unconstrained minimum.
    radius : float
        Radius of the sphere around the origin.
    x : ndarray, shape (3,)
        Filled with the minimum.

    Returns
    -------
    float
        The value at the minimum.
    """
    u = np.empty(3)
    trial = np.empty(3)
    t1 = np.empty(3)
    t2 = np.empty(3)
    force = np.empty(3)
    n = np.sqrt(centre[0] ** 2 + centre[1] ** 2 + centre[2] ** 2)
    if n == 0.0:
        u[0], u[1], u[2] = 1.0, 0.0, 0.0
    else:
        for r in range(3):
            u[r] = centre[r] / n
    value = 0.0
    for r in range(3):
        for c in range(3):
            value += (radius * u[r] - centre[r]) * normal[r, c] * (radius * u[c] - centre[c])
    damping = 0.0
    for _ in range(50):
        # Two directions that span the tangent plane.
        _across(u, t1)
        dot = u[0] * t1[0] + u[1] * t1[1] + u[2] * t1[2]
        n = np.sqrt(1.0 - dot * dot)
        for r in range(3):
            t1[r] = (t1[r] - dot * u[r]) / n
        for r in range(3):
            i, j = (r + 1) % 3, (r + 2) % 3
            t2[r] = u[i] * t1[j] - u[j] * t1[i]
        a11 = 0.0
        a12 = 0.0
        a22 = 0.0
        b1 = 0.0
        b2 = 0.0
        for r in range(3):
            force[r] = 0.0
            for c in range(3):
                force[r] += normal[r, c] * (centre[c] - radius * u[c])
                a11 += t1[r] * normal[r, c] * t1[c]
                a12 += t1[r] * normal[r, c] * t2[c]
                a22 += t2[r] * normal[r, c] * t2[c]
            b1 += t1[r] * force[r]
            b2 += t2[r] * force[r]
        # The curvature of the sphere turns the pull towards the centre into stiffness.
        pull = (u[0] * force[0] + u[1] * force[1] + u[2] * force[2]) / radius
        a11 += pull
        a22 += pull
        # Lift the 2 by 2 matrix to positive definiteness, where the curvature made it indefinite.
        half = 0.5 * (a11 + a22)
        split = np.sqrt((0.5 * (a11 - a22)) ** 2 + a12 * a12)
        lift = max(0.0, 1e-6 * (abs(half) + split) - (half - split)) + damping * (abs(half) + split)
        a11 += lift
        a22 += lift
        det = a11 * a22 - a12 * a12
        s1 = (a22 * b1 - a12 * b2) / det / radius
        s2 = (a11 * b2 - a12 * b1) / det / radius
        angle = np.sqrt(s1 * s1 + s2 * s2)
        if angle < 1e-13:
            break
        shorten = 1.0 if angle < 1.0 else 1.0 / angle
        sine = np.sin(angle * shorten) / angle
        cosine = np.cos(angle * shorten)
        now = 0.0
        for r in range(3):
            trial[r] = cosine * u[r] + sine * (s1 * t1[r] + s2 * t2[r])
        for r in range(3):
            for c in range(3):
                now += (radius * trial[r] - centre[r]) * normal[r, c] * (radius * trial[c] - centre[c])
        if now > value:
            if now <= value * (1.0 + 1e-12):
                break
            damping = max(4.0 * damping, 0.1)
            if damping > 1e8:
                break
            continue
        done = value - now <= 1e-13 * value
        value = now
        damping *= 0.25
        n = np.sqrt(trial[0] ** 2 + trial[1] ** 2 + trial[2] ** 2)
        for r in range(3):
            u[r] = trial[r] / n
        if done:
            break
    for r in range(3):
        x[r] = radius * u[r]
    return value


@kernel
def search_on_sphere(
    phase_m, wavelength_m, first, count, whitener, baseline_map, normal, softest, radius, n_keep
):
    """All double-difference integer sets of a box, each with the best baseline of the known length.

    Parameters
    ----------
    phase_m, wavelength_m : ndarray, shape (m,)
        The enumerated rows.
    first, count : ndarray of int64, shape (m,)
        Smallest integer and number of integers of each row; the first row is slowest.
    whitener : ndarray, shape (m, m)
        Inverse Cholesky factor of the rows' covariance, lower triangular.
    baseline_map : ndarray, shape (3, m)
        Least-squares baseline from whitened, ambiguity-free phases.
    normal : ndarray, shape (3, 3)
        Normal matrix of the baseline.
    softest : float
        Its smallest eigenvalue.
    radius : float
        Known length, metres.
    n_keep : int
        Sets to keep.

    Returns
    -------
    integers : ndarray of int64, shape (n_keep, m)
    baseline : ndarray, shape (n_keep, 3)
    objective : ndarray, shape (n_keep,)
        Unordered.
    n_kept : int
    """
    m = phase_m.shape[0]
    integers = np.zeros((n_keep, m), dtype=np.int64)
    baseline = np.zeros((n_keep, 3))
    objective = np.zeros(n_keep)
    n = first.copy()
    w = np.zeros(m)
    free = np.empty(3)
    x = np.empty(3)
    n_kept = 0
    place = 0
    limit = np.inf
    changed = 0
    while True:
        for i in range(changed, m):
            w[i] = 0.0
            for j in range(i + 1):
                w[i] += whitener[i, j] * (phase_m[j] - wavelength_m[j] * n[j])
        norm2 = 0.0
        for r in range(3):
            free[r] = 0.0
            for i in range(m):
                free[r] += baseline_map[r, i] * w[i]
            norm2 += free[r] * free[r]
        omega = 0.0
        for i in range(m):
            omega += w[i] * w[i]
        for r in range(3):
            for c in range(3):
                omega -= free[r] * normal[r, c] * free[c]
        # No baseline of the known length can do better than this.
        least = omega + softest * (np.sqrt(norm2) - radius) ** 2
        if least < limit:
            value = omega + sphere_minimum(normal, free, radius, x)
            if value < limit:
                if n_kept < n_keep:
                    place = n_kept
                    n_kept += 1
                # Element by element: assigning a row costs three seconds of compilation.
                for i in range(m):
                    integers[place, i] = n[i]
                for r in range(3):
                    baseline[place, r] = x[r]
                objective[place] = value
                if n_kept == n_keep:
                    limit = -1.0
                    for k in range(n_keep):
                        if objective[k] > limit:
                            limit = objective[k]
                            place = k
        changed = m - 1
        while changed >= 0:
            n[changed] += 1
            if n[changed] < first[changed] + count[changed]:
                break
            n[changed] = first[changed]
            changed -= 1
        if changed < 0:
            return integers, baseline, objective, n_kept


@kernel
def baselines_on_sphere(normal, free, radius):
    """Baselines of a known length nearest to unconstrained ones.

    Parameters
    ----------
    normal : ndarray, shape (3, 3)
        Normal matrix.
    free : ndarray, shape (c, 3)
        Unconstrained baselines.
    radius : float
        Known length, metres.

    Returns
    -------
    baseline : ndarray, shape (c, 3)
    value : ndarray, shape (c,)
        Growth of the quadratic form.
    """
    baseline = np.empty_like(free)
    value = np.empty(free.shape[0])
    for k in range(free.shape[0]):
        value[k] = sphere_minimum(normal, free[k], radius, baseline[k])
    return baseline, value
