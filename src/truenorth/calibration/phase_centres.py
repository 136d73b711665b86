r"""Phase centres of antennas that turn with the platform.

The ANTEX correction depends on where the satellite stands in the antenna's own axes: north mark, east of it,
up. With the antenna's zenith along the up axis of the body and its north mark turned by the angle q from
forward to the right,

    e_antenna = R_3(q) diag(1, 1, -1) R_body_from_ned e_ned.

Corrections of alike antennas that are mounted alike cancel between them; of unlike ones, or with marks that
look elsewhere, they turn with the platform by as much as the offsets are apart.

Reference: M. Rothacher and R. Schmid, ANTEX: the antenna exchange format, version 1.4, 2010.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..constants import SPEED_OF_LIGHT_MPS, SYSTEMS
from ..errors import ConfigError
from ..formats.antex import Antex
from ..observations import Observations, frequency_hz
from ..rotations import exp_so3, log_so3

__all__ = [
    "attitude_of_rows",
    "correct_phases",
    "direction_in_antenna",
    "directions_of_rows",
    "phase_centre_correction_m",
]


def direction_in_antenna(rot_ned_from_body, direction_ned, yaw_of_antenna_rad=0.0):
    """Where satellites stand in the axes of an antenna.

    Parameters
    ----------
    rot_ned_from_body : ndarray, shape (..., 3, 3)
        Attitude.
    direction_ned : ndarray, shape (..., 3)
        Unit vectors to the satellites.
    yaw_of_antenna_rad : float
        From forward to the right, to the antenna's north mark.

    Returns
    -------
    azimuth_rad, elevation_rad : ndarray, shape (...)
        From the north mark to the east of it, in [0, 2 pi); above the antenna's horizon.
    """
    forward, right, down = np.moveaxis(np.einsum("...ji,...j->...i", rot_ned_from_body, direction_ned), -1, 0)
    azimuth = np.mod(np.arctan2(right, forward) - yaw_of_antenna_rad, 2.0 * np.pi)
    return azimuth, np.arctan2(-down, np.hypot(forward, right))


def phase_centre_correction_m(
    antex: Antex,
    antenna_type: str,
    sat,
    signal,
    rot_ned_from_body,
    direction_ned,
    yaw_of_antenna_rad: float = 0.0,
    *,
    serial: str = "",
) -> np.ndarray:
    """What the phase centre of an antenna on a turning platform adds to its phases.

    Parameters
    ----------
    antex : Antex
        The calibrations.
    antenna_type : str
        IGS name as in the RINEX header.
    sat, signal : ndarray of int, shape (n,)
        Satellites and signals of the rows, see `truenorth.observations`.
    rot_ned_from_body : ndarray, shape (3, 3) or (n, 3, 3)
        Attitude.
    direction_ned : ndarray, shape (n, 3)
        Unit vectors to the satellites.
    yaw_of_antenna_rad : float
        From forward to the right, to the antenna's north mark.
    serial : str
        Serial number of the antenna.

    Returns
    -------
    ndarray, shape (n,)
        Metres, to be taken off the phases (as ranges); NaN where the direction is.

    Raises
    ------
    FormatError
        If the file does not have the antenna.
    """
    sat, signal = np.broadcast_arrays(np.asarray(sat, dtype=np.int64), np.asarray(signal, dtype=np.int64))
    rot_ned_from_body = np.broadcast_to(rot_ned_from_body, (len(sat), 3, 3))
    azimuth, elevation = direction_in_antenna(rot_ned_from_body, direction_ned, yaw_of_antenna_rad)
    correction = np.full(len(sat), np.nan)
    code = sat // 100 * 100 + signal // 100
    for value in np.unique(code):
        rows = np.flatnonzero((code == value) & np.isfinite(azimuth))
        band = f"{SYSTEMS[value // 100]}{value % 100:02d}"
        correction[rows] = antex.range_correction_m(
            antenna_type, band, azimuth[rows], elevation[rows], serial=serial
        )
    return correction


def directions_of_rows(observations: Observations, navigation):
    """Unit vectors from the antenna to the satellite of every row.

    Parameters
    ----------
    observations : Observations
        Of one receiver.
    navigation : Navigation
        Ephemerides.

    Returns
    -------
    ndarray, shape (n_rows, 3)
        North, east, down; NaN where satellite or position are not known.
    """
    from ..positioning import solve_single_point

    view = solve_single_point(observations, navigation).satellites
    epoch = np.repeat(np.arange(observations.n_epochs), np.diff(view.epoch_start))
    key = epoch * 1000 + view.sat
    wanted = observations.epoch_of_row * 1000 + observations.sat
    at = np.minimum(np.searchsorted(key, wanted), max(len(key) - 1, 0))
    direction = np.full((observations.n_rows, 3), np.nan)
    if len(key) == 0:
        return direction
    level = np.cos(view.elevation_rad)
    ned = np.stack(
        [level * np.cos(view.azimuth_rad), level * np.sin(view.azimuth_rad), -np.sin(view.elevation_rad)],
        axis=1,
    )
    known = key[at] == wanted
    direction[known] = ned[at[known]]
    return direction


def attitude_of_rows(observations: Observations, time_ns, rot_ned_from_body):
    """Attitude of the platform for every row.

    Parameters
    ----------
    observations : Observations
        Of one receiver.
    time_ns : ndarray of int64, shape (n,)
        When the attitude is known, increasing.
    rot_ned_from_body : ndarray, shape (n, 3, 3)
        Attitude; NaN where there is none.

    Returns
    -------
    ndarray, shape (n_rows, 3, 3)
        Turned evenly from one known attitude to the next; before the first and after the last as there.

    Raises
    ------
    ConfigError
        If no attitude is known.
    """
    known = np.isfinite(rot_ned_from_body[:, 0, 0])
    time_ns, rot = np.asarray(time_ns)[known], rot_ned_from_body[known]
    if len(time_ns) == 0:
        raise ConfigError("could not turn directions into the body frame: no epoch has an attitude")
    if len(time_ns) == 1:
        return np.broadcast_to(rot[0], (observations.n_rows, 3, 3))
    after = np.clip(np.searchsorted(time_ns, observations.time_ns), 1, len(time_ns) - 1)
    before = after - 1
    share = (observations.time_ns - time_ns[before]) / (time_ns[after] - time_ns[before])
    turn = log_so3(np.swapaxes(rot[before], 1, 2) @ rot[after])
    found = rot[before] @ exp_so3(np.clip(share, 0.0, 1.0)[:, None] * turn)
    return found[observations.epoch_of_row]


def correct_phases(observations: Observations, correction_m) -> Observations:
    """Observations without what an antenna adds to their phases.

    Parameters
    ----------
    observations : Observations
        Of one receiver.
    correction_m : ndarray, shape (n_rows,)
        Metres; NaN leaves the phase as it is.

    Returns
    -------
    Observations
    """
    frequency = frequency_hz(observations.sat, observations.signal, observations.glonass_channel)
    cycles = np.nan_to_num(np.asarray(correction_m) * frequency / SPEED_OF_LIGHT_MPS)
    return replace(observations, phase_cyc=observations.phase_cyc - cycles)
