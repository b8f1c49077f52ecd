"""Zeros that drift in time beside the states of a bank, against Bayes by brute force on all samples at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.estimation.bank import filter_bank
from strainsight.estimation.bank_smoother import smooth_bank
from strainsight.estimation.conditional import Nuisances, known_ends, no_nuisances
from strainsight.estimation.draws import draw_truth

from .chain import ROWS, STEPS, chain, forces, loaded_chain, start
from .test_bank import joint, log_normal

END = np.array([[6e-3, 0.0], [0.0, 4e-3], [5e-3, 5e-3]])
"""What one of every constant adds to both readings at the end (3, 2): two channels that drift, and what both feel."""
FELT = END[:, None] * np.arange(1, STEPS + 1)[:, None] / STEPS


def drifts(learned=False):
    E = np.stack([np.zeros((3, 2)), END], axis=2)
    return Nuisances(("drift", "drift", "temperature"), np.zeros((3, 2, 5)), E, np.zeros((3, 2)), learned=learned)


def measured():
    """The samples of a truth with a drift of nearly two σ of all three."""
    model = chain()
    _, y = draw_truth(model, np.zeros(7), start(), forces(), [5])
    return model, y[:, 0] + np.tensordot([1.8, -1.6, 1.7], FELT, axes=1)


def test_parameters_and_drifts_are_those_of_bayes_by_brute_force():
    """All readings are one Gaussian at every θ: drifts are one more covariance of it, and one more regression. Without them the
    same readings mislead."""
    model, y = measured()
    P, columns = start(), FELT.reshape(3, -1).T
    bank = filter_bank(model, np.zeros(7), P, forces(), y, drifts(), spacing=0.6, depth=20.0)
    mean, std = bank.run.mean[-1, 0, 5:], bank.run.std[-1, 0, 5:]
    axis = 0.65 * np.arange(-12, 13)
    point = mean + std * np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    log_density, nu = np.empty(len(point)), np.empty((len(point), 3))
    for i, p in enumerate(point):
        middle, covariance = joint(p, P)
        covariance = covariance + columns @ columns.T
        log_density[i] = log_normal(y.ravel(), middle, covariance) - 0.5 * np.sum(p**2 / np.diag(P)[5:])
        nu[i] = columns.T @ np.linalg.solve(covariance, y.ravel() - middle)
    w = np.exp(log_density - log_density.max())
    assert max(w.reshape(25, 25)[[0, -1]].max(), w.reshape(25, 25)[:, [0, -1]].max()) < 1e-8
    w /= w.sum()
    expected = w @ point
    np.testing.assert_allclose(mean / std, expected / std, atol=1e-6)
    np.testing.assert_allclose(std, np.sqrt(w @ (point - expected) ** 2), rtol=1e-6)
    np.testing.assert_allclose(bank.nuisances[0], w @ nu, atol=1e-5)
    exact = filter_bank(model, np.zeros(7), P, forces(), y).run
    assert (np.abs(exact.mean[-1, 0, 5:] - mean) > 0.5 * std).any()


def test_motion_that_learns_drifts_is_the_regression_on_all_samples():
    """At known stiffness, what the gauges read at the end without noise and drift, by filter and smoother."""
    model, P = loaded_chain(), start()[:5, :5]
    y, own = measured()[1], drifts(learned=True)
    bank = filter_bank(model, np.zeros(5), P, forces(), y, own)
    later = smooth_bank(model, np.zeros(5), P, forces(), y, own, bank)
    mean, covariance = joint(np.zeros(2), start())
    columns = FELT.reshape(3, -1).T
    whole, rows = covariance + columns @ columns.T, covariance[-2:].copy()
    rows[:, -2:] -= model.noise[0] * np.eye(2)
    expected = mean[-2:] + rows @ np.linalg.solve(whole, y.ravel() - mean)
    left = rows[:, -2:] - rows @ np.linalg.solve(whole, rows.T)
    np.testing.assert_allclose(ROWS @ later.mean[-1, 0, :2], expected, atol=1e-6 * np.sqrt(np.diag(left)).min())
    np.testing.assert_allclose(ROWS @ later.covariance[-1, 0, :2, :2] @ ROWS.T, left, rtol=1e-5, atol=1e-8 * left.max())
    np.testing.assert_allclose(later.mean[-1, 0] / later.std[-1, 0], bank.run.mean[-1, 0] / later.std[-1, 0], atol=1e-5)
    np.testing.assert_allclose(later.std[-1, 0], bank.run.std[-1, 0], rtol=1e-5)


def test_t_over_the_whole_record_stands_behind_the_loads():
    known = forces()
    ends = known_ends(known, drifts())
    np.testing.assert_array_equal(ends[:, 0], known.sum(axis=1)[:, 0])
    np.testing.assert_allclose(ends[[0, STEPS // 2 - 1, -1], 1], [1 / STEPS, 0.5, 1.0], rtol=1e-15)
    assert known_ends(known, no_nuisances(chain())).shape == (STEPS, 1)


def test_a_drift_of_nothing_is_no_drift_to_the_bit():
    model, y = measured()
    none = replace(drifts(), E=np.zeros((3, 2, 2)))
    plain = replace(none, E=none.E[..., :1])
    one, other = (filter_bank(model, np.zeros(7), start(), forces(), y, own).run for own in (none, plain))
    np.testing.assert_array_equal(one.mean, other.mean)
    np.testing.assert_array_equal(one.std, other.std)
