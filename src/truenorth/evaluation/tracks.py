"""Angles over time, whatever they came from: solutions in memory, their files, tables of truth."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..attitude.array_solution import AttitudeSolution
from ..attitude.solution import BaselineSolution
from ..errors import FormatError, Status
from ..frames import azimuth_elevation_from_enu
from ..rotations import rot_ned_from_body

__all__ = ["ATTITUDE", "DIRECTION", "Track", "direction_of_body_vector", "reference_track", "solution_track"]

ATTITUDE = ("heading", "pitch", "roll")
DIRECTION = ("azimuth", "elevation")

_STATUS_OF = {status.label: int(status) for status in Status}


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Angles at n instants.

    Parameters
    ----------
    angles : tuple of str
        Their names: `ATTITUDE` or `DIRECTION`.
    time_ns : ndarray of int64, shape (n,)
        GPS time, rising.
    angle_rad : ndarray, shape (n, k)
        NaN where unknown.
    cov_rad2 : ndarray, shape (n, k, k)
        Covariance; NaN where unknown.
    status : ndarray of uint8, shape (n,)
        Codes of `truenorth.errors.Status`.
    latitude_deg, longitude_deg : ndarray, shape (n,), or None
        Where the platform was.
    """

    angles: tuple[str, ...]
    time_ns: np.ndarray
    angle_rad: np.ndarray
    cov_rad2: np.ndarray
    status: np.ndarray
    latitude_deg: np.ndarray | None = None
    longitude_deg: np.ndarray | None = None


def solution_track(source: Any) -> Track:
    """Angles of a solution.

    Parameters
    ----------
    source : BaselineSolution, AttitudeSolution, path-like or dict
        A result, its CSV or Parquet file, or columns of the same names.

    Returns
    -------
    Track

    Raises
    ------
    FormatError
        If a file cannot be read or has not the columns of a solution.
    """
    if isinstance(source, AttitudeSolution):
        angle = np.stack([source.heading_rad, source.pitch_rad, source.roll_rad], axis=1)
        return Track(ATTITUDE, source.time_ns, angle, source.cov_rad2, source.status)
    if isinstance(source, BaselineSolution):
        angle = np.stack([source.azimuth_rad, source.elevation_rad], axis=1)
        cov = _direction_covariance(source.baseline_enu_m, source.cov_enu_m2)
        return Track(DIRECTION, source.time_ns, angle, cov, source.status)
    columns, path = _columns(source)
    names, angle = _angles(columns, path)
    n = len(angle)
    cov = np.zeros((n, len(names), len(names)))
    for k, name in enumerate(names):
        cov[:, k, k] = np.radians(_numbers(columns, f"{name}_sd_deg", n)) ** 2
    if names == ATTITUDE:
        for row, column, key in ((0, 1, "cov_hp_deg2"), (0, 2, "cov_hr_deg2"), (1, 2, "cov_pr_deg2")):
            if key in columns:
                cov[:, row, column] = cov[:, column, row] = np.radians(np.radians(columns[key]))
    elif "cov_ee_m2" in columns:
        cov = _direction_covariance(*_enu(columns))
    status = np.full(n, Status.FIXED, np.uint8)
    if "status" in columns:
        status = np.array([_STATUS_OF.get(str(word), 0) for word in columns["status"]], np.uint8)
    return Track(names, _times(columns, path), angle, cov, status, *_places(columns))


def reference_track(source: Any) -> Track:
    """Angles of a reference: a table of truth, another solution, or another instrument.

    Parameters
    ----------
    source : path-like, dict, BaselineSolution, AttitudeSolution
        A CSV or Parquet table with ``time_ns`` or ``time_gpst`` and ``heading_deg`` (then ``pitch_deg``
        and ``roll_deg``, where there are such) or ``azimuth_deg``; the ``truth`` of a simulation; a solution,
        of which the accepted epochs count.

    Returns
    -------
    Track

    Raises
    ------
    FormatError
        If a file cannot be read or has no such columns.
    """
    if isinstance(source, (AttitudeSolution, BaselineSolution)):
        return solution_track(source)
    columns, path = _columns(source)
    names, angle = _angles(columns, path)
    n = len(angle)
    status = np.full(n, Status.FIXED, np.uint8)
    if "status" in columns:
        status = np.array([_STATUS_OF.get(str(word), 0) for word in columns["status"]], np.uint8)
    cov = np.full((n, len(names), len(names)), np.nan)
    return Track(names, _times(columns, path), angle, cov, status, *_places(columns))


def direction_of_body_vector(
    angle_rad: np.ndarray, body: np.ndarray | tuple[float, float, float]
) -> np.ndarray:
    """Azimuth and elevation of a vector that is fixed in the body.

    Parameters
    ----------
    angle_rad : ndarray, shape (n, 3)
        Heading, pitch, roll. An unknown roll is no hindrance to a vector along the x axis.
    body : array_like, shape (3,)
        The vector: forward, right, down.

    Returns
    -------
    ndarray, shape (n, 2)
        Azimuth in [0, 2 pi), elevation.
    """
    body = np.asarray(body, dtype=float)
    angle_rad = np.array(angle_rad, dtype=float)
    if not np.any(body[1:]):
        angle_rad[:, 2] = 0.0
        if not np.isfinite(angle_rad[:, 1]).any():
            angle_rad[:, 1] = 0.0
    north, east, down = (rot_ned_from_body(*angle_rad.T) @ body).T
    return np.stack(azimuth_elevation_from_enu(np.stack([east, north, -down], axis=-1)), axis=-1)


def _columns(source: Any) -> tuple[Mapping[str, np.ndarray], str]:
    """Columns of a table in memory or in a file, angles in degrees, and the file's name."""
    if isinstance(source, (str, os.PathLike)):
        from ..formats import read_table

        if not Path(source).is_file():
            raise FormatError("there is no such file; check the name", path=str(source))
        return read_table(source)[0], str(source)
    columns = dict(source)
    for key in [key for key in columns if key.endswith("_rad")]:
        columns.setdefault(f"{key.removesuffix('_rad')}_deg", np.degrees(columns[key]))
    return columns, ""


def _angles(columns: Mapping[str, np.ndarray], path: str) -> tuple[tuple[str, ...], np.ndarray]:
    names = ATTITUDE if "heading_deg" in columns else DIRECTION
    if f"{names[0]}_deg" not in columns:
        raise FormatError(
            f"the table has neither `heading_deg` nor `azimuth_deg`, but {', '.join(list(columns)[:6])} ...; "
            "give the result of `truenorth solve` or a table of truth",
            path=path or None,
        )
    n = len(columns[f"{names[0]}_deg"])
    return names, np.radians(np.stack([_numbers(columns, f"{name}_deg", n) for name in names], axis=1))


def _numbers(columns: Mapping[str, np.ndarray], key: str, n: int) -> np.ndarray:
    """A column of numbers, NaN where the table has none."""
    return np.asarray(columns[key], dtype=float) if key in columns else np.full(n, np.nan)


def _times(columns: Mapping[str, np.ndarray], path: str) -> np.ndarray:
    if "time_ns" in columns:
        time_ns = np.asarray(columns["time_ns"]).astype(np.int64)
    elif "time_gpst" in columns:
        stamp = columns["time_gpst"]
        try:
            stamp = np.asarray(stamp).astype("datetime64[ns]")
        except ValueError as error:
            raise FormatError("`time_gpst` is not in ISO 8601; write it so", path=path or None) from error
        epoch = np.datetime64("1980-01-06T00:00:00", "ns")
        time_ns = (stamp - epoch).astype(np.int64)
    else:
        raise FormatError(
            "the table has neither `time_ns` nor `time_gpst`; add one, in GPS time", path=path or None
        )
    if np.any(np.diff(time_ns) <= 0):
        raise FormatError("the times of the table do not rise; sort it by time", path=path or None)
    return time_ns


def _places(columns: Mapping[str, np.ndarray]) -> tuple[np.ndarray | None, np.ndarray | None]:
    if "latitude_deg" not in columns or "longitude_deg" not in columns:
        return None, None
    return np.asarray(columns["latitude_deg"], float), np.asarray(columns["longitude_deg"], float)


def _enu(columns: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Baseline and its covariance from the columns of a baseline's table."""
    enu = np.stack([columns[f"{name}_m"] for name in ("east", "north", "up")], axis=1)
    ee, nn, uu, en, nu, ue = (columns[f"cov_{name}_m2"] for name in ("ee", "nn", "uu", "en", "nu", "ue"))
    cov = np.stack([ee, en, ue, en, nn, nu, ue, nu, uu], axis=1).reshape(-1, 3, 3)
    return enu, cov


def _direction_covariance(enu_m: np.ndarray, cov_m2: np.ndarray) -> np.ndarray:
    """Covariance of azimuth and elevation of a vector, shape (n, 2, 2)."""
    east, north, up = enu_m.T
    horizontal = np.hypot(east, north)
    size = np.hypot(horizontal, up)
    with np.errstate(invalid="ignore", divide="ignore"):
        to_azimuth = np.stack([north, -east, np.zeros_like(up)], axis=1) / horizontal[:, None] ** 2
        to_elevation = np.stack([-up * east, -up * north, horizontal**2], axis=1)
        to_elevation /= (horizontal * size**2)[:, None]
    jacobian = np.stack([to_azimuth, to_elevation], axis=1)
    return jacobian @ cov_m2 @ np.swapaxes(jacobian, 1, 2)
