"""The best layout, the unknowns that a layout loses and the refusals, against all layouts of small pools."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.optimize import OptimizeResult

from strainsight.placement import layouts as module
from strainsight.placement.layouts import Detection, best_layout, refusal
from strainsight.placement.limits import limits_of
from strainsight.placement.scenario import Scenario, solve_pool

POOL = 8
EVERY = np.array(list(product([False, True], repeat=POOL)))
SIZE = np.array([2, 1, 1, 2, 1, 2, 1, 1])
PRICE = np.array([1.0, 0.5, 0.8, 0.0, 2.0, 1.5, 0.3, 2.5])
ZONE, NEAR = ("place.at_most.0", np.arange(POOL) < 4, 1), np.array([(0, 1), (2, 3), (3, 4), (4, 5), (6, 7)])
LIMITS = limits_of(POOL, 5, size=SIZE, price=1e4 * PRICE, budget=3e4, near=NEAR, zones=[ZONE], fixed=(6,))


def within(v, names):
    """The limits above in words; names: of those that are asked for."""
    return (
        v[6]
        and ("place.keep" not in names or SIZE[v].sum() <= 5)
        and ("place.budget" not in names or PRICE[v].sum() <= 3.0)
        and ("place.minimum_spacing" not in names or not any(v[a] and v[b] for a, b in NEAR))
        and ("place.at_most.0" not in names or v[:4].sum() <= 1)
    )


FAMILIES = ["place.keep", "place.budget", "place.minimum_spacing", "place.at_most.0"]
ASKED = {
    "all limits": {},
    "some": {"names": ["place.keep", "place.minimum_spacing"]},
    "others": {"names": ["place.budget", "place.at_most.0"]},
    "some that are there": {"allowed": np.isin(np.arange(POOL), [0, 1, 4, 5, 6])},
    "some that stay": {"required": np.arange(POOL) == 1},
    "at least three": {"floor": 3, "names": ["place.keep", "place.budget"]},
    "one of each": {
        "hits": [np.isin(np.arange(POOL), [1, 7]), np.isin(np.arange(POOL), [2, 4])],
        "names": ["place.keep"],
    },
    "more than there is": {"floor": 6},
    "what may not be had": {"hits": [np.arange(POOL) == 7]},
}


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("case", ASKED)
def test_no_layout_is_worth_more_and_what_is_found_is_one(case, unit):
    asked = ASKED[case]
    for seed in range(3):
        value = unit * np.random.default_rng(seed).normal(0.3, 1.0, POOL)
        found = best_layout(LIMITS, value, **asked)
        layouts = [
            v
            for v in EVERY
            if within(v, asked.get("names", FAMILIES))
            and SIZE[v].sum() >= asked.get("floor", 0)
            and all(v[hit].any() for hit in asked.get("hits", ()))
            and not np.any(v & ~asked.get("allowed", np.ones(POOL, dtype=bool)))
            and not np.any(asked.get("required", np.zeros(POOL, dtype=bool)) & ~v)
        ]
        assert found.settled
        if not layouts:
            assert found.gauges is None
            assert found.bound == -np.inf
            continue
        best = max(layouts, key=lambda v: value[v].sum())
        assert found.gauges.tolist() == np.flatnonzero(best).tolist()
        assert found.bound == pytest.approx(value[best].sum(), abs=1e-6 * unit)


@pytest.mark.parametrize("unit", [1e-9, 1e9])
def test_the_unit_of_prices_changes_nothing(unit):
    for seed in range(5):
        value = np.random.default_rng(seed).uniform(0.5, 1.0, POOL)
        here, there = (best_layout(limits_of(POOL, 6, price=u * PRICE, budget=u * 3.0), value) for u in (1.0, unit))
        assert PRICE[here.gauges].sum() <= 3.0
        assert there.gauges.tolist() == here.gauges.tolist()


def test_search_limit_is_reported():
    # a knapsack of prices that are next to what they are worth; no branching allowed
    rng = np.random.default_rng(0)
    price = rng.integers(1000, 2000, 24).astype(float)
    value = price + rng.integers(-5, 6, 24)
    limits = limits_of(24, 24, price=price, budget=0.5 * price.sum() + 0.5)
    proven, hasty = best_layout(limits, value, nodes=5000), best_layout(limits, value, nodes=0)
    assert not hasty.settled
    assert hasty.bound >= value[proven.gauges].sum() - 1e-6
    if hasty.gauges is not None:
        assert limits.allows(hasty.gauges)
        assert value[hasty.gauges].sum() <= proven.bound + 1e-6


def test_prices_are_not_rounded_into_a_budget():
    # three of a price that passes the budget by 2e-7 of it: the program by itself would let them through
    price = np.full(4, 1 / 3 * (1 + 2e-7))
    found = best_layout(limits_of(4, 4, price=price, budget=1.0), np.ones(4))
    assert len(found.gauges) == 2


def test_what_breaks_the_budget_even_so_is_not_taken(monkeypatch):
    monkeypatch.setattr(module, "milp", lambda *_, **__: OptimizeResult(x=np.ones(4), status=0, mip_dual_bound=-4.0))
    found = best_layout(limits_of(4, 4, price=np.ones(4), budget=3.0), np.ones(4))
    assert found.gauges is None
    assert not found.settled
    assert found.bound == 4.0


def walks(channels):
    """Three walks; every gauge reads those that it is given."""
    H = np.zeros((len(channels), 2, 3))
    for block, states in zip(H, channels, strict=True):
        for row, state in zip(block, states, strict=False):
            row[state] = 1.0
    return solve_pool(Scenario(np.zeros((3, 3)), np.eye(3), H, np.full((len(channels), 2), 1e-2), np.ones(3)))


READ = [(0,), (1,), (2,), (0, 1), (1, 2), (0,), (1,), (0,)]
NAMES = ("a", "b", "c")


def tells(gauges):
    return {state for g in gauges for state in READ[g]} == {0, 1, 2}


def test_masks_cover_every_layout():
    detection = Detection([walks(READ)])
    for v in EVERY:
        assert detection.loses(np.flatnonzero(v)) == (not tells(np.flatnonzero(v)))
    assert len(detection.hits) == len({hit.tobytes() for hit in detection.hits})
    for v in EVERY:
        assert all(hit[v].any() for hit in detection.hits) == tells(np.flatnonzero(v))
    assert detection.words(np.array([0, 2]), NAMES) == "b"
    assert detection.words(np.array([3, 2]), NAMES) == "nothing"


@pytest.mark.parametrize("seed", range(6))
def test_best_layout_detects_all_unknowns(seed):
    value = np.random.default_rng(seed).normal(0.0, 1.0, POOL)
    found = Detection([walks(READ)]).layout(limits_of(POOL, 4), value)
    layouts = [v for v in EVERY if v.sum() <= 4 and tells(np.flatnonzero(v))]
    assert found.gauges.tolist() == np.flatnonzero(max(layouts, key=lambda v: value[v].sum())).tolist()


def test_sets_of_too_few_gauges_are_not_tried_one_by_one(monkeypatch):
    """Sixty gauges, each with an answer of its own to three walks: any three detect them, and 1770 pairs do not."""
    rows = np.random.default_rng(0).normal(size=(60, 3))
    pool = solve_pool(Scenario(np.zeros((3, 3)), np.eye(3), rows, np.full(60, 1e-2), np.ones(3)))
    programs = []
    solve = module.milp

    def counted(*args, **options):
        programs.append(args)
        assert len(programs) < 10
        return solve(*args, **options)

    monkeypatch.setattr(module, "milp", counted)
    limits = limits_of(60, 4, price=np.full(60, 3.0), budget=1.0)
    error = refusal(limits, Detection([pool]), NAMES)
    assert error.what.startswith("the cheapest gauges that make every unknown observable cost 9, but place.budget is 1")


ALL = np.arange(POOL)
REFUSED = {
    "bonded dearly": (
        {"keep": 3, "fixed": (4, 7), "price": PRICE, "budget": 4.0},
        "place.budget",
        "bonded gauges (gauges.fixed) use 4.5 of the 4 that place.budget allows",
    ),
    "no room in two zones": (
        {"keep": 4, "zones": [("place.at_most.0", ALL < 4, 1), ("place.at_most.1", ALL > 3, 2)]},
        "place.at_most.1",
        "place.at_most.1 together with place.at_most.0 allows only 3 of the 8 candidate gauges",
    ),
    "no room in the second by itself": (
        {"keep": 4, "zones": [("place.at_most.0", ALL < 4, 3), ("place.at_most.1", ALL >= 0, 2)]},
        "place.at_most.1",
        "requested, but place.at_most.1 allows only 2 of the 8 candidate gauges",
    ),
    "no room at all": (
        {"keep": 1, "zones": [("place.at_most.0", ALL >= 0, 0)]},
        "place.at_most.0",
        "place.at_most.0 allows only 0 of the 8 candidate gauges",
    ),
    "a zone hides a walk": (
        {"keep": 4, "zones": [("place.at_most.0", np.isin(ALL, [2, 4]), 0)]},
        "place.at_most.0",
        "no layout within place.at_most.0 can observe c",
    ),
    "too dear together": (
        {"keep": 3, "price": PRICE, "budget": 0.7},
        "place.budget",
        "the cheapest gauges that make every unknown observable cost 0.8, but place.budget is 0.7",
    ),
    "too few": ({"keep": 1}, "place.keep", "the smallest set that makes every unknown observable has 2"),
    "too few in a zone": (
        {"keep": 2, "zones": [("place.at_most.0", np.isin(ALL, [3, 4]), 0)]},
        "place.keep",
        "the smallest set that makes every unknown observable within place.at_most.0 has 3",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_the_first_family_that_leaves_no_layout_is_named(case):
    asked, key, words = REFUSED[case]
    error = refusal(limits_of(POOL, **asked), Detection([walks(READ)]), NAMES)
    assert words in str(error)
    assert "stopped at its limit" not in str(error)
    assert error.key == key
    assert error.remedy


@pytest.mark.parametrize("case", ["no room in two zones", "too few"])
def test_unproven_refusal_states_search_limit(monkeypatch, case):
    def hasty(*arguments, **more):
        return replace(best_layout(*arguments, **more), settled=False)

    monkeypatch.setattr(module, "best_layout", hasty)
    asked, key, _ = REFUSED[case]
    error = refusal(limits_of(POOL, **asked), Detection([walks(READ)]), NAMES)
    assert "stopped at its limit of 200 nodes" in str(error)
    assert error.key == key
