"""What is wrong with a flat Abaqus deck of solids is named with its line."""

from __future__ import annotations

import pytest

from strainsight.errors import DeckError

from .test_deck import TETRAHEDRON, one_element

ELEMENT = "*ELEMENT, TYPE=C3D4, ELSET=EALL\n10, 1, 2, 3, 4"


@pytest.mark.parametrize(
    ("old", "new", "what", "line"),
    [
        ("4, 0., 0., 1.", "3, 0., 0., 1.", "node id 3 stands twice .*deck.inp:7", 8),
        ("4, 0., 0., 1.", "-4, 0., 0., 1.", "-4 is not positive", 8),
        ("4, 0., 0., 1.", "4, 0., 0., one", "'one', not a number", 8),
        ("4, 0., 0., 1.", "4, 0., 0., nan", "'nan', not a number", 8),
        ("4, 0., 0., 1.", "4., 0., 0., 1.", "'4.', not an integer", 8),
        ("4, 0., 0., 1.", "4_0, 0., 0., 1.", "'4_0', not an integer", 8),
        ("4, 0., 0., 1.", "99999999999999999999, 0., 0., 1.", "99999999999999999999, too large", 8),
        ("4, 0., 0., 1.", "4, 0., 0., 1.\n1000000000000, 0., 0., 1.", "1000000000000, too large", 9),
        (ELEMENT, ELEMENT[:-1] + "1000000000000", "entry 5 is 1000000000000, too large", 10),
        ("4, 0., 0., 1.", "*NGEN\n1, 3, 1", "NGEN: generated meshes", 8),
        ("4, 0., 0., 1.", "*NODE, SYSTEM=S\n4, 0., 0., 1.", "SYSTEM=S", 8),
        ("4, 0., 0., 1.", "*SYSTEM\n0.,0.,0.,1.,0.,0.\n2.,0.,0.", "on one line", 9),
        (ELEMENT, ELEMENT + "\n*ELGEN\n10, 2", "ELGEN: generated", 11),
        ("10, 1, 2, 3, 4", "10, 1, 2, 3, 5", "C3D4 10: node 5 is not in the deck", 10),
        ("10, 1, 2, 3, 4", "10, 1, 2, 3, 3", "C3D4 10: a node stands twice", 10),
        ("10, 1, 2, 3, 4", "10, 1, 2, 3", "C3D4 10: 3 nodes, where a C3D4 has 4", 10),
        ("10, 1, 2, 3, 4", "10, 1, 2, 3, 4, 1", "C3D4 10: 5 nodes, where a C3D4 has 4", 10),
        ("10, 1, 2, 3, 4", "9, 4, 2, 3, 1\n10, 1, 2, 3\n11, 2, 1, 3, 4", "C3D4 10: 3 nodes", 11),
        ("10, 1, 2, 3, 4", "10, 1, 2, 3, x", "'x', not an integer", 10),
        ("10, 1, 2, 3, 4", "10, 1, 2, , 4", "'', not an integer", 10),
        ("10, 1, 2, 3, 4", ",\n11, 1, 2, 3", "'', not an integer", 10),
        ("10, 1, 2, 3, 4", '10, "1, 2, 3, 4', "not an integer", 10),
        ("10, 1, 2, 3, 4", "0, 1, 2, 3, 4", "0 is not positive", 10),
        ("10, 1, 2, 3, 4", "10, 1, 2, 3, 4\n10, 2, 1, 3, 4", "element id 10 stands twice .*deck.inp:10", 11),
        ("10, 1, 2, 3, 4", "10, 1, 2, 3, 4\n11, 2, 3, 1, 4", "C3D4 11: the same nodes as C3D4 10 at .*:10", 11),
        ("10, 1, 2, 3, 4\n", "", "no data line", 9),
        ("TYPE=C3D4, ", "", "has no TYPE", 9),
        ("C3D4", "C3D27", "C3D27 solids are not supported", 9),
        ("C3D4", "C3D8T", "C3D8T solids are not supported", 9),
        ("C3D4", "M3D4R", "no solid element, and no shell or beam", None),
        ("C3D4", "S4R", "S4R 10 is a shell", 16),
        ("C3D4, ELSET=EALL", "C3D4, ELSET=OTHER", "element set 'EALL' is not in the deck", 16),
        (ELEMENT, ELEMENT + "\n*ELEMENT, TYPE=C3D4\n11, 4, 1, 2, 3", "C3D4 11 has no section", 12),
        ("*SOLID SECTION, ELSET=EALL, MATERIAL=STEEL\n", "", "C3D4 10 has no section", 10),
        (", MATERIAL=STEEL", "", "has no MATERIAL", 16),
        ("MATERIAL=STEEL", "MATERIAL=IRON", "material 'IRON' is not in the deck", 16),
        ("MATERIAL=STEEL", "MATERIAL=STEEL, COMPOSITE", "it is COMPOSITE and has a MATERIAL", 16),
        ("*BOUNDARY", "*SOLID SECTION, ELSET=EALL, MATERIAL=STEEL\n*BOUNDARY", "in the section of EALL already", 17),
        ("*ELASTIC\n2.1e11, .3\n", "", "'Steel' of a section has no \\*ELASTIC", 11),
        ("*ELASTIC", "*ELASTIC, TYPE=TRACTION", "TYPE=TRACTION", 12),
        ("*ELASTIC", "*ELASTIC, TYPE=ENGINEERING CONSTANTS", "1 lines, and 9 constants need 2", 12),
        ("*MATERIAL, NAME=Steel\n", "", "stands before any \\*MATERIAL", 11),
        ("*DENSITY", "*ELASTIC\n1., .3\n*DENSITY", "stands twice in the material", 14),
        ("2.1e11, .3", "-2.1e11, .3", "Young's modulus is -2.1e\\+11", 13),
        ("2.1e11, .3", "2.1e11, .5", "Poisson's ratio is 0.5", 13),
        ("2.1e11, .3", "2.1e11, -1", "Poisson's ratio is -1", 13),
        ("2.1e11, .3", "", "no data line", 12),
        ("7850.", "-7850.", "density is -7850", 15),
        ("*HEADING", "1, 2\n*HEADING", "before the first keyword", 1),
        ("** a comment", "*INCLUDE, INPUT=deck.inp", "includes itself", 3),
        ("** a comment", "*INCLUDE, INPUT=../deck.inp", "leaves the folder", 3),
        ("** a comment", "*INCLUDE, INPUT=none.inp", "no such file", 3),
        ("** a comment", "*INCLUDE", "has no INPUT", 3),
        ("** a comment", "*PARAMETER\na=1", "parameters are not supported", 3),
        ("** a comment", "*PART, NAME=P", "no \\*END PART follows", 3),
        ("** a comment", "*END PART", "no \\*PART to end", 3),
        ("** a comment", "*STEP\n*NODE\n1,2,3,4", "inside a \\*STEP", 4),
        ("*BOUNDARY", "*STEP\n*BOUNDARY", "no \\*END STEP follows", 17),
        ("*BOUNDARY", "*NSET, NSET=A\n1, 77\n*BOUNDARY", "node 77 is not in the deck", 18),
        ("*BOUNDARY", "*NSET, NSET=A\n1, B\n*BOUNDARY", "node set 'B' is not in the deck", 18),
        ("*BOUNDARY", "*NSET, NSET=A\n1, B\n*NSET, NSET=B\nA\n*BOUNDARY", "contains itself", 20),
        ("*BOUNDARY", "*NSET, NSET=A, GENERATE\n4, 2\n*BOUNDARY", "runs backwards", 18),
        ("*BOUNDARY", "*NSET, NSET=A, ELSET=B\n*BOUNDARY", "element set 'B' is not in the deck", 17),
    ],
)
def test_what_is_wrong_is_named_with_file_and_line(read, old, new, what, line):
    assert old in TETRAHEDRON
    with pytest.raises(DeckError, match=what) as caught:
        read(TETRAHEDRON.replace(old, new))
    assert caught.value.where.endswith("deck.inp" if line is None else f"deck.inp:{line}")
    assert caught.value.remedy
    assert caught.value.exit_code == 2


@pytest.mark.parametrize(
    "content", [b"", b"  \n", b"\0\1\2*NODE", b"hello\n", b"** only a comment\n", b"*NODE\n", b"*\n"]
)
def test_files_that_are_no_deck_are_refused(read, content):
    with pytest.raises(DeckError):
        read(content)


@pytest.mark.parametrize("kind", ["tet10", "hex20"])
def test_a_deck_cut_off_before_its_material_is_complete_is_refused(read, kind):
    text = one_element(kind)
    for end in range(0, text.index("*DENSITY"), 7):
        with pytest.raises(DeckError) as caught:
            read(text[:end])
        assert caught.value.remedy


def test_a_circle_of_included_files_is_named(read, tmp_path):
    (tmp_path / "a.inp").write_text("*INCLUDE, INPUT=deck.inp\n")
    with pytest.raises(DeckError, match="includes itself") as caught:
        read("*INCLUDE, INPUT=a.inp\n")
    assert caught.value.where.endswith("a.inp:1")
