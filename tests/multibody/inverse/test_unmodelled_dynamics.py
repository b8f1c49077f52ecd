"""What a step leaves out is made up for: on a linear bench the filter is that of the exactly sampled system, at any step."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from strainsight.estimation.filter import filter_runs
from strainsight.loads.input_models import IntegratedRandomWalk, Matern, Oscillator, RandomWalk
from strainsight.multibody.inverse.loads import load_process, step_responses

from .benches import bench, loads, spring_step, springs
from .test_filter import ITERATED

N = 3
LAMBDA = 2 * np.pi * 2.0 / np.sqrt(2**0.5 - 1)
"""Rate of a Matérn process of ν = 3/2 that has fallen to half its spectrum at 2 Hz."""
PROCESSES = {
    # ċ = A c + (0, …, 1) w of an intensity, by hand
    "walk": (RandomWalk(), [[0.0]], 2.5**2 / 0.05),
    "integrated": (IntegratedRandomWalk(2.0), [[0.0, 4 * np.pi], [0.0, 0.0]], 3.0**2 * 4 * np.pi / (2 * np.pi)),
    "matern": (Matern(2.0, 1.5), [[0.0, LAMBDA], [-LAMBDA, -2 * LAMBDA]], 3.0**2 * 4 * LAMBDA),
    "oscillator": (Oscillator(2.0), [[0.0, 4 * np.pi], [-4 * np.pi, -0.4 * np.pi]], 3.0**2 * 0.2 * 4 * np.pi),
}


def sampled(F, Q, h):
    """exp(Fh) and ∫ exp(Ft) Q exp(Ft)ᵀ dt by fine midpoints."""
    t = (np.arange(4000) + 0.5) * h / 4000
    Phi = expm(F * h / 4000)
    part = expm(F * t[0])
    whole = np.zeros_like(Q)
    for _ in t:
        whole += part @ Q @ part.T * h / 4000
        part = Phi @ part
    return expm(F * h), whole


ALTERNATE = [*zip(PROCESSES, ("second_order", "thesis") * 2, strict=True)]


@pytest.mark.parametrize(("process", "method"), ALTERNATE)
def test_springs_under_loads_that_move_within_the_step_are_kalmans_filter_of_the_exact_system(process, method):
    """A step of 50 ms is twenty times the slowest radian of the springs: both methods as they are make nothing of it."""
    h, steps = 0.05, 12
    model_of_load, A_c, intensity = PROCESSES[process]
    M, C, K, shape, rows = springs()
    rng = np.random.default_rng(1)
    known, R = rng.normal(size=(steps + 1, 3)), np.array([1e-6, 4e-6])
    moving = load_process([model_of_load], [3.0], [2.5], h)
    model = spring_step((M, C, K, shape, rows), known, moving, np.zeros(N), R, method, corrected=True)
    k, n = len(A_c), 2 * N
    y = 1e-2 * rng.normal(size=(steps, 2))
    P = np.diag([1e-4] * n + [2.0] * k)
    whole = np.zeros((model.size, model.size))
    mine = [*range(n), *range(model.c.start, model.c.stop)]
    whole[np.ix_(mine, mine)] = P
    run = filter_runs(model, np.zeros(model.size), whole, y, keep="all", form="square_root", **ITERATED)

    # exact: known loads as straight lines, the unknown one as its process
    inverse = np.linalg.inv(M)
    F = np.zeros((n + k + 2,) * 2)
    F[:N, N:n] = np.eye(N)
    F[N:n, :n] = np.hstack([-inverse @ K, -inverse @ C])
    F[N:n, n] = inverse @ shape[1]
    F[n : n + k, n : n + k] = A_c
    F[-1, -2] = 1.0
    Q = np.zeros_like(F)
    Q[n + k - 1, n + k - 1] = intensity
    x, H = np.zeros(n + k), np.hstack([rows, np.zeros((2, N + k))])
    for i in range(steps):
        from_known = [known[i, [0, 2]] @ shape[[0, 2]], (known[i + 1] - known[i])[[0, 2]] @ shape[[0, 2]] / h]
        F[N:n, -2], F[N:n, -1] = inverse @ from_known[0], inverse @ from_known[1]
        Phi, gathered = sampled(F, Q, h)
        own = slice(0, n + k)
        x, P = Phi[own, own] @ x + Phi[own, -2], Phi[own, own] @ P @ Phi[own, own].T + gathered[own, own]
        S = H @ P @ H.T + np.diag(R)
        gain = P @ H.T @ np.linalg.inv(S)
        x, P = x + gain @ (y[i] - H @ x), P - gain @ S @ gain.T
        std = np.sqrt(np.diag(P))
        np.testing.assert_allclose(run.mean[i + 1, 0, mine] / std, x / std, atol=1e-5)
        found = run.covariance[i + 1, 0][np.ix_(mine, mine)]
        np.testing.assert_allclose(found / np.outer(std, std), P / np.outer(std, std), atol=1e-6)


@pytest.mark.parametrize("doublings", [0, 5])
def test_responses_of_a_step_are_exponentials_of_larger_matrices(doublings):
    """Van Loan: Φ, X, Y in exp([F G 0; 0 0 1; 0 0 0] s), the noise in exp([−F Q; 0 Fᵀ] s), by SciPy."""
    rng = np.random.default_rng(4)
    n, k, part = 7, 2, 0.02
    F, G = rng.normal(size=(n, n)), rng.normal(size=(n, k))
    F *= 0.8 / part / np.linalg.norm(F)
    drawn = np.zeros((n, 2))
    drawn[[1, 4]] = [[30.0, 0.0], [7.0, 0.01]]
    Q, s = drawn @ drawn.T, part * 2**doublings
    whole = np.zeros((n + 2 * k, n + 2 * k))
    whole[:n, :n], whole[:n, n : n + k], whole[n : n + k, n + k :] = F, G, np.eye(k)
    exact = expm(whole * s)
    noise = expm(np.block([[-F, Q], [np.zeros((n, n)), F.T]]) * s)
    expected = exact[:n, :n], noise[n:, n:].T @ noise[:n, n:], exact[:n, n : n + k], exact[:n, n + k :]
    for found, own in zip(step_responses(F, Q, G, part, doublings), expected, strict=True):
        np.testing.assert_allclose(found, own, rtol=0, atol=1e-11 * np.abs(own).max())
    assert not step_responses(F, None, G, part, doublings)[1].any()


def test_no_unmodelled_dynamics_at_rest():
    b, h = bench(), 0.05
    model = b.model(h, 2, load=1.0, corrected=True, rest=False)
    x, _ = b.start(model)
    model.begin(x[None], 1)
    ahead, _ = model.step(x[None], 1)
    d = b.system.metric
    assert np.max(np.abs(d * (ahead[0, model.q] - x[model.q]))) < 1e-9 * np.linalg.norm(d * x[model.q])
    assert np.max(np.abs(d * ahead[0, model.v])) < 1e-8 * np.linalg.norm(d * x[model.q])


@pytest.mark.parametrize("method", ["second_order", "thesis"])
def test_slopes_of_unmodelled_dynamics(method):
    b, h = bench(["preload"], modulus=True, preload=2e-4), 0.02
    model = b.model(h, 2, free=("E", "b.preload"), load=1e3, corrected=True, rest=False, method=method)
    x, _ = b.start(model)
    rng = np.random.default_rng(2)
    x[model.v] += 1e-3 * rng.normal(size=model.system.size)
    x[model.u] = [2e4, -1e4, 3e4]
    x = model.projected(x[None], 0)[0]

    def begun(x):
        model.begin(x[None], 1)
        return model.step(x[None], 1)

    (_,), (A,) = begun(x)
    plain = replace(model, corrected=False).step(x[None], 1)[1][0]
    d = np.tile(b.system.metric, 2)
    for at, width in ((model.u[0], 1e2), (model.xi.start, 1e-3), (model.xi.start + 1, 1e-2)):
        e = np.zeros(model.size)
        e[at] = width
        difference = (begun(x + e)[0][0] - begun(x - e)[0][0])[: model.v.stop] / (2 * width)
        off = np.linalg.norm(d * (A[: model.v.stop, at] - difference))
        assert off < 0.02 * np.linalg.norm(d * difference)
        assert off < 0.1 * np.linalg.norm(d * (plain[: model.v.stop, at] - difference))


def test_unmodelled_dynamics_are_of_third_order():
    b, sizes = bench(), []
    for h in (2e-4, 1e-4):
        model = b.model(h, 2, load=1.0, corrected=True, rest=False)
        x, _ = b.start(model)
        x[model.u] = loads(0.05, 4)[-1]
        model.begin(x[None], 1)
        left = model.step(x[None], 1)[0][0] - replace(model, corrected=False).step(x[None], 1)[0][0]
        sizes.append(np.linalg.norm(b.system.metric * left[model.v]))
    assert 7 < sizes[0] / sizes[1] < 9
