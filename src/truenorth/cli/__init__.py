"""The command line: one thin file per command, each a call of one public function.

Results go to stdout or to files, everything else to stderr. Exit codes: 0 good, 1 finished without a
usable solution, 2 usage, 3 unreadable input, 4 internal error. A failure is one sentence; the
environment variable ``TRUENORTH_TRACEBACK=1`` adds the traceback.
"""

from __future__ import annotations

import sys

__all__ = ["main"]


def main() -> None:
    """Entry point of the ``truenorth`` program."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            # A file name that the terminal cannot show must not end the run.
            stream.reconfigure(errors="backslashreplace")
    from .quick import parse_solve

    call = parse_solve(sys.argv[1:])
    if call is not None:
        from .guard import run_safely
        from .run import run_solve

        sys.exit(run_safely(run_solve, *call.arguments, **call.outputs))
    from .app import app

    app(prog_name="truenorth")
