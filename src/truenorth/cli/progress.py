"""Progress on a terminal, silence in a pipe."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["kernels_are_compiled", "mark_kernels_compiled", "working"]


@contextmanager
def working(text: str) -> Iterator[Callable[[int, int], None] | None]:
    """Show on a terminal that something is being done; announce the first compilation.

    Parameters
    ----------
    text : str
        What is being done.

    Yields
    ------
    callable or None
        To be called with (steps done, steps in all); None where nobody watches.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    if not kernels_are_compiled():
        text += " (first run: compiling, about half a minute, once)"
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(text, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def kernels_are_compiled(kind: str = "pair") -> bool:
    """Whether a run has compiled the present kernels before, by the mark that it left.

    Parameters
    ----------
    kind : {"pair", "array"}
        Those of two antennas, or of more.

    Returns
    -------
    bool
    """
    return any(mark.is_file() for mark in _marks(kind))


def mark_kernels_compiled(kind: str = "pair") -> None:
    """Leave the mark of a first run beside Numba's cache, where that can be written.

    Parameters
    ----------
    kind : {"pair", "array"}
        Those of two antennas, or of more.
    """
    for mark in _marks(kind):
        try:
            mark.parent.mkdir(parents=True, exist_ok=True)
            mark.touch()
        except OSError:
            continue
        return


def _marks(kind: str) -> list[Path]:
    """Where the mark may be: Numba's folders, in its own order."""
    from .._kernels import fingerprint

    named = os.environ.get("NUMBA_CACHE_DIR")
    kernels = Path(__file__).parent.parent / "_kernels"
    folders = [Path(named)] if named else [kernels / "__pycache__", Path.home() / ".cache" / "numba"]
    return [folder / f"truenorth-{fingerprint()[:16]}-{kind}.compiled" for folder in folders]
