"""Failures of commands: one message and an exit code."""

from __future__ import annotations

import errno
import gc
import os
import signal
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import typer

from strainsight.errors import StrainsightError, printable
from strainsight.processes import end_children
from strainsight_cli.printing import Level, level_of, say, shown, speaking

INTERNAL, USER, INCONSISTENT, INTERRUPTED = 1, 2, 3, 130
SHOW_CURSOR = b"\x1b[?25h\n"
"""Escape sequence to show the cursor, which a progress bar hides."""
KEPT = "interrupted; finished stages are kept"
ENDED = "terminated by a signal; finished stages are kept"
ENDINGS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name))
"""Signals that end the process with exit code 128 + number: Ctrl-C, SIGTERM, a closed terminal; on Windows, without SIGHUP,
Ctrl-Break."""
SHARED = Path("/dev/shm")
"""Folder of memory files on Linux."""
PATIENCE = 1.0
"""[s] Time limit for final messages."""
FULL = tuple(getattr(errno, name) for name in ("ENOSPC", "EDQUOT", "EFBIG") if hasattr(errno, name))
"""Python's text for a full disk without a file name."""
LAST_WORDS: list[Callable[[str], None]] = []
"""Callbacks that report an interrupt before the process ends; none may block."""


@dataclass(frozen=True)
class Failure:
    """Report of an exception: exit code, message, and the traceback if it is useful."""

    code: int
    message: str
    details: str = ""


def failure_of(error: Exception) -> Failure:
    """Exit code 2 if the user can correct the failure, otherwise 1."""
    details = "".join(traceback.format_exception(error))
    if isinstance(error, StrainsightError):
        return Failure(error.exit_code, str(error), details if error.exit_code == INTERNAL else "")
    if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
        remedy = "increase the limit of open files (ulimit -n), or use --jobs 1"
        return Failure(USER, f"{error.strerror}\n    {remedy}", details)
    if isinstance(error, OSError) and error.filename is not None and error.strerror is not None:
        remedy = "make the path readable and writable, or use another one (for results: --results FOLDER)"
        return Failure(USER, f"{printable(str(error.filename))}  {error.strerror}\n    {remedy}", details)
    if isinstance(error, OSError) and error.errno is not None and error.errno in FULL and _output_fails():
        what = f"standard output cannot be written: {os.strerror(error.errno)}"
        return Failure(
            USER,
            f"{what}\n    redirect the output to another file; the results in the results folder are kept",
            details,
        )
    if isinstance(error, OSError) and error.errno is not None and error.errno in FULL:
        return Failure(
            USER, f"{os.strerror(error.errno)}\n    free some disk space, or use a folder on another disk", details
        )
    if isinstance(error, MemoryError):
        detail = f": {printable(str(error))}" if str(error) else ""
        remedy = "use a coarser mesh or a larger machine, end other programs, or use --jobs 1"
        return Failure(USER, f"not enough memory{detail}\n    {remedy}", details)
    text = f"internal error: {type(error).__name__}: {printable(str(error))}"
    return Failure(INTERNAL, f"{text}\n    run the command again with -v, and report the details", details)


def _output_fails() -> bool:
    """Whether standard output cannot be written, as a full device; tested with zero bytes, so that nothing is printed."""
    try:
        if sys.stdout is not None:
            os.write(sys.stdout.fileno(), b"")
    except (OSError, ValueError):  # ValueError: a stream without a file, as of tests
        return sys.stdout is sys.__stdout__
    return False


def tell(failure: Failure, verbose: bool) -> typer.Exit:
    """Print the failure on stderr; returns the exit to raise."""
    if verbose:
        say(*failure.details.splitlines(), error=True)
    say(*failure.message.split("\n"), error=True)
    return typer.Exit(failure.code)


@contextmanager
def reported(verbose: bool = False) -> Iterator[None]:
    """Turn exceptions into a message on stderr and typer.Exit: 2 if the user can correct it, otherwise 1; 130 interrupted."""
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


@contextmanager
def saying(quiet: bool, verbose: bool, named: str | None, wanted: bool) -> Iterator[bool]:
    """`reported` at the level of -q, -v or --log-level; yields whether the level is debug.

    wanted: the output on stdout is the result, as with --json, and is printed at every level."""
    with reported(verbose or named == "debug"):
        level = level_of(quiet, verbose, named)
        with speaking(level, wanted):
            yield level >= Level.DEBUG


def plain_warnings(verbose: bool) -> None:
    """Print each warning to the user once, on one line; show warnings to developers only if `verbose`."""
    if not verbose:
        warnings.simplefilter("ignore")
        warnings.simplefilter("default", UserWarning)
    shown_texts: set[str] = set()

    def show(message: Warning | str, *_: object, **__: object) -> None:
        text = str(message)
        if shown(Level.WARNING) and same_text(text) not in shown_texts:
            shown_texts.add(same_text(text))
            say(f"warning: {text}", error=True)

    warnings.showwarning = show


def warn(text: str) -> None:
    """Print a warning on stderr, once per command, and write it to the open log."""
    warnings.showwarning(UserWarning(text), UserWarning, "strainsight", 0)


def same_text(text: str) -> str:
    """Key to compare warnings: without the case of the first letter and the final point."""
    return f"{text[:1].lower()}{text[1:].rstrip('.')}"


@contextmanager
def _interruptible() -> Iterator[None]:
    """End the process and its children at once on Ctrl-C and similar signals, also during a C library call.
    Python raises KeyboardInterrupt in the main thread only after the current C call, and loses it in C callbacks. Here, another
    thread waits for the signal. A hard exit loses nothing: artefacts are complete or absent, the kernel releases the lock, and
    the next run cleans up."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    reading, writing = os.pipe()
    if hasattr(os, "set_blocking"):  # not on Windows before Python 3.12, which asks for it on POSIX only
        os.set_blocking(writing, False)
    waiting = threading.Thread(target=_wait_for_the_end, args=(reading,), daemon=True)
    # nohup's child goes on without its terminal.
    numbers = [number for number in ENDINGS if number == signal.SIGINT or signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, _stay) for number in numbers}
    woken = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    waiting.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(woken)
        for number, handler in before.items():
            signal.signal(number, handler)
        os.close(writing)
        waiting.join()
        os.close(reading)


def _stay(number: int, _: object) -> None:
    """Signal handler of the main thread: wait, then end the process if the other thread could not."""
    time.sleep(PATIENCE)
    _leave(128 + number)


def _wait_for_the_end(reading: int) -> None:
    """Wait for a signal number, which Python writes to the other end of this pipe; the pipe is closed when the command ends."""
    while came := os.read(reading, 1):
        if came[0] in ENDINGS:
            _end(came[0])


def _end(number: int) -> None:
    gc.disable()  # a collection may wait for a lock that the interrupted code holds, as that of h5py
    text = KEPT if number == signal.SIGINT else ENDED
    with suppress(Exception):  # a terminal that is gone
        # Not print: the interrupted code may hold the stream's buffer.
        for stream in (sys.stdout, sys.stderr):
            if stream.isatty():
                os.write(stream.fileno(), SHOW_CURSOR)
        os.write(2, f"{text}\n".encode())
    with suppress(Exception):
        for tell_it in LAST_WORDS:
            tell_it(text)
    with suppress(Exception):
        end_children()
    _leave(128 + number)


def _leave(code: int) -> None:
    """End without further Python code; remove the memory files that Intel's OpenMP otherwise may leave."""
    with suppress(OSError):
        for registered in SHARED.glob(f"__KMP_REGISTERED_LIB_{os.getpid()}_*"):
            registered.unlink(missing_ok=True)
    os._exit(code)
