"""What noise says of constants in a filter of free loads: by unit readings one at a time, and that nothing is left of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.estimation import bank_filters
from strainsight.estimation.bank import filter_bank
from strainsight.estimation.conditional import no_nuisances
from strainsight.estimation.draws import draw_truth
from strainsight.estimation.linear import LinearModels, plain_motion
from strainsight.estimation.noise_alone import noise_alone

from .chain import NOISE, REFERENCE, chain, forces, start


def test_the_mean_is_that_of_unit_readings_one_after_the_other():
    """All matrices at random, four ν of which two act on the motion, a channel that is missing now and then, noise that changes.
    Σ εᵀS⁻¹e is a quadratic form of the readings: its mean is the sum over readings of one σ in one sample of one channel."""
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
    nothing = np.zeros((1, n, 0)), np.zeros((1, e, n, 0))
    models = LinearModels(
        plain_motion(A[None], nothing[0], A_nu[None], nothing[1]),
        (C @ C.T)[None],
        rows[None],
        np.zeros((1, m, 0)),
        D,
        np.zeros((d, m, 0)),
        np.zeros((d, m)),
        np.zeros((d, m, 0)),
        np.zeros((0, n)),
        np.zeros((0, 0)),
        np.zeros(d),
        np.zeros((1, d)),
        np.zeros(d, dtype=bool),
    )
    np.testing.assert_allclose(noise_alone(models, P0, R).sum(axis=0), expected, rtol=1e-10)


def test_where_nothing_changes_any_more_steps_are_those_before():
    """A sample at every second step: a long record adds the same for each, and takes the way that is short."""
    model = replace(chain(), free_loads=True)
    problem = bank_filters.BankProblem(
        (bank_filters.bank_record(replace(model, every=2), forces(800), np.zeros((400, 2)), damping(model), None),),
        np.zeros(7),
        start(),
        np.zeros(0, dtype=int),
        1.0,
        6.0,
        judged=True,
    )
    (found,) = problem.noise_alone
    pairs = found.reshape(400, 2, -1).sum(axis=1)
    np.testing.assert_allclose(pairs[200:300], np.tile(pairs[250], (100, 1)), rtol=1e-6)


def damping(model, spread=0.5):
    return replace(no_nuisances(model), damping=spread)


def test_noise_does_not_speak_for_a_damping():
    """Of a chain whose unknown load is at rest: ν of both modes, beside a spring, is zero on average over four records. It was
    2.3 and 1.5 of its σ where the walk that is not there was expected to ring."""
    whole, kept, steps = chain(), [0, 1, 2, 3, 4, 6], 150
    unknowns = replace(whole.unknowns, parameters=("k2",))
    Q, P = whole.Q[np.ix_(kept, kept)], start()[np.ix_(kept, kept)]
    model = replace(whole, unknowns=unknowns, fixed={"k1": REFERENCE["k1"]}, H=whole.H[:, kept], Q=Q, free_loads=True)
    truth, _ = draw_truth(replace(model, Q=0 * Q), np.zeros(6), np.zeros((6, 6)), forces(steps), [1])
    means = []
    for seed in range(4):
        y = truth[1:, 0] @ model.H.T + NOISE * np.random.default_rng(seed).standard_normal((steps, 2))
        bank = filter_bank(model, np.zeros(6), P, forces(steps), y, damping(model))
        means.append(bank.nuisances[0])
    left = np.sqrt(np.diag(bank.nuisances[1]))
    assert np.all(np.abs(np.mean(means, axis=0)) < 1.4 * left / np.sqrt(4))
