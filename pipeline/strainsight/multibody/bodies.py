"""Rigid and flexible bodies in natural coordinates."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from strainsight.errors import InfeasibleError
from strainsight.fem.affine import AffineOperator
from strainsight.rom.inertia import InertiaInvariants

TURNED = {"x": (1, 2, 0), "y": (2, 0, 1), "z": (0, 1, 2)}
"""Axes in the cyclic order that ends with the one meant."""


@dataclass(frozen=True)
class Carried:
    """A vector that a body carries: b = t r + R(c + C η), bilinear in (R, η), so of constant second derivative.

    body: its name, None for the ground (b = c); t [-]; c (3,); C (3, n). A clamped body has r = 0, R = I.
    """

    body: str | None
    t: float
    c: np.ndarray
    C: np.ndarray

    def __neg__(self) -> Carried:
        return Carried(self.body, -self.t, -self.c, -self.C)


def constant(vector: np.ndarray) -> Carried:
    """A vector fixed in space (3,)."""
    return Carried(None, 0.0, np.asarray(vector, dtype=float), np.zeros((3, 0)))


@dataclass(frozen=True)
class Frame:
    """A right-handed frame on a body: origin p = r + R(o + Φη), axes a_k = R(I + [Ψη]×)A₀e_k.

    body: its name, None for the ground; origin o (3,) [m] and axes A₀ (3, 3), its columns, in body axes; displacement
    Φ (3, n) [m] and rotation Ψ (3, n) [rad] of the interface node where the body is flexible (small rotation).
    """

    name: str
    body: str | None = None
    origin: np.ndarray = field(default_factory=lambda: np.zeros(3))
    axes: np.ndarray = field(default_factory=lambda: np.eye(3))
    displacement: np.ndarray | None = None
    rotation: np.ndarray | None = None

    def __post_init__(self) -> None:
        axes = np.asarray(self.axes, dtype=float)
        if axes.shape != (3, 3) or np.abs(axes.T @ axes - np.eye(3)).max() > 1e-9 or np.linalg.det(axes) < 0:
            raise InfeasibleError(f"frame {self.name}: its axes are not three right-handed orthonormal columns")

    @property
    def point(self) -> Carried:
        """p."""
        return Carried(
            self.body, float(self.body is not None), np.asarray(self.origin, dtype=float), _shapes(self.displacement)
        )

    def axis(self, k: int) -> Carried:
        """a_k."""
        a = np.asarray(self.axes, dtype=float)[:, k]
        return Carried(self.body, 0.0, a, -cross_matrix(a) @ _shapes(self.rotation))

    def turned(self, axis: str) -> Frame:
        """The same frame with its axis x, y or z as z."""
        return replace(self, axes=np.asarray(self.axes, dtype=float)[:, TURNED[axis]])


def cross_matrix(a: np.ndarray) -> np.ndarray:
    """[a]× (3, 3): [a]× b = a × b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _shapes(X: np.ndarray | None) -> np.ndarray:
    return np.zeros((3, 0)) if X is None else np.asarray(X, dtype=float)


RIGID = 12
"""Natural coordinates of a moving body before its modal ones: r (3), then R column by column (9)."""


@dataclass(frozen=True)
class RigidBody:
    """A rigid body, q = [r, R₁, R₂, R₃] (12,), RᵀR = I; a material point x sits at p = r + R x.

    mass [kg]; centre (3,) [m] of mass in body axes; inertia (3, 3) [kg m²] about the body's origin, in body axes.
    A straight rod has no inertia about its axis: the joints must then hold that rotation.
    Raises InfeasibleError for a mass that is not positive or an inertia that no distribution of mass has.
    """

    name: str
    mass: float
    centre: np.ndarray
    inertia: np.ndarray

    def __post_init__(self) -> None:
        if not (np.isfinite(self.mass) and self.mass > 0):
            raise InfeasibleError(f"body {self.name} has a mass of {self.mass:g} kg", remedy="give it a positive mass")
        inertia = np.asarray(self.inertia, dtype=float)
        if inertia.shape != (3, 3) or not np.allclose(inertia, inertia.T, rtol=1e-9, atol=0.0):
            raise InfeasibleError(f"body {self.name}: the inertia is no symmetric 3×3 matrix")
        centre = np.asarray(self.centre, dtype=float)
        central = self.second - self.mass * np.outer(centre, centre)
        least = float(np.linalg.eigvalsh(central)[0])
        if least < -1e-9 * max(float(np.trace(self.second)), np.finfo(float).tiny):
            raise InfeasibleError(
                f"body {self.name}: no distribution of mass has this inertia "
                f"(least central moment of second order {least:.3g} kg m²)",
                remedy="the inertia is about the body's origin, not the centre of mass; any two principal moments "
                "must together exceed the third",
            )

    @property
    def second(self) -> np.ndarray:
        """∫ρ x xᵀ = ½ tr(I)·1 − I  (3, 3) [kg m²]."""
        inertia = np.asarray(self.inertia, dtype=float)
        return 0.5 * np.trace(inertia) * np.eye(3) - inertia


@dataclass(frozen=True)
class FlexibleBody:
    """A reduced elastic body: p = r + R(x + Φη), small deformation; q = [r, R₁, R₂, R₃, η] (12 + n,), or η if clamped.

    clamped: the body's frame is the ground's, M η̈ + C η̇ + K η = f exactly. stiffness K(θ), damping C(θ) (n, n),
    affine in named parameters (a plain matrix: constant) [N/m, N s/m in the unit of η]; mass (n, n); invariants: the
    inertia in the floating frame. Shapes of a free body must hold no rigid motion (fix them to one interface).
    Raises InfeasibleError for shapes that do not agree or a mass that is not positive.
    """

    name: str
    clamped: bool
    stiffness: AffineOperator | np.ndarray
    mass: np.ndarray
    damping: AffineOperator | np.ndarray
    invariants: InertiaInvariants

    def __post_init__(self) -> None:
        n = self.modes
        if n == 0:
            raise InfeasibleError(
                f"body {self.name} has no shapes", remedy="make it a rigid body, or part of the ground"
            )
        for what, X in (("stiffness", self.stiffness), ("damping", self.damping)):
            matrices = [X.constant, *X.terms.values()] if isinstance(X, AffineOperator) else [X]
            if any(np.shape(part) != (n, n) for part in matrices):
                raise InfeasibleError(f"body {self.name}: the {what} is not {n}×{n} as the mass is")
        if np.shape(self.invariants.first_modal) != (3, n):
            raise InfeasibleError(
                f"body {self.name}: the inertia is of {np.shape(self.invariants.first_modal)[1]} modes, not {n}"
            )
        if not self.invariants.mass > 0:
            raise InfeasibleError(f"body {self.name} has a mass of {self.invariants.mass:g} kg")
        size = np.sqrt(np.maximum(np.diag(self.mass), np.finfo(float).tiny))
        least = float(np.linalg.eigvalsh(self.mass / np.outer(size, size))[0])  # of a microgram as of a tonne
        if not least > 0:
            raise InfeasibleError(
                f"body {self.name}: the reduced mass is not positive definite (least eigenvalue {least:.3g}, of a diagonal "
                "of 1)",
                remedy="leave out the shapes that carry no mass",
            )

    @property
    def modes(self) -> int:
        return len(self.mass)


Body = RigidBody | FlexibleBody


def mass_moment(body: Body) -> Carried:
    """∫ρ p = m r + R(∫ρ x + ∫ρΦ η) [kg m]."""
    if isinstance(body, RigidBody):
        return Carried(body.name, body.mass, body.mass * np.asarray(body.centre, dtype=float), np.zeros((3, 0)))
    own = body.invariants
    return Carried(body.name, own.mass, np.asarray(own.first, dtype=float), np.asarray(own.first_modal, dtype=float))


def size(body: Body) -> int:
    """Number of coordinates."""
    if isinstance(body, RigidBody):
        return RIGID
    return body.modes if body.clamped else RIGID + body.modes


def modes(body: Body) -> int:
    """Number of modal coordinates."""
    return 0 if isinstance(body, RigidBody) else body.modes


def moves(body: Body) -> bool:
    """Whether the body has a frame of its own, r and R."""
    return isinstance(body, RigidBody) or not body.clamped


def mass_matrix(body: Body) -> np.ndarray:
    """M (size, size) where it is constant: [[m, Sᵀ], [S, J]] ⊗ 1 of a rigid body, the reduced mass of a clamped one."""
    if isinstance(body, FlexibleBody):
        return np.asarray(body.mass, dtype=float)
    first = body.mass * np.asarray(body.centre, dtype=float)
    small = np.block([[np.array([[body.mass]]), first[None]], [first[:, None], body.second]])
    return np.kron(small, np.eye(3))


def metric(body: Body) -> np.ndarray:
    """d (size,) with d² of the unit of the mass matrix: coordinates times d are comparable, whatever the units.

    d² = m for r, tr(∫ρxxᵀ)/3 for R (no direction preferred), M_kk for η. Raises InfeasibleError for a point mass.
    """
    if isinstance(body, FlexibleBody) and body.clamped:
        return np.sqrt(np.diag(body.mass))
    if isinstance(body, RigidBody):
        mass, second, modal = body.mass, body.second, np.zeros(0)
    else:
        mass, second, modal = body.invariants.mass, body.invariants.second, np.diag(body.invariants.modal)
    radius2 = float(np.trace(second)) / 3
    if not radius2 > 0:
        raise InfeasibleError(
            f"body {body.name} is a point mass: it has no inertia about its origin", remedy="give it one"
        )
    return np.sqrt(np.concatenate([np.full(3, mass), np.full(9, radius2), modal]))
