"""Loads of a bench whose motion another integrator made: σ holds where samples say more of a load than its walk does."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.integrate._ivp.rk import DOP853, rk_step

from strainsight.estimation.filter import filter_runs
from strainsight.multibody.equations import balance

from .benches import bench
from .test_filter import ITERATED

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


def motion(b, loads, time):
    """Readings (T, m) at time (T,) from M v̇ + c + f = Bᵀλ and B v̇ + Ḃv = 0 by an explicit method of eighth order."""
    n, m, elastic = b.system.size, b.system.constrained, b.system.at(b.theta)
    still, none = np.zeros(n), np.zeros(m)

    def rate(t, x):
        at = balance(b.system, x[:n], x[n:], still, none, none, loads([t])[0], b.theta, elastic)
        KKT = np.block([[at.mass, -at.B.T], [at.B, np.zeros((m, m))]])
        return np.concatenate([x[n:], np.linalg.solve(KKT, np.concatenate([-at.load, -at.B_rate @ x[n:]]))[:n]])

    start = np.concatenate([b.q, still])
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
    n, m, elastic = b.system.size, b.system.constrained, b.system.at(b.theta)
    still, none, stages = np.zeros(n), np.zeros(m), np.empty((DOP853.n_stages + 1, 2 * n))
    x, found = np.concatenate([b.q, still]), []
    for first, last in pairwise(u):

        def rate(t, x, first=first, last=last):
            at = balance(b.system, x[:n], x[n:], still, none, none, first + (last - first) * t / h, b.theta, elastic)
            KKT = np.block([[at.mass, -at.B.T], [at.B, np.zeros((m, m))]])
            return np.concatenate([x[n:], np.linalg.solve(KKT, np.concatenate([-at.load, -at.B_rate @ x[n:]]))[:n]])

        x, _ = rk_step(rate, 0.0, x, rate(0.0, x), h, DOP853.A, DOP853.B, DOP853.C, stages)
        found.append(b.sensors.read(x[:n], x[n:])[0])
    return np.array(found)


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
