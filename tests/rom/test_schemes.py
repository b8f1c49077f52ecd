"""Trapezoidal rule and implicit Euler by modes are those of the whole system, and their bias is what theory says."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import sqrtm

from strainsight.fem.affine import AffineOperator
from strainsight.rom.modal_step import acceleration_map, modal_step, parameter_slopes
from strainsight.rom.model import Damping, ReducedModel
from strainsight.rom.schemes import scheme_bias, scheme_step

DAMPINGS = [Damping(), Damping("modal", ratio=0.02), Damping("rayleigh", alpha=0.5, beta=1e-4)]
THETA = {"E": 1.2, "rho": 0.9}


def positive(rng: np.random.Generator, n: int) -> np.ndarray:
    X = rng.standard_normal((n, n))
    return X @ X.T / n + 0.2 * np.eye(n)


def two_materials(damping: Damping, n: int = 4) -> ReducedModel:
    rng = np.random.default_rng(3)
    stiffness = AffineOperator(1e4 * positive(rng, n), {"E": 5e3 * positive(rng, n)})
    mass = AffineOperator(positive(rng, n), {"rho": 0.5 * positive(rng, n)})
    return ReducedModel(mass, stiffness, rng.standard_normal((n, 2)), ("Fx", "Fz"), {"E": 1.0, "rho": 1.0}, damping)


def dense(model: ReducedModel, theta) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """M, C, K with the damping by a matrix root."""
    M, K, d = model.mass.at(theta), model.stiffness.at(theta), model.damping
    if d.kind == "modal":
        return M, 2 * d.ratio * M @ sqrtm(np.linalg.solve(M, K)).real, K
    return M, d.alpha * M + d.beta * K, K


@pytest.mark.parametrize("damping", DAMPINGS)
@pytest.mark.parametrize("h", [1e-4, 1e-2, 0.3])
@pytest.mark.parametrize("scheme", ["trapezoidal", "implicit_euler"])
def test_a_scheme_by_modes_is_that_of_the_first_order_system(damping, h, scheme):
    """(I − s A) x⁺ = (I + (h − s) A) x + h b with s = h/2 or h, b of the mean force or of that at the end."""
    model = two_materials(damping)
    M, C, K = dense(model, THETA)
    n = model.size
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    B = np.vstack([np.zeros((n, 2)), np.linalg.solve(M, model.input_shape)])
    rng = np.random.default_rng(0)
    x, u = rng.standard_normal(2 * n), 100 * rng.standard_normal((3, 2))
    start, end = u[0], u.sum(axis=0)
    s, force = (h / 2, (start + end) / 2) if scheme == "trapezoidal" else (h, end)
    expected = np.linalg.solve(np.eye(2 * n) - s * A, x + (h - s) * (A @ x) + h * (B @ force))
    step = modal_step(model, THETA, h, scheme)
    found = step.transition @ x + np.einsum("aju,ju->a", step.input, u)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("damping", DAMPINGS)
def test_the_acceleration_solves_the_equation_of_motion(damping):
    model = two_materials(damping)
    M, C, K = dense(model, THETA)
    rng = np.random.default_rng(1)
    x, u = rng.standard_normal(8), 100 * rng.standard_normal(2)
    found = acceleration_map(model, THETA)
    a = found.transition @ x + found.input[:, 0] @ u
    np.testing.assert_allclose(a, np.linalg.solve(M, model.input_shape @ u - C @ x[4:] - K @ x[:4]), rtol=1e-10)


@pytest.mark.parametrize("damping", DAMPINGS)
@pytest.mark.parametrize("kind", ["trapezoidal", "implicit_euler", "acceleration"])
def test_slopes_agree_with_central_differences(damping, kind):
    model, rng = two_materials(damping), np.random.default_rng(2)
    inputs = 1 if kind == "acceleration" else 3
    x, u = rng.standard_normal(8), rng.standard_normal((inputs, 2))

    def built(theta):
        return acceleration_map(model, theta) if kind == "acceleration" else modal_step(model, theta, 7e-3, kind)

    def after(theta):
        linear = built(theta)
        return linear.transition @ x + np.einsum("aju,ju->a", linear.input, u)

    slopes = parameter_slopes(model, built(THETA), THETA, x, u, ("E", "rho"))
    assert slopes.shape == (len(after(THETA)), 2)
    for i, name in enumerate(("E", "rho")):
        d = 1e-5
        difference = (after({**THETA, name: THETA[name] + d}) - after({**THETA, name: THETA[name] - d})) / (2 * d)
        np.testing.assert_allclose(slopes[:, i], difference, atol=1e-7 * np.abs(difference).max())


def test_bias_is_that_of_the_textbook_for_small_steps():
    lam, h = np.array([1e2, 1e4]), 1e-3
    angle = np.sqrt(lam) * h
    longer, damped = scheme_bias(lam, Damping(), h, "trapezoidal")
    np.testing.assert_allclose(longer, angle**2 / 12, rtol=0.01)
    np.testing.assert_allclose(damped, 0, atol=1e-12)
    longer, damped = scheme_bias(lam, Damping(), h, "implicit_euler")
    np.testing.assert_allclose(longer, angle**2 / 3, rtol=0.01)
    np.testing.assert_allclose(damped, angle / 2, rtol=0.01)
    assert not np.any(scheme_bias(lam, Damping(ratio=0.1), h, "exact"))


@pytest.mark.parametrize("scheme", ["trapezoidal", "implicit_euler"])
def test_bias_is_seen_in_a_free_motion(scheme):
    """Counted on the free decay itself: zero crossings for the period, the envelope for the damping."""
    damping, h, lam = Damping(ratio=0.01), 1e-2, np.array([30.0**2])
    block = scheme_step(lam, damping, h, scheme)[0][:, :2, 0]
    state, z = np.array([0.0, 1.0]), []
    for _ in range(2000):
        z.append(state[0] / np.linalg.norm(state))
        state = block @ (state / np.linalg.norm(state))
    crossings = np.flatnonzero(np.diff(np.signbit(z)))
    at = crossings + np.array(z)[crossings] / (np.array(z)[crossings] - np.array(z)[crossings + 1])
    half_period = (at[-1] - at[0]) / (len(at) - 1) * h
    longer, damped = scheme_bias(lam, damping, h, scheme)
    exact = np.pi / (30.0 * np.sqrt(1 - 0.01**2))
    assert half_period / exact - 1 == pytest.approx(longer[0], rel=0.02)
    decay = -np.log(np.abs(np.linalg.det(block))) / (2 * h)
    total = 0.01 + damped[0]
    assert decay == pytest.approx(total / np.sqrt(1 - total**2) * np.pi / half_period, rel=1e-3)


def test_a_mode_that_does_not_swing_has_no_period():
    longer, damped = scheme_bias(np.array([1.0, 1e4]), Damping("rayleigh", alpha=5.0), 1e-3, "trapezoidal")
    assert np.isnan(longer[0])
    assert np.isfinite(longer[1])
    assert np.isfinite(damped[1])
