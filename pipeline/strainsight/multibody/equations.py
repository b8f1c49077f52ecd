"""The equations of motion and all their derivatives at one state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.errors import NumericalError
from strainsight.multibody.bodies import cross_matrix
from strainsight.multibody.compiled.arrays import compiled
from strainsight.multibody.compiled.equations import BROKEN, SOLVED, natural_equations
from strainsight.multibody.forces import Load
from strainsight.multibody.inertia import inertia_load
from strainsight.multibody.joints import Driven, driven_of
from strainsight.multibody.relations import relation_rows
from strainsight.multibody.system import Element, System


@dataclass(frozen=True)
class Balance:
    """(1.3) at (q, v, a, μ, λ, u, θ), without the multipliers: M a + c + f.

    phi φ (m,); B (m, n) = ∂φ/∂q; B_rate (m, n) = ∂φ̇/∂q; driven: φ_t and more where joints are driven, φ̇ = Bv + φ_t;
    load (n,) = M(q)a + c(q, v) + f(q, v, u, θ); mass M (n, n);
    stiffness (n, n) = ∂(load − Bᵀλ)/∂q; damping (n, n) = ∂load/∂v; constraint_stiffness (n, n) = ∂(Bᵀμ)/∂q;
    gradient (nr, n) of all relations; by_parameters (n, nθ + width of u): ∂f/∂(θ, u) of the elements.
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
    by_parameters: np.ndarray
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
    tangents: bool = True,
) -> Balance:
    """All terms at once, without tangents no stiffness and no damping;
    q, v, a (n,), mu, lam (m,), u (nu,), theta (nθ,).

    Every force but the moment is conjugate to relations ρ: f = ∇ρᵀF with F = −u for an input, −1 for the weight, F(ρ, ρ̇, θ)
    for an element, ρ̇ = ∇ρ v; ∂f/∂q = ∇ρᵀ(∂F/∂ρ ∇ρ + ∂F/∂ρ̇ vᵀ∇²ρ) + Σ F ∇²ρ, ∂f/∂v = ∇ρᵀ ∂F/∂ρ̇ ∇ρ.
    """
    q, v, a, mu, lam, u, theta = (np.ascontiguousarray(x, dtype=float) for x in (q, v, a, mu, lam, u, theta))
    m, own = system.constrained, compiled(system)
    point = own.at(system, theta)._replace(u=u)
    state, t = natural_equations(own.natural, point, theta, np.zeros(own.memory), q, v, a, mu, lam, tangents)
    if state == BROKEN and (failure := own.failure()):
        raise failure
    if state != SOLVED:
        rho, G, _ = relation_rows(system.products, q, v)
        for element in system.elements:
            element_load(element, rho[element.rows], G[element.rows] @ v, theta, u)
        raise NumericalError("a force law has no load here")
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
    first = len(system.parameters)
    slopes = at.by_parameters[:, first : first + len(system.inputs)].copy()
    rows, which = system.input_rows
    for row, k in zip(rows, which, strict=True):
        slopes[:, k] -= at.gradient[row]
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
    elastic = (system.stiffness_terms @ q + system.damping_terms @ v).T
    return np.asarray(elastic + at.by_parameters[:, : len(system.parameters)])


def mass_at(system: System, q: np.ndarray) -> np.ndarray:
    """M(q) (n, n)."""
    zero = np.zeros(system.size)
    mass = system.mass.copy()
    for body in system.inertia:
        own = slice(body.at, body.at + 12 + len(body.modal))
        mass[own, own] = inertia_load(body, q, zero, zero)[0]
    return mass
