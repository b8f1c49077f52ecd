"""Accelerations at an instant, and the reactions of joints and drives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dgecon, dgetrf, dgetrs

from strainsight.errors import NumericalError
from strainsight.multibody.bodies import Carried, Frame, cross_matrix, inertia_load
from strainsight.multibody.compiled.arrays import compile_system
from strainsight.multibody.compiled.equations import BROKEN, SOLVED, natural_equations
from strainsight.multibody.forces import Gravity, Load
from strainsight.multibody.joints import Driven, DrivenRelation, Joint, driven_of
from strainsight.multibody.laws import TurningGravity
from strainsight.multibody.relations import Relation, relation_bends, relation_rows
from strainsight.multibody.sensors import CompiledSensors, Felt
from strainsight.multibody.system import Element, System


@dataclass(frozen=True)
class Balance:
    """(1.3) at (q, v, a, μ, λ, u, θ), without the multipliers: M a + c + f. phi φ (m,); B (m, n) = ∂φ/∂q; B_rate (m, n) =
    ∂φ̇/∂q; driven: φ_t and more where joints are driven, φ̇ = Bv + φ_t; load (n,) = M(q)a + c(q, v) + f(q, v, u, θ); mass M
    (n, n); stiffness (n, n) = ∂(load − Bᵀλ)/∂q; damping (n, n) = ∂load/∂v; constraint_stiffness (n, n) = ∂(Bᵀμ)/∂q; gradient
    (nr, n) of all relations; by_parameters (n, nθ + width of u): ∂f/∂(θ, u) of the elements."""

    phi: np.ndarray
    B: np.ndarray
    B_rate: np.ndarray
    load: np.ndarray
    mass: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    constraint_stiffness: np.ndarray
    gradient: np.ndarray
    by_parameters: np.ndarray
    driven: Driven | None


def balance(
    system: System,
    q: np.ndarray,
    v: np.ndarray,
    u: np.ndarray,
    theta: np.ndarray,
    *,
    a: np.ndarray | None = None,
    lam: np.ndarray | None = None,
    mu: np.ndarray | None = None,
    tangents: bool = True,
) -> Balance:
    """All terms at once, without tangents no stiffness and no damping; q, v, a (n,), u (nu,), theta (nθ,), lam, mu (m,); what is
    left out is zero.

    Every force but the moment is conjugate to relations ρ: f = ∇ρᵀF with F = −u for an input, −1 for the weight, F(ρ, ρ̇, θ)
    for an element, ρ̇ = ∇ρ v; ∂f/∂q = ∇ρᵀ(∂F/∂ρ ∇ρ + ∂F/∂ρ̇ vᵀ∇²ρ) + Σ F ∇²ρ, ∂f/∂v = ∇ρᵀ ∂F/∂ρ̇ ∇ρ."""
    m, arrays = system.constrained, compile_system(system)
    q, v, u, theta = (np.ascontiguousarray(x, dtype=float) for x in (q, v, u, theta))
    a, lam, mu = (
        np.zeros(size) if x is None else np.ascontiguousarray(x, dtype=float)
        for x, size in ((a, system.size), (lam, m), (mu, m))
    )
    point = arrays.at(system, theta)._replace(u=u)
    state, t = natural_equations(arrays.natural, point, np.zeros(arrays.memory), q, v, a, mu, lam, tangents)
    if state == BROKEN and (failure := arrays.failure()):
        raise failure
    if state != SOLVED:
        rho, G, _ = relation_rows(system.products, q, v)
        for element in system.elements:
            element_load(element, rho[element.rows], G[element.rows] @ v, theta, u)
        raise NumericalError(
            "a force on a body is not finite at the current positions of the bodies",
            remedy="correct the poses of the bodies, or use a smaller time step",
        )
    load, stiffness, mass = t.r2 + t.g[:m].T @ lam, t.K, system.mass
    for moment in system.moments:
        T = moment.directions @ u[moment.inputs]
        if moment.R >= 0:
            cross = 0.5 * cross_matrix(T)
            for j in range(3):
                at = slice(moment.R + 3 * j, moment.R + 3 * j + 3)
                load[at] -= cross @ q[at]
                load[moment.eta] -= moment.rotation[j] * (q[at] @ T)
                if tangents:
                    stiffness[at, at] -= cross
                    stiffness[moment.eta, at] -= np.outer(moment.rotation[j], T)
        else:
            load[moment.eta] -= moment.rotation.T @ T
    if system.inertia:
        mass = mass.copy()
        for body in system.inertia:
            span = slice(body.at, body.at + 12 + len(body.modal))
            mass[span, span] = t.TM[span, : span.stop - span.start]
    driven = driven_of(system.drives, m, u, t.by_drive)
    return Balance(t.r4, t.g[:m], t.gr[:m], load, mass, stiffness, t.A, t.X, t.g, t.by_parameters, driven)


def element_load(element: Element, rho: np.ndarray, rho_dot: np.ndarray, theta: np.ndarray, u: np.ndarray) -> Load:
    """Of an element's relations, ρ and ρ̇ (k,), from θ (nθ,) and u of the system. Raises NumericalError that names the
    element."""
    force = element.force
    try:
        return force.law.load(rho, rho_dot, np.concatenate([theta[element.parameters], u[element.inputs]]))
    except NumericalError as error:
        raise NumericalError(f"{force.name}: {error.what}", remedy=error.remedy) from error


def input_slopes(system: System, at: Balance, q: np.ndarray) -> np.ndarray:
    """∂f/∂u (n, nu)."""
    first = len(system.parameters)
    slopes = at.by_parameters[:, first : first + len(system.inputs)].copy()
    rows, which = system.input_rows
    for row, k in zip(rows, which, strict=True):
        slopes[:, k] -= at.gradient[row]
    for moment in system.moments:
        if moment.R >= 0:
            R = q[moment.R : moment.R + 9].reshape(3, 3).T
            for j in range(3):
                column = slice(moment.R + 3 * j, moment.R + 3 * j + 3)
                slopes[column, moment.inputs] -= 0.5 * np.cross(moment.directions.T, R[:, j]).T
            slopes[moment.eta, moment.inputs] -= moment.rotation.T @ (R.T @ moment.directions)
        else:
            slopes[moment.eta, moment.inputs] -= moment.rotation.T @ moment.directions
    return slopes


def parameter_slopes(system: System, at: Balance, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """∂f/∂θ (n, nθ)."""
    elastic = (system.stiffness_terms @ q + system.damping_terms @ v).T
    return np.asarray(elastic + at.by_parameters[:, : len(system.parameters)])


def mass_at(system: System, q: np.ndarray) -> np.ndarray:
    """M(q) (n, n)."""
    zero = np.zeros(system.size)
    mass = system.mass.copy()
    for body in system.inertia:
        coordinates = slice(body.at, body.at + 12 + len(body.modal))
        mass[coordinates, coordinates] = inertia_load(body, q, zero, zero)[0]
    return mass


TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class Instant:
    """v̇ (n,), λ (m,), and of every drive the force or torque (nd,) [N or N m] that does the work force · ṗ on the bench."""

    acceleration: np.ndarray
    lam: np.ndarray
    drive: np.ndarray


def instant(
    system: System, q: np.ndarray, v: np.ndarray, u: np.ndarray, theta: np.ndarray, p_second: np.ndarray
) -> Instant:
    """Accelerations and reactions of a state on the constraints by (1.3), independent of any time step:

        [M  −Bᵀ] [v̇]     [c + f                                  ]
        [B   0 ] [λ ] = − [B_rate v + ṗ (B_p v + ∂φ_t/∂p) + φ_p p̈]

    q, v (n,) with φ = 0, Bv = −φ_t; u as in `advance`; p_second (nd,) p̈ of the drives. Where constraints become dependent, the
    smallest λ. The force of a drive is −Σ λ φ_p."""
    n, d, drives = system.size, system.metric, system.drives
    at = balance(system, q, v, u, theta, tangents=False)
    bend = at.B_rate @ v
    if at.driven is not None:
        p_rate = u[drives.at + len(drives.names) :]
        for i, (row, k) in enumerate(zip(drives.row, drives.which, strict=True)):
            bend[row] += p_rate[k] * (at.driven.gradient[i] @ v + at.driven.bend[i]) + at.driven.slope[i] * p_second[k]
    A, s = _matrix(system, at)
    z = _solve(A, -np.concatenate([at.load * (1 / d), s * bend]))
    lam, force = z[n:] * s, np.zeros(len(drives.names))
    if at.driven is not None:
        np.add.at(force, drives.which, -lam[drives.row] * at.driven.slope)
    return Instant(z[:n] / d, lam, force)


@dataclass(frozen=True)
class InstantSlopes:
    """∂v̇/∂q, ∂v̇/∂v (n, n), ∂v̇/∂u (n, loads), ∂v̇/∂θ (n, nθ) of `instant`."""

    by_q: np.ndarray
    by_v: np.ndarray
    by_u: np.ndarray
    by_theta: np.ndarray


def instant_slopes(
    system: System, q: np.ndarray, v: np.ndarray, u: np.ndarray, theta: np.ndarray, p_second: np.ndarray, now: Instant
) -> InstantSlopes:
    """Of the instant, by both rows of (1.3) as they are solved for (v̇, λ), off the constraints, too: [M  −Bᵀ] [∂v̇]     [∂(M
    v̇ + c + f − Bᵀλ)                      ] [B   0 ] [∂λ] = − [∂(B v̇ + B_rate v + …) = ∂φ̈,  ∂φ̈/∂v = 2 B_rate]"""
    n, m, d = system.size, system.constrained, system.metric
    at = balance(system, q, v, u, theta, a=now.acceleration, lam=now.lam)
    A, s = _matrix(system, at)
    by_u, by_theta = input_slopes(system, at, q), parameter_slopes(system, at, q, v)
    upper = np.hstack([at.stiffness, at.damping, by_u, by_theta]) / d[:, None]
    lower = np.zeros((m, upper.shape[1]))
    lower[:, :n], lower[:, n : 2 * n] = _bends(system, at, q, v, now.acceleration, u, p_second), 2 * at.B_rate
    z = _solve(A, -np.vstack([upper, s[:, None] * lower]))[:n] / d[:, None]
    return InstantSlopes(*np.split(z, np.cumsum([n, n, by_u.shape[1]]), axis=1))


def _bends(
    system: System, at: Balance, q: np.ndarray, v: np.ndarray, a: np.ndarray, u: np.ndarray, p_second: np.ndarray
) -> np.ndarray:
    """∂φ̈/∂q (m, n); of a driven angle φ̈ = cos p ρ̈ − sin p ρ̈' + 2ṗ φ̇_p + p̈ φ_p − ṗ² φ, with ρ̇ for ρ in φ̇_p."""
    drives, m = system.drives, system.constrained
    whole = relation_bends(system.products, q, v, a)
    bends = whole[:m].copy()
    if at.driven is None:
        return bends
    rate = relation_rows(system.products, q, v)[2]
    p, p_rate = u[drives.at : drives.at + len(drives.names)], u[drives.at + len(drives.names) :]
    for i, (row, across, k) in enumerate(zip(drives.row, drives.across, drives.which, strict=True)):
        if across < 0:
            continue  # neither p nor its square multiplies q
        c, s = np.cos(p[k]), np.sin(p[k])
        bends[row] = c * whole[row] - s * whole[across] - 2 * p_rate[k] * (s * rate[row] + c * rate[across])
        bends[row] += p_second[k] * at.driven.gradient[i] - p_rate[k] ** 2 * at.B[row]
    return bends


def _matrix(system: System, at: Balance) -> tuple[np.ndarray, np.ndarray]:
    """That of `instant` (n + m square) for (D v̇, λ/s), and s (m,)."""
    per = 1 / system.metric
    B, s = unit_rows(at.B, per)
    return saddle((at.mass * per) * per[:, None], B), s


def unit_rows(B: np.ndarray, per: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """S B D⁻¹ (m, n) of unit rows, and S (m,), by which λ = S λ'; per (n,) = 1/d."""
    B = B * per
    s = 1 / np.maximum(np.sqrt(np.einsum("ij,ij->i", B, B)), TINY)
    B *= s[:, None]
    return B, s


def saddle(K: np.ndarray, B: np.ndarray) -> np.ndarray:
    """[K −Bᵀ; B 0] of K (n, n), B (m, n)."""
    n, m = len(K), len(B)
    A = np.zeros((n + m, n + m))
    A[:n, :n], A[:n, n:], A[n:, :n] = K, -B.T, B
    return A


def _solve(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """A⁻¹b, or the least-squares solution of least norm for a singular A; LU factors if they are regular."""
    lu, order, failed = dgetrf(A)
    if failed == 0 and dgecon(lu, np.abs(A).sum(axis=0).max())[0] > 1e-9:
        return np.asarray(dgetrs(lu, order, b)[0])
    return np.asarray(np.linalg.lstsq(A, b, rcond=1e-12)[0])


@dataclass(frozen=True)
class ReadingSlopes:
    """y (k,) of all sensors, ∂y/∂q, ∂y/∂v (k, n), ∂y/∂u (k, loads), ∂y/∂θ (k, nθ)."""

    y: np.ndarray
    by_q: np.ndarray
    by_v: np.ndarray
    by_u: np.ndarray
    by_theta: np.ndarray


def measure(
    system: System,
    sensors: CompiledSensors,
    q: np.ndarray,
    v: np.ndarray,
    u: np.ndarray,
    theta: np.ndarray,
    p_second: np.ndarray,
) -> ReadingSlopes:
    """Sensor readings and their slopes: accelerometers respond directly to loads and parameters; independent of the time step.
    Arguments as in `instant`."""
    now = instant(system, q, v, u, theta, p_second)
    felt = Felt(now.acceleration, gravity_at(system, u))
    y, by_q, by_v = sensors.read(q, v, felt)
    by_u, by_theta = np.zeros((len(y), len(system.inputs))), np.zeros((len(y), len(theta)))
    if sensors.accelerometers:
        channels, slopes = sensors.accelerated, instant_slopes(system, q, v, u, theta, p_second, now)
        *_, by_a, by_g = sensors.accelerations(q, v, felt)
        by_q[channels] += by_a @ slopes.by_q
        by_v[channels] += by_a @ slopes.by_v
        by_u[channels], by_theta[channels] = by_a @ slopes.by_u, by_a @ slopes.by_theta
        for law, k in _turning(system):
            by_u[channels, k] += by_g @ law.at(u[k])[1]
    return ReadingSlopes(y, by_q, by_v, by_u, by_theta)


def at_rest(system: System, u: np.ndarray) -> Felt:
    """Accelerometer input of a bench at rest."""
    return Felt(np.zeros(system.size), gravity_at(system, u))


def gravity_at(system: System, u: np.ndarray) -> np.ndarray:
    """Total acceleration of gravity (3,) [m/s²]."""
    steady = sum((force.acceleration for force in system.forces if isinstance(force, Gravity)), np.zeros(3))
    return np.asarray(steady + sum((law.at(u[k])[0] for law, k in _turning(system)), np.zeros(3)))


def _turning(system: System) -> list[tuple[TurningGravity, int]]:
    """Rotating gravity laws, with the index of their angle in u."""
    laws = [(element.force.law, int(element.inputs[0])) for element in system.elements if len(element.inputs)]
    return [(law, k) for law, k in laws if isinstance(law, TurningGravity)]


def reaction(
    system: System, joint: Joint, i: Frame, j: Frame, q: np.ndarray, lam: np.ndarray, u: np.ndarray
) -> np.ndarray:
    """Force [N] and moment [N m] about p_j (6,), in the axes of i, that the joint exerts on the body of j:

        F = Σ λ t y,    M = Σ λ (b − t p_j) × y     over the products b·y of its relations, b = t r + R c carried by that body

    for δ(b·y) = t δp_j·y + δθ·((b − t p_j) × y) in a virtual motion of that body about p_j. λ (m,) as of `instant`."""
    # the constraints of the rigid motions stand before those of all joints
    first = system.constrained - sum(
        len(constraint.relations) for constraint in system.joints[system.joints.index(joint) :]
    )
    side, sign = (j.body, 1.0) if j.body is not None else (i.body, -1.0)
    p, F, M = _vector(system, j.point, q), np.zeros(3), np.zeros(3)
    for k, constraint in enumerate(joint.relations):
        for relation, share in _products(system, constraint, u):
            weight = sign * share * lam[first + k]
            x, y = (sum(_vector(system, b, q) for b in side_of) for side_of in (relation.x, relation.y))
            for vectors, other in ((relation.x, y), (relation.y, x)):
                for b in vectors:
                    if b.body == side:
                        F += weight * b.t * other
                        M += weight * np.cross(_vector(system, b, q) - b.t * p, other)
    axes = np.stack([_vector(system, i.axis(k), q) for k in range(3)])
    return np.concatenate([axes @ F, axes @ M])


def _products(system: System, constraint: Relation | DrivenRelation, u: np.ndarray) -> list[tuple[Relation, float]]:
    """The relations of a constraint, each with its factor."""
    if isinstance(constraint, Relation):
        return [(constraint, 1.0)]
    p = u[system.drives.at + system.drives.names.index(constraint.drive)]
    if constraint.across is None:
        return [(constraint.relation, 1.0)]
    return [(constraint.relation, float(np.cos(p))), (constraint.across, -float(np.sin(p)))]


def _vector(system: System, b: Carried, q: np.ndarray) -> np.ndarray:
    """b (3,) at q."""
    if b.body is None:
        return np.asarray(b.c)
    coordinates, eta = system.of[b.body], q[system.modal(b.body)]
    c = b.c + b.C @ eta if b.C.shape[1] else b.c
    if coordinates.stop - coordinates.start == len(eta):
        return np.asarray(c)
    r, R = q[coordinates][:3], q[coordinates][3:12].reshape(3, 3).T
    return np.asarray(b.t * r + R @ c)
