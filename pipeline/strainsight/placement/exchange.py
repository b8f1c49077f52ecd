"""Swaps after the elimination: one gauge of the set against one left out, until no swap helps."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import partial

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
    """gauges (keep,) ascending; trace after every swap, the start first; swaps (out, in); solves: exact Riccati solves,
    never more than `limit`; complete: every remaining swap is known not to help, which they were enough for."""

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
    chosen = np.sort(np.asarray(gauges, dtype=int))
    loops = []
    for pool in pools:
        P = subset_covariance(pool, chosen)
        if P is None:
            raise ValueError("an exchange starts from a set that detects every unknown")
        loops.append(loop_of(pool, chosen, P))
    trace = [_cost(pools, loops, aggregate)]
    swaps: list[tuple[int, int]] = []
    solves, complete = 0, False
    while not complete:
        found, number, stopped = _first_gain(pools, loops, chosen, aggregate, fixed, trace[-1], limit - solves)
        solves += number
        if found is None:
            complete = not stopped
            break
        out, into, loops = found
        chosen = _swapped(chosen, out, into)
        swaps.append((out, into))
        trace.append(_cost(pools, loops, aggregate))
    return Exchange(chosen, np.array(trace), tuple(swaps), solves, complete)


def _first_gain(
    pools: Sequence[Pool],
    loops: Sequence[Loop],
    chosen: np.ndarray,
    aggregate: Aggregate,
    fixed: Collection[int],
    cost: float,
    limit: int,
) -> tuple[tuple[int, int, list[Loop]] | None, int, bool]:
    """The first swap that helps, (out, in, loops of the new set), or None; the exact solves, at most `limit`; whether
    the search was stopped by it."""
    movable = chosen[~np.isin(chosen, list(fixed))]
    others = np.delete(np.arange(len(pools[0].rows)), chosen)
    if not len(movable) or not len(others):
        return None, 0, False
    traces = np.array([weighted_trace(p, l.P) for p, l in zip(pools, loops, strict=True)])
    gradients = np.array([gauge_gradients(l, p.rows, p.scenario.weight) for p, l in zip(pools, loops, strict=True)])
    least = gradients[:, movable].min(axis=1)
    promise = aggregated(traces[:, None] + least[:, None] - gradients[:, others], aggregate)
    enough = cost * (1 - WORTH)
    hopeful = np.flatnonzero(promise < enough)
    solves = 0
    for at in hopeful[np.argsort(promise[hopeful], kind="stable")]:
        if solves + len(pools) > limit:
            return None, solves, True
        into = int(others[at])
        grown = []
        for pool, loop in zip(pools, loops, strict=True):
            row = pool.rows[into]
            G = loop.G + np.outer(row, row)
            P = loop.P + addition(pool.scenario.F, pool.scenario.Q, loop, row)
            grown.append(close_loop(pool.scenario.F, G, refined(pool, G, P)))
        solves += len(pools)
        after = np.array([weighted_trace(p, l.P) for p, l in zip(pools, grown, strict=True)])
        bounds = aggregated(
            np.array(
                [
                    base + gauge_gradients(l, p.rows[movable], p.scenario.weight)
                    for base, p, l in zip(after, pools, grown, strict=True)
                ]
            ),
            aggregate,
        )
        for i in np.argsort(bounds, kind="stable"):
            if bounds[i] >= enough:
                break
            if solves + len(pools) > limit:
                return None, solves, True
            out = int(movable[i])
            swapped, number = _without(pools, grown, out, _swapped(chosen, out, into))
            solves += number
            if swapped is not None and _cost(pools, swapped, aggregate) < enough:
                return (out, into, swapped), solves, False
    return None, solves, False


def _swapped(chosen: np.ndarray, out: int, into: int) -> np.ndarray:
    return np.sort(np.where(chosen == out, into, chosen))


def _without(pools: Sequence[Pool], loops: Sequence[Loop], out: int, rest: np.ndarray) -> tuple[list[Loop] | None, int]:
    swapped = []
    for number, (pool, loop) in enumerate(zip(pools, loops, strict=True), start=1):
        rows = pool.rows[rest]
        D = removal(pool.scenario.F, pool.scenario.Q, loop, pool.rows[out], partial(np.asarray, rows), pool.modes)
        if D is None:
            return None, number
        swapped.append(loop_of(pool, rest, refined(pool, rows.T @ rows, loop.P + D)))
    return swapped, len(pools)


def _cost(pools: Sequence[Pool], loops: Sequence[Loop], aggregate: Aggregate) -> float:
    return float(aggregated(np.array([weighted_trace(p, l.P) for p, l in zip(pools, loops, strict=True)]), aggregate))
