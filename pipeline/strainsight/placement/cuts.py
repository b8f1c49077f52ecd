"""Supporting planes of the relaxed cost, and the bound that several of them give together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from strainsight.errors import NumericalError
from strainsight.loads.observability import undetectable_directions
from strainsight.placement.increment import gauge_gradients
from strainsight.placement.information import information
from strainsight.placement.limits import Limits, as_limits
from strainsight.placement.region import cheapest
from strainsight.placement.riccati import close_loop
from strainsight.placement.scenario import Aggregate, Pool, refined


@dataclass(frozen=True)
class Cut:
    """f_s(v) ≥ offset_s + slope_s·v for all gauge weights v ≥ 0: f_s the metric, touched at the weights it was made at.

    offset (s,), slope (s, pool); cost (s,): f_s there; P: covariances there, for the next one to start from.
    """

    offset: np.ndarray
    slope: np.ndarray
    cost: np.ndarray
    P: tuple[np.ndarray, ...]


@dataclass(frozen=True)
class Bound:
    """No set of the node costs less than value; weights (pool,): where the cuts are lowest; taken (pool,) bool: the free
    gauges that the combination of cuts behind the bound takes; reduced (pool,): by how much that bound rises where one
    of them is left out, or another free gauge is taken; active (cuts,) bool: the cuts it combines."""

    value: float
    weights: np.ndarray
    taken: np.ndarray
    reduced: np.ndarray
    active: np.ndarray


def cut_at(pools: Sequence[Pool], w: np.ndarray, last: Sequence[np.ndarray] | None) -> Cut | None:
    """The plane that touches the relaxed cost of every scenario at w (pool,), None where w cannot detect every unknown.

        f(v) ≥ f(w) + ∇f·(v − w),   ∂f/∂w_g = −tr(h_g P X P h_gᵀ),   G = Σ_g w_g h_gᵀh_g

    A plane bounds f everywhere because f is convex (`Criterion`). last: covariances of weights nearby.
    """
    cost, slope, covariances = [], [], []
    for i, pool in enumerate(pools):
        rows = (pool.rows * np.sqrt(w)[:, None, None]).reshape(-1, pool.rows.shape[2])
        if not detects(pool, rows):
            return None
        G = information(rows)
        try:
            P = refined(pool, G, None if last is None else last[i])
        except NumericalError:
            return None
        cost.append(pool.metric.value(P))
        slope.append(-gauge_gradients(close_loop(pool.scenario.F, G, P), pool.rows, pool.metric.gradient(P)))
        covariances.append(P)
    f, g = np.array(cost), np.array(slope)
    return Cut(f - g @ w, g, f, tuple(covariances))


def detects(pool: Pool, rows: np.ndarray) -> bool:
    """Whether rows h/√r (m, n*) detect every unknown."""
    return undetectable_directions(pool.scenario.F, rows, pool.modes).shape[1] == 0


def lowest(
    cuts: Sequence[Cut], inside: np.ndarray, free: np.ndarray, keep: int | Limits, aggregate: Aggregate
) -> Bound:
    """Least aggregate of the cuts over all layouts of gauges of inside or free that hold all of inside.

        min agg_s(t_s),   t_s ≥ offset_ks + slope_ks·v,   A v ≤ b,   0 ≤ v ≤ 1,   Σ v = keep,   v = 1 inside, 0 elsewhere

    The linear program only chooses the multipliers μ_ks of the cuts (Σ_k μ_ks = 1/scenarios for the mean, Σ μ = 1 for
    the worst) and λ ≥ 0 of the limits beside the count; with any of them, Σ μ (offset + slope·v) + λ·(A v − b) bounds the
    aggregate, and its least over v is had by sorting: the bound does not depend on the tolerances of the program. It is
    infinite where the program has no point. inside, free (pool,) bool, at least one way to choose.
    """
    limits = as_limits(len(free), keep, ())
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
        found = np.maximum(-programme.ineqlin.marginals, 0.0)
        mu = found[: offset.size].reshape(offset.shape) + 1e-15 * mu
        penalty = unit * found[offset.size :]
    mu /= scenarios * mu.sum(axis=0) if aggregate == "mean" else mu.sum()
    if not exact:
        # count and floor are left to the sorting
        penalty[:2] = 0.0
    steep = np.tensordot(mu, slope, axes=2) + penalty @ A
    least, chosen, rise = _sorted(steep, size, floor, left)
    reduced, taken = np.full(len(free), np.inf), np.zeros(len(free), dtype=bool)
    reduced[places], taken[places] = rise, chosen
    weights = inside.astype(float)
    solved = programme.x if programme.status == 0 else None
    weights[places] = chosen if solved is None else np.clip(solved[: len(places)], 0, 1)
    value = float((mu * offset).sum() - penalty @ b) + least
    return Bound(value, weights, taken, reduced, mu.sum(axis=1) > 1e-12)


def _binding(limits: Limits, places: np.ndarray, used: np.ndarray, floor: int) -> tuple[np.ndarray, np.ndarray]:
    """The limits that the free gauges could break, each at a largest entry of one: A (k, free), b (k,).

    The count and Σ size·v ≥ floor come first, where they are not one equation.
    """
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


def _sorted(steep: np.ndarray, size: np.ndarray, floor: int, left: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Least of steep·v over 0 ≤ v ≤ 1, floor ≤ Σ size·v ≤ left; the gauges it takes; what the other choice of each adds."""
    if floor != left or np.any(size != 1):
        value, theta = cheapest(steep, size, floor, left)
        price = steep + theta * size
        return value, price < 0, np.abs(price)
    order = np.argsort(steep, kind="stable")
    taken, others = order[:left], order[left:]
    rise = np.full(len(steep), np.inf)
    if left and len(others):
        rise[taken] = steep[others[0]] - steep[taken]
        rise[others] = steep[others] - steep[taken[-1]]
    chosen = np.zeros(len(steep), dtype=bool)
    chosen[taken] = True
    return float(steep[taken].sum()), chosen, rise
