"""The body of a RINEX 3 observation file, columns in, bytes out: the inverse of `rinex_obs`.

Every observation is a field F14.3 with a digit for loss of lock and one for signal strength behind it.
A value x is written as the integer nearest to 1000 x, ties away from zero, so a value that is a
multiple of 0.001 comes out as printf would print it, and reading gives the same double again. Values
that are NaN are blank, and so is the end of a line behind its last field.

Reference: RINEX 3.05, tables A2 and A3.
"""

import numpy as np

from .jit import kernel

# What stopped the writing.
DONE, FULL, UNDECLARED, TOO_WIDE = np.int64(0), np.int64(1), np.int64(2), np.int64(3)

EPOCH_LINE_BYTES = 57
"""Longest epoch line with its line feed."""

_SPACE, _DOT, _MINUS, _ZERO, _ANGLE, _FEED = 32, 46, 45, 48, 62, 10
_FIELD_BYTES = 16
_TICKS_PER_DAY = 864_000_000_000
_DAYS_TO_1980 = 723_125  # from 0000-03-01 to 1980-01-06


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
def _epoch_line(out, at, ticks, flag, n_sats, clock_s):
    """Write an epoch line; where the next line starts, or -1 when the clock offset has no room."""
    for k in range(EPOCH_LINE_BYTES):
        out[at + k] = _SPACE
    out[at] = _ANGLE
    # Calendar from days, with years that start in March so that the leap day is the last.
    days = ticks // _TICKS_PER_DAY + _DAYS_TO_1980
    era = days // 146_097
    of_era = days - era * 146_097
    year = (of_era - of_era // 1460 + of_era // 36_524 - of_era // 146_096) // 365
    of_year = of_era - (365 * year + year // 4 - year // 100)
    month = (5 * of_year + 2) // 153
    day = of_year - (153 * month + 2) // 5 + 1
    month = month + 3 if month < 10 else month - 9
    year += era * 400 + (1 if month <= 2 else 0)
    ticks %= _TICKS_PER_DAY
    _digits(out, at + 6, year, 4)
    _digits(out, at + 9, month, 2)
    _digits(out, at + 12, day, 2)
    _digits(out, at + 15, ticks // 36_000_000_000, 2)
    _digits(out, at + 18, ticks // 600_000_000 % 60, 2)
    ticks %= 600_000_000
    _digits(out, at + 21, ticks // 10_000_000, 1)
    out[at + 21] = _DOT
    _digits(out, at + 29, ticks % 10_000_000, 7)
    out[at + 31] = _ZERO + flag
    _digits(out, at + 35, n_sats, 1)
    end = at + 35
    if np.isfinite(clock_s):
        size = abs(clock_s)
        if size >= (10.0 if clock_s < 0 else 100.0) - 1e-12:
            return -1
        picoseconds = np.int64(size * 1e12 + 0.5)
        end = at + 56
        _digits(out, end, picoseconds % 1_000_000_000_000, 12)
        out[at + 43] = _DOT
        start = _digits(out, at + 43, picoseconds // 1_000_000_000_000, 1)
        if clock_s < 0 and picoseconds > 0:
            out[start - 1] = _MINUS
    out[end] = _FEED
    return end + 1


@kernel
def write_epochs(
    first, last, out, letters, slot_of_signal, places, line_bytes,
    ticks, flag, clock_s, epoch_start, sat, signal, code_m, phase_cyc, doppler_hz, cn0_dbhz, lli,
):  # fmt: skip
    """Write epochs until the last one is done, the output is full, or a value cannot be written.

    Parameters
    ----------
    first, last : int
        Epochs ``first:last`` are to be written.
    out : ndarray of uint8
        The text; filled from the start.
    letters : ndarray of uint8, shape (7,)
        Letter of each system.
    slot_of_signal : ndarray of int64, shape (7, 1000)
        Index of a signal in `places` by system and signal code, -1 where it is not declared.
    places : ndarray of int64, shape (7, s, 4)
        Place of code, phase, Doppler and C/N0 in the line; -1 where not declared.
    line_bytes : int
        Longest line of a satellite, with its line feed.
    ticks : ndarray of int64, shape (n_epochs,)
        Time tags in units of 100 ns.
    flag : ndarray of uint8, shape (n_epochs,)
        Epoch flag, 0 or 1.
    clock_s, epoch_start, sat, signal, code_m, phase_cyc, doppler_hz, cn0_dbhz, lli : ndarray
        As in `truenorth.observations.Observations`.

    Returns
    -------
    outcome : int
        `DONE`, `FULL`, `UNDECLARED` or `TOO_WIDE`.
    epoch, row : int
        First epoch that is not written, and the row at fault.
    n_bytes : int
        Bytes written.
    """
    at = 0
    for epoch in range(first, last):
        begin, stop = epoch_start[epoch], epoch_start[epoch + 1]
        n_sats = 0
        for row in range(begin, stop):
            if row == begin or sat[row] != sat[row - 1]:
                n_sats += 1
        if at + EPOCH_LINE_BYTES + n_sats * line_bytes > len(out):
            return FULL, epoch, begin, at
        start_of_epoch = at
        at = _epoch_line(out, at, ticks[epoch], flag[epoch], n_sats, clock_s[epoch])
        if at < 0 or n_sats > 999:
            return TOO_WIDE, epoch, begin, start_of_epoch
        line = at
        end = at
        for row in range(begin, stop):
            system = sat[row] // 100
            if row == begin or sat[row] != sat[row - 1]:
                line = at
                for k in range(line_bytes):
                    out[line + k] = _SPACE
                out[line] = letters[system]
                out[line + 1] = _ZERO + sat[row] // 10 % 10
                out[line + 2] = _ZERO + sat[row] % 10
                end = line + 3
            slot = slot_of_signal[system, signal[row]]
            if slot < 0:
                return UNDECLARED, epoch, row, start_of_epoch
            strength = 0
            if np.isfinite(cn0_dbhz[row]):
                strength = min(max(np.int64(cn0_dbhz[row]) // 6, 1), 9)
            for kind in range(4):
                value = code_m[row]
                if kind == 1:
                    value = phase_cyc[row]
                elif kind == 2:
                    value = doppler_hz[row]
                elif kind == 3:
                    value = cn0_dbhz[row]
                flagged = kind == 1 and (lli[row] & 3) != 0
                there = np.isfinite(value)
                if not there and not flagged:
                    continue
                if places[system, slot, kind] < 0:
                    return UNDECLARED, epoch, row, start_of_epoch
                field = line + places[system, slot, kind]
                if there:
                    if value > 9_999_999_999.999 or value < -999_999_999.999:
                        return TOO_WIDE, epoch, row, start_of_epoch
                    mantissa = np.int64(abs(value) * 1000.0 + 0.5)
                    whole = mantissa // 1000
                    _digits(out, field + 14, mantissa % 1000, 3)
                    out[field + 10] = _DOT
                    k = _digits(out, field + 10, whole, 1)
                    if value < 0 and mantissa > 0:
                        out[k - 1] = _MINUS
                    end = max(end, field + 14)
                    if kind < 2 and strength > 0:
                        out[field + 15] = _ZERO + strength
                        end = max(end, field + 16)
                if flagged:
                    out[field + 14] = _ZERO + (lli[row] & 3)
                    end = max(end, field + 15)
            if row + 1 == stop or sat[row + 1] != sat[row]:
                out[end] = _FEED
                at = end + 1
    return DONE, last, 0, at
