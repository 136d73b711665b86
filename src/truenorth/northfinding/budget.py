r"""Error budget of north from gravity and the Earth's rotation, to first order, at any attitude.

With the errors :math:`\delta f, \delta\omega` of the mean specific force and of the mean rate, turned from
the body into north, east, down, and :math:`\hat C^n_b = \exp([\varphi])\,C^n_b`, the alignment that takes
gravity as exact is in error by

.. math::
    \varphi_n = -\frac{\delta f_e}{g},\qquad \varphi_e = \frac{\delta f_n}{g},\qquad
    \varphi_d = -\frac{\delta\omega_e}{\omega\cos\phi} + \frac{\delta f_e}{g}\tan\phi

These are Oguz (6.19) to (6.21) in the sign of this package: there :math:`\bar C = (I - [\varphi])C`, and the
printed signs of the accelerometer's terms belong to a specific force of +g down, whereas an accelerometer at
rest feels -g. The latitude does not enter: its error turns nothing, because the two vectors give the
meridian by themselves. The published direct form (see `truenorth.northfinding.static`) uses the latitude and
all three components; of the nearest rotation to its matrix only the north tilt differs,

.. math::
    \varphi_e = \tfrac12\left(\frac{\delta f_n}{g} - \frac{\delta f_d}{g}\tan\phi
    + \frac{\delta\omega_d}{\omega\cos\phi} + \delta\phi\right)

A scale error or a misalignment acts through what the axis feels of the Earth:
:math:`\delta\omega = M\omega^b`, :math:`\delta f = M f^b`, and :math:`\delta\omega = G f^b` for the
sensitivity of the gyros to specific force.

A mean over a time T leaves, per axis: of a bias itself; of white noise of density N, N^2/T; of a random walk
of the bias of coefficient K that starts with the record, K^2 T/3; of flicker noise the variance of the mean
of the Gauss-Markov processes it is made of (`truenorth.sensors.processes`), each
:math:`2\sigma^2(x - 1 + e^{-x})/x^2` with x = T over the time constant; of counted increments a sixth of a
step squared over T^2, the two ends.

References
----------
Oguz, P., M.Sc. thesis, Middle East Technical University (2006), sec. 6.
Groves, P. D., Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed. (2013),
sec. 5.6.2.
Heiskanen, W. A., Moritz, H., Physical Geodesy (1967), sec. 5-4 (azimuth and deflection of the vertical).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..attitude.vectors import angle_jacobian
from ..constants import DPH_RADPS, STANDARD_GRAVITY_MPS2, UG_MPS2
from .site import Site
from .solution import BudgetLine, ErrorBudget, Verdict

if TYPE_CHECKING:
    from ..sensors.imu import ImuDescription

__all__ = [
    "DEFLECTION_SD_RAD",
    "accelerometer_sensitivity",
    "covariance_after",
    "deflection_sensitivity",
    "gyro_sensitivity",
    "heading_sd_against_latitude",
    "heading_sd_on_circle",
    "judge",
    "latitude_sensitivity",
    "matrix_sensitivity",
    "published_bound_rad",
    "static_budget",
    "wrapped_covariance",
]

Form = Literal["orthonormal", "published"]

DEFLECTION_SD_RAD = float(np.radians(5.0 / 3600.0))
"""Deflection of the vertical that is assumed, each component: 5 arc seconds; tens in the mountains."""


HOPELESS_SD_RAD = 0.5
"""Where first-order theory says more than this, the horizontal Earth rate is lost in the errors."""


def gyro_sensitivity(rot_ned_from_body: np.ndarray, site: Site, *, form: Form = "orthonormal") -> np.ndarray:
    """Attitude error by an error of the mean rate in body axes.

    Parameters
    ----------
    rot_ned_from_body : ndarray, shape (3, 3)
        Attitude.
    site : Site
        Where.
    form : {"orthonormal", "published"}
        Form of the alignment.

    Returns
    -------
    ndarray, shape (3, 3)
        Small rotation in north, east, down for each rad/s about forward, right, down; seconds.
    """
    by_ned = np.zeros((3, 3))
    by_ned[2, 1] = -1.0 / site.horizontal_rate_radps
    if form == "published":
        by_ned[1, 2] = 0.5 / site.horizontal_rate_radps
    return by_ned @ rot_ned_from_body


def accelerometer_sensitivity(
    rot_ned_from_body: np.ndarray, site: Site, *, form: Form = "orthonormal"
) -> np.ndarray:
    """Attitude error by an error of the mean specific force in body axes.

    Parameters
    ----------
    rot_ned_from_body : ndarray, shape (3, 3)
        Attitude.
    site : Site
        Where.
    form : {"orthonormal", "published"}
        Form of the alignment.

    Returns
    -------
    ndarray, shape (3, 3)
        Small rotation in north, east, down for each m/s^2 along forward, right, down.
    """
    tangent = np.tan(site.latitude_rad)
    by_ned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, tangent, 0.0]])
    if form == "published":
        by_ned[1] = 0.5, 0.0, -0.5 * tangent
    return by_ned @ rot_ned_from_body / site.gravity_mps2


def matrix_sensitivity(sensitivity: np.ndarray, sensed_body: np.ndarray) -> np.ndarray:
    """Attitude error by each element of a matrix of scale errors, misalignments or g-sensitivities.

    Parameters
    ----------
    sensitivity : ndarray, shape (3, 3)
        Of `gyro_sensitivity` or `accelerometer_sensitivity`.
    sensed_body : ndarray, shape (3,)
        What the matrix acts on: the Earth rate or the specific force, in body axes.

    Returns
    -------
    ndarray, shape (3, 3, 3)
        ``[i, j, k]``: rotation about axis i for the element of row j and column k.
    """
    return sensitivity[:, :, None] * sensed_body


def latitude_sensitivity(*, form: Form = "orthonormal") -> np.ndarray:
    """Attitude error by an error of the latitude given; none where gravity is taken as exact.

    Returns
    -------
    ndarray, shape (3,)
        Small rotation in north, east, down for each radian.
    """
    return np.array([0.0, 0.5 if form == "published" else 0.0, 0.0])


def deflection_sensitivity(site: Site) -> np.ndarray:
    r"""Attitude error against the ellipsoid by the deflection of the vertical.

    The sensors find the astronomic azimuth, which differs from the geodetic one by :math:`\eta\tan\phi`.

    Parameters
    ----------
    site : Site
        Where.

    Returns
    -------
    ndarray, shape (3, 2)
        Small rotation in north, east, down for each radian of the components north (xi) and east (eta).
    """
    return np.array([[0.0, -1.0], [1.0, 0.0], [0.0, np.tan(site.latitude_rad)]])


@dataclass(frozen=True, slots=True, eq=False)
class _Source:
    """An error that is the same along all axes of a sensor: what of it a mean over times leaves."""

    name: str
    stated: str
    is_gyro: bool
    variance: np.ndarray


def _axis_sources(
    errors: ImuDescription, duration_s: np.ndarray, gravity_mps2: float, noise_factor: float
) -> Iterator[_Source]:
    """Errors that every axis has alike; variances in (rad/s)^2 or (m/s^2)^2, shaped as the durations."""
    time = np.asarray(duration_s, dtype=float)
    step_s = 1.0 / errors.rate_hz

    def constant(value: float) -> np.ndarray:
        return np.full(time.shape, value)

    walk, vrw = errors.gyro_random_walk_deg_per_sqrt_h, errors.accel_random_walk_mps_per_sqrt_h
    gyro_density, accel_density = errors.gyro_density_rad_per_sqrt_s, errors.accel_density_mps_per_sqrt_s
    bias = errors.gyro_bias_sd_dph
    yield _Source("gyro bias", f"{bias:g} deg/h", True, constant((DPH_RADPS * bias) ** 2))
    floor = errors.gyro_bias_instability_dph
    yield _Source("gyro bias instability", f"{floor:g} deg/h", True, _flicker_mean(time, DPH_RADPS * floor))
    yield _Source("angle random walk", f"{walk:g} deg/sqrt(h)", True, noise_factor * gyro_density**2 / time)
    drift = errors.gyro_bias_walk_dph_per_sqrt_h
    yield _Source(
        "rate random walk", f"{drift:g} deg/h/sqrt(h)", True, (DPH_RADPS * drift / 60.0) ** 2 * time / 3.0
    )
    force = errors.gyro_g_sensitivity_dph_per_g
    yield _Source(
        "gyro g-sensitivity",
        f"{force:g} deg/h/g",
        True,
        constant((DPH_RADPS * force * gravity_mps2 / STANDARD_GRAVITY_MPS2) ** 2),
    )
    step = errors.gyro_resolution_dps
    yield _Source(
        "gyro quantisation",
        f"{step:g} deg/s",
        True,
        _counted(errors.output, np.radians(step), step_s, gyro_density, time, noise_factor),
    )
    bias = errors.accel_bias_sd_ug
    yield _Source("accelerometer bias", f"{bias:g} ug", False, constant((UG_MPS2 * bias) ** 2))
    floor = errors.accel_bias_instability_ug
    yield _Source(
        "accelerometer bias instability", f"{floor:g} ug", False, _flicker_mean(time, UG_MPS2 * floor)
    )
    yield _Source(
        "velocity random walk", f"{vrw:g} m/s/sqrt(h)", False, noise_factor * accel_density**2 / time
    )
    drift = errors.accel_bias_walk_ug_per_sqrt_h
    yield _Source(
        "accelerometer bias walk", f"{drift:g} ug/sqrt(h)", False, (UG_MPS2 * drift / 60.0) ** 2 * time / 3.0
    )
    step = errors.accel_resolution_ug
    yield _Source(
        "accelerometer quantisation",
        f"{step:g} ug",
        False,
        _counted(errors.output, UG_MPS2 * step, step_s, accel_density, time, noise_factor),
    )


def _flicker_mean(time_s: np.ndarray, floor: float) -> np.ndarray:
    """Variance of the mean of flicker noise over times."""
    from ..sensors.processes import flicker_components, gauss_markov_mean_covariance

    sd, time_constants = flicker_components(floor)
    ratio = np.asarray(time_s)[..., None] / time_constants
    return np.asarray(sd**2 * gauss_markov_mean_covariance(0, ratio).sum(-1))


def _counted(
    output: str, step: float, interval_s: float, density: float, time_s: np.ndarray, noise_factor: float
) -> np.ndarray:
    r"""Variance of the mean of counted values over times; step and density of a rate or a force.

    Counted increments carry their remainder: only the two ends of the record are rounded. Rates are rounded
    one by one; noise of sd s per sample leaves of the rounding error a constant part of variance
    :math:`\sum_k \tfrac12 (\Delta/\pi k)^2 \exp(-4\pi^2k^2s^2/\Delta^2)` over all phases of the truth within
    a step, and the rest is white.
    """
    if step == 0.0:
        return np.zeros(np.shape(time_s))
    if output == "increments":
        return (step * interval_s) ** 2 / 6.0 / np.asarray(time_s) ** 2
    k = np.arange(1, 200)
    spread = density / np.sqrt(interval_s) / step
    stays = float(np.sum(0.5 * (step / np.pi / k) ** 2 * np.exp(-((2.0 * np.pi * k * spread) ** 2))))
    return stays + noise_factor * max(step**2 / 12.0 - stays, 0.0) * interval_s / np.asarray(time_s)


def _fixed_lines(
    errors: ImuDescription, rot_ned_from_body: np.ndarray, site: Site, form: Form, deflection_sd_rad: float
) -> Iterator[BudgetLine]:
    """Lines of the errors that depend on the direction of the axes or do not come from the sensor."""
    # Scale errors and misalignments are those of the axes of the unit.
    rot = rot_ned_from_body @ errors.rot_body_from_imu
    diagonal = np.eye(3, dtype=bool)
    for sensor, sensitivity, sensed in (
        ("gyro", gyro_sensitivity(rot, site, form=form), site.earth_rate_ned_radps @ rot),
        ("accelerometer", accelerometer_sensitivity(rot, site, form=form), site.force_ned_mps2 @ rot),
    ):
        by_element = matrix_sensitivity(sensitivity, sensed)
        is_gyro = sensor == "gyro"
        scale = errors.gyro_scale_sd_ppm if is_gyro else errors.accel_scale_sd_ppm
        skewed = errors.gyro_misalignment_sd_mrad if is_gyro else errors.accel_misalignment_sd_mrad
        for name, stated, sd, elements in (
            ("scale", f"{scale:g} ppm", 1e-6 * scale, diagonal),
            ("misalignment", f"{skewed:g} mrad", 1e-3 * skewed, ~diagonal),
        ):
            chosen = by_element[:, elements]
            yield BudgetLine(f"{sensor} {name}", stated, sd**2 * chosen @ chosen.T)
    by_latitude = latitude_sensitivity(form=form)
    arcsec = 3600.0 * np.degrees(site.latitude_sd_rad)
    if arcsec > 0.0:
        yield BudgetLine(
            "latitude", f"{arcsec:.3g} arcsec", site.latitude_sd_rad**2 * np.outer(by_latitude, by_latitude)
        )
    by_deflection = deflection_sensitivity(site)
    arcsec = 3600.0 * np.degrees(deflection_sd_rad)
    if arcsec > 0.0:
        yield BudgetLine(
            "deflection of the vertical",
            f"{arcsec:.3g} arcsec (assumed)",
            deflection_sd_rad**2 * by_deflection @ by_deflection.T,
        )


def static_budget(
    errors: ImuDescription,
    rot_ned_from_body: np.ndarray,
    site: Site,
    duration_s: float,
    *,
    noise_factor: float = 1.0,
    deflection_sd_rad: float = DEFLECTION_SD_RAD,
    form: Form = "orthonormal",
) -> ErrorBudget:
    """Where the error of an alignment at rest comes from.

    Parameters
    ----------
    errors : ImuDescription
        Errors of the sensor.
    rot_ned_from_body : ndarray, shape (3, 3)
        Attitude.
    site : Site
        Where, and how well the latitude is known.
    duration_s : float
        Averaging time.
    noise_factor : float
        Variance that the white noises (angle and velocity random walk, rounding) leave, as a multiple of what
        plain averaging leaves.
    deflection_sd_rad : float
        Of each component of the deflection of the vertical; 0 where north is to be the astronomic one.
    form : {"orthonormal", "published"}
        Form of the alignment.

    Returns
    -------
    ErrorBudget
        A line for each source that is there, largest effect on the heading first.
    """
    lines = list(_fixed_lines(errors, rot_ned_from_body, site, form, deflection_sd_rad))
    by_gyro = gyro_sensitivity(rot_ned_from_body, site, form=form)
    by_force = accelerometer_sensitivity(rot_ned_from_body, site, form=form)
    of_sensor = {True: by_gyro @ by_gyro.T, False: by_force @ by_force.T}
    for source in _axis_sources(errors, np.array(duration_s), site.gravity_mps2, noise_factor):
        cov = float(source.variance) * of_sensor[source.is_gyro]
        lines.append(BudgetLine(source.name, source.stated, cov))
    present = [line for line in lines if line.source == "latitude" or np.any(line.cov_ned_rad2)]
    row = _heading_row(rot_ned_from_body)
    present.sort(key=lambda line: -float(row @ line.cov_ned_rad2 @ row))
    return ErrorBudget(tuple(present), np.array(rot_ned_from_body))


def covariance_after(
    errors: ImuDescription,
    rot_ned_from_body: np.ndarray,
    site: Site,
    duration_s: np.ndarray,
    *,
    noise_factor: float = 1.0,
    deflection_sd_rad: float = DEFLECTION_SD_RAD,
    form: Form = "orthonormal",
) -> np.ndarray:
    """Covariance of `static_budget` at many durations at once.

    Parameters
    ----------
    errors, rot_ned_from_body, site, noise_factor, deflection_sd_rad, form
        As for `static_budget`.
    duration_s : ndarray, shape (k,)
        Averaging times.

    Returns
    -------
    ndarray, shape (k, 3, 3)
        Of the small rotation in north, east, down.
    """
    duration = np.asarray(duration_s, dtype=float)
    total = np.zeros((len(duration), 3, 3))
    for line in _fixed_lines(errors, rot_ned_from_body, site, form, deflection_sd_rad):
        total += line.cov_ned_rad2
    by_gyro = gyro_sensitivity(rot_ned_from_body, site, form=form)
    by_force = accelerometer_sensitivity(rot_ned_from_body, site, form=form)
    of_sensor = {True: by_gyro @ by_gyro.T, False: by_force @ by_force.T}
    for source in _axis_sources(errors, duration, site.gravity_mps2, noise_factor):
        total += source.variance[:, None, None] * of_sensor[source.is_gyro]
    return total


def _heading_row(rot_ned_from_body: np.ndarray) -> np.ndarray:
    """Derivatives of the heading by a small turn; with the nose straight up, those of the azimuth alone."""
    row = angle_jacobian(np.asarray(rot_ned_from_body)[None])[0, 0]
    return row if np.all(np.isfinite(row)) else np.array([0.0, 0.0, 1.0])


@lru_cache(maxsize=1)
def _circle_table() -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations of a direction in the plane: first-order ones and those on the circle."""
    from scipy.special import ndtr

    linear = np.geomspace(0.02, 100.0, 400)
    k = 1.0 / linear[:, None]
    angle = np.linspace(-np.pi, np.pi, 4001)
    along = k * np.cos(angle)
    density = np.exp(-0.5 * k**2) / (2.0 * np.pi)
    density = density + along / np.sqrt(2.0 * np.pi) * np.exp(-0.5 * (k * np.sin(angle)) ** 2) * ndtr(along)
    return linear, np.sqrt(np.trapezoid(density * angle**2, angle, axis=1))


def heading_sd_on_circle(linear_sd_rad: ArrayLike) -> np.ndarray:
    r"""Standard deviation of a heading whose first-order one is given.

    The heading is the direction of a horizontal vector, the Earth rate; errors of standard deviation s
    relative to its length spread it by s where s is small, and by :math:`\pi/\sqrt3` where they drown it: any
    direction is then as likely (the phase of a constant in Gaussian noise, Rice 1948).

    Parameters
    ----------
    linear_sd_rad : float or ndarray
        First-order standard deviation.

    Returns
    -------
    ndarray
        Standard deviation of the error in (-pi, pi].
    """
    linear = np.asarray(linear_sd_rad, dtype=float)
    table, on_circle = _circle_table()
    ratio = np.interp(linear, table, on_circle / table, left=1.0)
    return np.where(linear > table[-1], np.pi / np.sqrt(3.0), ratio * linear)


def wrapped_covariance(rot_ned_from_body: np.ndarray, cov_ned_rad2: np.ndarray) -> np.ndarray:
    """First-order covariances whose heading is put on the circle, for gyros that hardly feel the Earth.

    Parameters
    ----------
    rot_ned_from_body : ndarray, shape (3, 3)
        Attitude.
    cov_ned_rad2 : ndarray, shape (..., 3, 3)
        First-order covariances.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        The same but for the row and the column of the down axis.
    """
    row = _heading_row(rot_ned_from_body)
    cov = np.asarray(cov_ned_rad2, dtype=float)
    linear = np.sqrt(np.maximum(np.einsum("i,...ij,j->...", row, cov, row), 0.0))
    factor = np.ones((*linear.shape, 3))
    factor[..., 2] = np.where(linear > 0.0, heading_sd_on_circle(linear) / np.maximum(linear, 1e-300), 1.0)
    return cov * factor[..., :, None] * factor[..., None, :]


def published_bound_rad(
    latitude_rad: ArrayLike,
    *,
    gyro_bias_dph: float = 1.0,
    accel_bias_ug: float = 1000.0,
    earth_rate_dph: float = 15.041,
    rss: bool = False,
) -> np.ndarray:
    r"""Bound of the azimuth error of Oguz (6.22).

    It is :math:`\delta\omega/(\omega\cos\phi) + (\delta f/g)\tan\phi`. Printed is 4.9615 deg for 1 deg/h,
    1 mg, 15.041 deg/h and latitude 39 deg 55'; these give 5.0146 deg (as a root of squares 4.967 deg), and
    4.9615 deg belongs to latitude 39.0 deg and 15.0 deg/h.

    Parameters
    ----------
    latitude_rad : float or ndarray
        Latitude.
    gyro_bias_dph : float
        Gyro bias.
    accel_bias_ug : float
        Accelerometer bias, millionths of the gravity.
    earth_rate_dph : float
        Earth rate.
    rss : bool
        Root of the sum of squares instead of the sum.

    Returns
    -------
    ndarray
        Radians.
    """
    latitude = np.asarray(latitude_rad, dtype=float)
    by_gyro = gyro_bias_dph / earth_rate_dph / np.cos(latitude)
    by_force = 1e-6 * accel_bias_ug * np.tan(np.abs(latitude))
    return np.asarray(np.hypot(by_gyro, by_force) if rss else by_gyro + by_force)


def heading_sd_against_latitude(
    errors: ImuDescription,
    rot_ned_from_body: np.ndarray,
    latitude_rad: np.ndarray,
    duration_s: float,
    *,
    linear: bool = False,
    deflection_sd_rad: float = DEFLECTION_SD_RAD,
) -> np.ndarray:
    """Standard deviation of the heading at latitudes.

    Parameters
    ----------
    errors : ImuDescription
        Errors of the sensor.
    rot_ned_from_body : ndarray, shape (3, 3)
        Attitude.
    latitude_rad : ndarray, shape (k,)
        Latitudes, none at a pole.
    duration_s : float
        Averaging time.
    linear : bool
        To first order, which is singular at the poles; otherwise on the circle.
    deflection_sd_rad : float
        Of each component of the deflection of the vertical.

    Returns
    -------
    ndarray, shape (k,)
        Radians.
    """
    row = _heading_row(rot_ned_from_body)
    variance = [
        row
        @ static_budget(
            errors, rot_ned_from_body, Site(float(latitude)), duration_s, deflection_sd_rad=deflection_sd_rad
        ).cov_ned_rad2
        @ row
        for latitude in np.asarray(latitude_rad)
    ]
    sd = np.sqrt(variance)
    return sd if linear else heading_sd_on_circle(sd)


_WHITE = {"angle random walk", "velocity random walk"}
_ENDS = {"gyro quantisation", "accelerometer quantisation", "shaking"}
_WALKS = {"rate random walk", "accelerometer bias walk"}
_SLOW = {"gyro bias instability", "accelerometer bias instability"}
_TURNS_AWAY = {"gyro bias", "gyro g-sensitivity", "accelerometer bias"}

LONGEST_S = 86_400.0
"""No one averages for longer."""


def judge(
    budget: ErrorBudget,
    site: Site,
    duration_s: float,
    required_heading_sd_rad: float,
    *,
    turned: bool = False,
) -> Verdict:
    """Whether a sensor can find north to a demanded accuracy, what limits it, and what would help.

    Parameters
    ----------
    budget : ErrorBudget
        Of the sensor, here.
    site : Site
        Where.
    duration_s : float
        How long it averages.
    required_heading_sd_rad : float
        What is demanded, one sigma.
    turned : bool
        Whether the record already holds several positions, so that turning the sensor is no advice.

    Returns
    -------
    Verdict
        Not able also where the errors are of the size of the horizontal Earth rate (first-order theory gives
        more than `HOPELESS_SD_RAD`), whatever is demanded.
    """
    row = _heading_row(budget.rot_ned_from_body)
    variance = {line.source: float(row @ line.cov_ned_rad2 @ row) for line in budget.lines}
    linear = float(np.sqrt(sum(variance.values())))
    achievable, required = float(heading_sd_on_circle(linear)), float(required_heading_sd_rad)
    where = f"at latitude {np.degrees(site.latitude_rad):.1f} in {duration_s:.4g} s"
    if linear == 0.0:
        return Verdict(True, f"No error is stated that would limit this sensor {where}.", 0.0, required)
    worst = max(budget.lines, key=lambda line: variance[line.source])
    whose = "the" if worst.source in ("latitude", "deflection of the vertical") else "its"
    limit = f"{whose} {worst.source} of {worst.stated}"
    if achievable <= required and linear < HOPELESS_SD_RAD:
        return Verdict(
            True,
            f"This sensor can find north to {_degrees(achievable)} (one sigma) {where}, better than the"
            f" {_degrees(required)} demanded; {limit} limits it.",
            achievable,
            required,
        )
    remedy = _remedy(variance, duration_s, required, turned)
    if linear >= HOPELESS_SD_RAD:
        ratio = float(np.sqrt(variance[worst.source]))
        times = f"{ratio:.1f} times" if ratio < 3.0 else f"{ratio:.0f} times"
        subject = limit if worst.source == "gyro bias" else f"what {limit} leaves"
        sentence = (
            f"This sensor cannot find north {where}: {subject} is {times} the horizontal Earth rate of"
            f" {site.horizontal_rate_radps / DPH_RADPS:.1f} deg/h there; {remedy}."
        )
    else:
        sentence = (
            f"This sensor cannot find north to the {_degrees(required)} demanded {where}: it reaches"
            f" {_degrees(achievable)} (one sigma), limited by {limit}; {remedy}."
        )
    return Verdict(False, sentence, achievable, required)


def _remedy(variance: dict[str, float], duration_s: float, required_sd_rad: float, turned: bool) -> str:
    """What would bring a heading to what is demanded, if anything would."""
    from ..sensors.processes import flicker_variance

    # What changes more slowly than the records is turned away with the biases: half the difference of two
    # neighbouring means has half the Allan variance of each.
    time = np.array(duration_s)
    stays = 0.5 * float(flicker_variance(time, 1.0) / _flicker_mean(time, 1.0))
    longer = np.geomspace(1.0, max(1.0, LONGEST_S / duration_s), 500)

    def after(positions: int) -> dict[str, np.ndarray]:
        """Variance of each source at longer durations."""
        sources = {}
        for name, value in variance.items():
            left = np.full(len(longer), value)
            if name in _WHITE | _ENDS:
                left = value / longer ** (1 if name in _WHITE else 2) / positions
            elif name in _WALKS:
                left = value * longer
            elif positions == 2 and name in _SLOW | _TURNS_AWAY:
                left = left * (stays if name in _SLOW else 0.0)
            sources[name] = left
        return sources

    for positions in (1,) if turned else (1, 2):
        sources = after(positions)
        left = sum(sources.values(), np.zeros(len(longer)))
        enough = np.flatnonzero(left <= required_sd_rad**2)
        if positions == 1 and len(enough):
            return f"averaging for {_span(longer[enough[0]] * duration_s)} would do"
        if len(enough) and enough[0] == 0:
            return (
                "two records of this length, with a turn by 180 degrees about the vertical between them,"
                f" would remove the biases and leave {_degrees(float(np.sqrt(left[0])))}"
            )
        if len(enough):
            span = _span(longer[enough[0]] * duration_s)
            return f"two positions, 180 degrees apart about the vertical, for {span} each would do"
    best = int(np.argmin(left))
    source = max(sources, key=lambda name: sources[name][best])
    least = _degrees(float(heading_sd_on_circle(np.sqrt(left[best]))))
    way = "longer averaging" if turned else "two positions, 180 degrees apart about the vertical,"
    return f"even {way} would leave {least}, most of it by {source}; it takes a better sensor"


def _degrees(angle_rad: float) -> str:
    """Angle in degrees to two figures, or three from ten on."""
    angle = float(np.degrees(angle_rad))
    return f"{angle:.3g} deg" if angle >= 10.0 else f"{angle:.2g} deg"


def _span(duration_s: float) -> str:
    """Duration in the unit a person would use."""
    for unit, length_s in (("hours", 3600.0), ("minutes", 60.0)):
        if duration_s >= 2.0 * length_s:
            return f"{duration_s / length_s:.2g} {unit}"
    return f"{np.ceil(duration_s):.0f} s"
