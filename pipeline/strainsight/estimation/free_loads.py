"""Filters with free loads, by which parameters are weighted. An unknown load is modelled as a random walk, which no real load
is. The likelihood of the configured walk depends on the size of the readings, and biases parameters on which that size
depends. Therefore the walk is free enough to follow a line in the spectrum. What the gauge noise alone adds to the likelihood
on average is subtracted: of the parameters by a filter of the loads alone (`advance_free_loads`), of ν by `noise_alone`.
Source: Francke, Koopman and de Vos, J. Time Series Analysis 31 (2010)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strainsight.estimation.conditional import linear_models, none_considered, tune_frequencies
from strainsight.estimation.parallel_filters import Data, Filters, LinearModels, Passage, advance, build_filters
from strainsight.estimation.record import GridRecord, start_filters

SLIGHT = 1e-3
"""Change of ln R for finite differences."""


@dataclass(frozen=True)
class FreeLoadFilters:
    """Filters with free loads at the grid points, by which the points are weighted. alone: model of the loads alone, without
    ν and channel offsets; louder, quieter: its filters with a noise SLIGHT larger and smaller than that of the gauges."""

    models: LinearModels
    filters: Filters
    alone: LinearModels
    louder: Filters
    quieter: Filters


def build_free_load_filters(record: GridRecord, load_models: LinearModels, point: np.ndarray) -> FreeLoadFilters:
    """Filters at points (B, k) before the first step of a record; load_models: models with the configured loads."""
    (free, alone), (mean, covariance) = record.free, record.start
    offsets, loads = len(record.biased), np.zeros(len(mean), dtype=bool)
    states, loads[free.input_states] = free.parameter_states.start, True
    Q = np.pad(free.process[:states, :states], (0, offsets))
    models = replace(load_models, Q=np.broadcast_to(Q, load_models.Q.shape))
    alone = tune_frequencies(alone, record.considered, point)[0]
    of_loads = linear_models(alone, point, none_considered(free), record.biased)
    start = np.zeros((len(point), len(mean))), np.where(np.outer(loads, loads), covariance, 0.0)
    return FreeLoadFilters(
        models,
        build_filters(models, *start_filters(free, models, mean, covariance, None)),
        of_loads,
        *(build_filters(of_loads, *start, np.zeros((len(point), 0, len(mean)))) for _ in range(2)),
    )


def advance_free_loads(free_load: FreeLoadFilters, data: Data, less: np.ndarray, keep: bool) -> Passage:
    """Advance the filters, and return their passage with the fit by which the points are weighted. Arguments as in `advance`.
    For noise v alone, with S the covariance of all readings of the loads alone, E ln p(v) = −½ ln|S| − ½ tr(R S⁻¹) up to a
    constant. tr(R S⁻¹) is the slope of ln|S| in ln R, from zero readings at R e^{±δ}."""
    passage = advance(free_load.models, free_load.filters, data, keep, states=False, less=less)
    loads = np.zeros((len(data.known_end), free_load.alone.F.shape[-1]))
    quiet = replace(data, known=0 * data.known, known_end=loads, samples=np.where(np.isnan(data.samples), np.nan, 0.0))

    def alone(filters: Filters, factor: float) -> np.ndarray:
        return advance(free_load.alone, filters, replace(quiet, noise=factor * data.noise), False).fit

    louder, quieter = alone(free_load.louder, np.exp(SLIGHT)), alone(free_load.quieter, np.exp(-SLIGHT))
    return replace(passage, fit=passage.fit - 0.5 * (louder + quieter) - (louder - quieter) / (2 * SLIGHT))


SETTLED = 1e-9
"""Relative change of a covariance per sample, in standard deviations, below which it is steady."""


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


def noise_alone(models: LinearModels, covariance: np.ndarray, noise: np.ndarray, every: int = 1) -> np.ndarray:
    """β (T, d), whose sum is the mean of Σₜ εₜᵀ Sₜ⁻¹ eₜ over records of gauge noise alone.

    ε are the slopes of the innovations e in ν (`parallel_filters.advance`). β = 0 if the innovations are as the filter
    claims, hence independent of ε; quieter readings have other innovations. For noise alone, with Φ = A(1 − KH) from
    prediction to prediction,

        Π⁺ = ΦΠΦᵀ + AKRKᵀAᵀ = E x̂x̂ᵀ,   Y = ΦᵀY⁺Φ + HᵀS⁻¹H
        β_k = ⟨KᵀAᵀY⁺ΦΠ − S⁻¹HΠ, D_k⟩ − ⟨Y⁺(ΦΠ(1 − KH)ᵀ + AKRKᵀ), A_k⟩

    Π runs forward and Y backward in time, in place of E x̂V_kᵀ for each k. models: one model; covariance (n, n) of its states
    at t = 0; noise (T, m): variances of the samples, infinite if missing; every: steps per sample. βₜ contains the effect of
    the noise up to step t in this and later steps."""
    A, H, A_nu = models.A[0], models.H[0], models.A_nu[0]
    steps = _run_forward(A, H, models.Q[0], covariance, noise, every)
    Y, one, beta = (
        [np.zeros_like(A)] * (len(steps) + 1),
        np.eye(len(A)),
        np.zeros((len(noise), models.considered_count)),
    )
    for t in reversed(range(len(steps))):
        now, after, later = steps[t], Y[t + 1], t + every
        if later < len(steps) and now is steps[later] and _is_steady(after, Y[later + 1], after):
            Y[t], beta[t] = Y[later], beta[later]
            continue
        left = one - now.gain @ H
        loop = A @ left
        propagated = loop @ now.covariance
        on_rows = (A @ now.gain).T @ after @ propagated - now.weight @ H @ now.covariance
        on_motion = after @ (propagated @ left.T + A @ (now.gain * now.noise) @ now.gain.T)
        beta[t] = np.tensordot(models.D, on_rows)
        beta[t, : len(A_nu)] -= np.tensordot(A_nu, on_motion)
        Y[t] = loop.T @ after @ loop + H.T @ now.weight @ H
    return beta


def _run_forward(
    A: np.ndarray, H: np.ndarray, Q: np.ndarray, P: np.ndarray, noise: np.ndarray, every: int
) -> list[_NoiseStep]:
    """All steps of the filter from rest; a steady step repeats the one a sample before."""
    steps: list[_NoiseStep] = []
    one, by_noise = np.eye(len(A)), np.zeros_like(A)
    for t, variance in enumerate(noise):
        P, by_noise = A @ P @ A.T + Q, A @ by_noise @ A.T
        measured = np.isfinite(variance)
        R = np.where(measured, variance, 0.0)
        before = steps[t - every] if t >= every else None
        if (
            before is not None
            and np.array_equal(R, before.noise)
            and _is_steady(P, before.P, P)
            and _is_steady(by_noise, before.covariance, P)
        ):
            now = before
        else:
            weight, rows = np.zeros((len(H), len(H))), H[measured]
            weight[np.ix_(measured, measured)] = np.linalg.inv(rows @ P @ rows.T + np.diag(R[measured]))
            now = _NoiseStep(P, by_noise, P @ H.T @ weight, weight, R)
        steps.append(now)
        left, fed = one - now.gain @ H, (now.gain * now.noise) @ now.gain.T
        P, by_noise = left @ now.P @ left.T + fed, left @ now.covariance @ left.T + fed
    return steps


def _is_steady(X: np.ndarray, before: np.ndarray, P: np.ndarray) -> bool:
    """Whether X (n, n) changed by less than SETTLED of the standard deviations of P."""
    std = np.sqrt(np.abs(np.diag(P)))
    return bool(np.all(np.abs(X - before) <= SETTLED * np.outer(std, std)))
