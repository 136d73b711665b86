"""The first run on a machine: kernels are compiled in two processes at once, then cached on disk."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..config import Session

__all__ = ["compile_kernels", "compile_positions", "engine_compiled_meanwhile"]

PATIENCE_S = 300.0
"""The other process may take so long; after that this one compiles what is missing itself."""

_REHEARSALS = {
    "pair": "from truenorth.ambiguity.rehearsal import rehearse_engine; rehearse_engine()",
    "array": "from truenorth.ambiguity.rehearsal import rehearse_search; rehearse_search()",
}


def compile_kernels(session: Session) -> float:
    """Compile what a run of the session needs, if nothing is compiled yet.

    The engine, or the joint search of an array, which takes more than half of the time, is compiled by a
    second process on made-up satellites, while this one compiles readers and positions on two epochs of the
    session's own files.

    Parameters
    ----------
    session : Session
        What is about to be solved.

    Returns
    -------
    float
        Wall time spent, seconds; 0 where everything had been compiled before.
    """
    started = time.perf_counter()
    try:
        with engine_compiled_meanwhile("array" if session.is_array else "pair") as is_needed:
            if not is_needed:
                return 0.0
            compile_positions(session)
    except Exception:
        # Whatever is wrong with the files, the run itself says it better.
        pass
    return time.perf_counter() - started


@contextmanager
def engine_compiled_meanwhile(kind: str = "pair") -> Iterator[bool]:
    """Let a second process compile the engine while this one does something else; wait for it at the end.

    Parameters
    ----------
    kind : {"pair", "array"}
        The engine of two antennas, or the joint search of more.

    Yields
    ------
    bool
        Whether there was anything to compile.
    """
    from .progress import kernels_are_compiled, mark_kernels_compiled

    if kernels_are_compiled(kind):
        yield False
        return
    quiet = subprocess.DEVNULL
    engine = subprocess.Popen(
        [sys.executable, "-c", _REHEARSALS[kind]], stdin=quiet, stdout=quiet, stderr=quiet
    )
    try:
        yield True
        if engine.wait(PATIENCE_S) == 0:
            mark_kernels_compiled(kind)
    except subprocess.TimeoutExpired:
        pass  # What is missing is compiled where it is needed.
    finally:
        if engine.poll() is None:
            engine.kill()
            engine.wait()


def compile_positions(session: Session) -> None:
    """Read the reference's file and position two of its epochs, which compiles readers and positioning."""
    from ..formats import iter_observations, read_navigation
    from ..positioning import solve_single_point

    paths = session.observation_paths
    navigation = read_navigation(*(session.gnss.navigation or paths))
    solve_single_point(next(iter_observations(paths[0], block_epochs=2)), navigation)
    if session.is_array:
        from ..attitude.array_run import compile_engine

        compile_engine()
