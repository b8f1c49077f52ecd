"""Loads of Abaqus decks: what CalculiX makes of the same deck, and resultants by hand."""

from __future__ import annotations

import shutil
import subprocess

import numpy as np
import pytest

from strainsight.decks.abaqus.deck import read_abaqus
from strainsight.errors import DeckError
from strainsight.fem.body_forces import with_body_forces
from strainsight.fem.factorisation import factorise
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import build_model, nodal
from strainsight.mesh.kinds import kind_of

from ...bodies import body

LOADS = {
    "DLOAD-1": "*DLOAD, OP=NEW\n2, P4, 3.E4\nALL, P1, -1.E4\n",
    "DLOAD-2": "*DLOAD, OP=NEW\nALL, GRAV, 9.81, 0., .6, -.8\n",
    "DLOAD-3": "*DLOAD, OP=NEW\nALL, CENTRIF, 4.E4, .1, -.5, 0., 0., .6, .8\n",
    "DSLOAD-1": "*DSLOAD, OP=NEW\nEND, P, 2.E4\n",
}


def bent(u, v, w):
    return 0.4 * u, 0.3 * v + 0.05 * u, 0.25 * w + 0.02 * u * u


def bar():
    """Two C3D20 in a row, bent, held at x = 0."""
    mesh = body("hex20", (2, 1, 1), bent)
    lines = ["*NODE, NSET=NALL"]
    lines += [f"{n}, {x!r}, {y!r}, {z!r}" for n, (x, y, z) in zip(mesh.node_ids, mesh.position.tolist(), strict=True)]
    lines += ["*ELEMENT, TYPE=C3D20, ELSET=ALL"]
    (block,) = mesh.blocks
    assert len(kind_of(block.kind).nodes) == 20
    for e, nodes in zip(block.ids, mesh.node_ids[block.nodes], strict=True):
        lines += [", ".join(map(str, (e, *nodes[:15]))) + ",", ", ".join(map(str, nodes[15:]))]
    lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", "2.1E11, .3", "*DENSITY", "7850.", "*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL"]
    held = mesh.node_ids[mesh.position[:, 0] == 0]
    lines += ["*BOUNDARY", *(f"{n}, 1, 3" for n in held), "*SURFACE, NAME=END", "2, S4"]
    return "\n".join([*lines, ""])


def displacement(deck):
    """Of every node by CalculiX, along its own axes where it has some (a line that ends in L)."""
    folder = deck.parent
    subprocess.run(["ccx", deck.stem], cwd=folder, check=True, stdout=subprocess.DEVNULL, timeout=60)
    rows = [line.split() for line in (folder / f"{deck.stem}.dat").read_text().splitlines()]
    return np.array([[float(v) for v in row[1:4]] for row in rows if len(row) - ("L" in row) == 4 and row[0].isdigit()])


@pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX is not installed")
def test_displacements_under_each_load_are_those_of_calculix(tmp_path):
    path = tmp_path / "bar.inp"
    steps = [f"*STEP\n*STATIC\n{load}*NODE PRINT, NSET=NALL\nU\n*END STEP\n" for load in LOADS.values()]
    # *DSLOAD takes nothing away from what *DLOAD of the step before has put on
    steps[-1] = steps[-1].replace("*DSLOAD", "*DLOAD, OP=NEW\n*DSLOAD")
    path.write_text(bar() + "".join(steps))
    mesh = with_body_forces(read_abaqus(path))
    found = displacement(path).reshape(len(LOADS), -1, 3)
    model = build_model(mesh)
    solve = factorise(model.stiffness.constant).solve
    names = [name for name in mesh.loads if mesh.loads[name].force.size]
    assert len(names) == len(LOADS)
    for name, expected in zip(names, found, strict=True):
        u = nodal(model, solve(input_shape(model, [PointLoad(name, deck_load=name, factor=True)]))).reshape(-1, 3)
        np.testing.assert_allclose(u, expected, atol=2e-6 * np.abs(expected).max())


def test_a_moment_of_a_cload_stays_one(read):
    text = bar() + "*CLOAD\n5, 4, 3.\n5, 6, -1.\n*CLOAD\n5, 1, 2.\n"
    mesh = read(text)
    loads = mesh.loads
    assert "*CLOAD of a moment on node 5 without rotations: a couple of forces on the nodes of the elements there" in mesh.notes
    led = read(bar() + "*NODE\n99, 0., 0., 9.\n*MPC\nBEAM, 5, 99\n*CLOAD\n99, 4, 3.\n5, 1, 2.\n")
    assert not any("without rotations" in note for note in led.notes)
    np.testing.assert_array_equal(loads["CLOAD-1"].moment, [[3, 0, -1]])
    np.testing.assert_array_equal(loads["CLOAD-1"].force, [[0, 0, 0]])
    assert loads["CLOAD-2"].moment is None


def test_gravity_without_a_set_pulls_at_point_masses_too(read):
    text = bar() + "*ELEMENT, TYPE=MASS, ELSET=M\n90, 3\n*MASS, ELSET=M\n5.\n"
    text += "*DLOAD\n, GRAV, 2., 0., 0., -3.\nALL, GRAV, 2., 0., 0., -3.\n"
    (load,) = with_body_forces(read(text)).loads.values()
    (other,) = with_body_forces(read(text.replace(", GRAV, 2., 0., 0., -3.\nALL", "ALL"))).loads.values()
    lost = load.force.sum(axis=0) - 2 * other.force.sum(axis=0)
    np.testing.assert_allclose(lost, [0, 0, -10], atol=1e-9)


@pytest.mark.parametrize(
    ("cards", "what"),
    [
        ("*DLOAD\nALL, P7, 1.\n", "'P7' is no facet of a hex20"),
        ("*DLOAD\nALL, GRAV, 9.81\n", "GRAV has no direction"),
        ("*DLOAD\nALL, CENTRIF, -1., 0., 0., 0., 0., 0., 1.\n", "negative"),
        ("*DSLOAD\nTOP, P, 1.\n", "surface 'TOP' is not in the deck"),
        ("*SURFACE, NAME=TOP, TYPE=NODE\n3\n*DSLOAD\nTOP, P, 1.\n", "no facets"),
    ],
)
def test_loads_that_cannot_be_taken_are_named(read, cards, what):
    with pytest.raises(DeckError, match=what):
        read(bar() + cards)


def test_other_kinds_are_counted(read):
    text = bar() + "*ELEMENT, TYPE=M3D3, ELSET=ALL\n80, 1, 2, 3\n"
    text += "*DLOAD\nALL, P1, 1.\nALL, BX, 1.\n*DSLOAD\nEND, TRVEC, 1., 1., 0., 0.\n"
    ignored = read(text).ignored
    assert ignored == {"*DLOAD BX": 1, "*DLOAD on elements that are no solids": 1, "*DSLOAD TRVEC": 1, "*ELEMENT, TYPE=M3D3": 1}
