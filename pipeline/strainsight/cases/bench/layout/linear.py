"""A bench about its static equilibrium as a linear system with unknown inputs: what gauges are ranked by, and what a filter on
them will claim."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.update import joseph
from strainsight.multibody.inverse.linear import linearised
from strainsight.multibody.inverse.start import white_force
from strainsight.multibody.system import System
from strainsight.placement.scenario import Scenario

DISTURBED = 1e-3
"""[m/s²] White acceleration of every body that gauges are ranked with where the filter has none or less: without any, motions
that nothing damps have no steady covariance."""
SETTLED = 1e-13
"""Relative change of every variance in as many steps as went before, below which they are steady."""
MOST_DOUBLINGS = 60


@dataclass(frozen=True)
class LinearBench:
    """M ÿ + C ẏ + K y = B u + w about an equilibrium, q + T y, and the unknown inputs u as random walks.

    T (n, r) [unit of q per m √kg]; M, C, K (r, r); B (r, nu); increment (nu,) σ of the change of every input in a step of
    h [s]; force (n,) variances of the generalised force on q that is drawn in every step for 1 m/s² of white acceleration.
    """

    T: np.ndarray
    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    B: np.ndarray
    increment: np.ndarray
    force: np.ndarray
    h: float

    @property
    def static(self) -> np.ndarray:
        """Change of q per unit of every input (n, nu), at rest."""
        return np.asarray(self.T @ np.linalg.solve(self.K, self.B))

    def disturbance(self, acceleration: float) -> np.ndarray:
        """Covariance (r, r) of the white force on y in a step; acceleration [m/s²]."""
        return np.asarray((self.T.T * (acceleration**2 * self.force)) @ self.T)


def linear_bench(
    system: System,
    q: np.ndarray,
    u: np.ndarray,
    theta: np.ndarray,
    inputs: Sequence[int],
    increment: np.ndarray,
    h: float,
) -> LinearBench:
    """The system about the equilibrium q (n,) under u (all inputs) and θ; inputs: places of the unknown ones."""
    T, M, C, K, B = linearised(system, q, u, theta)
    return LinearBench(T, M, C, K, B[:, list(inputs)], np.asarray(increment, float), white_force(system, 1.0), h)


def scenario_of(bench: LinearBench, rows: np.ndarray, noise: float, acceleration: float) -> Scenario:
    """ẋ = F x + w, strain = H x + v of x = (y, ẏ, u), without weights:

        F = [0  I  0; −M⁻¹K  −M⁻¹C  M⁻¹B; 0  0  0],   Q = diag(0, h M⁻¹WM⁻¹, increment²/h),   r = σ²h

    W the covariance of the white force in a step. rows (k, n): strain per coordinate of the system; noise σ [strain] of a
    sample every h; acceleration [m/s²] of the white force, `DISTURBED` at least.
    """
    r, nu = bench.B.shape
    accelerations = np.linalg.solve(bench.M, np.hstack([-bench.K, -bench.C, bench.B]))
    F = np.zeros((2 * r + nu, 2 * r + nu))
    F[:r, r : 2 * r] = np.eye(r)
    F[r : 2 * r] = accelerations
    Q = np.zeros_like(F)
    W = bench.disturbance(max(acceleration, DISTURBED))
    Q[r : 2 * r, r : 2 * r] = bench.h * np.linalg.solve(bench.M, np.linalg.solve(bench.M, W).T)
    Q[2 * r :, 2 * r :] = np.diag(bench.increment**2 / bench.h)
    return Scenario(
        F, 0.5 * (Q + Q.T), _readings(bench, rows), np.full(len(rows), noise**2 * bench.h), np.zeros(len(F))
    )


def expected_std(bench: LinearBench, rows: np.ndarray, noise: float, acceleration: float) -> np.ndarray:
    """σ (nu,) [N, N m] of the inputs after an update, that the filter on implicit Euler with these gauges comes to claim:

        S v' = M v/h − K y + B(u + δ) + w,   y' = y + h v',   S = M/h + C + hK

    where the samples begin long ago. rows (k, n), noise and acceleration as of `scenario_of`, here as they
    are; inf where an input does not show in the gauges. Raises NumericalError where it does not settle.
    """
    (r, nu), h = bench.B.shape, bench.h
    S = bench.M / h + bench.C + h * bench.K
    velocity = np.linalg.solve(S, np.hstack([-bench.K, bench.M / h, bench.B, np.eye(r)]))
    A = np.eye(2 * r + nu)
    A[r : 2 * r] = velocity[:, : 2 * r + nu]
    A[:r] += h * A[r : 2 * r]
    H, inputs = _readings(bench, rows), slice(2 * r, 2 * r + nu)
    if np.linalg.matrix_rank(H[:, :r] @ np.linalg.solve(bench.K, bench.B) * bench.increment) < nu:
        return np.full(nu, np.inf)
    path = np.concatenate([h * velocity[:, -r:], velocity[:, -r:], np.zeros((nu, r))])
    walk = A[:, inputs] * bench.increment
    process = path @ bench.disturbance(acceleration) @ path.T + walk @ walk.T
    # all of one size: what an increment does at rest, and in a step
    still = np.abs(np.linalg.solve(bench.K, bench.B)) @ bench.increment
    scale = np.concatenate([still, still / h, bench.increment])
    unit = np.outer(scale, scale)
    P = steady(A / scale[:, None] * scale, H * scale, process / unit, np.full(len(rows), noise**2))
    return np.asarray(np.sqrt(np.diag(P)[inputs]) * bench.increment)


def steady(A: np.ndarray, H: np.ndarray, Q: np.ndarray, R: np.ndarray) -> np.ndarray:
    """P (n, n) after an update, of x' = A x + w, y = H x + v with covariances Q and diag R (m,), from P = 0 until it is steady:

        W = 1 + G P,   P ← P + Fᵀ P W⁻¹ F,   G ← G + F W⁻¹ G Fᵀ,   F ← F W⁻¹ F,     F = Aᵀ, G = HᵀR⁻¹H, P = Q at first

    each of which doubles the number of steps done; P is the covariance before an update. Raises NumericalError where it grows
    for ever. Source: Anderson, Int. J. Control 28 (1978).
    """
    F, G, P = A.T, (H.T / R) @ H, Q
    for _ in range(MOST_DOUBLINGS):
        WF, WG = np.split(np.linalg.solve(np.eye(len(A)) + G @ P, np.hstack([F, G])), 2, axis=1)
        rise = F.T @ P @ WF
        P, G, F = P + 0.5 * (rise + rise.T), G + F @ (0.5 * (WG + WG.T)) @ F.T, F @ WF
        # P grows, so each variance beside itself: a state that nothing but the disturbance reaches may dwarf the others
        if np.all(np.abs(np.diag(rise)) <= SETTLED * np.diag(P)):
            return np.asarray(joseph(P[None], H, R, np.nan)[0][0])
    raise NumericalError(
        f"the σ of the inputs does not settle within 2^{MOST_DOUBLINGS} steps",
        remedy="estimate.inputs: larger increments, or a smaller noise of the gauges",
    )


def _readings(bench: LinearBench, rows: np.ndarray) -> np.ndarray:
    """H (k, 2r + nu) on (y, ẏ, u)."""
    still = np.zeros((len(rows), len(bench.M) + bench.B.shape[1]))
    return np.hstack([rows @ bench.T, still])
