"""Nodes and elements of one part, or of a flat deck, as arrays in its own ids and axes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from strainsight.decks.abaqus.cells import Cells, read_cells
from strainsight.decks.abaqus.text import Keyword, Row, integers
from strainsight.decks.faults import IdTable, repeated
from strainsight.errors import DeckError
from strainsight.mesh.model import FloatArray, IntArray

GENERATORS = {"NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY"}


@dataclass(frozen=True)
class Part:
    """keywords as they stand; node ids (n,), position (n, 3) in the axes of the part, where each node stands; elements.

    rows: id(keyword) → rows of the nodes or elements that this *NODE or *ELEMENT defines.
    """

    keywords: tuple[Keyword, ...]
    nodes: IdTable
    position: FloatArray
    node_where: tuple[tuple[str, int], ...]
    cells: tuple[Cells, ...]
    elements: IdTable
    rows: dict[int, IntArray]

    @cached_property
    def sets(self) -> dict[tuple[str, str], list[Keyword]]:
        """("NODE" or "ELEMENT", NAME of a set) → the keywords that define it."""
        found: dict[tuple[str, str], list[Keyword]] = {}
        for keyword in self.keywords:
            for kind, parameter in (("NODE", "NSET"), ("ELEMENT", "ELSET")):
                if keyword.name in (kind, parameter) and keyword.parameters.get(parameter):
                    found.setdefault((kind, keyword.parameters[parameter].upper()), []).append(keyword)
        return found


def read_part(keywords: tuple[Keyword, ...]) -> Part:
    """The nodes and elements that the keywords of a part define.

    Raises DeckError for nodes and elements that stand twice, have a wrong number of nodes or a node that is missing, for
    solids that are not supported and for generated meshes.
    """
    ids, position, where, rows = _nodes(keywords)
    table = IdTable(ids)
    cells = tuple(read_cells(keyword, table) for keyword in keywords if keyword.name == "ELEMENT")
    elements = np.concatenate([c.ids for c in cells]) if cells else np.zeros(0, dtype=np.int64)
    if twice := repeated(elements):
        at = [(c, int(i)) for c in cells for i in c.line]
        (a, i), (b, j) = at[twice[0]], at[twice[1]]
        raise DeckError(
            f"element id {elements[twice[1]]} stands twice (first at {a.keyword.where_data(i)})",
            where=b.keyword.where_data(j),
            remedy="give every element its own id",
        )
    start = 0
    for c in cells:
        rows[id(c.keyword)] = np.arange(start, start + len(c.ids))
        start += len(c.ids)
    return Part(keywords, table, position, where, cells, IdTable(elements), rows)


def _nodes(
    keywords: tuple[Keyword, ...],
) -> tuple[IntArray, FloatArray, tuple[tuple[str, int], ...], dict[int, IntArray]]:
    ids, positions = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))]
    where: list[tuple[str, int]] = []
    rows: dict[int, IntArray] = {}
    axes, origin, start = np.eye(3), np.zeros(3), 0
    for keyword in keywords:
        if keyword.name in GENERATORS:
            raise keyword.error("generated meshes are not supported", "write the nodes and elements out")
        if keyword.name == "SYSTEM":
            origin, axes = _system(keyword)
        if keyword.name != "NODE":
            continue
        own, local = _node_lines(keyword)
        system = keyword.parameters.get("SYSTEM", "R").upper()
        if system == "C":
            r, angle = local[:, 0].copy(), np.radians(local[:, 1])
            local[:, 0], local[:, 1] = r * np.cos(angle), r * np.sin(angle)
        elif system != "R":
            raise keyword.error(f"SYSTEM={system} is not supported", "write the nodes in rectangular coordinates")
        ids.append(own)
        positions.append(origin + local @ axes.T)
        where += zip(keyword.files, keyword.numbers, strict=True)
        rows[id(keyword)] = np.arange(start, start + len(own))
        start += len(own)
    all_ids = np.concatenate(ids)
    if twice := repeated(all_ids):
        (a, i), (b, j) = where[twice[0]], where[twice[1]]
        raise DeckError(
            f"node id {all_ids[twice[1]]} stands twice (first at {a}:{i})",
            where=f"{b}:{j}",
            remedy="give every node its own id",
        )
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
    found, position = [], []
    for row in keyword.rows():
        found.append(row.integer(0, "the node id"))
        if found[-1] < 1:
            raise row.error(f"the node id {found[-1]} is not positive")
        position.append([row.real(i, "a coordinate", 0.0) for i in (1, 2, 3)])
    return np.array(found, dtype=np.int64), np.array(position)


def _system(keyword: Keyword) -> tuple[FloatArray, FloatArray]:
    """*SYSTEM: origin a, and axes: x towards b, c in the xy plane on the side of y; without c, z stays Z."""
    rows = keyword.rows(needed=False)
    if not rows:
        return np.zeros(3), np.eye(3)
    origin, b = rows[0].reals(6, "a coordinate").reshape(2, 3)
    if not any(rows[0].entries[3:]):
        return origin, np.eye(3)
    x = b - origin
    if len(rows) > 1:
        z = normal(x, rows[1].reals(3, "a coordinate") - origin)
    elif abs(x[2]) > 1e-9 * np.linalg.norm(x):
        raise rows[0].error("point b must lie in the plane of a, or a point c be given", "add the line of point c")
    else:
        z = np.array([0.0, 0.0, 1.0])
    return origin, orthonormal(x, z, rows[0])


def orthonormal(x: FloatArray, z: FloatArray, row: Row) -> FloatArray:
    """Axes x, z × x, z of length one as columns (3, 3); DeckError where one of them is zero."""
    lengths = np.linalg.norm(x), np.linalg.norm(z)
    if not min(lengths) > 0:
        raise row.error("the points lie on one line and define no axes", "give points that span a plane")
    x, z = x / lengths[0], z / lengths[1]
    return np.column_stack([x, np.cross(z, x), z])


def normal(a: FloatArray, b: FloatArray) -> FloatArray:
    """a × b, exactly zero where they are parallel to rounding."""
    product = np.cross(a, b)
    return product if np.linalg.norm(product) > 1e-9 * np.linalg.norm(a) * np.linalg.norm(b) else np.zeros(3)
