r"""Error model of a platform at rest: attitude, velocity, displacement, biases of gyros and accelerometers.

Between the edges k and k+1 of an interval of length T the strapdown runs in an inertial frame that coincides
with north, east, down at edge k. With :math:`E = \exp([\omega T])` for the Earth rate, the increments
:math:`\Delta\theta, \Delta v, \Delta s` of `truenorth.strapdown` and gravity g, which turns with the Earth,

.. math::
    C_{k+1} &= E^T C_k \exp([\Delta\theta])\\
    E\,u_{k+1} &= u_k + C_k\Delta v + \textstyle\int g\\
    E\,r_{k+1} &= r_k + T u_k + C_k\Delta s + \textstyle\iint g

of the displacement r from the place where the platform stood and of :math:`u = v + \omega\times r`. The
errors :math:`\hat C = \exp([\varphi])C,\ \delta u,\ \delta r` and those of the sensors obey, to first order,

.. math::
    E\,\varphi_{k+1} &= \varphi_k + C_k\,(T\bar V b + \text{noise})\\
    E\,\delta u_{k+1} &= \delta u_k + \varphi_k\times f_0 T
        + C_k b \times f_0 T^2/2 + T C_k\bar V a + \dots\\
    E\,\delta r_{k+1} &= \delta r_k + T\delta u_k + \varphi_k\times f_0 T^2/2 + \dots

with the rate error b, the force error a, and :math:`\bar V` the mean rotation within the interval. The
force in these derivatives is :math:`f_0 = (0, 0, -g)`, that of rest, and not the one felt: otherwise the
shaking, which is not known to be what is felt, would seem to tell the heading.

The error of each axis is a constant (turn-on bias and all that acts like one at a fixed attitude),
Gauss-Markov processes in the ratio of 10 for the bias instability (those shorter than the intervals are
white, those much longer than the record constant), and a random walk. Where the body turns, the scale errors
and misalignments are states of their own.

References
----------
Groves, P. D., Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed. (2013),
ch. 4, sec. 5.6.3 and 14.2.
Savage, P. G., Strapdown Analytics, 2nd ed. (2007), ch. 12 (error dynamics).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..constants import DPH_RADPS, STANDARD_GRAVITY_MPS2, UG_MPS2
from ..rotations import exp_so3, skew
from ..sensors.imu import ImuDescription
from ..sensors.processes import flicker_components
from ..strapdown import InertialIncrements
from .site import Site

__all__ = ["ErrorModel", "Nominal", "Source", "earth_turn", "mean_rotation"]

N_CORE = 9
"""Attitude, velocity, displacement."""

HEADING_SD_RAD = 10.0
"""Nothing is known of the heading before."""
TILT_SD_RAD = 0.3
"""The start levels the platform better than this."""
START_VELOCITY_SD_MPS = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """One source of error in the terms of the filter.

    Parameters
    ----------
    name, stated : str
        As in a budget.
    start_var : ndarray, shape (n,)
        What it adds to the variance of each state at the start.
    process_var : ndarray, shape (n,)
        What it adds to that of each state beyond the core in an interval.
    core : ndarray, shape (9, 9), or None
        What it adds to the covariance of attitude, velocity and displacement in an interval.
    """

    name: str
    stated: str
    start_var: np.ndarray
    process_var: np.ndarray
    core: np.ndarray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Nominal:
    """The trajectory about which the errors are small.

    Parameters
    ----------
    rot_ned_from_body : ndarray, shape (n + 1, 3, 3)
        Attitude at the edges.
    displacement_m : ndarray, shape (n + 1, 3)
        Displacement that follows from it without any correction, north, east, down.
    gyro_bias_radps, accel_bias_mps2 : ndarray, shape (3,)
        What was taken off the increments, body axes.
    """

    rot_ned_from_body: np.ndarray
    displacement_m: np.ndarray
    gyro_bias_radps: np.ndarray
    accel_bias_mps2: np.ndarray


def earth_turn(site: Site, interval_s: float) -> np.ndarray:
    """Turn of north, east, down against inertial space over an interval, shape (3, 3)."""
    return exp_so3(interval_s * site.earth_rate_ned_radps)


def mean_rotation(angle_rad: np.ndarray) -> np.ndarray:
    r"""Mean of ``exp([s v])`` over s from 0 to 1 (the left Jacobian), shape (..., 3, 3)."""
    size = np.sqrt(np.sum(angle_rad**2, axis=-1))[..., None, None]
    cross = skew(angle_rad)
    first = 0.5 * np.sinc(0.5 * size / np.pi) ** 2
    # (x - sin x) / x^3 cancels below 1e-2, where its series is exact to rounding.
    safe = np.maximum(size, 1e-2)
    second = np.where(size < 1e-2, (1.0 - size**2 / 20.0) / 6.0, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + first * cross + second * (cross @ cross)


class ErrorModel:
    """States, their transition and their noises.

    Parameters
    ----------
    blocks : InertialIncrements
        The record in even intervals.
    site : Site
        Where.
    errors : ImuDescription
        Of the sensor.
    gravity_sd_mps2 : float
        How far gravity may be off the normal one.
    turned : bool
        Whether the body turns, so that the matrices of the sensors are states.
    level_from_body : ndarray, shape (3, 3)
        Attitude at the start (any heading), for what acts like a bias at a fixed attitude.
    """

    def __init__(
        self,
        blocks: InertialIncrements,
        site: Site,
        errors: ImuDescription,
        *,
        gravity_sd_mps2: float,
        turned: bool,
        level_from_body: np.ndarray,
    ) -> None:
        self.blocks, self.site, self.errors, self.turned = blocks, site, errors, turned
        self.interval_s = float(np.mean(np.diff(blocks.time_s)))
        self.duration_s = float(blocks.time_s[-1] - blocks.time_s[0])
        self._gravity_sd = gravity_sd_mps2
        self._level = level_from_body
        # Of the flicker's components each pair makes one state.
        self.gyro_flicker = _components(
            DPH_RADPS * errors.gyro_bias_instability_dph, self.interval_s, self.duration_s
        )
        self.accel_flicker = _components(
            UG_MPS2 * errors.accel_bias_instability_ug, self.interval_s, self.duration_s
        )
        self._layout()

    def _layout(self) -> None:
        """Where each state is."""
        at = N_CORE
        self.slices: dict[str, slice] = {
            "attitude": slice(0, 3),
            "velocity": slice(3, 6),
            "displacement": slice(6, 9),
        }

        def add(name: str, count: int) -> None:
            nonlocal at
            if count:
                self.slices[name] = slice(at, at + count)
                at += count

        add("gyro bias", 3)
        add("accelerometer bias", 3)
        add("gyro drift", 3 * len(self.gyro_flicker.time_s))
        add("accelerometer drift", 3 * len(self.accel_flicker.time_s))
        add("gravity", 1)
        add("latitude", int(self.site.latitude_sd_rad > 0.0))
        add("gyro matrix", 9 * int(self.turned))
        add("accelerometer matrix", 9 * int(self.turned))
        self.n = at

    def _summing(self, sensor: str) -> np.ndarray:
        """What of the states adds up to the error of each axis, shape (3, n)."""
        matrix = np.zeros((3, self.n))
        matrix[:, self.slices[f"{sensor} bias"]] = np.eye(3)
        drift = self.slices.get(f"{sensor} drift")
        if drift is not None:
            matrix[:, drift] = np.tile(np.eye(3), (drift.stop - drift.start) // 3)
        return matrix

    @cached_property
    def gyro_sum(self) -> np.ndarray:
        """ndarray, shape (3, n): Sums up the error of the gyros, body axes."""
        return self._summing("gyro")

    @cached_property
    def accel_sum(self) -> np.ndarray:
        """ndarray, shape (3, n): Sums up the error of the accelerometers, body axes."""
        return self._summing("accelerometer")

    @cached_property
    def decay(self) -> np.ndarray:
        """ndarray, shape (n - 9,): What is left after an interval of each state beyond the core."""
        decay = np.ones(self.n)
        for sensor, flicker in (("gyro", self.gyro_flicker), ("accelerometer", self.accel_flicker)):
            place = self.slices.get(f"{sensor} drift")
            if place is not None:
                decay[place] = np.repeat(np.exp(-self.interval_s / flicker.time_s), 3)
        return decay[N_CORE:]

    @cached_property
    def core(self) -> np.ndarray:
        """ndarray, shape (9, 9): Transition of attitude, velocity and displacement over an interval."""
        t = self.interval_s
        push = skew(self.site.force_ned_mps2)
        core = np.eye(N_CORE)
        core[3:6, 0:3] = -t * push
        core[6:9, 0:3] = -0.5 * t**2 * push
        core[6:9, 3:6] = t * np.eye(3)
        return np.kron(np.eye(3), earth_turn(self.site, t).T) @ core

    def drive(self, nominal: Nominal) -> np.ndarray:
        """How the other states drive the core over each interval, shape (intervals, 9, n - 9)."""
        t, blocks = self.interval_s, self.blocks
        rot = nominal.rot_ned_from_body[:-1]
        middle = rot @ exp_so3(0.5 * blocks.angle_rad)
        number = len(rot)
        force = self.site.force_ned_mps2
        push = skew(force)
        by_rate = np.empty((number, N_CORE, 3))
        by_rate[:, 0:3] = t * (rot @ mean_rotation(blocks.angle_rad))
        by_rate[:, 3:6] = -0.5 * t * push @ by_rate[:, 0:3]
        by_rate[:, 6:9] = -(t**2) / 6.0 * push @ by_rate[:, 0:3]
        by_force = np.zeros((number, N_CORE, 3))
        by_force[:, 3:6] = by_rate[:, 0:3]
        by_force[:, 6:9] = 0.5 * t**2 * (rot @ exp_so3(blocks.angle_rad / 3.0))
        drive = by_rate @ self.gyro_sum + by_force @ self.accel_sum
        # Gravity that is taken for too large is felt as a force upwards that is not there.
        drive[:, 5, self.slices["gravity"]] = t
        drive[:, 8, self.slices["gravity"]] = 0.5 * t**2
        if "latitude" in self.slices:
            rate = np.linalg.norm(self.site.earth_rate_ned_radps)
            latitude = self.site.latitude_rad
            slope = -rate * np.array([np.sin(latitude), 0.0, np.cos(latitude)])
            for row, factor in ((0, t * np.eye(3)), (3, -0.5 * t**2 * push), (6, -(t**3) / 6.0 * push)):
                drive[:, row : row + 3, self.slices["latitude"]] = -(factor @ slope)[:, None]
        if self.turned:
            # A matrix M acts on what is sensed: M w = (w_1 e_i, w_2 e_i, w_3 e_i) by rows i; the unit's axes.
            mount = self.errors.rot_body_from_imu
            axes = middle @ mount
            turned = blocks.angle_rad @ mount
            at_rest = t * force @ axes
            for name, sensed, where in (
                ("gyro matrix", turned, ((0, np.eye(3)), (3, -0.5 * t * push), (6, -(t**2) / 6.0 * push))),
                ("accelerometer matrix", at_rest, ((3, np.eye(3)), (6, 0.5 * t * np.eye(3)))),
            ):
                columns = (axes[:, :, :, None] * sensed[:, None, None, :]).reshape(number, 3, 9)
                for row, factor in where:
                    drive[:, row : row + 3, self.slices[name]] = factor @ columns
        turn = np.kron(np.eye(3), earth_turn(self.site, t).T)
        return turn @ drive[:, :, N_CORE:]

    @cached_property
    def sources(self) -> tuple[Source, ...]:
        """Tuple of Source: Every source of error but the shaking."""
        return tuple(_sources(self))

    @cached_property
    def start_cov(self) -> np.ndarray:
        """ndarray, shape (n, n): Covariance of the states at the start."""
        return np.diag(sum((source.start_var for source in self.sources), np.zeros(self.n)))

    @cached_property
    def process_cov(self) -> tuple[np.ndarray, np.ndarray]:
        """Tuple of ndarray: What an interval adds to the core, shape (9, 9), and to the others, (n - 9,)."""
        core = sum((s.core for s in self.sources if s.core is not None), np.zeros((N_CORE, N_CORE)))
        return core, sum((source.process_var for source in self.sources), np.zeros(self.n - N_CORE))

    def nominal(
        self,
        rot_ned_from_body: np.ndarray,
        time_index: int,
        gyro_bias_radps: np.ndarray,
        accel_bias_mps2: np.ndarray,
    ) -> Nominal:
        """Trajectory through an attitude at one edge, the biases taken off the increments.

        Parameters
        ----------
        rot_ned_from_body : ndarray, shape (3, 3)
            Attitude at the edge ``time_index``.
        time_index : int
            Which edge.
        gyro_bias_radps, accel_bias_mps2 : ndarray, shape (3,)
            Biases, body axes.

        Returns
        -------
        Nominal
        """
        t, blocks = self.interval_s, self.blocks
        assert blocks.position_m is not None  # compressed increments have it
        turn = mean_rotation(blocks.angle_rad)
        velocity = (
            blocks.velocity_mps
            - t * turn @ accel_bias_mps2
            - np.cross(gyro_bias_radps, t * blocks.velocity_mps - blocks.position_m)
        )
        position = (
            blocks.position_m
            - 0.5 * t**2 * exp_so3(blocks.angle_rad / 3.0) @ accel_bias_mps2
            - t**2 / 6.0 * np.cross(gyro_bias_radps, blocks.velocity_mps)
        )
        step = exp_so3(-t * turn @ gyro_bias_radps) @ exp_so3(blocks.angle_rad)
        earth = earth_turn(self.site, t)
        number = len(step)
        rot = np.empty((number + 1, 3, 3))
        rot[time_index] = rot_ned_from_body
        for k in range(time_index, number):
            rot[k + 1] = earth.T @ rot[k] @ step[k]
        for k in range(time_index - 1, -1, -1):
            rot[k] = earth @ rot[k + 1] @ step[k].T
        # Gravity turns with north, east, down: its integrals in the frame of the first edge.
        gravity = -self.site.force_ned_mps2
        first = t * mean_rotation(t * self.site.earth_rate_ned_radps) @ gravity
        second = 0.5 * t**2 * exp_so3(t / 3.0 * self.site.earth_rate_ned_radps) @ gravity
        gained = (rot[:-1] @ velocity[:, :, None])[:, :, 0] + first
        moved = (rot[:-1] @ position[:, :, None])[:, :, 0] + second
        displacement = np.zeros((number + 1, 3))
        speed, place = np.zeros(3), np.zeros(3)
        for k in range(number):
            place = earth.T @ (place + t * speed + moved[k])
            speed = earth.T @ (speed + gained[k])
            displacement[k + 1] = place
        return Nominal(rot, displacement, gyro_bias_radps, accel_bias_mps2)


@dataclass(frozen=True, slots=True, eq=False)
class _Flicker:
    """Bias instability as the filter has it.

    Parameters
    ----------
    var, time_s : ndarray, shape (m,)
        Variance and time constant of each Gauss-Markov process.
    density2 : float
        Square of the density of what is white.
    constant_var : float
        Variance of what does not change within the record.
    """

    var: np.ndarray
    time_s: np.ndarray
    density2: float
    constant_var: float


def _components(floor: float, interval_s: float, duration_s: float) -> _Flicker:
    """Components of flicker noise, two of the simulated processes in one."""
    sd, constants = flicker_components(floor)
    count = 2 * (len(constants) // 2)
    pairs = np.sqrt(constants[0:count:2] * constants[1:count:2])
    variance = np.full(len(pairs), 2.0 * sd**2)
    if count < len(constants):
        pairs, variance = np.append(pairs, constants[-1]), np.append(variance, sd**2)
    short, long = pairs <= interval_s, pairs >= 20.0 * duration_s
    kept = ~short & ~long if floor > 0.0 else np.zeros(len(pairs), dtype=bool)
    return _Flicker(
        variance[kept],
        pairs[kept],
        float(np.sum(2.0 * variance[short] * pairs[short])),
        float(np.sum(variance[long])),
    )


def _sources(model: ErrorModel) -> list[Source]:
    """Every source of error but the shaking."""
    errors, t = model.errors, model.interval_s
    sources: list[Source] = []

    def add(
        name: str,
        stated: str,
        start: dict[str, float | np.ndarray],
        process: dict[str, float | np.ndarray] | None = None,
        core: np.ndarray | None = None,
    ) -> None:
        start_var = np.zeros(model.n)
        for key, value in start.items():
            start_var[model.slices[key]] = value
        process_var = np.zeros(model.n)
        for key, value in (process or {}).items():
            process_var[model.slices[key]] = value
        present = np.any(start_var) or np.any(process_var) or (core is not None and np.any(core))
        if present:
            sources.append(Source(name, stated, start_var, process_var[N_CORE:], core))

    add(
        "start",
        "unknown",
        {
            "attitude": np.array([TILT_SD_RAD, TILT_SD_RAD, HEADING_SD_RAD]) ** 2,
            "velocity": START_VELOCITY_SD_MPS**2,
            # The displacement at the start is that of the shaking, and counts from wherever it is.
            "displacement": 1.0,
        },
    )
    mount = errors.rot_body_from_imu
    axes = model._level @ mount
    earth, force = model.site.earth_rate_ned_radps @ axes, model.site.force_ned_mps2 @ axes
    for sensor, unit, letter, sensed in (
        ("gyro", DPH_RADPS, "gyro", earth),
        ("accelerometer", UG_MPS2, "accel", force),
    ):
        gyro = sensor == "gyro"
        names = ("dph", "deg/h") if gyro else ("ug", "ug")

        def stated(key: str, letter: str = letter) -> float:
            return float(getattr(errors, f"{letter}_{key}"))

        bias = f"{sensor} bias"
        value = stated(f"bias_sd_{names[0]}")
        add(bias, f"{value:g} {names[1]}", {bias: (unit * value) ** 2})
        floor = stated(f"bias_instability_{names[0]}")
        flicker = model.gyro_flicker if gyro else model.accel_flicker
        start: dict[str, float | np.ndarray] = {bias: flicker.constant_var}
        process: dict[str, float | np.ndarray] = {}
        drift = f"{sensor} drift"
        if drift in model.slices:
            start[drift] = np.repeat(flicker.var, 3)
            process[drift] = np.repeat(-flicker.var * np.expm1(-2.0 * t / flicker.time_s), 3)
        noise = _gyro_noise(model, flicker.density2) if gyro else _accel_noise(model, flicker.density2)
        add(f"{bias} instability", f"{floor:g} {names[1]}", start, process, noise)
        walk = stated(f"bias_walk_{names[0]}_per_sqrt_h")
        add(
            "rate random walk" if gyro else "accelerometer bias walk",
            f"{walk:g} {names[1]}/sqrt(h)",
            {},
            {bias: (unit * walk / 60.0) ** 2 * t},
        )
        scale, skewed = stated("scale_sd_ppm"), stated("misalignment_sd_mrad")
        diagonal, others = (1e-6 * scale) ** 2, (1e-3 * skewed) ** 2
        if model.turned:
            matrix = np.eye(3).ravel()
            add(f"{sensor} scale", f"{scale:g} ppm", {f"{sensor} matrix": diagonal * matrix})
            add(f"{sensor} misalignment", f"{skewed:g} mrad", {f"{sensor} matrix": others * (1.0 - matrix)})
        else:
            # At a fixed attitude the axes feel the same all the time: these are biases too. Their
            # covariance in the body is that of the unit's axes up to a rotation of the mount.
            square = sensed**2
            add(f"{sensor} scale", f"{scale:g} ppm", {bias: _turned_diagonal(mount, diagonal * square)})
            add(
                f"{sensor} misalignment",
                f"{skewed:g} mrad",
                {bias: _turned_diagonal(mount, others * (square.sum() - square))},
            )
    sensitive = errors.gyro_g_sensitivity_dph_per_g
    by_force = (DPH_RADPS * sensitive * model.site.gravity_mps2 / STANDARD_GRAVITY_MPS2) ** 2
    add("gyro g-sensitivity", f"{sensitive:g} deg/h/g", {"gyro bias": by_force})
    arw, vrw = errors.gyro_random_walk_deg_per_sqrt_h, errors.accel_random_walk_mps_per_sqrt_h
    arw_density2 = errors.gyro_density_rad_per_sqrt_s**2
    vrw_density2 = errors.accel_density_mps_per_sqrt_s**2
    add("angle random walk", f"{arw:g} deg/sqrt(h)", {}, None, _gyro_noise(model, arw_density2))
    add("velocity random walk", f"{vrw:g} m/s/sqrt(h)", {}, None, _accel_noise(model, vrw_density2))
    gyro_step = float(np.radians(errors.gyro_resolution_dps))
    accel_step = UG_MPS2 * errors.accel_resolution_ug
    step_s = 1.0 / errors.rate_hz
    stated_steps = f"{errors.gyro_resolution_dps:g} deg/s", f"{errors.accel_resolution_ug:g} ug"
    if errors.output == "rates":
        noise = _gyro_noise(model, gyro_step**2 / 12.0 * step_s)
        add("gyro quantisation", stated_steps[0], {}, None, noise)
        noise = _accel_noise(model, accel_step**2 / 12.0 * step_s)
        add("accelerometer quantisation", stated_steps[1], {}, None, noise)
    else:
        # Counts carry their remainder: an angle or a velocity is off by part of a step at each sample, which
        # makes a random walk of their integrals.
        core = np.zeros((N_CORE, N_CORE))
        core[3:6, 3:6] = (model.site.gravity_mps2 * gyro_step * step_s) ** 2 / 12.0 * step_s * t * np.eye(3)
        add("gyro quantisation", stated_steps[0], {}, None, core)
        core = np.zeros((N_CORE, N_CORE))
        core[6:9, 6:9] = (accel_step * step_s) ** 2 / 12.0 * step_s * t * np.eye(3)
        add("accelerometer quantisation", stated_steps[1], {}, None, core)
    add("gravity", f"{1e5 * model._gravity_sd:g} mGal (assumed)", {"gravity": model._gravity_sd**2})
    if "latitude" in model.slices:
        latitude_sd = model.site.latitude_sd_rad
        arcsec = 3600.0 * np.degrees(latitude_sd)
        add("latitude", f"{arcsec:.3g} arcsec", {"latitude": latitude_sd**2})
    return sources


def _turned_diagonal(rot: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Variances along the axes after a rotation of independent components."""
    return np.diag(rot @ np.diag(variance) @ rot.T)


def _gyro_noise(model: ErrorModel, density2: float) -> np.ndarray:
    """What white noise of the gyros does to the core over an interval."""
    t, push = model.interval_s, skew(model.site.force_ned_mps2)
    square = push @ push.T
    core = np.zeros((N_CORE, N_CORE))
    core[0:3, 0:3] = t * np.eye(3)
    core[3:6, 0:3], core[6:9, 0:3] = -0.5 * t**2 * push, -(t**3) / 6.0 * push
    core[0:3, 3:6], core[0:3, 6:9] = core[3:6, 0:3].T, core[6:9, 0:3].T
    core[3:6, 3:6], core[6:9, 6:9] = t**3 / 3.0 * square, t**5 / 20.0 * square
    core[3:6, 6:9] = core[6:9, 3:6] = t**4 / 8.0 * square
    return density2 * core


def _accel_noise(model: ErrorModel, density2: float) -> np.ndarray:
    """What white noise of the accelerometers does to the core over an interval."""
    t = model.interval_s
    core = np.zeros((N_CORE, N_CORE))
    core[3:6, 3:6], core[6:9, 6:9] = t * np.eye(3), t**3 / 3.0 * np.eye(3)
    core[3:6, 6:9] = core[6:9, 3:6] = 0.5 * t**2 * np.eye(3)
    return density2 * core
