"""What filters at many parameter values say together: mean and covariance of their mixture along the samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Generic, Protocol, TypeVar

import numpy as np

from strainsight.columns import Column
from strainsight.errors import NumericalError
from strainsight.estimation.conditional import conditional_states
from strainsight.estimation.model import FilterModel
from strainsight.estimation.parallel_filters import LinearModels, Passage, States
from strainsight.estimation.run import FilterRun, Keep
from strainsight.estimation.update import standard_deviation


class Weights(Protocol):
    """What B points say of the posterior of the parameters at L instants."""

    @property
    def mean(self) -> np.ndarray:
        """(L, B) that give the mean over the posterior of what is known at the points, of sum one."""
        ...

    @property
    def positive(self) -> np.ndarray:
        """(L, B) of sum one for what has to stay positive."""
        ...

    @property
    def log_mass(self) -> np.ndarray:
        """Logarithm of the integral (L,) of the density, but for a constant."""
        ...

    def covariance(self, values: np.ndarray, middle: np.ndarray) -> np.ndarray:
        """(L, n, n) over the posterior, of values (B, L, n) with the mean (L, n)."""
        ...

    def sampled(self, nu: np.ndarray, left: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Points (b, k) of positive weights (b,) with the moments of the posterior at the last instant, and mean (b, d) and
        covariance (b, d, d) of ν there; nu (B, d), left (B, d, d) at the points of the bank."""
        ...


class Cover(Protocol):
    """Points at which the posterior of the parameters is known, and what follows from them."""

    @property
    def point(self) -> np.ndarray:
        """(B, k)."""
        ...

    @property
    def step(self) -> np.ndarray:
        """From point to point along every parameter (k,); infinite where the points are no lattice."""
        ...

    def weights(self, log_weight: np.ndarray) -> Weights:
        """Of points with log-densities (L, B), but for a constant, at L instants."""
        ...

    def holds(self, log_weight: np.ndarray) -> np.ndarray:
        """Whether these points are still good for the posterior (L,)."""
        ...


C = TypeVar("C", bound=Cover)


@dataclass(frozen=True)
class Standing(Generic[C]):
    """Of all points of a cover after some steps: prior and fit (B,), the logarithms of the prior and of the likelihood of all
    samples so far."""

    cover: C
    prior: np.ndarray
    fit: np.ndarray
    step: int

    @property
    def log_weight(self) -> np.ndarray:
        """Of the points (B,), but for a constant."""
        return self.prior + self.fit

    @property
    def weights(self) -> Weights:
        """At one instant."""
        return self.cover.weights(self.log_weight[None])


def log_normal(point: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Logarithm (B,) of a normal density at points (B, k), but for a constant."""
    off = point - mean
    return np.asarray(-0.5 * np.sum(off * np.linalg.solve(covariance, off.T).T, axis=1))


ROUNDING = 1e-12
"""Of the covariance of ν before the samples, which is 1: growth by less is none."""


class Mixture:
    """The arrays of a bank while it runs: T steps of a model with d nuisances. With keep "parameters" all else is NaN after
    t = 0."""

    def __init__(
        self, model: FilterModel, mean: np.ndarray, covariance: np.ndarray, steps: int, learned: bool, keep: Keep
    ):
        n, m = len(mean), model.H.shape[-2]
        at = conditional_states(model, n - model.size)
        self.model, self.steps, self.states_of_filters, self.learned = model, steps, len(at), learned
        self.parameters_alone = keep == "parameters"
        # states of the filters first, then the parameters; x* has them the other way round where there are offsets
        self.order = np.concatenate([at, np.arange(n)[model.parameter_states]])
        self.back = np.argsort(self.order)
        self.unknowns = self.back[model.position]
        self.mean, self.std = np.full((2, steps + 1, n), np.nan)
        self.unknown_covariance = np.full((steps + 1, len(self.unknowns), len(self.unknowns)), np.nan)
        self.covariance = np.zeros((steps + 1, n, n)) if keep == "all" else None
        self.mean[0] = mean[self.order]
        self._keep(slice(0, 1), covariance[np.ix_(self.order, self.order)][None])
        self.gauge_mean, self.gauge_variance, self.innovation, self.whitened = np.full((4, steps, m), np.nan)
        self.log_likelihood = 0.0

    def states(
        self,
        span: slice,
        point: np.ndarray,
        weights: Weights,
        found: States,
        models: LinearModels,
        known_end: np.ndarray,
    ) -> None:
        """After L steps of these numbers: points (B, k) with their weights, filters at the ends, loads known there (L, p₁)."""
        after = slice(span.start + 1, span.stop + 1)
        if self.parameters_alone:
            self._parameters(after, point, weights)
            return
        x, P, at, covariance = self._moments(after, point, weights, found)
        y = np.einsum("bmn,btn->btm", models.H, x) + np.einsum("bmp,tp->btm", models.F, known_end)
        self.gauge_mean[span] = np.einsum("tb,btm->tm", weights.mean, y)
        H = models.H[at, None]
        own = np.sum((H @ P) * H, axis=-1)
        among = weights.covariance(y, self.gauge_mean[span])
        self.gauge_variance[span] = np.einsum("tb,btm->tm", weights.positive[:, at], own)
        self.gauge_variance[span] += np.diagonal(among, axis1=1, axis2=2)
        if not self.learned:
            self._as_they_read(after, weights, found, models, covariance)
        self._keep(after, covariance)

    def begin(self, point: np.ndarray, weights: Weights, found: States, models: LinearModels, informed: bool) -> None:
        """At t = 0, of points (B, k) with their weights; informed: whether records before said something of ν."""
        if self.parameters_alone:
            self._parameters(slice(0, 1), point, weights)
            return
        covariance = self._moments(slice(0, 1), point, weights, found)[-1]
        if informed and not self.learned:
            self._motion_as_read(slice(0, 1), weights, found, models.about, covariance)
        self._keep(slice(0, 1), covariance)

    def _parameters(self, at: slice, point: np.ndarray, weights: Weights) -> None:
        """At L instants, of points (B, k)."""
        of, mean = slice(self.states_of_filters, None), weights.mean @ point
        each = np.broadcast_to(point[:, None], (len(point), *mean.shape))
        self.mean[at, of], self.std[at, of] = mean, standard_deviation(weights.covariance(each, mean))

    def _moments(
        self, at: slice, point: np.ndarray, weights: Weights, found: States
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Mean of the states at L instants; returns x (B, L, n) of every filter, P (b, L, n, n) of those numbers (b,) that have a
        positive weight, and the covariance (L, n + k, n + k) of states and parameters."""
        V, states = found.V, self.states_of_filters
        # what the samples say of ν moves every estimate, and leaves the rest of it in P
        x = found.x - np.einsum("btda,btd->bta", V, found.nu)
        heavy = np.flatnonzero((weights.positive > 0).any(axis=0))
        V, left = V[heavy], found.left[heavy]
        P = found.P[heavy] + np.swapaxes(V, 2, 3) @ (left @ V)
        whole = np.concatenate([x, np.broadcast_to(point[:, None], (*x.shape[:2], point.shape[1]))], axis=2)
        self.mean[at] = np.einsum("tb,btn->tn", weights.mean, whole)
        covariance = weights.covariance(whole, self.mean[at])
        covariance[:, :states, :states] += np.einsum("tb,btac->tac", weights.positive[:, heavy], P)
        return x, P, heavy, covariance

    def _keep(self, at: slice, covariance: np.ndarray) -> None:
        """Of the covariance (L, n + k, n + k) of states and parameters at L instants."""
        self.std[at], self.last = standard_deviation(covariance), covariance[-1:]
        self.unknown_covariance[at] = covariance[:, self.unknowns[:, None], self.unknowns]
        if self.covariance is not None:
            self.covariance[at] = covariance

    def _as_they_read(
        self, after: slice, weights: Weights, found: States, models: LinearModels, covariance: np.ndarray
    ) -> None:
        """Motion and loads as they were before the samples' mean of ν corrected them, and σ as well:

        x̂ + V ν̂,     P + V (1 − Λ) Vᵀ,     Λ the covariance of ν by the samples, 1 that without them (`removed_of`)
        """
        span, w = slice(after.start - 1, after.stop - 1), weights.mean
        nu, gone = self._motion_as_read(after, weights, found, models.about, covariance)
        sensed = np.einsum("tb,btdm->tdm", w, found.V @ np.swapaxes(models.H, 1, 2)[:, None])
        self.gauge_mean[span] += np.einsum("tdm,td->tm", sensed, nu)
        self.gauge_variance[span] += np.sum(sensed * (gone @ sensed), axis=1)

    def _motion_as_read(
        self, at: slice, weights: Weights, found: States, about: np.ndarray, covariance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Motion and loads, and their covariance (L, n + k, n + k) in place; returns ν̂ (L, d), with what it is counted from, and
        1 − Λ (L, d, d)."""
        states, w = self.states_of_filters, weights.mean
        nu = np.einsum("tb,btd->td", w, found.nu)
        left = np.einsum("tb,btdk->tdk", weights.positive, found.left) + weights.covariance(found.nu, nu)
        nu = nu + about
        gone = removed_of(left)
        V = np.einsum("tb,btda->tda", w, found.V)
        self.mean[at, :states] += np.einsum("tda,td->ta", V, nu)
        covariance[:, :states, :states] += np.swapaxes(V, 1, 2) @ (gone @ V)
        return nu, gone

    def innovations(
        self,
        span: slice,
        weights: Weights,
        before: tuple[np.ndarray, np.ndarray],
        passage: Passage,
        samples: np.ndarray,
    ) -> None:
        """Of L steps of these numbers: weights of the points before each; before the first, mean (B, 1, d) and covariance
        (B, 1, d, d) of ν by each filter; what they found, samples (L, m)."""
        if self.parameters_alone:
            return
        L = len(samples)
        own, slope = passage.states, passage.slope[:, :L]
        known, unsure = (
            np.concatenate([start, each[:, : L - 1]], axis=1)
            for start, each in zip(before, (own.nu, own.left), strict=True)
        )
        foreseen = passage.expected[:, :L] + np.einsum("btmd,btd->btm", slope, known)
        spread = passage.S[:, :L] + slope @ unsure @ np.swapaxes(slope, 2, 3)
        expected = np.einsum("tb,btm->tm", weights.mean, foreseen)
        S = np.einsum("tb,btmk->tmk", weights.positive, spread) + weights.covariance(foreseen, expected)
        self.innovation[span] = samples - expected
        there = np.isfinite(samples)
        # a channel without a sample is one by itself
        S = np.where(there[:, :, None] & there[:, None], S, np.eye(S.shape[-1]))
        try:
            factor = np.linalg.cholesky(S)
        except np.linalg.LinAlgError:
            raise NumericalError(
                f"the readings of step {span.start + _first_indefinite(S)} differ in size beyond what a number can hold",
                remedy="check the units and scales of the channels",
            ) from None
        z = np.linalg.solve(factor, np.where(there, self.innovation[span], 0.0)[..., None])[..., 0]
        self.whitened[span] = np.where(there, z, np.nan)

    def finished(self) -> FilterRun:
        """As a filter's run, of one run, with σ and covariances that hold what the nuisances add."""
        back = self.back
        return FilterRun(
            time=self.model.h * np.arange(self.steps + 1),
            mean=self.mean[:, None, back],
            std=self.std[:, None, back],
            unknown_covariance=self.unknown_covariance[:, None],
            gauge_mean=self.gauge_mean[:, None],
            gauge_std=np.sqrt(self.gauge_variance)[:, None],
            innovation=self.innovation[:, None],
            whitened=self.whitened[:, None],
            nis=np.nansum(self.whitened**2, axis=1)[:, None],
            lost=np.array([-1]),
            log_likelihood=np.array([self.log_likelihood]),
            last=self.last[:, back[:, None], back],
            covariance=None if self.covariance is None else self.covariance[:, None, back[:, None], back],
        )


def _first_indefinite(S: np.ndarray) -> int:
    """Of matrices (L, m, m), one of which has no Cholesky factor, the first that has none."""
    for t, own in enumerate(S):
        try:
            np.linalg.cholesky(own)
        except np.linalg.LinAlgError:
            return t
    return 0


def removed_of(left: np.ndarray) -> np.ndarray:
    """1 − Λ (..., d, d): by how much samples that leave ν a covariance of Λ (..., d, d) made it smaller.

    Zero along a direction in which it is larger than before them: parameters that are all still likely ask for different ν.
    """
    found = np.eye(left.shape[-1]) - left
    try:
        # a factor says in a fourth of the time that there is no such direction
        np.linalg.cholesky(found + ROUNDING * np.eye(left.shape[-1]))
    except np.linalg.LinAlgError:
        size, axes = np.linalg.eigh(found)
        found = (axes * np.maximum(size, 0.0)[..., None, :]) @ np.swapaxes(axes, -1, -2)
    return np.asarray(found)


VALUES = 401
"""At which a density is given."""
REACH = 5.0
"""Standard deviations about the mean, and about every point that counts, that it is given over."""
COUNTS = 1e-9
"""Least weight of such a point."""
KERNEL = 0.7
"""Of a point of the lattice, in steps of it: a normal density is right to 2 exp(−2π² KERNEL²) = 1e-4 of its height, and
narrow peaks are drawn wider than they are."""
VALLEY = 0.5
"""Two peaks are two where the density between them falls below this share of the lower one;"""
SHARE = 0.01
"""and each holds at least so much of it."""


@dataclass(frozen=True)
class Posterior:
    """What the samples leave of one parameter, <what>; its peaks from the lowest value on."""

    value: Annotated[np.ndarray, Column("<unit>", "/value", "values of <what>")]
    density: Annotated[np.ndarray, Column("1", "/value", "density of ln <what> after the samples")]
    prior: Annotated[np.ndarray, Column("1", "/value", "the same before them")]
    left: Annotated[float, Column("1", "", "σ of ln <what> after the samples over that before them")]
    peak: Annotated[np.ndarray, Column("<unit>", "/peak", "values at which the density is largest")]
    share: Annotated[np.ndarray, Column("1", "/peak", "probability of what lies about each")]


def marginal(point: np.ndarray, weight: np.ndarray, step: float, prior: tuple[float, float]) -> Posterior:
    """Of a posterior given by points (B,) with weights (B,) of sum one; step: of the lattice they belong to, along p, infinite
    where it is no lattice, which has the normal density then; prior: mean and standard deviation of a normal density.

        π(p) = Σ wᵢ N(p; p̄ + a(pᵢ − p̄), h²),     h = KERNEL · step,     a² = 1 − h²/σ²

    with kernels drawn together about the mean p̄, so that it keeps mean and variance σ² of the points. Source: Liu and West, in
    Sequential Monte Carlo Methods in Practice (2001), chapter 10.
    """
    mean = float(weight @ point)
    std = float(np.sqrt(weight @ (point - mean) ** 2))
    h = min(KERNEL * step, std)
    centre = mean + np.sqrt(1 - (h / std) ** 2) * (point - mean)
    heavy = weight > COUNTS
    ends = (
        min(mean - REACH * std, centre[heavy].min() - REACH * h),
        max(mean + REACH * std, centre[heavy].max() + REACH * h),
    )
    value = np.linspace(*ends, VALUES)
    density = normal(value[:, None], centre, h) @ weight
    peak, share = peaks_of(value, density)
    return Posterior(value, density, normal(value, *prior), std / prior[1], peak, share)


def normal(value: np.ndarray, mean: np.ndarray | float, std: float) -> np.ndarray:
    return np.asarray(np.exp(-0.5 * ((value - mean) / std) ** 2) / (np.sqrt(2 * np.pi) * std))


def peaks_of(value: np.ndarray, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where a density (k,) at equally spaced values (k,) has its peaks, and the share of it up to the valleys beside each."""
    inner = density[1:-1]
    tops = 1 + np.flatnonzero((inner > density[:-2]) & (inner >= density[2:]))
    kept: list[int] = []
    valleys: list[int] = []
    for top in tops.tolist():
        if kept:
            low = kept[-1] + int(np.argmin(density[kept[-1] : top + 1]))
            if density[low] > VALLEY * min(density[kept[-1]], density[top]):
                kept[-1] = max(kept[-1], top, key=lambda at: float(density[at]))
                continue
            valleys.append(low)
        kept.append(top)
    mass = np.array([part.sum() for part in np.split(density, valleys)]) / density.sum()
    large = mass >= SHARE
    return value[kept][large], mass[large]
