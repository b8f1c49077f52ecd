"""Supporting planes of the relaxed cost, and the bound that several of them give together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from strainsight.augmentation.observability import undetectable_directions
from strainsight.errors import NumericalError
from strainsight.placement.increment import gauge_gradients
from strainsight.placement.riccati import close_loop
from strainsight.placement.scenario import Aggregate, Pool, refined, weighted_trace


@dataclass(frozen=True)
class Cut:
    """f_s(v) ≥ offset_s + slope_s·v for all gauge weights v ≥ 0: f_s = tr(W P_s), touched at the weights it was made at.

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

        f(v) ≥ f(w) + ∇f·(v − w),   ∂f/∂w_g = −h_g P X P h_gᵀ/r_g,   G = Σ_g w_g h_gᵀh_g/r_g

    A plane bounds f everywhere because f is convex (`gauge_gradients`). last: covariances of weights nearby.
    """
    cost, slope, covariances = [], [], []
    for i, pool in enumerate(pools):
        rows = pool.rows * np.sqrt(w)[:, None]
        if not detects(pool, rows):
            return None
        G = rows.T @ rows
        try:
            P = refined(pool, G, None if last is None else last[i])
        except NumericalError:
            return None
        cost.append(weighted_trace(pool, P))
        slope.append(-gauge_gradients(close_loop(pool.scenario.F, G, P), pool.rows, pool.scenario.weight))
        covariances.append(P)
    f, g = np.array(cost), np.array(slope)
    return Cut(f - g @ w, g, f, tuple(covariances))


def detects(pool: Pool, rows: np.ndarray) -> bool:
    """Whether rows h/√r (m, n*) detect every unknown."""
    return undetectable_directions(pool.scenario.F, rows, pool.modes).shape[1] == 0


def lowest(cuts: Sequence[Cut], inside: np.ndarray, free: np.ndarray, count: int, aggregate: Aggregate) -> Bound:
    """Least aggregate of the cuts over all sets of `count` gauges of inside or free that hold all of inside.

        min agg_s(t_s),   t_s ≥ offset_ks + slope_ks·v,   0 ≤ v ≤ 1,   Σ v = count,   v = 1 inside, 0 elsewhere

    The linear program only chooses the multipliers μ_ks of the cuts (Σ_k μ_ks = 1/scenarios for the mean, Σ μ = 1 for
    the worst); with any such μ, Σ μ (offset + slope·v) bounds the aggregate, and its least over v is had by sorting: the
    bound does not depend on the tolerances of the program. inside, free (pool,) bool, at least one way to choose.
    """
    places, left = np.flatnonzero(free), count - int(inside.sum())
    scenarios = len(cuts[0].offset)
    offset = np.array([c.offset + c.slope[:, inside].sum(axis=1) for c in cuts])
    slope = np.array([c.slope[:, places] for c in cuts])
    unit = max(float(np.abs(offset).max()), np.finfo(float).tiny)
    levels = np.tile(np.eye(scenarios), (len(cuts), 1)) if aggregate == "mean" else np.ones((offset.size, 1))
    programme = linprog(
        np.concatenate([np.zeros(len(places)), np.full(levels.shape[1], 1 / levels.shape[1])]),
        A_ub=np.hstack([slope.reshape(offset.size, -1) / unit, -levels]),
        b_ub=-offset.ravel() / unit,
        A_eq=np.concatenate([np.ones(len(places)), np.zeros(levels.shape[1])])[None, :],
        b_eq=[left],
        bounds=[(0, 1)] * len(places) + [(None, None)] * levels.shape[1],
        method="highs-ds",
    )
    mu = np.zeros(offset.shape)
    mu[-1] = 1.0
    if programme.status == 0:
        mu = np.maximum(-programme.ineqlin.marginals, 0.0).reshape(offset.shape) + 1e-15 * mu
    mu /= scenarios * mu.sum(axis=0) if aggregate == "mean" else mu.sum()
    steep = np.tensordot(mu, slope, axes=2)
    order = np.argsort(steep, kind="stable")
    taken, others = order[:left], order[left:]
    reduced = np.full(len(free), np.inf)
    if left and len(others):
        reduced[places[taken]] = steep[others[0]] - steep[taken]
        reduced[places[others]] = steep[others] - steep[taken[-1]]
    weights = inside.astype(float)
    if programme.status == 0:
        weights[places] = np.clip(programme.x[: len(places)], 0, 1)
    else:
        weights[places[taken]] = 1.0
    chosen = np.zeros(len(free), dtype=bool)
    chosen[places[taken]] = True
    value = float((mu * offset).sum() + steep[taken].sum())
    return Bound(value, weights, chosen, reduced, mu.sum(axis=1) > 1e-12)
