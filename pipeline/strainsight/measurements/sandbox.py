"""Signals from a child process, in which the library of a format may crash, hang, or want more memory than there is.

The HDF5 library ends the whole process with a segmentation fault on some damaged files, and never ends on others (seen with
HDF5 2.0, a few altered bytes in four of four thousand files); a damaged MDF4 or MAT file claims any amount of memory. In a
child process that costs the file and not the run.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np

from strainsight.errors import UserError
from strainsight.processes import asked_of_reader, limit_memory, reader

DAMAGED = "export the test data again: the file is damaged or none"
Signals = Iterator[tuple[np.ndarray, str | None]]
"""Values (T,) and their unit, None where the file states none."""
Read = Callable[[Path, Sequence[Any]], Signals]
"""File, names → their signals; the first name is that of the time, None where the format has one of its own."""
Declared = Callable[[Path, Sequence[Any]], list[int]]
"""File, names → bytes that each unpacks to, by what the file declares, before any is read."""


def read_apart(
    command: Sequence[str],
    path: Path,
    names: Sequence[str | None],
    places: Sequence[str],
    limits: tuple[float, float],
    library: str,
    unpacked: float | None = None,
) -> Signals:
    """What `answer` in a child process reads under `names`; places: of each, for a message; limits [s] of processor time until it
    is there and of every answer; unpacked [bytes/s]: a second more for so many of those that it declares, where it does.

    Raises UserError as it does, and where the process fails.
    """
    with reader(command, [str(path), *names], limits[0]) as within:
        more = [0.0] * len(places)
        if unpacked is not None:
            said = within(limits[1], partial(_said, where=places[0], library=library))
            more = [size / unpacked for size in said["declared"]]
        for where, longer in zip(places, more, strict=True):
            yield within(limits[1] + longer, partial(_received, where=where, library=library))


def _said(stream: IO[bytes], where: str, library: str) -> dict[str, Any]:
    """A line of JSON. Raises UserError where it is one, and where nothing came."""
    line = stream.readline()
    try:
        said: dict[str, Any] = json.loads(line)
    except ValueError:
        raise _failed(where, library) from None
    if "what" in said:
        raise UserError(said["what"], where=said["where"], remedy=said["remedy"])
    return said


def _failed(where: str, library: str) -> UserError:
    return UserError(f"the {library} library crashed, or did not come to an end", where=where, remedy=DAMAGED)


def _received(stream: IO[bytes], where: str, library: str) -> tuple[np.ndarray, str | None]:
    """A signal: a line of JSON, {samples, unit} or the error, then the samples."""
    said = _said(stream, where, library)
    values = np.empty(said["samples"])
    view, filled = values.view(np.uint8), 0
    while filled < len(view) and (count := stream.readinto(view[filled:])):  # type: ignore[attr-defined]
        filled += count
    if filled < len(view):
        raise _failed(where, library)
    return values, said["unit"]


def answer(
    read: Read, modules: Sequence[str], memory: Callable[[int], int] | None = None, declared: Declared | None = None
) -> None:
    """In the child process: what `read` gives, with the modules imported before, and before that what is declared; memory: bytes
    of the file → bytes that reading may take."""
    path, *names = asked_of_reader(*modules)
    out = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what a library prints is no answer
    if memory is not None:
        limit_memory(memory(Path(path).stat().st_size))
    try:
        if declared is not None:
            out.write(json.dumps({"declared": declared(Path(path), names)}).encode() + b"\n")
            out.flush()
        for values, unit in read(Path(path), names):
            out.write(json.dumps({"samples": values.size, "unit": unit}).encode() + b"\n")
            out.write(np.ascontiguousarray(values, dtype=float).data)
            out.flush()
    except UserError as error:
        out.write(json.dumps({"what": error.what, "where": error.where, "remedy": error.remedy}).encode() + b"\n")
    out.flush()
