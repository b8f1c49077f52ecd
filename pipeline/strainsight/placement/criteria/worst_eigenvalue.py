"""The variance of the combination of the weighed unknowns that is known worst."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.placement.criteria.criterion import Criterion

ROUNDING = 1e-12
"""Eigenvalues closer than this share of them are one, so that rounding chooses no vector of theirs; a rise below this share
of tr D is the rounding of D, and none."""


@dataclass(frozen=True)
class WorstEigenvalue(Criterion):
    """c = λ₁(M), the largest eigenvalue: E-optimality. At a temperature τ > 0, τ ln Σ exp(λᵢ/τ).

    W = v₁v₁ᵀ, or Σ θᵢ vᵢvᵢᵀ with θ = exp(λ/τ)/Σ: of trace 1, hence tr(W N) ≤ λ₁(N) for every N; of a repeated λ₁ the mean
    over its vectors. The units of the unknowns matter. What does not touch v₁ has no rise.
    """

    temperature: float = 0.0

    name = "worst_eigenvalue"
    title = "worst eigenvalue"
    symbol = "λ₁(P)"
    sigma = "the steady-state σ of the worst-known combination"
    meaning = "variance of that combination of the unknowns, each in units of its scale, which is known worst"

    def value(self, M: np.ndarray) -> float:
        values = np.linalg.eigvalsh(M)
        return float(values[-1] + self.temperature * np.log(self._share(values).sum()))

    def gradient(self, M: np.ndarray) -> np.ndarray:
        values, V = np.linalg.eigh(M)
        share = self._share(values)
        return np.asarray((V * (share / share.sum())) @ V.T)

    def rise(self, M: np.ndarray, D: np.ndarray) -> float:
        """λ₁(M + D) − λ₁(M), not softened."""
        values, V = np.linalg.eigh(M)
        Z = V.T @ D @ V
        below = values[-1] - values[:-1]
        if len(below) and below[-1] < 4 * np.linalg.norm(Z):
            rise = np.linalg.eigvalsh(Z - np.diag(values[-1] - values))[-1]
        else:
            # μ = z₁₁ + zᵀ(μ + Δ − Z₂₂)⁻¹z keeps the digits of a rise far below the gap Δ to the other eigenvalues
            rise = Z[-1, -1]
            for _ in range(8):
                rise = Z[-1, -1] + Z[-1, :-1] @ np.linalg.solve(np.diag(rise + below) - Z[:-1, :-1], Z[:-1, -1])
        return float(rise) if rise > ROUNDING * np.trace(D) else 0.0

    def least_rise(self, M: np.ndarray, t: float) -> float:
        return t

    def lifts(self, M: np.ndarray, D: np.ndarray, doubt: np.ndarray) -> np.ndarray:
        """λ₁(M + D) − λ₁(M), less the rounding of a difference: where D turns v₁ that is far more than v₁ᵀD v₁."""
        after = np.linalg.eigvalsh(M + D)[:, -1]
        return np.asarray(np.maximum(after * (1 - ROUNDING) - np.linalg.eigvalsh(M)[-1] - doubt, 0.0))

    def softened(self, temperature: float) -> WorstEigenvalue:
        return WorstEigenvalue(temperature)

    def _share(self, values: np.ndarray) -> np.ndarray:
        """exp((λ − λ₁)/τ) (k,)."""
        if self.temperature == 0:
            return np.asarray(values >= (1 - ROUNDING) * values[-1], dtype=float)
        return np.asarray(np.exp((values - values[-1]) / self.temperature))
