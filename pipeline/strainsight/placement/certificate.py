"""How far a set can be from the best of its size: the convex relaxation and its Frank-Wolfe bound."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.errors import NumericalError
from strainsight.placement.increment import gauge_gradients
from strainsight.placement.information import information
from strainsight.placement.limits import Limits, as_limits
from strainsight.placement.region import Region
from strainsight.placement.riccati import Loop, close_loop
from strainsight.placement.scenario import Aggregate, Pool, refined


@dataclass(frozen=True)
class Certificate:
    """No set of this size costs less than lower_bound; gap = (cost − lower_bound)/cost of the set that was certified.

    weights (pool,) of the relaxation, 0 ≤ w ≤ 1; iterations: evaluations of the relaxed cost;
    relaxed: the least relaxed cost found, which no bound can exceed; including (pool,): no such set with that gauge costs less.
    """

    lower_bound: float
    gap: float
    relaxed: float
    weights: np.ndarray
    iterations: int
    including: np.ndarray


def certify(
    pools: Sequence[Pool],
    gauges: Sequence[int] | np.ndarray,
    cost: float,
    aggregate: Aggregate = "mean",
    *,
    fixed: Collection[int] = (),
    limits: Limits | None = None,
    start: np.ndarray | None = None,
    tolerance: float = 1e-4,
    budget: int = 300,
) -> Certificate:
    """Lower bound of the aggregate of the metric over all sets with as many gauges as `gauges`, whose own cost is `cost`;
    over all layouts within `limits` where these are given.

        min f(w) over 0 ≤ w ≤ 1, Σ w = n or the limits, w = 1 on fixed gauges;   f = Σ_s μ_s c(P_s),   G = Σ_g w_g h_gᵀh_g
        every w and μ gives   f* ≥ Σ_s μ_s tr(W_s P_s) + min over v of g·(v − w),   g = −Σ_s μ_s tr(h_g P_s X_s P_s h_gᵀ)
        and of the sets with gauge j the same with the minimum over v_j = 1

    by projected gradient steps of Barzilai-Borwein length with a non-monotone line search; every point gives a bound
    and the best is kept. "mean": μ = 1/scenarios. "worst": max_s ≥ Σ μ_s f_s for any μ on the simplex; w descends on
    the soft maximum τ log Σ exp(f_s/τ), μ is its slope, and τ falls. A metric with kinks is softened by the same τ: with
    its W_s, tr(W_s P_s) bounds the metric itself (`Criterion`). Ends when bound and relaxed cost agree to `tolerance` or
    after `budget` evaluations: the bound is valid at any time. start (pool,): weights to begin with.
    Source: Frank and Wolfe (1956); Birgin, Martínez and Raydan, SIAM J. Optim. 10 (2000).
    """
    count = len(pools[0].rows)
    region = Region(as_limits(count, len(gauges) if limits is None else limits, fixed))
    relaxation = _Relaxation(pools, region, aggregate)
    # half the set itself, half the uniform weights: near the answer and still inside
    chosen = np.zeros(count)
    chosen[np.asarray(gauges, dtype=int)] = 1.0
    w = region.project(0.5 * (chosen + len(gauges) / len(chosen)) if start is None else start)
    smooth = (aggregate == "mean" or len(pools) == 1) and all(p.metric.smooth for p in pools)
    temperatures = [0.0] if smooth else [t * cost for t in (1e-2, 1e-3, 1e-4)]
    relaxed, used = np.inf, 0
    for stage, temperature in enumerate(temperatures, start=1):
        share = budget * stage // len(temperatures)
        w, relaxed, used = _descend(relaxation, w, temperature, relaxed, used, share, tolerance)
    # where the set is optimal the two agree to rounding: never claim more than the set attains
    lower = min(relaxation.lower, cost)
    relaxed = max(lower, relaxed)
    return Certificate(lower, (cost - lower) / cost, relaxed, w, used, relaxation.including)


def _descend(
    relaxation: _Relaxation,
    w: np.ndarray,
    temperature: float,
    relaxed: float,
    used: int,
    budget: int,
    tolerance: float,
) -> tuple[np.ndarray, float, int]:
    """Spectral projected gradient at one temperature, from w, until the bound closes: w, relaxed, used."""
    value, slope, costs, bound = relaxation.evaluate(w, temperature)
    used += 1
    relaxed = min(relaxed, costs)
    recent = [value]
    steepest = max(float(np.abs(slope).max()), np.finfo(float).tiny)
    reach = float(np.abs(relaxation.region.project(w - slope / steepest) - w).max())
    length = 0.1 / max(reach, 1e-12) / steepest
    while (
        used < budget
        and value - bound > 0.3 * tolerance * abs(value)
        and relaxed - relaxation.lower > tolerance * relaxed
    ):
        step = relaxation.region.project(w - length * slope) - w
        descent = float(slope @ step)
        if descent > -1e-15 * abs(value):
            break
        t = 1.0
        while used < budget:
            try:
                trial = relaxation.evaluate(w + t * step, temperature)
            except NumericalError:
                trial = None
            used += 1
            if trial is not None and trial[0] <= max(recent[-8:]) + 1e-4 * t * descent:
                break
            t *= 0.3
        else:
            break
        new, new_slope, costs, new_bound = trial
        relaxed = min(relaxed, costs)
        s, y = t * step, new_slope - slope
        curvature = float(s @ y)
        length = float(s @ s) / curvature if curvature > 0 else 10 * length
        w, value, slope, bound = w + s, new, new_slope, new_bound
        recent.append(value)
    return w, relaxed, used


class _Relaxation:
    """f(w) and ∇f, each scenario started from its last covariance; the best bounds so far: lower, of all sets, including (pool,),
    of those with each gauge."""

    def __init__(self, pools: Sequence[Pool], region: Region, aggregate: Aggregate):
        self.pools, self.region, self.aggregate = pools, region, aggregate
        self.last: list[np.ndarray | None] = [None] * len(pools)
        self.lower, self.including = -np.inf, np.full(len(pools[0].rows), -np.inf)

    def evaluate(self, w: np.ndarray, temperature: float) -> tuple[float, np.ndarray, float, float]:
        """Objective, its gradient (pool,), the aggregate cost and the lower bound at w (pool,)."""
        loops = [self._loop(i, w) for i in range(len(self.pools))]
        costs = np.array([p.metric.value(l.P) for p, l in zip(self.pools, loops, strict=True)])
        soft, levels, gradients = np.empty_like(costs), np.empty_like(costs), np.empty((len(costs), len(w)))
        for i, (p, l) in enumerate(zip(self.pools, loops, strict=True)):
            metric = p.metric.softened(temperature)
            W = metric.gradient(l.P)
            soft[i], levels[i] = metric.value(l.P), np.vdot(W, l.P)
            gradients[i] = -gauge_gradients(l, p.rows, W)
        if temperature > 0 and self.aggregate == "worst":
            share = np.exp((soft - soft.max()) / temperature)
            value = soft.max() + temperature * np.log(share.sum())
            mu = share / share.sum()
        else:
            mu = np.full(len(costs), 1 / len(costs))
            value = float(mu @ soft)
        slope = mu @ gradients
        least, rise = self.region.least(slope)
        bound = float(mu @ levels - slope @ w + least)
        self.lower, self.including = max(self.lower, bound), np.maximum(self.including, bound + rise)
        return float(value), slope, float(costs.max() if self.aggregate == "worst" else costs.mean()), bound

    def _loop(self, i: int, w: np.ndarray) -> Loop:
        pool = self.pools[i]
        rows = (pool.rows * np.sqrt(w)[:, None, None]).reshape(-1, pool.rows.shape[2])
        G = information(rows)
        P = refined(pool, G, self.last[i])
        self.last[i] = P
        return close_loop(pool.scenario.F, G, P)
