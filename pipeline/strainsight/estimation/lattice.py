"""A lattice of points that covers a density, and its moments by the trapezoidal rule."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Lattice:
    """B points  p = centre + frame z  at integers z: centre (k,), frame (k, k), node z (B, k).

    A sum over such points integrates a smooth density that has died away at their edge to far better than its spacing: of a
    normal density of standard deviation σ the error is 2 exp(−2π²σ²/h²), 5e-9 at h = σ.
    Source: Trefethen and Weideman, SIAM Review 56 (2014).
    """

    centre: np.ndarray
    frame: np.ndarray
    node: np.ndarray

    @property
    def point(self) -> np.ndarray:
        """(B, k)."""
        return self.centre + self.node @ self.frame.T

    @property
    def edge(self) -> np.ndarray:
        """Which points (B,) have a neighbour that is not in the lattice."""
        there = {tuple(z) for z in self.node.tolist()}
        return np.array([any(tuple(own) not in there for own in _beside(z).tolist()) for z in self.node])

    def beside(self, which: np.ndarray) -> np.ndarray:
        """Neighbours z (any, k) of some points (B,) of bool that are not in the lattice, each once, in order."""
        there = {tuple(z) for z in self.node.tolist()}
        wanted = {tuple(own) for z in self.node[which] for own in _beside(z).tolist()} - there
        return np.array(sorted(wanted), dtype=int).reshape(-1, self.node.shape[1])

    def spread(self, covariance: np.ndarray) -> np.ndarray:
        """Eigenvalues (k,) of a covariance (..., k, k) of p in units of the lattice's own steps."""
        inverse = np.linalg.inv(self.frame)
        return np.linalg.eigvalsh(inverse @ covariance @ inverse.T)

    def grown(self, node: np.ndarray) -> Lattice:
        """With more nodes, behind the others."""
        return replace(self, node=np.concatenate([self.node, node]))


def lattice_about(mean: np.ndarray, covariance: np.ndarray, spacing: float, radius: float) -> Lattice:
    """All points within `radius` standard deviations of a mean (k,) with covariance (k, k), `spacing` of them apart."""
    k, most = len(mean), int(radius / spacing)
    wide = 2 * most + 1
    cube = np.indices((wide,) * k).reshape(k, wide**k).T - most
    ball = cube[spacing**2 * np.sum(cube**2, axis=1) <= radius**2]
    return Lattice(np.asarray(mean, dtype=float), spacing * np.linalg.cholesky(covariance), ball)


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
