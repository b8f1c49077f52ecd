"""One result of another program: a mode shape, or the response to a static load."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np

from strainsight.decks.faults import repeated
from strainsight.decks.text import parse_integer, parse_real
from strainsight.errors import DeckError
from strainsight.mesh.thin import FloatArray, IntArray


@dataclass(frozen=True)
class Response:
    """The motion of nodes in a mode or under a static load, in the units of its file.

    kind; step: number of the step, subcase or data set by which a config asks for it, from 1; number: of the mode within its
    step, from 1, and 1 of a static response; node_ids (n,) of the file, each once, in any order; motion (n, 3) translations
    [length of the file], or (n, 6) with rotations [rad] behind them; frequency [Hz] of a mode, −√|ω²|/2π where ω² < 0, and 0 of a
    static response; label: title of the step or subcase in the words of the file, "" where it has none; modal_mass: ΦᵀMΦ [mass
    of the file, times length² where the shape is a length] where the file states it; along_node_axes: the motion is along the
    displacement axes of each node (CD of a GRID), which the deck states, and not along the basic axes; rounding: largest relative
    error of a number of the file, 5e-6 of 1.23457E+00, 6e-8 in single precision, 1e-16 in double; scalar_points: how many
    points that are no nodes (scalar, fluid) stand among these in the file and are left out; where: file and step, or line, for a
    message; position (n, 3) of the nodes along the basic axes, where the file has them and its reader reads them.
    """

    kind: Literal["mode", "static"]
    step: int
    number: int
    node_ids: IntArray
    motion: FloatArray
    frequency: float = 0.0
    label: str = ""
    modal_mass: float | None = None
    along_node_axes: bool = False
    rounding: float = 6e-8
    scalar_points: int = 0
    where: str = ""
    position: FloatArray | None = None


AGAIN = "write the file again: it was cut short or altered"


def natural_frequency(eigenvalue: float) -> float:
    """f = √λ/2π [Hz] of an eigenvalue λ = ω² [1/s²]; −√|λ|/2π where it is negative."""
    return math.copysign(math.sqrt(abs(eigenvalue)) / math.tau, eigenvalue)


def check_motion(ids: IntArray, motion: FloatArray, where: str) -> None:
    """Raise DeckError unless ids (n,) are each there once and motion (n, k) is finite."""
    if (pair := repeated(ids)) is not None:
        raise DeckError(f"node {ids[pair[1]]} stands twice", where=where, remedy=AGAIN)
    finite = np.isfinite(motion).all(axis=1)
    if not finite.all():
        row = int(np.argmin(finite))
        said = ", ".join(f"{value:g}" for value in motion[row])
        raise DeckError(
            f"node {ids[row]} moves by {said}",
            where=where,
            remedy="look for errors in the output of that program, and write the file again",
        )


def check_frequency(frequency: float, where: str) -> None:
    """Raise DeckError unless a mode's frequency is a finite number."""
    if not math.isfinite(frequency):
        raise DeckError(f"the frequency of the mode is {frequency:g}", where=where, remedy=AGAIN)


def unsupported(what: str, where: str) -> DeckError:
    """A kind of result that is none of the two that are read."""
    return DeckError(
        f"{what}, no real mode or static response",
        where=where,
        remedy="write real normal modes or static displacements, in a file of their own",
    )


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
