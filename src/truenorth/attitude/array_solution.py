"""The result of a run over three or more antennas: one attitude per epoch and what is known about it."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .array_vectors import ArrayVectors
from .filter_state import FilteredAttitude
from .reliability.array_reliability import AttitudeReliability
from .solution import BaselineSolution, EpochEvent, SolutionOutputs

__all__ = ["AttitudeSolution", "PhaseResiduals"]


@dataclass(frozen=True, slots=True, eq=False)
class PhaseResiduals:
    """Residuals of the joint adjustment, one row for each phase that took part.

    Parameters
    ----------
    epoch : ndarray of int64, shape (k,)
        Index of the epoch.
    antenna : ndarray of int16, shape (k,)
        Index of the antenna.
    sat, signal : ndarray of int16, shape (k,)
        Satellite and signal, see `truenorth.observations`.
    residual_m : ndarray of float64, shape (k,)
        Undifferenced, satellite constants and clocks estimated; metres.
    azimuth_rad, elevation_rad : ndarray of float64, shape (k,)
        Direction of the satellite in the local level.
    integer_cyc : ndarray of float64, shape (k,)
        Integer of the arc, up to constants of a satellite and of a clock.
    """

    epoch: np.ndarray
    antenna: np.ndarray
    sat: np.ndarray
    signal: np.ndarray
    residual_m: np.ndarray
    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray
    integer_cyc: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeSolution(SolutionOutputs):
    """Attitude of the platform at every epoch of its reference antenna.

    Arrays have one row per epoch; angles that could not be found are NaN.

    Parameters
    ----------
    time_ns : ndarray of int64, shape (n,)
        GPS time of the epoch (the reference receiver's time tag), nanoseconds.
    status, reason : ndarray of uint8, shape (n,)
        Codes of `truenorth.errors.Status` and `truenorth.errors.Reason`. Epochs whose antennas stand on
        one line are accepted with `Reason.ROLL_UNOBSERVABLE`.
    heading_rad, pitch_rad, roll_rad : ndarray of float64, shape (n,)
        Intrinsic z-y-x angles from north, east, down; heading in [0, 2 pi).
    cov_rad2 : ndarray of float64, shape (n, 3, 3)
        Covariance of heading, pitch and roll.
    rot_ned_from_body : ndarray of float64, shape (n, 3, 3)
        The attitude itself; NaN where one of its angles is.
    is_used, is_excluded : ndarray of bool, shape (n, n_antennas)
        Antennas that took part, and those that contradicted the others.
    chi2, chi2_limit : ndarray of float64, shape (n,)
        Test of the adjustment against the body coordinates and its limit: of all phases where the antennas
        were resolved jointly, of the vectors (those included that were left out because of it) otherwise.
    success_probability : ndarray of float64, shape (n,)
        With which the integers of the joint search were accepted; NaN where the baselines were solved one
        by one.
    n_sats : ndarray of int16, shape (n,)
        Satellites that took part: all of the joint adjustment, or those of the baseline that used fewest.
    position_ecef_m : ndarray of float64, shape (n, 3)
        Single-point position of the reference antenna, metres.
    antennas : tuple of str
        Names, the reference first.
    positions_body_m : ndarray of float64, shape (n_antennas, 3)
        Body coordinates, metres.
    level : str
        How much of the geometry the integers rest on: ``joint`` (all body coordinates), ``length`` (the
        distances from the reference antenna) or ``free`` (none).
    vectors : ArrayVectors or None
        Vectors between the antennas as the phases alone give them, with their joint covariance; None where
        they were not kept.
    residuals : PhaseResiduals or None
        Of every phase that took part in the joint adjustment, where they were asked for.
    filtered : FilteredAttitude or None
        All that the attitude filter knows, rates included, where one was asked for.
    reliability : AttitudeReliability or None
        Tests, detectable blunders, their effect and protection levels at the epochs of `vectors`, where they
        were asked for.
    baselines : tuple of BaselineSolution
        From the reference to each other antenna, at their own epochs; empty at the level ``joint``.
    settings : dict
        Effective settings, every default included.
    inputs : dict
        Names of the files and what was found in them.
    warnings : tuple of str
        Said once each.
    events : tuple of EpochEvent
        Every decision, in time order.
    seconds : dict of str to float
        Wall time of read, compile, solve, write.
    """

    time_ns: np.ndarray
    status: np.ndarray
    reason: np.ndarray
    heading_rad: np.ndarray
    pitch_rad: np.ndarray
    roll_rad: np.ndarray
    cov_rad2: np.ndarray
    rot_ned_from_body: np.ndarray
    is_used: np.ndarray
    is_excluded: np.ndarray
    chi2: np.ndarray
    chi2_limit: np.ndarray
    success_probability: np.ndarray
    n_sats: np.ndarray
    position_ecef_m: np.ndarray
    antennas: tuple[str, ...]
    positions_body_m: np.ndarray
    level: str = "length"
    vectors: ArrayVectors | None = None
    residuals: PhaseResiduals | None = None
    filtered: FilteredAttitude | None = None
    reliability: AttitudeReliability | None = None
    baselines: tuple[BaselineSolution, ...] = ()
    settings: dict[str, Any] = field(default_factory=dict)
    inputs: dict[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    events: tuple[EpochEvent, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def n_antennas_used(self) -> np.ndarray:
        """Ndarray of int, shape (n,): antennas that took part."""
        return np.count_nonzero(self.is_used, axis=1)

    @property
    def excluded(self) -> np.ndarray:
        """Ndarray of str, shape (n,): names of the antennas left out, with ``+`` between them."""
        words = np.full(self.n_epochs, "", dtype=object)
        for row in np.flatnonzero(np.any(self.is_excluded, axis=1)):
            words[row] = "+".join(self.antennas[k] for k in np.flatnonzero(self.is_excluded[row]))
        return words.astype(str)

    @property
    def protection_rad(self) -> np.ndarray:
        """Ndarray of float64, shape (n, 3): protection levels of heading, pitch, roll; NaN without."""
        level = np.full((self.n_epochs, 3), np.nan)
        if self.reliability is not None and self.n_epochs:
            own = self.reliability
            at = np.minimum(np.searchsorted(self.time_ns, own.time_ns), self.n_epochs - 1)
            same = self.time_ns[at] == own.time_ns
            level[at[same]] = np.where(own.is_passed[:, None], own.protection_rad, np.inf)[same]
        return level

    def angle_sd_rad(self, k: int) -> np.ndarray:
        """Standard deviations of heading (0), pitch (1) or roll (2), ndarray, shape (n,)."""
        return np.sqrt(self.cov_rad2[:, k, k])

    def __str__(self) -> str:
        """One line: antennas, epochs, share accepted."""
        accepted = int(np.count_nonzero(self.is_accepted))
        return (
            f"attitude solution: {len(self.antennas)} antennas, {self.n_epochs} epochs, {accepted} accepted"
        )
