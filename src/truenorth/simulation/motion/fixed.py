"""Platforms that stay where they are: at rest, or on a turntable."""

from __future__ import annotations

import msgspec
import numpy as np

from ...errors import ConfigError
from ...frames import ecef_from_geodetic, rot_ned_from_ecef
from ...rotations import rot_ned_from_body
from .kinematics import Attitude, Motion, Place, motion_of
from .laws import Law, SplineLaw, UniformLaw

__all__ = ["StaticMotion", "TurntableMotion", "TurntableTrajectory"]


class StaticMotion(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="static"
):
    """A platform at rest."""

    heading_deg: float = 0.0
    """Clockwise from true north."""
    pitch_deg: float = 0.0
    """Nose up."""
    roll_deg: float = 0.0
    """Right side down."""


class TurntableMotion(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="turntable"
):
    """A turntable under the origin of the body: constant rate, or a list of rates, about a tilted axis."""

    rate_dps: float = 10.0
    """Rate about the axis, clockwise seen from above, degrees per second."""
    heading_deg: float = 0.0
    """Heading at the start, on the level table."""
    tilt_deg: float = 0.0
    """Angle between the axis and the vertical."""
    tilt_azimuth_deg: float = 0.0
    """Where the upper end of the axis leans to, clockwise from north."""
    steps: tuple[tuple[float, float], ...] = ()
    """Pairs of an instant (s) and the rate (deg/s) from then on; in place of `rate_dps`."""
    ramp_s: float = 0.5
    """Duration of the change from one rate to the next."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.tilt_deg < 180.0:
            raise ConfigError(
                f"`tilt_deg` is {self.tilt_deg!r}; give 0 to below 180", key="tilt_deg", value=self.tilt_deg
            )
        if not self.ramp_s > 0.0:
            raise ConfigError(
                f"`ramp_s` is {self.ramp_s!r}; give a positive number", key="ramp_s", value=self.ramp_s
            )
        instants = [step[0] for step in self.steps]
        if instants != sorted(instants):
            raise ConfigError(
                f"`steps` is {self.steps!r}; give ascending instants", key="steps", value=self.steps
            )


class TurntableTrajectory:
    """Rotation about an axis that is fixed in the Earth; the origin of the body is on the axis.

    Parameters
    ----------
    latitude_rad, longitude_rad, height_m : float
        Where, geodetic.
    rot_ned_from_table : ndarray, shape (3, 3)
        Attitude of the table, whose third axis is the one it turns about.
    angle : Law
        Angle turned over time, radians.
    """

    def __init__(
        self,
        latitude_rad: float,
        longitude_rad: float,
        height_m: float,
        rot_ned_from_table: np.ndarray,
        angle: Law,
    ) -> None:
        self._position = ecef_from_geodetic(latitude_rad, longitude_rad, height_m)
        self._frame = rot_ned_from_ecef(latitude_rad, longitude_rad)
        self._table = rot_ned_from_table
        self._angle = angle

    @classmethod
    def build(
        cls,
        section: StaticMotion | TurntableMotion,
        latitude_rad: float,
        longitude_rad: float,
        height_m: float,
        duration_s: float,
    ) -> TurntableTrajectory:
        """Trajectory of a section."""
        heading = np.radians(section.heading_deg)
        if isinstance(section, StaticMotion):
            table = rot_ned_from_body(heading, np.radians(section.pitch_deg), np.radians(section.roll_deg))
            return cls(latitude_rad, longitude_rad, height_m, table, UniformLaw(0.0))
        # A lean to the azimuth is a rotation by the tilt about the horizontal axis to the right of it.
        lean = rot_ned_from_body(np.radians(section.tilt_azimuth_deg), 0.0, 0.0)
        tilt = lean @ rot_ned_from_body(0.0, -np.radians(section.tilt_deg), 0.0) @ lean.T
        table = tilt @ rot_ned_from_body(heading, 0.0, 0.0)
        angle: Law
        if section.steps:
            angle = SplineLaw.from_rates(
                [step[0] for step in section.steps],
                [np.radians(step[1]) for step in section.steps],
                duration_s=duration_s,
                ramp_s=section.ramp_s,
            )
        else:
            angle = UniformLaw(np.radians(section.rate_dps))
        return cls(latitude_rad, longitude_rad, height_m, table, angle)

    def at(self, time_s: np.ndarray) -> Motion:
        """State at instants, seconds since the start, shape (n,)."""
        time_s = np.atleast_1d(np.asarray(time_s, dtype=float))
        n = len(time_s)
        angle, rate = self._angle.derivatives(time_s)[:2]
        zero = np.zeros((n, 3))
        place = Place(
            np.tile(self._position, (n, 1)), zero, zero.copy(), np.tile(self._frame, (n, 1, 1)), zero.copy()
        )
        turn = rot_ned_from_body(angle, 0.0, 0.0)
        rate_body = np.stack((zero[:, 0], zero[:, 0], rate), axis=-1)
        return motion_of(time_s, place, Attitude(self._table @ turn, rate_body))

    def distance_m(self, time_s: np.ndarray) -> np.ndarray:
        """Distance along the route: none."""
        return np.zeros(np.shape(np.atleast_1d(time_s)))

    def course_rad(self, time_s: np.ndarray) -> np.ndarray:
        """Direction of travel; of a platform that does not travel, its heading."""
        return self.at(time_s).heading_rad
