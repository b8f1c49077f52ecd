"""The limit of slow loads: a reduced model whose coordinates follow K(θ) q = S(θ) u."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.fem.affine import AffineOperator
from strainsight.rom.model import Damping, ReducedModel

FASTER = 100.0
"""ω_s over ω of the first mode."""
RATIO = 0.7
"""Damping ratio of the coordinates: with it they follow soonest, without swinging."""


def quasi_static(model: ReducedModel, basis: np.ndarray) -> tuple[ReducedModel, np.ndarray]:
    """The model with M = K(θ₀)/ω_s² in place of its mass, and its basis, in coordinates where again M = I, K(θ₀) = Λ = ω_s² I:

        Ψ′ = Ψ ω_s Λ^(−1/2),    K′(θ) = ω_s² Λ^(−1/2) K(θ) Λ^(−1/2),    S′ = ω_s Λ^(−1/2) S

    All coordinates have one frequency, ω_s = 100 ω₁, and are damped by 0.7 of critical: under a load of frequency ω they
    lag behind their static response by 1.4 ω/ω_s, 1.4e-3 at a tenth of the first mode, and have forgotten how they began
    before the first sample. So filter, bank and placement are those of a model with inertia. What inertia adds, (ω/ω₁)², is
    left out. model modal at the reference; basis Ψ (n_free, r) [1/√kg]; densities change nothing but their loads.
    """
    stiffness = np.diag(model.stiffness.at(model.reference))
    speed = FASTER * np.sqrt(stiffness.min())
    D = np.diag(speed / np.sqrt(stiffness))
    return (
        replace(
            model,
            mass=AffineOperator(np.eye(model.size), {}),
            stiffness=model.stiffness.project(D),
            input_shape=D @ model.input_shape,
            input_slope={name: D @ slope for name, slope in model.input_slope.items()},
            damping=Damping("modal", RATIO),
        ),
        basis @ D,
    )
