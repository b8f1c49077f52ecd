"""Forces: each is conjugate to relations, Q = −∇ρᵀ F, but for the moment, which has no potential."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from strainsight.multibody.bodies import Frame
from strainsight.multibody.relations import Relation


class Load(NamedTuple):
    """What a law gives: F (k,) that holds the relations, ∂F/∂ρ (k, k), ∂F/∂ρ̇ (k, k) or None where it does not feel ρ̇, and
    ∂F/∂θ (k, number of the element's parameters and inputs)."""

    F: np.ndarray
    F_rho: np.ndarray
    F_rate: np.ndarray | None
    F_theta: np.ndarray


class ForceLaw(Protocol):
    """F(ρ, ρ̇, θ); what does not depend on ρ̇ is F = ∂Π/∂ρ of an energy Π (for the bearing 1.21-1.25)."""

    def load(self, rho: np.ndarray, rho_dot: np.ndarray, theta: np.ndarray) -> Load:
        """From ρ (k,) [m, m² or -], ρ̇ = ∇ρ v (k,) a second, θ the element's own parameters, then its inputs. Raises
        NumericalError where there is no such load."""


@runtime_checkable
class CompiledLaw(ForceLaw, Protocol):
    """A law that the step calls without Python; one without these members is called back through `load`, 10 to 30 µs a call.

    address: of a function with SIGNATURE that answers as `load` does, by `compiled_law` of `compiled/law.py`, or 0; memory: how
    many numbers it keeps from one trial state to the next, zero at first, on which no answer may depend but by rounding.
    """

    @property
    def address(self) -> int: ...

    @property
    def memory(self) -> int: ...

    def numbers(self, theta: np.ndarray) -> np.ndarray:
        """What that function takes of the law, for the element's own parameters θ (without inputs). Raises as `load` does."""


@dataclass(frozen=True)
class RelativeElement:
    """A force law on relations between frames: Q = −∇ρᵀ F(ρ, ρ̇, θ); it gives the bodies the power −F·ρ̇.

    relations (k): their value is subtracted, so ρ is measured from it; parameters: names of θ among the system's; aligned:
    cosines of axes between which the law takes the angle to be small; inputs: names among the system's loads u, whose values
    the law has behind its parameters.
    """

    name: str
    relations: tuple[Relation, ...]
    law: ForceLaw
    parameters: tuple[str, ...] = ()
    aligned: tuple[Relation, ...] = ()
    inputs: tuple[str, ...] = ()


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


Force = RelativeElement | PointForce | PointMoment | Gravity
