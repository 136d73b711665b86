"""Which signals reach the antenna, and how much weaker: horizon, masks, obstructions, outages.

A satellite is seen when it stands above the horizon and, where asked, before the antenna: the two criteria
of Oguz (2006), section 2.2.4,

    sin E = V . Up > 0,    0 < arcsin(V . u_antenna) < 90 degrees

with V the line of sight and u_antenna the antenna's axis, turned with the platform. His Up is the direction
from the Earth's centre, up to 0.19 degrees off the vertical; it is kept as a named option. Masks of the
platform (mast, cabin) count from its forward axis and deck, the horizon and obstructions from north and the
level. All is a function of the time alone, so any blocks of epochs give the same.

Reference: P. Oguz, Implementation of Northfinding Techniques, METU, 2006, sections 2.2.3 and 2.2.4.
"""

from __future__ import annotations

import math
from typing import Literal

import msgspec
import numpy as np

from ..constants import SYSTEMS
from ..errors import ConfigError
from ..frames import geodetic_from_ecef
from .obstructions import Obstruction, ObstructionModel, is_between

__all__ = ["BodyMask", "Outage", "Visibility", "VisibilitySection"]


def _refuse(key, value, wanted):
    raise ConfigError(f"`{key}` is {value!r}; give {wanted}", key=key, value=value)


class BodyMask(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A part of the platform in the way, such as a mast: it turns with the platform."""

    azimuth_deg: tuple[float, float] = (0.0, 360.0)
    """From and to, clockwise from forward."""
    elevation_deg: tuple[float, float] = (-90.0, 90.0)
    """From and to, above the deck."""
    attenuation_db: float = math.inf
    """What it takes; ``inf`` is everything."""

    def __post_init__(self) -> None:
        low, high = self.elevation_deg
        if not -90.0 <= low < high <= 90.0:
            _refuse("elevation_deg", self.elevation_deg, "two elevations, the lower first")
        if not self.attenuation_db >= 0.0:
            _refuse("attenuation_db", self.attenuation_db, "0 or more")


class Outage(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A time without satellites."""

    start_s: float
    """Seconds since the start of the scenario."""
    duration_s: float = math.inf
    """Its length; ``inf`` lasts to the end."""
    period_s: float | None = None
    """And again every so many seconds."""
    systems: str = SYSTEMS
    """Letters of the systems that are gone."""

    def __post_init__(self) -> None:
        if not self.duration_s > 0.0:
            _refuse("duration_s", self.duration_s, "a positive number")
        if self.period_s is not None and not self.period_s > self.duration_s:
            _refuse("period_s", self.period_s, "more than `duration_s`")
        if not self.systems or set(self.systems) - set(SYSTEMS):
            _refuse("systems", self.systems, f"letters among {SYSTEMS}")


class VisibilitySection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The ``[visibility]`` table."""

    elevation_mask_deg: float = 0.0
    """Satellites below this elevation are not tracked (first criterion of Oguz: 0)."""
    antenna_mask_deg: float = -90.0
    """Satellites lower than this above the deck are not tracked; 0 is the second criterion of Oguz."""
    up: Literal["geodetic", "geocentric"] = "geodetic"
    """Against what `elevation_mask_deg` counts; ``geocentric`` is the thesis of Oguz."""
    horizon_deg: tuple[tuple[float, float], ...] = ()
    """Skyline: pairs of azimuth and elevation, joined by lines in order of azimuth, closed over north."""
    body_masks: tuple[BodyMask, ...] = ()
    """Parts of the platform in the way."""
    obstructions: tuple[Obstruction, ...] = ()
    """What stands along the route."""
    outages: tuple[Outage, ...] = ()
    """Times without satellites."""

    def __post_init__(self) -> None:
        for key in ("elevation_mask_deg", "antenna_mask_deg"):
            if not -90.0 <= getattr(self, key) < 90.0:
                _refuse(key, getattr(self, key), "an angle from -90 to below 90")
        for pair in self.horizon_deg:
            if not (-360.0 <= pair[0] <= 360.0 and -90.0 <= pair[1] <= 90.0):
                _refuse("horizon_deg", pair, "pairs of azimuth and elevation")
        if len({azimuth % 360.0 for azimuth, _ in self.horizon_deg}) != len(self.horizon_deg):
            _refuse("horizon_deg", self.horizon_deg, "each azimuth once")


class Visibility:
    """What stands between satellites and antennas along a trajectory.

    Parameters
    ----------
    section : VisibilitySection
        What to model.
    trajectory : truenorth.simulation.motion.Trajectory
        Where the platform is; asked only where the section needs it.
    seed : int
        Seed of the scenario: of the fading.
    """

    def __init__(self, section, trajectory, seed):
        self.section = section
        self._trajectory = trajectory
        lap_m = getattr(trajectory, "lap_m", None)
        self._obstructions = [
            ObstructionModel(item, seed, item.name or f"{item.kind} {k}", lap_m)
            for k, item in enumerate(section.obstructions)
        ]
        self._tilt_rad = 0.0
        if section.up == "geocentric":
            position = trajectory.at(np.zeros(1)).position_ecef_m[0]
            latitude, _, _ = geodetic_from_ecef(position)
            self._tilt_rad = float(latitude - np.arctan2(position[2], np.hypot(position[0], position[1])))
        self._skyline = None
        if section.horizon_deg:
            corners = np.array(
                sorted((azimuth % 360.0, elevation) for azimuth, elevation in section.horizon_deg)
            )
            self._skyline = np.radians(corners)

    def attenuation_db(self, time_s, sat, azimuth_rad, elevation_rad, azimuth_body_rad, elevation_body_rad):
        """Compute what platform and surroundings take from signals.

        Parameters
        ----------
        time_s : ndarray, shape (n,)
            Seconds since the start of the scenario.
        sat : ndarray of int, shape (n,)
            Satellites.
        azimuth_rad, elevation_rad : ndarray, shape (n,)
            Direction of the satellite from the platform, clockwise from north and above the level.
        azimuth_body_rad, elevation_body_rad : ndarray, shape (n,)
            The same in the body frame: clockwise from forward, and above the deck.

        Returns
        -------
        ndarray, shape (n,)
            Decibels; infinite where the signal is blocked.
        """
        time_s, azimuth_rad, elevation_rad = (
            np.atleast_1d(np.asarray(values, dtype=float)) for values in (time_s, azimuth_rad, elevation_rad)
        )
        sat = np.atleast_1d(np.asarray(sat, dtype=np.int64))
        time_s = np.broadcast_to(time_s, sat.shape)
        section = self.section
        blocked = self._above_horizon(azimuth_rad, elevation_rad) < np.radians(section.elevation_mask_deg)
        blocked |= np.asarray(elevation_body_rad) < np.radians(section.antenna_mask_deg)
        if self._skyline is not None:
            azimuth, elevation = self._skyline.T
            blocked |= elevation_rad < np.interp(azimuth_rad, azimuth, elevation, period=2.0 * np.pi)
        for outage in section.outages:
            blocked |= _is_out(outage, time_s, sat)
        loss_db = np.where(blocked, np.inf, 0.0)
        for mask in section.body_masks:
            low, high = np.radians(mask.elevation_deg)
            hit = is_between(azimuth_body_rad, *mask.azimuth_deg)
            hit &= (elevation_body_rad >= low) & (elevation_body_rad <= high)
            loss_db += np.where(hit, mask.attenuation_db, 0.0)
        if self._obstructions:
            way_m, course_rad = self._route(time_s)
            for model in self._obstructions:
                loss_db += model.attenuation_db_at(time_s, way_m, course_rad, sat, azimuth_rad, elevation_rad)
        return loss_db

    def _above_horizon(self, azimuth_rad, elevation_rad):
        if self._tilt_rad == 0.0:
            return elevation_rad
        # The axis from the Earth's centre leans from the vertical towards the equator.
        c, s = np.cos(self._tilt_rad), np.sin(self._tilt_rad)
        sine = c * np.sin(elevation_rad) - s * np.cos(elevation_rad) * np.cos(azimuth_rad)
        return np.arcsin(np.clip(sine, -1.0, 1.0))

    def _route(self, time_s):
        """Distance along the route and course at each ray; None where no obstruction asks."""
        by_way = any(model.is_by_way for model in self._obstructions)
        by_course = any(model.needs_course for model in self._obstructions)
        if not (by_way or by_course):
            return None, None
        # Rays of an epoch share the time.
        times, place = np.unique(time_s, return_inverse=True)
        way_m = np.asarray(self._trajectory.distance_m(times))[place] if by_way else None
        course_rad = np.asarray(self._trajectory.course_rad(times))[place] if by_course else None
        return way_m, course_rad


def _is_out(outage, time_s, sat):
    since_s = time_s - outage.start_s
    if outage.period_s is not None:
        since_s = np.where(since_s >= 0.0, np.mod(since_s, outage.period_s), since_s)
    gone = np.isin(sat // 100, [SYSTEMS.index(letter) for letter in outage.systems])
    return (since_s >= 0.0) & (since_s < outage.duration_s) & gone
