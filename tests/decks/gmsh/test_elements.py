"""Elements of gmsh in our order: mid-side nodes on their edges, facets outward."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.mesh.facets import FACETS

# Ends of the edges of mid-side nodes: the figures of the gmsh manual ("Node ordering"), and the class descriptions of
# vtkQuadraticTetra, vtkQuadraticHexahedron and vtkQuadraticWedge.
GMSH_EDGES = {
    "tet10": [(0, 1), (1, 2), (0, 2), (0, 3), (2, 3), (1, 3)],
    "hex20": [(0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7)],
    "wedge15": [(0, 1), (0, 2), (0, 3), (1, 2), (1, 4), (2, 5), (3, 4), (3, 5), (4, 5)],
}
VTK_EDGES = {
    "tet10": [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
    "hex20": [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)],
    "wedge15": [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)],
}
CORNERS = {
    "tet": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "hex": [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],
    "wed": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)],
}
NUMBER = {"tet4": 4, "hex8": 5, "wedge6": 6, "tet10": 11, "hex20": 17, "wedge15": 18}


def one_element(kind: str) -> str:
    corners = np.array(CORNERS[kind[:3]]) * [1.0, 1.25, 1.5]
    x = np.vstack([corners, *[(corners[a] + corners[b]) / 2 for a, b in GMSH_EDGES.get(kind, [])]])
    nodes = [f"{i} {p[0]} {p[1]} {p[2]}" for i, p in enumerate(x, 1)]
    element = f"1 {NUMBER[kind]} 2 1 1 " + " ".join(str(i) for i in range(1, len(x) + 1))
    parts = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", str(len(x)), *nodes, "$EndNodes"]
    return "\n".join([*parts, "$Elements", "1", element, "$EndElements", ""])


@pytest.mark.parametrize("kind", GMSH_EDGES)
def test_mid_side_nodes_lie_on_the_edges_that_vtk_says(read, kind):
    mesh = read(one_element(kind))
    (block,) = mesh.blocks
    x = mesh.position[block.nodes[0]]
    k = len(CORNERS[kind[:3]])
    assert block.kind == kind
    np.testing.assert_allclose(x[k:], [(x[a] + x[b]) / 2 for a, b in VTK_EDGES[kind]], atol=1e-15)


@pytest.mark.parametrize("kind", NUMBER)
def test_normals_of_all_facets_point_outward(read, kind):
    mesh = read(one_element(kind))
    x = mesh.position[mesh.blocks[0].nodes[0]]
    for _, local in FACETS[kind]:
        a, b, c = x[list(local[:3])]
        assert np.cross(b - a, c - a) @ (a - x.mean(axis=0)) > 0
