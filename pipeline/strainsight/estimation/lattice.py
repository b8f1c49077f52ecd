"""A lattice of points that covers a density, and its moments by the trapezoidal rule."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

LEFT = 3.5
"""Where a point at its edge is within exp(−LEFT) of the largest density, a lattice no longer holds it;"""
NARROW = 0.5
"""nor where its variance has fallen to this share, of the one that the lattice was laid for, in some direction;"""
SHARP = 0.25
"""nor where that of its highest peak has, along an axis of the lattice: with it sums are right to 1e-2 of σ."""


@dataclass(frozen=True)
class Lattice:
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
        there = {z: i for i, z in enumerate(nodes)}
        found = [there.get((*z[:a], z[a] + s, *z[a + 1 :]), -1) for z in nodes for s in (1, -1) for a in range(k)]
        return np.array(found, dtype=int).reshape(len(nodes), 2, k)

    @property
    def edge(self) -> np.ndarray:
        """Which points (B,) have a neighbour that is not in the lattice."""
        return np.asarray((self.neighbour < 0).any(axis=(1, 2)))

    def beside(self, which: np.ndarray) -> np.ndarray:
        """Neighbours z (any, k) of some points (B,) of bool that are not in the lattice, each once, in order."""
        there = {tuple(z) for z in self.node.tolist()}
        wanted = {tuple(own) for z in self.node[which] for own in _beside(z).tolist()} - there
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

    def weights(self, log_weight: np.ndarray) -> LatticeWeights:
        """Of points with log-densities (L, B)."""
        largest = log_weight.max(axis=-1, keepdims=True)
        w = np.exp(log_weight - largest)
        mass = w.sum(axis=-1, keepdims=True)
        return LatticeWeights(self.point, w / mass, (largest + np.log(mass))[..., 0])

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
        heavy = log_weight > log_weight.max() - depth
        left, found = set(np.flatnonzero(heavy).tolist()), []
        for start in np.argsort(-log_weight).tolist():
            if start not in left:
                continue
            left.discard(start)
            own, open_ = [start], [start]
            while open_:
                for other in self.neighbour[open_.pop()].ravel().tolist():
                    if other in left:
                        left.discard(other)
                        own.append(other)
                        open_.append(other)
            found.append(np.array(sorted(own)))
        return found

    def nearest(self, point: np.ndarray) -> np.ndarray:
        """Nodes (any, k) nearest to points (q, k), each once, in order."""
        z = np.rint(np.linalg.solve(self.frame, (point - self.centre).T).T).astype(int)
        return np.unique(z, axis=0)

    def spread(self, covariance: np.ndarray) -> np.ndarray:
        """Eigenvalues (k,) of a covariance (..., k, k) of p in units of the lattice's own steps."""
        inverse = np.linalg.inv(self.frame)
        return np.linalg.eigvalsh(inverse @ covariance @ inverse.T)

    def with_nodes(self, node: np.ndarray) -> Lattice:
        """With those of some nodes (any, k) that it does not have yet."""
        there = {tuple(z) for z in self.node.tolist()}
        new = [z for z in node.tolist() if tuple(z) not in there]
        return self.grown(np.array(new, dtype=int).reshape(-1, self.node.shape[1]))

    def grown(self, node: np.ndarray) -> Lattice:
        """With more nodes, behind the others."""
        return replace(self, node=np.concatenate([self.node, node]))


@dataclass(frozen=True)
class LatticeWeights:
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


def lattice_about(mean: np.ndarray, covariance: np.ndarray, spacing: float, radius: float) -> Lattice:
    """All points within `radius` standard deviations of a mean (k,) with covariance (k, k), `spacing` of them apart."""
    k, most = len(mean), int(radius / spacing)
    wide = 2 * most + 1
    cube = np.indices((wide,) * k).reshape(k, wide**k).T - most
    ball = cube[spacing**2 * np.sum(cube**2, axis=1) <= radius**2]
    return Lattice(np.asarray(mean, dtype=float), spacing * np.linalg.cholesky(covariance), ball, spacing)


def one_point(point: np.ndarray) -> Lattice:
    """A lattice of one point (k,)."""
    k = len(point)
    return Lattice(point, np.eye(k), np.zeros((1, k), dtype=int))


def moments(point: np.ndarray, log_weight: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights (..., B) of sum one, mean (..., k) and covariance (..., k, k) of points (B, k) with log-weights (..., B)."""
    w = np.exp(log_weight - log_weight.max(axis=-1, keepdims=True))
    w /= w.sum(axis=-1, keepdims=True)
    mean = w @ point
    off = point - mean[..., None, :]
    return w, mean, np.swapaxes(off * w[..., None], -1, -2) @ off


def _beside(z: np.ndarray) -> np.ndarray:
    """The 2k neighbours of a node along the axes."""
    unit = np.eye(len(z), dtype=int)
    return np.concatenate([z + unit, z - unit])
