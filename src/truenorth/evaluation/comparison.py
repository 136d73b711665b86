"""A solution against a reference: errors at every epoch, their statistics, and whether sigma was honest.

The reference is interpolated to the epochs of the solution, angle by angle along the shorter way around
the circle. Errors are solution less reference. An accepted epoch is wrong when an angle is off by more
than so many of its stated standard deviations, or by more than so many degrees where a limit is given.
"""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ConfigError, NoSolutionError, Status
from ..timescales import NS_PER_S, format_gpst
from .statistics import Consistency, ErrorStatistics, consistency_of, error_statistics
from .tracks import ATTITUDE, DIRECTION, Track, direction_of_body_vector, reference_track, solution_track

__all__ = ["Comparison", "body_vector_beside", "compare"]

GROUPS = ("accepted", "fixed", "held", "float")
"""Epochs by status; ``accepted`` is fixed and held."""


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Errors of a solution, one row per epoch that the reference covers.

    Parameters
    ----------
    angles : tuple of str
        ``heading``, ``pitch``, ``roll``, or ``azimuth``, ``elevation``.
    time_ns : ndarray of int64, shape (n,)
        GPS time.
    status : ndarray of uint8, shape (n,)
        Of the solution.
    estimate_rad, reference_rad, error_rad, sd_rad : ndarray, shape (n, k)
        Solution, reference, their difference in (-pi, pi] and its stated standard deviation; NaN where
        there is no solution.
    nees : ndarray, shape (n,)
        Normalised error squared of the angles that there are.
    dof : ndarray of int, shape (n,)
        How many these are.
    is_wrong : ndarray of bool, shape (n,)
        Accepted epochs beyond `wrong_sd` or `wrong_deg`.
    interval_s : float
        Between epochs of the solution.
    expected_epochs : int
        That the span of the reference has at this interval.
    longest_outage_s : float
        Longest time without accepted epoch within the span of the reference.
    wrong_sd : float
        Standard deviations that an error may have.
    wrong_deg : float or None
        Degrees that an error may have.
    statistics : dict of str to dict of str to ErrorStatistics
        By status and angle, degrees.
    consistency : Consistency
        Of the accepted epochs.
    latitude_deg, longitude_deg : ndarray, shape (n,), or None
        Where the platform was, by the reference or else by the solution.
    """

    angles: tuple[str, ...]
    time_ns: np.ndarray
    status: np.ndarray
    estimate_rad: np.ndarray
    reference_rad: np.ndarray
    error_rad: np.ndarray
    sd_rad: np.ndarray
    nees: np.ndarray
    dof: np.ndarray
    is_wrong: np.ndarray
    interval_s: float
    expected_epochs: int
    longest_outage_s: float
    wrong_sd: float
    wrong_deg: float | None
    statistics: dict[str, dict[str, ErrorStatistics]]
    consistency: Consistency
    latitude_deg: np.ndarray | None = None
    longitude_deg: np.ndarray | None = None

    @property
    def n_epochs(self) -> int:
        """int: Epochs compared."""
        return len(self.time_ns)

    @property
    def is_accepted(self) -> np.ndarray:
        """Ndarray of bool, shape (n,): epochs with validated integers (fixed or held)."""
        return (self.status == Status.FIXED) | (self.status == Status.HELD)

    @property
    def availability(self) -> float:
        """float: Accepted epochs among those that the span of the reference has."""
        return float(np.count_nonzero(self.is_accepted) / max(self.expected_epochs, 1))

    @property
    def wrong_fraction(self) -> float:
        """float: Wrong epochs among the accepted ones."""
        return float(np.count_nonzero(self.is_wrong) / max(int(np.count_nonzero(self.is_accepted)), 1))

    def to_dict(self) -> dict[str, Any]:
        """Compute all but the epochs themselves, in values that JSON can hold; angles in degrees."""
        consistency = {**asdict(self.consistency), "verdict": self.consistency.verdict}
        return _finite(
            {
                "first_gpst": format_gpst(self.time_ns[0]) if self.n_epochs else None,
                "last_gpst": format_gpst(self.time_ns[-1]) if self.n_epochs else None,
                "epochs": self.n_epochs,
                "expected_epochs": self.expected_epochs,
                "interval_s": self.interval_s,
                "accepted": int(np.count_nonzero(self.is_accepted)),
                "availability": self.availability,
                "longest_outage_s": self.longest_outage_s,
                "wrong": int(np.count_nonzero(self.is_wrong)),
                "wrong_fraction": self.wrong_fraction,
                "wrong_sd": self.wrong_sd,
                "wrong_deg": self.wrong_deg,
                "errors_deg": {
                    group: {angle: asdict(entry) for angle, entry in entries.items()}
                    for group, entries in self.statistics.items()
                },
                "consistency": consistency,
            }
        )

    def availability_sentence(self) -> str:
        """str: Share and number of accepted epochs, and the longest time without one."""
        return (
            f"{100.0 * self.availability:.1f} %, {np.count_nonzero(self.is_accepted)} accepted of "
            f"{self.expected_epochs} epochs; longest outage {self.longest_outage_s:g} s"
        )

    def wrong_sentence(self) -> str:
        """str: What counts as wrong, and how many epochs do."""
        limit = f"{self.wrong_sd:g} sigma" + (f" or {self.wrong_deg:g} deg" if self.wrong_deg else "")
        return (
            f"{np.count_nonzero(self.is_wrong)} epochs ({100.0 * self.wrong_fraction:.2f} %) beyond {limit}"
        )

    def consistency_sentence(self) -> str:
        """str: The mean normalised error squared against its bounds."""
        c = self.consistency
        if c.verdict == "unknown":
            return "unknown: no epochs with a stated covariance"
        meaning = {
            "consistent": "the stated sigma is honest",
            "optimistic": f"errors are {np.sqrt(c.nees):.2f} times the stated sigma",
            "pessimistic": f"errors are only {np.sqrt(c.nees):.2f} times the stated sigma",
        }[c.verdict]
        return (
            f"NEES {c.nees:.3f} per degree of freedom, {c.lower:.3f} to {c.upper:.3f} expected "
            f"({100.0 * c.confidence:g} %, {c.n_effective:.0f} independent of {c.n} epochs): {meaning}"
        )

    def __str__(self) -> str:
        """Table of the statistics, the outcome first."""
        heads = ("mean", "sd", "rms", "68 %", "95 %", "99 %", "max")
        lines = [
            f"available   {self.availability_sentence()}",
            f"wrong       {self.wrong_sentence()}",
            f"consistency {self.consistency_sentence()}",
            f"{'errors, deg':<22} {'n':>9} " + " ".join(f"{head:>9}" for head in heads),
        ]
        for group, entries in self.statistics.items():
            if group == "fixed" and "held" not in self.statistics:
                continue  # The same as accepted.
            for angle, e in entries.items():
                numbers = (e.mean, e.sd, e.rms, e.p68, e.p95, e.p99, e.max)
                words = " ".join(f"{value:9.4f}" for value in numbers)
                lines.append(f"  {group:<9} {angle:<10} {e.n:9d} {words}")
        return "\n".join(lines)


def compare(
    solution: Any,
    reference: Any,
    *,
    baseline_body_m: tuple[float, float, float] | None = None,
    wrong_sd: float = 5.0,
    wrong_deg: float | None = None,
    max_gap_s: float | None = None,
) -> Comparison:
    """Compare a solution with a reference.

    Parameters
    ----------
    solution : BaselineSolution, AttitudeSolution, path-like or dict
        A result, or its CSV or Parquet file.
    reference : path-like, dict, BaselineSolution or AttitudeSolution
        A table of truth such as `truenorth simulate` writes (``time_ns`` or ``time_gpst``,
        ``heading_deg``, ``pitch_deg``, ``roll_deg``), the ``truth`` of a simulation in memory, or another
        solution.
    baseline_body_m : tuple of float, optional
        Where the rover antenna of a baseline stands as seen from the base: forward, right, down. Needed to
        compare a baseline with an attitude; straight ahead by default.
    wrong_sd : float
        An accepted epoch is wrong when an angle is off by more standard deviations.
    wrong_deg : float, optional
        It is also wrong when an angle is off by more degrees.
    max_gap_s : float, optional
        The reference is not interpolated over longer gaps; by default three of its own intervals.

    Returns
    -------
    Comparison

    Raises
    ------
    FormatError
        If a file cannot be read or has not the columns.
    ConfigError
        If a limit is not positive, or an attitude shall be compared with a direction.
    NoSolutionError
        If solution and reference have no time in common.

    Examples
    --------
    >>> from truenorth.evaluation import compare
    >>> print(compare("attitude.csv", "truth.csv"))  # doctest: +SKIP
    """
    for key, value in (("wrong_sd", wrong_sd), ("wrong_deg", wrong_deg), ("max_gap_s", max_gap_s)):
        if value is not None and not value > 0.0:
            raise ConfigError(f"`{key}` is {value!r}; give a positive number", key=key, value=value)
    track, truth = solution_track(solution), reference_track(reference)
    if track.angles == ATTITUDE and truth.angles == DIRECTION:
        raise ConfigError(
            "an attitude cannot be compared with the direction of a baseline; give a reference with "
            "`heading_deg`",
            key="reference",
        )
    reference_rad, covered, at = _interpolated(track, truth, baseline_body_m, max_gap_s)
    if not np.any(covered):
        raise NoSolutionError(
            "could not compare: solution and reference have no time in common"
            + _spans(track.time_ns, truth.time_ns)
        )
    angle_rad, cov_rad2 = track.angle_rad[covered], track.cov_rad2[covered]
    time_ns, status = track.time_ns[covered], track.status[covered]
    error_rad = np.remainder(angle_rad - reference_rad + np.pi, 2.0 * np.pi) - np.pi
    with np.errstate(invalid="ignore"):
        sd_rad = np.sqrt(np.einsum("nii->ni", cov_rad2))
    nees, dof = _normalised(error_rad, cov_rad2)
    accepted = (status == Status.FIXED) | (status == Status.HELD)
    with np.errstate(invalid="ignore"):
        beyond = np.abs(error_rad) > wrong_sd * sd_rad
        if wrong_deg is not None:
            beyond |= np.abs(error_rad) > np.radians(wrong_deg)
    groups = {
        "accepted": accepted,
        **{name: status == Status[name.upper()] for name in GROUPS[1:]},
    }
    statistics = {
        group: {
            angle: error_statistics(np.degrees(error_rad[rows, k])) for k, angle in enumerate(track.angles)
        }
        for group, rows in groups.items()
        if group == "accepted" or np.any(rows)
    }
    interval_ns = int(np.median(np.diff(track.time_ns))) if len(track.time_ns) > 1 else NS_PER_S
    span_ns = int(truth.time_ns[-1] - truth.time_ns[0])
    places = _places(track, truth, covered, at)
    return Comparison(
        angles=track.angles,
        time_ns=time_ns,
        status=status,
        estimate_rad=angle_rad,
        reference_rad=reference_rad,
        error_rad=error_rad,
        sd_rad=sd_rad,
        nees=nees,
        dof=dof,
        is_wrong=accepted & beyond.any(1),
        interval_s=interval_ns / NS_PER_S,
        expected_epochs=max(round(span_ns / interval_ns) + 1, 1),
        longest_outage_s=_longest_outage_s(time_ns[accepted], truth.time_ns, interval_ns),
        wrong_sd=float(wrong_sd),
        wrong_deg=None if wrong_deg is None else float(wrong_deg),
        statistics=statistics,
        consistency=consistency_of(nees[accepted], dof[accepted]),
        latitude_deg=places[0],
        longitude_deg=places[1],
    )


def body_vector_beside(path: str | os.PathLike[str]) -> tuple[float, float, float] | None:
    """Body vector of a baseline whose result has its settings beside it, as `truenorth solve` leaves them.

    Parameters
    ----------
    path : path-like
        The result file.

    Returns
    -------
    tuple of float or None
        From the first antenna to the second; None where there are no such settings or no coordinates.
    """
    from ..config import Session

    settings = Path(path).with_suffix(".settings.toml")
    if not settings.is_file():
        return None
    antennas = Session.from_toml(settings.read_text(encoding="utf-8")).platform.antennas
    first, second = (antenna.position_body_m for antenna in antennas[:2])
    if first is None or second is None:
        return None
    forward, right, down = (float(b - a) for a, b in zip(first, second, strict=True))
    return forward, right, down


def _interpolated(
    track: Track, truth: Track, body_m: tuple[float, float, float] | None, max_gap_s: float | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Reference angles at the epochs that it covers, which these are, and the last reference before them."""
    angle_rad, time_ns = truth.angle_rad, truth.time_ns
    known = np.isfinite(angle_rad[:, 0]) & (truth.status >= Status.HELD)
    angle_rad, time_ns = angle_rad[known], time_ns[known]
    if track.angles == DIRECTION and truth.angles == ATTITUDE:
        angle_rad = direction_of_body_vector(angle_rad, body_m if body_m is not None else (1.0, 0.0, 0.0))
    at = np.clip(np.searchsorted(time_ns, track.time_ns, side="right") - 1, 0, max(len(time_ns) - 2, 0))
    if len(time_ns) == 0:
        return angle_rad[:0], np.zeros(len(track.time_ns), bool), at
    after = np.minimum(at + 1, len(time_ns) - 1)
    gap_ns = time_ns[after] - time_ns[at]
    limit_ns = 3.0 * np.median(np.diff(time_ns)) if len(time_ns) > 1 else 0.0
    if max_gap_s is not None:
        limit_ns = max_gap_s * NS_PER_S
    share = (track.time_ns - time_ns[at]) / np.maximum(gap_ns, 1)
    exact = (share == 0.0) | (share == 1.0)
    covered = exact | ((share > 0.0) & (share < 1.0) & (gap_ns <= limit_ns))
    step = np.remainder(angle_rad[after] - angle_rad[at] + np.pi, 2.0 * np.pi) - np.pi
    found = angle_rad[at] + np.where(share[:, None] == 0.0, 0.0, share[:, None] * step)
    found[:, 0] = np.mod(found[:, 0], 2.0 * np.pi)
    return found[covered], covered, np.flatnonzero(known)[at]


def _normalised(error_rad: np.ndarray, cov_rad2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normalised error squared of the angles that are known, and how many these are."""
    known = np.isfinite(error_rad) & np.isfinite(np.einsum("nii->ni", cov_rad2))
    nees, dof = np.full(len(error_rad), np.nan), np.count_nonzero(known, axis=1)
    for pattern in np.unique(known, axis=0):
        if not pattern.any():
            continue
        rows = np.flatnonzero((known == pattern).all(1))
        some = np.flatnonzero(pattern)
        cov = cov_rad2[np.ix_(rows, some, some)]
        usable = np.linalg.det(cov) > 0.0
        rows, cov = rows[usable], cov[usable]
        error = error_rad[np.ix_(rows, some)]
        nees[rows] = np.einsum("ni,ni->n", error, np.linalg.solve(cov, error[..., None])[..., 0])
    return nees, dof


def _longest_outage_s(accepted_ns: np.ndarray, reference_ns: np.ndarray, interval_ns: int) -> float:
    """Longest time between accepted epochs or to an end of the reference, beyond one interval."""
    ends = [reference_ns[0] - interval_ns, *accepted_ns, reference_ns[-1] + interval_ns]
    return max(float(np.max(np.diff(np.array(ends, dtype=np.int64))) - interval_ns) / NS_PER_S, 0.0)


def _places(
    track: Track, truth: Track, covered: np.ndarray, at: np.ndarray
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Where the platform was: by the reference, or by the solution."""
    if truth.latitude_deg is not None and truth.longitude_deg is not None:
        return truth.latitude_deg[at[covered]], truth.longitude_deg[at[covered]]
    if track.latitude_deg is not None and track.longitude_deg is not None:
        return track.latitude_deg[covered], track.longitude_deg[covered]
    return None, None


def _spans(time_ns: np.ndarray, reference_ns: np.ndarray) -> str:
    """What each covers, as the end of a sentence."""
    if len(time_ns) == 0 or len(reference_ns) == 0:
        return "; one of them is empty"
    texts = [f"{format_gpst(t[0])} to {format_gpst(t[-1])}" for t in (time_ns, reference_ns)]
    return f"; the solution runs from {texts[0]}, the reference from {texts[1]} GPST"


def _finite(value: Any) -> Any:
    """The same with None for what is not a finite number."""
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value
