"""What a solution remembers of its run: files, settings, and what must be said once."""

from dataclasses import replace

import msgspec
import numpy as np

from ..constants import SYSTEMS
from ..timescales import format_gpst

__all__ = ["add_provenance", "describe_observations"]


def add_provenance(solution, base, rover, navigation, settings):
    """Attach inputs, effective settings and warnings to a solution.

    Parameters
    ----------
    solution : BaselineSolution
        Fresh from the solver.
    base, rover : Observations or blocks
        The raw observations.
    navigation : Navigation
        The ephemerides.
    settings : GnssSettings
        Effective settings.

    Returns
    -------
    BaselineSolution
    """
    inputs = {
        "base": describe_observations(base),
        "rover": describe_observations(rover),
        "navigation": list(navigation.paths),
    }
    warnings = [
        f"{name} file {observations.meta.path}: {text}" if observations.meta.path else f"{name}: {text}"
        for name, observations in (("base", base), ("rover", rover))
        for text in observations.meta.warnings
    ]
    common = solution.n_epochs / max(1, min(base.n_epochs, rover.n_epochs))
    if common < 0.9:
        warnings.append(
            f"only {solution.n_epochs} epochs are common to the base ({base.n_epochs}) and the rover "
            f"({rover.n_epochs}); the others are left out"
        )
    return replace(
        solution,
        settings=msgspec.to_builtins(settings),
        inputs=inputs | solution.inputs,
        warnings=(*warnings, *solution.warnings),
    )


def describe_observations(observations):
    """What a file held, as plain values for a report.

    Parameters
    ----------
    observations : Observations or blocks
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
