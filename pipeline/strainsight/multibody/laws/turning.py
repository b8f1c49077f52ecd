"""Gravity that turns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.multibody.bodies import Body, mass_moment
from strainsight.multibody.forces import Load, RelativeElement
from strainsight.multibody.frames import constant
from strainsight.multibody.relations import Relation


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
