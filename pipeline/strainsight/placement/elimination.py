"""Elimination of gauges one by one, least important first (algorithm 2), by few exact costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from strainsight.errors import InfeasibleError
from strainsight.ordering import TIE, index_of_largest
from strainsight.placement.increment import Modes, least_increments, removals, squares
from strainsight.placement.layouts import Detection
from strainsight.placement.limits import Limits, as_limits
from strainsight.placement.riccati import Loop, close_loop, information
from strainsight.placement.scenario import Aggregate, Pool, aggregated, fewest_gauges, refine, refine_with_residual
from strainsight.placement.witness import Guard, Remaining

NOTHING = 1e-12
"""Rises and bounds below this share of the largest bound are rounding, and count as zero."""
AT_ONCE = 64
"""Gauges whose bounds are sharpened at once."""


@dataclass(frozen=True)
class Choice:
    """The gauge to remove and its place in `Remaining`; D (n, n) of each scenario; the rise of the aggregate; the ties."""

    gauge: int
    at: int
    increments: list[np.ndarray]
    rise: float
    ties: tuple[int, ...]


@dataclass(frozen=True)
class RemovedGauge:
    """Common data of all removals from one set: its scenarios, loops, costs (scenarios,) and the remaining gauges."""

    pools: Sequence[Pool]
    loops: Sequence[Loop]
    costs: np.ndarray
    left: Remaining
    aggregate: Aggregate

    @cached_property
    def level(self) -> np.ndarray:
        """Costs relative to the current aggregate (scenarios,), so that small rises keep their digits."""
        return self.costs - self.costs.max() if self.aggregate == "worst" else np.zeros_like(self.costs)

    @cached_property
    def modes(self) -> Modes:
        return Modes(self.loops)

    @cached_property
    def slopes(self) -> tuple[np.ndarray, np.ndarray]:
        return self.modes.slopes([p.metric.gradient(l.P) for p, l in zip(self.pools, self.loops, strict=True)])

    @cached_property
    def bounds(self) -> np.ndarray:
        """Least rise of each scenario (scenarios, m), by its slope in the weight of each gauge."""
        bounds = np.array([squares(self.left.product(i, factor)) for i, factor in enumerate(self.slopes[0])])
        return np.where(bounds > NOTHING * bounds.max(axis=1, keepdims=True), bounds, 0.0)

    @cached_property
    def lifted(self) -> np.ndarray:
        """The same for a metric with kinks, by all directions instead of the slope."""
        bounds = self.bounds.copy()
        for i, (pool, loop) in enumerate(zip(self.pools, self.loops, strict=True)):
            if not pool.metric.smooth:
                B = self.left.product(i, loop.P)
                rise = pool.metric.lifts(loop.P, *least_increments(loop, B, pool.metric.states))
                bounds[i] = np.maximum(bounds[i], rise)
        return bounds

    @cached_property
    def rounding(self) -> float:
        """Rise of the aggregate up to which removals tie at zero."""
        return NOTHING * float(self.lifted.max())

    def together(self, parts: np.ndarray) -> np.ndarray:
        """Rise of the aggregate from those of the scenarios (scenarios, ...), zero below rounding."""
        level = self.level.reshape(-1, *[1] * (parts.ndim - 1))
        rise = aggregated(level + parts, self.aggregate)
        return np.where(rise > self.rounding, rise, 0.0)

    def sharpened(self, places: np.ndarray) -> np.ndarray:
        """Refined bounds of the aggregate's rise (k,)."""
        parts = self.lifted[:, places]
        for first in range(0, len(places), AT_ONCE):
            span = np.s_[first : first + AT_ONCE]
            rows = self.modes.rows([pool.rows[self.left.index[places[span]]] for pool in self.pools])
            sharp = self.modes.sharper_bounds(self.slopes[1], rows.swapaxes(0, 1))
            for part, bound, pool, loop in zip(parts[:, span], sharp.T, self.pools, self.loops, strict=True):
                part[:] = np.where(part > 0, np.maximum(part, pool.metric.least_rise(loop.P, bound)), 0.0)
        return self.together(parts)

    def exactly(self, at: int) -> tuple[float, list[np.ndarray] | None]:
        """The rise of the aggregate and D of every scenario; None if one loses an unknown."""
        without, gauge = self.left.without(at), self.left.index[at]
        blocks = [pool.rows[gauge] for pool in self.pools]
        increments = removals(self.pools, self.modes, blocks, lambda i: self.pools[i].stacked(without))
        if increments is None:
            return np.inf, None
        each = zip(self.pools, self.loops, increments, strict=True)
        return float(self.together(np.array([pool.metric.rise(loop.P, D) for pool, loop, D in each]))), increments


def least_missed(step: RemovedGauge, relief: np.ndarray | None = None) -> tuple[Choice | None, int, np.ndarray]:
    """The gauge with the smallest rise, None if every removal costs infinity; the number of exact solves; the bounds. relief
    (m,): rises count per relief, gauges without relief stay; default 1."""
    left = step.left
    worth = aggregated(step.level[:, None] + step.bounds, step.aggregate)
    per = np.ones(len(worth)) if relief is None else relief
    waiting = np.divide(
        step.together(step.lifted), per, out=np.full(len(worth), np.inf), where=left.movable & (per > 0)
    )
    exact: dict[int, tuple[float, list[np.ndarray]]] = {}
    best, solves = np.inf, 0

    def evaluate(at: int) -> float:
        nonlocal solves
        value, increments = step.exactly(at)
        solves += len(step.pools)
        if increments is not None:
            exact[at] = value, increments
        return value / per[at]

    while best == np.inf:
        at = int(np.argmin(waiting))
        if waiting[at] == np.inf:
            return None, solves, worth
        best = evaluate(at)
        waiting[left.twins(at)] = np.inf
    doubtful = left.one_of_each(np.flatnonzero(waiting <= best * (1 + TIE)))
    bounds = step.sharpened(doubtful) / per[doubtful]
    for at, bound in sorted(zip(doubtful.tolist(), bounds.tolist(), strict=True), key=lambda entry: entry[::-1]):
        # of rises of zero the first one is taken, and one more shows that it is a tie: all gauges may be such
        if bound > best * (1 + TIE) or (best == 0 and [rise for rise, _ in exact.values()].count(0.0) > 1):
            break
        best = min(best, evaluate(at))
    # twins cost the same without being evaluated
    as_good = sorted(
        (int(left.index[twin]), int(twin), at)
        for at, (value, _) in exact.items()
        if value / per[at] <= best + TIE * abs(best)
        for twin in left.twins(at)
    )
    gauge, place, at = as_good[0]
    return Choice(gauge, place, exact[at][1], exact[at][0], tuple(g for g, _, _ in as_good[1:])), solves, worth


def known_to_go(step: RemovedGauge, gauge: int) -> Choice:
    """The removal of a gauge without which every unknown is known to be observable, regardless of the numerical test.
    The test is relative to the strongest row: compared with one of 1e10 times the weight, all others are rounding."""
    at = int(np.flatnonzero(step.left.index == gauge)[0])
    increments, rises = [], []
    for pool, loop in zip(step.pools, step.loops, strict=True):
        rows = pool.stacked(step.left.without(at))
        increments.append(refine(pool, information(rows), None) - loop.P)
        rises.append(pool.metric.rise(loop.P, increments[-1]))
    rise = aggregated(step.costs + rises, step.aggregate) - aggregated(step.costs, step.aggregate)
    return Choice(gauge, at, increments, float(rise), ())


@dataclass(frozen=True)
class Elimination:
    """What was removed and what it cost. kept ascending; removed (s,) in order; cost (s + 1,) aggregate of the metric, the
    whole pool first; rise (s,) its increments, not differences of `cost` and so with all their digits; blocks (s + 1, states
    that any scenario weighs) their variances times their weights, Mᵢᵢ (of the worst scenario where that is the aggregate),
    which add up to the trace; solves (s,): exact Riccati solves of every step, one a scenario; ties: per step, gauges that
    were as good as the one removed, all of them but for rises of zero; residual: the largest relative one of all; pools: the
    scenarios as solved."""

    selected: np.ndarray
    removed: np.ndarray
    cost: np.ndarray
    rise: np.ndarray
    blocks: np.ndarray
    solves: np.ndarray
    ties: tuple[tuple[int, ...], ...]
    residual: float
    pools: tuple[Pool, ...]


def eliminate_from(
    pools: Sequence[Pool], keep: int | Limits, aggregate: Aggregate = "mean", *, names: Sequence[str] = ()
) -> Elimination:
    """Remove, again and again, the gauge that raises the aggregate of the metric least, until the limits are kept.

        least of Δ_g / Σ_k a_kg e_k / b_k²,     e_k = max(0, Σ a_kg over the gauges still there − b_k),     limits a·v ≤ b

    over the gauges that a broken limit counts: the least rise, where the count alone is broken; per price, where the
    budget is; else per unit of violation removed. `keep`: a number, or `Limits`: under a budget what is left may be fewer,
    without one they are as many as the limits allow. A layout inside the set still there is known all the time
    (`Witness`); a gauge of it without which no other is found stays while it has the gauge. With a plain count that is
    done only where the removals without it end in a set that can lose no further gauge: then all over again with it.

    One product bounds every candidate from below (`slopes`). The candidate of the least bound is evaluated
    exactly; those whose bound does not exceed its value get a sharper one (`sharper_bound`), and are evaluated exactly
    in that order until the next bound exceeds the best value: the same answer as evaluating all of them. A removal
    after which an unknown is undetectable costs infinity, by test. All scenarios have the same gauges; names:
    of the unknowns.
    Raises InfeasibleError where no layout within the limits was found that detects the unknowns, ConfigError for an
    impossible `keep`.
    Source of the ratio: Senju and Toyoda, Management Science 15 (1968)."""
    limits = as_limits(len(pools[0].rows), keep)
    unknowns, least = fewest_gauges(pools)
    if limits.keep < least:
        raise InfeasibleError(
            f"{limits.keep} gauges cannot observe {unknowns} unknowns" + (f" ({', '.join(names)})" if names else ""),
            remedy=f"keep at least {least} gauges (place.keep), or estimate fewer unknowns",
        )
    return _descend(
        tuple(pools), limits, aggregate, names, None if limits.plain else Guard(limits, Detection(pools), names)
    )


def _descend(
    pools: tuple[Pool, ...], limits: Limits, aggregate: Aggregate, names: Sequence[str], guard: Guard | None
) -> Elimination:
    """The removals until the limits are satisfied; repeated with a guard if no removal is possible without one."""
    left = Remaining(pools, limits.fixed, None if limits.plain else limits.labels)
    loops = [close_loop(p.scenario.F, left.information(i), p.P) for i, p in enumerate(pools)]
    residual = max(p.residual for p in pools)
    removed: list[tuple[int, float, tuple[int, ...]]] = []
    solves: list[int] = []
    costs = np.array([p.metric.value(p.P) for p in pools])
    cost, blocks = [float(aggregated(costs, aggregate))], [_blocks(pools, loops, costs, aggregate)]
    spent = 0
    while left.count > limits.keep if guard is None else guard.broken:
        relief = None if guard is None else guard.relief[left.index]
        step = RemovedGauge(pools, loops, costs, left, aggregate)
        place, number, worth = least_missed(step, relief)
        spent += number
        if place is None:
            if guard is None:
                return _descend(pools, limits, aggregate, names, Guard(limits, Detection(pools), names))
            place = known_to_go(step, guard.surplus(left.index, worth))
            spent += len(pools)
        if guard is not None:
            spared = guard.lets_go(place.gauge, left.index, worth)
            left.hold(guard.held)
            if not spared:
                continue
        left.remove(place.at)
        for i, (pool, D) in enumerate(zip(pools, place.increments, strict=True)):
            G = left.information(i)
            P, error = refine_with_residual(pool, G, loops[i].P + D)
            residual = max(residual, error)
            loops[i] = close_loop(pool.scenario.F, G, P)
            costs[i] = pool.metric.value(P)
        removed.append((place.gauge, place.rise, place.ties))
        solves.append(spent)
        spent = 0
        cost.append(float(aggregated(costs, aggregate)))
        blocks.append(_blocks(pools, loops, costs, aggregate))
    return Elimination(
        selected=left.gauges,
        removed=np.array([gauge for gauge, _, _ in removed], dtype=int),
        cost=np.array(cost),
        rise=np.array([rise for _, rise, _ in removed]),
        blocks=np.array(blocks),
        solves=np.array(solves, dtype=int),
        ties=tuple(ties for _, _, ties in removed),
        residual=residual,
        pools=pools,
    )


def _blocks(pools: Sequence[Pool], loops: Sequence[Loop], costs: np.ndarray, aggregate: Aggregate) -> np.ndarray:
    size = min(len(p.metric.weight) for p in pools)
    at = np.flatnonzero(np.any([p.metric.weight[-size:] > 0 for p in pools], axis=0)) - size
    root = [np.sqrt(p.metric.weight[at]) for p in pools]
    parts = np.array([np.diag(l.P)[at] * (w * w) for w, l in zip(root, loops, strict=True)])
    return parts.mean(axis=0) if aggregate == "mean" else parts[index_of_largest(costs)]
