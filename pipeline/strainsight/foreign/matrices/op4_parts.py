"""What text and binary OUTPUT4 files have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

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
