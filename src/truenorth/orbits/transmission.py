"""States of satellites at the instant at which the received signal left them.

A pseudorange P with time tag T satisfies ``P / c = T - (t_tx + dt_sat)`` whatever the receiver clock,
which stands in both the tag and the pseudorange. So ``t_tx = T - P / c - dt_sat``.
"""

import numpy as np

from ..constants import SPEED_OF_LIGHT_MPS
from .broadcast import _states
from .selection import OrbitStatus

__all__ = ["compute_transmission_states"]


def compute_transmission_states(
    navigation, sat, receive_time_ns, code_m, *, ephemeris=None, precise=None, include_unhealthy=False
):
    """Compute where satellites were when they sent the signals that a receiver tagged.

    Parameters
    ----------
    navigation : Navigation
        Broadcast ephemerides.
    sat : ndarray of int, shape (n,)
        Satellites.
    receive_time_ns : int or ndarray of int64, shape (n,)
        Receiver time tags as in the file, GPS time, nanoseconds.
    code_m : ndarray, shape (n,)
        Pseudoranges as in the file (tag and pseudorange share the receiver clock).
    ephemeris, precise, include_unhealthy
        As `truenorth.orbits.compute_satellite_states`.

    Returns
    -------
    SatelliteStates
        Positions are in the Earth-fixed frame of the time of transmission: a range to the receiver
        still needs the rotation of the Earth during the flight. Rows without pseudorange have the
        status ``NO_CODE``.
    """
    sat = np.array(sat, dtype=np.int64, order="C", ndmin=1)
    delay_s = np.array(code_m, dtype=np.float64, order="C", ndmin=1) / SPEED_OF_LIGHT_MPS
    missing = ~np.isfinite(delay_s)
    states = _states(
        navigation,
        sat,
        receive_time_ns,
        np.where(missing, 0.0, delay_s),
        True,
        ephemeris,
        precise,
        include_unhealthy,
    )
    if np.any(missing):
        for name in ("position_ecef_m", "velocity_ecef_mps", "clock_s", "clock_drift_sps"):
            getattr(states, name)[missing] = np.nan
        states.status[missing & (states.status == OrbitStatus.OK)] = OrbitStatus.NO_CODE
    return states
