"""What a filter of attitude is asked for, what it carries, and what it gives."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from ..config import AttitudeFilterSettings
from .solution import EpochEvent

__all__ = ["AttitudeFilterSettings", "FilterState", "FilterStatus", "FilteredAttitude"]


class FilterStatus(IntEnum):
    """What the filter has at an epoch."""

    NONE = 0
    PREDICTED = 1
    UPDATED = 2

    @property
    def label(self) -> str:
        """str: The word used in files: ``none``, ``predicted`` or ``updated``."""
        return self.name.lower()


@dataclass(slots=True, eq=False)
class FilterState:
    """All that the forward filter carries from one block of epochs to the next.

    Parameters
    ----------
    pose : ndarray, shape (4, 3)
        Rotation from body to north, east, down, and in the last row the angular rate in body axes, rad/s.
    cov : ndarray, shape (6, 6)
        Covariance of rotation error and rate error from noise alone, both in body axes.
    sensitivity : ndarray, shape (6, c)
        Error of the state by a metre of error of each body coordinate; c is 0 where they are exact.
    carried : ndarray of int64
        Counters and times, see `truenorth._kernels.attitude_filter`.
    pending : tuple
        Epochs that may help to start: time, white rows, observations.
    """

    pose: np.ndarray
    cov: np.ndarray
    sensitivity: np.ndarray
    carried: np.ndarray
    pending: tuple[tuple[int, np.ndarray, np.ndarray], ...] = ()

    def copy(self) -> FilterState:
        """A state of its own, so that the next block does not change this one."""
        return FilterState(
            self.pose.copy(),
            self.cov.copy(),
            self.sensitivity.copy(),
            self.carried.copy(),
            self.pending,
        )


@dataclass(frozen=True, slots=True, eq=False)
class FilteredAttitude:
    """Attitude and rate at every output epoch, n epochs of m antennas; NaN where there is none.

    Parameters
    ----------
    time_ns : ndarray of int64, shape (n,)
        GPS time.
    status : ndarray of uint8, shape (n,)
        Codes of `FilterStatus`.
    rot_ned_from_body : ndarray, shape (n, 3, 3)
        Attitude.
    rate_body_radps : ndarray, shape (n, 3)
        Angular rate of the body against north, east, down, in body axes.
    cov : ndarray, shape (n, 6, 6)
        Covariance of the rotation error (rad) and the rate error (rad/s), both in body axes;
        ``R_true = R exp(skew(error))``. That of the body coordinates is in it.
    heading_rad, pitch_rad, roll_rad : ndarray, shape (n,)
        Angles.
    cov_rad2 : ndarray, shape (n, 3, 3)
        Covariance of heading, pitch, roll.
    chi2, chi2_limit : ndarray, shape (n,)
        Square of the innovation in the metric of its covariance, before anything was left out, and the
        limit of the global test. NaN where there was no measurement or the filter was started.
    dof : ndarray of int64, shape (n,)
        Observations that it has.
    local_statistic, vector_statistic : ndarray, shape (n,)
        Largest local (absolute, normal) and vector-wise (chi-square of three) statistic, before anything
        was left out.
    is_used, is_rejected : ndarray of bool, shape (n, m)
        Antennas that took part, the reference among them, and those that were left out.
    is_lock_out, is_start : ndarray of bool, shape (n,)
        Epochs at which the filter was found locked out, and at which it was started or widened.
    segment : ndarray of int64, shape (n,)
        Number of the stretch without a new start; -1 outside.
    events : tuple of EpochEvent
        Starts, rejections, lock-outs, gaps, in time order; `EpochEvent.signal` is the antenna.
    settings : AttitudeFilterSettings
        What was asked for.
    predicted_rot, predicted_rate, predicted_cov : ndarray or None
        Of the filter before the update, shapes as above.
    state : FilterState or None
        Of the forward filter after the last epoch, to go on from.
    """

    time_ns: np.ndarray
    status: np.ndarray
    rot_ned_from_body: np.ndarray
    rate_body_radps: np.ndarray
    cov: np.ndarray
    heading_rad: np.ndarray
    pitch_rad: np.ndarray
    roll_rad: np.ndarray
    cov_rad2: np.ndarray
    chi2: np.ndarray
    chi2_limit: np.ndarray
    dof: np.ndarray
    local_statistic: np.ndarray
    vector_statistic: np.ndarray
    is_used: np.ndarray
    is_rejected: np.ndarray
    is_lock_out: np.ndarray
    is_start: np.ndarray
    segment: np.ndarray
    events: tuple[EpochEvent, ...] = ()
    settings: AttitudeFilterSettings = field(default_factory=AttitudeFilterSettings)
    predicted_rot: np.ndarray | None = None
    predicted_rate: np.ndarray | None = None
    predicted_cov: np.ndarray | None = None
    state: FilterState | None = None

    @property
    def n_epochs(self) -> int:
        """int: Number of epochs."""
        return len(self.time_ns)

    @property
    def rate_ned_radps(self) -> np.ndarray:
        """Ndarray, shape (n, 3): angular rate in north, east, down."""
        return np.einsum("nij,nj->ni", self.rot_ned_from_body, self.rate_body_radps)

    @property
    def cov_ned_rad2(self) -> np.ndarray:
        """Ndarray, shape (n, 3, 3): covariance of the rotation error in north, east, down."""
        rot = self.rot_ned_from_body
        return rot @ self.cov[:, :3, :3] @ np.swapaxes(rot, 1, 2)
