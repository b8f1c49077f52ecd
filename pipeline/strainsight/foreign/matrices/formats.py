"""Readers of OUTPUT4 (text and binary) and Matrix Market matrices.

SciPy's Matrix Market reader crashes with a segmentation fault at an invalid line (seen with SciPy 1.17)."""

from __future__ import annotations

import re
import struct
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from io import TextIOWrapper
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from scipy import sparse

from strainsight.decks.text import PACKING, SMALL, damage_error, error_at, open_file, parse_integer
from strainsight.errors import DeckError

LARGEST = 50_000_000
"""Largest number of rows or columns; a larger number means damage."""
BIGMAT = 65_536
"""Number of rows from which the strings of a sparse matrix have two words in front of them, not one."""


@dataclass(frozen=True)
class Header:
    """name; shape (rows, columns); wide: two words in front of every string; words of a number."""

    name: str
    shape: tuple[int, int]
    wide: bool
    words: int


Column = tuple[int, list[int], list[int], Any]
"""Column number from 1, first row from 1 and length of every string of numbers, and the numbers of all strings."""


def header_of(name: bytes, columns: int, rows: int, kind: int, words: int, where: str) -> Header:
    matrix_name = name.replace(b"\0", b" ").decode("ascii", "replace").strip()
    if kind in (3, 4):
        raise error_at(where, f"the matrix {matrix_name} is complex", "export stiffness and mass as real matrices")
    if kind not in (1, 2) or not (0 < columns <= LARGEST and 0 < abs(rows) <= LARGEST):
        raise error_at(
            where,
            f"the matrix header is not valid: {abs(rows)} rows, {columns} columns, type {kind}",
            "check that the file is an OP4 file and not damaged",
        )
    return Header(matrix_name, (abs(rows), columns), rows < 0 or rows >= BIGMAT, 1 if kind == 1 else words)


def check_column(header: Header, column: int, rows: list[int], lengths: list[int], numbers: Any, where: str) -> Column:
    for row, length in zip(rows, lengths, strict=True):
        if not (row >= 1 and 1 <= length <= header.shape[0] - row + 1):
            what = f"column {column} of matrix {header.name} has {length} numbers from row {row} on"
            raise damage_error(f"{what}, but the matrix has {header.shape[0]} rows", where)
    return column, rows, lengths, numbers


def check_order(column: int, last: int, header: Header, where: str) -> int:
    if column <= last:
        what = f"column {column} of matrix {header.name} follows column {last}, but column numbers must increase"
        raise damage_error(what, where)
    return column


MARKERS = {struct.pack(order + "i", size): (order, size == 48) for order in "<>" for size in (24, 48)}
"""First four bytes → byte order, and whether integers are long."""


def binary_matrices(path: Path, order: str, long: bool) -> Iterator[tuple[Header, Iterator[Column]]]:
    data = path.read_bytes()
    records = _records(data, order, path)
    integer = 8 if long else 4
    for at, size in records:
        if size != 6 * integer:
            raise damage_error(f"expected a matrix header at byte {at}", str(path))
        columns, rows, _, kind = struct.unpack_from(order + ("4q" if long else "4i"), data, at)
        name = data[at + 4 * integer : at + size]
        header = header_of(name, columns, rows, kind, 1 if long else 2, f"{path}, byte {at}")
        yield header, _binary_columns(data, records, header, order, integer, kind, path)


def _records(data: bytes, order: str, path: Path) -> Iterator[tuple[int, int]]:
    """Start and size of every record, which is enclosed by its length in bytes."""
    at = 0
    while at < len(data):
        size = struct.unpack_from(order + "i", data, at)[0] if at + 8 <= len(data) else -1
        end = at + 4 + size
        if size < 0 or data[at : at + 4] != data[end : end + 4]:
            raise damage_error(f"the record at byte {at} is incomplete", str(path))
        yield at + 4, size
        at = end + 4


def _binary_columns(
    data: bytes, records: Iterator[tuple[int, int]], header: Header, order: str, integer: int, kind: int, path: Path
) -> Iterator[Column]:
    real = np.dtype(f"{order}f{integer if kind == 1 else 8}")
    word = np.dtype(f"{order}i{integer}")
    last, heads = 0, 2 if header.wide else 1
    for at, size in records:
        where = f"{path}, byte {at}"
        if size < 3 * integer:
            raise damage_error("the record is too short for a matrix column", where)
        column, row, count = np.frombuffer(data, word, 3, at).tolist()
        last = check_order(column, last, header, where)
        if column > header.shape[1]:
            return
        begin = at + 3 * integer
        if count < 0 or begin + count * integer > at + size:
            raise damage_error(f"a matrix column of {count} words is in a record of only {size} bytes", where)
        if row > 0:
            length = count // header.words
            numbers = np.frombuffer(data, real, length, begin).astype(float)
            yield check_column(header, column, [row], [length], numbers, where)
            continue
        body = np.frombuffer(data, word, count, begin)
        rows, lengths, places = _strings_of(body.tolist(), header, column, where)
        keep = np.ones(count, dtype=bool)
        keep[np.array(places, dtype=np.int64)[:, None] + np.arange(heads)] = False
        yield check_column(header, column, rows, lengths, body[keep].view(real).astype(float), where)
    raise damage_error(f"the file ends inside matrix {header.name}", str(path))


def _strings_of(words: list[int], header: Header, column: int, where: str) -> tuple[list[int], list[int], list[int]]:
    """First row, count of numbers, and position of the head of every string in a sparse column."""
    rows, lengths, places = [], [], []
    at = 0
    while at < len(words):
        places.append(at)
        if header.wide:
            size, row = words[at] - 1, words[at + 1] if at + 1 < len(words) else 0
            at += 2
        else:
            size, row = (words[at] >> 16) - 1, words[at] & 0xFFFF
            at += 1
        at += size
        if size <= 0 or size % header.words or at > len(words):
            raise damage_error(f"a block of entries in column {column} has the invalid length of {size} words", where)
        rows.append(row)
        lengths.append(size // header.words)
    return rows, lengths, places


_FORMAT = re.compile(r"(\d+)[EDFG](\d+)\.\d+")
_NO_LETTER = re.compile(rb"\s*([-+]?\d*\.?\d*)([-+]\d+)\s*")


@dataclass
class _Lines:
    """Lines of a text file, and the number of the last one."""

    path: Path
    lines: Iterator[bytes]
    number: int = 0

    @property
    def where(self) -> str:
        return f"{self.path}:{self.number}"

    def next(self) -> bytes:
        self.number += 1
        if (line := next(self.lines, None)) is None:
            raise damage_error("the file ends inside a matrix", self.where)
        return line.rstrip(b"\r\n")

    def integers(self, line: bytes, *widths: int) -> tuple[int, ...]:
        ends = np.cumsum(widths).tolist()
        try:
            return tuple(int(line[end - width : end]) for end, width in zip(ends, widths, strict=True))
        except ValueError:
            text = line[:40].decode("ascii", "replace")
            raise DeckError(
                f"{text!r} is not a valid line of an OP4 file",
                where=self.where,
                remedy="check that the file is an OP4 file and not damaged",
            ) from None


def text_matrices(path: Path) -> Iterator[tuple[Header, Iterator[Column]]]:
    with path.open("rb") as file:
        lines = _Lines(path, iter(file))
        for line in lines.lines:
            lines.number += 1
            line = line.rstrip()
            if not line:
                continue
            widths = (16, 16, 8, 8) if line.endswith(b"|I16") else (8, 8, 8, 8)
            columns, rows, _, kind = lines.integers(line, *widths)
            at = sum(widths)
            header = header_of(line[at : at + 8], columns, rows, kind, 2, lines.where)
            number_format = _FORMAT.search(line[at + 8 :].decode("ascii", "replace").upper())
            per_line, width = (int(number_format[1]), int(number_format[2])) if number_format else (5, 16)
            if not (0 < per_line <= 100 and 0 < width <= 100):
                raise damage_error(f"the number format {per_line}E{width} is not valid", lines.where)
            yield header, _text_columns(lines, header, per_line, width)


def _text_columns(lines: _Lines, header: Header, per_line: int, width: int) -> Iterator[Column]:
    last = 0
    while True:
        column, row, left = lines.integers(lines.next(), 8, 8, 8)
        where = lines.where
        last = check_order(column, last, header, where)
        if column > header.shape[1]:
            lines.next()
            return
        numbers = array("d")
        if row > 0:
            _read_numbers(numbers, lines, left, per_line, width)
            yield check_column(header, column, [row], [left], numbers, where)
            continue
        rows, lengths = [], []
        while left > 0:
            line = lines.next()
            if header.wide:
                size, row = lines.integers(line, 8, 8)
                size, left = size - 1, left - 1
            else:
                (head,) = lines.integers(line, max(len(line), 1))
                size, row = (head >> 16) - 1, head & 0xFFFF
            left -= 1 + size
            if size <= 0 or left < 0:
                what = f"a block of entries in column {column} has the invalid length of {size} words"
                raise damage_error(what, lines.where)
            rows.append(row)
            lengths.append(size // header.words)
            _read_numbers(numbers, lines, lengths[-1], per_line, width)
        yield check_column(header, column, rows, lengths, numbers, where)


def _read_numbers(numbers: array[float], lines: _Lines, count: int, per_line: int, width: int) -> None:
    while count > 0:
        line = lines.next().replace(b"D", b"E")
        many = min(per_line, count)
        numbers.extend([_number(line[at : at + width], lines) for at in range(0, width * many, width)])
        count -= many


def _number(text: bytes, lines: _Lines) -> float:
    try:
        return float(text)
    except ValueError:
        pass
    # Fortran omits the letter of three-digit exponents: 1.5-105
    if split := _NO_LETTER.fullmatch(text):
        return float(split[1] + b"E" + split[2])
    raise damage_error(f"{text.decode('ascii', 'replace')!r} is not a number", lines.where)


REAL = ("real", "integer", "double", "unsigned-integer")
LONGEST = 10_000
"""Longest line above the entries [characters]."""


def read_market(path: Path) -> sparse.coo_array | np.ndarray:
    """The matrix, with both triangles if the file declares it symmetric. Raises DeckError for complex, pattern and skew matrices
    and for invalid lines; OSError, EOFError and zlib.error from reading."""
    with open_file(path) as raw, TextIOWrapper(raw, "ascii", "replace") as file:
        words = file.readline(LONGEST).lower().split()
        if len(words) != 5 or words[:2] != ["%%matrixmarket", "matrix"] or words[2] not in ("array", "coordinate"):
            raise damage_error("the first line is not a Matrix Market header", f"{path}:1")
        layout, field, kind = words[2:]
        if field not in REAL or kind not in ("general", "symmetric"):
            raise error_at(
                f"{path}:1",
                f"{kind} {field} matrices are not supported",
                "write the matrix as real, and general or symmetric",
            )
        rows, columns, entries, line = _sizes(file, path, layout, kind)
        size = path.stat().st_size
        # a line of one entry has at least two bytes, with its indices six
        if (2 if layout == "array" else 6) * entries > (
            max(SMALL, PACKING * size) if path.suffix.lower() == ".gz" else size
        ):
            raise error_at(
                path,
                f"the file declares a {rows} × {columns} matrix with {entries} entries, more than its file size allows",
                "export the matrix again",
            )
        table = _table(file, path, entries, 1 if layout == "array" else 3, line)
    return (
        _dense(table[:, 0], rows, columns, kind)
        if layout == "array"
        else _sparse(table, rows, columns, kind, path, line)
    )


def _sizes(file: TextIO, path: Path, layout: str, kind: str) -> tuple[int, int, int, int]:
    """Rows, columns, entries in the file, and the line number of these sizes."""
    number, text = 1, "%"
    while text.startswith("%") or (text and not text.strip()):
        text, number = file.readline(LONGEST), number + 1
    sizes = [parse_integer(word) for word in text.split()]
    rows, columns, *more = [size or 0 for size in sizes] if len(sizes) >= 2 else [0, 0]
    if None in sizes or len(more) != (layout == "coordinate") or not (0 < rows <= LARGEST and 0 < columns <= LARGEST):
        raise damage_error(f"{text.strip()[:60]!r} is not a valid matrix size", f"{path}:{number}")
    if kind == "symmetric" and rows != columns:
        raise damage_error(f"a symmetric matrix must be square, but the size is {rows} × {columns}", f"{path}:{number}")
    dense = columns * (columns + 1) // 2 if kind == "symmetric" else rows * columns
    return rows, columns, more[0] if more else dense, number


def _table(file: TextIO, path: Path, entries: int, width: int, line: int) -> np.ndarray:
    """(entries, width) numbers, one line each."""
    if entries <= 0:
        return np.zeros((0, width))
    try:
        table = np.loadtxt(file, comments=None, ndmin=2, max_rows=entries)
    except ValueError as error:
        message = str(error).partition(";")[0][:200]
        raise damage_error(
            f"a line below the matrix size is not a valid matrix entry: {message}", f"{path}:{line + 1}"
        ) from None
    if table.shape != (entries, width) or any(rest.strip() for rest in iter(lambda: file.readline(LONGEST), "")):
        count = len(table) if len(table) < entries else f"more than {entries}"
        message = f"the number of entries is {count}, but the file declares {entries}"
        if table.shape[1:] != (width,):
            message = f"the number of values per line is {table.shape[1]}, not {width}"
        raise damage_error(message, f"{path}:{line}")
    return table


def _dense(values: np.ndarray, rows: int, columns: int, kind: str) -> np.ndarray:
    """Entries column by column; for a symmetric matrix those on the diagonal and below."""
    if kind == "general":
        return values.reshape(columns, rows).T
    X = np.zeros((columns, columns))
    upper = np.triu_indices(columns)  # the upper entries by rows are the lower ones by columns
    X[upper] = values
    X.T[upper] = values
    return X


def _sparse(table: np.ndarray, rows: int, columns: int, kind: str, path: Path, line: int) -> sparse.coo_array:
    place = table[:, :2]
    outside = ~((place >= 1) & (place <= [rows, columns]) & (place == np.floor(place))).all(axis=1)
    if outside.any():
        i, j = place[np.argmax(outside)]
        what = f"entry {int(np.argmax(outside)) + 1} is at ({i:g}, {j:g}), outside a {rows} × {columns} matrix"
        raise damage_error(what, f"{path}:{line}")
    row, column = (place[:, k].astype(np.int64) - 1 for k in (0, 1))
    value = table[:, 2]
    if kind == "symmetric":
        off = row != column
        row, column = np.concatenate([row, column[off]]), np.concatenate([column, row[off]])
        value = np.concatenate([value, value[off]])
    return sparse.coo_array((value, (row, column)), shape=(rows, columns))
