"""How unknown loads of a bench move in time: the input models of a structure, in the units of the loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import factorial

import numpy as np
from scipy.linalg import expm, solve_continuous_lyapunov

from strainsight.augmentation.input_models import (
    InputModel,
    IntegratedRandomWalk,
    RandomWalk,
    block_diagonal,
    components,
    input_intensity,
    rate_matrix,
)


@dataclass(frozen=True, eq=False)
class LoadProcess:
    """ċ = A c + w, w of intensity Q, u = c[first]; after a step c' = exp(Ah) c + δ.

    A (k, k) [1/s]; Q (k, k) [unit²/s]; first (nu,): places of the loads in c, behind each its rates, all in the unit of the load;
    std (k,): of the components behind the first at the start [unit]; h [s].
    """

    A: np.ndarray
    Q: np.ndarray
    first: np.ndarray
    std: np.ndarray
    h: float

    @property
    def size(self) -> int:
        """k."""
        return len(self.A)

    @cached_property
    def transition(self) -> np.ndarray:
        """exp(Ah) (k, k)."""
        return np.asarray(expm(self.A * self.h))

    @cached_property
    def drawn(self) -> np.ndarray:
        """Covariance (k, k) of δ, by the nilpotent or short series of A over small parts of the step, doubled."""
        parts = max(0, int(np.ceil(np.log2(max(np.abs(self.A).max(initial=0.0) * self.h, 1e-300) / SHORT))))
        return step_noise(self.A, self.Q, self.h / 2**parts, parts)[1]


SHORT = 0.8
"""Radians per part of a step that a series of TERMS terms is right to rounding for."""
TERMS = 17
_POWERS = np.arange(TERMS)
_OVERLAP = 1.0 / (1.0 + np.add.outer(_POWERS, _POWERS))
"""∫ sⁱ sʲ ds from 0 to 1."""
_INVERSE = [1.0 / factorial(j) for j in range(TERMS)]


def step_noise(F: np.ndarray, Q: np.ndarray, part: float, doublings: int) -> tuple[np.ndarray, np.ndarray]:
    """exp(F s) (n, n) and ∫₀ˢ exp(F t) Q exp(F t)ᵀ dt (n, n) of `step_responses`."""
    return step_responses(F, Q, np.zeros((len(F), 0)), part, doublings)[:2]


def step_responses(
    F: np.ndarray, Q: np.ndarray, G: np.ndarray, part: float, doublings: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Φ = exp(F s) (n, n), ∫₀ˢ exp(F t) Q exp(F t)ᵀ dt (n, n), X = ∫₀ˢ exp(F t) G dt and Y = ∫₀ˢ exp(F (s − t)) G t dt (n, k),
    s = part · 2^doublings, ‖F‖ part ≤ about SHORT:

        Φ₂ₛ = Φₛ Φₛ,   Q₂ₛ = Qₛ + Φₛ Qₛ Φₛᵀ,   X₂ₛ = Xₛ + Φₛ Xₛ,   Y₂ₛ = Yₛ + Φₛ Yₛ + s Xₛ

    from the Taylor series of the part, by powers of F⁴ (Paterson, Stockmeyer).
    """
    n, k = G.shape
    there = np.flatnonzero(Q.any(axis=0))
    values, vectors = np.linalg.eigh(Q[np.ix_(there, there)])
    both = np.zeros((TERMS, n, len(there) + k))
    both[0, there, k:], both[0, :, :k] = vectors * np.sqrt(np.maximum(values, 0.0)), G
    first = F * part
    for j in range(1, TERMS):
        np.matmul(first, both[j - 1], out=both[j])
        both[j] /= j
    low = [np.eye(n), first, first @ first]
    low.append(low[2] @ first)
    fourth = low[2] @ low[2]
    phi = low[0] * _INVERSE[TERMS - 1]
    for j in range(TERMS - 5, -1, -4):
        phi = fourth @ phi
        for i, own in enumerate(low):
            phi += own * _INVERSE[j + i]
    terms, fed, s = both[:, :, k:], np.empty((n, 2 * k)), part
    fed[:, :k] = part * np.tensordot(1 / (1.0 + _POWERS), both[:, :, :k], axes=1)
    fed[:, k:] = part**2 * np.tensordot(1 / ((1.0 + _POWERS) * (2.0 + _POWERS)), both[:, :, :k], axes=1)
    weighted = np.tensordot(part * _OVERLAP, terms, axes=1)
    wide = TERMS * len(there)
    gathered = terms.transpose(1, 0, 2).reshape(n, wide) @ weighted.transpose(1, 0, 2).reshape(n, wide).T
    for _ in range(doublings):
        gathered = gathered + phi @ gathered @ phi.T
        before = fed
        fed = phi @ before
        fed += before
        fed[:, k:] += s * before[:, :k]
        phi, s = phi @ phi, 2 * s
    return phi, 0.5 * (gathered + gathered.T), fed[:, :k], fed[:, k:]


def load_process(models: Sequence[InputModel], amplitude: np.ndarray, increment: np.ndarray, h: float) -> LoadProcess:
    """Of loads (nu,) by their models; amplitude (nu,) [unit] of all but random walks, increment (nu,) [unit]: σ of the change of
    a random walk in a step of h [s]; of the others not read."""
    A, Q, std, first, at = [], [], [], [], 0
    for model, size, change in zip(models, amplitude, increment, strict=True):
        walks = isinstance(model, RandomWalk)
        k, unit = components(model), 1.0 if walks else size
        A.append(rate_matrix(model))
        Q.append(unit**2 * input_intensity(model, change**2 / h if walks else 0.0))
        std.append(np.zeros(1) if walks else unit * _spread(model, k))
        first.append(at)
        at += k
    whole = block_diagonal(A) if A else np.zeros((0, 0))
    intensity = block_diagonal(Q) if Q else np.zeros((0, 0))
    return LoadProcess(whole, intensity, np.array(first, dtype=int), np.concatenate([*std, np.zeros(0)]), h)


def walks(increment: np.ndarray, h: float) -> LoadProcess:
    """Random walks with σ of their changes in a step, increment (nu,) [unit]."""
    changes = np.asarray(increment, dtype=float)
    return load_process([RandomWalk()] * len(changes), np.ones(len(changes)), changes, h)


def _spread(model: InputModel, k: int) -> np.ndarray:
    """σ (k,) of ζ at the start, 0 of the load itself, which is stated: stationary, and 1 of the rate of an integrated walk."""
    if isinstance(model, IntegratedRandomWalk):
        return np.array([0.0, 1.0])
    stationary = solve_continuous_lyapunov(rate_matrix(model), -input_intensity(model, 0.0))
    return np.concatenate([[0.0], np.sqrt(np.diag(stationary)[1:])])
