"""Vectors for a self-survey: from a solution that is there, or from raw data with the geometry unknown."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import msgspec
import numpy as np

from ..attitude.adjustment import free_of_length
from ..attitude.array_vectors import ArrayVectors
from ..config import Session
from ..errors import ConfigError, NoSolutionError
from ..timescales import NS_PER_S

__all__ = ["survey_session", "vectors_of_baselines", "vectors_of_solution"]

_NED_FROM_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])

MIN_LENGTH_SD_M = 5e-4
"""A length better known than this could not be taken out of an adjusted baseline without loss of digits."""


def vectors_of_solution(solution) -> ArrayVectors:
    """Vectors of an attitude solution, as the phases alone gave them.

    Parameters
    ----------
    solution : AttitudeSolution
        Its own vectors where it keeps them; else its baselines, freed of the length that adjusted them.

    Returns
    -------
    ArrayVectors

    Raises
    ------
    ConfigError
        If the solution keeps neither.

    Notes
    -----
    Whatever the integers of the solution rested on chose them. Where the geometry is in doubt use
    `survey_session`, which resolves them without it.
    """
    vectors = getattr(solution, "vectors", None)
    if vectors is not None:
        return vectors
    if len(solution.baselines) == 0:
        raise ConfigError(
            "the solution keeps neither vectors nor baselines; solve the session anew", key="vectors"
        )
    return vectors_of_baselines(
        solution.baselines, solution.positions_body_m, solution.time_ns, names=solution.antennas
    )


def vectors_of_baselines(baselines, positions_body_m, time_ns, *, names=(), max_time_difference_s=0.05):
    """Vectors from baselines that share their first antenna.

    Half of the variance of a baseline is that of the antenna that all share: with alike receivers under the
    same satellites the covariance between two baselines of covariance P_i = L_i L_i^T is L_i L_j^T / 2.

    Parameters
    ----------
    baselines : sequence of BaselineSolution
        From the reference antenna to each other one, in the order of the coordinates.
    positions_body_m : ndarray, shape (m, 3)
        Body coordinates, the reference first.
    time_ns : ndarray of int64, shape (n,)
        Epochs that are wanted.
    names : sequence of str, optional
        Of the antennas.
    max_time_difference_s : float
        Epochs of a baseline further off are not those.

    Returns
    -------
    ArrayVectors
        Of accepted epochs.
    """
    m, n = len(positions_body_m), len(time_ns)
    vector_m = np.full((n, m, 3), np.nan)
    factor = np.full((n, m, 3, 3), np.nan)
    for k, solution in enumerate(baselines, start=1):
        rows = np.flatnonzero(solution.is_accepted)
        if len(rows) == 0:
            continue
        enu_m, cov_enu_m2 = free_of_length(solution, rows)
        cov = _NED_FROM_ENU @ cov_enu_m2 @ _NED_FROM_ENU.T
        size = np.linalg.eigvalsh(cov)
        after = np.clip(np.searchsorted(time_ns, solution.time_ns[rows]), 1, max(n - 1, 1))
        earlier = np.abs(solution.time_ns[rows] - time_ns[after - 1])
        later = np.abs(solution.time_ns[rows] - time_ns[np.minimum(after, n - 1)])
        at = np.where(earlier <= later, after - 1, np.minimum(after, n - 1))
        good = (np.minimum(earlier, later) <= max_time_difference_s * NS_PER_S) & (size[:, 0] > 0.0)
        # Without the length a baseline may be as weak as the sky is; such epochs say nothing of it.
        good &= size[:, 2] < 0.01 * np.maximum(np.sum(enu_m**2, axis=1), 0.01)
        vector_m[at[good], k] = enu_m[good] @ _NED_FROM_ENU.T
        factor[at[good], k] = np.linalg.cholesky(cov[good])
    cov_m2 = 0.5 * np.einsum("niab,njcb->niajc", factor, factor, optimize=True)
    for k in range(m):
        cov_m2[:, k, :, k, :] *= 2.0
    present = np.isfinite(vector_m[..., 0]).any(1)
    return ArrayVectors(
        time_ns=np.asarray(time_ns),
        reference=np.where(present, 0, -1).astype(np.int64),
        vector_ned_m=vector_m,
        cov_ned_m2=cov_m2.reshape(n, 3 * m, 3 * m),
        positions_body_m=np.asarray(positions_body_m, dtype=float),
        body_cov_m2=np.zeros((3 * m, 3 * m)),
        names=tuple(names),
    )


def survey_session(
    session: Session,
    *,
    lengths: Literal["unknown", "approximate", "declared"] = "unknown",
    length_sd_m: float = 0.05,
    progress: Callable[[int, int], None] | None = None,
    residual_rows: int = 0,
):
    """Solve the baselines of a session for a self-survey.

    Parameters
    ----------
    session : Session
        Two antennas or more.
    lengths : str
        What the integers may rest on. ``"unknown"``: on no length at all; ``"approximate"``: on the declared
        ones within `length_sd_m`; ``"declared"``: as the session says. In every case the vectors are
        then freed of them.
    length_sd_m : float
        For ``"approximate"``.
    progress : callable, optional
        Called with (epochs done, epochs in all).
    residual_rows : int
        Phase residuals that each baseline keeps at most.

    Returns
    -------
    vectors : ArrayVectors
        Between the antennas that could be solved; its names say which.
    baselines : tuple of BaselineSolution
        To each of them but the first.
    warnings : tuple of str
        Antennas that are left out among them.

    Raises
    ------
    ConfigError
        If an option is impossible.
    FormatError
        If a file cannot be read.
    NoSolutionError
        If no antenna has an accepted epoch together with the first.
    """
    from ..attitude.baselines import solve_baseline
    from ..attitude.runs import open_receiver
    from ..formats import read_navigation

    antennas = session.platform.antennas
    names = tuple(antenna.name for antenna in antennas)
    if lengths not in ("unknown", "approximate", "declared"):
        raise ConfigError(
            f"`lengths` is {lengths!r}; give unknown, approximate or declared", key="lengths", value=lengths
        )
    known = all(antenna.position_body_m is not None for antenna in antennas)
    if lengths != "unknown" and not known:
        raise ConfigError(
            f"`lengths` is {lengths!r} but the antennas have no body coordinates; give unknown",
            key="lengths",
            value=lengths,
        )
    positions_m = np.array([antenna.position_body_m or (0.0, 0.0, 0.0) for antenna in antennas])
    settings = session.settings
    paths = session.observation_paths
    navigation = read_navigation(*(session.gnss.navigation or paths))
    base = open_receiver(paths[0], whole=settings.direction != "forward")
    baselines, warnings, kept = [], [], [0]
    for k, path in enumerate(paths[1:]):
        own = settings
        if lengths == "unknown":
            own = msgspec.structs.replace(
                settings, length_m=None, length_use="off", direction_azimuth_deg=None, estimate_length=False
            )
        else:
            length_m = float(np.linalg.norm(positions_m[k + 1] - positions_m[0]))
            sd_m = length_sd_m if lengths == "approximate" else settings.length_sd_m
            own = msgspec.structs.replace(
                settings, length_m=length_m, length_sd_m=max(sd_m, MIN_LENGTH_SD_M), estimate_length=False
            )
        part = None
        if progress is not None:
            part = _part(progress, k, len(paths) - 1)
        try:
            solution = solve_baseline(
                base, path, navigation, settings=own, progress=part, residual_rows=residual_rows
            )
        except NoSolutionError as error:
            warnings.append(f"{names[k + 1]} is left out: {error}")
            continue
        warnings += [f"{names[k + 1]}: {text}" for text in solution.warnings]
        if not np.any(solution.is_accepted):
            warnings.append(f"{names[k + 1]} is left out: no epoch of it was accepted")
            continue
        baselines.append(solution)
        kept.append(k + 1)
    if not baselines:
        raise NoSolutionError(
            f"could not calibrate the array: {'; '.join(warnings)}; observe longer, or let the integers "
            "rest on approximate lengths"
        )
    positions_m, names = positions_m[kept], tuple(names[k] for k in kept)
    vectors = vectors_of_baselines(
        baselines, positions_m, base.time_ns, names=names,
        max_time_difference_s=settings.max_time_difference_s,
    )  # fmt: skip
    return vectors, tuple(baselines), tuple(dict.fromkeys(warnings))


def _part(progress, k, n_parts):
    """Progress of one baseline as part of the whole."""
    return lambda done, total: progress(k * total + done, n_parts * total)
