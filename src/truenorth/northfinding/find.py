"""One search for north: the record is checked, a method chosen by name, and the result judged."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from ..constants import DPH_RADPS
from ..errors import ConfigError
from ..formats.imu_table import ImuTable
from ..gravity import EARTH_RATE_RADPS
from ..sensors.imu import ImuDescription
from ..strapdown import InertialIncrements
from .checks import RecordFigures, check_record
from .site import Site
from .solution import NorthSolution, Verdict

__all__ = ["DEFAULT_METHOD", "METHODS", "TURNING", "find_north"]


def _static(form: Any) -> Callable[..., NorthSolution]:
    def align(increments: InertialIncrements, site: Site, **options: Any) -> NorthSolution:
        from .static import align_static

        return align_static(increments, site, form=form, **options)

    return align


def _inertial(form: str) -> Callable[..., NorthSolution]:
    def align(increments: InertialIncrements, site: Site, **options: Any) -> NorthSolution:
        from .inertial import align_inertial

        return align_inertial(increments, site, form=form, **options)

    return align


def _fine(updates: Any) -> Callable[..., NorthSolution]:
    def align(increments: InertialIncrements, site: Site, **options: Any) -> NorthSolution:
        from .fine import align_fine

        return align_fine(increments, site, updates=updates, **options)

    return align


def _positions(increments: InertialIncrements, site: Site, **options: Any) -> NorthSolution:
    from .positions import align_positions

    return align_positions(increments, site, **options)


def _carousel(increments: InertialIncrements, site: Site, **options: Any) -> NorthSolution:
    from .positions import align_carousel

    return align_carousel(increments, site, **options)


DEFAULT_METHOD = "velocity-fit"

FELT_SHARE = 0.02
"""Of the Earth rate: a horizontal rate that is farther off is worth a sentence."""

METHODS: dict[str, tuple[Callable[..., NorthSolution], str]] = {
    "velocity-fit": (
        _inertial("velocity-fit"),
        "inertial frame, least squares of the velocity; at rest, shaken",
    ),
    "weighted": (_inertial("weighted"), "the same with the gyro's noise weighed against the shaking"),
    "gravity-fit": (_inertial("gravity-fit"), "inertial frame, gravity's cone fitted"),
    "velocity-differences": (_inertial("velocity-differences"), "inertial frame, sliding differences"),
    "velocity-optimised": (
        _inertial("velocity-optimised"),
        "inertial frame, all velocities (Wu et al. 2011)",
    ),
    "displacement-optimised": (_inertial("displacement-optimised"), "inertial frame, second integrals"),
    "two-velocities": (_inertial("two-velocities"), "inertial frame, two vectors"),
    "static": (_static("orthonormal"), "plain averages, two vectors; nothing may move"),
    "published": (_static("published"), "plain averages, the direct form of Oguz (2006)"),
    "fine": (_fine("always"), "filter with biases, about one place throughout; needs --errors"),
    "strapdown": (_fine("still"), "filter with biases, held only where the record is still; needs --errors"),
    "positions": (_positions, "two or more positions on a turntable: gyro bias removed"),
    "carousel": (_carousel, "continuous turning on a turntable: gyro bias removed"),
}
"""Method by name and what it is for."""

TURNING = ("positions", "carousel")
"""Methods whose record holds the turns of a table."""

FILTERS = ("fine", "strapdown")
"""Methods that cannot do without stated errors; the body may turn."""


def find_north(
    record: ImuTable | InertialIncrements,
    site: Site,
    *,
    method: str = DEFAULT_METHOD,
    errors: ImuDescription | None = None,
    required_heading_sd_rad: float = float(np.radians(1.0)),
    running: bool = True,
    **options: Any,
) -> NorthSolution:
    """Find where a body at rest points, from gyros and accelerometers alone.

    Parameters
    ----------
    record : ImuTable or InertialIncrements
        A log as `truenorth.read_imu_table` reads it, or increments in body axes (forward, right, down).
    site : Site
        Where it stands.
    method : str
        A name of `METHODS`.
    errors : ImuDescription, optional
        What is known of the sensor's errors. Without it sigma covers what shows as noise in the record, and
        the verdict says which bias would be too much.
    required_heading_sd_rad : float
        What the verdict is about.
    running : bool
        Also the estimate after every second.
    **options
        Of the method, see its function.

    Returns
    -------
    NorthSolution
        Attitude at the end of the record, with covariance, budget and verdict.

    Raises
    ------
    ConfigError
        If the method is unknown or needs errors that are not stated.
    NoSolutionError
        If the record cannot be what it claims to be: saturated, wrongly scaled, feeling no Earth rate, too
        short; or if the method finds nothing in it.
    """
    from .budget import judge

    if method not in METHODS:
        raise ConfigError(f"`{method}` is no method; choose {', '.join(METHODS)}", key="method", value=method)
    if errors is None and method in FILTERS:
        raise ConfigError(
            f"the filter of `{method}` weighs biases against noise; state the errors of the sensor",
            key="errors",
        )
    moving = method in (*TURNING, *FILTERS)
    table = record if isinstance(record, ImuTable) else None
    increments = record.increments if isinstance(record, ImuTable) else record
    felt = check_record(increments, site, errors=errors, may_turn=moving, table=table)
    solution = METHODS[method][0](increments, site, errors=errors, running=running, **options)
    turned = method in TURNING
    if solution.budget is None or errors is None:
        verdict = _unstated(solution, required_heading_sd_rad, turned)
    else:
        verdict = judge(solution.budget, site, solution.duration_s, required_heading_sd_rad, turned=turned)
    told = felt.figures()
    if "horizontal_rate_dph" in solution.measured:
        # The method has its own figures of the Earth's turn; one of each is enough.
        told = {name: value for name, value in told.items() if "rate" not in name and "latitude" not in name}
    measured = {**told, **solution.measured}
    notes = (*_latitude_notes(felt, site, errors), *solution.notes)
    return dataclasses.replace(solution, method=method, verdict=verdict, measured=measured, notes=notes)


def _latitude_notes(felt: RecordFigures, site: Site, errors: ImuDescription | None) -> tuple[str, ...]:
    """A sentence where the Earth is felt to turn as at another latitude than the one given."""
    if felt.latitude_rad is None:
        return ()
    off_radps = felt.horizontal_rate_radps - site.horizontal_rate_radps
    chance_radps = 5.0 * felt.horizontal_rate_sd_radps
    if errors is not None:
        biases = np.hypot(errors.gyro_bias_sd_dph, errors.gyro_g_sensitivity_dph_per_g)
        chance_radps = np.hypot(chance_radps, 3.0 * biases * DPH_RADPS)
    if abs(off_radps) < max(chance_radps, FELT_SHARE * EARTH_RATE_RADPS):
        return ()
    return (
        f"The gyros feel the Earth turn as at latitude {np.degrees(felt.latitude_rad):.1f}, and"
        f" {np.degrees(site.latitude_rad):.1f} was given: either that is wrong, or they have a bias of"
        f" {abs(off_radps) / DPH_RADPS:.2g} deg/h towards north, and then probably as much towards east.",
    )


def _unstated(solution: NorthSolution, required_rad: float, turned: bool) -> Verdict:
    """What a verdict can be where nobody stated the sensor's errors: what would be too much."""
    noise_rad = float(solution.angle_sd_rad[0])
    horizontal_radps = solution.site.horizontal_rate_radps
    room_rad = np.sqrt(max(required_rad**2 - noise_rad**2, 0.0))
    dph = np.degrees(room_rad * horizontal_radps) * 3600.0
    required = f"{np.degrees(required_rad):.3g} deg"
    if room_rad == 0.0:
        text = (
            f"The noise of the record alone makes {np.degrees(noise_rad):.2g} deg of the {required} that were"
            f" asked for; average longer."
        )
        return Verdict(False, text, noise_rad, required_rad)
    if turned:
        text = (
            f"The errors of the sensor are not stated. The turns took its constant gyro bias away, and the"
            f" noise of the record makes {np.degrees(noise_rad):.2g} deg; how far the bias wanders between"
            f" the turns, and the scale of the gyros, must be small beside {required}."
        )
        return Verdict(None, text, noise_rad, required_rad)
    text = (
        f"The errors of the sensor are not stated. It can do {required} at latitude"
        f" {np.degrees(solution.site.latitude_rad):.2f} if its gyro bias is below {dph:.2g} deg/h (one sigma,"
        f" east axis)."
    )
    return Verdict(None, text, noise_rad, required_rad)
