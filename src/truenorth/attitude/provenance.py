"""What a solution remembers of its run: files, settings, and what must be said once."""

from dataclasses import replace

import msgspec
import numpy as np

from ..constants import SYSTEMS
from ..timescales import format_gpst
from .length_check import (
    FEW_ACCEPTED,
    compare_length,
    length_warning,
    measure_free_length,
    sample_free_length,
)

__all__ = ["add_provenance", "describe_observations"]


def add_provenance(solution, differences, base, rover, navigation, settings, *, variance_factors=(1.0, 1.0)):
    """Attach inputs, effective settings and warnings to a solution.

    Parameters
    ----------
    solution : BaselineSolution
        Fresh from the solver.
    differences : SingleDifferences
        What it was solved from.
    base, rover : Observations
        The raw observations.
    navigation : Navigation
        The ephemerides.
    settings : GnssSettings
        Effective settings.
    variance_factors : tuple of float
        By which the phase and code variances of the settings were scaled.

    Returns
    -------
    BaselineSolution
    """
    inputs = {
        "base": describe_observations(base),
        "rover": describe_observations(rover),
        "navigation": list(navigation.paths),
        "variance_factors": {"phase": float(variance_factors[0]), "code": float(variance_factors[1])},
    }
    solution = replace(solution, settings=msgspec.to_builtins(settings), inputs=inputs)
    warnings = [
        f"{name} file {observations.meta.path}: {text}" if observations.meta.path else f"{name}: {text}"
        for name, observations in (("base", base), ("rover", rover))
        for text in observations.meta.warnings
    ]
    common = differences.n_epochs / max(1, min(base.n_epochs, rover.n_epochs))
    if common < 0.9:
        warnings.append(
            f"only {differences.n_epochs} epochs are common to the base ({base.n_epochs}) and the rover "
            f"({rover.n_epochs}); the others are left out"
        )
    check = _check_length(solution, differences, base, rover, settings)
    if settings.length_use != "off" and (text := length_warning(check)) is not None:
        warnings.append(text)
    return replace(
        solution, warnings=tuple(dict.fromkeys((*solution.warnings, *warnings))), length_check=check
    )


def describe_observations(observations):
    """What a file held, as plain values for a report.

    Parameters
    ----------
    observations : Observations
        Raw observations of one receiver.

    Returns
    -------
    dict
    """
    meta = observations.meta
    n = observations.n_epochs
    return {
        "path": meta.path,
        "format": meta.format,
        "receiver": " ".join(word for word in (meta.receiver_type, meta.receiver_serial) if word),
        "antenna": meta.antenna_type,
        "epochs": n,
        "first_gpst": format_gpst(observations.time_ns[0]) if n else None,
        "last_gpst": format_gpst(observations.time_ns[-1]) if n else None,
        "systems": "".join(SYSTEMS[k] for k in np.unique(observations.sat // 100)),
    }


def _check_length(solution, differences, base, rover, settings):
    """The declared length against the measured one, from a run without it where it may be the culprit."""
    decides = settings.length_m is not None and settings.length_use in ("constrain", "check")
    if decides and solution.n_epochs:
        sampled = sample_free_length(differences, settings)
        if sampled is not None and sampled["verdict"] == "disagrees":
            return sampled
    if decides and solution.n_epochs and np.mean(solution.is_accepted) < FEW_ACCEPTED:
        free = measure_free_length(differences, base, rover, settings)
        if free["measured_m"] is not None:
            return free
    return compare_length(solution)
