"""The attitude of an array with its integers resolved jointly, the body geometry inside the search.

Call stack: every receiver is read and positioned once (`truenorth.attitude.array_run`), the noise is taken
from a sample of epochs that are resolved each by itself, then one compiled pass over all epochs gives
integers, rotation, tests and the vectors between the antennas.
"""

from __future__ import annotations

import msgspec
import numpy as np

from ..ambiguity.resolution import median_factor
from ..config import ArraySettings
from ..errors import NoSolutionError, Reason, Status
from ..rotations import heading_pitch_roll
from .array_run import EXCLUDED, USED, ArrayEngine, ArrayRun
from .array_solution import AttitudeSolution, PhaseResiduals
from .array_vectors import ArrayVectors
from .solution import EpochEvent
from .vector_methods import ALONG_X, MAX_SD_RAD
from .vectors import angle_covariance

__all__ = ["solve_joint"]

SAMPLE_EPOCHS = 60
"""Epochs from which the noise is estimated."""

FACTOR_PASSES = 3
"""Times that the noise is estimated, each with the noise of the time before."""

SURE = 0.95
"""Winners less probable than this say nothing of the noise: a wrong one fits too well."""


def solve_joint(
    receivers,
    positions_body_m,
    navigation,
    settings,
    *,
    array=None,
    names,
    progress=None,
    keep_residuals=False,
    block_epochs=None,
):
    """Attitude of a rigid array, all antennas in one search and one adjustment.

    Parameters
    ----------
    receivers : sequence of Observations or blocks
        Of the antennas.
    positions_body_m : ndarray, shape (n_antennas, 3)
        Body coordinates.
    navigation : Navigation
        Broadcast ephemerides.
    settings : GnssSettings
        Systems, bands, masks, noise and tests.
    array : ArraySettings, optional
        Uncertainty of the coordinates, demanded probability; the defaults where omitted.
    names : sequence of str
        Of the antennas.
    progress : callable, optional
        Called with (epochs done, epochs in all).
    keep_residuals : bool
        Keep the residual of every phase.
    block_epochs : int, optional
        Epochs that are in memory at a time.

    Returns
    -------
    solution : AttitudeSolution
    read_s : float
        Seconds of the time that went into reading.

    Raises
    ------
    NoSolutionError
        If no two receivers have an epoch with common signals.
    """
    array = array or ArraySettings()
    run = ArrayRun(receivers, navigation, settings, block_epochs)
    factors = _variance_factors(run, positions_body_m, settings, array)
    engine = ArrayEngine(
        positions_body_m, settings, array, factors=factors, names=names, keep_vectors=array.keep_vectors
    )
    parts, done, seen = [], 0, set()
    for rows, resumed in run.blocks():
        block = engine.step(rows, resumed)
        parts.append(_assemble(block, done, names, positions_body_m, keep_residuals))
        done += rows.n_epochs
        seen.update(np.unique(rows.antenna[np.isfinite(rows.phase_m)]).tolist())
        if progress is not None:
            progress(min(done, run.n_epochs), run.n_epochs)
    if not parts:
        raise NoSolutionError(
            "could not solve the array: no two antennas have an epoch with common signals; give files of the "
            "same time, or widen `systems` and `bands`"
        )
    columns, vectors, residuals, events = _join(parts)
    m = len(positions_body_m)
    never = np.flatnonzero(~columns["is_used"].any(0)) if columns["is_used"].any() else []
    said = [
        f"{names[k]}: took part in no epoch; it has no epochs with signals in common with the others"
        if k not in seen
        else f"{names[k]}: took part in no epoch; its phases contradict those of the others or are too few"
        for k in never
    ]
    solution = AttitudeSolution(
        **columns,
        antennas=tuple(names),
        positions_body_m=np.asarray(positions_body_m, float),
        level="joint",
        vectors=ArrayVectors(
            time_ns=columns["time_ns"],
            positions_body_m=np.asarray(positions_body_m, float),
            body_cov_m2=array.position_sd_m**2 * np.eye(3 * m),
            names=tuple(names),
            **vectors,
        )
        if array.keep_vectors
        else None,
        residuals=PhaseResiduals(**residuals) if keep_residuals else None,
        settings=msgspec.to_builtins(settings) | {"array": msgspec.to_builtins(array)},
        inputs={"variance_factors": {"phase": float(factors[0]), "code": float(factors[1])}},
        warnings=tuple(said),
        events=tuple(EpochEvent(*event) for event in sorted(events, key=lambda event: event[0])),
    )
    return solution, run.read_s


def _variance_factors(run, positions_body_m, settings, array):
    """Variance factors of phases and codes from the sure winners of a sample of epochs."""
    from .._kernels import array_engine as kernel

    if not settings.stochastic.estimate:
        return 1.0, 1.0
    rows = run.sample(SAMPLE_EPOCHS)
    if rows is None:
        return 1.0, 1.0
    alone = msgspec.structs.replace(settings, single_epoch=True)
    # The test must not sort out what the factor is to be taken from.
    alone = msgspec.structs.replace(alone, residual_significance=1e-12)
    easy = msgspec.structs.replace(array, success_probability=0.5)
    factors = 1.0, 1.0
    for _ in range(FACTOR_PASSES):
        block = ArrayEngine(positions_body_m, alone, easy, factors=factors, keep_vectors=False).step(rows)
        table = block.table
        sure = table[:, kernel.PROBABILITY] > SURE
        if not sure.any():
            break
        phase = median_factor(table[sure, kernel.CHI2], table[sure, kernel.CHI2_DOF])
        chi2, dof = _code_chi2(block, factors[1], positions_body_m)
        code = median_factor(chi2[sure], dof[sure])
        factors = factors[0] * phase, factors[1] * code
    return factors


def _code_chi2(block, factor, positions_body_m):
    """Square sum of the codes at the attitude of the phases, and its degrees of freedom, every epoch."""
    from .._kernels import array_engine as kernel

    rows = block.rows
    chi2, dof = np.full(rows.n_epochs, np.nan), np.zeros(rows.n_epochs)
    for k in np.flatnonzero(block.status >= Status.HELD):
        here = np.arange(rows.start[k], rows.start[k + 1])
        here = here[np.isfinite(rows.code_m[here])]
        rot = block.table[k, kernel.ROT : kernel.ROT + 9].reshape(3, 3)
        vector = (positions_body_m @ rot.T)[rows.antenna[here]]
        misfit = rows.code_m[here] - np.sum(rows.design_ned[here] * vector, axis=1)
        weight = 1.0 / np.sqrt(factor * rows.code_variance_m2[here])
        clock = rows.group[here] * 100 + rows.antenna[here]
        _, satellite = np.unique(rows.satellite[here], return_inverse=True)
        _, clock = np.unique(clock, return_inverse=True)
        nuisance = np.zeros((len(here), satellite.max(initial=-1) + clock.max(initial=-1) + 2))
        nuisance[np.arange(len(here)), satellite] = weight
        nuisance[np.arange(len(here)), satellite.max(initial=-1) + 1 + clock] = weight
        found, _, rank, _ = np.linalg.lstsq(nuisance, weight * misfit, rcond=1e-10)
        chi2[k] = np.sum((weight * misfit - nuisance @ found) ** 2)
        dof[k] = len(here) - rank
    return chi2, dof


def _assemble(block, first_epoch, names, positions_body_m, keep_residuals):
    """Columns of the solution of one block."""
    from .._kernels import array_engine as kernel

    rows, table = block.rows, block.table
    accepted = block.status >= Status.HELD
    # Under satellites in too few directions a turn is open: known no better than this it is not known.
    is_open = accepted & ~(table[:, kernel.COV : kernel.COV + 3].max(1) <= MAX_SD_RAD**2)
    accepted &= ~is_open
    n = rows.n_epochs
    rot = np.full((n, 3, 3), np.nan)
    rot[accepted] = table[accepted, kernel.ROT : kernel.ROT + 9].reshape(-1, 3, 3)
    xx, yy, zz, xy, xz, yz = (table[:, kernel.COV + k] for k in range(6))
    cov_ned = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1).reshape(n, 3, 3)
    angle = np.full((n, 3), np.nan)
    cov = np.full((n, 3, 3), np.nan)
    angle[accepted] = np.stack(heading_pitch_roll(rot[accepted]), axis=-1)
    cov[accepted] = angle_covariance(rot[accepted], cov_ned[accepted])
    status, reason = block.status.copy(), block.reason.copy()
    status[is_open], reason[is_open] = Status.NONE, Reason.WEAK_GEOMETRY
    # Antennas on one line: heading and pitch where it is that of the x axis, else a direction only.
    for k in np.flatnonzero(accepted & (table[:, kernel.IS_LINE] > 0.5)):
        used = positions_body_m[block.part[k] == USED]
        arm = used[np.argmax(np.linalg.norm(used - used[0], axis=1))] - used[0]
        rot[k], angle[k, 2], cov[k, 2, :], cov[k, :, 2] = np.nan, np.nan, np.nan, np.nan
        reason[k] = Reason.ROLL_UNOBSERVABLE
        if np.hypot(arm[1], arm[2]) > ALONG_X * abs(arm[0]):
            angle[k], cov[k], status[k], reason[k] = np.nan, np.nan, Status.NONE, Reason.DIRECTION_ONLY
    took_part = np.isfinite(block.residual_m)
    epoch = np.repeat(np.arange(n), np.diff(rows.start))
    satellites = np.unique(epoch[took_part] * 1000 + rows.sat[took_part]) // 1000
    columns = {
        "time_ns": rows.time_ns,
        "status": status,
        "reason": reason,
        "heading_rad": angle[:, 0],
        "pitch_rad": angle[:, 1],
        "roll_rad": angle[:, 2],
        "cov_rad2": cov,
        "rot_ned_from_body": rot,
        "is_used": block.part == USED,
        "is_excluded": block.part == EXCLUDED,
        "chi2": table[:, kernel.CHI2].copy(),
        "chi2_limit": table[:, kernel.CHI2_LIMIT].copy(),
        "success_probability": table[:, kernel.PROBABILITY].copy(),
        "n_sats": np.bincount(satellites, minlength=n).astype(np.int16),
        "position_ecef_m": rows.position_ecef_m,
    }
    reference = np.where(accepted, np.nan_to_num(table[:, kernel.REFERENCE], nan=-1.0), -1).astype(np.int16)
    vectors = {"reference": reference, "vector_ned_m": block.vector_ned_m, "cov_ned_m2": block.cov_ned_m2}
    keep = took_part if keep_residuals else np.zeros(len(took_part), bool)
    residuals = {
        "epoch": epoch[keep] + first_epoch,
        "antenna": rows.antenna[keep].astype(np.int16),
        "sat": rows.sat[keep].astype(np.int16),
        "signal": rows.signal[keep].astype(np.int16),
        "residual_m": block.residual_m[keep],
        "azimuth_rad": rows.azimuth_rad[keep],
        "elevation_rad": rows.elevation_rad[keep],
        "integer_cyc": block.integer_cyc[keep],
    }
    return columns, vectors, residuals, [*block.events, *_antenna_events(block, names)]


def _antenna_events(block, names):
    """When antennas joined and left the adjustment within a block."""
    part = block.part
    accepted = block.status >= Status.HELD
    for k, name in enumerate(names):
        used = part[:, k] == USED
        change = np.flatnonzero(accepted[1:] & accepted[:-1] & (used[1:] != used[:-1])) + 1
        for at in change:
            if part[at, k] == EXCLUDED:
                continue
            text = f"{name} takes part" if used[at] else f"{name} takes no part: it has no phases to go on"
            count = float(np.count_nonzero(part[at] == USED))
            yield int(block.rows.time_ns[at]), "returned" if used[at] else "lost", "", "", count, np.nan, text


def _join(parts):
    """Columns, vectors and residuals of a run from those of its blocks."""
    joined = []
    for which in range(3):
        pieces = {name: [part[which][name] for part in parts] for name in parts[0][which]}
        joined.append({name: np.concatenate(pieces.pop(name)) for name in list(pieces)})
    return *joined, [event for part in parts for event in part[3]]
