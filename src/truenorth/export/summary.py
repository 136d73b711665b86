"""One run in a few numbers: how much was solved, what came out, why the rest was not.

The mean azimuth is circular, atan2(mean sin, mean cos), and its scatter is taken around it; all
means are over accepted epochs (fixed or held). For a platform that turns the mean means nothing.
"""

import numpy as np

from ..attitude.array_solution import AttitudeSolution
from ..attitude.length_check import compare_length
from ..errors import REASON_SENTENCES, Reason, Status
from ..timescales import format_gpst

__all__ = ["summarize_solution"]


def summarize_solution(solution):
    """Summarise a run, in values that JSON can hold.

    Parameters
    ----------
    solution : BaselineSolution or AttitudeSolution
        Result of `truenorth.solve_baseline`; that of an array has a summary of its own, see
        `truenorth.export.attitude_summary.summarize_attitude`.

    Returns
    -------
    dict
        ``epochs``, ``epochs_by_status``, ``accepted_fraction``; ``azimuth_deg``, ``elevation_deg``,
        ``length_m`` (each ``mean``, ``sd`` and ``stated_sd``, over accepted epochs; None where there
        is none); ``length_check``; ``reasons``; ``satellites`` and ``signals`` used; ``inputs``,
        ``seconds``, ``warnings``.
    """
    if isinstance(solution, AttitudeSolution):
        from .attitude_summary import summarize_attitude

        return summarize_attitude(solution)
    from .. import __version__

    accepted = solution.is_accepted
    n_epochs = solution.n_epochs
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
        "epochs_by_status": epochs_by_status(solution),
        "accepted_fraction": float(np.count_nonzero(accepted) / n_epochs) if n_epochs else 0.0,
        "azimuth_deg": angle_entry(
            solution.azimuth_rad[accepted], solution.azimuth_sd_rad[accepted], turn=360.0
        ),
        "elevation_deg": angle_entry(solution.elevation_rad[accepted], solution.elevation_sd_rad[accepted]),
        "length_m": _plain(solution.length_m[accepted], solution.length_sd_m[accepted]),
        "length_check": dict(solution.length_check) or compare_length(solution),
        "reasons": reasons,
        "satellites": spread_entry(solution.n_sats[accepted]),
        "signals": spread_entry(solution.n_signals[accepted]),
        "inputs": jsonable(solution.inputs),
        "seconds": stage_seconds(solution),
        "warnings": list(solution.warnings),
    }


def epochs_by_status(solution):
    """Epochs by the word of their status, the best first."""
    return {
        status.label: int(np.count_nonzero(solution.status == status))
        for status in sorted(Status, reverse=True)
    }


def stage_seconds(solution):
    """Wall time of every stage, 0 where there was none."""
    return {
        **dict.fromkeys(("read", "compile", "solve", "write"), 0.0),
        **{name: float(value) for name, value in solution.seconds.items()},
    }


def angle_entry(angle_rad, sd_rad, *, turn=None):
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


def spread_entry(counts):
    """Least, middle and largest of some counts; None where there are none."""
    if len(counts) == 0:
        return {"min": None, "median": None, "max": None}
    return {"min": int(np.min(counts)), "median": float(np.median(counts)), "max": int(np.max(counts))}


def jsonable(value):
    """Plain dictionaries, lists, strings and finite numbers, for strict JSON."""
    if isinstance(value, dict):
        return {str(key): jsonable(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple | set | np.ndarray):
        return [jsonable(inner) for inner in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return _finite(value)
    return None if value is None else str(value)
