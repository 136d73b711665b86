"""What an array will achieve at a place over a day: accuracy, success, dilutions, reliability."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..ambiguity.array_model import ArrayEpoch
from ..config import Session
from ..constants import SYSTEMS
from ..frames import azimuth_elevation_from_enu
from ..positioning.dops import baseline_dops
from ..rotations import rot_ned_from_body
from ..simulation.scenario import Scenario
from ..timescales import format_gpst, gpst_to_datetime64
from .precision import array_precision, vector_information
from .reliability import DayReliability, day_reliability
from .resolution import baseline_success
from .settings import PlanSettings, plan_settings
from .view import SkyView, sky_view

__all__ = ["ANGLES", "Plan", "plan_array"]

ANGLES = ("heading", "pitch", "roll")


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Expected performance, single epoch with integers fixed, n epochs.

    Parameters
    ----------
    settings : PlanSettings
        What was asked.
    view : SkyView
        Signals in view.
    n_satellites : ndarray of int, shape (n,)
        In view.
    cov_rad2 : ndarray, shape (n, 3, 3)
        Of heading, pitch and roll; NaN for what cannot be observed.
    information : ndarray, shape (n, 3, 3)
        About the place of one antenna among the others, one over square metres, north, east, down.
    success : ndarray, shape (n,)
        Lower bound of the success rate of the integers of one baseline by itself.
    adop_cyc : ndarray, shape (n,)
        Ambiguity dilution of precision of one baseline.
    n_integers : ndarray of int, shape (n,)
        Double differences of one baseline.
    pdop, azimuth_dop, elevation_dop : ndarray, shape (n,)
        Dilutions of the longest baseline for undifferenced noise of 1 (Wang & Lachapelle 2002).
    reliability : DayReliability
        Minimal detectable blunders of the phases and their effect.
    """

    settings: PlanSettings
    view: SkyView
    n_satellites: np.ndarray
    cov_rad2: np.ndarray
    information: np.ndarray
    success: np.ndarray
    adop_cyc: np.ndarray
    n_integers: np.ndarray
    pdop: np.ndarray
    azimuth_dop: np.ndarray
    elevation_dop: np.ndarray
    reliability: DayReliability

    @property
    def time_ns(self) -> np.ndarray:
        """Ndarray of int64, shape (n,): GPS time."""
        return self.view.time_ns

    @property
    def n_epochs(self) -> int:
        """int: Number of epochs."""
        return self.view.n_epochs

    @property
    def sd_rad(self) -> np.ndarray:
        """Ndarray, shape (n, 3): standard deviations of heading, pitch and roll."""
        with np.errstate(invalid="ignore"):
            return np.sqrt(np.einsum("nii->ni", self.cov_rad2))

    @property
    def angles_rad(self) -> tuple[float, float, float]:
        """Tuple of float: heading, pitch and roll at which the platform stands."""
        return _angles_rad(self.settings)

    @property
    def longest_baseline(self) -> tuple[int, int]:
        """Tuple of int: the two antennas furthest apart."""
        return _longest(np.array(self.settings.antennas))

    def array_epoch(self, epoch: int) -> ArrayEpoch:
        """Rows of all antennas at an epoch without noise or integers, e.g. for `phase_reliability`.

        Parameters
        ----------
        epoch : int
            Which epoch.

        Returns
        -------
        ArrayEpoch
            Sorted by group, satellite and antenna; rows whose phase counts.
        """
        view, k = self.view, len(self.settings.antennas)
        rows = view.rows(epoch)
        use = np.flatnonzero(view.has_integers[rows]) + rows.start
        use = use[np.lexsort((view.satellite[use], view.group[use]))]
        positions_m = np.array(self.settings.antennas, dtype=float)
        antenna = np.tile(np.arange(k), len(use))
        row = np.repeat(use, k)
        ned_m = positions_m @ rot_ned_from_body(*self.angles_rad).T
        range_m = -np.einsum("ri,ri->r", view.line_of_sight_ned[row], ned_m[antenna])
        return ArrayEpoch(
            antenna=antenna,
            satellite=np.repeat(np.arange(len(use)), k),
            group=np.unique(view.group[row], return_inverse=True)[1].astype(np.int64),
            phase_m=range_m,
            code_m=range_m.copy(),
            design_ned=-view.line_of_sight_ned[row],
            wavelength_m=view.wavelength_m[row],
            phase_variance_m2=view.phase_variance_m2[row],
            code_variance_m2=view.code_variance_m2[row],
            positions_body_m=positions_m,
            position_sd_m=self.settings.position_sd_m,
        )

    def columns(self) -> dict[str, np.ndarray]:
        """Table of the plan, one row an epoch: name of the column and its values."""
        sd_deg = np.degrees(self.sd_rad)
        reliability = self.reliability
        return {
            "time_gpst": gpst_to_datetime64(self.time_ns),
            "n_satellites": self.n_satellites,
            "n_integers": self.n_integers,
            **{f"{name}_sd_deg": sd_deg[:, k] for k, name in enumerate(ANGLES)},
            "baseline_success": self.success,
            "adop_cyc": self.adop_cyc,
            "pdop": self.pdop,
            "azimuth_dop": self.azimuth_dop,
            "elevation_dop": self.elevation_dop,
            "mdb_m": reliability.mdb_m,
            "mdb_cyc": reliability.mdb_cyc,
            **{
                f"{name}_external_deg": np.degrees(reliability.external_rad[:, k])
                for k, name in enumerate(ANGLES)
            },
        }

    def to_dict(self) -> dict[str, Any]:
        """Compute the day in a few numbers, in values that JSON can hold; angles in degrees."""
        found = {
            "first_gpst": format_gpst(self.time_ns[0]),
            "last_gpst": format_gpst(self.time_ns[-1]),
            "epochs": self.n_epochs,
            "antennas": list(self.settings.antenna_names),
            "groups": list(self.view.groups),
        }
        for name, values in self.columns().items():
            if name == "time_gpst":
                continue
            known = np.asarray(values, dtype=float)
            known = known[np.isfinite(known)]
            found[name] = (
                {
                    "min": float(known.min()),
                    "median": float(np.median(known)),
                    "p95": float(np.quantile(known, 0.95)),
                    "max": float(known.max()),
                    "known": len(known),
                }
                if len(known)
                else None
            )
        return found

    def __str__(self) -> str:
        """The day in a table: least, median, 95 % and largest of each quantity."""
        s = self.settings
        names = s.antenna_names
        first, second = self.longest_baseline
        length_m = float(np.linalg.norm(np.subtract(s.antennas[second], s.antennas[first])))
        lines = [
            f"array       {len(names)} antennas ({', '.join(names)}), up to {length_m:.3f} m apart",
            f"place       {s.latitude_deg:.4f}, {s.longitude_deg:.4f}, {s.height_m:g} m; heading "
            f"{s.heading_deg:g}, pitch {s.pitch_deg:g}, roll {s.roll_deg:g} deg",
            f"time        {format_gpst(self.time_ns[0], decimals=0)} to "
            f"{format_gpst(self.time_ns[-1], decimals=0)} GPST, {self.n_epochs} epochs",
            f"signals     {', '.join(self.view.groups)}; above {s.elevation_mask_deg:g} deg",
            "accuracy    of a single epoch with its integers fixed, no multipath but that in the noise",
        ]
        unobservable = [name for k, name in enumerate(ANGLES) if np.all(np.isnan(self.cov_rad2[:, k, k]))]
        if unobservable:
            lines.append(f"unknown     {' and '.join(unobservable)}: these antennas do not observe it")
        lines.append(f"{'':<34} {'best':>9} {'median':>9} {'95 %':>9} {'worst':>9}")
        for name, unit, values, scale, small_is_good in self._rows():
            known = np.asarray(values, dtype=float) * scale
            known = known[np.isfinite(known)]
            if len(known) == 0:
                continue
            ends = (known.min(), np.median(known), np.quantile(known, 0.95), known.max())
            if not small_is_good:
                ends = (known.max(), np.median(known), np.quantile(known, 0.05), known.min())
            words = " ".join(f"{value:9.4g}" for value in ends)
            lines.append(f"  {name + (', ' + unit if unit else ''):<32} {words}")
        lost = int(np.count_nonzero(~np.isfinite(self.information).all((1, 2)) | (self.n_integers < 3)))
        if lost:
            lines.append(f"without     {lost} of {self.n_epochs} epochs have too few satellites to resolve")
        return "\n".join(lines)

    def _rows(self) -> list[tuple[str, str, np.ndarray, float, bool]]:
        """Lines of the table: name, unit, values, factor, whether small is good."""
        degree = float(np.degrees(1.0))
        sd, reliability = self.sd_rad, self.reliability
        return [
            ("satellites", "", self.n_satellites, 1.0, False),
            *((f"sigma {name}", "deg", sd[:, k], degree, True) for k, name in enumerate(ANGLES)),
            ("success of one baseline, at least", "", self.success, 1.0, False),
            ("ADOP", "cycles", self.adop_cyc, 1.0, True),
            ("PDOP", "", self.pdop, 1.0, True),
            ("azimuth DOP, longest baseline", "", self.azimuth_dop, 1.0, True),
            ("elevation DOP, longest baseline", "", self.elevation_dop, 1.0, True),
            ("MDB of the worst phase", "mm", reliability.mdb_m, 1e3, True),
            *(
                (f"hidden blunder in {name}", "deg", reliability.external_rad[:, k], degree, True)
                for k, name in enumerate(ANGLES)
            ),
        ]


def plan_array(
    source: Session | Scenario | PlanSettings | str | os.PathLike[str] | None = None, **changes: Any
) -> Plan:
    """Plan an array: what it can be expected to achieve at a place over some hours.

    Parameters
    ----------
    source : Session, Scenario, PlanSettings, path-like or str, optional
        A session, a scenario by name or file, or finished settings.
    **changes
        Fields of `truenorth.planning.PlanSettings`, e.g. ``antennas``, ``latitude_deg``,
        ``longitude_deg``, ``start``, ``hours``, ``step_s``; ``navigation`` names files of a real sky.

    Returns
    -------
    Plan

    Raises
    ------
    ConfigError
        For what is missing or impossible, by name.
    NoSolutionError
        If no satellite is ever in view.

    Examples
    --------
    >>> from truenorth.planning import plan_array
    >>> day = plan_array(antennas=[(0, 0, 0), (2, 0, 0), (1, 1, 0)], latitude_deg=47.07, longitude_deg=15.44,
    ...                  start="2024-06-24", hours=2, step_s=1800)
    >>> day.n_epochs
    5
    """
    settings = source if isinstance(source, PlanSettings) and not changes else _settings(source, changes)
    view = sky_view(settings)
    positions_m = np.array(settings.antennas, dtype=float)
    angles_rad = _angles_rad(settings)
    weight = np.where(view.has_integers, 1.0 / view.phase_variance_m2, 0.0)
    information = vector_information(view, weight)
    precision = array_precision(information, positions_m, angles_rad, position_sd_m=settings.position_sd_m)
    success, adop_cyc, n_integers = baseline_success(view)
    dops = _dops(view, positions_m, angles_rad)
    return Plan(
        settings=settings,
        view=view,
        n_satellites=view.n_satellites(),
        cov_rad2=precision.cov_rad2,
        information=information,
        success=success,
        adop_cyc=adop_cyc,
        n_integers=n_integers,
        pdop=dops.pdop,
        azimuth_dop=dops.azimuth_dop,
        elevation_dop=dops.elevation_dop,
        reliability=day_reliability(
            view,
            weight,
            information,
            precision,
            positions_m,
            angles_rad,
            position_sd_m=settings.position_sd_m,
        ),
    )


def _settings(source: Any, changes: dict[str, Any]) -> PlanSettings:
    """Settings from any source with changes on top."""
    if isinstance(source, PlanSettings):
        import msgspec

        source, changes = None, {**msgspec.structs.asdict(source), **changes}
    return plan_settings(source, **changes)


def _angles_rad(settings: PlanSettings) -> tuple[float, float, float]:
    heading, pitch, roll = (settings.heading_deg, settings.pitch_deg, settings.roll_deg)
    return float(np.radians(heading)), float(np.radians(pitch)), float(np.radians(roll))


def _longest(positions_m: np.ndarray) -> tuple[int, int]:
    apart_m = np.linalg.norm(positions_m[:, None] - positions_m[None], axis=-1)
    first, second = np.unravel_index(int(np.argmax(apart_m)), apart_m.shape)
    return int(min(first, second)), int(max(first, second))


def _dops(view: SkyView, positions_m: np.ndarray, angles_rad: tuple[float, ...]) -> Any:
    """Dilutions of the longest baseline, with the phases of the first band of each system that has it."""
    first, second = _longest(positions_m)
    ned = rot_ned_from_body(*angles_rad) @ (positions_m[second] - positions_m[first])
    azimuth, elevation = azimuth_elevation_from_enu(np.array([ned[1], ned[0], -ned[2]]))
    one = np.ones(len(view.satellite), dtype=bool)
    one[1:] = (np.diff(view.satellite) != 0) | (np.diff(view.epoch) != 0)
    use = np.flatnonzero(one)
    enu = view.line_of_sight_ned[use][:, [1, 0, 2]] * np.array([1.0, 1.0, -1.0])
    start = np.searchsorted(view.epoch[use], np.arange(view.n_epochs + 1))
    system = np.array([SYSTEMS.index(name[0]) for name in view.groups])[view.group[use]]
    return baseline_dops(enu, azimuth, elevation, group=system, epoch_start=start)
