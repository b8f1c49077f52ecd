"""The placement of gauges: elimination, exchanges, proof and bound, failures, other rules, and what to do with the layout."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from strainsight.cases.layout.advice import advice, moved_in_words
from strainsight.cases.layout.comparison import Comparison, comparison
from strainsight.cases.layout.expectation import Expectation, least_expected
from strainsight.cases.layout.gauge_list import GaugeList
from strainsight.cases.layout.layout import Layout, layout_of, proved
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
    tasks: Sequence[Task],
    claimed: Callable[[np.ndarray], Expectation],
    listed: Callable[[np.ndarray], GaugeList],
    progress: Callable[[str, float], None],
    *,
    alike: Callable[[np.ndarray], Sequence[tuple[int, ...]]] = lambda gauges: (),
    alone: Callable[[np.ndarray, float], Sequence[Pool]] | None = None,
) -> Placed:
    """The layout of least expected σ among those of the tasks, which are the same but for their coherence; the first has none.

    Of gauges (k,) by their numbers: claimed, σ that a filter on them comes to claim; listed, the same for people; alike, groups
    that are redundant; alone, where a pool row may be two gauges, the scenarios of a coherence with these as pool rows of their
    own. Raises InfeasibleError where no layout within the limits detects every unknown.
    """

    @cache
    def expects(rows: tuple[int, ...]) -> Expectation:
        return claimed(tasks[0].pool.gauges_of(np.array(rows)))

    drafts = [_drafted(task, progress) for task in tasks]
    chosen = 0
    if len(tasks) > 1:
        chosen = least_expected([expects(tuple(layout.gauges)) for _, layout in drafts], tasks[0].over)
    task, (result, layout) = tasks[chosen], drafts[chosen]
    pool = task.pool
    with blame("place.keep"):
        layout = proved(layout, result.pools, task.limits, task.settings, task.aggregate, progress)
    expected, final = _most_missed_first(task, expects(tuple(layout.gauges)), layout.gauges)
    gauges = pool.gauges_of(final)
    own = listed(gauges)
    progress("failures and other rules", 0.8)
    if len(final) == len(gauges) or alone is None:
        loss = loss_if_one_fails(task.under(task.pools), final, task.aggregate)
    else:  # of a mirrored pair one gauge fails, not both
        single = task.under(alone(gauges, task.coherence))
        loss = loss_if_one_fails(single, np.arange(len(gauges)), task.aggregate)
    words = advice(task, result, layout, own, expected, loss, alike(gauges))
    if chosen:
        words = (moved_in_words(expects(tuple(drafts[0][1].gauges)), expected, task.over), *words)
    others = comparison(task, final, result.kept)
    return Placed(task, result, layout, final, gauges, own, expected, loss, others, words)


def _drafted(task: Task, progress: Callable[[str, float], None]) -> tuple[Elimination, Layout]:
    """Elimination and exchanges."""
    progress("elimination", 0.3)
    with blame("place.keep"):
        result = eliminate_from(task.under(task.pools), task.limits, task.aggregate, names=task.unknowns.states)
        return result, layout_of(result.pools, result.kept, task.limits, task.settings, task.aggregate, progress)


def _most_missed_first(task: Task, expected: Expectation, rows: np.ndarray) -> tuple[Expectation, np.ndarray]:
    """What the layout is expected to know, and its pool rows, both in the order in which its gauges are missed; the lower row
    first of those missed alike."""
    gauges, importance = task.pool.gauges_of(rows), expected.importance(task.over)
    missed = [importance[np.isin(gauges, task.pool.gauges[row])].sum() for row in rows]
    final = rows[tied_order(-np.array(missed))]
    order = [int(np.flatnonzero(gauges == gauge)[0]) for gauge in task.pool.gauges_of(final)]
    return expected.ordered(np.array(order)), final
