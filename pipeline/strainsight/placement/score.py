"""What any set of gauges is worth, by the covariance that also ranks the elimination."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.placement.scenario import Aggregate, Pool, aggregated, subset_covariance, weighted_trace

Gauges = Sequence[int] | np.ndarray


def score(pools: Sequence[Pool], gauges: Gauges, aggregate: Aggregate = "mean") -> float:
    """Aggregate of tr(W P) with these gauges (pool rows) only; inf where they cannot detect every unknown."""
    costs = []
    for pool in pools:
        P = subset_covariance(pool, gauges)
        if P is None:
            return float("inf")
        costs.append(weighted_trace(pool, P))
    return float(aggregated(np.array(costs), aggregate))


def frozen_std(pools: Sequence[Pool], gauges: Gauges, count: int) -> np.ndarray:
    """√Pᵢᵢ of the last `count` states, the unknowns, with these gauges (scenarios, count), in units of ũ and p.

    A ranking number of the frozen linearisation, not what a filter along the motion will claim. inf where undetectable.
    """
    std = np.full((len(pools), count), np.inf)
    for row, pool in zip(std, pools, strict=True):
        P = subset_covariance(pool, gauges)
        if P is not None and count:
            row[:] = (np.sqrt(np.diag(P)) * pool.scale)[-count:]
    return std
