"""Gauges added one by one while the limits leave room: what is left of a budget after the elimination."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.ordering import TIE
from strainsight.placement.increment import addition, gauge_gradients
from strainsight.placement.limits import Limits
from strainsight.placement.riccati import Loop, close_loop
from strainsight.placement.scenario import Aggregate, Pool, aggregated, loop_of, refined, subset_covariance


def fill(
    pools: Sequence[Pool], gauges: Sequence[int] | np.ndarray, limits: Limits, aggregate: Aggregate = "mean"
) -> np.ndarray:
    """Add, again and again, the gauge that lowers the aggregate f of the metric most, until none fits in the limits.

        f(S + j) ≥ agg(f_s − φ_j),   φ_j = tr(h_j P X P h_jᵀ) of the present set

    Those of the least bound are added exactly until the next bound exceeds the least value found. gauges: a set within
    the limits, but for the least number of gauges, that detects every unknown. Returns the set, ascending; the lower
    index wins a tie.
    """
    chosen = np.sort(np.asarray(gauges, dtype=int))
    room = _room(limits, chosen)
    if not len(room):
        return chosen
    loops = []
    for pool in pools:
        P = subset_covariance(pool, chosen)
        if P is None:
            raise ValueError("only a set that detects every unknown is filled")
        loops.append(loop_of(pool, chosen, P))
    while len(room):
        into, loops = _most_telling(pools, loops, room, aggregate)
        chosen = np.sort(np.append(chosen, into))
        room = _room(limits, chosen)
    return chosen


def with_gauge(pools: Sequence[Pool], loops: Sequence[Loop], gauge: int) -> list[Loop]:
    """The loops of all scenarios with one gauge more."""
    grown = []
    for pool, loop in zip(pools, loops, strict=True):
        block = pool.rows[gauge]
        G = loop.information.with_rows(block)
        P = loop.P + addition(pool.scenario.F, pool.scenario.Q, loop, block)
        grown.append(close_loop(pool.scenario.F, G, refined(pool, G, P)))
    return grown


def costs_of(pools: Sequence[Pool], loops: Sequence[Loop]) -> np.ndarray:
    """The metric of every scenario."""
    return np.array([p.metric.value(l.P) for p, l in zip(pools, loops, strict=True)])


def gradients_of(pools: Sequence[Pool], loops: Sequence[Loop]) -> np.ndarray:
    """φ of every scenario and gauge of the pool: what it is worth at most where it is out, at least where it is in."""
    return np.array([gauge_gradients(l, p.rows, p.metric.gradient(l.P)) for p, l in zip(pools, loops, strict=True)])


def _room(limits: Limits, chosen: np.ndarray) -> np.ndarray:
    """The gauges that still fit."""
    fits = ~limits.too_large(limits.used(chosen))
    fits[chosen] = False
    return np.flatnonzero(fits)


def _most_telling(
    pools: Sequence[Pool], loops: Sequence[Loop], room: np.ndarray, aggregate: Aggregate
) -> tuple[int, list[Loop]]:
    costs = costs_of(pools, loops)
    bounds = aggregated(costs[:, None] - gradients_of(pools, loops)[:, room], aggregate)
    best, exact = np.inf, dict[int, tuple[float, list[Loop]]]()
    for at in np.argsort(bounds, kind="stable"):
        if bounds[at] > best * (1 + TIE):
            break
        grown = with_gauge(pools, loops, int(room[at]))
        cost = float(aggregated(costs_of(pools, grown), aggregate))
        best = min(best, cost)
        exact[int(room[at])] = cost, grown
        # loops are matrices: only those that may still be taken are kept
        exact = {gauge: found for gauge, found in exact.items() if found[0] <= best * (1 + TIE)}
    into = min(exact)
    return into, exact[into][1]
