"""Rigid and flexible bodies in natural coordinates, and the inertia of a flexible one in its floating frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from strainsight.compiled import inner, kept
from strainsight.errors import InfeasibleError
from strainsight.fem.affine import AffineOperator
from strainsight.rom.inertia import InertiaInvariants

TURNED = {"x": (1, 2, 0), "y": (2, 0, 1), "z": (0, 1, 2)}
"""Cyclic order of the axes that ends with the selected one."""


@dataclass(frozen=True)
class Carried:
    """A vector that a body carries: b = t r + R(c + C η), bilinear in (R, η), so of constant second derivative. body: its
    name, None for the ground (b = c); t [-]; c (3,); C (3, n). A clamped body has r = 0, R = I."""

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
    """A right-handed frame on a body: origin p = r + R(o + Φη), axes a_k = R(I + [Ψη]×)A₀e_k. body: its name, None for the
    ground; origin o (3,) [m] and axes A₀ (3, 3), its columns, in body axes; displacement Φ (3, n) [m] and rotation Ψ (3, n)
    [rad] of the interface node where the body is flexible (small rotation)."""

    name: str
    body: str | None = None
    origin: np.ndarray = field(default_factory=lambda: np.zeros(3))
    axes: np.ndarray = field(default_factory=lambda: np.eye(3))
    displacement: np.ndarray | None = None
    rotation: np.ndarray | None = None

    def __post_init__(self) -> None:
        axes = np.asarray(self.axes, dtype=float)
        if axes.shape != (3, 3) or np.abs(axes.T @ axes - np.eye(3)).max() > 1e-9 or np.linalg.det(axes) < 0:
            raise InfeasibleError(
                f"frame {self.name}: the columns of the axes matrix are not right-handed and orthonormal",
                remedy="specify three orthogonal unit vectors as columns, with z = x × y",
            )

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
    """A rigid body, q = [r, R₁, R₂, R₃] (12,), RᵀR = I; a material point x sits at p = r + R x. mass [kg]; centre (3,) [m] of
    mass in body axes; inertia (3, 3) [kg m²] about the body's origin, in body axes. A straight rod has no inertia about its
    axis: the joints must then hold that rotation. modes, moves, size: as of `FlexibleBody`. Raises InfeasibleError for a mass
    that is not positive or an inertia that no distribution of mass has."""

    name: str
    mass: float
    centre: np.ndarray
    inertia: np.ndarray

    modes, moves, size = 0, True, RIGID

    def __post_init__(self) -> None:
        if not (np.isfinite(self.mass) and self.mass > 0):
            raise InfeasibleError(f"body {self.name} has a mass of {self.mass:g} kg", remedy="specify a positive mass")
        inertia = np.asarray(self.inertia, dtype=float)
        if inertia.shape != (3, 3) or not np.allclose(inertia, inertia.T, rtol=1e-9, atol=0.0):
            raise InfeasibleError(f"body {self.name}: the inertia is not a symmetric 3×3 matrix")
        centre = np.asarray(self.centre, dtype=float)
        central = self.second - self.mass * np.outer(centre, centre)
        least = float(np.linalg.eigvalsh(central)[0])
        if least < -1e-9 * max(float(np.trace(self.second)), np.finfo(float).tiny):
            raise InfeasibleError(
                f"body {self.name}: no mass distribution has the inertia tensor in `RigidBody.inertia`; its second moment of "
                f"mass in one direction through the centre of mass is negative ({least:.3g} kg m²)",
                remedy="set `RigidBody.inertia` to the inertia tensor about the origin of the body, not about the centre of "
                "mass; no principal moment may exceed the sum of the other two",
            )

    @property
    def second(self) -> np.ndarray:
        """∫ρ x xᵀ = ½ tr(I)·1 − I  (3, 3) [kg m²]."""
        inertia = np.asarray(self.inertia, dtype=float)
        return 0.5 * np.trace(inertia) * np.eye(3) - inertia


@dataclass(frozen=True)
class FlexibleBody:
    """A reduced elastic body: p = r + R(x + Φη), small deformation; q = [r, R₁, R₂, R₃, η] (12 + n,), or η if clamped.
    clamped: the body's frame is the ground's, M η̈ + C η̇ + K η = f exactly. stiffness K(θ), damping C(θ) (n, n), affine in
    named parameters (a plain matrix: constant) [N/m, N s/m in the unit of η]; mass (n, n); invariants: the inertia in the
    floating frame. Shapes of a free body must hold no rigid motion (fix them to one interface). Raises InfeasibleError for
    shapes that do not agree or a mass that is not positive."""

    name: str
    clamped: bool
    stiffness: AffineOperator | np.ndarray
    mass: np.ndarray
    damping: AffineOperator | np.ndarray
    invariants: InertiaInvariants

    def __post_init__(self) -> None:
        n = self.modes
        if n == 0:
            raise InfeasibleError(f"body {self.name} has no mode shapes", remedy="add mode shapes, or use a rigid body")
        for what, X in (("stiffness", self.stiffness), ("damping", self.damping)):
            matrices = [X.constant, *X.terms.values()] if isinstance(X, AffineOperator) else [X]
            if any(np.shape(part) != (n, n) for part in matrices):
                raise InfeasibleError(
                    f"body {self.name}: the {what} matrix does not have the shape {n}×{n} of the mass matrix"
                )
        if np.shape(self.invariants.first_modal) != (3, n):
            raise InfeasibleError(
                f"body {self.name}: the inertia invariants belong to {np.shape(self.invariants.first_modal)[1]} modes, but "
                f"the mass matrix belongs to {n}"
            )
        if not self.invariants.mass > 0:
            raise InfeasibleError(
                f"body {self.name} has a mass of {self.invariants.mass:g} kg", remedy="specify a positive mass"
            )
        size = np.sqrt(np.maximum(np.diag(self.mass), np.finfo(float).tiny))
        least = float(np.linalg.eigvalsh(self.mass / np.outer(size, size))[0])  # of a microgram as of a tonne
        if not least > 0:
            raise InfeasibleError(
                f"body {self.name}: the reduced mass matrix is not positive definite (smallest eigenvalue {least:.3g}, with the "
                "diagonal scaled to 1)",
                remedy="remove mode shapes that are linearly dependent or move no mass",
            )

    @property
    def modes(self) -> int:
        """Number of modal coordinates."""
        return len(self.mass)

    @property
    def moves(self) -> bool:
        """Whether the body has a floating frame, r and R."""
        return not self.clamped

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return RIGID * self.moves + self.modes


Body = RigidBody | FlexibleBody


def mass_moment(body: Body) -> Carried:
    """∫ρ p = m r + R(∫ρ x + ∫ρΦ η) [kg m]."""
    if isinstance(body, RigidBody):
        return Carried(body.name, body.mass, body.mass * np.asarray(body.centre, dtype=float), np.zeros((3, 0)))
    s = body.invariants
    return Carried(body.name, s.mass, np.asarray(s.first, dtype=float), np.asarray(s.first_modal, dtype=float))


def mass_matrix(body: Body) -> np.ndarray:
    """M (size, size) if constant: [[m, Sᵀ], [S, J]] ⊗ 1 of a rigid body, the reduced mass of a clamped one."""
    if isinstance(body, FlexibleBody):
        return np.asarray(body.mass, dtype=float)
    first = body.mass * np.asarray(body.centre, dtype=float)
    small = np.block([[np.array([[body.mass]]), first[None]], [first[:, None], body.second]])
    return np.kron(small, np.eye(3))


def metric(body: Body) -> np.ndarray:
    """d (size,) with d² of the unit of the mass matrix: coordinates times d are comparable, whatever the units. d² = m for r,
    tr(∫ρxxᵀ)/3 for R (no direction preferred), M_kk for η. Raises InfeasibleError for a point mass."""
    if isinstance(body, FlexibleBody) and body.clamped:
        return np.sqrt(np.diag(body.mass))
    if isinstance(body, RigidBody):
        mass, second, modal = body.mass, body.second, np.zeros(0)
    else:
        mass, second, modal = body.invariants.mass, body.invariants.second, np.diag(body.invariants.modal)
    radius2 = float(np.trace(second)) / 3
    if not radius2 > 0:
        raise InfeasibleError(
            f"all moments of inertia of body {body.name} about the origin of the body are zero",
            remedy="specify nonzero moments of inertia",
        )
    return np.sqrt(np.concatenate([np.full(3, mass), np.full(9, radius2), modal]))


class Inertia(NamedTuple):
    """The invariants of one body that are not made of the others, contiguous, with at: its first coordinate."""

    at: int
    mass: float
    first: np.ndarray
    first_modal: np.ndarray
    second: np.ndarray
    coupling: np.ndarray
    coupling_modal: np.ndarray
    modal: np.ndarray


def as_inertia(at: int, x: InertiaInvariants) -> Inertia:
    """Contiguous arrays of the body whose coordinates begin at `at`, for compiled code."""
    fields = (x.first, x.first_modal, x.second, x.coupling, x.coupling_modal, x.modal)
    return Inertia(at, float(x.mass), *(np.ascontiguousarray(field, dtype=float) for field in fields))


@kept()
def inertia_load(
    body: Inertia, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """M (s, s), g = M(q)a + c(q, v) (s,), ∂g/∂q, ∂c/∂v (s, s) of one body, s = 12 + n: `add_inertia`."""
    s = 12 + body.modal.shape[0]
    M, g, Gq, Gv = np.zeros((s, s)), np.zeros(s), np.zeros((s, s)), np.zeros((s, s))
    # no literal, for which numba would compile `add_inertia` a second time
    add_inertia(body, q, v, a, s > 0, M, g, Gq, Gv)
    return M, g, Gq, Gv


@inner
def add_inertia(
    body: Inertia,
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    tangents: bool,
    M: np.ndarray,
    g: np.ndarray,
    Gq: np.ndarray,
    Gv: np.ndarray,
) -> None:
    """g = M(q)a + c(q, v) (s,), with tangents M, ∂g/∂q, ∂c/∂v (s, s), too, into what is given as zeros, s = 12 + n.

        p̈ = a_r + Σ_j y_j a_j + RΦα + 2ṘΦη̇,  y = x + Φη,     g = ∫ρ Jᵀp̈,  J = ∂p/∂q = [1, y₁1, y₂1, y₃1, RΦ]
        ŝ = ∫ρ y,  Ĵ = ∫ρ y yᵀ,  C_j = ∫ρ y_j Φ,  E_ij = ∫ρ φ_iᵀφ_j  (n, n), φ_i row i of Φ,  RᵀR = 1

    a = [a_r, a_1, a_2, a_3, α] the accelerations. All that is quadratic in the modes is Σ_m x_m E_ij[m, :] of x = η, α and η̇,
    and Σ_ij s_ij E_ij of s = RᵀṘ and RᵀA, by one passage through E. Source: differentiation of p = r + R(x + Φη) and d'Alembert.
    """
    n = body.modal.shape[0]
    at = body.at
    R, W, A = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    spin, bent = np.zeros((3, 3)), np.zeros((3, 3))
    for j in range(3):
        for i in range(3):
            R[i, j], W[i, j], A[i, j] = q[at + 3 + 3 * j + i], v[at + 3 + 3 * j + i], a[at + 3 + 3 * j + i]
    for i in range(3):
        for j in range(3):
            for c in range(3):
                spin[i, j] += R[c, i] * W[c, j]
                bent[i, j] += R[c, i] * A[c, j]
    eta, rate, alpha = q[at + 12 : at + 12 + n], v[at + 12 : at + 12 + n], a[at + 12 : at + 12 + n]
    S, E = body.first_modal, body.coupling_modal
    C, by_rate, by_alpha = body.coupling.copy(), np.zeros((3, 3, n)), np.zeros((3, 3, n))
    turned, swung = np.zeros((n, n)), np.zeros((n, n))
    for k in range(n):
        for i in range(3):
            for j in range(3):
                for m in range(n):
                    C[i, j, m] += eta[k] * E[k, i, j, m]
                    by_rate[i, j, m] += rate[k] * E[k, i, j, m]
                if tangents:
                    for m in range(n):
                        by_alpha[i, j, m] += alpha[k] * E[k, i, j, m]
                        turned[k, m] += spin[i, j] * E[k, i, j, m]
                        swung[k, m] += bent[i, j] * E[k, i, j, m]
    s, J = body.first.copy(), body.second.copy()
    # ∫ρ Φα and 2 ∫ρ Φη̇, then with y_i before them
    push, drift = np.zeros((4, 3)), np.zeros((4, 3))
    for j in range(3):
        for m in range(n):
            s[j] += S[j, m] * eta[m]
            push[0, j] += S[j, m] * alpha[m]
            drift[0, j] += 2 * S[j, m] * rate[m]
        for i in range(3):
            for m in range(n):
                # Ĵ = ∫ρ (x + Φη)(x + Φη)ᵀ by C, which has one of the two deformed already
                J[i, j] += 0.5 * eta[m] * (C[i, j, m] + C[j, i, m] + body.coupling[i, j, m] + body.coupling[j, i, m])
                push[1 + i, j] += C[i, j, m] * alpha[m]
                drift[1 + i, j] += 2 * C[i, j, m] * rate[m]
    for c in range(3):
        g[c] = body.mass * a[at + c]
        for j in range(3):
            g[c] += A[c, j] * s[j] + R[c, j] * push[0, j] + W[c, j] * drift[0, j]
        for i in range(3):
            value = s[i] * a[at + c]
            for j in range(3):
                value += J[i, j] * A[c, j] + R[c, j] * push[1 + i, j] + W[c, j] * drift[1 + i, j]
            g[3 + 3 * i + c] = value
    for j in range(3):
        forward = R[0, j] * a[at] + R[1, j] * a[at + 1] + R[2, j] * a[at + 2]
        for m in range(n):
            g[12 + m] += S[j, m] * forward
        for i in range(3):
            for m in range(n):
                g[12 + m] += C[i, j, m] * bent[j, i] + 2 * spin[j, i] * by_rate[i, j, m]
    for m in range(n):
        for k in range(n):
            g[12 + m] += body.modal[m, k] * alpha[k]
    if not tangents:
        return
    for c in range(3):
        M[c, c] = body.mass
        for j in range(3):
            col = 3 + 3 * j + c
            M[c, col] = M[col, c] = s[j]
            Gq[c, col], Gv[c, col] = push[0, j], drift[0, j]
            for i in range(3):
                M[3 + 3 * i + c, col] = J[i, j]
                Gq[3 + 3 * i + c, col], Gv[3 + 3 * i + c, col] = push[1 + i, j], drift[1 + i, j]
        for j in range(3):
            col = 3 + 3 * j + c
            for m in range(n):
                M[c, 12 + m] += R[c, j] * S[j, m]
                Gq[c, 12 + m] += A[c, j] * S[j, m]
                Gv[c, 12 + m] += 2 * W[c, j] * S[j, m]
                Gq[12 + m, col] += S[j, m] * a[at + c]
            for i in range(3):
                row = 3 + 3 * i + c
                for m in range(n):
                    M[row, 12 + m] += R[c, j] * C[i, j, m]
                    Gv[row, 12 + m] += 2 * W[c, j] * C[i, j, m]
                    # ∂Ĵ_ij/∂η = C_i[j] + C_j[i];  ∂C_i/∂η = E_i
                    Gq[row, 12 + m] += (C[i, j, m] + C[j, i, m]) * A[c, j] + R[c, j] * by_alpha[j, i, m]
                    Gq[row, 12 + m] += 2 * W[c, j] * by_rate[j, i, m]
                    Gq[12 + m, col] += C[i, j, m] * A[c, i]
                    # R_j on the rate of φ_j, and Ṙ_i on that of φ_i: both halves of s_ji = R_j·Ṙ_i
                    Gq[12 + m, col] += 2 * W[c, i] * by_rate[i, j, m]
                    Gv[12 + m, row] += 2 * R[c, j] * by_rate[i, j, m]
            for m in range(n):
                Gq[3 + 3 * j + c, 12 + m] += S[j, m] * a[at + c]
    for m in range(n):
        for row in range(12):
            M[12 + m, row] = M[row, 12 + m]
        for k in range(n):
            M[12 + m, 12 + k] = body.modal[m, k]
            Gq[12 + m, 12 + k] = swung[m, k]
            Gv[12 + m, 12 + k] = 2 * turned[m, k]
