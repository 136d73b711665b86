"""The satellites of a scenario: what they broadcast, and where they truly are.

Four kinds of sky:

- ``nominal``: the published nominal constellations (`truenorth.simulation.almanac`);
- ``files``: the real constellation of RINEX navigation and SP3 files, moved in time where asked;
- ``oguz``: the 24 circular orbits of Oguz (2006), eq. 2.1 to 2.4;
- ``directions``: circular orbits through given azimuths and elevations at the start.

`Sky.navigation` is what the receivers decode. `Sky.true_states` is where the signals come from: the
broadcast orbit and clock plus errors that are fixed in the orbit's own axes,

    d(t) = sd (a cos n t + b sin n t),    a, b ~ N(0, 1),    n = 2 pi / orbit period

along the radius, the track and the normal, and a constant clock error ~ N(0, sd).

References: P. Oguz, Implementation of Northfinding Techniques, METU, 2006, section 2.2; sizes of the
broadcast errors: O. Montenbruck, P. Steigenberger, A. Hauschild, "Multi-GNSS signal-in-space range error
assessment", Adv. Space Res. 61, 2018, 3020-3038.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import msgspec
import numpy as np

from ..constants import SPEED_OF_LIGHT_MPS, SYSTEMS
from ..errors import ConfigError
from ..frames import azimuth_elevation_from_enu, geodetic_from_ecef, rot_enu_from_ecef
from ..navigation import Navigation
from ..observations import sat_id, sat_name
from .almanac import EARTH_RATE_RADPS
from .randomness import stream

__all__ = ["NominalSky", "OrbitErrors", "Sky", "SkySection", "build_sky"]


def _refuse(key, value, wanted):
    raise ConfigError(f"`{key}` is {value!r}; give {wanted}", key=key, value=value)


class OrbitErrors(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How far true orbits and clocks are from the broadcast ones, standard deviations in metres."""

    radial_sd_m: float = 0.0
    """Along the radius."""
    along_sd_m: float = 0.0
    """Along the track."""
    cross_sd_m: float = 0.0
    """Normal to the plane."""
    clock_sd_m: float = 0.0
    """Satellite clock times the speed of light; constant over the scenario."""

    def __post_init__(self) -> None:
        for key in ("radial_sd_m", "along_sd_m", "cross_sd_m", "clock_sd_m"):
            if not 0.0 <= getattr(self, key) <= 1e5:
                _refuse(key, getattr(self, key), "0 to 100000 metres")


_TYPICAL = OrbitErrors(radial_sd_m=0.2, along_sd_m=0.8, cross_sd_m=0.5, clock_sd_m=0.4)


def _check_selection(section):
    if section.n_satellites is not None and not 1 <= section.n_satellites <= 200:
        _refuse("n_satellites", section.n_satellites, "1 to 200, or leave it out")
    for name in section.leave_out:
        try:
            known = sat_name(sat_id(name)) == name
        except ValueError:
            known = False
        if not known:
            _refuse("leave_out", name, "satellites such as G05")


class NominalSky(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="nominal"
):
    """The published nominal constellations."""

    systems: str = "GREC"
    """Letters of the systems: GPS, GLONASS, Galileo, BeiDou, QZSS (J), NavIC (I)."""
    gps_slots: int = 30
    """24 for the baseline constellation; up to 30 with its expandable slots held twice."""
    gps_eccentricity: float = 0.01
    """GPS eccentricities are drawn between 0 and this (the standard allows 0.02); other systems are circular,
    but for the quasi-zenith orbits."""
    leave_out: tuple[str, ...] = ()
    """Satellites that are not there."""
    n_satellites: int | None = None
    """Keep only so many: those highest at the start, for the whole run."""
    klobuchar: tuple[float, ...] = (
        1.118e-08,
        -7.451e-09,
        -5.961e-08,
        1.192e-07,
        1.167e05,
        -2.294e05,
        -1.311e05,
        1.049e06,
    )
    """Ionosphere coefficients alpha 0-3, beta 0-3; by default those that GPS broadcast on 2004-01-01."""
    errors: OrbitErrors = _TYPICAL

    def __post_init__(self) -> None:
        if not self.systems or set(self.systems) - set("GRECJI"):
            _refuse("systems", self.systems, "letters among GRECJI")
        if not 24 <= self.gps_slots <= 30:
            _refuse("gps_slots", self.gps_slots, "24 to 30")
        if not 0.0 <= self.gps_eccentricity <= 0.05:
            _refuse("gps_eccentricity", self.gps_eccentricity, "0 to 0.05")
        if len(self.klobuchar) != 8:
            _refuse("klobuchar", self.klobuchar, "eight coefficients, alpha 0-3 and beta 0-3")
        _check_selection(self)


SkySection = NominalSky


@dataclass(frozen=True, slots=True, eq=False)
class Sky:
    """Satellites of a scenario.

    Parameters
    ----------
    navigation : Navigation
        What the receivers decode and what is written as a navigation file.
    satellites : ndarray of int16, shape (n,)
        All satellites, increasing.
    source : str
        Where the orbits come from, one sentence.
    """

    navigation: Navigation
    satellites: np.ndarray
    source: str
    _errors: _ErrorModel = field(repr=False)

    def true_states(self, sat, time_ns, delay_s=0.0):
        """Compute where satellites truly are.

        Parameters
        ----------
        sat : ndarray of int, shape (n,)
            Satellites.
        time_ns : int or ndarray of int64, shape (n,)
            GPS time, nanoseconds.
        delay_s : float or ndarray, shape (n,)
            Taken off the time, seconds.

        Returns
        -------
        position_ecef_m, velocity_ecef_mps : ndarray, shape (n, 3)
            In the Earth-fixed frame of the instant ``time - delay``.
        clock_s, clock_drift_sps : ndarray, shape (n,)
            Satellite clock minus system time, relativity included, group delays not.
        status : ndarray of uint8, shape (n,)
            `truenorth.orbits.OrbitStatus`; NaN where it is not 0.
        """
        from ..orbits import compute_satellite_states

        sat = np.array(sat, dtype=np.int64, order="C", ndmin=1)
        time_ns = np.array(np.broadcast_to(np.asarray(time_ns, dtype=np.int64), sat.shape))
        delay_s = np.array(np.broadcast_to(np.asarray(delay_s, dtype=np.float64), sat.shape))
        states = compute_satellite_states(self.navigation, sat, time_ns, delay_s=delay_s)
        position, velocity, clock = self._errors.apply(
            sat, time_ns, delay_s, states.position_ecef_m, states.velocity_ecef_mps, states.clock_s
        )
        return position, velocity, clock, states.clock_drift_sps, states.status


@dataclass(frozen=True, slots=True, eq=False)
class _ErrorModel:
    """True minus broadcast: harmonics of the orbit period, by satellite code."""

    start_ns: int
    amplitude_m: np.ndarray
    """Shape (700, 3, 2): radial, along, cross; cosine and sine."""
    clock_s: np.ndarray
    is_zero: bool

    @classmethod
    def draw(cls, errors, satellites, start_ns, seed):
        amplitude, clock = np.zeros((100 * len(SYSTEMS), 3, 2)), np.zeros(100 * len(SYSTEMS))
        sd_m = np.array([errors.radial_sd_m, errors.along_sd_m, errors.cross_sd_m])
        for sat in satellites:
            rng = stream(seed, "sky", "errors", sat_name(int(sat)))
            amplitude[sat] = sd_m[:, None] * rng.standard_normal((3, 2))
            clock[sat] = errors.clock_sd_m / SPEED_OF_LIGHT_MPS * rng.standard_normal()
        return cls(start_ns, amplitude, clock, not (np.any(amplitude) or np.any(clock)))

    def apply(self, sat, time_ns, delay_s, position, velocity, clock):
        if self.is_zero:
            return position, velocity, clock
        # In axes that do not turn: the orbit's radius, track and normal.
        turn = np.zeros_like(velocity)
        turn[:, 0] = -EARTH_RATE_RADPS * position[:, 1]
        turn[:, 1] = EARTH_RATE_RADPS * position[:, 0]
        inertial = velocity + turn
        distance = np.sqrt(np.einsum("ij,ij->i", position, position))
        radial = position / distance[:, None]
        normal = np.cross(position, inertial)
        momentum = np.sqrt(np.einsum("ij,ij->i", normal, normal))
        normal /= momentum[:, None]
        along = np.cross(normal, radial)
        rate = momentum / distance**2
        angle = rate * ((time_ns - self.start_ns) * 1e-9 - delay_s)
        c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
        amplitude = self.amplitude_m[sat]
        size = amplitude[:, :, 0] * c + amplitude[:, :, 1] * s
        size_rate = rate[:, None] * (amplitude[:, :, 1] * c - amplitude[:, :, 0] * s)
        # The axes turn about the normal: radial' = rate * along, along' = -rate * radial.
        radial_rate = size_rate[:, 0] - rate * size[:, 1]
        along_rate = size_rate[:, 1] + rate * size[:, 0]
        shift = size[:, :1] * radial + size[:, 1:2] * along + size[:, 2:] * normal
        shift_rate = radial_rate[:, None] * radial + along_rate[:, None] * along + size_rate[:, 2:] * normal
        shift_rate[:, 0] += EARTH_RATE_RADPS * shift[:, 1]
        shift_rate[:, 1] -= EARTH_RATE_RADPS * shift[:, 0]
        return position + shift, velocity + shift_rate, clock + self.clock_s[sat]


def build_sky(section, *, start_ns, duration_s, seed, folder="", position_ecef_m=None):
    """Make the satellites of a scenario.

    Parameters
    ----------
    section : NominalSky
        The ``[sky]`` table.
    start_ns : int
        GPS time of the scenario's start, nanoseconds.
    duration_s : float
        Its length, seconds.
    seed : int
        Seed of the scenario.
    folder : str or path-like
        What relative file names start from.
    position_ecef_m : ndarray, shape (3,), optional
        Where the platform is at the start: needed for ``n_satellites`` and for a sky given by directions.

    Returns
    -------
    Sky

    Raises
    ------
    ConfigError
        If the section contradicts itself or the times.
    FormatError
        If a file cannot be read.
    """
    from .broadcast import nominal_navigation

    navigation = nominal_navigation(section, start_ns=start_ns, duration_s=duration_s, seed=seed)
    source = "nominal constellations"
    return _finish(section, navigation, source, start_ns, seed, position_ecef_m)


def _finish(section, navigation, source, start_ns, seed, position_ecef_m):
    """Leave satellites out, keep the highest, draw the errors."""
    known = np.unique(np.concatenate([navigation.kepler.sat, navigation.states.sat]))
    kept = known[~np.isin(known, [sat_id(name) for name in section.leave_out])]
    if section.n_satellites is not None:
        kept = _highest(navigation, kept, section.n_satellites, start_ns, position_ecef_m)
    navigation = keep_satellites(navigation, kept)
    errors = _ErrorModel.draw(section.errors, kept, start_ns, seed)
    return Sky(navigation, kept.astype(np.int16), source, errors)


def _highest(navigation, sats, count, start_ns, position_ecef_m):
    from ..orbits import compute_satellite_states

    if position_ecef_m is None:
        _refuse("n_satellites", count, "`position_ecef_m` to `build_sky` with it")
    states = compute_satellite_states(navigation, sats, start_ns)
    _, elevation = azimuth_elevation(states.position_ecef_m, position_ecef_m)
    order = np.argsort(-np.where(np.isfinite(elevation), elevation, -np.pi), kind="stable")
    return np.sort(sats[order[:count]])


def azimuth_elevation(satellite_ecef_m, position_ecef_m):
    """Azimuth and elevation of satellites from a place, radians, without light time.

    Parameters
    ----------
    satellite_ecef_m : ndarray, shape (..., 3)
        Satellites.
    position_ecef_m : ndarray, shape (3,)
        The place.

    Returns
    -------
    azimuth_rad, elevation_rad : ndarray, shape (...)
    """
    position_ecef_m = np.asarray(position_ecef_m, dtype=float)
    lat, lon, _ = geodetic_from_ecef(position_ecef_m)
    return azimuth_elevation_from_enu((satellite_ecef_m - position_ecef_m) @ rot_enu_from_ecef(lat, lon).T)


def keep_satellites(navigation, sats):
    """Navigation data of some satellites only.

    Parameters
    ----------
    navigation : Navigation
        All of it.
    sats : ndarray of int
        Those to keep.

    Returns
    -------
    Navigation
    """
    from dataclasses import fields, replace

    def rows(table):
        keep = np.isin(table.sat, sats)
        return replace(table, **{entry.name: getattr(table, entry.name)[keep] for entry in fields(table)})

    return replace(navigation, kepler=rows(navigation.kepler), states=rows(navigation.states))
