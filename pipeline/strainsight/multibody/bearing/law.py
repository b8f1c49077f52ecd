"""The bearing as the force law of a system (thesis figure 1.8), with friction and damping."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from strainsight.multibody.bearing.element import bearing_load
from strainsight.multibody.bearing.geometry import PARAMETERS, Bearing
from strainsight.multibody.bearing.ring import KEPT, ring_law
from strainsight.multibody.bodies import Frame
from strainsight.multibody.compiled.law import compiled_law
from strainsight.multibody.forces import Load
from strainsight.multibody.laws.actuators import regular_friction
from strainsight.multibody.laws.springs import turned_by
from strainsight.multibody.relations import Relation, bearing_displacements, dot

TILTED, RADIAL = 4.4, 2.2 * 1.73
"""Weights of tilting moment and radial force beside the axial one in the friction of a ball slewing bearing."""
SMALL = 1.0
"""[N or N m] below which the size of a load is rounded off, so that it has a slope at zero."""


@dataclass(frozen=True)
class Drag:
    """What a bearing takes from motion: a moment against its turn, regular as `regular_friction`, and damping of the ring.

        T_c = T₀ + µ/2 (4.4 M + D F_a + 3.81 D F_r),     T = T_c tanh(ω/ω₀) + c ω

    moment T₀ [N m], of seals and preload; coefficient µ [-]; viscous c [N m s/rad]; speed ω₀ [rad/s]; F_a, F_r, M axial and
    radial force and tilting moment that the balls carry, D the pitch diameter. damping (5,): of the five displacements
    [N s/m, N s/m, N s/m, N m s/rad, N m s/rad].
    Source: thyssenkrupp rothe erde, slewing bearings, starting torque of ball bearings.
    """

    moment: float = 0.0
    coefficient: float = 0.0
    viscous: float = 0.0
    speed: float = 1e-3
    damping: np.ndarray = field(default_factory=lambda: np.zeros(5))

    @property
    def turns(self) -> bool:
        """Whether it resists the turn."""
        return bool(self.moment or self.coefficient or self.viscous)


def ring_relations(outer: Frame, inner: Frame, drag: Drag) -> tuple[Relation, ...]:
    """The five displacements of the inner ring in the outer one; with friction cosine and sine of its turn about x, too."""
    five = bearing_displacements(outer, inner)
    return (*five, dot(outer, 1, inner, 1), dot(outer, 2, inner, 1)) if drag.turns else five


class BearingLaw:
    """F(ρ, ρ̇, θ) of a bearing on `ring_relations`; θ: those of its parameters that are free, by name, in order."""

    def __init__(self, bearing: Bearing, free: Sequence[str] = (), drag: Drag | None = None):
        self._places = [PARAMETERS.index(name) for name in free]
        self._bearing = self._at = bearing
        self._drag = drag or Drag()

    def load(self, rho: np.ndarray, rho_dot: np.ndarray, theta: np.ndarray) -> Load:
        """F (5 or 7,), ∂F/∂ρ, ∂F/∂ρ̇, ∂F/∂θ (, number of free parameters). Raises the errors of `bearing_load` and `Bearing`."""
        self._move(theta)
        found = bearing_load(self._at, rho[:5], slopes=bool(self._places))
        own, drag = Load(found.force, found.tangent, None, found.slopes[:, self._places]), self._drag
        rate = None
        if drag.damping.any():
            rate = np.diag(drag.damping)
            own = own._replace(F=own.F + rate @ rho_dot[:5], F_rate=rate)
        return self._turned(found.force, own, rho[5:], rho_dot[5:]) if drag.turns else own

    def _move(self, theta: np.ndarray) -> None:
        if self._places and not np.array_equal(self._at.parameters[self._places], theta):
            values = self._bearing.parameters
            values[self._places] = theta
            self._at = self._bearing.with_parameters(values)

    def _turned(self, held: np.ndarray, own: Load, rho: np.ndarray, rho_dot: np.ndarray) -> Load:
        """With the moment against the turn; held (5,): what the balls carry."""
        drag, D = self._drag, self._at.pitch_diameter
        squares = np.array([held[0] ** 2, held[1] ** 2 + held[2] ** 2, held[3] ** 2 + held[4] ** 2])
        size = np.sqrt(squares + SMALL**2)
        share = 0.5 * drag.coefficient * np.array([D, RADIAL * D, TILTED])
        by_load = held * (share / size)[[0, 1, 1, 2, 2]]
        _, slope, bend = turned_by(rho)
        coulomb = drag.moment + float(share @ (size - SMALL))
        T, steep, by_coulomb = regular_friction(float(slope @ rho_dot), coulomb, drag.viscous, drag.speed)
        F_rho, F_rate = np.zeros((7, 7)), np.zeros((7, 7))
        F_rho[:5, :5] = own.F_rho
        F_rho[5:, :5] = np.outer(slope, by_coulomb * (by_load @ own.F_rho))
        F_rho[5:, 5:] = steep * np.outer(slope, bend @ rho_dot) + T * bend
        F_rate[:5, :5] = 0.0 if own.F_rate is None else own.F_rate
        F_rate[5:, 5:] = steep * np.outer(slope, slope)
        F_theta = np.vstack([own.F_theta, np.outer(slope, by_coulomb * (by_load @ own.F_theta))])
        return Load(np.concatenate([own.F, T * slope]), F_rho, F_rate, F_theta)

    @property
    def address(self) -> int:
        """0, which is in Python, where the bearing takes from motion."""
        drag = self._drag
        return (
            0 if drag.turns or drag.damping.any() else int(compiled_law(ring_law, "multibody/bearing/ring.py").address)
        )

    @property
    def memory(self) -> int:
        """What is kept of every ball, from which it is followed."""
        return 6 + KEPT * self._bearing.balls

    def numbers(self, theta: np.ndarray) -> np.ndarray:
        """As `ring_law` takes them."""
        self._move(theta)
        own = self._at
        sizes = [own.pitch_diameter / 2, own.ball_diameter, own.balls]
        parts = own.contacts.table.ravel(), own.contacts.centrifugal, sizes, own.turns.ravel(), self._places
        return np.concatenate([np.asarray(part, dtype=float) for part in parts])
