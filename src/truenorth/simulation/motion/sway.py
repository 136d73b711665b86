r"""A platform that stays where it is but is shaken: a vehicle with its engine on, a mast, a moored boat.

About a mean place and attitude, each of three angles and three displacements is a sum of oscillations, a slow
drift and moves at given instants,

.. math:: x(t) = \bar x + \dot x\,t + \sum_k o_k(t) + \sum_m h_m\,S((t - t_m)/T_m),

with the oscillations of `truenorth.simulation.motion.sea` and the smooth step

.. math:: S(u) = u^5\,(126 - 420 u + 540 u^2 - 315 u^3 + 70 u^4),

whose first four derivatives are zero at both ends. All have exact derivatives. The body turns about its
origin; a sensor beside it is shaken by its lever arm as well.
"""

from __future__ import annotations

import msgspec
import numpy as np

from ...frames import ecef_from_geodetic, rot_ned_from_ecef
from ..randomness import stream
from .drives import require_positive
from .kinematics import Attitude, Motion, motion_of, place_from_ecef
from .routes import Sinusoids
from .sea import Oscillation, wave_sinusoids

__all__ = ["Move", "SwayMotion", "SwayTrajectory"]

_ANGLES = ("yaw", "pitch", "roll")
_SHIFTS = ("surge", "sway", "heave")

_STEP = np.polynomial.Polynomial([0.0] * 5 + [126.0, -420.0, 540.0, -315.0, 70.0])
_STEPS = (_STEP, _STEP.deriv(), _STEP.deriv(2))


class Move(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A door is shut, someone climbs aboard, the platform is set down anew."""

    at_s: float
    """When it begins, seconds since the start."""
    duration_s: float
    """How long it takes, there and back if it is not lasting."""
    lasting: bool = True
    """Whether the platform stays as it is after the move, or comes back."""
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    surge_m: float = 0.0
    """Forward, along the mean heading."""
    sway_m: float = 0.0
    """To the right of the mean heading."""
    heave_m: float = 0.0
    """Up."""

    def __post_init__(self) -> None:
        require_positive(self, "duration_s")


class SwayMotion(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="sway"
):
    """A platform that is shaken, rocked and moved a little where it stands."""

    heading_deg: float = 0.0
    """Clockwise from true north, in the mean."""
    pitch_deg: float = 0.0
    """Nose up, in the mean."""
    roll_deg: float = 0.0
    """Right side down, in the mean."""
    heading_drift_deg_per_h: float = 0.0
    pitch_drift_deg_per_h: float = 0.0
    roll_drift_deg_per_h: float = 0.0
    """Slow tilting, as on soft ground or on springs that settle."""
    yaw: tuple[Oscillation, ...] = (Oscillation(amplitude=0.02, period_s=2.5, bandwidth=0.2),)
    pitch: tuple[Oscillation, ...] = (Oscillation(amplitude=0.05, period_s=0.9, bandwidth=0.2),)
    roll: tuple[Oscillation, ...] = (Oscillation(amplitude=0.1, period_s=1.3, bandwidth=0.2),)
    """Amplitudes in degrees; the oscillations of a list add up."""
    surge: tuple[Oscillation, ...] = (Oscillation(amplitude=0.002, period_s=0.9, bandwidth=0.2),)
    """Forward along the mean heading, metres."""
    sway: tuple[Oscillation, ...] = (Oscillation(amplitude=0.004, period_s=1.3, bandwidth=0.2),)
    """To the right of the mean heading, metres."""
    heave: tuple[Oscillation, ...] = (Oscillation(amplitude=0.001, period_s=0.7, bandwidth=0.2),)
    """Up, metres."""
    moves: tuple[Move, ...] = ()


class SwayTrajectory:
    """Motion of a shaken platform.

    Parameters
    ----------
    section : SwayMotion
        Settings.
    latitude_rad, longitude_rad, height_m : float
        The mean place, geodetic.
    seed : int
        Of the scenario; draws the phases of the oscillations.
    """

    def __init__(
        self, section: SwayMotion, latitude_rad: float, longitude_rad: float, height_m: float, seed: int
    ) -> None:
        self._section = section
        self._origin = ecef_from_geodetic(latitude_rad, longitude_rad, height_m)
        self._ned_from_ecef = rot_ned_from_ecef(latitude_rad, longitude_rad)
        self._sums: dict[str, list[Sinusoids]] = {}
        for component in (*_ANGLES, *_SHIFTS):
            unit = np.pi / 180.0 if component in _ANGLES else 1.0
            self._sums[component] = [
                wave_sinusoids(oscillation, unit, stream(seed, "motion", "sway", component, k))
                for k, oscillation in enumerate(getattr(section, component))
            ]

    def _component(self, name: str, time_s: np.ndarray) -> np.ndarray:
        """Value, first and second derivative of what is added to the mean, shape (3, n)."""
        total = np.zeros((3, len(time_s)))
        for shape in self._sums[name]:
            total += shape.derivatives(time_s)
        for move in self._section.moves:
            height = (
                np.radians(getattr(move, f"{name}_deg")) if name in _ANGLES else getattr(move, f"{name}_m")
            )
            if height == 0.0:
                continue
            # One that comes back goes in half of its time, and returns in the other half.
            length = move.duration_s if move.lasting else 0.5 * move.duration_s
            starts = [(move.at_s, 1.0)] if move.lasting else [(move.at_s, 1.0), (move.at_s + length, -1.0)]
            for start, sign in starts:
                share = np.clip((time_s - start) / length, 0.0, 1.0)
                for order, polynomial in enumerate(_STEPS):
                    total[order] += sign * height / length**order * polynomial(share)
        return total

    def at(self, time_s: np.ndarray) -> Motion:
        """State at instants, seconds since the start, shape (n,)."""
        time_s = np.atleast_1d(np.asarray(time_s, dtype=float))
        section = self._section
        means = (
            (section.heading_deg, section.heading_drift_deg_per_h),
            (section.pitch_deg, section.pitch_drift_deg_per_h),
            (section.roll_deg, section.roll_drift_deg_per_h),
        )
        angles = []
        for name, (mean, drift) in zip(_ANGLES, means, strict=True):
            value, rate, _ = self._component(name, time_s)
            slope = np.radians(drift) / 3600.0
            angles.append((value + np.radians(mean) + slope * time_s, rate + slope))
        surge, sway, heave = (self._component(name, time_s) for name in _SHIFTS)
        cosine, sine = np.cos(np.radians(section.heading_deg)), np.sin(np.radians(section.heading_deg))
        ned = np.stack((cosine * surge - sine * sway, sine * surge + cosine * sway, -heave), axis=-1)
        shift, velocity, acceleration = ned @ self._ned_from_ecef
        place = place_from_ecef(self._origin + shift, velocity, acceleration)
        return motion_of(time_s, place, Attitude.from_angles(angles[0], angles[1], angles[2]))

    def distance_m(self, time_s: np.ndarray) -> np.ndarray:
        """Distance along the route: none, whatever the platform does about its place."""
        return np.zeros(np.shape(np.atleast_1d(time_s)))

    def course_rad(self, time_s: np.ndarray) -> np.ndarray:
        """Direction of travel; of a platform that does not travel, its heading."""
        return self.at(time_s).heading_rad
