r"""Inertial measurement units of named grades: three gyros and three accelerometers.

Of the increments over a sample interval dt, in the axes of the unit at its start (coning and sculling are
compensated within the unit; `truenorth.strapdown`)::

    dtheta_out = (I + Mg) dtheta + G dv + (bg + fg + wg) dt + Ng sqrt(dt) n
    dv_out     = (I + Ma) dv            + (ba + fa + wa) dt + Na sqrt(dt) n

b is the bias of a run (turn-on), f the bias instability as flicker noise with the stated floor of the Allan
deviation, w a random walk of the bias, N the angle or velocity random walk, M the scale errors (diagonal)
and misalignments, G the sensitivity of the gyros to specific force. Increments beyond the range are
cut; they are counted in whole steps with the remainder carried (nothing is lost, only late), rates are
rounded one by one. `allan_deviation` is the Allan deviation that follows from a description.

Grades (values per axis, one sigma unless said otherwise; where a data sheet gives limits or nothing, the
choice is marked *):

============  ==============================================================================
consumer      TDK InvenSense ICM-20948, DS-000189 rev. 1.3; biases*, instability and walks* as
              measured on such parts
industrial    SBG Systems Ellipse 2 series data sheet (repeatability*, cross-axis*, g-sensitivity*)
tactical      Sensonor STIM300 data sheet TS1524, 10 g accelerometers
navigation    Honeywell HG9900 brochure N61-1638 (velocity random walk after Groves 2013,
              sec. 4.4.3; instabilities*, misalignments*)
============  ==============================================================================

References
----------
P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed. (2013),
ch. 4.
IEEE Std 952-1997, annex C.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import msgspec
import numpy as np

from ..constants import DPH_RADPS, STANDARD_GRAVITY_MPS2, UG_MPS2
from ..rotations import rot_ned_from_body
from ..sensor_log import SensorLog
from ..strapdown import reference_increments
from .checks import refuse, require, require_not_negative, require_positive
from .kinematics import Mover, PointOfBody
from .processes import (
    flicker,
    flicker_variance,
    quantisation_variance,
    random_walk,
    random_walk_variance,
    white_variance,
)
from .sampling import GeneratorByName, SampledSensor, blocks, sample_times_s, stamp_times

__all__ = [
    "GRADES",
    "ImuCalibration",
    "ImuDescription",
    "allan_deviation",
    "correct_imu",
    "draw_calibration",
    "imu_increments_from_log",
    "simulate_imu",
]


GRADES: dict[str, dict[str, Any]] = {
    "consumer": {
        "output": "rates",
        "gyro_bias_sd_dph": 3600.0,
        "gyro_bias_instability_dph": 10.0,
        "gyro_random_walk_deg_per_sqrt_h": 0.9,
        "gyro_bias_walk_dph_per_sqrt_h": 60.0,
        "gyro_scale_sd_ppm": 15_000.0,
        "gyro_misalignment_sd_mrad": 20.0,
        "gyro_g_sensitivity_dph_per_g": 360.0,
        "gyro_range_dps": 500.0,
        "gyro_resolution_dps": 1.0 / 65.5,
        "accel_bias_sd_ug": 25_000.0,
        "accel_bias_instability_ug": 50.0,
        "accel_random_walk_mps_per_sqrt_h": 0.135,
        "accel_bias_walk_ug_per_sqrt_h": 600.0,
        "accel_scale_sd_ppm": 5_000.0,
        "accel_misalignment_sd_mrad": 20.0,
        "accel_range_g": 4.0,
        "accel_resolution_ug": 1e6 / 8192.0,
    },
    "industrial": {
        "output": "rates",
        "gyro_bias_sd_dph": 70.0,
        "gyro_bias_instability_dph": 7.0,
        "gyro_random_walk_deg_per_sqrt_h": 0.15,
        "gyro_bias_walk_dph_per_sqrt_h": 0.0,
        "gyro_scale_sd_ppm": 500.0,
        "gyro_misalignment_sd_mrad": 1.0,
        "gyro_g_sensitivity_dph_per_g": 10.0,
        "gyro_range_dps": 450.0,
        "gyro_resolution_dps": 0.001,
        "accel_bias_sd_ug": 1_000.0,
        "accel_bias_instability_ug": 14.0,
        "accel_random_walk_mps_per_sqrt_h": 0.033,
        "accel_bias_walk_ug_per_sqrt_h": 0.0,
        "accel_scale_sd_ppm": 1_000.0,
        "accel_misalignment_sd_mrad": 1.0,
        "accel_range_g": 8.0,
        "accel_resolution_ug": 10.0,
    },
    "tactical": {
        "output": "increments",
        "gyro_bias_sd_dph": 4.0,
        "gyro_bias_instability_dph": 0.5,
        "gyro_random_walk_deg_per_sqrt_h": 0.15,
        "gyro_bias_walk_dph_per_sqrt_h": 0.0,
        "gyro_scale_sd_ppm": 500.0,
        "gyro_misalignment_sd_mrad": 1.0,
        "gyro_g_sensitivity_dph_per_g": 1.0,
        "gyro_range_dps": 400.0,
        "gyro_resolution_dps": 2.0**-14,
        "accel_bias_sd_ug": 750.0,
        "accel_bias_instability_ug": 50.0,
        "accel_random_walk_mps_per_sqrt_h": 0.06,
        "accel_bias_walk_ug_per_sqrt_h": 0.0,
        "accel_scale_sd_ppm": 300.0,
        "accel_misalignment_sd_mrad": 1.0,
        "accel_range_g": 10.0,
        "accel_resolution_ug": 1e6 * 2.0**-19,
    },
    "navigation": {
        "output": "increments",
        "gyro_bias_sd_dph": 0.0035,
        "gyro_bias_instability_dph": 0.001,
        "gyro_random_walk_deg_per_sqrt_h": 0.002,
        "gyro_bias_walk_dph_per_sqrt_h": 0.0,
        "gyro_scale_sd_ppm": 5.0,
        "gyro_misalignment_sd_mrad": 0.02,
        "gyro_g_sensitivity_dph_per_g": 0.0,
        "gyro_range_dps": 512.0,
        "gyro_resolution_dps": 1e-6,
        "accel_bias_sd_ug": 25.0,
        "accel_bias_instability_ug": 5.0,
        "accel_random_walk_mps_per_sqrt_h": 0.012,
        "accel_bias_walk_ug_per_sqrt_h": 0.0,
        "accel_scale_sd_ppm": 100.0,
        "accel_misalignment_sd_mrad": 0.02,
        "accel_range_g": 37.0,
        "accel_resolution_ug": 0.1,
    },
}
"""Settings of each grade."""


OF_GRADE: Any = None
"""Left out; the grade says it before anyone can see this."""


class ImuDescription(SampledSensor, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A ``[[sensors.imu]]`` table: a grade, and what is to differ from it.

    Every setting that is left out takes the value of the grade at once, so a description always holds
    numbers.
    """

    name: str = "imu"
    """Of its log; each unit aboard has its own."""
    grade: Literal["consumer", "industrial", "tactical", "navigation"] = "tactical"
    rate_hz: float = 100.0
    output: Literal["increments", "rates"] = OF_GRADE
    """Increments of angle and velocity, or their means over the interval: rates and specific forces."""
    position_body_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the unit sits: forward, right, down."""
    mount_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Heading, pitch and roll of the unit's axes in the body."""
    gyro_bias_sd_dph: float = OF_GRADE
    """Turn-on bias, one sigma, degrees in an hour."""
    gyro_bias_instability_dph: float = OF_GRADE
    """Floor of the Allan deviation."""
    gyro_random_walk_deg_per_sqrt_h: float = OF_GRADE
    """Angle random walk."""
    gyro_bias_walk_dph_per_sqrt_h: float = OF_GRADE
    """Rate random walk."""
    gyro_scale_sd_ppm: float = OF_GRADE
    gyro_misalignment_sd_mrad: float = OF_GRADE
    """Each axis against each other one."""
    gyro_g_sensitivity_dph_per_g: float = OF_GRADE
    """Each gyro to the force along each axis, one sigma."""
    gyro_range_dps: float = OF_GRADE
    gyro_resolution_dps: float = OF_GRADE
    """One step of a rate; of an increment it is this times the interval. 0: continuous."""
    accel_bias_sd_ug: float = OF_GRADE
    """Turn-on bias, one sigma, millionths of standard gravity."""
    accel_bias_instability_ug: float = OF_GRADE
    """Floor of the Allan deviation."""
    accel_random_walk_mps_per_sqrt_h: float = OF_GRADE
    """Velocity random walk."""
    accel_bias_walk_ug_per_sqrt_h: float = OF_GRADE
    accel_scale_sd_ppm: float = OF_GRADE
    accel_misalignment_sd_mrad: float = OF_GRADE
    accel_range_g: float = OF_GRADE
    accel_resolution_ug: float = OF_GRADE
    """One step of a specific force; of an increment it is this times the interval. 0: continuous."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for key, value in GRADES[self.grade].items():
            if getattr(self, key) is OF_GRADE:
                msgspec.structs.force_setattr(self, key, value)
        numbers = [key for key in GRADES[self.grade] if key != "output"]
        ranges = [key for key in numbers if "_range_" in key]
        require_positive(self, *ranges)
        require_not_negative(self, *(key for key in numbers if key not in ranges))
        require(self, "position_body_m", "mount_deg", test=lambda _: True, wanted="three finite numbers")
        if not self.name:
            refuse("name", self.name, "a name")

    @property
    def gyro_density_rad_per_sqrt_s(self) -> float:
        """float: White noise of a gyro, the angle random walk, rad/sqrt(s)."""
        return float(np.radians(self.gyro_random_walk_deg_per_sqrt_h)) / 60.0

    @property
    def accel_density_mps_per_sqrt_s(self) -> float:
        """float: White noise of an accelerometer, the velocity random walk, (m/s)/sqrt(s)."""
        return self.accel_random_walk_mps_per_sqrt_h / 60.0

    @property
    def rot_body_from_imu(self) -> np.ndarray:
        """ndarray, shape (3, 3): Axes of the unit in the body."""
        return rot_ned_from_body(*np.radians(self.mount_deg))


@dataclass(frozen=True, slots=True, eq=False)
class ImuCalibration:
    """Constant errors of one unit in one run, in its own axes.

    Parameters
    ----------
    gyro_bias_radps, accel_bias_mps2 : ndarray, shape (3,)
        Turn-on biases.
    gyro_matrix, accel_matrix : ndarray, shape (3, 3)
        Scale and misalignment: the unit gives ``matrix @ truth``.
    gyro_g_sensitivity : ndarray, shape (3, 3)
        Rate by specific force, (rad/s)/(m/s^2).
    """

    gyro_bias_radps: np.ndarray
    accel_bias_mps2: np.ndarray
    gyro_matrix: np.ndarray
    accel_matrix: np.ndarray
    gyro_g_sensitivity: np.ndarray


def draw_calibration(imu: ImuDescription, generator: GeneratorByName) -> ImuCalibration:
    """Constant errors of a unit; the same for the same generators, so a test can draw them again."""

    def matrix(kind: str, scale_ppm: float, misalignment_mrad: float) -> np.ndarray:
        draws = generator(kind, "matrix").standard_normal((3, 3))
        sd = np.where(np.eye(3, dtype=bool), 1e-6 * scale_ppm, 1e-3 * misalignment_mrad)
        return np.eye(3) + sd * draws

    return ImuCalibration(
        gyro_bias_radps=DPH_RADPS * imu.gyro_bias_sd_dph * generator("gyro", "bias").standard_normal(3),
        accel_bias_mps2=UG_MPS2 * imu.accel_bias_sd_ug * generator("accel", "bias").standard_normal(3),
        gyro_matrix=matrix("gyro", imu.gyro_scale_sd_ppm, imu.gyro_misalignment_sd_mrad),
        accel_matrix=matrix("accel", imu.accel_scale_sd_ppm, imu.accel_misalignment_sd_mrad),
        gyro_g_sensitivity=DPH_RADPS
        / STANDARD_GRAVITY_MPS2
        * imu.gyro_g_sensitivity_dph_per_g
        * generator("gyro", "g_sensitivity").standard_normal((3, 3)),
    )


def simulate_imu(
    imu: ImuDescription,
    mover: Mover,
    *,
    start_ns: int,
    duration_s: float,
    generator: GeneratorByName,
) -> SensorLog:
    """Output of an IMU on a moving body.

    Parameters
    ----------
    imu : ImuDescription
        The unit.
    mover : object with ``at(time_s)``
        Motion of the body.
    start_ns : int
        GPS time of the start, nanoseconds.
    duration_s : float
        Length of the record, seconds.
    generator : callable
        Random generators by name.

    Returns
    -------
    SensorLog
        Columns ``delta_angle_x_rad``, ... ``delta_velocity_z_mps``, or ``rate_x_radps``, ...
        ``force_z_mps2``, in the axes of the unit; truth ``time_ns``, the same columns without errors, and
        ``gyro_bias_x_radps``, ... ``accel_bias_z_mps2``: all that changes slowly (turn-on bias,
        instability, walk).
    """
    edges_s = sample_times_s(imu, duration_s)
    step_s, n = 1.0 / imu.rate_hz, len(edges_s) - 1
    angle, velocity = np.empty((n, 3)), np.empty((n, 3))
    point = PointOfBody(mover, np.array(imu.position_body_m))
    for rows in blocks(n):
        ideal = reference_increments(point, edges_s[rows.start : rows.stop + 1])
        angle[rows] = ideal.angle_rad @ imu.rot_body_from_imu
        velocity[rows] = ideal.velocity_mps @ imu.rot_body_from_imu
    errors = draw_calibration(imu, generator)

    def drifts(kind: str, constant: np.ndarray, floor: float, walk: float) -> np.ndarray:
        total = constant + flicker(generator(kind, "instability"), (n, 3), step_s, floor)
        # Walks are stated per square root of an hour.
        return total + random_walk(generator(kind, "bias_walk"), (n, 3), step_s, walk / 60.0)

    gyro_bias = drifts(
        "gyro",
        errors.gyro_bias_radps,
        DPH_RADPS * imu.gyro_bias_instability_dph,
        DPH_RADPS * imu.gyro_bias_walk_dph_per_sqrt_h,
    )
    accel_bias = drifts(
        "accel",
        errors.accel_bias_mps2,
        UG_MPS2 * imu.accel_bias_instability_ug,
        UG_MPS2 * imu.accel_bias_walk_ug_per_sqrt_h,
    )
    gyro_density, accel_density = _densities(imu)
    out_angle = angle @ errors.gyro_matrix.T + velocity @ errors.gyro_g_sensitivity.T + gyro_bias * step_s
    out_angle += gyro_density * np.sqrt(step_s) * generator("gyro", "noise").standard_normal((n, 3))
    out_velocity = velocity @ errors.accel_matrix.T + accel_bias * step_s
    out_velocity += accel_density * np.sqrt(step_s) * generator("accel", "noise").standard_normal((n, 3))

    carried = imu.output == "increments"
    gyro_step, accel_step = _steps(imu)
    gyro_range = np.radians(imu.gyro_range_dps) * step_s
    accel_range = imu.accel_range_g * STANDARD_GRAVITY_MPS2 * step_s
    out_angle = _count(np.clip(out_angle, -gyro_range, gyro_range), gyro_step * step_s, carried)
    out_velocity = _count(np.clip(out_velocity, -accel_range, accel_range), accel_step * step_s, carried)

    true_ns, stamped_ns = stamp_times(imu, edges_s[1:], start_ns, generator)
    return SensorLog(
        kind="imu",
        time_ns=stamped_ns,
        columns=_columns(imu, out_angle, out_velocity),
        meta={"interval_s": step_s, "grade": imu.grade, "name": imu.name},
        truth={
            "time_ns": true_ns,
            **_columns(imu, angle, velocity),
            **_axes("gyro_bias", gyro_bias, "radps"),
            **_axes("accel_bias", accel_bias, "mps2"),
        },
    )


def imu_increments_from_log(imu: ImuDescription, log: SensorLog) -> tuple[np.ndarray, np.ndarray]:
    """Increments of angle and velocity of a log in the axes of the unit, whatever its output.

    Returns
    -------
    delta_angle_rad, delta_velocity_mps : ndarray, shape (n, 3)
    """
    if imu.output == "increments":
        names, factor = (("delta_angle", "rad"), ("delta_velocity", "mps")), 1.0
    else:
        names, factor = (("rate", "radps"), ("force", "mps2")), 1.0 / imu.rate_hz
    angle, velocity = (
        factor * np.stack([log.columns[f"{name}_{axis}_{unit}"] for axis in "xyz"], axis=-1)
        for name, unit in names
    )
    return angle, velocity


def correct_imu(
    imu: ImuDescription, log: SensorLog, calibration: ImuCalibration
) -> tuple[np.ndarray, np.ndarray]:
    """Increments in body axes, freed from the constant errors of a calibration.

    Parameters
    ----------
    imu : ImuDescription
        The unit.
    log : SensorLog
        What it said.
    calibration : ImuCalibration
        Errors known from a laboratory or a filter.

    Returns
    -------
    delta_angle_rad, delta_velocity_mps : ndarray, shape (n, 3)
        Body axes.
    """
    angle, velocity = imu_increments_from_log(imu, log)
    step_s = 1.0 / imu.rate_hz
    velocity = np.linalg.solve(
        calibration.accel_matrix, (velocity - calibration.accel_bias_mps2 * step_s).T
    ).T
    angle = angle - calibration.gyro_bias_radps * step_s - velocity @ calibration.gyro_g_sensitivity.T
    angle = np.linalg.solve(calibration.gyro_matrix, angle.T).T
    return angle @ imu.rot_body_from_imu.T, velocity @ imu.rot_body_from_imu.T


def allan_deviation(imu: ImuDescription, tau_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Allan deviation of one gyro and one accelerometer of a unit at rest.

    Parameters
    ----------
    imu : ImuDescription
        The unit.
    tau_s : ndarray, shape (n,)
        Averaging times, seconds; from one sample interval up.

    Returns
    -------
    gyro_radps, accel_mps2 : ndarray, shape (n,)
        The rounding of rates is taken as white, which holds where the noise spans a step.
    """
    step_s = 1.0 / imu.rate_hz
    floors = (DPH_RADPS * imu.gyro_bias_instability_dph, UG_MPS2 * imu.accel_bias_instability_ug)
    walks = (DPH_RADPS * imu.gyro_bias_walk_dph_per_sqrt_h, UG_MPS2 * imu.accel_bias_walk_ug_per_sqrt_h)
    deviations = []
    for density, floor, walk, step in zip(_densities(imu), floors, walks, _steps(imu), strict=True):
        variance = white_variance(tau_s, density) + flicker_variance(tau_s, floor)
        variance = variance + random_walk_variance(tau_s, walk / 60.0)
        if imu.output == "increments":
            variance = variance + quantisation_variance(tau_s, step * step_s)
        else:
            variance = variance + white_variance(tau_s, step * np.sqrt(step_s / 12.0))
        deviations.append(np.sqrt(variance))
    return deviations[0], deviations[1]


def _densities(imu: ImuDescription) -> tuple[float, float]:
    """White noise of gyros, rad/sqrt(s), and accelerometers, (m/s)/sqrt(s)."""
    return imu.gyro_density_rad_per_sqrt_s, imu.accel_density_mps_per_sqrt_s


def _steps(imu: ImuDescription) -> tuple[float, float]:
    """One count of a rate, rad/s, and of a specific force, m/s^2."""
    return float(np.radians(imu.gyro_resolution_dps)), UG_MPS2 * imu.accel_resolution_ug


def _count(value: np.ndarray, step: float, carried: bool) -> np.ndarray:
    """Whole steps; what is left over goes into the next sample, or is lost."""
    if step == 0.0:
        return value
    if carried:
        return np.diff(np.rint(np.cumsum(value, axis=0) / step), axis=0, prepend=0.0) * step
    return np.rint(value / step) * step


def _columns(imu: ImuDescription, angle: np.ndarray, velocity: np.ndarray) -> dict[str, np.ndarray]:
    """Output columns of increments in the axes of the unit."""
    if imu.output == "increments":
        return {**_axes("delta_angle", angle, "rad"), **_axes("delta_velocity", velocity, "mps")}
    return {
        **_axes("rate", angle * imu.rate_hz, "radps"),
        **_axes("force", velocity * imu.rate_hz, "mps2"),
    }


def _axes(name: str, values: np.ndarray, unit: str) -> dict[str, np.ndarray]:
    """One column for each axis."""
    return {f"{name}_{axis}_{unit}": values[:, k] for k, axis in enumerate("xyz")}
