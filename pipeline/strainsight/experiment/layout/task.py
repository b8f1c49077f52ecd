"""The task of a placement: a linear problem, the pool of its gauges, and what a layout may be and has to make small."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from strainsight.config.layout import LayoutSettings
from strainsight.experiment.layout.load_cases import LoadCases
from strainsight.experiment.layout.pool import PoolRows
from strainsight.placement.criteria.choices import CRITERIA, criterion_of
from strainsight.placement.criteria.criterion import Criterion
from strainsight.placement.criteria.trace import Trace
from strainsight.placement.limits import Limits
from strainsight.placement.metric import Metric
from strainsight.placement.scenario import Aggregate, Pool, thesis_weight, weight_of_pools
from strainsight.placement.slow_motions import of_last_states, slow_pools
from strainsight.sensors.candidates import Candidates


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
class Whole:
    """All candidates, where the pool is only a part of them: pools, every scenario solved with all, still without a metric;
    limits of a layout of them; rows (p,): numbers of those in the pool, ascending."""

    pools: tuple[Pool, ...]
    limits: Limits
    rows: np.ndarray


@dataclass(frozen=True)
class Task:
    """unknowns; pools: every scenario solved with all gauges of the pool, still without a metric; candidates, and which of them
    are the pool, with price (p,) of its rows; limits, settings: `place` of a config; readings; seed of random sets; aggregate
    over the scenarios; weights of the trace; relative: whether σ is claimed relative to `scale`, or in its unit; coherence τ [s]
    of the white noise that stands for errors of installation in the pools, 0: they are taken as exact; cases: the load cases that
    the scenarios are of, None where there is one without a name; whole: all candidates, by which the trace is then weighed, None
    where the pool has all."""

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
    cases: LoadCases | None = None
    whole: Whole | None = None

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
    def searched(self) -> tuple[Pool, ...]:
        """What elimination and exchanges go by: the pools, of large models in their slow motions."""
        own = self.unknowns
        return slow_pools(self.pools, (len(self.pools[0].P) - len(own.states)) // 2, own.at)

    @cached_property
    def metrics(self) -> dict[str, tuple[Metric, ...]]:
        """Every criterion of these unknowns by its name, one a load case: the trace weighed as `weights` asks for, of the
        scenarios of that case; the others in units of `size`. Unknowns that are silent in a case have no weight there."""
        found = [self._metrics_of(case) for case in range(1 if self.cases is None else len(self.cases.names))]
        return {c.name: tuple(own[c.name] for own in found) for c in CRITERIA}

    def _metrics_of(self, case: int) -> dict[str, Metric]:
        own, states, cases = self.unknowns, len(self.pools[0].P), self.cases
        over, scale = np.isin(own.names, self.over), own.scale
        pools = self.pools if self.whole is None else self.whole.pools
        if cases is not None:
            over, scale = over & cases.acts[case], cases.scale[case]
            pools = tuple(pools[i] for i in np.flatnonzero(cases.of == case))
        at = own.at[over]
        weight = thesis_weight(states, at, scale[over]) if self.weights == "thesis" else weight_of_pools(pools, at)
        plain = thesis_weight(states, at, 1 / own.size[over])
        return {c.name: Metric(weight if isinstance(c, Trace) else plain, c) for c in CRITERIA}

    def under(
        self,
        pools: Sequence[Pool],
        criterion: str = "",
        aggregate: Aggregate | None = None,
        at: Sequence[int] | None = None,
    ) -> list[Pool]:
        """Scenarios by a criterion, that of the layout where none is named, each by the unknowns and the weight of its load case.

        pools: one for each scenario, or for those numbered `at`. The weight is a factor of the metric, which has the aggregate
        weighed and every bound of it valid as it is (`LoadCases.factors`).
        """
        metrics, cases = self.metrics[criterion or self.settings.criterion], self.cases
        if cases is None:
            return [pool.under(of_last_states(metrics[0], len(pool.P))) for pool in pools]
        of = cases.of if at is None else cases.of[np.asarray(at)]
        factors = cases.factors(of, self.aggregate if aggregate is None else aggregate)
        return [
            pool.under(of_last_states(metrics[case].times(factor), len(pool.P)))
            for pool, case, factor in zip(pools, of.tolist(), factors.tolist(), strict=True)
        ]

    @property
    def criterion(self) -> Criterion:
        """What the layout is chosen by."""
        return criterion_of(self.settings.criterion)

    @property
    def weighed(self) -> tuple[str, ...]:
        """The unknowns that the criterion weighs, in the order of x*."""
        order = np.argsort(self.unknowns.at, kind="stable")
        return tuple(self.unknowns.names[i] for i in order if self.unknowns.names[i] in self.over)

    @property
    def sigma(self) -> str:
        """What the root of the metric is: the σ of one unknown, or the criterion's mean of several."""
        return root_of(self.criterion, self.over) + (" (installation as noise)" if self.coherence else "")

    def cost_of(self, rows: np.ndarray) -> tuple[float, float] | None:
        """What a layout (k,) of pool rows costs and may cost; None without a budget."""
        budget = self.settings.budget
        return None if budget is None else (float(self.price[rows].sum()), budget)


def root_of(criterion: Criterion, over: Sequence[str]) -> str:
    """The name of the root of a criterion: the σ of one unknown, or the criterion's mean of several."""
    if len(over) == 1:
        return f"the steady-state σ of {over[0]}"
    return f"{criterion.sigma} of {', '.join(over[:-1])} and {over[-1]}"
