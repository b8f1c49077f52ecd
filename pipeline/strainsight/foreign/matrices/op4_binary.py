"""OUTPUT4 files in binary, of either byte order, with integers of 4 or 8 bytes."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from strainsight.errors import DeckError
from strainsight.foreign.matrices.op4_parts import TRUNCATED, Column, Header, checked, header_of, in_order

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
