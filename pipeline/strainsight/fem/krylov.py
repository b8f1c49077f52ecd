"""The lowest modes by block Lanczos iterations."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import sparse
from scipy.linalg import eigh

from strainsight.errors import NumericalError

DEPENDENT = 1e-14
"""Share of A⁻¹M q in the norm of M below which what is left of it beside all q is rounding."""
MOST = 1000
"""Blocks after which iterations are given up."""


def largest(
    inverse: Callable[[np.ndarray], np.ndarray],
    M: sparse.csr_array,
    count: int,
    start: np.ndarray,
    most: int,
    tolerance: float,
    beside: int = 0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The largest μ of A⁻¹M φ = μ φ, in the space of the vectors Q of all blocks:

        A⁻¹M Q = Q T + q [0 R],   QᵀMQ = I,   T s = μ s,   φ = Q s

    Every block is made orthogonal in M to all before it; before Q has more than `most` columns, the best φ take their place
    (thick restart). It ends where every |A⁻¹Mφ − μφ|_M = |R s_last| of the first `count` is at most tolerance · μ. A block sees
    as many copies of a repeated μ as it has vectors, and what the start has no part of is not seen at all.
    inverse: X (n, k) → A⁻¹X; M (n, n) positive semidefinite; start (n, b), in the range of A⁻¹M; beside: how many of the next
    are returned as they stand.
    Returns μ (count + beside,) falling, φ (n, count + beside) with φᵀMφ = 1, and |A⁻¹Mφ − μφ|_M, fewer where there are no more.
    Raises NumericalError where they do not converge.
    Sources: Grimes, Lewis and Simon, SIAM J. Matrix Anal. Appl. 15 (1994); Wu and Simon, ibid. 22 (2000).
    """
    Q, T, used = np.empty((len(start), most), order="F"), np.zeros((0, 0)), 0
    q, Mq, _ = _beside(Q[:, :0], M, start, M @ start)
    for _ in range(MOST):
        behind = used + q.shape[1]
        Q[:, used:behind] = q
        W = inverse(Mq)
        MW = M @ W
        share = Q[:, :behind].T @ MW
        T = np.block([[T, share[:used]], [share[:used].T, 0.5 * (share[used:] + share[used:].T)]])
        whole = _length(W, MW)
        W -= Q[:, :behind] @ share
        q, Mq, R = _beside(Q[:, :behind], M, W, M @ W, DEPENDENT * whole)
        mu, s = eigh(T)
        mu, s = mu[::-1], s[:, ::-1]
        found = min(count + beside, behind)
        left = np.linalg.norm(R @ s[used:, :found], axis=0)
        if not q.shape[1] or (behind >= count and np.all(left[:count] <= tolerance * mu[: min(count, behind)])):
            return mu[:found], Q[:, :behind] @ s[:, :found], left
        used = behind
        if used + q.shape[1] > most:
            used = min(behind, (count + beside + most) // 2)
            Q[:, :used] = Q[:, :behind] @ s[:, :used]
            T = np.diag(mu[:used])
    raise NumericalError(
        f"the Lanczos iterations did not converge in {MOST} steps",
        remedy="check the model for nearly loose parts, or ask for fewer modes",
    )


def _length(W: np.ndarray, MW: np.ndarray) -> float:
    """The largest norm in M of columns."""
    return float(np.sqrt(np.maximum(np.einsum("ij,ij->j", W, MW), 0.0).max(initial=0.0)))


def _beside(
    Q: np.ndarray, M: sparse.csr_array, W: np.ndarray, MW: np.ndarray, least: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, Mq (n, r) and R (r, b) of W = Q C + q R: qᵀMq = I, QᵀMq = 0; r < b where less than b directions are longer than
    `least`. Twice: the first Gram matrix knows what is 1e-8 of the longest by its order only."""
    R, floor = np.eye(W.shape[1]), least
    for first in (True, False):
        W = W - Q @ (Q.T @ MW)
        # QᵀMW = 0 now, so that the old MW gives the products of the new W
        G = W.T @ MW
        size, V = eigh(0.5 * (G + G.T))
        longest = float(size[-1]) if len(size) else 0.0
        if not longest > floor**2:
            return W[:, :0], MW[:, :0], R[:0]
        if first:
            size = np.maximum(size, 1e-15 * longest)
        else:
            kept = (size > 1e-12) & (np.linalg.norm(np.sqrt(np.abs(size))[:, None] * (V.T @ R), axis=1) > least)
            size, V = size[kept], V[:, kept]
        turn = V / np.sqrt(size)
        W, R, floor = W @ turn, np.sqrt(size)[:, None] * (V.T @ R), 0.0
        MW = M @ W if first else MW @ turn
    return W, MW, R
