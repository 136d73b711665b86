"""Positions and clocks of satellites from tables of precise orbits.

A polynomial of degree 10 through the eleven epochs around the time, fitted in the frame that is
aligned with the Earth at that time but does not turn (the orbit is smooth there); velocities are its
derivative; clocks are linear between epochs, plus the periodic relativistic term -2 r.v / c^2.

Reference: M. Schenewerk, "A brief review of basic GPS orbit interpolation strategies", GPS Solutions 6,
2003, 265-267 (Neville's form, degree 9 to 11 for epochs 15 min apart).
"""

import numpy as np

__all__ = ["DEGREE", "interpolate_precise"]

DEGREE = 10
"""Degree of the polynomial: one less than the epochs that it needs."""


def interpolate_precise(precise, sat, time_ns, *, delay_s=0.0, is_reception=False):
    """States from precise orbits.

    Parameters
    ----------
    precise : PreciseOrbits
        The table.
    sat : ndarray of int, shape (n,)
        Satellites.
    time_ns : int or ndarray of int64, shape (n,)
        GPS time, nanoseconds.
    delay_s : float or ndarray, shape (n,)
        Taken off the time, seconds.
    is_reception : bool
        ``time_ns`` are receiver tags and ``delay_s`` pseudoranges over c: take off the clock too.

    Returns
    -------
    position_ecef_m, velocity_ecef_mps : ndarray, shape (n, 3)
        Centre of mass, Earth-fixed frame of the instant.
    clock_s, clock_drift_sps : ndarray, shape (n,)
        Satellite clock with the periodic relativistic term.
    status : ndarray of uint8, shape (n,)
        `truenorth.orbits.OrbitStatus`; values are NaN where it is not 0. There is no extrapolation.
    """
    from .._kernels.orbits import interpolate_orbits

    sat = np.array(sat, dtype=np.int64, order="C", ndmin=1)
    n = len(sat)
    time_ns = np.array(np.broadcast_to(np.asarray(time_ns, dtype=np.int64), sat.shape))
    delay_s = np.array(np.broadcast_to(np.asarray(delay_s, dtype=np.float64), sat.shape))
    place = np.minimum(np.searchsorted(precise.sat, sat), max(precise.n_sats - 1, 0))
    known = precise.sat[place] == sat if precise.n_sats else np.zeros(n, dtype=bool)
    intervals = np.diff(precise.time_ns)
    longest_gap_ns = int(1.5 * np.median(intervals)) if len(intervals) else 0
    position, velocity = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    clock, drift = np.full(n, np.nan), np.full(n, np.nan)
    status = np.empty(n, dtype=np.uint8)
    interpolate_orbits(
        np.where(known, place, -1).astype(np.int64),
        time_ns,
        delay_s,
        is_reception,
        np.array(precise.time_ns, dtype=np.int64),
        longest_gap_ns,
        DEGREE + 1,
        np.array(precise.position_ecef_m, dtype=np.float64, order="C"),
        np.array(precise.clock_s, dtype=np.float64, order="C"),
        position,
        velocity,
        clock,
        drift,
        status,
    )
    return position, velocity, clock, drift, status
