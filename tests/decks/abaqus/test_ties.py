"""Supports, loads, masses, surfaces and ties of Abaqus decks mean the nodes and directions that the manual says."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strainsight.errors import DeckError
from strainsight.fem.constraints import constraint_transform

from ...refusals import expect_refusal, refusal_table

POINTS = np.array([(0, 0, 0), (2, 0, 0), (2, 3, 0), (0, 3, 0), (0, 0, 5), (2, 0, 5), (2, 3, 5), (0, 3, 5)], dtype=float)
NODES = "*NODE\n" + "".join(f"{i}, {x}, {y}, {z}\n" for i, (x, y, z) in enumerate(POINTS.tolist(), start=1))
MATERIAL = "*MATERIAL, NAME=M\n*ELASTIC\n1.,.3\n*DENSITY\n1.\n*SOLID SECTION, ELSET=E, MATERIAL=M\n"
BRICK = NODES + "*ELEMENT, TYPE=C3D8I, ELSET=E\n1, 1, 2, 3, 4, 5, 6, 7, 8\n" + MATERIAL
BRICK += "*NSET, NSET=TOP\n5, 6, 7, 8\n*NODE, NSET=REF\n100, 1., 1., 9.\n"
TOP = {4, 5, 6, 7}


def pairs(mesh):
    return {tuple(pair) for pair in mesh.fixed.tolist()}


@pytest.mark.parametrize(
    ("lines", "held"),
    [
        ("TOP, 1, 3", set(itertools.product(TOP, range(3)))),
        ("top, 1\nTOP, 2, 3, 0.", set(itertools.product(TOP, range(3)))),
        ("1, 3, , 0.0", {(0, 2)}),
        ("1, ENCASTRE", set(itertools.product([0], range(6)))),
        ("1, pinned", set(itertools.product([0], range(3)))),
        ("1, XSYMM", {(0, 0), (0, 4), (0, 5)}),
        ("1, YSYMM", {(0, 1), (0, 3), (0, 5)}),
        ("1, ZSYMM", {(0, 2), (0, 3), (0, 4)}),
        ("1, XASYMM", {(0, 1), (0, 2), (0, 3)}),
        ("1, 2, 6\n1, 2, 4", {(0, c) for c in range(1, 6)}),
    ],
)
def test_supports_in_every_form(read, lines, held):
    assert pairs(read(f"{BRICK}*BOUNDARY\n{lines}\n")) == held
    assert pairs(read(f"{BRICK}*STEP\n*STATIC\n*BOUNDARY\n{lines}\n*END STEP\n")) == held


def expected_axes(kind: str, a: np.ndarray, b: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Columns by angles about the pole, not by cross products."""
    if kind == "R":
        first = a / np.linalg.norm(a)
        second = b - first * (b @ first)
        second = second / np.linalg.norm(second)
        return np.column_stack([first, second, np.cross(first, second)])
    z = (b - a) / np.linalg.norm(b - a)
    radial = (x - a) - z * ((x - a) @ z)
    radial = radial / np.linalg.norm(radial)
    around = Rotation.from_rotvec(np.pi / 2 * z).apply(radial)
    if kind == "C":
        return np.column_stack([radial, around, z])
    r = (x - a) / np.linalg.norm(x - a)
    return np.column_stack([r, around, np.cross(r, around)])


@pytest.mark.parametrize("kind", "RCS")
def test_transform_rotates_supports_and_forces(read, kind):
    a, b = np.array([0.4, -0.3, 0.2]), np.array([-0.1, 1.2, 0.5])
    numbers = ", ".join(map(str, [*a.tolist(), *b.tolist()]))
    mesh = read(f"{BRICK}*TRANSFORM, NSET=TOP, TYPE={kind}\n{numbers}\n*CLOAD\nTOP, 2, 3.\n6, 1, 4.\n1, 1, 7.\n")
    assert set(mesh.axes) == TOP
    for node in TOP:
        np.testing.assert_allclose(mesh.axes[node], expected_axes(kind, a, b, POINTS[node]), atol=1e-14)
    load = mesh.loads["CLOAD-1"]
    force = dict(zip(load.nodes.tolist(), load.force, strict=True))
    np.testing.assert_allclose(force[4], 3 * mesh.axes[4][:, 1])
    np.testing.assert_allclose(force[5], 3 * mesh.axes[5][:, 1] + 4 * mesh.axes[5][:, 0])
    np.testing.assert_allclose(force[0], [7, 0, 0])


def test_each_load_keyword_is_one_load(read):
    mesh = read(
        BRICK
        + "*STEP\n*CLOAD\n1, 1, 5.\n1, 1, -2.\n*CLOAD\n1, 5, 9.\n*END STEP\n*STEP\n*CLOAD, AMPLITUDE=A\nREF, 3, 1.\n"
        "*END STEP\n"
    )
    assert set(mesh.loads) == {"CLOAD-1", "CLOAD-2", "CLOAD-3"}
    np.testing.assert_array_equal(mesh.loads["CLOAD-1"].force, [[3, 0, 0]])
    np.testing.assert_array_equal(mesh.loads["CLOAD-2"].moment, [[0, 9, 0]])
    np.testing.assert_array_equal(mesh.loads["CLOAD-3"].force, [[0, 0, 1]])
    assert mesh.ignored == {}


MASSES = "*ELEMENT, TYPE=MASS, ELSET=P\n50, 5\n51, REF\n*MASS, ELSET=P\n2.5,\n"
INERTIA = "*ELEMENT, TYPE=ROTARYI, ELSET=I\n60, {}\n*ROTARY INERTIA, ELSET=I\n3., 4., 5., .1, .2, .3\n"
TENSOR = np.array([(3, 0.1, 0.2), (0.1, 4, 0.3), (0.2, 0.3, 5)])


def test_rotary_inertia_is_added_to_point_mass(read):
    masses = read(BRICK + MASSES + INERTIA.format(100)).point_masses
    assert [(p.id, p.node, p.mass) for p in masses] == [(50, 4, 2.5), (51, 8, 2.5)]
    np.testing.assert_array_equal(masses[0].inertia, np.zeros((3, 3)))
    np.testing.assert_array_equal(masses[1].inertia, TENSOR)


def test_inertia_rotates_with_instance(read):
    instance = "*INSTANCE, NAME=I, PART=P\n0.,0.,0.\n1.,2.,3.,2.,4.,2., 40.\n*END INSTANCE\n"
    part, material = (
        BRICK.replace(MATERIAL, "*SOLID SECTION, ELSET=E, MATERIAL=M\n"),
        MATERIAL[: MATERIAL.index("*SOLID")],
    )
    text = f"*PART, NAME=P\n{part}{INERTIA.format(5)}*END PART\n*ASSEMBLY\n{instance}*END ASSEMBLY\n{material}"
    (point,) = read(text).point_masses
    axis = np.array([1, 2, -1]) / np.sqrt(6)
    R = Rotation.from_rotvec(np.radians(40) * axis).as_matrix()
    np.testing.assert_allclose(point.inertia, R @ TENSOR @ R.T, atol=1e-14)


# Facets as the element library lists them, nodes from one.
ABAQUS_FACETS = {
    "C3D8": ("1234", "5876", "1562", "2673", "3784", "4851"),
    "C3D4": ("123", "142", "243", "341"),
    "C3D6": ("123", "465", "1452", "2563", "3641"),
}


@pytest.mark.parametrize(
    ("type_", "number"), [(t, i) for t, facets in ABAQUS_FACETS.items() for i in range(len(facets))]
)
def test_surface_facets_follow_element_library(read, type_, number):
    facet = {int(n) for n in ABAQUS_FACETS[type_][number]}
    entries = {"C3D8": "1,2,3,4,5,6,7,8", "C3D4": "1,2,3,5", "C3D6": "1,2,3,5,6,7"}[type_].split(",")
    text = f"{NODES}*ELEMENT, TYPE={type_}, ELSET=E\n1, {', '.join(entries)}\n{MATERIAL}"
    mesh = read(f"{text}*SURFACE, NAME=F, TYPE=ELEMENT\nE, S{number + 1}\n*SURFACE, NAME=G\n1, s{number + 1}\n")
    expected = sorted(int(entries[n - 1]) for n in facet)
    assert list(mesh.node_sets["F"]) == list(mesh.node_sets["G"]) == expected


def test_surface_without_label_is_exterior(read):
    second = "*ELEMENT, TYPE=C3D8I, ELSET=E2\n2, 5, 6, 7, 8, 15, 16, 17, 18\n*SOLID SECTION, ELSET=E2, MATERIAL=M\n"
    nodes = "*NODE\n" + "".join(
        f"{i + 11}, {x}, {y}, {z + 5}\n" for i, (x, y, z) in enumerate(POINTS.tolist()) if i > 3
    )
    coupling = "*COUPLING, REF NODE=REF, SURFACE=S, CONSTRAINT NAME=C\n*DISTRIBUTING\n"
    mesh = read(BRICK + nodes + second + "*SURFACE, NAME=S\nE2,\n" + coupling)
    assert list(mesh.node_sets["S"]) == [5, 6, 7, 8, 15, 16, 17, 18]
    top, sides = 2 * 3, 2 * (2 + 3) * 5
    assert mesh.averaging[0].weight.sum() == pytest.approx(top + sides)


@pytest.mark.parametrize(
    "tie",
    [
        "*RIGID BODY, REF NODE=100, TIE NSET=TOP\n",
        "*RIGID BODY, REF NODE=REF, NSET=TOP\n",
        "*SURFACE, NAME=S, TYPE=NODE\nTOP,\n*COUPLING, REF NODE=REF, SURFACE=S\n*KINEMATIC\n",
        "*SURFACE, NAME=S\nE, S2\n*COUPLING, REF NODE=100, SURFACE=s\n*KINEMATIC\n1, 3\n",
        "*KINEMATIC COUPLING, REF NODE=100\nTOP, 1, 3\n",
        "*RIGID BODY, REF NODE=100, PIN NSET=TOP\n",
        "*MPC\nBEAM, TOP, 100\n",
        "*MPC\nBEAM, 5, REF\nBEAM, 6, REF\nBEAM, 7, REF\nBEAM, 8, REF\n",
    ],
)
def test_all_rigid_keywords_give_same_motion(read, tie):
    mesh = read(BRICK + tie)
    constraint = constraint_transform(mesh)
    z = np.zeros(constraint.transform.shape[1])
    motion = np.array([0.1, -0.2, 0.3, 0.4, -0.5, 0.6])
    rows = [*range(24, 27), *range(constraint.reference_rows[8], constraint.reference_rows[8] + 3)]
    for row, value in zip(rows, motion, strict=True):
        z[np.flatnonzero(constraint.free_rows == row)] = value
    u = (constraint.transform @ z)[:27].reshape(-1, 3)
    for node in TOP:
        expected = motion[:3] + np.cross(motion[3:], POINTS[node] - [1.0, 1.0, 9.0])
        np.testing.assert_allclose(u[node], expected, atol=1e-14)
    assert mesh.ignored == {}


@pytest.mark.parametrize("members", ["TIE NSET=TOP", "NSET=TOP", "PIN NSET=TOP"])
def test_rigid_body_without_reference_uses_first_node(read, members):
    """CalculiX adds a node for it: the body turns and moves about any point alike, and the same motions are left."""
    mesh, other = (read(f"{BRICK}*RIGID BODY, {members}{reference}\n") for reference in ("", ", REF NODE=100"))
    assert [(own.reference, set(own.nodes.tolist())) for own in mesh.rigid] == [(4, {5, 6, 7})]
    assert mesh.notes[-1].endswith("*RIGID BODY has no REF NODE, so its first node 5 is used")

    def motions(mesh):
        """Projection onto all motions of the brick's nodes that the tie leaves."""
        T = constraint_transform(mesh).transform[:24].toarray()
        return T @ np.linalg.pinv(T)

    assert np.linalg.matrix_rank(motions(mesh)) == 12 + 6
    np.testing.assert_allclose(motions(mesh), motions(other), atol=1e-12)


@pytest.mark.parametrize(
    ("surface", "weight"), [("TYPE=NODE\nTOP, 2.", 2.0), ("TYPE=NODE\nTOP", 1.0), ("TYPE=ELEMENT\nE, S2", 1.5)]
)
def test_distributing_coupling_weights_by_area(read, surface, weight):
    mesh = read(f"{BRICK}*SURFACE, NAME=S, {surface}\n*COUPLING, REF NODE=100, SURFACE=S\n*DISTRIBUTING\n")
    (averaging,) = mesh.averaging
    assert averaging.reference == 8
    assert averaging.components == (0, 1, 2, 3, 4, 5)
    np.testing.assert_array_equal(averaging.nodes, [4, 5, 6, 7])
    np.testing.assert_allclose(averaging.weight, weight)


NEAR = "*SURFACE, NAME=S\nE,\n*COUPLING, REF NODE=100, SURFACE=S, INFLUENCE RADIUS=5.\n*KINEMATIC\n"
COMPONENTS = "*SURFACE, NAME=S, TYPE=NODE\nTOP\n*COUPLING, REF NODE=100, SURFACE=S\n*KINEMATIC\n1,\n3, 4\n"


@pytest.mark.parametrize(
    ("tie", "nodes", "components"),
    [
        (COMPONENTS, TOP, (0, 2, 3)),
        (NEAR, set(np.flatnonzero(np.linalg.norm(POINTS - [1, 1, 9], axis=1) <= 5.0).tolist()), (0, 1, 2, 3, 4, 5)),
        ("*NODE\n105, 0., 0., 5.\n*MPC\nPIN, 105, 5\n", {9}, (0, 1, 2)),
    ],
)
def test_coupling_nodes_and_components(read, tie, nodes, components):
    (rigid,) = read(BRICK + tie).rigid
    assert (set(rigid.nodes.tolist()), rigid.components) == (nodes, components)
    assert rigid.reference == (4 if "PIN" in tie else 8)


def test_rot_node_controls_rotations(read):
    rot = "*NODE\n101, 1., 1., 9.\n*RIGID BODY, NSET=TOP, REF NODE=100, ROT NODE=101\n*BOUNDARY\n100, 1, 2\n101, 3\n"
    assert pairs(read(BRICK + rot)) == {(8, 0), (8, 1), (8, 5)}


def test_other_constraints_are_counted(read):
    mesh = read(BRICK + "*MPC\nLINK, 1, 5\nPIN, 2, 6\nCYCLSYM, 1, 2, 3, 4\n*SURFACE, NAME=A, TYPE=CYLINDER\n1.\n")
    assert mesh.ignored == {"*MPC CYCLSYM": 1, "*MPC LINK": 1, "*MPC PIN": 1, "*SURFACE, TYPE=CYLINDER": 1}
    assert mesh.rigid == ()


test_errors_have_line = refusal_table(lambda lines: f"{BRICK}{lines}\n", [
    ("*BOUNDARY\n77, 1", "node 77 is not in the deck", 2),
    ("*BOUNDARY\n1, 3, 2", "degrees of freedom 3 to 2", 2),
    ("*TRANSFORM, NSET=TOP\n1., 0., 0., 2., 0., 0.", "on one line", 2),
    ("*TRANSFORM, NSET=TOP, TYPE=C\n2., 3., 0., 2., 3., 1.", "node 7 is on the axis of the cylindrical system, where", 2),
    ("*ELEMENT, TYPE=MASS, ELSET=P\n50, 5", r"MASS 50 has no \*MASS", 2),
    ("*ELEMENT, TYPE=MASS, ELSET=P\n50, 5\n*MASS, ELSET=P\n-1.", "mass is -1", 4),
    (INERTIA.format(5).replace("3.,", "-3.,"), r"a principal moment of inertia is -3\.00622, negative", 4),
    ("*RIGID BODY", "REF NODE is missing", 1),
    ("*SURFACE, NAME=S\nE, S2\n*COUPLING, REF NODE=100, SURFACE=S", r"\*KINEMATIC or \*DISTRIBUTING is missing", 3),
    ("*SURFACE, NAME=S\nE, S7", "'S7' is not a facet of a hex8", 2),
    ("*SURFACE, NAME=S\nE, SPOS", "'SPOS' is not a facet", 2),
    ("*TRANSFORM, NSET=TOP\n1.,1.,0.,0.,1.,0.\n*KINEMATIC COUPLING, REF NODE=100\nTOP, 1, 2", "components are tied at node 5", 4),
], before=BRICK.count("\n"))


ROT = "*NODE\n101, 1., 1., 9.\n*RIGID BODY, NSET=TOP, REF NODE=100, ROT NODE=101\n"


def test_force_on_rot_node_is_moment(read):
    mesh = read(f"{BRICK}{ROT}*CLOAD\n101, 2, 5.\n100, 1, 3.\n")
    np.testing.assert_array_equal(mesh.loads["CLOAD-1"].nodes, [8])
    np.testing.assert_array_equal(mesh.loads["CLOAD-1"].force, [[3, 0, 0]])
    np.testing.assert_array_equal(mesh.loads["CLOAD-1"].moment, [[0, 5, 0]])
    assert mesh.ignored == {}


@pytest.mark.parametrize("element", ["*ELEMENT, TYPE=MASS, ELSET=P\n50, {}\n*MASS, ELSET=P\n2.\n", INERTIA])
def test_mass_on_rot_node_is_refused(read, element):
    read(BRICK + ROT + element.format(100))
    with expect_refusal(DeckError, r"refers to node 101, the ROT NODE of a \*RIGID BODY", remedy="REF NODE 100"):
        read(BRICK + ROT + element.format(101))


