"""Task of a placement: linear problem with load cases, pool of gauges, limits and criterion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from strainsight.config.layout import LayoutSettings
from strainsight.errors import blame
from strainsight.experiment.layout.gauge_list import zone_of
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.placement.criteria import CRITERIA, Criterion, Metric, Trace, criterion_of
from strainsight.placement.limits import FIXED, Limits, limits_of
from strainsight.placement.scenario import (
    Aggregate,
    Pool,
    in_reached_states,
    of_last_states,
    slow_pools,
    thesis_weight,
    weight_of_pools,
)
from strainsight.sensors.candidates import STRAIN, Candidates
from strainsight.sensors.zones import inside
from strainsight.text import listed


@dataclass(frozen=True)
class LoadCases:
    """c load cases: weight (c,) > 0 [-]; of (scenarios,): case index of each; acts (c, u) bool: whether an unknown acts in a case
    (parameters always do); scale (c, u) [unit]: amplitude or guess of each unknown."""

    names: tuple[str, ...]
    weight: np.ndarray
    of: np.ndarray
    acts: np.ndarray
    scale: np.ndarray

    def factors(self, of: np.ndarray, aggregate: Aggregate) -> np.ndarray:
        """Factors on the metric of every scenario that turn the plain aggregate into the weighted one:

            mean    Σ_c w_c mean_s∈c f_s / Σ_c w_c,     factor  S w_c / (S_c Σ w)
            worst   max_c w_c max_s∈c f_s / max_c w_c,  factor  w_c / max w

        of (S,): case of each scenario, S_c of them in case c. As metrics are homogeneous, c(αM) = α c(M), elimination, exchange,
        lower bound and proof remain valid."""
        weight = self.weight[of]
        if aggregate == "worst":
            return np.asarray(weight / self.weight.max())
        share = self.weight[of] / self.weight[np.unique(of)].sum()
        return np.asarray(len(of) * share / np.bincount(of)[of])

    def shares(self) -> np.ndarray:
        """Weights (scenarios, u) of the mean of an unknown over the cases in which it acts; columns sum to 1."""
        weight = (self.weight / np.bincount(self.of, minlength=len(self.weight)))[self.of, None] * self.acts[self.of]
        return np.asarray(weight / weight.sum(axis=0))

    def amplitude(self) -> np.ndarray:
        """Weighted RMS of `scale` over the cases in which an unknown acts (u,) [unit]."""
        return np.asarray(np.sqrt(np.sum(self.shares() * self.scale[self.of] ** 2, axis=0)))


@dataclass(frozen=True)
class PoolRows:
    """Pool rows, each a gauge or a mirrored pair.

    gauges (p, 1 or 2): gauge numbers, padded with −1; channels (p, c): candidate channels, padded with −1; alone: number of
    gauges omitted because they have no mirror image."""

    gauges: np.ndarray
    channels: np.ndarray
    alone: int = 0

    @property
    def first(self) -> np.ndarray:
        """First channel of every row (p,)."""
        return self.channels[:, 0]

    @property
    def flat(self) -> tuple[np.ndarray, np.ndarray]:
        """All gauges of the pool, and their pool rows."""
        which, column = np.nonzero(self.gauges >= 0)
        return self.gauges[which, column], which

    def gauges_of(self, rows: np.ndarray) -> np.ndarray:
        """Gauge numbers of some pool rows, in order."""
        gauges = self.gauges[rows].ravel()
        return gauges[gauges >= 0]

    def summed(self, values: np.ndarray) -> np.ndarray:
        """Sum values, one per gauge of `flat`, over the gauges of every row (p,)."""
        return np.bincount(self.flat[1], weights=values, minlength=len(self.gauges))


def layout_limits(
    place: LayoutSettings, pool: PoolRows, mesh: Mesh, candidates: Candidates, price: np.ndarray, key: str = FIXED
) -> Limits:
    """Limits of a layout from `place`: size, bonded gauges, spacing, zones, budget.

    price (p,): of every pool row; key: config key of the bonded gauges."""
    gauge, which = pool.flat
    first = candidates.first[gauge]
    part = candidates.take(first)
    places, zones = part.grids, []
    spaced = (part.facet > 0) | (part.quantity == STRAIN)
    facets = exterior_facets(mesh) if mesh.has_surface and place.at_most else None
    for i, limit in enumerate(place.at_most):
        name = f"place.at_most.{i}"
        with blame(f"{name}.zone"):
            within = inside(zone_of(limit.zone), mesh, facets, places.position, places.normal)
        zones.append((name, pool.summed(part.any_grid(within)), limit.count))
    return limits_of(
        len(pool.gauges),
        place.keep,
        fixed=np.flatnonzero(pool.summed(candidates.bonded[first]) > 0).tolist(),
        size=(pool.gauges >= 0).sum(axis=1),
        price=price if place.budget is not None else None,
        budget=place.budget,
        near=_near(places.position, part.channel_of_grid, which, place.minimum_spacing, spaced),
        zones=zones,
        key=key,
    )


def _near(
    position: np.ndarray, owner: np.ndarray, which: np.ndarray, spacing: float, spaced: np.ndarray
) -> np.ndarray | None:
    """Pairs of pool rows (q, 2) with gauges nearer than the spacing [m].
    position (g, 3): of grids; owner (g,): gauge of each; which: pool row of every gauge; spaced: whether the spacing applies to a
    gauge, as it does not for sensors off the surface."""
    if spacing <= 0:
        return None
    pairs = owner[cKDTree(position).query_pairs(spacing * (1 - 1e-9), output_type="ndarray")]
    pairs = pairs[spaced[pairs].all(axis=1)]
    return np.unique(np.sort(which[pairs[pairs[:, 0] != pairs[:, 1]]], axis=1), axis=0)


@dataclass(frozen=True)
class UnknownStates:
    """Unknowns among the states x* of a linear problem.

    names (u,); states: names of the last states of x*; at (u,): indices in x*, numbered from its last state; scale (u,)
    [unit]: of x*; size (u,): scaling of each for criteria other than the trace."""

    names: tuple[str, ...]
    states: tuple[str, ...]
    at: np.ndarray
    scale: np.ndarray
    size: np.ndarray


@dataclass(frozen=True)
class PoolReadings:
    """Input of rules based on readings only: rows (pool, c, n) per coordinate, important coordinates first; variance (pool, c) of
    the noise; prior (n, n) covariance of the coordinates."""

    rows: np.ndarray
    variance: np.ndarray
    prior: np.ndarray


@dataclass(frozen=True)
class Whole:
    """All candidates, if the pool is a subset: pools: scenarios solved with all, without a metric; limits: of a layout; rows
    (p,): those in the pool, ascending; task_with: creates the task with another pool."""

    pools: tuple[Pool, ...]
    limits: Limits
    rows: np.ndarray
    task_with: Callable[[np.ndarray], Task]


@dataclass(frozen=True)
class Task:
    """Task of a placement.

    pools: scenarios solved with all gauges of the pool, without a metric; price (p,): of the pool rows; settings: `place` of the
    config; seed: of random layouts; aggregate: over scenarios; weights: of the trace; relative: whether σ is relative to `scale`;
    coherence τ [s]: of the noise that replaces installation errors, 0 without; cases: None without load cases; whole: all
    candidates, None if the pool has all; single: creates pools with one row per gauge (k,), None if rows are single gauges."""

    unknowns: UnknownStates
    pools: tuple[Pool, ...]
    candidates: Candidates
    pool: PoolRows
    price: np.ndarray
    limits: Limits
    settings: LayoutSettings
    readings: PoolReadings
    seed: int
    aggregate: Aggregate = "mean"
    weights: str = "normalised"
    relative: bool = True
    coherence: float = 0.0
    cases: LoadCases | None = None
    whole: Whole | None = None
    single: Callable[[np.ndarray], Sequence[Pool]] | None = None

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states x* = [q, q̇, unknowns and states of their models]."""
        last = self.unknowns.states
        numbers = range(1, (len(self.pools[0].P) - len(last)) // 2 + 1)
        return (*(f"q{i}" for i in numbers), *(f"dq{i}/dt" for i in numbers), *last)

    @property
    def over(self) -> tuple[str, ...]:
        """Unknowns in the criterion."""
        return self.settings.metric_over or self.unknowns.names

    @cached_property
    def searched(self) -> tuple[Pool, ...]:
        """Pools for elimination and exchanges; large models are reduced to their slow motions."""
        unknowns = self.unknowns
        return slow_pools(self.pools, (len(self.pools[0].P) - len(unknowns.states)) // 2, unknowns.at)

    @cached_property
    def metrics(self) -> dict[str, tuple[Metric, ...]]:
        """Metrics by criterion and load case: the trace with `weights`, the others scaled by `size`; inactive unknowns have no
        weight."""
        by_case = [self._metrics_of(case) for case in range(1 if self.cases is None else len(self.cases.names))]
        return {c.name: tuple(metrics[c.name] for metrics in by_case) for c in CRITERIA}

    def _metrics_of(self, case: int) -> dict[str, Metric]:
        unknowns, states, cases = self.unknowns, len(self.pools[0].P), self.cases
        over, scale = np.isin(unknowns.names, self.over), unknowns.scale
        pools = self.pools if self.whole is None else self.whole.pools
        if cases is not None:
            over, scale = over & cases.acts[case], cases.scale[case]
            pools = tuple(pools[i] for i in np.flatnonzero(cases.of == case))
        at = unknowns.at[over]
        weight = thesis_weight(states, at, scale[over]) if self.weights == "thesis" else weight_of_pools(pools, at)
        plain = thesis_weight(states, at, 1 / unknowns.size[over])
        return {c.name: Metric(weight if isinstance(c, Trace) else plain, c) for c in CRITERIA}

    def under(
        self,
        pools: Sequence[Pool],
        criterion: str = "",
        aggregate: Aggregate | None = None,
        at: Sequence[int] | None = None,
    ) -> list[Pool]:
        """`weighed_pools` without the states that the process noise does not reach."""
        last = len(self.unknowns.states)
        return [in_reached_states(pool, last) for pool in self.weighed_pools(pools, criterion, aggregate, at)]

    def weighed_pools(
        self,
        pools: Sequence[Pool],
        criterion: str = "",
        aggregate: Aggregate | None = None,
        at: Sequence[int] | None = None,
    ) -> list[Pool]:
        """Set the metric of scenarios: a criterion (default: of the layout), with unknowns and weight of the load case.

        pools: one per scenario, or for the scenarios `at`. Weights are factors of the metric (`LoadCases.factors`)."""
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
        """Criterion of the layout."""
        return criterion_of(self.settings.criterion)

    @property
    def weighed(self) -> tuple[str, ...]:
        """Unknowns in the criterion, in the order of x*."""
        order = np.argsort(self.unknowns.at, kind="stable")
        return tuple(self.unknowns.names[i] for i in order if self.unknowns.names[i] in self.over)

    @property
    def sigma(self) -> str:
        """Name of the root of the metric, with the treatment of installation errors."""
        return root_of(self.criterion, self.over) + (" (with installation errors as noise)" if self.coherence else "")

    def cost_of(self, rows: np.ndarray) -> tuple[float, float] | None:
        """Price of a layout (k,) of pool rows and its budget, None without a budget."""
        budget = self.settings.budget
        return None if budget is None else (float(self.price[rows].sum()), budget)


def root_of(criterion: Criterion, unknowns: Sequence[str]) -> str:
    """Name of the root of a criterion: steady-state σ of one unknown, or the criterion's mean of several."""
    if len(unknowns) == 1:
        return f"the steady-state σ({unknowns[0]})"
    return f"{criterion.sigma} of {listed(unknowns)}"
