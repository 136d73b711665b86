r"""Single-axis fibre-optic gyro that counts: error model, simulation and the way back to a heading rate.

With the rate w about the sensitive axis, the scale s (degrees per second in a count) and the bias d::

    count = round((w + noise) / s(T) + d(T) + walk),      w = s(T) (count - d)           (Harvey 5.1)
    s(T)  = b0 + b1 T + b2 T^2                                                          (Harvey 5.2)

What the axis ``a`` (body frame) feels is the mean over the sample interval of ``a . w_ib``: the body's
turning, the Earth's, and the local level frame's over the ground. With heading psi, pitch theta and roll
phi, and the rate of the north-east-down frame ``w_in`` subtracted, it is linear in the Euler rates::

    a . (w_ib - w_in) = psi' a.(-sin(theta), cos(theta) sin(phi), cos(theta) cos(phi))
                      + theta' a.(0, cos(phi), -sin(phi)) + phi' a.(1, 0, 0)

which for an axis down is ``psi' = (w + theta' sin(phi)) / (cos(theta) cos(phi))``. Harvey's (5.11) keeps
``psi' = w / sqrt(1 - theta^2 - phi^2)`` and no Earth rate.

The defaults describe the Andrew AUTOGYRO 3ARG-D of the source, by its tables, where it gives figures.
Assumed, for the source has none: the bias table (the factory's is lost; about 0.4 count, as the drift of
the raw integrated gyro says), the walk (0.1 count in 2400 s, the 0.005 deg/s of the data sheet), and the
code of the temperature byte.

References
----------
R. S. Harvey, Development of a Precision Pointing System Using an Integrated Multi-Sensor Approach,
UCGE Report 20117, University of Calgary (1998), ch. 5.
"""

from __future__ import annotations

import numpy as np

from ..errors import ModelError
from ..rotations import body_rate_from_euler_rates, rot_ned_from_body
from ..sensor_log import SensorLog
from .checks import refuse, require, require_not_negative, require_table
from .kinematics import Mover, angle_integrals
from .processes import random_walk
from .sampling import GeneratorByName, SampledSensor, sample_times_s, stamp_times, table_at

__all__ = [
    "FogDescription",
    "correct_gyro",
    "heading_rate",
    "heading_rate_simplified",
    "rate_from_counts",
    "scale_radps_per_count",
    "sensitive_axis_body",
    "simulate_gyro",
]


class FogDescription(SampledSensor, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The ``[sensors.gyro]`` table: a fibre-optic gyro with counts for rate and temperature."""

    phase_s: float = 0.03
    """Unsynchronised: with stamps of a PC, 9, 10 or 11 samples fall into a second."""
    time_tag_step_s: float = 0.055
    """Stamped by the clock of a PC."""
    scale_polynomial: tuple[float, ...] = (0.0486972010810, -0.0003749484972, 0.0000142854916)
    """Scale in (deg/s)/count by powers of the temperature in deg C, constant first (Harvey 5.2)."""
    scale_temperature_range_degc: tuple[float, float] = (15.0, 23.0)
    """The polynomial was fitted here, and outside keeps the value of the nearer end."""
    bias_table: tuple[tuple[float, float], ...] = ((15.0, 0.35), (19.0, 0.40), (23.0, 0.45))
    """Bias by temperature, rows of deg C and counts: the calibration that comes with the sensor."""
    bias_sd_count: float = 0.0
    """The constant by which the bias of one run departs from the table, one sigma, counts."""
    bias_walk_count_per_sqrt_s: float = 0.002
    """Random walk of the bias, counts per square root of a second."""
    angle_random_walk_deg_per_sqrt_h: float = 0.12
    """White noise of the rate: 0.02 deg/s in 100 Hz, the least rate detected."""
    bits: int = 12
    """Length of the rate word; two's complement."""
    axis_pitch_deg: float = 0.0
    """Tilt of the sensitive axis from the body's down axis, about right: its top leans backwards."""
    axis_roll_deg: float = 0.0
    """Tilt of the sensitive axis about forward: its top leans to the right."""
    temperature_profile: tuple[tuple[float, float], ...] = ((0.0, 15.0), (900.0, 20.0), (2400.0, 23.0))
    """Temperature of the sensor in time, rows of seconds since the start and deg C."""
    temperature_step_degc: float = 0.5
    """One count of the temperature byte."""
    temperature_zero_degc: float = -40.0
    """Temperature of count 0."""
    failures: tuple[tuple[float, float], ...] = ()
    """Intervals, seconds since the start, in which the status says failure and the rate freezes."""
    failure_probability: float = 0.0
    """Chance of a single sample to be flagged as failed, its rate frozen."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(
            self, "bias_sd_count", "bias_walk_count_per_sqrt_s", "angle_random_walk_deg_per_sqrt_h"
        )
        require(self, "temperature_step_degc", test=lambda number: number > 0.0, wanted="a positive number")
        require(
            self, "axis_pitch_deg", "axis_roll_deg", test=lambda deg: abs(deg) < 90.0, wanted="less than 90"
        )
        require(
            self, "failure_probability", test=lambda share: 0.0 <= share <= 1.0, wanted="a share from 0 to 1"
        )
        require_table(self, "bias_table", "rows of rising temperatures and counts")
        require_table(self, "temperature_profile", "rows of rising times and temperatures")
        if not 2 <= self.bits <= 32:
            refuse("bits", self.bits, "2 to 32")
        low, high = self.scale_temperature_range_degc
        if not low <= high:
            refuse("scale_temperature_range_degc", self.scale_temperature_range_degc, "a rising pair")
        if not self.scale_polynomial or not np.all(scale_radps_per_count(self, np.array([low, high])) > 0.0):
            refuse("scale_polynomial", self.scale_polynomial, "coefficients of a positive scale")
        for first, last in self.failures:
            if not first < last:
                refuse("failures", self.failures, "pairs of rising times")


def scale_radps_per_count(gyro: FogDescription, temperature_degc: np.ndarray) -> np.ndarray:
    """Scale at a temperature (Harvey 5.2), rad/s in a count."""
    inside = np.clip(temperature_degc, *gyro.scale_temperature_range_degc)
    return np.radians(np.polynomial.polynomial.polyval(inside, gyro.scale_polynomial))


def sensitive_axis_body(gyro: FogDescription) -> np.ndarray:
    """Unit vector of the sensitive axis in the body frame; ``(0, 0, 1)`` without tilt."""
    pitch, roll = np.radians([gyro.axis_pitch_deg, gyro.axis_roll_deg])
    # Third column of R_y(pitch) R_x(roll).
    return np.array([np.sin(pitch) * np.cos(roll), -np.sin(roll), np.cos(pitch) * np.cos(roll)])


def simulate_gyro(
    gyro: FogDescription, mover: Mover, *, start_ns: int, duration_s: float, generator: GeneratorByName
) -> SensorLog:
    """Counts of a gyro that rides on a moving body.

    Parameters
    ----------
    gyro : FogDescription
        The sensor.
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
        Columns ``rate_count``, ``temperature_count``, ``status`` (1: failure); truth ``time_ns``,
        ``rate_radps`` about the sensitive axis (mean of the interval that ends at the time),
        ``noise_radps``, ``temperature_degc``, ``scale_radps_per_count``, ``bias_count``,
        ``quantisation_count`` (what rounding and the end of the range added).
    """
    edges_s = sample_times_s(gyro, duration_s)
    time_s, n = edges_s[1:], len(edges_s) - 1
    step_s = 1.0 / gyro.rate_hz
    rate = angle_integrals(mover, edges_s) @ sensitive_axis_body(gyro) / step_s
    density = np.radians(gyro.angle_random_walk_deg_per_sqrt_h) / 60.0
    noise = density / np.sqrt(step_s) * generator("noise").standard_normal(n)
    temperature = table_at(gyro.temperature_profile, time_s)
    scale = scale_radps_per_count(gyro, temperature)
    bias = (
        table_at(gyro.bias_table, temperature)
        + gyro.bias_sd_count * generator("bias").standard_normal()
        + random_walk(generator("bias_walk"), n, step_s, gyro.bias_walk_count_per_sqrt_s)
    )
    ideal = (rate + noise) / scale + bias
    top = 2 ** (gyro.bits - 1)
    count = np.clip(np.rint(ideal), -top, top - 1)

    status = generator("status").random(n) < gyro.failure_probability
    for first_s, last_s in gyro.failures:
        status |= (time_s >= first_s) & (time_s < last_s)
    good = np.where(status, -1, np.arange(n))
    # A failed sample repeats the last good one; before the first of them the word is zero.
    held = np.maximum.accumulate(good) if n else good
    count = np.where(held >= 0, count[held], 0.0)

    true_ns, stamped_ns = stamp_times(gyro, time_s, start_ns, generator)
    byte = np.rint((temperature - gyro.temperature_zero_degc) / gyro.temperature_step_degc)
    return SensorLog(
        kind="gyro",
        time_ns=stamped_ns,
        columns={
            "rate_count": count.astype(np.int64),
            "temperature_count": np.clip(byte, 0, 255).astype(np.int64),
            "status": status.astype(np.int64),
        },
        meta={
            "bits": float(gyro.bits),
            "interval_s": step_s,
            "temperature_step_degc": gyro.temperature_step_degc,
            "temperature_zero_degc": gyro.temperature_zero_degc,
        },
        truth={
            "time_ns": true_ns,
            "rate_radps": rate,
            "noise_radps": noise,
            "temperature_degc": temperature,
            "scale_radps_per_count": scale,
            "bias_count": bias,
            "quantisation_count": count - ideal,
        },
    )


def rate_from_counts(
    gyro: FogDescription,
    rate_count: np.ndarray,
    temperature_degc: np.ndarray,
    *,
    bias_offset_count: float | np.ndarray = 0.0,
) -> np.ndarray:
    """Rate about the sensitive axis (Harvey 5.1), rad/s.

    Parameters
    ----------
    gyro : FogDescription
        Gives the scale and the bias table.
    rate_count, temperature_degc : ndarray, shape (n,)
        What the sensor says.
    bias_offset_count : float or ndarray
        What a filter has found beyond the table, counts.

    Returns
    -------
    ndarray, shape (n,)
    """
    bias = table_at(gyro.bias_table, temperature_degc) + bias_offset_count
    return scale_radps_per_count(gyro, temperature_degc) * (rate_count - bias)


def correct_gyro(
    gyro: FogDescription, log: SensorLog, *, bias_offset_count: float | np.ndarray = 0.0
) -> np.ndarray:
    """Rates of a log about the sensitive axis, rad/s; NaN where the status says failure."""
    temperature = gyro.temperature_zero_degc + gyro.temperature_step_degc * log.columns["temperature_count"]
    rate = rate_from_counts(gyro, log.columns["rate_count"], temperature, bias_offset_count=bias_offset_count)
    return np.where(log.columns["status"] == 0, rate, np.nan)


def heading_rate_simplified(
    rate_radps: np.ndarray, pitch_rad: np.ndarray, roll_rad: np.ndarray
) -> np.ndarray:
    """Heading rate by the small-angle form ``w / sqrt(1 - theta^2 - phi^2)`` (Harvey 5.9, 5.11).

    Parameters
    ----------
    rate_radps : ndarray, shape (n,)
        Rate about the body's down axis, rad/s.
    pitch_rad, roll_rad : ndarray, shape (n,)
        Tilt, radians; the form fails at ``theta^2 + phi^2 >= 1``.

    Returns
    -------
    ndarray, shape (n,)
        Without tilt rates and without Earth rate, rad/s.
    """
    share = 1.0 - np.square(pitch_rad) - np.square(roll_rad)
    if np.any(share <= 0.0):
        raise ModelError(
            "could not turn gyro rates into heading rates: a tilt beyond 1 rad was found, for which the "
            "small-angle form has no value; use `heading_rate`"
        )
    return rate_radps / np.sqrt(share)


def heading_rate(
    rate_radps: np.ndarray,
    pitch_rad: np.ndarray,
    roll_rad: np.ndarray,
    *,
    pitch_rate_radps: np.ndarray | float = 0.0,
    roll_rate_radps: np.ndarray | float = 0.0,
    axis_body: np.ndarray | None = None,
    heading_rad: np.ndarray | None = None,
    frame_rate_ned_radps: np.ndarray | None = None,
) -> np.ndarray:
    """Heading rate from the rate about one body axis, exactly.

    Parameters
    ----------
    rate_radps : ndarray, shape (n,)
        Inertial rate about the axis, rad/s.
    pitch_rad, roll_rad : ndarray, shape (n,)
        Tilt of the body, radians.
    pitch_rate_radps, roll_rate_radps : ndarray or float
        Rates of these angles; 0 where they are not known.
    axis_body : ndarray, shape (3,), optional
        The axis; down if left out. See `sensitive_axis_body`.
    heading_rad : ndarray, shape (n,), optional
        Heading, needed with `frame_rate_ned_radps`; a few degrees are good enough.
    frame_rate_ned_radps : ndarray, shape (3,) or (n, 3), optional
        Rate of the local frame, see `truenorth.sensors.kinematics.frame_rate_ned`; left out, the Earth
        stands still.

    Returns
    -------
    ndarray, shape (n,)
        Rate of the heading against true north, rad/s; NaN where the axis does not feel it.
    """
    axis = np.array([0.0, 0.0, 1.0]) if axis_body is None else np.asarray(axis_body, dtype=float)
    rate = np.asarray(rate_radps, dtype=float)
    if frame_rate_ned_radps is not None:
        if heading_rad is None:
            raise ModelError(
                "could not subtract the rate of the Earth from a gyro: no heading was given; give "
                "`heading_rad` with `frame_rate_ned_radps`"
            )
        axis_ned = rot_ned_from_body(heading_rad, pitch_rad, roll_rad) @ axis
        rate = rate - np.sum(axis_ned * frame_rate_ned_radps, axis=-1)
    still = body_rate_from_euler_rates(pitch_rad, roll_rad, 0.0, pitch_rate_radps, roll_rate_radps)
    turning = body_rate_from_euler_rates(pitch_rad, roll_rad, 1.0, 0.0, 0.0)
    rate, felt = rate - still @ axis, turning @ axis
    return np.where(np.abs(felt) > 1e-6, rate / np.where(felt == 0.0, 1.0, felt), np.nan)
