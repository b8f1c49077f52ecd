"""What is removed always leaves a layout, however little work its search is given; dead ends of a plain count."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from strainsight.errors import InfeasibleError
from strainsight.placement import elimination as room
from strainsight.placement import layouts, witness
from strainsight.placement.layouts import Detection
from strainsight.placement.limits import limits_of
from strainsight.placement.scenario import Scenario, solve_pool
from strainsight.placement.score import score

from ..shared import slowly
from .conftest import beam_of, scenarios_of
from .whole_pools import eliminate


def scattered(count, distance, seed=3):
    """One load on an oscillator, seen the better the further to the right; pairs of places nearer than the distance."""
    place = np.random.default_rng(seed).random((count, 2))
    far = np.linalg.norm(place[:, None] - place[None], axis=2)
    near = np.argwhere(np.triu(far < distance, 1))
    F = np.zeros((3, 3))
    F[0, 1], F[1] = 1.0, [-4.0, -0.4, 1.0]
    H = np.column_stack([1 + 0.1 * place[:, 0], np.zeros((count, 2))])
    return Scenario(F, np.diag([0, 0.01, 0.1]), H, np.full(count, 1e-2), np.array([0, 0, 1.0])), near


@pytest.mark.parametrize(("keep", "work"), [(36, "the usual"), *slowly((38, "little")), (38, "none")])
def test_near_the_densest_packing_a_layout_is_left_however_little_work_is_spent(monkeypatch, keep, work):
    scenario, near = scattered(250, 0.15)
    limits = limits_of(250, keep, near=near)
    if work != "the usual":
        monkeypatch.setattr(witness, "EFFORT", 0)
        monkeypatch.setattr(witness, "REACH", {"little": 20, "none": 0}[work])
    found = eliminate([scenario], limits)
    assert len(found.selected) == keep
    chosen = set(found.selected.tolist())
    assert not any(a in chosen and b in chosen for a, b in near.tolist())
    np.testing.assert_allclose(found.cost[-1], score(found.pools, found.selected), rtol=1e-7)
    assert np.all(found.rise > 0)


def test_result_is_independent_of_time(monkeypatch):
    scenario, near = scattered(250, 0.15)
    asked = []

    def spy(*arguments, **more):
        asked.append(set(more["options"]))
        return solver(*arguments, **more)

    solver = layouts.milp
    monkeypatch.setattr(layouts, "milp", spy)
    eliminate([scenario], limits_of(250, 38, near=near))
    with pytest.raises(InfeasibleError, match="allows only 38 of the 250 candidate gauges"):
        eliminate([scenario], limits_of(250, 60, near=near))
    assert asked
    assert all(options == {"node_limit", "mip_rel_gap"} for options in asked)


@pytest.mark.parametrize("seed", range(6))
def test_what_is_held_is_part_of_a_layout_inside_what_is_left(monkeypatch, seed):
    rng = np.random.default_rng(seed)
    scenarios = scenarios_of(beam_of(14, 2, seed=seed), ("Fz",), ("E",))
    near = np.array([pair for pair in combinations(range(14), 2) if rng.random() < 0.35])
    price = np.round(rng.uniform(0.5, 3, 14), 1)
    asked = {"price": price, "budget": 6.0} if seed % 2 else {"zones": [("place.at_most.0", np.arange(14) < 7, 1)]}
    limits = limits_of(14, 3, near=near, **asked)
    monkeypatch.setattr(witness, "EFFORT", 0)
    held = []

    class Watched(witness.Guard):
        def lets_go(self, *arguments):
            spared = super().lets_go(*arguments)
            layout = self._witness.units
            assert limits.allows(layout)
            assert np.all(self.remaining[layout])
            assert np.all(layout[self.held])
            assert not self.detection.loses(np.flatnonzero(layout))
            held.append(self.held.sum())
            return spared

    monkeypatch.setattr(room, "Guard", Watched)
    assert limits.allows(eliminate(scenarios, limits).selected)
    assert held


def two_instants(rows, noise):
    """A constant drives an oscillator; rows (gauges, 2): state that each gauge reads at either instant, 1 sees no constant."""
    F = np.zeros((4, 4))
    F[0, 1], F[1], F[3, 3] = 1.0, [-4, -0.4, 1, 1], -0.5
    Q, weight = np.diag([0, 0.01, 0.1, 0.1]), np.array([0, 0, 1.0, 0])
    return [Scenario(F, Q, np.eye(4)[states], np.array(noise), weight) for states in np.array(rows).T]


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
def test_two_gauges_that_see_one_instant_each_give_way_to_one_that_sees_both(aggregate):
    scenarios = two_instants([(0, 1), (1, 0), (0, 0)], [1e-3, 1e-3, 1e-1])
    found = eliminate(scenarios, 1, aggregate)
    assert found.selected.tolist() == [2]
    np.testing.assert_allclose(found.cost[-1], score(found.pools, [2], aggregate), rtol=1e-9)
    with pytest.raises(InfeasibleError, match=r"1 gauges requested, but the smallest set .* has 2"):
        eliminate(two_instants([(0, 1), (1, 0), (1, 1)], [1e-3, 1e-3, 1e-1]), 1, aggregate)


def test_rosettes_that_share_their_unknowns_badly_are_no_dead_end(six_loads):
    assert eliminate([six_loads], 2).selected.tolist() == [1, 2]


def test_weak_gauge_is_found_next_to_strong_gauges():
    # either strong gauge alone makes rounding of the weak one, which sees both unknowns
    F, Q = np.zeros((2, 2)), np.eye(2)
    H = np.array([[[1.0, 0], [0, 0]], [[0, 1.0], [0, 0]], [[1, 0], [0, 1.0]]])
    r = np.array([1e-21, 1e-21, 1.0])[:, None] * np.ones(2)
    scenario = Scenario(F, Q, H, r, np.ones(2))
    found = eliminate([scenario], limits_of(3, 1, zones=[("place.at_most.0", np.array([True, True, False]), 0)]))
    assert found.selected.tolist() == [2]
    np.testing.assert_allclose(found.cost[-1], score([solve_pool(scenario)], [2]), rtol=1e-9)
    np.testing.assert_allclose(found.cost[0] + found.rise.sum(), found.cost[-1], rtol=1e-9)


def test_another_layout_is_looked_for_around_the_gauge_that_leaves():
    """A path of four places beside 148 pairs that are worth more: it takes two swaps at once, of gauges worth least of all."""
    count = 300
    chain, pairs = [(0, 1), (1, 2), (2, 3)], [(i, i + 1) for i in range(4, count, 2)]
    limits = limits_of(count, 2 + len(pairs), near=np.array(chain + pairs))
    scenario, _ = scattered(count, 0.0)
    worth = np.concatenate([[3.0, 1.0, 4.0, 2.0], np.linspace(10, 20, count - 4)])
    at_hand = witness.Witness(limits, Detection([solve_pool(scenario)]), worth, ())
    assert at_hand.units[:4].tolist() == [True, False, True, False]
    before = at_hand.units[4:].copy()
    assert at_hand.spares(0, np.ones(count, dtype=bool), worth)
    assert at_hand.units[:4].tolist() == [False, True, False, True]
    assert np.array_equal(at_hand.units[4:], before)
    assert limits.allows(at_hand.units)


def test_the_surplus_is_the_gauge_worth_least_that_a_broken_limit_counts_and_no_layout_needs():
    scenario, _ = scattered(6, 0.0)
    price = np.array([1.0, 1.0, 0.0, 1.0, 1.0, 1.0])
    guard = witness.Guard(limits_of(6, 6, price=price, budget=2.0), Detection([solve_pool(scenario)]), ())
    index, bounds = np.arange(6), np.array([0.3, 0.04, 0.01, 0.02, 0.03, 0.4])
    # 2 costs nothing and is no surplus; 0 and 5 are what the budget has room for
    np.testing.assert_allclose(guard.relief, 3 / 4 * price)
    for out in (3, 4, 1):
        assert guard.broken
        assert guard.surplus(index, bounds) == out
        assert guard.lets_go(out, index, bounds)
        bounds = bounds[index != out]
        index = index[index != out]
    assert not guard.broken
    assert np.flatnonzero(guard.remaining).tolist() == [0, 2, 5]
    assert not guard.held.any()


def test_a_limit_of_nothing_counts_by_what_the_whole_pool_takes():
    scenario, _ = scattered(5, 0.0)
    zone = np.array([True, True, True, False, False])
    guard = witness.Guard(limits_of(5, 2, zones=[("place.at_most.0", zone, 0)]), Detection([solve_pool(scenario)]), ())
    np.testing.assert_allclose(guard.excess, [3, 3])
    np.testing.assert_allclose(guard.relief, 3 / 2**2 + zone * 3 / 3**2)


def two_loads(count, see_second):
    """Two loads on two oscillators: every gauge sees the first, the second only those of `see_second` (count,) bool."""
    F = np.zeros((6, 6))
    F[:2, 2:4], F[2:4] = np.eye(2), np.hstack([-np.diag([1.0, 4.0]), -0.2 * np.eye(2), np.diag([1.0, 4.0])])
    H = np.zeros((count, 2, 6))
    H[:, 0, 0] = 1.0
    H[see_second, 1, 1] = 1.0
    return Scenario(
        F, np.diag([0, 0, 0.01, 0.01, 0.1, 0.1]), H, np.full((count, 2), 1e-2), np.array([0, 0, 0, 0, 1.0, 1])
    )


@pytest.mark.parametrize("reach", [5, 40])
def test_another_layout_is_looked_for_among_those_that_see_what_is_lost(monkeypatch, reach):
    monkeypatch.setattr(witness, "REACH", reach)
    sees = np.isin(np.arange(40), [3, 17, 29])
    limits = limits_of(40, 4, near=np.array([(10, 11), (12, 13)]))
    worth = np.where(sees, 0.5 + 0.001 * np.arange(40), 1.0 + np.arange(40))
    at_hand = witness.Witness(limits, Detection([solve_pool(two_loads(40, sees))]), worth, ())
    there = np.ones(40, dtype=bool)
    for others_left in (True, True, False):
        assert limits.allows(at_hand.units)
        (kept,) = np.flatnonzero(at_hand.units & sees)
        assert at_hand.spares(int(kept), there, worth) == others_left
        assert at_hand.units[kept] != others_left
        there[kept] = False


def test_the_nearest_rows_are_those_that_share_a_limit_with_the_gauge_or_with_one_that_does(monkeypatch):
    """A path 0 to 5, and 6 beside 2, 3 and 5: without 0 there are {1, 3, 5} and {1, 4, 6}, and 3 is worth more than 6."""
    monkeypatch.setattr(witness, "REACH", 3)
    near = np.array([(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (2, 6), (3, 6), (5, 6)])
    worth = np.array([7.0, 2, 8, 4, 1, 9, 3])
    scenario, _ = scattered(7, 0.0)
    at_hand = witness.Witness(limits_of(7, 3, near=near), Detection([solve_pool(scenario)]), worth, ())
    assert np.flatnonzero(at_hand.units).tolist() == [0, 2, 5]
    assert at_hand.spares(0, np.ones(7, dtype=bool), worth)
    assert np.flatnonzero(at_hand.units).tolist() == [1, 3, 5]


def test_where_another_gauge_fits_in_its_place_the_rest_of_the_layout_stays():
    scenario, _ = scattered(10, 0.0)
    limits = limits_of(10, 4, near=np.array([(i, i + 1) for i in range(9)]))
    worth = np.array([1.0, 0, 9, 0, 8, 0, 7, 0, 6, 0])
    at_hand = witness.Witness(limits, Detection([solve_pool(scenario)]), worth, ())
    assert np.flatnonzero(at_hand.units).tolist() == [2, 4, 6, 8]
    assert at_hand.spares(8, np.ones(10, dtype=bool), np.array([1.0, 9, 0, 9, 0, 9, 0, 9, 0, 2]))
    assert np.flatnonzero(at_hand.units).tolist() == [2, 4, 6, 9]


def test_under_a_budget_the_first_layout_is_of_gauges_worth_most_for_what_they_take_of_count_and_budget():
    scenario, _ = scattered(12, 0.0)
    rng = np.random.default_rng(5)
    for _ in range(10):
        price, worth = rng.uniform(0, 0.4, 12), rng.uniform(0.1, 1, 12)
        limits = limits_of(12, 5, price=price, budget=0.6)
        found = witness.Witness(limits, Detection([solve_pool(scenario)]), worth, ()).units
        chosen: list[int] = []
        for g in sorted(range(12), key=lambda g: -worth[g] / (1 / 5 + price[g] / 0.6)):
            if len(chosen) < 5 and price[[*chosen, g]].sum() <= 0.6:
                chosen.append(g)
        assert np.flatnonzero(found).tolist() == sorted(chosen)
