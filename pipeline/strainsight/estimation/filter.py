"""The augmented extended Kalman filter (1.53-1.60) for a batch of runs, with Joseph's covariance update."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.model import FilterModel, augmented_jacobian, constant_step, step, theta_of
from strainsight.rom.modal_step import modal_step

LOST = 10.0
"""A run is lost when a parameter has left its guess by a factor of exp(LOST)."""


@dataclass(frozen=True)
class FilterRun:
    """What B runs over T steps estimated; index k of a measured quantity is the instant (k + 1)h.

    time (T + 1,) [s]; mean, std (T + 1, B, n*) of x* after the update (index 0: the initial state);
    unknown_covariance (T + 1, b, k, k) of the block [ũ, p];
    gauge_mean, gauge_std (T, B, m) of H x* after the update [strain];
    innovation (T, B, m) y − H x̂⁻ [strain]; whitened (T, B, m) L⁻¹(y − H x̂⁻), unit white noise if the model is true;
    nis (T, B) its square sum; lost (B,) index of the step that lost the run (NaN from there on), −1 for none;
    covariance (T + 1, b, n*, n*) and jacobian (T, b, n*, n*) only where kept; b is 1 where all runs share them.
    A missing measurement (NaN) leaves NaN in innovation and whitened and adds nothing to nis.
    """

    time: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    unknown_covariance: np.ndarray
    gauge_mean: np.ndarray
    gauge_std: np.ndarray
    innovation: np.ndarray
    whitened: np.ndarray
    nis: np.ndarray
    lost: np.ndarray
    covariance: np.ndarray | None
    jacobian: np.ndarray | None


def run_filter(
    model: FilterModel,
    mean: np.ndarray,
    covariance: np.ndarray,
    known: np.ndarray,
    measurement: np.ndarray,
    keep: Literal["mean", "all"] = "mean",
) -> FilterRun:
    """Predict with the step, update with the strains, T times, for B runs at once:

        x̂⁻ = f(x̂, u),   P⁻ = A* P A*ᵀ + Q h     (1.57),   then `update` (1.58-1.60)

    mean (n*,) or (B, n*) and covariance (n*, n*) or (B, n*, n*) of x* at t = 0, which may be singular;
    known (T, HOLD, n_known) hold coefficients [N]; measurement (T, m) or (T, B, m) strain at h, 2h, … (NaN: missing);
    keep "all" stores what the smoother needs (2 T b n*² numbers).
    One update a step: the measurement is linear in x*, so Gauss-Newton iterations of it would not move.
    No scaling of the states: products and Cholesky factors of HPHᵀ + R commute with a diagonal scaling, and P is
    never inverted. A covariance that no run changes (no parameters, one set of gauges) is computed once.
    Raises NumericalError where every run is lost, or where HPHᵀ + R is not positive definite.
    """
    steps = len(measurement)
    y = measurement if measurement.ndim == 3 else measurement[:, None, :]
    covariances_given = _covariance_runs(model, covariance)
    runs = max(y.shape[1], covariances_given, mean.size // model.size)
    shared = covariances_given == 1 and not model.unknowns.parameters and not np.isnan(y).any()
    b = 1 if shared else runs
    size, gauges = model.size, y.shape[2]
    block = slice(2 * model.model.size, size)
    x = np.broadcast_to(mean, (runs, size)).astype(float)
    P = np.broadcast_to(covariance, (b, size, size)).astype(float)
    start = x.copy(), P.copy()
    Q, R = model.Q * model.h, np.broadcast_to(model.r / model.h, (b, gauges))
    constant = constant_step(model)
    means, stds = np.empty((steps + 1, runs, size)), np.empty((steps + 1, b, size))
    blocks = np.empty((steps + 1, b, size - block.start, size - block.start))
    gauge_mean, innovation, whitened = (np.empty((steps, runs, gauges)) for _ in range(3))
    gauge_std = np.empty((steps, b, gauges))
    lost = np.full(runs, -1)
    covariances = np.empty((steps + 1, b, size, size)) if keep == "all" else None
    jacobians = np.empty((1 if constant else steps, b, size, size)) if keep == "all" else None

    def store(k: int) -> None:
        means[k], stds[k], blocks[k] = x, standard_deviation(P), P[..., block, block]
        if covariances is not None:
            covariances[k] = P

    store(0)
    for k in range(steps):
        x, A = step(model, x, known[k], constant)
        P = predict(P, A, Q)
        H, innovation[k] = model.H, y[k] - apply(model.H, x)
        if not shared:
            H = np.where(np.isnan(innovation[k])[..., None], 0.0, H)
        x, P, whitened[k] = update(x, P, H, R, np.nan_to_num(innovation[k]), instant=(k + 1) * model.h)
        astray = ~np.all(np.abs(x[:, model.parameter_states]) <= LOST, axis=1) | ~np.isfinite(x).all(axis=1)
        if astray.any():
            lost[astray & (lost < 0)] = k + 1
            if np.all(lost >= 0):
                raise _all_lost(model, lost, start[0])
            x[astray] = start[0][astray]
            if not shared:
                P[astray] = start[1][astray]
        store(k + 1)
        gauge_mean[k], gauge_std[k] = apply(model.H, x), output_std(model.H, P)
        if jacobians is not None and k < len(jacobians):
            jacobians[k] = A
    whitened[np.isnan(innovation)] = np.nan
    nis = np.nansum(whitened**2, axis=2)
    for run in np.flatnonzero(lost >= 0):
        means[lost[run] :, run] = np.nan
        for record in (gauge_mean, innovation, whitened, nis):
            record[lost[run] - 1 :, run] = np.nan
    if jacobians is not None:
        jacobians = np.broadcast_to(jacobians, (steps, b, size, size))
    return FilterRun(
        time=model.h * np.arange(steps + 1),
        mean=means,
        std=np.broadcast_to(stds, means.shape),
        unknown_covariance=blocks,
        gauge_mean=gauge_mean,
        gauge_std=np.broadcast_to(gauge_std, gauge_mean.shape),
        innovation=innovation,
        whitened=whitened,
        nis=nis,
        lost=lost,
        covariance=covariances,
        jacobian=jacobians,
    )


def predict(P: np.ndarray, A: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """P⁻ = A P Aᵀ + Q  (1.57), symmetrised; P, A (b, n, n), Q the covariance added in the step."""
    return _symmetric(A @ P @ _T(A) + Q)


def gain(P: np.ndarray, H: np.ndarray, R: np.ndarray, instant: float = np.nan) -> tuple[np.ndarray, np.ndarray]:
    """Kalman gain K = PHᵀS⁻¹ (1.58) and the Cholesky factor L of S = HPHᵀ + R = LLᵀ.

    P (b, n, n); H (m, n) or (b, m, n); R (b, m) variances. Returns K (b, n, m), L (b, m, m).
    Raises NumericalError, with the instant [s], where S is not positive definite.
    """
    HP = H @ P
    S = _symmetric(HP @ _T(H))
    S[..., range(R.shape[-1]), range(R.shape[-1])] += R
    try:
        L = np.linalg.cholesky(S)
    except np.linalg.LinAlgError as error:
        raise NumericalError(
            f"the innovation covariance is not positive definite at {instant:g} s",
            remedy="two gauges may be the same: give them noise, or choose others",
        ) from error
    return _T(np.linalg.solve(_T(L), np.linalg.solve(L, HP))), L


def update(
    x: np.ndarray, P: np.ndarray, H: np.ndarray, R: np.ndarray, innovation: np.ndarray, instant: float = np.nan
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x⁺ = x + Kν (1.59),  P⁺ = (I − KH)P(I − KH)ᵀ + KRKᵀ (Joseph's form of 1.60), symmetrised.

    x (B, n); P (b, n, n); H (m, n) or (b, m, n); R (b, m) variances; innovation ν (B, m).
    Returns x⁺, P⁺ and the whitened innovation L⁻¹ν (B, m).
    Source: Bucy and Joseph, Filtering for Stochastic Processes (1968).
    """
    K, L = gain(P, H, R, instant)
    left = np.eye(P.shape[-1]) - K @ H
    P = _symmetric(left @ P @ _T(left) + (K * R[..., None, :]) @ _T(K))
    return x + apply(K, innovation), P, np.linalg.solve(L, innovation[..., None])[..., 0]


def covariance_recursion(
    model: FilterModel, trajectory: np.ndarray, u: np.ndarray, covariance: np.ndarray
) -> np.ndarray:
    """Standard deviation of x* that the filter will claim along a given motion, for B sets of gauges at once.

    The covariance recursion of `run_filter`, which needs no measurement, with A* at the motion and θ = guess (p = 0).
    trajectory (T + 1, 2n) [q, q̇]; u (T, HOLD, n_u) hold coefficients of all inputs of the model [N], unknown ones too;
    covariance (n*, n*) or (B, n*, n*) of x* at t = 0. Returns std (T + 1, B, n*); B = 1 for one set.
    """
    b = _covariance_runs(model, covariance)
    P = np.broadcast_to(covariance, (b, model.size, model.size)).astype(float)
    Q, R = model.Q * model.h, np.broadcast_to(model.r / model.h, (b, model.H.shape[-2]))
    theta = theta_of(model, np.zeros(model.size))
    modal = modal_step(model.model, theta, model.h)
    nothing = np.zeros((1, R.shape[-1]))
    std = np.empty((len(u) + 1, b, model.size))
    std[0] = standard_deviation(P)
    chunk = 256
    for first in range(0, len(u), chunk):
        span = slice(first, min(first + chunk, len(u)))
        A = augmented_jacobian(model, modal, theta, trajectory[span], u[span])
        for k in range(span.start, span.stop):
            P = predict(P, A[(k - first) % len(A)], Q)
            _, P, _ = update(np.zeros((1, model.size)), P, model.H, R, nothing, instant=(k + 1) * model.h)
            std[k + 1] = standard_deviation(P)
    return std


def standard_deviation(P: np.ndarray) -> np.ndarray:
    """√diag P (..., n); rounding below zero counts as zero."""
    return np.sqrt(np.maximum(np.diagonal(P, axis1=-2, axis2=-1), 0.0))


def output_std(C: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Standard deviation of C x*, √diag(C P Cᵀ); C (m, n*) or (b, m, n*), P (..., n*, n*). Returns (..., m)."""
    return np.sqrt(np.maximum(np.sum((C @ P) * C, axis=-1), 0.0))


def apply(C: np.ndarray, x: np.ndarray) -> np.ndarray:
    """C x for every run: C (m, n) or (b, m, n), x (B, n). Returns (B, m)."""
    return (C @ x[..., None])[..., 0]


def _covariance_runs(model: FilterModel, covariance: np.ndarray) -> int:
    given = ((covariance, 2), (model.H, 2), (model.Q, 2), (model.r, 1))
    return max(len(a) if a.ndim > single else 1 for a, single in given)


def _all_lost(model: FilterModel, lost: np.ndarray, start: np.ndarray) -> NumericalError:
    names = ", ".join(model.unknowns.parameters) or "the state"
    return NumericalError(
        f"the filter diverged: {names} left the guess by more than a factor of {np.exp(LOST):.0f}"
        f" in all of {len(start)} runs, first at {lost.min() * model.h:g} s",
        remedy="choose a guess nearer to the truth, a smaller initial standard deviation or a smaller time step",
    )


def _T(X: np.ndarray) -> np.ndarray:
    return np.swapaxes(X, -1, -2)


def _symmetric(X: np.ndarray) -> np.ndarray:
    return 0.5 * (X + _T(X))
