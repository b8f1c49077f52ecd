"""Viscous damping of the whole model: proportional to mass and stiffness, and given mode by mode."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy import sparse

from strainsight.fem.modes import modes as lowest_modes


@dataclass(frozen=True)
class ViscousDamping:
    """C = αM + βK + Σ_i c_i (Mφ_i)(Mφ_i)ᵀ.

    alpha α [1/s]; beta β [s]; frequency ω (N,) [rad/s] and shapes φ (n_free, N) [1/√kg] of the lowest modes, at the same
    parameters as K and M; rate c (N,) [1/s].
    """

    alpha: float = 0.0
    beta: float = 0.0
    frequency: np.ndarray = field(default_factory=lambda: np.zeros(0))
    shapes: np.ndarray | None = None
    rate: np.ndarray = field(default_factory=lambda: np.zeros(0))


def modal_damping(
    K: sparse.csr_array,
    M: sparse.csr_array,
    ratio: float,
    modes: int,
    above: Literal["stiffness", "none"] = "stiffness",
    rigid: np.ndarray | None = None,
) -> ViscousDamping:
    """The ratio ζ in each of the lowest N modes, exactly; above them, as no sparse C has one ratio for all modes:

        "stiffness"   β = 2ζ/ω_N,  c_i = 2ζω_i − βω_i²:  the ratio grows as ζω/ω_N from ζ on, and static responses stay
        "none"        β = 0,       c_i = 2ζω_i:           nothing

    K, M (n, n); modes N ≥ 1; rigid (n, k): the rigid motions of a free structure, which are not damped. Raises the errors of
    `fem.modes.modes`.
    """
    frequency, shapes = lowest_modes(K, M, modes, rigid=rigid)
    omega = 2 * np.pi * frequency
    beta = 2 * ratio / omega[-1] if above == "stiffness" else 0.0
    return ViscousDamping(0.0, beta, omega, shapes, 2 * ratio * omega - beta * omega**2)
