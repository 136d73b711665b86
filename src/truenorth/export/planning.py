"""Tables of plans and studies as files: CSV by hand, Parquet by polars."""

from pathlib import Path

import numpy as np

from ..errors import writing
from .files import check_suffix

__all__ = ["TABLE_SUFFIXES", "check_table_path", "table_csv", "write_table"]

TABLE_SUFFIXES = (".csv", ".parquet")


def check_table_path(path):
    """Make sure that a table can be written.

    Parameters
    ----------
    path : str or path-like
        File to be written later.

    Raises
    ------
    ConfigError
        If the suffix is unknown or the file cannot be written.
    """
    check_suffix(path, TABLE_SUFFIXES)


def write_table(columns, path):
    """Write a table to a file; the suffix names the format.

    Parameters
    ----------
    columns : dict of str to ndarray, shape (n,)
        Names and values; times as ``datetime64[ns]`` of GPS time.
    path : str or path-like
        ``.csv`` or ``.parquet``; an existing file is replaced.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ConfigError
        If the suffix is unknown or the file cannot be written.
    """
    path = Path(path)
    check_table_path(path)
    with writing(path):
        if path.suffix.lower() == ".parquet":
            import polars as pl

            arrays = {
                name: np.ascontiguousarray(values.astype(str) if values.dtype.kind in "UO" else values)
                for name, values in columns.items()
            }
            pl.DataFrame(arrays).write_parquet(path)
        else:
            path.write_text(table_csv(columns), encoding="utf-8", newline="\n")
    return path


def table_csv(columns):
    """Format a table as CSV text.

    Parameters
    ----------
    columns : dict of str to ndarray, shape (n,)
        Names and values.

    Returns
    -------
    str
        Numbers with nine digits, ``NaN`` for what is not there, ISO times of GPS time.
    """
    cells = [_cells(np.asarray(values)) for values in columns.values()]
    lines = [",".join(columns), *(",".join(row) for row in zip(*cells, strict=True))]
    return "\n".join(lines) + "\n"


def _cells(values):
    """Values of a column as text."""
    if values.dtype.kind == "M":
        unit = "ms" if not np.any(values.astype("datetime64[ns]").astype(np.int64) % 1_000_000) else "ns"
        return np.datetime_as_string(values, unit=unit).tolist()
    if values.dtype.kind == "f":
        return ["NaN" if value != value else f"{value:.9g}" for value in values.tolist()]
    quoted = (str(value) for value in values.tolist())
    return ['"' + cell.replace('"', '""') + '"' if "," in cell or '"' in cell else cell for cell in quoted]
