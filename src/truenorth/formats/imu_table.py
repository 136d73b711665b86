r"""Logs of inertial units as tables: what every method without satellites begins with.

Three kinds of file say themselves what their numbers mean, and need no help:

* the text of the PSINS toolbox: remarks after ``%``, three lines of numbers (attitude, place and interval,
  worth of a count), then whole counts of angle and velocity, axes x right, y forward, z up;
* TrueNorth's own sensor tables of kind ``imu``;
* any table (CSV, Parquet) whose columns have the names of these: ``rate_x_radps``, ``force_x_mps2`` or
  ``delta_angle_x_rad``, ``delta_velocity_x_mps`` (x, y, z; axes forward, right, down), with stamps
  ``time_s`` or ``time_ns`` or a line ``# interval_s = 0.01``.

Units are never guessed: any other table is refused without an `ImuMapping`.

What is returned are increments over equal intervals in body axes (forward, right, down). A rate or specific
force is the mean over the interval that ends with its sample.

References
----------
G. Yan, PSINS toolbox, file format of ``imufile``.
Savage, P. G., "Strapdown inertial navigation integration algorithm design", J. Guidance, Control, and
Dynamics 21 (1998) 19-28 and 208-221 (coning, sculling).
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NoReturn

import numpy as np

from ..errors import FormatError
from ..strapdown import InertialIncrements, compensate_increments
from ..timescales import NS_PER_S
from .compression import read_bytes
from .sensor_table import parse_table

__all__ = ["ImuTable", "is_psins_text", "read_imu_table"]

ARCSEC_RAD = np.pi / 180.0 / 3600.0

_OURS = {
    "increments": (
        tuple(f"delta_angle_{axis}_rad" for axis in "xyz"),
        tuple(f"delta_velocity_{axis}_mps" for axis in "xyz"),
    ),
    "rates": (
        tuple(f"rate_{axis}_radps" for axis in "xyz"),
        tuple(f"force_{axis}_mps2" for axis in "xyz"),
    ),
}
"""Columns of tables that need no mapping, by what they hold."""

RFU_IN_FRD = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Turns components along right, forward, up into those along forward, right, down."""


@dataclass(frozen=True, slots=True, eq=False)
class ImuTable:
    """The samples of an inertial unit, n of them at equal intervals.

    Parameters
    ----------
    increments : InertialIncrements
        In body axes; times in seconds since the start of the record, also of a part of it.
    sensor_angle_rad, sensor_velocity_mps : ndarray, shape (n, 3)
        The same as the file has them, in the axes of its columns, before any compensation: what a check
        for the limits of the sensor must look at.
    interval_s : float
        Of the samples.
    source : str
        The file.
    start_ns : int or None
        GPS time at which the record starts, nanoseconds; None where the file does not say.
    latitude_rad, longitude_rad, height_m : float or None
        Of the place, where the file or the mapping says it.
    gyro_range_radps, accelerometer_range_mps2 : float or None
        Limits of the sensor, where stated.
    errors : mapping
        Settings of a sensor description, as the mapping gives them; empty where it gives none.
    notes : tuple of str
        Whole sentences: what was assumed or converted.
    """

    increments: InertialIncrements
    sensor_angle_rad: np.ndarray
    sensor_velocity_mps: np.ndarray
    interval_s: float
    source: str
    start_ns: int | None = None
    latitude_rad: float | None = None
    longitude_rad: float | None = None
    height_m: float | None = None
    gyro_range_radps: float | None = None
    accelerometer_range_mps2: float | None = None
    errors: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def n_samples(self) -> int:
        """int: Number of samples."""
        return len(self.sensor_angle_rad)

    @property
    def duration_s(self) -> float:
        """float: Length of the samples together, seconds."""
        return self.n_samples * self.interval_s

    def between(self, start_s: float | None = None, end_s: float | None = None) -> ImuTable:
        """A part of the record.

        Parameters
        ----------
        start_s, end_s : float or None
            Seconds since the start of the record; None: to its end.

        Returns
        -------
        ImuTable
            The samples whose intervals lie between the two; their times are still those of the record.

        Raises
        ------
        FormatError
            If no sample does.
        """
        edges = self.increments.time_s
        slack = 1e-6 * self.interval_s
        first = 0 if start_s is None else int(np.searchsorted(edges, start_s - slack))
        last = len(edges) - 1 if end_s is None else int(np.searchsorted(edges, end_s + slack)) - 1
        if last <= first:
            _refuse_empty(start_s, end_s, edges[0], edges[-1], self.source)
        inside = self.increments
        return replace(
            self,
            increments=InertialIncrements(
                inside.time_s[first : last + 1], inside.angle_rad[first:last], inside.velocity_mps[first:last]
            ),
            sensor_angle_rad=self.sensor_angle_rad[first:last],
            sensor_velocity_mps=self.sensor_velocity_mps[first:last],
        )


def read_imu_table(
    path: str | os.PathLike[str],
    *,
    start_s: float | None = None,
    end_s: float | None = None,
) -> ImuTable:
    """Read a log of an inertial unit.

    Parameters
    ----------
    path : str or os.PathLike
        The file, packed or not.
    start_s, end_s : float, optional
        The part to read, seconds since the start of the record; what lies outside may have gaps.

    Returns
    -------
    ImuTable

    Raises
    ------
    FormatError
        If the file cannot be read, does not say what its numbers mean, or has gaps, backward stamps or
        missing numbers in the part to read.
    """
    data = read_bytes(path)
    if is_psins_text(data[:4096]):
        return _psins(data, str(path), start_s, end_s)
    columns, meta = parse_table(data, path=path)
    return _own_table(columns, meta, str(path), start_s, end_s)


# ---------------------------------------------------------------------------------- kinds of files


def is_psins_text(head: bytes) -> bool:
    """Whether content begins like a log of the PSINS toolbox."""
    return head.startswith(b"%") and b"PSINS" in head.split(b"\n", 1)[0]


def _psins(data: bytes, source: str, start_s: float | None, end_s: float | None) -> ImuTable:
    """Counts of angle and velocity after a header that says what they are worth."""
    header, at, line_number = [], 0, 0
    while len(header) < 3 and at < len(data):
        end = data.find(b"\n", at)
        end = len(data) if end < 0 else end
        line = data[at:end].strip()
        at, line_number = end + 1, line_number + 1
        if line and not line.startswith(b"%"):
            try:
                header.append([float(word) for word in line.split()])
            except ValueError:
                break
    if [len(row) for row in header] != [6, 6, 6] or not np.all(np.isfinite(header)):
        raise FormatError(
            "a PSINS log has three lines of six numbers before its samples, and this one has not; give the"
            " complete file",
            path=source,
            line_number=line_number,
        )
    _, (latitude_deg, longitude_deg, height_m, _, interval_ms, g_mps2), scales = header
    if not (abs(latitude_deg) <= 90.0 and interval_ms > 0.0 and 9.0 < g_mps2 < 10.0 and min(scales) > 0.0):
        raise FormatError(
            f"the second and third line of numbers of a PSINS log give latitude, interval, gravity and"
            f" worth of counts, and hold {latitude_deg:g} deg, {interval_ms:g} ms, {g_mps2:g} m/s^2 and"
            f" {min(scales):g}; give the complete file",
            path=source,
            line_number=line_number,
        )
    counts = _numbers(data[at:], 6, source, line_number)
    interval_s = 1e-3 * interval_ms
    rows = _rows_between(interval_s * np.arange(1, len(counts) + 1), interval_s, start_s, end_s, source)
    counts = counts[rows]
    _refuse_missing(
        counts, ("gyro x", "gyro y", "gyro z", "accelerometer x", "y", "z"), rows, interval_s, source
    )
    return _table(
        counts[:, :3] * np.array(scales[:3]) * ARCSEC_RAD,
        counts[:, 3:] * np.array(scales[3:]) * 1e-6 * g_mps2,
        time_s=interval_s * np.arange(rows.start, rows.stop + 1),
        rot_body_from_sensor=RFU_IN_FRD,
        compensated=False,
        interval_s=interval_s,
        source=source,
        latitude_rad=float(np.radians(latitude_deg)),
        longitude_rad=float(np.radians(longitude_deg)),
        height_m=height_m,
        notes=(
            f"The header gives the place, {1e3 * interval_s:g} ms between samples, counts of"
            f" {scales[0]:g} arcsec and {scales[3]:g} ug s with g = {g_mps2:g} m/s^2, and axes x right,"
            f" y forward, z up.",
            "Its attitude is not used; coning and sculling are compensated here.",
        ),
    )


def _own_table(
    columns: Mapping[str, np.ndarray],
    meta: Mapping[str, Any],
    source: str,
    start_s: float | None,
    end_s: float | None,
) -> ImuTable:
    """A table whose columns have our names."""
    output = next((kind for kind, names in _OURS.items() if {*names[0], *names[1]} <= set(columns)), None)
    if output is None:
        _refuse_unknown(columns, source)
    gyro, accelerometer = (
        np.stack([_floats(columns[name], name, source) for name in names], axis=-1) for names in _OURS[output]
    )
    stated_s = meta.get("interval_s")
    if stated_s is not None and not (isinstance(stated_s, int | float) and 0.0 < stated_s < np.inf):
        raise FormatError(f"`interval_s` of the table is {stated_s!r}; give a positive number", path=source)
    start_ns, stamps_s = None, None
    if "time_ns" in columns and columns["time_ns"].dtype.kind in "iu" and len(gyro):
        first = int(columns["time_ns"][0])
        stamps_s = (columns["time_ns"].astype(np.int64) - first) / NS_PER_S
        start_ns = first
    elif "time_s" in columns:
        stamps_s = _floats(columns["time_s"], "time_s", source)
        stamps_s = stamps_s - stamps_s[:1]
    return _regular(
        gyro,
        accelerometer,
        output=output,
        stamps_s=stamps_s,
        stated_s=stated_s,
        start_s=start_s,
        end_s=end_s,
        names=(*_OURS[output][0], *_OURS[output][1]),
        source=source,
        first_ns=start_ns,
        rot_body_from_sensor=np.eye(3),
        compensated=True,
        notes=(
            "The names of the columns give the units; their axes are taken as forward, right, down, and"
            " coning and sculling as compensated by the unit.",
        ),
    )


# ---------------------------------------------------------------------------------- samples to increments


def _regular(
    gyro: np.ndarray,
    accelerometer: np.ndarray,
    *,
    output: str,
    stamps_s: np.ndarray | None,
    stated_s: float | None,
    start_s: float | None,
    end_s: float | None,
    names: tuple[str, ...],
    source: str,
    first_ns: int | None,
    notes: tuple[str, ...] = (),
    **rest: Any,
) -> ImuTable:
    """Samples in SI units with their stamps, made a table of equal intervals, or refused."""
    if not len(gyro):
        raise FormatError("the table holds no samples", path=source)
    if stamps_s is None:
        if stated_s is None:
            raise FormatError(
                "the table says nothing of time; give a column `time_s`, or a first line"
                " `# interval_s = 0.01`, or `rate_hz` in a mapping",
                path=source,
            )
        interval_s = float(stated_s)
        stamps_s = interval_s * np.arange(1, len(gyro) + 1)
        rows = _rows_between(stamps_s, interval_s, start_s, end_s, source)
    else:
        nominal_s = _nominal_interval_s(stamps_s, stated_s, source)
        # Stamps count from the start of the record: the first sample ends one interval after it.
        stamps_s = stamps_s + nominal_s
        rows = _rows_between(stamps_s, nominal_s, start_s, end_s, source)
        interval_s, said = _check_stamps(stamps_s[rows], nominal_s, stated_s, source)
        notes = notes + said
    gyro, accelerometer = gyro[rows], accelerometer[rows]
    _refuse_missing(np.hstack([gyro, accelerometer]), names, rows, interval_s, source)
    factor = interval_s if output == "rates" else 1.0
    begin_s = float(stamps_s[rows.start]) - interval_s
    return _table(
        gyro * factor,
        accelerometer * factor,
        time_s=begin_s + interval_s * np.arange(len(gyro) + 1),
        interval_s=interval_s,
        source=source,
        start_ns=None if first_ns is None else first_ns - round(interval_s * NS_PER_S),
        notes=notes,
        **rest,
    )


def _table(
    angle: np.ndarray,
    velocity: np.ndarray,
    *,
    time_s: np.ndarray,
    rot_body_from_sensor: np.ndarray,
    compensated: bool,
    **rest: Any,
) -> ImuTable:
    """Increments in the axes of the columns, turned into body axes and compensated."""
    body = [rows @ rot_body_from_sensor.T for rows in (angle, velocity)]
    if not compensated:
        body = list(compensate_increments(*body))
    return ImuTable(InertialIncrements(time_s, *body), angle, velocity, **rest)


def _nominal_interval_s(stamps_s: np.ndarray, stated_s: float | None, source: str) -> float:
    """Interval of samples: as stated, or the one that most stamps have."""
    if stated_s is not None:
        return float(stated_s)
    steps = np.diff(stamps_s)
    steps = steps[steps > 0.0]
    if not len(steps):
        raise FormatError(
            "the time stamps do not advance, so the interval of the samples is unknown; give `rate_hz` in a"
            " mapping",
            path=source,
        )
    return float(np.median(steps))


_LATE = 10
"""Samples within which the stamps after a late one must have caught up."""


def _check_stamps(
    stamps_s: np.ndarray, nominal_s: float, stated_s: float | None, source: str
) -> tuple[float, tuple[str, ...]]:
    """Interval of complete samples and what is to be said of it; refuses what is not complete."""
    advice = "select a part without it with --from and --until"
    bad = np.flatnonzero(~np.isfinite(stamps_s))
    if len(bad):
        raise FormatError(f"sample {bad[0] + 1} has no time stamp; {advice}", path=source)
    steps = np.diff(stamps_s)
    back = np.flatnonzero(steps <= 0.0)
    if len(back):
        k = back[0]
        what = "is given twice" if steps[k] == 0.0 else f"goes back by {-steps[k]:.6g} s"
        raise FormatError(
            f"time {what} at {stamps_s[k]:.3f} s ({len(back)} such places); {advice}, or give `rate_hz` in a"
            f" mapping if only the stamps are wrong",
            path=source,
        )
    for k in np.flatnonzero(steps > 1.5 * nominal_s):
        # A stamp may be late without a sample missing; then those that follow crowd after it.
        ahead = stamps_s[k + 1 : k + 1 + _LATE] - stamps_s[k]
        if not np.any(ahead[1:] <= (np.arange(2, len(ahead) + 1) + 0.5) * nominal_s):
            raise FormatError(
                f"after {stamps_s[k]:.3f} s there is a gap of {steps[k]:.6g} s where samples come every"
                f" {nominal_s:.6g} s; {advice}",
                path=source,
            )
    if len(steps) == 0:
        return nominal_s, ()
    mean_s = float((stamps_s[-1] - stamps_s[0]) / len(steps))
    if abs(mean_s / nominal_s - 1.0) > 0.01 + 1.0 / len(steps):
        raise FormatError(
            f"the stamps advance by {mean_s:.6g} s a sample on average, but "
            + ("`interval_s` says" if stated_s is not None else "most of them by")
            + f" {nominal_s:.6g} s; {advice}, or give `rate_hz` in a mapping",
            path=source,
        )
    interval_s = nominal_s if stated_s is not None else mean_s
    jitter_s = float(np.max(np.abs(stamps_s - stamps_s[0] - interval_s * np.arange(len(stamps_s)))))
    if jitter_s > 0.01 * interval_s:
        return interval_s, (
            f"The stamps leave equal intervals of {interval_s:.6g} s by up to {jitter_s:.3g} s, and none is"
            f" missing; the samples are taken as equally spaced.",
        )
    return interval_s, ()


def _rows_between(
    stamps_s: np.ndarray, interval_s: float, start_s: float | None, end_s: float | None, source: str
) -> slice:
    """Samples whose intervals lie in a part of the record; stamps are ends of intervals."""
    if start_s is None and end_s is None:
        return slice(0, len(stamps_s))
    slack = 0.01 * interval_s
    inside = np.ones(len(stamps_s), dtype=bool)
    if start_s is not None:
        inside &= stamps_s - interval_s >= start_s - slack
    if end_s is not None:
        inside &= stamps_s <= end_s + slack
    chosen = np.flatnonzero(inside)
    if not len(chosen):
        last_s = float(np.nanmax(stamps_s)) if np.any(np.isfinite(stamps_s)) else 0.0
        _refuse_empty(start_s, end_s, 0.0, last_s, source)
    return slice(int(chosen[0]), int(chosen[-1]) + 1)


def _refuse_empty(
    start_s: float | None, end_s: float | None, first_s: float, last_s: float, source: str
) -> NoReturn:
    part = " ".join(
        f"{word} {value:g} s" for word, value in (("from", start_s), ("until", end_s)) if value is not None
    )
    raise FormatError(
        f"no samples lie {part or 'in it'}; the record goes from {first_s:g} s to {last_s:g} s", path=source
    )


def _refuse_missing(
    samples: np.ndarray, names: tuple[str, ...], rows: slice, interval_s: float, source: str
) -> None:
    """Refuse cells without a number."""
    missing = ~np.isfinite(samples)
    if missing.any():
        row, column = np.argwhere(missing)[0]
        raise FormatError(
            f"`{names[column]}` holds no number in sample {rows.start + row + 1}"
            f" ({(rows.start + row) * interval_s:.3f} s; {int(missing.any(axis=1).sum())} such samples);"
            f" select a part without it with --from and --until",
            path=source,
        )


def _refuse_unknown(columns: Mapping[str, np.ndarray], source: str) -> NoReturn:
    shown = ", ".join(list(columns)[:8]) + (" ..." if len(columns) > 8 else "")
    raise FormatError(
        f"the table does not say the units and axes of its columns ({shown}); write them into a small TOML"
        f" file with [time], [gyro], [accelerometer] and `axes`, and give it with --mapping",
        path=source,
    )


# ---------------------------------------------------------------------------------- numbers from text


def _floats(column: np.ndarray, name: str, source: str) -> np.ndarray:
    """A column as numbers."""
    if column.dtype.kind not in "iuf":
        raise FormatError(
            f"the column `{name}` holds something that is no number; mend the table", path=source
        )
    return column.astype(float)


def _numbers(text: bytes, n_columns: int, source: str, line_number: int) -> np.ndarray:
    """Rows of numbers with blanks between them, shape (n, n_columns); empty lines are no rows."""
    if not text.endswith(b"\n"):
        text += b"\n"
    letters = np.frombuffer(text, dtype=np.uint8)
    # 9 to 13 and 32 are the blanks of ASCII; a word begins where a letter follows a blank.
    blank = (letters == 32) | ((letters >= 9) & (letters <= 13))
    begins = ~blank
    begins[1:] &= blank[:-1]
    ends = np.flatnonzero(letters == 10)
    counts = np.diff(np.cumsum(begins)[ends], prepend=0)
    wrong = np.flatnonzero((counts != n_columns) & (counts != 0))
    if len(wrong):
        raise FormatError(
            f"this line has {counts[wrong[0]]} numbers where {n_columns} belong; mend or delete it",
            path=source,
            line_number=line_number + int(wrong[0]) + 1,
        )
    n_rows = int(np.count_nonzero(counts))
    if n_rows == 0:
        raise FormatError("the table holds no samples", path=source)
    odd = re.search(rb"[^\s0-9eE+\-.naifNAIF]", text)
    values = None
    if odd is None:
        import warnings

        with warnings.catch_warnings():
            # NumPy warns where a word is no number, and returns what stands before it.
            warnings.simplefilter("ignore", DeprecationWarning)
            values = np.fromstring(text.decode("ascii"), sep=" ")
    if values is None or len(values) != n_rows * n_columns:
        before = len(values) if values is not None else 0
        _refuse_word(text, before, source, line_number)
    return values.reshape(n_rows, n_columns)


def _refuse_word(text: bytes, n_before: int, source: str, line_number: int) -> NoReturn:
    """Name the first word that is no number."""
    for k, line in enumerate(text.split(b"\n")):
        for word in line.split():
            try:
                float(word)
            except ValueError:
                raise FormatError(
                    f"{word[:30].decode('ascii', 'replace')!r} is no number; mend or delete this line",
                    path=source,
                    line_number=line_number + k + 1,
                ) from None
    raise FormatError(
        f"the numbers cannot be read after the first {n_before}; write the table again", path=source
    )
