"""From baselines to the attitude of the platform."""

from .baselines import solve_baseline

__all__ = ["solve_baseline"]
