"""The smoother, and loads from a truth by another integrator."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.integrate._ivp.rk import DOP853, rk_step

from strainsight.estimation.filter import filter_runs
from strainsight.estimation.smoother import smooth_first
from strainsight.experiment.bench.inverse.filtering import keep_for, smoothed_loads
from strainsight.experiment.bench.inverse.truth import sample
from strainsight.loads.input_models import Matern, RandomWalk
from strainsight.multibody.accelerations import balance
from strainsight.multibody.inverse.loads import load_process, walks

from .benches import bench, spring_step, springs
from .test_filter import ITERATED


def step_matrices(M, C, K, shape, h, method):
    """(q', v') of (q, v), loads at start and end, a force on q: F, E₀, E₁, G of M v̇ + C v + K q = Φᵀu + w. With Z = (1 − zA)⁻¹,
    z = γh, x' = Z (x + (1 − γ)/γ (k − x) + z b(1)), k = Z (x + z b(γ)), b straight in between."""
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    G = np.concatenate([np.zeros((n, n)), np.linalg.inv(M)])
    gamma = 1 - 0.5**0.5 if method == "second_order" else 1.0
    Z = np.linalg.inv(np.eye(2 * n) - gamma * h * A)
    b = gamma * h * Z @ G
    if method == "thesis":
        return Z, 0 * b @ shape.T, b @ shape.T, b
    c = 1 / gamma - 1
    between = c * Z @ b
    return (1 - c) * Z + c * Z @ Z, (1 - gamma) * between @ shape.T, (b + gamma * between) @ shape.T, b + between


def least_squares(maps, offsets, rows, y, noise):
    """Mean and σ (T + 1, n) of xₖ = maps[k] ζ + offsets[k], ζ of unit normals, by rows[k] xₖ₊₁ = y[k] within noise (m,); NaN is
    not measured."""
    seen = np.concatenate([H @ M / noise[:, None] for H, M in zip(rows, maps[1:], strict=True)])
    off = np.concatenate([(own - H @ x) / noise for own, H, x in zip(y, rows, offsets[1:], strict=True)])
    there, count = np.isfinite(off), seen.shape[1]
    Q, R = np.linalg.qr(np.concatenate([seen[there], np.eye(count)]))
    zeta, inverse = np.linalg.solve(R, Q.T @ np.concatenate([off[there], np.zeros(count)])), np.linalg.inv(R)
    mean = np.array([M @ zeta + x for M, x in zip(maps, offsets, strict=True)])
    return mean, np.array([np.linalg.norm(M @ inverse, axis=1) for M in maps])


@pytest.mark.parametrize("method", ["second_order", "thesis"])
@pytest.mark.parametrize(
    "how", [{}, ITERATED, {"iterations": 5}], ids=["one shot", "through the step", "behind the step"]
)
def test_springs_are_the_least_squares_solution_over_all_samples(how, method):
    """Steps by hand; velocities known at the start and one mass undisturbed, so that P and P⁻ are singular; a sample missing.
    The filter is the solution over the samples so far (Kalman)."""
    h, steps, rng = 0.02, 40, np.random.default_rng(1)
    M, C, K, shape, rows = springs()
    known, Q_w, R = rng.normal(size=(steps + 1, 3)), np.array([0.2, 0.0, 0.3]), np.array([1e-6, 4e-6])
    model = spring_step((M, C, K, shape, rows), known, walks(np.array([0.7]), h), Q_w, R, method)
    y = 1e-2 * rng.normal(size=(steps, 2))
    y[7, 1] = y[8] = np.nan
    std = np.array([1e-2] * 3 + [0.0] * 3 + [1.5])
    run = filter_runs(model, np.zeros(model.size), model.spread(np.diag(std**2)), y, "first", form="square_root", **how)
    found = smooth_first(model, run)

    own, before, after, by_w = step_matrices(M, C, K, shape, h, method)
    F, draws = np.eye(7), np.zeros((7, 4))
    F[:6, :6], F[:6, 6] = own, before[:, 1] + after[:, 1]
    draws[:, 0], draws[:6, 1:] = 0.7 * np.append(after[:, 1], 1.0), by_w * np.sqrt(Q_w)
    maps, offsets = [np.zeros((7, 7 + 4 * steps))], [np.zeros(7)]
    maps[0][:, :7] = np.diag(std)
    for k in range(steps):
        told = known[k : k + 2].copy()
        told[:, 1] = 0.0
        maps.append(F @ maps[-1])
        maps[-1][:, 7 + 4 * k : 11 + 4 * k] = draws
        offsets.append(F @ offsets[-1])
        offsets[-1][:6] += before @ told[0] + after @ told[1]
    H, mine = [np.hstack([rows, np.zeros((2, 4))])] * steps, [*range(6), *model.u]
    for k in (1, 8, 20, steps):
        mean, sigma = (own[-1] for own in least_squares(maps[: k + 1], offsets[: k + 1], H[:k], y[:k], np.sqrt(R)))
        np.testing.assert_allclose(run.mean[k, 0, mine] / sigma, mean / sigma, rtol=0, atol=1e-6)
        np.testing.assert_allclose(run.std[k, 0, mine], sigma, rtol=1e-6)
    mean, sigma = least_squares(maps, offsets, H, y, np.sqrt(R))
    scale = np.where(sigma > 1e-12, sigma, 1.0)
    np.testing.assert_allclose(found.mean[:, 0, mine] / scale, mean / scale, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.std[:, 0, mine] / scale, sigma / scale, rtol=0, atol=1e-8)


@pytest.mark.parametrize("corrected", [False, True])
def test_on_constraints_and_from_a_wide_start_sigma_keeps_its_digits(corrected):
    """A jointed bench at 1e-10 of noise, loads from 10 kN: σ of Fy at the start is 0.5 N, where the adjoint form, which takes the
    variance off the first one, has lost it. Least squares along the filter's own linearisations, in deviations from x̂⁻."""
    b, h, steps = bench(), 0.02, 15
    model = b.model(h, steps, load=3e3, noise=(1e-10, 1e-10), white=1e-3, corrected=corrected)
    x, P = b.start(model, std_u=1e4, spread=1e-3)
    real = sample(model, x[None], P[None], np.zeros((steps + 1, 3)), 1, 3)
    y = real.readings + np.sqrt(model.R) * np.random.default_rng(1).normal(size=real.readings.shape)
    project = model.projected if corrected else None
    run = filter_runs(model, x, P, y, "first", form="square_root", project=project, **ITERATED)
    found = smooth_first(model, run)

    def factor(P):
        scale = np.where(np.diag(P) > 0, np.sqrt(np.diag(P)), 1.0)
        values, vectors = np.linalg.eigh(P / np.outer(scale, scale))
        return scale[:, None] * vectors[:, values > 1e-14] * np.sqrt(values[values > 1e-14])

    n, start, before = model.size, factor(P), factor(model.before(0))
    after = [np.zeros((n, 0))] * steps if run.process is None else [factor(own[0]) for own in run.process]
    at = start.shape[1]
    maps = [np.hstack([start, np.zeros((n, steps * before.shape[1] + sum(own.shape[1] for own in after)))])]
    for k in range(steps):
        own = maps[-1].copy()
        own[:, at : at + before.shape[1]] += before
        own, at = run.jacobian[k, 0] @ own, at + before.shape[1]
        own[:, at : at + after[k].shape[1]] += after[k]
        maps.append(own)
        at += after[k].shape[1]
    sigma = least_squares(maps, np.zeros((steps + 1, n)), run.rows[:, 0], 0 * y[:, 0], np.sqrt(model.R))[1]
    np.testing.assert_allclose(found.std[:, 0, model.u], sigma[:, model.u], rtol=1e-6)
    np.testing.assert_array_equal(found.mean[-1], run.mean[-1])


def test_of_several_runs_the_first_is_smoothed_as_it_is_alone():
    b, h, steps = bench(), 0.02, 6
    model = b.model(h, steps, load=3e3, corrected=True)
    x, P = b.start(model, std_u=1e3)
    y = np.random.default_rng(2).normal(size=(steps, 3, 9)) * 1e-9 + model.measure(x[None], 0)[0]
    how = {"form": "square_root", "project": model.projected, **ITERATED}
    alone = smooth_first(model, filter_runs(model, x, P, y[:, :1], "first", **how))
    several = filter_runs(model, np.tile(x, (3, 1)), np.tile(P, (3, 1, 1)), y, "first", **how)
    assert several.covariance.shape[1] == several.jacobian.shape[1] == several.process.shape[1] == 1
    found = smooth_first(model, several)
    sigma = alone.std[:, 0, model.u]
    # an iterated update settles to 1e-6 of σ, so a load near zero has no digits of its own
    np.testing.assert_allclose(found.mean[:, 0, model.u] / sigma, alone.mean[:, 0, model.u] / sigma, rtol=0, atol=1e-7)
    np.testing.assert_allclose(found.std[:, 0, model.u], sigma, rtol=1e-6)


def test_sigma_of_smooth_loads_is_withheld_where_the_step_is_corrected():
    b, h, steps = bench(), 0.02, 4
    mixed = load_process([RandomWalk(), Matern(0.5, 2.5), RandomWalk()], [1e3] * 3, [1e3] * 3, h)
    for corrected in (True, False):
        model = b.model(h, steps, loads=mixed, corrected=corrected)
        x, P = b.start(model, std_u=1e3)
        y = np.tile(model.measure(x[None], 0)[0], (steps, 1))
        run = filter_runs(model, x, P, y, "first", form="square_root", **ITERATED)
        found = smoothed_loads(model, model, run)
        np.testing.assert_array_equal(np.isnan(found.std), np.broadcast_to([False, corrected, False], found.std.shape))
        assert np.isfinite(found.mean).all()


def test_long_record_is_filtered_without_smoothing():
    b = bench()
    assert keep_for(b.model(0.02, 2), 1000) == ("first", ())
    keep, notes = keep_for(b.model(0.02, 2), 100_000)
    assert keep == "mean"
    assert "Smoothing of 100000 steps" in notes[0]
    assert keep_for(b.model(0.02, 2, known=np.zeros((2, 3))), 100_000) == ("mean", ())


SEEDS, NOISE, SAMPLE, DURATION = 20, np.array([1e-8] * 4 + [1e-7] * 5), 0.01, 1.5
"""Seeds; σ of a strain and of a displacement; [s]."""


def drawn_loads(seed):
    """Three loads of three sines each [N], 0.1 to 0.6 Hz, all zero at the start."""
    rng = np.random.default_rng(seed)
    turning, phase = 2 * np.pi * rng.uniform(0.1, 0.6, (3, 3)), rng.uniform(0, 2 * np.pi, (3, 3))
    amplitude = rng.uniform(0.3, 1.0, (3, 3)) * np.array([[2e4], [1e4], [1.5e4]])

    def loads(time):
        return np.sum(amplitude * (np.sin(turning * np.asarray(time)[:, None, None] + phase) - np.sin(phase)), axis=2)

    return loads


def rate_of(b, load):
    """ẋ(t, x) of M v̇ + c + f = Bᵀλ and B v̇ + Ḃv = 0 under load(t) (3,)."""
    n, m = b.system.size, b.system.constrained

    def rate(t, x):
        at = balance(b.system, x[:n], x[n:], load(t), b.theta)
        KKT = np.block([[at.mass, -at.B.T], [at.B, np.zeros((m, m))]])
        return np.concatenate([x[n:], np.linalg.solve(KKT, np.concatenate([-at.load, -at.B_rate @ x[n:]]))[:n]])

    return rate


def motion(b, loads, time):
    """Readings (T, m) at time (T,) by an explicit method of eighth order."""
    n, start, rate = b.system.size, np.concatenate([b.q, 0 * b.q]), rate_of(b, lambda t: loads([t])[0])
    found = solve_ivp(rate, (0, time[-1]), start, "DOP853", rtol=1e-6, atol=1e-9, t_eval=time).y.T
    return np.array([b.sensors.read(x[:n], x[n:])[0] for x in found])


@pytest.mark.slow
def test_sigma_of_loads_holds_at_steps_of_10_20_and_50_ms_and_that_of_implicit_euler_does_not():
    """Twenty drawn histories: RMS of error over σ. Increments are the RMS changes in a step."""
    b, time = bench(), SAMPLE * np.arange(1, round(DURATION / SAMPLE) + 1)
    histories = [drawn_loads(seed) for seed in range(SEEDS)]
    clean = np.stack([motion(b, loads, time) for loads in histories], axis=1)
    truth = np.stack([loads(time) for loads in histories], axis=1)
    rng, found = np.random.default_rng(99), {}
    for method in ("second_order", "thesis"):
        for every in (1, 2, 5):
            u, y = truth[every - 1 :: every], clean[every - 1 :: every]
            change = np.sqrt(np.mean(np.diff(np.concatenate([0 * u[:1], u]), axis=0) ** 2))
            model = b.model(every * SAMPLE, len(y), load=change, noise=(1e-8, 1e-7), white=0.0, method=method)
            x, P = b.start(model, std_u=1e-3)
            start = np.tile(x, (SEEDS, 1)), np.tile(P, (SEEDS, 1, 1))
            run = filter_runs(model, *start, y + NOISE * rng.normal(size=y.shape), **ITERATED)
            scores = (run.mean[1:, :, model.u] - u) / run.std[1:, :, model.u]
            found[method, every] = np.sqrt(np.mean(scores**2))
    for every in (1, 2, 5):
        assert 0.95 < found["second_order", every] < 1.15
    assert 1.1 < found["thesis", 1] < found["thesis", 2] < found["thesis", 5]
    assert found["thesis", 5] > 5


def walked(b, u, h):
    """Readings (N, m) every h under loads u (N + 1, 3), straight between, by the same method of eighth order in steps of h."""
    n, x, found = b.system.size, np.concatenate([b.q, 0 * b.q]), []
    stages = np.empty((DOP853.n_stages + 1, 2 * n))
    for first, last in pairwise(u):
        rate = rate_of(b, lambda t, first=first, last=last: first + (last - first) * t / h)
        x, _ = rk_step(rate, 0.0, x, rate(0.0, x), h, DOP853.A, DOP853.B, DOP853.C, stages)
        found.append(b.sensors.read(x[:n], x[n:])[0])
    return np.array(found)


@pytest.mark.slow
def test_sigma_holds_of_loads_that_walk_within_the_step_and_not_where_the_step_is_taken_for_true():
    """Three walks drawn every millisecond, in steps of 20 ms; `benchmarks/bench_sigma.py` has 20, 10 and 50 ms, a modulus."""
    b, fine, every, size = bench(), 1e-3, 20, np.array([2e4, 1e4, 1.5e4])
    rng, h = np.random.default_rng(6), 0.02
    u = np.array([np.vstack([np.zeros(3), np.cumsum(rng.normal(size=(400, 3)) * size * fine**0.5, axis=0)]) for _ in range(3)])
    y = np.stack([walked(b, own, fine)[every - 1 :: every] for own in u], axis=1)
    noisy, true = y + NOISE * rng.normal(size=y.shape), np.swapaxes(u[:, every::every], 0, 1)
    ratios = {}
    for corrected in (True, False):
        model = b.model(h, len(y), load=size * h**0.5, noise=(1e-8, 1e-7), white=0.0, corrected=corrected)
        x, P = b.start(model, std_u=1e-3)
        how = {**ITERATED, "form": "square_root", "project": model.projected if corrected else None}
        run = filter_runs(model, np.tile(x, (3, 1)), np.tile(P, (3, 1, 1)), noisy, **how)
        ratios[corrected] = np.sqrt(np.mean(((run.mean[1:, :, model.u] - true) / run.std[1:, :, model.u]) ** 2))
        if corrected:
            assert 0.85 < np.sqrt(run.nis.mean() / 9) < 1.15
    assert 0.8 < ratios[True] < 1.2
    assert ratios[False] > 5
