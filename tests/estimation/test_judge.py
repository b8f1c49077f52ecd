"""Parameters beside an unknown load that is free: Bayes by dense normal densities, and what noise alone says of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import ConfigError
from strainsight.estimation import grid_filter_points
from strainsight.estimation.conditional import _linearise_about, none_considered
from strainsight.estimation.grid_filter import filter_on_grid
from strainsight.estimation.noise_bias import noise_alone
from strainsight.estimation.parallel_filters import LinearModels
from strainsight.estimation.parameter_grid import one_point
from strainsight.estimation.record import GridRecord
from strainsight.loads.input_models import (
    WALK,
    IntegratedRandomWalk,
    Matern,
    Oscillator,
    RandomWalk,
    line_intensity,
)

from .chain import KAPPA, NOISE, REFERENCE, ROWS, STEPS, H, chain, finer, forces, joint, log_normal, start
from .conftest import plain_models
from .truth import draw_truth, plain_motion


def line(steps):
    """Intensity of the free walk, ω²T/2: its frequency is KAPPA [Hz], so that κ of the chain's walk is the default."""
    return (2 * np.pi * KAPPA) ** 2 * steps * H / 2


def densities(p, P, steps, white=(0, 0, 1e-4, 1e-4)):
    """Of all readings at p, one Gaussian each: mean and covariance under the free load, and covariance of that load alone."""
    mean, whole = joint(p, P, steps, (*white, line(steps)))
    loads = np.zeros_like(P)
    loads[4, 4] = P[4, 4]
    return mean, whole, joint(p, loads, steps, (0, 0, 0, 0, line(steps)))[1]


def log_density(y, mean, whole, alone):
    """ln p(y | p) of free loads less what that of these loads alone is on average of readings that are noise alone."""
    noise = -0.5 * NOISE**2 * np.trace(np.linalg.inv(alone))
    return log_normal(y.ravel(), mean, whole) - log_normal(0 * y.ravel(), 0 * mean, alone) - noise


@pytest.fixture(scope="module")
def case():
    model, P = chain(), start()
    _, y = draw_truth(model, np.zeros(7), P, forces(), [5])
    return replace(model, free_loads=True), P, y[:, 0]


def test_parameters_are_weighted_with_free_loads(case):
    """A square of points 0.9 σ apart, each of one dense density of all readings."""
    model, P, y = case
    with finer(0.8, 16.0):
        grid_run = filter_on_grid(GridRecord(model, np.zeros(7), P, forces(), y, none_considered(model)))
    mean, std = grid_run.run.mean[-1, 0, 5:], grid_run.run.std[-1, 0, 5:]
    axis = 0.9 * np.arange(-6, 7)
    point = mean + std * np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    prior = np.diag(P)[5:]
    density = np.array([log_density(y, *densities(p, P, STEPS)) - 0.5 * np.sum(p**2 / prior) for p in point])
    w = np.exp(density - density.max())
    w /= w.sum()
    expected = w @ point
    np.testing.assert_allclose(mean / std, expected / std, atol=1e-4)
    np.testing.assert_allclose(std, np.sqrt(w @ (point - expected) ** 2), rtol=1e-4)
    # the first spring, on which a load of any size may pull, is known by how that was stated to move
    walked = replace(model, free_loads=False)
    stated = filter_on_grid(GridRecord(walked, np.zeros(7), P, forces(), y, none_considered(walked))).run.std[-1, 0, 5:]
    assert std[0] > 5 * stated[0]
    assert std[1] == pytest.approx(stated[1], rel=0.02)


def gauged_with_gains(spread, steps, force):
    """The chain with one unknown stiffness, a free load and gains of both gauges; covariance at t = 0, known load."""
    states = [0, 1, 2, 3, 4, 6]
    whole, P = chain(), start()
    model = replace(
        whole,
        unknowns=replace(whole.unknowns, parameters=("k2",)),
        fixed={"k1": REFERENCE["k1"]},
        H=whole.H[:, states],
        Q=np.diag([0, 0, 0, 0, KAPPA, 0]),
        free_loads=True,
    )
    none = none_considered(model)
    rows = spread * np.eye(2)[:, :, None] * np.pad(ROWS, [(0, 0), (0, 3)])
    gains = replace(none, source=("gain", "gain"), D=rows, E=np.zeros((2, 2, 1)), offset=np.zeros((2, 2)))
    return model, P[np.ix_(states, states)], force * forces(steps), gains


def test_gains_are_integrated_out_with_free_loads():
    """Of both gauges, 5 %, drawn 1.6 and −1.3 of that, beside k₂: Bayes over all three on a grid of dense densities."""
    spread, true, steps, force = 0.05, np.array([0.06, 1.6, -1.3]), STEPS // 2, 30.0
    model, P, held, gains = gauged_with_gains(spread, steps, force)
    truth, _ = draw_truth(model, np.r_[np.zeros(5), true[0]], np.zeros((6, 6)), held, [3])
    y = (1 + spread * true[1:]) * (truth[1:, 0, :2] @ ROWS.T)
    y += NOISE * np.random.default_rng(4).standard_normal((steps, 2))
    grid_run = filter_on_grid(GridRecord(model, np.zeros(6), P, held, y, gains))
    (mean,), cov = grid_run.posterior
    nu, nu_std = grid_run.nu_moments[0], np.sqrt(np.diag(grid_run.nu_moments[1]))
    std, noise = np.sqrt(cov[0, 0]), NOISE**2 * np.eye(2 * steps)
    axis, weight, point = np.linspace(-4, 4, 11), [], []
    for p in mean + std * axis:
        centre, covariance, alone = densities(np.array([0, p]), start(), steps, (0, 0, 0, 0))
        for own_nu in nu + nu_std * np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2):
            g = np.tile(1 + spread * own_nu, steps)
            read = [g[:, None] * (own - noise) * g + noise for own in (covariance, alone)]
            weight.append(log_density(y, g * force * centre, *read) - 0.5 * (p / 0.2) ** 2 - 0.5 * own_nu @ own_nu)
            point.append(p)
    w = np.exp(np.array(weight) - max(weight))
    w /= w.sum()
    expected = w @ np.array(point)
    exact = np.sqrt(w @ (np.array(point) - expected) ** 2)
    assert abs(mean - expected) < 0.1 * exact
    assert std == pytest.approx(exact, rel=0.02)


@pytest.mark.parametrize("p", [0.0, 1.0])
def test_noise_alone_is_no_information_on_gains_at_any_parameter(p):
    steps, seeds = 600, 40
    model, P, held, gains = gauged_with_gains(0.05, steps, 0.0)
    P[-1, -1] = 0.5**2
    pulls = []
    for seed in range(seeds):
        y = NOISE * np.random.default_rng(seed).standard_normal((steps, 2))
        record = GridRecord(model, np.zeros(6), P, held, y, gains)
        problem = grid_filter_points.GridProblem((record,), use_free_loads=True)
        states = grid_filter_points.filter_points(problem, one_point(np.array([p])), steps).states
        pulls.append(np.linalg.solve(states.left[0, 0], states.nu[0, 0]))
    error = np.std(pulls, axis=0) / np.sqrt(seeds)
    assert np.all(np.abs(np.mean(pulls, axis=0)) < 3 * error)


def test_linearisation_matches_bilinear_model():
    """All matrices at random; central differences of a bilinear function are exact."""
    rng, (n, m, p, p1, e, f, d) = np.random.default_rng(8), (5, 3, 6, 2, 5, 2, 7)
    A, G, Q, H, F = (rng.standard_normal((2, *shape)) for shape in ((n, n), (n, p), (n, n), (m, n), (m, p1)))
    A_nu, G_nu = rng.standard_normal((2, e, n, n)), rng.standard_normal((2, e, n, p))
    D, E, offset, B = (rng.standard_normal((d, m, *more)) for more in ((n,), (p1,), (), (f,)))
    U, W, about, damping = rng.standard_normal((f, n)), rng.standard_normal((f, p1)), rng.standard_normal(d), 2
    offset[:-1] = about[-1] = 0.0
    given = A, G, A_nu, G_nu
    models = LinearModels(plain_motion(*given), Q, H, F, D, E, offset, B, U, W, about, np.zeros((2, d)), about != 0)
    x, w, end = rng.standard_normal(n), rng.standard_normal(p), rng.standard_normal(p1)

    def step(nu):
        return (A @ x + G @ w) + sum(nu[k] * (A_nu[:, k] @ x + G_nu[:, k] @ w) for k in range(e))

    def reading(nu):
        found = H @ x + F @ end
        for k in range(d):
            found = found + nu[k] * (D[k] @ x + E[k] @ end + offset[k])
            for j in range(f):
                found = found + nu[k] * nu[e - f + j] * B[k, :, j] * (U[j] @ x + W[j] @ end)
        return found

    a = np.where(np.arange(d) < damping, 0.0, about)
    at = _linearise_about(models, damping)
    np.testing.assert_allclose(at.A @ x + at.G @ w, step(a), atol=1e-12)
    np.testing.assert_allclose(at.H @ x + at.F @ end, reading(a), atol=1e-12)
    for k, one in enumerate(np.eye(d)):
        slope = (reading(a + one) - reading(a - one))[0] / 2
        np.testing.assert_allclose(at.D[k] @ x + at.E[k] @ end + at.offset[k], slope, atol=1e-12)
    for k, one in enumerate(np.eye(d)[:e]):
        np.testing.assert_allclose(
            at.A_nu[:, k] @ x + at.G_nu[:, k] @ w, (step(a + one) - step(a - one)) / 2, atol=1e-12
        )


LOADS = [
    RandomWalk(),
    *(IntegratedRandomWalk(3.0, kappa) for kappa in (0.02, WALK, 3.0)),
    Matern(3.0, 1.5),
    Oscillator(3.0, 0.05),
]


def test_free_load_is_independent_of_configured_intensity():
    model, at = chain(), 4
    for factor in (1e-3, 1.0, 30.0):
        Q = replace(model, Q=model.Q * factor).with_free_loads(STEPS).Q
        assert Q[at, at] == pytest.approx(line(STEPS), rel=1e-12)
        np.testing.assert_array_equal(np.delete(np.diag(Q), at), factor * np.delete(np.diag(model.Q), at))
    sets = model.Q * np.array([1.0, 1e6])[:, None, None]
    np.testing.assert_allclose(replace(model, Q=sets).with_free_loads(STEPS).Q[:, at, at], [line(STEPS), 1e6 * KAPPA])
    with pytest.raises(ConfigError, match="frequency of unknown is None"):
        replace(model, unknowns=replace(model.unknowns, frequency={})).with_free_loads(STEPS)


@pytest.mark.parametrize("model", LOADS, ids=str)
def test_free_load_noise_matches_energy_of_tone(model):
    """Of a sine of amplitude 1 and 3 Hz, 40 periods of it: its noise by derivatives of the sine, and ∫w²dt; whatever κ."""
    duration, omega = 40 / 3.0, 2 * np.pi * 3.0
    t = np.linspace(0, duration, 40 * 400, endpoint=False)
    zero, one, two = np.sin(omega * t), omega * np.cos(omega * t), -(omega**2) * np.sin(omega * t)
    lam = omega / np.sqrt(np.sqrt(2) - 1)
    noise = {
        "RandomWalk": one,
        "IntegratedRandomWalk": two / omega,
        # (d/dt + λ)² u = λ w
        "Matern": two / lam + 2 * one + lam * zero,
        "Oscillator": two / omega + 0.1 * one + omega * zero,
    }[type(model).__name__]
    assert line_intensity(model, 3.0, duration) == pytest.approx(np.mean(noise**2) * duration, rel=1e-6)


def test_noise_bias_matches_unit_readings():
    """Σ εᵀS⁻¹e is a quadratic form of the readings: its mean is the sum over readings of one σ in one sample and channel."""
    rng, (n, m, d, e, steps) = np.random.default_rng(3), (4, 2, 4, 2, 30)
    A = rng.standard_normal((n, n))
    A /= 1.05 * np.abs(np.linalg.eigvals(A)).max()
    C, P0, rows = rng.standard_normal((n, n)), 3 * np.eye(n), rng.standard_normal((m, n))
    A_nu, D = 0.3 * rng.standard_normal((e, n, n)), rng.standard_normal((d, m, n))
    R = rng.uniform(0.5, 2.0, (steps, m))
    R[4, 0] = R[7] = R[20:22, 1] = np.inf

    def form(y):
        x, V, P, total = np.zeros(n), np.zeros((d, n)), P0, np.zeros(d)
        for t in range(steps):
            there = np.isfinite(R[t])
            h = rows[there]
            V = V @ A.T
            V[:e] -= A_nu @ x
            x, P = A @ x, A @ P @ A.T + C @ C.T
            K = P @ h.T @ np.linalg.inv(S := h @ P @ h.T + np.diag(R[t, there]))
            slope, off = D[:, there] @ x - V @ h.T, y[t, there] - h @ x
            total = total + slope @ np.linalg.solve(S, off)
            x, V, P = x + K @ off, V + slope @ K.T, P - K @ h @ P
        return total

    expected = np.zeros(d)
    for t, c in np.argwhere(np.isfinite(R)):
        y = np.zeros((steps, m))
        y[t, c] = np.sqrt(R[t, c])
        expected += form(y)
    models = plain_models(A, C @ C.T, rows, D, A_nu)
    bias = noise_alone(models, P0, R)
    np.testing.assert_allclose(bias.row[bias.step].sum(axis=0), expected, rtol=1e-10)


def test_steady_noise_steps_are_reused():
    model = replace(chain(), free_loads=True)
    first = replace(model, every=2), np.zeros(7), start()
    record = GridRecord(*first, forces(800), np.zeros((400, 2)), damping(model))
    bias = record.noise_bias[0]
    assert len(bias.row) < 200
    pairs = bias.row[bias.step].reshape(400, 2, -1).sum(axis=1)
    np.testing.assert_allclose(pairs[200:300], np.tile(pairs[250], (100, 1)), rtol=1e-6)


def damping(model, spread=0.5):
    return replace(none_considered(model), damping=spread)


def test_noise_does_not_bias_damping():
    whole, kept, steps = chain(), [0, 1, 2, 3, 4, 6], 150
    unknowns = replace(whole.unknowns, parameters=("k2",))
    Q, P = whole.Q[np.ix_(kept, kept)], start()[np.ix_(kept, kept)]
    model = replace(whole, unknowns=unknowns, fixed={"k1": REFERENCE["k1"]}, H=whole.H[:, kept], Q=Q, free_loads=True)
    truth, _ = draw_truth(replace(model, Q=0 * Q), np.zeros(6), np.zeros((6, 6)), forces(steps), [1])
    means = []
    for seed in range(2):
        y = truth[1:, 0] @ model.H.T + NOISE * np.random.default_rng(seed).standard_normal((steps, 2))
        grid_run = filter_on_grid(GridRecord(model, np.zeros(6), P, forces(steps), y, damping(model)))
        means.append(grid_run.nu_moments[0])
    left = np.sqrt(np.diag(grid_run.nu_moments[1]))
    assert np.all(np.abs(np.mean(means, axis=0)) < 1.4 * left / np.sqrt(2))
