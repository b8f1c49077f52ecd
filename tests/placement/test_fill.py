"""The filling of a layout: what it adds, and what it holds while it looks for the next gauge."""

from __future__ import annotations

import weakref

import numpy as np
import pytest

from strainsight.placement import fill as filling
from strainsight.placement.elimination import eliminate
from strainsight.placement.limits import as_limits, limits_of
from strainsight.placement.scenario import Scenario, solve_pool


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
def test_the_loops_of_gauges_that_lose_are_let_go(beam_of, scenarios_of, monkeypatch, aggregate):
    """However many are evaluated: beside the present set's only those of the best, and of the one before."""
    result = eliminate(scenarios_of(beam_of(60, 4), ("Fz",), ("E",), instants=(55, 260)), 2)
    with_gauge, made, held = filling.with_gauge, [], []

    def watched(pools, loops, gauge):
        held.append(sum(loop() is not None for loop in made))
        grown = with_gauge(pools, loops, gauge)
        made.extend(weakref.ref(loop) for loop in grown)
        return grown

    monkeypatch.setattr(filling, "with_gauge", watched)
    filling.fill(result.pools, result.kept, as_limits(60, 3, ()), aggregate)
    assert len(held) > 10
    assert max(held) <= 2 * len(result.pools)


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
@pytest.mark.parametrize("seed", range(3))
def test_the_gauge_that_fits_and_lowers_the_cost_most_is_added_until_none_fits(aggregate, seed):
    """Unknowns that wander, F = 0 and Q = q I: P = √q G^(−1/2). Gauges 3 and 4 read what 7 and 9 do, the other way round."""
    rng = np.random.default_rng(seed)
    H, levels, weight = rng.normal(size=(2, 12, 3)), (1.0, 30.0), np.array([1.0, 5.0, 0.2])
    H[:, [7, 9]] = -2 * H[:, [3, 4]]
    H[:, [3, 4]] *= 2
    pools = [
        solve_pool(Scenario(np.zeros((3, 3)), q * np.eye(3), h, np.ones(12), weight))
        for h, q in zip(H, levels, strict=True)
    ]

    def cost(chosen):
        each = []
        for h, q in zip(H[:, chosen], levels, strict=True):
            lam, U = np.linalg.eigh(h.T @ h)
            each.append(np.sqrt(q) * weight @ (U**2 / np.sqrt(lam)).sum(axis=1))
        return max(each) if aggregate == "worst" else sum(each) / 2

    price = np.array([3.0, 1, 1, 1, 2, 2, 1, 1, 0.5, 2, 1, 3])
    zone = ("place.at_most.0", np.isin(np.arange(12), [1, 2, 3, 7]), 2)
    for limits in (as_limits(12, 8, ()), limits_of(12, 9, price=price, budget=12.0, zones=[zone])):
        chosen, added = [0, 5, 8], []
        while fits := [
            g for g in range(12) if g not in chosen and np.all(limits.used(np.array([*chosen, g])) <= limits.most)
        ]:
            costs = {g: cost([*chosen, g]) for g in fits}
            added.append(min(g for g in fits if costs[g] <= min(costs.values()) * (1 + 1e-8)))
            chosen.append(added[-1])
        assert len(added) > 3
        assert filling.fill(pools, [8, 0, 5], limits, aggregate).tolist() == sorted(chosen)


def test_only_a_set_that_tells_every_unknown_is_filled():
    pools = [solve_pool(Scenario(np.zeros((2, 2)), np.eye(2), np.eye(2)[[0, 1, 0]], np.ones(3), np.ones(2)))]
    with pytest.raises(ValueError, match="detects every unknown"):
        filling.fill(pools, [0], as_limits(3, 2, ()))
    assert filling.fill(pools, [0, 2], as_limits(3, 2, ())).tolist() == [0, 2]
