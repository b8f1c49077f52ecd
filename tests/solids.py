"""The solids as other sources describe them: what the package's own records are held against.

Corners, and edges in the order of their mid-side nodes, from VTK's class descriptions (vtkQuadraticTetra and others) and the
figures of the manuals: Nastran Quick Reference Guide, Abaqus Elements Guide, gmsh "Node ordering".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Edges = tuple[tuple[int, int], ...]

TRIANGLE = ((0, 0), (1, 0), (0, 1))
SQUARE = ((0, 0), (1, 0), (1, 1), (0, 1))
TET = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
HEX = tuple((x, y, z) for z in (0, 1) for x, y in SQUARE)
WEDGE = tuple((x, y, z) for z in (0, 1) for x, y in TRIANGLE)
LOOP3, LOOP4 = ((0, 1), (1, 2), (2, 0)), ((0, 1), (1, 2), (2, 3), (3, 0))
UP3, UP4 = tuple((a, a + 3) for a in range(3)), tuple((a, a + 4) for a in range(4))
TOP3, TOP4 = tuple((a + 3, b + 3) for a, b in LOOP3), tuple((a + 4, b + 4) for a, b in LOOP4)
TET_EDGES = (*LOOP3, (0, 3), (1, 3), (2, 3))


@dataclass(frozen=True)
class Solid:
    """corners in a reference element; edges of VTK's and Abaqus' mid-side nodes, and of the others'; names in the formats:
    nastran the card, abaqus the type, gmsh the number of the type, vtk that of the cell, meshio the name of the cell."""

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
}


def facets_point_outward(x: np.ndarray, facets) -> bool:
    """Whether the normals of all facets (of kinds and local nodes) of a straight element x (k, 3) point away from its middle."""
    return all(np.cross(x[b] - x[a], x[c] - x[a]) @ (x[a] - x.mean(axis=0)) > 0 for _, (a, b, c, *_) in facets)
