"""Truths and measurements drawn from the filter's own model, to test whether its σ is honest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.estimation.filter import apply
from strainsight.estimation.model import FilterModel, constant_step, step


def draw_truth(
    model: FilterModel, mean: np.ndarray, covariance: np.ndarray, known: np.ndarray, seeds: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """One run of the filter's own model a seed:

        x*₀ ~ N(mean, P₀),   x*ₖ₊₁ = f(x*ₖ, u) + wₖ,   yₖ = H x*ₖ + vₖ,   wₖ ~ N(0, Q h),   vₖ ~ N(0, r/h)

    mean (n*,) and covariance P₀ (n*, n*) as the filter will be told (P₀, Q may be singular); known (T, HOLD, n_known)
    hold coefficients [N]; the H and r of the model may be one set a run, its Q may not.
    A run depends on its own seed alone. Returns truth x* (T + 1, B, n*) and measurement (T, B, m).
    """
    steps, size = len(known), model.size
    first, walk = covariance_factor(covariance), covariance_factor(model.Q * model.h)
    generators = [np.random.default_rng(seed) for seed in seeds]
    x = mean + np.stack([first @ rng.standard_normal(first.shape[1]) for rng in generators])
    disturbance = np.stack([rng.standard_normal((steps, walk.shape[1])) @ walk.T for rng in generators], axis=1)
    noise = np.stack([rng.standard_normal((steps, model.H.shape[-2])) for rng in generators], axis=1)
    noise *= np.sqrt(model.r / model.h)
    constant = constant_step(model)
    truth, measurement = np.empty((steps + 1, len(seeds), size)), np.empty_like(noise)
    truth[0] = x
    for k in range(steps):
        truth[k + 1] = step(model, truth[k], known[k], constant)[0] + disturbance[k]
        measurement[k] = apply(model.H, truth[k + 1]) + noise[k]
    return truth, measurement


def covariance_factor(P: np.ndarray) -> np.ndarray:
    """F (n, rank) with F Fᵀ = P, P (n, n) positive semidefinite; scaled to diag P = 1 first, so units do not matter."""
    std = np.sqrt(np.diag(P))
    scale = np.where(std > 0, std, 1.0)
    values, vectors = np.linalg.eigh(P / np.outer(scale, scale))
    positive = values > len(P) * np.finfo(float).eps * max(values.max(initial=0.0), 0.0)
    return scale[:, None] * vectors[:, positive] * np.sqrt(values[positive])
