"""How far an estimate is from the truth, in the two numbers that reports quote."""

from __future__ import annotations

import numpy as np


def parameter_error(estimate: np.ndarray, truth: float) -> np.ndarray:
    """|mean of the estimate over the last half − θ| / |θ|; estimate (T + 1, ...) in the unit of θ. Returns (...)."""
    return np.abs(np.mean(estimate[len(estimate) // 2 :], axis=0) - truth) / abs(truth)


def input_error(estimate: np.ndarray, truth: np.ndarray, burn_in: float = 0.1) -> np.ndarray:
    """RMS error of every component over the RMS of the load vector, √(mean eᵢ²) / √(mean |u|²), after the first tenth.

    estimate (T + 1, ..., n_u) and truth (T + 1, n_u), or of the estimate's shape, in one unit;
    burn_in: the share left out.
    Returns (..., n_u). Raises ValueError where the true load is zero.
    """
    while truth.ndim < estimate.ndim:
        truth = np.expand_dims(truth, 1)
    start = int(np.ceil(burn_in * len(estimate)))
    load = np.sqrt(np.mean(np.sum(truth[start:] ** 2, axis=-1, keepdims=True), axis=0))
    if not np.all(load > 0):
        raise ValueError("the true load is zero: a relative error has no meaning")
    return np.sqrt(np.mean((estimate[start:] - truth[start:]) ** 2, axis=0)) / load


def honesty(error: np.ndarray, std: np.ndarray, burn_in: float = 0.1) -> np.ndarray:
    """Real error over claimed one, √(mean e²) / √(mean σ²) over time and runs, after the first tenth: 1 is honest.

    error, std (T + 1, B, k), estimate less truth. Returns (k,).
    """
    start = int(np.ceil(burn_in * len(error)))
    return np.sqrt(np.mean(error[start:] ** 2, axis=(0, 1)) / np.mean(std[start:] ** 2, axis=(0, 1)))
