"""CalculiX result files (.frd), text and binary: the mesh and the result blocks.

Source: cgx manual, "Result Format": lines `1P…` are parameters of a step, `2C` nodes, `3C` elements, `100C` a result
block, whose last number is the format of its numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np

from strainsight.decks.faults import check_elements, check_nodes, plural
from strainsight.decks.text import error_at, open_file
from strainsight.errors import DeckError
from strainsight.mesh.kinds import ELEMENTS
from strainsight.mesh.kinds.kind import in_order
from strainsight.mesh.model import CellBlock, IdTable, IntArray, Mesh, Region

ID_WIDTH = {0: 5, 1: 10}
"""Format of a block → columns of a node id, text in short and long form."""
ITEM: dict[int, np.dtype] = {2: np.dtype("<f4"), 3: np.dtype("<f8")}
"""Format of a binary block → type of its numbers; each row begins with its node in four bytes."""
NUMBER, NUMBERS_A_LINE = 12, 6
STATIC, FREQUENCY = 0, 2
DAMAGE = (ValueError, LookupError, ArithmeticError)
"""Errors from parsing damaged bytes as numbers."""
_REAL = re.compile(rb" *-?(?:\d\.\d+E[+-]\d+|[Nn]a[Nn]|[Ii]nf)")


@dataclass(frozen=True)
class Block:
    """Header of a block: value (time, or frequency [Hz]), rows, kind of analysis (0 static, 2 frequency), format,
    name and components of a row; parameters: the lines `1P…` before it, first word → the rest."""

    value: float
    rows: int
    analysis: int
    format: int
    name: bytes
    components: tuple[bytes, ...]
    parameters: dict[bytes, list[bytes]] = field(default_factory=dict)


def blocks(file: BinaryIO, path: Path, nodes: list[NodeTable]) -> Iterator[tuple[Block, str]]:
    """Headers of the result blocks; the caller reads or skips the rows of a block before it requests the next. Node
    tables are appended to `nodes`."""
    parameters: dict[bytes, list[bytes]] = {}
    while line := file.readline():
        key = line[:6]
        if key == b"    1P":
            words = line[6:].split()
            if words[0] == b"STEP":
                parameters = {}
            parameters[words[0]] = words[1:]
        elif key == b"    2C":
            nodes.append(node_table(file, line, str(path)))
        elif key == b"    3C":
            _skip_elements(file, line, str(path))
        elif key == b"  100C":
            yield _header(file, line, parameters), str(path)
        elif line[:5] == b" 9999":
            return
    raise error_at(path, "the last line, 9999, is missing: the file may be truncated", "export the results again")


def _header(file: BinaryIO, line: bytes, parameters: dict[bytes, list[bytes]]) -> Block:
    """Parse `100C` (set, value, rows, text, analysis, step, its name, format), ` -4` (name, count), and one ` -5`
    line a component."""
    value, rows, analysis, format = float(line[12:24]), int(line[24:36]), int(line[56:58]), int(line[73:75])
    entity = file.readline()
    components = []
    for _ in range(int(entity[13:18])):
        definition = file.readline()
        if definition[33:38].strip() in (b"", b"0"):  # else cgx computes it, and the file has no number for it
            components.append(definition[5:13].strip())
    if rows < 0 or entity[:3] != b" -4" or format not in (*ID_WIDTH, *ITEM) or not parameters[b"STEP"][2:]:
        raise ValueError
    return Block(value, rows, analysis, format, entity[5:13].strip(), tuple(components), dict(parameters))


def table(file: BinaryIO, block: Block, where: str) -> tuple[bytes, np.ndarray]:
    """Node ids as bytes, and the numbers (rows, k)."""
    k = len(block.components)
    if block.format in ITEM:
        item = np.dtype([("node", "<i4"), ("value", ITEM[block.format], (k,))])
        table_rows = np.frombuffer(read_exactly(file, block.rows * item.itemsize, where), item)
        return table_rows["node"].tobytes(), table_rows["value"].astype(float)
    if k > NUMBERS_A_LINE:
        raise error_at(
            where,
            f"a result block has {k} components per node, but at most {NUMBERS_A_LINE} are supported",
            "export the results again, with fewer components in this block",
        )
    width = ID_WIDTH[block.format]
    start = file.tell()
    length = len(file.readline())
    if length <= 3 + width + NUMBER * k:
        raise unreadable_line(where)
    file.seek(start)
    text = np.frombuffer(read_exactly(file, block.rows * length, where), np.uint8).reshape(block.rows, length)
    if (text[:, :3] == np.frombuffer(b" -1", np.uint8)).all() and (text[:, -1] == ord("\n")).all():
        ids, last = text[:, 3 : 3 + width].tobytes(), 3 + width + NUMBER * k
        values = np.ascontiguousarray(text[:, 3 + width : last]).view(f"S{NUMBER}").astype(float)
    else:  # a number as -1.00000E-100 makes its line longer
        file.seek(start)
        lines = [file.readline() for _ in range(block.rows)]
        ids = b"".join(line[3 : 3 + width] for line in lines)
        rows = [_REAL.findall(line[3 + width :]) for line in lines]
        if any(line[:3] != b" -1" for line in lines) or any(len(row) != k for row in rows):
            raise unreadable_line(where)
        values = np.array(rows, dtype="S16").astype(float)
    if file.readline()[:3] != b" -3":
        raise error_at(
            where,
            f"the result block of {plural(block.rows, 'node')} does not end with the line -3",
            "export the results again",
        )
    return ids, values


def node_ids(raw: bytes, format: int) -> np.ndarray:
    if format in ITEM:
        return np.frombuffer(raw, "<i4").astype(np.int64)
    return np.frombuffer(raw, f"S{ID_WIDTH[format]}").astype(np.int64)


def skip_rows(file: BinaryIO, block: Block, where: str) -> None:
    k = len(block.components)
    if block.format in ITEM:
        read_exactly(file, block.rows * (4 + ITEM[block.format].itemsize * k), where)
    else:
        while (line := file.readline()) and line[:3] != b" -3":
            pass


@dataclass(frozen=True)
class NodeTable:
    """Nodes of a file: ids (n,), position (n, 3) [length of the file]; text: written with six digits."""

    ids: np.ndarray
    position: np.ndarray
    text: bool


def node_table(file: BinaryIO, line: bytes, where: str) -> NodeTable:
    """Read the block `2C` whose first line is `line`."""
    count, format = int(line[24:36]), int(line[73:75])
    raw, position = table(file, Block(0.0, count, STATIC, format, b"", (b"X", b"Y", b"Z")), where)
    return NodeTable(node_ids(raw, format), position, format in ID_WIDTH)


def _skip_elements(file: BinaryIO, line: bytes, where: str) -> None:
    """Skip the elements; the first line `line` states their number and format."""
    count, format = int(line[24:36]), int(line[73:75])
    if format in ITEM:
        for _ in range(count):
            read_exactly(file, 4 * NODES_OF[int(np.frombuffer(read_exactly(file, 16, where), "<i4")[1])], where)
    else:
        while (line := file.readline()) and line[:3] != b" -3":
            pass


NODES_OF = {1: 8, 2: 6, 3: 4, 4: 20, 5: 15, 6: 10, 7: 3, 8: 6, 9: 4, 10: 8, 11: 2, 12: 3}
"""Element type in the file → number of nodes."""


def read_exactly(file: BinaryIO, size: int, where: str) -> bytes:
    """Read the next bytes of a file; DeckError if it ends before."""
    content = file.read(size)
    if len(content) < size:
        raise error_at(where, "the file ends inside a block: it is truncated", "export the results again")
    return content


def unreadable_line(where: str) -> DeckError:
    """Error for a damaged file."""
    return error_at(where, "a line of a result block cannot be read", "export the results again")


SOLIDS = {1: "hex8", 2: "wedge6", 3: "tet4", 4: "hex20", 5: "wedge15", 6: "tet10"}
"""Element type in the file → kind; the nodes are in the order of Nastran, vertical edges before the mid-side nodes of the top."""


def read_frd_mesh(path: Path, *, required: bool = True) -> Mesh:
    """Read the mesh of an .frd in its own units: one region a material number; no materials, supports or ties.

    Elements that are not solids are left out, with a note. required: require solid elements. Raises DeckError for a
    file that is truncated, damaged or has no nodes, and for an invalid mesh."""
    try:
        return _mesh(path, required)
    except DAMAGE:
        raise unreadable_line(str(path)) from None


def _mesh(path: Path, required: bool) -> Mesh:
    names: dict[int, str] = {}
    nodes: NodeTable | None = None
    elements: dict[int, tuple[list[tuple[int, int]], list[IntArray]]] = {}
    with open_file(path) as file:
        while (line := file.readline()) and line[:6] not in (b"  100C", b" 9999"):
            if line[:9] == b"    1UMAT" and line[9:14].strip().isdigit():
                names[int(line[9:14])] = line[14:].decode("latin-1").strip()
            elif line[:6] == b"    2C":
                nodes = node_table(file, line, str(path))
            elif line[:6] == b"    3C":
                elements = _elements(file, line, str(path))
    if nodes is None:
        raise error_at(path, "the file contains no nodes", "set mesh.file to the input deck (.inp)")
    check_nodes(nodes.ids, nodes.position, lambda *_: str(path))
    table, blocks, others = IdTable(nodes.ids), [], 0
    for form, (heads, rows) in sorted(elements.items()):
        if form not in SOLIDS:
            others += len(rows)
            continue
        kind = next(element_kind for element_kind in ELEMENTS if element_kind.name == SOLIDS[form])
        index, missing = table.rows(np.array(rows))
        if missing.any():
            raise error_at(
                path,
                f"element {heads[int(np.argmax(missing.any(axis=1)))][0]} has a node that is not in the file",
                "export the results again",
            )
        ids, region = np.array(heads, dtype=np.int64).T
        blocks.append(CellBlock(kind.name, ids.copy(), in_order(index, kind.nastran_order), region.copy()))
    if not blocks and required:
        raise error_at(path, "the file contains no solid elements", "set mesh.file to the input deck (.inp)")
    check_elements(blocks, lambda *_: str(path))
    regions = sorted({int(number) for block in blocks for number in np.unique(block.region)})
    notes = (
        [
            "coordinates of a text result file (.frd) have only six digits; those of the input deck (.inp) are more precise"
        ]
        if nodes.text
        else []
    )
    if others:
        notes.append(f"{plural(others, 'element')} left out, because only solids are imported")
    return Mesh(
        node_ids=nodes.ids,
        position=nodes.position,
        blocks=tuple(blocks),
        regions={number: Region(number, names.get(number) or f"material {number}", 0) for number in regions},
        notes=tuple(notes),
        source=str(path),
    )


def _elements(file: BinaryIO, line: bytes, where: str) -> dict[int, tuple[list[tuple[int, int]], list[IntArray]]]:
    """Element type → ids and materials of its elements, and their nodes (ids)."""
    elements: dict[int, tuple[list[tuple[int, int]], list[IntArray]]] = {}
    count, format = int(line[24:36]), int(line[73:75])
    for _ in range(count):
        if format > 1:
            number, kind, _, material = np.frombuffer(read_exactly(file, 16, where), "<i4").tolist()
            nodes = np.frombuffer(read_exactly(file, 4 * NODES_OF[kind], where), "<i4").astype(np.int64)
        else:
            wide = 10 if format == 1 else 5
            head = file.readline()
            number = int(head[3 : 3 + wide])
            kind, _, material = (int(head[at : at + 5]) for at in range(3 + wide, 18 + wide, 5))
            listed: list[bytes] = []
            while len(listed) < NODES_OF[kind]:
                row = file.readline().rstrip()
                if row[:3] != b" -2":
                    raise unreadable_line(where)
                listed += [row[at : at + wide] for at in range(3, len(row), wide)]
            nodes = np.array([int(entry) for entry in listed], dtype=np.int64)
        heads, rows = elements.setdefault(kind, ([], []))
        heads.append((number, material))
        rows.append(nodes)
    return elements
