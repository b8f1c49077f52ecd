"""The modal step is the matrix exponential, and its parameter slopes are the Fréchet derivative of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm, expm_frechet, solve_sylvester, sqrtm

from strainsight.fem.affine import AffineOperator, Coefficient, Newton
from strainsight.rom.modal_step import modal_step, parameter_slopes, simulate
from strainsight.rom.model import Damping, ReducedModel, damping_derivative, damping_matrix

from .models import DAMPINGS, IDS, positive, scales, shape, system, two_materials

NAMES = ("E", "rho")


def one_material(lam: np.ndarray, damping: Damping) -> ReducedModel:
    n = len(lam)
    zero = np.zeros((n, n))
    stiffness, mass = AffineOperator(zero, {"E": np.diag(lam)}), AffineOperator(zero, {"rho": np.eye(n)})
    S = np.random.default_rng(0).standard_normal((n, 2))
    return ReducedModel(mass, stiffness, S, ("Fx", "Fz"), {"E": 1.0, "rho": 1.0}, damping)


def system_slope(model: ReducedModel, theta, name: str) -> tuple[np.ndarray, np.ndarray]:
    K, M, S = model.stiffness.at(theta), model.mass.at(theta), shape(model, theta)
    dK, dM = model.stiffness.derivative(name, theta), model.mass.derivative(name, theta)
    X = np.linalg.solve(M, K)
    dX = np.linalg.solve(M, dK - dM @ X)
    d = model.damping
    dc = d.beta * dX
    if d.kind == "modal":
        root = sqrtm(X).real
        dc = 2 * d.ratio * solve_sylvester(root, root, dX)
    zero = np.zeros_like(K)
    dS = model.input_slope.get(name, np.zeros_like(S))
    dB = np.vstack([np.zeros_like(S), np.linalg.solve(M, dS - dM @ np.linalg.solve(M, S))])
    return np.block([[zero, zero], [-dX, -dc]]), dB


def with_force_states(A: np.ndarray, B: np.ndarray, h: float) -> np.ndarray:
    """A h with the held force and its derivatives in s = τ/h as further states: [x, u₀, u₁, 2u₂] → over one step."""
    n, n_u = B.shape
    G = np.zeros((n + 3 * n_u, n + 3 * n_u))
    G[:n, :n], G[:n, n : n + n_u] = A * h, B * h
    G[n : n + 2 * n_u, n + n_u :] = np.eye(2 * n_u)
    return G


@pytest.mark.parametrize("damping", DAMPINGS, ids=IDS)
@pytest.mark.parametrize("h", [1e-4, 1e-2, 0.3])
def test_the_step_is_the_exponential_of_the_first_order_system(damping, h):
    theta = {"E": 1.2, "rho": 0.9}
    for seed in range(3):
        model = two_materials(seed, damping, on_mass=seed > 0)
        n = 2 * model.size
        step = modal_step(model, theta, h)
        exact = expm(with_force_states(*system(model, theta), h))
        w = scales(model, theta)
        np.testing.assert_allclose(w[:, None] * step.transition / w, w[:, None] * exact[:n, :n] / w, atol=2e-11)
        inputs = np.stack([exact[:n, n : n + 2], exact[:n, n + 2 : n + 4], 2 * exact[:n, n + 4 :]], axis=1)
        size = np.abs(w[:, None, None] * inputs).max()
        np.testing.assert_allclose(w[:, None, None] * step.input, w[:, None, None] * inputs, atol=2e-11 * size)


@pytest.mark.parametrize("damping", DAMPINGS, ids=IDS)
@pytest.mark.parametrize("h", [1e-4, 1e-2, 0.3])
def test_the_parameter_slopes_are_the_frechet_derivative_of_the_exponential(damping, h):
    theta = {"E": 1.2, "rho": 0.9}
    for seed in range(3):
        for on_mass in (False, True):
            assert_slopes_are_frechet(two_materials(seed, damping, on_mass=on_mass), theta, h, 1e-9)


def assert_slopes_are_frechet(model: ReducedModel, theta, h: float, tolerance: float) -> None:
    rng = np.random.default_rng(1)
    w = scales(model, theta)
    x, u = rng.standard_normal(2 * model.size) / w, rng.standard_normal((3, 2))
    slopes = parameter_slopes(model, modal_step(model, theta, h), theta, x, u, NAMES)
    G = with_force_states(*system(model, theta), h)
    start = np.concatenate([x, u[0], u[1], 2 * u[2]])
    for i, name in enumerate(NAMES):
        dA, dB = system_slope(model, theta, name)
        dG = with_force_states(dA, dB, h)
        dG[-len(u.ravel()) :] = 0
        exact = (expm_frechet(G, dG, compute_expm=False) @ start)[: len(x)]
        assert np.max(np.abs(w * (slopes[:, i] - exact))) < tolerance * max(np.max(np.abs(w * exact)), 1e-12)


@pytest.mark.parametrize("damping", DAMPINGS[:2], ids=IDS[:2])
@pytest.mark.parametrize("split", [0.0, 1e-13, 1e-9, 1e-6, 3e-5, 1e-3])
def test_repeated_and_nearly_repeated_frequencies(damping, split):
    rng = np.random.default_rng(7)
    lam = 1e4 * np.array([1.0, 1.0 + split, 1.0 + 2 * split, 6.0])
    stiffness = AffineOperator(np.diag(lam), {"E": 1e4 * positive(rng, 4)})
    mass = AffineOperator(np.eye(4), {"rho": positive(rng, 4)})
    model = ReducedModel(mass, stiffness, rng.standard_normal((4, 2)), ("Fx", "Fz"), {"E": 0.0, "rho": 0.0}, damping)
    assert_slopes_are_frechet(model, {"E": 0.0, "rho": 0.0}, 5e-3, 1e-8)


@pytest.mark.parametrize("damping", DAMPINGS, ids=IDS)
def test_slopes_in_a_thickness_agree_with_central_differences(damping):
    """K = K₀ + E (t K₁ + t³ K₃), M = M₀ + ρ t M₁: at many values at once, of the step and of what it damps."""
    plain = two_materials(12, damping)
    t, t3 = (Coefficient((Newton("t", (0.0,) * k),), np.eye(k + 1)[-1]) for k in (1, 3))
    K, M = plain.stiffness.terms["E"], plain.mass.terms["rho"]
    thick = replace(
        plain,
        stiffness=AffineOperator(
            plain.stiffness.constant,
            {"E t": K, "E t^3": K[::-1, ::-1]},
            {"E t": t.times("E"), "E t^3": t3.times("E")},
        ),
        mass=AffineOperator(plain.mass.constant, {"rho t": M}, {"rho t": t.times("rho")}),
        reference={"E": 1.0, "rho": 1.0, "t": 1.0},
    )
    rng = np.random.default_rng(3)
    x, u = rng.standard_normal((5, 8)), rng.standard_normal((5, 3, 2))
    theta = {"E": rng.uniform(0.8, 1.2, 5), "rho": 1.1, "t": rng.uniform(0.8, 1.2, 5)}

    def after(values):
        step = modal_step(thick, values, 7e-3)
        return np.einsum("kab,kb->ka", step.transition, x) + np.einsum("kaju,kju->ka", step.input, u)

    names = ("E", "rho", "t")
    slopes = parameter_slopes(thick, modal_step(thick, theta, 7e-3), theta, x, u, names)
    for i, name in enumerate(names):
        d = 1e-5
        difference = (after({**theta, name: theta[name] + d}) - after({**theta, name: theta[name] - d})) / (2 * d)
        np.testing.assert_allclose(slopes[..., i], difference, atol=1e-7 * np.abs(difference).max())
        at = {"E": 0.9, "rho": 1.1, "t": 1.05}
        C = [damping_matrix(thick, {**at, name: at[name] + s * d}) for s in (1, -1)]
        slope = damping_derivative(thick, at, name)
        np.testing.assert_allclose(slope, (C[0] - C[1]) / (2 * d), atol=1e-8 * np.abs(C[0]).max())


@pytest.mark.parametrize("omega", [1e-1, 1e7])
@pytest.mark.parametrize("damping", DAMPINGS[:2], ids=IDS[:2])
def test_slow_and_fast_modes_beside_one_another(omega, damping):
    """ωh from 1e-5 (barely moving) to 1e3 (a static mode): slopes against the closed form of a lone undamped sine."""
    model = one_material(np.array([omega**2, 4 * omega**2]), damping)
    step = modal_step(model, model.reference, 1e-4)
    assert np.isfinite(step.transition).all()
    x = np.array([1.0, 0.0, 0.0, 0.0])
    slopes = parameter_slopes(model, step, model.reference, x, np.zeros((3, 2)), NAMES)
    assert np.isfinite(slopes).all()
    if damping.ratio == 0:
        angle = omega * 1e-4
        # A slow mode's slope (ωh)²/2 stands beside x = 1 with its rounding eps/(ωh).
        rounding = 2e-16 / min(angle, 1.0)
        np.testing.assert_allclose(slopes[0, 0], -0.5 * angle * np.sin(angle), rtol=1e-9, atol=rounding)
        np.testing.assert_allclose(slopes[0, 1], 0.5 * angle * np.sin(angle), rtol=1e-9, atol=rounding)


@pytest.mark.parametrize("damping", DAMPINGS, ids=IDS)
def test_simulation_from_rest_is_what_an_ode_solver_finds(damping):
    model, theta = two_materials(10, damping, n=3, omega=30.0), {"E": 1.1, "rho": 1.2}
    A, B = system(model, theta)
    steps, h = 20, 0.01
    rng = np.random.default_rng(5)
    u = rng.standard_normal((steps, 3, 2))
    x = simulate(model, theta, u, h)
    assert x.shape == (steps + 1, 6)
    np.testing.assert_array_equal(x[0], 0.0)
    state = np.zeros(6)
    for k in range(steps):

        def rate(t, y, k=k):
            s = t / h
            return A @ y + B @ (u[k, 0] + u[k, 1] * s + u[k, 2] * s * s)

        state = solve_ivp(rate, (0, h), state, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
        np.testing.assert_allclose(x[k + 1], state, atol=1e-10)
