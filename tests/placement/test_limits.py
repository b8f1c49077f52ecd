"""Layouts within limits: none is ever broken, no bound exceeds the best of all layouts, the search finds it."""

from __future__ import annotations

from itertools import combinations, cycle

import numpy as np
import pytest

from strainsight.errors import InfeasibleError
from strainsight.placement.branch_and_bound import branch_and_bound
from strainsight.placement.certificate import certify
from strainsight.placement.exchange import exchange, fill
from strainsight.placement.failure import loss_if_one_fails, robust_set
from strainsight.placement.limits import Swaps, limits_of
from strainsight.placement.scenario import Scenario, solve_pool, subset_covariance

from ..shared import slowly
from .conftest import COMBINED, beam_of, oracle, scenarios_of
from .rules import CASES, POOL, Rules
from .whole_pools import eliminate

EVERY = [units for k in range(1, 6) for units in combinations(range(POOL), k)]


class Costs(dict):
    """{units: cost} of sets of rows, by the oracle where it is asked for."""

    def __init__(self, pools, combine, oracle):
        self.pools, self.combine, self.oracle = pools, combine, oracle

    def __missing__(self, units):
        values = [np.inf]
        if all(subset_covariance(p, units) is not None for p in self.pools):
            values = [p.scenario.weight @ np.diag(self.oracle(p.scenario, list(units))) for p in self.pools]
        self[units] = float(self.combine(values))
        return self[units]


@pytest.fixture(scope="module")
def every_cost():
    """Scenarios, their pools and what sets of rows cost; mirrored rows are blocks of two."""
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
            made[key] = blocks, pools, Costs(pools, COMBINED[aggregate], oracle)
        return made[key]

    return costs


def paired(rules):
    return int((rules.size == 2).sum())


@pytest.mark.parametrize(("case", "aggregate"), list(zip(CASES, cycle(["mean", "worst"]))))
def test_no_layout_breaks_a_limit_and_the_search_finds_the_best(every_cost, case, aggregate):
    rules = CASES[case]()
    scenarios, pools, costs = every_cost(aggregate, paired(rules))
    limits = rules.limits
    best = min(costs[units] for units in EVERY if rules.hold(units))
    for units in EVERY:
        assert limits.allows(np.array(units)) == rules.hold(units)
    kept = eliminate(scenarios, limits, aggregate)
    assert rules.hold(kept.selected)
    np.testing.assert_allclose(kept.cost[-1], costs[tuple(kept.selected.tolist())], rtol=1e-7)
    filled = fill(pools, kept.selected, limits, aggregate)
    assert rules.hold(filled)
    assert not any(rules.hold([*filled, g]) for g in set(range(POOL)) - set(filled.tolist()))
    swapped = exchange(pools, filled, aggregate, limits=limits)
    assert rules.hold(swapped.gauges)
    mine = costs[tuple(swapped.gauges.tolist())]
    np.testing.assert_allclose(swapped.cost[-1], mine, rtol=1e-7)
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
def test_limits_of_additions_and_swaps(case):
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


@pytest.mark.parametrize("case", [*list(CASES)[::2], *slowly(*list(CASES)[1::2])])
def test_a_robust_layout_breaks_no_limit_and_no_move_helps(every_cost, case):
    rules = CASES[case]()
    _, pools, costs = every_cost("mean", paired(rules))
    found = robust_set(pools, rules.limits)
    assert rules.hold(found)

    def measure(units):
        loss = [costs[tuple(u for u in units if u != out)] if len(units) > 1 else np.inf for out in units]
        finite = [v for v in loss if v < np.inf]
        return len(loss) - len(finite), max(finite, default=0.0)

    fatal, worst = measure(found.tolist())
    assert fatal == np.sum(loss_if_one_fails(pools, found) == np.inf)
    for other in one_move_away(found.tolist(), rules):
        lost, largest = measure(other)
        assert lost >= fatal
        assert lost > fatal or largest >= worst * (1 - 2e-9)


@pytest.mark.parametrize("case", ["budget", "pairs, odd", "generous budget", "zones", "spacing"])
def test_the_gauge_of_the_least_rise_per_relief_leaves(every_cost, case):
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
        for g in (g for g, value in rise.items() if value < rise[out] * (1 - 1e-4) - 1e-7):
            rest = [o for o in left if o != g]
            assert not any(rules.hold(units) for units in combinations(rest, rules.keep))
            held += 1
        left.remove(out)
    assert held <= 3


def test_spacing_that_leaves_room_for_exactly_as_many(every_cost):
    near = [(i, i + 1) for i in range(POOL - 1)]
    scenarios, _, _ = every_cost()
    rules = Rules(6, near=near)
    assert eliminate(scenarios, rules.limits).selected.tolist() == [0, 2, 4, 6, 8, 10]
    with pytest.raises(
        InfeasibleError, match=r"7 gauges requested, but place.minimum_spacing allows only 6 of the 11 candidate gauges"
    ) as refused:
        eliminate(scenarios, Rules(7, near=near).limits)
    assert refused.value.key == "place.minimum_spacing"


def test_pairs_too_near_are_gathered_and_none_is_lost():
    rng = np.random.default_rng(0)
    place = rng.uniform(0, 1, (60, 2))
    near = np.array([(a, b) for a, b in combinations(range(60), 2) if np.linalg.norm(place[a] - place[b]) < 0.15])
    limits = limits_of(60, 5, near=near)
    assert len(limits.most) < 1 + 0.5 * len(near)
    pairs = set(map(tuple, near.tolist()))
    for a, b in combinations(range(60), 2):
        assert bool(np.all(limits.used(np.array([a, b])) <= limits.most)) == ((a, b) not in pairs)
