"""The numbers of a section of a gmsh file one after the other, whether it is text or binary."""

from __future__ import annotations

import warnings

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.model import FloatArray, IntArray

LARGEST_NUMBER = 2.0**53
"""Up to here a double holds every integer."""


class Text:
    """Numbers of a section that is text: body, which begins at line `line` of the file.

    Raises DeckError for what is no number, with its line, and for numbers that are claimed and not there.
    """

    def __init__(self, body: bytes, path: str, name: str, line: int):
        self.path, self.name, self.line = path, name, line
        lines = body.split(b"\n")
        self._ends = np.cumsum([len(text.split()) for text in lines])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            try:
                self.values: FloatArray = np.fromstring(body, sep=" ")
            except ValueError:
                self.values = np.zeros(0)
        if len(self.values) != self._ends[-1]:
            self._find_word(lines)
        self.start = self.at = 0

    def _find_word(self, lines: list[bytes]) -> None:
        for number, text in enumerate(lines, self.line):
            for word in text.split():
                try:
                    np.array(word, dtype="S40").astype(float)
                except ValueError:
                    raise self._error(f"{word[:40].decode('latin-1')!r} is no number", number) from None
        raise self._error("numbers that run into each other", self.line)

    def take(self, kind: str, count: int) -> np.ndarray:
        """The next numbers: kind "double", or "int" and "size" for whole ones. Returns (count,)."""
        self.start = self.at
        if not 0 <= count <= len(self.values) - self.at:
            raise self.error(f"{count} more numbers are claimed, {len(self.values) - self.at} are there")
        self.at += count
        values = self.values[self.start : self.at]
        if kind == "double":
            return values
        whole = (values == np.floor(values)) & (np.abs(values) < LARGEST_NUMBER)
        if not whole.all():
            self.start += int(np.argmin(whole))
            raise self.error(f"{self.values[self.start]:g} stands where a whole number belongs")
        return values.astype(np.int64)

    def rows(self, count: int, reals: int) -> tuple[IntArray, FloatArray]:
        """The next rows of one whole number and `reals` others: (count,) and (count, reals)."""
        table = self.take("double", count * (1 + reals)).reshape(count, 1 + reals)
        whole = (table[:, 0] == np.floor(table[:, 0])) & (np.abs(table[:, 0]) < LARGEST_NUMBER)
        if not whole.all():
            self.start += int(np.argmin(whole)) * (1 + reals)
            raise self.error(f"{self.values[self.start]:g} stands where a node number belongs")
        return table[:, 0].astype(np.int64), table[:, 1:]

    def lines(self, count: int, width: int) -> IntArray | None:
        """Lines on which the `count` rows of `width` numbers begin that were taken last."""
        begin = self.start + width * np.arange(count)
        return np.searchsorted(self._ends, begin, side="right").astype(np.int64) + self.line

    def error(self, what: str, remedy: str = "write the mesh again: the file is damaged or truncated") -> DeckError:
        """An error at the line of the numbers that were taken last."""
        begin = min(self.start, max(len(self.values) - 1, 0))
        return self._error(what, int(np.searchsorted(self._ends, begin, side="right")) + self.line, remedy)

    def _error(self, what: str, line: int, remedy: str = "correct the line, or write the mesh again") -> DeckError:
        return DeckError(f"${self.name}: {what}", where=f"{self.path}:{line}", remedy=remedy)

    def finish(self) -> None:
        """Raise DeckError where numbers are left over."""
        if self.at < len(self.values):
            self.start = self.at
            raise self.error(f"{len(self.values) - self.at} numbers more than the counts claim")


class Binary:
    """Numbers of a binary section that begins at byte `at` of the file; order "<" or ">", size [bytes] of a size_t.

    Raises DeckError, with the section, for numbers that are claimed and not there.
    """

    def __init__(self, content: bytes, at: int, path: str, name: str, order: str, size: int):
        # a file that ends within its count has no byte behind it
        self.content, self.at, self.path, self.name = content, min(at, len(content)), path, name
        self.types = {
            "int": np.dtype(f"{order}i4"),
            "size": np.dtype(f"{order}u{size}"),
            "double": np.dtype(f"{order}f8"),
        }

    def take(self, kind: str, count: int) -> np.ndarray:
        """The next numbers: kind "double", "int" or "size". Returns (count,)."""
        values = self._raw(self.types[kind], count)
        if kind == "double":
            return values.astype(np.float64)
        whole = values.astype(np.int64)
        if kind == "size" and np.any(whole < 0):
            raise self.error("a number beyond 2⁶³")
        return whole

    def rows(self, count: int, reals: int) -> tuple[IntArray, FloatArray]:
        """The next rows of one whole number and `reals` others: (count,) and (count, reals)."""
        table = self._raw(np.dtype([("id", self.types["int"]), ("x", self.types["double"], (reals,))]), count)
        return table["id"].astype(np.int64), table["x"].astype(np.float64)

    def _raw(self, dtype: np.dtype, count: int) -> np.ndarray:
        left = (len(self.content) - self.at) // dtype.itemsize
        if not 0 <= count <= left:
            raise self.error(f"{count} more entries are claimed, at most {left} are in the file")
        values = np.frombuffer(self.content, dtype, count, self.at) if count else np.zeros(0, dtype)
        self.at += count * dtype.itemsize
        return values

    def rest(self) -> np.ndarray:
        """All that follows as ints, without taking it."""
        count = (len(self.content) - self.at) // 4
        return np.frombuffer(self.content, self.types["int"], count, self.at) if count else np.zeros(0, np.int32)

    def lines(self, count: int, width: int) -> IntArray | None:
        """None: bytes have no lines."""
        return None

    def error(self, what: str, remedy: str = "write the mesh again: the file is damaged or truncated") -> DeckError:
        """An error in this section."""
        return DeckError(f"${self.name}: {what}", where=self.path, remedy=remedy)

    def finish(self) -> None:
        """Raise DeckError where the section does not end here."""
        tail = self.content[self.at : self.at + 40].lstrip()
        if not tail.startswith(b"$End" + self.name.encode()):
            raise self.error(f"$End{self.name} does not follow the last entry that the counts claim")


Numbers = Text | Binary
