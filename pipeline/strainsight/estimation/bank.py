"""A bank of linear filters over the parameters: exact Bayes for a model that is linear once its parameters are known.

    p(θ | y) ∝ p(θ) Πₖ p(yₖ | y₁ … yₖ₋₁, θ),     x̂ = Σ wᵢ x̂ᵢ,     P = Σ wᵢ (Pᵢ + (x̂ᵢ − x̂)(x̂ᵢ − x̂)ᵀ)

At fixed parameters the reduced model is linear, and the innovations of a Kalman filter give the likelihood of the parameters,
with errors of installation and damping integrated out. The extended filter linearises the product of parameter and motion
instead, and is sure of what it does not know.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from strainsight.errors import NumericalError
from strainsight.estimation.conditional import (
    Nuisances,
    conditional_states,
    considers,
    discrepancy,
    linear_models,
    no_nuisances,
)
from strainsight.estimation.lattice import Lattice, lattice_about, moments
from strainsight.estimation.mixture import Mixture
from strainsight.estimation.model import FilterModel
from strainsight.estimation.parallel_filters import Filters, LinearModels, Passage, advance, filters_of
from strainsight.estimation.reduced import LOST
from strainsight.estimation.run import FilterRun
from strainsight.estimation.settled import Settled, beginning

SPACING = 1.0
"""Of the lattice, in standard deviations of the posterior it was laid for."""
DEPTH = 6.0
"""A point of the lattice whose density is within exp(−DEPTH) of the largest has all its neighbours in it, when it is laid;"""
LEFT = 3.5
"""a point at its edge within exp(−LEFT) later on, and it is laid anew;"""
NARROW = 0.5
"""and so where the posterior's variance has fallen to this share in some direction."""
SHARP = 0.25
"""and where the variance of its highest peak has, along an axis of the lattice: with it sums are right to 1e-2 of σ;"""
FRESH = 0.4
"""when it is laid, that peak has at least this."""
COLLAPSED = 0.1
"""Share below which the lattice is too coarse to tell the posterior's covariance."""
PATIENCE = 4
"""Layers that are added on the way uphill before a wider lattice is laid there."""
MOST_POINTS = 4000
FEW = 3
"""Parameters that a lattice is for."""
MOST_FINE = 1000
"""Points of a lattice that is laid more finely for the sake of its peak; beyond them it stays as it is, and the posterior of a
long narrow crescent is right to a tenth of its σ."""
MOST_LAID = 60
"""Lattices on the way to one that resolves the posterior."""
SHORTEST, SHARE = 8, 8
"""Fewest steps between two looks at the posterior, and the share of the steps so far, 1/SHARE, that is taken otherwise: it
narrows as the record grows."""
KEPT = 4_000_000
"""Numbers that are kept of one passage."""


@dataclass(frozen=True)
class BankRun:
    """What the bank found.

    run: as a filter's, of one run; its σ holds what the nuisances add. point (B, k) and weight (B,): the posterior of the
    parameters at the end; nu (B, d) and left (B, d, d): mean and covariance of ν at each point; laid: how often the lattice was.
    """

    run: FilterRun
    point: np.ndarray
    weight: np.ndarray
    nu: np.ndarray
    left: np.ndarray
    laid: int

    @property
    def posterior(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (k,) and covariance (k, k) of the parameters."""
        mean = self.weight @ self.point
        off = self.point - mean
        return mean, (off * self.weight[:, None]).T @ off

    @property
    def nuisances(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (d,) and covariance (d, d) of ν."""
        mean = self.weight @ self.nu
        off = self.nu - mean
        return mean, np.einsum("b,bdk->dk", self.weight, self.left) + (off * self.weight[:, None]).T @ off


def filter_bank(
    model: FilterModel,
    mean: np.ndarray,
    covariance: np.ndarray,
    known: np.ndarray,
    measurement: np.ndarray,
    nuisances: Nuisances | None = None,
    *,
    spacing: float = SPACING,
    biased: np.ndarray | None = None,
    settled: Settled | None = None,
    depth: float = DEPTH,
    threads: int = 1,
) -> BankRun:
    """Posterior of the parameters, which are constant, and of all states along the samples.

    model: of one set of channels, no drift of its parameters; mean (n*,), covariance (n*, n*) at t = 0, no parameter known
    exactly nor correlated with a state; known (T, HOLD, n_known) [N]; measurement (T/every, m), NaN where missing; spacing of
    the lattice in standard deviations of the posterior, and how far below its largest density it reaches, in logarithms.
    biased (b,): channels with an unknown offset, behind x* in mean, covariance and all that is found. settled: the motion at
    t = 0 is the periodic one, at all parameters and ν, in place of that in mean and covariance.
    The lattice begins at the prior. It is laid anew about the posterior, and filtered again from the start, whenever that has
    narrowed or moved to its edge. Raises NumericalError where it would need more than MOST_POINTS points, and where the
    posterior leaves the guess by a factor of exp(LOST).
    """
    own = no_nuisances(model) if nuisances is None else nuisances
    data = _data(model, known, measurement, discrepancy(model, own, measurement))
    offsets = np.zeros(0, dtype=int) if biased is None else biased
    problem = _Problem(model, mean, covariance, data, own, offsets, settled, spacing, depth, threads)
    states = model.parameter_states
    now, laid = _laid(problem, mean[states], covariance[states, states], 0), 1
    mixture = Mixture(model, mean, covariance, len(known), own.learned)
    if settled is not None:
        mixture.begin(now.lattice.point, now.log_weight, now.filters)
    while now.step < len(known):
        ahead = min(max(SHORTEST, now.step // SHARE), len(known) - now.step, max(1, KEPT // _numbers(now.models)))
        before = replace(now.filters.states, nu=now.filters.nu[:, None].copy(), left=now.filters.left[:, None].copy())
        passage = _passed(problem, now, ahead, keep=True)
        weights = now.log_weight[:, None] + np.cumsum(passage.fit, axis=1)
        good = now.good(weights.T, spacing)
        used = ahead if good.all() else int(np.argmin(good)) + 1
        first, point, weights, fit = now.step, now.lattice.point, weights[:, :used], passage.fit[:, :used]
        mixture.innovations(first, point, weights - fit, before, passage, data.samples[first : first + used])
        mixture.log_likelihood += float(np.sum(logsumexp(weights, axis=0) - logsumexp(weights - fit, axis=0)))
        ends = data.known_end[first : first + used]
        mixture.states(first, point, weights, passage.states.first(used), now.models, ends)
        now = _on(now, passage, used)
        if not good.all():
            now, laid = _laid_anew(problem, now), laid + 1
            # the last of these steps, which the old lattice is no longer fine enough for
            mixture.states(
                now.step - 1, now.lattice.point, now.log_weight[:, None], now.filters.states, now.models, ends[-1:]
            )
    weight, _, _ = moments(now.lattice.point, now.log_weight)
    return BankRun(mixture.finished(), now.lattice.point, weight, now.filters.nu, now.filters.left, laid)


@dataclass(frozen=True)
class _Data:
    """known (T, p) and known_end (T, p₁) of every step, samples (T, m) with NaN where none, noise (T, m) and
    discrepancy (m,) their variances."""

    known: np.ndarray
    known_end: np.ndarray
    samples: np.ndarray
    noise: np.ndarray
    discrepancy: np.ndarray


@dataclass(frozen=True)
class _Problem:
    model: FilterModel
    mean: np.ndarray
    covariance: np.ndarray
    data: _Data
    nuisances: Nuisances
    biased: np.ndarray
    settled: Settled | None
    spacing: float
    depth: float
    threads: int

    def log_prior(self, point: np.ndarray) -> np.ndarray:
        """Of points (B, k), but for a constant."""
        at = self.model.parameter_states
        off = point - self.mean[at]
        return -0.5 * np.sum(off * np.linalg.solve(self.covariance[at, at], off.T).T, axis=1)


@dataclass(frozen=True)
class _Now:
    """A lattice with its filters after some steps: fit (B,) of all samples so far; sharp, the least variance of its highest
    peak along an axis that it is good for."""

    lattice: Lattice
    prior: np.ndarray
    models: LinearModels
    filters: Filters
    fit: np.ndarray
    step: int
    sharp: float = SHARP

    @property
    def log_weight(self) -> np.ndarray:
        """Of the points (B,), but for a constant."""
        return self.prior + self.fit

    def good(self, log_weight: np.ndarray, spacing: float) -> np.ndarray:
        """Whether the lattice still holds the posterior of log-weights (..., B): not too narrow for it, nor at its edge."""
        _, _, covariance = moments(self.lattice.point, log_weight)
        all_of_it = self.lattice.spread(covariance).min(axis=-1, initial=np.inf)
        highest = self.lattice.width(log_weight).min(axis=-1, initial=np.inf)
        wide = (all_of_it * spacing**2 >= NARROW) & (highest * spacing**2 >= self.sharp)
        edge = np.max(log_weight[..., self.lattice.edge], axis=-1, initial=-np.inf)
        return np.asarray(wide & (edge < log_weight.max(axis=-1) - LEFT))


def _numbers(models: LinearModels) -> int:
    """How many are kept of a step."""
    n = models.A.shape[1]
    return models.count * (n * (n + 1 + models.nuisances) + models.nuisances**2)


def _data(model: FilterModel, known: np.ndarray, measurement: np.ndarray, more: np.ndarray) -> _Data:
    """more (m,): variance of the discrepancy of every channel."""
    steps, m = len(known), model.H.shape[-2]
    samples = np.full((steps, m), np.nan)
    samples[model.every - 1 :: model.every] = measurement
    noise = model.noise[:, 0] if model.noise.ndim == 3 else np.broadcast_to(model.noise, (steps, m))
    held = known.reshape(steps, known.shape[1] * known.shape[2])
    return _Data(held, known.sum(axis=1), samples, np.ascontiguousarray(noise), more)


class _TooMany(NumericalError):
    """The lattice would need more points than it may have."""


def _laid(
    problem: _Problem,
    mean: np.ndarray,
    covariance: np.ndarray,
    step: int,
    other: np.ndarray | None = None,
    most: int = MOST_POINTS,
) -> _Now:
    """A lattice about a guess of the posterior after `step` steps, grown until it holds it, with its filters there.

    Where the largest density stays at its edge the posterior lies elsewhere: it is laid about that point, three times as wide.
    other (q, k): points of other peaks, which it is to hold as well.
    """
    radius = np.sqrt(2 * problem.depth)
    lattice = lattice_about(mean, covariance, problem.spacing, radius)
    if other is not None and len(other):
        lattice = lattice.with_nodes(lattice.nearest(other))
    now, outside = _filtered(problem, lattice, step), 0
    while True:
        log_weight, edge = now.log_weight, now.lattice.edge
        heavy = edge & (log_weight > log_weight.max() - problem.depth)
        if not heavy.any():
            return now
        best = int(np.argmax(log_weight))
        outside = outside + 1 if edge[best] else 0
        if outside > PATIENCE:
            centre, covariance = now.lattice.point[best], 9 * covariance
            if np.abs(centre - problem.mean[problem.model.parameter_states]).max() > LOST:
                raise NumericalError(
                    f"the measurements ask for parameters that differ from the guess by more than a factor of {np.exp(LOST):.0f}",
                    remedy="check which channel is which gauge, their units and signs, and the loads",
                )
            now, outside = _filtered(problem, lattice_about(centre, covariance, problem.spacing, radius), step), 0
            continue
        more = replace(now.lattice, node=now.lattice.beside(heavy))
        if len(now.lattice.node) + len(more.node) > most:
            raise _TooMany(
                f"the posterior of the parameters spreads over more than {most} points of its lattice",
                remedy=_fewer(len(now.lattice.point[0])),
            )
        now = _joined(now, _filtered(problem, more, step))


def _fewer(parameters: int) -> str:
    if parameters > FEW:
        return f"a bank is for up to {FEW} parameters: estimate no more, or take filter.method: sigma-point, without tolerances"
    return "the measurements hardly distinguish them: estimate fewer, or state a smaller initial standard deviation"


def _laid_anew(problem: _Problem, now: _Now) -> _Now:
    """A lattice for the posterior as it is now; where that is too narrow for the old one, by way of finer ones, for a power of
    its density. Raises NumericalError where no lattice resolves it."""
    for _ in range(MOST_LAID):
        share, lattice = 1.0, now.lattice
        while True:
            first, *others = lattice.peaks(share * now.log_weight, problem.depth)
            mean, covariance, narrow = _spread(problem, lattice, first, share * now.log_weight[first])
            if narrow >= COLLAPSED:
                break
            share *= 0.5
        if share < 1.0:
            covariance = min(1.0, NARROW / narrow) * covariance
        other = lattice.point[np.concatenate(others)] if others else lattice.point[:0]
        now = _laid(problem, mean, covariance, now.step, other)
        if share == 1.0:
            return _sharpened(problem, now, mean, covariance, other)
    raise NumericalError(
        f"the posterior of the parameters is too uneven for {MOST_LAID} lattices one finer than the other",
        remedy="state a larger noise of the gauges, or a smaller initial standard deviation of the parameters",
    )


def _spread(
    problem: _Problem, lattice: Lattice, which: np.ndarray, log_weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean and covariance to lay a lattice for, of points (q,) of this one, and the least variance in its own steps.

    The covariance is that of the density or twice that of its square, whichever is the narrower: of a normal density they are the
    same, of a curved one the second is nearer to that at its peak.
    """

    def least(covariance: np.ndarray) -> float:
        return float(lattice.spread(covariance).min(initial=np.inf) * problem.spacing**2)

    _, mean, plain = moments(lattice.point[which], log_weight)
    squared = 2 * moments(lattice.point[which], 2 * log_weight)[2]
    if COLLAPSED <= least(squared) < least(plain):
        return mean, squared, least(squared)
    return mean, plain, least(plain)


def _sharpened(problem: _Problem, now: _Now, mean: np.ndarray, covariance: np.ndarray, other: np.ndarray) -> _Now:
    """The lattice laid anew, as finely as its highest peak asks for and MOST_FINE allows."""
    while True:
        narrow = now.lattice.width(now.log_weight).min(initial=np.inf) * problem.spacing**2
        if narrow >= FRESH:
            return now
        covariance = narrow / (2 * SHARP) * covariance
        try:
            now = _laid(problem, mean, covariance, now.step, other, MOST_FINE)
        except _TooMany:
            return replace(now, sharp=min(SHARP, 0.5 * narrow))


def _filtered(problem: _Problem, lattice: Lattice, step: int) -> _Now:
    """Filters at the points of a lattice, from the start through `step` steps."""
    models = linear_models(problem.model, lattice.point, problem.nuisances, problem.biased)
    at = conditional_states(problem.model, len(problem.biased))
    start = beginning(problem.model, models, problem.mean[at], problem.covariance[np.ix_(at, at)], problem.settled)
    filters = filters_of(models, *start, consider=considers(problem.model, problem.nuisances))
    B = models.count
    now = _Now(lattice, problem.log_prior(lattice.point), models, filters, np.zeros(B), 0)
    while now.step < step:
        passage = _passed(problem, now, min(step - now.step, max(1, KEPT // B)), keep=False)
        now = _on(now, passage, passage.fit.shape[1])
    return now


def _passed(problem: _Problem, now: _Now, steps: int, keep: bool) -> Passage:
    span, data = slice(now.step, now.step + steps), problem.data
    return advance(
        now.models,
        now.filters,
        data.known[span],
        data.known_end[span],
        data.samples[span],
        data.noise[span],
        data.discrepancy,
        keep,
        problem.threads,
    )


def _on(now: _Now, passage: Passage, steps: int) -> _Now:
    """After the first steps of a passage."""
    return replace(now, fit=now.fit + passage.fit[:, :steps].sum(axis=1), step=now.step + steps)


def _joined(now: _Now, more: _Now) -> _Now:
    """Two parts of one lattice."""

    def both(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.concatenate([a, b])

    one, two = now.models, more.models
    models = replace(one, **{name: both(getattr(one, name), getattr(two, name)) for name in OF_POINTS})
    filters = Filters(*(both(getattr(now.filters, f), getattr(more.filters, f)) for f in Filters.__dataclass_fields__))
    return _Now(
        now.lattice.grown(more.lattice.node),
        both(now.prior, more.prior),
        models,
        filters,
        both(now.fit, more.fit),
        now.step,
    )


OF_POINTS = ("A", "G", "Q", "H", "F", "A_nu", "G_nu")
"""What of the models differs from point to point."""
