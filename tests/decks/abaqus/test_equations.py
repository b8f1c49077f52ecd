"""*EQUATION: the displacements that CalculiX finds of the same deck, sets, and what cannot be taken."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from strainsight.decks.abaqus.deck import read_abaqus
from strainsight.errors import DeckError
from strainsight.fem.constraints import constraint_transform
from strainsight.fem.factorisation import factorise
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import build_model, nodal

from .test_loads import bar, displacement

EQUATIONS = """\
*NODE, NSET=NALL
900, 1., .2, .1
*TRANSFORM, NSET=TURNED
.6, .8, 0., -.8, .6, 0.
*NSET, NSET=TURNED
3, 900
*EQUATION
2
3, 1, 1., 900, 1, -.7
3
6, 2, 2.
900, 2, -.5, 23, 3, .3
1
30, 3, 1.
4
9, 1, 1., 6, 3, .4, 23, 1, -.8,
30, 2, .6
"""


@pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX is not installed")
def test_displacements_with_equations_are_those_of_calculix(tmp_path):
    """Weighted, to a node that no element has, along axes of nodes, to the ground."""
    path = tmp_path / "bar.inp"
    load = "*STEP\n*STATIC\n*CLOAD\n900, 1, 2.E4\n900, 2, 1.E4\n23, 3, -3.E4\n*NODE PRINT, NSET=NALL\nU\n*END STEP\n"
    path.write_text(bar() + EQUATIONS + load)
    expected = displacement(path)
    mesh = read_abaqus(path)
    assert [len(own.node) for own in mesh.relations] == [2, 3, 1, 4]
    (name,) = mesh.loads
    model = build_model(mesh)
    S = input_shape(model, [PointLoad(name, deck_load=name, factor=True)])
    u = nodal(model, factorise(model.stiffness.constant).solve(S)).reshape(-1, 3)
    # CalculiX prints along the axes of a node, and two motions of 900 alone
    printed = np.array([row @ mesh.axes.get(node, np.eye(3)) for node, row in enumerate(u)])
    assert np.abs(printed[-1, :2]).min() > 0.01 * np.abs(printed).max()
    np.testing.assert_allclose(printed, expected, atol=1e-6 * np.abs(expected).max())


def test_sets_make_an_equation_for_each_of_their_nodes(read):
    sets = "*NSET, NSET=A\n9, 5\n*NSET, NSET=B\n30, 3\n*EQUATION\n3\nA, 2, 1., B, 1, -1., 6, 3, .5\n"
    mesh = read(bar() + sets)
    named = [mesh.node_ids[own.node].tolist() for own in mesh.relations]
    assert named == [[5, 3, 6], [9, 30, 6]]
    assert all(own.component.tolist() == [1, 0, 2] and own.value.tolist() == [1, -1, 0.5] for own in mesh.relations)


def test_degrees_of_freedom_of_a_node_that_stands_for_rotations_are_rotations(read):
    text = bar() + "*NODE\n900, 1., .2, .1\n901, 1., .2, .1\n*NSET, NSET=T\n3, 9\n"
    text += "*RIGID BODY, NSET=T, REF NODE=900, ROT NODE=901\n*EQUATION\n3\n23, 1, 1., 901, 2, -.25, 900, 6, 2.\n"
    mesh = read(text)
    (own,) = mesh.relations
    assert mesh.node_ids[own.node].tolist() == [23, 900, 900]
    assert own.component.tolist() == [0, 4, 5]
    T = constraint_transform(mesh)
    row = T.reference_rows[mesh.node_index(900)]
    found = T.transform[[3 * mesh.node_index(23)]].toarray()
    np.testing.assert_allclose(found, (0.25 * T.transform[[row + 1]] - 2 * T.transform[[row + 2]]).toarray())


def test_equations_that_are_left_out_are_counted(read):
    mesh = read(bar() + EQUATIONS, ignore=["EQUATION"])
    assert (mesh.relations, mesh.ignored, mesh.effect) == ((), {"*EQUATION": 1}, {"*EQUATION": "structure"})


def test_the_model_names_the_line_of_an_equation(read):
    text = bar() + "*EQUATION\n2\n23, 1, 1., 6, 1, -1.\n2\n23, 1, 1., 9, 1, -1.\n"
    lines = text.count("\n")
    mesh = read(text)
    with pytest.raises(DeckError, match=r"node 23 is dependent in \*EQUATION \(.*\) and in \*EQUATION") as caught, mesh.located():
        constraint_transform(mesh)
    assert caught.value.where.endswith(f"deck.inp:{lines - 1}")
    assert f"deck.inp:{lines - 3}" in str(caught.value)


def test_equations_that_a_later_step_adds_or_removes_are_left_out_with_a_note(read):
    own = "*EQUATION\n2\n23, 1, 1., 6, 1, -1.\n"
    steps = "*STEP\n*STATIC\n*END STEP\n*STEP\n*EQUATION, REMOVE ALL\n*END STEP\n"
    mesh = read(bar() + own + steps)
    assert len(mesh.relations) == 1
    assert "the equations of step 2" in mesh.notes[-1]


@pytest.mark.parametrize(
    ("cards", "what", "line"),
    [
        ("*EQUATION\n", "no data line follows", 1),
        ("*EQUATION, REMOVE\n2\n5, 1, 1., 6, 1, -1.\n", "REMOVE is not supported", 1),
        ("*EQUATION\n5, 1, 1., 6, 1, -1.\n", "is no number of terms", 2),
        ("*EQUATION\n0\n", "is no number of terms", 2),
        ("*EQUATION\n3\n5, 1, 1., 6, 1, -1.\n", "3 terms are stated, 2 follow", 2),
        ("*EQUATION\n1\n5, 1, 1., 6, 1, -1.\n", "1 terms are stated, 2 follow", 2),
        ("*EQUATION\n2\n5, 1, 1., 6, 1\n", "not three entries a term", 3),
        ("*EQUATION\n2\n5, 1, 0., 6, 1, 1.\n", "the coefficient of the first term is 0", 3),
        ("*EQUATION\n2\n5, 1, 1., 777, 1, 1.\n", "node 777 is not in the deck", 3),
        ("*EQUATION\n2\n5, 1, 1., 6, 11, 1.\n", "degree of freedom 11", 3),
        ("*EQUATION\n2\n5, 1, 1., 6, 4, 1.\n", "degree of freedom 4 of node 6, which has no such rotation", 3),
        ("*EQUATION\n2\nNALL, 1, 1., ONE, 1, 1.\n*NSET, NSET=ONE\n5, 6\n", "a set of 2 nodes where the first one has", 3),
        ("*EQUATION\n1\nONE, 1, 1.\n*NSET, NSET=ONE, UNSORTED\n6, 5\n", "'ONE' is UNSORTED", 3),
        ("*STEP\n*EQUATION\n1\n5, 1, 1.\n*END STEP\n", "stands inside the first \\*STEP", 2),
    ],
)
def test_equations_that_cannot_be_taken_are_named(read, cards, what, line):
    text = bar()
    with pytest.raises(DeckError, match=what) as caught:
        read(text + cards)
    assert caught.value.where.endswith(f":{text.count(chr(10)) + line}")
    assert caught.value.remedy
