"""What filters at many parameter values say together: their mixture along the samples, and the posterior of each parameter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Generic, Protocol, TypeVar

import numpy as np

from strainsight.columns import Column
from strainsight.errors import NumericalError
from strainsight.estimation.conditional import conditional_states
from strainsight.estimation.parallel_filters import LinearModels, Passage, States
from strainsight.estimation.record import GridRecord
from strainsight.estimation.run import FilterRun, Keep
from strainsight.estimation.update import standard_deviation


class Weights(Protocol):
    """Posterior weights of B points of the parameters at L instants."""

    @property
    def point(self) -> np.ndarray:
        """(B, k)."""

    @property
    def mean(self) -> np.ndarray:
        """(L, B) that give the mean over the posterior of what is known at the points, of sum one."""

    @property
    def positive(self) -> np.ndarray:
        """(L, B) of sum one for what has to stay positive."""

    @property
    def log_mass(self) -> np.ndarray:
        """Logarithm of the integral (L,) of the density, but for a constant."""

    def covariance(self, values: np.ndarray, middle: np.ndarray) -> np.ndarray:
        """(L, n, n) over the posterior, of values (B, L, n) with the mean (L, n)."""

    def sampled(self, nu: np.ndarray, left: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Points (b, k) of positive weights (b,) with the moments of the posterior at the last instant, and mean (b, d) and
        covariance (b, d, d) of ν there; nu (B, d), left (B, d, d) at the points of the grid filter."""


class Cover(Protocol):
    """Points at which the posterior of the parameters is known, and what follows from them."""

    @property
    def point(self) -> np.ndarray:
        """(B, k)."""

    @property
    def step(self) -> np.ndarray:
        """From point to point along every parameter (k,); infinite where the points are no lattice."""

    def weights(self, log_weight: np.ndarray) -> Weights:
        """Of points with log-densities (L, B), but for a constant, at L instants."""

    def holds(self, log_weight: np.ndarray) -> np.ndarray:
        """Whether these points are still good for the posterior (L,)."""


C = TypeVar("C", bound=Cover)


@dataclass(frozen=True)
class PosteriorWeights(Generic[C]):
    """Of all points of a cover after some steps: prior and fit (B,), the logarithms of the prior and of the likelihood of all
    samples so far."""

    SHARED: ClassVar[tuple[str, ...]] = ("cover", "step")

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
    """Mean and covariance over the points of a grid filter along a record, while it runs. With keep "parameters" all else is
    NaN after t = 0."""

    def __init__(self, record: GridRecord, keep: Keep):
        model, steps, n, m = record.model, record.steps, len(record.mean), record.samples.shape[1]
        at = conditional_states(model, len(record.biased))
        self.record, self.size, self.learned = record, len(at), record.considered.learned
        self.parameters_alone = keep == "parameters"
        # states of the filters first, then the parameters; x* has them the other way round where there are offsets
        order = np.concatenate([at, np.arange(n)[model.parameter_states]])
        self.back = np.argsort(order)
        self.unknowns = self.back[model.position]
        self.mean, self.std = np.full((2, steps + 1, n), np.nan)
        self.unknown_covariance = np.full((steps + 1, len(self.unknowns), len(self.unknowns)), np.nan)
        self.covariance = np.zeros((steps + 1, n, n)) if keep == "all" else None
        self.mean[0] = record.mean[order]
        self._keep(slice(0, 1), record.covariance[np.ix_(order, order)][None])
        self.gauge_mean, self.gauge_variance, self.innovation, self.whitened = np.full((4, steps, m), np.nan)
        self.log_likelihood = 0.0

    def states(self, span: slice, weights: Weights, states: States, models: LinearModels) -> None:
        """After L steps of these numbers: states of the filters at their ends."""
        after = slice(span.start + 1, span.stop + 1)
        if self.parameters_alone:
            self._parameters(after, weights)
            return
        x, P, at, covariance = self._moments(after, weights, states)
        y = np.einsum("bmn,btn->btm", models.H, x)
        y = y + np.einsum("bmp,tp->btm", models.F, self.record.data.known_end[span])
        self.gauge_mean[span] = np.einsum("tb,btm->tm", weights.mean, y)
        H = models.H[at, None]
        among = weights.covariance(y, self.gauge_mean[span])
        self.gauge_variance[span] = np.einsum("tb,btm->tm", weights.positive[:, at], np.sum((H @ P) * H, axis=-1))
        self.gauge_variance[span] += np.diagonal(among, axis1=1, axis2=2)
        if not self.learned:
            nu, removed = self._motion_as_read(after, weights, states, models.about, covariance)
            read = np.einsum("tb,btdm->tdm", weights.mean, states.V @ np.swapaxes(models.H, 1, 2)[:, None])
            self.gauge_mean[span] += np.einsum("tdm,td->tm", read, nu)
            self.gauge_variance[span] += np.sum(read * (removed @ read), axis=1)
        self._keep(after, covariance)

    def begin(self, weights: Weights, states: States, models: LinearModels, informed: bool) -> None:
        """At t = 0; informed: whether records before said something of ν."""
        if self.parameters_alone:
            self._parameters(slice(0, 1), weights)
            return
        covariance = self._moments(slice(0, 1), weights, states)[-1]
        if informed and not self.learned:
            self._motion_as_read(slice(0, 1), weights, states, models.about, covariance)
        self._keep(slice(0, 1), covariance)

    def _parameters(self, at: slice, weights: Weights) -> None:
        """At L instants."""
        point, of = weights.point, slice(self.size, None)
        mean = weights.mean @ point
        each = np.broadcast_to(point[:, None], (len(point), *mean.shape))
        self.mean[at, of], self.std[at, of] = mean, standard_deviation(weights.covariance(each, mean))

    def _moments(
        self, at: slice, weights: Weights, states: States
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Mean of the states at L instants; returns x (B, L, n) of every filter, P (b, L, n, n) of those numbers (b,) that have a
        positive weight, and the covariance (L, n + k, n + k) of states and parameters."""
        # what the samples say of ν moves every estimate, and leaves the rest of it in P
        x = states.x - np.einsum("btda,btd->bta", states.V, states.nu)
        heavy = np.flatnonzero((weights.positive > 0).any(axis=0))
        V, left, point = states.V[heavy], states.left[heavy], weights.point
        P = states.P[heavy] + np.swapaxes(V, 2, 3) @ (left @ V)
        whole = np.concatenate([x, np.broadcast_to(point[:, None], (*x.shape[:2], point.shape[1]))], axis=2)
        self.mean[at] = np.einsum("tb,btn->tn", weights.mean, whole)
        covariance = weights.covariance(whole, self.mean[at])
        covariance[:, : self.size, : self.size] += np.einsum("tb,btac->tac", weights.positive[:, heavy], P)
        return x, P, heavy, covariance

    def _keep(self, at: slice, covariance: np.ndarray) -> None:
        """Of the covariance (L, n + k, n + k) of states and parameters at L instants."""
        self.std[at], self.last = standard_deviation(covariance), covariance[-1:]
        self.unknown_covariance[at] = covariance[:, self.unknowns[:, None], self.unknowns]
        if self.covariance is not None:
            self.covariance[at] = covariance

    def _motion_as_read(
        self, at: slice, weights: Weights, states: States, about: np.ndarray, covariance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Motion and loads as they were before the samples' mean of ν corrected them, and their covariance in place:

            x̂ + V ν̂,     P + V (1 − Λ) Vᵀ,     Λ the covariance of ν by the samples, 1 that without them (`removed_of`)

        Returns ν̂ (L, d), with what it is counted from, and 1 − Λ (L, d, d)."""
        size, w = self.size, weights.mean
        nu = np.einsum("tb,btd->td", w, states.nu)
        left = np.einsum("tb,btdk->tdk", weights.positive, states.left) + weights.covariance(states.nu, nu)
        nu, removed, V = nu + about, removed_of(left), np.einsum("tb,btda->tda", w, states.V)
        self.mean[at, :size] += np.einsum("tda,td->ta", V, nu)
        covariance[:, :size, :size] += np.swapaxes(V, 1, 2) @ (removed @ V)
        return nu, removed

    def innovations(
        self, span: slice, weights: Weights, before: tuple[np.ndarray, np.ndarray], passage: Passage
    ) -> None:
        """Of L steps of these numbers: weights of the points before each; before the first, mean (B, 1, d) and covariance
        (B, 1, d, d) of ν by each filter."""
        if self.parameters_alone:
            return
        samples = self.record.data.samples[span]
        L, states = len(samples), passage.states
        slope = passage.slope[:, :L]
        nu, left = (
            np.concatenate([start, each[:, : L - 1]], axis=1)
            for start, each in zip(before, (states.nu, states.left), strict=True)
        )
        foreseen = passage.expected[:, :L] + np.einsum("btmd,btd->btm", slope, nu)
        spread = passage.S[:, :L] + slope @ left @ np.swapaxes(slope, 2, 3)
        expected = np.einsum("tb,btm->tm", weights.mean, foreseen)
        S = np.einsum("tb,btmk->tmk", weights.positive, spread) + weights.covariance(foreseen, expected)
        self.innovation[span] = samples - expected
        measured = np.isfinite(samples)
        # a channel without a sample is one by itself
        S = np.where(measured[:, :, None] & measured[:, None], S, np.eye(S.shape[-1]))
        try:
            factor = np.linalg.cholesky(S)
        except np.linalg.LinAlgError:
            raise NumericalError(
                f"the readings of step {span.start + _first_indefinite(S)} differ in size beyond what a number can hold",
                remedy="check the units and scales of the channels",
            ) from None
        z = np.linalg.solve(factor, np.where(measured, self.innovation[span], 0.0)[..., None])[..., 0]
        self.whitened[span] = np.where(measured, z, np.nan)

    def finished(self) -> FilterRun:
        """As a filter's run, of one run, with σ and covariances that hold what the nuisances add."""
        back = self.back
        return FilterRun(
            time=self.record.model.h * np.arange(self.record.steps + 1),
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
    for t, matrix in enumerate(S):
        try:
            np.linalg.cholesky(matrix)
        except np.linalg.LinAlgError:
            return t
    return 0


def removed_of(left: np.ndarray) -> np.ndarray:
    """1 − Λ (..., d, d): by how much samples that leave ν a covariance of Λ (..., d, d) made it smaller.

    Zero along a direction in which it is larger than before them: parameters that are all still likely ask for different ν.
    """
    removed = np.eye(left.shape[-1]) - left
    try:
        # a factor says in a fourth of the time that there is no such direction
        np.linalg.cholesky(removed + ROUNDING * np.eye(left.shape[-1]))
    except np.linalg.LinAlgError:
        size, axes = np.linalg.eigh(removed)
        removed = (axes * np.maximum(size, 0.0)[..., None, :]) @ np.swapaxes(axes, -1, -2)
    return np.asarray(removed)


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
