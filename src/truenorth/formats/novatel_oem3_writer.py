"""Writing NovAtel OEM3 logs: ranges as RGED or RGEB, ephemerides as REPB, ionosphere as IONB.

The layout of the messages is in `truenorth.formats.novatel_oem3`. What is lost:

    ======================  =================================  ====================================
    quantity                RGED                               RGEB
    ======================  =================================  ====================================
    pseudorange             1/128 m (error up to 3.9 mm)       none
    carrier phase           1/256 cycle (error up to 0.37 mm   none
                            on L1), and multiples of 2^23
                            cycles
    Doppler                 1/256 Hz                           float32 (0.25 mHz at 4 kHz)
    C/N0                    1 dB-Hz, limited to 20 to 51       float32
    lock time               1/32 s, modulo 65536 s             float32
    time                    must be a multiple of 1/100 s      float64 (0.1 ns)
    ======================  =================================  ====================================

The receiver knew GPS L1 C/A, and L2 P without code; rows of other systems and signals are left out. No
field can say that it is missing: only the two lock flags of the tracking status can, for code and phase. So
a row needs pseudorange, Doppler and C/N0, else it is left out, and a missing phase is one without lock.

The lock time begins anew where the loss-of-lock bit is set; a signal that begins without the bit is given a
minute of lock before. The standard deviations are those of thermal noise in the loops,

    sigma_code  = 293.05 m sqrt(B d / (2 c/n0)),   B = 0.05 Hz (carrier-aided), d = 0.1 chip
    sigma_phase = sqrt(B / c/n0) / (2 pi) cycles,  B = 15 Hz

References
----------
As `truenorth.formats.novatel_oem3`; IS-GPS-200N 20.3.3 (subframes); Kaplan and Hegarty, "Understanding GPS",
2nd edition, 2006, 5.6 (thermal noise of the loops).
"""

from pathlib import Path

import numpy as np

from ..constants import GPS
from ..errors import FormatError
from ..navigation import MessageType
from ..observations import LLI_HALF_CYCLE, LLI_SLIP, signal_id
from ..timescales import NS_PER_S, NS_PER_WEEK, format_gpst
from .navigation_bits import LNAV_BITS
from .navigation_frames import lnav_subframes
from .novatel_oem3 import (
    CODE_LOCK,
    HEADER_BYTES,
    IONB,
    LOCK_ROLL_S,
    PARITY_KNOWN,
    PHASE_LOCK,
    REPB,
    RGEB,
    RGEB_EPOCH,
    RGEB_RANGE,
    RGED,
    RGED_EPOCH,
    RGED_RANGE,
    SIGNAL_OF_TRACKING,
    SYNC,
)

__all__ = ["encode_oem3", "write_oem3"]

_LOCK_BEFORE_S = 60.0
_STATUS_GOOD = 0x000A00FF  # antenna, oscillators, memories, ports good; time set
_L1_PHASE_LOCK_LOOP, _L2_PHASE_LOCK_LOOP, _NARROW_CORRELATOR = 4, 11, 2 << 12
_CHIP_M = 293.05
_CODE_SD_LIMITS_M = (
    0.050, 0.075, 0.113, 0.169, 0.253, 0.380, 0.570, 0.854, 1.281, 2.375, 4.75, 9.5, 19.0, 38.0, 76.0,
)  # fmt: skip


def write_oem3(path, observations, navigation=None, *, ranges="RGED"):
    """Write a NovAtel OEM3 log.

    Parameters
    ----------
    path : str or os.PathLike
        File to write.
    observations, navigation, ranges
        As `encode_oem3`.

    Returns
    -------
    int
        Rows of the observations that the log cannot hold.

    Raises
    ------
    FormatError
        As `encode_oem3`.
    """
    data, n_left_out = encode_oem3(observations, navigation, ranges=ranges)
    Path(path).write_bytes(data)
    return n_left_out


def encode_oem3(observations, navigation=None, *, ranges="RGED"):
    """Put observations and ephemerides into OEM3 messages.

    Parameters
    ----------
    observations : Observations
        Ranges; GPS ``1C``, ``1P``, ``2C``, ``2P`` and ``2W`` are written.
    navigation : Navigation, optional
        GPS LNAV ephemerides, each written before the first epoch at or after its transmission, and
        Klobuchar's coefficients, written first.
    ranges : {"RGED", "RGEB"}, optional
        Compressed or plain ranges.

    Returns
    -------
    data : bytes
        The log.
    n_left_out : int
        Rows of the observations that the log cannot hold.

    Raises
    ------
    FormatError
        If no row can be written, a value is outside of its field, or `ranges` is ``RGED`` and a time is
        no multiple of 1/100 s.
    """
    if ranges not in ("RGED", "RGEB"):
        raise FormatError(f"an OEM3 log holds ranges as RGED or RGEB, not as {ranges!r}; give one of them")
    rows, status = _writable(observations)
    if len(rows) == 0:
        raise FormatError(
            "no row of the observations is one of GPS L1 or L2 with pseudorange, Doppler and C/N0, and an "
            "OEM3 log holds nothing else; write RINEX or UBX"
        )
    lock_s = _lock_times(observations, rows)
    status = status | np.where(np.isfinite(observations.phase_cyc[rows]), PHASE_LOCK, 0)
    pack = _plain_messages if ranges == "RGEB" else _compressed_messages
    range_messages = pack(observations, rows, status, lock_s)
    ephemerides = [] if navigation is None else _ephemeris_messages(navigation)
    parts = []
    if navigation is not None and "G" in navigation.klobuchar:
        parts.append(_message(IONB, np.asarray(navigation.klobuchar["G"], dtype="<f8").tobytes()))
    waiting = iter(ephemerides)
    following = next(waiting, None)
    for time_ns, message in zip(observations.time_ns.tolist(), range_messages, strict=True):
        while following is not None and following[0] <= time_ns:
            parts.append(following[1])
            following = next(waiting, None)
        parts.append(message)
    while following is not None:
        parts.append(following[1])
        following = next(waiting, None)
    return b"".join(parts), observations.n_rows - len(rows)


def _message(identity, data):
    size = HEADER_BYTES + len(data)
    rest = identity.to_bytes(4, "little") + size.to_bytes(4, "little") + data
    whole = np.frombuffer(SYNC + rest, dtype=np.uint8)
    return SYNC + bytes([int(np.bitwise_xor.reduce(whole))]) + rest


def _writable(observations):
    """Rows that a log can hold, and their tracking status without the phase lock."""
    frequency = np.full(1000, -1)
    code = np.zeros(1000, dtype=np.int64)
    for (band, kind), name in SIGNAL_OF_TRACKING.items():
        frequency[signal_id(name)], code[signal_id(name)] = band, kind
    number = observations.sat.astype(np.int64) - 100 * GPS
    good = (number >= 1) & (number <= 32) & (frequency[observations.signal] >= 0)
    for column in (observations.code_m, observations.doppler_hz, observations.cn0_dbhz):
        good &= np.isfinite(column)
    rows = np.flatnonzero(good)
    band, kind = frequency[observations.signal[rows]], code[observations.signal[rows]]
    state = np.where(band == 0, _L1_PHASE_LOCK_LOOP, _L2_PHASE_LOCK_LOOP)
    # The channels of a satellite are those of its place among all satellites of the log.
    channel = np.unique(number[rows], return_inverse=True)[1] & 0x1F
    parity = np.where(observations.lli[rows] & LLI_HALF_CYCLE, 0, PARITY_KNOWN)
    return rows, state | channel << 4 | parity | CODE_LOCK | _NARROW_CORRELATOR | band << 20 | kind << 21


def _lock_times(observations, rows):
    """Time since the lock of every row began, seconds; zero without phase."""
    lock_s = np.zeros(len(rows))
    with_phase = np.flatnonzero(np.isfinite(observations.phase_cyc[rows]))
    if len(with_phase) == 0:
        return lock_s
    epoch = observations.epoch_of_row[rows][with_phase]
    sat, signal = observations.sat[rows][with_phase], observations.signal[rows][with_phase]
    order = np.lexsort((epoch, signal, sat))
    time_ns = observations.time_ns[epoch[order]]
    slip = (observations.lli[rows][with_phase][order] & LLI_SLIP) != 0
    new = np.ones(len(order), dtype=bool)
    new[1:] = (np.diff(sat[order]) != 0) | (np.diff(signal[order]) != 0)
    began_ns = np.where(slip, time_ns, time_ns - round(_LOCK_BEFORE_S * NS_PER_S))
    start = np.flatnonzero(slip | new)[np.cumsum(slip | new) - 1]
    lock_s[with_phase[order]] = (time_ns - began_ns[start]) / NS_PER_S
    return lock_s


def _thermal_noise(cn0_dbhz):
    """Standard deviations of code (metres) and phase (cycles)."""
    ratio = 10.0 ** (cn0_dbhz / 10.0)
    return _CHIP_M * np.sqrt(0.05 * 0.1 / (2.0 * ratio)), np.sqrt(15.0 / ratio) / (2.0 * np.pi)


def _field(values, bits, name, observations, rows):
    """Whole numbers within a field of two's complement, as unsigned."""
    counts = np.rint(values)
    outside = ~(np.abs(counts) < 1 << (bits - 1))
    if np.any(outside):
        k = np.flatnonzero(outside)[0]
        epoch = observations.epoch_of_row[rows[k]]
        raise FormatError(
            f"the {name} at {format_gpst(observations.time_ns[epoch])} GPST does not fit into an RGED "
            "message; write RGEB"
        )
    return counts.astype(np.int64) & ((1 << bits) - 1)


def _epoch_slices(observations, rows):
    """First row (index into `rows`) of every epoch, and the end."""
    return np.searchsorted(rows, observations.epoch_start)


def _plain_messages(observations, rows, status, lock_s):
    record = np.zeros(len(rows), dtype=RGEB_RANGE)
    cn0_dbhz = observations.cn0_dbhz[rows]
    record["prn"] = observations.sat[rows] - 100 * GPS
    record["code"] = observations.code_m[rows]
    record["adr"] = np.where(status & PHASE_LOCK, -observations.phase_cyc[rows], 0.0)
    record["code_sd"], record["adr_sd"] = _thermal_noise(cn0_dbhz)
    record["doppler"], record["cn0"], record["lock"] = observations.doppler_hz[rows], cn0_dbhz, lock_s
    record["status"] = status
    first = _epoch_slices(observations, rows)
    head = np.zeros(observations.n_epochs, dtype=RGEB_EPOCH)
    head["week"] = observations.time_ns // NS_PER_WEEK
    head["tow"] = observations.time_ns % NS_PER_WEEK / NS_PER_S
    head["n"], head["status"] = np.diff(first), _STATUS_GOOD
    for k in range(observations.n_epochs):
        yield _message(RGEB, head[k].tobytes() + record[first[k] : first[k + 1]].tobytes())


def _compressed_messages(observations, rows, status, lock_s):
    step_ns = NS_PER_S // 100
    odd = np.flatnonzero(observations.time_ns % step_ns)
    if len(odd):
        raise FormatError(
            f"an RGED message holds times to 1/100 s, and an epoch is at "
            f"{format_gpst(observations.time_ns[odd[0]], decimals=9)} GPST; write RGEB"
        )
    code = _field(128.0 * observations.code_m[rows], 36, "pseudorange", observations, rows)
    doppler = _field(256.0 * observations.doppler_hz[rows], 28, "Doppler", observations, rows)
    phase_cyc = np.where(status & PHASE_LOCK, observations.phase_cyc[rows], 0.0)
    # Any whole roll will do: the reader finds it again from the pseudorange.
    adr = np.rint(-256.0 * phase_cyc).astype(np.int64)
    cn0_dbhz = observations.cn0_dbhz[rows]
    cn0 = np.clip(np.rint(cn0_dbhz) - 20.0, 0.0, 31.0).astype(np.int64)
    lock = np.rint(32.0 * lock_s).astype(np.int64) % round(32.0 * LOCK_ROLL_S)
    code_sd_m, adr_sd_cyc = _thermal_noise(cn0_dbhz)
    code_sd = np.searchsorted(_CODE_SD_LIMITS_M, code_sd_m)
    adr_sd = np.clip(np.ceil(512.0 * adr_sd_cyc) - 1.0, 0.0, 15.0).astype(np.int64)
    record = np.zeros(len(rows), dtype=RGED_RANGE)
    record["prn_cn0_lock"] = (observations.sat[rows] - 100 * GPS).astype(np.int64) | cn0 << 6 | lock << 11
    record["adr"] = ((adr + (1 << 31)) % (1 << 32)) - (1 << 31)
    record["high_doppler"] = code >> 32 | doppler << 4
    record["low"] = code & 0xFFFFFFFF
    record["sd_status"] = adr_sd | code_sd << 4 | (status & 0xFFFFFF) << 8
    first = _epoch_slices(observations, rows)
    head = np.zeros(observations.n_epochs, dtype=RGED_EPOCH)
    head["n"], head["status"] = np.diff(first), _STATUS_GOOD
    head["week"] = observations.time_ns // NS_PER_WEEK
    head["tow"] = observations.time_ns % NS_PER_WEEK // step_ns
    for k in range(observations.n_epochs):
        yield _message(RGED, head[k].tobytes() + record[first[k] : first[k + 1]].tobytes())


def _ephemeris_messages(navigation):
    """Time of transmission and REPB of every GPS LNAV ephemeris, in the order of transmission."""
    kepler = navigation.kepler
    chosen = np.flatnonzero((kepler.sat // 100 == GPS) & (kepler.message == MessageType.LNAV))
    chosen = chosen[np.argsort(kepler.transmission_ns[chosen], kind="stable")]
    messages = []
    for k in chosen.tolist():
        sent_ns, number = int(kepler.transmission_ns[k]), int(kepler.sat[k]) - 100 * GPS
        try:
            # The time of transmission is that in the hand-over word of subframe 1: the start of subframe 2.
            subframes = lnav_subframes(kepler, k, sent_ns - 6 * NS_PER_S)
        except ValueError as error:
            raise FormatError(
                f"an ephemeris of G{number:02d} does not fit into the broadcast message ({error}); leave it "
                "out"
            ) from None
        data = b"".join(bits.to_bytes(LNAV_BITS // 8, "big") for bits in subframes)
        messages.append((sent_ns, _message(REPB, number.to_bytes(4, "little") + data + bytes(2))))
    return messages
