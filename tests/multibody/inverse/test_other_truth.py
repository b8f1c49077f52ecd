"""Loads of a bench whose motion another integrator made: σ holds where samples say more of a load than its walk does."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

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
