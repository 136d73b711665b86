"""What ``truenorth solve`` does, behind whatever parsed its arguments."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..config import Session

__all__ = ["run_session", "run_solve"]


def run_solve(files: list[Path], overrides: dict[str, Any], assignments: list[str], **outputs: Any) -> int:
    """Solve what the arguments of the command name.

    Parameters
    ----------
    files : list of Path
        One ``.toml``, or base, rover and navigation files.
    overrides : dict
        Settings given as options; None where an option was not given.
    assignments : list of str
        ``key=value`` texts.
    **outputs
        As for `run_session`.

    Returns
    -------
    int
        Exit code.
    """
    from .request import make_session

    return run_session(make_session(files, overrides, assignments), **outputs)


def run_session(
    session: Session,
    *,
    out: Path | None = None,
    figure: Path | None = None,
    explain: str | None = None,
    as_json: bool = False,
) -> int:
    """Solve a session, write what was asked for, and tell the outcome.

    Parameters
    ----------
    session : Session
        What to solve: two antennas or an array.
    out, figure : Path, optional
        Files to write.
    explain : str, optional
        Time of an epoch whose story is told instead of the summary.
    as_json : bool
        Tell it as JSON.

    Returns
    -------
    int
        Exit code: 1 when no epoch was accepted.
    """
    import json
    import time
    import warnings

    from ..errors import TrueNorthWarning
    from ..export import check_output_path, summarize_solution, write_settings, write_solution
    from ..report.text import explain_epoch, find_epoch, summary_text
    from .guard import ExitCode
    from .progress import working

    if out is not None:
        check_output_path(out, of_array=session.is_array)
    if figure is not None:
        from ..report import check_figure_path

        check_figure_path(figure)

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", TrueNorthWarning)
        with working("solving") as progress:
            from ..attitude import solve_session
            from .first_run import compile_kernels

            compiling = compile_kernels(session)
            solution = solve_session(session, progress=progress, keep_residuals=explain is not None)
    said = [str(warning.message) for warning in caught if issubclass(warning.category, TrueNorthWarning)]

    written = []
    started = time.perf_counter()
    if out is not None:
        written = [write_solution(solution, out), write_settings(session, out, solution=solution)]
    if figure is not None:
        from ..report import write_figure

        with working("drawing"):
            written.append(write_figure(solution, figure))

    summary = summarize_solution(solution)
    summary["seconds"]["write"] = time.perf_counter() - started
    summary["seconds"]["compile"] += compiling
    summary["warnings"] += [text for text in dict.fromkeys(said) if text not in summary["warnings"]]
    summary["files"] = [str(path) for path in written]
    summary["settings_file"] = str(written[1]) if out is not None else None

    if explain is not None:
        story = explain_epoch(solution, find_epoch(solution, explain))
        summary["explain"] = story
    if as_json:
        print(json.dumps(summary, indent=2, allow_nan=False))
    else:
        print(story if explain is not None else summary_text(summary))
    return int(ExitCode.GOOD if summary["accepted_fraction"] > 0.0 else ExitCode.NO_SOLUTION)
