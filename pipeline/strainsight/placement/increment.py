"""Change of the steady covariance by one gauge more or less, to full relative accuracy, and lower bounds of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from strainsight.errors import NumericalError
from strainsight.loads.observability import MarginalModes, undetectable_directions
from strainsight.placement.riccati import (
    Loop,
    adjoint_lyapunov,
    close_loop,
    information,
    lyapunov,
    lyapunov_in_schur,
    solve_anew,
)

CONVERGED = 1e-13
QUADRATIC, ROUNDING = 1e-4, 1e-9
"""Relative size of a Newton step from which convergence is quadratic, and that of the rounding at which its result is
accepted. The difference of two P has fewer digits: on the lug Newton's D is within 2e-10 of D refined in long doubles, the
difference is off by 7e-9 to 3e-8."""
DOUBT = 1e-10
"""Relative uncertainty of the slopes of a bound, of their largest parts: rounding amplified by the loop."""


@dataclass(frozen=True)
class Slopes:
    """Common data of the lower bounds of all removals from one loop. factor L (n, n): L Lᵀ = P X P; X (n, n): Aᵀ X + X A + W = 0
    in the Schur coordinates of the loop; G there, as one matrix (n, n) or two factors."""

    loop: Loop
    factor: np.ndarray
    X: np.ndarray
    G: tuple[np.ndarray, ...]


def slopes(loop: Loop, W: np.ndarray) -> Slopes:
    """The `Slopes` of tr(W P) at a loop; W (n, n) positive semidefinite: gradient of a metric."""
    X = adjoint_lyapunov(loop, W)
    # squares of a factor keep the digits of a small φ that the products of P X P lose
    values, vectors = np.linalg.eigh(X)
    factor = loop.P @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    return Slopes(loop, factor, loop.U.T @ X @ loop.U, _in_schur(loop))


def gauge_gradients(loop: Loop, rows: np.ndarray, W: np.ndarray) -> np.ndarray:
    """−∂tr(W P)/∂w_g for all gauges at once; at w_g = 1 the least rise of tr(W P) when the gauge is removed.

        Aᵀ X + X A + W = 0,     Δ_g ≥ φ_g = tr(h_g P X P h_gᵀ),   h_g at unit noise

    A lower bound of the rise because tr(W P) is convex in the gauge weights: for a fixed estimator the error is a
    quadratic plus Σ r ∫m²/w, jointly convex in the estimator m and w, and its least over m stays convex in w. With W the
    gradient of a `Metric` it is the slope of the metric, which is convex in them, too. All channels of a gauge have its one
    weight. rows (m, c, n): h_g/√r_g; W (n, n) positive semidefinite. Returns (m,) in the unit of tr(W P)."""
    return squares((rows.reshape(-1, rows.shape[-1]) @ slopes(loop, W).factor).reshape(rows.shape))


def least_increments(loop: Loop, B: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What every gauge adds at least to the covariance of some states when it leaves, and by how much that may be wrong.

        D ≥ Y,   A Y + Y Aᵀ + B Bᵀ = 0,   B = P hᵀ;     Yᵢⱼ = tr(Bᵀ Xᵢⱼ B),   Aᵀ Xᵢⱼ + Xᵢⱼ A + ½(eᵢeⱼᵀ + eⱼeᵢᵀ) = 0

    As a matrix, because vᵀP v is convex in the gauge weights for every v, as tr(W P) is (`gauge_gradients`), and Y is the slope
    of P. One Xᵢⱼ serves all gauges. B (m, c, n): h P U of the gauges at unit noise, U of the loop's Schur form; at (k,): the
    states. Returns Y (m, k, k) and the largest error of an eigenvalue (m,)."""
    m, c, n = B.shape
    flat, increments, doubt = B.reshape(-1, n), np.empty((m, len(at), len(at))), np.zeros(m)
    length = np.sqrt(squares(B))
    for i, row in enumerate(at):
        for j, column in enumerate(at[: i + 1]):
            unit = np.zeros((n, n))
            unit[row, column] += 0.5
            unit[column, row] += 0.5
            X = loop.U.T @ adjoint_lyapunov(loop, unit) @ loop.U
            BX = (flat @ X).reshape(m, c, n)
            increments[:, i, j] = increments[:, j, i] = np.einsum("mcn,mcn->m", B, BX)
            doubt = np.maximum(doubt, np.sqrt(squares(BX)) * length)
    return increments, DOUBT * len(at) * doubt


def squares(rows: np.ndarray) -> np.ndarray:
    """Sum of squares of each block (m, c, n)."""
    flat = rows.reshape(len(rows), -1)
    return np.asarray(np.einsum("ij,ij->i", flat, flat))


def sharper_bound(at: Slopes, block: np.ndarray) -> float:
    """Least rise of tr(W P) when the gauge `block` = h/√r leaves, from the slope and the curvature in its weight.

        Δ ≥ a₁² / (a₁ − a₂),   a₁ = tr(BᵀX B),   a₂ = 2 tr(BᵀX Y hᵀ) − tr(X Y G Y),   A Y + Y Aᵀ + B Bᵀ = 0,   B = P hᵀ

    As a function of the one weight w of its channels, f = tr(W P) is a least over their impulse responses m of a
    quadratic plus r ∫m²/w, hence f = f∞ + ∫ dν(s)/(s + w) with ν ≥ 0 on s ≥ 0. With x = 1/(s + 1):
    f(1 − t) = f(1) + a₁ t + a₂ t² + …,   aₖ = ∫ xᵏ⁺¹ dν, and f(0) − f(1) = ∫ x²/(1 − x) dν, where Jensen's inequality
    replaces x by its mean a₂/a₁.
    a₂ is lessened by what rounding may add to it. Block (c, n). Returns the bound in the unit of tr(W P)."""
    loop = at.loop
    h = loop.U.T @ block.T
    b = loop.U.T @ (loop.P @ block.T)
    Y = lyapunov_in_schur(loop, b @ b.T)
    Xb, Yh, GY = at.X @ b, Y @ h, _times(at.G, Y)
    a1 = float(np.vdot(b, Xb))
    XY = at.X @ Y
    a2 = 2 * float(np.vdot(Xb, Yh)) - float(np.sum(XY * GY.T))
    doubt = DOUBT * (2 * np.linalg.norm(Xb) * np.linalg.norm(Yh) + np.linalg.norm(XY) * np.linalg.norm(GY))
    a2 -= float(doubt)
    if not 0 < a2 < a1:
        return max(a1, 0.0)
    return a1 * a1 / (a1 - a2)


def removal(
    F: np.ndarray, Q: np.ndarray, loop: Loop, block: np.ndarray, rest: Callable[[], np.ndarray], modes: MarginalModes
) -> np.ndarray | None:
    """D = P' − P where the gauge `block` = h/√r leaves and `rest()` = H'/√r' remains; None where that cannot detect.

        A D + D Aᵀ + (B + C)(B + C)ᵀ − D G D = 0,     B = P hᵀ,   C = D hᵀ   of the block h at unit noise

    the same as (A + B h) D + D (A + B h)ᵀ + B Bᵀ − D (G − hᵀh) D = 0. F, Q, D (n, n); block (c, n); rest: (any, n), or by gauges,
    asked for only where the loop at hand does not carry over to the new one; modes: the marginal ones of F."""
    D = _fixed_point(loop, block, 1.0)
    if D is not None:
        return D
    # summed anew: a gauge that outweighs the rest would leave its rounding behind
    remaining = rest().reshape(-1, len(F))
    G = information(remaining)
    # a stable loop proves detectability; an unstable one proves nothing
    without = close_loop(F, G, loop.P)
    doubtful = without.abscissa > -1e-9 * np.linalg.norm(loop.A)
    if doubtful and undetectable_directions(F, remaining, modes).shape[1]:
        return None
    if not doubtful:
        D = _newton(loop, block, 1.0, without)
        if D is not None:
            return D
    return solve_anew(F, Q, G) - loop.P


def addition(F: np.ndarray, Q: np.ndarray, loop: Loop, block: np.ndarray) -> np.ndarray:
    """D = P' − P where a gauge `block` = h/√r is added: A D + D Aᵀ − (B + C)(B + C)ᵀ − D G D = 0; as in `removal`."""
    D = _fixed_point(loop, block, -1.0)
    if D is not None:
        return D
    # Kleinman: the old gain with zero for the new gauge stabilises, so the next loop F − P G' does
    G = loop.information.with_rows(block)
    D = _newton(loop, block, -1.0, close_loop(F, G, loop.P))
    return D if D is not None else solve_anew(F, Q, G) - loop.P


def _fixed_point(loop: Loop, block: np.ndarray, sign: float) -> np.ndarray | None:
    """D by repeated Lyapunov solves with the loop at hand; None where they do not contract by 0.3. Where they contract, 𝓛_A +
    t(𝓛_A' − 𝓛_A) is regular for all 0 ≤ t ≤ 1, so no eigenvalue of the loop crosses the axis on the way from A to A': the
    limit is the stabilising solution."""
    U = loop.U
    h, b, G = U.T @ block.T, U.T @ (loop.P @ block.T), _in_schur(loop)
    D = lyapunov_in_schur(loop, sign * (b @ b.T))
    change = np.linalg.norm(D)
    for _ in range(20):
        e = b + D @ h
        new = lyapunov_in_schur(loop, sign * (e @ e.T) - _squared(G, D))
        before, change = change, np.linalg.norm(new - D)
        D = new
        if change <= CONVERGED * np.linalg.norm(D):
            return U @ D @ U.T
        if change > 0.3 * before:
            # rounding has been reached, or the iteration is no contraction
            return U @ D @ U.T if change <= 1e-11 * np.linalg.norm(D) else None
    return None


def _newton(loop: Loop, block: np.ndarray, sign: float, start: Loop) -> np.ndarray | None:
    """D by Newton-Kleinman from D = 0, `start` being the loop F − P G'; None where it does not converge."""
    b = loop.P @ block.T
    source = sign * (b @ b.T)
    G = (start.G,) if start.factor is None else (start.factor.T, start.factor)
    D = np.zeros_like(loop.P)
    stage = start
    change: np.floating | float = np.inf
    for _ in range(30):
        if not stage.stable:
            return None
        try:
            new = lyapunov(stage, source + _squared(G, D))
        except NumericalError:
            return None
        before, change = change, np.linalg.norm(new - D)
        D = new
        size = np.linalg.norm(D)
        if change <= CONVERGED * size:
            return D
        if change > 0.5 * before and before <= QUADRATIC * size:
            # rounding has been reached: more steps change its sign, not its size
            return D if change <= ROUNDING * size else None
        stage = close_loop(start.A, start.information, D)
    return None


def _in_schur(loop: Loop) -> tuple[np.ndarray, ...]:
    """Uᵀ G U, or its factors Uᵀ Rᵀ, R U if the sum lacks digits."""
    if loop.factor is None:
        return (loop.U.T @ loop.G @ loop.U,)
    RU = loop.factor @ loop.U
    return RU.T, RU


def _times(G: tuple[np.ndarray, ...], Y: np.ndarray) -> np.ndarray:
    """G Y, from right to left."""
    for part in reversed(G):
        Y = part @ Y
    return Y


def _squared(G: tuple[np.ndarray, ...], D: np.ndarray) -> np.ndarray:
    """D G D, D symmetric, the factors first multiplied by D."""
    if len(G) == 1:
        return D @ G[0] @ D
    B = D @ G[0]
    return B @ B.T
