"""Layouts by other rules on the same pool, to be scored by the same covariance."""

from __future__ import annotations

import numpy as np
from scipy.linalg import qr

from strainsight.errors import ConfigError


def random_sets(pool: int, keep: int, count: int, seed: int) -> np.ndarray:
    """`count` sets of `keep` different gauges out of `pool`, uniformly; (count, keep), each ascending."""
    _check(pool, keep)
    rng = np.random.default_rng(seed)
    return np.array([np.sort(rng.choice(pool, keep, replace=False)) for _ in range(count)]).reshape(count, keep)


def effective_independence(rows: np.ndarray, keep: int) -> np.ndarray:
    """EFI: remove, again and again, the gauge of the smallest leverage E_g = h_g (HᵀH)⁻¹ h_gᵀ of the strain modes.

    rows (m, k): strain of every gauge in k modes, most important first; at most `keep` of them are used, since fewer
    gauges than modes have no independent set. Returns `keep` gauges, ascending; the lower index leaves a tie.
    Source: Kammer, J. Guidance 14 (1991).
    """
    _check(len(rows), keep)
    left = np.arange(len(rows))
    targets = _independent(rows[:, :keep])
    while len(left) > keep:
        basis = np.linalg.qr(targets[left])[0]
        left = np.delete(left, int(np.argmin(np.sum(basis**2, axis=1))))
    return left


def qr_pivoting(rows: np.ndarray, keep: int) -> np.ndarray:
    """The first `keep` pivots of QR(Hᵀ); of QR(H Hᵀ) where more gauges than columns are kept. Ascending.

    rows (m, k): strain of every gauge in k modes.
    Source: Manohar, Brunton, Kutz and Brunton, IEEE Control Systems 38 (2018).
    """
    _check(len(rows), keep)
    matrix = rows.T if keep <= rows.shape[1] else rows @ rows.T
    return np.sort(qr(matrix, mode="r", pivoting=True)[1][:keep])


def d_optimal(rows: np.ndarray, variance: np.ndarray, prior: np.ndarray, keep: int) -> np.ndarray:
    """Greedy Bayesian D-optimal set: add, again and again, the gauge that raises log det(C⁻¹ + Σ h hᵀ/r) most, which is

        log(1 + h_g Σ h_gᵀ / r_g),    Σ⁺ = Σ − Σ h hᵀ Σ / (r + h Σ hᵀ),    Σ₀ = C

    rows (m, k) [strain]; variance r (m,) [strain²]; prior C (k, k): covariance of the coordinates in the training run.
    Returns `keep` gauges, ascending; the lower index wins a tie. Source: Krause, Singh and Guestrin, JMLR 9 (2008).
    """
    _check(len(rows), keep)
    y = rows / np.sqrt(variance)[:, None]
    covariance = np.array(prior, dtype=float)
    free = np.ones(len(rows), dtype=bool)
    for _ in range(keep):
        answer = y @ covariance
        gain = np.sum(answer * y, axis=1)
        best = int(np.argmax(np.where(free, gain, -np.inf)))
        free[best] = False
        covariance -= np.outer(answer[best], answer[best]) / (1 + gain[best])
    return np.flatnonzero(~free)


def _independent(rows: np.ndarray) -> np.ndarray:
    """The columns of rows (m, k) of unit length, without those that depend on the ones before them."""
    columns: list[np.ndarray] = []
    kept = []
    for column in rows.T:
        rest = column.copy()
        for _ in range(2):
            for unit in columns:
                rest -= unit * (unit @ rest)
        if np.linalg.norm(rest) > 1e-8 * np.linalg.norm(column):
            columns.append(rest / np.linalg.norm(rest))
            kept.append(column / np.linalg.norm(column))
    if not kept:
        raise ConfigError("no gauge of the pool answers to any mode", remedy="choose another direction for the gauges")
    return np.array(kept).T


def _check(pool: int, keep: int) -> None:
    if not 1 <= keep <= pool:
        raise ConfigError(f"{keep} gauges out of a pool of {pool}", remedy=f"keep between 1 and {pool}")
