"""The linear system of one Newton iteration of the implicit step, condensed and free of units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.linalg.lapack import dgetrf, dgetrs

from strainsight.errors import NumericalError
from strainsight.multibody.equations import Balance

TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class StepMatrix:
    """The Jacobian of the step (1.7) in (q, v, μ, λ) after elimination of v, factorised.

    D² ((q' − q)/h − v') + Bᵀμ = r₁,   M a + c + f − Bᵀλ = r₂,   B v' = r₃,   φ = r₄
    scaled: x = D q, y = h D v, B̂ = S B D⁻¹ of unit rows;   y = X x + B̂ᵀμ̂ − r̂₁,   X = 1 + h D⁻¹(∂Bᵀμ/∂q)D⁻¹
    [A₂₁ + A₂₂X   A₂₂B̂ᵀ   −B̂ᵀ] [x]   [r̂₂ + A₂₂r̂₁]
    [A₃₁ + B̂X    B̂B̂ᵀ     0  ] [μ̂] = [r̂₃ + B̂r̂₁  ]
    [B̂            0        0  ] [λ̂]   [r̂₄         ]
    """

    lu: np.ndarray
    pivots: np.ndarray
    X: np.ndarray
    A22: np.ndarray
    B: np.ndarray
    d: np.ndarray
    s: np.ndarray
    h: float

    def solve(self, r1: np.ndarray, r2: np.ndarray, r3: np.ndarray, r4: np.ndarray) -> tuple[np.ndarray, ...]:
        """(q, v, μ, λ) from right-hand sides (n, k), (n, k), (m, k), (m, k)."""
        r1, right = _condensed(r1, r2, r3, r4, self.A22, self.B, self.d, self.s, self.h)
        z, _ = dgetrs(self.lu, self.pivots, right, overwrite_b=1)
        found: tuple[np.ndarray, ...] = _expanded(z, r1, self.X, self.B, self.d, self.s, self.h)
        return found


def step_matrix(at: Balance, d: np.ndarray, h: float) -> StepMatrix:
    """Factorise at a trial state. Raises NumericalError where the matrix is singular."""
    A, X, A22, B, s = _assembled(
        at.mass, at.damping, at.stiffness, at.constraint_stiffness, at.B, at.B_rate, len(at.phi), d, h
    )
    lu, pivots, info = dgetrf(A, overwrite_a=1)
    if info != 0:
        raise NumericalError("the matrix of the step is singular")
    return StepMatrix(lu, pivots, X, A22, B, d, s, h)


@njit(cache=True)
def _condensed(
    r1: np.ndarray,
    r2: np.ndarray,
    r3: np.ndarray,
    r4: np.ndarray,
    A22: np.ndarray,
    B: np.ndarray,
    d: np.ndarray,
    s: np.ndarray,
    h: float,
) -> tuple[np.ndarray, np.ndarray]:
    """r̂₁ (n, k) and the right-hand side (n + 2m, k) of `StepMatrix`, in the order of LAPACK."""
    (n, k), m = r1.shape, len(s)
    own = np.empty((n, k))
    for i in range(n):
        for c in range(k):
            own[i, c] = h / d[i] * r1[i, c]
    first, second = A22 @ own, B @ own
    T = np.empty((k, n + 2 * m))
    for c in range(k):
        for i in range(n):
            T[c, i] = h * h / d[i] * r2[i, c] + first[i, c]
        for j in range(m):
            T[c, n + j] = h * s[j] * r3[j, c] + second[j, c]
            T[c, n + m + j] = s[j] * r4[j, c]
    return own, T.T


@njit(cache=True)
def _expanded(
    z: np.ndarray, r1: np.ndarray, X: np.ndarray, B: np.ndarray, d: np.ndarray, s: np.ndarray, h: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """q, v, μ, λ from the solution (n + 2m, k) in scaled coordinates."""
    (n, k), m = r1.shape, len(s)
    x, mu = np.empty((n, k)), np.empty((m, k))
    for c in range(k):
        for i in range(n):
            x[i, c] = z[i, c]
        for j in range(m):
            mu[j, c] = z[n + j, c]
    y = X @ x + B.T @ mu - r1
    lam = np.empty((m, k))
    for c in range(k):
        for i in range(n):
            x[i, c] /= d[i]
            y[i, c] /= h * d[i]
        for j in range(m):
            mu[j, c] *= s[j] / h
            lam[j, c] = z[n + m + j, c] * s[j] / (h * h)
    return x, y, mu, lam


@njit(cache=True)
def _assembled(
    mass: np.ndarray,
    damping: np.ndarray,
    stiffness: np.ndarray,
    constraint_stiffness: np.ndarray,
    gradient: np.ndarray,
    B_rate: np.ndarray,
    m: int,
    d: np.ndarray,
    h: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The matrix of `StepMatrix` in the order of LAPACK, and X, A₂₂, B̂ and S it is made of."""
    n = len(d)
    X, A22, K = np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    for i in range(n):
        for j in range(n):
            scale = 1 / (d[i] * d[j])
            X[i, j] = h * constraint_stiffness[i, j] * scale
            A22[i, j] = (mass[i, j] + h * damping[i, j]) * scale
            K[i, j] = h * h * stiffness[i, j] * scale
        X[i, i] += 1.0
    B, s = np.empty((m, n)), np.empty(m)
    for k in range(m):
        squares = 0.0
        for j in range(n):
            B[k, j] = gradient[k, j] / d[j]
            squares += B[k, j] * B[k, j]
        s[k] = 1 / np.sqrt(max(squares, TINY))
        for j in range(n):
            B[k, j] *= s[k]
    # transposed, so that its transpose is in columns
    T = np.zeros((n + 2 * m, n + 2 * m))
    first = K + A22 @ X
    across, moved, held = A22 @ B.T, B @ X, B @ B.T
    for i in range(n):
        for j in range(n):
            T[j, i] = first[i, j]
        for k in range(m):
            T[n + k, i] = across[i, k]
            T[n + m + k, i] = -B[k, i]
            T[i, n + k] = h * s[k] * B_rate[k, i] / d[i] + moved[k, i]
            T[i, n + m + k] = B[k, i]
    for k in range(m):
        for j in range(m):
            T[n + j, n + k] = held[k, j]
    return T.T, X, A22, B, s
