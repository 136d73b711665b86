"""Broadcast ephemerides fitted to precise orbits, for files that hold no others.

Around each reference time the elements of the message are adjusted by least squares (Gauss-Newton with
difference quotients, a little damped for the elements that a circular or equatorial orbit leaves open) to the
precise positions over the message's span: fifteen Kepler elements over four hours; position, velocity and
acceleration over half an hour for GLONASS. The clock is a line through the same span. Group delays are
unknown and zero; GLONASS channels are the nominal ones.
"""

import numpy as np

from ...constants import BEIDOU, GLONASS, SBAS
from ...navigation import KEPLER_COLUMNS, STATE_COLUMNS, build_navigation
from ...timescales import BDT_OFFSET_NS, NS_PER_S, NS_PER_WEEK, leap_seconds
from .almanac import EARTH_RATE_RADPS, GLONASS_CHANNELS, GM_M3PS2
from .broadcast import FIT_S, URA_M, as_written, constants_of, is_beidou_fixed, messages_of, reference_times

__all__ = ["fit_broadcast"]

_FITTED = (
    "sqrt_a", "eccentricity", "i0_rad", "omega0_rad", "omega_rad", "m0_rad", "delta_n_radps",
    "omega_dot_radps", "idot_radps", "cuc_rad", "cus_rad", "crc_m", "crs_m", "cic_rad", "cis_rad",
)  # fmt: skip
# Steps of the difference quotients: each moves the satellite by some ten metres within the span.
_KEPLER_STEP = np.array([1e-3, *[1e-6] * 5, *[1e-10] * 3, 1e-6, 1e-6, 10.0, 10.0, 1e-6, 1e-6])
_STATE_STEP = np.array([10.0] * 3 + [0.01] * 3 + [1e-5] * 3)
_HALF_SPAN_S = {GLONASS: 900.0}
_USUAL_HALF_SPAN_S = 7200.0
_N_SAMPLES = 25
_N_ITERATIONS = 10
_DAMPING = 1e-12
_KEPLER, _KEPLER_GEO, _GLONASS = 0, 1, 2


def fit_broadcast(precise, *, start_ns, duration_s):
    """Fit ephemerides to precise orbits.

    Parameters
    ----------
    precise : PreciseOrbits
        Positions and clocks.
    start_ns : int
        GPS time of the scenario's start, nanoseconds.
    duration_s : float
        Its length, seconds.

    Returns
    -------
    Navigation
        Of all satellites (but SBAS) and reference times whose span the precise orbits cover.
    """
    kepler_rows, state_rows = [], []
    for system in sorted({int(sat) // 100 for sat in precise.sat} - {SBAS}):
        sats = precise.sat[precise.sat // 100 == system].astype(np.int64)
        groups = [sats]
        if system == BEIDOU:
            fixed = np.array([is_beidou_fixed(int(sat)) for sat in sats])
            groups = [sats[~fixed], sats[fixed]]
        for group in groups:
            for toe_ns in reference_times(system, start_ns, duration_s):
                if system == GLONASS:
                    state_rows += _fit_states(precise, group, toe_ns)
                else:
                    kepler_rows += _fit_kepler(precise, group, toe_ns, system)
    return as_written(build_navigation(kepler_rows, state_rows, leap_seconds=int(leap_seconds(start_ns))))


def _samples(precise, sats, toe_ns, system):
    """Satellites that are there over the whole span, with positions, velocities, clocks; and the times."""
    from ...orbits import interpolate_precise

    half_s = _HALF_SPAN_S.get(system, _USUAL_HALF_SPAN_S)
    offsets_s = np.linspace(-half_s, half_s, _N_SAMPLES)
    time_ns = toe_ns + np.rint(offsets_s * NS_PER_S).astype(np.int64)
    columns = interpolate_precise(precise, np.repeat(sats, _N_SAMPLES), np.tile(time_ns, len(sats)))
    position, velocity, clock, _, status = (
        column.reshape(len(sats), _N_SAMPLES, *column.shape[1:]) for column in columns
    )
    there = np.all(status == 0, axis=1)
    return sats[there], position[there], velocity[there], clock[there], time_ns, offsets_s


def _lines(offsets_s, clock):
    """Bias at the reference time and drift of each row."""
    mean = np.mean(clock, axis=1)
    drift = (clock - mean[:, None]) @ offsets_s / (offsets_s @ offsets_s)
    return mean, drift


def _fit_kepler(precise, sats, toe_ns, system):
    sats, position, velocity, clock, time_ns, offsets_s = _samples(precise, sats, toe_ns, system)
    if len(sats) == 0:
        return []
    kind = _KEPLER_GEO if is_beidou_fixed(int(sats[0])) else _KEPLER
    gm, omega_e = constants_of(system)
    own_ns = toe_ns - (BDT_OFFSET_NS if system == BEIDOU else 0)
    toe_s = (own_ns % NS_PER_WEEK) / NS_PER_S
    middle = _N_SAMPLES // 2
    first = _osculating(position[:, middle], velocity[:, middle], kind, gm, omega_e, toe_s)
    place = [KEPLER_COLUMNS.index(name) for name in _FITTED]

    def model(parameters):
        table = np.zeros((len(parameters), len(KEPLER_COLUMNS)))
        table[:, place] = parameters
        return _propagated(table, kind, toe_ns, toe_s, gm, omega_e, time_ns)

    fitted = _least_squares(model, first, _KEPLER_STEP, position)
    # The broadcast clock has no relativistic term, -2 r.v / c^2; the precise one as interpolated has.
    inertial = velocity.copy()
    inertial[..., 0] -= EARTH_RATE_RADPS * position[..., 1]
    inertial[..., 1] += EARTH_RATE_RADPS * position[..., 0]
    relativity = -2.0 * np.einsum("ijk,ijk->ij", position, inertial) / 299_792_458.0**2
    bias, drift = _lines(offsets_s, clock - relativity)
    rows = []
    for k, sat in enumerate(sats.tolist()):
        values = dict.fromkeys(KEPLER_COLUMNS, 0.0)
        values |= dict(zip(_FITTED, fitted[k].tolist(), strict=True))
        for angle in ("omega0_rad", "omega_rad", "m0_rad"):
            values[angle] = float((values[angle] + np.pi) % (2.0 * np.pi) - np.pi)
        values |= {"af0_s": float(bias[k]), "af1_sps": float(drift[k])}
        values |= {"ura_m": URA_M[system], "fit_interval_s": FIT_S[system]}
        issue = int(own_ns // (7200 * NS_PER_S)) % 128
        rows += [
            (sat, message, toe_ns, toe_ns, toe_ns, issue, issue, 0, list(values.values()))
            for message in messages_of(sat)
        ]
    return rows


def _fit_states(precise, sats, toe_ns):
    sats, position, velocity, clock, time_ns, offsets_s = _samples(precise, sats, toe_ns, GLONASS)
    if len(sats) == 0:
        return []
    middle = _N_SAMPLES // 2
    first = np.hstack([position[:, middle], velocity[:, middle], np.zeros((len(sats), 3))])

    def model(parameters):
        table = np.zeros((len(parameters), len(KEPLER_COLUMNS)))
        table[:, :9] = parameters
        return _propagated(table, _GLONASS, toe_ns, 0.0, 0.0, 0.0, time_ns)

    fitted = _least_squares(model, first, _STATE_STEP, position)
    bias, drift = _lines(offsets_s, clock)
    rows = []
    for k, sat in enumerate(sats.tolist()):
        values = dict.fromkeys(STATE_COLUMNS, 0.0)
        values |= dict(zip(STATE_COLUMNS[:9], fitted[k].tolist(), strict=True))
        values |= {"clock_s": float(bias[k]), "clock_drift_sps": float(drift[k])}
        number = sat % 100
        channel = GLONASS_CHANNELS[number - 1] if number <= len(GLONASS_CHANNELS) else 0
        rows.append((sat, toe_ns, toe_ns - 900 * NS_PER_S, channel, 0, list(values.values())))
    return rows


def _osculating(position, velocity, kind, gm, omega_e, toe_s):
    """Kepler elements of states, in the order of `_FITTED`, the corrections zero."""
    inertial = velocity.copy()
    inertial[:, 0] -= EARTH_RATE_RADPS * position[:, 1]
    inertial[:, 1] += EARTH_RATE_RADPS * position[:, 0]
    if kind == _KEPLER_GEO:
        c, s = np.cos(np.radians(5.0)), np.sin(np.radians(5.0))
        turn = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
        position, inertial = position @ turn.T, inertial @ turn.T
    momentum = np.cross(position, inertial)
    radius = np.linalg.norm(position, axis=1)
    a = 1.0 / (2.0 / radius - np.einsum("ij,ij->i", inertial, inertial) / GM_M3PS2)
    normal = momentum / np.linalg.norm(momentum, axis=1)[:, None]
    node = np.arctan2(normal[:, 0], -normal[:, 1])
    to_node = np.stack([np.cos(node), np.sin(node), np.zeros(len(node))], axis=1)
    ahead = np.cross(normal, to_node)
    argument = np.arctan2(np.einsum("ij,ij->i", position, ahead), np.einsum("ij,ij->i", position, to_node))
    vector = np.cross(inertial, momentum) / GM_M3PS2 - position / radius[:, None]
    e = np.linalg.norm(vector, axis=1)
    perigee = np.arctan2(np.einsum("ij,ij->i", vector, ahead), np.einsum("ij,ij->i", vector, to_node))
    true = argument - perigee
    eccentric = np.arctan2(np.sqrt(1.0 - e * e) * np.sin(true), e + np.cos(true))
    out = np.zeros((len(a), len(_FITTED)))
    inclination = np.arccos(np.clip(normal[:, 2], -1.0, 1.0))
    out[:, 0], out[:, 1], out[:, 2] = np.sqrt(a), e, inclination
    out[:, 3], out[:, 4] = node + omega_e * toe_s, perigee
    out[:, 5] = eccentric - e * np.sin(eccentric)
    return out


def _propagated(table, kind, toe_ns, toe_s, gm, omega_e, time_ns):
    """Positions of all rows at all times, shape (n_rows, n_times, 3)."""
    from ..._kernels.orbits import propagate_orbits

    n_rows, n_times = len(table), len(time_ns)
    n = n_rows * n_times
    position, velocity, clock, drift = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n), np.zeros(n)
    times = np.full(n_rows, toe_ns, dtype=np.int64)
    propagate_orbits(
        np.repeat(np.arange(n_rows, dtype=np.int64), n_times),
        np.tile(time_ns, n_rows),
        np.zeros(n),
        False,
        np.full(n_rows, kind, dtype=np.int64),
        times,
        times,
        np.full(n_rows, float(toe_s)),
        np.full(n_rows, float(gm)),
        np.full(n_rows, float(omega_e)),
        np.ascontiguousarray(table),
        position,
        velocity,
        clock,
        drift,
        np.zeros(n, dtype=np.uint8),
    )
    return position.reshape(n_rows, n_times, 3)


def _least_squares(model, first, step, wanted):
    """Gauss-Newton of many problems at once; parameters counted in steps."""
    n, n_par = first.shape
    wanted = wanted.reshape(n, -1)
    parameters = first.copy()
    for _ in range(_N_ITERATIONS):
        moved = np.repeat(parameters[:, None, :], n_par + 1, axis=1)
        moved[:, 1:, :] += np.diag(step)
        values = model(moved.reshape(-1, n_par)).reshape(n, n_par + 1, -1)
        columns = values[:, 1:] - values[:, :1]
        normal = columns @ columns.transpose(0, 2, 1)
        scale = np.trace(normal, axis1=1, axis2=2)[:, None, None] / n_par
        normal += _DAMPING * scale * np.eye(n_par)
        rest = wanted - values[:, 0]
        change = np.linalg.solve(normal, columns @ rest[:, :, None])[:, :, 0]
        parameters = parameters + change * step
        # An eccentricity cannot be negative: the perigee is then on the other side.
        if n_par == len(_FITTED):
            parameters[:, 1] = np.clip(parameters[:, 1], 0.0, 0.5)
    return parameters
