"""Layouts by other rules on the same pool, to be scored by the same covariance.

Rows (pool, k), or (pool, c, k) for up to c channels (zero rows if fewer): modal strain, or whitened rows of the augmented model.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain

import numpy as np

from strainsight.errors import ConfigError
from strainsight.ordering import ascending_ties, index_of_largest

VITAL = 1e-9
"""Eigenvalue of a hat block, up to 1, above which a mode depends on the unit."""
LEVEL = 1e-10
"""Difference of leverages below which they tie: those of mirrored gauges differ by up to 1e-12 by rounding."""
DEPENDENT = 1e-8
"""Share of a vector outside the span of others below which it depends on them."""
NOTHING = 1e-12
"""Gains below this share of the largest are rounding, and tie."""
TRIES = 200
"""Draws per set until the search for allowed sets is aborted."""


def random_sets(
    pool: int, keep: int, count: int, seed: int, allowed: Callable[[np.ndarray], bool] | None = None
) -> np.ndarray:
    """`count` sets of `keep` different gauges out of `pool`, uniformly; (count, keep), each ascending. allowed: only sets for
    which it is true, by rejection and so uniformly among them; fewer than `count`, or none, where `TRIES` · count draws do
    not find as many."""
    _check(pool, keep)
    rng = np.random.default_rng(seed)
    sets: list[np.ndarray] = []
    for _ in range(count if allowed is None else TRIES * count):
        if len(sets) == count:
            break
        sample = np.sort(rng.choice(pool, keep, replace=False))
        if allowed is None or allowed(sample):
            sets.append(sample)
    return np.array(sets, dtype=int).reshape(len(sets), keep)


def effective_independence(rows: np.ndarray, keep: int) -> np.ndarray:
    """EFI: remove, again and again, the gauge of the smallest leverage E_g = tr h_g (HᵀH)⁻¹ h_gᵀ of the strain modes.

    rows (pool, k) or (pool, c, k): reading of every channel in k modes, most important first; no more modes are used than
    any `keep` gauges have channels, since fewer readings than modes are no independent set. A gauge of several channels
    without which a mode would be lost stays. Returns `keep` gauges, ascending; the lower index leaves a tie.
    Source: Kammer, J. Guidance 14 (1991)."""
    _check(len(rows), keep)
    blocks = _blocks(rows)
    modes = int(np.sort(np.maximum(blocks.any(axis=2).sum(axis=1), 1))[:keep].sum())
    left = np.arange(len(blocks))
    flat = _independent(blocks.reshape(-1, blocks.shape[2])[:, :modes])
    targets = flat.reshape(*blocks.shape[:2], -1)
    while len(left) > keep:
        basis = np.linalg.qr(targets[left].reshape(-1, targets.shape[2]))[0]
        left = np.delete(left, _least_leverage(basis.reshape(len(left), blocks.shape[1], -1)))
    return left


def _least_leverage(basis: np.ndarray) -> int:
    """The unit with the smallest trace of its hat block among those that lose no mode; basis (units, c, k) orthonormal."""
    leverage = np.einsum("uck,uck->u", basis, basis)
    order = ascending_ties(leverage, LEVEL)
    least = next(order)
    spared = (at for at in chain([least], order) if np.linalg.norm(basis[at], 2) ** 2 < 1 - VITAL)
    return next(spared, least)


def qr_pivoting(rows: np.ndarray, keep: int) -> np.ndarray:
    """The first `keep` gauges in the order of their first pivot of QR(Hᵀ); then of QR(Hᵀ) of the gauges left, and so on.

    rows (pool, k) or (pool, c, k): reading of every channel in k modes. Returns `keep` gauges, ascending; the lower index
    wins a tie.
    Source: Manohar, Brunton, Kutz and Brunton, IEEE Control Systems 38 (2018)."""
    _check(len(rows), keep)
    blocks = _blocks(rows)
    c, k = blocks.shape[1:]
    selected: list[int] = []
    while len(selected) < keep:
        left = np.setdiff1d(np.arange(len(blocks)), selected)
        pivots = left[_pivots(blocks[left].reshape(-1, k)) // c]
        selected += list(dict.fromkeys(pivots.tolist())) or left.tolist()
    return np.sort(selected[:keep])


def _pivots(rows: np.ndarray) -> np.ndarray:
    """Rows (m, k) in the order of their distance from the span of those before, as long as they are independent."""
    rest = rows.copy()
    selected: list[int] = []
    length = np.sum(rest**2, axis=1)
    while len(selected) < min(rows.shape) and length.max() > DEPENDENT**2 * np.sum(rows**2, axis=1).max():
        selected.append(index_of_largest(length))
        unit = rest[selected[-1]] / np.sqrt(length[selected[-1]])
        rest -= np.outer(rest @ unit, unit)
        rest[selected[-1]] = 0.0
        length = np.sum(rest**2, axis=1)
    return np.array(selected, dtype=int)


def d_optimal(rows: np.ndarray, variance: np.ndarray, prior: np.ndarray, keep: int) -> np.ndarray:
    """Greedy Bayesian D-optimal set: add, again and again, the gauge that raises log det(C⁻¹ + Σ hᵀh/r) most, which is by

        log det(I + h_g Σ h_gᵀ),    Σ⁺ = Σ − Σ hᵀ (I + h Σ hᵀ)⁻¹ h Σ,    Σ₀ = C,    h at unit noise

    rows (pool, k) or (pool, c, k) [strain, or the unit of the channel]; variance r (pool,) or (pool, c) [its square],
    positive also of zero rows; prior C (k, k): covariance of the coordinates in the training simulation.
    Returns `keep` gauges, ascending; the lower index wins a tie. Source: Krause, Singh and Guestrin, JMLR 9 (2008)."""
    _check(len(rows), keep)
    blocks = _blocks(rows / np.sqrt(variance)[..., None])
    pool, c, k = blocks.shape
    y = blocks.reshape(-1, k)
    covariance = np.array(prior, dtype=float)
    free, rounding = np.ones(pool, dtype=bool), 0.0
    for _ in range(keep):
        answer = y @ covariance
        if c == 1:
            gain = np.sum(answer * y, axis=1)  # the logarithm is monotone
        else:
            read = np.linalg.eigvalsh(np.einsum("gik,gjk->gij", answer.reshape(pool, c, k), blocks))
            gain = np.log1p(np.maximum(read, 0.0)).sum(axis=1)
        rounding = rounding or NOTHING * float(gain.max())
        best = index_of_largest(np.where(free, gain, -np.inf), rounding)
        free[best] = False
        for channel in range(best * c, (best + 1) * c):
            # one channel after the other is the same update as all at once
            row = answer[channel] if channel == best * c else y[channel] @ covariance
            covariance -= np.outer(row, row) / (1 + np.sum(row * y[channel]))
    return np.flatnonzero(~free)


def _blocks(rows: np.ndarray) -> np.ndarray:
    """(pool, c, k) of rows (pool, k) or (pool, c, k)."""
    return np.reshape(rows, (len(rows), -1, rows.shape[-1]))


def _independent(rows: np.ndarray) -> np.ndarray:
    """The columns of rows (m, k) with unit length, without those that depend on earlier ones."""
    columns: list[np.ndarray] = []
    selected = []
    for column in rows.T:
        rest = column.copy()
        for _ in range(2):
            for unit in columns:
                rest -= unit * (unit @ rest)
        if np.linalg.norm(rest) > DEPENDENT * np.linalg.norm(column):
            columns.append(rest / np.linalg.norm(rest))
            selected.append(column / np.linalg.norm(column))
    if not selected:
        raise ConfigError(
            "no candidate gauge responds to any mode", remedy="choose another measuring direction of the gauges"
        )
    return np.array(selected).T


def _check(pool: int, keep: int) -> None:
    if not 1 <= keep <= pool:
        raise ConfigError(
            f"cannot keep {keep} of the {pool} candidate gauges",
            remedy=f"keep between 1 and {pool} gauges (place.keep)",
        )
