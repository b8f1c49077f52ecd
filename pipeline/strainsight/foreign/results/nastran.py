"""Modes and static displacements of a Nastran OUTPUT2 file (.op2) and punch file (.pch).

OUTPUT2: a chain of Fortran records (length, content, length). A record of a single word is a key: n > 0, the next record has n
words; n < 0, the logical record is complete; 0, the data block is complete. A data block is its name (two words), its trailer,
and records with a type word in front. The type is 0 for a table, 1 and more for a column of a matrix. A displacement table
consists of pairs of records: 146 words of header, then the rows. A row is ten times the point id plus the device code, the point
type, and six components. Source: DMAP Programmer's Guide, data blocks OUG (displacements) and LAMA (eigenvalues).

Punch: lines of 80 columns, with the line number in the last 8. A block is header comments, then two lines a point. The first has
id (ten columns), type (eight), three components (eighteen each), the second -CONT- and the three rotations."""

from __future__ import annotations

import os
import re
import struct
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from strainsight.decks.text import damage_error, error_at, open_file, parse_integer, parse_real
from strainsight.foreign.results.response import (
    Response,
    integers,
    natural_frequency,
    pad_line,
    reals,
    result_lines,
    unsupported_error,
)

_WIDTHS = {struct.pack(order + "i", width): (order, width) for order in "<>" for width in (4, 8)}
"""First four bytes → byte order, and bytes of a word."""
_NAME = 2
"""Words of the name of a data block."""
_AT_ONCE = 1 << 24
"""Largest number of bytes read at once."""


class Record(NamedTuple):
    """A record of a table: table name, record number from 0, content, and file with byte."""

    table: str
    number: int
    content: bytes
    where: str


class Op2File:
    """An open file: its records and number types. width [bytes] of a word."""

    def __init__(self, file: BinaryIO, path: Path):
        """Raise DeckError if it is not a binary OUTPUT2 file."""
        self._file, self._path = file, path
        self._length = file.read(4)
        """Length field of the next record; b"" at the end of the file."""
        if self._length not in _WIDTHS:
            raise error_at(
                path,
                "the file is not a binary OUTPUT2 file" if self._length else "the file is empty",
                "write the file in Nastran with PARAM,POST,-1, unformatted",
            )
        order, self.width = _WIDTHS[self._length]
        self.integer = np.dtype(f"{order}i{self.width}")
        self.real = np.dtype(f"{order}f{self.width}")
        self._int32 = struct.Struct(order + "i")

    def records(self, wanted: Callable[[str], bool]) -> Iterator[Record]:
        """The records of every table whose name is wanted, one in memory at a time; others are skipped. Raises DeckError with
        the byte position if the file is damaged, or ends inside a data block."""
        while self._length:
            if (name := self._logical(keep=True)) is None:
                continue  # end of the file, or of one of several concatenated files
            # the file header has no two-word name in front
            table = self.text(name[0]) if name and len(name[0]) == _NAME * self.width else ""
            keep = bool(table) and wanted(table)
            number, where = -1, self._place()  # the trailer is not a record
            while (parts := self._logical(keep)) is not None:
                if keep and number >= 0 and len(parts) > 1 and not any(parts[0]):
                    yield Record(table, number, b"".join(parts[1:]), where)
                number, where = number + 1, self._place()

    def text(self, content: bytes) -> str:
        """Four characters a word, without surrounding blanks."""
        words = np.frombuffer(content[: len(content) // self.width * self.width], np.uint8)
        return words.reshape(-1, self.width)[:, :4].tobytes().decode("latin-1").strip(" \0")

    def _logical(self, keep: bool) -> list[bytes] | None:
        """Parts of a logical record, empty if they are not kept; None at the end of the data block."""
        parts = []
        while (key := self._key()) > 0:
            at = self._place()
            content = self._record(keep)
            if keep and len(content) != key * self.width:
                raise damage_error(f"a record length of {key} words is announced, but {len(content)} bytes follow", at)
            if keep:
                parts.append(content)
        return parts if key < 0 else None

    def _key(self) -> int:
        at = self._place()
        content = self._record(keep=True, most=self.width)
        if len(content) != self.width:
            raise damage_error(f"expected a record length (key), but found a record of {len(content)} bytes", at)
        return int(np.frombuffer(content, self.integer)[0])

    def _record(self, keep: bool, most: int | None = None) -> bytes:
        """Content of the next Fortran record, of at most `most` bytes; b"" if it is skipped."""
        at, length = self._place(), self._length
        if len(length) < 4:
            raise damage_error("the file ends inside a data block", at)
        size = self._int32.unpack(length)[0]
        if size < 0 or (most is not None and size > most):
            raise damage_error(f"a record has the invalid length of {size} bytes", at)
        content = []
        left = size
        if not keep:
            self._file.seek(size, os.SEEK_CUR)
        # read in pieces, so that a damaged length does not allocate memory
        while keep and left and (part := self._file.read(min(left, _AT_ONCE))):
            content.append(part)
            left -= len(part)
        rest = self._file.read(8)
        if rest[:4] != length:
            raise damage_error(f"a record of {size} bytes begins here, but does not end correctly", at)
        self._length = rest[4:]
        return b"".join(content)

    def _place(self) -> str:
        return f"{self._path}, byte {self._file.tell() - len(self._length)}"


_DISPLACEMENTS = re.compile(r"(B?)O(?:UGV?|PHIG)[12]?(PAT)?")
"""Names of displacement tables. With B or PAT they are along the basic axes, otherwise along nodal axes."""
_EIGENVALUES = "LAMA"
_DISPLACEMENT, _EIGENVECTOR = 1, 7
"""Table codes; 10 and 11 are velocities and accelerations."""
_MODE = 2
_STATIC = (1, 7, 10, 11, 12)
"""Analysis codes: linear, before buckling, nonlinear (three)."""
_OTHERS = {5: "a frequency response", 6: "a transient response", 8: "a buckling shape", 9: "a complex mode"}
_COMPLEX, _BY_NODE, _RANDOM = 1, 2, 4
"""Bits of a table code, in thousands: complex numbers; all steps of a node together (SORT2); random response statistics."""
_NODE = 1
"""Point type of nodes; others are scalar, extra, modal and fluid points."""
_HEAD, _ROW, _EIGENVALUE_ROW = 146, 8, 7
"""Words of header and rows."""
_ROUNDING = {4: 6e-8, 8: 2e-16}
"""Bytes of a word → relative rounding error."""
_TITLES = ((114, 146), (82, 114), (50, 82))
"""Words of label, subtitle and title; the first non-blank one is the label of a response."""


def op2_responses(path: Path) -> Iterator[Response]:
    """Modes and static displacements in file order; other tables, velocities and temperatures are skipped.

    The step is the subcase; if it has tables in nodal and in basic axes, the first is used. The frequency of a mode comes from
    its eigenvalue λ = ω², its modal mass from a preceding table LAMA. Load steps of a nonlinear subcase are numbered from 1.
    Raises DeckError for a damaged file, other kinds of displacements, and displacements written node by node (SORT2)."""
    with open_file(path) as file:
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
            elif head.table in (_DISPLACEMENT, _EIGENVECTOR) and head.thermal != 1 and not head.sort & _RANDOM:
                is_basic = _is_basic(record.table)
                if basic.setdefault((head.analysis, head.subcase), is_basic) == is_basic:
                    counts[head.subcase] += head.analysis != _MODE
                    yield _response(op2, record, head, masses, counts[head.subcase])
            head = None


class _Head(NamedTuple):
    """Header of a table: codes of analysis and table, sort as bits, subcase, mode and its eigenvalue, words of a row."""

    analysis: int
    table: int
    sort: int
    subcase: int
    mode: int
    eigenvalue: float
    row: int
    thermal: int
    label: str


def _head(op2: Op2File, record: Record) -> _Head:
    words = np.frombuffer(record.content, op2.integer)
    if len(words) != _HEAD:
        raise damage_error(
            f"record {record.number} of table {record.table} has {len(words)} words, not {_HEAD}", record.where
        )
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
    """Whether the motions of a table are along the basic axes instead of nodal axes."""
    name = _DISPLACEMENTS.fullmatch(table)
    return name is not None and any(name.groups())


def _response(
    op2: Op2File, record: Record, head: _Head, masses: dict[tuple[int, float], float], count: int
) -> Response:
    """count: number of static responses of the subcase so far, including this one."""
    is_mode = head.analysis == _MODE
    where = f"{record.where}, table {record.table} of subcase {head.subcase}" + (
        f", mode {head.mode}" if is_mode else ""
    )
    if head.analysis in _OTHERS or head.sort & _COMPLEX:
        raise unsupported_error(_OTHERS.get(head.analysis, "complex displacements"), where)
    if head.sort & _BY_NODE:
        raise error_at(where, "the displacements are written node by node (SORT2)", "request DISPLACEMENT(SORT1)")
    if head.row != _ROW or (not is_mode and head.analysis not in _STATIC) or len(record.content) % (_ROW * op2.width):
        raise damage_error(
            f"invalid block of displacements: {len(record.content)} bytes, {head.row} words per row, analysis {head.analysis}",
            where,
        )
    row = np.dtype([("point", op2.integer), ("type", op2.integer), ("motion", op2.real, (6,))])
    rows = np.frombuffer(record.content, row)
    nodes = rows["type"] == _NODE
    return Response(
        ("static", "mode")[is_mode],
        head.subcase,
        head.mode if is_mode else count,
        (rows["point"][nodes] // 10).astype(np.int64),
        rows["motion"][nodes].astype(float),
        natural_frequency(head.eigenvalue) if is_mode else 0.0,
        head.label,
        masses.get((head.mode, head.eigenvalue)) if is_mode else None,
        along_node_axes=not _is_basic(record.table),
        rounding=_ROUNDING[op2.width],
        scalar_points=int(np.count_nonzero(~nodes)),
        where=where,
    )


def _modal_masses(op2: Op2File, record: Record) -> dict[tuple[int, float], float]:
    """Mode and λ → ΦᵀMΦ of a table LAMA, whose rows are mode, order, λ, ω, f, ΦᵀMΦ and ΦᵀKΦ. λ identifies the
    solution, because a run may solve for eigenvalues twice."""
    count = len(record.content) // (_EIGENVALUE_ROW * op2.width)
    row = np.dtype([("mode", op2.integer), ("order", op2.integer), ("values", op2.real, (5,))])
    rows = np.frombuffer(record.content, row, count)
    values = rows["values"].astype(float)
    return dict(zip(zip(rows["mode"].tolist(), values[:, 0].tolist(), strict=True), values[:, 3].tolist(), strict=True))


_WIDTH, _ID, _FIRST, _NUMBER = 72, 10, 18, 18
"""Columns of a line, of an id, before the first component, and of each component."""
_PUNCH_ROUNDING = 5e-7
"""Relative rounding error of a number with seven digits."""
_WORDS = {"EIGENVECTOR", "DISPLACEMENTS"}
_EIGENVALUE = re.compile(r"(\S+)\s+MODE\s*=\s*(\d+)")
_OVER = {"FREQUENCY": "a frequency response", "TIME": "a transient response"}


class _Block(NamedTuple):
    """Header comments, keyword → value ("" for a single word), data lines of _WIDTH columns each, and the number of
    the first line."""

    header: dict[str, str]
    lines: bytearray
    number: int


def punch_responses(path: Path) -> Iterator[Response]:
    """Eigenvectors and displacements in file order; other blocks and cards are skipped.

    The step is the subcase; the frequency of a mode comes from its eigenvalue λ = ω². Displacements of one subcase
    are numbered from 1. The format does not distinguish vibration and buckling modes. Raises DeckError with the line
    for unreadable numbers, complex results, results over time or frequency, and results written point by point (SORT2)."""
    counts: Counter[int] = Counter()
    for block in _blocks(path):
        yield _punch_response(block, counts, path)


def _blocks(path: Path) -> Iterator[_Block]:
    """Blocks of eigenvectors and displacements, one in memory at a time."""
    block = _Block({}, bytearray(), 0)
    in_comments = False
    for number, line in result_lines(path, "a punch file", "specify the .pch file of Nastran"):
        is_comment = line.startswith(b"$")
        if is_comment and not in_comments:
            if block.lines:
                yield block
            block = _Block({}, bytearray(), 0)
        if is_comment:
            key, _, value = line[1:_WIDTH].decode("latin-1").partition("=")
            block.header[" ".join(key.split())] = " ".join(value.split())
        elif _WORDS & block.header.keys():
            block = block if block.lines else block._replace(number=number)
            block.lines.extend(pad_line(line, _WIDTH))
        in_comments = is_comment
    if block.lines:
        yield block


def _punch_response(block: _Block, counts: Counter[int], path: Path) -> Response:
    header, where = block.header, f"{path}:{block.number}"
    if (subcase := parse_integer(header.get("SUBCASE ID", ""))) is None:
        raise damage_error("the comments before this line have no SUBCASE ID", where)
    if other := next((what for word, what in _OVER.items() for key in header if key.startswith(word)), None):
        raise unsupported_error(other, where)
    if "REAL OUTPUT" not in header:
        raise unsupported_error("complex displacements", where)
    if "POINT ID" in header:
        raise error_at(where, "the displacements are written node by node (SORT2)", "request DISPLACEMENT(SORT1,PUNCH)")
    mode = _EIGENVALUE.fullmatch(header.get("EIGENVALUE", "")) if "EIGENVECTOR" in header else None
    eigenvalue = parse_real(mode[1]) if mode else 0.0
    if ("EIGENVECTOR" in header and mode is None) or eigenvalue is None:
        raise damage_error("the comments before this line have no EIGENVALUE and MODE", where)
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
        next((header[word] for word in ("LABEL", "SUBTITLE", "TITLE") if header.get(word)), ""),
        along_node_axes=True,
        rounding=_PUNCH_ROUNDING,
        scalar_points=scalar_points,
        where=f"{where}, subcase {subcase}" + (f", mode {number}" if mode else ""),
    )


def _rows(block: _Block, path: Path) -> tuple[np.ndarray, np.ndarray, int]:
    """Node ids (n,), motion (n, 6), and the number of other points."""
    text = np.frombuffer(block.lines, np.uint8).reshape(-1, _WIDTH)
    goes_on = text[:, 0] == ord("-")
    is_node = ~goes_on & (text[:, _FIRST - 1] == ord("G"))
    first = np.flatnonzero(is_node)
    # first line of a node, its second line, and then another point
    second = np.append(goes_on, [False, False])
    if (wrong := first[~second[first + 1] | second[first + 2]]).size:
        raise damage_error("the displacements of a node must have two lines", f"{path}:{block.number + int(wrong[0])}")

    def place(row: int) -> str:
        return f"{path}:{block.number + int(first[row])}"

    return (
        integers(text[first, :_ID], place),
        reals(np.concatenate([text[first, _FIRST:], text[first + 1, _FIRST:]], axis=1), _NUMBER, place),
        int(np.count_nonzero(~is_node & ~goes_on)),
    )
