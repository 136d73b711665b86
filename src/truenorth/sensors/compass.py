r"""Electronic compass: a three-axis magnetometer in the field of the Earth and of what stands around it.

With the field ``B`` of the Earth (north, east, down, from the IGRF), the attitude ``C =
rot_ned_from_body``, the iron of the vehicle and a passing disturbance d, the magnetometer sees in body
axes::

    m = S (C^T B + d) + h              S: soft iron, h: hard iron
    heading = atan2(-l_y, l_x),        l = R_y(pitch) R_x(roll) m,     heading_true = heading + declination

Besides these, the error of the heading in the field of a town is a first-order Gauss-Markov process (it
wanders with what the vehicle passes) around a mean; at rest it is smaller. It is applied to the level
field, so heading and field components agree. Passing cars are Poisson events: a disturbance of random
direction that swells and fades.

The anomaly flag is what the module's detector says: either that the strength of the field or its vertical
part departs from a stored reference (`threshold`), or a coin that knows nothing of the error
(`independent`), as Harvey found it to be: raised for 61 per cent of his drive and no use.

The defaults describe the Precision Navigation TCM2-50 in the source: 5.8 deg, 10 s or longer, mean -1.2
deg, resolution 0.1 deg. Assumed: the error at rest, and rate, strength and duration of the anomalies.

References
----------
R. S. Harvey, Development of a Precision Pointing System Using an Integrated Multi-Sensor Approach,
UCGE Report 20117, University of Calgary (1998), ch. 5 and 7.
P. Alken et al., "International Geomagnetic Reference Field: the thirteenth generation", Earth, Planets and
Space 73:49 (2021); the coefficients are those of the installed ``ppigrf``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import msgspec
import numpy as np

from ..errors import ConfigError
from ..frames import geodetic_from_ecef
from ..rotations import rot_ned_from_body
from ..sensor_log import SensorLog
from ..timescales import gpst_to_datetime64
from .checks import refuse, require, require_not_negative, require_positive
from .kinematics import Mover
from .processes import gauss_markov, poisson_events, sum_of_events
from .sampling import GeneratorByName, SampledSensor, blocks, quantise, sample_times_s, stamp_times
from .tilt import moving_share

__all__ = [
    "CompassDescription",
    "MagneticEvent",
    "correct_iron",
    "declination_rad",
    "earth_field_ned_nt",
    "magnetic_heading",
    "simulate_compass",
]


class MagneticEvent(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A ``[[sensors.compass.events]]`` table: one disturbance on schedule."""

    start_s: float
    duration_s: float
    peak_body_nt: tuple[float, float, float]
    """At its middle: forward, right, down."""

    def __post_init__(self) -> None:
        require_positive(self, "duration_s")
        require(self, "start_s", "peak_body_nt", test=lambda _: True, wanted="finite numbers")


class CompassDescription(SampledSensor, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The ``[sensors.compass]`` table: an electronic compass with tilt compensation."""

    phase_s: float = 0.07
    time_tag_step_s: float = 0.055
    """Stamped by the clock of a PC."""
    mean_error_deg: float = -1.2
    """Mean of the heading error."""
    error_moving_deg: float = 5.8
    """Standard deviation of the wandering heading error on the road."""
    error_static_deg: float = 2.0
    """The same at rest."""
    error_time_constant_s: float = 10.0
    hard_iron_body_nt: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Field of the vehicle's permanent magnets that the calibration has left: forward, right, down."""
    soft_iron: tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]] = (
        (1.0, 0.0, 0.0),
        (0.0, 1.0, 0.0),
        (0.0, 0.0, 1.0),
    )
    """How the vehicle's iron bends the field, rows of the matrix in body axes."""
    noise_nt: float = 20.0
    """White noise of each magnetometer."""
    anomalies_per_minute: float = 0.5
    """Passing cars."""
    anomaly_sd_nt: float = 3000.0
    """Standard deviation of each component of the field of a passing car at its nearest."""
    anomaly_duration_s: float = 4.0
    """Mean time in which a car passes; single ones scatter by a factor of 2 either way."""
    events: tuple[MagneticEvent, ...] = ()
    """Disturbances on schedule."""
    anomaly_flag: Literal["independent", "threshold", "off"] = "independent"
    """What raises the flag; see the module."""
    anomaly_flag_share: float = 0.61
    """Of the independent flag: share of the samples with the flag raised."""
    anomaly_flag_time_constant_s: float = 5.0
    """Of the independent flag: time after which it is thrown anew."""
    anomaly_threshold_nt: float = 2000.0
    """Departure of the field's strength or vertical part that raises the flag."""
    tilt_compensation: Literal["attitude", "tilt"] = "attitude"
    """What levels the field: the true pitch and roll (the errors of the module's own tilt meter are then
    part of the wandering error, as in the figures of the source), or the readings of the simulated tilt
    meter."""
    resolution_deg: float = 0.1

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(
            self,
            "error_moving_deg",
            "error_static_deg",
            "error_time_constant_s",
            "noise_nt",
            "anomalies_per_minute",
            "anomaly_sd_nt",
            "resolution_deg",
        )
        require_positive(self, "anomaly_duration_s", "anomaly_flag_time_constant_s", "anomaly_threshold_nt")
        require(self, "mean_error_deg", test=lambda deg: abs(deg) <= 180.0, wanted="an angle up to 180")
        require(self, "hard_iron_body_nt", test=lambda _: True, wanted="finite numbers")
        require(
            self, "anomaly_flag_share", test=lambda share: 0.0 <= share <= 1.0, wanted="a share from 0 to 1"
        )
        if not np.linalg.det(self.soft_iron) > 0.0:
            refuse("soft_iron", self.soft_iron, "a matrix with a positive determinant")


def earth_field_ned_nt(
    latitude_rad: float, longitude_rad: float, height_m: float, time_ns: int
) -> np.ndarray:
    """Magnetic field of the Earth's core by the IGRF.

    Parameters
    ----------
    latitude_rad, longitude_rad : float
        Geodetic place, radians.
    height_m : float
        Height above the ellipsoid, metres.
    time_ns : int
        GPS time, nanoseconds.

    Returns
    -------
    ndarray, shape (3,)
        North, east, down; nanotesla.

    Raises
    ------
    ConfigError
        If the date lies outside the years of the model.
    """
    import ppigrf

    date = gpst_to_datetime64(time_ns).astype("datetime64[us]").item()
    years = ppigrf.ppigrf.read_shc()[0].index
    if not years[0] <= date <= years[-1]:
        raise ConfigError(
            f"could not take the magnetic field of {date:%Y-%m-%d}: the model holds {years[0]:%Y} to "
            f"{years[-1]:%Y}; give a date in these years",
            key="start",
            value=str(date),
        )
    east, north, up = ppigrf.igrf(np.degrees(longitude_rad), np.degrees(latitude_rad), height_m / 1e3, date)
    return np.array([north.item(), east.item(), -up.item()])


def declination_rad(latitude_rad: float, longitude_rad: float, height_m: float, time_ns: int) -> float:
    """Angle from true to magnetic north by the IGRF, clockwise positive, radians.

    Arguments as `earth_field_ned_nt`; a magnetic heading plus the declination is a true heading.
    """
    north, east, _ = earth_field_ned_nt(latitude_rad, longitude_rad, height_m, time_ns)
    return float(np.arctan2(east, north))


def magnetic_heading(field_body: np.ndarray, pitch_rad: np.ndarray, roll_rad: np.ndarray) -> np.ndarray:
    """Heading against magnetic north from a field in body axes and the tilt.

    Parameters
    ----------
    field_body : ndarray, shape (n, 3)
        Forward, right, down; any unit.
    pitch_rad, roll_rad : ndarray, shape (n,)
        Tilt of the body, radians.

    Returns
    -------
    ndarray, shape (n,)
        Radians in [0, 2 pi).
    """
    level = _level(field_body, pitch_rad, roll_rad)
    return np.mod(np.arctan2(-level[:, 1], level[:, 0]), 2.0 * np.pi)


def correct_iron(compass: CompassDescription, field_body_nt: np.ndarray) -> np.ndarray:
    """Field without the vehicle's iron, shape (n, 3): ``S^-1 (m - h)``, nanotesla."""
    return np.linalg.solve(
        np.array(compass.soft_iron), (field_body_nt - np.array(compass.hard_iron_body_nt)).T
    ).T


def simulate_compass(
    compass: CompassDescription,
    mover: Mover,
    *,
    start_ns: int,
    duration_s: float,
    generator: GeneratorByName,
    tilt_readings: Mapping[str, np.ndarray] | None = None,
) -> SensorLog:
    """Readings of an electronic compass that rides on a moving body.

    Parameters
    ----------
    compass : CompassDescription
        The sensor.
    mover : object with ``at(time_s)``
        Motion of the body.
    start_ns : int
        GPS time of the start, nanoseconds; the field of the Earth is that of this place and time.
    duration_s : float
        Length of the record, seconds.
    generator : callable
        Random generators by name.
    tilt_readings : mapping, optional
        Columns of the tilt meter of the same module (same rate and phase), for
        ``tilt_compensation = "tilt"``.

    Returns
    -------
    SensorLog
        Columns ``heading_magnetic_deg``, ``field_forward_nt``, ``field_right_nt``, ``field_down_nt``,
        ``anomaly`` (1: raised); truth ``time_ns``, ``heading_rad`` (against true north), ``wander_rad``
        (mean error and Gauss-Markov process), ``anomaly_nt`` (size of all passing disturbances),
        ``error_rad`` (reading minus true magnetic heading).
    """
    edges_s = sample_times_s(compass, duration_s)
    time_s, n = edges_s[1:], len(edges_s) - 1
    step_s = 1.0 / compass.rate_hz
    latitude, longitude, height = geodetic_from_ecef(mover.at(np.zeros(1)).position_ecef_m[0])
    earth = earth_field_ned_nt(float(latitude), float(longitude), float(height), start_ns)
    declination = np.arctan2(earth[1], earth[0])

    heading, pitch, roll, speed = (np.empty(n) for _ in range(4))
    for rows in blocks(n):
        motion = mover.at(time_s[rows])
        heading[rows], pitch[rows], roll[rows] = motion.heading_rad, motion.pitch_rad, motion.roll_rad
        speed[rows] = np.linalg.norm(motion.velocity_ecef_mps, axis=-1)
    share = moving_share(speed)
    wander = gauss_markov(generator("wander"), n, step_s, 1.0, compass.error_time_constant_s)
    wander *= np.sqrt(share * compass.error_moving_deg**2 + (1.0 - share) * compass.error_static_deg**2)
    wander = np.radians(wander + compass.mean_error_deg)

    disturbance = _disturbance(compass, time_s, duration_s, generator)
    # Turning the level field by the wander makes field and heading agree.
    seen = np.einsum("nji,j->ni", rot_ned_from_body(heading + wander, pitch, roll), earth)
    field = (seen + disturbance) @ np.array(compass.soft_iron).T + compass.hard_iron_body_nt
    field += compass.noise_nt * generator("noise").standard_normal((n, 3))
    if compass.tilt_compensation == "tilt":
        if tilt_readings is None or len(tilt_readings["pitch_deg"]) != n:
            raise ConfigError(
                '`compass.tilt_compensation` is "tilt", but no tilt meter with the same rate and phase is '
                'aboard; describe one, or give "attitude"',
                key="compass.tilt_compensation",
                value="tilt",
            )
        used_pitch, used_roll = (np.radians(tilt_readings[key]) for key in ("pitch_deg", "roll_deg"))
    else:
        used_pitch, used_roll = pitch, roll
    measured = np.degrees(magnetic_heading(field, used_pitch, used_roll))
    reading = np.mod(quantise(measured, compass.resolution_deg), 360.0)

    true_ns, stamped_ns = stamp_times(compass, time_s, start_ns, generator)
    error = np.radians(reading) - (heading - declination)
    return SensorLog(
        kind="compass",
        time_ns=stamped_ns,
        columns={
            "heading_magnetic_deg": reading,
            "field_forward_nt": field[:, 0],
            "field_right_nt": field[:, 1],
            "field_down_nt": field[:, 2],
            "anomaly": _flag(compass, field, earth, used_pitch, used_roll, step_s, generator),
        },
        meta={"interval_s": step_s, "declination_deg": float(np.degrees(declination))},
        truth={
            "time_ns": true_ns,
            "heading_rad": heading,
            "wander_rad": wander,
            "anomaly_nt": np.linalg.norm(disturbance, axis=1),
            "error_rad": np.mod(error + np.pi, 2.0 * np.pi) - np.pi,
        },
    )


def _level(field_body: np.ndarray, pitch_rad: np.ndarray, roll_rad: np.ndarray) -> np.ndarray:
    """Field in the level frame that is turned to the heading, shape (n, 3)."""
    zero = np.zeros(len(field_body))
    return np.einsum("nij,nj->ni", rot_ned_from_body(zero, pitch_rad, roll_rad), field_body)


def _disturbance(
    compass: CompassDescription, time_s: np.ndarray, duration_s: float, generator: GeneratorByName
) -> np.ndarray:
    """Field of passing cars and of the events on schedule, body axes, shape (n, 3), nT."""
    rng = generator("anomalies")
    start = poisson_events(rng, compass.anomalies_per_minute / 60.0, duration_s)
    length = compass.anomaly_duration_s * 2.0 ** rng.uniform(-1.0, 1.0, len(start))
    peak = compass.anomaly_sd_nt * rng.standard_normal((len(start), 3))
    total = sum_of_events(time_s, start, length, peak)
    if compass.events:
        start_s = [event.start_s for event in compass.events]
        duration = [event.duration_s for event in compass.events]
        total += sum_of_events(time_s, start_s, duration, [event.peak_body_nt for event in compass.events])
    return total


def _flag(
    compass: CompassDescription,
    field: np.ndarray,
    earth: np.ndarray,
    pitch_rad: np.ndarray,
    roll_rad: np.ndarray,
    step_s: float,
    generator: GeneratorByName,
) -> np.ndarray:
    """The anomaly flag of each sample, 0 or 1."""
    n = len(field)
    if compass.anomaly_flag == "threshold":
        down = _level(field, pitch_rad, roll_rad)[:, 2]
        strength = np.linalg.norm(field, axis=1) - np.linalg.norm(earth)
        departure = np.maximum(np.abs(strength), np.abs(down - earth[2]))
        return (departure > compass.anomaly_threshold_nt).astype(np.int64)
    if compass.anomaly_flag == "off" or n == 0:
        return np.zeros(n, dtype=np.int64)
    rng = generator("flag")
    thrown = rng.random(n) < -np.expm1(-step_s / compass.anomaly_flag_time_constant_s)
    raised = rng.random(n) < compass.anomaly_flag_share
    last = np.maximum.accumulate(np.where(thrown, np.arange(n), 0))
    return raised[last].astype(np.int64)
