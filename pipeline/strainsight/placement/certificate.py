"""Distance of a set from the best of its size: the convex relaxation and its Frank-Wolfe bound."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from strainsight.errors import NumericalError
from strainsight.loads.observability import undetectable_directions
from strainsight.placement.exchange import costs_of, gradients_of
from strainsight.placement.increment import gauge_gradients
from strainsight.placement.limits import Limits, Polytope, as_limits, cheapest
from strainsight.placement.riccati import Loop, close_loop, information
from strainsight.placement.scenario import Aggregate, Pool, aggregated, refine

CLOSE = 1e-4
"""Relative difference of bound and relaxed cost at which the relaxation has converged."""


@dataclass(frozen=True)
class Certificate:
    """No set of this size costs less than lower_bound; gap = (cost − lower_bound)/cost of the set that was certified. weights
    (pool,) of the relaxation, 0 ≤ w ≤ 1; iterations: evaluations of the relaxed cost; relaxed: the least relaxed cost found,
    which no bound can exceed; including (pool,): no such set with that gauge costs less."""

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
    limits: Limits | None = None,
    start: np.ndarray | None = None,
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
    its W_s, tr(W_s P_s) bounds the metric itself (`Criterion`). Ends when bound and relaxed cost agree to CLOSE or
    after `budget` evaluations: the bound is valid at any time. start (pool,): weights to begin with.
    Source: Frank and Wolfe (1956); Birgin, Martínez and Raydan, SIAM J. Optim. 10 (2000)."""
    count = len(pools[0].rows)
    region = Polytope(as_limits(count, len(gauges) if limits is None else limits))
    relaxation = _Relaxation(pools, region, aggregate)
    # half the set itself, half the uniform weights: near the answer and still inside
    chosen = np.zeros(count)
    chosen[np.asarray(gauges, dtype=int)] = 1.0
    w = region.project(0.5 * (chosen + len(gauges) / len(chosen)) if start is None else start)
    smooth = (aggregate == "mean" or len(pools) == 1) and all(p.metric.smooth for p in pools)
    temperatures = [0.0] if smooth else [t * cost for t in (1e-2, 1e-3, 1e-4)]
    for stage, temperature in enumerate(temperatures, start=1):
        w = relaxation.descend(w, temperature, budget * stage // len(temperatures))
    # where the set is optimal the two agree to rounding: never claim more than the set attains
    lower = min(relaxation.lower, cost)
    relaxed = max(lower, relaxation.relaxed)
    return Certificate(lower, (cost - lower) / cost, relaxed, w, relaxation.used, relaxation.including)


class _Relaxation:
    """f(w) and ∇f, each scenario started from its last covariance; the best bounds so far: lower, of all sets, including (pool,),
    of those with each gauge; relaxed: the least cost of the weights on the way; used: evaluations."""

    def __init__(self, pools: Sequence[Pool], region: Polytope, aggregate: Aggregate):
        self.pools, self.region, self.aggregate = pools, region, aggregate
        self.last: list[np.ndarray | None] = [None] * len(pools)
        self.lower, self.including = -np.inf, np.full(len(pools[0].rows), -np.inf)
        self.relaxed, self.used = np.inf, 0

    def descend(self, w: np.ndarray, temperature: float, budget: int) -> np.ndarray:
        """Spectral projected gradient at one temperature, from w (pool,), until the bound closes or the budget is used."""
        value, slope, cost, bound = self.evaluate(w, temperature)
        self.relaxed = min(self.relaxed, cost)
        recent = [value]
        steepest = max(float(np.abs(slope).max()), np.finfo(float).tiny)
        reach = float(np.abs(self.region.project(w - slope / steepest) - w).max())
        length = 0.1 / max(reach, 1e-12) / steepest
        while value - bound > 0.3 * CLOSE * abs(value) and self.relaxed - self.lower > CLOSE * self.relaxed:
            step = self.region.project(w - length * slope) - w
            descent = float(slope @ step)
            if self.used >= budget or descent > -1e-15 * abs(value):
                break
            t, trial = 1.0, None
            while self.used < budget and trial is None:
                with suppress(NumericalError):
                    trial = self.evaluate(w + t * step, temperature)
                if trial is not None and trial[0] > max(recent[-8:]) + 1e-4 * t * descent:
                    trial = None
                t *= 0.3 if trial is None else 1.0
            if trial is None:
                break
            new, new_slope, cost, new_bound = trial
            self.relaxed = min(self.relaxed, cost)
            s, y = t * step, new_slope - slope
            curvature = float(s @ y)
            length = float(s @ s) / curvature if curvature > 0 else 10 * length
            w, value, slope, bound = w + s, new, new_slope, new_bound
            recent.append(value)
        return w

    def evaluate(self, w: np.ndarray, temperature: float) -> tuple[float, np.ndarray, float, float]:
        """Objective, its gradient (pool,), the aggregate cost and the lower bound at w (pool,)."""
        self.used += 1
        loops = [relaxed_loop(p, weight_rows(p, w), P) for p, P in zip(self.pools, self.last, strict=True)]
        self.last = [loop.P for loop in loops]
        costs = costs_of(self.pools, loops)
        metrics = [(p.metric.softened(temperature), l.P) for p, l in zip(self.pools, loops, strict=True)]
        soft = np.array([metric.value(P) for metric, P in metrics])
        W = [metric.gradient(P) for metric, P in metrics]
        levels = np.array([np.vdot(w, P) for w, (_, P) in zip(W, metrics, strict=True)])
        gradients = -gauge_gradients(loops, [p.rows for p in self.pools], W)
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
        return float(value), slope, float(aggregated(costs, self.aggregate)), bound


def weight_rows(pool: Pool, w: np.ndarray) -> np.ndarray:
    """√w_g h_g (pool · c, n*), of which G = Σ_g w_g h_gᵀh_g."""
    return (pool.rows * np.sqrt(w)[:, None, None]).reshape(-1, pool.rows.shape[2])


def relaxed_loop(pool: Pool, rows: np.ndarray, last: np.ndarray | None) -> Loop:
    """Closed loop with `weight_rows`; last: a covariance of similar weights."""
    G = information(rows)
    return close_loop(pool.scenario.F, G, refine(pool, G, last))


@dataclass(frozen=True)
class Cut:
    """f_s(v) ≥ offset_s + slope_s·v for all gauge weights v ≥ 0: f_s the metric, touched at the weights it was made at.
    offset (s,), slope (s, pool); cost (s,): f_s there; P: covariances there, for the next one to start from."""

    offset: np.ndarray
    slope: np.ndarray
    cost: np.ndarray
    P: tuple[np.ndarray, ...]


@dataclass(frozen=True)
class Bound:
    """No set of the node costs less than value; weights (pool,): where the cuts are lowest; selected (pool,) bool: the free
    gauges that the combination of cuts behind the bound takes; reduced (pool,): by how much that bound rises where one
    of them is left out, or another free gauge is taken; active (cuts,) bool: the cuts it combines."""

    value: float
    weights: np.ndarray
    selected: np.ndarray
    reduced: np.ndarray
    active: np.ndarray


def cut_at(pools: Sequence[Pool], w: np.ndarray, last: Sequence[np.ndarray] | None) -> Cut | None:
    """The plane that touches the relaxed cost of every scenario at w (pool,), None where w cannot detect every unknown.

        f(v) ≥ f(w) + ∇f·(v − w),   ∂f/∂w_g = −tr(h_g P X P h_gᵀ),   G = Σ_g w_g h_gᵀh_g

    A plane bounds f everywhere because f is convex (`Criterion`). last: covariances of weights nearby."""
    loops = []
    for pool, P in zip(pools, [None] * len(pools) if last is None else last, strict=True):
        rows = weight_rows(pool, w)
        if not detects(pool, rows):
            return None
        try:
            loops.append(relaxed_loop(pool, rows, P))
        except NumericalError:
            return None
    f, g = costs_of(pools, loops), -gradients_of(pools, loops)
    return Cut(f - g @ w, g, f, tuple(loop.P for loop in loops))


def detects(pool: Pool, rows: np.ndarray) -> bool:
    """Whether rows h/√r (m, n*) detect every unknown."""
    return undetectable_directions(pool.scenario.F, rows, pool.modes).shape[1] == 0


def lowest(
    cuts: Sequence[Cut], inside: np.ndarray, free: np.ndarray, keep: int | Limits, aggregate: Aggregate
) -> Bound:
    """Least aggregate of the cuts over all layouts of gauges of inside or free that hold all of inside.

        min agg_s(t_s),   t_s ≥ offset_ks + slope_ks·v,   A v ≤ b,   0 ≤ v ≤ 1,   Σ v = keep,   v = 1 inside, 0 elsewhere

    The linear program only chooses the multipliers μ_ks of the cuts (Σ_k μ_ks = 1/scenarios for the mean, Σ μ = 1 for
    the worst) and λ ≥ 0 of the limits other than the count; with any of them, Σ μ (offset + slope·v) + λ·(A v − b) bounds the
    aggregate, and its minimum over v follows from sorting: the bound does not depend on the tolerances of the program. It is
    infinite where the program has no point. inside, free (pool,) bool, at least one way to choose."""
    limits = as_limits(len(free), keep)
    places = np.flatnonzero(free)
    used = limits.used(inside)
    size, left, floor = limits.size[places], limits.keep - int(used[0]), limits.least - int(used[0])
    scenarios = len(cuts[0].offset)
    offset = np.array([c.offset + c.slope[:, inside].sum(axis=1) for c in cuts])
    slope = np.array([c.slope[:, places] for c in cuts])
    unit = max(float(np.abs(offset).max()), np.finfo(float).tiny)
    levels = np.tile(np.eye(scenarios), (len(cuts), 1)) if aggregate == "mean" else np.ones((offset.size, 1))
    A, b = _binding(limits, places, used, floor)
    nothing = np.zeros((len(b), levels.shape[1]))
    exact = floor == left
    programme = linprog(
        np.concatenate([np.zeros(len(places)), np.full(levels.shape[1], 1 / levels.shape[1])]),
        A_ub=np.vstack([np.hstack([slope.reshape(offset.size, -1) / unit, -levels]), np.hstack([A, nothing])]),
        b_ub=np.concatenate([-offset.ravel() / unit, b]),
        A_eq=np.concatenate([size, np.zeros(levels.shape[1])])[None, :] if exact else None,
        b_eq=[left] if exact else None,
        bounds=[(0, 1)] * len(places) + [(None, None)] * levels.shape[1],
        method="highs-ds",
    )
    if programme.status == 2:
        nowhere = np.full(len(free), np.inf)
        return Bound(np.inf, inside.astype(float), np.zeros_like(free), nowhere, np.ones(len(cuts), dtype=bool))
    mu = np.zeros(offset.shape)
    mu[-1] = 1.0
    penalty = np.zeros(len(b))
    if programme.status == 0:
        multipliers = np.maximum(-programme.ineqlin.marginals, 0.0)
        mu = multipliers[: offset.size].reshape(offset.shape) + 1e-15 * mu
        penalty = unit * multipliers[offset.size :]
    mu /= scenarios * mu.sum(axis=0) if aggregate == "mean" else mu.sum()
    if not exact:
        # count and floor are left to the sorting
        penalty[:2] = 0.0
    steep = np.tensordot(mu, slope, axes=2) + penalty @ A
    least, chosen, rise = _sort_rows(steep, size, floor, left)
    reduced, selected = np.full(len(free), np.inf), np.zeros(len(free), dtype=bool)
    reduced[places], selected[places] = rise, chosen
    weights = inside.astype(float)
    solved = programme.x if programme.status == 0 else None
    weights[places] = chosen if solved is None else np.clip(solved[: len(places)], 0, 1)
    value = float((mu * offset).sum() - penalty @ b) + least
    return Bound(value, weights, selected, reduced, mu.sum(axis=1) > 1e-12)


def _binding(limits: Limits, places: np.ndarray, used: np.ndarray, floor: int) -> tuple[np.ndarray, np.ndarray]:
    """Limits that the free gauges could break, each with a largest entry of one: A (k, free), b (k,). The count and Σ size·v ≥
    floor come first, unless they are one equation."""
    part = limits.rows[:, places]
    room = limits.most - used
    open_ = np.asarray(part.sum(axis=1)).ravel() > room
    open_[0] = False
    A, b = part[open_].toarray(), room[open_]
    if floor != room[0]:
        size = limits.size[places].astype(float)
        A, b = np.vstack([size, -size, A]), np.concatenate([[room[0], -floor], b])
    unit = np.maximum(np.abs(A).max(axis=1, initial=0.0), np.finfo(float).tiny)
    return A / unit[:, None], b / unit


def _sort_rows(steep: np.ndarray, size: np.ndarray, floor: int, left: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Minimum of steep·v over 0 ≤ v ≤ 1, floor ≤ Σ size·v ≤ left; the selected gauges; the increment by the other choice of
    each."""
    if floor != left or np.any(size != 1):
        value, theta = cheapest(steep, size, floor, left)
        price = steep + theta * size
        return value, price < 0, np.abs(price)
    order = np.argsort(steep, kind="stable")
    selected, others = order[:left], order[left:]
    rise = np.full(len(steep), np.inf)
    if left and len(others):
        rise[selected] = steep[others[0]] - steep[selected]
        rise[others] = steep[others] - steep[selected[-1]]
    chosen = np.zeros(len(steep), dtype=bool)
    chosen[selected] = True
    return float(steep[selected].sum()), chosen, rise
