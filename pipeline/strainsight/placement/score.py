"""What any set of gauges is worth, by the covariance that also ranks the elimination."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.errors import NumericalError
from strainsight.placement.scenario import Aggregate, Pool, aggregated, subset_covariance

Gauges = Sequence[int] | np.ndarray


@dataclass(frozen=True)
class Scores:
    """One layout by every metric, from the same steady covariances P; inf throughout where it loses an unknown, NaN where
    there is none or P is not solved to accuracy.

    cost: name of the metric → its aggregate; std (count,) [SI]: √Pᵢᵢ · scale of each unknown, root mean square over
    scenarios. All of a fixed linearisation: numbers to rank layouts by, not what a filter along the motion will claim.
    """

    cost: Mapping[str, float]
    std: np.ndarray

    @classmethod
    def all(cls, metrics: Iterable[str], value: float, unknowns: int) -> Scores:
        return cls(dict.fromkeys(metrics, value), np.full(unknowns, value))


def score(pools: Sequence[Pool], gauges: Gauges, aggregate: Aggregate = "mean") -> float:
    """Aggregate of the metric with these gauges (pool rows) only; inf where they cannot detect every unknown."""
    return cost_of(covariances_of(pools, gauges), pools, aggregate)


def scores(
    by: Mapping[str, Sequence[Pool]],
    gauges: Gauges,
    unknown: np.ndarray,
    scale: np.ndarray,
    aggregate: Aggregate = "mean",
    share: np.ndarray | None = None,
) -> Scores:
    """The `Scores` of these gauges (pool rows); by: name of a metric → the scenarios with it; unknown (count,): the unknowns'
    indices in x*; scale (count,) [SI], or (scenarios, count) with share (scenarios, count), what each counts in σ, of sum 1."""
    pools = next(iter(by.values()))
    try:
        P = covariances_of(pools, gauges)
        cost = {key: cost_of(P, own, aggregate) for key, own in by.items()}
    except NumericalError:
        return Scores.all(by, np.nan, len(unknown))
    if P is None:
        return Scores.all(by, np.inf, len(unknown))
    variances = np.array([np.diag(unknown_block(pool, own, unknown)) for pool, own in zip(pools, P, strict=True)])
    if share is None:
        return Scores(cost, np.sqrt(np.mean(variances, axis=0)) * scale)
    return Scores(cost, np.sqrt(np.sum(share * variances * scale**2, axis=0)))


def covariances_of(pools: Sequence[Pool], gauges: Gauges) -> list[np.ndarray] | None:
    """P of every scenario, or None where these gauges lose an unknown."""
    found = []
    for pool in pools:
        P = subset_covariance(pool, gauges)
        if P is None:
            return None
        found.append(P)
    return found


def cost_of(covariances: Sequence[np.ndarray] | None, pools: Sequence[Pool], aggregate: Aggregate) -> float:
    """Aggregate of the metric, inf where there are no covariances."""
    if covariances is None:
        return float("inf")
    values = [p.metric.value(P) for p, P in zip(pools, covariances, strict=True)]
    return float(aggregated(np.array(values), aggregate))


def unknown_block(pool: Pool, P: np.ndarray, unknown: np.ndarray) -> np.ndarray:
    """Rows and columns of the unknowns (count,) of a covariance P (n*, n*) in the pool's coordinates, in units of x*."""
    units = pool.scale[unknown]
    return np.asarray(P[np.ix_(unknown, unknown)] * np.outer(units, units))
