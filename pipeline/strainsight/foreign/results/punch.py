"""Modes and static displacements of a Nastran punch file (.pch).

Lines of 80 columns, of which the last 8 are their number. A block is comments that say what it holds, then two lines a point: id
in ten columns, type in eight, three components in eighteen each; -CONT- in their place and the three rotations.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from strainsight.decks.text import opened, parse_integer, parse_real
from strainsight.errors import DeckError
from strainsight.foreign.results.response import (
    AGAIN,
    Response,
    check_motion,
    integers,
    natural_frequency,
    padded,
    reals,
    unsupported,
)

_WIDTH, _ID, _FIRST, _NUMBER = 72, 10, 18, 18
"""Columns of a line, of an id, in front of the first component, and of each."""
_LONGEST = 4096
"""[bytes] read as one line."""
_ROUNDING = 5e-7
"""Of a number with seven digits."""
_WORDS = {"EIGENVECTOR", "DISPLACEMENTS"}
_EIGENVALUE = re.compile(r"(\S+)\s+MODE\s*=\s*(\d+)")
_OVER = {"FREQUENCY": "a frequency response", "TIME": "a transient response"}


class _Block(NamedTuple):
    """What the comments say, keyword → its value ("" for a word alone), the lines behind them, each of _WIDTH columns, and the
    number of the first."""

    says: dict[str, str]
    lines: bytearray
    number: int


def punch_responses(path: Path) -> Iterator[Response]:
    """Eigenvectors and displacements of the file in its order; other blocks, and cards, are passed over.

    The step is the subcase; a mode's frequency comes from its eigenvalue λ = ω². Displacements of one subcase count from 1.
    The format does not say whether an eigenvector is one of vibration or of buckling.
    Raises DeckError with the line for numbers that cannot be read, complex results, those over time or frequency, and those
    written point by point (SORT2).
    """
    counts: Counter[int] = Counter()
    for block in _blocks(path):
        yield _response(block, counts, path)


def _blocks(path: Path) -> Iterator[_Block]:
    """The blocks of eigenvectors and displacements, one in memory at a time."""
    block = _Block({}, bytearray(), 0)
    number, in_comments = 0, False
    with opened(path) as file:
        while line := file.readline(_LONGEST):
            number += 1
            if b"\0" in line or len(line) == _LONGEST:
                raise DeckError(
                    "no line of a punch file", where=f"{path}:{number}", remedy="give the .pch file that Nastran wrote"
                )
            is_comment = line.startswith(b"$")
            if is_comment and not in_comments:
                if block.lines:
                    yield block
                block = _Block({}, bytearray(), 0)
            if is_comment:
                key, _, value = line[1:_WIDTH].decode("latin-1").partition("=")
                block.says[" ".join(key.split())] = " ".join(value.split())
            elif _WORDS & block.says.keys():
                block = block if block.lines else block._replace(number=number)
                block.lines.extend(padded(line, _WIDTH))
            in_comments = is_comment
    if block.lines:
        yield block


def _response(block: _Block, counts: Counter[int], path: Path) -> Response:
    says, where = block.says, f"{path}:{block.number}"
    subcase = parse_integer(says.get("SUBCASE ID", ""))
    if subcase is None:
        raise DeckError("the comments before this line name no SUBCASE ID", where=where, remedy=AGAIN)
    if other := next((what for word, what in _OVER.items() for said in says if said.startswith(word)), None):
        raise unsupported(other, where)
    if "REAL OUTPUT" not in says:
        raise unsupported("complex displacements", where)
    if "POINT ID" in says:
        raise DeckError(
            "the displacements are written point by point (SORT2)",
            where=where,
            remedy="ask for DISPLACEMENT(SORT1,PUNCH)",
        )
    mode = _EIGENVALUE.fullmatch(says.get("EIGENVALUE", "")) if "EIGENVECTOR" in says else None
    eigenvalue = parse_real(mode[1]) if mode else 0.0
    if ("EIGENVECTOR" in says and mode is None) or eigenvalue is None:
        raise DeckError("the comments before this line state no EIGENVALUE and MODE", where=where, remedy=AGAIN)
    if mode is None:
        counts[subcase] += 1
    number = int(mode[2]) if mode else counts[subcase]
    ids, motion, scalar_points = _rows(block, path)
    check_motion(ids, motion, where)
    return Response(
        "mode" if mode else "static",
        subcase,
        number,
        ids,
        motion,
        natural_frequency(eigenvalue) if mode else 0.0,
        next((says[word] for word in ("LABEL", "SUBTITLE", "TITLE") if says.get(word)), ""),
        along_node_axes=True,
        rounding=_ROUNDING,
        scalar_points=scalar_points,
        where=f"{where}, subcase {subcase}" + (f", mode {number}" if mode else ""),
    )


def _rows(block: _Block, path: Path) -> tuple[np.ndarray, np.ndarray, int]:
    """Ids (n,) of the nodes, motion (n, 6), and how many other points there are."""
    text = np.frombuffer(block.lines, np.uint8).reshape(-1, _WIDTH)
    goes_on = text[:, 0] == ord("-")
    is_node = ~goes_on & (text[:, _FIRST - 1] == ord("G"))
    first = np.flatnonzero(is_node)
    # behind the line of a node its second, and then that of another point
    second = np.append(goes_on, [False, False])
    wrong = first[~second[first + 1] | second[first + 2]]
    if wrong.size:
        raise DeckError("a node without its two lines", where=f"{path}:{block.number + int(wrong[0])}", remedy=AGAIN)

    def place(row: int) -> str:
        return f"{path}:{block.number + int(first[row])}"

    numbers = np.concatenate([text[first, _FIRST:], text[first + 1, _FIRST:]], axis=1)
    return (
        integers(text[first, :_ID], place),
        reals(numbers, _NUMBER, place),
        int(np.count_nonzero(~is_node & ~goes_on)),
    )
