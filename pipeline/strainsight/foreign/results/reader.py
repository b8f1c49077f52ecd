"""Any file of results in, its modes and static responses out, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from strainsight.decks.text import UNPACKING, check_plain
from strainsight.errors import DeckError
from strainsight.foreign.results.ansys import ansys_responses
from strainsight.foreign.results.frd import frd_responses
from strainsight.foreign.results.op2 import op2_responses
from strainsight.foreign.results.punch import punch_responses
from strainsight.foreign.results.response import Response
from strainsight.foreign.results.universal import universal_responses
from strainsight.foreign.results.vtu import vtu_responses

Reader = Callable[[Path], Iterator[Response]]
READERS: dict[str, Reader] = {
    ".frd": frd_responses,
    ".op2": op2_responses,
    ".pch": punch_responses,
    ".rst": ansys_responses,
    ".unv": universal_responses,
    ".uff": universal_responses,
    ".vtu": vtu_responses,
    ".vtk": vtu_responses,
}
"""Ending of the name, without .gz → reader."""


def read_responses(path: Path, readers: Mapping[str, Reader] = READERS) -> Iterator[Response]:
    """The modes and static responses of a file in its order; one at a time is in memory, so that a file may be larger than that.

    The ending of the name chooses the reader; .gz before it is passed over. Raises DeckError for an ending that no reader has, a
    file that is missing, damaged or no plain one, and what its reader refuses.
    """
    path = Path(path)
    reader = readers.get(ending_of(path))
    if reader is None:
        raise DeckError(
            f"no file of results by its name: {path.name}", where=str(path), remedy=f"known: {', '.join(readers)}"
        )
    try:
        check_plain(path)
        yield from reader(path)
    except FileNotFoundError:
        raise DeckError("no such file", where=str(path), remedy="check the name and the folder") from None
    except UNPACKING as error:
        raise DeckError(f"cannot be unpacked: {error}", where=str(path), remedy="pack the file again") from None
    except OSError as error:
        raise DeckError(
            f"cannot be read: {error.strerror}", where=str(path), remedy="check that it is a readable file"
        ) from None


def ending_of(path: Path) -> str:
    """The last ending of a name but .gz, in lower case; "" where it has none."""
    return next((ending.lower() for ending in reversed(path.suffixes) if ending.lower() != ".gz"), "")
