"""One step in time: implicit Euler on the GGL-stabilised equations (1.5-1.7), or two implicit stages, and their slopes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np

from strainsight.errors import InfeasibleError, NumericalError
from strainsight.multibody.accelerations import balance, element_load, unit_rows
from strainsight.multibody.compiled import newton as iteration
from strainsight.multibody.compiled.arrays import NONE, Compiled, StepPoint, compile_system
from strainsight.multibody.compiled.equations import BROKEN, SOLVED
from strainsight.multibody.compiled.stages import Past, Stages, Steps, nothing, solve_stages, step_slopes
from strainsight.multibody.initial import check_regular
from strainsight.multibody.joints import between
from strainsight.multibody.relations import relation_rows
from strainsight.multibody.system import System

HALVINGS = 6
"""Halvings of the step to find a start for Newton's iteration."""


@dataclass(frozen=True)
class EulerStep:
    """(q, v)_{k+1} with μ, λ (m,) [h· and 1· the unit of a constraint force], iterations, and what it was the answer to. μ
    and λ are those of the joints; they are zero for the rigidity of bodies, which is not among the equations that are solved.
    motion ζ (nt,): v in minimal coordinates; memory: what force laws remember."""

    q: np.ndarray
    v: np.ndarray
    mu: np.ndarray
    lam: np.ndarray
    iterations: int
    motion: np.ndarray
    memory: np.ndarray
    start: tuple[np.ndarray, np.ndarray]
    u: np.ndarray
    theta: np.ndarray
    w: np.ndarray
    h: float


def step(
    system: System,
    q: np.ndarray,
    v: np.ndarray,
    u: np.ndarray,
    h: float,
    theta: np.ndarray,
    w: np.ndarray | None = None,
    guess: EulerStep | None = None,
) -> EulerStep:
    """The state one step later, from

        D² ((q' − q)/h − v') + B(q')ᵀμ = 0,    M(q')(v' − v)/h + c(q', v') + f(q', v', u, θ) − B(q')ᵀλ = w
        B(q')v' = −φ_t,    φ(q', t') = 0

    q, v (n,) at the start [SI], need not satisfy φ = 0; u at the end of the step, where joints are driven with p and ṗ of then
    (φ_t = φ_p ṗ, else 0); h [s]; theta (nθ,); w (n,) an
    extra generalised force; guess: the step before, whose multipliers start Newton's iteration. D², the diagonal scale
    of the mass (`System.metric`), stands where the thesis has 1, so that no unit matters; μ = 0 in the exact solution.
    The rotations R' of the trial states are rotations, v' = T(q')ζ' moves them as such, and both equations are taken along T:
    so the constraints of rigidity and their multipliers are out of it, and the answer is the same.
    Where Newton fails from the start it is led there by steps of h/2, h/4, …: the equations stay those of h.
    Raises NumericalError naming the constraint, body or force that is farthest from balance.
    Source: thesis (1.5-1.7); Gear, Gupta, Leimkuhler, J. Comput. Appl. Math. 12 (1985)."""
    problem = problem_of(system, q, v, u[None, None], theta, w)
    first = _Trial(problem.q + h * problem.v, problem.v, *left_by(problem, guess))
    try:
        return _newton(problem, h, first)
    except NumericalError:
        for halvings in range(1, HALVINGS + 1):
            if (lead := _lead(problem, h, first, halvings)) is not None:
                return lead
    return _newton(problem, h, first)


class StepProblem(NamedTuple):
    """Start and conditions of steps: q, v (n,); u (T, k, nu) at k stages each, θ, w (n,) or (0,)."""

    system: System
    compiled: Compiled
    point: StepPoint
    q: np.ndarray
    v: np.ndarray
    u: np.ndarray
    theta: np.ndarray
    w: np.ndarray


def problem_of(
    system: System, q: np.ndarray, v: np.ndarray, u: np.ndarray, theta: np.ndarray, w: np.ndarray | None
) -> StepProblem:
    """The problem with contiguous arrays."""
    result = compile_system(system)
    q, v = np.ascontiguousarray(q, dtype=float), np.ascontiguousarray(v, dtype=float)
    u, theta = np.ascontiguousarray(u, dtype=float), np.ascontiguousarray(theta, dtype=float)
    w = NONE if w is None else np.ascontiguousarray(w, dtype=float)
    return StepProblem(system, result, result.at(system, theta), q, v, u, theta, w)


def left_by(problem: StepProblem, guess: EulerStep | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """μ, λ (m,) and the memory of force laws after the previous stage."""
    if guess is not None:
        return guess.mu, guess.lam, guess.memory
    none = np.zeros(problem.system.constrained)
    return none, none, np.zeros(problem.compiled.memory)


def solve_steps(
    problem: StepProblem,
    h: float,
    carried: float,
    left: tuple[np.ndarray, np.ndarray, np.ndarray],
    near: tuple[np.ndarray, np.ndarray] | None,
    past: Past,
) -> Steps:
    """`solve_stages` of the problem; near: where the iteration of the last stage starts. Raises the errors of laws in Python."""
    point = problem.point._replace(q=problem.q, v=problem.v, h=h, u=problem.u[0, 0], w=problem.w)
    start = np.zeros((0, len(problem.q))) if near is None else np.stack(near)
    mu, lam, memory = left
    arrays = problem.compiled
    solution: Steps = solve_stages(
        arrays.arrays, arrays.pattern, point, problem.u, carried, memory, mu, lam, start, past
    )
    if solution.last.ended == BROKEN and (failure := arrays.failure()):
        raise failure
    return solution


class _Trial(NamedTuple):
    """Start of Newton's iteration."""

    q: np.ndarray
    v: np.ndarray
    mu: np.ndarray
    lam: np.ndarray
    memory: np.ndarray


def _lead(problem: StepProblem, h: float, first: _Trial, halvings: int) -> EulerStep | None:
    """Newton's iteration at h/2ᵏ, …, h/2, h, each started from the previous one."""
    q, v = problem.q, problem.v
    start = first
    try:
        for k in range(halvings, -1, -1):
            part = h / 2**k
            result = _newton(problem, part, start._replace(q=start.q if k < halvings else q + part * v))
            start = _Trial(result.q + (result.q - q), 2 * result.v - v, result.mu, result.lam, result.memory)
    except NumericalError:
        return None
    return result


def _newton(problem: StepProblem, h: float, start: _Trial) -> EulerStep:
    result = solve_steps(problem, h, 0.0, start[2:], start[:2], nothing(1, len(start.q))).last
    if result.ended == SOLVED:
        return Advance(result, problem.u[0], problem.theta, problem.w, h).stages[0]
    trial = result.q[0], result.v[0], result.mu[0], result.lam[0]
    raise _refusal(problem, h, trial, result.ended, int(result.iterations[0]))


REASONS = {
    iteration.INFINITE: "a coordinate of a body is not finite",
    iteration.SINGULAR: "the matrix of the time step is singular",
    iteration.ENDLESS: "Newton's iteration does not converge",
}


def _refusal(problem: StepProblem, h: float, trial: tuple[np.ndarray, ...], ended: int, count: int) -> NumericalError:
    """Error that names a broken force, else the constraint with the largest residual, else the unbalanced body."""
    q = trial[0]
    try:
        off = _farthest(problem, h, trial)
    except NumericalError as error:  # of a law that has no load there, in its own words
        return error
    return NumericalError(
        f"the time step of {h:g} s was not solved after {count} iterations: {REASONS[ended]}; {off}"
        f"{_dependent(problem.system, q, problem.u[0, 0])}",
        remedy="use a smaller time step",
    )


def _farthest(problem: StepProblem, h: float, trial: tuple[np.ndarray, ...]) -> str:
    system, d, rigid = problem.system, problem.system.metric, problem.system.rigid
    q, v, mu, lam = trial
    rho, G, *_ = relation_rows(system.products, q, v)
    for element in system.elements:
        F = element_load(element, rho[element.rows], G[element.rows] @ v, problem.theta, problem.u[0, 0]).F
        if not np.all(np.isfinite(F)):
            return f"force {element.force.name} is not finite"
    at = balance(system, q, v, problem.u[0, 0], problem.theta, a=(v - problem.v) / h, lam=lam, mu=mu)
    whole = float(np.linalg.norm(d * problem.q)) or 1.0
    r3, r4 = at.B @ v + (0.0 if at.driven is None else at.driven.rate), at.phi
    off = np.concatenate([np.abs(r4), h * np.abs(r3)]) * np.tile(unit_rows(at.B, 1 / d)[1], 2) / whole
    if len(off) and np.max(off) > 1e-6:
        worst = int(np.argmax(off))
        row, moving = worst % len(r4), worst >= len(r4)
        value, level = (r3[row], "velocity") if moving else (r4[row], "position")
        return f"largest residual {value:.3g} in the {level} constraint '{system.constraints[row]}'"
    r2 = at.load - at.B.T @ lam - (problem.w if len(problem.w) else 0.0)
    # what the rigidity of the bodies carries is in balance
    E = at.B[:rigid] / d
    forces = r2 / d - E.T @ np.linalg.lstsq(E.T, r2 / d, rcond=None)[0] if rigid else r2 / d
    name = system.most_in(forces)
    return f"largest residual {np.max(np.abs((d * forces)[system.of[name]])):.3g} in the force balance of body {name}"


def _dependent(system: System, q: np.ndarray, u: np.ndarray) -> str:
    if not np.all(np.isfinite(q)):
        return ""
    try:
        check_regular(system, q, u)
    except InfeasibleError as error:
        return f"; {error.what}"
    return ""


Method = Literal["second_order", "thesis"]
GAMMA = 1.0 - np.sqrt(0.5)
"""Both stages are steps of γh; this γ makes the method second-order and damps very fast motions."""
CARRIED = (1.0 - GAMMA) / GAMMA
"""Share of the change in the first stage from which the second stage starts."""
LAG, GAIN = 0.113, 0.0178
"""A free rotation by φ per step lags by LAG φ² of its angle and gains GAIN φ⁴ of its spin per step (measured; see the tests)."""
INSTANTS: Mapping[Method, tuple[float, ...]] = MappingProxyType({"second_order": (GAMMA, 1.0), "thesis": (1.0,)})
"""Ends of the stages as shares of the step: the instants at which loads act."""


@dataclass(frozen=True)
class Advance:
    """State at the end, q, v (n,), and the implicit steps of h under u (k, width), with the data from which the next ones are
    predicted."""

    result: Stages
    u: np.ndarray
    theta: np.ndarray
    w: np.ndarray
    h: float

    @property
    def q(self) -> np.ndarray:
        return self.result.q[-1]

    @property
    def v(self) -> np.ndarray:
        return self.result.v[-1]

    @cached_property
    def stages(self) -> tuple[EulerStep, ...]:
        """The steps one by one."""
        fields = zip(*self.result[1:10], self.u, strict=True)
        return tuple(
            EulerStep(q, v, mu, lam, int(count), motion, memory, (start_q, start_v), u, self.theta, self.w, self.h)
            for count, start_q, start_v, q, v, motion, mu, lam, memory, u in fields
        )


def _joined(steps: Sequence[EulerStep]) -> Advance:
    """Steps of one length as the stages of one."""
    columns = (
        np.array([at.iterations for at in steps]),
        *(np.stack([at.start[k] for at in steps]) for k in range(2)),
        *(np.stack([getattr(at, name) for at in steps]) for name in ("q", "v", "motion", "mu", "lam", "memory")),
    )
    last = steps[-1]
    result = Stages._make((SOLVED, *columns, nothing(len(steps), len(last.q))))
    return Advance(result, np.stack([at.u for at in steps]), last.theta, last.w, last.h)


def advance(
    system: System,
    q: np.ndarray,
    v: np.ndarray,
    u: tuple[np.ndarray, np.ndarray],
    h: float,
    theta: np.ndarray,
    method: Method,
    w: np.ndarray | None = None,
    last: Advance | None = None,
    near: tuple[np.ndarray, np.ndarray] | None = None,
) -> Advance:
    """x_{k+1} = (q, v)_{k+1} of x_k by `step` Ψ of implicit Euler, singly diagonally implicit (Alexander):

        x₁ = Ψ(x_k, u(γh), γh),    x_{k+1} = Ψ(x_k + (1 − γ)/γ (x₁ − x_k), u(h), γh),    γ = 1 − √½

    or x_{k+1} = Ψ(x_k, u(h), h) where method is `thesis`. Both stages end on φ = 0, Bv = −φ_t.

    q, v (n,) at the start, need not satisfy φ = 0; u: loads (nu,) at start and end, straight between [N, N m], with p and ṗ of
    driven joints behind them, on a cubic between; h [s]; theta (nθ,); w (n,) an extra generalised force, the same all along;
    last: the advance before, from which and from those before it the stages are foreseen (`compiled/stages.py`); near: q', v'
    (n,) from which the iteration of the last stage starts. Neither changes the answer beyond what Newton's iteration leaves.
    Raises NumericalError as `step` does.
    Source: Alexander, SIAM J. Numer. Anal. 14 (1977); thesis (1.5-1.7)."""
    return advance_steps(system, q, v, np.stack(u), h, theta, method, w, last, near)[0]


def advance_steps(
    system: System,
    q: np.ndarray,
    v: np.ndarray,
    u: np.ndarray,
    h: float,
    theta: np.ndarray,
    method: Method,
    w: np.ndarray | None = None,
    last: Advance | None = None,
    near: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[Advance, np.ndarray, np.ndarray, np.ndarray]:
    """`advance` from row to row of u (T + 1, nu), until a step is difficult: at least one step. The last one, and q, v (t, n),
    λ (t, m) at the ends of all."""
    stage_step, carried, inside = h, 0.0, np.empty((len(u) - 1, len(INSTANTS[method]), u.shape[1]))
    inside[:, -1] = u[1:]
    if method == "second_order":
        stage_step, carried = GAMMA * h, CARRIED
        if system.drives.names:
            W = between(system.drives, h, GAMMA)
            inside[:, 0] = u[:-1] @ W[0].T + u[1:] @ W[1].T
        else:
            inside[:, 0] = (1 - GAMMA) * u[:-1] + GAMMA * u[1:]
    problem = problem_of(system, q, v, inside, theta, w)
    past = _past(last, stage_step, inside.shape[1], system.size)
    left = left_by(problem, None) if last is None else (last.result.mu[-1], last.result.lam[-1], last.result.memory[-1])
    result = solve_steps(problem, stage_step, carried, left, near, past)
    if result.last.ended == SOLVED:
        end = Advance(result.last, inside[len(result.q) - 1], problem.theta, problem.w, stage_step)
        return end, result.q, result.v, result.lam
    # each by itself, led there
    guess = None if last is None else last.stages[-1]
    first = step(system, q, v, inside[0, 0], stage_step, theta, w, guess)
    both: tuple[EulerStep, ...] = (first,)
    if inside.shape[1] > 1:
        middle = q + carried * (first.q - q), v + carried * (first.v - v)
        both = first, step(system, *middle, inside[0, 1], stage_step, theta, w, first)
    end = _joined(both)
    return end, end.q[None], end.v[None], both[-1].lam[None]


def _past(last: Advance | None, h: float, count: int, n: int) -> Past:
    """Past of the previous step; for another step length its last acceleration only."""
    if last is None:
        return nothing(count, n)
    result = last.result
    if last.h == h and len(last.u) == count and len(result.past.rate):
        return result.past
    rate = np.stack([np.zeros(n), (last.v - result.start_v[-1]) / last.h])
    return nothing(count, n)._replace(rate=rate)


def linear_step(M: np.ndarray, C: np.ndarray, K: np.ndarray, h: float, method: Method) -> tuple[np.ndarray, ...]:
    """Matrices of `advance` for M ÿ + C ẏ + K y = f: of (y, ẏ) (2r, 2r), and of f at start and end (2r, r), linear in between."""
    r, stage_step = len(M), h * INSTANTS[method][0]
    velocity = np.linalg.solve(M / stage_step + C + stage_step * K, np.column_stack([-K, M / stage_step, np.eye(r)]))
    whole = np.vstack([stage_step * velocity, velocity])
    whole[:r, :r] += np.eye(r)
    X, b = whole[:, : 2 * r], whole[:, 2 * r :]
    if method == "thesis":
        return X, np.zeros_like(b), b
    carried = CARRIED * X
    between = carried @ b
    return carried @ X + (1 - CARRIED) * X, (1 - GAMMA) * between, b + GAMMA * between


@dataclass(frozen=True)
class AdvanceSlopes:
    """∂x_{k+1} with respect to x_k: A (2n, 2n); u(0), u(h): B_start, B_end (2n, nu); θ: B_theta (2n, nθ); w: B_w (2n, n)."""

    A: np.ndarray
    B_start: np.ndarray
    B_end: np.ndarray
    B_theta: np.ndarray
    B_w: np.ndarray


def slopes(system: System, at: Advance, forced: bool = True) -> AdvanceSlopes:
    """By the chain rule through the stages, each exact: with c = (1 − γ)/γ and those of the stages Aᵢ, Bᵢ; B_w if `forced`,

    A = A₂ ((1 − c) 1 + c A₁),     ∂/∂p = B₂ + c A₂ B₁   of θ and w,     u(γh) = W₀ u(0) + W₁ u(h)  (`between`)

    A stage solves r(z; x_k, u, θ, w) = 0, z = (q, v, μ, λ)_{k+1}:  ∂z/∂p = −(∂r/∂z)⁻¹ ∂r/∂p.

        ∂r₁/∂q_k = −D²/h,   ∂r₂/∂v_k = −M/h,   ∂r₂/∂u = ∂f/∂u,   ∂r₂/∂θ = ∂f/∂θ,   ∂r₂/∂w = −1
        driven:  ∂r₁/∂p = B_pᵀμ,   ∂r₂/∂p = −B_pᵀλ,   ∂r₃/∂p = B_p v + ∂φ_t/∂p,   ∂r₃/∂ṗ = ∂r₄/∂p = φ_p

    Exact at the new state, where the matrix is factorised once more: the one of Newton's last iteration belongs to the
    state before its last correction. Valid off the constraints too: x_k may be any state, x_{k+1} is on them.
    Raises NumericalError where the matrix is singular."""
    arrays, result = compile_system(system), at.result
    point = arrays.at(system, at.theta)._replace(q=at.q, v=at.v, h=at.h, u=at.u[-1], w=at.w)
    elastic = np.zeros((len(at.u), system.size, 0))
    if len(at.theta):
        by_theta = (
            system.stiffness_terms @ q + system.damping_terms @ v for q, v in zip(result.q, result.v, strict=True)
        )
        elastic = np.stack([each.T for each in by_theta])
    regular, A, inside, end, B_theta, B_w = step_slopes(
        arrays.arrays, arrays.pattern, point, at.u, result.start_q, result.start_v, result.q, result.motion, result.mu,
        result.lam, result.memory, elastic, CARRIED, forced,
    )  # fmt: skip
    if not regular:
        raise NumericalError("the matrix of the time step is singular")
    if system.drives.names:
        W = between(system.drives, at.h / GAMMA, GAMMA)
        return AdvanceSlopes(A, inside @ W[0], end + inside @ W[1], B_theta, B_w)
    return AdvanceSlopes(A, (1 - GAMMA) * inside, end + GAMMA * inside, B_theta, B_w)
