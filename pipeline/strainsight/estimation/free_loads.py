"""Filters with free loads, by which parameters are weighted. An unknown load is modelled as a random walk, which no real load
is. The likelihood of the configured walk depends on the size of the readings, and biases parameters on which that size
depends. Therefore the walk is free enough to follow a line in the spectrum. What the gauge noise alone adds to the likelihood
on average is subtracted at each point: of the parameters by a filter of the loads alone (`advance_free_loads`), of ν by
`noise_alone`.
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
    ν and channel offsets; louder, quieter: its filters with a noise SLIGHT larger and smaller than that of the gauges; bias:
    `NoiseBias` of each point (B,)."""

    models: LinearModels
    filters: Filters
    alone: LinearModels
    louder: Filters
    quieter: Filters
    bias: np.ndarray


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
    noise = np.where(np.isnan(record.data.samples), np.inf, record.data.noise)
    bias = np.empty(len(point), dtype=object)
    for b in range(len(point)):
        bias[b] = noise_alone(models.of(slice(b, b + 1)), covariance, noise, free.every)
    return FreeLoadFilters(
        models,
        build_filters(models, *start_filters(free, models, mean, covariance, None)),
        of_loads,
        louder=build_filters(of_loads, *start, np.zeros((len(point), 0, len(mean)))),
        quieter=build_filters(of_loads, *start, np.zeros((len(point), 0, len(mean)))),
        bias=bias,
    )


def advance_free_loads(free_load: FreeLoadFilters, data: Data, span: slice, keep: bool) -> Passage:
    """Advance the filters, and return their passage with the fit by which the points are weighted. span: steps of the record;
    other arguments as in `advance`.

    For noise v alone, with S the covariance of all readings of the loads alone, E ln p(v) = −½ ln|S| − ½ tr(R S⁻¹) up to a
    constant. tr(R S⁻¹) is the slope of ln|S| in ln R, from zero readings at R e^{±δ}."""
    less = np.stack([bias.row[bias.step[span]] for bias in free_load.bias])
    passage = advance(free_load.models, free_load.filters, data, keep, states=False, less=less)
    loads = np.zeros((len(data.known_end), free_load.alone.F.shape[-1]))
    quiet = replace(data, known=0 * data.known, known_end=loads, samples=np.where(np.isnan(data.samples), np.nan, 0.0))

    def alone(filters: Filters, factor: float) -> np.ndarray:
        return advance(free_load.alone, filters, replace(quiet, noise=factor * data.noise), False).fit

    louder, quieter = alone(free_load.louder, np.exp(SLIGHT)), alone(free_load.quieter, np.exp(-SLIGHT))
    return replace(passage, fit=passage.fit - 0.5 * (louder + quieter) - (louder - quieter) / (2 * SLIGHT))


SETTLED, LEAST = 1e-9, 1e-6
"""Relative change of a covariance per sample, in standard deviations, below which it is steady; and the least of these, as a
share of the largest: motion that no load excites is rounding."""


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
    steps = _run_forward(A, H, models.Q[0], covariance, noise, every)
    Y, one = [np.zeros_like(A)] * (len(steps) + 1), np.eye(len(A))
    rows: list[np.ndarray] = []
    row = np.zeros(len(steps), dtype=int)
    for t in reversed(range(len(steps))):
        now, after, later = steps[t], Y[t + 1], t + every
        if later < len(steps) and now is steps[later] and _is_steady(after, Y[later + 1], now.P, inverse=True):
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
    A: np.ndarray, H: np.ndarray, Q: np.ndarray, P: np.ndarray, noise: np.ndarray, every: int
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
        if before is not None and same and _is_steady(P, before.P, P) and _is_steady(by_noise, before.covariance, P):
            steps.append(before)
            continue
        weight, rows = np.zeros((len(H), len(H))), H[measured]
        weight[np.ix_(measured, measured)] = np.linalg.inv(rows @ P @ rows.T + np.diag(R[measured]))
        steps.append(_NoiseStep(P, by_noise, P @ H.T @ weight, weight, R))
    return steps


def _is_steady(X: np.ndarray, before: np.ndarray, P: np.ndarray, inverse: bool = False) -> bool:
    """Whether X (n, n) changed by less than SETTLED of the standard deviations of P; inverse: X is of the inverse units, and
    SETTLED a share of its largest entry in these standard deviations."""
    if X is before:
        return True
    std = np.sqrt(np.abs(np.diag(P)))
    if inverse:
        return bool(np.all(np.abs(X - before) * np.outer(std, std) <= SETTLED * np.max(np.abs(X) * np.outer(std, std))))
    std = np.maximum(std, LEAST * std.max())
    return bool(np.all(np.abs(X - before) <= SETTLED * np.outer(std, std)))
