"""What a bank knows of its constants: points that cover their posterior, and how likely each of them is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np


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
