"""From one instant to the next: two implicit stages of second order, or the thesis's implicit Euler, with exact derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np

from strainsight.errors import NumericalError
from strainsight.multibody.compiled.equations import SOLVED
from strainsight.multibody.compiled.slopes import step_slopes
from strainsight.multibody.compiled.stages import Past, nothing
from strainsight.multibody.compiled.system import compiled
from strainsight.multibody.drives import between
from strainsight.multibody.step import Step, left_by, problem_of, solved, stages, step
from strainsight.multibody.system import System

Method = Literal["second_order", "thesis"]
GAMMA = 1.0 - np.sqrt(0.5)
"""Both stages are steps of γh; with this γ the method is of second order and damps what is far too quick for the step."""
CARRIED = (1.0 - GAMMA) / GAMMA
"""Share of the first stage's change from which the second stage starts."""
LAG, GAIN = 0.113, 0.0178
"""What turns freely by φ a step lags by LAG φ² of its angle and gains GAIN φ⁴ of its spin a step (measured; see the tests)."""
INSTANTS: Mapping[Method, tuple[float, ...]] = MappingProxyType({"second_order": (GAMMA, 1.0), "thesis": (1.0,)})
"""Where in the step its stages end, as shares of it: the instants at which loads act."""


@dataclass(frozen=True)
class Advance:
    """The state at the end, q, v (n,), the implicit steps that led there, and what the next ones are foreseen from."""

    stages: tuple[Step, ...]
    past: Past

    @property
    def q(self) -> np.ndarray:
        return self.stages[-1].q

    @property
    def v(self) -> np.ndarray:
        return self.stages[-1].v


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
    Source: Alexander, SIAM J. Numer. Anal. 14 (1977); thesis (1.5-1.7).
    """
    own, carried, inside = h, 0.0, np.empty((len(INSTANTS[method]), len(u[1])))
    inside[-1] = u[1]
    if method == "second_order":
        own, carried = GAMMA * h, CARRIED
        if system.drives.names:
            W = between(system.drives, h, GAMMA)
            inside[0] = W[0] @ u[0] + W[1] @ u[1]
        else:
            inside[0] = (1 - GAMMA) * u[0] + GAMMA * u[1]
    problem = problem_of(system, q, v, inside, theta, w)
    guess = None if last is None else last.stages[-1]
    found = stages(problem, own, carried, left_by(problem, guess), near, _past(last, own, len(inside), system.size))
    if found.ended == SOLVED:
        return Advance(solved(problem, own, found), found.past)
    # each by itself, led there
    first = step(system, q, v, inside[0], own, theta, w, guess)
    both: tuple[Step, ...] = (first,)
    if len(inside) > 1:
        middle = q + carried * (first.q - q), v + carried * (first.v - v)
        both = first, step(system, *middle, inside[1], own, theta, w, first)
    return Advance(both, nothing(len(both), system.size))


def _past(last: Advance | None, h: float, count: int, n: int) -> Past:
    """That of the advance before; of one in steps of another length its last acceleration alone."""
    if last is None:
        return nothing(count, n)
    before = last.stages[-1]
    if before.h == h and len(last.stages) == count and len(last.past.rate):
        return last.past
    return nothing(count, n)._replace(rate=np.stack([np.zeros(n), (before.v - before.start[1]) / before.h]))


def linear_step(M: np.ndarray, C: np.ndarray, K: np.ndarray, h: float, method: Method) -> tuple[np.ndarray, ...]:
    """What `advance` makes of M ÿ + C ẏ + K y = f: of (y, ẏ) (2r, 2r), and of f at start and end (2r, r), straight between."""
    r, own = len(M), h * INSTANTS[method][0]
    velocity = np.linalg.solve(M / own + C + own * K, np.column_stack([-K, M / own, np.eye(r)]))
    whole = np.vstack([own * velocity, velocity])
    whole[:r, :r] += np.eye(r)
    X, b = whole[:, : 2 * r], whole[:, 2 * r :]
    if method == "thesis":
        return X, np.zeros_like(b), b
    carried = CARRIED * X
    between = carried @ b
    return carried @ X + (1 - CARRIED) * X, (1 - GAMMA) * between, b + GAMMA * between


@dataclass(frozen=True)
class Slopes:
    """∂x_{k+1} with respect to x_k: A (2n, 2n); u(0), u(h): B_start, B_end (2n, nu); θ: B_theta (2n, nθ); w: B_w (2n, n)."""

    A: np.ndarray
    B_start: np.ndarray
    B_end: np.ndarray
    B_theta: np.ndarray
    B_w: np.ndarray


def slopes(system: System, at: Advance, forced: bool = True) -> Slopes:
    """By the chain rule through the stages, each exact: with c = (1 − γ)/γ and those of the stages Aᵢ, Bᵢ; B_w if `forced`,

    A = A₂ ((1 − c) 1 + c A₁),     ∂/∂p = B₂ + c A₂ B₁   of θ and w,     u(γh) = W₀ u(0) + W₁ u(h)  (`between`)
    """
    own = [sensitivities(system, stage) for stage in at.stages]
    if len(own) == 1:
        only: Sensitivities = own[0]
        return Slopes(only.A, np.zeros_like(only.B_u), only.B_u, only.B_theta, only.B_w)
    first, second = own
    through = CARRIED * second.A
    A = through @ first.A
    A += (1 - CARRIED) * second.A
    B_w = second.B_w + through @ first.B_w if forced else second.B_w[:, :0]
    inside, h = through @ first.B_u, at.stages[0].h / GAMMA
    if system.drives.names:
        W = between(system.drives, h, GAMMA)
        start, end = inside @ W[0], inside @ W[1]
    else:
        start, end = (1 - GAMMA) * inside, GAMMA * inside
    return Slopes(A, start, second.B_u + end, second.B_theta + through @ first.B_theta, B_w)


@dataclass(frozen=True)
class Sensitivities:
    """∂(q, v)_{k+1} with respect to (q, v)_k: A (2n, 2n); u, with p and ṗ: B_u (2n, width); θ: B_theta (2n, nθ);
    w: B_w (2n, n)."""

    A: np.ndarray
    B_u: np.ndarray
    B_theta: np.ndarray
    B_w: np.ndarray


def sensitivities(system: System, at: Step) -> Sensitivities:
    """Of the step r(z; x_k, u, θ, w) = 0, z = (q, v, μ, λ)_{k+1}:  ∂z/∂p = −(∂r/∂z)⁻¹ ∂r/∂p.

        ∂r₁/∂q_k = −D²/h,   ∂r₂/∂v_k = −M/h,   ∂r₂/∂u = ∂f/∂u,   ∂r₂/∂θ = ∂f/∂θ,   ∂r₂/∂w = −1
        driven:  ∂r₁/∂p = B_pᵀμ,   ∂r₂/∂p = −B_pᵀλ,   ∂r₃/∂p = B_p v + ∂φ_t/∂p,   ∂r₃/∂ṗ = ∂r₄/∂p = φ_p

    Exact at the new state, where the matrix is factorised once more: the one of Newton's last iteration belongs to the
    state before its last correction. Valid off the constraints too: x_k may be any state, x_{k+1} is on them.
    Raises NumericalError where the matrix is singular.
    """
    own = compiled(system)
    elastic = np.ascontiguousarray((system.stiffness_terms @ at.q + system.damping_terms @ at.v).T)
    given = own.at(system, at.theta)._replace(q=at.start[0], v=at.start[1], h=at.h, u=at.u, w=at.w)
    regular, A, B_u, B_theta, B_w = step_slopes(
        own.arrays, own.pattern, given, at.theta, at.memory.copy(), at.q, at.motion, at.mu, at.lam, elastic
    )
    if not regular:
        raise NumericalError("the matrix of the step is singular")
    return Sensitivities(A, B_u, B_theta, B_w)
