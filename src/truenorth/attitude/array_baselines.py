"""The attitude of an array from baselines that were resolved one by one, each with its length or without.

What the array falls back on where its observations refute the body coordinates, and the way of the published
systems: the accepted baselines of an epoch, freed of the length that adjusted them, give heading, pitch and
roll (`truenorth.attitude.vectors`) and must fit the body coordinates. With four antennas or more a baseline
that does not fit is found by leaving each out in turn.
"""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np

from ..config import ArraySettings
from ..errors import NoSolutionError, Reason, Status
from ..timescales import NS_PER_S
from .adjustment import ArrayAdjustment, free_of_length
from .array_solution import AttitudeSolution
from .array_vectors import ArrayVectors
from .baselines import RESIDUAL_ROWS, solve_baseline
from .geometry_checks import GeometryCheckSettings
from .solution import EpochEvent
from .vectors import shared_reference_covariance

__all__ = ["attitude_from_baselines", "solve_by_baselines"]

MIN_LENGTH_SD_M = 5e-4
"""A length better known than this could not be taken out of an adjusted baseline without loss of digits."""

MAX_SHARE_OF_LENGTH = 0.2
"""A baseline may be uncertain by this share of its length, without it; its mirror image is further away."""

BLOCK_EPOCHS = 20_000
"""Epochs whose rotations are estimated at once, which bounds the memory."""

_NED_FROM_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def solve_by_baselines(
    receivers, positions_body_m, navigation, settings, *, array=None, names, length=True, progress=None,
    keep_residuals=False,
):  # fmt: skip
    """Attitude of a rigid array from the baselines between the first antenna and each other one.

    Parameters
    ----------
    receivers : sequence of Observations or blocks
        Of the antennas, the reference first.
    positions_body_m : ndarray, shape (n_antennas, 3)
        Body coordinates.
    navigation : Navigation
        Broadcast ephemerides.
    settings : GnssSettings
        Of every baseline; ``length_sd_m`` is how well the distances are known.
    array : ArraySettings, optional
        ``angle_tolerance_deg`` and ``keep_vectors``.
    names : sequence of str
        Of the antennas.
    length : bool
        Whether the distance by the body coordinates constrains the integers of a baseline.
    progress : callable, optional
        Called with (epochs done, epochs in all), the baselines one after another.
    keep_residuals : bool
        Keep the phase residuals of every baseline.

    Returns
    -------
    solution : AttitudeSolution
    seconds : dict of str to float
        Wall time of read, compile and solve.

    Raises
    ------
    NoSolutionError
        If no antenna has anything in common with the reference that could be solved.
    """
    seconds = {"read": 0.0, "compile": 0.0, "solve": 0.0}
    baselines, warnings = [], []
    for k, rover in enumerate(receivers[1:]):
        length_m = float(np.linalg.norm(positions_body_m[k + 1] - positions_body_m[0]))
        own = msgspec.structs.replace(
            settings, length_m=length_m, length_sd_m=max(settings.length_sd_m, MIN_LENGTH_SD_M)
        )
        if not length:
            own = msgspec.structs.replace(own, length_use="compute")
        try:
            solution = solve_baseline(
                receivers[0],
                rover,
                navigation,
                settings=own,
                progress=_part(progress, k, len(receivers) - 1),
                residual_rows=RESIDUAL_ROWS if keep_residuals else 0,
            )
        except NoSolutionError as error:
            warnings.append(f"{names[k + 1]}: left out, {error}")
            baselines.append(None)
            continue
        for stage in seconds:
            seconds[stage] += solution.seconds[stage]
        warnings += [f"{names[k + 1]}: {text}" for text in solution.warnings]
        baselines.append(solution)
    if all(solution is None for solution in baselines):
        raise NoSolutionError(f"could not solve the array: {'; '.join(warnings)}")
    kept = [k for k, solution in enumerate(baselines) if solution is not None]
    solution = attitude_from_baselines(
        [baselines[k] for k in kept],
        positions_body_m[[0] + [k + 1 for k in kept]],
        receivers[0].time_ns,
        names=[names[0]] + [names[k + 1] for k in kept],
        settings=settings,
        array=array,
    )
    factors = {names[k + 1]: baselines[k].inputs["variance_factors"] for k in kept}
    solution = replace(
        solution,
        level="length" if length else "free",
        inputs={"variance_factors": factors},
        warnings=tuple(dict.fromkeys((*warnings, *solution.warnings))),
    )
    return solution, seconds


def attitude_from_baselines(baselines, positions_body_m, time_ns, *, names, settings, array=None):
    """Attitude from baselines that share their first antenna.

    Parameters
    ----------
    baselines : sequence of BaselineSolution
        From the reference antenna to each other one.
    positions_body_m : ndarray, shape (n_baselines + 1, 3)
        Body coordinates, the reference first.
    time_ns : ndarray of int64
        Epochs of the reference receiver.
    names : sequence of str
        Of the antennas.
    settings : GnssSettings
        ``residual_significance``, ``length_sd_m`` and ``max_time_difference_s`` are used.
    array : ArraySettings, optional
        ``angle_tolerance_deg`` and ``keep_vectors``; the defaults where omitted.

    Returns
    -------
    AttitudeSolution
        At the epochs of the reference receiver that any baseline has.
    """
    body_m = positions_body_m[1:] - positions_body_m[0]
    time_ns, row = _align([solution.time_ns for solution in baselines], time_ns, settings)
    n, m = row.shape
    reason = np.zeros((n, m), np.uint8)
    status = np.zeros((n, m), np.uint8)
    n_sats = np.zeros((n, m), np.int16)
    vector_m, cov_m2 = np.full((n, m, 3), np.nan), np.full((n, m, 3, 3), np.nan)
    position_ecef_m = np.full((n, 3), np.nan)
    for k, solution in enumerate(baselines):
        here = np.flatnonzero(row[:, k] >= 0)
        at = row[here, k]
        status[here, k], reason[here, k] = solution.status[at], solution.reason[at]
        n_sats[here, k] = solution.n_sats[at]
        for first in range(0, len(here), BLOCK_EPOCHS):
            part = slice(first, first + BLOCK_EPOCHS)
            enu_m, cov_enu_m2 = free_of_length(solution, at[part])
            vector_m[here[part], k] = enu_m @ _NED_FROM_ENU.T
            cov_m2[here[part], k] = _NED_FROM_ENU @ cov_enu_m2 @ _NED_FROM_ENU.T
        unknown = here[np.isnan(position_ecef_m[here, 0])]
        position_ecef_m[unknown] = solution.position_ecef_m[row[unknown, k]]
    accepted = (status == Status.FIXED) | (status == Status.HELD)
    array = array or ArraySettings()
    checks = None
    if array.angle_tolerance_deg is not None:
        checks = GeometryCheckSettings(angle_tolerance_deg=array.angle_tolerance_deg)
    adjustment = ArrayAdjustment(body_m, n, settings, checks)
    for first in range(0, n, BLOCK_EPOCHS):
        part = slice(first, first + BLOCK_EPOCHS)
        weak = accepted[part] & ~_stand_alone(cov_m2[part], np.linalg.norm(body_m, axis=1))
        reason[part][weak] = Reason.WEAK_GEOMETRY
        accepted[part] &= ~weak
        adjustment.solve(np.arange(first, min(first + BLOCK_EPOCHS, n)), vector_m, cov_m2, accepted)
    a = adjustment
    # What no baseline explains is explained by the one that came nearest.
    nearest = np.argmax(status, axis=1)
    epoch_reason = np.where(accepted.any(1), a.reason, reason[np.arange(n), nearest])
    held = np.any(a.is_used & (status == Status.HELD), axis=1)
    epoch_status = np.where(a.is_solved, np.where(held, Status.HELD, Status.FIXED), Status.NONE)
    fewest = np.where(a.is_used, n_sats, np.iinfo(np.int16).max).min(1)
    vectors = None
    if array.keep_vectors:
        vectors = _joint_vectors(time_ns, vector_m, cov_m2, accepted & a.is_used, positions_body_m, names, a)
    with_reference = a.is_used.any(1, keepdims=True)
    solution = AttitudeSolution(
        time_ns=time_ns,
        status=epoch_status.astype(np.uint8),
        reason=epoch_reason.astype(np.uint8),
        heading_rad=a.angle_rad[:, 0],
        pitch_rad=a.angle_rad[:, 1],
        roll_rad=a.angle_rad[:, 2],
        cov_rad2=a.cov_rad2,
        rot_ned_from_body=a.rot,
        is_used=np.hstack([with_reference, a.is_used]),
        is_excluded=np.hstack([np.zeros((n, 1), bool), a.is_excluded]),
        chi2=a.chi2,
        chi2_limit=a.chi2_limit,
        success_probability=np.full(n, np.nan),
        n_sats=np.where(a.is_used.any(1), fewest, 0).astype(np.int16),
        position_ecef_m=position_ecef_m,
        antennas=tuple(names),
        positions_body_m=np.asarray(positions_body_m),
        vectors=vectors,
        baselines=tuple(baselines),
        settings=msgspec.to_builtins(settings) | {"array": msgspec.to_builtins(array)},
    )
    return replace(solution, events=tuple(_events(solution)))


def _joint_vectors(time_ns, vector_m, cov_m2, is_used, positions_body_m, names, adjustment):
    """Baselines that took part as vectors with the covariance of the reference antenna they share."""
    n, m = is_used.shape
    vector = np.full((n, m + 1, 3), np.nan)
    vector[:, 1:] = np.where(is_used[:, :, None], vector_m, np.nan)
    cov = np.full((n, 3 * m + 3, 3 * m + 3), np.nan, np.float32)
    for first in range(0, n, BLOCK_EPOCHS):
        part = slice(first, first + BLOCK_EPOCHS)
        known = np.repeat(is_used[part], 3, axis=1)
        some = np.where(is_used[part][:, :, None, None], cov_m2[part], np.eye(3))
        joint = shared_reference_covariance(some)
        cov[part, 3:, 3:] = np.where(known[:, :, None] & known[:, None, :], joint, np.nan)
    reference = np.where(is_used.any(1), 0, -1).astype(np.int16)
    return ArrayVectors(
        time_ns, reference, vector, cov, np.asarray(positions_body_m, float), adjustment.body_cov_m2,
        tuple(names),
    )  # fmt: skip


def _stand_alone(cov_m2, length_m):
    """Whether the phases of a baseline determine it without its length, shape (n, n_baselines).

    Three satellites leave a line of baselines, which the sphere of the known length meets twice: two mirror
    images of the whole array that lengths and angles cannot tell apart.
    """
    known = np.isfinite(cov_m2).all((2, 3))
    variance_m2 = np.linalg.eigvalsh(cov_m2[known])
    reach_m = np.broadcast_to(MAX_SHARE_OF_LENGTH * length_m, known.shape)[known]
    known[known] = (variance_m2[:, 0] > 0.0) & (variance_m2[:, 2] < reach_m**2)
    return known


def _align(times_ns, reference_ns, settings):
    """Epochs of the reference that any baseline has, and the row of each baseline there, -1 for none."""
    row = np.full((len(reference_ns), len(times_ns)), -1, np.int64)
    for k, time_ns in enumerate(times_ns):
        after = np.clip(np.searchsorted(reference_ns, time_ns), 1, max(len(reference_ns) - 1, 1))
        before_is_nearer = (
            time_ns - reference_ns[after - 1] < reference_ns[after % len(reference_ns)] - time_ns
        )
        at = np.where(before_is_nearer, after - 1, after % len(reference_ns))
        near = np.abs(reference_ns[at] - time_ns) <= settings.max_time_difference_s * NS_PER_S
        row[at[near], k] = np.flatnonzero(near)
    known = np.any(row >= 0, axis=1)
    return reference_ns[known], row[known]


def _events(solution):
    """When the attitude was found and lost, and when antennas were left out and came back."""
    n = solution.n_epochs

    def changes(flags):
        """Epochs at which a flag changes, and what it changes to."""
        at = np.flatnonzero(np.diff(flags, prepend=False))
        return zip(at.tolist(), flags[at].tolist(), strict=True)

    found = []
    for at, is_up in changes(solution.is_accepted):
        used = int(solution.n_antennas_used[at])
        text = f"attitude from {used} antennas" if is_up else "no attitude"
        found.append((at, "fixed" if is_up else "released", text))
    for k, name in enumerate(solution.antennas):
        for at, is_out in changes(solution.is_excluded[:, k]):
            text = "contradicts the other antennas and is left out" if is_out else "is no longer left out"
            found.append((at, "excluded" if is_out else "returned", f"{name} {text}"))
    for at, kind, text in sorted(found):
        time_ns = int(solution.time_ns[min(at, n - 1)])
        yield EpochEvent(
            time_ns, kind, "", "", float(solution.chi2[at]), float(solution.chi2_limit[at]), text
        )


def _part(progress, k, n_parts):
    """Progress of one baseline as part of the whole."""
    if progress is None:
        return None
    return lambda done, total: progress(k * total + done, n_parts * total)
