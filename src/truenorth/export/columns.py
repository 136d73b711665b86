"""The columns of a result table: name, unit, meaning, digits and where the numbers come from.

The first sixteen names and their order are a contract with scripts; later columns may be appended.
"""

from typing import NamedTuple

import numpy as np

from ..errors import Reason, Status
from ..frames import geodetic_from_ecef
from ..timescales import gpst_to_datetime64

__all__ = ["COLUMNS", "CONTRACT", "Column", "format_times", "reason_labels", "status_labels"]

CONTRACT = (
    "time_gpst,azimuth_deg,elevation_deg,length_m,east_m,north_m,up_m,azimuth_sd_deg,"
    "elevation_sd_deg,length_sd_m,n_sats,n_signals,ratio,success_probability,status,quality"
)
"""How every CSV file begins; scripts rely on it."""

_STATUS_LABELS = np.array([status.label for status in sorted(Status)])
_REASON_LABELS = np.array([reason.name.lower() for reason in sorted(Reason)])


class Column(NamedTuple):
    """One column of the table.

    Parameters
    ----------
    name : str
        Name in files, with its unit as suffix.
    unit : str
        Unit as written in attributes; ``1`` for pure numbers, empty for text.
    description : str
        What it is.
    spec : str
        Format of one value in text files.
    """

    name: str
    unit: str
    description: str
    spec: str


COLUMNS = (
    Column("time_gpst", "", "GPS time of the rover's time tag", "%s"),
    Column("azimuth_deg", "degree", "azimuth from base to rover, clockwise from true north", "%.6f"),
    Column("elevation_deg", "degree", "elevation from base to rover, upwards", "%.6f"),
    Column("length_m", "m", "length measured without the declared one", "%.5f"),
    Column("east_m", "m", "baseline, east", "%.5f"),
    Column("north_m", "m", "baseline, north", "%.5f"),
    Column("up_m", "m", "baseline, up", "%.5f"),
    Column("azimuth_sd_deg", "degree", "standard deviation of the azimuth", "%.6f"),
    Column("elevation_sd_deg", "degree", "standard deviation of the elevation", "%.6f"),
    Column("length_sd_m", "m", "standard deviation of the measured length", "%.6f"),
    Column("n_sats", "1", "satellites used", "%d"),
    Column("n_signals", "1", "double-differenced phases used", "%d"),
    Column("ratio", "1", "objective of the second-best over the best integers", "%.3f"),
    Column("success_probability", "1", "posterior probability of the integers", "%.9f"),
    Column("status", "", "fixed, held, float or none", "%s"),
    Column("quality", "1", "quality class, 1 (integer) to 6 (single point), 0 without solution", "%d"),
    Column("reason", "", "why the epoch has its status", "%s"),
    Column("x_ecef_m", "m", "baseline, ECEF x", "%.5f"),
    Column("y_ecef_m", "m", "baseline, ECEF y", "%.5f"),
    Column("z_ecef_m", "m", "baseline, ECEF z", "%.5f"),
    Column("cov_ee_m2", "m2", "variance of the baseline, east", "%.6e"),
    Column("cov_nn_m2", "m2", "variance of the baseline, north", "%.6e"),
    Column("cov_uu_m2", "m2", "variance of the baseline, up", "%.6e"),
    Column("cov_en_m2", "m2", "covariance of the baseline, east and north", "%.6e"),
    Column("cov_nu_m2", "m2", "covariance of the baseline, north and up", "%.6e"),
    Column("cov_ue_m2", "m2", "covariance of the baseline, up and east", "%.6e"),
    Column("pdop", "1", "position dilution of the double differences", "%.3f"),
    Column("hdop", "1", "horizontal dilution", "%.3f"),
    Column("vdop", "1", "vertical dilution", "%.3f"),
    Column("azimuth_dop", "1", "azimuth dilution, per unit undifferenced phase noise and length", "%.3f"),
    Column("elevation_dop", "1", "elevation dilution, same normalisation", "%.3f"),
    Column("chi2", "1", "residual test of the winning integers", "%.3f"),
    Column("chi2_limit", "1", "limit of the residual test", "%.3f"),
    Column("latitude_deg", "degree", "latitude of the base antenna, WGS 84, single point", "%.8f"),
    Column("longitude_deg", "degree", "longitude of the base antenna", "%.8f"),
    Column("height_m", "m", "ellipsoidal height of the base antenna", "%.3f"),
)


def status_labels(solution):
    """Status words by epoch, ndarray of str, shape (n,)."""
    return _STATUS_LABELS[solution.status]


def reason_labels(solution):
    """Reason words by epoch, ndarray of str, shape (n,)."""
    return _REASON_LABELS[solution.reason]


def format_times(time_ns):
    """ISO times of GPS time, all with the fewest of 3, 6 or 9 decimals that lose nothing.

    Parameters
    ----------
    time_ns : ndarray of int64, shape (n,)
        GPS time, nanoseconds.

    Returns
    -------
    list of str
    """
    time_ns = np.asarray(time_ns, dtype=np.int64)
    exact = (unit for unit, step in (("ms", 1_000_000), ("us", 1_000)) if not np.any(time_ns % step))
    unit = next(exact, "ns")
    return np.datetime_as_string(gpst_to_datetime64(time_ns), unit=unit).tolist()


def column_arrays(solution):
    """Yield the arrays of `COLUMNS` in order; times stay ``datetime64[ns]`` of GPS time."""
    degrees = np.degrees
    yield gpst_to_datetime64(solution.time_ns)
    yield degrees(solution.azimuth_rad)
    yield degrees(solution.elevation_rad)
    yield solution.length_m
    yield from solution.baseline_enu_m.T
    yield degrees(solution.azimuth_sd_rad)
    yield degrees(solution.elevation_sd_rad)
    yield solution.length_sd_m
    yield solution.n_sats
    yield solution.n_signals
    yield solution.ratio
    yield solution.success_probability
    yield status_labels(solution)
    yield solution.quality
    yield reason_labels(solution)
    yield from solution.baseline_ecef_m.T
    for row, column in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)):
        yield solution.cov_enu_m2[:, row, column]
    for name in ("pdop", "hdop", "vdop", "azimuth_dop", "elevation_dop", "chi2", "chi2_limit"):
        yield getattr(solution, name)
    yield from geodetic_degrees(solution.position_ecef_m)


def geodetic_degrees(position_ecef_m):
    """Latitude and longitude in degrees and height; NaN for the centre of the Earth, which is no position."""
    absent = ~np.any(position_ecef_m, axis=-1, keepdims=True)
    latitude_rad, longitude_rad, height_m = geodetic_from_ecef(np.where(absent, np.nan, position_ecef_m))
    return np.degrees(latitude_rad), np.degrees(longitude_rad), height_m
