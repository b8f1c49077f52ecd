"""Exchange after the elimination: additions within the limits, and swaps until none helps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.ordering import TIE, tied_order
from strainsight.placement.increment import Modes, additions, gauge_gradients, gradients_by, removals
from strainsight.placement.limits import Limits, Swaps, as_limits
from strainsight.placement.riccati import Loop, close_loop, information
from strainsight.placement.scenario import Aggregate, Gauges, Pool, aggregated, loop_of, loops_of, refine


def fill(pools: Sequence[Pool], gauges: Gauges, limits: Limits, aggregate: Aggregate = "mean") -> np.ndarray:
    """Add, again and again, the gauge that lowers the aggregate f of the metric most, until none fits in the limits.

        f(S + j) ≥ agg(f_s − φ_j),   φ_j = tr(h_j P X P h_jᵀ) of the present set

    Those of the least bound are added exactly until the next bound exceeds the least value found. gauges: a set within
    the limits, but for the least number of gauges, that detects every unknown. Returns the set, ascending; the lower
    index wins a tie."""
    chosen = np.sort(np.asarray(gauges, dtype=int))
    room = _room(limits, chosen)
    if not len(room):
        return chosen
    if (loops := loops_of(pools, chosen)) is None:
        raise ValueError("gauges can be added only to a gauge set that makes every unknown observable")
    while len(room):
        into, loops = _most_telling(pools, loops, room, aggregate)
        chosen = np.sort(np.append(chosen, into))
        room = _room(limits, chosen)
    return chosen


def with_gauge(pools: Sequence[Pool], modes: Modes, gauge: int) -> list[Loop]:
    """The loops of all scenarios with an additional gauge."""
    grown = []
    blocks = [pool.rows[gauge] for pool in pools]
    for pool, loop, block, D in zip(pools, modes.loops, blocks, additions(pools, modes, blocks), strict=True):
        G = loop.information.with_rows(block)
        grown.append(close_loop(pool.scenario.F, G, refine(pool, G, loop.P + D)))
    return grown


def costs_of(pools: Sequence[Pool], loops: Sequence[Loop]) -> np.ndarray:
    """Metric of each scenario."""
    return np.array([p.metric.value(l.P) for p, l in zip(pools, loops, strict=True)])


def gradients_of(pools: Sequence[Pool], loops: Sequence[Loop]) -> np.ndarray:
    """φ of each scenario and gauge: largest worth of an absent gauge, least worth of a present one."""
    return gauge_gradients(loops, [p.rows for p in pools], gradients_at(pools, loops))


def gradients_at(pools: Sequence[Pool], loops: Sequence[Loop]) -> list[np.ndarray]:
    """Gradient of the metric of each scenario."""
    return [p.metric.gradient(l.P) for p, l in zip(pools, loops, strict=True)]


def _room(limits: Limits, chosen: np.ndarray) -> np.ndarray:
    """The gauges that still fit."""
    fits = ~limits.too_large(limits.used(chosen))
    fits[chosen] = False
    return np.flatnonzero(fits)


def _most_telling(
    pools: Sequence[Pool], loops: Sequence[Loop], room: np.ndarray, aggregate: Aggregate
) -> tuple[int, list[Loop]]:
    costs, modes = costs_of(pools, loops), Modes(loops)
    bounds = aggregated(costs[:, None] - gradients_of(pools, loops)[:, room], aggregate)
    best, exact = np.inf, dict[int, tuple[float, list[Loop]]]()
    for at in np.argsort(bounds, kind="stable"):
        if bounds[at] > best * (1 + TIE):
            break
        grown = with_gauge(pools, modes, int(room[at]))
        cost = float(aggregated(costs_of(pools, grown), aggregate))
        best = min(best, cost)
        exact[int(room[at])] = cost, grown
        # loops are matrices: only those that may still be taken are kept
        exact = {gauge: result for gauge, result in exact.items() if result[0] <= best * (1 + TIE)}
    into = min(exact)
    return into, exact[into][1]


@dataclass(frozen=True)
class Exchange:
    """gauges (keep,) ascending; cost after each swap, the start first; swaps (out, in), out −1 for additions; solves: exact
    Riccati solves, at most `limit`; complete: all remaining swaps were excluded."""

    gauges: np.ndarray
    cost: np.ndarray
    swaps: tuple[tuple[int, int], ...]
    solves: int
    complete: bool


def exchange(
    pools: Sequence[Pool],
    gauges: Gauges,
    aggregate: Aggregate = "mean",
    *,
    limits: Limits | None = None,
    limit: int = 20_000,
) -> Exchange:
    """Swap until none lowers the aggregate f of the metric over the scenarios by more than a tie; the result is so far optimal
    against single swaps.

        swap (i out, j in):  f ≥ agg(f_s + min over i of φ_i − φ_j),   φ_g = tr(h_g P X P h_gᵀ) of the present set

    Gauges j are tried in the order of that bound and left where it promises nothing; j is then added exactly, and only
    the i whose removal bounds in the enlarged set (`Modes.sharper_bounds`) allow a gain are removed exactly. The first swap
    that helps is made; of equal ones, that of the lower indices.
    gauges: a set that detects every unknown; limits: of which every set on the way breaks none;
    if they permit j in addition to the set, j is added and none leaves. limit: of exact solves."""
    chosen = np.sort(np.asarray(gauges, dtype=int))
    bounded = as_limits(len(pools[0].rows), len(chosen) if limits is None else limits)
    if not bounded.allows(chosen):
        raise ValueError(
            "an exchange of gauges must start from a layout within the limits that contains the fixed gauges"
        )
    if (loops := loops_of(pools, chosen)) is None:
        raise ValueError("an exchange of gauges must start from a set of gauges that makes every unknown observable")
    costs = [_cost(pools, loops, aggregate)]
    swaps: list[tuple[int, int]] = []
    solves = 0
    while True:
        result, number, stopped = _first_gain(pools, loops, chosen, aggregate, bounded, costs[-1], limit - solves)
        solves += number
        if result is None:
            break
        out, into, loops = result
        chosen = _swap(chosen, out, into)
        swaps.append((out, into))
        costs.append(_cost(pools, loops, aggregate))
    return Exchange(chosen, np.array(costs), tuple(swaps), solves, not stopped)


def _first_gain(
    pools: Sequence[Pool],
    loops: Sequence[Loop],
    chosen: np.ndarray,
    aggregate: Aggregate,
    limits: Limits,
    cost: float,
    limit: int,
) -> tuple[tuple[int, int, list[Loop]] | None, int, bool]:
    """The first improving swap (out, in, loops of the new set), or None; the exact solves, at most `limit`; whether the limit
    stopped the search."""
    movable = chosen[~np.isin(chosen, list(limits.fixed))]
    others = np.delete(np.arange(len(pools[0].rows)), chosen)
    swaps = Swaps(limits, chosen, movable)
    if not len(others) or not (len(movable) or swaps.room.any()):
        return None, 0, False
    costs, modes = costs_of(pools, loops), Modes(loops)
    gradients = gradients_of(pools, loops)
    least = gradients[:, movable].min(axis=1, initial=np.inf)
    # nothing leaves where there is room
    fall = gradients[:, others] - np.where(swaps.room[others], 0.0, least[:, None])
    promise = aggregated(costs[:, None] - fall, aggregate)
    enough = cost * (1 - TIE)
    hopeful = np.flatnonzero(promise < enough)
    solves = 0
    for at in hopeful[tied_order(promise[hopeful])]:
        into = int(others[at])
        may = swaps.out(into)
        if not may.any() and not swaps.room[into]:
            continue
        if solves + len(pools) > limit:
            return None, solves, True
        grown = with_gauge(pools, modes, into)
        solves += len(pools)
        after = costs_of(pools, grown)
        if swaps.room[into]:
            if float(aggregated(after, aggregate)) < enough:
                return (-1, into, grown), solves, False
            continue
        more = Modes(grown)
        factor, X = more.slopes(gradients_at(pools, grown))
        rows = [pool.rows[movable] for pool in pools]
        bounds = aggregated(after[:, None] + gradients_by(factor, rows), aggregate)
        bounds[~may] = np.inf
        sharper = aggregated(after[:, None] + _least_rises(pools, more, X, rows), aggregate)
        for i in tied_order(bounds):
            if bounds[i] >= enough:
                break
            if sharper[i] >= enough:
                continue
            if solves + len(pools) > limit:
                return None, solves, True
            out = int(movable[i])
            swapped = _without(pools, more, out, _swap(chosen, out, into), enough, aggregate)
            solves += len(pools)
            if swapped is not None:
                return (out, into, swapped), solves, False
    return None, solves, False


def _swap(chosen: np.ndarray, out: int, into: int) -> np.ndarray:
    return np.sort(np.append(chosen[chosen != out], into))


def _least_rises(pools: Sequence[Pool], modes: Modes, X: np.ndarray, rows: Sequence[np.ndarray]) -> np.ndarray:
    """Lower bounds (s, k) of what the removal of each gauge adds to the metric; X of `Modes.slopes`, rows (k, c, n)."""
    bounds = modes.sharper_bounds(X, modes.rows(rows).swapaxes(0, 1)).T
    each = zip(pools, modes.loops, bounds, strict=True)
    return np.array([pool.metric.least_rise(loop.P, bound) for pool, loop, bound in each])


def _without(
    pools: Sequence[Pool], modes: Modes, out: int, rest: np.ndarray, enough: float, aggregate: Aggregate
) -> list[Loop] | None:
    """The loops without a gauge, None if the metric is not below `enough`."""
    D = removals(pools, modes, [pool.rows[out] for pool in pools], lambda i: pools[i].stacked(rest))
    if D is None:
        return None
    P = [loop.P + d for loop, d in zip(modes.loops, D, strict=True)]
    if (
        float(aggregated(np.array([p.metric.value(each) for p, each in zip(pools, P, strict=True)]), aggregate))
        >= enough
    ):
        return None
    return [loop_of(p, rest, refine(p, information(p.stacked(rest)), each)) for p, each in zip(pools, P, strict=True)]


def _cost(pools: Sequence[Pool], loops: Sequence[Loop], aggregate: Aggregate) -> float:
    return float(aggregated(costs_of(pools, loops), aggregate))
