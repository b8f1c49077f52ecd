"""Every input model has the variance, the spectrum and the rate that its docstring promises."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from strainsight.augmentation.input_models import (
    IntegratedRandomWalk,
    Matern,
    Oscillator,
    RandomWalk,
    component_names,
    components,
    input_intensity,
    rate_matrix,
)
from strainsight.augmentation.unknowns import Unknowns
from strainsight.errors import ConfigError

STATIONARY = [Matern(8.0, 0.5), Matern(8.0, 1.5), Matern(8.0, 2.5), Oscillator(20.0), Oscillator(20.0, 0.7)]


def spectrum(model, omega):
    """|[1, 0, …](iωI − A)⁻¹ L|² q of ũ for every ω."""
    A, Q = rate_matrix(model), input_intensity(model, 1.0)
    response = np.linalg.solve(1j * omega[:, None, None] * np.eye(len(A)) - A, np.eye(len(A)))[:, 0, -1]
    return np.abs(response) ** 2 * Q[-1, -1]


@pytest.mark.parametrize("model", STATIONARY)
def test_a_stationary_input_has_the_variance_of_its_amplitude(model):
    P = solve_continuous_lyapunov(rate_matrix(model), -input_intensity(model, 0.0))
    expected = np.eye(components(model))
    if len(expected) == 3:  # var ũ̈ = λ⁴ and cov(ũ, ũ̈) = −var ũ̇ = −λ²/3
        expected = np.array([[1, 0, -1 / 3], [0, 1 / 3, 0], [-1 / 3, 0, 1]])
    np.testing.assert_allclose(P, expected, atol=1e-12)


@pytest.mark.parametrize("model", [Matern(8.0, nu) for nu in (0.5, 1.5, 2.5)])
def test_half_the_power_density_is_left_at_the_bandwidth(model):
    zero, edge = spectrum(model, 2 * np.pi * np.array([0.0, 8.0]))
    assert edge / zero == pytest.approx(0.5, rel=1e-12)
    far = spectrum(model, 2 * np.pi * np.array([8e4, 8e5]))
    assert np.log10(far[0] / far[1]) == pytest.approx(2 * model.smoothness + 1, rel=1e-4)


def test_an_oscillator_has_half_its_power_within_its_bandwidth():
    model = Oscillator(20.0, 0.02)
    omega = 2 * np.pi * np.linspace(0.0, 400.0, 400_001)
    density = spectrum(model, omega)
    assert omega[np.argmax(density)] == pytest.approx(2 * np.pi * 20, rel=1e-3)
    inside = np.abs(omega / (2 * np.pi) - 20) <= 0.02 * 20
    assert density[inside].sum() / density.sum() == pytest.approx(0.5, abs=0.01)


def test_the_rate_of_an_integrated_walk_gains_its_amplitude_in_one_period():
    omega = 2 * np.pi * 20
    model = IntegratedRandomWalk(20.0)
    gained = input_intensity(model, 0.0)[1, 1] / 20  # variance of r = u̇/(aω) after one period
    t = np.linspace(0, 1 / 20, 1000, endpoint=False)
    assert gained == pytest.approx(np.max(np.cos(omega * t) ** 2), rel=1e-12)
    np.testing.assert_allclose(rate_matrix(model), [[0, omega], [0, 0]])


def test_a_random_walk_is_what_it_was():
    assert rate_matrix(RandomWalk()).tolist() == [[0.0]]
    assert input_intensity(RandomWalk(), 12.5).tolist() == [[12.5]]


def test_components_have_names():
    assert component_names(RandomWalk(), "F") == ("F",)
    assert component_names(Oscillator(3.0), "F") == ("F", "rate of F")
    assert component_names(Matern(3.0, 2.5), "F") == ("F", "rate of F", "curvature of F")
    assert [components(model) for model in STATIONARY] == [1, 2, 3, 2, 2]


@pytest.mark.parametrize(
    ("build", "said"),
    [
        (lambda: IntegratedRandomWalk(0.0), "frequency of an integrated random walk is 0"),
        (lambda: IntegratedRandomWalk(1.0, -1.0), "kappa of an integrated random walk is -1"),
        (lambda: Matern(np.inf), "bandwidth of a Matérn input is inf"),
        (lambda: Matern(1.0, 1.0), "smoothness 1.0"),
        (lambda: Oscillator(-3.0), "frequency of an oscillator"),
        (lambda: Oscillator(3.0, 0.0), "damping of an oscillator"),
    ],
)
def test_nonsense_is_refused(build, said):
    with pytest.raises(ConfigError, match=said):
        build()


def test_unknowns_say_where_they_stand(chain_of, theta):
    model = chain_of()
    unknowns = Unknowns(
        ("side", "tip"), ("rho",), {"tip": 40.0, "side": 7.0}, theta, {"side": Matern(3.0, 2.5), "tip": Oscillator(9.0)}
    )
    assert unknowns.state_names == ("side", "rate of side", "curvature of side", "tip", "rate of tip", "rho")
    assert unknowns.names == ("side", "tip", "rho")
    assert unknowns.count == 3
    assert unknowns.size(model) == 2 * model.size + 6
    assert (unknowns.position(model) - 2 * model.size).tolist() == [0, 3, 5]
    assert unknowns.state_scale.tolist() == [7.0, 7.0, 7.0, 40.0, 40.0, 7800.0]
    plain = Unknowns(("side", "tip"), ("rho",), {"tip": 40.0, "side": 7.0}, theta)
    assert plain.state_names == plain.names
    assert (plain.position(model) - 2 * model.size).tolist() == [0, 1, 2]
