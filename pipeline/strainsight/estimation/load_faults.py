"""Faults of known loads: their corrections, and the selection of those to be evaluated."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import TypeVar

import numpy as np

from strainsight.estimation.conditional import none_considered
from strainsight.estimation.consistency import whiteness_band
from strainsight.estimation.decision import SLACK
from strainsight.estimation.faults import LOAD_SCALES, MOST_LATE, Fault
from strainsight.estimation.grid_filter_points import GridProblem, advance_points, apply_passage, filter_points
from strainsight.estimation.parallel_filters import KEPT
from strainsight.estimation.parameter_grid import scattered_points
from strainsight.estimation.record import GridRecord

R = TypeVar("R", bound=GridRecord)

PLACES = (-1.0, -0.5, 0.5, 1.0)
"""Values of each parameter in prior σ, around its first estimate, at which faults are ranked."""
CLOSELY = 3
"""Load faults evaluated with all tolerances."""
SEVERAL = 100.0
"""Change ½Σz² of the innovations from which a channel counts as affected by a fault."""


def undo_load_fault(record: R, load: np.ndarray, fault: Fault) -> R:
    """The record without a fault of a known load, or of two swapped ones; load (p,): load of each column of `known`. Late
    loads are shifted to their own time. At the open end of the record they are held constant, and the samples are omitted."""
    known, samples, W = record.known.copy(), record.samples, record.settled
    tones = np.zeros((0, *known.shape[1:]), dtype=complex) if W is None else W.hold.copy()
    wrong = load == fault.channel
    if fault.kind == "swapped":
        other = load == int(fault.amount)
        for each in (known, tones):
            each[..., wrong], each[..., other] = each[..., other], each[..., wrong]
    elif fault.kind == "late":
        n, steps = int(fault.amount), int(fault.amount) * record.model.every
        known[..., wrong] = _shift(known[..., wrong], steps)
        samples = samples.copy()
        samples[slice(len(samples) - n, None) if n > 0 else slice(0, -n)] = np.nan
        if W is not None:
            tones[..., wrong] *= np.exp(1j * W.frequency * record.model.h * steps)[:, None, None]
    else:
        known[..., wrong] *= fault.factor
        tones[..., wrong] *= fault.factor
    return replace(record, known=known, samples=samples, settled=None if W is None else replace(W, hold=tones))


def _shift(hold: np.ndarray, steps: int) -> np.ndarray:
    """Hold coefficients (T, HOLD, p) so many steps later, constant outside the record."""
    moved = np.zeros_like(hold)
    if steps > 0:
        moved[:-steps] = hold[steps:]
        moved[-steps:, 0] = hold[-1].sum(axis=0)
    else:
        moved[-steps:] = hold[:steps]
        moved[:-steps, 0] = hold[0, 0]
    return moved


@dataclass(frozen=True)
class Innovations:
    """Whitened innovations (B, T, m) of linear filters at B points of the parameters, without tolerances. unloaded: without
    known loads; by_load[i][j]: contribution of load i acting as load j; log_prior (B,): of the points, with that of σ."""

    unloaded: np.ndarray
    by_load: list[list[np.ndarray]]
    log_prior: np.ndarray

    def under(self, fault: Fault | None) -> np.ndarray:
        """Innovations (B, T, m) under a load fault, or none."""
        acting = [self.by_load[i][i] for i in range(len(self.by_load))]
        if fault is not None:
            i = fault.channel
            if fault.kind == "swapped":
                j = int(fault.amount)
                acting[i], acting[j] = self.by_load[j][i], self.by_load[i][j]
            elif fault.kind == "late":
                n = int(fault.amount)
                acting[i] = np.roll(acting[i], -n, axis=1)
                acting[i][:, slice(-n, None) if n > 0 else slice(-n)] = 0.0
            else:
                acting[i] = acting[i] * fault.factor
        return self.unloaded + np.sum(acting, axis=0)

    def density(self, fault: Fault | None) -> float:
        """Log-density of the record at the best point, up to a constant."""
        return float(np.max(self.log_prior - 0.5 * np.sum(self.under(fault) ** 2, axis=(1, 2))))

    def speaking(self, fault: Fault) -> int:
        """Number of channels that a load fault affects by SEVERAL at all points."""
        change = 0.5 * np.sum((self.under(fault) - self.under(None)) ** 2, axis=1)
        return int(np.sum(change.min(axis=0) > SEVERAL))


def compute_innovations(record: GridRecord, load: np.ndarray) -> Innovations:
    """Run a filter for each load; load (p,): load of each column of `known`."""
    mean, covariance = record.prior
    sigma, k = np.sqrt(np.diag(covariance)), len(mean)
    point = mean + sigma * np.vstack([np.zeros((1, k)), *(x * np.eye(k) for x in PLACES)])
    record = replace(record, considered=none_considered(record.model), settled=None)
    silent = 0 * record.known
    unloaded, log_prior = _whiten(replace(record, known=silent), point)
    nothing = replace(record, mean=0 * record.mean, samples=np.where(np.isnan(record.samples), np.nan, 0.0))

    def effect(i: int, j: int) -> np.ndarray:
        known = silent.copy()
        known[..., load == j] = record.known[..., load == i]
        return _whiten(replace(nothing, known=known), point)[0]

    loads = range(len(np.unique(load)))
    return Innovations(unloaded, [[effect(i, j) for j in loads] for i in loads], log_prior)


def _whiten(record: GridRecord, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Innovations (B, T, m) over their σ, zero for missing samples, and the log-density of the points and of σ (B,)."""
    problem = GridProblem((record,))
    now, parts = filter_points(problem, scattered_points(point), 0), []
    while now.step < record.steps:
        ahead = min(record.steps - now.step, max(1, KEPT // now.models.kept_a_step))
        passage = advance_points(problem, now, ahead, keep=True)
        parts.append((passage.passage.expected, passage.passage.S))
        now = apply_passage(now, passage, ahead)
    expected, S = (np.concatenate(each, axis=1)[:, record.sampled] for each in zip(*parts, strict=True))
    e = record.samples - expected
    measured = np.isfinite(e)
    S = np.where(measured[..., :, None] & measured[..., None, :], S, np.eye(S.shape[-1]))
    L = np.linalg.cholesky(S)
    z = np.linalg.solve(L, np.where(measured, e, 0.0)[..., None])[..., 0]
    return z, problem.log_prior(point) - np.log(np.diagonal(L, axis1=2, axis2=3)).sum(axis=(1, 2))


def select_load_faults(innovations: Innovations) -> list[Fault]:
    """Load faults that improve the likelihood, best first: CLOSELY of them, and neighbouring delays."""
    count, T = len(innovations.by_load), innovations.unloaded.shape[1]
    most = min(MOST_LATE, T // 4)
    faults = [Fault("swapped", i, j, of_load=True) for i, j in combinations(range(count), 2)]
    for i in range(count):
        faults += [Fault("sign", i, of_load=True), *(Fault("scale", i, s, of_load=True) for s in LOAD_SCALES)]
        late = [Fault("late", i, n, of_load=True) for n in range(-most, most + 1) if n]
        faults += sorted(late, key=innovations.density)[-1:]
    as_it_is = innovations.density(None)
    ranked = sorted(((innovations.density(fault), k) for k, fault in enumerate(faults)), reverse=True)
    wanted = [faults[k] for density, k in ranked if density > as_it_is][:CLOSELY]
    return wanted + [other for fault in wanted for other in fault.neighbours]


SHARE = 0.6
"""Least share of the excess over the claim in the pattern."""
SLOW = 0.3
"""Least correlation of successive samples along the pattern: relevant loads last longer than a sample."""
LARGEST = 3.0
"""Larger whitened samples are clipped to a norm of √m plus this."""


@dataclass(frozen=True)
class ResidualPattern:
    """Direction in which innovations exceed their claimed covariance. size: RMS over the claim; correlation: of successive
    samples; share (m,): squares of the channels in units of their noise; gain: of ln p by a first-order autoregression
    instead of white noise."""

    size: float
    correlation: float
    share: np.ndarray
    gain: float


def residual_pattern(
    whitened: np.ndarray, innovation: np.ndarray, noise: np.ndarray, least: float
) -> ResidualPattern | None:
    """The only eigenvector of the innovation covariance with too large an eigenvalue, or None.

        C = (1/T) Σ ν̃ₖν̃ₖᵀ = I + λ v vᵀ

    The eigenvalues of C lie below (1 + √(m/T))² for a correct model (Marchenko and Pastur 1967). An unmodelled load adds one
    dyad with correlated samples.

    whitened (T, m) [1], innovation (T, m) [unit], NaN if missing; noise (m,) [unit] of a sample; least: smallest relevant
    size. Modelled loads that vary faster than their process noise also leave a pattern: compare `gain` with theirs."""
    complete = np.isfinite(whitened).all(axis=1) & np.isfinite(innovation).all(axis=1)
    samples, m = whitened[complete].shape
    if samples <= m or m < 2:
        return None
    # a load that begins at once makes a few large innovations, and no pattern that lasts
    norm = np.maximum(np.linalg.norm(whitened[complete], axis=1, keepdims=True), np.finfo(float).tiny)
    white = whitened[complete] * np.minimum(1.0, (np.sqrt(m) + LARGEST) / norm)
    values, vectors = np.linalg.eigh(white.T @ white / samples)
    chance = ((1 + np.sqrt(m / samples)) * (1 + SLACK)) ** 2
    excess = np.maximum(values - 1, 0.0)
    along = white @ vectors[:, -1]
    correlation = float(along[1:] @ along[:-1] / (along @ along))
    alone = values[-2] <= chance or excess[-1] >= SHARE * excess.sum()
    if values[-1] < max(least**2, chance) or not alone or correlation < max(SLOW, whiteness_band(samples, 1)):
        return None
    # ν = L ν̃, with the factor L that all samples have on average
    factor = np.linalg.lstsq(whitened[complete], innovation[complete], rcond=None)[0].T
    share = (factor @ vectors[:, -1] / noise) ** 2
    gain = 0.5 * samples * (values[-1] - 1 - np.log(values[-1] * (1 - correlation**2)))
    return ResidualPattern(float(np.sqrt(values[-1])), correlation, share / share.sum(), float(gain))
