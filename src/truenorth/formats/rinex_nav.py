"""RINEX navigation files, versions 2, 3 and 4.

A record is a line with satellite, clock epoch and three numbers, followed by lines of four numbers of
19 columns. Which number is what depends on the satellite system and, in RINEX 4, on the message that
the record names. Times of week are placed next to the clock epoch, so no week number is needed and
rollovers do no harm. GLONASS comes in UTC and kilometres, BeiDou in BeiDou time; both are converted
here, once.

References: RINEX 2.11 (W. Gurtner, 2012) tables A3-A6, A10-A17; RINEX 3.05 (IGS/RTCM, 2020) appendix
A5-A22; RINEX 4.02 (IGS/RTCM, 2024) section 8; URA and SISA indices: IS-GPS-200N 20.3.3.3.1.3 and
30.3.3.1.1.4.
"""

from datetime import UTC, datetime

import numpy as np

from ..constants import SYSTEMS
from ..errors import FormatError
from ..navigation import (
    KEPLER_COLUMNS,
    STATE_COLUMNS,
    KeplerEphemerides,
    MessageType,
    Navigation,
    StateEphemerides,
    merge_navigation,
)
from ..observations import NO_CHANNEL
from ..timescales import BDT_OFFSET_NS, NS_PER_DAY, NS_PER_S, NS_PER_WEEK, gpst_from_utc_ns
from .compression import read_bytes

__all__ = ["parse_rinex_nav", "read_rinex_nav"]

_WIDTH = 19

# Lines of a record by message; the last lines of the GLONASS record may be missing before 3.05.
_LINES = {
    "LNAV": 8,
    "INAV": 8,
    "FNAV": 8,
    "IFNV": 8,
    "D1": 8,
    "D2": 8,
    "D1D2": 8,
    "CNAV": 9,
    "CNV1": 10,
    "CNV2": 10,
    "CNV3": 9,
    "L1NV": 9,
    "FDMA": 5,
    "SBAS": 4,
}
_FEWEST_LINES = {"FDMA": 4}

# What can be computed, by system; the RINEX 2 and 3 files name no message.
_MESSAGES = {
    "G": ("LNAV", "CNAV", "CNV2"),
    "J": ("LNAV", "CNAV", "CNV2"),
    "E": ("INAV", "FNAV", "IFNV"),
    "C": ("D1", "D2", "D1D2", "CNV1", "CNV2", "CNV3"),
    "I": ("LNAV", "L1NV"),
    "R": ("FDMA",),
    "S": ("SBAS",),
}
_UNNAMED = {"G": "LNAV", "J": "LNAV", "E": "IFNV", "C": "D1D2", "I": "LNAV", "R": "FDMA", "S": "SBAS"}

# Places of the values in a record, counted over its numbers. The first twenty are common to all
# Keplerian messages; place 3 is an issue of data in the older messages, A-dot in the newer.
_COMMON = {
    "af0_s": 0,
    "af1_sps": 1,
    "af2_sps2": 2,
    "crs_m": 4,
    "delta_n_radps": 5,
    "m0_rad": 6,
    "cuc_rad": 7,
    "eccentricity": 8,
    "cus_rad": 9,
    "sqrt_a": 10,
    "cic_rad": 12,
    "omega0_rad": 13,
    "cis_rad": 14,
    "i0_rad": 15,
    "crc_m": 16,
    "omega_rad": 17,
    "omega_dot_radps": 18,
    "idot_radps": 19,
}
_MODERN = {"a_dot_mps": 3, "delta_n_dot_radps2": 20}
_TOE = 11

_FIT_S = {
    "G": 4 * 3600.0,
    "J": 2 * 3600.0,
    "E": 8 * 3600.0,
    "C": 4 * 3600.0,
    "I": 4 * 3600.0,
}
_MODERN_FIT_S = {"G": 3 * 3600.0, "J": 2 * 3600.0, "C": 4 * 3600.0, "I": 4 * 3600.0}

# Semi-major axes of navigation satellites are between 16 000 km and 50 000 km: the square roots.
_SQRT_A_RANGE = (4_000.0, 7_100.0)
_RADIUS_RANGE_M = (1.6e7, 5.0e7)

# The format writes "unknown" as 0.999999999999E+09; nothing meant is larger.
_LARGEST = 1e12


class _Text:
    """The lines of the file and where the data begin; makes the errors."""

    def __init__(self, data, path):
        self.lines = data.splitlines()
        self.path = path
        self.version = 0.0
        self.first_data_line = 0

    def error(self, index, message):
        return FormatError(message, path=self.path, line_number=index + 1)


def read_rinex_nav(path):
    """Read a RINEX navigation file of version 2, 3 or 4, compressed or not.

    Parameters
    ----------
    path : str or path-like
        The file.

    Returns
    -------
    Navigation
        Orbits, clocks and ionosphere coefficients; records without a usable orbit are counted in
        ``skipped`` (``"truncated"`` is a cut last record, ``"unusable"`` an orbit of impossible size).

    Raises
    ------
    FormatError
        If the file is not RINEX navigation data, or a record cannot be read; with the line number.
    """
    return parse_rinex_nav(read_bytes(path), path=str(path))


def parse_rinex_nav(data, *, path=None):
    """Read RINEX navigation text, see `read_rinex_nav`.

    Parameters
    ----------
    data : bytes
        The whole text.
    path : str, optional
        Name for messages.

    Returns
    -------
    Navigation

    Raises
    ------
    FormatError
        As `read_rinex_nav`.
    """
    text = _Text(data, path)
    header = _read_header(text)
    skipped = {}
    if text.version >= 4.0:
        groups, ionosphere = _split_named(text, skipped)
    else:
        groups, ionosphere = _split_unnamed(text, header["system"], skipped), []
    for index, letter, message, count in ionosphere:
        _add_ionosphere(text, header, skipped, index, letter, message, count)
    tables = []
    for (system, message), records in groups.items():
        fields = _read_fields(text, records, message)
        first = [index for index, _, _ in records]
        sat = np.array([sat for _, sat, _ in records], dtype=np.int16)
        toc_ns = _read_epochs(text, first)
        if message in ("FDMA", "SBAS"):
            table = _make_states(text, first, sat, toc_ns, fields, system, skipped)
            tables.append(_navigation(states=table))
        else:
            table = _make_kepler(text, first, sat, toc_ns, fields, system, message, skipped)
            tables.append(_navigation(kepler=table))
    # Joining with an empty table sorts and removes duplicates also when there is one group.
    merged = merge_navigation(_navigation(), _navigation(), *tables)
    return Navigation(
        kepler=merged.kepler,
        states=merged.states,
        klobuchar=header["klobuchar"],
        nequick=header["nequick"],
        leap_seconds=header["leap_seconds"],
        skipped=skipped,
        paths=() if path is None else (path,),
    )


def _navigation(kepler=None, states=None):
    none = np.empty(0, dtype=np.int64)
    if kepler is None:
        kepler = KeplerEphemerides(*[none] * 8, np.empty((0, len(KEPLER_COLUMNS))))
    if states is None:
        states = StateEphemerides(*[none] * 5, np.empty((0, len(STATE_COLUMNS))))
    return Navigation(kepler=kepler, states=states)


def _read_header(text):
    """Version, system and ionosphere of the header; sets the first line of the data."""
    lines = text.lines
    if not lines or lines[0][60:80].strip() != b"RINEX VERSION / TYPE":
        raise text.error(0, "not RINEX: the first line lacks `RINEX VERSION / TYPE`; give a RINEX file")
    try:
        text.version = float(lines[0][:9])
    except ValueError:
        raise text.error(0, f"RINEX version {_show(lines[0][:9])} is no number; repair the header") from None
    if not 2.0 <= text.version < 5.0:
        raise text.error(0, f"RINEX version {text.version:g} is not known; give version 2, 3 or 4")
    kind = lines[0][20:21].decode("ascii", "replace")
    system = {"N": "G", "G": "R", "H": "S", "E": "E", "L": "E", "J": "J"}.get(kind)
    if system is None or (text.version >= 3.0 and kind != "N"):
        wanted = "it holds observations; give it as such" if kind == "O" else "give a navigation file"
        raise text.error(0, f"RINEX file type {kind!r} is not navigation data: {wanted}")
    label = lines[0][40:41].decode("ascii", "replace")
    if text.version < 3.0 and kind == "N" and label in "REJCS":
        system = label
    header = {"system": system, "klobuchar": {}, "nequick": None, "leap_seconds": None}
    alpha, beta = {}, {}
    for index in range(1, len(lines)):
        line, label = lines[index], lines[index][60:80].strip()
        if label == b"END OF HEADER":
            text.first_data_line = index + 1
            break
        if label == b"IONOSPHERIC CORR":
            source = line[:4].decode("ascii", "replace").strip()
            if source == "GAL":
                values = _header_floats(text, index, 5, 12, 3)
                if header["nequick"] is None:
                    header["nequick"] = np.array(values)
            elif source in ("GPSA", "BDSA", "QZSA", "IRNA", "GPSB", "BDSB", "QZSB", "IRNB"):
                letter = {"G": "G", "B": "C", "Q": "J", "I": "I"}[source[0]]
                half = alpha if source[3] == "A" else beta
                half.setdefault(letter, _header_floats(text, index, 5, 12, 4))
        elif label == b"ION ALPHA":
            alpha.setdefault("G", _header_floats(text, index, 2, 12, 4))
        elif label == b"ION BETA":
            beta.setdefault("G", _header_floats(text, index, 2, 12, 4))
        elif label == b"LEAP SECONDS":
            try:
                leap = int(line[:6] or 0)
            except ValueError:
                raise text.error(index, f"leap seconds {_show(line[:6])} are not a whole number") from None
            header["leap_seconds"] = leap + (14 if line[24:27] == b"BDS" else 0)
    else:
        raise text.error(len(lines) - 1, "the header has no `END OF HEADER`; the file is cut")
    for letter in alpha.keys() & beta.keys():
        header["klobuchar"][letter] = np.array(alpha[letter] + beta[letter])
    return header


def _header_floats(text, index, start, width, count):
    line = text.lines[index][:60].replace(b"D", b"E").replace(b"d", b"e")
    values = []
    for k in range(count):
        field = line[start + k * width : start + (k + 1) * width].strip()
        try:
            values.append(float(field or 0.0))
        except ValueError:
            raise text.error(index, f"{_show(field)} in the header is no number; repair it") from None
    return values


def _show(field):
    return repr(field.decode("ascii", "replace").strip())


def _parse_sat(text, index, field, system=None):
    """Satellite integer of ``G05``, or of `` 5`` in a file of one system; None if not known."""
    name = field.decode("ascii", "replace")
    if name[:1] in SYSTEMS and name[:1] != "":
        system, name = name[0], name[1:]
    try:
        number = int(name)
    except ValueError:
        raise text.error(index, f"{_show(field)} is not a satellite; repair or remove the record") from None
    if system is None or not 0 < number < 100:
        raise text.error(index, f"{_show(field)} is not a satellite; repair or remove the record")
    return SYSTEMS.index(system) * 100 + number


def _split_unnamed(text, file_system, skipped):
    """Records of RINEX 2 and 3: lists of (first line, satellite, lines) by (system, message)."""
    lines, version = text.lines, text.version
    groups = {}
    starts = []
    for index in range(text.first_data_line, len(lines)):
        line = lines[index]
        head = line[:3] if version >= 3.0 else line[:2]
        if not head.strip():
            continue
        if line[60:67] == b"COMMENT":
            lines[index] = b""
            continue
        starts.append(index)
    for index in range(text.first_data_line, starts[0] if starts else len(lines)):
        if lines[index].strip():
            raise text.error(index, "a number line stands before the first record; the file is damaged")
    ends = [*starts, len(lines)][1:]
    for index, end in zip(starts, ends, strict=True):
        if version >= 3.0:
            sat = _parse_sat(text, index, lines[index][:3])
        else:
            sat = _parse_sat(text, index, lines[index][:2], file_system)
        system = SYSTEMS[sat // 100]
        _add_record(text, groups, skipped, index, end, sat, system, _UNNAMED[system])
    return groups


def _split_named(text, skipped):
    """Records of RINEX 4, which name their kind, satellite and message."""
    lines = text.lines
    starts = [k for k in range(text.first_data_line, len(lines)) if lines[k][:1] == b">"]
    for index in range(text.first_data_line, starts[0] if starts else len(lines)):
        if lines[index].strip():
            raise text.error(index, "a line stands before the first `>` record; the file is damaged")
    groups, ionosphere = {}, []
    for index, end in zip(starts, [*starts, len(lines)][1:], strict=True):
        words = lines[index].decode("ascii", "replace").split()
        if len(words) < 4:
            if end == len(lines):
                skipped["truncated"] = skipped.get("truncated", 0) + 1
                break
            raise text.error(index, "the `>` line lacks kind, satellite or message; remove the record")
        kind, message = words[1], words[3]
        if kind == "ION":
            ionosphere.append((index, words[2][0], " ".join(words[3:]), end - index - 1))
            continue
        if kind != "EPH":
            skipped[kind] = skipped.get(kind, 0) + 1
            continue
        system = words[2][0]
        if message not in _MESSAGES.get(system, ()):
            skipped[f"EPH {message}"] = skipped.get(f"EPH {message}", 0) + 1
            continue
        sat = _parse_sat(text, index, words[2].encode())
        _add_record(text, groups, skipped, index + 1, end, sat, system, message)
    return groups, ionosphere


def _add_record(text, groups, skipped, index, end, sat, system, message):
    lines = text.lines
    is_last = end == len(lines)
    while end > index and not lines[end - 1].strip():
        end -= 1
    needed = _FEWEST_LINES.get(message, _LINES[message])
    # The newer QZSS and GPS messages differ by the line of the L1C group delays.
    if end - index < needed:
        if is_last:
            skipped["truncated"] = skipped.get("truncated", 0) + 1
            return
        name = f"{system}{sat % 100:02d}"
        raise text.error(
            index,
            f"the record of {name} has {end - index} lines, {needed} needed; repair or remove it",
        )
    groups.setdefault((system, message), []).append((index, sat, end - index))


def _read_fields(text, records, message):
    """All numbers of the records, shape (n_records, 3 + 4 * (lines - 1)); blanks are zero."""
    lines = text.lines
    start, first = (4, 23) if text.version >= 3.0 else (3, 22)
    count = _LINES[message]
    parts = []
    for index, _, available in records:
        parts.append(lines[index][first : first + 3 * _WIDTH].ljust(3 * _WIDTH))
        parts += [
            line[start : start + 4 * _WIDTH].ljust(4 * _WIDTH)
            for line in lines[index + 1 : index + min(count, available)]
        ]
        parts += [b" " * (4 * _WIDTH)] * (count - available)
    joined = b"".join(parts).replace(b"D", b"E").replace(b"d", b"e")
    cells = np.frombuffer(joined, dtype=f"S{_WIDTH}").reshape(len(records), -1)
    blank = np.all(cells.view(np.uint8).reshape(*cells.shape, _WIDTH) == ord(" "), axis=2)
    cells = np.where(blank, b"0", cells)
    try:
        values = cells.astype(np.float64)
    except ValueError:
        values = np.empty(cells.shape)
        for place in np.ndindex(cells.shape):
            try:
                values[place] = float(cells[place])
            except ValueError:
                values[place] = np.nan
    bad = np.argwhere(~(np.abs(values) < _LARGEST))
    if len(bad):
        record, place = bad[0]
        line = records[record][0] + (0 if place < 3 else 1 + (place - 3) // 4)
        raise text.error(line, f"{_show(bytes(cells[record, place]))} is not a number; repair the record")
    return values


def _read_epochs(text, first_lines):
    """Clock epochs in the scale of the file, nanoseconds since 1980-01-06."""
    known = {}
    epochs = np.empty(len(first_lines), dtype=np.int64)
    for k, index in enumerate(first_lines):
        stamp = text.lines[index][3:23] if text.version >= 3.0 else text.lines[index][2:22]
        if stamp not in known:
            known[stamp] = _parse_epoch(text, index, stamp)
        epochs[k] = known[stamp]
    return epochs


def _parse_epoch(text, index, stamp):
    try:
        words = stamp.split()
        year, month, day, hour, minute = (int(word) for word in words[:5])
        second = float(words[5])
        if year < 100:  # two digits, RINEX 2
            year += 1900 if year >= 80 else 2000
        if not (1980 <= year < 2100 and 0 <= hour <= 24 and 0 <= minute <= 60 and 0.0 <= second <= 61.0):
            raise ValueError
        days = datetime(year, month, day, tzinfo=UTC).toordinal() - datetime(1980, 1, 6).toordinal()
    except (ValueError, IndexError):
        raise text.error(index, f"{_show(stamp)} is not a time; repair or remove the record") from None
    return days * NS_PER_DAY + (hour * 3600 + minute * 60) * NS_PER_S + round(second * NS_PER_S)


def _near(second_of_period, reference_ns, period_ns):
    """The time nearest to the reference that has the given seconds of the week (or day)."""
    phase = np.rint(second_of_period * 1e9).astype(np.int64) - reference_ns
    return reference_ns + (phase + period_ns // 2) % period_ns - period_ns // 2


def _whole(text, first, fields, place, limit):
    values = fields[:, place]
    bad = np.flatnonzero((np.abs(values) > limit) | (values != np.rint(values)))
    if len(bad):
        line = first[bad[0]] + (0 if place < 3 else 1 + (place - 3) // 4)
        raise text.error(line, f"{values[bad[0]]:g} is not a whole number up to {limit}; repair the record")
    return values.astype(np.int32)


def _accuracy_from_index(index):
    """Upper bound of the URA (metres) from its index, NaN for "no statement"."""
    index = np.asarray(index, dtype=float)
    metres = np.where(index <= 6.0, 2.0 ** (1.0 + index / 2.0), 2.0 ** (index - 2.0))
    return np.where((index >= 15.0) | (index <= -16.0), np.nan, metres)


def _message_codes(sat, fields, system, message):
    n = len(sat)
    if system == "E":
        if message != "IFNV":
            return np.full(n, MessageType[message], dtype=np.int8)
        # Data source: bit 9 says that the clock is of E5b/E1 (I/NAV), bit 8 of E5a/E1 (F/NAV).
        source = fields[:, 20].astype(np.int64)
        is_fnav = ((source & 0x200) == 0) & (((source & 0x100) != 0) | ((source & 0x7) == 2))
        return np.where(is_fnav, MessageType.FNAV, MessageType.INAV).astype(np.int8)
    if system == "C":
        if message.startswith("D"):
            number = sat % 100
            return np.where((number <= 5) | (number >= 59), MessageType.D2, MessageType.D1).astype(np.int8)
        return np.full(n, MessageType[message], dtype=np.int8)
    name = "CNAV2" if message == "CNV2" else message
    return np.full(n, MessageType[name], dtype=np.int8)


def _make_kepler(text, first, sat, toc_ns, fields, system, message, skipped):
    n = len(sat)
    elements = np.zeros((n, len(KEPLER_COLUMNS)))

    def put(name, values):
        elements[:, KEPLER_COLUMNS.index(name)] = values

    for name, place in _COMMON.items():
        put(name, fields[:, place])
    # The places that differ: transmission time, issues, health, accuracy, group delays.
    is_modern = message in ("CNAV", "CNV1", "CNV2", "CNV3", "L1NV")
    is_beidou_modern = system == "C" and is_modern
    if is_modern:
        for name, place in _MODERN.items():
            put(name, fields[:, place])
    limit = 2**30
    for place in (_TOE, 3):
        _check_range(text, first, fields, place, 1e7)
    if is_beidou_modern:
        sent_place = 31 if message == "CNV3" else 35
        health = _whole(text, first, fields, 28 if message == "CNV3" else 32, limit)
        iodc = np.zeros(n, dtype=np.int32) if message == "CNV3" else _whole(text, first, fields, 34, limit)
        iode = np.zeros(n, dtype=np.int32) if message == "CNV3" else _whole(text, first, fields, 38, limit)
        put("tgd_s", fields[:, 30 if message == "CNV3" else 29])
        if message != "CNV3":
            put("tgd2_s", fields[:, 30])
        put("ura_m", _accuracy_from_index(fields[:, 23].clip(-16, 15)))
    elif is_modern:
        sent_place = 35 if message == "CNV2" else 31
        health = _whole(text, first, fields, 24, limit)
        iode = iodc = np.zeros(n, dtype=np.int32)
        put("tgd_s", fields[:, 25])
        put("ura_m", _accuracy_from_index(fields[:, 23].clip(-16, 15)))
    else:
        sent_place = 27
        health = _whole(text, first, fields, 24, limit)
        iode = _whole(text, first, fields, 3, limit)
        put("tgd_s", fields[:, 25])
        put("ura_m", np.where(fields[:, 23] < 0.0, np.nan, fields[:, 23]))
        if system in "GJ":
            iodc = _whole(text, first, fields, 26, limit)
        elif system == "C":
            put("tgd2_s", fields[:, 26])
            iodc = _whole(text, first, fields, 28, limit)
        else:
            if system == "E":
                _whole(text, first, fields, 20, limit)
                put("tgd2_s", fields[:, 26])
            iodc = iode
    put("fit_interval_s", _fit_interval(fields, system, is_modern))
    # CNAV and CNAV-2 give the time of prediction where others give toe; there toe equals toc.
    has_toe = not (system in "GJ" and is_modern)
    toe_ns = _near(fields[:, _TOE], toc_ns, NS_PER_WEEK) if has_toe else toc_ns
    _check_range(text, first, fields, sent_place, 2e9)
    sent_ns = _near(fields[:, sent_place], toc_ns, NS_PER_WEEK)
    # Unknown times of transmission are written as 0.9999E9, or left blank.
    unknown = (np.abs(fields[:, sent_place]) > 2e6) | (np.abs(sent_ns - toe_ns) > NS_PER_DAY)
    sent_ns = np.where(unknown, toe_ns, sent_ns)
    shift = BDT_OFFSET_NS if system == "C" else 0
    sqrt_a, eccentricity = fields[:, 10], fields[:, 8]
    usable = (sqrt_a > _SQRT_A_RANGE[0]) & (sqrt_a < _SQRT_A_RANGE[1])
    usable &= (eccentricity >= 0.0) & (eccentricity < 0.5)
    if not np.all(usable):
        skipped["unusable"] = skipped.get("unusable", 0) + int(np.sum(~usable))
    return KeplerEphemerides(
        sat=sat[usable],
        message=_message_codes(sat, fields, system, message)[usable],
        toe_ns=(toe_ns + shift)[usable],
        toc_ns=(toc_ns + shift)[usable],
        transmission_ns=(sent_ns + shift)[usable],
        iode=iode[usable],
        iodc=iodc[usable],
        health=health[usable],
        elements=elements[usable],
    )


def _check_range(text, first, fields, place, limit):
    bad = np.flatnonzero(np.abs(fields[:, place]) > limit)
    if len(bad):
        line = first[bad[0]] + (0 if place < 3 else 1 + (place - 3) // 4)
        raise text.error(line, f"{fields[bad[0], place]:g} is out of range; repair the record")


def _fit_interval(fields, system, is_modern):
    if is_modern:
        return np.full(len(fields), _MODERN_FIT_S[system])
    default = _FIT_S[system]
    if system not in "GJ":
        return np.full(len(fields), default)
    # Hours; but some writers put the flag of the message (1: longer than the normal interval).
    hours = fields[:, 28]
    longer = 6 * 3600.0 if system == "G" else 4 * 3600.0
    fit_s = np.where((hours >= 2.0) & (hours <= 170.0), hours * 3600.0, default)
    return np.where(hours == 1.0, longer, fit_s)


def _make_states(text, first, sat, toc_ns, fields, system, skipped):
    states = np.zeros((len(sat), len(STATE_COLUMNS)))
    for axis in range(3):
        # Kilometres in the file: position, velocity, acceleration of each axis on one line.
        for order in range(3):
            states[:, 3 * order + axis] = 1e3 * fields[:, 3 + 4 * axis + order]
    states[:, 9] = fields[:, 0]
    states[:, 10] = fields[:, 1]
    health = _whole(text, first, fields, 6, 2**30)
    _check_range(text, first, fields, 2, 2e9)
    if system == "R":
        delay = fields[:, 16]
        states[:, 11] = np.where(np.abs(delay) < 1e-3, delay, 0.0)  # 0.999999999999E+09: unknown
        number = _whole(text, first, fields, 10, 2**30)
        number = np.where(number > 128, number - 256, number)  # unsigned bytes of some writers
        channel = np.where((number >= -7) & (number <= 13), number, NO_CHANNEL).astype(np.int8)
        sent_ns = gpst_from_utc_ns(_near(fields[:, 2], toc_ns, NS_PER_DAY))
        toe_ns = gpst_from_utc_ns(toc_ns)
    else:
        channel = np.zeros(len(sat), dtype=np.int8)
        toe_ns = toc_ns
        sent_ns = _near(fields[:, 2], toc_ns, NS_PER_WEEK)
        unknown = (np.abs(fields[:, 2]) > 2e6) | (np.abs(sent_ns - toe_ns) > NS_PER_DAY)
        sent_ns = np.where(unknown, toe_ns, sent_ns)
    radius = np.sqrt(np.sum(np.minimum(np.abs(states[:, :3]), 1e9) ** 2, axis=1))
    usable = (radius > _RADIUS_RANGE_M[0]) & (radius < _RADIUS_RANGE_M[1])
    usable &= np.all(np.abs(states[:, 3:9]) < 1e5, axis=1)
    if not np.all(usable):
        skipped["unusable"] = skipped.get("unusable", 0) + int(np.sum(~usable))
    return StateEphemerides(
        sat=sat[usable],
        toe_ns=toe_ns[usable],
        transmission_ns=sent_ns[usable],
        channel=channel[usable],
        health=health[usable],
        states=states[usable],
    )


def _add_ionosphere(text, header, skipped, index, letter, message, count):
    """Ionosphere record of RINEX 4: Klobuchar, NeQuick-G; the BeiDou global model is counted."""
    kind = message.split()[0]
    n_values = 4 if letter == "E" else 8
    known = (letter in "GJI" and kind in ("LNAV", "CNVX")) or (letter == "C" and kind == "D1D2")
    if letter == "J" and "JAPN" in message:
        known = False
    if not known and not (letter == "E" and kind == "IFNV"):
        skipped[f"ION {letter} {kind}"] = skipped.get(f"ION {letter} {kind}", 0) + 1
        return
    needed = 1 + (n_values - 3 + 3) // 4
    if count < needed:
        if index + 1 + count >= len(text.lines):
            skipped["truncated"] = skipped.get("truncated", 0) + 1
            return
        raise text.error(index, f"the ionosphere record has {count} lines of {needed}; remove it")
    parts = [text.lines[index + 1][23:80].ljust(57)]
    parts += [line[4:80].ljust(76) for line in text.lines[index + 2 : index + 1 + needed]]
    joined = b"".join(parts).replace(b"D", b"E").replace(b"d", b"e")
    try:
        values = [float(joined[k * _WIDTH : (k + 1) * _WIDTH].strip() or 0.0) for k in range(n_values)]
    except ValueError:
        raise text.error(index + 1, "an ionosphere coefficient is no number; remove it") from None
    if letter == "E":
        if header["nequick"] is None:
            header["nequick"] = np.array(values[:3])
    else:
        header["klobuchar"].setdefault(letter, np.array(values))
