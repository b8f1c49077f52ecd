"""Losing any one gauge: the losses, and the set that loses least, against every set."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from strainsight.errors import NumericalError
from strainsight.ordering import TIE
from strainsight.placement import failure, scenario
from strainsight.placement.branch_and_bound import branch_and_bound
from strainsight.placement.exchange import exchange
from strainsight.placement.failure import LossSearch, loss_if_one_fails, measure, robust_set
from strainsight.placement.limits import limits_of
from strainsight.placement.scenario import solve_pool
from strainsight.placement.score import score

from ..shared import slowly
from .conftest import COMBINED, beam_of, blind_sideways, costs_of, every_set, oracle, pools_of, scenarios_of
from .whole_pools import eliminate


def one_swap_away(gauges, pool, fixed=()):
    return [
        tuple(sorted({*gauges, into} - {out}))
        for out in set(gauges) - set(fixed)
        for into in set(range(pool)) - set(gauges)
    ]


@pytest.fixture(scope="module")
def one_sees_sideways():
    """A pool of 12 of which gauge 7 alone sees Fy."""
    beam = beam_of(12, 3)
    (scenario,) = scenarios_of(beam, ("Fz", "Fy"), ())
    return solve_pool(blind_sideways(beam, scenario, np.arange(12) != 7))


def test_a_failure_that_loses_an_unknown_costs_infinity(one_sees_sideways):
    loss = loss_if_one_fails([one_sees_sideways], [3, 7, 9])
    assert np.isinf(loss).tolist() == [False, True, False]
    assert np.all(np.isinf(loss_if_one_fails([one_sees_sideways], [1, 3, 5])))
    pools = [solve_pool(s) for s in scenarios_of(beam_of(12, 3), ("Fz", "Fy"), ("E",))]
    assert np.all(np.isinf(loss_if_one_fails(pools, [0, 4, 8])))


@pytest.mark.parametrize(("inputs", "parameters", "seed"), [((), ("E",), 0), (("Fz", "Fy"), ("E",), 2)])
def test_no_single_swap_lowers_the_worst_loss(inputs, parameters, seed):
    pools = [solve_pool(s) for s in scenarios_of(beam_of(11, 2, seed=seed), inputs, parameters)]
    cost = every_set(pools, 3, "mean")
    worst = {g: max(cost[rest] for rest in combinations(g, 3)) for g in combinations(range(11), 4)}
    found = robust_set(pools, 4)
    mine = worst[tuple(found.tolist())]
    loss = loss_if_one_fails(pools, found)
    np.testing.assert_allclose(loss.max(), mine, rtol=1e-7)
    assert min(worst[other] for other in one_swap_away(found.tolist(), 11)) >= mine * (1 - 1e-7)
    assert min(worst.values()) * (1 - 1e-7) <= mine <= 1.1 * min(worst.values())
    optimum = branch_and_bound(pools, 4)
    assert score(pools, found) >= optimum.cost * (1 - 1e-6)
    assert loss.max() <= loss_if_one_fails(pools, optimum.gauges).max() * (1 + 1e-9)


def test_where_one_gauge_alone_sees_an_unknown_the_others_are_made_robust(one_sees_sideways):
    pool = one_sees_sideways
    found = robust_set([pool], 4)
    loss = loss_if_one_fails([pool], found)
    assert found[loss == np.inf].tolist() == [7]

    def largest(gauges):
        rests = [[g for g in gauges if g != out] for out in gauges if out != 7]
        return max(pool.scenario.weight @ np.diag(oracle(pool.scenario, rest)) for rest in rests)

    mine = largest(found.tolist())
    np.testing.assert_allclose(loss[found != 7].max(), mine, rtol=1e-7)
    for other in one_swap_away(found.tolist(), 12, fixed=[7]):
        assert largest(other) >= mine * (1 - 1e-7)


def test_a_start_with_a_fatal_gauge_is_replaced():
    beam = beam_of(12, 3)
    (scenario,) = scenarios_of(beam, ("Fz", "Fy"), ())
    # gauge 0 sees both loads, 1 to 7 only Fz, 8 to 11 only Fy and that weakly
    upright = blind_sideways(beam, scenario, np.arange(12) > 0).H
    H = np.concatenate([scenario.H[:1], upright[1:8], 1e-2 * (scenario.H - upright)[8:]])
    pool = solve_pool(replace(scenario, H=H))
    plain = branch_and_bound([pool], 3)
    assert np.isinf(loss_if_one_fails([pool], plain.gauges).max())
    found = robust_set([pool], 3)
    assert loss_if_one_fails([pool], found).max() < np.inf
    assert sum(g == 0 or g >= 8 for g in found) >= 2
    assert sum(g < 8 for g in found) >= 2


def test_a_failure_whose_covariance_is_not_solved_is_not_called_a_lost_unknown(monkeypatch):
    pools = tuple(solve_pool(s) for s in scenarios_of(beam_of(8), ("Fz",), ("E",)))
    plain = loss_if_one_fails(pools, [1, 4, 6])
    solve = scenario.subset_covariance

    def unsolved(pool, gauges):
        if list(gauges) == [1, 6]:
            raise NumericalError("solved to 1e-7 only")
        return solve(pool, gauges)

    monkeypatch.setattr(scenario, "subset_covariance", unsolved)
    loss = loss_if_one_fails(pools, [1, 4, 6])
    assert np.isfinite(plain).all()
    assert np.isnan(loss[1])
    np.testing.assert_array_equal(loss[[0, 2]], plain[[0, 2]])


def wandering(seed, pool, unknowns):
    H = np.random.default_rng(seed).normal(size=(1, pool, unknowns))
    return pools_of(H, (1.0,), np.ones(unknowns))[0]


@pytest.mark.parametrize("seed", [10, 19, *slowly(28, 36)])
def test_of_the_two_starts_the_better_end_counts(seed):
    pool = wandering(seed, 14, 4)
    found, (six, twelve) = robust_set([pool], 6), (eliminate([pool.scenario], keep).selected.tolist() for keep in (6, 12))
    while len(twelve) > 6:
        rests = {g: [o for o in twelve if o != g] for g in twelve}
        twelve = min(rests.values(), key=lambda rest: loss_if_one_fails([pool], rest).max())
    search = failure.LossSearch([pool], "mean", limits_of(14, 6), 20_000)
    ends = [max(search.swapped(start)[1].values()) for start in (exchange([pool], six).gauges.tolist(), twelve)]
    assert abs(ends[0] - ends[1]) > 0.005 * ends[0]
    np.testing.assert_allclose(loss_if_one_fails([pool], found).max(), min(ends), rtol=1e-9)


def test_the_wider_start_is_twice_as_many_and_twice_as_dear_and_nothing_else():
    price, zone = np.array([1.0, 2, 3, 4, 5, 6, 7]), ("place.at_most.0", np.arange(7) < 3, 1)
    near = np.array([(5, 6)])
    for keep, twice in ((2, 4), (3, 6), (4, 7), (7, 7)):
        plain = failure._twice(limits_of(7, keep))
        assert plain.plain
        assert plain.keep == plain.least == plain.most[0] == twice
        limits = failure._twice(limits_of(7, keep, price=price, budget=6.0, near=near, zones=[zone]))
        for k in range(1, 7):
            for gauges in map(list, combinations(range(7), k)):
                may = k <= twice and price[gauges].sum() <= 12.0 and sum(g < 3 for g in gauges) <= 1
                assert limits.allows(np.array(gauges)) == (may and not {5, 6} <= set(gauges))
    sizes = np.array([2, 1, 1, 2, 1])
    # a pair may leave a place over, and no fewer gauges than before are asked for
    pairs = failure._twice(limits_of(5, 3, size=sizes))
    assert (pairs.keep, pairs.most[0], pairs.least) == (6, 6, 2)
    assert failure._twice(limits_of(5, 4, size=sizes)).keep == 7


class Wander:
    """Two unknowns or more that wander, in one or more scenarios: H (scenarios, pool, unknowns) at unit noise."""

    def __init__(self, H, aggregate, levels=(1.0, 4.0, 9.0)):
        self.H, self.aggregate = np.asarray(H, dtype=float), aggregate
        self.size, n = self.H.shape[1:]
        self.levels, self.weight = levels[: len(self.H)], 1.0 + np.arange(n)
        self.pools = pools_of(self.H, self.levels, self.weight)

    def costs(self, v):
        return costs_of(self.H, self.levels, self.weight, v)

    def loss(self, chosen):
        held = np.isin(np.arange(self.size), chosen)
        return {
            g: float(COMBINED[self.aggregate](self.costs(held & (np.arange(self.size) != g)))) for g in sorted(chosen)
        }

    def gradients(self, chosen):
        held, step = np.isin(np.arange(self.size), chosen).astype(float), 1e-5
        return np.transpose(
            [(self.costs(held - step * e) - self.costs(held + step * e)) / (2 * step) for e in np.eye(self.size)]
        )

    def search(self, limits, limit=10**6):
        return LossSearch(self.pools, self.aggregate, limits, limit)


def drawn(seed, aggregate, *, pool=8, unknowns=3, scenarios=2):
    return Wander(np.random.default_rng(seed).normal(size=(scenarios, pool, unknowns)), aggregate)


@pytest.mark.parametrize(("seed", "aggregate"), [(0, "mean"), (2, "worst")])
def test_the_first_swap_that_helps_in_the_order_of_the_bound_is_made(aggregate, seed):
    case, keep = drawn(seed, aggregate), 5
    made = 0
    for chosen in list(combinations(range(8), keep))[::7]:
        loss = case.loss(chosen)
        least = {}
        for out in chosen:
            for into in set(range(8)) - set(chosen):
                after = [loss[out]]
                for g in set(chosen) - {out}:
                    rest = [o for o in chosen if o != g]
                    phi = case.gradients(rest)
                    level = case.costs(np.isin(np.arange(8), rest))
                    after.append(COMBINED[aggregate](level + phi[:, out] - phi[:, into]))
                least[out, into] = max(after)
        enough = max(loss.values()) * (1 - TIE)
        helps = [
            swap
            for swap in sorted(least, key=least.get)
            if max(case.loss([*(set(chosen) - {swap[0]}), swap[1]]).values()) < enough
        ]
        for swap in helps:
            assert least[swap] <= max(case.loss([*(set(chosen) - {swap[0]}), swap[1]]).values()) * (1 + 1e-6)
        found = case.search(limits_of(8, keep)).first_gain(list(chosen), loss)
        assert (found and found[:2]) == (helps[0] if helps else None)
        if helps:
            made += 1
            expected = case.loss([*(set(chosen) - {found[0]}), found[1]])
            assert set(found[2]) == set(expected)
            np.testing.assert_allclose([found[2][g] for g in expected], list(expected.values()), rtol=1e-8)
    assert made > 3


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
def test_where_there_is_room_the_gauge_of_the_least_bound_is_added(aggregate):
    case = drawn(5, aggregate)
    limits = limits_of(8, 8, price=np.array([1.0] * 7 + [9.0]), budget=8.0)
    for chosen in ([0, 1, 2, 3], [1, 3, 4, 5], [0, 2, 5, 6], [1, 2, 3, 4]):
        least = dict.fromkeys(set(range(7)) - set(chosen), -np.inf)
        for g in chosen:
            rest = [o for o in chosen if o != g]
            level, phi = case.costs(np.isin(np.arange(8), rest)), case.gradients(rest)
            least = {j: max(least[j], COMBINED[aggregate](level - phi[:, j])) for j in least}
        out, into, loss = case.search(limits).first_gain(chosen, case.loss(chosen))
        expected = case.loss([*chosen, into])
        assert (out, into) == (-1, min(least, key=least.get))
        assert least[into] <= max(expected.values())
        np.testing.assert_allclose([loss[g] for g in expected], list(expected.values()), rtol=1e-8)


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
def test_every_solve_after_a_failure_is_counted_and_none_begins_beyond_the_limit(aggregate, monkeypatch):
    case, calls = drawn(3, aggregate), []
    solve = scenario.subset_covariance
    monkeypatch.setattr(scenario, "subset_covariance", lambda *asked: calls.append(1) or solve(*asked))
    start = [0, 1, 2, 3]
    whole = case.search(limits_of(8, 4))
    assert whole.swapped(start)[0] != start
    assert whole.solves == len(calls)
    for limit in range(1, whole.solves, 11):
        search = case.search(limits_of(8, 4), limit)
        search.swapped(start)
        assert limit <= search.solves < limit + 3 * 4 * len(case.pools)
    assert case.search(limits_of(8, 4), whole.solves + 1).swapped(start)[0] == whole.swapped(start)[0]


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
def test_of_gauges_that_are_too_many_the_one_missed_least_goes_first(aggregate):
    H = np.random.default_rng(4).normal(size=(2, 8, 3))
    H[:, 6] = -H[:, 1]
    case = Wander(H, aggregate)
    inside = np.isin(np.arange(8), [0, 2, 4, 5])
    for limits in (
        limits_of(8, 4),
        limits_of(8, 4, fixed=(0, 3)),
        limits_of(8, 5, zones=[("place.at_most.0", inside, 1)]),
        limits_of(8, 6, price=np.array([3.0, 1, 2, 5, 1, 0, 1, 4]), budget=9.0),
    ):
        left = list(range(8))
        while (limits.rows @ np.isin(np.arange(8), left) > limits.most).any():
            broken = limits.rows.toarray()[limits.rows @ np.isin(np.arange(8), left) > limits.most]
            may = [g for g in left if g not in limits.fixed and broken[:, g].any()]
            measures = {g: measure(case.loss([o for o in left if o != g])) for g in may}
            lost = min(fatal for fatal, _ in measures.values())
            lowest = min(largest for fatal, largest in measures.values() if fatal == lost)
            left.remove(min(g for g in may if measures[g] <= (lost, lowest * (1 + 1e-8))))
        assert case.search(limits).reduced(list(range(8))) == left


def test_a_gauge_that_tells_nothing_is_not_added_where_there_is_room():
    rows = np.array([[1.0, 0.2], [0.3, 1.0], [1.0, -1.0], [0.8, 0.9]])
    case = Wander([[*rows, [0.0, 0.0]]], "mean")
    limits = limits_of(5, 5, price=np.ones(5), budget=5.0)
    assert case.search(limits).first_gain([0, 1, 2, 3], case.loss([0, 1, 2, 3])) is None
    three = case.loss([0, 1, 2])
    out, into, loss = case.search(limits).first_gain([0, 1, 2], three)
    assert (out, into) == (-1, 3)
    assert measure(loss) < measure(three)
    assert case.search(limits, limit=1).first_gain([0, 1, 2], three) is None


def test_no_gauge_is_swapped_for_its_twin():
    rows = np.array([[1.0, 0.2], [0.3, 1.0], [1.0, -1.0], [0.8, 0.9]])
    case = Wander([[*rows, *-rows, *rows]], "mean")
    best = min(combinations(range(12), 4), key=lambda chosen: measure(case.loss(chosen)))
    search = case.search(limits_of(12, 4), 2000)
    assert search.swapped(list(best))[0] == list(best)
    assert search.solves < 2000


def test_fewer_losses_of_an_unknown_come_first_and_the_largest_of_the_others_second():
    inf = np.inf
    ordered = [{1: 0.2, 2: 0.3}, {1: 0.1, 2: 0.4}, {1: inf, 2: 0.1, 3: 0.2}, {1: inf, 2: inf}, {1: inf, 2: inf, 3: 0.1}]
    assert [measure(loss) for loss in ordered] == [(0, 0.3), (0, 0.4), (1, 0.2), (2, 0.0), (2, 0.1)]
    assert sorted(ordered, key=measure) == ordered
