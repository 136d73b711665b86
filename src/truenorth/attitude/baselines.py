"""The baseline between two antennas from their raw observations, epoch by epoch.

Call stack: read -> single-point positions and clocks -> single differences -> integers -> solution.
"""

import sys
import time
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np

from ..ambiguity.differencing import build_single_differences
from ..ambiguity.resolution import group_references, resolve_epochs
from ..config import GnssSettings, convert_settings
from ..errors import NoSolutionError, Reason, Status
from ..frames import azimuth_elevation_from_enu
from .provenance import add_provenance
from .solution import BaselineSolution, EpochEvent

__all__ = ["solve_baseline"]

MISLEADING_LENGTH_M = 0.05
"""A quarter of the shortest carrier wave: a smaller error of the length leaves the integers alone."""

MIN_EPOCHS_FOR_LENGTH = 10
"""Accepted epochs that an estimate of the length needs."""


def solve_baseline(base, rover, navigation=(), *, length_m=None, settings=None, progress=None, **overrides):
    """Baseline from the base to the rover antenna at every common epoch.

    Parameters
    ----------
    base, rover : path or Observations
        Raw observations of the two receivers (RINEX, UBX).
    navigation : path, sequence of paths or Navigation
        Broadcast ephemerides; may stay empty where the observation logs hold them (UBX).
    length_m : float, optional
        Known antenna separation, metres.
    settings : GnssSettings, optional
        All options; the defaults where omitted.
    progress : callable, optional
        Called with (epochs done, epochs in all).
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
    from ..positioning import solve_single_point

    settings = settings or GnssSettings()
    if length_m is not None:
        overrides["length_m"] = float(length_m)
    if overrides:
        table = msgspec.to_builtins(settings) | msgspec.to_builtins(overrides)
        settings = convert_settings(table, GnssSettings)
    stages = _Stages()
    base, rover, navigation = _read_inputs(base, rover, navigation)
    stages.end("read")
    options = {"systems": settings.systems, "elevation_mask_deg": min(settings.elevation_mask_deg, 10.0)}
    base_point = solve_single_point(base, navigation, **options)
    rover_point = solve_single_point(rover, navigation, **options)
    differences = build_single_differences(base, rover, base_point, rover_point, settings)
    said = ()
    if settings.estimate_length:
        settings, said = _estimate_length(differences, base, rover, settings)
    resolved = resolve_epochs(differences, base, rover, settings, progress=progress)
    solution = add_provenance(
        _assemble(differences, resolved, settings),
        differences, base, rover, navigation, settings, variance_factors=resolved.variance_factors,
    )  # fmt: skip
    check = solution.length_check
    if check["without_declared"] and check["verdict"] == "disagrees" and _misleads(check["difference_m"]):
        solution = _distrust(solution, differences, resolved, settings)
    stages.end("solve")
    return replace(solution, seconds=stages.seconds, warnings=(*said, *solution.warnings))


class _Stages:
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

    def end(self, stage):
        now, compiled = time.perf_counter(), self._compilation()
        self.seconds["compile"] += compiled - self._compiled
        self.seconds[stage] = now - self._since - (compiled - self._compiled)
        self._since, self._compiled = now, compiled


def _estimate_length(differences, base, rover, settings):
    """Length of the rigid baseline from a first run without it; returns (settings, warnings)."""
    free = msgspec.structs.replace(settings, length_m=None, direction_azimuth_deg=None)
    found = _assemble(differences, resolve_epochs(differences, base, rover, free), free)
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


def _misleads(difference_m):
    """Whether a length that is wrong by so much can choose wrong integers, not only bend right ones."""
    return abs(difference_m) > MISLEADING_LENGTH_M


def _distrust(solution, differences, resolved, settings):
    """Take back the epochs that were accepted with a length which the observations refute."""
    from .._kernels import engine

    accepted = resolved.status >= Status.HELD
    has_float = np.isfinite(resolved.table[:, engine.FLOAT_X])
    status = np.where(accepted, np.where(has_float, Status.FLOAT, Status.NONE), resolved.status)
    reason = np.where(accepted, Reason.LENGTH_TEST, resolved.reason)
    refuted = replace(resolved, status=status.astype(np.uint8), reason=reason.astype(np.uint8))
    kept = ("settings", "inputs", "warnings", "length_check")
    return replace(
        _assemble(differences, refuted, settings), **{name: getattr(solution, name) for name in kept}
    )


def _read_inputs(base, rover, navigation):
    from ..formats import read_navigation, read_observations
    from ..navigation import Navigation
    from ..observations import Observations

    if isinstance(navigation, (str, Path)):
        navigation = (navigation,)
    if not isinstance(navigation, Navigation):
        paths = list(navigation)
        if not paths:
            paths = [p for p in (base, rover) if isinstance(p, (str, Path))]
        navigation = read_navigation(*paths)
    if not isinstance(base, Observations):
        base = read_observations(base)
    if not isinstance(rover, Observations):
        rover = read_observations(rover)
    for name, observations in (("base", base), ("rover", rover)):
        if observations.n_epochs == 0:
            raise NoSolutionError(
                f"could not solve: the {name} file {observations.meta.path} holds no epochs"
            )
    return base, rover, navigation


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
        pdop=table[:, kernel.PDOP],
        hdop=table[:, kernel.HDOP],
        vdop=table[:, kernel.VDOP],
        azimuth_dop=table[:, kernel.AZ_DOP],
        elevation_dop=table[:, kernel.EL_DOP],
        ratio=table[:, kernel.RATIO],
        success_probability=table[:, kernel.PROBABILITY],
        chi2=table[:, kernel.CHI2],
        chi2_limit=table[:, kernel.CHI2_LIMIT],
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
        candidate_length_m=table[:, kernel.LENGTH],
        candidate_length_sd_m=table[:, kernel.LENGTH_SD],
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
