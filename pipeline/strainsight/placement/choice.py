"""The gauge that is missed least of those still there, by exact costs and few of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from strainsight.ordering import TIE
from strainsight.placement.increment import Slopes, least_increments, removal, sharper_bound, slopes, squares
from strainsight.placement.information import information
from strainsight.placement.remaining import Remaining
from strainsight.placement.riccati import Loop
from strainsight.placement.scenario import Aggregate, Pool, aggregated, refined

NOTHING = 1e-12
"""Rises and their bounds below this share of the largest bound are zero: rounding, where a metric does not feel a gauge."""


@dataclass(frozen=True)
class Choice:
    """The gauge to remove and its place in `Remaining`; D (n, n) of every scenario; the aggregate's rise; the ties."""

    gauge: int
    at: int
    increments: list[np.ndarray]
    rise: float
    ties: tuple[int, ...]


@dataclass(frozen=True)
class Step:
    """What all removals from one set share: its scenarios, loops, costs (scenarios,) and the gauges left."""

    pools: Sequence[Pool]
    loops: Sequence[Loop]
    costs: np.ndarray
    left: Remaining
    aggregate: Aggregate

    @cached_property
    def level(self) -> np.ndarray:
        """Costs relative to the present aggregate (scenarios,), so that small rises keep their digits."""
        return self.costs - self.costs.max() if self.aggregate == "worst" else np.zeros_like(self.costs)

    @cached_property
    def slopes(self) -> list[Slopes]:
        return [slopes(l, p.metric.gradient(l.P)) for p, l in zip(self.pools, self.loops, strict=True)]

    @cached_property
    def bounds(self) -> np.ndarray:
        """Least rise of every scenario (scenarios, m) by its slope in each gauge's weight."""
        found = np.array([squares(self.left.product(i, s.factor)) for i, s in enumerate(self.slopes)])
        return np.where(found > NOTHING * found.max(axis=1, keepdims=True), found, 0.0)

    @cached_property
    def lifted(self) -> np.ndarray:
        """The same, of a metric with kinks by all directions and not by that of its slope alone."""
        found = self.bounds.copy()
        for i, (pool, loop) in enumerate(zip(self.pools, self.loops, strict=True)):
            if not pool.metric.smooth:
                B = self.left.product(i, loop.P @ loop.U)
                rise = pool.metric.lifts(loop.P, *least_increments(loop, B, pool.metric.states))
                found[i] = np.maximum(found[i], rise)
        return found

    @cached_property
    def rounding(self) -> float:
        """Rises of the aggregate up to this one are zero: all of them are ties."""
        return NOTHING * float(self.lifted.max())

    def together(self, parts: np.ndarray) -> np.ndarray:
        """Rise of the aggregate from that of every scenario (scenarios, ...)."""
        level = self.level.reshape(-1, *[1] * (parts.ndim - 1))
        return aggregated(level + parts, self.aggregate)

    def rounded(self, parts: np.ndarray) -> float:
        """The rise of the aggregate, zero where it is rounding."""
        rise = float(self.together(parts))
        return rise if rise > self.rounding else 0.0

    def sharpened(self, at: int, best: float) -> tuple[float, np.ndarray]:
        """A sharper bound of the aggregate's rise and its parts (scenarios,), until it exceeds the best value."""
        parts = self.lifted[:, at].copy()
        for i, (pool, s) in enumerate(zip(self.pools, self.slopes, strict=True)):
            if parts[i] > 0:
                bound = sharper_bound(s, pool.rows[self.left.index[at]])
                parts[i] = max(parts[i], pool.metric.least_rise(s.loop.P, bound))
            if self.together(parts) > max(best * (1 + TIE), self.rounding):
                break
        return self.rounded(parts), parts

    def exactly(self, at: int, bounds: np.ndarray, best: float) -> tuple[float, list[np.ndarray] | None, int]:
        """The rise of the aggregate, D of every scenario and the solves; None as soon as a scenario loses an unknown or as
        the exact parts and the bounds (scenarios,) of the others together exceed the best value."""
        parts, increments = bounds.copy(), []
        for i, (pool, loop) in enumerate(zip(self.pools, self.loops, strict=True)):
            s, block = pool.scenario, pool.rows[self.left.index[at]]
            D = removal(s.F, s.Q, loop, block, partial(_rest, pool, self.left, at), pool.modes)
            if D is None:
                return np.inf, None, i + 1
            increments.append(D)
            parts[i] = pool.metric.rise(loop.P, D)
            if self.together(parts) > max(best * (1 + TIE), self.rounding):
                return np.inf, None, i + 1
        return self.rounded(parts), increments, len(self.pools)


def least_missed(step: Step, relief: np.ndarray | None = None) -> tuple[Choice | None, int, np.ndarray]:
    """The gauge of the smallest rise, None where every removal costs infinity; the number of exact solves; the bounds.

    relief (m,): the rise counts per relief, and gauges of none stay; 1 where not given.
    """
    left = step.left
    worth, least = step.together(step.bounds), step.together(step.lifted)
    per = np.ones(len(worth)) if relief is None else relief
    least = np.where(least > step.rounding, least, 0.0)
    waiting = np.divide(least, per, out=np.full(len(worth), np.inf), where=left.movable & (per > 0))
    exact: dict[int, tuple[float, list[np.ndarray]]] = {}
    best, solves = np.inf, 0
    while best == np.inf:
        at = int(np.argmin(waiting))
        if waiting[at] == np.inf:
            return None, solves, worth
        value, increments, number = step.exactly(at, step.lifted[:, at], best)
        solves += number
        waiting[left.twins(at)] = np.inf
        if increments is not None:
            exact[at], best = (value, increments), value / per[at]
    doubtful = [
        (bound / per[at], at, parts)
        for at in left.one_of_each(np.flatnonzero(waiting <= best * (1 + TIE)))
        for bound, parts in [step.sharpened(at, best * per[at])]
    ]
    for bound, at, parts in sorted(doubtful, key=lambda entry: entry[:2]):
        # of rises of zero the first one is taken, and one more shows that it is a tie: all gauges may be such
        if bound > best * (1 + TIE) or (best == 0 and [rise for rise, _ in exact.values()].count(0.0) > 1):
            break
        value, increments, number = step.exactly(at, parts, best * per[at])
        solves += number
        if increments is not None:
            exact[at], best = (value, increments), min(best, value / per[at])
    # twins cost the same without being evaluated
    as_good = sorted(
        (int(left.index[twin]), int(twin), at)
        for at, (value, _) in exact.items()
        if value / per[at] <= best + TIE * abs(best)
        for twin in left.twins(at)
    )
    gauge, place, at = as_good[0]
    return Choice(gauge, place, exact[at][1], exact[at][0], tuple(g for g, _, _ in as_good[1:])), solves, worth


def known_to_go(step: Step, gauge: int) -> Choice:
    """The removal of a gauge without which every unknown is known to be observable, whatever the test of what is left says.

    The test compares with the strongest row there: beside one of 1e10 times the weight, all others are rounding.
    """
    at = int(np.flatnonzero(step.left.index == gauge)[0])
    increments, rises = [], []
    for pool, loop in zip(step.pools, step.loops, strict=True):
        rows = pool.stacked(step.left.without(at))
        increments.append(refined(pool, information(rows), None) - loop.P)
        rises.append(pool.metric.rise(loop.P, increments[-1]))
    rise = aggregated(step.costs + rises, step.aggregate) - aggregated(step.costs, step.aggregate)
    return Choice(gauge, at, increments, float(rise), ())


def _rest(pool: Pool, left: Remaining, at: int) -> np.ndarray:
    """Rows (m − 1, c, n*) of the gauges left but the one at this place."""
    return pool.rows[left.without(at)]
