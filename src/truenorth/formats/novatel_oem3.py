"""NovAtel OEM3 logs (MiLLennium and its generation): ranges RGEB and RGED, ephemerides REPB and IONB.

A message is ``AA 44 11, checksum, identity (4), byte count (4), data``, little-endian. The count includes
the twelve bytes of the header, and the exclusive or of all bytes of the message is zero. ASCII logs and
lost bytes may stand between messages; every intact message is found even where others are cut.

RGEB (identity 32, 32 + 44 n bytes), offsets within the message:

    12 week i4   16 second of week f8   24 n i4   28 receiver status u4, then n records of
    0 PRN i4   4 pseudorange f8, m   12 its standard deviation f4, m   16 ADR f8, cycles
    24 its standard deviation f4, cycles   28 Doppler f4, Hz   32 C/N0 f4, dB-Hz   36 lock time f4, s
    40 tracking status u4

RGED (identity 65, 24 + 20 n bytes), the same compressed:

    12 n u2   14 week u2   16 second of week u4, 1/100 s   20 receiver status u4, then n records whose
    bits, counted from the lowest of five words of 32, are
    0-5 PRN   6-10 C/N0 - 20 dB-Hz   11-31 lock time, 1/32 s, modulo 65536 s
    32-63 ADR, 1/256 cycle, two's complement
    64-67 and 96-127 high and low part of the pseudorange, 1/128 m   68-95 Doppler, 1/256 Hz, both two's
    complement
    128-131 standard deviation of the ADR, (n + 1) / 512 cycles   132-135 code of that of the pseudorange
    136-159 tracking status, bits 0-23

    tracking status   0-3 state of the loops   4-8 channel   9 phase lock   10 parity known   11 code lock
    12-14 correlator   15-17 system (0 GPS)   19 grouped   20 frequency (0 L1, 1 L2)
    21-22 code (0 C/A, 1 P, 2 P codeless)
    receiver status   8 week not set   9 coarse time not set

REPB (identity 14, 108 bytes): 12 PRN i4, 16 subframes 1, 2 and 3 of 30 bytes each without parity.
IONB (identity 16, 76 bytes): 12 alpha 0-3 and beta 0-3 f8, in seconds and semicircles.

- The accumulated Doppler range (ADR) falls when the range grows: the carrier phase is its negative. In
  RGED it rolls over at 2^23 cycles; the whole rolls are those that bring the first phase after each loss
  of lock closest to the pseudorange, and stay until the next (the manual decides anew at every epoch,
  which makes a jump of 2^23 cycles where code and phase happen to be half a roll apart).
- Doppler is positive for approaching satellites, as RINEX.
- Lock is lost where the lock time is shorter than the time since the previous phase of the signal, by
  more than its quantum. While the parity is not known, the phase may be off by half a cycle: such phases
  have the half-cycle bit, and where the parity becomes known or is lost a slip is flagged.
- Weeks are taken as written: this generation of receivers was built before and after the first roll-over
  of the ten-bit week, and a week 925 is one of 1997.
- The compressed record of earlier firmware, RGEC, is in no public document that we know; RGED has taken its
  place (manual 4.45 and later) and is read here. Messages of other identities are passed over and counted.

References
----------
NovAtel Inc., "MiLLennium GPSCard software version 4.50, command descriptions manual", OM-20000041 rev 1,
1998, pages 138-139 (IONB), 192 (REPB), 195 (RGEB, RGED), tables D-5, D-6 and D-7; the same of version 4.45,
OM-20000026 rev 1, chapter 4 (binary messages). The sign of the ADR and of the Doppler follow RTKLIB 2.4.3.
"""

import numpy as np

from ..constants import FREQUENCY_HZ, GPS, SPEED_OF_LIGHT_MPS
from ..errors import FormatError
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

__all__ = ["find_messages", "is_oem3", "parse_oem3", "read_oem3"]

FORMAT = "novatel_oem3"

SYNC = b"\xaa\x44\x11"
HEADER_BYTES = 12
REPB, IONB, RGEB, RGED = 14, 16, 32, 65
_NAMES = {12: "SATB", 14: "REPB", 15: "RALB", 16: "IONB", 17: "UTCB", 18: "ALMB", 32: "RGEB", 65: "RGED"}
_LONGEST = 1 << 14  # a RGEB of all channels has a thousand bytes

RGEB_EPOCH = np.dtype([("week", "<i4"), ("tow", "<f8"), ("n", "<i4"), ("status", "<u4")])
RGEB_RANGE = np.dtype(
    [("prn", "<i4"), ("code", "<f8"), ("code_sd", "<f4"), ("adr", "<f8"), ("adr_sd", "<f4"),
     ("doppler", "<f4"), ("cn0", "<f4"), ("lock", "<f4"), ("status", "<u4")]
)  # fmt: skip
RGED_EPOCH = np.dtype([("n", "<u2"), ("week", "<u2"), ("tow", "<u4"), ("status", "<u4")])
RGED_RANGE = np.dtype(
    [("prn_cn0_lock", "<u4"), ("adr", "<i4"), ("high_doppler", "<u4"), ("low", "<u4"), ("sd_status", "<u4")]
)

PHASE_LOCK, PARITY_KNOWN, CODE_LOCK = 1 << 9, 1 << 10, 1 << 11
_NO_TIME = 1 << 8 | 1 << 9
ADR_ROLL_CYC = float(1 << 23)
LOCK_ROLL_S = float(1 << 16)
_LOCK_QUANTUM_S = 1.0 / 32.0
_LOCK_TOLERANCE_S = 0.04  # two rounded lock times, each by half a quantum, and the float32 of RGEB
_WEEK_LIMIT = 8_192

SIGNAL_OF_TRACKING = {(0, 0): "1C", (0, 1): "1P", (1, 0): "2C", (1, 1): "2P", (1, 2): "2W"}
"""Signal by frequency and code type of the tracking status."""


def _signal_table():
    table = np.full((2, 4), -1, dtype=np.int16)
    for (frequency, code), name in SIGNAL_OF_TRACKING.items():
        table[frequency, code] = signal_id(name)
    return table


_SIGNAL = _signal_table()


def is_oem3(head):
    """Tell whether there is an intact message among the first bytes."""
    return len(find_messages(np.frombuffer(head, dtype=np.uint8))[0]) > 0


def read_oem3(path):
    """Read a NovAtel OEM3 log.

    Parameters
    ----------
    path : str or os.PathLike
        The log, plain or compressed.

    Returns
    -------
    observations : Observations
        All ranges of GPS, in time order. What could not be used is counted in ``meta.warnings``.
    navigation : Navigation
        Ephemerides of the REPB messages; empty where the log has none.

    Raises
    ------
    FormatError
        If the file cannot be opened, is no OEM3 log, or holds no ranges.
    """
    return parse_oem3(read_bytes(path), path=path)


def parse_oem3(data, *, path=""):
    """Read a NovAtel OEM3 log that is already in memory.

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
        As `read_oem3`.
    """
    buffer = np.frombuffer(data, dtype=np.uint8)
    offset, size, kind, n_damaged = find_messages(buffer)
    if len(offset) == 0:
        raise FormatError(
            f"no intact OEM3 message was found in {len(buffer)} bytes; give a binary log of a NovAtel OEM3 "
            "receiver",
            path=path or None,
            byte_offset=0,
        )
    warnings = []
    n_between = len(buffer) - int(size.sum())
    if n_between:
        warnings.append(
            f"{n_between} bytes belong to no intact message, {n_damaged} headers of damaged ones among them; "
            "they are left out"
        )
    epochs, rows = _ranges(buffer, offset, size, kind, warnings)
    if len(epochs["time_ns"]) == 0:
        _refuse(kind, path, len(buffer))
    navigation = _navigation(buffer, offset, kind, epochs, str(path))
    if REPB not in kind:
        warnings.append("the log holds no REPB, so no ephemerides; give a navigation file")
    epochs, rows = _sort(epochs, rows, warnings)
    time_ns = epochs["time_ns"]
    lli = _flags_and_rolls(rows, time_ns)
    return Observations(
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
        glonass_channel=np.full(100, NO_CHANNEL, dtype=np.int8),
        meta=ObservationMeta(
            path=str(path),
            format=FORMAT,
            receiver_type="NovAtel OEM3",
            interval_s=_interval_s(time_ns),
            warnings=tuple(warnings),
        ),
    ), navigation


def find_messages(buffer):
    """Find every intact message.

    Parameters
    ----------
    buffer : ndarray of uint8, shape (n,)
        The log.

    Returns
    -------
    offset, size, kind : ndarray of int64, shape (m,)
        First byte, number of bytes and identity of each message; they do not overlap. Where the module
        knows a message, its size agrees with its content: eight bits of checksum are few.
    n_damaged : int
        Sync patterns outside of intact messages.
    """
    n = len(buffer)
    sync = np.frombuffer(SYNC, dtype=np.uint8)
    start = np.flatnonzero((buffer[:-2] == sync[0]) & (buffer[1:-1] == sync[1]) & (buffer[2:] == sync[2]))
    start = start.astype(np.int64)
    begin = start[start + HEADER_BYTES <= n]
    head = _records(buffer, begin, np.dtype([("sync", "u1", 4), ("kind", "<u4"), ("size", "<u4")]))
    kind, size = head["kind"].astype(np.int64), head["size"].astype(np.int64)
    whole = (size >= HEADER_BYTES) & (size <= _LONGEST) & (begin + size <= n)
    begin, kind, size = begin[whole], kind[whole], size[whole]
    # Exclusive or before every byte: two look-ups give the checksum of any stretch.
    before = np.zeros(n + 1, dtype=np.uint8)
    np.bitwise_xor.accumulate(buffer, out=before[1:])
    intact = before[begin] == before[begin + size]
    intact &= _has_right_size(buffer, begin, size, kind)
    begin, kind, size = begin[intact], kind[intact], size[intact]
    keep = _not_overlapping(begin, size, kind)
    begin, kind, size = begin[keep], kind[keep], size[keep]
    owner = np.searchsorted(begin, start, side="right") - 1
    inside = owner >= 0
    if len(begin):
        inside &= start < begin[owner] + size[owner]
    return begin, size, kind, int(np.sum(~inside))


def _not_overlapping(begin, size, kind):
    """Which of the messages with right checksums count, where some stand inside of others.

    A cut message reaches into the next one, and one in 256 of them then has a right checksum by chance; a
    sync pattern with its message inside of other data is far less likely. So a message into which another
    reaches is dropped, and so is one of those that this module reads if it holds another. The messages that
    pass on what came in at a port may hold whole messages: there the outer one counts.
    """
    keep = np.ones(len(begin), dtype=bool)
    end = begin + size
    last = np.searchsorted(begin, end) - 1  # the last message that begins before the end
    holds = last > np.arange(len(begin))
    keep[holds & ((end[last] > end) | np.isin(kind, (REPB, IONB, RGEB, RGED)))] = False
    free_from = 0
    for k in np.flatnonzero(keep).tolist():
        keep[k] = begin[k] >= free_from
        if keep[k]:
            free_from = end[k]
    return keep


def _has_right_size(buffer, begin, size, kind):
    """Whether the size of each message is the one that its identity and its number of records demand."""
    right = np.ones(len(begin), dtype=bool)
    for identity, expected in ((REPB, 108), (IONB, 76)):
        right &= (kind != identity) | (size == expected)
    for identity, epoch, record in ((RGEB, RGEB_EPOCH, RGEB_RANGE), (RGED, RGED_EPOCH, RGED_RANGE)):
        fixed = HEADER_BYTES + epoch.itemsize
        chosen = np.flatnonzero(kind == identity)
        right[chosen] &= size[chosen] >= fixed
        chosen = chosen[right[chosen]]
        count = _records(buffer, begin[chosen] + HEADER_BYTES, epoch)["n"].astype(np.int64)
        right[chosen] &= size[chosen] == fixed + count * record.itemsize
    return right


def _records(buffer, offset, dtype):
    """One structured record at each offset."""
    if len(offset) == 0:
        return np.zeros(0, dtype=dtype)
    windows = np.lib.stride_tricks.sliding_window_view(buffer, dtype.itemsize)
    return np.ascontiguousarray(windows[offset]).view(dtype)[:, 0]


def _refuse(kind, path, n_bytes):
    """Raise the error of a log without usable ranges."""
    found = [_NAMES.get(k, f"message {k}") for k in np.unique(kind).tolist()]
    if RGEB in kind or RGED in kind:
        message = (
            "the ranges of this log have no valid time: the receiver never had a position; record longer, "
            "with the antenna under open sky"
        )
    else:
        shown = ", ".join(found[:8]) + (", ..." if len(found) > 8 else "")
        message = (
            f"the log holds {len(kind)} OEM3 messages ({shown}) but no ranges; log RGEB or RGED, and REPB, "
            "in the receiver and record again"
        )
    raise FormatError(message, path=path or None, byte_offset=n_bytes)


def _ranges(buffer, offset, size, kind, warnings):
    """Epochs and rows of all range messages in file order; rows name their epoch by index."""
    chosen = (kind == RGEB) | (kind == RGED)
    at, compressed = offset[chosen], kind[chosen] == RGED
    time_s = np.zeros(len(at))
    week, count, status = (np.zeros(len(at), dtype=np.int64) for _ in range(3))
    for mask, dtype, scale in ((~compressed, RGEB_EPOCH, 1.0), (compressed, RGED_EPOCH, 0.01)):
        head = _records(buffer, at[mask] + HEADER_BYTES, dtype)
        time_s[mask], week[mask] = head["tow"] * scale, head["week"]
        count[mask], status[mask] = head["n"], head["status"]
    in_time = np.isfinite(time_s) & (time_s >= 0.0) & (time_s < 604_801.0)
    in_time &= (week > 0) & (week < _WEEK_LIMIT) & ((status & _NO_TIME) == 0)
    if not np.all(in_time):
        warnings.append(
            f"{int(np.sum(~in_time))} range messages from before the receiver knew the time; they are left "
            "out"
        )
    at, compressed, count = at[in_time], compressed[in_time], count[in_time]
    tow_ns = np.rint(time_s[in_time] * NS_PER_S).astype(np.int64)
    epochs = {
        "time_ns": week[in_time] * NS_PER_WEEK + tow_ns,
        "offset": at,
        "compressed": compressed,
    }
    parts = []
    for flag, head, dtype, unpack in (
        (False, RGEB_EPOCH, RGEB_RANGE, _plain_rows),
        (True, RGED_EPOCH, RGED_RANGE, _compressed_rows),
    ):
        of = np.flatnonzero(compressed == flag)
        epoch = np.repeat(of, count[of])
        within = np.arange(len(epoch)) - np.repeat(np.cumsum(count[of]) - count[of], count[of])
        first = at[epoch] + HEADER_BYTES + head.itemsize
        rows = unpack(_records(buffer, first + within * dtype.itemsize, dtype))
        parts.append(rows | {"epoch": epoch, "compressed": np.full(len(epoch), flag)})
    rows = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return epochs, _known_rows(rows, warnings)


def _plain_rows(record):
    with np.errstate(invalid="ignore"):
        values = {
            "code_m": record["code"].copy(),
            "phase_cyc": -record["adr"],
            "doppler_hz": record["doppler"].astype(float),
            "cn0_dbhz": record["cn0"].astype(float),
            "lock_s": record["lock"].astype(float),
        }
        for column in values.values():
            column[~(np.abs(column) < 1e12)] = np.nan
    return values | {"prn": record["prn"].astype(np.int64), "status": record["status"].astype(np.int64)}


def _compressed_rows(record):
    first, third = record["prn_cn0_lock"].astype(np.int64), record["high_doppler"].astype(np.int64)
    high = third & 0xF
    high -= (high & 8) << 1
    doppler = third >> 4
    doppler -= (doppler & 1 << 27) << 1
    return {
        "code_m": ((high << 32) + record["low"].astype(np.int64)) / 128.0,
        "phase_cyc": record["adr"].astype(float) / -256.0,
        "doppler_hz": doppler / 256.0,
        "cn0_dbhz": 20.0 + (first >> 6 & 0x1F),
        "lock_s": (first >> 11) * _LOCK_QUANTUM_S,
        "prn": first & 0x3F,
        "status": record["sd_status"].astype(np.int64) >> 8,
    }


def _known_rows(rows, warnings):
    """Rows of GPS signals, with satellite and signal for PRN and status; what is not locked is missing."""
    status, prn = rows.pop("status"), rows.pop("prn")
    rows["sat"] = (100 * GPS + prn).astype(np.int16)
    rows["signal"] = _SIGNAL[status >> 20 & 1, status >> 21 & 3]
    known = (status >> 15 & 7 == 0) & (prn >= 1) & (prn <= 32) & (rows["signal"] >= 0)
    rows["code_m"][(status & CODE_LOCK) == 0] = np.nan
    rows["phase_cyc"][(status & PHASE_LOCK) == 0] = np.nan
    rows["cn0_dbhz"][~(rows["cn0_dbhz"] > 0.0)] = np.nan
    rows["half_unknown"] = (status & PARITY_KNOWN) == 0
    if not np.all(known):
        warnings.append(f"{int(np.sum(~known))} ranges of other systems or signals are left out")
    return {name: column[known] for name, column in rows.items()}


def _sort(epochs, rows, warnings):
    """Bring epochs into strictly increasing time and rows into (epoch, satellite, signal) order."""
    time_ns = epochs["time_ns"]
    if np.any(np.diff(time_ns) <= 0):
        backward = np.flatnonzero(np.diff(time_ns) <= 0)
        # Of equal times the plain message goes before the compressed one, else the first in the file.
        order = np.lexsort((np.arange(len(time_ns)), epochs["compressed"], time_ns))
        first = order[np.concatenate(([True], np.diff(time_ns[order]) > 0))]
        warnings.append(
            f"time goes back or repeats at {len(backward)} places (first: "
            f"{format_gpst(time_ns[backward[0] + 1])} GPST); the epochs are sorted and "
            f"{len(time_ns) - len(first)} repeated ones left out"
        )
        new_index = np.full(len(time_ns), -1)
        new_index[first] = np.arange(len(first))
        epochs = {name: column[first] for name, column in epochs.items()}
        rows = {**rows, "epoch": new_index[rows["epoch"]]}
        rows = {name: column[rows["epoch"] >= 0] for name, column in rows.items()}
    order = np.lexsort((rows["signal"], rows["sat"], rows["epoch"]))
    rows = {name: column[order] for name, column in rows.items()}
    same = np.zeros(len(order), dtype=bool)
    same[1:] = (np.diff(rows["epoch"]) == 0) & (np.diff(rows["sat"]) == 0) & (np.diff(rows["signal"]) == 0)
    if np.any(same):
        warnings.append(
            f"{int(np.sum(same))} ranges repeat a signal within their epoch; the first one is kept"
        )
        rows = {name: column[~same] for name, column in rows.items()}
    return epochs, rows


def _flags_and_rolls(rows, time_ns):
    """Loss-of-lock bits of sorted rows; puts the whole rolls back into the compressed phases."""
    lli = np.zeros(len(rows["sat"]), dtype=np.uint8)
    order = np.lexsort((rows["epoch"], rows["signal"], rows["sat"]))
    order = order[np.isfinite(rows["phase_cyc"][order])]
    if len(order) == 0:
        return lli
    sat, signal, lock_s = rows["sat"][order], rows["signal"][order], rows["lock_s"][order]
    half = rows["half_unknown"][order]
    same = (np.diff(sat) == 0) & (np.diff(signal) == 0)
    passed_s = np.diff(time_ns[rows["epoch"][order]]) / NS_PER_S
    short_s = passed_s - np.diff(lock_s)
    rolled = np.abs(short_s - LOCK_ROLL_S) <= _LOCK_TOLERANCE_S
    lost = ~(short_s <= _LOCK_TOLERANCE_S) & ~rolled
    slip = lock_s < _LOCK_QUANTUM_S / 2.0
    slip[1:] = np.where(same, lost | (np.diff(half.astype(np.int8)) != 0), slip[1:])
    lli[order[slip]] |= LLI_SLIP
    lli[order[half]] |= LLI_HALF_CYCLE
    begins = slip.copy()
    begins[0] = True
    begins[1:] |= ~same
    arc_start = np.flatnonzero(begins)[np.cumsum(begins) - 1]
    wavelength_m = SPEED_OF_LIGHT_MPS / FREQUENCY_HZ[GPS, signal // 100]
    rolls = (rows["code_m"][order] / wavelength_m - rows["phase_cyc"][order]) / ADR_ROLL_CYC
    rolls[~np.isfinite(rolls)] = 0.0
    whole = np.rint(rolls[arc_start]) + np.rint(rolls - rolls[arc_start])
    rows["phase_cyc"][order] += np.where(rows["compressed"][order], whole * ADR_ROLL_CYC, 0.0)
    return lli


def _interval_s(time_ns):
    """Most frequent step between epochs, to the hundredth of a second; None for a single epoch."""
    if len(time_ns) < 2:
        return None
    step, times = np.unique(np.rint(np.diff(time_ns) / 1e7).astype(np.int64), return_counts=True)
    return max(float(step[np.argmax(times)]) / 100.0, 0.01)


def _navigation(buffer, offset, kind, epochs, path):
    """Feed all ephemerides of the log to the decoder, each with the time of the epoch before it."""
    decoder = BroadcastDecoder()
    chosen = (kind == REPB) | (kind == IONB)
    at = offset[chosen]
    index = np.maximum(np.searchsorted(epochs["offset"], at) - 1, 0)
    near_ns = epochs["time_ns"][index].tolist()
    for begin, identity, near in zip(at.tolist(), kind[chosen].tolist(), near_ns, strict=True):
        data = buffer[begin + HEADER_BYTES :].data
        if identity == IONB:
            klobuchar = np.frombuffer(data, dtype="<f8", count=8).copy()
            if np.all(np.abs(klobuchar) < 1e9):
                decoder.klobuchar["G"] = klobuchar
            continue
        prn = int.from_bytes(data[:4], "little")
        if not 1 <= prn <= 32:
            decoder.skip("REPB of unknown satellite")
            continue
        for k in range(3):
            bits = int.from_bytes(data[4 + 30 * k : 34 + 30 * k], "big")
            decoder.add_lnav(100 * GPS + prn, bits, near)
    return decoder.build(paths=(path,) if path else ())
