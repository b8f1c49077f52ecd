"""Force laws between two frames: springs, dampers, bushings, friction, and follower loads."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from strainsight.compiled import carray
from strainsight.errors import NumericalError
from strainsight.multibody.bodies import Body, Carried, Frame, constant, mass_moment
from strainsight.multibody.forces import MOVING, NONE, STILL, FunctionLaw, Load, RelativeElement
from strainsight.multibody.relations import (
    Relation,
    bushing_displacements,
    cosine,
    distance_squared,
    dot,
    offset,
    place,
)

SHORTEST = 1e-6
"""[m] Shortest distance of the ends of a spring; below, its direction is rounding."""

Measure = Callable[[np.ndarray], tuple[float, np.ndarray, np.ndarray]]
"""ρ (k,) → a displacement x(ρ), ∇x (k,), ∇²x (k, k)."""


@dataclass(frozen=True)
class AlongDisplacement(ABC):
    """T(x, ẋ, θ) along a displacement x(ρ), ẋ = ∇x·ρ̇: F = T ∇x,     ∂F/∂ρ = ∇x (T_x ∇x + T_ẋ ∇²x ρ̇)ᵀ + T ∇²x,     ∂F/∂ρ̇ =
    T_ẋ ∇x ∇xᵀ,     ∂F/∂θ = ∇x T_θᵀ"""

    measure: Measure

    @abstractmethod
    def force(self, x: float, rate: float, theta: np.ndarray) -> tuple[float, float, float, Sequence[float]]:
        """T, T_x, T_ẋ, T_θ."""

    def load(self, rho: np.ndarray, rho_dot: np.ndarray, theta: np.ndarray) -> Load:
        x, slope, bend = self.measure(rho)
        T, by_x, by_rate, by_theta = self.force(x, float(slope @ rho_dot), theta)
        F_rho = np.outer(slope, by_x * slope + by_rate * (bend @ rho_dot)) + T * bend
        F_rate = by_rate * np.outer(slope, slope) if by_rate else None
        return Load(T * slope, F_rho, F_rate, np.outer(slope, by_theta))


@dataclass(frozen=True)
class SpringDamper(FunctionLaw):
    """F = T ∇x, T = k x + c ẋ along a displacement x(ρ) from the unloaded position; stiffness k [N/m or N m/rad], damping c [N
    s/m or N m s/rad], origin of x."""

    stiffness: float
    damping: float
    origin: float
    function: Callable[..., int]
    refusal: Callable[[np.ndarray], NumericalError]

    def numbers(self, theta: np.ndarray) -> np.ndarray:
        """k, c, origin."""
        return np.array([self.stiffness, self.damping, self.origin])


def spring(
    name: str, i: Frame, j: Frame, stiffness: float, damping: float = 0.0, length: float = 0.0
) -> RelativeElement:
    """Along the line of the origins of i and j, pulling for T > 0: T = k(l − l₀) + c l̇, ρ = l². stiffness k [N/m], damping c
    [N s/m], length l₀ [m]. Raises NumericalError in `load` for l below SHORTEST."""
    law = SpringDamper(stiffness, damping, length, _pull, lambda rho: _no_direction(rho, i.name, j.name))
    return RelativeElement(name, (distance_squared(i, j),), law)


def _no_direction(rho: np.ndarray, first: str, second: str) -> NumericalError:
    distance = np.sqrt(max(float(rho[0]), 0.0))
    return NumericalError(
        f"the distance between the end points '{first}' and '{second}' is {distance:.2g} m, below {SHORTEST:g} m: the "
        "force has no direction",
        remedy="choose two frames whose origins do not meet during the motion",
    )


def length_of(rho: np.ndarray, first: str, second: str) -> tuple[float, np.ndarray, np.ndarray]:
    """l = √ρ, dl/dρ, d²l/dρ². Raises NumericalError, naming the two frames, where it has no direction."""
    s = float(rho[0])
    if not s > SHORTEST**2:
        raise _no_direction(rho, first, second)
    l = float(np.sqrt(s))
    return l, np.array([0.5 / l]), np.array([[-0.25 / (l * s)]])


def _pull(k, p, numbers, memory, rho, rate, theta, F, F_rho, F_rate, F_theta):  # type: ignore[no-untyped-def]
    law, s, ds = carray(numbers, 3), carray(rho, 1)[0], carray(rate, 1)[0]
    if not s > SHORTEST**2:
        return NONE
    stiffness, damping, l = law[0], law[1], np.sqrt(s)
    slope, bend = 0.5 / l, -0.25 / (l * s)
    T = stiffness * (l - law[2]) + damping * slope * ds
    carray(F, 1)[0] = T * slope
    carray(F_rho, 1)[0] = slope * (stiffness * slope + damping * bend * ds) + T * bend
    carray(F_rate, 1)[0] = damping * slope * slope
    return MOVING if damping != 0.0 else STILL


FARTHEST = 3.0
"""[rad] Largest rotation of a torsion spring from its unloaded angle: at π its moment would jump."""


def torsion(
    name: str, i: Frame, j: Frame, stiffness: float, damping: float = 0.0, angle: float = 0.0, axis: str = "z"
) -> RelativeElement:
    """About an axis that both frames keep together, T = k(φ − φ₀) + c φ̇ on i, −T on j. φ = atan2(y_i·x_j, x_i·x_j) with the
    axis as z; stiffness k [N m/rad], damping c [N m s/rad], angle φ₀ [rad]. A damper alone turns as far as it likes. Raises
    NumericalError in `load` for |φ − φ₀| above FARTHEST."""
    i, j = i.turned(axis), j.turned(axis)
    c, s = np.cos(angle), np.sin(angle)

    def too_far(rho: np.ndarray) -> NumericalError:
        x, y = rho
        phi = float(np.arctan2(y * c - x * s, x * c + y * s))
        return NumericalError(
            f"the torsion spring is rotated by {phi:.3g} rad from its unloaded angle; the limit is {FARTHEST:g} rad",
            remedy="check the unloaded angle and the stiffness: a torsion spring can rotate by less than half a revolution",
        )

    law = SpringDamper(stiffness, damping, angle, _turned, too_far)
    return RelativeElement(name, (dot(i, 0, j, 0), dot(i, 1, j, 0)), law, aligned=(cosine(i, 2, j, 2),))


def turned_by(rho: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """φ = atan2(y, x) of ρ = (x, y), ∇φ (2,), ∇²φ (2, 2): slopes and so rates are regular at every angle."""
    x, y = float(rho[0]), float(rho[1])
    r = x * x + y * y
    bend = np.array([[2 * x * y, y * y - x * x], [y * y - x * x, -2 * x * y]]) / r**2
    return float(np.arctan2(y, x)), np.array([-y, x]) / r, bend


def _turned(k, p, numbers, memory, rho, rate, theta, F, F_rho, F_rate, F_theta):  # type: ignore[no-untyped-def]
    law, at, moving = carray(numbers, 3), carray(rho, 2), carray(rate, 2)
    x, y, dx, dy = at[0], at[1], moving[0], moving[1]
    stiffness, damping, c, s = law[0], law[1], np.cos(law[2]), np.sin(law[2])
    phi = np.arctan2(y * c - x * s, x * c + y * s)
    if stiffness != 0.0 and not abs(phi) <= FARTHEST:
        return NONE
    r = x * x + y * y
    slope = (-y / r, x / r)
    bend = ((2 * x * y / r**2, (y * y - x * x) / r**2), ((y * y - x * x) / r**2, -2 * x * y / r**2))
    T = stiffness * phi + damping * (slope[0] * dx + slope[1] * dy)
    out, by_rho, by_rate = carray(F, 2), carray(F_rho, (2, 2)), carray(F_rate, (2, 2))
    for i in range(2):
        out[i] = T * slope[i]
        for j in range(2):
            bent = bend[j][0] * dx + bend[j][1] * dy
            by_rho[i, j] = slope[i] * (stiffness * slope[j] + damping * bent) + T * bend[i][j]
            by_rate[i, j] = damping * slope[i] * slope[j]
    return MOVING if damping != 0.0 else STILL


def _load(k, p, numbers, memory, rho, rate, theta, F, F_rho, F_rate, F_theta):  # type: ignore[no-untyped-def]
    law = carray(numbers, 1 + 2 * k * k + k + p * k * k)
    x, xr, out = carray(rho, k), carray(rate, k), carray(F, k)
    by_rho, by_rate, by_theta = carray(F_rho, (k, k)), carray(F_rate, (k, k)), carray(F_theta, (k, p))
    rest = 1 + 2 * k * k
    for i in range(k):
        for j in range(k):
            elongation = x[j] - law[rest + j]
            by_rho[i, j] = law[1 + k * i + j]
            by_rate[i, j] = law[1 + k * k + k * i + j]
            out[i] += by_rho[i, j] * elongation + by_rate[i, j] * xr[j]
            for m in range(p):
                by_theta[i, m] += law[rest + k + k * (k * m + i) + j] * elongation
    return MOVING if law[0] != 0.0 else STILL


@dataclass(frozen=True)
class LinearLaw(FunctionLaw):
    """F = (K + Σ θ_j K_j)(ρ − rest) + D ρ̇. stiffness K (k, k), rest (k,), terms K_j in the order of the parameters, damping
    D (k, k) or None."""

    stiffness: np.ndarray
    rest: np.ndarray
    terms: tuple[np.ndarray, ...] = ()
    damping: np.ndarray | None = None

    function = staticmethod(_load)

    def numbers(self, theta: np.ndarray) -> np.ndarray:
        """Whether it is damped; K(θ), D, rest, the terms."""
        K = self.stiffness
        for value, term in zip(theta, self.terms, strict=True):
            K = K + value * term
        D = np.zeros_like(K) if self.damping is None else self.damping
        return np.concatenate([[self.damping is not None], *(np.ravel(X) for X in (K, D, self.rest, *self.terms))])


def bushing(name: str, i: Frame, j: Frame, stiffness: Sequence[float], damping: Sequence[float]) -> RelativeElement:
    """The six displacements d of j in i, each with its own spring and damper: F = diag(k) d + diag(c) ḋ. stiffness k (6,)
    [N/m, then N m/rad], damping c (6,) [N s/m, then N m s/rad]: along x, y, z of i, then about them. Where k or c of a
    rotation is not zero the rotation has to be small."""
    k, c = np.asarray(stiffness, dtype=float), np.asarray(damping, dtype=float)
    turning = bool(k[3:].any() or c[3:].any())
    law = LinearLaw(np.diag(k), np.zeros(6), damping=np.diag(c) if c.any() else None)
    aligned = (cosine(i, 0, j, 0), cosine(i, 1, j, 1)) if turning else ()
    return RelativeElement(name, bushing_displacements(i, j), law, aligned=aligned)


@dataclass(frozen=True)
class Actuator(AlongDisplacement):
    """T = −u of a load u(t), which does the work u ẋ on the bench."""

    def force(self, x: float, rate: float, theta: np.ndarray) -> tuple[float, float, float, Sequence[float]]:
        return -theta[0], 0.0, 0.0, (-1.0,)


@dataclass(frozen=True)
class Follower:
    """A load u(t) C ρ, linear in the axes that rotate with it: F = −u C ρ. C (k, k) is not symmetric, so it has no potential."""

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
    axes = tuple(place(frame, e) for e in np.eye(3))
    C = np.zeros((6, 6))
    C[:3, 3:] = np.eye(3)
    return RelativeElement(name, (*axes, *_components(frame, direction)), Follower(C), inputs=(name,))


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
        sum(d * x for d, x in zip(direction, vector, strict=True))
        for vector in ([a.c for a in axes], [a.C for a in axes])
    )
    along = Carried(frame.body, 0.0, np.asarray(c), np.asarray(C))
    return tuple(
        Relation(f"load direction in the axes of frame {frame.name}", (constant(e),), (along,)) for e in np.eye(3)
    )


def regular_friction(rate: float, coulomb: float, viscous: float, speed: float) -> tuple[float, float, float]:
    """T = T_c tanh(ẋ/ẋ₀) + c ẋ, ∂T/∂ẋ, ∂T/∂T_c. Sticking parts creep at T/T_c ẋ₀; a smaller ẋ₀ reduces the creep and requires
    smaller steps."""
    s = float(np.tanh(rate / speed))
    return coulomb * s + viscous * rate, coulomb * (1 - s * s) / speed + viscous, s


@dataclass(frozen=True)
class Friction(AlongDisplacement):
    """T of `regular_friction`; coulomb T_c [N or N m], viscous c [N s/m or N m s/rad], speed ẋ₀ [m/s or rad/s]."""

    coulomb: float
    viscous: float
    speed: float

    def force(self, x: float, rate: float, theta: np.ndarray) -> tuple[float, float, float, Sequence[float]]:
        T, steep, _ = regular_friction(rate, self.coulomb, self.viscous, self.speed)
        return T, 0.0, steep, ()


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
    """Against the turn of j about an axis that both frames keep together, any number of turns, or its slide along an axis of
    i. T on j is −T_c tanh(ω/ω₀) − cω. The Coulomb part is as given, whatever the joint carries."""
    if motion == "slide":
        law = Friction(lambda rho: (float(rho[0]), np.ones(1), np.zeros((1, 1))), coulomb, viscous, speed)
        return RelativeElement(name, (offset(i, "xyz".index(axis), j),), law)
    i, j = i.turned(axis), j.turned(axis)
    law = Friction(turned_by, coulomb, viscous, speed)
    return RelativeElement(name, (dot(i, 0, j, 0), dot(i, 1, j, 0)), law, aligned=(cosine(i, 2, j, 2),))


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
    """Gravity of a bench that is slowly rotated about an axis; its rotation has no other effect."""
    weights = [
        Relation(f"weight of body {body.name}", (constant(e),), (mass_moment(body),))
        for body in bodies
        for e in np.eye(3)
    ]
    return RelativeElement(name, tuple(weights), TurningGravity(acceleration, axis), inputs=(name,))


LAWS: Mapping[str, Callable[..., RelativeElement]] = {
    law.__name__: law for law in (spring, bushing, torsion, friction, torque, actuator)
}
"""Name → (name of the force, first frame, second frame, the keys of its section) → element."""
