"""The model on its free motions, and loads on it: weight, rotation and point masses, forces and moments of decks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import DeckError, UserError
from strainsight.fem.factorisation import factorise
from strainsight.fem.loads import (
    MISALIGNMENTS,
    PointLoad,
    input_shape,
    misaligned_shape,
    misalignment_shapes,
    nodal_forces,
)
from strainsight.fem.mass import mass_properties
from strainsight.fem.model import build_model, nodal
from strainsight.fem.nodal_forces import body_forces, with_body_forces
from strainsight.mesh.joins import BodyForce, NodalForces, PointMass, RigidElement

from ..bodies import RHO, E, body, held, with_nodes
from ..solids import SOLIDS

G = np.array([1.0, -2.0, 9.81])
OMEGA, CENTRE = np.array([3.0, -1.0, 2.0]), np.array([0.3, 0.2, -0.4])


def distorted(u, v, w):
    x = np.array([u, v, w])
    return x + 0.1 * np.prod(np.sin(np.pi * x)) * np.array([1, -1, 0.5])


@pytest.mark.parametrize("kind", list(SOLIDS))
def test_resultant_and_moment_are_those_of_a_rigid_box(kind):
    """F = m a(x̄) and, about the centre x̄, M = −ω × Jω J = m/12 (b² + c², …) of a box of 2 × 1 × 1 m."""
    mesh = body(kind, (2, 1, 1), distorted)
    x = mesh.position
    own = body_forces(mesh, BodyForce(G, OMEGA, CENTRE, factor=2.0))
    m, middle, sides = 2 * RHO, np.array([1, 0.5, 0.5]), np.array([2.0, 1, 1])
    a = G + OMEGA @ OMEGA * (middle - CENTRE) - OMEGA * (OMEGA @ (middle - CENTRE))
    np.testing.assert_allclose(own.force.sum(axis=0), 2 * m * a, atol=1e-12 * m * np.linalg.norm(a))
    J = m / 12 * np.diag(sides @ sides - sides**2)
    turned = np.cross(x[own.nodes] - middle, own.force).sum(axis=0)
    np.testing.assert_allclose(turned, -2 * np.cross(OMEGA, J @ OMEGA), atol=1e-9 * m * (OMEGA @ OMEGA))
    assert own.regions == (1,)


def test_a_hanging_bar_stretches_by_its_weight():
    """ν = 0: u(z) = ρg/E (L z − z²/2) below the support, exactly in quadratic elements."""
    mesh = body("hex20", (1, 1, 4), lambda u, v, w: (0.1 * u, 0.1 * v, w - 4))
    mesh = held(replace(mesh, materials={1: replace(mesh.materials[1], poisson_ratio=0.0)}), mesh.position[:, 2] == 0)
    model = build_model(mesh)
    S = input_shape(model, [PointLoad("g", gravity=(0, 0, -2.0))])
    u = nodal(model, factorise(model.stiffness.constant).solve(S)).reshape(-1, 3)
    z = -mesh.position[:, 2]
    np.testing.assert_allclose(u[:, 2], -RHO / E * (4 * z - z**2 / 2), rtol=1e-9, atol=1e-20)


def test_a_point_mass_pulls_where_it_is_and_turns_its_node():
    """m a at its centre and −ω × Jω, against particles that make up mass and inertia."""
    mesh = body("hex8", (1, 1, 1), lambda *u: u)
    rng = np.random.default_rng(2)
    r, dm = rng.normal(size=(6, 3)), rng.uniform(0.5, 2, 6)
    m, centre = dm.sum(), dm @ r / dm.sum()
    J = sum(d * (q @ q * np.eye(3) - np.outer(q, q)) for d, q in zip(dm, r - centre, strict=True))
    node = 8
    mesh = replace(
        with_nodes(mesh, [0.5, 0.5, 2.0]),
        rigid=(RigidElement(1, node, np.array([4, 5, 6, 7]), (0, 1, 2)),),
        point_masses=(PointMass(7, node, m, centre, J),),
    )
    both = body_forces(mesh, BodyForce(G, OMEGA, CENTRE))
    alone = body_forces(mesh, BodyForce(G, OMEGA, CENTRE, elements=np.array([7])))
    assert alone.regions == ()
    assert alone.nodes.tolist() == [node]
    each = dm[:, None] * (G + np.cross(np.cross(OMEGA, mesh.position[node] + r - CENTRE), OMEGA))
    np.testing.assert_allclose(alone.force[0], each.sum(axis=0))
    np.testing.assert_allclose(alone.moment[0], np.cross(r, each).sum(axis=0))
    np.testing.assert_allclose(both.force[both.nodes == node][0], alone.force[0])


@pytest.fixture(scope="module")
def clamped():
    mesh = body("hex8", (3, 1, 1), lambda *u: u)
    return held(mesh, mesh.position[:, 0] == 0)


def test_a_load_of_the_deck_has_its_weight_by_the_density_of_the_mesh(clamped):
    weight, push = BodyForce(acceleration=G), NodalForces(np.array([3]), np.array([[1.0, 0, 0]]), body=(BodyForce(G),))
    light = replace(clamped, materials={1: replace(clamped.materials[1], density=10.0)})
    light = replace(light, loads={"LOAD-1": push, "LOAD-2": NodalForces(np.array([0]), np.zeros((1, 3)))})
    found = with_body_forces(light).loads
    np.testing.assert_allclose(found["LOAD-1"].force.sum(axis=0), 30 * G + [1, 0, 0])
    assert (found["LOAD-1"].regions, found["LOAD-1"].body) == ((1,), ())
    assert found["LOAD-2"] is light.loads["LOAD-2"]
    np.testing.assert_allclose(body_forces(light, weight).force.sum(axis=0), 30 * G)


def test_a_factor_keeps_the_numbers_of_the_deck_and_the_resultant_does_not(clamped):
    pair = NodalForces(np.array([5, 6]), np.array([[0, 3.0, 0], [0, 4.0, 0]]))
    mesh = replace(clamped, loads={"LOAD-1": pair, "LOAD-2": replace(pair, force=np.array([[0, 3.0, 0], [0, -3.0, 0]]))})
    one, times = (nodal_forces(mesh, PointLoad("F", deck_load="LOAD-1", factor=f)).force for f in (False, True))
    np.testing.assert_allclose(7 * one, times)
    with pytest.raises(UserError, match="the resultant of the forces of LOAD-2 is zero") as caught:
        nodal_forces(mesh, PointLoad("F", deck_load="LOAD-2"))
    assert "factor: true" in caught.value.remedy
    assert input_shape(build_model(mesh), [PointLoad("F", deck_load="LOAD-2", factor=True)]).any()


def test_a_moment_of_the_deck_is_that_of_a_load_with_a_moment(clamped):
    rim = np.flatnonzero(clamped.position[:, 0] == 3)
    mesh = replace(
        with_nodes(clamped, [3, 0.5, 0.5], ids=[99]),
        rigid=(RigidElement(1, 16, rim, (0, 1, 2)),),
        loads={"LOAD-1": NodalForces(np.array([16]), np.zeros((1, 3)), np.array([[0, 0, 5.0]]))},
    )
    model = build_model(mesh)
    S = input_shape(model, [PointLoad("M", deck_load="LOAD-1", factor=True), PointLoad("T", node_id=99, moment=(0, 0, 1))])
    assert S[:, 0].any()
    np.testing.assert_allclose(S[:, 0], 5 * S[:, 1])


def test_moment_on_dependent_node_acts_on_its_reference():
    mesh = body("hex8", (3, 1, 1), lambda *u: u)
    mesh = held(mesh, mesh.position[:, 0] == 0)
    end = np.flatnonzero(mesh.position[:, 0] == 3)
    mesh = replace(
        with_nodes(mesh, [3, 0.5, 0.5], [4, 0.7, 0.5], [9, 9, 9], ids=[98, 99, 100]),
        rigid=(
            RigidElement(1, 16, end[1:], (0, 1, 2)),
            RigidElement(2, 16, np.array([end[0], 17]), (0, 1, 2, 3, 4, 5)),
        ),
    )
    f, M = np.array([2.0, -1.0, 3.0]), np.array([[4.0, 5.0, -6.0]])

    def shape(*moment):
        nodes = np.array([16, *(node for node, _ in moment)])
        load = NodalForces(nodes, np.array([f, *(np.zeros(3) for _ in moment)]), np.array([np.zeros(3), *(m for _, m in moment)]))
        model = build_model(replace(mesh, loads={"LOAD-1": load}))
        return input_shape(model, [PointLoad("F", deck_load="LOAD-1", factor=True)])[:, 0]

    for node in (17, end[0]):
        np.testing.assert_allclose(shape((node, M[0])), shape((16, M[0])))
    with pytest.warns(UserWarning, match="the moment on node 100 has no effect: the node has no rotations"):
        np.testing.assert_allclose(shape((18, M[0])), shape())


def test_gravity_can_be_rotated_but_not_shifted(clamped):
    model = build_model(clamped)
    loads = [PointLoad("g", gravity=(0, 0, -1.0)), PointLoad("w", rotation=((1.0, 0, 0), (0, 5.0, 0)))]
    shapes = misalignment_shapes(model, loads)
    assert [bool(shapes[:, 0, i].any()) for i in range(MISALIGNMENTS)] == [True, True, False, False]
    assert not shapes[:, 1].any()
    small = 1e-6
    for i in range(2):
        turn = small * np.eye(2)[i]
        apart = [misaligned_shape(model, loads[0], s * turn, np.array([0.3, 0.1])) for s in (1, -1)]
        np.testing.assert_allclose((apart[0] - apart[1]) / (2 * small), shapes[:, 0, i], atol=1e-6 * np.abs(shapes).max())


OFFSET = np.array([0.3, -0.2, 0.5])
INERTIA = np.array([[2.0, 0.3, -0.1], [0.3, 1.5, 0.2], [-0.1, 0.2, 1.0]]) * 1e3


@pytest.fixture(scope="module")
def bar(box):
    """A bar whose tip follows node 900; 901 lies off it."""
    mesh = box("hex8", (3, 1, 1), size=(3.0, 1.0, 1.0), clamp_root=True)
    n = len(mesh.position)
    tip = np.flatnonzero(np.isclose(mesh.position[:, 0], 3.0))
    reference = np.array([3.2, 0.6, 0.4])
    return replace(
        with_nodes(mesh, reference, reference + OFFSET, ids=[900, 901]),
        rigid=(RigidElement(1, n, tip, (0, 1, 2)),),
    )


def mass_of(mesh):
    return build_model(mesh).mass.constant.toarray()


@pytest.mark.parametrize("components", [(0, 1, 2), (0, 1, 2, 3, 4, 5)])
def test_an_offset_is_a_rigid_arm_to_a_node_that_follows_in_rotation(bar, components):
    n = len(bar.position) - 2
    with_offset = replace(bar, point_masses=(PointMass(4, n, 500.0, OFFSET, INERTIA),))
    arm = RigidElement(2, n, np.array([n + 1]), components)
    on_arm = replace(bar, rigid=(*bar.rigid, arm), point_masses=(PointMass(4, n + 1, 500.0, inertia=INERTIA),))
    expected, mass = mass_of(with_offset), mass_of(on_arm)
    follows = len(components) == 6
    assert np.allclose(mass, expected, rtol=0, atol=1e-12 * np.abs(expected).max()) == follows


def test_energy_of_a_turning_body_has_its_inertia_and_that_of_its_centre(bar):
    """ωᵀJω + m |ω × (x + d)|² beside that of the bar."""
    free = replace(bar, fixed=np.zeros((0, 2), dtype=np.int64), position=bar.position - 1.0)
    n = len(bar.position) - 2
    heavy = build_model(replace(free, point_masses=(PointMass(4, n, 500.0, OFFSET, INERTIA),)), supported=False)
    plain = build_model(free, supported=False)
    omega = np.array([0.3, -0.8, 0.5])
    z = np.zeros(heavy.constraint.transform.shape[0])
    z[: 3 * len(free.position)] = np.cross(omega, free.position).ravel()
    z[heavy.constraint.reference_rows[n] :][:3] = omega
    z = z[heavy.constraint.free_rows]
    np.testing.assert_allclose(
        nodal(heavy, z[:, None])[: 3 * n, 0], np.cross(omega, free.position[:n]).ravel(), atol=1e-13
    )
    centre = free.position[n] + OFFSET
    expected = omega @ INERTIA @ omega + 500.0 * np.sum(np.cross(omega, centre) ** 2)
    assert z @ (heavy.mass.constant - plain.mass.constant) @ z == pytest.approx(expected, rel=1e-12)


def test_a_node_without_rotations_takes_the_mass_only(bar):
    node = int(np.flatnonzero(np.isclose(bar.position[:, 0], 1.0))[0])
    at_node = PointMass(4, node, 500.0)
    off = replace(at_node, offset=OFFSET, inertia=INERTIA)
    expected = mass_of(replace(bar, point_masses=(at_node,)))
    np.testing.assert_array_equal(mass_of(replace(bar, point_masses=(off,))), expected)
    difference = expected - mass_of(bar)
    assert np.trace(difference) == pytest.approx(3 * 500.0)
    assert np.count_nonzero(np.abs(difference) > 1e-6) == 3


def test_the_centre_of_mass_is_that_of_all_parts(bar):
    n = len(bar.position) - 2
    masses = (PointMass(4, n, 500.0, OFFSET, INERTIA), PointMass(5, 3, 20.0))
    mass, centre = mass_properties(replace(bar, point_masses=masses))
    parts = [(3 * 7850.0, np.array([1.5, 0.5, 0.5])), (500.0, bar.position[n + 1]), (20.0, bar.position[3])]
    assert mass == pytest.approx(sum(m for m, _ in parts), rel=1e-12)
    np.testing.assert_allclose(centre, sum(m * x for m, x in parts) / mass, rtol=1e-12)


def test_invalid_bodies_are_refused(bar):
    n = len(bar.position) - 2
    with pytest.raises(DeckError, match="point mass 4 has the mass -1 kg"):
        build_model(replace(bar, point_masses=(PointMass(4, n, -1.0),)))
    skew = np.eye(3) + np.eye(3, k=1)
    with pytest.raises(DeckError, match="the inertia tensor of point mass 4 is not symmetric"):
        build_model(replace(bar, point_masses=(PointMass(4, n, 1.0, inertia=skew),)))


@pytest.fixture(scope="module")
def beam(box):
    """A beam with a rigid tip whose reference node 100 carries 3 kg."""
    mesh = box("hex20", (4, 1, 1), size=(4.0, 1.0, 1.0), clamp_root=True)
    tip = np.flatnonzero(np.isclose(mesh.position[:, 0], 4.0))
    n = len(mesh.position)
    return replace(
        with_nodes(mesh, [4.0, 0.5, 0.5], ids=[1000]),
        rigid=(RigidElement(1, n, tip, (0, 1, 2)),),
        point_masses=(PointMass(2, n, 3.0),),
        node_sets={"tip": mesh.node_ids[tip], "nothing": np.array([], dtype=np.int64)},
        loads={
            "FORCE-1": NodalForces(np.array([n, tip[0]]), np.array([[0.0, 3.0, 0.0], [0.0, 0.0, -4.0]])),
            "FORCE-2": NodalForces(tip[:2], np.array([[0.0, 3.0, 0.1], [0.0, -3.0, -0.1]])),
            "FORCE-3": NodalForces(np.flatnonzero(mesh.position[:, 0] == 0), np.ones((8, 3))),
        },
    )


def test_a_tip_force_does_the_work_of_its_displacement(beam):
    model = build_model(beam)
    loads = [
        PointLoad("x", (2.0, 0.0, 0.0), node_id=1000),
        PointLoad("set", (0.0, 0.0, 1.0), node_set="tip"),
        PointLoad("oblique", (1.0, 1.0, 0.0), node_id=1000),
    ]
    S = input_shape(model, loads)
    field = np.random.default_rng(0).normal(size=(model.size, 1))
    z = nodal(model, field).reshape(-1, 3)
    tip = np.isin(beam.node_ids, beam.node_sets["tip"])
    assert np.allclose((S.T @ field)[:, 0], [z[-1, 0], z[tip, 2].mean(), (z[-1, 0] + z[-1, 1]) / np.sqrt(2)])


def test_a_load_of_the_deck_has_a_unit_resultant_and_its_distribution(beam):
    model = build_model(beam)
    reference, node = beam.node_ids[beam.loads["FORCE-1"].nodes]
    parts = [PointLoad("a", (0, 1, 0), node_id=int(reference)), PointLoad("b", (0, 0, -1), node_id=int(node))]
    S = input_shape(model, [PointLoad("F", deck_load="FORCE-1"), *parts])
    assert np.allclose(S[:, 0], 0.6 * S[:, 1] + 0.8 * S[:, 2], rtol=0, atol=1e-15)


def test_constrained_mass_keeps_the_point_mass_and_the_body(beam):
    model = build_model(replace(beam, fixed=np.zeros((0, 2), dtype=np.int64)), supported=False)
    e = np.zeros(model.size)
    e[(model.constraint.free_rows < 3 * len(beam.position)) & (model.constraint.free_rows % 3 == 1)] = 1.0
    assert e @ model.mass.constant @ e == pytest.approx(4.0 * 7850.0 + 3.0, rel=1e-13)


@pytest.mark.parametrize(
    ("load", "message"),
    [
        (PointLoad("F", (0, 0, 1), node_id=77777), "node 77777, which does not exist"),
        (PointLoad("F", (0, 0, 1), node_set="tips"), "node set 'tips', which does not exist"),
        (PointLoad("F", (0, 0, 1), node_set="nothing"), "which is empty"),
        (PointLoad("F", (0, 0, 0), node_id=1000), "direction"),
        (PointLoad("F", (0, 0, 1), node_id=1), "node 1, which cannot move in the direction of the load"),
        (PointLoad("F", (0, 0, 1)), "must act on a node or on a node set"),
        (PointLoad("F", node_id=1, deck_load="FORCE-1"), "must act on a node or on a node set, or be a load of the deck"),
        (PointLoad("F", (0, 0, 1), deck_load="FORCE-1"), "direction"),
        (PointLoad("F", deck_load="FORCE-9"), "'FORCE-9' of the deck, which does not exist"),
        (PointLoad("F", deck_load="FORCE-2"), "the resultant of the forces of FORCE-2 is zero"),
        (PointLoad("F", deck_load="FORCE-3"), "cannot move"),
    ],
)
def test_loads_that_cannot_act_are_refused(beam, load, message):
    with pytest.raises(UserError, match=message):
        input_shape(build_model(beam), [load])


def test_a_mesh_with_nothing_to_move_is_refused(box):
    mesh = box("tet4", (1, 1, 1))
    with pytest.raises(DeckError, match="no elements"):
        build_model(replace(mesh, blocks=()))
    with pytest.raises(DeckError, match="every node is clamped"):
        build_model(replace(mesh, fixed=np.array([(i, c) for i in range(8) for c in range(3)])))


def test_forces_of_a_deck_on_clamped_nodes_are_reported_and_push_only_the_support(beam):
    root, tip = int(np.flatnonzero(beam.position[:, 0] == 0)[0]), len(beam.position) - 1
    both = NodalForces(np.array([root, tip]), np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 3.0]]))
    model = build_model(replace(beam, loads={"FORCE-4": both}))
    with pytest.warns(UserWarning, match=r"25 % of the resultant has no effect, because 1 of 2 loaded nodes .* cannot move"):
        S = input_shape(model, [PointLoad("F", deck_load="FORCE-4")])
    np.testing.assert_allclose(S, 0.75 * input_shape(model, [PointLoad("F", (0, 0, 1), node_id=1000)]), atol=1e-15)
