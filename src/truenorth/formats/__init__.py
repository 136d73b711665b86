"""Reading files: observations, navigation, orbits, in whatever packing they come; and writing them.

`read` recognises a file by its content; `read_observations` and `read_navigation` say what they
expect; `summarize` tells what a file holds. Writers are loaded when they are used.
"""

import importlib
from typing import Any

from .registry import FORMATS, read, read_navigation, read_observations, sniff

_WRITERS = {
    "RinexObservationWriter": "rinex_obs_writer",
    "write_rinex_observations": "rinex_obs_writer",
}

__all__ = [  # noqa: PLE0604  (the keys are strings)
    "FORMATS",
    "read",
    "read_navigation",
    "read_observations",
    "sniff",
    "summarize",
    *_WRITERS,
]


def __getattr__(name: str) -> Any:
    if name not in _WRITERS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_WRITERS[name]}", __name__), name)


def summarize(path):
    """Tell what a file holds.

    Parameters
    ----------
    path : str or os.PathLike
        Any file that `read` knows.

    Returns
    -------
    truenorth.formats.inventory.Inventory

    Raises
    ------
    FormatError
        If the file cannot be read.
    """
    from .inventory import summarize as summarize_file

    return summarize_file(path)
