r"""Marks from theodolites: forward intersection, and the adjustment of all directions and zenith angles.

A direction read at station A towards N, oriented by o, is the azimuth nu = alpha + o. Two of them, from A and
B, give the point by

    s_AN = s_AB sin(nu_BN - nu_AB) / sin(nu_BN - nu_AN)
    x_N = x_A + s_AN cos nu_AN,        y_N = y_A + s_AN sin nu_AN

and zenith angles its height, h_N = h_A + i_A + s_AN cot zeta_AN. All sets from all stations are adjusted
together: unknown are the marks, an orientation of every set, and the stations within what is known of them.
Each observation is tested with its normalised residual w = v / (sigma_v); the worst beyond the limit is left
out, one after the other.

References
----------
K. Landfahrer, "Attitude determination using a GPS multi antenna array", MSc thesis, TU Graz, 2009, eqs. (4.1)
to (4.6); W. Baarda, "A testing procedure for use in geodetic networks", Netherlands Geodetic Commission 2
(1968).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..ambiguity.acceptance import chi2_quantile
from ..errors import ConfigError, NoSolutionError

__all__ = ["Pointing", "Station", "TheodoliteNetwork", "adjust_pointings", "forward_intersection"]

MAX_STEPS = 20
STEP_LIMIT_M = 1e-7
MIN_SINE = 0.02
"""Rays that meet at less than this do not meet anywhere in particular."""


@dataclass(frozen=True, slots=True)
class Station:
    """A pillar.

    Parameters
    ----------
    name : str
        As the pointings name it.
    north_m, east_m, height_m : float
        Of the mark on it, in a local frame.
    instrument_height_m : float
        From the mark to the tilting axis.
    sd_m : float
        Of each coordinate.
    """

    name: str
    north_m: float
    east_m: float
    height_m: float
    instrument_height_m: float = 0.0
    sd_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Pointing:
    """One pointing: both faces averaged.

    Parameters
    ----------
    station, target : str
        Names; the target is a mark or another station.
    series : str
        The set: one orientation of the circle.
    direction_rad : float
        Horizontal circle, clockwise; NaN if not read.
    zenith_rad : float
        Vertical circle, from the zenith; NaN if not read.
    direction_sd_rad, zenith_sd_rad : float
        Standard deviations.
    """

    station: str
    target: str
    series: str
    direction_rad: float
    zenith_rad: float = np.nan
    direction_sd_rad: float = 5e-6
    zenith_sd_rad: float = 5e-6


@dataclass(frozen=True, slots=True, eq=False)
class TheodoliteNetwork:
    """Adjusted marks.

    Parameters
    ----------
    names : tuple of str
        Of the marks.
    position_ned_m : ndarray, shape (k, 3)
        North, east, down: minus the height.
    cov_m2 : ndarray, shape (3 k, 3 k)
        Joint covariance, by the stated standard deviations.
    orientation_rad : dict of (str, str) to float
        By station and set: azimuth of the zero of the circle.
    residual_rad : ndarray, shape (n, 2)
        Of each pointing, direction and zenith angle, observed less adjusted; NaN where not read.
    w : ndarray, shape (n, 2)
        Normalised residuals; NaN where nothing controls the observation.
    redundancy : ndarray, shape (n, 2)
        Part of an error that shows in the residual, 0 to 1.
    is_excluded : ndarray of bool, shape (n, 2)
        Blunders.
    statistic, limit : float
        Square sum of the normalised residuals of those kept, and the limit of it.
    degrees : int
        Degrees of freedom.
    events : tuple of str
        A sentence for each blunder.
    """

    names: tuple[str, ...]
    position_ned_m: np.ndarray
    cov_m2: np.ndarray
    orientation_rad: dict[tuple[str, str], float]
    residual_rad: np.ndarray
    w: np.ndarray
    redundancy: np.ndarray
    is_excluded: np.ndarray
    statistic: float
    limit: float
    degrees: int
    events: tuple[str, ...] = ()

    @property
    def sd_m(self) -> np.ndarray:
        """Ndarray, shape (k, 3): standard deviations of the coordinates."""
        return np.sqrt(np.diag(self.cov_m2)).reshape(-1, 3)


def forward_intersection(a_m, b_m, azimuth_a_rad, azimuth_b_rad):
    """Point from its azimuths at two stations; Landfahrer 2009, eqs. (4.2) to (4.6).

    Parameters
    ----------
    a_m, b_m : array_like, shape (2,)
        Northing and easting of the stations.
    azimuth_a_rad, azimuth_b_rad : float
        Oriented directions to the point.

    Returns
    -------
    point_m : ndarray, shape (2,)
        Northing and easting.
    distance_a_m, distance_b_m : float
        Horizontal distances from the stations; a negative one means that the rays meet behind it.

    Raises
    ------
    ConfigError
        If the rays are parallel.
    """
    a_m, b_m = np.asarray(a_m, dtype=float), np.asarray(b_m, dtype=float)
    apart = b_m - a_m
    base_m, base_rad = np.hypot(*apart), np.arctan2(apart[1], apart[0])
    sine = np.sin(azimuth_b_rad - azimuth_a_rad)
    if abs(sine) < MIN_SINE:
        raise ConfigError("the rays of the two stations are parallel and meet nowhere", key="azimuth")
    from_a = base_m * np.sin(azimuth_b_rad - base_rad) / sine
    from_b = base_m * np.sin(azimuth_a_rad - base_rad) / sine
    point_m = a_m + from_a * np.array([np.cos(azimuth_a_rad), np.sin(azimuth_a_rad)])
    return point_m, float(from_a), float(from_b)


def adjust_pointings(stations, pointings, *, significance: float = 1e-3, max_excluded: int | None = None):
    """Adjust the marks of a theodolite survey.

    Parameters
    ----------
    stations : sequence of Station
        Pillars with known coordinates.
    pointings : sequence of Pointing
        To marks and to other stations, which orient the sets.
    significance : float
        False-alarm rate of the test of a single observation.
    max_excluded : int, optional
        Observations left out at most; a tenth of them, by default.

    Returns
    -------
    TheodoliteNetwork

    Raises
    ------
    ConfigError
        If a pointing names an unknown station, or a set is not oriented.
    NoSolutionError
        If the observations do not determine the marks.
    """
    network = _Network(stations, pointings)
    read = network.is_read.copy()
    max_excluded = max(int(read.sum()) // 10, 1) if max_excluded is None else max_excluded
    limit = np.sqrt(chi2_quantile(1.0 - significance, 1))
    excluded = np.zeros_like(read)
    events = []
    while True:
        network.adjust(read & ~excluded)
        size = np.where(read & ~excluded & (network.redundancy > 1e-3), np.abs(network.w), 0.0)
        worst = np.unravel_index(np.argmax(size), size.shape)
        if size[worst] <= limit or excluded.sum() >= max_excluded:
            break
        excluded[worst] = True
        p = pointings[worst[0]]
        kind = ("direction", "zenith angle")[worst[1]]
        events.append(
            f"{kind} of set {p.series} from {p.station} to {p.target} is left out: its normalised residual "
            f"is {size[worst]:.1f}, limit {limit:.1f}"
        )
    degrees = int(np.count_nonzero(read & ~excluded)) - network.n_free
    if degrees < 0:
        raise NoSolutionError("could not adjust the pointings: there are fewer than unknowns; observe more")
    return TheodoliteNetwork(
        names=tuple(network.marks),
        position_ned_m=network.mark_m * [1.0, 1.0, -1.0],
        cov_m2=network.mark_cov(),
        orientation_rad=dict(
            zip(network.series, np.mod(network.orientation_rad, 2.0 * np.pi).tolist(), strict=True)
        ),
        residual_rad=network.residual,
        w=network.w,
        redundancy=network.redundancy,
        is_excluded=excluded,
        statistic=network.statistic,
        limit=float(chi2_quantile(1.0 - significance, degrees)) if degrees else 0.0,
        degrees=degrees,
        events=tuple(events),
    )


class _Network:
    """Unknowns: marks (north, east, height), orientations of sets, corrections of stations."""

    def __init__(self, stations, pointings):
        self.pointings = list(pointings)
        if not self.pointings:
            raise ConfigError("there are no pointings; give some", key="pointings")
        self.stations = [station.name for station in stations]
        if len(set(self.stations)) != len(self.stations):
            raise ConfigError("two stations have one name; give each its own", key="stations")
        self.station_m = np.array([[s.north_m, s.east_m, s.height_m] for s in stations], dtype=float)
        self.axis_m = np.array([s.instrument_height_m for s in stations], dtype=float)
        self.station_sd_m = np.array([s.sd_m for s in stations], dtype=float)
        for p in self.pointings:
            if p.station not in self.stations:
                raise ConfigError(
                    f"a pointing is from {p.station!r}, which is no station; the stations are "
                    + ", ".join(self.stations),
                    key="station",
                    value=p.station,
                )
        targets = dict.fromkeys(p.target for p in self.pointings)
        self.marks = [name for name in targets if name not in self.stations]
        self.series = list(dict.fromkeys((p.station, p.series) for p in self.pointings))
        self.observed = np.array([[p.direction_rad, p.zenith_rad] for p in self.pointings], dtype=float)
        self.sd = np.array([[p.direction_sd_rad, p.zenith_sd_rad] for p in self.pointings], dtype=float)
        self.is_read = np.isfinite(self.observed)
        if not np.all(self.sd > 0.0):
            raise ConfigError("a pointing has no positive standard deviation; give one", key="sd")
        self.start_station_m = self.station_m.copy()
        self.n_free = 3 * len(self.marks) + len(self.series)
        self._orient()
        self._intersect()

    def _orient(self):
        """Orientations from pointings to other stations."""
        self.orientation_rad = np.full(len(self.series), np.nan)
        for k, (name, series) in enumerate(self.series):
            turns = []
            for p, read in zip(self.pointings, self.is_read, strict=True):
                if (p.station, p.series) == (name, series) and p.target in self.stations and read[0]:
                    apart = (
                        self.station_m[self.stations.index(p.target)]
                        - self.station_m[self.stations.index(name)]
                    )
                    turns.append(np.exp(1j * (np.arctan2(apart[1], apart[0]) - p.direction_rad)))
            if not turns:
                raise ConfigError(
                    f"set {series} at {name} points to no other station, so that its circle is not oriented",
                    key="series",
                    value=series,
                )
            self.orientation_rad[k] = np.angle(np.median(np.real(turns)) + 1j * np.median(np.imag(turns)))

    def _intersect(self):
        """Approximate marks from the two rays that meet best."""
        self.mark_m = np.full((len(self.marks), 3), np.nan)
        for k, mark in enumerate(self.marks):
            rays = []
            for p, read in zip(self.pointings, self.is_read, strict=True):
                if p.target == mark and read[0]:
                    azimuth = p.direction_rad + self.orientation_rad[self.series.index((p.station, p.series))]
                    rays.append((self.stations.index(p.station), azimuth, p.zenith_rad))
            places = []
            for i, (a, azimuth_a, zenith) in enumerate(rays):
                for b, azimuth_b, _ in rays[i + 1 :]:
                    if a == b or abs(np.sin(azimuth_b - azimuth_a)) < MIN_SINE:
                        continue
                    point, from_a, _ = forward_intersection(
                        self.station_m[a, :2], self.station_m[b, :2], azimuth_a, azimuth_b
                    )
                    height = self.station_m[a, 2] + self.axis_m[a] + from_a / np.tan(zenith)
                    places.append([*point, height])
            if not places:
                raise NoSolutionError(
                    f"could not adjust the pointings: the rays to {mark} are of one station or parallel"
                )
            places = np.array(places)
            has_height = np.isfinite(places[:, 2])
            if not has_height.any():
                raise NoSolutionError(f"could not adjust the pointings: no zenith angle to {mark}; read one")
            self.mark_m[k] = np.median(places[has_height], axis=0)

    def _model(self):
        """Computed observations and their derivatives by all unknowns."""
        n_marks, n_series = len(self.marks), len(self.series)
        width = 3 * n_marks + n_series + 3 * len(self.stations)
        computed = np.zeros((len(self.pointings), 2))
        design = np.zeros((len(self.pointings), 2, width))
        first_station = 3 * n_marks + n_series
        for row, p in enumerate(self.pointings):
            a = self.stations.index(p.station)
            from_columns = first_station + 3 * a + np.arange(3)
            if p.target in self.marks:
                k = self.marks.index(p.target)
                target, columns = self.mark_m[k], 3 * k + np.arange(3)
            else:
                b = self.stations.index(p.target)
                target, columns = self.station_m[b], first_station + 3 * b + np.arange(3)
            north, east, up = target - self.station_m[a]
            up -= self.axis_m[a]
            level, square = np.hypot(north, east), north**2 + east**2 + up**2
            turn = self.series.index((p.station, p.series))
            computed[row] = np.arctan2(east, north) - self.orientation_rad[turn], np.arctan2(level, up)
            of_direction = np.array([-east, north, 0.0]) / level**2
            of_zenith = np.array([up * north / level, up * east / level, -level]) / square
            for kind, gradient in enumerate((of_direction, of_zenith)):
                design[row, kind, columns] += gradient
                design[row, kind, from_columns] -= gradient
            design[row, 0, 3 * n_marks + turn] = -1.0
        return computed, design

    def adjust(self, is_used):
        """Gauss-Newton with some of the observations; then their tests."""
        n_marks, n_series = len(self.marks), len(self.series)
        fixed = np.repeat(self.station_sd_m <= 0.0, 3)
        free = np.concatenate([np.ones(3 * n_marks + n_series, bool), ~fixed])
        prior = np.zeros(len(free))
        stations = slice(3 * n_marks + n_series, None)
        prior[stations][~fixed] = 1.0 / np.repeat(self.station_sd_m, 3)[~fixed] ** 2
        for _ in range(MAX_STEPS):
            residual, design = self._residual()
            white = (design / self.sd[..., None])[is_used][:, free]
            rhs = white.T @ (residual / self.sd)[is_used]
            off = np.zeros(len(free))
            off[stations] = (self.start_station_m - self.station_m).ravel()
            normal = white.T @ white + np.diag(prior[free])
            rhs += (prior * off)[free]
            scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
            scaled = scale[:, None] * normal * scale
            if np.linalg.eigvalsh(scaled)[0] < 1e-12:
                raise NoSolutionError(
                    "could not adjust the pointings: they do not determine all marks and orientations; "
                    "observe more, from two stations at least"
                )
            step = np.zeros(len(free))
            step[free] = scale * np.linalg.solve(scaled, scale * rhs)
            self.mark_m += step[: 3 * n_marks].reshape(-1, 3)
            self.orientation_rad += step[3 * n_marks : 3 * n_marks + n_series]
            self.station_m += step[stations].reshape(-1, 3)
            if np.max(np.abs(step)) < STEP_LIMIT_M:
                break
        residual, design = self._residual()
        white = (design / self.sd[..., None])[..., free]
        inverse = scale[:, None] * np.linalg.inv(scaled) * scale
        explained = np.einsum("nki,ij,nkj->nk", white, inverse, white)
        # One that took no part is predicted; its variance is the sum.
        self.redundancy = np.where(is_used, np.maximum(1.0 - explained, 0.0), 1.0 + explained)
        self.redundancy[~self.is_read] = np.nan
        self.residual = np.where(self.is_read, residual, np.nan)
        with np.errstate(invalid="ignore", divide="ignore"):
            self.w = np.where(
                self.redundancy > 1e-6, self.residual / self.sd / np.sqrt(self.redundancy), np.nan
            )
        self.redundancy = np.where(is_used, self.redundancy, np.nan)
        moved = ((self.station_m - self.start_station_m).ravel())[~fixed]
        self.statistic = float(
            np.sum((residual / self.sd)[is_used] ** 2) + np.sum(prior[stations][~fixed] * moved**2)
        )
        self._inverse = np.zeros((len(free), len(free)))
        self._inverse[np.ix_(free, free)] = inverse

    def _residual(self):
        computed, design = self._model()
        residual = self.observed - computed
        residual[:, 0] = np.mod(residual[:, 0] + np.pi, 2.0 * np.pi) - np.pi
        return residual, design

    def mark_cov(self):
        """Covariance of the marks, north, east, down."""
        width = 3 * len(self.marks)
        sign = np.tile([1.0, 1.0, -1.0], len(self.marks))
        return sign[:, None] * self._inverse[:width, :width] * sign
