"""One run in a few numbers: how much was solved, what came out, why the rest was not.

The mean azimuth is circular, atan2(mean sin, mean cos), and its scatter is taken around it; all
means are over accepted epochs (fixed or held). For a platform that turns the mean means nothing.
"""

import numpy as np

from ..errors import REASON_SENTENCES, Reason, Status
from ..timescales import format_gpst

__all__ = ["compare_length", "summarize_solution"]


def summarize_solution(solution):
    """Summarise a run, in values that JSON can hold.

    Parameters
    ----------
    solution : BaselineSolution
        Result of `truenorth.solve_baseline`.

    Returns
    -------
    dict
        ``epochs``, ``epochs_by_status``, ``accepted_fraction``; ``azimuth_deg``, ``elevation_deg``,
        ``length_m`` (each ``mean``, ``sd`` and ``stated_sd``, over accepted epochs; None where there
        is none); ``length_check``; ``reasons``; ``satellites`` and ``signals`` used; ``inputs``,
        ``seconds``, ``warnings``.
    """
    from .. import __version__

    accepted = solution.is_accepted
    n_epochs = solution.n_epochs
    by_status = {
        status.label: int(np.count_nonzero(solution.status == status))
        for status in sorted(Status, reverse=True)
    }
    reasons = {
        reason.name.lower(): {"epochs": count, "sentence": REASON_SENTENCES[reason]}
        for reason, count in solution.reason_counts().items()
        if reason != Reason.OK
    }
    return {
        "version": __version__,
        "method": solution.settings.get("method"),
        "first_gpst": format_gpst(solution.time_ns[0]) if n_epochs else None,
        "last_gpst": format_gpst(solution.time_ns[-1]) if n_epochs else None,
        "epochs": n_epochs,
        "epochs_by_status": by_status,
        "accepted_fraction": float(np.count_nonzero(accepted) / n_epochs) if n_epochs else 0.0,
        "azimuth_deg": _angle(solution.azimuth_rad[accepted], solution.azimuth_sd_rad[accepted], turn=360.0),
        "elevation_deg": _angle(solution.elevation_rad[accepted], solution.elevation_sd_rad[accepted]),
        "length_m": _plain(solution.length_m[accepted], solution.length_sd_m[accepted]),
        "length_check": compare_length(solution),
        "reasons": reasons,
        "satellites": _spread(solution.n_sats[accepted]),
        "signals": _spread(solution.n_signals[accepted]),
        "inputs": _jsonable(solution.inputs),
        "seconds": {
            **dict.fromkeys(("read", "compile", "solve", "write"), 0.0),
            **{name: float(value) for name, value in solution.seconds.items()},
        },
        "warnings": list(solution.warnings),
    }


def compare_length(solution):
    """Compare the declared antenna separation with the measured one.

    Accepted epochs give the measured length; without any, those that the length test turned down.
    The two agree when they differ by no more than ``length_tolerance_sd`` joint standard deviations:
    that of the declared length, and that of one epoch (errors of epochs are too alike to average).

    Parameters
    ----------
    solution : BaselineSolution
        Result of `truenorth.solve_baseline`.

    Returns
    -------
    dict
        ``declared_m``, ``declared_sd_m``, ``measured_m``, ``measured_sd_m``, ``difference_m``,
        ``limit_m`` (None where unknown) and ``verdict``: ``agrees``, ``disagrees``,
        ``not declared`` or ``not measured``.
    """
    settings = solution.settings
    declared_m = settings.get("length_m")
    declared_sd_m = settings.get("length_sd_m", 0.0) if declared_m is not None else None
    use = solution.is_accepted & np.isfinite(solution.length_m)
    if not np.any(use):
        use = (solution.reason == Reason.LENGTH_TEST) & np.isfinite(solution.length_m)
    result = {
        "declared_m": declared_m,
        "declared_sd_m": declared_sd_m,
        "measured_m": None,
        "measured_sd_m": None,
        "difference_m": None,
        "limit_m": None,
        "verdict": "not declared" if declared_m is None else "not measured",
    }
    if not np.any(use):
        return result
    measured_m = float(np.median(solution.length_m[use]))
    measured_sd_m = _finite(np.sqrt(np.nanmean(solution.length_sd_m[use] ** 2)))
    result.update(measured_m=measured_m, measured_sd_m=measured_sd_m)
    if declared_m is None:
        return result
    joint_m = float(np.hypot(declared_sd_m, measured_sd_m or 0.0))
    limit_m = float(settings.get("length_tolerance_sd", 4.0)) * joint_m
    difference_m = measured_m - declared_m
    verdict = "agrees" if abs(difference_m) <= limit_m else "disagrees"
    result.update(difference_m=difference_m, limit_m=limit_m, verdict=verdict)
    return result


def _angle(angle_rad, sd_rad, *, turn=None):
    """Circular mean and scatter in degrees; the mean lies in [0, `turn`) where one is given."""
    known = np.isfinite(angle_rad)
    if not np.any(known):
        return {"mean": None, "sd": None, "stated_sd": None}
    angle_rad = angle_rad[known]
    mean_rad = np.arctan2(np.mean(np.sin(angle_rad)), np.mean(np.cos(angle_rad)))
    off_rad = np.mod(angle_rad - mean_rad + np.pi, 2.0 * np.pi) - np.pi
    mean_deg = float(np.degrees(mean_rad))
    return {
        "mean": mean_deg % turn if turn else mean_deg,
        "sd": float(np.degrees(_scatter(off_rad))),
        "stated_sd": _finite(np.degrees(_rms(sd_rad[known]))),
    }


def _plain(value, sd):
    known = np.isfinite(value)
    if not np.any(known):
        return {"mean": None, "sd": None, "stated_sd": None}
    mean = float(np.mean(value[known]))
    return {"mean": mean, "sd": float(_scatter(value[known] - mean)), "stated_sd": _finite(_rms(sd[known]))}


def _scatter(deviation):
    """Standard deviation of values whose mean was taken off; 0 for a single one."""
    return np.sqrt(np.sum(deviation**2) / max(len(deviation) - 1, 1))


def _rms(values):
    values = values[np.isfinite(values)]
    return np.sqrt(np.mean(values**2)) if len(values) else np.nan


def _finite(value):
    return float(value) if np.isfinite(value) else None


def _spread(counts):
    if len(counts) == 0:
        return {"min": None, "median": None, "max": None}
    return {"min": int(np.min(counts)), "median": float(np.median(counts)), "max": int(np.max(counts))}


def _jsonable(value):
    """Plain dictionaries, lists, strings and finite numbers, for strict JSON."""
    if isinstance(value, dict):
        return {str(key): _jsonable(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple | set | np.ndarray):
        return [_jsonable(inner) for inner in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return _finite(value)
    return None if value is None else str(value)
