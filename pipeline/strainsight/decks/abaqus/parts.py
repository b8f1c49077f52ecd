"""Nodes and elements (*NODE, *ELEMENT) of one part or flat deck, with its ids and axes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from strainsight.decks.abaqus.text import Keyword, Row, integers, split
from strainsight.decks.faults import check_once
from strainsight.decks.text import describe_non_integer, parse_integer
from strainsight.errors import DeckError
from strainsight.mesh.kinds import ELEMENTS, FAMILIES
from strainsight.mesh.kinds.kind import ElementKind
from strainsight.mesh.model import FloatArray, IdTable, IntArray
from strainsight.mesh.thin import concatenate

SOLIDS = {type_: (kind, how) for kind in ELEMENTS for type_, how in kind.abaqus.items()}
"""Type → kind of element, and note on its import. Nodes have the order of VTK in all types."""
USUAL = ", ".join(next(iter(kind.abaqus)) for kind in ELEMENTS if kind.abaqus)
REDUCED = "the element has full integration, without hourglass control"
SHELLS = {
    **dict.fromkeys(("S3", "S3R"), ("tri3", "")),
    "STRI3": ("tri3", "the element has transverse shear deformation"),
    "S4": ("quad4", ""),
    **dict.fromkeys(("S4R", "S4R5"), ("quad4", REDUCED)),
    **dict.fromkeys(("STRI65", "S6"), ("tri6", "")),
    "S8": ("quad8", ""),
    **dict.fromkeys(("S8R", "S8R5"), ("quad8", REDUCED)),
}
BEAMS = {
    **dict.fromkeys(("B31", "B31H", "B33"), ("beam", "")),
    **dict.fromkeys(("B32", "B32H", "B32R"), ("beam3", "")),
    "T3D2": ("rod", ""),
}
THIN = {**SHELLS, **BEAMS}
"""Type → kind of shell or beam, and note on its import."""
NODES = {"tri3": 3, "quad4": 4, "tri6": 6, "quad8": 8}


@dataclass(frozen=True)
class Cells:
    """Elements of one *ELEMENT keyword: type in capitals; kind, None if it is not a solid; ids (m,); nodes in a flat
    (c,) array of rows (−1 if missing), first (m + 1,) start of the nodes of each element; data line (m,).

    words: position in nodes → entry that is not a number (node of an instance); cut: each line has more nodes than
    an element and ends in a comma, as the first lines of quadratic elements; the first nodes are used, as in CalculiX."""

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
    """The elements of an *ELEMENT keyword, on one or more lines each, with the rows of their nodes in `table`.

    A beam may have one extra node, which defines its first axis. Raises DeckError for a wrong number of nodes, a
    missing node and unsupported solids."""
    type_ = keyword.needs("TYPE").upper()
    if type_ not in SOLIDS and type_.startswith("C3D"):
        raise keyword.error(f"{type_} solids are not supported", f"use {FAMILIES} ({USUAL})")
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
        raise _wrong_count_error(keyword, counts, width, type_)
    if (values := integers(tokens)) is None:
        raise _invalid_id_error(keyword)
    values = values.reshape(-1, width)
    if values[:, 0].min() < 1:
        i = int(np.argmin(values[:, 0]))
        raise _at(keyword, int(first[i]), f"element id {values[i, 0]} is not positive", "use ids of at least 1")
    rows, missing = table.rows(values[:, 1:])
    if missing.any():
        i, j = np.argwhere(missing)[0]
        number = values[i, j + 1]
        raise _at(
            keyword,
            int(first[i]),
            f"{type_} {values[i, 0]}: node {number} is not in the deck",
            f"add node {number}, or correct the node id of the element",
        )
    begin = np.arange(len(values) + 1) * (width - 1)
    return Cells(keyword, type_, kind, values[:, 0].copy(), rows.ravel(), begin, first, {}, cut)


def _at(keyword: Keyword, i: int, what: str, remedy: str = "correct the line") -> DeckError:
    return DeckError(what, where=keyword.where_data(i), remedy=remedy)


def _wrong_count_error(keyword: Keyword, counts: IntArray, width: int, type_: str) -> DeckError:
    """Error for the first element whose lines do not contain exactly its id and its nodes."""
    have = start = 0
    for i, count in enumerate(counts.tolist()):
        start = i if have == 0 else start
        continued = i > start and keyword.texts[i - 1][-1] == ","
        have += count
        if have > width or (have < width and i + 1 == len(counts)):
            count_of_element = have if have < width or i == start or continued else have - count
            element = split(keyword.texts[start])[0]
            return _at(
                keyword,
                start,
                f"{type_} {element} has {count_of_element - 1} nodes, but a {type_} needs {width - 1}",
                "complete the element; the deck may be truncated here",
            )
        have %= width
    raise AssertionError("internal error: the element with a wrong number of nodes was not found")


def _invalid_id_error(keyword: Keyword) -> DeckError:
    for row in keyword.rows():
        tokens = keyword.texts[row.i].rstrip(", \t").split(",")
        for number, token in enumerate(map(str.strip, tokens), start=1):
            if parse_integer(token) is None:
                fault = describe_non_integer(f"entry {number} of the line", token)
                return row.error(fault, "write element id and node ids as integers")
    raise AssertionError("internal error: the entry that is not an integer was not found")


def _other_cells(keyword: Keyword, type_: str, table: IdTable) -> Cells:
    """Beams, point masses and elements that are only counted; missing nodes are allowed."""
    lines: list[int] = []
    tokens: list[list[str]] = []
    for row in keyword.rows():
        previous = keyword.texts[row.i - 1] if row.i else ""
        if tokens and previous[-1:] == "," and previous.count(",") > 7:
            tokens[-1] += row.tokens
            continue
        lines.append(row.i)
        tokens.append(row.tokens)
        if row.integer(0, "the element id") < 1:
            raise row.error(f"the element id {row.tokens[0]} is not positive", "use ids of at least 1")
    ids = np.array([int(entries[0]) for entries in tokens], dtype=np.int64)
    nodes = [[entry for entry in entries[1:] if entry] for entries in tokens]
    first = np.cumsum([0, *map(len, nodes)])
    flat = [entry for entries in nodes for entry in entries]
    numbers = [parse_integer(entry) for entry in flat]
    rows, missing = table.rows(np.array([number or 0 for number in numbers], dtype=np.int64))
    words = {i: entry for i, (entry, number) in enumerate(zip(flat, numbers, strict=True)) if number is None}
    return Cells(keyword, type_, None, ids, np.where(missing, -1, rows), first, np.array(lines), words)


GENERATORS = {"NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY"}


@dataclass(frozen=True)
class Part:
    """The keywords of a part; node ids (n,), position (n, 3) in the axes of the part, file and line of each node;
    elements likewise.

    rows: id(keyword) → rows of the nodes or elements that this *NODE or *ELEMENT defines."""

    keywords: tuple[Keyword, ...]
    nodes: IdTable
    position: FloatArray
    node_where: tuple[tuple[str, int], ...]
    cells: tuple[Cells, ...]
    elements: IdTable
    element_where: tuple[tuple[str, int], ...]
    rows: dict[int, IntArray]

    @cached_property
    def sets(self) -> dict[tuple[str, str], list[Keyword]]:
        """("NODE" or "ELEMENT", NAME of a set) → the keywords that define it."""
        keywords_by_set: dict[tuple[str, str], list[Keyword]] = {}
        for keyword in self.keywords:
            for kind, parameter in (("NODE", "NSET"), ("ELEMENT", "ELSET")):
                if keyword.name in (kind, parameter) and keyword.parameters.get(parameter):
                    keywords_by_set.setdefault((kind, keyword.parameters[parameter].upper()), []).append(keyword)
        return keywords_by_set


def read_part(keywords: tuple[Keyword, ...]) -> Part:
    """The nodes and elements that the keywords of a part define. Raises DeckError for duplicate ids, a wrong number of nodes,
    missing nodes, unsupported solids and generated meshes."""
    ids, position, where, rows = _nodes(keywords)
    table = IdTable(ids)
    cells = tuple(read_cells(keyword, table) for keyword in keywords if keyword.name == "ELEMENT")
    elements = concatenate(c.ids for c in cells)
    lines = [(c.keyword.files[i], c.keyword.numbers[i]) for c in cells for i in c.line.tolist()]
    check_once(elements, "element", lambda i: "{}:{}".format(*lines[i]))
    start = 0
    for c in cells:
        rows[id(c.keyword)] = np.arange(start, start + len(c.ids))
        start += len(c.ids)
    return Part(keywords, table, position, where, cells, IdTable(elements), tuple(lines), rows)


def _nodes(
    keywords: tuple[Keyword, ...],
) -> tuple[IntArray, FloatArray, tuple[tuple[str, int], ...], dict[int, IntArray]]:
    ids, positions = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))]
    where: list[tuple[str, int]] = []
    rows: dict[int, IntArray] = {}
    axes, origin, start = np.eye(3), np.zeros(3), 0
    for keyword in keywords:
        if keyword.name in GENERATORS:
            raise keyword.error(
                "generated nodes and elements are not supported",
                "export all nodes and elements with *NODE and *ELEMENT",
            )
        if keyword.name == "SYSTEM":
            origin, axes = _system(keyword)
        if keyword.name != "NODE":
            continue
        new_ids, local = _node_lines(keyword)
        system = keyword.word("SYSTEM", "R")
        if system == "C":
            r, angle = local[:, 0].copy(), np.radians(local[:, 1])
            local[:, 0], local[:, 1] = r * np.cos(angle), r * np.sin(angle)
        elif system != "R":
            raise keyword.error(f"SYSTEM={system} is not supported", "export the nodes in rectangular coordinates")
        ids.append(new_ids)
        positions.append(origin + local @ axes.T)
        where += zip(keyword.files, keyword.numbers, strict=True)
        rows[id(keyword)] = np.arange(start, start + len(new_ids))
        start += len(new_ids)
    all_ids = np.concatenate(ids)
    check_once(all_ids, "node", lambda i: "{}:{}".format(*where[i]))
    return all_ids, np.concatenate(positions), tuple(where), rows


def _node_lines(keyword: Keyword) -> tuple[IntArray, FloatArray]:
    """Ids (n,) and coordinates (n, 3) of a *NODE keyword; missing coordinates are zero."""
    if not keyword.texts:
        keyword.rows()
    tokens, counts = keyword.flat()
    if np.all(counts == 4):
        ids = integers(tokens[::4])
        try:
            values = np.array(list(map(float, tokens)))
        except ValueError:
            values = np.full(1, np.nan)
        if ids is not None and ids.min() > 0 and np.isfinite(values).all() and "_" not in "".join(keyword.texts):
            return ids, values.reshape(-1, 4)[:, 1:]
    node_ids, position = [], []
    for row in keyword.rows():
        node_ids.append(row.integer(0, "the node id"))
        if node_ids[-1] < 1:
            raise row.error(f"node id {node_ids[-1]} is not positive", "use ids of at least 1")
        position.append([row.real(i, "a coordinate", 0.0) for i in (1, 2, 3)])
    return np.array(node_ids, dtype=np.int64), np.array(position)


def _system(keyword: Keyword) -> tuple[FloatArray, FloatArray]:
    """*SYSTEM: origin a, and axes with x towards b and c in the xy plane on the side of y; without c, the z axis stays Z."""
    if not (rows := keyword.rows(needed=False)):
        return np.zeros(3), np.eye(3)
    origin, b = rows[0].reals(6, "a coordinate").reshape(2, 3)
    if not any(rows[0].tokens[3:]):
        return origin, np.eye(3)
    x = b - origin
    if len(rows) > 1:
        z = normal(x, rows[1].reals(3, "a coordinate") - origin)
    elif abs(x[2]) > 1e-9 * np.linalg.norm(x):
        raise rows[0].error(
            "points a and b of the coordinate system have different z coordinates, so point c is required",
            "add a second line with the coordinates of point c",
        )
    else:
        z = np.array([0.0, 0.0, 1.0])
    return origin, orthonormal(x, z, rows[0])


def orthonormal(x: FloatArray, z: FloatArray, row: Row) -> FloatArray:
    """Axes x, z × x, z of length one as columns (3, 3); DeckError if one of them is zero."""
    lengths = np.linalg.norm(x), np.linalg.norm(z)
    if not min(lengths) > 0:
        raise row.error("the points that define the axes are on one line", "specify points that are not on one line")
    x, z = x / lengths[0], z / lengths[1]
    return np.column_stack([x, np.cross(z, x), z])


def normal(a: FloatArray, b: FloatArray) -> FloatArray:
    """a × b, exactly zero if the vectors are parallel to rounding."""
    product = np.cross(a, b)
    return product if np.linalg.norm(product) > 1e-9 * np.linalg.norm(a) * np.linalg.norm(b) else np.zeros(3)
