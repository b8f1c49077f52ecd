"""Branch and bound ends with the set that exhaustive search finds, and never claims more than is so."""

from __future__ import annotations

from itertools import combinations, count, cycle
from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.errors import InfeasibleError, NumericalError
from strainsight.ordering import TIE
from strainsight.placement import branch_and_bound as module
from strainsight.placement import branch_and_bound as room
from strainsight.placement.branch_and_bound import Node, Search, branch_and_bound
from strainsight.placement.certificate import cut_at
from strainsight.placement.limits import limits_of
from strainsight.placement.scenario import Scenario, solve_pool
from strainsight.placement.score import score

from .conftest import COMBINED, beam_of, costs_of, every_set, pools_of, scenarios_of
from .whole_pools import eliminate


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
def test_a_bad_start_is_left_for_the_optimum_and_out_of_time_there_is_a_set_and_a_bound(aggregate):
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
    with pytest.raises(ValueError, match="contain the fixed gauges"):
        branch_and_bound(pools, limits_of(11, 3, fixed=[next(g for g in range(11) if g not in worst)]), start=worst)


def test_timeout_without_set_is_reported(monkeypatch, six_loads):
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


def test_a_set_that_cannot_be_solved_is_not_claimed_to_be_worse(monkeypatch):
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


def test_no_proof_claims_more_than_a_tie():
    pools = eliminate(scenarios_of(beam_of(7), ("Fz",), ("E",)), 3).pools
    found = branch_and_bound(pools, 3)
    assert found.proven
    assert found.lower_bound <= found.cost * (1 - 1e-6)
    assert found.lower_bound <= min(every_set(pools, 3, "mean").values()) <= found.cost * (1 + 1e-9)


def test_twins_are_not_searched_twice():
    (scenario,) = scenarios_of(beam_of(6, 2), ("Fz",), ("E",))
    twice = np.concatenate([np.arange(6), np.arange(6)])
    sign = np.repeat([1.0, -1.0], 6)[:, None]
    doubled = Scenario(scenario.F, scenario.Q, sign * scenario.H[twice], scenario.r[twice], scenario.weight)
    pools = [solve_pool(doubled)]
    agrees(branch_and_bound(pools, 4), every_set(pools, 4, "mean"))
    agrees(
        branch_and_bound(pools, limits_of(12, 4, fixed=[8])),
        {gauges: cost for gauges, cost in every_set(pools, 4, "mean").items() if 8 in gauges},
    )


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
@pytest.mark.parametrize("seed", range(2))
def test_the_search_needs_no_swaps(aggregate, seed, monkeypatch):
    rng = np.random.default_rng(seed)
    F, H = -np.diag(rng.integers(1, 10, (2, 3))[0].astype(float)), 10.0 * rng.integers(-3, 4, (9, 3))
    scenarios = [Scenario(F * f, np.eye(3), H, np.full(9, 0.1), np.ones(3)) for f in (1.0, 3.0)]
    pools = [solve_pool(s) for s in scenarios]
    costs = every_set(pools, 3, aggregate)
    monkeypatch.setattr(room, "exchange", lambda pools, gauges, *rest, **more: SimpleNamespace(gauges=gauges))
    found = branch_and_bound(pools, 3, aggregate, start=max(costs, key=costs.get))
    agrees(found, costs)
    monkeypatch.setattr(module, "monotonic", count().__next__)
    stopped = branch_and_bound(pools, 3, aggregate, start=max(costs, key=costs.get), time_limit=2)
    assert stopped.nodes == min(2, found.nodes)
    assert stopped.lower_bound <= min(costs.values()) * (1 + 1e-9)
    assert stopped.cost >= min(costs.values()) * (1 - 1e-9)


def test_a_cut_touches_the_cost_and_stays_below_it():
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


POOL, LEVELS, WEIGHT = 9, (1.0, 20.0), np.array([1.0, 4.0, 0.5])
SIZE = np.array([2, 1, 1, 2, 1, 1, 1, 2, 1])
LIMITS = {
    "count": lambda: limits_of(POOL, 4),
    "fixed": lambda: limits_of(POOL, 4, fixed=(2,)),
    "spacing": lambda: limits_of(POOL, 4, near=np.array([(0, 1), (1, 2), (4, 6), (7, 7)])),
    "pairs": lambda: limits_of(POOL, 5, size=SIZE, zones=[("place.at_most.0", np.arange(POOL) < 4, 2)]),
    "budget": lambda: limits_of(POOL, 6, price=np.array([3.0, 1, 2, 1, 2, 1, 0, 2, 1]), budget=5.0),
}


def wandering(H):
    return pools_of(H, LEVELS[: len(H)], WEIGHT[: H.shape[2]])


def cost(H, v, aggregate):
    return float(COMBINED[aggregate](costs_of(H, LEVELS, WEIGHT, v)))


def drawn(seed):
    return np.random.default_rng(seed).normal(size=(2, POOL, 3))


def mask(gauges):
    return np.isin(np.arange(POOL), gauges)


def layouts(H, limits, aggregate):
    """{gauges: cost} of everything that the limits allow."""
    every = [gauges for k in range(1, 7) for gauges in combinations(range(POOL), k) if limits.allows(np.array(gauges))]
    return {gauges: cost(H, mask(gauges), aggregate) for gauges in every}


@pytest.mark.parametrize(("case", "aggregate"), list(zip(LIMITS, cycle(["worst", "mean"]), strict=False)))
def test_halves_hold_every_better_layout_once_and_claim_no_more_than_their_best(case, aggregate, monkeypatch):
    H, limits = drawn(0), LIMITS[case]()
    pools, costs = wandering(H), layouts(drawn(0), limits, aggregate)
    search = Search(pools, limits, aggregate)
    search.best = np.array(max(costs, key=lambda g: costs[g] if costs[g] < np.inf else 0.0))
    search.cost = float(np.quantile([c for c in costs.values() if c < np.inf], 0.06))
    met = set()
    monkeypatch.setattr(search, "offer", lambda gauges, bound=0.0: met.add(tuple(gauges.tolist())))

    sets, value = list(costs), np.array(list(costs.values()))
    members = np.array([mask(gauges) for gauges in sets])

    def sets_of(node):
        return ~(node.inside & ~members).any(axis=1) & ~(node.outside & members).any(axis=1)

    def within(gauges):
        """What is in no half and costs less is part of a layout that was met: a gauge more never harms."""
        return any(set(gauges) <= set(other) for other in met)

    nodes, claims = [(-np.inf, search.root(mask(list(limits.fixed))))], 0
    for bound, node in nodes:
        halves = search.children(node, bound)
        missing = sets_of(node) & (value < search.target * (1 - 1e-9))
        for half_bound, half in halves:
            assert bound <= half_bound < search.target
            assert half_bound <= value[sets_of(half)].min(initial=np.inf) * (1 + 1e-9)
            claims += half_bound > bound
        kept = [sets_of(half) for _, half in halves]
        assert np.sum(kept, axis=0).max(initial=0) <= 1
        missing &= ~np.any([missing & False, *kept], axis=0)
        assert all(within(sets[i]) for i in np.flatnonzero(missing))
        nodes += halves
    assert claims > 0
    assert all(limits.allows(np.array(gauges)) for gauges in met)
    assert min(costs, key=costs.get) in met


@pytest.mark.parametrize("case", LIMITS)
def test_weights_are_moved_in_proportion_to_a_sum_that_is_allowed(case):
    limits, rng = LIMITS[case](), np.random.default_rng(1)
    seen = set()
    for _ in range(60):
        inside = mask(list(limits.fixed)) | (mask(rng.permutation(POOL)[:1]) if rng.random() < 0.5 else mask([]))
        free = ~inside & (rng.random(POOL) < 0.9)
        w = rng.uniform(0, 1, POOL) ** rng.choice([0.2, 1, 6])
        moved = room._within(w, inside, free, limits)
        np.testing.assert_array_equal(moved[inside], 1.0)
        np.testing.assert_array_equal(moved[~inside & ~free], 0.0)
        assert np.all((moved >= 0) & (moved <= 1 + 1e-12))
        before, after = limits.size @ np.where(inside, 1.0, w * free), limits.size @ moved
        if before > limits.keep:
            np.testing.assert_allclose(after, limits.keep)
            assert np.ptp(moved[free] / w[free]) < 1e-12
            seen.add("less")
        elif before < limits.least:
            np.testing.assert_allclose(after, limits.least)
            assert np.ptp((1 - moved[free]) / (1 - w[free])) < 1e-9
            seen.add("more")
        else:
            np.testing.assert_array_equal(moved[free], w[free])
            seen.add("as it was")
    assert "less" in seen
    assert ("more" in seen) == (limits.least > 0)


def test_the_most_fractional_gauge_is_branched_on_and_of_twins_the_lowest():
    H = drawn(2)
    H[:, 5], H[:, 8] = -H[:, 3], H[:, 3]
    limits = LIMITS["count"]()
    search = Search(wandering(H), limits, "mean")
    search.cost = 1e9
    assert len(np.unique(search.twins)) == POOL - 2
    centre = np.array([0.9, 0.1, 1.0, 0.8, 0.7, 0.45, 0.2, 0.0, 0.3])
    for outside, most, same in (([], 3, [3, 5, 8]), ([3], 5, [5, 8]), ([5], 4, [4]), ([3, 4, 5], 8, [8])):
        node = Node(mask([0]), mask(outside), (), centre)
        without, with_it = sorted(
            search._halves(node.inside, node.outside, 1.0, None, node), key=lambda half: half[1].inside.sum()
        )
        assert without[0] == with_it[0] == 1.0
        assert np.flatnonzero(with_it[1].inside).tolist() == sorted([0, most])
        np.testing.assert_array_equal(with_it[1].outside, node.outside)
        np.testing.assert_array_equal(without[1].inside, node.inside)
        assert np.flatnonzero(without[1].outside).tolist() == sorted([*outside, *same])


def test_gauges_that_the_limits_distinguish_are_no_twins():
    H = drawn(2)
    H[:, 5], H[:, 8] = -H[:, 3], H[:, 3]
    price = np.array([1.0] * 5 + [2.0] + [1.0] * 3)
    twins = Search(wandering(H), limits_of(POOL, 4, price=price, budget=6.0), "mean").twins
    assert twins[3] == twins[8] != twins[5]
    assert len(np.unique(twins)) == POOL - 1


def test_what_costs_less_is_taken_with_the_swaps_that_help_it():
    H, limits = drawn(4), LIMITS["count"]()
    costs = layouts(H, limits, "mean")
    search = Search(wandering(H), limits, "mean")
    assert (search.target, search.best) == (np.inf, None)
    start = max(costs, key=costs.get)
    search.offer(np.array(start))
    found = tuple(search.best.tolist())
    np.testing.assert_allclose(search.cost, costs[found], rtol=1e-9)
    assert search.target == search.cost * (1 - TIE)
    one_swap_away = [g for g in costs if len(set(g) & set(found)) == 3]
    assert all(costs[g] >= costs[found] * (1 - 1e-8) for g in one_swap_away)
    for worse in one_swap_away[:3]:
        search.offer(np.array(worse))
        assert tuple(search.best.tolist()) == found
    assert search.unsolved == np.inf


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
def test_the_largest_weights_are_offered_unless_the_cuts_say_that_they_cost_too_much(aggregate, monkeypatch):
    H, limits = drawn(5), LIMITS["spacing"]()
    pools = wandering(H)
    search, offered = Search(pools, limits, aggregate), []
    monkeypatch.setattr(search, "offer", lambda gauges: offered.append(gauges.tolist()))
    weights = np.array([0.9, 0.95, 0.2, 0.5, 0.8, 0.1, 0.85, 1.0, 0.3])
    # 7 may not be kept, 0 is too near to 1, 4 to 6
    packed, inside = [1, 3, 6, 8], mask([8])
    cuts = [cut_at(pools, w, None) for w in (np.full(POOL, 0.4), 0.2 + 0.6 * mask([0, 3, 4]))]
    planes = np.array([c.offset + c.slope @ mask(packed) for c in cuts])
    claimed = COMBINED[aggregate](planes.max(axis=0))
    assert claimed <= cost(H, mask(packed), aggregate)
    search.cost = claimed * (1 - 1e-5)
    search._round(cuts, weights, inside)
    assert offered == []
    search.cost = claimed * (1 + 1e-5)
    search._round(cuts, weights, inside)
    assert offered == [packed]
    search._round(cuts, weights, mask([0, 3, 4, 5, 8]))
    search.cost = np.inf
    assert offered == [packed]


def test_missing_cut_is_made_halfway_to_equal_weights():
    H = drawn(6)
    search = Search(wandering(H), LIMITS["count"](), "mean")
    inside, outside = mask([1]), mask([0, 2])
    free = ~(inside | outside)
    equal = np.where(inside, 1.0, np.where(free, 3 / 6, 0.0))
    alone = np.where(inside, 1.0, 0.0)
    good = np.where(free, 0.3, inside)
    for w, touched in ((good, good), (alone, 0.5 * (alone + equal))):
        (cut,) = search._cut(w, inside, free, None)
        np.testing.assert_allclose(np.mean(cut.cost), cost(H, touched, "mean"), rtol=1e-9)
    thin = np.where(free, 1e-6, inside)
    search.cost = cost(H, thin, "mean") / 50
    (cut,) = search._cut(thin, inside, free, None)
    np.testing.assert_allclose(np.mean(cut.cost), cost(H, thin, "mean"), rtol=1e-9)
    search.cost = cost(H, thin, "mean") / 300
    (cut,) = search._cut(thin, inside, free, None)
    np.testing.assert_allclose(np.mean(cut.cost), cost(H, 0.5 * (thin + equal), "mean"), rtol=1e-9)
    search.cost = cost(H, equal, "mean") / 300
    assert search._cut(thin, inside, free, None) == []


def test_without_a_cut_a_node_is_halved_all_the_same(monkeypatch):
    limits = LIMITS["count"]()
    search = Search(wandering(drawn(7)), limits, "mean")
    search.cost = 1e3
    root = search.root(mask([]))
    cut = search._cut
    for cuts in (0, 1):
        more = iter(range(cuts))
        monkeypatch.setattr(search, "_cut", lambda *asked, more=more: [] if next(more, None) is None else cut(*asked))
        node = Node(root.inside, root.outside, (), root.centre)
        halves = [half for _, half in search.children(node, 0.25)]
        (gauge,) = np.flatnonzero(halves[0].inside)
        assert halves[1].inside.sum() == halves[0].outside.sum() == 0
        assert np.flatnonzero(halves[1].outside).tolist() == [gauge]
        assert len(halves[0].cuts) == cuts


def test_mirrored_gauges_are_twins_whatever_their_rounding():
    rng = np.random.default_rng(7)
    H = np.tile([[2.0, -2.0, 1.0], [1.0, 2.0, -2.0], [2.0, 1.0, 2.0]], (POOL // 3, 1))
    H *= rng.choice([-1.0, 1.0], (POOL, 1)) * (1 + 1e-10 * rng.standard_normal(H.shape))
    H[5] *= 1 + 1e-7
    twins = Search(wandering(H[None]), LIMITS["count"](), "mean").twins
    assert twins[0] == twins[3] == twins[6]
    assert twins[1] == twins[4] == twins[7]
    assert twins[2] == twins[8] != twins[5]
    assert len(np.unique(twins)) == 4


def test_a_set_of_twins_is_no_better():
    rows = np.array([[1.0, 0.2], [0.3, 1.0], [1.0, -1.0]])
    (pool,) = wandering(np.array([[*rows, *(1 + 1e-13) * rows, *-rows * (1 + 2e-13)]]))
    search = Search([pool], LIMITS["count"](), "mean")
    search.offer(np.array([0, 1, 2, 5]))
    best = search.best
    for other in combinations(range(POOL), 4):
        if sorted(g % 3 for g in other) == sorted(g % 3 for g in best):
            search.offer(np.array(other))
    assert search.best is best


def test_the_root_has_the_cut_at_its_weights_where_these_tell_every_unknown():
    pools = wandering(drawn(8))
    assert Search(pools, limits_of(POOL, 1, fixed=(0,)), "mean").root(mask([0])).cuts == ()
    (cut,) = Search(pools, LIMITS["fixed"](), "mean").root(mask([2])).cuts
    np.testing.assert_allclose(cut.cost.mean(), cost(drawn(8), np.where(mask([2]), 1.0, 3 / 8), "mean"), rtol=1e-9)
