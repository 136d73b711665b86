"""Bodies whose motion is known in closed form, for the tests of sensors."""

from dataclasses import dataclass

import numpy as np

from truenorth.frames import ecef_from_geodetic, rot_ned_from_ecef
from truenorth.rotations import body_rate_from_euler_rates, rot_ned_from_body
from truenorth.simulation.motion import Motion
from truenorth.simulation.randomness import stream

LATITUDE, LONGITUDE, HEIGHT = np.radians(51.1), np.radians(-114.15), 1100.0


def generators(seed=1):
    """Random generators by name, as the emulator hands them to sensors."""
    return lambda *names: stream(seed, *names)


@dataclass
class Body:
    """A body on a plane at a place; subclasses say how it moves (level frame, seconds)."""

    latitude: float = LATITUDE

    def angles(self, t):
        """Heading, pitch, roll and their rates."""
        zero = np.zeros_like(t)
        return zero, zero, zero, zero, zero, zero

    def way(self, t):
        """Position, velocity and acceleration: north, east, down."""
        zero = np.zeros((len(t), 3))
        return zero, zero, zero

    def at(self, time_s):
        t = np.asarray(time_s, dtype=float)
        heading, pitch, roll, heading_rate, pitch_rate, roll_rate = self.angles(t)
        place, velocity, acceleration = self.way(t)
        level = rot_ned_from_ecef(self.latitude, LONGITUDE)
        return Motion(
            time_s=t,
            position_ecef_m=ecef_from_geodetic(self.latitude, LONGITUDE, HEIGHT) + place @ level,
            velocity_ecef_mps=velocity @ level,
            acceleration_ecef_mps2=acceleration @ level,
            rot_ecef_from_body=level.T @ rot_ned_from_body(heading, pitch, roll),
            rate_body_radps=body_rate_from_euler_rates(pitch, roll, heading_rate, pitch_rate, roll_rate),
            heading_rad=np.mod(heading, 2.0 * np.pi),
            pitch_rad=pitch,
            roll_rad=roll,
        )


@dataclass
class Resting(Body):
    """At rest in a given attitude, degrees."""

    heading_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0

    def angles(self, t):
        zero = np.zeros_like(t)
        turned = (np.radians(deg) + zero for deg in (self.heading_deg, self.pitch_deg, self.roll_deg))
        return *turned, zero, zero, zero


@dataclass
class Wobbling(Body):
    """Turning, with swings in all three angles."""

    def angles(self, t):
        return (
            0.3 * t + 0.5 * np.sin(t), 0.2 * np.sin(1.3 * t), 0.15 * np.cos(0.9 * t),
            0.3 + 0.5 * np.cos(t), 0.26 * np.cos(1.3 * t), -0.135 * np.sin(0.9 * t),
        )  # fmt: skip


@dataclass
class Circling(Body):
    """A level circle, clockwise."""

    speed_mps: float = 10.0
    radius_m: float = 50.0

    def angles(self, t):
        zero, rate = np.zeros_like(t), self.speed_mps / self.radius_m
        return rate * t, zero, zero, zero + rate, zero, zero

    def way(self, t):
        rate = self.speed_mps / self.radius_m
        s, c, zero = np.sin(rate * t), np.cos(rate * t), np.zeros_like(t)
        return (
            self.radius_m * np.stack([s, -c, zero], axis=-1),
            self.speed_mps * np.stack([c, s, zero], axis=-1),
            self.speed_mps * rate * np.stack([-s, c, zero], axis=-1),
        )


@dataclass
class Rushing(Body):
    """Straight ahead with constant acceleration from a start at rest."""

    heading_deg: float = 90.0
    acceleration_mps2: float = 1.5

    def angles(self, t):
        zero = np.zeros_like(t)
        return np.radians(self.heading_deg) + zero, zero, zero, zero, zero, zero

    def way(self, t):
        ahead = np.array([np.cos(np.radians(self.heading_deg)), np.sin(np.radians(self.heading_deg)), 0.0])
        a, ones = self.acceleration_mps2, np.ones_like(t)
        return tuple(np.multiply.outer(f, ahead) for f in (0.5 * a * t**2, a * t, a * ones))
