"""Residual vectors of reduced bodies of a bench: statics, weight and acceleration of the full model."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from strainsight.decks.reader import read_mesh
from strainsight.errors import InfeasibleError
from strainsight.fem.factorisation import factorise
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import modes as lowest_modes
from strainsight.mesh.joins import PointMass
from strainsight.rom.craig_bampton import craig_bampton, floating_basis, inertia_loads, residual_vectors, rigid_field
from strainsight.rom.inertia import inertia_invariants

from .bars import MESHES, ROOT, SIDE, TIP, bar, frequencies, gauge_rows, inertia_of, pick, rigid


@pytest.mark.parametrize("count", [0, 1, 40])
def test_weight_deforms_it_as_the_full_model_with_any_number_of_modes(clamped, count):
    body = craig_bampton(clamped, [TIP, SIDE], modes=count)
    f = inertia_of(clamped, rigid(clamped.mesh.position)[:, :3])
    exact = factorise(clamped.stiffness.constant).solve(f)
    found = np.linalg.solve(body.stiffness.constant, body.basis.T @ f)
    assert body.size == 12 + count + 3
    assert np.allclose(body.basis @ found, exact, rtol=0, atol=1e-9 * np.abs(exact).max(axis=0))
    strain = gauge_rows(clamped, exact)
    assert np.allclose(gauge_rows(clamped, body.basis) @ found, strain, rtol=0, atol=1e-9 * np.abs(strain).max(axis=0))


@pytest.mark.parametrize("count", [0, 40])
def test_a_body_that_moves_deforms_as_the_full_one_under_any_acceleration_of_its_frame(free, clamped, count):
    body = floating_basis(craig_bampton(free, [ROOT, TIP], modes=count), ROOT)
    motion = rigid(free.mesh.position)
    exact = factorise(clamped.stiffness.constant).solve(inertia_of(clamped, motion))
    found = np.linalg.solve(body.stiffness.constant, body.basis.T @ inertia_of(free, motion))
    assert body.size == 6 + count + 6
    field = nodal(clamped, exact)
    assert np.allclose(nodal(free, body.basis) @ found, field, rtol=0, atol=1e-9 * np.abs(field).max(axis=0))
    strain = gauge_rows(clamped, exact)
    assert np.allclose(gauge_rows(free, body.basis) @ found, strain, rtol=0, atol=1e-9 * np.abs(strain).max(axis=0))


@pytest.mark.parametrize("count", [0, 40])
def test_residual_vectors_are_apart_from_the_modes_and_from_each_other(clamped, free, count):
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


def test_loads_of_inertia_count_held_nodes_and_point_masses(free):
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
        assert body.size == one.size == 15
        assert len(body.frequency) == count
        assert np.linalg.matrix_rank(body.basis) == 15
    none = craig_bampton(build_model(mesh, supported=False), [ROOT, TIP], modes=0)
    assert none.size == 12
    assert none.cut == np.inf
    with pytest.raises(InfeasibleError, match="0 unknowns between"):
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
    reduced = np.linalg.solve(body.stiffness.constant, np.eye(body.size)[:, :6])
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
