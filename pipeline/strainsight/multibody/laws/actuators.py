"""Loads with a history that turn with what they act on: motors, cylinders, forces and moments in the axes of a frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from strainsight.multibody.bodies import Body, Carried, Frame, constant, mass_moment
from strainsight.multibody.forces import Load, RelativeElement
from strainsight.multibody.laws.springs import Measure, length_of, turned_by
from strainsight.multibody.relations import Relation, cosine, distance_squared, dot, offset, place


@dataclass(frozen=True)
class Actuator:
    """A load u(t) along a displacement x(ρ): F = −u ∇x, which does the work u ẋ on the bench."""

    measure: Measure

    def load(self, rho: np.ndarray, rho_dot: np.ndarray, theta: np.ndarray) -> Load:
        _, slope, bend = self.measure(rho)
        return Load(-theta[0] * slope, -theta[0] * bend, None, -slope[:, None])


@dataclass(frozen=True)
class Follower:
    """A load u(t) C ρ, linear in the axes it turns with: F = −u C ρ. C (k, k) is not symmetric: it has no potential."""

    coefficients: np.ndarray

    def load(self, rho: np.ndarray, rho_dot: np.ndarray, theta: np.ndarray) -> Load:
        along = -(self.coefficients @ rho)
        return Load(theta[0] * along, -theta[0] * self.coefficients, None, along[:, None])


def torque(name: str, i: Frame, j: Frame, axis: str = "z") -> RelativeElement:
    """A motor of torque u [N m] on j, −u on i, about an axis that both frames keep together, any number of turns."""
    i, j = i.turned(axis), j.turned(axis)
    turn = (dot(i, 0, j, 0), dot(i, 1, j, 0))
    return RelativeElement(name, turn, Actuator(turned_by), aligned=(cosine(i, 2, j, 2),), inputs=(name,))


def actuator(name: str, i: Frame, j: Frame) -> RelativeElement:
    """A cylinder that pushes the origins of i and j apart by u [N]."""
    law = Actuator(lambda rho: length_of(rho, i.name, j.name))
    return RelativeElement(name, (distance_squared(i, j),), law, inputs=(name,))


def follower_force(name: str, frame: Frame, direction: np.ndarray) -> RelativeElement:
    """u [N] at a frame's origin along a direction (3,) of length 1 in its own axes: Q = J_pᵀ u a, a the direction carried."""
    own = tuple(place(frame, e) for e in np.eye(3))
    C = np.zeros((6, 6))
    C[:3, 3:] = np.eye(3)
    return RelativeElement(name, (*own, *_components(frame, direction)), Follower(C), inputs=(name,))


def follower_moment(name: str, frame: Frame, direction: np.ndarray) -> RelativeElement:
    """u [N m] about a direction (3,) of length 1 in a frame's own axes: d·δθ = ½ (e₂·δe₁ − e₁·δe₂), e₁ × e₂ = d."""
    across = np.linalg.svd(direction[None])[2][1:]
    first, second = across if np.cross(*across) @ direction > 0 else across[::-1]
    C = np.zeros((6, 6))
    C[:3, 3:], C[3:, :3] = 0.5 * np.eye(3), -0.5 * np.eye(3)
    axes = (*_components(frame, first), *_components(frame, second))
    return RelativeElement(name, axes, Follower(C), inputs=(name,))


def _components(frame: Frame, direction: np.ndarray) -> tuple[Relation, ...]:
    """Global components of a direction in a frame's axes."""
    axes = [frame.axis(k) for k in range(3)]
    c, C = (
        sum(d * x for d, x in zip(direction, own, strict=True)) for own in ([a.c for a in axes], [a.C for a in axes])
    )
    along = Carried(frame.body, 0.0, np.asarray(c), np.asarray(C))
    return tuple(Relation(f"axis of {frame.name}", (constant(e),), (along,)) for e in np.eye(3))


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


@dataclass(frozen=True)
class TurningGravity:
    """F = −g(φ) on ∫ρ p of every body, g(φ) = g_∥ + cos φ g_⊥ + sin φ a × g: the acceleration g (3,) [m/s²], turned by the load φ
    [rad] about an axis a (3,) of length 1."""

    acceleration: np.ndarray
    axis: np.ndarray

    def at(self, angle: float) -> tuple[np.ndarray, np.ndarray]:
        """g, ∂g/∂φ (3,)."""
        along = (self.axis @ self.acceleration) * self.axis
        across, sideways = self.acceleration - along, np.cross(self.axis, self.acceleration)
        c, s = np.cos(angle), np.sin(angle)
        return along + c * across + s * sideways, c * sideways - s * across

    def load(self, rho: np.ndarray, rho_dot: np.ndarray, theta: np.ndarray) -> Load:
        bodies = len(rho) // 3
        g, slope = self.at(float(theta[0]))
        return Load(-np.tile(g, bodies), np.zeros((len(rho), len(rho))), None, -np.tile(slope, bodies)[:, None])


def turning_gravity(name: str, bodies: Sequence[Body], acceleration: np.ndarray, axis: np.ndarray) -> RelativeElement:
    """What a bench feels that is itself turned about an axis, slowly: of its own rotation there is nothing else."""
    weights = [
        Relation(f"{name} on {body.name}", (constant(e),), (mass_moment(body),)) for body in bodies for e in np.eye(3)
    ]
    return RelativeElement(name, tuple(weights), TurningGravity(acceleration, axis), inputs=(name,))
