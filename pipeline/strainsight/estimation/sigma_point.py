"""The augmented sigma-point filter: the extended filter with its Jacobians replaced by regressions over the parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from strainsight.estimation.model import FilterModel
from strainsight.estimation.reduced import StepModel, driven_with_offsets
from strainsight.estimation.update import symmetric, transpose

Outcome = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Regression:
    """f(x) ≈ mean + slope (x − x̂) + r: mean (B, r), slope (B, r, n), rest (B, r, r) covariance of r, which x does not
    explain."""

    mean: np.ndarray
    slope: np.ndarray
    rest: np.ndarray


Points = tuple[np.ndarray, np.ndarray]
"""Sigma points z (N, k) of k standard normal numbers with weights (N,), all positive."""


def points_of(k: int) -> Points:
    """The product of Gauss-Hermite rules of three points: exact for polynomials up to degree five in each of k normal numbers.

    For k = 1 they are those of the unscented transform with n + κ = 3. Its 2k + 1 points for k > 1, and those of the cubature
    rule, miss the fourth moments, and with them the variance of a product of two errors.
    Source: Ito and Xiong, IEEE Trans. Automatic Control 45 (2000).

    """
    node, weight = (0.0, np.sqrt(3.0), -np.sqrt(3.0)), (2 / 3, 1 / 6, 1 / 6)
    z = np.array(list(product(node, repeat=k))).reshape(3**k, k)
    return z, np.array([np.prod(weights) for weights in product(weight, repeat=k)])


def regression(
    of: Callable[[np.ndarray], Outcome], x: np.ndarray, P: np.ndarray, parameters: slice, points: Points
) -> Regression:
    """Statistical linear regression of f on x ~ N(x̂, P), f linear in x at fixed parameters p = x[parameters]:

        x = x̂ + C z + e,   z ~ N(0, I) of p alone,   cov e = Σ = P − C Cᵀ, nothing in p
        mean = Σ wᵢ fᵢ,   slope C = Σ wᵢ fᵢ zᵢᵀ,   slope e = Σ wᵢ Jᵢ e,   fᵢ = f(x̂ + C zᵢ)
        rest = Σ wᵢ (rᵢ rᵢᵀ + (Jᵢ − J̄) Σ (Jᵢ − J̄)ᵀ),   rᵢ = fᵢ − mean − slope C zᵢ

    Exact in e, of degree five in p. rest is positive semidefinite, and so is slope P slopeᵀ + rest, the covariance of f.
    of: x (N B, n) point by point → f (N B, r) and J = ∂f/∂x (N B or 1, r, n), of which columns of p are not used;
    x (B, n), P (B, n, n). A direction of p without variance has no spread and no slope.
    Sources: Morelande and Ristić, Proc. SPIE 6236 (2006); Lefebvre, Bruyninckx and De Schutter, IEEE Trans. Automatic Control
    47 (2002).

    """
    (z, w), (B, n) = points, x.shape
    N = len(w)
    inverse, spread = _inverse_factor(P[:, parameters, parameters]), P[:, :, parameters]
    C = spread @ inverse
    f, J = of((x + np.einsum("bnk,ik->ibn", C, z)).reshape(N * B, n))
    f = f.reshape(N, B, -1)
    J = np.array(np.broadcast_to(J, (N * B, *J.shape[1:]))).reshape(N, B, -1, n)
    J[..., parameters] = 0.0

    def average(X: np.ndarray) -> np.ndarray:
        return np.asarray((w @ X.reshape(N, -1)).reshape(X.shape[1:]))

    mean, middle = average(f), average(J)
    along = average((f - mean)[..., None] * z[:, None, None])
    slope = middle.copy()
    slope[..., parameters] += (along - middle @ C) @ transpose(inverse)
    off = f - mean - np.einsum("brk,ik->ibr", along, z)
    turned = J - middle
    rest = average(off[..., None] * off[..., None, :] + turned @ (P - C @ transpose(C)) @ transpose(turned))
    return Regression(mean, slope, symmetric(rest))


@dataclass(frozen=True)
class SigmaPoints:
    """Regressions of step and measurement in place of their Jacobians:

        x̂⁻ = mean_f,   P⁻ = A P Aᵀ + Q + rest_f,     S = H P⁻ Hᵀ + R + rest_h,   x̂ = x̂⁻ + P⁻Hᵀ S⁻¹ (y − mean_h)

    with A, H their slopes: the covariance of the extended filter, and what the product of the errors of parameter and motion
    adds, which that neglects. The density of parameter and motion is taken as normal after every step.
    model: of every run; many: of all points of all runs; parameters: their indices in x; curved: whether the reading is not
    linear, and so needs a regression."""

    model: StepModel
    many: StepModel
    parameters: slice
    points: Points
    curved: bool

    def step(self, x: np.ndarray, P: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x̂⁻ (B, n), A (B, n, n) and process noise (B, n, n) with rest_f; the parameters are exactly unchanged."""
        at = self.parameters
        moved = regression(lambda points: self.many.step(points, k), x, P, at, self.points)
        moved.mean[:, at] = x[:, at]
        moved.slope[:, at] = np.eye(x.shape[1])[at]
        moved.rest[:, at] = moved.rest[:, :, at] = 0.0
        return moved.mean, moved.slope, self.model.process(k) + moved.rest

    def measure(
        self, x: np.ndarray, P: np.ndarray, R: np.ndarray, measured: np.ndarray, k: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Reading (B, m), H (B, m, n) and noise (B, m, m) of variances R (B, m) with rest_h, R itself for linear readings;
        measured (B, m)."""
        if not self.curved:
            return *self.model.measure(x, k), R
        read = regression(lambda points: self.many.measure(points, k), x, P, self.parameters, self.points)
        both = measured[:, :, None] & measured[:, None, :]
        return read.mean, read.slope, np.where(both, read.rest, 0.0) + R[:, None, :] * np.eye(R.shape[1])


def sigma_points(
    model: FilterModel, core: StepModel, known: np.ndarray, biased: np.ndarray | None = None
) -> SigmaPoints | None:
    """Sigma points of the reduced model under known loads, with its `StepModel` core; None without estimated parameters."""
    if core.linear:
        return None
    points = points_of(len(model.unknowns.parameters))
    many = driven_with_offsets(_repeat_model(model, len(points[1])), known, biased)
    return SigmaPoints(core, many, model.parameter_states, points, model.curved)


def _repeat_model(model: FilterModel, times: int) -> FilterModel:
    """The model for all points of all runs, if each run has its channels."""
    if model.H.ndim < 3:
        return model
    quantity = model.quantity
    if quantity is not None and quantity.ndim == 2:
        quantity = np.tile(quantity, (times, 1))
    change = model.change.of_terms(lambda X: np.tile(X, (times, 1, 1)))
    return replace(model, H=np.tile(model.H, (times, 1, 1)), change=change, quantity=quantity)


def _inverse_factor(P: np.ndarray) -> np.ndarray:
    """W (B, k, k) with Wᵀ P W = I, scaled to diag P = 1 first; zero columns for directions without variance."""
    std = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
    size = np.where(std > 0, std, 1.0)
    values, vectors = np.linalg.eigh(P / (size[:, :, None] * size[:, None, :]))
    spread = values > P.shape[-1] * np.finfo(float).eps
    inverse = np.where(spread, 1 / np.sqrt(np.where(spread, values, 1.0)), 0.0)
    return np.asarray(vectors / size[:, :, None] * inverse[:, None])
