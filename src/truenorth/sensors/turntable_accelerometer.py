r"""Vertical accelerometer on a turntable, which feels the north from the Coriolis acceleration.

An accelerometer sits at the radius rho of a table that turns with Omega counter-clockwise as seen from
above, its axis u along the table's. With the angle alpha = Omega t + mark from the body's forward axis,
counter-clockwise, the body's inertial rate w and the specific force f0 at the table's centre::

    r = rho (cos alpha, sin alpha) in the table,
    f = u . (f0 + r'' + 2 w x r' + w x (w x r))

On a level table at the heading psi it is, with w_N = W cos(latitude) and psi_ccw = mark - psi (Oguz 2006,
eq. 5.6 to 5.12)::

    f = g + 2 Omega w_N rho cos(Omega t + psi_ccw) + smaller terms

A tilted table turns the horizontal part of the Earth rate in its plane: the azimuth is wrong by about
atan(tilt tan(latitude) cos(axis)) (eq. 5.20); the simulation has the exact geometry instead. What the
log says of north is `truenorth.northfinding.turntable`'s.

Defaults are those of the source: 600 revolutions a minute, 5 cm, noise 1e-5 m/s^2; 500 samples in a
revolution, as its scatter suggests. Angular acceleration of the body is left out: the method is for a
platform at rest.

References
----------
P. Oguz, Implementation of Northfinding Techniques, M.Sc. thesis, Middle East Technical University (2006),
ch. 5.
"""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from ..frames import geodetic_from_ecef
from ..gravity import EARTH_RATE_RADPS
from ..rotations import rot_ned_from_body
from ..sensor_log import SensorLog
from ..strapdown import rate_inertial_body_radps, specific_force_body_mps2
from ..timescales import NS_PER_S
from .checks import require, require_not_negative, require_positive
from .kinematics import Mover
from .processes import gauss_markov
from .sampling import GeneratorByName, blocks

__all__ = [
    "TurntableAccelerometerDescription",
    "Vibration",
    "coriolis_amplitude_mps2",
    "simulate_turntable_accelerometer",
]


class Vibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A ``[[sensors.turntable_accelerometer.vibrations]]`` table: a sine along the axis."""

    frequency_hz: float
    amplitude_mps2: float
    phase_deg: float = 0.0

    def __post_init__(self) -> None:
        require_positive(self, "frequency_hz")
        require_not_negative(self, "amplitude_mps2")


class TurntableAccelerometerDescription(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True
):
    """The ``[sensors.turntable_accelerometer]`` table."""

    radius_m: float = 0.05
    table_rpm: float = 600.0
    """Speed of the table, revolutions a minute, counter-clockwise from above; negative turns clockwise."""
    samples_per_revolution: int = 500
    start_s: float = 0.0
    """When the first revolution begins, seconds since the start."""
    revolutions: int = 10
    mark_deg: float = 0.0
    """Where the accelerometer is at angle zero of the table: from forward, counter-clockwise."""
    noise_mps2: float = 1e-5
    """White noise of a sample, one sigma."""
    bias_mps2: float = 0.0
    tilt_pitch_deg: float = 0.0
    """Tilt of the table in the body: its front higher."""
    tilt_roll_deg: float = 0.0
    """Tilt of the table in the body: its right side lower."""
    axis_error_mrad: tuple[float, float] = (0.0, 0.0)
    """The sensitive axis leans outwards along the radius, and along the motion of a table that turns
    counter-clockwise."""
    speed_jitter: float = 0.0
    """Share by which the speed wanders, one sigma."""
    speed_jitter_time_constant_s: float = 0.05
    angle_noise_deg: float = 0.0
    """White noise of the encoder that reads the table's angle."""
    vibrations: tuple[Vibration, ...] = ()

    def __post_init__(self) -> None:
        require_positive(self, "radius_m", "samples_per_revolution", "revolutions")
        require(self, "table_rpm", test=lambda rpm: rpm != 0.0, wanted="a speed that is not zero")
        require_not_negative(
            self, "start_s", "noise_mps2", "speed_jitter", "speed_jitter_time_constant_s", "angle_noise_deg"
        )
        require(
            self,
            "tilt_pitch_deg",
            "tilt_roll_deg",
            test=lambda deg: abs(deg) < 90.0,
            wanted="an angle below 90",
        )
        require(
            self, "mark_deg", "bias_mps2", "axis_error_mrad", test=lambda _: True, wanted="finite numbers"
        )

    @property
    def table_rate_radps(self) -> float:
        """float: Speed of the table, rad/s, counter-clockwise positive."""
        return self.table_rpm * 2.0 * np.pi / 60.0


def simulate_turntable_accelerometer(
    sensor: TurntableAccelerometerDescription,
    mover: Mover,
    *,
    start_ns: int,
    duration_s: float,
    generator: GeneratorByName,
) -> SensorLog:
    """Accelerations of whole revolutions, as many as were asked for and fit into the record.

    Parameters
    ----------
    sensor : TurntableAccelerometerDescription
        The device.
    mover : object with ``at(time_s)``
        Motion of the body that carries it; meant to be at rest.
    start_ns : int
        GPS time of the start, nanoseconds.
    duration_s : float
        Length of the record, seconds.
    generator : callable
        Random generators by name.

    Returns
    -------
    SensorLog
        Columns ``acceleration_mps2`` and ``table_angle_rad`` (encoder, from the mark counter-clockwise,
        growing or falling over the revolutions); truth ``time_ns``, ``heading_rad``, ``table_angle_rad``,
        ``signal_mps2`` (without noise, bias and vibration), ``coriolis_mps2`` (the textbook term),
        ``vibration_mps2``, ``noise_mps2``.
    """
    rate, per_turn = sensor.table_rate_radps, sensor.samples_per_revolution
    step_s = 2.0 * np.pi / abs(rate) / per_turn
    turns = min(sensor.revolutions, int((duration_s - sensor.start_s) / (per_turn * step_s) + 1e-9))
    n = max(0, turns) * per_turn
    time_s = sensor.start_s + np.arange(n) * step_s
    jitter = gauss_markov(
        generator("jitter"), n, step_s, sensor.speed_jitter, sensor.speed_jitter_time_constant_s
    )
    speed = rate * (1.0 + jitter)
    # The table turns by the mean of the speeds at both ends of a step, and accelerates by their difference.
    turned = np.cumsum(0.5 * (speed[1:] + speed[:-1]) * step_s)
    angle = np.concatenate([np.zeros(min(n, 1)), turned])
    acceleration = np.gradient(speed, step_s) if n > 1 else np.zeros(n)

    tilt = rot_ned_from_body(0.0, np.radians(sensor.tilt_pitch_deg), np.radians(sensor.tilt_roll_deg))
    signal, coriolis, heading = np.empty(n), np.empty(n), np.empty(n)
    for rows in blocks(n):
        motion = mover.at(time_s[rows])
        alpha = angle[rows] + np.radians(sensor.mark_deg)
        # Counter-clockwise from above is from forward to the left.
        radial = np.stack([np.cos(alpha), -np.sin(alpha), np.zeros(len(alpha))], axis=-1) @ tilt.T
        along = np.stack([-np.sin(alpha), -np.cos(alpha), np.zeros(len(alpha))], axis=-1) @ tilt.T
        lean_out, lean_along = 1e-3 * np.array(sensor.axis_error_mrad)
        axis = -tilt[:, 2] + lean_out * radial + lean_along * along
        axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
        place = sensor.radius_m * radial
        velocity = sensor.radius_m * speed[rows, None] * along
        inner = sensor.radius_m * (acceleration[rows, None] * along - speed[rows, None] ** 2 * radial)
        w = rate_inertial_body_radps(motion)
        force = specific_force_body_mps2(motion) + inner
        force += 2.0 * np.cross(w, velocity) + np.cross(w, np.cross(w, place))
        signal[rows] = np.einsum("ni,ni->n", axis, force)
        north = _north_rate(motion)
        coriolis[rows] = 2.0 * rate * sensor.radius_m * north * np.cos(alpha - motion.heading_rad)
        heading[rows] = motion.heading_rad
    vibration = np.zeros(n)
    for wave in sensor.vibrations:
        phase = 2.0 * np.pi * wave.frequency_hz * time_s + np.radians(wave.phase_deg)
        vibration += wave.amplitude_mps2 * np.sin(phase)
    noise = sensor.noise_mps2 * generator("noise").standard_normal(n)
    read = angle + np.radians(sensor.angle_noise_deg) * generator("encoder").standard_normal(n)
    time_ns = start_ns + np.rint(time_s * NS_PER_S).astype(np.int64)
    return SensorLog(
        kind="turntable_accelerometer",
        time_ns=time_ns,
        columns={
            "acceleration_mps2": signal + sensor.bias_mps2 + vibration + noise,
            "table_angle_rad": read,
        },
        meta={
            "radius_m": sensor.radius_m,
            "table_rate_radps": rate,
            "samples_per_revolution": float(per_turn),
            "mark_deg": sensor.mark_deg,
        },
        truth={
            "time_ns": time_ns,
            "heading_rad": heading,
            "table_angle_rad": angle,
            "signal_mps2": signal,
            "coriolis_mps2": coriolis,
            "vibration_mps2": vibration,
            "noise_mps2": noise,
        },
    )


def coriolis_amplitude_mps2(sensor: TurntableAccelerometerDescription, latitude_rad: float) -> float:
    """Amplitude ``2 Omega W cos(latitude) rho`` of the signal on a level table (Oguz 5.12), m/s^2."""
    return float(2.0 * sensor.table_rate_radps * EARTH_RATE_RADPS * np.cos(latitude_rad) * sensor.radius_m)


def _north_rate(motion: Any) -> np.ndarray:
    """Horizontal Earth rate at the places of a motion, rad/s."""
    return EARTH_RATE_RADPS * np.cos(geodetic_from_ecef(motion.position_ecef_m)[0])
