"""The search for the least loss, step by step, on unknowns that wander with no dynamics."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from strainsight.ordering import TIE
from strainsight.placement import score
from strainsight.placement.failure import robust_set
from strainsight.placement.limits import limits_of
from strainsight.placement.losses import LossSearch, measure

from .wandering import COMBINED, costs_of, pools_of


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
        """φ (scenarios, pool) by differences."""
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
    solve = score.subset_covariance
    monkeypatch.setattr(score, "subset_covariance", lambda *asked: calls.append(1) or solve(*asked))
    start = [0, 1, 2, 3]
    whole = case.search(limits_of(8, 4))
    _, _, swaps = whole.swapped(start)
    assert swaps
    assert whole.solves == len(calls)
    for limit in range(1, whole.solves, 11):
        search = case.search(limits_of(8, 4), limit)
        search.swapped(start)
        # the losses of the set, its bounds and one set that is tried are not left halfway
        assert limit <= search.solves < limit + 3 * 4 * len(case.pools)
    assert case.search(limits_of(8, 4), whole.solves + 1).swapped(start)[0] == whole.swapped(start)[0]


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
def test_of_gauges_that_are_too_many_the_one_missed_least_goes_first(aggregate):
    """The lower index of those that are equal; bonded gauges and those that break no limit stay."""
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
    """Every gauge is there three times: from the best set some swap always costs the same to the last digits."""
    rows = np.array([[1.0, 0.2], [0.3, 1.0], [1.0, -1.0], [0.8, 0.9]])
    case = Wander([[*rows, *-rows, *rows]], "mean")
    best = min(combinations(range(12), 4), key=lambda chosen: measure(case.loss(chosen)))
    found = robust_set(case.pools, 4, start=best, limit=2000)
    assert found.complete
    assert found.swaps == ()


def test_fewer_losses_of_an_unknown_come_first_and_the_largest_of_the_others_second():
    inf = np.inf
    ordered = [{1: 0.2, 2: 0.3}, {1: 0.1, 2: 0.4}, {1: inf, 2: 0.1, 3: 0.2}, {1: inf, 2: inf}, {1: inf, 2: inf, 3: 0.1}]
    assert [measure(loss) for loss in ordered] == [(0, 0.3), (0, 0.4), (1, 0.2), (2, 0.0), (2, 0.1)]
    assert sorted(ordered, key=measure) == ordered
