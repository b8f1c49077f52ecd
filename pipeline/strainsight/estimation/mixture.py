"""Mixture of the filters at the grid points along the samples, and the posterior of each parameter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Generic, Protocol, TypeVar

import numpy as np

from strainsight.columns import Column
from strainsight.errors import NumericalError
from strainsight.estimation.conditional import conditional_states, inertia_std
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
        """Weights (L, B) of sum one for posterior means."""

    @property
    def positive(self) -> np.ndarray:
        """Nonnegative weights (L, B) of sum one, for quantities that must stay positive."""

    @property
    def log_mass(self) -> np.ndarray:
        """Logarithm of the integral (L,) of the density, up to a constant."""

    def covariance(self, values: np.ndarray, middle: np.ndarray) -> np.ndarray:
        """Posterior covariance (L, n, n) of values (B, L, n) with mean (L, n)."""

    def sampled(self, nu: np.ndarray, left: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Points (b, k) with positive weights (b,) and the posterior moments at the last instant; mean (b, d) and covariance (b,
        d, d) of ν.

        nu (B, d), left (B, d, d): mean and covariance of ν at the grid points."""


class Cover(Protocol):
    """Set of points that represents the posterior of the parameters."""

    @property
    def point(self) -> np.ndarray:
        """(B, k)."""

    @property
    def step(self) -> np.ndarray:
        """Distance of neighbouring points for each parameter (k,); infinite without a grid."""

    def weights(self, log_weight: np.ndarray) -> Weights:
        """Weights of points with log-densities (L, B), up to a constant."""

    def holds(self, log_weight: np.ndarray) -> np.ndarray:
        """Mask (L,): whether these points still represent the posterior."""


C = TypeVar("C", bound=Cover)


@dataclass(frozen=True)
class PosteriorWeights(Generic[C]):
    """Posterior weights of the points after `step` steps: prior and fit (B,), the logarithms of prior and likelihood."""

    SHARED: ClassVar[tuple[str, ...]] = ("cover", "step")

    cover: C
    prior: np.ndarray
    fit: np.ndarray
    step: int

    @property
    def log_weight(self) -> np.ndarray:
        """Log-weights of the points (B,), up to a constant."""
        return self.prior + self.fit

    @property
    def weights(self) -> Weights:
        """Weights at the current instant."""
        return self.cover.weights(self.log_weight[None])


def log_normal(point: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Logarithm (B,) of a normal density at points (B, k), up to a constant."""
    off = point - mean
    return np.asarray(-0.5 * np.sum(off * np.linalg.solve(covariance, off.T).T, axis=1))


ROUNDING = 1e-12
"""Relative to the unit prior covariance of ν: smaller growth is rounding."""
FEW = 8
"""Instants that are decomposed together, where Λ exceeds the prior at one of them."""


class Mixture:
    """Mean and covariance over the grid points along a record; with keep "parameters" other entries are NaN after t = 0, with
    "readings" and no parameters σ of the states."""

    def __init__(self, record: GridRecord, keep: Keep):
        model, steps, n, m = record.model, record.steps, len(record.mean), record.samples.shape[1]
        at = conditional_states(model, len(record.biased))
        self.record, self.size, self.learned = record, len(at), record.considered.learned
        self.parameters_alone, self.readings_alone = keep == "parameters", keep == "readings"
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
        """Add L steps: states of the filters at their ends."""
        after = slice(span.start + 1, span.stop + 1)
        if self.parameters_alone:
            self._parameters(after, weights)
            return
        if weights.point.shape == (1, 0):
            self._states_of_one_filter(span, after, states, models)
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

    def _states_of_one_filter(self, span: slice, after: slice, states: States, models: LinearModels) -> None:
        """Without parameters x̂ and P of L steps need no weights, and no matrix where σ alone is stored:

        x̂ − V ν̂,   P + V Λ Vᵀ   if ν is learned,     x̂ + V a,   P + V Vᵀ   otherwise, a the reference of ν"""
        x, P, V, H = states.x[0], states.P[0], states.V[0], models.H[0]
        nu = states.nu[0] if self.learned else np.broadcast_to(-models.about, states.nu[0].shape)
        mean, read = x - (nu[:, None] @ V)[:, 0], V @ H.T
        self.mean[after] = mean
        self.gauge_mean[span] = mean @ H.T + self.record.data.known_end[span] @ models.F[0].T
        spread = states.left[0] @ read if self.learned else read
        self.gauge_variance[span] = np.sum((H @ P) * H, axis=2) + np.sum(read * spread, axis=1)
        if self.readings_alone:
            return
        spread = states.left[0] @ V if self.learned else V
        self.std[after] = np.sqrt(np.maximum(np.diagonal(P, axis1=1, axis2=2) + np.sum(V * spread, axis=1), 0.0))
        at = self.unknowns
        self.unknown_covariance[after] = P[:, at[:, None], at] + np.swapaxes(V[..., at], 1, 2) @ spread[..., at]
        self.last = P[-1:] + np.swapaxes(V[-1:], 1, 2) @ spread[-1:]
        if self.covariance is not None:
            self.covariance[after] = P + np.swapaxes(V, 1, 2) @ spread

    def begin(self, weights: Weights, states: States, models: LinearModels, informed: bool) -> None:
        """Add the states at t = 0; informed: whether earlier records have updated ν."""
        if self.parameters_alone:
            self._parameters(slice(0, 1), weights)
            return
        covariance = self._moments(slice(0, 1), weights, states)[-1]
        if informed and not self.learned:
            self._motion_as_read(slice(0, 1), weights, states, models.about, covariance)
        self._keep(slice(0, 1), covariance)

    def _parameters(self, at: slice, weights: Weights) -> None:
        """Store mean and σ of the parameters at L instants."""
        point, of = weights.point, slice(self.size, None)
        mean = weights.mean @ point
        each = np.broadcast_to(point[:, None], (len(point), *mean.shape))
        self.mean[at, of], self.std[at, of] = mean, standard_deviation(weights.covariance(each, mean))

    def _moments(
        self, at: slice, weights: Weights, states: States
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Store the mean at L instants; return x (B, L, n), P (b, L, n, n) of the points (b,) with positive weights, and the
        covariance.
        The covariance (L, n + k, n + k) is that of states and parameters."""
        # the estimate of ν corrects all estimates, and its remaining covariance is part of P
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
        """Store σ and covariances (L, n + k, n + k) of states and parameters at L instants."""
        self.std[at], self.last = standard_deviation(covariance), covariance[-1:]
        self.unknown_covariance[at] = covariance[:, self.unknowns[:, None], self.unknowns]
        if self.covariance is not None:
            self.covariance[at] = covariance

    def _motion_as_read(
        self, at: slice, weights: Weights, states: States, about: np.ndarray, covariance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Undo the correction of motion and loads by the mean of ν, and adapt the covariance in place:

            x̂ + V ν̂,     P + V (1 − Λ) Vᵀ,     Λ the posterior covariance of ν, 1 its prior (`removed_of`)

        Returns ν̂ (L, d) and 1 − Λ (L, d, d)."""
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
        """Add the innovations of L steps; weights: before each step. before: mean (B, 1, d) and covariance (B, 1, d, d) of ν
        of each filter before the first step."""
        if self.parameters_alone:
            return
        samples = self.record.data.samples[span]
        L, states = len(samples), passage.states
        slope = passage.slope[:, :L]
        nu = np.concatenate([before[0], states.nu[:, : L - 1]], axis=1)
        foreseen = passage.expected[:, :L] + np.einsum("btmd,btd->btm", slope, nu)
        parts = (slope[:, :1], before[1]), (slope[:, 1:], states.left[:, : L - 1])
        spread = np.concatenate([each @ left @ np.swapaxes(each, 2, 3) for each, left in parts], axis=1)
        spread += passage.S[:, :L]
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
                f"at time step {span.start + _first_indefinite(S)} the readings of the channels differ too much in magnitude for "
                "double precision",
                remedy="check the units and scales of the channels",
            ) from None
        z = np.linalg.solve(factor, np.where(measured, self.innovation[span], 0.0)[..., None])[..., 0]
        self.whitened[span] = np.where(measured, z, np.nan)

    def finished(self) -> FilterRun:
        """The mixture as a filter run; σ and covariances contain the considered parameters."""
        back, record = self.back, self.record
        mean = self.mean[:, back]
        inertia = inertia_std(record.model, record.considered, mean, record.known_at_instants)
        at = record.model.position
        return FilterRun(
            time=record.model.h * np.arange(record.steps + 1),
            mean=mean[:, None],
            std=np.hypot(self.std[:, back], inertia)[:, None],
            unknown_covariance=(self.unknown_covariance + inertia[:, at, None] ** 2 * np.eye(len(at)))[:, None],
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
    """Index of the first of matrices (L, m, m) without a Cholesky factor."""
    for t, matrix in enumerate(S):
        try:
            np.linalg.cholesky(matrix)
        except np.linalg.LinAlgError:
            return t
    return 0


def removed_of(left: np.ndarray) -> np.ndarray:
    """1 − Λ (..., d, d): reduction of the unit prior covariance of ν by the samples. Directions in which Λ exceeds the prior
    are set to zero: points with different ν are still likely."""
    removed = np.eye(left.shape[-1]) - left
    try:
        # a factor says in a fourth of the time that there is no such direction
        np.linalg.cholesky(removed + ROUNDING * np.eye(left.shape[-1]))
    except np.linalg.LinAlgError:
        if removed.ndim > 2 and len(removed) > FEW:
            half = len(removed) // 2
            return np.concatenate([removed_of(left[:half]), removed_of(left[half:])])
        size, axes = np.linalg.eigh(removed)
        removed = (axes * np.maximum(size, 0.0)[..., None, :]) @ np.swapaxes(axes, -1, -2)
    return np.asarray(removed)


VALUES = 401
"""Number of values of a density."""
REACH = 5.0
"""Range of a density: standard deviations about the mean and about each significant point."""
COUNTS = 1e-9
"""Least weight of a significant point."""
KERNEL = 0.7
"""Kernel width in grid steps. A normal density is accurate to 2 exp(−2π² KERNEL²) = 1e-4 of its height; narrow peaks appear
wider."""
VALLEY = 0.5
"""Two peaks are separate if the density between them falls below this share of the lower one,"""
SHARE = 0.01
"""and if each contains at least this probability."""


@dataclass(frozen=True)
class Posterior:
    """Posterior of one parameter, <what>; peaks in ascending order."""

    value: Annotated[np.ndarray, Column("<unit>", "/value", "values of <what>")]
    density: Annotated[np.ndarray, Column("1", "/value", "posterior density of ln <what>")]
    prior: Annotated[np.ndarray, Column("1", "/value", "prior density of ln <what>")]
    left: Annotated[float, Column("1", "", "posterior σ of ln <what> divided by its prior σ")]
    peak: Annotated[np.ndarray, Column("<unit>", "/peak", "values of <what> at the peaks of its posterior density")]
    share: Annotated[np.ndarray, Column("1", "/peak", "posterior probability of <what> near each peak of its density")]


def marginal(point: np.ndarray, weight: np.ndarray, step: float, prior: tuple[float, float]) -> Posterior:
    """Marginal posterior from points (B,) with normalised weights (B,).

    step: grid step along p, infinite without a grid, which gives a normal density; prior: mean and standard deviation of a
    normal prior.

        π(p) = Σ wᵢ N(p; p̄ + a(pᵢ − p̄), h²),     h = KERNEL · step,     a² = 1 − h²/σ²

    The kernels are shrunk towards the mean p̄, which preserves mean and variance σ² of the points. Source: Liu and West, in
    Sequential Monte Carlo Methods in Practice (2001), chapter 10."""
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
    """Peaks of a density (k,) at equally spaced values (k,), and the probability up to the neighbouring valleys."""
    inner = density[1:-1]
    tops = 1 + np.flatnonzero((inner > density[:-2]) & (inner >= density[2:]))
    peaks: list[int] = []
    valleys: list[int] = []
    for top in tops.tolist():
        if peaks:
            low = peaks[-1] + int(np.argmin(density[peaks[-1] : top + 1]))
            if density[low] > VALLEY * min(density[peaks[-1]], density[top]):
                peaks[-1] = max(peaks[-1], top, key=lambda at: float(density[at]))
                continue
            valleys.append(low)
        peaks.append(top)
    mass = np.array([part.sum() for part in np.split(density, valleys)]) / density.sum()
    large = mass >= SHARE
    return value[peaks][large], mass[large]
