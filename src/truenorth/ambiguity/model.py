"""What every integer method takes, and what every one gives back: one epoch of double differences.

    phase_m = wavelength_m * N + design @ b + e_phase,      e_phase ~ N(0, cov_phase_m2)
    code_m  =                code_design @ b + e_code,      e_code  ~ N(0, cov_code_m2)

One row is a satellite against the reference satellite of its group (system, band, tracking), so
the covariances hold the reference's noise in every pair of rows of a group. ``b`` points from the
base to the rover antenna; the design is given in local east, north, up. The modelled ranges, with
each receiver's own reception time, are already subtracted, so ``b`` is counted from the baseline
used there (zero for antennas on one platform).

References: Harvey 1998, eq. (3.13); Wang & Lachapelle 2002, eq. (2); Teunissen & Kleusberg 1998.
"""

from dataclasses import dataclass

import numpy as np

from ..errors import Reason, Status

__all__ = ["DoubleDifferences", "Resolution"]


@dataclass(frozen=True, slots=True, eq=False)
class DoubleDifferences:
    """One epoch of double differences; the common input of all integer methods.

    Parameters
    ----------
    phase_m : ndarray, shape (m,)
        Double-difference phases in metres, ambiguities inside.
    design : ndarray, shape (m, 3)
        Rows ``-(e_satellite - e_reference)`` in east, north, up; ``e`` points receiver to satellite.
    wavelength_m : ndarray, shape (m,)
        Carrier wavelengths.
    cov_phase_m2 : ndarray, shape (m, m)
        Covariance of ``phase_m``.
    code_m : ndarray, shape (k,)
        Double-difference pseudoranges; k may be 0.
    code_design : ndarray, shape (k, 3)
        Their design rows.
    cov_code_m2 : ndarray, shape (k, k)
        Their covariance.
    elevation_rad : ndarray, shape (m,), optional
        Elevation of each row's satellite, for methods that order satellites by height.
    group : ndarray of int, shape (m,), optional
        Group (reference satellite) of each row.
    length_m, length_sd_m : float
        Known antenna separation and its standard deviation; NaN where unknown.
    prior_baseline_enu_m : ndarray, shape (3,), optional
        A-priori baseline (from compass and tilt, or a previous epoch).
    cov_prior_m2 : ndarray, shape (3, 3), optional
        Its covariance.
    """

    phase_m: np.ndarray
    design: np.ndarray
    wavelength_m: np.ndarray
    cov_phase_m2: np.ndarray
    code_m: np.ndarray
    code_design: np.ndarray
    cov_code_m2: np.ndarray
    elevation_rad: np.ndarray | None = None
    group: np.ndarray | None = None
    length_m: float = np.nan
    length_sd_m: float = np.nan
    prior_baseline_enu_m: np.ndarray | None = None
    cov_prior_m2: np.ndarray | None = None

    @property
    def n_phases(self) -> int:
        """int: Number of double-difference phases m."""
        return len(self.phase_m)


@dataclass(frozen=True, slots=True, eq=False)
class Resolution:
    """What an integer method found; the common output of all of them.

    Parameters
    ----------
    status : Status
        `Status.FIXED` when accepted, `Status.FLOAT` when only a float baseline stands,
        `Status.NONE` otherwise.
    reason : Reason
        Why.
    integers_cyc : ndarray of int64, shape (c, m)
        Candidates, best first; c may be 0. A row left float (partial fixing) is marked in `is_fixed`.
    objective : ndarray, shape (c,)
        Weighted square sum that the method minimises, of each candidate.
    baseline_enu_m : ndarray, shape (c, 3)
        Baseline of each candidate, adjusted as the method prescribes.
    cov_baseline_m2 : ndarray, shape (3, 3)
        Covariance of the best one, given that its integers are right.
    float_baseline_enu_m : ndarray, shape (3,)
        Baseline before the integers were fixed; NaN where not estimable.
    is_fixed : ndarray of bool, shape (m,)
        Rows whose integers are fixed; all True except in partial fixing.
    ratio : float
        Second-best objective over the best; NaN with fewer than two candidates.
    success_probability : float
        Probability that the winner is right, as the method can state it; NaN where it cannot.
    chi2, chi2_limit : float
        Residual test of the winner; NaN where not computed.
    n_candidates : int
        Candidates that were evaluated, also those not kept.
    """

    status: Status
    reason: Reason
    integers_cyc: np.ndarray
    objective: np.ndarray
    baseline_enu_m: np.ndarray
    cov_baseline_m2: np.ndarray
    float_baseline_enu_m: np.ndarray
    is_fixed: np.ndarray
    ratio: float
    success_probability: float
    chi2: float
    chi2_limit: float
    n_candidates: int
