"""Boresight between two attitude series from their tables: matched in time, the reference interpolated."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import FormatError
from ..rotations import exp_so3, log_so3, rot_ned_from_body
from ..timescales import NS_PER_S
from .tracks import ATTITUDE, reference_track, solution_track

if TYPE_CHECKING:
    from ..calibration.mounting import Boresight

__all__ = ["boresight_of_tracks"]

MAX_GAP_S = 2.0
"""Across a longer gap the reference is not interpolated."""


def boresight_of_tracks(solution: Any, reference: Any, *, test_share: float = 0.0) -> Boresight:
    """Constant rotation between the platform of a solution and that of a reference.

    Parameters
    ----------
    solution : AttitudeSolution, path-like or dict
        Attitude of the array; accepted epochs with three angles count.
    reference : path-like, dict or AttitudeSolution
        Attitude of the IMU, turned evenly between its epochs.
    test_share : float
        As for `truenorth.calibration.mounting.align_attitudes`.

    Returns
    -------
    Boresight
        From the frame of the solution to that of the reference.

    Raises
    ------
    FormatError
        If a table cannot be read or does not have three angles.
    NoSolutionError
        If they have fewer than three epochs in common.
    """
    from ..calibration.mounting import align_attitudes

    own, other = solution_track(solution), reference_track(reference)
    for track, name in ((own, "solution"), (other, "reference")):
        if track.angles != ATTITUDE:
            raise FormatError(f"the {name} has no heading, pitch and roll; give the attitude of an array")
    rot_own, rot_other = rot_ned_from_body(*own.angle_rad.T), rot_ned_from_body(*other.angle_rad.T)
    known = np.isfinite(rot_other).all((1, 2))
    time_ns, rot_other = other.time_ns[known], rot_other[known]
    matched = np.full(rot_own.shape, np.nan)
    if len(time_ns) > 1:
        after = np.clip(np.searchsorted(time_ns, own.time_ns), 1, len(time_ns) - 1)
        gap_ns = time_ns[after] - time_ns[after - 1]
        share = (own.time_ns - time_ns[after - 1]) / gap_ns
        inside = (share >= 0.0) & (share <= 1.0) & (gap_ns <= MAX_GAP_S * NS_PER_S)
        before = rot_other[after - 1]
        turn = log_so3(np.swapaxes(before, 1, 2) @ rot_other[after])
        matched[inside] = (before @ exp_so3(share[:, None] * turn))[inside]
    return align_attitudes(rot_own, matched, time_ns=own.time_ns, test_share=test_share)
