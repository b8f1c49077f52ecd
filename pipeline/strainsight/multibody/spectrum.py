"""Small undamped motions about a state: how fast the coupled system moves by itself."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh, null_space

from strainsight.multibody.equations import balance
from strainsight.multibody.initial import constraints_at
from strainsight.multibody.system import System

ROUNDING = 100.0
"""Times n eps ‖K‖, K before its terms cancel: a stiffness below is none."""


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
    scale = float(np.linalg.norm(at.stiffness / np.outer(d, d)))
    K, M, N = at.stiffness, at.mass, np.eye(n)
    if m:
        lam = np.linalg.lstsq((at.B / d).T, at.load / d, rcond=None)[0]
        K = balance(system, q, v, zero, np.zeros(m), lam, u, theta, elastic).stiffness
        scale += float(np.linalg.norm((K - at.stiffness) / np.outer(d, d)))
        N = null_space(constraints_at(system, q)[1] / d)
    K, M = (N.T @ (X / np.outer(d, d)) @ N for X in (K, M))
    values = eigh(0.5 * (K + K.T), 0.5 * (M + M.T), eigvals_only=True) if len(K) else np.zeros(0)
    return np.sqrt(values[values > ROUNDING * n * np.finfo(float).eps * scale]) / (2 * np.pi)
