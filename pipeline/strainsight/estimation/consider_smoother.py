"""The smoother of filters whose gains consider constants that nobody estimates, with the variance that it really has."""

from __future__ import annotations

import numpy as np

from strainsight.estimation.parallel_filters import LinearModels, States, advance, filters_of
from strainsight.estimation.update import transposed

RIDGE = 1e-12
"""On the diagonal of a correlation matrix before it is inverted: a motion that is known exactly has none."""


def consider_smoothed(
    models: LinearModels,
    start: tuple[np.ndarray, np.ndarray, np.ndarray],
    known: np.ndarray,
    known_end: np.ndarray,
    measurement: np.ndarray,
    noise: np.ndarray,
) -> States:
    """x (B, T + 1, n) by all samples, P of what no constant explains of its error and V what one of each adds to it.

    The filter's error is w + V ν with gains K of Schmidt (`advance`). Going back, by the best linear gain of the pair of
    instants with ν at its σ:

        x̂ˢ = x̂ + C(x̂ˢ⁺ − x̂⁻),     C = (P Aᵀ + V V⁻ᵀ)(P⁻ + V⁻V⁻ᵀ)⁻¹,     P⁻ = A P Aᵀ + Q,   V⁻ = A V − (A_ν x̂ + G_ν w)

    Neither gain is that of a Kalman filter, so the error is followed as it is: after the update of the next instant it is
    Mw⁺ + Nν + u, u of the noises beyond, independent of w⁺ and of covariance U, and so

        L = I + C(MJ − I)A,   Pˢ = L P Lᵀ + U',   Vˢ = V + C(N − V⁻),   J = I − K H
        U' = C((MJ − I)Q(MJ − I)ᵀ + U + M K R KᵀMᵀ)Cᵀ                       with M = L, N = Vˢ, U = U' for the step before

    which holds whatever the gains are. Without constants it is that of Rauch, Tung and Striebel.
    start: x (B, n), P (n, n), V (B, d, n) at t = 0; known (T, p), known_end (T, p₁), measurement (T, m) NaN where missing, noise
    (T, m) variances.
    """
    filters = filters_of(models, *start, consider=True)
    first = filters.states
    first = States(*(getattr(first, name).copy() for name in ("x", "P", "V", "nu", "left")))
    steps, more = len(known), np.zeros(measurement.shape[1])
    kept = advance(models, filters, known, known_end, measurement, noise, more, keep=True).states
    x, P, V = (np.concatenate([getattr(first, f), getattr(kept, f)], axis=1) for f in ("x", "P", "V"))
    A, AT, n, e = models.A, transposed(models.A), models.A.shape[1], models.A_nu.shape[1]
    M, U = np.broadcast_to(np.eye(n), A.shape), np.zeros_like(A)
    for t in range(steps - 1, -1, -1):
        own, spread, slope = x[:, t], P[:, t], V[:, t]
        ahead = (A @ own[..., None])[..., 0] + models.G @ known[t]
        P_ahead, V_ahead = A @ spread @ AT + models.Q, slope @ AT
        V_ahead[:, :e] -= (models.A_nu @ own[:, None, :, None])[..., 0] + models.G_nu @ known[t]
        K, H, R = _gain(models, ahead, P_ahead, V_ahead, known_end[t], measurement[t], noise[t])
        C = _back(spread @ AT + transposed(slope) @ V_ahead, P_ahead + transposed(V_ahead) @ V_ahead)
        off = M - M @ K @ H - np.eye(n)
        MK = M @ K
        L = np.eye(n) + C @ off @ A
        U = C @ (off @ models.Q @ transposed(off) + U + (MK * R) @ transposed(MK)) @ transposed(C)
        x[:, t] += (C @ (x[:, t + 1] - ahead)[..., None])[..., 0]
        V[:, t] += (V[:, t + 1] - V_ahead) @ transposed(C)
        P[:, t] = L @ spread @ transposed(L) + U
        M = L
    return States(x, P, V, first.nu, first.left)


def _gain(
    models: LinearModels, x: np.ndarray, P: np.ndarray, V: np.ndarray, known: np.ndarray, y: np.ndarray, R: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """K (B, n, k) of the k channels that measured, as `advance` takes it; their rows (B, k, n) and variances (k,)."""
    there = np.isfinite(y)
    H = models.H[:, there]
    sensed = (models.D[:, there] @ x[:, None, :, None])[..., 0] + models.E[:, there] @ known + models.offset[:, there]
    slope = transposed(sensed - V @ transposed(H))
    on_samples = H @ P - slope @ V
    S = H @ P @ transposed(H) + slope @ transposed(slope) + np.diag(R[there])
    return transposed(np.linalg.solve(S, on_samples)), H, R[there]


def _back(cross: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """cross · covariance⁻¹ (B, n, n), in units of the standard deviations."""
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    std = np.where(std > 0, std, 1.0)
    scaled = covariance / (std[:, :, None] * std[:, None]) + RIDGE * np.eye(std.shape[1])
    return np.asarray(transposed(np.linalg.solve(scaled, transposed(cross / std[:, None]))) / std[:, None])
