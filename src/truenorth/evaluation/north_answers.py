"""Where a comparison of ways to find north takes place, and what one of them answered there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Answers", "Scene", "wrapped_deg"]

WRONG_SD = 5.0
"""An answer beyond so many of its own sigma is wrong."""


@dataclass(frozen=True, slots=True)
class Scene:
    """A level platform at rest, and how often north is sought there.

    Parameters
    ----------
    latitude_deg, longitude_deg, height_m : float
        Where, geodetic.
    heading_deg : float
        Where it points.
    runs : int
        Independent draws of every error.
    seed : int
        Of the first draw; the others follow.
    """

    latitude_deg: float
    longitude_deg: float
    height_m: float
    heading_deg: float
    runs: int
    seed: int


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """What one technique said in every run.

    Parameters
    ----------
    error_deg : ndarray, shape (runs,)
        Heading less the truth; NaN where no answer was given.
    sd_deg : ndarray, shape (runs,)
        Stated with it, degrees.
    is_wrong : ndarray of bool, shape (runs,)
        Integers that are not the true ones, or an error beyond five stated sigma.
    data_s : float
        Seconds of data that an answer takes; 0 for a single epoch.
    cpu_ms : float
        Processor time of a solution, milliseconds.
    """

    error_deg: np.ndarray
    sd_deg: np.ndarray
    is_wrong: np.ndarray
    data_s: float
    cpu_ms: float

    @classmethod
    def judged(cls, error_deg: np.ndarray, sd_deg: np.ndarray, data_s: float, cpu_ms: float) -> Answers:
        """Judge answers by the sigma that they state."""
        with np.errstate(invalid="ignore"):
            is_wrong = np.abs(error_deg) > WRONG_SD * sd_deg
        return cls(error_deg, sd_deg, is_wrong, data_s, cpu_ms)

    @property
    def is_given(self) -> np.ndarray:
        """Ndarray of bool, shape (runs,): Runs with an answer."""
        return np.isfinite(self.error_deg)

    @property
    def available(self) -> float:
        """float: Share of the runs with an answer."""
        return float(np.mean(self.is_given))

    @property
    def wrong(self) -> float:
        """float: Share of wrong ones among the answers; NaN without answers."""
        given = self.is_given
        return float(np.mean(self.is_wrong[given])) if given.any() else np.nan

    def rms_deg(self, *, right_only: bool = False) -> float:
        """Root mean square of the errors of all answers, or of those that are not wrong."""
        chosen = self._chosen(right_only)
        return float(np.sqrt(np.mean(self.error_deg[chosen] ** 2))) if chosen.any() else np.nan

    def nees(self, *, right_only: bool = False) -> float:
        """Mean square of the errors over their stated sigma, of all answers or of those not wrong."""
        chosen = self._chosen(right_only)
        return float(np.mean((self.error_deg[chosen] / self.sd_deg[chosen]) ** 2)) if chosen.any() else np.nan

    def _chosen(self, right_only: bool) -> np.ndarray:
        return self.is_given & ~self.is_wrong if right_only else self.is_given


def wrapped_deg(angle_deg: np.ndarray | float) -> np.ndarray | float:
    """Angles in [-180, 180)."""
    return np.mod(np.asarray(angle_deg) + 180.0, 360.0) - 180.0
