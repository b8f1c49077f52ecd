"""Likelihood by which parameters are weighed jointly with unknown loads: of loads that are free, less its mean over noise alone.

An unknown load is modelled as a random walk, and a real one is none. The likelihood of the walk as stated depends on the size of
the readings, and speaks for parameters at which they are larger or smaller. So the walk is free enough to follow a line in the
spectrum, and what noise of the gauges alone adds to the likelihood on average is taken off: of the parameters by a filter of
loads alone (`judged`), of ν by `noise_alone`. Source: Francke, Koopman and de Vos, J. Time Series Analysis 31 (2010).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.estimation.conditional import linear_models, no_nuisances, tuned
from strainsight.estimation.parallel_filters import (
    Data,
    Filters,
    LinearModels,
    Passage,
    advance,
    filters_of,
    joined,
    joined_models,
)
from strainsight.estimation.record import BankRecord, beginning

SLIGHT = 1e-3
"""Change of ln R for slopes in it."""


@dataclass(frozen=True)
class Judge:
    """Filters of free loads at the points of a bank; and those of what these loads alone read, under noises that are SLIGHT more
    and less than the gauges'. `alone` knows neither ν nor offsets of channels."""

    models: LinearModels
    filters: Filters
    alone: LinearModels
    louder: Filters
    quieter: Filters


def judge_of(record: BankRecord, stated: LinearModels, point: np.ndarray) -> Judge:
    """At points (B, k) before any step of a record, where the filters of loads as stated have the models `stated`."""
    (free, alone), (mean, covariance) = record.free, record.start
    offsets, loads = len(record.biased), np.zeros(len(mean), dtype=bool)
    states, loads[free.input_states] = free.parameter_states.start, True
    Q = np.pad(free.process[:states, :states], (0, offsets))
    models = replace(stated, Q=np.broadcast_to(Q, stated.Q.shape))
    alone = tuned(alone, record.nuisances, point)[0]
    of_loads = linear_models(alone, point, no_nuisances(free), record.biased)
    start = np.zeros((len(point), len(mean))), np.where(np.outer(loads, loads), covariance, 0.0)
    return Judge(
        models,
        filters_of(models, *beginning(free, models, mean, covariance, None)),
        of_loads,
        *(filters_of(of_loads, *start, np.zeros((len(point), 0, len(mean)))) for _ in range(2)),
    )


def joined_judges(parts: Sequence[Judge]) -> Judge:
    """Judges of parts of a bank as one."""
    return Judge(
        joined_models([part.models for part in parts]),
        joined([part.filters for part in parts]),
        joined_models([part.alone for part in parts]),
        joined([part.louder for part in parts]),
        joined([part.quieter for part in parts]),
    )


def judged(judge: Judge, data: Data, less: np.ndarray, keep: bool) -> Passage:
    """Take it some steps on: what its filters found, with the fit by which points are weighed. Arguments as of `advance`.

    Of noise v alone, with S the covariance of all that loads alone read, E ln p(v) = −½ ln|S| − ½ tr(R S⁻¹) but for a constant,
    and tr(R S⁻¹) is the slope of ln|S| in ln R: of readings of zero at R e^{±δ}.
    """
    passage = advance(judge.models, judge.filters, data, keep, states=False, less=less)
    loads = np.zeros((len(data.known_end), judge.alone.F.shape[-1]))
    quiet = replace(data, known=0 * data.known, known_end=loads, samples=np.where(np.isnan(data.samples), np.nan, 0.0))

    def alone(filters: Filters, factor: float) -> np.ndarray:
        return advance(judge.alone, filters, replace(quiet, noise=factor * data.noise), False).fit

    louder, quieter = alone(judge.louder, np.exp(SLIGHT)), alone(judge.quieter, np.exp(-SLIGHT))
    return replace(passage, fit=passage.fit - 0.5 * (louder + quieter) - (louder - quieter) / (2 * SLIGHT))


SETTLED = 1e-9
"""Change of a covariance from sample to sample, beside its standard deviations, below which it stays."""


@dataclass(frozen=True)
class _NoiseStep:
    """Of one step of a filter on noise: P (n, n) as claimed and Π (n, n) by noise alone of its prediction; gain K (n, m),
    weight S⁻¹ (m, m) of the innovations, zero where none is; variance R (m,) of the samples, zero where there is none."""

    P: np.ndarray
    covariance: np.ndarray
    gain: np.ndarray
    weight: np.ndarray
    noise: np.ndarray


def noise_alone(models: LinearModels, covariance: np.ndarray, noise: np.ndarray, every: int = 1) -> np.ndarray:
    """β (T, d), of which the sum is the mean of Σₜ εₜᵀ Sₜ⁻¹ eₜ over records that are the noise of gauges alone.

    ε are the slopes of innovations e in ν (`parallel_filters.advance`). β = 0 where innovations are as the filter claims, and so
    independent of ε; readings that are quieter have others. Under noise alone, with Φ = A(1 − KH) from prediction to prediction,

        Π⁺ = ΦΠΦᵀ + AKRKᵀAᵀ = E x̂x̂ᵀ,   Y = ΦᵀY⁺Φ + HᵀS⁻¹H
        β_k = ⟨KᵀAᵀY⁺ΦΠ − S⁻¹HΠ, D_k⟩ − ⟨Y⁺(ΦΠ(1 − KH)ᵀ + AKRKᵀ), A_k⟩

    Π forward in time and Y backward, in place of E x̂V_kᵀ of every k.
    models: one; covariance (n, n) of its states at t = 0; noise (T, m) variances of the samples, infinite where there is none;
    every: steps from sample to sample. βₜ is what comes of the noise up to step t, in that step and later.
    """
    A, H, A_nu = models.A[0], models.H[0], models.A_nu[0]
    steps = _forward(A, H, models.Q[0], covariance, noise, every)
    Y, one, beta = [np.zeros_like(A)] * (len(steps) + 1), np.eye(len(A)), np.zeros((len(noise), models.nuisances))
    for t in reversed(range(len(steps))):
        now, after, later = steps[t], Y[t + 1], t + every
        if later < len(steps) and now is steps[later] and _settled(after, Y[later + 1], after):
            Y[t], beta[t] = Y[later], beta[later]
            continue
        kept = one - now.gain @ H
        loop = A @ kept
        seen = loop @ now.covariance
        on_rows = (A @ now.gain).T @ after @ seen - now.weight @ H @ now.covariance
        on_motion = after @ (seen @ kept.T + A @ (now.gain * now.noise) @ now.gain.T)
        beta[t] = np.tensordot(models.D, on_rows)
        beta[t, : len(A_nu)] -= np.tensordot(A_nu, on_motion)
        Y[t] = loop.T @ after @ loop + H.T @ now.weight @ H
    return beta


def _forward(
    A: np.ndarray, H: np.ndarray, Q: np.ndarray, P: np.ndarray, noise: np.ndarray, every: int
) -> list[_NoiseStep]:
    """Every step of the filter, from rest; where nothing changes any more it is the one a sample before."""
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
            and _settled(P, before.P, P)
            and _settled(by_noise, before.covariance, P)
        ):
            now = before
        else:
            weight, seen = np.zeros((len(H), len(H))), H[measured]
            weight[np.ix_(measured, measured)] = np.linalg.inv(seen @ P @ seen.T + np.diag(R[measured]))
            now = _NoiseStep(P, by_noise, P @ H.T @ weight, weight, R)
        steps.append(now)
        left, fed = one - now.gain @ H, (now.gain * now.noise) @ now.gain.T
        P, by_noise = left @ now.P @ left.T + fed, left @ now.covariance @ left.T + fed
    return steps


def _settled(X: np.ndarray, before: np.ndarray, P: np.ndarray) -> bool:
    """Whether X (n, n) has moved by less than SETTLED of the standard deviations of P."""
    std = np.sqrt(np.abs(np.diag(P)))
    return bool(np.all(np.abs(X - before) <= SETTLED * np.outer(std, std)))
