"""Loads with a history that turn with what they act on: motors, cylinders, forces and moments in the axes of a frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.multibody.forces import Load, RelativeElement
from strainsight.multibody.frames import Carried, Frame, constant
from strainsight.multibody.laws.spring import Measure, length_of
from strainsight.multibody.laws.torsion import turned_by
from strainsight.multibody.relations import Relation, cosine, distance_squared, dot, place


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
