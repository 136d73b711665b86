"""The sentences of the TCM2 electronic compass: heading, tilt, magnetic field, temperature, anomaly flag.

The standard sentence holds those of its fields that are switched on, in this order, and the exclusive or
of the bytes between ``$`` and ``*``; the NMEA 0183 sentences hold the heading alone:

    $C328.3P28.4R-12.4X55.11Y12.33Z-18.43T22.3E001*29
    $HCHDM,182.3,M*21        heading from magnetic north
    $HCHDT,200.9,T*22        heading from true north

    C   heading, degrees (from magnetic north, or from true north where the module knows the declination)
    P   pitch, degrees, positive when the front edge is up
    R   roll, degrees, positive when the right edge is down
    X Y Z   magnetic field, microtesla; X forward, Y right, Z down
    T   temperature, degrees Celsius
    E   three hexadecimal digits: 001 magnetic anomaly, 002 inclinometer and 004 magnetometer out of range

The digits are those of the module: a tenth of a degree for the angles and the temperature, a hundredth of
a microtesla for the field. The columns are those of the simulated compass and tilt meter
(`truenorth.sensors`), the field in nanotesla. Sentences without a checksum, as the module sends them in
mils, are rejected.

A sentence has no time. It is given (start and rate: the k-th line, damaged ones included, is k / rate
after the start), or the computer that logs the module wrote it before each sentence, week and seconds of
the week (`truenorth.formats.stamped_lines`).

References
----------
PNI Corporation, "TCM2.5 and TCM2.6 user manual", document 1007535 r05, 2006, pages 11-15 and 19;
R. S. Harvey, UCGE Report 20117, University of Calgary, 1998, chapter 5 (TCM2-50).
"""

import re
from pathlib import Path

import numpy as np

from ..errors import FormatError
from ..sensor_log import SensorLog
from ..timescales import NS_PER_S
from .compression import read_bytes
from .stamped_lines import sort_by_time, split_stamp, stamp

__all__ = ["encode_tcm2", "is_tcm2", "parse_tcm2", "read_tcm2", "split_tcm2", "write_tcm2"]

RATE_HZ = 10.0
"""Sentences a second as logged in the source; the module sends up to 40."""

ANOMALY, TILT_OUT_OF_RANGE, FIELD_OUT_OF_RANGE = 1, 2, 4
"""Bits of ``error_code``."""

_NUMBER = r"-?\d{1,4}(?:\.\d{0,3})?"
# Column, its unit in units of the sentence, digits.
_FIELDS = {
    "C": ("heading_magnetic_deg", 1.0, 1),
    "P": ("pitch_deg", 1.0, 1),
    "R": ("roll_deg", 1.0, 1),
    "X": ("field_forward_nt", 1e-3, 2),
    "Y": ("field_right_nt", 1e-3, 2),
    "Z": ("field_down_nt", 1e-3, 2),
    "T": ("temperature_degc", 1.0, 1),
}
_STANDARD = re.compile("".join(f"(?:{letter}({_NUMBER}))?" for letter in _FIELDS) + "(?:E([0-9A-F]{3}))?")
_NMEA = re.compile(rf"HCHD([MT]),({_NUMBER}),\1")
_SENTENCE = re.compile(r"\$([^$*]*)\*([0-9A-Fa-f]{2})\s*$")
_LOOKS_LIKE = re.compile(
    rb"(?:\d{1,4} \d{1,6}(?:\.\d*)? )?\$(?:HCHD[MT],|[CPRXT]-?\d+\.\d)[^$]*\*[0-9A-F]{2}"
)

_COLUMNS = {name: unit for name, unit, _ in _FIELDS.values()}
_ALWAYS = ("heading_magnetic_deg", "pitch_deg", "roll_deg", "temperature_degc")
_TILT = ("pitch_deg", "roll_deg", "temperature_degc", "error_code")


def is_tcm2(head):
    """Tell whether a sentence of the compass is among the first lines."""
    return any(_LOOKS_LIKE.match(line) for line in head.splitlines()[:20])


def read_tcm2(path, *, start_ns=None, rate_hz=RATE_HZ, north="magnetic"):
    """Read a log of the compass.

    Parameters
    ----------
    path : str or os.PathLike
        Log of sentences, with or without time stamps, plain or compressed.
    start_ns : int, optional
        Of a log without time stamps: GPS time of the first line, nanoseconds.
    rate_hz : float, optional
        Of a log without time stamps: sentences a second.
    north : {"magnetic", "true"}, optional
        What the heading of the standard sentence counts from; the module does not say.

    Returns
    -------
    SensorLog
        Kind ``compass``, or ``tilt`` where no sentence has a heading. Columns
        ``heading_magnetic_deg`` (or ``heading_true_deg``, or both), ``pitch_deg``, ``roll_deg``,
        ``temperature_degc``, ``anomaly`` (1: raised), ``error_code`` (all bits) and, where they are sent,
        ``field_forward_nt``, ``field_right_nt``, ``field_down_nt``; NaN where a sentence lacks the field.
        ``meta`` has ``time`` (``stamped``, ``given``, or ``counted`` from zero when there is no start),
        ``n_rejected_lines``, ``n_rejected_bytes`` and ``warnings``.

    Raises
    ------
    FormatError
        If the file cannot be opened or holds no intact sentence.
    """
    return parse_tcm2(read_bytes(path), path=path, start_ns=start_ns, rate_hz=rate_hz, north=north)


def parse_tcm2(data, *, path="", start_ns=None, rate_hz=RATE_HZ, north="magnetic"):
    """Read a log of the compass that is already in memory.

    Parameters
    ----------
    data : bytes
        The log.
    path : str or os.PathLike, optional
        Name of the file for messages and metadata.
    start_ns, rate_hz, north
        As `read_tcm2`.

    Returns
    -------
    SensorLog

    Raises
    ------
    FormatError
        As `read_tcm2`.
    """
    lines = [line for line in data.decode("latin-1").split("\n") if line.strip(" \r\0:") and line[0] != "#"]
    stamps, found = [], []
    for line in lines:
        time_ns, rest = split_stamp(line)
        stamps.append(time_ns)
        found.append(_sentence(rest))
    stamped = any(t is not None and s is not None for t, s in zip(stamps, found, strict=True))
    good = [k for k, s in enumerate(found) if s is not None and (stamps[k] is not None) == stamped]
    if not good:
        raise FormatError(
            f"no intact sentence of a TCM2 compass was found in {len(lines)} lines; give a log of sentences "
            "like $C328.3P28.4R-12.4*hh, with their checksums",
            path=path or None,
            line_number=1,
        )
    warnings = []
    if stamped:
        time_ns, kind_of_time = np.array([stamps[k] for k in good], dtype=np.int64), "stamped"
    else:
        kind_of_time = "counted" if start_ns is None else "given"
        time_ns = (start_ns or 0) + np.rint(np.array(good) * (NS_PER_S / rate_hz)).astype(np.int64)
        if start_ns is None:
            warnings.append(f"the log has no time: samples are counted from zero at {rate_hz:g} Hz")
    n_lines = len(lines) - len(good)
    kept = set(good)
    n_bytes = sum(len(line) for k, line in enumerate(lines) if k not in kept)
    if n_lines:
        warnings.append(f"{n_lines} lines ({n_bytes} bytes) are damaged; they are left out")
    columns = _columns([found[k] for k in good], north)
    time_ns, columns = sort_by_time(time_ns, columns, warnings)
    has_heading = any(np.any(np.isfinite(columns[name])) for name in columns if name.startswith("heading_"))
    return SensorLog(
        kind="compass" if has_heading else "tilt",
        time_ns=time_ns,
        columns=columns,
        meta={
            "path": str(path),
            "time": kind_of_time,
            "n_rejected_lines": n_lines,
            "n_rejected_bytes": n_bytes,
            "warnings": "\n".join(warnings),
        },
    )


def _checksum(body):
    value = 0
    for character in body:
        value ^= ord(character)
    return value


def _sentence(text):
    """Fields of the last sentence of a line by column name; None when it is damaged."""
    whole = _SENTENCE.search(text)
    if whole is None or _checksum(whole[1]) != int(whole[2], 16):
        return None
    nmea = _NMEA.fullmatch(whole[1])
    if nmea is not None:
        name = "heading_magnetic_deg" if nmea[1] == "M" else "heading_true_deg"
        values = {name: float(nmea[2])}
    else:
        standard = _STANDARD.fullmatch(whole[1])
        if standard is None:
            return None
        *numbers, code = standard.groups()
        fields = zip(_COLUMNS.items(), numbers, strict=True)
        values = {name: float(n) / unit for (name, unit), n in fields if n is not None}
        if not values:
            return None
        values["error_code"] = int(code or "0", 16)
    if not all(0.0 <= values[name] <= 360.0 for name in values if name.startswith("heading")):
        return None
    in_range = abs(values.get("pitch_deg", 0.0)) <= 90.0 and abs(values.get("roll_deg", 0.0)) <= 180.0
    return values if in_range else None


def _columns(sentences, north):
    """Columns of all fields that are always there or occur."""
    names = [n for n in (*_COLUMNS, "heading_true_deg") if n in _ALWAYS or any(n in s for s in sentences)]
    columns = {n: np.array([s.get(n, np.nan) for s in sentences], dtype=float) for n in names}
    if north == "true":
        # NMEA sentences say what they count from; only the standard one does not.
        standard = np.array(["error_code" in s for s in sentences])
        true = columns.get("heading_true_deg", np.full(len(sentences), np.nan))
        columns["heading_true_deg"] = np.where(standard, columns["heading_magnetic_deg"], true)
        columns["heading_magnetic_deg"] = np.where(standard, np.nan, columns["heading_magnetic_deg"])
    for name, values in columns.items():
        if name.startswith("heading"):
            values[values == 360.0] = 0.0
    code = np.array([s.get("error_code", 0) for s in sentences], dtype=np.int64)
    columns["anomaly"] = code & ANOMALY
    columns["error_code"] = code
    return columns


def split_tcm2(log):
    """Part the samples of the module into those of a compass and those of a tilt meter.

    Parameters
    ----------
    log : SensorLog
        As `read_tcm2` gives it.

    Returns
    -------
    compass, tilt : SensorLog
        Both with all times; the tilt meter has pitch, roll, temperature and the error code.
    """
    compass = {name: c for name, c in log.columns.items() if name not in ("pitch_deg", "roll_deg")}
    tilt = {name: c for name, c in log.columns.items() if name in _TILT}
    return (
        SensorLog("compass", log.time_ns, compass, log.meta, log.truth),
        SensorLog("tilt", log.time_ns, tilt, log.meta, log.truth),
    )


def encode_tcm2(log, *, tilt=None, form="standard", stamped=True):
    """Write samples as sentences.

    Parameters
    ----------
    log : SensorLog
        Any of the columns that `read_tcm2` gives; fields that are NaN are left out of the sentence.
        ``anomaly`` sets the lowest bit of ``error_code``.
    tilt : SensorLog, optional
        Samples of the tilt meter in the same module, at the same times: its columns are added.
    form : {"standard", "nmea"}, optional
        ``nmea`` writes the heading alone.
    stamped : bool, optional
        Write the time before each sentence.

    Returns
    -------
    bytes

    Raises
    ------
    FormatError
        If the tilt samples have other times, a sample holds nothing to write, or a value is outside of
        what the sentence holds.
    """
    columns = dict(log.columns)
    if tilt is not None:
        if not np.array_equal(tilt.time_ns, log.time_ns):
            raise FormatError(
                "the compass and the tilt meter of one module speak in one sentence, and their samples have "
                "different times; give samples of equal times"
            )
        columns = {**tilt.columns, **columns}
    bodies = _nmea_bodies(columns) if form == "nmea" else _standard_bodies(columns, log.n_samples)
    times = [stamp(t) + " " for t in log.time_ns.tolist()] if stamped else [""] * log.n_samples
    return "".join(
        f"{time}${body}*{_checksum(body):02X}\r\n" for time, body in zip(times, bodies, strict=True)
    ).encode()


def _limited(name, values, unit=1.0):
    """Values in units of the sentence, which can hold them; the heading within the circle after rounding."""
    values = np.asarray(values, dtype=float) * unit
    if name.startswith("heading"):
        return np.round(values, 1) % 360.0
    limit = {"pitch_deg": 90.0, "roll_deg": 180.0}.get(name, 9999.0)
    if np.any(np.abs(values) > limit):
        largest = np.nanmax(np.abs(values)) / unit
        raise FormatError(f"`{name}` reaches {largest:g}, and the sentence holds {limit / unit:g}; limit it")
    return values


def _standard_bodies(columns, n):
    if "heading_magnetic_deg" not in columns and "heading_true_deg" in columns:
        columns = {**columns, "heading_magnetic_deg": columns["heading_true_deg"]}
    code = np.asarray(columns.get("error_code", np.zeros(n)), dtype=np.int64) & 0xFFF
    if "anomaly" in columns:
        code = code & ~ANOMALY | np.where(np.asarray(columns["anomaly"]) != 0, ANOMALY, 0)
    parts = [
        (letter, digits, _limited(name, columns[name], unit).tolist())
        for letter, (name, unit, digits) in _FIELDS.items()
        if name in columns
    ]
    for k, bits in enumerate(code.tolist()):
        body = "".join(f"{letter}{v[k]:.{digits}f}" for letter, digits, v in parts if v[k] == v[k])
        if not body:
            raise FormatError(f"sample {k} holds nothing that a TCM2 sentence could say; leave it out")
        yield body + (f"E{bits:03X}" if bits else "")


def _nmea_bodies(columns):
    letter, name = "M", "heading_magnetic_deg"
    if name not in columns:
        letter, name = "T", "heading_true_deg"
    if name not in columns or not np.all(np.isfinite(columns[name])):
        raise FormatError("an NMEA sentence of the compass is a heading, and samples lack it; leave them out")
    for value in _limited(name, columns[name]).tolist():
        yield f"HCHD{letter},{value:.1f},{letter}"


def write_tcm2(path, log, *, tilt=None, form="standard", stamped=True):
    """Write a log of the compass.

    Parameters
    ----------
    path : str or os.PathLike
        File to write.
    log, tilt, form, stamped
        As `encode_tcm2`.

    Raises
    ------
    FormatError
        As `encode_tcm2`.
    """
    Path(path).write_bytes(encode_tcm2(log, tilt=tilt, form=form, stamped=stamped))
