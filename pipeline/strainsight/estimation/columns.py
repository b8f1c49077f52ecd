"""The posterior of many parameters: a line of points along its weakest direction, and a normal density across each of them.

    p(θ | y) ≈ Σⱼ Wⱼ N(cⱼ + A mⱼ, A Cⱼ Aᵀ)

About the largest density of each column its logarithm is a parabola, by second differences (Laplace); along the line it is what
it is. A lattice over k parameters has some 7ᵏ points, columns have 9 (k − 1)².
Source: Tierney and Kadane, J. American Statistical Association 81 (1986)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from strainsight.errors import NumericalError
from strainsight.estimation.grid_filter_points import GridProblem, WeightedFilters, filter_points, refuse_lost
from strainsight.estimation.parallel_filters import concatenate
from strainsight.estimation.parameter_grid import DEPTH, LEFT, NARROW, SPACING

FINE = 0.1
"""Step of the differences, in standard deviations across a column."""
CENTRED = 0.3
"""A new column is within so many standard deviations of its maximum."""
OFF = 1.0
"""Largest distance of a column from its maximum in standard deviations; at least half a standard deviation more than initially.
"""
WIDE = 4.0
"""Largest variance relative to the construction; the least is NARROW, or half of the initial one."""
CLOSE = 0.5, 2.0
"""Relative variances within which differences are not repeated."""
STRIDE = 3.0
"""Largest step towards the maximum in standard deviations."""
MOST_TURNS = 60
"""Most steps towards the maximum."""
LEVEL = 1e-6
"""Decrease of the log-density from which a step counts as downhill."""
FEW_TURNS = 5
"""Most steps for one column."""
MOST_COLUMNS = 60
TIE = 1e-3
"""Directions whose shares of the prior variance differ by less are equally weak; the one closest to the first parameter is used.
"""


@dataclass(frozen=True)
class ColumnLimits:
    """Validity of columns: off, distance of their maxima; narrow and wide, the variance across; short, that along the line,
    relative to the construction."""

    off: float = OFF
    narrow: float = NARROW
    wide: float = WIDE
    short: float = NARROW


@dataclass(frozen=True)
class Columns:
    """J columns about centre (J, k): across (k, c), their standard deviations; precision (k, k) of the prior; limits of
    validity.

    Points of a column: its centre, FINE times each of ± the c axes, and of ± the sum of two of them."""

    centre: np.ndarray
    across: np.ndarray
    precision: np.ndarray
    limits: ColumnLimits = ColumnLimits()

    @cached_property
    def stencil(self) -> np.ndarray:
        """Stencil (S, c) in standard deviations."""
        axes = np.eye(self.across.shape[1])
        pairs = [axes[i] + axes[j] for i, j in self._pairs]
        ends = np.array([*axes, *pairs]).reshape(-1, len(axes))
        return FINE * np.concatenate([np.zeros((1, len(axes))), ends, -ends])

    @property
    def _pairs(self) -> list[tuple[int, int]]:
        return [(i, j) for i in range(self.across.shape[1]) for j in range(i)]

    @property
    def point(self) -> np.ndarray:
        """Points (J S, k), column by column."""
        return np.asarray((self.centre[:, None] + self.stencil @ self.across.T).reshape(-1, self.centre.shape[1]))

    @property
    def step(self) -> np.ndarray:
        """Infinite (k,): columns provide only mean and variance of a parameter."""
        return np.full(self.centre.shape[1], np.inf)

    def weights(self, log_weight: np.ndarray) -> ColumnWeights:
        """Of points with log-densities (L, B): the parabola of each column,

            ln p ≈ a + gᵀy − ½ yᵀΛy,     m = Λ⁻¹g,   C = Λ⁻¹,   ln W = a + ½ gᵀm + ½ ln |C|

        nowhere less curved than the prior alone, to which a likelihood of one peak adds."""
        c, at_centre = self.across.shape[1], log_weight.reshape(len(log_weight), len(self.centre), -1)
        a, (ahead, behind) = at_centre[..., 0], np.split(at_centre[..., 1:], 2, axis=-1)
        g = (ahead - behind)[..., :c] / (2 * FINE)
        bent = (ahead + behind - 2 * a[..., None]) / FINE**2
        H = np.zeros((*a.shape, c, c))
        H[..., range(c), range(c)] = bent[..., :c]
        for value, (i, j) in zip(np.moveaxis(bent[..., c:], -1, 0), self._pairs, strict=True):
            H[..., i, j] = H[..., j, i] = 0.5 * (value - bent[..., i] - bent[..., j])
        prior = self.across.T @ self.precision @ self.across
        added, axes = np.linalg.eigh(-H - prior)
        curvature = prior + (axes * np.maximum(added, 0.0)[..., None, :]) @ np.swapaxes(axes, -1, -2)
        C = np.linalg.inv(curvature)
        m = (C @ g[..., None])[..., 0]
        log_mass = a + 0.5 * np.sum(g * m, axis=-1) + 0.5 * np.linalg.slogdet(C)[1]
        return ColumnWeights(self, log_mass, m, C)

    def holds(self, log_weight: np.ndarray) -> np.ndarray:
        """Whether the posterior of log-weights (L, B) is still within the columns and as wide."""
        weights, limits = self.weights(log_weight), self.limits
        size, mass = np.linalg.eigvalsh(weights.C), weights.column_mass
        fits = (np.abs(weights.m).max(axis=2) <= limits.off) & (size[..., 0] >= limits.narrow)
        fits &= size[..., -1] <= limits.wide
        ends = mass[:, [0, -1]].max(axis=1) < mass.max(axis=1) - LEFT
        return np.asarray((fits | ~weights.heavy).all(axis=1) & (weights.along >= limits.short) & ends)

    def as_they_are(self, log_weight: np.ndarray) -> Columns:
        """The columns with limits that they satisfy at log-weights (B,)."""
        weights = self.weights(log_weight[None])
        size = np.linalg.eigvalsh(weights.C[weights.heavy])
        off, narrow = max(OFF, np.abs(weights.m[weights.heavy]).max() + 0.5), min(NARROW, 0.5 * size[:, 0].min())
        wide, short = max(WIDE, 2 * size[:, -1].max()), min(NARROW, 0.5 * weights.along[0])
        return replace(self, limits=ColumnLimits(off, narrow, wide, short))


@dataclass(frozen=True)
class ColumnWeights:
    """Weights of J columns at L instants: column_mass (L, J): logarithm of W, up to a constant; m (L, J, c) and C (L, J, c,
    c)."""

    of: Columns
    column_mass: np.ndarray
    m: np.ndarray
    C: np.ndarray

    @property
    def point(self) -> np.ndarray:
        return self.of.point

    @property
    def log_mass(self) -> np.ndarray:
        return np.asarray(logsumexp(self.column_mass, axis=1))

    @cached_property
    def column(self) -> np.ndarray:
        """Normalised W (L, J)."""
        return np.exp(self.column_mass - self.log_mass[:, None])

    @property
    def heavy(self) -> np.ndarray:
        """Mask (L, J) of columns within exp(−LEFT) of the heaviest."""
        return np.asarray(self.column_mass > self.column_mass.max(axis=1, keepdims=True) - LEFT)

    @property
    def along(self) -> np.ndarray:
        """Variance (L,) along the line, in columns."""
        place = np.arange(self.column.shape[1])
        return np.asarray(np.sum(self.column * (place - (self.column @ place)[:, None]) ** 2, axis=1))

    @cached_property
    def mean(self) -> np.ndarray:
        """W (f₀ + Σᵢ mᵢ (f₊ − f₋)/2δ) of every column."""
        (L, J), c = self.column.shape, self.m.shape[-1]
        w = np.zeros((L, J, len(self.of.stencil)))
        middle = 1 + len(self.of.stencil) // 2
        w[..., 0] = self.column
        w[..., 1 : 1 + c] = self.column[..., None] * self.m / (2 * FINE)
        w[..., middle : middle + c] = -w[..., 1 : 1 + c]
        return w.reshape(L, -1)

    @cached_property
    def positive(self) -> np.ndarray:
        """Weights of the centres."""
        w = np.zeros((*self.column.shape, len(self.of.stencil)))
        w[..., 0] = self.column
        return w.reshape(len(w), -1)

    def covariance(self, values: np.ndarray, middle: np.ndarray) -> np.ndarray:
        """Σ W ((f − f̄)(f − f̄)ᵀ + F C Fᵀ), f at the columns' means and F the slopes across them."""
        at_centre, slope = self._linear(values)
        off = at_centre + np.einsum("tjc,jctn->jtn", self.m, slope) - middle
        among = np.einsum("tj,jtn,jtk->tnk", self.column, off, off, optimize=True)
        return np.asarray(among + np.einsum("tj,tjcd,jctn,jdtk->tnk", self.column, self.C, slope, slope, optimize=True))

    def sampled(self, nu: np.ndarray, left: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Points by the cubature rule of degree three on each column."""
        of, (J, c) = self.of, self.m.shape[1:]
        ends = np.sqrt(c) * np.swapaxes(np.linalg.cholesky(self.C[-1]), 1, 2)
        y = self.m[-1, :, None] + np.concatenate([ends, -ends], axis=1)
        point = of.centre[:, None] + y @ of.across.T
        at_centre, slope = self._linear(nu[:, None])
        mean = at_centre + y @ slope[:, :, 0]
        weight = np.repeat(self.column[-1] / (2 * c), 2 * c)
        covariance = np.repeat(left[:: len(of.stencil)], 2 * c, axis=0)
        return point.reshape(J * 2 * c, -1), weight, mean.reshape(J * 2 * c, -1), covariance

    def _linear(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (B, L, n) at the centres (J, L, n), and their slopes per standard deviation across (J, c, L, n)."""
        each = values.reshape(len(self.of.centre), len(self.of.stencil), *values.shape[1:])
        c, middle = self.m.shape[-1], 1 + len(self.of.stencil) // 2
        return each[:, 0], (each[:, 1 : 1 + c] - each[:, middle : middle + c]) / (2 * FINE)


def rebuild_columns(problem: GridProblem, now: WeightedFilters[Columns]) -> WeightedFilters[Columns]:
    """Columns for the current posterior."""
    weights, point = _weights(now), now.cover.point
    middle = weights.mean[0] @ point
    return build_columns(problem, middle, weights.covariance(point[:, None], middle)[0], now.step)


def build_columns(
    problem: GridProblem, mean: np.ndarray, covariance: np.ndarray, step: int
) -> WeightedFilters[Columns]:
    """Columns about the maximum after `step` steps, searched from a guess: as many as the posterior extends along its weakest
    direction, each about its own maximum."""
    mean, covariance = _summit(problem, mean, covariance, step)
    along, across = weakest(covariance, problem.prior[1])
    stride = SPACING * along
    parts = [_centre_column(problem, mean, across, step)]
    top = _weights(parts[0]).column_mass[0, 0]
    for forward in (True, False):
        while True:
            # a bent ridge is followed
            end = parts[-1 if forward else 0].cover.centre[0]
            neighbour = end - (stride if forward else -stride)
            if len(parts) > 1:
                neighbour = parts[-2 if forward else 1].cover.centre[0]
            part = _centre_column(problem, 2 * end - neighbour, across, step)
            parts = [*parts, part] if forward else [part, *parts]
            mass = _weights(part).column_mass[0, 0]
            top = max(top, mass)
            if mass < top - DEPTH:
                break
            if len(parts) > MOST_COLUMNS:
                raise NumericalError(
                    f"the parameter grid needs more than {MOST_COLUMNS} grid lines to cover the posterior of the parameters",
                    remedy="the measurements hardly distinguish the parameters: estimate fewer parameters, or reduce their "
                    "initial standard deviation (estimate.initial_std, validate.initial_std)",
                )
    cover = Columns(np.concatenate([part.cover.centre for part in parts]), across, parts[0].cover.precision)
    whole = concatenate(parts)
    return replace(whole, cover=cover.as_they_are(whole.log_weight))


def _summit(problem: GridProblem, mean: np.ndarray, covariance: np.ndarray, step: int) -> tuple[np.ndarray, np.ndarray]:
    """Maximum of the density and its covariance there, by Newton's method with halved steps."""
    precision = np.linalg.inv(problem.prior[1])
    start, top, move = mean, -np.inf, np.zeros(len(mean))
    for _ in range(MOST_TURNS):
        now = filter_points(problem, Columns(mean[None], np.linalg.cholesky(covariance), precision), step)
        if now.log_weight[0] < top - LEVEL:
            move = 0.5 * move
            mean = start + move
            continue
        weights, across = _weights(now), now.cover.across
        m, C = weights.m[0, 0], weights.C[0, 0]
        size, covariance = np.linalg.eigvalsh(C), across @ C @ across.T
        if CLOSE[0] <= size[0] and size[-1] <= CLOSE[1] and np.abs(m).max() <= CENTRED:
            return mean, covariance
        start, top = mean, now.log_weight[0]
        move = across @ m * min(1.0, STRIDE / np.abs(m).max())
        mean = start + move
        refuse_lost(problem, mean)
    raise NumericalError(
        f"the search for the most likely parameter values did not converge in {MOST_TURNS} steps",
        remedy="increase the noise of the gauges (gauges.noise_std, estimate.channels.*.noise_std), or reduce the initial "
        "standard deviation of the parameters (estimate.initial_std, validate.initial_std)",
    )


def _centre_column(problem: GridProblem, centre: np.ndarray, across: np.ndarray, step: int) -> WeightedFilters[Columns]:
    """A column about its maximum, as far as a few steps reach it."""
    precision = np.linalg.inv(problem.prior[1])
    for _ in range(FEW_TURNS):
        now = filter_points(problem, Columns(centre[None], across, precision), step)
        m = _weights(now).m[0, 0]
        if np.abs(m).max() <= CENTRED:
            break
        centre = centre + across @ m * min(1.0, STRIDE / np.abs(m).max())
    return now


def _weights(now: WeightedFilters[Columns]) -> ColumnWeights:
    return now.cover.weights(now.log_weight[None])


def weakest(covariance: np.ndarray, prior: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """f (k,) and A (k, k − 1) with f fᵀ + A Aᵀ the covariance (k, k), f along the direction whose variance is the largest share
    of the prior's (k, k)."""
    k = len(covariance)
    factor = np.linalg.cholesky(prior)
    whitened = np.linalg.solve(factor, np.linalg.solve(factor, covariance).T)
    share, axes = np.linalg.eigh(0.5 * (whitened + whitened.T))
    equal = axes[:, share >= (1 - TIE) * share[-1]]
    reach = np.linalg.norm(equal, axis=1)
    which = int(np.argmax(reach >= reach.max() - TIE))
    w = np.linalg.solve(factor.T, equal @ equal[which])
    f = covariance @ w / np.sqrt(w @ covariance @ w)
    # Householder's reflection of the first axis to f, in units of the covariance
    L = np.linalg.cholesky(covariance)
    u = np.linalg.solve(L, f)
    sign = 1.0 if u[0] > -TIE else -1.0
    v = u + sign * np.eye(k)[0]
    mirror = np.eye(k) - 2 * np.outer(v, v) / (v @ v)
    return f, L @ mirror[:, 1:]
