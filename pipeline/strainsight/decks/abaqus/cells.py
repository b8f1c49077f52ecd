"""Elements of an *ELEMENT keyword as arrays: solids, shells, beams, and others that are only counted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.decks.abaqus.text import Keyword, integers, split
from strainsight.decks.faults import IdTable
from strainsight.decks.text import no_integer, parse_integer
from strainsight.errors import DeckError
from strainsight.mesh.kinds import ELEMENTS, FAMILIES
from strainsight.mesh.kinds.kind import ElementKind
from strainsight.mesh.model import IntArray

SOLIDS = {type_: (kind, how) for kind in ELEMENTS for type_, how in kind.abaqus.items()}
"""Type → kind of element, and how it is reinterpreted. The order of the nodes is that of VTK in all of them."""
USUAL = ", ".join(next(iter(kind.abaqus)) for kind in ELEMENTS if kind.abaqus)
REDUCED = "integrated fully: reduced integration and its hourglass control are not imitated"
SHELLS = {
    "S3": ("tri3", ""),
    "S3R": ("tri3", ""),
    "STRI3": ("tri3", "which shears"),
    "S4": ("quad4", ""),
    "S4R": ("quad4", REDUCED),
    "S4R5": ("quad4", REDUCED),
    "STRI65": ("tri6", ""),
    "S6": ("tri6", ""),
    "S8": ("quad8", ""),
    "S8R": ("quad8", REDUCED),
    "S8R5": ("quad8", REDUCED),
}
BEAMS = {
    "B31": ("beam", ""),
    "B31H": ("beam", ""),
    "B33": ("beam", ""),
    "B32": ("beam3", ""),
    "B32H": ("beam3", ""),
    "B32R": ("beam3", ""),
    "T3D2": ("rod", ""),
}
THIN = {**SHELLS, **BEAMS}
"""Type → kind of shell or beam, and how it is reinterpreted."""
NODES = {"tri3": 3, "quad4": 4, "tri6": 6, "quad8": 8}


@dataclass(frozen=True)
class Cells:
    """Elements of one *ELEMENT keyword: type in capitals; kind, None where it is no solid; ids (m,); nodes in a
    flat (c,) array of rows (−1 where there is none), first (m + 1,) where those of each element begin; data line (m,).

    words: position in nodes → entry that is no number (node of an instance, seen from the assembly); cut: each line holds more
    nodes than an element has and ends in a comma, as the first lines of quadratic ones do: the first ones count, as in CalculiX.
    """

    keyword: Keyword
    type: str
    kind: ElementKind | None
    ids: IntArray
    nodes: IntArray
    first: IntArray
    line: IntArray
    words: dict[int, str]
    cut: bool = False


def read_cells(keyword: Keyword, table: IdTable) -> Cells:
    """The elements of an *ELEMENT keyword, on as many lines each as it takes, with the rows of their nodes in `table`.

    A beam may have one node more, which its first axis points to. Raises DeckError for a wrong number of nodes, a node that is
    missing, and solids that are not supported.
    """
    type_ = keyword.needs("TYPE").upper()
    if type_ not in SOLIDS and type_.startswith("C3D"):
        raise keyword.error(
            f"{type_} solids are not supported ({len(keyword.texts)} lines)", f"mesh with {FAMILIES} ({USUAL})"
        )
    if not keyword.texts:
        keyword.rows()
    kind = SOLIDS[type_][0] if type_ in SOLIDS else None
    if kind is not None:
        width = len(kind.nodes) + 1
    elif type_ in SHELLS:
        width = NODES[SHELLS[type_][0]] + 1
    else:
        return _other_cells(keyword, type_, table)
    tokens, counts = keyword.flat()
    ends = np.cumsum(counts)
    first = np.flatnonzero((ends - counts) % width == 0)
    cut = bool(np.all(counts > width)) and all(text[-1] == "," for text in keyword.texts)
    if cut:
        tokens = [token for text in keyword.texts for token in split(text)[:width]]
        first = np.arange(len(keyword.texts))
    elif len(first) * width != ends[-1]:
        raise _miscount(keyword, counts, width, type_)
    values = integers(tokens)
    if values is None:
        raise _no_integer(keyword)
    values = values.reshape(-1, width)
    if values[:, 0].min() < 1:
        i = int(np.argmin(values[:, 0]))
        raise _at(keyword, int(first[i]), f"the element id {values[i, 0]} is not positive")
    rows, missing = table.rows(values[:, 1:])
    if missing.any():
        i, j = np.argwhere(missing)[0]
        number = values[i, j + 1]
        raise _at(
            keyword,
            int(first[i]),
            f"{type_} {values[i, 0]}: node {number} is not in the deck",
            f"add the node {number}, or correct the id",
        )
    begin = np.arange(len(values) + 1) * (width - 1)
    return Cells(keyword, type_, kind, values[:, 0].copy(), rows.ravel(), begin, first, {}, cut)


def _at(keyword: Keyword, i: int, what: str, remedy: str = "correct the line and run again") -> DeckError:
    return DeckError(what, where=keyword.where_data(i), remedy=remedy)


def _miscount(keyword: Keyword, counts: IntArray, width: int, type_: str) -> DeckError:
    """The first element whose lines do not hold its id and its nodes."""
    have = start = 0
    for i, count in enumerate(counts.tolist()):
        start = i if have == 0 else start
        continued = i > start and keyword.texts[i - 1][-1] == ","
        have += count
        if have > width or (have < width and i + 1 == len(counts)):
            own = have if have < width or i == start or continued else have - count
            element = split(keyword.texts[start])[0]
            return _at(
                keyword,
                start,
                f"{type_} {element}: {own - 1} nodes, where a {type_} has {width - 1}",
                "give the nodes of a whole element; the deck may be cut off here",
            )
        have %= width
    raise AssertionError("the lines hold whole elements")


def _no_integer(keyword: Keyword) -> DeckError:
    for row in keyword.rows():
        for i, entry in enumerate(keyword.texts[row.i].rstrip(", \t").split(",")):
            if parse_integer(entry.strip()) is None:
                return row.error(f"entry {i + 1} {no_integer(entry.strip())}", "give the ids of element and nodes")
    raise AssertionError("all entries are integers")


def _other_cells(keyword: Keyword, type_: str, table: IdTable) -> Cells:
    """Beams, point masses, and elements that are only counted: nodes that are not there do not matter yet."""
    lines: list[int] = []
    tokens: list[list[str]] = []
    for row in keyword.rows():
        previous = keyword.texts[row.i - 1] if row.i else ""
        if tokens and previous[-1:] == "," and previous.count(",") > 7:
            tokens[-1] += row.entries
            continue
        lines.append(row.i)
        tokens.append(row.entries)
        if row.integer(0, "the element id") < 1:
            raise row.error(f"the element id {row.entries[0]} is not positive")
    ids = np.array([int(entries[0]) for entries in tokens], dtype=np.int64)
    own = [[entry for entry in entries[1:] if entry] for entries in tokens]
    first = np.cumsum([0, *map(len, own)])
    flat = [entry for entries in own for entry in entries]
    numbers = [parse_integer(entry) for entry in flat]
    rows, missing = table.rows(np.array([number or 0 for number in numbers], dtype=np.int64))
    words = {i: entry for i, (entry, number) in enumerate(zip(flat, numbers, strict=True)) if number is None}
    return Cells(keyword, type_, None, ids, np.where(missing, -1, rows), first, np.array(lines), words)


def kind_index(kind: ElementKind | None) -> int:
    """Position in ELEMENTS; −1 for elements that are no solids."""
    return ELEMENTS.index(kind) if kind else -1
