"""What a plan needs to know: the array, the place, the day, the sky and the noise; strict like a session."""

from __future__ import annotations

import os
from typing import Any, Literal, NoReturn

import msgspec
import numpy as np

from ..config import Session, StochasticSettings, convert_settings
from ..constants import BAND_CLASSES, SYSTEMS
from ..errors import ConfigError
from ..simulation.scenario import Scenario
from ..simulation.sky import FileSky, NominalSky, SkySection
from ..simulation.visibility import VisibilitySection
from ..timescales import parse_gpst

__all__ = ["PlanSettings", "plan_settings", "white_noise"]

LARGEST_PLAN = 20_000
"""Epochs; a week every half minute."""


class PlanSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An array at a place over some hours."""

    antennas: tuple[tuple[float, float, float], ...]
    """Body coordinates: forward, right, down, metres."""
    names: tuple[str, ...] = ()
    """Of the antennas; by default A1, A2..."""
    latitude_deg: float
    longitude_deg: float
    height_m: float = 0.0
    """Above the ellipsoid."""
    start: str
    """GPS time of the first epoch, such as 2024-06-24 or 2024-06-24T08:00:00."""
    hours: float = 24.0
    step_s: float = 300.0
    heading_deg: float = 0.0
    """How the platform stands: the accuracy of an angle depends on where the array points."""
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    elevation_mask_deg: float = 15.0
    systems: str = "GRECJ"
    """Letters of the satellite systems to use."""
    bands: tuple[str, ...] = ("L1", "L2")
    """Band names, see `truenorth.constants.BAND_CLASSES`."""
    glonass_ambiguities: Literal["float", "calibrated"] = "float"
    """``float``: phases of GLONASS (FDMA) bring nothing in a single epoch; its codes help to resolve."""
    position_sd_m: float = 0.0
    """Of each body coordinate; 0 takes them as exact."""
    sky: SkySection = NominalSky(systems="GRECJ")
    """Satellites: nominal constellations, or files of a real one."""
    visibility: VisibilitySection = VisibilitySection()
    """Skyline, masks of the platform, obstructions and outages, as of a scenario."""
    along_m: float | None = None
    """Where on the route of a scenario the platform stands, for obstructions given by distance; without
    it these are left out."""
    zenith_cn0_dbhz: float = 50.0
    """C/N0 that is expected; the noise depends on it."""
    horizon_cn0_dbhz: float = 36.0
    lose_dbhz: float = 28.0
    """What is left below this behind an obstruction is not tracked."""
    stochastic: StochasticSettings = StochasticSettings()
    """Noise of undifferenced observations; `estimate`, `correlation_s` and `memory_epochs` have no part."""
    seed: int = 1

    def __post_init__(self) -> None:
        def refuse(key: str, wanted: str) -> NoReturn:
            value = getattr(self, key)
            raise ConfigError(f"`{key}` is {value!r}; give {wanted}", key=key, value=value)

        n = len(self.antennas)
        if not 2 <= n <= 30:
            raise ConfigError(
                f"`antennas` holds {n}; give the body coordinates of 2 to 30", key="antennas", value=n
            )
        if not np.all(np.isfinite(self.antennas)) or np.max(np.abs(self.antennas)) > 10_000.0:
            refuse("antennas", "coordinates in metres, up to 10 km")
        if self.names and len(self.names) != n:
            refuse("names", f"{n} names, one for each antenna, or none")
        for k in range(1, n):
            for j in range(k):
                apart_m = float(np.linalg.norm(np.subtract(self.antennas[k], self.antennas[j])))
                if apart_m < 0.01:
                    raise ConfigError(
                        f"`antennas`: numbers {j + 1} and {k + 1} stand {apart_m:g} m apart; give each "
                        "its own place",
                        key="antennas",
                        value=apart_m,
                    )
        if not -90.0 <= self.latitude_deg <= 90.0:
            refuse("latitude_deg", "-90 to 90")
        if not -180.0 <= self.longitude_deg <= 360.0:
            refuse("longitude_deg", "-180 to 360")
        if not -10_000.0 <= self.height_m <= 100_000.0:
            refuse("height_m", "metres from -10000 to 100000")
        try:
            start_ns = parse_gpst(self.start)
        except ValueError:
            refuse("start", "a date such as 2024-06-24 or a time such as 2024-06-24T08:00:00")
        if start_ns < 0 or start_ns > parse_gpst("2100-01-01"):
            refuse("start", "a date from 1980-01-06 to 2100")
        if not 0.0 <= self.hours <= 168.0:
            refuse("hours", "0 to 168, which is a week")
        if not 0.001 <= self.step_s <= 86_400.0:
            refuse("step_s", "0.001 to 86400 seconds")
        if self.n_epochs > LARGEST_PLAN:
            raise ConfigError(
                f"`step_s` is {self.step_s!r}: these are {self.n_epochs} epochs; give a longer step, for "
                f"{LARGEST_PLAN} at most",
                key="step_s",
                value=self.step_s,
            )
        if not -90.0 < self.pitch_deg < 90.0:
            refuse("pitch_deg", "an angle between -90 and 90, where heading and roll exist")
        for key in ("heading_deg", "roll_deg"):
            if not abs(getattr(self, key)) <= 360.0:
                refuse(key, "degrees up to 360")
        if not -90.0 <= self.elevation_mask_deg < 90.0:
            refuse("elevation_mask_deg", "an angle from -90 to below 90")
        if not self.systems or set(self.systems) - set(SYSTEMS):
            refuse("systems", f"letters among {SYSTEMS}")
        if not self.bands or set(self.bands) - set(BAND_CLASSES):
            refuse("bands", "names among " + ", ".join(BAND_CLASSES))
        if not 0.0 <= self.position_sd_m <= 1.0:
            refuse("position_sd_m", "0 to 1 metre")
        if self.horizon_cn0_dbhz > self.zenith_cn0_dbhz:
            refuse("horizon_cn0_dbhz", "no more than `zenith_cn0_dbhz`")

    @property
    def n_epochs(self) -> int:
        """int: Number of epochs, both ends included."""
        return int(np.floor(self.hours * 3600.0 / self.step_s + 1e-9)) + 1

    @property
    def start_ns(self) -> int:
        """int: GPS time of the first epoch, nanoseconds."""
        return parse_gpst(self.start)

    @property
    def time_ns(self) -> np.ndarray:
        """Ndarray of int64, shape (n_epochs,): GPS time of the epochs."""
        return self.start_ns + np.rint(np.arange(self.n_epochs) * (self.step_s * 1e9)).astype(np.int64)

    @property
    def antenna_names(self) -> tuple[str, ...]:
        """Tuple of str: names, given or A1, A2..."""
        return self.names or tuple(f"A{k + 1}" for k in range(len(self.antennas)))


def white_noise(phase_sd_m: float, code_sd_m: float) -> StochasticSettings:
    """Noise that is the same for every signal, as published studies assume it.

    Parameters
    ----------
    phase_sd_m, code_sd_m : float
        Of undifferenced observations, metres.

    Returns
    -------
    StochasticSettings
    """
    return StochasticSettings(
        phase_sd_m=phase_sd_m,
        phase_elevation_sd_m=0.0,
        code_sd_m=code_sd_m,
        code_elevation_sd_m=0.0,
        cn0_slope=0.0,
    )


def plan_settings(
    source: Session | Scenario | str | os.PathLike[str] | None = None, **changes: Any
) -> PlanSettings:
    """Settings of a plan from a session or a scenario, and what is given beside it.

    Parameters
    ----------
    source : Session, Scenario, path-like or str, optional
        A session (antennas and their uncertainty, systems, bands, mask and noise) or a scenario by name or
        file (antennas, place, day, sky, what stands in the way, and what it tells the solver).
    **changes
        Fields of `PlanSettings`, which replace those of the source; None counts as not given.
        ``navigation`` (paths) stands for a sky of files.

    Returns
    -------
    PlanSettings

    Raises
    ------
    ConfigError
        For what is missing or impossible, by name.
    FormatError
        If a file cannot be read.
    """
    table = _described(source)
    given = {key: value for key, value in changes.items() if value is not None}
    navigation = given.pop("navigation", ())
    systems = given.get("systems", table.get("systems", "GRECJ"))
    if navigation:
        table["sky"] = FileSky(files=tuple(os.path.abspath(name) for name in navigation))
    elif "sky" not in table:
        nominal = "".join(letter for letter in systems if letter in "GRECJI")
        table["sky"] = NominalSky(systems=nominal or "G")
    if "antennas" in given and "names" not in given:
        table.pop("names", None)
    table.update(given)
    if "antennas" not in table:
        raise ConfigError("no array is given; name a session or a scenario, or give antennas", key="antennas")
    return convert_settings(msgspec.to_builtins(table), PlanSettings)


def _described(source: Any) -> dict[str, Any]:
    """Fields of `PlanSettings` that a session or a scenario says."""
    if source is None:
        return {}
    if isinstance(source, str | os.PathLike):
        source = _read_source(os.fspath(source))
    if isinstance(source, Scenario):
        receiver = source.receiver
        table: dict[str, Any] = {
            "antennas": [antenna.position_body_m for antenna in source.platform.antennas],
            "names": [antenna.name for antenna in source.platform.antennas],
            "latitude_deg": source.place.latitude_deg,
            "longitude_deg": source.place.longitude_deg,
            "height_m": source.place.height_m,
            "start": source.start,
            "sky": _with_full_paths(source),
            "visibility": source.visibility,
            "seed": source.seed,
            "zenith_cn0_dbhz": receiver.zenith_cn0_dbhz,
            "horizon_cn0_dbhz": receiver.horizon_cn0_dbhz,
            "lose_dbhz": receiver.tracking.lose_dbhz,
        }
        gnss = source.solve
    else:
        gnss = source.settings
        antennas = source.platform.antennas
        positions = [antenna.position_body_m for antenna in antennas]
        if any(position is None for position in positions):
            if gnss.length_m is None:
                raise ConfigError(
                    "the session gives neither body coordinates nor a length; give antennas", key="antennas"
                )
            positions = [(0.0, 0.0, 0.0), (gnss.length_m, 0.0, 0.0)]
        table = {"antennas": positions, "names": [antenna.name for antenna in antennas]}
        if source.is_array:
            table["position_sd_m"] = source.array.position_sd_m
        if source.gnss.navigation:
            table["sky"] = FileSky(files=tuple(os.path.abspath(name) for name in source.gnss.navigation))
    for key in ("systems", "bands", "elevation_mask_deg", "glonass_ambiguities", "stochastic"):
        table[key] = getattr(gnss, key)
    return table


def _read_source(name: str) -> Session | Scenario:
    """A session file, or a scenario by name or file: a scenario says where it takes place."""
    from ..simulation import read_scenario

    if not name.endswith(".toml"):
        return read_scenario(name)
    import tomllib

    try:
        with open(name, "rb") as file:
            table = tomllib.load(file)
    except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError):
        return Session.read(name)  # which says what is wrong with it
    return read_scenario(name) if "place" in table or "extends" in table else Session.read(name)


def _with_full_paths(scenario: Scenario) -> SkySection:
    sky = scenario.sky
    if not isinstance(sky, FileSky):
        return sky
    files = tuple(os.path.abspath(os.path.join(scenario.folder, name)) for name in sky.files)
    return msgspec.structs.replace(sky, files=files)
