"""The linear system of one Newton iteration of the implicit step, condensed and free of units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dgetrf, dgetrs

from strainsight.errors import NumericalError
from strainsight.multibody.equations import Balance


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
        d, s, h = self.d[:, None], self.s[:, None], self.h
        n, m = len(d), len(s)
        r1 = (h / d) * r1
        right = np.empty((n + 2 * m, r1.shape[1]), order="F")
        right[:n] = (h * h / d) * r2 + self.A22 @ r1
        right[n : n + m] = (h * s) * r3 + self.B @ r1
        right[n + m :] = s * r4
        z, _ = dgetrs(self.lu, self.pivots, right, overwrite_b=1)
        x, mu, lam = z[:n], z[n : n + m], z[n + m :]
        y = self.X @ x + self.B.T @ mu - r1
        return x / d, y / (h * d), mu * (s / h), lam * (s / (h * h))


def step_matrix(at: Balance, d: np.ndarray, h: float) -> StepMatrix:
    """Factorise at a trial state. Raises NumericalError where the matrix is singular."""
    n, m = len(d), len(at.phi)
    e = 1 / d
    B = at.B * e
    s = 1 / np.sqrt(np.maximum(np.einsum("ij,ij->i", B, B), np.finfo(float).tiny))
    B *= s[:, None]
    scale = np.outer(e, e)
    X = at.constraint_stiffness * (h * scale)
    X.flat[:: n + 1] += 1.0
    A22 = (at.mass + h * at.damping) * scale
    A = np.zeros((n + 2 * m, n + 2 * m), order="F")
    A[:n, :n] = at.stiffness * (h * h * scale) + A22 @ X
    A[:n, n : n + m] = A22 @ B.T
    A[:n, n + m :] = -B.T
    A[n : n + m, :n] = at.B_rate * (h * s[:, None] * e) + B @ X
    A[n : n + m, n : n + m] = B @ B.T
    A[n + m :, :n] = B
    lu, pivots, info = dgetrf(A, overwrite_a=1)
    if info != 0:
        raise NumericalError("the matrix of the step is singular")
    return StepMatrix(lu, pivots, X, A22, B, d, s, h)
