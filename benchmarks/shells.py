"""K and M of shells: `python -m benchmarks.shells [UNKNOWNS]` (315 000 unless told).

A plate of square shells, and a plate of quadratic hexahedra with about as many unknowns as a peer; each in one run, processor
seconds of `build_model` without supports, and their ratio an unknown. Machines differ and are shared: the ratio says more.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np

from strainsight.fem.model import build_model
from strainsight.mesh.model import CellBlock, Material, Mesh, Region
from strainsight.mesh.thin import ShellBlock, ShellSection

CORNERS = ((0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2))
SIDES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))


PLATE = {1: Region(1, "plate", 1)}
STEEL = {1: Material(1, 2.1e11, 0.3, 7850.0)}


def shells(unknowns: int) -> Mesh:
    """n × n squares of 10 mm, 2 mm thick, with six unknowns a node."""
    n = round((unknowns / 6) ** 0.5) - 1
    grid = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    nodes = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=-1).reshape(-1, 4)
    x, y = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    position = 0.01 * np.column_stack([x.ravel(), y.ravel(), np.zeros(grid.size)])
    e = len(nodes)
    block = ShellBlock("quad4", 1 + np.arange(e), nodes, np.ones(e, int), np.zeros(e), np.full((e, 3), np.nan))
    mesh = Mesh(1 + np.arange(grid.size), position, (), shells=(block,), regions=PLATE, materials=STEEL)
    return replace(mesh, sections={1: ShellSection(0.002)})


def solids(unknowns: int) -> Mesh:
    """n × n × 1 quadratic hexahedra with about as many unknowns."""
    n = round((unknowns / 3 / 7) ** 0.5)
    half = np.array([2 * n, 2 * n, 2])
    steps = np.array(CORNERS + tuple(tuple((np.array(CORNERS[a]) + CORNERS[b]) // 2) for a, b in SIDES))
    i, j = (2 * own.ravel() for own in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    at = np.stack([i, j, 0 * i], axis=1)[:, None] + steps
    key = (at[..., 0] * (half[1] + 1) + at[..., 1]) * 3 + at[..., 2]
    used, nodes = np.unique(key, return_inverse=True)
    position = 0.005 * np.column_stack([used // 3 // (half[1] + 1), used // 3 % (half[1] + 1), used % 3])
    block = CellBlock("hex20", 1 + np.arange(len(key)), nodes.reshape(key.shape), np.ones(len(key), int))
    return Mesh(1 + np.arange(len(used)), position, (block,), regions=PLATE, materials=STEEL)


def main(words: list[str]) -> None:
    unknowns = int(words[0]) if words else 315_000
    print("| elements | unknowns | K and M, processor seconds | µs an unknown |\n|---|---|---|---|")
    for make in (shells, solids):
        mesh, start = make(unknowns), time.process_time()
        model = build_model(mesh, supported=False)
        spent = time.process_time() - start
        print(f"| {make.__name__} | {model.size} | {spent:.2f} | {1e6 * spent / model.size:.1f} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
