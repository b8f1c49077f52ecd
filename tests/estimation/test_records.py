"""Several records in one posterior: dense Bayes over all of them, what is shared, what is each record's own."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag

from strainsight.errors import NumericalError
from strainsight.estimation.conditional import ConsideredParameters, none_considered, split_by_record
from strainsight.estimation.grid_filter import FOLLOWED, filter_on_grid, filter_records
from strainsight.estimation.grid_filter_smoother import sample_paths, smooth_on_grid
from strainsight.estimation.record import GridRecord

from .chain import NOISE, ROWS, STEPS, H, chain, driven_chain, driven_start, finer, forces, loaded_chain, start, states
from .truth import draw_truth

LENGTHS = 10, 14
SHARED, OWN = np.array([2e-3, -3e-3]), np.array([[4e-3, 0.0], [0.0, 3e-3]])
"""Readings of both channels that one shared constant adds; those of each record's own two."""


def held_of(record):
    return (1 + 0.5 * record) * forces(LENGTHS[record])


def dense(p, record):
    """Mean of all states (5 (T + 1)) of a record at θ = reference·exp(p), their covariance, and the rows of the readings."""
    mean, O, rows, Q = states(p, held_of(record))
    return mean, O @ block_diag(start()[:5, :5], *[Q] * LENGTHS[record]) @ O.T, rows


def both(p):
    """Mean and covariance of [states of record 0, of record 1, ν], and rows of all readings on them, at θ."""
    (m0, P0, H0), (m1, P1, H1) = (dense(p, record) for record in range(2))
    offsets = np.zeros((len(H0) + len(H1), 5))
    offsets[:, 0] = np.tile(SHARED, sum(LENGTHS))
    for record, span in ((0, slice(0, len(H0))), (1, slice(len(H0), None))):
        offsets[span, 1 + 2 * record : 3 + 2 * record] = np.tile(OWN, (1, LENGTHS[record])).T
    rows = np.hstack([block_diag(H0, H1), offsets])
    return np.concatenate([m0, m1, np.zeros(5)]), block_diag(P0, P1, np.eye(5)), rows


def conditioned(p, y, of=slice(None)):
    """ln p(y | θ), and mean and covariance of (some) [states, ν] given y and θ: one Gaussian of both records."""
    mean, P, rows = both(p)
    cross = rows @ P
    S = cross @ rows.T + NOISE**2 * np.eye(len(y))
    K = np.linalg.solve(S, cross[:, of]).T
    e = y - rows @ mean
    fit = -0.5 * (e @ np.linalg.solve(S, e) + np.linalg.slogdet(S)[1] + len(y) * np.log(2 * np.pi))
    return fit, mean[of] + K @ e, P[of, of] - K @ cross[:, of]


def considered(learned=True):
    one = ConsideredParameters(
        ("gain", "offset", "offset"),
        np.zeros((3, 2, 5)),
        np.zeros((3, 2, 1)),
        np.vstack([SHARED, OWN]),
        learned=learned,
    )
    return split_by_record(one, 2, ("offset",))


@pytest.fixture(scope="module")
def measured():
    """Readings of two records, off by one shared constant and by two of their own."""
    shared, found = 0.7, []
    for record, own in enumerate(([1.2, -0.4], [-0.8, 1.5])):
        truth, y = draw_truth(chain(), np.zeros(7), start(), held_of(record), [5 + record])
        assert truth.shape[0] == LENGTHS[record] + 1
        found.append(y[:, 0] + shared * SHARED + np.array(own) @ OWN)
    return found


def campaign(model, P, y, own, **more):
    records = [GridRecord(model, np.zeros(len(P)), P, held_of(r), y[r], own[r]) for r in range(2)]
    return filter_records(records, **more)


@pytest.fixture(scope="module")
def square(measured):
    """Bayes by brute force on a square of parameters 0.8 σ apart."""
    with finer(0.4, 24.0):
        grid_runs = campaign(chain(), start(), measured, considered())
    mean, covariance = grid_runs[0].posterior
    std = np.sqrt(np.diag(covariance))
    axis = 0.8 * np.arange(-9, 10)
    point = mean + std * np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    y = np.concatenate([own.ravel() for own in measured])
    found = [conditioned(p, y, slice(-10, None)) for p in point]
    prior = np.array([0.3, 0.2])
    density = np.array([own[0] for own in found]) - 0.5 * np.sum((point / prior) ** 2, axis=1)
    evidence = np.logaddexp.reduce(density) + np.log(0.8**2 * std.prod() / (2 * np.pi * prior.prod()))
    w = np.exp(density - density.max())
    edge = w.reshape(19, 19)
    assert max(edge[[0, -1]].max(), edge[:, [0, -1]].max()) < 1e-7
    w /= w.sum()
    return grid_runs, point, w, [own[1:] for own in found], evidence


def test_two_records_match_brute_force_bayes(square):
    grid_runs, point, w, found, evidence = square
    mean = w @ point
    std = np.sqrt(w @ (point - mean) ** 2)
    for grid_run in grid_runs:
        own, covariance = grid_run.posterior
        np.testing.assert_allclose(own / std, mean / std, atol=1e-6)
        np.testing.assert_allclose(np.sqrt(np.diag(covariance)), std, rtol=1e-6)
    assert sum(float(grid_run.run.log_likelihood[0]) for grid_run in grid_runs) == pytest.approx(evidence, abs=1e-6)
    nu = np.array([own[0][-5:] for own in found])
    middle = w @ nu
    variance = w @ ((nu - middle) ** 2 + np.array([np.diag(own[1])[-5:] for own in found]))
    own, covariance = grid_runs[1].nu_moments
    np.testing.assert_allclose(own, middle, atol=1e-6)
    np.testing.assert_allclose(np.diag(covariance), variance, rtol=1e-6)


def test_last_instant_contains_all_samples(square):
    grid_runs, _, w, found, _ = square
    x = np.array([own[0][-10:-5] for own in found])
    mean = w @ x
    std = np.sqrt(w @ ((x - mean) ** 2 + np.array([np.diag(own[1])[-10:-5] for own in found])))
    run = grid_runs[1].run
    np.testing.assert_allclose(run.mean[-1, 0, :5] / std, mean / std, atol=1e-6)
    np.testing.assert_allclose(run.std[-1, 0, :5], std, rtol=1e-6)


def test_smoother_shares_constants_between_records(measured):
    """Parameters known: smoothed motion and loads of both records are those of one dense Gaussian."""
    model, P = loaded_chain(), start()[:5, :5]
    own = considered()
    grid_runs = campaign(model, P, measured, own)
    _, mean, covariance = conditioned(np.zeros(2), np.concatenate([y.ravel() for y in measured]))
    first = 0
    for r, grid_run in enumerate(grid_runs):
        later = smooth_on_grid(GridRecord(model, np.zeros(5), P, held_of(r), measured[r], own[r]), grid_run)
        span = slice(first, first + 5 * (LENGTHS[r] + 1))
        expected, std = mean[span].reshape(-1, 5), np.sqrt(np.diag(covariance)[span]).reshape(-1, 5)
        np.testing.assert_allclose(later.mean[:, 0] / std, expected / std, atol=1e-7)
        np.testing.assert_allclose(later.std[:, 0], std, rtol=1e-7)
        first = span.stop


def test_unlearned_motion_is_independent_of_other_records(measured):
    model, P, own = loaded_chain(), start()[:5, :5], considered(learned=False)
    alone = ConsideredParameters(("gain", "offset", "offset"), np.zeros((3, 2, 5)), np.zeros((3, 2, 1)), np.vstack([SHARED, OWN]))
    for r, grid_run in enumerate(campaign(model, P, measured, own)):
        by_itself = filter_on_grid(GridRecord(model, np.zeros(5), P, held_of(r), measured[r], alone))
        args = model, np.zeros(5), P, held_of(r), measured[r]
        one, other = smooth_on_grid(GridRecord(*args, own[r]), grid_run), smooth_on_grid(GridRecord(*args, alone), by_itself)
        for found, expected in ((grid_run.run, by_itself.run), (one, other)):
            std = expected.std.max(axis=0)
            np.testing.assert_allclose(found.mean / std, expected.mean / std, atol=1e-9)
            np.testing.assert_allclose(found.std, expected.std, rtol=1e-9)


def test_sampled_histories_match_smoother_and_share_constants(measured):
    model, own, count = chain(), considered(), 4000
    grid_runs = campaign(model, start(), measured, own)
    parts = []
    for r, grid_run in enumerate(grid_runs):
        args = GridRecord(model, np.zeros(7), start(), held_of(r), measured[r], own[r]), grid_run
        drawn = next(sample_paths(*args, count, 1, number=r))
        later = smooth_on_grid(*args)
        std = later.std[1:, 0, :5]
        off = (drawn.state[:, 1:].mean(axis=0) - later.mean[1:, 0, :5]) / std
        assert np.abs(off).max() < 5 / np.sqrt(count)
        np.testing.assert_allclose(drawn.state[:, 1:].std(axis=0) / std, 1.0, atol=0.08)
        parts.append(drawn)
    np.testing.assert_array_equal(parts[0].parameter, parts[1].parameter)
    loads = [(own.state[:, -1, 4] - own.state[:, -1, 4].mean()) / own.state[:, -1, 4].std() for own in parts]
    _, mean, covariance = conditioned(np.zeros(2), np.concatenate([y.ravel() for y in measured]))
    ends = 5 * (LENGTHS[0] + 1) - 1, len(mean) - 6
    alike = covariance[ends] / np.sqrt(covariance[ends[0], ends[0]] * covariance[ends[1], ends[1]])
    assert np.mean(loads[0] * loads[1]) == pytest.approx(alike, abs=0.1)


def test_the_order_of_records_does_not_matter(measured):
    model = chain()

    def posterior(order):
        first = model, np.zeros(7), start()
        records = [GridRecord(*first, held_of(r), measured[r], considered()[i]) for i, r in enumerate(order)]
        mean, covariance = filter_records(records)[0].posterior
        return mean, np.sqrt(np.diag(covariance))

    for grid, close in ((finer(0.5, 20.0), 1e-6), (nullcontext(), 1e-2)):
        with grid:
            (one, std), (other, other_std) = posterior((0, 1)), posterior((1, 0))
        np.testing.assert_allclose(one / std, other / std, atol=close)
        np.testing.assert_allclose(std, other_std, rtol=close)


def test_records_may_differ_in_step_and_noise(measured):
    model, own = driven_chain(), none_considered(driven_chain())
    fine = replace(model, h=H / 2, every=2)
    known = held_of(1)
    halved = np.repeat(known, 2, axis=0)
    P = driven_start()

    def posterior(second, held):
        records = [GridRecord(model, np.zeros(6), P, held_of(0), measured[0], own)]
        records.append(GridRecord(second, np.zeros(6), P, held, measured[1], own))
        grid_runs = filter_records(records)
        assert grid_runs[1].run.time[-1] == pytest.approx(LENGTHS[1] * H)
        return grid_runs[0].posterior

    (mean, covariance), (other, finer) = posterior(model, known), posterior(fine, halved)
    std = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(mean / std, other / std, atol=0.02)
    np.testing.assert_allclose(std, np.sqrt(np.diag(finer)), rtol=0.02)


GAIN = 0.02


def gains():
    """Both gauges read too much by 2 % of what they read, each by its own."""
    D = np.zeros((2, 2, 4))
    D[[0, 1], [0, 1], :2] = GAIN * ROWS
    return ConsideredParameters(("gain 1", "gain 2"), D, np.zeros((2, 2, 1)), np.zeros((2, 2)), learned=False)


def slow(steps=STEPS):
    """A known force that the chain follows at rest: what it strains is force over stiffness."""
    held = np.zeros((steps, 3, 1))
    force = 1.5 * (1 - np.cos(np.pi * np.arange(steps + 1) / steps))
    held[:, 0, 0], held[:, 1, 0] = force[:-1], np.diff(force)
    return held


def driven(noise):
    whole = driven_chain(noise, ("k1",))
    whole = replace(whole, Q=np.zeros_like(whole.Q), h=25 * H, r=25 * whole.r)
    return whole, np.diag([1e-12, 1e-12, 1e-12, 1e-12, 0.3**2])


def stiffness_of(model, P, y, renewed=()):
    own = split_by_record(gains(), len(y), renewed)
    first = model, np.zeros(len(P)), P
    records = [GridRecord(*first, slow(), each, its) for each, its in zip(y, own, strict=True)]
    mean, covariance = filter_records(records)[0].posterior
    return float(mean[0]), float(np.sqrt(covariance[0, 0]))


def test_shared_gauge_errors_do_not_average_out():
    """Quiet readings, whose gains are all that is not known: F/k is, and ln k with σ of the gain."""
    model, P = driven(2e-5)
    _, y = draw_truth(model, np.zeros(5), np.diag([*np.diag(P)[:4], 1e-30]), slow(), range(4))
    records = [y[:, 0]] * 4
    alone, shared = stiffness_of(model, P, records[:1])[1], stiffness_of(model, P, records)[1]
    apart = stiffness_of(model, P, records, renewed=("gain 1", "gain 2"))[1]
    assert alone == pytest.approx(GAIN, rel=0.05)
    assert shared == pytest.approx(GAIN, rel=0.05)
    assert apart == pytest.approx(GAIN / 2, rel=0.05)


@pytest.mark.slow
def test_sigma_of_campaign_is_calibrated():
    model, P = driven(1e-4)
    off = []
    rng = np.random.default_rng(3)
    for campaign_ in range(120):
        start_ = P.copy()
        p = 0.3 * rng.standard_normal()
        start_[4, 4] = 1e-30
        truth, y = draw_truth(model, np.array([0, 0, 0, 0, p]), start_, slow(), range(3 * campaign_, 3 * campaign_ + 3))
        gain = GAIN * rng.standard_normal(2)
        read = [y[:, r] + gain * (truth[1:, r, :2] @ ROWS.T) for r in range(3)]
        mean, std = stiffness_of(model, P, read)
        off.append((mean - p) / std)
    off = np.array(off)
    assert 0.90 <= np.mean(np.abs(off) < 2) <= 0.98
    assert 0.85 <= np.sqrt(np.mean(off**2)) <= 1.15


def test_record_outside_model_is_refused():
    model, P = driven(1e-4)
    _, y = draw_truth(model, np.zeros(5), P, slow(), range(2))
    with pytest.raises(NumericalError):
        stiffness_of(model, P, [y[:, 0], 1e9 * y[:, 1]])


def test_birge_ratio_root_two_halves_information(measured):
    """ln p(y, y | θ) / 2 = ln p(y | θ)."""
    record = GridRecord(chain(), np.zeros(7), start(), held_of(0), measured[0], none_considered(chain()))
    with finer(0.5, 14.0):
        one = filter_records([record])[0]
        two = filter_records([record, record], birge_ratio=np.sqrt(2))[0]
    assert two.grid_count < FOLLOWED
    std = np.sqrt(np.diag(one.posterior[1]))
    np.testing.assert_allclose(two.posterior[0], one.posterior[0], atol=2e-3 * std.min())
    np.testing.assert_allclose(two.posterior[1], one.posterior[1], atol=5e-3 * std.min() ** 2)
