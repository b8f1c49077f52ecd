"""Output of a command: levels, streams, and protection against control characters in names."""

from __future__ import annotations

import io
import json
import os
import shutil
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from enum import IntEnum
from typing import IO, TYPE_CHECKING, Any

from strainsight.errors import UserError, printable

_rows = 0


def say(*lines: str, error: bool = False) -> None:
    """Print each text on a separate line, flushed, with control characters and line breaks as escapes; error: on stderr."""
    global _rows
    for line in map(printable, lines):
        print(line, file=sys.stderr if error else sys.stdout, flush=True)
        _rows += rows_of(line)


def rows_of(line: str) -> int:
    """Rows that a line takes on the terminal, 1 in files and pipes."""
    return 1 + max(len(line) - 1, 0) // shutil.get_terminal_size().columns if sys.stdout.isatty() else 1


def printed_rows() -> int:
    """Rows that `say` has printed in this process."""
    return _rows


def json_line(entry: Any) -> str:
    """Print an object of --json; its text can be read back unchanged."""
    return "".join(
        c if c.isprintable() else json.dumps(c)[1:-1] for c in json.dumps(entry, ensure_ascii=False, allow_nan=False)
    )


class Level(IntEnum):
    """ERROR: why the command ends; WARNING: warnings and notes; INFO: progress and tables; DEBUG: reasons, tracebacks."""

    ERROR = 0
    WARNING = 1
    INFO = 2
    DEBUG = 3


_now = Level.INFO


def now() -> Level:
    """The level of this process."""
    return _now


def shown(level: Level) -> bool:
    """Whether messages of this level are printed."""
    return level <= _now


def set_level(level: Level) -> None:
    """Set the level in a child process."""
    global _now
    _now = level


def level_of(quiet: bool, verbose: bool, named: str | None) -> Level:
    """Level of -q, -v and --log-level, which exclude each other. Raises UserError for several."""
    options = [option for option, is_there in (("-q", quiet), ("-v", verbose), ("--log-level", named)) if is_there]
    if len(options) > 1:
        raise UserError(
            f"{' and '.join(options)} exclude each other",
            remedy="use one of them: -q is --log-level error, -v is --log-level debug",
        )
    return Level[named.upper()] if named else Level.ERROR if quiet else Level.DEBUG if verbose else Level.INFO


@contextmanager
def speaking(level: Level, wanted: bool) -> Iterator[None]:
    """Set this level; wanted: the output on stdout is the result (--json, --dry-run), and is printed at every level."""
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
"""Number of the last standard stream."""
LEAST = 1 << 30
"""[bytes] Minimum address space; the libraries use more than half of it, and OpenBLAS hangs without memory for threads."""


class Pipe(io.FileIO):
    """A stream that discards output after its reader has closed the pipe, as with `| head`: results are files, so the run
    continues. Other errors are raised."""

    def write(self, content: ReadableBuffer, /) -> int:
        try:
            return super().write(content)
        except BrokenPipeError:
            self.to_nowhere()
            return super().write(content)

    def to_nowhere(self) -> None:
        """The same file descriptor, opened again."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.fileno())
        os.close(nowhere)


def prepare_streams() -> None:
    """Open closed standard streams as null devices, and replace characters that the terminal cannot encode by question marks."""
    # the numbers that are free are the first that files get, and a library may print on 1 and 2
    while (descriptor := os.open(os.devnull, os.O_RDWR)) < LAST_STREAM:
        pass
    if descriptor > LAST_STREAM:
        os.close(descriptor)
    sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    sys.stdout, sys.stderr = _for_pipe(sys.stdout, line_buffering=False), _for_pipe(sys.stderr, line_buffering=True)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _for_pipe(stream: IO[str], line_buffering: bool) -> IO[str]:
    """The stream itself, or one that survives its reader."""
    if not isinstance(stream, io.TextIOWrapper) or not stat.S_ISFIFO(os.fstat(stream.fileno()).st_mode):
        return stream
    stream.flush()
    raw = Pipe(stream.fileno(), "wb", closefd=False)
    return io.TextIOWrapper(io.BufferedWriter(raw), encoding=stream.encoding, line_buffering=line_buffering)


def unwritten() -> str:
    """Message if the output could not be written, as on a full disk; otherwise empty. There is no second attempt."""
    try:
        sys.stdout.flush()
    except OSError as error:
        Pipe(sys.stdout.fileno(), "wb", closefd=False).to_nowhere()
        remedy = "redirect the output to another file; the results in the results folder are kept"
        return f"standard output cannot be written: {error.strerror}\n    {remedy}"
    return ""


def missing() -> str:
    """Message with a remedy if something essential is missing; otherwise empty."""
    try:
        os.getcwd()
    except OSError:
        return "the working folder does not exist, or cannot be read\n    change to an existing folder"
    try:
        import resource
    except ImportError:  # Windows has no such limits
        return ""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < LEAST:
        return (
            f"the address space limit is {limit / 2**20:.0f} MiB (ulimit -v), not enough to load the "
            f"libraries\n    set at least {LEAST // 2**20} MiB: ulimit -v {LEAST // 1024}, plus the memory of the model"
        )
    return ""
