"""The nodes of the search: what they keep, what they claim and where they branch, on unknowns that wander with no dynamics."""

from __future__ import annotations

from itertools import combinations, cycle

import numpy as np
import pytest

from strainsight.placement import nodes as module
from strainsight.placement.cuts import cut_at
from strainsight.placement.limits import limits_of
from strainsight.placement.nodes import Node, Search

from .wandering import COMBINED, costs_of, pools_of

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
    """A set that costs less is in one of the halves, or was met, or is left out because of a twin."""
    H, limits = drawn(0), LIMITS[case]()
    pools, costs = wandering(H), layouts(drawn(0), limits, aggregate)
    search = Search(pools, limits, aggregate, 1e-6)
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
        moved = module._within(w, inside, free, limits)
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
    search = Search(wandering(H), limits, "mean", 1e-6)
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
    twins = Search(wandering(H), limits_of(POOL, 4, price=price, budget=6.0), "mean", 1e-6).twins
    assert twins[3] == twins[8] != twins[5]
    assert len(np.unique(twins)) == POOL - 1


def test_what_costs_less_is_taken_with_the_swaps_that_help_it():
    H, limits = drawn(4), LIMITS["count"]()
    costs = layouts(H, limits, "mean")
    search = Search(wandering(H), limits, "mean", 0.1)
    assert (search.target, search.best) == (np.inf, None)
    start = max(costs, key=costs.get)
    search.offer(np.array(start))
    found = tuple(search.best.tolist())
    np.testing.assert_allclose(search.cost, costs[found], rtol=1e-9)
    np.testing.assert_allclose(search.target, 0.9 * costs[found], rtol=1e-9)
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
    search, offered = Search(pools, limits, aggregate, 1e-6), []
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
    # too few are left for a layout
    search._round(cuts, weights, mask([0, 3, 4, 5, 8]))
    search.cost = np.inf
    assert offered == [packed]


def test_a_cut_is_made_halfway_to_equal_weights_where_there_is_none():
    H = drawn(6)
    search = Search(wandering(H), LIMITS["count"](), "mean", 1e-6)
    inside, outside = mask([1]), mask([0, 2])
    free = ~(inside | outside)
    equal = np.where(inside, 1.0, np.where(free, 3 / 6, 0.0))
    alone = np.where(inside, 1.0, 0.0)
    good = np.where(free, 0.3, inside)
    for w, touched in ((good, good), (alone, 0.5 * (alone + equal))):
        (cut,) = search._cut(w, inside, free, None)
        np.testing.assert_allclose(np.mean(cut.cost), cost(H, touched, "mean"), rtol=1e-9)
    # where the cost is a hundred times the incumbent, too
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
    """Where no weights that are tried can be solved for, or none but the first."""
    limits = LIMITS["count"]()
    search = Search(wandering(drawn(7)), limits, "mean", 1e-6)
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
    """Rows of either sign, their largest components alike, 1e-10 of their length apart; 1e-7 is another gauge."""
    rng = np.random.default_rng(7)
    H = np.tile([[2.0, -2.0, 1.0], [1.0, 2.0, -2.0], [2.0, 1.0, 2.0]], (POOL // 3, 1))
    H *= rng.choice([-1.0, 1.0], (POOL, 1)) * (1 + 1e-10 * rng.standard_normal(H.shape))
    H[5] *= 1 + 1e-7
    twins = Search(wandering(H[None]), LIMITS["count"](), "mean", 1e-6).twins
    assert twins[0] == twins[3] == twins[6]
    assert twins[1] == twins[4] == twins[7]
    assert twins[2] == twins[8] != twins[5]
    assert len(np.unique(twins)) == 4


def test_a_set_of_twins_is_no_better():
    """Every gauge is there three times: what differs by the last digits only does not become the best."""
    rows = np.array([[1.0, 0.2], [0.3, 1.0], [1.0, -1.0]])
    (pool,) = wandering(np.array([[*rows, *(1 + 1e-13) * rows, *-rows * (1 + 2e-13)]]))
    search = Search([pool], LIMITS["count"](), "mean", 1e-6)
    search.offer(np.array([0, 1, 2, 5]))
    best = search.best
    for other in combinations(range(POOL), 4):
        if sorted(g % 3 for g in other) == sorted(g % 3 for g in best):
            search.offer(np.array(other))
    assert search.best is best


def test_the_root_has_the_cut_at_its_weights_where_these_tell_every_unknown():
    pools = wandering(drawn(8))
    assert Search(pools, limits_of(POOL, 1, fixed=(0,)), "mean", 1e-6).root(mask([0])).cuts == ()
    (cut,) = Search(pools, LIMITS["fixed"](), "mean", 1e-6).root(mask([2])).cuts
    np.testing.assert_allclose(cut.cost.mean(), cost(drawn(8), np.where(mask([2]), 1.0, 3 / 8), "mean"), rtol=1e-9)
