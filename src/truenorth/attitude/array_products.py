"""What is made of the vectors of an array once its integers are known.

Another method's attitude, a filtered or smoothed one, and a statement of what could hide in it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import msgspec
import numpy as np

from ..config import AttitudeFilterSettings, ReliabilitySection
from ..errors import ConfigError, Reason, Status
from .array_solution import AttitudeSolution
from .array_vectors import ArrayVectors

__all__ = ["filter_solution", "solve_by_method", "state_reliability"]

_ANGLES = ("heading_rad", "pitch_rad", "roll_rad")


def _vectors(solution: AttitudeSolution, wanted: str) -> ArrayVectors:
    if solution.vectors is None:
        raise ConfigError(
            f"{wanted} needs the vectors between the antennas; set `keep_vectors`", key="array.keep_vectors"
        )
    return solution.vectors


def solve_by_method(solution: AttitudeSolution, method: str) -> AttitudeSolution:
    """The same integers and vectors, the attitude by another method.

    Parameters
    ----------
    solution : AttitudeSolution
        With its vectors.
    method : str
        One of `truenorth.attitude.vector_methods.VECTOR_METHODS`.

    Returns
    -------
    AttitudeSolution
    """
    from .vector_methods import attitude_from_vectors

    fit = attitude_from_vectors(_vectors(solution, f"the method {method}"), method)
    lost = solution.is_accepted & ~fit.is_solved
    return replace(
        solution,
        **{name: getattr(fit, name) for name in _ANGLES},
        cov_rad2=fit.cov_rad2,
        rot_ned_from_body=fit.rot_ned_from_body,
        status=np.where(lost, Status.NONE, solution.status).astype(np.uint8),
        reason=np.where(lost, fit.reason, solution.reason).astype(np.uint8),
    )


def filter_solution(solution: AttitudeSolution, settings: AttitudeFilterSettings) -> AttitudeSolution:
    """Filter or smooth the attitude of a run.

    Parameters
    ----------
    solution : AttitudeSolution
        With its vectors.
    settings : AttitudeFilterSettings
        What the filter does.

    Returns
    -------
    AttitudeSolution
        At the output times of the filter. Epochs between measurements and over gaps have the status
        ``float`` and `Reason.PREDICTED`.
    """
    from .filter import FilterStatus, filter_attitude

    found = filter_attitude(_vectors(solution, "the attitude filter"), settings)
    at = np.searchsorted(solution.time_ns, found.time_ns)
    at = np.minimum(at, solution.n_epochs - 1)
    own = solution.time_ns[at] == found.time_ns
    updated = found.status == FilterStatus.UPDATED
    predicted = found.status == FilterStatus.PREDICTED
    status = np.where(own & updated, solution.status[at], Status.NONE)
    status = np.where(updated & ~(status >= Status.HELD), Status.HELD, status)
    status = np.where(predicted, Status.FLOAT, status)
    reason = np.where(own, solution.reason[at], Reason.NO_CANDIDATE)
    reason = np.where(updated, Reason.OK, np.where(predicted, Reason.PREDICTED, reason))

    def take(column: np.ndarray, nothing: Any) -> np.ndarray:
        """A column at the output times, `nothing` where the run has no such epoch."""
        taken = column[at].copy()
        taken[~own] = nothing
        return taken

    return replace(
        solution,
        time_ns=found.time_ns,
        status=status.astype(np.uint8),
        reason=reason.astype(np.uint8),
        **{name: getattr(found, name) for name in _ANGLES},
        cov_rad2=found.cov_rad2,
        rot_ned_from_body=found.rot_ned_from_body,
        is_used=found.is_used,
        is_excluded=take(solution.is_excluded, False) | found.is_rejected,
        chi2=take(solution.chi2, np.nan),
        chi2_limit=take(solution.chi2_limit, np.nan),
        success_probability=take(solution.success_probability, np.nan),
        n_sats=take(solution.n_sats, 0),
        position_ecef_m=take(solution.position_ecef_m, np.nan),
        filtered=found,
        events=tuple(sorted((*solution.events, *found.events), key=lambda event: event.time_ns)),
    )


def state_reliability(solution: AttitudeSolution, settings: ReliabilitySection) -> AttitudeSolution:
    """Add minimal detectable blunders, their effect on the angles and protection levels.

    Parameters
    ----------
    solution : AttitudeSolution
        With its vectors; of a filtered run the levels are those of its updates.
    settings : ReliabilitySection
        What is demanded.

    Returns
    -------
    AttitudeSolution
    """
    from .reliability import ReliabilitySettings, attitude_reliability, reliability_events

    vectors = _vectors(solution, "the reliability")
    settings = ReliabilitySettings(**msgspec.structs.asdict(settings))
    at = np.searchsorted(solution.time_ns, vectors.time_ns)
    at = np.minimum(at, solution.n_epochs - 1)
    own = solution.time_ns[at] == vectors.time_ns
    rot = np.where(own[:, None, None], solution.rot_ned_from_body[at], np.nan)
    used = vectors.is_present & own[:, None] & solution.is_used[at]
    risk = 1.0 - np.where(own, solution.success_probability[at], np.nan)
    risk = np.where(np.isfinite(risk), risk, settings.wrong_integer_risk)
    f = solution.filtered
    if f is not None and f.predicted_rot is not None and f.predicted_cov is not None:
        from .reliability import filter_reliability

        predicted = np.where(own[:, None, None], f.predicted_rot[at], np.nan)
        turned = np.einsum("nij,njk,nlk->nil", predicted, f.predicted_cov[at][:, :3, :3], predicted)
        result = filter_reliability(
            vectors, predicted, turned, settings=settings, is_used=used, wrong_integer_risk=risk
        )
    else:
        result = attitude_reliability(vectors, rot, settings=settings, is_used=used, wrong_integer_risk=risk)
    events = tuple(sorted((*solution.events, *reliability_events(result)), key=lambda event: event.time_ns))
    return replace(solution, reliability=result, events=events)
