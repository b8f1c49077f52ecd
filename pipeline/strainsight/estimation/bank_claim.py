"""The standard deviation that the bank will claim along a known motion, without any measurement, and what it is made of."""

from __future__ import annotations

import numpy as np

from strainsight.estimation.along import steps_along
from strainsight.estimation.claim import START, WHITE, Claim, by_sensors, by_source, starts
from strainsight.estimation.conditional import Nuisances, considers
from strainsight.estimation.model import FilterModel
from strainsight.estimation.settled import Settled, start_errors
from strainsight.estimation.update import corrected, gain, predict, standard_deviation, transposed


def bank_claim(
    model: FilterModel,
    trajectory: np.ndarray,
    u: np.ndarray,
    covariance: np.ndarray,
    nuisances: Nuisances,
    settled: Settled | None = None,
) -> Claim:
    """Standard deviation of x* = [s, p] that the bank will claim along a given motion, for B sets of sensors at once.

    Laplace's approximation of its posterior at the guess: that of constants c = [ν, p] beside a Kalman filter of s = [q, q̇, ζ]
    that takes them for known, in the gains K of which c has no part. Errors are w + V c, and innovations e = ε c + white noise:

        V⁻ = A V − B,   ε = D − H V⁻,   V = V⁻ + K ε,        B = [A_ν x + G_ν w, ∂x⁺/∂p],   D = [D x + E w₁ + o, ∂y/∂p]
        Λ⁻¹ = RᵀR = Λ₀⁻¹ + Σ εᵀS⁻¹ε,                         ĉ = Λ Σ εᵀS⁻¹e = R⁻¹z

    p is estimated with ν integrated out: σ_p² = Λ_pp. Where gains consider ν, P and V of the states are by those, of a filter
    beside it. Motion and loads follow p̂, and ν̂ as well where it is `learned`:

        σ_s² = diag(P + V C Vᵀ),     C = Λ where ν is learned,   C = [[1, Λ_νp], [Λ_pν, Λ_pp]] otherwise

    Arguments and parts as of `covariance_recursion`, settled as of `filter_bank`; p is not correlated with s at t = 0, ν has
    mean zero and variance one.
    Raises NumericalError where the covariance of an innovation is not positive definite.
    R and z by orthogonal factors: the sums would lose what confounded constants leave open under readings of small noise.
    Source: Friedland, IEEE Trans. Automatic Control 14 (1969); `parallel_filters.advance` and `Mixture` take the same steps.
    """
    source = nuisances.sources(model.model.size)
    covariance, V0 = start_errors(model, nuisances, covariance, settled)
    whole, parts, Q = starts(model, covariance)
    B, d, n = len(whole), len(source), model.parameter_states.start
    c, at_p = d + model.size - n, slice(d, None)
    prior = np.ones((B, c))
    prior[:, at_p] = np.diagonal(whole, axis1=1, axis2=2)[:, n:]
    P, V, root = whole[:, :n, :n], np.tile(V0, (B, 1, 1)), np.eye(c) / np.sqrt(prior[:, None])
    # parts of [w, z at c = 0]
    parts, Q = (np.pad(each[:, :n, :n], [(0, 0), (0, c), (0, c)]) for each in (parts, Q))
    A, kept = np.eye(n + c), np.eye(n + c)
    considered = _Considered(P, V, parts[:, :n, :n], d) if considers(model, nuisances) else None
    found = _Found(model.size, len(u) + 1, source, nuisances.learned, prior)
    found.after(0, P, V, root, parts)
    for k, step in enumerate(steps_along(model, trajectory, u, nuisances, B), start=1):
        A[:n, :n] = step.A[:n, :n]
        pushed = np.concatenate([step.pushed[:, :n], step.A[:n, n:].T])
        P, parts = predict(P, A[:n, :n], model.process[:n, :n]), predict(parts, A, Q)
        V = V @ A[:n, :n].T - pushed
        if considered is not None:
            considered.predict(A[:n, :n], model.process[:n, :n], Q[:, :n, :n], pushed)
        if step.sampled:
            H = step.H[..., :n]
            K, L = gain(P, H, step.variance, step.instant)
            read = np.broadcast_to(transposed(step.H[..., n:]), (B, c - d, H.shape[-2]))
            read = np.concatenate([np.broadcast_to(step.read, (B, *step.read.shape)), read], axis=1)
            slope = read - V @ transposed(H)
            whitened = np.linalg.solve(L, transposed(slope))
            turn, root = np.linalg.qr(np.concatenate([root, whitened], axis=1))
            on_samples = transposed(np.linalg.solve(transposed(L[:1]), turn[:1, c:]))
            kept[n:, n:] = turn[0, :c].T
            rows = np.pad(H[:1], [(0, 0), (0, 0), (0, c)])
            parts = kept @ parts @ kept.T
            parts = corrected(parts, np.concatenate([K[:1], on_samples], axis=1), rows, by_sensors(step.variance))
            P, V = corrected(P, K, H, step.variance), V + slope @ transposed(K)
            if considered is not None:
                considered.update(H, step.variance, read)
        if considered is None:
            found.after(k, P, V, root, parts)
        else:
            found.after(k, considered.P, considered.V, root, considered.beside(parts))
    return found.claim()


class _Considered:
    """The filter by gains that consider the first d of c constants: P (B, n, n), V (B, c, n), parts (3, n, n)."""

    def __init__(self, P: np.ndarray, V: np.ndarray, parts: np.ndarray, d: int):
        self.P, self.V, self.parts, self.d = P, V, parts, d

    def predict(self, A: np.ndarray, process: np.ndarray, Q: np.ndarray, pushed: np.ndarray) -> None:
        self.P, self.parts, self.V = predict(self.P, A, process), predict(self.parts, A, Q), self.V @ A.T - pushed

    def update(self, H: np.ndarray, R: np.ndarray, read: np.ndarray) -> None:
        """Schmidt's gain, as in `parallel_filters.advance`."""
        slope = read - self.V @ transposed(H)
        own = transposed(slope[:, : self.d])
        across = H @ self.P - own @ self.V[:, : self.d]
        S = H @ self.P @ transposed(H) + own @ transposed(own) + R[:, :, None] * np.eye(R.shape[1])
        K = transposed(np.linalg.solve(S, across))
        self.P, self.V = corrected(self.P, K, H, R), self.V + slope @ transposed(K)
        self.parts = corrected(self.parts, K[:1], H[:1], by_sensors(R))

    def beside(self, parts: np.ndarray) -> np.ndarray:
        """Its parts for those of w, with those of z. The bank adds what the two leave: that they share noise is not in its σ."""
        n = self.P.shape[-1]
        both = parts.copy()
        both[:, :n], both[:, :, :n] = 0.0, 0.0
        both[:, :n, :n] = self.parts
        return both


class _Found:
    """Variances of x* and their parts in the first set, instant by instant."""

    def __init__(self, size: int, instants: int, source: tuple[str, ...], learned: bool, prior: np.ndarray):
        sets, self.source, self.learned, self.prior = len(prior), source, learned, prior
        self.std = np.empty((instants, sets, size))
        self.white = np.empty((instants, len(WHITE), size))
        self.constant = np.empty((instants, prior.shape[1], size))

    def after(self, k: int, P: np.ndarray, V: np.ndarray, root: np.ndarray, parts: np.ndarray) -> None:
        """P (B, n, n), V (B, c, n), R (B, c, c), parts (3, n + c, n + c) at instant k."""
        n, d = P.shape[-1], len(self.source)
        inverse = np.linalg.inv(root)
        left = inverse @ transposed(inverse)
        C = left.copy()
        if not self.learned:
            C[:, :d, :d] = np.eye(d)
        own = np.diagonal(P, axis1=1, axis2=2) + np.sum((C @ V) * V, axis=1)
        self.std[k, :, :n] = np.sqrt(np.maximum(own, 0.0))
        self.std[k, :, n:] = standard_deviation(left)[:, d:]
        # what the estimate of c makes of z, and of c itself; ν that is not learned is taken to be nothing
        followed = inverse[0].copy()
        drawn = left[0] / np.sqrt(self.prior[0])
        if not self.learned:
            followed[:d], drawn[:d] = 0.0, np.eye(len(drawn))[:d]
        T = np.block([[np.eye(n), -V[0].T @ followed], [np.zeros((len(drawn) - d, n)), inverse[0, d:]]])
        self.white[k] = np.maximum(np.sum((T @ parts) * T, axis=-1), 0.0)
        self.constant[k] = np.concatenate([V[0].T @ drawn, left[0, d:] / np.sqrt(self.prior[0])]).T

    def claim(self) -> Claim:
        d = len(self.source)
        budget = {name: self.white[:, i] for i, name in enumerate(WHITE)}
        budget[START] = budget[START] + np.sum(self.constant[:, d:] ** 2, axis=1)
        return Claim(self.std, budget | by_source(self.source, self.constant[:, :d]))
