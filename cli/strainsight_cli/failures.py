"""Every failure ends in one message and the right exit code."""

from __future__ import annotations

import os
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import typer

INTERNAL, USER, INTERRUPTED = 1, 2, 130
SHOW_CURSOR = b"\x1b[?25h\n"
"""What a progress bar hides while it is drawn."""
KEPT = "interrupted; finished stages are kept"


@contextmanager
def reported(verbose: bool = False) -> Iterator[None]:
    """Turn exceptions into a message on stderr and typer.Exit: 2 if the user can mend it, else 1; 130 interrupted."""
    from strainsight.errors import StrainsightError

    with warnings.catch_warnings(), _interruptible():
        plain_warnings(verbose)
        try:
            yield
        except (typer.Exit, BrokenPipeError):
            raise
        except StrainsightError as error:
            raise _exit(error.exit_code, str(error), verbose and error.exit_code == INTERNAL) from None
        except KeyboardInterrupt:
            raise _exit(INTERRUPTED, KEPT, False) from None
        except OSError as error:
            if error.filename is None or error.strerror is None:
                raise _exit(INTERNAL, _internal(error), verbose) from None
            remedy = "make the path readable and writable, or give another one"
            raise _exit(USER, f"{error.filename}  {error.strerror}\n    {remedy}", verbose) from None
        except Exception as error:
            raise _exit(INTERNAL, _internal(error), verbose) from None


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
        os._exit(INTERRUPTED)

    before = signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _internal(error: BaseException) -> str:
    return f"internal error: {type(error).__name__}: {error}\n    run again with -v for the details, and report them"


def _exit(code: int, message: str, with_traceback: bool) -> typer.Exit:
    if with_traceback:
        traceback.print_exc()
    print(message, file=sys.stderr)
    return typer.Exit(code)


def _warn(message: Warning | str, *_: object, **__: object) -> None:
    print(f"warning: {message}", file=sys.stderr)
