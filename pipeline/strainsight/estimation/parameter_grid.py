"""Parameter grid that covers a density, its construction, and moments by the trapezoidal rule."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.mixture import PosteriorWeights
from strainsight.estimation.parallel_filters import concatenate
from strainsight.mesh.coincident import component_labels

SPACING = 1.0
"""Grid spacing in standard deviations of the posterior."""
DEPTH = 6.0
"""All points within exp(−DEPTH) of the largest density get all their neighbours when the grid is built."""
LEFT = 3.5
"""The grid no longer covers a density that exceeds exp(−LEFT) of its maximum at the edge,"""
NARROW = 0.5
"""or whose variance has fallen to this share of that of the construction in some direction,"""
SHARP = 0.25
"""or whose highest peak has, along an axis of the grid: then sums are accurate to 1e-2 of σ."""


@dataclass(frozen=True)
class ParameterGrid:
    """B points p = centre + frame z at integers z. centre (k,), frame (k, k), node z (B, k); spacing: between neighbours, in
    standard deviations of the construction; sharp: smallest variance of the highest peak that the grid resolves. The
    trapezoidal sum of a smooth density that vanishes at the edge is far more accurate than the spacing: for a normal density
    of standard deviation σ the error is 2 exp(−2π²σ²/h²), 5e-9 at h = σ. Source: Trefethen and Weideman, SIAM Review 56
    (2014)."""

    centre: np.ndarray
    frame: np.ndarray
    node: np.ndarray
    spacing: float = 1.0
    sharp: float = SHARP

    @property
    def point(self) -> np.ndarray:
        """(B, k)."""
        return self.centre + self.node @ self.frame.T

    @property
    def step(self) -> np.ndarray:
        """Distance of neighbouring points along each coordinate (k,), RMS over the grid axes."""
        return np.asarray(np.linalg.norm(self.frame, axis=1))

    @cached_property
    def neighbour(self) -> np.ndarray:
        """Index of the next point ahead and behind along each axis (B, 2, k); −1 if missing."""
        k = self.node.shape[1]
        nodes = [tuple(z) for z in self.node.tolist()]
        index = {z: i for i, z in enumerate(nodes)}
        neighbours = [index.get((*z[:a], z[a] + s, *z[a + 1 :]), -1) for z in nodes for s in (1, -1) for a in range(k)]
        return np.array(neighbours, dtype=int).reshape(len(nodes), 2, k)

    @property
    def edge(self) -> np.ndarray:
        """Mask (B,) of points with a neighbour outside the grid."""
        return np.asarray((self.neighbour < 0).any(axis=(1, 2)))

    def missing_neighbours(self, which: np.ndarray) -> np.ndarray:
        """Neighbours z (any, k) of the selected points (B,) bool that are not in the grid, sorted."""
        present, unit = {tuple(z) for z in self.node.tolist()}, np.eye(self.node.shape[1], dtype=int)
        wanted = {tuple(z) for way in (*unit, *-unit) for z in (self.node[which] + way).tolist()} - present
        return np.array(sorted(wanted), dtype=int).reshape(-1, self.node.shape[1])

    def width(self, log_weight: np.ndarray) -> np.ndarray:
        """Variance (..., k) of a density at its largest point, along the axes in units of the grid steps. From second
        differences of the logarithm (..., B): exact for a normal density, infinite if they do not fall or are unknown. For
        several peaks it is the variance of the highest one."""
        best = np.argmax(log_weight, axis=-1)
        neighbour = self.neighbour[best]
        values = np.take_along_axis(log_weight, neighbour.reshape(*best.shape, -1), axis=-1).reshape(neighbour.shape)
        values = np.where((neighbour >= 0) & np.isfinite(values), values, np.inf)
        top = np.take_along_axis(log_weight, best[..., None], axis=-1)
        drop = top - 0.5 * (values[..., 0, :] + values[..., 1, :])
        return np.asarray(np.where(drop > 0, 0.5 / np.where(drop > 0, drop, 1.0), np.inf))

    def weights(self, log_weight: np.ndarray) -> GridWeights:
        """Weights of points with log-densities (L, B)."""
        largest = log_weight.max(axis=-1, keepdims=True)
        w = np.exp(log_weight - largest)
        mass = w.sum(axis=-1, keepdims=True)
        return GridWeights(self.point, w / mass, (largest + np.log(mass))[..., 0])

    def holds(self, log_weight: np.ndarray) -> np.ndarray:
        """Mask of instants at which the grid still covers the density of log-weights (..., B): neither too narrow nor at the
        edge."""
        _, _, covariance = moments(self.point, log_weight)
        all_of_it = self.spread(covariance).min(axis=-1, initial=np.inf)
        highest = self.width(log_weight).min(axis=-1, initial=np.inf)
        wide = (all_of_it * self.spacing**2 >= NARROW) & (highest * self.spacing**2 >= self.sharp)
        edge = np.max(log_weight[..., self.edge], axis=-1, initial=-np.inf)
        return np.asarray(wide & (edge < log_weight.max(axis=-1) - LEFT))

    def peaks(self, log_weight: np.ndarray, depth: float) -> list[np.ndarray]:
        """Connected sets of points within exp(−depth) of the largest density, as indices, highest peak first."""
        heavy, ahead = log_weight > log_weight.max() - depth, self.neighbour[:, 0]
        i, axis = np.nonzero(heavy[:, None] & (ahead >= 0) & heavy[ahead])
        label = component_labels(len(heavy), i, ahead[i, axis])
        falling = np.argsort(-log_weight)
        return [
            np.flatnonzero(heavy & (label == peak)) for peak in dict.fromkeys(label[falling][heavy[falling]].tolist())
        ]

    def nearest(self, point: np.ndarray) -> np.ndarray:
        """Nodes (any, k) nearest to points (q, k), sorted."""
        z = np.rint(np.linalg.solve(self.frame, (point - self.centre).T).T).astype(int)
        return np.unique(z, axis=0)

    def spread(self, covariance: np.ndarray) -> np.ndarray:
        """Eigenvalues (k,) of a covariance (..., k, k) of p in units of the grid steps."""
        inverse = np.linalg.inv(self.frame)
        return np.linalg.eigvalsh(inverse @ covariance @ inverse.T)

    def with_nodes(self, node: np.ndarray) -> ParameterGrid:
        """The grid with additional nodes (any, k), as far as they are missing."""
        present = {tuple(z) for z in self.node.tolist()}
        new = [z for z in node.tolist() if tuple(z) not in present]
        return self.grown(np.array(new, dtype=int).reshape(-1, self.node.shape[1]))

    def grown(self, node: np.ndarray) -> ParameterGrid:
        """The grid with more nodes appended."""
        return replace(self, node=np.concatenate([self.node, node]))


@dataclass(frozen=True)
class GridWeights:
    """Weights of B points (B, k) at L instants: mean (L, B), all positive; log_mass (L,) of the density, up to a constant."""

    point: np.ndarray
    mean: np.ndarray
    log_mass: np.ndarray

    @property
    def positive(self) -> np.ndarray:
        return self.mean

    def covariance(self, values: np.ndarray, middle: np.ndarray) -> np.ndarray:
        off = np.swapaxes(values - middle, 0, 1)
        return np.asarray(np.swapaxes(off * self.mean[..., None], 1, 2) @ off)

    def sampled(self, nu: np.ndarray, left: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        return self.point, self.mean[-1], nu, left


def build_grid_about(mean: np.ndarray, covariance: np.ndarray, spacing: float, radius: float) -> ParameterGrid:
    """All points within `radius` standard deviations of a mean (k,) with covariance (k, k), at a distance of `spacing`."""
    k, most = len(mean), int(radius / spacing)
    wide = 2 * most + 1
    cube = np.indices((wide,) * k).reshape(k, wide**k).T - most
    ball = cube[spacing**2 * np.sum(cube**2, axis=1) <= radius**2]
    return ParameterGrid(np.asarray(mean, dtype=float), spacing * np.linalg.cholesky(covariance), ball, spacing)


def one_point(point: np.ndarray) -> ParameterGrid:
    """Grid of a single point (k,)."""
    k = len(point)
    return ParameterGrid(point, np.eye(k), np.zeros((1, k), dtype=int))


def scattered_points(point: np.ndarray) -> ParameterGrid:
    """Points (B, k) without grid structure."""
    k = point.shape[1]
    return ParameterGrid(np.zeros(k), np.eye(k), point)


def moments(point: np.ndarray, log_weight: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normalised weights (..., B), mean (..., k) and covariance (..., k, k) of points (B, k) with log-weights (..., B)."""
    w = np.exp(log_weight - log_weight.max(axis=-1, keepdims=True))
    w /= w.sum(axis=-1, keepdims=True)
    mean = w @ point
    off = point - mean[..., None, :]
    return w, mean, np.swapaxes(off * w[..., None], -1, -2) @ off


FRESH = 0.4
"""Least variance of the highest peak of a new grid, as a share of that of the construction."""
COLLAPSED = 0.1
"""Share below which the grid is too coarse for the covariance of the posterior."""
PATIENCE = 4
"""Layers added uphill before a wider grid is built there."""
MOST_POINTS = 4000
MOST_FINE = 1000
"""Most points of a refined grid. Beyond, the grid stays, and the posterior of a long narrow crescent is accurate to a tenth of
its σ."""
MOST_LAID = 60
"""Most grids until one resolves the posterior."""


S = TypeVar("S", bound=PosteriorWeights[ParameterGrid])


@dataclass(frozen=True)
class GridConstruction(Generic[S]):
    """Inputs of the grid construction. prior: mean (k,) and covariance (k, k); at: grid, step → filters at its points after
    that step; refuse_lost: raises for an implausible point (k,); most: largest number of points; peak_points (q, k): points
    that all grids but the first have to contain."""

    prior: tuple[np.ndarray, np.ndarray]
    at: Callable[[ParameterGrid, int], S]
    refuse_lost: Callable[[np.ndarray], None]
    most: int = MOST_POINTS
    peak_points: np.ndarray | None = None


class _TooMany(NumericalError):
    """The grid needs more points than allowed."""


def build_first_grid(construction: GridConstruction[S]) -> S:
    """Grid for the prior."""
    return _build_and_filter(construction, *construction.prior, 0)


def _build_and_filter(
    construction: GridConstruction[S],
    mean: np.ndarray,
    covariance: np.ndarray,
    step: int,
    other: np.ndarray | None = None,
    most: int | None = None,
) -> S:
    """A grid about a guess of the posterior after `step` steps, grown until it covers it, with the filters at its points. If
    the largest density stays at the edge, the grid is built about that point, three times as wide. other (q, k): points of
    other peaks to be covered."""
    construction.refuse_lost(mean)
    most = min(construction.most, most or construction.most)
    grid = _build_grid(construction, mean, covariance, other)
    parts, outside = [construction.at(grid, step)], 0
    while True:
        log_weight, edge = np.concatenate([part.log_weight for part in parts]), grid.edge
        heavy = edge & (log_weight > log_weight.max() - DEPTH)
        if not heavy.any():
            return parts[0] if len(parts) == 1 else replace(concatenate(parts), cover=grid)
        best = int(np.argmax(log_weight))
        outside = outside + 1 if edge[best] else 0
        if outside > PATIENCE:
            centre, covariance = grid.point[best], 9 * covariance
            construction.refuse_lost(centre)
            grid = _build_grid(construction, centre, covariance, other)
            parts, outside = [construction.at(grid, step)], 0
            continue
        more = replace(grid, node=grid.missing_neighbours(heavy))
        if len(grid.node) + len(more.node) > most:
            raise _TooMany(
                f"the posterior distribution of the parameters needs more than {most} grid points",
                remedy="the measurements hardly distinguish the parameters: estimate fewer parameters, or reduce their "
                "initial standard deviation (estimate.initial_std, validate.initial_std; estimate.parameters.*.std of a bench)",
            )
        grid = grid.grown(more.node)
        parts.append(construction.at(more, step))


def _build_grid(
    construction: GridConstruction[S], mean: np.ndarray, covariance: np.ndarray, other: np.ndarray | None
) -> ParameterGrid:
    """Grid about a guess, with the nodes nearest to other points (q, k)."""
    grid = build_grid_about(mean, covariance, SPACING, np.sqrt(2 * DEPTH))
    return grid if other is None or not len(other) else grid.with_nodes(grid.nearest(other))


def build_next_grid(construction: GridConstruction[S], now: S) -> S:
    """Grid for the current posterior, by way of finer grids for a power of its density if the old grid is too coarse. Raises
    NumericalError if no grid resolves the posterior."""
    for _ in range(MOST_LAID):
        share, grid = 1.0, now.cover
        while True:
            top = float(now.log_weight.max())
            # beyond the digits of a logarithm no depth of a lattice is left below its largest value
            if not np.isfinite(now.log_weight).any() or not top - DEPTH < top:
                raise NumericalError(
                    "the readings are larger than the model can produce with any parameter values",
                    remedy="check the units and scales of the channels",
                )
            first, *others = grid.peaks(share * now.log_weight, DEPTH)
            mean, covariance, narrow = _spread(construction, grid, first, share * now.log_weight[first])
            if narrow >= COLLAPSED:
                break
            share *= 0.5
        if share < 1.0:
            covariance = min(1.0, NARROW / narrow) * covariance
        other = grid.point[np.concatenate(others)] if others else grid.point[:0]
        if construction.peak_points is not None:
            other = np.concatenate([other, construction.peak_points])
        now = _build_and_filter(construction, mean, covariance, now.step, other)
        if share == 1.0:
            return _refine_grid(construction, now, other)
    raise NumericalError(
        f"the parameter grid does not resolve the posterior distribution of the parameters after {MOST_LAID} refinements",
        remedy="increase the noise of the sensors (gauges.noise_std; estimate.sensors.*.noise of a bench), or reduce the initial "
        "standard deviation of the parameters (estimate.initial_std; estimate.parameters.*.std of a bench)",
    )


def _spread(
    construction: GridConstruction[S], grid: ParameterGrid, which: np.ndarray, log_weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean and covariance for the next grid from points (q,) of this one, and the least variance in grid steps. The
    covariance is the smaller of that of the density and twice that of its square. They agree for a normal density; for a
    curved one the second is closer to that at the peak."""

    def least(covariance: np.ndarray) -> float:
        return float(grid.spread(covariance).min(initial=np.inf) * SPACING**2)

    _, mean, plain = moments(grid.point[which], log_weight)
    squared = 2 * moments(grid.point[which], 2 * log_weight)[2]
    if COLLAPSED <= least(squared) < least(plain):
        return mean, squared, least(squared)
    return mean, plain, least(plain)


def _refine_grid(construction: GridConstruction[S], now: S, other: np.ndarray) -> S:
    """The grid refined to its highest peak, as far as MOST_FINE allows."""
    for _ in range(MOST_LAID):
        narrow = now.cover.width(now.log_weight).min(initial=np.inf) * SPACING**2
        if narrow >= FRESH:
            return now
        frame = now.cover.frame / now.cover.spacing
        covariance = narrow / (2 * SHARP) * frame @ frame.T
        # far from the middle of a lattice that has moved on the way, or that is much too coarse
        middle = now.cover.centre if narrow >= COLLAPSED else now.cover.point[int(np.argmax(now.log_weight))]
        try:
            now = _build_and_filter(construction, middle, covariance, now.step, other, MOST_FINE)
        except _TooMany:
            break
    return replace(now, cover=replace(now.cover, sharp=min(SHARP, 0.5 * narrow)))
