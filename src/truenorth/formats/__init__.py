"""Reading files: observations, navigation, orbits, in whatever packing they come.

`read` recognises a file by its content; `read_observations` and `read_navigation` say what they
expect; `summarize` tells what a file holds.
"""

from .registry import FORMATS, read, read_navigation, read_observations, sniff

__all__ = ["FORMATS", "read", "read_navigation", "read_observations", "sniff", "summarize"]


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
