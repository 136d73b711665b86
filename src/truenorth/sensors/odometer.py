r"""Wheel odometer: counted pulses of a turning wheel, with scale error and slip.

    pulses = floor( integral of (1 + e) (1 + slip(t)) v_x dt / d + u ),      v = v_body + w x l

d is the road of one pulse, e the scale error of the run (tyre pressure and wear), l the place of the wheel
in the body, u the phase of the first pulse. While a wheel spins (or locks) the slip is positive (or
negative). Pulses of driving backwards count down where the wheel has two sensors, and up where it has one.

References
----------
P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed. (2013),
sec. 6.3.
"""

from __future__ import annotations

import numpy as np

from ..sensor_log import SensorLog
from .checks import require, require_not_negative, require_positive
from .kinematics import Mover
from .processes import poisson_events, sum_of_events
from .sampling import GeneratorByName, SampledSensor, blocks, sample_times_s, stamp_times

__all__ = ["OdometerDescription", "distance_from_pulses", "simulate_odometer"]


class OdometerDescription(SampledSensor, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The ``[sensors.odometer]`` table: pulses of one wheel."""

    pulse_m: float = 0.02
    """Road of one pulse (about 100 pulses a turn)."""
    scale_sd_ppm: float = 5_000.0
    """Scale error of a run, one sigma."""
    slips_per_minute: float = 0.2
    """Spinning or locking of the wheel, while driving."""
    slip_sd: float = 0.1
    """Share of the road that is gained or lost at the height of a slip, one sigma."""
    slip_duration_s: float = 1.5
    """Mean duration; single ones scatter by a factor of 2 either way."""
    position_body_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the wheel stands: forward, right, down."""
    signed: bool = True
    """Pulses of driving backwards count down."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "pulse_m", "slip_duration_s")
        require_not_negative(self, "scale_sd_ppm", "slips_per_minute", "slip_sd")
        require(self, "position_body_m", test=lambda _: True, wanted="three lengths")


def simulate_odometer(
    odometer: OdometerDescription,
    mover: Mover,
    *,
    start_ns: int,
    duration_s: float,
    generator: GeneratorByName,
) -> SensorLog:
    """Pulse counts of an odometer on a moving body.

    Parameters
    ----------
    odometer : OdometerDescription
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
        Column ``pulse_count``, all pulses since the start; truth ``time_ns``, ``distance_m`` of the wheel
        over ground, forward positive (absolute road if not signed), ``speed_mps``, ``scale`` and ``slip``.
    """
    edges_s = sample_times_s(odometer, duration_s)
    step_s, n = 1.0 / odometer.rate_hz, len(edges_s) - 1
    # Two points in an interval beside its ends: Simpson's rule over each half.
    fine_s = edges_s[0] + np.arange(4 * n + 1) * (step_s / 4.0)
    speed = np.empty(len(fine_s))
    for rows in blocks(len(fine_s)):
        motion = mover.at(fine_s[rows])
        turning = np.cross(motion.rate_body_radps, odometer.position_body_m)[:, 0]
        ahead = np.einsum("ni,ni->n", motion.rot_ecef_from_body[:, :, 0], motion.velocity_ecef_mps)
        speed[rows] = ahead + turning
    if not odometer.signed:
        speed = np.abs(speed)
    rng = generator("slip")
    begin = poisson_events(rng, odometer.slips_per_minute / 60.0, duration_s)
    length = odometer.slip_duration_s * 2.0 ** rng.uniform(-1.0, 1.0, len(begin))
    height = odometer.slip_sd * rng.standard_normal((len(begin), 1))
    slip = sum_of_events(fine_s, begin, length, height)[:, 0]
    scale = 1.0 + 1e-6 * odometer.scale_sd_ppm * generator("scale").standard_normal()
    road = _integral(speed, step_s)
    counted = _integral(scale * (1.0 + slip) * speed, step_s) / odometer.pulse_m
    true_ns, stamped_ns = stamp_times(odometer, edges_s[1:], start_ns, generator)
    return SensorLog(
        kind="odometer",
        time_ns=stamped_ns,
        columns={"pulse_count": np.floor(counted + generator("phase").random()).astype(np.int64)},
        meta={"interval_s": step_s, "pulse_m": odometer.pulse_m},
        truth={
            "time_ns": true_ns,
            "distance_m": road,
            "speed_mps": speed[4::4],
            "scale": np.full(n, scale),
            "slip": slip[4::4],
        },
    )


def distance_from_pulses(
    odometer: OdometerDescription, pulse_count: np.ndarray, *, scale: float | np.ndarray = 1.0
) -> np.ndarray:
    """Road since the start, metres; good to one pulse, with the scale that a filter has found."""
    return np.asarray(pulse_count) * odometer.pulse_m / scale


def _integral(values: np.ndarray, step_s: float) -> np.ndarray:
    """Integral from the start to each sample: Simpson's rule over the halves of each interval."""
    halves = (values[:-1:2] + 4.0 * values[1::2] + values[2::2]) * (step_s / 12.0)
    return np.cumsum(halves.reshape(-1, 2).sum(axis=1))
