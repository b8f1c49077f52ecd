"""The gauge that is missed least of those still there, by exact costs and few of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from strainsight.placement.increment import Slopes, removal, sharper_bound, slopes, squares
from strainsight.placement.information import information
from strainsight.placement.ordering import TIE
from strainsight.placement.remaining import Remaining
from strainsight.placement.riccati import Loop
from strainsight.placement.scenario import Aggregate, Pool, aggregated, refined


@dataclass(frozen=True)
class Choice:
    """The gauge to remove and its place in `Remaining`; D (n, n) of every scenario; the aggregate's rise; the ties."""

    gauge: int
    at: int
    increments: list[np.ndarray]
    rise: float
    ties: tuple[int, ...]


def least_missed(
    pools: Sequence[Pool],
    loops: Sequence[Loop],
    costs: np.ndarray,
    left: Remaining,
    aggregate: Aggregate,
    relief: np.ndarray | None = None,
) -> tuple[Choice | None, int, np.ndarray]:
    """The gauge of the smallest rise, None where every removal costs infinity; the number of exact solves; the bounds.

    relief (m,): the rise counts per relief, and gauges of none stay; 1 where not given.
    """
    # relative to the present aggregate, so that small rises keep their digits
    level = costs - costs.max() if aggregate == "worst" else np.zeros_like(costs)
    shared = [slopes(loop, p.scenario.weight) for p, loop in zip(pools, loops, strict=True)]
    bounds = np.array([squares(left.product(i, s.factor)) for i, s in enumerate(shared)])
    worth = aggregated(level[:, None] + bounds, aggregate)
    per = np.ones(len(worth)) if relief is None else relief
    waiting = np.divide(worth, per, out=np.full(len(worth), np.inf), where=left.movable & (per > 0))
    exact: dict[int, tuple[float, list[np.ndarray]]] = {}
    best, solves = np.inf, 0
    while best == np.inf:
        at = int(np.argmin(waiting))
        if waiting[at] == np.inf:
            return None, solves, worth
        value, increments, number = _exactly(pools, loops, level, bounds[:, at], left, at, aggregate, best)
        solves += number
        waiting[left.twins(at)] = np.inf
        if increments is not None:
            exact[at], best = (value, increments), value / per[at]
    doubtful = [
        (bound / per[at], at, parts)
        for at in left.one_of_each(np.flatnonzero(waiting <= best * (1 + TIE)))
        for bound, parts in [_sharpened(pools, shared, level, bounds[:, at], left, at, aggregate, best * per[at])]
    ]
    for bound, at, parts in sorted(doubtful, key=lambda entry: entry[:2]):
        if bound > best * (1 + TIE):
            break
        value, increments, number = _exactly(pools, loops, level, parts, left, at, aggregate, best * per[at])
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


def known_to_go(
    pools: Sequence[Pool], loops: Sequence[Loop], costs: np.ndarray, left: Remaining, aggregate: Aggregate, gauge: int
) -> Choice:
    """The removal of a gauge without which every unknown is known to be told, whatever the test of what is left says.

    The test compares with the strongest row there: beside one of 1e10 times the weight, all others are rounding.
    """
    at = int(np.flatnonzero(left.index == gauge)[0])
    increments = []
    for pool, loop in zip(pools, loops, strict=True):
        rows = pool.stacked(left.without(at))
        increments.append(refined(pool, information(rows), None) - loop.P)
    rises = np.array([p.scenario.weight @ np.diag(D) for p, D in zip(pools, increments, strict=True)])
    rise = aggregated(costs + rises, aggregate) - aggregated(costs, aggregate)
    return Choice(gauge, at, increments, float(rise), ())


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
        s, block = pool.scenario, pool.rows[left.index[at]]
        D = removal(s.F, s.Q, loop, block, partial(rest, pool, left, at), pool.modes)
        if D is None:
            return np.inf, None, i + 1
        increments.append(D)
        parts[i] = s.weight @ np.diag(D)
        if aggregated(level + parts, aggregate) > best * (1 + TIE):
            return np.inf, None, i + 1
    return float(aggregated(level + parts, aggregate)), increments, len(pools)


def rest(pool: Pool, left: Remaining, at: int) -> np.ndarray:
    """Rows (m − 1, c, n*) of the gauges left but the one at this place."""
    return pool.rows[left.without(at)]
