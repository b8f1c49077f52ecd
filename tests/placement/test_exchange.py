"""Swaps of gauges end where none helps, and rounding does not choose between gauges that symmetry makes equal."""

from __future__ import annotations

import weakref
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from strainsight.placement import exchange as filling
from strainsight.placement.baselines import d_optimal, effective_independence, qr_pivoting, random_sets
from strainsight.placement.branch_and_bound import branch_and_bound
from strainsight.placement.criteria import CRITERIA, Metric
from strainsight.placement.elimination import eliminate_from
from strainsight.placement.exchange import exchange, fill
from strainsight.placement.failure import robust_set
from strainsight.placement.limits import as_limits, limits_of
from strainsight.placement.scenario import Scenario, solve_pool
from strainsight.placement.score import gains, redundant_groups, score, worth_keeping
from strainsight.placement.witness import Remaining, twin_groups

from .conftest import COMBINED, beam_of, costs_of, oracle, pools_of, scenarios_of
from .whole_pools import eliminate


@pytest.mark.parametrize("instants", [(63,), (55, 871)])
def test_the_limit_is_never_passed_and_never_passes_for_an_end(instants):
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


def test_room_next_to_fixed_gauges_is_filled():
    pools = eliminate(scenarios_of(beam_of(12), ("Fz",), ("E",)), 4).pools
    bonded = [1, 5, 7]
    limits = limits_of(12, 6, fixed=bonded, price=np.ones(12), budget=5.0)
    found = exchange(pools, bonded, limits=limits)
    assert [out for out, _ in found.swaps] == [-1, -1]
    assert len(found.gauges) == 5
    assert set(bonded) <= set(found.gauges.tolist())
    assert found.cost[0] > found.cost[1] > found.cost[2]
    assert found.complete
    none_moves = limits_of(12, 6, fixed=found.gauges.tolist(), price=np.ones(12), budget=5.0)
    full = exchange(pools, found.gauges, limits=none_moves)
    assert (full.swaps, full.solves, full.complete) == ((), 0, True)


def swaps_in_words(oracle, pools, chosen, aggregate, limits):
    """The swaps of the docstring of `exchange`, every number from an oracle; and how many covariances they ask for."""
    combine = {"mean": np.mean, "worst": np.max}[aggregate]
    known = {}

    def at(gauges):
        """Costs (scenarios,) of a set, φ (scenarios, pool), and φ²/(φ − a₂) with the curvature a₂ in the weight of a gauge."""
        if tuple(gauges) not in known:
            costs, phi, sharper = [], [], []
            for pool in pools:
                s, rows = pool.scenario, pool.stacked(np.array(gauges))
                P, G = oracle(s, gauges), rows.T @ rows
                A = s.F - P @ G
                X = solve_continuous_lyapunov(A.T, -np.diag(s.weight))
                costs.append(s.weight @ np.diag(P))
                slope = np.array([np.trace(h @ P @ X @ P @ h.T) for h in pool.rows])
                Y = [solve_continuous_lyapunov(A, -P @ h.T @ h @ P) for h in pool.rows]
                bend = [2 * np.trace(X @ y @ h.T @ h @ P) - np.trace(X @ y @ G @ y) for y, h in zip(Y, pool.rows, strict=True)]
                phi.append(slope)
                sharper.append([a * a / (a - b) if 0 < b < a else a for a, b in zip(slope, bend, strict=True)])
            known[tuple(gauges)] = np.array(costs), np.array(phi), np.array(sharper)
        return known[tuple(gauges)]

    def next_swap(solves):
        costs, phi, _ = at(chosen)
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
            costs, phi, sharper = at(grown)
            bound = {i: combine(costs + (phi[:, i] if i >= 0 else 0)) for i in without}
            for i in sorted(bound, key=bound.get):
                if bound[i] < enough and (i < 0 or combine(costs + sharper[:, i]) < enough):
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
def test_the_swaps_are_those_of_its_words_and_no_more_is_solved(case, aggregate):
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


def test_a_swap_that_loses_an_unknown_is_no_swap_and_a_bound_may_exclude_it():
    """1 and 2 see the second walk, 2 far better, and 1 is bonded: 2 for 0 promises much, but 0 alone sees the first walk."""
    H = np.array([[[1.0, 0]], [[0, 1.0]], [[0, 1.0]]])
    sees_both = np.concatenate([H, [[[0, 0.0]]] * 3], axis=1)
    sees_both[2, 1, 0] = 1.0
    H = np.concatenate([H, np.zeros_like(H)], axis=1)
    r = np.array([1.0, 1.0, 1e-6])[:, None] * np.ones(2)
    one, both = (solve_pool(Scenario(np.zeros((2, 2)), np.eye(2), h, r, np.ones(2))) for h in (H, sees_both))
    for pools, solves in (([one, one], 2), ([one, both], 4), ([both, one], 4)):
        found = exchange(pools, [0, 1], limits=limits_of(3, 2, fixed=[1]))
        assert found.swaps == ()
        assert found.complete
        assert found.solves == solves


KEEP, ROUNDING = 4, 1e-13


@pytest.fixture(scope="module")
def mirrored():
    """Scenario and strain rows of 5 places with 4 gauges each: bending about y and about z, each with both signs."""
    beam = beam_of(5, 3, seed=1)
    vertical = (np.abs(beam.model.input_shape[:, 0]) > np.abs(beam.model.input_shape[:, 1]))[None]
    rows = [np.where(vertical, one * beam.rows, two * beam.rows) for one in (1, -1) for two in (1, -1)]
    beam = replace(beam, rows=np.stack(rows, axis=1).reshape(-1, beam.rows.shape[1]))
    return beam, scenarios_of(beam, ("Fz", "Fy"), ("E",))[0]


def found_by_all(scenario, rows, prior) -> dict[str, tuple[int, ...]]:
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
        "fill": fill(pools, result.selected, as_limits(pool, KEEP + 3)),
        "robust": robust_set(pools, KEEP),
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


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
def test_the_loops_of_gauges_that_lose_are_let_go(monkeypatch, aggregate):
    result = eliminate(scenarios_of(beam_of(60, 4), ("Fz",), ("E",), instants=(55, 260)), 2)
    with_gauge, made, held = filling.with_gauge, [], []

    def watched(pools, loops, gauge):
        held.append(sum(loop() is not None for loop in made))
        grown = with_gauge(pools, loops, gauge)
        made.extend(weakref.ref(loop) for loop in grown)
        return grown

    monkeypatch.setattr(filling, "with_gauge", watched)
    filling.fill(result.pools, result.selected, as_limits(60, 3), aggregate)
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
    pools = pools_of(H, levels, weight)

    def cost(chosen):
        return COMBINED[aggregate](costs_of(H[:, chosen], levels, weight, np.ones(len(chosen))))

    price = np.array([3.0, 1, 1, 1, 2, 2, 1, 1, 0.5, 2, 1, 3])
    zone = ("place.at_most.0", np.isin(np.arange(12), [1, 2, 3, 7]), 2)
    for limits in (as_limits(12, 8), limits_of(12, 9, price=price, budget=12.0, zones=[zone])):
        chosen, added = [0, 5, 8], []
        while fits := [
            g for g in range(12) if g not in chosen and np.all(limits.used(np.array([*chosen, g])) <= limits.most)
        ]:
            costs = {g: cost([*chosen, g]) for g in fits}
            added.append(min(g for g in fits if costs[g] <= min(costs.values()) * (1 + 1e-8)))
            chosen.append(added[-1])
        assert len(added) > 3
        assert filling.fill(pools, [8, 0, 5], limits, aggregate).tolist() == sorted(chosen)


def test_the_sum_and_the_rows_follow_every_removal():
    (scenario,) = scenarios_of(beam_of(1400, 3), ("Fz",), ("E",))
    rng = np.random.default_rng(0)
    r = scenario.r.reshape(700, 2) * 10.0 ** rng.uniform(0, 8, (700, 1))
    pool = solve_pool(Scenario(scenario.F, scenario.Q, scenario.H.reshape(700, 2, -1), r, scenario.weight))
    left = Remaining([pool], fixed=[5, 6])
    factor = rng.normal(size=(len(pool.P), 2))
    gone: list[int] = []
    # the most telling gauges first: what is left of the sum is small against what it was
    order = [g for g in np.argsort(-np.sum(pool.rows**2, axis=(1, 2))) if g not in (5, 6)]
    for gauge in order[:690]:
        left.remove(int(np.flatnonzero((left.index == gauge) & left.movable)[0]))
        gone.append(gauge)
        there = np.delete(np.arange(700), gone)
        rows = pool.rows[there].reshape(-1, len(pool.P))
        G = rows.T @ rows
        size = np.sqrt(np.outer(np.diag(G), np.diag(G)))
        assert np.all(np.abs(left.gram(0) - G) <= 1e-12 * size)
        assert left.count == len(there)
    np.testing.assert_array_equal(left.gauges, there)
    np.testing.assert_array_equal(left.index[left.movable], np.setdiff1d(there, [5, 6]))
    seen = np.isin(left.index, there)
    np.testing.assert_allclose(left.product(0, factor)[seen], pool.rows[left.index[seen]] @ factor)
    assert np.all(left.product(0, factor)[~seen] == 0)
    assert len(left.index) < 1.2 * left.count
    np.testing.assert_array_equal(left.without(0), np.setdiff1d(there, left.index[0]))


def test_twins_agree_in_every_scenario_up_to_their_sign():
    a, b = np.array([0.0, 1.5, -2.0]), np.array([0.0, 1.5, 2.0])
    first = np.array([a, b, -a, a, 0 * a, -0.0 * a])[:, None, :]
    second = np.array([b, b, b, a, 0 * a, 0 * a])[:, None, :]
    one = twin_groups([first])
    assert one[0] == one[2] == one[3]
    assert one[4] == one[5]
    assert len({one[0], one[1], one[4]}) == 3
    both = twin_groups([first, second])
    assert both[0] == both[2]
    assert both[4] == both[5]
    assert len(set(both.tolist())) == 4


def test_blocks_of_the_same_channels_in_another_order_are_twins():
    a, b = np.array([1.0, -2.0]), np.array([0.0, 3.0])
    labels = twin_groups([np.array([[a, b], [b, -a], [a, a], [b, b], [0 * a, a], [a, -0.0 * a]])])
    assert labels[0] == labels[1]
    assert labels[4] == labels[5]
    assert len(set(labels.tolist())) == 4


@pytest.mark.parametrize("unit", [1e-25, 1.0, 1e25])
def test_twins_do_not_depend_on_the_unit(unit):
    rows = np.random.default_rng(6).normal(size=(5, 2, 3))[[0, 1, 2, 1, 0, 3, 4]]
    found = twin_groups([unit * rows])
    np.testing.assert_array_equal(found[:, None] == found, np.all(rows[:, None] == rows, axis=(2, 3)))


def test_twins_are_movable_and_respect_labels():
    (scenario,) = scenarios_of(beam_of(6, 2), ("Fz",), ("E",))
    same = np.array([0, 1, 0, 2, 0, 1, 3, 0])
    r = scenario.r[same]
    pools = [solve_pool(Scenario(scenario.F, scenario.Q, scenario.H[same], r, scenario.weight))]
    left = Remaining(pools, fixed=[4])
    assert left.twins(0).tolist() == [0, 2, 7]
    assert left.twins(1).tolist() == [1, 5]
    assert left.twins(3).tolist() == [3]
    assert sorted(left.one_of_each(np.array([1, 2, 3, 5, 6, 7]))) == [1, 2, 3, 6]
    left.remove(2)
    assert left.twins(0).tolist() == [0, int(np.flatnonzero(left.index == 7)[0])]
    left.hold(np.arange(8) == 7)
    assert left.index[left.movable].tolist() == [0, 1, 3, 5, 6]
    assert left.twins(0).tolist() == [0]
    left.hold(np.zeros(8, dtype=bool))
    assert left.index[left.movable].tolist() == [0, 1, 3, 5, 6, 7]
    # by what the limits say of them
    labels = np.array([0, 0, 1, 0, 0, 1, 0, 1])
    apart = Remaining(pools, fixed=[], labels=labels)
    for at in range(8):
        assert apart.twins(at).tolist() == [g for g in range(8) if (same[g], labels[g]) == (same[at], labels[at])]


def test_noise_that_averages_halves_sigma_with_four_times_the_gauges():
    """T = 1/n: the n + 1st gauge lowers σ by 1 − √(n/(n + 1)), which falls below 5 % at n = 10."""
    n = np.arange(50, 1, -1)
    np.testing.assert_allclose(gains(1 / n)[:3], 1 - np.sqrt([2 / 3, 3 / 4, 4 / 5]), rtol=1e-14)
    assert worth_keeping(1 / n, 2) == next(k for k in range(2, 50) if 1 - np.sqrt(k / (k + 1)) < 0.05) == 10


@pytest.mark.parametrize(("trace", "keep", "worth"), [([1.0, 1.0, 1.0], 4, 4), ([1.0, 1.0, 4.0], 4, 5), ([2.0], 7, 7)])
def test_the_elbow_is_where_the_last_worthy_gauge_is(trace, keep, worth):
    assert worth_keeping(np.array(trace), keep) == worth


def test_redundancy_depends_on_angle_of_rows():
    tilt = np.deg2rad(8.0)  # cos = 0.9903
    steps = np.array([[np.cos(k * tilt), np.sin(k * tilt), 0.0] for k in range(3)]) * [[1], [-5], [1e-6]]
    rows = np.vstack([steps, [0, 0, 1], [0, 0, 0], [0, 1e-9, -1]])
    assert redundant_groups(rows) == [(0, 1, 2), (3, 5)]
    assert redundant_groups(rows[[0, 2, 3, 4]]) == []
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    assert redundant_groups(rows @ turn) == redundant_groups(rows)


def test_redundant_rosettes_span_same_space():
    rng = np.random.default_rng(1)
    plane, mix = rng.standard_normal((2, 6)), rng.standard_normal((2, 2))
    basis = np.linalg.qr(plane.T)[0].T
    out = np.linalg.svd(basis)[2][2]
    tilted = [[basis[0], np.cos(a) * basis[1] + np.sin(a) * out] for a in np.deg2rad([7.0, 9.0])]
    single = np.array([basis[0], np.zeros(6)])
    rows = np.stack([plane, mix @ plane, *np.array(tilted), single, 3 * single, np.zeros((2, 6))])
    # 7° are within 0.99, 9° are not, but two gauges 2° apart are, and chain
    assert redundant_groups(rows[[0, 1, 2, 4, 5, 6]]) == [(0, 1, 2), (3, 4)]
    assert redundant_groups(rows[[0, 1, 3, 4, 6]]) == [(0, 1)]
    assert redundant_groups(rows[:4]) == [(0, 1, 2, 3)]
    assert redundant_groups(rows[[0, 4]]) == []
