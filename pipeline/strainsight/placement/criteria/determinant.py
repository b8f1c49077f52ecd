"""The volume of what stays uncertain, all weighed unknowns together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from strainsight.errors import NumericalError
from strainsight.placement.criteria.criterion import Criterion


@dataclass(frozen=True)
class LogDeterminant(Criterion):
    """c = det(M)^(1/k) = exp(ln det M / k): D-optimality, as the geometric mean of the variances along the axes of M.

    The layouts of least ln det, which by itself may be negative, so that a share of it means nothing. No unit of an
    unknown changes a layout. Over several scenarios the mean is that of these variances.
    """

    name = "log_determinant"
    title = "log-determinant"
    symbol = "det(P)^(1/n)"
    sigma = "the geometric mean of the steady-state σ along the axes of the error ellipsoid"
    meaning = "geometric mean of the variances along the axes of the error ellipsoid of the unknowns"

    def value(self, M: np.ndarray) -> float:
        return float(np.exp(np.linalg.slogdet(M)[1] / len(M)))

    def gradient(self, M: np.ndarray) -> np.ndarray:
        inverse = solve_triangular(_factor(M), np.eye(len(M)), lower=True)
        return np.asarray(self.value(M) / len(M) * (inverse.T @ inverse))

    def rise(self, M: np.ndarray, D: np.ndarray) -> float:
        """c (exp(ln det(I + L⁻¹DL⁻ᵀ)/k) − 1),   M = L Lᵀ."""
        L = _factor(M)
        inner = solve_triangular(L, solve_triangular(L, D, lower=True).T, lower=True)
        return self.value(M) * float(np.expm1(np.log1p(np.linalg.eigvalsh(0.5 * (inner + inner.T))).mean()))

    def least_rise(self, M: np.ndarray, t: float) -> float:
        """det(I + X) ≥ 1 + tr X for X ≥ 0, and here tr X = k t / c."""
        c, k = self.value(M), len(M)
        return c * float(np.expm1(np.log1p(k * t / c) / k))


def _factor(M: np.ndarray) -> np.ndarray:
    """L of M = L Lᵀ."""
    try:
        return np.asarray(np.linalg.cholesky(M))
    except np.linalg.LinAlgError:
        raise NumericalError(
            "the covariance of the unknowns is singular to rounding",
            key="place.criterion",
            remedy="a combination of them is known far better than each one: estimate fewer, or choose another criterion",
        ) from None
