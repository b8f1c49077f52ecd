"""Matrix Market files (.mtx): a banner, comments, the sizes, then one entry a line.

SciPy's reader ends the process with a segmentation fault where a line in the middle is none (seen with SciPy 1.17).
"""

from __future__ import annotations

from io import TextIOWrapper
from pathlib import Path
from typing import TextIO

import numpy as np
from scipy import sparse

from strainsight.decks.text import PACKING, SMALL, opened, parse_integer
from strainsight.errors import DeckError
from strainsight.foreign.matrices.op4 import LARGEST

REAL = ("real", "integer", "double", "unsigned-integer")
LONGEST = 10_000
"""Signs of a line above the entries."""
AGAIN = "write the matrix again: it was cut short or altered"


def read_market(path: Path) -> sparse.coo_array | np.ndarray:
    """The matrix, with both triangles where the file says that it is symmetric.

    Raises DeckError for complex, pattern and skew ones and for lines that are no entry; OSError, EOFError and zlib.error as
    reading does.
    """
    with opened(path) as raw, TextIOWrapper(raw, "ascii", "replace") as file:
        words = file.readline(LONGEST).lower().split()
        if len(words) != 5 or words[:2] != ["%%matrixmarket", "matrix"] or words[2] not in ("array", "coordinate"):
            raise DeckError("no Matrix Market file by its first line", where=f"{path}:1", remedy=AGAIN)
        layout, field, kind = words[2:]
        if field not in REAL or kind not in ("general", "symmetric"):
            raise DeckError(
                f"a {kind} {field} matrix", where=f"{path}:1", remedy="write it real, and general or symmetric"
            )
        rows, columns, entries, line = _sizes(file, path, layout, kind)
        size = path.stat().st_size
        # a line of one entry has two bytes at least, of its place and its value six
        if (2 if layout == "array" else 6) * entries > (
            max(SMALL, PACKING * size) if path.suffix.lower() == ".gz" else size
        ):
            raise DeckError(
                f"it claims {rows} × {columns} with {entries} entries, more than it can hold",
                where=str(path),
                remedy="write the matrix again",
            )
        table = _table(file, path, entries, 1 if layout == "array" else 3, line)
    return (
        _dense(table[:, 0], rows, columns, kind)
        if layout == "array"
        else _sparse(table, rows, columns, kind, path, line)
    )


def _sizes(file: TextIO, path: Path, layout: str, kind: str) -> tuple[int, int, int, int]:
    """Rows, columns, entries in the file, and the number of the line that says so."""
    number, text = 1, "%"
    while text.startswith("%") or (text and not text.strip()):
        text, number = file.readline(LONGEST), number + 1
    sizes = [parse_integer(word) for word in text.split()]
    rows, columns, *more = [size or 0 for size in sizes] if len(sizes) >= 2 else [0, 0]
    if None in sizes or len(more) != (layout == "coordinate") or not (0 < rows <= LARGEST and 0 < columns <= LARGEST):
        raise DeckError(f"{text.strip()[:60]!r} are no sizes of a matrix", where=f"{path}:{number}", remedy=AGAIN)
    if kind == "symmetric" and rows != columns:
        raise DeckError(f"a symmetric matrix of {rows} × {columns}", where=f"{path}:{number}", remedy=AGAIN)
    dense = columns * (columns + 1) // 2 if kind == "symmetric" else rows * columns
    return rows, columns, more[0] if more else dense, number


def _table(file: TextIO, path: Path, entries: int, width: int, line: int) -> np.ndarray:
    """(entries, width) numbers, one line each."""
    if entries <= 0:
        return np.zeros((0, width))
    try:
        table = np.loadtxt(file, comments=None, ndmin=2, max_rows=entries)
    except ValueError as error:
        said = str(error).partition(";")[0][:200]
        raise DeckError(
            f"a line below the sizes is no entry: {said}", where=f"{path}:{line + 1}", remedy=AGAIN
        ) from None
    if table.shape != (entries, width) or any(rest.strip() for rest in iter(lambda: file.readline(LONGEST), "")):
        there = f"{len(table)} entries" if len(table) < entries else f"more than {entries} entries"
        said = there if table.shape[1:] == (width,) else f"lines of {table.shape[1]} numbers"
        raise DeckError(f"{said} where {entries} are claimed", where=f"{path}:{line}", remedy=AGAIN)
    return table


def _dense(values: np.ndarray, rows: int, columns: int, kind: str) -> np.ndarray:
    """Entries column by column; of a symmetric matrix those on the diagonal and below."""
    if kind == "general":
        return values.reshape(columns, rows).T
    X = np.zeros((columns, columns))
    upper = np.triu_indices(columns)  # row by row as the lower ones column by column
    X[upper] = values
    X.T[upper] = values
    return X


def _sparse(table: np.ndarray, rows: int, columns: int, kind: str, path: Path, line: int) -> sparse.coo_array:
    place = table[:, :2]
    outside = ~((place >= 1) & (place <= [rows, columns]) & (place == np.floor(place))).all(axis=1)
    if outside.any():
        i, j = place[np.argmax(outside)]
        raise DeckError(
            f"entry {int(np.argmax(outside)) + 1} stands at ({i:g}, {j:g}) of a {rows} × {columns} matrix",
            where=f"{path}:{line}",
            remedy=AGAIN,
        )
    row, column = (place[:, k].astype(np.int64) - 1 for k in (0, 1))
    value = table[:, 2]
    if kind == "symmetric":
        off = row != column
        row, column = np.concatenate([row, column[off]]), np.concatenate([column, row[off]])
        value = np.concatenate([value, value[off]])
    return sparse.coo_array((value, (row, column)), shape=(rows, columns))
