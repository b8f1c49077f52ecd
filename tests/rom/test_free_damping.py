"""A parameter that multiplies the damping: steps, accelerations, matrices and their slopes in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm, expm_frechet

from strainsight.errors import NumericalError
from strainsight.rom.modal_step import acceleration_map, modal_step, parameter_slopes, simulate
from strainsight.rom.model import Damping, damping_derivative, damping_matrix
from strainsight.rom.steady import steady_start

from .test_modal_step import system, two_materials, with_force_states

DAMPINGS = [Damping("modal", ratio=0.02), Damping("rayleigh", alpha=0.5, beta=1e-4)]
IDS = ["modal", "rayleigh"]
THETA = {"E": 1.2, "rho": 0.9, "zeta": 1.7}


def pair(damping, seed=3):
    """A model with a free factor of its damping, and the one whose damping is so much stronger."""
    known = two_materials(seed, damping, on_mass=True)
    return known.with_damping("zeta", 1.0), replace(known, damping=damping.scaled(THETA["zeta"]))


@pytest.mark.parametrize("damping", DAMPINGS, ids=IDS)
def test_at_a_value_it_is_the_model_damped_so_much(damping):
    free, known = pair(damping)
    assert free.parameters == ("E", "rho", "zeta")
    for made in (lambda m: modal_step(m, THETA, 7e-3), lambda m: acceleration_map(m, THETA)):
        a, b = made(free), made(known)
        np.testing.assert_allclose(a.transition, b.transition, rtol=1e-13, atol=1e-15 * np.abs(b.transition).max())
        np.testing.assert_allclose(a.input, b.input, rtol=1e-13, atol=1e-15 * np.abs(b.input).max())
    np.testing.assert_allclose(damping_matrix(free, THETA), damping_matrix(known, THETA), rtol=1e-13, atol=1e-13)
    u = np.random.default_rng(0).standard_normal((5, 3, 2))
    np.testing.assert_allclose(simulate(free, THETA, u, 1e-2), simulate(known, THETA, u, 1e-2), rtol=1e-11, atol=1e-14)
    tone = np.array([20.0]), np.array([[1.0, 0.5j]])
    np.testing.assert_allclose(
        steady_start(free, THETA, 1e-2, *tone), steady_start(known, THETA, 1e-2, *tone), rtol=1e-11, atol=1e-14
    )


@pytest.mark.parametrize("damping", DAMPINGS, ids=IDS)
@pytest.mark.parametrize("of_all", [False, True], ids=["damping alone", "all"])
def test_many_values_at_once_are_each_alone(damping, of_all):
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
    after = modal_step(free, THETA, h)
    np.testing.assert_allclose(
        after.transition @ x + np.einsum("aju,ju->a", after.input, u), (expm(G) @ start)[:8], rtol=1e-8, atol=1e-10
    )


@pytest.mark.parametrize("damping", DAMPINGS, ids=IDS)
@pytest.mark.parametrize("scheme", ["trapezoidal", "implicit_euler"])
def test_slopes_of_schemes_and_accelerations_agree_with_central_differences(damping, scheme):
    free, _ = pair(damping)
    rng = np.random.default_rng(4)
    x, u = rng.standard_normal(8), rng.standard_normal((3, 2))
    # an acceleration is linear in the damping
    for made, inputs, d in (
        (lambda at: modal_step(free, at, 7e-3, scheme), u, 1e-5),
        (lambda at: acceleration_map(free, at), u[:1], 0.5),
    ):

        def after(zeta, made=made, inputs=inputs):
            found = made({**THETA, "zeta": zeta})
            return found.transition @ x + np.einsum("aju,ju->a", found.input, inputs)

        slope = parameter_slopes(free, made(THETA), THETA, x, inputs, ["zeta"])[:, 0]
        difference = (after(THETA["zeta"] + d) - after(THETA["zeta"] - d)) / (2 * d)
        np.testing.assert_allclose(slope, difference, atol=1e-8 * np.abs(difference).max())


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
    with pytest.raises(NumericalError, match="critically damped"):
        modal_step(free, {**THETA, "zeta": 2.0}, 1e-3)
