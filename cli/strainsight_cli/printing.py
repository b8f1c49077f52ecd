"""What a command prints, at which level, and the streams that it prints to: nothing that a terminal obeys, no line that a name
makes up."""

from __future__ import annotations

import io
import json
import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from enum import IntEnum
from typing import IO, TYPE_CHECKING, Any

from strainsight.errors import printable


def say(*lines: str, error: bool = False) -> None:
    """Print each on a line of its own, at once, with control characters, also a line break, as escapes; error: on stderr."""
    for line in lines:
        print(printable(line), file=sys.stderr if error else sys.stdout, flush=True)


def json_line(entry: Any) -> str:
    """An object of --json, whose text is read back as it was."""
    return "".join(
        c if c.isprintable() else json.dumps(c)[1:-1] for c in json.dumps(entry, ensure_ascii=False, allow_nan=False)
    )


class Level(IntEnum):
    """ERROR: what ends the command; WARNING: warnings and notes; INFO: what is done, and the tables; DEBUG: why, tracebacks."""

    ERROR = 0
    WARNING = 1
    INFO = 2
    DEBUG = 3


_now = Level.INFO


def now() -> Level:
    """The level of this process."""
    return _now


def shown(level: Level) -> bool:
    """Whether what is of this level goes to the terminal."""
    return level <= _now


def set_level(level: Level) -> None:
    """In a process that another one has started."""
    global _now
    _now = level


def level_of(quiet: bool, verbose: bool, named: str | None) -> Level:
    """Of -q, -v and --log-level, of which one may be given. Raises UserError for several."""
    options = [option for option, is_there in (("-q", quiet), ("-v", verbose), ("--log-level", named)) if is_there]
    if len(options) > 1:
        from strainsight.errors import UserError

        raise UserError(
            f"{' and '.join(options)} contradict each other",
            remedy="give one: -q is --log-level error, -v is --log-level debug",
        )
    return Level[named.upper()] if named else Level.ERROR if quiet else Level.DEBUG if verbose else Level.INFO


@contextmanager
def speaking(level: Level, wanted: bool) -> Iterator[None]:
    """At this level from here on; wanted: what goes to stdout was wanted (--json, --dry-run) and stays."""
    before = _now
    set_level(level)
    try:
        if wanted or level >= Level.INFO:
            yield
        else:
            with open(os.devnull, "w", encoding="utf-8") as nowhere, redirect_stdout(nowhere):
                yield
    finally:
        set_level(before)


if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

LAST_STREAM = 2
"""Number of the last of the three that a process is born with."""
LEAST = 1 << 30
"""[bytes] of address space; the libraries take more than half of it, and OpenBLAS waits for ever for threads without room."""


class Pipe(io.FileIO):
    """What is written to a pipe whose reader has gone, as with `| head`, goes nowhere: the work is not in vain, since its results
    are files. Every other failure is one."""

    def write(self, content: ReadableBuffer, /) -> int:
        try:
            return super().write(content)
        except BrokenPipeError:
            self.to_nowhere()
            return super().write(content)

    def to_nowhere(self) -> None:
        """The same number, another end."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.fileno())
        os.close(nowhere)


def prepare_streams() -> None:
    """A service may have closed them: what is printed then goes nowhere. A terminal without Greek gets question marks, not a
    failure at the end of a long run."""
    # the numbers that are free are the first that files get, and a library may print on 1 and 2
    while (taken := os.open(os.devnull, os.O_RDWR)) < LAST_STREAM:
        pass
    if taken > LAST_STREAM:
        os.close(taken)
    sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    sys.stdout, sys.stderr = _for_pipe(sys.stdout, line_buffering=False), _for_pipe(sys.stderr, line_buffering=True)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _for_pipe(stream: IO[str], line_buffering: bool) -> IO[str]:
    """The stream itself, or one that outlives its reader."""
    if not isinstance(stream, io.TextIOWrapper) or not stat.S_ISFIFO(os.fstat(stream.fileno()).st_mode):
        return stream
    stream.flush()
    raw = Pipe(stream.fileno(), "wb", closefd=False)
    return io.TextIOWrapper(io.BufferedWriter(raw), encoding=stream.encoding, line_buffering=line_buffering)


def unwritten() -> str:
    """What of the output cannot be written, a full disk say, as a message; empty where all is there. Nothing is tried again."""
    try:
        sys.stdout.flush()
    except OSError as error:
        Pipe(sys.stdout.fileno(), "wb", closefd=False).to_nowhere()
        return (
            f"standard output cannot be written: {error.strerror}\n    what is computed is kept; write to another file"
        )
    return ""


def missing() -> str:
    """What is not there, with the remedy; empty where all is."""
    try:
        os.getcwd()
    except OSError:
        return "the working folder is gone, or may not be read\n    change to a folder that exists"
    try:
        import resource
    except ImportError:  # Windows has no such limits
        return ""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < LEAST:
        return (
            f"the limit of address space is {limit / 2**20:.0f} MiB (ulimit -v), too little to load the libraries\n"
            f"    at least {LEAST // 2**20} MiB: ulimit -v {LEAST // 1024}, and what the model takes beside it"
        )
    return ""
