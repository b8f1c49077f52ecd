"""Lists of unequal length as columns: one behind the other, with their offsets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

ALL = ", all lists one behind the other"
OFFSET = "list i is [offset[i], offset[i + 1])"


def ints(values: Sequence[int]) -> np.ndarray:
    """Whole numbers as a column (n,)."""
    return np.array(values, dtype=np.int64)


def floats(values: Sequence[float] | Sequence[np.ndarray], tail: tuple[int, ...] = ()) -> np.ndarray:
    """Numbers, or arrays of shape `tail`, as a column (n, *tail)."""
    return np.array(values, dtype=float).reshape(-1, *tail)


def joined(lists: Sequence[np.ndarray], kind: type, tail: tuple[int, ...] = ()) -> tuple[np.ndarray, np.ndarray]:
    """Lists of entries of shape `tail`, one behind the other, and where each begins."""
    offset = np.concatenate([[0], np.cumsum([len(entry) for entry in lists])]).astype(np.int64)
    return np.concatenate([np.zeros((0, *tail), kind), *(np.asarray(entry, kind) for entry in lists)]), offset


def split(flat: np.ndarray, offset: np.ndarray) -> list[np.ndarray]:
    """The lists again."""
    return np.split(flat, offset[1:-1]) if len(offset) > 1 else []


def letters(components: tuple[int, ...]) -> str:
    """Components 0-5 as decks write them, "123"."""
    return "".join(str(c + 1) for c in components)


def components(letters: str) -> tuple[int, ...]:
    """Components 0-5 of "123"."""
    return tuple(int(letter) - 1 for letter in letters)
