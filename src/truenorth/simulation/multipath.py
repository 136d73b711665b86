"""Multipath: from plane reflectors by geometry, and as a Gauss-Markov process.

A plane at distance d below (beside) the antenna with unit normal n towards it sends a second ray of
relative amplitude a, longer by ``2 d (n . e)``. Of direct and reflected ray together the loops see

    theta = 2 pi delta / lambda + pi
    phase error = lambda / (2 pi) * atan2(a sin theta, 1 + a cos theta)
    code error  = a delta cos theta / (1 + a cos theta)          for delta within a chip
    fading      = 10 log10(1 + 2 a cos theta + a^2)  dB

References: Georgiadou & Kleusberg 1988, Manuscripta Geodaetica 13, 172-179; Braasch 1996, in Parkinson &
Spilker, Global Positioning System: Theory and Applications I, ch. 14.
"""

from __future__ import annotations

from typing import Literal

import msgspec
import numpy as np

from ..errors import ConfigError

__all__ = ["GaussMarkovSection", "MultipathSection", "ReflectorSection", "reflected_ray"]


class ReflectorSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A plane that mirrors the satellites: ground, roof, wall, mast."""

    name: str = "ground"
    distance_m: float
    """From the antenna to the plane."""
    coefficient: float
    """Amplitude of the reflected over the direct ray, antenna gain apart."""
    frame: Literal["world", "body"] = "world"
    """World: north, east, down; body: forward, right, down."""
    normal: tuple[float, float, float] = (0.0, 0.0, -1.0)
    """From the plane towards the antenna, in `frame`."""
    elevation_deg: tuple[float, float] = (-90.0, 90.0)
    """Satellite elevations for which the plane is large enough to reflect."""

    def __post_init__(self) -> None:
        if not self.distance_m > 0.0:
            raise ConfigError(
                f"`distance_m` is {self.distance_m!r}; give a positive number",
                key="distance_m",
                value=self.distance_m,
            )
        if not 0.0 <= self.coefficient < 1.0:
            raise ConfigError(
                f"`coefficient` is {self.coefficient!r}; give 0 to below 1",
                key="coefficient",
                value=self.coefficient,
            )
        if not np.linalg.norm(self.normal) > 0.0:
            raise ConfigError(
                f"`normal` is {self.normal!r}; give a direction", key="normal", value=self.normal
            )


class GaussMarkovSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Multipath as a first-order Gauss-Markov process of every signal."""

    code_sd_m: float = 0.0
    phase_sd_m: float = 0.0
    """At the zenith."""
    horizon_factor: float = 1.0
    """Standard deviations at the horizon over those at the zenith; linear in the sine of the elevation."""
    tau_s: float = 100.0
    """Correlation time at rest."""
    tau_moving_s: float = 5.0
    """Correlation time while the platform moves faster than 0.5 m/s."""

    def __post_init__(self) -> None:
        for key in ("tau_s", "tau_moving_s"):
            if not getattr(self, key) > 0.0:
                raise ConfigError(f"`{key}` is {getattr(self, key)!r}; give a positive number", key=key)
        for key in ("code_sd_m", "phase_sd_m", "horizon_factor"):
            if not getattr(self, key) >= 0.0:
                raise ConfigError(f"`{key}` is {getattr(self, key)!r}; give 0 or more", key=key)


class MultipathSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Both kinds add up."""

    reflectors: tuple[ReflectorSection, ...] = ()
    gauss_markov: GaussMarkovSection = GaussMarkovSection()


def reflected_ray(
    path_m: np.ndarray,
    amplitude: np.ndarray,
    wavelength_m: np.ndarray,
    chip_m: np.ndarray,
    spacing_chips: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors of code and phase, and fading, of a direct ray with one reflected ray.

    Parameters
    ----------
    path_m : ndarray, shape (n,)
        Length of the reflected minus the direct ray, metres.
    amplitude : ndarray, shape (n,)
        Amplitude of the reflected over the direct ray, below 1.
    wavelength_m, chip_m : ndarray, shape (n,)
        Carrier wavelength and length of a code chip, metres.
    spacing_chips : float
        Distance of early and late correlator.

    Returns
    -------
    code_error_m, phase_error_m, fading_db : ndarray, shape (n,)
    """
    theta = 2.0 * np.pi * path_m / wavelength_m + np.pi
    c, s = np.cos(theta), np.sin(theta)
    phase = wavelength_m / (2.0 * np.pi) * np.arctan2(amplitude * s, 1.0 + amplitude * c)
    # Beyond a chip the reflected ray no longer correlates; the last half spacing is a linear fall.
    chips = path_m / chip_m
    near = np.clip((1.0 + 0.5 * spacing_chips - chips) / spacing_chips, 0.0, 1.0)
    code = near * amplitude * path_m * c / (1.0 + amplitude * c)
    return code, phase, 10.0 * np.log10(1.0 + 2.0 * amplitude * c + amplitude**2)
