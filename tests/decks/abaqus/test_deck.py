"""Solids, sections and materials of flat Abaqus decks arrive as written."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import DeckError

from ...refusals import expect_refusal
from .test_loads import bar

TETRAHEDRON = """\
*HEADING
 one tetrahedron
** a comment
*NODE, NSET=NALL
1, 0., 0., 0.
2, 1., 0., 0.
3, 0., 1., 0.
4, 0., 0., 1.
*ELEMENT, TYPE=C3D4, ELSET=EALL
10, 1, 2, 3, 4
*MATERIAL, NAME=Steel
*ELASTIC
2.1e11, .3
*DENSITY
7850.,
*SOLID SECTION, ELSET=EALL, MATERIAL=STEEL
*BOUNDARY
1, 1, 3
"""


def test_complete_deck(read):
    mesh = read(TETRAHEDRON)
    assert list(mesh.node_ids) == [1, 2, 3, 4]
    assert list(mesh.blocks[0].ids) == [10]
    assert mesh.regions[1].name == "EALL"
    material = mesh.materials[mesh.regions[1].material]
    assert (material.youngs_modulus, material.poisson_ratio, material.density) == (2.1e11, 0.3, 7850.0)
    assert {tuple(pair) for pair in mesh.fixed.tolist()} == {(0, 0), (0, 1), (0, 2)}
    assert (mesh.ignored, mesh.notes) == ({}, ())
    assert mesh.where("node", 3).endswith("deck.inp:7")
    assert mesh.where("element", 10).endswith("deck.inp:10")


def with_commas(comma):
    """CalculiX decks end keywords so: what follows is data where it begins with a number, or has one behind the name of a set."""
    text = TETRAHEDRON.replace("*ELASTIC", f"*ELASTIC{comma}").replace("*BOUNDARY", f"*BOUNDARY{comma}")
    return text.replace("*ELEMENT, TYPE=C3D4, ELSET=EALL", f"*ELEMENT{comma}\nTYPE=C3D4,\n  ELSET=EALL{comma}")


SAME = [
    TETRAHEDRON.lower(),
    TETRAHEDRON.replace("\n", "\r\n"),
    TETRAHEDRON.replace(", ", " ,\t"),
    TETRAHEDRON.replace("\n", "\n** between\n\n"),
    TETRAHEDRON.replace("*ELEMENT, TYPE=C3D4, ELSET=EALL", "*ELEMENT,\nTYPE=C3D4,\n ELSET=EALL"),
    TETRAHEDRON.replace("2.1e11", "2.1D+11").replace("1., 0., 0.\n", "1.D0,,\n"),
    "\ufeff" + TETRAHEDRON,
    *map(with_commas, (",", " , ", ",,")),
    # what CalculiX passes over
    TETRAHEDRON.replace("NAME=Steel\n", "NAME=STEEL   # what it is made of\n# and more\n"),
    TETRAHEDRON.replace("*BOUNDARY\n", "*EQUATION\n2\n1, 11, 1., 2, 11, -1.\n*BOUNDARY\n"),
    TETRAHEDRON.replace("10, 1, 2, 3, 4\n", "10, 1, 2, 3, 4, 77, 78,\n"),
]


@pytest.mark.parametrize("text", SAME)
def test_keyword_spelling_is_normalised(read, text):
    plain, altered = read(TETRAHEDRON), read(text)
    np.testing.assert_array_equal(altered.position, plain.position)
    np.testing.assert_array_equal(altered.blocks[0].nodes, plain.blocks[0].nodes)
    np.testing.assert_array_equal(altered.fixed, plain.fixed)
    assert replace(altered.materials[1], name="") == replace(plain.materials[1], name="")
    assert altered.materials[1].name.lower() == "material steel"
    assert (len(altered.materials), altered.relations) == (1, ())
    assert altered.ignored == {} or "EQUATION" in text


def test_include_and_input_files(read, tmp_path):
    plain = read(TETRAHEDRON)
    start, end = TETRAHEDRON.index("1, 0., 0., 0."), TETRAHEDRON.index("*ELEMENT")
    head, nodes, rest = TETRAHEDRON[:start], TETRAHEDRON[start:end], TETRAHEDRON[end:]
    (tmp_path / "nodes.txt").write_text("** nodes\n" + nodes)
    (tmp_path / "rest.inp").write_text(rest)
    mesh = read(head.replace("NSET=NALL", "NSET=NALL, INPUT=nodes.txt") + "*INCLUDE, INPUT=rest.inp\n")
    np.testing.assert_array_equal(mesh.position, plain.position)
    assert [name.rsplit("/")[-1] for name in mesh.included] == ["nodes.txt", "rest.inp"]
    assert mesh.where("node", 2).endswith("nodes.txt:3")
    assert mesh.where("element", 10).endswith("rest.inp:2")


def test_generated_and_nested_sets(read):
    nodes = "".join(f"{i}, {i}., {i * i}., {i**3}.\n" for i in range(11, 60, 2))
    sets = (
        "*NSET, NSET=G, GENERATE\n11, 31, 4\n40, 59\n*NSET, NSET=g\n13, 15,\n*NSET, NSET=ALL, UNSORTED\nG, 57, nall\n"
    )
    mesh = read(TETRAHEDRON.replace("4, 0., 0., 1.\n", "4, 0., 0., 1.\n" + nodes) + sets)
    there = set(range(11, 60, 2))
    G = {i for i in there if (11 <= i <= 31 and (i - 11) % 4 == 0) or 40 <= i <= 59 or i in (13, 15)}
    assert list(mesh.node_sets["G"]) == sorted(G)
    assert set(mesh.node_sets["ALL"]) == G | there | {1, 2, 3, 4}
    assert [note for note in mesh.notes if "that are not in the deck are left out (10 in total)" in note]


def test_a_node_set_of_an_element_set(read):
    more = "*ELEMENT, TYPE=M3D3, ELSET=SKIN\n20, 2, 3, 4\n*NSET, NSET=S, ELSET=SKIN\n*NSET, NSET=T, ELSET=EALL\n"
    mesh = read(TETRAHEDRON + more)
    assert list(mesh.node_sets["S"]) == [2, 3, 4]
    assert list(mesh.node_sets["T"]) == [1, 2, 3, 4]
    assert "SKIN" not in mesh.element_sets
    assert mesh.ignored == {"*ELEMENT, TYPE=M3D3": 1}


@pytest.mark.parametrize(
    ("lines", "point"),
    [
        ("*SYSTEM\n1., 2., 3.\n*NODE\n4, 0., 0., 1.", (1.0, 2.0, 4.0)),
        ("*SYSTEM\n1., 0., 0., 1., 1., 0.\n*NODE\n4, 0., 0., 1.", (1.0, 0.0, 1.0)),
        ("*SYSTEM\n0., 0., 0., 0., 0., 1.\n1., 0., 0.\n*NODE\n4, 0., 0., 1.", (0.0, 1.0, 0.0)),
        ("*SYSTEM\n1., 2., 3.\n*SYSTEM\n*NODE\n4, 0., 0., 1.", (0.0, 0.0, 1.0)),
        ("*NODE, SYSTEM=C\n4, 2., 60., 1.", (1.0, np.sqrt(3), 1.0)),
    ],
)
def test_system_applies_to_following_nodes(read, lines, point):
    mesh = read(TETRAHEDRON.replace("4, 0., 0., 1.", lines))
    np.testing.assert_allclose(mesh.position[mesh.node_index(4)], point, atol=1e-15)
    np.testing.assert_allclose(mesh.position[mesh.node_index(2)], [1, 0, 0])


@pytest.mark.parametrize(
    ("old", "new", "note"),
    [
        ("2.1e11, .3", "2.1e11, .3, 20.\n1.9e11, .3, 300.", "has 2 data lines of *ELASTIC; the values of the first"),
        ("*DENSITY\n7850.,\n", "", "no *DENSITY"),
        ("*BOUNDARY", "*SURFACE, NAME=CONTACT\n** none\n*BOUNDARY", "surface CONTACT has no data lines, so it is empty"),
    ],
)
def test_reinterpreted_input_is_noted(read, old, new, note):
    assert old in TETRAHEDRON
    assert any(note in text for text in read(TETRAHEDRON.replace(old, new)).notes)
    reduced = read(bar().replace("C3D20", "C3D20R")).notes[0]
    assert reduced.startswith("2 C3D20R elements imported as hex20: the element has full integration")


def test_regions_follow_the_sections(read):
    text = TETRAHEDRON.replace(
        "10, 1, 2, 3, 4\n", "10, 1, 2, 3, 4\n*NODE\n5, 1.,1.,1.\n*ELEMENT, TYPE=C3D4, ELSET=Upper\n11, 2, 3, 4, 5\n"
    )
    mesh = read(text + "*SOLID SECTION, ELSET=UPPER, MATERIAL=steel\n*MATERIAL, NAME=spare\n")
    assert {i: region.name for i, region in mesh.regions.items()} == {1: "EALL", 2: "Upper"}
    assert dict(zip(mesh.blocks[0].ids, mesh.blocks[0].region, strict=True)) == {10: 1, 11: 2}
    assert len(mesh.materials) == 1
    assert mesh.ignored == {"*MATERIAL that no section refers to": 1}


def test_structural_keywords_are_counted(read):
    text = TETRAHEDRON.replace("*DENSITY", "*PLASTIC\n1., 0.\n*DENSITY")
    mesh = read(
        text + "*ELEMENT, TYPE=DASHPOT1, ELSET=SP\n30, 4\n31, 3\n*DASHPOT, ELSET=SP\n3\n100.\n"
        "*TIE, NAME=T, CYCLIC SYMMETRY=YES\na, b\n"
        "*RESTART, WRITE\n*STEP, PERTURBATION\n*FREQUENCY\n10\n*NODE FILE\nU\n*EL PRINT\nS\n*NODE OUTPUT\nU\n*OUTPUT, FIELD\n"
        "*DLOAD\nEALL, GRAV, 9.81, 0., 0., -1.\n*END STEP\n"
    )
    assert mesh.ignored == {"*DASHPOT": 1, "*ELEMENT, TYPE=DASHPOT1": 2, "*PLASTIC": 1, "*TIE that is a symmetry": 1}


def test_windows_1252_names_are_decoded(read):
    text = TETRAHEDRON.replace("EALL", "Größe „5€“")
    assert list(read(text.encode("cp1252")).element_sets) == ["Größe „5€“"]
    assert list(read(text.encode()).element_sets) == ["Größe „5€“"]
    hole = TETRAHEDRON.replace("EALL", "N\x81\xfc").encode("latin-1")
    assert list(read(hole).element_sets) == ["N\x81ü"]


def test_text_before_first_keyword_is_counted(read):
    mesh = read(f">**\nmade by hand\n{TETRAHEDRON}")
    assert list(mesh.node_ids) == [1, 2, 3, 4]
    assert mesh.ignored["lines before the first keyword"] == 2
    assert mesh.effect["lines before the first keyword"] == "none"
    for text in ("SOL 103\nCEND\nBEGIN BULK\nGRID,1\n", f"a title\n4, 0., 0., 1.\n{TETRAHEDRON}"):
        with expect_refusal(DeckError, "before the first keyword", remedy="mesh.format: nastran"):
            read(text)
