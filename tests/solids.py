"""The solids as other sources describe them: what the package's own records are held against.

Corners, and edges in the order of their mid-side nodes, from VTK's class descriptions (vtkQuadraticTetra and others) and the
figures of the manuals: Nastran Quick Reference Guide, Abaqus Elements Guide, gmsh "Node ordering".
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np

Edges = tuple[tuple[int, int], ...]

TRIANGLE = ((0, 0), (1, 0), (0, 1))
SQUARE = ((0, 0), (1, 0), (1, 1), (0, 1))
TET = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
HEX = tuple((x, y, z) for z in (0, 1) for x, y in SQUARE)
WEDGE = tuple((x, y, z) for z in (0, 1) for x, y in TRIANGLE)
PYRAMID = (*HEX[:4], (0.25, 0.5, 1))
LOOP3, LOOP4 = ((0, 1), (1, 2), (2, 0)), ((0, 1), (1, 2), (2, 3), (3, 0))
UP3, UP4 = tuple((a, a + 3) for a in range(3)), tuple((a, a + 4) for a in range(4))
TOP3, TOP4 = tuple((a + 3, b + 3) for a, b in LOOP3), tuple((a + 4, b + 4) for a, b in LOOP4)
TET_EDGES = (*LOOP3, (0, 3), (1, 3), (2, 3))


@dataclass(frozen=True)
class Solid:
    """corners in a reference element; edges of VTK's and Abaqus' mid-side nodes, and of the others'; names in the formats:
    nastran the card, abaqus the type, gmsh the number of the type, vtk that of the cell, meshio the name of the cell; "" and
    0 where a program has no such element."""

    corners: tuple[tuple[float, ...], ...]
    nastran: str
    abaqus: str
    gmsh: int
    vtk: int
    meshio: str
    edges: Edges = ()
    nastran_edges: Edges = ()
    gmsh_edges: Edges = ()

    def points(self, edges: Edges | None = None) -> np.ndarray:
        """Nodes of a straight element of 1 × 1.25 × 1.5, mid-side nodes in the order of `edges` (None: VTK's)."""
        x = np.array(self.corners) * [1.0, 1.25, 1.5]
        return np.vstack([x, *((x[[a]] + x[[b]]) / 2 for a, b in (self.edges if edges is None else edges))])


SOLIDS = {
    "tet4": Solid(TET, "CTETRA", "C3D4", 4, 10, "tetra"),
    "tet10": Solid(
        *(TET, "CTETRA", "C3D10", 11, 24, "tetra10", TET_EDGES, TET_EDGES),
        gmsh_edges=((0, 1), (1, 2), (0, 2), (0, 3), (2, 3), (1, 3)),
    ),
    "hex8": Solid(HEX, "CHEXA", "C3D8", 5, 12, "hexahedron"),
    "hex20": Solid(
        *(HEX, "CHEXA", "C3D20", 17, 25, "hexahedron20", (*LOOP4, *TOP4, *UP4), (*LOOP4, *UP4, *TOP4)),
        gmsh_edges=tuple(sorted((min(edge), max(edge)) for edge in (*LOOP4, *TOP4, *UP4))),
    ),
    "wedge6": Solid(WEDGE, "CPENTA", "C3D6", 6, 13, "wedge"),
    "wedge15": Solid(
        *(WEDGE, "CPENTA", "C3D15", 18, 26, "wedge15", (*LOOP3, *TOP3, *UP3), (*LOOP3, *UP3, *TOP3)),
        gmsh_edges=tuple(sorted((min(edge), max(edge)) for edge in (*LOOP3, *TOP3, *UP3))),
    ),
    "pyra5": Solid(PYRAMID, "CPYRAM", "C3D5", 7, 14, "pyramid"),
}


def _kuhn() -> list[tuple[int, ...]]:
    """Six tetrahedra in a hexahedron: the paths along its edges from corner 0 to corner 6."""
    cuts = []
    for steps in permutations(np.eye(3, dtype=int).tolist()):
        a, b, c = (HEX.index(tuple(corner)) for corner in np.cumsum(steps, axis=0).tolist())
        cuts.append((0, a, b, c) if np.linalg.det(steps) > 0 else (0, b, a, c))
    return cuts


CUTS = {
    HEX: [tuple(range(8))],
    WEDGE: [(0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7)],
    TET: _kuhn(),
    PYRAMID: [(0, 1, 2, 3, 8), (7, 6, 5, 4, 8), (4, 5, 1, 0, 8), (5, 6, 2, 1, 8), (6, 7, 3, 2, 8), (7, 4, 0, 3, 8)],
}
"""How a hexahedron is cut into linear elements: wedges along the diagonal 0-2, pyramids on its facets with the node 8 inside."""
REGULAR = {
    TET: ((1, 1, 1), (-1, 1, -1), (1, -1, -1), (-1, -1, 1)),
    HEX: HEX,
    WEDGE: tuple((np.cos(a), np.sin(a), z) for z in (0, 3**0.5) for a in (0, 2 * np.pi / 3, 4 * np.pi / 3)),
    PYRAMID: (*HEX[:4], (0.5, 0.5, 0.5**0.5)),
}
"""Corners of the element whose sides are all of one length."""


def facets_point_outward(x: np.ndarray, facets) -> bool:
    """Whether the normals of all facets (of kinds and local nodes) of a straight element x (k, 3) point away from its middle."""
    return all(np.cross(x[b] - x[a], x[c] - x[a]) @ (x[a] - x.mean(axis=0)) > 0 for _, (a, b, c, *_) in facets)
