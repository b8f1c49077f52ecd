"""Supports, rigid and averaging elements, masses and sets."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import DeckError

ALL = {(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (2, 0), (2, 1), (2, 2)}


def pairs(mesh):
    return {tuple(map(int, pair)) for pair in mesh.fixed}


@pytest.mark.parametrize(
    "cards",
    [
        "SPC1,1,123,1,2,3",
        "SPC1,1,123,1,THRU,3",
        "SPC1,1,321,1,THRU,3",
        "SPC,1,1,123,,2,123\nSPC,1,3,123,0.",
        "SPC1,1,1,1,2,3\nSPC1,1,23,1,2,3\nSPC1,1,12,1",
        "SPCADD,7,1,2\nSPC1,1,12,1,2,3\nSPC1,2,3,1,2,3",
        "SPC1,1,123,2,THRU,3\nGRDX",
    ],
)
def test_supports_in_every_form_are_the_same_pairs(read, tetrahedron, cards):
    text = tetrahedron.replace("SPC1,1,123,1,2,3", cards)
    if "GRDX" in cards:
        text = text.replace("GRDX\n", "").replace("GRID,1,,0.,0.,0.", "GRID,1,,0.,0.,0.,,123")
    assert pairs(read(text)) == ALL


def test_a_range_takes_the_nodes_that_exist(read, tetrahedron):
    mesh = read(tetrahedron.replace("SPC1,1,123,1,2,3", "SPC1,1,3,3,THRU,99999999"))
    assert pairs(mesh) == {(2, 2), (3, 2)}


def test_the_case_control_selects_the_set(read, tetrahedron):
    bulk = tetrahedron + "SPC1,2,3,4\nSPC1,3,1,4\nSPCADD,9,2,3\n"
    assert pairs(read(f"SPC = 2\nBEGIN BULK\n{bulk}")) == {(3, 2)}
    assert pairs(read(f"CEND\nspc=9\nSPCFORCES = ALL\nBEGIN BULK\n{bulk}")) == {(3, 0), (3, 2)}
    assert read(f"SPC = 1\nBEGIN BULK\n{bulk}").ignored == {"SPC1 of a set that is not selected": 2}


def test_no_support_at_all_is_an_empty_list(read, tetrahedron):
    assert read(tetrahedron.replace("SPC1,1,123,1,2,3\n", "")).fixed.shape == (0, 2)


@pytest.mark.parametrize(
    ("head", "cards", "what"),
    [
        ("", "SPC1,2,3,4", "2 sets of supports \\(1, 2\\) and no selection"),
        ("SPC = 5\nBEGIN BULK\n", "", "SPC = 5 selects a set that is not in the deck"),
        ("SUBCASE 1\nSPC = 1\nSUBCASE 2\nSPC = 2\nBEGIN BULK\n", "SPC1,2,3,4", "different supports"),
        ("", "SPCADD,9,1,2", "set 2 has no SPC"),
        ("", "SPC1,1,123,9", "node 9 is not in the deck"),
        ("", "SPC1,1,127,4", "components '127'"),
        ("", "SPC1,1,,4", "components ''"),
        ("", "SPC1,1,113,4", "components '113'"),
        ("", "SPC1,1,123,8,THRU,9", "holds no node"),
        ("", "SPC1,1,123,4,THRU,2", "runs backwards"),
        ("", "SPC1,1,123,4,TO,2", "'TO' is no id"),
        ("", "SPC,1,4,123,.1", "enforced displacement"),
        ("", "GRID,5,,1.,1.,1.,6\nSPC1,1,12,5", "along its own system CD"),
    ],
)
def test_supports_that_cannot_be_taken_are_named(read, tetrahedron, head, cards, what):
    with pytest.raises(DeckError, match=what) as caught:
        read(head + tetrahedron + cards + "\n")
    assert "deck.bdf:" in caught.value.where


def test_all_three_components_of_a_turned_node_are_the_same_in_every_system(read, tetrahedron):
    mesh = read(tetrahedron + "GRID,5,,1.,1.,1.,6\nSPC1,1,123,5\n")
    assert {(4, 0), (4, 1), (4, 2)} < pairs(mesh)
    assert mesh.ignored == {"GRID displacement system CD": 1}


def test_rbe2_keeps_reference_dependents_and_translations(read, tetrahedron):
    (rigid,) = read(tetrahedron + "GRID,50,,5.,5.,5.\nRBE2,99,50,123456,2,THRU,4,1.-5\n").rigid
    assert (rigid.id, rigid.reference, rigid.components) == (99, 4, (0, 1, 2))
    assert sorted(rigid.nodes) == [1, 2, 3]


def test_rbe3_weights_belong_to_their_groups(read, tetrahedron):
    card = "RBE3,98,,50,123456,1.5,123,1,2\n+,.5,123,3,4,ALPHA,1.-5\n"
    (averaging,) = read(tetrahedron + "GRID,50,,5.,5.,5.\n" + card).averaging
    assert (averaging.reference, averaging.components) == (4, (0, 1, 2, 3, 4, 5))
    assert list(averaging.nodes) == [0, 1, 2, 3]
    np.testing.assert_array_equal(averaging.weight, [1.5, 1.5, 0.5, 0.5])


@pytest.mark.parametrize(
    ("cards", "what"),
    [
        ("RBE2,99,51,123,4", "node 51 is not in the deck"),
        ("RBE2,99,50,123,4,77", "node 77 is not in the deck"),
        ("RBE2,99,50,123", "no dependent node"),
        ("RBE2,99,50,123,4,50", "also dependent"),
        ("RBE2,99,50,456,4", "rotations only"),
        ("RBE2,99,50,,4", "components ''"),
        ("RBE2,99,50,123,4\nRBE2,99,50,123,3", "rigid element id 99 stands twice"),
        ("RBE2,99,50,123,4\nGRID,51\nRBE2,98,51,123456,50", "the reference of another element"),
        ("RBE3,98,,50,123,1.,123456,1,2", "are not 123"),
        ("RBE3,98,,50,123,1.,123", "no nodes"),
        ("RBE3,98,,50,123,-1.,123,1,2", "positive weight"),
        ("RBE3,98,,50,123,1,123,1,2", "positive weight"),
        ("RBE3,98,,50,123,1.,123,1,1", "stands twice"),
        ("RBE3,98,,50,123,1.,123,1,2\n+,UM,1,1", "UM set"),
        ("CONM2,90,4,,-3.", "mass is -3"),
        ("CONM2,90,7,,3.", "node 7 is not in the deck"),
        ("CONM2,90,4,,3.\nCONM2,90,3,,3.", "id stands twice"),
        ("SET1,5,1,2,77", "node 77 is not in the deck"),
        ("SET1,5,1,2\nSET1,5,3", "set id stands twice"),
    ],
)
def test_ties_masses_and_sets_that_cannot_be_taken_are_named(read, tetrahedron, cards, what):
    with pytest.raises(DeckError, match=what) as caught:
        read(tetrahedron + "GRID,50,,5.,5.,5.\n" + cards + "\n")
    assert "deck.bdf:" in caught.value.where


def test_offset_and_inertia_of_a_mass_are_counted(read, tetrahedron):
    mesh = read(tetrahedron + "CONM2,90,4,,3.,0.,0.,.1\nCONM2,91,4,,3.\n+,5.\n")
    assert [point.mass for point in mesh.point_masses] == [3.0, 3.0]
    assert mesh.ignored == {"CONM2 offset": 1, "CONM2 inertia": 1}


def test_sets_of_bulk_data_and_case_control(read, tetrahedron):
    head = "SET 1 = 1, 2,\n 4\nSET 2 = 10\nSET 3 = ALL\nSET 4 = 1 THRU 4 EXCEPT 3\n"
    head += "SET 6 = 1 THRU 12 EXCEPT 2, 3, 4\nBEGIN BULK\n"
    mesh = read(head + tetrahedron + "SET1,7,1,THRU,3\nSET3,8,ELEM,10\nSET3,9,GRID,4,2\nSET3,10,PROP,1\n")
    expected = {"SET-1": [1, 2, 4], "SET-4": [1, 2, 4], "SET-6": [1], "SET1-7": [1, 2, 3], "SET3-9": [2, 4]}
    assert {name: list(ids) for name, ids in mesh.node_sets.items()} == expected
    assert {name: list(ids) for name, ids in mesh.element_sets.items()} == {
        "SET-2": [10],
        "SET-6": [10],
        "SET3-8": [10],
    }
    assert mesh.ignored == {"SET of the case control": 1, "SET3": 1}
