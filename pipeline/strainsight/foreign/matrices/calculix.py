"""Readers of CalculiX matrices (SOLVER=MATRIXSTORAGE) and of the nodes and components of their rows."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy import sparse

from strainsight.decks.text import check_plain, error_at, parse_real, text_lines
from strainsight.errors import DeckError
from strainsight.foreign.matrices.formats import LARGEST

WRITE_AGAIN = "export the matrix again with SOLVER=MATRIXSTORAGE"


def read_calculix(path: Path, name: str | None) -> sparse.csr_array:
    """A symmetric matrix: lines "row column value", each off-diagonal pair once. Raises DeckError for a name, invalid row
    numbers, and a pair that occurs twice."""
    if name is not None:
        raise DeckError(
            f"matrices in CalculiX files have no names, but `name` is set to {name!r}", remedy="remove `name`"
        )
    entries = _entries(path)
    if entries.shape[1] != 3:
        what = f"the number of values per line is {entries.shape[1]}, not 3 (row, column and value)"
        raise DeckError(what, remedy=WRITE_AGAIN)
    places = entries[:, :2]
    whole = ((places == np.floor(places)) & (places >= 1) & (places <= LARGEST)).all(axis=1)
    if not whole.all():
        i = int(np.argmin(whole))
        message = f"row {entries[i, 0]:g} and column {entries[i, 1]:g} of entry {i + 1} must be integers ≥ 1"
        raise DeckError(message, remedy=WRITE_AGAIN)
    at = places.astype(np.int64)
    n = int(at.max())
    low, high = at.min(axis=1) - 1, at.max(axis=1) - 1
    if len(np.unique(low * n + high)) < len(at):
        what = "the file contains both triangles of the matrix, or one entry twice"
        raise DeckError(what, remedy=f"{WRITE_AGAIN}, or write a Matrix Market file (.mtx)")
    half = sparse.csr_array((entries[:, 2], (low, high)), shape=(n, n))
    full = sparse.csr_array(half + half.T - sparse.diags_array(half.diagonal()))
    full.eliminate_zeros()
    return full


def _entries(path: Path) -> np.ndarray:
    """(entries, 3) read by NumPy, or by our slower reader for exponents with D and for error messages. Raises
    DeckError for a file without entries, with file:line for an invalid line."""
    check_plain(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # an empty file, for which text_lines raises the error
        try:
            entries = np.loadtxt(path, comments=None, ndmin=2)
        except ValueError:
            entries = np.zeros((0, 3))
    if entries.size:
        return entries
    rows = []
    for number, line in enumerate(text_lines(path), start=1):
        values = [parse_real(word) for word in line.split()]
        if len(values) not in (0, 3) or None in values:
            message = f"{line.strip()[:60]!r} does not consist of row, column and value"
            raise error_at(f"{path}:{number}", message, WRITE_AGAIN)
        rows += [values] if values else []
    return np.array(rows, dtype=float)


def read_dofs(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line number, and node and component of every row "17.3". Raises DeckError for other lines."""
    for number, line in enumerate(text_lines(path), start=1):
        if text := line.strip():
            node, dot, component = text.partition(".")
            if not dot:
                raise error_at(
                    f"{path}:{number}", f"{text[:40]!r} is not of the form node.component", "export the file again"
                )
            yield number, [node, component]
