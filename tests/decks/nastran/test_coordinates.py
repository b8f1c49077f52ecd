"""Points and directions in the systems of a deck are what other programs make of them."""

from __future__ import annotations

import io

import numpy as np
import pytest
from pyyeti import nastran

from strainsight.errors import DeckError

SYSTEMS = """\
CORD2R,1,0,1.,2.,3.,1.,2.,4.
+,2.,3.,3.
CORD2C,2,1,.1,.2,.3,.4,.1,1.
+,1.,.5,.2
CORD2S,3,2,1.,30.,.5,1.,40.,2.
+,2.,10.,.3
"""


def test_coordinates_in_nested_systems_are_what_pyyeti_computes(read, tetrahedron):
    local = {1: (0.3, -0.2, 0.7), 2: (1.5, 40.0, -0.3), 3: (2.0, 70.0, -25.0)}
    grids = "".join(f"GRID,{100 + c},{c},{x},{y},{z}\n" for c, (x, y, z) in local.items())
    mesh = read(SYSTEMS + grids + tetrahedron)
    uset, _ = nastran.bulk2uset(io.StringIO(SYSTEMS + grids))
    for c in local:
        expected = uset.loc[(100 + c, 1), "x":"z"].to_numpy(dtype=float)
        np.testing.assert_allclose(mesh.position[mesh.node_index(100 + c)], expected, atol=1e-13)


def test_a_quarter_turn_in_a_cylinder_is_the_y_axis(read, tetrahedron):
    mesh = read("CORD2C,4,,0.,0.,0.,0.,0.,1.\n+,1.,0.,0.\nGRID,9,4,2.,90.,5.\n" + tetrahedron)
    np.testing.assert_allclose(mesh.position[mesh.node_index(9)], [0, 2, 5], atol=1e-15)


CD = "GRID,{id},{cp},{x},{y},{z},{cd}\n"


@pytest.mark.parametrize("c", [1, 2, 3])
def test_directions_of_a_displacement_system_are_those_of_pyyeti(read, tetrahedron, c):
    """Its rigid-body translations are written along the directions of the node."""
    cards = SYSTEMS + "".join(
        CD.format(id=200 + i, cp=0, x=x, y=y, z=z, cd=c)
        for i, (x, y, z) in enumerate([(1.5, -0.3, 0.2), (-2.0, 0.4, -0.9), (0.1, 3.0, 1.0)])
    )
    mesh = read(cards + tetrahedron)
    uset, _ = nastran.bulk2uset(io.StringIO(cards))
    rigid = nastran.rbgeom_uset(uset, [0, 0, 0]).reshape(3, 6, 6)
    assert sorted(mesh.axes) == [mesh.node_index(200 + i) for i in range(3)]
    for i in range(3):
        np.testing.assert_allclose(mesh.axes[mesh.node_index(200 + i)].T, rigid[i, :3, :3], atol=1e-13)


@pytest.mark.parametrize(("shape", "middle"), [("C", (0.0, 0.0, 0.7)), ("S", (0.0, 0.0, -0.7)), ("S", (0.0, 0.0, 0.0))])
def test_on_the_axis_the_directions_are_those_that_define_the_system(read, tetrahedron, shape, middle):
    system = f"CORD2{shape},4,,.1,.2,.3,.4,.1,1.\n+,1.,.5,.2\n"
    frame = read(system.replace(f"CORD2{shape}", "CORD2R") + "GRID,9,,9.,9.,9.,4\n" + tetrahedron).axes[0]
    point = np.array([0.1, 0.2, 0.3]) + frame @ middle
    lost = "e_r and e_θ" if shape == "C" else "e_θ and e_φ"
    mesh = read(system + "GRID,9,,{:.12f},{:.12f},{:.12f},4\n".format(*point) + tetrahedron + "ENDDATA\n")
    np.testing.assert_allclose(mesh.axes[0], frame, atol=1e-10)
    assert mesh.notes == (
        f"1 of the nodes with CD = 4 lie on its axis (node 9), where {lost} have no direction: their components are along "
        "the rectangular axes that define it",
    )


@pytest.mark.parametrize("shape", "RCS")
def test_a_system_by_nodes_is_the_one_by_their_points(read, tetrahedron, shape):
    """The nodes themselves lie in a cylindrical system, one of them in a system by nodes again."""
    nodes = "GRID,31,2,.5,30.,.1\nGRID,32,3,1.5,50.,20.\nGRID,33,8,.2,.3,-.4\n"
    other = "CORD1R,8,31,32,4\n"
    probe = "GRID,40,7,.6,35.,-.25,7\nGRID,41,6,.6,35.,-.25\n"
    by_nodes = read(f"CORD1{shape},7,31,32,33,6,32,33,31\n" + probe + other + nodes + SYSTEMS + tetrahedron)
    points = [by_nodes.position[by_nodes.node_index(i)] for i in (31, 32, 33)]

    def by_points(cid, points):
        a, b, c = ([f"{x:.14f}" for x in point] for point in points)
        return f"CORD2{shape},{cid},,{','.join([*a, *b])}\n+,{','.join(c)}\n"

    cards = by_points(7, points) + by_points(6, (points[1], points[2], points[0])) + probe
    uset, _ = nastran.bulk2uset(io.StringIO(cards))
    rigid = nastran.rbgeom_uset(uset, [0, 0, 0])
    for number in (40, 41):
        expected = uset.loc[(number, 1), "x":"z"].to_numpy(dtype=float)
        np.testing.assert_allclose(by_nodes.position[by_nodes.node_index(number)], expected, atol=1e-12)
    np.testing.assert_allclose(by_nodes.axes[by_nodes.node_index(40)].T, rigid[:3, :3], atol=1e-12)


def test_grdset_fills_blank_fields_only(read, tetrahedron):
    system = "CORD2R,5,,1.,0.,0.,1.,0.,1.\n+,1.,1.,0.\n"
    deck = system + "GRDSET,,5,,,,5,12\n" + tetrahedron.replace("GRID,4,,0.,0.,1.", "GRID,4,0,0.,0.,1.,0,0")
    mesh = read(deck)
    # x' = y, y' = −x, about a point at x = 1
    np.testing.assert_allclose(mesh.position, [[1, 0, 0], [1, 1, 0], [0, 0, 0], [0, 0, 1]], atol=1e-15)
    assert sorted(mesh.axes) == [0, 1, 2]
    np.testing.assert_allclose(mesh.axes[0], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    permanent = read(deck.replace("SPC1,1,123,1,2,3\n", "")).fixed
    assert permanent.tolist() == [[0, 0], [0, 1], [1, 0], [1, 1], [2, 0], [2, 1]]


@pytest.mark.parametrize(
    ("card", "what"),
    [
        ("CORD2R,1,,0.,0.,0.,0.,0.,1.\n+,0.,0.,2.", "one line"),
        ("CORD2R,1,,0.,0.,0.,0.,0.,0.\n+,1.,0.,0.", "one line"),
        ("CORD2R,1,2,0.,0.,0.,0.,0.,1.\n+,1.,0.,0.", "system 2, which is not in the deck"),
        ("CORD2R,1,2,0.,0.,0.,0.,0.,1.\n+,1.,0.,0.\nCORD2R,2,1,0.,0.,0.,0.,0.,1.\n+,1.,0.,0.", "refers to itself"),
        ("CORD2R,1,,0.,0.,0.,0.,0.,1.\n+,1.,0.,0.\nCORD2C,1,,0.,0.,0.,0.,0.,1.\n+,1.,0.,0.", "stands twice"),
        ("CORD1R,1,1,2,9", "node 9 is not in the deck"),
        ("CORD1R,1,1,2,2", "one line"),
        ("CORD1R,1,1,2,3,1,1,2,4", "system id 1 stands twice"),
        ("CORD1R,1,1,2,60\nGRID,60,1,0.,1.,0.", "refers to itself"),
        ("CORD1R,1,1,2,60\nGRID,60,2,0.,1.,0.\nCORD1C,2,1,2,61\nGRID,61,1,0.,1.,0.", "refers to itself"),
        ("CORD1R,1,1,2,60\nGRID,60,7,0.,1.,0.", "system 7, which is not in the deck"),
    ],
)
def test_coordinate_systems_that_define_nothing_are_refused(read, tetrahedron, card, what):
    with pytest.raises(DeckError, match=what):
        read(card + "\n" + tetrahedron)
