"""Covariances of the start and of disturbances; the linear system at an equilibrium."""

import numpy as np
import pytest

from strainsight.errors import InfeasibleError
from strainsight.multibody.initial import constraints_at
from strainsight.multibody.inverse.linear import linearised
from strainsight.multibody.inverse.start import start_covariance, white_force
from strainsight.multibody.static import static_equilibrium

from .benches import bench

FREE = ["E", "b.ball_diameter"]


def test_start_covariance_is_that_of_equilibria_under_other_loads_and_parameters():
    b = bench(["ball_diameter"], modulus=True)
    model = b.model(0.1, 1, free=FREE, load=1.0)
    u0 = np.array([1e4, -2e4, 3e4])
    q, _ = static_equilibrium(b.system, b.q, u0, b.theta)
    std_u, std_xi = np.array([1e3, 2e3, 5e3]), np.array([0.1, 0.2])
    P = start_covariance(b.system, q, u0, b.theta, model.coordinates, model.inputs, std_u, std_xi)
    xi, columns = model.coordinates.xi(b.theta), []

    def settled(z):
        return static_equilibrium(b.system, q, u0 + z[:3], model.coordinates.theta(xi + z[3:])[0])[0]

    for j, size in enumerate([10.0, 10.0, 10.0, 1e-4, 1e-4]):
        d = np.zeros(5)
        d[j] = size
        response = (8 * (settled(d) - settled(-d)) - settled(2 * d) + settled(-2 * d)) / (12 * size)
        columns.append(np.concatenate([response, np.zeros(b.system.size), np.eye(5)[j]]))
    J = np.stack(columns, axis=1)
    expected = J @ np.diag(np.concatenate([std_u, std_xi]) ** 2) @ J.T
    scale = np.sqrt(np.diag(expected))
    scale = np.where(scale > 1e-9 * np.abs(J).max(), scale, np.inf)
    np.testing.assert_allclose(P / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-5)
    assert np.linalg.matrix_rank(P / np.outer(scale, scale), tol=1e-9) == 5


def test_further_motions_are_those_that_the_constraints_leave():
    b = bench()
    model = b.model(0.1, 1, load=1.0)
    n, none = b.system.size, np.zeros(3)
    P = start_covariance(b.system, b.q, none, b.theta, model.coordinates, model.inputs, none, [], (2.0, 3.0))
    _, B = constraints_at(b.system, b.q)
    d, m = b.system.metric, len(B)
    for own, spread in ((model.q, 2.0), (model.v, 3.0)):
        scaled = d[:, None] * P[own, own] * d
        assert np.abs(B / d @ scaled).max() < 1e-12 * np.abs(B / d).max()
        values = np.linalg.eigvalsh(scaled)
        np.testing.assert_allclose(values, [0.0] * m + [spread**2] * (n - m), atol=1e-12)
    assert not P[2 * n :].any()
    with pytest.raises(InfeasibleError, match="2 deviations for 3 inputs"):
        start_covariance(b.system, b.q, none, b.theta, model.coordinates, model.inputs, [1.0, 1.0], [])


def test_correlated_parameters_may_be_given_as_a_covariance():
    b = bench(["ball_diameter", "radius_inner_left"])
    free = ["b.ball_diameter", "b.radius_inner_left"]
    model = b.model(0.1, 1, free=free, known=np.zeros((1, 3)))
    known = model.coordinates.covariance(b.theta, 1e-4 * b.theta)
    P = start_covariance(b.system, b.q, np.zeros(3), b.theta, model.coordinates, model.inputs, [], known)
    np.testing.assert_allclose(model.spread(P)[model.xi, model.xi], known, rtol=1e-12)


def test_white_force_is_mass_times_acceleration():
    b = bench()
    blade = b.system.of["blade"]
    std = np.sqrt(white_force(b.system, 0.3))
    np.testing.assert_allclose(std[blade][:3], 1.4e4 * 0.3)
    # a third of the trace of ∫ρxxᵀ, half the trace of the inertia
    radius = np.sqrt((1.5e4 + 2 * (2.8e6 + 1.4e4 * 17**2)) / 2 / 3 / 1.4e4)
    np.testing.assert_allclose(std[blade][3:], 1.4e4 * 0.3 * radius)
    np.testing.assert_allclose(std[b.system.of["hub"]], 0.3 * np.sqrt(9e3 * np.diag(b.system.mass)[:9]))


def test_linear_system_of_the_whole_bench_gives_the_static_response():
    b = bench()
    T, M, _, K, B_u = linearised(b.system, b.q, np.zeros(3), b.theta)
    _, B = constraints_at(b.system, b.q)
    assert np.abs(B @ T).max() < 1e-12 * np.abs(B).max() * np.abs(T).max()
    du = np.array([20.0, -10.0, 30.0])
    plus, minus = (static_equilibrium(b.system, b.q, s * du, b.theta)[0] for s in (1, -1))
    moved = 0.5 * (plus - minus)
    np.testing.assert_allclose(T @ np.linalg.solve(K, B_u @ du), moved, atol=1e-6 * np.abs(moved).max())
    assert np.linalg.eigvalsh(M).min() > 0


def test_matrices_are_those_of_the_hub_where_the_blade_is_still():
    b = bench()
    T, M, C, _, _ = linearised(b.system, b.q, np.zeros(3), b.theta)
    blade = T[b.system.of["blade"]]
    rank = np.linalg.matrix_rank(blade, tol=1e-9 * np.abs(T).max())
    still = np.linalg.svd(blade)[2][rank:].T
    X = T[b.system.of["hub"]] @ still
    hub = b.system.bodies[0]
    assert X.shape[1] > 0
    np.testing.assert_allclose(still.T @ M @ still, X.T @ hub.mass @ X, atol=1e-9)
    np.testing.assert_allclose(still.T @ C @ still, X.T @ hub.damping @ X, atol=1e-9 * np.abs(C).max())
