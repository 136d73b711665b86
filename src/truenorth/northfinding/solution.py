r"""What a search for north returns: attitude, covariance, where the error comes from, and a verdict.

Errors are small rotations :math:`\varphi` in north, east, down,

.. math:: \hat C^n_b = \exp([\varphi])\, C^n_b,

so :math:`\varphi_d` is the error of the heading of a level body, positive clockwise. Covariances are those of
:math:`\varphi`; those of heading, pitch and roll are views of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..attitude.vectors import angle_covariance
from ..rotations import heading_pitch_roll
from .site import Site

__all__ = ["BudgetLine", "ErrorBudget", "NorthRun", "NorthSolution", "Verdict", "angle_deviations"]


def angle_deviations(rot_ned_from_body: np.ndarray, cov_ned_rad2: np.ndarray) -> np.ndarray:
    """Standard deviations of heading, pitch and roll.

    Parameters
    ----------
    rot_ned_from_body : ndarray, shape (..., 3, 3)
        Attitudes.
    cov_ned_rad2 : ndarray, shape (..., 3, 3)
        Covariances of their errors as small rotations in north, east, down.

    Returns
    -------
    ndarray, shape (..., 3)
        Radians.
    """
    angles = angle_covariance(np.asarray(rot_ned_from_body), np.asarray(cov_ned_rad2))
    return np.sqrt(np.maximum(np.diagonal(angles, axis1=-2, axis2=-1), 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class BudgetLine:
    """One source of error and what it does to the attitude.

    Parameters
    ----------
    source : str
        E.g. ``gyro bias``, ``angle random walk``, ``accelerometer bias``, ``latitude``.
    stated : str
        Its size as a person would say it, e.g. ``1 deg/h``.
    cov_ned_rad2 : ndarray, shape (3, 3)
        Covariance of the small rotation that it causes, radians squared.
    """

    source: str
    stated: str
    cov_ned_rad2: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class ErrorBudget:
    """All sources of error of one search for north; independent, so covariances add.

    Parameters
    ----------
    lines : tuple of BudgetLine
        The sources, largest effect on the heading first.
    rot_ned_from_body : ndarray, shape (3, 3)
        Attitude for which it holds.
    """

    lines: tuple[BudgetLine, ...]
    rot_ned_from_body: np.ndarray

    @property
    def cov_ned_rad2(self) -> np.ndarray:
        """ndarray, shape (3, 3): Sum of all sources."""
        return sum((line.cov_ned_rad2 for line in self.lines), np.zeros((3, 3)))

    def angle_sd_rad(self, line: BudgetLine | None = None) -> np.ndarray:
        """Standard deviations of heading, pitch and roll from one source, or from all, shape (3,)."""
        cov = self.cov_ned_rad2 if line is None else line.cov_ned_rad2
        return angle_deviations(self.rot_ned_from_body, cov)


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether the sensor can find north here in the time it has.

    Parameters
    ----------
    able : bool or None
        Whether the achievable sigma is below the demanded one; None where nobody stated the sensor's errors.
    sentence : str
        What a person is told: sigma, place, time, and what limits it.
    achievable_heading_sd_rad : float
        Predicted from the stated errors; infinite where nothing can be found.
    required_heading_sd_rad : float
        What was asked for.
    """

    able: bool | None
    sentence: str
    achievable_heading_sd_rad: float
    required_heading_sd_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class NorthRun:
    """The estimate as it grew, from all samples up to each instant.

    Parameters
    ----------
    time_s : ndarray, shape (k,)
        Seconds since the start of the record.
    angles_rad : ndarray, shape (k, 3)
        Heading, pitch and roll at that instant; NaN until there is an estimate.
    sd_rad : ndarray, shape (k, 3)
        Their standard deviations.
    """

    time_s: np.ndarray
    angles_rad: np.ndarray
    sd_rad: np.ndarray

    @classmethod
    def of_attitudes(
        cls, time_s: np.ndarray, rot_ned_from_body: np.ndarray, cov_ned_rad2: np.ndarray
    ) -> NorthRun:
        """Run of attitudes, shape (k, 3, 3), and the covariances of their errors in north, east, down."""
        angles_rad = np.stack(heading_pitch_roll(rot_ned_from_body), axis=-1)
        return cls(time_s, angles_rad, angle_deviations(rot_ned_from_body, cov_ned_rad2))


@dataclass(frozen=True, slots=True, eq=False)
class NorthSolution:
    """Attitude of a platform found without satellites.

    Parameters
    ----------
    method : str
        Name of the method.
    site : Site
        Where.
    time_s : float
        Instant to which the attitude belongs, seconds since the start of the record.
    duration_s : float
        Length of the data that went into it.
    rot_ned_from_body : ndarray, shape (3, 3)
        Attitude at that instant.
    cov_ned_rad2 : ndarray, shape (3, 3)
        Covariance of its error as a small rotation in north, east, down.
    measured : mapping of str to float
        What the data say of themselves: e.g. ``gravity_mps2``, ``earth_rate_dph``, ``residual_mps``,
        estimated biases; units in the names.
    run : NorthRun or None
        The estimate as it grew.
    budget : ErrorBudget or None
        Where the error comes from; None where the errors of the sensor are not stated.
    verdict : Verdict or None
        Whether the sensor can do it at all.
    notes : tuple of str
        Whole sentences a user should read, e.g. that sigma covers noise only.
    """

    method: str
    site: Site
    time_s: float
    duration_s: float
    rot_ned_from_body: np.ndarray
    cov_ned_rad2: np.ndarray
    measured: Mapping[str, float] = field(default_factory=dict)
    run: NorthRun | None = None
    budget: ErrorBudget | None = None
    verdict: Verdict | None = None
    notes: tuple[str, ...] = ()

    @property
    def angles_rad(self) -> np.ndarray:
        """ndarray, shape (3,): Heading in [0, 2 pi), pitch and roll."""
        return np.array(heading_pitch_roll(self.rot_ned_from_body))

    @property
    def heading_rad(self) -> float:
        """float: Clockwise from true north."""
        return float(self.angles_rad[0])

    @property
    def pitch_rad(self) -> float:
        """float: Nose up."""
        return float(self.angles_rad[1])

    @property
    def roll_rad(self) -> float:
        """float: Right side down."""
        return float(self.angles_rad[2])

    @property
    def angle_cov_rad2(self) -> np.ndarray:
        """ndarray, shape (3, 3): Covariance of heading, pitch and roll."""
        return angle_covariance(self.rot_ned_from_body[None], self.cov_ned_rad2[None])[0]

    @property
    def angle_sd_rad(self) -> np.ndarray:
        """ndarray, shape (3,): Standard deviations of heading, pitch and roll."""
        return np.sqrt(np.diag(self.angle_cov_rad2))
