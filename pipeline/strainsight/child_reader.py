"""Read a file in a child process, in which the library of its format may crash, hang, or run out of memory.
The HDF5 library crashes on some damaged files, and hangs on others (HDF5 2.0, four of four thousand altered files). Damaged MDF4
or MAT files, or meshio, may request any amount of memory (192 GiB for a TetGen file of 300 bytes). In a child process, only the
file is lost.
A message of the child is a line of JSON, followed by the arrays listed in it."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import IO, Any

import numpy as np

from strainsight.errors import UserError
from strainsight.processes import START_LIMIT, limit_memory, reader, receive_request

Message = tuple[dict[str, Any], list[np.ndarray]]
"""Plain values, and arrays."""


@contextmanager
def child_reader(command: Sequence[str], request: Any, failure: UserError) -> Iterator[Callable[[float], Message]]:
    """The next message of `answer` in the process of this command, by its limit [s] of processor time.

    A message raises the error, of the class of `failure`, that the child raised, and `failure` where the process fails."""
    with reader(command, request, START_LIMIT) as within:
        yield lambda limit: within(limit, partial(_received, failure=failure))


def _received(stream: IO[bytes], failure: UserError) -> Message:
    try:
        head: dict[str, Any] = json.loads(stream.readline())
    except ValueError:
        raise failure from None
    if "what" in head:
        raise type(failure)(head["what"], where=head["where"], remedy=head["remedy"])
    arrays = []
    for kind, shape in head.pop("arrays"):
        values = np.empty(shape, kind)
        view, filled = values.reshape(-1).view(np.uint8), 0
        while filled < len(view) and (count := stream.readinto(view[filled:])):  # type: ignore[attr-defined]
            filled += count
        if filled < len(view):
            raise failure
        arrays.append(values)
    return head, arrays


def answer(
    read: Callable[[Any], Iterable[Message]],
    modules: Sequence[str],
    memory: Callable[[Any], int] | None = None,
    writable: Callable[[Any], str] | None = None,
) -> None:
    """In the child process: send the messages that `read` makes of the request, or the UserError that it raises.

    modules: imported before; memory: request → bytes that reading may take; writable: see `receive_request`."""
    request = receive_request(*modules, writable=writable)
    out = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what a library prints is no answer
    if memory is not None:
        limit_memory(memory(request))
    try:
        for head, arrays in read(request):
            plain = [np.ascontiguousarray(values) for values in arrays]
            _send(out, head | {"arrays": [(values.dtype.str, values.shape) for values in plain]}, plain)
    except UserError as error:
        _send(out, {"what": error.what, "where": error.where, "remedy": error.remedy}, ())


def _send(out: IO[bytes], head: dict[str, Any], arrays: Sequence[np.ndarray]) -> None:
    out.write(json.dumps(head).encode() + b"\n")
    for values in arrays:
        out.write(values.reshape(-1).view(np.uint8).data)
    out.flush()


def reason(error: Exception) -> str:
    """Message of a library for a damaged file, on one line; most libraries have no specific error classes."""
    return " ".join(str(error).split())[:200] or type(error).__name__
