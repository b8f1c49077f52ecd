"""The whole model in time on meshes: against scipy's integrators and its own modes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

from strainsight.decks.reader import read_mesh
from strainsight.fem import transient as module
from strainsight.fem.affine import Parameter
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import build_model
from strainsight.fem.transient import free_rows, transient
from strainsight.fem.viscous import ViscousDamping, modal_damping
from strainsight.gauges.candidates import candidates
from strainsight.gauges.rows import channel_matrix
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.joins import RigidElement
from strainsight.rom.modal_step import simulate
from strainsight.rom.model import Damping
from strainsight.rom.reduction import modal_model
from strainsight.signals.histories import Sine, hold_coefficients, instant_values

from ..bodies import with_nodes
from ..shared import slowly
from .transients import NONE, chain, dense_damping, model_of


def tied(box):
    """A soft beam of hexahedra of two regions, clamped at its root, a rigid plate on its tip led by a node of its own."""
    mesh = box(
        "hex8",
        (5, 1, 1),
        (1.0, 0.2, 0.15),
        clamp_root=True,
        region=np.array([1, 1, 1, 2, 2]),
        materials={1: (1.0e7, 0.3, 1000.0), 2: (2.0e7, 0.25, 1500.0)},
    )
    tip = np.flatnonzero(np.isclose(mesh.position[:, 0], 1.0))
    n = len(mesh.position)
    return replace(
        with_nodes(mesh, [1.1, 0.1, 0.075], ids=[900]),
        rigid=(RigidElement(1, n, tip, (0, 1, 2)),),
    )


@pytest.mark.parametrize("kind", [*slowly("rayleigh"), "modal"])
def test_a_mesh_with_supports_and_a_rigid_tie_agrees_with_solve_ivp(box, kind):
    mesh = tied(box)
    model = build_model(mesh, (Parameter("E2", "youngs_modulus", (2,), 2.0e7),))
    theta = {"E2": 2.6e7}
    K, M = model.stiffness.at(theta), model.mass.at(theta)
    S = input_shape(model, [PointLoad("tip", (0, 0.3, 1), node_id=900)])
    damping = ViscousDamping(1.5, 2e-5) if kind == "rayleigh" else modal_damping(K, M, 0.02, 6)
    first = np.sqrt(eigh(K.toarray(), M.toarray(), eigvals_only=True)[0]) / (2 * np.pi)
    T = 160
    h = 2.0 / first / T

    held = hold_coefficients([Sine(0.8 * first, 100.0)], 0.0, h, T)
    facets = exterior_facets(mesh)
    gauges = candidates(mesh, facets, (1.0, 0.0, 0.0), (0.0,))
    rows = free_rows(model, channel_matrix(mesh.position, gauges, facets))
    moving = sparse.csr_array(sparse.eye_array(model.size, format="csr")[-6:])

    n, inverse = model.size, np.linalg.inv(M.toarray())
    C = dense_damping(K.toarray(), M.toarray(), damping)
    A = np.block([[np.zeros(K.shape), np.eye(n)], [-inverse @ K.toarray(), -inverse @ C]])
    B = np.concatenate([np.zeros(n), inverse @ S[:, 0]])
    states = [np.zeros(2 * n)]
    for a, b, c in held[:, :, 0]:
        # step by step: the load's slope jumps from one to the next

        def slope(t, x, a=a, b=b, c=c):
            return A @ x + B * (a + b * t / h + c * (t / h) ** 2)

        states.append(solve_ivp(slope, (0, h), states[-1], method="DOP853", rtol=1e-9, atol=1e-12).y[:, -1])
    true = np.array(states)
    strain = true[:, :n] @ rows.T
    acceleration = (true @ A.T + np.outer(instant_values(held)[:, 0], B))[:, n:] @ moving.T

    default = transient(model, S, theta, damping, held, h, rows)
    np.testing.assert_allclose(default.reading, strain, atol=1e-3 * np.abs(strain).max())
    fine = transient(model, S, theta, damping, held, h, rows, moving, highest=6 / h)
    np.testing.assert_allclose(fine.reading, strain, atol=1e-7 * np.abs(strain).max())
    np.testing.assert_allclose(fine.acceleration, acceleration, atol=1e-5 * np.abs(acceleration).max())


@pytest.mark.slow
def test_the_cantilever_agrees_with_its_modes_as_far_as_these_go():
    """60 modes with static terms against 10 700 unknowns: closer than 40 modes are to 60, once every mode is resolved that
    60 modes have; and close enough with the steps that the first modes need."""
    mesh = read_mesh(Path(__file__).parents[2] / "meshes" / "cantilever.bdf")
    model = build_model(mesh)
    S = input_shape(model, [PointLoad("tip", (0, 0, 1), node_id=2)])
    h, T = 2.5e-4, 40
    held = hold_coefficients([Sine(20.0, 1e4)], 0.0, h, T)
    facets = exterior_facets(mesh)
    gauges = candidates(mesh, facets, (1.0, 0.0, 0.0), (0.0,))
    rows = free_rows(model, channel_matrix(mesh.position, gauges, facets))
    damping = modal_damping(model.stiffness.at({}), model.mass.at({}), 0.01, 60)
    strain = []
    for modes in (60, 40):
        reduced, basis = modal_model(model, S, ("tip",), {}, modes, Damping("modal", ratio=0.01))
        x = simulate(reduced, {}, held, h)
        strain.append(x[:, : reduced.size] @ (rows @ basis).T)
    peak = np.abs(strain[0]).max()
    fine = transient(model, S, {}, damping, held, h, rows, highest=7000.0)
    assert np.abs(fine.reading - strain[0]).max() < np.abs(strain[1] - strain[0]).max()
    plain = transient(model, S, {}, damping, held, h, rows)
    assert (plain.order, plain.substeps) == (3, 1)
    assert np.abs(plain.reading - strain[0]).max() < 5e-4 * peak


# ---- edges


def test_without_a_stated_frequency_the_first_modes_and_the_loads_are_resolved():
    K, M = chain(8)
    f = np.sqrt(eigh(K, M, eigvals_only=True)) / (2 * np.pi)
    h, T = 1e-4, 4000

    def highest(frequency):
        held = hold_coefficients([Sine(frequency, 1.0)], 0.0, h, T)
        return module._reach(sparse.csr_array(K), sparse.csr_array(M), NONE, held, h, None)

    assert highest(2.0) == pytest.approx(f[3], rel=1e-9)
    assert highest(900.0) == pytest.approx(900.0, abs=10)
    assert module._reach(sparse.csr_array(K), sparse.csr_array(M), NONE, np.zeros((5, 1, 1)), h, None) == pytest.approx(f[3])
    found = transient(model_of(K, M), np.eye(8)[:, :1], {}, NONE, np.zeros((3, 1, 1)), h, np.eye(8), np.eye(8))
    assert found.highest >= 1 / (2.56 * h)
