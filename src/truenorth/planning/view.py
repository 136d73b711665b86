"""Which signals a platform will receive over time, from where, and with how much noise.

All antennas of the platform see the same satellites: what differs between them (a mast before one of them)
is not planned. The noise is that of the solver,

    sd^2 = (a^2 + b^2 / sin^2 E) 10^(s (C_0 - C/N0) / 10),     C/N0 below C_0,

with the C/N0 that an antenna of the usual gain has at that elevation, less what an obstruction takes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from ..constants import BAND_CLASSES, GLONASS, SPEED_OF_LIGHT_MPS, SYSTEMS
from ..errors import NoSolutionError
from ..frames import ecef_from_geodetic
from ..observations import frequency_hz
from ..rotations import rot_ned_from_body
from .settings import PlanSettings

__all__ = ["SkyView", "sky_view"]


@dataclass(frozen=True, slots=True, eq=False)
class SkyView:
    """Signals in view at each epoch: rows sorted by (epoch, satellite, signal).

    Parameters
    ----------
    time_ns : ndarray of int64, shape (n,)
        GPS time.
    epoch_start : ndarray of int64, shape (n + 1,)
        Rows of epoch k are ``epoch_start[k]:epoch_start[k + 1]``.
    satellite : ndarray of int64, shape (m,)
    group : ndarray of int64, shape (m,)
        Rows of a system and band share a number.
    line_of_sight_ned : ndarray, shape (m, 3)
        Unit vectors to the satellites.
    azimuth_rad, elevation_rad : ndarray, shape (m,)
    wavelength_m : ndarray, shape (m,)
        Of GLONASS that of channel 0.
    phase_variance_m2, code_variance_m2 : ndarray, shape (m,)
        Of an undifferenced observation.
    has_integers : ndarray of bool, shape (m,)
        The phase counts once its integers are fixed.
    groups : tuple of str
        System and band by group number.
    """

    time_ns: np.ndarray
    epoch_start: np.ndarray
    satellite: np.ndarray
    group: np.ndarray
    line_of_sight_ned: np.ndarray
    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray
    wavelength_m: np.ndarray
    phase_variance_m2: np.ndarray
    code_variance_m2: np.ndarray
    has_integers: np.ndarray
    groups: tuple[str, ...]

    @property
    def n_epochs(self) -> int:
        """int: Number of epochs."""
        return len(self.time_ns)

    @property
    def epoch(self) -> np.ndarray:
        """Ndarray of int64, shape (m,): epoch of each row."""
        return np.repeat(np.arange(self.n_epochs), np.diff(self.epoch_start))

    def rows(self, epoch: int) -> slice:
        """Rows of an epoch."""
        return slice(int(self.epoch_start[epoch]), int(self.epoch_start[epoch + 1]))

    def n_satellites(self) -> np.ndarray:
        """Satellites in view, ndarray of int, shape (n,)."""
        first = np.ones(len(self.satellite), dtype=bool)
        first[1:] = (np.diff(self.satellite) != 0) | (np.diff(self.epoch) != 0)
        return np.bincount(self.epoch[first], minlength=self.n_epochs)


class _Standing:
    """A platform at one place of a route."""

    def __init__(self, position_ecef_m: np.ndarray, along_m: float, course_rad: float) -> None:
        self._position_ecef_m, self._along_m, self._course_rad = position_ecef_m, along_m, course_rad

    def distance_m(self, time_s: np.ndarray) -> np.ndarray:
        return np.full(len(time_s), self._along_m)

    def course_rad(self, time_s: np.ndarray) -> np.ndarray:
        return np.full(len(time_s), self._course_rad)

    def at(self, time_s: np.ndarray) -> Any:
        from types import SimpleNamespace

        return SimpleNamespace(position_ecef_m=np.tile(self._position_ecef_m, (len(time_s), 1)))


def sky_view(settings: PlanSettings) -> SkyView:
    """Compute the signals that a platform will receive.

    Parameters
    ----------
    settings : PlanSettings
        Where, when, and what stands in the way.

    Returns
    -------
    SkyView

    Raises
    ------
    NoSolutionError
        If no satellite is in view at any time.
    """
    from ..simulation.receivers import ReceiverSection, antenna_gain_db
    from ..simulation.sky import build_sky
    from ..simulation.sky.tracks import tracks

    place = ecef_from_geodetic(
        np.radians(settings.latitude_deg), np.radians(settings.longitude_deg), settings.height_m
    )
    time_ns = settings.time_ns
    sky = build_sky(
        settings.sky,
        start_ns=settings.start_ns,
        duration_s=max(float(time_ns[-1] - time_ns[0]) * 1e-9, 1.0),
        seed=settings.seed,
        position_ecef_m=place,
    )
    seen = tracks(sky, place, time_ns)
    with np.errstate(invalid="ignore"):
        is_up = seen.elevation_rad >= np.radians(settings.elevation_mask_deg)
    is_up &= np.isin(seen.sat // 100, [SYSTEMS.index(letter) for letter in settings.systems])
    epoch, column = np.nonzero(is_up)
    sat = seen.sat[column].astype(np.int64)
    azimuth, elevation = seen.azimuth_rad[epoch, column], seen.elevation_rad[epoch, column]
    ned = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), -np.sin(elevation)], -1
    )
    receiver = ReceiverSection(
        zenith_cn0_dbhz=settings.zenith_cn0_dbhz, horizon_cn0_dbhz=settings.horizon_cn0_dbhz
    )
    rot = rot_ned_from_body(*np.radians([settings.heading_deg, settings.pitch_deg, settings.roll_deg]))
    body = ned @ rot
    cn0_dbhz = settings.zenith_cn0_dbhz + antenna_gain_db(receiver, -body[:, 2])
    time_s = (time_ns[epoch] - time_ns[0]) * 1e-9
    loss_db = _in_the_way(settings, place).attenuation_db(
        time_s,
        sat,
        np.mod(azimuth, 2.0 * np.pi),
        elevation,
        np.mod(np.arctan2(body[:, 1], body[:, 0]), 2.0 * np.pi),
        np.arcsin(np.clip(-body[:, 2], -1.0, 1.0)),
    )
    cn0_dbhz = cn0_dbhz - loss_db
    received = (loss_db == 0.0) | (cn0_dbhz >= settings.lose_dbhz)
    if not np.any(received):
        raise NoSolutionError(
            f"no satellite of {settings.systems} is in view above {settings.elevation_mask_deg:g} degrees at "
            f"any of {len(time_ns)} epochs; lower the mask, or add systems"
        )
    rows = np.flatnonzero(received)
    return _signals(settings, time_ns, epoch[rows], sat[rows], ned[rows], azimuth[rows], cn0_dbhz[rows])


def _in_the_way(settings: PlanSettings, place: np.ndarray) -> Any:
    """What stands between the satellites and a platform that stands still."""
    import msgspec

    from ..simulation.visibility import Visibility

    section = settings.visibility
    if settings.along_m is None:
        by_time = tuple(
            item
            for item in section.obstructions
            if item.start_m is None and item.end_m is None and item.lap_m is None and not item.every_lap
        )
        section = msgspec.structs.replace(section, obstructions=by_time)
    standing = _Standing(place, settings.along_m or 0.0, float(np.radians(settings.heading_deg)))
    return Visibility(section, standing, settings.seed)


def _signals(
    settings: PlanSettings,
    time_ns: np.ndarray,
    epoch: np.ndarray,
    sat: np.ndarray,
    ned: np.ndarray,
    azimuth_rad: np.ndarray,
    cn0_dbhz: np.ndarray,
) -> SkyView:
    """Rows of every signal of satellites in view."""
    noise = settings.stochastic
    rows, bands, digits = [], [], []
    for number, band in enumerate(settings.bands):
        digit = np.zeros(len(SYSTEMS), dtype=np.int64)
        for letter, bands_of in cast("dict[str, tuple[int, ...]]", BAND_CLASSES[band]).items():
            digit[SYSTEMS.index(letter)] = bands_of[0]
        has = np.flatnonzero(digit[sat // 100] > 0)
        rows.append(has)
        bands.append(np.full(len(has), number))
        digits.append(digit[sat[has] // 100])
    row, band_of, digit_of = (np.concatenate(parts) for parts in (rows, bands, digits))
    order = np.lexsort((band_of, sat[row], epoch[row]))
    row, band_of, digit_of = row[order], band_of[order], digit_of[order]
    sat, epoch, ned, azimuth_rad, cn0_dbhz = (
        values[row] for values in (sat, epoch, ned, azimuth_rad, cn0_dbhz)
    )
    elevation = np.arcsin(np.clip(-ned[:, 2], -1.0, 1.0))
    # Below the horizon the law has no meaning; a tenth of a degree stands for all that is there.
    sine2 = np.maximum(np.sin(elevation), 0.002) ** 2
    weak_db = np.maximum(noise.cn0_reference_dbhz - cn0_dbhz, 0.0)
    factor = 10.0 ** (0.1 * noise.cn0_slope * weak_db)
    channel = np.zeros(100)
    wavelength = SPEED_OF_LIGHT_MPS / frequency_hz(sat, 100 * digit_of, channel)
    key = (sat // 100) * len(settings.bands) + band_of
    known, group = np.unique(key, return_inverse=True)
    names = tuple(
        f"{SYSTEMS[code // len(settings.bands)]} {settings.bands[code % len(settings.bands)]}"
        for code in known.tolist()
    )
    is_fdma = (sat // 100 == GLONASS) & (digit_of <= 2)
    return SkyView(
        time_ns=time_ns,
        epoch_start=np.searchsorted(epoch, np.arange(len(time_ns) + 1)).astype(np.int64),
        satellite=sat,
        group=group.astype(np.int64),
        line_of_sight_ned=ned,
        azimuth_rad=np.mod(azimuth_rad, 2.0 * np.pi),
        elevation_rad=elevation,
        wavelength_m=wavelength,
        phase_variance_m2=factor * (noise.phase_sd_m**2 + noise.phase_elevation_sd_m**2 / sine2),
        code_variance_m2=factor * (noise.code_sd_m**2 + noise.code_elevation_sd_m**2 / sine2),
        has_integers=~is_fdma | (settings.glonass_ambiguities == "calibrated"),
        groups=names,
    )
