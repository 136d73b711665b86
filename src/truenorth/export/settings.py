"""The effective settings of a run, written beside its result so that the run can be repeated."""

from pathlib import Path

from ..errors import writing
from ..timescales import format_gpst
from .files import ensure_writable

__all__ = ["settings_path", "write_settings"]


def settings_path(result_path):
    """Where the settings of a result file go: ``result.csv`` has ``result.settings.toml`` beside it."""
    return Path(result_path).with_suffix(".settings.toml")


def write_settings(session, result_path, *, solution=None):
    """Write the effective settings as a session file that repeats the run.

    Parameters
    ----------
    session : Session
        What was solved.
    result_path : str or path-like
        The result that the settings belong to.
    solution : BaselineSolution, optional
        Names the span of the run in the heading of the file.

    Returns
    -------
    pathlib.Path
        The settings file, to be given to ``truenorth solve``.

    Raises
    ------
    ConfigError
        If the file cannot be written.
    """
    from .. import __version__

    path = settings_path(result_path)
    ensure_writable(path)
    heading = [
        f"# Effective settings of {Path(result_path).name}, every default included.",
        f"# TrueNorth {__version__}",
    ]
    if solution is not None and solution.n_epochs:
        first, last = (format_gpst(time_ns) for time_ns in solution.time_ns[[0, -1]])
        heading.append(f"# {solution.n_epochs} epochs, {first} to {last} GPST")
    text = "\n".join(heading) + "\n\n" + session.to_toml(folder=path.parent)
    with writing(path):
        path.write_text(text, encoding="utf-8")
    return path
