"""Elements of gmsh in our order: mid-side nodes on their edges, facets outward."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.mesh.kinds import kind_of

from ...solids import SOLIDS, facets_point_outward


def one_element(kind: str) -> str:
    solid = SOLIDS[kind]
    x = solid.points(solid.gmsh_edges)
    nodes = [f"{i} {p[0]} {p[1]} {p[2]}" for i, p in enumerate(x, 1)]
    element = f"1 {solid.gmsh} 2 1 1 " + " ".join(str(i) for i in range(1, len(x) + 1))
    parts = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", str(len(x)), *nodes, "$EndNodes"]
    return "\n".join([*parts, "$Elements", "1", element, "$EndElements", ""])


@pytest.mark.parametrize("kind", [kind for kind, solid in SOLIDS.items() if solid.gmsh])
def test_nodes_lie_where_vtk_says_and_normals_of_all_facets_point_outward(read, kind):
    mesh = read(one_element(kind))
    (block,) = mesh.blocks
    x = mesh.position[block.nodes[0]]
    assert block.kind == kind
    np.testing.assert_allclose(x, SOLIDS[kind].points(), atol=1e-15)
    assert facets_point_outward(x, kind_of(kind).facets)
