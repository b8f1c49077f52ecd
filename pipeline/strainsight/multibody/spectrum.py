"""Small undamped motions about a state: how fast the coupled system moves by itself."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh, null_space

from strainsight.multibody.equations import balance
from strainsight.multibody.initial import constraints_at
from strainsight.multibody.system import System

RIGID = 1e-6
"""Share of the highest frequency below which a motion counts as free."""


def coupled_frequencies(system: System, q: np.ndarray, v: np.ndarray, u: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Undamped natural frequencies [Hz], ascending, of the system held where it is:

        Nᵀ(K_T − Σ λ ∇²φ)N a = ω² NᵀMN a,     B N = 0

    q on the constraints; v only sets the forces that depend on it; K_T the tangent of all forces, λ the constraint forces that
    balance them. Free motions (ω = 0) and those that the loads make unstable are left out.
    """
    n, m = system.size, system.constrained
    elastic = system.at(theta)
    zero = np.zeros(n)
    at = balance(system, q, v, zero, np.zeros(m), np.zeros(m), u, theta, elastic)
    d = system.metric
    lam = np.linalg.lstsq((at.B / d).T, at.load / d, rcond=None)[0] if m else np.zeros(0)
    at = balance(system, q, v, zero, np.zeros(m), lam, u, theta, elastic)
    K, M = at.stiffness / np.outer(d, d), at.mass / np.outer(d, d)
    if m:
        N = null_space(constraints_at(system, q)[1] / d)
        K, M = N.T @ K @ N, N.T @ M @ N
    lam2 = eigh(0.5 * (K + K.T), M, eigvals_only=True)
    moving = lam2[lam2 > (RIGID**2) * lam2[-1]] if len(lam2) else lam2
    return np.sqrt(moving) / (2 * np.pi)
