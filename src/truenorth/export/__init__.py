"""Results as tables, files and summaries.

`write_solution` chooses the format by the suffix of the file; `solution_columns` is the table that
all formats share; `summarize_solution` boils a run down to what a person or a script asks first.
The baseline points from base to rover; angles are in degrees here, and only here and in ``report``.
"""

from .files import FORMATS, check_output_path, write_solution
from .settings import write_settings
from .summary import summarize_solution
from .tables import solution_columns, to_polars, to_xarray

__all__ = [
    "FORMATS",
    "check_output_path",
    "solution_columns",
    "summarize_solution",
    "to_polars",
    "to_xarray",
    "write_settings",
    "write_solution",
]
