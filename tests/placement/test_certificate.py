"""No set beats the bound, by exhaustive search; the cuts that it is made of."""

from __future__ import annotations

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import LinearConstraint, NonlinearConstraint, linprog, minimize

from strainsight.errors import NumericalError
from strainsight.placement import certificate as module
from strainsight.placement.certificate import Cut, certify, cut_at, lowest
from strainsight.placement.layouts import Detection
from strainsight.placement.limits import Polytope, cheapest, limits_of
from strainsight.placement.scenario import Scenario, solve_pool

from .conftest import beam_of, every_set, scenarios_of
from .whole_pools import eliminate


def walks(q, unit):
    """Three walks of intensities q (3,), gauge g reading walk READS[g] alone: tr(W P) = unit Σ √(qᵢ / Σ γ over its gauges)."""
    return solve_pool(Scenario(np.zeros((3, 3)), np.diag(q), np.eye(3)[READS], 1 / PRECISION, np.full(3, unit)))


READS = np.array([0, 1, 2, 0, 1, 2, 0, 1, 0, 2])
PRECISION = np.array([1.0, 3.0, 2.0, 0.3, 5.0, 0.7, 2.5, 0.2, 1.4, 9.0])
SPREAD = [np.array([1.0, 4.0, 0.2]), np.array([0.1, 9.0, 2.0])]


def cost_of_walks(q, w):
    return sum(np.sqrt(q[i] / max((w * PRECISION)[i == READS].sum(), 1e-9)) for i in range(3))


BOUNDED = {
    "count": {},
    "bonded": {"fixed": (3, 7)},
    "pairs": {"size": np.array([2, 1] * 5)},
    "budget": {"price": PRECISION, "budget": 9.0},
    "spacing": {"near": np.array([(0, 3), (1, 2), (4, 5), (6, 8), (8, 9)])},
}


@pytest.mark.parametrize(("aggregate", "unit"), [("mean", 1e6), ("worst", 1e-6)])
@pytest.mark.parametrize("case", BOUNDED)
def test_the_relaxation_of_walks_is_that_of_a_general_solver(case, aggregate, unit):
    combine = {"mean": np.mean, "worst": np.max}[aggregate]
    pools, limits = [walks(q, unit) for q in SPREAD], limits_of(10, 5, **BOUNDED[case])
    gauges = limits.packed(np.array([4, 5, 6, 9, 1, 0, 2, 3, 7, 8]), np.array(sorted(limits.fixed), dtype=int))
    cost = combine([cost_of_walks(q, np.isin(np.arange(10), gauges)) for q in SPREAD])
    found = certify(pools, gauges, unit * cost, aggregate, limits=limits)
    # w and t: least t with t ≥ f_s(w)
    best = minimize(
        lambda z: z[-1],
        np.append(np.where(np.isin(np.arange(10), gauges), 0.7, 0.2), 2 * cost),
        bounds=[(float(g in limits.fixed), 1) for g in range(10)] + [(0, None)],
        constraints=[
            LinearConstraint(np.hstack([limits.rows.toarray(), np.zeros((len(limits.most), 1))]), -np.inf, limits.most),
            NonlinearConstraint(
                lambda z: (
                    z[-1] - np.array([combine([cost_of_walks(q, z[:-1]) for q in SPREAD])])
                    if aggregate == "mean"
                    else [z[-1] - cost_of_walks(q, z[:-1]) for q in SPREAD]
                ),
                0,
                np.inf,
            ),
        ],
        method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 500},
    ).fun
    best *= unit
    assert found.lower_bound <= best * (1 + 1e-7)
    assert found.relaxed >= best * (1 - 1e-7)
    assert found.relaxed - found.lower_bound <= (1.001e-4 if aggregate == "mean" else 5e-3) * found.relaxed
    assert found.iterations < (60 if aggregate == "mean" else 300)
    np.testing.assert_allclose(found.gap, 1 - found.lower_bound / (unit * cost), atol=1e-12)
    assert np.all(found.weights[list(limits.fixed)] == 1)
    assert np.all(limits.rows @ found.weights <= limits.most + 1e-5)
    assert unit * combine([cost_of_walks(q, found.weights) for q in SPREAD]) <= found.relaxed * 1.01


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
def test_no_set_with_a_gauge_costs_less_than_its_own_bound(aggregate):
    """By brute force over all sets of three, and over those whose gauges keep apart."""
    scenarios = scenarios_of(beam_of(11, 2), ("Fz",), ("E",), instants=(55, 871))
    greedy = eliminate(scenarios, 3, aggregate)
    pools, costs = greedy.pools, every_set(greedy.pools, 3, aggregate)
    apart = limits_of(11, 3, near=np.array([[i, i + 1] for i in range(10)]))
    for limits in (limits_of(11, 3), apart):
        allowed = {gauges: cost for gauges, cost in costs.items() if limits.allows(np.array(gauges))}
        best = min(allowed, key=allowed.__getitem__)
        found = certify(pools, best, allowed[best], aggregate, limits=limits)
        for gauge in range(11):
            least = min(cost for gauges, cost in allowed.items() if gauge in gauges)
            assert found.lower_bound * (1 - 1e-9) <= found.including[gauge] <= least * (1 + 1e-7)
        assert np.sum(found.including > found.lower_bound * 1.001) >= 3


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
        assert np.all(limits.rows @ low.weights <= limits.most * (1 + 1e-8) + 1e-8)
        assert limits.size @ low.weights >= limits.least - 1e-8
        np.testing.assert_array_equal(low.weights[[2, 5]], [1, 0])
        assert model(low.weights) == pytest.approx(low.value, abs=1e-7 * unit)
        costs = {tuple(v): model(v) for v in layouts(limits, inside, free)}
        assert low.value <= min(costs.values()) + 1e-12 * unit
        for gauge in np.flatnonzero(free):
            others = [np.array(v) for v in costs if v[gauge] != low.selected[gauge]]
            assert low.value + low.reduced[gauge] <= min(map(model, others), default=np.inf) + 1e-12 * unit
            assert low.reduced[gauge] >= 0
            # complementary slackness: a price is paid only where the weights have chosen
            if low.reduced[gauge] > 1e-6 * unit:
                assert low.weights[gauge] == pytest.approx(float(low.selected[gauge]), abs=1e-6)
        assert np.all(low.reduced[~free] == np.inf)
        prices += list(low.reduced[free] / unit)
        fewer = lowest(
            [c for c, active in zip(cuts, low.active, strict=True) if active], inside, free, limits, aggregate
        )
        assert fewer.value == pytest.approx(low.value, abs=1e-9 * unit)
    assert max(prices) > 0.01


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
            others = [v for v in found if v[gauge] != low.selected[gauge]]
            least = min((model_of(cuts, aggregate)(v) for v in others), default=np.inf)
            assert low.value + low.reduced[gauge] <= least + 1e-12


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
def test_single_layout_bound_equals_cutting_planes(aggregate):
    cuts, inside, free = drawn(0)
    for limits, taken in ((limits_of(POOL, 7), free), (limits_of(POOL, 1), np.zeros(POOL, dtype=bool))):
        low = lowest(cuts, inside, free, limits, aggregate)
        assert low.selected.tolist() == taken.tolist()
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


def test_weights_that_see_all_but_cannot_be_solved_have_no_cut(monkeypatch):
    pools = [solve_pool(s) for s in scenarios_of(beam_of(10, 3), ("Fz",), ("E",))]
    assert cut_at(pools, np.full(10, 0.5), None) is not None

    def refuse(*_):
        raise NumericalError("not solved")

    monkeypatch.setattr(module, "refine", refuse)
    assert cut_at(pools, np.full(10, 0.5), None) is None


def nearest(w, rows, bonded):
    """The point of the box next to w within linear constraints, by a general solver; bonded weights are 1."""
    found = minimize(
        lambda v: np.sum((v - w) ** 2),
        np.full(len(w), 0.4),
        jac=lambda v: 2 * (v - w),
        bounds=[(float(g in bonded), 1) for g in range(len(w))],
        constraints=rows,
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    return found.x


def drawn_limits(seed):
    """Limits of a pool of 12 of which the even ones with a budget, by seed."""
    rng = np.random.default_rng(seed)
    return rng, limits_of(
        12,
        5,
        fixed=(3,),
        size=rng.integers(1, 3, 12),
        price=rng.uniform(0, 2, 12) * (rng.random(12) < 0.7),
        budget=4.0 if seed % 2 == 0 else None,
        near=np.array([(0, 1), (1, 2), (3, 4), (5, 6), (6, 7), (5, 7)]),
        zones=[("place.at_most.0", np.arange(12) > 7, 1)],
    )


@pytest.mark.parametrize("seed", range(6))
def test_the_projection_is_the_nearest_point_and_the_least_that_of_a_program(seed):
    rng, limits = drawn_limits(seed)
    region = Polytope(limits)
    A = np.vstack([limits.rows.toarray(), -limits.size])
    b = np.append(limits.most, -limits.least)
    bounds = [(1, 1) if g in limits.fixed else (0, 1) for g in range(12)]
    for _ in range(3):
        w = rng.normal(0.5, 1.0, 12)
        mine = region.project(w)
        assert np.all(A @ mine <= b + 1e-6)
        assert mine[3] == 1
        np.testing.assert_allclose(mine, nearest(w, LinearConstraint(A, -np.inf, b), limits.fixed), atol=2e-5)
        slope = -rng.exponential(1.0, 12)
        least = linprog(slope, A_ub=A, b_ub=b, bounds=bounds).fun
        np.testing.assert_allclose(region.least(slope)[0], least, rtol=1e-9)


@pytest.mark.parametrize("case", ["plain", "plain, bonded", "pairs", "pairs, bonded", "budget", "budget in cents"])
def test_weights_far_too_low_or_high_move_to_the_nearest_that_the_limits_allow(case):
    """In words: 0 ≤ w ≤ 1, bonded at 1, least ≤ Σ size·w ≤ keep, price·w ≤ budget."""
    rng = np.random.default_rng(3)
    fixed = (2, 7) if "bonded" in case else ()
    size = np.where(np.arange(10) % 2, 1, 2) if "pairs" in case else np.ones(10)
    price, budget, unit = rng.uniform(0, 1, 10), 1.2, 1e-9 if "cents" in case else 1e9
    asked = {"price": unit * price, "budget": unit * budget} if "budget" in case else {"size": size}
    region = Polytope(limits_of(10, 6, fixed=fixed, **asked))
    least = 0 if "budget" in case else 5 if "pairs" in case else 6
    rows = [LinearConstraint(size, least, 6)]
    rows += [LinearConstraint(price, -np.inf, budget)] if "budget" in case else []
    for shift in (-1.0, 0.5, 2.0):
        w = rng.normal(shift, 0.4, 10)
        np.testing.assert_allclose(region.project(w), nearest(w, rows, fixed), atol=2e-5)


@pytest.mark.parametrize("seed", range(20))
def test_the_cheapest_sum_is_that_of_a_linear_program(seed):
    rng = np.random.default_rng(seed)
    slope, size = rng.normal(rng.choice([-1, 0, 1]), 1.0, 7), rng.integers(1, 4, 7)
    least = int(rng.integers(-2, 8))
    most = max(0, least + int(rng.integers(0, 9)))
    value, theta = cheapest(slope, size, least, most)
    done = linprog(slope, A_ub=np.array([size, -size]), b_ub=[most, -least], bounds=(0, 1))
    if done.status == 2:
        assert value == np.inf
        return
    np.testing.assert_allclose(value, done.fun, atol=1e-9)
    # leaving out what it takes, or the other way round, costs at least what the multiplier says
    for g in range(7):
        price = slope[g] + theta * size[g]
        other = linprog(
            slope,
            A_ub=np.array([size, -size]),
            b_ub=[most, -least],
            bounds=[((0, 0) if price < 0 else (1, 1)) if i == g else (0, 1) for i in range(7)],
        )
        assert other.status == 2 or other.fun >= value + abs(price) - 1e-9


def test_where_all_may_be_taken_the_cheapest_sum_is_that_of_what_costs_less_than_nothing():
    slope, size = np.array([-3.0, 2.0, -0.5, 0.0]), np.array([1, 2, 3, 1])
    for most in (7, 8, 100):
        assert cheapest(slope, size, 0, most) == (-3.5, 0.0)
    assert cheapest(slope[:0], size[:0], 0, 3) == (0.0, 0.0)
    assert cheapest(slope[:0], size[:0], 1, 3)[0] == np.inf
    assert cheapest(slope, size, 7, 7)[0] == pytest.approx(-1.5)


def test_what_swings_without_damping_needs_a_gauge_that_sees_either_part_of_it():
    F = np.zeros((4, 4))
    F[0, 1], F[1, 0], F[2, 3], F[3, 2] = 1.0, -4.0, 1.0, -9.0
    H = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 2.0, 0], [0, 0, 0, 1.0], [0, 0, 0, 0]])
    pool = solve_pool(Scenario(F, np.eye(4), H, np.ones(5), np.ones(4)))
    detection = Detection([pool])
    assert not detection.loses(np.array([0, 3]))
    assert not detection.loses(np.array([1, 2]))
    assert detection.hits == []
    assert detection.loses(np.array([0, 1, 4]))
    assert [hit.tolist() for hit in detection.hits] == [[False, False, True, True, False]]
    found = detection.layout(limits_of(5, 2, near=np.array([(0, 2), (0, 3)])), np.array([5.0, 1, 1, 1, 4]))
    assert found.gauges.tolist() in ([1, 2], [1, 3])


def test_a_stopped_search_still_gives_a_bound():
    greedy = eliminate(scenarios_of(beam_of(40), ("Fz",), ("E",), noise=1e-9), 4)
    found = [certify(greedy.pools, greedy.selected, greedy.cost[-1], budget=b) for b in (1, 3, 10, 300)]
    assert [each.iterations for each in found[:3]] == [1, 3, 10]
    assert 10 < found[3].iterations <= 300
    bounds = [each.lower_bound for each in found]
    assert bounds == sorted(bounds)
    assert 0.9 * greedy.cost[-1] < bounds[-1] <= greedy.cost[-1]
