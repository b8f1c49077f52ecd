"""Numbers that stand in columns of fixed width, as Fortran writes them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from strainsight.decks.numbers import parse_integer, parse_real
from strainsight.errors import DeckError
from strainsight.foreign.results.checks import AGAIN
from strainsight.mesh.thin import FloatArray, IntArray

T = TypeVar("T")


def padded(line: bytes, width: int) -> bytes:
    """A line without its end, cut or filled with blanks to so many columns."""
    return line.rstrip(b"\r\n")[:width].ljust(width)


def reals(text: np.ndarray, width: int, place: Callable[[int], str]) -> FloatArray:
    """(n, k) numbers, also in Fortran's short form 1.0-100, of the characters (n, k width) of n rows; place: row → its place.

    Raises DeckError where there is none.
    """
    words = np.ascontiguousarray(text).view(f"S{width}")
    try:
        return words.astype(float)
    except (ValueError, OverflowError):
        rows = [[_checked(parse_real, word, place, row) for word in line] for row, line in enumerate(words.tolist())]
        return np.array(rows)


def integers(text: np.ndarray, place: Callable[[int], str]) -> IntArray:
    """(n,) integers of the characters (n, width) of n rows, as `reals`."""
    words = np.ascontiguousarray(text).view(f"S{text.shape[1]}")[:, 0]
    try:
        return words.astype(np.int64)
    except (ValueError, OverflowError):
        return np.array(
            [_checked(parse_integer, word, place, row) for row, word in enumerate(words.tolist())], np.int64
        )


def _checked(parse: Callable[[str], T | None], word: bytes, place: Callable[[int], str], row: int) -> T:
    value = parse(word.decode("latin-1").strip())
    if value is None:
        said = " ".join(word.decode("latin-1").split())
        raise DeckError(f"{said!r} is no finite number", where=place(row), remedy=AGAIN)
    return value
