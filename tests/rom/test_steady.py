"""The periodic motion under tones: it repeats, differs from any other motion by free vibration, and is the complex solution."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import InfeasibleError
from strainsight.fem.affine import AffineOperator
from strainsight.rom.modal_step import simulate
from strainsight.rom.model import Damping, ReducedModel
from strainsight.rom.steady import steady_start

from .models import DAMPINGS, IDS, scales, system, two_materials

THETA = {"E": 1.2, "rho": 0.9}
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


def test_an_undamped_mode_at_the_frequency_of_a_load_is_refused_and_a_load_that_does_not_reach_it_is_not():
    model = ReducedModel(
        AffineOperator(np.eye(2), {}),
        AffineOperator(np.diag([1e4, 4e4]), {}),
        np.array([[1.0], [0.0]]),
        ("F",),
        {},
        Damping(),
    )
    with pytest.raises(InfeasibleError, match=r"15\.91.* Hz at the undamped mode 1"):
        steady_start(model, {}, 1e-3, np.array([100.0]), np.ones((1, 1)))
    assert np.isfinite(steady_start(model, {}, 1e-3, np.array([200.0]), np.ones((1, 1)))).all()
