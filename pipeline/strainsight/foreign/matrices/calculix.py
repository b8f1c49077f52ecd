"""Matrices of CalculiX, of *FREQUENCY, SOLVER=MATRIXSTORAGE: .sti and .mas, and what their rows are, .dof."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy import sparse

from strainsight.decks.text import check_plain, parse_real, text_lines
from strainsight.errors import DeckError
from strainsight.foreign.matrices.op4 import LARGEST

AGAIN = "write it again, with SOLVER=MATRIXSTORAGE"


def read_calculix(path: Path, name: str | None) -> sparse.csr_array:
    """A symmetric matrix: lines "row column value", each pair below or above the diagonal once.

    Raises DeckError for a name, numbers of rows that are none, and a pair that stands on both sides.
    """
    if name is not None:
        raise DeckError(f"a matrix of CalculiX has no name, such as {name!r}", remedy="remove the name")
    entries = _entries(path)
    if entries.shape[1] != 3:
        raise DeckError(f"its lines have {entries.shape[1]} numbers, not row, column and value", remedy=AGAIN)
    whole = ((entries[:, :2] == np.floor(entries[:, :2])) & (entries[:, :2] >= 1) & (entries[:, :2] <= LARGEST)).all(
        axis=1
    )
    if not whole.all():
        i = int(np.argmin(whole))
        said = f"row {entries[i, 0]:g} and column {entries[i, 1]:g} of entry {i + 1} are not whole numbers from 1"
        raise DeckError(said, remedy=AGAIN)
    at = entries[:, :2].astype(np.int64)
    n = int(at.max())
    low, high = at.min(axis=1) - 1, at.max(axis=1) - 1
    if len(np.unique(low * n + high)) < len(at):
        raise DeckError("it holds both triangles, or an entry twice", remedy="write it again, or as Matrix Market")
    half = sparse.csr_array((entries[:, 2], (low, high)), shape=(n, n))
    full = sparse.csr_array(half + half.T - sparse.diags_array(half.diagonal()))
    full.eliminate_zeros()
    return full


def _entries(path: Path) -> np.ndarray:
    """(entries, 3) as numpy reads them; by our own reader, which is slower, where it cannot: exponents with D, or a fault in some
    line. Raises DeckError for a file without entries, with file:line for what is none."""
    check_plain(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of a file without lines, which text_lines refuses
        try:
            found = np.loadtxt(path, comments=None, ndmin=2)
        except ValueError:
            found = np.zeros((0, 3))
    if found.size:
        return found
    rows = []
    for number, line in enumerate(text_lines(path), start=1):
        values = [parse_real(word) for word in line.split()]
        if len(values) not in (0, 3) or None in values:
            said = f"{line.strip()[:60]!r} is not row, column and value"
            raise DeckError(said, where=f"{path}:{number}", remedy=AGAIN)
        rows += [values] if values else []
    return np.array(rows, dtype=float)


def read_dofs(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line number, and node and component of every row: lines "17.3". Raises DeckError for others."""
    for number, line in enumerate(text_lines(path), start=1):
        if text := line.strip():
            node, dot, component = text.partition(".")
            if not dot:
                raise DeckError(
                    f"{text[:40]!r} is no node.component", where=f"{path}:{number}", remedy="write it again"
                )
            yield number, [node, component]
