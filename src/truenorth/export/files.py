"""Writing a result to a file; the suffix names the format.

CSV, RTKLIB-style ``.pos`` and NMEA are formatted here by hand, so that the command line never loads
a table library for them.
"""

import json
import os
import re
from itertools import chain
from pathlib import Path

import numpy as np

from ..attitude.array_solution import AttitudeSolution
from ..errors import ConfigError, writing
from .columns import format_times
from .layout import arrays_of, columns_of

__all__ = ["FORMATS", "check_output_path", "check_suffix", "write_solution"]

FORMATS = {
    ".csv": "csv",
    ".parquet": "parquet",
    ".pos": "pos",
    ".nmea": "nmea",
    ".json": "json",
    ".nc": "netcdf",
}
"""Format by file suffix."""


def write_solution(solution, path, *, format=None):
    """Write a result to a file.

    Parameters
    ----------
    solution : BaselineSolution or AttitudeSolution
        Result of `truenorth.solve_session`.
    path : str or path-like
        File to write; an existing one is replaced.
    format : {"csv", "parquet", "pos", "nmea", "json", "netcdf"}, optional
        By default the suffix of `path` decides, see `FORMATS`.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ConfigError
        If the format is unknown or the file cannot be written.
    """
    path = Path(path)
    name = check_output_path(path, format=format, of_array=isinstance(solution, AttitudeSolution))
    with writing(path):
        if name == "parquet":
            from .tables import to_polars

            to_polars(solution).write_parquet(path)
        elif name == "netcdf":
            from .tables import to_xarray

            to_xarray(solution).to_netcdf(path)
        else:
            path.write_text(_TEXT_WRITERS[name](solution), encoding="utf-8", newline="\n")
    return path


def check_output_path(path, *, format=None, of_array=False):
    """Find the format of an output file and make sure that the file can be written.

    Parameters
    ----------
    path : str or path-like
        File to be written later.
    format : str, optional
        Name of the format, if not by suffix.
    of_array : bool
        The result is an attitude, for which some formats have no place.

    Returns
    -------
    str
        Name of the format.

    Raises
    ------
    ConfigError
        If the format is unknown or unfit, the folder is missing or the place is not writable.
    """
    path = Path(path)
    name = format or FORMATS.get(path.suffix.lower())
    if name not in FORMATS.values():
        known = ", ".join(FORMATS) if format is None else ", ".join(sorted(set(FORMATS.values())))
        found = format or path.suffix or "no suffix"
        raise ConfigError(
            f"could not choose the format of {path}: {found!r} is not one of {known}",
            key="out",
            value=str(path),
        )
    if name == "pos" and of_array:
        raise ConfigError(
            f"could not write {path}: this format holds one baseline, not the attitude of an array; give a "
            ".csv, .parquet, .nmea, .json or .nc file",
            key="out",
            value=str(path),
        )
    ensure_writable(path)
    return name


def check_suffix(path, suffixes, *, key="out"):
    """Make sure that a file can be written whose suffix names its format.

    Parameters
    ----------
    path : str or path-like
        File to be written later.
    suffixes : sequence of str
        Those that have a format.
    key : str
        The option that named the file.

    Raises
    ------
    ConfigError
        If the suffix is none of them or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in suffixes:
        raise ConfigError(
            f"could not choose the format of {path}: {path.suffix or 'no suffix'!r} is not one of "
            + ", ".join(suffixes),
            key=key,
            value=str(path),
        )
    ensure_writable(path, key=key)


def ensure_writable(path, *, key="out"):
    """Refuse a path that cannot become a file: missing folder, a folder itself, no permission."""
    path = Path(path)
    folder = path.parent
    problem = None
    if path.is_dir():
        problem = "it is a folder; give a file name"
    elif not folder.is_dir():
        problem = f"the folder {folder} does not exist; create it or give another"
    elif not os.access(path if path.exists() else folder, os.W_OK):
        problem = "permission denied; give another place"
    if problem:
        raise ConfigError(f"could not write {path}: {problem}", key=key, value=str(path))


def csv_text(solution):
    """The result as CSV text; begins with the columns of the contract."""
    columns = columns_of(solution)
    header = ",".join(column.name for column in columns)
    row = ",".join(column.spec for column in columns) + "\n"
    arrays = [_quoted(values.tolist()) for values in _text_arrays(solution)]
    body = row * solution.n_epochs % tuple(chain.from_iterable(zip(*arrays, strict=True)))
    # The words of status and reason do not contain "nan", see the tests; a name might.
    body = re.sub(r"(?<=,)nan(?=[,\n])", "NaN", body)
    return f"{header}\n{body}"


def _quoted(cells):
    """Cells of a CSV column; names of antennas may hold what separates cells."""
    if cells and isinstance(cells[0], str):
        return [_quote(cell) for cell in cells]
    return cells


def _quote(cell):
    if not re.search('[",\n]', cell):
        return cell
    doubled = cell.replace('"', '""')
    return f'"{doubled}"'


def json_text(solution):
    """The result as JSON: the summary and the table by columns, null for what is not there."""
    from .summary import summarize_solution

    columns = {}
    for column, values in zip(columns_of(solution), _text_arrays(solution), strict=True):
        listed = values.tolist()
        if values.dtype.kind == "f":
            listed = [value if value == value else None for value in listed]
        columns[column.name] = listed
    return json.dumps({"summary": summarize_solution(solution), "columns": columns}, allow_nan=False) + "\n"


def _text_arrays(solution):
    arrays = arrays_of(solution)
    next(arrays)
    yield np.array(format_times(solution.time_ns), dtype=object)
    yield from arrays


def _pos_text(solution):
    from .rtklib_pos import pos_text

    return pos_text(solution)


def _nmea_text(solution):
    from .nmea import nmea_text

    return nmea_text(solution)


_TEXT_WRITERS = {"csv": csv_text, "json": json_text, "pos": _pos_text, "nmea": _nmea_text}
