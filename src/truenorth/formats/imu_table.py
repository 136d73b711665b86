r"""Logs of inertial units as tables: what every method without satellites begins with.

Three kinds of file say themselves what their numbers mean, and need no help:

* the text of the PSINS toolbox: remarks after ``%``, three lines of numbers (attitude, place and interval,
  worth of a count), then whole counts of angle and velocity, axes x right, y forward, z up;
* TrueNorth's own sensor tables of kind ``imu``;
* any table (CSV, Parquet) whose columns have the names of these: ``rate_x_radps``, ``force_x_mps2`` or
  ``delta_angle_x_rad``, ``delta_velocity_x_mps`` (x, y, z; axes forward, right, down), with stamps
  ``time_s`` or ``time_ns`` or a first line ``# interval_s = 0.01``.

Units are never guessed: any other table is refused without an `ImuMapping`, a small TOML file
(`truenorth.formats.imu_mapping`).

What is returned are increments over equal intervals in body axes (forward, right, down). A rate or a
specific force is taken as the mean over the interval that ends with its sample; of a unit that samples
instead of averaging, vibration near its sample rate comes back as an error that nothing can undo.

References
----------
G. Yan, PSINS toolbox for Matlab, file format of ``imufile``.
Savage, P. G., "Strapdown inertial navigation integration algorithm design", J. Guidance, Control, and
Dynamics 21 (1998) 19-28 and 208-221 (coning, sculling).
"""

from __future__ import annotations

import contextlib
import os
import re
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, NoReturn

import numpy as np

from ..errors import ConfigError, FormatError
from ..rotations import rot_ned_from_body
from ..strapdown import InertialIncrements, compensate_increments
from ..timescales import NS_PER_S
from .compression import read_bytes
from .imu_mapping import SECONDS, AccelerometerColumns, GyroColumns, ImuMapping, rot_frd_from_axes
from .sensor_table import parse_table

__all__ = ["ImuMapping", "ImuTable", "is_psins_text", "read_imu_table"]

ARCSEC_RAD = np.pi / 180.0 / 3600.0

_PARQUET = b"PAR1"
_PSINS_AXES = "x right, y forward, z up"

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
    errors : dict or None
        Settings of a sensor description, as the mapping gives them; None where it gives none.
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
    errors: dict[str, Any] | None = None
    notes: tuple[str, ...] = ()

    @property
    def n_samples(self) -> int:
        """int: Number of samples."""
        return len(self.sensor_angle_rad)

    @property
    def duration_s(self) -> float:
        """float: Length of the samples together, seconds."""
        return self.n_samples * self.interval_s

    def __str__(self) -> str:
        """One line: samples, rate, length."""
        return (
            f"{self.n_samples} samples, {1.0 / self.interval_s:.6g} Hz, {self.increments.time_s[0]:.6g} s to"
            f" {self.increments.time_s[-1]:.6g} s"
        )

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
            _refuse_empty(_Part(start_s, end_s), edges[0], edges[-1], self.source)
        return replace(
            self,
            increments=self.increments.part(first, last),
            sensor_angle_rad=self.sensor_angle_rad[first:last],
            sensor_velocity_mps=self.sensor_velocity_mps[first:last],
        )


def read_imu_table(
    path: str | os.PathLike[str],
    mapping: ImuMapping | str | os.PathLike[str] | None = None,
    *,
    start_s: float | None = None,
    end_s: float | None = None,
) -> ImuTable:
    """Read a log of an inertial unit.

    Parameters
    ----------
    path : str or os.PathLike
        The file, packed or not.
    mapping : ImuMapping, str or os.PathLike, optional
        What its columns mean, or the TOML file that says it; needed where the log itself does not.
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
    ConfigError
        If the mapping is impossible, or names columns that the file has not.
    """
    if mapping is not None and not isinstance(mapping, ImuMapping):
        mapping = ImuMapping.read(mapping)
    part = _Part(start_s, end_s)
    data, source = read_bytes(path), os.fspath(path)
    mapping = mapping or ImuMapping()
    if mapping.gyro is not None:
        return _mapped(data, mapping, source, part)
    return (_psins if is_psins_text(data[:4096]) else _own_table)(data, mapping, source, part)


# ---------------------------------------------------------------------------------- kinds of files


def is_psins_text(head: bytes) -> bool:
    """Whether content begins like a log of the PSINS toolbox."""
    return head.startswith(b"%") and b"PSINS" in head.split(b"\n", 1)[0]


def _psins(data: bytes, mapping: ImuMapping, source: str, part: _Part) -> ImuTable:
    """Counts of angle and velocity after a header that says what they are worth."""
    header: list[list[float]] = []
    at, line_number = 0, 0
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
    axes, compensated = mapping.axes or _PSINS_AXES, bool(mapping.compensated)
    place = {
        "latitude_rad": float(np.radians(latitude_deg)),
        "longitude_rad": float(np.radians(longitude_deg)),
        "height_m": height_m,
    }
    return _regular(
        counts[:, :3] * np.array(scales[:3]) * ARCSEC_RAD,
        counts[:, 3:] * np.array(scales[3:]) * 1e-6 * g_mps2,
        stated_s=1e-3 * interval_ms,
        part=part,
        names=tuple(f"{kind} {axis}" for kind in ("gyro", "accelerometer") for axis in "xyz"),
        source=source,
        rot_body_from_sensor=_rot_body_from_sensor(axes, mapping),
        compensated=compensated,
        notes=(
            f"The header gives the place, {interval_ms:g} ms between samples, and counts of {scales[0]:g}"
            f" arcsec and {scales[3]:g} ug s with g = {g_mps2:g} m/s^2; axes are {axes}.",
            f"Its attitude is not used; coning and sculling are compensated"
            f" {'by the unit' if compensated else 'here'}.",
        ),
        **place | {key: value for key, value in _stated(mapping).items() if value is not None},
    )


def _own_table(data: bytes, mapping: ImuMapping, source: str, part: _Part) -> ImuTable:
    """A table whose columns have our names."""
    if not data.startswith(_PARQUET):
        _check_names(data, source)
    columns, meta = parse_table(data, path=source)
    output = next((kind for kind, names in _OURS.items() if {*names[0], *names[1]} <= set(columns)), None)
    if output is None:
        _refuse_unknown(list(columns), source)
    gyro, accelerometer = (
        np.stack([_floats(columns[name], name, source) for name in names], axis=-1) for names in _OURS[output]
    )
    stated_s = meta.get("interval_s")
    if stated_s is not None and not (isinstance(stated_s, int | float) and 0.0 < stated_s < np.inf):
        raise FormatError(f"`interval_s` of the table is {stated_s!r}; give a positive number", path=source)
    first_ns, stamps_s = None, None
    if mapping.time is not None and mapping.time.rate_hz is not None:
        stated_s = 1.0 / mapping.time.rate_hz
    elif "time_ns" in columns and columns["time_ns"].dtype.kind in "iu":
        stamps_s, first_ns = _since_first(columns["time_ns"], 1e-9)
    elif "time_s" in columns:
        stamps_s, _ = _since_first(_floats(columns["time_s"], "time_s", source), 1.0)
    axes = mapping.axes or "x forward, y right, z down"
    compensated = mapping.compensated is not False
    interval_rates = output == "rates"
    return _regular(
        gyro,
        accelerometer,
        is_rate=(interval_rates, interval_rates),
        stamps_s=stamps_s,
        stated_s=None if stated_s is None else float(stated_s),
        part=part,
        names=(*_OURS[output][0], *_OURS[output][1]),
        source=source,
        first_ns=first_ns,
        rot_body_from_sensor=_rot_body_from_sensor(axes, mapping),
        compensated=compensated,
        notes=(
            f"The names of the columns give their units; axes are {axes}, and coning and sculling are"
            f" compensated {'by the unit' if compensated else 'here'}.",
        ),
        **_stated(mapping),
    )


def _mapped(data: bytes, mapping: ImuMapping, source: str, part: _Part) -> ImuTable:
    """A table of which a mapping says everything."""
    gyro, accelerometer, time = mapping.gyro, mapping.accelerometer, mapping.time
    assert gyro is not None
    assert accelerometer is not None
    assert time is not None
    assert mapping.axes is not None
    columns = _mapped_columns(data, mapping, source)
    first_ns, stamps_s, stated_s = None, None, None
    if time.rate_hz is not None:
        stated_s = 1.0 / time.rate_hz
    else:
        assert time.column is not None
        assert time.unit is not None
        stamps = columns[time.column]
        stamps_s, first_ns = _since_first(
            stamps if stamps.dtype.kind in "iu" else _floats(stamps, time.column, source), SECONDS[time.unit]
        )
        first_ns = first_ns if time.epoch == "gps" else None
    compensated = bool(mapping.compensated)
    samples = [
        kind.factor * np.stack([_floats(columns[name], name, source) for name in kind.columns], axis=-1)
        for kind in (gyro, accelerometer)
    ]
    return _regular(
        *samples,
        is_rate=(gyro.is_rate, accelerometer.is_rate),
        stamps_s=stamps_s,
        stated_s=stated_s,
        part=part,
        names=tuple(str(name) for name in (*gyro.columns, *accelerometer.columns)),
        source=source,
        first_ns=first_ns,
        rot_body_from_sensor=_rot_body_from_sensor(mapping.axes, mapping),
        compensated=compensated,
        notes=(
            f"By the mapping: {_in_words(gyro)}, {_in_words(accelerometer)}, axes {mapping.axes}; coning and"
            f" sculling are compensated {'by the unit' if compensated else 'here'}.",
        ),
        **_stated(mapping),
    )


def _in_words(kind: GyroColumns | AccelerometerColumns) -> str:
    """Unit of a sensor's columns, as a note says it."""
    name = "gyro" if isinstance(kind, GyroColumns) else "accelerometer"
    counts = "" if kind.scale == 1.0 else f"counts of {kind.scale:g} "
    g = (
        f" with g = {kind.g_mps2:g} m/s^2"
        if isinstance(kind, AccelerometerColumns) and "g" in kind.unit
        else ""
    )
    return f"{name} in {counts}{kind.unit}{g}"


def _rot_body_from_sensor(axes: str, mapping: ImuMapping) -> np.ndarray:
    """Axes of the columns in the body: as they lie on the unit, and as the unit sits in the body."""
    return rot_ned_from_body(*np.radians(mapping.mount_deg)) @ rot_frd_from_axes(axes)


def _stated(mapping: ImuMapping) -> dict[str, Any]:
    """What a mapping says beside the columns."""
    said: dict[str, Any] = {"errors": mapping.errors}
    if mapping.place is not None:
        place = mapping.place
        said["latitude_rad"] = float(np.radians(place.latitude_deg))
        if place.longitude_deg is not None:
            said["longitude_rad"] = float(np.radians(place.longitude_deg))
        said["height_m"] = place.height_m
    if mapping.gyro is not None and mapping.gyro.range_dps is not None:
        said["gyro_range_radps"] = float(np.radians(mapping.gyro.range_dps))
    if mapping.accelerometer is not None and mapping.accelerometer.range_g is not None:
        said["accelerometer_range_mps2"] = mapping.accelerometer.range_g * mapping.accelerometer.g_mps2
    return said


def _since_first(stamps: np.ndarray, unit_s: float) -> tuple[np.ndarray, int | None]:
    """Stamps in seconds since the first, and the first in nanoseconds."""
    if not len(stamps):
        return np.zeros(0), None
    first = stamps[0].item()
    # Whole numbers are subtracted as such: today in nanoseconds has no exact double.
    since = (stamps - stamps[0]) * unit_s
    return since, round(first * round(unit_s * NS_PER_S)) if np.isfinite(first) else None


# ---------------------------------------------------------------------------------- samples to increments


class _Part(NamedTuple):
    """What of a record is wanted, seconds since its start; None: all."""

    start_s: float | None
    end_s: float | None


def _regular(
    gyro: np.ndarray,
    accelerometer: np.ndarray,
    *,
    stated_s: float | None,
    part: _Part,
    names: tuple[str, ...],
    source: str,
    rot_body_from_sensor: np.ndarray,
    compensated: bool,
    is_rate: tuple[bool, bool] = (False, False),
    stamps_s: np.ndarray | None = None,
    first_ns: int | None = None,
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
        nominal_s = interval_s = stated_s
        stamps_s = interval_s * np.arange(1, len(gyro) + 1)
        rows = _rows_between(stamps_s, interval_s, part, source)
    else:
        nominal_s = _nominal_interval_s(stamps_s, stated_s, source)
        # Stamps count from the start of the record: the first sample ends one interval after it.
        stamps_s = stamps_s + nominal_s
        rows = _rows_between(stamps_s, nominal_s, part, source)
        interval_s, said = _check_stamps(stamps_s[rows], nominal_s, stated_s, source)
        notes = notes + said
    _refuse_missing(gyro, accelerometer, names, rows, stamps_s, source)
    angle, velocity = (
        samples[rows] * (interval_s if rate else 1.0)
        for samples, rate in zip((gyro, accelerometer), is_rate, strict=True)
    )
    # Not a matrix product: BLAS would start threads for nine multiplications a row.
    body = [np.einsum("ij,nj->ni", rot_body_from_sensor, samples) for samples in (angle, velocity)]
    if not compensated:
        body = list(compensate_increments(*body))
    begin_s = float(stamps_s[rows.start]) - nominal_s
    return ImuTable(
        increments=InertialIncrements(begin_s + interval_s * np.arange(len(angle) + 1), *body),
        sensor_angle_rad=angle,
        sensor_velocity_mps=velocity,
        interval_s=interval_s,
        source=source,
        start_ns=None if first_ns is None else first_ns - round(interval_s * NS_PER_S),
        notes=notes,
        **rest,
    )


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
    # Where nobody says the interval, the mean of complete stamps is right, and the commonest step is a count
    # of a coarse clock.
    if stated_s is not None and abs(mean_s / nominal_s - 1.0) > 0.01 + 1.0 / len(steps):
        raise FormatError(
            f"the stamps advance by {mean_s:.6g} s a sample on average, but `interval_s` says"
            f" {nominal_s:.6g}; {advice}, or give `rate_hz` in a mapping",
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


def _rows_between(stamps_s: np.ndarray, interval_s: float, part: _Part, source: str) -> slice:
    """Samples whose intervals lie in a part of the record; stamps are ends of intervals."""
    if part.start_s is None and part.end_s is None:
        return slice(0, len(stamps_s))
    slack = 0.01 * interval_s
    inside = np.ones(len(stamps_s), dtype=bool)
    if part.start_s is not None:
        inside &= stamps_s - interval_s >= part.start_s - slack
    if part.end_s is not None:
        inside &= stamps_s <= part.end_s + slack
    chosen = np.flatnonzero(inside)
    if not len(chosen):
        last_s = float(np.nanmax(stamps_s)) if np.any(np.isfinite(stamps_s)) else 0.0
        _refuse_empty(part, 0.0, last_s, source)
    return slice(int(chosen[0]), int(chosen[-1]) + 1)


def _refuse_empty(part: _Part, first_s: float, last_s: float, source: str) -> NoReturn:
    said = [f"{word} {x:g} s" for word, x in zip(("from", "until"), part, strict=True) if x is not None]
    raise FormatError(
        f"no samples lie {' '.join(said)}; the record goes from {first_s:g} s to {last_s:g} s", path=source
    )


def _refuse_missing(
    gyro: np.ndarray,
    accelerometer: np.ndarray,
    names: tuple[str, ...],
    rows: slice,
    stamps_s: np.ndarray,
    source: str,
) -> None:
    """Refuse cells without a number."""
    missing = ~np.isfinite(np.hstack([gyro[rows], accelerometer[rows]]))
    if missing.any():
        row, column = np.argwhere(missing)[0]
        raise FormatError(
            f"`{names[column]}` holds no number in sample {rows.start + row + 1} at"
            f" {stamps_s[rows.start + row]:.3f} s ({int(missing.any(axis=1).sum())} such); select a part"
            f" without it with --from and --until",
            path=source,
        )


def _check_names(data: bytes, source: str) -> None:
    """Refuse a text table whose names are not ours before it is read as one."""
    lines = (found.group() for found in re.finditer(rb"[^\r\n]+", data[: 2**20]))
    text = next((line for line in lines if not line.startswith(b"#")), b"")
    names = [name.strip().strip('"') for name in text.decode("utf-8", "replace").split(",")]
    if not any({*kind[0], *kind[1]} <= set(names) for kind in _OURS.values()):
        _refuse_unknown(names, source)


def _refuse_unknown(names: list[str], source: str) -> NoReturn:
    shown = ", ".join(name[:40] for name in names[:8]) + (", ..." if len(names) > 8 else "")
    if not shown.isprintable():
        raise FormatError(
            "this is neither a text table nor Parquet; give a log of an inertial unit", path=source
        )
    raise FormatError(
        f"the table does not say the units and axes of its columns ({shown}); write them into a TOML file"
        f" with [time], [gyro], [accelerometer] and `axes`, and give it with --mapping",
        path=source,
    )


# ---------------------------------------------------------------------------------- numbers from text


def _mapped_columns(data: bytes, mapping: ImuMapping, source: str) -> dict[str | int, np.ndarray]:
    """The columns that a mapping names or numbers."""
    wanted = mapping.columns
    if data.startswith(_PARQUET):
        columns, _ = parse_table(data, path=source)
    else:
        columns = _text_columns(data, mapping, source)
    found: dict[str | int, np.ndarray] = dict(columns)
    found |= dict(enumerate(columns.values(), 1))
    for name in wanted:
        if name not in found:
            known = ", ".join(list(columns)[:12]) if isinstance(name, str) else f"1 to {len(columns)}"
            raise ConfigError(
                f"the mapping asks for the column {name!r}, which {source} has not; there are {known}",
                key="columns",
                value=name,
            )
    return {name: found[name] for name in wanted}


def _text_columns(data: bytes, mapping: ImuMapping, source: str) -> dict[str, np.ndarray]:
    """Columns of a text table by name; those of a table without names are called 1, 2, 3..."""
    at, skipped = 0, 0
    while at < len(data):
        end = data.find(b"\n", at) + 1 or len(data)
        if skipped >= mapping.header_lines and data[at:end].strip()[:1] not in (b"", b"#", b"%"):
            break
        at, skipped = end, skipped + 1
    body = data[at:]
    first = body.split(b"\n", 1)[0].decode("utf-8", "replace").strip()
    by_number = isinstance(mapping.columns[0], int)
    if mapping.separator == "space":
        names = first.split()
        if by_number:
            names = [str(k + 1) for k in range(len(names))]
        else:
            body, skipped = body[body.find(b"\n") + 1 or len(body) :], skipped + 1
        if not names:
            raise FormatError("the table holds no samples", path=source)
        values = _numbers(body, len(names), source, skipped)
        return {name: values[:, k] for k, name in enumerate(names)}
    if mapping.separator != "comma":
        separator = {"semicolon": b";", "tab": b"\t"}[mapping.separator]
        if b"," in body:
            raise FormatError(
                f"the cells are separated by {mapping.separator}s and hold commas; write numbers with a"
                f" decimal point",
                path=source,
            )
        body = body.replace(separator, b",")
        first = first.replace(separator.decode(), ",")
    if by_number:
        body = ",".join(str(k + 1) for k in range(first.count(",") + 1)).encode() + b"\n" + body
        skipped -= 1
    try:
        return parse_table(body, path=source)[0]
    except FormatError as error:
        if error.line_number is None:
            raise
        said = str(error).removeprefix(f"{source}, line {error.line_number}: ")
        raise FormatError(said, path=source, line_number=error.line_number + skipped) from None


def _floats(column: np.ndarray, name: str | int, source: str) -> np.ndarray:
    """A column as numbers."""
    if column.dtype.kind in "iuf":
        return column.astype(float)
    word = next((word for word in column.tolist() if not _is_number(word)), "")
    raise FormatError(f"the column {name!r} holds {word!r}, which is no number; mend the table", path=source)


def _is_number(word: object) -> bool:
    try:
        float(str(word))
    except ValueError:
        return False
    return True


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

        with warnings.catch_warnings(), contextlib.suppress(ValueError):
            # Where a word is no number, NumPy raises, or warns and returns what stands before it.
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
