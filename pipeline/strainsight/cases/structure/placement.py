"""The placement of gauges: elimination, exchanges, a bound, and what the layout is expected to know (5.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.augmentation.observability import Observability, observability
from strainsight.cases.resources import Resources
from strainsight.cases.structure.advice import advice
from strainsight.cases.structure.channels import largest_of_quantity
from strainsight.cases.structure.comparison import Comparison, comparison
from strainsight.cases.structure.expectation import Expectation, alike_gauges, expectation
from strainsight.cases.structure.gauge_list import GaugeList, gauge_list
from strainsight.cases.structure.layout import Layout, gauge_losses, layout_of
from strainsight.cases.structure.pool import PoolRows, layout_cost, limits_of_config, pool_of
from strainsight.cases.structure.problem import Problem
from strainsight.cases.structure.scenarios import metrics_of, scenarios_of
from strainsight.config.placement import PlacementConfig
from strainsight.errors import blame
from strainsight.mesh.model import Mesh
from strainsight.ordering import tied_order
from strainsight.placement.criteria.criterion import Criterion
from strainsight.placement.elimination import Elimination, eliminate_from
from strainsight.placement.scenario import Scenario, solved
from strainsight.records.training import Screened, Training
from strainsight.rom.model import modal_basis


@dataclass(frozen=True)
class Placement:
    """All that a placement has found.

    problem; pool: what is placed and removed as one; elimination of it; layout: its best set; final (k,) pool rows and gauges
    (k,) numbers of the gauges of the layout, the most missed first; listed: the same for people; loss (k,): the metric when
    each fails; expected: σ of every unknown, relative to its scale; others: layouts by other rules; condition: whether the
    pool can tell the unknowns; advice in sentences; plain: no limit but the number of gauges.
    """

    problem: Problem
    pool: PoolRows
    elimination: Elimination
    layout: Layout
    final: np.ndarray
    gauges: np.ndarray
    listed: GaugeList
    loss: np.ndarray
    expected: Expectation
    others: Comparison
    condition: Observability
    advice: tuple[str, ...]
    plain: bool

    @property
    def criterion(self) -> Criterion:
        """What the layout was chosen by."""
        return self.elimination.pools[0].metric.criterion


def placement_of(
    config: PlacementConfig, mesh: Mesh, problem: Problem, training: Training, screened: Screened, using: Resources
) -> Placement:
    """Linearise along the training run, eliminate, exchange, certify, and say what the layout is expected to know.

    Raises InfeasibleError where no layout within the limits detects every unknown.
    """
    settings, seed, channels = config.place, config.seed, problem.channels
    names, candidates = problem.unknowns.names, training.candidates
    over = settings.metric_over or names
    pool = pool_of(screened.kept, channels, candidates, settings.symmetry)
    with blame("place.keep"):
        limits = limits_of_config(config, pool, mesh, channels, candidates)
    ranges = {name: entry.range for name, entry in config.parameters.items()}
    with blame("place.estimate"):
        scenarios = scenarios_of(problem, pool.channels, settings, ranges, seed)
        pools = using.sweep(solved, scenarios, problem.unknowns.state_names)
    metrics = metrics_of(problem, pools, settings)
    metric = metrics[settings.criterion]
    using.progress("elimination", 0.0)
    with blame("place.keep"):
        pools = [own.under(metric) for own in pools]
        result = eliminate_from(pools, limits, settings.aggregate, names=problem.unknowns.state_names)
        layout = layout_of(result.pools, result.kept, limits, settings, using.progress)
    expected, final = _most_missed_first(problem, pool, layout, over)
    gauges = pool.gauges_of(final)
    listed = gauge_list(gauges, channels, training, screened)
    using.progress("failures and other rules", 0.8)
    loss = gauge_losses(problem, pools, metric, final, gauges, settings, ranges, seed)
    others = comparison(
        problem,
        pools,
        metrics,
        settings.criterion,
        pool.channels,
        final,
        result.kept,
        settings.aggregate,
        limits.fixed,
        limits.allows,
        seed,
    )
    words = advice(
        labels=listed.labels,
        criterion=metric.criterion,
        over=over,
        cost=result.cost if limits.plain else result.cost[-1:],
        keep=settings.keep,
        kept=len(layout.gauges),
        std=expected.std,
        certificate=layout.certificate,
        groups=alike_gauges(problem, gauges),
        glued=listed.glued,
        load=listed.peak / listed.range,
        loss=loss,
        without=expected.without,
        ties=sum(1 for tied in result.ties if tied),
        price=layout_cost(config, candidates, gauges),
        alone=pool.alone,
    )
    condition = _observability(problem, training, scenarios[0], pool)
    return Placement(
        problem,
        pool,
        result,
        layout,
        final,
        gauges,
        listed,
        loss,
        expected,
        others,
        condition,
        words,
        limits.plain,
    )


def _most_missed_first(
    problem: Problem, pool: PoolRows, layout: Layout, over: tuple[str, ...]
) -> tuple[Expectation, np.ndarray]:
    """What the layout is expected to know, and its pool rows, both in the order in which its gauges are missed; the lower row
    first of those missed alike."""
    gauges = pool.gauges_of(layout.gauges)
    expected = expectation(problem, gauges)
    importance = expected.importance(over)
    missed = [importance[np.isin(gauges, pool.gauges[row])].sum() for row in layout.gauges]
    final = layout.gauges[tied_order(-np.array(missed))]
    order = [int(np.flatnonzero(gauges == gauge)[0]) for gauge in pool.gauges_of(final)]
    return expected.ordered(np.array(order)), final


def _observability(problem: Problem, training: Training, scenario: Scenario, pool: PoolRows) -> Observability:
    p, n = problem, problem.model.size
    frequency = np.sqrt(modal_basis(p.model, p.model.reference)[0])
    amplitude = float(np.sqrt(np.sum((p.x[:, :n] * frequency) ** 2 + p.x[:, n:] ** 2, axis=1)).max())
    there = pool.channels >= 0
    used = pool.channels[there]
    H = scenario.H[there] if scenario.H.ndim == 3 else scenario.H
    return observability(
        scenario.F,
        H / largest_of_quantity(training.reading[:, used], p.channels.quantity[used])[:, None],
        names=p.unknowns.state_names,
        frequency=frequency,
        state_amplitude=amplitude,
        largest_strain=1.0,
        raw_scale=p.unknowns.state_scale,
        raw_rows=H,
    )
