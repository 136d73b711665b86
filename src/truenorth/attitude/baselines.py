"""The baseline between two antennas from their raw observations, epoch by epoch.

Call stack: read -> single-point positions and clocks -> single differences -> integers -> solution; for a
long run block after block (`truenorth.attitude.runs`).
"""

import sys
import time
from dataclasses import fields, replace
from itertools import chain
from pathlib import Path

import msgspec
import numpy as np

from ..ambiguity.carried import ResolutionState
from ..ambiguity.resolution import estimate_variance_factors, group_references, resolve_epochs
from ..config import GnssSettings, convert_settings
from ..errors import Reason, Status
from ..frames import azimuth_elevation_from_enu
from .length_check import (
    FEW_ACCEPTED,
    compare_length,
    is_declared,
    length_warning,
    measure_free_length,
    sample_free_length,
)
from .provenance import add_provenance
from .runs import open_receiver, open_run
from .solution import BaselineSolution, EpochEvent

__all__ = ["Stages", "solve_baseline"]

MISLEADING_LENGTH_M = 0.05
"""A quarter of the shortest carrier wave: a smaller error of the length leaves the integers alone."""

MIN_EPOCHS_FOR_LENGTH = 10
"""Accepted epochs that an estimate of the length needs."""

RESIDUAL_ROWS = 1_000_000
"""Residual rows that a solution keeps unless told otherwise (about 50 bytes each)."""


def solve_baseline(
    base,
    rover,
    navigation=(),
    *,
    length_m=None,
    settings=None,
    progress=None,
    block_epochs=None,
    residual_rows=RESIDUAL_ROWS,
    **overrides,
):
    """Baseline from the base to the rover antenna at every common epoch.

    Parameters
    ----------
    base, rover : path, Observations or blocks
        Raw observations of the two receivers (RINEX, UBX), or what `truenorth.formats.open_observations`
        returned.
    navigation : path, sequence of paths or Navigation
        Broadcast ephemerides; may stay empty where the observation logs hold them (UBX).
    length_m : float, optional
        Known antenna separation, metres.
    settings : GnssSettings, optional
        All options; the defaults where omitted.
    progress : callable, optional
        Called with (epochs done, epochs in all).
    block_epochs : int, optional
        Common epochs that are in memory at a time; the result does not depend on it. By default a run is
        cut into blocks when it is long. A ``direction`` other than ``forward`` needs the whole run.
    residual_rows : int
        Residuals kept at most: in a longer run those of every second, fourth, ... epoch, with a warning.
    **overrides
        Single fields of `GnssSettings` by name.

    Returns
    -------
    BaselineSolution

    Raises
    ------
    FormatError
        If a file cannot be read.
    ConfigError
        If an option is unknown or impossible.
    NoSolutionError
        If the files hold nothing in common that could be solved.

    Examples
    --------
    >>> import truenorth
    >>> files = ("base.obs", "rover.obs", "brdc.nav")
    >>> solution = truenorth.solve_baseline(*files, length_m=0.99)  # doctest: +SKIP
    """
    settings = settings or GnssSettings()
    if length_m is not None:
        overrides["length_m"] = float(length_m)
    if overrides:
        table = msgspec.to_builtins(settings) | msgspec.to_builtins(overrides)
        settings = convert_settings(table, GnssSettings)
    stages = Stages()
    base, rover, navigation = _read_inputs(base, rover, navigation, settings)
    stages.end("read")
    run = open_run(base, rover, navigation, settings, block_epochs=block_epochs)
    said = ()
    if settings.estimate_length:
        settings, said = _estimate_length(run, settings)

    def solve(settings, *, is_refuted=False, residual_rows=residual_rows, progress=progress):
        return _solve(run, settings, is_refuted=is_refuted, residual_rows=residual_rows, progress=progress)

    # A length that the observations refute takes back what was accepted with it.
    check = sample_free_length(*run.sample(), settings) if is_declared(settings) else None
    if check is not None and check["verdict"] != "disagrees":
        check = None
    solution = solve(settings, is_refuted=_misleads(check))
    if check is None and is_declared(settings) and np.mean(solution.is_accepted) < FEW_ACCEPTED:
        free = measure_free_length(lambda free: solve(free, residual_rows=0, progress=None), settings)
        check = free if free["measured_m"] is not None else None
        if _misleads(check):
            solution = solve(settings, is_refuted=True)
    solution = add_provenance(solution, run.base, run.rover, navigation, settings)
    check = compare_length(solution) if check is None else check
    said = (*said, *solution.warnings)
    if settings.length_use != "off" and (text := length_warning(check)) is not None:
        said = (*said, text)
    stages.end("solve", read_s=run.read_s)
    return replace(solution, seconds=stages.seconds, warnings=tuple(dict.fromkeys(said)), length_check=check)


def _solve(run, settings, *, is_refuted=False, residual_rows=RESIDUAL_ROWS, progress=None):
    """Solve all blocks of a run; `is_refuted` takes back the epochs that are accepted."""
    of_sample, sample = run.sample()
    factors = estimate_variance_factors(of_sample, settings, sample)
    state = ResolutionState()
    parts, done, every = [], 0, 1
    for differences, base, rover in run.blocks():
        own_progress = progress and (lambda k, _, done=done: progress(done + k, run.n_epochs))
        resolved = resolve_epochs(
            differences, base, rover, settings, factors=factors, state=state, progress=own_progress
        )
        part = _assemble(differences, _take_back(resolved) if is_refuted else resolved, settings)
        parts.append(_thin(replace(part, residual_epoch=part.residual_epoch + done), every))
        while sum(len(part.residual_m) for part in parts) > residual_rows and every < 2 * run.n_epochs:
            every *= 2
            parts = [_thin(part, every) for part in parts]
        done += differences.n_epochs
        if progress is not None and done < run.n_epochs:
            progress(done, run.n_epochs)
    return _join(parts, every if residual_rows else 1, factors)


class Stages:
    """Wall time of the stages of a run, compilation apart."""

    def __init__(self):
        self.seconds = {"read": 0.0, "compile": 0.0, "solve": 0.0}
        self._compiled = self._compilation()
        self._since = time.perf_counter()

    @staticmethod
    def _compilation():
        # Before the first kernel there is nothing to ask, and no reason to load Numba.
        jit = sys.modules.get("truenorth._kernels.jit")
        return 0.0 if jit is None else jit.compile_clock.seconds

    def end(self, stage, *, read_s=0.0):
        """End a stage; of its time `read_s` went into reading."""
        now, compiled = time.perf_counter(), self._compilation()
        self.seconds["compile"] += compiled - self._compiled
        self.seconds[stage] += now - self._since - (compiled - self._compiled) - read_s
        self.seconds["read"] += read_s
        self._since, self._compiled = now, compiled


def _estimate_length(run, settings):
    """Length of the rigid baseline from a first run without it; returns (settings, warnings)."""
    free = msgspec.structs.replace(settings, length_m=None, direction_azimuth_deg=None)
    found = _solve(run, free, residual_rows=0)
    length = found.length_m[found.is_accepted]
    if len(length) < MIN_EPOCHS_FOR_LENGTH:
        text = (
            f"could not estimate the length: {len(length)} of {found.n_epochs} epochs were accepted without "
            f"it, {MIN_EPOCHS_FOR_LENGTH} needed; give `length_m`"
        )
        return free, (text,)
    middle = float(np.median(length))
    # Multipath does not average out in a run: the sd of one epoch, not of the mean.
    sd = max(1.4826 * float(np.median(np.abs(length - middle))), 0.001)
    settings = msgspec.structs.replace(settings, length_m=middle, length_sd_m=sd)
    return settings, (f"length estimated from {len(length)} epochs: {middle:.4f} m, sd {sd:.4f} m",)


def _misleads(check):
    """Whether a length is wrong by so much that it can choose wrong integers, not only bend right ones."""
    if check is None or check["verdict"] != "disagrees":
        return False
    return abs(check["difference_m"]) > MISLEADING_LENGTH_M


def _take_back(resolved):
    """Without the epochs that were accepted with a length which the observations refute."""
    from .._kernels import engine

    accepted = resolved.status >= Status.HELD
    has_float = np.isfinite(resolved.table[:, engine.FLOAT_X])
    status = np.where(accepted, np.where(has_float, Status.FLOAT, Status.NONE), resolved.status)
    reason = np.where(accepted, Reason.LENGTH_TEST, resolved.reason)
    return replace(resolved, status=status.astype(np.uint8), reason=reason.astype(np.uint8))


def _read_inputs(base, rover, navigation, settings):
    from ..formats import read_navigation
    from ..navigation import Navigation

    if isinstance(navigation, (str, Path)):
        navigation = (navigation,)
    if not isinstance(navigation, Navigation):
        paths = list(navigation)
        if not paths:
            paths = [p for p in (base, rover) if isinstance(p, (str, Path))]
        navigation = read_navigation(*paths)
    whole = settings.direction != "forward"
    return open_receiver(base, whole=whole), open_receiver(rover, whole=whole), navigation


def _thin(part, every):
    """Only the residuals of every so many epochs, so of none where these are more than there are."""
    if every == 1:
        return part
    keep = (part.residual_epoch + 1) % every == 0
    names = [field.name for field in fields(part) if field.name.startswith("residual_")]
    return replace(part, **{name: getattr(part, name)[keep] for name in names})


def _join(parts, every, factors):
    """One solution from those of its blocks, which are gone afterwards."""
    solution = parts[0]
    if len(parts) > 1:
        names = [field.name for field in fields(solution)]
        names = [name for name in names if isinstance(getattr(solution, name), np.ndarray)]
        pieces = {name: [getattr(part, name) for part in parts] for name in names}
        events = tuple(chain.from_iterable(part.events for part in parts))
        # Column after column, so that only one of them is in memory twice.
        parts.clear()
        joined = {name: np.concatenate(pieces.pop(name)) for name in names}
        solution = replace(solution, **joined, events=events)
    said = ()
    if every > 1:
        text = "none is kept" if every > solution.n_epochs else f"those of one epoch in {every} are kept"
        said = (
            f"of the phase residuals {text}, {len(solution.residual_m)} rows; "
            "`residual_rows` says how many there may be",
        )
    inputs = {"variance_factors": {"phase": float(factors[0]), "code": float(factors[1])}}
    return replace(solution, inputs=inputs, warnings=said)


def _assemble(differences, resolved, settings):
    """The public result from the engine's table."""
    from .._kernels import engine as kernel

    d, r = differences, resolved
    n = d.n_epochs
    table = r.table
    status = r.status.copy()
    fixed = (status == Status.FIXED) | (status == Status.HELD)
    is_float = status == Status.FLOAT

    def symmetric(first):
        xx, yy, zz, xy, xz, yz = (table[:, first + k] for k in range(6))
        return np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1).reshape(n, 3, 3)

    enu = np.where(fixed[:, None], table[:, kernel.BX : kernel.BZ + 1], np.nan)
    enu[is_float] = table[is_float, kernel.FLOAT_X : kernel.FLOAT_X + 3]
    cov = np.where(fixed[:, None, None], symmetric(kernel.COV), np.nan)
    cov[is_float] = symmetric(kernel.FLOAT_COV)[is_float]
    length = np.where(fixed, table[:, kernel.LENGTH], np.linalg.norm(enu, axis=1))
    azimuth, elevation = azimuth_elevation_from_enu(enu)
    horizontal = np.hypot(enu[:, 0], enu[:, 1])
    size = np.linalg.norm(enu, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        g_az = np.stack([enu[:, 1], -enu[:, 0], np.zeros(n)], axis=1) / horizontal[:, None] ** 2
        g_el = np.stack([-enu[:, 2] * enu[:, 0], -enu[:, 2] * enu[:, 1], horizontal**2], axis=1)
        g_el /= (horizontal * size**2)[:, None]
        unit = enu / size[:, None]

    def column(k):
        # A copy: a view would keep the whole table in memory.
        return table[:, k].copy()

    def spread(g):
        return np.sqrt(np.einsum("ni,nij,nj->n", g, cov, g))

    length_sd = np.where(fixed, table[:, kernel.LENGTH_SD], spread(unit))
    epoch = np.repeat(np.arange(n), np.diff(r.start))
    is_reference = group_references(epoch, d.group[r.row], r.integer_cyc) == np.arange(len(r.row))
    sat_key = np.unique(epoch * 1000 + d.sat[r.row])
    n_sats = np.bincount(sat_key // 1000, minlength=n)
    ecef = np.einsum("nji,nj->ni", d.rot_enu_from_ecef, enu)
    return BaselineSolution(
        time_ns=d.time_ns,
        status=status,
        reason=r.reason,
        baseline_ecef_m=ecef,
        baseline_enu_m=enu,
        cov_enu_m2=cov,
        azimuth_rad=azimuth,
        elevation_rad=elevation,
        azimuth_sd_rad=spread(g_az),
        elevation_sd_rad=spread(g_el),
        length_m=length,
        length_sd_m=length_sd,
        n_sats=n_sats.astype(np.int16),
        n_signals=np.nan_to_num(table[:, kernel.N_PHASES]).astype(np.int16),
        pdop=column(kernel.PDOP),
        hdop=column(kernel.HDOP),
        vdop=column(kernel.VDOP),
        azimuth_dop=column(kernel.AZ_DOP),
        elevation_dop=column(kernel.EL_DOP),
        ratio=column(kernel.RATIO),
        success_probability=column(kernel.PROBABILITY),
        chi2=column(kernel.CHI2),
        chi2_limit=column(kernel.CHI2_LIMIT),
        quality=_quality(status, cov),
        position_ecef_m=d.position_ecef_m,
        residual_epoch=epoch,
        residual_sat=d.sat[r.row],
        residual_signal=d.signal[r.row],
        residual_m=r.residual_m,
        residual_elevation_rad=d.elevation_rad[r.row],
        residual_azimuth_rad=d.azimuth_rad[r.row],
        residual_integer_cyc=r.integer_cyc,
        residual_is_reference=is_reference,
        candidate_length_m=column(kernel.LENGTH),
        candidate_length_sd_m=column(kernel.LENGTH_SD),
        events=tuple(EpochEvent(*event) for event in sorted(r.events, key=lambda event: event[0])),
    )


def _quality(status, cov):
    """Quality class 1 (integer) to 6, by status and expected error; Landfahrer 2009, table 5.1."""
    sd = np.sqrt(np.einsum("nii->n", cov))
    quality = np.zeros(len(status), np.uint8)
    known = np.isfinite(sd)
    quality[known] = np.digitize(sd[known], [0.40, 1.00, 2.00, 5.00]).astype(np.uint8) + 2
    fixed = (status == Status.FIXED) | (status == Status.HELD)
    quality[fixed] = np.where(sd[fixed] <= 0.15, 1, 2)
    quality[status == Status.NONE] = 0
    return quality
