"""Where solids and shells are hinged on each other is found from the mesh: as many motions as K has zero eigenvalues."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.fem.constraints import constraint_transform
from strainsight.fem.model import build_model
from strainsight.fem.pieces import stiff_pieces
from strainsight.fem.support import rigid_body_motions, rigid_motions
from strainsight.fem.turning import turning_nodes
from strainsight.mesh.joins import AveragingElement
from strainsight.mesh.thin import ShellBlock, ShellSection

SECTION = {9: ShellSection(0.05)}


def with_plates(mesh, quads):
    """Shells on nodes of a mesh of solids, of its material."""
    e = len(quads)
    block = ShellBlock("quad4", np.arange(1000, 1000 + e), quads, np.full(e, 9), np.zeros(e), np.full((e, 3), np.nan))
    regions = {**mesh.regions, 9: replace(mesh.regions[1], id=9)}
    return replace(mesh, shells=(block,) if e else (), sections=SECTION, regions=regions)


def held_motions(mesh):
    """How supports and ties of a mesh hold its nodes."""
    return constraint_transform(mesh, rotations=turning_nodes(mesh))


def some_of(mesh, chosen):
    block = mesh.blocks[0]
    return replace(
        mesh,
        blocks=(replace(block, ids=block.ids[chosen], nodes=block.nodes[chosen], region=block.region[chosen]),),
    )


def inner_quads(mesh):
    """Faces of all cells of a mesh of hex8, each once, on which plates can lie."""
    faces = [(0, 3, 7, 4), (0, 1, 5, 4), (0, 1, 2, 3), (1, 2, 6, 5), (3, 2, 6, 7), (4, 5, 6, 7)]
    quads = np.concatenate([mesh.blocks[0].nodes[:, list(face)] for face in faces])
    return quads[np.unique(np.sort(quads, axis=1), axis=0, return_index=True)[1]]


@pytest.mark.parametrize("seed", range(40))
def test_as_many_motions_are_found_as_the_stiffness_has_zero_eigenvalues(box, seed):
    """Cells of a 3 × 2 × 2 box, and plates between its nodes, drawn anew: they hang together by faces, edges and corners."""
    rng = np.random.default_rng(seed)
    full = box("hex8", (3, 2, 2), size=(1.0, 0.8, 0.7), distort=0.1, seed=seed)
    quads = inner_quads(full)
    mesh = some_of(full, np.sort(rng.choice(12, rng.integers(2, 6), replace=False)))
    mesh = with_plates(mesh, quads[rng.choice(len(quads), rng.integers(0, 4), replace=False)])
    K = build_model(mesh, supported=False).stiffness.constant.toarray()
    strength = np.linalg.eigvalsh(K / np.sqrt(np.outer(K.diagonal(), K.diagonal())))
    zeros = int(np.count_nonzero(strength < 1e-10))
    assert strength[zeros] > 1e-7
    constraint = held_motions(mesh)
    if zeros == 6:
        assert rigid_motions(mesh, constraint).shape[1] == 6
        return
    with pytest.raises(UserError, match="move against each other") as caught:
        rigid_motions(mesh, constraint)
    assert int(re.search(r"(\d+) free motions", str(caught.value))[1]) == zeros


def stand(box, **more):
    """A plate on the middle line of the top of a block that is held below, edge-on."""
    mesh = box("hex8", (2, 2, 1), size=(1.0, 1.0, 0.5))
    below = np.flatnonzero(mesh.position[:, 2] == 0)
    line = np.flatnonzero((mesh.position[:, 0] == 0.5) & (mesh.position[:, 2] == 0.5))
    n = len(mesh.position)
    above = mesh.position[line] + np.array([0.0, 0.0, 0.3])
    mesh = replace(
        mesh,
        node_ids=np.arange(1, n + len(line) + 1),
        position=np.vstack([mesh.position, above]),
        fixed=np.array([(i, c) for i in below for c in range(3)]),
    )
    quads = np.array([[line[i], line[i + 1], n + i + 1, n + i] for i in range(len(line) - 1)])
    return replace(with_plates(mesh, quads), **more), line


def test_a_plate_that_stands_on_a_solid_is_hinged_and_its_line_named(box):
    mesh, _ = stand(box)
    motions = rigid_body_motions(mesh, held_motions(mesh))
    assert motions == ("rotation about y through (0.5, 0.5, 0.5) m of the part with node 19",)
    with pytest.raises(UserError, match="move freely: rotation about y through"):
        build_model(mesh)


def test_it_is_held_where_a_node_turns_with_its_neighbours_on_the_face(box):
    mesh, line = stand(box)
    around = np.flatnonzero((np.abs(mesh.position[:, 2] - 0.5) < 1e-9) & (mesh.position[:, 0] != 0.5))
    tie = AveragingElement(1, int(line[1]), around, np.ones(len(around)), (3, 4, 5))
    held = replace(mesh, averaging=(tie,))
    assert rigid_body_motions(held, held_motions(held)) == ()


def test_a_corner_of_two_plates_holds_itself(box):
    mesh, line = stand(box)
    n = len(mesh.position)
    side = int(np.flatnonzero(np.all(np.isclose(mesh.position, [1.0, 0.5, 0.5]), axis=1))[0])
    mesh = replace(
        mesh,
        node_ids=np.arange(1, n + 2),
        position=np.vstack([mesh.position, mesh.position[side] + np.array([0.0, 0.0, 0.3])]),
    )
    top = int(np.flatnonzero(np.all(np.isclose(mesh.position, [0.5, 0.5, 0.8]), axis=1))[0])
    corner = with_plates(mesh, np.vstack([mesh.shells[0].nodes, [[line[1], side, n, top]]]))
    assert stiff_pieces(corner).count == 1
    assert rigid_body_motions(corner, held_motions(corner)) == ()


@pytest.mark.parametrize("kind", ["tet4", "tet10", "wedge15", "hex20"])
def test_a_body_of_one_kind_is_one_piece(box, kind):
    mesh = box(kind, (3, 2, 2), distort=0.1)
    found = stiff_pieces(mesh)
    assert found.count == 1
    np.testing.assert_array_equal(np.unique(found.label[mesh.nodes_of_elements]), [0])
