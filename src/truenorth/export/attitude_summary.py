"""A run over an array in a few numbers: how much was solved, how well, by which antennas."""

import numpy as np

from ..errors import REASON_SENTENCES, Reason
from ..timescales import format_gpst
from .summary import angle_entry, epochs_by_status, jsonable, spread_entry, stage_seconds

__all__ = ["summarize_attitude"]


def summarize_attitude(solution):
    """Summarise a run over an array, in values that JSON can hold.

    Parameters
    ----------
    solution : AttitudeSolution
        Result of `truenorth.attitude.solve_array`.

    Returns
    -------
    dict
        ``epochs``, ``epochs_by_status``, ``accepted_fraction``; ``heading_deg``, ``pitch_deg``,
        ``roll_deg`` (each ``mean``, ``sd`` and ``stated_sd`` over accepted epochs; None where there is
        none); ``antennas``: for each its distance from the first, the epochs in which it was used and
        left out, and of baselines that were solved one by one the share accepted; ``level`` of the geometry;
        ``reasons``; ``antennas_used`` and ``satellites``; ``inputs``, ``seconds``, ``warnings``.
    """
    from .. import __version__

    accepted = solution.is_accepted
    n_epochs = solution.n_epochs
    antennas = {}
    baselines = solution.baselines or [None] * (len(solution.antennas) - 1)
    for k, (name, baseline) in enumerate(zip(solution.antennas, [None, *baselines], strict=True)):
        arm_m = solution.positions_body_m[k] - solution.positions_body_m[0]
        used = int(np.count_nonzero(solution.is_used[:, k]))
        antennas[name] = {
            "length_m": float(np.linalg.norm(arm_m)),
            "used_fraction": float(used / max(n_epochs, 1)),
            "used_epochs": used,
            "excluded_epochs": int(np.count_nonzero(solution.is_excluded[:, k])),
        }
        if baseline is not None:
            antennas[name] |= {
                "accepted_fraction": float(np.count_nonzero(baseline.is_accepted) / max(n_epochs, 1)),
                "length_check": jsonable(baseline.length_check),
            }
    return {
        "version": __version__,
        "method": solution.settings.get("method"),
        "first_gpst": format_gpst(solution.time_ns[0]) if n_epochs else None,
        "last_gpst": format_gpst(solution.time_ns[-1]) if n_epochs else None,
        "epochs": n_epochs,
        "epochs_by_status": epochs_by_status(solution),
        "accepted_fraction": float(np.count_nonzero(accepted) / n_epochs) if n_epochs else 0.0,
        "heading_deg": angle_entry(
            solution.heading_rad[accepted], solution.angle_sd_rad(0)[accepted], turn=360.0
        ),
        "pitch_deg": angle_entry(solution.pitch_rad[accepted], solution.angle_sd_rad(1)[accepted]),
        "roll_deg": angle_entry(solution.roll_rad[accepted], solution.angle_sd_rad(2)[accepted]),
        "reference": solution.antennas[0],
        "antennas": antennas,
        "reasons": {
            reason.name.lower(): {"epochs": count, "sentence": REASON_SENTENCES[reason]}
            for reason, count in solution.reason_counts().items()
            if reason != Reason.OK
        },
        "level": solution.level,
        "antennas_used": spread_entry(solution.n_antennas_used[accepted]),
        "satellites": spread_entry(solution.n_sats[accepted]),
        "inputs": jsonable(solution.inputs),
        "seconds": stage_seconds(solution),
        "warnings": list(solution.warnings),
    }
