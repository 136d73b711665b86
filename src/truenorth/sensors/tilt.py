r"""Two-axis liquid tilt meter: the apparent vertical through a damped oscillator, and its correction.

A liquid settles along the specific force f (body frame), so an accelerating vehicle sees an apparent
vertical; the liquid follows it as a damped oscillator of natural frequency w0 and damping z, one for each
axis u = pitch, roll::

    pitch_apparent = atan2(fx, |(fy, fz)|),     roll_apparent = atan2(-fy, -fz)
    x'' + 2 z w0 x' + w0^2 x = w0^2 u

The instrument adds broadband noise, far less at rest than on the road, an offset, its resolution and the end
of its range. Without the oscillator, an acceleration ``a`` ahead reads as nose up, ``a`` to the right as
right side up, each by ``atan(a / g)`` (Harvey 5.14); `correct_tilt` takes it off again, and
`spline_acceleration` supplies the acceleration from velocities (as Harvey does it, by a relaxed cubic spline
through three consecutive ones).

The defaults are those of the TCM2-50 in the source: resolution 0.3 deg, range 50 deg, and broadband errors
that leave 1.9 deg in pitch and 2.6 deg in roll after the correction, on a drive of which a third is at
rest. Assumed: natural frequency and damping, chosen so that the error falls to the noise in 0.3 s as the
source's autocorrelation does.

References
----------
R. S. Harvey, Development of a Precision Pointing System Using an Integrated Multi-Sensor Approach,
UCGE Report 20117, University of Calgary (1998), ch. 5 and 7.
"""

from __future__ import annotations

import numpy as np

from ..sensor_log import SensorLog
from ..strapdown import specific_force_body_mps2
from .checks import require, require_not_negative, require_positive
from .kinematics import Mover, apparent_tilt
from .processes import gauss_markov
from .sampling import GeneratorByName, SampledSensor, blocks, quantise, sample_times_s, stamp_times

__all__ = [
    "TiltDescription",
    "correct_tilt",
    "correct_tilt_simplified",
    "moving_share",
    "simulate_tilt",
    "spline_acceleration",
]


TILT_OUT_OF_RANGE = 2
"""Bit of the error code of the TCM2."""


class TiltDescription(SampledSensor, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The ``[sensors.tilt]`` table: a liquid tilt meter for pitch and roll."""

    phase_s: float = 0.07
    time_tag_step_s: float = 0.055
    """Stamped by the clock of a PC."""
    natural_frequency_hz: float = 1.5
    """Of the undamped liquid; 0: the liquid follows at once."""
    damping: float = 0.5
    """Share of critical damping."""
    offset_deg: tuple[float, float] = (0.0, 0.0)
    """Constant error of pitch and roll."""
    noise_moving_deg: tuple[float, float] = (2.2, 3.1)
    """Broadband error of pitch and roll on the road, one sigma: vibration that the liquid picks up."""
    noise_static_deg: tuple[float, float] = (0.1, 0.1)
    """The same at rest."""
    noise_time_constant_s: float = 0.25
    """Of the broadband error."""
    resolution_deg: float = 0.3
    range_deg: float = 50.0
    """Readings end at plus and minus this."""
    temperature_degc: float = 20.0
    """What the module's thermometer says."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(
            self,
            "natural_frequency_hz",
            "noise_moving_deg",
            "noise_static_deg",
            "noise_time_constant_s",
            "resolution_deg",
        )
        require_positive(self, "damping")
        require(self, "range_deg", test=lambda deg: 0.0 < deg < 90.0, wanted="an angle between 0 and 90")
        require(self, "offset_deg", test=lambda deg: abs(deg) < 90.0, wanted="angles below 90")


def moving_share(speed_mps: np.ndarray) -> np.ndarray:
    """How far a vehicle is from standing: 0 at rest, half at 1 m/s, 1 on the road."""
    return np.square(speed_mps) / (1.0 + np.square(speed_mps))


def simulate_tilt(
    tilt: TiltDescription, mover: Mover, *, start_ns: int, duration_s: float, generator: GeneratorByName
) -> SensorLog:
    """Readings of a tilt meter that rides on a moving body.

    Parameters
    ----------
    tilt : TiltDescription
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
        Columns ``pitch_deg``, ``roll_deg``, ``temperature_degc``, ``error_code`` (2: out of range);
        truth ``time_ns`` and, each for pitch
        and roll: the attitude ``..._rad``, ``..._apparent_rad`` (bubble at once), ``..._liquid_rad``
        (bubble as it moves), ``..._noise_rad``.
    """
    edges_s = sample_times_s(tilt, duration_s)
    time_s, n = edges_s[1:], len(edges_s) - 1
    step_s = 1.0 / tilt.rate_hz
    # The liquid is followed in steps short against its period; the samples are every `parts`-th of them.
    parts = max(1, int(np.ceil(20.0 * tilt.natural_frequency_hz * step_s)))
    fine_s = edges_s[0] + np.arange(n * parts + 1) * (step_s / parts)
    apparent = np.empty((len(fine_s), 2))
    attitude, speed = np.empty((len(fine_s), 2)), np.empty(len(fine_s))
    for rows in blocks(len(fine_s)):
        motion = mover.at(fine_s[rows])
        apparent[rows] = np.stack(apparent_tilt(specific_force_body_mps2(motion)), axis=-1)
        attitude[rows] = np.stack([motion.pitch_rad, motion.roll_rad], axis=-1)
        speed[rows] = np.linalg.norm(motion.velocity_ecef_mps, axis=-1)
    liquid = follow(apparent, step_s / parts, tilt.natural_frequency_hz, tilt.damping)
    samples = slice(parts, None, parts)
    apparent, liquid, attitude, speed = (values[samples] for values in (apparent, liquid, attitude, speed))

    noise = gauss_markov(generator("noise"), (n, 2), step_s, 1.0, tilt.noise_time_constant_s)
    share = moving_share(speed)[:, None]
    moving, static = np.radians(tilt.noise_moving_deg), np.radians(tilt.noise_static_deg)
    noise = noise * np.sqrt(share * moving**2 + (1.0 - share) * static**2)
    reading = np.degrees(liquid + noise) + tilt.offset_deg
    reading = quantise(reading, tilt.resolution_deg)
    outside = (np.abs(reading) > tilt.range_deg).any(axis=1)
    reading = np.clip(reading, -tilt.range_deg, tilt.range_deg)

    true_ns, stamped_ns = stamp_times(tilt, time_s, start_ns, generator)
    truth = {"time_ns": true_ns}
    for k, angle in enumerate(("pitch", "roll")):
        truth[f"{angle}_rad"] = attitude[:, k]
        truth[f"{angle}_apparent_rad"] = apparent[:, k]
        truth[f"{angle}_liquid_rad"] = liquid[:, k]
        truth[f"{angle}_noise_rad"] = noise[:, k]
    return SensorLog(
        kind="tilt",
        time_ns=stamped_ns,
        columns={
            "pitch_deg": reading[:, 0],
            "roll_deg": reading[:, 1],
            "temperature_degc": np.full(n, tilt.temperature_degc),
            "error_code": np.where(outside, TILT_OUT_OF_RANGE, 0),
        },
        meta={"interval_s": step_s},
        truth=truth,
    )


def follow(angle: np.ndarray, step_s: float, frequency_hz: float, damping: float) -> np.ndarray:
    """Answer of a damped oscillator to an angle that changes linearly between its samples.

    Parameters
    ----------
    angle : ndarray, shape (n, k)
        What it is drawn to.
    step_s : float
        Time between samples, seconds.
    frequency_hz : float
        Natural frequency; 0 gives the input back.
    damping : float
        Share of critical damping.

    Returns
    -------
    ndarray, shape (n, k)
        At rest on the first sample. Exact for the piecewise linear input (first-order hold).
    """
    if frequency_hz == 0.0 or len(angle) == 0:
        return angle.copy()
    from scipy.signal import cont2discrete, lfilter, lfilter_zi

    w0 = 2.0 * np.pi * frequency_hz
    system = ([w0**2], [1.0, 2.0 * damping * w0, w0**2])
    numerator, denominator, _ = cont2discrete(system, step_s, method="foh")
    numerator = np.ravel(numerator)
    rest = np.multiply.outer(lfilter_zi(numerator, denominator), angle[0])
    return lfilter(numerator, denominator, angle, axis=0, zi=rest)[0]


def correct_tilt_simplified(
    pitch_rad: np.ndarray,
    roll_rad: np.ndarray,
    forward_mps2: np.ndarray,
    right_mps2: np.ndarray,
    *,
    gravity_mps2: float = 9.81,
) -> tuple[np.ndarray, np.ndarray]:
    """Take the acceleration off tilt readings by ``atan(a / g)`` (Harvey 5.14).

    Parameters
    ----------
    pitch_rad, roll_rad : ndarray, shape (n,)
        Readings, radians.
    forward_mps2, right_mps2 : ndarray, shape (n,)
        Horizontal acceleration of the vehicle along its heading and to its right, m/s^2.
    gravity_mps2 : float
        Gravity.

    Returns
    -------
    pitch_rad, roll_rad : ndarray, shape (n,)
        Acceleration ahead had read as nose up, acceleration to the right as right side up.
    """
    return (
        pitch_rad - np.arctan(forward_mps2 / gravity_mps2),
        roll_rad + np.arctan(right_mps2 / gravity_mps2),
    )


def correct_tilt(
    pitch_rad: np.ndarray,
    roll_rad: np.ndarray,
    forward_mps2: np.ndarray,
    right_mps2: np.ndarray,
    *,
    down_mps2: np.ndarray | float = 0.0,
    gravity_mps2: float | np.ndarray = 9.81,
) -> tuple[np.ndarray, np.ndarray]:
    """Pitch and roll from the apparent ones and the acceleration, exactly for an ideal bubble.

    Parameters
    ----------
    pitch_rad, roll_rad : ndarray, shape (n,)
        Readings, radians.
    forward_mps2, right_mps2, down_mps2 : ndarray, shape (n,)
        Acceleration in the level frame that is turned to the vehicle's heading, m/s^2.
    gravity_mps2 : float or ndarray
        Gravity.

    Returns
    -------
    pitch_rad, roll_rad : ndarray, shape (n,)

    Notes
    -----
    The reading gives the direction of the specific force in the body, ``f = |f| (sin p, -cos p sin r,
    -cos p cos r)``; in the level frame it is ``(a_forward, a_right, a_down - g)``. Pitch leaves the
    component to the right alone, so it gives the roll; the two others then give the pitch.
    """
    forward, right, down = np.broadcast_arrays(
        np.asarray(forward_mps2, dtype=float),
        np.asarray(right_mps2, dtype=float),
        np.asarray(down_mps2, dtype=float) - gravity_mps2,
    )
    size = np.sqrt(forward**2 + right**2 + down**2)
    x = size * np.sin(pitch_rad)
    across = size * np.cos(pitch_rad)
    # a_right = -across sin(reading - roll): roll turns the force in the plane of y and z.
    roll = roll_rad + np.arcsin(np.clip(right / across, -1.0, 1.0))
    z = -across * np.cos(roll_rad - roll)
    pitch = np.arctan2(x, -z) - np.arctan2(forward, -down)
    return pitch, roll


def spline_acceleration(
    time_s: np.ndarray, velocity_mps: np.ndarray, at_s: np.ndarray, *, longest_gap_s: float = 1.5
) -> np.ndarray:
    """Acceleration from velocities: a relaxed cubic spline through three in a row, differentiated.

    Parameters
    ----------
    time_s : ndarray, shape (m,)
        Rising instants of the velocities, seconds.
    velocity_mps : ndarray, shape (m, k)
        Velocities; NaN where there is none.
    at_s : ndarray, shape (n,)
        Instants of the accelerations. Each lies in the later half of its spline (in the earlier half before
        the second velocity), so that a process in real time waits for one velocity and no more.
    longest_gap_s : float
        Nothing is interpolated over longer gaps.

    Returns
    -------
    ndarray, shape (n, k)
        m/s^2; NaN where three velocities in a row are missing.

    Notes
    -----
    With steps h1, h2, slopes s1, s2 and no curvature at both ends, the curvature in the middle is
    ``M = 3 (s2 - s1) / (h1 + h2)``; in the later half ``v' = s2 + M (h2 / 6 - (t2 - t)^2 / (2 h2))`` and in
    the earlier ``v' = s1 - M (h1 / 6 - (t - t0)^2 / (2 h1))``.
    """
    time_s, at_s = np.asarray(time_s, dtype=float), np.asarray(at_s, dtype=float)
    velocity = np.asarray(velocity_mps, dtype=float)
    velocity = velocity.reshape(len(time_s), -1)
    given = np.isfinite(velocity).all(axis=1)
    time_s, velocity = time_s[given], velocity[given]
    if len(time_s) < 3:
        return np.full((len(at_s), velocity.shape[1]), np.nan)
    interval = np.clip(np.searchsorted(time_s, at_s, side="right") - 1, 0, len(time_s) - 2)
    middle = np.maximum(interval, 1)
    t0, t1, t2 = time_s[middle - 1], time_s[middle], time_s[middle + 1]
    h1, h2 = t1 - t0, t2 - t1
    s1 = (velocity[middle] - velocity[middle - 1]) / h1[:, None]
    s2 = (velocity[middle + 1] - velocity[middle]) / h2[:, None]
    curvature = 3.0 * (s2 - s1) / (h1 + h2)[:, None]
    late = s2 + curvature * (h2 / 6.0 - (t2 - at_s) ** 2 / (2.0 * h2))[:, None]
    early = s1 - curvature * (h1 / 6.0 - (at_s - t0) ** 2 / (2.0 * h1))[:, None]
    rate = np.where((interval >= 1)[:, None], late, early)
    inside = (at_s >= time_s[0]) & (at_s <= time_s[-1]) & (np.maximum(h1, h2) <= longest_gap_s)
    return np.where(inside[:, None], rate, np.nan)
