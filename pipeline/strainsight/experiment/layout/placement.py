"""The placement of gauges: elimination, exchanges, proof and bound, failures, other rules, and what to do with the layout."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from strainsight.errors import blame
from strainsight.experiment.layout.advice import Expectation, advice, least_expected, moved_in_words
from strainsight.experiment.layout.comparison import Comparison, comparison
from strainsight.experiment.layout.gauge_list import GaugeList
from strainsight.experiment.layout.layout import Layout, layout_of, proved
from strainsight.experiment.layout.task import Task
from strainsight.ordering import TIE, tied_order
from strainsight.placement.certificate import certify
from strainsight.placement.elimination import Elimination, eliminate_from
from strainsight.placement.exchange import exchange
from strainsight.placement.failure import loss_if_one_fails
from strainsight.placement.scenario import Pool
from strainsight.placement.score import score

ROUNDS = 3
"""Most times that a pool is widened by what the bound over all candidates leaves open."""


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
    pooled: Callable[[np.ndarray], Task] | None = None,
) -> Placed:
    """The layout of least expected σ among those of the tasks, which are the same but for their coherence; the first has none.

    Of gauges (k,) by their numbers: claimed, σ that a filter on them comes to claim; listed, the same for people; alike, groups
    that are redundant; alone, where a pool row may be two gauges, the scenarios of a coherence with these as pool rows of their
    own; pooled, where the task has a part of the candidates in its pool, the task with these.
    Raises InfeasibleError where no layout within the limits detects every unknown.
    """

    @cache
    def expects(gauges: tuple[int, ...]) -> Expectation:
        return claimed(np.array(gauges))

    def expected_of(task: Task, layout: Layout) -> Expectation:
        return expects(tuple(task.pool.gauges_of(layout.gauges).tolist()))

    drafts = [_drafted(task, progress) for task in tasks]
    chosen = 0
    if len(tasks) > 1:
        both = [expected_of(task, layout) for task, (_, layout) in zip(tasks, drafts, strict=True)]
        chosen = least_expected(both, tasks[0].over)
    task, (result, layout) = tasks[chosen], drafts[chosen]
    if pooled is not None and task.whole is not None and task.settings.optimise == "metric":
        task, result, layout = _widened(task, result, layout, pooled, progress)
    pool, whole = task.pool, task.whole
    every = None if whole is None else (task.under(whole.pools), whole.limits, whole.rows)
    with blame("place.keep"):
        searched = () if task.searched is task.pools else task.under(task.searched)
        layout = proved(layout, result.pools, task.limits, task.settings, task.aggregate, progress, every, searched)
    expected, final = _most_missed_first(task, expected_of(task, layout), layout.gauges)
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
        words = (moved_in_words(expected_of(tasks[0], drafts[0][1]), expected, task.over), *words)
    others = comparison(task, final, result.kept)
    return Placed(task, result, layout, final, gauges, own, expected, loss, others, words)


def _drafted(task: Task, progress: Callable[[str, float], None]) -> tuple[Elimination, Layout]:
    """Elimination and exchanges."""
    progress("elimination", 0.3)
    with blame("place.keep"):
        result = eliminate_from(task.under(task.searched), task.limits, task.aggregate, names=task.unknowns.states)
        layout = layout_of(result.pools, result.kept, task.limits, task.settings, task.aggregate, progress)
    if task.searched is task.pools:
        return result, layout
    pools = tuple(task.under(task.pools))
    cost = np.append(result.cost[:-1], score(pools, result.kept, task.aggregate))
    return (
        replace(result, cost=cost, pools=pools),
        replace(layout, cost=score(pools, layout.gauges, task.aggregate)),
    )


def _widened(
    task: Task,
    result: Elimination,
    layout: Layout,
    pooled: Callable[[np.ndarray], Task],
    progress: Callable[[str, float], None],
) -> tuple[Task, Elimination, Layout]:
    """The same with a pool to which every candidate was added that a better layout could have, the likeliest first and at most as
    many again in a round: exchanges lead on from the layout until none is left out, and the elimination of what is then the pool
    is one more start; of the layouts the best."""
    start, cost, before, rounds = layout.gauges, layout.cost, task, ROUNDS if layout.exchange else 1
    for _ in range(rounds):
        whole = task.whole
        assert whole is not None
        progress("bound over all candidates", 0.55)
        found = certify(task.under(whole.pools), whole.rows[start], cost, task.aggregate, limits=whole.limits)
        new = np.setdiff1d(np.flatnonzero(found.including < cost * (1 - TIE)), whole.rows)
        if not len(new):
            break
        new = new[tied_order(found.including[new])][: len(whole.rows)]
        task = pooled(np.union1d(whole.rows, new))
        start = whole.rows[start] if task.whole is None else np.searchsorted(task.whole.rows, whole.rows[start])
        if layout.exchange:
            start = exchange(task.under(task.searched), start, task.aggregate, limits=task.limits).gauges
            cost = score(task.under(task.pools), start, task.aggregate)
        if task.whole is None:  # the pool is every candidate
            break
    if task is before:
        return task, result, layout
    result, own = _drafted(task, progress)
    led_on = exchange(task.under(task.searched), start, task.aggregate, limits=task.limits) if own.exchange else None
    gauges = start if led_on is None else led_on.gauges
    cost = score(result.pools, gauges, task.aggregate)
    return task, result, Layout(gauges, cost, led_on) if cost < own.cost * (1 - TIE) else own


def _most_missed_first(task: Task, expected: Expectation, rows: np.ndarray) -> tuple[Expectation, np.ndarray]:
    """What the layout is expected to know, and its pool rows, both in the order in which its gauges are missed; the lower row
    first of those missed alike."""
    gauges, importance = task.pool.gauges_of(rows), expected.importance(task.over)
    missed = [importance[np.isin(gauges, task.pool.gauges[row])].sum() for row in rows]
    final = rows[tied_order(-np.array(missed))]
    order = [int(np.flatnonzero(gauges == gauge)[0]) for gauge in task.pool.gauges_of(final)]
    return expected.ordered(np.array(order)), final
