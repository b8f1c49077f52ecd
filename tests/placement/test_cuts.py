"""Planes below the cost: what they say together of all layouts within limits, with nothing but the layouts to compare."""

from __future__ import annotations

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.errors import NumericalError
from strainsight.placement import cuts as module
from strainsight.placement.cuts import Cut, cut_at, lowest
from strainsight.placement.limits import limits_of
from strainsight.placement.scenario import solve_pool

POOL = 8
SIZE = np.array([2, 1, 1, 2, 1, 2, 1, 1])
PRICE = np.array([1.0, 0.5, 0.8, 0.0, 2.0, 1.5, 0.3, 2.5])
HALF = ("place.at_most.0", np.arange(POOL) < 4, 1)
LIMITS = {
    "count": lambda: limits_of(POOL, 4),
    "zone": lambda: limits_of(POOL, 3, zones=[HALF]),
    "spacing": lambda: limits_of(POOL, 3, near=np.array([(0, 1), (2, 3), (3, 4), (4, 5), (6, 7)])),
    "budget": lambda: limits_of(POOL, 4, price=PRICE, budget=4.0),
    "budget that binds alone": lambda: limits_of(POOL, 8, price=PRICE, budget=2.0),
    "budget that binds nothing": lambda: limits_of(POOL, 4, price=PRICE, budget=100.0),
    "pairs": lambda: limits_of(POOL, 5, size=SIZE),
    "pairs, budget, zone": lambda: limits_of(POOL, 6, size=SIZE, price=1e3 * PRICE, budget=4e3, zones=[HALF]),
    "all of a size": lambda: limits_of(POOL, 6, size=np.full(POOL, 2)),
}


def layouts(limits, inside, free):
    """Every layout that holds `inside` and none beside `free`."""
    for chosen in product([False, True], repeat=POOL):
        v = np.array(chosen)
        if not np.any(inside & ~v) and not np.any(v & ~inside & ~free) and limits.allows(v):
            yield v


def drawn(seed, unit=1.0):
    """Three planes for each of two scenarios; 2 is inside and 5 left out."""
    rng = np.random.default_rng(seed)
    cuts = [Cut(unit * rng.uniform(0, 1, 2), unit * rng.uniform(-1, 0.3, (2, POOL)), np.zeros(2), ()) for _ in range(3)]
    return cuts, np.arange(POOL) == 2, ~np.isin(np.arange(POOL), [2, 5])


def model_of(cuts, aggregate):
    combine = {"mean": np.mean, "worst": np.max}[aggregate]
    return lambda v: float(combine(np.max([c.offset + c.slope @ v for c in cuts], axis=0)))


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
@pytest.mark.parametrize("case", LIMITS)
def test_within_limits_the_bound_of_planes_is_attained_by_weights_and_passed_by_no_layout(case, aggregate):
    limits, prices = LIMITS[case](), []
    for seed, unit in enumerate([1.0, 1e-12, 1e12]):
        cuts, inside, free = drawn(seed, unit)
        model, low = model_of(cuts, aggregate), lowest(cuts, inside, free, limits, aggregate)
        # weights within the limits that cost as much as the bound: no higher one is possible
        assert np.all(limits.rows @ low.weights <= limits.most * (1 + 1e-8) + 1e-8)
        assert limits.size @ low.weights >= limits.least - 1e-8
        np.testing.assert_array_equal(low.weights[[2, 5]], [1, 0])
        assert model(low.weights) == pytest.approx(low.value, abs=1e-7 * unit)
        costs = {v.tobytes(): model(v) for v in layouts(limits, inside, free)}
        assert low.value <= min(costs.values()) + 1e-12 * unit
        for gauge in np.flatnonzero(free):
            others = [v for v in map(masked, costs) if v[gauge] != low.taken[gauge]]
            assert low.value + low.reduced[gauge] <= min(map(model, others), default=np.inf) + 1e-12 * unit
            assert low.reduced[gauge] >= 0
            # complementary slackness: a price is paid only where the weights have chosen
            if low.reduced[gauge] > 1e-6 * unit:
                assert low.weights[gauge] == pytest.approx(float(low.taken[gauge]), abs=1e-6)
        assert np.all(low.reduced[~free] == np.inf)
        prices += list(low.reduced[free] / unit)
        fewer = lowest(
            [c for c, active in zip(cuts, low.active, strict=True) if active], inside, free, limits, aggregate
        )
        assert fewer.value == pytest.approx(low.value, abs=1e-9 * unit)
    assert max(prices) > 0.01


def masked(key):
    return np.frombuffer(key, dtype=bool)


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
@pytest.mark.parametrize("case", LIMITS)
def test_where_the_program_fails_one_plane_still_bounds_every_layout(monkeypatch, case, aggregate):
    monkeypatch.setattr(module, "linprog", lambda *_, **__: SimpleNamespace(status=4, x=None))
    limits = LIMITS[case]()
    for seed in range(4):
        cuts, inside, free = drawn(seed)
        low = lowest(cuts, inside, free, limits, aggregate)
        found = list(layouts(limits, inside, free))
        assert low.value <= min(model_of(cuts, aggregate)(v) for v in found) + 1e-12
        assert low.value > -10
        for gauge in np.flatnonzero(free):
            others = [v for v in found if v[gauge] != low.taken[gauge]]
            least = min((model_of(cuts, aggregate)(v) for v in others), default=np.inf)
            assert low.value + low.reduced[gauge] <= least + 1e-12


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
def test_where_one_layout_is_left_the_bound_is_what_the_planes_say_of_it(aggregate):
    cuts, inside, free = drawn(0)
    for limits, taken in ((limits_of(POOL, 7), free), (limits_of(POOL, 1), np.zeros(POOL, dtype=bool))):
        low = lowest(cuts, inside, free, limits, aggregate)
        assert low.taken.tolist() == taken.tolist()
        assert np.all(low.reduced == np.inf)
        assert low.value == pytest.approx(model_of(cuts, aggregate)(inside | taken), abs=1e-9)


@pytest.mark.parametrize("size", [None, np.full(POOL, 2)])
def test_limits_that_leave_no_weights_have_an_infinite_bound(size):
    # of the three that are free the zone allows one, and the count asks for two
    limits = limits_of(POOL, 3 if size is None else 6, size=size, zones=[HALF])
    cuts, _, _ = drawn(0)
    free = np.isin(np.arange(POOL), [0, 1, 3])
    assert list(layouts(limits, np.arange(POOL) == 6, free)) == []
    low = lowest(cuts, np.arange(POOL) == 6, free, limits, "mean")
    assert low.value == np.inf
    assert np.all(low.active)


def test_weights_that_see_all_but_cannot_be_solved_have_no_cut(monkeypatch, beam_of, scenarios_of):
    pools = [solve_pool(s) for s in scenarios_of(beam_of(10, 3), ("Fz",), ("E",))]
    assert cut_at(pools, np.full(10, 0.5), None) is not None

    def refuse(*_):
        raise NumericalError("not solved")

    monkeypatch.setattr(module, "refined", refuse)
    assert cut_at(pools, np.full(10, 0.5), None) is None
