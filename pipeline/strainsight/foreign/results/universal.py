"""Modes and static displacements of a universal file (.unv, .uff): datasets 55 and 2414, data at nodes.

Source: the UFF pages of the University of Cincinnati (SDRL). Lines of -1 stand around every dataset. A header is followed by two
lines a node: its number, and its values in columns of 13.
"""

from __future__ import annotations

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
    check_frequency,
    check_motion,
    integers,
    padded,
    reals,
    unsupported,
)

_LONGEST = 4096
"""[bytes] read as one line: those of a text have 80."""
_WIDTH, _ID, _NUMBER = 78, 10, 13
"""Columns of a line of values, of the number of a node, and of a value."""
_ROUNDING = 5e-6
"""Of a number with six digits."""
_OTHERS = {
    3: "complex modes",
    4: "a transient response",
    5: "a frequency response",
    6: "a buckling shape",
    7: "complex modes",
}
_STATIC, _MODE, _NONLINEAR = 1, 2, 9
_REAL = (2, 4)
_VECTORS = {2: 3, 3: 6}
"""Data characteristic → values a node: translations, and rotations with them."""
_AT_NODES = 1
_DISPLACEMENT = 8
_SHAPED = (2, 3, 7)
"""Kinds of analysis whose vectors are shapes, real or complex."""
_SHAPES = (0, 1, _DISPLACEMENT, 11, 12, 95, 96)
"""Types of data that a mode shape may have: unknown, general, displacement, velocity, acceleration."""
_NONE = ("", "NONE")


class _Layout(NamedTuple):
    """Lines of a header; those of its titles, parameters, integers, reals and location (from 0; None: always nodes); the fields
    of load case and mode among the integers, of frequency and modal mass among the reals."""

    lines: int
    titles: slice
    parameters: int
    integers: int
    reals: int
    location: int | None
    load_case: int
    mode: int
    frequency: int
    mass: int


_LAYOUTS = {
    "55": _Layout(8, slice(0, 5), 5, 6, 7, None, 2, 3, 0, 1),
    "2414": _Layout(13, slice(3, 8), 8, 9, 11, 2, 4, 5, 1, 3),
}

"""Number of a dataset → where its header has what."""


class _Dataset(NamedTuple):
    """A dataset: its lines, each of _WIDTH columns, and the number of the first of them in the file."""

    layout: _Layout
    lines: bytearray
    number: int


def universal_responses(path: Path) -> Iterator[Response]:
    """Mode shapes and static displacements at nodes, in the order of the file; other datasets are passed over.

    The step is the load case (dataset 55) or the load set (2414), 1 where it is 0; static responses of one count from 1. They are
    along the basic axes, as the format has it.
    Raises DeckError with file:line where datasets do not close or numbers cannot be read, and for complex, transient, frequency
    and buckling results.
    """
    counts: Counter[int] = Counter()
    for dataset in _datasets(path):
        found = _response(dataset, counts, path)
        if found is not None:
            yield found


def _is_mark(line: bytes) -> bool:
    """The line before and behind every dataset: -1 in the first six columns."""
    return line[:6].strip() == b"-1" and not line[6:].strip()


def _datasets(path: Path) -> Iterator[_Dataset]:
    """The datasets 55 and 2414, one in memory at a time."""
    number = 0
    with opened(path) as file:
        while line := file.readline(_LONGEST):
            number += 1
            if not line.strip():
                continue
            if not _is_mark(line):
                raise DeckError(
                    "no start of a dataset",
                    where=f"{path}:{number}",
                    remedy="a universal file has lines of -1 around every dataset: give such a file, or export it again",
                )
            kind = file.readline(_LONGEST)[:6].strip().decode("latin-1")
            number += 1
            layout, first, lines = _LAYOUTS.get(kind), number + 1, bytearray()
            while not _is_mark(line := file.readline(_LONGEST)):
                number += 1
                if not line:
                    raise DeckError(f"the file ends within dataset {kind}", where=f"{path}:{number}", remedy=AGAIN)
                if layout is not None:
                    lines.extend(padded(line, _WIDTH))
            number += 1
            if layout is not None:
                yield _Dataset(layout, lines, first)


def _response(dataset: _Dataset, counts: Counter[int], path: Path) -> Response | None:
    """None where it holds something else than a vector of displacements at nodes."""
    layout, lines, where = dataset.layout, dataset.lines, f"{path}:{dataset.number}"
    if (there := len(lines) // _WIDTH) < layout.lines:
        raise DeckError(f"a header of {there} lines, not {layout.lines}", where=where, remedy=AGAIN)
    head = [lines[row * _WIDTH : (row + 1) * _WIDTH].decode("latin-1") for row in range(layout.lines)]
    _, analysis, characteristic, kind, data, count = _integers(head[layout.parameters], 6, where)
    if layout.location is not None and _integers(head[layout.location], 1, where)[0] != _AT_NODES:
        return None
    if characteristic not in _VECTORS or kind not in (_SHAPES if analysis in _SHAPED else (_DISPLACEMENT,)):
        return None
    if analysis not in (_STATIC, _MODE, _NONLINEAR) or data not in _REAL:
        raise unsupported(
            _OTHERS.get(analysis, "complex values" if data > 4 else f"an analysis of type {analysis}"), where
        )
    if count != _VECTORS[characteristic]:
        raise DeckError(f"a vector of {count} values, not {_VECTORS[characteristic]}", where=where, remedy=AGAIN)
    integers_, reals_ = _integers(head[layout.integers], 8, where), _reals(head[layout.reals], where)
    step = integers_[layout.load_case] or 1
    is_mode = analysis == _MODE
    counts[step] += not is_mode
    frequency = reals_[layout.frequency] if is_mode else 0.0
    ids, motion = _rows(dataset, count, path)
    check_motion(ids, motion, where)
    check_frequency(frequency, where)
    return Response(
        "mode" if is_mode else "static",
        step,
        integers_[layout.mode] if is_mode else counts[step],
        ids,
        motion,
        frequency,
        next((title for line in head[layout.titles] if (title := line.strip()) not in _NONE), ""),
        (reals_[layout.mass] or None) if is_mode else None,
        rounding=_ROUNDING,
        where=where,
    )


def _integers(line: str, count: int, where: str) -> list[int]:
    """So many integers of a line of a header, 0 where it is shorter."""
    values = [parse_integer(word) for word in line.split()[:count]]
    if None in values:
        raise DeckError(f"{line.strip()!r} are no integers of a header", where=where, remedy=AGAIN)
    return [value for value in values if value is not None] + [0] * (count - len(values))


def _reals(line: str, where: str) -> list[float]:
    """Six numbers of a line of a header, 0 where it is shorter."""
    words = [line[at : at + _NUMBER].strip() for at in range(0, _WIDTH, _NUMBER)]
    values = [parse_real(word or "0") for word in words]
    if None in values:
        raise DeckError(f"{line.strip()!r} are no numbers of a header", where=where, remedy=AGAIN)
    return [value for value in values if value is not None]


def _rows(dataset: _Dataset, count: int, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Ids (n,) and values (n, count)."""
    first = dataset.layout.lines
    number = dataset.number + first
    text = np.frombuffer(dataset.lines, np.uint8).reshape(-1, _WIDTH)[first:]
    if len(text) % 2:
        raise DeckError("a node without its values", where=f"{path}:{number + len(text)}", remedy=AGAIN)
    return (
        integers(text[::2, :_ID], lambda row: f"{path}:{number + 2 * row}"),
        reals(text[1::2, : count * _NUMBER], _NUMBER, lambda row: f"{path}:{number + 2 * row + 1}"),
    )
