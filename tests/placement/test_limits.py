"""Layouts within limits: none is ever broken, no bound exceeds the best of all layouts, the search finds it."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from strainsight.errors import ConfigError, InfeasibleError
from strainsight.placement.branch_and_bound import branch_and_bound
from strainsight.placement.certificate import certify
from strainsight.placement.elimination import eliminate
from strainsight.placement.exchange import exchange
from strainsight.placement.failure import loss_if_one_fails, robust_set
from strainsight.placement.fill import fill
from strainsight.placement.limits import Swaps, as_limits, limits_of
from strainsight.placement.scenario import Scenario, solve_pool, subset_covariance

POOL = 11


@pytest.fixture(scope="module")
def every_cost(oracle, beam_of, scenarios_of):
    """Scenarios, their pools and {units: cost} of every set of one to five rows; mirrored rows are blocks of two."""
    made = {}

    def costs(aggregate="mean", paired=0, seed=0):
        key = (aggregate, paired, seed)
        if key not in made:
            instants = (55, 260) if aggregate == "worst" else (63,)
            scenarios = scenarios_of(beam_of(2 * POOL, 2, seed=seed), ("Fz",), ("E",), instants=instants)
            blocks = []
            for s in scenarios:
                H, r = s.H.reshape(POOL, 2, -1).copy(), s.r.reshape(POOL, 2)
                H[paired:, 1] = 0.0
                blocks.append(Scenario(s.F, s.Q, H, r, s.weight))
            pools = [solve_pool(s) for s in blocks]
            combine = {"mean": np.mean, "worst": np.max}[aggregate]
            table = {}
            for k in range(1, 6):
                for units in combinations(range(POOL), k):
                    seen = all(subset_covariance(p, units) is not None for p in pools)
                    values = (
                        [p.scenario.weight @ np.diag(oracle(p.scenario, list(units))) for p in pools]
                        if seen
                        else [np.inf]
                    )
                    table[units] = float(combine(values))
            made[key] = blocks, pools, table
        return made[key]

    return costs


class Rules:
    """The limits once more, in words that a test can check."""

    def __init__(self, keep, *, fixed=(), size=None, price=None, budget=None, near=(), zones=()):
        self.keep, self.fixed, self.near, self.zones = keep, fixed, near, zones
        self.size = np.ones(POOL, dtype=int) if size is None else size
        self.price, self.budget = price, budget
        self.limits = limits_of(
            POOL, keep, fixed=fixed, size=size, price=price, budget=budget, near=np.array(near), zones=zones
        )

    def hold(self, units, least=True):
        units = [int(u) for u in units]
        total = sum(self.size[u] for u in units)
        spare = 0 if self.size.max() == 1 else 1
        return (
            total <= self.keep
            and (not least or self.budget is not None or total >= self.keep - spare)
            and set(self.fixed) <= set(units)
            # two that are glued are as they are
            and not any({a, b} <= set(units) and (a == b or not {a, b} <= set(self.fixed)) for a, b in self.near)
            and all(sum(int(members[u]) for u in units) <= most for _, members, most in self.zones)
            and (self.budget is None or sum(self.price[u] for u in units) <= self.budget * (1 + 2e-9))
        )


def zone(name, members, most):
    return (name, np.isin(np.arange(POOL), members), most)


PRICE = np.array([3.0, 1.0, 2.5, 0.7, 1.1, 4.0, 0.0, 2.2, 1.3, 0.9, 5.0])
PAIRS = np.array([2] * 6 + [1] * 5)
NEAR = [(0, 1), (1, 2), (0, 2), (2, 3), (4, 5), (5, 6), (7, 10), (8, 9), (9, 10)]
CASES = {
    "count": lambda: Rules(4),
    "fixed": lambda: Rules(4, fixed=(2, 9)),
    "spacing": lambda: Rules(4, near=NEAR),
    "spacing, fixed": lambda: Rules(4, near=NEAR, fixed=(5,)),
    "zones": lambda: Rules(
        4, zones=[zone("place.at_most.0", [0, 1, 2, 3, 4, 5], 1), zone("place.at_most.1", [5, 6, 7], 1)]
    ),
    "a fixed gauge in two zones": lambda: Rules(
        4, fixed=(5,), zones=[zone("place.at_most.0", [0, 2, 5, 8], 1), zone("place.at_most.1", [3, 4, 5, 6], 2)]
    ),
    "budget": lambda: Rules(4, price=PRICE, budget=4.3),
    "generous budget": lambda: Rules(3, price=PRICE, budget=100.0),
    "tight budget": lambda: Rules(5, price=PRICE, budget=1.6),
    "budget, zone, spacing": lambda: Rules(
        4, price=PRICE, budget=5.0, near=NEAR, zones=[zone("place.at_most.0", [3, 6, 9], 1)]
    ),
    "all cost nothing": lambda: Rules(3, price=np.zeros(POOL), budget=0.0),
    "pairs": lambda: Rules(4, size=PAIRS),
    "pairs, odd": lambda: Rules(5, size=PAIRS),
    "pairs, fixed": lambda: Rules(5, size=PAIRS, fixed=(1, 8)),
    "pairs, spacing": lambda: Rules(4, size=PAIRS, near=NEAR),
    "pairs too near to their mirror images": lambda: Rules(5, size=PAIRS, near=[*NEAR, (0, 0), (3, 3), (9, 9)]),
    "fixed too near to one another": lambda: Rules(4, near=[*NEAR, (1, 3), (5, 9)], fixed=(1, 2, 3)),
    "pairs, budget": lambda: Rules(5, size=PAIRS, price=PRICE, budget=5.2),
}


def paired(rules):
    return int((rules.size == 2).sum())


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
@pytest.mark.parametrize("case", CASES)
def test_no_layout_breaks_a_limit_and_the_search_finds_the_best(every_cost, case, aggregate):
    rules = CASES[case]()
    scenarios, pools, costs = every_cost(aggregate, paired(rules))
    limits = rules.limits
    layouts = {units: cost for units, cost in costs.items() if rules.hold(units)}
    best = min(layouts.values())
    for units in costs:
        assert limits.allows(np.array(units)) == rules.hold(units)
    kept = eliminate(scenarios, limits, aggregate)
    assert rules.hold(kept.kept)
    np.testing.assert_allclose(kept.trace[-1], costs[tuple(kept.kept.tolist())], rtol=1e-7)
    filled = fill(pools, kept.kept, limits, aggregate)
    assert rules.hold(filled)
    assert not any(rules.hold([*filled, g]) for g in set(range(POOL)) - set(filled.tolist()))
    swapped = exchange(pools, filled, aggregate, limits=limits)
    assert rules.hold(swapped.gauges)
    mine = costs[tuple(swapped.gauges.tolist())]
    np.testing.assert_allclose(swapped.trace[-1], mine, rtol=1e-7)
    for other in one_move_away(swapped.gauges.tolist(), rules):
        assert costs[other] >= mine * (1 - 2e-9)
    certificate = certify(pools, swapped.gauges, mine, aggregate, limits=limits)
    assert certificate.lower_bound <= best * (1 + 1e-8)
    assert certificate.lower_bound > 0.4 * best
    assert certificate.relaxed - certificate.lower_bound < 0.02 * certificate.relaxed
    found = branch_and_bound(pools, limits, aggregate)
    assert found.proven
    assert rules.hold(found.gauges)
    np.testing.assert_allclose(costs[tuple(found.gauges.tolist())], best, rtol=1e-6)
    assert found.lower_bound <= best * (1 + 1e-9)


def one_move_away(units, rules):
    others = set(range(POOL)) - set(units)
    moved = [tuple(sorted({*units, j} - {i})) for i in set(units) - set(rules.fixed) for j in others]
    moved += [tuple(sorted({*units, j})) for j in others]
    return [m for m in moved if rules.hold(m)]


@pytest.mark.parametrize("case", CASES)
def test_what_fits_beside_a_set_what_fills_it_and_who_may_leave_for_whom(case):
    rules, rng = CASES[case](), np.random.default_rng(7)
    limits = rules.limits
    for _ in range(8):
        order = rng.permutation(POOL)
        start = np.array(rules.fixed, dtype=int)
        full = limits.packed(order, start)
        chosen = list(rules.fixed)
        for g in order.tolist():
            if g not in chosen and rules.hold([*chosen, g], least=False):
                chosen.append(g)
        assert full.tolist() == sorted(chosen)
        some = full[np.isin(full, start) | (rng.random(len(full)) < 0.7)]
        for units in (full, some):
            used, swaps = limits.used(units), Swaps(limits, units, np.setdiff1d(units, start))
            np.testing.assert_allclose(used[0], rules.size[units].sum())
            for g in np.setdiff1d(order, units).tolist():
                fits = rules.hold([*units, g], least=False)
                assert limits.fits(used, g) == fits
                assert limits.too_large(used)[g] == (not fits)
                assert swaps.room[g] == fits
                leave = [rules.hold([*np.setdiff1d(units, [i]), g]) for i in np.setdiff1d(units, start)]
                assert swaps.out(g).tolist() == leave
            assert not swaps.room[units].any()


@pytest.mark.parametrize("case", CASES)
def test_rows_alike_stand_for_each_other_in_every_limit(case):
    rules = CASES[case]()
    for a, b in combinations(range(POOL), 2):
        alike = rules.limits.alike[a] == rules.limits.alike[b]
        assert alike == np.array_equal(*rules.limits.rows.toarray()[:, [a, b]].T)


@pytest.mark.parametrize("case", CASES)
def test_a_robust_layout_breaks_no_limit_and_no_move_helps(every_cost, case):
    rules = CASES[case]()
    _, pools, costs = every_cost("mean", paired(rules))
    found = robust_set(pools, rules.limits)
    assert rules.hold(found.gauges)
    np.testing.assert_allclose(found.loss, loss_if_one_fails(pools, found.gauges), rtol=1e-9)

    def measure(units):
        loss = [costs[tuple(u for u in units if u != out)] if len(units) > 1 else np.inf for out in units]
        finite = [v for v in loss if v < np.inf]
        return len(loss) - len(finite), max(finite, default=0.0)

    fatal, worst = measure(found.gauges.tolist())
    assert fatal == len(found.fatal)
    for other in one_move_away(found.gauges.tolist(), rules):
        lost, largest = measure(other)
        assert lost >= fatal
        assert lost > fatal or largest >= worst * (1 - 2e-9)


@pytest.mark.parametrize("seed", range(12))
def test_limits_drawn_at_random_hold(every_cost, seed):
    rng = np.random.default_rng(seed)
    size = PAIRS if seed % 3 == 0 else None
    price = np.round(rng.uniform(0, 3, POOL), 2) * (rng.random(POOL) < 0.8)
    members = [rng.permutation(POOL)[: rng.integers(2, 8)] for _ in range(2)]
    rules = Rules(
        int(rng.integers(3, 6)),
        size=size,
        fixed=tuple(rng.permutation(POOL)[: rng.integers(0, 2)].tolist()),
        price=price if seed % 2 else None,
        budget=float(rng.uniform(3, 6)) if seed % 2 else None,
        near=[tuple(sorted(rng.permutation(POOL)[:2].tolist())) for _ in range(rng.integers(0, 12))],
        zones=[zone(f"place.at_most.{i}", m, int(rng.integers(1, 3))) for i, m in enumerate(members)],
    )
    scenarios, pools, costs = every_cost("mean", paired(rules))
    layouts = {units: cost for units, cost in costs.items() if rules.hold(units) and cost < np.inf}
    if not layouts:
        with pytest.raises(InfeasibleError):
            eliminate(scenarios, rules.limits)
        return
    best = min(layouts.values())
    kept = eliminate(scenarios, rules.limits).kept
    assert rules.hold(kept)
    swapped = exchange(pools, fill(pools, kept, rules.limits), limits=rules.limits)
    assert rules.hold(swapped.gauges)
    certificate = certify(pools, swapped.gauges, swapped.trace[-1], limits=rules.limits)
    assert certificate.lower_bound <= best * (1 + 1e-8)
    found = branch_and_bound(pools, rules.limits)
    assert found.proven
    assert rules.hold(found.gauges)
    np.testing.assert_allclose(costs[tuple(found.gauges.tolist())], best, rtol=1e-6)
    assert found.lower_bound <= best * (1 + 1e-9)


@pytest.mark.parametrize("case", ["budget", "pairs, odd", "generous budget", "zones", "spacing"])
def test_the_gauge_of_the_least_rise_per_relief_leaves(every_cost, oracle, case):
    """Every step against all candidates, in the words of the docstring."""
    rules = CASES[case]()
    scenarios, pools, _ = every_cost("mean", paired(rules))
    found = eliminate(scenarios, rules.limits)
    A, b = rules.limits.rows.toarray(), rules.limits.most
    s = pools[0].scenario
    left, held = list(range(POOL)), 0
    for out in found.removed.tolist():
        excess = np.maximum(A[:, left].sum(axis=1) - b, 0)
        relief = A.T @ (excess / b**2)
        present = s.weight @ np.diag(oracle(s, left))
        rise = {
            g: (s.weight @ np.diag(oracle(s, [o for o in left if o != g])) - present) / relief[g]
            for g in left
            if relief[g] > 0
        }
        assert out in rise
        # what has a lower one is in every layout that is left
        for g in (g for g, value in rise.items() if value < rise[out] * (1 - 1e-4) - 1e-7):
            rest = [o for o in left if o != g]
            assert not any(rules.hold(units) for units in combinations(rest, rules.keep))
            held += 1
        left.remove(out)
    assert held <= 3


def test_a_plain_count_and_its_limits_are_one_thing(beam_of, scenarios_of):
    scenarios = scenarios_of(beam_of(30), ("Fz",), ("E",))
    plain, limited = eliminate(scenarios, 4), eliminate(scenarios, limits_of(30, 4))
    assert plain.removed.tolist() == limited.removed.tolist()
    assert limits_of(30, 4).plain
    assert not limits_of(30, 4, near=np.array([[1, 2]])).plain
    assert limits_of(30, 4, near=np.array([[1, 2]]), fixed=(1, 2)).plain
    # any two more beside the pair that is glued; but those are three rows of four gauges
    assert not limits_of(30, 4, size=np.where(np.arange(30) == 3, 2, 1), fixed=(3,)).plain


def test_what_is_glued_later_is_no_conflict_but_closes_its_surroundings():
    limits = Rules(5, near=[*NEAR, (4, 4)]).limits
    later, before = as_limits(POOL, limits, (0, 1, 8)), Rules(5, near=[*NEAR, (4, 4)], fixed=(0, 1, 8)).limits
    for k in (3, 4, 5):
        for units in combinations(range(POOL), k):
            assert later.allows(np.array(units)) == before.allows(np.array(units))
    assert later.fixed == before.fixed
    assert limits.fixed == frozenset()
    assert not as_limits(POOL, limits, (4,)).allows(np.array([1, 4, 7, 8, 6]))


def test_spacing_that_leaves_room_for_exactly_as_many(every_cost):
    # a path of eleven: no more than six, and those in one way only
    near = [(i, i + 1) for i in range(POOL - 1)]
    scenarios, _, _ = every_cost()
    rules = Rules(6, near=near)
    assert eliminate(scenarios, rules.limits).kept.tolist() == [0, 2, 4, 6, 8, 10]
    with pytest.raises(
        InfeasibleError, match=r"7 gauges asked for, place.minimum_spacing leaves room for 6 of the pool's 11"
    ) as refused:
        eliminate(scenarios, Rules(7, near=near).limits)
    assert refused.value.key == "place.minimum_spacing"


def test_a_swap_of_a_pair_leaves_room_that_is_used(every_cost):
    rules = Rules(4, size=PAIRS)
    _, pools, costs = every_cost("mean", 6)
    pairs = min((u for u in costs if len(u) == 2 and max(u) < 6), key=lambda u: -costs[u])
    found = exchange(pools, pairs, limits=rules.limits)
    assert any(out == -1 for out, _ in found.swaps) or len(found.gauges) == 2
    assert rules.hold(found.gauges)


REFUSED = {
    "fixed in one zone": (
        {"keep": 4, "fixed": (0, 1), "zones": [zone("place.at_most.0", [0, 1, 2], 1)]},
        "place.at_most.0",
        r"what is glued already \(gauges.fixed\) takes 2 gauges of the 1 that place.at_most.0 allows",
    ),
    "fixed too near to its own mirror image": (
        {"keep": 5, "fixed": (3, 4), "near": [(3, 4), (4, 4), (6, 6)]},
        "place.minimum_spacing",
        "the gauges of row 4 of the pool are glued already",
    ),
    "too near to their own mirror images": (
        {"keep": 4, "near": [(g, g) for g in range(8)]},
        "place.minimum_spacing",
        "place.minimum_spacing leaves room for 3 of the pool's 11",
    ),
    "fixed too dear": (
        {"keep": 4, "fixed": (0, 10), "price": PRICE, "budget": 7.5},
        "place.budget",
        "takes 8 of the 7.5 that place.budget allows",
    ),
    "zones": (
        {"keep": 4, "zones": [zone("place.at_most.0", range(6), 1), zone("place.at_most.1", range(5, 11), 2)]},
        "place.at_most.1",
        "place.at_most.1 together with place.at_most.0 leaves room for 3 of the pool's 11",
    ),
    "one zone": (
        {"keep": 4, "zones": [zone("place.at_most.3", range(11), 2)]},
        "place.at_most.3",
        "4 gauges asked for, place.at_most.3 leaves room for 2 of the pool's 11",
    ),
    "spacing of what is fixed": (
        {"keep": 3, "fixed": (0,), "near": [(0, i) for i in range(1, 10)]},
        "place.minimum_spacing",
        "place.minimum_spacing leaves room for 2 of the pool's 11",
    ),
    "budget": (
        {"keep": 4, "price": PRICE + 1, "budget": 2.6},
        "place.budget",
        r"the cheapest gauges that detect every unknown cost 2\.7, place.budget is 2\.6",
    ),
    "budget of nothing": (
        {"keep": 4, "price": PRICE, "budget": 0.0},
        "place.budget",
        "the cheapest gauges that detect every unknown cost 0.7, place.budget is 0",
    ),
    "count": ({"keep": 1}, None, r"1 gauges cannot observe 2 unknowns \(Fz, E\)"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_leaves_no_layout_is_named(every_cost, case):
    asked, key, words = REFUSED[case]
    scenarios, pools, _ = every_cost()
    limits = Rules(**asked).limits
    with pytest.raises(InfeasibleError, match=words) as refused:
        eliminate(scenarios, limits, names=("Fz", "E"))
    assert refused.value.key == key
    assert refused.value.remedy
    with pytest.raises(InfeasibleError):
        branch_and_bound(pools, limits)


def test_a_zone_around_all_that_see_an_unknown_is_named_with_it(beam_of, scenarios_of):
    beam = beam_of(POOL, 3)
    (scenario,) = scenarios_of(beam, ("Fz", "Fy"), ())
    H = scenario.H.copy()
    sideways = np.flatnonzero(np.abs(beam.model.input_shape[:, 1]) > 1e-6 * np.abs(beam.model.input_shape).max())
    H[np.ix_(np.arange(POOL) != 7, sideways)] = 0.0
    scenario = Scenario(scenario.F, scenario.Q, H, scenario.r, scenario.weight)
    closed = Rules(4, zones=[zone("place.at_most.0", [6, 7], 0)]).limits
    with pytest.raises(InfeasibleError, match=r"kept within place.at_most.0, they cannot tell Fy") as refused:
        eliminate([scenario], closed, names=("Fz", "Fy"))
    assert refused.value.key == "place.at_most.0"
    # gauge 7 is too dear for its neighbours: it stays, as every layout needs it
    price = np.where(np.arange(POOL) == 7, 9.0, 1.0)
    rules = Rules(4, price=price, budget=10.5, near=[(7, i) for i in (0, 1, 2, 3, 4)])
    kept = eliminate([scenario], rules.limits).kept
    assert 7 in kept
    assert rules.hold(kept)
    with pytest.raises(InfeasibleError, match=r"cost 10, place.budget is 9"):
        eliminate([scenario], Rules(4, price=price, budget=9.0).limits)
    # what is glued blinds the layout: three gauges of which none sees Fy
    blind = Rules(3, fixed=(0, 1, 2), zones=[zone("place.at_most.0", range(POOL), 9)]).limits
    with pytest.raises(InfeasibleError, match=r"the fewest of the pool .* within place.at_most.0 are 4") as refused:
        eliminate([scenario], blind)
    assert refused.value.key == "place.keep"


def test_impossible_counts_keep_their_words():
    with pytest.raises(ConfigError, match="12 gauges are to be kept of a pool of 11 with 0 fixed"):
        limits_of(11, 12)
    with pytest.raises(ConfigError, match="1 gauges are to be kept of a pool of 11 with 2 fixed"):
        limits_of(11, 1, fixed=(3, 4))
    with pytest.raises(ConfigError, match="18 gauges are to be kept of a pool of 17 with 4 fixed"):
        limits_of(11, 18, size=PAIRS, fixed=(0, 1))


def test_pairs_too_near_are_gathered_and_none_is_lost():
    rng = np.random.default_rng(0)
    place = rng.uniform(0, 1, (60, 2))
    near = np.array([(a, b) for a, b in combinations(range(60), 2) if np.linalg.norm(place[a] - place[b]) < 0.15])
    limits = limits_of(60, 5, near=near)
    assert len(limits.most) < 1 + 0.5 * len(near)
    pairs = set(map(tuple, near.tolist()))
    for a, b in combinations(range(60), 2):
        assert bool(np.all(limits.used(np.array([a, b])) <= limits.most)) == ((a, b) not in pairs)
