"""Load cases of one placement: which scenario is of which case, and what each case counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.placement.scenario import Aggregate


@dataclass(frozen=True)
class LoadCases:
    """names (c,); weight (c,) > 0 [-]; of (scenarios,): the case of each, by number; acts (c, u) bool: whether an unknown acts in
    a case, a parameter always does; scale (c, u) [unit]: one of x* in the unit of each unknown, an amplitude or a guess."""

    names: tuple[str, ...]
    weight: np.ndarray
    of: np.ndarray
    acts: np.ndarray
    scale: np.ndarray

    def factors(self, of: np.ndarray, aggregate: Aggregate) -> np.ndarray:
        """What the metric of every scenario is multiplied by, so that its plain aggregate over scenarios is the weighed one:

            mean    Σ_c w_c mean_s∈c f_s / Σ_c w_c,     factor  S w_c / (S_c Σ w)
            worst   max_c w_c max_s∈c f_s / max_c w_c,  factor  w_c / max w

        of (S,): the case of each scenario, S_c of them of case c. Two cases that are alike give the cost of one, whatever their
        weights. Metrics are homogeneous, c(αM) = α c(M), and a factor of the weights W is a metric itself: elimination, exchange,
        lower bound and proof hold as they are.
        """
        weight = self.weight[of]
        if aggregate == "worst":
            return np.asarray(weight / self.weight.max())
        there = np.unique(of)
        share = self.weight[of] / self.weight[there].sum()
        return np.asarray(len(of) * share / np.bincount(of)[of])

    def shares(self) -> np.ndarray:
        """What a scenario counts in the mean of an unknown over the cases in which it acts (scenarios, u), of sum 1 a column."""
        weight = (self.weight / np.bincount(self.of, minlength=len(self.weight)))[self.of, None] * self.acts[self.of]
        return np.asarray(weight / weight.sum(axis=0))

    def amplitude(self) -> np.ndarray:
        """Root of the weighed mean square of `scale` over the cases in which an unknown acts (u,) [unit]."""
        return np.asarray(np.sqrt(np.sum(self.shares() * self.scale[self.of] ** 2, axis=0)))
