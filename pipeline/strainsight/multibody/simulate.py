"""A run of steps, all alike or divided until halving them again changes nothing that counts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from strainsight.errors import NumericalError
from strainsight.multibody.initial import check_consistent
from strainsight.multibody.step import Advance, Method, advance
from strainsight.multibody.system import System

FINEST = 1024
"""Most parts of a step."""
SAMPLED, STRAIGHT = 64, 1e-3
"""Instants of a step at which loads are looked at beforehand, and how far off their largest value they may be from straight
lines between the parts: otherwise a load that passes between them would not be seen."""
TINY = 1e-10
"""Motion of a body beside the largest of any that is none."""
EASY = 16.0
"""Times that a step has to be better than asked for before the next one is divided into half as many parts."""


@dataclass(frozen=True)
class Trajectory:
    """time (T + 1,) [s], q, v (T + 1, n), u (T + 1, nu), the start first; lam (T, m): multipliers of the
    joints in the last stage of a step, zero for the rigidity of bodies."""

    time: np.ndarray
    q: np.ndarray
    v: np.ndarray
    u: np.ndarray
    lam: np.ndarray


def simulate(
    system: System,
    q0: np.ndarray,
    v0: np.ndarray,
    u: np.ndarray,
    h: float,
    theta: np.ndarray,
    method: Method = "second_order",
    progress: Callable[[int], None] | None = None,
) -> Trajectory:
    """`advance` from 0 to h, 2h, …; u (T + 1, nu): loads at these instants, straight between them [N, N m], then p and ṗ of
    driven joints.

    progress is called with the number of steps done.
    Raises InfeasibleError where the start breaks a constraint, NumericalError with the time where a step fails.
    """
    u = np.asarray(u, dtype=float)
    check_consistent(system, np.asarray(q0, dtype=float), np.asarray(v0, dtype=float), u[0])
    count = len(u) - 1
    q, v = np.empty((count + 1, system.size)), np.empty((count + 1, system.size))
    lam = np.empty((count, system.constrained))
    q[0], v[0] = q0, v0
    last: Advance | None = None
    for k in range(count):
        try:
            last = advance(system, q[k], v[k], (u[k], u[k + 1]), h, theta, method, last=last)
        except NumericalError as error:
            raise NumericalError(f"at t = {k * h:g} s: {error.what}", remedy=error.remedy) from error
        q[k + 1], v[k + 1], lam[k] = last.q, last.v, last.stages[-1].lam
        if progress is not None:
            progress(k + 1)
    return Trajectory(h * np.arange(count + 1), q, v, u, lam)


@dataclass(frozen=True)
class Controlled:
    """The run, and into how many parts each step (T,) was divided at last."""

    run: Trajectory
    parts: np.ndarray


def simulate_controlled(
    system: System,
    q0: np.ndarray,
    v0: np.ndarray,
    loads: Callable[[np.ndarray], np.ndarray],
    h: float,
    steps: int,
    theta: np.ndarray,
    method: Method,
    tolerance: float,
    progress: Callable[[int], None] | None = None,
) -> Controlled:
    """`advance` through every step in n and in 2n parts, n = 1, 2, 4, …, until both end alike; the 2n parts are kept:

        max over bodies  ‖D (q₂ₙ − qₙ)‖ / max over time ‖D q‖  ≤  tolerance / steps

    D² the metric of the mass, in which a turn counts as much as the body is wide; loads: time (k,) → (k, nu) [N, N m], of any
    time, so that a finer step sees more of them.
    The difference is three times the error of 2n parts to leading order, so that errors of all steps add up to a third of the
    tolerance. Raises InfeasibleError where the start breaks a constraint, NumericalError with the time where FINEST parts are not
    enough.
    """
    check_consistent(system, np.asarray(q0, dtype=float), np.asarray(v0, dtype=float), loads(np.zeros(1))[0])
    q, v = np.empty((steps + 1, system.size)), np.empty((steps + 1, system.size))
    lam, parts = np.empty((steps, system.constrained)), np.empty(steps, dtype=int)
    q[0], v[0] = q0, v0
    largest, last, n = _sizes(system, q[0]), None, 1
    heaviest = np.zeros(system.drives.width)
    for k in range(steps):
        heaviest, n = _straight(loads(k * h + h / SAMPLED * np.arange(SAMPLED + 1)), heaviest, n)

        def through(count: int, k: int = k, last: Advance | None = last) -> Advance:
            return _through(system, q[k], v[k], loads, k * h, h, count, theta, method, last)

        coarse: Advance | None = None
        while True:
            try:
                coarse = through(n) if coarse is None else coarse
                fine = through(2 * n)
                # of this trial alone: one that is far off may not make later ones look small
                whole = np.maximum(largest, _sizes(system, fine.q))
                off = float(np.max(_sizes(system, fine.q - coarse.q) / np.maximum(whole, TINY * whole.max())))
                unsolved: NumericalError | None = None
            except NumericalError as error:
                coarse, fine, off, unsolved = None, None, np.inf, error
            if steps * off <= tolerance:
                break
            if 2 * n >= FINEST:
                raise _refused(k * h, h, 2 * n, off, unsolved)
            coarse, n = fine, 2 * n
        assert fine is not None
        largest = whole
        q[k + 1], v[k + 1], lam[k], parts[k], last = fine.q, fine.v, fine.stages[-1].lam, 2 * n, fine
        if EASY * steps * off < tolerance:
            n = max(1, n // 2)
        if progress is not None:
            progress(k + 1)
    u = loads(h * np.arange(steps + 1))
    return Controlled(Trajectory(h * np.arange(steps + 1), q, v, u, lam), parts)


def _straight(u: np.ndarray, heaviest: np.ndarray, parts: int) -> tuple[np.ndarray, int]:
    """The largest loads (nu,) so far, and in how many parts, at least as many as these, u (SAMPLED + 1, nu) is straight."""
    largest = np.maximum(heaviest, np.abs(u).max(axis=0, initial=0.0))
    at = np.arange(len(u))
    while parts < SAMPLED:
        nodes = at[:: SAMPLED // parts]
        lines = np.column_stack([np.interp(at, nodes, own[nodes]) for own in u.T]) if u.shape[1] else u
        if np.all(np.abs(u - lines) <= STRAIGHT * largest):
            break
        parts *= 2
    return largest, parts


def _through(
    system: System,
    q: np.ndarray,
    v: np.ndarray,
    loads: Callable[[np.ndarray], np.ndarray],
    start: float,
    h: float,
    parts: int,
    theta: np.ndarray,
    method: Method,
    last: Advance | None,
) -> Advance:
    """A step in equal parts."""
    u = loads(start + h / parts * np.arange(parts + 1))
    for k in range(parts):
        last = advance(system, q, v, (u[k], u[k + 1]), h / parts, theta, method, last=last)
        q, v = last.q, last.v
    assert last is not None
    return last


def _sizes(system: System, q: np.ndarray) -> np.ndarray:
    """‖D q‖ of every body [m √kg]."""
    return np.asarray(np.sqrt(np.add.reduceat((system.metric * q) ** 2, system.starts)))


def _refused(time: float, h: float, parts: int, off: float, unsolved: NumericalError | None) -> NumericalError:
    if unsolved is not None:
        return NumericalError(
            f"at t = {time:g} s, in {parts} parts of {h:g} s: {unsolved.what}", remedy=unsolved.remedy
        )
    return NumericalError(
        f"at t = {time:g} s the step of {h:g} s is {off:.2g} off in {parts} parts",
        remedy="take a smaller simulate.time_step, or a larger simulate.tolerance",
    )
