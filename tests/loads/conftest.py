"""A chain of masses and springs with two loads: K and M partly parametric, so that nothing commutes by accident."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from strainsight.fem.affine import AffineOperator
from strainsight.rom.model import Damping, ReducedModel

theta = {"E": 2.1e11, "rho": 7800.0}


def chain_of(size: int = 5, *, ground: float = 3e6, extra: float = 0.7, damping: Damping | None = None) -> ReducedModel:
    """`ground` springs to the floor (K₀) and `extra` masses (M₀); zero makes the model homogeneous in E and ρ."""
    rng = np.random.default_rng(5)
    stiffness = rng.uniform(0.5, 2.0, size) * 1e7 / theta["E"]
    K1 = np.diag(stiffness) + np.diag([*stiffness[1:], 0.0]) - np.diag(stiffness[1:], 1) - np.diag(stiffness[1:], -1)
    M1 = np.diag(rng.uniform(1, 3, size)) / theta["rho"]
    K0, M0 = ground * np.diag(rng.uniform(0, 1, size)), extra * np.diag(rng.uniform(0, 1, size))
    _, Phi = eigh(K0 + theta["E"] * K1, M0 + theta["rho"] * M1)
    S = np.zeros((size, 2))
    S[-1, 0] = S[1, 1] = 1.0
    return ReducedModel(
        mass=AffineOperator(M0, {"rho": M1}).project(Phi),
        stiffness=AffineOperator(K0, {"E": K1}).project(Phi),
        input_shape=Phi.T @ S,
        inputs=("tip", "side"),
        reference=dict(theta),
        damping=damping or Damping("modal", ratio=0.02),
    )
