"""How unknown loads of a bench move in time: the input models of a structure, in the units of the loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import factorial

import numpy as np
from scipy.linalg import block_diag, expm, solve_continuous_lyapunov

from strainsight.loads.input_models import (
    InputModel,
    IntegratedRandomWalk,
    RandomWalk,
    components,
    input_intensity,
    rate_matrix,
)


@dataclass(frozen=True, eq=False)
class LoadProcess:
    """ċ = A c + w, w of intensity Q, u = c[first]; after a step c' = exp(Ah) c + δ. A (k, k) [1/s]; Q (k, k) [unit²/s]; first
    (nu,): places of the loads in c, behind each its rates, all in the unit of the load; std (k,): of the components behind
    the first at the start [unit]; h [s]."""

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
    def noise_covariance(self) -> np.ndarray:
        """Covariance (k, k) of δ, by the nilpotent or short series of A over small parts of the step, doubled."""
        parts = doublings_of(np.abs(self.A).max(initial=0.0) * self.h)
        return step_noise(self.A, self.Q, self.h / 2**parts, parts)[1]


SHORT = 0.8
"""Radians per part of a step that series of 4 · FOURTHS terms are right to rounding for, and a Gauss rule of NODES of squares."""
FOURTHS, NODES = 5, 7
_SERIES = np.array([1.0 / factorial(j) for j in range(4 * FOURTHS + 2)])
_REMAINDER = _SERIES[2:].reshape(FOURTHS, 4)
"""Of φ₂(x) = (eˣ − 1 − x)/x², four powers a row."""
_AT, _WEIGHTS = (0.5 * (np.polynomial.legendre.leggauss(NODES)[i] + shift) for i, shift in ((0, 1.0), (1, 0.0)))
_EXPONENTIALS = np.sqrt(_WEIGHTS)[:, None] * _AT[:, None] ** np.arange(4 * FOURTHS) * _SERIES[:-2]
"""√weight · eˢˣ at the nodes s of the rule (NODES, 4 · FOURTHS), by powers of x."""


def doublings_of(radians: float) -> int:
    """How often a step of so many radians is halved into parts of SHORT."""
    return max(0, int(np.ceil(np.log2(max(radians, 1e-300) / SHORT))))


def step_noise(F: np.ndarray, Q: np.ndarray, part: float, doublings: int) -> tuple[np.ndarray, np.ndarray]:
    """exp(F s) (n, n) and ∫₀ˢ exp(F t) Q exp(F t)ᵀ dt (n, n) of `step_responses`."""
    return step_responses(F, Q, np.zeros((len(F), 0)), part, doublings)[:2]


def step_responses(
    F: np.ndarray, Q: np.ndarray | None, G: np.ndarray, part: float, doublings: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Φ (n, n), step noise (n, n), and the load integrals X and Y (n, k), with s = part · 2^doublings, ‖F‖ part ≤ about SHORT:

        Φ = exp(F s),   ∫₀ˢ exp(F t) Q exp(F t)ᵀ dt,   X = ∫₀ˢ exp(F t) G dt,   Y = ∫₀ˢ exp(F (s − t)) G t dt

        Φ₂ₛ = Φₛ Φₛ,   Q₂ₛ = Qₛ + Φₛ Qₛ Φₛᵀ,   X₂ₛ = Xₛ + Φₛ Xₛ,   Y₂ₛ = Yₛ + Φₛ Yₛ + s Xₛ

    from the series of φ₂(A) = A⁻²(eᴬ − 1 − A) of a part p, A = F p, by powers of A⁴ (Paterson, Stockmeyer), Φ = 1 + A + A² φ₂,
    X = p (1 + A φ₂) G, Y = p² φ₂ G, and a Gauss rule for the noise; Q None: of none."""
    n, k = G.shape
    A = F * part
    low = np.empty((4, n, n))
    low[0], low[1] = np.eye(n), A
    np.matmul(A, A, out=low[2])
    np.matmul(low[2], A, out=low[3])
    fourth = low[2] @ low[2]
    rows = (_REMAINDER @ low.reshape(4, n * n)).reshape(FOURTHS, n, n)
    phi2 = rows[-1]
    for row in rows[-2::-1]:
        phi2 = fourth @ phi2 + row
    phi1 = A @ phi2 + low[0]
    # Φ, X and Y in one array, all propagated by Φ
    carried, s = np.empty((n, n + 2 * k)), part
    carried[:, :n] = A @ phi1 + low[0]
    carried[:, n : n + k], carried[:, n + k :] = part * (phi1 @ G), part**2 * (phi2 @ G)
    gathered = _gathered(Q, low, fourth, part)
    for _ in range(doublings):
        phi = carried[:, :n]
        if gathered is not None:
            gathered = gathered + phi @ gathered @ phi.T
        further = phi @ carried
        further[:, n:] += carried[:, n:]
        further[:, n + k :] += s * carried[:, n : n + k]
        carried, s = further, 2 * s
    noise = np.zeros((n, n)) if gathered is None else 0.5 * (gathered + gathered.T)
    return carried[:, :n], noise, carried[:, n : n + k], carried[:, n + k :]


def _gathered(Q: np.ndarray | None, low: np.ndarray, fourth: np.ndarray, part: float) -> np.ndarray | None:
    """∫ exp(A s) Q exp(A s)ᵀ ds · part over 0 to 1 (n, n), by a Gauss rule; None of no noise; low: A⁰ to A³, fourth A⁴."""
    if Q is None or not Q.any():
        return None
    driven = np.flatnonzero(Q.any(axis=0))
    values, vectors = np.linalg.eigh(Q[driven[:, None], driven])
    n, noises = len(Q), len(driven)
    powers = np.empty((FOURTHS, n, 4, noises))
    powers[0] = (low[:, :, driven] @ (vectors * np.sqrt(part * np.maximum(values, 0.0)))).transpose(1, 0, 2)
    flat = powers.reshape(FOURTHS, n, 4 * noises)
    for j in range(1, FOURTHS):
        np.matmul(fourth, flat[j - 1], out=flat[j])
    nodes = np.tensordot(_EXPONENTIALS.reshape(NODES, FOURTHS, 4), powers, axes=((1, 2), (0, 2)))
    factor = nodes.transpose(1, 0, 2).reshape(n, NODES * noises)
    return np.asarray(factor @ factor.T)


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
    whole = block_diag(np.zeros((0, 0)), *A)
    intensity = block_diag(np.zeros((0, 0)), *Q)
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
