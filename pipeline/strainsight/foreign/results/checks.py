"""What every reader of results asks of its numbers, and says of what it refuses."""

from __future__ import annotations

import math

import numpy as np

from strainsight.decks.faults import repeated
from strainsight.errors import DeckError
from strainsight.mesh.thin import FloatArray, IntArray

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
