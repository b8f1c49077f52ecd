"""Friction about or along an axis: Coulomb's, made regular, with viscous."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from strainsight.multibody.forces import Load, RelativeElement
from strainsight.multibody.frames import Frame
from strainsight.multibody.laws.spring import Measure
from strainsight.multibody.laws.torsion import turned_by
from strainsight.multibody.relations import cosine, dot, offset


def regular_friction(rate: float, coulomb: float, viscous: float, speed: float) -> tuple[float, float, float]:
    """T = T_c tanh(ẋ/ẋ₀) + c ẋ, ∂T/∂ẋ, ∂T/∂T_c.

    What should stick creeps by T/T_c ẋ₀: the smaller ẋ₀, the less, and the smaller the steps that it takes.
    """
    s = float(np.tanh(rate / speed))
    return coulomb * s + viscous * rate, coulomb * (1 - s * s) / speed + viscous, s


@dataclass(frozen=True)
class Friction:
    """T of `regular_friction` on the rate of a displacement x(ρ), ẋ = ∇x·ρ̇:

        F = T ∇x,     ∂F/∂ρ = T' ∇x (∇²x ρ̇)ᵀ + T ∇²x,     ∂F/∂ρ̇ = T' ∇x ∇xᵀ

    coulomb T_c [N or N m], viscous c [N s/m or N m s/rad], speed ẋ₀ [m/s or rad/s].
    """

    measure: Measure
    coulomb: float
    viscous: float
    speed: float

    def load(self, rho: np.ndarray, rho_dot: np.ndarray, theta: np.ndarray) -> Load:
        _, slope, bend = self.measure(rho)
        T, steep, _ = regular_friction(float(slope @ rho_dot), self.coulomb, self.viscous, self.speed)
        F_rho = steep * np.outer(slope, bend @ rho_dot) + T * bend
        return Load(T * slope, F_rho, steep * np.outer(slope, slope), np.zeros((len(rho), 0)))


def friction(
    name: str,
    i: Frame,
    j: Frame,
    motion: Literal["turn", "slide"],
    coulomb: float,
    viscous: float,
    speed: float,
    axis: str = "z",
) -> RelativeElement:
    """Against the turn of j about an axis that both frames keep together, any number of turns, or its slide along an axis of i.

    T on j is −T_c tanh(ω/ω₀) − cω. The Coulomb part is as given, whatever the joint carries.
    """
    if motion == "slide":
        law = Friction(_straight, coulomb, viscous, speed)
        return RelativeElement(name, (offset(i, "xyz".index(axis), j),), law)
    i, j = i.turned(axis), j.turned(axis)
    law = Friction(turned_by, coulomb, viscous, speed)
    return RelativeElement(name, (dot(i, 0, j, 0), dot(i, 1, j, 0)), law, aligned=(cosine(i, 2, j, 2),))


def _straight(rho: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    return float(rho[0]), np.ones(1), np.zeros((1, 1))
