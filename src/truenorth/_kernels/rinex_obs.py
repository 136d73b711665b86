"""The body of a RINEX observation file, bytes in, columns out.

One pass over the text. An epoch's satellite lines are located first and put in order, then only the
fields that belong to a signal are read, so the rows leave the kernel sorted by (epoch, satellite,
signal). A field F14.3 is read as an integer and divided once by a power of ten: both are exact in
double precision, so the quotient is the correctly rounded value of the text.

The kernel stops at event records (epoch flags 2 to 6) and hands them to the caller, who may change
the tables and call again with the same state.

Reference: RINEX 2.11 section A2, RINEX 3.05 table A3, RINEX 4.02 table A3.
"""

import numpy as np

from .jit import kernel

# Slots of the state vector, shared with formats/rinex_obs.py.
POSITION = 0
N_EPOCHS = 1
N_ROWS = 2
OUTCOME = 3
BAD_FIELDS = 4
BAD_FIELD_AT = 5
BAD_LINES = 6
BAD_LINE_AT = 7
SHORT_EPOCHS = 8
SHORT_EPOCH_AT = 9
EVENT_TIME = 10
EVENT_FLAG = 11
EVENT_COUNT = 12
EVENT_AT = 13
LAST_GOT = 14
LAST_EXPECTED = 15
UNDECLARED = 16
STATE_SIZE = 17

# Outcomes.
END, EVENT, GROW = 0, 1, 2

NO_TIME = np.iinfo(np.int64).min
_BAD_TIME = NO_TIME + 1

_MAX_SATS = 1000
_SPACE, _DOT, _MINUS, _PLUS, _ZERO = 32, 46, 45, 43, 48


@kernel
def _line_end(data, start, size):
    """Index of the line feed that ends the line, or the size of the data."""
    k = start
    while k < size and data[k] != 10:
        k += 1
    return k


@kernel
def _unsigned(data, start, stop):
    """Blank-padded unsigned integer; -1 when blank, -2 when something else."""
    value = -1
    closed = False
    for k in range(start, stop):
        c = np.int64(data[k])
        if c == _SPACE:
            closed = value >= 0
        elif c < _ZERO or c > _ZERO + 9 or closed:
            return -2
        else:
            value = max(value, 0) * 10 + c - _ZERO
    return value


@kernel
def _decimal(data, start, stop, divisor):
    """Value of one field, and 0 for missing, 1 for read, 2 for unreadable.

    ``divisor`` is 1000 times the scale factor of the observable: that of a text with three decimals.
    """
    mantissa = 0
    digits = 0
    k = start
    while k < stop and data[k] == _SPACE:
        k += 1
    if k == stop:
        return np.nan, 0
    negative = data[k] == _MINUS
    if negative or data[k] == _PLUS:
        k += 1
    first = k
    while k < stop:
        c = np.int64(data[k]) - _ZERO
        if c < 0 or c > 9:
            break
        mantissa = mantissa * 10 + c
        k += 1
    digits = k - first
    if k == stop or data[k] != _DOT:
        return np.nan, 2
    k += 1
    point = k
    while k < stop:
        c = np.int64(data[k]) - _ZERO
        if c < 0 or c > 9:
            break
        mantissa = mantissa * 10 + c
        k += 1
    decimals = k - point
    digits += decimals
    while k < stop and data[k] == _SPACE:
        k += 1
    if k < stop or digits == 0 or digits > 15:
        return np.nan, 2
    if mantissa == 0:
        return np.nan, 0
    while decimals < 3:
        mantissa *= 10
        decimals += 1
    while decimals > 3:
        divisor *= 10.0
        decimals -= 1
    value = mantissa / divisor
    return (-value if negative else value), 1


@kernel
def _days_from_gps_epoch(year, month, day):
    """Days since 1980-01-06 in the Gregorian calendar."""
    y = year - 1 if month <= 2 else year
    era_year = y % 400
    shifted = (month + 9) % 12
    day_of_year = (153 * shifted + 2) // 5 + day - 1
    day_of_era = era_year * 365 + era_year // 4 - era_year // 100 + day_of_year
    return (y // 400) * 146_097 + day_of_era - 723_125


@kernel
def _epoch_time(data, start, end, old):
    """Time tag of an epoch line in its own scale, and where its seconds end.

    Returns `NO_TIME` when the field is blank and `_BAD_TIME` when it cannot be read.
    """
    first = start + (0 if old else 1)
    seconds_at = start + (15 if old else 18)
    if end < seconds_at + 3:
        return _BAD_TIME, seconds_at
    blank = True
    for k in range(first, min(end, seconds_at + 11)):
        if data[k] != _SPACE:
            blank = False
            break
    if blank:
        return NO_TIME, seconds_at + 11
    if old:
        year = _unsigned(data, start, start + 3)
        if year < 0 or year > 99:
            return _BAD_TIME, seconds_at
        year += 1900 if year >= 80 else 2000
    else:
        year = _unsigned(data, start + 1, start + 6)
    month = _unsigned(data, seconds_at - 12, seconds_at - 9)
    day = _unsigned(data, seconds_at - 9, seconds_at - 6)
    hour = _unsigned(data, seconds_at - 6, seconds_at - 3)
    minute = _unsigned(data, seconds_at - 3, seconds_at)
    if year < 1980 or year > 2200 or month < 1 or month > 12 or day < 1 or day > 31:
        return _BAD_TIME, seconds_at
    if hour < 0 or hour > 23 or minute < 0 or minute > 59:
        return _BAD_TIME, seconds_at
    k = seconds_at
    while k < end and data[k] == _SPACE:
        k += 1
    second = 0
    first = k
    while k < end and _ZERO <= data[k] <= _ZERO + 9 and k < first + 3:
        second = second * 10 + np.int64(data[k]) - _ZERO
        k += 1
    if k == first or second > 60 or k == end or data[k] != _DOT:
        return _BAD_TIME, seconds_at
    k += 1
    weight = 100_000_000_000
    picoseconds = 0
    while k < end and _ZERO <= data[k] <= _ZERO + 9:
        picoseconds += (np.int64(data[k]) - _ZERO) * weight
        weight //= 10
        k += 1
    whole = _days_from_gps_epoch(year, month, day) * 86_400 + hour * 3_600 + minute * 60 + second
    return whole * 1_000_000_000 + (picoseconds + 500) // 1000, k


@kernel
def _is_comment(data, start, end):
    """Whether columns 61 to 67 of the line say COMMENT."""
    return (
        end >= start + 67
        and data[start + 60] == 67
        and data[start + 61] == 79
        and data[start + 62] == 77
        and data[start + 63] == 77
        and data[start + 64] == 69
        and data[start + 65] == 78
        and data[start + 66] == 84
    )


@kernel
def _looks_like_epoch(data, start, end, old):
    """Cheap test whether a line begins an epoch; never true for a well-formed observation line."""
    if not old:
        return end > start and data[start] == 62
    if end < start + 29 or data[start] != _SPACE or data[start + 10] == _DOT:
        return False
    if data[start + 18] == _DOT:
        return True
    # An event record may leave its time blank; its flag stands alone in column 29.
    for k in range(start, start + 28):
        if data[k] != _SPACE:
            return False
    flag = data[start + 28]
    if flag < _ZERO + 2 or flag > _ZERO + 6:
        return False
    return end <= start + 32 or data[start + 32] == _SPACE or data[start + 31] != _SPACE


@kernel
def _satellite(data, start, end, system_of_letter, blank_system):
    """Satellite code of three characters such as ``G05`` or ``R 7``; -1 when it is none."""
    if end < start + 3:
        return -1
    letter = data[start]
    system = blank_system if letter == _SPACE else system_of_letter[letter]
    number = _unsigned(data, start + 1, start + 3)
    if system < 0 or number <= 0:
        return -1
    return system * 100 + number


@kernel
def parse_body(
    data, state, old, pico, blank_system, system_of_letter, lines_per_sat,
    n_signals, signal_ids, columns, divisors, half_cycle,
    time_ns, clock_s, epoch_flag, epoch_start,
    sat, signal, code_m, phase_cyc, doppler_hz, cn0_dbhz, lli,
):  # fmt: skip
    """Read epochs from ``state[POSITION]`` until the end, an event record or full arrays.

    Parameters
    ----------
    data : ndarray of uint8
        The whole file.
    state : ndarray of int64, shape (STATE_SIZE,)
        Position, counts and diagnostics; updated.
    old, pico : bool
        RINEX 2 layout; RINEX 4.01 and newer, whose epoch lines may end in picoseconds.
    blank_system : int
        System meant by a blank letter, -1 where not allowed.
    system_of_letter : ndarray of int64, shape (256,)
        System code by letter, -1 for others.
    lines_per_sat : int
        Text lines of one satellite.
    n_signals : ndarray of int64, shape (7,)
        Signals declared for each system, -1 for systems that are not declared.
    signal_ids : ndarray of int64, shape (7, s)
        Signal codes of each system in increasing order.
    columns : ndarray of int64, shape (7, s, 4)
        Place of code, phase, Doppler and C/N0: ``line << 16 | offset``; -1 where not declared.
    divisors : ndarray of float64, shape (7, s, 4)
        1000 times the scale factor.
    half_cycle : ndarray of uint8, shape (7, s)
        Bits to set in ``lli`` of every row (RINEX 2 wavelength factor).
    time_ns, clock_s, epoch_flag, epoch_start : ndarray
        Columns of the epochs; filled.
    sat, signal, code_m, phase_cyc, doppler_hz, cn0_dbhz, lli : ndarray
        Columns of the rows; filled.
    """
    size = len(data)
    pos = state[POSITION]
    n_epochs = state[N_EPOCHS]
    n_rows = state[N_ROWS]
    max_signals = signal_ids.shape[1]
    sats = np.empty(_MAX_SATS, np.int64)
    order = np.empty(_MAX_SATS, np.int64)
    line_start = np.empty(_MAX_SATS * lines_per_sat, np.int64)
    line_stop = np.empty(_MAX_SATS * lines_per_sat, np.int64)
    values = np.empty(4)
    in_junk = False
    state[OUTCOME] = END

    while pos < size:
        end = _line_end(data, pos, size)
        stop = end - 1 if end > pos and data[end - 1] == 13 else end
        k = pos
        while k < stop and data[k] == _SPACE:
            k += 1
        if k == stop or _is_comment(data, pos, stop):
            pos = end + 1
            continue
        time, after = _BAD_TIME, 0
        if _looks_like_epoch(data, pos, stop, old):
            time, after = _epoch_time(data, pos, stop, old)
        if time == _BAD_TIME:
            if not in_junk:
                state[BAD_LINES] += 1
                if state[BAD_LINE_AT] < 0:
                    state[BAD_LINE_AT] = pos
            in_junk = True
            pos = end + 1
            continue

        # Flag and number of satellites or records.
        flag_at = pos + 28
        if not old:
            flag_at = pos + 31 + max(after - (pos + 29), 0)
            if (
                flag_at <= stop
                and (flag_at == stop or data[flag_at] == _SPACE)
                and _ZERO <= data[flag_at - 1] <= _ZERO + 9
            ):
                flag_at -= 1  # some writers leave one blank out
        flag = 0
        count = -1
        if flag_at < stop:
            flag = max(_unsigned(data, flag_at, flag_at + 1), -1)
            if flag == -1 and data[flag_at] == _SPACE:
                flag = 0
            count = _unsigned(data, flag_at + 1, min(flag_at + 4, stop))
        if flag >= 2 and flag <= 6:
            state[EVENT_TIME] = time
            state[EVENT_FLAG] = flag
            state[EVENT_COUNT] = max(count, 0)
            state[EVENT_AT] = pos
            state[OUTCOME] = EVENT
            pos = end + 1
            break
        if flag < 0 or flag > 6 or count < 0 or time == NO_TIME:
            if not in_junk:
                state[BAD_LINES] += 1
                if state[BAD_LINE_AT] < 0:
                    state[BAD_LINE_AT] = pos
            in_junk = True
            pos = end + 1
            continue
        if n_epochs + 1 >= len(time_ns) or n_rows + count * max_signals > len(sat):
            state[OUTCOME] = GROW
            state[EVENT_COUNT] = count
            break
        in_junk = False
        epoch_at = pos

        clock = np.nan
        clock_at = flag_at + (40 if old else 10)
        clock_stop = min(clock_at + (12 if old else 15), stop)
        if clock_at < clock_stop:
            clock, outcome = _decimal(data, clock_at, clock_stop, 1000.0)
            if outcome == 2:
                state[BAD_FIELDS] += 1
                if state[BAD_FIELD_AT] < 0:
                    state[BAD_FIELD_AT] = pos
            elif outcome == 0:
                for k in range(clock_at, clock_stop):
                    if data[k] == _DOT:
                        clock = 0.0
        if pico and flag_at + 31 <= stop:
            extension = _unsigned(data, flag_at + 25, flag_at + 31)
            if extension > 0:
                time += (extension + 500) // 1000

        # Satellite list of RINEX 2, twelve a line.
        pos = end + 1
        if old:
            row_at, row_stop = epoch_at, stop
            broken = False
            for k in range(count):
                if k > 0 and k % 12 == 0:
                    end = _line_end(data, pos, size)
                    row_at, row_stop = pos, (end - 1 if end > pos and data[end - 1] == 13 else end)
                    for j in range(row_at, min(row_at + 32, row_stop)):
                        if data[j] != _SPACE:
                            broken = True
                    if broken or pos >= size:
                        broken = True
                        break
                    pos = end + 1
                sats[k] = _satellite(data, row_at + 32 + 3 * (k % 12), row_stop,
                                     system_of_letter, blank_system)  # fmt: skip
            if broken:
                state[BAD_LINES] += 1
                if state[BAD_LINE_AT] < 0:
                    state[BAD_LINE_AT] = epoch_at
                in_junk = True
                continue

        # Where the lines of every satellite are.
        got = 0
        interrupted = False
        while got < count and not interrupted:
            j = 0
            while j < lines_per_sat:
                if pos >= size:
                    interrupted = True
                    break
                end = _line_end(data, pos, size)
                stop = end - 1 if end > pos and data[end - 1] == 13 else end
                if _is_comment(data, pos, stop):
                    pos = end + 1
                    continue
                if j == 0 and _looks_like_epoch(data, pos, stop, old):
                    interrupted = True
                    break
                if not old:
                    if stop == pos:
                        pos = end + 1
                        continue
                    sats[got] = _satellite(data, pos, stop, system_of_letter, blank_system)
                if end == size and (got + 1 < count or j + 1 < lines_per_sat):
                    interrupted = True  # the file ends within this line
                    pos = size
                    break
                if end == size:
                    # The very last line has no line feed: trust it only if it ends where a field ends.
                    tail = (stop - pos - (0 if old else 3)) % 16
                    if stop > pos and tail != 14 and tail != 15 and tail != 0:
                        interrupted = True
                        pos = size
                        break
                line_start[got * lines_per_sat + j] = pos
                line_stop[got * lines_per_sat + j] = stop
                pos = end + 1
                j += 1
            if not interrupted:
                if sats[got] < 0:
                    state[BAD_LINES] += 1
                    if state[BAD_LINE_AT] < 0:
                        state[BAD_LINE_AT] = epoch_at if old else line_start[got * lines_per_sat]
                got += 1
        state[LAST_GOT] = got
        state[LAST_EXPECTED] = count
        if got < count:
            state[SHORT_EPOCHS] += 1
            if state[SHORT_EPOCH_AT] < 0:
                state[SHORT_EPOCH_AT] = epoch_at
            if got == 0:
                continue

        # Order of the satellites, by insertion: they are few and mostly in order.
        for k in range(got):
            j = k
            while j > 0 and sats[order[j - 1]] > sats[k]:
                order[j] = order[j - 1]
                j -= 1
            order[j] = k

        time_ns[n_epochs] = time
        clock_s[n_epochs] = clock
        epoch_flag[n_epochs] = flag
        epoch_start[n_epochs] = n_rows
        previous = -1
        for rank in range(got):
            slot = order[rank]
            name = sats[slot]
            if name < 0:
                continue
            if name == previous:
                state[BAD_LINES] += 1
                if state[BAD_LINE_AT] < 0:
                    state[BAD_LINE_AT] = line_start[slot * lines_per_sat]
                continue
            previous = name
            system = name // 100
            if n_signals[system] < 0:
                state[UNDECLARED] += 1
                continue
            last_signal = -1
            for s in range(n_signals[system]):
                if signal_ids[system, s] == last_signal:
                    continue  # two RINEX 2 types mean this signal; the first that has data counts
                found = False
                bits = half_cycle[system, s]
                for o in range(4):
                    values[o] = np.nan
                    place = columns[system, s, o]
                    if place < 0:
                        continue
                    line = slot * lines_per_sat + (place >> 16)
                    at = line_start[line] + (place & 0xFFFF)
                    if at >= line_stop[line]:
                        continue
                    value, outcome = _decimal(
                        data, at, min(at + 14, line_stop[line]), divisors[system, s, o]
                    )
                    if outcome == 1 and at + 14 > line_stop[line]:
                        outcome = 2  # the line was cut within the number
                    if outcome == 1:
                        values[o] = value
                        found = True
                    elif outcome == 2:
                        state[BAD_FIELDS] += 1
                        if state[BAD_FIELD_AT] < 0:
                            state[BAD_FIELD_AT] = line_start[line]
                    if o == 1 and at + 14 < line_stop[line]:
                        indicator = np.int64(data[at + 14]) - _ZERO
                        if indicator >= 0 and indicator <= 9:
                            bits |= np.uint8(indicator & 3)
                if found:
                    last_signal = signal_ids[system, s]
                    sat[n_rows] = name
                    signal[n_rows] = last_signal
                    code_m[n_rows] = values[0]
                    phase_cyc[n_rows] = values[1]
                    doppler_hz[n_rows] = values[2]
                    cn0_dbhz[n_rows] = values[3]
                    lli[n_rows] = bits
                    n_rows += 1
        n_epochs += 1
        epoch_start[n_epochs] = n_rows

    state[POSITION] = min(pos, size)
    state[N_EPOCHS] = n_epochs
    state[N_ROWS] = n_rows
