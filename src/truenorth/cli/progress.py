"""Progress on a terminal, silence in a pipe."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["kernels_are_compiled", "working"]


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


def kernels_are_compiled() -> bool:
    """Whether Numba has compiled our kernels before, judged by the age of its cache files."""
    sources = Path(__file__).parent.parent / "_kernels"
    named = os.environ.get("NUMBA_CACHE_DIR")
    caches = [Path(named)] if named else [sources / "__pycache__", Path.home() / ".cache" / "numba"]
    compiled = [path.stat().st_mtime for cache in caches for path in cache.rglob("*.nbi")]
    newest = max(path.stat().st_mtime for path in sources.glob("*.py"))
    return bool(compiled) and max(compiled) >= newest
