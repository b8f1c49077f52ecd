"""The filter of a bench with the thesis's noise and update is its algorithm 1, and what these two cost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.estimation.filter import filter_runs
from strainsight.multibody.advance import advance
from strainsight.multibody.initial import constraints_at

from .benches import bench, loads

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


def test_with_both_it_is_algorithm_1_as_printed(case):
    b, model, x, P, y = case
    own = np.concatenate([np.arange(2 * b.system.size), model.position])
    mean, std = algorithm_1(b, model, x[own], P[np.ix_(own, own)], y)
    run = filter_runs(model, x, P, y, form="square_root")
    unknown = model.position
    np.testing.assert_allclose(run.std[1:, 0][:, unknown], std, rtol=1e-5)
    off = np.abs(run.mean[1:, 0][:, own] - mean)
    assert np.all(off[:, -4:] < 1e-3 * std)
    assert np.all(off[:, : b.system.size] * b.system.metric < 1e-7)


def test_sigma_of_a_load_is_then_at_least_its_increment_whatever_is_measured(case):
    """Before the step, the readings at its end have seen the change: of a noise of 1e-8 it leaves less than a fifth of that."""
    b, printed, _, _, y = case
    printed, last = replace(printed, R=np.full(9, 1e-8**2), Q_w=0 * printed.Q_w), []
    for model in (printed, replace(printed, printed=False)):
        x, P = b.start(model, std_u=1e4, std_xi=1e-3, spread=1e-3, theta=1.001 * b.theta)
        last.append(filter_runs(model, x, P, y, form="square_root").std[-1, 0][model.u])
    assert np.all(last[0] > 0.999 * INCREMENT)
    assert np.all(last[1] < INCREMENT / 5)


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
