"""GPS time as int64 nanoseconds since 1980-01-06, and its relation to other scales.

At rest every time of the package is such an integer; inside kernels it is a float of seconds from
some epoch. GLONASS, BeiDou and UTC are converted once, in the readers.

    GPST = UTC + leap seconds,   GPST = BDT + 14 s,   GLONASST = UTC + 3 h
"""

from datetime import UTC, datetime
from typing import Any

import numpy as np

__all__ = [
    "BDT_OFFSET_NS",
    "NS_PER_DAY",
    "NS_PER_S",
    "NS_PER_WEEK",
    "format_gpst",
    "gpst_from_calendar",
    "gpst_from_utc_ns",
    "gpst_from_week",
    "gpst_to_datetime64",
    "leap_seconds",
    "parse_gpst",
    "week_from_gpst",
]

NS_PER_S = 1_000_000_000
NS_PER_DAY = 86_400 * NS_PER_S
NS_PER_WEEK = 7 * NS_PER_DAY
BDT_OFFSET_NS = 14 * NS_PER_S
"""GPS time minus BeiDou time."""

_GPS_EPOCH = np.datetime64("1980-01-06T00:00:00", "ns")

# UTC instants at which GPS minus UTC grew to the given value (IERS Bulletin C).
_LEAPS = [
    ("1981-07-01", 1),
    ("1982-07-01", 2),
    ("1983-07-01", 3),
    ("1985-07-01", 4),
    ("1988-01-01", 5),
    ("1990-01-01", 6),
    ("1991-01-01", 7),
    ("1992-07-01", 8),
    ("1993-07-01", 9),
    ("1994-07-01", 10),
    ("1996-01-01", 11),
    ("1997-07-01", 12),
    ("1999-01-01", 13),
    ("2006-01-01", 14),
    ("2009-01-01", 15),
    ("2012-07-01", 16),
    ("2015-07-01", 17),
    ("2017-01-01", 18),
]
_LEAP_UTC_NS = np.array([(np.datetime64(d, "ns") - _GPS_EPOCH).astype(np.int64) for d, _ in _LEAPS])


def leap_seconds(utc_ns: Any) -> Any:
    """GPS time minus UTC.

    Parameters
    ----------
    utc_ns : int or ndarray of int64
        UTC, written as nanoseconds since 1980-01-06 00:00 UTC without leap seconds.

    Returns
    -------
    int or ndarray
        Whole seconds.
    """
    return np.searchsorted(_LEAP_UTC_NS, utc_ns, side="right")


def gpst_from_utc_ns(utc_ns: Any) -> Any:
    """GPS time of a UTC instant, both in nanoseconds since 1980-01-06 of their own scale."""
    return utc_ns + leap_seconds(utc_ns) * NS_PER_S


def gpst_from_calendar(
    year: int, month: int, day: int, hour: int = 0, minute: int = 0, second: float = 0.0
) -> int:
    """Nanoseconds of a calendar time within one continuous scale.

    Parameters
    ----------
    year, month, day, hour, minute : int
        Calendar fields.
    second : float
        May carry a fraction; rounded to the nanosecond. Values of 60 and above roll over.

    Returns
    -------
    int
        Nanoseconds since 1980-01-06 00:00:00 of the same scale.
    """
    days = datetime(year, month, day, tzinfo=UTC).toordinal() - datetime(1980, 1, 6).toordinal()
    whole = days * 86_400 + hour * 3_600 + minute * 60
    return whole * NS_PER_S + round(second * NS_PER_S)


def gpst_from_week(week: int, tow_s: float) -> int:
    """Nanoseconds of GPS time from a continuous week number and seconds of the week."""
    return int(week) * NS_PER_WEEK + round(float(tow_s) * NS_PER_S)


def week_from_gpst(time_ns: Any) -> tuple[Any, Any]:
    """Split GPS time into continuous week and seconds of week.

    Parameters
    ----------
    time_ns : int or ndarray of int64
        GPS time, nanoseconds.

    Returns
    -------
    week : int or ndarray
        Weeks since 1980-01-06.
    tow_s : float or ndarray
        Seconds of the week.
    """
    week = time_ns // NS_PER_WEEK
    return week, (time_ns - week * NS_PER_WEEK) / NS_PER_S


def gpst_to_datetime64(time_ns: Any) -> Any:
    """GPS time as ``datetime64[ns]`` (still GPS time, not UTC)."""
    return _GPS_EPOCH + np.asarray(time_ns, dtype=np.int64).astype("timedelta64[ns]")


def format_gpst(time_ns: Any, *, decimals: int = 3) -> str:
    """Write GPS time as ISO 8601 without a zone, e.g. ``2024-06-24T08:20:00.000``."""
    step = 10 ** (9 - decimals)
    rounded = (int(time_ns) + step // 2) // step * step
    text = str(gpst_to_datetime64(rounded))
    return text[: 20 + decimals] if decimals else text[:19]


def parse_gpst(text: str) -> int:
    """Read an ISO 8601 GPS time, the inverse of `format_gpst`.

    Raises
    ------
    ValueError
        If the text is not an ISO time.
    """
    stamp = np.datetime64(text.strip().replace(" ", "T").removesuffix("Z"), "ns")
    if np.isnat(stamp):
        raise ValueError(f"could not read a time: {text!r} is not ISO 8601")
    return int(np.int64(stamp - _GPS_EPOCH))
