"""What linear benches give placement: the system that gauges are ranked by, and what a filter on them will claim."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.multibody.inverse.linear import LinearBench, in_steps, in_time
from strainsight.placement.doubling import factor_after, steady_factor
from strainsight.placement.scenario import Scenario

DISTURBED = 1e-3
"""[m/s²] White acceleration of every body that gauges are ranked with where the filter has none or less: without any, motions
that nothing damps have no steady covariance."""


def scenario_of(
    bench: LinearBench, H: np.ndarray, noise: np.ndarray | float, acceleration: float, white: np.ndarray | float = 0.0
) -> Scenario:
    """The bench in time with readings of intensity σ²h, without weights.

    H (k, n*): readings of (η, η̇, unknowns); noise (k,) or one for all: σ of a sample every h; acceleration [m/s²] of the white
    force, `DISTURBED` at least; white (k,): variance of a reading by it for 1 m/s², which is taken as noise of its own.
    """
    acceleration = max(acceleration, DISTURBED)
    F, Q = in_time(bench, acceleration)
    variance = np.broadcast_to(np.asarray(noise) ** 2 + acceleration**2 * np.asarray(white), len(H))
    return Scenario(F, Q, H, variance * bench.h, np.zeros(len(F)))


def expected_std(
    bench: LinearBench,
    H: np.ndarray,
    noise: np.ndarray | float,
    acceleration: float,
    off: np.ndarray | float = 0.0,
) -> np.ndarray:
    """σ (nu,) [N, N m] of the inputs after an update, that the filter with these gauges comes to claim,
    where the samples begin long ago; off (k,): σ of a constant error of each reading, of which the gain knows nothing (Schmidt):

        S = (1 − K H) A S + K diag(off),     K = P Hᵀ R⁻¹,     σ² = diag(P + S Sᵀ)

    H (k, n*), noise and acceleration as of `scenario_of`, here as they are; inf where the gauges do not detect all inputs.
    Raises InfeasibleError and NumericalError as `steady_factor`.
    """
    A, N, scale = in_steps(bench, acceleration)
    L = steady_factor(A, H * scale / _column(noise), N)
    unknown = slice(len(A) - len(bench.increment), len(A))
    if L is None:
        return np.full(len(bench.increment), np.inf)
    G = np.broadcast_to(np.asarray(off) / noise, len(H))
    if G.any():
        scaled = H * scale / _column(noise)
        K = L @ (scaled @ L).T
        L = np.hstack([L, np.linalg.solve(np.eye(len(A)) - A + K @ (scaled @ A), K * G)])
    return np.asarray(np.linalg.norm(L[unknown], axis=1) * bench.increment)


def factors_along(
    benches: Sequence[LinearBench],
    readings: Sequence[np.ndarray],
    noise: np.ndarray | float,
    acceleration: float,
    drawn: np.ndarray,
    start: np.ndarray,
    steps: Sequence[int],
) -> list[np.ndarray]:
    """Factors L (unknowns, any) of the covariance of the unknowns c at the end of each pose of a run that stays in each of the
    benches for so many steps, after it began at rest with a covariance of c of the factor start (unknowns, any):

        L₀ = (S; 0; 1) start,     η = S c at rest,     from pose to pose   η ← S' c + Π (η − S c),   η̇ ← Π η̇

    Π takes a motion of the bodies from the modes of one pose to those of the next, so that the change of pose moves nothing by
    itself. drawn (unknowns,): σ of their changes in a step, 0 of a constant; readings: H of each;
    the others as of `scenario_of`.
    """
    found: list[np.ndarray] = []
    L = np.zeros((0, 0))
    for k, (bench, count) in enumerate(zip(benches, steps, strict=True)):
        r, rest = len(bench.stiffness), bench.B / bench.stiffness[:, None]
        if k == 0:
            L = np.vstack([rest @ start, np.zeros((r, start.shape[1])), start])
        else:
            before, felt = benches[k - 1], np.sqrt(bench.force)[:, None]
            over, c = np.linalg.lstsq(felt * bench.T, felt * before.T, rcond=None)[0], L[2 * len(before.stiffness) :]
            eta, rate = L[: len(before.stiffness)], L[len(before.stiffness) : 2 * len(before.stiffness)]
            swung = eta - before.B / before.stiffness[:, None] @ c
            L = np.vstack([rest @ c + over @ swung, over @ rate, c])
        A, N, scale = in_steps(bench, acceleration, drawn)
        H = readings[k] * scale / _column(noise)
        L = scale[:, None] * factor_after(A, H, N, L / scale[:, None], count)
        found.append(L[2 * r :])
    return found


def _column(noise: np.ndarray | float) -> np.ndarray:
    return np.atleast_1d(np.asarray(noise, dtype=float))[:, None]
