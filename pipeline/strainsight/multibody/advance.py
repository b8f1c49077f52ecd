"""From one instant to the next: two implicit stages of second order, or the thesis's implicit Euler, with exact derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np

from strainsight.multibody.drives import between
from strainsight.multibody.sensitivity import Sensitivities, sensitivities
from strainsight.multibody.step import Step, step
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
    """The state at the end, q, v (n,), and the implicit steps that led there."""

    stages: tuple[Step, ...]

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
    last: the advance before, whose multipliers start Newton's iteration; near: q', v' (n,) from which it starts. Raises
    NumericalError as `step` does.
    Source: Alexander, SIAM J. Numer. Anal. 14 (1977); thesis (1.5-1.7).
    """
    guess = None if last is None else last.stages[-1]
    if method == "thesis":
        return Advance((step(system, q, v, u[1], h, theta, w, guess, near),))
    own = GAMMA * h
    before = None if guess is None else (guess.v - guess.start[1]) / guess.h
    inside = (1 - GAMMA) * u[0] + GAMMA * u[1]
    if system.drives.names:
        W = between(system.drives, h, GAMMA)
        inside = W[0] @ u[0] + W[1] @ u[1]
    first = step(system, q, v, inside, own, theta, w, guess, _ahead(q, v, before, own))
    start = q + CARRIED * (first.q - q), v + CARRIED * (first.v - v)
    if near is None:
        now = (first.v - v) / own
        near = _ahead(*start, now if before is None else now + CARRIED * (now - before), own)
    return Advance((first, step(system, *start, u[1], own, theta, w, first, near)))


def _ahead(q: np.ndarray, v: np.ndarray, a: np.ndarray | None, h: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Where a stage of h leads with the acceleration a (n,): there Newton's iteration starts."""
    return None if a is None else (q + h * (v + h * a), v + h * a)


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
