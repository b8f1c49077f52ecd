"""MPC cards as relations, and which of them count."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.fem.constraints import constraint_transform


def test_terms_stand_in_pairs_on_a_line_in_every_format(read, tetrahedron):
    free = "MPC,3,4,1,2.,2,3,-1.\n,,3,2,.5,1,6\n,,2,1,1.5-1\n"
    fixed = (
        "MPC            3       4       1      2.       2       3     -1.\n"
        "                       3       2      .5       1       6\n"
        "                       2       1     .15\n"
    )
    for card in (free, fixed):
        (own,) = read(tetrahedron + card).relations
        assert (own.id, str(own), own.follower) == (1, "MPC 3", (3, 0))
        assert own.node.tolist() == [3, 1, 2, 0, 1]
        assert own.component.tolist() == [0, 2, 1, 5, 0]
        assert own.value.tolist() == [2.0, -1.0, 0.5, 0.0, 0.15]


def test_components_are_along_the_axes_of_the_node(read, tetrahedron):
    """u_r of a cylindrical system at 45° is (u_x + u_y)/√2."""
    text = tetrahedron.replace("GRID,4,,0.,0.,1.", "CORD2C,6,,0.,0.,0.,0.,0.,1.\n+,1.,0.,0.\nGRID,4,,1.,1.,1.,6")
    mesh = read(f"{text}MPC,3,4,1,1.\n")
    T = constraint_transform(mesh).transform.toarray()
    assert T.shape[1] == 2
    np.testing.assert_allclose(T[9] + T[10], 0, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(T[9:12], axis=0), 1)


@pytest.mark.parametrize(
    ("head", "cards", "what", "line"),
    [
        ("", "MPC,3,4,1,0.,2,3,-1.", "the coefficient of the first term is 0", 9),
        ("", "MPC,3,4,7,1.", "component 7", 9),
        ("", "MPC,3,4,,1.", "component 0", 9),
        ("", "MPC,3,77,1,1.", "node 77 is not in the deck", 9),
        ("", "MPC,3", "has no terms", 9),
        ("", "MPC,3,4,1,1.,2,3,-1.,3\n,,2,1,.1", "'3' stands in field 9", 9),
        ("", "SPOINT,99\nMPC,3,99,0,1.", "node 99 is a scalar point", 10),
        ("", "MPC,3,4,1,1.\nMPC,5,4,2,1.", "2 sets of relations .3, 5. and no case control", 10),
        ("", "MPC,3,4,1,1.\nMPCADD,5,3,6", "set 6 has no MPC", 10),
        ("", "MPCADD,5,6", "set 6 has no MPC", 9),
        ("MPC = 4\n", "MPC,3,4,1,1.", "MPC = 4 selects a set that is not in the deck", 1),
        ("SUBCASE 1\nMPC = 3\nSUBCASE 2\nMPC = 5\n", "MPC,3,4,1,1.\nMPC,5,4,2,1.", "different relations .3, 5.", 4),
    ],
)
def test_relations_that_cannot_be_taken_are_named(read, tetrahedron, head, cards, what, line):
    text = f"{head}BEGIN BULK\n{tetrahedron}{cards}\nENDDATA\n" if head else f"{tetrahedron}{cards}\n"
    with pytest.raises(DeckError, match=what) as caught:
        read(text)
    assert caught.value.where.endswith(f":{line}")
    assert caught.value.remedy


def test_an_error_of_the_model_names_the_line_of_the_card(read, tetrahedron):
    mesh = read(f"{tetrahedron}RBAR,20,1,4,1236,45,,3\nMPC,3,4,1,1.,2,3,-1.\nMPC,3,4,1,1.,3,3,-1.\n")
    with mesh.located(), pytest.raises(DeckError, match=r"node 4 is dependent in MPC 3 \(.*deck.bdf:10\) and in MPC 3"):
        constraint_transform(mesh)
    with pytest.raises(DeckError) as caught, mesh.located():
        constraint_transform(mesh)
    assert caught.value.where.endswith(":11")


def test_relations_that_are_left_out_are_counted(read, tetrahedron):
    cards = "MPC,3,4,1,1.\nMPCADD,5,3\n"
    mesh = read(tetrahedron + cards, ignore=["MPC"])
    assert (mesh.relations, mesh.ignored["MPC"]) == ((), 1)
    mesh = read(f"CEND\nMPC = 5\nBEGIN BULK\n{tetrahedron}{cards}ENDDATA\n", ignore=["MPC", "MPCADD"])
    assert (mesh.relations, mesh.ignored) == ((), {"MPC": 1, "MPCADD": 1})
    assert mesh.effect == {"MPC": "structure", "MPCADD": "structure"}


def test_a_moment_on_a_node_that_a_relation_turns_acts_there(read, tetrahedron):
    """A node that no element has, turned by a relation: no note says that its moment becomes a couple."""
    cards = "GRID,9,,0.,0.,2.\nMPC,3,4,1,1.,9,5,-2.\nMOMENT,7,9,,1.,0.,1.,0.\n"
    mesh = read(tetrahedron + cards)
    assert not [note for note in mesh.notes if "without rotations" in note]
    T = constraint_transform(mesh)
    row = T.reference_rows[mesh.node_index(9)] + 1
    assert T.transform[[row]].nnz == 1
    assert T.transform[[9]].toarray().max() == pytest.approx(2.0)
