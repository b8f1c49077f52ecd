"""A run of a bench by Radau's collocation of fifth order: another integrator than the step, for truths that a filter is held
against."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import LinAlgError, lu_factor, lu_solve

from strainsight.errors import NumericalError
from strainsight.multibody.accelerations import Balance, balance
from strainsight.multibody.initial import check_consistent, nearest_state
from strainsight.multibody.simulate import Trajectory
from strainsight.multibody.system import System

ROOT = np.sqrt(6.0)
PLACES = np.array([(4 - ROOT) / 10, (4 + ROOT) / 10, 1.0])
"""Of the stages in a step; the last one is its end."""
WEIGHTS = np.array(
    [
        [(88 - 7 * ROOT) / 360, (296 - 169 * ROOT) / 1800, (-2 + 3 * ROOT) / 225],
        [(296 + 169 * ROOT) / 1800, (88 + 7 * ROOT) / 360, (-2 - 3 * ROOT) / 225],
        [(16 - ROOT) / 36, (16 + ROOT) / 36, 1 / 9],
    ]
)
"""Integrals up to the stages of the polynomials that are 1 at one stage and 0 at the others (Hairer, Wanner 1996)."""
ITERATIONS, DONE = 25, 1e-12
"""Most of a step, and what a last change of the displacements is, beside the coordinates in the metric of the mass."""
SLOW = 0.05
"""Factor by which an iteration has to be better than the one before for its matrices to serve the next step, too."""


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
    Raises InfeasibleError where the start breaks a constraint, NumericalError with the time where a step fails.
    """
    if system.drives.names:
        raise NumericalError("a driven joint has no such truth", remedy="set estimate.truth.model: fine")
    u = np.asarray(u, dtype=float)
    check_consistent(system, np.asarray(q0, dtype=float), np.asarray(v0, dtype=float), u[0])
    count, n, m = len(u) - 1, system.size, system.constrained
    q, v, lam = np.empty((count + 1, n)), np.empty((count + 1, n)), np.empty((count, m))
    q[0], v[0] = q0, v0
    eigen = np.linalg.eig(WEIGHTS)
    stages, factors = np.zeros((3, n + m)), None
    for k in range(count):
        loads = u[k] + PLACES[:, None] * (u[k + 1] - u[k])

        def equations(x: np.ndarray, here: np.ndarray, moving: np.ndarray, load: np.ndarray) -> Balance:
            return balance(system, here, moving, x[:n], np.zeros(m), x[n:], load, theta)

        try:
            stages, factors = _step(system, equations, q[k], v[k], loads, h, eigen, stages, factors)
        except NumericalError as error:
            raise NumericalError(f"at t = {k * h:g} s: {error.what}", remedy=error.remedy) from error
        ahead = q[k] + h * v[k] + h**2 * (WEIGHTS @ WEIGHTS)[-1] @ stages[:, :n]
        q[k + 1], v[k + 1] = nearest_state(system, ahead, v[k] + h * WEIGHTS[-1] @ stages[:, :n], u[k + 1])
        lam[k] = stages[-1, n:]
        stages = _EXTENDED @ stages
        if progress is not None:
            progress(k + 1)
    return Trajectory(h * np.arange(count + 1), q, v, u, lam)


Equations = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], Balance]
"""(a, λ) (n + m,), q, v (n,) and loads (nu,) of a stage → the terms there."""
Factors = list[tuple[np.ndarray, np.ndarray]]
"""Of the matrix of every eigenvalue."""


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
        found = [equations(*own) for own in zip(x, places, speeds, loads, strict=True)]
        if factors is None:
            factors, fresh = [_factor(found[-1], h * value) for value in values], True
        left = np.array(
            [
                np.concatenate([at.load - at.B.T @ own[n:], at.B @ own[:n] + at.B_rate @ moving])
                for at, own, moving in zip(found, x, speeds, strict=True)
            ]
        )
        along = back @ left
        change = -(across @ np.array([lu_solve(f, r) for f, r in zip(factors, along, strict=True)])).real
        x = x + change
        moved = float(np.linalg.norm(h**2 * system.metric * change[:, :n]))
        # what starts at zero moves beside where it gets
        size = max(size, float(np.linalg.norm(system.metric * places, axis=1).max()))
        if not np.isfinite(moved):
            break
        if moved <= DONE * size or (moved < 1e3 * DONE * size and moved > 0.5 * before):
            return x, factors if moved <= SLOW * before else None
        if moved > SLOW * before and not fresh:
            factors = None  # of a bench that has moved on since
        before = moved
    raise NumericalError("a step of the truth does not converge", remedy="take a smaller estimate.truth.step")


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
        raise NumericalError("the matrix of a step of the truth is singular", remedy="look at the joints") from error
    return np.asarray(lu), np.asarray(pivots)


def _extended() -> np.ndarray:
    """(3, 3): values at the stages of the next step of the polynomial through those of this one."""
    powers = PLACES[:, None] ** np.arange(3)
    return np.asarray((1 + PLACES[:, None]) ** np.arange(3) @ np.linalg.inv(powers))


_EXTENDED = _extended()
