"""Prediction and update of a covariance: Joseph form and square-root form."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy.linalg.lapack import dpstrf

from strainsight.errors import NumericalError

Form = Literal["joseph", "square_root"]


def predict(P: np.ndarray, A: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """P⁻ = A P Aᵀ + Q  (1.57), symmetrised; P, A (b, n, n), Q the covariance added in the step."""
    return symmetric(A @ P @ transpose(A) + Q)


def whitened_gain(
    P: np.ndarray, H: np.ndarray, R: np.ndarray, instant: float = np.nan
) -> tuple[np.ndarray, np.ndarray]:
    """G = PHᵀL⁻ᵀ and the Cholesky factor L of S = HPHᵀ + R = LLᵀ: the gain is K = G L⁻¹ (1.58). P (b, n, n); H (m, n) or (b,
    m, n); R (b, m) variances, or (b, m, m). Returns G (b, n, m), L (b, m, m). Raises NumericalError, with the instant [s],
    where S is not positive definite."""
    HP = H @ P
    S = symmetric(HP @ transpose(H))
    if R.ndim == 3:
        S += R
    else:
        diagonal = range(R.shape[-1])
        S[..., diagonal, diagonal] += R
    try:
        L = np.linalg.cholesky(S)
    except np.linalg.LinAlgError as error:
        raise _indefinite(instant) from error
    return transpose(np.linalg.solve(L, HP)), L


def gain(P: np.ndarray, H: np.ndarray, R: np.ndarray, instant: float = np.nan) -> tuple[np.ndarray, np.ndarray]:
    """Kalman gain K = PHᵀS⁻¹ (1.58) and the Cholesky factor L of S = HPHᵀ + R = LLᵀ; as `whitened_gain`."""
    G, L = whitened_gain(P, H, R, instant)
    return transpose(np.linalg.solve(transpose(L), transpose(G))), L


def schmidt_gain(P: np.ndarray, H: np.ndarray, R: np.ndarray, V: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Schmidt's gain, which considers constants ν of unit variance: K = (P Hᵀ − Vᵀεᵀ) S⁻¹, S = H P Hᵀ + ε εᵀ + R. P (b, n, n)
    excludes the effect of ν; H (m, n) or (b, m, n); R (b, m) or (m,) variances. V (b, d, n): error of the states per unit ν,
    slope ε (b, m, d) of the innovation. Returns K (b, n, m). Source: Schmidt, Advances in Control Systems 3 (1966)."""
    S = H @ P @ transpose(H) + slope @ transpose(slope) + R[..., None] * np.eye(R.shape[-1])
    return transpose(np.linalg.solve(S, H @ P - slope @ V))


def joseph(P: np.ndarray, H: np.ndarray, R: np.ndarray, instant: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """P⁺ = (I − KH)P(I − KH)ᵀ + KRKᵀ (Joseph's form of 1.60), symmetrised; with G and L of `whitened_gain`.

    Source: Bucy and Joseph, Filtering for Stochastic Processes (1968)."""
    G, L = whitened_gain(P, H, R, instant)
    K = transpose(np.linalg.solve(transpose(L), transpose(G)))
    return joseph_update(P, K, H, R), G, L


def joseph_update(P: np.ndarray, K: np.ndarray, H: np.ndarray, R: np.ndarray) -> np.ndarray:
    """(I − KH)P(I − KH)ᵀ + KRKᵀ, the covariance after an update by any gain K (b, n, m), symmetrised; R as of `whitened_gain`."""
    left = np.eye(P.shape[-1]) - K @ H
    KR = K @ R if R.ndim == 3 else K * R[..., None, :]
    return symmetric(left @ P @ transpose(left) + KR @ transpose(K))


def predict_factor(F: np.ndarray, A: np.ndarray, Q_factor: np.ndarray) -> np.ndarray:
    """Lower triangular F⁻ with F⁻F⁻ᵀ = A F Fᵀ Aᵀ + Q, from the QR factors of [A F, Q½]ᵀ; Q_factor (b or 1, n, any)."""
    return _lower(join_columns(A @ F, Q_factor))


def join_columns(*factors: np.ndarray) -> np.ndarray:
    """Columns of all factors (b or 1, n, any) in one."""
    b = max(len(X) for X in factors)
    whole = np.empty((b, factors[0].shape[1], sum(X.shape[2] for X in factors)))
    at = 0
    for X in factors:
        whole[:, :, at : at + X.shape[2]] = X
        at += X.shape[2]
    return whole


def innovation_factor(
    F: np.ndarray, A: np.ndarray, Q_factor: np.ndarray, H: np.ndarray, R: np.ndarray, instant: float
) -> np.ndarray:
    """L (b, m, m) of HP⁻Hᵀ + R = LLᵀ, P⁻ of `predict_factor`, by the QR factors of [R½, H A F, H Q½]ᵀ; R (b, m)."""
    L = _lower(join_columns(np.sqrt(R)[:, :, None] * np.eye(R.shape[-1]), H @ A @ F, H @ Q_factor))
    diagonal = np.diagonal(L, axis1=-2, axis2=-1)
    if not np.all(diagonal != 0):
        raise _indefinite(instant)
    return L * np.where(diagonal < 0, -1.0, 1.0)[:, None, :]


def update_factor(F: np.ndarray, H: np.ndarray, R: np.ndarray, instant: float) -> tuple[np.ndarray, ...]:
    """The array form of the update: the orthogonal Θ that makes [R½  H F] Θ = [L  0] makes [0  F] Θ = [G  F⁺].

    Θ is that of the QR factors of [R½  H F]ᵀ, m reflections: F⁺ needs to be no triangle.
    F (b, n, r) with P = F Fᵀ; H (m, n) or (b, m, n); R as of `whitened_gain`. Returns F⁺ and G, L as of that.
    Orthogonal steps alone: F has twice the digits of P, and P = F Fᵀ cannot lose its sign.
    Source: Kailath, Sayed and Hassibi, Linear Estimation (2000), section 12.3."""
    b, m = len(F), R.shape[-1]
    array = np.zeros((b, m, m + F.shape[-1]))
    if R.ndim == 3:
        array[:, :, :m] = np.linalg.cholesky(R)
    else:
        array[:, range(m), range(m)] = np.sqrt(R)
    array[:, :, m:] = H @ F
    theta, upper = np.linalg.qr(transpose(array), mode="complete")
    after = F @ theta[:, m:]
    sign = np.where(np.diagonal(upper, axis1=-2, axis2=-1) < 0, -1.0, 1.0)[:, None, :]
    L, G = transpose(upper[:, :m]) * sign, after[:, :, :m] * sign
    if not np.all(np.diagonal(L, axis1=-2, axis2=-1) > 0):
        raise _indefinite(instant)
    return after[:, :, m:], G, L


def covariance_factor(P: np.ndarray) -> np.ndarray:
    """F (n, rank) with F Fᵀ = P, P (n, n) positive semidefinite; scaled to diag P = 1 first, so units do not matter."""
    std = np.sqrt(np.diag(P))
    scale = np.where(std > 0, std, 1.0)
    values, vectors = np.linalg.eigh(P / np.outer(scale, scale))
    positive = values > len(P) * np.finfo(float).eps * max(values.max(initial=0.0), 0.0)
    return scale[:, None] * vectors[:, positive] * np.sqrt(values[positive])


def pivoted_factors(P: np.ndarray) -> np.ndarray:
    """As `square_factor`, by pivoted Cholesky: a tenth of the work, and less accurate for nearly dependent states."""
    factors = np.zeros_like(P)
    if not np.isfinite(P).all():
        raise np.linalg.LinAlgError("the process noise contains NaN or infinite values")
    for F, covariance in zip(factors, P, strict=True):
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        moving = np.flatnonzero(std)
        scaled = covariance[np.ix_(moving, moving)] / np.outer(std[moving], std[moving])
        lower, order, rank, _ = dpstrf(scaled, lower=1, tol=len(covariance) * np.finfo(float).eps)
        F[moving[order - 1], :rank] = std[moving[order - 1], None] * np.tril(lower)[:, :rank]
    return factors


def square_factor(P: np.ndarray) -> np.ndarray:
    """`covariance_factor` of each P (b, n, n), padded with zero columns to (b, n, n)."""
    factors = np.zeros_like(P)
    for factor, covariance in zip(factors, P, strict=True):
        columns = covariance_factor(covariance)
        factor[:, : columns.shape[1]] = columns
    return factors


def whiten(L: np.ndarray, innovation: np.ndarray) -> np.ndarray:
    """L⁻¹ν (B, m) for L (b, m, m), b = 1 or B."""
    if len(L) == 1:
        return np.linalg.solve(L[0], innovation.T).T
    return np.linalg.solve(L, innovation[..., None])[..., 0]


def standard_deviation(P: np.ndarray) -> np.ndarray:
    """√diag P (..., n); rounding below zero counts as zero."""
    return np.sqrt(np.maximum(np.diagonal(P, axis1=-2, axis2=-1), 0.0))


def output_std(C: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Standard deviation of C x*, √diag(C P Cᵀ); C (m, n*) or (b, m, n*), P (..., n*, n*). Returns (..., m)."""
    return np.sqrt(np.maximum(np.sum((C @ P) * C, axis=-1), 0.0))


def apply(C: np.ndarray, x: np.ndarray) -> np.ndarray:
    """C x for every run: C (m, n) or (b, m, n), x (B, n). Returns (B, m)."""
    if C.ndim == 2 or len(C) == 1:
        return x @ C.reshape(C.shape[-2:]).T
    return (C @ x[..., None])[..., 0]


def transpose(X: np.ndarray) -> np.ndarray:
    """X with its last two axes exchanged."""
    return X.swapaxes(-1, -2)


def symmetric(X: np.ndarray) -> np.ndarray:
    """(X + Xᵀ)/2."""
    return 0.5 * (X + transpose(X))


def _lower(X: np.ndarray) -> np.ndarray:
    return transpose(np.asarray(np.linalg.qr(transpose(X), mode="r")))


def _indefinite(instant: float) -> NumericalError:
    return NumericalError(
        f"the innovation covariance is not positive definite at t = {instant:g} s",
        remedy="remove gauges that measure the same, or increase the noise of each gauge above 1e-8 times the largest "
        "reading that the unknowns can cause",
    )


@dataclass(frozen=True)
class Transition:
    """P → A (P + before) Aᵀ + process: A (b, n, n), covariances (n, n) or (b, n, n), before None for none."""

    A: np.ndarray
    process: np.ndarray
    before: np.ndarray | None = None


@dataclass(frozen=True)
class Joseph:
    """P (b, n, n) of b runs, updated by Joseph's form."""

    covariance: np.ndarray

    def predicted(self, step: Transition) -> Joseph:
        """Covariance after a step."""
        P = self.covariance if step.before is None else self.covariance + step.before
        return Joseph(predict(P, step.A, step.process))

    def expected(self, step: Transition, H: np.ndarray, R: np.ndarray, instant: float) -> np.ndarray:
        """Factor L (b, m, m) of the innovation covariance after a step."""
        return whitened_gain(self.predicted(step).covariance, H, R, instant)[1]

    def updated(self, H: np.ndarray, R: np.ndarray, instant: float) -> tuple[Joseph, np.ndarray, np.ndarray]:
        """Covariance after the measurement, with G (b, n, m) and L (b, m, m) of `whitened_gain`."""
        P, G, L = joseph(self.covariance, H, R, instant)
        return Joseph(P), G, L

    def reset(self, runs: np.ndarray, P: np.ndarray) -> Joseph:
        """With the covariances P (b, n, n) in the selected runs (b,)."""
        return Joseph(np.where(runs[:, None, None], P, self.covariance))


@dataclass(frozen=True)
class SquareRoot:
    """F with P = F Fᵀ, updated by orthogonal transformations, with the methods of `Joseph`; factors: of the last noise, to
    factorise constant noise once."""

    factor: np.ndarray
    factors: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    @property
    def covariance(self) -> np.ndarray:
        return self.factor @ transpose(self.factor)

    def predicted(self, step: Transition) -> SquareRoot:
        F = predict_factor(self._at_start(step), step.A, self._factor("process", step.process))
        return SquareRoot(F, self.factors)

    def expected(self, step: Transition, H: np.ndarray, R: np.ndarray, instant: float) -> np.ndarray:
        return innovation_factor(self._at_start(step), step.A, self._factor("process", step.process), H, R, instant)

    def updated(self, H: np.ndarray, R: np.ndarray, instant: float) -> tuple[SquareRoot, np.ndarray, np.ndarray]:
        F, G, L = update_factor(self.factor, H, R, instant)
        return SquareRoot(F, self.factors), G, L

    def reset(self, runs: np.ndarray, P: np.ndarray) -> SquareRoot:
        return SquareRoot(np.where(runs[:, None, None], square_factor(P), self.factor), self.factors)

    def _at_start(self, step: Transition) -> np.ndarray:
        """A factor of P + before."""
        return self.factor if step.before is None else join_columns(self.factor, self._factor("before", step.before))

    def _factor(self, which: str, Q: np.ndarray) -> np.ndarray:
        if which not in self.factors or self.factors[which][0] is not Q:
            # what is constant is factored once, what is found on the way in every step
            factor = square_factor(Q[None]) if Q.ndim == 2 else pivoted_factors(Q)
            # noise on few states has few columns, and every column costs an orthogonal step
            self.factors[which] = (Q, factor[:, :, np.any(factor, axis=(0, 1))])
        return self.factors[which][1]


Belief = Joseph | SquareRoot


def belief_of(form: Form, P: np.ndarray) -> Belief:
    """The covariance P (b, n, n) in standard (Joseph) or square-root form."""
    return Joseph(P) if form == "joseph" else SquareRoot(square_factor(P))
