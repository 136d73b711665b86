"""From exceptions to exit codes and one sentence on stderr."""

from __future__ import annotations

import functools
import os
import sys
import traceback
from collections.abc import Callable
from enum import IntEnum
from typing import Any

import typer

from ..errors import ConfigError, FormatError, NoSolutionError, TrueNorthError

__all__ = ["ExitCode", "exit_code_of", "guarded"]


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


def guarded(command: Callable[..., Any]) -> Callable[..., Any]:
    """Make a command end with an exit code and one sentence instead of a traceback.

    Parameters
    ----------
    command : callable
        A command function; its signature is kept.

    Returns
    -------
    callable
    """

    @functools.wraps(command)
    def run(*args: Any, **kwargs: Any) -> Any:
        try:
            result = command(*args, **kwargs)
            sys.stdout.flush()
        except BrokenPipeError:
            # The reader of our output has gone; nothing is left to tell it. Python would complain once
            # more while closing stdout, so that is pointed to nowhere.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(int(ExitCode.GOOD)) from None
        except (typer.Exit, typer.Abort, typer.BadParameter):
            raise
        except (Exception, KeyboardInterrupt) as error:
            raise _end(error) from None
        return result

    return run


def _end(error: BaseException) -> typer.Exit:
    """Say what happened and make the exit."""
    code = exit_code_of(error)
    if os.environ.get("TRUENORTH_TRACEBACK", "") not in ("", "0"):
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
    typer.echo(f"truenorth: {sentence}", err=True)
    return typer.Exit(int(code))


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())
