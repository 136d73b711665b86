"""From baselines to the attitude of the platform."""

from .baselines import solve_baseline
from .sessions import solve_session

__all__ = ["solve_baseline", "solve_session"]
