r"""A ship in waves: courses with turns, and roll, pitch, yaw and heave from spectra.

Each oscillation is a sum of sinusoids whose frequencies share the energy of a spectrum evenly, so that its
standard deviation is exact and its extremes wander as at sea. The spectra, with :math:`x = f / f_p`:

* narrow: a normal curve about the mean frequency (a lightly damped roll),
* Pierson-Moskowitz: :math:`x^{-5} \exp(-\tfrac54 x^{-4})`,
* JONSWAP: that times :math:`3.3^{\exp(-(x-1)^2 / 2\sigma^2)}`, :math:`\sigma` = 0.07 below the peak and
  0.09 above.

They are spectra of what the ship does, not of the sea: how she answers to a wave at a speed and course is in
the amplitude and period that are given. The defaults are the motion of the ship of McMillan, J. C., Arden,
D. A. G., Lachapelle, G., Lu, G., "Dynamic GPS attitude performance using INS/GPS reference", Proc. ION GPS-94
(1994), as assumed for it: roll of 3 to 5 degrees at 8 to 10 s, pitch of 1 to 2 at 6 to 8 s, yaw of 1 at 12 s.

References
----------
Pierson, W. J., Moskowitz, L., J. Geophysical Research 69 (1964) 5181-5190.
Hasselmann, K. et al., Ergaenzungsheft zur Deutschen Hydrographischen Zeitschrift A8(12) (1973).
"""

from __future__ import annotations

from typing import Literal

import msgspec
import numpy as np

from ...errors import ConfigError
from ..randomness import stream
from .drives import require_open_turns, require_positive, street_path
from .kinematics import LocalPlane
from .laws import PAD_S, UniformLaw
from .routes import Component, Disturbance, RouteTrajectory, Sinusoids

__all__ = ["Oscillation", "ShipLeg", "ShipMotion", "ship_trajectory", "wave_sinusoids"]

N_COMPONENTS = 32


class Oscillation(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One component of a ship's motion in waves."""

    amplitude: float
    """Typical amplitude: the standard deviation times the root of two. Degrees; heave in metres."""
    period_s: float
    """Of the middle of the narrow spectrum, of the peak of the others."""
    spectrum: Literal["narrow", "pierson-moskowitz", "jonswap"] = "narrow"
    bandwidth: float = 0.06
    """Standard deviation of the narrow spectrum by its mean frequency; 0 is a pure sinusoid."""

    def __post_init__(self) -> None:
        require_positive(self, "period_s")
        if not self.amplitude >= 0.0:
            raise ConfigError(
                f"`amplitude` is {self.amplitude!r}; give 0 or more", key="amplitude", value=self.amplitude
            )
        if not 0.0 <= self.bandwidth <= 0.3:
            raise ConfigError(
                f"`bandwidth` is {self.bandwidth!r}; give 0 to 0.3", key="bandwidth", value=self.bandwidth
            )


class ShipLeg(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One course."""

    course_deg: float
    """Clockwise from north."""
    length_m: float
    """From one turn to the next."""

    def __post_init__(self) -> None:
        require_positive(self, "length_m")


class ShipMotion(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="ship"
):
    """A ship on courses with turns, in waves; the legs are repeated as long as the scenario lasts."""

    speed_mps: float = 5.0
    """Constant."""
    legs: tuple[ShipLeg, ...] = (
        ShipLeg(course_deg=35.0, length_m=1500.0),
        ShipLeg(course_deg=80.0, length_m=1200.0),
        ShipLeg(course_deg=350.0, length_m=2000.0),
        ShipLeg(course_deg=245.0, length_m=2500.0),
        ShipLeg(course_deg=170.0, length_m=3500.0),
        ShipLeg(course_deg=290.0, length_m=1200.0),
    )
    turn_radius_m: float = 300.0
    roll: Oscillation = Oscillation(amplitude=4.0, period_s=9.0)
    pitch: Oscillation = Oscillation(amplitude=1.5, period_s=7.0)
    yaw: Oscillation = Oscillation(amplitude=1.0, period_s=12.0)
    heave: Oscillation = Oscillation(amplitude=0.5, period_s=8.0, spectrum="jonswap")

    def __post_init__(self) -> None:
        require_positive(self, "speed_mps", "turn_radius_m")
        if not self.legs:
            raise ConfigError("`legs` is empty; give at least one course", key="legs", value=self.legs)
        require_open_turns("legs", _corners(self.legs, 2), closed=False)


def _corners(legs: tuple[ShipLeg, ...], times: int) -> np.ndarray:
    """Ends of the legs, sailed so many times, from the origin on."""
    course = np.radians([leg.course_deg for leg in legs])
    length = np.array([leg.length_m for leg in legs])
    sides = np.tile(length[:, None] * np.stack((np.sin(course), np.cos(course)), axis=-1), (times, 1))
    return np.concatenate([np.zeros((1, 2)), np.cumsum(sides, axis=0)])


def wave_sinusoids(oscillation: Oscillation, unit: float, rng: np.random.Generator) -> Sinusoids:
    """Sum of sinusoids with the spectrum of an oscillation.

    Parameters
    ----------
    oscillation : Oscillation
        What it is to look like.
    unit : float
        Amplitude 1 of the section in the unit of the sum.
    rng : numpy.random.Generator
        Draws the frequency of each component within its share of the energy, and its phase.

    Returns
    -------
    Sinusoids
        32 components of equal amplitude.
    """
    if oscillation.spectrum == "narrow":
        width = oscillation.bandwidth
        x = np.linspace(1.0 - 3.0 * width, 1.0 + 3.0 * width, 2001)
        density = np.exp(-0.5 * ((x - 1.0) / width) ** 2) if width > 0.0 else np.ones_like(x)
    else:
        x = np.linspace(0.4, 4.0, 2001)
        density = x**-5.0 * np.exp(-1.25 * x**-4.0)
        if oscillation.spectrum == "jonswap":
            density *= 3.3 ** np.exp(-0.5 * ((x - 1.0) / np.where(x < 1.0, 0.07, 0.09)) ** 2)
    energy = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    share = (np.arange(N_COMPONENTS) + rng.random(N_COMPONENTS)) / N_COMPONENTS
    frequency = np.interp(share * energy[-1], energy, x) / oscillation.period_s
    phase = rng.uniform(0.0, 2.0 * np.pi, N_COMPONENTS)
    if oscillation.spectrum == "narrow" and oscillation.bandwidth == 0.0:
        frequency, phase = frequency[:1], phase[:1]
    amplitude = np.full(len(phase), oscillation.amplitude * unit / np.sqrt(len(phase)))
    return Sinusoids(amplitude, 2.0 * np.pi * frequency, phase)


def ship_trajectory(section: ShipMotion, plane: LocalPlane, duration_s: float, seed: int) -> RouteTrajectory:
    """Trajectory of a `ShipMotion`.

    Parameters
    ----------
    section : ShipMotion
        Settings.
    plane : LocalPlane
        Where the courses are drawn.
    duration_s : float
        How long the motion is needed.
    seed : int
        Of the scenario.

    Returns
    -------
    RouteTrajectory
        The voyage; the start of the scenario is the start of the first leg.
    """
    # Turns cut their corners by up to twice the tangent of an arc; the lead is for instants before the start.
    total = 2.0 * (duration_s + 2.0 * PAD_S) * section.speed_mps
    times = 1 + int(np.ceil(total / sum(leg.length_m for leg in section.legs)))
    corners = _corners(section.legs, times)
    reach = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    corners = corners[: 2 + int(np.searchsorted(reach, total))]
    lead = PAD_S * section.speed_mps + section.turn_radius_m
    first = (corners[1] - corners[0]) / np.hypot(*(corners[1] - corners[0]))
    corners[0] -= lead * first
    path, _ = street_path(corners, section.turn_radius_m, closed=False)
    degree = np.pi / 180.0
    components: tuple[Component, ...] = ("roll", "pitch", "yaw", "heave")
    waves = tuple(
        Disturbance(
            component,
            "time",
            wave_sinusoids(
                getattr(section, component),
                1.0 if component == "heave" else degree,
                stream(seed, "motion", "waves", component),
            ),
        )
        for component in components
    )
    return RouteTrajectory(
        plane, path, UniformLaw(section.speed_mps, lead), disturbances=waves, origin_m=lead
    )
