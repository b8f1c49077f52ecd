"""The most likely parameters of a record, and how likely the record is: Laplace's approximation of what a bank integrates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.estimation.bank_filters import BankProblem, BankRecord, bank_record, filtered_at
from strainsight.estimation.conditional import Nuisances
from strainsight.estimation.model import FilterModel
from strainsight.estimation.reduced import LOST
from strainsight.estimation.settled import Settled

ROUNDS = 15
"""Of Newton's method at most: what has not settled then is no record that the model could make."""
SETTLED = 0.2
"""Step in standard deviations of the posterior below which it has."""
FLATTEST = 1e-12
"""Curvature of a density that has none, in units of the prior's."""


@dataclass(frozen=True)
class Points:
    """Parameters (B, k) at which filters run: no lattice."""

    point: np.ndarray


@dataclass(frozen=True)
class Peak:
    """point (k,) where the posterior of the parameters is largest; evidence: ln p(y)."""

    point: np.ndarray
    evidence: float


def peak_of(
    model: FilterModel,
    mean: np.ndarray,
    covariance: np.ndarray,
    known: np.ndarray,
    measurement: np.ndarray,
    nuisances: Nuisances,
    biased: np.ndarray,
    settled: Settled | None,
) -> Peak:
    """Arguments as of `filter_bank`.

        ln p(y) ≈ ln p(y, p̂) + ½ ln det Σ − ½ ln det P₀,     Σ⁻¹ = −∂² ln p(y, p)/∂p² at its largest value p̂

    p(y | p) by a filter at p, tolerances integrated out. Newton's method on differences over a σ of the posterior, in 1 + 2k +
    k(k − 1)/2 filters a round. A lattice follows a posterior to wherever a wrong record drives it; this gives up.
    """
    return peak_of_records([bank_record(model, known, measurement, nuisances, settled)], mean, covariance, biased)


def peak_of_records(
    records: Sequence[BankRecord], mean: np.ndarray, covariance: np.ndarray, biased: np.ndarray
) -> Peak:
    """The same of records that share their parameters and ν; arguments as of `filter_records`."""
    problem = BankProblem(tuple(records), mean, covariance, biased, 1.0, 1.0)
    centre, prior = problem.prior
    k = len(centre)
    width = np.sqrt(np.diag(prior))

    def density(point: np.ndarray) -> np.ndarray:
        found = filtered_at(problem, Points(point), problem.first[-1]).log_weight  # type: ignore[type-var]
        return np.where(np.isfinite(found), found, -np.finfo(float).max)

    if not k:
        return Peak(centre, float(density(centre[None])[0]))
    pairs = [(i, j) for i in range(k) for j in range(i)]
    offsets = np.vstack([np.zeros(k), np.eye(k), -np.eye(k), *[(np.eye(k)[i] + np.eye(k)[j])[None] for i, j in pairs]])
    at, step, best = centre, 0.5 * width, -np.inf
    hessian = -np.diag(1 / width**2)
    for _ in range(ROUNDS):
        tried = np.clip(at + step * offsets, centre - LOST, centre + LOST)
        value = density(tried)
        up, down = value[1 : k + 1], value[k + 1 : 2 * k + 1]
        slope, curve = (up - down) / 2, up + down - 2 * value[0]
        scaled = np.diag(curve)
        for own, (i, j) in zip(value[2 * k + 1 :], pairs, strict=True):
            scaled[i, j] = scaled[j, i] = own - up[i] - up[j] + value[0]
        size, axes = np.linalg.eigh(-scaled)
        top = int(np.argmax(value))
        best = max(best, float(value[top]))
        if size[0] <= FLATTEST * np.max(np.abs(value[0]), initial=1.0):
            # no summit here: on from the best of these points, in steps that are larger
            at, step = tried[top], (1.5 if top else 0.5) * step
            continue
        move = axes @ ((axes.T @ slope) / size)
        long = float(np.abs(move).max())
        hessian = scaled / np.outer(step, step)
        spread = step * np.sqrt(np.diag(axes @ np.diag(1 / size) @ axes.T))
        at = np.clip(at + step * move * min(1.0, 4.0 / max(long, 1e-300)), centre - LOST, centre + LOST)
        near = np.all(np.abs(step * move) <= SETTLED * spread) and np.all(np.abs(np.log(step / spread)) < np.log(4.0))
        step = np.clip(spread, 0.05 * step, 4.0 * step)
        if near:
            best = max(best, float(value[0] + 0.5 * slope @ move))
            break
    sign, logdet = np.linalg.slogdet(-hessian)
    wide = -logdet if sign > 0 else 0.0
    return Peak(at, best + 0.5 * wide - 0.5 * float(np.linalg.slogdet(prior)[1]))


def known_at(
    model: FilterModel, point: np.ndarray, mean: np.ndarray, covariance: np.ndarray
) -> tuple[FilterModel, np.ndarray, np.ndarray]:
    """Model, mean and covariance at t = 0 with the parameters known to be those of `point` (k,), offsets of channels kept."""
    at = model.parameter_states
    kept = np.delete(np.arange(len(mean)), np.arange(at.start, at.stop))
    states = kept[kept < model.size]
    guess = model.unknowns.guess
    fixed = {name: float(guess[name] * np.exp(point[i])) for i, name in enumerate(model.unknowns.parameters)}
    found = replace(
        model,
        unknowns=replace(model.unknowns, parameters=()),
        fixed={**model.fixed, **fixed},
        H=model.H[..., states],
        Q=model.Q[..., states[:, None], states],
    )
    return found, mean[kept], covariance[np.ix_(kept, kept)]
