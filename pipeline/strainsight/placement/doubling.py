"""The steady error covariance of a filter in steps: doubled in factors, and measured by how far it is from the solution."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from strainsight.errors import InfeasibleError, NumericalError
from strainsight.loads.observability import undetectable_directions

ACCEPTED = 1e-9
"""Largest error of a covariance, beside σᵢσⱼ, that is taken as solved."""
NOT_REACHED = 1e-8
"""States whose σ is below this share of the largest are taken as not reached by the noise."""
SETTLED = 1e-13
"""Relative change of every variance in as many steps as went before, below which they are steady."""
MOST_DOUBLINGS = 60


def steady_factor(A: np.ndarray, H: np.ndarray, N: np.ndarray) -> np.ndarray | None:
    """L (n, k), P = LLᵀ after an update, of the steady filter on x' = A x + N w, y = H x + v, with w and v of unit covariance;
    None where the rows do not detect what fails to decay by itself.

    A (n, n), N (n, any), H (m, n), states in units of like size. From P⁻ = NNᵀ, F = Aᵀ, G = HᵀH every doubling takes as many
    steps as were done before:

        W = 1 + G P⁻,   P⁻ ← P⁻ + Fᵀ P⁻ W⁻¹ F,   G ← G + F W⁻¹ G Fᵀ,   F ← F W⁻¹ F

    on factors P⁻ = LLᵀ, G = CᵀC with CL = U Σ Vᵀ, so that nothing is inverted that could be singular and no variance loses
    its sign: P⁻W⁻¹ = L V(1 + Σ²)⁻¹VᵀLᵀ, W⁻¹G = CᵀU(1 + Σ²)⁻¹UᵀC, W⁻¹ = 1 − CᵀU Σ(1 + Σ²)⁻¹VᵀLᵀ.
    Raises InfeasibleError where a motion that does not decay is reached by no noise, NumericalError where P is further than
    1e-9 from the solution. Source: Anderson, Int. J. Control 28 (1978); Chu, Fan, Lin and Wang, Int. J. Control 77 (2004).
    """
    one = np.eye(len(A))
    # (A − 1)(A + 1)⁻¹ has the eigenvectors of A, and Re λ ≥ 0 where A has |λ| ≥ 1
    unstepped = np.linalg.solve((A + one).T, (A - one).T).T
    if undetectable_directions(unstepped, H).shape[1]:
        return None
    if undetectable_directions(unstepped.T, N.T).shape[1]:
        raise InfeasibleError(
            "a motion that does not decay is reached by no noise: no steady filter exists",
            remedy="give all that moves damping or a disturbance",
        )
    F, C, L = A.T, _triangle(H), _triangle(N.T).T
    for _ in range(MOST_DOUBLINGS):
        variance = np.sum(L**2, axis=1)
        F, C, L = _doubled(F, C, L)
        grown = np.sum(L**2, axis=1) - variance
        # P⁻ grows, so each variance beside itself: a state that nothing but one noise reaches may dwarf the others
        if np.all(grown <= SETTLED * np.maximum(variance, NOT_REACHED**2 * variance.max())):
            break
    before = updated(L, H)
    # what doubling has rounded, a step of the filter itself forgets as fast as it forgets all else
    P = updated(_triangle(np.hstack([A @ before, N]).T).T, H)
    if not (error := _error(A, H, before, P)) <= ACCEPTED:
        solved = f"solved to {error:.1e} only" if np.isfinite(error) else "not solved: its filter is not stable"
        raise NumericalError(
            f"the steady covariance of a set of gauges is {solved}; {ACCEPTED:.0e} is asked for",
            remedy="the noises of gauges and inputs lie too far apart for sixteen digits: check their units",
        )
    return P


def factor_after(A: np.ndarray, H: np.ndarray, N: np.ndarray, start: np.ndarray, steps: int) -> np.ndarray:
    """L (n, k), P = LLᵀ after the update of the last of so many steps of the filter of `steady_factor`, from a start whose
    covariance has the factor start (n, any) and no reading. With the W, G, F and P⁻ of 2ʲ steps, which the doublings there give,

        P ← P⁻ + Fᵀ P (1 + G P)⁻¹ F

    leads any covariance P before a reading as many steps on; the steps are put together of powers of two.
    """
    P = _triangle(np.hstack([A @ start, N]).T).T
    F, C, L = A.T, _triangle(H), _triangle(N.T).T
    left = steps - 1
    while left > 0:
        if left % 2:
            P = _triangle(np.hstack([L, F.T @ updated(P, C)]).T).T
        left //= 2
        if left:
            F, C, L = _doubled(F, C, L)
    return updated(P, H)


def updated(L: np.ndarray, H: np.ndarray) -> np.ndarray:
    """Factor L V(1 + Σ²)^(−½) of P − PHᵀ(1 + HPHᵀ)⁻¹HP, P = LLᵀ, HL = U Σ Vᵀ: readings H (m, n) of unit noise."""
    _, s, Vt = np.linalg.svd(H @ L)
    return np.asarray((L @ Vt.T) * _kept(s, len(Vt)))


def _doubled(F: np.ndarray, C: np.ndarray, L: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same of twice as many steps."""
    U, s, Vt = np.linalg.svd(C @ L)
    m = len(s)
    rise, seen = (F.T @ L @ Vt.T) * _kept(s, len(Vt)), _kept(s, len(U))[:, None] * (U.T @ C @ F.T)
    F = F @ F - (F @ C.T @ U[:, :m]) * (s / (1 + s**2)) @ (Vt[:m] @ L.T @ F)
    return F, _triangle(np.vstack([C, seen])), _triangle(np.hstack([L, rise]).T).T


def _error(A: np.ndarray, H: np.ndarray, before: np.ndarray, after: np.ndarray) -> float:
    """How far a covariance P, after = its factor, is from the solution, the largest |Xᵢⱼ|/σᵢσⱼ; infinite where its filter is
    not stable.

    X = Φ(X + P − P₋)Φᵀ, P₋ that of a step before, by Newton's step; Φ = (1 − KH)A. Source: Hewer, IEEE Trans. AC 16 (1971).
    """
    std = np.linalg.norm(after, axis=1)
    std = np.maximum(std, NOT_REACHED * std.max())
    loop = (A - after @ (H @ after).T @ H @ A) / std[:, None] * std
    if not np.abs(np.linalg.eigvals(loop)).max() < 1:
        return float("inf")
    after, before = after / std[:, None], before / std[:, None]
    missed = loop @ (after @ after.T - before @ before.T) @ loop.T
    return float(np.abs(solve_discrete_lyapunov(loop, missed)).max())


def _kept(s: np.ndarray, size: int) -> np.ndarray:
    """(1 + Σ²)^(−½) (size,), one beyond the singular values."""
    return np.concatenate([1 / np.sqrt(1 + s**2), np.ones(size - len(s))])


def _triangle(X: np.ndarray) -> np.ndarray:
    """R (any, n) of no more than n rows with RᵀR = XᵀX, X (any, n)."""
    return X if len(X) <= X.shape[1] else np.asarray(np.linalg.qr(X, mode="r"))
