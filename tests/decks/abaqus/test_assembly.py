"""Parts and instances of Abaqus decks, and what is wrong in a deck."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strainsight.errors import DeckError
from strainsight.mesh.sanity import unused_nodes

from ...records.test_record import same
from ...refusals import refusal_table
from .test_deck import TETRAHEDRON

POINTS = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)], dtype=float)
UP = np.array([0.0, 0.0, 5.0])
MESH = """\
*NODE, NSET=All
1, 0., 0., 0.
2, 1., 0., 0.
3, 0., 1., 0.
4, 0., 0., 1.
5, 1., 1., 1.
*NSET, NSET=Foot, GENERATE
1, 3, 1
*ELEMENT, TYPE=C3D4, ELSET=Body
1, 1, 2, 3, 4
2, 2, 3, 4, 5
*SOLID SECTION, ELSET=Body, MATERIAL=Steel
"""
MATERIAL = "*MATERIAL, NAME=Steel\n*ELASTIC\n2.1e11, .3\n*DENSITY\n7850.\n"


def assembly(*instances: str, inside: str = "", after: str = "", mesh: str = MESH) -> str:
    """A part W and its instances, each given by its lines ("" for one at its origin)."""
    placed = "".join(
        f"*INSTANCE, NAME=W-{i}, PART=w\n{lines}\n*END INSTANCE\n" for i, lines in enumerate(instances, start=1)
    )
    return f"*PART, NAME=W\n{mesh}*END PART\n*ASSEMBLY, NAME=A\n{placed}{inside}*END ASSEMBLY\n{MATERIAL}{after}"


def test_single_instance_equals_flat_deck(read):
    support = "*BOUNDARY\n{}Foot, 1, 3\n"
    flat = read(MESH + MATERIAL + support.format(""))
    placed = read(assembly("", after=support.format("W-1.")))
    for name in ("node_ids", "position", "blocks", "fixed", "regions", "materials", "node_sets", "element_sets", "notes"):
        assert same(getattr(placed, name), getattr(flat, name)), name
    assert flat.notes == ()


@pytest.mark.parametrize("seed", range(3))
def test_instance_is_translated_then_rotated(read, seed):
    rng = np.random.default_rng(seed)
    t, a, b, angle = rng.normal(size=3), rng.normal(size=3), rng.normal(size=3), rng.uniform(-180, 180)
    numbers = ", ".join(map(str, [*a.tolist(), *b.tolist(), angle]))
    mesh = read(assembly(f"{', '.join(map(str, t.tolist()))}\n{numbers}"))
    turn = Rotation.from_rotvec(np.radians(angle) * (b - a) / np.linalg.norm(b - a))
    np.testing.assert_allclose(mesh.position, a + turn.apply(POINTS + t - a), atol=1e-13)


def test_clashing_instance_ids_are_offset(read):
    mesh = read(assembly("", "0., 0., 5.", after="*BOUNDARY\nw-2.foot, 1, 1\nW-1.4, 2\n"))
    assert list(mesh.node_ids) == [1, 2, 3, 4, 5, 11, 12, 13, 14, 15]
    assert list(mesh.blocks[0].ids) == [1, 2, 11, 12]
    np.testing.assert_allclose(mesh.position[5:], POINTS + UP)
    np.testing.assert_array_equal(mesh.blocks[0].nodes[2:], mesh.blocks[0].nodes[:2] + 5)
    assert {name: list(ids) for name, ids in mesh.node_sets.items()} == {
        "W-1.All": [1, 2, 3, 4, 5],
        "W-1.Foot": [1, 2, 3],
        "W-2.All": [11, 12, 13, 14, 15],
        "W-2.Foot": [11, 12, 13],
    }
    assert {i: (r.name, r.material) for i, r in mesh.regions.items()} == {1: ("W-1.Body", 1), 2: ("W-2.Body", 1)}
    assert list(mesh.blocks[0].region) == [1, 1, 2, 2]
    assert {tuple(pair) for pair in mesh.fixed.tolist()} == {(5, 0), (6, 0), (7, 0), (3, 1)}
    assert [n for n in mesh.notes if n.startswith("the node ids of instance W-2 are increased by 10, and the element ids by 10")]
    assert mesh.where("node", 13) == mesh.where("node", 3)


def test_unique_instance_ids_are_unchanged(read):
    other = MESH
    for i in (5, 4, 3, 2, 1):
        other = other.replace(f"\n{i}, ", f"\n{i + 100}, ")
    other = other.replace("1, 2, 3, 4\n", "101, 102, 103, 104\n").replace("2, 3, 4, 5\n", "102, 103, 104, 105\n")
    other = other.replace("101, 3, 1", "101, 103, 1").replace("102, 101, 102", "102, 102")
    text = assembly("", inside="*INSTANCE, NAME=V-1, PART=V\n9., 9., 9.\n*END INSTANCE\n")
    mesh = read(f"*PART, NAME=V\n{other}*END PART\n{text}")
    assert list(mesh.node_ids) == [1, 2, 3, 4, 5, 101, 102, 103, 104, 105]
    assert list(mesh.element_sets["V-1.Body"]) == [101, 102]
    assert mesh.notes == ()


def test_assembly_sets_refer_to_instances(read):
    inside = (
        "*NODE, NSET=Pilot\n1, 9., 9., 9.\n"
        "*NSET, NSET=Ends, INSTANCE=W-1\n4, Foot\n*NSET, NSET=Ends, INSTANCE=W-2, GENERATE\n4, 5, 1\n"
        "*NSET, NSET=Mixed\nW-2.1, W-1.Foot, Pilot, 1\n*ELSET, ELSET=Upper, INSTANCE=W-2\n2,\n"
        "*NSET, NSET=Foot, INSTANCE=W-1\n5,\n"
    )
    mesh = read(assembly("", "0., 0., 5.", inside=inside))
    assert list(mesh.node_sets["Ends"]) == [1, 2, 3, 4, 14, 15]
    assert list(mesh.node_sets["Mixed"]) == [1, 2, 3, 11, 21]
    assert list(mesh.node_sets["Pilot"]) == [21]
    assert list(mesh.element_sets["Upper"]) == [12]
    assert list(mesh.node_sets["Foot"]) == [5]
    assert list(unused_nodes(mesh)) == [10]


def test_instance_with_separate_mesh(read):
    own = assembly(MESH.strip(), mesh="")
    moved = assembly("0., 0., 5.\n" + MESH.strip(), mesh="")
    np.testing.assert_array_equal(read(own).position, POINTS)
    np.testing.assert_allclose(read(moved).position, POINTS + UP)
    assert read(own).regions[1].name == "Body"


def test_assembly_section_refers_to_instance(read):
    mesh = MESH[: MESH.index("*SOLID")]
    section = "*SOLID SECTION, ELSET=W-1.Body, MATERIAL=Steel\n*SOLID SECTION, ELSET=w-2.body, MATERIAL=Steel\n"
    regions = read(assembly("", "0., 0., 5.", inside=section, mesh=mesh)).regions
    assert [region.name for region in regions.values()] == ["W-1.Body", "W-2.Body"]


@pytest.mark.parametrize("turned", [False, True])
def test_part_axes_rotate_with_instance(read, turned):
    mesh = MESH + "*TRANSFORM, NSET=Foot, TYPE=R\n0., 1., 0., -1., 0., 0.\n"
    lines = "0., 0., 0.\n1., 0., 0., 1., 1., 0., 90." if turned else ""
    expected = np.array([(0, 1, 0), (-1, 0, 0), (0, 0, 1)], dtype=float).T
    turn = Rotation.from_euler("y", 90, degrees=True).as_matrix() if turned else np.eye(3)
    axes = read(assembly(lines, mesh=mesh)).axes
    assert set(axes) == {0, 1, 2}
    np.testing.assert_allclose(axes[1], turn @ expected, atol=1e-15)


test_errors_have_line = refusal_table(assembly("").replace, [
    ("PART=w", "PART=v", "part 'v' is not in the deck", 16),
    ("*END PART\n", "", r"not allowed inside \*PART at", 14),
    ("*END INSTANCE\n", "", r"\*END ASSEMBLY: \*ASSEMBLY is missing before this line", 18),
    ("*END INSTANCE\n", "*END INSTANCE\n*INSTANCE, NAME=w-1, PART=W\n*END INSTANCE\n", "is defined twice", 19),
    ("PART=w\n\n", "PART=w\n0.,0.,0.\n1.,1.,1.,1.,1.,1.,30.\n", "points of the rotation axis coincide", 18),
    ("*END ASSEMBLY\n", "*NSET, NSET=A, INSTANCE=X\n1\n*END ASSEMBLY\n", "instance 'X' is not in the deck", 19),
    ("*END ASSEMBLY\n", "*NSET, NSET=A\nW-1.Head\n*END ASSEMBLY\n", "set 'W-1.Head' is not in the deck", 20),
    ("MATERIAL=Steel", "MATERIAL=Iron", "material 'Iron' is not", 13),
])


def instances(count: int) -> str:
    placed = "".join(
        f"*INSTANCE, NAME=I{i}, PART=W\n{2 * i}., 0., 0.\n*END INSTANCE\n*NSET, NSET=R{i}, INSTANCE=I{i}\n1, 2\n"
        for i in range(count)
    )
    supports = "".join(f"R{i}, 1\n" for i in range(count))
    return f"*PART, NAME=W\n{MESH}*END PART\n*ASSEMBLY, NAME=A\n{placed}*END ASSEMBLY\n{MATERIAL}*BOUNDARY\n{supports}"


def test_reading_time_is_linear(read):
    """Calls of Python functions for eight times as many instances, sets and supports: 8 times as many, not 64."""

    def calls(count: int) -> int:
        made = 0

        def counted(frame, event, argument) -> None:
            nonlocal made
            made += event == "call"

        text = instances(count)
        sys.setprofile(counted)
        try:
            read(text)
        finally:
            sys.setprofile(None)
        return made

    calls(2)  # what is imported and cached
    assert calls(160) < 9 * calls(20)


ELEMENT = "*ELEMENT, TYPE=C3D4, ELSET=EALL\n10, 1, 2, 3, 4"


test_errors_have_file_and_line = refusal_table(TETRAHEDRON.replace, [
    ("4, 0., 0., 1.", "3, 0., 0., 1.", "node id 3 is used twice .*deck.inp:7", 8),
    ("4, 0., 0., 1.", "4, 0., 0., one", "'one', not a number", 8),
    ("4, 0., 0., 1.", "99999999999999999999, 0., 0., 1.", "99999999999999999999, too large", 8),
    ("4, 0., 0., 1.", "*NGEN\n1, 3, 1", "NGEN: generated nodes and elements", 8),
    (ELEMENT, ELEMENT + "\n*ELGEN\n10, 2", "ELGEN: generated", 11),
    ("10, 1, 2, 3, 4", "10, 1, 2, 3, 5", "C3D4 10: node 5 is not in the deck", 10),
    ("10, 1, 2, 3, 4", "10, 1, 2, 3", "C3D4 10 has 3 nodes, but a C3D4 needs 4", 10),
    ("10, 1, 2, 3, 4", '10, "1, 2, 3, 4', "not an integer", 10),
    ("10, 1, 2, 3, 4", "10, 1, 2, 3, 4\n10, 2, 1, 3, 4", "element id 10 is used twice .*deck.inp:10", 11),
    ("10, 1, 2, 3, 4", "10, 1, 2, 3, 4\n11, 2, 3, 1, 4", "C3D4 11 has the same nodes as C3D4 10 at .*:10", 11),
    ("10, 1, 2, 3, 4\n", "", "the data lines are missing", 9),
    ("C3D4", "C3D27", "C3D27 solids are not supported", 9),
    ("C3D4", "M3D4R", "the deck contains no solid, shell or beam elements", "deck.inp"),
    ("C3D4", "S4R", "contains S4R 10, to which this section does not", 16),
    (ELEMENT, ELEMENT + "\n*ELEMENT, TYPE=C3D4\n11, 4, 1, 2, 3", "C3D4 11 has no section", 12),
    ("*SOLID SECTION, ELSET=EALL, MATERIAL=STEEL\n", "", "C3D4 10 has no section", 10),
    ("MATERIAL=STEEL", "MATERIAL=IRON", "material 'IRON' is not in the deck", 16),
    ("MATERIAL=STEEL", "MATERIAL=STEEL, COMPOSITE", "a COMPOSITE section must not have a MATERIAL", 16),
    ("*BOUNDARY", "*SOLID SECTION, ELSET=EALL, MATERIAL=STEEL\n*BOUNDARY", "element 10 already belongs to section", 17),
    ("*ELASTIC\n2.1e11, .3\n", "", "'Steel', but this material has no \\*ELASTIC", 11),
    ("*ELASTIC", "*ELASTIC, TYPE=TRACTION", "TYPE=TRACTION", 12),
    ("2.1e11, .3", "-2.1e11, .3", "Young's modulus is -2.1e\\+11", 13),
    ("2.1e11, .3", "2.1e11, .5", "Poisson's ratio is 0.5", 13),
    ("7850.", "-7850.", "density is -7850", 15),
    ("** a comment", "*INCLUDE, INPUT=deck.inp", "includes itself", 3),
    ("** a comment", "*PARAMETER\na=1", "named variables are not supported", 3),
    ("** a comment", "*PART, NAME=P", r"\*END PART is missing", 3),
    ("** a comment", "*STEP\n*NODE\n1,2,3,4", "inside a \\*STEP", 4),
    ("*BOUNDARY", "*NSET, NSET=A\n1, 77\n*BOUNDARY", "node 77 is not in the deck", 18),
    ("*BOUNDARY", "*NSET, NSET=A\n1, B\n*NSET, NSET=B\nA\n*BOUNDARY", "contains itself", 20),
    ("*BOUNDARY", "*NSET, NSET=A, GENERATE\n4, 2\n*BOUNDARY", "is decreasing", 18),
])


@pytest.mark.parametrize(
    "content", [b"", b"  \n", b"\0\1\2*NODE", b"hello\n", b"** only a comment\n", b"*NODE\n", b"*\n"]
)
def test_invalid_files_are_refused(read, content):
    with pytest.raises(DeckError):
        read(content)
