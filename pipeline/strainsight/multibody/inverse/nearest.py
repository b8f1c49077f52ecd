"""A state put back on its constraints, fast: for states that are close to them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs

from strainsight.errors import InfeasibleError
from strainsight.multibody.initial import moving_constraints, project_position
from strainsight.multibody.system import System

ITERATIONS = 20
ROUNDING = 1e-15
"""A correction below this, beside the state in the metric, is none."""
TINY = float(np.finfo(float).tiny)


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
    before, per = np.inf, 1 / d
    for _ in range(ITERATIONS):
        phi, B, rate = moving_constraints(system, q, u)
        across = _factor(B * per)
        if across is None:
            break
        x = _across(across, phi)
        q -= x * per
        y = d * q
        size, whole = math.sqrt(x @ x), math.sqrt(y @ y)
        if not math.isfinite(size):
            break
        if size <= ROUNDING * whole or (size < 1e-12 * whole and size > 0.3 * before):
            y = d * v
            for _ in range(2):
                y = y - _across(across, B @ (y * per) + rate)
            return q, y * per
        before = size
    project_position(system, q, u)
    raise InfeasibleError(
        "the joints cannot be satisfied near this configuration",
        remedy="take a smaller time step, or iterate the update",
    )


class _Across(NamedTuple):
    """Lengths⁻¹ s (m,) of the rows of B, these as units (m, n), and Cholesky's factor of unit unitᵀ."""

    s: np.ndarray
    unit: np.ndarray
    lower: np.ndarray


def _factor(B: np.ndarray) -> _Across | None:
    """None where BBᵀ is singular."""
    s = 1 / np.maximum(np.sqrt(np.einsum("ij,ij->i", B, B)), TINY)
    unit = s[:, None] * B
    lower, info = dpotrf(unit @ unit.T, lower=1)
    return _Across(s, unit, lower) if info == 0 else None


def _across(B: _Across, value: np.ndarray) -> np.ndarray:
    """Bᵀ(BBᵀ)⁻¹ value."""
    return np.asarray(dpotrs(B.lower, B.s * value, lower=1)[0] @ B.unit)
