"""The same small mesh in the formats of gmsh, and real files of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

DATA = Path(__file__).parents[1] / "data"
REAL = sorted(DATA.glob("pin-*.msh"))

NAMES = """\
$PhysicalNames
2
2 4 "foot"
3 9 "steel part"
$EndPhysicalNames
"""
OLD = f"""\
$MeshFormat
2.2 0 8
$EndMeshFormat
{NAMES}$Nodes
5
10 0 0 0
7 1 0 0
30 0 1 0
4 0 0 1
5 1 1 1
$EndNodes
$Elements
3
1 2 2 4 1 10 7 30
6 4 2 9 1 10 7 30 4
8 4 2 9 2 7 30 4 5
$EndElements
"""
NEW = f"""\
$MeshFormat
4.1 0 8
$EndMeshFormat
{NAMES}$Entities
0 0 1 2
1 0 0 0 1 1 0 1 4 0
1 0 0 0 1 1 1 1 9 1 1
2 0 0 0 1 1 1 1 9 0
$EndEntities
$Nodes
2 5 4 30
2 1 0 3
10
7
30
0 0 0
1 0 0
0 1 0
3 1 0 2
4
5
0 0 1
1 1 1
$EndNodes
$Elements
3 3 1 8
2 1 2 1
1 10 7 30
3 1 4 1
6 10 7 30 4
3 2 4 1
8 7 30 4 5
$EndElements
"""
# The same with counts of blocks only, entities' tags before dimensions, and nodes in one line (format 4.0).
FORMER = f"""\
$MeshFormat
4 0 8
$EndMeshFormat
{NAMES}$Entities
1 0 1 2
1 0 0 0 0 0 0 0
1 0 0 0 1 1 0 1 4 0
1 0 0 0 1 1 1 1 9 1 1
2 0 0 0 1 1 1 1 9 0
$EndEntities
$Nodes
2 5
1 2 0 3
10 0 0 0
7 1 0 0
30 0 1 0
1 3 0 2
4 0 0 1
5 1 1 1
$EndNodes
$Elements
3 3
1 2 2 1
1 10 7 30
1 3 4 1
6 10 7 30 4
2 3 4 1
8 7 30 4 5
$EndElements
"""


def check_same(mesh, other):
    np.testing.assert_array_equal(mesh.node_ids, other.node_ids)
    np.testing.assert_allclose(mesh.position, other.position, rtol=1e-15, atol=1e-15)
    assert [b.kind for b in mesh.blocks] == [b.kind for b in other.blocks]
    for a, b in zip(mesh.blocks, other.blocks, strict=True):
        order, other_order = np.argsort(a.ids), np.argsort(b.ids)
        for x, y in ((a.ids, b.ids), (a.nodes, b.nodes), (a.region, b.region)):
            np.testing.assert_array_equal(x[order], y[other_order])
    assert mesh.regions == other.regions
    for sets, others in ((mesh.node_sets, other.node_sets), (mesh.element_sets, other.element_sets)):
        assert {k: v.tolist() for k, v in sets.items()} == {k: v.tolist() for k, v in others.items()}
