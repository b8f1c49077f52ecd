"""Scenarios in their slow motions: statics exact, σ as it was, modes of one frequency together, the layouts of all motions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.placement.certificate import certify
from strainsight.placement.elimination import eliminate_from
from strainsight.placement.exchange import exchange
from strainsight.placement.scenario import Scenario, solve_pool
from strainsight.placement.score import score
from strainsight.placement.slow_motions import AGREES, LARGE, in_slow_motions, of_last_states, slow_pools

MODES = 34
"""And the static response to a tip force, which takes one coordinate more."""


@pytest.fixture(scope="module")
def scenarios(beam_of, scenarios_of):
    beam = beam_of(12, MODES, seed=5)
    return scenarios_of(beam, ("Fz",), ("E",), instants=(63, 125))


@pytest.fixture(scope="module")
def pools(scenarios):
    return tuple(solve_pool(own) for own in scenarios)


def found_in(pools):
    size = len(pools[0].P)
    return slow_pools(pools, (size - 2) // 2, np.array([size - 2, size - 1]))


def slow_metric(pools, slow):
    """The slow pools by the metric of the whole ones."""
    metrics = [pool.metric.scaled(1 / pool.scale) for pool in pools]
    return [own.under(of_last_states(metric, len(own.P))) for own, metric in zip(slow, metrics, strict=True)]


@pytest.mark.parametrize("count", [3, 8, 20])
def test_what_steady_loads_and_parameters_do_to_readings_is_exact(scenarios, count):
    own, motions = scenarios[0], MODES + 1
    slow = in_slow_motions(own, motions, count)
    for scenario, n in ((own, motions), (slow, (len(slow.F) - 2) // 2)):
        moving = slice(0, 2 * n)
        at_rest = -np.linalg.solve(scenario.F[moving, moving], scenario.F[moving, 2 * n :])
        read = scenario.H[:, moving] @ at_rest + scenario.H[:, 2 * n :]
        if scenario is own:
            expected = read
    np.testing.assert_allclose(read, expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max())


def test_slow_motions_are_the_modes_of_the_lowest_frequencies(scenarios):
    slow = in_slow_motions(scenarios[0], MODES + 1, 6)
    n = (len(slow.F) - 2) // 2
    every = np.sort(np.linalg.eigvals(-scenarios[0].F[MODES + 1 : 2 * MODES + 2, : MODES + 1]).real)
    own = np.sort(np.linalg.eigvals(-slow.F[n : 2 * n, :n]).real)
    np.testing.assert_allclose(own, every[:6], rtol=1e-6)


def test_modes_of_one_frequency_stay_together():
    A = np.diag([1.0, 4.0, 4.0, 9.0])
    turn, _ = np.linalg.qr(np.random.default_rng(1).standard_normal((4, 4)))
    F = np.zeros((9, 9))
    F[:4, 4:8], F[4:8, :4], F[4:8, 4:8] = np.eye(4), -turn @ A @ turn.T, -0.1 * np.eye(4)
    F[4:8, 8] = 1.0
    scenario = Scenario(F, np.diag([0.0] * 4 + [0.1] * 5), np.ones((2, 9)), np.ones(2), np.zeros(9))
    assert len(in_slow_motions(scenario, 4, 2).F) == 2 * 3 + 1
    assert in_slow_motions(scenario, 4, 4) is scenario


def test_sigma_of_any_set_of_gauges_is_that_of_all_motions(pools, oracle):
    slow = found_in(pools)
    assert len(slow[0].P) < 0.7 * len(pools[0].P)
    rng = np.random.default_rng(2)
    for own, whole in zip(slow, pools, strict=True):
        for count in (12, 8, 4, 3):
            chosen = sorted(rng.choice(12, count, replace=False).tolist())
            quick, full = (np.sqrt(np.diag(oracle(p.scenario, chosen))[-2:]) * p.scale[-2:] for p in (own, whole))
            np.testing.assert_allclose(quick, full, rtol=1.5 * AGREES)


def test_search_in_slow_motions_ends_where_that_in_all_ends(pools):
    slow = slow_metric(pools, found_in(pools))
    costs = []
    for searched in (slow, pools):
        kept = eliminate_from(searched, 4).kept
        costs.append(score(pools, exchange(searched, kept).gauges, "mean"))
    assert costs[0] == pytest.approx(costs[1], rel=2 * AGREES)


def test_a_bound_that_begins_at_the_optimum_of_the_slow_motions_is_one_of_all(pools):
    slow = slow_metric(pools, found_in(pools))
    gauges = exchange(pools, eliminate_from(pools, 4).kept).gauges
    cost = score(pools, gauges, "mean")
    plain = certify(pools, gauges, cost)
    near = certify(slow, gauges, score(slow, gauges, "mean"))
    begun = certify(pools, gauges, cost, start=near.weights)
    assert begun.lower_bound == pytest.approx(plain.lower_bound, rel=3e-4)
    assert begun.lower_bound <= plain.relaxed
    assert begun.iterations < plain.iterations


def test_small_models_and_those_with_nothing_quick_are_searched_as_they_are(beam_of, scenarios_of):
    small = tuple(solve_pool(own) for own in scenarios_of(beam_of(12), ("Fz",), ("E",)))
    assert len(small[0].P) <= LARGE
    assert found_in(small) is small
    quick = scenarios_of(beam_of(24, MODES, seed=5), ("Fz",), ("E",), noise=1e-10, h=1e-6)
    kept = found_in(tuple(solve_pool(replace(own, Q=1e6 * own.Q)) for own in quick))
    assert len(kept[0].P) == len(quick[0].F)
