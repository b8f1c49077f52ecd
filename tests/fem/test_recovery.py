"""Strain and stress of the surface against known fields, gauges and draws; parts of a mesh that are moved at their cut."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strainsight.fem.affine import Parameter
from strainsight.fem.assembly import assemble
from strainsight.fem.nodal_forces import tractions
from strainsight.fem.patch import Incidence, forced_nodes, held_components, patch_around
from strainsight.fem.recovery import bubble_amplitudes, facet_strain, principal, surface_model, surface_state, von_mises
from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.joins import AveragingElement, RigidElement
from strainsight.mesh.kinds import ELEMENTS, FACETS
from strainsight.mesh.kinds.solids import HEX8
from strainsight.mesh.model import Mesh
from strainsight.sensors.candidates import candidates
from strainsight.sensors.hot_spots import refined_submodel, submodel, with_spread_forces
from strainsight.sensors.strain_operator import channel_matrix

from ..bodies import body, held, moved, with_nodes
from ..shared import slowly

KINDS = [kind.name for kind in ELEMENTS]
E, NU, RHO = 2.1e11, 0.3, 7850.0


def voigt(tensor):
    """(..., 3, 3) symmetric → [xx yy zz 2xy 2yz 2zx]."""
    t = np.asarray(tensor)
    return np.stack(
        [t[..., 0, 0], t[..., 1, 1], t[..., 2, 2], 2 * t[..., 0, 1], 2 * t[..., 1, 2], 2 * t[..., 2, 0]], axis=-1
    )


def shaken(mesh: Mesh, size: float, seed: int = 0) -> Mesh:
    """Every node moved, mid-side nodes too: distorted elements with curved facets."""
    moved = mesh.position + size * np.random.default_rng(seed).uniform(-1, 1, mesh.position.shape)
    return Mesh(mesh.node_ids, moved, mesh.blocks, mesh.fixed, regions=mesh.regions, materials=mesh.materials)


def column(field):
    return np.asarray(field).reshape(-1, 1)


def centres(mesh, facets):
    """(f, 3) [m], of facets with straight edges."""
    corners = [FACETS[kind].corners for kind in facets.kind]
    return np.array([mesh.position[n[:c]].mean(axis=0) for n, c in zip(facets.nodes, corners, strict=True)])


def tensors(rows, field):
    return (rows.matrix @ np.asarray(field).ravel()).reshape(-1, 6)


@pytest.mark.parametrize("kind", KINDS)
def test_a_linear_field_is_recovered_exactly_on_distorted_and_curved_elements(box, kind):
    mesh = shaken(box(kind), 0.03)
    G = np.random.default_rng(1).standard_normal((3, 3))
    rows = facet_strain(mesh, exterior_facets(mesh))
    expected = np.tile(voigt(0.5 * (G + G.T)), (len(rows.region), 1))
    np.testing.assert_allclose(tensors(rows, mesh.position @ G.T + 0.7), expected, atol=2e-13)


@pytest.mark.parametrize("kind", KINDS)
def test_along_the_surface_it_is_what_a_gauge_reads(box, kind):
    """Any field, distorted and curved elements: tᵀεt at a facet's centre is the row of a point gauge there."""
    mesh = shaken(box(kind), 0.05, seed=3)
    facets = exterior_facets(mesh)
    gauges = candidates(mesh, facets, (1.0, 0.7, 0.4), (0.0, 30.0, 90.0))
    field = np.random.default_rng(5).standard_normal(3 * len(mesh.position))
    read = channel_matrix(mesh.position, gauges, facets) @ field
    number = {(e, f): i for i, (e, f) in enumerate(zip(facets.element_id, facets.facet, strict=True))}
    at = [number[key] for key in zip(gauges.element, gauges.facet, strict=True)]
    strain = tensors(facet_strain(mesh, facets), field)[at]
    t = gauges.direction
    along = voigt(np.einsum("mi,mj->mij", t, t)) * [1, 1, 1, 0.5, 0.5, 0.5]
    np.testing.assert_allclose(np.sum(along * strain, axis=1), read, rtol=1e-10, atol=1e-10 * np.abs(read).max())


def test_the_incompatible_modes_stand_where_the_assembly_condenses_them(box):
    """zᵀKz of the assembled element is the energy of the strain with these amplitudes, at its own quadrature points."""
    mesh = shaken(box("hex8", (1, 1, 1)), 0.1)
    nodes, z = mesh.blocks[0].nodes, np.random.default_rng(2).standard_normal((8, 3))
    x, u = mesh.position[nodes[0]], z[nodes[0]]
    alpha = (bubble_amplitudes(HEX8, x[None], np.array([NU]), np.array([1]))[0] @ u.ravel()).reshape(3, 3)
    lam, mu, energy = E * NU / ((1 + NU) * (1 - 2 * NU)), 0.5 * E / (1 + NU), 0.0
    J0 = x.T @ HEX8.gradient(np.zeros((1, 3)))[0]
    for xi, dN in zip(HEX8.stiffness[0], HEX8.gradient(HEX8.stiffness[0]), strict=True):
        J = x.T @ dN
        own = np.linalg.det(J0) / np.linalg.det(J) * (-2 * np.diag(xi)) @ np.linalg.inv(J0)
        G = u.T @ dN @ np.linalg.inv(J) + alpha.T @ own
        strain = 0.5 * (G + G.T)
        energy += np.linalg.det(J) * (lam * np.trace(strain) ** 2 + 2 * mu * np.sum(strain**2))
    assert energy == pytest.approx(z.ravel() @ (assemble(mesh)[0].constant @ z.ravel()), rel=1e-12)


@pytest.mark.parametrize("kind", ["tet10", "hex8", "hex20", "wedge15"])
def test_pure_bending_of_a_bar(box, kind):
    """u = κ[−xz, νyz, (x² + ν(z² − y²))/2]: σxx = −Eκz alone; hex8 holds the field by its incompatible modes."""
    k, mesh = 1e-3, box(kind, (8, 2, 2), (1.0, 0.1, 0.08), material=(E, NU, RHO))
    x, y, z = mesh.position.T - np.array([[0.0], [0.05], [0.04]])
    field = k * np.column_stack([-x * z, NU * y * z, 0.5 * (x**2 + NU * (z**2 - y**2))])
    facets = exterior_facets(mesh)
    state = surface_state(surface_model(mesh, facet_strain(mesh, facets), column(field)), {}, np.ones(1))
    expected = np.zeros_like(state.stress)
    expected[:, 0] = -E * k * (centres(mesh, facets)[:, 2] - 0.04)
    np.testing.assert_allclose(state.stress, expected, atol=1e-8 * E * k * 0.04)


def test_invariants_do_not_turn_with_the_axes():
    rng = np.random.default_rng(0)
    s = np.array([3.0, -1.0, 0.5])
    for R in Rotation.random(20, random_state=rng).as_matrix():
        t = R @ np.diag(s) @ R.T
        stress = voigt(t) * [1, 1, 1, 0.5, 0.5, 0.5]
        np.testing.assert_allclose(principal(stress), np.sort(s)[::-1], atol=1e-14)
        assert von_mises(stress) == pytest.approx(np.sqrt(0.5 * ((4) ** 2 + 1.5**2 + 2.5**2)), rel=1e-14)


@pytest.fixture(scope="module")
def random_model(box):
    mesh = shaken(box("hex8", region=np.repeat([1, 2], 4), materials={1: (E, NU, RHO), 2: (7e10, 0.33, 2700.0)}), 0.03)
    facets = exterior_facets(mesh)
    rng = np.random.default_rng(7)
    field = rng.standard_normal((3 * len(mesh.position), 5))
    parameters = (Parameter("E1", "youngs_modulus", (1,), E), Parameter("rho", "density", (2,), 2700.0))
    return surface_model(mesh, facet_strain(mesh, facets), field, parameters), facets


def test_stress_is_affine_in_a_free_modulus(random_model):
    model, facets = random_model
    q = np.random.default_rng(8).standard_normal(5)
    once, twice = (surface_state(model, {"E1": factor * E}, q).stress for factor in (1, 2))
    factor = np.where(facets.region == 1, 2.0, 1.0)[:, None]
    np.testing.assert_allclose(twice, factor * once, rtol=1e-14)
    lam, mu = (7e10 * NU_ for NU_ in (0.33 / (1.33 * 0.34), 0.5 / 1.33))
    strain = surface_state(model, {"E1": E}, q).strain[facets.region == 2]
    expected = 2 * mu * strain * [1, 1, 1, 0.5, 0.5, 0.5]
    expected[:, :3] += lam * strain[:, :3].sum(axis=1, keepdims=True)
    np.testing.assert_allclose(once[facets.region == 2], expected, rtol=1e-13)


def test_standard_deviations_are_those_of_draws(random_model):
    model, facets = random_model
    rng = np.random.default_rng(9)
    q = rng.standard_normal(5)
    A = rng.standard_normal((6, 6))
    scale = np.r_[np.full(5, 2e-3), 2e-3 * E]
    P = (A @ A.T) * np.outer(scale, scale)
    state = surface_state(model, {"E1": E}, q, P, ("E1",))
    draws = 20_000
    x = np.r_[q, E] + rng.multivariate_normal(np.zeros(6), P / np.outer(scale, scale), draws) * scale
    some = np.linspace(0, len(facets.kind) - 1, 6).astype(int)
    strain = np.einsum("pir,dr->dpi", model.strain[some], x[:, :5])
    factor = np.where(facets.region[some] == 1, x[:, 5:], 7e10)[..., None]
    nu = np.where(facets.region[some] == 1, NU, 0.33)[:, None]
    stress = factor / (1 + nu) * strain * [1, 1, 1, 0.5, 0.5, 0.5]
    stress[..., :3] += factor * nu / ((1 + nu) * (1 - 2 * nu)) * strain[..., :3].sum(axis=2, keepdims=True)
    within = 4 / np.sqrt(2 * draws)
    np.testing.assert_allclose(state.strain_std[some], strain.std(axis=0), rtol=within)
    np.testing.assert_allclose(state.stress_std[some], stress.std(axis=0), rtol=within)
    np.testing.assert_allclose(state.von_mises_std[some], von_mises(stress).std(axis=0), rtol=within)


def test_at_rest_von_mises_has_the_root_mean_square_for_its_deviation(random_model):
    model, _ = random_model
    P = np.diag(np.arange(1.0, 6.0))
    state = surface_state(model, {"E1": E}, np.zeros(5), P)
    draws = np.random.default_rng(3).standard_normal((20_000, 5)) * np.sqrt(np.diag(P))
    stress = np.stack([surface_state(model, {"E1": E}, e).stress[:4] for e in np.eye(5)])
    mises = von_mises(np.einsum("rpi,dr->dpi", stress, draws))
    np.testing.assert_allclose(state.von_mises_std[:4], np.sqrt((mises**2).mean(axis=0)), rtol=0.03)


def test_blocks_of_several_kinds_and_ids_in_any_order(box, mesh_of):
    left, right = box("hex8", (2, 1, 1)), box("wedge6", (1, 1, 1))
    position = np.vstack([left.position, right.position + np.array([1, 0, 0])])
    wedges = right.blocks[0].nodes + len(left.position)
    mesh = mesh_of(position, [("hex8", left.blocks[0].nodes, 1), ("wedge6", wedges, 1)])
    mesh = replace(mesh, blocks=tuple(replace(block, ids=9 - block.ids) for block in mesh.blocks))
    facets = exterior_facets(mesh)
    x, field = mesh.position[:, 0], np.zeros_like(mesh.position)
    field[:, 1] = np.where(x > 1, 5 * (x - 1), 0.0)
    strain = tensors(facet_strain(mesh, facets), field)
    assert np.all((np.abs(strain[:, 3]) > 1) == np.isin(facets.element_id, [5, 6]))


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
    assert finer.prescribed[x[:, 2] == 0, 2].all()
    assert finer.prescribed[x[:, 0] == 0].all()
    inside = (x[:, 0] > 0) & (x[:, 0] < 2.9) & (x[:, 2] > 0) & (x[:, 2] < 1.9) & (x[:, 1] > 0.1) & (x[:, 1] < 3.9)
    assert not finer.prescribed[inside].any()
    np.testing.assert_allclose(finer.force.reshape(-1, 3).sum(axis=0), [0, 1000, 0], atol=1e-6)
    assert np.count_nonzero(np.abs(finer.force) > 1e-6) == 1
