"""Matrices of a Nastran OUTPUT4 file: text or binary, dense, sparse, or sparse with many rows ("bigmat").

pyYeti reads them too, but holds every number as a Python object (0.1 KiB and a microsecond each) and does not return
from some damaged binary files.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy import sparse

from strainsight.decks.matrices.op4_binary import MARKERS, binary_matrices
from strainsight.decks.matrices.op4_parts import Column
from strainsight.decks.matrices.op4_text import text_matrices
from strainsight.errors import DeckError


def read_op4(path: Path, name: str | None = None) -> sparse.csr_array:
    """The matrix of that name (case does not count), or the only one.

    Raises DeckError for a name that is not there, a choice that is left open, complex numbers, a damaged file.
    """
    with path.open("rb") as file:
        binary = MARKERS.get(file.read(4))
    matrices = binary_matrices(path, *binary) if binary else text_matrices(path)
    found = None
    names: list[str] = []
    for header, columns in matrices:
        wanted = header.name.lower() == name.lower() if name else not names
        names.append(header.name)
        if wanted and found is not None:
            raise DeckError(
                f"it holds the matrix {header.name} twice",
                where=str(path),
                remedy="write every matrix under its own name",
            )
        if wanted:
            found = _collected(header.shape, columns)
        else:
            for _ in columns:
                pass
    if name is None and len(names) > 1:
        raise DeckError(
            f"it holds {len(names)} matrices: {', '.join(names)}", where=str(path), remedy="give the name of one"
        )
    if found is None:
        what = f"it holds no matrix {name!r}" if name else "it holds no matrix"
        raise DeckError(what, where=str(path), remedy=f"it has {', '.join(names) or 'none'}")
    return found


def _collected(shape: tuple[int, int], columns: Iterator[Column]) -> sparse.csr_array:
    values, column, row, count = array("d"), array("q"), array("q"), array("q")
    for number, rows, lengths, numbers in columns:
        values.frombytes(memoryview(numbers).cast("B"))
        column.extend([number] * len(rows))
        row.extend(rows)
        count.extend(lengths)
    n = np.array(count, dtype=np.int64)
    within = np.arange(n.sum()) - np.repeat(np.cumsum(n) - n, n)
    entries = np.frombuffer(values) if len(values) else np.zeros(0)
    place = (np.repeat(row, n) - 1 + within, np.repeat(column, n) - 1)
    csr = sparse.csr_array(sparse.coo_array((entries, place), shape=shape).tocsr())
    csr.eliminate_zeros()
    return csr
