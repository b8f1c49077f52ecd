"""The placement of gauges: elimination, exchanges, proof and bound, failures, other rules, and what to do with the layout."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.cases.layout.advice import advice
from strainsight.cases.layout.comparison import Comparison, comparison
from strainsight.cases.layout.expectation import Expectation
from strainsight.cases.layout.gauge_list import GaugeList
from strainsight.cases.layout.layout import Layout, layout_of
from strainsight.cases.layout.task import Task
from strainsight.errors import blame
from strainsight.ordering import tied_order
from strainsight.placement.elimination import Elimination, eliminate_from
from strainsight.placement.failure import loss_if_one_fails
from strainsight.placement.scenario import Pool


@dataclass(frozen=True)
class Placed:
    """All that a placement has found, of a structure or of a bench.

    task; elimination of its pool; layout: the best set; final (k,) pool rows and gauges (k,) numbers of the gauges of the
    layout, the most missed first; listed: the same for people; expected: what a filter on it claims; loss (k,): the metric
    when each fails, inf where an unknown is lost, NaN where not solved; others: layouts by other rules; advice in sentences.
    """

    task: Task
    elimination: Elimination
    layout: Layout
    final: np.ndarray
    gauges: np.ndarray
    listed: GaugeList
    expected: Expectation
    loss: np.ndarray
    others: Comparison
    advice: tuple[str, ...]


def placed(
    task: Task,
    claimed: Callable[[np.ndarray], Expectation],
    listed: Callable[[np.ndarray], GaugeList],
    progress: Callable[[str, float], None],
    *,
    alike: Callable[[np.ndarray], Sequence[tuple[int, ...]]] = lambda gauges: (),
    alone: Callable[[np.ndarray], Sequence[Pool]] | None = None,
) -> Placed:
    """The layout that the task asks for.

    Of gauges (k,) by their numbers: claimed, σ that a filter on them comes to claim; listed, the same for people; alike, groups
    that are redundant; alone, where a pool row may be two gauges, the scenarios with these as pool rows of their own.
    Raises InfeasibleError where no layout within the limits detects every unknown.
    """
    settings, limits, metric, pool = task.settings, task.limits, task.metric, task.pool
    progress("elimination", 0.3)
    with blame("place.keep"):
        pools = [own.under(metric) for own in task.pools]
        result = eliminate_from(pools, limits, task.aggregate, names=task.unknowns.states)
        layout = layout_of(result.pools, result.kept, limits, settings, task.aggregate, progress)
    expected, final = _most_missed_first(task, claimed(pool.gauges_of(layout.gauges)), layout.gauges)
    gauges = pool.gauges_of(final)
    own = listed(gauges)
    progress("failures and other rules", 0.8)
    if len(final) == len(gauges) or alone is None:
        loss = loss_if_one_fails(pools, final, task.aggregate)
    else:  # of a mirrored pair one gauge fails, not both
        single = [each.under(metric) for each in alone(gauges)]
        loss = loss_if_one_fails(single, np.arange(len(gauges)), task.aggregate)
    words = advice(task, result, layout, own, expected, loss, alike(gauges))
    others = comparison(task, final, result.kept)
    return Placed(task, result, layout, final, gauges, own, expected, loss, others, words)


def _most_missed_first(task: Task, expected: Expectation, rows: np.ndarray) -> tuple[Expectation, np.ndarray]:
    """What the layout is expected to know, and its pool rows, both in the order in which its gauges are missed; the lower row
    first of those missed alike."""
    gauges, importance = task.pool.gauges_of(rows), expected.importance(task.over)
    missed = [importance[np.isin(gauges, task.pool.gauges[row])].sum() for row in rows]
    final = rows[tied_order(-np.array(missed))]
    order = [int(np.flatnonzero(gauges == gauge)[0]) for gauge in task.pool.gauges_of(final)]
    return expected.ordered(np.array(order)), final
