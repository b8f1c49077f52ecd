"""Truths and measurements drawn from the filter's own model, and linear models of full matrices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.estimation.model import FilterModel
from strainsight.estimation.parallel_filters import ModalMotion
from strainsight.estimation.reduced import DrivenModel
from strainsight.estimation.update import covariance_factor


def draw_truth(
    model: FilterModel, mean: np.ndarray, covariance: np.ndarray, known: np.ndarray, seeds: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """One run of the filter's own model a seed:

        x*₀ ~ N(mean, P₀),   x*ₖ₊₁ = f(x*ₖ, u) + wₖ,   yₖ = h(x*ₖ) + vₖ,   wₖ ~ N(0, Q_h),   vₖ ~ N(0, R)

    mean (n*,) and covariance P₀ (n*, n*) as the filter is given them (P₀, Q may be singular); known (T, HOLD, n_known)
    hold coefficients [N]; the H and r of the model may be one set a run, its Q may not.
    A run depends on its own seed alone. Returns truth x* (T + 1, B, n*) and measurement (T/every, B, m).
    """
    steps, size = len(known), model.size
    first, walk = covariance_factor(covariance), covariance_factor(model.process)
    generators = [np.random.default_rng(seed) for seed in seeds]
    x = mean + np.stack([first @ rng.standard_normal(first.shape[1]) for rng in generators])
    disturbance = np.stack([rng.standard_normal((steps, walk.shape[1])) @ walk.T for rng in generators], axis=1)
    noise = np.stack([rng.standard_normal((steps, model.H.shape[-2])) for rng in generators], axis=1)
    noise *= np.sqrt(model.noise)
    driven = DrivenModel(model, known)
    truth, measurement = np.empty((steps + 1, len(seeds), size)), np.empty_like(noise)
    truth[0] = x
    for k in range(steps):
        truth[k + 1] = driven.step(truth[k], k)[0] + disturbance[k]
        measurement[k] = driven.measure(truth[k + 1], k)[0] + noise[k]
    return truth, measurement[model.every - 1 :: model.every]


def plain_motion(A: np.ndarray, G: np.ndarray, A_nu: np.ndarray, G_nu: np.ndarray) -> ModalMotion:
    """Of full matrices A (B, n, n), G (B, n, p), A_ν (B, e, n, n) and G_ν (B, e, n, p), no mode apart."""
    one, pairs = np.tile(np.eye(A.shape[-1]), (len(A), 1, 1)), np.zeros((len(A), 4, 0))
    pairs_nu = np.zeros((*A_nu.shape[:2], 4, 0))
    return ModalMotion(one, one, pairs, np.swapaxes(A, -1, -2), G, pairs_nu, np.swapaxes(A_nu, -1, -2), G_nu)
