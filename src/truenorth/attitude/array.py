"""The attitude of three and more antennas: jointly resolved, or baseline by baseline.

The geometry of the platform is used as far as it stands: all of it in the joint search
(`truenorth.attitude.array_joint`); where the observations refute it, the distances from the first antenna,
one baseline at a time; where they refute those, none (`truenorth.attitude.array_baselines`). The solution
says which.
"""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np

from ..config import ArraySettings, GnssSettings, convert_settings
from ..errors import ConfigError, NoSolutionError, Reason
from .array_baselines import attitude_from_baselines, solve_by_baselines
from .array_joint import solve_joint
from .array_products import filter_solution, solve_by_method, state_reliability
from .baselines import Stages
from .length_check import FEW_ACCEPTED
from .provenance import describe_observations
from .runs import open_receiver

__all__ = ["attitude_from_baselines", "solve_array"]

JOINT_METHODS = ("constrained", "filter")
"""Methods that the joint engine stands for; the others are of one baseline."""


def solve_array(
    observations,
    positions_body_m,
    navigation=(),
    *,
    names=None,
    settings=None,
    array=None,
    attitude_filter=None,
    reliability=None,
    progress=None,
    keep_residuals=False,
    block_epochs=None,
    **overrides,
):
    """Attitude of a rigid array of antennas at every epoch.

    Parameters
    ----------
    observations : sequence of path or Observations
        Raw observations of the antennas, the reference first.
    positions_body_m : array_like, shape (n_antennas, 3)
        Where the antennas stand: forward, right, down, metres.
    navigation : path, sequence of paths or Navigation
        Broadcast ephemerides; may stay empty where the observation logs hold them (UBX).
    names : sequence of str, optional
        Of the antennas.
    settings : GnssSettings, optional
        Systems, bands, masks, noise and tests; the defaults where omitted.
    array : ArraySettings, optional
        How the antennas are resolved together; the defaults where omitted.
    attitude_filter : AttitudeFilterSettings, optional
        Filter or smooth the attitude; every epoch by itself where omitted.
    reliability : ReliabilitySection, optional
        State detectable blunders, their effect on the angles and protection levels; none where omitted.
    progress : callable, optional
        Called with (epochs done, epochs in all).
    keep_residuals : bool
        Keep the residual of every phase, which takes more memory than all else.
    block_epochs : int, optional
        Epochs that are in memory at a time; the result does not depend on it.
    **overrides
        Single fields of `GnssSettings` by name.

    Returns
    -------
    AttitudeSolution

    Raises
    ------
    FormatError
        If a file cannot be read.
    ConfigError
        If an option is unknown or impossible, or coordinates and antennas differ in number.
    NoSolutionError
        If no antenna has anything in common with the reference that could be solved.

    Examples
    --------
    >>> import truenorth
    >>> files = ["aft.obs", "fore.obs", "mast.obs"]
    >>> body_m = [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (1.0, 1.5, -0.5)]
    >>> solution = truenorth.solve_array(files, body_m, "brdc.nav")  # doctest: +SKIP
    """
    settings = settings or GnssSettings()
    if overrides:
        table = msgspec.to_builtins(settings) | msgspec.to_builtins(overrides)
        settings = convert_settings(table, GnssSettings)
    positions_body_m = np.asarray(positions_body_m, dtype=float)
    observations = list(observations)
    names = tuple(names) if names is not None else tuple(f"antenna {k}" for k in range(len(observations)))
    _check_array(observations, positions_body_m, names, settings)
    array = array or ArraySettings()
    stages = Stages()
    receivers, navigation = _read(observations, navigation, settings)
    stages.end("read")
    common = {"array": array, "names": names, "keep_residuals": keep_residuals, "progress": progress}
    arguments = receivers, positions_body_m, navigation, settings
    solution, said = None, []
    if array.resolution == "joint" and settings.method in JOINT_METHODS:
        solution, read_s = solve_joint(*arguments, block_epochs=block_epochs, **common)
        stages.end("solve", read_s=read_s)
        said = list(solution.warnings)
    for length in (True, False):
        if solution is not None and not _is_refuted(solution):
            break
        if solution is not None:
            said.append(_say_fallback(solution, length))
        below, seconds = solve_by_baselines(*arguments, length=length, **common)
        stages.end("solve", read_s=seconds["read"])
        if solution is None or np.mean(below.is_accepted) > np.mean(solution.is_accepted):
            solution = below
            said += below.warnings
    if array.method != "adjustment":
        solution = solve_by_method(solution, array.method)
    if attitude_filter is not None:
        solution = filter_solution(solution, attitude_filter)
    if reliability is not None:
        solution = state_reliability(solution, reliability)
    stages.end("solve")
    described = {
        name: describe_observations(receiver) for name, receiver in zip(names, receivers, strict=True)
    }
    inputs = {"antennas": described, "navigation": list(navigation.paths)}
    return replace(
        solution,
        inputs=solution.inputs | inputs,
        warnings=tuple(dict.fromkeys(said)),
        seconds=stages.seconds,
    )


def _is_refuted(solution):
    """Whether the observations contradict the body coordinates in most epochs that they could decide."""
    reasons = np.isin(solution.reason, [Reason.RESIDUAL_TEST, Reason.NO_CANDIDATE, Reason.GEOMETRY_TEST])
    unsolved = ~solution.is_accepted
    return np.mean(solution.is_accepted) < FEW_ACCEPTED and np.count_nonzero(
        reasons & unsolved
    ) > 0.5 * np.count_nonzero(unsolved)


def _say_fallback(solution, length):
    """What a step down from one level of geometry to the next says."""
    share = 100.0 * float(np.mean(solution.is_accepted))
    if solution.level == "joint" and length:
        return (
            f"the body coordinates do not fit the phases: {share:.1f} % of the epochs were accepted with all "
            "of them in the search; solved again by the distances from the first antenna alone. Measure the "
            "coordinates with `truenorth calibrate array`"
        )
    return (
        f"the distances from the first antenna do not fit the phases: {share:.1f} % of the epochs were "
        "accepted with them; solved again without any geometry"
    )


def _check_array(observations, positions_body_m, names, settings):
    if len(observations) < 2:
        raise ConfigError(f"{len(observations)} antennas given; give two or more", key="observations")
    if positions_body_m.shape != (len(observations), 3):
        raise ConfigError(
            f"{len(observations)} antennas but body coordinates of shape {positions_body_m.shape}; "
            "give three for each antenna",
            key="positions_body_m",
        )
    if len(names) != len(observations):
        raise ConfigError(
            f"{len(observations)} antennas but {len(names)} names; give one for each", key="names"
        )
    if settings.length_m is not None:
        raise ConfigError(
            f"`length_m` is {settings.length_m:g} m; leave it out, the body coordinates give the lengths",
            key="length_m",
            value=settings.length_m,
        )


def _read(observations, navigation, settings):
    """Observations of the antennas, and the ephemerides."""
    from ..formats import read_navigation
    from ..navigation import Navigation
    from ..observations import Observations

    if not isinstance(navigation, Navigation):
        paths = (
            [navigation]
            if isinstance(navigation, str) or hasattr(navigation, "__fspath__")
            else list(navigation)
        )
        paths = paths or [entry for entry in observations if not isinstance(entry, Observations)]
        navigation = read_navigation(*paths)
    whole = settings.direction != "forward"
    receivers = [open_receiver(source, whole=whole) for source in observations]
    if receivers[0].n_epochs == 0:
        raise NoSolutionError(f"could not solve: the reference file {receivers[0].meta.path} holds no epochs")
    return receivers, navigation
