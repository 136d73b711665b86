"""GPS time stamps before the lines of a sensor log.

Gyros and compasses of the serial age send no time; the computer that logs them writes its own, already
reduced to GPS time, before each line:

    929 339200.055000000 $C328.3P28.4R-12.4*41
    week, seconds of the week (nine decimals at most), what the sensor sent

The week is continuous since 1980-01-06. Lines that begin with ``#`` are remarks.
"""

import re

from ..timescales import NS_PER_S, NS_PER_WEEK

__all__ = ["sort_by_time", "split_stamp", "stamp"]

_STAMP = re.compile(r"(\d{1,4}) (\d{1,6})(?:\.(\d{0,9}))? ", re.ASCII)
_SECONDS_PER_WEEK = NS_PER_WEEK // NS_PER_S


def stamp(time_ns):
    """Write a time stamp.

    Parameters
    ----------
    time_ns : int
        GPS time, nanoseconds, not before 1980-01-06.

    Returns
    -------
    str
        Week and seconds of the week, nine decimals.
    """
    week, rest_ns = divmod(int(time_ns), NS_PER_WEEK)
    second, fraction_ns = divmod(rest_ns, NS_PER_S)
    return f"{week} {second}.{fraction_ns:09d}"


def split_stamp(line):
    """Take the time stamp off a line.

    Parameters
    ----------
    line : str
        The line.

    Returns
    -------
    time_ns : int or None
        GPS time, nanoseconds; None when the line begins with no stamp, or an impossible one.
    rest : str
        What follows the stamp; the whole line where there is none.
    """
    found = _STAMP.match(line)
    if found is None:
        return None, line
    week, second, fraction = found.groups()
    if int(second) >= _SECONDS_PER_WEEK:
        return None, line
    fraction_ns = int((fraction or "").ljust(9, "0"))
    return int(week) * NS_PER_WEEK + int(second) * NS_PER_S + fraction_ns, line[found.end() :]


def sort_by_time(time_ns, columns, warnings):
    """Bring samples into time order; those with equal stamps keep their order.

    Parameters
    ----------
    time_ns : ndarray of int64, shape (n,)
        Stamps in file order.
    columns : dict of str to ndarray, shape (n,)
        What belongs to them.
    warnings : list of str
        Grows by a sentence where time goes back.

    Returns
    -------
    time_ns : ndarray of int64, shape (n,)
    columns : dict of str to ndarray
    """
    n_back = int((time_ns[1:] < time_ns[:-1]).sum())
    if n_back == 0:
        return time_ns, columns
    warnings.append(f"time goes back at {n_back} places; the samples are sorted")
    order = time_ns.argsort(kind="stable")
    return time_ns[order], {name: column[order] for name, column in columns.items()}
