"""What a filter of attitude is asked for, what it carries, and what it gives."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Literal, NoReturn

import msgspec
import numpy as np

from ..errors import ConfigError
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


class AttitudeFilterSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What `filter_attitude` does."""

    direction: Literal["forward", "backward", "smoother"] = "forward"
    """``forward`` knows the past, ``backward`` the future, ``smoother`` both."""
    process: Literal["continuous", "wang"] = "continuous"
    """``continuous``: noise of the rates per time, whatever the epochs' interval; ``wang``: the same step at
    every epoch, as printed by Wang and Lachapelle (2002), eq. 9."""
    rate_noise_dps2_per_s: tuple[float, float, float] = (40.0, 40.0, 40.0)
    """Variance that the rate about the forward, right and down axis gains in a second, (deg/s)^2/s. 40 is
    2 deg/s in every 0.1 s."""
    rate_step_dps: tuple[float, float, float] = (2.0, 2.0, 2.0)
    """With ``process = "wang"``: standard deviation that every epoch adds to the rates, deg/s."""
    initial_rate_sd_dps: float = 30.0
    """Of the rate, which is taken as zero at a start."""
    gate: bool = True
    """Test the innovations and leave out what fails."""
    significance: float = 0.001
    """Of the local test (two-sided: 3.29) and of the vector-wise one (16.3)."""
    power: float = 0.8
    """With which all tests find an error of the size that the local test finds (B-method)."""
    global_test: Literal["b_method", "significance"] = "b_method"
    """Limit of the global test: of equal power with the local one (Baarda 1968), or of equal significance."""
    max_passes: int = 4
    """Antennas that may be left out of one epoch before all of it is."""
    lock_out_epochs: int = 5
    """Epochs in a row, what was left of which does not hold all three axes, after which the filter counts
    as locked out."""
    recovery: Literal["restart", "inflate", "none"] = "restart"
    """After a lock-out: start anew by least squares, widen the covariance, or go on predicting."""
    max_prediction_s: float = 10.0
    """Longest time without an update; after it the filter starts anew."""
    max_sd_deg: float = 30.0
    """Attitudes less certain than this (root of the sum of the three variances) are not given out."""
    output_rate_hz: float | None = None
    """Give out attitudes at this rate, on whole multiples of its period in GPS time, instead of at the
    epochs of the vectors."""
    keep_predictions: bool = True
    """Keep what was predicted before every update, which `innovations` needs."""

    def __post_init__(self) -> None:
        def refuse(key: str, wanted: str) -> NoReturn:
            value = getattr(self, key)
            raise ConfigError(f"`{key}` is {value!r}; give {wanted}", key=key, value=value)

        for key in ("rate_noise_dps2_per_s", "rate_step_dps"):
            if not all(0.0 < value < math.inf for value in getattr(self, key)):
                refuse(key, "three positive numbers")
        for key in ("initial_rate_sd_dps", "max_prediction_s", "max_sd_deg"):
            if not 0.0 < getattr(self, key) < math.inf:
                refuse(key, "a positive number")
        if not 0.0 < self.significance < 1.0:
            refuse("significance", "a share between 0 and 1")
        if not self.significance < self.power < 1.0:
            refuse("power", "a share between `significance` and 1")
        for key in ("max_passes", "lock_out_epochs"):
            if getattr(self, key) < 1:
                refuse(key, "1 or more")
        if self.output_rate_hz is not None and not 0.0 < self.output_rate_hz <= 10_000.0:
            refuse("output_rate_hz", "a rate up to 10000 Hz, or leave it out")


@dataclass(slots=True, eq=False)
class FilterState:
    """All that the forward filter carries from one block of epochs to the next.

    Parameters
    ----------
    rot_ned_from_body : ndarray, shape (3, 3)
        Attitude.
    rate_body_radps : ndarray, shape (3,)
        Angular rate in body axes.
    cov : ndarray, shape (6, 6)
        Covariance of rotation error and rate error from noise alone, both in body axes.
    sensitivity : ndarray, shape (6, c)
        Error of the state by a metre of error of each body coordinate; c is 0 where they are exact.
    carried : ndarray of int64
        Counters and times, see `truenorth._kernels.attitude_filter`.
    pending : tuple
        Epochs that may help to start: time, white rows, observations.
    """

    rot_ned_from_body: np.ndarray
    rate_body_radps: np.ndarray
    cov: np.ndarray
    sensitivity: np.ndarray
    carried: np.ndarray
    pending: tuple[tuple[int, np.ndarray, np.ndarray], ...] = ()

    def copy(self) -> FilterState:
        """A state of its own, so that the next block does not change this one."""
        return FilterState(
            self.rot_ned_from_body.copy(),
            self.rate_body_radps.copy(),
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
