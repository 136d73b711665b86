"""The satellites of a scenario: what they broadcast, and where they truly are.

Four kinds of sky:

- ``nominal``: the published nominal constellations (`truenorth.simulation.sky.almanac`);
- ``files``: the real constellation of RINEX navigation and SP3 files, moved by whole days where asked;
- ``oguz``: the 24 circular orbits of Oguz (2006), eq. 2.1 to 2.4;
- ``directions``: circular orbits through given azimuths and elevations at the start.

`Sky.navigation` is what the receivers decode. `Sky.true_states` is where the signals come from: smooth
orbits and clocks (those of the messages before they are rounded, or the precise ones, or what passes
smoothly from one real ephemeris to the next), plus errors in the orbit's own axes,

    d(t) = sd (a cos n t + b sin n t),    a, b ~ N(0, 1),    n = 2 pi / orbit period

along the radius, the track and the normal, and a constant clock error ~ N(0, sd).

References: P. Oguz, Implementation of Northfinding Techniques, METU, 2006, section 2.2; sizes of the
broadcast errors: O. Montenbruck, P. Steigenberger, A. Hauschild, "Multi-GNSS signal-in-space range error
assessment", Adv. Space Res. 61, 2018, 3020-3038.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import msgspec
import numpy as np

from ...constants import SPEED_OF_LIGHT_MPS, SYSTEMS
from ...errors import ConfigError
from ...navigation import Navigation, keep_satellites
from ...observations import sat_id, sat_name
from ..randomness import stream
from .almanac import EARTH_RATE_RADPS
from .tracks import azimuth_elevation

__all__ = [
    "DirectionsSky",
    "FileSky",
    "NominalSky",
    "OguzSky",
    "OrbitErrors",
    "Sky",
    "SkySection",
    "build_sky",
]


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
        except (ValueError, IndexError):
            known = False
        if not known:
            _refuse("leave_out", name, "satellites such as G05")


_KLOBUCHAR_2004 = (1.118e-08, -7.451e-09, -5.961e-08, 1.192e-07, 1.167e05, -2.294e05, -1.311e05, 1.049e06)


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
    klobuchar: tuple[float, ...] = _KLOBUCHAR_2004
    """Ionosphere coefficients alpha 0-3, beta 0-3; by default those that GPS broadcast on 2004-01-01."""
    errors: OrbitErrors = _TYPICAL
    """True minus broadcast; by default sizes of today's systems (Montenbruck and others, 2018)."""

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


class FileSky(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="files"
):
    """The real constellation of some day.

    Broadcast ephemerides are what the receivers decode; with an SP3 file its orbits and clocks are the
    truth (centres of mass: no satellite antenna offsets are applied). Without broadcast ephemerides they
    are fitted to the SP3 file.
    """

    files: tuple[str, ...]
    """RINEX navigation and SP3 files, relative to the scenario."""
    systems: str = "GRECJIS"
    """Letters of the systems to use of them."""
    time_shift: Literal["days", "none"] = "days"
    """``days``: where the scenario is on another day, move the files by whole days, with every satellite over
    the same place on the Earth at the same time of day; ``none``: take their times as they are."""
    smooth: bool = True
    """The true orbits pass smoothly from one broadcast ephemeris to the next, and do not jump with them."""
    leave_out: tuple[str, ...] = ()
    """Satellites that are not there."""
    n_satellites: int | None = None
    """Keep only so many: those highest at the start, for the whole run."""
    errors: OrbitErrors = OrbitErrors()
    """True minus broadcast (or precise)."""

    def __post_init__(self) -> None:
        if not self.files:
            _refuse("files", self.files, "at least one RINEX navigation or SP3 file")
        if not self.systems or set(self.systems) - set(SYSTEMS):
            _refuse("systems", self.systems, f"letters among {SYSTEMS}")
        _check_selection(self)


class OguzSky(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="oguz"
):
    """The 24 satellites of Oguz (2006): six planes of four, circular, 55 degrees.

    The thesis gives the arguments of latitude as "multiples of 45 degrees plus a phase difference". Four
    satellites evenly spaced in a plane are 90 degrees apart, so here the even planes hold the even
    multiples, the odd planes the odd ones, and each plane is ahead of the one before by the phase.
    """

    phasing: Literal["multiples_of_45", "published_slots"] = "multiples_of_45"
    """Arguments of latitude: his, or those of the 24 slots of the GPS standard."""
    plane_phase_deg: float = 15.0
    """Phase difference from plane to plane, for ``multiples_of_45``."""
    orbit_radius_m: float = 26_559_700.0
    greenwich_angle_deg: float | None = None
    """Angle from the vernal equinox to Greenwich at the start (eq. 2.3); by default the real one."""
    clock_bias_m: float = 2.0
    """Error of all satellite clocks, as a delay in metres (the thesis: bias 2.0 m)."""
    leave_out: tuple[str, ...] = ()
    """Satellites that are not there."""
    n_satellites: int | None = None
    """Keep only so many: those highest at the start, for the whole run (the thesis: 3 and 4)."""
    klobuchar: tuple[float, ...] = _KLOBUCHAR_2004
    """Ionosphere coefficients alpha 0-3, beta 0-3; the thesis gives none."""
    errors: OrbitErrors = OrbitErrors()
    """True minus broadcast."""

    def __post_init__(self) -> None:
        if not 2.0e7 <= self.orbit_radius_m <= 4.5e7:
            _refuse("orbit_radius_m", self.orbit_radius_m, "20000 to 45000 km in metres")
        if len(self.klobuchar) != 8:
            _refuse("klobuchar", self.klobuchar, "eight coefficients, alpha 0-3 and beta 0-3")
        _check_selection(self)


class DirectionsSky(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="directions"
):
    """GPS satellites on circular orbits, seen in given directions at the start."""

    azimuth_elevation_deg: tuple[tuple[float, float], ...]
    """Azimuth and elevation of each satellite at the start, from where the platform is."""
    names: tuple[str, ...] = ()
    """Their names; by default G01, G02..."""
    orbit_radius_m: float = 26_559_800.0
    inclination_deg: float = 55.0
    """Raised where the satellite stands further north or south than that."""
    leave_out: tuple[str, ...] = ()
    n_satellites: int | None = None
    klobuchar: tuple[float, ...] = _KLOBUCHAR_2004
    errors: OrbitErrors = OrbitErrors()
    """True minus broadcast."""

    def __post_init__(self) -> None:
        directions = self.azimuth_elevation_deg
        if not 1 <= len(directions) <= 32:
            _refuse("azimuth_elevation_deg", len(directions), "1 to 32 pairs")
        for azimuth, elevation in directions:
            if not (-360.0 <= azimuth <= 360.0 and -90.0 <= elevation <= 90.0):
                _refuse("azimuth_elevation_deg", (azimuth, elevation), "pairs of azimuth and elevation")
        if self.names and len(set(self.names)) != len(directions):
            _refuse("names", self.names, "as many different names as directions")
        for name in self.names:
            if name[:1] != "G" or not name[1:].isdigit() or not 1 <= int(name[1:]) <= 32:
                _refuse("names", name, "GPS satellites, G01 to G32")
        if not 2.0e7 <= self.orbit_radius_m <= 4.5e7:
            _refuse("orbit_radius_m", self.orbit_radius_m, "20000 to 45000 km in metres")
        if not 0.0 < self.inclination_deg <= 90.0:
            _refuse("inclination_deg", self.inclination_deg, "an angle above 0 and up to 90")
        _check_selection(self)


SkySection = NominalSky | FileSky | OguzSky | DirectionsSky


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
    _truth: Any = field(repr=False)
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
        sat = np.array(sat, dtype=np.int64, order="C", ndmin=1)
        time_ns = np.array(np.broadcast_to(np.asarray(time_ns, dtype=np.int64), sat.shape))
        delay_s = np.array(np.broadcast_to(np.asarray(delay_s, dtype=np.float64), sat.shape))
        position, velocity, clock, drift, status = self._truth.states(sat, time_ns, delay_s)
        position, velocity, clock = self._errors.apply(sat, time_ns, delay_s, position, velocity, clock)
        return position, velocity, clock, drift, status


@dataclass(frozen=True, slots=True, eq=False)
class _ErrorModel:
    """True minus broadcast: harmonics of the orbit period, by satellite code."""

    start_ns: int
    amplitude_m: np.ndarray
    """Shape (700, 3, 2): radial, along, cross; cosine and sine."""
    clock_s: np.ndarray
    is_zero: bool

    @classmethod
    def draw(cls, errors, satellites, start_ns, seed, *, clock_bias_m=0.0):
        amplitude, clock = np.zeros((100 * len(SYSTEMS), 3, 2)), np.zeros(100 * len(SYSTEMS))
        sd_m = np.array([errors.radial_sd_m, errors.along_sd_m, errors.cross_sd_m])
        for sat in satellites:
            rng = stream(seed, "sky", "errors", sat_name(int(sat)))
            amplitude[sat] = sd_m[:, None] * rng.standard_normal((3, 2))
            # A late clock is a delay: the pseudorange grows as the clock falls behind.
            clock[sat] = (errors.clock_sd_m * rng.standard_normal() - clock_bias_m) / SPEED_OF_LIGHT_MPS
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
    section : NominalSky, FileSky, OguzSky or DirectionsSky
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
    span = {"start_ns": int(start_ns), "duration_s": float(duration_s)}
    clock_bias_m = 0.0
    if isinstance(section, FileSky):
        from .real_constellation import real_constellation

        navigation, truth, source = real_constellation(section, **span, folder=folder)
    elif isinstance(section, NominalSky):
        from .broadcast import nominal_navigation

        navigation, truth = nominal_navigation(section, **span, seed=seed)
        source = "nominal constellations: GPS SPS PS 2020, GLONASS ICD 5.1, Galileo OS SDD 1.1, BDS-OS-PS-3.0"
    elif isinstance(section, OguzSky):
        from .circular import oguz_navigation

        navigation, truth = oguz_navigation(section, **span)
        source = "24 circular orbits, Oguz 2006, equations 2.1 to 2.4"
        clock_bias_m = section.clock_bias_m
    else:
        from .circular import directions_navigation

        _need_position("azimuth_elevation_deg", section.azimuth_elevation_deg, position_ecef_m)
        navigation, truth = directions_navigation(section, **span, position_ecef_m=position_ecef_m)
        source = "circular orbits through given directions at the start"
    known = np.unique(np.concatenate([navigation.kepler.sat, navigation.states.sat]))
    kept = known[~np.isin(known, [sat_id(name) for name in section.leave_out])]
    if section.n_satellites is not None:
        _need_position("n_satellites", section.n_satellites, position_ecef_m)
        position, *_ = truth.states(
            kept.astype(np.int64), np.full(len(kept), span["start_ns"]), np.zeros(len(kept))
        )
        _, elevation = azimuth_elevation(position, position_ecef_m)
        order = np.argsort(-np.where(np.isfinite(elevation), elevation, -np.pi), kind="stable")
        kept = np.sort(kept[order[: section.n_satellites]])
    if len(kept) == 0:
        _refuse("leave_out", section.leave_out, "fewer, for no satellite is left")
    errors = _ErrorModel.draw(section.errors, kept, span["start_ns"], seed, clock_bias_m=clock_bias_m)
    return Sky(keep_satellites(navigation, kept), kept.astype(np.int16), source, truth, errors)


def _need_position(key, value, position_ecef_m):
    if position_ecef_m is None:
        raise ConfigError(
            f"`{key}` needs the place of the platform: give `position_ecef_m`", key=key, value=value
        )
