"""What the noise of gauges alone says of constants ν, on average, in a filter whose loads are freer than any load."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.estimation.linear import LinearModels

SETTLED = 1e-9
"""Change of a covariance from sample to sample, beside its standard deviations, below which it stays."""


@dataclass(frozen=True)
class _Step:
    """Of one step of a filter on noise: P (n, n) as claimed and Π (n, n) by noise alone of its prediction; gain K (n, m),
    weight S⁻¹ (m, m) of the innovations, zero where none is; variance R (m,) of the samples, zero where there is none."""

    P: np.ndarray
    covariance: np.ndarray
    gain: np.ndarray
    weight: np.ndarray
    noise: np.ndarray


def noise_alone(models: LinearModels, covariance: np.ndarray, noise: np.ndarray, every: int = 1) -> np.ndarray:
    """β (T, d), of which the sum is the mean of Σₜ εₜᵀ Sₜ⁻¹ eₜ over records that are the noise of gauges alone.

    ε are the slopes of innovations e in ν (`parallel_filters.advance`). Innovations that are as the filter claims are
    independent of the motion that is predicted, and so of ε: β = 0. Those of readings that are quieter are not: what a
    prediction has followed of the noise is taken back in the next steps, and ε goes with it. Under noise alone, with
    Φ = A(1 − KH) from prediction to prediction,

        Π⁺ = ΦΠΦᵀ + AKRKᵀAᵀ = E x̂x̂ᵀ,   Y = ΦᵀY⁺Φ + HᵀS⁻¹H
        β_k = ⟨KᵀAᵀY⁺ΦΠ − S⁻¹HΠ, D_k⟩ − ⟨Y⁺(ΦΠ(1 − KH)ᵀ + AKRKᵀ), A_k⟩

    Π forward in time and Y backward, in place of E x̂V_kᵀ of every k.
    models: one; covariance (n, n) of its states at t = 0; noise (T, m) variances of the samples, infinite where there is none;
    every: steps from sample to sample. βₜ is what comes of the noise up to step t, in that step and later.
    """
    A, H, A_nu = models.A[0], models.H[0], models.A_nu[0]
    steps = _forward(A, H, models.Q[0], covariance, noise, every)
    Y, one, found = [np.zeros_like(A)] * (len(steps) + 1), np.eye(len(A)), np.zeros((len(noise), models.nuisances))
    for t in reversed(range(len(steps))):
        now, after, later = steps[t], Y[t + 1], t + every
        if later < len(steps) and now is steps[later] and _settled(after, Y[later + 1], after):
            Y[t], found[t] = Y[later], found[later]
            continue
        kept = one - now.gain @ H
        loop = A @ kept
        seen = loop @ now.covariance
        on_rows = (A @ now.gain).T @ after @ seen - now.weight @ H @ now.covariance
        on_motion = after @ (seen @ kept.T + A @ (now.gain * now.noise) @ now.gain.T)
        found[t] = np.tensordot(models.D, on_rows)
        found[t, : len(A_nu)] -= np.tensordot(A_nu, on_motion)
        Y[t] = loop.T @ after @ loop + H.T @ now.weight @ H
    return found


def _forward(A: np.ndarray, H: np.ndarray, Q: np.ndarray, P: np.ndarray, noise: np.ndarray, every: int) -> list[_Step]:
    """Every step of the filter, from rest; where nothing changes any more it is the one a sample before."""
    steps: list[_Step] = []
    one, by_noise = np.eye(len(A)), np.zeros_like(A)
    for t, variance in enumerate(noise):
        P, by_noise = A @ P @ A.T + Q, A @ by_noise @ A.T
        there = np.isfinite(variance)
        R = np.where(there, variance, 0.0)
        before = steps[t - every] if t >= every else None
        if (
            before is not None
            and np.array_equal(R, before.noise)
            and _settled(P, before.P, P)
            and _settled(by_noise, before.covariance, P)
        ):
            now = before
        else:
            weight, seen = np.zeros((len(H), len(H))), H[there]
            weight[np.ix_(there, there)] = np.linalg.inv(seen @ P @ seen.T + np.diag(R[there]))
            now = _Step(P, by_noise, P @ H.T @ weight, weight, R)
        steps.append(now)
        left, fed = one - now.gain @ H, (now.gain * now.noise) @ now.gain.T
        P, by_noise = left @ now.P @ left.T + fed, left @ now.covariance @ left.T + fed
    return steps


def _settled(X: np.ndarray, before: np.ndarray, P: np.ndarray) -> bool:
    """Whether X (n, n) has moved by less than SETTLED of the standard deviations of P."""
    std = np.sqrt(np.abs(np.diag(P)))
    return bool(np.all(np.abs(X - before) <= SETTLED * np.outer(std, std)))
