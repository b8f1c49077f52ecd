"""Change of the steady covariance by one gauge more or less, to full relative accuracy, and lower bounds of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from strainsight.errors import NumericalError
from strainsight.loads.observability import MarginalModes, undetectable_directions
from strainsight.placement.riccati import Loop, close_loop, information, lyapunov, solve_anew
from strainsight.placement.scenario import Pool

CONVERGED = 1e-13
QUADRATIC, ROUNDING = 1e-4, 1e-9
"""Relative size of a Newton step from which convergence is quadratic, and that of the rounding at which its result is
accepted. The difference of two P has fewer digits: on the lug Newton's D is within 2e-10 of D refined in long doubles, the
difference is off by 7e-9 to 3e-8."""
CONDITION = 1e3
"""Largest ‖V‖‖V⁻¹‖ of the modes V of a loop, of unit length, in whose coordinates increments are computed."""
DOUBT = 1e-10
"""Relative uncertainty of the slopes of a bound, of their largest parts: rounding amplified by the loop."""


class Modes:
    """The loops of all scenarios in coordinates of their modes, where a Lyapunov equation is solved entry by entry:

        A = V Λ V⁻¹,     Λ Y + Y Λᴴ + S = 0:   Yᵢⱼ = −Sᵢⱼ/(λᵢ + λ̄ⱼ)

    Padded to the same number of states n by some that decay. usable (s,) bool: whether these coordinates have the digits."""

    def __init__(self, loops: Sequence[Loop]):
        self.loops = loops
        self.size = max(len(loop.A) for loop in loops)
        A, self.P, G = (self._padded(X) for X in zip(*((loop.A, loop.P, loop.G) for loop in loops), strict=True))
        for each, loop in zip(A, loops, strict=True):
            each[range(len(loop.A), self.size), range(len(loop.A), self.size)] = -1.0
        value, self.V = np.linalg.eig(A)
        try:
            self.inverse = np.linalg.inv(self.V)
        except np.linalg.LinAlgError:
            self.inverse = np.full_like(self.V, np.inf)
        condition = _norm(self.V) * _norm(self.inverse)
        summed = [loop.factor is None for loop in loops]
        self.usable = (condition <= CONDITION * self.size) & (value.real < 0).all(axis=1) & summed
        self.inverse[~self.usable] = 0.0
        self.solution = -1 / np.where(self.usable[:, None, None], value[:, :, None] + value[:, None, :].conj(), 1.0)
        self.G = _adjoint(self.V) @ G @ self.V

    def rows(self, blocks: Sequence[np.ndarray]) -> np.ndarray:
        """Gauges (..., n) of each scenario, padded, as (s, ..., n)."""
        padded = np.zeros((len(blocks), *blocks[0].shape[:-1], self.size))
        for h, into in zip(blocks, padded, strict=True):
            into[..., : h.shape[-1]] = h
        return padded

    def _padded(self, matrices: Sequence[np.ndarray]) -> np.ndarray:
        padded = np.zeros((len(matrices), self.size, self.size))
        for X, into in zip(matrices, padded, strict=True):
            into[: len(X), : len(X)] = X
        return padded

    def slopes(self, W: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Factors L (s, n, n), L Lᵀ = P X P with Aᵀ X + X A + W = 0, and VᴴX V; W (n, n) positive semidefinite: gradients of the
        metric, for the lower bounds of all removals from the same loops."""
        inside = self.solution.conj() * (_adjoint(self.V) @ self._padded(W) @ self.V)
        X = (_adjoint(self.inverse) @ inside @ self.inverse).real
        for i in np.flatnonzero(~self.usable).tolist():
            X[i, : len(W[i]), : len(W[i])] = lyapunov(self.loops[i], W[i], adjoint=True)
        # squares of a factor keep the digits of a small φ that the products of P X P lose
        values, vectors = np.linalg.eigh(0.5 * (X + X.swapaxes(1, 2)))
        return self.P @ (vectors * np.sqrt(np.maximum(values, 0.0))[:, None]), inside

    def sharper_bounds(self, X: np.ndarray, blocks: np.ndarray) -> np.ndarray:
        """Least rises (k, s) of tr(W P) when the gauges h/√r, blocks (k, s, c, n), leave, from the slope and the curvature in
        their weight; X (s, n, n) of `slopes`; 0 where the modes are not usable.

            Δ ≥ a₁² / (a₁ − a₂),   a₁ = tr(BᵀX B),   a₂ = 2 tr(BᵀX Y hᵀ) − tr(X Y G Y),   A Y + Y Aᵀ + B Bᵀ = 0,   B = P hᵀ

        As a function of the one weight w of its channels, f = tr(W P) is a least over their impulse responses m of a
        quadratic plus r ∫m²/w, hence f = f∞ + ∫ dν(s)/(s + w) with ν ≥ 0 on s ≥ 0. With x = 1/(s + 1):
        f(1 − t) = f(1) + a₁ t + a₂ t² + …,   aₖ = ∫ xᵏ⁺¹ dν, and f(0) − f(1) = ∫ x²/(1 − x) dν, where Jensen's inequality
        replaces x by its mean a₂/a₁. a₂ is lessened by what rounding may add to it."""
        h, b = self._gauge(blocks)
        Y = self.solution * (b @ _adjoint(b))
        Xb, Yh, XY, GY = X @ b, Y @ h, X @ Y, self.G @ Y
        a1 = _trace(b, Xb)
        doubt = 2 * _norm(Xb) * _norm(Yh) + _norm(XY) * _norm(GY)
        a2 = 2 * _trace(Xb, Yh) - _trace(_adjoint(XY), GY) - DOUBT * doubt
        sharp = np.divide(a1 * a1, a1 - a2, out=a1.copy(), where=(a2 > 0) & (a2 < a1))
        return np.where(self.usable, np.maximum(sharp, 0.0), 0.0)

    def increments(self, blocks: np.ndarray, sign: float) -> tuple[np.ndarray, np.ndarray]:
        """D (s, n, n) of `removal` (sign 1) or `addition` (−1) of the gauges h/√r, blocks (s, c, n), by repeated Lyapunov solves,
        and where (s,) they contract by 0.3. There 𝓛_A + t(𝓛_A' − 𝓛_A) is regular for all 0 ≤ t ≤ 1, so no eigenvalue of the loop
        crosses the axis on the way from A to A': the limit is the stabilising solution."""
        h, b = self._gauge(blocks)
        D = self.solution * (sign * (b @ _adjoint(b)))
        change, open_, solved = _norm(D), self.usable.copy(), np.zeros_like(self.usable)
        for _ in range(20):
            e = b + D @ h
            new = self.solution * (sign * (e @ _adjoint(e)) - D @ self.G @ D)
            before, change = change, _norm(new - D)
            D = np.where(open_[:, None, None], new, D)
            size = _norm(D)
            # rounding has been reached, or the iteration is no contraction; else the next change is less by as much again
            stalled = change > 0.3 * before
            converged = (change <= CONVERGED * size) | (~stalled & (change**2 <= CONVERGED * size * before))
            solved |= open_ & (converged | (stalled & (change <= 1e-11 * size)))
            open_ &= ~(solved | stalled)
            if not open_.any():
                break
        return (self.V @ D @ _adjoint(self.V)).real, solved

    def _gauge(self, blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(h V)ᴴ and V⁻¹B, B = P hᵀ, of gauges h (..., s, c, n)."""
        return _adjoint(blocks @ self.V), self.inverse @ (self.P @ blocks.swapaxes(-1, -2))


def gauge_gradients(loops: Sequence[Loop], rows: Sequence[np.ndarray], W: Sequence[np.ndarray]) -> np.ndarray:
    """−∂tr(W P)/∂w_g for all gauges at once; at w_g = 1 the least rise of tr(W P) when the gauge is removed.

        Aᵀ X + X A + W = 0,     Δ_g ≥ φ_g = tr(h_g P X P h_gᵀ),   h_g at unit noise

    A lower bound of the rise because tr(W P) is convex in the gauge weights: for a fixed estimator the error is a
    quadratic plus Σ r ∫m²/w, jointly convex in the estimator m and w, and its least over m stays convex in w. With W the
    gradient of a `Metric` it is the slope of the metric, which is convex in them, too. All channels of a gauge have its one
    weight. For each scenario its loop, rows (m, c, n): h_g/√r_g, and W (n, n) positive semidefinite. Returns (s, m) in the
    unit of tr(W P)."""
    return gradients_by(Modes(loops).slopes(W)[0], rows)


def gradients_by(factor: np.ndarray, rows: Sequence[np.ndarray]) -> np.ndarray:
    """`gauge_gradients` from the factors L (s, n, n) of `Modes.slopes`."""
    parts = zip(factor, rows, strict=True)
    return np.array(
        [squares((h.reshape(-1, h.shape[2]) @ L[: h.shape[2]]).reshape(*h.shape[:2], -1)) for L, h in parts]
    )


def least_increments(loop: Loop, B: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What every gauge adds at least to the covariance of some states when it leaves, and by how much that may be wrong.

        D ≥ Y,   A Y + Y Aᵀ + B Bᵀ = 0,   B = P hᵀ;     Yᵢⱼ = tr(Bᵀ Xᵢⱼ B),   Aᵀ Xᵢⱼ + Xᵢⱼ A + ½(eᵢeⱼᵀ + eⱼeᵢᵀ) = 0

    As a matrix, because vᵀP v is convex in the gauge weights for every v, as tr(W P) is (`gauge_gradients`), and Y is the slope
    of P. One Xᵢⱼ serves all gauges. B (m, c, n): h P of the gauges at unit noise; at (k,): the states. Returns Y (m, k, k) and
    the largest error of an eigenvalue (m,)."""
    m, c, n = B.shape
    flat, increments, doubt = B.reshape(-1, n), np.empty((m, len(at), len(at))), np.zeros(m)
    length = np.sqrt(squares(B))
    for i, row in enumerate(at):
        for j, column in enumerate(at[: i + 1]):
            unit = np.zeros((n, n))
            unit[row, column] += 0.5
            unit[column, row] += 0.5
            BX = (flat @ lyapunov(loop, unit, adjoint=True)).reshape(m, c, n)
            increments[:, i, j] = increments[:, j, i] = np.einsum("mcn,mcn->m", B, BX)
            doubt = np.maximum(doubt, np.sqrt(squares(BX)) * length)
    return increments, DOUBT * len(at) * doubt


def squares(rows: np.ndarray) -> np.ndarray:
    """Sum of squares of each block (m, c, n)."""
    flat = rows.reshape(len(rows), -1)
    return np.asarray(np.einsum("ij,ij->i", flat, flat))


def removals(
    pools: Sequence[Pool], modes: Modes, blocks: Sequence[np.ndarray], rest: Callable[[int], np.ndarray]
) -> list[np.ndarray] | None:
    """`removal` of a gauge from the loops of all scenarios, None where one cannot detect; blocks (c, n) and rest(i) of each."""
    increments, solved = modes.increments(modes.rows(blocks), 1.0)
    removed = []
    for i, (pool, loop) in enumerate(zip(pools, modes.loops, strict=True)):
        s, D = pool.scenario, increments[i]
        if not solved[i]:
            if (exact := removal(s.F, s.Q, loop, blocks[i], partial(rest, i), pool.modes)) is None:
                return None
            D = exact
        removed.append(D[: len(s.F), : len(s.F)])
    return removed


def additions(pools: Sequence[Pool], modes: Modes, blocks: Sequence[np.ndarray]) -> list[np.ndarray]:
    """`addition` of a gauge to the loops of all scenarios; blocks (c, n) of each."""
    increments, solved = modes.increments(modes.rows(blocks), -1.0)
    each = zip(pools, modes.loops, blocks, increments, solved, strict=True)
    return [
        D[: len(loop.A), : len(loop.A)] if good else addition(pool.scenario.F, pool.scenario.Q, loop, block)
        for pool, loop, block, D, good in each
    ]


def removal(
    F: np.ndarray, Q: np.ndarray, loop: Loop, block: np.ndarray, rest: Callable[[], np.ndarray], modes: MarginalModes
) -> np.ndarray | None:
    """D = P' − P where the gauge `block` = h/√r leaves and `rest()` = H'/√r' remains; None where that cannot detect.

        A D + D Aᵀ + (B + C)(B + C)ᵀ − D G D = 0,     B = P hᵀ,   C = D hᵀ   of the block h at unit noise

    the same as (A + B h) D + D (A + B h)ᵀ + B Bᵀ − D (G − hᵀh) D = 0. F, Q, D (n, n); block (c, n); rest: (any, n), or by gauges,
    asked for only where the loop at hand does not carry over to the new one; modes: the marginal ones of F."""
    # summed anew: a gauge that outweighs the rest would leave its rounding behind
    remaining = rest().reshape(-1, len(F))
    G = information(remaining)
    # a stable loop proves detectability; an unstable one proves nothing
    without = close_loop(F, G, loop.P)
    doubtful = without.abscissa > -1e-9 * np.linalg.norm(loop.A)
    if doubtful and undetectable_directions(F, remaining, modes).shape[1]:
        return None
    if not doubtful and (D := _newton(loop, block, 1.0, without)) is not None:
        return D
    return solve_anew(F, Q, G) - loop.P


def addition(F: np.ndarray, Q: np.ndarray, loop: Loop, block: np.ndarray) -> np.ndarray:
    """D = P' − P where a gauge `block` = h/√r is added: A D + D Aᵀ − (B + C)(B + C)ᵀ − D G D = 0; as in `removal`."""
    # Kleinman: the old gain with zero for the new gauge stabilises, so the next loop F − P G' does
    G = loop.information.with_rows(block)
    D = _newton(loop, block, -1.0, close_loop(F, G, loop.P))
    return D if D is not None else solve_anew(F, Q, G) - loop.P


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


def _squared(G: tuple[np.ndarray, ...], D: np.ndarray) -> np.ndarray:
    """D G D, D symmetric, the factors first multiplied by D."""
    if len(G) == 1:
        return D @ G[0] @ D
    B = D @ G[0]
    return B @ B.T


def _adjoint(X: np.ndarray) -> np.ndarray:
    return X.swapaxes(-1, -2).conj()


def _norm(X: np.ndarray) -> np.ndarray:
    """Frobenius norm of each matrix (..., n, k)."""
    parts = np.ascontiguousarray(X).view(float)
    return np.asarray(np.sqrt(np.einsum("...ij,...ij->...", parts, parts)))


def _trace(X: np.ndarray, Y: np.ndarray) -> np.ndarray:
    """Re tr(XᴴY) of each pair (..., n, k)."""
    return np.asarray(np.einsum("...ij,...ij->...", X.conj(), Y).real)
