"""Solving a session: the platform, its files and its settings, from one TOML file."""

from __future__ import annotations

import os
from collections.abc import Callable

from ..config import Session
from .array import solve_array
from .array_solution import AttitudeSolution
from .baselines import solve_baseline
from .solution import BaselineSolution

__all__ = ["solve_session"]


def solve_session(
    session: Session | str | os.PathLike[str],
    *,
    progress: Callable[[int, int], None] | None = None,
    keep_residuals: bool = False,
) -> BaselineSolution | AttitudeSolution:
    """Baseline of two antennas, or attitude of more, at every common epoch of a session.

    Parameters
    ----------
    session : Session or path-like
        The session or its ``session.toml``.
    progress : callable, optional
        Called with (epochs done, epochs in all).
    keep_residuals : bool
        Keep the phase residuals of every baseline of an array; those of two antennas are always kept.

    Returns
    -------
    BaselineSolution or AttitudeSolution
        From the first of two antennas to the second; the attitude where there are three or more.

    Raises
    ------
    ConfigError
        If the session holds an unknown key or an impossible value, or names a missing file.
    FormatError
        If a file cannot be read.
    NoSolutionError
        If the files hold nothing in common that could be solved.
    """
    if not isinstance(session, Session):
        session = Session.read(session)
    paths, navigation = session.observation_paths, list(session.gnss.navigation)
    if session.is_array:
        antennas = session.platform.antennas
        return solve_array(
            paths,
            [antenna.position_body_m for antenna in antennas],
            navigation,
            names=[antenna.name for antenna in antennas],
            settings=session.settings,
            array=session.array,
            attitude_filter=session.attitude_filter,
            reliability=session.reliability,
            progress=progress,
            keep_residuals=keep_residuals,
        )
    base, rover = paths
    return solve_baseline(base, rover, navigation, settings=session.settings, progress=progress)
