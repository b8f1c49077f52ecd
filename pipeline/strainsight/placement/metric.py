"""The metric of a layout: a criterion of the covariance of those states that have a weight."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from strainsight.placement.criteria import Criterion, Trace


@dataclass(frozen=True)
class Metric:
    """c(M), M = √W P √W over the states of positive weight; weight (n*,) ≥ 0: diagonal of W. States of no weight stay
    states of the filter.

    For any weights w of the gauges, Y = P⁻¹ is the largest solution of −YF − FᵀY − YQY + G(w) = 0, hence concave in w and
    not falling; M⁻¹ is a Schur complement of Y in units of √W, and so is it. That is what a `Criterion` asks for.
    """

    weight: np.ndarray
    criterion: Criterion = field(default_factory=Trace)

    @cached_property
    def states(self) -> np.ndarray:
        """Indices of the weighed states (k,)."""
        return np.flatnonzero(self.weight > 0)

    @cached_property
    def _block(self) -> tuple[slice | np.ndarray, ...]:
        at = self.states
        if len(at) and at[-1] - at[0] == len(at) - 1:
            # a slice costs a tenth of an index
            return (slice(at[0], at[-1] + 1),) * 2
        return np.ix_(at, at)

    @cached_property
    def _units(self) -> np.ndarray:
        root = np.sqrt(self.weight[self.states])
        return np.outer(root, root)

    @property
    def smooth(self) -> bool:
        """Whether the criterion has no kinks."""
        return len(self.states) < 2 or self.criterion.softened(1.0) == self.criterion

    def weighed(self, P: np.ndarray) -> np.ndarray:
        """M (k, k) of P (n*, n*)."""
        return np.asarray(P[self._block] * self._units)

    def value(self, P: np.ndarray) -> float:
        """c(M) of P (n*, n*)."""
        return self.criterion.value(self.weighed(P))

    def gradient(self, P: np.ndarray) -> np.ndarray:
        """∂c/∂P (n*, n*), positive semidefinite."""
        W = np.zeros_like(P)
        W[self._block] = self.criterion.gradient(self.weighed(P)) * self._units
        return W

    def rise(self, P: np.ndarray, D: np.ndarray) -> float:
        """c at P + D less c at P, with the digits of D (n*, n*)."""
        return self.criterion.rise(self.weighed(P), self.weighed(D))

    def least_rise(self, P: np.ndarray, t: float) -> float:
        """Least rise over all D ≥ 0 with tr(∂c/∂P D) ≥ t."""
        return self.criterion.least_rise(self.weighed(P), t)

    def lifts(self, P: np.ndarray, D: np.ndarray, doubt: np.ndarray) -> np.ndarray:
        """Least rises (m,) over all increments of no less than D (m, k, k) of the weighed states, in whose eigenvalues doubt (m,)
        is rounding."""
        return self.criterion.lifts(self.weighed(P), D * self._units, doubt * float(self._units.max()))

    def softened(self, temperature: float) -> Metric:
        """The metric without its kinks: see `Criterion`."""
        soft = self.criterion.softened(temperature)
        return self if soft == self.criterion else Metric(self.weight, soft)

    def times(self, factor: float) -> Metric:
        """The metric `factor` > 0 times as large: c(αM) = α c(M) of every criterion."""
        return Metric(self.weight * factor, self.criterion)

    def scaled(self, d: np.ndarray) -> Metric:
        """The same of x*/d."""
        return Metric(self.weight * d * d, self.criterion)
