"""Every failure ends in one message and the right exit code."""

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

from strainsight.errors import printable
from strainsight.processes import end_children
from strainsight_cli.printing import Level, level_of, say, shown, speaking

INTERNAL, USER, CONTRADICTED, INTERRUPTED = 1, 2, 3, 130
SHOW_CURSOR = b"\x1b[?25h\n"
"""What a progress bar hides while it is drawn."""
KEPT = "interrupted; finished stages are kept"
ENDED = "ended from outside; finished stages are kept"
ENDINGS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name))
"""What ends the process with exit code 128 + its number: Ctrl-C, a polite kill, a terminal that was closed; on Windows, which has
no SIGHUP, Ctrl-Break."""
SHARED = Path("/dev/shm")
"""Where Linux keeps memory files."""
PATIENCE = 1.0
"""[s] for the last words."""
FULL = tuple(getattr(errno, name) for name in ("ENOSPC", "EDQUOT", "EFBIG") if hasattr(errno, name))
"""What Python says of a full disk without the name of the file."""
MORE_FILES = "allow more of them at a time (ulimit -n), or give --jobs 1"
LAST_WORDS: list[Callable[[str], None]] = []
"""What else reports an interrupt, before the process ends; none may wait for anything."""


@dataclass(frozen=True)
class Failure:
    """What is reported of an exception: exit code, message, and the traceback where that is of help."""

    code: int
    message: str
    details: str = ""


def failure_of(error: Exception) -> Failure:
    """Exit code 2 for what the user can correct, else 1."""
    from strainsight.errors import StrainsightError

    details = "".join(traceback.format_exception(error))
    if isinstance(error, StrainsightError):
        return Failure(error.exit_code, str(error), details if error.exit_code == INTERNAL else "")
    if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
        return Failure(USER, f"{error.strerror}\n    {MORE_FILES}", details)
    if isinstance(error, OSError) and error.filename is not None and error.strerror is not None:
        remedy = "make the path readable and writable, or give another one (for results: --results FOLDER)"
        return Failure(USER, f"{printable(str(error.filename))}  {error.strerror}\n    {remedy}", details)
    if isinstance(error, OSError) and error.errno is not None and error.errno in FULL and _output_fails():
        what = f"standard output cannot be written: {os.strerror(error.errno)}"
        return Failure(USER, f"{what}\n    what is computed is kept; write to another file", details)
    if isinstance(error, OSError) and error.errno is not None and error.errno in FULL:
        return Failure(USER, f"{os.strerror(error.errno)}\n    make room on the disk, or write to another one", details)
    if isinstance(error, MemoryError):
        asked = f": {printable(str(error))}" if str(error) else ""
        remedy = "take a coarser mesh or a larger machine, end other programs, or give --jobs 1"
        return Failure(USER, f"there is not enough memory{asked}\n    {remedy}", details)
    text = f"internal error: {type(error).__name__}: {printable(str(error))}"
    return Failure(INTERNAL, f"{text}\n    run again with -v for the details, and report them", details)


def _output_fails() -> bool:
    """Whether standard output takes nothing, as a device that is full; asked with no byte, so that nothing is printed."""
    try:
        if sys.stdout is not None:
            os.write(sys.stdout.fileno(), b"")
    except (OSError, ValueError):  # ValueError: a stream without a file, as of tests
        return sys.stdout is sys.__stdout__
    return False


def tell(failure: Failure, verbose: bool) -> typer.Exit:
    """Say it on stderr; the exit to raise."""
    if verbose:
        say(*failure.details.splitlines(), error=True)
    say(*failure.message.split("\n"), error=True)
    return typer.Exit(failure.code)


@contextmanager
def reported(verbose: bool = False) -> Iterator[None]:
    """Turn exceptions into a message on stderr and typer.Exit: 2 if the user can correct it, else 1; 130 interrupted."""
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
    """`reported` with as much on the terminal as -q, -v or --log-level want; yields whether that is all there is.

    wanted: what goes to stdout is what was wanted, as with --json, and is printed in any case.
    """
    with reported(verbose or named == "debug"):
        level = level_of(quiet, verbose, named)
        with speaking(level, wanted):
            yield level >= Level.DEBUG


def plain_warnings(verbose: bool) -> None:
    """From now on warnings to the user are one line each, once; those to developers are only shown where `verbose`."""
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
    """Print a warning on stderr, once a command, and write it to the log that is open."""
    warnings.showwarning(UserWarning(text), UserWarning, "strainsight", 0)


def same_text(text: str) -> str:
    """By which two warnings are one: stages begin them in lower case, pages write sentences."""
    return f"{text[:1].lower()}{text[1:].rstrip('.')}"


@contextmanager
def _interruptible() -> Iterator[None]:
    """Make Ctrl-C, and what else asks a process to end, end it: at once, in any case, and with what it has started.

    Python raises KeyboardInterrupt wherever its main thread happens to be: in a callback of a C library it is printed and
    forgotten, and a factorisation is ended first, which may take a minute. Another thread waits for the signal here, and runs
    as soon as the C library lets it. Nothing is lost by ending hard: an artefact is whole or absent, the kernel drops the
    lock, and the next run clears up.
    """
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
    """The main thread, where Python has a turn: it starts nothing more, and ends all where the other thread cannot."""
    time.sleep(PATIENCE)
    _leave(128 + number)


def _wait_for_the_end(reading: int) -> None:
    """Python writes the number of every signal to the other end of this pipe, which is closed when nothing is left to end."""
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
    """End without another line of anybody's code, and without what Intel's OpenMP keeps in memory files until it is left
    properly (now and then: it depends on how far its threads have come)."""
    with suppress(OSError):
        for registered in SHARED.glob(f"__KMP_REGISTERED_LIB_{os.getpid()}_*"):
            registered.unlink(missing_ok=True)
    os._exit(code)
