"""Bodies reduced to their interfaces: statics, weight and rigid motion of the full model, and close to it in low modes."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import eigvalsh
from scipy.spatial.transform import Rotation

from strainsight.decks.reader import read_mesh
from strainsight.errors import InfeasibleError, UserError
from strainsight.fem.affine import Parameter
from strainsight.fem.factorisation import factorise
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import modes as lowest_modes
from strainsight.mesh.joins import PointMass, RigidElement
from strainsight.rom.craig_bampton import (
    craig_bampton,
    floating_basis,
    inertia_loads,
    residual_vectors,
    rigid_field,
    rigid_motions,
)
from strainsight.rom.inertia import inertia_invariants

from ..bodies import with_nodes
from .bars import (
    MESHES,
    RHO,
    ROOT,
    SIDE,
    SIZE,
    START,
    TIP,
    bar,
    dense,
    frequencies,
    gauge_rows,
    inertia_of,
    pick,
    rigid,
)


def test_a_load_on_the_interface_moves_it_and_all_else_as_in_the_full_model(clamped):
    body = craig_bampton(clamped, [TIP, SIDE], modes=5)
    B = pick(clamped, TIP, SIDE)
    exact = np.linalg.solve(dense(clamped.stiffness.constant), B.T)
    reduced = np.linalg.solve(body.stiffness.constant, np.eye(body.basis.shape[1])[:, :12])
    assert np.allclose(body.basis @ reduced, exact, rtol=0, atol=1e-10 * np.abs(exact).max(axis=0))
    flexibility = B @ exact
    assert np.allclose(reduced[:12], flexibility, rtol=0, atol=1e-10 * np.abs(flexibility).max())


def test_reduction_with_all_modes_is_exact():
    model = build_model(bar((3, 2, 1), clamped=True))
    body = craig_bampton(model, [TIP], modes=model.size - 6)
    exact = frequencies(dense(model.stiffness.constant), dense(model.mass.constant))
    assert body.basis.shape[1] == model.size
    assert body.cut == np.inf
    assert np.allclose(frequencies(body.stiffness.constant, body.mass), exact, rtol=1e-9)


def test_modes_are_fixed_interface_modes(clamped):
    body = craig_bampton(clamped, [TIP, SIDE], modes=6)
    i = np.flatnonzero(~pick(clamped, TIP, SIDE).any(axis=0))
    K, M = (dense(X.constant)[np.ix_(i, i)] for X in (clamped.stiffness, clamped.mass))
    exact = frequencies(K, M)
    assert np.allclose(body.frequency, exact[:6], rtol=1e-9)
    assert body.cut == pytest.approx(exact[6], rel=1e-9)


@pytest.mark.parametrize("count", [0, 8, 32])
def test_frequencies_are_too_high_by_at_most_half_the_square_of_their_share_of_the_cut(clamped, count):
    """δ² ≤ λ/λ_cut is the energy of a mode that the kept shapes miss, and (1 − δ²)/(1 − 2δ²) bounds the growth of λ."""
    exact = frequencies(dense(clamped.stiffness.constant), dense(clamped.mass.constant))
    body = craig_bampton(clamped, [TIP, SIDE], modes=count)
    found = frequencies(body.stiffness.constant, body.mass)
    exact = exact[: len(found)]
    low = exact < 0.5 * body.cut
    missed = (exact[low] / body.cut) ** 2
    assert low[:2].all()
    assert np.all(found >= exact * (1 - 1e-9))
    assert np.all(found[low] <= exact[low] * np.sqrt((1 - missed) / (1 - 2 * missed)))


@pytest.mark.parametrize("kept", [1, 12, 13, 30])
def test_a_cut_off_keeps_every_mode_up_to_it(clamped, kept):
    by_count = craig_bampton(clamped, [TIP], modes=kept)
    body = craig_bampton(clamped, [TIP], cutoff=0.5 * (by_count.frequency[-1] + by_count.cut))
    assert np.allclose(body.frequency, by_count.frequency, rtol=1e-9)
    assert body.cut == pytest.approx(by_count.cut, rel=1e-9)


def test_a_cut_off_below_the_first_mode_leaves_the_static_shapes(clamped):
    body = craig_bampton(clamped, [TIP, SIDE], cutoff=1.0)
    assert body.basis.shape[1] == 12 + 3
    assert len(body.frequency) == 0
    assert body.cut > 1.0


def on_the_interface(model, *nodes):
    """z_b (6k, 6) of three translations and three rotations about the origin."""
    x = np.array([model.mesh.position[model.mesh.node_index(node)] for node in nodes])
    moved = rigid(x).reshape(-1, 3, 6)
    turned = np.broadcast_to(np.hstack([np.zeros((3, 3)), np.eye(3)]), moved.shape)
    return np.concatenate([moved, turned], axis=1).reshape(-1, 6)


@pytest.mark.parametrize("nodes", [(TIP,), (ROOT, TIP), (SIDE, ROOT, TIP)])
def test_a_rigid_motion_of_the_interface_takes_every_node_along_without_force(free, nodes):
    body = craig_bampton(free, nodes, modes=3)
    r = np.vstack([on_the_interface(free, *nodes), np.zeros((body.basis.shape[1] - 6 * len(nodes), 6))])
    assert np.allclose(nodal(free, body.basis @ r), rigid(free.mesh.position), rtol=0, atol=1e-13)
    K = body.stiffness.constant
    full = free.stiffness.constant.diagonal().max()
    assert np.all(np.abs(K @ r) <= 1e-13 * full)


def test_the_inertia_of_rigid_motions_is_that_of_a_cuboid(free):
    """m, m x̄ and ∫ρ(|x|² I − x xᵀ), by the formulae of a cuboid with its centre off the origin."""
    body = craig_bampton(free, [ROOT, TIP, SIDE], modes=3)
    r = np.vstack([on_the_interface(free, ROOT, TIP, SIDE), np.zeros((body.basis.shape[1] - 18, 6))])
    inertia = r.T @ body.mass @ r
    m, c = RHO * SIZE.prod(), START + 0.5 * SIZE
    second = m * (np.diag(SIZE**2) / 12 + np.outer(c, c))
    cross = np.array([[0, -c[2], c[1]], [c[2], 0, -c[0]], [-c[1], c[0], 0]])
    expected = np.block([[m * np.eye(3), -m * cross], [m * cross, np.trace(second) * np.eye(3) - second]])
    assert np.allclose(inertia, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("turned", [False, True])
def test_a_hinge_leaves_one_rigid_motion(turned):
    axes = Rotation.from_rotvec([0.4, -0.3, 0.8]).as_matrix() if turned else np.eye(3)
    mesh = bar()
    root = mesh.node_index(ROOT)
    mesh = replace(mesh, fixed=np.array([(root, c) for c in (0, 1, 2, 3, 5)]), axes={root: axes} if turned else {})
    model = build_model(mesh, supported=False)
    left = rigid_motions(model)
    assert left.shape == (model.size, 1)
    spin = np.cross(axes[:, 1], mesh.position - mesh.position[root]).ravel()
    shape = nodal(model, left)[:, 0]
    assert abs(shape @ spin) == pytest.approx(np.linalg.norm(shape) * np.linalg.norm(spin), rel=1e-13)
    lam = eigvalsh(craig_bampton(model, [TIP], modes=3).stiffness.constant)
    assert abs(lam[0]) <= 1e-13 * lam[-1]
    assert lam[1] > 1e-8 * lam[-1]


def test_a_supported_body_has_no_rigid_motion(clamped, free):
    assert rigid_motions(clamped).shape == (clamped.size, 0)
    assert rigid_motions(free).shape == (free.size, 6)


def test_interface_motions_are_along_the_basic_axes_whatever_the_axes_of_the_node(free):
    turned = {free.mesh.node_index(TIP): Rotation.from_rotvec([0.5, 1.0, -0.7]).as_matrix()}
    own = build_model(replace(free.mesh, axes=turned), supported=False)
    plain = craig_bampton(free, [ROOT, TIP], modes=0)
    body = craig_bampton(own, [ROOT, TIP], modes=0)
    K = plain.stiffness.constant
    assert np.allclose(body.stiffness.constant, K, rtol=0, atol=1e-11 * np.abs(K).max())
    assert np.allclose(nodal(own, body.basis), nodal(free, plain.basis), rtol=0, atol=1e-10)


def test_rows_of_an_interface_are_the_motions_of_the_node(free):
    body = craig_bampton(free, [SIDE, TIP], modes=4)
    for node in (SIDE, TIP):
        assert np.allclose(body.interface[node], pick(free, node) @ body.basis, rtol=0, atol=1e-12)


def test_floating_basis_equals_clamped_body(free, clamped):
    seen = floating_basis(craig_bampton(free, [ROOT, TIP, SIDE], modes=5), ROOT)
    held = craig_bampton(clamped, [TIP, SIDE], modes=5)
    assert (seen.basis.shape[1], held.basis.shape[1]) == (17 + 6, 17 + 3)
    for found, exact in ((seen.stiffness.constant, held.stiffness.constant), (seen.mass, held.mass)):
        found, exact = found[:17, :17], exact[:17, :17]
        scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
        sign = np.sign(np.einsum("ij,ij->j", nodal(free, seen.basis[:, :17]), nodal(clamped, held.basis[:, :17])))
        assert np.all(np.abs(found * np.outer(sign, sign) - exact) <= 1e-9 * scale)
    assert not seen.interface[ROOT].any()
    assert eigvalsh(seen.stiffness.constant)[0] > 0


MODULI = (Parameter("E1", "youngs_modulus", (1,), 2.1e11), Parameter("E2", "youngs_modulus", (2,), 7.0e10))
REFERENCE = {p.name: p.reference for p in MODULI}


def test_the_stiffness_is_affine_in_the_moduli():
    model = build_model(bar(clamped=True), MODULI)
    body = craig_bampton(model, [TIP], modes=4, reference=REFERENCE)
    for theta in (REFERENCE, {"E1": 1.7e11, "E2": 9e10}):
        exact = body.basis.T @ (model.stiffness.at(theta) @ body.basis)
        assert np.allclose(body.stiffness.at(theta), exact, rtol=0, atol=1e-13 * np.abs(exact).max())
    plain = craig_bampton(build_model(bar(clamped=True)), [TIP], modes=4)
    assert np.allclose(body.frequency, plain.frequency, rtol=1e-10)


@pytest.mark.parametrize(
    ("nodes", "words"),
    [
        ((), "has no interface node"),
        ((77777,), "no node 77777"),
        ((TIP, TIP), "twice"),
        ((ROOT,), "clamped in translation x"),
        ((20,), "no rotations"),
    ],
)
def test_invalid_interface_nodes_are_refused(clamped, nodes, words):
    with pytest.raises(UserError, match=words):
        craig_bampton(clamped, nodes, modes=1)


def test_a_node_that_follows_an_interface_is_refused(free):
    n = len(free.mesh.position)
    arm = RigidElement(9, free.mesh.node_index(TIP), np.array([n]), (0, 1, 2, 3, 4, 5))
    lug = RigidElement(10, n, np.array([40]), (0, 1, 2))
    mesh = replace(with_nodes(free.mesh, [2.0, 0.0, 0.0], ids=[950]), rigid=(*free.mesh.rigid, arm, lug))
    model = build_model(mesh, supported=False)
    with pytest.raises(UserError, match="950 are not independent"):
        craig_bampton(model, [TIP, 950], modes=1)
    # alone it stands for the node that it follows
    alone = craig_bampton(model, [950], modes=1).interface[950]
    assert np.allclose(alone[:3, :3], np.eye(3))


def test_invalid_reduction_options_are_refused(clamped, free):
    with pytest.raises(UserError, match="either"):
        craig_bampton(clamped, [TIP])
    with pytest.raises(UserError, match="either"):
        craig_bampton(clamped, [TIP], modes=2, cutoff=100.0)
    with pytest.raises(InfeasibleError, match="-1 modes are requested"):
        craig_bampton(clamped, [TIP], modes=-1)
    with pytest.raises(InfeasibleError, match="100000 modes are requested"):
        craig_bampton(clamped, [TIP], modes=100_000)
    with pytest.raises(InfeasibleError, match="0 Hz"):
        craig_bampton(clamped, [TIP], cutoff=0.0)
    model = build_model(bar(clamped=True), (*MODULI, Parameter("rho", "density", (1,), RHO)))
    with pytest.raises(UserError, match="rho is a density"):
        craig_bampton(model, [TIP], modes=1, reference=REFERENCE)
    with pytest.raises(UserError, match="E2 has no reference"):
        craig_bampton(build_model(bar(clamped=True), MODULI), [TIP], modes=1, reference={"E1": 2.1e11})
    body = craig_bampton(free, [ROOT, TIP], modes=1)
    with pytest.raises(UserError, match="node 903 is not an interface"):
        floating_basis(body, SIDE)
    with pytest.raises(UserError, match="already fixed to node 901"):
        floating_basis(floating_basis(body, ROOT), TIP)


@pytest.mark.parametrize("count", [0, 1, 40])
def test_weight_deforms_it_as_the_full_model_with_any_number_of_modes(clamped, count):
    body = craig_bampton(clamped, [TIP, SIDE], modes=count)
    f = inertia_of(clamped, rigid(clamped.mesh.position)[:, :3])
    exact = factorise(clamped.stiffness.constant).solve(f)
    found = np.linalg.solve(body.stiffness.constant, body.basis.T @ f)
    assert body.basis.shape[1] == 12 + count + 3
    assert np.allclose(body.basis @ found, exact, rtol=0, atol=1e-9 * np.abs(exact).max(axis=0))
    strain = gauge_rows(clamped, exact)
    assert np.allclose(gauge_rows(clamped, body.basis) @ found, strain, rtol=0, atol=1e-9 * np.abs(strain).max(axis=0))


@pytest.mark.parametrize("count", [0, 40])
def test_a_body_that_moves_deforms_as_the_full_one_under_any_acceleration_of_its_frame(free, clamped, count):
    body = floating_basis(craig_bampton(free, [ROOT, TIP], modes=count), ROOT)
    motion = rigid(free.mesh.position)
    exact = factorise(clamped.stiffness.constant).solve(inertia_of(clamped, motion))
    found = np.linalg.solve(body.stiffness.constant, body.basis.T @ inertia_of(free, motion))
    assert body.basis.shape[1] == 6 + count + 6
    field = nodal(clamped, exact)
    assert np.allclose(nodal(free, body.basis) @ found, field, rtol=0, atol=1e-9 * np.abs(field).max(axis=0))
    strain = gauge_rows(clamped, exact)
    assert np.allclose(gauge_rows(free, body.basis) @ found, strain, rtol=0, atol=1e-9 * np.abs(strain).max(axis=0))


@pytest.mark.parametrize("count", [0, 40])
def test_residual_vectors_are_orthonormal(clamped, free, count):
    for model, vectors in ((clamped, 3), (free, 6)):
        body = craig_bampton(model, [TIP, SIDE] if vectors == 3 else [ROOT, TIP], modes=count)
        K, M = body.stiffness.constant[12:, 12:], body.mass[12:, 12:]
        lam = np.diag(K)
        assert len(lam) == count + vectors
        assert len(body.frequency) == count
        assert np.allclose(M, np.eye(len(M)), rtol=0, atol=1e-12)
        assert np.all(np.abs(K - np.diag(lam)) <= 1e-10 * np.sqrt(np.outer(lam, lam)))
        # made of modes that were left out
        assert np.all(lam[count:] >= (2 * np.pi * body.cut) ** 2 * (1 - 1e-9))
        assert np.all(np.diff(lam[count:]) > 0)


def test_inertia_loads_include_clamped_nodes_and_point_masses(free):
    """MR of a free body; of a held one what its multibody weight is."""
    points = (
        PointMass(1, free.mesh.node_index(TIP), 40.0, (0.1, 0.2, -0.3), np.diag([3.0, 4.0, 5.0])),
        PointMass(2, 20, 25.0, (0.0, 0.0, 0.0), np.zeros((3, 3))),
    )
    loose = build_model(replace(free.mesh, point_masses=points), supported=False)
    R = np.linalg.lstsq(loose.constraint.transform.toarray(), rigid_field(loose), rcond=None)[0]
    exact = loose.mass.constant @ R
    assert np.allclose(inertia_loads(loose), exact, rtol=0, atol=1e-12 * np.abs(exact).max())
    held = build_model(replace(bar(side=True, clamped=True), point_masses=points))
    body = craig_bampton(held, [TIP, SIDE], modes=2)
    weight = inertia_invariants(held, body.basis).first_modal.T
    assert np.allclose(body.basis.T @ inertia_loads(held)[:, :3], weight, rtol=0, atol=1e-12 * np.abs(weight).max())


def test_an_interior_of_one_node_or_none_has_no_more_shapes_than_motions():
    mesh = bar((1, 1, 1))
    root, tip = mesh.rigid
    one = build_model(replace(mesh, rigid=(root, replace(tip, nodes=tip.nodes[:3]))), supported=False)
    for count in range(4):
        body = craig_bampton(one, [ROOT, TIP], modes=count)
        assert body.basis.shape[1] == one.size == 15
        assert len(body.frequency) == count
        assert np.linalg.matrix_rank(body.basis) == 15
    none = craig_bampton(build_model(mesh, supported=False), [ROOT, TIP], modes=0)
    assert none.basis.shape[1] == 12
    assert none.cut == np.inf
    with pytest.raises(InfeasibleError, match="has only 0 degrees of freedom apart from"):
        craig_bampton(build_model(mesh, supported=False), [ROOT, TIP], modes=1)


def test_rounding_does_not_flip_an_antisymmetric_vector():
    n, rng = 41, np.random.default_rng(0)
    K = sparse.csr_array(sparse.diags_array([np.full(n, 2.0), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1]))
    M = sparse.csr_array(sparse.eye_array(n))
    s = np.linspace(-1, 1, n)
    F = np.column_stack([s, -(s**3), np.sign(s), -np.sin(5 * s)])
    for _ in range(5):
        shaken = F * (1 + 1e-14 * rng.standard_normal(F.shape))
        V = residual_vectors(shaken, M, factorise(K), np.zeros(0), np.zeros((n, 0)))
        assert np.allclose(V, -V[::-1], atol=1e-9)
        first = np.argmax(np.abs(V) > (1 - 1e-6) * np.abs(V).max(axis=0), axis=0)
        assert np.all(V[first, np.arange(4)] > 0)


def test_the_deck_is_the_one_in_the_list_of_checksums():
    digest, name = (MESHES / "hub-bench.sha256").read_text().split()
    assert hashlib.sha256((MESHES / name).read_bytes()).hexdigest() == digest


@pytest.mark.slow
def test_the_hub_is_the_full_one_in_statics_and_in_its_modes_below_half_the_cut_off():
    model = build_model(read_mesh(MESHES / "hub-bench.bdf.gz"))
    body = craig_bampton(model, [2], cutoff=550.0)
    K, M = model.stiffness.constant, model.mass.constant
    factor = factorise(K)
    B = pick(model, 2)
    exact = factor.solve(B.T)
    reduced = np.linalg.solve(body.stiffness.constant, np.eye(body.basis.shape[1])[:, :6])
    assert np.allclose(body.basis @ reduced, exact, rtol=0, atol=1e-10 * np.abs(exact).max(axis=0))
    flexibility = B @ exact
    assert np.allclose(reduced[:6], flexibility, rtol=0, atol=1e-10 * np.abs(flexibility).max())
    f = inertia_of(model, rigid(model.mesh.position)[:, :3])
    exact = factor.solve(f)
    found = body.basis @ np.linalg.solve(body.stiffness.constant, body.basis.T @ f)
    assert np.allclose(found, exact, rtol=0, atol=1e-10 * np.abs(exact).max(axis=0))
    frequency, _ = lowest_modes(K, M, 9, factor=factor)
    assert frequency[-1] < 0.5 * body.cut
    ratio = frequencies(body.stiffness.constant, body.mass)[:9] / frequency
    assert np.all((ratio > 1 - 1e-9) & (ratio < 1.005))
