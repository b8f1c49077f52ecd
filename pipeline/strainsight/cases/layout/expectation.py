"""What a filter on a layout is expected to claim, with all gauges and without each, and what that is made of."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np


@dataclass(frozen=True)
class Expectation:
    """σ of every unknown: std, name → σ; without, name → (k,) σ without each gauge in turn. On a structure relative to the
    scale of the unknown, on a bench in N or N m; inf where it is lost, NaN where it is not solved. budget, name → source → share
    of the variance with all gauges, the shares of a name in sum 1; empty on a bench."""

    std: dict[str, float]
    without: dict[str, np.ndarray]
    budget: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def importance(self, over: Collection[str]) -> np.ndarray:
        """How much σ grows without each gauge, summed over these unknowns (k,); infinite where that is not solved."""
        grown = np.asarray(sum(self.without[name] / self.std[name] for name in over))
        return np.where(np.isnan(grown), np.inf, grown)

    def ordered(self, order: np.ndarray) -> Expectation:
        """The same with the gauges in another order."""
        return replace(self, without={name: values[order] for name, values in self.without.items()})
