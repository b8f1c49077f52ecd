"""The equations of motion and all their derivatives at one state."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strainsight.errors import NumericalError
from strainsight.multibody.drives import Driven, drive, spread
from strainsight.multibody.forces import Load
from strainsight.multibody.frames import cross_matrix
from strainsight.multibody.inertia import inertia_load
from strainsight.multibody.products import curvature, relation_rows
from strainsight.multibody.system import Element, System

NONE = np.zeros((0, 0))


@dataclass(frozen=True)
class Balance:
    """(1.3) at (q, v, a, μ, λ, u, θ), without the multipliers: M a + c + f.

    phi φ (m,); B (m, n) = ∂φ/∂q; B_rate (m, n) = ∂φ̇/∂q; driven: φ_t and more where joints are driven, φ̇ = Bv + φ_t;
    load (n,) = M(q)a + c(q, v) + f(q, v, u, θ); mass M (n, n);
    stiffness (n, n) = ∂(load − Bᵀλ)/∂q; damping (n, n) = ∂load/∂v; constraint_stiffness (n, n) = ∂(Bᵀμ)/∂q;
    gradient (nr, n) of all relations; slopes: ∂F/∂(θ, u) of every element.
    """

    phi: np.ndarray
    B: np.ndarray
    B_rate: np.ndarray
    load: np.ndarray
    mass: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    constraint_stiffness: np.ndarray
    gradient: np.ndarray
    slopes: tuple[np.ndarray, ...]
    driven: Driven | None


def balance(
    system: System,
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    mu: np.ndarray,
    lam: np.ndarray,
    u: np.ndarray,
    theta: np.ndarray,
    elastic: tuple[np.ndarray, np.ndarray],
    tangents: bool = True,
) -> Balance:
    """All terms at once, without tangents no stiffness and no damping;
    q, v, a (n,), mu, lam (m,), u (nu,), theta (nθ,), elastic: K(θ), C(θ) of `System.at`.

    Every force but the moment is conjugate to relations ρ: f = ∇ρᵀF with F = −u for an input, −1 for the weight, F(ρ, ρ̇, θ)
    for an element, ρ̇ = ∇ρ v; ∂f/∂q = ∇ρᵀ(∂F/∂ρ ∇ρ + ∂F/∂ρ̇ vᵀ∇²ρ) + Σ F ∇²ρ, ∂f/∂v = ∇ρᵀ ∂F/∂ρ̇ ∇ρ.
    """
    m = system.constrained
    rho, G, G_rate, b, J = relation_rows(system.products, q, v)
    driven = drive(system.drives, m, u, rho, G, G_rate)
    F = system.weights.copy()
    rows, which = system.input_rows
    if len(rows):
        F[rows] = -u[which]
    K, C = elastic
    stiffness, damping = (K.copy(), C.copy()) if tangents else (NONE, NONE)
    slopes = []
    for element in system.elements:
        own = element.rows
        g, rate = G[own], G_rate[own]
        F[own], F_rho, F_rate, F_theta = element_load(element, rho[own], g @ v, theta, u)
        slopes.append(F_theta)
        if not tangents:
            continue
        stiffness += g.T @ (F_rho @ g)
        if F_rate is not None:
            stiffness += g.T @ (F_rate @ rate)
            damping += g.T @ (F_rate @ g)
    by_mu = NONE
    if tangents:
        weight = np.zeros((2, len(F)))
        weight[0, :m] = mu
        weight[1] = F
        weight[1, :m] = -lam
        spread(system.drives, u, weight)
        by_mu, bent = curvature(system.products, system.size, weight, b, J)
        stiffness += bent
    load = G[m:].T @ F[m:]
    load += K @ q
    load += C @ v
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
    mass = system.mass
    if system.inertia:
        mass = mass.copy()
        for body in system.inertia:
            own = slice(body.at, body.at + 12 + len(body.modal))
            mass[own, own], g, Gq, Gv = inertia_load(body, q, v, a)
            load[own] += g
            if tangents:
                stiffness[own, own] += Gq
                damping[own, own] += Gv
    load += system.mass @ a
    return Balance(rho[:m], G[:m], G_rate[:m], load, mass, stiffness, damping, by_mu, G, tuple(slopes), driven)


def with_multipliers(
    system: System, at: Balance, q: np.ndarray, v: np.ndarray, lam: np.ndarray, u: np.ndarray
) -> Balance:
    """The balance at (q, v, u) that was found without λ, with λ (m,): its stiffness alone feels it."""
    _, _, _, b, J = relation_rows(system.products, q, v)
    weight = np.zeros((2, len(system.weights)))
    weight[1, : len(lam)] = -lam
    spread(system.drives, u, weight)
    return replace(at, stiffness=at.stiffness + curvature(system.products, system.size, weight, b, J)[1])


def element_load(element: Element, rho: np.ndarray, rho_dot: np.ndarray, theta: np.ndarray, u: np.ndarray) -> Load:
    """Of an element's relations, ρ and ρ̇ (k,), from θ (nθ,) and u of the system. Raises NumericalError that names the element."""
    force = element.force
    try:
        own = theta[element.parameters]
        if len(element.inputs):
            own = np.concatenate([own, u[element.inputs]])
        return force.law.load(rho, rho_dot, own)
    except NumericalError as error:
        raise NumericalError(f"{force.name}: {error.what}", remedy=error.remedy) from error


def input_slopes(system: System, at: Balance, q: np.ndarray) -> np.ndarray:
    """∂f/∂u (n, nu)."""
    slopes = np.zeros((system.size, len(system.inputs)))
    rows, which = system.input_rows
    for row, k in zip(rows, which, strict=True):
        slopes[:, k] -= at.gradient[row]
    for element, F_theta in zip(system.elements, at.slopes, strict=True):
        if len(element.inputs):
            slopes[:, element.inputs] += at.gradient[element.rows].T @ F_theta[:, len(element.parameters) :]
    for moment in system.moments:
        if moment.R >= 0:
            R = q[moment.R : moment.R + 9].reshape(3, 3).T
            for j in range(3):
                own = slice(moment.R + 3 * j, moment.R + 3 * j + 3)
                slopes[own, moment.inputs] -= 0.5 * np.cross(moment.directions.T, R[:, j]).T
            slopes[moment.eta, moment.inputs] -= moment.rotation.T @ (R.T @ moment.directions)
        else:
            slopes[moment.eta, moment.inputs] -= moment.rotation.T @ moment.directions
    return slopes


def parameter_slopes(system: System, at: Balance, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """∂f/∂θ (n, nθ)."""
    slopes = (system.stiffness_terms @ q + system.damping_terms @ v).T
    for element, own in zip(system.elements, at.slopes, strict=True):
        if len(element.parameters):
            contribution = at.gradient[element.rows].T @ own
            for k, name in enumerate(element.parameters):
                slopes[:, name] += contribution[:, k]
    return slopes


def mass_at(system: System, q: np.ndarray) -> np.ndarray:
    """M(q) (n, n)."""
    zero = np.zeros(system.size)
    mass = system.mass.copy()
    for body in system.inertia:
        own = slice(body.at, body.at + 12 + len(body.modal))
        mass[own, own] = inertia_load(body, q, zero, zero)[0]
    return mass
