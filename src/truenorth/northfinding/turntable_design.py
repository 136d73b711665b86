r"""How well a rotating accelerometer can find north: bounds, published and corrected formulas, design.

A sine of amplitude :math:`A = 2 \Omega \rho\, w_N` in white noise of :math:`\sigma` a sample, n revolutions
of M samples, has the Cramer-Rao bound of its phase, and so of the heading,

.. math:: \sigma_\psi^2 \ge \frac{2 \sigma^2}{n M A^2}

when the table's angle is known. When only the angle of the first of the N = n M samples is known and the
speed is estimated too, the bound is larger by :math:`(4N - 2)/(N + 1)`, nearly four times
(Rife and Boorstyn 1974). With no angle at all the phase says nothing: only the amplitude is left.

The square wave collects :math:`\int f \,\mathrm{sgn}(\cos) dt`: of M samples of :math:`T/M` seconds each the
noise adds up to :math:`T\sigma/\sqrt M`, the signal to :math:`8 w_N \rho = 2 A T / \pi`, so

.. math:: \sigma_\psi = \frac{T \sigma}{8 w_N \rho \sqrt M} = \frac{\pi}{2} \frac{\sigma}{A \sqrt M}

for one revolution and :math:`1/\sqrt n` of it for the mean of n: :math:`\pi^2/8 = 1.234` times the bound in
variance, the price of the higher odd harmonics that the square wave listens to. The published formula
(Oguz 2006, eq. 5.19), :math:`\sigma/(2\Omega\rho) / (w_e \cos\varphi \sqrt n) = \sigma/(A \sqrt n)`, leaves
the samples of a revolution out.

References
----------
P. Oguz, Implementation of Northfinding Techniques, M.Sc. thesis, Middle East Technical University (2006),
ch. 5.
D. C. Rife and R. R. Boorstyn, "Single-tone parameter estimation from discrete-time observations", IEEE
Trans. Inf. Theory 20 (1974) 591-598.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import ConfigError
from ..gravity import EARTH_RATE_RADPS
from .site import Site

__all__ = [
    "TurntableDesign",
    "design_turntable",
    "heading_crlb_rad",
    "published_heading_sd_rad",
    "square_wave_heading_sd_rad",
]


def heading_crlb_rad(
    amplitude_mps2: float,
    noise_mps2: float,
    samples_per_revolution: int,
    revolutions: int,
    *,
    speed_known: bool = True,
) -> float:
    """Cramer-Rao bound of the heading from a level table.

    Parameters
    ----------
    amplitude_mps2 : float
        Of the signal, see `truenorth.sensors.turntable_accelerometer.coriolis_amplitude_mps2`.
    noise_mps2 : float
        White noise of a sample, one sigma; of coloured noise that which has its density at the signal.
    samples_per_revolution, revolutions : int
        Samples in a revolution, and whole revolutions.
    speed_known : bool
        Whether the angle of every sample is known; else only that of the first sample, and the speed is
        estimated too.

    Returns
    -------
    float
        Least standard deviation, radians.
    """
    n = samples_per_revolution * revolutions
    known = 2.0 * noise_mps2**2 / (n * amplitude_mps2**2)
    return float(np.sqrt(known if speed_known else known * (4.0 * n - 2.0) / (n + 1.0)))


def square_wave_heading_sd_rad(
    amplitude_mps2: float, noise_mps2: float, samples_per_revolution: int, revolutions: int
) -> float:
    """Standard deviation of the square wave's mean heading, ``pi/2 sigma/(A sqrt(n M))``, radians.

    Parameters
    ----------
    amplitude_mps2 : float
        Of the signal.
    noise_mps2 : float
        White noise of a sample, one sigma.
    samples_per_revolution, revolutions : int
        Samples in a revolution, and whole revolutions.

    Returns
    -------
    float
        Radians; that of a single revolution with ``revolutions=1``.
    """
    n = samples_per_revolution * revolutions
    return float(0.5 * np.pi * noise_mps2 / (amplitude_mps2 * np.sqrt(n)))


def published_heading_sd_rad(amplitude_mps2: float, noise_mps2: float, revolutions: int) -> float:
    """The published noise formula (Oguz 2006, eq. 5.19), ``sigma/(A sqrt(n))``, radians.

    Parameters
    ----------
    amplitude_mps2 : float
        Of the signal.
    noise_mps2 : float
        Noise of a sample, one sigma.
    revolutions : int
        "Repeating periods".

    Returns
    -------
    float
        Radians; without the samples of a revolution it is too large by about sqrt(M) / 1.57.
    """
    return float(noise_mps2 / (amplitude_mps2 * np.sqrt(revolutions)))


@dataclass(frozen=True, slots=True, eq=False)
class TurntableDesign:
    """Standard deviations of the heading for combinations of a design, one row each.

    Parameters
    ----------
    latitude_rad, radius_m, table_rate_radps, noise_mps2, inclination_sd_rad : ndarray, shape (k,)
        The design; the noise is that of a sample.
    samples_per_revolution, revolutions : ndarray of int64, shape (k,)
        The record.
    amplitude_mps2 : ndarray, shape (k,)
        Of the signal.
    likelihood_sd_rad, square_wave_sd_rad : ndarray, shape (k,)
        From the noise, with each method.
    inclination_error_rad : ndarray, shape (k,)
        From the tilt that is not known, and gravity that the leaning axis feels because of it.
    heading_sd_rad : ndarray, shape (k,)
        Noise with maximum likelihood, tilt and lean together.
    duration_s : ndarray, shape (k,)
        Length of the record.
    needed_revolutions : ndarray, shape (k,)
        Fewest for the demanded sigma; infinite where the tilt forbids it, NaN where none is demanded.
    needed_s : ndarray, shape (k,)
        Their time.
    required_heading_sd_rad : float
        What is demanded; NaN where nothing is.
    """

    latitude_rad: np.ndarray
    radius_m: np.ndarray
    table_rate_radps: np.ndarray
    noise_mps2: np.ndarray
    inclination_sd_rad: np.ndarray
    samples_per_revolution: np.ndarray
    revolutions: np.ndarray
    amplitude_mps2: np.ndarray
    likelihood_sd_rad: np.ndarray
    square_wave_sd_rad: np.ndarray
    inclination_error_rad: np.ndarray
    heading_sd_rad: np.ndarray
    duration_s: np.ndarray
    needed_revolutions: np.ndarray
    needed_s: np.ndarray
    required_heading_sd_rad: float

    def columns(self) -> dict[str, np.ndarray]:
        """The table as a person reads it: degrees, revolutions a minute."""
        return {
            "latitude_deg": np.degrees(self.latitude_rad),
            "radius_m": self.radius_m,
            "table_rpm": self.table_rate_radps * 30.0 / np.pi,
            "noise_mps2": self.noise_mps2,
            "samples_per_revolution": self.samples_per_revolution,
            "revolutions": self.revolutions,
            "inclination_sd_deg": np.degrees(self.inclination_sd_rad),
            "amplitude_mps2": self.amplitude_mps2,
            "likelihood_sd_deg": np.degrees(self.likelihood_sd_rad),
            "square_wave_sd_deg": np.degrees(self.square_wave_sd_rad),
            "inclination_error_deg": np.degrees(self.inclination_error_rad),
            "heading_sd_deg": np.degrees(self.heading_sd_rad),
            "duration_s": self.duration_s,
            "needed_revolutions": self.needed_revolutions,
            "needed_s": self.needed_s,
        }


def design_turntable(
    latitude_rad: float | Sequence[float],
    *,
    radius_m: float | Sequence[float] = 0.05,
    table_rate_radps: float | Sequence[float] = 20.0 * np.pi,
    noise_mps2: float | Sequence[float] = 1e-5,
    noise_density_mps2_rthz: float | Sequence[float] | None = None,
    samples_per_revolution: int | Sequence[int] = 500,
    revolutions: int | Sequence[int] = 10,
    inclination_sd_rad: float | Sequence[float] = 0.0,
    lean_rad: float = 0.0,
    speed_known: bool = True,
    required_heading_sd_rad: float | None = None,
) -> TurntableDesign:
    """Predicted sigma of the heading for every combination of the values given.

    Parameters
    ----------
    latitude_rad : float or sequence of float
        Of the place.
    radius_m, table_rate_radps : float or sequence of float
        Radius of the accelerometer and speed of the table.
    noise_mps2 : float or sequence of float
        White noise of a sample, one sigma.
    noise_density_mps2_rthz : float or sequence of float, optional
        Noise as a density instead, m/s^2/sqrt(Hz); the noise of a sample follows from the sampling rate.
    samples_per_revolution, revolutions : int or sequence of int
        The record.
    inclination_sd_rad : float or sequence of float
        How well the tilt of the table about each horizontal axis is known.
    lean_rad : float
        Lean of the sensitive axis that is not known, each way; it lets gravity in on a tilted table.
    speed_known : bool
        Whether an encoder tells the table's angle.
    required_heading_sd_rad : float, optional
        Demanded sigma: the revolutions that it takes are solved for.

    Returns
    -------
    TurntableDesign

    Raises
    ------
    ConfigError
        If a value is impossible, or a latitude is a pole.
    """
    by_density = noise_density_mps2_rthz is not None
    values = {
        "latitude": latitude_rad,
        "radius": radius_m,
        "speed": table_rate_radps,
        "noise": noise_density_mps2_rthz if by_density else noise_mps2,
        "samples": samples_per_revolution,
        "revolutions": revolutions,
        "inclination": inclination_sd_rad,
    }
    lists = {name: np.atleast_1d(np.asarray(value, dtype=float)) for name, value in values.items()}
    for name in ("radius", "speed", "noise", "samples", "revolutions"):
        if not np.all(np.isfinite(lists[name]) & (lists[name] > 0.0)):
            raise ConfigError(f"`{name}` must be above zero, got {lists[name].tolist()}", key=name)
    if not np.all(lists["inclination"] >= 0.0) or not lean_rad >= 0.0:
        raise ConfigError("`inclination` and `lean` must not be negative", key="inclination")
    for latitude in lists["latitude"]:
        Site(float(latitude))
    grid = np.array(list(itertools.product(*lists.values()))).T
    latitude, radius, rate, noise, samples, turns, tilt = grid
    if by_density:
        noise = noise * np.sqrt(0.5 * samples * rate / (2.0 * np.pi))
    north = EARTH_RATE_RADPS * np.cos(latitude)
    amplitude = 2.0 * rate * radius * north
    one = np.sqrt(2.0 * noise**2 / (samples * amplitude**2))
    if not speed_known:
        one = one * np.sqrt((4.0 * samples * turns - 2.0) / (samples * turns + 1.0))
    felt = np.sqrt(2.0) * np.array([Site(float(x)).gravity_mps2 for x in latitude]) * tilt * lean_rad
    fixed = np.hypot(tilt * np.tan(latitude), felt / amplitude)
    needed = np.full(len(latitude), np.nan)
    if required_heading_sd_rad is not None:
        if not required_heading_sd_rad > 0.0:
            raise ConfigError("the demanded sigma must be above zero", key="require")
        left = required_heading_sd_rad**2 - fixed**2
        needed = np.where(left > 0.0, np.ceil(one**2 / np.where(left > 0.0, left, 1.0) - 1e-9), np.inf)
    return TurntableDesign(
        latitude_rad=latitude,
        radius_m=radius,
        table_rate_radps=rate,
        noise_mps2=noise,
        inclination_sd_rad=tilt,
        samples_per_revolution=samples.astype(np.int64),
        revolutions=turns.astype(np.int64),
        amplitude_mps2=amplitude,
        likelihood_sd_rad=one / np.sqrt(turns),
        square_wave_sd_rad=0.5 * np.pi * noise / (amplitude * np.sqrt(samples * turns)),
        inclination_error_rad=fixed,
        heading_sd_rad=np.hypot(one / np.sqrt(turns), fixed),
        duration_s=turns * 2.0 * np.pi / rate,
        needed_revolutions=needed,
        needed_s=needed * 2.0 * np.pi / rate,
        required_heading_sd_rad=np.nan if required_heading_sd_rad is None else float(required_heading_sd_rad),
    )
