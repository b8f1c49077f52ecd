"""The fixed-interval smoother: what all strains, also the later ones, say about every instant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.estimation.filter import FilterRun, apply, gain, predict, standard_deviation
from strainsight.estimation.model import FilterModel


@dataclass(frozen=True)
class Smoothed:
    """mean, std (T + 1, B, n*) of x* given all measurements; covariance (T + 1, b, n*, n*) if asked; time [s]."""

    time: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    covariance: np.ndarray | None


def smooth(model: FilterModel, run: FilterRun, covariance: bool = False) -> Smoothed:
    """The Rauch-Tung-Striebel estimate in the adjoint form of Bryson and Frazier, which inverts neither P nor P⁻:

        x̂ˢ = x̂ − P λ,      λ⁻ = (I − KH)ᵀλ − HᵀS⁻¹ν,             λ ← A*ᵀλ⁻
        Pˢ = P − P Λ P,     Λ⁻ = (I − KH)ᵀΛ(I − KH) + HᵀS⁻¹H,      Λ ← A*ᵀΛ⁻A*

    backwards from λ = 0, Λ = 0 at the last instant.

    run: `run_filter(..., keep="all")` of the same model. A singular P⁻ (states without process noise) needs no care.
    Raises ValueError where the run was not kept.
    Source: Bierman, Fixed interval smoothing with discrete measurements, Int. J. Control 18 (1973); for the extended
    filter the Jacobians are those along the filtered estimate.
    """
    if run.covariance is None or run.jacobian is None:
        raise ValueError("the smoother needs a run kept with keep='all'")
    steps, runs, gauges = run.innovation.shape
    b, size = run.covariance.shape[1:3]
    Q, R = model.Q * model.h, np.broadcast_to(model.r / model.h, (b, gauges))
    adjoint, information = np.zeros((runs, size)), np.zeros((b, size, size))
    mean, std = np.empty_like(run.mean), np.empty((steps + 1, b, size))
    kept = np.empty_like(run.covariance) if covariance else None
    for k in range(steps, -1, -1):
        P = run.covariance[k]
        PInformation = P @ information
        mean[k] = run.mean[k] - apply(P, adjoint)
        std[k] = np.sqrt(np.maximum(standard_deviation(P) ** 2 - np.sum(PInformation * P, axis=-1), 0.0))
        if kept is not None:
            smoothed = P - PInformation @ P
            kept[k] = 0.5 * (smoothed + np.swapaxes(smoothed, -1, -2))
        if k == 0:
            break
        A = run.jacobian[k - 1]
        innovation = run.innovation[k - 1]
        missing = np.isnan(innovation)
        H = np.where(missing[..., None], 0.0, model.H) if missing.any() else model.H
        K, L = gain(predict(run.covariance[k - 1], A, Q), H, R, instant=run.time[k])
        whitened_rows = np.linalg.solve(L, np.broadcast_to(H, (b, gauges, size)))
        whitened = np.nan_to_num(run.whitened[k - 1])
        left = np.eye(size) - K @ H
        leftT, AT, rowsT = (np.swapaxes(X, -1, -2) for X in (left, A, whitened_rows))
        adjoint = apply(AT, apply(leftT, adjoint) - apply(rowsT, whitened))
        information = AT @ (leftT @ information @ left + rowsT @ whitened_rows) @ A
        information = 0.5 * (information + np.swapaxes(information, -1, -2))
    return Smoothed(run.time, mean, np.broadcast_to(std, mean.shape), kept)
