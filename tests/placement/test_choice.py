"""The gauge that is missed least per what its leaving mends, of all, on unknowns that wander with no dynamics."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.placement.choice import Step, known_to_go, least_missed
from strainsight.placement.remaining import Remaining
from strainsight.placement.scenario import loop_of, subset_covariance

from .wandering import COMBINED, costs_of, pools_of

POOL, LEVELS, WEIGHT = 12, (1.0, 9.0), np.array([1.0, 3.0, 0.5])


class Left:
    """What is left after some gauges have gone; two scenarios, H (2, pool, 3) at unit noise."""

    def __init__(self, H, aggregate, removed=(), fixed=()):
        self.H, self.aggregate = H, aggregate
        self.pools = pools_of(H, LEVELS, WEIGHT)
        self.left = Remaining(self.pools, fixed)
        for gauge in removed:
            self.left.remove(int(np.flatnonzero(self.left.index == gauge)[0]))
        self.gauges = self.left.gauges.tolist()
        P = [subset_covariance(pool, self.gauges) for pool in self.pools]
        self.loops = [loop_of(pool, self.gauges, p) for pool, p in zip(self.pools, P, strict=True)]
        self.costs = np.array([pool.metric.value(p) for pool, p in zip(self.pools, P, strict=True)])
        self.step = Step(self.pools, self.loops, self.costs, self.left, aggregate)

    def each(self, gauges):
        """tr(W P) of every scenario."""
        return costs_of(self.H[:, gauges], LEVELS, WEIGHT, np.ones(len(gauges)))

    def rise(self, gauge):
        combine = COMBINED[self.aggregate]
        return combine(self.each([g for g in self.gauges if g != gauge])) - combine(self.each(self.gauges))

    def found(self, relief=None):
        at_places = None if relief is None else relief[self.left.index]
        return least_missed(self.step, at_places)


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
@pytest.mark.parametrize("seed", range(6))
def test_the_least_rise_per_relief_of_all_is_found(aggregate, seed):
    """Relief of any size, none at all for some gauges: they stay. A bound is never above the rise."""
    rng = np.random.default_rng(seed)
    H = rng.normal(size=(2, POOL, 3))
    H[:, [4, 9]] = -H[:, [2, 6]]
    for removed, fixed in (((), ()), ((1, 7, 10), (0, 3)), ((0, 3, 5, 8, 10, 11, 7), (1,))):
        step = Left(H, aggregate, removed, fixed)
        for relief in (None, 10.0 ** rng.uniform(-2, 2, POOL) * (rng.random(POOL) < 0.7), np.full(POOL, 100.0)):
            per = np.ones(POOL) if relief is None else relief
            per[[4, 9]] = per[[2, 6]]
            rates = {g: step.rise(g) / per[g] for g in step.gauges if g not in fixed and per[g] > 0}
            least = min(rates.values())
            best = [g for g, rate in rates.items() if rate <= least * (1 + 1e-8)]
            choice, solves, worth = step.found(relief)
            assert (choice.gauge, choice.ties) == (best[0], tuple(best[1:]))
            assert step.left.index[choice.at] == choice.gauge
            np.testing.assert_allclose(choice.rise, step.rise(choice.gauge), rtol=1e-7)
            parts = [p.scenario.weight @ np.diag(D) for p, D in zip(step.pools, choice.increments, strict=True)]
            np.testing.assert_allclose(
                step.costs + parts, step.each([g for g in step.gauges if g != choice.gauge]), rtol=1e-9
            )
            assert 2 <= solves <= 2 * len(rates)
            for place, gauge in enumerate(step.left.index.tolist()):
                assert gauge not in step.gauges or worth[place] <= step.rise(gauge) + 1e-9


def test_where_every_removal_loses_an_unknown_none_is_found():
    H = np.random.default_rng(1).normal(size=(2, POOL, 3))
    step = Left(H, "mean", range(3, POOL))
    choice, solves, _ = step.found()
    assert choice is None
    assert solves == 3
    assert Left(H, "mean", range(5, POOL), fixed=range(5)).found()[:2] == (None, 0)


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
def test_a_gauge_that_is_known_to_go_is_taken_at_what_it_costs(aggregate):
    step = Left(np.random.default_rng(2).normal(size=(2, POOL, 3)), aggregate, (0, 4, 6))
    for gauge in (2, 11):
        choice = known_to_go(step.step, gauge)
        assert (choice.gauge, step.left.index[choice.at], choice.ties) == (gauge, gauge, ())
        np.testing.assert_allclose(choice.rise, step.rise(gauge), rtol=1e-8)
        parts = [p.scenario.weight @ np.diag(D) for p, D in zip(step.pools, choice.increments, strict=True)]
        np.testing.assert_allclose(step.costs + parts, step.each([g for g in step.gauges if g != gauge]), rtol=1e-9)
