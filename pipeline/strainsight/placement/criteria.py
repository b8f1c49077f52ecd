"""Layouts by other criteria of the same steady covariance: its determinant, or the worst-known combination of unknowns."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import partial
from typing import Literal

import numpy as np
from scipy.linalg import solve_triangular

from strainsight.augmentation.observability import undetectable_directions
from strainsight.errors import ConfigError, NumericalError
from strainsight.placement.choice import rest
from strainsight.placement.increment import removal, squares
from strainsight.placement.ordering import TIE, lowest_first
from strainsight.placement.remaining import Remaining
from strainsight.placement.riccati import Loop, adjoint_lyapunov, close_loop
from strainsight.placement.scenario import Pool, refined
from strainsight.placement.score import unknown_block

Criterion = Literal["log_determinant", "worst_eigenvalue"]

EVALUATED = 32
"""Most gauges evaluated exactly at one removal, beside those that cannot go: the bound settles a removal with 2 to 4 on
average and 27 at most in beam pools of 100 and 1000, so that the limit is felt only where very many gauges are next to
identical."""


def eliminate_by(
    pools: Sequence[Pool],
    keep: int,
    criterion: Criterion,
    unknown: np.ndarray,
    *,
    fixed: Collection[int] = (),
) -> np.ndarray | None:
    """Remove, again and again, the gauge that raises the mean over the scenarios of a criterion c(P_uu) least.

        c = ln det P_uu:  W = P_uu⁻¹, c' − c ≥ ln(1 + φ);    c = λ₁(P_uu):  W = v₁v₁ᵀ, c' − c ≥ φ;    φ = tr h P X P hᵀ

    with Aᵀ X + X A + W = 0 at the present covariance. P_uu rises by no less than its slope in the gauge's weight, for
    every combination of the unknowns, because tr(W P) is convex in it for any W ≥ 0; hence both bounds. Gauges are
    evaluated exactly in the order of their bound until it exceeds the best rise: the removal is then the least of all.
    `EVALUATED` of them are evaluated at most; where that ends a removal, it is the least of those and not of all.
    A greedy heuristic all the same, whose set need not be the best one: no removal is taken back.

    unknown (count,): indices of the unknowns in x*, whose units are those of λ₁; fixed: pool rows that stay.
    Returns `keep` pool rows, ascending, from which every unknown is detectable; None where this greedy way leads to
    none, which does not prove that there is none: every further removal would lose an unknown, or the covariance after
    one cannot be solved to accuracy. Raises ConfigError for an impossible `keep`.
    """
    count = len(pools[0].rows)
    if not max(1, len(fixed)) <= keep <= count:
        raise ConfigError(
            f"{keep} gauges are to be kept of a pool of {count} with {len(fixed)} fixed",
            remedy=f"keep between {max(1, len(fixed))} and {count}",
        )
    kept = _descend(pools, keep, criterion, unknown, fixed)
    if kept is None:
        # a removal that was free may have been of the only gauge that sees two directions at once
        needed = _cover(pools, fixed)
        kept = _descend(pools, keep, criterion, unknown, needed) if len(needed) <= keep else None
    return kept


def _descend(
    pools: Sequence[Pool], keep: int, criterion: Criterion, unknown: np.ndarray, fixed: Collection[int]
) -> np.ndarray | None:
    """The gauges (keep,) left in the end; None where every removal would lose an unknown before, or P becomes inaccurate."""
    left = Remaining(pools, fixed)
    try:
        loops = [close_loop(p.scenario.F, left.information(i), p.P) for i, p in enumerate(pools)]
        while left.count > keep:
            found = _least_missed(pools, loops, left, criterion, unknown)
            if found is None:
                return None
            at, increments = found
            left.remove(at)
            for i, (pool, D) in enumerate(zip(pools, increments, strict=True)):
                G = left.information(i)
                loops[i] = close_loop(pool.scenario.F, G, refined(pool, G, loops[i].P + D))
    except (NumericalError, np.linalg.LinAlgError):
        return None
    return left.gauges


def _least_missed(
    pools: Sequence[Pool], loops: Sequence[Loop], left: Remaining, criterion: Criterion, unknown: np.ndarray
) -> tuple[int, list[np.ndarray]] | None:
    """Place in `left` of the gauge to remove and D (n*, n*) of every scenario; None where none can go."""
    parts = [_bound(p, loop, left, i, criterion, unknown) for i, (p, loop) in enumerate(zip(pools, loops, strict=True))]
    bounds = np.where(left.movable, np.mean(parts, axis=0), np.inf)
    exact: dict[int, tuple[float, list[np.ndarray]]] = {}
    best = np.inf
    for at in lowest_first(bounds):
        if bounds[at] == np.inf or bounds[at] > best * (1 + TIE) or len(exact) == EVALUATED:
            break
        increments = _without(pools, loops, left, at)
        if increments is not None:
            rises = [_rise(p, l.P, D, criterion, unknown) for p, l, D in zip(pools, loops, increments, strict=True)]
            exact[at] = (float(np.mean(rises)), increments)
            best = min(best, exact[at][0])
    if not exact:
        return None
    at = min(place for place, (rise, _) in exact.items() if rise <= best + TIE * abs(best))
    return at, exact[at][1]


def _bound(
    pool: Pool, loop: Loop, left: Remaining, scenario: int, criterion: Criterion, unknown: np.ndarray
) -> np.ndarray:
    """Least rise of the criterion (m,) when each of the gauges `left` is removed."""
    block = unknown_block(pool, loop.P, unknown)
    if criterion == "log_determinant":
        inverse = solve_triangular(np.linalg.cholesky(block), np.eye(len(unknown)), lower=True)
        gradient = inverse.T @ inverse
    else:
        worst = np.linalg.eigh(block)[1][:, -1]
        gradient = np.outer(worst, worst)
    W = np.zeros_like(loop.P)
    units = pool.scale[unknown]
    W[np.ix_(unknown, unknown)] = gradient * np.outer(units, units)
    values, vectors = np.linalg.eigh(adjoint_lyapunov(loop, W))
    slope = squares(left.product(scenario, loop.P @ (vectors * np.sqrt(np.maximum(values, 0.0)))))
    return np.log1p(slope) if criterion == "log_determinant" else slope


def _rise(pool: Pool, P: np.ndarray, D: np.ndarray, criterion: Criterion, unknown: np.ndarray) -> float:
    """c(P + D) − c(P), from D and not as a difference: ln det(I + L⁻¹DL⁻ᵀ) with P_uu = L Lᵀ, or that of λ₁."""
    block, step = unknown_block(pool, P, unknown), unknown_block(pool, D, unknown)
    if criterion == "log_determinant":
        L = np.linalg.cholesky(block)
        inner = solve_triangular(L, solve_triangular(L, step, lower=True).T, lower=True)
        return float(np.log1p(np.linalg.eigvalsh(0.5 * (inner + inner.T))).sum())
    values, V = np.linalg.eigh(block)
    Z = V.T @ step @ V
    below = values[-1] - values[:-1]
    if len(below) and below[-1] < 4 * np.linalg.norm(Z):
        return float(np.linalg.eigvalsh(Z - np.diag(values[-1] - values))[-1])
    # μ = z₁₁ + zᵀ(μ + Δ − Z₂₂)⁻¹z keeps the digits of a rise far below the gap Δ to the other eigenvalues
    rise = Z[-1, -1]
    for _ in range(8):
        rise = Z[-1, -1] + Z[-1, :-1] @ np.linalg.solve(np.diag(rise + below) - Z[:-1, :-1], Z[:-1, -1])
    return float(rise)


def _without(pools: Sequence[Pool], loops: Sequence[Loop], left: Remaining, at: int) -> list[np.ndarray] | None:
    """D = P' − P of every scenario where the gauge at this place leaves; None where one loses an unknown or cannot be solved."""
    increments = []
    for pool, loop in zip(pools, loops, strict=True):
        s = pool.scenario
        try:
            D = removal(s.F, s.Q, loop, pool.rows[left.index[at]], partial(rest, pool, left, at), pool.modes)
        except NumericalError:
            D = None
        if D is None:
            return None
        increments.append(D)
    return increments


def _cover(pools: Sequence[Pool], fixed: Collection[int]) -> set[int]:
    """Few gauges, the fixed ones among them, that detect all: each the one that leaves the fewest directions lost."""
    chosen = sorted(fixed)
    while _lost(pools, chosen):
        others = np.setdiff1d(np.arange(len(pools[0].rows)), chosen)
        chosen.append(int(others[np.argmin([_lost(pools, [*chosen, int(g)]) for g in others])]))
    return set(chosen)


def _lost(pools: Sequence[Pool], gauges: Sequence[int]) -> int:
    chosen = np.asarray(gauges, dtype=int)
    return sum(undetectable_directions(p.scenario.F, p.stacked(chosen), p.modes).shape[1] for p in pools)
