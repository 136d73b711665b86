"""One data set at several update rates: what a lower rate costs, with the same satellites in view.

Three laps driven at three rates see three skies (Landfahrer 2009, chapter 6). Here one recording is thinned
to each rate and solved anew: sky, obstructions and noise are the same, so that only the rate differs. Loss
of lock in an epoch that was taken out is told at the next one, as a receiver of that rate would.

The time to re-fix counts from the first instant at which all antennas have the phases of four satellites
again, in the full recording, to the first accepted epoch at the lower rate.

Reference: K. Landfahrer, "Attitude determination using a GPS multi antenna array", MSc thesis, TU Graz, 2009,
chapter 6.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from ..attitude import solve_array, solve_baseline
from ..attitude.array_solution import AttitudeSolution
from ..attitude.solution import BaselineSolution
from ..config import GnssSettings, Session
from ..constants import BAND_CLASSES, SYSTEMS
from ..errors import ConfigError, NoSolutionError, Status
from ..formats import read_navigation, read_observations
from ..frames import ecef_from_geodetic
from ..navigation import Navigation
from ..observations import Observations
from ..positioning.dops import baseline_dops
from ..timescales import NS_PER_S, format_gpst
from .comparison import Comparison, compare
from .decimation import decimate, median_interval_ns

__all__ = ["Obstruction", "RateResult", "RateStudy", "compare_rates"]

FEWEST_SATELLITES = 4
"""Without so many common to all antennas nothing can be resolved."""

MERGED_WITHIN_S = 1.0
"""Obstructions closer together are one."""

MOVING_MPS = 1.0
"""Slower counts as standing, for positions of single epochs wander by decimetres."""


@dataclass(frozen=True, slots=True)
class Obstruction:
    """A time with too few satellites common to all antennas, in the full recording.

    Parameters
    ----------
    start_ns, end_ns : int
        First epoch without, first epoch with four again; GPS time.
    fewest : int
        Satellites at the worst instant.
    """

    start_ns: int
    end_ns: int
    fewest: int

    @property
    def duration_s(self) -> float:
        """float: Seconds without."""
        return (self.end_ns - self.start_ns) / NS_PER_S


@dataclass(frozen=True, slots=True, eq=False)
class RateResult:
    """The data set at one rate.

    Parameters
    ----------
    rate_hz : float
    solution : BaselineSolution or AttitudeSolution
        Of the thinned data.
    n_expected : int
        Epochs that the span has at this rate.
    gaps_s : ndarray
        Times between accepted epochs that are longer than one and a half intervals.
    spacing_m : float
        Median distance between points while the platform moves; NaN where it stands.
    largest_spacing_m : float
        Longest way between accepted epochs.
    refix_s : ndarray, shape (n_obstructions,)
        Time to re-fix after each obstruction; NaN where none came before the next one.
    consistency : float
        Mean square of measured lengths over their stated sigma, which no reference is needed for: of a
        baseline about their middle, of an array about the body coordinates. 1 where sigma is honest.
    pdop : ndarray, shape (n,)
        At the solved epochs.
    quality : ndarray of uint8, shape (n,)
        1 (integers) to 6 (single point), Landfahrer 2009, table 5.1; 0 without a solution.
    comparison : Comparison or None
        With the reference.
    """

    rate_hz: float
    solution: BaselineSolution | AttitudeSolution
    n_expected: int
    gaps_s: np.ndarray
    spacing_m: float
    largest_spacing_m: float
    refix_s: np.ndarray
    consistency: float
    pdop: np.ndarray
    quality: np.ndarray
    comparison: Comparison | None = None

    @property
    def availability(self) -> float:
        """float: Accepted epochs among those expected."""
        return float(np.count_nonzero(self.solution.is_accepted) / max(self.n_expected, 1))

    def status_share(self, status: Status) -> float:
        """Share of a status among the epochs expected; those that are missing are `Status.NONE`."""
        n = int(np.count_nonzero(self.solution.status == status))
        if status == Status.NONE:
            n += self.n_expected - self.solution.n_epochs
        return n / max(self.n_expected, 1)

    def quality_share(self, quality: int) -> float:
        """Share of a quality class among the epochs expected."""
        n = int(np.count_nonzero(self.quality == quality))
        if quality == 0:
            n += self.n_expected - self.solution.n_epochs
        return n / max(self.n_expected, 1)

    def numbers(self) -> dict[str, float]:
        """The rate in numbers, by name with unit; NaN for what is not known."""
        refix = self.refix_s[np.isfinite(self.refix_s)]
        pdop = self.pdop[np.isfinite(self.pdop)]
        found = {
            "rate_hz": self.rate_hz,
            "epochs_expected": float(self.n_expected),
            "epochs_solved": float(np.count_nonzero(self.solution.status != Status.NONE)),
            **{f"{status.label}_share": self.status_share(status) for status in reversed(Status)},
            **{f"quality_{k}_share": self.quality_share(k) for k in (1, 2, 3, 4, 5, 6, 0)},
            "gaps": float(len(self.gaps_s)),
            "gaps_total_s": float(self.gaps_s.sum()),
            "gap_longest_s": float(self.gaps_s.max(initial=0.0)),
            "spacing_m": self.spacing_m,
            "largest_spacing_m": self.largest_spacing_m,
            "refixes": float(len(refix)),
            "refix_median_s": float(np.median(refix)) if len(refix) else np.nan,
            "refix_longest_s": float(refix.max()) if len(refix) else np.nan,
            "consistency": self.consistency,
            "satellites_fewest": float(self.solution.n_sats[self.solution.n_sats > 0].min(initial=99)),
            "satellites_median": float(np.median(self.solution.n_sats)) if self.solution.n_epochs else np.nan,
            "pdop_median": float(np.median(pdop)) if len(pdop) else np.nan,
            "pdop_95": float(np.quantile(pdop, 0.95)) if len(pdop) else np.nan,
        }
        if self.comparison is not None:
            for angle, errors in self.comparison.statistics["accepted"].items():
                found[f"{angle}_rms_deg"] = errors.rms
                found[f"{angle}_p95_deg"] = errors.p95
            found["wrong_epochs"] = float(np.count_nonzero(self.comparison.is_wrong))
            found["nees"] = self.comparison.consistency.nees
        return found


@dataclass(frozen=True, slots=True, eq=False)
class RateStudy:
    """A data set at several rates.

    Parameters
    ----------
    results : tuple of RateResult
        In the order asked for.
    obstructions : tuple of Obstruction
        Of the full recording, the same for all rates.
    time_ns : ndarray of int64, shape (n,)
        Epochs of the full recording.
    n_common : ndarray of int, shape (n,)
        Satellites whose phases all antennas have, whatever their elevation.
    recorded_hz : float
        Rate of the full recording.
    """

    results: tuple[RateResult, ...]
    obstructions: tuple[Obstruction, ...]
    time_ns: np.ndarray
    n_common: np.ndarray
    recorded_hz: float

    def columns(self) -> dict[str, np.ndarray]:
        """One row a rate: name of the column and its values."""
        numbers = [result.numbers() for result in self.results]
        return {name: np.array([entry.get(name, np.nan) for entry in numbers]) for name in numbers[0]}

    def refix_columns(self) -> dict[str, np.ndarray]:
        """One row an obstruction: when, how long, and the time to re-fix at each rate."""
        return {
            "start_gpst": np.array([item.start_ns for item in self.obstructions], dtype=np.int64).astype(
                "timedelta64[ns]"
            )
            + np.datetime64("1980-01-06", "ns"),
            "duration_s": np.array([item.duration_s for item in self.obstructions]),
            "fewest_satellites": np.array([item.fewest for item in self.obstructions], dtype=np.int64),
            **{f"refix_s_{result.rate_hz:g}hz": result.refix_s for result in self.results},
        }

    def to_dict(self) -> dict[str, Any]:
        """Compute all numbers in values that JSON can hold."""

        def plain(value: float) -> float | None:
            return float(value) if np.isfinite(value) else None

        return {
            "recorded_hz": self.recorded_hz,
            "rates": [
                {name: plain(value) for name, value in result.numbers().items()} for result in self.results
            ],
            "obstructions": [
                {
                    "start_gpst": format_gpst(item.start_ns),
                    "duration_s": item.duration_s,
                    "fewest_satellites": item.fewest,
                    "refix_s": [plain(result.refix_s[k]) for result in self.results],
                }
                for k, item in enumerate(self.obstructions)
            ],
        }

    def __str__(self) -> str:
        """Quantities down, rates across; then every obstruction."""
        columns = self.columns()
        rates = [f"{rate:g} Hz" for rate in columns["rate_hz"]]
        lines = [
            f"recorded    {self.recorded_hz:g} Hz, {len(self.time_ns)} epochs, "
            f"{format_gpst(self.time_ns[0], decimals=0)} to {format_gpst(self.time_ns[-1], decimals=0)} GPST",
            f"{'':<34}" + "".join(f"{rate:>11}" for rate in rates),
        ]
        for name, label in _LABELS.items():
            values = columns.get(name)
            if values is None or np.all(np.isnan(values)) or (name in _WHEN_THERE and not np.any(values)):
                continue
            factor = 100.0 if name.endswith("_share") else 1.0
            lines.append(f"  {label:<32}" + "".join(f"{_word(factor * value):>11}" for value in values))
        if self.obstructions:
            lines.append(f"time to re-fix, s, after {len(self.obstructions)} obstructions")
            for k, item in enumerate(self.obstructions):
                since_s = (item.start_ns - self.time_ns[0]) / NS_PER_S
                text = f"at {since_s:.1f} s, for {item.duration_s:.2f} s, {item.fewest} left"
                words = "".join(f"{_word(result.refix_s[k]):>11}" for result in self.results)
                lines.append(f"  {text:<32}{words}")
        return "\n".join(lines)


_LABELS = {
    "epochs_expected": "epochs expected",
    "fixed_share": "fixed, %",
    "held_share": "held, %",
    "float_share": "float, %",
    "none_share": "none, %",
    "quality_1_share": "quality 1, %",
    "quality_2_share": "quality 2, %",
    "quality_3_share": "quality 3, %",
    "quality_4_share": "quality 4, %",
    "quality_5_share": "quality 5, %",
    "quality_6_share": "quality 6, %",
    "gaps": "gaps",
    "gaps_total_s": "gaps together, s",
    "gap_longest_s": "longest gap, s",
    "spacing_m": "point spacing, m",
    "largest_spacing_m": "longest way without, m",
    "refix_median_s": "time to re-fix, median, s",
    "refix_longest_s": "time to re-fix, longest, s",
    "consistency": "length scatter over stated, sq.",
    "satellites_fewest": "satellites, fewest",
    "satellites_median": "satellites, median",
    "pdop_median": "PDOP, median",
    "pdop_95": "PDOP, 95 %",
    "heading_rms_deg": "heading error, rms, deg",
    "pitch_rms_deg": "pitch error, rms, deg",
    "roll_rms_deg": "roll error, rms, deg",
    "azimuth_rms_deg": "azimuth error, rms, deg",
    "elevation_rms_deg": "elevation error, rms, deg",
    "wrong_epochs": "wrong epochs",
    "nees": "NEES per angle",
}
"""Lines of the table."""

_WHEN_THERE = {f"quality_{k}_share" for k in range(2, 7)}


def _word(value: float) -> str:
    if not np.isfinite(value):
        return "-"
    return f"{value:.0f}" if value == round(value) and abs(value) >= 10.0 else f"{value:.3g}"


@dataclass(frozen=True, slots=True, eq=False)
class _Recording:
    """What is solved again and again."""

    observations: tuple[Observations, ...]
    navigation: Navigation
    positions_body_m: list[tuple[float, float, float]] | None
    names: tuple[str, ...]
    settings: GnssSettings
    options: dict[str, Any]
    """What else the session says about an array."""


def compare_rates(
    session: Session | str | os.PathLike[str] | Any,
    rates_hz: Sequence[float],
    reference: Any = None,
    *,
    baseline_body_m: tuple[float, float, float] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> RateStudy:
    """Thin one data set to several rates, solve each, and compare what comes out.

    Parameters
    ----------
    session : Session, path-like or Simulation
        The session or its ``session.toml``, or a simulation in memory.
    rates_hz : sequence of float
        Update rates, none above that of the recording.
    reference : path-like, dict or solution, optional
        Truth, as for `truenorth.evaluation.compare`.
    baseline_body_m : tuple of float, optional
        Where the second of two antennas stands as seen from the first; by default from the session.
    progress : callable, optional
        Called with (epochs done, epochs in all).

    Returns
    -------
    RateStudy

    Raises
    ------
    ConfigError
        If a rate is above that of the recording, or none is given.
    NoSolutionError
        If the antennas have no epoch in common.

    Examples
    --------
    >>> from truenorth.evaluation import compare_rates
    >>> print(compare_rates("session.toml", [1, 10, 20], "truth.csv"))  # doctest: +SKIP
    """
    rates = [float(rate) for rate in rates_hz]
    if not rates:
        raise ConfigError("no rate is given; name one or more in hertz", key="rates")
    recording, body_m = _recording(session)
    body_m = baseline_body_m if baseline_body_m is not None else body_m
    start_ns = int(recording.observations[0].time_ns[0]) // NS_PER_S * NS_PER_S
    thinned = [
        [decimate(observations, rate, start_ns=start_ns) for observations in recording.observations]
        for rate in rates
    ]
    time_ns, n_common = _common_satellites(recording)
    obstructions = _obstructions(time_ns, n_common)
    total = sum(group[0].n_epochs for group in thinned)
    way, results, done = None, [], 0
    order = np.argsort(rates)[::-1]  # The fastest tells best where the platform went.
    for k in order:
        told = _shifted(progress, done, total)
        solution = _solve(recording, thinned[k], told)
        done += thinned[k][0].n_epochs
        comparison = None
        if reference is not None:
            comparison = compare(solution, reference, baseline_body_m=body_m)
        if way is None:
            way = _way_of(solution, comparison)
        results.append(_result(rates[k], solution, time_ns, obstructions, way, comparison))
    return RateStudy(
        results=tuple(results[int(np.flatnonzero(order == k)[0])] for k in range(len(rates))),
        obstructions=obstructions,
        time_ns=time_ns,
        n_common=n_common,
        recorded_hz=round(NS_PER_S / median_interval_ns(time_ns), 6),
    )


def _recording(session: Any) -> tuple[_Recording, tuple[float, float, float] | None]:
    """Observations in memory, and the body vector of a baseline where it is known."""
    from ..simulation.run import Simulation

    if isinstance(session, Simulation):
        antennas = session.scenario.platform.antennas
        positions = [antenna.position_body_m for antenna in antennas]
        settings = session.scenario.solve
        if len(antennas) == 2 and settings.length_m is None:
            import msgspec

            length_m = float(np.linalg.norm(np.subtract(positions[1], positions[0])))
            settings = msgspec.structs.replace(settings, length_m=length_m)
        recording = _Recording(
            tuple(session.observations.values()),
            session.navigation,
            positions,
            tuple(session.observations),
            settings,
            {},
        )
        return recording, _difference(positions)
    if not isinstance(session, Session):
        session = Session.read(session)
    paths = session.observation_paths
    given = [antenna.position_body_m for antenna in session.platform.antennas]
    known = [position for position in given if position is not None]
    recording = _Recording(
        tuple(read_observations(path) for path in paths),
        read_navigation(*(session.gnss.navigation or paths)),
        known if len(known) == len(given) else None,
        tuple(antenna.name for antenna in session.platform.antennas),
        session.settings,
        {key: getattr(session, key) for key in ("array", "attitude_filter", "reliability")},
    )
    return recording, _difference(recording.positions_body_m)


def _difference(
    positions: Sequence[tuple[float, float, float]] | None,
) -> tuple[float, float, float] | None:
    if positions is None:
        return None
    forward, right, down = (float(value) for value in np.subtract(positions[1], positions[0]))
    return forward, right, down


def _solve(
    recording: _Recording, observations: list[Observations], progress: Any
) -> BaselineSolution | AttitudeSolution:
    if len(observations) == 2:
        base, rover = observations
        return solve_baseline(
            base, rover, recording.navigation, settings=recording.settings, progress=progress
        )
    return solve_array(
        observations,
        recording.positions_body_m,
        recording.navigation,
        names=recording.names,
        settings=recording.settings,
        **recording.options,
        progress=progress,
        keep_residuals=True,
    )


def _shifted(progress: Callable[[int, int], None] | None, done: int, total: int) -> Any:
    if progress is None:
        return None
    return lambda here, of_here: progress(done + here, total)


def _common_satellites(recording: _Recording) -> tuple[np.ndarray, np.ndarray]:
    """Epochs of the recording's grid, missing ones included, and the satellites that all antennas have."""
    first = recording.observations[0]
    step_ns = median_interval_ns(first.time_ns)
    origin = int(first.time_ns[0])
    n = round((int(first.time_ns[-1]) - origin) / step_ns) + 1
    settings = recording.settings
    systems = [SYSTEMS.index(letter) for letter in settings.systems]
    wanted = np.zeros((len(SYSTEMS), 10), dtype=bool)
    for band in settings.bands:
        for letter, digits in cast("dict[str, tuple[int, ...]]", BAND_CLASSES[band]).items():
            wanted[SYSTEMS.index(letter), list(digits)] = True
    common = None
    for observations in recording.observations:
        slot = np.rint((observations.time_ns - origin) / step_ns).astype(np.int64)[observations.epoch_of_row]
        system = observations.sat // 100
        good = np.isfinite(observations.phase_cyc) & np.isin(system, systems) & (slot >= 0) & (slot < n)
        good &= wanted[system, observations.signal // 100]
        key = np.unique(slot[good] * 1000 + observations.sat[good])
        common = key if common is None else np.intersect1d(common, key, assume_unique=True)
    if common is None or len(common) == 0:
        raise NoSolutionError("could not compare rates: the antennas never have a satellite in common")
    return origin + np.arange(n) * step_ns, np.bincount(common // 1000, minlength=n)


def _obstructions(time_ns: np.ndarray, n_common: np.ndarray) -> tuple[Obstruction, ...]:
    """Times with too few satellites after the first with enough; those that end within the recording."""
    few = n_common < FEWEST_SATELLITES
    enough = np.flatnonzero(~few)
    if len(enough) == 0:
        return ()
    few[: enough[0]] = False
    edge = np.diff(np.concatenate(([0], few.astype(np.int8), [0])))
    starts, ends = np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)
    found: list[Obstruction] = []
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        if end >= len(time_ns):
            continue
        fewest = int(n_common[start:end].min())
        if found and time_ns[start] - found[-1].end_ns < MERGED_WITHIN_S * NS_PER_S:
            last = found.pop()
            found.append(Obstruction(last.start_ns, int(time_ns[end]), min(last.fewest, fewest)))
        else:
            found.append(Obstruction(int(time_ns[start]), int(time_ns[end]), fewest))
    return tuple(found)


def _way_of(
    solution: BaselineSolution | AttitudeSolution, comparison: Comparison | None
) -> tuple[np.ndarray, np.ndarray]:
    """Seconds and way along the route: of the reference, or from positions averaged over a second."""
    place_deg = (None, None) if comparison is None else (comparison.latitude_deg, comparison.longitude_deg)
    if comparison is not None and place_deg[0] is not None and place_deg[1] is not None:
        time_ns, slowest_mps = comparison.time_ns, 0.01
        position_m = ecef_from_geodetic(np.radians(place_deg[0]), np.radians(place_deg[1]), 0.0)
    else:
        time_ns, position_m, slowest_mps = solution.time_ns, solution.position_ecef_m, MOVING_MPS
    known = np.isfinite(position_m).all(1)
    time_ns, position_m = time_ns[known], position_m[known]
    if len(time_ns) < 2:
        return np.zeros(1), np.zeros(1)
    time_s = (time_ns - time_ns[0]) / NS_PER_S
    if slowest_mps == MOVING_MPS:
        _, place = np.unique(time_ns // NS_PER_S, return_inverse=True)
        count = np.bincount(place)
        time_s = np.bincount(place, time_s) / count
        position_m = np.stack([np.bincount(place, position_m[:, i]) / count for i in range(3)], axis=-1)
    step_m = np.linalg.norm(np.diff(position_m, axis=0), axis=1)
    step_m[step_m < slowest_mps * np.diff(time_s)] = 0.0
    return time_s + time_ns[0] / NS_PER_S, np.concatenate(([0.0], np.cumsum(step_m)))


def _result(
    rate_hz: float,
    solution: BaselineSolution | AttitudeSolution,
    time_ns: np.ndarray,
    obstructions: tuple[Obstruction, ...],
    way: tuple[np.ndarray, np.ndarray],
    comparison: Comparison | None,
) -> RateResult:
    """Numbers of one rate."""
    step_ns = NS_PER_S / rate_hz
    accepted_ns = solution.time_ns[solution.is_accepted]
    ends_ns = np.concatenate(([time_ns[0] - step_ns], accepted_ns, [time_ns[-1] + step_ns]))
    apart_ns = np.diff(ends_ns)
    # The grid of the rate and that of the recording may be apart by a part of an interval at the ends.
    gaps_s = (apart_ns[apart_ns > 1.5 * step_ns] - step_ns) / NS_PER_S
    way_at = np.interp(solution.time_ns / NS_PER_S, *way)
    step_m = np.diff(way_at)
    regular = np.diff(solution.time_ns) < 1.5 * step_ns
    moving = regular & (step_m > MOVING_MPS * step_ns / NS_PER_S)
    between_m = np.diff(np.interp(accepted_ns / NS_PER_S, *way))
    refix_s = np.full(len(obstructions), np.nan)
    for k, item in enumerate(obstructions):
        limit_ns = obstructions[k + 1].start_ns if k + 1 < len(obstructions) else time_ns[-1] + 1
        after = accepted_ns[(accepted_ns >= item.end_ns) & (accepted_ns < limit_ns)]
        if len(after):
            refix_s[k] = (after[0] - item.end_ns) / NS_PER_S
    pdop, quality = _pdop_and_quality(solution)
    return RateResult(
        rate_hz=rate_hz,
        solution=solution,
        n_expected=int(np.floor((time_ns[-1] - time_ns[0]) / step_ns + 1e-6)) + 1,
        gaps_s=gaps_s,
        spacing_m=float(np.median(step_m[moving])) if np.any(moving) else np.nan,
        largest_spacing_m=float(between_m.max()) if len(between_m) else np.nan,
        refix_s=refix_s,
        consistency=_consistency(solution),
        pdop=pdop,
        quality=quality,
        comparison=comparison,
    )


def _consistency(solution: BaselineSolution | AttitudeSolution) -> float:
    """Mean square of measured lengths about what they should be, over their stated variances."""
    if isinstance(solution, BaselineSolution):
        good = solution.is_accepted & np.isfinite(solution.length_m) & (solution.length_sd_m > 0.0)
        if np.count_nonzero(good) < 3:
            return np.nan
        # About their own middle: what is wrong with the declared length is told elsewhere.
        off_m = solution.length_m[good] - np.median(solution.length_m[good])
        return float(np.mean((off_m / solution.length_sd_m[good]) ** 2))
    squares = [value for *_, value in _vectors_of(solution)]
    whole = np.concatenate(squares) if squares else np.zeros(0)
    whole = whole[np.isfinite(whole)]
    return float(whole.mean()) if len(whole) else np.nan


def _vectors_of(solution: AttitudeSolution) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Epochs, expected error in space, and squared misfit of the length over its variance, by antenna."""
    vectors = solution.vectors
    if vectors is None:
        return
    accepted = solution.is_accepted & (vectors.reference >= 0)
    body_m = vectors.positions_body_m
    for k in range(len(body_m)):
        rows = np.flatnonzero(accepted & np.isfinite(vectors.vector_ned_m[:, k, 0]))
        if len(rows) == 0:
            continue
        b = vectors.vector_ned_m[rows, k].astype(float)
        cov = vectors.cov_ned_m2[rows][:, 3 * k : 3 * k + 3, 3 * k : 3 * k + 3].astype(float)
        size_m = np.linalg.norm(b, axis=1)
        variance = np.einsum("ni,nij,nj->n", b, cov, b) / size_m**2
        length_m = np.linalg.norm(body_m[k] - body_m[vectors.reference[rows]], axis=1)
        yield rows, np.sqrt(np.einsum("nii->n", cov)), (size_m - length_m) ** 2 / variance


def _pdop_and_quality(solution: BaselineSolution | AttitudeSolution) -> tuple[np.ndarray, np.ndarray]:
    """Of an array the PDOP of the satellites that any antenna used, and the class of its worst vector."""
    if isinstance(solution, BaselineSolution):
        return np.where(solution.status == Status.NONE, np.nan, solution.pdop), solution.quality
    quality = np.zeros(solution.n_epochs, np.uint8)
    for rows, error_m, _ in _vectors_of(solution):
        # Integers: 1 up to 0.15 m, else 2 (Landfahrer 2009, table 5.1).
        quality[rows] = np.maximum(quality[rows], np.where(error_m <= 0.15, 1, 2))
    return _array_pdop(solution), quality


def _array_pdop(solution: AttitudeSolution) -> np.ndarray:
    """PDOP of the satellites whose phases took part, or of the worst baseline; NaN where nothing tells."""
    pdop = np.full(solution.n_epochs, np.nan)
    for baseline in solution.baselines:
        _, here, there = np.intersect1d(
            solution.time_ns, baseline.time_ns, assume_unique=True, return_indices=True
        )
        own = np.where(baseline.status[there] == Status.NONE, np.nan, baseline.pdop[there])
        pdop[here] = np.fmax(pdop[here], own)
    residuals = solution.residuals
    if residuals is None or len(residuals.epoch) == 0:
        return pdop
    key = residuals.epoch * 1000 + residuals.sat
    key, first = np.unique(key, return_index=True)
    azimuth, elevation = residuals.azimuth_rad[first], residuals.elevation_rad[first]
    enu = np.stack(
        [np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)], -1
    )
    start = np.searchsorted(key // 1000, np.arange(solution.n_epochs + 1))
    system = (key % 1000) // 100
    found = baseline_dops(enu, 0.0, 0.0, group=system, epoch_start=start).pdop
    return np.where(solution.status == Status.NONE, np.nan, found)
