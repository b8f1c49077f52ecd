"""Steps by modes are those of the whole system, and the closed form of one oscillator is exact over the whole range of ωh."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from strainsight.errors import NumericalError
from strainsight.rom.modal_step import acceleration_map, modal_step, parameter_slopes
from strainsight.rom.model import Damping
from strainsight.rom.oscillator import HOLD, oscillator_step, phi_functions
from strainsight.rom.schemes import scheme_bias, scheme_step

from .models import DAMPINGS, system, two_materials

THETA = {"E": 1.2, "rho": 0.9}


@pytest.mark.parametrize("damping", DAMPINGS)
@pytest.mark.parametrize("h", [1e-4, 1e-2, 0.3])
@pytest.mark.parametrize("scheme", ["trapezoidal", "implicit_euler"])
def test_a_scheme_by_modes_is_that_of_the_first_order_system(damping, h, scheme):
    """(I − s A) x⁺ = (I + (h − s) A) x + h b with s = h/2 or h, b of the mean force or of that at the end."""
    model = two_materials(3, damping)
    A, B = system(model, THETA)
    n = model.size
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
    model = two_materials(3, damping)
    A, B = system(model, THETA)
    rng = np.random.default_rng(1)
    x, u = rng.standard_normal(8), 100 * rng.standard_normal(2)
    found = acceleration_map(model, THETA)
    a = found.transition @ x + found.input[:, 0] @ u
    np.testing.assert_allclose(a, (A @ x + B @ u)[4:], rtol=1e-10)


@pytest.mark.parametrize("damping", DAMPINGS)
@pytest.mark.parametrize("kind", ["trapezoidal", "implicit_euler", "acceleration"])
def test_slopes_agree_with_central_differences(damping, kind):
    model, rng = two_materials(3, damping), np.random.default_rng(2)
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


@pytest.mark.parametrize("scheme", ["trapezoidal", "implicit_euler"])
def test_bias_is_seen_in_a_free_motion(scheme):
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


def propagator(lam: mpmath.mpf, damping: Damping, h: float) -> mpmath.matrix:
    """[z, ż, g₀, g₁, g₂] → [z, ż](h) by the matrix exponential of the oscillator with its force as states."""
    if damping.kind == "modal":
        c = 2 * mpmath.mpf(damping.ratio) * mpmath.sqrt(lam)
    else:
        c = mpmath.mpf(damping.alpha) + mpmath.mpf(damping.beta) * lam
    h = mpmath.mpf(h)
    A = mpmath.zeros(5)
    A[0, 1] = 1
    A[1, 0], A[1, 1], A[1, 2] = -lam, -c, 1
    # The force and its derivatives in s = τ/h as states: g(0) = g₀, g' = g₁/h, g'' = 2g₂/h².
    A[2, 3] = A[3, 4] = 1
    scale = mpmath.diag([1, 1, 1, 1 / h, 2 / h**2])
    return (mpmath.expm(A * h, method="taylor") * scale)[:2, :]


KINDS = [
    Damping(),
    Damping("modal", ratio=0.01),
    Damping("modal", ratio=1.7),
    Damping("rayleigh", alpha=3.0, beta=1e-3),
]


@pytest.mark.parametrize("damping", KINDS, ids=["none", "modal", "overdamped", "rayleigh"])
@pytest.mark.parametrize("omega", [1e-2, 1.0, 100.0, 1e4, 3e5])
def test_the_step_and_its_slope_agree_with_sixty_digits(damping, omega):
    h, lam = 5e-4, omega**2
    T, dT = oscillator_step(np.array([lam]), damping, h)
    with mpmath.workdps(60 if omega < 1e5 else 250):
        exact = propagator(mpmath.mpf(lam), damping, h)
        step = mpmath.mpf(lam) * mpmath.mpf(10) ** -20
        slope = (propagator(lam + step, damping, h) - propagator(lam - step, damping, h)) / (2 * step)
        exact = np.array(exact.tolist(), dtype=float).reshape(2, 2 + HOLD)
        slope = np.array(slope.tolist(), dtype=float).reshape(2, 2 + HOLD)
    # What rounding may cost: the phase ωh where it is large, the difference of two close roots where it is small.
    # λ ∂T/∂λ is held against T itself: beside it, it is of order (ωh)² where ωh is small.
    cost = max(1.0, omega * h) / min(1.0, omega * h)
    size = np.outer([1.0, omega], [1.0, 1 / omega, *([1 / lam] * HOLD)]) if omega * h > 1 else np.abs(exact)
    assert np.all(np.abs(T[..., 0] - exact) <= 2e-14 * cost * (np.abs(exact) + size))
    assert np.all(lam * np.abs(dT[..., 0] - slope) <= 1e-13 * cost * (lam * np.abs(slope) + size))


def test_nothing_overflows_at_huge_frequencies():
    for damping in KINDS:
        T, dT = oscillator_step(np.array([1e16, 1e20]), damping, 1e-2)
        assert np.isfinite(T).all()
        assert np.isfinite(dT).all()
        # Displacement under a constant force tends to g/λ within twice the static value.
        assert np.all(np.abs(T[0, 2]) <= 2.000001 / np.array([1e16, 1e20]))


def test_critical_damping_is_refused_with_a_remedy():
    with pytest.raises(NumericalError, match="critically damped"):
        oscillator_step(np.array([25.0]), Damping("modal", ratio=1.0), 0.1)


def test_phi_functions_against_high_precision():
    z = np.array([0.0, 1e-9, 0.3j, -0.999, 0.7 + 0.7j, 1.0, -1.0001, 5j, -40.0, 300j, -1e5 + 2e4j])
    phi = phi_functions(z, 4)
    with mpmath.workdps(40):
        for i, value in enumerate(z):
            for k in range(5):
                exact = complex(mpmath.hyp1f1(1, k + 1, mpmath.mpc(value)) / mpmath.factorial(k))
                assert abs(phi[k][i] - exact) <= 2e-14 * max(abs(exact), 1e-30) * max(1, abs(value))
