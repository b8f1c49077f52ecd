"""What text and binary OUTPUT4 files have in common."""

from __future__ import annotations

import re
import struct
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from strainsight.errors import DeckError

LARGEST = 50_000_000
"""Rows or columns; a claim beyond it is damage."""
BIGMAT = 65_536
"""From this many rows on the strings of a sparse matrix have two words in front of them, not one."""
TRUNCATED = "write the file again: it was cut short or altered"


@dataclass(frozen=True)
class Header:
    """name; shape (rows, columns); wide: two words in front of every string; words a number takes."""

    name: str
    shape: tuple[int, int]
    wide: bool
    words: int


Column = tuple[int, list[int], list[int], Any]
"""Number from 1, first row from 1 and length of every string of numbers in it, and the numbers of all strings."""


def header_of(name: bytes, columns: int, rows: int, kind: int, words: int, where: str) -> Header:
    said = name.replace(b"\0", b" ").decode("ascii", "replace").strip()
    if kind in (3, 4):
        raise DeckError(f"the matrix {said} is complex", where=where, remedy="give real stiffness and mass matrices")
    if kind not in (1, 2) or not (0 < columns <= LARGEST and 0 < abs(rows) <= LARGEST):
        raise DeckError(
            f"no header of a matrix: {abs(rows)} × {columns}, type {kind}",
            where=where,
            remedy="the file is no OP4 file, or damaged",
        )
    return Header(said, (abs(rows), columns), rows < 0 or rows >= BIGMAT, 1 if kind == 1 else words)


def checked(header: Header, column: int, rows: list[int], lengths: list[int], numbers: Any, where: str) -> Column:
    for row, length in zip(rows, lengths, strict=True):
        if not (row >= 1 and 1 <= length <= header.shape[0] - row + 1):
            raise DeckError(
                f"column {column} of {header.name} has {length} numbers from row {row} of {header.shape[0]} on",
                where=where,
                remedy=TRUNCATED,
            )
    return column, rows, lengths, numbers


def in_order(column: int, last: int, header: Header, where: str) -> int:
    if column <= last:
        raise DeckError(f"column {column} of {header.name} follows column {last}", where=where, remedy=TRUNCATED)
    return column


MARKERS = {struct.pack(order + "i", size): (order, size == 48) for order in "<>" for size in (24, 48)}
"""First four bytes → byte order, and whether integers are long."""


def binary_matrices(path: Path, order: str, long: bool) -> Iterator[tuple[Header, Iterator[Column]]]:
    data = path.read_bytes()
    records = _records(data, order, path)
    integer = 8 if long else 4
    for at, size in records:
        if size != 6 * integer:
            raise DeckError(f"no header of a matrix at byte {at}", where=str(path), remedy=TRUNCATED)
        columns, rows, _, kind = struct.unpack_from(order + ("4q" if long else "4i"), data, at)
        name = data[at + 4 * integer : at + size]
        header = header_of(name, columns, rows, kind, 1 if long else 2, f"{path}, byte {at}")
        yield header, _binary_columns(data, records, header, order, integer, kind, path)


def _records(data: bytes, order: str, path: Path) -> Iterator[tuple[int, int]]:
    """Begin and size of every record, which its length in bytes encloses."""
    at = 0
    while at < len(data):
        size = struct.unpack_from(order + "i", data, at)[0] if at + 8 <= len(data) else -1
        end = at + 4 + size
        if size < 0 or data[at : at + 4] != data[end : end + 4]:
            raise DeckError(f"the record at byte {at} is not complete", where=str(path), remedy=TRUNCATED)
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
            raise DeckError("a record too short for a column", where=where, remedy=TRUNCATED)
        column, row, count = np.frombuffer(data, word, 3, at).tolist()
        last = in_order(column, last, header, where)
        if column > header.shape[1]:
            return
        begin = at + 3 * integer
        if count < 0 or begin + count * integer > at + size:
            raise DeckError(f"a column of {count} words in a record of {size} bytes", where=where, remedy=TRUNCATED)
        if row > 0:
            length = count // header.words
            numbers = np.frombuffer(data, real, length, begin).astype(float)
            yield checked(header, column, [row], [length], numbers, where)
            continue
        body = np.frombuffer(data, word, count, begin)
        rows, lengths, places = _strings_of(body.tolist(), header, column, where)
        keep = np.ones(count, dtype=bool)
        for shift in range(heads):
            keep[np.array(places, dtype=np.int64) + shift] = False
        yield checked(header, column, rows, lengths, body[keep].view(real).astype(float), where)
    raise DeckError(f"the file ends within {header.name}", where=str(path), remedy=TRUNCATED)


def _strings_of(words: list[int], header: Header, column: int, where: str) -> tuple[list[int], list[int], list[int]]:
    """First row, count of numbers, and place of the head of every string in a sparse column."""
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
            raise DeckError(f"a string of {size} words in column {column}", where=where, remedy=TRUNCATED)
        rows.append(row)
        lengths.append(size // header.words)
    return rows, lengths, places


_FORMAT = re.compile(r"(\d+)[EDFG](\d+)\.\d+")
_NO_LETTER = re.compile(rb"\s*([-+]?\d*\.?\d*)([-+]\d+)\s*")


@dataclass
class _Lines:
    """Lines of a text file, and where the last one stands."""

    path: Path
    lines: Iterator[bytes]
    number: int = 0

    @property
    def where(self) -> str:
        return f"{self.path}:{self.number}"

    def next(self) -> bytes:
        self.number += 1
        line = next(self.lines, None)
        if line is None:
            raise DeckError("the file ends within a matrix", where=self.where, remedy=TRUNCATED)
        return line.rstrip(b"\r\n")

    def integers(self, line: bytes, *widths: int) -> tuple[int, ...]:
        ends = np.cumsum(widths).tolist()
        try:
            return tuple(int(line[end - width : end]) for end, width in zip(ends, widths, strict=True))
        except ValueError:
            said = line[:40].decode("ascii", "replace")
            raise DeckError(
                f"{said!r} is no line of an OP4 file here",
                where=self.where,
                remedy="the file is no OP4 file, or damaged",
            ) from None


def text_matrices(path: Path) -> Iterator[tuple[Header, Iterator[Column]]]:
    with path.open("rb") as file:
        lines = _Lines(path, iter(file))
        for line in lines.lines:
            lines.number += 1
            line = line.rstrip()
            if not line:
                continue
            wide = line.endswith(b"|I16")
            widths = (16, 16, 8, 8) if wide else (8, 8, 8, 8)
            columns, rows, _, kind = lines.integers(line, *widths)
            at = sum(widths)
            header = header_of(line[at : at + 8], columns, rows, kind, 2, lines.where)
            stated = _FORMAT.search(line[at + 8 :].decode("ascii", "replace").upper())
            a_line, width = (int(stated[1]), int(stated[2])) if stated else (5, 16)
            if not (0 < a_line <= 100 and 0 < width <= 100):
                raise DeckError(f"no format of numbers: {a_line}E{width}", where=lines.where, remedy=TRUNCATED)
            yield header, _text_columns(lines, header, a_line, width)


def _text_columns(lines: _Lines, header: Header, a_line: int, width: int) -> Iterator[Column]:
    last = 0
    while True:
        column, row, left = lines.integers(lines.next(), 8, 8, 8)
        where = lines.where
        last = in_order(column, last, header, where)
        if column > header.shape[1]:
            lines.next()
            return
        found = array("d")
        if row > 0:
            _read_numbers(found, lines, left, a_line, width)
            yield checked(header, column, [row], [left], found, where)
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
                raise DeckError(f"a string of {size} words in column {column}", where=lines.where, remedy=TRUNCATED)
            rows.append(row)
            lengths.append(size // header.words)
            _read_numbers(found, lines, lengths[-1], a_line, width)
        yield checked(header, column, rows, lengths, found, where)


def _read_numbers(found: array[float], lines: _Lines, count: int, a_line: int, width: int) -> None:
    while count > 0:
        line = lines.next().replace(b"D", b"E")
        many = min(a_line, count)
        found.extend([_number(line[at : at + width], lines) for at in range(0, width * many, width)])
        count -= many


def _number(text: bytes, lines: _Lines) -> float:
    try:
        return float(text)
    except ValueError:
        pass
    # Fortran drops the letter where the exponent has three digits: 1.5-105
    if split := _NO_LETTER.fullmatch(text):
        return float(split[1] + b"E" + split[2])
    raise DeckError(f"{text.decode('ascii', 'replace')!r} is not a number", where=lines.where, remedy=TRUNCATED)
