r"""North from an accelerometer on a turntable: which way the Coriolis acceleration points.

Two methods. The square wave correlates each revolution with the signs of cosine and sine of the table's angle
(Oguz 2006, eq. 5.13 to 5.18),

.. math::
    A = \int_0^T f\, \mathrm{sgn}(\cos \Omega t)\, dt = 8 w_N \rho \cos\psi, \qquad
    B = -\int_0^T f\, \mathrm{sgn}(\sin \Omega t)\, dt = 8 w_N \rho \sin\psi, \qquad
    \hat\psi = \mathrm{atan2}(B, A),

psi counter-clockwise from north to the place of angle zero. Maximum likelihood fits constant, sine, and what
disturbs it, to all samples at once (`truenorth.northfinding.turntable_fit`), and turns the harmonic into a
heading by the exact geometry of a table whose tilt is known (`truenorth.northfinding.turntable_signal`).

Logs of the same table at different speeds, best in opposite directions, separate the Earth rate from gravity
felt by a leaning axis on a tilted table: ``h(Omega) = K(Omega) w_h + d`` with the same d.

References
----------
P. Oguz, Implementation of Northfinding Techniques, M.Sc. thesis, Middle East Technical University (2006),
ch. 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import msgspec
import numpy as np

from ..errors import ConfigError, FormatError, NoSolutionError
from ..rotations import rot_ned_from_body
from ..sensor_log import SensorLog
from ..sensors.turntable_accelerometer import TurntableAccelerometerDescription
from ..timescales import NS_PER_S
from .site import Site
from .solution import BudgetLine, ErrorBudget, NorthRun, NorthSolution, Verdict
from .turntable_design import heading_crlb_rad, square_wave_heading_sd_rad
from .turntable_fit import HarmonicFit, fit_harmonic, wandering_phase
from .turntable_signal import (
    TableGeometry,
    heading_from_harmonic_rad,
    heading_jacobian,
    inclination_error_rad,
    table_geometry,
)

__all__ = [
    "TurntableNorth",
    "demodulate",
    "describe_turntable",
    "find_north_turntable",
    "heading_crlb_rad",
    "inclination_error_rad",
    "turntable_budget",
]

Method = Literal["maximum-likelihood", "square-wave"]

KIND = "turntable_accelerometer"

_MIN_SIGNAL_SD = 4.0
"""Below so many sigma an amplitude is no signal."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TurntableNorth(NorthSolution):
    """North from a rotating accelerometer; a `NorthSolution` with what its revolutions say.

    Parameters
    ----------
    sensor : TurntableAccelerometerDescription
        What was assumed of the device.
    revolution_heading_rad : ndarray, shape (n,)
        Heading from each whole revolution by itself, in [0, 2 pi).
    revolution_sd_rad : float
        Standard deviation of one of them.
    revolution_time_s : ndarray, shape (n,)
        Ends of the revolutions, seconds since the first sample.
    amplitude_mps2 : float
        Of the signal that was found.
    amplitude_sd_mps2 : float
        Its standard deviation.
    expected_amplitude_mps2 : float
        Of the signal at this latitude, tilt and heading.
    crlb_rad : float
        Least standard deviation that any method can have with the noise of the residuals; without an encoder
        with an unknown speed.
    fits : tuple of HarmonicFit
        The fits of the logs.
    """

    sensor: TurntableAccelerometerDescription
    revolution_heading_rad: np.ndarray
    revolution_sd_rad: float
    revolution_time_s: np.ndarray
    amplitude_mps2: float
    amplitude_sd_mps2: float
    expected_amplitude_mps2: float
    crlb_rad: float
    fits: tuple[HarmonicFit, ...] = field(default=())

    @property
    def heading_sd_rad(self) -> float:
        """float: Standard deviation of the heading, everything stated included."""
        return float(self.angle_sd_rad[0])

    @property
    def revolution_scatter_rad(self) -> float:
        """float: Standard deviation of the headings of the revolutions about the heading found."""
        off = np.mod(self.revolution_heading_rad - self.heading_rad + np.pi, 2.0 * np.pi) - np.pi
        return float(np.std(off, ddof=1)) if len(off) > 1 else np.nan


def describe_turntable(log: SensorLog) -> TurntableAccelerometerDescription:
    """What a log says of its device.

    Parameters
    ----------
    log : SensorLog
        Of kind ``turntable_accelerometer``, with ``radius_m``, ``table_rate_radps`` and
        ``samples_per_revolution`` beside the columns, and ``mark_deg`` unless it is 0.

    Returns
    -------
    TurntableAccelerometerDescription
        Without noise or other errors.

    Raises
    ------
    FormatError
        If the log is of another sensor or does not say what is needed.
    """
    _check_kind(log)
    values: dict[str, float] = {}
    for key in ("radius_m", "table_rate_radps", "samples_per_revolution", "mark_deg"):
        value = log.meta.get(key, 0.0 if key == "mark_deg" else None)
        if not isinstance(value, int | float) or not np.isfinite(value):
            raise FormatError(
                f"the log of the turntable does not say {key}; give a line `# {key} = ...` at its head or the"
                " description of the device"
            )
        values[key] = float(value)
    return TurntableAccelerometerDescription(
        radius_m=values["radius_m"],
        table_rpm=values["table_rate_radps"] * 30.0 / np.pi,
        samples_per_revolution=round(values["samples_per_revolution"]),
        mark_deg=values["mark_deg"],
        noise_mps2=0.0,
    )


def demodulate(sensor: TurntableAccelerometerDescription, log: SensorLog) -> tuple[np.ndarray, np.ndarray]:
    """Heading of the body from each revolution by square-wave demodulation (Oguz 5.13 to 5.18).

    Parameters
    ----------
    sensor : TurntableAccelerometerDescription
        Gives samples in a revolution, the mark and the direction of rotation.
    log : SensorLog
        Whole revolutions.

    Returns
    -------
    heading_rad : ndarray, shape (revolutions,)
        Clockwise from true north in [0, 2 pi), as on a level table.
    amplitude_mps2 : ndarray, shape (revolutions,)
        Of the signal.

    Raises
    ------
    FormatError
        If the samples are no whole number of revolutions.

    Notes
    -----
    ``psi = atan2(B, A)`` is the counter-clockwise angle from north to the place of angle zero, so the heading
    is ``mark - psi``. The mean of each revolution is taken off before, so that gravity does not leak through
    an odd number of samples.
    """
    harmonic = _demodulated(sensor, log.columns["acceleration_mps2"], log.columns["table_angle_rad"])
    north = np.sign(sensor.table_rpm) * harmonic
    heading = np.mod(np.arctan2(-north[:, 1], north[:, 0]), 2.0 * np.pi)
    return heading, np.hypot(north[:, 0], north[:, 1])


def _demodulated(
    sensor: TurntableAccelerometerDescription, signal: np.ndarray, angle: np.ndarray
) -> np.ndarray:
    """Vector h of each revolution by square waves."""
    per_turn = sensor.samples_per_revolution
    if len(signal) == 0 or len(signal) % per_turn:
        raise FormatError(
            f"the square wave needs whole revolutions of {per_turn} samples, the log has {len(signal)}; "
            "cut it there, or use the maximum-likelihood method"
        )
    if missing := int(np.count_nonzero(~(np.isfinite(signal) & np.isfinite(angle)))):
        raise FormatError(
            f"the square wave needs every sample of a revolution and {missing} are missing; use the "
            "maximum-likelihood method"
        )
    signal = signal.reshape(-1, per_turn)
    angle = angle.reshape(-1, per_turn)
    signal = signal - signal.mean(axis=1, keepdims=True)
    # Taken half a step late, no sample falls on an edge of the square waves.
    late = np.sign(sensor.table_rpm) * np.pi / per_turn
    a = (signal * np.sign(np.cos(angle + late))).sum(axis=1)
    b = -(signal * np.sign(np.sin(angle + late))).sum(axis=1)
    # psi_ccw is the mark less the bearing of the signal's maximum.
    bearing = np.radians(sensor.mark_deg) - np.arctan2(b, a) - late
    amplitude = np.hypot(a, b) * np.pi / (2.0 * per_turn)
    return np.stack([amplitude * np.cos(bearing), -amplitude * np.sin(bearing)], axis=1)


def find_north_turntable(
    log: SensorLog | Sequence[SensorLog],
    site: Site,
    *,
    description: TurntableAccelerometerDescription | None = None,
    method: Method = "maximum-likelihood",
    tilt_rad: tuple[float, float] | None = None,
    tilt_sd_rad: float = 0.0,
    lean_sd_rad: float = 0.0,
    mark_sd_rad: float = 0.0,
    encoder: bool = True,
    harmonics: int = 1,
    max_vibrations: int = 4,
    speed_terms: bool = True,
    required_heading_sd_rad: float = np.radians(1.0),
) -> TurntableNorth:
    """Heading of a platform from the log of its rotating accelerometer.

    Parameters
    ----------
    log : SensorLog or sequence of SensorLog
        Columns ``acceleration_mps2`` and ``table_angle_rad``. Several logs of one table at different speeds,
        the platform at rest between, are solved together: they separate the lean of the axis.
    site : Site
        Where.
    description : TurntableAccelerometerDescription, optional
        What is known of the device: radius, mark, its tilt in the platform and the lean of its axis are used
        and corrected; noise, vibration, jitter and encoder give the budget. By default what the log says.
    method : {"maximum-likelihood", "square-wave"}
        How the signal is found. The square wave suffers what maximum likelihood takes for unknown, and sigma
        says so.
    tilt_rad : tuple of float, optional
        Pitch and roll of the platform, e.g. from a tilt meter; level by default.
    tilt_sd_rad : float
        How well each is known, one sigma.
    lean_sd_rad : float
        How well each lean of the axis is known; harmless where several speeds are combined.
    mark_sd_rad : float
        How well the angle between mark and platform is known.
    encoder : bool
        Whether the table's angle of the log is used; without it the speed is estimated, and the log must
        begin at the mark. The square wave always uses it.
    harmonics, max_vibrations, speed_terms
        As in `truenorth.northfinding.turntable_fit.fit_harmonic`.
    required_heading_sd_rad : float
        Sigma that is needed: the verdict tells whether the described device has it here in this time.

    Returns
    -------
    TurntableNorth

    Raises
    ------
    FormatError
        If the log is of another sensor or lacks columns, or is no whole number of revolutions for the square
        wave.
    NoSolutionError
        If there is no signal, or one that cannot be the Earth's rotation, or the sensor was saturated.
    """
    logs = (log,) if isinstance(log, SensorLog) else tuple(log)
    if not logs:
        raise ConfigError("no log of the turntable was given; give one, or one for each speed")
    if method not in ("maximum-likelihood", "square-wave"):
        raise ConfigError(
            f"there is no method {method!r} for the turntable; use maximum-likelihood or square-wave",
            key="method",
            value=method,
        )
    square = method == "square-wave"
    encoder = encoder or square
    sensors = tuple(_sensor_of(one, description) for one in logs)
    for one, sensor in zip(logs, sensors, strict=True):
        _check_log(one, sensor, encoder)
    tilt = (0.0, 0.0) if tilt_rad is None else tilt_rad
    notes: list[str] = []
    if tilt_rad is None:
        notes.append(
            "The platform was taken as level; a tilt turns the azimuth by about tilt times tan(latitude)."
        )
    fits = tuple(
        _fit(one, sensor, encoder, harmonics, max_vibrations, speed_terms)
        for one, sensor in zip(logs, sensors, strict=True)
    )
    geometry = table_geometry(sensors[0], site, tilt_rad=tilt)
    gains = np.array([geometry.gain_mps(fit.rate_radps) for fit in fits])
    turns = tuple(
        _square_wave(one, sensor, fit) if square else _revolutions(one, fit)
        for one, sensor, fit in zip(logs, sensors, fits, strict=True)
    )
    rate_plane, cov_rate, lean = _combined(turns, gains, geometry)
    each, ends_s, running, running_cov = _growth(turns, gains, lean)
    if not encoder and len(logs) == 1:
        bearing = np.unwrap(np.arctan2(-each[:, 1], each[:, 0]))
        size = float(np.linalg.norm(rate_plane))
        floor = float(fits[0].noise.harmonics_sd[-1] / abs(gains[0]) / size)
        floor *= float(np.sqrt(2.0 * len(each) / len(fits[0].used)))
        if (wandered := wandering_phase(ends_s - 0.5 * ends_s[0], bearing, floor)) is not None:
            start, start_sd = wandered
            rate_plane = size * np.array([np.cos(start), -np.sin(start)])
            cov_rate = np.diag([(size * start_sd) ** 2] * 2)
            notes.append(
                "The speed of the table wanders and no encoder tells the angle: the first revolutions decide."
            )
    # All revolutions together are the result; what is common to them is paid for from the first.
    running[-1] = rate_plane
    running_cov *= np.trace(cov_rate) / np.trace(running_cov[-1])
    heading, north = (float(x) for x in heading_from_harmonic_rad(geometry, rate_plane))
    gradient = heading_jacobian(geometry, heading)
    noise_sd = float(np.sqrt(gradient @ cov_rate @ gradient))
    amplitude = float(np.linalg.norm(rate_plane)) * abs(float(gains[0]))
    expected = float(np.linalg.norm(geometry.rate_plane_radps(heading))) * abs(float(gains[0]))
    amplitude_sd = float(np.sqrt(np.linalg.eigvalsh(cov_rate)[-1])) * abs(float(gains[0]))
    _check_signal(amplitude, expected, amplitude_sd, site)
    if abs(amplitude / expected - 1.0) > 0.05 and abs(amplitude - expected) > 5.0 * amplitude_sd:
        notes.append(
            f"The signal is {100.0 * amplitude / expected:.0f} % of what latitude, radius and speed say; "
            "check them and the scale of the sensor."
        )

    if any(fit.noise.is_raised for fit in fits):
        notes.append(
            "Something disturbs beside the frequency of the table; nearer than one over the length of the "
            "record it cannot be told from the signal: record longer."
        )
    lean_matters = lean_sd_rad if len(logs) == 1 else 0.0
    cov_ned = np.zeros((3, 3))
    cov_ned[2, 2] = noise_sd**2 + mark_sd_rad**2
    cov_ned += _tilt_covariance(site, tilt_sd_rad)
    cov_ned[2, 2] += _lean_variance(geometry, site, gains[0], tilt_sd_rad, lean_matters)
    if site.latitude_sd_rad:
        cov_ned[2, 2] += (_latitude_slope(geometry, site, heading) * site.latitude_sd_rad) ** 2
    rot = rot_ned_from_body(heading, *tilt)
    length = sum(len(fit.used) for fit in fits)
    duration_s = float(sum(_seconds(one)[-1] for one in logs))
    headings = heading_from_harmonic_rad(geometry, each)[0]
    run_heading = heading_from_harmonic_rad(geometry, running)[0]
    run_sd = np.sqrt(np.einsum("i,nij,j->n", gradient, running_cov, gradient))
    other = cov_ned[2, 2] - noise_sd**2
    run_angles = np.stack([run_heading, *(np.full(len(each), angle) for angle in tilt)], axis=1)
    run = NorthRun(
        ends_s,
        run_angles,
        np.stack([np.sqrt(run_sd**2 + other), *(np.full(len(each), tilt_sd_rad),) * 2], axis=1),
    )
    budget = None
    if description is not None:
        budget = turntable_budget(
            msgspec.structs.replace(description, table_rpm=sensors[0].table_rpm),
            site,
            heading_rad=heading,
            tilt_rad=tilt,
            revolutions=max(1, round(length / description.samples_per_revolution)),
            method=method,
            tilt_sd_rad=tilt_sd_rad,
            lean_sd_rad=lean_matters,
            mark_sd_rad=mark_sd_rad,
        )
    noise = fits[0].noise
    measured = {
        "amplitude_mps2": amplitude,
        "expected_amplitude_mps2": expected,
        "earth_rate_north_dph": float(np.degrees(north)) * 3600.0,
        "table_rate_radps": fits[0].rate_radps,
        "mean_acceleration_mps2": fits[0].mean_mps2,
        "noise_mps2": noise.white_sd,
        "noise_at_signal_mps2": noise.signal_sd,
        "noise_order": float(noise.order),
        "samples_left_out": float(sum(np.count_nonzero(~fit.used) for fit in fits)),
        "vibration_lines": float(len(fits[0].vibrations)),
    }
    for k, (hz, size) in enumerate(fits[0].vibrations):
        measured[f"vibration_{k + 1}_hz"], measured[f"vibration_{k + 1}_mps2"] = float(hz), float(size)
    if len(logs) > 1:
        measured["lean_harmonic_mps2"] = float(np.linalg.norm(lean))
        plane = geometry.force_plane_mps2
        if (size := float(plane @ plane)) > 0.0 and tilt_rad is not None:
            measured["lean_outward_rad"] = float(plane @ lean / size)
            measured["lean_along_rad"] = float((plane[0] * lean[1] - plane[1] * lean[0]) / size)
    terms, term_sd = fits[0].speed_terms_mps2, fits[0].speed_terms_sd_mps2
    if terms is not None and term_sd is not None:
        inward = sensors[0].radius_m * fits[0].rate_radps ** 2
        measured["lean_outward_by_speed_rad"] = float(-terms[0] / inward)
        measured["lean_outward_by_speed_sd_rad"] = float(term_sd[0] / inward)
    solution = TurntableNorth(
        method=f"turntable {method}" + (f" of {len(logs)} speeds" if len(logs) > 1 else ""),
        site=site,
        time_s=float(_seconds(logs[-1])[-1]),
        duration_s=duration_s,
        rot_ned_from_body=rot,
        cov_ned_rad2=cov_ned,
        measured=measured,
        run=run,
        budget=budget,
        notes=tuple(notes),
        sensor=sensors[0],
        revolution_heading_rad=headings,
        revolution_sd_rad=float(run_sd[0]),
        revolution_time_s=ends_s,
        amplitude_mps2=amplitude,
        amplitude_sd_mps2=amplitude_sd,
        expected_amplitude_mps2=expected,
        crlb_rad=_bound_rad(fits, gains, expected / abs(float(gains[0])), encoder),
        fits=fits,
    )
    return _judged(solution, required_heading_sd_rad)


def turntable_budget(
    sensor: TurntableAccelerometerDescription,
    site: Site,
    *,
    heading_rad: float = 0.0,
    tilt_rad: tuple[float, float] = (0.0, 0.0),
    revolutions: int | None = None,
    method: Method = "maximum-likelihood",
    tilt_sd_rad: float = 0.0,
    lean_sd_rad: float = 0.0,
    mark_sd_rad: float = 0.0,
) -> ErrorBudget:
    """Where the error of the heading comes from, predicted from the stated errors of the device.

    Parameters
    ----------
    sensor : TurntableAccelerometerDescription
        Its noise, vibrations, jitter and encoder.
    site : Site
        Where.
    heading_rad : float
        Of the platform.
    tilt_rad : tuple of float
        Its pitch and roll.
    revolutions : int, optional
        By default those of the description.
    method : {"maximum-likelihood", "square-wave"}
        Maximum likelihood takes vibration lines that it can resolve, and the effects of an uneven speed that
        an encoder shows, for unknowns; the square wave suffers them.
    tilt_sd_rad, lean_sd_rad, mark_sd_rad : float
        As in `find_north_turntable`.

    Returns
    -------
    ErrorBudget
        Largest effect on the heading first.
    """
    geometry = table_geometry(sensor, site, tilt_rad=tilt_rad)
    turns = sensor.revolutions if revolutions is None else revolutions
    rate, per_turn = sensor.table_rate_radps, sensor.samples_per_revolution
    gain = geometry.gain_mps(rate)
    amplitude = abs(gain) * float(np.linalg.norm(geometry.rate_plane_radps(heading_rad)))
    published = method == "square-wave"
    white = square_wave_heading_sd_rad if published else heading_crlb_rad
    effects = [
        (
            "sensor noise",
            f"{sensor.noise_mps2:g} m/s^2 a sample",
            _about_down(white(amplitude, sensor.noise_mps2, per_turn, turns) ** 2),
        )
    ]
    turn_hz, length_s = abs(rate) / (2.0 * np.pi), turns * 2.0 * np.pi / abs(rate)
    for wave in sensor.vibrations:
        reached = 0.0
        for k in (1, 3, 5, 7) if published else (1,):
            off = (wave.frequency_hz - k * turn_hz) * length_s
            resolved = not published and abs(off) > 2.0
            reached += 0.0 if resolved else (np.sinc(off) / k) ** 2
        effects.append(
            (
                f"vibration at {wave.frequency_hz:g} Hz",
                f"{wave.amplitude_mps2:g} m/s^2",
                _about_down(0.5 * reached * (wave.amplitude_mps2 / amplitude) ** 2),
            )
        )
    if sensor.speed_jitter and published:
        constant_s = sensor.speed_jitter_time_constant_s
        density = 2.0 * constant_s * sensor.speed_jitter**2 / (1.0 + (rate * constant_s) ** 2)
        outward, along = geometry.lean_rad
        felt = sensor.radius_m * rate**2 * np.hypot(2.0 * outward, along)
        effects.append(
            (
                "speed jitter through the leaning axis",
                f"{sensor.speed_jitter:g} of the speed",
                _about_down(2.0 * density / length_s * (felt / amplitude) ** 2),
            )
        )
    if sensor.angle_noise_deg:
        sd = np.radians(sensor.angle_noise_deg)
        effects.append(
            ("encoder noise", f"{sensor.angle_noise_deg:g} deg", _about_down(sd**2 / (turns * per_turn)))
        )
    if tilt_sd_rad:
        effects.append(
            ("tilt", f"{np.degrees(tilt_sd_rad):.3g} deg an axis", _tilt_covariance(site, tilt_sd_rad))
        )
    if variance := _lean_variance(geometry, site, gain, tilt_sd_rad, lean_sd_rad):
        effects.append(("lean of the axis", f"{1e3 * lean_sd_rad:.3g} mrad an axis", _about_down(variance)))
    if mark_sd_rad:
        effects.append(("mark", f"{np.degrees(mark_sd_rad):.3g} deg", _about_down(mark_sd_rad**2)))
    if site.latitude_sd_rad:
        slope = _latitude_slope(geometry, site, heading_rad)
        effects.append(
            (
                "latitude",
                f"{np.degrees(site.latitude_sd_rad):.3g} deg",
                _about_down((slope * site.latitude_sd_rad) ** 2),
            )
        )
    lines = [BudgetLine(*effect) for effect in effects]
    lines.sort(key=lambda line: -float(line.cov_ned_rad2[2, 2]))
    return ErrorBudget(tuple(lines), rot_ned_from_body(heading_rad, *tilt_rad))


# ------------------------------------------------------------------------------------ pieces


def _fit(
    log: SensorLog,
    sensor: TurntableAccelerometerDescription,
    encoder: bool,
    harmonics: int,
    max_vibrations: int,
    speed_terms: bool,
) -> HarmonicFit:
    mark = np.radians(sensor.mark_deg)
    return fit_harmonic(
        _seconds(log),
        log.columns["acceleration_mps2"],
        angle_rad=log.columns["table_angle_rad"] + mark if encoder else None,
        rate_radps=sensor.table_rate_radps,
        start_angle_rad=mark,
        harmonics=harmonics,
        max_vibrations=max_vibrations,
        speed_terms=speed_terms,
    )


class _Turns(NamedTuple):
    """What one log says: its harmonic with covariance, and that of each whole revolution."""

    harmonic: np.ndarray
    cov: np.ndarray
    each: np.ndarray
    ends_s: np.ndarray


def _combined(
    turns: tuple[_Turns, ...], gains: np.ndarray, geometry: TableGeometry
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Earth rate in the plane, its covariance, and the harmonic of the leaning axis."""
    if len(turns) == 1:
        lean = geometry.lean_mps2
        return (turns[0].harmonic - lean) / gains[0], turns[0].cov / gains[0] ** 2, lean
    if np.ptp(gains) < 0.1 * np.max(np.abs(gains)):
        raise ConfigError(
            "the logs of the turntable have the same speed and direction; give runs at different speeds, "
            "best in opposite directions"
        )
    normal, right = np.zeros((4, 4)), np.zeros(4)
    scale = float(np.max(np.abs(gains)))
    for log, gain in zip(turns, gains, strict=True):
        design = np.hstack([np.eye(2) * gain / scale, np.eye(2)])
        weight = np.linalg.inv(log.cov)
        normal += design.T @ weight @ design
        right += design.T @ weight @ log.harmonic
    cov = np.linalg.inv(normal)
    found = cov @ right
    return found[:2] / scale, cov[:2, :2] / scale**2, found[2:]


def _revolutions(log: SensorLog, fit: HarmonicFit) -> _Turns:
    """Maximum likelihood: the fit, and the harmonic of each whole revolution by itself."""
    time = _seconds(log)
    step_s = time[-1] / max(1, len(time) - 1)
    turned = np.abs(fit.angle_rad - fit.angle_rad[0]) / (2.0 * np.pi)
    step = turned[-1] / max(1, len(turned) - 1)
    whole = max(1, int(np.floor(turned[-1] + 1.5 * step)))
    # An encoder's noise may put a sample beside its revolution; that does not matter.
    rows = np.clip(np.floor(turned + 0.5 * step).astype(int), 0, whole)
    columns = np.stack(
        [
            np.ones(len(time)),
            fit.relative_speed * np.cos(fit.angle_rad),
            -fit.relative_speed * np.sin(fit.angle_rad),
        ],
        axis=1,
    )
    columns[~fit.used] = 0.0
    normal, right = np.zeros((whole + 1, 3, 3)), np.zeros((whole + 1, 3))
    for i in range(3):
        right[:, i] = np.bincount(rows, columns[:, i] * fit.cleaned_mps2, minlength=whole + 1)
        for j in range(3):
            normal[:, i, j] = np.bincount(rows, columns[:, i] * columns[:, j], minlength=whole + 1)
    inverse = np.linalg.pinv(normal[:whole], hermitian=True)
    each = np.einsum("nij,nj->ni", inverse, right[:whole])[:, 1:]
    ends = np.cumsum(np.bincount(rows, minlength=whole + 1))[:whole] * step_s
    return _Turns(fit.harmonic_mps2, fit.cov_harmonic, each, ends)


def _square_wave(log: SensorLog, sensor: TurntableAccelerometerDescription, fit: HarmonicFit) -> _Turns:
    """The harmonic of each revolution by square waves, and their mean."""
    angle = log.columns["table_angle_rad"]
    each = _demodulated(sensor, log.columns["acceleration_mps2"], angle)
    # Noise enters at the odd multiples of the speed, each by its share; above the seventh as white.
    order = np.array([1.0, 3.0, 5.0, 7.0])
    rest = np.pi**2 / 8.0 - float(np.sum(1.0 / order**2))
    noise = float(np.sum((fit.noise.harmonics_sd / order) ** 2)) + rest * fit.noise.white_sd**2
    # What is not noise gets through as it is.
    false = _demodulated(sensor, fit.disturbance_mps2, angle).mean(axis=0)
    variance = 2.0 * noise / len(fit.used) + 0.5 * float(false @ false)
    ends = (
        np.arange(1, len(each) + 1) * _seconds(log)[-1] / (len(fit.used) - 1) * sensor.samples_per_revolution
    )
    return _Turns(each.mean(axis=0), np.diag([variance] * 2), each, ends)


def _growth(
    turns: tuple[_Turns, ...], gains: np.ndarray, lean: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Earth rate in the plane from each whole revolution, when it ended, and the running mean of them."""
    each = [(log.each - lean) / gain for log, gain in zip(turns, gains, strict=True)]
    covs = [
        np.tile(log.cov * len(log.each) / gain**2, (len(log.each), 1, 1))
        for log, gain in zip(turns, gains, strict=True)
    ]
    passed = np.cumsum([0.0, *(log.ends_s[-1] for log in turns[:-1])])
    ends = np.concatenate([log.ends_s + before for log, before in zip(turns, passed, strict=True)])
    rates = np.concatenate(each)
    return rates, ends, *_running_means(rates, np.concatenate(covs))


def _running_means(each: np.ndarray, cov: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean of the first k rows, weighted by their covariance, and its covariance, for every k."""
    weight = np.linalg.inv(np.broadcast_to(cov, (len(each), 2, 2)))
    running = np.linalg.inv(np.cumsum(weight, axis=0))
    sums = np.cumsum(np.einsum("nij,nj->ni", weight, each), axis=0)
    return np.einsum("nij,nj->ni", running, sums), running


def _bound_rad(fits: tuple[HarmonicFit, ...], gains: np.ndarray, rate_radps: float, encoder: bool) -> float:
    """Cramer-Rao bound with the noise of the residuals; the lean taken as known."""
    information = 0.0
    for fit, gain in zip(fits, gains, strict=True):
        bound = heading_crlb_rad(
            abs(float(gain)) * rate_radps, fit.noise.signal_sd, len(fit.used), 1, speed_known=encoder
        )
        information += 1.0 / bound**2
    return float(1.0 / np.sqrt(information))


def _about_down(variance: float) -> np.ndarray:
    cov = np.zeros((3, 3))
    cov[2, 2] = variance
    return cov


def _tilt_covariance(site: Site, tilt_sd_rad: float) -> np.ndarray:
    """Of an error of the tilt: a turn about north by x turns the azimuth by -x tan(latitude)."""
    slope = np.array([[1.0, 0.0], [0.0, 1.0], [-np.tan(site.latitude_rad), 0.0]])
    return np.asarray(tilt_sd_rad**2 * (slope @ slope.T))


def _lean_variance(
    geometry: TableGeometry, site: Site, gain: float, tilt_sd_rad: float, lean_sd_rad: float
) -> float:
    """Of the heading, because the axis leans and the table is tilted, and either is not well known."""
    tilted = float(geometry.force_plane_mps2 @ geometry.force_plane_mps2)
    unknown = (site.gravity_mps2 * tilt_sd_rad) ** 2
    felt = lean_sd_rad**2 * (tilted + 2.0 * unknown) + float(geometry.lean_rad @ geometry.lean_rad) * unknown
    return felt / (gain * geometry.north_radps) ** 2


def _latitude_slope(geometry: TableGeometry, site: Site, heading_rad: float) -> float:
    """Change of the heading with the latitude that is assumed; zero on a level table."""
    down = geometry.rot_table_from_level[:2, 2] * site.horizontal_rate_radps
    return float(heading_jacobian(geometry, heading_rad) @ down)


def _seconds(log: SensorLog) -> np.ndarray:
    return np.asarray((log.time_ns - log.time_ns[0]) / NS_PER_S)


# ------------------------------------------------------------------------------------ checks


def _check_kind(log: SensorLog) -> None:
    if log.kind != KIND:
        raise FormatError(
            f"this is a log of kind {log.kind!r}, not of a rotating accelerometer; give one of kind {KIND!r}"
        )


def _sensor_of(
    log: SensorLog, description: TurntableAccelerometerDescription | None
) -> TurntableAccelerometerDescription:
    """The description, with the speed that the log states: runs differ in it."""
    if description is None:
        return describe_turntable(log)
    _check_kind(log)
    rate = log.meta.get("table_rate_radps")
    if isinstance(rate, int | float):
        return msgspec.structs.replace(description, table_rpm=float(rate) * 30.0 / np.pi)
    return description


def _check_log(log: SensorLog, sensor: TurntableAccelerometerDescription, encoder: bool) -> None:
    for name in ("acceleration_mps2", *(("table_angle_rad",) if encoder else ())):
        if name not in log.columns:
            raise FormatError(
                f"the log of the turntable has no column {name}; it has {', '.join(log.columns) or 'none'}"
            )
    signal = np.asarray(log.columns["acceleration_mps2"], dtype=float)
    if log.n_samples < sensor.samples_per_revolution:
        raise NoSolutionError(
            f"the log of the turntable has {log.n_samples} samples, less than a revolution of "
            f"{sensor.samples_per_revolution}; record whole revolutions"
        )
    step = np.diff(log.time_ns)
    if np.any(step <= 0):
        raise FormatError("the times of the turntable's log do not increase; sort it or repair its clock")
    if step.max() > 1.5 * np.median(step):
        raise FormatError(
            f"the log of the turntable has a gap of {step.max() / NS_PER_S:.4g} s after sample "
            f"{int(np.argmax(step)) + 1}; give a part without gaps"
        )
    good = np.isfinite(signal)
    if np.count_nonzero(good) < 0.8 * len(signal):
        raise NoSolutionError(
            f"{np.count_nonzero(~good)} of {len(signal)} samples of the turntable's log are missing; record "
            "again"
        )
    if encoder:
        angle = np.asarray(log.columns["table_angle_rad"], dtype=float)
        turned = float(np.nanmax(angle) - np.nanmin(angle))
        told = abs(sensor.table_rate_radps) * float(_seconds(log)[-1])
        if not 0.5 < turned / told < 2.0:
            raise FormatError(
                f"the table's angle changes by {turned / 2.0 / np.pi:.2f} revolutions in the log while speed "
                f"and time say {told / 2.0 / np.pi:.2f}; the column table_angle_rad must grow over the "
                "revolutions, in radians"
            )
    _check_saturation(signal[good])


def _check_saturation(signal: np.ndarray) -> None:
    """Refuse a signal that stands at its limits."""
    values, counts = np.unique(signal, return_counts=True)
    if len(values) == 1:
        raise NoSolutionError(
            f"the accelerometer says {values[0]:g} m/s^2 in every sample; it is stuck, saturated or not "
            "connected"
        )
    # A sensor of coarse steps repeats all of them, at the crest of a sine twice as often as next to it; one
    # that is cut off repeats its limits alone.
    for k, beside in ((0, 1), (-1, -2)):
        value, count = values[k], counts[k]
        if count > max(0.02 * len(signal), 8.0 * counts[beside]):
            raise NoSolutionError(
                f"{count} of {len(signal)} samples stand at {value:g} m/s^2: the accelerometer was "
                "saturated; use a wider range"
            )


def _check_signal(amplitude: float, expected: float, amplitude_sd: float, site: Site) -> None:
    latitude = np.degrees(site.latitude_rad)
    if amplitude < _MIN_SIGNAL_SD * amplitude_sd:
        raise NoSolutionError(
            f"no signal of the Earth's rotation stands out: {amplitude:.3g} m/s^2 once a revolution with a "
            f"sigma of {amplitude_sd:.3g}, where latitude {latitude:.2f} should give {expected:.3g}; record "
            "more revolutions"
        )
    if not 0.5 < amplitude / expected < 2.0 and abs(amplitude - expected) > 5.0 * amplitude_sd:
        raise NoSolutionError(
            f"the signal once a revolution is {amplitude:.3g} m/s^2 where latitude {latitude:.2f}, radius "
            f"and speed give {expected:.3g}: the scale is wrong, or gravity is felt by a leaning axis on a "
            "tilted table"
        )


def _judged(solution: TurntableNorth, required_rad: float) -> TurntableNorth:
    """The solution with its verdict."""
    measured_sd = solution.heading_sd_rad
    budget = solution.budget
    achievable = measured_sd if budget is None else float(budget.angle_sd_rad()[0])
    n = len(solution.revolution_heading_rad)
    where = (
        f"at latitude {np.degrees(solution.site.latitude_rad):.2f} after {n} revolutions, "
        f"{solution.duration_s:.3g} s"
    )
    if budget is None:
        able = None
        sentence = (
            f"The heading has a sigma of {np.degrees(achievable):.3g} deg {where}, by the noise of this "
            "record; what the sensor can do is open, for its errors are not stated"
        )
    else:
        able = bool(achievable <= required_rad)
        sentence = (
            f"The stated errors give a heading sigma of {np.degrees(achievable):.3g} deg {where}, most of it "
            f"from {budget.lines[0].source}; {np.degrees(required_rad):.3g} deg are asked for"
        )
        noise = solution.revolution_sd_rad**2
        left = required_rad**2 - max(0.0, achievable**2 - noise / n)
        if not able and left > 0.0:
            sentence += f", which takes {int(np.ceil(noise / left))} revolutions"
    return replace(solution, verdict=Verdict(able, sentence + ".", achievable, required_rad))
