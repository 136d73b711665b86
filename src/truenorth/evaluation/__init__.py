"""Solutions against references: errors aligned in time, their statistics, and whether sigma was honest."""

from .comparison import Comparison, compare
from .north_comparison import NorthComparison, compare_north
from .update_rates import RateStudy, compare_rates

__all__ = ["Comparison", "NorthComparison", "RateStudy", "compare", "compare_north", "compare_rates"]
