"""What any set of gauges is worth, by the covariance that also ranks the elimination, and how many are worth it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components

from strainsight.errors import NumericalError
from strainsight.placement.scenario import Aggregate, Gauges, Pool, aggregated, covariances_of


@dataclass(frozen=True)
class Scores:
    """One layout by every metric, from the same steady covariances P; inf if it loses an unknown, NaN without a
    layout or an accurate P.

    cost: name of the metric → its aggregate; std (count,) [SI]: √Pᵢᵢ · scale of each unknown, root mean square over
    scenarios. All of a fixed linearisation: numbers to rank layouts by, not what a filter along the motion will claim."""

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
        cost = {key: cost_of(P, matrix, aggregate) for key, matrix in by.items()}
    except NumericalError:
        return Scores.all(by, np.nan, len(unknown))
    if P is None:
        return Scores.all(by, np.inf, len(unknown))
    variances = np.array([(np.diag(matrix) * pool.scale**2)[unknown] for pool, matrix in zip(pools, P, strict=True)])
    if share is None:
        return Scores(cost, np.sqrt(np.mean(variances, axis=0)) * scale)
    return Scores(cost, np.sqrt(np.sum(share * variances * scale**2, axis=0)))


def cost_of(covariances: Sequence[np.ndarray] | None, pools: Sequence[Pool], aggregate: Aggregate) -> float:
    """Aggregate of the metric, inf where there are no covariances."""
    if covariances is None:
        return float("inf")
    values = [p.metric.value(P) for p, P in zip(pools, covariances, strict=True)]
    return float(aggregated(np.array(values), aggregate))


WORTH = 0.05
"""Relative decrease of σ for which another gauge is worthwhile."""
REDUNDANT = 0.99
"""Cosine between the rows of two gauges above which they are redundant."""
NOTHING = 1e-6
"""Share of its largest response below which a gauge of several channels does not respond to a motion."""


def gains(cost: np.ndarray) -> np.ndarray:
    """Relative decrease of σ = √c by one more gauge, from the smallest set on: 1 − √(c(n + 1)/c(n)). cost (s,) of an
    elimination, the whole pool first. Returns (s − 1,) for n = keep, keep + 1, …, pool − 1."""
    c = np.asarray(cost, dtype=float)[::-1]
    return 1 - np.sqrt(c[1:] / c[:-1])


def worth_keeping(cost: np.ndarray, keep: int) -> int:
    """Elbow of the trend: fewest gauges n ≥ keep after which no further one reduces σ by 5 % or more. cost (pool − keep + 1,)
    of an elimination, the whole pool first."""
    worth = np.flatnonzero(gains(cost) >= WORTH)
    return keep + (int(worth[-1]) + 1 if worth.size else 0)


def redundant_groups(rows: np.ndarray) -> list[tuple[int, ...]]:
    """Groups of redundant gauges, whose rows (k, n), or (k, c, n) of up to c channels, span the same space. Each is within
    0.99 of another of its group, by the smallest cosine of the principal angles; for one channel |cos| of the rows. Rows in
    coordinates of unit training amplitude: the cosine is the correlation of the readings, and redundant gauges only average
    noise. Spaces of different dimension, such as of a rosette and a single gauge, never agree."""
    blocks = np.reshape(rows, (len(rows), -1, rows.shape[-1]))
    _, sigma, basis = np.linalg.svd(blocks, full_matrices=False)
    rank = np.sum(sigma > NOTHING * sigma[:, :1], axis=1)
    near = np.zeros((len(blocks),) * 2, dtype=bool)
    for r in np.unique(rank[rank > 0]):
        same = np.flatnonzero(rank == r)
        span = basis[same, :r]
        cosines = np.linalg.svd(np.einsum("ain,bjn->abij", span, span), compute_uv=False)
        near[np.ix_(same, same)] = cosines[..., -1] > REDUNDANT
    _, group = connected_components(near, directed=False)
    members = [tuple(np.flatnonzero(group == number).tolist()) for number in dict.fromkeys(group.tolist())]
    return [member for member in members if len(member) > 1]
