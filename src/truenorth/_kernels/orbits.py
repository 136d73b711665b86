"""Choice of ephemerides, and orbits and clocks from them: Kepler elements, GLONASS, SBAS, tables.

Ephemerides of all kinds come in one table with 24 columns in the order of `KEPLER_COLUMNS`; state
vectors fill the first 12. Times are int64 nanoseconds plus a float of seconds.
"""

import math

import numpy as np

from .jit import kernel

OK = 0
NO_EPHEMERIS = 1
TOO_OLD = 2
UNHEALTHY = 3
NOT_COMPUTABLE = 4

KEPLER = 0
KEPLER_GEO = 1
GLONASS = 2
SBAS = 3

_C = 299_792_458.0
_COS_5 = math.cos(math.radians(5.0))
_SIN_5 = math.sin(math.radians(5.0))
_TIE_NS = 60_000_000_000

# GLONASS ICD 5.1 (2008), table 3.2
_GLO_GM = 398_600.4418e9
_GLO_RE = 6_378_136.0
_GLO_J2 = 1_082_625.75e-9
_GLO_OMEGA = 7.292115e-5  # also the nominal rate of IERS Conventions 2010, for tables
_GLO_STEP_S = 60.0
_N_NODES = 256

# Only a caller's own choice of ephemerides can be this far off; it bounds the integration.
_LONGEST_S = 7.0 * 86_400.0


@kernel
def select_ephemerides(
    sat, time_ns, first, toe_ns, sent_ns, rank, window_ns, healthy, any_health, index, status,
):  # fmt: skip
    """Best ephemeris of each (satellite, time): best rank, then nearest toe, then latest sent.

    ``first`` has the rows of satellite s at ``first[s]:first[s + 1]``.
    """
    n_sats = first.shape[0] - 1
    last_time = np.zeros(n_sats, dtype=np.int64)
    last_row = np.full(n_sats, -1, dtype=np.int64)
    for k in range(sat.shape[0]):
        s = sat[k]
        if s < 0 or s >= n_sats:
            index[k] = -1
            status[k] = NO_EPHEMERIS
            continue
        t = time_ns[k]
        # Signals of one satellite come one after another with the same time.
        if last_row[s] >= 0 and last_time[s] == t:
            index[k] = index[last_row[s]]
            status[k] = status[last_row[s]]
            continue
        best_rank = np.int64(1_000_000)
        best_age = np.int64(0)
        for e in range(first[s], first[s + 1]):
            age = abs(t - toe_ns[e])
            if age <= window_ns[e] and (rank[e] < best_rank or (rank[e] == best_rank and age < best_age)):
                best_rank = rank[e]
                best_age = age
        best = np.int64(-1)
        for e in range(first[s], first[s + 1]):
            # An upload that cuts in moves toe by seconds only: the later message supersedes.
            is_near = rank[e] == best_rank and abs(t - toe_ns[e]) <= min(window_ns[e], best_age + _TIE_NS)
            if is_near and (best < 0 or sent_ns[e] >= sent_ns[best]):
                best = e
        index[k] = best
        if first[s] == first[s + 1]:
            status[k] = NO_EPHEMERIS
        elif best < 0:
            status[k] = TOO_OLD
        elif healthy[best] == 0 and any_health == 0:
            status[k] = UNHEALTHY
        else:
            status[k] = OK
        last_time[s] = t
        last_row[s] = k


@kernel
def _kepler_state(tk, el, toe_sow, gm, omega_e, is_geo, out):
    """Position and velocity into out[0:6], relativistic clock term and its rate into out[6:8].

    IS-GPS-200N tables 20-IV and 30-II; BDS-SIS-ICD-B1I 3.0 section 5.2.4.12 for the BeiDou GEO.
    """
    a0 = el[0] * el[0]
    a = a0 + el[15] * tk
    ecc = el[1]
    n0 = math.sqrt(gm / (a0 * a0 * a0)) + el[6]
    m = el[5] + (n0 + 0.5 * el[16] * tk) * tk
    m_dot = n0 + el[16] * tk
    ea = m
    for _ in range(12):
        step = (ea - ecc * math.sin(ea) - m) / (1.0 - ecc * math.cos(ea))
        ea -= step
        if abs(step) < 1e-14:
            break
    se, ce = math.sin(ea), math.cos(ea)
    q = 1.0 - ecc * ce
    root = math.sqrt(1.0 - ecc * ecc)
    ea_dot = m_dot / q
    phi = math.atan2(root * se, ce - ecc) + el[4]
    phi_dot = ea_dot * root / q
    s2, c2 = math.sin(2.0 * phi), math.cos(2.0 * phi)
    u = phi + el[10] * s2 + el[9] * c2
    r = a * q + el[12] * s2 + el[11] * c2
    inc = el[2] + el[8] * tk + el[14] * s2 + el[13] * c2
    u_dot = phi_dot * (1.0 + 2.0 * (el[10] * c2 - el[9] * s2))
    r_dot = a * ecc * se * ea_dot + el[15] * q + 2.0 * phi_dot * (el[12] * c2 - el[11] * s2)
    inc_dot = el[8] + 2.0 * phi_dot * (el[14] * c2 - el[13] * s2)
    su, cu = math.sin(u), math.cos(u)
    xp, yp = r * cu, r * su
    xp_dot = r_dot * cu - yp * u_dot
    yp_dot = r_dot * su + xp * u_dot
    si, ci = math.sin(inc), math.cos(inc)
    node_dot = el[7] - (0.0 if is_geo else omega_e)
    node = el[3] + node_dot * tk - omega_e * toe_sow
    so, co = math.sin(node), math.cos(node)
    x = xp * co - yp * ci * so
    y = xp * so + yp * ci * co
    z = yp * si
    w = yp_dot * ci - yp * si * inc_dot
    vx = xp_dot * co - w * so - y * node_dot
    vy = xp_dot * so + w * co + x * node_dot
    vz = yp_dot * si + yp * ci * inc_dot
    if is_geo:
        # The elements refer to a plane tilted by -5 degrees that does not turn with the Earth.
        y, z = y * _COS_5 - z * _SIN_5, y * _SIN_5 + z * _COS_5
        vy, vz = vy * _COS_5 - vz * _SIN_5, vy * _SIN_5 + vz * _COS_5
        sr, cr = math.sin(omega_e * tk), math.cos(omega_e * tk)
        x, y = x * cr + y * sr, -x * sr + y * cr
        vx, vy = vx * cr + vy * sr + omega_e * y, -vx * sr + vy * cr - omega_e * x
    out[0], out[1], out[2] = x, y, z
    out[3], out[4], out[5] = vx, vy, vz
    out[6] = -2.0 * math.sqrt(gm * a0) * ecc * se / (_C * _C)
    out[7] = -2.0 * math.sqrt(gm * a0) * ecc * ce * ea_dot / (_C * _C)


@kernel
def _glonass_step(h, s, acc, rate, work):
    """One Runge-Kutta step of the GLONASS equations of motion (ICD 5.1, A.3.1.2), state s in place."""
    for j in range(6):
        work[j] = s[j]
        work[j + 6] = 0.0
    for stage in range(4):
        x, y, z = work[0], work[1], work[2]
        r2 = x * x + y * y + z * z
        g = _GLO_GM / (r2 * math.sqrt(r2))
        oblate = 1.5 * _GLO_J2 * g * _GLO_RE * _GLO_RE / r2
        tilt = 5.0 * z * z / r2
        w2 = _GLO_OMEGA * _GLO_OMEGA
        rate[0], rate[1], rate[2] = work[3], work[4], work[5]
        rate[3] = (w2 - g - oblate * (1.0 - tilt)) * x + 2.0 * _GLO_OMEGA * work[4] + acc[0]
        rate[4] = (w2 - g - oblate * (1.0 - tilt)) * y - 2.0 * _GLO_OMEGA * work[3] + acc[1]
        rate[5] = (-g - oblate * (3.0 - tilt)) * z + acc[2]
        weight = 1.0 if stage == 0 or stage == 3 else 2.0
        ahead = h if stage == 2 else 0.5 * h
        for j in range(6):
            work[j + 6] += weight * rate[j]
            work[j] = s[j] + ahead * rate[j]
    for j in range(6):
        s[j] += h / 6.0 * work[j + 6]


@kernel
def propagate_orbits(
    index, time_ns, delay_s, is_reception, kind, toe_ns, toc_ns, toe_sow, gm, omega_e, table,
    position, velocity, clock, drift, status,
):  # fmt: skip
    """Orbits and clocks of the ephemerides ``index`` at ``time_ns - delay_s``.

    With ``is_reception`` the delay is code / c, and the satellite clock offset is taken off as well:
    the code measures from the satellite's own clock to the receiver's tag.
    """
    # GLONASS is integrated outwards from its reference time in whole steps; the last node stays for
    # the next row. The nodes do not depend on the order of the rows.
    node = np.zeros((_N_NODES, 6))
    node_step = np.zeros(_N_NODES, dtype=np.int64)
    node_owner = np.full(_N_NODES, -1, dtype=np.int64)
    out = np.zeros(8)
    rate = np.zeros(6)
    work = np.zeros(12)
    for k in range(index.shape[0]):
        e = index[k]
        if e < 0 or status[k] != OK:
            continue
        el = table[e]
        is_kepler = kind[e] == KEPLER or kind[e] == KEPLER_GEO
        if is_kepler:
            af0, af1, af2 = el[17], el[18], el[19]
        else:
            af0, af1, af2 = el[9], el[10], 0.0
        delay = delay_s[k]
        dt = float(time_ns[k] - toc_ns[e]) * 1e-9 - delay
        bias = af0 + (af1 + af2 * dt) * dt
        if is_reception:
            dt0 = dt
            for _ in range(2):
                dt = dt0 - bias
                bias = af0 + (af1 + af2 * dt) * dt
            delay += bias
        tk = float(time_ns[k] - toe_ns[e]) * 1e-9 - delay
        total = tk
        for j in range(20 if is_kepler else 12):
            total += el[j]
        is_ellipse = not is_kepler or (el[0] > 0.0 and 0.0 <= el[1] < 1.0)
        if not (math.isfinite(total) and abs(tk) < _LONGEST_S and is_ellipse):
            status[k] = NOT_COMPUTABLE
            continue
        relativity = 0.0
        relativity_rate = 0.0
        if is_kepler:
            _kepler_state(tk, el, toe_sow[e], gm[e], omega_e[e], kind[e] == KEPLER_GEO, out)
            relativity, relativity_rate = out[6], out[7]
        elif kind[e] == GLONASS:
            wanted = np.int64(tk / _GLO_STEP_S)
            place = e % _N_NODES
            is_behind = wanted * node_step[place] < 0 or abs(wanted) < abs(node_step[place])
            if node_owner[place] != e or is_behind:
                node_owner[place] = e
                node_step[place] = 0
                for j in range(6):
                    node[place, j] = el[j]
            n_whole = abs(wanted - node_step[place])
            for j in range(6):
                out[j] = node[place, j]
            for n in range(n_whole + 1):
                h = math.copysign(_GLO_STEP_S, tk)
                if n == n_whole:
                    h = tk - wanted * _GLO_STEP_S
                    node_step[place] = wanted
                    for j in range(6):
                        node[place, j] = out[j]
                _glonass_step(h, out, el[6:9], rate, work)
        else:
            for j in range(3):
                out[j] = el[j] + (el[j + 3] + 0.5 * el[j + 6] * tk) * tk
                out[j + 3] = el[j + 3] + el[j + 6] * tk
        # The relativistic part of the clock is known only now; it moves the instant by 50 ns at most.
        late = relativity if is_reception else 0.0
        total = 0.0
        for j in range(3):
            position[k, j] = out[j] - late * out[j + 3]
            velocity[k, j] = out[j + 3]
            total += position[k, j] + velocity[k, j]
        clock[k] = bias + relativity
        drift[k] = af1 + 2.0 * af2 * dt + relativity_rate
        if not math.isfinite(total + clock[k]):
            status[k] = NOT_COMPUTABLE
            clock[k] = np.nan
            drift[k] = np.nan
            for j in range(3):
                position[k, j] = np.nan
                velocity[k, j] = np.nan


@kernel
def interpolate_orbits(
    column, time_ns, delay_s, is_reception, epoch_ns, longest_gap_ns, n_nodes, nodes, node_clock,
    position, velocity, clock, drift, status,
):  # fmt: skip
    """Positions between the epochs of a table by Neville's polynomial through ``n_nodes``; linear clocks.

    The nodes are first turned with the Earth to the instant asked for, where the curve is smooth.
    """
    n_epochs = epoch_ns.shape[0]
    p = np.zeros((n_nodes, 3))
    v = np.zeros((n_nodes, 3))
    for k in range(column.shape[0]):
        c = column[k]
        if c < 0:
            status[k] = NO_EPHEMERIS
            continue
        status[k] = TOO_OLD
        delay = delay_s[k]
        after = np.int64(0)
        bias = 0.0
        rate = 0.0
        # The clock decides when the signal left; it changes by less than 1e-15 s over its own size.
        for _ in range(2 if is_reception else 1):
            t_ns = time_ns[k] - np.int64(round((delay + bias) * 1e9))
            low, high = np.int64(0), np.int64(n_epochs)
            while low < high:
                middle = (low + high) // 2
                if epoch_ns[middle] <= t_ns:
                    low = middle + 1
                else:
                    high = middle
            after = low
            if t_ns == epoch_ns[n_epochs - 1]:
                after = n_epochs - 1
            if after < 1 or after >= n_epochs:
                break
            rest = (float(time_ns[k] - epoch_ns[after - 1]) * 1e-9 - delay) - bias
            step = float(epoch_ns[after] - epoch_ns[after - 1]) * 1e-9
            rate = (node_clock[after, c] - node_clock[after - 1, c]) / step
            bias = node_clock[after - 1, c] + rate * rest
        if after < 1 or after >= n_epochs or n_epochs < n_nodes:
            continue
        if not math.isfinite(bias):
            status[k] = NOT_COMPUTABLE
            continue
        if is_reception:
            delay += bias
        start = min(max(after - (n_nodes + 1) // 2, 0), n_epochs - n_nodes)
        usable = True
        for j in range(n_nodes):
            e = start + j
            usable = usable and math.isfinite(nodes[e, c, 0])
            usable = usable and (j == 0 or epoch_ns[e] - epoch_ns[e - 1] <= longest_gap_ns)
        if not usable:
            continue
        for j in range(n_nodes):
            e = start + j
            angle = -_GLO_OMEGA * (float(epoch_ns[e] - time_ns[k]) * 1e-9 + delay)
            sa, ca = math.sin(angle), math.cos(angle)
            p[j, 0] = nodes[e, c, 0] * ca + nodes[e, c, 1] * sa
            p[j, 1] = nodes[e, c, 1] * ca - nodes[e, c, 0] * sa
            p[j, 2] = nodes[e, c, 2]
            for i in range(3):
                v[j, i] = 0.0
        for width in range(1, n_nodes):
            for j in range(n_nodes - width):
                first = float(epoch_ns[start + j] - time_ns[k]) * 1e-9 + delay
                last = float(epoch_ns[start + j + width] - time_ns[k]) * 1e-9 + delay
                inverse = 1.0 / (last - first)
                for i in range(3):
                    v[j, i] = (last * v[j, i] - first * v[j + 1, i] + p[j + 1, i] - p[j, i]) * inverse
                    p[j, i] = (last * p[j, i] - first * p[j + 1, i]) * inverse
        for i in range(3):
            position[k, i] = p[0, i]
        velocity[k, 0] = v[0, 0] + _GLO_OMEGA * p[0, 1]
        velocity[k, 1] = v[0, 1] - _GLO_OMEGA * p[0, 0]
        velocity[k, 2] = v[0, 2]
        # Tables leave the periodic relativistic term out: -2 r.v / c^2.
        radial = p[0, 0] * v[0, 0] + p[0, 1] * v[0, 1] + p[0, 2] * v[0, 2]
        relativity = -2.0 * radial / (_C * _C)
        if is_reception:
            for i in range(3):
                position[k, i] -= relativity * velocity[k, i]
        # Its rate, with the attraction of the Earth alone: r.a = -GM / r.
        radius = math.sqrt(p[0, 0] * p[0, 0] + p[0, 1] * p[0, 1] + p[0, 2] * p[0, 2])
        speed2 = v[0, 0] * v[0, 0] + v[0, 1] * v[0, 1] + v[0, 2] * v[0, 2]
        clock[k] = bias + relativity
        drift[k] = rate - 2.0 * (speed2 - _GLO_GM / radius) / (_C * _C)
        status[k] = OK
