"""SP3 precise orbits, versions a, b, c and d.

A header of lines that begin with ``#``, ``+``, ``%`` and ``/*``; then for each epoch a line ``*`` and,
for each satellite, a line ``P`` with position (kilometres) and clock (microseconds).

Reference: S. Hilla, "The Extended Standard Product 3 Orbit Format (SP3-d)", 2016.
"""

from datetime import UTC, datetime

import numpy as np

from ..constants import SYSTEMS
from ..errors import FormatError
from ..navigation import PreciseOrbits
from ..timescales import BDT_OFFSET_NS, NS_PER_DAY, NS_PER_S, gpst_from_utc_ns
from .compression import read_bytes

__all__ = ["parse_sp3", "read_sp3"]

_WIDTH = 14
_N_VALUES = 4
_NO_CLOCK_US = 999_999.0
_LARGEST = 1e9  # a number of this format has at most 14 columns, 7 of them before the point
_TAI_MINUS_GPST_NS = 19 * NS_PER_S


def read_sp3(path):
    """Read an SP3 file, compressed or not.

    Parameters
    ----------
    path : str or path-like
        The file.

    Returns
    -------
    PreciseOrbits

    Raises
    ------
    FormatError
        If the file is not SP3 or a line cannot be read; with the line number.
    """
    return parse_sp3(read_bytes(path), path=str(path))


def parse_sp3(data, *, path=None):
    """Read SP3 text, see `read_sp3`.

    Parameters
    ----------
    data : bytes
        The whole text.
    path : str, optional
        Name for messages.

    Returns
    -------
    PreciseOrbits

    Raises
    ------
    FormatError
        As `read_sp3`.
    """
    lines = data.splitlines()

    def error(index, message):
        return FormatError(message, path=path, line_number=index + 1)

    first = lines[0] if lines else b""
    if first[:1] != b"#" or first[1:2] not in (b"a", b"b", b"c", b"d"):
        raise error(
            0, "not SP3: the first line does not begin with `#a`, `#b`, `#c` or `#d`; give an SP3 file"
        )
    header_sats, exponents, scale = [], [], None
    epoch_ns, epoch_of_row, rows = [], [], []
    for index, line in enumerate(lines):
        mark = line[:1]
        if mark == b"P":
            if len(line) < 4 + _WIDTH * 3:
                if index >= len(lines) - 1:
                    break  # the last line of a cut file
                raise error(index, "the position line is too short; repair or remove it")
            if not epoch_ns:
                raise error(index, "a position stands before the first epoch; the file is damaged")
            rows.append(index)
            epoch_of_row.append(len(epoch_ns) - 1)
        elif mark == b"*":
            if index == len(lines) - 1:
                break
            epoch_ns.append(_epoch(error, index, line))
            if len(epoch_ns) > 1 and epoch_ns[-1] <= epoch_ns[-2]:
                raise error(index, "the epoch is not later than the one before; repair the file")
        elif line[:2] == b"++":
            exponents += [line[k : k + 3] for k in range(9, 60, 3)]
        elif line[:2] == b"+ ":
            header_sats += [line[k : k + 3] for k in range(9, 60, 3)]
        elif line[:2] == b"%c" and scale is None:
            scale = line[9:12].decode("ascii", "replace").strip()
        elif line[:3] == b"EOF":
            break
    if not rows:
        raise error(len(lines) - 1, "the file holds no positions; give a complete SP3 file")
    values = _values(error, lines, rows)
    row_sat = np.array([_sat(error, index, lines[index][1:4]) for index in rows])
    sat, column = np.unique(row_sat, return_inverse=True)
    position = np.full((len(epoch_ns), len(sat), 3), np.nan)
    clock = np.full((len(epoch_ns), len(sat)), np.nan)
    # A position of zeros and a clock of 999999.999999 mean that there is none.
    values[np.all(values[:, :3] == 0.0, axis=1), :3] = np.nan
    values[np.abs(values[:, 3]) >= _NO_CLOCK_US, 3] = np.nan
    position[epoch_of_row, column] = 1e3 * values[:, :3]
    clock[epoch_of_row, column] = 1e-6 * values[:, 3]
    return PreciseOrbits(
        time_ns=_to_gpst(np.array(epoch_ns, dtype=np.int64), scale or ""),
        sat=sat.astype(np.int16),
        position_ecef_m=position,
        clock_s=clock,
        sd_m=_accuracies(sat, header_sats, exponents),
        frame=first[46:51].decode("ascii", "replace").strip(),
        agency=first[56:60].decode("ascii", "replace").strip(),
        path=path or "",
    )


def _epoch(error, index, line):
    try:
        words = line[1:31].split()
        year, month, day, hour, minute = (int(word) for word in words[:5])
        second = float(words[5])
        if not (1980 <= year < 2100 and 0 <= hour <= 24 and 0 <= minute <= 60 and 0.0 <= second <= 61.0):
            raise ValueError
        days = datetime(year, month, day, tzinfo=UTC).toordinal() - datetime(1980, 1, 6).toordinal()
    except (ValueError, IndexError):
        shown = line[1:31].decode("ascii", "replace").strip()
        raise error(index, f"{shown!r} is not a time; repair the epoch line") from None
    return days * NS_PER_DAY + (hour * 3600 + minute * 60) * NS_PER_S + round(second * NS_PER_S)


def _to_gpst(time_ns, scale):
    """Epochs in GPS time; an unset scale (``ccc``) and those steered to GPS time stay."""
    if scale in ("UTC", "GLO"):
        return gpst_from_utc_ns(time_ns)
    if scale == "BDT":
        return time_ns + BDT_OFFSET_NS
    if scale == "TAI":
        return time_ns - _TAI_MINUS_GPST_NS
    return time_ns


def _sat(error, index, field):
    name = field.decode("ascii", "replace")
    letter = name[0] if name[0] in SYSTEMS else "G"  # version a has numbers only, and they are GPS
    number = name[1:] if name[0] in SYSTEMS else name
    try:
        value = int(number)
    except ValueError:
        value = 0
    if not 0 < value < 100:
        raise error(index, f"{name!r} is not a satellite; repair or remove the line")
    return SYSTEMS.index(letter) * 100 + value


def _values(error, lines, rows):
    size = _WIDTH * _N_VALUES
    joined = b"".join([lines[index][4 : 4 + size].ljust(size) for index in rows])
    cells = np.frombuffer(joined, dtype=f"S{_WIDTH}").reshape(len(rows), _N_VALUES)
    blank = np.all(cells.view(np.uint8).reshape(*cells.shape, _WIDTH) == ord(" "), axis=2)
    blank[:, :3] = False
    cells = np.where(blank, b"999999.999999", cells)
    try:
        values = cells.astype(np.float64)
    except ValueError:
        values = np.array([[_number(cell) for cell in row] for row in cells])
    bad = np.argwhere(~(np.abs(values) < _LARGEST))
    if len(bad):
        row, place = bad[0]
        shown = bytes(cells[row, place]).decode("ascii", "replace").strip()
        raise error(rows[row], f"{shown!r} is not a number; repair or remove the line")
    return values


def _number(cell):
    try:
        return float(cell)
    except ValueError:
        return np.nan


def _accuracies(sat, header_sats, exponents):
    """One sigma of the orbits, 2^n millimetres, in the order of the satellites."""
    known = {}
    for field, exponent in zip(header_sats, exponents, strict=False):
        name = field.decode("ascii", "replace").strip()
        digits = exponent.strip()
        if name in ("", "0") or not digits.isdigit() or not 0 < int(digits) < 40:
            continue
        letter, number = (name[0], name[1:]) if name[0] in SYSTEMS else ("G", name)
        if number.strip().isdigit():
            known[SYSTEMS.index(letter) * 100 + int(number)] = 1e-3 * 2.0 ** int(digits)
    return np.array([known.get(int(s), np.nan) for s in sat])
