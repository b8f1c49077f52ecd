"""One step of implicit Euler on the GGL-stabilised equations (1.5-1.7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from strainsight.errors import InfeasibleError, NumericalError
from strainsight.multibody.equations import Balance, balance, element_load
from strainsight.multibody.initial import check_regular
from strainsight.multibody.newton import TINY, StepMatrix, step_matrix
from strainsight.multibody.products import relation_rows
from strainsight.multibody.system import System

ITERATIONS = 25
CONVERGED = 1e-12
"""Largest correction of a body's coordinates beside the coordinates themselves, or its expected successor."""
ROUNDING = 1e-8
"""A correction below this that no longer shrinks is rounding."""
SLOW = 1e-3
"""Motion in a step beside the coordinates below which the velocity is as good as none."""
STILL = 1e-10
"""Deformation of a body beside the whole system's coordinates that is as good as none: what no load deforms is rounding."""
LEAST = 1e-3
"""Share of a correction below which Newton's iteration is given up."""
HALVINGS = 6
"""How often the step is halved to find a start for Newton's iteration."""


@dataclass(frozen=True)
class Step:
    """(q, v)_{k+1} with μ, λ (m,) [h· and 1· the unit of a constraint force], iterations, and what it was the answer to.

    factor: the last Newton matrix, factorised one correction before (q, v).
    """

    q: np.ndarray
    v: np.ndarray
    mu: np.ndarray
    lam: np.ndarray
    iterations: int
    factor: StepMatrix
    start: tuple[np.ndarray, np.ndarray]
    u: np.ndarray
    theta: np.ndarray
    h: float


def step(
    system: System,
    q: np.ndarray,
    v: np.ndarray,
    u: np.ndarray,
    h: float,
    theta: np.ndarray,
    w: np.ndarray | None = None,
    guess: Step | None = None,
    near: tuple[np.ndarray, np.ndarray] | None = None,
) -> Step:
    """The state one step later, from

        D² ((q' − q)/h − v') + B(q')ᵀμ = 0,    M(q')(v' − v)/h + c(q', v') + f(q', v', u, θ) − B(q')ᵀλ = w
        B(q')v' = −φ_t,    φ(q', t') = 0

    q, v (n,) at the start [SI], need not satisfy φ = 0; u at the end of the step, where joints are driven with p and ṗ of then
    (φ_t = φ_p ṗ, else 0); h [s]; theta (nθ,); w (n,) an
    extra generalised force; guess: the step before, whose multipliers start Newton's iteration; near: q', v' (n,) from which
    it starts first, by default q + hv, v. D², the diagonal scale
    of the mass (`System.metric`), stands where the thesis has 1, so that no unit matters; μ = 0 in the exact solution.
    Where Newton fails from the start it is led there by steps of h/2, h/4, …: the equations stay those of h.
    Raises NumericalError naming the constraint, body or force that is farthest from balance.
    Source: thesis (1.5-1.7); Gear, Gupta, Leimkuhler, J. Comput. Appl. Math. 12 (1985).
    """
    u, theta = np.asarray(u, dtype=float), np.asarray(theta, dtype=float)
    problem = _Problem(system, q, v, u, theta, w, system.at(theta), np.zeros(system.constrained))
    m = system.constrained
    mu, lam = (guess.mu, guess.lam) if guess is not None else (np.zeros(m), np.zeros(m))
    first = (q + h * v, v, mu, lam)
    if near is not None:
        try:
            return _newton(problem, h, (*near, mu, lam))
        except NumericalError:
            pass
    try:
        return _newton(problem, h, first)
    except NumericalError:
        for halvings in range(1, HALVINGS + 1):
            found = _lead(problem, h, first, halvings)
            if found is not None:
                return found
    return _newton(problem, h, first)


@dataclass(frozen=True)
class _Problem:
    system: System
    q: np.ndarray
    v: np.ndarray
    u: np.ndarray
    theta: np.ndarray
    w: np.ndarray | None
    elastic: tuple[np.ndarray, np.ndarray]
    still: np.ndarray


def _lead(problem: _Problem, h: float, first: tuple[np.ndarray, ...], halvings: int) -> Step | None:
    """Newton at h/2ᵏ, …, h/2, h, each started from the one before."""
    q, v = problem.q, problem.v
    start = first
    try:
        for k in range(halvings, -1, -1):
            part = h / 2**k
            start = (start[0] if k < halvings else q + part * v, *start[1:])
            found = _newton(problem, part, start)
            start = (found.q + (found.q - q), 2 * found.v - v, found.mu, found.lam)
    except NumericalError:
        return None
    return found


def _newton(problem: _Problem, h: float, start: tuple[np.ndarray, ...]) -> Step:
    """Undamped while the corrections shrink; a step after which they grow is halved."""
    system, d = problem.system, problem.system.metric
    q, v, mu, lam = start
    before, share = np.inf, 1.0
    last: tuple[np.ndarray, ...] | None = None
    for iteration in range(1, ITERATIONS + 1):
        try:
            at = _balance(problem, h, q, v, mu, lam)
        except NumericalError:
            # a force that cannot be had at a trial state: go there by half
            share *= 0.5
            if last is None or share < LEAST:
                raise
            q, v, mu, lam = (z + share * dz for z, dz in zip(last[:4], last[4:], strict=True))
            continue
        load = at.load if problem.w is None else at.load - problem.w
        still = problem.still if at.driven is None else at.driven.rate
        r1, r2, r3, finite = _residual(d, h, problem.q, q, v, mu, lam, at.B, at.phi, still, load)
        residual, failed = (r1, r2, r3, at.phi), not finite
        if not failed:
            try:
                factor = step_matrix(at, d, h)
            except NumericalError as error:
                raise _refusal(problem, h, (q, v), residual, at, iteration, error.what) from error
            dq, dv, dmu, dlam = (z[:, 0] for z in factor.solve(*(-r[:, None] for r in residual)))
            size = _size(system.starts, d, q, v, dq, dv, h)
            failed = not np.isfinite(size)
        if last is not None and (failed or (size > 2 * before and size > 1e-3)):
            share *= 0.5
            if share < LEAST:
                raise _refusal(problem, h, (q, v), residual, at, iteration, "Newton's iteration does not converge")
            q, v, mu, lam = (z + share * dz for z, dz in zip(last[:4], last[4:], strict=True))
            continue
        if failed:
            raise _refusal(problem, h, (q, v), residual, at, iteration, "it meets what is not finite")
        last = (q, v, mu, lam, dq, dv, dmu, dlam)
        q, v, mu, lam = q + dq, v + dv, mu + dmu, lam + dlam
        beyond = size * (size / before) if iteration > 1 and size < 0.01 * before else np.inf
        if size <= CONVERGED or beyond <= 0.1 * CONVERGED or (iteration > 2 and 0.3 * before < size < ROUNDING):
            return Step(q, v, mu, lam, iteration, factor, (problem.q, problem.v), problem.u, problem.theta, h)
        before, share = size, 1.0
    raise _refusal(problem, h, (q, v), residual, at, ITERATIONS, "Newton's iteration does not converge")


def _balance(problem: _Problem, h: float, q: np.ndarray, v: np.ndarray, mu: np.ndarray, lam: np.ndarray) -> Balance:
    return balance(problem.system, q, v, (v - problem.v) / h, mu, lam, problem.u, problem.theta, problem.elastic)


@njit(cache=True)
def _residual(
    d: np.ndarray,
    h: float,
    start: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    mu: np.ndarray,
    lam: np.ndarray,
    B: np.ndarray,
    phi: np.ndarray,
    rate: np.ndarray,
    load: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
    """The first three equations of `step` at a trial state, and whether all four are finite."""
    n, m = len(d), len(phi)
    r1, r2, r3 = np.empty(n), load.copy(), rate.copy()
    for i in range(n):
        r1[i] = d[i] * d[i] * ((q[i] - start[i]) / h - v[i])
    for k in range(m):
        for i in range(n):
            r1[i] += B[k, i] * mu[k]
            r2[i] -= B[k, i] * lam[k]
            r3[k] += B[k, i] * v[i]
    return r1, r2, r3, bool(np.isfinite(r1.sum() + r2.sum() + r3.sum() + phi.sum()))


@njit(cache=True)
def _size(
    starts: np.ndarray, d: np.ndarray, q: np.ndarray, v: np.ndarray, dq: np.ndarray, dv: np.ndarray, h: float
) -> float:
    """Largest correction of any body: of its coordinates beside these, of its velocity beside this or SLOW of them, [-]."""
    ends = np.append(starts[1:], len(d))
    squares = np.zeros((len(starts), 4))
    for body in range(len(starts)):
        for i in range(starts[body], ends[body]):
            squares[body, 0] += (d[i] * dq[i]) ** 2
            squares[body, 1] += (h * d[i] * dv[i]) ** 2
            squares[body, 2] += (d[i] * (q[i] + dq[i])) ** 2
            squares[body, 3] += (h * d[i] * (v[i] + dv[i])) ** 2
    whole, largest = squares[:, 2].sum(), 0.0
    if not np.isfinite(squares.sum()):
        return np.inf
    for body in range(len(starts)):
        own = max(squares[body, 2], STILL**2 * whole)
        largest = max(largest, squares[body, 0] / max(own, TINY))
        largest = max(largest, squares[body, 1] / max(squares[body, 3], SLOW**2 * own, TINY))
    return float(np.sqrt(largest))


def _refusal(
    problem: _Problem,
    h: float,
    trial: tuple[np.ndarray, ...],
    residual: tuple[np.ndarray, ...],
    at: Balance,
    count: int,
    why: str,
) -> NumericalError:
    """The error that names a broken force, else the constraint farthest from zero, else the body off balance."""
    return NumericalError(
        f"the step of {h:g} s was not solved after {count} iterations: {why}; {_farthest(problem, h, trial, residual, at)}"
        f"{_dependent(problem.system, trial[0], problem.u)}",
        remedy="take a smaller time step, or start from a consistent state (`project_position`, `project_velocity`)",
    )


def _farthest(
    problem: _Problem, h: float, trial: tuple[np.ndarray, ...], residual: tuple[np.ndarray, ...], at: Balance
) -> str:
    system, d = problem.system, problem.system.metric
    q, v = trial[:2]
    rho, G, *_ = relation_rows(system.products, q, v)
    for element in system.elements:
        F = element_load(element, rho[element.rows], G[element.rows] @ v, problem.theta, problem.u).F
        if not np.all(np.isfinite(F)):
            return f"force {element.force.name} is not finite"
    _, r2, r3, r4 = residual
    lengths = np.sqrt(np.maximum(np.einsum("ij,ij->i", at.B / d, at.B / d), np.finfo(float).tiny))
    whole = float(np.linalg.norm(d * problem.q)) or 1.0
    off = np.concatenate([np.abs(r4), h * np.abs(r3)]) / np.tile(lengths, 2) / whole
    if len(off) and np.max(off) > 1e-6:
        worst = int(np.argmax(off))
        row, moving = worst % len(r4), worst >= len(r4)
        value = r3[row] if moving else r4[row]
        return f"largest residual {value:.3g} in {'the rate of ' if moving else ''}{system.constraints[row]}"
    forces = np.abs(r2 / d)
    name = max(system.of, key=lambda body: float(np.max(forces[system.of[body]], initial=0.0)))
    return f"largest residual {np.max(np.abs(r2[system.of[name]])):.3g} in the balance of body {name}"


def _dependent(system: System, q: np.ndarray, u: np.ndarray) -> str:
    if not np.all(np.isfinite(q)):
        return ""
    try:
        check_regular(system, q, u)
    except InfeasibleError as error:
        return f"; {error.what}"
    return ""
