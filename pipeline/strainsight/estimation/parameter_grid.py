"""A lattice of points that covers a density, grown until it holds it, and its moments by the trapezoidal rule."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.mixture import PosteriorWeights
from strainsight.estimation.parallel_filters import joined
from strainsight.mesh.unjoined import component_labels

SPACING = 1.0
"""Of a lattice, in standard deviations of the posterior it was laid for."""
DEPTH = 6.0
"""A point whose density is within exp(−DEPTH) of the largest has all its neighbours in a lattice, when it is laid."""
LEFT = 3.5
"""Where a point at its edge is within exp(−LEFT) of the largest density, a lattice no longer holds it;"""
NARROW = 0.5
"""nor where its variance has fallen to this share, of the one that the lattice was laid for, in some direction;"""
SHARP = 0.25
"""nor where that of its highest peak has, along an axis of the lattice: with it sums are right to 1e-2 of σ."""


@dataclass(frozen=True)
class ParameterGrid:
    """B points  p = centre + frame z  at integers z: centre (k,), frame (k, k), node z (B, k). spacing: of neighbours, in
    standard deviations of what it was laid for; sharp: the least variance of the highest peak that it is good for.

    A sum over such points integrates a smooth density that has died away at their edge to far better than its spacing: of a
    normal density of standard deviation σ the error is 2 exp(−2π²σ²/h²), 5e-9 at h = σ.
    Source: Trefethen and Weideman, SIAM Review 56 (2014).
    """

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
        """From point to point along every coordinate (k,), RMS over the axes of the lattice together."""
        return np.asarray(np.linalg.norm(self.frame, axis=1))

    @cached_property
    def neighbour(self) -> np.ndarray:
        """Of every point the next ones along the axes (B, 2, k), ahead and behind; −1 where there is none."""
        k = self.node.shape[1]
        nodes = [tuple(z) for z in self.node.tolist()]
        index = {z: i for i, z in enumerate(nodes)}
        neighbours = [index.get((*z[:a], z[a] + s, *z[a + 1 :]), -1) for z in nodes for s in (1, -1) for a in range(k)]
        return np.array(neighbours, dtype=int).reshape(len(nodes), 2, k)

    @property
    def edge(self) -> np.ndarray:
        """Which points (B,) have a neighbour that is not in the lattice."""
        return np.asarray((self.neighbour < 0).any(axis=(1, 2)))

    def beside(self, which: np.ndarray) -> np.ndarray:
        """Neighbours z (any, k) of some points (B,) of bool that are not in the lattice, each once, in order."""
        present, unit = {tuple(z) for z in self.node.tolist()}, np.eye(self.node.shape[1], dtype=int)
        wanted = {tuple(z) for way in (*unit, *-unit) for z in (self.node[which] + way).tolist()} - present
        return np.array(sorted(wanted), dtype=int).reshape(-1, self.node.shape[1])

    def width(self, log_weight: np.ndarray) -> np.ndarray:
        """Variance (..., k) of a density about its largest point, along the axes in units of the lattice's own steps, from the
        second differences of its logarithm (..., B): exact for a normal one, infinite where they do not fall or are not known.

        Of a density with several peaks it is that of the highest, which the covariance of all hides.
        """
        best = np.argmax(log_weight, axis=-1)
        beside = self.neighbour[best]
        values = np.take_along_axis(log_weight, beside.reshape(*best.shape, -1), axis=-1).reshape(beside.shape)
        values = np.where((beside >= 0) & np.isfinite(values), values, np.inf)
        top = np.take_along_axis(log_weight, best[..., None], axis=-1)
        drop = top - 0.5 * (values[..., 0, :] + values[..., 1, :])
        return np.asarray(np.where(drop > 0, 0.5 / np.where(drop > 0, drop, 1.0), np.inf))

    def weights(self, log_weight: np.ndarray) -> GridWeights:
        """Of points with log-densities (L, B)."""
        largest = log_weight.max(axis=-1, keepdims=True)
        w = np.exp(log_weight - largest)
        mass = w.sum(axis=-1, keepdims=True)
        return GridWeights(self.point, w / mass, (largest + np.log(mass))[..., 0])

    def holds(self, log_weight: np.ndarray) -> np.ndarray:
        """Whether it still holds the density of log-weights (..., B): not too narrow for it, nor at its edge."""
        _, _, covariance = moments(self.point, log_weight)
        all_of_it = self.spread(covariance).min(axis=-1, initial=np.inf)
        highest = self.width(log_weight).min(axis=-1, initial=np.inf)
        wide = (all_of_it * self.spacing**2 >= NARROW) & (highest * self.spacing**2 >= self.sharp)
        edge = np.max(log_weight[..., self.edge], axis=-1, initial=-np.inf)
        return np.asarray(wide & (edge < log_weight.max(axis=-1) - LEFT))

    def peaks(self, log_weight: np.ndarray, depth: float) -> list[np.ndarray]:
        """Points within exp(−depth) of the largest density that hang together, indices by peak, the highest first."""
        heavy, ahead = log_weight > log_weight.max() - depth, self.neighbour[:, 0]
        i, axis = np.nonzero(heavy[:, None] & (ahead >= 0) & heavy[ahead])
        label = component_labels(len(heavy), i, ahead[i, axis])
        falling = np.argsort(-log_weight)
        return [
            np.flatnonzero(heavy & (label == peak)) for peak in dict.fromkeys(label[falling][heavy[falling]].tolist())
        ]

    def nearest(self, point: np.ndarray) -> np.ndarray:
        """Nodes (any, k) nearest to points (q, k), each once, in order."""
        z = np.rint(np.linalg.solve(self.frame, (point - self.centre).T).T).astype(int)
        return np.unique(z, axis=0)

    def spread(self, covariance: np.ndarray) -> np.ndarray:
        """Eigenvalues (k,) of a covariance (..., k, k) of p in units of the lattice's own steps."""
        inverse = np.linalg.inv(self.frame)
        return np.linalg.eigvalsh(inverse @ covariance @ inverse.T)

    def with_nodes(self, node: np.ndarray) -> ParameterGrid:
        """With those of some nodes (any, k) that it does not have yet."""
        present = {tuple(z) for z in self.node.tolist()}
        new = [z for z in node.tolist() if tuple(z) not in present]
        return self.grown(np.array(new, dtype=int).reshape(-1, self.node.shape[1]))

    def grown(self, node: np.ndarray) -> ParameterGrid:
        """With more nodes, behind the others."""
        return replace(self, node=np.concatenate([self.node, node]))


@dataclass(frozen=True)
class GridWeights:
    """Of B points (B, k) at L instants: mean (L, B), all positive; log_mass (L,) of the density, but for a constant."""

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
    """All points within `radius` standard deviations of a mean (k,) with covariance (k, k), `spacing` of them apart."""
    k, most = len(mean), int(radius / spacing)
    wide = 2 * most + 1
    cube = np.indices((wide,) * k).reshape(k, wide**k).T - most
    ball = cube[spacing**2 * np.sum(cube**2, axis=1) <= radius**2]
    return ParameterGrid(np.asarray(mean, dtype=float), spacing * np.linalg.cholesky(covariance), ball, spacing)


def one_point(point: np.ndarray) -> ParameterGrid:
    """A lattice of one point (k,)."""
    k = len(point)
    return ParameterGrid(point, np.eye(k), np.zeros((1, k), dtype=int))


def scattered_points(point: np.ndarray) -> ParameterGrid:
    """Points (B, k) as they are, that are no lattice."""
    k = point.shape[1]
    return ParameterGrid(np.zeros(k), np.eye(k), point)


def moments(point: np.ndarray, log_weight: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights (..., B) of sum one, mean (..., k) and covariance (..., k, k) of points (B, k) with log-weights (..., B)."""
    w = np.exp(log_weight - log_weight.max(axis=-1, keepdims=True))
    w /= w.sum(axis=-1, keepdims=True)
    mean = w @ point
    off = point - mean[..., None, :]
    return w, mean, np.swapaxes(off * w[..., None], -1, -2) @ off


FRESH = 0.4
"""When a lattice is laid, the variance of its highest peak is at least this share of that it is laid for."""
COLLAPSED = 0.1
"""Share below which the lattice is too coarse for the posterior's covariance."""
PATIENCE = 4
"""Layers that are added on the way uphill before a wider lattice is laid there."""
MOST_POINTS = 4000
MOST_FINE = 1000
"""Points of a lattice that is laid more finely for the sake of its peak; beyond them it stays as it is, and the posterior of a
long narrow crescent is right to a tenth of its σ."""
MOST_LAID = 60
"""Lattices on the way to one that resolves the posterior."""


S = TypeVar("S", bound=PosteriorWeights[ParameterGrid])


@dataclass(frozen=True)
class GridConstruction(Generic[S]):
    """What lattices are laid for: the prior, mean (k,) and covariance (k, k); at: lattice, step → the filters at its points after
    so many steps; refuse_lost: raises where a point (k,) is one that nobody means; most points of a lattice; held (q, k): points
    that every lattice but the first has a node next to, whatever the samples so far say."""

    prior: tuple[np.ndarray, np.ndarray]
    at: Callable[[ParameterGrid, int], S]
    refuse_lost: Callable[[np.ndarray], None]
    most: int = MOST_POINTS
    held: np.ndarray | None = None


class _TooMany(NumericalError):
    """The lattice would need more points than it may have."""


def build_first_grid(construction: GridConstruction[S]) -> S:
    """For the prior."""
    return _laid(construction, *construction.prior, 0)


def _laid(
    construction: GridConstruction[S],
    mean: np.ndarray,
    covariance: np.ndarray,
    step: int,
    other: np.ndarray | None = None,
    most: int | None = None,
) -> S:
    """A lattice about a guess of the posterior after `step` steps, grown until it holds it, with its filters there.

    Where the largest density stays at its edge the posterior lies elsewhere: it is laid about that point, three times as wide.
    other (q, k): points of other peaks, which it is to hold as well.
    """
    construction.refuse_lost(mean)
    most = min(construction.most, most or construction.most)
    grid = _build_grid(construction, mean, covariance, other)
    parts, outside = [construction.at(grid, step)], 0
    while True:
        log_weight, edge = np.concatenate([part.log_weight for part in parts]), grid.edge
        heavy = edge & (log_weight > log_weight.max() - DEPTH)
        if not heavy.any():
            return parts[0] if len(parts) == 1 else replace(joined(parts), cover=grid)
        best = int(np.argmax(log_weight))
        outside = outside + 1 if edge[best] else 0
        if outside > PATIENCE:
            centre, covariance = grid.point[best], 9 * covariance
            construction.refuse_lost(centre)
            grid = _build_grid(construction, centre, covariance, other)
            parts, outside = [construction.at(grid, step)], 0
            continue
        more = replace(grid, node=grid.beside(heavy))
        if len(grid.node) + len(more.node) > most:
            raise _TooMany(
                f"the posterior of the parameters spreads over more than {most} points of its lattice",
                remedy="the measurements hardly distinguish them: estimate fewer, or state a smaller initial standard deviation",
            )
        grid = grid.grown(more.node)
        parts.append(construction.at(more, step))


def _build_grid(
    construction: GridConstruction[S], mean: np.ndarray, covariance: np.ndarray, other: np.ndarray | None
) -> ParameterGrid:
    """About a guess, with the nodes next to other points (q, k)."""
    grid = build_grid_about(mean, covariance, SPACING, np.sqrt(2 * DEPTH))
    return grid if other is None or not len(other) else grid.with_nodes(grid.nearest(other))


def build_next_grid(construction: GridConstruction[S], now: S) -> S:
    """A lattice for the posterior as it is now; where that is too narrow for the old one, by way of finer ones, for a power of
    its density. Raises NumericalError where no lattice resolves it."""
    for _ in range(MOST_LAID):
        share, grid = 1.0, now.cover
        while True:
            top = float(now.log_weight.max())
            # beyond the digits of a logarithm no depth of a lattice is left below its largest value
            if not np.isfinite(now.log_weight).any() or not top - DEPTH < top:
                raise NumericalError(
                    "the readings are beyond what the model can make at any parameters",
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
        if construction.held is not None:
            other = np.concatenate([other, construction.held])
        now = _laid(construction, mean, covariance, now.step, other)
        if share == 1.0:
            return _sharpened(construction, now, other)
    raise NumericalError(
        f"the posterior of the parameters is too uneven for {MOST_LAID} lattices one finer than the other",
        remedy="state a larger noise of the gauges, or a smaller initial standard deviation of the parameters",
    )


def _spread(
    construction: GridConstruction[S], grid: ParameterGrid, which: np.ndarray, log_weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean and covariance to lay a lattice for, of points (q,) of this one, and the least variance in its own steps.

    The covariance is that of the density or twice that of its square, whichever is the narrower: of a normal density they are the
    same, of a curved one the second is nearer to that at its peak.
    """

    def least(covariance: np.ndarray) -> float:
        return float(grid.spread(covariance).min(initial=np.inf) * SPACING**2)

    _, mean, plain = moments(grid.point[which], log_weight)
    squared = 2 * moments(grid.point[which], 2 * log_weight)[2]
    if COLLAPSED <= least(squared) < least(plain):
        return mean, squared, least(squared)
    return mean, plain, least(plain)


def _sharpened(construction: GridConstruction[S], now: S, other: np.ndarray) -> S:
    """The lattice laid anew, as finely as its highest peak asks for and MOST_FINE allows."""
    for _ in range(MOST_LAID):
        narrow = now.cover.width(now.log_weight).min(initial=np.inf) * SPACING**2
        if narrow >= FRESH:
            return now
        frame = now.cover.frame / now.cover.spacing
        covariance = narrow / (2 * SHARP) * frame @ frame.T
        # far from the middle of a lattice that has moved on the way, or that is much too coarse
        middle = now.cover.centre if narrow >= COLLAPSED else now.cover.point[int(np.argmax(now.log_weight))]
        try:
            now = _laid(construction, middle, covariance, now.step, other, MOST_FINE)
        except _TooMany:
            break
    return replace(now, cover=replace(now.cover, sharp=min(SHARP, 0.5 * narrow)))
