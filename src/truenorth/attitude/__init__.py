"""From baselines to the attitude of the platform."""

from .array import attitude_from_baselines, solve_array
from .baselines import solve_baseline
from .sessions import solve_session

__all__ = ["attitude_from_baselines", "solve_array", "solve_baseline", "solve_session"]
