r"""Motion along a route: a path, a height profile, a time law, and how the body moves on top of it.

With the way s(t), the point p(s) and the height u(s), velocity and acceleration follow by the chain rule,
:math:`\ddot p = p''\dot s^2 + p'\ddot s`. Heading is that of the path (and so is held at a stop), pitch that
of the slope. To these the body adds what its springs do, in proportion to the acceleration along and
across, or banks so that the apparent vertical stays in its own plane of symmetry,

.. math:: \tan\phi = a_{across} / g,

and the unevenness of the road, as sums of sinusoids of the way (a standing vehicle does not shake), or the
waves, as sums of sinusoids of the time. All have exact derivatives.

References
----------
Gillespie, T. D., Fundamentals of Vehicle Dynamics (1992), ch. 5 and 6 (ride and body roll).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np

from ...constants import STANDARD_GRAVITY_MPS2
from ...errors import ConfigError
from .kinematics import Attitude, LocalPlane, Motion, motion_of
from .laws import Law
from .paths import CirclePath, FlatProfile, Path, Profile, SplinePath

__all__ = ["BodySection", "Component", "Disturbance", "RouteTrajectory", "Sinusoids", "road_unevenness"]

Component = Literal["heave", "roll", "pitch", "yaw"]

REFERENCE_SPEED_MPS = 50.0 / 3.6
"""Speed at which the unevenness of a road is stated."""


class BodySection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How the body of a vehicle moves on its wheels."""

    roll_deg_per_mps2: float = 0.5
    """Outward roll by lateral acceleration; 0.5 is a usual car (5 degrees at 1 g)."""
    pitch_deg_per_mps2: float = 0.25
    """Nose up by acceleration, and down by braking."""
    crossfall_deg: float = 0.0
    """Roll of the road itself, right side down."""
    unevenness_mps2: float = 0.0
    """Vertical acceleration from the road at 50 km/h, root mean square, between 0.7 and 10 Hz."""
    side_offset_deg: float = 0.0
    """Heading minus the course over the ground: how far the body frame is turned in the vehicle."""

    def __post_init__(self) -> None:
        if not self.unevenness_mps2 >= 0.0:
            raise ConfigError(
                f"`unevenness_mps2` is {self.unevenness_mps2!r}; give 0 or more",
                key="unevenness_mps2",
                value=self.unevenness_mps2,
            )


class Sinusoids:
    """A sum of sinusoids.

    Parameters
    ----------
    amplitude : ndarray, shape (k,)
        Amplitudes.
    rate : ndarray, shape (k,)
        Angular rates, radians by unit of the argument.
    phase_rad : ndarray, shape (k,)
        Phases at argument 0.
    """

    def __init__(self, amplitude: np.ndarray, rate: np.ndarray, phase_rad: np.ndarray) -> None:
        self.amplitude, self.rate, self.phase_rad = amplitude, rate, phase_rad

    def derivatives(self, argument: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sum and its first two derivatives, each of shape (n,)."""
        value, first, second = np.zeros((3, len(argument)))
        # One component after the other, so that memory stays that of the arguments.
        for amplitude, rate, phase in zip(self.amplitude, self.rate, self.phase_rad, strict=True):
            angle = rate * argument + phase
            sine = amplitude * np.sin(angle)
            value += sine
            first += amplitude * rate * np.cos(angle)
            second -= rate**2 * sine
        return value, first, second


@dataclass(frozen=True, slots=True)
class Disturbance:
    """What is added to one component of the motion.

    Parameters
    ----------
    component : {"heave", "roll", "pitch", "yaw"}
        Heave in metres up; angles in radians.
    by : {"time", "way"}
        What the sinusoids depend on.
    shape : Sinusoids
        The sum.
    """

    component: Component
    by: Literal["time", "way"]
    shape: Sinusoids


def road_unevenness(acceleration_rms_mps2: float, rng: np.random.Generator) -> tuple[Disturbance, ...]:
    """Heave, pitch and roll from an uneven road.

    Parameters
    ----------
    acceleration_rms_mps2 : float
        Vertical acceleration at 50 km/h, root mean square; spread evenly from 0.7 to 10 Hz at that speed.
    rng : numpy.random.Generator
        Frequencies and phases are drawn from it.

    Returns
    -------
    tuple of Disturbance
        The angles are the slopes between the wheels of a car (2.7 m apart along, 1.5 m across) that heave
        alike, independent of one another.
    """
    if acceleration_rms_mps2 == 0.0:
        return ()
    n = 20
    out = []
    gains: dict[Component, float] = {"heave": 1.0, "pitch": 2.0 / 2.7, "roll": 2.0 / 1.5}
    for component, gain in gains.items():
        hertz = np.linspace(0.7, 10.0, n + 1)
        rate = 2.0 * np.pi * rng.uniform(hertz[:-1], hertz[1:])
        amplitude = gain * acceleration_rms_mps2 * np.sqrt(2.0 / n) / rate**2
        phase = rng.uniform(0.0, 2.0 * np.pi, n)
        out.append(Disturbance(component, "way", Sinusoids(amplitude, rate / REFERENCE_SPEED_MPS, phase)))
    return tuple(out)


class RouteTrajectory:
    """A vehicle, ship or aircraft on its route.

    Parameters
    ----------
    plane : LocalPlane
        Where the route is drawn.
    path : Path
        The route.
    law : Law
        Way over time, metres.
    profile : Profile, optional
        Height by the way; level otherwise.
    body : BodySection, optional
        Springs and mounting; a stiff body otherwise.
    coordinated : bool
        Bank into turns, in place of rolling out of them.
    pitch_offset_rad : float
        Added to the pitch (the angle of attack of an aircraft).
    disturbances : tuple of Disturbance
        Unevenness or waves.
    origin_m : float
        Way from which distances count.
    """

    def __init__(
        self,
        plane: LocalPlane,
        path: Path,
        law: Law,
        *,
        profile: Profile | None = None,
        body: BodySection | None = None,
        coordinated: bool = False,
        pitch_offset_rad: float = 0.0,
        disturbances: tuple[Disturbance, ...] = (),
        origin_m: float = 0.0,
    ) -> None:
        self._plane, self._path, self._law = plane, path, law
        self._profile = FlatProfile() if profile is None else profile
        body = BodySection(roll_deg_per_mps2=0.0, pitch_deg_per_mps2=0.0) if body is None else body
        self._roll_gain = -np.radians(body.roll_deg_per_mps2)
        self._pitch_gain = np.radians(body.pitch_deg_per_mps2)
        self._roll_offset = np.radians(body.crossfall_deg)
        self._heading_offset = np.radians(body.side_offset_deg)
        self._coordinated = coordinated
        self._pitch_offset = pitch_offset_rad
        self._disturbances = disturbances
        self._origin_m = origin_m

    @property
    def lap_m(self) -> float | None:
        """Length of a lap of a closed route, else None."""
        if isinstance(self._path, CirclePath):
            return 2.0 * np.pi * abs(self._path.radius_m)
        return self._path.length_m if isinstance(self._path, SplinePath) and self._path.closed else None

    def at(self, time_s: np.ndarray) -> Motion:
        """State at instants, seconds since the start, shape (n,)."""
        time_s = np.atleast_1d(np.asarray(time_s, dtype=float))
        way, speed, along, jerk = self._law.derivatives(time_s)
        point, tangent, bend, bend1 = self._path.derivatives(way)
        height, slope, slope1 = self._profile.derivatives(way)

        up = [height, slope * speed, slope1 * speed**2 + slope * along]
        yaw = [np.full(len(way), self._heading_offset), np.zeros(len(way))]
        grade = slope1 * speed / (1.0 + slope**2)
        pitch = [
            np.arctan(slope) + self._pitch_gain * along + self._pitch_offset,
            grade + self._pitch_gain * jerk,
        ]
        # Acceleration across, positive to the right, and its derivative.
        curvature = bend[:, 0] * tangent[:, 1] - bend[:, 1] * tangent[:, 0]
        curvature1 = bend1[:, 0] * tangent[:, 1] - bend1[:, 1] * tangent[:, 0]
        across = curvature * speed**2
        across1 = curvature1 * speed**3 + 2.0 * curvature * speed * along
        if self._coordinated:
            lean = across / STANDARD_GRAVITY_MPS2
            roll = [np.arctan(lean), across1 / STANDARD_GRAVITY_MPS2 / (1.0 + lean**2)]
        else:
            roll = [self._roll_offset + self._roll_gain * across, self._roll_gain * across1]

        target = {"heave": up, "yaw": yaw, "pitch": pitch, "roll": roll}
        for disturbance in self._disturbances:
            by_way = disturbance.by == "way"
            value, first, second = disturbance.shape.derivatives(way if by_way else time_s)
            changes = (
                (value, first * speed, second * speed**2 + first * along)
                if by_way
                else (value, first, second)
            )
            parts = target[disturbance.component]
            for order, part in enumerate(parts):
                parts[order] = part + changes[order]

        place, course, course_rate = self._plane.place(
            (point, tangent * speed[:, None], bend * speed[:, None] ** 2 + tangent * along[:, None]),
            (up[0], up[1], up[2]),
            (tangent, bend * speed[:, None]),
        )
        heading = (course + yaw[0], course_rate + yaw[1])
        return motion_of(
            time_s, place, Attitude.from_angles(heading, (pitch[0], pitch[1]), (roll[0], roll[1]))
        )

    def distance_m(self, time_s: np.ndarray) -> np.ndarray:
        """Distance along the route since its start, on the map, shape (n,)."""
        return self._law.derivatives(np.atleast_1d(np.asarray(time_s, dtype=float)))[0] - self._origin_m

    def course_rad(self, time_s: np.ndarray) -> np.ndarray:
        """Direction of travel, clockwise from north in [0, 2 pi), shape (n,); held while at rest."""
        way = self.distance_m(time_s) + self._origin_m
        point, tangent, _, _ = self._path.derivatives(way)
        none = np.zeros_like(tangent)
        height = self._profile.derivatives(way)[0]
        flat = np.zeros(len(way))
        _, course, _ = self._plane.place((point, none, none), (height, flat, flat), (tangent, none))
        return np.mod(course, 2.0 * np.pi)
