"""Gauges leave one by one, the least missed first (algorithm 2), by exact costs and few of them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.errors import InfeasibleError
from strainsight.ordering import first_of_largest
from strainsight.parallel.sweep import Sweep, serial
from strainsight.placement.choice import Step, known_to_go, least_missed
from strainsight.placement.layouts import Detection
from strainsight.placement.limits import Limits, as_limits
from strainsight.placement.remaining import Remaining
from strainsight.placement.riccati import Loop, close_loop, relative_residual
from strainsight.placement.scenario import (
    Aggregate,
    Pool,
    Scenario,
    aggregated,
    fewest_gauges,
    refined,
    solved,
    whole_pool_weight,
)
from strainsight.placement.witness import Guard

__all__ = ["Elimination", "Scenario", "eliminate", "eliminate_from", "whole_pool_weight"]


@dataclass(frozen=True)
class Elimination:
    """What was removed and what it cost.

    kept ascending; removed (s,) in order; cost (s + 1,) aggregate of the metric, the whole pool first; rise (s,) its
    increments, not differences of `cost` and so with all their digits; blocks (s + 1, states that any scenario weighs)
    their variances times their weights, Mᵢᵢ (of the worst scenario where that is the aggregate), which add up to the trace;
    solves (s,): exact Riccati solves of every step, one a scenario; ties: per step, gauges that were as good as the one
    removed, all of them but for rises of zero; residual: the largest relative one of all; pools: the scenarios as solved.
    """

    kept: np.ndarray
    removed: np.ndarray
    cost: np.ndarray
    rise: np.ndarray
    blocks: np.ndarray
    solves: np.ndarray
    ties: tuple[tuple[int, ...], ...]
    residual: float
    pools: tuple[Pool, ...]


def eliminate(
    scenarios: Sequence[Scenario],
    keep: int | Limits,
    aggregate: Aggregate = "mean",
    *,
    fixed: Collection[int] = (),
    names: Sequence[str] = (),
    sweep: Sweep = serial,
) -> Elimination:
    """`eliminate_from` of the scenarios as solved; names: of the unknowns; sweep: solves them with the whole pool."""
    limits = as_limits(len(scenarios[0].H), keep, fixed)
    return eliminate_from(sweep(solved, scenarios, names), limits, aggregate, names=names)


def eliminate_from(
    pools: Sequence[Pool],
    keep: int | Limits,
    aggregate: Aggregate = "mean",
    *,
    fixed: Collection[int] = (),
    names: Sequence[str] = (),
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
    after which an unknown is undetectable costs infinity, by test. All scenarios have the same gauges; fixed: gauges
    that stay; names: of the unknowns.
    Raises InfeasibleError where no layout within the limits was found that detects the unknowns, ConfigError for an
    impossible `keep`.
    Source of the ratio: Senju and Toyoda, Management Science 15 (1968).
    """
    limits = as_limits(len(pools[0].rows), keep, fixed)
    unknowns, least = fewest_gauges(pools)
    if limits.keep < least:
        raise InfeasibleError(
            f"{limits.keep} gauges cannot observe {unknowns} unknowns" + (f" ({', '.join(names)})" if names else ""),
            remedy=f"keep at least {least}, or estimate fewer unknowns",
        )
    return _descend(
        tuple(pools), limits, aggregate, names, None if limits.plain else Guard(limits, Detection(pools), names)
    )


def _descend(
    pools: tuple[Pool, ...], limits: Limits, aggregate: Aggregate, names: Sequence[str], guard: Guard | None
) -> Elimination:
    """The removals until the limits are kept; all over again with a guard where without one none is possible before."""
    left = Remaining(pools, limits.fixed, None if limits.plain else limits.alike)
    loops = [close_loop(p.scenario.F, left.information(i), p.P) for i, p in enumerate(pools)]
    residual = max(p.residual for p in pools)
    removed: list[int] = []
    solves: list[int] = []
    ties: list[tuple[int, ...]] = []
    costs = np.array([p.metric.value(p.P) for p in pools])
    rises: list[float] = []
    cost, blocks = [float(aggregated(costs, aggregate))], [_blocks(pools, loops, costs, aggregate)]
    spent = 0
    while left.count > limits.keep if guard is None else guard.broken:
        relief = None if guard is None else guard.relief[left.index]
        step = Step(pools, loops, costs, left, aggregate)
        found, number, worth = least_missed(step, relief)
        spent += number
        if found is None:
            if guard is None:
                return _descend(pools, limits, aggregate, names, Guard(limits, Detection(pools), names))
            found = known_to_go(step, guard.surplus(left.index, worth))
            spent += len(pools)
        if guard is not None:
            spared = guard.lets_go(found.gauge, left.index, worth)
            left.hold(guard.held)
            if not spared:
                continue
        left.remove(found.at)
        for i, (pool, D) in enumerate(zip(pools, found.increments, strict=True)):
            G = left.information(i)
            P = refined(pool, G, loops[i].P + D)
            residual = max(residual, relative_residual(pool.scenario.F, pool.scenario.Q, G, P))
            loops[i] = close_loop(pool.scenario.F, G, P)
            costs[i] = pool.metric.value(P)
        removed.append(found.gauge)
        rises.append(found.rise)
        solves.append(spent)
        spent = 0
        ties.append(found.ties)
        cost.append(float(aggregated(costs, aggregate)))
        blocks.append(_blocks(pools, loops, costs, aggregate))
    return Elimination(
        kept=left.gauges,
        removed=np.array(removed, dtype=int),
        cost=np.array(cost),
        rise=np.array(rises),
        blocks=np.array(blocks),
        solves=np.array(solves, dtype=int),
        ties=tuple(ties),
        residual=residual,
        pools=pools,
    )


def _blocks(pools: Sequence[Pool], loops: Sequence[Loop], costs: np.ndarray, aggregate: Aggregate) -> np.ndarray:
    at = np.flatnonzero(np.any([p.metric.weight > 0 for p in pools], axis=0))
    root = [np.sqrt(p.metric.weight[at]) for p in pools]
    parts = np.array([np.diag(l.P)[at] * (w * w) for w, l in zip(root, loops, strict=True)])
    return parts.mean(axis=0) if aggregate == "mean" else parts[first_of_largest(costs)]
