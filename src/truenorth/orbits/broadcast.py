"""Positions, velocities and clocks of satellites from broadcast ephemerides.

Kepler elements with harmonic corrections (IS-GPS-200N tables 20-IV and 30-II, Galileo OS-SIS-ICD 2.1
section 5.1.1, BDS-SIS-ICD-B1I 3.0 section 5.2.4.12, IS-QZSS-PNT-005 section 5.6, IRNSS-SIS-ICD 1.1
appendix A), numerical integration for GLONASS (ICD 5.1, section A.3.1.2), a parabola for SBAS (DO-229).
The satellite clock is

    dt_sat = af0 + af1 (t - toc) + af2 (t - toc)^2 - 2 sqrt(mu a) e sin E / c^2

without the group delay of any one signal, which `group_delay_s` gives; for GLONASS and SBAS the last
term is part of the broadcast clock. Positions are in the Earth-fixed frame of the instant asked for.
"""

from dataclasses import dataclass, replace

import numpy as np

from .precise import interpolate_precise
from .selection import OrbitStatus, ephemeris_table, select_ephemerides

__all__ = ["SatelliteStates", "compute_satellite_states"]


@dataclass(frozen=True, slots=True, eq=False)
class SatelliteStates:
    """States of satellites, one row per asked pair of satellite and time; NaN where ``status`` is not 0.

    Parameters
    ----------
    position_ecef_m, velocity_ecef_mps : ndarray, shape (n, 3)
        Antenna phase centre (broadcast) or centre of mass (precise), Earth-fixed.
    clock_s, clock_drift_sps : ndarray, shape (n,)
        Satellite clock minus system time, relativity included, group delay not.
    ephemeris_index : ndarray of int64, shape (n,)
        Row in ``navigation.kepler`` or, beyond its length, in ``navigation.states``; -1 for none.
    healthy : ndarray of bool, shape (n,)
        What the chosen ephemeris says.
    status : ndarray of uint8, shape (n,)
        `truenorth.orbits.OrbitStatus`.
    ura_m : ndarray, shape (n,)
        Broadcast accuracy, NaN where there is no statement.
    """

    position_ecef_m: np.ndarray
    velocity_ecef_mps: np.ndarray
    clock_s: np.ndarray
    clock_drift_sps: np.ndarray
    ephemeris_index: np.ndarray
    healthy: np.ndarray
    status: np.ndarray
    ura_m: np.ndarray

    def __len__(self):
        """Number of rows."""
        return len(self.clock_s)


def compute_satellite_states(
    navigation, sat, time_ns, *, delay_s=0.0, ephemeris=None, precise=None, include_unhealthy=False
):
    """Compute where satellites are at given instants of GPS time.

    Parameters
    ----------
    navigation : Navigation
        Broadcast ephemerides.
    sat : ndarray of int, shape (n,)
        Satellites, see `truenorth.observations.sat_id`.
    time_ns : int or ndarray of int64, shape (n,)
        GPS time, nanoseconds.
    delay_s : float or ndarray, shape (n,)
        Taken off the time, seconds; for instants finer than a nanosecond.
    ephemeris : ndarray of int, shape (n,), optional
        Rows to use, as `select_ephemerides` returns them; -1 for none. Chosen by time if not given.
    precise : PreciseOrbits, optional
        Used instead of the broadcast orbits and clocks; health still comes from the broadcast where
        there is one.
    include_unhealthy : bool
        Compute also satellites that say they are unhealthy.

    Returns
    -------
    SatelliteStates

    Examples
    --------
    >>> import numpy as np
    >>> from truenorth.navigation import build_navigation
    >>> from truenorth.orbits import compute_satellite_states
    >>> states = compute_satellite_states(build_navigation(), np.array([5]), 0)
    >>> int(states.status[0])
    1
    """
    sat = np.array(sat, dtype=np.int64, order="C", ndmin=1)
    delay_s = np.array(np.broadcast_to(np.asarray(delay_s, dtype=np.float64), sat.shape))
    return _states(navigation, sat, time_ns, delay_s, False, ephemeris, precise, include_unhealthy)


def _states(navigation, sat, time_ns, delay_s, is_reception, ephemeris, precise, include_unhealthy):
    precise = navigation.precise if precise is None else precise
    from .._kernels.orbits import propagate_orbits

    table = ephemeris_table(navigation)
    n = len(sat)
    time_ns = np.array(np.broadcast_to(np.asarray(time_ns, dtype=np.int64), sat.shape))
    if ephemeris is None:
        # With precise orbits the broadcast still tells the health, and nothing else.
        index, status = select_ephemerides(navigation, sat, time_ns, include_unhealthy=include_unhealthy)
    else:
        index = np.array(ephemeris, dtype=np.int64, order="C", ndmin=1)
        if index.shape != sat.shape or np.any(index >= len(table.kind)):
            raise ValueError(
                "`ephemeris` does not fit `sat` and the navigation data; use `select_ephemerides`"
            )
        status = np.where(index < 0, OrbitStatus.NO_EPHEMERIS, OrbitStatus.OK).astype(np.uint8)
        if not include_unhealthy and len(table.kind):
            status[(index >= 0) & (table.healthy[index] == 0)] = OrbitStatus.UNHEALTHY
    states = SatelliteStates(
        position_ecef_m=np.full((n, 3), np.nan),
        velocity_ecef_mps=np.full((n, 3), np.nan),
        clock_s=np.full(n, np.nan),
        clock_drift_sps=np.full(n, np.nan),
        ephemeris_index=index,
        healthy=table.healthy[index].astype(bool) & (index >= 0)
        if len(table.kind)
        else np.zeros(n, dtype=bool),
        status=status,
        ura_m=np.where(index >= 0, table.ura_m[index], np.nan) if len(table.kind) else np.full(n, np.nan),
    )
    if precise is not None:
        computed = interpolate_precise(precise, sat, time_ns, delay_s=delay_s, is_reception=is_reception)
        refused = status == OrbitStatus.UNHEALTHY
        columns = [np.where(_like(refused, column), np.nan, column) for column in computed[:4]]
        return replace(
            states,
            position_ecef_m=columns[0],
            velocity_ecef_mps=columns[1],
            clock_s=columns[2],
            clock_drift_sps=columns[3],
            status=np.where(refused, status, computed[4]),
            ura_m=_table_accuracy(precise, sat),
        )
    propagate_orbits(
        index,
        time_ns,
        delay_s,
        is_reception,
        table.kind,
        table.toe_ns,
        table.toc_ns,
        table.toe_sow,
        table.gm,
        table.omega_e,
        table.elements,
        states.position_ecef_m,
        states.velocity_ecef_mps,
        states.clock_s,
        states.clock_drift_sps,
        states.status,
    )
    return states


def _like(mask, column):
    return mask[:, None] if column.ndim == 2 else mask


def _table_accuracy(precise, sat):
    if precise.n_sats == 0:
        return np.full(len(sat), np.nan)
    place = np.minimum(np.searchsorted(precise.sat, sat), precise.n_sats - 1)
    return np.where(precise.sat[place] == sat, precise.sd_m[place], np.nan)
