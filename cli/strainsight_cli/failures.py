"""Every failure ends in one message and the right exit code."""

from __future__ import annotations

import os
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

import typer

INTERNAL, USER, INTERRUPTED = 1, 2, 130
SHOW_CURSOR = b"\x1b[?25h\n"
"""What a progress bar hides while it is drawn."""
KEPT = "interrupted; finished stages are kept"
LAST_WORDS: list[Callable[[str], None]] = []
"""What else is told of an interrupt, before the process ends; none may wait for anything."""


@dataclass(frozen=True)
class Failure:
    """What is told of an exception: exit code, message, and the traceback where that is of help."""

    code: int
    message: str
    details: str = ""


def failure_of(error: Exception) -> Failure:
    """Exit code 2 for what the user can mend, else 1."""
    from strainsight.errors import StrainsightError

    details = "".join(traceback.format_exception(error))
    if isinstance(error, StrainsightError):
        return Failure(error.exit_code, str(error), details if error.exit_code == INTERNAL else "")
    if isinstance(error, OSError) and error.filename is not None and error.strerror is not None:
        remedy = "make the path readable and writable, or give another one"
        return Failure(USER, f"{error.filename}  {error.strerror}\n    {remedy}", details)
    said = f"internal error: {type(error).__name__}: {error}\n    run again with -v for the details, and report them"
    return Failure(INTERNAL, said, details)


def tell(failure: Failure, verbose: bool) -> typer.Exit:
    """Say it on stderr; the exit to raise."""
    if verbose:
        print(failure.details, end="", file=sys.stderr)
    print(failure.message, file=sys.stderr)
    return typer.Exit(failure.code)


@contextmanager
def reported(verbose: bool = False) -> Iterator[None]:
    """Turn exceptions into a message on stderr and typer.Exit: 2 if the user can mend it, else 1; 130 interrupted."""
    with warnings.catch_warnings(), _interruptible():
        plain_warnings(verbose)
        try:
            yield
        except (typer.Exit, BrokenPipeError):
            raise
        except KeyboardInterrupt:
            raise tell(Failure(INTERRUPTED, KEPT), verbose) from None
        except Exception as error:
            raise tell(failure_of(error), verbose) from None


def plain_warnings(verbose: bool) -> None:
    """From now on warnings to the user are one line each; those to developers are only shown where `verbose`."""
    if not verbose:
        warnings.simplefilter("ignore")
        warnings.simplefilter("default", UserWarning)
    warnings.showwarning = _warn


@contextmanager
def _interruptible() -> Iterator[None]:
    """Make Ctrl-C end the process, at once and in any case.

    Python raises KeyboardInterrupt wherever it happens to be: in a callback of a C library it is printed and forgotten, and
    elsewhere it may end the process by the signal instead of the exit code. Nothing is lost by ending hard: an artefact is
    whole or absent, the kernel drops the lock, and the next run clears up.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(*_: object) -> None:
        # Not print: the interrupted code may hold the stream's buffer.
        for stream in (sys.stdout, sys.stderr):
            if stream.isatty():
                os.write(stream.fileno(), SHOW_CURSOR)
        os.write(2, f"{KEPT}\n".encode())
        with suppress(Exception):
            for tell_it in LAST_WORDS:
                tell_it(KEPT)
        os._exit(INTERRUPTED)

    before = signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _warn(message: Warning | str, *_: object, **__: object) -> None:
    print(f"warning: {message}", file=sys.stderr)
