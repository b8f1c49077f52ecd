"""A part of a mesh, moved at its cut as the whole is, moves inside as the whole does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.fem.patch import Incidence, forced_nodes, held_components, patch_around
from strainsight.fem.patch_forces import tractions
from strainsight.fem.submodel import refined_submodel, submodel, with_spread_forces
from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.joins import AveragingElement, RigidElement

from ..bodies import body, held, moved, with_nodes
from ..shared import slowly

N = (6, 4, 3)


def part(mesh, field, nodes, forced=(), layers=2):
    patch = patch_around(mesh, Incidence.of(mesh), np.atleast_1d(nodes), layers)
    everywhere = forced_nodes(mesh)
    everywhere[list(forced)] = True
    own = field.reshape(len(mesh.position), 3, -1)[patch.nodes].reshape(3 * len(patch.nodes), -1)
    none = tractions(patch, own, exterior_facets(mesh), *np.zeros((2, len(mesh.position)), dtype=bool))
    return patch, own, submodel(patch, own, held_components(mesh)[patch.nodes], everywhere[patch.nodes], none)


def block(kind):
    mesh = body(kind, N, lambda u, v, w: (u, v, w))
    return mesh, held(mesh, mesh.position[:, 0] == 0)


@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet10", "wedge6"])
def test_layers_hold_the_elements_that_touch(kind):
    mesh, _ = block(kind)
    cells = mesh.blocks[0].nodes
    node = int(np.argmin(np.linalg.norm(mesh.position - [3, 2, 3], axis=1)))
    first = np.flatnonzero(np.any(cells == node, axis=1))
    second = np.flatnonzero(np.any(np.isin(cells, cells[first]), axis=1))
    for layers, expected in ((1, first), (2, second)):
        patch = patch_around(mesh, Incidence.of(mesh), np.array([node]), layers)
        np.testing.assert_array_equal(patch.mesh.blocks[0].ids, mesh.blocks[0].ids[expected])
        outside = np.setdiff1d(np.arange(len(cells)), expected)
        np.testing.assert_array_equal(patch.cut, np.isin(patch.nodes, cells[outside]))
        np.testing.assert_array_equal(patch.nodes[patch.mesh.blocks[0].nodes], cells[expected])


def cases(kind):
    """Name, mesh, forces (n, 3), loaded nodes: a force at a node; through a rigid and an averaging element; on rollers; a support
    along axes of its own."""
    plain, clamped = block(kind)
    x, y, z = plain.position.T
    top = int(np.argmin(np.linalg.norm(plain.position - [4, 2, 3], axis=1)))
    force = np.zeros((len(x), 3))
    force[top] = [300, -200, -1000]
    yield "a force at a node", clamped, force, [top]
    end = np.flatnonzero(x == N[0])
    for name in ("rigid", "averaging"):
        tied, reference = with_nodes(clamped, [N[0] + 1.0, 2.0, 1.5]), len(x)
        element = RigidElement(9, reference, end, (0, 1, 2))
        if name == "averaging":
            element = AveragingElement(9, reference, end, np.ones(len(end)), (0, 1, 2, 3, 4, 5))
        tied = replace(tied, **{name: (element,)})
        push = np.zeros((len(tied.position), 3))
        push[reference] = [0, 500, -1000]
        yield name, tied, push, []
    rollers = held(held(held(plain, x == 0, (0,)), y == 0, (1,)), z == 0, (2,))
    yield "rollers", rollers, force, [top]
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    corner = int(np.argmin(np.linalg.norm(plain.position - [N[0], 0, 0], axis=1)))
    aslant = replace(held(clamped, np.arange(len(x)) == corner, (1,)), axes={corner: turn})
    yield "axes of its own", aslant, force, [top]


@pytest.mark.parametrize("kind", ["hex8", *slowly("hex20", "tet10")])
def test_every_part_of_a_model_at_rest_moves_as_it_does_there(kind):
    for name, mesh, force, forced in cases(kind):
        field = moved(mesh, force)
        solid = np.unique(mesh.blocks[0].nodes)
        for node in solid[:: len(solid) // 6]:
            _, before, own = part(mesh, field, node, forced)
            np.testing.assert_allclose(own.field, before, rtol=0, atol=1e-9 * np.abs(field).max(), err_msg=name)


@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet10"])
def test_a_force_that_is_spread_has_its_resultant_and_moment(kind):
    _, mesh = block(kind)
    force = np.zeros((len(mesh.position), 3))
    for place in ([6, 4, 3], [6, 2, 3], [4, 2, 3]):
        node = int(np.argmin(np.linalg.norm(mesh.position - place, axis=1)))
        force[:] = 0
        force[node] = [3.0, -2.0, 7.0]
        patch, _, own = part(mesh, moved(mesh, force), node, [node])
        facets = exterior_facets(mesh)
        chosen = np.isin(facets.element_id, patch.mesh.blocks[0].ids)
        columns = (facets.element_id, facets.facet, facets.kind, patch.local(facets.nodes), facets.region)
        spread = with_spread_forces(own, Facets(*(column[chosen] for column in columns)))
        found, x = spread.force.reshape(-1, 3), patch.mesh.position
        assert np.count_nonzero(found.any(axis=1)) > 3
        np.testing.assert_allclose(found.sum(axis=0), force[node], atol=1e-8)
        np.testing.assert_allclose(np.cross(x, found).sum(axis=0), np.cross(place, force[node]), atol=1e-7)


def test_a_refined_part_holds_what_the_part_holds():
    plain, _ = block("hex20")
    mesh = held(held(plain, plain.position[:, 2] == 0, (2,)), plain.position[:, 0] == 0, (0, 1, 2))
    node = int(np.argmin(np.linalg.norm(mesh.position - [1, 2, 0], axis=1)))
    force = np.zeros((len(mesh.position), 3))
    force[node] = [0, 1000, 0]
    _, _, own = part(mesh, moved(mesh, force), node, [node])
    finer, _ = refined_submodel(own)
    x = finer.mesh.position
    assert finer.held[x[:, 2] == 0, 2].all()
    assert finer.held[x[:, 0] == 0].all()
    inside = (x[:, 0] > 0) & (x[:, 0] < 2.9) & (x[:, 2] > 0) & (x[:, 2] < 1.9) & (x[:, 1] > 0.1) & (x[:, 1] < 3.9)
    assert not finer.held[inside].any()
    np.testing.assert_allclose(finer.force.reshape(-1, 3).sum(axis=0), [0, 1000, 0], atol=1e-6)
    assert np.count_nonzero(np.abs(finer.force) > 1e-6) == 1
