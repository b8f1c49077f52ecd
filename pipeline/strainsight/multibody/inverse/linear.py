"""The system as a linear one in the coordinates that its constraints leave."""

from __future__ import annotations

import numpy as np

from strainsight.multibody.equations import input_slopes
from strainsight.multibody.spectrum import tangent_space
from strainsight.multibody.system import System


def linearised(
    system: System, q: np.ndarray, u: np.ndarray, theta: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """T (n, r), M, C, K (r, r), B_u (r, nu) of small motions about an equilibrium q (n,) under u (nu,), θ (nθ,):

        q + T y,   B(q) T = 0,      M ÿ + C ẏ + K y = B_u Δu
        M = TᵀM(q)T,   C = Tᵀ(∂f/∂v)T,   K = Tᵀ(∂f/∂q − Σ λ ∇²φ)T symmetrised,   B_u = −Tᵀ ∂f/∂u

    T orthonormal in the metric of the mass, so y is in m √kg. u holds all inputs of the system, B_u a column for each.
    """
    found = tangent_space(system, q, np.zeros(system.size), u, theta)
    M, C, K = (found.project(X) for X in (found.at.mass, found.at.damping, found.at.stiffness))
    force = -found.T.T @ input_slopes(system, found.at, np.asarray(q, dtype=float))
    return found.T, 0.5 * (M + M.T), C, 0.5 * (K + K.T), force
