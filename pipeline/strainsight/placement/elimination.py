"""Gauges leave one by one, the least missed first (algorithm 2), by exact costs and few of them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from strainsight.augmentation.observability import least_gauges
from strainsight.errors import ConfigError, InfeasibleError
from strainsight.placement.increment import Slopes, removal, sharper_bound, slopes, squares
from strainsight.placement.remaining import Remaining
from strainsight.placement.riccati import Loop, close_loop, relative_residual
from strainsight.placement.scenario import (
    Aggregate,
    Pool,
    Scenario,
    aggregated,
    refined,
    solve_pool,
    weighted_trace,
    whole_pool_weight,
)

__all__ = ["Elimination", "Scenario", "eliminate", "whole_pool_weight"]

TIE = 1e-9
"""Two rises closer than this share of themselves are a tie; the lower gauge index leaves."""


@dataclass(frozen=True)
class Elimination:
    """What was removed and what it cost.

    kept (keep,) ascending; removed (pool − keep,) in order; trace (pool − keep + 1,) aggregate tr(W P), the whole pool
    first; rise (pool − keep,) its increments, not differences of `trace` and so with all their digits;
    blocks (pool − keep + 1, unknowns) the trace by unknown (states of positive weight; of the worst scenario where that
    is the aggregate); solves: exact Riccati solves of every step, one a scenario; ties: per step, the gauges that were
    as good as the one removed; residual: the largest relative one of all; pools: the scenarios as solved.
    """

    kept: np.ndarray
    removed: np.ndarray
    trace: np.ndarray
    rise: np.ndarray
    blocks: np.ndarray
    solves: np.ndarray
    ties: tuple[tuple[int, ...], ...]
    residual: float
    pools: tuple[Pool, ...]


def eliminate(
    scenarios: Sequence[Scenario],
    keep: int,
    aggregate: Aggregate = "mean",
    *,
    fixed: Collection[int] = (),
    names: Sequence[str] = (),
) -> Elimination:
    """Remove, again and again, the gauge that raises the aggregate of tr(W P) least, until `keep` are left.

    One product bounds every candidate from below (`slopes`). The candidate of the least bound is evaluated
    exactly; those whose bound does not exceed its value get a sharper one (`sharper_bound`), and are evaluated exactly
    in that order until the next bound exceeds the best value: the same answer as evaluating all of them. A removal
    after which an unknown is undetectable costs infinity, by test. All scenarios have the same gauges; fixed: gauges
    that stay; names: of the unknowns.
    Raises InfeasibleError where `keep` gauges cannot detect the unknowns, ConfigError for an impossible `keep`.
    """
    count = len(scenarios[0].H)
    if not max(1, len(fixed)) <= keep <= count:
        raise ConfigError(
            f"{keep} gauges are to be kept of a pool of {count} with {len(fixed)} fixed",
            remedy=f"keep between {max(1, len(fixed))} and {count}",
        )
    pools = tuple(solve_pool(s, names) for s in scenarios)
    least = max(least_gauges(p.modes) for p in pools)
    if keep < least:
        raise InfeasibleError(
            f"{keep} gauges cannot observe {least} unknowns" + (f" ({', '.join(names)})" if names else ""),
            remedy=f"keep at least {least}, or estimate fewer unknowns",
        )
    left = Remaining(pools, fixed)
    loops = [close_loop(p.scenario.F, left.gram(i), p.P) for i, p in enumerate(pools)]
    residual = max(p.residual for p in pools)
    removed: list[int] = []
    solves: list[int] = []
    ties: list[tuple[int, ...]] = []
    costs = np.array([weighted_trace(p, p.P) for p in pools])
    rises: list[float] = []
    trace, blocks = [float(aggregated(costs, aggregate))], [_blocks(pools, loops, costs, aggregate)]
    while left.count > keep:
        found, number = _least_missed(pools, loops, costs, left, aggregate)
        if found is None:
            raise InfeasibleError(
                f"with fewer than {left.count} gauges an unknown is lost, {keep} are to be kept",
                remedy=f"keep at least {left.count}, or estimate fewer unknowns",
            )
        left.remove(found.at)
        for i, (pool, D) in enumerate(zip(pools, found.increments, strict=True)):
            G = left.gram(i)
            P = refined(pool, G, loops[i].P + D)
            residual = max(residual, relative_residual(pool.scenario.F, pool.scenario.Q, G, P))
            loops[i] = close_loop(pool.scenario.F, G, P)
            costs[i] = weighted_trace(pool, P)
        removed.append(found.gauge)
        rises.append(found.rise)
        solves.append(number)
        ties.append(found.ties)
        trace.append(float(aggregated(costs, aggregate)))
        blocks.append(_blocks(pools, loops, costs, aggregate))
    return Elimination(
        kept=left.gauges,
        removed=np.array(removed, dtype=int),
        trace=np.array(trace),
        rise=np.array(rises),
        blocks=np.array(blocks),
        solves=np.array(solves, dtype=int),
        ties=tuple(ties),
        residual=residual,
        pools=pools,
    )


@dataclass(frozen=True)
class _Choice:
    """The gauge to remove and its place in `Remaining`; D (n, n) of every scenario; the aggregate's rise; the ties."""

    gauge: int
    at: int
    increments: list[np.ndarray]
    rise: float
    ties: tuple[int, ...]


def _least_missed(
    pools: Sequence[Pool], loops: Sequence[Loop], costs: np.ndarray, left: Remaining, aggregate: Aggregate
) -> tuple[_Choice | None, int]:
    """The gauge of the smallest rise, None where every removal costs infinity; and the number of exact solves."""
    # relative to the present aggregate, so that small rises keep their digits
    level = costs - costs.max() if aggregate == "worst" else np.zeros_like(costs)
    shared = [slopes(loop, p.scenario.weight) for p, loop in zip(pools, loops, strict=True)]
    bounds = np.array([squares(left.product(i, s.factor)) for i, s in enumerate(shared)])
    waiting = aggregated(level[:, None] + bounds, aggregate)
    waiting[~left.movable] = np.inf
    exact: dict[int, tuple[float, list[np.ndarray]]] = {}
    best, solves = np.inf, 0
    while best == np.inf:
        at = int(np.argmin(waiting))
        if waiting[at] == np.inf:
            return None, solves
        value, increments, number = _exactly(pools, loops, level, bounds[:, at], left, at, aggregate, best)
        solves += number
        waiting[left.twins(at)] = np.inf
        if increments is not None:
            exact[at], best = (value, increments), value
    doubtful = [
        (bound, at, parts)
        for at in left.one_of_each(np.flatnonzero(waiting <= best * (1 + TIE)))
        for bound, parts in [_sharpened(pools, shared, level, bounds[:, at], left, at, aggregate, best)]
    ]
    for bound, at, parts in sorted(doubtful, key=lambda entry: entry[:2]):
        if bound > best * (1 + TIE):
            break
        value, increments, number = _exactly(pools, loops, level, parts, left, at, aggregate, best)
        solves += number
        if increments is not None:
            exact[at], best = (value, increments), min(best, value)
    # twins cost the same without being evaluated
    as_good = sorted(
        (int(left.index[twin]), int(twin), at)
        for at, (value, _) in exact.items()
        if value <= best + TIE * abs(best)
        for twin in left.twins(at)
    )
    gauge, place, at = as_good[0]
    return _Choice(gauge, place, exact[at][1], exact[at][0], tuple(g for g, _, _ in as_good[1:])), solves


def _sharpened(
    pools: Sequence[Pool],
    shared: Sequence[Slopes],
    level: np.ndarray,
    bounds: np.ndarray,
    left: Remaining,
    at: int,
    aggregate: Aggregate,
    best: float,
) -> tuple[float, np.ndarray]:
    """A sharper bound of the aggregate and its parts (scenarios,), until it exceeds the best value."""
    parts = bounds.copy()
    for i, (pool, s) in enumerate(zip(pools, shared, strict=True)):
        parts[i] = max(parts[i], sharper_bound(s, pool.rows[left.index[at]]))
        if aggregated(level + parts, aggregate) > best * (1 + TIE):
            break
    return float(aggregated(level + parts, aggregate)), parts


def _exactly(
    pools: Sequence[Pool],
    loops: Sequence[Loop],
    level: np.ndarray,
    bounds: np.ndarray,
    left: Remaining,
    at: int,
    aggregate: Aggregate,
    best: float,
) -> tuple[float, list[np.ndarray] | None, int]:
    """The rise of the aggregate, D of every scenario and the solves; None as soon as a scenario loses an unknown or as
    the exact parts and the bounds (scenarios,) of the others together exceed the best value."""
    parts, increments = bounds.copy(), []
    for i, (pool, loop) in enumerate(zip(pools, loops, strict=True)):
        s, row = pool.scenario, pool.rows[left.index[at]]
        D = removal(s.F, s.Q, loop, row, partial(_rest, pool, left, at), pool.modes)
        if D is None:
            return np.inf, None, i + 1
        increments.append(D)
        parts[i] = s.weight @ np.diag(D)
        if aggregated(level + parts, aggregate) > best * (1 + TIE):
            return np.inf, None, i + 1
    return float(aggregated(level + parts, aggregate)), increments, len(pools)


def _rest(pool: Pool, left: Remaining, at: int) -> np.ndarray:
    return pool.rows[left.without(at)]


def _blocks(pools: Sequence[Pool], loops: Sequence[Loop], costs: np.ndarray, aggregate: Aggregate) -> np.ndarray:
    unknown = np.flatnonzero(pools[0].scenario.weight > 0)
    parts = np.array([(p.scenario.weight * np.diag(l.P))[unknown] for p, l in zip(pools, loops, strict=True)])
    return parts.mean(axis=0) if aggregate == "mean" else parts[int(np.argmax(costs))]
