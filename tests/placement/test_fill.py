"""Gauges that are added to a layout, what remains without them, and how many are recommended."""

from __future__ import annotations

import weakref
from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.placement import fill as filling
from strainsight.placement.elimination import eliminate
from strainsight.placement.limits import as_limits, limits_of
from strainsight.placement.recommendation import alike, gains, worth_keeping
from strainsight.placement.remaining import Remaining, twin_groups
from strainsight.placement.scenario import Scenario, solve_pool

from .wandering import COMBINED, costs_of, pools_of


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
    pools = pools_of(H, levels, weight)

    def cost(chosen):
        return COMBINED[aggregate](costs_of(H[:, chosen], levels, weight, np.ones(len(chosen))))

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


def test_the_sum_and_the_rows_follow_every_removal(beam_of, scenarios_of):
    """Of gauges of two channels."""
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


def test_twins_are_those_that_may_leave_and_stand_apart_where_they_are_distinguished(beam_of, scenarios_of):
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
    apart = Remaining(pools, fixed=[], apart=labels)
    for at in range(8):
        assert apart.twins(at).tolist() == [g for g in range(8) if (same[g], labels[g]) == (same[at], labels[at])]


def test_what_a_sharp_gauge_leaves_behind_is_no_rounding():
    # one gauge of 300 reads one of the states 1e9 times better than the others do
    rows = np.random.default_rng(1).normal(size=(300, 1, 3))
    rows[7, 0, 1] = 1e9
    left = Remaining([SimpleNamespace(rows=rows)], fixed=[])
    left.remove(7)
    there = np.delete(rows[:, 0], 7, axis=0)
    np.testing.assert_allclose(left.gram(0), there.T @ there, rtol=1e-12)


def test_noise_that_averages_halves_sigma_with_four_times_the_gauges():
    """T = 1/n: the n + 1st gauge lowers σ by 1 − √(n/(n + 1)), which falls below 5 % at n = 10."""
    n = np.arange(50, 1, -1)
    np.testing.assert_allclose(gains(1 / n)[:3], 1 - np.sqrt([2 / 3, 3 / 4, 4 / 5]), rtol=1e-14)
    assert worth_keeping(1 / n, 2) == next(k for k in range(2, 50) if 1 - np.sqrt(k / (k + 1)) < 0.05) == 10


@pytest.mark.parametrize(("trace", "keep", "worth"), [([1.0, 1.0, 1.0], 4, 4), ([1.0, 1.0, 4.0], 4, 5), ([2.0], 7, 7)])
def test_the_elbow_is_where_the_last_worthy_gauge_is(trace, keep, worth):
    assert worth_keeping(np.array(trace), keep) == worth


def test_rows_are_alike_by_their_angle_whatever_length_and_sign():
    tilt = np.deg2rad(8.0)  # cos = 0.9903
    steps = np.array([[np.cos(k * tilt), np.sin(k * tilt), 0.0] for k in range(3)]) * [[1], [-5], [1e-6]]
    rows = np.vstack([steps, [0, 0, 1], [0, 0, 0], [0, 1e-9, -1]])
    assert alike(rows) == [(0, 1, 2), (3, 5)]
    assert alike(rows[[0, 2, 3, 4]]) == []
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    assert alike(rows @ turn) == alike(rows)


def test_gauges_of_several_channels_are_alike_where_they_span_the_same_space():
    rng = np.random.default_rng(1)
    plane, mix = rng.standard_normal((2, 6)), rng.standard_normal((2, 2))
    basis = np.linalg.qr(plane.T)[0].T
    out = np.linalg.svd(basis)[2][2]
    tilted = [[basis[0], np.cos(a) * basis[1] + np.sin(a) * out] for a in np.deg2rad([7.0, 9.0])]
    single = np.array([basis[0], np.zeros(6)])
    rows = np.stack([plane, mix @ plane, *np.array(tilted), single, 3 * single, np.zeros((2, 6))])
    # 7° are within 0.99, 9° are not, but two gauges 2° apart are, and chain
    assert alike(rows[[0, 1, 2, 4, 5, 6]]) == [(0, 1, 2), (3, 4)]
    assert alike(rows[[0, 1, 3, 4, 6]]) == [(0, 1)]
    assert alike(rows[:4]) == [(0, 1, 2, 3)]
    assert alike(rows[[0, 4]]) == []


def test_one_channel_in_a_block_is_a_row():
    rows = np.random.default_rng(4).standard_normal((30, 2))
    padded = np.zeros((30, 3, 2))
    padded[:, 1] = rows
    assert alike(padded) == alike(rows) == alike(rows[:, None])
    assert len(alike(rows)) > 1
