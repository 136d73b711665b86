"""Which signals reach the antenna, and how much weaker: horizon, masks, obstructions, outages."""

from __future__ import annotations

import msgspec
import numpy as np

from ..errors import ConfigError

__all__ = ["Visibility", "VisibilitySection"]


def _refuse(key, value, wanted):
    raise ConfigError(f"`{key}` is {value!r}; give {wanted}", key=key, value=value)


class VisibilitySection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The ``[visibility]`` table."""

    elevation_mask_deg: float = 0.0
    """Satellites below are not tracked."""

    def __post_init__(self) -> None:
        if not -90.0 <= self.elevation_mask_deg < 90.0:
            _refuse("elevation_mask_deg", self.elevation_mask_deg, "an angle from -90 to below 90")


class Visibility:
    """What stands between satellites and antennas along a trajectory.

    Parameters
    ----------
    section : VisibilitySection
        What to model.
    trajectory : truenorth.simulation.motion.Trajectory
        Where the platform is.
    seed : int
        Seed of the scenario.
    """

    def __init__(self, section, trajectory, seed):
        self.section = section
        self._trajectory = trajectory
        self._seed = seed

    def attenuation_db(self, time_s, sat, azimuth_rad, elevation_rad, azimuth_body_rad, elevation_body_rad):
        """Compute what the surroundings take from signals.

        Parameters
        ----------
        time_s : ndarray, shape (n,)
            Seconds since the start of the scenario.
        sat : ndarray of int, shape (n,)
            Satellites.
        azimuth_rad, elevation_rad : ndarray, shape (n,)
            Direction of the satellite from the platform, local level.
        azimuth_body_rad, elevation_body_rad : ndarray, shape (n,)
            The same in the body frame: clockwise from forward, and above the deck.

        Returns
        -------
        ndarray, shape (n,)
            Decibels; infinite where the signal is blocked.
        """
        blocked = np.asarray(elevation_rad) < np.radians(self.section.elevation_mask_deg)
        return np.where(blocked, np.inf, 0.0)
