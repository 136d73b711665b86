"""Solutions against references: errors aligned in time, their statistics, and whether sigma was honest."""

from .comparison import Comparison, compare
from .update_rates import RateStudy, compare_rates

__all__ = ["Comparison", "RateStudy", "compare", "compare_rates"]
