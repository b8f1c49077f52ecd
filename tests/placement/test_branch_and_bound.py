"""Branch and bound ends with the set that exhaustive search finds, and never claims more than is so."""

from __future__ import annotations

from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.errors import InfeasibleError, NumericalError
from strainsight.placement import branch_and_bound as module
from strainsight.placement import nodes as room
from strainsight.placement.branch_and_bound import branch_and_bound
from strainsight.placement.cuts import cut_at
from strainsight.placement.elimination import eliminate
from strainsight.placement.scenario import Scenario, solve_pool
from strainsight.placement.score import score


def agrees(found, costs):
    """The best set or a tie with it; its cost to the digits of the oracle; a bound below the optimum, as close as claimed."""
    best, runner_up = sorted([*costs.values(), np.inf])[:2]
    mine = costs[tuple(found.gauges.tolist())]
    assert mine <= best * (1 + 1e-6)
    if runner_up > best * (1 + 2e-6):
        assert found.gauges.tolist() == list(min(costs, key=costs.get))
    np.testing.assert_allclose(found.cost, mine, rtol=1e-7)
    assert found.proven
    assert found.lower_bound <= best * (1 + 1e-9)
    assert found.lower_bound >= found.cost * (1 - 1.001e-6)


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
def test_a_bad_start_is_left_for_the_optimum_and_out_of_time_there_is_a_set_and_a_bound(
    every_set, beam_of, scenarios_of, aggregate
):
    scenarios = scenarios_of(beam_of(11, 2, seed=1), ("Fz", "Fy"), ("E",), instants=(63, 260))
    pools = [solve_pool(s) for s in scenarios]
    costs = every_set(pools, 3, aggregate)
    worst = max(costs, key=costs.get)
    found = branch_and_bound(pools, 3, aggregate, start=worst)
    agrees(found, costs)
    hasty, best = branch_and_bound(pools, 3, aggregate, time_limit=0.0), min(costs.values())
    assert hasty.nodes == 1 < found.nodes
    assert not hasty.proven
    assert 0.5 * best < hasty.lower_bound <= best * (1 + 1e-9)
    assert found.lower_bound > hasty.lower_bound
    np.testing.assert_allclose(hasty.cost, costs[tuple(hasty.gauges.tolist())], rtol=1e-7)
    with pytest.raises(ValueError, match="3 different gauges"):
        branch_and_bound(pools, 3, start=[1, 2, 2])
    with pytest.raises(ValueError, match="the fixed ones among them"):
        branch_and_bound(pools, 3, start=worst, fixed=[next(g for g in range(11) if g not in worst)])


def test_out_of_time_before_any_set_it_says_so(monkeypatch, six_loads):
    """The greedy way is a dead end, and the first node halves before it meets a set."""
    pools = [solve_pool(six_loads)]

    def dead_end(*_, **__):
        raise InfeasibleError("no way on", remedy="none")

    monkeypatch.setattr(module, "eliminate_from", dead_end)
    monkeypatch.setattr(room.Search, "_round", lambda *_: None)
    found = branch_and_bound(pools, 2, time_limit=0.0)
    assert len(found.gauges) == 0
    assert found.cost == np.inf
    assert not found.proven
    assert found.nodes == 1
    started = branch_and_bound(pools, 2, start=[1, 2], time_limit=0.0)
    whole = branch_and_bound(pools, 2)
    assert started.gauges.tolist() == whole.gauges.tolist() == [1, 2]
    assert whole.proven
    assert found.lower_bound <= whole.cost


def test_a_set_that_cannot_be_solved_is_not_claimed_to_be_worse(every_set, beam_of, scenarios_of, monkeypatch):
    pools = [solve_pool(s) for s in scenarios_of(beam_of(10, 2, seed=2), ("Fz",), ("E",))]
    costs = every_set(pools, 3, "mean")
    best, second = sorted(costs, key=costs.get)[:2]

    def unsolved(pools, gauges, aggregate):
        if tuple(int(g) for g in gauges) == best:
            raise NumericalError("not solved")
        return score(pools, gauges, aggregate)

    monkeypatch.setattr(room, "score", unsolved)
    found = branch_and_bound(pools, 3)
    assert tuple(found.gauges.tolist()) == second
    assert not found.proven
    assert found.lower_bound <= costs[best] * (1 + 1e-9)


def test_no_proof_claims_more_than_a_tie(beam_of, scenarios_of, every_set):
    """A set that is better by less than 1e-6 is not taken, so that no bound may come closer, whatever gap is asked for."""
    pools = eliminate(scenarios_of(beam_of(7), ("Fz",), ("E",)), 3).pools
    found = branch_and_bound(pools, 3, gap=0.0, time_limit=60.0)
    assert found.proven
    assert found.lower_bound <= found.cost * (1 - 1e-6)
    assert found.lower_bound <= min(every_set(pools, 3, "mean").values()) <= found.cost * (1 + 1e-9)


def test_twins_are_not_searched_twice(every_set, beam_of, scenarios_of):
    (scenario,) = scenarios_of(beam_of(6, 2), ("Fz",), ("E",))
    twice = np.concatenate([np.arange(6), np.arange(6)])
    sign = np.repeat([1.0, -1.0], 6)[:, None]
    doubled = Scenario(scenario.F, scenario.Q, sign * scenario.H[twice], scenario.r[twice], scenario.weight)
    pools = [solve_pool(doubled)]
    agrees(branch_and_bound(pools, 4), every_set(pools, 4, "mean"))
    agrees(
        branch_and_bound(pools, 4, fixed=[8]),
        {gauges: cost for gauges, cost in every_set(pools, 4, "mean").items() if 8 in gauges},
    )


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
@pytest.mark.parametrize("seed", range(2))
def test_the_search_needs_no_swaps(every_set, aggregate, seed, monkeypatch):
    """Three states and rows of small integers, from the worst set of all: what it finds, it finds itself."""
    rng = np.random.default_rng(seed)
    F, H = -np.diag(rng.integers(1, 10, (2, 3))[0].astype(float)), 10.0 * rng.integers(-3, 4, (9, 3))
    scenarios = [Scenario(F * f, np.eye(3), H, np.full(9, 0.1), np.ones(3)) for f in (1.0, 3.0)]
    pools = [solve_pool(s) for s in scenarios]
    costs = every_set(pools, 3, aggregate)
    monkeypatch.setattr(room, "exchange", lambda pools, gauges, *rest, **more: SimpleNamespace(gauges=gauges))
    found = branch_and_bound(pools, 3, aggregate, start=max(costs, key=costs.get))
    agrees(found, costs)
    # a clock that ticks once a look
    monkeypatch.setattr(module, "monotonic", count().__next__)
    stopped = branch_and_bound(pools, 3, aggregate, start=max(costs, key=costs.get), time_limit=2)
    assert stopped.nodes == min(2, found.nodes)
    assert stopped.lower_bound <= min(costs.values()) * (1 + 1e-9)
    assert stopped.cost >= min(costs.values()) * (1 - 1e-9)


def test_a_cut_touches_the_cost_and_stays_below_it(beam_of, scenarios_of):
    pools = [solve_pool(s) for s in scenarios_of(beam_of(10, 3), ("Fz",), ("E",), instants=(55, 260))]
    rng = np.random.default_rng(2)
    weights = rng.uniform(0.1, 1, (5, 10))
    cuts = [cut_at(pools, w, None) for w in weights]
    for cut, w in zip(cuts, weights, strict=True):
        np.testing.assert_allclose(cut.offset + cut.slope @ w, cut.cost, rtol=1e-9)
        for other, v in zip(cuts, weights, strict=True):
            assert np.all(cut.offset + cut.slope @ v <= other.cost * (1 + 1e-9))
        slope = [
            (cut_at(pools, w + 1e-4 * e, None).cost - cut_at(pools, w - 1e-4 * e, None).cost) / 2e-4 for e in np.eye(10)
        ]
        np.testing.assert_allclose(cut.slope.T, slope, rtol=1e-4, atol=1e-7)
    assert cut_at(pools, np.eye(10)[3], None) is None
