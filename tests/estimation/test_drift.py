"""Offsets and drifts of channels, as states and beside the states of a bank."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.estimation.bank import filter_bank
from strainsight.estimation.bank_smoother import smooth_bank
from strainsight.estimation.biased import Biased
from strainsight.estimation.conditional import Nuisances, known_ends, no_nuisances
from strainsight.estimation.draws import draw_truth
from strainsight.estimation.filter import filter_runs
from strainsight.estimation.motion import measure
from strainsight.estimation.reduced import Driven

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
    axis = 0.7 * np.arange(-11, 12)
    point = mean + std * np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    log_density, nu = np.empty(len(point)), np.empty((len(point), 3))
    for i, p in enumerate(point):
        middle, covariance = joint(p, P)
        covariance = covariance + columns @ columns.T
        log_density[i] = log_normal(y.ravel(), middle, covariance) - 0.5 * np.sum(p**2 / np.diag(P)[5:])
        nu[i] = columns.T @ np.linalg.solve(covariance, y.ravel() - middle)
    w = np.exp(log_density - log_density.max())
    assert max(w.reshape(23, 23)[[0, -1]].max(), w.reshape(23, 23)[:, [0, -1]].max()) < 1e-8
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


AT = np.array([0, 2])
RECORD = 150


@pytest.fixture(scope="module")
def filters(make_beam, make_filter):
    """The linear filter model of a tip force, and one of the modulus too, under a known force in the middle."""
    beam = make_beam(modes=3, load_nodes=(16, 8))
    known = np.tile(np.array([50.0, 20.0, -10.0])[:, None], (RECORD, 1, 1))
    return {
        unknown: Driven(
            make_filter(beam, ("tip",), unknown, ("middle",), accelerometers=1, h=1e-3, noise_step=1e-3), known
        )
        for unknown in ((), ("E",))
    }


@pytest.mark.parametrize("unknown", [(), ("E",)])
def test_an_offset_adds_itself_to_its_channel_and_nothing_else(filters, unknown):
    """Linear in b, so differences are exact; the rest is the plain model's."""
    plain = filters[unknown]
    model, n = Biased(plain, AT), plain.size
    rng = np.random.default_rng(4)
    x = rng.normal(size=(2, n)) * np.where(np.arange(n) < 6, 1e-4, 0.01)
    b = rng.normal(size=(2, len(AT)))
    both = np.hstack([x, b])
    for function, own, kept in ((model.step, plain.step, n), (model.measure, plain.measure, model.channels)):
        value, slope = function(both, 3)
        there, base = own(x, 3)
        shift = np.zeros_like(value[:, :kept])
        if function == model.measure:
            shift[:, AT] = b
        np.testing.assert_array_equal(value[:, :kept], there + shift)
        np.testing.assert_array_equal(slope[..., :kept, :n], base)
        moved = function(np.hstack([x, b + 1.0]), 3)[0] - value
        np.testing.assert_allclose(moved, np.broadcast_to(slope[..., n:].sum(axis=-1), moved.shape), atol=1e-12)
    np.testing.assert_array_equal(model.step(both, 3)[0][:, n:], b)


def test_a_known_offset_is_one_taken_from_the_record(filters):
    """b known without doubt: the filter on y is the plain filter on y − E b."""
    unknown = ("E",)
    plain = filters[unknown]
    model, b = Biased(plain, AT), np.array([3e-5, -2e-5])
    mean = np.zeros(plain.size)
    P = np.diag([0.0] * 6 + [1e-2] + [1e-6] * len(unknown))
    _, y = draw_truth(plain.model, mean, P, plain.known, [0])
    read = y.copy()
    read[..., AT] += b
    expected = filter_runs(plain, mean, P, y, keep="all")
    corner = np.zeros((model.size, model.size))
    corner[: plain.size, : plain.size] = P
    found = filter_runs(model, np.append(mean, b), corner, read, keep="all")
    scale = np.abs(expected.mean).max(axis=(0, 1))
    assert np.all(np.abs(found.mean[..., : plain.size] - expected.mean) <= 1e-9 * scale)
    np.testing.assert_allclose(found.log_likelihood, expected.log_likelihood, rtol=1e-9)
    assert np.all(found.mean[..., plain.size :] == b)


def test_an_offset_is_found_and_stays_what_it_is(filters):
    plain = filters[()]
    model, b = Biased(plain, AT), np.array([3e-5, -2e-5])
    mean, P = np.zeros(plain.size), np.diag([0.0] * 6 + [1e-2])
    _, y = draw_truth(plain.model, mean, P, plain.known, [0])
    y[..., AT] += b
    start = np.diag(np.append(np.diag(P), [1e-8, 1e-8]))
    run = filter_runs(model, np.zeros(model.size), start, y, keep="all")
    last, std = run.mean[-1, 0, -2:], np.sqrt(np.diagonal(run.covariance[-1, 0]))[-2:]
    assert np.all(np.abs(last - b) < 4 * std)
    assert np.all(std < 0.1 * np.abs(b))
    # no process noise acts on it: what is known of it is never lost again
    known = np.diagonal(run.covariance[:, 0], axis1=-2, axis2=-1)[:, -2:]
    assert np.all(np.diff(known, axis=0) <= 1e-12 * known[:-1])


def test_a_known_force_reaches_the_accelerometers_as_the_general_measurement_says(filters):
    """The linear filter adds it as a term a step; the measurement that also parameters use takes it at the step's end."""
    plain = filters[()]
    x = np.random.default_rng(2).normal(size=(2, plain.size)) * 1e-4
    expected = measure(plain.model, x, plain.known[3].sum(axis=-2))[0]
    np.testing.assert_allclose(plain.measure(x, 3)[0], expected, rtol=1e-12)
    assert np.any(
        np.abs(expected - measure(plain.model, x, 0 * plain.known[3].sum(axis=-2))[0]) > 1e-3 * np.abs(expected)
    )
