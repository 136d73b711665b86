"""Motion from a table of positions and attitudes, by splines that go through every row.

Position and angles are quintic splines of time: all derivatives up to the fourth are continuous. Rounded
positions make rough accelerations (0.1 mm at 10 Hz some 0.03 m/s^2): such a table is as good as its digits.
"""

from __future__ import annotations

import csv
import gzip
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from ...errors import ConfigError, FormatError
from ...frames import ecef_from_geodetic
from .kinematics import Attitude, Motion, motion_of, place_from_ecef

if TYPE_CHECKING:
    from scipy.interpolate import CubicHermiteSpline

__all__ = ["TableMotion", "TableTrajectory", "read_motion_table"]

REACH_S = 5.0
"""How far the splines go on before the first and after the last row."""

COLUMNS = "time_s latitude_deg longitude_deg height_m x_m y_m z_m heading_deg pitch_deg roll_deg".split()


class TableMotion(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="table"
):
    """A file of comma-separated values with a header: time, position and attitude."""

    file: str
    """Relative to the scenario; may be compressed (``.gz``)."""
    columns: dict[str, str] = {}
    """Names in the file by ours where they differ. Ours: ``time_s``; ``latitude_deg``, ``longitude_deg`` and
    ``height_m``, or ``x_m``, ``y_m`` and ``z_m`` (ECEF); ``heading_deg``, ``pitch_deg`` and ``roll_deg``,
    which are 0 where they are missing."""
    start_s: float = 0.0
    """Time in the file at which the scenario starts."""

    def __post_init__(self) -> None:
        for key in self.columns:
            if key not in COLUMNS:
                raise ConfigError(
                    f"`columns` holds {key!r}; give names among {', '.join(COLUMNS)}",
                    key="columns",
                    value=key,
                )


class TableTrajectory:
    """Motion through given positions and attitudes.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Instants, ascending, n >= 6.
    position_ecef_m : ndarray, shape (n, 3)
        Positions.
    heading_rad, pitch_rad, roll_rad : ndarray, shape (n,)
        Attitudes against local north, east, down; the heading may jump by whole turns.

    Raises
    ------
    ConfigError
        If there are too few rows, times do not ascend, or the nose comes within 5 degrees of the vertical,
        where angles cannot be interpolated.
    """

    def __init__(
        self,
        time_s: np.ndarray,
        position_ecef_m: np.ndarray,
        heading_rad: np.ndarray,
        pitch_rad: np.ndarray,
        roll_rad: np.ndarray,
    ) -> None:
        from scipy.interpolate import make_interp_spline

        time_s = np.asarray(time_s, dtype=float)
        if len(time_s) < 6 or not np.all(np.diff(time_s) > 0.0):
            raise ConfigError(
                f"the motion table has {len(time_s)} rows; give six or more with ascending times",
                key="motion",
            )
        # Splines of small numbers: the first position is taken off.
        self._origin = np.array(position_ecef_m[0], dtype=float)
        rows = np.column_stack(
            [
                np.asarray(position_ecef_m, dtype=float) - self._origin,
                np.unwrap(np.asarray(heading_rad, dtype=float)),
                np.asarray(pitch_rad, dtype=float),
                np.unwrap(np.asarray(roll_rad, dtype=float)),
            ]
        )
        if not np.all(np.isfinite(rows)):
            raise ConfigError("the motion table has gaps; fill them or leave the rows out", key="motion")
        if np.max(np.abs(rows[:, 4])) > np.radians(85.0):
            raise ConfigError("the motion table has a pitch beyond 85 degrees; leave it out", key="motion")
        self.first_s, self.last_s = float(time_s[0]), float(time_s[-1])
        before = _continuation(time_s[:12], rows[:12], 0)
        after = _continuation(time_s[-12:], rows[-12:], -1)
        times = np.concatenate([before[0][::-1], time_s, after[0]])
        rows = np.concatenate([before[1][::-1], rows, after[1]])
        spline = make_interp_spline(times, rows, k=5)
        self._splines = [spline, spline.derivative(), spline.derivative(2)]
        self._distance, self._knot_course = self._survey(times)

    def _survey(self, times: np.ndarray) -> tuple[CubicHermiteSpline, tuple[np.ndarray, np.ndarray]]:
        """Distance along the way as a spline, and the course of the last movement at each row."""
        from scipy.interpolate import CubicHermiteSpline

        node, weight = np.polynomial.legendre.leggauss(4)
        half = 0.5 * np.diff(times)
        inside = (times[:-1, None] + half[:, None] * (1.0 + node)).ravel()
        speed = self._ground_velocity(inside)[0].reshape(-1, 4)
        distance = np.concatenate([[0.0], np.cumsum(half * (speed @ weight))])
        speed, course = self._ground_velocity(times)
        spline = CubicHermiteSpline(times, distance, speed)
        moving = np.maximum.accumulate(np.where(speed > STILL_MPS, np.arange(len(times)), -1))
        heading = self._splines[0](times)[:, 3]
        held = np.where(moving >= 0, course[moving], heading)
        return spline, (times, held)

    def _ground_velocity(self, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Horizontal speed and course."""
        value, first, second = (spline(time_s)[:, :3] for spline in self._splines)
        place = place_from_ecef(self._origin + value, first, second)
        north, east, _ = np.einsum("nij,nj->in", place.rot_ned_from_ecef, first)
        return np.hypot(north, east), np.arctan2(east, north)

    def at(self, time_s: np.ndarray) -> Motion:
        """State at instants, seconds since the start, shape (n,)."""
        time_s = np.atleast_1d(np.asarray(time_s, dtype=float))
        value, first, second = (spline(time_s) for spline in self._splines)
        place = place_from_ecef(self._origin + value[:, :3], first[:, :3], second[:, :3])
        angles = [(value[:, k], first[:, k]) for k in (3, 4, 5)]
        return motion_of(time_s, place, Attitude.from_angles(*angles))

    def distance_m(self, time_s: np.ndarray) -> np.ndarray:
        """Distance along the way since instant 0, on the map, shape (n,)."""
        return self._distance(np.atleast_1d(np.asarray(time_s, dtype=float))) - self._distance(0.0)

    def course_rad(self, time_s: np.ndarray) -> np.ndarray:
        """Direction of travel, clockwise from north in [0, 2 pi), shape (n,); held while at rest."""
        time_s = np.atleast_1d(np.asarray(time_s, dtype=float))
        speed, course = self._ground_velocity(time_s)
        times, held = self._knot_course
        row = np.clip(np.searchsorted(times, time_s, side="right") - 1, 0, len(times) - 1)
        return np.mod(np.where(speed > STILL_MPS, course, held[row]), 2.0 * np.pi)


STILL_MPS = 0.02
"""Below it the direction of a tabulated velocity is that of the rounding."""


def _continuation(time_s: np.ndarray, rows: np.ndarray, end: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows beyond the first (end 0) or last (-1) one: the rate goes on, its change fades in a second."""
    # Of a cubic through some rows, because those of the spline at its end have the rounding of the rows.
    origin = time_s[end]
    cubic = np.polynomial.polynomial.polyfit(time_s - origin, rows, 3)
    sign = 1.0 if end else -1.0
    step = (time_s[-1] - time_s[0]) / (len(time_s) - 1)
    elapsed = step * np.arange(1.0, np.ceil(REACH_S / step) + 1.0)[:, None]
    # Twice integrated, a second derivative that decays with a time constant of 1 s.
    faded = np.expm1(-elapsed) + elapsed
    beyond = rows[end] + sign * cubic[1] * elapsed + 2.0 * cubic[2] * faded
    return origin + sign * elapsed[:, 0], beyond


def read_motion_table(section: TableMotion, *, duration_s: float, folder: str = "") -> TableTrajectory:
    """Trajectory of a `TableMotion`.

    Parameters
    ----------
    section : TableMotion
        Settings.
    duration_s : float
        How long the motion is needed.
    folder : str
        Folder that the file is relative to.

    Returns
    -------
    TableTrajectory
        The motion, by seconds since the start of the scenario.

    Raises
    ------
    ConfigError
        If the file is not there or does not last.
    FormatError
        If a column is missing or a value is not a number.
    """
    path = Path(folder) / section.file
    if not path.is_file():
        raise ConfigError(f"`file` is {section.file!r}; there is no {path}", key="file", value=section.file)
    with gzip.open(path, "rt") if path.suffix == ".gz" else path.open() as stream:
        reader = csv.reader(stream)
        header = [name.strip() for name in next(reader, [])]
        index = {
            name: header.index(section.columns.get(name, name))
            for name in COLUMNS
            if section.columns.get(name, name) in header
        }
        geodetic = {"latitude_deg", "longitude_deg", "height_m"} <= index.keys()
        for name in ("time_s", *(() if geodetic else ("x_m", "y_m", "z_m"))):
            if name not in index:
                raise FormatError(
                    f"there is no column for {name} among {', '.join(header)}; name it in `columns`",
                    path=path,
                    line_number=1,
                )
        values: dict[str, list[float]] = {name: [] for name in index}
        for line in reader:
            if not line:
                continue
            try:
                for name, k in index.items():
                    values[name].append(float(line[k]))
            except (ValueError, IndexError):
                raise FormatError(
                    f"the motion table has no number for {name}; give one",
                    path=path,
                    line_number=reader.line_num,
                ) from None
    table = {name: np.array(column) for name, column in values.items()}
    time_s = table["time_s"] - section.start_s
    if len(time_s) == 0 or time_s[0] > 0.0 or time_s[-1] < duration_s - 1e-6:
        covered = f"{time_s[0]:g} to {time_s[-1]:g} s" if len(time_s) else "nothing"
        raise ConfigError(
            f"`file` is {section.file!r} and covers {covered} of a scenario of {duration_s:g} s; "
            "shorten `duration_s` or change `start_s`",
            key="file",
            value=section.file,
        )
    if geodetic:
        latitude, longitude = np.radians(table["latitude_deg"]), np.radians(table["longitude_deg"])
        position = ecef_from_geodetic(latitude, longitude, table["height_m"])
    else:
        position = np.column_stack([table["x_m"], table["y_m"], table["z_m"]])
    none = np.zeros(len(time_s))
    angles = [np.radians(table.get(name, none)) for name in ("heading_deg", "pitch_deg", "roll_deg")]
    return TableTrajectory(time_s, position, *angles)
