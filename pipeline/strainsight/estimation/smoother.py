"""The fixed-interval smoother: what all strains, also the later ones, say about every instant."""

from __future__ import annotations

import numpy as np

from strainsight.estimation.core import StepModel
from strainsight.estimation.filter import FilterRun
from strainsight.estimation.model import FilterModel
from strainsight.estimation.reduced import Driven
from strainsight.estimation.smoothed import Smoothed
from strainsight.estimation.update import apply, gain, predict, standard_deviation, symmetric, transposed
from strainsight.rom.oscillator import HOLD


def smooth(model: FilterModel | StepModel, run: FilterRun, covariance: bool = False) -> Smoothed:
    """The Rauch-Tung-Striebel estimate in the adjoint form of Bryson and Frazier, which inverts neither P nor P⁻:

        x̂ˢ = x̂ − P λ,      λ⁻ = (I − KH)ᵀλ − HᵀS⁻¹ν,             λ ← Aᵀλ⁻
        Pˢ = P − P Λ P,     Λ⁻ = (I − KH)ᵀΛ(I − KH) + HᵀS⁻¹H,      Λ ← AᵀΛ⁻A

    backwards from λ = 0, Λ = 0 at the last instant.

    run: `run_filter(..., keep="all")` or `run_sigma_points` of the same model, in any form and by any update. A singular
    P⁻ (states without process noise) needs no care.
    A nonlinear model is smoothed along the Jacobians, or the regressions, that its filter used.
    Raises ValueError where the run was not kept, or the first one alone of several.
    Source: Bierman, Fixed interval smoothing with discrete measurements, Int. J. Control 18 (1973).
    """
    if run.covariance is None or run.jacobian is None or run.rows is None or run.adjusted is None:
        raise ValueError("the smoother needs a run kept with keep='all'")
    if run.covariance.shape[1] != run.unknown_covariance.shape[1]:
        raise ValueError("only the first run was kept")
    core = Driven(model, np.zeros((0, HOLD, 0))) if isinstance(model, FilterModel) else model
    steps, runs, channels = run.innovation.shape
    b, size = run.covariance.shape[1:3]
    missing = np.isnan(run.adjusted) if b > 1 else np.isnan(run.adjusted).all(axis=1, keepdims=True)
    whitened = np.nan_to_num(run.adjusted)
    adjoint, information = np.zeros((runs, size)), np.zeros((b, size, size))
    mean, std = np.empty_like(run.mean), np.empty((steps + 1, b, size))
    kept = np.empty_like(run.covariance) if covariance else None
    for k in range(steps, -1, -1):
        P = run.covariance[k]
        PInformation = P @ information
        mean[k] = run.mean[k] - apply(P, adjoint)
        std[k] = np.sqrt(np.maximum(standard_deviation(P) ** 2 - np.sum(PInformation * P, axis=-1), 0.0))
        if kept is not None:
            kept[k] = symmetric(P - PInformation @ P)
        if k == 0:
            break
        A = run.jacobian[k - 1]
        if not missing[k - 1].all():
            H, before = run.rows[k - 1], core.before(k - 1)
            H = np.where(missing[k - 1][..., None], 0.0, H) if missing[k - 1].any() else H
            P = run.covariance[k - 1] if before is None else run.covariance[k - 1] + before
            R = np.broadcast_to(core.noise(k - 1), (b, channels)) if run.noise is None else run.noise[k - 1]
            process = core.process(k - 1) if run.process is None else run.process[k - 1]
            K, L = gain(predict(P, A, process), H, R, instant=run.time[k])
            whitened_rows = np.linalg.solve(L, np.broadcast_to(H, (b, channels, size)))
            left = np.eye(size) - K @ H
            adjoint = apply(transposed(left), adjoint) - apply(transposed(whitened_rows), whitened[k - 1])
            information = transposed(left) @ information @ left + transposed(whitened_rows) @ whitened_rows
        adjoint = apply(transposed(A), adjoint)
        information = symmetric(transposed(A) @ information @ A)
    return Smoothed(run.time, mean, np.broadcast_to(std, mean.shape), kept)
