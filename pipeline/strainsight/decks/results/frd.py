"""Results of CalculiX (.frd): displacements of static and frequency steps, text and binary, block by block.

Source: cgx manual, "Result Format": lines `1P…` parameters of a step, `2C` nodes, `3C` elements, `100C` a block of results, whose
last number says how its numbers are written.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import BinaryIO

import numpy as np

from strainsight.decks.faults import IdTable
from strainsight.decks.results.response import Response
from strainsight.decks.text import opened
from strainsight.errors import DeckError

ID_WIDTH = {0: 5, 1: 10}
"""Columns of the id of a node by the format of a block: text in short and in long form."""
ITEM: dict[int, np.dtype] = {2: np.dtype("<f4"), 3: np.dtype("<f8")}
"""Numbers of a binary block by its format; each row has its node as four bytes before them."""
ROUNDING = {0: 5e-6, 1: 5e-6, 2: 6e-8, 3: 2e-16}
"""Largest relative error of a number by the format of its block: text has six digits."""
NUMBER, NUMBERS_A_LINE = 12, 6
STATIC, FREQUENCY = 0, 2
DAMAGE = (ValueError, LookupError, ArithmeticError)
"""What damaged bytes raise where they are taken for numbers."""
_REAL = re.compile(rb" *-?(?:\d\.\d+E[+-]\d+|[Nn]a[Nn]|[Ii]nf)")


@dataclass(frozen=True)
class _Block:
    """Header of a block: value (time, or frequency [Hz]), rows, kind of analysis (0 static, 2 frequency), format, entity and
    names of the numbers of a row; parameters: the lines `1P…` before it, first word → the rest."""

    value: float
    rows: int
    analysis: int
    format: int
    name: bytes
    components: tuple[bytes, ...]
    parameters: dict[bytes, list[bytes]] = field(default_factory=dict)


def frd_responses(path: Path) -> Iterator[Response]:
    """Every block DISP of the static and frequency steps of the file, in its order.

    Raises DeckError for a file that is cut off or damaged, for numbers that are not finite, and for other kinds of steps that
    have displacements (dynamic, buckling, complex frequencies).
    """
    try:
        yield from _responses(path)
    except DAMAGE:
        raise no_number(str(path)) from None


def _responses(path: Path) -> Iterator[Response]:
    nodes: list[NodeTable] = []
    known: tuple[bytes, np.ndarray, np.ndarray | None] = (b"", np.zeros(0, dtype=np.int64), None)
    with opened(path) as file:
        for block, where in _blocks(file, path, nodes):
            if block.name != b"DISP":
                _skip(file, block, where)
                continue
            raw, motion = _table(file, block, where)
            if raw != known[0]:
                ids = _ids(raw, block.format)
                known = raw, ids, _positions(nodes, ids)
            yield replace(_response(block, known[1], motion, where), position=known[2])


def _positions(nodes: list[NodeTable], ids: np.ndarray) -> np.ndarray | None:
    """Positions (n, 3) of these nodes; NaN of a node, and None where the file has none."""
    if not nodes:
        return None
    table = IdTable(np.concatenate([own.ids for own in nodes]))
    rows, missing = table.rows(ids)
    return np.where(missing[:, None], np.nan, np.concatenate([own.position for own in nodes])[rows])


def _response(block: _Block, ids: np.ndarray, motion: np.ndarray, where: str) -> Response:
    step, rounding = int(block.parameters[b"STEP"][2]), ROUNDING[block.format]
    if motion.shape[1] < 3 or not np.isfinite(motion).all():
        raise DeckError(
            f"the displacements of step {step} are no three finite numbers at every node",
            where=where,
            remedy="look at the output of the run, and write the results again (*NODE FILE, U)",
        )
    if block.analysis == STATIC:
        increment = int(block.parameters[b"STEP"][1])
        return Response("static", step, increment, ids, motion[:, :3], rounding=rounding, where=f"{where}, step {step}")
    if block.analysis != FREQUENCY or b"MODE" not in block.parameters:
        raise DeckError(
            f"step {step} is neither static nor a frequency step",
            where=where,
            remedy="write results of *STATIC and *FREQUENCY steps alone",
        )
    mode = int(block.parameters[b"MODE"][0])
    mass = block.parameters.get(b"GM")
    frequency, stiffness = block.value, block.parameters.get(b"GK")
    if stiffness is not None and float(stiffness[0]) < 0:
        frequency = -abs(frequency)
    return Response(
        "mode",
        step,
        mode,
        ids,
        motion[:, :3],
        frequency,
        modal_mass=float(mass[0]) if mass else None,
        rounding=rounding,
        where=f"{where}, step {step}, mode {mode}",
    )


def _blocks(file: BinaryIO, path: Path, nodes: list[NodeTable]) -> Iterator[tuple[_Block, str]]:
    """Headers of the blocks of results; the caller reads or skips the rows behind each before it asks for the next. Tables of
    nodes before them are put into `nodes`."""
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
    raise DeckError(
        "the file ends without its last line, 9999: it may be cut off", where=str(path), remedy="write it again"
    )


def _header(file: BinaryIO, line: bytes, parameters: dict[bytes, list[bytes]]) -> _Block:
    """`100C` (set, value, rows, text, analysis, step, its name, format), ` -4` name and count, ` -5` a line a component."""
    value, rows, analysis, format = float(line[12:24]), int(line[24:36]), int(line[56:58]), int(line[73:75])
    entity = file.readline()
    components = []
    for _ in range(int(entity[13:18])):
        own = file.readline()
        if own[33:38].strip() in (b"", b"0"):  # else cgx computes it, and the file has no number of it
            components.append(own[5:13].strip())
    if rows < 0 or entity[:3] != b" -4" or format not in (*ID_WIDTH, *ITEM) or not parameters[b"STEP"][2:]:
        raise ValueError
    return _Block(value, rows, analysis, format, entity[5:13].strip(), tuple(components), dict(parameters))


def _table(file: BinaryIO, block: _Block, where: str) -> tuple[bytes, np.ndarray]:
    """Nodes as the file writes them, and the numbers (rows, k) beside them."""
    k = len(block.components)
    if block.format in ITEM:
        item = np.dtype([("node", "<i4"), ("value", ITEM[block.format], (k,))])
        found = np.frombuffer(whole(file, block.rows * item.itemsize, where), item)
        return found["node"].tobytes(), found["value"].astype(float)
    if k > NUMBERS_A_LINE:
        raise DeckError(
            f"{k} numbers a node in a block of displacements", where=where, remedy="write the results again"
        )
    width = ID_WIDTH[block.format]
    start = file.tell()
    length = len(file.readline())
    if length <= 3 + width + NUMBER * k:
        raise no_number(where)
    file.seek(start)
    text = np.frombuffer(whole(file, block.rows * length, where), np.uint8).reshape(block.rows, length)
    if (text[:, :3] == np.frombuffer(b" -1", np.uint8)).all() and (text[:, -1] == ord("\n")).all():
        ids, last = text[:, 3 : 3 + width].tobytes(), 3 + width + NUMBER * k
        columns = np.ascontiguousarray(text[:, 3 + width : last]).view(f"S{NUMBER}")
        values = columns.astype(float)
    else:  # a number as -1.00000E-100 makes its line longer
        file.seek(start)
        lines = [file.readline() for _ in range(block.rows)]
        ids = b"".join(line[3 : 3 + width] for line in lines)
        rows = [_REAL.findall(line[3 + width :]) for line in lines]
        if any(line[:3] != b" -1" for line in lines) or any(len(row) != k for row in rows):
            raise no_number(where)
        values = np.array(rows, dtype="S16").astype(float)
    if file.readline()[:3] != b" -3":
        raise DeckError(
            f"a block of {block.rows} nodes does not end after them", where=where, remedy="write the results again"
        )
    return ids, values


def _ids(raw: bytes, format: int) -> np.ndarray:
    if format in ITEM:
        return np.frombuffer(raw, "<i4").astype(np.int64)
    return np.frombuffer(raw, f"S{ID_WIDTH[format]}").astype(np.int64)


def _skip(file: BinaryIO, block: _Block, where: str) -> None:
    k = len(block.components)
    if block.format in ITEM:
        whole(file, block.rows * (4 + ITEM[block.format].itemsize * k), where)
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
    """The block `2C` whose first line is `line`."""
    count, format = int(line[24:36]), int(line[73:75])
    raw, position = _table(file, _Block(0.0, count, STATIC, format, b"", (b"X", b"Y", b"Z")), where)
    return NodeTable(_ids(raw, format), position, format in ID_WIDTH)


def _skip_elements(file: BinaryIO, line: bytes, where: str) -> None:
    """Pass over elements, whose first line `line` says how many there are and how they are written."""
    count, format = int(line[24:36]), int(line[73:75])
    if format in ITEM:
        for _ in range(count):
            whole(file, 4 * NODES_OF[int(np.frombuffer(whole(file, 16, where), "<i4")[1])], where)
    else:
        while (line := file.readline()) and line[:3] != b" -3":
            pass


NODES_OF = {1: 8, 2: 6, 3: 4, 4: 20, 5: 15, 6: 10, 7: 3, 8: 6, 9: 4, 10: 8, 11: 2, 12: 3}
"""Kind of an element in the file → how many nodes it has."""


def whole(file: BinaryIO, size: int, where: str) -> bytes:
    """The next bytes of a file; DeckError where it ends before."""
    found = file.read(size)
    if len(found) < size:
        raise DeckError("the file ends within a block: it is cut off", where=where, remedy="write the results again")
    return found


def no_number(where: str) -> DeckError:
    """A damaged file."""
    return DeckError("a block of results has a line that cannot be read", where=where, remedy="write the results again")
