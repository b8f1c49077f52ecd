"""The whole model in time against exponentials, scipy's integrators and its own modes; Padé approximations; periodic motion."""

from __future__ import annotations

from dataclasses import replace
from math import factorial
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import eigh, expm

from strainsight.decks.reader import read_mesh
from strainsight.errors import NumericalError, UserError
from strainsight.fem import factorisation
from strainsight.fem import transient as module
from strainsight.fem.affine import AffineOperator, Parameter
from strainsight.fem.constraints import Constraint
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import FiniteElementModel, build_model
from strainsight.fem.transient import (
    DEGREES,
    ViscousDamping,
    choose,
    free_rows,
    modal_damping,
    pade,
    steady_state,
    transient,
)
from strainsight.loads.histories import Constant, MultiSine, Sine, hold_coefficients, instant_values, tones_of
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.joins import RigidElement
from strainsight.rom.modal_step import simulate
from strainsight.rom.model import Damping
from strainsight.rom.reduction import modal_model
from strainsight.sensors.candidates import candidates
from strainsight.sensors.strain_operator import channel_matrix

from ..bodies import with_nodes
from ..shared import slowly

NONE = ViscousDamping()


def model_of(K, M) -> FiniteElementModel:
    """A model of given matrices; it has no mesh."""
    K, M = sparse.csr_array(np.asarray(K, float)), sparse.csr_array(np.asarray(M, float))
    free = sparse.csr_array(sparse.eye_array(K.shape[0], format="csr"))
    constraint = Constraint(free, {}, np.arange(K.shape[0]))
    return FiniteElementModel(None, constraint, AffineOperator(K, {}), AffineOperator(M, {}))


def chain(n, stiffness=4e4, mass=1.0, coupling=0.1):
    """n masses in a row, the first on a spring to the ground; a mass matrix that is not diagonal."""
    K = stiffness * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    K[-1, -1] = stiffness
    return K, mass * (np.eye(n) + coupling * (np.eye(n, k=1) + np.eye(n, k=-1)))


def dense_damping(K, M, damping):
    C = damping.alpha * M + damping.beta * K
    for i, c in enumerate(damping.rate):
        m = M @ damping.shapes[:, i]
        C = C + c * np.outer(m, m)
    return C


def exact(K, M, C, S, held, h, x0=None):
    """[z, ż, z̈] (T + 1, 3, n) by the exponential of the system and its polynomial load together."""
    n, J = len(K), held.shape[1]
    inverse = np.linalg.inv(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ K, -inverse @ C]])
    B = np.vstack([np.zeros_like(S), inverse @ S])
    width = S.shape[1]
    full = np.zeros((2 * n + J * width,) * 2)
    full[: 2 * n, : 2 * n] = A
    full[: 2 * n, 2 * n : 2 * n + width] = B
    for j in range(J - 1):
        full[2 * n + j * width : 2 * n + (j + 1) * width, 2 * n + (j + 1) * width : 2 * n + (j + 2) * width] = np.eye(
            width
        )
    E = expm(full * h)
    factor = np.array([1.0, 1.0 / h, 2.0 / h**2])[:J, None]
    x = np.zeros(2 * n) if x0 is None else np.concatenate(x0)
    states = [x]
    for u in held:
        x = E[: 2 * n] @ np.concatenate([x, (factor * u).ravel()])
        states.append(x)
    states = np.array(states)
    u = instant_values(held)
    z, v = states[:, :n], states[:, n:]
    return np.stack([z, v, (u @ S.T - z @ K - v @ C) @ inverse], axis=1)


def random_load(T, width, J=3, seed=0):
    return np.random.default_rng(seed).standard_normal((T, J, width))


@pytest.mark.parametrize("J", [1, 2, 3])
def test_several_masses_loads_and_rows_over_several_blocks(J):
    K, M = chain(6)
    S = np.random.default_rng(1).standard_normal((6, 2))
    damping = replace(modal_damping(sparse.csr_array(K), sparse.csr_array(M), 0.03, 3), alpha=2.0)
    # the shapes are eigenvectors whatever the mass-proportional part
    held, h = random_load(70, 2, J), 2e-3
    rows = np.random.default_rng(2).standard_normal((4, 6))
    found = transient(
        model_of(K, M), S, {}, damping, held, h, rows, sparse.csr_array(rows[:2]), highest=600.0
    )
    true = exact(K, M, dense_damping(K, M, damping), S, held, h)
    np.testing.assert_allclose(found.reading, true[:, 0] @ rows.T, atol=1e-10 * np.abs(true[:, 0]).max())
    np.testing.assert_allclose(found.acceleration, true[:, 2] @ rows[:2].T, atol=1e-9 * np.abs(true[:, 2]).max())
    np.testing.assert_allclose(found.end, true[-1, :2], rtol=0, atol=1e-10 * np.abs(true[-1, :2]).max())


def test_a_motion_that_follows_its_load_is_exact_however_fast_the_mode():
    """Quadratic load, quadratic motion: z = u/k − m ü/k², for modes from far below to far above the step."""
    h, T = 1e-3, 40
    omega = np.array([10.0, 1e3, 1e5, 1e7])
    t = h * np.arange(T)
    held = np.stack([1 + 50 * t + 4e3 * t**2, h * (50 + 8e3 * t), np.full(T, 4e3 * h * h)], axis=1)[:, :, None]
    k = omega**2
    now = lambda time: (1 + 50 * time + 4e3 * time**2)[..., None] / k - 8e3 / k**2  # noqa: E731
    found = transient(
        model_of(np.diag(k), np.eye(4)),
        np.ones((4, 1)),
        {},
        NONE,
        held,
        h,
        np.eye(4),
        start=(now(np.zeros(())), 50 / k),
        highest=50.0,
    )
    expected = now(h * np.arange(T + 1))
    np.testing.assert_allclose(found.reading[:, 1:], expected[:, 1:], rtol=1e-11)
    np.testing.assert_allclose(found.reading[:, 0], expected[:, 0], rtol=1e-6)


def test_damping_by_modes_is_the_stated_ratio_in_each_and_grows_above():
    K, M = chain(8)
    lam, Phi = eigh(K, M)
    omega = np.sqrt(lam)
    expected = 0.02 * np.maximum(1.0, omega / omega[3])
    C = dense_damping(K, M, modal_damping(sparse.csr_array(K), sparse.csr_array(M), 0.02, 4))
    np.testing.assert_allclose(Phi.T @ C @ Phi, np.diag(2 * expected * omega), atol=1e-10 * omega[-1])


def test_unknowns_without_mass_move_but_have_no_acceleration():
    K = np.array([[3e4, -1e4, 0], [-1e4, 2e4, -1e4], [0, -1e4, 1e4]])
    M = np.diag([1.0, 0.0, 1.0])
    held, h = hold_coefficients([Sine(5.0, 10.0)], 0.0, 1e-3, 50), 1e-3
    S = np.eye(3)[:, 2:]
    found = transient(model_of(K, M), S, {}, NONE, held, h, np.eye(3), highest=100.0)
    np.testing.assert_allclose(
        found.reading[:, 1], found.reading[:, [0, 2]].mean(axis=1), atol=1e-9 * np.abs(found.reading).max()
    )
    small = exact(
        K[[0, 2]][:, [0, 2]] - np.outer(K[[0, 2], 1], K[1, [0, 2]]) / K[1, 1],
        np.eye(2),
        np.zeros((2, 2)),
        S[[0, 2]],
        held,
        h,
    )
    np.testing.assert_allclose(found.reading[:, [0, 2]], small[:, 0], atol=1e-6 * np.abs(small[:, 0]).max())
    with pytest.raises(UserError, match="degrees of freedom without mass"):
        transient(model_of(K, M), S, {}, NONE, held, h, np.eye(3), np.eye(3))


def test_without_pardiso_superlu_gives_the_same(monkeypatch):
    K, M = chain(6)
    held = random_load(20, 1)
    given = (model_of(K, M), np.eye(6)[:, :1], {}, ViscousDamping(1.0, 1e-5), held, 1e-3, np.eye(6))
    once = transient(*given).reading

    def missing(upper):
        raise ImportError

    monkeypatch.setattr(factorisation, "_pardiso", missing)
    np.testing.assert_allclose(transient(*given).reading, once, rtol=1e-11, atol=1e-13 * np.abs(once).max())


def test_progress_and_a_motion_that_overflows():
    K, M = chain(2)
    shares = []
    transient(model_of(K, M), np.eye(2)[:, :1], {}, NONE, np.zeros((70, 1, 1)), 1e-3, np.eye(2), progress=shares.append)
    assert shares == [0.0, 32 / 70, 64 / 70]
    with pytest.raises(NumericalError, match="finite"):
        transient(model_of(K, M), np.eye(2)[:, :1], {}, NONE, np.full((3, 1, 1), np.nan), 1e-3, np.eye(2), highest=1.0)


@pytest.mark.parametrize("degree", DEGREES)
def test_the_approximation_has_its_order_and_its_damping(degree):
    """R has the Taylor coefficients of eᶻ up to z^(2s−1) and no further, |R(iy)| ≤ 1 everywhere, and |R∞| < 1."""
    scheme = pade(degree)
    turn = np.arange(64)
    coefficient = np.fft.fft(scheme.at(np.exp(2j * np.pi * turn / 64)))[: 2 * degree + 1].real / 64
    error = np.abs(coefficient - [1 / factorial(k) for k in range(2 * degree + 1)])
    assert error[:-1].max() < 3e-14 < error[-1]
    y = np.geomspace(1e-2, 1e6, 2000)
    assert np.all(np.abs(scheme.at(1j * y)) <= 1 + 1e-13)
    assert abs(scheme.at(1e12j)) == pytest.approx(abs(scheme.infinity), rel=1e-6)
    assert abs(scheme.infinity) < 0.91
    assert np.all(scheme.pole.real > 0)


@pytest.mark.parametrize("y", [0.01, 0.3, 0.5, 0.9, 2.7, 3.0, 5.6, 7.0, 20.0])
def test_what_is_resolved_keeps_its_period_and_its_amplitude(y):
    scheme, substeps = choose(y)
    R = scheme.at(1j * y / substeps) ** substeps
    turned = np.angle(R * np.exp(-1j * y))
    assert abs(turned) <= 1.01e-4 * y
    assert abs(np.log(abs(R))) <= 1e-4 * y


def test_fewest_solves_and_never_more_factors_for_nothing():
    cost = {y: choose(y)[0].degree * choose(y)[1] // 2 for y in (0.1, 0.5, 1.0, 2.0, 4.0, 8.0)}
    assert cost == {0.1: 1, 0.5: 1, 1.0: 2, 2.0: 2, 4.0: 3, 8.0: 6}


DAMPINGS = ["modal", "rayleigh", "none"]


def damping_of(kind, K, M):
    K, M = sparse.csr_array(K), sparse.csr_array(M)
    return {
        "modal": modal_damping(K, M, 0.02, 4),
        "rayleigh": ViscousDamping(2.0, 1e-5),
        "none": NONE,
    }[kind]


@pytest.mark.parametrize("kind", DAMPINGS)
@pytest.mark.parametrize("hertz", [0.0, 3.0, 11.0, 40.0])
def test_it_is_the_dense_complex_solution(kind, hertz):
    """Below, between and above the modes of a chain of eight, 5.4 to 69 Hz."""
    K, M = chain(8)
    damping, omega = damping_of(kind, K, M), 2 * np.pi * hertz
    S, U = np.random.default_rng(1).standard_normal((8, 2)), np.array([1.0 - 2.0j, 0.5 + 0.3j])
    dense = K - omega**2 * M + 1j * omega * dense_damping(K, M, damping)
    expected = np.linalg.solve(dense, S @ U)
    z, v = steady_state(sparse.csr_array(K), sparse.csr_array(M), S, damping, np.array([omega]), U[None])
    np.testing.assert_allclose(z, expected.real, rtol=0, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(v, (1j * omega * expected).real, rtol=0, atol=1e-9 * max(1, omega) * np.abs(expected).max())


@pytest.mark.parametrize("kind", ["modal", *slowly("rayleigh")])
def test_stepped_on_it_repeats(kind):
    """Three tones and a constant over their common period of 0.5 s, to the error of the scheme; from rest it is far from it."""
    K, M = chain(8)
    damping = damping_of(kind, K, M)
    S = np.eye(8)[:, [7, 3]]
    signals = [MultiSine(4.0, 12.0, 3, 5.0, seed=2), Constant(2.0)]
    tones, T = tones_of(signals), 1000
    held = hold_coefficients(signals, 0.0, 0.5 / T, T)
    start = steady_state(sparse.csr_array(K), sparse.csr_array(M), S, damping, tones.frequency, tones.amplitude)
    found = transient(model_of(K, M), S, {}, damping, held, 0.5 / T, np.eye(8), start=start).reading
    size = np.abs(found).max()
    assert np.abs(found[-1] - found[0]).max() <= 1e-5 * size
    rest = transient(model_of(K, M), S, {}, damping, held, 0.5 / T, np.eye(8)).reading
    assert np.abs(rest[-1] - rest[0]).max() > 0.1 * size


def test_a_tone_at_an_undamped_mode_is_refused():
    """k/m = 10⁴ to the last bit."""
    K, M = sparse.csr_array(np.array([[1e4]])), sparse.csr_array(np.array([[1.0]]))
    tones = tones_of([Sine(100.0 / (2 * np.pi), 1.0)])
    with pytest.raises(NumericalError):
        steady_state(K, M, np.ones((1, 1)), NONE, np.array([100.0]), tones.amplitude)


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
def test_a_mesh_with_supports_and_a_rigid_tie_is_its_exponential(box, kind):
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

    dense = K.toarray(), M.toarray()
    z, _, acceleration = exact(*dense, dense_damping(*dense, damping), S, held, h).swapaxes(0, 1)
    strain, acceleration = z @ rows.T, acceleration @ moving.T

    default = transient(model, S, theta, damping, held, h, rows)
    np.testing.assert_allclose(default.reading, strain, atol=1e-3 * np.abs(strain).max())
    fine = transient(model, S, theta, damping, held, h, rows, moving, highest=6 / h)
    np.testing.assert_allclose(fine.reading, strain, atol=1e-7 * np.abs(strain).max())
    np.testing.assert_allclose(fine.acceleration, acceleration, atol=1e-5 * np.abs(acceleration).max())


@pytest.mark.slow
def test_the_cantilever_agrees_with_its_modes_as_far_as_these_go():
    """60 modes with static terms against 10 700 degrees of freedom: closer than 40 modes are to 60, once every mode is
    resolved that 60 modes have; and close enough with the steps that the first modes need."""
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
    assert np.abs(plain.reading - strain[0]).max() < 5e-4 * peak


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
