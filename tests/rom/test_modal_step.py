"""The modal step is the matrix exponential, schemes are those of the whole system; slopes, one oscillator, periodic motion."""

from __future__ import annotations

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from scipy.linalg import expm, expm_frechet, solve_sylvester, sqrtm

from strainsight.errors import InfeasibleError, NumericalError
from strainsight.fem.affine import AffineOperator, Coefficient, Newton
from strainsight.rom.modal_step import (
    HOLD,
    acceleration_map,
    modal_step,
    oscillator_step,
    parameter_slopes,
    phi_functions,
    scheme_bias,
    scheme_step,
    simulate,
    steady_start,
)
from strainsight.rom.model import Damping, ReducedModel, damping_derivative, damping_matrix, frequency_response

from .models import DAMPINGS, IDS, positive, scales, shape, system, two_materials

NAMES = ("E", "rho")


def one_material(lam: np.ndarray, damping: Damping) -> ReducedModel:
    n = len(lam)
    zero = np.zeros((n, n))
    stiffness, mass = AffineOperator(zero, {"E": np.diag(lam)}), AffineOperator(zero, {"rho": np.eye(n)})
    S = np.random.default_rng(0).standard_normal((n, 2))
    return ReducedModel(mass, stiffness, S, ("Fx", "Fz"), {"E": 1.0, "rho": 1.0}, damping)


@pytest.mark.parametrize("damping", DAMPINGS[1:], ids=IDS[1:])
def test_frequency_response_is_that_of_the_first_order_system(damping):
    """H = R [1 0](iω − A)⁻¹ B at parameter values where nothing commutes; static, at a mode and above all modes."""
    model, theta = two_materials(3, damping, on_mass=True), {"E": 1.3, "rho": 0.8}
    A, B = system(model, theta)
    R, n = np.random.default_rng(5).standard_normal((3, model.size)), model.size
    frequency = np.append([0.0, 1.0, 300.0], np.abs(np.linalg.eigvals(A).imag) / (2 * np.pi))
    expected = [R @ np.linalg.solve(2j * np.pi * f * np.eye(2 * n) - A, B)[:n] for f in frequency]
    np.testing.assert_allclose(frequency_response(model, theta, R, frequency), expected, rtol=1e-8)


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
def test_step_with_slow_and_fast_modes(omega, damping):
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


def test_simulation_from_rest_is_step_after_step():
    model, theta = two_materials(10, DAMPINGS[1], n=3, omega=30.0), {"E": 1.1, "rho": 1.2}
    u, step = np.random.default_rng(5).standard_normal((20, 3, 2)), modal_step(model, theta, 0.01)
    expected = [np.zeros(6)]
    for own in u:
        expected.append(step.transition @ expected[-1] + np.einsum("aju,ju->a", step.input, own))
    np.testing.assert_allclose(simulate(model, theta, u, 0.01), expected, rtol=1e-12, atol=1e-15)


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
    """In the damping factor too, where there is damping."""
    model, rng = two_materials(3, damping, on_mass=True), np.random.default_rng(2)
    names, at = ("E", "rho"), THETA
    if damping is not DAMPINGS[0]:
        model, names, at = model.with_damping("zeta", 1.0), ("E", "rho", "zeta"), {**THETA, "zeta": 1.7}
    x, u = rng.standard_normal(8), rng.standard_normal((1 if kind == "acceleration" else 3, 2))

    def built(theta):
        return acceleration_map(model, theta) if kind == "acceleration" else modal_step(model, theta, 7e-3, kind)

    def after(theta):
        linear = built(theta)
        return linear.transition @ x + np.einsum("aju,ju->a", linear.input, u)

    slopes = parameter_slopes(model, built(at), at, x, u, names)
    for i, name in enumerate(names):
        d = 1e-5
        difference = (after({**at, name: at[name] + d}) - after({**at, name: at[name] - d})) / (2 * d)
        np.testing.assert_allclose(slopes[:, i], difference, atol=1e-7 * np.abs(difference).max())


@pytest.mark.parametrize("scheme", ["trapezoidal", "implicit_euler"])
def test_scheme_bias_agrees_with_free_motion(scheme):
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


def test_overdamped_mode_has_no_period():
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
    with pytest.raises(NumericalError, match="critical damping"):
        oscillator_step(np.array([25.0]), Damping("modal", ratio=1.0), 0.1)


def test_phi_functions_against_high_precision():
    z = np.array([0.0, 1e-9, 0.3j, -0.999, 0.7 + 0.7j, 1.0, -1.0001, 5j, -40.0, 300j, -1e5 + 2e4j])
    phi = phi_functions(z, 4)
    with mpmath.workdps(40):
        for i, value in enumerate(z):
            for k in range(5):
                exact = complex(mpmath.hyp1f1(1, k + 1, mpmath.mpc(value)) / mpmath.factorial(k))
                assert abs(phi[k][i] - exact) <= 2e-14 * max(abs(exact), 1e-30) * max(1, abs(value))


FREQUENCY = 2 * np.pi * np.array([0.0, 20.0, 35.0])
AMPLITUDE = np.array([[3.0, 0.0], [1.0 - 2.0j, 0.5j], [0.0, -1.5]])


def loads(t):
    """u (..., 2) of the tones, by cosines."""
    phase = np.exp(1j * FREQUENCY * np.asarray(t)[..., None])
    return (phase @ AMPLITUDE).real


def held(h, steps):
    """Quadratics through the start, the middle and the end of every step, by NumPy's fit."""
    t = h * np.arange(steps)[:, None] + h * np.array([0.0, 0.5, 1.0])
    fits = [np.polynomial.polynomial.polyfit([0.0, 0.5, 1.0], loads(own), 2) for own in t]
    return np.array(fits)


@pytest.mark.parametrize("damping", DAMPINGS, ids=IDS)
@pytest.mark.parametrize("steps", [40, 400])
def test_the_motion_repeats_after_the_common_period(damping, steps):
    """0.2 s is four periods of 20 Hz and seven of 35 Hz; undamped, nothing but the start could make it so."""
    model, h = two_materials(1, damping), 0.2 / steps
    x = simulate(model, THETA, held(h, 2 * steps), h, steady_start(model, THETA, h, FREQUENCY, AMPLITUDE))
    w = scales(model, THETA)
    size = np.abs(w * x).max()
    assert np.abs(w * (x[steps:] - x[: steps + 1])).max() <= 1e-9 * size
    assert size > 0


@pytest.mark.parametrize("damping", DAMPINGS, ids=IDS)
def test_it_tends_to_the_complex_solution(damping):
    """[z, ż] = Re (iωI − A)⁻¹B U of the first-order form: the error of the hold falls with h⁴ at least."""
    model = two_materials(3, damping)
    A, B = system(model, THETA)
    each = [np.linalg.solve(1j * f * np.eye(len(A)) - A, B @ U) for f, U in zip(FREQUENCY, AMPLITUDE, strict=True)]
    expected, w = np.sum(each, axis=0).real, scales(model, THETA)
    wrong = [
        np.abs(w * (steady_start(model, THETA, h, FREQUENCY, AMPLITUDE) - expected)).max() / np.abs(w * expected).max()
        for h in (2e-3, 1e-3, 5e-4)
    ]
    assert wrong[0] < 1e-4
    assert wrong[0] / wrong[1] > 14
    assert wrong[1] / wrong[2] > 14


def test_two_masses_in_closed_form():
    """k[[2, −1], [−1, 1]], m, C = αM + βK, one tone on the second mass: Cramer's rule on the complex 2 × 2 matrix."""
    k, m, alpha, beta, omega, U = 4e4, 2.0, 3.0, 1e-4, 150.0, 7.0 - 3.0j
    springs = k * np.array([[2.0, -1.0], [-1.0, 1.0]])
    model = ReducedModel(
        AffineOperator(m * np.eye(2), {}),
        AffineOperator(springs, {}),
        np.array([[0.0], [1.0]]),
        ("F",),
        {},
        Damping("rayleigh", alpha=alpha, beta=beta),
    )
    spring = k * (1 + 1j * omega * beta)
    inertia = -(omega**2) * m + 1j * omega * alpha * m
    a, b, d = 2 * spring + inertia, -spring, spring + inertia
    q = np.array([-b, a]) * U / (a * d - b * b)
    found = steady_start(model, {}, 1e-5, np.array([omega]), np.array([[U]]))
    np.testing.assert_allclose(found[:2], q.real, rtol=1e-9)
    np.testing.assert_allclose(found[2:], (1j * omega * q).real, rtol=1e-9)


def test_resonant_undamped_mode_is_refused():
    model = ReducedModel(
        AffineOperator(np.eye(2), {}),
        AffineOperator(np.diag([1e4, 4e4]), {}),
        np.array([[1.0], [0.0]]),
        ("F",),
        {},
        Damping(),
    )
    with pytest.raises(InfeasibleError, match=r"15\.91.* Hz excites the undamped mode 1"):
        steady_start(model, {}, 1e-3, np.array([100.0]), np.ones((1, 1)))
    assert np.isfinite(steady_start(model, {}, 1e-3, np.array([200.0]), np.ones((1, 1)))).all()
