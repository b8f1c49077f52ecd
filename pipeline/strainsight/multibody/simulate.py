"""A run of steps of one length or of controlled length, or by Radau collocation of fifth order."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, lu_factor, lu_solve

from strainsight.errors import NumericalError
from strainsight.multibody.accelerations import Balance, balance
from strainsight.multibody.initial import check_consistent, nearest_state
from strainsight.multibody.step import Advance, Method, advance, advance_steps
from strainsight.multibody.system import System

BLOCK = 64
"""Most steps that compiled code takes at once."""
FINEST = 1024
"""Largest number of parts of a step."""
SAMPLED, STRAIGHT = 64, 1e-3
"""Instants of a step at which loads are checked in advance, and their largest deviation from straight lines between the parts,
so that short loads are not missed."""
TINY = 1e-10
"""Motion of a body, relative to the largest, that is negligible."""
EASY = 16.0
"""Factor by which a step must be more accurate than required before the next one uses half as many parts."""


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
    Raises InfeasibleError where the start breaks a constraint, NumericalError with the time where a step fails."""
    u = np.asarray(u, dtype=float)
    last: Advance | None = None

    def step(k: int, q: np.ndarray, v: np.ndarray) -> State:
        nonlocal last
        with at_time(k * h):
            last, *ends = advance_steps(system, q, v, u[k : k + BLOCK + 1], h, theta, method, last=last)
        return ends[0], ends[1], ends[2]

    return _run(system, (q0, v0), u, h, step, progress)


State = tuple[np.ndarray, np.ndarray, np.ndarray]
"""q, v (t, n), λ (t, m) at the ends of t steps."""


def _run(
    system: System,
    start: tuple[np.ndarray, np.ndarray],
    u: np.ndarray,
    h: float,
    step: Callable[[int, np.ndarray, np.ndarray], State],
    progress: Callable[[int], None] | None,
) -> Trajectory:
    """The states at 0, h, 2h, … under u (T + 1, nu); step: one or more steps from k, q, v. Raises InfeasibleError where the
    start breaks a constraint."""
    check_consistent(system, np.asarray(start[0], dtype=float), np.asarray(start[1], dtype=float), u[0])
    count = len(u) - 1
    q, v = np.empty((2, count + 1, system.size))
    lam = np.empty((count, system.constrained))
    q[0], v[0] = start
    done = 0
    while done < count:
        ends = step(done, q[done], v[done])
        first, done = done, done + len(ends[0])
        q[first + 1 : done + 1], v[first + 1 : done + 1], lam[first:done] = ends
        if progress is not None:
            progress(done)
    return Trajectory(h * np.arange(count + 1), q, v, u, lam)


@contextmanager
def at_time(t: float) -> Iterator[None]:
    """Add the time [s] to a NumericalError."""
    try:
        yield
    except NumericalError as error:
        raise NumericalError(f"at t = {t:g} s: {error.what}", remedy=error.remedy) from error


@dataclass(frozen=True)
class Controlled:
    """The run, and the final number of parts of each step (T,)."""

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
    """`advance` through every step in n and in 2n parts, n = 1, 2, 4, …, until both ends agree; the result is that of 2n parts:

        max over bodies  ‖D (q₂ₙ − qₙ)‖ / max over time ‖D q‖  ≤  tolerance / steps

    D² the metric of the mass, in which a turn counts as much as the body is wide; loads: time (k,) → (k, nu) [N, N m], of any
    time, so that a finer step sees more of them.
    The difference is three times the error of 2n parts to leading order, so that errors of all steps add up to a third of the
    tolerance. Raises InfeasibleError where the start breaks a constraint, NumericalError with the time where FINEST parts are not
    enough."""
    largest, last, n = _sizes(system, np.asarray(q0, dtype=float)), None, 1
    heaviest, parts = np.zeros(system.drives.width), np.empty(steps, dtype=int)

    def step(k: int, q: np.ndarray, v: np.ndarray) -> State:
        nonlocal largest, last, n, heaviest
        heaviest, n = _check_straight(loads(k * h + h / SAMPLED * np.arange(SAMPLED + 1)), heaviest, n)

        def through(count: int) -> Advance:
            """The step in so many equal parts."""
            result, at = last, (q, v)
            u = loads(k * h + h / count * np.arange(count + 1))
            for i in range(count):
                result = advance(system, *at, (u[i], u[i + 1]), h / count, theta, method, last=result)
                at = result.q, result.v
            assert result is not None
            return result

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
                raise _refusal(k * h, h, 2 * n, off, tolerance / steps, unsolved)
            coarse, n = fine, 2 * n
        assert fine is not None
        largest, last, parts[k] = whole, fine, 2 * n
        if EASY * steps * off < tolerance:
            n = max(1, n // 2)
        return fine.q[None], fine.v[None], fine.stages[-1].lam[None]

    return Controlled(_run(system, (q0, v0), loads(h * np.arange(steps + 1)), h, step, progress), parts)


def _check_straight(u: np.ndarray, heaviest: np.ndarray, parts: int) -> tuple[np.ndarray, int]:
    """Largest loads (nu,) so far, and the number of parts, at least the given one, in which u (SAMPLED + 1, nu) is straight."""
    largest = np.maximum(heaviest, np.abs(u).max(axis=0, initial=0.0))
    at = np.arange(len(u))
    while parts < SAMPLED:
        nodes = at[:: SAMPLED // parts]
        lines = np.column_stack([np.interp(at, nodes, load[nodes]) for load in u.T]) if u.shape[1] else u
        if np.all(np.abs(u - lines) <= STRAIGHT * largest):
            break
        parts *= 2
    return largest, parts


def _sizes(system: System, q: np.ndarray) -> np.ndarray:
    """‖D q‖ of every body [m √kg]."""
    return np.asarray(np.sqrt(np.add.reduceat((system.metric * q) ** 2, system.starts)))


def _refusal(
    time: float, h: float, parts: int, off: float, limit: float, unsolved: NumericalError | None
) -> NumericalError:
    if unsolved is not None:
        return NumericalError(
            f"at t = {time:g} s, the step of {h:g} s was not solved with {parts} substeps ({unsolved.what})",
            remedy=unsolved.remedy,
        )
    return NumericalError(
        f"at t = {time:g} s the step of {h:g} s, divided into {parts} substeps, has a relative error of {off:.2g} "
        f"in the coordinates of a body; the limit is {limit:.2g} (simulate.tolerance / number of time steps)",
        remedy="reduce simulate.time_step, or increase simulate.tolerance",
    )


ROOT = np.sqrt(6.0)
PLACES = np.array([(4 - ROOT) / 10, (4 + ROOT) / 10, 1.0])
"""Stages in a step; the last one is its end."""
WEIGHTS = np.array(
    [
        [(88 - 7 * ROOT) / 360, (296 - 169 * ROOT) / 1800, (-2 + 3 * ROOT) / 225],
        [(296 + 169 * ROOT) / 1800, (88 + 7 * ROOT) / 360, (-2 - 3 * ROOT) / 225],
        [(16 - ROOT) / 36, (16 + ROOT) / 36, 1 / 9],
    ]
)
"""Integrals up to the stages of the polynomials that are 1 at one stage and 0 at the others (Hairer, Wanner 1996)."""
ITERATIONS, DONE = 25, 1e-12
"""Most iterations of a step, and the last change of the displacements relative to the coordinates in the metric of the mass."""
SLOW = 0.05
"""Factor by which an iteration must decrease for its matrices to serve the next step, too."""


def simulate_radau(
    system: System,
    q0: np.ndarray,
    v0: np.ndarray,
    u: np.ndarray,
    h: float,
    theta: np.ndarray,
    progress: Callable[[int], None] | None = None,
) -> Trajectory:
    """q, v of M v̇ + c + f = Bᵀλ, B v̇ + Ḃ v = 0 at 0, h, 2h, …, which shares the equations with `simulate`, and no step:

        vᵢ = v + h Σ Aᵢⱼ aⱼ,     qᵢ = q + h cᵢ v + h² Σ (A²)ᵢⱼ aⱼ,     aᵢ, λᵢ from the equations at every stage i

    A the three stages of Radau IIA, of fifth order; simplified Newton along the eigenvectors of A. Every step ends on φ = 0 and
    Bv = 0. u (T + 1, nu): loads at these instants, straight between them [N, N m]; no joint is driven.
    Raises InfeasibleError where the start breaks a constraint, NumericalError with the time where a step fails."""
    if system.drives.names:
        raise NumericalError(
            "`estimate.truth.model: independent` does not support driven joints",
            remedy="set estimate.truth.model: fine",
        )
    u, n = np.asarray(u, dtype=float), system.size
    eigen = np.linalg.eig(WEIGHTS)
    stages, factors = np.zeros((3, n + system.constrained)), None

    def step(k: int, q: np.ndarray, v: np.ndarray) -> State:
        nonlocal stages, factors
        loads = u[k] + PLACES[:, None] * (u[k + 1] - u[k])

        def equations(x: np.ndarray, here: np.ndarray, moving: np.ndarray, load: np.ndarray) -> Balance:
            return balance(system, here, moving, load, theta, a=x[:n], lam=x[n:])

        with at_time(k * h):
            stages, factors = _step(system, equations, q, v, loads, h, eigen, stages, factors)
        ahead = q + h * v + h**2 * (WEIGHTS @ WEIGHTS)[-1] @ stages[:, :n]
        end, lam = nearest_state(system, ahead, v + h * WEIGHTS[-1] @ stages[:, :n], u[k + 1]), stages[-1, n:]
        stages = _EXTENDED @ stages
        return end[0][None], end[1][None], lam[None]

    return _run(system, (q0, v0), u, h, step, progress)


Equations = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], Balance]
"""(a, λ) (n + m,), q, v (n,) and loads (nu,) of a stage → its terms."""
Factors = list[tuple[np.ndarray, np.ndarray]]
"""LU factors for each eigenvalue."""


def _step(
    system: System,
    equations: Equations,
    q: np.ndarray,
    v: np.ndarray,
    loads: np.ndarray,
    h: float,
    eigen: tuple[np.ndarray, np.ndarray],
    x: np.ndarray,
    factors: Factors | None,
) -> tuple[np.ndarray, Factors | None]:
    """a, λ (3, n + m) of the stages from a guess x, and matrices for the next step; factors: those of the step before."""
    n, (values, across) = system.size, eigen
    back, size, before = np.linalg.inv(across), float(np.linalg.norm(system.metric * q)), np.inf
    fresh = factors is None
    for _ in range(ITERATIONS):
        speeds = v + h * WEIGHTS @ x[:, :n]
        places = q + h * PLACES[:, None] * v + h**2 * WEIGHTS @ WEIGHTS @ x[:, :n]
        terms = [equations(*stage) for stage in zip(x, places, speeds, loads, strict=True)]
        if factors is None:
            factors, fresh = [_factor(terms[-1], h * value) for value in values], True
        left = np.array(
            [
                np.concatenate([at.load - at.B.T @ stage[n:], at.B @ stage[:n] + at.B_rate @ moving])
                for at, stage, moving in zip(terms, x, speeds, strict=True)
            ]
        )
        along = back @ left
        change = -(across @ np.array([lu_solve(f, r) for f, r in zip(factors, along, strict=True)])).real
        x = x + change
        moved = float(np.linalg.norm(h**2 * system.metric * change[:, :n]))
        # a motion that starts at zero is relative to its end
        size = max(size, float(np.linalg.norm(system.metric * places, axis=1).max()))
        if not np.isfinite(moved):
            break
        if moved <= DONE * size or (moved < 1e3 * DONE * size and moved > 0.5 * before):
            return x, factors if moved <= SLOW * before else None
        if moved > SLOW * before and not fresh:
            factors = None  # of a bench that has moved on since
        before = moved
    raise NumericalError(
        f"Newton's iteration of the simulated test does not converge with the time step of {h:g} s",
        remedy="reduce estimate.truth.step",
    )


def _factor(at: Balance, scale: complex) -> tuple[np.ndarray, np.ndarray]:
    """LU of [M + sC + s²K, −Bᵀ; B, 0], s = hλ of an eigenvalue λ of A."""
    n, m = len(at.mass), len(at.phi)
    whole = np.zeros((n + m, n + m), dtype=complex if scale.imag else float)
    s = scale if scale.imag else scale.real
    whole[:n, :n] = at.mass + s * at.damping + s**2 * at.stiffness
    whole[:n, n:], whole[n:, :n] = -at.B.T, at.B
    try:
        lu, pivots = lu_factor(whole)
    except (LinAlgError, ValueError) as error:
        raise NumericalError(
            "the matrix of a time step of the simulated test is singular",
            remedy="remove redundant joints, and specify mass and inertia of every body",
        ) from error
    return np.asarray(lu), np.asarray(pivots)


_EXTENDED = (1 + PLACES[:, None]) ** np.arange(3) @ np.linalg.inv(PLACES[:, None] ** np.arange(3))
"""(3, 3): values at the stages of the next step of the polynomial through those of this one."""
