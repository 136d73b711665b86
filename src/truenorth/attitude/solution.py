"""The result of a run over two antennas: one baseline per epoch, with all that is known about it."""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import Reason, Status

__all__ = ["BaselineSolution", "EpochEvent", "SolutionOutputs"]


@dataclass(frozen=True, slots=True)
class EpochEvent:
    """One decision of the solver, for the log and for ``--explain``.

    Parameters
    ----------
    time_ns : int
        GPS time of the epoch, nanoseconds.
    kind : str
        ``slip``, ``outlier``, ``excluded``, ``fixed``, ``released``, ``test`` ...
    satellite, signal : str
        Names, empty where the event concerns no single signal.
    statistic, limit : float
        The number that decided and its limit; NaN where there is none.
    text : str
        One sentence.
    """

    time_ns: int
    kind: str
    satellite: str
    signal: str
    statistic: float
    limit: float
    text: str


class SolutionOutputs:
    """What every solution of epochs offers: counts, tables, files and figures."""

    __slots__ = ()

    time_ns: np.ndarray
    status: np.ndarray
    reason: np.ndarray

    @property
    def n_epochs(self) -> int:
        """int: Number of epochs."""
        return len(self.time_ns)

    @property
    def is_accepted(self) -> np.ndarray:
        """Ndarray of bool, shape (n,): epochs with validated integers (fixed or held)."""
        return (self.status == Status.FIXED) | (self.status == Status.HELD)

    def reason_counts(self) -> dict[Reason, int]:
        """Epochs by reason, as ``{Reason: count}`` in order of frequency."""
        codes, counts = np.unique(self.reason, return_counts=True)
        order = np.argsort(-counts, kind="stable")
        return {Reason(int(codes[k])): int(counts[k]) for k in order}

    def to_polars(self) -> Any:
        """Table of one row per epoch, see `truenorth.export.to_polars`."""
        from ..export import to_polars

        return to_polars(self)

    def to_xarray(self) -> Any:
        """Labelled arrays with units along ``time``, see `truenorth.export.to_xarray`."""
        from ..export import to_xarray

        return to_xarray(self)

    def summary(self) -> dict[str, Any]:
        """The run in a few numbers, see `truenorth.export.summarize_solution`."""
        from ..export import summarize_solution

        return summarize_solution(self)

    def write(self, path: str | os.PathLike[str], *, format: str | None = None) -> Path:
        """Write the result to a file; the suffix names the format, see `truenorth.export.write_solution`."""
        from ..export import write_solution

        return write_solution(self, path, format=format)

    def plot(self) -> Any:
        """One page of figures as a ``matplotlib.figure.Figure``, see `truenorth.report.figure_page`."""
        from ..report import figure_page

        return figure_page(self)


@dataclass(frozen=True, slots=True, eq=False)
class BaselineSolution(SolutionOutputs):
    """Baseline from the base to the rover antenna at every common epoch.

    Arrays have one row per epoch; angles are NaN where ``status`` is `Status.NONE`.

    Parameters
    ----------
    time_ns : ndarray of int64, shape (n,)
        GPS time of the epoch (the rover's time tag), nanoseconds.
    status, reason : ndarray of uint8, shape (n,)
        Codes of `truenorth.errors.Status` and `truenorth.errors.Reason`.
    baseline_ecef_m, baseline_enu_m : ndarray of float64, shape (n, 3)
        Base to rover, metres. The fixed baseline is adjusted with the known length when the length
        constrains the solution.
    cov_enu_m2 : ndarray of float64, shape (n, 3, 3)
        Its covariance.
    azimuth_rad, elevation_rad : ndarray of float64, shape (n,)
        Direction of the baseline; azimuth in [0, 2 pi).
    azimuth_sd_rad, elevation_sd_rad : ndarray of float64, shape (n,)
        Standard deviations.
    length_m, length_sd_m : ndarray of float64, shape (n,)
        Length measured without the declared one, and its standard deviation.
    n_sats, n_signals : ndarray of int16, shape (n,)
        Satellites and double-differenced phases used.
    pdop, hdop, vdop, azimuth_dop, elevation_dop : ndarray of float64, shape (n,)
        Of the double-difference geometry, unit undifferenced phase noise (Wang 2002, sec. 3.9).
    ratio : ndarray of float64, shape (n,)
        Objective of the second-best over the best candidate. Exact up to 3, or to the threshold of the
        ratio test; above, a lower bound. NaN where there is no candidate.
    success_probability : ndarray of float64, shape (n,)
        Posterior probability of the winning integers; of held ones that with which they were fixed.
    chi2, chi2_limit : ndarray of float64, shape (n,)
        Residual test of the winner and its limit.
    quality : ndarray of uint8, shape (n,)
        1 (integer) to 6 (single point), after Landfahrer 2009, table 5.1; 0 where no solution.
    position_ecef_m : ndarray of float64, shape (n, 3)
        Single-point position of the base antenna, metres.
    residual_epoch, residual_sat, residual_signal : ndarray, shape (m,)
        Epoch index, satellite and signal of each phase that took part, accepted epoch or not.
    residual_m : ndarray of float64, shape (m,)
        Single-difference phase residuals of the best candidate, metres; NaN where there is none.
        Those of epochs that are not accepted explain why.
    residual_elevation_rad, residual_azimuth_rad : ndarray of float64, shape (m,)
        Where that satellite stood.
    residual_integer_cyc : ndarray of float64, shape (m,)
        Double-difference integer of the row against its group's reference satellite (NaN for float).
    residual_is_reference : ndarray of bool, shape (m,)
        Rows of reference satellites.
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
    candidate_length_m, candidate_length_sd_m : ndarray of float64, shape (n,), or None
        Length of the best candidate and its standard deviation, accepted or not; NaN where there is
        none. What the length test saw.
    length_check : dict
        Declared against measured length, see `truenorth.attitude.length_check.compare_length`.
    """

    time_ns: np.ndarray
    status: np.ndarray
    reason: np.ndarray
    baseline_ecef_m: np.ndarray
    baseline_enu_m: np.ndarray
    cov_enu_m2: np.ndarray
    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray
    azimuth_sd_rad: np.ndarray
    elevation_sd_rad: np.ndarray
    length_m: np.ndarray
    length_sd_m: np.ndarray
    n_sats: np.ndarray
    n_signals: np.ndarray
    pdop: np.ndarray
    hdop: np.ndarray
    vdop: np.ndarray
    azimuth_dop: np.ndarray
    elevation_dop: np.ndarray
    ratio: np.ndarray
    success_probability: np.ndarray
    chi2: np.ndarray
    chi2_limit: np.ndarray
    quality: np.ndarray
    position_ecef_m: np.ndarray
    residual_epoch: np.ndarray
    residual_sat: np.ndarray
    residual_signal: np.ndarray
    residual_m: np.ndarray
    residual_elevation_rad: np.ndarray
    residual_azimuth_rad: np.ndarray
    residual_integer_cyc: np.ndarray
    residual_is_reference: np.ndarray
    settings: dict[str, Any] = field(default_factory=dict)
    inputs: dict[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    events: tuple[EpochEvent, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)
    candidate_length_m: np.ndarray | None = None
    candidate_length_sd_m: np.ndarray | None = None
    length_check: dict[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        """One line: epochs, share accepted."""
        accepted = int(np.count_nonzero(self.is_accepted))
        return f"baseline solution: {self.n_epochs} epochs, {accepted} accepted"
