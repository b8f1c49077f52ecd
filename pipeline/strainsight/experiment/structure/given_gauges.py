"""Given gauges from their files: strain rows and a table of places."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy import sparse

from strainsight.errors import DeckError
from strainsight.foreign.matrices.files import csv_lines, read_matrix
from strainsight.foreign.ready import row_scale
from strainsight.sensors.given import GivenGauges, given_pool

COLUMNS = ("gauge", "x", "y", "z", "dx", "dy", "dz")


def read_given(rows: Path, table: Path, components: np.ndarray, length: float) -> GivenGauges:
    """Strain rows ε = R u [1/L on translations, 1/rad on rotations] and the table gauge,x,y,z,dx,dy,dz [L], L [m].

    components (r,) 0-5 of the rows of the matrices. Raises DeckError for files that cannot be read or do not fit together.
    """
    number, position, direction = given_table(table)
    R = _rows(rows, components, length)
    if R.shape[0] != len(number):
        raise DeckError(
            f"the matrix has {R.shape[0]} rows, {table.name} has {len(number)} gauges",
            where=str(rows),
            remedy="one row a gauge, in the order of the table",
        )
    return GivenGauges(given_pool(number, position * length, direction), R)


def _rows(path: Path, components: np.ndarray, length: float) -> sparse.csr_array:
    """The strain rows (m, r) in SI: R_SI = R s/L,  s = 1 for translations, L for rotations. Errors as `read_given`."""
    R = read_matrix(path)
    if R.shape[1] != len(components):
        raise DeckError(
            f"the matrix has {R.shape[1]} columns, the stiffness {len(components)} rows",
            where=str(path),
            remedy="one column for every line of mesh.matrices.numbering",
        )
    return sparse.csr_array(R @ sparse.diags_array(row_scale(components, length) / length))


def given_table(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Numbers (m,), positions and directions (m, 3) of the table, in its unit. Errors as `read_given`."""
    number: list[int] = []
    position, direction = [], []
    for line, cells in csv_lines(path, COLUMNS):
        try:
            gauge = int(cells[0])
            x = [float(cell) for cell in cells[1:4]]
            d = [float(cell or "0") for cell in cells[4:]]
        except ValueError:
            raise DeckError(
                f"{','.join(cells)[:60]!r} holds something that is no number",
                where=f"{path}:{line}",
                remedy="give a whole number, a position and a direction, which may be left blank",
            ) from None
        if not (np.isfinite([*x, *d]).all() and abs(gauge) < 2**62):
            raise DeckError(
                f"gauge {gauge} has a number that is not finite", where=f"{path}:{line}", remedy="correct it"
            )
        number.append(gauge)
        position.append(x)
        direction.append(d)
    if not number:
        raise DeckError("no gauge in the table", where=str(path), remedy=f"one line a gauge: {','.join(COLUMNS)}")
    ids, first = np.unique(number, return_index=True)
    if len(ids) < len(number):
        again = next(i for i in range(len(number)) if i not in set(first.tolist()))
        raise DeckError(
            f"gauge {number[again]} is there twice", where=f"{path}:{again + 2}", remedy="give each its own number"
        )
    return np.array(number, dtype=np.int64), np.array(position), np.array(direction)
