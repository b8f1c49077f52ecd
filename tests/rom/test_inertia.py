"""Inertia of a free structure; damping of reduced models, and how far their frequencies reach."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh, expm_frechet, solve_sylvester, sqrtm
from scipy.spatial.transform import Rotation

from strainsight.errors import DeckError, NumericalError
from strainsight.fem.affine import AffineOperator, Parameter
from strainsight.fem.mass import mass_properties
from strainsight.fem.model import build_model
from strainsight.mesh.joins import PointMass, RigidElement
from strainsight.mesh.model import Mesh
from strainsight.rom.craig_bampton import OFF, craig_bampton, excess, inertia_loads, reach
from strainsight.rom.inertia import InertiaInvariants, inertia_invariants
from strainsight.rom.modal_step import acceleration_map, modal_step, parameter_slopes, steady_start
from strainsight.rom.model import (
    Damping,
    ReducedModel,
    damping_derivative,
    damping_matrix,
    modal_basis,
)

from ..bodies import with_nodes
from ..fem.conftest import make_box
from ..solids import HEX
from .bars import TIP, bar, dense, pick
from .models import positive, system, two_materials
from .test_modal_step import with_force_states

SIZE, START = np.array([1.0, 0.6, 0.4]), np.array([0.3, -0.8, 0.5])
CORNERS = np.array(HEX)
DENSITY = {1: 7850.0, 2: 2700.0}
FIELDS = tuple(InertiaInvariants.__dataclass_fields__)


def box(bend: float = 0.0, densities: dict[int, float] = DENSITY, turn: np.ndarray | None = None) -> Mesh:
    """3 × 2 × 2 hexahedra in two materials, inner nodes shaken by `bend` of an element, then all mapped by `turn`."""
    materials = {r: (2e11, 0.3, rho) for r, rho in densities.items()}
    mesh = make_box("hex8", (3, 2, 2), SIZE, bend, region=np.repeat([1, 2], 6), materials=materials)
    return replace(mesh, position=(START + mesh.position) @ (np.eye(3) if turn is None else turn).T)


def shapes(model, count: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((model.size, count))


def by_definition(weight: np.ndarray, x: np.ndarray, Phi: np.ndarray) -> dict[str, np.ndarray]:
    """Sums over points of weight (p,) at x (p, 3) with shapes Phi (p, 3, n)."""

    def sum_over(pattern: str, *fields: np.ndarray) -> np.ndarray:
        return np.einsum("p," + pattern, weight, *fields)

    half = sum_over("pi,pjk->kij", x, Phi)
    return {
        "mass": weight.sum(),
        "first": sum_over("pi->i", x),
        "first_modal": sum_over("pik->ik", Phi),
        "second": sum_over("pi,pj->ij", x, x),
        "second_modal": half + half.swapaxes(1, 2),
        "second_modal2": sum_over("pik,pjl->klij", Phi, Phi),
        "coupling": sum_over("pj,pik->jik", x, Phi),
        "coupling_modal": sum_over("pjk,pil->kjil", Phi, Phi),
        "modal": sum_over("pik,pil->kl", Phi, Phi),
    }


def assert_same(found: InertiaInvariants, exact, rtol: float = 1e-12) -> None:
    for name in FIELDS:
        expected = exact[name] if isinstance(exact, dict) else getattr(exact, name)
        assert np.shape(getattr(found, name)) == np.shape(expected)
        assert np.allclose(getattr(found, name), expected, rtol=0, atol=rtol * np.abs(expected).max()), name


def quadrature_points(mesh: Mesh, field: np.ndarray):
    """Four Gauss points each way in every hexahedron: weight ρ dV, place, and field (nodes, 3, n) there."""
    g, w = np.polynomial.legendre.leggauss(4)
    g, w = 0.5 * (g + 1), 0.5 * w
    block = mesh.blocks[0]
    X = mesh.position[block.nodes]
    rho = np.array([mesh.materials[r].density for r in block.region])
    weight, place, value = [], [], []
    for i, j, k in np.ndindex(4, 4, 4):
        factor = np.where(CORNERS == 1, g[[i, j, k]], 1 - g[[i, j, k]])
        N = factor.prod(axis=1)
        slope = np.where(CORNERS == 1, 1.0, -1.0) * N[:, None] / factor
        jacobian = np.linalg.det(np.einsum("ad,eac->edc", slope, X))
        weight.append(rho * jacobian * w[i] * w[j] * w[k])
        place.append(np.einsum("a,eac->ec", N, X))
        value.append(np.einsum("a,eack->eck", N, field[block.nodes]))
    return np.concatenate(weight), np.concatenate(place), np.concatenate(value)


@pytest.mark.parametrize("sheared", [False, True])
def test_inertia_invariants_equal_integrals_over_hexahedra(sheared):
    turn = np.array([[1.0, 0.3, -0.2], [0.1, 0.9, 0.4], [-0.3, 0.2, 1.2]]) if sheared else None
    model = build_model(box(turn=turn), supported=False)
    basis = shapes(model, 4)
    weight, x, Phi = quadrature_points(model.mesh, basis.reshape(-1, 3, 4))
    assert_same(inertia_invariants(model, basis), by_definition(weight, x, Phi))


def tied(clamped: bool) -> Mesh:
    """The box with its far face on node 901, its near face clamped if asked."""
    mesh = box(0.1)
    far, near = np.flatnonzero(mesh.position[:, 0] > 1.2), np.flatnonzero(mesh.position[:, 0] < 0.4)
    n = len(mesh.position)
    fixed = [(node, c) for node in near for c in range(3)] if clamped else []
    return replace(
        with_nodes(mesh, [1.5, -0.4, 0.9], ids=[901]),
        fixed=np.array(fixed, dtype=np.int64).reshape(-1, 2),
        rigid=(RigidElement(1, n, far, (0, 1, 2)),),
    )


PARTS = (
    PointMass(1, 36, 300.0, np.array([0.3, -0.2, 0.5]), np.diag([20.0, 15.0, 12.0]) + 2.0),
    PointMass(2, 4, 70.0),
)


@pytest.mark.parametrize("clamped", [False, True])
@pytest.mark.parametrize("points", [(), PARTS])
def test_the_modal_mass_is_that_of_the_model(clamped, points):
    model = build_model(replace(tied(clamped), point_masses=points), supported=False)
    basis = shapes(model, 5)
    body = inertia_invariants(model, basis)
    exact = basis.T @ (model.mass.constant @ basis)
    assert np.allclose(body.modal, exact, rtol=0, atol=1e-12 * np.abs(exact).max())
    assert body.mass == pytest.approx(mass_properties(model.mesh)[0], rel=1e-13)
    assert np.allclose(body.first, body.mass * mass_properties(model.mesh)[1], rtol=1e-12)


def test_point_mass_equals_its_particles():
    """Six particles m/6 about the centre with the inertia diag(b² + c², a² + c², a² + b²) m/3, on rigid arms, turned."""
    mesh = tied(clamped=False)
    node, n, m = 36, len(mesh.position), 300.0
    arms, offset = np.array([0.3, 0.2, 0.15]), np.array([0.3, -0.2, 0.5])
    Q = Rotation.from_rotvec([0.4, 1.1, -0.3]).as_matrix()
    places = offset + np.vstack([np.diag(arms), -np.diag(arms)]) @ Q.T
    inertia = Q @ np.diag(m / 3 * (np.sum(arms**2) - arms**2)) @ Q.T
    one = build_model(replace(mesh, point_masses=(PointMass(1, node, m, offset, inertia),)), supported=False)
    arm = RigidElement(2, node, n + np.arange(6), (0, 1, 2))
    particles = replace(
        with_nodes(mesh, mesh.position[node] + places),
        rigid=(*mesh.rigid, arm),
        point_masses=tuple(PointMass(i + 1, n + i, m / 6) for i in range(6)),
    )
    six = build_model(particles, supported=False)
    assert six.size == one.size
    basis = shapes(one, 3)
    assert_same(inertia_invariants(one, basis), inertia_invariants(six, basis))


def test_a_body_without_mass_is_refused():
    model = build_model(box(densities={1: 0.0, 2: 0.0}), supported=False)
    with pytest.raises(DeckError, match="total mass of the body is 0 kg"):
        inertia_invariants(model, shapes(model, 2))


DAMPINGS = [Damping("modal", ratio=0.02), Damping("rayleigh", alpha=0.5, beta=1e-4)]
IDS = ["modal", "rayleigh"]
THETA = {"E": 1.2, "rho": 0.9, "zeta": 1.7}


def pair(damping, seed=3):
    """A model with a free factor of its damping, and the one whose damping is so much stronger."""
    known = two_materials(seed, damping, on_mass=True)
    return known.with_damping("zeta", 1.0), replace(known, damping=damping.scaled(THETA["zeta"]))


@pytest.mark.parametrize("damping", DAMPINGS, ids=IDS)
def test_damping_parameter_scales_damping(damping):
    free, known = pair(damping)
    assert free.parameters == ("E", "rho", "zeta")
    for made in (lambda m: modal_step(m, THETA, 7e-3), lambda m: acceleration_map(m, THETA)):
        a, b = made(free), made(known)
        np.testing.assert_allclose(a.transition, b.transition, rtol=1e-13, atol=1e-15 * np.abs(b.transition).max())
        np.testing.assert_allclose(a.input, b.input, rtol=1e-13, atol=1e-15 * np.abs(b.input).max())
    np.testing.assert_allclose(damping_matrix(free, THETA), damping_matrix(known, THETA), rtol=1e-13, atol=1e-13)
    tone = np.array([20.0]), np.array([[1.0, 0.5j]])
    np.testing.assert_allclose(
        steady_start(free, THETA, 1e-2, *tone), steady_start(known, THETA, 1e-2, *tone), rtol=1e-11, atol=1e-14
    )


@pytest.mark.parametrize("damping", DAMPINGS, ids=IDS)
@pytest.mark.parametrize("of_all", [False, True], ids=["damping alone", "all"])
def test_damping_broadcasts_over_values(damping, of_all):
    free, _ = pair(damping)
    zeta = np.array([0.5, 1.0, 3.0])
    E = np.array([1.0, 1.1, 1.3]) if of_all else np.full(3, 1.2)
    theta = {"E": E if of_all else 1.2, "rho": 0.9, "zeta": zeta}
    together = modal_step(free, theta, 7e-3)
    rng = np.random.default_rng(1)
    x, u = rng.standard_normal((3, 8)), rng.standard_normal((3, 3, 2))
    slopes = parameter_slopes(free, together, theta, x, u, free.parameters)
    for k in range(3):
        at = {"E": float(E[k]), "rho": 0.9, "zeta": float(zeta[k])}
        alone = modal_step(free, at, 7e-3)
        np.testing.assert_allclose(together.transition[k], alone.transition, rtol=1e-10, atol=1e-13)
        np.testing.assert_allclose(together.input[k], alone.input, rtol=1e-10, atol=1e-13)
        own = parameter_slopes(free, alone, at, x[k], u[k], free.parameters)
        np.testing.assert_allclose(slopes[k], own, rtol=1e-9, atol=1e-11 * np.abs(own).max())


@pytest.mark.parametrize("damping", DAMPINGS, ids=IDS)
@pytest.mark.parametrize("h", [1e-3, 0.1])
def test_the_slope_is_the_frechet_derivative_of_the_exponential(damping, h):
    """With the damping by a matrix root, of which ∂C/∂θ is C/θ: no modes anywhere."""
    free, known = pair(damping)
    rng = np.random.default_rng(2)
    x, u = rng.standard_normal(8), rng.standard_normal((3, 2))
    slope = parameter_slopes(free, modal_step(free, THETA, h), THETA, x, u, ["zeta"])[:, 0]
    A, B = system(known, THETA)
    dA = np.zeros_like(A)
    dA[4:, 4:] = A[4:, 4:] / THETA["zeta"]
    dG = with_force_states(dA, 0 * B, h)
    dG[-u.size :] = 0
    G = with_force_states(A, B, h)
    start = np.concatenate([x, u[0], u[1], 2 * u[2]])
    exact = (expm_frechet(G, dG, compute_expm=False) @ start)[:8]
    np.testing.assert_allclose(slope, exact, atol=1e-9 * np.abs(exact).max())


@pytest.mark.parametrize("damping", DAMPINGS, ids=IDS)
@pytest.mark.parametrize("name", ["E", "rho", "zeta"])
def test_slopes_of_the_matrix_agree_with_central_differences(damping, name):
    free, _ = pair(damping)
    d = 1e-5
    change = [damping_matrix(free, {**THETA, name: THETA[name] + s * d}) for s in (1, -1)]
    difference = (change[0] - change[1]) / (2 * d)
    found = damping_derivative(free, THETA, name)
    np.testing.assert_allclose(found, difference, atol=1e-7 * np.abs(difference).max())


def test_critical_damping_at_a_value_is_refused():
    free, _ = pair(Damping("modal", ratio=0.5))
    with pytest.raises(NumericalError, match="critical damping"):
        modal_step(free, {**THETA, "zeta": 2.0}, 1e-3)


MODAL = Damping("modal", ratio=0.03)
RAYLEIGH = Damping("rayleigh", alpha=0.4, beta=2e-3)


def test_modes_are_those_of_the_generalised_problem_and_mass_normalised():
    model = two_materials(0, MODAL, 5, 30.0)
    lam, Phi = modal_basis(model, THETA)
    K, M = model.stiffness.at(THETA), model.mass.at(THETA)
    np.testing.assert_allclose(lam, eigh(K, M, eigvals_only=True), rtol=1e-12)
    np.testing.assert_allclose(Phi.T @ M @ Phi, np.eye(5), atol=1e-12)
    np.testing.assert_allclose(Phi.T @ K @ Phi, np.diag(lam), atol=1e-9)


@pytest.mark.parametrize("seed", range(2))
def test_modal_damping_is_twice_the_ratio_times_the_matrix_root(seed):
    model = two_materials(seed, MODAL, 5, 30.0)
    K, M = model.stiffness.at(THETA), model.mass.at(THETA)
    root = sqrtm(np.linalg.solve(M, K)).real
    np.testing.assert_allclose(damping_matrix(model, THETA), 2 * 0.03 * M @ root, atol=1e-11)


@pytest.mark.parametrize("name", ["E", "rho"])
@pytest.mark.parametrize("seed", range(2))
def test_the_derivative_of_modal_damping_solves_the_sylvester_equation_of_the_root(seed, name):
    """X² = A, X dX + dX X = dA,  C = 2ζ M X."""
    model = two_materials(seed, MODAL, 5, 30.0)
    K, M = model.stiffness.at(THETA), model.mass.at(THETA)
    dK, dM = model.stiffness.derivative(name, THETA), model.mass.derivative(name, THETA)
    A = np.linalg.solve(M, K)
    dA = np.linalg.solve(M, dK - dM @ A)
    X = sqrtm(A).real
    dX = solve_sylvester(X, X, dA)
    np.testing.assert_allclose(damping_derivative(model, THETA, name), 0.06 * (dM @ X + M @ dX), atol=1e-11)


def test_rayleigh_damping_is_the_combination_of_mass_and_stiffness_and_so_is_its_derivative():
    model = two_materials(3, RAYLEIGH, 5, 30.0)
    K, M = model.stiffness.at(THETA), model.mass.at(THETA)
    np.testing.assert_allclose(damping_matrix(model, THETA), 0.4 * M + 2e-3 * K, atol=1e-12)
    np.testing.assert_allclose(damping_derivative(model, THETA, "E"), 2e-3 * model.stiffness.terms["E"], atol=1e-12)
    np.testing.assert_allclose(damping_derivative(model, THETA, "rho"), 0.4 * model.mass.terms["rho"], atol=1e-12)


def test_repeated_and_nearly_repeated_frequencies_do_not_spoil_the_derivative():
    rng = np.random.default_rng(5)
    for split in (0.0, 1e-12, 1e-8, 1e-6, 1e-4):
        lam = np.array([100.0, 100.0 * (1 + split), 300.0])
        coupling = AffineOperator(np.diag(lam), {"E": positive(rng, 3)})
        mass = AffineOperator(np.eye(3), {})
        model = ReducedModel(mass, coupling, np.ones((3, 1)), ("F",), {"E": 0.0}, MODAL)
        X = np.diag(np.sqrt(lam))
        expected = 0.06 * solve_sylvester(X, X, coupling.terms["E"])
        np.testing.assert_allclose(damping_derivative(model, {"E": 0.0}, "E"), expected, rtol=1e-9, atol=1e-9)


def test_factors_damp_every_mode_by_its_own_and_the_slope_is_that_of_differences():
    rng = np.random.default_rng(4)
    mass = AffineOperator(positive(rng, 5), {})
    stiffness = AffineOperator(positive(rng, 5), {"E": positive(rng, 5)})
    factors = rng.uniform(0.3, 3.0, 5)
    for damping in (MODAL, RAYLEIGH):
        model = ReducedModel(mass, stiffness, np.ones((5, 1)), ("F",), {"E": 1.0}, damping.scaled(factors.tolist()))
        lam, Phi = eigh(stiffness.at({"E": 1.3}), mass.constant)
        alone = 2 * MODAL.ratio * np.sqrt(lam) if damping is MODAL else RAYLEIGH.alpha + RAYLEIGH.beta * lam
        C = damping_matrix(model, {"E": 1.3})
        np.testing.assert_allclose(Phi.T @ C @ Phi, np.diag(factors * alone), atol=1e-12 * np.abs(alone).max())
        h = 1e-6
        ends = [damping_matrix(model, {"E": 1.3 + way}) for way in (h, -h)]
        slope = damping_derivative(model, {"E": 1.3}, "E")
        np.testing.assert_allclose(slope, (ends[0] - ends[1]) / (2 * h), atol=1e-7 * np.abs(slope).max())
        # a factor on all of it comes on top
        twice = ReducedModel(mass, stiffness, np.ones((5, 1)), ("F",), {"E": 1.0}, model.damping.scaled(2.0))
        np.testing.assert_allclose(damping_matrix(twice, {"E": 1.3}), 2 * C, rtol=1e-12)


@pytest.mark.parametrize("apart", [0.0, 1e-12])
def test_factors_of_the_modes_of_one_frequency_do_not_depend_on_which_pair_of_modes_is_taken(apart):
    damping = MODAL.scaled((2.0, 3.0, 5.0))
    lam = np.array([4.0, 4.0 * (1 + apart), 9.0])
    Q = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]

    def model(K: np.ndarray) -> ReducedModel:
        return ReducedModel(AffineOperator(np.eye(3), {}), AffineOperator(K, {}), np.ones((3, 1)), ("F",), {}, damping)

    expected = 0.06 * np.diag([4.0, 4.0, 15.0])
    np.testing.assert_allclose(damping_matrix(model(np.diag(lam)), {}), expected, atol=1e-9)
    np.testing.assert_allclose(damping_matrix(model(Q @ np.diag(lam) @ Q.T), {}), Q @ expected @ Q.T, atol=1e-9)


MODULI = (Parameter("E1", "youngs_modulus", (1,), 2.1e11), Parameter("E2", "youngs_modulus", (2,), 7.0e10))
REFERENCE = {p.name: p.reference for p in MODULI}


def reduced(moduli, modes=0):
    model = build_model(bar(clamped=True), moduli)
    return model, craig_bampton(model, [TIP], modes=modes, reference={p.name: p.reference for p in moduli})


@pytest.mark.parametrize("theta", [{"E1": 4.2e11}, {"E2": 3.5e10}, {"E1": 1.0e11, "E2": 9e10}])
def test_the_excess_is_that_of_the_flexibility_at_the_interface(theta):
    """max vᵀ(S* − S)v/vᵀS*v = 1 − 1/max eig(S⁻¹S*), or that of the body's own inertia with it held."""
    model, body = reduced(MODULI)
    theta = REFERENCE | theta
    B = pick(model, TIP)
    exact = B @ np.linalg.solve(dense(model.stiffness.at(theta)), B.T)
    found = np.linalg.inv(body.stiffness.at(theta))[:6, :6]
    interfaces = 1 - 1 / np.linalg.eigvals(exact @ np.linalg.inv(found)).real.max()
    held = B.any(axis=0)
    K, H = dense(model.stiffness.at(theta))[np.ix_(~held, ~held)], body.basis[~held, 6:]
    F = inertia_loads(model)[~held, :3]
    r = H.T @ K @ H
    ratio = np.linalg.solve(F.T @ np.linalg.solve(K, F), F.T @ H @ np.linalg.solve(r, H.T @ F))
    inertia = 1 - np.linalg.eigvals(ratio).real.min()
    assert excess(model, body, [TIP], theta) == pytest.approx(max(interfaces, inertia), rel=1e-6)


@pytest.mark.parametrize("modes", [0, 3])
def test_static_error_within_reach_is_below_one_per_cent(modes):
    model, body = reduced(MODULI, modes)
    for name, (low, high) in reach(model, body, [TIP], REFERENCE).items():
        own = REFERENCE[name]
        assert own / 2 <= low < own < high <= 2 * own
        for value in (low, high):
            off = excess(model, body, [TIP], {**REFERENCE, name: value})
            assert off <= 1.1 * OFF
            if 0.51 * own < value < 1.99 * own:
                assert off > 0.5 * OFF


def test_rigid_motions_of_a_free_body_take_no_work():
    model = build_model(bar(), MODULI, supported=False)
    body = craig_bampton(model, [TIP], modes=2, reference=REFERENCE)
    assert excess(model, body, [TIP], REFERENCE) < 1e-9
    assert 1e-4 < excess(model, body, [TIP], {"E1": 4.2e11, "E2": 7e10}) < 0.5


def test_single_modulus_has_unlimited_reach():
    model, body = reduced((Parameter("E", "youngs_modulus", (1, 2), 2.1e11),))
    assert reach(model, body, [TIP], {"E": 2.1e11}) == {"E": (0.0, np.inf)}
    assert excess(model, body, [TIP], {"E": 9e11}) < 1e-9
