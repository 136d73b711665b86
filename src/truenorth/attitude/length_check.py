"""The declared antenna separation against the measured one.

A wrong declared length either shows in the accepted epochs (where it does not decide) or keeps
epochs from being accepted (where it does). In the second case the run is repeated without it, and
what the observations then say is compared with what was declared.
"""

import msgspec
import numpy as np

from ..errors import Status

__all__ = ["compare_length", "length_warning", "measure_free_length", "sample_free_length"]

MIN_SAMPLE_ACCEPTED = 10
"""Epochs of a sample that must be fixed without the length before they can speak against it."""

FEW_ACCEPTED = 0.5
"""With a smaller share of accepted epochs a declared length comes under suspicion."""


UNANIMOUS = 0.9
"""Share of the lengths that must lie together. Wrong integers give lengths all over the place: where a single
frequency fixes wrongly without the length, that says nothing against the length."""


def is_declared(settings):
    """Tell whether a declared length decides about epochs.

    Parameters
    ----------
    settings : GnssSettings
        Of the run.

    Returns
    -------
    bool
    """
    return settings.length_m is not None and settings.length_use in ("constrain", "check")


def compare_length(solution):
    """Compare the declared antenna separation with the measured one.

    Accepted epochs give the measured length. The two agree when they differ by no more than
    ``length_tolerance_sd`` joint standard deviations: that of the declared length, and that of one
    epoch (errors of epochs are too alike to average).

    Parameters
    ----------
    solution : BaselineSolution
        Result of `truenorth.solve_baseline`.

    Returns
    -------
    dict
        ``declared_m``, ``declared_sd_m``, ``measured_m``, ``measured_sd_m``, ``difference_m``,
        ``limit_m`` (None where unknown); ``verdict``: ``agrees``, ``disagrees``, ``not declared``
        or ``not measured``; ``without_declared``: whether the measured length comes from a run in
        which the declared one took no part.
    """
    settings = solution.settings
    use = solution.is_accepted
    return _compare(
        settings.get("length_m"),
        settings.get("length_sd_m", 0.0),
        settings.get("length_tolerance_sd", 4.0),
        solution.length_m[use],
        solution.length_sd_m[use],
    )


def measure_free_length(solve, settings):
    """Compare as `compare_length`, with a run in which the declared length takes no part.

    Parameters
    ----------
    solve : callable
        Takes settings, returns the BaselineSolution of the same run with them.
    settings : GnssSettings
        Of the run whose declared length is under suspicion.

    Returns
    -------
    dict
        As `compare_length`.
    """
    free = msgspec.structs.replace(
        settings,
        method="lambda",
        single_epoch=False,
        length_use="off",
        ratio_test="none",
        min_epochs_to_fix=1,
    )
    found = solve(free)
    use = found.is_accepted
    length_m, length_sd_m = found.length_m[use], found.length_sd_m[use]
    if not _are_unanimous(length_m, length_sd_m):
        length_m, length_sd_m = length_m[:0], length_sd_m[:0]
    return _compare(
        settings.length_m,
        settings.length_sd_m,
        settings.length_tolerance_sd,
        length_m,
        length_sd_m,
        without_declared=True,
    )


def sample_free_length(differences, sample, settings):
    """Compare as `compare_length`, with a sample of epochs that are resolved without the length.

    A wrong length can win the search for hundreds of epochs, with residuals that the estimated noise
    then covers; epochs that need no length to be fixed tell.

    Parameters
    ----------
    differences : SingleDifferences
        All epochs, or a sample of them.
    sample : ndarray of int or None
        Epochs to resolve; None takes a sample of them.
    settings : GnssSettings
        Of the run.

    Returns
    -------
    dict or None
        None where too few epochs can be fixed without the length, or their lengths contradict each other.
    """
    from .._kernels import engine as kernel
    from ..ambiguity.resolution import resolve_sample

    free = msgspec.structs.replace(settings, method="lambda", length_use="off", ratio_test="none")
    resolved, sample = resolve_sample(differences, free, sample)
    accepted = sample[resolved.status[sample] >= Status.HELD]
    length_m, length_sd_m = (resolved.table[accepted, column] for column in (kernel.LENGTH, kernel.LENGTH_SD))
    if len(accepted) < MIN_SAMPLE_ACCEPTED or not _are_unanimous(length_m, length_sd_m):
        return None
    return _compare(
        settings.length_m,
        settings.length_sd_m,
        settings.length_tolerance_sd,
        length_m,
        length_sd_m,
        without_declared=True,
    )


def _are_unanimous(length_m, length_sd_m):
    """Whether nearly all lengths agree with their median within four of their standard deviations."""
    if len(length_m) == 0:
        return True
    limit_m = 4.0 * np.hypot(length_sd_m, np.median(length_sd_m))
    return np.mean(np.abs(length_m - np.median(length_m)) <= limit_m) >= UNANIMOUS


def length_warning(check):
    """One sentence that names the declared length as the suspect, or None where it is not.

    Parameters
    ----------
    check : dict
        Result of `compare_length` or `measure_free_length`.

    Returns
    -------
    str or None
    """
    if check["verdict"] != "disagrees":
        return None
    without = "without it the observations give" if check["without_declared"] else "the observations give"
    return (
        f"the declared length of {check['declared_m']:.4f} m disagrees with the measured one: {without} "
        f"{check['measured_m']:.4f} m ({1e3 * check['difference_m']:+.0f} mm, limit "
        f"{1e3 * check['limit_m']:.0f} mm); suspect the declared length"
    )


def _compare(declared_m, declared_sd_m, tolerance_sd, length_m, length_sd_m, *, without_declared=False):
    known = np.isfinite(length_m) & np.isfinite(length_sd_m)
    result = {
        "declared_m": declared_m,
        "declared_sd_m": None if declared_m is None else float(declared_sd_m),
        "measured_m": None,
        "measured_sd_m": None,
        "difference_m": None,
        "limit_m": None,
        "verdict": "not declared" if declared_m is None else "not measured",
        "without_declared": without_declared,
    }
    if not np.any(known):
        return result
    measured_m = float(np.median(length_m[known]))
    measured_sd_m = float(np.sqrt(np.mean(length_sd_m[known] ** 2)))
    result.update(measured_m=measured_m, measured_sd_m=measured_sd_m)
    if declared_m is None:
        return result
    limit_m = float(tolerance_sd * np.hypot(declared_sd_m, measured_sd_m))
    difference_m = measured_m - declared_m
    verdict = "agrees" if abs(difference_m) <= limit_m else "disagrees"
    result.update(difference_m=difference_m, limit_m=limit_m, verdict=verdict)
    return result
