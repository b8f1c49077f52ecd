"""Static equilibrium."""

from __future__ import annotations

import numpy as np

from strainsight.errors import InfeasibleError, NumericalError
from strainsight.multibody.equations import Balance, balance
from strainsight.multibody.system import System

ITERATIONS = 200
CONVERGED = 1e-12
ROUNDING = 1e-8
"""A correction below this that no longer shrinks is rounding."""
NEAR = 1e-11
"""Shift of the first step beside the stiffness where q is nearly there: Newton's own."""
FIRMEST = 1e6
"""Shift beside the stiffness beyond which a trial state that some force does not allow is not gone round."""
FREE = 1e-12
"""Stiffness of a motion beside the largest (in the metric of the mass) below which nothing holds it."""


def static_equilibrium(
    system: System, q: np.ndarray, u: np.ndarray, theta: np.ndarray, near: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """q (n,) and λ (m,) with  f(q, 0, u, θ) = Bᵀλ,  φ(q) = 0,  from the configuration q.

        [K + D²/τ²   −Bᵀ] [Δq]     [f − Bᵀλ]
        [B            0 ] [λ'] = − [φ      ],     τ grows as the imbalance falls: at last Newton's own steps

    the motion of the system under heavy damping with ever longer time steps, which goes downhill in the potential (from
    the very top of it, it stays there). near: q is an equilibrium of nearly the same loads and parameters.
    Raises NumericalError where it does not settle, InfeasibleError where nothing holds some motion of a body (named).
    Source: pseudo-transient continuation, Kelley and Keyes, SIAM J. Numer. Anal. 35 (1998).
    """
    q, u, theta = np.array(q, dtype=float), np.asarray(u, dtype=float), np.asarray(theta, dtype=float)
    d, m, n = system.metric, system.constrained, system.size
    zero, lam = np.zeros(n), np.zeros(m)
    at = balance(system, q, zero, zero, np.zeros(m), lam, u, theta)
    K, B, s = in_the_metric(at, d)
    if m:
        lam = np.linalg.lstsq(B.T, at.load / d, rcond=None)[0] * s
    stiffness = float(np.linalg.norm(K, 2)) or 1.0
    before, shift, whole, good = np.inf, NEAR * stiffness if near else stiffness, 1.0, (q, lam)
    for _ in range(ITERATIONS):
        try:
            at = balance(system, q, zero, zero, np.zeros(m), lam, u, theta)
        except NumericalError:
            # a force that cannot be had at a trial state: go there in smaller steps
            shift = max(10 * shift, 1e-3 * stiffness)
            if shift > FIRMEST * stiffness:
                raise
            q, lam = good
            continue
        good = q, lam
        K, B, s = in_the_metric(at, d)
        A = np.block([[K + shift * np.eye(n), -B.T], [B, np.zeros((m, m))]])
        right = -np.concatenate([at.load / d, s * at.phi])
        try:
            z = np.linalg.solve(A, right)
        except np.linalg.LinAlgError:
            if before < 1e-6 * whole:
                refuse_free(system, K, B)
            shift = max(4 * shift, 1e-6 * stiffness)
            continue
        x, whole = z[:n], float(np.linalg.norm(d * q)) or 1.0
        size = float(np.linalg.norm(x))
        if m and size > 0.3 * whole:
            x *= 0.3 * whole / size
        q, lam = q + x / d, z[n:] * s
        if shift < 1e-10 * stiffness and (
            size <= CONVERGED * whole or (size < ROUNDING * whole and size > 0.3 * before)
        ):
            at = balance(system, q, zero, zero, np.zeros(m), lam, u, theta)
            refuse_free(system, *in_the_metric(at, d)[:2])
            return q, lam
        shift *= 0.2 if size < before or size < ROUNDING * whole else 2.0
        before = size
    raise NumericalError(
        f"no static equilibrium was found in {ITERATIONS} iterations (last change {before:.2g} of {whole:.2g})",
        remedy="start nearer to it, or hold or damp the motion that goes on",
    )


def in_the_metric(at: Balance, d: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """D⁻¹K D⁻¹ (n, n), S B D⁻¹ (m, n) of unit rows, and S (m,), by which λ = S λ'."""
    B = at.B / d
    s = 1 / np.maximum(np.linalg.norm(B, axis=1), np.finfo(float).tiny)
    return at.stiffness / np.outer(d, d), s[:, None] * B, s


def refuse_free(system: System, K: np.ndarray, B: np.ndarray) -> None:
    """Raise InfeasibleError, with the body, where nothing holds a motion on B x = 0; K (n, n), B (m, n) as of `in_the_metric`."""
    null = np.linalg.svd(B)[2][len(B) :].T if len(B) else np.eye(system.size)
    if not null.shape[1]:
        return
    _, sigma, V = np.linalg.svd(null.T @ K @ null)
    if sigma[-1] < FREE * max(sigma[0], np.finfo(float).tiny):
        motion = np.abs(null @ V[-1])
        name = max(system.of, key=lambda body: float(np.max(motion[system.of[body]])))
        raise InfeasibleError(
            f"nothing holds body {name} in one motion (stiffness {sigma[-1] / max(sigma[0], 1e-300):.1e} of the largest)",
            remedy="hold that motion with a joint or a spring",
        )
