"""The reduced model, and how far its frequencies reach."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh, solve_sylvester, sqrtm

from strainsight.fem.affine import AffineOperator, Parameter
from strainsight.fem.model import build_model
from strainsight.rom.craig_bampton import craig_bampton, inertia_loads
from strainsight.rom.model import (
    Damping,
    ReducedModel,
    damping_derivative,
    damping_matrix,
    modal_basis,
)
from strainsight.rom.reach import OFF, excess, reach

from .bars import TIP, bar, dense, pick
from .models import positive, two_materials

MODAL = Damping("modal", ratio=0.03)
RAYLEIGH = Damping("rayleigh", alpha=0.4, beta=2e-3)
THETA = {"E": 1.3, "rho": 0.8}


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
        model = ReducedModel(
            mass, stiffness, np.ones((5, 1)), ("F",), {"E": 1.0}, damping.scaled(factors.tolist())
        )
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
def test_within_its_reach_statics_are_right_to_one_per_cent(modes):
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


def test_one_modulus_of_the_whole_may_have_any_value():
    model, body = reduced((Parameter("E", "youngs_modulus", (1, 2), 2.1e11),))
    assert reach(model, body, [TIP], {"E": 2.1e11}) == {"E": (0.0, np.inf)}
    assert excess(model, body, [TIP], {"E": 9e11}) < 1e-9
