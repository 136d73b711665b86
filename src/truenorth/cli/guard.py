"""From exceptions to exit codes and one sentence on stderr."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from enum import IntEnum
from typing import Any

from ..errors import ConfigError, FormatError, NoSolutionError, TrueNorthError

__all__ = ["ExitCode", "exit_code_of", "run_safely"]


class ExitCode(IntEnum):
    """What the program's exit codes mean; scripts rely on them."""

    GOOD = 0
    NO_SOLUTION = 1
    USAGE = 2
    UNREADABLE_INPUT = 3
    INTERNAL = 4
    INTERRUPTED = 130


def exit_code_of(error: BaseException) -> ExitCode:
    """Exit code that an exception ends the program with."""
    if isinstance(error, KeyboardInterrupt):
        return ExitCode.INTERRUPTED
    if isinstance(error, ConfigError):
        return ExitCode.USAGE
    if isinstance(error, NoSolutionError):
        return ExitCode.NO_SOLUTION
    # Data sets that cannot be fetched are input errors of the operating system with our own sentence.
    if isinstance(error, FormatError) or (isinstance(error, TrueNorthError) and isinstance(error, OSError)):
        return ExitCode.UNREADABLE_INPUT
    return ExitCode.INTERNAL


def run_safely(command: Callable[..., Any], *args: Any, **kwargs: Any) -> int:
    """Run a command; end with an exit code and one sentence instead of a traceback.

    Parameters
    ----------
    command : callable
        Returns an exit code, or None for 0.
    *args, **kwargs
        Its arguments.

    Returns
    -------
    int
        Exit code, see `ExitCode`.
    """
    try:
        code = command(*args, **kwargs)
        sys.stdout.flush()
    except BrokenPipeError:
        # The reader of our output has gone; nothing is left to tell it. Python would complain once
        # more while closing stdout, so that is pointed to nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return int(ExitCode.GOOD)
    except (Exception, KeyboardInterrupt) as error:
        return _tell(error)
    return int(code or 0)


def _tell(error: BaseException) -> int:
    """Say what happened; the exit code that it ends with."""
    code = exit_code_of(error)
    if os.environ.get("TRUENORTH_TRACEBACK", "") not in ("", "0"):
        import traceback

        traceback.print_exception(error)
    if code == ExitCode.INTERRUPTED:
        sentence = "interrupted"
    elif code == ExitCode.INTERNAL:
        sentence = (
            f"internal error ({type(error).__name__}: {_one_line(error)}); this is a fault of the program: "
            "set TRUENORTH_TRACEBACK=1 to see where, and report it with the input"
        )
    else:
        sentence = _one_line(error)
    print(f"truenorth: {sentence}", file=sys.stderr)
    return int(code)


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())
