"""Input models over one time step: transition, the load they hold within it, and the noise they gather."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm, matrix_balance

from strainsight.augmentation.input_models import RandomWalk
from strainsight.augmentation.unknowns import Unknowns


def input_transition(unknowns: Unknowns, h: float) -> np.ndarray:
    """exp(A_u h) (k, k) of ζ of all inputs."""
    return np.eye(len(unknowns.inputs)) if _all_walk(unknowns) else expm(unknowns.rate_matrix() * h)


def input_hold(unknowns: Unknowns, h: float) -> np.ndarray:
    """Hold coefficients of the unknown inputs within a step as rows on ζ at its start: uⱼ = Rⱼ ζ, R (HOLD, n_ũ, k) [N].

        u₀ = u(0),   u₁ = −3u(0) + 4u(½) − u(1),   u₂ = 2u(0) − 4u(½) + 2u(1),   u(s) = amplitude C_u exp(A_u s h) ζ

    Exact for both random walks; the others err by the hold's own (ωh)³ω₀h/720 of the motion they cause.
    """
    inputs = len(unknowns.inputs)
    first = np.cumsum([0, *unknowns.lengths])[:-1]
    left = np.zeros((inputs, sum(unknowns.lengths)))
    left[range(inputs), first] = unknowns.scale[:inputs]
    middle = left @ input_transition(unknowns, 0.5 * h)
    right = left @ input_transition(unknowns, h)
    return np.stack([left, -3 * left + 4 * middle - right, 2 * left - 4 * middle + 2 * right])


def process_covariance(F: np.ndarray, Q: np.ndarray, h: float) -> np.ndarray:
    """Covariance (..., n, n) that ẋ = F x + w gathers in a step, w of intensity Q:

        Q_h = ∫₀ʰ exp(F s) Q exp(F s)ᵀ ds,     by Q_2s = Q_s + Φ_s Q_s Φ_sᵀ from a part of the step in which little turns

    Q h alone would leave the motion that an unknown load causes while it drifts within the step: next to nothing for a
    strain, but an accelerometer reads the load at the end of the step, which has not moved the structure yet, and a filter
    that does not know of it is overconfident. For h → 0 it is Q h.
    F (n, n) [1/s]; Q (..., n, n) intensity; h [s]. Source: Van Loan, IEEE Trans. Automatic Control 23 (1978).
    """
    n = len(F)
    balanced, (scale, _) = matrix_balance(F, permute=False, separate=True)
    turns = np.abs(np.linalg.eigvals(balanced)).max(initial=0.0) * h
    halvings = max(0, int(np.ceil(np.log2(max(turns, 1e-300) / PART))))
    part = h / 2**halvings
    units = np.outer(scale, scale)
    # Q_h is linear in Q, and a large Q would spoil the exponential of the rest
    units = units * (float(np.abs(Q / units).max(initial=0.0)) or 1.0)
    generator = np.zeros((*Q.shape[:-2], 2 * n, 2 * n))
    generator[..., :n, :n], generator[..., n:, n:], generator[..., :n, n:] = -balanced, balanced.T, Q / units
    exponential = expm(generator * part)
    turned = np.swapaxes(exponential[..., n:, n:], -1, -2)
    gathered = turned @ exponential[..., :n, n:]
    for _ in range(halvings):
        gathered = gathered + turned @ gathered @ np.swapaxes(turned, -1, -2)
        turned = turned @ turned
    gathered = gathered * units
    return np.asarray(0.5 * (gathered + np.swapaxes(gathered, -1, -2)))


PART = 0.5
"""Radians that the fastest state may turn in the part of a step that `process_covariance` begins with."""


def _all_walk(unknowns: Unknowns) -> bool:
    return all(isinstance(unknowns.model_of(name), RandomWalk) for name in unknowns.inputs)
