"""Which table a solution has: that of a baseline, or that of an attitude."""

from ..attitude.array_solution import AttitudeSolution
from .attitude_columns import ATTITUDE_COLUMNS, attitude_arrays
from .columns import COLUMNS, column_arrays

__all__ = ["arrays_of", "columns_of"]


def columns_of(solution):
    """Columns of the table of a solution, tuple of `truenorth.export.columns.Column`."""
    return ATTITUDE_COLUMNS if isinstance(solution, AttitudeSolution) else COLUMNS


def arrays_of(solution):
    """Arrays of `columns_of`, in order; times are ``datetime64[ns]`` of GPS time."""
    return attitude_arrays(solution) if isinstance(solution, AttitudeSolution) else column_arrays(solution)
