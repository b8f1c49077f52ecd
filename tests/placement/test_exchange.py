"""After the swaps no single swap helps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from strainsight.placement.baselines import random_sets
from strainsight.placement.elimination import eliminate
from strainsight.placement.exchange import exchange
from strainsight.placement.limits import limits_of
from strainsight.placement.scenario import Scenario, solve_pool
from strainsight.placement.score import score


@pytest.mark.parametrize(("aggregate", "instants"), [("mean", (63,)), ("mean", (55, 871)), ("worst", (55, 871))])
def test_no_single_swap_helps_any_more(beam_of, scenarios_of, aggregate, instants):
    scenarios = scenarios_of(beam_of(16, 5), ("Fz",), ("E",), instants=instants)
    pools = eliminate(scenarios, 4, aggregate).pools
    start = random_sets(16, 4, 1, seed=8)[0]
    found = exchange(pools, start, aggregate)
    assert found.complete
    assert len(found.swaps) == len(found.cost) - 1 > 0
    assert all(b < a for a, b in zip(found.cost, found.cost[1:], strict=False))
    present = score(pools, found.gauges, aggregate)
    assert abs(present - found.cost[-1]) < 1e-8 * present
    for out in found.gauges:
        for into in set(range(16)) - set(found.gauges.tolist()):
            other = sorted({*found.gauges.tolist(), into} - {int(out)})
            assert score(pools, other, aggregate) >= present * (1 - 2e-9)


def test_bonded_gauges_are_not_swapped_and_a_limit_is_kept(beam_of, scenarios_of):
    pools = eliminate(scenarios_of(beam_of(30), ("Fz",), ("E",)), 4).pools
    start = random_sets(30, 4, 1, seed=3)[0]
    bonded = [int(start[0]), int(start[2])]
    assert set(bonded) <= set(exchange(pools, start, fixed=bonded).gauges.tolist())
    stopped = exchange(pools, start, limit=1)
    assert not stopped.complete
    assert stopped.cost[-1] <= stopped.cost[0]


@pytest.mark.parametrize("instants", [(63,), (55, 871)])
def test_the_limit_is_never_passed_and_never_passes_for_an_end(beam_of, scenarios_of, instants):
    pools = eliminate(scenarios_of(beam_of(16, 5), ("Fz",), ("E",), instants=instants), 4).pools
    start = random_sets(16, 4, 1, seed=8)[0]
    whole = exchange(pools, start)
    assert whole.complete
    assert len(whole.swaps) > 0
    for limit in range(0, whole.solves, 3):
        stopped = exchange(pools, start, limit=limit)
        assert stopped.solves <= limit
        assert not stopped.complete
        assert stopped.swaps == whole.swaps[: len(stopped.swaps)]
    exact = exchange(pools, start, limit=whole.solves)
    assert exact.complete
    assert exact.swaps == whole.swaps


def test_an_undetectable_start_is_a_mistake_of_the_caller(beam_of, scenarios_of):
    pools = eliminate(scenarios_of(beam_of(10), ("Fz",), ("E",)), 4).pools
    with pytest.raises(ValueError, match="detects every unknown"):
        exchange(pools, [3])


def test_beside_gauges_that_may_not_leave_room_is_filled(beam_of, scenarios_of):
    """Every gauge is bonded and the budget has room for two: two are added, each lowers the cost, and no more is tried."""
    pools = eliminate(scenarios_of(beam_of(12), ("Fz",), ("E",)), 4).pools
    bonded = [1, 5, 7]
    limits = limits_of(12, 6, fixed=bonded, price=np.ones(12), budget=5.0)
    found = exchange(pools, bonded, limits=limits)
    assert [out for out, _ in found.swaps] == [-1, -1]
    assert len(found.gauges) == 5
    assert set(bonded) <= set(found.gauges.tolist())
    assert found.cost[0] > found.cost[1] > found.cost[2]
    assert found.complete
    full = exchange(pools, found.gauges, limits=limits, fixed=found.gauges.tolist())
    assert (full.swaps, full.solves, full.complete) == ((), 0, True)


def swaps_in_words(oracle, pools, chosen, aggregate, limits):
    """The swaps of the docstring of `exchange`, every number from an oracle; and how many covariances they ask for."""
    combine = {"mean": np.mean, "worst": np.max}[aggregate]
    known = {}

    def at(gauges):
        """Costs (scenarios,) of a set, and φ (scenarios, pool)."""
        if tuple(gauges) not in known:
            costs, phi = [], []
            for pool in pools:
                s, rows = pool.scenario, pool.stacked(np.array(gauges))
                P = oracle(s, gauges)
                X = solve_continuous_lyapunov((s.F - P @ rows.T @ rows).T, -np.diag(s.weight))
                costs.append(s.weight @ np.diag(P))
                phi.append([np.trace(h @ P @ X @ P @ h.T) for h in pool.rows])
            known[tuple(gauges)] = np.array(costs), np.array(phi)
        return known[tuple(gauges)]

    def next_swap(solves):
        costs, phi = at(chosen)
        enough = combine(costs) * (1 - 1e-6)
        may_leave = [i for i in chosen if i not in limits.fixed]
        promise = {}
        for j in set(range(phi.shape[1])) - set(chosen):
            room = limits.allows(np.array([*chosen, j]))
            promise[j] = combine(costs - phi[:, j] + (0 if room else phi[:, may_leave].min(axis=1)))
        for j in sorted(promise, key=promise.get):
            grown = sorted([*chosen, j])
            without = {i: [g for g in grown if g != i] for i in may_leave}
            if limits.allows(np.array(grown)):
                without = {-1: grown}
            without = {i: rest for i, rest in without.items() if limits.allows(np.array(rest))}
            if promise[j] >= enough or not without:
                continue
            solves += len(pools)
            costs, phi = at(grown)
            bound = {i: combine(costs + (phi[:, i] if i >= 0 else 0)) for i in without}
            for i in sorted(bound, key=bound.get):
                if bound[i] < enough:
                    solves += len(pools) * (i >= 0)
                    if combine(at(without[i])[0]) < enough:
                        return (i, j), without[i], solves
        return None, chosen, solves

    swaps, solves = [], 0
    while True:
        swap, chosen, solves = next_swap(solves)
        if swap is None:
            return swaps, solves
        swaps.append(swap)


WITHIN = {
    "count": {},
    "spacing": {"near": np.array([(0, 3), (1, 6), (6, 9), (2, 8), (4, 5), (5, 10), (7, 11), (0, 7)])},
    "budget": {"price": np.tile([2.0, 1.0, 0.5], 4), "budget": 5.0},
    "pairs": {"size": np.tile([1, 2], 6)},
}


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
@pytest.mark.parametrize("case", WITHIN)
def test_the_swaps_are_those_of_its_words_and_no_more_is_solved(oracle, beam_of, scenarios_of, case, aggregate):
    scenarios = scenarios_of(beam_of(12, 2, seed=4), ("Fz",), ("E",), instants=(55, 871))
    pools = [solve_pool(s) for s in scenarios]
    rng = np.random.default_rng(1)
    made = 0
    for fixed in ((), (4,)):
        limits = limits_of(12, 4, fixed=fixed, **WITHIN[case])
        start = limits.packed(rng.permutation(12), np.array(fixed, dtype=int))
        found = exchange(pools, start, aggregate, limits=limits)
        swaps, solves = swaps_in_words(oracle, pools, start.tolist(), aggregate, limits)
        assert list(found.swaps) == swaps
        assert found.solves == solves
        assert found.complete
        made += len(swaps)
    assert made > 1


def test_gauges_that_are_equal_are_not_swapped_for_each_other(beam_of, scenarios_of):
    (scenario,) = scenarios_of(beam_of(6, 2), ("Fz",), ("E",))
    twice = Scenario(scenario.F, scenario.Q, np.tile(scenario.H, (2, 1)), np.tile(scenario.r, 2), scenario.weight)
    pools = [solve_pool(twice)]
    best = exchange(pools, [0, 1, 2]).gauges
    mirrored = np.sort((best + 6) % 12)
    for gauges in (best, mirrored):
        again = exchange(pools, gauges, limit=500)
        assert again.complete
        assert again.swaps == ()


def test_a_swap_that_loses_an_unknown_is_no_swap_and_counts_up_to_the_scenario_that_loses_it():
    """Two walks; 1 and 2 see the second one, 2 far better, and 1 is bonded: 2 for 0 promises much, but 0 alone sees the
    first walk. Where 2 sees that, too, in the first of two scenarios, it is lost in the second one only."""
    H = np.array([[[1.0, 0]], [[0, 1.0]], [[0, 1.0]]])
    sees_both = np.concatenate([H, [[[0, 0.0]]] * 3], axis=1)
    sees_both[2, 1, 0] = 1.0
    H = np.concatenate([H, np.zeros_like(H)], axis=1)
    r = np.array([1.0, 1.0, 1e-6])[:, None] * np.ones(2)
    one, both = (solve_pool(Scenario(np.zeros((2, 2)), np.eye(2), h, r, np.ones(2))) for h in (H, sees_both))
    for pools, solves in (([one, one], 3), ([one, both], 3), ([both, one], 4)):
        found = exchange(pools, [0, 1], fixed=[1])
        assert found.swaps == ()
        assert found.complete
        assert found.solves == solves
