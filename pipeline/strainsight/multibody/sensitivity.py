"""Derivatives of the implicit step by the implicit function theorem (1.53-1.54)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.multibody.drives import Driven
from strainsight.multibody.equations import balance, input_slopes, parameter_slopes
from strainsight.multibody.newton import StepMatrix, step_matrix
from strainsight.multibody.step import Step
from strainsight.multibody.system import System


@dataclass(frozen=True)
class Sensitivities:
    """∂(q, v)_{k+1} with respect to (q, v)_k: A (2n, 2n); u, with p and ṗ: B_u (2n, width); θ: B_theta (2n, nθ);
    w: B_w (2n, n)."""

    A: np.ndarray
    B_u: np.ndarray
    B_theta: np.ndarray
    B_w: np.ndarray


def sensitivities(system: System, at: Step) -> Sensitivities:
    """Of the step r(z; x_k, u, θ, w) = 0, z = (q, v, μ, λ)_{k+1}:  ∂z/∂p = −(∂r/∂z)⁻¹ ∂r/∂p.

        ∂r₁/∂q_k = −D²/h,   ∂r₂/∂v_k = −M/h,   ∂r₂/∂u = ∂f/∂u,   ∂r₂/∂θ = ∂f/∂θ,   ∂r₂/∂w = −1

    Exact at the new state, where the matrix is factorised once more: the one of Newton's last iteration belongs to the
    state before its last correction. Valid off the constraints too: x_k may be any state, x_{k+1} is on them.
    """
    n, h, d = system.size, at.h, system.metric
    acceleration = (at.v - at.start[1]) / h
    here = balance(system, at.q, at.v, acceleration, at.mu, at.lam, at.u, at.theta, system.at(at.theta))
    matrix = step_matrix(here, d, h)
    r1, r2, none = np.zeros((n, 2 * n)), np.zeros((n, 2 * n)), np.zeros((system.constrained, 2 * n))
    np.fill_diagonal(r1[:, :n], d * d / h)
    np.fill_diagonal(r2[:, n:], 1.0)
    whole = np.concatenate(matrix.solve(r1, r2, none, none)[:2])
    # v_k, u and θ act through the second equation, as w does
    from_q, B_w = whole[:, :n], whole[:, n:]
    others = [here.mass / h, -input_slopes(system, here, at.q), -parameter_slopes(system, here, at.q, at.v)]
    widths = np.cumsum([part.shape[1] for part in others[:2]])
    from_v, B_u, B_theta = np.split(B_w @ np.concatenate(others, axis=1), widths, axis=1)
    if here.driven is not None:
        B_u = np.concatenate([B_u, _by_drives(system, at, here.driven, matrix)], axis=1)
    return Sensitivities(np.concatenate([from_q, from_v], axis=1), B_u, B_theta, B_w)


def _by_drives(system: System, at: Step, driven: Driven, matrix: StepMatrix) -> np.ndarray:
    """By p and by ṗ (2n, 2 nd):  ∂r₁/∂p = B_pᵀμ,  ∂r₂/∂p = −B_pᵀλ,  ∂r₃/∂p = B_p v + ∂φ_t/∂p,  ∂r₃/∂ṗ = ∂r₄/∂p = φ_p."""
    n, m, nd = system.size, system.constrained, len(system.drives.names)
    r1, r2, r3, r4 = (np.zeros((rows, 2 * nd)) for rows in (n, n, m, m))
    for i, (row, k) in enumerate(zip(system.drives.row, system.drives.which, strict=True)):
        r1[:, k] -= driven.gradient[i] * at.mu[row]
        r2[:, k] += driven.gradient[i] * at.lam[row]
        r3[row, k] -= driven.gradient[i] @ at.v + driven.bend[i]
        r3[row, nd + k] -= driven.slope[i]
        r4[row, k] -= driven.slope[i]
    return np.concatenate(matrix.solve(r1, r2, r3, r4)[:2])
