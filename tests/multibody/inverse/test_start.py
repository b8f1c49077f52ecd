"""The start of the filter, zeroed gauges, and the noise as printed in the thesis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import InfeasibleError
from strainsight.estimation.filter import filter_runs
from strainsight.multibody.bodies import Frame, RigidBody
from strainsight.multibody.forces import Load, RelativeElement
from strainsight.multibody.initial import constraints_at, static_equilibrium
from strainsight.multibody.inverse.linear import linearise
from strainsight.multibody.inverse.parameters import (
    follow_equilibrium,
    parameter_coordinates,
    rest_at,
    start_covariance,
    white_force,
    zero_at_rest,
)
from strainsight.multibody.joints import prismatic
from strainsight.multibody.laws import bushing
from strainsight.multibody.relations import offset
from strainsight.multibody.step import advance
from strainsight.multibody.system import assemble

from .benches import bench, loads

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
    _, B, _ = constraints_at(b.system, b.q)
    d, m = b.system.metric, len(B)
    for own, spread in ((model.q, 2.0), (model.v, 3.0)):
        scaled = d[:, None] * P[own, own] * d
        assert np.abs(B / d @ scaled).max() < 1e-12 * np.abs(B / d).max()
        values = np.linalg.eigvalsh(scaled)
        np.testing.assert_allclose(values, [0.0] * m + [spread**2] * (n - m), atol=1e-12)
    assert not P[2 * n :].any()
    with pytest.raises(InfeasibleError, match="2 initial standard deviations for 3 unknown loads"):
        start_covariance(b.system, b.q, none, b.theta, model.coordinates, model.inputs, [1.0, 1.0], [])


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
    T, M, _, K, B_u = linearise(b.system, b.q, np.zeros(3), b.theta)
    _, B, _ = constraints_at(b.system, b.q)
    assert np.abs(B @ T).max() < 1e-12 * np.abs(B).max() * np.abs(T).max()
    du = np.array([20.0, -10.0, 30.0])
    plus, minus = (static_equilibrium(b.system, b.q, s * du, b.theta)[0] for s in (1, -1))
    moved = 0.5 * (plus - minus)
    np.testing.assert_allclose(T @ np.linalg.solve(K, B_u @ du), moved, atol=1e-6 * np.abs(moved).max())
    assert np.linalg.eigvalsh(M).min() > 0


LOADS = np.array([2e4, -1e4, 1.5e4])
ALL = np.ones(9, dtype=bool)


@pytest.fixture(scope="module")
def loaded():
    """A bench with a free modulus and ball diameter, and its zero under loads."""
    b = bench(free=("ball_diameter",), modulus=True)
    coordinates = parameter_coordinates(b.system.parameters, ("E", "b.ball_diameter"), b.theta, {"b": b.bearing.parameters})
    q = static_equilibrium(b.system, b.q, LOADS, b.theta)[0]
    return b, coordinates, q


def sought(loaded, xi):
    """From the unloaded state, by no answer of before."""
    b, coordinates, _ = loaded
    q = static_equilibrium(b.system, b.q, LOADS, coordinates.theta(xi)[0])[0]
    return b.sensors.read(q, np.zeros_like(q))[0]


def test_followed_answers_are_those_sought_from_the_start(loaded):
    b, coordinates, q = loaded
    zero = zero_at_rest(b.system, b.sensors, ALL, q, LOADS, coordinates)
    first, rng = coordinates.xi(b.theta), np.random.default_rng(3)
    for size in (1e-6, 1e-3, 0.3):
        for _ in range(4):
            xi = first + size * np.array([1.0, 1e-3]) * rng.normal(size=2)
            expected = sought(loaded, xi)
            np.testing.assert_allclose(zero(xi)[0], expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_its_slopes_are_those_of_differences(loaded):
    b, coordinates, q = loaded
    zero = zero_at_rest(b.system, b.sensors, ALL, q, LOADS, coordinates)
    xi = coordinates.xi(b.theta) + np.array([0.05, 1e-4])
    zero(coordinates.xi(b.theta))
    slopes = zero(xi)[1]
    for j, step in enumerate((1e-4, 1e-6)):
        ends = [sought(loaded, xi + sign * step * np.eye(2)[j]) for sign in (1, -1)]
        by_hand = (ends[0] - ends[1]) / (2 * step)
        np.testing.assert_allclose(slopes[:, j], by_hand, rtol=0, atol=1e-4 * np.abs(by_hand).max())


def test_untracked_equilibrium_is_searched(loaded, monkeypatch):
    """A modulus fifty times as large, and Newton's iteration that is given one step."""
    b, coordinates, q = loaded
    zero = zero_at_rest(b.system, b.sensors, ALL, q, LOADS, coordinates)
    xi = coordinates.xi(b.theta)
    zero(xi)
    far = xi + np.array([np.log(50.0), 0.0])
    monkeypatch.setattr("strainsight.multibody.inverse.parameters.STEPS", 1)
    expected = sought(loaded, far)
    np.testing.assert_allclose(zero(far)[0], expected, rtol=0, atol=1e-9 * np.abs(expected).max())


class Unknown:
    """F = θρ."""

    def load(self, rho, rho_dot, theta):
        return Load(theta[0] * rho, theta[0] * np.eye(1), None, rho[:, None])


def test_a_motion_that_becomes_free_on_the_way_is_refused_as_from_the_start():
    stones = [RigidBody(name, 2.0, np.zeros(3), np.eye(3)) for name in ("held", "loose")]
    rails = [prismatic(own.name, Frame("rail"), Frame("centre", own.name)) for own in stones]
    known = bushing("known", Frame("wall"), Frame("end", "held"), [0, 0, 100.0, 0, 0, 0], [0.0] * 6)
    unknown = RelativeElement("unknown", (offset(Frame("wall"), 2, Frame("end", "loose")),), Unknown(), ("k",))
    system = assemble(stones, rails, [known, unknown])
    q = np.tile(np.concatenate([np.zeros(3), np.eye(3).ravel()]), 2)
    rest = rest_at(system, q, np.zeros(0), np.array([50.0]))
    assert follow_equilibrium(system, rest, np.zeros(0), np.array([1.0])).theta == 1.0
    for seek, start in ((rest_at, q), (follow_equilibrium, rest)):
        with pytest.raises(InfeasibleError, match="no stiffness restrains body loose"):
            seek(system, start, np.zeros(0), np.array([1e-11]))


ACCELERATION, INCREMENT, DRIFT, H, STEPS = 1e-3, 2e3, 1e-4, 0.05, 4


@pytest.fixture(scope="module")
def case():
    """Three loads and the ball's diameter unknown, by implicit Euler: model, start, covariance, readings with noise."""
    b = bench(["ball_diameter"])
    u = loads(H, STEPS, 0.3)
    _, y = b.truth(u, H, method="thesis")
    y = y + 1e-6 * np.random.default_rng(2).standard_normal(y.shape)
    model = b.model(
        H, STEPS, free=["b.ball_diameter"], theta=1.001 * b.theta, noise=(1e-6, 1e-6), load=INCREMENT, white=ACCELERATION,
        method="thesis", rest=False,
    )  # fmt: skip
    model = replace(model, Q_xi=np.array([DRIFT**2]), printed=True)
    x, P = b.start(model, std_u=1e4, std_xi=1e-3, spread=1e-3, theta=1.001 * b.theta)
    return b, model, x, P, y


def slopes(f, x, size):
    """∂f/∂x by central differences, a step each of the size of what x is known to."""
    columns = []
    for j, step in enumerate(size):
        moved = np.zeros_like(x)
        moved[j] = step
        columns.append((f(x + moved) - f(x - moved)) / (2 * step))
    return np.stack(columns, axis=1)


def algorithm_1(b, model, x, P, y):
    """(1.53) to (1.60) to the letter, x* = (q, v, u, p) and p = ln D: mean and σ after every step."""
    system, n = b.system, b.system.size
    name = system.parameters.index("b.ball_diameter")
    size = np.concatenate([1e-6 / system.metric, 1e-5 / system.metric, np.full(3, 10.0), [1e-6]])

    def f_d(z):
        theta = model.coordinates.theta(z[-1:])[0]
        assert theta[name] > 0
        u = z[2 * n : 2 * n + 3]
        new = advance(system, z[:n], z[n : 2 * n], (u, u), H, theta, "thesis")
        return np.concatenate([new.q, new.v, z[2 * n :]])

    def h_d(z):
        return b.sensors.read(z[:n], z[n : 2 * n])[0]

    # a white acceleration of every body, in a step of every coordinate alone
    Q = np.zeros(2 * n)
    for body in system.bodies:
        mass = {"hub": 9e3, "blade": 1.4e4}[body.name]
        own = system.of[body.name]
        Q[n:][own] = H**2 * ACCELERATION**2 * mass / system.metric[own] ** 2
    Q_star = np.diag(np.concatenate([Q, np.full(3, INCREMENT**2), [DRIFT**2]]))
    R, found = np.diag(np.full(9, 1e-6**2)), []
    for k in range(STEPS):
        A = slopes(f_d, x, size)
        x = f_d(x)
        P = A @ P @ A.T + Q_star
        C = slopes(h_d, x, size)
        K = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
        x = x + K @ (y[k] - h_d(x))
        P = (np.eye(len(x)) - K @ C) @ P
        found.append((x, np.sqrt(np.diag(P)[2 * n :])))
    return np.array([mean for mean, _ in found]), np.array([std for _, std in found])


def test_step_matches_printed_algorithm(case):
    b, model, x, P, y = case
    own = np.concatenate([np.arange(2 * b.system.size), model.position])
    mean, std = algorithm_1(b, model, x[own], P[np.ix_(own, own)], y)
    run = filter_runs(model, x, P, y, form="square_root")
    unknown = model.position
    np.testing.assert_allclose(run.std[1:, 0][:, unknown], std, rtol=1e-5)
    off = np.abs(run.mean[1:, 0][:, own] - mean)
    assert np.all(off[:, -4:] < 1e-3 * std)
    assert np.all(off[:, : b.system.size] * b.system.metric < 1e-7)


def test_its_update_leaves_the_constraints_and_being_put_back_does_not(case):
    b, model, x, P, y = case
    free = filter_runs(model, x, P, y, form="square_root")
    held = filter_runs(model, x, P, y, form="square_root", project=model.projected)

    def worst(run):
        return max(np.abs(constraints_at(b.system, state[model.q])[0]).max() for state in run.mean[1:, 0])

    assert worst(held) < 1e-13
    assert worst(free) > 1e4 * worst(held)
    # the next step begins there and ends on them
    ahead = model.step(free.mean[-1], STEPS - 1)[0][0]
    assert np.abs(constraints_at(b.system, ahead[model.q])[0]).max() < 1e-12
