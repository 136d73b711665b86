"""The three-byte packet of a fibre-optic gyro, raw or in a log with time stamps.

Ten times a second the gyro sends, without checksum, most significant bit first,

    byte 1   1  F  r11 r10 r9  r8  r7  r6      F: status, 1 when the gyro has failed
    byte 2   0  r5 r4  r3  r2  r1  r0  t7      r: rotation rate, 12 bits
    byte 3   0  t6 t5  t4  t3  t2  t1  t0      t: temperature, 8 bits

The source gives the bits and their number: a sync bit of 1, 0, 0 at the head of the three bytes, the
status bit, and 20 bits that are 12 of rotation and then 8 of temperature. It gives neither the coding of
the rotation nor the scale of the temperature: both are settings (`FogCoding`). The defaults are offset
binary (2048 is no rotation, as of a converter that spans -100 to +100 deg/s) and half degrees from -40,
which hold the specified -40 to +70 degrees Celsius. Samples keep the counts; the simulated gyro
(`truenorth.sensors.gyro`) has the same columns.

A packet counts only where exactly two bytes stand between its first byte and the next first byte, or the
end: one lost or surplus byte costs the packets that it touches and nothing else. Damage that leaves the
sync bits alone cannot be seen in a packet; `implausible_packets` looks for jumps that no vehicle and no
temperature makes.

The stream has no time. It is either given (start and rate: the k-th packet of the stream, rejected ones
included, is k / rate after the start), or logged, in the text form that this module reads and writes:

    # fog-packet 1
    # rotation = offset_binary
    # temperature = unsigned
    # temperature_step_degc = 0.5
    # temperature_zero_degc = -40.0
    929 339200.055000000 a0107e

Each further line is what one read of the port returned, in hexadecimal, after its stamp
(`truenorth.formats.stamped_lines`): usually one packet, but any number of bytes. The bytes of all lines
are one stream, and a packet has the stamp of the line that holds its first byte.

References
----------
R. S. Harvey, "Development of a precision pointing system using an integrated multi-sensor approach",
UCGE Report 20117, University of Calgary, 1998, chapter 5 (Andrew AUTOGYRO 3ARG-D).
"""

import re
from dataclasses import asdict, dataclass
from math import isfinite
from pathlib import Path

import numpy as np

from ..errors import ConfigError, FormatError
from ..sensor_log import SensorLog
from ..timescales import NS_PER_S
from .compression import read_bytes
from .stamped_lines import sort_by_time, split_stamp, stamp

__all__ = [
    "FogCoding",
    "coding_of",
    "decode_packets",
    "encode_fog_log",
    "encode_packets",
    "implausible_packets",
    "is_fog_log",
    "is_packet_stream",
    "parse_fog_packets",
    "read_fog_packets",
    "write_fog_packets",
]

RATE_HZ = 10.0
"""Packets a second of the gyro of the source."""

_TITLE = "# fog-packet"
_PACKET_BYTES = 3
_SYNC = 0x80
_HALF_RANGE = 2048
_REMARK = re.compile(r"#\s*(\w+)\s*=\s*(\S+)\s*$", re.ASCII)


@dataclass(frozen=True, slots=True)
class FogCoding:
    """What the bits of a packet mean.

    Parameters
    ----------
    rotation : {"offset_binary", "twos_complement"}
        Coding of the 12 bits of rotation; both give -2048 to 2047 counts.
    temperature : {"unsigned", "twos_complement"}
        Coding of the 8 bits of temperature: 0 to 255 or -128 to 127 counts.
    temperature_step_degc, temperature_zero_degc : float
        Degrees Celsius of one count, and of count zero.

    Raises
    ------
    ConfigError
        If a value is impossible.
    """

    rotation: str = "offset_binary"
    temperature: str = "unsigned"
    temperature_step_degc: float = 0.5
    temperature_zero_degc: float = -40.0

    def __post_init__(self):
        """Refuse impossible values."""
        for key, known in (
            ("rotation", ("offset_binary", "twos_complement")),
            ("temperature", ("unsigned", "twos_complement")),
        ):
            value = getattr(self, key)
            if value not in known:
                raise ConfigError(f"`{key}` is {value!r}; give {' or '.join(known)}", key=key, value=value)
        for key, refused in (("temperature_step_degc", 0.0), ("temperature_zero_degc", None)):
            value = getattr(self, key)
            if not isfinite(value) or value == refused:
                raise ConfigError(f"`{key}` is {value!r}; give degrees Celsius", key=key, value=value)


def decode_packets(stream, coding=FogCoding()):
    """Find and decode the packets of a stream.

    Parameters
    ----------
    stream : bytes or ndarray of uint8
        What the gyro sent, from any byte on.
    coding : FogCoding, optional
        What the bits mean.

    Returns
    -------
    offset : ndarray of int64, shape (n,)
        First byte of each packet.
    columns : dict of str to ndarray, shape (n,)
        ``rate_count``, ``temperature_count``, ``status`` (1 where the gyro says that it has failed).
    n_rejected_packets : int
        First bytes of packets that are cut or too long.
    """
    data = np.frombuffer(stream, dtype=np.uint8) if isinstance(stream, bytes | bytearray) else stream
    first = np.flatnonzero(data & _SYNC)
    following = np.append(first[1:], len(data))
    whole = following - first == _PACKET_BYTES
    offset = first[whole].astype(np.int64)
    one, two, three = (data[offset + k].astype(np.int64) for k in range(_PACKET_BYTES))
    rotation = (one & 0x3F) << 6 | two >> 1
    if coding.rotation == "offset_binary":
        rotation = rotation - _HALF_RANGE
    else:
        rotation = (rotation ^ _HALF_RANGE) - _HALF_RANGE
    count = (two & 1) << 7 | three
    if coding.temperature == "twos_complement":
        count = (count ^ 0x80) - 0x80
    columns = {
        "rate_count": rotation,
        "temperature_count": count,
        "status": one >> 6 & 1,
    }
    return offset, columns, len(first) - len(offset)


def encode_packets(log, coding=FogCoding()):
    """Write samples as packets.

    Parameters
    ----------
    log : SensorLog
        With ``rate_count``, ``temperature_count`` and, where the gyro may fail, ``status``; counts are
        rounded to whole ones.
    coding : FogCoding, optional
        What the bits mean.

    Returns
    -------
    ndarray of uint8, shape (n, 3)
        One packet a row.

    Raises
    ------
    FormatError
        If a column is missing or holds a value that the bits cannot.
    """
    rotation = _whole_numbers(log, "rate_count", -_HALF_RANGE, _HALF_RANGE - 1)
    rotation = rotation + _HALF_RANGE if coding.rotation == "offset_binary" else rotation & 0xFFF
    lowest = 0 if coding.temperature == "unsigned" else -128
    count = _whole_numbers(log, "temperature_count", lowest, lowest + 255) & 0xFF
    failed = np.asarray(log.columns.get("status", np.zeros(log.n_samples))) != 0
    packets = np.empty((log.n_samples, _PACKET_BYTES), dtype=np.uint8)
    packets[:, 0] = _SYNC | failed.astype(np.int64) << 6 | rotation >> 6
    packets[:, 1] = (rotation & 0x3F) << 1 | count >> 7
    packets[:, 2] = count & 0x7F
    return packets


def _whole_numbers(log, name, lowest, highest):
    """One column of counts as int64."""
    if name not in log.columns:
        raise FormatError(
            f"a gyro packet holds `{name}`, and the log has only {', '.join(log.columns)}; add the column"
        )
    counts = np.rint(np.asarray(log.columns[name], dtype=float))
    outside = ~((counts >= lowest) & (counts <= highest))
    if np.any(outside):
        raise FormatError(
            f"`{name}` is {log.columns[name][np.flatnonzero(outside)[0]]} and in all {int(outside.sum())} "
            f"samples are outside of the {lowest} to {highest} of a gyro packet; limit them, as the gyro does"
        )
    return counts.astype(np.int64)


def implausible_packets(log, *, rate_jump_count=400.0, temperature_jump_count=4.0):
    """Find samples that damage behind intact sync bits explains better than motion does.

    A sample is suspect when it differs from both its neighbours, in the same direction, by more than the
    limit. The end samples have one neighbour and are held against that one only.

    Parameters
    ----------
    log : SensorLog
        With ``rate_count`` and ``temperature_count``.
    rate_jump_count, temperature_jump_count : float, optional
        Limits: 400 counts of 0.05 deg/s within a tenth of a second are an angular acceleration of
        200 deg/s^2, which no road vehicle reaches there and back within two samples.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    suspect = np.zeros(log.n_samples, dtype=bool)
    if log.n_samples < 2:
        return suspect
    for name, limit in (("rate_count", rate_jump_count), ("temperature_count", temperature_jump_count)):
        step = np.diff(np.asarray(log.columns[name], dtype=float))
        before, after = np.concatenate((-step[:1], step)), np.concatenate((-step, step[-1:]))
        spike = np.minimum(np.abs(before), np.abs(after)) > limit
        suspect |= spike & (np.sign(before) == np.sign(after))
    return suspect


def is_packet_stream(head):
    """Tell whether bytes are a raw stream of packets.

    Parameters
    ----------
    head : bytes
        The first bytes.

    Returns
    -------
    bool
        True when there are at least eight packets and they make up nine tenths of the bytes.
    """
    offset, _, _ = decode_packets(head)
    return len(offset) >= 8 and 10 * _PACKET_BYTES * len(offset) >= 9 * (len(head) - 2 * _PACKET_BYTES)


def is_fog_log(head):
    """Tell whether the first bytes are those of a log with time stamps."""
    return head.startswith(_TITLE.encode())


def read_fog_packets(path, *, coding=None, start_ns=None, rate_hz=RATE_HZ):
    """Read a log of gyro packets.

    Parameters
    ----------
    path : str or os.PathLike
        Raw stream or log with time stamps, plain or compressed.
    coding : FogCoding, optional
        What the bits mean. The default is what the log says, or the default coding.
    start_ns : int, optional
        Of a raw stream: GPS time of its first byte, nanoseconds.
    rate_hz : float, optional
        Of a raw stream: packets a second.

    Returns
    -------
    SensorLog
        Kind ``gyro``: columns as `decode_packets`. ``meta`` has the coding, ``time`` (``stamped``,
        ``given``, or ``counted`` from zero when a raw stream has no start), ``n_rejected_bytes``,
        ``n_rejected_packets``, ``n_rejected_lines`` and ``warnings``.

    Raises
    ------
    FormatError
        If the file cannot be opened or holds no packet.
    """
    return parse_fog_packets(read_bytes(path), path=path, coding=coding, start_ns=start_ns, rate_hz=rate_hz)


def parse_fog_packets(data, *, path="", coding=None, start_ns=None, rate_hz=RATE_HZ):
    """Read a log of gyro packets that is already in memory.

    Parameters
    ----------
    data : bytes
        Raw stream or log with time stamps.
    path : str or os.PathLike, optional
        Name of the file for messages and metadata.
    coding, start_ns, rate_hz
        As `read_fog_packets`.

    Returns
    -------
    SensorLog

    Raises
    ------
    FormatError
        As `read_fog_packets`.
    """
    warnings = []
    n_lines = 0
    if is_fog_log(data):
        stream, origin, times, said, n_lines = _lines(data)
        coding = coding or _coding(said, path)
        offset, columns, n_packets = decode_packets(stream, coding)
        time_ns, kind_of_time = times[origin[offset]], "stamped"
    else:
        stream = np.frombuffer(data, dtype=np.uint8)
        coding = coding or FogCoding()
        offset, columns, n_packets = decode_packets(stream, coding)
        index = np.rint(offset / _PACKET_BYTES)
        kind_of_time = "counted" if start_ns is None else "given"
        time_ns = (start_ns or 0) + np.rint(index * (NS_PER_S / rate_hz)).astype(np.int64)
        if start_ns is None:
            warnings.append(f"the stream has no time: samples are counted from zero at {rate_hz:g} Hz")
    n_bytes = len(stream) - _PACKET_BYTES * len(offset)
    if len(offset) == 0:
        raise FormatError(
            f"no gyro packet (a byte with its highest bit set, then two without) was found in {len(stream)} "
            "bytes; give what a fibre-optic gyro sent",
            path=path or None,
            byte_offset=0,
        )
    if n_packets or n_bytes or n_lines:
        warnings.append(
            f"{n_packets} packets ({n_bytes} bytes) and {n_lines} lines are damaged; they are left out"
        )
    time_ns, columns = sort_by_time(time_ns, columns, warnings)
    return SensorLog(
        kind="gyro",
        time_ns=time_ns,
        columns=columns,
        meta={
            "path": str(path),
            "time": kind_of_time,
            "bits": 12.0,
            **asdict(coding),
            "n_rejected_bytes": n_bytes,
            "n_rejected_packets": n_packets,
            "n_rejected_lines": n_lines,
            "warnings": "\n".join(warnings),
        },
    )


def _lines(data):
    """The stream of all lines, the line of every byte, the time of every line, remarks, damaged lines."""
    chunks, times, said, n_damaged = [], [], {}, 0
    for line in data.decode("latin-1").split("\n"):
        if line.startswith("#"):
            remark = _REMARK.match(line)
            if remark:
                said[remark[1]] = remark[2]
            continue
        if not line.strip():
            continue
        time_ns, digits = split_stamp(line)
        try:
            chunk = bytes.fromhex(digits)
        except ValueError:
            chunk = b""
        if time_ns is None or not chunk:
            n_damaged += 1
            continue
        chunks.append(chunk)
        times.append(time_ns)
    stream = np.frombuffer(b"".join(chunks), dtype=np.uint8)
    origin = np.repeat(np.arange(len(chunks)), [len(chunk) for chunk in chunks])
    return stream, origin, np.array(times, dtype=np.int64), said, n_damaged


def _coding(said, path):
    """Coding that the remarks of a log give."""
    try:
        return FogCoding(
            **{name: said[name] for name in ("rotation", "temperature") if name in said},
            **{name: float(said[name]) for name in said if name.startswith("temperature_")},
        )
    except (ConfigError, TypeError, ValueError) as error:
        raise FormatError(
            f"the head of the log does not say how the gyro codes its packets ({error}); mend it, or give "
            "the coding",
            path=path or None,
            line_number=1,
        ) from None


def coding_of(log):
    """Coding that agrees with what a log says of itself, the default where it says nothing.

    Parameters
    ----------
    log : SensorLog
        With the names of `FogCoding` in ``meta``.

    Returns
    -------
    FogCoding
    """
    return FogCoding(**{name: log.meta[name] for name in asdict(FogCoding()) if name in log.meta})


def encode_fog_log(log, coding=None):
    """Write samples as a log with time stamps.

    Parameters
    ----------
    log : SensorLog
        As `encode_packets` takes it.
    coding : FogCoding, optional
        What the bits mean; it is written into the head. The default is `coding_of` the log.

    Returns
    -------
    bytes

    Raises
    ------
    FormatError
        As `encode_packets`.
    """
    coding = coding or coding_of(log)
    packets = encode_packets(log, coding).tobytes().hex()
    lines = [f"{_TITLE} 1", *(f"# {name} = {value}" for name, value in asdict(coding).items())]
    width = 2 * _PACKET_BYTES
    for k, time_ns in enumerate(log.time_ns.tolist()):
        lines.append(f"{stamp(time_ns)} {packets[width * k : width * (k + 1)]}")
    return ("\n".join(lines) + "\n").encode()


def write_fog_packets(path, log, *, coding=None, stamped=True):
    """Write a log of gyro packets.

    Parameters
    ----------
    path : str or os.PathLike
        File to write.
    log : SensorLog
        As `encode_packets` takes it.
    coding : FogCoding, optional
        What the bits mean. The default is `coding_of` the log.
    stamped : bool, optional
        Write the log with time stamps, which keeps the times of the samples; else the raw stream.

    Raises
    ------
    FormatError
        As `encode_packets`.
    """
    coding = coding or coding_of(log)
    data = encode_fog_log(log, coding) if stamped else encode_packets(log, coding).tobytes()
    Path(path).write_bytes(data)
