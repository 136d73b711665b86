"""Reading files: observations, navigation, orbits, in whatever packing they come; and writing them.

`read` recognises a file by its content; `read_observations` and `read_navigation` say what they
expect; `summarize` tells what a file holds. Writers, and what reads tables, are loaded when used.
"""

import importlib
from typing import Any

from .registry import FORMATS, read, read_navigation, read_observations, sniff

_LAZY = {
    "FogCoding": "fog_packet",
    "ImuMapping": "imu_mapping",
    "ImuTable": "imu_table",
    "iter_observations": "blocks",
    "open_observations": "blocks",
    "parse_antex": "antex",
    "phase_centre_correction_m": "antex",
    "read_antex": "antex",
    "read_fog_packets": "fog_packet",
    "read_imu_table": "imu_table",
    "read_sensor_table": "sensor_table",
    "read_table": "sensor_table",
    "read_tcm2": "tcm2",
    "RinexObservationWriter": "rinex_obs_writer",
    "split_tcm2": "tcm2",
    "TableWriter": "sensor_table",
    "UbxWriter": "ubx_writer",
    "write_fog_packets": "fog_packet",
    "write_oem3": "novatel_oem3_writer",
    "write_rinex_navigation": "rinex_nav_writer",
    "write_rinex_observations": "rinex_obs_writer",
    "write_sensor_table": "sensor_table",
    "write_table": "sensor_table",
    "write_tcm2": "tcm2",
    "write_ubx": "ubx_writer",
}

__all__ = [  # noqa: PLE0604  (the keys are strings)
    "FORMATS",
    "read",
    "read_navigation",
    "read_observations",
    "sniff",
    "summarize",
    *_LAZY,
]


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_LAZY[name]}", __name__), name)


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
