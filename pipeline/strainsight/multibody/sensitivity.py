"""Derivatives of the implicit step by the implicit function theorem (1.53-1.54)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.errors import NumericalError
from strainsight.multibody.compiled.slopes import step_slopes
from strainsight.multibody.step import Step, compiled, point
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
        driven:  ∂r₁/∂p = B_pᵀμ,   ∂r₂/∂p = −B_pᵀλ,   ∂r₃/∂p = B_p v + ∂φ_t/∂p,   ∂r₃/∂ṗ = ∂r₄/∂p = φ_p

    Exact at the new state, where the matrix is factorised once more: the one of Newton's last iteration belongs to the
    state before its last correction. Valid off the constraints too: x_k may be any state, x_{k+1} is on them.
    Raises NumericalError where the matrix is singular.
    """
    own = compiled(system)
    elastic = np.ascontiguousarray((system.stiffness_terms @ at.q + system.damping_terms @ at.v).T)
    regular, A, B_u, B_theta, B_w = step_slopes(
        own.arrays, point(own.at(system, at.theta), at.start, at.u, at.h, at.w), at.theta, at.memory.copy(), at.q, at.motion,
        at.mu, at.lam, elastic,
    )  # fmt: skip
    if not regular:
        raise NumericalError("the matrix of the step is singular")
    return Sensitivities(A, B_u, B_theta, B_w)
