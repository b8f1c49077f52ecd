"""What is kept up to date while gauges leave, against what it is made of."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.placement.remaining import Remaining, twin_groups
from strainsight.placement.scenario import Scenario, solve_pool


def test_the_sum_and_the_rows_follow_every_removal(beam_of, scenarios_of):
    (scenario,) = scenarios_of(beam_of(700, 3), ("Fz",), ("E",))
    rng = np.random.default_rng(0)
    r = scenario.r * 10.0 ** rng.uniform(0, 8, 700)
    pool = solve_pool(Scenario(scenario.F, scenario.Q, scenario.H, r, scenario.weight))
    left = Remaining([pool], fixed=[5, 6])
    factor = rng.normal(size=(len(pool.P), 2))
    gone: list[int] = []
    # the most telling gauges first: what is left of the sum is small against what it was
    order = [g for g in np.argsort(-np.sum(pool.rows**2, axis=(1, 2))) if g not in (5, 6)]
    for gauge in order[:690]:
        left.remove(int(np.flatnonzero((left.index == gauge) & left.movable)[0]))
        gone.append(gauge)
        there = np.delete(np.arange(700), gone)
        G = pool.rows[there, 0].T @ pool.rows[there, 0]
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
