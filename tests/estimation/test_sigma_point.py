"""The sigma-point filter against brute force by dense quadrature, the Kalman filter, the textbook smoother and the grid
filter."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from strainsight.errors import NumericalError
from strainsight.estimation.filter import run_filter
from strainsight.estimation.reduced import DrivenModel, driven_with_offsets
from strainsight.estimation.sigma_point import points_of, regression
from strainsight.estimation.smoother import smooth

from .chain import REFERENCE, ROWS, H, chain, continuous, forces, gathered, start, step_at
from .conftest import drawn, make_beam, make_filter, sine
from .truth import draw_truth


@pytest.mark.parametrize("k", [0, 1, 2, 3])
def test_points_have_the_moments_of_normal_numbers_up_to_degree_five_each(k):
    z, weight = points_of(k)
    assert weight.min(initial=1.0) > 0
    odd = {0: 1.0, 1: 0.0, 2: 1.0, 3: 0.0, 4: 3.0, 5: 0.0}
    for degree in product(range(6), repeat=k):
        found = weight @ np.prod(z ** np.array(degree, dtype=int).reshape(1, k), axis=1)
        assert found == pytest.approx(np.prod([odd[d] for d in degree]), abs=1e-13)


def cubic(x):
    """f(s, p), linear in s, of degree two in p and two products with it; with ∂f/∂s."""
    s, p = x[:, :2], x[:, 2:]
    f = np.stack([s[:, 0] * p[:, 0] + p[:, 1] ** 2, s[:, 1] * (1 + p[:, 0] * p[:, 1]) - s[:, 0] * p[:, 1]], axis=1)
    J = np.full((len(x), 2, 4), np.nan)
    J[:, 0, 0], J[:, 0, 1] = p[:, 0], 0.0
    J[:, 1, 0], J[:, 1, 1] = -p[:, 1], 1 + p[:, 0] * p[:, 1]
    return f, J


def test_a_regression_has_the_exact_moments_of_a_polynomial():
    """Mean, covariance and cross covariance of f by eight Gauss-Hermite points in each of four directions."""
    rng = np.random.default_rng(3)
    x, F = rng.standard_normal((2, 4)), rng.standard_normal((2, 4, 4))
    P = F @ np.swapaxes(F, 1, 2)
    found = regression(cubic, x, P, slice(2, 4), points_of(2))
    node, weight = np.polynomial.hermite_e.hermegauss(8)
    z = np.array(list(product(node, repeat=4)))
    w = np.array([np.prod(own) for own in product(weight / weight.sum(), repeat=4)])
    for b in range(2):
        at = x[b] + z @ np.linalg.cholesky(P[b]).T
        f = cubic(at)[0]
        mean = w @ f
        cross, cov = (f - mean).T @ (w[:, None] * (at - x[b])), (f - mean).T @ (w[:, None] * (f - mean))
        own = found.slope[b] @ P[b] @ found.slope[b].T + found.rest[b]
        scale = np.sqrt(np.outer(np.diag(cov), np.diag(P[b])))
        np.testing.assert_allclose(found.mean[b], mean, rtol=1e-11)
        np.testing.assert_allclose(found.slope[b] @ P[b], cross, atol=1e-11 * scale.max())
        # of its variance the parts of degree five and six in p need more than three points
        np.testing.assert_allclose(own[0, 0], cov[0, 0], rtol=1e-11)
        assert np.linalg.eigvalsh(found.rest[b])[0] > 0


def dense(mean, P, known, count=8):
    """Mean and covariance of [s⁺, p] after a step without noise: Gauss-Hermite in p, s given p in closed form."""
    node, weight = np.polynomial.hermite_e.hermegauss(count)
    z, w = np.array(list(product(node, repeat=2))), np.array([np.prod(own) for own in product(weight, repeat=2)])
    w = w / w.sum()
    p = mean[5:] + z @ np.linalg.cholesky(P[5:, 5:]).T
    gain = P[:5, 5:] @ np.linalg.inv(P[5:, 5:])
    left = P[:5, :5] - gain @ P[5:, :5]
    ahead, spread = np.zeros((len(p), 7)), np.zeros((7, 7))
    for i, own in enumerate(p):
        A, drive = step_at(own)
        ahead[i] = np.concatenate([A @ (mean[:5] + gain @ (own - mean[5:])) + drive * known, own])
        spread[:5, :5] += w[i] * A @ left @ A.T
    middle = w @ ahead
    return middle, spread + (ahead - middle).T @ (w[:, None] * (ahead - middle))


def test_filter_step_matches_brute_force():
    """Forty steps of two parameters with a prior of 30 and 20 %: step by dense quadrature and expm, update by the textbook."""
    model, P = chain(), start()
    u = forces()
    _, y = draw_truth(model, np.zeros(7), P, u, [5])
    run = run_filter(model, np.zeros(7), P, u, y[:, 0], keep="all", by_points=True)
    noise = np.zeros((7, 7))
    noise[:5, :5] = gathered(continuous(REFERENCE)[0], np.diag([0, 0, 1e-4, 1e-4, 30.0]))
    rows, R = np.hstack([ROWS, np.zeros((2, 5))]), np.diag(model.r / H)
    x = np.zeros(7)
    for k in range(len(u)):
        x, P = dense(x, P, u[k, 0, 0])
        P = P + noise
        K = P @ rows.T @ np.linalg.inv(rows @ P @ rows.T + R)
        x = x + K @ (y[k, 0] - rows @ x)
        P = P - K @ (rows @ P @ rows.T + R) @ K.T
        std = np.sqrt(np.diag(P))
        np.testing.assert_allclose(run.mean[k + 1, 0] / std, x / std, atol=2e-3)
        np.testing.assert_allclose(run.covariance[k + 1, 0] / np.outer(std, std), P / np.outer(std, std), atol=2e-3)


def test_accelerometer_update_matches_brute_force():
    """Moments of its reading by dense quadrature over E and ρ, its rows at unit vectors, the update by the textbook."""
    beam = make_beam(modes=2, graded=True, load_nodes=(16, 8))
    model = make_filter(
        beam, ("tip",), ("E", "rho"), known=("middle",), accelerometers=2, gauges=(0.05,), q_velocity=1.0, q_parameter=0.0,
        h=1e-3, acceleration_noise=0.05,
    )  # fmt: skip
    P = np.diag([1e-6, 1e-7, 1e-2, 1e-2, 1.0, 0.04**2, 0.025**2])
    P[4, 5] = P[5, 4] = 0.5 * 0.04
    u = sine(1e-3 * np.arange(1), 1e-3, 1e4, 13.0)
    nothing = np.full((1, 3), np.nan)
    ahead = run_filter(model, np.zeros(7), P, u, nothing, keep="all", by_points=True)
    x, P1 = ahead.mean[1, 0], ahead.covariance[1, 0]
    node, weight = np.polynomial.hermite_e.hermegauss(20)
    z, w = np.array(list(product(node, repeat=2))), np.array([np.prod(own) for own in product(weight, repeat=2)])
    w = w / w.sum()
    gain, off = P1[:5, 5:] @ np.linalg.inv(P1[5:, 5:]), z @ np.linalg.cholesky(P1[5:, 5:]).T
    left = P1[:5, :5] - gain @ P1[5:, :5]
    core = DrivenModel(model, u)
    read, spread, cross = np.zeros((len(w), 3)), np.zeros((3, 3)), np.zeros((7, 3))
    for i, own in enumerate(off):
        at = x + np.concatenate([gain @ own, own])
        probes = at + np.vstack([np.zeros(7), np.eye(5, 7)])
        y = core.measure(probes, 0)[0]
        rows, read[i] = (y[1:] - y[0]).T, y[0]
        spread += w[i] * rows @ left @ rows.T
        cross[:5] += w[i] * left @ rows.T
    expected = w @ read
    cross += np.hstack([off @ gain.T, off]).T @ (w[:, None] * (read - expected))
    S = spread + (read - expected).T @ (w[:, None] * (read - expected)) + np.diag(model.noise)
    sample = expected + np.linalg.cholesky(S) @ np.array([0.7, -1.0, 0.4])
    K = cross @ np.linalg.inv(S)
    mean, after = x + K @ (sample - expected), P1 - K @ S @ K.T
    std = np.sqrt(np.diag(after))
    for form in ("joseph", "square_root"):
        run = run_filter(model, np.zeros(7), P, u, sample[None], keep="all", form=form, by_points=True)
        np.testing.assert_allclose(run.mean[1, 0] / std, mean / std, atol=1e-3)
        np.testing.assert_allclose(run.covariance[1, 0] / np.outer(std, std), after / np.outer(std, std), atol=1e-3)
        np.testing.assert_allclose(run.whitened[0, 0], [0.7, -1.0, 0.4], atol=1e-3)


@pytest.mark.parametrize(("form", "accelerometers"), [("joseph", 0), ("square_root", 1)])
def test_known_parameters_give_kalman_filter(form, accelerometers):
    beam = make_beam(modes=3, graded=True, load_nodes=(16, 8))
    options = {"known": ("middle",), "q_velocity": 1e-2, "h": 1e-3, "accelerometers": accelerometers}
    options |= {"gauges": (0.05, 0.9), "q_parameter": 0.0}
    with_parameters = make_filter(beam, ("tip",), ("E", "rho"), **options)
    without = make_filter(beam, ("tip",), (), **options)
    n = without.size
    P = np.diag(np.concatenate([np.full(3, 1e-10), np.full(3, 1e-4), [1.0]]))
    u = sine(1e-3 * np.arange(150), 1e-3, 1e4, 13.0)
    _, y = draw_truth(without, np.zeros(n), P, u, [0, 1])
    y[20:23], y[40, 0, 1] = np.nan, np.nan
    wide = np.zeros((n + 2, n + 2))
    wide[:n, :n] = P
    found = run_filter(with_parameters, np.zeros(n + 2), wide, u, y, keep="all", form=form, by_points=True)
    known = run_filter(without, np.zeros(n), np.stack([P, P]), u, y, keep="all")
    std = known.std[1:].max(axis=(0, 1))
    np.testing.assert_allclose(found.mean[:, :, :n] / std, known.mean / std, atol=1e-9)
    np.testing.assert_allclose(
        found.covariance[..., :n, :n] / np.outer(std, std), known.covariance / np.outer(std, std), atol=1e-9
    )
    np.testing.assert_allclose(found.log_likelihood, known.log_likelihood, rtol=1e-9)
    np.testing.assert_allclose(found.whitened, known.whitened, atol=1e-8)
    later, plain = smooth(with_parameters, found), smooth(without, known)
    np.testing.assert_allclose(later.mean[:, :, :n] / std, plain.mean / std, atol=1e-9)
    np.testing.assert_allclose(later.std[:, :, :n] / std, plain.std / std, atol=1e-7)


def test_channels_of_each_run_are_its_own():
    beam = make_beam(modes=3, graded=True, load_nodes=(16, 8))
    model = make_filter(
        beam, ("tip",), ("E", "rho"), known=("middle",), accelerometers=1, gauges=(0.05, 0.3), q_velocity=1e-2, h=1e-3
    )
    u = sine(1e-3 * np.arange(30), 1e-3, 1e4, 13.0)
    P = np.diag(np.concatenate([np.full(3, 1e-10), np.full(3, 1e-4), [1.0, 0.01, 0.01]]))
    _, y = draw_truth(model, np.zeros(9), P, u, [1, 2])
    order = [[0, 1, 2], [2, 0, 1]]
    H_, quantity, r = (np.stack([own[one] for one in order]) for own in (model.H, model.quantity, model.r))
    y = np.stack([y[:, b, one] for b, one in enumerate(order)], axis=1)
    y[10:14, 1, 0] = np.nan
    both = run_filter(replace(model, H=H_, quantity=quantity, r=r), np.zeros(9), P, u, y, keep="all", by_points=True)
    for b in range(2):
        alone = replace(model, H=H_[b], quantity=quantity[b], r=r[b])
        one = run_filter(alone, np.zeros(9), P, u, y[:, b], keep="all", by_points=True)
        std = one.std[1:].max(axis=(0, 1))
        np.testing.assert_allclose(both.mean[:, b] / std, one.mean[:, 0] / std, atol=1e-8)
        np.testing.assert_allclose(both.std[:, b] / std, one.std[:, 0] / std, atol=1e-8)


def test_smoother_matches_rts():
    """By its regressions, whose cross covariance of two instants is P Aᵀ; accelerometers and an offset among the channels."""
    beam = make_beam(modes=2, graded=True, load_nodes=(16, 8))
    model = make_filter(
        beam, ("tip",), ("E",), known=("middle",), accelerometers=1, gauges=(0.05, 0.9), q_velocity=1.0,
        q_parameter=1e-3, h=1e-3,
    )  # fmt: skip
    u = sine(1e-3 * np.arange(80), 1e-3, 1e4, 13.0)
    P = np.diag(np.concatenate([np.full(2, 1e-8), np.full(2, 1e-2), [1.0, 0.01]]))
    _, y = draw_truth(model, np.zeros(6), P, u, [4])
    y[30:33, 0, 0] = np.nan
    offset = np.array([1])
    wide = np.zeros((7, 7))
    wide[:6, :6], wide[6, 6] = P, 1e-10
    run = run_filter(model, np.zeros(7), wide, u, y[:, 0], keep="all", biased=offset, by_points=True)
    found = smooth(driven_with_offsets(model, u, offset), run, covariance=True)
    x, S = run.mean[-1, 0], run.covariance[-1, 0]
    scale = run.std.max(axis=(0, 1))
    for k in range(len(u) - 1, -1, -1):
        own, A = run.covariance[k, 0], run.jacobian[k, 0]
        ahead = (A @ own @ A.T + run.process[k, 0]) / np.outer(scale, scale)
        gain = (own @ A.T / scale) @ np.linalg.pinv(ahead, rcond=1e-14, hermitian=True) / scale
        # what the update has added to the prediction
        rows = run.rows[k, 0]
        there = np.isfinite(run.innovation[k, 0])
        rows = rows[there]
        S_y = rows @ (ahead * np.outer(scale, scale)) @ rows.T + run.noise[k, 0][np.ix_(there, there)]
        K = (ahead * np.outer(scale, scale)) @ rows.T @ np.linalg.inv(S_y)
        predicted = run.mean[k + 1, 0] - K @ run.innovation[k, 0, there]
        x = run.mean[k, 0] + gain @ (x - predicted)
        S = own + gain @ (S - ahead * np.outer(scale, scale)) @ gain.T
        np.testing.assert_allclose(found.mean[k, 0] / scale, x / scale, atol=1e-5)
        np.testing.assert_allclose(
            found.covariance[k, 0] / np.outer(scale, scale), S / np.outer(scale, scale), atol=1e-5
        )


def test_divergence_of_all_runs_is_reported():
    model, mean, P, u, _, y = drawn(make_filter, make_beam(modes=3), sine, (), ("E",), steps=60)
    with pytest.raises(NumericalError, match="diverged"):
        run_filter(model, mean, 1e4 * P, u, 1e9 * y, by_points=True)
