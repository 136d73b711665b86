"""RINEX observation files, versions 2.10 to 4.02.

The header is read in Python, the body in one compiled pass (`truenorth._kernels.rinex_obs`). A long file
is read in blocks of epochs from pieces of its text (`RinexObservationBlocks`); a file read at once is one
block of one piece.

- A row is one signal of one satellite at one epoch. It exists when at least one of code, phase,
  Doppler and C/N0 is there; blank and zero values are NaN.
- Loss-of-lock bit 0 (slip) and bit 1 (half cycle) of the phase are kept; bit 2 (anti-spoofing in
  RINEX 2, BOC tracking in RINEX 3) is dropped. Epoch flag 1 (power failure) marks every phase of its
  epoch as slipped.
- Time tags become GPS time: GLONASS files are in UTC, BeiDou files 14 s behind GPS.
- ``SYS / SCALE FACTOR`` is undone. ``SYS / PHASE SHIFT`` is kept in the metadata and not applied: the
  standard says that the phases in the file are already aligned (RINEX 3.05, section 9.1).
- Pseudo-observations (``X``, ``I``) and unknown types are skipped.

RINEX 2 names have no tracking attribute. They are given one by this table (a name in brackets is used
when the first is not in the file)::

    system    L1 D1 S1    C1   P1   L2 D2 S2      C2   P2   5    6    7    8
    GPS       1C (1W)     1C   1W   2W (2X)       2X   2W   5X
    GLONASS   1C (1P)     1C   1P   2P (2C)       2C   2P   3X from C3
    Galileo   1X          1X                                5X   6X   7X   8X
    BeiDou    2I          2I        2I            2I        5X   6I   7I
    QZSS      1C          1C        2X            2X        5X   6X
    SBAS      1C          1C                                5X
    NavIC                                                   5X

so the phase goes with ``C1`` when the file has it, else with ``P1``; on L2 with ``P2``, else ``C2``.
The two-letter names of RINEX 2.12 (``CA``, ``LB``, ...) are read as A = 1C, B = 1X, C = 2X, D = 2C.

References: W. Gurtner and L. Estey, RINEX 2.11, 2007, and 2.12, 2009; IGS/RTCM, RINEX 3.05, 2020, and
4.02, 2024.
"""

import sys
from dataclasses import dataclass, field

import numpy as np

from ..constants import GPS, SYSTEMS
from ..errors import FormatError
from ..observations import (
    LLI_HALF_CYCLE,
    LLI_SLIP,
    NO_CHANNEL,
    ObservationEvent,
    ObservationMeta,
    Observations,
    signal_id,
)
from ..timescales import BDT_OFFSET_NS, format_gpst, gpst_from_utc_ns

__all__ = ["RinexObservationBlocks", "parse_rinex_obs", "read_rinex_obs"]

FORMAT = "rinex_obs"

_KINDS = "CLDS"
_LABELS_OF_COLUMNS = {
    "# / TYPES OF OBSERV",
    "SYS / # / OBS TYPES",
    "SYS / SCALE FACTOR",
    "WAVELENGTH FACT L1/2",
}
_MAX_HEADER_LINES = 100_000
_MAX_WARNINGS = 50
_MAX_TYPES = 999
_SURVEY_EPOCHS = 4096
_LONGEST_EPOCH = 16 * 2**20
_TIME_SYSTEMS = {"GPS": 0, "GAL": 0, "QZS": 0, "IRN": 0, "BDT": BDT_OFFSET_NS, "GLO": None, "UTC": None}
_TIME_SYSTEM_OF_FILE = {"R": "GLO", "E": "GAL", "C": "BDT", "J": "QZS", "I": "IRN"}

# Signals of RINEX 2 code types: system -> {type: signal}.
_OLD_CODES = {
    "G": {"C1": "1C", "P1": "1W", "C2": "2X", "P2": "2W", "C5": "5X"},
    "R": {"C1": "1C", "P1": "1P", "C2": "2C", "P2": "2P", "C3": "3X"},
    "E": {"C1": "1X", "C5": "5X", "C6": "6X", "C7": "7X", "C8": "8X"},
    "C": {"C2": "2I", "C1": "2I", "C5": "5X", "C6": "6I", "C7": "7I"},
    "J": {"C1": "1C", "C2": "2X", "C5": "5X", "C6": "6X"},
    "S": {"C1": "1C", "C5": "5X"},
    "I": {"C5": "5X"},
}
# Code type that the phase, Doppler and C/N0 of a band go with, best first.
_OLD_HOST = {"1": ("C1", "P1"), "2": ("P2", "C2")}
_OLD_LETTERS = {"A": "1C", "B": "1X", "C": "2X", "D": "2C"}


@dataclass
class _Header:
    version: float = 0.0
    version_text: str = ""
    file_system: str = " "
    types: dict[str, list[str]] = field(default_factory=dict)
    scale: dict[tuple[str, str], float] = field(default_factory=dict)
    time_system: str = ""
    wavelength_factor: tuple[int, int] = (1, 1)
    channels: dict[int, int] = field(default_factory=dict)
    meta: dict[str, object] = field(default_factory=dict)
    phase_shift: dict[str, float] = field(default_factory=dict)
    glonass_bias: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    continued_system: str = ""
    continued_scale: tuple[str, float] = ("", 1.0)
    started_types: set[str] = field(default_factory=set)

    @property
    def old(self):
        return self.version < 3.0


def read_rinex_obs(path):
    """Read a RINEX observation file, packed or not.

    Parameters
    ----------
    path : str or os.PathLike
        The file.

    Returns
    -------
    Observations

    Raises
    ------
    FormatError
        If the file is not a readable RINEX observation file.
    """
    from .compression import read_bytes

    return parse_rinex_obs(read_bytes(path), path=path)


def parse_rinex_obs(data, *, path=None):
    """Read the plain content of a RINEX observation file.

    Parameters
    ----------
    data : bytes
        Content after unpacking.
    path : str or os.PathLike, optional
        Name of the file, for messages and metadata.

    Returns
    -------
    Observations
        Sorted by (epoch, satellite, signal); what had to be mended is said in ``meta.warnings``.

    Raises
    ------
    FormatError
        If the header is not that of a RINEX observation file, or no epoch of the body can be read.
    """
    body = _Body((data,), path)
    epochs, rows, events = body.read()
    body.judge()
    time_ns = _to_gpst(epochs["time_ns"], body.header)
    keep = _increasing(time_ns, body.header)
    finish = _Finish(body.header, path)
    observations = finish(time_ns, epochs, rows, events)
    return observations if keep is None else observations.select_epochs(keep)


class RinexObservationBlocks:
    """A RINEX observation file in blocks of epochs, whose text is never in memory as a whole.

    Opening goes through the whole file once, for the times of all epochs; what the header and later header
    records say, and what had to be mended, is then known and the same for every block.

    Parameters
    ----------
    pieces : callable
        Returns an iterator of the consecutive pieces of the unpacked text, from its beginning.
    path : str or os.PathLike, optional
        Name of the file, for messages and metadata.

    Attributes
    ----------
    time_ns : ndarray of int64, shape (n_epochs,)
        Of all epochs, as in `Observations`.
    sat : ndarray of int16
        Satellites of the file, each once.
    n_rows : int
        Rows of all epochs.
    meta : ObservationMeta
        As of the whole file.

    Raises
    ------
    FormatError
        As `parse_rinex_obs`.
    """

    def __init__(self, pieces, path=None):
        self._pieces, self._path = pieces, path
        body = _Body(pieces(), path)
        times, seen, self.n_rows = [], np.zeros(100 * len(SYSTEMS), bool), 0
        while not times or len(times[-1]):
            epochs, rows, _ = body.read(_SURVEY_EPOCHS)
            times.append(epochs["time_ns"])
            seen[rows["sat"]] = True
            self.n_rows += len(rows["sat"])
        body.judge()
        self.time_ns = _to_gpst(np.concatenate(times), body.header)
        self._keep = _increasing(self.time_ns, body.header)
        if self._keep is not None:
            self.time_ns = self.time_ns[self._keep]
        self._finish = _Finish(body.header, path)
        self.sat = np.flatnonzero(seen).astype(np.int16)
        self.meta = self._finish.meta

    @property
    def n_epochs(self):
        """int: Number of epochs."""
        return len(self.time_ns)

    def ranges(self, ranges):
        """Read ranges of epochs, in one more pass over the file.

        Parameters
        ----------
        ranges : iterable of tuple of int
            First epoch and the one after the last, of each block; increasing, none empty.

        Yields
        ------
        Observations
            With the metadata and channels of the whole file, and the events of the block.
        """
        body = _Body(self._pieces(), self._path, count_lines=False)
        at = 0
        for first, stop in ranges:
            kept = np.arange(first, stop) if self._keep is None else self._keep[first:stop]
            while at < kept[0]:
                step = min(int(kept[0]) - at, _SURVEY_EPOCHS)
                body.read(step)
                at += step
            epochs, rows, events = body.read(int(kept[-1]) + 1 - at)
            block = self._finish(_to_gpst(epochs["time_ns"], self._finish.header), epochs, rows, events)
            if self._keep is not None:
                block = block.select_epochs((kept - at)[kept - at < block.n_epochs])
            at = int(kept[-1]) + 1
            if not np.array_equal(block.time_ns, self.time_ns[first:stop]):
                raise FormatError(
                    "the file changed while it was read; read it again when it is complete", path=self._path
                )
            yield block


# --------------------------------------------------------------------------------------- header


def _read_header(data, path):
    """Header and the offset of the first byte after it."""
    first = data[:512].split(b"\n", 1)[0].decode("latin-1").rstrip("\r")
    start = 0
    if first.startswith("\xef\xbb\xbf"):
        first, start = first[3:], 3
    header = _Header()
    _read_version(first, header, path)
    pos = data.find(b"\n", start) + 1
    if pos == 0:
        raise FormatError("the file ends within its header; fetch it again", path=path, line_number=1)
    line_number = 1
    ended = False
    while pos < len(data):
        end = data.find(b"\n", pos)
        end = len(data) if end < 0 else end
        raw = data[pos:end]
        line = raw.decode("latin-1").rstrip("\r")
        label = line[60:80].strip()
        line_number += 1
        if line_number > _MAX_HEADER_LINES:
            raise FormatError(
                "the header does not end; this is no RINEX observation file or a damaged one, fetch it again",
                path=path,
                line_number=line_number,
            )
        if label == "END OF HEADER":
            pos = end + 1
            ended = True
            break
        if _begins_body(line, header.old):
            break
        _read_header_line(line, label, header, path, line_number)
        pos = end + 1
    if not header.types:
        kind = "# / TYPES OF OBSERV" if header.old else "SYS / # / OBS TYPES"
        raise FormatError(
            f"the header has no '{kind}' line, so the columns have no names; fetch the file again",
            path=path,
            line_number=line_number,
        )
    if not ended:
        header.warnings.append("END OF HEADER is missing")
    return header, min(pos, len(data))


def _read_version(line, header, path):
    label = line[60:80].strip()
    if label != "RINEX VERSION / TYPE":
        raise FormatError(
            "this is not a RINEX file: the first line does not end in 'RINEX VERSION / TYPE'; give a RINEX "
            "observation file or a UBX log",
            path=path,
            line_number=1,
        )
    try:
        header.version = float(line[:20].split()[0])
    except (ValueError, IndexError):
        raise FormatError(
            f"the RINEX version {line[:20].strip()!r} is not a number; the file is damaged, fetch it again",
            path=path,
            line_number=1,
        ) from None
    kind = line[20:21].upper()
    if kind in "NGHL" and kind.strip():
        raise FormatError(
            "this is a RINEX navigation file; give it as navigation, and an observation file here",
            path=path,
            line_number=1,
        )
    if kind != "O":
        names = {"M": "meteorological", "C": "clock"}
        raise FormatError(
            f"this is a RINEX {names.get(kind, 'file of type ' + repr(kind))} file and observations are "
            "expected; give a RINEX observation file",
            path=path,
            line_number=1,
        )
    if not 2.0 <= header.version < 5.0:
        raise FormatError(
            f"RINEX version {line[:20].strip()} is not known; versions 2 to 4 are read, convert the file",
            path=path,
            line_number=1,
        )
    header.version_text = f"{header.version:.2f}"
    header.file_system = line[40:41].upper()


def _begins_body(line, old):
    """Whether a line of the header section is really the first epoch line."""
    if not old:
        return line.startswith("> ")
    label = line[60:80]
    return (
        len(line) >= 32
        and line[0] == " "
        and line[18:19] == "."
        and line[1:3].strip().isdigit()
        and line[28] in " 0123456"
        and line[29:32].strip().isdigit()
        and not (label.strip().isupper() and " / " in label)
    )


def _floats(text):
    values = [float(word) for word in text.split()]
    if not all(np.isfinite(values)):
        raise ValueError("not finite")
    return values


def _read_header_line(line, label, header, path, line_number):
    """Take one header line; what cannot be understood and does not matter becomes a warning."""
    body = line[:60]
    meta = header.meta
    try:
        if label in ("COMMENT", ""):
            return
        if label == "MARKER NAME":
            meta.setdefault("marker", body.strip())
        elif label == "REC # / TYPE / VERS":
            meta.setdefault("receiver_serial", body[:20].strip())
            meta.setdefault("receiver_type", body[20:40].strip())
            meta.setdefault("receiver_firmware", body[40:60].strip())
        elif label == "ANT # / TYPE":
            meta.setdefault("antenna_serial", body[:20].strip())
            meta.setdefault("antenna_type", body[20:40].strip())
        elif label == "APPROX POSITION XYZ":
            position = tuple(_floats(body))
            if len(position) == 3 and any(position):
                meta.setdefault("approx_position_ecef_m", position)
        elif label == "ANTENNA: DELTA H/E/N":
            delta = tuple(_floats(body))
            if len(delta) == 3:
                meta.setdefault("antenna_delta_hen_m", delta)
        elif label == "INTERVAL":
            interval = _floats(body[:20])[0]
            if interval > 0:
                meta.setdefault("interval_s", interval)
        elif label == "LEAP SECONDS":
            meta.setdefault("leap_seconds", int(body[:6]))
        elif label == "TIME OF FIRST OBS":
            header.time_system = body[48:51].strip().upper()
        elif label == "WAVELENGTH FACT L1/2":
            _read_wavelength_factor(body, header)
        elif label == "GLONASS SLOT / FRQ #":
            _read_glonass_slots(body, header)
        elif label == "GLONASS COD/PHS/BIS":
            _read_glonass_biases(body, header)
        elif label == "SYS / PHASE SHIFT":
            _read_phase_shift(body, header)
        elif label == "SYS / SCALE FACTOR":
            _read_scale_factor(body, header)
        elif label == "# / TYPES OF OBSERV" and header.old:
            _read_types(body[:6], body[6:], "*", header, path, line_number)
        elif label == "SYS / # / OBS TYPES" and not header.old:
            _read_types(body[3:6], body[6:], body[:1], header, path, line_number)
    except FormatError:
        raise
    except (ValueError, IndexError):
        header.warnings.append(f"line {line_number}: '{label}' cannot be read and is ignored")


def _read_types(count_text, names, system, header, path, line_number):
    if count_text.strip():
        if system != "*" and system not in SYSTEMS:
            header.warnings.append(f"line {line_number}: system {system!r} is not known and is skipped")
            header.continued_system = ""
            return
        try:
            count = int(count_text)
        except ValueError:
            count = -1
        if not 0 <= count <= _MAX_TYPES:
            raise FormatError(
                f"the number of observation types {count_text.strip()!r} makes no sense; the header is "
                "damaged, fetch the file again",
                path=path,
                line_number=line_number,
            )
        header.continued_system = system
        header.types[system] = []
    system = header.continued_system
    if system:
        room = _MAX_TYPES - len(header.types[system])
        header.types[system] += names.split()[:room]


def _read_wavelength_factor(body, header):
    if not body[12:18].strip():  # later lines for single satellites carry their number here
        header.wavelength_factor = (int(body[:6]), int(body[6:12] or 1))


def _read_glonass_slots(body, header):
    for k in range(8):
        item = body[4 + 7 * k : 11 + 7 * k]
        if item.strip() and item[0] == "R":
            slot, channel = int(item[1:3]), int(item[4:6])
            if 1 <= slot < 100 and -7 <= channel <= 24:
                header.channels[slot] = channel


def _read_glonass_biases(body, header):
    for k in range(4):
        item = body[13 * k : 13 * (k + 1)]
        if item[5:].strip():
            header.glonass_bias[item[2:4]] = _floats(item[5:])[0]


def _read_phase_shift(body, header):
    system, code, rest = body[:1], body[2:5].strip(), body[6:14].strip()
    if system in SYSTEMS and len(code) >= 2:
        shift = float(rest) if rest else 0.0
        sats = body[18:].split() if body[16:18].strip() else []
        names = [f"{sat}{code[1:]}" for sat in sats] or [f"{system}{code[1:]}"]
        header.phase_shift.update(dict.fromkeys(names, shift))


def _read_scale_factor(body, header):
    if body[:1].strip():
        system, factor = body[0], float(int(body[2:6]))
        if system not in SYSTEMS or factor not in (1.0, 10.0, 100.0, 1000.0):
            raise ValueError(factor)
        codes = body[10:].split() or [""]
        header.continued_scale = (system, factor)
    else:
        system, factor = header.continued_scale
        codes = body[10:].split()
    for code in codes:
        header.scale[system, code] = factor


# ------------------------------------------------------------------------------- tables for the body


def _signal_columns(header):
    """Per system, a list of (signal, places of C L D S, type names of C L D S)."""
    tables = {}
    for system in SYSTEMS:
        if header.old:
            names = header.types.get("*", [])
            found = _old_signals(system, names)
        else:
            names = header.types.get(system)
            if names is None:
                continue
            found = _new_signals(system, names, header)
        rows = []
        for signal, kinds in found:
            places = [-1] * 4
            labels = [""] * 4
            for kind, index in kinds.items():
                line, offset = (index // 5, 16 * (index % 5)) if header.old else (0, 3 + 16 * index)
                places[_KINDS.index(kind)] = line << 16 | offset
                labels[_KINDS.index(kind)] = names[index]
            rows.append((signal_id(signal), places, labels))
        rows.sort(key=lambda row: row[0])
        tables[system] = rows
    return tables


def _new_signals(system, names, header):
    found = {}
    for index, name in enumerate(names):
        if len(name) not in (2, 3) or name[0] not in _KINDS or name[1] not in "123456789":
            continue
        if len(name) == 3 and not ("A" <= name[2] <= "Z"):
            continue
        signal = name[1:]
        # RINEX 3.02 called the band of B1I by 1; B1C has no I and Q, so these can only be B1I.
        if system == "C" and (signal in ("1I", "1Q") or (signal == "1X" and header.version_text == "3.02")):
            signal = "2" + signal[1]
            note = "BeiDou band 1 is B1I here and is read as band 2"
            if note not in header.warnings:
                header.warnings.append(note)
        found.setdefault(signal, {}).setdefault(name[0], index)
    return list(found.items())


def _old_signals(system, names):
    """Signals of RINEX 2 types; see the table at the top of this module."""
    index = {}
    for k, name in enumerate(names):
        index.setdefault(name, k)
    codes = _OLD_CODES[system]
    found = {}  # by code type, so that two types of one signal stay apart
    for code, signal in codes.items():
        if code in index:
            found[code] = (signal, {"C": index[code]})
    for name, k in index.items():
        if len(name) != 2 or name[0] not in "LDS" or not name[1].isdigit():
            continue
        hosts = [host for host in _OLD_HOST.get(name[1], ("C" + name[1],)) if host in codes]
        if system == "C" and name[1] in "12":
            hosts = ["C" + name[1]]
        if hosts:
            host = next((h for h in hosts if h in index), hosts[0])
            found.setdefault(host, (codes[host], {}))[1][name[0]] = k
    for name, k in index.items():
        if len(name) == 2 and name[0] in _KINDS and name[1] in _OLD_LETTERS:
            signal = _OLD_LETTERS[name[1]]
            host = next((key for key, (s, _) in found.items() if s == signal), "letter " + name[1])
            found.setdefault(host, (signal, {}))[1].setdefault(name[0], k)
    return list(found.values())


def _tables(header):
    """Arrays of `parse_body` that describe the columns."""
    rows_of = _signal_columns(header)
    width = max(1, max((len(rows) for rows in rows_of.values()), default=1))
    n_signals = np.full(len(SYSTEMS), -1, dtype=np.int64)
    signal_ids = np.zeros((len(SYSTEMS), width), dtype=np.int64)
    columns = np.full((len(SYSTEMS), width, 4), -1, dtype=np.int64)
    divisors = np.full((len(SYSTEMS), width, 4), 1000.0)
    half_cycle = np.zeros((len(SYSTEMS), width), dtype=np.uint8)
    for system, rows in rows_of.items():
        code = SYSTEMS.index(system)
        n_signals[code] = len(rows)
        for k, (signal, places, labels) in enumerate(rows):
            signal_ids[code, k] = signal
            columns[code, k] = places
            for o, label in enumerate(labels):
                factor = header.scale.get((system, label), header.scale.get((system, ""), 1.0))
                divisors[code, k, o] = 1000.0 * factor
            band = signal // 100
            if header.old and band in (1, 2) and header.wavelength_factor[band - 1] == 2:
                half_cycle[code, k] = LLI_HALF_CYCLE
    n_types = len(header.types.get("*", []))
    lines_per_sat = max(1, -(-n_types // 5)) if header.old else 1
    return lines_per_sat, n_signals, signal_ids, columns, divisors, half_cycle


_LETTERS = np.full(256, -1, dtype=np.int64)
for _code, _letter in enumerate(SYSTEMS):
    _LETTERS[ord(_letter)] = _code


# ------------------------------------------------------------------------------------------ body

_EPOCH_COLUMNS = {"time_ns": np.int64, "clock_s": np.float64, "flag": np.uint8, "start": np.int64}
_ROW_COLUMNS = {
    "sat": np.int16,
    "signal": np.int16,
    "code_m": np.float64,
    "phase_cyc": np.float64,
    "doppler_hz": np.float64,
    "cn0_dbhz": np.float64,
    "lli": np.uint8,
}


class _Body:
    """The body of a file, read with the kernel from event record to event record.

    Parameters
    ----------
    pieces : iterable of bytes
        The text. It is handed to the kernel up to the last epoch that begins in what has come, so that an
        epoch and its lines are never apart.
    path : str or os.PathLike, optional
        For messages.
    count_lines : bool
        Whether lines are counted from piece to piece, which messages need.
    """

    def __init__(self, pieces, path, *, count_lines=True):
        from .._kernels import rinex_obs as body

        self._path, self._count_lines = path, count_lines
        self._pieces = iter(pieces)
        self._next = next(self._pieces, None)
        self._lines_before = 0
        self._first_line = {}
        self._rows_per_epoch = 64.0
        self.n_epochs = 0
        text = self._follow(b"")
        while self._next is not None and b"END OF HEADER" not in text and len(text) < _LONGEST_EPOCH:
            text = self._follow(text)
        self.header, body_at = _read_header(text, path)
        self._tables = _tables(self.header)
        self._blank_system = SYSTEMS.find(self.header.file_system) if self.header.file_system.strip() else GPS
        if self.header.old and self._blank_system < 0:
            self._blank_system = GPS
        self._state = np.zeros(body.STATE_SIZE, dtype=np.int64)
        # Slots of the state that are places in the text.
        self._places = (body.BAD_FIELD_AT, body.BAD_LINE_AT, body.SHORT_EPOCH_AT)
        self._state[list(self._places)] = -1
        self._load(text, body_at)

    def _follow(self, text):
        """The text and the piece that follows it."""
        text, self._next = text + (self._next or b""), next(self._pieces, None)
        return text

    def _load(self, text, body_at):
        """Give the kernel the text up to the last epoch that begins in it, or all of it at the end."""
        from .._kernels import rinex_obs as body

        cut = len(text)
        while self._next is not None:
            cut = _last_epoch(text, body_at, self.header.old)
            if cut > body_at:
                break
            text = self._follow(text)
            cut = len(text)
        self._data, self._rest = text[:cut], text[cut:]
        data = self._data.ljust(8, b"\n")
        self._text = np.frombuffer(data, dtype=np.uint8)
        # The 64-bit integer at every byte, without a copy. Without the JIT its wrap-around would warn.
        self._words = np.ndarray((len(data) - 7,), dtype="<u8", buffer=data, strides=(1,))
        self._counted = (0, 1)
        self._state[body.POSITION] = body_at

    def _next_piece(self):
        """Go on with the text that follows; false at the end of the file."""
        if self._next is None and not self._rest:
            return False
        if self._count_lines:
            self._note_lines()
            self._lines_before += self._data.count(b"\n")
        self._load(self._rest if self._next is None else self._follow(self._rest), 0)
        return True

    def _line_number(self, position):
        """Line of a position in the text at hand, which only grows from call to call."""
        before, number = self._counted
        if position < before:
            before, number = 0, 1
        number += self._data.count(b"\n", before, position)
        self._counted = position, number
        return self._lines_before + number

    def _note_lines(self):
        """Keep the line numbers of places that are only positions in the text at hand."""
        for place in self._places:
            if self._state[place] >= 0 and place not in self._first_line:
                self._first_line[place] = self._line_number(int(self._state[place]))

    def read(self, most=None):
        """Columns of the next epochs and of their rows, and the event records among them.

        Parameters
        ----------
        most : int, optional
            Epochs to read; all that are left by default.

        Returns
        -------
        epochs, rows : dict of str to ndarray
            Columns; ``time_ns`` in the time scale of the file.
        events : list of tuple
            (index of the epoch that follows in this block, time or None, flag, text).
        """
        from .._kernels import rinex_obs as body
        from .._kernels.jit import IS_COMPILED

        state, header = self._state, self.header
        swift = IS_COMPILED and sys.byteorder == "little"
        n_bytes = len(self._data) - state[body.POSITION]
        n_epochs = n_bytes // 2000 + 256 if most is None else most + 1
        n_rows = n_bytes // 50 + 4096 if most is None else int(1.1 * most * self._rows_per_epoch) + 4096
        epochs = {k: np.empty(n_epochs, dtype=t) for k, t in _EPOCH_COLUMNS.items()}
        rows = {k: np.empty(n_rows, dtype=t) for k, t in _ROW_COLUMNS.items()}
        epochs["start"][0] = 0
        state[[body.N_EPOCHS, body.N_ROWS]] = 0
        events = []
        while True:
            lines_per_sat, *columns = self._tables
            body.parse_body(
                self._text, self._words, swift, state,
                header.old, header.version >= 4.01, self._blank_system, _LETTERS, lines_per_sat, *columns,
                *epochs.values(), *rows.values(),
            )  # fmt: skip
            if state[body.OUTCOME] == body.EVENT:
                if self._take_event(events):
                    self._tables = _tables(header)
            elif state[body.OUTCOME] == body.GROW:
                if most is not None and state[body.N_EPOCHS] >= most:
                    break
                needed = int(state[body.N_ROWS] + state[body.EVENT_COUNT] * columns[1].shape[1])
                _grow(rows, needed)
                if most is None:
                    _grow(epochs, int(state[body.N_EPOCHS]) + 2)
            elif not self._next_piece():
                break
        n_epochs, n_rows = int(state[body.N_EPOCHS]), int(state[body.N_ROWS])
        self.n_epochs += n_epochs
        self._rows_per_epoch = n_rows / max(n_epochs, 1)
        # Shrinking gives the unused pages back without a copy.
        for column in rows.values():
            column.resize(n_rows, refcheck=False)
        for name, column in epochs.items():
            column.resize(n_epochs + (name == "start"), refcheck=False)
        return epochs, rows, events

    def _take_event(self, events):
        """Consume one event record; true when the columns may have changed."""
        from .._kernels import rinex_obs as body

        state, header, data = self._state, self.header, self._data
        flag, count = int(state[body.EVENT_FLAG]), int(state[body.EVENT_COUNT])
        pos = int(state[body.POSITION])
        n_lines = count
        if flag == 6:
            n_lines = count * self._tables[0] + (max(0, (count - 1) // 12) if header.old else 0)
        lines = []
        while len(lines) < n_lines and pos < len(data):
            end = data.find(b"\n", pos)
            end = len(data) if end < 0 else end
            line = data[pos:end].decode("latin-1").rstrip("\r")
            if _begins_body(line, header.old):
                break
            lines.append(line)
            pos = end + 1
        # What follows the text at hand begins with an epoch, too.
        if len(lines) < n_lines and (pos < len(data) or self._rest or self._next is not None):
            number = self._line_number(pos)
            header.warnings.append(f"line {number}: an event record has fewer lines than it says")
        state[body.POSITION] = min(pos, len(data))
        time = int(state[body.EVENT_TIME])
        text = "\n".join(x.rstrip() for x in lines)
        events.append((int(state[body.N_EPOCHS]), None if time == body.NO_TIME else time, flag, text))
        if flag == 6 or not lines:
            return False
        number = self._line_number(int(state[body.EVENT_AT]))
        labels = [line[60:80].strip() for line in lines]
        for k, (line, label) in enumerate(zip(lines, labels, strict=True)):
            _read_header_line(line, label, header, self._path, number + 1 + k)
        return not _LABELS_OF_COLUMNS.isdisjoint(labels)

    def judge(self):
        """Turn the counts of the whole body into warnings, or an error when nothing could be read."""
        from .._kernels import rinex_obs as body

        state, header = self._state, self.header
        self._note_lines()
        if self.n_epochs == 0:
            if state[body.BAD_LINES] > 0:
                raise FormatError(
                    "no epoch can be read: this line is not an epoch of a RINEX "
                    f"{header.version_text} observation file; check the version in the first line",
                    path=self._path,
                    line_number=self._first_line[body.BAD_LINE_AT],
                )
            header.warnings.append("the file holds a header and no observations")
        for count, at, what in (
            (body.BAD_FIELDS, body.BAD_FIELD_AT, "{} values cannot be read and are left out"),
            (body.BAD_LINES, body.BAD_LINE_AT, "{} lines cannot be read and are left out"),
            (body.SHORT_EPOCHS, body.SHORT_EPOCH_AT, "{} epochs have fewer satellites than they announce"),
        ):
            if state[count] > 0:
                place = self._first_line[at]
                header.warnings.append(what.format(int(state[count])) + f" (first in line {place})")
        if state[body.LAST_GOT] < state[body.LAST_EXPECTED]:
            got, expected = state[body.LAST_GOT], state[body.LAST_EXPECTED]
            header.warnings.append(f"the last epoch is cut off: {got} of {expected} satellites kept")
        if state[body.UNDECLARED] > 0:
            header.warnings.append(
                f"{state[body.UNDECLARED]} satellite lines of systems without declared observation types "
                "skipped"
            )


def _grow(columns, needed):
    for column in columns.values():
        column.resize(max(needed, len(column) + len(column) // 2), refcheck=False)


def _last_epoch(text, after, old):
    """Where the last epoch (or event) of a text begins, the last line apart; `after` or less where none."""
    end = text.rfind(b"\n", after)
    if not old:
        found = text.rfind(b"\n> ", after) + 1
        if found > after:
            return found
        end = after
    while end > after:
        start = text.rfind(b"\n", after, end) + 1
        if start <= after:
            break
        if _begins_body(text[start:end].decode("latin-1").rstrip("\r"), True):
            return start
        end = start - 1
    # Megabytes without an epoch are no observations: any line will do.
    return text.rfind(b"\n", after) + 1 if len(text) - after > _LONGEST_EPOCH else 0


# --------------------------------------------------------------------------------------- result


def _to_gpst(time_ns, header):
    """Time tags of the file's scale in GPS time."""
    name = header.time_system or _TIME_SYSTEM_OF_FILE.get(header.file_system, "GPS")
    if name not in _TIME_SYSTEMS:
        note = f"time system {name!r} is not known; GPS time is assumed"
        if note not in header.warnings:
            header.warnings.append(note)
        name = "GPS"
    offset = _TIME_SYSTEMS[name]
    return gpst_from_utc_ns(time_ns) if offset is None else time_ns + offset


def _increasing(time_ns, header):
    """Indices of the epochs to keep, or None for all: the first of equal ones, and no outliers.

    The largest set in increasing order; what is dropped is said in the warnings of the header.
    """
    from bisect import bisect_left

    if len(time_ns) < 2 or np.all(np.diff(time_ns) > 0):
        return None
    candidates = np.sort(np.unique(time_ns, return_index=True)[1])
    times = time_ns[candidates].tolist()
    tails, tail_at, before = [], [], []
    for k, time in enumerate(times):  # patience sorting
        place = bisect_left(tails, time)
        before.append(tail_at[place - 1] if place else -1)
        tails[place : place + 1] = [time]
        tail_at[place : place + 1] = [k]
    chain = []
    k = tail_at[-1] if tail_at else -1
    while k >= 0:
        chain.append(k)
        k = before[k]
    keep = candidates[chain[::-1]]
    dropped = np.setdiff1d(np.arange(len(time_ns)), keep)
    header.warnings.append(
        f"{len(dropped)} epochs repeat a time or go back in time and are dropped "
        f"(first: {format_gpst(time_ns[dropped[0]])} GPST)"
    )
    return keep


class _Finish:
    """Columns of the kernel as `Observations`, with what the whole file says about itself."""

    def __init__(self, header, path):
        self.header = header
        warnings = header.warnings[:_MAX_WARNINGS]
        if len(header.warnings) > _MAX_WARNINGS:
            warnings.append(f"and {len(header.warnings) - _MAX_WARNINGS} more warnings")
        self._glonass_channel = np.full(100, NO_CHANNEL, dtype=np.int8)
        for slot, channel in header.channels.items():
            self._glonass_channel[slot] = channel
        self.meta = ObservationMeta(
            path="" if path is None else str(path),
            format=FORMAT,
            version=header.version_text,
            phase_shift_cyc=header.phase_shift,
            glonass_code_phase_bias_m=header.glonass_bias,
            warnings=tuple(warnings),
            **header.meta,
        )

    def __call__(self, time_ns, epochs, rows, events):
        start, lli = epochs["start"], rows["lli"]
        for k in np.flatnonzero(epochs["flag"] == 1):
            part = slice(start[k], start[k + 1])
            lli[part][np.isfinite(rows["phase_cyc"][part])] |= LLI_SLIP
            events.append((int(k), int(epochs["time_ns"][k]), 1, "power failure before this epoch"))
        events.sort(key=lambda event: (event[0], event[2] == 1))  # file order
        return Observations(
            time_ns=time_ns,
            epoch_start=start,
            **rows,
            clock_offset_s=epochs["clock_s"],
            glonass_channel=self._glonass_channel,
            events=tuple(
                ObservationEvent(None if t is None else int(_to_gpst(t, self.header)), flag, text)
                for _, t, flag, text in events
            ),
            meta=self.meta,
        )
