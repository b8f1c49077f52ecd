"""A static equilibrium followed as the parameters change: from one that is known, along its slopes, by Newton's own steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.errors import NumericalError
from strainsight.multibody.equations import balance, parameter_slopes
from strainsight.multibody.inverse.start import static_response
from strainsight.multibody.static import CONVERGED, ROUNDING, in_the_metric, refuse_free, static_equilibrium
from strainsight.multibody.system import System

STEPS = 8
"""Of Newton's iteration; one that has not ended by then began too far away."""


@dataclass(frozen=True, eq=False)
class Rest:
    """q (n,), λ (m,) in equilibrium at θ (nθ,), and by_theta (n, nθ) = ∂q/∂θ."""

    theta: np.ndarray
    q: np.ndarray
    lam: np.ndarray
    by_theta: np.ndarray


def rest_at(system: System, q: np.ndarray, u: np.ndarray, theta: np.ndarray) -> Rest:
    """The equilibrium under u near q (n,). Raises what `static_equilibrium` and `static_response` raise."""
    q, lam = static_equilibrium(system, q, u, theta, near=True)
    return Rest(theta, q, lam, static_response(system, q, u, theta)[1])


def followed(system: System, known: Rest, u: np.ndarray, theta: np.ndarray) -> Rest:
    """The equilibrium at θ (nθ,), from one that is known under the same loads u, by

        [K  −Bᵀ] [Δq  ∂q]     [f  ∂f/∂θ]
        [B   0 ] [λ'  ∂λ] = − [φ  0    ]

    from q + ∂q Δθ; where that does not end it is sought as by `rest_at`. Raises InfeasibleError, as
    that does, where nothing holds some motion at θ.
    """
    return _newton(system, known, u, theta) or rest_at(system, known.q, u, theta)


def _newton(system: System, known: Rest, u: np.ndarray, theta: np.ndarray) -> Rest | None:
    d, n, m = system.metric, system.size, system.constrained
    q, lam, elastic = known.q + known.by_theta @ (theta - known.theta), known.lam, system.at(theta)
    still, none, before = np.zeros(n), np.zeros(m), np.inf
    right = np.zeros((n + m, 1 + len(theta)))
    for _ in range(STEPS):
        try:
            at = balance(system, q, still, still, none, lam, u, theta, elastic)
            K, B, s = in_the_metric(at, d)
            right[:n, 0], right[n:, 0] = -at.load / d, -s * at.phi
            right[:n, 1:] = -parameter_slopes(system, at, q, still) / d[:, None]
            z = np.linalg.solve(np.block([[K, -B.T], [B, np.zeros((m, m))]]), right)
        except (NumericalError, np.linalg.LinAlgError):
            return None
        size, whole = float(np.linalg.norm(z[:n, 0])), float(np.linalg.norm(d * q)) or 1.0
        q, lam = q + z[:n, 0] / d, z[n:, 0] * s
        if size <= CONVERGED * whole or (size < ROUNDING * whole and size > 0.3 * before):
            refuse_free(system, K, B)
            return Rest(theta, q, lam, z[:n, 1:] / d[:, None])
        if not size < before:
            return None
        before = size
    return None
