"""Antenna phase centres from ANTEX files, versions 1.3 and 1.4.

The phase of a signal that arrives from direction e (unit vector from the antenna to the other end of the
ray, in the antenna's own axes) is that of the distance to the antenna reference point plus

    correction = PCV(azimuth, zenith angle) - PCO . e

with the offset PCO of the mean phase centre and the variation PCV, both of the carrier frequency. Axes of
receiver antennas are north mark, east of it, up; azimuth runs from north to east. Axes of satellite
antennas are the satellite's x, y, z with z to the Earth; azimuth runs from y to x, and the zenith angle is
the nadir angle. Variations are interpolated linearly in both angles and stay at the last value beyond
the grid.

Reference: M. Rothacher and R. Schmid, ANTEX: the antenna exchange format, version 1.4, 2010.
"""

import re
from dataclasses import dataclass, field

import numpy as np

from ..constants import FREQUENCY_HZ, SYSTEMS
from ..errors import FormatError
from ..observations import sat_name
from ..timescales import format_gpst, gpst_from_calendar
from .compression import read_bytes

__all__ = [
    "Antex",
    "AntennaCalibration",
    "PhasePattern",
    "parse_antex",
    "phase_centre_correction_m",
    "read_antex",
]

_LABEL = slice(60, 80)
_SATELLITE = re.compile(f"[{SYSTEMS}][0-9][0-9]")
_FREQUENCY = re.compile(f"[{SYSTEMS}][0-9]{{2}}")
_ALWAYS = (np.iinfo(np.int64).min, np.iinfo(np.int64).max)


@dataclass(frozen=True, slots=True, eq=False)
class PhasePattern:
    """Phase centre of one antenna at one frequency.

    Parameters
    ----------
    offset_m : ndarray, shape (3,)
        Mean phase centre from the reference point: north, east, up of receiver antennas; x, y, z of
        satellites.
    zenith_rad : ndarray, shape (n,)
        Zenith angles of the variations, increasing.
    noazi_m : ndarray, shape (n,)
        Variations averaged over the azimuth.
    azimuth_rad : ndarray, shape (m,)
        Azimuths of `grid_m` from 0 to 2 pi; empty where the variation does not depend on the azimuth.
    grid_m : ndarray, shape (m, n)
        Variations by azimuth and zenith angle.
    """

    offset_m: np.ndarray
    zenith_rad: np.ndarray
    noazi_m: np.ndarray
    azimuth_rad: np.ndarray
    grid_m: np.ndarray

    def variation_m(self, azimuth_rad, zenith_rad):
        """Phase-centre variation.

        Parameters
        ----------
        azimuth_rad, zenith_rad : float or ndarray
            Direction in the antenna's axes.

        Returns
        -------
        ndarray
            Metres, to be added to the distance.
        """
        zenith = np.asarray(zenith_rad, dtype=float)
        if len(self.azimuth_rad) == 0:
            return np.interp(zenith, self.zenith_rad, self.noazi_m)
        zenith, azimuth = np.broadcast_arrays(zenith, np.asarray(azimuth_rad, dtype=float))
        row, up = _cell(np.mod(azimuth, 2.0 * np.pi), self.azimuth_rad)
        column, right = _cell(zenith, self.zenith_rad)
        near = self.grid_m[row, column] * (1.0 - right) + self.grid_m[row, column + 1] * right
        far = self.grid_m[row + 1, column] * (1.0 - right) + self.grid_m[row + 1, column + 1] * right
        return near * (1.0 - up) + far * up


def _cell(value, grid):
    """Index of the interval of an even grid, and the place within it from 0 to 1."""
    place = np.clip((value - grid[0]) / (grid[1] - grid[0]), 0.0, len(grid) - 1.0)
    index = np.minimum(place.astype(np.int64), len(grid) - 2)
    return index, place - index


@dataclass(frozen=True, slots=True, eq=False)
class AntennaCalibration:
    """One antenna of the file.

    Parameters
    ----------
    type : str
        IGS name with radome in columns 17 to 20, e.g. ``"TRM59800.00     NONE"``; of satellites the
        block type.
    serial : str
        Serial number, empty for the mean of the type; of satellites their name (``"G05"``).
    is_satellite : bool
        Whether this is a satellite's antenna.
    patterns : dict of str to PhasePattern
        By frequency code, e.g. ``"G01"``, ``"E05"``: system and RINEX band.
    valid_from_ns, valid_until_ns : int
        GPS time, nanoseconds.
    method : str
        How the calibration was made, e.g. ``"ROBOT"``.
    """

    type: str
    serial: str
    is_satellite: bool
    patterns: dict[str, PhasePattern] = field(default_factory=dict)
    valid_from_ns: int = _ALWAYS[0]
    valid_until_ns: int = _ALWAYS[1]
    method: str = ""

    def pattern(self, frequency, *, exact=False):
        """Phase centre at a frequency.

        Parameters
        ----------
        frequency : str
            System and band, e.g. ``"E07"``.
        exact : bool
            Whether only this very code will do. Many antennas are calibrated for ``G01`` and ``G02``
            alone; without `exact`, the calibrated frequency that is closest stands for one that is not.

        Returns
        -------
        PhasePattern

        Raises
        ------
        FormatError
            If the frequency is unknown, or not calibrated and `exact`.
        """
        if frequency in self.patterns:
            return self.patterns[frequency]
        wanted_hz = _carrier_hz(frequency)
        if exact or np.isnan(wanted_hz) or not self.patterns:
            raise FormatError(
                f"the antenna {self.type!r} is not calibrated for {frequency!r}; it is for "
                f"{', '.join(self.patterns) or 'no frequency'}"
            )
        known = list(self.patterns)
        # Of equally close ones that of GPS, which comes first in every file.
        return self.patterns[known[int(np.nanargmin([abs(_carrier_hz(k) - wanted_hz) for k in known]))]]


def _carrier_hz(frequency):
    if not _FREQUENCY.fullmatch(frequency) or int(frequency[1:]) >= FREQUENCY_HZ.shape[1]:
        return np.nan
    return FREQUENCY_HZ[SYSTEMS.index(frequency[0]), int(frequency[1:])]


def phase_centre_correction_m(antenna, frequency, azimuth_rad, elevation_rad, *, exact=False):
    """What the phase centre of an antenna adds to the distance from its reference point.

    Parameters
    ----------
    antenna : AntennaCalibration
        From `Antex.receiver` or `Antex.satellite`.
    frequency : str
        System and band, e.g. ``"G01"``.
    azimuth_rad, elevation_rad : float or ndarray
        Direction of the ray in the antenna's own axes: from its north mark to the east and above its
        horizon; of satellites from y to x and 90 degrees minus the nadir angle.
    exact : bool
        As in `AntennaCalibration.pattern`.

    Returns
    -------
    ndarray
        Metres: variation minus offset along the ray.

    Raises
    ------
    FormatError
        As `AntennaCalibration.pattern`.
    """
    pattern = antenna.pattern(frequency, exact=exact)
    azimuth, elevation = np.broadcast_arrays(
        np.asarray(azimuth_rad, dtype=float), np.asarray(elevation_rad, dtype=float)
    )
    along, across = np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation)
    if antenna.is_satellite:
        along, across = across, along  # azimuth zero is the y axis
    offset = pattern.offset_m
    to_centre = offset[0] * along + offset[1] * across + offset[2] * np.sin(elevation)
    return pattern.variation_m(azimuth, 0.5 * np.pi - elevation) - to_centre


@dataclass(frozen=True, slots=True, eq=False)
class Antex:
    """All antennas of a file.

    Parameters
    ----------
    antennas : tuple of AntennaCalibration
        In the order of the file.
    is_absolute : bool
        Whether the patterns are absolute, or relative to a reference antenna.
    version, path : str
        What the file says about itself, and its name.
    """

    antennas: tuple[AntennaCalibration, ...]
    is_absolute: bool = True
    version: str = ""
    path: str = ""

    def receiver(self, antenna_type, serial=""):
        """Calibration of a receiver antenna.

        Parameters
        ----------
        antenna_type : str
            IGS name as in the RINEX header. Without a radome, ``NONE`` is meant.
        serial : str
            Serial number; its own calibration is preferred to that of the type.

        Returns
        -------
        AntennaCalibration

        Raises
        ------
        FormatError
            If the file does not have it.
        """
        code, radome = _split_type(antenna_type)
        same_code = [a for a in self.antennas if not a.is_satellite and _split_type(a.type)[0] == code]
        found = [a for a in same_code if _split_type(a.type)[1] == radome]
        for wanted in ({serial.strip()} if serial.strip() else set()), {""}:
            for antenna in found:
                if antenna.serial in wanted:
                    return antenna
        if found:
            serials = ", ".join(antenna.serial for antenna in found[:8])
            what = f"only single antennas of type {antenna_type!r}, with the serial numbers {serials}"
        elif same_code:
            radomes = ", ".join(sorted({_split_type(a.type)[1] for a in same_code}))
            what = f"the antenna {code!r} not with the radome {radome!r} but with {radomes}"
        else:
            what = f"no antenna {code!r}"
        raise FormatError(
            f"the ANTEX file has {what}; give its IGS name, or another file", path=self.path or None
        )

    def satellite(self, sat, time_ns):
        """Calibration of a satellite antenna.

        Parameters
        ----------
        sat : int
            Satellite, see `truenorth.observations.sat_id`.
        time_ns : int
            GPS time, nanoseconds.

        Returns
        -------
        AntennaCalibration

        Raises
        ------
        FormatError
            If the file does not have it for this time.
        """
        name = sat_name(int(sat))
        for antenna in self.antennas:
            if (
                antenna.is_satellite
                and antenna.serial == name
                and antenna.valid_from_ns <= time_ns <= antenna.valid_until_ns
            ):
                return antenna
        raise FormatError(
            f"the ANTEX file has no antenna of {name} at {format_gpst(time_ns)} GPST; give a newer file",
            path=self.path or None,
        )

    def range_correction_m(self, antenna_type, frequency, azimuth_rad, elevation_rad, *, serial=""):
        """What a receiver antenna's phase centre adds to the distance, by `phase_centre_correction_m`.

        Parameters
        ----------
        antenna_type, serial : str
            As in `receiver`.
        frequency : str
            System and band, e.g. ``"G01"``; the closest calibrated one stands for one that is not.
        azimuth_rad, elevation_rad : float or ndarray
            Direction of the satellite in the antenna's own axes.

        Returns
        -------
        ndarray
            Metres.

        Raises
        ------
        FormatError
            If the file does not have the antenna.
        """
        antenna = self.receiver(antenna_type, serial)
        return phase_centre_correction_m(antenna, frequency, azimuth_rad, elevation_rad)


def _split_type(name):
    """Antenna code and radome."""
    parts = name.split()
    if len(parts) > 1 and len(parts[-1]) == 4:
        return " ".join(parts[:-1]), parts[-1]
    return " ".join(parts), "NONE"


# ------------------------------------------------------------------------------------- reading


def read_antex(path):
    """Read an ANTEX file.

    Parameters
    ----------
    path : str or os.PathLike
        The file, packed or not.

    Returns
    -------
    Antex

    Raises
    ------
    FormatError
        If the file cannot be opened, is no ANTEX file, or an antenna of it cannot be read.
    """
    return parse_antex(read_bytes(path), path=path)


def parse_antex(data, *, path=None):
    """Read the plain content of an ANTEX file.

    Parameters
    ----------
    data : bytes
        Content after unpacking.
    path : str or os.PathLike, optional
        Name of the file for messages.

    Returns
    -------
    Antex

    Raises
    ------
    FormatError
        As `read_antex`.
    """
    lines = data.decode("latin-1").splitlines()
    if not lines or lines[0][_LABEL].strip() != "ANTEX VERSION / SYST":
        raise FormatError(
            "this is no ANTEX file: the first line does not end in 'ANTEX VERSION / SYST'; give one, e.g. of "
            "the IGS",
            path=path,
            line_number=1,
        )
    is_absolute = True
    antennas, begun = [], None
    for number, line in enumerate(lines):
        label = line[_LABEL].strip()
        if label == "PCV TYPE / REFANT":
            is_absolute = line[:1] != "R"
        elif label == "START OF ANTENNA":
            begun = number
        elif label == "END OF ANTENNA" and begun is not None:
            antennas.append(_Block(lines[begun + 1 : number], begun + 2, path).read())
            begun = None
    if begun is not None or not antennas:
        raise FormatError(
            "the file ends within an antenna" if antennas or begun is not None else "the file has no antenna",
            path=path,
            line_number=len(lines),
        )
    return Antex(
        antennas=tuple(antennas),
        is_absolute=is_absolute,
        version=lines[0][:8].strip(),
        path="" if path is None else str(path),
    )


class _Block:
    """The lines of one antenna."""

    def __init__(self, lines, first_number, path):
        self._lines, self._first, self._path = lines, first_number, path
        self._at = 0

    def read(self):
        values = {"type": "", "serial": ""}
        patterns, dazi, zenith = {}, 0.0, None
        while self._at < len(self._lines):
            line = self._lines[self._at]
            label = line[_LABEL].strip()
            try:
                if label == "TYPE / SERIAL NO":
                    values["type"], values["serial"] = line[:20].rstrip(), line[20:40].strip()
                elif label == "METH / BY / # / DATE":
                    values["method"] = line[:20].strip()
                elif label == "DAZI":
                    dazi = float(line[2:8])
                elif label == "ZEN1 / ZEN2 / DZEN":
                    zenith = [float(line[2 + 6 * k : 8 + 6 * k]) for k in range(3)]
                elif label in ("VALID FROM", "VALID UNTIL"):
                    key = label.lower().replace(" ", "_") + "_ns"
                    values[key] = gpst_from_calendar(*map(int, line[:30].split()), float(line[30:43]))
                elif label == "START OF FREQUENCY":
                    code = line[3:6].replace(" ", "0")
                    self._at += 1
                    patterns[code] = self._pattern(dazi, zenith)
                    continue
                elif label == "START OF FREQ RMS":  # accuracies, to the end of their block
                    while self._lines[self._at][_LABEL].strip() != "END OF FREQ RMS":
                        self._at += 1
            except (ValueError, IndexError, TypeError, ArithmeticError):
                raise self._damaged(f"this line of the antenna {values['type']!r} cannot be read") from None
            self._at += 1
        if not values["type"]:
            self._at = 0
            raise self._damaged("this antenna has no line 'TYPE / SERIAL NO'")
        is_satellite = _SATELLITE.fullmatch(values["serial"]) is not None
        return AntennaCalibration(**values, is_satellite=is_satellite, patterns=patterns)

    def _damaged(self, what):
        return FormatError(
            f"{what}; the file is damaged, fetch it again",
            path=self._path,
            line_number=self._first + min(self._at, len(self._lines) - 1),
        )

    def _pattern(self, dazi, zenith):
        """Offset and variations up to the end of the frequency; stops behind it."""
        first, last, step = zenith
        n_zenith, n_azimuth = round((last - first) / step) + 1, round(360.0 / dazi) + 1 if dazi > 0 else 0
        if n_zenith < 2 or n_azimuth == 1:
            raise ValueError(zenith)
        offset, noazi, grid = None, None, []
        while True:
            line = self._lines[self._at]
            label = line[_LABEL].strip()
            if label == "END OF FREQUENCY":
                self._at += 1
                break
            if label == "NORTH / EAST / UP":
                offset = [float(line[10 * k : 10 * k + 10]) for k in range(3)]
            elif label != "COMMENT" or len(line) > 80:
                row = [float(line[8 + 8 * k : 16 + 8 * k]) for k in range(n_zenith)]
                if line[3:8] == "NOAZI":
                    noazi = row
                elif float(line[:8]) == len(grid) * dazi:
                    grid.append(row)
                else:
                    raise ValueError(line[:8])
            self._at += 1
        complete = offset is not None and noazi is not None and len(grid) == n_azimuth
        if not complete or not np.all(np.isfinite([*offset, *noazi, *np.ravel(grid)])):
            self._at -= 1
            raise ValueError(offset)
        return PhasePattern(
            offset_m=np.array(offset) * 1e-3,
            zenith_rad=np.deg2rad(first + step * np.arange(n_zenith)),
            noazi_m=np.array(noazi) * 1e-3,
            azimuth_rad=np.deg2rad(dazi * np.arange(n_azimuth)),
            grid_m=np.array(grid).reshape(n_azimuth, n_zenith) * 1e-3,
        )
