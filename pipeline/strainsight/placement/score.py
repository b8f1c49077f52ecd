"""What any set of gauges is worth, by the covariance that also ranks the elimination."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.errors import NumericalError
from strainsight.placement.scenario import Aggregate, Pool, aggregated, subset_covariance, weighted_trace

Gauges = Sequence[int] | np.ndarray


@dataclass(frozen=True)
class Scores:
    """One layout by every criterion, from the same steady covariances P; inf throughout where it loses an unknown, NaN where
    there is none or P is not solved to accuracy.

    trace [1]: aggregate of tr(W P); log_determinant: mean over scenarios of ln det P_uu; worst_eigenvalue: aggregate of
    the largest eigenvalue of P_uu, the variance of the worst-known combination of unknowns, both of the unknowns as in x*
    (relative to amplitude and guess); std (count,) [N, SI]: √Pᵢᵢ · scale of each unknown, root mean square over scenarios.
    All of a frozen linearisation: numbers to rank layouts by, not what a filter along the motion will claim.
    """

    trace: float
    log_determinant: float
    worst_eigenvalue: float
    std: np.ndarray

    @classmethod
    def all(cls, value: float, unknowns: int) -> Scores:
        return cls(value, value, value, np.full(unknowns, value))


def score(pools: Sequence[Pool], gauges: Gauges, aggregate: Aggregate = "mean") -> float:
    """Aggregate of tr(W P) with these gauges (pool rows) only; inf where they cannot detect every unknown."""
    costs = []
    for pool in pools:
        P = subset_covariance(pool, gauges)
        if P is None:
            return float("inf")
        costs.append(weighted_trace(pool, P))
    return float(aggregated(np.array(costs), aggregate))


def scores(
    pools: Sequence[Pool], gauges: Gauges, unknown: np.ndarray, scale: np.ndarray, aggregate: Aggregate = "mean"
) -> Scores:
    """The `Scores` of these gauges (pool rows); unknown (count,): their indices in x*; scale (count,) [N, SI]."""
    traces, determinants, largest, variances = [], [], [], []
    for pool in pools:
        try:
            P = subset_covariance(pool, gauges)
        except NumericalError:
            return Scores.all(np.nan, len(unknown))
        if P is None:
            return Scores.all(np.inf, len(unknown))
        block = unknown_block(pool, P, unknown)
        traces.append(weighted_trace(pool, P))
        determinants.append(np.linalg.slogdet(block)[1])
        largest.append(np.linalg.eigvalsh(block).max(initial=0.0))
        variances.append(np.diag(block))
    return Scores(
        trace=float(aggregated(np.array(traces), aggregate)),
        log_determinant=float(np.mean(determinants)),
        worst_eigenvalue=float(aggregated(np.array(largest), aggregate)),
        std=np.sqrt(np.mean(variances, axis=0)) * scale,
    )


def unknown_block(pool: Pool, P: np.ndarray, unknown: np.ndarray) -> np.ndarray:
    """Rows and columns of the unknowns (count,) of a covariance P (n*, n*) in the pool's coordinates, in units of x*."""
    units = pool.scale[unknown]
    return np.asarray(P[np.ix_(unknown, unknown)] * np.outer(units, units))


def frozen_std(pools: Sequence[Pool], gauges: Gauges, unknown: np.ndarray) -> np.ndarray:
    """√Pᵢᵢ of the unknowns (count,), indices in x*, with these gauges (scenarios, count), in the units of x*.

    A ranking number of the frozen linearisation, not what a filter along the motion will claim. inf where undetectable.
    """
    std = np.full((len(pools), len(unknown)), np.inf)
    for row, pool in zip(std, pools, strict=True):
        P = subset_covariance(pool, gauges)
        if P is not None:
            row[:] = np.sqrt(np.diag(unknown_block(pool, P, unknown)))
    return std
