"""What a filter on a layout is expected to claim, with all gauges and without each, and what that is made of."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from strainsight.ordering import tied_order

MATTERS = 1.05
"""Factor that another layout than the first has to be better by, and that σ of no unknown may be worse by."""


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


def least_expected(found: Sequence[Expectation], over: Collection[str]) -> int:
    """Which of several layouts has the least geometric mean of σ over these unknowns; the first one unless another is better
    by the factor MATTERS, and worse by it in no unknown."""
    ratio = np.array([[own.std[name] / found[0].std[name] for name in over] for own in found])
    mean = np.exp(np.mean(np.log(ratio), axis=1))
    allowed = (mean * MATTERS <= 1) & (ratio.max(axis=1) <= MATTERS)
    allowed[0] = True
    return int(tied_order(np.where(allowed, mean, np.inf))[0])
