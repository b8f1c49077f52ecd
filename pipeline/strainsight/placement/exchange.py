"""Swaps after the elimination: one gauge of the set against one left out, until no swap helps."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.placement.increment import addition, gauge_gradients, removal
from strainsight.placement.riccati import Loop, close_loop
from strainsight.placement.scenario import (
    Aggregate,
    Pool,
    aggregated,
    loop_of,
    refined,
    subset_covariance,
    weighted_trace,
)

WORTH = 1e-9
"""A swap counts when it lowers the aggregate by more than this share of it."""


@dataclass(frozen=True)
class Exchange:
    """gauges (keep,) ascending; trace after every swap, the start first; swaps (out, in); solves: exact Riccati solves;
    complete: every remaining swap is known not to help, which `limit` solves were enough for."""

    gauges: np.ndarray
    trace: np.ndarray
    swaps: tuple[tuple[int, int], ...]
    solves: int
    complete: bool


def exchange(
    pools: Sequence[Pool],
    gauges: Sequence[int] | np.ndarray,
    aggregate: Aggregate = "mean",
    *,
    fixed: Collection[int] = (),
    limit: int = 20_000,
) -> Exchange:
    """Swap until none lowers the aggregate f of tr(W P) over the scenarios; the result is optimal against single swaps.

        swap (i out, j in):  f ≥ agg(f_s + min over i of φ_i − φ_j),   φ_g = h_g P X P h_gᵀ/r_g of the present set

    Gauges j are tried in the order of that bound and left where it promises nothing; j is then added exactly, and only
    the i whose removal bound in the enlarged set allows a gain are removed exactly. The first swap that helps is made.
    gauges: a set that detects every unknown; fixed: gauges that stay; limit: of exact solves.
    """
    count = len(pools[0].rows)
    chosen = sorted(int(g) for g in gauges)
    loops = []
    for pool in pools:
        P = subset_covariance(pool, chosen)
        if P is None:
            raise ValueError("an exchange starts from a set that detects every unknown")
        loops.append(loop_of(pool, chosen, P))
    trace = [_cost(pools, loops, aggregate)]
    swaps: list[tuple[int, int]] = []
    solves = 0
    while solves < limit:
        found, number = _first_gain(pools, loops, chosen, count, aggregate, fixed, trace[-1], limit - solves)
        solves += number
        if found is None:
            return Exchange(np.array(chosen), np.array(trace), tuple(swaps), solves, solves < limit)
        out, into, loops = found
        chosen = sorted({*chosen, into} - {out})
        swaps.append((out, into))
        trace.append(_cost(pools, loops, aggregate))
    return Exchange(np.array(chosen), np.array(trace), tuple(swaps), solves, False)


def _first_gain(
    pools: Sequence[Pool], loops: Sequence[Loop], chosen: list[int], count: int, aggregate: Aggregate,
    fixed: Collection[int], cost: float, limit: int,
) -> tuple[tuple[int, int, list[Loop]] | None, int]:
    """The first swap that helps, (out, in, loops of the new set), or None; and the number of exact solves."""
    movable = [g for g in chosen if g not in fixed]
    others = [g for g in range(count) if g not in chosen]
    if not movable or not others:
        return None, 0
    traces = np.array([weighted_trace(p, l.P) for p, l in zip(pools, loops, strict=True)])
    gradients = np.array([gauge_gradients(l, p.rows, p.scenario.weight) for p, l in zip(pools, loops, strict=True)])
    least = gradients[:, movable].min(axis=1)
    promise = aggregated(traces[:, None] + least[:, None] - gradients[:, others], aggregate)
    enough = cost * (1 - WORTH)
    solves = 0
    for at in np.argsort(promise, kind="stable"):
        if promise[at] >= enough or solves >= limit:
            break
        into = others[at]
        grown = []
        for pool, loop in zip(pools, loops, strict=True):
            row = pool.rows[into]
            G = loop.G + np.outer(row, row)
            P = loop.P + addition(pool.scenario.F, pool.scenario.Q, loop, row)
            grown.append(close_loop(pool.scenario.F, G, refined(pool, G, P)))
        solves += len(pools)
        after = np.array([weighted_trace(p, l.P) for p, l in zip(pools, grown, strict=True)])
        bounds = aggregated(
            np.array([
                base + gauge_gradients(l, p.rows[movable], p.scenario.weight)
                for base, p, l in zip(after, pools, grown, strict=True)
            ]),
            aggregate,
        )
        for i in np.argsort(bounds, kind="stable"):
            if bounds[i] >= enough:
                break
            out = movable[i]
            rest = sorted({*chosen, into} - {out})
            swapped, number = _without(pools, grown, out, rest)
            solves += number
            if swapped is not None and _cost(pools, swapped, aggregate) < enough:
                return (out, into, swapped), solves
    return None, solves


def _without(pools: Sequence[Pool], loops: Sequence[Loop], out: int, rest: list[int]) -> tuple[list[Loop] | None, int]:
    swapped = []
    for number, (pool, loop) in enumerate(zip(pools, loops, strict=True), start=1):
        D = removal(pool.scenario.F, pool.scenario.Q, loop, pool.rows[out], pool.rows[rest], pool.modes)
        if D is None:
            return None, number
        rows = pool.rows[rest]
        swapped.append(loop_of(pool, rest, refined(pool, rows.T @ rows, loop.P + D)))
    return swapped, len(pools)


def _cost(pools: Sequence[Pool], loops: Sequence[Loop], aggregate: Aggregate) -> float:
    return float(aggregated(np.array([weighted_trace(p, l.P) for p, l in zip(pools, loops, strict=True)]), aggregate))
