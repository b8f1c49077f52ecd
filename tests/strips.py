"""A strip of quadrangles with lines along one side, as files that state no sections: gmsh text, and what meshio writes."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np

L, B, T = 1.0, 0.1, 0.01
E, RHO = 2.0e11, 7800.0
SKIN, SPAR, ROOT, TIP = 3, 3, 1, 5
"""Numbers of their groups: the surface and one of the lines share theirs."""


def grid(along: int = 8, across: int = 2) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Points (n, 3) of L × B on z = 0, quadrangles (e, 4), normal along z, and lines (k, 2): root, tip, and spar on y = 0."""
    number = np.arange((along + 1) * (across + 1)).reshape(along + 1, across + 1)
    x, y = np.meshgrid(np.linspace(0, L, along + 1), np.linspace(0, B, across + 1), indexing="ij")
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    sides = {"root": number[0], "spar": number[:, 0], "tip": number[-1]}
    lines = {name: np.column_stack([own[:-1], own[1:]]) for name, own in sides.items()}
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]), quads, lines


def gmsh(unit: float = 1.0, **size: int) -> str:
    """Format 2.2: physical surface 3 "skin", physical lines 3 "spar", 1 "root", 5 without a name."""
    points, quads, lines = grid(**size)
    rows = [(1, tag, own) for tag, name in ((ROOT, "root"), (SPAR, "spar"), (TIP, "tip")) for own in lines[name]]
    rows += [(3, SKIN, own) for own in quads]
    return "\n".join(
        [
            "$MeshFormat\n2.2 0 8\n$EndMeshFormat",
            f'$PhysicalNames\n3\n1 {ROOT} "root"\n1 {SPAR} "spar"\n2 {SKIN} "skin"\n$EndPhysicalNames',
            f"$Nodes\n{len(points)}",
            *(f"{i} {' '.join(map(repr, own))}" for i, own in enumerate((points / unit).tolist(), 1)),
            f"$EndNodes\n$Elements\n{len(rows)}",
            *(f"{i} {kind} 2 {tag} {tag} {' '.join(map(str, own + 1))}" for i, (kind, tag, own) in enumerate(rows, 1)),
            "$EndElements\n",
        ]
    )


def triangles(quads: np.ndarray) -> np.ndarray:
    """Two of each."""
    return quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)


def vtu(path: Path, **size: int) -> Path:
    """The same with the cell data `region`, half of the skin in triangles; sets of nodes are data that are 0 or 1."""
    points, quads, lines = grid(**size)
    half = len(quads) // 2
    cells = [("quad", quads[:half]), ("triangle", triangles(quads[half:])), ("line", lines["spar"])]
    region = [np.full(len(own), tag) for (_, own), tag in zip(cells, (7, 7, 7), strict=True)]
    sets = {name: np.isin(np.arange(len(points)), own).astype(int) for name, own in lines.items()}
    meshio.Mesh(points, cells, cell_data={"region": region}, point_data=sets).write(path)
    return path
