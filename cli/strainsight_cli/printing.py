"""What a command prints: nothing that a terminal obeys, and no line that a name makes up."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from enum import IntEnum
from typing import Any

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
    given = [option for option, is_there in (("-q", quiet), ("-v", verbose), ("--log-level", named)) if is_there]
    if len(given) > 1:
        from strainsight.errors import UserError

        raise UserError(
            f"{' and '.join(given)} contradict each other",
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
