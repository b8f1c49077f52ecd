"""The smoother of filters whose gains consider constants that nobody estimates, with the variance that it really has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.estimation.parallel_filters import LinearModels, States, advance, filters_of
from strainsight.estimation.update import symmetric, transposed

SAID = 1e-8


def consider_smoothed(
    models: LinearModels,
    start: tuple[np.ndarray, np.ndarray, np.ndarray],
    known: np.ndarray,
    known_end: np.ndarray,
    measurement: np.ndarray,
    noise: np.ndarray,
) -> States:
    """x (B, T + 1, n) by all samples, P of what no constant explains of its error and V what one of each adds to it.

    The filter's error is w + V ν with gains K of Schmidt (`advance`), P the covariance of w, and its innovations are
    e = −H w⁻ + ε ν + noise, of covariance S. Going back from λ = 0, as Bierman does with gains of Kalman, for which C = P:

        x̂ˢ = x̂ + C λ,     λ⁻ = Jᵀλ + HᵀS⁻¹e,   J = I − K H,     λ ← Aᵀλ⁻

    λ is L w + N ν + u, u of the noises beyond, independent of w and of covariance U, and so

        L⁻ = JᵀL J − HᵀS⁻¹H,     N⁻ = JᵀN + HᵀS⁻¹ε,     U⁻ = JᵀU J + L⁻Q L⁻ᵀ + (JᵀL K + HᵀS⁻¹) R (…)ᵀ
        L ← AᵀL⁻A,   N ← AᵀN⁻,   U ← AᵀU⁻A,     Pˢ = (I + C L) P (I + C L)ᵀ + C U Cᵀ,   Vˢ = V + C N

    whatever the gains are. C = −(P Lᵀ + V Nᵀ)(L P Lᵀ + N Nᵀ + U)⁻¹ is the one of least variance with ν at its σ.
    start: x (B, n), P (n, n), V (B, d, n) at t = 0; known (T, p), known_end (T, p₁), measurement (T, m) NaN where missing, noise
    (T, m) variances.
    Source: Bierman, Fixed interval smoothing with discrete measurements, Int. J. Control 18 (1973).
    """
    filters = filters_of(models, *start, consider=True)
    first = filters.states
    first = States(*(getattr(first, name).copy() for name in ("x", "P", "V", "nu", "left")))
    steps, more = len(known), np.zeros(measurement.shape[1])
    kept = advance(models, filters, known, known_end, measurement, noise, more, keep=True).states
    x, P, V = (np.concatenate([getattr(first, f), getattr(kept, f)], axis=1) for f in ("x", "P", "V"))
    A, AT, (B, d, n), e = models.A, transposed(models.A), start[2].shape, models.A_nu.shape[1]
    adjoint, N, L, U = np.zeros((B, n)), np.zeros((B, d, n)), np.zeros((B, n, n)), np.zeros((B, n, n))
    for t in range(steps - 1, -1, -1):
        own, spread, slope = x[:, t], P[:, t], V[:, t]
        ahead = (A @ own[..., None])[..., 0] + models.G @ known[t]
        slope_ahead = slope @ AT
        slope_ahead[:, :e] -= (models.A_nu @ own[:, None, :, None])[..., 0] + models.G_nu @ known[t]
        update = _update(models, ahead, A @ spread @ AT + models.Q, slope_ahead, known_end[t], measurement[t], noise[t])
        K, H, rows = update.K, update.H, update.rows
        J = np.eye(n) - K @ H
        by_noise = transposed(J) @ L @ K + rows
        L = transposed(J) @ L @ J - rows @ H
        U = transposed(J) @ U @ J + L @ models.Q @ transposed(L) + (by_noise * update.R) @ transposed(by_noise)
        N = (N @ J + transposed(rows @ update.slope)) @ A
        adjoint = ((adjoint[:, None] @ J + transposed(rows @ update.innovation[..., None])) @ A)[:, 0]
        L, U = AT @ L @ A, AT @ U @ A
        C = _gain(spread, slope, L, N, U)
        x[:, t] += (C @ adjoint[..., None])[..., 0]
        V[:, t] += N @ transposed(C)
        left = np.eye(n) + C @ L
        P[:, t] = symmetric(left @ spread @ transposed(left) + C @ U @ transposed(C))
    return States(x, P, V, first.nu, first.left)


def _gain(P: np.ndarray, V: np.ndarray, L: np.ndarray, N: np.ndarray, U: np.ndarray) -> np.ndarray:
    """C (B, n, n), by way of Fᵀλ with F Fᵀ = P + V Vᵀ: its covariance is the share of the variance that the samples ahead explain
    in each direction, and less than SAID of it is nothing."""
    whole = P + transposed(V) @ V
    std = np.sqrt(np.diagonal(whole, axis1=1, axis2=2))
    std = np.where(std > 0, std, 1.0)
    share, axes = np.linalg.eigh(whole / (std[:, :, None] * std[:, None]))
    F = std[:, :, None] * axes * np.sqrt(np.maximum(share, 0.0))[:, None]
    said = transposed(F) @ (L @ P @ transposed(L) + transposed(N) @ N + U) @ F + SAID * np.eye(P.shape[1])
    cross = (P @ transposed(L) + transposed(V) @ N) @ F
    return -transposed(np.linalg.solve(symmetric(said), transposed(cross))) @ transposed(F)


@dataclass(frozen=True)
class _Update:
    """By the k channels that measured: K (B, n, k) as `advance` takes it, rows H (B, k, n), R (k,), innovation (B, k), slope ε
    (B, k, d) of it in ν, and rows HᵀS⁻¹ (B, n, k)."""

    K: np.ndarray
    H: np.ndarray
    R: np.ndarray
    innovation: np.ndarray
    slope: np.ndarray
    rows: np.ndarray


def _update(
    models: LinearModels, x: np.ndarray, P: np.ndarray, V: np.ndarray, known: np.ndarray, y: np.ndarray, R: np.ndarray
) -> _Update:
    """x (B, n), P and V as predicted."""
    there = np.isfinite(y)
    H = models.H[:, there]
    sensed = (models.D[:, there] @ x[:, None, :, None])[..., 0] + models.E[:, there] @ known + models.offset[:, there]
    slope = transposed(sensed - V @ transposed(H))
    S = H @ P @ transposed(H) + slope @ transposed(slope) + np.diag(R[there])
    K = transposed(np.linalg.solve(S, H @ P - slope @ V))
    innovation = y[there] - (H @ x[..., None])[..., 0] - models.F[:, there] @ known
    return _Update(K, H, R[there], innovation, slope, transposed(np.linalg.solve(S, H)))
