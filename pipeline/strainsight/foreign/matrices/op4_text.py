"""OUTPUT4 files in text."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strainsight.errors import DeckError
from strainsight.foreign.matrices.op4_parts import TRUNCATED, Column, Header, checked, header_of, in_order

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
