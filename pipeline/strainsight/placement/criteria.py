"""Criteria of a layout: their interface, the available ones, and the metric of a covariance."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.linalg import solve_triangular

from strainsight.errors import NumericalError


class Criterion(Protocol):
    """c(M) of the covariance M (k, k) of the weighed unknowns, a variance, which a layout makes small.

        c > 0,    c(αM) = α c(M),    c(M + D) ≥ c(M) for D ≥ 0,    1/c concave in M⁻¹

    M⁻¹ is concave in the gauge weights w and does not fall in them (`Metric`), so 1/c does neither, and c is convex in w:
    with W = ∂c/∂M ≥ 0, its slope in a gauge's weight is that of tr(W M) at fixed W, and tr(W M) = c(M) (Euler).
    name: in a config; title, symbol: in words and as a formula; sigma: what √c is, in a sentence; meaning: what c is.
    Source: 1/c is an information function; Pukelsheim, Optimal Design of Experiments (1993), ch. 5 and 6."""

    name: str
    title: str
    symbol: str
    sigma: str
    meaning: str

    def value(self, M: np.ndarray) -> float:
        """c(M)."""
        ...

    def gradient(self, M: np.ndarray) -> np.ndarray:
        """W (k, k) = ∂c/∂M, positive semidefinite; where c has a kink, any W with tr(W N) ≤ c(N) for every N ≥ 0 and
        tr(W M) = c(M)."""
        ...

    def rise(self, M: np.ndarray, D: np.ndarray) -> float:
        """c(M + D) − c(M), D (k, k) ≥ 0, computed from D with all its digits, not as a difference."""
        ...

    def least_rise(self, M: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Least c(M + D) − c(M) of all D ≥ 0 with tr(W D) ≥ t, W the gradient at M, for each t (m,). 0 is always valid, at the
        cost of more solves; t is valid for c convex in M."""
        return np.zeros_like(t)

    def lifts(self, M: np.ndarray, D: np.ndarray, doubt: np.ndarray) -> np.ndarray:
        """Least rises (m,) of all increments D' ≥ D − doubt·1, one for every D (m, k, k) ≥ 0 and doubt (m,). Only asked of a
        criterion with kinks: there its slope says little of a rise. 0 holds always, and makes a search solve more."""
        return np.zeros(len(D))

    def softened(self, temperature: float) -> Criterion:
        """Smooth upper bound of c, by at most temperature · ln k. Its gradient W need not satisfy tr(W M) = c(M), but tr(W N) ≤
        c(N) for every N ≥ 0."""
        return self


@dataclass(frozen=True)
class Trace(Criterion):
    """c = tr M = tr(W P): A-optimality."""

    name = "trace"
    title = "trace"
    symbol = "tr(W P)"
    sigma = "the weighted RMS of the steady-state σ"
    meaning = "sum of the scaled error variances of the unknowns"

    def value(self, M: np.ndarray) -> float:
        return float(M.trace())

    def gradient(self, M: np.ndarray) -> np.ndarray:
        return np.eye(len(M))

    def rise(self, M: np.ndarray, D: np.ndarray) -> float:
        return float(D.trace())

    def least_rise(self, M: np.ndarray, t: np.ndarray) -> np.ndarray:
        return t


@dataclass(frozen=True)
class LogDeterminant(Criterion):
    """c = det(M)^(1/k) = exp(ln det M / k): D-optimality, as the geometric mean of the variances along the axes of M. The
    layouts of least ln det, which by itself may be negative, so that a share of it means nothing. No unit of an unknown
    changes a layout. Over several scenarios the mean is that of these variances."""

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

    def least_rise(self, M: np.ndarray, t: np.ndarray) -> np.ndarray:
        """det(I + X) ≥ 1 + tr X for X ≥ 0, and here tr X = k t / c."""
        c, k = self.value(M), len(M)
        return np.asarray(c * np.expm1(np.log1p(k * t / c) / k))


def _factor(M: np.ndarray) -> np.ndarray:
    """L of M = L Lᵀ."""
    try:
        return np.asarray(np.linalg.cholesky(M))
    except np.linalg.LinAlgError:
        raise NumericalError(
            "the covariance of the unknowns is numerically singular",
            key="place.criterion",
            remedy="a combination of unknowns is known far better than each unknown: estimate fewer unknowns, or change "
            "place.criterion",
        ) from None


ROUNDING = 1e-12
"""Eigenvalues closer than this share are equal, so that rounding does not select an eigenvector. A rise below this share of tr D
is rounding."""


@dataclass(frozen=True)
class WorstEigenvalue(Criterion):
    """c = λ₁(M), the largest eigenvalue: E-optimality. At a temperature τ > 0, τ ln Σ exp(λᵢ/τ). W = v₁v₁ᵀ, or Σ θᵢ vᵢvᵢᵀ
    with θ = exp(λ/τ)/Σ: of trace 1, hence tr(W N) ≤ λ₁(N) for every N; of a repeated λ₁ the mean over its vectors. The units
    of the unknowns matter. What does not touch v₁ has no rise."""

    temperature: float = 0.0

    name = "worst_eigenvalue"
    title = "worst eigenvalue"
    symbol = "λ₁(P)"
    sigma = "the steady-state σ of the most uncertain combination of unknowns"
    meaning = "largest variance of any combination of the scaled unknowns"

    def value(self, M: np.ndarray) -> float:
        values = np.linalg.eigvalsh(M)
        return float(values[-1] + self.temperature * np.log(self._share(values).sum()))

    def gradient(self, M: np.ndarray) -> np.ndarray:
        values, V = np.linalg.eigh(M)
        share = self._share(values)
        return np.asarray((V * (share / share.sum())) @ V.T)

    def rise(self, M: np.ndarray, D: np.ndarray) -> float:
        """λ₁(M + D) − λ₁(M), without smoothing."""
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

    def least_rise(self, M: np.ndarray, t: np.ndarray) -> np.ndarray:
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


CRITERIA: tuple[Criterion, ...] = (Trace(), LogDeterminant(), WorstEigenvalue())


def criterion_of(criterion: str | Criterion) -> Criterion:
    """The criterion of a name in a config, or the criterion itself."""
    return next(known for known in CRITERIA if known.name == criterion) if isinstance(criterion, str) else criterion


@dataclass(frozen=True)
class Metric:
    """c(M), M = √W P √W over the states of positive weight; weight (n*,) ≥ 0: diagonal of W. States of no weight stay
    states of the filter.

    For any weights w of the gauges, Y = P⁻¹ is the largest solution of −YF − FᵀY − YQY + G(w) = 0, hence concave in w and
    not falling; M⁻¹ is a Schur complement of Y in units of √W, and so is it. That is what a `Criterion` asks for."""

    weight: np.ndarray
    criterion: Criterion = field(default_factory=Trace)

    @cached_property
    def states(self) -> np.ndarray:
        """Indices of the weighted states (k,)."""
        return np.flatnonzero(self.weight > 0)

    @cached_property
    def _block(self) -> tuple[slice | np.ndarray, ...]:
        at = self.states
        if len(at) and at[-1] - at[0] == len(at) - 1:
            # a slice costs a tenth of an index
            return (slice(at[0], at[-1] + 1),) * 2
        return np.ix_(at, at)

    @cached_property
    def _units(self) -> np.ndarray:
        root = np.sqrt(self.weight[self.states])
        return np.outer(root, root)

    @property
    def smooth(self) -> bool:
        """Whether the criterion is differentiable everywhere."""
        return len(self.states) < 2 or self.criterion.softened(1.0) == self.criterion

    def weighed(self, P: np.ndarray) -> np.ndarray:
        """M (k, k) of P (n*, n*)."""
        return np.asarray(P[self._block] * self._units)

    def value(self, P: np.ndarray) -> float:
        """c(M) of P (n*, n*)."""
        return self.criterion.value(self.weighed(P))

    def gradient(self, P: np.ndarray) -> np.ndarray:
        """∂c/∂P (n*, n*), positive semidefinite."""
        W = np.zeros_like(P)
        W[self._block] = self.criterion.gradient(self.weighed(P)) * self._units
        return W

    def rise(self, P: np.ndarray, D: np.ndarray) -> float:
        """c at P + D less c at P, with the digits of D (n*, n*)."""
        return self.criterion.rise(self.weighed(P), self.weighed(D))

    def least_rise(self, P: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Least rise over all D ≥ 0 with tr(∂c/∂P D) ≥ t, for each t (m,)."""
        return self.criterion.least_rise(self.weighed(P), t)

    def lifts(self, P: np.ndarray, D: np.ndarray, doubt: np.ndarray) -> np.ndarray:
        """Least rises (m,) over all increments of no less than D (m, k, k) of the weighed states, in whose eigenvalues doubt (m,)
        is rounding."""
        return self.criterion.lifts(self.weighed(P), D * self._units, doubt * float(self._units.max()))

    def softened(self, temperature: float) -> Metric:
        """Smoothed metric: see `Criterion`."""
        soft = self.criterion.softened(temperature)
        return self if soft == self.criterion else Metric(self.weight, soft)

    def times(self, factor: float) -> Metric:
        """The metric multiplied by `factor` > 0: c(αM) = α c(M) for every criterion."""
        return Metric(self.weight * factor, self.criterion)

    def scaled(self, d: np.ndarray) -> Metric:
        """The metric in coordinates x*/d."""
        return Metric(self.weight * d * d, self.criterion)
