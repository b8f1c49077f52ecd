"""A spring and a damper on one displacement: the length between two points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from strainsight.compiled import carray
from strainsight.errors import NumericalError
from strainsight.multibody.compiled.law import MOVING, NONE, STILL, compiled_law
from strainsight.multibody.forces import Load, RelativeElement
from strainsight.multibody.frames import Frame
from strainsight.multibody.relations import distance_squared

SHORTEST = 1e-6
"""[m] between the ends of a spring below which its direction is rounding."""

Measure = Callable[[np.ndarray], tuple[float, np.ndarray, np.ndarray]]
"""ρ (k,) → a displacement x(ρ), ∇x (k,), ∇²x (k, k)."""


@dataclass(frozen=True)
class SpringDamper:
    """T = k x + c ẋ on a displacement x(ρ), measured from where the spring is without force.

        F = T ∇x,     ∂F/∂ρ = ∇x (k ∇x + c ∇²x ρ̇)ᵀ + T ∇²x,     ∂F/∂ρ̇ = c ∇x ∇xᵀ

    stiffness k [N/m or N m/rad], damping c [N s/m or N m s/rad]; compiled: the same as a law with SIGNATURE of
    `compiled/law.py` whose numbers are k, c and the origin of x; without one it is called back.
    """

    measure: Measure
    stiffness: float
    damping: float
    compiled: Callable[..., int] | None = None
    origin: float = 0.0
    memory = 0

    def load(self, rho: np.ndarray, rho_dot: np.ndarray, theta: np.ndarray) -> Load:
        x, slope, bend = self.measure(rho)
        T = self.stiffness * x + self.damping * float(slope @ rho_dot)
        F_rho = np.outer(slope, self.stiffness * slope + self.damping * (bend @ rho_dot)) + T * bend
        F_rate = self.damping * np.outer(slope, slope) if self.damping else None
        return Load(T * slope, F_rho, F_rate, np.zeros((len(rho), 0)))

    @property
    def address(self) -> int:
        return 0 if self.compiled is None else int(compiled_law(self.compiled).address)

    def numbers(self, theta: np.ndarray) -> np.ndarray:
        """k, c, origin."""
        return np.array([self.stiffness, self.damping, self.origin])


def spring(
    name: str, i: Frame, j: Frame, stiffness: float, damping: float = 0.0, length: float = 0.0
) -> RelativeElement:
    """Along the line of the origins of i and j, pulling for T > 0: T = k(l − l₀) + c l̇, ρ = l².

    stiffness k [N/m], damping c [N s/m], length l₀ [m]. Raises NumericalError in `load` for l below SHORTEST.
    """

    def stretch(rho: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        l, slope, bend = length_of(rho, i.name, j.name)
        return l - length, slope, bend

    return RelativeElement(name, (distance_squared(i, j),), SpringDamper(stretch, stiffness, damping, _pull, length))


def length_of(rho: np.ndarray, first: str, second: str) -> tuple[float, np.ndarray, np.ndarray]:
    """l = √ρ, dl/dρ, d²l/dρ². Raises NumericalError, naming the two frames, where it has no direction."""
    s = float(rho[0])
    if not s > SHORTEST**2:
        raise NumericalError(
            f"its end points '{first}' and '{second}' are {np.sqrt(max(s, 0.0)):.2g} m apart, below {SHORTEST:g} m: the force "
            "has no direction",
            remedy="name frames that stay apart",
        )
    l = float(np.sqrt(s))
    return l, np.array([0.5 / l]), np.array([[-0.25 / (l * s)]])


def _pull(k, p, numbers, memory, rho, rate, theta, F, F_rho, F_rate, F_theta):  # type: ignore[no-untyped-def]
    given, s, ds = carray(numbers, 3), carray(rho, 1)[0], carray(rate, 1)[0]
    if not s > SHORTEST**2:
        return NONE
    l = np.sqrt(s)
    slope, bend = 0.5 / l, -0.25 / (l * s)
    T = given[0] * (l - given[2]) + given[1] * slope * ds
    carray(F, 1)[0] = T * slope
    carray(F_rho, 1)[0] = slope * (given[0] * slope + given[1] * bend * ds) + T * bend
    carray(F_rate, 1)[0] = given[1] * slope * slope
    return MOVING if given[1] != 0.0 else STILL
