"""Gauges leave one by one, the least missed first (algorithm 2), by exact costs and few of them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.augmentation.observability import least_gauges
from strainsight.errors import ConfigError, InfeasibleError
from strainsight.placement.increment import gauge_gradients, removal
from strainsight.placement.riccati import Loop, relative_residual
from strainsight.placement.scenario import (
    Aggregate,
    Pool,
    Scenario,
    aggregated,
    loop_of,
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
    is the aggregate); solves: exact Riccati solves of every step; ties: per step, the gauges that were as good as the
    one removed; residual: the largest relative one of all; pools: the scenarios as solved.
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

    Candidates are evaluated exactly in the order of their lower bounds (`gauge_gradients`) until the next bound exceeds
    the best exact value: the same answer as evaluating all of them. A removal after which an unknown is undetectable
    costs infinity, by test. All scenarios have the same gauges; fixed: gauges that stay; names: of the unknowns.
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
    alive = list(range(count))
    loops = [loop_of(p, alive, p.P) for p in pools]
    residual = max(p.residual for p in pools)
    removed: list[int] = []
    solves: list[int] = []
    ties: list[tuple[int, ...]] = []
    costs = np.array([weighted_trace(p, p.P) for p in pools])
    rises: list[float] = []
    trace, blocks = [float(aggregated(costs, aggregate))], [_blocks(pools, loops, costs, aggregate)]
    while len(alive) > keep:
        candidates = [g for g in alive if g not in fixed]
        gauge, increments, rise, number, tied = _least_missed(pools, loops, costs, alive, candidates, aggregate)
        if increments is None:
            raise InfeasibleError(
                f"with fewer than {len(alive)} gauges an unknown is lost, {keep} are to be kept",
                remedy=f"keep at least {len(alive)}, or estimate fewer unknowns",
            )
        alive.remove(gauge)
        for i, (pool, D) in enumerate(zip(pools, increments, strict=True)):
            rows = pool.rows[alive]
            G = rows.T @ rows
            P = refined(pool, G, loops[i].P + D)
            residual = max(residual, relative_residual(pool.scenario.F, pool.scenario.Q, G, P))
            loops[i] = loop_of(pool, alive, P)
            costs[i] = weighted_trace(pool, P)
        removed.append(gauge)
        rises.append(rise)
        solves.append(number)
        ties.append(tied)
        trace.append(float(aggregated(costs, aggregate)))
        blocks.append(_blocks(pools, loops, costs, aggregate))
    return Elimination(
        kept=np.array(alive),
        removed=np.array(removed, dtype=int),
        trace=np.array(trace),
        rise=np.array(rises),
        blocks=np.array(blocks),
        solves=np.array(solves, dtype=int),
        ties=tuple(ties),
        residual=residual,
        pools=pools,
    )


def _least_missed(
    pools: Sequence[Pool], loops: Sequence[Loop], costs: np.ndarray, alive: list[int], candidates: list[int],
    aggregate: Aggregate,
) -> tuple[int, list[np.ndarray] | None, float, int, tuple[int, ...]]:
    """The gauge of the smallest rise, its D per scenario (None if all are infinite), the rise, solves, ties."""
    # relative to the present aggregate, so that small rises keep their digits
    level = costs - costs.max() if aggregate == "worst" else np.zeros_like(costs)
    bounds = aggregated(
        np.array([
            lv + gauge_gradients(loop, pool.rows[candidates], pool.scenario.weight)
            for lv, pool, loop in zip(level, pools, loops, strict=True)
        ]),
        aggregate,
    )
    exact: dict[int, tuple[float, list[np.ndarray]]] = {}
    best, number = np.inf, 0
    for j in np.argsort(bounds, kind="stable"):
        if bounds[j] > best * (1 + TIE):
            break
        gauge = candidates[j]
        rest = [g for g in alive if g != gauge]
        increments: list[np.ndarray] = []
        for pool, loop in zip(pools, loops, strict=True):
            number += 1
            D = removal(pool.scenario.F, pool.scenario.Q, loop, pool.rows[gauge], pool.rows[rest], pool.modes)
            if D is None:
                break
            increments.append(D)
        if len(increments) < len(pools):
            continue
        rise = np.array([pool.scenario.weight @ np.diag(D) for pool, D in zip(pools, increments, strict=True)])
        value = float(aggregated(level + rise, aggregate))
        exact[gauge] = value, increments
        best = min(best, value)
    if not exact:
        return -1, None, np.inf, number, ()
    as_good = sorted(g for g, (value, _) in exact.items() if value <= best + TIE * abs(best))
    value, increments = exact[as_good[0]]
    return as_good[0], increments, value, number, tuple(as_good[1:])


def _blocks(pools: Sequence[Pool], loops: Sequence[Loop], costs: np.ndarray, aggregate: Aggregate) -> np.ndarray:
    unknown = np.flatnonzero(pools[0].scenario.weight > 0)
    parts = np.array([(p.scenario.weight * np.diag(l.P))[unknown] for p, l in zip(pools, loops, strict=True)])
    return parts.mean(axis=0) if aggregate == "mean" else parts[int(np.argmax(costs))]

