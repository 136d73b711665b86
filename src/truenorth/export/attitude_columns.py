"""The columns of an attitude table.

The first twelve names and their order are a contract with scripts; later columns may be appended.
"""

import numpy as np

from ..timescales import gpst_to_datetime64
from .columns import Column, geodetic_degrees, reason_labels, status_labels

__all__ = ["ATTITUDE_COLUMNS", "ATTITUDE_CONTRACT"]

ATTITUDE_CONTRACT = (
    "time_gpst,heading_deg,pitch_deg,roll_deg,heading_sd_deg,pitch_sd_deg,roll_sd_deg,status,reason,"
    "n_antennas,n_sats,excluded"
)
"""How every CSV file of an attitude begins; scripts rely on it."""

ATTITUDE_COLUMNS = (
    Column("time_gpst", "", "GPS time of the reference receiver's time tag", "%s"),
    Column("heading_deg", "degree", "heading of the body, clockwise from true north", "%.6f"),
    Column("pitch_deg", "degree", "pitch, nose up", "%.6f"),
    Column("roll_deg", "degree", "roll, right side down", "%.6f"),
    Column("heading_sd_deg", "degree", "standard deviation of the heading", "%.6f"),
    Column("pitch_sd_deg", "degree", "standard deviation of the pitch", "%.6f"),
    Column("roll_sd_deg", "degree", "standard deviation of the roll", "%.6f"),
    Column("status", "", "fixed, held, float (predicted by a filter) or none", "%s"),
    Column("reason", "", "why the epoch has its status", "%s"),
    Column("n_antennas", "1", "antennas used", "%d"),
    Column("n_sats", "1", "satellites that took part", "%d"),
    Column("excluded", "", "antennas left out because they contradict the others", "%s"),
    Column("chi2", "1", "test of the adjustment against the body coordinates", "%.3f"),
    Column("chi2_limit", "1", "its limit", "%.3f"),
    Column("cov_hp_deg2", "degree2", "covariance of heading and pitch", "%.6e"),
    Column("cov_hr_deg2", "degree2", "covariance of heading and roll", "%.6e"),
    Column("cov_pr_deg2", "degree2", "covariance of pitch and roll", "%.6e"),
    Column("latitude_deg", "degree", "latitude of the reference antenna, WGS 84, single point", "%.8f"),
    Column("longitude_deg", "degree", "longitude of the reference antenna", "%.8f"),
    Column("height_m", "m", "ellipsoidal height of the reference antenna", "%.3f"),
    Column("success_probability", "1", "of the integers, when they were accepted", "%.9f"),
    Column("heading_pl_deg", "degree", "protection level of the heading, infinite where it has none", "%.6f"),
    Column("pitch_pl_deg", "degree", "protection level of the pitch", "%.6f"),
    Column("roll_pl_deg", "degree", "protection level of the roll", "%.6f"),
)


def attitude_arrays(solution):
    """Yield the arrays of `ATTITUDE_COLUMNS` in order; times stay ``datetime64[ns]`` of GPS time."""
    yield gpst_to_datetime64(solution.time_ns)
    yield np.degrees(solution.heading_rad)
    yield np.degrees(solution.pitch_rad)
    yield np.degrees(solution.roll_rad)
    for k in range(3):
        yield np.degrees(solution.angle_sd_rad(k))
    yield status_labels(solution)
    yield reason_labels(solution)
    yield solution.n_antennas_used
    yield solution.n_sats
    yield solution.excluded
    yield solution.chi2
    yield solution.chi2_limit
    for row, column in ((0, 1), (0, 2), (1, 2)):
        yield np.degrees(np.degrees(solution.cov_rad2[:, row, column]))
    yield from geodetic_degrees(solution.position_ecef_m)
    yield solution.success_probability
    yield from np.degrees(solution.protection_rad).T
