"""What is kept up to date while gauges leave, against what it is made of."""

from __future__ import annotations

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
