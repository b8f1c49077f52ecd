"""Process and measurement noise, measurement rows, and models of inputs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

from strainsight.errors import ConfigError
from strainsight.loads.input_models import (
    IntegratedRandomWalk,
    Matern,
    Oscillator,
    Unknowns,
    components,
    input_intensity,
    rate_matrix,
)
from strainsight.loads.linearisation import (
    channel_intensity,
    gauge_intensity,
    linearise,
    measurement_rows,
    process_intensity,
)
from strainsight.sensors.candidates import ACCELERATION, STRAIN

from .conftest import chain_of, theta

UNKNOWNS = Unknowns(("F",), ("E",), {"F": 1e4}, {"E": 2e11})


def test_default_intensities_act_on_unknowns_only():
    Q = process_intensity(3, UNKNOWNS, {"F": 20.0}, {"E": 0.05})
    np.testing.assert_allclose(Q, np.diag([0, 0, 0, 0, 0, 0, 20.0, 0.0025]), rtol=1e-14)
    noisy = process_intensity(3, UNKNOWNS, {"F": 20.0}, {"E": 0.05}, velocity=np.array([1.0, 2.0, 3.0]))
    assert np.diag(noisy)[:6].tolist() == [0, 0, 0, 1, 2, 3]


@pytest.mark.parametrize("h", [1e-3, 2e-4])
def test_thesis_rule_gives_its_discrete_covariance_at_the_stated_step(h):
    omega = 2 * np.pi * 20
    Q = process_intensity(2, UNKNOWNS, {"F": 20.0}, {"E": 3.0}, rule="thesis", h=h)
    np.testing.assert_allclose(np.diag(Q)[-2:] * h, [(h * omega) ** 2, (h * 3.0) ** 2])
    printed = process_intensity(2, UNKNOWNS, {"F": 20.0}, {"E": 3.0}, rule="as_printed", h=h)
    np.testing.assert_allclose(np.diag(printed)[-2:], [(h * omega) ** 2, (h * 3.0) ** 2])


def test_a_rule_that_needs_a_step_asks_for_it_and_a_missing_guess_is_named():
    with pytest.raises(ConfigError, match="time step"):
        process_intensity(2, UNKNOWNS, {"F": 20.0}, {"E": 3.0}, rule="thesis")
    with pytest.raises(ConfigError, match="frequency of F"):
        process_intensity(2, UNKNOWNS, {}, {"E": 3.0})


def test_gauge_intensity_is_variance_times_sampling_step():
    np.testing.assert_allclose(gauge_intensity(np.array([1e-6, 2e-6]), 1e-3), [1e-15, 4e-15])
    np.testing.assert_allclose(gauge_intensity(np.array([1e-6]), 1e-3, "as_printed"), [1e-12])


def test_every_input_model_brings_its_own_intensity():
    unknowns = Unknowns(
        ("F", "G", "W"), ("E",), dict.fromkeys("FGW", 1e4), {"E": 2e11}, {"F": Matern(5.0, 2.5), "G": Oscillator(10.0)}
    )
    q = np.diag(process_intensity(2, unknowns, {"W": 20.0}, {"E": 0.05}, kappa=np.array([9.0, 9.0, 0.2])))
    rate = 2 * np.pi * 5.0 / np.sqrt(2 ** (1 / 3) - 1)
    expected = [0, 0, 0, 0, 0, 0, 16 / 3 * rate, 0, 4 * 0.05 * 2 * np.pi * 10, 0.2 * 2 * np.pi * 20, 0.0025]
    np.testing.assert_allclose(q, expected)


def test_the_rules_of_the_thesis_are_those_of_a_random_walk():
    smooth = Unknowns(("F",), (), {"F": 1e4}, {}, {"F": IntegratedRandomWalk(20.0)})
    with pytest.raises(ConfigError, match="load F has another model"):
        process_intensity(2, smooth, {"F": 20.0}, {}, rule="thesis", h=1e-3)


def test_an_accelerometer_reads_the_error_of_the_model_too():
    std, rows = np.array([1e-6, 0.1, 0.1]), np.random.default_rng(0).normal(size=(3, 4))
    quantity = np.array([STRAIN, ACCELERATION, ACCELERATION])
    Q = process_intensity(4, UNKNOWNS, {"F": 20.0}, {"E": 0.05}, velocity=np.array([1.0, 2.0, 3.0, 4.0]))
    r = channel_intensity(std, 1e-3, rows, quantity, Q)
    heard = np.sum(rows**2 * np.array([1.0, 2.0, 3.0, 4.0]), axis=1)
    np.testing.assert_allclose(r, std**2 * 1e-3 + np.array([0, heard[1], heard[2]]))
    both = channel_intensity(np.array([std, 2 * std]), 1e-3, np.array([rows, rows]), quantity, Q)
    np.testing.assert_allclose(both[1] - both[0], 3 * std**2 * 1e-3)


@pytest.mark.parametrize("velocity", [1e-4, 1e-2])
def test_acceleration_noise_term_is_required(velocity):
    """Real error by the Lyapunov equation with the correlation S = Q_v φᵀ, at the gain of a filter that does not know it."""
    model, noise = chain_of(3), 1e-3
    n = model.size
    unknowns = Unknowns(("tip",), (), {"tip": 40.0}, theta)
    F = linearise(model, unknowns, theta, np.zeros((1, 2 * n)), np.zeros((1, 2)))[0]
    Q = process_intensity(n, unknowns, {"tip": 20.0}, {}, kappa=0.1, velocity=velocity)
    rng = np.random.default_rng(0)
    rows = np.vstack([rng.normal(size=(2, n)), model.input_shape[:, 0]])
    quantity = np.array([STRAIN, STRAIN, ACCELERATION])
    scale = np.concatenate([1 / np.sqrt(np.diag(model.stiffness.at(theta))), np.ones(n + 1)])
    H = measurement_rows(rows, quantity, F) * scale
    F, Q_scaled = F / scale[:, None] * scale, Q / np.outer(scale, scale)
    std = np.array([1e-7, 1e-7, noise])
    S = np.zeros((len(F), 3))
    S[n : 2 * n, 2] = Q[n : 2 * n, n : 2 * n] @ rows[2]
    r = channel_intensity(std, 1e-3, rows, quantity, Q)

    def claimed_and_real(assumed):
        P = solve_continuous_are(F.T, H.T, Q_scaled, np.diag(assumed))
        K = P @ H.T / assumed
        closed = F - K @ H
        real = solve_continuous_lyapunov(closed, -(Q_scaled - K @ S.T - S @ K.T + K * r @ K.T))
        return np.sqrt(np.diag(P)), np.sqrt(np.diag(real))

    claimed, real = claimed_and_real(r)
    assert np.all(claimed > 0.95 * real)
    assert np.all(claimed < 1.6 * real)
    claimed, real = claimed_and_real(gauge_intensity(std, 1e-3))
    assert np.min(claimed / real) < 0.25


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


@pytest.mark.parametrize(
    ("build", "said"),
    [
        (lambda: IntegratedRandomWalk(0.0), "frequency of an integrated random walk is 0"),
        (lambda: IntegratedRandomWalk(1.0, -1.0), "kappa of an integrated random walk is -1"),
        (lambda: Matern(np.inf), "bandwidth of a Matérn input is inf"),
        (lambda: Oscillator(-3.0), "frequency of an oscillator"),
        (lambda: Oscillator(3.0, 0.0), "damping of an oscillator"),
    ],
)
def test_invalid_values_are_refused(build, said):
    with pytest.raises(ConfigError, match=said):
        build()


def test_positions_of_unknowns_in_the_state():
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
