"""Forces: each is conjugate to relations, Q = −∇ρᵀ F, but for the moment, which has no potential."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from strainsight.multibody.frames import Frame
from strainsight.multibody.relations import Relation


class ForceLaw(Protocol):
    """F(ρ, θ): the load that holds the relations at ρ; for the bearing (1.21-1.25), F = ∂Π/∂ρ."""

    def load(self, rho: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F (k,), ∂F/∂ρ (k, k), ∂F/∂θ (k, number of parameters), from ρ (k,) and the element's own parameters."""


@dataclass(frozen=True)
class RelativeElement:
    """A force law on relations between frames: Q = −∇ρᵀ (F(ρ, θ) + D ρ̇).

    relations (k): their value is subtracted, so ρ is measured from it; law: F and its slopes; parameters: names of θ
    among the system's; damping D (k, k) or None.
    """

    name: str
    relations: tuple[Relation, ...]
    law: ForceLaw
    parameters: tuple[str, ...] = ()
    damping: np.ndarray | None = None


@dataclass(frozen=True)
class LinearLaw:
    """F = (K + Σ θ_j K_j)(ρ − rest); stiffness K (k, k), rest (k,), terms K_j in the order of the parameters."""

    stiffness: np.ndarray
    rest: np.ndarray
    terms: tuple[np.ndarray, ...] = ()

    def load(self, rho: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        apart = rho - self.rest
        K = self.stiffness
        slopes = np.empty((len(rho), len(self.terms)))
        for j, term in enumerate(self.terms):
            K = K + theta[j] * term
            slopes[:, j] = term @ apart
        return K @ apart, K, slopes


@dataclass(frozen=True)
class SpringDamper:
    """A spring and a damper along the line of two points: F = k(l − l₀) + c l̇, pulling for F > 0; l > 0.

    stiffness k [N/m], damping c [N s/m], length l₀ [m].
    """

    name: str
    first: Frame
    second: Frame
    stiffness: float
    damping: float = 0.0
    length: float = 0.0


@dataclass(frozen=True)
class PointForce:
    """Σ u_k d_k at a frame's origin, in global axes; directions (3, k), inputs: the names of u_k [N]."""

    name: str
    frame: Frame
    directions: np.ndarray
    inputs: Sequence[str]


@dataclass(frozen=True)
class PointMoment:
    """T = Σ u_k d_k on a frame, in global axes; directions (3, k), inputs: the names of u_k [N m].

    virtual work T·δθ,  δθ = ½ Σ R_k × δR_k + R Ψ δη
    """

    name: str
    frame: Frame
    directions: np.ndarray
    inputs: Sequence[str]


@dataclass(frozen=True)
class Gravity:
    """∫ρ g·δp over every body, flexible ones as they deform; acceleration g (3,) [m/s²]."""

    acceleration: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))
    name: str = "gravity"


Force = RelativeElement | SpringDamper | PointForce | PointMoment | Gravity
