"""Histories drawn from the smoothed posterior: what the smoother claims at every instant, and how instants belong together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag

from strainsight.damage import Curve, damage_of, interval_of
from strainsight.estimation.conditional import none_considered
from strainsight.estimation.filter import run_filter
from strainsight.estimation.grid_filter import filter_on_grid
from strainsight.estimation.grid_filter_smoother import sample_paths, smooth_on_grid
from strainsight.estimation.record import GridRecord
from strainsight.estimation.reduced import driven_with_offsets
from strainsight.estimation.smoother import smooth, smoother_errors

from ..shared import slowly
from .chain import forces, loaded_chain, states
from .chain import start as chain_start
from .truth import draw_truth
from .two_masses import REFERENCE, believed, chain, constants, start
from .two_masses import forces as both_forces

STEPS, COUNT = 25, 2500
SAMPLING = 5.0 / np.sqrt(COUNT)
"""Five standard deviations of a mean of draws, in those of a draw; of a ratio of σ they are 1/√2 of it."""
P = chain_start()[:5, :5]


def measured(model, known, first, mean):
    _, y = draw_truth(model, mean, first, known, [3])
    y = y[:, 0].copy()
    y[7, 0], y[15] = np.nan, np.nan
    return y


def dense(model, y):
    """Covariance of the whole history (STEPS + 1)·5 given the samples, by conditioning one normal vector."""
    _, O, rows, Q = states(np.zeros(2), forces(STEPS), np.diag(model.Q))
    prior, rows = O @ block_diag(P, *[Q] * STEPS) @ O.T, rows[np.isfinite(y).ravel()]
    gain = prior @ rows.T @ np.linalg.inv(rows @ prior @ rows.T + model.noise[0] * np.eye(len(rows)))
    return prior - gain @ rows @ prior


@pytest.mark.parametrize("by", ["grid", "moments"])
def test_sampled_paths_match_joint_posterior(by):
    model, known = loaded_chain(), forces(STEPS)
    y = measured(model, known, P, np.zeros(5))
    expected = dense(model, y)
    if by == "grid":
        none = none_considered(model)
        grid_run = filter_on_grid(GridRecord(model, np.zeros(5), P, known, y, none))
        parts = sample_paths(GridRecord(model, np.zeros(5), P, known, y, none), grid_run, COUNT, 1)
        x = np.concatenate([part.state for part in parts])
        middle = smooth_on_grid(GridRecord(model, np.zeros(5), P, known, y, none), grid_run).mean[:, 0]
    else:
        run = run_filter(model, np.zeros(5), P, known, y, "all")
        x = smoother_errors(driven_with_offsets(model, known), run, COUNT, np.random.default_rng(1))
        x, middle = x + smooth(model, run).mean[None, :, 0], smooth(model, run).mean[:, 0]
    std = np.sqrt(np.diag(expected))
    assert np.abs((x.mean(axis=0) - middle).ravel() / std).max() < SAMPLING
    off = (x - middle).reshape(COUNT, -1) / std
    assert np.abs(off.T @ off / COUNT - expected / np.outer(std, std)).max() < 1.5 * SAMPLING


def drawn_paths(model, known, own):
    """The grid filter, what its smoother claims, and histories (COUNT, T + 1, n) and parameters (COUNT, k) drawn from it."""
    first, mean = start(model.size), believed(model)
    given = model, mean, first, known, measured(model, known, first, mean), own
    grid_run = filter_on_grid(GridRecord(*given))
    parts = list(sample_paths(GridRecord(*given), grid_run, COUNT, 1))
    x, p = (np.concatenate([getattr(part, name) for part in parts]) for name in ("state", "parameter"))
    return given, grid_run, smooth_on_grid(GridRecord(*given), grid_run), x, p


@pytest.mark.parametrize("learned", [*slowly(False), True])
def test_sampled_paths_match_smoother_moments(learned):
    model, known = chain(("k1", "k2")), both_forces()[:, :, :1]
    own = replace(constants(model), learned=learned)
    *_, claimed, x, p = drawn_paths(model, known, own)
    assert claimed.covariance is not None
    whole = np.concatenate([x, np.repeat(p[:, None], x.shape[1], axis=1)], axis=2)
    off = (whole - claimed.mean[:, 0]) / claimed.std[:, 0]
    assert np.abs(off.mean(axis=0)).max() < SAMPLING
    expected = claimed.covariance[:, 0] / (claimed.std[:, 0, :, None] * claimed.std[:, 0, None, :])
    found = np.einsum("nta,ntc->tac", off, off, optimize=True) / COUNT
    assert np.abs(found - expected).max() < 1.5 * SAMPLING


@pytest.mark.parametrize(("parameters", "learned"), [((), False), (("k1",), True)])
def test_sampled_truncation_matches_smoother(parameters, learned):
    """z = ν u of a known and of an unknown load, behind the states; of the known load its history times one normal number."""
    model, known = chain(parameters), both_forces()[:, :, :1]
    both = constants(model)
    changes = np.array([[[0.05, 0.0], [0.0, 0.0]], [[0.0, 0.02], [0.0, 0.03]]])
    rows = [np.concatenate([np.zeros((2, *own.shape[1:])), own]) for own in (both.D, both.E, both.offset)]
    own = replace(
        both, source=("load", "load", *both.source), D=rows[0], E=rows[1], offset=rows[2], shape=changes,
        load=np.array([0, 1]), behind=True, learned=learned,
    )  # fmt: skip
    *_, claimed, x, _ = drawn_paths(model, known, own)
    n = model.parameter_states.start
    at = np.concatenate([np.arange(n), [-2, -1]])
    std = np.where(claimed.std[:, 0, at] > 0, claimed.std[:, 0, at], 1.0)
    off = (x - claimed.mean[:, 0, at]) / std
    assert np.abs(off.mean(axis=0)).max() < SAMPLING
    assert claimed.covariance is not None
    expected = claimed.covariance[:, 0][:, at[:, None], at] / (std[:, :, None] * std[:, None, :])
    found = np.einsum("nta,ntc->tac", off, off, optimize=True) / COUNT
    assert np.abs(found - expected).max() < 1.5 * SAMPLING
    force = np.concatenate([known[:, 0, 0], known[-1:, :, 0].sum(axis=1)])
    which = n + model.model.inputs.index(model.known_inputs[0])
    nu = x[:, -1, which] / force[-1]
    np.testing.assert_allclose(x[:, :, which], np.outer(nu, force), atol=1e-9 * np.abs(x[:, :, which]).max())
    assert nu.std() == pytest.approx(1.0, abs=4 * SAMPLING) if not learned else nu.std() < 1.0


def test_sampled_motion_matches_smoother_at_parameters():
    """At a parameter two standard deviations off, against smoothing there: within a twentieth of σ."""
    model, known = chain(("k1",)), both_forces()[:, :, :1]
    given, grid_run, claimed, x, p = drawn_paths(model, known, none_considered(model))
    centre, spread = grid_run.posterior
    for side in (2.0, -2.0):
        there = centre + side * np.sqrt(spread[0])
        points = {"point": np.array([there - 1e-6, there + 1e-6]), "weight": np.full(2, 0.5)}
        narrow = replace(grid_run, **points, nu=np.zeros((2, 0)), left=np.zeros((2, 0, 0)))
        exact = smooth_on_grid(GridRecord(*given), narrow).mean[:, 0, :5]
        z = (p[:, 0] - centre[0]) / np.sqrt(spread[0, 0])
        near = np.abs(z - side) < 0.1
        off = (x[near].mean(axis=0) - exact) / claimed.std[:, 0, :5]
        assert np.abs(off).max() < 0.05 + 5 / np.sqrt(near.sum())


def test_seed_determines_draws():
    model, known = loaded_chain(), forces(STEPS)
    y, none = measured(model, known, P, np.zeros(5)), none_considered(model)
    grid_run = filter_on_grid(GridRecord(model, np.zeros(5), P, known, y, none))

    def drawn(seed, **more):
        return next(sample_paths(GridRecord(model, np.zeros(5), P, known, y, none), grid_run, 50, seed, **more)).state

    np.testing.assert_array_equal(drawn(1), drawn(1))
    np.testing.assert_array_equal(drawn(1)[:, :, :2], drawn(1, states=slice(0, 2)))
    assert np.abs(drawn(1) - drawn(2)).max() > 0


RECORDS, DRAWS = 100, 60
CURVE = Curve(1.0, 2e6, 5.0)


def spring_forces(x, p):
    """k₁q₁ and k₂(q₂ − q₁) (2, T + 1) of a history (T + 1, n), k₁ that of the draw."""
    return np.stack([REFERENCE["k1"] * np.exp(p) * x[:, 0], REFERENCE["k2"] * (x[:, 1] - x[:, 0])])


@pytest.mark.slow
def test_interval_contains_truth_in_95_percent():
    """Damage in both springs of truths of the filter's own model; that of the smoothed history is too small in most."""
    model, known = chain(("k1",)), both_forces()[:, :, :1]
    none, first, mean = none_considered(model), start(model.size), np.zeros(model.size)
    inside, low = [], []
    for record in range(RECORDS):
        x, y = draw_truth(model, mean, first, known, [1000 + record])
        true = damage_of(spring_forces(x[:, 0], x[-1, 0, -1]), CURVE).miner
        grid_run = filter_on_grid(GridRecord(model, mean, first, known, y[:, 0], none))
        drawn = [
            damage_of(spring_forces(own, p[0]), CURVE).miner
            for part in sample_paths(GridRecord(model, mean, first, known, y[:, 0], none), grid_run, DRAWS, record)
            for own, p in zip(part.state, part.parameter, strict=True)
        ]
        found = interval_of(np.array(drawn))
        inside.append((found.low <= true) & (true <= found.high))
        later = smooth_on_grid(GridRecord(model, mean, first, known, y[:, 0], none), grid_run).mean[:, 0]
        low.append(damage_of(spring_forces(later, later[-1, -1]), CURVE).miner < true)
    share = np.mean(inside, axis=0)
    assert (share >= 0.90).all(), share
    assert (share <= 0.99).all(), share
    assert np.mean(low) > 0.5
