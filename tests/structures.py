"""Small named models of which several files make theirs: beams of Hermite elements, grids of hexahedra."""

from __future__ import annotations

import numpy as np

from .solids import HEX


def beam_matrices(elements: int, length: float, inertia: float, area: float) -> tuple[np.ndarray, np.ndarray]:
    """Bending stiffness and mass (elements, 4, 4) of Euler-Bernoulli elements, E = 1 and ρ = 1, on w and w' of both ends."""
    h = length / elements
    stiffness = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
                          [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]])  # fmt: skip
    mass = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2],
                     [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]])  # fmt: skip
    return tuple(np.tile(one, (elements, 1, 1)) for one in (inertia / h**3 * stiffness, area * h / 420 * mass))


def clamped_beam(blocks: np.ndarray) -> np.ndarray:
    """The matrix of a line of elements (e, 4, 4), clamped at its first end: w and w' of all other nodes."""
    whole = np.zeros((2 * len(blocks) + 2,) * 2)
    for e, block in enumerate(blocks):
        whole[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += block
    return whole[2:, 2:]


def beam_curvature(position: np.ndarray, elements: int, length: float) -> np.ndarray:
    """Rows that give w'' at distances from the root of a clamped beam."""
    h, rows = length / elements, np.zeros((len(position), 2 * elements + 2))
    for row, x in zip(rows, position, strict=True):
        e = min(int(x / h), elements - 1)
        s = x / h - e
        row[2 * e : 2 * e + 4] = (12 * s - 6) / h**2, (6 * s - 4) / h, (6 - 12 * s) / h**2, (6 * s - 2) / h
    return rows[:, 2:]


def hexahedra(counts: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Grid points (n, 3) in cells, their numbers (nx + 1, ny + 1, nz + 1), and cells (nx, ny, nz, 8) of a box."""
    number = np.arange(np.prod(np.add(counts, 1))).reshape(np.add(counts, 1))
    grid = np.stack(np.unravel_index(number.ravel(), number.shape), axis=-1)
    nx, ny, nz = counts
    cells = np.stack([number[i : nx + i, j : ny + j, k : nz + k] for i, j, k in HEX], axis=-1)
    return grid, number, cells
