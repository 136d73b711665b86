"""The body of a RINEX 3 observation file, numbers in, bytes out: the inverse of `rinex_obs`.

Every observation is a field F14.3 with a digit for loss of lock and one for signal strength behind it.
What arrives here are integers of 0.001 units, so nothing is rounded here. What is missing is blank, and
so is the end of a line behind its last field, which is not written.

Reference: RINEX 3.05, tables A2 and A3.
"""

import numpy as np

from .jit import kernel

MISSING = np.iinfo(np.int64).min

_SPACE, _DOT, _MINUS, _ZERO, _FEED = 32, 46, 45, 48, 10


@kernel
def _digits(out, end, value, count):
    """Write an unsigned integer of at least `count` digits so that it ends before `end`; where it starts."""
    while value > 0 or count > 0:
        end -= 1
        out[end] = _ZERO + value % 10
        value //= 10
        count -= 1
    return end


@kernel
def write_epochs(
    out, line_bytes, letters, heads, head_bytes, epoch_start, sat, mantissa, field_at, lost, strength
):
    """Write epochs.

    Parameters
    ----------
    out : ndarray of uint8
        The text; long enough for all lines at their longest.
    line_bytes : int
        Longest line of a satellite, with its line feed.
    letters : ndarray of uint8, shape (7,)
        Letter of each system.
    heads : ndarray of uint8, shape (n_epochs, m)
        Epoch lines with their line feeds.
    head_bytes : ndarray of int64, shape (n_epochs,)
        Bytes of each that count.
    epoch_start : ndarray of int64, shape (n_epochs + 1,)
        First row of each epoch.
    sat : ndarray of int16, shape (n_rows,)
        Satellites; rows of a satellite stand together.
    mantissa : ndarray of int64, shape (n_rows, 4)
        Code, phase, Doppler and C/N0 in 0.001 units, `MISSING` for none.
    field_at : ndarray of int64, shape (n_rows, 4)
        Place of each in the line.
    lost, strength : ndarray of uint8, shape (n_rows,)
        Digit behind the phase, and digit behind code and phase; 0 for blank.

    Returns
    -------
    int
        Bytes written.
    """
    at = 0
    for epoch in range(len(head_bytes)):
        for k in range(head_bytes[epoch]):
            out[at + k] = heads[epoch, k]
        at += head_bytes[epoch]
        line, end, previous = at, at, -1
        for row in range(epoch_start[epoch], epoch_start[epoch + 1]):
            name = np.int64(sat[row])
            if name != previous:
                if previous >= 0:
                    out[end] = _FEED
                    line = end + 1
                for k in range(line_bytes):
                    out[line + k] = _SPACE
                out[line] = letters[name // 100]
                out[line + 1] = _ZERO + name // 10 % 10
                out[line + 2] = _ZERO + name % 10
                end = line + 3
                previous = name
            for kind in range(4):
                value = mantissa[row, kind]
                field = line + field_at[row, kind]
                if value != MISSING:
                    size = abs(value)
                    _digits(out, field + 14, size % 1000, 3)
                    out[field + 10] = _DOT
                    start = _digits(out, field + 10, size // 1000, 1)
                    if value < 0:
                        out[start - 1] = _MINUS
                    end = max(end, field + 14)
                    if kind < 2 and strength[row] > 0:
                        out[field + 15] = _ZERO + strength[row]
                        end = max(end, field + 16)
                if kind == 1 and lost[row] > 0:
                    out[field + 14] = _ZERO + lost[row]
                    end = max(end, field + 15)
        at = end
        if previous >= 0:
            out[end] = _FEED
            at = end + 1
    return at
