"""The task of a placement: a linear problem, the pool of its gauges, and what a layout may be and has to make small."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from strainsight.cases.layout.pool import PoolRows
from strainsight.config.layout import LayoutSettings
from strainsight.gauges.candidates import Candidates
from strainsight.placement.criteria.choices import CRITERIA
from strainsight.placement.criteria.criterion import Criterion
from strainsight.placement.criteria.trace import Trace
from strainsight.placement.limits import Limits
from strainsight.placement.metric import Metric
from strainsight.placement.scenario import Aggregate, Pool, thesis_weight, weight_of_pools


@dataclass(frozen=True)
class Unknowns:
    """The unknowns among the states x* of a linear problem.

    names (u,); states: names of the last states of x*, theirs among them; at (u,): their indices in x*; scale (u,) [unit]: one
    of x* in the unit of each; size (u,): what a criterion other than the trace counts each in, in x*.
    """

    names: tuple[str, ...]
    states: tuple[str, ...]
    at: np.ndarray
    scale: np.ndarray
    size: np.ndarray


@dataclass(frozen=True)
class Readings:
    """What rules know that look at readings only: rows (pool, c, n) per coordinate, the more important coordinates first;
    variance (pool, c) of their noise; prior (n, n) covariance of the coordinates."""

    rows: np.ndarray
    variance: np.ndarray
    prior: np.ndarray


@dataclass(frozen=True)
class Task:
    """unknowns; pools: every scenario solved with all gauges of the pool, still without a metric; candidates, and which of them
    are the pool, with price (p,) of its rows; limits, settings: `place` of a config; readings; seed of random sets; aggregate
    over the scenarios; weights of the trace; relative: whether σ is claimed relative to `scale`, or in its unit; coherence τ [s]
    of the white noise that stands for errors of installation in the pools, 0: they are taken as exact."""

    unknowns: Unknowns
    pools: tuple[Pool, ...]
    candidates: Candidates
    pool: PoolRows
    price: np.ndarray
    limits: Limits
    settings: LayoutSettings
    readings: Readings
    seed: int
    aggregate: Aggregate = "mean"
    weights: str = "normalised"
    relative: bool = True
    coherence: float = 0.0

    @property
    def states(self) -> tuple[str, ...]:
        """What each of x* = [q, q̇, unknowns with what their models add] is."""
        last = self.unknowns.states
        numbers = range(1, (len(self.pools[0].P) - len(last)) // 2 + 1)
        return (*(f"q{i}" for i in numbers), *(f"dq{i}/dt" for i in numbers), *last)

    @property
    def over(self) -> tuple[str, ...]:
        """The unknowns that the criterion covers."""
        return self.settings.metric_over or self.unknowns.names

    @cached_property
    def metrics(self) -> dict[str, Metric]:
        """Every criterion of these unknowns, by its name: the trace weighed as `weights` asks for, the others in units of
        `size`."""
        own, states = self.unknowns, len(self.pools[0].P)
        over = np.isin(own.names, self.over)
        at = own.at[over]
        if self.weights == "thesis":
            weight = thesis_weight(states, at, own.scale[over])
        else:
            weight = weight_of_pools(self.pools, at)
        plain = thesis_weight(states, at, 1 / own.size[over])
        return {c.name: Metric(weight if isinstance(c, Trace) else plain, c) for c in CRITERIA}

    @property
    def metric(self) -> Metric:
        """What the layout is chosen by."""
        return self.metrics[self.settings.criterion]

    @property
    def sigma(self) -> str:
        """What the root of the metric is: the σ of one unknown, or the criterion's mean of several."""
        return root_of(self.metric.criterion, self.over) + (" (installation as noise)" if self.coherence else "")

    def cost_of(self, rows: np.ndarray) -> tuple[float, float] | None:
        """What a layout (k,) of pool rows costs and may cost; None without a budget."""
        budget = self.settings.budget
        return None if budget is None else (float(self.price[rows].sum()), budget)


def root_of(criterion: Criterion, over: Sequence[str]) -> str:
    """The name of the root of a criterion: the σ of one unknown, or the criterion's mean of several."""
    if len(over) == 1:
        return f"the steady-state σ of {over[0]}"
    return f"{criterion.sigma} of {', '.join(over[:-1])} and {over[-1]}"
