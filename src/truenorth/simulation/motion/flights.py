r"""An aircraft in coordinated turns and climbs.

At constant speed V over the ground a bank :math:`\phi` turns the course at :math:`g\tan\phi / V`. The banks
of a list of legs are joined smoothly; course and position are integrals of them.
"""

from __future__ import annotations

import msgspec
import numpy as np

from ...constants import STANDARD_GRAVITY_MPS2
from ...errors import ConfigError
from .drives import require_positive
from .kinematics import LocalPlane
from .laws import PAD_S, Law, SplineLaw, UniformLaw, uniform_spline
from .paths import SplinePath
from .routes import RouteTrajectory

__all__ = ["AircraftLeg", "AircraftMotion", "aircraft_trajectory"]


class AircraftLeg(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One part of a flight."""

    duration_s: float
    bank_deg: float = 0.0
    """Right wing down: a turn to the right."""
    climb_mps: float = 0.0
    """Rate of climb."""

    def __post_init__(self) -> None:
        require_positive(self, "duration_s")
        if not abs(self.bank_deg) <= 70.0:
            raise ConfigError(
                f"`bank_deg` is {self.bank_deg!r}; give -70 to 70", key="bank_deg", value=self.bank_deg
            )


class AircraftMotion(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="aircraft"
):
    """A flight of legs, repeated as long as the scenario lasts."""

    speed_mps: float = 60.0
    """Constant, over the ground."""
    heading_deg: float = 0.0
    """Course at the start."""
    legs: tuple[AircraftLeg, ...] = (
        AircraftLeg(duration_s=60.0),
        AircraftLeg(duration_s=41.0, bank_deg=25.0),
        AircraftLeg(duration_s=40.0, climb_mps=3.0),
        AircraftLeg(duration_s=27.0, bank_deg=-35.0),
        AircraftLeg(duration_s=40.0, climb_mps=-3.0),
        AircraftLeg(duration_s=83.0, bank_deg=25.0),
    )
    roll_time_s: float = 4.0
    """Duration of the roll from one bank to the next."""
    attack_deg: float = 2.0
    """Pitch above the path of flight."""

    def __post_init__(self) -> None:
        require_positive(self, "speed_mps", "roll_time_s")
        if not self.legs:
            raise ConfigError("`legs` is empty; give at least one", key="legs", value=self.legs)
        steepest = max(abs(leg.climb_mps) for leg in self.legs)
        if steepest > 0.5 * self.speed_mps:
            raise ConfigError(
                f"`climb_mps` is {steepest!r}; give at most half of `speed_mps`",
                key="climb_mps",
                value=steepest,
            )


class _ClimbProfile:
    """Height that is a law of time, at constant speed."""

    def __init__(self, law: Law, speed_mps: float) -> None:
        self._law, self._speed = law, speed_mps

    def derivatives(self, way_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Height and its first two derivatives by the way, each of shape (n,)."""
        height, climb, change, _ = self._law.derivatives(way_m / self._speed)
        return height, climb / self._speed, change / self._speed**2


def aircraft_trajectory(section: AircraftMotion, plane: LocalPlane, duration_s: float) -> RouteTrajectory:
    """Trajectory of an `AircraftMotion`.

    Parameters
    ----------
    section : AircraftMotion
        Settings.
    plane : LocalPlane
        Where the flight is drawn.
    duration_s : float
        How long the motion is needed.

    Returns
    -------
    RouteTrajectory
        The flight.
    """
    from scipy.interpolate import BSpline, make_interp_spline

    durations = np.array([leg.duration_s for leg in section.legs])
    times = 1 + int((duration_s + PAD_S) / np.sum(durations))
    legs = section.legs * times
    begin = np.concatenate([[0.0], np.cumsum([leg.duration_s for leg in legs])[:-1]])
    # The kernel's central 95 % are 2.8 steps wide.
    step = section.roll_time_s / 2.8
    controls = np.arange(-np.ceil(PAD_S / step) - 4.0, np.ceil((duration_s + PAD_S) / step) + 6.0) * step
    bank = np.radians([leg.bank_deg for leg in legs])
    held = bank[np.maximum(np.searchsorted(begin, controls, side="right") - 1, 0)]
    bank_spline = uniform_spline(controls[0], step, held)
    # Degree 5 on a tenth of the roll time: the course is integrated to 1e-9 rad.
    fine = np.arange(-PAD_S, duration_s + PAD_S, 0.1 * section.roll_time_s)
    rate = STANDARD_GRAVITY_MPS2 * np.tan(bank_spline(fine)) / section.speed_mps
    turn = make_interp_spline(fine, rate, k=5).antiderivative()
    course = np.radians(section.heading_deg) + turn(fine) - turn(0.0)
    velocity = make_interp_spline(
        fine, section.speed_mps * np.stack((np.sin(course), np.cos(course)), axis=-1), k=5
    )
    flown = velocity.antiderivative()
    by_way = BSpline(flown.t * section.speed_mps, flown.c - flown(0.0), flown.k)
    path = SplinePath(by_way, section.speed_mps * duration_s, False, section.speed_mps * (fine[1] - fine[0]))
    climb = SplineLaw.from_rates(
        begin,
        [leg.climb_mps for leg in legs],
        duration_s=duration_s,
        ramp_s=section.roll_time_s,
    )
    return RouteTrajectory(
        plane,
        path,
        UniformLaw(section.speed_mps),
        profile=_ClimbProfile(climb, section.speed_mps),
        coordinated=True,
        pitch_offset_rad=np.radians(section.attack_deg),
    )
