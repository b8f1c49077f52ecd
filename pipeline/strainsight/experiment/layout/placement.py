"""Placement of gauges: elimination, exchanges, proof and bound, failures, comparison with other rules, advice."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from strainsight.errors import blame
from strainsight.experiment.layout.advice import Expectation, advice, least_expected, moved_in_words
from strainsight.experiment.layout.comparison import RuleComparison, comparison
from strainsight.experiment.layout.gauge_list import GaugeList
from strainsight.experiment.layout.layout import OptimisedLayout, layout_of, proved
from strainsight.experiment.layout.task import Task
from strainsight.ordering import TIE, tied_order
from strainsight.placement.certificate import certify
from strainsight.placement.elimination import Elimination, eliminate_from
from strainsight.placement.exchange import exchange
from strainsight.placement.failure import loss_if_one_fails
from strainsight.placement.score import score

ROUNDS = 3
"""Most rounds of extending the pool by candidates that the bound does not exclude."""


@dataclass(frozen=True)
class Placement:
    """Result of a placement on a structure or a bench.

    final (k,): pool rows, gauges (k,): numbers of the layout, the most important first; listed: the same as a list; expected: σ
    of a filter on it; loss (k,): metric if each fails, inf if an unknown becomes unobservable, NaN if not solved; others:
    layouts by other rules; advice: sentences."""

    task: Task
    elimination: Elimination
    layout: OptimisedLayout
    final: np.ndarray
    gauges: np.ndarray
    listed: GaugeList
    expected: Expectation
    loss: np.ndarray
    others: RuleComparison
    advice: tuple[str, ...]


class Subject(ABC):
    """Structure or bench on which gauges are placed; gauges (k,): numbers."""

    @abstractmethod
    def tasks(self) -> Sequence[Task]:
        """Task without installation errors, then optionally some with installation errors as noise."""

    @abstractmethod
    def expectation(self, gauges: np.ndarray) -> Expectation:
        """Expected σ of a filter on the gauges."""

    @abstractmethod
    def listed(self, gauges: np.ndarray) -> GaugeList:
        """List of the gauges."""

    def redundant(self, gauges: np.ndarray) -> Sequence[tuple[int, ...]]:
        """Groups of redundant gauges."""
        return ()


def place(subject: Subject, progress: Callable[[str, float], None]) -> Placement:
    """Find the layout of smallest expected σ among the tasks of the subject.

    Raises InfeasibleError if no layout within the limits detects every unknown."""

    @cache
    def expectation_of(gauges: tuple[int, ...]) -> Expectation:
        return subject.expectation(np.array(gauges))

    def expected_of(task: Task, layout: OptimisedLayout) -> Expectation:
        return expectation_of(tuple(task.pool.gauges_of(layout.gauges).tolist()))

    tasks = subject.tasks()
    drafts = [_draft(task, progress) for task in tasks]
    chosen = 0
    if len(tasks) > 1:
        drafted = [expected_of(task, layout) for task, (_, layout) in zip(tasks, drafts, strict=True)]
        chosen = least_expected(drafted, tasks[0].over)
    task, (result, layout) = tasks[chosen], drafts[chosen]
    if task.whole is not None and task.settings.optimise == "metric":
        task, result, layout = _extend_pool(task, result, layout, progress)
    layout = proved(task, layout, result.pools, progress)
    expected, final = _most_important_first(task, expected_of(task, layout), layout.gauges)
    gauges = task.pool.gauges_of(final)
    listed = subject.listed(gauges)
    progress("effect of gauge failures, comparison of placement rules", 0.8)
    if task.single is None or len(final) == len(gauges):
        loss = loss_if_one_fails(task.under(task.pools), final, task.aggregate)
    else:  # one gauge of a mirrored pair fails, not both
        loss = loss_if_one_fails(task.under(task.single(gauges)), np.arange(len(gauges)), task.aggregate)
    words = advice(task, result, layout, listed, expected, loss, subject.redundant(gauges))
    if chosen:
        words = (moved_in_words(expected_of(tasks[0], drafts[0][1]), expected, task.over), *words)
    others = comparison(task, final, result.selected)
    return Placement(task, result, layout, final, gauges, listed, expected, loss, others, words)


def _draft(task: Task, progress: Callable[[str, float], None]) -> tuple[Elimination, OptimisedLayout]:
    """Run elimination and exchanges."""
    progress("elimination", 0.3)
    with blame("place.keep"):
        result = eliminate_from(task.under(task.searched), task.limits, task.aggregate, names=task.unknowns.states)
        layout = layout_of(result.pools, result.selected, task.limits, task.settings, task.aggregate, progress)
    if task.searched is task.pools:
        return result, layout
    pools = tuple(task.under(task.pools))
    cost = np.append(result.cost[:-1], score(pools, result.selected, task.aggregate))
    return (replace(result, cost=cost, pools=pools), replace(layout, cost=score(pools, layout.gauges, task.aggregate)))


def _extend_pool(
    task: Task, result: Elimination, layout: OptimisedLayout, progress: Callable[[str, float], None]
) -> tuple[Task, Elimination, OptimisedLayout]:
    """Extend the pool by candidates that could improve the layout, in rounds that at most double it, and return the best layout.
    Exchanges continue from the layout; a new elimination of the extended pool is a second start."""
    start, cost, before, rounds = layout.gauges, layout.cost, task, ROUNDS if layout.exchange else 1
    for _ in range(rounds):
        whole = task.whole
        assert whole is not None
        progress("lower bound of the criterion over all candidates", 0.55)
        bound = certify(task.under(whole.pools), whole.rows[start], cost, task.aggregate, limits=whole.limits)
        new = np.setdiff1d(np.flatnonzero(bound.including < cost * (1 - TIE)), whole.rows)
        if not len(new):
            break
        new = new[tied_order(bound.including[new])][: len(whole.rows)]
        task = whole.task_with(np.union1d(whole.rows, new))
        start = whole.rows[start] if task.whole is None else np.searchsorted(task.whole.rows, whole.rows[start])
        if layout.exchange:
            start = exchange(task.under(task.searched), start, task.aggregate, limits=task.limits).gauges
            cost = score(task.under(task.pools), start, task.aggregate)
        if task.whole is None:  # the pool has all candidates
            break
    if task is before:
        return task, result, layout
    result, draft = _draft(task, progress)
    continued = (
        exchange(task.under(task.searched), start, task.aggregate, limits=task.limits) if draft.exchange else None
    )
    gauges = start if continued is None else continued.gauges
    cost = score(result.pools, gauges, task.aggregate)
    return task, result, OptimisedLayout(gauges, cost, continued) if cost < draft.cost * (1 - TIE) else draft


def _most_important_first(task: Task, expected: Expectation, rows: np.ndarray) -> tuple[Expectation, np.ndarray]:
    """Sort expectation and pool rows by the increase of σ without each gauge, ties by row."""
    gauges, importance = task.pool.gauges_of(rows), expected.importance(task.over)
    increase = [importance[np.isin(gauges, task.pool.gauges[row])].sum() for row in rows]
    final = rows[tied_order(-np.array(increase))]
    order = np.array([int(np.flatnonzero(gauges == gauge)[0]) for gauge in task.pool.gauges_of(final)])
    return replace(expected, without={name: values[order] for name, values in expected.without.items()}), final
