"""Solutions against references: errors aligned in time, their statistics, and whether sigma was honest."""

from .comparison import Comparison, compare

__all__ = ["Comparison", "compare"]
