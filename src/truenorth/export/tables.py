"""Result tables for Python: plain arrays, polars and xarray."""

import numpy as np

from ..attitude.array_solution import AttitudeSolution
from ..timescales import gpst_to_datetime64
from .columns import COLUMNS, reason_labels, status_labels
from .layout import arrays_of, columns_of

__all__ = ["solution_columns", "to_polars", "to_xarray"]


def solution_columns(solution):
    """The result table as arrays, one row per epoch.

    Parameters
    ----------
    solution : BaselineSolution or AttitudeSolution
        Result of `truenorth.solve_session`.

    Returns
    -------
    dict of str to ndarray
        In the order of the CSV columns; angles in degrees, times as ``datetime64[ns]`` of GPS time.
    """
    names = (column.name for column in columns_of(solution))
    return dict(zip(names, arrays_of(solution), strict=True))


def to_polars(solution):
    """The result table as a polars data frame, same columns as the CSV file.

    Parameters
    ----------
    solution : BaselineSolution or AttitudeSolution
        Result of `truenorth.solve_session`.

    Returns
    -------
    polars.DataFrame
        ``time_gpst`` is a zone-less datetime in GPS time; missing numbers are NaN.
    """
    import polars as pl

    arrays = {
        name: np.ascontiguousarray(values.astype(str) if values.dtype.kind == "U" else values)
        for name, values in solution_columns(solution).items()
    }
    return pl.DataFrame(arrays)


def to_xarray(solution):
    """The whole result as an xarray dataset, with units and meanings as attributes.

    Parameters
    ----------
    solution : BaselineSolution or AttitudeSolution
        Result of `truenorth.solve_session`.

    Returns
    -------
    xarray.Dataset
        Dimensions ``time`` (GPS time), ``enu``, ``ecef`` and, for the phase residuals, ``residual``.
        Ready for NetCDF.
    """
    import xarray as xr

    if isinstance(solution, AttitudeSolution):
        return _attitude_dataset(solution)
    table = {column.name: column for column in COLUMNS}
    skipped = ("time_gpst", "status", "reason", "east_m", "north_m", "up_m")
    variables = {}
    for name, values in solution_columns(solution).items():
        if name in skipped or name.startswith(("cov_", "x_", "y_", "z_")):
            continue
        attributes = {"units": table[name].unit, "long_name": table[name].description}
        variables[name] = ("time", np.array(values), attributes)

    def add(name, dims, values, unit, meaning):
        variables[name] = (dims, np.array(values), {"units": unit, "long_name": meaning})

    add("status", "time", status_labels(solution), "", table["status"].description)
    add("reason", "time", reason_labels(solution), "", table["reason"].description)
    add("baseline_enu_m", ("time", "enu"), solution.baseline_enu_m, "m", "baseline from base to rover")
    add("baseline_ecef_m", ("time", "ecef"), solution.baseline_ecef_m, "m", "baseline from base to rover")
    add("cov_enu_m2", ("time", "enu", "enu_"), solution.cov_enu_m2, "m2", "covariance of the baseline")
    add("position_ecef_m", ("time", "ecef"), solution.position_ecef_m, "m", "base antenna, single point")
    add("residual_epoch", "residual", solution.residual_epoch, "1", "epoch index of the residual")
    add("residual_sat", "residual", solution.residual_sat, "1", "satellite, 100 * system + number")
    add("residual_signal", "residual", solution.residual_signal, "1", "signal, 100 * band + letter")
    add("residual_m", "residual", solution.residual_m, "m", "single-difference phase residual")
    for name, meaning in (("elevation", "elevation"), ("azimuth", "azimuth")):
        angle_rad = getattr(solution, f"residual_{name}_rad")
        add(
            f"residual_{name}_deg", "residual", np.degrees(angle_rad), "degree", f"{meaning} of the satellite"
        )

    time = ("time", gpst_to_datetime64(solution.time_ns), {"long_name": "GPS time"})
    axes = {"enu": ["east", "north", "up"], "enu_": ["east", "north", "up"], "ecef": ["x", "y", "z"]}
    attributes = {"title": "TrueNorth baseline solution", "convention": "azimuth clockwise from true north"}
    return xr.Dataset(variables, coords={"time": time, **axes}, attrs=attributes)


def _attitude_dataset(solution):
    """The attitude as an xarray dataset: its table, its covariance and its rotation."""
    import xarray as xr

    variables = {
        column.name: ("time", np.array(values), {"units": column.unit, "long_name": column.description})
        for column, values in zip(columns_of(solution), arrays_of(solution), strict=True)
        if column.name != "time_gpst" and not column.name.startswith("cov_")
    }
    angle, ned, body = ["heading", "pitch", "roll"], ["north", "east", "down"], ["forward", "right", "down"]
    variables["cov_deg2"] = (
        ("time", "angle", "angle_"),
        np.degrees(np.degrees(solution.cov_rad2)),
        {"units": "degree2", "long_name": "covariance of heading, pitch and roll"},
    )
    variables["rot_ned_from_body"] = (
        ("time", "ned", "body"),
        solution.rot_ned_from_body,
        {"units": "1", "long_name": "attitude"},
    )
    for name, flags in (("is_used", solution.is_used), ("is_excluded", solution.is_excluded)):
        variables[name] = (("time", "antenna"), flags, {"units": "1", "long_name": name.replace("_", " ")})
    time = ("time", gpst_to_datetime64(solution.time_ns), {"long_name": "GPS time"})
    axes = {"angle": angle, "angle_": angle, "ned": ned, "body": body, "antenna": list(solution.antennas)}
    attributes = {
        "title": "TrueNorth attitude solution",
        "convention": "body forward, right, down; intrinsic z-y-x angles from north, east, down",
    }
    return xr.Dataset(variables, coords={"time": time, **axes}, attrs=attributes)
