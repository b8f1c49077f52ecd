"""Nodes and solids of a file of results of CalculiX (.frd)."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np

from strainsight.decks.faults import IdTable, check_elements, check_nodes
from strainsight.decks.results.frd import DAMAGE, NODES_OF, NodeTable, no_number, node_table, whole
from strainsight.decks.text import opened
from strainsight.errors import DeckError
from strainsight.mesh.kinds import ELEMENTS
from strainsight.mesh.kinds.kind import in_order
from strainsight.mesh.model import CellBlock, IntArray, Mesh, Region

SOLIDS = {1: "hex8", 2: "wedge6", 3: "tet4", 4: "hex20", 5: "wedge15", 6: "tet10"}
"""Kind of an element in the file → ours, the nodes in the order of Nastran: uprights before the mid-sides of the top."""


def read_frd_mesh(path: Path, *, required: bool = True) -> Mesh:
    """The mesh of an .frd, in its own units: a region a number of material, with its name; no materials, supports or ties.

    Elements that are no solids are left out, with a note. required: there have to be solids. Raises DeckError for a file that is
    cut off, damaged or has no nodes, and for what makes no mesh.
    """
    try:
        return _mesh(path, required)
    except DAMAGE:
        raise no_number(str(path)) from None


def _mesh(path: Path, required: bool) -> Mesh:
    names: dict[int, str] = {}
    nodes: NodeTable | None = None
    elements: dict[int, tuple[list[tuple[int, int]], list[IntArray]]] = {}
    with opened(path) as file:
        while (line := file.readline()) and line[:6] not in (b"  100C", b" 9999"):
            if line[:9] == b"    1UMAT" and line[9:14].strip().isdigit():
                names[int(line[9:14])] = line[14:].decode("latin-1").strip()
            elif line[:6] == b"    2C":
                nodes = node_table(file, line, str(path))
            elif line[:6] == b"    3C":
                elements = _elements(file, line, str(path))
    if nodes is None:
        raise DeckError("the file holds no nodes", where=str(path), remedy="give the deck as mesh.file")
    check_nodes(nodes.ids, nodes.position, lambda *_: str(path))
    table, blocks, others = IdTable(nodes.ids), [], 0
    for form, (heads, rows) in sorted(elements.items()):
        if form not in SOLIDS:
            others += len(rows)
            continue
        kind = next(own for own in ELEMENTS if own.name == SOLIDS[form])
        index, missing = table.rows(np.array(rows))
        if missing.any():
            raise DeckError(
                f"element {heads[int(np.argmax(missing.any(axis=1)))][0]} has a node that the file lacks",
                where=str(path),
                remedy="write the results again",
            )
        ids, region = np.array(heads, dtype=np.int64).T
        blocks.append(CellBlock(kind.name, ids.copy(), in_order(index, kind.nastran_order), region.copy()))
    if not blocks and required:
        raise DeckError("the file holds no solid elements", where=str(path), remedy="give the deck as mesh.file")
    check_elements(blocks, lambda *_: str(path))
    regions = sorted({int(number) for block in blocks for number in np.unique(block.region)})
    notes = ["coordinates of a text file of results have six digits"] if nodes.text else []
    if others:
        notes.append(f"{others} elements that are no solids are left out")
    return Mesh(
        node_ids=nodes.ids,
        position=nodes.position,
        blocks=tuple(blocks),
        regions={number: Region(number, names.get(number) or f"material {number}", 0) for number in regions},
        materials={},
        fixed=np.zeros((0, 2), dtype=np.int64),
        notes=tuple(notes),
        source=str(path),
    )


def _elements(file: BinaryIO, line: bytes, where: str) -> dict[int, tuple[list[tuple[int, int]], list[IntArray]]]:
    """Kind → ids and materials of its elements, and their nodes (ids)."""
    found: dict[int, tuple[list[tuple[int, int]], list[IntArray]]] = {}
    count, format = int(line[24:36]), int(line[73:75])
    for _ in range(count):
        if format > 1:
            number, kind, _, material = np.frombuffer(whole(file, 16, where), "<i4").tolist()
            nodes = np.frombuffer(whole(file, 4 * NODES_OF[kind], where), "<i4").astype(np.int64)
        else:
            wide = 10 if format == 1 else 5
            head = file.readline()
            number = int(head[3 : 3 + wide])
            kind, _, material = (int(head[at : at + 5]) for at in range(3 + wide, 18 + wide, 5))
            listed: list[bytes] = []
            while len(listed) < NODES_OF[kind]:
                row = file.readline().rstrip()
                if row[:3] != b" -2":
                    raise no_number(where)
                listed += [row[at : at + wide] for at in range(3, len(row), wide)]
            nodes = np.array([int(own) for own in listed], dtype=np.int64)
        heads, rows = found.setdefault(kind, ([], []))
        heads.append((number, material))
        rows.append(nodes)
    return found
