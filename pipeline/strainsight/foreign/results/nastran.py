"""Modes and static displacements of a Nastran OUTPUT2 file (.op2) and punch file (.pch).

OUTPUT2: a chain of Fortran records (length, content, length). One of a single word is a key: n > 0, the next record holds n
words; n < 0, the logical record is complete; 0, the data block is. A data block is its name (two words), its trailer, and then
records with a word in front that says what they are: 0 for a table, 1 and more for a column of a matrix. A table of displacements
is pairs of records: 146 words that say what it is, then the rows: ten times the id of a point and its device, its type, six
components. Source: DMAP Programmer's Guide, data blocks OUG (displacements) and LAMA (eigenvalues).

Punch: lines of 80 columns, of which the last 8 are their number. A block is comments that say what it holds, then two lines a
point: id in ten columns, type in eight, three components in eighteen each; -CONT- in their place and the three rotations.
"""

from __future__ import annotations

import os
import re
import struct
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from strainsight.decks.text import damaged, error_at, opened, parse_integer, parse_real
from strainsight.foreign.results.response import (
    Response,
    integers,
    natural_frequency,
    padded,
    reals,
    result_lines,
    unsupported,
)

_WIDTHS = {struct.pack(order + "i", width): (order, width) for order in "<>" for width in (4, 8)}
"""First four bytes → byte order, and bytes of a word."""
_NAME = 2
"""Words of the name of a data block."""
_AT_ONCE = 1 << 24
"""[bytes]"""


class Record(NamedTuple):
    """A record of a table: name of the table, number from 0 of the record, content, and file with byte."""

    table: str
    number: int
    content: bytes
    where: str


class Op2File:
    """An open file: its records, and how words are to be read in them. width [bytes] of a word."""

    def __init__(self, file: BinaryIO, path: Path):
        """Raises DeckError where it is no binary OUTPUT2 file."""
        self._file, self._path = file, path
        self._length = file.read(4)
        """Of the next record, as it stands there; b"" at the end of the file."""
        if self._length not in _WIDTHS:
            raise error_at(
                path,
                "no binary OUTPUT2 file" if self._length else "the file is empty",
                "have Nastran write it by PARAM,POST,-1, unformatted",
            )
        order, self.width = _WIDTHS[self._length]
        self.integer = np.dtype(f"{order}i{self.width}")
        self.real = np.dtype(f"{order}f{self.width}")
        self._int32 = struct.Struct(order + "i")

    def records(self, wanted: Callable[[str], bool]) -> Iterator[Record]:
        """The records of every table whose name is wanted, one in memory at a time; the rest is passed over.

        Raises DeckError with the byte where the file is damaged, or ends within a data block.
        """
        while self._length:
            name = self._logical(keep=True)
            if name is None:
                continue  # the end of the file, or of one of several that were put one behind the other
            # what has no name of two words in front is the head of the file
            table = self.text(name[0]) if name and len(name[0]) == _NAME * self.width else ""
            keep = bool(table) and wanted(table)
            number, where = -1, self._place()  # the trailer is no record
            while (parts := self._logical(keep)) is not None:
                if keep and number >= 0 and len(parts) > 1 and not any(parts[0]):
                    yield Record(table, number, b"".join(parts[1:]), where)
                number, where = number + 1, self._place()

    def text(self, content: bytes) -> str:
        """Four characters a word, without the blanks around them."""
        words = np.frombuffer(content[: len(content) // self.width * self.width], np.uint8)
        return words.reshape(-1, self.width)[:, :4].tobytes().decode("latin-1").strip(" \0")

    def _logical(self, keep: bool) -> list[bytes] | None:
        """The parts of a logical record, none where they are not to be kept; None at the end of the data block."""
        parts = []
        while (key := self._key()) > 0:
            at = self._place()
            content = self._record(keep)
            if keep and len(content) != key * self.width:
                raise damaged(f"{key} words are announced, and {len(content)} bytes follow", at)
            if keep:
                parts.append(content)
        return parts if key < 0 else None

    def _key(self) -> int:
        at = self._place()
        content = self._record(keep=True, most=self.width)
        if len(content) != self.width:
            raise damaged(f"no key, but a record of {len(content)} bytes", at)
        return int(np.frombuffer(content, self.integer)[0])

    def _record(self, keep: bool, most: int | None = None) -> bytes:
        """The content of the next Fortran record, of at most so many bytes; b"" where it is passed over."""
        at, length = self._place(), self._length
        if len(length) < 4:
            raise damaged("the file ends within a data block", at)
        size = self._int32.unpack(length)[0]
        if size < 0 or (most is not None and size > most):
            raise damaged(f"no record of {size} bytes can be here", at)
        content = []
        left = size
        if not keep:
            self._file.seek(size, os.SEEK_CUR)
        # what a damaged length claims is not set aside before it is there
        while keep and left and (part := self._file.read(min(left, _AT_ONCE))):
            content.append(part)
            left -= len(part)
        rest = self._file.read(8)
        if rest[:4] != length:
            raise damaged(f"a record of {size} bytes begins here, and does not end as it should", at)
        self._length = rest[4:]
        return b"".join(content)

    def _place(self) -> str:
        return f"{self._path}, byte {self._file.tell() - len(self._length)}"


_DISPLACEMENTS = re.compile(r"(B?)O(?:UGV?|PHIG)[12]?(PAT)?")
"""Names of the tables. With B or PAT they are along the basic axes, otherwise along those of each node."""
_EIGENVALUES = "LAMA"
_DISPLACEMENT, _EIGENVECTOR = 1, 7
"""Codes of a table; 10 and 11 are velocities and accelerations."""
_MODE = 2
_STATIC = (1, 7, 10, 11, 12)
"""Codes of an analysis: linear, before buckling, nonlinear (three)."""
_OTHERS = {5: "a frequency response", 6: "a transient response", 8: "a buckling shape", 9: "a complex mode"}
_COMPLEX, _BY_NODE, _RANDOM = 1, 2, 4
"""Bits of a table code, in thousands: complex numbers; all steps of a node together (SORT2); statistics of a random response."""
_NODE = 1
"""Type of a point; others are scalar, extra, modal and fluid points."""
_HEAD, _ROW, _EIGENVALUE_ROW = 146, 8, 7
"""Words."""
_ROUNDING = {4: 6e-8, 8: 2e-16}
"""Of a number by the bytes of a word."""
_TITLES = ((114, 146), (82, 114), (50, 82))
"""Words of label, subtitle and title: the first that is there is the label of a response."""


def op2_responses(path: Path) -> Iterator[Response]:
    """Modes and static displacements of the file in its order; other tables, velocities and temperatures are passed over.

    The step is the subcase; where there are two tables of it, along the axes of each node and the basic ones, the first counts.
    A mode's frequency comes from its eigenvalue λ = ω², its modal mass from a table LAMA before it. Load steps of a nonlinear
    subcase count from 1.
    Raises DeckError for a damaged file, other kinds of displacements, and those written node by node (SORT2).
    """
    with opened(path) as file:
        op2 = Op2File(file, path)
        head: _Head | None = None
        masses: dict[tuple[int, float], float] = {}
        counts: Counter[int] = Counter()
        basic: dict[tuple[int, int], bool] = {}
        for record in op2.records(lambda name: name == _EIGENVALUES or _DISPLACEMENTS.fullmatch(name) is not None):
            if record.number % 2 == 1:
                head = _head(op2, record)
                continue
            if record.number == 0 or head is None:
                head = None
            elif record.table == _EIGENVALUES:
                masses |= _modal_masses(op2, record)
            elif head.is_displacement:
                own = _is_basic(record.table)
                if basic.setdefault((head.analysis, head.subcase), own) == own:
                    counts[head.subcase] += head.analysis != _MODE
                    yield _response(op2, record, head, masses, counts[head.subcase])
            head = None


class _Head(NamedTuple):
    """What a table holds: analysis and table by their codes, sort as bits, subcase, mode and its eigenvalue, words of a row."""

    analysis: int
    table: int
    sort: int
    subcase: int
    mode: int
    eigenvalue: float
    row: int
    thermal: int
    label: str

    @property
    def is_displacement(self) -> bool:
        return self.table in (_DISPLACEMENT, _EIGENVECTOR) and self.thermal != 1 and not self.sort & _RANDOM


def _head(op2: Op2File, record: Record) -> _Head:
    words = np.frombuffer(record.content, op2.integer)
    if len(words) != _HEAD:
        raise damaged(f"record {record.number} of {record.table} has {len(words)} words, not {_HEAD}", record.where)
    sort, table = divmod(int(words[1]), 1000)
    titles = (op2.text(record.content[first * op2.width : last * op2.width]) for first, last in _TITLES)
    return _Head(
        analysis=int(words[0]) // 10,
        table=table,
        sort=sort,
        subcase=int(words[3]),
        mode=int(words[4]),
        eigenvalue=float(np.frombuffer(record.content, op2.real)[5]),
        row=int(words[9]),
        thermal=int(words[22]),
        label=" ".join(next((title for title in titles if title), "").split()),
    )


def _is_basic(table: str) -> bool:
    """Are the motions of a table along the basic axes, and not along those of each node?"""
    name = _DISPLACEMENTS.fullmatch(table)
    return name is not None and any(name.groups())


def _response(
    op2: Op2File, record: Record, head: _Head, masses: dict[tuple[int, float], float], count: int
) -> Response:
    """count: of the static responses of its subcase, with this one."""
    is_mode = head.analysis == _MODE
    where = f"{record.where}, {record.table} of subcase {head.subcase}" + (f", mode {head.mode}" if is_mode else "")
    if head.analysis in _OTHERS or head.sort & _COMPLEX:
        raise unsupported(_OTHERS.get(head.analysis, "complex displacements"), where)
    if head.sort & _BY_NODE:
        raise error_at(where, "the displacements are written node by node (SORT2)", "ask for DISPLACEMENT(SORT1)")
    if head.row != _ROW or (not is_mode and head.analysis not in _STATIC) or len(record.content) % (_ROW * op2.width):
        raise damaged(
            f"{len(record.content)} bytes of rows of {head.row} words, of an analysis of code {head.analysis}", where
        )
    row = np.dtype([("point", op2.integer), ("type", op2.integer), ("motion", op2.real, (6,))])
    rows = np.frombuffer(record.content, row)
    nodes = rows["type"] == _NODE
    ids = (rows["point"][nodes] // 10).astype(np.int64)
    motion = rows["motion"][nodes].astype(float)
    frequency = natural_frequency(head.eigenvalue) if is_mode else 0.0
    return Response(
        "mode" if is_mode else "static",
        head.subcase,
        head.mode if is_mode else count,
        ids,
        motion,
        frequency,
        head.label,
        masses.get((head.mode, head.eigenvalue)) if is_mode else None,
        along_node_axes=not _is_basic(record.table),
        rounding=_ROUNDING[op2.width],
        scalar_points=int(np.count_nonzero(~nodes)),
        where=where,
    )


def _modal_masses(op2: Op2File, record: Record) -> dict[tuple[int, float], float]:
    """Mode and λ → ΦᵀMΦ of a table LAMA, whose rows are mode, order, λ, ω, f, ΦᵀMΦ and ΦᵀKΦ. λ tells whether it is that of the
    shape: a run may solve for eigenvalues twice."""
    count = len(record.content) // (_EIGENVALUE_ROW * op2.width)
    row = np.dtype([("mode", op2.integer), ("order", op2.integer), ("values", op2.real, (5,))])
    rows = np.frombuffer(record.content, row, count)
    values = rows["values"].astype(float)
    return dict(zip(zip(rows["mode"].tolist(), values[:, 0].tolist(), strict=True), values[:, 3].tolist(), strict=True))


_WIDTH, _ID, _FIRST, _NUMBER = 72, 10, 18, 18
"""Columns of a line, of an id, in front of the first component, and of each."""
_PUNCH_ROUNDING = 5e-7
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
        yield _punch_response(block, counts, path)


def _blocks(path: Path) -> Iterator[_Block]:
    """The blocks of eigenvectors and displacements, one in memory at a time."""
    block = _Block({}, bytearray(), 0)
    in_comments = False
    for number, line in result_lines(path, "a punch file", "give the .pch file that Nastran wrote"):
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


def _punch_response(block: _Block, counts: Counter[int], path: Path) -> Response:
    says, where = block.says, f"{path}:{block.number}"
    subcase = parse_integer(says.get("SUBCASE ID", ""))
    if subcase is None:
        raise damaged("the comments before this line name no SUBCASE ID", where)
    if other := next((what for word, what in _OVER.items() for said in says if said.startswith(word)), None):
        raise unsupported(other, where)
    if "REAL OUTPUT" not in says:
        raise unsupported("complex displacements", where)
    if "POINT ID" in says:
        raise error_at(
            where, "the displacements are written point by point (SORT2)", "ask for DISPLACEMENT(SORT1,PUNCH)"
        )
    mode = _EIGENVALUE.fullmatch(says.get("EIGENVALUE", "")) if "EIGENVECTOR" in says else None
    eigenvalue = parse_real(mode[1]) if mode else 0.0
    if ("EIGENVECTOR" in says and mode is None) or eigenvalue is None:
        raise damaged("the comments before this line state no EIGENVALUE and MODE", where)
    if mode is None:
        counts[subcase] += 1
    number = int(mode[2]) if mode else counts[subcase]
    ids, motion, scalar_points = _rows(block, path)
    return Response(
        "mode" if mode else "static",
        subcase,
        number,
        ids,
        motion,
        natural_frequency(eigenvalue) if mode else 0.0,
        next((says[word] for word in ("LABEL", "SUBTITLE", "TITLE") if says.get(word)), ""),
        along_node_axes=True,
        rounding=_PUNCH_ROUNDING,
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
        raise damaged("a node without its two lines", f"{path}:{block.number + int(wrong[0])}")

    def place(row: int) -> str:
        return f"{path}:{block.number + int(first[row])}"

    numbers = np.concatenate([text[first, _FIRST:], text[first + 1, _FIRST:]], axis=1)
    return (
        integers(text[first, :_ID], place),
        reals(numbers, _NUMBER, place),
        int(np.count_nonzero(~is_node & ~goes_on)),
    )
