"""Bias of the considered constants by gauge noise in filters with free loads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.estimation.parallel_filters import LinearModels

SETTLED, SOONEST, LEAST = 10.0, 1e-2, 1e-2
"""A covariance is steady if it changes per sample by less than SETTLED/T and SOONEST, in standard deviations. Each of them is at
least LEAST of the largest of its kind, because motion that no load excites is rounding."""


@dataclass(frozen=True)
class NoiseBias:
    """β (T, d) of `noise_alone`: rows (u, d), of which step t has row[step[t]]; steady steps have the same."""

    row: np.ndarray
    step: np.ndarray


@dataclass(frozen=True)
class _NoiseStep:
    """One step of a filter on pure noise. P (n, n): predicted covariance as claimed; covariance Π (n, n): that by noise
    alone; gain K (n, m); weight S⁻¹ (m, m) of the innovations, zero for missing samples; noise R (m,), zero for missing
    samples."""

    P: np.ndarray
    covariance: np.ndarray
    gain: np.ndarray
    weight: np.ndarray
    noise: np.ndarray


def noise_alone(models: LinearModels, covariance: np.ndarray, noise: np.ndarray, every: int = 1) -> NoiseBias:
    """β (T, d), whose sum is the mean of Σₜ εₜᵀ Sₜ⁻¹ eₜ over records of gauge noise alone.

    ε are the slopes of the innovations e in ν (`parallel_filters.advance`). β = 0 if the innovations are as the filter
    claims, hence independent of ε; quieter readings have other innovations. For noise alone, with Φ = A(1 − KH) from
    prediction to prediction,

        Π⁺ = ΦΠΦᵀ + AKRKᵀAᵀ = E x̂x̂ᵀ,   Y = ΦᵀY⁺Φ + HᵀS⁻¹H
        β_k = ⟨KᵀAᵀY⁺ΦΠ − S⁻¹HΠ, D_k⟩ − ⟨Y⁺(ΦΠ(1 − KH)ᵀ + AKRKᵀ), A_k⟩

    Π runs forward and Y backward in time, in place of E x̂V_kᵀ for each k. models: one model; covariance (n, n) of its states
    at t = 0; noise (T, m): variances of the samples, infinite if missing; every: steps per sample. βₜ contains the effect of
    the noise up to step t in this and later steps."""
    if not models.considered_count:
        return NoiseBias(np.zeros((1, 0)), np.zeros(len(noise), dtype=int))
    A, H, A_nu = models.A[0], models.H[0], models.A_nu[0]
    pairs = models.motion.pairs.shape[-1]
    kinds = (slice(0, pairs), slice(pairs, 2 * pairs))
    settled = min(SOONEST, SETTLED / len(noise))
    steps = _run_forward(A, H, models.Q[0], covariance, noise, every, kinds, settled)
    Y, one = [np.zeros_like(A)] * (len(steps) + 1), np.eye(len(A))
    rows: list[np.ndarray] = []
    row = np.zeros(len(steps), dtype=int)
    for t in reversed(range(len(steps))):
        now, after, later = steps[t], Y[t + 1], t + every
        if later < len(steps) and now is steps[later] and _is_steady_adjoint(after, Y[later + 1], now.P, settled):
            Y[t], row[t] = Y[later], row[later]
            continue
        left = one - now.gain @ H
        loop = A @ left
        propagated = loop @ now.covariance
        on_rows = (A @ now.gain).T @ after @ propagated - now.weight @ H @ now.covariance
        on_motion = after @ (propagated @ left.T + A @ (now.gain * now.noise) @ now.gain.T)
        beta = np.tensordot(models.D, on_rows)
        beta[: len(A_nu)] -= np.tensordot(A_nu, on_motion)
        row[t] = len(rows)
        rows.append(beta)
        Y[t] = loop.T @ after @ loop + H.T @ now.weight @ H
    return NoiseBias(np.array(rows), row)


def _run_forward(
    A: np.ndarray,
    H: np.ndarray,
    Q: np.ndarray,
    P: np.ndarray,
    noise: np.ndarray,
    every: int,
    kinds: tuple[slice, ...],
    settled: float,
) -> list[_NoiseStep]:
    """All steps of the filter from rest; a steady step repeats the one a sample before."""
    steps: list[_NoiseStep] = []
    one, by_noise = np.eye(len(A)), np.zeros_like(A)
    for t, variance in enumerate(noise):
        measured = np.isfinite(variance)
        R = np.where(measured, variance, 0.0)
        before = steps[t - every] if t >= every else None
        same = before is not None and np.array_equal(R, before.noise)
        if before is not None and same and t > every and steps[-1] is steps[-1 - every]:
            steps.append(before)
            continue
        if steps:
            last = steps[-1]
            left, fed = one - last.gain @ H, (last.gain * last.noise) @ last.gain.T
            P, by_noise = left @ last.P @ left.T + fed, left @ last.covariance @ left.T + fed
        P, by_noise = A @ P @ A.T + Q, A @ by_noise @ A.T
        if before is not None and same:
            std = _least_std(P, kinds)
            if _is_steady(P, before.P, std, settled) and _is_steady(by_noise, before.covariance, std, settled):
                steps.append(before)
                continue
        weight, rows = np.zeros((len(H), len(H))), H[measured]
        weight[np.ix_(measured, measured)] = np.linalg.inv(rows @ P @ rows.T + np.diag(R[measured]))
        steps.append(_NoiseStep(P, by_noise, P @ H.T @ weight, weight, R))
    return steps


def _least_std(P: np.ndarray, kinds: tuple[slice, ...]) -> np.ndarray:
    """Standard deviations (n,) of P, at least LEAST of the largest among states of the same kind."""
    std = np.sqrt(np.abs(np.diag(P)))
    for kind in kinds:
        std[kind] = np.maximum(std[kind], LEAST * np.max(std[kind], initial=0.0))
    return std


def _is_steady(X: np.ndarray, before: np.ndarray, std: np.ndarray, settled: float) -> bool:
    """Whether X (n, n) changed by less than `settled` in standard deviations (n,)."""
    return bool(np.all(np.abs(X - before) <= settled * np.outer(std, std)))


def _is_steady_adjoint(Y: np.ndarray, before: np.ndarray, P: np.ndarray, settled: float) -> bool:
    """Whether Y (n, n), of the inverse unit of P, changed by less than `settled` of its largest entry times that of P."""
    if Y is before:
        return True
    std = np.sqrt(np.abs(np.diag(P)))
    scale = np.outer(std, std)
    return bool(np.all(np.abs(Y - before) * scale <= settled * np.max(np.abs(Y) * scale)))
