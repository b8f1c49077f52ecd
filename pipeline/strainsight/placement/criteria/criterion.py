"""What a criterion has to be, so that every search and every bound of a layout holds for it."""

from __future__ import annotations

from typing import Protocol

import numpy as np


class Criterion(Protocol):
    """c(M) of the covariance M (k, k) of the weighed unknowns, a variance, which a layout makes small.

        c > 0,    c(αM) = α c(M),    c(M + D) ≥ c(M) for D ≥ 0,    1/c concave in M⁻¹

    M⁻¹ is concave in the gauge weights w and does not fall in them (`Metric`), so 1/c does neither, and c is convex in w:
    with W = ∂c/∂M ≥ 0, its slope in a gauge's weight is that of tr(W M) at fixed W, and tr(W M) = c(M) (Euler).
    name: in a config; title, symbol: in words and as a formula; sigma: what √c is, in a sentence; meaning: what c is.
    Source: 1/c is an information function; Pukelsheim, Optimal Design of Experiments (1993), ch. 5 and 6.
    """

    name: str
    title: str
    symbol: str
    sigma: str
    meaning: str

    def value(self, M: np.ndarray) -> float:
        """c(M)."""
        ...

    def gradient(self, M: np.ndarray) -> np.ndarray:
        """W (k, k) = ∂c/∂M, positive semidefinite; where c has a kink, any W with tr(W N) ≤ c(N) for every N ≥ 0 and
        tr(W M) = c(M)."""
        ...

    def rise(self, M: np.ndarray, D: np.ndarray) -> float:
        """c(M + D) − c(M), D (k, k) ≥ 0, from D and not as a difference: with all the digits that D has."""
        ...

    def least_rise(self, M: np.ndarray, t: float) -> float:
        """Least c(M + D) − c(M) of all D ≥ 0 with tr(W D) ≥ t, W the gradient at M. 0 holds always, and makes a search
        solve more; t holds where c is convex in M."""
        return 0.0

    def lifts(self, M: np.ndarray, D: np.ndarray, doubt: np.ndarray) -> np.ndarray:
        """Least rises (m,) of all increments D' ≥ D − doubt·1, one for every D (m, k, k) ≥ 0 and doubt (m,). Only asked of a
        criterion with kinks: there its slope says little of a rise. 0 holds always, and makes a search solve more."""
        return np.zeros(len(D))

    def softened(self, temperature: float) -> Criterion:
        """Without the kinks: smooth, no less than c, by no more than temperature · ln k above it. Its gradient W need not have
        tr(W M) = c(M), but tr(W N) ≤ c(N) for every N ≥ 0."""
        return self
