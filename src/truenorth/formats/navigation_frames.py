"""Broadcast navigation frames made from ephemerides: the inverse of `navigation_bits`.

Every quantity is rounded to the least significant bit of its field, so reading the frames gives the
ephemeris as the satellite would send it. Frames come as the words that a u-blox receiver hands out
(RXM-SFRBX), with all check bits as they are sent:

- GPS, QZSS LNAV: ten words of 30 bits with the (32, 26) Hamming parity of IS-GPS-200N table 20-XIV, which
  also takes the last two bits of the word before. A word after one that ends in 1 is sent inverted; the
  receiver undoes that for the whole word, parity included.
- BeiDou D1, D2: BCH(15, 11, 1) with x^4 + x + 1, two blocks a word but in the first word, interleaving
  undone (BDS-SIS-ICD-B1I-3.0, 5.1.3).
- Galileo: CRC-24Q over the even and the odd page part (OS SIS ICD 2.1, 5.1.9.4), or over the page (4.2.2).
- GLONASS: Hamming code of the string in its last eight bits (ICD L1/L2 5.1, 4.7).

A frame begins every 30 s of the system's own time: GPS, QZSS, Galileo and BeiDou time, UTC for GLONASS.

References: those of `truenorth.formats.navigation_bits`.
"""

import functools
import math
from dataclasses import replace

import numpy as np

from ..constants import BEIDOU, GALILEO, GLONASS, GPS, QZSS
from ..navigation import KEPLER_COLUMNS, STATE_COLUMNS, MessageType
from ..timescales import (
    BDT_OFFSET_NS,
    NS_PER_DAY,
    NS_PER_S,
    NS_PER_WEEK,
    gpst_to_datetime64,
    leap_seconds,
)
from . import navigation_bits as bits
from .ubx import crc24q

__all__ = [
    "FRAME_NS",
    "as_broadcast",
    "beidou_words",
    "fnav_words",
    "frame_start_ns",
    "glonass_words",
    "inav_words",
    "insert",
    "is_geostationary",
    "ionosphere_words",
    "lnav_subframes",
    "lnav_words",
    "navigation_words",
    "own_frame_offset_ns",
]

FRAME_NS = 30 * NS_PER_S
"""Every message is sent once in this time (Galileo F/NAV takes longer, which nobody minds)."""

_ANGLES = ("m0_rad", "omega0_rad", "omega_rad", "i0_rad")
_MOSCOW_NS = 3 * 3600 * NS_PER_S


def _at(frame, first, count, scale=1.0):
    """One run of bits, unsigned."""
    return bits.BitField(((frame, first, count),), scale)


def insert(frames, field, n_bits, value, *, wrap=False):
    """Write one field into the frames that hold it: the inverse of `navigation_bits.extract`.

    Parameters
    ----------
    frames : dict of int to int
        Frame bits by number; the field's bits must be zero. Updated.
    field : BitField
        Where to write.
    n_bits : int
        Length of every frame.
    value : int or float
        In the units of the field.
    wrap : bool
        Whether the value is an angle, of which whole turns are taken off.

    Raises
    ------
    ValueError
        If the value has no room in the field.
    """
    length = sum(count for _, _, count in field.runs)
    number = round(value / field.scale)
    half = 1 << (length - 1)
    if wrap:
        number = (number + half) % (2 * half) - half
    low, high = {"u": (0, 2 * half - 1), "s": (-half, half - 1), "m": (1 - half, half - 1)}[field.kind]
    if not low <= number <= high:
        raise ValueError(f"{value!r} has no room in {length} bits of {field.scale!r}")
    if field.kind == "m" and number < 0:
        number = half - number
    number &= 2 * half - 1
    for frame, first, count in field.runs:
        length -= count
        run = number >> length & ((1 << count) - 1)
        frames[frame] |= run << (n_bits - first - count)


def _insert_all(frames, fields, n_bits, values):
    for name, field in fields.items():
        insert(frames, field, n_bits, values[name], wrap=name in _ANGLES)


def _exact(time_ns, step_s, what):
    """Seconds of a time that must be a whole number of steps."""
    seconds, rest = divmod(time_ns, NS_PER_S)
    if rest or seconds % step_s:
        raise ValueError(f"{what} is no multiple of {step_s} s")
    return seconds


# ------------------------------------------------------------------------------------ check bits

# Data bits (1 to 24, bit 1 first) and which of the last two bits before (29, 30) each parity bit sums.
_PARITY = (
    (29, (1, 2, 3, 5, 6, 10, 11, 12, 13, 14, 17, 18, 20, 23)),
    (30, (2, 3, 4, 6, 7, 11, 12, 13, 14, 15, 18, 19, 21, 24)),
    (29, (1, 3, 4, 5, 7, 8, 12, 13, 14, 15, 16, 19, 20, 22)),
    (30, (2, 4, 5, 6, 8, 9, 13, 14, 15, 16, 17, 20, 21, 23)),
    (30, (1, 3, 5, 6, 7, 9, 10, 14, 15, 16, 17, 18, 21, 22, 24)),
    (29, (3, 5, 6, 8, 9, 10, 11, 13, 15, 19, 22, 23, 24)),
)
# The same as masks of 26 bits: bit 29 and bit 30 of the word before, then the data.
_PARITY_MASKS = tuple(
    (1 << (25 if before == 29 else 24)) | sum(1 << (24 - k) for k in taps) for before, taps in _PARITY
)


def _lnav_parity(data, before):
    """Six parity bits of 24 data bits after a word that ends in the two bits `before`."""
    value = before << 24 | data
    parity = 0
    for mask in _PARITY_MASKS:
        parity = parity << 1 | (value & mask).bit_count() & 1
    return parity


def lnav_words(subframe):
    """Words of a GPS or QZSS subframe, parity added.

    Parameters
    ----------
    subframe : int
        `navigation_bits.LNAV_BITS` bits: 24 data bits of each word. The last two of words 2 and 10, which
        carry nothing, are set so that the word ends in two zeros (IS-GPS-200N 20.3.3.2).

    Returns
    -------
    list of int
        Ten words; above the 30 bits stand the last two of the word before.
    """
    words = []
    before = 0
    for k in range(10):
        data = subframe >> (216 - 24 * k) & 0xFFFFFF
        if k in (1, 9):
            data = next(d for d in range(data & ~3, (data | 3) + 1) if _lnav_parity(d, before) & 3 == 0)
        parity = _lnav_parity(data, before)
        word = before << 30 | data << 6 | parity
        # What was sent inverted is turned back as a whole by the receiver.
        words.append(word ^ (0xC000003F if before & 1 else 0))
        before = parity & 3
    return words


def _bch_bits(data):
    """Four check bits of eleven data bits."""
    rest = data << 4
    for k in range(14, 3, -1):
        if rest >> k & 1:
            rest ^= 0b10011 << (k - 4)
    return rest


_BCH = tuple(_bch_bits(data) for data in range(1 << 11))


def beidou_words(subframe):
    """Words of a BeiDou D1 or D2 subframe, check bits added.

    Parameters
    ----------
    subframe : int
        `navigation_bits.D1_BITS` bits: 26 of the first word, 22 of each other.

    Returns
    -------
    list of int
        Ten words of 30 bits, not interleaved.
    """
    first = subframe >> 198
    words = [first << 4 | _BCH[first & 0x7FF]]
    for k in range(9):
        data = subframe >> (176 - 22 * k) & 0x3FFFFF
        words.append(data << 8 | _BCH[data >> 11] << 4 | _BCH[data & 0x7FF])
    return words


def inav_words(word):
    """Words of a nominal Galileo I/NAV page that carries a 128-bit word.

    Parameters
    ----------
    word : int
        `navigation_bits.INAV_BITS` bits.

    Returns
    -------
    list of int
        Eight words of 32 bits: even part of 120 bits and 8 of padding, odd part likewise; search-and-rescue
        and reserved bits are zero.
    """
    even = word >> 16  # both leading bits zero: even, nominal
    odd = 0b10 << 80 | (word & 0xFFFF) << 64
    odd = odd << 24 | crc24q(even << 82 | odd)
    return _words32(even << 142 | odd << 22, 8)


def fnav_words(page):
    """Words of a Galileo F/NAV page.

    Parameters
    ----------
    page : int
        `navigation_bits.FNAV_BITS` bits.

    Returns
    -------
    list of int
        Eight words of 32 bits: page, checksum, tail and padding.
    """
    return _words32((page << 24 | crc24q(page)) << 18, 8)


# Bits of a string (85 is sent first, 1 last) that each of the check bits 1 to 7 sums, as masks.
def _hamming_masks():
    data = list(range(9, 86))  # 77 bits; their code words are the numbers that are no powers of two
    codes = [n for n in range(3, 128) if n & (n - 1)][: len(data)]
    return tuple(
        sum(1 << (bit - 1) for bit, code in zip(data, codes, strict=True) if code >> k & 1) for k in range(7)
    )


_HAMMING_MASKS = _hamming_masks()


def glonass_words(string, superframe, frame):
    """Words of a GLONASS string, check bits added.

    Parameters
    ----------
    string : int
        `navigation_bits.GLONASS_BITS` bits; the last eight are replaced.
    superframe, frame : int
        Count of the superframe and number of the frame within it, 1 to 5.

    Returns
    -------
    list of int
        Three words of 32 bits with the 85 bits in front, and one of the counts.
    """
    string &= ~0xFF
    check = sum(((string & mask).bit_count() & 1) << k for k, mask in enumerate(_HAMMING_MASKS))
    string |= check
    string |= (string.bit_count() & 1) << 7  # the sum of all bits is even
    return [*_words32(string << 11, 3), (superframe & 0xFFFF) << 16 | frame]


def _words32(value, count):
    return [value >> 32 * (count - 1 - k) & 0xFFFFFFFF for k in range(count)]


# ---------------------------------------------------------------------------------------- frames


def own_frame_offset_ns(system, time_ns):
    """GPS time minus the time in whose multiples of 30 s a system's frames begin.

    Parameters
    ----------
    system : int
        System code.
    time_ns : int
        GPS time, nanoseconds.

    Returns
    -------
    int
        Nanoseconds.
    """
    if system == BEIDOU:
        return BDT_OFFSET_NS
    if system == GLONASS:
        return _leap_at(time_ns) * NS_PER_S
    return 0


def _leap_at(gpst_ns):
    """GPS time minus UTC at a GPS time."""
    return int(leap_seconds(gpst_ns - int(leap_seconds(gpst_ns)) * NS_PER_S))


def frame_start_ns(system, time_ns):
    """GPS time at which the last frame began that is complete at a time.

    Parameters
    ----------
    system : int
        System code.
    time_ns : int
        GPS time, nanoseconds.

    Returns
    -------
    int
        GPS time, nanoseconds.
    """
    offset_ns = own_frame_offset_ns(system, time_ns)
    return ((time_ns - offset_ns) // FRAME_NS - 1) * FRAME_NS + offset_ns


@functools.lru_cache(maxsize=8192)
def navigation_words(navigation, table, row, start_ns):
    """All frames of an ephemeris that are sent from some time on.

    Parameters
    ----------
    navigation : Navigation
        Where the ephemeris is.
    table : {"kepler", "states"}
        In which table.
    row : int
        Which row.
    start_ns : int
        GPS time at which the frame begins, as `frame_start_ns` gives it.

    Returns
    -------
    tuple of list of int
        Words of RXM-SFRBX, one list a message.

    Raises
    ------
    ValueError
        If a value of the ephemeris has no room in the message, or there is no such message.
    """
    if table == "states":
        return _glonass(navigation, row, start_ns)
    eph = navigation.kepler
    system, message = int(eph.sat[row]) // 100, MessageType(int(eph.message[row]))
    if system in (GPS, QZSS) and message == MessageType.LNAV:
        return tuple(lnav_words(subframe) for subframe in lnav_subframes(eph, row, start_ns))
    if system == GALILEO and message == MessageType.INAV:
        return _inav(navigation, row, start_ns)
    if system == GALILEO and message == MessageType.FNAV:
        return _fnav(navigation, row, start_ns)
    if system == BEIDOU and message in (MessageType.D1, MessageType.D2):
        return _beidou(navigation, row, start_ns)
    raise ValueError(f"{message.name} of this system is not written")


# What does not depend on the time of transmission is packed once for each ephemeris.
_once = functools.lru_cache(maxsize=4096)


def _elements(eph, row):
    return dict(zip(KEPLER_COLUMNS, eph.elements[row].tolist(), strict=True))


def _without(fields, *names):
    return {name: field for name, field in fields.items() if name not in names}


def _lnav_head(frames, start_ns):
    """Telemetry and hand-over words; the count is the start of the next subframe."""
    for number in frames:
        insert(frames, _at(number, 0, 8), bits.LNAV_BITS, 0x8B)
        next_s = (start_ns // NS_PER_S + 6 * number) % 604_800
        insert(frames, _at(number, 24, 17, scale=6.0), bits.LNAV_BITS, next_s)
        insert(frames, _at(number, 43, 3), bits.LNAV_BITS, number)


def lnav_subframes(eph, row, start_ns):
    """Subframes 1 to 3 of a GPS or QZSS ephemeris, without parity.

    Parameters
    ----------
    eph : KeplerEphemerides
        Where the ephemeris is.
    row : int
        Which row.
    start_ns : int
        GPS time at which subframe 1 begins, a multiple of 6 s.

    Returns
    -------
    tuple of int
        `navigation_bits.LNAV_BITS` bits each.

    Raises
    ------
    ValueError
        If a value of the ephemeris has no room in the message.
    """
    frames = dict(zip((1, 2, 3), _lnav_body(eph, row), strict=True))
    _lnav_head(frames, start_ns)
    insert(frames, bits.LNAV_FIELDS["week"], bits.LNAV_BITS, start_ns // NS_PER_WEEK % 1024)
    return tuple(frames.values())


@_once
def _lnav_body(eph, row):
    sat, iode = int(eph.sat[row]), int(eph.iode[row]) & 0xFF
    usual_fit_s = 7_200.0 if sat // 100 == QZSS else 14_400.0
    values = _elements(eph, row)
    values |= {
        "ura_index": _ura_index(values["ura_m"]),
        "health": int(eph.health[row]) & 0x3F,
        "iodc": int(eph.iodc[row]) & 0x300 | iode,
        "iode": iode,
        "iode3": iode,
        "toe_s": _exact(int(eph.toe_ns[row]) % NS_PER_WEEK, 16, "toe"),
        "toc_s": _exact(int(eph.toc_ns[row]) % NS_PER_WEEK, 16, "toc"),
        "fit_flag": int(values["fit_interval_s"] > usual_fit_s),
    }
    frames = dict.fromkeys((1, 2, 3), 0)
    insert(frames, _at(1, 58, 2), bits.LNAV_BITS, 1)  # P code on L2
    _insert_all(frames, _without(bits.LNAV_FIELDS, "week"), bits.LNAV_BITS, values)
    return tuple(frames.values())


def ionosphere_words(klobuchar, start_ns):
    """Subframe 4 page 18 of a GPS or QZSS satellite: ionosphere and leap seconds.

    Parameters
    ----------
    klobuchar : ndarray, shape (8,)
        Alpha 0-3, beta 0-3.
    start_ns : int
        GPS time at which the frame of the subframe begins.

    Returns
    -------
    list of int
        Ten words.

    Raises
    ------
    ValueError
        If a coefficient has no room in the message.
    """
    frames = {4: 0}
    _lnav_head(frames, start_ns)
    insert(frames, _at(4, 48, 2), bits.LNAV_BITS, 1)
    insert(frames, bits.LNAV_PAGE, bits.LNAV_BITS, 56)
    for field, value in zip(bits.LNAV_KLOBUCHAR, klobuchar, strict=True):
        insert(frames, field, bits.LNAV_BITS, float(value))
    leap_s = _leap_at(start_ns)
    # The last change of leap seconds lies behind; the end of a day four weeks ago says so.
    past_ns = start_ns - 4 * NS_PER_WEEK
    values = {
        "now_s": leap_s,
        "future_s": leap_s,
        "week": past_ns // NS_PER_WEEK % 256,
        "day": past_ns % NS_PER_WEEK // NS_PER_DAY + 1,
    }
    _insert_all(frames, bits.LNAV_LEAP, bits.LNAV_BITS, values)
    insert(frames, _at(4, 184, 8), bits.LNAV_BITS, start_ns // NS_PER_WEEK % 256)
    return lnav_words(frames[4])


def _galileo_values(eph, row):
    values = _elements(eph, row)
    iod, health = int(eph.iode[row]) & 0x3FF, int(eph.health[row])
    return values | {
        **{f"iod{k}": iod for k in (1, 2, 3, 4)},
        "svid": int(eph.sat[row]) % 100,
        "toe_s": _exact(int(eph.toe_ns[row]) % NS_PER_WEEK, 60, "toe"),
        "toc_s": _exact(int(eph.toc_ns[row]) % NS_PER_WEEK, 60, "toc"),
        "sisa_index": _sisa_index(values["ura_m"]),
        # RINEX 4.01 table A8: E1-B in bits 0-2, E5a in bits 3-5, E5b in bits 6-8.
        "e1b_invalid": health & 1,
        "e1b_health": health >> 1 & 3,
        "e5a_invalid": health >> 3 & 1,
        "e5a_health": health >> 4 & 3,
        "e5b_invalid": health >> 6 & 1,
        "e5b_health": health >> 7 & 3,
    }


def _galileo_week(time_ns):
    return (time_ns // NS_PER_WEEK - bits.GALILEO_WEEK) % 4096, time_ns % NS_PER_WEEK // NS_PER_S


def _inav(navigation, row, start_ns):
    frames = dict(zip(range(1, 6), _inav_body(navigation, row), strict=True))
    # Word 5 comes 24 s after the start of the subframe of 30 s.
    week, tow_s = _galileo_week(start_ns + 24 * NS_PER_S)
    insert(frames, bits.INAV_FIELDS["week"], bits.INAV_BITS, week)
    insert(frames, bits.INAV_FIELDS["tow_s"], bits.INAV_BITS, tow_s)
    return tuple(inav_words(frames[k]) for k in (2, 4, 1, 3, 5))


@_once
def _inav_body(navigation, row):
    frames = dict.fromkeys(range(1, 6), 0)
    for number in frames:
        insert(frames, _at(number, 0, 6), bits.INAV_BITS, number)
    values = _galileo_values(navigation.kepler, row)
    _insert_all(frames, _without(bits.INAV_FIELDS, "week", "tow_s"), bits.INAV_BITS, values)
    if navigation.nequick is not None:
        for field, value in zip(bits.INAV_NEQUICK, navigation.nequick, strict=True):
            insert(frames, field, bits.INAV_BITS, float(value))
    return tuple(frames.values())


# Week and second of week, which every page repeats for its own time: page, first bit.
_FNAV_TIMES = ((1, 155), (2, 182), (3, 174), (4, 189))


def _fnav(navigation, row, start_ns):
    frames = dict(zip(range(1, 5), _fnav_body(navigation, row), strict=True))
    for number, first in _FNAV_TIMES:
        week, tow_s = _galileo_week(start_ns + 10 * (number - 1) * NS_PER_S)
        if number < 4:
            insert(frames, _at(number, first, 12), bits.FNAV_BITS, week)
            first += 12
        insert(frames, _at(number, first, 20), bits.FNAV_BITS, tow_s)
    return tuple(fnav_words(frame) for frame in frames.values())


@_once
def _fnav_body(navigation, row):
    frames = dict.fromkeys(range(1, 5), 0)
    for number in frames:
        insert(frames, _at(number, 0, 6), bits.FNAV_BITS, number)
    values = _galileo_values(navigation.kepler, row)
    _insert_all(frames, _without(bits.FNAV_FIELDS, "week", "tow_s"), bits.FNAV_BITS, values)
    if navigation.nequick is not None:
        for field, value in zip(bits.FNAV_NEQUICK, navigation.nequick, strict=True):
            insert(frames, field, bits.FNAV_BITS, float(value))
    return tuple(frames.values())


def is_geostationary(sat):
    """Whether a satellite is a geostationary one of BeiDou and so sends D2 (ICD B1I 3.0, 5.1.1)."""
    return sat // 100 == BEIDOU and (sat % 100 <= 5 or sat % 100 >= 59)


def _beidou(navigation, row, start_ns):
    body = _beidou_body(navigation, row)
    is_d2 = len(body) == 10
    frames = dict(enumerate(body, start=1))
    start_ns -= BDT_OFFSET_NS
    for number in frames:
        sow = (start_ns // NS_PER_S + (3 if is_d2 else 6) * (number - 1)) % 604_800
        insert(frames, _at(number, 18, 20), bits.D1_BITS, sow)
    week = (bits.D2_FIELDS if is_d2 else bits.D1_FIELDS)["week"]
    insert(frames, week, bits.D1_BITS, start_ns // NS_PER_WEEK - bits.BEIDOU_WEEK)
    return tuple(beidou_words(frame) for frame in frames.values())


@_once
def _beidou_body(navigation, row):
    eph = navigation.kepler
    toe_ns, toc_ns = int(eph.toe_ns[row]) - BDT_OFFSET_NS, int(eph.toc_ns[row]) - BDT_OFFSET_NS
    values = _elements(eph, row)
    values |= {
        "ura_index": _ura_index(values["ura_m"]),
        "health": int(eph.health[row] != 0),
        "iodc": int(eph.iodc[row]) & 0x1F,
        "iode": int(eph.iode[row]) & 0x1F,
        "toe_s": _exact(toe_ns % NS_PER_WEEK, 8, "toe"),
        "toc_s": _exact(toc_ns % NS_PER_WEEK, 8, "toc"),
    }
    is_d2 = is_geostationary(int(eph.sat[row]))
    fields, ionosphere = (bits.D2_FIELDS, bits.D2_KLOBUCHAR) if is_d2 else (bits.D1_FIELDS, bits.D1_KLOBUCHAR)
    frames = dict.fromkeys(range(1, 11 if is_d2 else 4), 0)
    for number in frames:
        insert(frames, _at(number, 0, 11), bits.D1_BITS, 0x712)
        insert(frames, _at(number, 15, 3), bits.D1_BITS, 1 if is_d2 else number)
        if is_d2:
            insert(frames, _at(number, 38, 4), bits.D2_BITS, number)
    _insert_all(frames, _without(fields, "week"), bits.D1_BITS, values)
    if "C" in navigation.klobuchar:
        for field, value in zip(ionosphere, navigation.klobuchar["C"], strict=True):
            insert(frames, field, bits.D1_BITS, float(value))
    return tuple(frames.values())


# What the fields of GLONASS_FIELDS do not hold: half hours between reference times, a GLONASS-M satellite.
_GLONASS_INTERVAL, _GLONASS_DAY = _at(1, 7, 2), _at(4, 59, 11)
_GLONASS_SLOT, _GLONASS_KIND = _at(4, 70, 5), _at(4, 75, 2)


def _glonass(navigation, row, start_ns):
    frames = dict(zip((1, 2, 3, 4), _glonass_body(navigation.states, row), strict=True))
    moscow_ns = _moscow_ns(start_ns)
    second_of_day = moscow_ns % NS_PER_DAY // NS_PER_S
    hours, minutes, halves = second_of_day // 3600, second_of_day // 60 % 60, second_of_day // 30 % 2
    frame_time = hours << 7 | minutes << 1 | halves
    insert(frames, bits.GLONASS_FIELDS["frame_time"], bits.GLONASS_BITS, frame_time)
    insert(frames, _GLONASS_DAY, bits.GLONASS_BITS, _day_of_four_years(moscow_ns))
    superframe, frame = second_of_day // 150, second_of_day // 30 % 5 + 1
    return tuple(glonass_words(string, superframe, frame) for string in frames.values())


def _moscow_ns(gpst_ns):
    return gpst_ns - _leap_at(gpst_ns) * NS_PER_S + _MOSCOW_NS


@_once
def _glonass_body(eph, row):
    sat, health = int(eph.sat[row]), int(eph.health[row])
    if sat // 100 != GLONASS:
        raise ValueError("messages of SBAS are not written")
    toe_s = _exact(_moscow_ns(int(eph.toe_ns[row])) % NS_PER_DAY, 900, "toe")
    if toe_s == 0:
        raise ValueError("GLONASS has no reference time at midnight of Moscow")
    values = dict(zip(STATE_COLUMNS, eph.states[row].tolist(), strict=True))
    values |= {"tb_s": toe_s, "health": 4 if health & ~2 else 0, "unhealthy": health >> 1 & 1}
    if math.isnan(values["delta_tau_s"]):
        values["delta_tau_s"] = 0.0
    frames = dict.fromkeys((1, 2, 3, 4), 0)
    for number in frames:
        insert(frames, _at(number, 1, 4), bits.GLONASS_BITS, number)
    _insert_all(frames, _without(bits.GLONASS_FIELDS, "frame_time"), bits.GLONASS_BITS, values)
    insert(frames, _GLONASS_INTERVAL, bits.GLONASS_BITS, 1)
    insert(frames, _GLONASS_SLOT, bits.GLONASS_BITS, sat % 100)
    insert(frames, _GLONASS_KIND, bits.GLONASS_BITS, 1)
    return tuple(frames.values())


def _day_of_four_years(moscow_ns):
    """Day from 1 on since the first of January of the last leap year (ICD 5.1, table 4.6)."""
    day = gpst_to_datetime64(moscow_ns // NS_PER_DAY * NS_PER_DAY).astype("M8[D]")
    year = int(day.astype("M8[Y]").astype(np.int64)) + 1970
    return int((day - np.datetime64(f"{year - year % 4}-01-01")).astype(np.int64)) + 1


_FIELDS_OF_MESSAGE = {
    MessageType.LNAV: bits.LNAV_FIELDS,
    MessageType.INAV: bits.INAV_FIELDS,
    MessageType.FNAV: bits.FNAV_FIELDS,
    MessageType.D1: bits.D1_FIELDS,
    MessageType.D2: bits.D2_FIELDS,
}
_KLOBUCHAR_FIELDS = {"G": bits.LNAV_KLOBUCHAR, "J": bits.LNAV_KLOBUCHAR, "C": bits.D1_KLOBUCHAR}


def as_broadcast(navigation):
    """Ephemerides as their messages carry them: every value a whole number of its least bit.

    Such data are the same in a navigation file and in the bits of a receiver's log. The steps are real:
    half a metre in the position of a GLONASS satellite, 4 cm along the orbit of a GPS satellite, 0.5 ns in
    its clock.

    Parameters
    ----------
    navigation : Navigation
        Any values; those of messages that are not written here stay as they are.

    Returns
    -------
    Navigation
    """
    kepler, states = navigation.kepler, navigation.states
    elements, vectors = kepler.elements.copy(), states.states.copy()
    for message, fields in _FIELDS_OF_MESSAGE.items():
        rows = kepler.message == message
        for column, name in enumerate(KEPLER_COLUMNS):
            if name in fields:
                elements[rows, column] = _rounded(elements[rows, column], fields[name], name in _ANGLES)
    is_glonass = states.sat // 100 == GLONASS
    for column, name in enumerate(STATE_COLUMNS):
        vectors[is_glonass, column] = _rounded(vectors[is_glonass, column], bits.GLONASS_FIELDS[name], False)
    klobuchar = {
        letter: np.array([_rounded(v, f, False) for v, f in zip(values, fields, strict=True)])
        if (fields := _KLOBUCHAR_FIELDS.get(letter))
        else values
        for letter, values in navigation.klobuchar.items()
    }
    return replace(
        navigation,
        kepler=replace(kepler, elements=elements),
        states=replace(states, states=vectors),
        klobuchar=klobuchar,
    )


def _rounded(values, field, is_angle):
    steps = np.round(values / field.scale)
    if is_angle:
        half = 2.0 ** (sum(count for _, _, count in field.runs) - 1)
        steps = (steps + half) % (2.0 * half) - half
    return steps * field.scale


def _ura_index(ura_m):
    """Index of the closest nominal accuracy; 15 where there is no statement."""
    return _closest(ura_m, tuple(bits.ura_m(k) for k in range(15)), 15)


def _sisa_index(ura_m):
    return _closest(ura_m, tuple(bits.sisa_m(k) for k in range(126)), 255)


def _closest(value, known, none):
    if not math.isfinite(value) or value < 0.0:
        return none
    return min(range(len(known)), key=lambda k: abs(known[k] - value))
