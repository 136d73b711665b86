"""What a sensor will achieve, before anything is recorded: the budget of each method at perfect rest."""

from __future__ import annotations

import numpy as np

from ..errors import ConfigError
from ..rotations import rot_ned_from_body
from ..sensors.imu import ImuDescription
from ..strapdown import InertialIncrements
from .budget import static_budget
from .inertial import FORMS, align_inertial
from .positions import positions_budget, turning_plan
from .site import Site
from .solution import ErrorBudget

__all__ = ["PREDICTED", "predict_budget"]

PREDICTED = ("static", *FORMS, "positions", "carousel")
"""Methods of `truenorth.northfinding.find.METHODS` that can be predicted."""

CAROUSEL_DPS = 10.0
"""Rate of a carousel."""

LEAST_S = 30.0
"""Of a record, as short as it makes sense."""


def predict_budget(
    errors: ImuDescription,
    site: Site,
    duration_s: float,
    *,
    method: str = "velocity-fit",
    positions: int = 2,
    heading_rad: float = 0.0,
) -> ErrorBudget:
    """Error budget of a level platform that stands perfectly still; shaking comes on top.

    Parameters
    ----------
    errors : ImuDescription
        Errors of the sensor.
    site : Site
        Where.
    duration_s : float
        Length of the record, turns of a table included.
    method : str
        A name of `PREDICTED`.
    positions : int
        How many, for the method ``positions``; the gyros measure the turns between.
    heading_rad : float
        Heading of the platform, at the start where it turns.

    Returns
    -------
    ErrorBudget

    Raises
    ------
    ConfigError
        If the method is none of them, or the time is too short.
    """
    if method not in PREDICTED:
        raise ConfigError(
            f"`{method}` cannot be predicted; choose {', '.join(PREDICTED)}", key="method", value=method
        )
    if not duration_s >= LEAST_S:
        raise ConfigError(
            f"in {duration_s:g} s no north is found; give {LEAST_S:g} s or more",
            key="duration",
            value=duration_s,
        )
    rot = rot_ned_from_body(heading_rad, 0.0, 0.0)
    if method == "static":
        return static_budget(errors, rot, site, duration_s)
    if method == "positions":
        if positions < 2:
            raise ConfigError(
                f"{positions} positions were asked for; give two or more, or another method",
                key="positions",
                value=positions,
            )
        plan = turning_plan(duration_s, positions)
        return positions_budget(errors, site, plan, heading_rad=heading_rad)
    if method == "carousel":
        plan = np.array([[0.0, 0.0], [duration_s, np.radians(CAROUSEL_DPS * duration_s)]])
        return positions_budget(errors, site, plan, heading_rad=heading_rad, encoder_sd_rad=0.0)
    # The method itself, on a record without errors, says what the stated ones do.
    intervals = max(round(duration_s), 1)
    step_s = duration_s / intervals
    ideal = InertialIncrements(
        step_s * np.arange(intervals + 1),
        np.tile(site.earth_rate_ned_radps @ rot * step_s, (intervals, 1)),
        np.tile(site.force_ned_mps2 @ rot * step_s, (intervals, 1)),
    )
    solution = align_inertial(ideal, site, errors=errors, form=method, running=False, interval_s=step_s)
    assert solution.budget is not None  # the errors are stated
    return solution.budget
