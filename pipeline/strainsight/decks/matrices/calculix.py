"""Matrices of CalculiX, of *FREQUENCY, SOLVER=MATRIXSTORAGE: .sti and .mas, and what their rows are, .dof."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy import sparse

from strainsight.decks.matrices.op4_parts import LARGEST
from strainsight.decks.text import text_lines
from strainsight.errors import DeckError


def read_calculix(path: Path, name: str | None) -> sparse.csr_array:
    """A symmetric matrix: lines "row column value", each pair below or above the diagonal once.

    Raises DeckError for a name, numbers of rows that are none, and a pair that stands on both sides.
    """
    if name is not None:
        raise DeckError(f"a matrix of CalculiX has no name, such as {name!r}", remedy="remove the name")
    entries = np.loadtxt(path, ndmin=2)
    if entries.size == 0 or entries.shape[1] != 3:
        raise DeckError("its lines are not row, column and value", remedy="write it again, with SOLVER=MATRIXSTORAGE")
    at = entries[:, :2].astype(np.int64)
    if (at != entries[:, :2]).any() or at.min() < 1 or at.max() > LARGEST:
        raise DeckError("its rows and columns are not whole numbers from 1", remedy="write it again")
    n = int(at.max())
    low, high = at.min(axis=1) - 1, at.max(axis=1) - 1
    if len(np.unique(low * n + high)) < len(at):
        raise DeckError("it holds both triangles, or an entry twice", remedy="write it again, or as Matrix Market")
    half = sparse.csr_array((entries[:, 2], (low, high)), shape=(n, n))
    full = sparse.csr_array(half + half.T - sparse.diags_array(half.diagonal()))
    full.eliminate_zeros()
    return full


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
