"""What one gauge more or less changes in the steady covariance, to full relative accuracy."""

from __future__ import annotations

import numpy as np

from strainsight.augmentation.observability import MarginalModes, undetectable_directions
from strainsight.errors import NumericalError
from strainsight.placement.riccati import Loop, adjoint_lyapunov, close_loop, lyapunov, solve_anew

CONVERGED = 1e-13


def gauge_gradients(loop: Loop, rows: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """−∂tr(W P)/∂w_g for all gauges at once; at w_g = 1 the least rise of tr(W P) when the gauge is removed.

        Aᵀ X + X A + W = 0,     Δ_g ≥ h_g P X P h_gᵀ / r_g

    A lower bound of the rise because tr(W P) is convex in the gauge weights: for a fixed estimator the error is a
    quadratic plus Σ r ∫m²/w, jointly convex in the estimator m and w, and its least over m stays convex in w.
    rows (m, n): h_g/√r_g; weight (n,): diagonal of W. Returns (m,) in the unit of tr(W P).
    """
    X = adjoint_lyapunov(loop, np.diag(weight))
    PH = loop.P @ rows.T
    return np.sum(PH * (X @ PH), axis=0)


def removal(
    F: np.ndarray, Q: np.ndarray, loop: Loop, row: np.ndarray, rest: np.ndarray, modes: MarginalModes
) -> np.ndarray | None:
    """D = P' − P where the gauge `row` = h/√r leaves and `rest` = H'/√r' remains; None where `rest` cannot detect.

        A D + D Aᵀ + (b + c)(b + c)ᵀ − D G D = 0,     b = P hᵀ/√r,   c = D hᵀ/√r

    the same as (A + b h/√r) D + D (…)ᵀ + b bᵀ − D (G − hᵀh/r) D = 0. F, Q, D (n, n); row (n,); rest (m − 1, n); modes:
    the marginal ones of F.
    """
    D = _fixed_point(loop, row, 1.0)
    if D is not None:
        return D
    # a stable loop proves detectability; an unstable one proves nothing
    G = loop.G - np.outer(row, row)
    without = close_loop(F, G, loop.P)
    doubtful = without.abscissa > -1e-9 * np.linalg.norm(loop.A)
    if doubtful and undetectable_directions(F, rest, modes).shape[1]:
        return None
    if not doubtful:
        D = _newton(loop, row, 1.0, without)
        if D is not None:
            return D
    return solve_anew(F, Q, G) - loop.P


def addition(F: np.ndarray, Q: np.ndarray, loop: Loop, row: np.ndarray) -> np.ndarray:
    """D = P' − P where a gauge `row` = h/√r is added: A D + D Aᵀ − (b + c)(b + c)ᵀ − D G D = 0; as in `removal`."""
    D = _fixed_point(loop, row, -1.0)
    if D is not None:
        return D
    # Kleinman: the old gain with zero for the new gauge stabilises, so the next loop F − P G' does
    G = loop.G + np.outer(row, row)
    D = _newton(loop, row, -1.0, close_loop(F, G, loop.P))
    return D if D is not None else solve_anew(F, Q, G) - loop.P


def _fixed_point(loop: Loop, row: np.ndarray, sign: float) -> np.ndarray | None:
    """D by repeated Lyapunov solves with the loop at hand; None where they do not contract by 0.3.

    Where they contract, 𝓛_A + t(𝓛_A' − 𝓛_A) is regular for all 0 ≤ t ≤ 1, so no eigenvalue of the loop crosses the
    axis on the way from A to A': the limit is the stabilising solution.
    """
    b = loop.P @ row
    D = lyapunov(loop, sign * np.outer(b, b))
    change = np.linalg.norm(D)
    for _ in range(20):
        e = b + D @ row
        new = lyapunov(loop, sign * np.outer(e, e) - D @ loop.G @ D)
        before, change = change, np.linalg.norm(new - D)
        D = new
        if change <= CONVERGED * np.linalg.norm(D):
            return D
        if change > 0.3 * before:
            # rounding has been reached, or the iteration is no contraction
            return D if change <= 1e-11 * np.linalg.norm(D) else None
    return None


def _newton(loop: Loop, row: np.ndarray, sign: float, start: Loop) -> np.ndarray | None:
    """D by Newton-Kleinman from D = 0, `start` being the loop F − P G'; None where it does not converge."""
    b = loop.P @ row
    source = sign * np.outer(b, b)
    G = start.G
    D = np.zeros_like(loop.P)
    stage = start
    change: np.floating | float = np.inf
    for _ in range(30):
        if not stage.stable:
            return None
        try:
            new = lyapunov(stage, source + D @ G @ D)
        except NumericalError:
            return None
        before, change = change, np.linalg.norm(new - D)
        D = new
        if change <= CONVERGED * np.linalg.norm(D) or (change > 0.5 * before and change <= 1e-10 * np.linalg.norm(D)):
            return D
        stage = close_loop(start.A, G, D)
    return None
