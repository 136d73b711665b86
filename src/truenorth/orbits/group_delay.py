"""Broadcast group delays: what a single-frequency user adds to the satellite clock.

Broadcast clocks refer to a reference signal or combination of the system's choice. The code of another
signal left the satellite as if its clock were

    dt_sat(signal) = dt_sat - group_delay(signal)

With ``gamma = (f1 / f)^2``:

- GPS, QZSS: clock of the L1/L2 P(Y) combination; TGD at L1, gamma TGD elsewhere (IS-GPS-200N
  20.3.3.3.3.2; the inter-signal corrections of CNAV, below 1 m, are not applied).
- Galileo: I/NAV clock of E1/E5b, F/NAV clock of E1/E5a; BGD at E1 and gamma BGD at the partner;
  the third frequency by the other BGD (OS-SIS-ICD 2.1, 5.1.5).
- BeiDou: clock of B3I, no delay there; TGD1 at B1I, TGD2 at B2I; CNV1 and CNV2 give B1C and B2a, CNV3
  B2b (ICD B1I 3.0 5.2.4.10, B1C 1.0 7.6.2, B2b 1.0 7.6).
- NavIC: clock of L5/S; TGD at S, gamma TGD at L5 (ICD 1.1, 6.2.1.5).
- GLONASS: clock of L1; delta tau is L2 minus L1 (ICD 5.1, table 4.5).
"""

import numpy as np

from ..constants import BEIDOU, FREQUENCY_HZ, GALILEO, GLONASS, GPS, NAVIC, QZSS
from ..navigation import MessageType
from .selection import ephemeris_table

__all__ = ["group_delay_s"]


def group_delay_s(navigation, ephemeris_index, sat, signal):
    """Group delay of single signals relative to the broadcast clock.

    Parameters
    ----------
    navigation : Navigation
        Broadcast ephemerides.
    ephemeris_index : ndarray of int, shape (n,)
        Rows as in `SatelliteStates.ephemeris_index`.
    sat : ndarray of int, shape (n,)
        Satellites.
    signal : ndarray of int, shape (n,)
        Signals, see `truenorth.observations.signal_id`.

    Returns
    -------
    ndarray, shape (n,)
        Seconds, to be subtracted from the satellite clock. Zero where the message says nothing about
        the signal and no other message of the satellite does; NaN where there is no ephemeris.
    """
    index = np.atleast_1d(np.asarray(ephemeris_index, dtype=np.int64))
    sat = np.atleast_1d(np.asarray(sat, dtype=np.int64))
    band = np.atleast_1d(np.asarray(signal, dtype=np.int64)) // 100
    index, sat, band = np.broadcast_arrays(index, sat, band)
    delay = np.zeros(index.shape)
    delay[index < 0] = np.nan
    table = ephemeris_table(navigation)
    n_kepler, kepler = table.n_kepler, navigation.kepler
    system = sat // 100

    state = index >= n_kepler
    lower = state & (system == GLONASS) & ((band == 2) | (band == 6))
    delay[lower] = navigation.states.states[index[lower] - n_kepler, 11]

    rows = np.flatnonzero((index >= 0) & ~state)
    if len(rows) == 0:
        return delay
    index, system, band = index[rows], system[rows], band[rows]
    freq = FREQUENCY_HZ[system, band]
    tgd, tgd2 = kepler.column("tgd_s")[index], kepler.column("tgd2_s")[index]
    message = kepler.message[index]
    value = np.zeros(len(rows))

    def gamma(reference_hz):
        return np.where(np.isfinite(freq), (reference_hz / freq) ** 2, 0.0)

    value = np.where((system == GPS) | (system == QZSS), gamma(FREQUENCY_HZ[GPS, 1]) * tgd, value)
    value = np.where(system == NAVIC, gamma(FREQUENCY_HZ[NAVIC, 9]) * tgd, value)
    value = np.where(
        system == GALILEO, _galileo(message, band, gamma(FREQUENCY_HZ[GALILEO, 1]), tgd, tgd2), value
    )
    beidou = system == BEIDOU
    if np.any(beidou):
        # Rows are many, pairs of ephemeris and band few.
        pairs, place = np.unique(10 * index[beidou] + band[beidou], return_inverse=True)
        value[beidou] = np.array([_beidou(kepler, int(pair // 10), int(pair % 10)) for pair in pairs])[place]
    delay[rows] = value
    return delay


def _galileo(message, band, gamma, bgd_5a, bgd_5b):
    """The clock combination has no delay; E1 has its BGD, and the others follow from E1.

    With clock combination (E1, X): delay(E1) = BGD_X and delay(X) = gamma_X BGD_X. For a third
    frequency Y, the difference of BGD definitions gives delay(Y) = BGD_X - (1 - gamma_Y) BGD_Y.
    """
    is_fnav = message == MessageType.FNAV
    own = np.where(is_fnav, bgd_5a, bgd_5b)
    other = np.where(is_fnav, bgd_5b, bgd_5a)
    # F/NAV records of some writers leave the second BGD blank: then nothing is known of E5b.
    own_band = np.where(is_fnav, 5, 7)
    other_band = np.where(is_fnav, 7, 5)
    value = np.where(band == 1, own, 0.0)
    value = np.where(band == own_band, gamma * own, value)
    third = own - (1.0 - gamma) * other
    value = np.where(band == other_band, third, value)
    # The alt-BOC centre and E6 have no broadcast delay of their own; E5 lies between E5a and E5b.
    e5 = 0.5 * (gamma * own + third)
    return np.where(band == 8, e5, value)


# Which column of which message holds the delay of a band: (message types, column).
_BEIDOU_SOURCE = {
    2: ((MessageType.D1, MessageType.D2), "tgd_s"),
    7: ((MessageType.D1, MessageType.D2), "tgd2_s"),
    1: ((MessageType.CNV1, MessageType.CNV2), "tgd_s"),
    5: ((MessageType.CNV1, MessageType.CNV2), "tgd2_s"),
}


def _beidou(kepler, index, band):
    """Delay of a BeiDou band, from the chosen message or the satellite's nearest one that has it."""
    if band not in _BEIDOU_SOURCE:
        return 0.0
    messages, column = _BEIDOU_SOURCE[band]
    if band == 7 and kepler.message[index] == MessageType.CNV3:
        return float(kepler.column("tgd_s")[index])
    candidates = np.flatnonzero((kepler.sat == kepler.sat[index]) & np.isin(kepler.message, messages))
    if len(candidates) == 0:
        return 0.0
    nearest = candidates[np.argmin(np.abs(kepler.toe_ns[candidates] - kepler.toe_ns[index]))]
    return float(kepler.column(column)[nearest])
