"""What stands beside the route: trees, buildings, underpasses, forests.

An obstruction holds on a stretch of the route or for a time. Beside the road it is a row of height h (above
the antenna) at the distance d across the road; at the azimuth alpha from the course it reaches up to

    tan e = (h / d) |sin alpha|

on its side. What a tree or forest takes fades about its mean: the attenuation in decibels is normal, with a
standard deviation and a correlation length (log-normal shadowing), and never below zero. The fading is a
fixed function of the seed, the obstruction, the satellite and the place (or the time), so it is the same
however the run is cut into blocks, and in every lap.

Reference for the sizes: J. Goldhirsh, W. J. Vogel, "Propagation effects for land mobile satellite systems",
NASA RP 1274, 1992, chapters 2 and 3 (single trees at 1.5 GHz: 10 to 14 dB).
"""

from __future__ import annotations

import math
import zlib
from typing import Literal

import msgspec
import numpy as np

from ..errors import ConfigError

__all__ = ["Obstruction", "ObstructionModel", "is_between", "shadowing"]


def _refuse(key, value, wanted):
    raise ConfigError(f"`{key}` is {value!r}; give {wanted}", key=key, value=value)


_KINDS = {
    # Side, height and distance of the row, attenuation, its standard deviation.
    "tree": ("right", 8.0, 5.0, 12.0, 5.0),
    "building": ("right", 10.0, 8.0, math.inf, 0.0),
    "underpass": ("around", 0.0, 0.0, math.inf, 0.0),
    "forest": ("around", 0.0, 0.0, 25.0, 7.0),
    "custom": ("around", 0.0, 0.0, math.inf, 0.0),
}


class Obstruction(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One obstruction, a ``[[visibility.obstructions]]`` table; what is left out is usual for its kind."""

    kind: Literal["tree", "building", "underpass", "forest", "custom"]
    name: str = ""
    """Of its own, for the fading; by default its kind and place in the list."""
    start_s: float | None = None
    """From this time on, seconds since the start of the scenario."""
    end_s: float | None = None
    """Up to this time."""
    period_s: float | None = None
    """And again every so many seconds."""
    start_m: float | None = None
    """From this distance along the route on, metres since its start."""
    end_m: float | None = None
    """Up to this distance."""
    lap_m: float | None = None
    """And again every so many metres."""
    every_lap: bool = False
    """And again in every lap of a closed route."""
    side: Literal["left", "right", "both", "around"] | None = None
    """Side of the road; ``around`` is everywhere. Tree and building: right; the others: around."""
    height_m: float | None = None
    """Height of the row beside the road above the antenna. Tree 8, building 10."""
    distance_m: float | None = None
    """Distance of the row from the antenna, across the road. Tree 5, building 8."""
    azimuth_deg: tuple[float, float] | None = None
    """Only within these azimuths, clockwise from the first to the second."""
    azimuth_from: Literal["north", "course"] = "north"
    """What they count from."""
    elevation_deg: tuple[float, float] = (-90.0, 90.0)
    """Only within these elevations."""
    attenuation_db: float | None = None
    """What it takes, on average; ``inf`` is everything. Tree 12, forest 25, the others all."""
    fading_sd_db: float | None = None
    """Standard deviation of the fading. Tree 5, forest 7."""
    correlation_m: float = 2.0
    """Length over which the fading changes, of an obstruction given by distance."""
    correlation_s: float = 1.0
    """Time over which it changes, of any other."""

    def __post_init__(self) -> None:
        by_time = any(value is not None for value in (self.start_s, self.end_s, self.period_s))
        by_way = any(value is not None for value in (self.start_m, self.end_m, self.lap_m)) or self.every_lap
        if by_time and by_way:
            _refuse("start_m", self.start_m, "either times or distances")
        for unit in ("s", "m"):
            start, end = getattr(self, f"start_{unit}"), getattr(self, f"end_{unit}")
            if start is not None and end is not None and not end > start:
                _refuse(f"end_{unit}", end, f"more than `start_{unit}` ({start!r})")
        for key in ("period_s", "lap_m", "distance_m", "correlation_m", "correlation_s"):
            value = getattr(self, key)
            if value is not None and not value > 0.0:
                _refuse(key, value, "a positive number")
        if self.lap_m is not None and self.every_lap:
            _refuse("lap_m", self.lap_m, "it or `every_lap`, not both")
        for key in ("height_m", "attenuation_db", "fading_sd_db"):
            value = getattr(self, key)
            if value is not None and not value >= 0.0:
                _refuse(key, value, "0 or more")
        if self.fading_sd_db == math.inf:
            _refuse("fading_sd_db", self.fading_sd_db, "a finite number")
        low, high = self.elevation_deg
        if not -90.0 <= low < high <= 90.0:
            _refuse("elevation_deg", self.elevation_deg, "two elevations, the lower first")
        if self.kind == "custom" and self.side not in (None, "around"):
            for key in ("height_m", "distance_m"):
                if getattr(self, key) is None:
                    _refuse(key, None, "it, for an obstruction of your own beside the road")


def is_between(angle_rad, first_deg, last_deg):
    """Whether angles lie in a range that runs clockwise from the first to the last, both included."""
    span = (last_deg - first_deg) % 360.0
    if span == 0.0 and last_deg != first_deg:
        return np.ones(np.shape(angle_rad), dtype=bool)
    turned = np.mod(np.degrees(angle_rad) - first_deg, 360.0)
    # An angle a rounding error before the first is not a whole turn after it.
    return (turned <= span + 1e-9) | (turned >= 360.0 - 1e-9)


_MULTIPLIERS = (np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB))
_STEP = np.uint64(0x9E3779B97F4A7C15)


def _hashed(value):
    """Mix 64 bits (the finaliser of SplitMix64; G. Steele, D. Lea, C. Flood, OOPSLA 2014)."""
    value = (value ^ (value >> np.uint64(30))) * _MULTIPLIERS[0]
    value = (value ^ (value >> np.uint64(27))) * _MULTIPLIERS[1]
    return value ^ (value >> np.uint64(31))


def _normal_at(key, node):
    """A nearly normal number for each key and node: the sum of twelve uniform ones, exact on any machine."""
    bits = _hashed(key + _STEP * node.astype(np.uint64))
    total = np.zeros(np.shape(bits))
    for _ in range(3):
        bits = _hashed(bits + _STEP)
        for shift in (0, 16, 32, 48):
            total += ((bits >> np.uint64(shift)) & np.uint64(0xFFFF)).astype(np.float64)
    # Each part has the mean 65535 / 2 and the variance (2^32 - 1) / 12: the sum of twelve has (2^32 - 1).
    return (total - 6.0 * 65_535.0) / 65_536.0


_NODES = 0.82


def shadowing(key, position, correlation):
    """Normal process with mean 0 and variance 1, a fixed function of its key and the position.

    Between independent numbers at evenly spaced nodes it is blended so that the variance stays 1; the nodes
    are 1 / 0.82 lengths apart, for which the correlation is 1/e at one length. It is 0 beyond 2.5.

    Parameters
    ----------
    key : ndarray of uint64, shape (n,)
        Which function.
    position : ndarray, shape (n,)
        Where, metres or seconds.
    correlation : float
        Correlation length, in the same unit.

    Returns
    -------
    ndarray, shape (n,)
    """
    place = position * (_NODES / correlation)
    node = np.floor(place)
    x = place - node
    later = x * x * (3.0 - 2.0 * x)
    earlier = 1.0 - later
    node = node.astype(np.int64)
    blended = earlier * _normal_at(key, node) + later * _normal_at(key, node + 1)
    return blended / np.sqrt(earlier * earlier + later * later)


class ObstructionModel:
    """An obstruction with all that its kind says, for one seed.

    Parameters
    ----------
    obstruction : Obstruction
        What stands there.
    seed : int
        Seed of the scenario.
    name : str
        Its name for the fading.
    lap_m : float or None
        Length of a lap of the route, where it is closed.
    """

    def __init__(self, obstruction, seed, name, lap_m):
        side, height_m, distance_m, attenuation_db, fading_sd_db = _KINDS[obstruction.kind]

        def given(key, usual):
            value = getattr(obstruction, key)
            return usual if value is None else value

        self._obstruction = obstruction
        self.side = given("side", side)
        self.slope = 0.0
        if self.side != "around":
            self.slope = given("height_m", height_m or 8.0) / given("distance_m", distance_m or 5.0)
        self.attenuation_db = given("attenuation_db", attenuation_db)
        self.fading_sd_db = given("fading_sd_db", fading_sd_db) if np.isfinite(self.attenuation_db) else 0.0
        self.period_m = lap_m if obstruction.every_lap else obstruction.lap_m
        if obstruction.every_lap and lap_m is None:
            _refuse("every_lap", True, "a closed route with it, or `lap_m`")
        self.is_by_way = self.period_m is not None or not (
            obstruction.start_m is None and obstruction.end_m is None
        )
        self._key = np.uint64(zlib.crc32(name.encode()) | (int(seed) & 0xFFFFFFFF) << 32)

    @property
    def needs_course(self):
        """bool: The direction of travel matters."""
        relative = self._obstruction.azimuth_deg is not None and self._obstruction.azimuth_from == "course"
        return self.side != "around" or relative

    def attenuation_db_at(self, time_s, way_m, course_rad, sat, azimuth_rad, elevation_rad):
        """Decibels taken from rays, shape (n,); ``way_m`` and ``course_rad`` may be None where not needed."""
        obstruction = self._obstruction
        if self.is_by_way:
            place, period = way_m, self.period_m
            first, last = obstruction.start_m, obstruction.end_m
        else:
            place, period = time_s, obstruction.period_s
            first, last = obstruction.start_s, obstruction.end_s
        first = -np.inf if first is None else first
        last = np.inf if last is None else last
        if period is not None:
            # Counted from the start of the stretch, which may run over the end of a lap.
            origin = first if np.isfinite(first) else 0.0
            place = origin + np.mod(place - origin, period)
        low, high = obstruction.elevation_deg
        hit = (place >= first) & (place < last)
        hit &= (elevation_rad >= np.radians(low)) & (elevation_rad <= np.radians(high))
        if obstruction.azimuth_deg is not None:
            origin_rad = course_rad if obstruction.azimuth_from == "course" else 0.0
            hit &= is_between(azimuth_rad - origin_rad, *obstruction.azimuth_deg)
        if self.side != "around":
            across = np.sin(azimuth_rad - course_rad)
            if self.side == "both":
                across = np.abs(across)
            elif self.side == "left":
                across = -across
            hit &= (across > 0.0) & (elevation_rad < np.arctan(self.slope * across))
        loss_db = np.where(hit, self.attenuation_db, 0.0)
        if self.fading_sd_db > 0.0 and np.any(hit):
            rows = np.flatnonzero(hit)
            key = _hashed(self._key + _STEP * sat[rows].astype(np.uint64))
            correlation = obstruction.correlation_m if self.is_by_way else obstruction.correlation_s
            fading = shadowing(key, place[rows], correlation)
            loss_db[rows] = np.maximum(loss_db[rows] + self.fading_sd_db * fading, 0.0)
        return loss_db
