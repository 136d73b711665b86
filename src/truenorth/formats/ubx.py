"""u-blox logs in the UBX protocol: raw measurements and broadcast navigation bits.

A frame is ``B5 62, class, identity, length (2), payload, checksum (2)``, with NMEA sentences, RTCM 3
messages or lost bytes between frames. The checksum is Fletcher's over the bytes x_1 ... x_n from the
class to the end of the payload,

    A = sum of x_k,   B = sum of (n + 1 - k) x_k,   both modulo 256,

so two running sums over the whole file give the checksum of every possible frame at once, and every
intact frame is found even where a log has lost bytes: a cut frame never hides the one after it. (A
reader that trusts the length of a cut frame loses what follows: pyubx2 1.4 finds 15 of the 321
measurement messages in the base log of the 0.33 m pair and then stops at a byte that it takes for text.)

Messages used: RXM-RAWX and the older RXM-RAW (measurements), RXM-SFRBX (navigation bits), NAV-SOL,
NAV-POSECEF and NAV-PVT (approximate position), MON-VER (receiver).

- The carrier phase of u-blox grows with range and is in cycles, its Doppler is positive for
  approaching satellites: both as RINEX. Time tags are kept as they are, to the nanosecond.
- A slip is flagged when the lock counter is zero, has decreased, or is shorter than the time since the
  previous phase of the signal, and when the half-cycle correction changed. The counter stops at 64.5 s,
  so a phase after a longer gap is always flagged.

References: u-blox, "ZED-F9P interface description" UBX-18010854, and "u-blox 8 / M8 receiver
description including protocol specification" UBX-13003221.
"""

import numpy as np

from ..constants import BEIDOU, GALILEO, GLONASS, GPS, NAVIC, QZSS, SBAS
from ..errors import FormatError
from ..frames import ecef_from_geodetic
from ..observations import (
    LLI_HALF_CYCLE,
    LLI_SLIP,
    NO_CHANNEL,
    ObservationMeta,
    Observations,
    signal_id,
)
from ..timescales import NS_PER_S, NS_PER_WEEK, format_gpst
from .compression import read_bytes
from .navigation_bits import BroadcastDecoder

__all__ = ["crc24q", "find_frames", "inav_word", "parse_ubx", "read_ubx"]

FORMAT = "ubx"

_SYNC = (0xB5, 0x62)
_OVERHEAD = 8
RXM_RAWX, RXM_RAW, RXM_SFRBX = 0x0215, 0x0210, 0x0213
MON_VER, NAV_SOL, NAV_POSECEF, NAV_PVT = 0x0A04, 0x0106, 0x0101, 0x0107
_NAMES = {
    0x0101: "NAV-POSECEF",
    0x0102: "NAV-POSLLH",
    0x0103: "NAV-STATUS",
    0x0104: "NAV-DOP",
    0x0106: "NAV-SOL",
    0x0107: "NAV-PVT",
    0x0111: "NAV-VELECEF",
    0x0120: "NAV-TIMEGPS",
    0x0130: "NAV-SVINFO",
    0x0135: "NAV-SAT",
    0x013C: "NAV-RELPOSNED",
    0x0210: "RXM-RAW",
    0x0213: "RXM-SFRBX",
    0x0215: "RXM-RAWX",
    0x0232: "RXM-RTCM",
    0x0A04: "MON-VER",
}

_EPOCH = np.dtype(
    [("tow", "<f8"), ("week", "<u2"), ("leap", "i1"), ("n", "u1"), ("status", "u1"), ("version", "u1"),
     ("reserved", "u1", 2)]
)  # fmt: skip
MEASUREMENT = np.dtype(
    [("code", "<f8"), ("phase", "<f8"), ("doppler", "<f4"), ("gnss", "u1"), ("sv", "u1"), ("sig", "u1"),
     ("freq", "u1"), ("lock_ms", "<u2"), ("cn0", "u1"), ("code_sd", "u1"), ("phase_sd", "u1"),
     ("doppler_sd", "u1"), ("track", "u1"), ("reserved", "u1")]
)  # fmt: skip
_OLD_EPOCH = np.dtype([("tow_ms", "<i4"), ("week", "<i2"), ("n", "u1"), ("reserved", "u1")])
_OLD_MEASUREMENT = np.dtype(
    [("phase", "<f8"), ("code", "<f8"), ("doppler", "<f4"), ("sv", "u1"), ("quality", "i1"), ("cn0", "i1"),
     ("lli", "u1")]
)  # fmt: skip

_LEAP_KNOWN = 1
_CODE_VALID, _PHASE_VALID, _HALF_RESOLVED, _HALF_SUBTRACTED = 1, 2, 4, 8
_NO_COUNTER_MS = 1 << 50  # longer than any gap: RXM-RAW flags slips itself
_WEEK_LIMIT = 8_192

# gnssId: our system, range of svId, what to subtract to get the satellite number.
SYSTEM_OF_GNSS = {
    0: (GPS, 1, 32, 0),
    1: (SBAS, 120, 158, 100),
    2: (GALILEO, 1, 36, 0),
    3: (BEIDOU, 1, 63, 0),
    5: (QZSS, 1, 10, 0),
    6: (GLONASS, 1, 32, 0),
    7: (NAVIC, 1, 14, 0),
}
# sigId of each gnssId, ZED-F9P interface description 1.5.4 and its successors.
SIGNALS = {
    0: {0: "1C", 3: "2L", 4: "2S", 6: "5I", 7: "5Q"},
    1: {0: "1C"},
    2: {0: "1C", 1: "1B", 3: "5I", 4: "5Q", 5: "7I", 6: "7Q", 8: "6B", 9: "6C", 10: "6A"},
    3: {0: "2I", 1: "2I", 2: "7I", 3: "7I", 4: "6I", 5: "1P", 6: "1D", 7: "5P", 8: "5D", 10: "6I"},
    5: {0: "1C", 1: "1Z", 4: "2S", 5: "2L", 8: "5I", 9: "5Q", 12: "1E"},
    6: {0: "1C", 2: "2C"},
    7: {0: "5A"},
}


def _lookup_tables():
    sat = np.full((256, 256), -1, dtype=np.int16)
    signal = np.full((256, 256), -1, dtype=np.int16)
    for gnss, (system, first, last, offset) in SYSTEM_OF_GNSS.items():
        numbers = np.arange(first, last + 1)
        sat[gnss, numbers] = 100 * system + numbers - offset
    for gnss, names in SIGNALS.items():
        for sig, name in names.items():
            signal[gnss, sig] = signal_id(name)
    return sat, signal


_SAT, _SIGNAL = _lookup_tables()

_WHAT_TO_ENABLE = "enable UBX-RXM-RAWX and UBX-RXM-SFRBX in the receiver and record again"


def read_ubx(path):
    """Read a u-blox log.

    Parameters
    ----------
    path : str or os.PathLike
        The log, plain or compressed. NMEA and RTCM 3 in between are passed over.

    Returns
    -------
    observations : Observations
        All measurements, in time order. What could not be used is counted in ``meta.warnings``.
    navigation : Navigation
        Ephemerides assembled from the broadcast bits; empty where the log has none.

    Raises
    ------
    FormatError
        If the file cannot be opened, is no UBX log, or holds no raw measurements.
    """
    return parse_ubx(read_bytes(path), path=path)


def parse_ubx(data, *, path=""):
    """Read a u-blox log that is already in memory.

    Parameters
    ----------
    data : bytes
        The log.
    path : str or os.PathLike, optional
        Name of the file for messages and metadata.

    Returns
    -------
    observations : Observations
    navigation : Navigation

    Raises
    ------
    FormatError
        As `read_ubx`.
    """
    buffer = np.frombuffer(data, dtype=np.uint8)
    offset, length, kind, n_damaged = find_frames(buffer)
    place = path or None
    if len(offset) == 0:
        raise FormatError(
            f"no intact UBX message was found in {len(buffer)} bytes; give a log of a u-blox receiver",
            path=place,
            byte_offset=0,
        )
    warnings = []
    if n_damaged:
        warnings.append(f"{n_damaged} UBX messages are cut off or have a wrong checksum; they are left out")
    epochs, rows = _measurements(buffer, offset, length, kind, warnings)
    if len(epochs["time_ns"]) == 0:
        found = [_NAMES.get(k, f"{k >> 8:02X}-{k & 255:02X}") for k in np.unique(kind).tolist()]
        if RXM_RAWX in kind or RXM_RAW in kind:
            raise FormatError(
                "the raw measurements of this log have no valid time: the receiver never had a position; "
                "record longer, with the antenna under open sky",
                path=place,
                byte_offset=int(offset[(kind == RXM_RAWX) | (kind == RXM_RAW)][0]),
            )
        raise FormatError(
            f"the log holds {len(offset)} UBX messages ({', '.join(found[:8])}"
            f"{', ...' if len(found) > 8 else ''}) but no raw measurements; {_WHAT_TO_ENABLE}",
            path=place,
            byte_offset=len(buffer),
        )
    navigation = _navigation(buffer, offset, length, kind, epochs, str(path))
    if RXM_SFRBX not in kind:
        warnings.append(
            "the log holds no UBX-RXM-SFRBX, so no ephemerides; give a navigation file or enable the message"
        )
    receiver_type, firmware = _receiver(buffer, offset, length, kind)
    epochs, rows = _sort(epochs, rows, warnings)
    time_ns = epochs["time_ns"]
    lli = _flags(rows, time_ns)
    observations = Observations(
        time_ns=time_ns,
        epoch_start=np.searchsorted(rows["epoch"], np.arange(len(time_ns) + 1)).astype(np.int64),
        sat=rows["sat"],
        signal=rows["signal"],
        code_m=rows["code_m"],
        phase_cyc=rows["phase_cyc"],
        doppler_hz=rows["doppler_hz"],
        cn0_dbhz=rows["cn0_dbhz"],
        lli=lli,
        clock_offset_s=np.full(len(time_ns), np.nan),
        glonass_channel=_channels(rows),
        meta=ObservationMeta(
            path=str(path),
            format=FORMAT,
            receiver_type=receiver_type,
            receiver_firmware=firmware,
            approx_position_ecef_m=_position(buffer, offset, length, kind),
            interval_s=_interval_s(time_ns),
            leap_seconds=_last_leap(epochs),
            warnings=tuple(warnings),
        ),
    )
    return observations, navigation


def find_frames(buffer):
    """Find every intact UBX frame.

    Parameters
    ----------
    buffer : ndarray of uint8, shape (n,)
        The log.

    Returns
    -------
    offset : ndarray of int64, shape (m,)
        Byte of the first sync character of each frame, increasing; frames do not overlap.
    length : ndarray of int64, shape (m,)
        Bytes of payload.
    kind : ndarray of int64, shape (m,)
        ``256 * class + identity``.
    n_damaged : int
        Headers outside of intact frames.
    """
    n = len(buffer)
    start = np.flatnonzero((buffer[:-1] == _SYNC[0]) & (buffer[1:] == _SYNC[1])).astype(np.int64)
    complete = start[start + _OVERHEAD <= n]
    length = buffer[complete + 4] + 256 * buffer[complete + 5].astype(np.int64)
    end = complete + 6 + length
    whole = end + 2 <= n
    complete, length, end = complete[whole], length[whole], end[whole]
    # Sums of x_k and k x_k before every byte; bytes wrap, and modulo 256 is all that is asked.
    plain, weighted = np.zeros(n + 1, dtype=np.uint8), np.zeros(n + 1, dtype=np.uint8)
    np.cumsum(buffer, dtype=np.uint8, out=plain[1:])
    np.cumsum(np.arange(n).astype(np.uint8) * buffer, dtype=np.uint8, out=weighted[1:])
    first = complete + 2
    sum_a = plain[end] - plain[first]
    sum_b = end.astype(np.uint8) * sum_a - (weighted[end] - weighted[first])
    intact = (sum_a == buffer[end]) & (sum_b == buffer[end + 1])
    complete, length, end = complete[intact], length[intact], end[intact]
    # A payload may happen to hold what looks like a frame: the outer one counts.
    keep = np.ones(len(complete), dtype=bool)
    reach = np.maximum.accumulate(end + 2) if len(end) else end
    if np.any(complete[1:] < reach[:-1]):
        free_from = 0
        for k, (begin, stop) in enumerate(zip(complete.tolist(), end.tolist(), strict=True)):
            keep[k] = begin >= free_from
            if keep[k]:
                free_from = stop + 2
    complete, length, end = complete[keep], length[keep], end[keep]
    # Headers inside intact frames are payload, not damage.
    owner = np.searchsorted(complete, start, side="right") - 1
    inside = np.zeros(len(start), dtype=bool)
    if len(complete):
        inside = (owner >= 0) & (start < end[owner] + 2)
    kind = 256 * buffer[complete + 2].astype(np.int64) + buffer[complete + 3]
    return complete, length, kind, int(np.sum(~inside))


def _records(buffer, offset, dtype):
    """One structured record at each offset."""
    if len(offset) == 0:
        return np.zeros(0, dtype=dtype)
    windows = np.lib.stride_tricks.sliding_window_view(buffer, dtype.itemsize)
    return np.ascontiguousarray(windows[offset]).view(dtype)[:, 0]


def _measurements(buffer, offset, length, kind, warnings):
    """Epochs and rows of all measurement messages in file order; rows name their epoch by index."""
    chosen = (kind == RXM_RAWX) & (length >= _EPOCH.itemsize)
    old = False
    if not np.any(chosen):
        chosen = (kind == RXM_RAW) & (length >= _OLD_EPOCH.itemsize)
        old = bool(np.any(chosen))
    epoch_dtype, row_dtype = (_OLD_EPOCH, _OLD_MEASUREMENT) if old else (_EPOCH, MEASUREMENT)
    at = offset[chosen]
    head = _records(buffer, at + 6, epoch_dtype)
    tow_s = head["tow_ms"] / 1000.0 if old else head["tow"]
    count = head["n"].astype(np.int64)
    fits = length[chosen] == epoch_dtype.itemsize + row_dtype.itemsize * count
    in_time = np.isfinite(tow_s) & (tow_s >= 0.0) & (tow_s < 604_801.0)
    in_time &= (head["week"] > 0) & (head["week"] < _WEEK_LIMIT)
    for bad, why in ((~fits, "whose length contradicts the number of satellites"),
                     (fits & ~in_time, "from before the receiver knew the time")):  # fmt: skip
        if np.any(bad):
            warnings.append(f"{int(np.sum(bad))} measurement messages {why}; they are left out")
    good = fits & in_time
    at, head, count, tow_s = at[good], head[good], count[good], tow_s[good]
    week = head["week"].astype(np.int64)
    if old:
        week = _unroll_old_week(week)
    epochs = {
        "time_ns": week * NS_PER_WEEK + np.rint(tow_s * NS_PER_S).astype(np.int64),
        "offset": at,
        "leap": np.where(head["status"] & _LEAP_KNOWN, head["leap"], -1) if not old else np.full(len(at), -1),
    }
    epoch = np.repeat(np.arange(len(at)), count)
    within = np.arange(len(epoch)) - np.repeat(np.cumsum(count) - count, count)
    record = _records(buffer, at[epoch] + 6 + epoch_dtype.itemsize + within * row_dtype.itemsize, row_dtype)
    rows = _old_rows(record) if old else _rows(record, head["version"][epoch])
    rows["epoch"] = epoch
    known = (rows["sat"] >= 0) & (rows["signal"] >= 0)
    if not np.all(known):
        warnings.append(f"{int(np.sum(~known))} measurements of unknown satellites or signals are left out")
        rows = {name: column[known] for name, column in rows.items()}
    return epochs, rows


def _rows(record, version):
    # Version 0 (M8) has no signal identity: every signal is the first one of its system.
    sig = np.where(version == 0, 0, record["sig"])
    track = record["track"]

    def valid(values, ok):
        with np.errstate(invalid="ignore"):
            return np.where(ok & np.isfinite(values) & (np.abs(values) < 1e12), values, np.nan)

    return {
        "sat": _SAT[record["gnss"], record["sv"]],
        "signal": _SIGNAL[record["gnss"], sig],
        "code_m": valid(record["code"], (track & _CODE_VALID) != 0),
        "phase_cyc": valid(record["phase"], (track & _PHASE_VALID) != 0),
        "doppler_hz": valid(record["doppler"].astype(float), True),
        "cn0_dbhz": np.where(record["cn0"] > 0, record["cn0"].astype(float), np.nan),
        "lock_ms": record["lock_ms"].astype(np.int64),
        "half_unresolved": (track & _HALF_RESOLVED) == 0,
        "half_subtracted": (track & _HALF_SUBTRACTED) != 0,
        "slip": np.zeros(len(record), dtype=bool),
        "channel": record["freq"].astype(np.int64) - 7,
    }


def _old_rows(record):
    """Rows of RXM-RAW: GPS and SBAS L1 with a RINEX loss-of-lock byte instead of counters."""
    number = record["sv"].astype(np.int64)
    gnss = np.where(number >= 120, 1, 0)
    # Quality 4: code and Doppler; 6 and 7: phase too (u-blox 6 protocol specification, RXM-RAW).
    track = np.where(record["quality"] >= 4, _CODE_VALID, 0)
    track |= np.where(record["quality"] >= 6, _PHASE_VALID, 0)
    modern = np.zeros(len(record), dtype=MEASUREMENT)
    for name in ("code", "phase", "doppler", "sv"):
        modern[name] = record[name]
    modern["gnss"] = gnss
    modern["cn0"] = np.maximum(record["cn0"], 0)
    modern["track"] = track | np.where(record["lli"] & 2, 0, _HALF_RESOLVED)
    rows = _rows(modern, np.ones(len(record)))
    rows["lock_ms"][:] = _NO_COUNTER_MS
    rows["slip"] = (record["lli"] & 1) != 0
    return rows


def _unroll_old_week(week):
    """RXM-RAW counts weeks as the receiver knows them; below 1024 they are taken after the 1999 rollover."""
    return np.where(week < 1024, week + 1024, week)


def _sort(epochs, rows, warnings):
    """Bring epochs into strictly increasing time and rows into (epoch, satellite, signal) order."""
    time_ns = epochs["time_ns"]
    if np.any(np.diff(time_ns) <= 0):
        backward = np.flatnonzero(np.diff(time_ns) <= 0)
        _, first = np.unique(time_ns, return_index=True)
        n_repeated = len(time_ns) - len(first)
        warnings.append(
            f"time goes back or repeats at {len(backward)} places (first: "
            f"{format_gpst(time_ns[backward[0] + 1])} GPST); the epochs are sorted and {n_repeated} repeated "
            "ones left out"
        )
        new_index = np.full(len(time_ns), -1)
        new_index[first] = np.arange(len(first))
        epochs = {name: column[first] for name, column in epochs.items()}
        rows = {**rows, "epoch": new_index[rows["epoch"]]}
        rows = {name: column[rows["epoch"] >= 0] for name, column in rows.items()}
    order = np.lexsort((rows["signal"], rows["sat"], rows["epoch"]))
    rows = {name: column[order] for name, column in rows.items()}
    repeated = np.zeros(len(order), dtype=bool)
    repeated[1:] = (
        (np.diff(rows["epoch"]) == 0) & (np.diff(rows["sat"]) == 0) & (np.diff(rows["signal"]) == 0)
    )
    if np.any(repeated):
        warnings.append(
            f"{int(np.sum(repeated))} measurements repeat a signal within their epoch; the first one is kept"
        )
        rows = {name: column[~repeated] for name, column in rows.items()}
    return epochs, rows


def _flags(rows, time_ns):
    """Loss-of-lock bits of sorted rows, from the lock counters and the half-cycle states."""
    lli = np.zeros(len(rows["sat"]), dtype=np.uint8)
    order = np.lexsort((rows["epoch"], rows["signal"], rows["sat"]))
    order = order[np.isfinite(rows["phase_cyc"][order])]
    sat, signal, lock_ms = rows["sat"][order], rows["signal"][order], rows["lock_ms"][order]
    # Exact to the millisecond of the counter: a lock as old as the previous epoch has not been lost since.
    when_ms = time_ns[rows["epoch"][order]] // 1_000_000
    slip = (lock_ms == 0) | rows["slip"][order]
    same = (np.diff(sat) == 0) & (np.diff(signal) == 0)
    lost = (np.diff(lock_ms) < 0) | (lock_ms[1:] < np.diff(when_ms))
    lost |= np.diff(rows["half_subtracted"][order].astype(np.int8)) != 0
    slip[1:] |= same & lost
    lli[order[slip]] |= LLI_SLIP
    lli[order[rows["half_unresolved"][order]]] |= LLI_HALF_CYCLE
    return lli


def _channels(rows):
    table = np.full(100, NO_CHANNEL, dtype=np.int8)
    glonass = (rows["sat"] // 100 == GLONASS) & (np.abs(rows["channel"]) <= 7)
    table[rows["sat"][glonass] % 100] = rows["channel"][glonass]
    return table


def _interval_s(time_ns):
    """Most frequent step between epochs, to the hundredth of a second; None for a single epoch."""
    if len(time_ns) < 2:
        return None
    step, times = np.unique(np.rint(np.diff(time_ns) / 1e7).astype(np.int64), return_counts=True)
    return max(float(step[np.argmax(times)]) / 100.0, 0.01)


def _last_leap(epochs):
    known = epochs["leap"][epochs["leap"] >= 0]
    return int(known[-1]) if len(known) else None


def _navigation(buffer, offset, length, kind, epochs, path):
    """Feed all navigation bits of the log to the decoder, each with the time of the epoch before it."""
    chosen = (kind == RXM_SFRBX) & (length >= 8)
    decoder = BroadcastDecoder()
    at, size = offset[chosen], length[chosen]
    index = np.maximum(np.searchsorted(epochs["offset"], at) - 1, 0)
    near_ns = epochs["time_ns"][index].tolist()
    for begin, n_bytes, near in zip((at + 6).tolist(), size.tolist(), near_ns, strict=True):
        gnss, sv, sig, freq, n_words, _, version, _ = buffer[begin : begin + 8].tolist()
        sat = int(_SAT[gnss, sv])
        if n_bytes != 8 + 4 * n_words or sat < 0:
            decoder.skip("SFRBX of unknown form")
            continue
        words = buffer[begin + 8 : begin + n_bytes].view("<u4").tolist()
        _add_subframe(decoder, sat, gnss, sig if version >= 2 else 0, freq, words, near)
    if decoder.leap_seconds is None:
        decoder.leap_seconds = _last_leap(epochs)
    return decoder.build(paths=(path,) if path else ())


def _add_subframe(decoder, sat, gnss, sig, freq, words, near_ns):
    n_words = len(words)
    if gnss in (0, 5) and sig == 0 and n_words >= 10:
        decoder.add_lnav(sat, _join(words[:10], 24, 6), near_ns)
    elif gnss == 2 and sig in (0, 1, 5) and n_words >= 8:
        word = inav_word(_join(words[:8], 32, 0))
        if word is None:
            decoder.skip("I/NAV page")
        else:
            decoder.add_inav(sat, word, near_ns)
    elif gnss == 2 and sig == 3 and n_words >= 8:
        page = _join(words[:8], 32, 0)
        # 214 bits, 24 of checksum, 6 of tail, 12 of padding.
        if crc24q(page >> 42) != page >> 18 & 0xFFFFFF:
            decoder.skip("F/NAV page")
        else:
            decoder.add_fnav(sat, page >> 42, near_ns)
    elif gnss == 3 and sig in (0, 1, 2, 3, 4, 10) and n_words >= 10:
        bits = (words[0] >> 4 & 0x3FFFFFF) << 198 | _join(words[1:10], 22, 8)
        # An M8 tells D1 from D2 only by the satellite: 1-5 and 59-63 are geostationary.
        number = sat % 100
        if sig in (1, 3, 10) or (sig == 0 and (number <= 5 or number >= 59)):
            decoder.add_d2(sat, bits, near_ns)
        else:
            decoder.add_d1(sat, bits, near_ns)
    elif gnss == 6 and n_words >= 4:
        bits = _join(words[:3], 32, 0) >> 11
        decoder.add_glonass_string(sat, bits, near_ns, channel=freq - 7, frame=words[3])
    else:
        names = {0: "GPS", 1: "SBAS", 2: "Galileo", 3: "BeiDou", 5: "QZSS", 6: "GLONASS", 7: "NavIC"}
        decoder.skip(f"{names[gnss]} signal {sig}")


def _join(words, n_bits, shift):
    """Concatenate `n_bits` of every word, which stand `shift` bits above its end."""
    value = 0
    mask = (1 << n_bits) - 1
    for word in words:
        value = value << n_bits | (word >> shift & mask)
    return value


def inav_word(pages):
    """Take the 128-bit word out of an even and an odd I/NAV page part.

    Parameters
    ----------
    pages : int
        256 bits: even part of 120 bits, 8 of padding, odd part of 120 bits, 8 of padding.

    Returns
    -------
    int or None
        The word; None when the parts are not an even and an odd one of a nominal page, or the
        checksum over both (Galileo OS SIS ICD 2.1, 4.3.2.3 and 5.1.9.4) is wrong.
    """
    even, odd = pages >> 142, pages & ((1 << 128) - 1)  # 114 bits before the tail; 128 bits
    if even >> 112 != 0b00 or odd >> 126 != 0b10:
        return None
    protected = even << 82 | odd >> 46
    if crc24q(protected) != odd >> 22 & 0xFFFFFF:
        return None
    return (even & ((1 << 112) - 1)) << 16 | (odd >> 110 & 0xFFFF)


def _crc_table():
    table = []
    for byte in range(256):
        crc = byte << 16
        for _ in range(8):
            crc = crc << 1 ^ (0x1864CFB if crc & 0x800000 else 0)
        table.append(crc & 0xFFFFFF)
    return table


_CRC_TABLE = _crc_table()


def crc24q(value):
    """CRC-24Q of a number taken as a string of bits; leading zeros change nothing."""
    crc = 0
    for byte in value.to_bytes((value.bit_length() + 7) // 8, "big"):
        crc = (crc << 8 & 0xFFFFFF) ^ _CRC_TABLE[crc >> 16 ^ byte]
    return crc


def _position(buffer, offset, length, kind):
    """Median of the receiver's own positions, ECEF metres; None where the log has none."""
    at = offset[(kind == NAV_SOL) & (length >= 52)] + 6
    if len(at):
        fix = _records(buffer, at + 10, np.dtype([("fix", "u1"), ("flags", "u1"), ("ecef_cm", "<i4", 3)]))
        position_m = fix["ecef_cm"][(fix["fix"] == 3) | (fix["fix"] == 4)] / 100.0
        if len(position_m):
            return tuple(np.median(position_m, axis=0).tolist())
    at = offset[(kind == NAV_POSECEF) & (length >= 20)] + 6
    if len(at):
        position_m = _records(buffer, at + 4, np.dtype([("ecef_cm", "<i4", 3)]))["ecef_cm"] / 100.0
        position_m = position_m[np.linalg.norm(position_m, axis=1) > 6e6]
        if len(position_m):
            return tuple(np.median(position_m, axis=0).tolist())
    at = offset[(kind == NAV_PVT) & (length >= 84)] + 6
    fix_type = buffer[at + 20]
    at = at[(fix_type == 3) | (fix_type == 4)]
    if len(at):
        point = _records(buffer, at + 24, np.dtype([("lon", "<i4"), ("lat", "<i4"), ("height_mm", "<i4")]))
        position_m = ecef_from_geodetic(
            np.deg2rad(point["lat"] * 1e-7), np.deg2rad(point["lon"] * 1e-7), point["height_mm"] * 1e-3
        )
        return tuple(np.median(position_m, axis=0).tolist())
    return None


def _receiver(buffer, offset, length, kind):
    """Type and firmware from the last MON-VER."""
    chosen = np.flatnonzero((kind == MON_VER) & (length >= 40))
    if len(chosen) == 0:
        return "", ""
    begin = int(offset[chosen[-1]]) + 6
    payload = buffer[begin : begin + int(length[chosen[-1]])].tobytes()

    def text(raw):
        return raw.split(b"\0")[0].decode("ascii", "replace").strip()

    extensions = dict(text(payload[k : k + 30]).partition("=")[::2] for k in range(40, len(payload) - 29, 30))
    hardware = f"u-blox {text(payload[30:40])}"
    return extensions.get("MOD", hardware), extensions.get("FWVER", text(payload[:30]))
