"""A state put back on its constraints, fast: for states that are close to them."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dposv

from strainsight.errors import InfeasibleError
from strainsight.multibody.initial import moving_constraints, project_position
from strainsight.multibody.system import System

ITERATIONS = 20
ROUNDING = 1e-15
"""A correction below this, beside the state in the metric, is none."""


def nearest_state(
    system: System, q: np.ndarray, v: np.ndarray, u: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """q, v (n,) with φ(q) = 0 and B(q)v = −φ_t, nearest in the metric of the mass:

        q ← q − D⁻²Bᵀ(BD⁻²Bᵀ)⁻¹φ(q) until it rests,     v ← v − D⁻²Bᵀ(BD⁻²Bᵀ)⁻¹(Bv + φ_t)

    as `project_position` and `project_velocity`, without their questions whether the joints are independent: that is for
    the start. u as of `constraints_at`. Raises InfeasibleError as `project_position` does, where no configuration nearby
    satisfies the joints.
    """
    q, d = np.array(q, dtype=float), system.metric
    if not system.constrained:
        return q, np.array(v, dtype=float)
    before = np.inf
    for _ in range(ITERATIONS):
        phi, B, rate = moving_constraints(system, q, u)
        x = _across(B / d, phi)
        if x is None:
            break
        q -= x / d
        size, whole = float(np.linalg.norm(x)), float(np.linalg.norm(d * q))
        if size <= ROUNDING * whole or (size < 1e-12 * whole and size > 0.3 * before):
            B = B / d
            y = d * v
            for _ in range(2):
                x = _across(B, B @ y + rate)
                if x is None:
                    break
                y = y - x
            else:
                return q, y / d
            break
        before = size
    project_position(system, q, u)
    raise InfeasibleError(
        "the joints cannot be satisfied near this configuration",
        remedy="take a smaller time step, or iterate the update",
    )


def _across(B: np.ndarray, value: np.ndarray) -> np.ndarray | None:
    """Bᵀ(BBᵀ)⁻¹ value by Cholesky of unit rows; None where BBᵀ is singular."""
    s = 1 / np.maximum(np.sqrt(np.einsum("ij,ij->i", B, B)), np.finfo(float).tiny)
    unit = s[:, None] * B
    _, z, info = dposv(unit @ unit.T, s * value)
    return unit.T @ z if info == 0 and np.all(np.isfinite(z)) else None
