"""The body of a RINEX observation file, bytes in, columns out.

One pass over the text. An epoch's satellite lines are located first and put in order, then only the
fields that belong to a signal are read, so the rows leave the kernel sorted by (epoch, satellite,
signal). A field F14.3 is read as an integer and divided once by a power of ten: both are exact in
double precision, so the quotient is the correctly rounded value of the text.

Speed comes from looking at eight bytes at a time: ``words[k]`` is the little-endian 64-bit integer at
byte k (a view with a stride of one byte). A blank field is two comparisons, eight digits are three
multiplications. Without ``swift`` everything is read byte by byte, with the same results.

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
_SPACE, _DOT, _MINUS, _PLUS, _ZERO, _ANGLE = 32, 46, 45, 43, 48, 62
_PS_PER_S = 1_000_000_000_000
_DAY_OF_GPS_EPOCH = 723_126
_COMMENT, _LABEL_MASK = np.uint64(0x00544E454D4D4F43), np.uint64(0x00FFFFFFFFFFFFFF)


_U = np.uint64
_ONE, _SEVEN, _EIGHT, _BITS_16, _BITS_32, _BITS_56 = _U(1), _U(7), _U(8), _U(16), _U(32), _U(56)
_ONES = _U(0x0101010101010101)
_TOP_BITS = _U(0x8080808080808080)
_FEEDS = _U(0x0A0A0A0A0A0A0A0A)
_BLANKS = _U(0x2020202020202020)
_MINUSES = _U(0x2D2D2D2D2D2D2D2D)
_ZEROS = _U(0x3030303030303030)
_ABOVE_NINE = _U(0x7676767676767676)
_INDEX_OF_BYTE = _U(0x0001020304050607)
_POINT_MASK, _POINT = _U(0x000000FF00000000), _U(0x0000002E00000000)
_BEFORE_POINT, _AFTER_POINT = _U(0x000000FFFF000000), _U(0xFFFFFF0000000000)
_PAIRS, _QUADS = _U(0x00FF00FF00FF00FF), _U(0x0000FFFF0000FFFF)
_BYTE, _TEN_5 = _U(255), _U(100_000)
_TEN_1, _TEN_2, _TEN_4 = _U(2561), _U(6553601), _U(42949672960001)  # 10^n in the low half, 1 above


@kernel
def _line_end(data, words, swift, start, size):
    """Index of the line feed that ends the line, or the size of the data."""
    k = start
    last = size - 7 if swift else 0
    while k < last:
        x = words[k] ^ _FEEDS
        hit = (x - _ONES) & ~x & _TOP_BITS  # top bit of the bytes that are zero, right up to the first
        if hit != 0:
            lowest = (hit & (~hit + _ONE)) >> _SEVEN
            return k + np.int64((lowest * _INDEX_OF_BYTE) >> _BITS_56)
        k += 8
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
def _eight_digits(v):
    """Number written by eight bytes 0 to 9, the first byte being the most significant."""
    v = (v * _TEN_1) >> _EIGHT
    v = ((v & _PAIRS) * _TEN_2) >> _BITS_16
    return ((v & _QUADS) * _TEN_4) >> _BITS_32


@kernel
def _field(w0, w1, divisor):
    """What `_decimal` says of 14 bytes given as words of bytes 0 to 7 and 6 to 13; 3 for "ask it".

    Takes numbers instead of the array because a compiled call with an array counts references.
    """
    if w0 == _BLANKS and w1 == _BLANKS:
        return np.nan, 0
    low = w1 ^ _ZEROS
    low = ((low << _EIGHT) & _BEFORE_POINT) | (low & _AFTER_POINT)  # 0 0 0 8 9 11 12 13
    high = w0 ^ _ZEROS
    not_low = ((low + _ABOVE_NINE) | low) & _TOP_BITS
    not_high = ((high + _ABOVE_NINE) | high) & _TOP_BITS
    # Bytes before the first digit, as a mask: they must be a run at the start of the field.
    lead = (not_high >> _SEVEN) * _BYTE
    if (w1 & _POINT_MASK) != _POINT or not_low != 0 or (lead & (lead + _ONE)) != 0:
        return np.nan, 3
    blanks = lead
    negative = False
    if (w0 & lead) != (_BLANKS & lead):
        blanks = lead >> _EIGHT
        sign = lead ^ blanks
        negative = True
        if (w0 & sign) != (_MINUSES & sign) or (w0 & blanks) != (_BLANKS & blanks):
            return np.nan, 3
    mantissa = np.int64(_eight_digits(high & ~lead) * _TEN_5 + _eight_digits(low))
    if mantissa == 0:
        return np.nan, 0
    value = mantissa / divisor
    return (-value if negative else value), 1


@kernel
def _epoch_time(data, start, end, old):
    """Time tag of an epoch line in its own scale, and where its seconds end.

    Returns `NO_TIME` when the field is blank and `_BAD_TIME` when it cannot be read.
    """
    at = start + (15 if old else 18)
    if end < at + 3:
        return _BAD_TIME, at
    year = _unsigned(data, at - 15 if old else at - 17, at - 12)
    month = _unsigned(data, at - 12, at - 9)
    day = _unsigned(data, at - 9, at - 6)
    hour = _unsigned(data, at - 6, at - 3)
    minute = _unsigned(data, at - 3, at)
    if old and year >= 0:
        year += 1900 if year >= 80 else 2000
    # Seconds as an integer of picoseconds, with as many decimals as there are.
    picoseconds = 0
    weight = 0
    k = at
    while k < end:
        c = np.int64(data[k]) - _ZERO
        if c >= 0 and c <= 9:
            picoseconds = picoseconds * 10 + c if weight == 0 else picoseconds + c * weight
            weight //= 10
        elif c == _DOT - _ZERO and weight == 0:
            picoseconds *= _PS_PER_S
            weight = _PS_PER_S // 10
        elif c != _SPACE - _ZERO or k > at + 1:
            break
        k += 1
    if year == -1 and month == -1 and day == -1 and hour == -1 and minute == -1 and k <= at + 2:
        return NO_TIME, at + 11
    bad = year < 1980 or year > 2200 or month < 1 or month > 12 or day < 1 or day > 31
    bad = bad or hour < 0 or hour > 23 or minute < 0 or minute > 59
    if bad or k < at + 4 or picoseconds > 61 * _PS_PER_S:
        return _BAD_TIME, at
    # Days since 1980-01-06, counting years from March.
    if month <= 2:
        year -= 1
    days = year * 365 + year // 4 - year // 100 + year // 400
    days += (153 * ((month + 9) % 12) + 2) // 5 + day - _DAY_OF_GPS_EPOCH
    whole = days * 86_400 + hour * 3_600 + minute * 60
    return whole * 1_000_000_000 + (picoseconds + 500) // 1000, k


@kernel
def _note(counter, at):
    """Count something that could not be read, and keep the place of the first."""
    counter[0] += 1
    if counter[1] < 0:
        counter[1] = at


@kernel
def parse_body(
    data, words, swift, state, old, pico, blank_system, system_of_letter, lines_per_sat,
    n_signals, signal_ids, columns, divisors, half_cycle,
    time_ns, clock_s, epoch_flag, epoch_start,
    sat, signal, code_m, phase_cyc, doppler_hz, cn0_dbhz, lli,
):  # fmt: skip
    """Read epochs from ``state[POSITION]`` until the end, an event record or full arrays.

    Parameters
    ----------
    data : ndarray of uint8
        The whole file.
    words : ndarray of uint64
        The 64-bit integers at every byte, one for all but the last seven.
    swift : bool
        Whether to use them.
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
    bad_fields = state[BAD_FIELDS : BAD_FIELDS + 2]
    bad_lines = state[BAD_LINES : BAD_LINES + 2]
    short_epochs = state[SHORT_EPOCHS : SHORT_EPOCHS + 2]
    state[OUTCOME] = END

    while pos < size:
        end = _line_end(data, words, swift, pos, size)
        stop = end - 1 if end > pos and data[end - 1] == 13 else end
        comment = stop > pos + 66 and pos + 68 <= size and (words[pos + 60] & _LABEL_MASK) == _COMMENT
        k = pos
        while k < stop and data[k] == _SPACE:
            k += 1
        if k == stop or comment:
            pos = end + 1
            continue
        time, after = _BAD_TIME, 0
        if data[pos] == (_SPACE if old else _ANGLE):
            time, after = _epoch_time(data, pos, stop, old)

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
        if flag_at < stop and time != _BAD_TIME:
            flag = max(_unsigned(data, flag_at, flag_at + 1), -1)
            if flag == -1 and data[flag_at] == _SPACE:
                flag = 0
            count = _unsigned(data, flag_at + 1, min(flag_at + 4, stop))
        if flag >= 2 and flag <= 6 and time != _BAD_TIME:
            state[EVENT_TIME] = time
            state[EVENT_FLAG] = flag
            state[EVENT_COUNT] = max(count, 0)
            state[EVENT_AT] = pos
            state[OUTCOME] = EVENT
            pos = end + 1
            break
        if flag < 0 or flag > 6 or count < 0 or time < 0:
            if not in_junk:
                _note(bad_lines, pos)
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
                _note(bad_fields, pos)
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
                    end = _line_end(data, words, swift, pos, size)
                    row_at, row_stop = pos, (end - 1 if end > pos and data[end - 1] == 13 else end)
                    for j in range(row_at, min(row_at + 32, row_stop)):
                        if data[j] != _SPACE:
                            broken = True
                    if broken or pos >= size:
                        broken = True
                        break
                    pos = end + 1
                at = row_at + 32 + 3 * (k % 12)
                sats[k] = -1
                if at + 3 <= row_stop:
                    system = blank_system if data[at] == _SPACE else system_of_letter[data[at]]
                    number = _unsigned(data, at + 1, at + 3)
                    if system >= 0 and number > 0:
                        sats[k] = system * 100 + number
            if broken:
                _note(bad_lines, epoch_at)
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
                end = _line_end(data, words, swift, pos, size)
                stop = end - 1 if end > pos and data[end - 1] == 13 else end
                # Calls with arrays cost, so look at single bytes before.
                if stop > pos + 66 and pos + 68 <= size and (words[pos + 60] & _LABEL_MASK) == _COMMENT:
                    pos = end + 1
                    continue
                if old:
                    if j == 0 and stop > pos + 28 and data[pos + 10] != _DOT:
                        # An epoch line, or an event record without a time: never an observation line.
                        empty = words[pos] == _BLANKS and words[pos + 8] == _BLANKS
                        empty = empty and words[pos + 16] == _BLANKS and words[pos + 20] == _BLANKS
                        event = data[pos + 28] >= _ZERO + 2 and data[pos + 28] <= _ZERO + 6
                        if data[pos + 18] == _DOT or (empty and event):
                            interrupted = True
                            break
                else:
                    if stop == pos:
                        pos = end + 1
                        continue
                    if data[pos] == _ANGLE:
                        interrupted = True
                        break
                    sats[got] = -1
                    if stop > pos + 2:
                        system = system_of_letter[data[pos]]
                        tens, units = np.int64(data[pos + 1]) - _ZERO, np.int64(data[pos + 2]) - _ZERO
                        if tens == _SPACE - _ZERO:
                            tens = 0
                        number = tens * 10 + units
                        if system >= 0 and 0 <= tens <= 9 and 0 <= units <= 9 and number > 0:
                            sats[got] = system * 100 + number
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
                    _note(bad_lines, epoch_at if old else line_start[got * lines_per_sat])
                got += 1
        state[LAST_GOT] = got
        state[LAST_EXPECTED] = count
        if got < count:
            _note(short_epochs, epoch_at)
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
                _note(bad_lines, line_start[slot * lines_per_sat])
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
                    whole = at + 14 <= line_stop[line]
                    outcome = 3
                    if whole and swift:
                        value, outcome = _field(words[at], words[at + 6], divisors[system, s, o])
                    if outcome == 3:
                        value, outcome = _decimal(
                            data, at, min(at + 14, line_stop[line]), divisors[system, s, o]
                        )
                    if outcome == 1 and not whole:
                        outcome = 2  # the line was cut within the number
                    if outcome == 1:
                        values[o] = value
                        found = True
                    elif outcome == 2:
                        _note(bad_fields, line_start[line])
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
