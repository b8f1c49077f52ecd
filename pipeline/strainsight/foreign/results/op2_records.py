"""The records of a Nastran OUTPUT2 file, of either byte order, with words of 4 or 8 bytes.

A file is a chain of Fortran records (length, content, length). One of a single word is a key: n > 0, the next record holds n
words; n < 0, the logical record is complete; 0, the data block is. A data block is its name (two words), its trailer, and then
records with a word in front that says what they are: 0 for a table, 1 and more for a column of a matrix.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from strainsight.errors import DeckError
from strainsight.foreign.results.checks import AGAIN

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
            raise DeckError(
                "no binary OUTPUT2 file" if self._length else "the file is empty",
                where=str(path),
                remedy="have Nastran write it by PARAM,POST,-1, unformatted",
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
                raise _damaged(f"{key} words are announced, and {len(content)} bytes follow", at)
            if keep:
                parts.append(content)
        return parts if key < 0 else None

    def _key(self) -> int:
        at = self._place()
        content = self._record(keep=True, most=self.width)
        if len(content) != self.width:
            raise _damaged(f"no key, but a record of {len(content)} bytes", at)
        return int(np.frombuffer(content, self.integer)[0])

    def _record(self, keep: bool, most: int | None = None) -> bytes:
        """The content of the next Fortran record, of at most so many bytes; b"" where it is passed over."""
        at, length = self._place(), self._length
        if len(length) < 4:
            raise _damaged("the file ends within a data block", at)
        size = self._int32.unpack(length)[0]
        if size < 0 or (most is not None and size > most):
            raise _damaged(f"no record of {size} bytes can be here", at)
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
            raise _damaged(f"a record of {size} bytes begins here, and does not end as it should", at)
        self._length = rest[4:]
        return b"".join(content)

    def _place(self) -> str:
        return f"{self._path}, byte {self._file.tell() - len(self._length)}"


def _damaged(what: str, where: str) -> DeckError:
    return DeckError(what, where=where, remedy=AGAIN)
