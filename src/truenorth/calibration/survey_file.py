"""The file of a theodolite survey: pillars, pointings, points behind planes and lines, the body frame."""

from __future__ import annotations

import csv
import os
import tomllib
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from ..config import convert_settings
from ..errors import ConfigError, FormatError
from ..frames import geodetic_from_ecef, rot_ned_from_ecef
from .gauss_krueger import BESSEL, WGS84, ecef_from_gauss_krueger
from .marks import body_coordinates, plane_line_point
from .theodolite import Pointing, Station, TheodoliteNetwork, adjust_pointings

__all__ = ["SurveyFile", "SurveyedPoints", "solve_survey"]


class StationSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A pillar, a ``[[stations]]`` table."""

    name: str
    north_m: float
    """Of a local frame, or northing where `[gauss_krueger]` is given."""
    east_m: float
    """Easting from the central meridian, without false easting, where `[gauss_krueger]` is given."""
    height_m: float
    instrument_height_m: float = 0.0
    """From the mark on the pillar to the tilting axis."""
    sd_m: float = 0.0
    """Of each coordinate; 0 holds them."""


class PointSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A reference point where a line pierces a plane, a ``[[points]]`` table."""

    name: str
    plane: tuple[str, ...]
    """Marks of the plane, three or more."""
    line: tuple[str, ...]
    """Marks of the line, two or more."""


class BodySection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The body frame, the ``[body]`` table."""

    axes: tuple[str, str, str]
    """Marks or points at the origin, forward of it, and at their height."""
    offset_body_m: dict[str, tuple[float, float, float]] = msgspec.field(default_factory=dict)
    """From a reference point to the phase centre of its antenna: forward, right, down."""


class GaussKruegerSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """That stations are in Gauss-Krueger coordinates, the ``[gauss_krueger]`` table."""

    central_meridian_deg: float
    """From Greenwich; of the Austrian M34 it is 16.3333."""
    ellipsoid: str = "WGS84"
    """WGS84 or Bessel."""

    def __post_init__(self) -> None:
        if self.ellipsoid not in ("WGS84", "Bessel"):
            raise ConfigError(
                f"`ellipsoid` is {self.ellipsoid!r}; give WGS84 or Bessel",
                key="ellipsoid",
                value=self.ellipsoid,
            )


class SurveyFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A theodolite survey, as ``truenorth calibrate theodolite`` reads it."""

    pointings: str
    """CSV table with station, target, set, direction_deg, zenith_deg; relative to this file."""
    direction_sd_arcsec: float = 1.0
    zenith_sd_arcsec: float = 1.0
    stations: tuple[StationSection, ...]
    points: tuple[PointSection, ...] = ()
    body: BodySection | None = None
    gauss_krueger: GaussKruegerSection | None = None

    def __post_init__(self) -> None:
        for key in ("direction_sd_arcsec", "zenith_sd_arcsec"):
            if not getattr(self, key) > 0.0:
                raise ConfigError(f"`{key}` is {getattr(self, key)!r}; give a positive angle", key=key)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> SurveyFile:
        """Read a survey file.

        Parameters
        ----------
        path : str or path-like
            A TOML file.

        Returns
        -------
        SurveyFile

        Raises
        ------
        FormatError
            If the file cannot be read.
        ConfigError
            If it is not TOML, or holds an unknown key or an impossible value.
        """
        path = Path(path)
        try:
            table = tomllib.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise FormatError(f"could not read the survey: {error.strerror}", path=str(path)) from error
        except UnicodeDecodeError as error:
            raise FormatError("could not read the survey: it is not UTF-8 text", path=str(path)) from error
        except tomllib.TOMLDecodeError as error:
            raise ConfigError(f"{path} is not valid TOML: {error}") from error
        survey = convert_settings(table, cls)
        return msgspec.structs.replace(survey, pointings=os.path.join(path.parent, survey.pointings))


@dataclass(frozen=True, slots=True, eq=False)
class SurveyedPoints:
    """Marks and points of a survey, in the local frame and in the body frame.

    Parameters
    ----------
    network : TheodoliteNetwork
        The adjustment of the pointings.
    names : tuple of str
        Marks, then points.
    position_ned_m : ndarray, shape (k, 3)
        North, east, down.
    cov_ned_m2 : ndarray, shape (3 k, 3 k)
        Joint covariance.
    position_body_m : ndarray, shape (k, 3), or None
        Forward, right, down, offsets of antennas included.
    cov_body_m2 : ndarray, shape (3 k, 3 k), or None
        Joint covariance by the rule of the axes.
    """

    network: TheodoliteNetwork
    names: tuple[str, ...]
    position_ned_m: np.ndarray
    cov_ned_m2: np.ndarray
    position_body_m: np.ndarray | None
    cov_body_m2: np.ndarray | None


def solve_survey(survey: SurveyFile) -> SurveyedPoints:
    """Adjust a theodolite survey and make what it asks for of the marks.

    Parameters
    ----------
    survey : SurveyFile
        What `SurveyFile.read` returned.

    Returns
    -------
    SurveyedPoints

    Raises
    ------
    FormatError
        If the table of pointings cannot be read.
    ConfigError
        If the survey names what is not there.
    NoSolutionError
        If the pointings do not determine the marks.
    """
    network = adjust_pointings(_stations(survey), _read_pointings(survey))
    names = list(network.names)
    position_m, cov_m2 = network.position_ned_m, network.cov_m2
    for point in survey.points:
        rows = [_index(names, mark, f"points.{point.name}") for mark in (*point.plane, *point.line)]
        columns = (3 * np.array(rows)[:, None] + np.arange(3)).ravel()
        n_plane = len(point.plane)
        place_m, jacobian, _ = plane_line_point(position_m[rows[:n_plane]], position_m[rows[n_plane:]])
        change = np.eye(len(cov_m2) + 3, len(cov_m2))
        # Marks may serve both plane and line.
        np.add.at(change[-3:].T, columns, jacobian.T)
        position_m, cov_m2 = np.vstack([position_m, place_m]), change @ cov_m2 @ change.T
        names.append(point.name)
    body_m = body_cov_m2 = None
    if survey.body is not None:
        axes = [_index(names, name, "body.axes") for name in survey.body.axes]
        body_m, body_cov_m2, _ = body_coordinates(position_m, cov_m2, axes)
        for name, offset_m in survey.body.offset_body_m.items():
            body_m[_index(names, name, "body.offset_body_m")] += offset_m
    return SurveyedPoints(network, tuple(names), position_m, cov_m2, body_m, body_cov_m2)


def _index(names, name, key):
    if name not in names:
        raise ConfigError(
            f"`{key}` names {name!r}; the marks and points are {', '.join(names)}", key=key, value=name
        )
    return names.index(name)


def _stations(survey):
    """Pillars in the local frame; those of plane coordinates north, east, up of the first of them."""
    sections = survey.stations
    places = np.array([[s.north_m, s.east_m, s.height_m] for s in sections], dtype=float)
    if survey.gauss_krueger is not None and len(places):
        meridian = np.radians(survey.gauss_krueger.central_meridian_deg)
        ellipsoid = BESSEL if survey.gauss_krueger.ellipsoid == "Bessel" else WGS84
        ecef_m = ecef_from_gauss_krueger(places[:, 1], places[:, 0], places[:, 2], meridian, ellipsoid)
        latitude, longitude, _ = geodetic_from_ecef(ecef_m[0])
        places = (ecef_m - ecef_m[0]) @ rot_ned_from_ecef(latitude, longitude).T * [1.0, 1.0, -1.0]
    return [
        Station(s.name, *place.tolist(), s.instrument_height_m, s.sd_m)
        for s, place in zip(sections, places, strict=True)
    ]


def _read_pointings(survey):
    path = survey.pointings
    arcsec = np.pi / 648_000.0
    found = []
    try:
        with open(path, encoding="utf-8", newline="") as file:
            reader = csv.DictReader(file)
            missing = {"station", "target", "set", "direction_deg"} - set(reader.fieldnames or ())
            if missing:
                raise FormatError(
                    f"the table of pointings has no column {', '.join(sorted(missing))}; give it", path=path
                )
            for row in reader:
                try:
                    angles = [
                        np.radians(float(row.get(key) or "nan")) for key in ("direction_deg", "zenith_deg")
                    ]
                except ValueError:
                    raise FormatError(
                        "this line has no angle in degrees where there should be one",
                        path=path,
                        line_number=reader.line_num,
                    ) from None
                found.append(
                    Pointing(
                        row["station"],
                        row["target"],
                        row["set"],
                        *angles,
                        survey.direction_sd_arcsec * arcsec,
                        survey.zenith_sd_arcsec * arcsec,
                    )
                )
    except OSError as error:
        raise FormatError(f"could not read the pointings: {error.strerror}", path=path) from error
    return found
