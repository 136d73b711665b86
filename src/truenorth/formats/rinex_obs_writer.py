"""Writing RINEX 3.05 observation files, whole or block after block of epochs.

- Observables are written as F14.3; the nearest multiple of 0.001, so values that are such multiples come
  back unchanged. RINEX has no zero: a value below 0.0005 is written as 0.000 and read as missing.
- Time tags have 100 ns. They are GPS time, whatever the systems.
- Behind code and phase stands the signal strength digit, ``min(max(floor(C/N0 / 6), 1), 9)``; behind the
  phase the loss-of-lock bits 0 (slip) and 1 (half cycle), blank for none.
- What is not known is left out or blank, as the standard says; nothing depends on the clock or the
  computer, so equal observations give equal bytes.

Reference: IGS/RTCM, RINEX 3.05, 2020, tables A2 and A3.
"""

from dataclasses import replace

import numpy as np

from ..constants import BEIDOU, GALILEO, GLONASS, GPS, NAVIC, QZSS, SBAS, SYSTEM_NAMES, SYSTEMS
from ..errors import FormatError
from ..observations import (
    NO_CHANNEL,
    ObservationEvent,
    ObservationMeta,
    sat_name,
    signal_id,
    signal_name,
)
from ..timescales import NS_PER_S, format_gpst, gpst_to_datetime64, leap_seconds
from .compression import open_for_writing

__all__ = ["RinexObservationWriter", "observation_types", "write_rinex_observations"]

VERSION = "3.05"

_KINDS = "CLDS"
_VALUES = ("code_m", "phase_cyc", "doppler_hz", "cn0_dbhz")
_ORDER = (GPS, GLONASS, GALILEO, QZSS, BEIDOU, NAVIC, SBAS)
_NS_PER_TICK = 100
_TICKS_PER_DAY = 864_000_000_000
_HEAD_BYTES = 57  # of the longest epoch line with its line feed
_ROWS_AT_ONCE = 16_384
_LOWEST, _HIGHEST = -999_999_999_999, 9_999_999_999_999  # thousandths that have room in F14.3
_GLONASS_BIASES = ("C1C", "C1P", "C2C", "C2P")
_EVENT_FLAGS = (2, 3, 4, 5)
# Header lines within the file that would change what the columns mean.
_COLUMN_LABELS = ("SYS / # / OBS TYPES", "# / TYPES OF OBSERV", "SYS / SCALE FACTOR", "WAVELENGTH FACT L1/2")


def observation_types(observations):
    """RINEX observation types that some observations hold.

    Parameters
    ----------
    observations : Observations

    Returns
    -------
    dict of str to tuple of str
        By system letter, e.g. ``{"G": ("C1C", "L1C", "D1C", "S1C")}``; sorted by signal.
    """
    types = {}
    keys, row_key = np.unique(observations.sat // 100 * 1000 + observations.signal, return_inverse=True)
    held = np.zeros((len(keys), 4), dtype=bool)
    for kind, name in enumerate(_VALUES):
        held[row_key[np.isfinite(getattr(observations, name))], kind] = True
    held[row_key[(observations.lli & 3) != 0], 1] = True
    for system in _ORDER:
        names = []
        for key, there in zip(keys.tolist(), held, strict=True):
            if key // 1000 == system:
                signal = signal_name(key % 1000).replace("?", "")
                names += [kind + signal for kind, held_kind in zip(_KINDS, there, strict=True) if held_kind]
        if names:
            types[SYSTEMS[system]] = tuple(names)
    return types


def write_rinex_observations(path, observations, **header):
    """Write observations to a RINEX 3.05 file.

    Parameters
    ----------
    path : str or os.PathLike
        The file; packed by gzip when the name ends in ``.gz``.
    observations : Observations
        What to write, with its events of flags 2 to 5.
    **header
        As the parameters of `RinexObservationWriter`. What `ObservationMeta` holds is taken from
        ``observations.meta`` where it is not given here.

    Raises
    ------
    FormatError
        If a value has no room in its field, or the file cannot be written.
    """
    meta = {
        name: getattr(observations.meta, name) for name in _META_NAMES if getattr(observations.meta, name)
    }
    header = {"types": observation_types(observations), **meta, **header}
    with RinexObservationWriter(path, **header) as writer:
        writer.write_block(observations)


_META_NAMES = (
    "marker", "receiver_type", "receiver_serial", "receiver_firmware", "antenna_type", "antenna_serial",
    "approx_position_ecef_m", "antenna_delta_hen_m", "interval_s", "leap_seconds", "phase_shift_cyc",
    "glonass_code_phase_bias_m",
)  # fmt: skip


class RinexObservationWriter:
    """A RINEX 3.05 observation file that grows by blocks of epochs.

    The header is written with the first block, which gives the time of the first epoch.

    Parameters
    ----------
    path : str or os.PathLike
        The file; packed by gzip when the name ends in ``.gz``.
    types : dict of str to sequence of str, optional
        By system letter, the observation types of all blocks (``"C1C"``), or signals (``"1C"``) for
        code, phase, Doppler and C/N0 of them. By default those of the first block.
    glonass_channel : ndarray of int8, shape (100,), optional
        Frequency channel by slot for the header; by default that of the first block.
    program, run_by, observer, agency : str
        For the header.
    date_ns : int, optional
        GPS time at which the file is said to be made; by default that of the first epoch.
    comments : sequence of str
        Comment lines, cut at 60 characters.
    **meta
        Fields of `truenorth.observations.ObservationMeta` for the header: ``marker``, ``receiver_type``,
        ``receiver_serial``, ``receiver_firmware``, ``antenna_type``, ``antenna_serial``,
        ``approx_position_ecef_m``, ``antenna_delta_hen_m``, ``interval_s``, ``leap_seconds``,
        ``phase_shift_cyc``, ``glonass_code_phase_bias_m``.

    Raises
    ------
    FormatError
        If the file cannot be opened.
    """

    def __init__(
        self, path, *, types=None, glonass_channel=None,
        program="TrueNorth", run_by="", observer="", agency="", date_ns=None, comments=(), **meta,
    ):  # fmt: skip
        self._path = path
        self._types = None if types is None else _full_types(types)
        self._glonass_channel = glonass_channel
        self._lines = {"program": program, "run_by": run_by, "observer": observer, "agency": agency}
        self._date_ns = date_ns
        self._comments = comments
        self._meta = replace(ObservationMeta(), **meta)
        self._tables = None
        self._last_ns = None
        self._file = open_for_writing(path)

    def __enter__(self):
        """Return the writer; leaving closes the file."""
        return self

    def __exit__(self, *_):
        """Close the file."""
        self.close()

    def close(self):
        """Finish the file. A file without epochs gets a header if its types were declared."""
        if self._file.closed:
            return
        try:
            if self._tables is None and self._types:
                self._write_header(None)
        finally:
            self._file.close()

    def write_block(self, observations):
        """Append epochs.

        Parameters
        ----------
        observations : Observations
            Epochs later than those of the block before, with events of flags 2 to 5.

        Raises
        ------
        FormatError
            If an epoch is not later than the one before, a signal or type was not declared, or a value
            has no room in its field.
        """
        time_ns = observations.time_ns
        if self._tables is None and (observations.n_epochs or observations.events):
            self._write_header(observations)
        if observations.n_epochs:
            times = time_ns if self._last_ns is None else np.concatenate(([self._last_ns], time_ns))
            ticks = _ticks(times)
            if np.any(np.diff(ticks) <= 0):
                at = int(np.flatnonzero(np.diff(ticks) <= 0)[0]) + 1
                raise FormatError(
                    f"the epoch {format_gpst(times[at], decimals=7)} GPST is not later than the one before; "
                    "write the blocks in order of time",
                    path=self._path,
                )
            self._last_ns = int(time_ns[-1])
        flag = np.zeros(observations.n_epochs, dtype=np.uint8)
        done = 0
        for event in observations.events:
            if event.flag == 1 and event.time_ns is not None:
                flag[time_ns == event.time_ns] = 1
        for event in observations.events:
            if event.flag in _EVENT_FLAGS:
                if event.time_ns is not None:
                    upto = max(done, int(np.searchsorted(time_ns, event.time_ns)))
                    self._write_epochs(observations, flag, done, upto)
                    done = upto
                self._file.write(_event_text(event))
        self._write_epochs(observations, flag, done, observations.n_epochs)

    def _write_header(self, observations):
        if self._types is None:
            self._types = observation_types(observations)
        if not self._types:
            raise FormatError(
                "the first block of epochs holds no observations, so the columns of the file are unknown; "
                "declare its observation types",
                path=self._path,
            )
        channel = self._glonass_channel
        if channel is None and observations is not None:
            channel = observations.glonass_channel
        first_ns = None
        if observations is not None and observations.n_epochs:
            first_ns = int(observations.time_ns[0])
        date_ns = first_ns if self._date_ns is None else self._date_ns
        text = _header_text(
            self._types, self._meta, channel, first_ns, date_ns, self._comments, **self._lines
        )
        self._file.write(text.encode("ascii", "replace"))
        self._tables = _tables(self._types)

    def _write_epochs(self, observations, flag, first, last):
        """Write epochs in pieces that stay in the processor's cache."""
        start = observations.epoch_start
        while first < last:
            stop = int(np.searchsorted(start, start[first] + _ROWS_AT_ONCE, side="right")) - 1
            stop = min(max(stop, first + 1), last)
            self._file.write(self._body(observations, flag, first, stop))
            first = stop

    def _body(self, observations, flag, first, last):
        from .._kernels.rinex_write import write_epochs

        letters, places, line_bytes = self._tables
        start = observations.epoch_start[first : last + 1]
        rows = slice(int(start[0]), int(start[-1]))
        sat, signal = observations.sat[rows], observations.signal[rows]
        mantissa, field_at = self._fields(observations, rows, places[sat // 100, signal])
        new_line = np.ones(len(sat) + 1, dtype=np.int64)
        new_line[1:-1] = sat[1:] != sat[:-1]
        new_line[start[:-1] - rows.start] = 1
        lines_before = np.concatenate(([0], np.cumsum(new_line[:-1])))
        n_sats = np.diff(lines_before[start - rows.start])
        heads, head_bytes = self._heads(
            observations.time_ns[first:last],
            flag[first:last],
            n_sats,
            observations.clock_offset_s[first:last],
        )
        with np.errstate(invalid="ignore"):
            strength = np.clip(observations.cn0_dbhz[rows] // 6.0, 1, 9)
        out = np.empty(heads.size + int(lines_before[-1]) * line_bytes, dtype=np.uint8)
        n_bytes = write_epochs(
            out, line_bytes, letters, heads, head_bytes,
            np.ascontiguousarray(start - rows.start),
            np.require(sat, np.int16, "CW"),
            mantissa, field_at,
            observations.lli[rows] & np.uint8(3),
            np.nan_to_num(strength, nan=0.0).astype(np.uint8),
        )  # fmt: skip
        return out[:n_bytes].data

    def _fields(self, observations, rows, field_at):
        """Values in units of 0.001 and their places; refuses what has no place or no room."""
        from .._kernels.rinex_write import MISSING

        values = np.column_stack([getattr(observations, name)[rows] for name in _VALUES])
        there = np.isfinite(values)
        needed = there.copy()
        needed[:, 1] |= (observations.lli[rows] & 3) != 0
        units = np.rint(np.clip(np.where(there, values, 0.0), -1e12, 1e12) * 1000.0)
        wide = (units > _HIGHEST) | (units < _LOWEST)
        for bad, why in (
            (needed & (field_at < 0), "and is not declared in the header; declare the types of all epochs"),
            (wide, "that has no room in a field F14.3; it must lie within -999999999.999 and 9999999999.999"),
        ):
            if np.any(bad):
                row, kind = (int(k[0]) for k in np.nonzero(bad))
                epoch = int(np.searchsorted(observations.epoch_start, rows.start + row, side="right")) - 1
                name = sat_name(int(observations.sat[rows.start + row]))
                name += " " + _KINDS[kind] + signal_name(int(observations.signal[rows.start + row]))
                raise FormatError(
                    f"{name} at {format_gpst(observations.time_ns[epoch])} GPST has the value "
                    f"{values[row, kind]} {why}",
                    path=self._path,
                )
        mantissa = np.where(there, units.astype(np.int64), MISSING)
        return mantissa, field_at

    def _heads(self, time_ns, flag, n_sats, clock_s):
        """Epoch lines as rows of bytes, and how many bytes of each count."""
        clock = np.isfinite(clock_s)
        picoseconds = np.rint(np.clip(np.where(clock, np.abs(clock_s), 0.0), 0.0, 1e3) * 1e12)
        if np.any(n_sats > 999) or np.any(picoseconds >= np.where(clock_s < 0, 1e13, 1e14)):
            raise FormatError(
                "an epoch has more than 999 satellites, or a receiver clock offset without room in its field "
                "F15.12; it must lie within -9.9 s and 99.9 s",
                path=self._path,
            )
        picoseconds = picoseconds.astype(np.int64)
        ticks = _ticks(time_ns)
        day = gpst_to_datetime64(ticks // _TICKS_PER_DAY * _TICKS_PER_DAY * _NS_PER_TICK).astype("M8[D]")
        month = day.astype("M8[M]")
        year = day.astype("M8[Y]").astype(np.int64) + 1970
        of_year = month.astype(np.int64) % 12 + 1
        of_month = (day - month).astype(np.int64) + 1
        minutes, in_minute = ticks // 600_000_000, ticks % 600_000_000
        heads = np.full((len(time_ns), _HEAD_BYTES), ord(" "), dtype=np.uint8)
        heads[:, 0] = ord(">")
        for end, value, n_digits, zeros in (
            (6, year, 4, True),
            (9, of_year, 2, True),
            (12, of_month, 2, True),
            (15, minutes // 60 % 24, 2, True),
            (18, minutes % 60, 2, True),
            (21, in_minute // 10_000_000, 2, False),
            (29, in_minute % 10_000_000, 7, True),
            (32, flag.astype(np.int64), 1, True),
            (35, n_sats, 3, False),
        ):
            _put(heads, end, value, n_digits, zeros)
        heads[:, 21] = ord(".")
        if np.any(clock):
            clocks = np.full((len(time_ns), _HEAD_BYTES - 35), ord(" "), dtype=np.uint8)
            _put(clocks, 8, picoseconds // 10**12, 2, False)
            _put(clocks, 21, picoseconds % 10**12, 12, True)
            clocks[:, 8] = ord(".")
            clocks[(clock_s < 0) & (picoseconds > 0), 6] = ord("-")
            clocks[:, -1] = ord("\n")
            heads[clock, 35:] = clocks[clock]
        heads[~clock, 35] = ord("\n")
        return heads, np.where(clock, _HEAD_BYTES, 36)


def _ticks(time_ns):
    """Time in units of 100 ns, the resolution of an epoch line."""
    return (time_ns + _NS_PER_TICK // 2) // _NS_PER_TICK


def _put(lines, end, value, n_digits, zeros):
    """Write integers into columns of text so that they end before `end`; leading zeros, or blanks."""
    for k in range(n_digits):
        digit = value // 10**k
        shown = ord("0") + digit % 10
        lines[:, end - 1 - k] = shown if zeros or k == 0 else np.where(digit > 0, shown, ord(" "))


def _full_types(types):
    """Types by system letter in the order of the header, with signals spelt out."""
    unknown = set(types) - set(SYSTEMS)
    if unknown:
        raise FormatError(
            f"there is no satellite system {sorted(unknown)[0]!r}; the systems are {', '.join(SYSTEM_NAMES)}"
        )
    full = {}
    for system in (SYSTEMS[code] for code in _ORDER):
        names = []
        for name in types.get(system, ()):
            new = [name] if name[0] in _KINDS else [kind + name for kind in _KINDS]
            names += [each for each in new if each not in names]
        if names:
            full[system] = tuple(names)
    return full


def _tables(types):
    """Letters of the systems, places of all fields by system, signal and kind, longest line."""
    letters = np.frombuffer(SYSTEMS.encode(), dtype=np.uint8).copy()
    places = np.full((len(SYSTEMS), 1000, len(_KINDS)), -1, dtype=np.int64)
    for letter, names in types.items():
        for column, name in enumerate(names):
            places[SYSTEMS.index(letter), signal_id(name[1:]), _KINDS.index(name[0])] = 3 + 16 * column
    return letters, places, 3 + 16 * max(len(names) for names in types.values()) + 1


# --------------------------------------------------------------------------------------- header


def _line(content, label):
    return f"{content[:60]:<60}{label:<20}\n"


def _header_text(types, meta, channel, first_ns, date_ns, comments, *, program, run_by, observer, agency):
    systems = "".join(types)
    kind = f"M: {'Mixed':<17}" if len(systems) > 1 else f"{systems}: {SYSTEM_NAMES[systems]:<17}"
    lines = [_line(f"{VERSION:>9}{'':11}{'OBSERVATION DATA':<20}{kind:<20}", "RINEX VERSION / TYPE")]
    lines.append(_line(f"{program:<20.20}{run_by:<20.20}{_date(date_ns):<20}", "PGM / RUN BY / DATE"))
    lines += [_line(comment, "COMMENT") for comment in comments]
    lines.append(_line(meta.marker, "MARKER NAME"))
    lines.append(_line(f"{observer:<20.20}{agency:<40.40}", "OBSERVER / AGENCY"))
    receiver = f"{meta.receiver_serial:<20.20}{meta.receiver_type:<20.20}{meta.receiver_firmware:<20.20}"
    lines.append(_line(receiver, "REC # / TYPE / VERS"))
    lines.append(_line(f"{meta.antenna_serial:<20.20}{meta.antenna_type:<20.20}", "ANT # / TYPE"))
    if meta.approx_position_ecef_m is not None:
        text = "".join(f"{value:14.4f}" for value in meta.approx_position_ecef_m)
        lines.append(_line(text, "APPROX POSITION XYZ"))
    delta = meta.antenna_delta_hen_m or (0.0, 0.0, 0.0)
    lines.append(_line("".join(f"{value:14.4f}" for value in delta), "ANTENNA: DELTA H/E/N"))
    for system, names in types.items():
        for k in range(0, len(names), 13):
            count = f"{system}  {len(names):3d}" if k == 0 else " " * 6
            lines.append(
                _line(count + "".join(f" {name:<3}" for name in names[k : k + 13]), "SYS / # / OBS TYPES")
            )
    lines.append(_line("DBHZ", "SIGNAL STRENGTH UNIT"))
    if meta.interval_s is not None:
        lines.append(_line(f"{meta.interval_s:10.3f}", "INTERVAL"))
    if first_ns is not None:
        lines.append(_line(_first_epoch(first_ns), "TIME OF FIRST OBS"))
    lines += _phase_shift_lines(types, meta.phase_shift_cyc)
    if "R" in types:
        lines += _glonass_lines(channel, meta.glonass_code_phase_bias_m)
    if meta.leap_seconds is not None:
        lines.append(_line(f"{meta.leap_seconds:6d}", "LEAP SECONDS"))
    lines.append(_line("", "END OF HEADER"))
    return "".join(lines)


def _date(gpst_ns):
    """UTC as in the first lines of a header."""
    if gpst_ns is None:
        return ""
    utc_ns = gpst_ns - int(leap_seconds(gpst_ns)) * NS_PER_S
    utc_ns = gpst_ns - int(leap_seconds(utc_ns)) * NS_PER_S
    text = format_gpst(utc_ns // NS_PER_S * NS_PER_S, decimals=0)
    return f"{text[:10]} {text[11:]} UTC".replace("-", "").replace(":", "")


def _first_epoch(gpst_ns):
    ticks = _ticks(gpst_ns)
    moment = gpst_to_datetime64(ticks // 600_000_000 * 60 * NS_PER_S)
    year, month, day = (int(part) for part in str(moment)[:10].split("-"))
    hour, minute = (int(part) for part in str(moment)[11:16].split(":"))
    seconds, rest = divmod(ticks % 600_000_000, 10_000_000)
    return f"{year:6d}{month:6d}{day:6d}{hour:6d}{minute:6d}{seconds:5d}.{rest:07d}     GPS"


def _phase_shift_lines(types, shifts):
    """What is known of each signal; one line with the system alone where nothing is."""
    lines = []
    for system in types:
        known = {}
        for name, shift in shifts.items():  # "G2X", or "G052X" for one satellite
            if name[0] == system:
                known.setdefault((name[-2:], shift), []).append(name[:-2])
        if not known:
            lines.append(_line(system, "SYS / PHASE SHIFT"))
        for (signal, shift), sats in known.items():
            head = f"{system} L{signal} {shift:8.5f}"
            if sats == [system]:
                lines.append(_line(head, "SYS / PHASE SHIFT"))
                continue
            for k in range(0, len(sats), 10):
                count = f"{head}  {len(sats):2d}" if k == 0 else " " * 18
                text = count + "".join(f" {sat}" for sat in sats[k : k + 10])
                lines.append(_line(text, "SYS / PHASE SHIFT"))
    return lines


def _glonass_lines(channel, biases):
    """Frequency channels and code-phase alignment."""
    known = [] if channel is None else np.flatnonzero(np.asarray(channel) != NO_CHANNEL).tolist()
    lines = []
    for k in range(0, max(len(known), 1), 8):
        count = f"{len(known):3d} " if k == 0 else " " * 4
        text = count + "".join(f"R{slot:02d} {int(channel[slot]):2d} " for slot in known[k : k + 8])
        lines.append(_line(text, "GLONASS SLOT / FRQ #"))
    bias = "".join(
        f" {code} {biases[code[1:]]:8.3f}" if code[1:] in biases else "" for code in _GLONASS_BIASES
    )
    lines.append(_line(bias, "GLONASS COD/PHS/BIS"))
    return lines


# --------------------------------------------------------------------------------------- events


def _event_text(event: ObservationEvent) -> bytes:
    """An event record, without header lines that would change the columns."""
    texts = event.text.split("\n") if event.text else []
    texts = [text for text in texts if text[60:80].strip() not in _COLUMN_LABELS]
    when = " " * 28
    if event.time_ns is not None:
        ticks = _ticks(event.time_ns)
        stamp = format_gpst(ticks * _NS_PER_TICK, decimals=7)
        when = f" {stamp[:4]} {stamp[5:7]} {stamp[8:10]} {stamp[11:13]} {stamp[14:16]}"
        when += f" {int(stamp[17:19]):2d}.{stamp[20:]}"
    head = f">{when}  {event.flag}{len(texts):3d}\n"
    return "".join([head, *(text[:80].rstrip() + "\n" for text in texts)]).encode("ascii", "replace")
