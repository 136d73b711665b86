"""``truenorth demo``: a simulated drive, solved and held against its truth, on one page."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..attitude.array_solution import AttitudeSolution
    from ..evaluation import Comparison
    from ..simulation import Scenario

__all__ = ["run_demo"]

SCENARIO = "demo"
PAGE = "demo.html"


def run_demo(out: Path, *, open_page: bool | None = None, as_json: bool = False) -> int:
    """Simulate a suburban drive with four antennas, solve it, compare it with the truth, write one page.

    Everything goes through files, as with real receivers: the folder holds a session that
    ``truenorth solve`` repeats.

    Parameters
    ----------
    out : Path
        Folder to write; made if need be.
    open_page : bool, optional
        Open the page in a browser; by default where one is likely to be seen.
    as_json : bool
        Tell the outcome as JSON.

    Returns
    -------
    int
        Exit code: 1 when no epoch was accepted.
    """
    import json

    from ..attitude.array_solution import AttitudeSolution
    from ..config import Session
    from ..export import write_solution
    from ..simulation import read_scenario, write_simulation
    from .first_run import compile_positions, engine_compiled_meanwhile
    from .guard import ExitCode
    from .progress import working

    started = time.perf_counter()
    scenario = read_scenario(SCENARIO)
    with working("simulating") as progress, engine_compiled_meanwhile("array") as was_new:
        written = write_simulation(scenario, out, progress=progress)
        assert written.session is not None  # four antennas are a session
        simulated = time.perf_counter()
        if was_new:
            compile_positions(Session.read(written.session))
    compiled = time.perf_counter()
    with working("solving") as progress:
        from ..attitude import solve_session

        solution = solve_session(written.session, progress=progress)
        assert isinstance(solution, AttitudeSolution)
    solved = time.perf_counter()
    with working("comparing"):
        from ..evaluation import compare

        result = write_solution(solution, out / "attitude.csv")
        comparison = compare(solution, written.truth)
        page = out / PAGE
        seconds = {
            "simulate": simulated - started,
            "compile": compiled - simulated,
            "solve": solved - compiled,
        }
        _write_page(page, scenario, written.truth, solution, comparison, seconds)
    seconds["all"] = time.perf_counter() - started

    if as_json:
        outcome: dict[str, Any] = {
            "page": str(page),
            "session": str(written.session),
            "result": str(result),
            "truth": str(written.truth),
            "seconds": {name: round(value, 3) for name, value in seconds.items()},
            "compiled": was_new,
            **comparison.to_dict(),
        }
        print(json.dumps(outcome, indent=2, allow_nan=False))
    else:
        print(f"scenario    {scenario.title}")
        print(
            f"simulated   {written.n_epochs} epochs, {len(written.observations)} antennas, "
            f"{written.n_rows} observations in {seconds['simulate']:.1f} s"
        )
        if was_new:
            print(f"compiled    kernels, once, in {seconds['compile']:.1f} s more")
        print(f"solved      in {seconds['solve']:.1f} s, by `truenorth solve {written.session}`")
        print(comparison)
        print(f"page        {page}")
    if open_page if open_page is not None else _has_a_viewer():
        import webbrowser

        webbrowser.open(page.resolve().as_uri())
    return int(ExitCode.GOOD if comparison.availability > 0.0 else ExitCode.NO_SOLUTION)


def _write_page(
    page: Path,
    scenario: Scenario,
    truth: Path,
    solution: AttitudeSolution,
    comparison: Comparison,
    seconds: dict[str, float],
) -> None:
    """Write the page of the demo."""
    from ..errors import writing
    from ..formats import read_table
    from ..report.comparison_page import comparison_html

    per_epoch_ms = 1e3 * solution.seconds["solve"] / max(solution.n_epochs, 1)
    rows = [
        (
            "Time",
            f"simulated in {seconds['simulate']:.1f} s, solved in {seconds['solve']:.1f} s; the solver took "
            f"{per_epoch_ms:.2f} ms for an epoch of {len(solution.antennas)} antennas",
        ),
        *(("Warning", text) for text in solution.warnings),
        (
            "Try",
            f"truenorth solve {page.parent / 'session.toml'}; truenorth simulate --list shows other drives",
        ),
    ]
    signals = " ".join(sorted(scenario.receiver.signals))
    subtitle = (
        f"Simulated with known truth: {scenario.start} GPST, {scenario.n_epochs} epochs at "
        f"{scenario.interval_s:g} s, {len(solution.antennas)} antennas, systems {signals}, "
        f"seed {scenario.seed}"
    )
    text = comparison_html(
        comparison,
        solution=solution,
        title=scenario.title,
        subtitle=subtitle,
        rows=rows,
        places=_places(scenario, read_table(truth)[0]),
    )
    with writing(page):
        page.write_text(text, encoding="utf-8")


def _places(scenario: Scenario, truth: dict[str, Any]) -> list[tuple[int, str]]:
    """Where the obstructions of the route are first met: (time, name)."""
    import numpy as np

    distance_m = truth["distance_m"]
    return [
        (int(truth["time_ns"][np.argmax(distance_m >= each.start_m)]), each.name or each.kind)
        for each in scenario.visibility.obstructions
        if 0.0 < each.start_m <= distance_m[-1]
    ]


def _has_a_viewer() -> bool:
    """Whether somebody sits at a terminal with a graphical desktop."""
    if not sys.stdout.isatty() or os.environ.get("CI") or os.environ.get("SSH_CONNECTION"):
        return False
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
