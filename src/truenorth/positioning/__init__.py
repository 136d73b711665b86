"""Single-point position and velocity, and the dilution of precision of baselines."""

from .dops import BaselineDops, baseline_dops
from .single_point import (
    CODE_PRIORITY,
    POINT_STATUS_SENTENCES,
    PointSolution,
    PointStatus,
    SatelliteView,
    select_codes,
    solve_single_point,
)

__all__ = [
    "CODE_PRIORITY",
    "POINT_STATUS_SENTENCES",
    "BaselineDops",
    "PointSolution",
    "PointStatus",
    "SatelliteView",
    "baseline_dops",
    "select_codes",
    "solve_single_point",
]
