"""Swaps of gauges end where none helps, and rounding does not choose between gauges that symmetry makes equal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from strainsight.placement.baselines import d_optimal, effective_independence, qr_pivoting, random_sets
from strainsight.placement.branch_and_bound import branch_and_bound
from strainsight.placement.criteria.choices import CRITERIA
from strainsight.placement.elimination import eliminate, eliminate_from
from strainsight.placement.exchange import exchange
from strainsight.placement.failure import robust_set
from strainsight.placement.fill import fill
from strainsight.placement.limits import as_limits, limits_of
from strainsight.placement.metric import Metric
from strainsight.placement.scenario import Scenario, solve_pool
from strainsight.placement.score import score


@pytest.mark.parametrize("instants", [(63,), (55, 871)])
def test_the_limit_is_never_passed_and_never_passes_for_an_end(beam_of, scenarios_of, instants):
    pools = eliminate(scenarios_of(beam_of(16, 5), ("Fz",), ("E",), instants=instants), 4).pools
    start = random_sets(16, 4, 1, seed=8)[0]
    whole = exchange(pools, start)
    assert whole.complete
    assert len(whole.swaps) > 0
    for limit in range(0, whole.solves, 3):
        stopped = exchange(pools, start, limit=limit)
        assert stopped.solves <= limit
        assert not stopped.complete
        assert stopped.swaps == whole.swaps[: len(stopped.swaps)]
    exact = exchange(pools, start, limit=whole.solves)
    assert exact.complete
    assert exact.swaps == whole.swaps


def test_beside_gauges_that_may_not_leave_room_is_filled(beam_of, scenarios_of):
    """Every gauge is bonded and the budget has room for two: two are added, each lowers the cost, and no more is tried."""
    pools = eliminate(scenarios_of(beam_of(12), ("Fz",), ("E",)), 4).pools
    bonded = [1, 5, 7]
    limits = limits_of(12, 6, fixed=bonded, price=np.ones(12), budget=5.0)
    found = exchange(pools, bonded, limits=limits)
    assert [out for out, _ in found.swaps] == [-1, -1]
    assert len(found.gauges) == 5
    assert set(bonded) <= set(found.gauges.tolist())
    assert found.cost[0] > found.cost[1] > found.cost[2]
    assert found.complete
    full = exchange(pools, found.gauges, limits=limits, fixed=found.gauges.tolist())
    assert (full.swaps, full.solves, full.complete) == ((), 0, True)


def swaps_in_words(oracle, pools, chosen, aggregate, limits):
    """The swaps of the docstring of `exchange`, every number from an oracle; and how many covariances they ask for."""
    combine = {"mean": np.mean, "worst": np.max}[aggregate]
    known = {}

    def at(gauges):
        """Costs (scenarios,) of a set, and φ (scenarios, pool)."""
        if tuple(gauges) not in known:
            costs, phi = [], []
            for pool in pools:
                s, rows = pool.scenario, pool.stacked(np.array(gauges))
                P = oracle(s, gauges)
                X = solve_continuous_lyapunov((s.F - P @ rows.T @ rows).T, -np.diag(s.weight))
                costs.append(s.weight @ np.diag(P))
                phi.append([np.trace(h @ P @ X @ P @ h.T) for h in pool.rows])
            known[tuple(gauges)] = np.array(costs), np.array(phi)
        return known[tuple(gauges)]

    def next_swap(solves):
        costs, phi = at(chosen)
        enough = combine(costs) * (1 - 1e-6)
        may_leave = [i for i in chosen if i not in limits.fixed]
        promise = {}
        for j in set(range(phi.shape[1])) - set(chosen):
            room = limits.allows(np.array([*chosen, j]))
            promise[j] = combine(costs - phi[:, j] + (0 if room else phi[:, may_leave].min(axis=1)))
        for j in sorted(promise, key=promise.get):
            grown = sorted([*chosen, j])
            without = {i: [g for g in grown if g != i] for i in may_leave}
            if limits.allows(np.array(grown)):
                without = {-1: grown}
            without = {i: rest for i, rest in without.items() if limits.allows(np.array(rest))}
            if promise[j] >= enough or not without:
                continue
            solves += len(pools)
            costs, phi = at(grown)
            bound = {i: combine(costs + (phi[:, i] if i >= 0 else 0)) for i in without}
            for i in sorted(bound, key=bound.get):
                if bound[i] < enough:
                    solves += len(pools) * (i >= 0)
                    if combine(at(without[i])[0]) < enough:
                        return (i, j), without[i], solves
        return None, chosen, solves

    swaps, solves = [], 0
    while True:
        swap, chosen, solves = next_swap(solves)
        if swap is None:
            return swaps, solves
        swaps.append(swap)


WITHIN = {
    "count": {},
    "spacing": {"near": np.array([(0, 3), (1, 6), (6, 9), (2, 8), (4, 5), (5, 10), (7, 11), (0, 7)])},
    "budget": {"price": np.tile([2.0, 1.0, 0.5], 4), "budget": 5.0},
    "pairs": {"size": np.tile([1, 2], 6)},
}


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
@pytest.mark.parametrize("case", WITHIN)
def test_the_swaps_are_those_of_its_words_and_no_more_is_solved(oracle, beam_of, scenarios_of, case, aggregate):
    scenarios = scenarios_of(beam_of(12, 2, seed=4), ("Fz",), ("E",), instants=(55, 871))
    pools = [solve_pool(s) for s in scenarios]
    rng = np.random.default_rng(1)
    made = 0
    for fixed in ((), (4,)):
        limits = limits_of(12, 4, fixed=fixed, **WITHIN[case])
        start = limits.packed(rng.permutation(12), np.array(fixed, dtype=int))
        found = exchange(pools, start, aggregate, limits=limits)
        swaps, solves = swaps_in_words(oracle, pools, start.tolist(), aggregate, limits)
        assert list(found.swaps) == swaps
        assert found.solves == solves
        assert found.complete
        made += len(swaps)
    assert made > 1


def test_gauges_that_are_equal_are_not_swapped_for_each_other(beam_of, scenarios_of):
    (scenario,) = scenarios_of(beam_of(6, 2), ("Fz",), ("E",))
    twice = Scenario(scenario.F, scenario.Q, np.tile(scenario.H, (2, 1)), np.tile(scenario.r, 2), scenario.weight)
    pools = [solve_pool(twice)]
    best = exchange(pools, [0, 1, 2]).gauges
    mirrored = np.sort((best + 6) % 12)
    for gauges in (best, mirrored):
        again = exchange(pools, gauges, limit=500)
        assert again.complete
        assert again.swaps == ()


def test_a_swap_that_loses_an_unknown_is_no_swap_and_counts_up_to_the_scenario_that_loses_it():
    """Two walks; 1 and 2 see the second one, 2 far better, and 1 is bonded: 2 for 0 promises much, but 0 alone sees the
    first walk. Where 2 sees that, too, in the first of two scenarios, it is lost in the second one only."""
    H = np.array([[[1.0, 0]], [[0, 1.0]], [[0, 1.0]]])
    sees_both = np.concatenate([H, [[[0, 0.0]]] * 3], axis=1)
    sees_both[2, 1, 0] = 1.0
    H = np.concatenate([H, np.zeros_like(H)], axis=1)
    r = np.array([1.0, 1.0, 1e-6])[:, None] * np.ones(2)
    one, both = (solve_pool(Scenario(np.zeros((2, 2)), np.eye(2), h, r, np.ones(2))) for h in (H, sees_both))
    for pools, solves in (([one, one], 3), ([one, both], 3), ([both, one], 4)):
        found = exchange(pools, [0, 1], fixed=[1])
        assert found.swaps == ()
        assert found.complete
        assert found.solves == solves


KEEP, ROUNDING = 4, 1e-13


@pytest.fixture(scope="module")
def mirrored(beam_of, scenarios_of):
    """Scenario and strain rows of 5 places with 4 gauges each: bending about y and about z, each with both signs."""
    beam = beam_of(5, 3, seed=1)
    vertical = (np.abs(beam.model.input_shape[:, 0]) > np.abs(beam.model.input_shape[:, 1]))[None]
    rows = [np.where(vertical, one * beam.rows, two * beam.rows) for one in (1, -1) for two in (1, -1)]
    beam = replace(beam, rows=np.stack(rows, axis=1).reshape(-1, beam.rows.shape[1]))
    return beam, scenarios_of(beam, ("Fz", "Fy"), ("E",))[0]


def found_by_all(scenario, rows, prior) -> dict[str, tuple[int, ...]]:
    """What every way to a layout finds."""
    pool, result = len(rows), eliminate([scenario], KEEP)
    pools = result.pools
    start = random_sets(pool, KEEP, 1, seed=2)[0]
    swapped = exchange(pools, start)
    proof = branch_and_bound(pools, KEEP, start=start, time_limit=60.0)
    # what the search starts from is not what it ends with, so that its nodes are distinguished, too
    assert proof.proven
    assert proof.cost < 0.99 * score(pools, swapped.gauges)
    found = {
        "elimination": result.removed,
        "exchange": swapped.gauges,
        "swaps": np.ravel(swapped.swaps),
        "fill": fill(pools, result.kept, as_limits(pool, KEEP + 3, ())),
        "robust": robust_set(pools, KEEP).gauges,
        "proof": proof.gauges,
        "d_optimal": d_optimal(rows, np.ones(pool), prior, KEEP),
    }
    for keep in (KEEP, rows.shape[1] + 3):
        found[f"effective_independence {keep}"] = effective_independence(rows, keep)
        found[f"qr_pivoting {keep}"] = qr_pivoting(rows, keep)
    for criterion in CRITERIA[1:]:
        own = [pool.under(Metric(scenario.weight, criterion)) for pool in pools]
        found[f"elimination by {criterion.name}"] = eliminate_from(own, KEEP).removed
        found[f"exchange by {criterion.name}"] = exchange(own, start).gauges
    return {name: tuple(np.asarray(gauges).tolist()) for name, gauges in found.items()}


def test_rounding_does_not_choose_between_equal_gauges(mirrored):
    beam, scenario = mirrored
    rng = np.random.default_rng(5)

    def shaken(X: np.ndarray) -> np.ndarray:
        return X * (1 + ROUNDING * rng.standard_normal(X.shape))

    rows = beam.rows / np.abs(beam.rows).max()
    prior = np.cov(beam.x[:, : beam.model.size], rowvar=False)
    first = found_by_all(scenario, rows, prior)
    assert any(eliminate([scenario], KEEP).ties)
    Q = shaken(scenario.Q)
    other = replace(scenario, F=shaken(scenario.F), H=shaken(scenario.H), Q=0.5 * (Q + Q.T))
    assert found_by_all(other, shaken(rows), prior) == first
