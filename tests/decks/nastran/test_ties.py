"""Supports, rigid and averaging elements, rigid bars, masses and sets of Nastran decks."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from strainsight.errors import ChoiceError, DeckError
from strainsight.fem.constraints import constraint_transform
from strainsight.fem.model import build_model

from ...refusals import expect_refusal, refusal_table
from ..conftest import TETRAHEDRON

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
def test_all_support_cards_give_same_components(read, tetrahedron, cards):
    text = tetrahedron.replace("SPC1,1,123,1,2,3", cards)
    if "GRDX" in cards:
        text = text.replace("GRDX\n", "").replace("GRID,1,,0.,0.,0.", "GRID,1,,0.,0.,0.,,123")
    assert pairs(read(text)) == ALL


def test_thru_range_selects_existing_nodes(read, tetrahedron):
    mesh = read(tetrahedron.replace("SPC1,1,123,1,2,3", "SPC1,1,3,3,THRU,99999999"))
    assert pairs(mesh) == {(2, 2), (3, 2)}


def test_case_control_selects_support_set(read, tetrahedron):
    bulk = tetrahedron + "SPC1,2,3,4\nSPC1,3,1,4\nSPCADD,9,2,3\n"
    bulk += "ENDDATA\n"
    assert pairs(read(f"SPC = 2\nBEGIN BULK\n{bulk}")) == {(3, 2)}
    assert pairs(read(f"CEND\nspc=9\nSPCFORCES = ALL\nBEGIN BULK\n{bulk}")) == {(3, 0), (3, 2)}
    assert read(f"SPC = 1\nBEGIN BULK\n{bulk}").ignored == {"SPC1 of a support set that is not selected": 2}


def test_config_selects_support_set(read, tetrahedron):
    bulk = tetrahedron + "SPC1,2,3,4\nSPC1,3,1,4\nSPCADD,9,2,3\nENDDATA\n"
    subcases = "SUBCASE 1\nSPC = 1\nSUBCASE 2\nSPC = 9\nSUBCASE 3\nSPC = 44\nBEGIN BULK\n"
    for head in (subcases, ""):
        with pytest.raises(ChoiceError, match="support") as caught:
            read(head + bulk)
        remedy = "set mesh.spc to the support set of the model, for example mesh.spc: 1"
        assert (caught.value.choices, caught.value.remedy) == ((1, 9), remedy)
        assert pairs(read(head + bulk, spc=9)) == {(3, 0), (3, 2)}
        assert pairs(read(head + bulk, spc=2)) == {(3, 2)}
    assert pairs(read(f"SPC = 44\nBEGIN BULK\n{bulk}", spc=2)) == {(3, 2)}
    with pytest.raises(DeckError, match="support set 7") as caught:
        read(bulk, spc=7)
    assert caught.value.remedy == "select one of the SPC sets 1, 2, 3, 9"


test_supports_that_cannot_be_taken_are_named = refusal_table(lambda head, cards: f"{head}{TETRAHEDRON}{cards}\nENDDATA\n", [
    ("", "SPC1,2,3,4", r"the deck has 2 support sets \(1, 2\), and the case control selects none"),
    ("SPC = 5\nBEGIN BULK\n", "", "SPC = 5 selects an SPC set that is not in the deck"),
    ("SUBCASE 1\nSPC = 1\nSUBCASE 2\nSPC = 2\nBEGIN BULK\n", "SPC1,2,3,4", "different support sets"),
    ("", "SPCADD,9,1,2", "SPCADD refers to set 2, which has no SPC or SPC1 card"),
    ("", "SPC1,1,123,9", "node 9 is not in the deck"),
    ("", "SPC1,1,127,4", "components '127'"),
    ("", "SPC1,1,123,4,THRU,2", "is decreasing"),
], placed=False)


CYLINDER = "CORD2C,6,,0.,0.,0.,0.,0.,1.\n+,1.,0.,0.\n"


def test_supports_are_along_nodal_axes(read, tetrahedron):
    mesh = read(tetrahedron + CYLINDER + "GRID,5,,0.,2.,1.,6\nSPC1,1,2,5\n")
    assert (4, 1) in pairs(mesh)
    np.testing.assert_allclose(mesh.axes[4], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    assert mesh.ignored == {}


@pytest.mark.parametrize("components", ["123456", "1", "135", "46"])
def test_rbe2_is_imported_with_nodes_and_components(read, tetrahedron, components):
    (rigid,) = read(tetrahedron + f"GRID,50,,5.,5.,5.\nRBE2,99,50,{components},2,THRU,4,1.-5\n").rigid
    assert (rigid.id, rigid.reference, rigid.components) == (99, 4, tuple(int(c) - 1 for c in components))
    assert sorted(rigid.nodes) == [1, 2, 3]


def test_rbe3_weights_belong_to_their_groups(read, tetrahedron):
    card = "RBE3,98,,50,123456,1.5,123,1,2\n+,.5,123,3,4,ALPHA,1.-5\n"
    (averaging,) = read(tetrahedron + "GRID,50,,5.,5.,5.\n" + card).averaging
    assert (averaging.reference, averaging.components) == (4, (0, 1, 2, 3, 4, 5))
    assert list(averaging.nodes) == [0, 1, 2, 3]
    np.testing.assert_array_equal(averaging.weight, [1.5, 1.5, 0.5, 0.5])
    assert averaging.directions is None
    assert averaging.dependent is None


def test_rbe3_groups_of_single_directions_and_a_um_set(read, tetrahedron):
    card = "RBE3,98,,50,123,1.5,12,1,2\n+,,,.5,3,2,3,,4\n+,UM,1,12,50,3\n+,ALPHA,1.-5\n"
    (averaging,) = read(tetrahedron + "GRID,50,,5.,5.,5.\n" + card).averaging
    assert list(averaging.nodes) == [0, 1, 1, 2, 3]
    np.testing.assert_array_equal(averaging.weight, [1.5, 1.5, 0.5, 0.5, 0.5])
    np.testing.assert_array_equal(averaging.directions, [[1, 1, 0], [1, 1, 0], [0, 0, 1], [0, 0, 1], [0, 0, 1]])
    np.testing.assert_array_equal(averaging.dependent, [[0, 0], [0, 1], [4, 2]])


test_ties_masses_and_sets_that_cannot_be_taken_are_named = refusal_table(
    lambda cards: f"{TETRAHEDRON}GRID,50,,5.,5.,5.\n{cards}\n", [
    ("RBE2,99,50,123,4,77", "node 77 is not in the deck"),
    ("RBE2,99,50,123,4,1000000000000", "is 1000000000000, too large"),
    ("RBE2,99,50,123", "no dependent node"),
    ("RBE2,99,50,123,4,50", "also dependent"),
    ("RBE2,99,50,123,4\nRBE2,99,50,123,3", "rigid element id 99 is used twice"),
    ("RBE3,98,,50,123,1.,123456,1,2", "rotations of node 1 are averaged, but the node has no rotations"),
    ("RBE3,98,,50,123,-1.,123,1,2", "positive weight"),
    ("RBE3,98,,50,123,1.,123,1,1", "a component is averaged twice"),
    ("RBE3,98,,50,123,1.,123,1,2\n+,UM,1,1", r"the UM set has 1 different components, but REFC has 3"),
    ("CONM2,90,4,,-3.", "mass is -3"),
    ("SET1,5,1,2,77", "node 77 is not in the deck"),
], placed=False)


def test_sets_of_bulk_data_and_case_control(read, tetrahedron):
    head = "SET 1 = 1, 2,\n 4\nSET 2 = 10\nSET 3 = ALL\nSET 4 = 1 THRU 4 EXCEPT 3\n"
    head += "SET 6 = 1 THRU 12 EXCEPT 2, 3, 4\nBEGIN BULK\n"
    mesh = read(head + tetrahedron + "SET1,7,1,THRU,3\nSET3,8,ELEM,10\nSET3,9,GRID,4,2\nSET3,10,PROP,1\nENDDATA\n")
    expected = {"SET-1": [1, 2, 4], "SET-4": [1, 2, 4], "SET-6": [1], "SET1-7": [1, 2, 3], "SET3-9": [2, 4]}
    assert {name: list(ids) for name, ids in mesh.node_sets.items()} == expected
    assert {name: list(ids) for name, ids in mesh.element_sets.items()} == {
        "SET-2": [10],
        "SET-6": [10],
        "SET3-8": [10],
    }
    assert mesh.ignored == {"SET of the case control": 1, "SET3": 1}


SHELL = "GRID,1\nGRID,2,,1.\nGRID,3,,1.,1.\nGRID,4,,,1.\nCQUAD,7,1,1,2,3,4\n"


def test_element_sets_of_a_deck_without_solids(read):
    head = "SET 1 = 7\nSET 2 = 1, 2\nBEGIN BULK\n"
    mesh = read(f"{head}{SHELL}SET3,5,ELEM,7\nSET3,6,ELEM,1,THRU,9\nENDDATA\n", required=False)
    assert {name: list(ids) for name, ids in mesh.node_sets.items()} == {"SET-2": [1, 2]}
    assert {name: list(ids) for name, ids in mesh.element_sets.items()} == {"SET3-6": []}
    assert mesh.ignored["SET3 with elements that are not imported"] == 1
    with pytest.raises(DeckError, match="element 8 is not in the deck"):
        read(SHELL + "SET3,5,ELEM,8\n", required=False)


@pytest.mark.parametrize("card", ["SPC1,1,0,4,9", "SPC1,1,123,9", "SPC,1,9,0", "SPC,1,10,,0.", "CONM2,90,9,,1."])
@pytest.mark.parametrize("points", ["SPOINT,9,10", "SPOINT,8,THRU,20"])
def test_scalar_point_is_refused(read, tetrahedron, card, points):
    with expect_refusal(DeckError, r"node \d+ is a scalar point \(SPOINT\), which is not supported", where=":10"):
        read(f"{tetrahedron}{points}\n{card}\n")


RELATIONS = "MPC,3,1,1,1.,2,1,-1.\nMPC,4,1,2,1.,2,2,-1.\nMPCADD,5,3,4\n"


@pytest.mark.parametrize(
    ("head", "left", "taken"),
    [
        ("", {}, [[0, 1, 0], [0, 1, 1]]),
        ("SOL 103\nCEND\n", {"MPC": 2, "MPCADD": 1}, []),
        ("CEND\nMPC = 3\n", {"MPC": 1, "MPCADD": 1}, [[0, 1, 0]]),
        ("CEND\nmpc=5\nSPC = 1\n", {}, [[0, 1, 0], [0, 1, 1]]),
    ],
)
def test_case_control_selects_mpc_set(read, tetrahedron, head, left, taken):
    mesh = read((f"{head}BEGIN BULK\n" if head else "") + tetrahedron + RELATIONS + "ENDDATA\n")
    assert mesh.ignored == {f"{name} of an MPC set that is not selected": n for name, n in left.items()}
    assert [[*e.node.tolist(), int(e.component[0])] for e in mesh.relations] == taken
    assert all(e.value.tolist() == [1.0, -1.0] for e in mesh.relations)


# RBAR, RBAR1, RROD and RBE1: what a rigid body does is all that they allow.
GRIDS = """\
CORD2R,7,,.0,.1,.2,.3,.4,1.
+,1.,.4,.1
GRID,1,,0.,0.,0.{0}
GRID,2,,1.,.2,0.3{1}
GRID,3,,0.1,1.,0.{0}
GRID,4,,-.2,0.,1.{1}
CBAR,10,1,1,2,.3,.4,.5
CBAR,11,1,3,4,.3,.4,.5
PBAR,1,1,.1,.2,.2,.1
MAT1,1,2.1+11,,.3,7850.
"""
SYSTEMS = [("", ""), (",,7", ""), ("", ",,7")]


def grids_of(systems):
    """CD is the seventh field of a GRID, after x, y, z."""
    return GRIDS.format(*(own.replace(",,", ",") for own in systems))


def rigid_motion(mesh, q):
    """(n, 6) motions along the axes of every node of a rigid body that moves by q = (u, θ) of the origin."""
    motion = np.column_stack([q[:3] + np.cross(q[3:], mesh.position), np.tile(q[3:], (len(mesh.position), 1))])
    for node, axes in mesh.axes.items():
        motion[node] = np.concatenate([axes.T @ motion[node, :3], axes.T @ motion[node, 3:]])
    return motion


@pytest.mark.parametrize("systems", SYSTEMS)
@pytest.mark.parametrize(
    ("card", "dependent"),
    [
        ("RBAR,20,1,2,1236,34", [(0, 3), (0, 4), (1, 0), (1, 1), (1, 2), (1, 4), (1, 5)]),
        ("RBAR,20,1,2,1236,34,0,15", [(1, 0), (1, 4)]),
        ("RBAR,20,1,2,45,1236,,45", [(1, 3), (1, 4)]),
        ("RBAR,20,1,2,45,1236,6,0", [(0, 5)]),
        ("RBE1,20,1,123,2,23,3,3\n+,UM,4,123,3,12,1,4", [(3, 0), (3, 1), (3, 2), (2, 0), (2, 1), (0, 3)]),
    ],
)
def test_rigid_bar_relations_admit_only_rigid_motions(read, card, dependent, systems):
    mesh = read(f"{grids_of(systems)}{card}\n")
    expected = dependent
    if card == "RBAR,20,1,2,1236,34":  # blank CMA and CMB: all that are not independent
        free = {(0, 0), (0, 1), (0, 2), (0, 5), (1, 2), (1, 3)}
        expected = sorted(set(product((0, 1), range(6))) - free)
    assert mesh.rigid == ()
    assert sorted(own.follower for own in mesh.relations) == sorted(expected)
    assert {str(own) for own in mesh.relations} == {f"{card[:4]} 20"}
    for q in np.eye(6):
        z = rigid_motion(mesh, q)
        for own in mesh.relations:
            terms = own.value * z[own.node, own.component]
            assert abs(terms.sum()) < 1e-13 * np.abs(own.value).max()
    # nothing but six independent motions leads: they are all that the others follow
    lead = {(n, c) for own in mesh.relations for n, c in zip(own.node[1:], own.component[1:], strict=True)}
    assert len(lead) <= 6
    assert not lead & set(expected)


@pytest.mark.parametrize("systems", SYSTEMS)
@pytest.mark.parametrize(
    "card",
    [
        "RBAR,20,1,3,123456", "RBAR,20,1,3,123456,,,123456", "RBAR,20,3,1,,123456", "RBAR,20,3,1,0,123456,123456,0",
        "RBAR1,20,1,3,123456", "RBE1,20,1,123456\n+,UM,3,123456", "RBE1,20,1,123456\n+,UM,3,123,3,456,1.-5",
    ],
)
def test_bar_with_one_leading_node_is_rigid_element(read, card, systems):
    mesh = read(f"{grids_of(systems)}{card}\n")
    expected = read(f"{grids_of(systems)}RBE2,20,1,123456,3\n")
    assert mesh.relations == ()
    (own,), (other,) = mesh.rigid, expected.rigid
    assert (own.id, own.reference, own.nodes.tolist(), own.components) == (20, 0, [2], other.components)
    assert str(own) == f"{card.split(',')[0]} 20"
    for found, there in zip(*(build_model(m, supported=False).stiffness.constant for m in (mesh, expected)), strict=True):
        assert np.array_equal(found.toarray(), there.toarray())


def test_dependent_motions_of_several_kinds_are_several_rigid_elements(read):
    mesh = read(f"{grids_of(SYSTEMS[0])}RBE1,20,1,123456\n+,UM,3,123,4,123,2,45\n")
    assert [(own.nodes.tolist(), own.components) for own in mesh.rigid] == [([1], (3, 4)), ([2, 3], (0, 1, 2))]


@pytest.mark.parametrize("systems", SYSTEMS)
@pytest.mark.parametrize(("fields", "follower"), [("2", (0, 1)), (",1", (1, 0)), ("0,3", (1, 2))])
def test_a_rigid_rod_keeps_its_length(read, fields, follower, systems):
    mesh = read(f"{grids_of(systems)}RROD,20,1,2,{fields}\n")
    (own,) = mesh.relations
    assert own.follower == follower
    rng = np.random.default_rng(0)
    T = constraint_transform(mesh).transform
    along = mesh.position[1] - mesh.position[0]
    z = T @ rng.standard_normal((T.shape[1], 5))
    np.testing.assert_allclose(along @ z[3:6], along @ z[:3], atol=1e-13)
    assert np.linalg.matrix_rank((T @ rng.standard_normal((T.shape[1], 12)))[:6]) == 5


test_bars_that_cannot_be_rigid_are_refused = refusal_table(lambda card: f"{grids_of(SYSTEMS[0])}GRID,5,,1.,1.2,.3\n{card}\n", [
    ("RBAR,20,1,1,123456", "both ends are at node"),
    ("RBAR,20,1,2,12345", "5 independent components"),
    ("RBAR,20,1,2,123,123", "the independent components do not constrain a rigid body"),
    ("RBAR,20,1,2,123456,,1,123456", "node 1 is both independent and dependent in component"),
    ("RBE1,20,1,123456", "the word UM is missing"),
    ("RBE1,20,1,123,2,123\n+,UM,3,123", "the independent components do not constrain a rigid body"),
    ("RROD,20,1,2,4", "exactly one translation must be dependent"),
    ("RROD,20,2,5,1", "the dependent translation is perpendicular to the rod"),
    ("GRID,6,,1.,.2,0.3\nRROD,20,2,6,1", "both ends coincide"),
], placed=False)
