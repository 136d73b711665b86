"""Solving a session: the platform, its files and its settings, from one TOML file."""

from __future__ import annotations

import os
from collections.abc import Callable

from ..config import Session
from .baselines import solve_baseline
from .solution import BaselineSolution

__all__ = ["solve_session"]


def solve_session(
    session: Session | str | os.PathLike[str], *, progress: Callable[[int, int], None] | None = None
) -> BaselineSolution:
    """Baseline between the two antennas of a session at every common epoch.

    Parameters
    ----------
    session : Session or path-like
        The session or its ``session.toml``.
    progress : callable, optional
        Called with (epochs done, epochs in all).

    Returns
    -------
    BaselineSolution
        From the first antenna of the platform to the second.

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
    base, rover = session.observation_paths
    return solve_baseline(
        base, rover, list(session.gnss.navigation), settings=session.settings, progress=progress
    )
