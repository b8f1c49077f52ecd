"""The augmented sigma-point filter: the extended filter with its Jacobians replaced by regressions over the parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from strainsight.estimation.filter import filter_runs, samples_by_step
from strainsight.estimation.model import FilterModel
from strainsight.estimation.reduced import driven_with_offsets
from strainsight.estimation.run import FilterRun, Keep, RunArrays
from strainsight.estimation.update import Form, Transition, apply, belief_of, symmetric, transposed, whiten

Outcome = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Regression:
    """f(x) ≈ mean + slope (x − x̂) + r: mean (B, r), slope (B, r, n), rest (B, r, r) covariance of r, which x does not explain."""

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
    mean, middle = np.tensordot(w, f, 1), np.tensordot(w, J, 1)
    along = np.einsum("i,ibr,ik->brk", w, f - mean, z)
    slope = middle + (along - middle @ C) @ transposed(_wide(inverse, parameters, n))
    off = f - mean - np.einsum("brk,ik->ibr", along, z)
    turned = J - middle
    rest = np.einsum("i,ibr,ibs->brs", w, off, off) + np.tensordot(
        w, turned @ (P - C @ transposed(C)) @ transposed(turned), 1
    )
    return Regression(mean, slope, symmetric(rest))


def run_sigma_points(
    model: FilterModel,
    mean: np.ndarray,
    covariance: np.ndarray,
    known: np.ndarray,
    measurement: np.ndarray,
    keep: Keep = "mean",
    *,
    form: Form = "joseph",
    biased: np.ndarray | None = None,
    refuse: bool = True,
) -> FilterRun:
    """Predict and update with the regressions of step and measurement, T times, for B runs at once:

        x̂⁻ = mean_f,   P⁻ = A P Aᵀ + Q + rest_f,     S = H P⁻ Hᵀ + R + rest_h,   x̂ = x̂⁻ + P⁻Hᵀ S⁻¹ (y − mean_h)

    with A, H their slopes: the covariance of the extended filter, and what the product of the errors of parameter and motion
    adds, which that neglects. A reading that is linear needs no regression. The density of parameter and motion is taken as
    normal after every step. Arguments as of `run_filter`. Parameters drift by what Q says. Without a parameter it is the Kalman
    filter. Raises ValueError where the known loads end before the samples, and as `filter_runs`.
    """
    y = samples_by_step(model, known, measurement)
    y = y if y.ndim == 3 else y[:, None]
    core = driven_with_offsets(model, known, biased)
    if core.linear:
        return filter_runs(core, mean, covariance, y, keep, form=form, refuse=refuse)
    parameters, points = model.parameter_states, points_of(len(model.unknowns.parameters))
    many = driven_with_offsets(_repeated(model, len(points[1])), known, biased)
    sets = max(core.sets, len(covariance) if covariance.ndim == 3 else 1)
    runs = max(y.shape[1], sets, mean.size // core.size)
    measured = np.broadcast_to(np.isfinite(y), (len(y), runs, y.shape[2]))
    x = np.broadcast_to(mean, (runs, core.size)).astype(float)
    P = np.broadcast_to(covariance, (runs, core.size, core.size)).astype(float)
    start, belief = (x.copy(), P.copy()), belief_of(form, P)
    record = RunArrays(core, len(y), runs, runs, keep, regressed=True)
    record.state(0, x, P)
    for k in range(len(y)):
        moved = _constant(regression(lambda at, k=k: many.step(at, k), x, P, parameters, points), x, parameters)  # type: ignore[misc]
        x, A, process = moved.mean, moved.slope, core.process(k) + moved.rest
        belief = belief.predicted(Transition(A, process))
        H: np.ndarray | None = None
        R = np.broadcast_to(core.noise(k), measured[k].shape)
        if measured[k].any():
            expected, H = core.measure(x, k)
            if model.curved:
                read = regression(lambda at, k=k: many.measure(at, k), x, belief.covariance, parameters, points)  # type: ignore[misc]
                both = measured[k][:, :, None] & measured[k][:, None, :]
                expected, H = read.mean, read.slope
                R = np.where(both, read.rest, 0.0) + R[:, None, :] * np.eye(R.shape[1])
            innovation = record.innovation[k] = y[k] - expected
            if not measured[k].all():
                H, innovation = np.where(measured[k][..., None], H, 0.0), np.nan_to_num(innovation)
            belief, G, L = belief.updated(H, R, (k + 1) * core.h)
            record.whitened[k] = whiten(L, innovation)
            record.spread[k] = np.diagonal(L, axis1=-2, axis2=-1)
            x = x + apply(G, record.whitened[k])
        astray = record.astray(k, x, refuse)
        if astray.any():
            x, belief = np.where(astray[:, None], start[0], x), belief.reset(astray, start[1])
        P = belief.covariance
        record.state(k + 1, x, P)
        record.readings(k, *core.measure(x, k), P)
        record.linearised(k, A, H, None)
        record.noises(k, process, R)
    return record.finished(P, measured)


def _repeated(model: FilterModel, times: int) -> FilterModel:
    """For so many points of every run, where each run has channels of its own."""
    if model.H.ndim < 3:
        return model
    quantity = model.quantity
    if quantity is not None and quantity.ndim == 2:
        quantity = np.tile(quantity, (times, 1))
    change = model.change.of_terms(lambda X: np.tile(X, (times, 1, 1)))
    return replace(model, H=np.tile(model.H, (times, 1, 1)), change=change, quantity=quantity)


def _constant(moved: Regression, x: np.ndarray, parameters: slice) -> Regression:
    """With the parameters as they were, to the last digit."""
    moved.mean[:, parameters] = x[:, parameters]
    moved.slope[:, parameters] = np.eye(x.shape[1])[parameters]
    moved.rest[:, parameters] = moved.rest[:, :, parameters] = 0.0
    return moved


def _inverse_factor(P: np.ndarray) -> np.ndarray:
    """W (B, k, k) with Wᵀ P W = I, scaled to diag P = 1 first; zero columns for directions without variance."""
    std = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
    size = np.where(std > 0, std, 1.0)
    values, vectors = np.linalg.eigh(P / (size[:, :, None] * size[:, None, :]))
    spread = values > P.shape[-1] * np.finfo(float).eps
    inverse = np.where(spread, 1 / np.sqrt(np.where(spread, values, 1.0)), 0.0)
    return np.asarray(vectors / size[:, :, None] * inverse[:, None])


def _wide(inverse: np.ndarray, parameters: slice, n: int) -> np.ndarray:
    """W (B, k, k) as rows of x (B, n, k)."""
    whole = np.zeros((len(inverse), n, inverse.shape[-1]))
    whole[:, parameters] = inverse
    return whole
