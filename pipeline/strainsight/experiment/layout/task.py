"""The task of a placement: a linear problem with its load cases, the pool of its gauges, and what a layout may be and has to
make small."""

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
from strainsight.placement.scenario import Aggregate, Pool, of_last_states, slow_pools, thesis_weight, weight_of_pools
from strainsight.sensors.candidates import STRAIN, Candidates
from strainsight.sensors.zones import inside
from strainsight.text import listed


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
        present = np.unique(of)
        share = self.weight[of] / self.weight[present].sum()
        return np.asarray(len(of) * share / np.bincount(of)[of])

    def shares(self) -> np.ndarray:
        """What a scenario counts in the mean of an unknown over the cases in which it acts (scenarios, u), of sum 1 a column."""
        weight = (self.weight / np.bincount(self.of, minlength=len(self.weight)))[self.of, None] * self.acts[self.of]
        return np.asarray(weight / weight.sum(axis=0))

    def amplitude(self) -> np.ndarray:
        """Root of the weighed mean square of `scale` over the cases in which an unknown acts (u,) [unit]."""
        return np.asarray(np.sqrt(np.sum(self.shares() * self.scale[self.of] ** 2, axis=0)))


@dataclass(frozen=True)
class PoolRows:
    """Pool rows, each a gauge or a mirrored pair of them.

    gauges (p, 1 or 2): numbers of the gauges of every row, −1 where it has one only; channels (p, c): their channels, rows of
    the candidates, −1 where it has fewer; alone: gauges that were left out because they have no mirror image.
    """

    gauges: np.ndarray
    channels: np.ndarray
    alone: int = 0

    @property
    def first(self) -> np.ndarray:
        """The first channel of every row (p,)."""
        return self.channels[:, 0]

    @property
    def flat(self) -> tuple[np.ndarray, np.ndarray]:
        """Every gauge of the pool, and the pool row it belongs to."""
        which, column = np.nonzero(self.gauges >= 0)
        return self.gauges[which, column], which

    def gauges_of(self, rows: np.ndarray) -> np.ndarray:
        """Numbers of the gauges of some pool rows, in their order."""
        gauges = self.gauges[rows].ravel()
        return gauges[gauges >= 0]

    def summed(self, values: np.ndarray) -> np.ndarray:
        """For every row the sum over its gauges (p,); values: of every gauge of `flat`."""
        return np.bincount(self.flat[1], weights=values, minlength=len(self.gauges))


def layout_limits(
    place: LayoutSettings, pool: PoolRows, mesh: Mesh, candidates: Candidates, price: np.ndarray, key: str = FIXED
) -> Limits:
    """What a layout may be, as `place` says: its size, bonded gauges, spacing, zones, budget.

    price (p,) of every pool row; key: config key of the bonded gauges.
    """
    gauge, which = pool.flat
    first = candidates.first[gauge]
    part = candidates.take(first)
    places, zones = part.grids, []
    apart = (part.facet > 0) | (part.quantity == STRAIN)
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
        near=_near(places.position, part.channel_of_grid, which, place.minimum_spacing, apart),
        zones=zones,
        key=key,
    )


def _near(
    position: np.ndarray, owner: np.ndarray, which: np.ndarray, spacing: float, apart: np.ndarray
) -> np.ndarray | None:
    """Pairs of pool rows (q, 2) with gauges nearer to each other than the spacing [m].

    position (g, 3) of grids; owner (g,): the gauge of each, whose arms may be as near to one another as they are; which: the
    pool row of every gauge; apart: of every gauge whether it keeps a spacing, as sensors that are not on the surface do not.
    """
    if spacing <= 0:
        return None
    pairs = owner[cKDTree(position).query_pairs(spacing * (1 - 1e-9), output_type="ndarray")]
    pairs = pairs[apart[pairs].all(axis=1)]
    return np.unique(np.sort(which[pairs[pairs[:, 0] != pairs[:, 1]]], axis=1), axis=0)


@dataclass(frozen=True)
class UnknownStates:
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
class PoolReadings:
    """What rules know that look at readings only: rows (pool, c, n) per coordinate, the more important coordinates first;
    variance (pool, c) of their noise; prior (n, n) covariance of the coordinates."""

    rows: np.ndarray
    variance: np.ndarray
    prior: np.ndarray


@dataclass(frozen=True)
class Whole:
    """All candidates, where the pool is only a part of them: pools, every scenario solved with all, still without a metric;
    limits of a layout of them; rows (p,): numbers of those in the pool, ascending; task_with: the same task with others as its
    pool."""

    pools: tuple[Pool, ...]
    limits: Limits
    rows: np.ndarray
    task_with: Callable[[np.ndarray], Task]


@dataclass(frozen=True)
class Task:
    """unknowns; pools: every scenario solved with all gauges of the pool, still without a metric; candidates, and which of them
    are the pool, with price (p,) of its rows; limits, settings: `place` of a config; readings; seed of random sets; aggregate
    over the scenarios; weights of the trace; relative: whether σ is claimed relative to `scale`, or in its unit; coherence τ [s]
    of the white noise that stands for errors of installation in the pools, 0: they are taken as exact; cases: the load cases that
    the scenarios are of, None where there is one without a name; whole: all candidates, by which the trace is then weighed, None
    where the pool has all; single: the pools with each gauge (k,) of a layout as a row of its own, None
    where every pool row is one gauge."""

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
        unknowns = self.unknowns
        return slow_pools(self.pools, (len(self.pools[0].P) - len(unknowns.states)) // 2, unknowns.at)

    @cached_property
    def metrics(self) -> dict[str, tuple[Metric, ...]]:
        """Every criterion of these unknowns by its name, one a load case: the trace weighed as `weights` asks for, of the
        scenarios of that case; the others in units of `size`. Unknowns that are silent in a case have no weight there."""
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
    return f"{criterion.sigma} of {listed(over)}"
